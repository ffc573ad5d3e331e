# SPDX-License-Identifier: Apache-2.0
"""What tools/environment.py says on a machine that lacks something, and when it does a step again."""

import ast
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from messages import mentions

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "tools" / "environment.py"
COMPILERS = ("cc", "c++", "cmake", "make")


@pytest.fixture
def tree(tmp_path):
    """A copy of what the setup reads, so that nothing here touches the environment the tests run in."""
    for name in ("tools", "requirements", "msg_defs", "resource", "config"):
        shutil.copytree(ROOT / name, tmp_path / "tree" / name)
    for name in ("package.xml", "setup.py", "setup.cfg"):
        shutil.copy(ROOT / name, tmp_path / "tree")
    shutil.copytree(ROOT / "plsing_ros" / "_core", tmp_path / "tree" / "plsing_ros" / "_core")
    return tmp_path / "tree"


@pytest.fixture
def environment(tree):
    """The script in the copied tree, as a module."""
    specification = importlib.util.spec_from_file_location("environment_under_test", tree / "tools" / "environment.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture
def machine(tmp_path):
    """A folder to be the whole PATH of a machine that has everything the setup asks for."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in COMPILERS:
        (folder / name).write_text("#!/bin/sh\n")
        (folder / name).chmod(0o755)
    return folder


@pytest.fixture
def setup(environment, machine, monkeypatch, capsys):
    """Run the setup on that machine, with no ROS; return the exit code and the error text."""

    def run(*options, **variables):
        for name in set(os.environ) - {"HOME"}:
            monkeypatch.delenv(name)
        for name, value in {"PATH": str(machine), **variables}.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(environment, "importable", lambda *_: True)  # slow, and has tests of its own
        monkeypatch.setattr(sys, "argv", ["environment.py", *options, "setup"])
        return environment.main(), capsys.readouterr().err

    return run


def setup_elsewhere(tree, before):
    """Run the setup as a program whose interpreter believes to be on another machine, after a line of Python."""
    script = str(tree / "tools" / "environment.py")
    lines = [
        "import runpy, sys",
        before,
        "sys.argv = ['', 'setup']",
        f"runpy.run_path({script!r}, run_name='__main__')",
    ]
    # Isolated: the interpreter of the test's own environment would start in that environment.
    command = [sys._base_executable, "-I", "-c", "\n".join(lines)]
    environment = {name: value for name, value in os.environ.items() if name != "ROS_DISTRO"}
    done = subprocess.run(command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    return done.returncode, done.stderr


def assert_one_sentence(result, *words):
    code, error = result
    assert code == 1
    assert "Traceback" not in error
    assert error.startswith("setup: ")
    assert error.count("\n") == 1
    for word in words:
        assert word in error


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("cc", ["C compiler", "sudo apt install gcc"]),
        ("c++", ["C++ compiler", "sudo apt install g++"]),
        ("cmake", ["cmake", "sudo apt install cmake"]),
        ("make", ["make", "sudo apt install make"]),
    ],
)
def test_missing_command_is_named_with_its_package(setup, machine, command, words):
    (machine / command).unlink()
    assert_one_sentence(setup(), *words)


def test_compiler_named_by_variable_must_exist(setup):
    assert_one_sentence(setup(CXX="nonesuch-c++ -O2"), "nonesuch-c++")


@pytest.mark.parametrize("version", ["(3, 6, 9)", "(3, 9, 18)", "(3, 14, 0)"])
def test_python_without_wheels_is_refused(tree, version):
    result = setup_elsewhere(tree, f"sys.version_info = {version}")
    assert_one_sentence(result, "3.10 to 3.13", "make PYTHON=python3.12", "sudo apt install python3.12")


def test_script_parses_on_pythons_too_old_to_run_it():
    ast.parse(SCRIPT.read_text(), feature_version=(3, 6))


@pytest.mark.parametrize(
    "before",
    [
        "import platform; platform.machine = lambda: 'aarch64'",
        "sys.platform = 'darwin'",
    ],
)
def test_machine_without_wheels_is_sent_to_ros(tree, before):
    assert_one_sentence(setup_elsewhere(tree, before), "x86-64 Linux", "install ROS 2 Jazzy")


def test_path_with_a_space_is_refused(environment, setup, monkeypatch):
    monkeypatch.setattr(environment, "ROOT", Path("/home/someone/my projects"))
    assert_one_sentence(setup(), "/home/someone/my projects", "space", "move this folder")


def test_missing_venv_module_is_named_with_its_package(environment, monkeypatch):
    monkeypatch.setattr(environment, "importable", lambda *_: False)
    with pytest.raises(environment.SetupError, match=r"python3\.\d+-venv"):
        environment.check_wheels_usable()


def test_absent_module_is_not_importable(environment):
    assert environment.importable("venv", "ensurepip")
    assert not environment.importable("venv", "nonesuch")


def test_missing_python_headers_are_named_with_their_package(environment, monkeypatch, tmp_path):
    monkeypatch.setattr(environment.sysconfig, "get_paths", lambda: {"include": str(tmp_path)})
    with pytest.raises(environment.SetupError, match=r"python3\.\d+-dev"):
        environment.check_wheels_usable()


@pytest.mark.skipif(importlib.util.find_spec("pip") is None, reason="this Python has no pip")
def test_unreachable_index_is_said_in_one_sentence(recorded, monkeypatch):
    found = recorded()
    found.python = sys.executable
    found.variables.update(PIP_CONFIG_FILE=os.devnull, PIP_INDEX_URL="http://127.0.0.1:9/simple")
    monkeypatch.setattr(found, "install_packages", lambda: found.pip_install("nonesuch==1.0"))
    with pytest.raises(Exception, match=r"^[^\n]*package index[^\n]*$"):
        found.make_ready()


def test_another_ros_is_refused(setup):
    assert_one_sentence(setup(ROS_DISTRO="humble"), "humble", "source /opt/ros/jazzy/setup.bash")


def test_half_sourced_ros_is_refused(setup):
    assert_one_sentence(setup(ROS_DISTRO="jazzy"), "AMENT_PREFIX_PATH", "setup.bash")


def test_sourced_ros_without_colcon_is_refused(setup):
    result = setup(ROS_DISTRO="jazzy", AMENT_PREFIX_PATH="/opt/ros/jazzy")
    assert_one_sentence(result, "sudo apt install python3-colcon-common-extensions")


@pytest.mark.skipif(sys.version_info[:2] == (3, 12), reason="this is the Python that noble has")
def test_noble_needs_its_python(setup):
    assert_one_sentence(setup("--noble"), "python3.12", "NOBLE_PYTHON=")


@pytest.mark.parametrize("target", ["setup", "test-noble"])
def test_python_that_does_not_run_is_named(tree, target):
    shutil.copy(ROOT / "Makefile", tree)
    command = ["make", target, "PYTHON=nonesuch", "NOBLE_PYTHON=nonesuch"]
    done = subprocess.run(command, cwd=tree, capture_output=True, text=True)
    assert done.returncode != 0
    assert mentions(done.stderr, "nonesuch")


# -- which steps are carried out --------------------------------------------------------------------------------------


@pytest.fixture
def recorded(environment, monkeypatch):
    """A wheel environment whose steps only record that they ran; call it for a new one, as in a new process."""

    def new():
        found = environment.WheelEnvironment(environment.ROOT / ".venv", "python.txt")
        found.prefix.mkdir(exist_ok=True)
        found.ran = []
        for step in ALL_STEPS:
            monkeypatch.setattr(found, step, lambda step=step: found.ran.append(step))
        return found

    return new


def steps_run(found):
    found.make_ready()
    return found.ran


ALL_STEPS = ["install_packages", "build_tf2_msgs", "build_messages", "install_plsing_ros"]


def test_second_setup_does_nothing(recorded):
    assert steps_run(recorded()) == ALL_STEPS
    assert steps_run(recorded()) == []


@pytest.mark.parametrize(
    ("file", "steps"),
    [
        ("requirements/python.txt", ALL_STEPS),
        ("requirements/constraints.txt", ALL_STEPS),
        ("requirements/noble.txt", []),
        ("tools/tf2_msgs/msg/TFMessage.msg", ALL_STEPS[1:]),
        ("msg_defs/msg/LocusDistance.msg", ALL_STEPS[2:]),
        ("setup.py", ALL_STEPS[3:]),
    ],
)
def test_changed_input_repeats_its_step_and_those_after_it(recorded, tree, file, steps):
    recorded().make_ready()
    with (tree / file).open("a") as stream:
        stream.write("\n# changed\n")
    assert steps_run(recorded()) == steps


def test_new_config_file_is_installed_and_an_edited_one_is_linked_already(recorded, tree):
    (tree / "config" / "one.yaml").write_text("a: 1\n")
    recorded().make_ready()
    (tree / "config" / "one.yaml").write_text("a: 2\n")
    assert steps_run(recorded()) == []
    (tree / "config" / "two.yaml").write_text("a: 1\n")
    assert steps_run(recorded()) == ["install_plsing_ros"]


def test_interrupted_step_is_repeated(recorded, monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    found = recorded()
    monkeypatch.setattr(found, "build_messages", interrupted)
    with pytest.raises(KeyboardInterrupt):
        found.make_ready()
    assert steps_run(recorded()) == ["build_messages", "install_plsing_ros"]


def test_failed_command_shows_its_last_words_and_the_log(recorded, monkeypatch):
    found = recorded()
    script = "import sys; print('what went wrong'); sys.exit(3)"
    monkeypatch.setattr(found, "build_messages", lambda: found.call(sys.executable, "-c", script))
    with pytest.raises(Exception, match=r"(?s)failed.*build/\.venv\.log.*what went wrong"):
        found.make_ready()
    assert steps_run(recorded()) == ["build_messages", "install_plsing_ros"]


def test_environments_of_chosen_pythons_are_kept_apart(environment, monkeypatch):
    monkeypatch.delenv("PYTHON", raising=False)
    assert environment.venv_name() == ".venv"
    monkeypatch.setenv("PYTHON", "/usr/bin/python3")
    assert environment.venv_name() == ".venv"
    monkeypatch.setenv("PYTHON", "/usr/bin/python3.12")
    assert environment.venv_name() == ".venv-{}.{}".format(*sys.version_info[:2])
