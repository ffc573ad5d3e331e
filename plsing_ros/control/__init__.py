# SPDX-License-Identifier: Apache-2.0
"""The control laws: from an interaction matrix and a feature error to a twist."""
