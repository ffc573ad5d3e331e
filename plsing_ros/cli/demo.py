# SPDX-License-Identifier: Apache-2.0
"""Command demo: a camera servos on four lines near a singularity, with the monitor's alerts coming in."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from plsing_ros.cli.command import make_folder, run_command
from plsing_ros.figures.servo_runs import save_figures
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation import near_transversal as experiment
from plsing_ros.simulation.run_record import Alert, RunRecord, summary_table
from plsing_ros.singularities import singular_set
from plsing_ros.testing.lockstep import run_lockstep

_EPILOG = """examples:
  demo                        Starts 1 to 4 of the paper
  demo --starts 2             only the one that blows up
  demo --estimate-pose        without the simulator's ground truth: image lines only
  demo --output /tmp/figures  write the figures there
  demo --starts 2 --record run    record the topics for replay run/start_2"""


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


def _run(options: argparse.Namespace) -> int:
    params_file = config_file("paper_p4l.yaml")
    singular = singular_set(read_scene(params_file))
    print(f"The paper's four lines: {singular.description}")
    print(f"Starts within 1.1 m of a target near {singular.transversals[0].name}, lambda = {experiment.GAIN} 1/s\n")
    make_folder(options.output, "write the figures", "--output")
    if options.record is not None:
        make_folder(options.record, "record", "--record")
    records = [_run_start(experiment.STARTS[number - 1], params_file, options) for number in options.starts]
    print(f"\n{summary_table(records)}\n")
    for file in save_figures(records, singular, options.output):
        print(f"figure: {file}")
    if options.record is not None:
        first = options.record / f"start_{options.starts[0]}"
        print(f"recorded: {options.record}; see what the monitor said, and would say: replay {first}")
    return 0


def _run_start(start: experiment.Start, params_file: Path, options: argparse.Namespace) -> RunRecord:
    at_start = float(np.linalg.norm(start.position - experiment.TARGET_POSITION))
    # Distances shrink by a constant factor each second when all goes well, so their logarithm is the progress.
    decades = np.log10(at_start / experiment.ARRIVED)
    bar = tqdm(
        total=100,
        desc=f"{start.name} ({start.note})",
        bar_format="{desc}: {percentage:3.0f}%|{bar:20}|{postfix}",
        file=sys.stdout,
        mininterval=0.2,
    )

    def on_frame(number: int, distance: float) -> None:
        if number % 10 == 0 or distance <= experiment.ARRIVED:
            progress = 100.0 * min(1.0, max(0.0, np.log10(at_start / distance) / decades))
            bar.set_postfix_str(f"step {number}, {distance:.3f} m from the target", refresh=False)
            bar.update(progress - bar.n)

    def on_alert(alert: Alert) -> None:
        bar.write(f"  {alert.time:6.2f} s  {alert.text}", file=sys.stdout)

    with bar:
        return run_lockstep(
            start.name,
            params_file,
            start={"start.position": start.position.tolist(), "start.orientation": experiment.ORIENTATION.tolist()},
            target={
                "target.position": experiment.TARGET_POSITION.tolist(),
                "target.orientation": experiment.ORIENTATION.tolist(),
                "gain": experiment.GAIN,
            },
            arrived=experiment.ARRIVED,
            max_steps=experiment.MAX_STEPS,
            on_frame=on_frame,
            on_alert=on_alert,
            executor=options.executor,
            estimate_pose=options.estimate_pose,
            record=None if options.record is None else options.record / start.name.lower().replace(" ", "_"),
        )
