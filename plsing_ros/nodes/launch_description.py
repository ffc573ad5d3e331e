# SPDX-License-Identifier: Apache-2.0
"""What the launch files in launch/ share: arguments, one process for each node or one for all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from plsing_ros.parameters.config_files import config_file

_SWITCH = ["true", "false"]
# Where a node listens that takes the estimated 3-D lines.
COMPLETED = {"line_features": "completed_line_features"}


def describe_nodes(
    *names: str,
    remappings: Mapping[str, Mapping[str, str]],
    topics: Mapping[str, tuple[str, ...]] | None = None,
    scene: str = "paper_p4l.yaml",
) -> LaunchDescription:
    """Return a description that starts nodes.

    Args:
        names: Executables, which are the nodes' names as well.
        remappings: For a node new names of topics by their old ones.
        topics: For a node those of its topics whose names are arguments of the launch file.
        scene: Parameter file of config/ that is used if none is given.
    """
    topics = topics or {}
    arguments = [
        DeclareLaunchArgument(
            "params_file",
            default_value=str(config_file(scene)),
            description="Parameter file with the scene and the target",
        ),
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes"),
        DeclareLaunchArgument(
            "use_sim_time", default_value="false", choices=_SWITCH, description="Whether the time is that of /clock"
        ),
        DeclareLaunchArgument(
            "autostart",
            default_value="true",
            choices=_SWITCH,
            description="Whether the nodes activate themselves; false: a lifecycle manager does",
        ),
        DeclareLaunchArgument(
            "container", default_value="false", choices=_SWITCH, description="Whether one process runs all nodes"
        ),
        *(
            DeclareLaunchArgument(topic, default_value=topic, description=f"Topic that {name} takes for {topic}")
            for name, chosen in topics.items()
            for topic in chosen
        ),
    ]
    renamed: dict[str, dict[str, Any]] = {
        name: {**remappings.get(name, {}), **{topic: LaunchConfiguration(topic) for topic in topics.get(name, ())}}
        for name in names
    }
    switches = {
        name: ParameterValue(LaunchConfiguration(name), value_type=bool) for name in ("use_sim_time", "autostart")
    }
    common = {
        "package": "plsing_ros",
        "namespace": LaunchConfiguration("namespace"),
        "parameters": [LaunchConfiguration("params_file"), switches],
        "output": "screen",
    }
    alone = [
        Node(
            executable=name,
            name=name,
            remappings=list(renamed[name].items()),
            condition=UnlessCondition(LaunchConfiguration("container")),
            **common,
        )
        for name in names
    ]
    rules = [[f"{name}:{old}:=", new] for name in names for old, new in renamed[name].items()]
    together = Node(
        executable="container",
        arguments=list(names),
        ros_arguments=[word for rule in rules for word in ("-r", rule)],
        condition=IfCondition(LaunchConfiguration("container")),
        **common,
    )
    return LaunchDescription([*arguments, *alone, together])
