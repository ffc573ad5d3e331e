# SPDX-License-Identifier: Apache-2.0
"""Poses along the paper's quadrifolium trajectories: accuracy and time of our estimator beside libraries, in one run.

The images are exact; the scene is known with Gaussian noise on the Plücker coordinates of its lines (unit directions
and moments about the origin), the paper's sigma, drawn anew for each sample. Every candidate gets the same noisy scene.
A library that is not installed is named as such. Times are the least processor time of one image, with the scene
prepared, candidates taking turns; the mean of five places along the trajectory. Their ratio is that to PoseLib with few
iterations. "warm" starts from the estimate of the sample before, too, as the node does.

    python3 -m benchmark pose_estimation
    python3 -m benchmark.pose_estimation --samples 401 --seeds 5
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from tqdm import tqdm

from paper.pose_quadrifolium import EXPERIMENTS, Experiment
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import EstimationParameters
from plsing_ros.pose import PoseEstimator, Verdict
from plsing_ros.pose.refinement import refine
from plsing_ros.pose.residuals import ImageResiduals, LineNoise, known_lines, residual_settings
from plsing_ros.simulation.simulated_camera import noisy_lines

SAMPLES, SEEDS = 101, 1
_PLACES, _ROUNDS = 5, 30
_OURS, _BACKEND, _WARM = "plsing_ros", "plsing_ros, backend poselib", "plsing_ros, warm"
_FIRST = "plsing_ros, first estimate"
# What times are compared with.
_REFERENCE = "PoseLib pnpl, 20 to 100 iterations"
_FOCAL_LENGTH = 1000.0  # [px]
# Half of the length of the segments that libraries are given instead of lines.
_HALF_PIXELS, _HALF_METRES = 500.0, 1.0
_CAMERA = {"model": "SIMPLE_PINHOLE", "width": 2000, "height": 2000, "params": [_FOCAL_LENGTH, 0.0, 0.0]}

# A camera centre, or None, and whether it is presented as good; from a scene, its exact image, and sigma.
Answer = tuple[np.ndarray | None, bool]
Candidate = Callable[[LineSet, LineObservation, float], Answer]


@dataclass
class _Record:
    error: list[float]
    ok: list[bool]


def main() -> None:
    """Measure and print."""
    report(SAMPLES, SEEDS)


def report(samples: int, seeds: int) -> None:
    """Print a table for each trajectory."""
    for experiment in EXPERIMENTS:
        found, missing = _candidates()
        seconds = _times(experiment, found)
        records = _run(experiment, found, samples, seeds)
        print(f"{experiment.name}; {samples} samples, {seeds} seed(s)")
        print(f"  {'translation error [m]':>76s}")
        print(
            f"  {'':34s}{'[ms]':>6s}  {'ratio':>6s}  {'median':>8s}  {'95 %':>8s}  {'max':>8s}   none     OK  max of OK"
        )
        for name, record in records.items():
            error, ok = np.array(record.error), np.array(record.ok)
            there = np.isfinite(error)
            numbers = "  ".join(f"{value:8.2g}" for value in np.quantile(error[there], [0.5, 0.95, 1.0]))
            largest = f"{error[ok].max():9.2g}" if ok.any() else "        -"
            time_of_it = f"{1e3 * seconds[name]:6.2f}" if name in seconds else "     -"
            ratio = seconds.get(name, np.nan) / seconds.get(_REFERENCE, np.nan)
            share = f"{ratio:6.2f}" if np.isfinite(ratio) else "     -"
            print(f"  {name:34s}{time_of_it}  {share}  {numbers}  {(~there).sum():5d}  {ok.mean():5.0%}  {largest}")
        for name in missing:
            print(f"  {name:34s}  not installed")
        print(flush=True)


def _times(experiment: Experiment, candidates: dict[str, Candidate]) -> dict[str, float]:
    """Return the time for one image of each [s]."""
    poses = experiment.poses(8 * _PLACES + 1)[2::8]
    total = dict.fromkeys((name for name in candidates if name != _FIRST), 0.0)
    for pose in poses:
        seen = LineObservation.of_lines(experiment.scene.transformed(pose.inverse(), "camera"))
        known = noisy_lines(experiment.scene, experiment.noise, np.random.default_rng(1))
        last = pose.integrate(np.full(6, 0.003), 1.0)
        calls: dict[str, Callable[[], object]] = {
            name: (lambda each=candidates[name]: each(known, seen, experiment.noise)) for name in total
        }
        for backend, name, start in (("numpy", _OURS, None), ("numpy", _WARM, last), ("poselib", _BACKEND, None)):
            if name in calls:
                settings = EstimationParameters(noise_image=0.0, noise_scene=experiment.noise, backend=backend)
                estimator = PoseEstimator(known, settings)
                calls[name] = lambda each=estimator, start=start: each.estimate(seen, start, (0.1, 0.1))
        for name, seconds in _min_seconds(calls).items():
            total[name] += seconds / len(poses)
    return total


def _min_seconds(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Return the least processor time of one call of each, in turns: what other programs do does not count."""
    least, generator = dict.fromkeys(calls, np.inf), np.random.default_rng(1)
    for _ in range(_ROUNDS):
        # In any order, as what one leaves in the caches is not the same for all.
        for name in generator.permutation(list(calls)):
            start = time.process_time()
            calls[name]()
            least[name] = min(least[name], time.process_time() - start)
    return least


def _run(experiment: Experiment, candidates: dict[str, Candidate], samples: int, seeds: int) -> dict[str, _Record]:
    records = {name: _Record([], []) for name in candidates}
    scene = experiment.scene
    for seed in range(1, seeds + 1):
        generator = np.random.default_rng(seed)
        for pose in tqdm(experiment.poses(samples), desc=experiment.name, leave=False):
            seen = LineObservation.of_lines(scene.transformed(pose.inverse(), "camera"))
            known = noisy_lines(scene, experiment.noise, generator)
            for name, candidate in candidates.items():
                center, ok = candidate(known, seen, experiment.noise)
                records[name].ok.append(ok)
                there = center is not None and np.isfinite(center).all()
                records[name].error.append(float(np.linalg.norm(center - pose.translation)) if there else np.inf)
    return records


def _candidates() -> tuple[dict[str, Candidate], list[str]]:
    """Return what can be measured here, by name, and the names of what is not installed."""
    poselib, cvxpnpl = _imported("poselib"), _imported("cvxpnpl")
    found: dict[str, Candidate] = {_OURS: _ours("numpy"), _WARM: _warm(), _FIRST: _first_estimate}
    missing = []
    if poselib is None:
        missing += [_BACKEND, "PoseLib pnpl", _REFERENCE]
    else:
        found[_BACKEND] = _ours("poselib")
        found["PoseLib pnpl"] = _poselib(poselib, {})
        found[_REFERENCE] = _poselib(poselib, {"min_iterations": 20, "max_iterations": 100})
    if cvxpnpl is None:
        missing += ["cvxpnpl", "cvxpnpl, then our refinement"]
    else:
        found["cvxpnpl"] = _cvxpnpl(cvxpnpl, refined=False)
        found["cvxpnpl, then our refinement"] = _cvxpnpl(cvxpnpl, refined=True)
    return found, missing


def _imported(name: str) -> ModuleType | None:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _ours(backend: str) -> Candidate:
    def estimate(known: LineSet, seen: LineObservation, noise: float) -> Answer:
        settings = EstimationParameters(noise_image=0.0, noise_scene=noise, backend=backend)
        found = PoseEstimator(known, settings).estimate(seen)
        center = None if found.T_world_camera is None else found.T_world_camera.translation
        return center, found.verdict is Verdict.OK

    return estimate


def _warm() -> Candidate:
    last: list[Pose | None] = [None]

    def estimate(known: LineSet, seen: LineObservation, noise: float) -> Answer:
        settings = EstimationParameters(noise_image=0.0, noise_scene=noise)
        found = PoseEstimator(known, settings).estimate(seen, last[0])
        if found.verdict in (Verdict.OK, Verdict.POOR):
            last[0] = found.T_world_camera
        center = None if found.T_world_camera is None else found.T_world_camera.translation
        return center, found.verdict is Verdict.OK

    return estimate


def _first_estimate(known: LineSet, seen: LineObservation, noise: float) -> Answer:
    settings = EstimationParameters(noise_image=0.0, noise_scene=noise)
    found = PoseEstimator(known, settings).estimate(seen)
    return None if found.first_estimate is None else found.first_estimate.translation, False


def _poselib(poselib: ModuleType, options: dict[str, int]) -> Candidate:
    nothing_2d, nothing_3d = np.zeros((0, 2)), np.zeros((0, 3))

    def estimate(known: LineSet, seen: LineObservation, _: float) -> Answer:
        first, second = _segments(seen)
        pose, _statistics = poselib.estimate_absolute_pose_pnpl(
            nothing_2d,
            nothing_3d,
            first,
            second,
            known.point - _HALF_METRES * known.direction,
            known.point + _HALF_METRES * known.direction,
            _CAMERA,
            {"max_reproj_error": 5.0, "max_epipolar_error": 5.0, **options},
            {},
        )
        return -pose.R.T @ pose.t, True

    return estimate


def _cvxpnpl(cvxpnpl: ModuleType, refined: bool) -> Candidate:
    intrinsics = np.diag([_FOCAL_LENGTH, _FOCAL_LENGTH, 1.0])

    def estimate(known: LineSet, seen: LineObservation, noise: float) -> Answer:
        segments = np.stack(_segments(seen), axis=1)
        ends = [known.point - _HALF_METRES * known.direction, known.point + _HALF_METRES * known.direction]
        poses = [each for each in cvxpnpl.pnl(segments, np.stack(ends, axis=1), intrinsics) if _is_pose(each)]
        if not poses:
            return None, False
        rotation = np.array([each[0] for each in poses])
        translation = np.array([each[1].ravel() for each in poses])
        image = ImageResiduals(known_lines(known), seen.image_lines, residual_settings(LineNoise(0.0, noise)))
        if refined:
            better = refine(image, rotation, translation, 40)
            rotation, translation = better.rotation, better.translation
        best = int(np.argmin(image.at(rotation, translation).squared.sum(axis=1)))
        return Pose(rotation[best].T, -rotation[best].T @ translation[best]).translation, True

    return estimate


def _is_pose(pair: tuple[np.ndarray, np.ndarray]) -> bool:
    rotation, translation = pair
    return bool(np.isfinite(translation).all() and np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6)


def _segments(seen: LineObservation) -> tuple[np.ndarray, np.ndarray]:
    """Return two points [px] on each image line."""
    line = seen.image_lines
    foot = -line[:, :2] * line[:, 2:] * _FOCAL_LENGTH
    along = np.stack([-line[:, 1], line[:, 0]], axis=1) * _HALF_PIXELS
    return foot - along, foot + along


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=SAMPLES, help=f"along each trajectory (default: {SAMPLES})")
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"of the noise, 1 to this (default: {SEEDS})")
    options = parser.parse_args()
    report(options.samples, options.seeds)
