# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
import yaml

from plsing_ros.cli.select_lines import main

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
    assert "a random choice (median)" in output and "without it" in output and "the longest lines" in output
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
    assert "no set of lines keeps the clearance" in capsys.readouterr().out


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
