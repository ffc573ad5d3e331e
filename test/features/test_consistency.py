# SPDX-License-Identifier: Apache-2.0
"""Contradictory features are named, consistent ones pass: of the paper's four lines and of any others."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from messages import mentions
from scipy.spatial.transform import Rotation
from strategies import numbers, vectors

from plsing_ros.features import LineObservation
from plsing_ros.features.consistency import ConsistencyCheck, Tolerances
from plsing_ros.features.near_pairs import exchanged_pair
from plsing_ros.geometry import LineSet, Pose

PAPER = LineSet.from_points_directions(
    [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [3.0, 5.0, 0.0], [0.0, 1.0, 7.0]],
    [[1.0, 0.0, 0.0], [4.0, -5.0, 0.0], [3.0, 7.0, 3.0], [-2.0, 1.0, 13.0]],
)
ORIENTATION = [0.9646013342952592, 0.043968296314734305, -0.011839951836364137, -0.2597515550203657]
CAMERA = Pose.from_quaternion([0.9962, -4.437, 7.8], ORIENTATION)


def seen_from(pose=CAMERA, scene=PAPER):
    return LineObservation.of_lines(scene.transformed(pose.inverse(), "camera"))


def changed(seen, image=1.0, direction=1.0, moment=1.0, ids=None):
    lines = seen.lines_camera
    ids = seen.ids if ids is None else ids
    in_space = LineSet(lines.direction * direction, lines.moment * moment, "camera", ids)
    return LineObservation(ids, seen.image_lines * image, seen.usable, in_space)


def signs(*negative, n=4):
    return np.array([[-1.0 if row + 1 in negative else 1.0] for row in range(n)])


def contradiction(seen, told=None, scene=PAPER):
    return ConsistencyCheck(scene).contradiction(seen, told)


def test_consistent_features_pass_with_and_without_a_scene():
    seen = seen_from()
    assert contradiction(seen, CAMERA) is None
    assert ConsistencyCheck(None).contradiction(seen) is None
    assert ConsistencyCheck(PAPER).unchecked(seen) == ""


@pytest.mark.parametrize("focal_length", [50.0, 500.0, -500.0])
def test_offsets_in_pixels(focal_length):
    reason = contradiction(changed(seen_from(), image=np.array([1.0, 1.0, focal_length])))
    assert reason is not None and mentions(reason, f"{focal_length:.3g} times", "pixels")


@pytest.mark.parametrize("negative", [(1,), (3,), (2, 4), (1, 2, 3, 4)])
def test_negated_image_lines_are_named(negative):
    reason = contradiction(changed(seen_from(), image=signs(*negative)))
    named = ", ".join(map(str, negative))
    assert reason is not None and mentions(reason, f"line{'s' if len(negative) > 1 else ''} {named}", "turned round")


@pytest.mark.parametrize("negative", [(1,), (2,), (3,), (4,), (1, 3), (2, 3)])
def test_reversed_lines_are_named(negative):
    sign = signs(*negative)
    reason = contradiction(changed(seen_from(), sign, sign, sign))
    named = ", ".join(map(str, negative))
    assert reason is not None and f"line{'s' if len(negative) > 1 else ''} {named} " in reason and "reversed" in reason


def test_offsets_made_positive_as_hough_transforms_give_them():
    seen = seen_from()
    sign = np.where(seen.image_lines[:, 2:] < 0.0, -1.0, 1.0)
    assert 0 < np.count_nonzero(sign < 0.0) < 4
    assert "turned round" in contradiction(changed(seen, image=sign))
    assert "reversed" in contradiction(changed(seen, sign, sign, sign))


def test_ids_that_are_exchanged_are_named():
    assert mentions(contradiction(changed(seen_from(), ids=(2, 1, 3, 4))), "lines 1 and 2", "ids")
    seen = seen_from()
    rows_exchanged = LineObservation(seen.ids, seen.image_lines[[1, 0, 2, 3]], seen.usable, seen.lines_camera)
    assert mentions(contradiction(rows_exchanged), "image lines 1 and 2", "exchanged")


@pytest.mark.parametrize("factor", [0.2, 1.5, 5.0, 1000.0])
def test_a_wrong_scale_is_named_with_its_factor(factor):
    assert mentions(contradiction(changed(seen_from(), moment=factor)), f"{factor:.3g} times")


def test_a_scale_that_can_be_corrected_passes():
    assert contradiction(changed(seen_from(), moment=1.15)) is None


@pytest.mark.parametrize(
    "told",
    [
        *(Pose(CAMERA.rotation, CAMERA.translation + [0.0, off, 0.0]) for off in (0.05, 0.2, 1.0, 5.0)),
        CAMERA.inverse(),
        Pose(CAMERA.rotation @ Rotation.from_euler("z", 90.0, degrees=True).as_matrix(), CAMERA.translation),
    ],
)
def test_a_pose_that_contradicts_exact_lines(told):
    assert mentions(contradiction(seen_from(), told), "camera_pose")


def test_unknown_ids_are_left_out_and_named():
    scene = LineSet(PAPER.direction[:3], PAPER.moment[:3], PAPER.frame, (1, 2, 3))
    check, seen = ConsistencyCheck(scene), changed(seen_from(), ids=(1, 2, 3, 99))
    assert check.contradiction(seen) is None
    assert check.unknown_ids(seen) == (99,)
    assert check.unknown_ids(seen_from(scene=scene)) == ()


def test_what_cannot_be_checked_is_said():
    seen = seen_from()
    image_only = LineObservation(seen.ids, seen.image_lines, seen.usable, None)
    assert contradiction(image_only) is None
    assert mentions(ConsistencyCheck(PAPER).unchecked(image_only), "image lines", "3-D lines", "pose_estimator")
    assert "scene" in ConsistencyCheck(None).unchecked(seen)


def test_a_line_that_was_moved_is_named():
    scene = LineSet.from_points_directions([*PAPER.point, [2.0, 0.0, 3.0]], [*PAPER.direction, [0.0, 1.0, 1.0]])
    shift = np.outer([0.0, 0.0, 0.0, 0.0, 1.0], [0.0, 0.5, 0.0])
    moved = LineSet.from_points_directions(scene.point + shift, scene.direction)
    reason = contradiction(seen_from(scene=moved), scene=scene)
    assert reason is not None and mentions(reason, "line 5", "scene")


def test_one_of_parallel_lines_that_points_the_other_way():
    corridor = LineSet.from_points_directions([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], [[0, 0, 1]] * 4)
    seen = seen_from(Pose.look_at([1.0, 0.8, -1.0], [1.1, 1.0, 5.0], down=(0.0, -1.0, 0.0)), corridor)
    assert contradiction(seen, scene=corridor) is None
    sign = signs(3)
    assert mentions(contradiction(changed(seen, sign, sign, sign), scene=corridor), "line 3", "reversed")


@given(shift=vectors(3, -0.012, 0.012), turn=vectors(3, -0.01, 0.01), noise=vectors(12, -0.03, 0.03))
def test_errors_within_the_tolerances_pass(shift, turn, noise):
    off = Pose(CAMERA.rotation @ Rotation.from_rotvec(turn).as_matrix(), CAMERA.translation + shift)
    at_pose, image = seen_from(off), seen_from().image_lines + noise.reshape(4, 3)
    image /= np.hypot(image[:, 0], image[:, 1])[:, np.newaxis]
    assert contradiction(LineObservation(at_pose.ids, image, at_pose.usable, at_pose.lines_camera), CAMERA) is None


@given(center=vectors(3, -3.0, 3.0), turn=vectors(3, -3.0, 3.0), row=st.integers(0, 3), other=st.integers(1, 3))
def test_reversed_and_exchanged_lines_are_refused_from_everywhere(center, turn, row, other):
    seen = seen_from(Pose(Rotation.from_rotvec(turn).as_matrix(), CAMERA.translation + center))
    assume(seen.usable.all())
    sign = signs(row + 1)
    assert contradiction(changed(seen, sign, sign, sign)) is not None
    order = [1, 2, 3, 4]
    second = (row + other) % 4
    order[row], order[second] = order[second], order[row]
    assert contradiction(changed(seen, ids=tuple(order))) is not None


@given(offset=numbers(3.0, 1e300), moment=numbers(1e-3, 1e200))
def test_huge_numbers_are_refused_without_an_exception(offset, moment):
    seen = seen_from()
    image = np.array(seen.image_lines)
    image[:, 2] = offset
    lines = LineSet(seen.lines_camera.direction, seen.lines_camera.moment * moment, "camera", seen.ids)
    check = ConsistencyCheck(PAPER, Tolerances(image=0.1, position=0.01))
    assert check.contradiction(LineObservation(seen.ids, image, seen.usable, lines)) is not None


@given(
    apart=st.tuples(numbers(-0.15, 0.15), numbers(-0.1, 0.1)),
    std=numbers(2e-4, 2e-3),
    noise=vectors(4, -2.0, 2.0),
    moved=vectors(2, -0.03, 0.03),
)
def test_nearly_equal_image_lines_that_are_exchanged_are_named_where_noise_lets_them(apart, std, noise, moved):
    # Two lines seen at 2 m, their images apart by an angle and an offset, both moved alike by an error of the pose.
    there = np.array([[0.3, 0.2], [0.3 + apart[0], 0.2 + apart[1]]])
    moment = 2.0 * np.column_stack([np.cos(there[:, 0]), np.sin(there[:, 0]), there[:, 1]])
    seen = there + moved + std * noise.reshape(2, 2)
    image = np.column_stack([np.cos(seen[:, 0]), np.sin(seen[:, 0]), seen[:, 1]])
    own = np.tile((std**2, 0.0, std**2), (2, 1))
    # The ends of a segment have a variance of 2 std^2 across it here; the map adds (5 mm / 2 m)^2.
    total = std * np.sqrt(1.0 + (0.005 / 2.0) ** 2 / (2.0 * std**2))
    separation = np.linalg.norm(apart) / (np.sqrt(2.0) * total)
    assert exchanged_pair(image, moment, own, 0.005) is None
    if separation > 8.0:
        assert exchanged_pair(image[::-1].copy(), moment, own, 0.005) == (0, 1)


@given(apart=st.tuples(numbers(-0.1, 0.1), numbers(-0.1, 0.1)), noise=vectors(10, -1.0, 1.0), share=numbers(0.0, 0.08))
def test_exchanged_image_lines_without_covariances_are_named_if_the_other_lines_fit_better(apart, noise, share):
    size = np.linalg.norm(apart)
    assume(size > 1e-4)
    angles = np.array([0.2, 0.2 + apart[0], 1.5, 2.6, 4.0])
    offsets = np.array([0.1, 0.1 + apart[1], 0.2, -0.1, 0.0])
    moment = 2.0 * np.column_stack([np.cos(angles), np.sin(angles), offsets])
    # Errors of all lines alike, and a share of what the two are apart.
    off = share * size * noise.reshape(5, 2)
    image = np.column_stack([np.cos(angles + off[:, 0]), np.sin(angles + off[:, 0]), offsets + off[:, 1]])
    assert exchanged_pair(image, moment, None, 0.005) is None
    assert exchanged_pair(image[[1, 0, 2, 3, 4]], moment, None, 0.005) == (0, 1)


@given(bend=numbers(-0.02, 0.02), share=numbers(-4.0, 4.0))
def test_lines_that_are_off_by_what_their_covariances_say_are_not_exchanged(bend, share):
    # Two edges end to end, nearly one line; where they meet they are off, so that each turns as the other one does.
    std = 2e-3
    off = 0.5 * share * std
    ends = np.array([[[-0.15, -0.1], [-0.15 + off, 0.0]], [[-0.15 + off, 0.0], [-0.15 + bend, 0.1]]])
    true = np.array([[[-0.15, -0.1], [-0.15, 0.0]], [[-0.15, 0.0], [-0.15 + bend, 0.1]]])
    lines = [np.cross(np.append(a, 1.0), np.append(b, 1.0)) for a, b in [*ends, *true]]
    image, moment = np.split(np.array([line / np.hypot(*line[:2]) for line in lines]), 2)
    by_turn = std / 0.05
    own = np.tile((by_turn**2, 0.0, 2.0 * std**2), (2, 1))
    assert exchanged_pair(image, 0.4 * moment, own, 0.005) is None


@given(angle=numbers(-3.0, 3.0), distance=numbers(0.011, 0.2), error=vectors(3, -0.002, 0.002))
def test_a_negated_image_line_is_refused_also_where_the_camera_nearly_touches_the_line(angle, distance, error):
    beside = np.array([math.cos(angle), math.sin(angle), 0.0]) * distance
    point, direction = np.array([0.0, 0.0, 2.0]) + beside, np.array([0.05, -0.02, 1.0])
    # The line is so far from the camera that no error of the map turns its image round.
    assume(np.linalg.norm(np.cross(point, direction / np.linalg.norm(direction))) > 0.011)
    scene = LineSet.from_points_directions(
        np.vstack([seen_from().lines_camera.point, point]), np.vstack([seen_from().lines_camera.direction, direction])
    )
    right = LineObservation.of_lines(scene.transformed(Pose(np.eye(3), error), "camera"))
    told = LineObservation.of_lines(scene.transformed(Pose(np.eye(3), np.zeros(3)), "camera"))
    assume(right.usable.all())
    image = right.image_lines * np.array([1.0, 1.0, 1.0, 1.0, -1.0])[:, np.newaxis]
    check = ConsistencyCheck(scene)
    assert check.contradiction(LineObservation(told.ids, image, told.usable, told.lines_camera)) is not None


@given(along=numbers(-2.0, 2.0), across=numbers(0.5, 5.0))
def test_a_pose_is_compared_with_parallel_lines_as_far_as_they_tell(along, across):
    points = [[0.0, 0.0, 0.0], [0.4, 0.0, 0.1], [0.1, 0.5, 0.0], [-0.4, 0.2, 0.3]]
    scene = LineSet.from_points_directions(points, np.tile([1.0, 0.2, 0.1], (4, 1)))
    seen = seen_from(scene=scene)
    shift = along * scene.direction[0]
    assert contradiction(seen, Pose(CAMERA.rotation, CAMERA.translation + shift), scene) is None
    off = np.cross(scene.direction[0], [0.0, 0.0, 1.0])
    shift = shift + across * off / np.linalg.norm(off)
    assert "parallel" in contradiction(seen, Pose(CAMERA.rotation, CAMERA.translation + shift), scene)
