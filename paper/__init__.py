# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments as data, the record of a run, and its figures."""
