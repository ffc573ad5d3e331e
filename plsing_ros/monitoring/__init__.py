# SPDX-License-Identifier: Apache-2.0
"""How near the camera is to a singularity: numbers, levels, and what lies ahead."""
