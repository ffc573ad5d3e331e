# SPDX-License-Identifier: Apache-2.0
"""The survey command: reproducible, continued where it stopped, honest about its input."""

import json
import re

from messages import mentions

from plsing_ros.cli import survey


def run(capsys, *arguments):
    code = survey.main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_continues_an_interrupted_run_with_the_same_result(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(survey, "_CHUNK", 100)
    whole, part = tmp_path / "whole.jsonl", tmp_path / "part.jsonl"
    code, expected, _ = run(capsys, "--scenes", 350, "--seed", 3, "--output", whole)
    assert code == 0
    run(capsys, "--scenes", 200, "--seed", 3, "--output", part)
    with part.open("a") as file:
        file.write('{"chunk": 2, "ellip')
    code, continued, _ = run(capsys, "--scenes", 350, "--seed", 3, "--output", part)
    assert code == 0
    assert continued == expected
    assert [json.loads(line)["chunk"] for line in part.read_text().splitlines()[-2:]] == [2, 3]
    assert re.search(r"\b350 scenes\b.*\b0 without", expected)
    records = [json.loads(line) for line in whole.read_text().splitlines()]
    assert [record["chunk"] for record in records[1:]] == [0, 1, 2, 3]
    _, again, _ = run(capsys, "--scenes", 350, "--seed", 3, "--output", whole)
    assert again == expected


def test_refuses_the_file_of_another_survey(tmp_path, capsys):
    output = tmp_path / "survey.jsonl"
    run(capsys, "--scenes", 10, "--seed", 3, "--output", output)
    code, _, error = run(capsys, "--scenes", 10, "--seed", 4, "--output", output)
    assert code == 2
    assert mentions(error, "another survey")
    for content in (b"# Notes\nof mine\n", b"\xff\xfe\x00\x80", b"\n", b"3\n"):
        output.write_bytes(content)
        code, _, error = run(capsys, "--scenes", 10, "--seed", 4, "--output", output)
        assert (code, output.read_bytes()) == (2, content)
        assert error.startswith(f"survey: {output}")
    code, _, error = run(capsys, "--scenes", 0)
    assert code == 2
    assert "--scenes 0" in error
