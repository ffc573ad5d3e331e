# SPDX-License-Identifier: Apache-2.0
"""Run a servo task of experiments/ through the real simulator and controller, in lockstep over the real topics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plsing_msgs.msg import ControllerState, LineFeatureArray, SimulatorState
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.conversions import (
    features_message,
    header,
    observation_from_message,
    twist_from_message,
)
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.pose_conversions import camera_pose_from_message
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.simulation.servo_run import RunRows
from plsing_ros.simulation.servo_task import ServoTask
from plsing_ros.simulation.stepping import FIRST_STAMP
from plsing_ros.testing.harness import Harness
from plsing_ros.testing.synchronizer import RELIABLE, FrameSynchronizer, stamp_of

_SECOND = 1_000_000_000

# The simulator's features on their way to the source of moving targets, and when their target has been delivered.
_HELD_FEATURES, _RELEASED_FEATURES = "held_line_features", "released_line_features"


def run_in_nodes(
    task: ServoTask,
    on_frame: Callable[[int, float], None] = lambda number, distance: None,
    executor: str = "events",
) -> RunRecord:
    """Run a task from its start until it arrives, is lost, or its time is over.

    Args:
        task: What to run.
        on_frame: Called with each frame's number and distance to where the camera shall be [m].
        executor: As in plsing_ros.nodes.main.make_executor.

    Raises:
        PlsingError: If a parameter is refused, the loop stops, a message was lost, or the controller answered a frame
            with the target of another one.
    """
    with Harness(executor, log_level="FATAL") as ros:
        frames = FrameSynchronizer(ros)
        simulator_states = ros.collect(SimulatorState, "feature_simulator/state", RELIABLE)
        ros.add(ControllerNode, parameters={"use_sim_time": True, **task.controller_values()})
        source = _TargetSource(ros, task) if task.moving else None
        simulator = ros.add(
            FeatureSimulatorNode,
            parameters={"publish_clock": True, **task.simulator_values()},
            remap={"line_features": _HELD_FEATURES} if source else {},
        )
        scene_frame, camera_frame = simulator.parameters.scene_frame, simulator.parameters.camera_frame
        time_step = round(task.time_step * _SECOND)
        rows = RunRows(task)
        while not rows.ended:
            stamp = FIRST_STAMP + len(rows) * time_step

            def refused() -> bool:
                # The twist of the frame before; at the very first frame the simulator waits as a matter of course.
                latest = simulator_states[-1] if len(rows) > 1 else None
                return latest is not None and latest.waiting and stamp_of(latest) == stamp - time_step

            ros.spin_until(
                lambda: refused() or frames.have_come(stamp),
                f"frame {len(rows) + 1} of {task.name}",
            )
            if not frames.have_come(stamp):
                rows.ended = f"lost: {simulator_states[-1].reason}"
                break
            pose, twist, state = frames.of(stamp)
            if source is not None:
                source.check(state)
            distance = rows.add(
                camera_pose_from_message(pose, scene_frame).translation,
                twist_from_message(twist, camera_frame),
                state.error_norm,
                state.inverse_condition_number,
            )
            on_frame(len(rows), distance)
        return rows.record()


class _TargetSource:
    """Publishes s* for each frame and lets the frame's features pass when s* has been delivered.

    Two topics have no order, so features that were not held back could overtake their s*. An executor that polls hands
    over what has arrived in any order, too: released features go through one more topic, so that the controller has
    been given what arrived together with the news that s* has been delivered.
    """

    def __init__(self, ros: Harness, task: ServoTask) -> None:
        self._task = task
        self._held: LineFeatureArray | None = None
        self._delivered = 0
        self._error_norms: dict[int, float] = {}
        self._features = ros.node.create_publisher(LineFeatureArray, "line_features", qos.SENSOR_DATA)
        self._released = ros.node.create_publisher(LineFeatureArray, _RELEASED_FEATURES, qos.STATUS)
        self._targets = ros.node.create_publisher(LineFeatureArray, "desired_line_features", qos.LATCHED)
        ros.node.create_subscription(LineFeatureArray, _HELD_FEATURES, self._on_features, qos.SENSOR_DATA)
        ros.node.create_subscription(LineFeatureArray, _RELEASED_FEATURES, self._features.publish, qos.STATUS)
        ros.node.create_subscription(LineFeatureArray, "desired_line_features", self._on_desired, qos.LATCHED)
        # Of the targets there are two listeners: the controller, and this source.
        wanted = ((self._features, 1), (self._released, 1), (self._targets, 2))
        ros.spin_until(
            lambda: all(each.get_subscription_count() >= count for each, count in wanted), "the controller to listen"
        )

    def _on_features(self, message: LineFeatureArray) -> None:
        stamp = stamp_of(message)
        if self._delivered == stamp:
            # A frame that is published again.
            self._features.publish(message)
            return
        self._held = message
        frame = message.header.frame_id
        target = self._task.target_observation((stamp - FIRST_STAMP) / _SECOND, frame)
        self._error_norms[stamp] = _error_norm(observation_from_message(message, frame), target)
        self._targets.publish(features_message(target, header(stamp, frame)))

    def _on_desired(self, message: LineFeatureArray) -> None:
        if self._held is not None and stamp_of(message) == stamp_of(self._held):
            self._delivered = stamp_of(message)
            self._released.publish(self._held)

    def check(self, state: ControllerState) -> None:
        """Raise PlsingError unless the controller used the s* of this frame, by the error norm that it reports."""
        expected = self._error_norms.pop(stamp_of(state))
        if state.mode != ControllerState.MODE_HALTED and abs(state.error_norm - expected) > 1e-9 * (1.0 + expected):
            raise PlsingError(
                f"at {stamp_of(state) / _SECOND:g} s the controller reports the error norm {state.error_norm:.9g}; "
                f"with the target of this frame it is {expected:.9g}: a message was overtaken"
            )


def _error_norm(seen: LineObservation, target: LineObservation) -> float:
    wanted = dict(zip(target.usable_ids, target.usable_image_lines, strict=True))
    pairs = zip(seen.usable_ids, seen.usable_image_lines, strict=True)
    return float(np.linalg.norm([line - wanted[i] for i, line in pairs if i in wanted]))
