# SPDX-License-Identifier: Apache-2.0
"""Proofs about a singular set: imported by nobody but its command."""
