# SPDX-License-Identifier: Apache-2.0
"""The command paper with short runs."""

import re
from dataclasses import replace

import matplotlib.image
import pytest
from messages import mentions

from paper import __main__ as paper
from paper.tasks import STARTS_FOUR, TRAJECTORIES, paper_tasks


@pytest.fixture
def short(monkeypatch):
    tasks = {
        group: tuple(replace(task, path=replace(task.path, duration=0.4)) for task in each)
        for group, each in paper_tasks().items()
    }
    monkeypatch.setattr(paper, "paper_tasks", lambda: {group: tasks[group] for group in (STARTS_FOUR, TRAJECTORIES)})


def test_one_group_leaves_a_page_and_figures(tmp_path, capfd, short):  # noqa: ARG001
    docs, output = tmp_path / "docs", tmp_path / "output"
    arguments = ["--only", TRAJECTORIES, "--docs", str(docs), "--output", str(output), "--jobs", "1"]
    assert paper.main(arguments) == 0
    text = (docs / "paper.md").read_text(encoding="utf-8")
    assert "Trajectory 2" in text and "Start 1" not in text and "## Choices" not in text
    (figure,) = (docs / "figures" / "paper").glob("*.png")
    assert f"figures/paper/{figure.name}" in text
    assert matplotlib.image.imread(figure)[..., :3].std() > 0.05
    assert "Trajectory 2" in (output / "scene.html").read_text(encoding="utf-8")
    printed = capfd.readouterr().out
    # In 0.4 s nothing of what the paper tells of can happen.
    assert re.search(r"\b\d of 4 statements", printed) and re.search(r"not hold.*Trajectory 1", printed)
    assert str(docs / "paper.md") in printed


def test_a_folder_that_cannot_be_written_is_named(tmp_path, capsys):
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert paper.main(["--docs", str(blocked), "--output", str(tmp_path)]) == 1
    assert mentions(capsys.readouterr().err, blocked)


@pytest.mark.parametrize("arguments", [["--only", "everything"], ["--fast"], ["--jobs", "x"]])
def test_bad_arguments_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        paper.main(arguments)
    assert caught.value.code == 2
    assert "usage" in capsys.readouterr().err


def test_no_processes_are_refused(capsys):
    assert paper.main(["--jobs", "0"]) == 1
    assert mentions(capsys.readouterr().err, "--jobs", 0)
