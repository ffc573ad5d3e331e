# SPDX-License-Identifier: Apache-2.0
"""Offline questions about scenes, paths and recordings: before and after a run."""
