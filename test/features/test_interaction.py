# SPDX-License-Identifier: Apache-2.0
"""The interaction matrix against ground truth it does not share code with: the moved camera's own projections."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import line_sets, numbers, poses, seen_lines, twists, vectors

from plsing_ros.errors import DegenerateProjectionError
from plsing_ros.features import interaction_matrix, project_lines, rank_basis
from plsing_ros.features.mean_interaction import mean_interaction
from plsing_ros.features.rank_basis import rank_bases
from plsing_ros.geometry import LineSet

STEP = 1e-6


def seen(lines, T_world_camera):
    return lines.transformed(T_world_camera.inverse(), "camera")


@given(lines_camera=seen_lines(), T_world_camera=poses(), twist=twists())
def test_matches_central_differences_of_the_moved_camera(lines_camera, T_world_camera, twist):
    lines = lines_camera.transformed(T_world_camera, "world")
    after, before = (project_lines(seen(lines, T_world_camera.integrate(twist, h))) for h in (STEP, -STEP))
    rate = interaction_matrix(lines_camera) @ twist
    np.testing.assert_allclose(rate, (after - before) / (2 * STEP), atol=1e-5, rtol=1e-5)


def test_the_sign_of_the_twist_is_that_of_the_camera():
    """A camera that moves right sees a vertical line in front of it move left."""
    vertical = LineSet.from_points_directions([[0, 0, 2.0]], [[0, 1.0, 0]])
    _, _, rate = interaction_matrix(vertical) @ [1.0, 0, 0, 0, 0, 0]
    a, _, c = project_lines(vertical)
    assert a * rate > 0  # the line a X + c = 0 is at X = -c / a, with a = +-1
    assert c == 0.0
    assert abs(rate) == pytest.approx(0.5)  # 1 m/s at 2 m


@given(lines_camera=seen_lines(), along=numbers(-50, 50), T_world_camera=poses())
def test_does_not_depend_on_the_point_that_represents_a_line(lines_camera, along, T_world_camera):
    lines = lines_camera.transformed(T_world_camera, "world")
    other = LineSet.from_points_directions(lines.point + along * lines.direction, 2.0 * lines.direction)
    first, second = seen(lines, T_world_camera), seen(other, T_world_camera)
    np.testing.assert_allclose(project_lines(second), project_lines(first), atol=1e-8)
    np.testing.assert_allclose(interaction_matrix(second), interaction_matrix(first), atol=1e-6)


@given(lines=seen_lines())
def test_reversed_lines_have_features_and_rates_of_opposite_sign(lines):
    np.testing.assert_array_equal(project_lines(lines.reversed()), -project_lines(lines))
    np.testing.assert_allclose(interaction_matrix(lines.reversed()), -interaction_matrix(lines), atol=1e-12)


@given(lines=seen_lines())
def test_the_image_line_contains_the_images_of_the_lines_points(lines):
    for offset in (-1.0, 3.0):
        points = lines.point + offset * lines.direction
        incidence = np.einsum("ij,ij->i", project_lines(lines).reshape(-1, 3), points)
        np.testing.assert_allclose(incidence, 0.0, atol=1e-8)


@given(lines_camera=seen_lines())
def test_the_rank_basis_spans_the_rows_of_the_interaction_matrix(lines_camera):
    """Each line's two rows of xi are combinations of its three rows of L."""
    for line in range(len(lines_camera)):
        of_interaction = interaction_matrix(lines_camera)[3 * line : 3 * line + 3]
        of_basis = rank_basis(lines_camera, [0, 0, 0], normalized=True)[2 * line : 2 * line + 2]
        together = np.vstack([of_interaction / np.linalg.norm(of_interaction), of_basis])
        assert np.linalg.svd(together)[1][2] < 1e-7
        assert np.linalg.svd(of_basis)[1][1] > 1e-3


@given(lines=seen_lines(min_size=3), T_world_camera=poses())
def test_the_rank_basis_does_not_depend_on_orientation(lines, T_world_camera):
    in_world = rank_basis(lines, T_world_camera.translation)
    in_camera = rank_basis(seen(lines, T_world_camera), [0, 0, 0])
    first, second = np.linalg.svd(in_world)[1], np.linalg.svd(in_camera)[1]
    np.testing.assert_allclose(first, second, atol=1e-7 * (1 + first.max()))


@given(lines=line_sets(max_size=4), centers=st.lists(vectors(), min_size=1, max_size=3))
def test_rank_bases_at_many_centres_are_those_of_the_definition(lines, centers):
    found = rank_bases(lines.direction, lines.point, np.array(centers), normalized=True, on_line=1e-6)
    for rows, center in zip(found, centers, strict=True):
        for line, (u, point) in enumerate(zip(lines.direction, lines.point, strict=True)):
            f = np.cross(u, point - center)
            expected = np.array([[*f, *(f @ f * u)], [0.0, 0.0, 0.0, *np.cross(u, f)]])
            away = np.linalg.norm(f)
            scale = 1.0 / np.linalg.norm(expected, axis=1, keepdims=True) if away > 1e-6 else 0.0
            np.testing.assert_allclose(rows[2 * line : 2 * line + 2], expected * scale, atol=1e-12)


@given(image=vectors(6, -3.0, 3.0), numbers=vectors(72, -1.0, 1.0), columns=st.integers(1, 6))
def test_the_mean_is_that_of_changes_of_angle_and_offset(image, numbers, columns):
    a, b, offset, target_offset = *image.reshape(3, 2)[:2], image[4], image[5]
    s = np.column_stack([np.cos(a), np.sin(a), [offset, 1.0]])
    s_target = np.column_stack([np.cos(b), np.sin(b), [target_offset, -1.0]])

    def rows(s, turn, shift):
        """What image lines have: d (cos a, sin a, r) = (-sin a da, cos a da, dr)."""
        return np.stack([-s[:, 1:2] * turn, s[:, :1] * turn, shift], axis=1).reshape(6, columns)

    da, dr, db, dq = (each[:, :columns] for each in numbers.reshape(4, 2, 9))
    mean = mean_interaction(rows(s, da, dr), s.ravel(), rows(s_target, db, dq), s_target.ravel())
    np.testing.assert_allclose(mean, rows(s, 0.5 * (da + db), 0.5 * (dr + dq)), atol=1e-15)


@pytest.mark.parametrize(
    ("point", "direction"),
    [([0, 0, 5.0], [0, 0, 1.0]), ([1, 2, 0.0], [3, -1, 0.0]), ([0.0, 0, 0], [1, 1, 1])],
    ids=["along the optical axis", "in the focal plane", "through the camera centre"],
)
def test_lines_without_an_image_are_named(point, direction):
    lines = LineSet.from_points_directions([[1, 0, 3], point], [[0, 1, 0], direction], ids=[4, 17])
    for function in (project_lines, interaction_matrix):
        with pytest.raises(DegenerateProjectionError, match=r"\bline 17\b") as caught:
            function(lines)
        assert caught.value.ids == (17,)
