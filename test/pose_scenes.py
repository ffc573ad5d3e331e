# SPDX-License-Identifier: Apache-2.0
"""Images of scenes with known poses, and checks that use no solver."""

from __future__ import annotations

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from strategies import numbers, poses

from plsing_ros.features import LineObservation, project_lines
from plsing_ros.geometry import LineSet, Pose


def arrays(*poses):
    """Rotations and translations of T_camera_world."""
    inverse = [pose.inverse() for pose in poses]
    return np.array([each.rotation for each in inverse]), np.array([each.translation for each in inverse])


def image_of(lines, pose, noise=0.0, generator=None):
    """What a camera sees, with noise on angle and offset of each image line."""
    image = project_lines(lines.transformed(pose.inverse(), "camera")).reshape(-1, 3)
    if noise:
        angle = np.arctan2(image[:, 1], image[:, 0]) + generator.normal(scale=noise, size=len(image))
        image = np.stack(
            [np.cos(angle), np.sin(angle), image[:, 2] + generator.normal(scale=noise, size=len(image))], 1
        )
    return LineObservation(lines.ids, image, np.ones(len(image), dtype=bool), None)


def observation(lines, image, usable=None):
    usable = np.ones(len(image), dtype=bool) if usable is None else usable
    return LineObservation(lines.ids, image, usable, None)


def random_view(generator, n):
    """A scene within a few metres, and a pose that looks at it, no line badly seen."""
    while True:
        lines = LineSet.from_points_directions(generator.normal(size=(n, 3)), generator.normal(size=(n, 3)))
        center = generator.normal(size=3)
        center *= generator.uniform(2.0, 5.0) / np.linalg.norm(center)
        pose = Pose.look_at(center, generator.normal(scale=0.3, size=3), down=generator.normal(size=3))
        moment = lines.transformed(pose.inverse(), "camera").moment
        depth = np.hypot(moment[:, 0], moment[:, 1])
        if depth.min() > 0.1 and (np.abs(moment[:, 2]) / depth).max() < 3.0:
            return lines, pose


@st.composite
def views(draw, min_size=3, max_size=6, least=0.03):
    """A scene in the world and a pose T_world_camera from which the image fixes the pose well.

    Planes through the camera and directions in them are spread already where all that is drawn is zero.
    """
    normal, direction, distance = [], [], []
    for i in range(draw(st.integers(min_size, max_size))):
        around = 2.1 * i + draw(numbers(-0.8, 0.8))
        up = 0.5 * (-1) ** i + draw(numbers(-0.4, 0.4))
        turn = 1.0 * i + 0.4 + draw(numbers(-0.8, 0.8))
        normal.append([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
        across = np.array([-np.sin(around), np.cos(around), 0.0])
        direction.append(np.cos(turn) * across + np.sin(turn) * np.cross(normal[-1], across))
        distance.append([draw(numbers(0.5, 10.0))])
    normal, direction = np.array(normal), np.array(direction)
    # A line parallel to the image is seen only in front of the camera, where its opposite direction puts it.
    behind = (np.cross(direction, normal)[:, 2] <= 0.0) & (np.abs(direction[:, 2]) < 1e-3)
    direction[behind] *= -1.0
    assume(np.linalg.svd(normal, compute_uv=False)[-1] > least)
    assume(np.linalg.svd(np.cross(direction, normal), compute_uv=False)[-1] > least)
    pose = draw(poses())
    return LineSet(direction, distance * normal, "camera").transformed(pose, "world"), pose


def misfit(lines, image, pose):
    """How far, as a sine and relative to the distance, a pose is from putting the lines into the seen planes."""
    normals = image / np.linalg.norm(image, axis=1, keepdims=True)
    direction = lines.direction @ pose.rotation
    point = (lines.point - pose.translation) @ pose.rotation
    length = 1.0 + np.linalg.norm(point, axis=1)
    return max(
        np.abs(np.einsum("ij,ij->i", normals, direction)).max(),
        np.abs(np.einsum("ij,ij->i", normals, point) / length).max(),
    )


def distance(first, second):
    """The larger of the differences of centres, relative, and of rotation matrices."""
    far = 1.0 + np.abs(second.translation).max()
    return max(
        np.abs(first.translation - second.translation).max() / far, np.abs(first.rotation - second.rotation).max()
    )


def polar_image(coordinates, rotation, translation):
    """Angle and offset of lines (u, l) (n, 6) in a camera frame, l made orthogonal to u first, shape (n, 2)."""
    u, l = coordinates[:, :3], coordinates[:, 3:]  # noqa: E741, the literature's name
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    l = l - (l * u).sum(axis=1, keepdims=True) * u  # noqa: E741
    moment = l @ rotation.T + np.cross(translation, u @ rotation.T)
    return np.column_stack(
        [np.arctan2(moment[:, 1], moment[:, 0]), moment[:, 2] / np.hypot(moment[:, 0], moment[:, 1])]
    )


def image_covariances(lines, pose, image=0.0, scene=0.0, camera=0.0):
    """Of angle and offset of each line, by central differences over all Plücker coordinates, shape (n, 2, 2)."""
    inverse, seen = pose.inverse(), lines.transformed(pose.inverse(), "camera")
    total = np.tile(image**2 * np.eye(2), (len(lines), 1, 1))
    frames = (lines, inverse.rotation, inverse.translation, scene), (seen, np.eye(3), np.zeros(3), camera)
    for own, turn, shift, sigma in frames:
        coordinates = np.hstack([own.direction, own.moment])
        for step in 1e-6 * np.eye(6):
            ends = polar_image(coordinates + step, turn, shift), polar_image(coordinates - step, turn, shift)
            change = ends[0] - ends[1]
            change[:, 0] = (change[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
            total += sigma**2 * np.einsum("ni,nj->nij", change, change) / 4e-12
    return total
