# SPDX-License-Identifier: Apache-2.0
"""Command replay: monitor and controller over a recorded run, also with other parameters."""

from __future__ import annotations

import argparse
import difflib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plsing_ros.analysis.recording import RecordedMessage, RecordingError, read_recording
from plsing_ros.analysis.replay import ReplayedRun, replay, scene_of
from plsing_ros.cli.command import make_folder, run_command
from plsing_ros.errors import ParameterError
from plsing_ros.figures.replay_report import save_replay_report
from plsing_ros.parameters import ControllerParameters, MonitorParameters
from plsing_ros.parameters.parameter_file import read_parameters

_EPILOG = """examples:
  replay run/                                        the scene is read from the recording
  replay run/ --params-file config/paper_p4l.yaml
  replay run/ --params-file config/paper_p4l.yaml --set warn.transversal_distance=0.1 --output report/

Record with: ros2 bag record line_features camera_pose cmd_twist desired_line_features singular_loci singularity_alerts
or with: demo --record run/"""

_FEATURES = ("completed_line_features", "line_features")


def main(argv: Sequence[str] | None = None) -> int:
    """Replay a recording and say what the monitor and the controller say; return the exit code."""
    parser = argparse.ArgumentParser(
        description="Let monitor and controller answer a recorded run (rosbag2: SQLite or MCAP) faster than real time.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("bag", help="folder of the recording")
    parser.add_argument("--params-file", help="parameter file of the nodes; without one, the recorded scene")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter over the file's")
    parser.add_argument("--features", choices=_FEATURES, help="topic to read (completed ones, if they are recorded)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--output", type=Path, metavar="DIR", help="folder for a figure and a report page")
    options = parser.parse_args(argv)
    return run_command("replay", lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    if options.output is not None:
        make_folder(options.output, "write the report", "--output")
    messages = list(tqdm(read_recording(options.bag), desc="reading", unit="message", disable=None, leave=False))
    monitor, controller = _parameters(options, messages)
    features = options.features or next(
        (name for name in _FEATURES if any(each.topic == name for each in messages)), _FEATURES[-1]
    )
    bar = tqdm(messages, desc="replaying", unit="message", disable=None, leave=False)
    run = replay(bar, monitor, controller, features)
    print(json.dumps(_as_json(run), indent=2) if options.json else run)
    if options.output is not None:
        for file in save_replay_report(run, f"Replay of {options.bag}", options.output):
            print(f"written: {file}")
    return 0


def _parameters(
    options: argparse.Namespace, messages: Sequence[RecordedMessage]
) -> tuple[MonitorParameters, ControllerParameters | None]:
    """Return the parameters of both nodes; None for a controller that has no target."""
    changes = dict(_change(text) for text in options.set)
    scene = scene_of(messages)
    known: set[str] = set()
    sets: list[dict[str, Any]] = []
    for node, kind in (("singularity_monitor", MonitorParameters), ("controller", ControllerParameters)):
        names = kind.specifications()
        values = dict(scene)
        if options.params_file is not None:
            values = {k: v for k, v in read_parameters(options.params_file, node).items() if k in names}
        sets.append(values | {name: value for name, value in changes.items() if name in names})
        known |= set(names)
    for name in changes:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise ParameterError(f"--set {name}: neither monitor nor controller has that parameter{hint}")
    if not sets[0].get("lines.points"):
        raise RecordingError(
            f"the scene is neither in the recording {options.bag} (topic singular_loci) nor in a parameter file: "
            "give --params-file"
        )
    has_target = "target.position" in sets[1] or any(each.topic == "desired_line_features" for each in messages)
    if "target.position" not in sets[1]:
        sets[1]["target.source"] = "topic"
    return MonitorParameters.from_values(sets[0]), ControllerParameters.from_values(sets[1]) if has_target else None


def _change(text: str) -> tuple[str, Any]:
    import yaml

    name, equals, value = text.partition("=")
    try:
        if not equals or not name:
            raise ParameterError(f"--set {text!r} is not NAME=VALUE")
        return name, yaml.safe_load(value)
    except yaml.YAMLError:
        raise ParameterError(f"--set {text!r}: {value!r} is no value") from None


def _as_json(run: ReplayedRun) -> dict[str, Any]:
    return {
        "duration": run.duration,
        "messages": len(run.time),
        "alerts": [{"time": each.time, "level": each.level.name, "text": each.text} for each in run.alerts],
        "recorded_alerts": [
            {"time": each.time, "level": each.level.name, "text": each.text} for each in run.recorded_alerts
        ],
        "refused": run.refused,
    }
