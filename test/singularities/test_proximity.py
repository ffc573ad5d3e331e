# SPDX-License-Identifier: Apache-2.0
"""The proximity of a camera to a singular centre, against finite differences, samples and known geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from singular_scenes import PAPER_FOUR, box_edges, line_set
from strategies import line_sets, vectors

from plsing_ros.errors import GeometryError
from plsing_ros.features import project_lines
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


def singular_values(direction, point, center):
    return np.linalg.svd(unit_rows(direction, point, center), compute_uv=False)


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
    # A row of a line that the camera touches has no direction.
    if away < 0.05 * frame.length or away < 1e-6:
        return
    values = singular_values(measured.direction, measured.point / frame.length, center / frame.length)
    # Where two singular values are as good as equal, neither has a derivative.
    if (values[:-1] - values[1:]).min() < 1e-3 or values[5] < 1e-4:
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
                    ends.append(singular_values(u, p, scaled))
                slopes.append(std * (ends[0] - ends[1]) / (2.0 * step))
    assert found.z == pytest.approx((values / np.linalg.norm(slopes, axis=0)).min(), rel=1e-4)
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


def test_z_is_small_at_far_points_of_a_roof():
    """Tens of roof lengths away several singular values are small, and not the smallest is the one that can vanish."""
    w, d, h, s = 4.5, 9.1, 2.2, 1.9
    corners, ridge = [(0, 0, 0), (w, 0, 0), (w, d, 0), (0, d, 0)], [(w / 2, s, h), (w / 2, d - s, h)]
    joins = [(corners[0], ridge[0]), (corners[1], ridge[0]), (corners[2], ridge[1]), (corners[3], ridge[1]), ridge]
    ends = np.array(joins, dtype=float)
    points, directions = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    exact = singular_set(line_set((points, directions)))
    far = max(exact.isolated_points, key=lambda point: np.linalg.norm(point - exact.frame.center))
    assert np.linalg.norm(far - exact.frame.center) > 30.0 * exact.frame.length
    generator, found = np.random.default_rng(3), []
    for _ in range(40):
        moved, turned = points + 5e-3 * generator.normal(size=(5, 3)), directions + 9e-3 * generator.normal(size=(5, 3))
        lines = LineSet.from_points_directions(moved, turned, position_std=5e-3, direction_std=9e-3)
        found.append(singular_set(lines).proximity(far).z)
    assert np.mean(np.array(found) < 3.0) > 0.9


@given(spread=st.lists(st.floats(0.2, 5.0), min_size=14, max_size=14), share=st.floats(-0.8, 0.8), eye=vectors())
@settings(max_examples=10, deadline=None)
def test_the_precision_is_that_of_the_covariances_of_the_features(spread, share, eye):
    """Angle and offset of each image line, moved by the camera as central differences say, weighted by covariances."""
    points, directions = box_edges()
    lines = line_set((points[:7], directions[:7]))
    center = lines.point.mean(axis=0) + np.array([4.0, 5.0, 3.0]) + 0.3 * eye
    pose = Pose.look_at(center, lines.point.mean(axis=0))
    first, second = (1e-3 * np.array(spread)).reshape(2, 7)
    covariances = np.stack([first**2, share * first * second, second**2], axis=1)

    def features(moved):
        image = project_lines(lines.transformed(moved.inverse(), "camera")).reshape(-1, 3)
        return np.stack([np.arctan2(image[:, 1], image[:, 0]), image[:, 2]], axis=1)

    length = SceneFrame.of(lines).length
    slopes = np.empty((7, 2, 6))
    for k in range(6):
        twist = np.zeros(6)
        twist[k] = 1e-6 * (length if k < 3 else 1.0)
        change = features(pose.integrate(twist, 1.0)) - features(pose.integrate(-twist, 1.0))
        change[:, 0] = (change[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
        slopes[:, :, k] = change / 2e-6
    blocks = np.array([[[a, b], [b, c]] for a, b, c in covariances])
    information = sum(J.T @ np.linalg.solve(S, J) for J, S in zip(slopes, blocks, strict=True))
    value, vector = np.linalg.eigh(information)
    worst = vector[:, 0] / np.sqrt(value[0])
    found = singular_set(lines).proximity(pose, covariances=covariances)
    assert found.position_std == pytest.approx(length * np.linalg.norm(worst[:3]), rel=1e-4)
    assert found.rotation_std == pytest.approx(np.linalg.norm(worst[3:]), rel=1e-4)
    with pytest.raises(GeometryError, match="covariances.*pose"):
        singular_set(lines).proximity(center, covariances=covariances)
    with pytest.raises(GeometryError, match="covariances.*nan"):
        singular_set(lines).proximity(pose, covariances=np.where(covariances == covariances.max(), np.nan, covariances))


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
