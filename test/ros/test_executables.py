# SPDX-License-Identifier: Apache-2.0
"""The executables as processes, as `ros2 run` starts them: with parameter files, signals and exit codes."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from builders import twist_values
from geometry_msgs.msg import TwistStamped
from lifecycle_msgs.srv import ChangeState, GetState
from messages import mentions

from plsing_msgs.msg import ControllerState, LineFeatureArray, SingularityAlert, SingularityStatus
from plsing_ros.nodes import qos
from plsing_ros.parameters.config_files import config_file
from plsing_ros.testing.harness import Harness

NODES = ["feature_simulator", "controller", "pose_estimator", "singularity_monitor"]
PAPER = ["--ros-args", "--params-file", str(config_file("paper_p4l.yaml"))]


def executable(name):
    """Where `ros2 run plsing_ros <name>` finds it: lib/plsing_ros of a prefix."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    found = [Path(prefix) / "lib" / "plsing_ros" / name for prefix in prefixes if prefix]
    existing = [path for path in found if path.is_file()]
    assert existing, f"{name} is in none of {found}"
    return existing[0]


@pytest.fixture
def ros():
    with Harness() as harness:
        yield harness


@pytest.fixture
def start(ros, tmp_path):
    """Start executables in the harness's domain; end them, however the test ends."""
    processes = []

    def start_process(name, *arguments):
        stderr = (tmp_path / f"{name}_{len(processes)}.log").open("w+")
        process = subprocess.Popen(
            [executable(name), *arguments], env=ros.environment(), stdout=stderr, stderr=subprocess.STDOUT, text=True
        )
        process.log = stderr
        processes.append(process)
        return process

    yield start_process
    for process in processes:
        process.terminate()
    try:
        for process in processes:
            process.wait(30.0)
    finally:
        # Only if one did not end, which is a fault: a killed one may leave broken shared memory behind.
        for process in processes:
            process.kill()
            process.log.close()


def output_of(process):
    process.log.seek(0)
    return process.log.read()


def test_the_nodes_as_processes_talk_to_a_subscriber_in_another_process(ros, start):
    features = ros.collect(LineFeatureArray, "line_features")
    twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)
    statuses = ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
    alerts = ros.collect(SingularityAlert, "singularity_alerts", qos.LATCHED)
    processes = [start(name, *PAPER) for name in NODES]
    ros.spin_until(
        lambda: features
        and any(np.any(twist_values(each) != 0.0) for each in twists)
        and any(each.distances_valid for each in statuses)
        and alerts,
        "features, a twist, a status with distances and an alert",
        30.0,
    )
    moment = features[-1].moments
    ros.spin_until(lambda: list(features[-1].moments) != list(moment), "the camera to move")
    for process in processes:
        assert process.poll() is None, output_of(process)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_controller_with_a_zero_twist_and_exit_code_0(ros, start, number):
    twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)
    states = ros.collect(ControllerState, "controller/state", qos.STATUS)
    start("feature_simulator", *PAPER)
    controller = start("controller", *PAPER)
    ros.spin_until(lambda: states and states[-1].mode == ControllerState.MODE_SERVOING, "servoing", 30.0)
    controller.send_signal(number)
    ros.spin_until(lambda: controller.poll() is not None, "the end of the process")
    ros.spin_for(0.2)
    assert controller.returncode == 0, output_of(controller)
    assert "Traceback" not in output_of(controller)
    assert np.all(twist_values(twists[-1]) == 0.0)
    assert "shuts down" in states[-1].reason


def test_a_signal_while_the_node_is_made_ends_it_in_order(start):
    """Ended at once, it would leave broken shared memory behind."""
    program = """
import os, signal, sys
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.main import run_node

def create(**options):
    os.kill(os.getpid(), signal.SIGTERM)
    return ControllerNode(**options)

sys.exit(run_node(create, "", ""))
"""
    process = start(sys.executable, "-c", program, *PAPER)
    assert process.wait(30.0) == 0, output_of(process)
    assert "Traceback" not in output_of(process)


@pytest.mark.parametrize("executor", ["events", "single"])
def test_a_node_does_not_grow_with_the_callbacks_it_has_served(start, executor):
    program = """
import gc, os, signal, sys
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.main import run_node

objects = []

def serve():
    if len(objects) % 200 == 0:
        gc.collect()
    objects.append(len(gc.get_objects()))
    if len(objects) == 601:
        print("grown by", objects[600] - objects[200])
        os.kill(os.getpid(), signal.SIGTERM)

def create(**options):
    node = ControllerNode(**options)
    node.create_steady_timer(0.001, serve)
    return node

sys.exit(run_node(create, "", ""))
"""
    process = start(sys.executable, "-c", program, "--executor", executor, *PAPER)
    assert process.wait(30.0) == 0, output_of(process)
    grown = int(re.search(r"grown by (-?\d+)", output_of(process))[1])
    assert grown < 200, "objects after 400 callbacks"


def test_a_node_starts_though_another_was_killed_when_it_started(ros, start):
    """What the other left: a file of Fast DDS at the port of the domain's second participant, not ready for use."""
    port = Path("/dev/shm") / f"fastrtps_port{7400 + 250 * ros.domain + 11 + 2}"
    port.write_bytes(bytes([1]) + bytes(52399))
    states = ros.collect(ControllerState, "controller/state", qos.STATUS)
    controller = start("controller", *PAPER)
    ros.spin_until(lambda: states, "the controller", 30.0)
    assert mentions(output_of(controller), port, "half made")


def test_a_node_ends_with_a_sentence_where_it_would_wait_for_a_living_program(ros, start):
    port = Path("/dev/shm") / f"fastrtps_port{7400 + 250 * ros.domain + 11 + 2}"
    with port.open("w+b") as held:
        held.write(bytes([1]) + bytes(52399))
        held.flush()
        controller = start("controller", *PAPER)
        assert controller.wait(30.0) == 1, output_of(controller)
    port.unlink()
    output = output_of(controller)
    assert mentions(output, port, "half made", f"process {os.getpid()}")
    assert len(output.strip().splitlines()) == 1, output


def test_a_container_runs_a_closed_loop_in_one_process_and_ends_it_with_a_zero_twist(ros, start):
    twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)
    statuses = ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
    # In lockstep simulator and controller always have an answer to take, and must see the signal all the same.
    lockstep = [
        "feature_simulator:mode:=lockstep",
        "feature_simulator:publish_clock:=true",
        "controller:use_sim_time:=true",
        "singularity_monitor:use_sim_time:=true",
    ]
    lockstep = [each for parameter in lockstep for each in ("-p", parameter)]
    container = start("container", "feature_simulator", "controller", "singularity_monitor", *PAPER, *lockstep)
    ros.spin_until(
        lambda: any(np.any(twist_values(each) != 0.0) for each in twists)
        and any(each.target_valid for each in statuses),
        "a twist, and a status",
        30.0,
    )
    container.send_signal(signal.SIGTERM)
    ros.spin_until(lambda: container.poll() is not None, "the end of the process")
    ros.spin_until(lambda: np.all(twist_values(twists[-1]) == 0.0), "a zero twist")
    assert container.returncode == 0, output_of(container)
    assert "Traceback" not in output_of(container)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["controller", "feature_simulator", *PAPER, "-p", "feature_simulator:noise:=-1.0"],
            "parameter 'noise' is -1.0",
        ),
        (["controller", "singularity_monitor", *PAPER, "-p", "zero_twists:=5"], "unknown parameter 'zero_twists'"),
        (["controller", "controller", *PAPER], "node 'controller' is given more than once"),
        (["contoller", *PAPER], "invalid choice: 'contoller' (choose from"),
    ],
    ids=["of one node", "not of all nodes", "twice", "no such node"],
)
def test_a_container_refuses_bad_input_of_any_of_its_nodes(start, arguments, message):
    process = start("container", *arguments)
    assert process.wait(30.0) == 2, output_of(process)
    assert message in output_of(process)
    assert "Traceback" not in output_of(process)


@pytest.mark.parametrize("name", NODES)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (PAPER + ["-p", "gian:=1.0"], "unknown parameter 'gian'"),
        (PAPER + ["-p", "scene_frame:=1.0"], "parameter 'scene_frame' is 1.0; it must be a text"),
        ([], "no scene given; start the node with a parameter file"),
        (["--ros-args", "-p", "lines.points:=[]"], "no scene given; start the node with a parameter file"),
        (PAPER + ["-p", "scene_frame:=[]"], "parameter 'scene_frame' is given without a value, or as an empty list"),
        (PAPER + ["-p", "autostart:=5"], "autostart"),
        (["--ros-args", "--params-file", "/nowhere.yaml"], "/nowhere.yaml"),
        (["--ros-args", "-p", "nonsense"], "nonsense"),
    ],
    ids=["unknown", "wrong type", "no scene", "empty scene", "empty list", "autostart", "no file", "bad argument"],
)
def test_bad_input_is_one_line_and_exit_code_2(start, name, arguments, message):
    process = start(name, *arguments)
    assert process.wait(30.0) == 2, output_of(process)
    output = output_of(process)
    assert message in output
    assert "Traceback" not in output
    assert len(output.strip().splitlines()) == 1, output
    assert output.startswith(f"{name}: ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a [1]\n/**: {ros__parameters: {gain: *a}}", "has an alias, *a, in line 2"),
        ("[" * 3000, "is nested more than 20 deep"),
        (f"/**: {{ros__parameters: {{gain: {'7' * 400}}}}}", "has an integer of 1329 bits"),
    ],
    ids=["alias", "brackets", "long integer"],
)
def test_a_parameter_file_made_to_do_harm_is_refused_before_ros_reads_it(start, tmp_path, text, message):
    file = tmp_path / "harm.yaml"
    file.write_text(text)
    process = start("controller", *PAPER, "--params-file", str(file))
    assert process.wait(30.0) == 2, output_of(process)
    output = output_of(process)
    assert output.startswith("controller: ") and mentions(output, "parameter file", file) and message in output
    assert len(output.strip().splitlines()) == 1, output


def test_a_node_that_cannot_be_configured_is_one_line_and_exit_code_1(start):
    ids = [f"lines.{each}" for each in ("points", "directions", "ids")]
    values = ["[0, 0, 0, 0, 0, 2, 3, 5, 0]", "[1, 0, 0, 4, -5, 0, 3, 7, 3]", "[1, 2, 3]"]
    scene = [each for pair in zip(ids, values, strict=True) for each in ("-p", ":=".join(pair))]
    process = start("controller", *PAPER, *scene, "-p", "target.position:=[3, 0, 0]")
    assert process.wait(30.0) == 1, output_of(process)
    output = output_of(process)
    assert output.startswith("controller: ") and mentions(output, "2 usable")
    assert len(output.strip().splitlines()) == 1, output


def test_without_autostart_it_waits_for_its_transitions_and_ends_at_a_signal(ros, start):
    process = start("controller", *PAPER, "-p", "autostart:=false")
    for label, state in (("configure", "inactive"), ("activate", "active"), ("deactivate", "inactive")):
        request = ChangeState.Request()
        request.transition.label = label
        assert ros.call(ChangeState, "controller/change_state", request, 30.0).success
        assert ros.call(GetState, "controller/get_state", GetState.Request()).current_state.label == state
    process.send_signal(signal.SIGTERM)
    assert process.wait(30.0) == 0, output_of(process)


@pytest.mark.parametrize("name", [*NODES, "demo", "analyze", "evaluate", "replay", "select_lines", "survey"])
def test_help_has_examples_and_is_quick_to_tell(start, name):
    process = start(name, "--help")
    assert process.wait(30.0) == 0
    assert re.search(r"examples:\n  \S+", output_of(process))


@pytest.mark.parametrize("name", [*NODES, "line_tracker", "arm_simulator", "container"])
def test_a_module_of_a_node_runs_it_as_well(name):
    command = [sys.executable, "-m", f"plsing_ros.nodes.{name}", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=True)
    assert "examples:" in done.stdout


def test_the_command_line_has_the_last_word_over_parameter_files(start):
    """Only a value that is refused shows in the output which one was taken."""
    process = start("controller", *PAPER, "-p", "gain:=-1.0")
    assert process.wait(30.0) == 2, output_of(process)
    assert mentions(output_of(process), "'gain'", "-1.0 1/s", "1e-06", "1000 1/s")
    both = ["--ros-args", "--params-file", str(config_file("controller.yaml")), *PAPER[1:]]
    process = start("controller", *both, "-p", "gain:=-1.0")
    assert process.wait(30.0) == 2, output_of(process)


def test_an_unknown_option_names_itself(start):
    process = start("controller", "--fast")
    assert process.wait(30.0) == 2
    assert mentions(output_of(process), "--fast")


def test_a_generated_parameter_file_before_a_scene_is_accepted(ros, start):
    statuses = ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
    for name in NODES:
        files = ["--params-file", str(config_file(f"{name}.yaml")), *PAPER[1:]]
        start(name, "--ros-args", *files)
    ros.spin_until(lambda: any(each.distances_valid for each in statuses), "a status with distances", 30.0)
