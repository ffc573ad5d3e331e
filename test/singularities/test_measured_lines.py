# SPDX-License-Identifier: Apache-2.0
"""Loci of lines with tolerances: those of the exact scene, found again, near where they were, with true figures."""

import numpy as np
import pytest
from singular_scenes import PAPER_FOUR, box_edges, line_set, min_ratio, paper_lines

from plsing_ros.geometry import LineSet
from plsing_ros.singularities import Kind, singular_set

BOX = box_edges()
CORRIDOR = (
    [[0, 0, 0], [4, 0, 0], [0, 3, 0], [4, 3, 0], [2, 0, 8], [2, 3, 8], [0, 1.5, 8], [4, 1.5, 8]],
    [[0, 0, 1]] * 4 + [[1, 0, 0]] * 2 + [[0, 1, 0]] * 2,
)
SCENES = {
    "corridor with its end wall": (CORRIDOR, ("circle",)),
    "five edges of a box": (([BOX[0][i] for i in (0, 1, 4, 5, 8)], [BOX[1][i] for i in (0, 1, 4, 5, 8)]), None),
    "window with a bar": (
        ([[0, 0, 0], [0, 0, 1.2], [0, 0, 0], [0.9, 0, 0], [0.4, 0, 0]], [[1, 0, 0]] * 2 + [[0, 0, 1]] * 3),
        ("plane",),
    ),
    "a sheet of five lines": (
        ([[0, 0, 1], [0.9, 0, 1], [0.45, 0, 2], [0.45, 0, 0], [1, 0, 1.2]],
         [[0, 0, 1], [0, 0, 1], [1, 0, 0], [1, 0, 0], [0.3, 0, 1]]),
        ("plane",),
    ),
}  # fmt: skip


def measured(scene, position_std, direction_std, seed):
    generator = np.random.default_rng(seed)
    points, directions = (np.array(each, dtype=float) for each in scene)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return LineSet.from_points_directions(
        points + position_std * generator.normal(size=points.shape),
        directions + direction_std * generator.normal(size=points.shape),
        position_std=position_std,
        direction_std=direction_std,
    )


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("size", [1e-7, 1e-4, 1e-3, 4e-3])
def test_the_loci_of_the_exact_scene_are_found_again(name, size):
    scene, names = SCENES[name]
    exact = singular_set(line_set(scene))
    if names is not None:
        assert tuple(locus.name for locus in exact.loci) == names
    for seed in range(3):
        lines = measured(scene, size, size, seed)
        singular = singular_set(lines)
        assert [(locus.name, locus.kind) for locus in singular.loci] == [(each.name, each.kind) for each in exact.loci]
        for locus, true in zip(singular.loci, exact.loci, strict=True):
            assert 0.0 < locus.exactness < 3.0
            assert true.exactness == 0.0
            # A camera on the true locus is in the width of the found one, and as good as singular.
            for center in true.samples[:5]:
                assert locus.distance(center) < 3.0 * locus.half_width
            assert locus.lowest_relative_condition < 0.1
            assert locus.half_width == pytest.approx(true.half_width, rel=0.2)
        # What is said to be exact for the exact lines is.
        for locus in singular.loci:
            for center in locus.samples[:5]:
                assert min_ratio(singular.exact_lines, center) < 1e-8


@pytest.mark.parametrize("name", SCENES)
def test_drawings_lie_on_their_loci(name):
    """Each locus draws itself, surfaces as meshes and the rest as polylines, in the ball or cube asked for."""
    singular = singular_set(measured(SCENES[name][0], 1e-4, 1e-4, 0))
    for locus in singular.loci:
        middle, radius = locus.samples[0], 2.0 * singular.frame.length
        polyline, mesh = locus.polyline(middle, radius), locus.mesh(middle, radius, 12)
        is_surface = locus.kind in (Kind.PLANE, Kind.QUADRIC, Kind.CUBIC)
        assert (len(polyline) == 0, len(mesh) > 0) == (is_surface, is_surface)
        points = (mesh if is_surface else polyline).reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        assert np.abs(points - middle).max() <= radius * (1.0 + 1e-9)
        assert max(locus.distance(point) for point in points) <= 0.1 * radius
        if locus.kind is not Kind.QUADRIC:
            assert max(locus.distance(point) for point in points) <= 1e-9 * radius


def test_without_tolerances_measured_lines_are_general_ones():
    lines = measured(CORRIDOR, 1e-3, 1e-3, 0)
    taken_as_exact = singular_set(LineSet(lines.direction, lines.moment, lines.frame))
    assert taken_as_exact.loci == ()
    assert taken_as_exact.exactness == 0.0
    assert taken_as_exact.proximity([4.5, 1.5, 8.0]).z is None
    assert singular_set(lines).proximity([4.5, 1.5, 8.0]).z < 4.0


def test_widths_are_those_of_a_scan():
    """Going away from the plane of a window, 1/cond comes to a tenth of normal at the half width."""
    singular = singular_set(line_set(SCENES["window with a bar"][0]))
    (plane,) = singular.loci
    places = []
    for center in plane.samples[:15]:
        heights = np.linspace(0.0, 5.0 * plane.half_width, 400)[1:]
        conditions = [singular.proximity(center + [0.0, height, 0.0]).relative_condition for height in heights]
        places.append(heights[np.argmax(np.array(conditions) > 0.1)])
    assert np.median(places) == pytest.approx(plane.half_width, rel=0.3)


def test_lines_that_are_nearly_parallel_are_singular_everywhere():
    nosings = [[0.0, 0.28 * i, 0.17 * i] for i in range(5)]
    lines = measured((nosings, [[1.0, 0.0, 0.0]] * 5), 1e-3, 1e-3, 1)
    singular = singular_set(lines)
    assert singular.singular_everywhere
    (everywhere,) = singular.loci
    assert everywhere.kind is Kind.EVERYWHERE
    assert everywhere.distance([1.0, 2.0, 3.0]) == 0.0
    assert everywhere.half_width == np.inf
    assert singular.proximity([0.5, -1.5, 1.5]).z < 3.0


def test_a_transversal_of_five_measured_lines():
    s, d = (4, -5, 7, 3, -2, 13, -11, 6), (2, 3, 5, 1, 7, -4, 7.717690945455682)
    scene = paper_lines(s, d)
    (true,) = singular_set(line_set(scene)).transversals
    found = singular_set(measured(scene, 1e-3, 1e-3, 2)).transversals
    assert len(found) == 1
    assert abs(found[0].direction @ true.direction) > 1.0 - 1e-4
    assert 0.0 < found[0].exactness < 3.0
    # Half a metre off the special position, nothing meets all five within a millimetre.
    d = (*d[:-1], d[-1] + 0.5)
    assert singular_set(measured(paper_lines(s, d), 1e-3, 1e-3, 2)).transversals == ()


def test_general_lines_stay_as_they_are():
    lines = measured(PAPER_FOUR, 0.0, 0.0, 0)
    std = np.full(4, 1e-3)
    tolerant = LineSet(lines.direction, lines.moment, lines.frame, position_std=std, direction_std=std)
    np.testing.assert_array_equal(singular_set(tolerant).isolated_points, singular_set(lines).isolated_points)
