# SPDX-License-Identifier: Apache-2.0
"""A simulated camera and whole servo runs, without ROS."""
