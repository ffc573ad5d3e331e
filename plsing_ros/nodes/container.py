# SPDX-License-Identifier: Apache-2.0
"""Executable container: several of the nodes in one process, where a message takes the shortest way."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from plsing_ros.errors import ParameterError
from plsing_ros.nodes.arm_simulator import ArmSimulatorNode
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.line_tracker import LineTrackerNode
from plsing_ros.nodes.main import Create, node_parser, run_nodes
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode

NODES: dict[str, Create] = {
    "arm_simulator": ArmSimulatorNode,
    "controller": ControllerNode,
    "feature_simulator": FeatureSimulatorNode,
    "line_tracker": LineTrackerNode,
    "pose_estimator": PoseEstimatorNode,
    "singularity_monitor": SingularityMonitorNode,
}

_EXAMPLES = """examples:
  share=$(ros2 pkg prefix --share plsing_ros)
  ros2 run plsing_ros container feature_simulator controller --ros-args --params-file $share/config/paper_p4l.yaml
  ros2 run plsing_ros container pose_estimator controller --ros-args --params-file $share/config/paper_p4l.yaml \\
    -r controller:line_features:=completed_line_features -p controller:gain:=0.5

The nodes share one thread: put those together that wait for each other anyway, and the singularity_monitor, which
nobody waits for, in a process of its own. On the command line, -p NODE:NAME:=VALUE sets a parameter of one node.
docs/results/performance.md says what it gains."""


def main() -> int:
    """Run the nodes."""
    parser = node_parser(__doc__.split("\n")[0], _EXAMPLES)
    parser.add_argument("nodes", nargs="+", choices=sorted(NODES), metavar="node", help=", ".join(sorted(NODES)))
    return run_nodes(_chosen, parser)


def _chosen(options: argparse.Namespace) -> Sequence[Create]:
    twice = {name for name in options.nodes if options.nodes.count(name) > 1}
    if twice:
        raise ParameterError(f"node '{min(twice)}' is given more than once; each can run once in a process")
    return [NODES[name] for name in options.nodes]


if __name__ == "__main__":
    sys.exit(main())
