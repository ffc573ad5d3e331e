# SPDX-License-Identifier: Apache-2.0
"""Plans from a process of their own: the same plans, nobody waits for them, and a process that ends is replaced."""

import os
import signal
import threading
import time

import pytest
from messages import mentions

from plsing_ros.control.command import Mode
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.planning.detour import plan_path
from plsing_ros.planning.planner import PlanNow, PlanProcess
from plsing_ros.simulation import near_transversal
from plsing_ros.singularities import singular_set

LINES = read_scene(config_file("paper_p4l.yaml"))
START = Pose.from_quaternion([0.9962, -4.437, 7.8], near_transversal.ORIENTATION)
TARGET = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)


@pytest.fixture(scope="module")
def planner():
    made = PlanProcess()
    yield made
    made.close()


def waited_for(answer):
    end = time.monotonic() + 60.0
    while (found := answer.result()) is None:
        assert time.monotonic() < end
        time.sleep(0.01)
    return found


def test_plans_are_those_of_the_function_itself(planner):
    singular = singular_set(LINES)
    asked = planner.ask(plan_path, singular, START, TARGET)
    there, here = waited_for(asked), PlanNow().ask(plan_path, singular, START, TARGET).result()
    assert there.decision is here.decision and there.reason == here.reason
    for one, other in zip(there.path.sampled(20), here.path.sampled(20), strict=True):
        assert one.is_close(other, 1e-12)


def test_a_question_that_fails_is_said_and_the_next_one_answered(planner):
    with pytest.raises(ObservationError, match=r"\bpath\b"):
        waited_for(planner.ask(plan_path, "no singular set", START, TARGET))
    assert waited_for(planner.ask(abs, -2)) == 2


def test_a_process_that_is_killed_is_replaced(planner):
    assert waited_for(planner.ask(abs, -1)) == 1
    os.kill(planner._process.pid, signal.SIGKILL)
    with pytest.raises(ObservationError, match="ended"):
        waited_for(planner.ask(time.sleep, 10.0))
    assert waited_for(planner.ask(abs, -3)) == 3


class Later:
    """Gives its plans when it is told to."""

    def __init__(self):
        self.ready, self.asked = threading.Event(), 0

    def ask(self, *_):
        self.asked += 1
        return self

    def result(self):
        return plan_path(singular_set(LINES), START, TARGET) if self.ready.is_set() else None


def test_the_camera_stands_until_the_plan_is_there():
    values = {
        "lines.points": LINES.point.ravel().tolist(),
        "lines.directions": LINES.direction.ravel().tolist(),
        "target.position": near_transversal.TARGET_POSITION,
        "target.orientation": near_transversal.ORIENTATION,
        "law": "detour",
    }
    planner = Later()
    servo = ServoController.from_parameters(ControllerParameters.from_values(values), planner)
    seen = LineObservation.of_lines(LINES.transformed(START.inverse(), "camera"))
    for k in range(3):
        command = servo.answer(seen, k + 1, k + 1)
        assert command.mode is Mode.HALTED and mentions(command.reason, "path", "planned") and not command.twist.any()
    assert planner.asked == 1
    planner.ready.set()
    modes = [servo.answer(seen, k, k) for k in (10**8, 2 * 10**8)]
    assert all(each.mode is Mode.SERVOING for each in modes) and modes[1].twist.any()
    assert planner.asked == 1
