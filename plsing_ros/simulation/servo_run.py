# SPDX-License-Identifier: Apache-2.0
"""Run a servo task without ROS: the simulated camera and the controller's cycle, in lockstep."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.servo_controller import Command, ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.parameters import ControllerParameters, SimulatorParameters
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.simulation.servo_task import LOST, ServoTask
from plsing_ros.simulation.simulation import Simulation


class RunRows:
    """The rows of a record while the run goes on, and when it ends."""

    def __init__(self, task: ServoTask) -> None:
        self._task = task
        self._rows: list[tuple[float, Array, Array, float, float, Array]] = []
        self.ended = ""
        self._arrived = False

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, position: Array, twist: Array, error_norm: float, inverse_condition_number: float) -> float:
        """Add a frame and return the distance to where the camera shall be [m]; afterwards `ended` may say why it ends.

        Args:
            position: Camera centre in the scene frame, shape (3,) [m].
            twist: Commanded (v, omega), shape (6,).
            error_norm: |s - s*|.
            inverse_condition_number: Of the matrix that the controller inverts.
        """
        task = self._task
        time = len(self._rows) * task.time_step
        asked = task.path.position(time)
        self._rows.append((time, position, twist, error_norm, inverse_condition_number, asked))
        distance = float(np.linalg.norm(position - asked))
        if task.arrived and distance <= task.arrived:
            self._arrived, self.ended = True, "arrived"
        elif distance > LOST:
            self.ended = f"lost: {distance:.3g} m away"
        elif len(self._rows) >= task.max_steps:
            self.ended = "time is over"
        return distance

    def record(self) -> RunRecord:
        """Return the record of all rows."""
        time, position, twist, error_norm, inverse, asked = (
            np.array(column) for column in zip(*self._rows, strict=True)
        )
        changes = tuple(piece.reason for piece in self._task.followed.pieces)
        return RunRecord(
            self._task.name,
            time,
            position,
            twist,
            error_norm,
            inverse,
            asked,
            self._arrived,
            (),
            self.ended,
            changes,
        )


def run_in_core(task: ServoTask) -> RunRecord:
    """Run a task from its start until it arrives, is lost, or its time is over.

    Raises:
        PlsingError: If the task's parameters are not allowed.
    """
    parameters = SimulatorParameters.from_values(task.simulator_values())
    simulation = Simulation(parameters)
    servo = ServoController.from_parameters(ControllerParameters.from_values(task.controller_values()))
    rows = RunRows(task)

    def retarget() -> None:
        if task.moving:
            servo.set_target(task.target_observation(len(rows) * task.time_step, parameters.camera_frame))

    for pose, command in servo_frames(simulation, servo, retarget):
        rows.add(pose.translation, command.twist, command.error_norm, command.inverse_condition_number)
        if rows.ended:
            break
    else:
        rows.ended = f"lost: {simulation.reason}"
    return rows.record()


def servo_frames(
    simulation: Simulation, servo: ServoController, before_frame: Callable[[], None] = lambda: None
) -> Iterator[tuple[Pose, Command]]:
    """Yield T_world_camera at each frame of a simulation and the controller's answer to it, until the camera is lost.

    Args:
        simulation: In mode lockstep.
        servo: The controller, which answers as its node does.
        before_frame: Called before each answer.
    """
    while True:
        before_frame()
        try:
            command = servo.answer(simulation.observation, simulation.stamp, simulation.stamp)
        except PlsingError as error:
            command = servo.halt(str(error))
        yield simulation.T_world_camera, command
        simulation.receive_twist(command.twist, simulation.stamp)
        if not simulation.step_in_lockstep():
            return
