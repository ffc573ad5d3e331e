# SPDX-License-Identifier: Apache-2.0
"""Distances to keep, against distances in plain numpy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import directions, vectors

from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.planning.clearance import Clearance
from plsing_ros.singularities import singular_set

SINGULAR = singular_set(read_scene(config_file("paper_p4l.yaml")))
THREE = singular_set(SINGULAR.lines.select([0, 1, 2]))


@given(centers=st.lists(vectors(), min_size=1, max_size=4).map(np.array), start=vectors(), target=vectors())
def test_distances_to_lines_and_points(centers, start, target):
    found = Clearance(SINGULAR, start, target, 0.2).distances(centers)
    lines = [(t.point, t.direction) for t in SINGULAR.transversals]
    observed = list(zip(SINGULAR.lines.point, SINGULAR.lines.direction, strict=True))
    columns = [np.linalg.norm(np.cross(centers - point, direction), axis=1) for point, direction in lines]
    columns += [np.linalg.norm(centers - point, axis=1) for point in SINGULAR.isolated_points]
    columns += [np.linalg.norm(np.cross(centers - point, direction), axis=1) for point, direction in observed]
    np.testing.assert_allclose(found, np.column_stack(columns), atol=1e-9)


@given(start=vectors(), target=vectors(), margin=st.floats(0.01, 2.0))
def test_ends_keep_less_than_they_have_and_the_way_no_more_than_the_margin(start, target, margin):
    clearance = Clearance(SINGULAR, start, target, margin)
    ends = np.array([start, target])
    assert (clearance.to_keep(ends) <= 0.9 * clearance.distances(ends) + 1e-12).all()
    far = start + np.array([[1e3, 0.0, 0.0]])
    assert (clearance.to_keep(np.vstack([ends, far])) <= margin).all()
    assert (clearance.excess(ends) >= -1e-12).all()


@settings(max_examples=50)
@given(start=vectors(), target=vectors(), keep_side=st.booleans())
def test_surfaces_between_start_and_goal_are_crossed_the_others_are_not(start, target, keep_side):
    clearance = Clearance(THREE, start, target, 0.2, keep_side)
    ends = np.array([start, target])
    separating = {surface.name for surface in THREE.surfaces if np.prod(np.sign(surface.value(ends))) < 0.0}
    assert set(clearance.crossed) == (separating if keep_side else {surface.name for surface in THREE.surfaces})
    assert set(clearance.names) == set(THREE.locus_names) - set(clearance.crossed)
    # On their own side, ends have no negative distance.
    assert (clearance.distances(ends) >= 0.0).all()


@given(center=vectors(), along=directions(), part=st.integers(0, 11))
def test_directions_out_are_across_the_motion_and_the_first_leads_away_from_a_line(center, along, part):
    along = along / np.linalg.norm(along)
    clearance = Clearance(SINGULAR, center, center + along, 0.2)
    paths = clearance.directions_out(center, part, along, 8)
    np.testing.assert_allclose(paths @ along, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(paths, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(paths.sum(axis=0), 0.0, atol=1e-9)
    if part < len(SINGULAR.transversals):
        direction = SINGULAR.transversals[part].direction
        if np.linalg.norm(np.cross(direction, along)) > 1e-3:
            assert paths[0] @ direction == pytest.approx(0.0, abs=1e-6)
