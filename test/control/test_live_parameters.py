# SPDX-License-Identifier: Apache-2.0
"""Each parameter of the controller that may change at run time is in force from the next step on."""

import dataclasses

import numpy as np
import pytest

from plsing_ros.control.halt_messages import HaltMessages
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.levels import Level
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation import near_transversal
from plsing_ros.singularities import singular_set

NOW, STEP = 10**12, 4 * 10**7
LINES = read_scene(config_file("paper_p4l.yaml"))
TARGET = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)
START = Pose.from_quaternion(near_transversal.STARTS[1].position, near_transversal.ORIENTATION)
# Near the first transversal, where guard and damping act.
TRANSVERSAL = singular_set(LINES).transversals[0]
FOOT = TRANSVERSAL.point + TRANSVERSAL.direction * (TRANSVERSAL.direction @ (START.translation - TRANSVERSAL.point))
NEAR = Pose(START.rotation, FOOT + 0.15 * (START.translation - FOOT))


def seen(pose, verdict=LinesVerdict.GIVEN, depth=1.0, turn=0.0, shift=0.0, image=0.0):
    """What is seen, with 3-D line 1 turned [rad] and shifted [m], and image line 1 turned [rad]."""
    true = LINES.transformed(pose.inverse(), "camera")
    points, directions = np.array(true.point), np.array(true.direction)
    normal = true.moment[0] / np.linalg.norm(true.moment[0])
    points[0] += shift * normal
    directions[0] += turn * normal
    off = LineSet.from_points_directions(points, directions, true.frame, true.ids)
    observation = LineObservation.of_lines(LineSet(off.direction, depth * off.moment, true.frame, true.ids))
    if image:
        lines, (x, y, z) = np.array(observation.image_lines), observation.image_lines[0]
        lines[0] = [np.cos(image) * x - np.sin(image) * y, np.sin(image) * x + np.cos(image) * y, z]
        observation = dataclasses.replace(observation, image_lines=lines)
    return dataclasses.replace(observation, verdict=verdict, verdict_reason="why")


def answers(servo, first, pose=START, verdict=LinesVerdict.GIVEN, late=0, frames=3, told=0.0, **off):
    """Answer some frames, the camera standing still; what is said and done, as values to compare."""
    result = []
    for k in range(first, first + frames):
        stamp = NOW + k * STEP
        servo.gate.receive(int(Level.WARN), "near", stamp - 5 * 10**6, stamp)
        if told:
            servo.receive_pose(pose, stamp, told**2 * np.eye(6))
        try:
            command = servo.answer(seen(pose, verdict, **off), stamp, stamp + late)
        except ObservationError as error:
            command = servo.halt(str(error))
        result.append((command.mode, command.reason, *command.output, command.scale, command.gain))
    return result


# Parameter, a value that makes a difference, other values with which it does, and what the camera sees.
CASES = [
    ("lines.points", tuple(0.01 + LINES.point.ravel()), {}, {}),
    ("lines.directions", tuple(-LINES.direction.ravel()), {}, {}),
    ("lines.ids", (1, 2, 3, 5), {}, {}),
    ("target.position", tuple(TARGET.translation + 0.01), {}, {}),
    ("target.orientation", tuple(TARGET.integrate([0, 0, 0, 0.1, 0, 0], 1.0).quaternion_xyzw), {}, {}),
    ("target.min_inverse_condition_number", 0.5, {}, {}),
    ("law", "guarded", {}, {"pose": NEAR}),
    ("interaction", "mean", {}, {}),
    ("gain", 0.2, {}, {}),
    ("gain_slope", 0.1, {}, {}),
    ("gain_at_infinity", 0.01, {"gain_slope": 0.1}, {}),
    ("degrees_of_freedom", (1, 1, 1, 1, 1, 0), {}, {}),
    ("secondary_twist", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), {"pinv_threshold": 1e-3}, {}),
    ("integral_gain", 1.0, {}, {}),
    ("integral_limit", 1e-4, {"integral_gain": 1.0}, {}),
    ("pinv_threshold", 1e-3, {}, {}),
    ("damping", 1.0, {"law": "dls"}, {}),
    ("onset", 0.1, {"law": "adaptive_dls"}, {"pose": NEAR}),
    ("max_damping", 1.0, {"law": "adaptive_dls"}, {"pose": NEAR}),
    ("guard.margin", 1.0, {"law": "guarded", "interaction": "current"}, {"pose": NEAR}),
    ("guard.floor", 0.9, {"law": "guarded", "guard.margin": 1.0, "interaction": "current"}, {"pose": NEAR}),
    ("guard.unobservable_share", 1000.0, {"law": "guarded", "interaction": "current"}, {"pose": NEAR}),
    ("detour.margin", 0.4, {"law": "detour"}, {"frames": 60}),
    ("detour.linear_speed", 0.01, {"law": "detour"}, {}),
    ("detour.angular_speed", 1e-3, {"law": "detour"}, {}),
    ("detour.replan_distance", 1e-3, {"law": "detour"}, {"frames": 60}),
    ("detour.pose_onset", 10.0, {"law": "detour"}, {"frames": 60}),
    ("detour.max_scale_error", 0.0, {"law": "detour"}, {"depth": 1.05}),
    ("detour.risk_margin", 0.0, {"law": "detour"}, {"told": 1e-3}),
    ("latency", 0.1, {}, {}),
    ("fused.position_std", 1.0, {"law": "fused"}, {"image": 0.05}),
    ("fused.rotation_std", 1.0, {"law": "fused"}, {"image": 0.05}),
    ("fused.angle_std", 1.0, {"law": "fused"}, {"image": 0.05}),
    ("fused.offset_std", 1.0, {"law": "fused"}, {"image": 0.05}),
    ("fused.map_std", 1.0, {"law": "fused"}, {"image": 0.05}),
    ("camera.half_view", (0.05, 0.05), {"law": "detour"}, {}),
    ("max_linear_speed", 1e-3, {}, {}),
    ("max_angular_speed", 1e-6, {}, {}),
    ("converged_error", 1.0, {}, {}),
    ("stall.error", 1e-3, {"stall.error": 10.0, "stall.ratio": 1.0, "stall.time": 0.0, "max_linear_speed": 1e-3}, {}),
    ("stall.ratio", 1.0, {"stall.time": 0.0, "max_linear_speed": 1e-3}, {}),
    ("stall.time", 100.0, {"stall.ratio": 1.0, "max_linear_speed": 1e-3}, {}),
    ("ambiguous_lines", "ignore", {}, {"verdict": LinesVerdict.AMBIGUOUS}),
    ("poor_lines", "halt", {}, {"verdict": LinesVerdict.POOR}),
    ("slow_scale", 0.9, {}, {"verdict": LinesVerdict.POOR}),
    ("gate_level", "OK", {"gate": "status"}, {}),
    ("gate_timeout", 1e-3, {"gate": "status"}, {}),
    ("features_timeout", 1e-3, {}, {"late": 10**7}),
    ("future_tolerance", 0.0, {}, {"late": -(10**7)}),
    ("tolerance.image", 1e-3, {}, {"image": 0.2}),
    ("tolerance.rotation", 1e-9, {"tolerance.image": 0.17}, {"image": 0.2}),
    ("tolerance.position", 1e-3, {"tolerance.distance": 0.0}, {"shift": 0.02}),
    ("tolerance.distance", 0.0, {}, {"shift": 0.1}),
    ("tolerance.direction", 0.01, {}, {"turn": 0.05}),
    ("tolerance.scale", 0.01, {}, {"depth": 1.15}),
    ("T_tool_camera.position", (0.1, 0.0, 0.0), {"tool_frame": "tool"}, {}),
    ("T_tool_camera.orientation", (1.0, 0.0, 0.0, 0.0), {"tool_frame": "tool"}, {}),
]


def servo_with(values):
    scene = {"lines.points": tuple(LINES.point.ravel()), "lines.directions": tuple(LINES.direction.ravel())}
    task = {
        "target.position": tuple(TARGET.translation),
        "target.orientation": tuple(TARGET.quaternion_xyzw),
    }
    return ServoController.from_parameters(ControllerParameters.from_values({**scene, **task, **values}))


@pytest.mark.parametrize(("name", "value", "others", "situation"), CASES, ids=[case[0] for case in CASES])
def test_it_acts_from_the_next_step_on(name, value, others, situation):
    unchanged, changed = servo_with(others), servo_with(others)
    assert answers(changed, 0, **situation) == answers(unchanged, 0, **situation)
    changed.parameters = changed.parameters.with_values({name: value})
    assert answers(changed, 100, **situation) != answers(unchanged, 100, **situation)


def test_the_number_of_zero_twists_counts_at_once():
    servo, counter = servo_with({}), HaltMessages()
    halted = servo.halt("for the test")
    assert counter.to_be_published(halted, servo.parameters.zero_twists)
    servo.parameters = servo.parameters.with_values({"zero_twists": 1})
    assert not counter.to_be_published(halted, servo.parameters.zero_twists)


def test_no_live_parameter_is_forgotten():
    live = {name for name, (_, each) in ControllerParameters.specifications().items() if each.live}
    assert live == {case[0] for case in CASES} | {"zero_twists"}


def test_the_situations_are_what_they_are_meant_to_be():
    assert np.linalg.norm(NEAR.translation - FOOT) < 0.06


def test_twists_under_way_count_when_a_latency_is_set_while_servoing():
    """The twist of the frame before acts between the next frame and the motion that answers it."""
    start = {"law": "pinv", "gain": 1.0, "max_linear_speed": 0.0, "max_angular_speed": 0.0}
    scene = {"lines.points": tuple(LINES.point.ravel()), "lines.directions": tuple(LINES.direction.ravel())}
    target = {"target.position": TARGET.translation, "target.orientation": TARGET.quaternion_xyzw}
    values = {**scene, **{name: tuple(each) for name, each in target.items()}, **start}
    servo = ServoController.from_parameters(ControllerParameters.from_values(values))
    sent = servo.answer(seen(NEAR), NOW, NOW).twist
    assert np.linalg.norm(sent) > 0.1
    servo.parameters = servo.parameters.with_values({"latency": STEP * 1e-9})
    found = servo.answer(seen(NEAR), NOW + STEP, NOW + STEP).twist
    fresh = ServoController.from_parameters(ControllerParameters.from_values(values))
    expected = fresh.answer(seen(NEAR.integrate(sent, STEP * 1e-9)), NOW, NOW).twist
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
