# SPDX-License-Identifier: Apache-2.0
"""Paths and trajectories keep away from what is singular within the tolerances of measured lines."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plsing_ros.geometry import LineSet, Pose
from plsing_ros.planning.detour import Decision, DetourOptions, plan_path
from plsing_ros.planning.trajectory_detour import plan_trajectory
from plsing_ros.singularities import Kind, singular_set

X, Y, Z = np.eye(3).tolist()
CORRIDOR = (
    [[0, 0, 0], [4, 0, 0], [0, 3, 0], [4, 3, 0], [0, 0, 2], [0, 3, 2], [0, 0, 2], [4, 0, 2]],
    [Z, Z, Z, Z, X, X, Y, Y],
)
MIDDLE, RADIUS = np.array([2.0, 1.5, 2.0]), 2.5
WINDOW = ([[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 1.4], [0.5, 0, 0]], [Z, Z, X, X, Z])
OPTIONS = DetourOptions(margin=0.2)


def measured(scene, seed):
    points, directions = np.array(scene[0], dtype=float), np.array(scene[1], dtype=float)
    errors = 1e-3 * np.random.default_rng(seed).normal(size=(2, *points.shape))
    return LineSet.from_points_directions(
        points + errors[0], directions + errors[1], position_std=1e-3, direction_std=1e-3
    )


def from_circle(centers):
    """Distances of centres (k, 3) from the circle that is singular for the ideal corridor."""
    across = np.linalg.norm(centers[:, :2] - MIDDLE[:2], axis=1)
    return np.hypot(across - RADIUS, centers[:, 2] - MIDDLE[2])


@settings(max_examples=4, deadline=None)
# At a turn of 0.6435 a corner of the corridor is on the circle, and nearer than it.
@given(turn=st.one_of(st.floats(0.3, 0.55), st.floats(0.75, 1.2)), seed=st.integers(0, 99))
def test_a_path_goes_round_a_circle(turn, seed):
    """From one side of the end wall's plane to the other, straight through the circle of the ideal corridor."""
    singular = singular_set(measured(CORRIDOR, seed))
    assert Kind.CONIC in {locus.kind for locus in singular.loci}
    through = MIDDLE + RADIUS * np.array([np.cos(turn), np.sin(turn), 0.0])
    look = Pose.look_at(through + [0.5, 0.4, 6.0], MIDDLE).rotation
    start, target = Pose(look, through + [0.0, 0.1, 0.9]), Pose(look, through + [0.0, -0.1, -0.9])
    plan = plan_path(singular, start, target, OPTIONS)
    assert plan.decision is Decision.DETOUR
    assert re.search(r"\bcircle\b.*\b0\.0", plan.reason)
    _, centers = plan.path.poses(np.linspace(0.0, 1.0, 300))
    assert from_circle(centers).min() > 0.6 * plan.margin


@settings(max_examples=4, deadline=None)
@given(x=st.floats(0.2, 0.9), seed=st.integers(0, 99))
def test_a_plane_is_crossed_and_said_to_be(x, seed):
    singular = singular_set(measured(WINDOW, seed))
    (plane,) = singular.loci
    assert plane.kind is Kind.PLANE
    start = Pose.look_at([x, -1.5, 2.4], [0.5, 0.0, 0.7])
    plan = plan_path(singular, start, Pose(start.rotation, np.array([x, 0.7, 2.4])), OPTIONS)
    assert plan.decision is not Decision.REFUSE
    assert f"across {plane.name}" in plan.reason
    # On one side of it nothing is crossed.
    aside = plan_path(singular, start, Pose(start.rotation, np.array([x + 0.3, -1.2, 2.2])), OPTIONS)
    assert "across" not in aside.reason


@pytest.mark.parametrize("seed", range(2))
def test_a_trajectory_is_left_near_a_circle(seed):
    singular = singular_set(measured(CORRIDOR, seed))
    through = MIDDLE + [0.0, RADIUS, 0.0]
    look = Pose.look_at(through + [0.5, 0.4, 6.0], MIDDLE).rotation

    def trajectory(time):
        return Pose(look, through + [0.3, 0.0, 1.0 - 0.04 * time])

    assert from_circle(np.array([trajectory(t).translation for t in np.linspace(0.0, 50.0, 500)])).min() < 0.05
    plan = plan_trajectory(singular, trajectory, 50.0, OPTIONS)
    assert any("circle" in piece.reason for piece in plan.pieces)
    centers = np.array([plan.pose(t).translation for t in np.linspace(0.0, 50.0, 500)])
    assert from_circle(centers).min() > 0.12
