# SPDX-License-Identifier: Apache-2.0
"""The pose filter across singular loci and under disturbances, beside single images, PoseLib and GTSAM.

Crossings: random scenes of 4 to 8 lines with straight paths across transversals and past isolated points (those of
benchmark.servo_tasks, kinds 1 and 2), and the paper's quadrifolia through their nodes. 25 Hz, 0.1 m/s, image noise 1e-3
on angle and offset. Each component of the twist given is off by 5 % of the speed, anew in each frame. Errors, and the
normalised estimation error squared (NEES) of position and orientation, by the distance to the nearest locus.

Disturbances: wrong lines, wrong twists, dropped frames, latency, a teleported camera, no features.

    python3 -m benchmark pose_filter
    python3 -m benchmark.pose_filter --quick
    python3 -m benchmark.pose_filter --seed 7 --scenes 400
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import importlib
from collections.abc import Iterator
from itertools import chain, cycle
from types import ModuleType

import numpy as np
from scipy.stats import chi2

from benchmark.camera_sequences import (
    NOISE,
    RATE,
    STARTS,
    TWIST_NOISE,
    Sequence,
    error_of,
    linearised,
    noisy_image,
    off_start,
    sequences,
    size_of,
    squared,
)
from benchmark.kept_results import kept_results, parts
from benchmark.pose_filter_faults import disturbances
from benchmark.pose_filter_figure import draw
from benchmark.pose_filter_scenes import flat_scenes, measured_covariances
from benchmark.timing import median_seconds
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import FilterParameters
from plsing_ros.pose import PoseEstimator, PoseFilter

SEED = 2  # thresholds were chosen on seed 1
SCENES = 200
QUICK_SCENES = 20
BANDS = ((0.0, 0.02), (0.02, 0.1), (0.1, 0.3), (0.3, 1.0))
_PIXELS = 1000.0


def main(quick: bool = False) -> None:
    """Measure and print."""
    report(SEED, QUICK_SCENES if quick else SCENES)


def report(seed: int, scenes: int, figure: str = "") -> None:
    """Print all tables, and draw the figure where that is asked for."""
    for line in chain(
        crossings(seed, scenes),
        disturbances(seed, max(10, scenes // 4)),
        flat_scenes(seed, scenes),
        measured_covariances(seed, scenes),
        speed(),
    ):
        print(line, flush=True)
    if figure:
        draw(crossing_records(next(iter(STARTS)), seed, scenes), figure)


# Columns of a record: distance to the locus, error of the position, NEES of all, position and orientation, jump from
# where the twist led, and change of the error, both in standard deviations.
_COLUMNS = 7


def filtered(seen: Sequence, start: Pose, covariance: np.ndarray) -> np.ndarray:
    """Return what a filter makes of a sequence, a row of _COLUMNS for each frame that has a pose."""
    pose_filter = PoseFilter(seen.lines, FilterParameters(noise_image=NOISE), start=start, start_covariance=covariance)
    rows: list[tuple[float, ...]] = []
    before, error_before = covariance, np.zeros(6)
    for k, (true, image) in enumerate(zip(seen.poses, seen.images, strict=True)):
        if k > 0:
            pose_filter.predict(seen.twists[k - 1], 1.0 / RATE)
        expected = pose_filter.pose_at(k / RATE)
        estimate = pose_filter.update(image, k / RATE)
        if estimate.pose is None:
            continue
        error, jump, change = error_of(true, estimate.pose), 0.0, 0.0
        if k > 0 and expected is not None:
            # The twist, too, is known to its noise only.
            reach = np.sqrt(np.diag(before) + np.square(TWIST_NOISE * size_of(seen.twists[k - 1]) / RATE))
            jump = float(np.abs(error_of(estimate.pose, expected) / reach).max())
            change = float(np.abs((error - error_before) / np.sqrt(np.diag(before))).max())
        before, error_before = estimate.covariance, error
        rows.append((seen.distance[k], np.linalg.norm(error[:3]), *squared(error, before), jump, change))
    return np.array(rows).reshape(-1, _COLUMNS)


def single_images(seen: Sequence, start: Pose) -> np.ndarray:
    """Return what single images, each beginning at the pose before, make of a sequence: distance and error."""
    estimator, last, rows = PoseEstimator(seen.lines, FilterParameters(noise_image=NOISE)), start, []
    for k, (true, image) in enumerate(zip(seen.poses, seen.images, strict=True)):
        estimate = estimator.estimate(image, last)
        if estimate.T_world_camera is not None:
            last = estimate.T_world_camera
            rows.append((seen.distance[k], np.linalg.norm(true.translation - last.translation)))
    return np.array(rows).reshape(-1, 2)


def poselib_images(poselib: ModuleType, seen: Sequence) -> np.ndarray:
    """Return what PoseLib's estimator for points and lines makes of each image: distance and error."""
    camera = {"model": "SIMPLE_PINHOLE", "width": 2, "height": 2, "params": [_PIXELS, 0.0, 0.0]}
    none_2d, none_3d, rows = np.zeros((0, 2)), np.zeros((0, 3)), []
    options = ({"max_reproj_error": 5.0, "max_epipolar_error": 5.0}, {})
    ends = [seen.lines.point + side * seen.lines.direction for side in (-0.5, 0.5)]
    for k, (true, image) in enumerate(zip(seen.poses, seen.images, strict=True)):
        line = image.image_lines
        foot = -line[:, :2] * line[:, 2:] * _PIXELS
        along = np.stack([-line[:, 1], line[:, 0]], axis=1) * 200.0
        pose, _ = poselib.estimate_absolute_pose_pnpl(
            none_2d, none_3d, foot - along, foot + along, *ends, camera, *options
        )
        center = -pose.R.T @ pose.t
        rows.append((seen.distance[k], np.linalg.norm(true.translation - center)))
    return np.array(rows).reshape(-1, 2)


def gtsam_filtered(gtsam: ModuleType, seen: Sequence, start: Pose, covariance: np.ndarray) -> np.ndarray:
    """Return what GTSAM's invariant filter, with one linear update a frame, makes of a sequence: as `filtered`.

    Its errors are (rotation, translation) in the camera's frame.
    """
    turn = np.zeros((6, 6))
    turn[:3, 3:] = turn[3:, :3] = start.rotation.T
    first = gtsam.Pose3(gtsam.Rot3(start.rotation), start.translation)
    ekf = gtsam.InvariantEKFPose3(first, turn @ covariance @ turn.T)
    rows = []
    for k, (true, image) in enumerate(zip(seen.poses, seen.images, strict=True)):
        if k > 0:
            twist = seen.twists[k - 1]
            noise = np.diag(np.concatenate([TWIST_NOISE * size_of(twist)[3:], TWIST_NOISE * size_of(twist)[:3]]) ** 2)
            # Its noise is multiplied by dt.
            step = 1.0 / RATE
            ekf.predict(np.concatenate([twist[3:], twist[:3]]), step, (noise + 1e-12 * np.eye(6)) * step)
        state = ekf.state()
        pose = Pose(state.rotation().matrix(), state.translation())
        residual, jacobian = linearised(seen.lines, pose, image)
        swapped = jacobian[:, [3, 4, 5, 0, 1, 2]]
        ekf.updateWithVector(residual, swapped, np.zeros(len(residual)), NOISE**2 * np.eye(len(residual)))
        state = ekf.state()
        pose = Pose(state.rotation().matrix(), state.translation())
        back = np.zeros((6, 6))
        back[:3, 3:] = back[3:, :3] = pose.rotation
        error = error_of(true, pose)
        rows.append(
            (seen.distance[k], np.linalg.norm(error[:3]), *squared(error, back @ ekf.covariance() @ back.T), 0.0, 0.0)
        )
    return np.array(rows).reshape(-1, _COLUMNS)


def crossed(task: tuple[str, int, range]) -> dict[str, list[np.ndarray]]:
    """Return what filter and rivals make of sequences, by the name of the start, seed and numbers."""
    name, seed, numbers = task
    gtsam, poselib = _imported("gtsam"), _imported("poselib")
    records: dict[str, list[np.ndarray]] = {}
    for number, (seen, generator) in zip(numbers, sequences(seed, numbers), strict=True):
        start = off_start(seen.poses[0], STARTS[name], generator)
        records.setdefault("filter", []).append(filtered(seen, *start))
        # The rivals take a hundred times as long, so every fifth sequence is theirs.
        if number % 5 == 0:
            records.setdefault("single images, from the last pose", []).append(single_images(seen, start[0]))
            if poselib is not None:
                records.setdefault("PoseLib, points and lines", []).append(poselib_images(poselib, seen))
            if gtsam is not None:
                records.setdefault("GTSAM, invariant filter", []).append(gtsam_filtered(gtsam, seen, *start))
    return records


def crossing_records(name: str, seed: int, scenes: int) -> dict[str, list[np.ndarray]]:
    """Return what filter and rivals make of all sequences with one of STARTS."""
    records: dict[str, list[np.ndarray]] = {}
    for part in kept_results(crossed, [(name, seed, numbers) for numbers in parts(scenes)]):
        for rival, runs in part.items():
            records.setdefault(rival, []).extend(runs)
    return records


def crossings(seed: int, scenes: int) -> Iterator[str]:
    """Yield the table of errors and NEES by distance to the loci, for the filter and its rivals."""
    for name in STARTS:
        records = crossing_records(name, seed, scenes)
        yield f"start {name}, {scenes} sequences; NEES of all, position, orientation: 95 % of means in {_bands(scenes)}"
        for rival, runs in records.items():
            for low, high in BANDS:
                yield _crossing_row(rival, low, high, runs)
        yield _consistency_row(records["filter"])
        for column, what in ((5, "jump from where the twist led"), (6, "change of the error between frames")):
            values = np.concatenate([run[:, column] for run in records["filter"]])
            high = np.quantile(values, 0.999)
            yield f"  largest {what}: {values.max():.2f} standard deviations; 99.9 %: {high:.2f}"
    missing = [each for each in ("gtsam", "poselib") if _imported(each) is None]
    if missing:
        yield f"not installed, so not measured: {', '.join(missing)}"


def _bands(runs: int) -> str:
    return ", ".join(
        f"{chi2.ppf(0.025, k * runs) / runs:.2f} to {chi2.ppf(0.975, k * runs) / runs:.2f}" for k in (6, 3, 3)
    )


def _crossing_row(rival: str, low: float, high: float, runs: list[np.ndarray]) -> str:
    chosen = [run[(run[:, 0] >= low) & (run[:, 0] < high)] for run in runs]
    rows = np.concatenate(chosen)
    if len(rows) == 0:
        return f"  {rival:34s} {low:g} to {high:g} m: no frame"
    error = " / ".join(f"{each:.3f}" for each in np.quantile(rows[:, 1], [0.5, 0.95, 1.0]))
    text = f"  {rival:34s} {low:4g} to {high:3g} m: {len(rows):6d} frames, median / 95 % / max {error} m"
    if rows.shape[1] == _COLUMNS:
        # Runs count alike, however long each is in the band.
        mean = np.mean([run[:, 2:5].mean(axis=0) for run in chosen if len(run)], axis=0)
        text += "; NEES " + ", ".join(f"{each:.2f}" for each in mean)
    return text


def _consistency_row(runs: list[np.ndarray]) -> str:
    """Return in how many time steps the mean over all runs that last so long is in its 95 % band."""
    shares = []
    for column, freedom in ((2, 6), (3, 3), (4, 3)):
        inside = []
        for k in range(1, max(map(len, runs))):
            values = np.array([run[k, column] for run in runs if len(run) > k])
            if len(values) >= 20:
                low, high = chi2.ppf([0.025, 0.975], freedom * len(values)) / len(values)
                inside.append(low <= values.mean() <= high)
        shares.append(float(np.mean(inside)) if inside else float("nan"))
    return "  time steps with the mean NEES in its 95 % band: " + ", ".join(f"{each:.0%}" for each in shares)


def _imported(name: str) -> ModuleType | None:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def speed() -> Iterator[str]:
    """Yield the time of one predict and update, by the number of lines."""
    yield "time of one predict and update (median), without and with a map that has tolerances"
    for n in (4, 8, 12):
        generator = np.random.default_rng(n)
        points, directions = generator.normal(size=(n, 3)), generator.normal(size=(n, 3))
        pose = Pose.look_at((1.0, 2.0, 4.0), (0.0, 0.0, 0.0))
        calls = {}
        for name, std in (("exact map", 0.0), ("map known to 1 mm", 1e-3)):
            lines = LineSet.from_points_directions(points, directions, position_std=std, direction_std=std)
            pose_filter = PoseFilter(
                lines, FilterParameters(noise_image=NOISE), start=pose, start_covariance=1e-4 * np.eye(6)
            )
            images = cycle([noisy_image(lines, pose, generator) for _ in range(50)])
            calls[name] = lambda pose_filter=pose_filter, images=images: (
                pose_filter.predict(np.zeros(6), 0.04),
                pose_filter.update(next(images)),
            )
            calls[name]()
        times = median_seconds(calls)
        yield f"  {n:2d} lines: " + ", ".join(f"{name} {1e6 * each:.0f} us" for name, each in times.items())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED, help=f"of scenes and noise (default: {SEED})")
    parser.add_argument("--scenes", type=int, default=SCENES, help=f"how many sequences (default: {SCENES})")
    parser.add_argument("--quick", action="store_true", help=f"only {QUICK_SCENES} sequences")
    parser.add_argument("--figure", default="", help="PNG of the errors over the distance to the loci")
    options = parser.parse_args()
    report(options.seed, QUICK_SCENES if options.quick else options.scenes, options.figure)
