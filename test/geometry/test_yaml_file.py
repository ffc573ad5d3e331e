# SPDX-License-Identifier: Apache-2.0
"""Files that are made to burn time or memory, and numbers as ROS writes them."""

import pytest
from messages import mentions

from plsing_ros.errors import SceneFileError
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.geometry.yaml_file import read_yaml

ALIAS_BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 10)
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ALIAS_BOMB, r"has an alias, \*a0, in line 2"),
        ("[" * 3000, "nested more than 20 deep in line 1"),
        ("[" * 3000 + "]" * 3000, "nested more than 20 deep in line 1"),
        ("{a: " * 3000, "nested more than 20 deep in line 1"),
        ("\n".join("  " * i + f"k{i}:" for i in range(400)), "nested more than 20 deep in line 21"),
        (f"a: {'7' * 400}", "an integer of 1329 bits; allowed are 64"),
        (f"a: [1, -{'7' * 400}]", "an integer of 1329 bits; allowed are 64"),
        (f"{'7' * 400}: a", "an integer of 1329 bits; allowed are 64"),
        (f"a: {'7' * 5000}", "is not YAML"),
        (f"a: 0x{'f' * 5000}", "an integer of 20000 bits"),
        ("a: [" + "1.0, " * 300_000 + "1.0]", "is larger than 1048576 bytes"),
        ("a: [1", "is not YAML"),
        ("a: 2026-13-45", "is not YAML"),
        ("a: !!python/object/apply:os.getcwd []", "is not YAML"),
    ],
    ids=[
        "alias bomb",
        "open brackets",
        "brackets",
        "braces",
        "indented",
        "long integer",
        "long negative integer",
        "long key",
        "longer integer",
        "long hexadecimal",
        "large",
        "cut off",
        "no such day",
        "an object",
    ],
)
def test_a_file_made_to_do_harm_ends_in_one_sentence(tmp_path, text, message):
    file = tmp_path / "scene.yaml"
    file.write_text(text)
    for read in (lambda: read_yaml(file, "scene file"), lambda: read_scene(file)):
        with pytest.raises(SceneFileError, match=message) as caught:
            read()
        assert mentions(str(caught.value), "scene file", file) and "\n" not in str(caught.value)


def test_no_text_and_no_file_are_sentences(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_bytes(b"\xff\xfe\xfa")
    with pytest.raises(SceneFileError, match="scene file"):
        read_yaml(file, "scene file")
    with pytest.raises(SceneFileError, match="scene file"):
        read_yaml(tmp_path / "nowhere.yaml", "scene file")


def test_numbers_are_read_as_ros_writes_and_reads_them(tmp_path):
    file = tmp_path / "numbers.yaml"
    file.write_text("a: [1e-06, 1.0e-06, -2E+3, 1, 0.5, 9223372036854775807]\nb: e5\n")
    content = read_yaml(file, "scene file")
    assert content == {"a": [1e-6, 1e-6, -2000.0, 1, 0.5, 2**63 - 1], "b": "e5"}
