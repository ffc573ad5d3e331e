# SPDX-License-Identifier: Apache-2.0
"""Launch files, read as they are: launch is not among the wheels. docs/results/ros.md tells how they were run."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import plsing_ros.parameters.config_files

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "launch").glob("*.launch.py"))
SHARED = ROOT / "plsing_ros" / "nodes" / "launch_description.py"


def calls(tree, name):
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name]


def console_scripts():
    """The names of the executables in setup.py, which `ros2 run` and launch look for."""
    texts = [
        each.value for each in ast.walk(ast.parse((ROOT / "setup.py").read_text())) if isinstance(each, ast.Constant)
    ]
    return {each.split(" = ")[0] for each in texts if isinstance(each, str) and " = plsing_ros." in each}


def described(file):
    """The executables and remappings that a launch file asks for, and the names that its remappings speak of."""
    function = next(each for each in ast.parse(file.read_text()).body if isinstance(each, ast.FunctionDef))
    assert function.name == "generate_launch_description" and not function.args.args
    (call,) = calls(function, "describe_nodes")
    remappings = next(each.value for each in call.keywords if each.arg == "remappings")
    return [each.value for each in call.args], [each.value for each in remappings.keys]


def test_there_is_one_for_each_use():
    names = ["arm_simulator", "image_lines", "line_tracker", "servo", "simulator"]
    assert [each.name for each in FILES] == [f"{name}.launch.py" for name in names]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_it_starts_executables_that_there_are_and_remaps_its_own(file):
    names, remapped = described(file)
    assert names and set(names) <= console_scripts()
    assert set(remapped) <= set(names)


def test_arguments_and_names_of_launch_that_are_used_are_those_of_its_sources():
    tree = ast.parse(SHARED.read_text())
    arguments = [getattr(each.args[0], "value", "") for each in calls(tree, "DeclareLaunchArgument")]
    assert arguments == ["params_file", "namespace", "use_sim_time", "autostart", "container", ""]
    # launch 3.4 and launch_ros 0.26: the keyword arguments of launch_ros.actions.Node and of DeclareLaunchArgument.
    of_node = {"executable", "package", "name", "namespace", "parameters", "remappings", "ros_arguments", "arguments"}
    for call in calls(tree, "Node"):
        assert {each.arg for each in call.keywords if each.arg} <= of_node | {"condition", "output"}
    for call in calls(tree, "DeclareLaunchArgument"):
        assert {each.arg for each in call.keywords} <= {"default_value", "description", "choices"}


def test_they_and_what_help_texts_refer_to_are_installed():
    """What setup.py hands to setuptools, which puts it into share/plsing_ros."""
    # In a process of its own: setuptools refuses to be imported after what others import of distutils.
    script = (
        "import json, setuptools; setuptools.setup = lambda **options: print(json.dumps(options['data_files'])); "
        "exec(open('setup.py').read())"
    )
    handed = json.loads(subprocess.check_output([sys.executable, "-c", script], cwd=ROOT, text=True))
    installed = {f"{folder}/{Path(file).name}" for folder, files in handed for file in files}
    wanted = [
        "package.xml",
        "config/paper_p4l.yaml",
        "config/small_object.yaml",
        "config/rviz/singularity.rviz",
        "config/foxglove/singularity.json",
        "config/security/plsing_ros.policy.xml",
        "docs/controller.md",
        "docs/howto/security.md",
        *(f"launch/{file.name}" for file in FILES),
    ]
    assert {f"share/plsing_ros/{each}" for each in wanted} <= installed
    assert plsing_ros.parameters.config_files.config_file("small_object.yaml").is_file()
