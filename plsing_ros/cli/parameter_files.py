# SPDX-License-Identifier: Apache-2.0
"""Command that writes config/<node>.yaml from the parameter specifications."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plsing_ros.cli.command import run_command
from plsing_ros.parameters import (
    ControllerParameters,
    MonitorParameters,
    ParameterSet,
    PoseEstimatorParameters,
    SimulatorParameters,
    Specification,
)
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.parameters.line_tracker import LineTrackerParameters
from plsing_ros.parameters.node import AUTOSTART, AUTOSTART_DEFAULT

NODES: dict[str, type[ParameterSet]] = {
    "feature_simulator": SimulatorParameters,
    "controller": ControllerParameters,
    "singularity_monitor": MonitorParameters,
    "pose_estimator": PoseEstimatorParameters,
    "line_tracker": LineTrackerParameters,
    "arm_simulator": ArmSimulatorParameters,
}


def parameter_file(node: str) -> str:
    """Return a ROS parameter file with every parameter of a node at its default, its meaning, unit and range."""
    lines = [
        f"# Every parameter of {node}, at its default. Give it before a scene's file, which has the last word:",
        "#   share=$(ros2 pkg prefix --share plsing_ros)",
        f"#   ros2 run plsing_ros {node} --ros-args \\",
        f"#     --params-file $share/config/{node}.yaml --params-file $share/config/paper_p4l.yaml",
        "# Made by python3 -m plsing_ros.cli.parameter_files from plsing_ros/parameters/.",
        "",
        f"/**/{node}:",
        "  ros__parameters:",
    ]
    for specification, default in node_parameters(node):
        comment = f"{specification.description}{_unit(specification)}. {_details(specification)}".strip()
        lines += textwrap.wrap(comment, 112, initial_indent="    # ", subsequent_indent="    # ")
        lines.append(f"    {specification.name}: {yaml_text(default)}")
    return "\n".join(lines) + "\n"


def node_parameters(node: str) -> list[tuple[Specification, Any]]:
    """Return what is known of each parameter of a node, and its default."""
    of_set = [(specification, field.default) for field, specification in NODES[node].specifications().values()]
    return [(AUTOSTART, AUTOSTART_DEFAULT), *of_set]


def generated_files() -> dict[str, str]:
    """Return the generated files' contents by path relative to the source tree."""
    return {f"config/{node}.yaml": parameter_file(node) for node in NODES}


def main(argv: Sequence[str] | None = None) -> int:
    """Write the files; return the exit code."""
    parser = argparse.ArgumentParser(
        description="Write config/<node>.yaml from plsing_ros/parameters/.",
        epilog="example: python3 -m plsing_ros.cli.parameter_files",
    )
    parser.add_argument("--root", type=Path, default=Path(), help="source tree (default: the current folder)")
    options = parser.parse_args(argv)
    return run_command("parameter_files", lambda: _run(options.root))


def _run(root: Path) -> int:
    for name, content in generated_files().items():
        (root / name).write_text(content, encoding="utf-8")
        print(f"wrote {root / name}")
    return 0


def _unit(specification: Specification) -> str:
    return f" [{specification.unit}]" if specification.unit else ""


def _details(specification: Specification) -> str:
    details = f"Allowed: {specification.range_text}. " if specification.range_text else ""
    return details + ("" if specification.live else "Fixed at the start.")


def yaml_text(value: Any) -> str:
    """Return a parameter's value as YAML that ROS and other readers take alike."""
    if isinstance(value, tuple):
        return "[" + ", ".join(map(yaml_text, value)) + "]"
    if isinstance(value, float):
        text = repr(value)
        # "1e-12" is a float to ROS and a string to YAML readers that follow YAML 1.1.
        return text if "." in text else text.replace("e", ".0e")
    if value == "":
        return '""'
    return str(value).lower() if isinstance(value, bool) else str(value)


if __name__ == "__main__":
    raise SystemExit(main())
