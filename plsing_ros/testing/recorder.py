# SPDX-License-Identifier: Apache-2.0
"""Record topics of a harness into a rosbag2, as `ros2 bag record` does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from plsing_ros.errors import PlsingError


class BagRecorder:
    """Writes each message of some topics as it comes, with the node's time, until it is closed."""

    def __init__(
        self,
        node: Node,
        folder: Path,
        topics: Sequence[tuple[type, str, QoSProfile]],
        now: Callable[[], int] | None = None,
    ) -> None:
        """Open the recording and subscribe.

        Args:
            node: That subscribes.
            folder: Of the recording; must not exist.
            topics: Message type, name and quality of service of each.
            now: Returns the time of a message that comes [ns]; that of the node's clock if not given.

        Raises:
            PlsingError: If rosbags is not installed, the folder exists, or cannot be written.
        """
        try:
            from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
        except ImportError:
            raise PlsingError(
                "recordings are written with the package rosbags: pip install 'plsing_ros[bags]'"
            ) from None
        self._now = now or (lambda: int(node.get_clock().now().nanoseconds))
        try:
            self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except (WriterError, OSError) as error:
            raise PlsingError(f"cannot record to {folder}: {error}; give a folder that does not exist") from None
        store = message_types([kind for kind, _, _ in topics])
        for kind, topic, profile in topics:
            name = type_name(kind)
            connection = self._writer.add_connection(node.resolve_topic_name(topic), name, typestore=store)
            node.create_subscription(kind, topic, self._write_to(connection), profile, raw=True)

    def _write_to(self, connection: Any) -> Callable[[bytes], None]:
        return lambda data: self._writer.write(connection, self._now(), bytes(data))

    def __enter__(self) -> BagRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()


def type_name(kind: type) -> str:
    """Return the name of a message type: "geometry_msgs/msg/Twist"."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"


def message_types(kinds: Sequence[type]) -> Any:
    """Return a type store of rosbags that knows message types, by the definitions in the installed share folders."""
    from ament_index_python import get_package_share_path
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for package in {type_name(kind).split("/")[0] for kind in kinds}:
        for file in sorted((get_package_share_path(package) / "msg").glob("*.msg")):
            name = f"{package}/msg/{file.stem}"
            if name not in store.types:
                store.register(get_types_from_msg(file.read_text(encoding="utf-8"), name))
    return store
