# SPDX-License-Identifier: Apache-2.0
"""Which lines to servo on: against brute force with covariances from central differences."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from messages import mentions
from strategies import line_sets, poses

import plsing_ros as pl
from plsing_ros.analysis import line_selection
from plsing_ros.analysis.accuracy import Camera, line_information, position_deviations
from plsing_ros.analysis.line_selection import select_lines
from plsing_ros.features.projection import degenerate_projections

STEP = 1e-6
PATH = [pl.Pose.look_at((4 * np.cos(t), 4 * np.sin(t), 1.5), (0, 0, 0)) for t in np.linspace(0.0, 1.2, 5)]


def segments(n, seed=3):
    rng = np.random.default_rng(seed)
    first = rng.uniform(-1.0, 1.0, (n, 3))
    ends = np.stack([first, first + 0.5 * rng.normal(size=(n, 3))], axis=1)
    lines = pl.LineSet.from_points_directions(
        ends.mean(axis=1), ends[:, 1] - ends[:, 0], position_std=1e-3, direction_std=2e-3
    )
    return lines, ends


def angle_and_offset(lines, pose):
    """(phi, rho) of the images, shape (n, 2), from the definition."""
    moment = lines.transformed(pose.inverse(), "camera").moment
    return np.column_stack([np.arctan2(moment[:, 1], moment[:, 0]), moment[:, 2] / np.hypot(*moment[:, :2].T)])


def changed(after, before):
    difference = after - before
    difference[:, 0] = np.arctan2(np.sin(difference[:, 0]), np.cos(difference[:, 0]))
    return difference / (2.0 * STEP)


def derivative_by_twist(lines, pose):
    sides = [[angle_and_offset(lines, pose.integrate(s * STEP * e, 1.0)) for s in (1, -1)] for e in np.eye(6)]
    return np.stack([changed(*side) for side in sides], axis=-1)


def covariance_by_map(lines, pose):
    """Of each line's (phi, rho): the pivot moved, and the direction turned about it, along two axes across the line."""
    covariance = np.zeros((len(lines), 2, 2))
    for axis in np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]:
        across = axis - lines.direction * (lines.direction @ axis)[:, np.newaxis]
        for of_point, std in ((1.0, lines.position_std), (0.0, lines.direction_std)):
            moved = [
                pl.LineSet.from_points_directions(
                    lines.pivot + of_point * s * STEP * across, lines.direction + (1.0 - of_point) * s * STEP * across
                )
                for s in (1, -1)
            ]
            by = changed(*(angle_and_offset(each, pose) for each in moved)) * std[:, np.newaxis]
            covariance += by[:, :, np.newaxis] * by[:, np.newaxis]
    return covariance


def deviation(lines, poses, noise):
    worst = 0.0
    for pose in poses:
        J = derivative_by_twist(lines, pose)
        information = sum(
            j.T @ np.linalg.inv(noise**2 * np.eye(2) + by_map) @ j
            for j, by_map in zip(J, covariance_by_map(lines, pose), strict=True)
        )
        worst = max(worst, np.sqrt(np.linalg.eigvalsh(np.linalg.inv(information)[:3, :3])[-1]))
    return worst


@settings(max_examples=25)
@given(lines=line_sets(min_size=4, max_size=6), pose=poses())
def test_information_is_that_of_central_differences(lines, pose):
    seen = lines.transformed(pose.inverse(), "camera")
    depth = np.hypot(*seen.moment[:, :2].T)
    if degenerate_projections(seen).any() or (depth < 0.05 * (1.0 + np.linalg.norm(seen.moment, axis=1))).any():
        return
    information = line_information(lines, [pose], Camera(1e-3, np.pi / 2))
    J = derivative_by_twist(lines, pose)
    for row in np.flatnonzero(information.visible[0]):
        np.testing.assert_allclose(
            information.matrices[0, row],
            1e6 * J[row].T @ J[row],
            rtol=1e-5,
            atol=1e-5 * np.abs(1e6 * J[row]).max() ** 1,
        )


def test_the_best_of_all_sets_is_that_of_brute_force():
    lines, _ = segments(9)
    chosen = select_lines(lines, 4, PATH, image_std=2e-3, max_angle=np.pi / 2, clearance=0.0)
    values = {rows: deviation(lines.select(rows), PATH, 2e-3) for rows in combinations(range(9), 4)}
    best = min(values, key=values.get)
    assert chosen.exact and chosen.ids == tuple(lines.ids[i] for i in best)
    assert chosen.deviation == pytest.approx(values[best], rel=1e-4)
    assert chosen.everything == pytest.approx(deviation(lines, PATH, 2e-3), rel=1e-4)
    assert chosen.everything < chosen.deviation < chosen.random
    dropped = next(iter(chosen.without))
    others = [i for i in best if lines.ids[i] != dropped]
    assert chosen.without[dropped] == pytest.approx(deviation(lines.select(others), PATH, 2e-3), rel=1e-3)
    for identity, value in chosen.instead.items():
        row = lines.ids.index(identity)
        swaps = [values[tuple(sorted({*best} - {i} | {row}))] for i in best]
        assert value == pytest.approx(min(swaps), rel=1e-4)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_exchange_comes_within_a_percent_of_all_sets(seed, monkeypatch):
    lines, ends = segments(18, seed)
    exact = select_lines(lines, 5, PATH, ends=ends)
    monkeypatch.setattr(line_selection, "MAX_EXHAUSTIVE", 0)
    found = select_lines(lines, 5, PATH, ends=ends)
    assert exact.exact and not found.exact
    assert found.deviation <= 1.01 * exact.deviation
    assert select_lines(lines, 5, PATH, ends=ends).ids == found.ids


def test_a_set_whose_locus_is_on_the_path_is_given_up_and_named():
    """Any three or more of four coplanar lines are singular in their plane, through which the camera goes."""
    flat = [[-1, 0, 0], [1, 0, 0], [0, 0, -1], [0, 0, 1]], [[0, 0, 1], [0, 0.0, 1], [1, 0, 0], [1, 0, 0]]
    space = [[0.3, 1, 0.2], [-0.4, 0.8, 0.5], [0.2, -1.1, 0.4]], [[1, 0.2, 0.3], [0.1, 0.3, 1], [0.4, -0.2, 1]]
    lines = pl.LineSet.from_points_directions(flat[0] + space[0], flat[1] + space[1])
    path = [pl.Pose.look_at((3.0, y, 0.4), (0, 0, 0)) for y in (-0.04, 0.05)]
    chosen = select_lines(lines, 4, path, clearance=0.1)
    assert chosen.is_clear and chosen.clearance >= 0.1
    assert not set(chosen.ids) <= {1, 2, 3, 4}
    far = select_lines(lines, 4, path, clearance=1e6)
    assert not far.is_clear and "asked" in str(far)


def test_lines_out_of_view_do_not_count():
    lines, ends = segments(8)
    behind = [pl.Pose.look_at((4, 0, 1), (8, 0, 1))]
    chosen = select_lines(lines, 4, behind, ends=ends)
    assert np.isinf(chosen.deviation) and mentions(str(chosen), "view")
    # With no ends, a line goes on to where the camera looks.
    assert np.isfinite(select_lines(lines, 4, behind, max_angle=np.pi / 2).deviation)


def test_fewer_than_three_lines_tell_no_pose():
    assert np.isinf(position_deviations(np.eye(6)[np.newaxis], np.array([2]))[0])


@pytest.mark.parametrize(("count", "poses_"), [(2, PATH), (9, PATH), (4, [])])
def test_what_cannot_be_chosen_is_refused(count, poses_):
    lines, _ = segments(8)
    with pytest.raises(pl.PlsingError):
        select_lines(lines, count, poses_)


@given(st.permutations(range(7)))
@settings(max_examples=5)
def test_the_order_of_candidates_does_not_matter(order):
    lines, ends = segments(7)
    assert set(select_lines(lines.select(order), 4, PATH, ends=ends[order]).ids) == set(
        select_lines(lines, 4, PATH, ends=ends).ids
    )
