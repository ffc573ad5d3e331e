# SPDX-License-Identifier: Apache-2.0
"""A target that cannot be held, a scene that loses what nobody asked for, and twists of another law."""

import math

import numpy as np
import pytest
from messages import mentions
from near_transversal_scene import LOOK, SCENE, SECOND, TARGET

from plsing_ros.features import LineObservation, interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.shaking import expected_shaking
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.planning.rollout import LoopModel, RolloutLaw, RolloutTask

STEP = SECOND // 30


def watch(monitor, pose, frames, twist_of=None, scene=SCENE, covariances=None):
    """Show a camera at rest to a monitor, and the twists that a controller sends; return what is said last."""
    for _ in range(frames):
        monitor.now = getattr(monitor, "now", 10**12) + STEP
        lines = scene.transformed(pose.inverse(), "camera")
        seen = LineObservation.of_lines(lines)
        if covariances is not None:
            seen = LineObservation(seen.ids, seen.image_lines, seen.usable, seen.lines_camera, covariances=covariances)
        monitor.receive_pose(pose, monitor.now)
        found = monitor.answer(seen, monitor.now, monitor.now)
        if twist_of is not None:
            monitor.receive_twist(twist_of(seen), monitor.now)
    return found


def test_the_expected_shaking_is_that_of_linear_theory():
    # x' = (1 - a) x - a w with a = gain * period has the variance a / (2 - a) var(w).
    points = np.array([[0.8, 0.3, 0.1], [-0.4, 0.7, -0.2], [0.1, -0.8, 0.6], [-0.7, -0.3, -0.5], [0.5, -0.5, 0.4]])
    directions = [[1.0, 0.2, 0.1], [0.1, 1.0, -0.3], [0.3, -0.2, 1.0], [1.0, -1.0, 0.4], [0.2, 0.7, 0.6]]
    scene = LineSet.from_points_directions(points, directions)
    target = Pose.look_at([0.3, 0.2, -4.0], [0.0, 0.0, 0.0], down=[0.0, 1.0, 0.0])
    covariances = np.array([[4e-6, 1.5e-6, 9e-6]] * 5)
    law, loop = RolloutLaw("pinv", gain=1.0), LoopModel(period=0.05, map_noise=0.5)
    seen = scene.transformed(target.inverse(), "camera")
    image = seen.moment / np.hypot(seen.moment[:, 0], seen.moment[:, 1])[:, np.newaxis]
    noise = np.zeros((15, 15))
    for i, (pp, pr, rr) in enumerate(covariances):
        basis = np.array([[-image[i, 1], image[i, 0], 0.0], [0.0, 0.0, 1.0]])
        noise[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = basis.T @ np.array([[pp, pr], [pr, rr]]) @ basis
    inverse = np.linalg.pinv(interaction_matrix(seen), rcond=1e-12)
    a = law.gain * loop.period
    expected = math.sqrt(np.trace((inverse @ noise @ inverse.T)[:3, :3]) * a / (2.0 - a))
    task = RolloutTask(scene, target, law, loop, covariances=covariances)
    assert expected_shaking(task, 200, 1, 10**6) == pytest.approx(expected, rel=0.15)


def test_a_target_that_cannot_be_held_is_named_with_the_motion_and_the_size():
    # 10 cm from the transversal, a pixel of noise moves the camera along it by far more than across it.
    near = Pose(LOOK, TARGET.translation + [-0.28, 0.28, -0.28])
    calm, shaken = (SingularityMonitor(SCENE, near, camera={"image_noise": noise}, gain=0.5) for noise in (0.0, 2e-3))
    assert "target" not in watch(calm, near, 20).reason
    found = watch(shaken, near, 20)
    assert found.level in (Level.WARN, Level.CRITICAL)
    assert found.risk.shaking > 0.05
    assert "shaking" in found.kind and mentions(found.reason, "target", "translation", "transversal 1")
    assert f"{found.risk.shaking:.2g} m" in found.reason


CORRIDOR = LineSet.from_points_directions([[0, 0, 0], [4, 0, 0], [0, 3, 0], [4, 3, 0]], [[0, 0, 1]] * 4)
MIDDLE = Pose.from_quaternion([2.2, 1.4, 5.0], [0.0, 0.0, 0.0, 1.0])


def test_a_corridor_is_healthy_for_who_asks_for_no_motion_along_it():
    target = Pose.from_quaternion([2.0, 1.5, 9.0], [0.0, 0.0, 0.0, 1.0])
    everything = watch(SingularityMonitor(CORRIDOR, target), MIDDLE, 3, scene=CORRIDOR)
    assert everything.level is Level.UNOBSERVABLE
    used = {"degrees_of_freedom": [1, 1, 0, 1, 1, 1]}
    without = SingularityMonitor(CORRIDOR, target, **used)
    found = watch(without, MIDDLE, 3, scene=CORRIDOR)
    assert found.level is Level.OK, found.reason
    # Four metres short of the target along the corridor is no harm.
    assert found.risk.probability < 0.1
    assert without.assess_pose(MIDDLE).level is Level.OK
    # In the plane of all lines a motion is lost that is asked for.
    flat = LineSet.from_points_directions([[0, 0, 0], [0, 1, 0], [0, 2, 0], [0, 3, 0]], [[0, 0, 1]] * 4)
    inside = Pose.from_quaternion([0.0, 1.4, 5.0], [0.0, 0.0, 0.0, 1.0])
    assert SingularityMonitor(flat, target, **used).assess_pose(inside).level is not Level.OK


def plain(gain, factor=1.0):
    target_image = LineObservation.of_lines(SCENE.transformed(TARGET.inverse(), "camera")).image_lines.ravel()

    def twist(seen):
        error = seen.image_lines.ravel() - target_image
        return -factor * gain * np.linalg.lstsq(interaction_matrix(seen.lines_camera), error, rcond=1e-12)[0]

    return twist


def test_twists_that_are_not_those_of_the_law_are_noticed_and_the_law_is_not_relied_on():
    start = Pose(LOOK, TARGET.translation + [0.2, -0.2, 0.2])
    options = {"gain": 0.5, "max_linear_speed": 0.0, "max_angular_speed": 0.0}

    def said(twist_of):
        return watch(SingularityMonitor(SCENE, TARGET, **options), start, 40, twist_of)

    for same in (plain(0.5), plain(0.5, 0.4)):
        found = said(same)
        assert found.risk is not None and "pinv" not in found.reason
    for other in (plain(0.5, 2.0), lambda seen: np.array([0.1, 0.0, 0.05, 0.0, 0.1, 0.0]), plain(0.5, -1.0)):
        found = said(other)
        assert found.risk is None and mentions(found.reason, "twists", "pinv")
        assert "other law" in found.kind
