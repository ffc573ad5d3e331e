# SPDX-License-Identifier: Apache-2.0
"""Servo tasks with segments, for cameras, robots and maps that are as wrong as real ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from plsing_ros.arrays import cross
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.rotations import exponential

FRAME_TIME = 1.0 / 30.0  # [s]
FOCAL_LENGTH = 554.0  # [px]: 640 pixels in 60 degrees
HALF_VIEW = 320.0 / FOCAL_LENGTH
_SHORTEST = 20.0 / FOCAL_LENGTH  # of a segment's image that a tracker still finds
_NEAREST = 0.1  # [m]
_PLANES = np.array(
    [[0.0, 0.0, 1.0], [1.0, 0.0, HALF_VIEW], [-1.0, 0.0, HALF_VIEW], [0.0, 1.0, HALF_VIEW], [0.0, -1.0, HALF_VIEW]]
)
_OFFSETS = np.array([_NEAREST, 0.0, 0.0, 0.0, 0.0])
ROBOT_LIMITS = (0.25, 1.0)  # |v| [m/s], |omega| [rad/s]


@dataclass(frozen=True)
class Condition:
    """What is wrong; the standard deviations of docs/results/laws.md.

    Attributes:
        name: For tables.
        pixels: Of a segment's end in the image [px].
        position: Of a camera pose, each coordinate [m].
        rotation: Of a camera pose, each axis [rad].
        latency: From image to motion, in frames.
        jitter: Share of frames that come one later.
        dropped: Share of frames that never come.
        map_shift: Of a segment's end in the map, each coordinate [m].
        focal_length: Factor, drawn as larger or smaller.
        lag: Time constant of the robot [s].
        limited: Whether the robot has speed limits.
        hand_turn: By how much the frame that is told to move is turned against the camera [rad].
        hand_arm: How far it is from the camera [m].
        shown: Whether targets are what was seen there, with all these errors, and not poses.
        chain: Whether poses come from pose_estimator, and so from the images, and not from elsewhere.
        wrong_pose: Largest constant error of poses, which nobody knows of [m]; a fifth of it in radians.
    """

    name: str
    pixels: float = 0.0
    position: float = 0.0
    rotation: float = 0.0
    latency: int = 0
    jitter: float = 0.0
    dropped: float = 0.0
    map_shift: float = 0.0
    focal_length: float = 1.0
    lag: float = 0.0
    limited: bool = False
    hand_turn: float = 0.0
    hand_arm: float = 0.0
    shown: bool = False
    chain: bool = False
    wrong_pose: float = 0.0


NOMINAL = Condition("nominal", 0.3, 0.003, np.radians(0.2), 1, lag=0.05, limited=True)
HARSH = Condition("harsh", 1.0, 0.005, np.radians(0.3), 3, 0.2, 0.1, 0.005, 1.02, 0.05, True)
CONDITIONS = {
    each.name: each
    for each in (
        Condition("lab", limited=True),
        NOMINAL,
        HARSH,
        replace(HARSH, name="shown", hand_turn=np.radians(3.0), hand_arm=0.02, shown=True),
    )
}


@dataclass(frozen=True, eq=False)
class SegmentTask:
    """A scene, a start and a target.

    Attributes:
        ends: Of the true segments, shape (n, 2, 3) [m].
        map_ends: Of the segments as the controller knows them.
        start, target: T_world_camera.
        gain: lambda [1/s].
        crossing: Whether the straight path leads across a line that all observed lines meet.
        focal_factor: By which the true focal length is larger than what is assumed.
        T_hand_camera: Of the frame that is told to move.
        T_camera_known: Of the poses that are known, without noise.
    """

    ends: np.ndarray
    map_ends: np.ndarray
    start: Pose
    target: Pose
    gain: float
    crossing: bool
    focal_factor: float
    T_hand_camera: Pose
    T_camera_known: Pose

    @property
    def map(self) -> LineSet:
        """The lines as the controller knows them."""
        return lines_through(self.map_ends)


def lines_through(ends: np.ndarray) -> LineSet:
    """Return the lines through segments, shape (n, 2, 3), directed from the first end to the second."""
    return LineSet.from_points_directions(ends[:, 0], ends[:, 1] - ends[:, 0])


def draw_task(rng: np.random.Generator, condition: Condition, crossing: bool) -> SegmentTask:
    """Return a random task: 4 to 12 segments of 0.2 to 5 m, of which start and target see four or more."""
    while True:
        n = int(rng.integers(4, 13))
        distance = float(rng.uniform(1.0, 4.0))
        target = looking(rng, distance * _direction(rng), 0.15)
        away = float(np.exp(rng.uniform(np.log(0.15), np.log(1.2))))
        if crossing:
            axis_point, axis, start_center = _axis_between(rng, target.translation, away)
            ends = _segments_meeting(rng, n, axis_point, axis, target.translation)
        else:
            start_center = target.translation + away * _direction(rng)
            ends = segments(rng, n, target.translation)
        start = looking(rng, start_center, 0.25)
        start = Pose(
            start.rotation @ Rotation.from_rotvec([0.0, 0.0, rng.normal(0.0, 0.35)]).as_matrix(), start.translation
        )
        if sees_enough(ends, start) and sees_enough(ends, target):
            return completed_task(rng, condition, ends, start, target, crossing)


def sees_enough(ends: np.ndarray, T_world_camera: Pose) -> bool:
    """Return whether four or more segments are seen from a pose."""
    return np.count_nonzero(view_of(ends, T_world_camera)[1]) >= 4


def completed_task(
    rng: np.random.Generator, condition: Condition, ends: np.ndarray, start: Pose, target: Pose, crossing: bool
) -> SegmentTask:
    """Return a task of a scene, start and target, with the constant errors of a condition drawn."""
    map_ends = ends + condition.map_shift * rng.normal(size=ends.shape)
    factor = condition.focal_length if rng.random() < 0.5 else 1.0 / condition.focal_length
    gain = float(np.exp(rng.uniform(np.log(0.1), np.log(2.0))))
    hand = Pose(exponential(condition.hand_turn * _direction(rng))[0], condition.hand_arm * _direction(rng))
    off = condition.wrong_pose * float(np.exp(rng.uniform(np.log(0.02), 0.0)))
    known = Pose(exponential(0.2 * off * _direction(rng))[0], off * _direction(rng))
    return SegmentTask(ends, map_ends, start, target, gain, crossing, factor, hand, known)


def view_of(ends: np.ndarray, T_world_camera: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the segments' visible parts in the image, shape (n, 2, 2), and which are long enough, (n,)."""
    image, seen = views_of(ends, T_world_camera.rotation[np.newaxis], T_world_camera.translation[np.newaxis])
    return image[0], seen[0]


def views_of(ends: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what k cameras at T_world_camera = (R, t) see: as view_of, shapes (k, n, 2, 2) and (k, n)."""
    in_camera = np.einsum("knei,kij->knej", ends - t[:, np.newaxis, np.newaxis], R)
    a, step = in_camera[:, :, 0], in_camera[:, :, 1] - in_camera[:, :, 0]
    # Each plane of the view keeps what has c . p >= d.
    start, slope = a @ _PLANES.T - _OFFSETS, step @ _PLANES.T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -start / slope
    low = np.where(slope > 0.0, crossing, 0.0).max(axis=2, initial=0.0)
    high = np.where(slope < 0.0, crossing, 1.0).min(axis=2, initial=1.0)
    good = (high > low) & ~((slope == 0.0) & (start < 0.0)).any(axis=2)
    low, high = np.where(good, low, 0.0)[..., np.newaxis], np.where(good, high, 1.0)[..., np.newaxis]
    points = np.stack([a + low * step, a + high * step], axis=2)
    depth = np.where(good[..., np.newaxis, np.newaxis], points[..., 2:], 1.0)
    image = points[..., :2] / depth
    length = np.linalg.norm(image[:, :, 1] - image[:, :, 0], axis=2)
    return image, good & (length >= _SHORTEST)


def image_lines(points: np.ndarray) -> np.ndarray:
    """Return the oriented image lines, shape (n, 3), through points (n, 2, 2): as those of lines directed likewise."""
    (x, y), (dx, dy) = points[:, 0].T, (points[:, 1] - points[:, 0]).T
    lines: np.ndarray = np.stack([-dy, dx, x * dy - y * dx], axis=1) / np.hypot(dx, dy)[:, np.newaxis]
    return lines


def line_covariances(points: np.ndarray, deviation: float) -> np.ndarray:
    """Return (phi phi, phi rho, rho rho) of lines through points (n, 2, 2) with independent errors, shape (n, 3)."""
    span = points[:, 1] - points[:, 0]
    square = np.einsum("ij,ij->i", span, span)
    # Ends along the line, counted from the foot of the perpendicular from the principal point.
    ends = np.einsum("ikj,ij->ik", points, span) / np.sqrt(square)[:, np.newaxis]
    middle = ends.mean(axis=1)
    phi = 2.0 * deviation**2 / square
    covariances: np.ndarray = np.stack([phi, middle * phi, middle**2 * phi + 0.5 * deviation**2], axis=1)
    return covariances


@dataclass(frozen=True, eq=False)
class Frame:
    """What a controller gets.

    Attributes:
        observation: Image lines with their covariances, and the map's lines as seen from the pose.
        T_world_camera: The pose that is known.
        covariance: Of that pose, (v, omega) in the camera frame, shape (6, 6).
    """

    observation: LineObservation
    T_world_camera: Pose
    covariance: np.ndarray


class DisturbedCamera:
    """Takes frames of a task in a condition; of several cameras at once with the same errors for all."""

    def __init__(self, task: SegmentTask, condition: Condition, rng: np.random.Generator) -> None:
        self._task, self._condition, self._rng = task, condition, rng
        self._map = task.map

    def image(self, T_world_camera: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return image lines (n, 3), covariances (n, 3) and which are seen (n,), as wrong as the condition says."""
        R, t = T_world_camera.rotation[np.newaxis], T_world_camera.translation[np.newaxis]
        lines, covariances, seen = self.images(R, t)
        return lines[0], covariances[0], seen[0]

    def images(self, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the same of cameras at T_world_camera = (R, t), shapes (k, 3, 3) and (k, 3)."""
        points, seen = views_of(self._task.ends, R, t)
        deviation = max(self._condition.pixels, 0.02) / FOCAL_LENGTH
        if self._condition.pixels:
            points = points + self._condition.pixels / FOCAL_LENGTH * self._rng.normal(size=points.shape[1:])
        points = points * self._task.focal_factor
        lines, covariances = np.zeros((*seen.shape, 3)), np.zeros((*seen.shape, 3))
        if seen.any():
            lines[seen] = image_lines(points[seen])
            covariances[seen] = line_covariances(points[seen], deviation)
        return lines, covariances, seen

    def pose(self, T_world_camera: Pose) -> tuple[Pose, np.ndarray]:
        """Return the pose as it is known without a filter, and its covariance."""
        return T_world_camera @ self.pose_error(), self.pose_covariance

    def pose_error(self) -> Pose:
        """Return T_camera_known of a frame."""
        condition = self._condition
        shift, turn = condition.position * self._rng.normal(size=3), condition.rotation * self._rng.normal(size=3)
        return self._task.T_camera_known @ Pose(exponential(turn)[0], shift)

    @property
    def pose_covariance(self) -> np.ndarray:
        """Of a pose that is known without a filter, as it is said to be, shape (6, 6)."""
        condition = self._condition
        deviation = np.repeat([max(condition.position, 1e-4), max(condition.rotation, 1e-4)], 3)
        covariance: np.ndarray = np.diag(deviation**2)
        return covariance

    def frame(self, T_world_camera: Pose) -> Frame:
        """Return a frame with a pose that is known without a filter."""
        return self.completed(*self.image(T_world_camera), *self.pose(T_world_camera))

    def completed(
        self, lines: np.ndarray, covariances: np.ndarray, seen: np.ndarray, pose: Pose, covariance: np.ndarray
    ) -> Frame:
        """Return a frame of image lines with the 3-D lines of the map as seen from a pose."""
        R, t = pose.rotation, pose.translation
        u = self._map.direction
        observation = LineObservation.from_rows(
            self._map.ids, lines, u @ R, (self._map.moment - cross(t[np.newaxis], u)) @ R, seen, "camera", covariances
        )
        return Frame(observation, pose, covariance)


def _direction(rng: np.random.Generator) -> np.ndarray:
    while True:
        vector = rng.normal(size=3)
        if (size := float(np.linalg.norm(vector))) > 1e-3:
            return vector / size


def looking(rng: np.random.Generator, center: np.ndarray, tilt: float) -> Pose:
    """Return a camera at a place that looks about where the scene is, at the origin."""
    down = _direction(rng)
    z = -center / np.linalg.norm(center)
    x = np.cross(down, z)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(z, x), z])
    return Pose(rotation @ Rotation.from_rotvec(rng.normal(0.0, tilt, 3)).as_matrix(), center)


def _axis_between(
    rng: np.random.Generator, target: np.ndarray, away: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a point and direction of the line to be crossed, and the start's centre on its other side."""
    axis, side = _direction(rng), _direction(rng)
    side -= (side @ axis) * axis
    side /= np.linalg.norm(side)
    share, miss = rng.uniform(0.25, 0.75), np.exp(rng.uniform(np.log(1e-3), np.log(0.05)))
    point = target + share * away * side + miss * np.cross(axis, side) * rng.choice([-1.0, 1.0])
    return point, axis, target + away * side


def segments(rng: np.random.Generator, n: int, viewer: np.ndarray) -> np.ndarray:
    """Return segments about the origin, shape (n, 2, 3)."""
    reach = 0.45 * float(np.linalg.norm(viewer))
    middle = rng.uniform(-reach, reach, (n, 3))
    length = np.exp(rng.uniform(np.log(0.2), np.log(5.0), n))
    half = 0.5 * length[:, np.newaxis] * np.array([_direction(rng) for _ in range(n)])
    return np.stack([middle - half, middle + half], axis=1)


def _segments_meeting(
    rng: np.random.Generator, n: int, point: np.ndarray, axis: np.ndarray, viewer: np.ndarray
) -> np.ndarray:
    """Return segments about the origin whose lines all meet an axis."""
    reach = 0.45 * float(np.linalg.norm(viewer))
    middle = rng.uniform(-reach, reach, (n, 3))
    met = point + rng.uniform(-4.0, 4.0, (n, 1)) * axis
    along = met - middle
    along *= rng.choice([-1.0, 1.0], (n, 1)) / np.linalg.norm(along, axis=1, keepdims=True)
    half = 0.5 * np.exp(rng.uniform(np.log(0.2), np.log(5.0), (n, 1))) * along
    return np.stack([middle - half, middle + half], axis=1)
