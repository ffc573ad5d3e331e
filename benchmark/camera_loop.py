# SPDX-License-Identifier: Apache-2.0
"""From a camera's images to the servo loop: random starts of a rendered arm, and the time from image to twist.

    python3 -m benchmark camera_loop
    python3 -m benchmark camera_loop --quick
    PLSING_CAMERA_LOOP_SEED=19 PLSING_CAMERA_LOOP_ROWS=rows.json python3 -m benchmark camera_loop

The loop runs in one process, in lockstep: arm and camera, line tracker, controller. The lines are those in the image
(law pinv), or those that are seen from the tracked pose (law position).
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from plsing_ros.errors import GeometryError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import exponential, rotation_vector
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.options import pose_options
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.simulation.arm import Arm
from plsing_ros.simulation.arm_simulation import ArmSimulation
from plsing_ros.simulation.camera_loop import CameraLoop
from plsing_ros.tracking.session import SessionState

SCENE = "camera_arm.yaml"
_MAX_FRAMES = 400
_GAIN = 2.0  # [1/s], for a short study
_LAST = 25  # frames that are averaged over in the end
_FIRST_OFF = 0.005, np.radians(2.0)  # of the pose that the tracker begins with
# A pose that is farther off than this, of a tracker that says TRACKING, is lost silently.
_LOST = 0.02, np.radians(5.0)
_VARIANTS = {"lines from the pose": ("position", True), "lines of the image": ("pinv", False)}
# Rows are kept here, if it is set, and an interrupted study goes on.
_ROWS = os.environ.get("PLSING_CAMERA_LOOP_ROWS")
# Of the starts, of the noise of images, and of the errors of first poses.
_SEED = int(os.environ.get("PLSING_CAMERA_LOOP_SEED", "18"))


@dataclass(frozen=True)
class Run:
    """How a run ended.

    Attributes:
        position: Median distance of the camera from the target in the last second [m].
        rotation: Likewise [rad].
        frames: Until it stayed within 0.5 mm and 0.1 degrees, or all.
        silent: Frames that were lost silently.
        not_tracking: Frames that were not TRACKING or WEAK, after the first.
        words: What was said last.
        nees: Median of the squared errors of poses that are TRACKING, in their covariance.
    """

    position: float
    rotation: float
    frames: int
    silent: int
    not_tracking: int
    words: str
    nees: float


def main(quick: bool = False) -> None:
    """Print how the runs ended."""
    import cv2

    cv2.setNumThreads(1)
    count = 6 if quick else 100
    starts = random_starts(count, np.random.default_rng(_SEED))
    print(
        f"Seed {_SEED}: {count} starts 10 to 30 cm and 10 to 20 degrees from the target, the object in view, noise 2\n"
    )
    # Edges look otherwise in the pictures of another renderer.
    print(renderer(starts[0]) + "\n", flush=True)
    rows: dict[str, list[Run]] = {name: [] for name in _VARIANTS}
    for number, start in enumerate(starts):
        for name, (law, from_pose) in _VARIANTS.items():
            rows[name].append(run_cached(name, number, start, law, from_pose))
    for name, runs in rows.items():
        law = _VARIANTS[name][0]
        position, rotation = (np.array([getattr(run, field) for run in runs]) for field in ("position", "rotation"))
        within = {limit: int(np.sum((position < 1e-3 * limit) & (rotation < np.radians(0.1)))) for limit in (0.5, 2.0)}
        there = {limit: int(np.sum(position < 1e-3 * limit)) for limit in (0.5, 2.0)}
        print(
            f"{name} (law {law}): {within[0.5]} of {count} within 0.5 mm and 0.1 degrees, {there[2.0]} within 2 mm "
            f"({within[2.0]} and 0.1 degrees); error {1e3 * np.median(position):.2f} / {1e3 * position.max():.2f} mm, "
            f"{np.degrees(np.median(rotation)):.3f} / {np.degrees(rotation.max()):.3f} degrees (median / largest); "
            f"lost silently {sum(run.silent for run in runs)} frames, not tracked "
            f"{sum(run.not_tracking for run in runs)}; "
            f"NEES {np.median([run.nees for run in runs]):.1f}",
            flush=True,
        )
        for number, run in enumerate(runs):
            if run.position > 2e-3 or run.silent:
                off = f"{1e3 * run.position:.1f} mm, {np.degrees(run.rotation):.2f} degrees"
                print(f"  start {number}: {off}, {run.words}")


def random_starts(count: int, random: np.random.Generator) -> list[Pose]:
    """Return starts 10 to 30 cm and 10 to 20 degrees from the target that see the object and that the arm reaches."""
    arm_values = read_parameters(config_file(SCENE), "arm_simulator")
    parameters = ArmSimulatorParameters.from_values(arm_values)
    target = ControllerParameters.from_values(read_parameters(config_file(SCENE), "controller")).target_pose()
    model, arm = parameters.model(), Arm(parameters.T_world_base)
    half = np.array([parameters.width, parameters.height]) / (2.0 * parameters.focal_length)
    near = arm.joints_for(target)
    starts: list[Pose] = []
    while len(starts) < count:
        away, axis = random.normal(size=(2, 3))
        away *= random.uniform(0.1, 0.3) / np.linalg.norm(away)
        axis *= np.radians(random.uniform(10.0, 20.0)) / np.linalg.norm(axis)
        pose = Pose(target.rotation @ exponential(axis)[0], target.translation + away)
        seen = (model.vertices - pose.translation) @ pose.rotation
        if seen[:, 2].min() < 0.1 or (np.abs(seen[:, :2]) > 0.95 * half * seen[:, 2:]).any():
            continue
        try:
            arm.joints_for(pose, near)
        except GeometryError:
            continue
        starts.append(pose)
    return starts


def run_cached(name: str, number: int, start: Pose, law: str, from_pose: bool) -> Run:
    """Return the row of a run, from the file of rows if it is there."""
    if _ROWS is None:
        return run_loop(number, start, law, from_pose)
    file, key = Path(_ROWS), f"{name} {_SEED} {number}"
    rows = json.loads(file.read_text()) if file.exists() else {}
    if key not in rows:
        rows[key] = asdict(run_loop(number, start, law, from_pose))
        whole = file.with_suffix(".new")
        whole.write_text(json.dumps(rows))
        whole.replace(file)
    return Run(**rows[key])


def run_loop(number: int, start: Pose, law: str, from_pose: bool) -> Run:
    """Run one start until it stays at the target, or its time is over."""
    arm = arm_at(start, 1000 * _SEED + number)
    controller = read_parameters(config_file(SCENE), "controller") | {"law": law, "gain": _GAIN}
    values = ControllerParameters.from_values(controller)
    loop, target = CameraLoop(arm, values, from_pose), values.target_pose()
    random = np.random.default_rng([_SEED, number])
    away, axis = random.normal(size=(2, 3))
    away *= _FIRST_OFF[0] / np.linalg.norm(away)
    axis *= _FIRST_OFF[1] / np.linalg.norm(axis)
    first = Pose(start.rotation @ exponential(axis)[0], start.translation + away)
    rows, squares, silent, not_tracking, words = [], [], 0, 0, ""
    for frame in loop.frames(first):
        rows.append(difference(frame.T_world_camera, target))
        found, tracking = frame.report.state, frame.report.tracking
        if found is SessionState.TRACKING and tracking is not None and tracking.T_world_camera is not None:
            off = difference(tracking.T_world_camera, frame.T_world_camera)
            silent += int(off[0] > _LOST[0] or off[1] > _LOST[1])
            squares.append(squared_error(tracking.T_world_camera, frame.T_world_camera, tracking.covariance))
        not_tracking += int(len(rows) > 1 and not frame.report.usable)
        words = " ".join(each for each in (found.name, frame.report.reason, frame.command.reason, frame.remark) if each)
        last = np.array(rows[-2 * _LAST :])
        settled = len(last) == 2 * _LAST and frame.report.usable and (np.ptp(last, axis=0) < (3e-4, 1e-3)).all()
        if settled or len(rows) == _MAX_FRAMES:
            break
    loop.simulation.close()
    position, rotation = np.median(np.array(rows[-_LAST:]), axis=0)
    outside = [k for k, (p, r) in enumerate(rows) if p > 5e-4 or r > np.radians(0.1)]
    frames = outside[-1] + 1 if outside else 0
    nees = float(np.median(squares)) if squares else float("nan")
    return Run(float(position), float(rotation), frames, silent, not_tracking, words, nees)


def arm_at(start: Pose, seed: int) -> ArmSimulatorParameters:
    """Return the arm of the scene at a start, with its camera, in lockstep."""
    given = pose_options(start)
    values = read_parameters(config_file(SCENE), "arm_simulator") | {
        "start.position": given["position"],
        "start.orientation": given["orientation"],
        "mode": "lockstep",
        "seed": seed,
    }
    return ArmSimulatorParameters.from_values(values)


def renderer(start: Pose) -> str:
    """Return what draws, as a sentence."""
    simulation = ArmSimulation(arm_at(start, 0))
    simulation.close()
    return simulation.renderer


def difference(a: Pose, b: Pose) -> tuple[float, float]:
    """Return how far two poses are apart [m] and [rad]."""
    turn = rotation_vector(a.rotation.T @ b.rotation)
    return float(np.linalg.norm(a.translation - b.translation)), float(np.linalg.norm(turn))


def squared_error(found: Pose, true: Pose, covariance: np.ndarray) -> float:
    """Return the squared error of a pose in its covariance, 6 in the mean if that is right."""
    turn = rotation_vector(found.rotation @ true.rotation.T)
    off = np.concatenate([found.translation - true.translation, turn])
    return float(off @ np.linalg.solve(covariance, off))
