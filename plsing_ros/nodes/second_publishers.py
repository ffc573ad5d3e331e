# SPDX-License-Identifier: Apache-2.0
"""Others that publish what only one node should."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node


class SecondPublishers:
    """Looks now and then whether topics have more than one publisher.

    Attributes:
        text: Which ones do, and who they are, or "".
    """

    def __init__(self, node: Node, topics: Sequence[str]) -> None:
        """Begin without having looked.

        Args:
            node: Whose names the topics are resolved by.
            topics: That should have one publisher at most.
        """
        self._node, self._topics = node, topics
        self.text = ""

    def look(self) -> bool:
        """Look, and return whether the text has changed."""
        before = self.text
        self.text = "; ".join(filter(None, map(self._of_topic, self._topics)))
        return self.text != before

    def _of_topic(self, topic: str) -> str:
        count = self._node.count_publishers(topic)
        if count < 2:
            return ""
        found = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
        names = sorted({f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in found})
        return f"{topic} has {count} publishers ({', '.join(names)}), but should have one"
