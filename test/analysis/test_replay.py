# SPDX-License-Identifier: Apache-2.0
"""A recording, written with rosbags from the message definitions, replayed without ROS."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import plsing_ros as pl
from plsing_ros.analysis.recording import read_recording
from plsing_ros.analysis.replay import replay
from plsing_ros.cli.replay import main
from plsing_ros.parameters import MonitorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.simulation import near_transversal as experiment

DEFINITIONS = Path(__file__).resolve().parents[2] / "msg_defs" / "msg"
PAPER = str(config_file("paper_p4l.yaml"))
START = pl.Pose.from_quaternion(experiment.STARTS[1].position, experiment.ORIENTATION)
TARGET = pl.Pose.from_quaternion(experiment.TARGET_POSITION, experiment.ORIENTATION)


def write_run(folder, plugin=StoragePlugin.MCAP, stamp_offset=0, frames=60):
    """A plain run towards a transversal, as the nodes would have recorded it."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for file in sorted(DEFINITIONS.glob("*.msg")):
        store.register(get_types_from_msg(file.read_text(), f"plsing_msgs/msg/{file.stem}"))
    types = store.types
    values = read_parameters(PAPER, "singularity_monitor")
    lines = MonitorParameters.from_values(
        {name: value for name, value in values.items() if name in MonitorParameters.specifications()}
    ).lines()
    run = pl.simulate(lines, START, TARGET, gain=0.5, max_time=frames * 0.04, max_linear_speed=0.0)

    def header(time, frame):
        seconds, nanoseconds = divmod(time, 10**9)
        stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    def features(seen, time):
        fields = {
            "header": header(time, "camera_optical_frame"),
            "ids": np.array(seen.ids, dtype=np.int32),
            "image_lines": seen.image_lines.ravel(),
            "directions": seen.lines_camera.direction.ravel(),
            "moments": seen.lines_camera.moment.ravel(),
            "visible": seen.usable.astype(np.uint8),
            "lines_verdict": 0,
            "lines_reason": "",
            "lines_source": "",
        }
        kind = types["plsing_msgs/msg/LineFeatureArray"]
        empty = {name: np.zeros(0) for name in kind.__dataclass_fields__ if name not in fields and name[0].islower()}
        return kind(**fields, **empty)

    def twist(values, time):
        vector, stamped = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/TwistStamped"]
        parts = {"linear": vector(*values[:3]), "angular": vector(*values[3:])}
        return stamped(header(time, "camera_optical_frame"), types["geometry_msgs/msg/Twist"](**parts))

    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        topics = {
            "/line_features": "plsing_msgs/msg/LineFeatureArray",
            "/desired_line_features": "plsing_msgs/msg/LineFeatureArray",
            "/cmd_twist": "geometry_msgs/msg/TwistStamped",
        }
        connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()}

        def write(topic, message, time):
            data = store.serialize_cdr(message, topics[topic])
            writer.write(connections[topic], time + stamp_offset, data)

        write("/desired_line_features", features(pl.project(lines, TARGET), 10**9), 10**9)
        for k, pose in enumerate(run.poses):
            time = 10**9 + k * 40_000_000
            write("/line_features", features(pl.project(lines, pose), time), time)
            write("/cmd_twist", twist(run.twists[k], time), time + 1_000_000)
    return run


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("offset", [0, 10**15])
def test_the_monitor_says_what_it_says_live_and_the_controller_commands_what_it_commanded(tmp_path, plugin, offset):
    recorded = write_run(tmp_path / "run", plugin, offset)
    assert main([str(tmp_path / "run"), "--params-file", PAPER, "--set", "gain=0.5", "--output", str(tmp_path)]) == 0
    values = read_parameters(PAPER, "singularity_monitor")
    known = {k: v for k, v in values.items() if k in MonitorParameters.specifications()}
    run = replay(read_recording(tmp_path / "run"), MonitorParameters.from_values(known))
    np.testing.assert_allclose(run.recorded_speed, np.linalg.norm(recorded.twists[:, :3], axis=1))
    np.testing.assert_allclose(run.time, recorded.times, atol=1e-9)
    live = pl.SingularityMonitor.from_parameters(MonitorParameters.from_values(known))
    live.set_target(pl.project(live.singular_set.lines, TARGET))
    levels = []
    for pose, twist, time in zip(recorded.poses, recorded.twists, recorded.times, strict=True):
        levels.append(live.assess(pl.project(live.singular_set.lines, pose), time=1.0 + time).level)
        live.receive_twist(twist, 10**18 + round((1.0 + time) * 1e9))
    assert list(run.level) == levels
    assert (tmp_path / "replay.png").stat().st_size > 20_000
    assert "data:image/png" in (tmp_path / "report.html").read_text()


def test_other_thresholds_give_other_alerts(tmp_path, capsys):
    write_run(tmp_path / "run")
    answers = []
    # By distances alone: the roll-outs know at once that this run comes to harm.
    distances = ["--set", "prediction.controller=unknown"]
    for changes in ([], ["--set", "warn.transversal_distance=5.0"]):
        assert main([str(tmp_path / "run"), "--params-file", PAPER, "--json", *distances, *changes]) == 0
        answers.append(json.loads(capsys.readouterr().out)["alerts"][0]["level"])
    assert answers == ["OK", "WARN"]


def test_broken_and_foreign_recordings_get_a_sentence(tmp_path, capsys):
    write_run(tmp_path / "run")
    cut = tmp_path / "cut"
    shutil.copytree(tmp_path / "run", cut)
    data = next(cut.glob("*.mcap"))
    data.write_bytes(data.read_bytes()[: data.stat().st_size // 3])
    (tmp_path / "empty").mkdir()
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "foreign", version=9) as writer:
        text = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        writer.write(text, 1, store.serialize_cdr(store.types["std_msgs/msg/String"]("hello"), "std_msgs/msg/String"))
    shutil.copytree(tmp_path / "run", tmp_path / "noise")
    next((tmp_path / "noise").glob("*.mcap")).write_bytes(np.random.default_rng(1).bytes(5000))
    write_run(tmp_path / "sqlite", StoragePlugin.SQLITE3, frames=20)
    database = next((tmp_path / "sqlite").glob("*.db3"))
    database.write_bytes(database.read_bytes()[: database.stat().st_size // 2])
    for name, words in (
        ("noise", "broken"),
        ("sqlite", "broken"),
        ("cut", "broken"),
        ("empty", "no metadata.yaml"),
        ("foreign", "/chatter"),
        ("nowhere", "does not exist"),
    ):
        assert main([str(tmp_path / name), "--params-file", PAPER]) == 1
        error = capsys.readouterr().err
        assert words in error and error.count("\n") == 1 and name in error


@pytest.mark.parametrize("change", ["warn.transversl_distance=1", "nonsense", "warn.transversal_distance=far"])
def test_bad_changes_are_refused(tmp_path, capsys, change):
    write_run(tmp_path / "run", frames=3)
    assert main([str(tmp_path / "run"), "--params-file", PAPER, "--set", change]) == 1
    assert "warn.transversal_distance" in capsys.readouterr().err or change == "nonsense"


def test_without_a_scene_it_says_what_to_give(tmp_path, capsys):
    write_run(tmp_path / "run", frames=3)
    assert main([str(tmp_path / "run")]) == 1
    assert "--params-file" in capsys.readouterr().err


def test_the_file_in_the_folder_will_do(tmp_path, capsys):
    write_run(tmp_path / "run", frames=3)
    answers = []
    for bag in (tmp_path / "run", next((tmp_path / "run").glob("*.mcap"))):
        assert main([str(bag), "--params-file", PAPER]) == 0
        answers.append(capsys.readouterr().out)
    assert answers[0] == answers[1]
