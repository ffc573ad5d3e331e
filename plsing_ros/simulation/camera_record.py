# SPDX-License-Identifier: Apache-2.0
"""What a run of the camera demo leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import rotation_vector
from plsing_ros.simulation.camera_scene import CameraScene
from plsing_ros.simulation.run_record import Alert

# At the target is within these [m] and [rad].
NEAR = 2e-3, np.radians(0.3)


@dataclass(frozen=True, eq=False)
class Picture:
    """The tracker's overlay at an instant.

    Attributes:
        time: Since the start [s].
        pixels: In red, green and blue, shape (height, width, 3).
        joints: Of the arm then, shape (6,) [rad].
    """

    time: float
    pixels: npt.NDArray[np.uint8]
    joints: Array


@dataclass(eq=False)
class CameraRecord:
    """What a run leaves, filled while it runs.

    Attributes:
        scene: What was run.
        rows: Time since the start [s], T_world_camera, and distance [m] and angle [rad] to the target, frame by frame.
        pictures: Of the overlay, some.
        twists: Time and commanded twist.
        statuses: Time, inverse condition number, and risk (not a number where there is none).
        alerts: Of the monitor.
        last_words: What each node said last, by its name.
        arrived: Whether it stayed at the target.
    """

    scene: CameraScene
    rows: list[tuple[float, Pose, float, float]] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    twists: list[tuple[float, Array]] = field(default_factory=list)
    statuses: list[tuple[float, float, float]] = field(default_factory=list)
    alerts: list[Alert] = field(default_factory=list)
    last_words: dict[str, str] = field(default_factory=dict)
    arrived: bool = False
    _first_stamp: int | None = None

    def time_of(self, stamp: int) -> float:
        """Return the time since the first frame [s] of a stamp [ns]."""
        return 0.0 if self._first_stamp is None else (stamp - self._first_stamp) * 1e-9

    def add(self, stamp: int, pose: Pose) -> tuple[float, float]:
        """Add a frame, and return its time [s] and the distance from the target [m]."""
        if self._first_stamp is None:
            self._first_stamp = stamp
        off = self.scene.target.inverse() @ pose
        distance, angle = float(np.linalg.norm(off.translation)), float(np.linalg.norm(rotation_vector(off.rotation)))
        self.rows.append((self.time_of(stamp), pose, distance, angle))
        return self.rows[-1][0], distance

    def stays(self, seconds: float) -> bool:
        """Return whether all frames of the last seconds are at the target."""
        if not self.rows or self.rows[-1][0] < seconds:
            return False
        last = [row for row in self.rows if row[0] >= self.rows[-1][0] - seconds]
        return all(distance < NEAR[0] and angle < NEAR[1] for _, _, distance, angle in last)

    @property
    def off_the_line(self) -> float:
        """The largest distance of the camera from the straight line between start and target [m]."""
        start, target = self.scene.start.translation, self.scene.target.translation
        along = (target - start) / np.linalg.norm(target - start)
        away = np.array([pose.translation - start for _, pose, _, _ in self.rows])
        return float(np.linalg.norm(away - np.outer(away @ along, along), axis=1).max())

    def __str__(self) -> str:
        at, _, distance, angle = self.rows[-1]
        text = (
            f"{self.scene.name}: {'arrived' if self.arrived else 'did not arrive'}; after {at:.1f} s "
            f"{1e3 * distance:.2f} mm and {np.degrees(angle):.2f} degrees from the target, at most "
            f"{1e3 * self.off_the_line:.0f} mm off the straight line; {len(self.alerts)} alert(s)"
        )
        words = "; ".join(f"{node}: {said}" for node, said in self.last_words.items() if said)
        return text if self.arrived or not words else f"{text}. {words}"
