# SPDX-License-Identifier: Apache-2.0
"""Benchmarks: medians, side by side with a peer in the same run. `make bench` runs them all."""
