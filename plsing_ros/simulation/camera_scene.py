# SPDX-License-Identifier: Apache-2.0
"""The runs of the camera demo: an arm that comes to its target, and one whose path crosses a transversal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.model import Model
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.options import flatten_options
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.parameters.scene import scene_values

SCENE_FILE = "camera_arm.yaml"
_MIDDLE = (0.0, 0.0, 0.04)  # of the object [m]


@dataclass(frozen=True, eq=False)
class CameraScene:
    """A start, a target, and the law that shall lead there.

    Attributes:
        name: Short, for files and tables.
        note: What is to be seen, as a sentence.
        start: T_world_camera at the start.
        target: T_world_camera at the target.
        law: Of the controller.
        ids: Of the edges that controller and monitor use; all if empty.
        must_arrive: Whether the demo fails if it does not arrive.
        max_time: To give up after [s].
    """

    name: str
    note: str
    start: Pose
    target: Pose
    law: str
    ids: tuple[int, ...]
    must_arrive: bool
    max_time: float

    @staticmethod
    def model() -> Model:
        """Return the object."""
        return ArmSimulatorParameters.from_values(read_parameters(config_file(SCENE_FILE), "arm_simulator")).model()

    def lines(self) -> LineSet:
        """Return the lines that controller and monitor use."""
        lines = self.model().lines()
        return lines.select([lines.ids.index(each) for each in self.ids or lines.ids])

    def values(self, node: str) -> dict[str, Any]:
        """Return what a node's parameters are beside those of the scene file, by ROS name."""
        if node == "arm_simulator":
            return flatten_options({"start": self.start})
        if node not in ("controller", "singularity_monitor"):
            return {}
        values: dict[str, Any] = flatten_options({"target": self.target})
        values["law"] = self.law
        if node == "singularity_monitor":
            values["target.known"] = True
        if self.ids:
            values |= scene_values(self.lines())
        return values


def camera_scenes() -> tuple[CameraScene, ...]:
    """Return the runs in order."""
    file = config_file(SCENE_FILE)
    start = ArmSimulatorParameters.from_values(read_parameters(file, "arm_simulator")).start_pose()
    controller = read_parameters(file, "controller")
    target = Pose.from_quaternion(controller["target.position"], controller["target.orientation"])
    # The middle of this path is on the transversal of edges 6, 8, 9 and 10 that is parallel to edges 6 and 8.
    left, right = (Pose.look_at((x, -0.35, 0.2489), _MIDDLE) for x in (-0.1139, 0.0361))
    return (
        CameraScene("approach", "15 cm and 15 degrees to the target", start, target, "position", (), True, 40.0),
        CameraScene(
            "crossing_plain",
            "across a transversal of four edges by the plain law, which sees these four",
            left,
            right,
            "pinv",
            (6, 8, 9, 10),
            False,
            15.0,
        ),
        CameraScene(
            "crossing_fused", "the same way by the law fused, with all edges", left, right, "fused", (), True, 40.0
        ),
    )
