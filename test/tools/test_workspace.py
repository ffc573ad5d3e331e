# SPDX-License-Identifier: Apache-2.0
"""A workspace in a temporary folder, by the README's commands: built, sourced, run, and its tests run and counted.

Three things differ from what a user does: the files of this folder stand in for a clone, rosdep is left out
(docs/results/ros.md), and object files of the native core that are newer than their sources are taken along, for it
takes two minutes to compile.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from catkin_pkg.packages import find_packages

from plsing_ros.testing.harness import Harness

ROOT = Path(__file__).resolve().parents[2]
# Seconds after which something has gone wrong.
PATIENCE = 120.0
# What each node of the README says once they all work together.
DONE = {
    "feature_simulator": "the camera moves",
    "singularity_monitor": "inverse condition number",
    "controller": "SERVOING",
}
# For a machine without the ros2 command: the same lookups in the same places.
ROS2 = """
command -v ros2 > /dev/null || ros2() {
    case "$1 $2" in
        "run plsing_ros") shift 2; exec "${AMENT_PREFIX_PATH%%:*}/lib/plsing_ros/$@";;
        "pkg prefix") echo "${AMENT_PREFIX_PATH%%:*}/share/$4";;
        *) echo "not known here: ros2 $*" >&2; return 1;;
    esac
}
"""


def readme_commands():
    """The commands of the README's section for ROS, line by line, of which some run until they are stopped."""
    section = (ROOT / "README.md").read_text().split("## Use it from ROS")[1].split("Without a ROS")[0]
    return re.findall(r"^    (\S.*)$", section, re.MULTILINE)


def copy_of_the_sources(folder):
    """What a clone would hold, with the files' times."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in listed.stdout.split("\n"):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def take_object_files(build):
    """Hand on the newest object file of each source; those older than it are compiled anew."""
    for file in sorted(ROOT.glob("build/**/plsing_ros/_core/*.o"), key=lambda each: each.stat().st_mtime):
        (temporary,) = (each for each in file.parents if each.name.startswith("temp."))
        target = build / "plsing_ros" / "build" / temporary.name / "plsing_ros" / "_core" / file.name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(file, target)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """The folder ws, built by the README, and what runs commands in it."""
    folder = tmp_path_factory.mktemp("home")
    environment = {**os.environ, "COLCON_LOG_PATH": str(folder / "log")}
    environment.pop("PYTHONPATH", None)
    if "ROS_DISTRO" not in os.environ:
        environment |= {
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "VIRTUAL_ENV": sys.prefix,
            "AMENT_PREFIX_PATH": sys.prefix,
            "CMAKE_PREFIX_PATH": sys.prefix,
        }

    def run(*commands, cwd=folder):
        script = "\n".join(["set -e", *commands])
        done = subprocess.run(["bash", "-c", script], cwd=cwd, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return done.stdout

    commands = readme_commands()
    build = next(number for number, each in enumerate(commands) if each.startswith("colcon build"))
    clone = next(number for number, each in enumerate(commands) if each.startswith("git clone"))
    run(*commands[:clone])
    copy_of_the_sources(folder / "ws" / "src" / "plsing_ros")
    take_object_files(folder / "ws" / "build")
    rest = [each for each in commands[clone + 1 : build + 1] if not each.startswith("rosdep")]
    run("cd ws/src", *rest, 'test "${AMENT_PREFIX_PATH%%:*}" = "$PWD/install/plsing_ros"')
    run.environment = environment
    return folder / "ws", run


def test_each_way_that_is_documented_finds_both_packages(workspace):
    ws, run = workspace
    linked = run("colcon list --names-only", cwd=ws)
    assert linked.split() == ["plsing_msgs", "plsing_ros"]
    assert {each.name for each in find_packages(str(ws / "src")).values()} == {"plsing_msgs", "plsing_ros"}  # rosdep's
    quickstart = (ROOT / "docs" / "howto" / "quickstart.md").read_text()
    base_paths = re.search(r"colcon build (--base-paths [^`]+)`", quickstart)[1]
    assert run(f"colcon list --names-only {base_paths}", cwd=ws / "src" / "plsing_ros").split() == linked.split()


def test_the_nodes_run_by_the_commands_of_the_readme(workspace, tmp_path):
    ws, run = workspace
    commands = readme_commands()
    first = next(number for number, each in enumerate(commands) if each.startswith("share="))
    (share, *programs) = commands[first:]
    names = [shlex.split(each)[3] for each in programs]
    assert names == list(DONE)
    with Harness() as ros:
        environment = {**run.environment, "ROS_DOMAIN_ID": ros.environment()["ROS_DOMAIN_ID"]}
        processes = []
        try:
            for name, command in zip(names, programs, strict=True):
                script = "\n".join(["source install/setup.bash", ROS2, share, command])
                with (tmp_path / name).open("w") as log:
                    processes.append(
                        subprocess.Popen(["bash", "-c", script], cwd=ws, env=environment, stdout=log, stderr=log)
                    )
            until = time.monotonic() + PATIENCE
            # The camera moves by the controller's twists, and the monitor watches it.
            while not all(word in (tmp_path / name).read_text() for name, word in DONE.items()):
                assert time.monotonic() < until and all(each.poll() is None for each in processes), {
                    name: (tmp_path / name).read_text() for name in names
                }
                time.sleep(0.2)
            maps = Path(f"/proc/{processes[-1].pid}/maps").read_text()
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
        assert [each.wait(PATIENCE) for each in processes] == [0, 0, 0]
    # What runs is the workspace's, native core and messages included.
    loaded = {Path(each) for each in re.findall(r"/\S*plsing\S*\.so", maps)}
    assert loaded and all(each.is_relative_to(ws) for each in loaded), loaded


def test_colcon_test_runs_the_tests_and_counts_them(workspace):
    ws, run = workspace
    selected = "test/test_arrays.py test/features/test_interaction.py"
    run("source install/setup.bash", f"colcon test --return-code-on-test-failure --pytest-args {selected}", cwd=ws)
    counted = re.search(r"Summary: (\d+) tests, 0 errors, 0 failures, 0 skipped", run("colcon test-result", cwd=ws))
    alone = [sys.executable, "-m", "pytest", "--collect-only", "-q", *selected.split()]
    collected = subprocess.run(alone, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert int(counted[1]) == int(re.search(r"(\d+) tests collected", collected)[1]) > 10


def test_colcon_test_says_when_a_test_fails(workspace):
    ws, run = workspace
    failing = ws / "src" / "plsing_ros" / "test" / "test_that_fails.py"
    failing.write_text("def test_it():\n    assert False\n")
    said = run(
        "source install/setup.bash",
        f"if colcon test --return-code-on-test-failure --pytest-args {failing}; then exit 1; fi",
        "if colcon test-result; then exit 1; fi; true",
        cwd=ws,
    )
    assert "1 test, 0 errors, 1 failure" in said
