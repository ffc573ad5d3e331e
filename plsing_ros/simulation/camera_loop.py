# SPDX-License-Identifier: Apache-2.0
"""The closed loop from images to joint speeds without ROS: arm, line tracker and controller, in lockstep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.control.servo_controller import Command, ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.pose.line_lifting import lift_lines_at
from plsing_ros.simulation.arm_simulation import ArmSimulation
from plsing_ros.tracking.session import SessionReport, TrackingSession


@dataclass(frozen=True, eq=False)
class LoopFrame:
    """One image of a closed loop, and what became of it.

    Attributes:
        T_world_camera: Where the camera was.
        joints: Of the arm, shape (6,) [rad].
        image: What it saw.
        report: What the tracker said.
        command: The controller's answer.
        remark: What keeps the arm from following it, or empty.
    """

    T_world_camera: Pose
    joints: Array
    image: npt.NDArray[np.uint8]
    report: SessionReport
    command: Command
    remark: str


class CameraLoop:
    """An arm with a wrist camera that servos on an object, in lockstep.

    Args:
        arm: What is simulated.
        controller: The law, the target, and the lines that it uses.
        from_pose: Give the controller the lines as they are seen from the tracked pose; else those in the image.
    """

    def __init__(self, arm: ArmSimulatorParameters, controller: ControllerParameters, from_pose: bool) -> None:
        self.simulation = ArmSimulation(arm)
        self._time_step = arm.time_step
        self._lines: LineSet = controller.lines()
        self._servo = ServoController.from_parameters(controller)
        self._session = TrackingSession(arm.model(), gamma=arm.gamma)
        self._session.set_camera(self.simulation.camera)
        self._from_pose = from_pose

    def frames(self, first: Pose) -> Iterator[LoopFrame]:
        """Yield one frame after the other, without end.

        Args:
            first: T_world_camera that the tracker begins with.
        """
        simulation, session = self.simulation, self._session
        session.set_pose(first)
        twist: Array = np.zeros(6)
        while True:
            pose = session.T_world_camera
            predicted = None if pose is None else pose.integrate(twist, self._time_step)
            report = session.process(simulation.image, predicted)
            command = self._command(report)
            twist = command.twist
            yield LoopFrame(
                simulation.T_world_camera, simulation.joints, simulation.image, report, command, simulation.remark
            )
            simulation.receive_twist(command.twist, simulation.stamp)
            simulation.step_in_lockstep()

    def _command(self, report: SessionReport) -> Command:
        stamp, tracking = self.simulation.stamp, report.tracking
        if not report.usable or tracking is None or tracking.T_world_camera is None:
            return self._servo.halt(report.reason)
        pose = tracking.T_world_camera
        try:
            if self._from_pose:
                seen = LineObservation.of_lines(self._lines.transformed(pose.inverse(), "camera_optical_frame"))
            else:
                seen = lift_lines_at(self._lines, pose, tracking.observation)
            return self._servo.answer(seen, stamp, stamp)
        except PlsingError as error:
            return self._servo.halt(str(error))
