# SPDX-License-Identifier: Apache-2.0
"""Markers of a scene's singular set and of the camera, for RViz and Foxglove, all in the scene's frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from plsing_ros.arrays import Array
from plsing_ros.figures.segments import segments_in_ball
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.nodes.conversions import point_message
from plsing_ros.nodes.locus_conversions import locus_segments
from plsing_ros.singularities import Kind, SingularSet

# Lines are drawn within this many scene lengths (mean distance of the lines from their centre) of the scene's centre.
_REACH = 6.0

# Longest drawn path of the camera, in poses.
_PATH_LENGTH = 2000

_OBSERVED = ColorRGBA(r=0.1, g=0.1, b=0.1, a=1.0)
_TRANSVERSAL = ColorRGBA(r=1.0, g=0.5, b=0.0, a=1.0)
_POINT = ColorRGBA(r=0.9, g=0.1, b=0.1, a=1.0)
_NEARLY = ColorRGBA(r=1.0, g=0.75, b=0.45, a=1.0)
_SURFACE = ColorRGBA(r=0.3, g=0.5, b=1.0, a=0.35)
_NEARLY_POINT = ColorRGBA(r=1.0, g=0.55, b=0.55, a=1.0)
_NEARLY_SURFACE = ColorRGBA(r=0.6, g=0.75, b=1.0, a=0.25)
_COLORS = {Kind.OBSERVED_LINE: _OBSERVED, Kind.TRANSVERSAL: _TRANSVERSAL}
# Namespace, shape, size in line widths, and colours of what is exactly singular and of what is within the tolerances.
_SURFACE_LOOK = ("surfaces", Marker.TRIANGLE_LIST, 1.0, _SURFACE, _NEARLY_SURFACE)
_CURVE_LOOK = ("curves", Marker.LINE_LIST, 1.0, _POINT, _NEARLY_POINT)
_LOOKS = {
    Kind.TRANSVERSAL: ("transversals", Marker.LINE_LIST, 1.0, _TRANSVERSAL, _NEARLY),
    Kind.ISOLATED_POINT: ("isolated_points", Marker.SPHERE_LIST, 6.0, _POINT, _NEARLY_POINT),
    Kind.PLANE: _SURFACE_LOOK,
    Kind.QUADRIC: _SURFACE_LOOK,
    Kind.CUBIC: _SURFACE_LOOK,
}
_DASHES = 30
_LEVELS = {
    Level.OK: ColorRGBA(r=0.1, g=0.7, b=0.1, a=1.0),
    Level.WARN: ColorRGBA(r=1.0, g=0.7, b=0.0, a=1.0),
    Level.CRITICAL: ColorRGBA(r=0.9, g=0.0, b=0.0, a=1.0),
}
_UNKNOWN = ColorRGBA(r=0.5, g=0.5, b=0.5, a=1.0)


def scene_markers(singular: SingularSet, head: Header) -> MarkerArray:
    """Return the observed lines and everything singular, paler what is so within the lines' tolerances.

    They last until they are replaced.
    """
    center, radius = singular.frame.center, _REACH * singular.frame.length
    width = 0.004 * radius
    lines = _marker(head, "observed_lines", Marker.LINE_LIST, width, _OBSERVED)
    lines.points = _points(segments_in_ball(singular.lines.point, singular.lines.direction, center, radius))
    markers = [lines]
    for number, locus in enumerate(singular.loci):
        namespace, shape, scale, exact, nearly = _LOOKS.get(locus.kind, _CURVE_LOOK)
        color = exact if locus.exactness == 0.0 else nearly
        marker = _marker(head, namespace, shape, 1.0 if shape == Marker.TRIANGLE_LIST else scale * width, color, number)
        if shape == Marker.TRIANGLE_LIST:
            marker.points = _points(locus.mesh(center, 0.5 * radius))
        else:
            marker.points = _points(locus_segments(locus, center, radius))
        markers.append(marker)
    if not singular.transversals and len(singular.lines) > 4:
        near = singular.nearest_transversal
        dashes = _marker(head, "nearest_transversal", Marker.LINE_LIST, 0.7 * width, _NEARLY)
        dashes.points = _points(_dashed(near.point, near.direction, center, radius))
        markers.append(dashes)
    # A marker without points is an error to the viewers; and what an earlier scene had must go.
    kept = [marker for marker in markers if marker.points]
    return MarkerArray(markers=[Marker(header=head, action=Marker.DELETEALL), *kept, *_labels(singular, head, radius)])


def _labels(singular: SingularSet, head: Header, radius: float) -> list[Marker]:
    """Return the names that alerts and statuses use, each at its locus; those of lines apart, near their drawn ends."""
    center = singular.frame.center
    closest = singular.distance_arrays(center).closest_point
    directions = singular.lines_and_points[1]
    labels = []
    for number, (name, kind, place) in enumerate(zip(singular.locus_names, singular.locus_kinds, closest, strict=True)):
        # What lies further away than what is drawn has no label either.
        if np.linalg.norm(place - center) > radius:
            continue
        label = _marker(head, "labels", Marker.TEXT_VIEW_FACING, 0.03 * radius, _COLORS.get(kind, _POINT), number)
        label.text = name
        along = 0.9 * radius * directions[number] if number < len(directions) else np.zeros(3)
        label.pose.position = point_message(place + along + [0.0, 0.0, 0.02 * radius])
        labels.append(label)
    return labels


def _dashed(point: Array, direction: Array, center: Array, radius: float) -> Array:
    """Return every second piece of a line in a ball, shape (k, 2, 3) [m]."""
    (start, end), *_ = np.reshape(segments_in_ball(point[None], direction[None], center, radius), (-1, 2, 3))
    steps = np.linspace(start, end, 2 * _DASHES)
    return np.stack([steps[0::2], steps[1::2]], axis=1)


class CameraMarkers:
    """Frustum, path coloured by level, unobservable motion and text of a camera that moves through a scene."""

    def __init__(self, singular: SingularSet) -> None:
        self._size = 0.25 * singular.frame.length
        self._path: deque[tuple[Point, ColorRGBA]] = deque(maxlen=_PATH_LENGTH)

    def markers(
        self, T_world_camera: Pose, level: Level, text: str, unobservable_motion: Array | None, head: Header
    ) -> MarkerArray:
        """Add a pose to the path and return all markers of the camera.

        Args:
            T_world_camera: Where the camera is.
            level: Of concern, for the colour.
            text: Shown beside the camera, one line for each part between semicolons.
            unobservable_motion: Twist in the optical frame, shape (6,), or None.
            head: The scene's frame; its stamp is not used.
        """
        color = _LEVELS.get(level, _UNKNOWN)
        center = point_message(T_world_camera.translation)
        self._path.append((center, color))
        frustum = _marker(head, "camera", Marker.LINE_LIST, 0.03 * self._size, color)
        frustum.points = _points(_frustum(T_world_camera, self._size))
        note = _marker(head, "status", Marker.TEXT_VIEW_FACING, 0.25 * self._size, color)
        note.text = text.replace("; ", "\n")
        note.pose.position = point_message(
            T_world_camera.translation - 0.7 * self._size * T_world_camera.rotation[:, 1]
        )
        path = _marker(head, "camera_path", Marker.LINE_STRIP, 0.03 * self._size, color)
        path.points, path.colors = (list(each) for each in zip(*self._path, strict=True))
        if len(self._path) < 2:
            path.action = Marker.DELETE  # a strip of one point is an error to the viewers
        arrow = _marker(head, "unobservable_motion", Marker.ARROW, 0.06 * self._size, _POINT)
        arrow.scale.y, arrow.scale.z = 0.12 * self._size, 0.2 * self._size
        length = 0.0 if unobservable_motion is None else float(np.linalg.norm(unobservable_motion[:3]))
        if unobservable_motion is None or length < 1e-9:
            arrow.action = Marker.DELETE
        else:
            tip = T_world_camera.translation + self._size / length * (T_world_camera.rotation @ unobservable_motion[:3])
            arrow.points = [center, point_message(tip)]
        return MarkerArray(markers=[frustum, path, note, arrow])


def _frustum(T_world_camera: Pose, size: float) -> Array:
    corners = size * np.array([[-0.5, -0.4, 1.0], [0.5, -0.4, 1.0], [0.5, 0.4, 1.0], [-0.5, 0.4, 1.0]])
    edges = [(np.zeros(3), corner) for corner in corners] + list(
        zip(corners, np.roll(corners, -1, axis=0), strict=True)
    )
    return np.reshape(edges, (-1, 3)) @ T_world_camera.rotation.T + T_world_camera.translation


def _marker(head: Header, namespace: str, kind: int, scale: float, color: ColorRGBA, number: int = 0) -> Marker:
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD, color=color)
    # Without a stamp, and locked to the frame: a viewer that starts late has no transform of the time it was made.
    marker.header.frame_id = head.frame_id
    marker.frame_locked = True
    marker.pose.orientation.w = 1.0
    marker.scale.x = marker.scale.y = marker.scale.z = float(scale)
    return marker


def _points(values: Array | Iterable[Array]) -> list[Point]:
    return [point_message(each) for each in np.reshape(np.asarray(values), (-1, 3))]
