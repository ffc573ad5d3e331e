# SPDX-License-Identifier: Apache-2.0
"""The parameter files in the tree say what the code says."""

from pathlib import Path

import pytest
import yaml

from plsing_ros.cli.parameter_files import NODES, generated_files, main

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", list(generated_files()))
def test_is_up_to_date(name):
    assert (ROOT / name).read_text() == generated_files()[name], "run: python3 -m plsing_ros.cli.parameter_files"


@pytest.mark.parametrize("node", list(NODES))
def test_every_parameter_is_there_with_its_default_unit_and_range(node):
    text = (ROOT / "config" / f"{node}.yaml").read_text()
    values = yaml.safe_load(text)[f"/**/{node}"]["ros__parameters"]
    words = " ".join(line.strip(" #") for line in text.splitlines())
    for name, (field, specification) in NODES[node].specifications().items():
        assert f"{name}:" in text
        if field.default != ():
            value = values[name]
            assert (tuple(value) if isinstance(value, list) else value) == field.default
            assert isinstance(value, list | type(field.default))
        assert specification.description in words
        assert f"[{specification.unit}]" in text or not specification.unit
        assert specification.range_text in words


def test_writes_where_it_is_told(tmp_path, capsys):
    (tmp_path / "config").mkdir()
    assert main(["--root", str(tmp_path)]) == 0
    name = "config/controller.yaml"
    assert (tmp_path / name).read_text() == generated_files()[name]
    assert "wrote" in capsys.readouterr().out
