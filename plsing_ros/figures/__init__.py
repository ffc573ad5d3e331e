# SPDX-License-Identifier: Apache-2.0
"""Pictures of scenes and servo runs."""
