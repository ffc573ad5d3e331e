# SPDX-License-Identifier: Apache-2.0
"""The demo's command line; the runs themselves are in test/ros/test_closed_loop.py."""

import matplotlib.image
import pytest
from messages import mentions

from plsing_ros.cli import demo
from plsing_ros.simulation import near_transversal


def test_runs_a_start_and_leaves_a_table_and_figures(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(near_transversal, "MAX_STEPS", 250)  # past the blow-up of Start 2
    assert demo.main(["--starts", "2", "--output", str(tmp_path / "new" / "folder")]) == 0
    output = capfd.readouterr().out
    assert mentions(output, "Start 2", 250, "not arrived")
    assert "CRITICAL: " in output
    figures = sorted((tmp_path / "new" / "folder").glob("*.png"))
    assert [file.stem for file in figures] == [
        "distance_to_target",
        "error_norm",
        "inverse_condition_number",
        "trajectories",
        "twists",
    ]
    for file in figures:
        assert str(file) in output
        assert matplotlib.image.imread(file)[..., :3].std() > 0.05  # not an empty page


def test_a_folder_that_cannot_be_written_is_named(tmp_path, capsys):
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert demo.main(["--starts", "1", "--output", str(blocked)]) == 1
    assert mentions(capsys.readouterr().err, "figures", blocked)


@pytest.mark.parametrize("arguments", [["--starts", "5"], ["--starts", "x"], ["--fast"]])
def test_bad_arguments_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        demo.main(arguments)
    assert caught.value.code == 2
    assert "usage" in capsys.readouterr().err
