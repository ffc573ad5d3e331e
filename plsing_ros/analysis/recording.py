# SPDX-License-Identifier: Apache-2.0
"""Recorded runs: the messages of a rosbag2, read without ROS."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plsing_ros.errors import PlsingError

_FEATURES = "plsing_msgs/msg/LineFeatureArray"
# What a replay reads, by the last part of the topic's name.
TYPES = {
    "line_features": _FEATURES,
    "completed_line_features": _FEATURES,
    "desired_line_features": _FEATURES,
    "camera_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "cmd_twist": "geometry_msgs/msg/TwistStamped",
    "singular_loci": "plsing_msgs/msg/SingularLoci",
    "singularity_alerts": "plsing_msgs/msg/SingularityAlert",
}
_METADATA = "metadata.yaml"
_SECOND = 1_000_000_000


class RecordingError(PlsingError):
    """A recording that cannot be read, or lacks what is needed; the message names the file."""


@dataclass(frozen=True)
class RecordedMessage:
    """A message of a recording.

    Attributes:
        topic: The last part of its topic's name, a key of TYPES.
        time: When it was recorded [ns].
        message: Has the fields of its type.
    """

    topic: str
    time: int
    message: Any


def read_recording(bag: str | Path, topics: Sequence[str] = tuple(TYPES)) -> Iterator[RecordedMessage]:
    """Yield the messages of a rosbag2 (SQLite or MCAP) in order of time, those of other topics and types left out.

    Args:
        bag: Folder of the recording, with metadata.yaml.
        topics: Last parts of the names of the topics that are wanted.

    Raises:
        RecordingError: If rosbags is not installed, the bag cannot be read, or none of the topics is in it.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise RecordingError("recordings are read with the package rosbags: pip install 'plsing_ros[bags]'") from None
    path = Path(bag)
    if not path.exists():
        raise RecordingError(f"recording {path} does not exist; give the folder that ros2 bag record has made")
    if path.is_file() and (path.parent / _METADATA).exists():
        path = path.parent
    if path.is_dir() and not (path / _METADATA).exists():
        raise RecordingError(
            f"recording {path} has no {_METADATA}: it is no rosbag2, or its recorder was killed (try ros2 bag reindex)"
        )
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            wanted = [
                connection
                for connection in reader.connections
                if (last := connection.topic.rsplit("/", 1)[-1]) in topics and connection.msgtype == TYPES[last]
            ]
            if not wanted:
                there = (
                    ", ".join(sorted({f"{each.topic} ({each.msgtype})" for each in reader.connections})) or "nothing"
                )
                raise RecordingError(
                    f"recording {path} has none of the topics {', '.join(topics)} with the types of plsing_ros; "
                    f"it has {there or 'nothing'}"
                )
            for connection, time, data in reader.messages(wanted):
                name = connection.topic.rsplit("/", 1)[-1]
                yield RecordedMessage(name, time, reader.deserialize(data, connection.msgtype))
    except PlsingError:
        raise
    except Exception as error:
        # The reader and what it reads with (SQLite, MCAP, compression) raise many kinds for files cut short.
        what = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"recording {path} is broken or no rosbag2: {what}") from None


def stamp_of(message: Any) -> int:
    """Return the stamp of a message's header [ns]."""
    return int(message.header.stamp.sec) * _SECOND + int(message.header.stamp.nanosec)
