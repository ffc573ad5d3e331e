# SPDX-License-Identifier: Apache-2.0
"""The proximity of a camera to a singular centre, against finite differences, samples and known geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from singular_scenes import PAPER_FOUR, box_edges, line_set
from strategies import line_sets, vectors

from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.singularities import singular_set
from plsing_ros.singularities.scene_frame import SceneFrame


def unit_rows(direction, point, center):
    """Row-normalised xi by its definition, in the unit given."""
    rows = []
    for u, x in zip(direction, point, strict=True):
        f = np.cross(u, x - center)
        rows += [np.r_[f, f @ f * u], np.r_[0.0, 0.0, 0.0, np.cross(u, f)]]
    rows = np.array(rows)
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def last_value(direction, point, center):
    return np.linalg.svd(unit_rows(direction, point, center), compute_uv=False)[-1]


def across(u):
    """Two unit vectors across u and each other."""
    return np.linalg.svd(u[np.newaxis])[2][1:]


@given(lines=line_sets(min_size=4, max_size=7), center=vectors())
@settings(max_examples=30, deadline=None)
def test_z_and_distance_are_those_of_finite_differences(lines, center):
    position_std, direction_std = 2e-3, 5e-4
    measured = LineSet.from_points_directions(
        lines.point + 0.3 * lines.direction, lines.direction, position_std=position_std, direction_std=direction_std
    )
    singular = singular_set(measured)
    frame = SceneFrame.of(measured)
    away = np.linalg.norm(np.cross(measured.direction, measured.point - center), axis=1).min()
    values = np.linalg.svd(
        unit_rows(measured.direction, measured.point / frame.length, center / frame.length), compute_uv=False
    )
    # Where the last two singular values are as good as equal, neither has a derivative.
    if away < 0.05 * frame.length or values[4] - values[5] < 1e-3 or values[5] < 1e-4:
        return
    found = singular.proximity(center)
    pivot, direction, scaled = measured.pivot / frame.length, measured.direction, center / frame.length
    step, slopes = 1e-6, []
    for i in range(len(measured)):
        for way in across(direction[i]):
            for std, moves in ((position_std / frame.length, True), (direction_std, False)):
                ends = []
                for sign in (1.0, -1.0):
                    p, u = pivot.copy(), direction.copy()
                    if moves:
                        p[i] += sign * step * way
                    else:
                        u[i] += sign * step * way
                        u[i] /= np.linalg.norm(u[i])
                    ends.append(last_value(u, p, scaled))
                slopes.append(std * (ends[0] - ends[1]) / (2.0 * step))
    assert found.z == pytest.approx(values[5] / np.linalg.norm(slopes), rel=1e-4)
    assert found.relative_condition == pytest.approx(values[5] / values[0] / singular.normal_condition, rel=1e-9)
    assert np.linalg.norm(found.closest_point - center) == pytest.approx(found.distance)


def test_z_is_standard_normal_on_a_singular_surface():
    """Cameras in the plane of a window, lines off by their tolerances: |z| is that of a normal variable, or smaller."""
    generator = np.random.default_rng(4)
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.2], [0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [0.4, 0.0, 0.0]])
    directions = np.array([[1.0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1], [1, 0, 1.3]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    on, beside = [], []
    for _ in range(300):
        moved = points + 1e-3 * generator.normal(size=points.shape)
        turned = directions + 1e-3 * generator.normal(size=points.shape)
        lines = LineSet.from_points_directions(moved, turned, position_std=1e-3, direction_std=1e-3)
        singular = singular_set(lines)
        on.append(singular.proximity([1.9, 0.0, -0.7]).z)
        beside.append(singular.proximity([1.9, 0.3, -0.7]))
    # A chi variable has a median of 0.67 for one degree of freedom, and more for each direction the rank can go.
    assert 0.3 < np.median(on) < 2.5
    assert np.mean(np.array(on) < 3.5) > 0.97
    assert np.median([each.z for each in beside]) > 30.0
    # One step from 30 cm away ends near the plane, and does not slide along it.
    errors = [abs(each.closest_point[1]) for each in beside]
    slides = [np.linalg.norm(each.closest_point - [1.9, 0.0, -0.7]) for each in beside]
    assert np.median(errors) < 0.1
    assert max(slides) < 0.5


def test_the_step_goes_to_points_lines_and_planes():
    four = singular_set(line_set(PAPER_FOUR))
    center = four.isolated_points[2]
    start = center + [4e-5, -2e-5, 3e-5]
    found = four.proximity(start)
    assert found.z is None
    assert np.linalg.norm(found.closest_point - center) < 0.05 * np.linalg.norm(start - center)
    for transversal in four.transversals:
        side = across(transversal.direction)[0]
        place = transversal.point + 0.7 * transversal.direction
        found = four.proximity(Pose(np.eye(3), place + 1e-4 * side))
        assert found.distance == pytest.approx(1e-4, rel=0.05)
        assert np.linalg.norm(found.closest_point - place) < 1e-5
    at = four.proximity(center)
    assert at.distance < 1e-9
    assert at.relative_condition < 1e-9


def test_the_precision_of_a_pose_is_that_of_least_squares():
    """Sampled normals of interpretation planes, and the pose that fits them best."""
    points, directions = box_edges()
    lines = line_set((points[:9], directions[:9]))
    center, std = np.array([1.8, 2.2, 1.7]), 1e-4
    found = singular_set(lines).proximity(center, image_std=std)
    length = singular_set(lines).frame.length
    scale = np.r_[np.full(3, length), np.ones(3)]
    rows = []
    for u, x in zip(lines.direction, lines.point, strict=True):
        l0 = np.cross(x - center, u)
        normal = l0 / np.linalg.norm(l0)
        for way in across(normal):
            # d(normal) for camera velocities v and omega: l changes by -(v x u + omega x l).
            row = [-way @ np.cross(e, u) for e in np.eye(3)] + [-way @ np.cross(e, l0) for e in np.eye(3)]
            rows.append(np.array(row) / np.linalg.norm(l0))
    covariance = std**2 * np.linalg.inv((np.array(rows) * scale).T @ (np.array(rows) * scale))
    value, vector = np.linalg.eigh(covariance)
    worst = np.sqrt(value[-1]) * vector[:, -1] * scale
    assert found.position_std == pytest.approx(np.linalg.norm(worst[:3]), rel=1e-9)
    assert found.rotation_std == pytest.approx(np.linalg.norm(worst[3:]), rel=1e-9)


def test_scenes_that_are_bad_everywhere_say_so_in_metres():
    """Five stair nosings that are parallel to a millimetre: the position along them is unknown by metres."""
    points = np.array([[0.0, 0.28 * i, 0.17 * i] for i in range(5)])
    directions = np.array([[1.0, 1e-3 * (-1) ** i, 1e-3 * (i % 3 - 1)] for i in range(5)])
    lines = LineSet.from_points_directions(points, directions, position_std=1e-3, direction_std=1e-3)
    found = singular_set(lines).proximity([0.5, -1.5, 1.5])
    assert found.z < 3.0
    assert found.position_std > 0.3


def test_bad_input_is_refused():
    singular = singular_set(line_set(PAPER_FOUR))
    with pytest.raises(GeometryError, match="pose_or_center"):
        singular.proximity([0.0, np.nan, 1.0])
    with pytest.raises(GeometryError, match="image_std"):
        singular.proximity([0.0, 0.0, 1.0], image_std=0.0)
    two = singular_set(line_set(([[0, 0, 0], [0, 1, 1]], [[1, 0, 0], [0, 1, 2]])))
    assert two.proximity([1.0, 2.0, 3.0]).position_std == np.inf
