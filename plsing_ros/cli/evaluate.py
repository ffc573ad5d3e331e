# SPDX-License-Identifier: Apache-2.0
"""Command evaluate: is this task safe with my lines, my noise, my robot?"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plsing_ros.analysis.checkpoint import Checkpoint
from plsing_ros.analysis.evaluation.evaluation import Evaluation, Safety, evaluate, name_of
from plsing_ros.analysis.evaluation.setup import Setup
from plsing_ros.analysis.parallel import Workers
from plsing_ros.cli.command import add_worker_options, make_folder, run_command
from plsing_ros.errors import ParameterError
from plsing_ros.figures.evaluation_report import save_evaluation_page
from plsing_ros.geometry import Pose
from plsing_ros.geometry.pose import checked_position
from plsing_ros.parameters import (
    ControllerParameters,
    MonitorParameters,
    PoseEstimatorParameters,
    SimulatorParameters,
)
from plsing_ros.parameters.law import LAWS
from plsing_ros.parameters.parameter_file import read_parameters

_EPILOG = """examples:
  evaluate config/paper_p4l.yaml --output report/            the paper's task: not safe, and which law helps
  evaluate config/small_object.yaml --quick                  ten runs of each law, in half a minute
  evaluate my_cell.yaml --start 0.9 -2.3 0.5 --target 0.6 -2.0 0.4 --noise 0.002 --output report/
  evaluate my_cell.yaml --runs 400 --output report/ --scheduler tcp://host:8786

The file is that of --params-file for the nodes: the scene under lines.*, the target and law under controller, the
robot, camera and thresholds under singularity_monitor, the noise under pose_estimator, the start under
feature_simulator. With --output, a command that was stopped goes on where it was when it is given again.

The exit code is 0 if the task is safe, 3 if it is not or if that is not known, 1 if the input is wrong."""

_NOT_SAFE = 3
_QUICK = 10


def main(argv: Sequence[str] | None = None) -> int:
    """Evaluate a task and say whether it is safe; return the exit code."""
    parser = argparse.ArgumentParser(
        description="Simulate a task with its lines, noise and robot again and again: by each control law, with the "
        "monitor watching, with lines as far off as they may be. Say whether it is safe, and what to do if not.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("params", help="parameter file of the nodes")
    where: dict[str, Any] = {"nargs": 3, "type": float, "metavar": ("X", "Y", "Z")}
    parser.add_argument("--start", **where, help="camera centre at the start [m] (the file's)")
    parser.add_argument("--target", **where, help="camera centre at the target [m] (the file's)")
    parser.add_argument("--look-at", **where, help="where --start and --target look (the middle of the lines)")
    parser.add_argument("--noise", type=float, help="of angle [rad] and offset of image lines (pose_estimator's)")
    parser.add_argument("--spread", type=float, default=0.02, help="of the starts [m] (%(default)g)")
    parser.add_argument("--turn", type=float, default=1.0, help="likewise [degrees] (%(default)g)")
    parser.add_argument("--runs", type=int, default=40, help="of each law (%(default)s)")
    parser.add_argument("--maps", type=int, default=40, help="that the lines may be (%(default)s)")
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK} of both")
    parser.add_argument("--laws", nargs="+", choices=LAWS, default=LAWS, metavar="LAW", help="to compare with (all)")
    parser.add_argument("--max-harm", type=float, default=0.1, help="share of harmful runs allowed (%(default)g)")
    parser.add_argument("--clearance", type=float, default=0.1, help="distance from singular loci [m] (%(default)g)")
    parser.add_argument("--accuracy", type=float, default=0.02, help="needed at the target [m] (%(default)g)")
    parser.add_argument("--seed", type=int, default=0, help="of all that is drawn (%(default)s)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="folder for the page, and for what is needed to go on"
    )
    add_worker_options(parser)
    options = parser.parse_args(argv)
    return run_command("evaluate", lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    if options.output is not None:
        make_folder(options.output, "write the report", "--output")
    found = _evaluate(options, _setup(options))
    print(json.dumps(found.as_json(), indent=2) if options.json else found)
    if options.output is not None:
        page = save_evaluation_page(found, f"Evaluation of {Path(options.params).name}", options.output / "report.html")
        if not options.json:
            print(f"page: {page}")
    return 0 if found.safety in (Safety.SAFE, Safety.CARE) else _NOT_SAFE


def _evaluate(options: argparse.Namespace, setup: Setup) -> Evaluation:
    from tqdm import tqdm

    name = name_of(setup)
    file = None if options.output is None else options.output / f"evaluate_{name}.jsonl"
    with Workers(options.scheduler, options.processes) as workers, tqdm(unit="task", disable=None, leave=False) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        return evaluate(
            setup,
            _QUICK if options.quick else options.runs,
            _QUICK if options.quick else options.maps,
            laws=tuple(options.laws),
            max_harm=options.max_harm,
            clearance=options.clearance,
            accuracy=options.accuracy,
            workers=workers,
            checkpoint=Checkpoint(file, {"evaluation": name}),
            progress=progress,
        )


def _setup(options: argparse.Namespace) -> Setup:
    for name, value, low, high in (
        ("--runs", options.runs, 1, 10**6),
        ("--maps", options.maps, 1, 10**6),
        ("--max-harm", options.max_harm, 0.0, 1.0),
        ("--spread", options.spread, 0.0, 1e3),
        ("--turn", options.turn, 0.0, 180.0),
        ("--noise", 0.0 if options.noise is None else options.noise, 0.0, 1.0),
        ("--clearance", options.clearance, 0.0, 1e6),
        ("--accuracy", options.accuracy, 0.0, 1e6),
        ("--seed", options.seed, 0, 2**31 - 1),
    ):
        if not low <= value <= high:
            raise ParameterError(f"{name} is {value}; it must be between {low:g} and {high:g}")
    values = {
        node: read_parameters(options.params, node)
        for node in ("controller", "singularity_monitor", "pose_estimator", "feature_simulator")
    }
    controller = ControllerParameters.from_values(values["controller"])
    controller.require_three_lines("to servo on")
    middle = controller.lines().pivot.mean(axis=0)
    at = checked_position("--look-at", middle if options.look_at is None else options.look_at)
    start = None if options.start is None else Pose.look_at(checked_position("--start", options.start), at)
    if options.target is not None:
        target = Pose.look_at(checked_position("--target", options.target), at)
        controller = controller.with_values(
            {"target.position": target.translation.tolist(), "target.orientation": target.quaternion_xyzw.tolist()}
        )
    elif "target.position" not in values["controller"]:
        raise ParameterError(
            "where to? give --target X Y Z, or target.position and target.orientation for controller in "
            f"{options.params}"
        )
    simulator = SimulatorParameters.from_values(values["feature_simulator"])
    if start is None and "start.position" not in values["feature_simulator"]:
        raise ParameterError(
            f"from where? give --start X Y Z, or start.position and start.orientation for feature_simulator in "
            f"{options.params}"
        )
    return Setup.of_parameters(
        controller,
        MonitorParameters.from_values(values["singularity_monitor"]),
        PoseEstimatorParameters.from_values(values["pose_estimator"]),
        simulator.start_pose() if start is None else start,
        simulator.time_step,
        options.noise,
        spread=options.spread,
        turn=math.radians(options.turn),
        seed=options.seed,
    )
