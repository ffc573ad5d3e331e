# SPDX-License-Identifier: Apache-2.0
"""Control laws from the literature that the package does not have: for comparison, with the package's own limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.servo_conditions import HALF_VIEW, ROBOT_LIMITS, Frame
from plsing_ros.control.saturation import saturate
from plsing_ros.features import LineObservation, interaction_matrix
from plsing_ros.geometry import LineSet, Pose


@dataclass(frozen=True, eq=False)
class Situation:
    """What a rival knows in a cycle: the same as the package's laws.

    Attributes:
        lines: In the camera frame.
        image, target_image: s and s* of the same lines, shape (3n,).
        target_lines: In the camera frame at the target.
        T_target_camera: By the poses that are known.
    """

    lines: LineSet
    image: np.ndarray
    target_image: np.ndarray
    target_lines: LineSet
    T_target_camera: Pose


Rival = Callable[[Situation, float], np.ndarray]


def situation_of(frame: Frame, target: Frame) -> Situation | None:
    """Return what is known in a frame, or None if fewer than three lines are seen here and at the target."""
    seen, there = frame.observation, target.observation
    ids = tuple(i for i in seen.usable_ids if i in there.usable_ids)
    if len(ids) < 3 or seen.lines_camera is None or there.lines_camera is None:
        return None
    rows, rows_there = ([each.usable_ids.index(i) for i in ids] for each in (seen, there))
    return Situation(
        seen.lines_camera.select(rows),
        seen.usable_image_lines[rows].ravel(),
        there.usable_image_lines[rows_there].ravel(),
        there.lines_camera.select(rows_there),
        target.T_world_camera.inverse() @ frame.T_world_camera,
    )


def position_based(now: Situation, gain: float) -> np.ndarray:
    """Return the twist straight back, by the pose alone.

    Source: Chaumette and Hutchinson, Visual servo control I (2006), position-based with the target's frame.
    """
    R, t = now.T_target_camera.rotation, now.T_target_camera.translation
    return -gain * np.concatenate([R.T @ t, Rotation.from_matrix(R).as_rotvec()])


def position_in_view(now: Situation, gain: float) -> np.ndarray:
    """Return the position-based twist whose translation waits where the scene would leave the view.

    Source: after Kyrki, Kragic and Christensen, New shortest-path approaches to visual servoing (2004): the straight
    path is kept, and the rotation keeps the scene's middle in view as long as it is near the edge.
    """
    twist = position_based(now, gain)
    middle = _middle(now.lines)
    if middle[2] <= 0.0:
        return twist
    x, y = middle[:2] / middle[2]
    share = float(np.clip((np.hypot(x, y) / HALF_VIEW - 0.5) / 0.4, 0.0, 1.0))
    centring = gain * np.array([-y, x, 0.0])
    twist[3:] = (1.0 - share) * twist[3:] + share * centring
    twist[:3] *= 1.0 - 0.8 * share
    return twist


def hybrid(now: Situation, gain: float) -> np.ndarray:
    """Return the 2.5-D twist: orientation by the pose, translation by the image of the scene's middle and its depth.

    Source: Malis, Chaumette and Boudet, 2 1/2 D visual servoing (1999).
    """
    R = now.T_target_camera.rotation
    turn = Rotation.from_matrix(R).as_rotvec()
    here, there = _middle(now.lines), _middle(now.target_lines)
    if here[2] <= 0.0 or there[2] <= 0.0:
        return position_based(now, gain)
    x, y = here[:2] / here[2]
    error = np.array([x - there[0] / there[2], y - there[1] / there[2], np.log(here[2] / there[2])])
    L_v = np.array([[-1.0, 0.0, x], [0.0, -1.0, y], [0.0, 0.0, -1.0]]) / here[2]
    L_omega = np.array([[x * y, -(1.0 + x * x), y], [1.0 + y * y, -x * y, -x], [-y, x, 0.0]])
    omega = -gain * turn
    return np.concatenate([np.linalg.solve(L_v, -gain * error - L_omega @ omega), omega])


def levenberg_marquardt(now: Situation, gain: float) -> np.ndarray:
    """Return the image-based twist with Levenberg and Marquardt's damping by the diagonal, shrinking with the error.

    Source: Chaumette and Hutchinson (2006); Collewet, Marchand and Chaumette (2008) for servoing.
    """
    L, error = interaction_matrix(now.lines), now.image - now.target_image
    normal = L.T @ L
    damping = 0.01 * min(1.0, float(error @ error))
    return -gain * np.linalg.solve(normal + damping * np.diag(np.diag(normal)) + 1e-9 * np.eye(6), L.T @ error)


def predictive(now: Situation, gain: float) -> np.ndarray:
    """Return the first twist of a short horizon that brings the image nearest to its target within the limits.

    Source: after Allibert, Courtial and Chaumette, Predictive control for constrained image-based visual servoing
    (2010), with the twist constant over the horizon of 1 / lambda and two Gauss-Newton steps.
    """
    horizon = 1.0 / gain
    twist = saturate(position_based(now, gain), *ROBOT_LIMITS)[0]
    for _ in range(2):
        then = now.lines.transformed(Pose(np.eye(3), np.zeros(3)).integrate(twist, horizon).inverse(), "camera")
        seen = LineObservation.of_lines(then)
        if len(seen.usable_ids) < len(then):
            break
        L = interaction_matrix(then) * horizon
        error = seen.usable_image_lines.ravel() + (now.image - _image(now.lines)) - now.target_image
        step = np.linalg.solve(L.T @ L + 1e-3 * np.eye(6), L.T @ error)
        twist = saturate(twist - step, *ROBOT_LIMITS)[0]
    return twist


RIVALS: dict[str, Rival] = {
    "position-based": position_based,
    "position in view": position_in_view,
    "2.5-D": hybrid,
    "Levenberg-Marquardt": levenberg_marquardt,
    "predictive": predictive,
}


def _middle(lines: LineSet) -> np.ndarray:
    """Return the point nearest to all lines, shape (3,), in their frame."""
    u = lines.direction
    matrix = len(u) * np.eye(3) - u.T @ u + 1e-9 * np.eye(3)
    point: np.ndarray = np.linalg.solve(matrix, lines.point.sum(axis=0))
    return point


def _image(lines: LineSet) -> np.ndarray:
    return LineObservation.of_lines(lines).usable_image_lines.ravel()
