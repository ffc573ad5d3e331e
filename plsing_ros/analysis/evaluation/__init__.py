# SPDX-License-Identifier: Apache-2.0
"""Is a task safe with one's own lines, noise and robot? Runs of it, and what monitor, laws and pose filter say."""
