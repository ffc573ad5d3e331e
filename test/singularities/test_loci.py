# SPDX-License-Identifier: Apache-2.0
"""Distances, surfaces, unobservable motions, nearest transversals, certificates: the parts of a singular set."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from messages import mentions
from scipy.optimize import minimize
from singular_scenes import PAPER_FOUR, distance_to_line, line_set, min_ratio, paper_lines
from strategies import line_sets, vectors

from plsing_ros.errors import GeometryError
from plsing_ros.features import rank_basis
from plsing_ros.geometry import LineSet
from plsing_ros.singularities import Kind, MotionKind, singular_set, surface_triangles, unobservable_motions

SINGULAR = singular_set(line_set(PAPER_FOUR, ids=[4, 7, 9, 2]))
THREE = singular_set(line_set(([[0, 0, 0], [0, 0, 2], [3, 5, 0]], [[1, 0, 0], [4, -5, 0], [3, 7, 3]])))


def test_names_and_order():
    assert SINGULAR.locus_names == (
        "transversal 1",
        "transversal 2",
        *(f"isolated point {i}" for i in range(1, 7)),
        "line 4",
        "line 7",
        "line 9",
        "line 2",
    )
    kinds = [Kind.TRANSVERSAL] * 2 + [Kind.ISOLATED_POINT] * 6 + [Kind.OBSERVED_LINE] * 4
    assert list(SINGULAR.locus_kinds) == kinds
    from_center = np.linalg.norm(SINGULAR.isolated_points - SINGULAR.frame.center, axis=1)
    assert (np.diff(from_center) > 0.0).all()
    assert THREE.locus_names[-2:] == ("quadric", "cubic surface")


@given(center=vectors())
@settings(deadline=None)
def test_distances_are_distances(center):
    arrays = SINGULAR.distance_arrays(center)
    expected = [distance_to_line(center, t.point, t.direction) for t in SINGULAR.transversals]
    expected += [np.linalg.norm(p - center) for p in SINGULAR.isolated_points]
    expected += [distance_to_line(center, p, u) for p, u in zip(*PAPER_FOUR, strict=True)]
    np.testing.assert_allclose(arrays.distance, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(arrays.closest_point - center, axis=1), arrays.distance, atol=1e-12)
    nearest_first = SINGULAR.distances(center)
    assert [d.distance for d in nearest_first] == sorted(d.distance for d in nearest_first)
    by_name = {d.name: d for d in nearest_first}
    assert set(by_name) == set(SINGULAR.locus_names)
    for name, kind, distance in zip(SINGULAR.locus_names, SINGULAR.locus_kinds, arrays.distance, strict=True):
        assert by_name[name].kind is kind
        assert by_name[name].distance == distance


@given(lines=line_sets(min_size=3, max_size=6), center=vectors())
@settings(max_examples=25)
def test_the_nearest_locus_is_the_nearest_that_is_no_observed_line(lines, center):
    singular = singular_set(lines)
    nearest = singular.nearest_locus(center)
    others = [each for each in singular.distances(center) if each.kind is not Kind.OBSERVED_LINE]
    assert (nearest is None) == (not others)
    if nearest is not None:
        assert nearest.name == others[0].name
        assert nearest.distance == min(each.distance for each in others)
        np.testing.assert_array_equal(nearest.closest_point, others[0].closest_point)


@given(center=vectors())
@settings(max_examples=40, deadline=None)
def test_surfaces_are_the_products_of_the_normals(center):
    lines = THREE.lines
    xi = rank_basis(lines, center)
    g = np.linalg.det(xi[0::2, :3])
    h = np.linalg.det(xi[1::2, 3:])
    for surface, value in zip(THREE.surfaces, (g, h), strict=True):
        far = np.array([31.0, -17.0, 23.0])
        reference = rank_basis(lines, far)
        scale = np.linalg.det(reference[0::2, :3] if surface.kind is Kind.QUADRIC else reference[1::2, 3:])
        scale /= surface.value(far[np.newaxis])[0]
        size = np.abs(scale) * (1.0 + np.abs(center).max()) ** surface.degree
        assert abs(surface.value(center[np.newaxis])[0] * scale - value) < 1e-10 * size
        powers = np.array([np.prod(center ** np.array(e)) for e in surface.exponents])
        assert abs(powers @ surface.coefficients - surface.value(center[np.newaxis])[0]) < 1e-10 * (size / abs(scale))
    assert [len(surface.coefficients) for surface in THREE.surfaces] == [10, 20]


@given(center=vectors())
@settings(max_examples=30, deadline=None)
def test_gradients_match_central_differences(center):
    for surface in THREE.surfaces:
        step = 1e-5
        numeric = [
            (surface.value([center + step * e])[0] - surface.value([center - step * e])[0]) / (2 * step)
            for e in np.eye(3)
        ]
        np.testing.assert_allclose(surface.gradient([center])[0], numeric, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("surface", THREE.surfaces, ids=lambda s: s.name)
@pytest.mark.parametrize("seed", range(6))
def test_nearest_point_of_a_surface(surface, seed):
    center = np.random.default_rng(seed).uniform(-4, 4, size=3)
    nearest = surface.nearest_point(center)
    assert min_ratio(THREE.lines, nearest) < 1e-9
    offset, gradient = nearest - center, surface.gradient([nearest])[0]
    assert np.linalg.norm(np.cross(offset, gradient)) < 1e-8 * np.linalg.norm(offset) * np.linalg.norm(gradient)
    # Nothing that a general-purpose optimiser finds is closer.
    for start in np.random.default_rng(seed + 100).uniform(-6, 6, size=(8, 3)):
        other = minimize(
            lambda p: (p - center) @ (p - center),
            start,
            method="SLSQP",
            constraints={"type": "eq", "fun": lambda p: surface.value([p])[0]},
        )
        if other.success and abs(surface.value([other.x])[0]) < 1e-9:
            assert np.linalg.norm(other.x - center) > np.linalg.norm(offset) - 1e-4
    # The first-order distance of every cycle has the same value near the surface.
    near = nearest + 1e-4 * offset / np.linalg.norm(offset) * -1.0
    index = THREE.locus_names.index(surface.name)
    assert THREE.distance_arrays(near).distance[index] == pytest.approx(1e-4, rel=0.05)


def test_mesh_lies_on_the_surface():
    for surface in THREE.surfaces:
        coarse, fine = (surface_triangles(surface, [0, 0, 0], 3.0, resolution) for resolution in (8, 32))
        assert len(fine) > 10 * len(coarse) > 0
        assert np.abs(fine).max() <= 3.0 + 1e-12
        errors = []
        for triangles in (coarse, fine):
            corners = triangles.reshape(-1, 3)
            slope = np.linalg.norm(surface.gradient(corners), axis=1)
            errors.append(np.median(np.abs(surface.value(corners)) / slope))
        # Linear interpolation: sixteen times smaller with a quarter of the cell once cells are small; eight is coarse.
        assert errors[1] < errors[0] / 4.0
    with pytest.raises(GeometryError, match="resolution"):
        surface_triangles(THREE.surfaces[0], [0, 0, 0], 1.0, 0)


def test_lost_motions_move_no_image_line():
    centers = [*SINGULAR.isolated_points, *(t.point + 0.7 * t.direction for t in SINGULAR.transversals)]
    for center in centers:
        (motion,) = SINGULAR.unobservable_motions(center)
        xi = rank_basis(SINGULAR.lines, center, normalized=True)
        twist = np.concatenate([motion.linear, motion.angular])
        assert np.abs(xi @ twist).max() < 1e-9 * np.linalg.norm(twist) * (1.0 + np.linalg.norm(center))
        if motion.kind is MotionKind.TRANSLATION:
            assert not motion.angular.any()
            assert motion.pitch == np.inf
        else:
            # v = (axis point - C) x ... : the velocity of the centre is that of the screw.
            rebuilt = np.cross(motion.angular, center - motion.axis_point) + motion.pitch * motion.angular
            np.testing.assert_allclose(rebuilt, motion.linear, atol=1e-9 * (1.0 + np.linalg.norm(motion.linear)))
            assert motion.kind is MotionKind.SCREW
    assert SINGULAR.unobservable_motions([0.2, 0.3, 0.9]) == ()
    assert "screw" in str(SINGULAR.unobservable_motions(SINGULAR.isolated_points[0])[0])


def test_three_lines_lose_a_translation_on_the_quadric_and_a_screw_on_the_cubic():
    quadric, cubic = THREE.surfaces
    (motion,) = unobservable_motions(THREE.lines, quadric.nearest_point([1.0, 1.0, 1.0]))
    assert motion.kind is MotionKind.TRANSLATION
    (motion,) = unobservable_motions(THREE.lines, cubic.nearest_point([1.0, 1.0, 1.0]))
    assert motion.kind is MotionKind.SCREW


def test_nearest_transversal_of_measured_lines():
    s, d = (4, -5, 7, 3, -2, 13, -11, 6), (2, 3, 5, 1, 7, -4, 7.717690945455682)
    points, directions = paper_lines(s, d)
    exact = singular_set(line_set((points, directions)))
    noisy_points = np.array(points, float) + 1e-4 * np.random.default_rng(0).normal(size=(5, 3))
    noisy = singular_set(line_set((noisy_points, directions)))
    assert noisy.transversals == ()
    nearest = noisy.nearest_transversal
    assert 0.0 < nearest.miss.max() < 1e-3
    assert nearest.residual < 1e-3
    (true,) = exact.transversals
    assert abs(nearest.direction @ true.direction) > 1.0 - 1e-6
    assert distance_to_line(nearest.point, true.point, true.direction) < 1e-2
    # What it says about its misses is true.
    for miss, point, u in zip(nearest.miss, noisy_points, directions, strict=True):
        across = np.cross(u, nearest.direction)
        assert miss == pytest.approx(abs((point - nearest.point) @ across) / np.linalg.norm(across), abs=1e-9)


@given(lines=line_sets(min_size=5, max_size=6))
@settings(max_examples=25, deadline=None)
def test_nearest_transversal_is_a_local_minimum(lines):
    singular = singular_set(lines)
    assume(not singular.singular_everywhere)
    nearest = singular.nearest_transversal
    frame = singular.frame
    rows = np.concatenate([frame.moment, frame.direction], axis=1)
    assume(len(rows) == len(lines))

    def cost(point, direction):
        direction = direction / np.linalg.norm(direction)
        return np.linalg.norm(rows @ np.concatenate([direction, np.cross(point, direction)]))

    point = frame.to_scene(nearest.point)
    best = cost(point, nearest.direction)
    rng = np.random.default_rng(0)
    for size in (1e-2, 1e-3):
        for _ in range(20):
            moved = cost(point + size * rng.normal(size=3), nearest.direction + size * rng.normal(size=3))
            assert moved >= best - 1e-6 * (1.0 + best)


def test_nearest_transversal_where_no_line_comes_near():
    # Gauss-Newton stalls here at 0.2900.
    points = [[0, 0, 1], [0, 0, 0], [-1, -0.5, 0.5], [0.5, 0, -0.5], [2, 1, 2]]
    directions = [[0, 1, 0], [1, 0, 0], [0, 1, 1], [1, 0, 1], [-1, 0, 1]]
    singular = singular_set(line_set((points, directions)))
    starts = np.random.default_rng(1).normal(size=(20, 6))
    rows = singular.frame.plucker_matrix

    def cost(x):
        direction = x[:3] / np.linalg.norm(x[:3])
        return np.linalg.norm(rows @ np.concatenate([direction, np.cross(x[3:], direction)]))

    nearest = singular.nearest_transversal
    own = cost(np.concatenate([nearest.direction, singular.frame.to_scene(nearest.point)]))
    assert own <= min(minimize(cost, start).fun for start in starts) + 1e-9


@settings(max_examples=10, deadline=None)
@given(angles=st.lists(st.integers(0, 30), min_size=4, max_size=4, unique=True), height=st.floats(-3.0, 3.0))
def test_a_transversal_at_infinity_is_said_to_be_there(angles, height):
    """Horizontal lines are met by the line at infinity of the horizontal planes."""
    turn = 0.1 * np.array(angles)
    points = [[0.0, 0.0, height], [1.0, 2.0, 0.3], [-0.7, 1.1, 4.0], [2.0, -1.0, -1.5]]
    lines = LineSet.from_points_directions(points, np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1))
    assert mentions(str(singular_set(lines)), "at infinity", "(0, 0, 1)")
    assert "at infinity" not in str(SINGULAR)


def test_an_observed_line_is_listed_once():
    """Spokes through an axis, and the axis: it meets them all, and is no locus beside itself."""
    points = [[0.0, 0.0, z] for z in (0.0, 1.0, 2.0, 3.5, 0.7)]
    directions = [[1.0, 0.3, 0.2], [-0.4, 1.0, 0.3], [0.7, -1.0, 0.1], [1.0, 1.0, -0.8]]
    spokes = singular_set(LineSet.from_points_directions(points[:4], directions))
    assert any(locus.distance([0.0, 0.0, 9.0]) < 1e-9 for locus in spokes.loci)
    both = singular_set(LineSet.from_points_directions(points, [*directions, [0.0, 0.0, 1.0]]))
    assert both.transversals == ()
    assert mentions(both.description, "Line 5")
    assert [each.name for each in both.distances([0.0, 0.0, 9.0]) if each.distance < 1e-9] == ["line 5"]
