# SPDX-License-Identifier: Apache-2.0
"""Every command of the tutorial, in order, in an empty folder."""

import importlib.util
from pathlib import Path

from messages import mentions
from rosbags.highlevel import AnyReader

import plsing_ros

SCRIPT = Path(plsing_ros.__file__).resolve().parents[1] / "docs" / "figures" / "tutorial_figures.py"


def test_the_tutorial_runs_and_says_what_its_page_says(tmp_path):
    spec = importlib.util.spec_from_file_location("tutorial_figures", SCRIPT)
    tutorial = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tutorial)
    assert len(tutorial.commands()) == 8
    said = tutorial.run_tutorial(tmp_path)
    page = tutorial.PAGE.read_text("utf-8")
    for printed, written in (("5.01 mm", "5.0 mm"), ("4.15 mm", "4.2 mm"), ("8.87 mm", "8.9 mm"), ("31.4 mm", "31 mm")):
        assert printed in said and written in page
    assert mentions(said, "no point, line or surface", "singular")
    assert mentions(said, "50 poses", "good")
    assert mentions(said, "task is safe")
    assert "WARN: inverse condition number" in said.split("page: evaluated/report.html")[1]
    for made in (
        "bracket.html",
        "checked/scene.html",
        "evaluated/report.html",
        "replayed/report.html",
        "run/twists.png",
    ):
        assert (tmp_path / made).stat().st_size > 10_000
    # The recording describes its own types, so that any reader of rosbag2 opens it.
    with AnyReader([tmp_path / "recorded" / "your_task"]) as reader:
        counts = {connection.topic.rsplit("/", 1)[-1]: connection.msgcount for connection in reader.connections}
        assert counts["line_features"] == counts["cmd_twist"] > 200 and counts["singular_loci"] >= 1
        for connection, _, data in reader.messages():
            assert reader.deserialize(data, connection.msgtype).header.frame_id
