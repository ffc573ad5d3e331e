"""Our own code in one cycle: the controller's step and the monitor's assessment, beside a textbook control law."""

from __future__ import annotations

import numpy as np

from benchmark.timing import median_seconds
from plsing_ros.features import LineObservation, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import ControllerParameters, MonitorParameters
from plsing_ros.servoing.line_servo import LineServo
from plsing_ros.servoing.singularity_monitor import SingularityMonitor

NOW = 10**12
START = Pose(np.eye(3), np.array([0.2, -0.1, -6.0]))
TARGET = Pose(np.eye(3), np.array([0.0, 0.0, -5.0]))


def main() -> None:
    """Measure and print."""
    print("median of one cycle [us]; textbook: projection, L and numpy's lstsq, without any check of the input\n")
    print(f"{'lines':>6} {'controller':>11} {'textbook':>9} {'ratio':>6} {'monitor':>9}")
    for n in (4, 5, 20, 100):
        generator = np.random.default_rng(n)
        lines = LineSet.from_points_directions(generator.normal(size=(n, 3)), generator.normal(size=(n, 3)))
        scene = {"lines_points": lines.point.ravel(), "lines_directions": lines.direction.ravel()}
        servo = LineServo(ControllerParameters(**scene, target_position=TARGET.translation))
        monitor = SingularityMonitor(MonitorParameters(**scene))
        monitor.receive_pose(START, NOW)
        observation = LineObservation.of_lines(lines.transformed(START.inverse(), "camera"))
        target = project_lines(lines.transformed(TARGET.inverse(), "camera"))
        medians = median_seconds(
            {
                "controller": lambda: servo.step(observation, NOW, NOW),
                "textbook": lambda: _textbook(observation.lines_camera, target),
                "monitor": lambda: monitor.assess(observation, NOW, NOW),
            }
        )
        microseconds = {name: 1e6 * value for name, value in medians.items()}
        print(
            f"{n:6d} {microseconds['controller']:11.0f} {microseconds['textbook']:9.0f} "
            f"{medians['controller'] / medians['textbook']:6.2f} {microseconds['monitor']:9.0f}"
        )


def _textbook(lines: LineSet, target: np.ndarray) -> np.ndarray:
    return -0.1 * np.linalg.lstsq(interaction_matrix(lines), project_lines(lines) - target, rcond=None)[0]
