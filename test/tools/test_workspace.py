"""A workspace in a temporary folder, built by the README's commands; colcon runs its tests, and a program starts."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def readme_commands():
    """The commands of the first block of the README's section for ROS."""
    section = (ROOT / "README.md").read_text().split("## Use it from ROS")[1]
    (block,) = re.findall(r"\n\n((?:    (?!share=).+\n)+)", section)[:1]
    return [line.strip() for line in block.splitlines()]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """The built workspace, and what runs a command in it."""
    folder = tmp_path_factory.mktemp("home")
    defaults = folder / "defaults.yaml"
    # What a ROS from Debian packages does not need, and only a few tests, so that it is quick. JSON is YAML.
    arguments = [f"-DPython3_EXECUTABLE={sys.executable}", "-DBUILD_TESTING=OFF"]
    build, test = {"cmake-args": arguments}, {"pytest-args": ["test/test_arrays.py"], "packages-select": ["plsing_ros"]}
    defaults.write_text(json.dumps({"build": build, "test": test}))
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "COLCON_DEFAULTS_FILE": str(defaults),
        "COLCON_LOG_PATH": str(folder / "log"),
    }
    if "ROS_DISTRO" not in os.environ:
        environment |= {"AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}
    environment.pop("PYTHONPATH", None)

    def run(*commands):
        script = "\n".join(["set -e", *commands])
        done = subprocess.run(["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return done.stdout

    commands = readme_commands()
    assert sum(each.startswith("git clone") for each in commands) == 1
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    clone = folder / "ws" / "src" / "plsing_ros"
    for name in filter(None, files):
        (clone / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, clone / name)
    # In the place of a clone there is a copy, rosdep needs its index, and without colcon-bash there is setup.sh only.
    run(*(each for each in commands if not each.startswith(("git clone", "rosdep")) and "colcon" not in each))
    run("cd ws", *(each.split(" && ")[0] for each in commands if each.startswith("colcon")))
    return folder, run


def test_both_packages_are_built_and_the_installed_node_starts(workspace):
    folder, run = workspace
    assert {"plsing_msgs", "plsing_ros"} <= {each.name for each in (folder / "ws" / "install").iterdir()}
    share = folder / "ws" / "install" / "plsing_ros" / "share" / "plsing_ros"
    for name in (
        "config/paper_p4l.yaml",
        "config/rviz/singularity.rviz",
        "launch/servo.launch.py",
        "docs/controller.md",
    ):
        assert (share / name).is_file(), name
    said = run(
        ". ws/install/setup.sh",
        "ws/install/plsing_ros/lib/plsing_ros/analyze ws/install/plsing_ros/share/plsing_ros/config/paper_p4l.yaml",
        "cd / && python3 -c 'import plsing_ros, plsing_msgs.msg; print(plsing_ros.__file__, plsing_msgs.__file__)'",
    )
    assert "transversal 1" in said
    assert str(folder / "ws" / "install" / "plsing_ros") in said.splitlines()[-1]
    assert str(folder / "ws" / "install" / "plsing_msgs") in said.splitlines()[-1]


def test_colcon_test_runs_the_tests_and_counts_them(workspace):
    _, run = workspace
    said = run("cd ws", "colcon test --return-code-on-test-failure", "colcon test-result --all")
    count = int(re.search(r"Summary: (\d+) tests?, 0 errors, 0 failures", said)[1])
    assert count >= 10
