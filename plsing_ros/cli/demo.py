# SPDX-License-Identifier: Apache-2.0
"""Command demo: a camera servos on four lines near a singularity, with the monitor's alerts coming in."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from plsing_ros.cli.command import make_folder, run_command
from plsing_ros.errors import ParameterError
from plsing_ros.figures.servo_runs import save_figures
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import ControllerParameters, SimulatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.simulation import near_transversal as experiment
from plsing_ros.simulation.run_record import Alert, RunRecord, summary_table
from plsing_ros.singularities import singular_set
from plsing_ros.testing.lockstep import run_lockstep

_EPILOG = """examples:
  demo                        Starts 1 to 4 of the paper
  demo --starts 2             only the one that blows up
  demo --estimate-pose        without the simulator's ground truth: image lines only
  demo --output /tmp/figures  write the figures there
  demo --starts 2 --record run    record the topics for replay run/start_2
  demo --params-file my_cell.yaml --record run    your own lines, start and target"""

# When a run of one's own ends [m], [frames].
_ARRIVED, _MAX_STEPS = 2e-3, 5000


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo; return the exit code."""
    parser = argparse.ArgumentParser(
        description="Run simulator, controller and monitor in one process over real topics, from the paper's four "
        "starts to a target near the transversal L_M, and draw what happened.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--starts", nargs="+", type=int, choices=(1, 2, 3, 4), default=(1, 2, 3, 4), help="which starts"
    )
    parser.add_argument("--params-file", type=Path, metavar="YAML", help="your own scene, start and target instead")
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="folder of the figures (%(default)s)")
    parser.add_argument(
        "--executor", choices=("events", "single"), default="events", help="rclpy executor (%(default)s)"
    )
    parser.add_argument(
        "--estimate-pose",
        action="store_true",
        help="show the nodes image lines only, as a tracker does, and estimate the camera pose from them",
    )
    parser.add_argument(
        "--record", type=Path, metavar="DIR", help="record the topics, a rosbag2 for each start, for replay"
    )
    options = parser.parse_args(argv)
    return run_command("demo", lambda: _run(options))


_SCENES = {True: "Your lines", False: "The paper's four lines"}


class _Task(NamedTuple):
    """A run to be made: from where to where, by the parameters of a file and what goes over them."""

    name: str
    note: str
    start: dict[str, Any]
    target: dict[str, Any]
    arrived: float
    max_steps: int
    distance: float


def _run(options: argparse.Namespace) -> int:
    own = options.params_file is not None
    params_file = options.params_file if own else config_file("paper_p4l.yaml")
    singular = singular_set(read_scene(params_file))
    tasks = [_own_task(params_file)] if own else [_papers_task(number) for number in options.starts]
    print(f"{_SCENES[own]}: {singular.description}")
    if not own:
        print(f"Starts within 1.1 m of a target near {singular.transversals[0].name}, lambda = {experiment.GAIN} 1/s\n")
    make_folder(options.output, "write the figures", "--output")
    if options.record is not None:
        make_folder(options.record, "record", "--record")
    records = [_run_task(task, params_file, options) for task in tasks]
    print(f"\n{summary_table(records)}\n")
    for file in save_figures(records, singular, options.output):
        print(f"figure: {file}")
    if options.record is not None:
        first = options.record / _folder(tasks[0])
        print(f"recorded: {options.record}; see what the monitor said, and would say: replay {first}")
    return 0


def _papers_task(number: int) -> _Task:
    start = experiment.STARTS[number - 1]
    orientation = experiment.ORIENTATION.tolist()
    return _Task(
        start.name,
        start.note,
        {"start.position": start.position.tolist(), "start.orientation": orientation},
        {
            "target.position": experiment.TARGET_POSITION.tolist(),
            "target.orientation": orientation,
            "gain": experiment.GAIN,
        },
        experiment.ARRIVED,
        experiment.MAX_STEPS,
        float(np.linalg.norm(start.position - experiment.TARGET_POSITION)),
    )


def _own_task(params_file: Path) -> _Task:
    """Return the task of a parameter file.

    Raises:
        PlsingError: If the file does not say from where and where to.
    """
    simulator, controller = (read_parameters(params_file, node) for node in ("feature_simulator", "controller"))
    for node, values, name in (("feature_simulator", simulator, "start"), ("controller", controller, "target")):
        if f"{name}.position" not in values:
            raise ParameterError(f"parameter file {params_file} has no {name}.position for {node}")
    start = SimulatorParameters.from_values(simulator).start_pose()
    target = ControllerParameters.from_values(controller).target_pose()
    distance = float(np.linalg.norm(start.translation - target.translation))
    return _Task("Your task", params_file.name, {}, {}, _ARRIVED, _MAX_STEPS, distance)


def _folder(task: _Task) -> str:
    return task.name.lower().replace(" ", "_")


def _run_task(task: _Task, params_file: Path, options: argparse.Namespace) -> RunRecord:
    # Distances shrink by a constant factor each second when all goes well, so their logarithm is the progress.
    decades = max(float(np.log10(max(task.distance, task.arrived) / task.arrived)), 1e-9)
    bar = tqdm(
        total=100,
        desc=f"{task.name} ({task.note})",
        bar_format="{desc}: {percentage:3.0f}%|{bar:20}|{postfix}",
        file=sys.stdout,
        mininterval=0.2,
    )

    def on_frame(number: int, distance: float) -> None:
        if number % 10 == 0 or distance <= task.arrived:
            progress = 100.0 * min(1.0, max(0.0, np.log10(task.distance / max(distance, 1e-12)) / decades))
            bar.set_postfix_str(f"step {number}, {distance:.3f} m from the target", refresh=False)
            bar.update(progress - bar.n)

    def on_alert(alert: Alert) -> None:
        bar.write(f"  {alert.time:6.2f} s  {alert.text}", file=sys.stdout)

    with bar:
        return run_lockstep(
            task.name,
            params_file,
            start=task.start,
            target=task.target,
            arrived=task.arrived,
            max_steps=task.max_steps,
            on_frame=on_frame,
            on_alert=on_alert,
            executor=options.executor,
            estimate_pose=options.estimate_pose,
            record=None if options.record is None else options.record / _folder(task),
        )
