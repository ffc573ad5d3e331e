# SPDX-License-Identifier: Apache-2.0
"""Commands: thin, the work is elsewhere."""
