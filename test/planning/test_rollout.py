# SPDX-License-Identifier: Apache-2.0
"""The native roll-out against the controller itself, step by step, and against closed forms where noise is in it."""

import dataclasses
import math
import sys
import threading
import time
from collections import deque

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import numbers, vectors

from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import LineObservation, interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import ControllerParameters
from plsing_ros.planning.rollout import Harm, LoopModel, RolloutLaw, RolloutTask, RunState, guard_loci
from plsing_ros.singularities import singular_set

# They all meet one line, which passes 0.9 m from the target.
AXIS_POINT, AXIS = np.array([0.4, 1.0, -3.6]), np.array([1.0, 0.1, 0.2])
_POINTS = np.array([[0.8, 0.3, 0.1], [-0.4, 0.7, -0.2], [0.1, -0.8, 0.6], [-0.7, -0.3, -0.5], [0.5, -0.5, 0.4]])
LINES = LineSet.from_points_directions(_POINTS, AXIS_POINT + np.outer([-2.0, 3.0, -0.5, 1.5, -3.5], AXIS) - _POINTS)
LOCI = guard_loci(singular_set(LINES))
TARGET = Pose.look_at([0.3, 0.2, -4.0], [0.0, 0.0, 0.0], down=[0.0, 1.0, 0.0])
LAWS = [("pinv", "auto"), ("pinv", "mean"), ("dls", "current"), ("adaptive_dls", "target"), ("guarded", "auto")]


def controller_parameters(law, interaction="auto", **others):
    return ControllerParameters(
        lines_points=tuple(LINES.point.ravel()),
        lines_directions=tuple(LINES.direction.ravel()),
        target_position=tuple(TARGET.translation),
        target_orientation=tuple(TARGET.quaternion_xyzw),
        law=law,
        interaction=interaction,
        **others,
    )


def task_of(parameters, loop, **others):
    return RolloutTask(LINES, TARGET, RolloutLaw.of_parameters(parameters), loop, loci=LOCI, **others)


def seen_from(camera, noise=None):
    """What the camera sees, with errors of the angles and offsets of its image lines, shape (n, 2)."""
    seen = LineObservation.of_lines(LINES.transformed(camera.inverse(), "camera"))
    if noise is None:
        return seen
    angle = np.arctan2(seen.image_lines[:, 1], seen.image_lines[:, 0]) + noise[:, 0]
    image = np.column_stack([np.cos(angle), np.sin(angle), seen.image_lines[:, 2] + noise[:, 1]])
    return dataclasses.replace(seen, image_lines=image)


def controller_twist(servo, camera, stamp=10**9, noise=None):
    return servo.answer(seen_from(camera, noise), stamp, stamp).twist


def offset_pose(turn, shift):
    return TARGET @ Pose(Rotation.from_rotvec(turn).as_matrix(), shift)


NEAR_TRANSVERSAL = st.builds(
    lambda along, away, turn: Pose(
        (TARGET @ Pose(Rotation.from_rotvec(turn).as_matrix(), np.zeros(3))).rotation,
        LOCI[0, :3] + along * LOCI[0, 3:] + away,
    ),
    numbers(-5.0, 5.0),
    vectors(3, -1e-3, 1e-3),
    vectors(3, -0.5, 0.5),
)
ANYWHERE = st.builds(offset_pose, vectors(3, -1.0, 1.0), vectors(3, -2.0, 2.0))


@pytest.mark.parametrize(("law", "interaction"), LAWS)
@given(camera=ANYWHERE | NEAR_TRANSVERSAL, noise=st.just(np.zeros(10)) | vectors(10, -0.01, 0.01))
def test_twists_are_those_of_the_controller(law, interaction, camera, noise):
    parameters = controller_parameters(law, interaction)
    seen = LINES.transformed(camera.inverse(), "camera")
    assume(np.hypot(*seen.moment[:, :2].T).min() > 1e-3)
    # What rounding leaves of least squares near a singularity is its condition times that of the machine, squared.
    assume(1.0 / np.linalg.cond(interaction_matrix(seen)) > 1e-6)
    try:
        expected = controller_twist(ServoController.from_parameters(parameters), camera, noise=noise.reshape(-1, 2))
    except ObservationError:
        assume(False)
    found = task_of(parameters, LoopModel()).twist(camera, seen_from(camera, noise.reshape(-1, 2)).image_lines)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * max(1.0, np.abs(expected).max()))


def run_in_python(parameters, camera, loop, steps):
    """The same loop with the controller itself, poses moved by the package's exponential."""
    servo = ServoController.from_parameters(parameters)
    queue = deque([np.zeros(6)] * loop.latency)
    motion = np.zeros(6)
    for step in range(steps):
        queue.append(controller_twist(servo, camera, 10**9 + step * 10**7))
        asked = queue.popleft()
        scale = min(
            1.0,
            loop.robot_linear_speed / max(np.linalg.norm(asked[:3]), 1e-300),
            loop.robot_angular_speed / max(np.linalg.norm(asked[3:]), 1e-300),
        )
        asked = asked * scale
        mean = asked
        if loop.lag > 0.0:
            left = math.exp(-loop.period / loop.lag)
            mean = asked + loop.lag / loop.period * (1.0 - left) * (motion - asked)
            motion = asked + left * (motion - asked)
        camera = camera.integrate(mean, loop.period)
    return camera


@pytest.mark.parametrize("law", ["pinv", "dls", "adaptive_dls", "guarded"])
@pytest.mark.parametrize("latency", [0, 3])
def test_the_loop_is_that_of_the_controller_with_latency_lag_and_clamp(law, latency):
    parameters = controller_parameters(law, gain=0.8, max_linear_speed=0.4)
    start = offset_pose([0.3, -0.2, 0.4], [0.5, -0.4, -0.6])
    loop = LoopModel(
        period=0.05, latency=latency, lag=0.08, robot_linear_speed=0.2, robot_angular_speed=0.3, horizon=2.0
    )
    expected = run_in_python(parameters, start, loop, 40)
    found = task_of(parameters, loop).roll_out([start], RunState(100.0, 1.0), 0)
    assert found.steps == 40
    assert found.distance[0] == pytest.approx(np.linalg.norm(expected.translation - TARGET.translation), abs=1e-9)
    angle = np.linalg.norm(Rotation.from_matrix(expected.rotation.T @ TARGET.rotation).as_rotvec())
    assert found.angle[0] == pytest.approx(angle, abs=1e-7)
    assert 0.1 < found.distance[0] < 0.8


@given(camera=ANYWHERE)
def test_position_goes_straight_and_falls_exponentially(camera):
    law = RolloutLaw("position", gain=0.5)
    loop = LoopModel(period=1e-3, horizon=1.0)
    distance = float(np.linalg.norm(camera.translation - TARGET.translation))
    found = RolloutTask(LINES, TARGET, law, loop).roll_out([camera], RunState(1e3, distance), 0)
    # Turning about the moving centre leaves the law of the distance unchanged to the order of a step.
    assert found.distance[0] == pytest.approx(distance * math.exp(-0.5), rel=2e-3, abs=1e-9)


def spread_at_target(task, samples=400):
    found = task.roll_out([TARGET] * samples, RunState(1e4, 1.0), 3)
    assert not found.kind.any()
    return float(np.sqrt(np.mean(found.distance**2)))


def test_covariances_of_features_shake_the_camera_as_linear_theory_says():
    # A discrete first-order loop x' = (1 - a) x + a w, with a = gain * period, has the variance a / (2 - a) var(w).
    covariance = np.array([[4e-6, 1.5e-6, 9e-6]] * len(LINES)) * np.arange(1, 6)[:, np.newaxis]
    law, loop = RolloutLaw("pinv", gain=2.0), LoopModel(period=0.05, horizon=0.999)
    # Below the arrival's duration, so that every sample runs through all its steps.
    seen = LINES.transformed(TARGET.inverse(), "camera")
    image = seen.moment / np.hypot(seen.moment[:, 0], seen.moment[:, 1])[:, np.newaxis]
    noise = np.zeros((15, 15))
    for i, (pp, pr, rr) in enumerate(covariance):
        basis = np.array([[-image[i, 1], image[i, 0], 0.0], [0.0, 0.0, 1.0]])
        noise[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = basis.T @ np.array([[pp, pr], [pr, rr]]) @ basis
    inverse = np.linalg.pinv(interaction_matrix(seen), rcond=1e-12)
    a, steps = law.gain * loop.period, 20
    share = a / (2.0 - a) * (1.0 - (1.0 - a) ** (2 * steps))
    expected = math.sqrt(np.trace((inverse @ noise @ inverse.T)[:3, :3]) * share)
    found = spread_at_target(RolloutTask(LINES, TARGET, law, loop, covariances=covariance))
    assert found == pytest.approx(expected, rel=0.1)


def test_noise_of_segment_ends_is_that_of_lines_drawn_through_noisy_points():
    ends = np.stack([LINES.point - 0.3 * LINES.direction, LINES.point + 0.5 * LINES.direction], axis=1)
    law, loop = RolloutLaw("pinv", gain=20.0), LoopModel(period=0.05, image_noise=1e-4, horizon=0.05)
    # gain * period = 1: after one step the camera is where the noisy image says, to first order.
    generator = np.random.default_rng(5)
    seen = LINES.transformed(TARGET.inverse(), "camera")
    inverse = np.linalg.pinv(interaction_matrix(seen), rcond=1e-12)
    image = (seen.moment / np.hypot(seen.moment[:, 0], seen.moment[:, 1])[:, np.newaxis]).ravel()
    points = (ends - TARGET.translation) @ TARGET.rotation
    points = points[..., :2] / points[..., 2:]
    squares = []
    for _ in range(2000):
        noisy = points + generator.normal(scale=1e-4, size=points.shape)
        across = np.cross(*(np.column_stack([noisy[:, end], np.ones(5)]) for end in (0, 1)))
        across /= np.hypot(across[:, 0], across[:, 1])[:, np.newaxis]
        across *= np.sign(np.sum(across * image.reshape(-1, 3), axis=1))[:, np.newaxis]
        squares.append(np.sum((inverse @ (across.ravel() - image))[:3] ** 2))
    found = spread_at_target(RolloutTask(LINES, TARGET, law, loop, ends=ends), samples=2000)
    assert found == pytest.approx(math.sqrt(np.mean(squares)), rel=0.1)


def test_each_kind_of_harm_is_told_with_its_time():
    ends = np.stack([LINES.point - 0.2 * LINES.direction, LINES.point + 0.2 * LINES.direction], axis=1)
    start = offset_pose([0.0, 0.0, 0.0], [0.3, 0.0, 0.0])
    loop = LoopModel(period=0.02, horizon=30.0)
    law = RolloutLaw("position", gain=1.0)

    def outcome(law=law, loop=loop, deadline=14.0, distance=0.3, start=start):
        found = RolloutTask(LINES, TARGET, law, loop, ends=ends).roll_out([start], RunState(deadline, distance), 0)
        return Harm(found.kind[0]), float(found.harm_time[0])

    assert outcome() == (Harm.NONE, 0.0)
    # exp(-t) 0.3 = 0.05 at 1.79 s, and 1 s more to be there.
    assert outcome(deadline=2.7) == (Harm.LATE, pytest.approx(2.7, abs=0.03))
    assert outcome(deadline=2.9)[0] is Harm.NONE
    # A horizon short of the deadline: late if it goes on as slowly, not if it goes on as fast.
    assert outcome(loop=dataclasses.replace(loop, horizon=1.0), deadline=9.0)[0] is Harm.NONE
    slow = dataclasses.replace(law, max_linear_speed=0.02)
    assert outcome(slow, dataclasses.replace(loop, horizon=1.0), deadline=2.7)[0] is Harm.LATE
    # Told to have begun nearer: it is beyond 1.5 times that at once.
    assert outcome(distance=0.1) == (Harm.AWAY, 0.0)
    narrow = dataclasses.replace(loop, half_view=(0.05, 0.05))
    assert outcome(loop=narrow)[0] is Harm.FEW_LINES


def test_demand_is_the_commanded_speed_over_the_limit_or_the_first_one():
    start = offset_pose([0.0, 0.0, 0.0], [0.8, 0.0, 0.0])
    loop = LoopModel(period=0.02, horizon=20.0, demand_linear_speed=0.25)
    task = RolloutTask(LINES, TARGET, RolloutLaw("position", gain=1.0), loop)
    found = task.roll_out([start], RunState(14.0, 0.8), 0)
    # It begins at 0.8 m/s: 3.2 times the limit, but only 1 / 1.5 of what counts.
    assert found.speed[0] == pytest.approx(3.2)
    assert found.demand[0] == pytest.approx(1.0 / 1.5)
    assert found.demand_time[0] == -1.0
    again = task.roll_out([start], RunState(14.0, 0.8, first_linear_speed=0.1, first_angular_speed=0.1), 0)
    assert again.demand[0] == pytest.approx(3.2)
    assert again.demand_time[0] == 0.0


def test_other_python_threads_run_meanwhile():
    count, done = [0], threading.Event()

    def go_on():
        while not done.is_set():
            count[0] += 1
            time.sleep(1e-5)

    task = RolloutTask(LINES, TARGET, RolloutLaw("pinv", gain=1e-3), LoopModel(period=1e-3, horizon=60.0))
    interval = sys.getswitchinterval()
    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        # This thread is not made to give way for a minute; so what is counted was counted inside of the call.
        sys.setswitchinterval(60.0)
        before = count[0]
        task.roll_out([offset_pose([0.0, 0.0, 0.0], [0.3, 0.0, 0.0])] * 2, RunState(1e6, 0.3), 0)
        assert count[0] > before
    finally:
        sys.setswitchinterval(interval)
        done.set()
        thread.join()


def test_numbers_that_make_no_task_are_refused():
    task = RolloutTask(LINES, TARGET, RolloutLaw(law="unheard_of"), LoopModel())
    with pytest.raises(GeometryError, match="unheard_of"):
        task.roll_out([TARGET], RunState(1.0, 1.0), 0)
    with pytest.raises(GeometryError, match="lag"):
        LoopModel(lag=-1.0)


def test_maps_are_drawn_to_where_the_lines_were_seen():
    # The true focal length is 3 % longer: without residuals a roll-out expects to arrive, with them where it will be.
    ends = np.stack([LINES.point - 0.3 * LINES.direction, LINES.point + 0.5 * LINES.direction], axis=1)
    law = RolloutLaw("pinv", gain=1.0)
    loop = LoopModel(period=0.05, map_noise=0.003, focal_error=0.03, horizon=8.0, stops=False)
    start, factor = offset_pose([0.05, -0.1, 0.1], [0.2, -0.1, -0.2]), 1.03
    servo = ServoController.from_parameters(controller_parameters("pinv", gain=1.0, max_linear_speed=0.0))
    camera = start
    for step in range(160):
        seen = LINES.transformed(camera.inverse(), "camera")
        image = seen.moment / np.hypot(seen.moment[:, 0], seen.moment[:, 1])[:, np.newaxis] * [1.0, 1.0, factor]
        stamp = 10**9 + step * 10**7
        camera = camera.integrate(servo.answer(LineObservation(LINES.ids, image, None, seen), stamp, stamp).twist, 0.05)
    true = np.linalg.norm(camera.translation - TARGET.translation)
    seen = LINES.transformed(start.inverse(), "camera")
    offset = seen.moment[:, 2] / np.hypot(seen.moment[:, 0], seen.moment[:, 1])
    rows = np.column_stack([np.zeros(5), (factor - 1.0) * offset, np.full(5, 1e-8), np.zeros(5), np.full(5, 1e-8)])

    def distances(residuals):
        task = task_of(controller_parameters("pinv", gain=1.0, max_linear_speed=0.0), loop, ends=ends)
        task = dataclasses.replace(task, law=law, residuals=residuals, T_world_camera=start)
        return task.roll_out([start] * 200, RunState(1e4, 10.0), 3).distance

    blind, told = distances(None), distances(rows)
    assert np.median(np.abs(told - true)) < 0.35 * np.median(np.abs(blind - true))
    assert np.median(told) == pytest.approx(true, rel=0.3)
    # What is not known of any line changes nothing.
    np.testing.assert_array_equal(distances(np.full((5, 5), np.nan)), blind)


def test_a_camera_that_has_been_there_for_a_while_arrives_sooner():
    law, loop = RolloutLaw("position", gain=1.0), LoopModel(period=0.1, horizon=5.0)
    task = RolloutTask(LINES, TARGET, law, loop)
    steps = [task.roll_out([TARGET], RunState(9.0, 1.0, arrived_for=since), 0).steps for since in (0.0, 0.55)]
    assert steps == [10, 5]


def test_a_limit_that_scales_commands_is_no_demand():
    law = RolloutLaw("position", gain=1.0, max_linear_speed=0.25)
    task = RolloutTask(LINES, TARGET, law, LoopModel(period=0.02, horizon=9.0, image_noise=1e-3))
    for seed in range(5):
        start = offset_pose([0.1 * seed, 0.0, 0.0], [0.8, 0.1 * seed, 0.0])
        found = task.roll_out([start], RunState(14.0, 0.8, 0.0, 0.01, 0.01), seed)
        assert found.demand[0] <= 1.0 and found.demand_time[0] == -1.0
        assert task.roll_out([start], RunState(14.0, 0.8), seed).first_linear_speed[0] == pytest.approx(0.25)


def test_the_error_of_an_estimated_pose_stays():
    law = RolloutLaw("position", gain=1.0)
    start, believed = offset_pose([0.0, 0.0, 0.0], [0.5, 0.0, 0.0]), offset_pose([0.0, 0.0, 0.0], [0.5, 0.07, 0.0])
    state = RunState(14.0, 0.5)

    def outcome(lasts):
        loop = LoopModel(period=0.05, horizon=14.0, pose_error_lasts=lasts)
        return RolloutTask(LINES, TARGET, law, loop, T_world_camera=believed).roll_out([start], state, 0)

    assert Harm(outcome(False).kind[0]) is Harm.NONE
    late = outcome(True)
    assert Harm(late.kind[0]) is Harm.LATE and late.distance[0] == pytest.approx(0.07, abs=1e-3)


def test_what_a_pose_is_off_by_is_no_way_gone():
    # The sample is 0.3 m from the target where 0.1 m is believed: the run began 0.2 m farther away, too.
    start, believed = offset_pose([0.0, 0.0, 0.0], [0.3, 0.0, 0.0]), offset_pose([0.0, 0.0, 0.0], [0.1, 0.0, 0.0])
    law, loop = RolloutLaw("position", gain=1.0), LoopModel(period=0.05, horizon=14.0)
    task = RolloutTask(LINES, TARGET, law, loop, T_world_camera=believed)
    assert Harm(task.roll_out([start], RunState(14.0, 0.1), 0).kind[0]) is Harm.NONE
    blind = dataclasses.replace(task, T_world_camera=None)
    assert Harm(blind.roll_out([start], RunState(14.0, 0.1), 0).kind[0]) is Harm.AWAY


@pytest.mark.parametrize(("begun", "out_for", "away_at"), [(0, 5.0, 3.0), (16, 1.0, 0.0)])
def test_detour_is_rolled_out_along_what_is_left_of_its_path(begun, out_for, away_at):
    # From a pure rotation 0.5 m aside at 0.1 m/s, and back.
    path = tuple(
        offset_pose([0.0, 0.0, 0.2 * (1.0 - share)], [0.5 - abs(1.0 - 2.0 * share) * 0.5, 0.0, 0.0])
        for share in np.linspace(0.0, 1.0, 41)
    )
    loop = LoopModel(period=0.02, horizon=30.0)
    task = RolloutTask(LINES, TARGET, RolloutLaw("detour", gain=0.5), loop, path=path)
    half_way = dataclasses.replace(task, loop=dataclasses.replace(loop, horizon=out_for))
    found = half_way.roll_out([path[begun]], RunState(60.0, 10.0), 0)
    assert found.distance[0] == pytest.approx(0.5, abs=0.01)
    assert Harm(task.roll_out([path[begun]], RunState(60.0, 10.0), 0).kind[0]) is Harm.NONE
    away = task.roll_out([path[begun]], RunState(60.0, 0.2), 0)
    assert Harm(away.kind[0]) is Harm.AWAY
    assert away.harm_time[0] == pytest.approx(away_at, abs=0.1)
    straight = dataclasses.replace(task, path=())
    assert Harm(straight.roll_out([path[0]], RunState(60.0, 0.0), 0).kind[0]) is Harm.NONE


@given(numbers(0.02, 0.1), numbers(0.02, 0.5), numbers(0.1, 1.5))
def test_steps_are_frames_for_a_second_and_longer_ones_from_then_on(period, later, gain):
    # On the straight way each step leaves the same share of the distance.
    distance, horizon = 0.8, 4.0
    law = RolloutLaw("position", gain=gain)
    loop = LoopModel(period=period, later_period=later, horizon=horizon, stops=False)
    found = RolloutTask(LINES, TARGET, law, loop).roll_out(
        [offset_pose([0.0] * 3, [distance, 0.0, 0.0])], RunState(1e3, distance), 0
    )
    frames = next(k for k in range(1000) if k * period >= 1.0)
    later = max(later, period)
    after = next(k for k in range(1000) if frames * period + k * later >= horizon * (1.0 - 1e-9))
    left = distance * (1.0 - gain * period) ** frames * (1.0 - gain * later) ** after
    assert found.distance[0] == pytest.approx(left, abs=1e-9)


@given(numbers(0.01, 2.0), numbers(0.5, 5.0))
def test_demand_refers_to_the_first_command_where_that_is_known(first, gain):
    task = RolloutTask(LINES, TARGET, RolloutLaw("position", gain=gain), LoopModel(period=1e-3, horizon=0.5))
    answer = np.array([0.0, 0.0, first, 0.0, 0.0, 0.0])
    start = offset_pose([0.0] * 3, [0.8, 0.0, 0.0])
    found = task.roll_out([start], RunState(1e3, 0.8, answer=answer), 0)
    assert found.first_linear_speed[0] == pytest.approx(first)
    # From the second frame on the law commands what it does at a distance of about 0.8 m.
    largest = max(first, gain * 0.8) / max(0.25, 1.5 * first)
    assert found.demand[0] == pytest.approx(largest, rel=0.03)
