# SPDX-License-Identifier: Apache-2.0
"""Objects, cameras and motions that the tests of the tracker draw."""

from __future__ import annotations

import numpy as np

from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.simulation.polygon_renderer import PolygonRenderer, random_patches
from plsing_ros.tracking import PinholeCamera

CAMERA = PinholeCamera(640, 480, 600.0, 605.0, 322.3, 236.8)
LENS = PinholeCamera(640, 480, 600.0, 605.0, 322.3, 236.8, (-0.25, 0.08, 0.001, -0.0005, 0.0))
QUADS = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
LIGHTS = (0.15, 0.75, 0.3, 0.55, 0.45, 0.62)


def box(x=0.12, y=0.09, z=0.07):
    """Return a box about the origin."""
    corners = 0.5 * np.array(
        [[-x, -y, -z], [x, -y, -z], [x, y, -z], [-x, y, -z], [-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]]
    )
    return Model.from_faces(corners, QUADS)


def renderer(model=None, camera=CAMERA, patches=0, **options):
    model = model or box()
    painted = random_patches(model, patches, np.random.default_rng(7)) if patches else ()
    return PolygonRenderer(model, camera, LIGHTS[: len(model.faces)], patches=painted, **options)


def orbit(k, steps=200.0, distance=0.45):
    """Return T_world_camera on a path round the origin, above it."""
    angle = 0.4 + 1.2 * np.sin(2.0 * np.pi * k / steps)
    height = 0.22 + 0.05 * np.cos(2.0 * np.pi * k / steps)
    far = distance + 0.06 * np.sin(4.0 * np.pi * k / steps)
    center = [far * np.cos(angle), far * np.sin(angle), height]
    return Pose.look_at(center, (0.02 * np.sin(k), 0.01, 0.0))


def error(found, true):
    """Return how far a pose is off [m] and [rad]."""
    off = true.inverse() @ found
    cosine = 0.5 * (np.trace(off.rotation) - 1.0)
    return float(np.linalg.norm(off.translation)), float(np.arccos(np.clip(cosine, -1.0, 1.0)))
