# SPDX-License-Identifier: Apache-2.0
"""Whether features agree with themselves, with the scene and with a camera pose: asked before anything moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array, cross
from plsing_ros.errors import GeometryError
from plsing_ros.features.contradictions import (
    Explanations,
    exchanged_images_text,
    fit_of,
    image_contradiction,
    text_of_pose,
)
from plsing_ros.features.near_pairs import OF_ALL, exchanged_pair
from plsing_ros.features.observation import LineObservation
from plsing_ros.geometry import LineSet, Pose, align_lines
from plsing_ros.geometry.line_alignment import matched_rows

# An image line on the other side of its 3-D line is never an error of measurement [rad].
_OTHER_SIDE = 1.9
# An image line is turned round when it is so to this [rad], and the camera is farther from it than this share of the
# tolerance.
_TURNED, _NEARER = 0.3, 0.25
# From here on another explanation of the image is looked for [rad].
_SUSPICIOUS = 0.08
# By which pose and map add to the allowed angle of an image line, but of those near the camera [rad].
_FARTHER = 0.25
# Standard deviations in a tolerance.
_DEVIATIONS = 8.0
# Up to this share of what is allowed, directions are not looked at line by line.
_SURE = 0.1
_NOTHING = np.empty((0, 3))
# As _core.are_consistent says it.
_NO_PAIR = 2
# A pose, and bounds of cosine and distance that any pose is within.
_SOMEWHERE, _ANYWHERE = Pose(np.eye(3), np.zeros(3)), (-2.0, math.inf)


def left_out_text(ids: Sequence[int]) -> str:
    """Return that lines of these ids are not in the scene, as a clause."""
    return f"line id{'s' if len(ids) > 1 else ''} {', '.join(map(str, ids))} not in the scene: left out"


@dataclass(frozen=True)
class Tolerances:
    """How far features may be off by errors of measurement and calibration; whatever is farther off contradicts.

    The defaults hold for images with an error of 1 pixel (of 640), poses with 5 mm and 0.3 degrees, a focal length 2 %
    wrong and a map of lines 5 mm wrong (standard deviations), of segments down to 20 pixels: docs/refusals.md.

    Attributes:
        image: Angle between the plane of an image line and that of its 3-D line [rad], pose and map left out.
        position: Of a line in the map, or of a camera pose [m].
        rotation: Of a camera pose [rad].
        direction: Of a 3-D line [rad].
        distance: Of a 3-D line, as a share of its distance.
        scale: Common to all 3-D lines, as a share.
    """

    image: float = 0.35
    position: float = 0.04
    rotation: float = 0.04
    direction: float = 0.2
    distance: float = 0.02
    scale: float = 0.2


class ConsistencyCheck:
    """Finds contradictions in observations of one scene, and says them in words that name the line and what to do.

    Source: new, docs/refusals.md.
    """

    def __init__(self, scene: LineSet | None, tolerances: Tolerances | None = None) -> None:
        """Begin.

        Args:
            scene: The lines in the scene frame; None where they are not known.
            tolerances: What is no contradiction.
        """
        self._scene = scene
        self.tolerances = Tolerances() if tolerances is None else tolerances
        self._sure = math.cos(_SUSPICIOUS), math.cos(_SURE * self.tolerances.direction), self.tolerances.position
        self._near = math.cos(min(self.tolerances.rotation, math.pi)), self.tolerances.position
        # Lines that are farther apart are farther off than is allowed, when they are exchanged.
        near = min(self.tolerances.image + _FARTHER, math.pi)
        self._near_lines = self.tolerances.position / _DEVIATIONS, near
        self._explanations = Explanations()
        # Of the latest lines, which seldom change: their ids and rows in the scene.
        self._latest: tuple[tuple[int, ...], LineSet] | None = None

    def unchecked(self, observation: LineObservation) -> str:
        """Return what cannot be checked about an observation, in words, or "" if everything can."""
        if observation.lines_camera is None:
            return "image lines without 3-D lines cannot be checked: only pose_estimator can tell whether they fit"
        if self._scene is None:
            return "features are not checked against a scene: none is given"
        if observation.lines_source:
            return (
                "image lines are not checked against 3-D lines, which were computed from them: only pose_estimator can"
            )
        return ""

    def unknown_ids(self, observation: LineObservation) -> tuple[int, ...]:
        """Return the ids of usable lines that are not in the scene; they are left out by everything here."""
        if self._scene is None or observation.usable_ids == self._scene.ids:
            return ()
        known = set(self._scene.ids)
        return tuple(i for i in observation.usable_ids if i not in known)

    def contradiction(self, observation: LineObservation, T_world_camera: Pose | None = None) -> str | None:
        """Return what contradicts, as a sentence, or None.

        Args:
            observation: What the camera sees; without 3-D lines nothing can be said.
            T_world_camera: Where the camera is said to be, if that is known from elsewhere.
        """
        lines = observation.lines_camera
        if lines is None:
            return None
        image, covariances = observation.usable_image_lines, observation.usable_covariances
        agreement = self._agreement(image, lines, T_world_camera)
        if agreement == _NO_PAIR and covariances is None:
            return None
        problem = None if agreement else self._disagreement(image, lines, T_world_camera)
        return problem or self._of_pairs(image, lines, covariances)

    def _disagreement(self, image: Array, lines: LineSet, told: Pose | None) -> str | None:
        with np.errstate(over="ignore", invalid="ignore"):
            problem = self._of_image(image, lines)
            if problem is not None or self._scene is None:
                return problem
            seen, expected = self._matched(lines)
            if seen is None or expected is None:
                return None
            return self._of_scene(expected, seen, told)

    def _agreement(self, image: Array, lines: LineSet, told: Pose | None) -> int:
        """Return whether nothing is near what is allowed, and whether no pair can be exchanged: most need no more."""
        direction: Array
        moment: Array
        if self._scene is None:
            direction, moment = _NOTHING, _NOTHING
        elif lines.ids == self._scene.ids:
            direction, moment = self._scene.direction, self._scene.moment
        elif self._latest is not None and lines.ids == self._latest[0]:
            direction, moment = self._latest[1].direction, self._latest[1].moment
        else:
            return 0
        pose, near = (_SOMEWHERE, _ANYWHERE) if told is None else (told, self._near)
        return _core.are_consistent(
            image,
            lines.direction,
            lines.moment,
            direction,
            moment,
            *self._sure,
            pose.rotation,
            pose.translation,
            *near,
            OF_ALL,
        )

    def _of_pairs(self, image: Array, lines: LineSet, covariances: Array | None) -> str | None:
        rows = exchanged_pair(image, lines.moment, covariances, *self._near_lines)
        return None if rows is None else exchanged_images_text(*(lines.ids[row] for row in rows))

    def _of_image(self, image: Array, lines: LineSet) -> str | None:
        """Compare the planes of image lines with those of the message's own 3-D lines."""
        tolerances, moment = self.tolerances, lines.moment
        distance = np.sqrt(np.einsum("ij,ij->i", moment, moment))
        size = distance * np.sqrt(np.einsum("ij,ij->i", image, image))
        cosine = np.einsum("ij,ij->i", image, moment) / size
        if cosine.min() > math.cos(_SUSPICIOUS):
            return None
        # What overflows is not the image of anything.
        angle = np.nan_to_num(np.arccos(np.clip(cosine, -1.0, 1.0)), nan=math.pi)
        by_pose = tolerances.rotation + tolerances.position / distance
        allowed = np.minimum(tolerances.image + by_pose, _OTHER_SIDE)
        # A camera within the tolerance of a line may be on either side of it. It then sees it at any angle, and hardly
        # ever exactly turned round, unless it is nearer still.
        near = distance <= tolerances.position
        allowed[near] = np.where(distance[near] > _NEARER * tolerances.position, math.pi - _TURNED, math.pi)
        return image_contradiction(lines.ids, image, moment, angle, allowed, _SUSPICIOUS)

    def _matched(self, lines: LineSet) -> tuple[LineSet | None, LineSet | None]:
        """Return the lines that are in the scene, and the scene's, in the same order; None for fewer than two."""
        assert self._scene is not None
        if lines.ids == self._scene.ids:
            return lines, self._scene
        known = set(self._scene.ids)
        if not known.issuperset(lines.ids):
            rows = [row for row, i in enumerate(lines.ids) if i in known]
            if len(rows) < 2:
                return None, None
            lines = lines.select(rows)
        if len(lines) < 2:
            return None, None
        if self._latest is None or self._latest[0] != lines.ids:
            self._latest = lines.ids, self._scene.select(matched_rows(self._scene, lines))
        return lines, self._latest[1]

    def _of_scene(self, expected: LineSet, seen: LineSet, told: Pose | None) -> str | None:
        """Compare 3-D lines with those of the scene at the pose that fits all of them, and that pose with another."""
        tolerances = self.tolerances
        try:
            aligned = align_lines(expected, seen)
        except GeometryError:
            # Parallel lines fix no pose; which way they point still tells, and whether a pose fits.
            problem = self._explanations.of_parallel(expected, seen)
            return problem if problem is not None or told is None else self._of_parallel_lines(expected, seen, told)
        total = aligned.offset * math.sqrt(len(seen))
        if not (aligned.angle <= _SURE * tolerances.direction and total <= tolerances.position):
            fit = fit_of(expected, seen, aligned.T_world_camera, self._allowed)
            problem = (
                self._explanations.exchanged(expected, seen, fit, self._allowed)
                if fit.good
                else self._explanations.of(expected, seen, self._allowed, tolerances.scale)
            )
            if problem is not None:
                return problem
        return None if told is None else self._of_pose(aligned.T_world_camera, aligned.angle, total, seen, told)

    def _of_parallel_lines(self, expected: LineSet, seen: LineSet, told: Pose) -> str | None:
        tolerances = self.tolerances

        def allowed(turn: Array, foot: Array) -> tuple[float, Array]:
            angle, offset = self._allowed(turn, foot)
            return angle + tolerances.rotation, offset + tolerances.position

        fit = fit_of(expected, seen, told, allowed)
        if fit.good:
            return None
        return (
            f"camera_pose contradicts the 3-D lines, which are parallel: by it line {seen.ids[fit.worst]} is "
            f"{math.degrees(fit.angle):.3g} degrees and {fit.offset:.3g} m off; check that it is T_world_camera of the "
            "optical frame, and that it belongs to these features"
        )

    def _allowed(self, turn: Array, foot: Array) -> tuple[float, Array]:
        """Return the allowed angle of directions and offset of lines [m], shape (k,), for turns and distances."""
        tolerances = self.tolerances
        # A direction that is off moves the line where it is seen, which is somewhere near the foot.
        return tolerances.direction, tolerances.position + (tolerances.distance + 2.0 * turn) * foot

    def _of_pose(self, fitted: Pose, angle: float, total: float, seen: LineSet, told: Pose) -> str | None:
        tolerances = self.tolerances
        apart = float(np.linalg.norm(fitted.translation - told.translation))
        cosine = 0.5 * (float(np.vdot(fitted.rotation, told.rotation)) - 1.0)
        turn = math.acos(min(max(cosine, -1.0), 1.0))
        if apart <= tolerances.position and turn <= tolerances.rotation:
            return None
        # What the lines leave open: their misfit carried over to the position, and turned about their distance.
        u = seen.direction
        weakest = float(np.linalg.eigvalsh(len(u) * np.eye(3) - u.T @ u)[0])
        far = float(np.linalg.norm(cross(u, seen.moment), axis=1).mean())
        room = 5.0 * total / math.sqrt(max(weakest, 1e-12)) + 2.0 * far * angle
        allowed = tolerances.position + room, tolerances.rotation + 3.0 * angle
        return None if apart <= allowed[0] and turn <= allowed[1] else text_of_pose(apart, turn, *allowed)


__all__ = ["ConsistencyCheck", "Tolerances"]
