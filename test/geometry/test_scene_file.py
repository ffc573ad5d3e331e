# SPDX-License-Identifier: Apache-2.0
import pytest

from plsing_ros.errors import SceneFileError
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file

ONE_LINE = """
/**:
  ros__parameters:
    scene_frame: map
    lines: {points: [0, 0, 0], directions: [0, 0, 2.0], ids: [9]}
"""


def test_reads_the_lines_frame_and_ids(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text(ONE_LINE)
    lines = read_scene(file)
    assert (lines.frame, lines.ids, lines.direction.tolist()) == ("map", (9,), [[0.0, 0.0, 1.0]])


def test_reads_the_papers_scene():
    lines = read_scene(config_file("paper_p4l.yaml"))
    assert len(lines) == 4 and lines.exact


@pytest.mark.parametrize(
    ("given", "expected"), [("", 1e-3), (", position_std: 0.02", 0.02), (", position_std: [3]", 3)]
)
def test_reads_how_well_the_lines_are_known(tmp_path, given, expected):
    file = tmp_path / "scene.yaml"
    file.write_text(ONE_LINE.replace("[9]", "[9]" + given))
    lines = read_scene(file)
    assert (lines.position_std.tolist(), lines.direction_std.tolist()) == ([expected], [1e-3])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "has no lines"),
        ("a: [1, 2", "is not YAML"),
        ("/**: {ros__parameters: {gain: 1.0}}", "has no lines"),
        (ONE_LINE.replace("[0, 0, 0]", "[0, 0]"), "lines.points has 2 numbers; it must have 3 for each line"),
        (ONE_LINE.replace("[0, 0, 0]", "[]"), "lines.points has 0 numbers"),
        (
            ONE_LINE.replace("[0, 0, 0]", "[[0, 0, 0]]"),
            r"lines.points is \[\[0, .*; it must be a list of numbers",
        ),
        (ONE_LINE.replace("[0, 0, 0]", "[0, 0, .nan]"), r"points\[0, 2\] is nan"),
        (ONE_LINE.replace("[0, 0, 2.0]", "[0, 0, 0.0]"), "line 9: its direction is zero"),
        (ONE_LINE.replace("[9]", "[9], position_std: -1"), r"line 9: position_std is -1\.0; it must be at least 0"),
        (ONE_LINE.replace("[9]", "[9], direction_std: [0, 0]"), r"direction_std has shape \(2,\), expected \(1\)"),
        (ONE_LINE.replace("[0, 0, 2.0]", "[0, 0, x]"), "scene.yaml"),
        (ONE_LINE.replace("[9]", "9"), "lines.ids is 9; it must be a list of numbers"),
        (ONE_LINE.replace("[9]", "[9.5]"), r"ids are \[9.5\]; they must be integers"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path, content, message):
    file = tmp_path / "scene.yaml"
    file.write_text(content)
    with pytest.raises(SceneFileError, match=message) as caught:
        read_scene(file)
    assert str(file) in str(caught.value)


def test_missing_and_binary_files_are_refused(tmp_path):
    with pytest.raises(SceneFileError, match="scene file.*nowhere.yaml"):
        read_scene(tmp_path / "nowhere.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(SceneFileError, match="scene file.*binary.yaml"):
        read_scene(tmp_path / "binary.yaml")


def test_a_parameter_file_that_is_not_there_says_where_it_was_sought():
    with pytest.raises(SceneFileError, match=r"nothing.yaml.*config"):
        config_file("nothing.yaml")
