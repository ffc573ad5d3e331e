# SPDX-License-Identifier: Apache-2.0
"""How well poses agree with images, told without edges: points of what is painted must stay where they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from plsing_ros._core import compiled
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.tracking import PinholeCamera

# Where a point is, x and y, by the number of the image [px].
Track = dict[int, np.ndarray]

_RIM = 9  # of the object's outline, where no points are taken [px]
_MAX_RETURN = 0.3  # of a point that is followed to the next image and back, from where it was [px]
_APART = 7  # points from each other [px]
_MIN_IMAGES = 12  # of a point
_DEVIATION = 0.4  # of a point's image [px]
_MIN_FACING = 0.25  # cosine between a ray and the normal of the face it meets


def follow_points(model: Model, camera: PinholeCamera, images: Sequence[Any], poses: Sequence[Pose]) -> list[Track]:
    """Return points on the object that are seen in a dozen images or more, by Lucas and Kanade's method.

    Args:
        model: Convex.
        camera: Without distortion.
        images: Grey.
        poses: T_camera_model, nearly: no more than where to look for points.
    """
    import cv2

    options: dict[str, Any] = {"winSize": (15, 15), "maxLevel": 4, "criteria": (3, 30, 0.005)}
    tracks: list[Track] = []
    active: list[Track] = []
    for k, (image, pose) in enumerate(zip(images, poses, strict=True)):
        corners = camera.project(model.vertices @ pose.rotation.T + pose.translation)
        inside = np.zeros(image.shape, np.uint8)
        cv2.fillConvexPoly(inside, np.round(cv2.convexHull(corners.astype(np.float32))).astype(np.int32), 255)
        inside = cv2.erode(inside, np.ones((_RIM, _RIM), np.uint8))
        if active:
            before = np.array([track[k - 1] for track in active], dtype=np.float32)
            now, found, _ = cv2.calcOpticalFlowPyrLK(images[k - 1], image, before, None, **options)
            back, again, _ = cv2.calcOpticalFlowPyrLK(image, images[k - 1], now, None, **options)
            column, row = np.clip(np.round(now).astype(int), 0, np.array(image.shape[::-1]) - 1).T
            good = (found & again).ravel().astype(bool) & (inside[row, column] > 0)
            good &= np.linalg.norm(back - before, axis=1) < _MAX_RETURN
            active = [track for track, kept in zip(active, good, strict=True) if kept]
            for track, place in zip(active, now[good], strict=True):
                track[k] = place.astype(float)
                cv2.circle(inside, tuple(np.round(place).astype(int).tolist()), _APART, 0, -1)
        new = cv2.goodFeaturesToTrack(image, 60, 0.02, _APART, mask=inside, blockSize=5)
        found_here = [] if new is None else [{k: place.astype(float)} for place in new.reshape(-1, 2)]
        tracks += found_here
        active = active + found_here
    return [track for track in tracks if len(track) >= _MIN_IMAGES]


def deviations(
    camera: PinholeCamera, tracks: Sequence[Track], pose_at: Callable[[int, float], Pose]
) -> tuple[np.ndarray, np.ndarray]:
    """Return how far points are from where they would be if they stayed where they fit all their images best.

    Where points are on the object is free: neither a model nor its place is needed.

    Args:
        camera: Without distortion.
        tracks: The points.
        pose_at: Pose of what the points are fixed to in the camera frame, of an image and a row [px].

    Returns:
        The image of each place of each point, and by how much it is off there [px].
    """
    images, off = [], []
    for track in tracks:
        seen = np.array(list(track.values()))
        poses = [pose_at(k, float(row)) for k, (_, row) in track.items()]
        turns = np.array([pose.rotation for pose in poses])
        places = np.array([pose.translation for pose in poses])
        rays = camera.normalised(seen)
        rows = turns[:, :2] - rays[:, :, np.newaxis] * turns[:, 2:]
        right = rays * places[:, 2:] - places[:, :2]
        weights = np.ones(len(seen))
        for _ in range(5):
            scaled = weights[:, np.newaxis]
            point = np.linalg.lstsq((scaled[:, np.newaxis] * rows).reshape(-1, 3), (scaled * right).ravel())[0]
            apart = np.linalg.norm(camera.project(turns @ point + places) - seen, axis=1)
            weights = 1.0 / np.sqrt(1.0 + (apart / _DEVIATION) ** 2)
        images += list(track)
        off += apart.tolist()
    return np.array(images), np.array(off)


def poses_of_points(
    model: Model, camera: PinholeCamera, tracks: Sequence[Track], start: Pose, count: int
) -> dict[int, Pose]:
    """Return the poses of an object whose points stay where the pose of the first image puts them, no edge used.

    Args:
        model: Convex.
        camera: Without distortion.
        tracks: Points; those that are seen in the first image are used.
        start: T_camera_model in the first image.
        count: Of images.
    """
    known = [track for track in tracks if 0 in track]
    rays = np.column_stack([camera.normalised(np.array([track[0] for track in known])), np.ones(len(known))])
    rays = rays @ start.rotation
    center, middle = -start.translation @ start.rotation, model.vertices.mean(axis=0)
    corners = model.vertices[model.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals *= np.sign(((corners[:, 0] - middle) * normals).sum(axis=1))[:, np.newaxis]
    normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
    height = ((corners[:, 0] - center) * normals).sum(axis=1)
    across = rays @ normals.T
    # A ray enters a convex object through the last of the planes that face it.
    distance = np.where(across < 0.0, height / np.minimum(across, -1e-12), -np.inf)
    face = distance.argmax(axis=1)
    rows = np.arange(len(known))
    clear = -across[rows, face] > _MIN_FACING * np.linalg.norm(rays, axis=1)
    points = center + distance[rows, face][:, np.newaxis] * rays
    poses, pose = {}, start
    for k in range(count):
        alive = [i for i in rows if clear[i] and k in known[i]]
        seen = camera.normalised(np.array([known[i][k] for i in alive]))
        rotation, translation, *_ = compiled.fit_points(points[alive], seen, _DEVIATION / camera.focal, pose)
        poses[k] = pose = Pose(rotation, translation)
    return poses
