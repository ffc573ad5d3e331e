from plsing_ros.cli.analyze import main
from plsing_ros.parameters.config_files import config_file

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
    assert nearest.endswith("m from transversal 1")
    assert float(nearest.split()[0]) < 1e-3  # the paper prints four digits


def test_away_from_all_loci_no_motion_is_lost(capsys):
    assert main([PAPER, "--at", "5", "2", "3"]) == 0
    assert "no motion is lost there" in capsys.readouterr().out


def test_a_file_that_cannot_be_read_is_one_line(capsys):
    assert main(["/nowhere.yaml"]) == 1
    assert capsys.readouterr().err.startswith("analyze: cannot read scene file /nowhere.yaml")


def test_a_camera_that_is_nowhere_is_refused(capsys):
    assert main([PAPER, "--at", "nan", "0", "0"]) == 1
    assert "--at[0] is nan" in capsys.readouterr().err


def test_proofs_are_printed_on_request(capsys):
    assert main([PAPER, "--certify"]) == 0
    output = capsys.readouterr().out
    assert "Exactly ten isolated points, 6 of them real" in output
    assert "Not proved" not in output


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
    assert capsys.readouterr().err.startswith("analyze: cannot write the page")
