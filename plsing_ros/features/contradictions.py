# SPDX-License-Identifier: Apache-2.0
"""What is wrong with features that contradict something: the explanation that fits, in words. Called when they do."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, IntArray, cross
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet, Pose, align_lines

# Another explanation counts when it leaves less than this share of the square misfit.
_MUCH_BETTER = 0.03
# Explanations by pairs of lines are tried for up to so many lines; more are seldom seen, and would take long.
_MOST_LINES = 16

Allowed = Callable[[Array, Array], tuple[float, Array]]


@dataclass(frozen=True)
class Fit:
    """How well seen lines fit the scene at a pose.

    Attributes:
        good: Whether every line is within what is allowed.
        worst: Row of the line that is farthest off, in terms of what is allowed.
        angle: Of its direction [rad].
        offset: Of the line itself, sideways [m].
        excess: How far each line is off, over what is allowed, shape (n,).
    """

    good: bool
    worst: int
    angle: float
    offset: float
    excess: Array


def fit_of(expected: LineSet, seen: LineSet, T_world_camera: Pose, allowed: Allowed) -> Fit:
    """Return how well seen lines fit those expected.

    The difference of two moments is what a line is shifted, plus what it is turned times the distance of the point it
    is turned about; the part of the turn about the foot (nearest to the camera) is taken off, so that the offset is
    that of the line near where it is seen.

    Args:
        expected: In the scene frame, n lines.
        seen: In the camera frame, in the same order.
        T_world_camera: The pose.
        allowed: Returns the allowed angle [rad], and offsets [m] for the lines' turns [rad] and distances [m].
    """
    R, t = T_world_camera.rotation, T_world_camera.translation
    u = expected.direction @ R
    moment = (expected.moment - cross(t[np.newaxis], expected.direction)) @ R
    turned = seen.direction - u
    foot = cross(u, moment)
    rest = seen.moment - moment - cross(foot, turned)
    offset = np.sqrt(np.einsum("ij,ij->i", rest, rest))
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", u, seen.direction), -1.0, 1.0))
    most_angle, most_offset = allowed(angle, np.sqrt(np.einsum("ij,ij->i", foot, foot)))
    excess = np.maximum(angle / most_angle, offset / most_offset)
    worst = int(np.argmax(excess))
    return Fit(bool(excess[worst] <= 1.0), worst, float(angle[worst]), float(offset[worst]), excess)


def image_contradiction(
    ids: tuple[int, ...], image: Array, moment: Array, angle: Array, allowed: Array, suspicious: float
) -> str | None:
    """Return how image lines contradict the moments of the same message, or None.

    Args:
        ids: Of the n lines.
        image: Shape (n, 3).
        moment: Shape (n, 3) [m].
        angle: Between the planes of the two, shape (n,) [rad].
        allowed: Shape (n,) [rad]; more contradicts.
        suspicious: [rad]; more contradicts if another explanation fits much better.
    """
    off = np.flatnonzero(angle > suspicious)
    if not len(off):
        return None
    contradicts = bool((angle > allowed).any())
    depth = np.hypot(moment[:, 0], moment[:, 1])
    # A degenerate line has no image to compare with: it is not in an observation.
    projected = moment / depth[:, np.newaxis]
    text = _scaled_offsets(image, projected, angle)
    if contradicts:
        text = _turned_rows(ids, angle, allowed) or _exchanged_rows(ids, image, projected, angle, off) or text
    if text is None and contradicts:
        row = int(np.argmax(angle - allowed))
        text = (
            f"image line {ids[row]} is {math.degrees(angle[row]):.3g} degrees away from the image of its own 3-D line, "
            f"allowed are {math.degrees(allowed[row]):.3g}; check which 3-D line it is given with"
        )
    return text


def _turned_rows(ids: tuple[int, ...], angle: Array, allowed: Array) -> str | None:
    turned = np.flatnonzero(angle > 0.5 * math.pi)
    if not len(turned) or (np.minimum(angle, math.pi - angle) > np.minimum(allowed, 0.5)).any():
        return None
    several = len(turned) > 1
    return (
        f"image {_lines(ids, turned)} the image{'s' if several else ''} of {'their' if several else 'its'} own 3-D "
        f"line{'s' if several else ''} turned round; image_lines, directions and moments must have the same sign"
    )


def _exchanged_rows(ids: tuple[int, ...], image: Array, projected: Array, angle: Array, off: IntArray) -> str | None:
    if not len(off) >= 2 or len(ids) > _MOST_LINES:
        return None
    n, p = _unit(image), _unit(projected)
    cross_angle = np.arccos(np.clip(n[off] @ p[off].T, -1.0, 1.0))
    for a, b in itertools.combinations(range(len(off)), 2):
        own = float(angle[off[a]] ** 2 + angle[off[b]] ** 2)
        other = float(cross_angle[a, b] ** 2 + cross_angle[b, a] ** 2)
        if other < _MUCH_BETTER * own:
            return exchanged_images_text(ids[off[a]], ids[off[b]])
    return None


def exchanged_images_text(first: int, second: int) -> str:
    """Return the sentence for two image lines of these ids that have each other's 3-D lines."""
    return (
        f"image lines {first} and {second} are exchanged: each is the image of the other's 3-D line; check the order "
        "of the rows"
    )


def _scaled_offsets(image: Array, projected: Array, angle: Array) -> str | None:
    """Return the sentence for offsets in pixels, if a common factor explains the image."""
    ours, theirs = image[:, 2], projected[:, 2]
    square = float(theirs @ theirs)
    if square == 0.0 or len(ours) < 3:
        return None
    # Robust against one other wrong line; a factor below 2 is no unit.
    factor = float(np.median(ours / np.where(theirs == 0.0, 1.0, theirs)))
    if not (abs(factor) >= 2.0 or abs(factor) <= 0.5) or factor == 0.0:
        return None
    without = image * (1.0, 1.0, 1.0 / factor)
    cosine = np.einsum("ij,ij->i", _unit(without), _unit(projected))
    rest = np.arccos(np.clip(cosine, -1.0, 1.0))
    if float(rest @ rest) >= _MUCH_BETTER * float(angle @ angle):
        return None
    return (
        f"the offsets of the image lines (third component) are {factor:.3g} times those of the 3-D lines; "
        "they must be in normalised image coordinates (focal length 1), not in pixels"
    )


class Explanations:
    """Finds what is wrong with 3-D lines that fit no pose in the scene; remembers it, because it seldom changes."""

    def __init__(self) -> None:
        self._latest: tuple[str, tuple[int, ...]] | None = None

    def exchanged(self, expected: LineSet, seen: LineSet, fit: Fit, allowed: Allowed) -> str | None:
        """Return the sentence for two lines that fit much better with each other's ids, or None; arguments as of."""
        rows = np.argsort(fit.excess)[-2:]
        order = np.arange(len(seen))
        order[rows] = rows[::-1]
        changed = LineSet(seen.direction[order], seen.moment[order], seen.frame, seen.ids)
        try:
            other = fit_of(expected, changed, align_lines(expected, changed).T_world_camera, allowed)
        except GeometryError:
            return None
        if float(other.excess @ other.excess) >= _MUCH_BETTER * float(fit.excess @ fit.excess):
            return None
        return _exchanged_text(tuple(seen.ids[row] for row in sorted(rows.tolist())))

    def of_parallel(self, expected: LineSet, seen: LineSet) -> str | None:
        """Return which of parallel lines point the wrong way, or None."""
        # Products of directions do not depend on the camera.
        against = (seen.direction @ seen.direction[0]) * (expected.direction @ expected.direction[0])
        if np.abs(against).min() < 0.5:
            return "no camera pose explains the 3-D lines, whose numbers are too large or whose directions do not fit"
        rows = np.flatnonzero(against < -0.5)
        if not len(rows):
            return None
        if 2 * len(rows) > len(seen):
            rows = np.setdiff1d(np.arange(len(seen)), rows)
        return _reversed_text(seen.ids, rows)

    def of(self, expected: LineSet, seen: LineSet, allowed: Allowed, scale: float) -> str | None:
        """Return the sentence that says what is wrong, or None if a common scale within `scale` explains it.

        Args:
            expected: Lines of the scene.
            seen: The same lines in the camera frame.
            allowed: As in fit_of.
            scale: By which share all of them may be too large or too small.
        """
        text = _scale_text(expected, seen, allowed, scale)
        if text is not None:
            return text or None
        if self._latest is not None:
            text = self._sentence(*self._latest, expected, seen, allowed)
        if text is None:
            for kind, rows in _guesses(expected.direction, seen.direction):
                guess = kind, tuple(seen.ids[row] for row in rows)
                text = self._sentence(*guess, expected, seen, allowed)
                if text is not None:
                    self._latest = guess
                    break
        return text or _no_pose_text(expected, seen, allowed)

    def _sentence(
        self, kind: str, ids: tuple[int, ...], expected: LineSet, seen: LineSet, allowed: Allowed
    ) -> str | None:
        """Return the sentence of an explanation if it holds."""
        rows = [row for row, i in enumerate(seen.ids) if i in ids]
        if len(rows) != len(ids):
            return None
        if kind == "left out":
            others = [row for row in range(len(seen)) if row not in rows]
            if _fits(expected.select(others), seen.select(others), allowed) is None:
                return None
            return (
                f"line {ids[0]} is not where the scene has it, while the other {len(others)} lines fit; "
                "check its id, its direction's sign and the scene"
            )
        if kind == "reversed":
            sign = np.ones((len(seen), 1))
            sign[rows] = -1.0
            changed = LineSet(seen.direction * sign, seen.moment * sign, seen.frame, seen.ids)
            return _reversed_text(seen.ids, rows) if _fits(expected, changed, allowed) else None
        order = list(range(len(seen)))
        order[rows[0]], order[rows[1]] = rows[1], rows[0]
        changed = LineSet(seen.direction[order], seen.moment[order], seen.frame, seen.ids)
        if _fits(expected, changed, allowed) is None:
            return None
        return _exchanged_text(ids)


def _exchanged_text(ids: tuple[int, ...]) -> str:
    first, second = sorted(ids)
    return f"lines {first} and {second} have each other's ids: no camera pose explains them as they are named"


def text_of_pose(apart: float, turn: float, allowed_apart: float, allowed_turn: float) -> str:
    """Return the sentence for a camera pose that contradicts the 3-D lines."""
    return (
        f"camera_pose is {apart:.3g} m and {math.degrees(turn):.1f} degrees away from where the 3-D lines put the "
        f"camera, allowed are {allowed_apart:.2g} m and {math.degrees(allowed_turn):.1f} degrees; check that it is "
        "T_world_camera of the optical frame, and that it belongs to these features"
    )


def _guesses(expected: Array, seen: Array) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Return what may be wrong with n lines of these directions, the simplest first."""
    n = len(seen)
    yield from (("reversed", rows) for rows in _reversed_guesses(expected, seen))
    if n <= _MOST_LINES:
        yield from (("exchanged", rows) for rows in itertools.combinations(range(n), 2))
    if n >= 4:
        yield from (("left out", (row,)) for row in range(n))


def _reversed_guesses(expected: Array, seen: Array) -> list[tuple[int, ...]]:
    """Return which lines may be reversed: two lines of known signs fix the camera's turn, and it the other signs."""
    found = set()
    for first in (0, 1):
        for second in range(len(seen)):
            for signs in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
                if second == first:
                    continue
                pair = [first, second]
                left, _, right = np.linalg.svd(expected[pair].T @ (seen[pair] * np.array(signs)[:, np.newaxis]))
                # Two lines leave the third axis to the rule of the right hand.
                left[:, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))
                cosine = np.einsum("ij,ij->i", expected @ (left @ right), seen)
                found.add(tuple(np.flatnonzero(cosine < 0.0).tolist()))
    found.discard(())
    return sorted(found, key=lambda rows: (len(rows), rows))


def _fits(expected: LineSet, seen: LineSet, allowed: Allowed) -> Pose | None:
    """Return the pose at which all lines are within what is allowed, or None."""
    try:
        pose = align_lines(expected, seen).T_world_camera
    except GeometryError:
        return None
    return pose if fit_of(expected, seen, pose, allowed).good else None


def _scale_text(expected: LineSet, seen: LineSet, allowed: Allowed, most: float) -> str | None:
    """Return "" if a small common scale explains the lines, the sentence if a large one does, None if none does."""
    try:
        pose = align_lines(expected, seen).T_world_camera
    except GeometryError:
        return None
    # l_scene = k R l_camera + t cross u: linear in k and t.
    turned, u = seen.moment @ pose.rotation.T, expected.direction
    matrix = np.empty((3 * len(u), 4))
    matrix[:, 0] = turned.ravel()
    for column, axis in enumerate(np.eye(3)):
        matrix[:, 1 + column] = cross(np.broadcast_to(axis, u.shape), u).ravel()
    if not np.isfinite(matrix).all():
        return None
    k = float(np.linalg.lstsq(matrix, expected.moment.ravel(), rcond=None)[0][0])
    if not 1e-6 < k < 1e6:
        return None
    if _fits(expected, LineSet(seen.direction, k * seen.moment, seen.frame, seen.ids), allowed) is None:
        return None
    if abs(1.0 / k - 1.0) <= most:
        return ""
    return (
        f"the 3-D lines are {1.0 / k:.3g} times too large for the scene, allowed is a scale error of {most:.0%}; "
        "check their unit, and the base or depth they are measured with"
    )


def _no_pose_text(expected: LineSet, seen: LineSet, allowed: Allowed) -> str:
    try:
        pose = align_lines(expected, seen).T_world_camera
    except GeometryError:
        return "no camera pose explains the 3-D lines; check ids, directions' signs and the scene"
    fit = fit_of(expected, seen, pose, allowed)
    return (
        f"no camera pose explains the 3-D lines: at the best one line {seen.ids[fit.worst]} is still "
        f"{math.degrees(fit.angle):.3g} degrees and {fit.offset:.3g} m off; check ids, directions' signs and the scene"
    )


def _reversed_text(ids: tuple[int, ...], rows: object) -> str:
    return (
        f"{_lines(ids, rows)} reversed with respect to the scene: the sign of its direction must agree with the scene's"
    )


def _lines(ids: tuple[int, ...], rows: object) -> str:
    named = [str(ids[int(row)]) for row in rows]  # type: ignore[attr-defined]
    return f"line {named[0]} is" if len(named) == 1 else f"lines {', '.join(named)} are"


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, np.newaxis]
    return unit
