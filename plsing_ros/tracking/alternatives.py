# SPDX-License-Identifier: Apache-2.0
"""Other poses of an object: symmetries, the second pose of a flat one, and where to search for a lost one."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.geometry.rotations import exponential

Rows = npt.NDArray[np.int32] | npt.NDArray[np.int_]

# Vertices, as a share of the model's size, and planes of visible edges.
_TOLERANCE = 1e-3
# Where a lost object is searched for: rings about the line of sight [px] with so many places, turns about it [rad], and
# shares of the distance.
_RINGS = (18.0, 6), (36.0, 10)
_ROLL = 0.1
_DEPTH = 0.08
# How far a first pose may be off: a turn [rad], a shift in the image [px], and as many times that along the view.
_NEAR_TURN, _NEAR_SHIFT, _NEAR_DEPTH = 0.09, 12.0, 3.0
# Models with more edges are taken as they are: comparing all with all would take too long.
_MAX_EDGES = 200


def symmetries(model: Model) -> list[Pose]:
    """Return the rotations other than none, about the model's middle, that map its edges onto its edges.

    Each is the pose T_model_model' of the turned model.
    """
    if len(model) > _MAX_EDGES:
        return []
    used = np.unique(model.edges)
    middle = model.vertices[used].mean(axis=0)
    points = model.vertices - middle
    size = float(np.linalg.norm(points[used], axis=1).max())
    pairs = {frozenset(edge) for edge in model.edges.tolist()}
    first = next((edge for edge in model.edges if _spans(points[edge], size)), None)
    if first is None:
        return []
    found: list[Pose] = []
    for edge in model.edges:
        for ends in (edge, edge[::-1]):
            if np.abs(points[ends] @ points[ends].T - points[first] @ points[first].T).max() > _TOLERANCE * size**2:
                continue
            rotation = _basis(points[ends]) @ _basis(points[first]).T
            if np.trace(rotation) > 3.0 - 1e-6 or not _maps(rotation, points, used, pairs, _TOLERANCE * size):
                continue
            found.append(Pose(rotation, middle - rotation @ middle))
    return found


def is_flat(model: Model, edges: Rows) -> bool:
    """Return whether edges lie in one plane, and not on one line."""
    points = model.vertices[np.unique(model.edges[edges])]
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(points) >= 3 and bool(values[-1] <= _TOLERANCE * values[0])


def flipped(model: Model, edges: Rows, T_camera_model: Pose) -> Pose | None:
    """Return the pose near the second minimum of a flat set of edges; None if they are seen straight on.

    A flat object that is tilted about a line of sight to one side looks nearly as if it were tilted to the other.

    Args:
        model: The object.
        edges: Rows of the visible edges.
        T_camera_model: The pose.

    Source: Schweighofer and Pinz (2006), whose two minima are these in the limit of weak perspective.
    """
    used = np.unique(model.edges[edges])
    points = model.vertices[used] @ T_camera_model.rotation.T + T_camera_model.translation
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    normal, sight = axes[-1], middle / np.linalg.norm(middle)
    normal = normal * math.copysign(1.0, float(normal @ sight))
    axis = cross(normal, sight)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return None
    return _turned(T_camera_model, 2.0 * math.asin(min(sine, 1.0)) / sine * axis, middle)


def surroundings(T_camera_model: Pose, center: Array, focal: float) -> list[Pose]:
    """Return poses round one, the nearest first, so near to each other that a search for edges closes the gaps.

    Args:
        T_camera_model: The pose.
        center: Of the object, in the model frame, shape (3,) [m].
        focal: Of the camera [px].
    """
    middle = T_camera_model.rotation @ center + T_camera_model.translation
    sight = middle / np.linalg.norm(middle)
    across = cross(np.array([0.0, 1.0, 0.0]), sight)
    down = cross(sight, across)
    turns = [
        radius / focal * (math.cos(angle) * across + math.sin(angle) * down)
        for radius, count in _RINGS
        for angle in 2.0 * math.pi * np.arange(count) / count
    ]
    found = [Pose(exponential(each)[0], np.zeros(3)) @ T_camera_model for each in turns]
    for roll in (-_ROLL, _ROLL):
        found.append(_turned(T_camera_model, roll * sight, middle))
    found += [Pose(np.eye(3), share * middle) @ T_camera_model for share in (-_DEPTH, _DEPTH)]
    return found


def nearby(T_camera_model: Pose, center: Array, focal: float) -> list[Pose]:
    """Return poses a little off one: turned about the camera's axes, and shifted along them, both ways.

    Args:
        T_camera_model: The pose, and theirs.
        center: Of the object, in the model frame, shape (3,) [m].
        focal: Of the camera [px].
    """
    middle = T_camera_model.rotation @ center + T_camera_model.translation
    found = []
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        found.append(_turned(T_camera_model, _NEAR_TURN * axis, middle))
        shift = _NEAR_SHIFT / focal * middle[2] * axis * (1.0, 1.0, _NEAR_DEPTH)
        found.append(Pose(np.eye(3), shift) @ T_camera_model)
    return found


def angle_between(a: Pose, b: Pose) -> float:
    """Return by how much two poses are turned against each other [rad]."""
    return math.acos(min(max(0.5 * (float(np.vdot(a.rotation, b.rotation)) - 1.0), -1.0), 1.0))


def _turned(T_camera_model: Pose, vector: Array, middle: Array) -> Pose:
    """Return a pose turned by a rotation vector about a point, both in camera coordinates."""
    turn = exponential(vector)[0]
    return Pose(turn, middle - turn @ middle) @ T_camera_model


def _spans(ends: Array, size: float) -> bool:
    """Return whether the two ends of an edge and the middle of the model are no line, so that they fix a rotation."""
    return float(np.linalg.norm(cross(ends[0], ends[1]))) > 1e-2 * size * size


def _basis(ends: Array) -> Array:
    x = ends[0] / np.linalg.norm(ends[0])
    z = cross(ends[0], ends[1])
    z /= np.linalg.norm(z)
    return np.column_stack([x, cross(z, x), z])


def _maps(rotation: Array, points: Array, used: Rows, pairs: set[frozenset[int]], tolerance: float) -> bool:
    image = points[used] @ rotation.T
    apart = np.linalg.norm(image[:, np.newaxis] - points[np.newaxis, used], axis=2)
    if apart.min(axis=1).max() > tolerance:
        return False
    to = dict(zip(used.tolist(), used[apart.argmin(axis=1)].tolist(), strict=True))
    return all(frozenset(to[end] for end in pair) in pairs for pair in pairs)
