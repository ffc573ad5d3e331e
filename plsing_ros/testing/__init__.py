# SPDX-License-Identifier: Apache-2.0
"""The harness and the lockstep runner, for users' tests too: with nodes/ the only place that imports rclpy."""
