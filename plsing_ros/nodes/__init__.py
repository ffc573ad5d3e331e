# SPDX-License-Identifier: Apache-2.0
"""The ROS nodes: they convert, delegate and publish. The only place that imports rclpy or messages."""
