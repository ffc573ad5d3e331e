# SPDX-License-Identifier: Apache-2.0
"""Parameters for nodes that are not there are refused; those for our other nodes are left alone."""

import pytest

from plsing_ros.errors import ParameterError
from plsing_ros.nodes.overrides import check_overrides, matches


@pytest.mark.parametrize(
    ("section", "name", "match"),
    [
        ("controller", "/controller", True),
        ("/controller", "/controller", True),
        ("controller", "/robot/controller", False),
        ("/robot/controller", "/robot/controller", True),
        ("/**/controller", "/controller", True),
        ("/**/controller", "/a/b/controller", True),
        ("/**", "/a/controller", True),
        ("/*/controller", "/a/controller", True),
        ("/*/controller", "/a/b/controller", False),
        ("/controler", "/controller", False),
    ],
)
def test_sections_match_as_ros_matches_them(section, name, match):
    assert matches(section, name) is match


@pytest.mark.parametrize("option", ["-p", "--param"])
def test_an_override_for_no_node_of_the_process_is_refused_with_the_nearest_name(option):
    arguments = ["--ros-args", option, "controller:max_linear_speed:=0.2"]
    check_overrides(arguments, ["/controller"])
    with pytest.raises(ParameterError, match="'robot/controller'"):
        check_overrides(arguments, ["/robot/controller", "/robot/pose_estimator"])
    check_overrides(["--ros-args", option, "gain:=0.5"], ["/robot/controller"])
    check_overrides(arguments[1:], ["/robot/controller"])  # not ROS's


def test_a_parameter_file_for_another_namespace_or_misspelt_is_refused(tmp_path):
    def check(section, *names):
        path = tmp_path / "parameters.yaml"
        path.write_text(f"{section}:\n  ros__parameters:\n    gain: 0.5\n")
        check_overrides(["--ros-args", "--params-file", str(path)], names)

    check("/**/controller", "/robot/controller")
    check("/controller", "/controller")
    check("singularity_monitor", "/controller")
    check("someone_elses", "/controller")
    check("/controller", "/controller", "/pose_estimator")
    with pytest.raises(ParameterError, match=r"/robot/controller\b.* /controller\b"):
        check("/controller", "/robot/controller")
    with pytest.raises(ParameterError, match=r" /controler\b"):
        check("/controler", "/controller")


def test_nested_namespaces_and_broken_files_are_left_to_ros(tmp_path):
    path = tmp_path / "parameters.yaml"
    arguments = ["--ros-args", "--params-file", str(path)]
    path.write_text("robot:\n  controller:\n    ros__parameters:\n      gain: 0.5\n")
    check_overrides(arguments, ["/robot/controller"])
    with pytest.raises(ParameterError):
        check_overrides(arguments, ["/controller"])
    for content in ("", "[1, 2", "- 3"):
        path.write_text(content)
        check_overrides(arguments, ["/controller"])
