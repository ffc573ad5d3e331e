# SPDX-License-Identifier: Apache-2.0
"""Command select_lines: which of many lines to servo on, for a target, a path or a workspace."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.analysis.line_selection import LineSelection, select_lines
from plsing_ros.arrays import Array
from plsing_ros.cli.camera_poses import PATH_HELP, add_pose_options, camera_poses
from plsing_ros.cli.command import add_worker_options, make_folder, run_command
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene, read_segment_ends
from plsing_ros.parameters.options import pose_options
from plsing_ros.parameters.scene import scene_values

_EPILOG = f"""examples:
  select_lines building.yaml --count 4 --box 2 -1 1 3 1 2
  select_lines building.yaml --count 6 --start 3 0 1 --target 1 0 1 --look-at 0 0 1 --output chosen/
  select_lines building.yaml --count 4 --path path.csv --json
  select_lines hall.yaml --count 8 --box 0 0 1 20 9 2 --output chosen/ --scheduler tcp://host:8786

With --output, a command that was stopped goes on where it was when it is given again.

{PATH_HELP}"""


def main(argv: Sequence[str] | None = None) -> int:
    """Choose lines and say why; return the exit code."""
    parser = argparse.ArgumentParser(
        description="Choose the lines to servo on: those with which the camera's position is known best at the worst "
        "of the poses, and whose singularities keep away from them.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scene", help="parameter file with lines.* (lines.ends if known), or a model: .obj, .cao")
    parser.add_argument("--count", type=int, default=4, help="how many lines (%(default)s)")
    add_pose_options(parser)
    parser.add_argument("--noise", type=float, default=1e-3, help="standard deviation of image lines (%(default)g)")
    parser.add_argument("--view", type=float, default=60.0, help="field of view, whole angle in degrees (%(default)g)")
    parser.add_argument(
        "--clearance", type=float, default=0.1, help="distance from singular loci to keep [m] (%(default)g)"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="folder for a figure, and for what is needed to go on"
    )
    add_worker_options(parser)
    options = parser.parse_args(argv)
    return run_command("select_lines", lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    if options.output is not None:
        make_folder(options.output, "write the figure", "--output")
    lines = read_scene(options.scene)
    poses = camera_poses(options, lines.pivot.mean(axis=0))
    ends = read_segment_ends(options.scene, len(lines))
    with tqdm(unit="set", disable=None, leave=False) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        chosen = select_lines(
            lines,
            options.count,
            poses,
            ends=ends,
            image_std=options.noise,
            max_angle=math.radians(options.view) / 2.0,
            clearance=options.clearance,
            progress=progress,
            processes=options.processes,
            scheduler=options.scheduler,
            resume=options.output,
        )
    print(json.dumps(_as_json(chosen), indent=2) if options.json else chosen)
    if options.output is not None:
        print(f"figure: {_save_figure(chosen, options.output / 'selection.png')}")
        print(f"parameters: {_save_parameters(chosen, lines, ends, poses, options)}")
    if not chosen.is_clear:
        print("no set of lines keeps the clearance: choose other poses, more lines, or a smaller --clearance")
    return 0


def _save_parameters(
    chosen: LineSelection, lines: LineSet, ends: Array | None, poses: Sequence[Pose], options: argparse.Namespace
) -> Path:
    """Write a parameter file for the nodes with the chosen lines, and with start and target if there are any."""
    import yaml

    rows = [lines.ids.index(i) for i in chosen.ids]
    kept = lines.select(rows)
    scene = {name.removeprefix("lines."): value for name, value in scene_values(kept).items()}
    sections: dict[str, Any] = {}
    if options.box is None:
        sections["controller"] = {"target": pose_options(poses[-1])}
        sections["singularity_monitor"] = {"target": {"known": True, **pose_options(poses[-1])}}
    if options.box is None and len(poses) > 1:
        sections["feature_simulator"] = {"start": pose_options(poses[0])}
    if ends is not None:
        sections.setdefault("singularity_monitor", {})["lines"] = {"ends": ends[rows].ravel().tolist()}
    content = {f"/**/{node}": {"ros__parameters": values} for node, values in sections.items()}
    # Last, because later sections win.
    content["/**"] = {"ros__parameters": {"lines": scene, "scene_frame": kept.frame}}
    file: Path = options.output / "lines.yaml"
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)
    file.write_text(f"# Lines that select_lines chose from {options.scene}.\n{text}", encoding="utf-8")
    return file


def _as_json(chosen: LineSelection) -> dict[str, object]:
    return {
        "ids": list(chosen.ids),
        "exact": chosen.exact,
        "clearance": _number(chosen.clearance),
        "locus": chosen.locus,
        "position_deviation": {name: _number(value) for name, value in chosen.table()},
        "without": {str(i): _number(value) for i, value in chosen.without.items()},
        "instead": {str(i): _number(value) for i, value in chosen.instead.items()},
        "given_up": [
            {"ids": list(ids), "position_deviation": _number(value), "distance": distance, "locus": name}
            for ids, value, distance, name in chosen.dropped
        ],
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _save_figure(chosen: LineSelection, file: Path) -> Path:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.add_subplot()
    rows = [
        *chosen.table(),
        *((f"without line {i}", value) for i, value in chosen.without.items()),
    ]
    shown = [(name, 1000.0 * value) for name, value in rows if np.isfinite(value)]
    colors = ["tab:green", *["tab:blue"] * (len(chosen.table()) - 1), *["tab:orange"] * len(rows)]
    bars = axes.barh([name for name, _ in shown], [value for _, value in shown], color=colors[: len(shown)])
    axes.bar_label(bars, fmt=" %.3g")
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.margins(x=0.15)
    axes.set_xlabel("standard deviation of the position, worst direction, worst pose [mm]")
    axes.set_title(f"lines {', '.join(map(str, chosen.ids))}")
    figure.savefig(file, dpi=110)
    return file
