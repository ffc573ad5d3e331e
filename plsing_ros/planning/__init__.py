# SPDX-License-Identifier: Apache-2.0
"""Paths round singular loci: planned, checked, and followed."""
