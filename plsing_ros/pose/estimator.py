# SPDX-License-Identifier: Apache-2.0
"""The camera pose from one image of known lines, with all that is known about its error."""

from __future__ import annotations

import math
from itertools import compress
from typing import Any

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.errors import DegenerateProjectionError, GeometryError, ObservationError
from plsing_ros.features import LineObservation, checked_observation, interaction_conditioning
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.rotations import rotation_vector
from plsing_ros.parameters.options import parameters_from_options
from plsing_ros.parameters.pose_estimator import EstimationParameters
from plsing_ros.pose.covariance import Uncertainty, uncertainty
from plsing_ros.pose.estimate import Alternative, PoseEstimate, Verdict, failed_estimate
from plsing_ros.pose.hypotheses import Costs, Hypothesis, all_lines_hypotheses, outlier_hypotheses
from plsing_ros.pose.residuals import ImageResiduals, LineNoise, residual_settings
from plsing_ros.pose.verdict import grade
from plsing_ros.pose.visible_lines import VisibleLines
from plsing_ros.singularities import LocusDistance

# Sets of lines seen together whose preparation is kept.
_MAX_SCENES = 64
# Two poses differ when the covariance puts them apart by more than this, squared.
_APART = 9.0
# Refined poses that differ by less, as _core.same_pose has it, are the same.
_EQUAL = 1e-3


def estimate_pose(lines: LineSet, observation: LineObservation, **options: Any) -> PoseEstimate:
    """Return the camera pose that one image of known lines shows, and how far it can be trusted.

    Args:
        lines: The scene, in the world frame.
        observation: Image lines with ids; 3-D lines in it are not used. Without covariances they have noise.image.
        options: Every parameter of the estimator by its name (docs/reference), nested where it has dots:
            noise={"image": 1e-3}.

    Raises:
        ObservationError: If a line is not in the scene.
        ParameterError: If an option is unknown or not allowed.
    """
    return PoseEstimator(lines, parameters_from_options(EstimationParameters, options)).estimate(observation)


class PoseEstimator:
    """Estimates camera poses in one scene.

    Args:
        lines: The scene, in the world frame.
        settings: Noise, thresholds and backend.

    Raises:
        ParameterError: If the backend is not installed.
    """

    def __init__(self, lines: LineSet, settings: EstimationParameters | None = None) -> None:
        self.lines = lines
        self.settings = settings if settings is not None else EstimationParameters()
        self._row_of = {i: row for row, i in enumerate(lines.ids)}
        self._scenes: dict[tuple[int, ...], VisibleLines] = {}
        noise = LineNoise(self.settings.noise_image, self.settings.noise_scene, self.settings.noise_camera)
        self._residual_settings = residual_settings(noise, self.settings.max_angle)
        self._costs = Costs(self.settings.outlier_gate**2, self.settings.reversal_cost)
        if len(lines) >= 3:
            self._scene(lines.ids)

    def estimate(
        self, observation: LineObservation, last: Pose | None = None, reach: tuple[float, float] | None = None
    ) -> PoseEstimate:
        """Return what one image says about the camera pose.

        Args:
            observation: Image lines with ids; 3-D lines in it are not used.
            last: T_world_camera of a moment ago, if known: one more first estimate, and the choice between poses that
                are about as plausible.
            reach: How far [m] and by which angle [rad] the camera can be from there. Poses further away are left out,
                as long as one is within reach: what the image leaves open, the motion decides.

        Raises:
            ObservationError: If a line is not in the scene, or the observation is something else.
        """
        ids = checked_observation(observation).usable_ids
        unknown = [i for i in observation.ids if i not in self._row_of]
        if unknown:
            raise ObservationError(f"line id {unknown[0]} is not in the scene, whose ids are {list(self.lines.ids)}")
        if len(ids) < 3:
            return failed_estimate(f"{len(ids)} usable line(s) in the image; at least 3 are needed for a camera pose")
        scene, image_lines = self._scene(ids), observation.usable_image_lines
        image = ImageResiduals(scene.known, image_lines, self._residual_settings, observation.usable_covariances)
        everywhere = self._hypotheses(scene, image, image_lines, last)
        if not everywhere:
            return failed_estimate("no pose was found: the lines or their images are degenerate")
        found = [each for each in everywhere if scene.near(each.center)]
        if not found:
            return failed_estimate("the image is explained best from infinitely far: the distance is not determined")
        if last is not None and reach is not None:
            found = [each for each in found if _within(each, last, *reach)] or found
        best = self._preferred(found, last)
        spread = uncertainty(image, best.rotation, best.translation, best.weight)
        if spread is None:
            return failed_estimate("the image does not determine the pose: a motion of the camera moves no line")
        return self._described(scene, best, found, spread)

    def surroundings(self, T_world_camera: Pose, ids: tuple[int, ...]) -> tuple[LocusDistance | None, float]:
        """Return the locus nearest to a camera that sees lines, and the inverse condition number of its image.

        Args:
            T_world_camera: The camera.
            ids: Of the lines; with fewer than three there is no locus, and the number is 0.
        """
        if len(ids) < 3:
            return None, 0.0
        scene = self._scene(ids)
        try:
            seen = scene.lines.transformed(T_world_camera.inverse(), "camera")
            condition = interaction_conditioning(seen).inverse_condition_number
        except (DegenerateProjectionError, GeometryError):
            condition = 0.0
        return scene.singular.nearest_locus(T_world_camera.translation), condition

    def _scene(self, ids: tuple[int, ...]) -> VisibleLines:
        if ids not in self._scenes:
            if len(self._scenes) >= _MAX_SCENES:
                self._scenes.pop(next(iter(self._scenes)))
            self._scenes[ids] = VisibleLines(self.lines.select([self._row_of[i] for i in ids]), self.settings)
        return self._scenes[ids]

    def _hypotheses(
        self, scene: VisibleLines, image: ImageResiduals, image_lines: Array, last: Pose | None
    ) -> list[Hypothesis]:
        """Return the poses that explain the image, best first."""
        rotation, translation = _with_last(*scene.triplets.candidates(image_lines), last)
        if len(rotation) == 0:
            return []
        found = all_lines_hypotheses(image, rotation, translation, self._costs)
        if image.count < 5 or (found and (self._costs.of_lines(found[0].residuals) <= self._costs.outlier).all()):
            return found
        own = scene.all_triplets.candidates(image_lines, all_lines=False)
        rotation, translation = np.concatenate([rotation, own[0]]), np.concatenate([translation, own[1]])
        return outlier_hypotheses(image, rotation, translation, self._costs) or found

    def _preferred(self, found: list[Hypothesis], last: Pose | None) -> Hypothesis:
        """Return the best hypothesis, or of those that are about as plausible the one closest to the last pose."""
        if last is None:
            return found[0]
        least = self.settings.min_likelihood_ratio
        plausible = [each for each in found if each.likelihood_ratio(found[0]) >= least]
        return min(plausible, key=lambda each: float(np.linalg.norm(each.center - last.translation)))

    def _described(
        self, scene: VisibleLines, best: Hypothesis, found: list[Hypothesis], spread: Uncertainty
    ) -> PoseEstimate:
        settings = self.settings
        pose = Pose(best.rotation.T, best.center)
        others: list[Hypothesis] = []
        for each in found:
            if each is best or each.likelihood_ratio(best) < settings.min_likelihood_ratio:
                continue
            if not any(_same(each, other) for other in (best, *others)) and self._differs(best, each, spread):
                others.append(each)
        alternatives = tuple(
            Alternative(Pose(each.rotation.T, each.center), each.likelihood_ratio(best)) for each in others
        )
        used = [weight > 0.0 for weight in best.weight.tolist()]
        freedom = 2 * sum(used) - 6
        residual = math.sqrt(spread.squared_residual / freedom) if freedom > 0 else 0.0
        nearest = scene.singular.nearest_locus(pose.translation)
        verdict, reason = grade(spread, residual, alternatives, nearest, settings)
        if verdict is Verdict.FAILED:
            return failed_estimate(reason)
        ids, against = scene.lines.ids, best.residuals.reversed[0].tolist()
        start_rotation, start_translation = best.start
        return PoseEstimate(
            verdict=verdict,
            reason=reason,
            T_world_camera=pose,
            covariance=spread.covariance,
            covariance_trusted=spread.nonlinearity <= settings.max_nonlinearity and not alternatives,
            position_deviation=spread.position_deviation,
            rotation_deviation=spread.rotation_deviation,
            nonlinearity=spread.nonlinearity,
            inverse_condition_number=spread.inverse_condition_number,
            least_observable_direction=spread.axes[0],
            least_observable_standard_deviation=float(spread.deviation[0]),
            residual=residual,
            nearest=nearest,
            alternatives=alternatives,
            used_ids=tuple(compress(ids, used)),
            outlier_ids=tuple(i for i, use in zip(ids, used, strict=True) if not use),
            reversed_ids=tuple(i for i, use, turned in zip(ids, used, against, strict=True) if use and turned),
            first_estimate=Pose(start_rotation.T, -start_rotation.T @ start_translation),
        )

    def _differs(self, first: Hypothesis, second: Hypothesis, spread: Uncertainty) -> bool:
        """Whether two poses are further apart than the limits, and than the first one's covariance allows."""
        shift = second.center - first.center
        turn = rotation_vector(second.rotation.T @ first.rotation)
        limits = self.settings
        if np.linalg.norm(shift) <= limits.max_position_deviation and (
            np.linalg.norm(turn) <= limits.max_rotation_deviation
        ):
            return False
        in_camera = np.concatenate([first.rotation @ shift, first.rotation @ turn])
        return bool((((spread.axes @ in_camera) / spread.deviation) ** 2).sum() > _APART)


def _with_last(rotation: Array, translation: Array, last: Pose | None) -> tuple[Array, Array]:
    if last is None:
        return rotation, translation
    inverse = last.rotation.T
    return (
        np.concatenate([rotation, inverse[np.newaxis]]),
        np.concatenate([translation, -(inverse @ last.translation)[np.newaxis]]),
    )


def _within(hypothesis: Hypothesis, last: Pose, distance: float, angle: float) -> bool:
    turn = rotation_vector(hypothesis.rotation @ last.rotation)
    shift = hypothesis.center - last.translation
    return bool(np.linalg.norm(shift) <= distance and np.linalg.norm(turn) <= angle)


def _same(first: Hypothesis, second: Hypothesis) -> bool:
    return _core.same_pose(first.rotation, first.center, second.rotation, second.center, _EQUAL)
