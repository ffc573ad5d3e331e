"""Distances to keep, against distances in plain numpy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import directions, vectors

from plsing_ros.experiments.config_files import config_file
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.servoing.ways.clearance import Clearance
from plsing_ros.singularities import singular_set

FOUND = singular_set(read_scene(config_file("paper_p4l.yaml")))
THREE = singular_set(FOUND.lines.select([0, 1, 2]))


@given(centers=st.lists(vectors(), min_size=1, max_size=4).map(np.array), start=vectors(), goal=vectors())
def test_distances_to_lines_and_points(centers, start, goal):
    found = Clearance(FOUND, start, goal, 0.2).distances(centers)
    lines = [(t.point, t.direction) for t in FOUND.transversals]
    observed = list(zip(FOUND.lines.point, FOUND.lines.direction, strict=True))
    columns = [np.linalg.norm(np.cross(centers - point, direction), axis=1) for point, direction in lines]
    columns += [np.linalg.norm(centers - point, axis=1) for point in FOUND.isolated_points]
    columns += [np.linalg.norm(np.cross(centers - point, direction), axis=1) for point, direction in observed]
    np.testing.assert_allclose(found, np.column_stack(columns), atol=1e-9)


@given(start=vectors(), goal=vectors(), margin=st.floats(0.01, 2.0))
def test_ends_keep_less_than_they_have_and_the_way_no_more_than_the_margin(start, goal, margin):
    clearance = Clearance(FOUND, start, goal, margin)
    ends = np.array([start, goal])
    assert (clearance.to_keep(ends) <= 0.9 * clearance.distances(ends) + 1e-12).all()
    far = start + np.array([[1e3, 0.0, 0.0]])
    assert (clearance.to_keep(np.vstack([ends, far])) <= margin).all()
    assert (clearance.excess(ends) >= -1e-12).all()


@settings(max_examples=50)
@given(start=vectors(), goal=vectors(), keep_side=st.booleans())
def test_surfaces_between_start_and_goal_are_crossed_the_others_are_not(start, goal, keep_side):
    clearance = Clearance(THREE, start, goal, 0.2, keep_side)
    ends = np.array([start, goal])
    separating = {surface.name for surface in THREE.surfaces if np.prod(np.sign(surface.value(ends))) < 0.0}
    assert set(clearance.crossed) == (separating if keep_side else {surface.name for surface in THREE.surfaces})
    assert set(clearance.names) == set(THREE.locus_names) - set(clearance.crossed)
    # On their own side, ends have no negative distance.
    assert (clearance.distances(ends) >= 0.0).all()


@given(center=vectors(), along=directions(), part=st.integers(0, 11))
def test_ways_out_are_across_the_motion_and_the_first_leads_away_from_a_line(center, along, part):
    along = along / np.linalg.norm(along)
    clearance = Clearance(FOUND, center, center + along, 0.2)
    ways = clearance.ways_out(center, part, along, 8)
    np.testing.assert_allclose(ways @ along, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(ways.sum(axis=0), 0.0, atol=1e-9)
    if part < len(FOUND.transversals):
        direction = FOUND.transversals[part].direction
        if np.linalg.norm(np.cross(direction, along)) > 1e-3:
            assert ways[0] @ direction == pytest.approx(0.0, abs=1e-6)
