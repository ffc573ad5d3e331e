"""A step of the plain law against the checked functions it is a short cut of, and exact arithmetic."""

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import line_sets, numbers, poses, seen_lines, twists, vectors

from plsing_ros.features import degenerate_projections, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.kernels import compiled, of_numpy

BOTH = pytest.mark.parametrize("the", [compiled, of_numpy], ids=["compiled", "numpy"])
LEAST_DEPTH, FASTEST = 1e-9, 1e9


def step(the, lines, desired, twist=None, duration=0.0, gain=1.0, fastest=FASTEST):
    """Return lines after a step and the twist there, or None."""
    before = np.array([lines.direction, lines.moment])
    moved, next_twist = np.empty(before.shape), np.empty(6)
    twist = np.zeros(6) if twist is None else twist
    if the.law_step(before, desired, twist, moved, next_twist, duration, gain, LEAST_DEPTH, fastest):
        return moved, next_twist
    return None


@BOTH
@given(seen=seen_lines(min_size=3), twist=twists())
def test_it_is_the_motion_and_the_law_of_the_checked_functions(the, seen, twist):
    moved = seen.transformed(Pose(np.eye(3), np.zeros(3)).moved(twist, 0.3).inverse(), "camera")
    desired = project_lines(seen).reshape(-1, 3) + 0.1
    found = step(the, seen, desired, twist, 0.3, 0.4)
    assume(found is not None)
    np.testing.assert_allclose(found[0], [moved.direction, moved.moment], atol=1e-7)
    after = LineSet(*found[0], "camera")
    assume(not degenerate_projections(after).any())
    L = interaction_matrix(after)
    values = np.linalg.svd(L, compute_uv=False)
    assume(values[-1] > 1e-6 * values[0])
    expected = -0.4 * np.linalg.lstsq(L, project_lines(after) - desired.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found[1], expected, atol=1e-6 * (1.0 + np.linalg.norm(expected)))


@BOTH
@given(lines=seen_lines(min_size=3))
def test_a_camera_at_rest_sees_the_same_lines_to_the_last_bit(the, lines):
    found = step(the, lines, np.zeros((len(lines), 3)))
    assume(found is not None)
    np.testing.assert_array_equal(found[0], [lines.direction, lines.moment])


@BOTH
@pytest.mark.parametrize("angle", [1e-6, 0.9e-4, 1.1e-4, 1e-3, 1.0])
def test_small_and_large_turns_are_as_exact(the, angle):
    lines = LineSet.from_points_directions([[0, 0, 3], [1, 0, 4], [0, 2, 5]], np.eye(3)[[1, 2, 0]], "camera")
    twist = np.array([1.0, -2.0, 3.0, 0.6 * angle, 0.0, 0.8 * angle])
    vx, vy, vz, x, y, z = twist.tolist()
    with mpmath.workdps(50):
        screw = mpmath.matrix([[0, -z, y, vx], [z, 0, -x, vy], [-y, x, 0, vz], [0, 0, 0, 0]])
        motion = np.array(mpmath.expm(screw).tolist(), dtype=float)
    expected = lines.transformed(Pose(motion[:3, :3], motion[:3, 3]).inverse(), "camera")
    moved = np.empty((2, 3, 3))
    # The motion does not ask for a law after it.
    the.law_step(
        np.array([lines.direction, lines.moment]), np.zeros((3, 3)), twist, moved, np.empty(6), 1.0, 1.0, 1e-9, 1e9
    )
    np.testing.assert_allclose(moved, [expected.direction, expected.moment], atol=5e-15)


@BOTH
@given(exponent=numbers(0.0, 8.0))
def test_the_twist_is_as_exact_as_its_condition_number_allows(the, exponent):
    """Four lines of the paper, from a centre 1 to 1e-8 m beside a transversal."""
    lines = LineSet.from_points_directions(
        [[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13]]
    )
    center = np.array([0.396236, -4.337064, 7.5]) + 10.0**-exponent
    seen = lines.transformed(Pose.looking_at(center, [0.0, 0.0, 0.0]).inverse(), "camera")
    L, error = interaction_matrix(seen), np.linspace(-0.1, 0.2, 12)
    with mpmath.workdps(60):
        A = mpmath.matrix(L.tolist())
        exact = np.array([float(x) for x in mpmath.lu_solve(A.T * A, A.T * mpmath.matrix(error.tolist()))])
    found = step(the, seen, project_lines(seen).reshape(-1, 3) - error.reshape(-1, 3))[1]
    condition = np.linalg.cond(L)
    # The residual is not small, so that the square of the condition number takes part.
    residual = np.linalg.norm(L @ exact - error) / (np.linalg.norm(L, 2) * np.linalg.norm(exact))
    allowed = 1e-14 * condition * (1.0 + condition * residual) * np.linalg.norm(exact)
    np.testing.assert_allclose(found, -exact, atol=allowed)


@BOTH
def test_there_is_no_law_through_the_camera_nor_where_all_is_lost_nor_beyond_the_fastest(the):
    through = LineSet(np.eye(3), np.array([[0, 1.0, 0], [0, 0, 0], [1.0, 0, 0]]), "camera")
    assert step(the, through, np.zeros((3, 3))) is None
    same = LineSet(np.array([[1.0, 0, 0]] * 3), np.array([[0.0, 1.0, 0]] * 3), "camera")
    assert step(the, same, np.zeros((3, 3))) is None
    good = LineSet.from_points_directions([[0, 0, 3], [1, 0, 4], [0, 2, 5]], np.eye(3)[[1, 2, 0]], "camera")
    desired = project_lines(good).reshape(-1, 3) + 0.1
    size = np.linalg.norm(step(the, good, desired)[1])
    assert step(the, good, desired, fastest=1.01 * size) is not None
    assert step(the, good, desired, fastest=0.99 * size) is None


@BOTH
@pytest.mark.parametrize("size", [np.inf, -np.inf, np.nan, 1e200, 1e308])
@pytest.mark.parametrize("axis", range(6))
def test_there_is_no_law_after_a_step_that_overflows(the, size, axis):
    lines = LineSet.from_points_directions([[0, 0, 3], [1, 0, 4], [0, 2, 5]], np.eye(3)[[1, 2, 0]], "camera")
    twist = size * np.eye(6)[axis] if np.isfinite(size) else np.where(np.arange(6) == axis, size, 0.0)
    found = step(the, lines, project_lines(lines).reshape(-1, 3) + 0.1, twist, 1.0)
    assert found is None or all(np.isfinite(each).all() for each in found)
    if axis > 2 or not np.isfinite(size):
        assert found is None


@BOTH
def test_images_of_lines_through_the_camera_deviate_by_no_finite_number(the):
    moment = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 1.0]])
    assert not np.isfinite(the.image_deviation(moment, np.zeros((2, 3))))


@given(lines=seen_lines(min_size=40, max_size=40))
def test_many_lines_agree(lines):
    desired = project_lines(lines).reshape(-1, 3) + 0.1
    compiled_one, of_numpy_one = (step(the, lines, desired, np.full(6, 0.1), 0.1) for the in (compiled, of_numpy))
    if compiled_one is None or of_numpy_one is None:
        # All lines the same, to rounding.
        assert compiled_one is of_numpy_one or np.linalg.matrix_rank(interaction_matrix(lines), tol=1e-9) < 6
    assume(compiled_one is not None and of_numpy_one is not None)
    np.testing.assert_allclose(compiled_one[0], of_numpy_one[0], atol=1e-12)
    condition, size = np.linalg.cond(interaction_matrix(LineSet(*of_numpy_one[0], "camera"))), np.linalg.norm(desired)
    assume(condition < 1e5)
    np.testing.assert_allclose(compiled_one[1], of_numpy_one[1], atol=1e-13 * condition**2 * (1.0 + size))


@BOTH
@given(lines=line_sets(), pose=poses(), others=st.data())
def test_lines_seen_are_the_transformed_ones(the, lines, pose, others):
    n = len(lines)
    given_lines = others.draw(line_sets(min_size=n, max_size=n))
    image = others.draw(vectors(3 * n)).reshape(n, 3)
    seen, error = np.empty((2, n, 3)), np.empty((2, n, 3))
    deviation = the.lines_seen(
        lines.direction,
        lines.moment,
        pose.rotation,
        pose.translation,
        given_lines.direction,
        given_lines.moment,
        image,
        seen,
        error,
    )
    expected = lines.transformed(pose.inverse(), "camera")
    np.testing.assert_allclose(seen, [expected.direction, expected.moment], atol=1e-13)
    np.testing.assert_array_equal(error, np.array([given_lines.direction, given_lines.moment]) - seen)
    np.testing.assert_array_equal(deviation, the.image_deviation(seen[1], image))


@BOTH
@given(lines=seen_lines(min_size=1), pose=poses())
def test_the_deviation_of_images(the, lines, pose):
    image = project_lines(lines).reshape(-1, 3)
    assert the.image_deviation(lines.moment * 3.0, image) == pytest.approx(0.0, abs=1e-20)
    other = pose.rotation[:1] + image
    assert the.image_deviation(lines.moment, other) == pytest.approx(len(lines), rel=1e-12)
