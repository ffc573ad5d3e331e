# SPDX-License-Identifier: Apache-2.0
"""Section "Pose Estimation along a quadrifolium trajectory", and its counterpart for five lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from paper.scenes import five_lines, four_lines
from plsing_ros.arrays import Array, BoolArray
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import EstimationParameters
from plsing_ros.pose import PoseEstimator, Verdict
from plsing_ros.simulation.simulated_camera import noisy_lines

SAMPLES = 401
SEEDS = (1, 2, 3, 4, 5)
# Half the size of a leaf, eq. quadrifolium [m].
_SIZE = 0.3


@dataclass(frozen=True)
class Experiment:
    """A trajectory of table PE_points, or one of those for five lines.

    Attributes:
        name: For titles.
        center: Of the quadrifolium [m].
        lines: How many are seen: the paper's four, or those and a fifth that meets the transversal L_M.
        noise: Standard deviation on each Plücker coordinate of the lines in the scene's frame.
        turned: Whether the pattern is turned by 90 degrees about the Y axis.
    """

    name: str
    center: tuple[float, float, float]
    lines: int
    noise: float
    turned: bool = False

    @property
    def scene(self) -> LineSet:
        """The observed lines."""
        return four_lines() if self.lines == 4 else five_lines()

    def poses(self, samples: int = SAMPLES) -> list[Pose]:
        """Return T_world_camera at evenly spaced s in [0, 2 pi], eq. quadrifolium.

        The paper's constant orientation points "roughly towards the origin": here the optical axis of a camera at the
        centre goes through it.
        """
        s = np.linspace(0.0, 2.0 * np.pi, samples)
        offset = _SIZE * np.stack([0.0 * s, np.cos(s) * np.cos(2 * s), np.sin(s) * np.cos(2 * s)], axis=1)
        if self.turned:
            offset = offset @ Rotation.from_euler("y", 90.0, degrees=True).as_matrix().T
        rotation = Pose.look_at(self.center, (0.0, 0.0, 0.0)).rotation
        return [Pose(rotation, np.array(self.center) + each) for each in offset]


EXPERIMENTS = (
    Experiment("P4L, Ex. 1: away from singularities", (5.0, 2.0, 3.0), 4, 1e-4),
    Experiment("P4L, Ex. 2: isolated point P1", (-9.858, -2.473, -1.841), 4, 1e-4, turned=True),
    Experiment("P4L, Ex. 3: on the transversal L_M", (0.7809, -2.024, 3.50), 4, 1e-4),
    Experiment("P5L: on the transversal L_M", (0.7809, -2.024, 3.50), 5, 5e-5),
    Experiment("P5L: away from singularities", (0.5, 4.0, 1.0), 5, 5e-5),
)


@dataclass(frozen=True, eq=False)
class QuadrifoliumErrors:
    """Errors along one trajectory, for each of k seeds and m samples.

    Attributes:
        experiment: Which one.
        parameter: s of eq. quadrifolium, shape (m,).
        true_center: Camera centres, shape (m, 3) [m].
        first_center: Of the first estimates, shape (k, m, 3) [m]; where there is no pose, the true one.
        refined_center: Of the refined ones, likewise.
        first_translation: Errors of the first estimates, shape (k, m) [m]; infinite where there is no pose.
        first_rotation: Likewise [rad].
        refined_translation: Errors after refinement, likewise.
        refined_rotation: Likewise.
        verdict: Values of Verdict, shape (k, m).
    """

    experiment: Experiment
    parameter: Array
    true_center: Array
    first_center: Array
    refined_center: Array
    first_translation: Array
    first_rotation: Array
    refined_translation: Array
    refined_rotation: Array
    verdict: npt.NDArray[np.int_]

    def summary(self, errors: Array, chosen: BoolArray | None = None) -> Array:
        """Return median, 95 % quantile and maximum of errors over all samples or those chosen, shape (3,).

        Of none, shape (0,).
        """
        values = errors.ravel() if chosen is None else errors[chosen]
        return np.asarray(np.quantile(values, [0.5, 0.95, 1.0])) if len(values) else np.zeros(0)


def run(
    experiment: Experiment,
    seeds: tuple[int, ...] = SEEDS,
    samples: int = SAMPLES,
    progress: Callable[[], object] = lambda: None,
) -> QuadrifoliumErrors:
    """Estimate the pose at each sample, from exact images and a scene known with noise, drawn anew each time.

    Args:
        experiment: Which one.
        seeds: Of the noise.
        samples: Along the trajectory.
        progress: Called after each sample.
    """
    poses = experiment.poses(samples)
    shape = (len(seeds), samples)
    first_center, refined_center = np.empty((*shape, 3)), np.empty((*shape, 3))
    errors = np.full((4, *shape), np.inf)
    verdict = np.full(shape, Verdict.FAILED.value)
    scene = experiment.scene
    settings = EstimationParameters(noise_image=0.0, noise_scene=experiment.noise)
    for k, seed in enumerate(seeds):
        generator = np.random.default_rng(seed)
        for i, pose in enumerate(poses):
            seen = LineObservation.of_lines(scene.transformed(pose.inverse(), "camera"))
            known = noisy_lines(scene, experiment.noise, generator)
            estimate = PoseEstimator(known, settings).estimate(seen)
            first_center[k, i] = refined_center[k, i] = pose.translation
            verdict[k, i] = estimate.verdict.value
            if estimate.first_estimate is not None and estimate.T_world_camera is not None:
                first_center[k, i] = estimate.first_estimate.translation
                refined_center[k, i] = estimate.T_world_camera.translation
                errors[:2, k, i] = pose_error(pose, estimate.first_estimate)
                errors[2:, k, i] = pose_error(pose, estimate.T_world_camera)
            progress()
    return QuadrifoliumErrors(
        experiment=experiment,
        parameter=np.asarray(np.linspace(0.0, 2.0 * np.pi, samples)),
        true_center=np.array([pose.translation for pose in poses]),
        first_center=first_center,
        refined_center=refined_center,
        first_translation=errors[0],
        first_rotation=errors[1],
        refined_translation=errors[2],
        refined_rotation=errors[3],
        verdict=verdict,
    )


def pose_error(true: Pose, estimated: Pose) -> tuple[float, float]:
    """Return the translation error [m] and the rotation error [rad], eq. PE_error_angle."""
    shift = float(np.linalg.norm(true.translation - estimated.translation))
    return shift, float(Rotation.from_matrix(true.rotation.T @ estimated.rotation).magnitude())


def save_figure(results: QuadrifoliumErrors, file: Path) -> None:
    """Draw the trajectories (top) and the errors (bottom) of the first seed, as in fig. pose_estimation."""
    import matplotlib as mpl

    mpl.use("Agg")  # files only, so that it works without a screen
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(7.5, 9.5), layout="constrained")
    panels = figure.subplot_mosaic([["path"], ["shift"], ["turn"]], height_ratios=(1.5, 1, 1))
    axes, shift, turn = panels["path"], panels["shift"], panels["turn"]
    # The plane of the pattern.
    i, j = (0, 1) if results.experiment.turned else (1, 2)
    middle = np.array(results.experiment.center)
    for centers, color, label in (
        (results.first_center[0], "tab:blue", "first estimate"),
        (results.refined_center[0], "tab:orange", "refined"),
        (results.true_center, "tab:red", "true"),
    ):
        axes.plot(centers[:, i], centers[:, j], color=color, label=label, linewidth=1.0)
    axes.set(
        xlabel=f"{'XYZ'[i]} [m]",
        ylabel=f"{'XYZ'[j]} [m]",
        xlim=(middle[i] - 1.6 * _SIZE, middle[i] + 1.6 * _SIZE),
        ylim=(middle[j] - 1.6 * _SIZE, middle[j] + 1.6 * _SIZE),
        aspect="equal",
        title=results.experiment.name,
    )
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    ok = results.verdict[0] == Verdict.OK.value
    for panel, first, refined, label in (
        (shift, results.first_translation[0], results.refined_translation[0], "translation error [m]"),
        (turn, results.first_rotation[0], results.refined_rotation[0], "rotation error [rad]"),
    ):
        panel.semilogy(results.parameter, np.maximum(first, 1e-12), color="tab:blue", linewidth=0.8, label="first")
        panel.semilogy(
            results.parameter, np.maximum(refined, 1e-12), color="tab:orange", linewidth=0.8, label="refined"
        )
        panel.semilogy(
            results.parameter[ok], np.maximum(refined[ok], 1e-12), ".", color="tab:green", markersize=3, label="OK"
        )
        for crossing in np.pi / 4 + np.arange(4) * np.pi / 2:
            panel.axvline(crossing, color="black", linestyle=":", linewidth=0.8)
        panel.set(xlabel="s", ylabel=label)
        panel.grid(alpha=0.3)
    shift.legend(loc="upper right", fontsize="small")
    figure.savefig(file, dpi=110)
    plt.close(figure)
