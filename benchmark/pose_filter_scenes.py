# SPDX-License-Identifier: Apache-2.0
"""Single images of flat scenes, and of lines as they are measured."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmark.camera_sequences import linearised, noisy_image
from benchmark.servo_tasks import random_task
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import FilterParameters
from plsing_ros.pose import PoseEstimator, Verdict


def flat_scenes(seed: int, tries: int) -> Iterator[str]:
    """Yield how often a mirrored pose, or any wrong one, of a flat scene is OK, with a map that is off by 1 mm."""
    half = {"door frame": (0.45, 1.0), "window": (0.6, 0.5), "pallet": (0.6, 0.4)}
    yield f"flat scenes, {tries} tries each, map off by 1 mm, default settings but for the images' noise"
    for name, (width, height) in half.items():
        generator = np.random.default_rng([seed, len(name)])
        share = dict.fromkeys(Verdict, 0)
        wrong = 0
        for _ in range(tries):
            corners = np.array(
                [[-width, -height, 0.0], [width, -height, 0.0], [width, height, 0.0], [-width, height, 0.0]]
            )
            directions = np.roll(corners, -1, axis=0) - corners
            true = LineSet.from_points_directions(corners, directions)
            known = LineSet.from_points_directions(
                corners + generator.normal(scale=1e-3, size=(4, 3)),
                directions / np.linalg.norm(directions, axis=1, keepdims=True)
                + generator.normal(scale=1e-3, size=(4, 3)),
                position_std=1e-3,
                direction_std=1e-3,
            )
            center = np.array([*generator.uniform(-1.0, 1.0, size=2), -generator.uniform(1.5, 4.0)])
            pose = Pose.look_at(center, generator.normal(scale=0.2, size=3), down=(0.0, 1.0, 0.0))
            estimate = PoseEstimator(known, FilterParameters(noise_image=1e-4)).estimate(
                noisy_image(true, pose, generator)
            )
            share[estimate.verdict] += 1
            if estimate.verdict is Verdict.OK and estimate.pose is not None:
                wrong += bool(np.linalg.norm(estimate.pose.translation - center) > 0.1)
        counts = ", ".join(f"{verdict.name} {count}" for verdict, count in share.items() if count)
        yield f"  {name:12s} wrong poses that are OK: {wrong}; {counts}"


def measured_covariances(seed: int, runs: int) -> Iterator[str]:
    """Yield errors with lines as they are measured on images, against those of the best linear estimate."""
    ratios: dict[str, list[tuple[float, float]]] = {"with covariances": [], "one number for all lines": []}
    for number in range(runs):
        generator = np.random.default_rng([seed, number, 5])
        task = random_task(seed, 3 * number)
        n = len(task.lines)
        angle = 3e-3 * 20.0 ** generator.uniform(-0.5, 0.5, size=n)
        offset = 3e-4 * 20.0 ** generator.uniform(-0.5, 0.5, size=n)
        covariances = np.stack([angle**2, 0.85 * angle * offset, offset**2], axis=1)
        image = noisy_image(task.lines, task.start, generator, covariances)
        blind = LineObservation(image.ids, image.image_lines, image.usable, None)
        _, jacobian = linearised(task.lines, task.start, image)
        matrices = covariances[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        weight = np.linalg.inv(matrices)
        rows = jacobian.reshape(n, 2, 6)
        best = np.sqrt(np.trace(np.linalg.inv(np.einsum("nia,nij,njb->ab", rows, weight, rows))[:3, :3]))
        if best > 0.05:
            continue
        for name, each, noise in (("with covariances", image, 1e-3), ("one number for all lines", blind, 1e-3)):
            found = PoseEstimator(task.lines, FilterParameters(noise_image=noise)).estimate(each, task.start)
            if found.pose is not None:
                ratios[name].append((float(np.linalg.norm(found.pose.translation - task.start.translation)), best))
    yield "lines as measured on images (correlation 0.85, standard deviations that differ 20-fold), single images"
    for name, values in ratios.items():
        error, best = np.array(values).T
        ratio = np.sqrt(np.mean((error / best) ** 2))
        yield f"  {name:26s} {len(values)} scenes: root mean square of error / best linear estimate's {ratio:.2f}"
