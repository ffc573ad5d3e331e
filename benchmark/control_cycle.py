# SPDX-License-Identifier: Apache-2.0
"""One control step, features to twist with condition number, beside ViSP's and numpy's; and the monitor's cycle."""

from __future__ import annotations

import statistics
from collections.abc import Callable

import numpy as np

from benchmark import visp
from benchmark.timing import median_seconds
from plsing_ros.control.plain_law import compute_plain_twist
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.features import LineObservation, decompose, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import ControllerParameters, MonitorParameters

NOW = 10**12
GAIN = 0.1
START = Pose(np.eye(3), np.array([0.2, -0.1, -6.0]))
TARGET = Pose(np.eye(3), np.array([0.0, 0.0, -5.0]))
# In a row, so that what one candidate leaves in the caches is not the next one's cost; ViSP's program does it likewise.
CALLS = 25
ROUNDS = 8  # of all candidates in turns, so that a change of the machine's speed hits them alike
OWN_NAMES = ("step", "input", "guarded", "core", "numpy", "monitor")


def main() -> None:
    """Measure and print."""
    with visp.compiled() as peer:
        print(f"ViSP: {peer if isinstance(peer, str) else f'{peer.version}, its own vpFeatureLine and vpServo, C++'}\n")
        print("median of one control step [us]")
        print("  step:    ServoController.step, with everything that its state says")
        print("  input:   LineObservation.from_rows, the checks of what comes from outside")
        print("  guarded: the same with law = guarded, where L is healthy")
        print("  core:    L, its singular value decomposition, twist, inverse condition number")
        print("  numpy:   projection, L by numpy, numpy.linalg.pinv, numpy.linalg.cond; no checks")
        print("  monitor: one assessment\n")
        columns = ("ViSP", *OWN_NAMES, "step/ViSP", "core/ViSP")
        print(f"{'lines':>6}" + "".join(f" {each:>9}" for each in columns))
        for n in (4, 5, 20, 100):
            medians = _measured(n, peer)
            shown = [f"{1e6 * medians[each]:.1f}" if each in medians else "" for each in columns[:-2]]
            if "ViSP" in medians:
                shown += [f"{medians[each] / medians['ViSP']:.2f}" for each in ("step", "core")]
            print(f"{n:6d}" + "".join(f" {each:>9}" for each in shown), flush=True)


def _measured(n: int, peer: visp.Visp | str) -> dict[str, float]:
    generator = np.random.default_rng(n)
    lines = LineSet.from_points_directions(generator.normal(size=(n, 3)), generator.normal(size=(n, 3)))
    own = _own(lines)
    times: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        found = median_seconds(own, rounds=20, calls=CALLS)
        if isinstance(peer, visp.Visp):
            found["ViSP"], inverse = peer.step(lines, START, TARGET)
            ours = decompose(interaction_matrix(lines.transformed(START.inverse(), "camera")))
            assert np.isclose(inverse, ours.inverse_condition_number, rtol=1e-6), "not the same scene"
        for name, value in found.items():
            times.setdefault(name, []).append(value)
    return {name: statistics.median(values) for name, values in times.items()}


def _own(lines: LineSet) -> dict[str, Callable[[], object]]:
    scene = {"lines_points": tuple(lines.point.ravel()), "lines_directions": tuple(lines.direction.ravel())}
    parameters = ControllerParameters(**scene, target_position=tuple(TARGET.translation), gain=GAIN)
    servo, guarded = (
        ServoController.from_parameters(parameters),
        ServoController.from_parameters(parameters.with_values({"law": "guarded"})),
    )
    monitor = SingularityMonitor.from_parameters(MonitorParameters(**scene))
    monitor.receive_pose(START, NOW)
    observation = LineObservation.of_lines(lines.transformed(START.inverse(), "camera"))
    seen, rows = observation.lines_camera, observation.image_lines
    image = rows.ravel()
    target = project_lines(lines.transformed(TARGET.inverse(), "camera"))

    def core() -> tuple[np.ndarray, float]:
        asked, _ = compute_plain_twist(parameters, seen, image, target)
        return asked.twist, float(asked.values[-1] / asked.values[0])

    def textbook() -> tuple[np.ndarray, float]:
        matrix = _interaction_matrix_of_numpy(seen)
        return -GAIN * np.linalg.pinv(matrix) @ (project_lines(seen) - target), 1.0 / np.linalg.cond(matrix)

    candidates = (
        lambda: servo.answer(observation, NOW, NOW),
        lambda: LineObservation.from_rows(seen.ids, rows, seen.direction, seen.moment, observation.usable, "camera"),
        lambda: guarded.answer(observation, NOW, NOW),
        core,
        textbook,
        lambda: monitor.answer(observation, NOW, NOW),
    )
    return dict(zip(OWN_NAMES, candidates, strict=True))


def _interaction_matrix_of_numpy(seen: LineSet) -> np.ndarray:
    depth = np.hypot(seen.moment[:, 0], seen.moment[:, 1])[:, np.newaxis, np.newaxis]
    image = seen.moment[:, :, np.newaxis] / depth
    rate = np.concatenate([np.cross(np.eye(3), each[:, np.newaxis]) for each in (seen.direction, seen.moment)], axis=2)
    across = (image[:, :2] * rate[:, :2]).sum(axis=1, keepdims=True)
    return ((rate - image * across) / depth).reshape(-1, 6)
