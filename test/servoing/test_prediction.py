import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import line_sets, numbers, poses, twists, vectors

from plsing_ros.features import degenerate_projections, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.servoing.prediction import ApproachTable, LawPreview, Slope, Trend, _seen_after, law
from plsing_ros.singularities import Kind, singular_set

PAPER = LineSet.from_points_directions(
    [[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13]]
)
FOUND = singular_set(PAPER)
TABLE = ApproachTable(FOUND)
MILLISECONDS = 1_000_000


@given(center=vectors(3), velocity=vectors(3, -1.0, 1.0))
def test_the_closest_approach_is_the_least_over_samples_of_the_way(center, velocity):
    assume(np.linalg.norm(velocity) > 0.1)
    trend, approach = TABLE.ahead(FOUND.distance_arrays(center), center, velocity, 10.0)
    assert isinstance(trend, Trend)
    if approach is None:
        return
    row = FOUND.locus_names.index(approach.name)

    def distance(time):
        return FOUND.distance_arrays(center + time * velocity).distance[row]

    assert distance(approach.time) == pytest.approx(approach.distance, abs=1e-6)
    assert all(distance(time) >= approach.distance - 1e-6 for time in np.linspace(0.0, 10.0, 30))


def test_trends_by_example():
    point = FOUND.isolated_points[0]
    way = np.array([0.6, 0.0, 0.8])
    for offset, expected in ((-0.05, Trend.APPROACHING), (0.05, Trend.LEAVING), (0.0005, Trend.PASSING)):
        center = point + offset * way + 0.001 * np.array([0.8, 0.0, -0.6])
        trend, approach = TABLE.ahead(FOUND.distance_arrays(center), center, 0.01 * way, 10.0)
        assert trend is expected
        if expected is Trend.APPROACHING:
            assert (approach.kind, approach.name) == (Kind.ISOLATED_POINT, "isolated point 1")
            assert approach.distance == pytest.approx(0.001) and approach.time == pytest.approx(5.0)
    assert TABLE.ahead(FOUND.distance_arrays(point), point, np.zeros(3), 10.0) == (Trend.STEADY, None)


def test_along_a_transversal_is_steady():
    line = FOUND.transversals[0]
    center = line.point + 1e-3 * np.cross(line.direction, [1.0, 0.0, 0.0])
    assert TABLE.ahead(FOUND.distance_arrays(center), center, line.direction, 10.0)[0] is Trend.STEADY


def test_a_surface_is_met_where_its_tangent_plane_is():
    found = singular_set(PAPER.select([0, 1, 2]))
    center = np.array([0.3, 0.4, 1.2])
    arrays = found.distance_arrays(center)
    row = found.locus_names.index("quadric")
    toward = (arrays.closest_point[row] - center) / arrays.distance[row]
    _, approach = ApproachTable(found).ahead(arrays, center, 0.1 * toward, 100.0)
    assert approach.distance == pytest.approx(0.0, abs=1e-9) and approach.time <= 10.0 * arrays.distance[row] + 1e-9


@given(rate=numbers(-10.0, 10.0), start=numbers(), n=st.integers(2, 30))
def test_a_straight_line_has_its_slope(rate, start, n):
    slope = Slope(10)
    results = [slope.add(start + rate * 0.04 * i, 1 + 40 * MILLISECONDS * i) for i in range(n)]
    assert results[0] is None
    assert results[-1][0] == pytest.approx(rate, abs=1e-8)


def test_a_rate_out_of_noise_is_small_and_its_error_right():
    generator = np.random.default_rng(0)
    slope = Slope(10)
    results = [slope.add(generator.normal(), 1 + 40 * MILLISECONDS * i) for i in range(3000)]
    rates, errors = np.array(results[10:]).T
    assert np.std(rates) == pytest.approx(0.11 / 0.04, rel=0.1)
    assert np.mean(np.abs(rates) < 3.0 * errors) > 0.97


def test_a_gap_or_a_stamp_that_is_not_later():
    slope = Slope(10)
    slope.add(1.0, 1)
    assert slope.add(2.0, 1) is None
    assert slope.add(5.0, 5_000 * MILLISECONDS) is None
    assert slope.add(6.0, 6_000 * MILLISECONDS)[0] == pytest.approx(1.0)


@given(lines=line_sets(min_size=4), pose=poses(), twist=twists())
def test_the_short_cuts_are_the_checked_functions(lines, pose, twist):
    seen = lines.transformed(pose.inverse(), "camera")
    moved = lines.transformed(pose.moved(twist, 0.3).inverse(), "camera")
    direction, moment = _seen_after(seen.direction, seen.moment, 0.3 * twist)
    np.testing.assert_allclose(direction, moved.direction, atol=1e-9)
    np.testing.assert_allclose(moment, moved.moment, atol=1e-7)
    assume(not degenerate_projections(seen).any())
    L = interaction_matrix(seen)
    values = np.linalg.svd(L, compute_uv=False)
    assume(values[-1] > 1e-3 * values[0])
    desired = project_lines(seen) + 0.1
    expected = np.linalg.lstsq(L, np.full(3 * len(lines), 0.1), rcond=None)[0]
    np.testing.assert_allclose(law(seen.direction, seen.moment, desired), expected, rtol=1e-6, atol=1e-9)


def preview_after(gain, cycles=30, turn=1.0):
    start = Pose.looking_at([0.7, -4.6, 7.8], [0, 0, 0])
    goal = start.moved([0.1, 0.05, 0.1, 0.02, 0, 0], 1.0)
    seen = PAPER.transformed(start.inverse(), "camera")
    desired = project_lines(PAPER.transformed(goal.inverse(), "camera"))
    twist = turn * gain * law(seen.direction, seen.moment, desired)
    preview, result = LawPreview(), None
    for _ in range(cycles):
        result = preview.advance(seen, desired, twist, 1.0)
    return result, np.linalg.norm(twist[:3])


@pytest.mark.parametrize("gain", [0.01, 0.1, 1.0])
def test_the_gain_is_read_off_the_twist(gain):
    (speed, time), now = preview_after(gain)
    assert speed >= now * (1.0 - 1e-9) and speed < 3.0 * now and 0.0 <= time <= 1.0


def test_a_twist_of_another_law_has_no_preview():
    assert preview_after(0.1, turn=-1.0)[0] is None
    assert preview_after(0.1, turn=0.0)[0] is None
