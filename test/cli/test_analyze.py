# SPDX-License-Identifier: Apache-2.0
import json
import re

import pytest
from messages import mentions

from plsing_ros.cli.analyze import main
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.singularities import singular_set

PAPER = str(config_file("paper_p4l.yaml"))


def test_tells_the_loci_of_the_papers_scene(capsys):
    assert main([PAPER]) == 0
    output = capsys.readouterr().out
    assert output.count("\ntransversal ") == 2
    assert output.count("\nisolated point ") == 6
    assert "hyperbolic" in output


def test_at_a_point_of_the_transversal_the_lost_motion_is_along_it(capsys):
    assert main([PAPER, "--at", "0.3962", "-4.337", "7.50"]) == 0
    nearest = capsys.readouterr().out.split("camera at")[1].splitlines()[1]
    assert mentions(nearest, "transversal 1")
    assert float(nearest.split()[0]) < 1e-3  # the paper prints four digits


def test_away_from_all_loci_no_motion_is_lost(capsys):
    assert main([PAPER, "--at", "5", "2", "3"]) == 0
    assert mentions(capsys.readouterr().out, "no motion")


def test_a_file_that_cannot_be_read_is_one_line(capsys):
    assert main(["/nowhere.yaml"]) == 1
    assert mentions(capsys.readouterr().err, "analyze", "scene file", "/nowhere.yaml")


def test_a_camera_that_is_nowhere_is_refused(capsys):
    assert main([PAPER, "--at", "nan", "0", "0"]) == 1
    assert mentions(capsys.readouterr().err, "--at[0]", "nan")


def test_proofs_are_printed_on_request(capsys):
    assert main([PAPER, "--certify"]) == 0
    output = capsys.readouterr().out
    assert re.search(r"ten isolated points\b.*\b6\b.*\breal", output)
    assert "not proved" not in output.lower()


def test_a_page_is_written_on_request(tmp_path, capsys):
    page = tmp_path / "scene.html"
    assert main([PAPER, "--page", str(page)]) == 0
    assert f"page: {page}" in capsys.readouterr().out
    text = page.read_text(encoding="utf-8")
    # Not in the assertion, which would explain five million characters.
    drawn = [name for name in ("line 4", "transversal 2", "isolated points", "paper_p4l.yaml") if name in text]
    assert len(drawn) == 4


def test_a_page_that_cannot_be_written_is_one_line(tmp_path, capsys):
    assert main([PAPER, "--page", str(tmp_path / "missing" / "scene.html")]) == 1
    assert mentions(capsys.readouterr().err, "analyze", "page", "scene.html")


def test_a_path_across_the_transversal_is_bad_and_says_where(capsys, tmp_path):
    on_both_sides = [
        "--start",
        "0.3962",
        "-4.437",
        "7.4",
        "--target",
        "0.3962",
        "-4.237",
        "7.6",
        "--look-at",
        "0",
        "0",
        "0",
    ]
    assert main([PAPER, *on_both_sides, "--view", "170", "--output", str(tmp_path / "report")]) == 0
    output = capsys.readouterr().out
    assert mentions(output, "transversal 1", "law detour")
    assert (tmp_path / "report" / "path.png").stat().st_size > 10_000


def test_a_workspace_as_json(capsys):
    assert main([PAPER, "--box", "5", "2", "3", "5.5", "2.5", "3.5", "--view", "170", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["verdict"] in ("good", "doubtful") and len(report["poses"]) == 50
    singular = singular_set(read_scene(PAPER))
    for pose in report["poses"][:5]:
        nearest = singular.nearest_locus(pose["center"])
        assert (pose["nearest"], pose["nearest_distance"]) == (nearest.name, pytest.approx(nearest.distance))


def test_a_target_that_sees_nothing_is_bad(capsys):
    assert main([PAPER, "--target", "5", "2", "3", "--look-at", "50", "20", "30", "--view", "5"]) == 0
    assert mentions(capsys.readouterr().out, "bad", "three lines", "view")


def test_json_without_poses_says_what_is_missing(capsys):
    assert main([PAPER, "--json"]) == 1
    assert "--target" in capsys.readouterr().err


FLAT = """v 0 0 0\nv 0.8 0 0\nv 0.8 0 0.6\nv 0 0 0.6\nv 0.2 0 0.1\nv 0.6 0 0.5
l 1 2\nl 2 3\nl 3 4\nl 4 1\nl 5 6\n"""


def test_a_flat_model_is_singular_in_its_plane_and_the_words_and_the_page_say_so(tmp_path, capsys):
    model, page = tmp_path / "frame.obj", tmp_path / "frame.html"
    model.write_text(FLAT)
    assert main([str(model), "--page", str(page)]) == 0
    said = capsys.readouterr().out
    assert mentions(said, "1 mm", "1 mrad", "singular")
    assert mentions(said, "plane y = 0 m")
    named = "in the plane y = 0 m" in page.read_text()
    assert named


def test_the_risk_along_the_papers_path_ends_behind_the_transversal(capsys):
    """From Start 2 the plain law blows up, from beyond the transversal it arrives; the way round arrives from both."""
    ends = ["--start", "0.0962", "-4.037", "7.2", "--target", "0.6962", "-4.637", "7.8", "--noise", "1e-5", "--json"]
    answers = {}
    for law in ("pinv", "detour"):
        assert main([PAPER, *ends, "--law", law]) == 0
        answers[law] = json.loads(capsys.readouterr().out)
    plain = [pose["risk"] for pose in answers["pinv"]["poses"]]
    assert answers["pinv"]["verdict"] == "bad" and any("law pinv" in each for each in answers["pinv"]["reasons"])
    assert min(plain[:15]) > 0.9 and max(plain[30:]) < 0.2
    assert max(pose["demand"] for pose in answers["pinv"]["poses"]) > 1.0
    assert max(pose["risk"] for pose in answers["detour"]["poses"]) < 0.2
