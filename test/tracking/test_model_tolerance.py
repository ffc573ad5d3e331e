# SPDX-License-Identifier: Apache-2.0
"""What a model is off by belongs in the covariance: objects are drawn whose edges are not where they should be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendered import CAMERA, LIGHTS, QUADS, box
from scipy.spatial.transform import Rotation

from plsing_ros._core import compiled
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.simulation.polygon_renderer import PolygonRenderer
from plsing_ros.tracking import LineTracker
from plsing_ros.tracking.model_tolerance import model_covariance


def fit_of(ends, seen, covariances, start):
    """Return the pose at which the ends of edges, shape (k, 2, 3), lie best on lines, without robust weights."""
    rotation, translation = start
    for _ in range(2):
        rows, right = [], []
        for (a, b), (phi, rho), covariance in zip(ends @ rotation.T + translation, seen, covariances, strict=True):
            root = np.linalg.cholesky(np.linalg.inv(covariance)).T

            def line(motion, a=a, b=b):
                turn = Rotation.from_rotvec(motion[3:]).as_matrix()
                m = np.cross(turn @ a + motion[:3], turn @ b + motion[:3])
                return np.array([np.arctan2(m[1], m[0]), m[2] / np.hypot(*m[:2])])

            now = line(np.zeros(6))
            rows.append(root @ np.column_stack([(line(s) - line(-s)) / 2e-6 for s in 1e-6 * np.eye(6)]))
            right.append(root @ [np.remainder(phi - now[0] + np.pi, 2.0 * np.pi) - np.pi, rho - now[1]])
        step = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
        turn = Rotation.from_rotvec(step[3:]).as_matrix()
        rotation, translation = turn @ rotation, turn @ translation + step[:3]
    matrix = np.vstack(rows)
    return rotation, translation, matrix.T @ matrix


@settings(max_examples=3, deadline=None)
@given(
    x=st.floats(0.2, 0.5),
    y=st.floats(-0.5, -0.2),
    z=st.floats(0.2, 0.4),
    position_std=st.floats(1e-5, 2e-4),
    direction_std=st.floats(1e-5, 1e-3),
    ratio=st.floats(1.0, 5.0),
)
def test_it_is_the_scatter_of_poses_of_objects_that_are_drawn(x, y, z, position_std, direction_std, ratio):
    T = Pose.look_at((x, y, z), (0.0, 0.0, 0.0)).inverse()
    start = np.asarray(T.rotation), np.asarray(T.translation)
    model, random = box(), np.random.default_rng(0)
    ends = model.vertices[model.edges][:9]
    in_camera = ends @ start[0].T + start[1]
    moments = np.cross(in_camera[:, 0], in_camera[:, 1])
    seen = np.column_stack(
        [np.arctan2(moments[:, 1], moments[:, 0]), moments[:, 2] / np.hypot(moments[:, 0], moments[:, 1])]
    )
    sizes = np.linspace(1.0, ratio, len(ends))
    covariances = sizes[:, np.newaxis, np.newaxis] ** 2 * np.diag([1e-6, 1e-7])
    information = fit_of(ends, seen, covariances, start)[2]
    lines = np.column_stack([seen, covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]])
    std = np.tile((position_std, direction_std), (len(ends), 1))
    claimed = model_covariance(in_camera, lines, np.ones(len(ends)), information, np.zeros((6, 6)), std)
    motions = []
    for _ in range(60):
        made = []
        for a, b in ends:
            half, middle = 0.5 * (b - a), 0.5 * (a + b)
            across = np.linalg.svd(half[np.newaxis])[2][1:]
            turned = half + np.linalg.norm(half) * direction_std * random.normal(size=2) @ across
            middle = middle + position_std * random.normal(size=2) @ across
            made.append((middle - turned, middle + turned))
        in_camera_made = np.array(made) @ start[0].T + start[1]
        m = np.cross(in_camera_made[:, 0], in_camera_made[:, 1])
        lines_made = np.column_stack([np.arctan2(m[:, 1], m[:, 0]), m[:, 2] / np.hypot(m[:, 0], m[:, 1])])
        rotation, translation, _ = fit_of(ends, lines_made, covariances, start)
        motions.append(compiled.motion_between(Pose(*start), Pose(rotation, translation)))
    squares = [each @ np.linalg.solve(claimed, each) for each in np.array(motions)]
    # The mean of 60 draws of six degrees of freedom scatters by 0.45.
    assert 4.0 < np.mean(squares) < 8.0


@pytest.mark.parametrize(("growth", "sides"), [(1.015, (0.12, 0.09, 0.07)), (0.985, (0.08, 0.11, 0.1))])
def test_an_object_of_another_size_is_where_its_tolerance_says(growth, sides):
    """No residual tells that an object is larger than its model, and seems nearer: only its tolerance can."""
    model, random = box(*sides), np.random.default_rng(1)
    drawing = PolygonRenderer(Model.from_faces(growth * model.vertices, QUADS), CAMERA, LIGHTS, 0.02)
    std = np.tile((1e-3, 1e-3), (len(model), 1))
    trackers = LineTracker(model, CAMERA), LineTracker(model, CAMERA, edge_std=std)
    squares: list[list[float]] = [[], []]
    for k in range(12):
        true = Pose.look_at((0.4, -0.3 + 0.01 * k, 0.25), (0.0, 0.0, 0.0))
        image = drawing.render(true.inverse(), 2.0, random)
        for each, tracker in zip(squares, trackers, strict=True):
            found = tracker.track(image, true if k == 0 else None)
            turn = Rotation.from_matrix(found.T_world_camera.rotation @ true.rotation.T).as_rotvec()
            off = np.concatenate([found.T_world_camera.translation - true.translation, turn])
            each.append(off @ np.linalg.solve(found.covariance, off))
    assert np.median(squares[0]) > 40.0
    assert np.median(squares[1]) < 13.0
