# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
import yaml
from messages import mentions

from plsing_ros.cli.select_lines import main
from plsing_ros.geometry.model_files import read_model
from plsing_ros.parameters import ControllerParameters, MonitorParameters, SimulatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.parameter_file import read_parameters

RNG = np.random.default_rng(5)
FIRST = RNG.uniform(-1.0, 1.0, (8, 3))
ENDS = np.stack([FIRST, FIRST + 0.6 * RNG.normal(size=(8, 3))], axis=1)
POSES = ["--target", "3", "0", "1", "--start", "3", "1.5", "1", "--look-at", "0", "0", "0"]


@pytest.fixture
def scene(tmp_path):
    lines = {
        "points": ENDS.mean(axis=1).ravel().tolist(),
        "directions": (ENDS[:, 1] - ENDS[:, 0]).ravel().tolist(),
        "ends": ENDS.ravel().tolist(),
    }
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"lines": lines}}}))
    return str(file)


def test_it_chooses_says_why_and_draws(scene, tmp_path, capsys):
    assert main([scene, *POSES, "--output", str(tmp_path / "chosen")]) == 0
    output = capsys.readouterr().out
    assert mentions(output, "random", "longest", "without it")
    assert (tmp_path / "chosen" / "selection.png").stat().st_size > 5_000


def test_json_is_the_same_answer_for_a_path_from_a_file(scene, tmp_path, capsys):
    path = tmp_path / "path.csv"
    path.write_text("x, y, z, qx, qy, qz, qw\n3, 0, 0, -0.5, -0.5, 0.5, 0.5\n3, 1, 0, -0.5, -0.5, 0.5, 0.5\n")
    answers = []
    for _ in range(2):
        assert main([scene, "--path", str(path), "--json", "--count", "5"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert answers[0] == answers[1] and len(answers[0]["ids"]) == 5
    assert answers[0]["position_deviation"]["all lines"] <= answers[0]["position_deviation"]["these lines"]


def test_a_workspace_is_a_box(scene, capsys):
    assert main([scene, "--box", "2", "-1", "0.5", "3", "1", "1.5", "--clearance", "1e3"]) == 0
    assert mentions(capsys.readouterr().out, "clearance")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--target"),
        (["--path", "/nowhere.csv"], "/nowhere.csv"),
        (["--target", "nan", "0", "0"], "--target"),
        ([*POSES, "--count", "40"], "40"),
    ],
)
def test_bad_input_is_one_sentence(scene, arguments, words, capsys):
    assert main([scene, *arguments]) == 1
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1


def test_a_path_file_with_a_wrong_row_is_named_with_its_line(scene, tmp_path, capsys):
    path = tmp_path / "path.csv"
    path.write_text("x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,1\n0,0,x,0,0,0,1\n")
    assert main([scene, "--path", str(path)]) == 1
    assert "line 3" in capsys.readouterr().err


def test_the_parameters_that_it_writes_are_the_nodes_own(tmp_path, capsys):
    model = read_model(config_file("bracket.obj"))
    arguments = ["--start", "-0.3", "-0.9", "0.6", "--target", "0.25", "-0.5", "0.45", "--count", "5"]
    assert main([str(config_file("bracket.obj")), *arguments, "--output", str(tmp_path)]) == 0
    assert str(tmp_path / "lines.yaml") in capsys.readouterr().out
    controller, monitor, simulator = (
        kind.from_values(read_parameters(tmp_path / "lines.yaml", node))
        for kind, node in (
            (ControllerParameters, "controller"),
            (MonitorParameters, "singularity_monitor"),
            (SimulatorParameters, "feature_simulator"),
        )
    )
    np.testing.assert_allclose(controller.target_pose().translation, (0.25, -0.5, 0.45))
    np.testing.assert_allclose(simulator.start_pose().translation, (-0.3, -0.9, 0.6))
    assert monitor.target_known and len(controller.lines()) == 5
    for number, line in enumerate(controller.lines().ids):
        edge = model.edges[model.ids.index(line)]
        np.testing.assert_allclose(np.reshape(monitor.line_ends, (-1, 2, 3))[number], model.vertices[edge])
    # The camera does not look past the bracket: lines that it does not see tell nothing.
    away = ["--look-at", "10", "10", "10", "--json"]
    assert main([str(tmp_path / "lines.yaml"), *arguments, *away]) == 0
    assert set(json.loads(capsys.readouterr().out)["position_deviation"].values()) == {None}


def test_models_of_all_kinds_give_the_same_lines(tmp_path, capsys):
    model = read_model(config_file("bracket.obj"))
    points = "\n".join(" ".join(map(str, vertex)) for vertex in model.vertices.tolist())
    edges = "\n".join(f"{a} {b}" for a, b in model.edges.tolist())
    cao = tmp_path / "bracket.cao"
    cao.write_text(f"V1\n{len(model.vertices)}\n{points}\n{len(model.edges)}\n{edges}\n0\n0\n0\n0\n")
    values = {"vertices": model.vertices.ravel().tolist(), "edges": model.edges.ravel().tolist()}
    (tmp_path / "bracket.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": {"model": values}}}))
    answers = []
    for file in (config_file("bracket.obj"), cao, tmp_path / "bracket.yaml"):
        assert main([str(file), "--target", "0.25", "-0.5", "0.45", "--count", "4", "--json"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert answers[0] == answers[1] == answers[2]
