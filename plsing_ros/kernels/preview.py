"""One step of the plain law ahead of the camera: see preview.c."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.kernels.interaction import interaction_matrix
from plsing_ros.kernels.least_squares import solve

# Singular values up to this times the largest are zero to working precision.
SINGULAR = 2.2e-16


@np.errstate(invalid="ignore", over="ignore")
def law_step(
    lines: Array,
    desired: Array,
    twist: Array,
    moved: Array,
    next_twist: Array,
    duration: float,
    gain: float,
    least_depth: float,
    fastest: float,
) -> bool:
    """Move the camera, and fill what it sees then and the twist -gain pinv(L) (s - s*) that the law commands there.

    Args:
        lines: n lines in the camera frame, direction and moment, shape (2, n, 3).
        desired: Image lines at the goal, shape (n, 3).
        twist: With which the camera moves, shape (6,) [m/s, rad/s].
        moved: Filled with the lines after the step, exactly, shape (2, n, 3).
        next_twist: Filled, shape (6,) [m/s, rad/s].
        duration: Of the step [s].
        gain: [1/s].
        least_depth: As for have_images.
        fastest: Size that the twist must not reach with gain 1.

    Returns:
        False, with the twist unfinished, if L is singular to working precision or a line has no image.
    """
    move_lines(lines, twist * duration, moved)
    direction, moment = moved
    interaction = np.empty((3 * len(moment), 6))
    if not interaction_matrix(direction, moment, interaction, least_depth):
        return False
    error = (moment / np.hypot(moment[:, 0], moment[:, 1])[:, np.newaxis] - desired).ravel()
    values, right, components, solution = np.empty(6), np.empty((6, 6)), np.empty(6), np.empty(6)
    if not solve(interaction, error, values, right, components, solution, -1.0, 0.0):
        return False
    np.multiply(solution, gain, out=next_twist)
    return bool(values[5] > SINGULAR * values[0] and solution @ solution < fastest * fastest)


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def image_deviation(moment: Array, image: Array) -> float:
    """Return the sum of squares of the images of lines of these moments (n, 3) [m] minus image lines (n, 3).

    Infinite or NaN if a line has no image.
    """
    deviation = (moment / np.hypot(moment[:, 0], moment[:, 1])[:, np.newaxis] - image).ravel()
    return float(deviation @ deviation)


def move_lines(lines: Array, step: Array, moved: Array) -> None:
    """Fill lines (2, n, 3) in the frame of a camera that moved by the screw exp(step), shape (6,) [m, rad]."""
    vx, vy, vz, x, y, z = step.tolist()
    square = x * x + y * y + z * z
    if square == math.inf:
        moved.fill(math.nan)
        return
    if square > 1e-8:
        angle = math.sqrt(square)
        sine, sine_of_half = math.sin(angle), math.sin(0.5 * angle)
        # 1 - cos(angle) would cancel.
        a, b, c = sine / angle, 2.0 * sine_of_half * sine_of_half / square, (angle - sine) / (square * angle)
    else:
        a, b, c = 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    # R = I + a K + b K^2 and t = (I + b K + c K^2) v with K = [omega]x and K^2 = omega omega^T - |omega|^2 I.
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    squared = skew @ skew
    translation = (np.eye(3) + b * skew + c * squared) @ (vx, vy, vz)
    _in_camera(lines[0], lines[1], np.eye(3) + a * skew + b * squared, translation, moved)


def lines_seen(
    direction: Array,
    moment: Array,
    rotation: Array,
    translation: Array,
    seen_direction: Array,
    seen_moment: Array,
    image: Array,
    expected: Array,
    error: Array,
) -> float:
    """Fill lines in the frame of a camera, and by how much those that it sees differ; return their image_deviation.

    Args:
        direction: In the scene frame, shape (n, 3).
        moment: Likewise, shape (n, 3) [m].
        rotation: Of T_world_camera, shape (3, 3).
        translation: Likewise, shape (3,) [m].
        seen_direction: Of the same lines as the camera sees them, in its frame, shape (n, 3).
        seen_moment: Likewise, shape (n, 3) [m].
        image: Their image lines, shape (n, 3), for the deviation.
        expected: Filled with direction and moment in the camera frame, shape (2, n, 3).
        error: Filled with those that are seen minus these, shape (2, n, 3).
    """
    _in_camera(direction, moment, rotation, translation, expected)
    np.subtract((seen_direction, seen_moment), expected, out=error)
    return image_deviation(expected[1], image)


def _in_camera(direction: Array, moment: Array, rotation: Array, translation: Array, seen: Array) -> None:
    tx, ty, tz = translation.tolist()
    # Rows times this are u x t, so that the moments become l - t x u.
    shift = np.array([[0.0, -tz, ty], [tz, 0.0, -tx], [-ty, tx, 0.0]])
    seen[0] = direction @ rotation
    seen[1] = (moment + direction @ shift) @ rotation
