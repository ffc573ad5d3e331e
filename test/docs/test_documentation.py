# SPDX-License-Identifier: Apache-2.0
"""The documentation builds without a warning, and its examples run."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import plsing_ros
from plsing_ros.cli import analyze
from plsing_ros.cli.parameter_files import NODES

ROOT = Path(plsing_ros.__file__).resolve().parents[1]
DOCS = ROOT / "docs"
EXAMPLE = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
PAGES = [page for page in (ROOT / "README.md", *sorted(DOCS.rglob("*.md"))) if EXAMPLE.search(page.read_text("utf-8"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_examples_of_a_page_run_one_after_the_other(page, monkeypatch):
    monkeypatch.chdir(ROOT)
    names = {}
    for example in EXAMPLE.finditer(page.read_text("utf-8")):
        # Lines are counted as in the page, for tracebacks.
        lines_before = page.read_text("utf-8")[: example.start(1)].count("\n")
        exec(compile("\n" * lines_before + example[1], str(page), "exec"), names)


def test_sphinx_builds_the_pages_without_a_warning(tmp_path):
    missing = "Sphinx, MyST and furo are not installed: pip install -r requirements/dev.txt"
    for module in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(module, reason=missing)
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "-q", "-d", tmp_path / "doctrees"]
    built = subprocess.run([*command, DOCS, tmp_path / "html"], capture_output=True, text=True, cwd=ROOT, check=False)
    assert built.returncode == 0, built.stderr
    assert "ServoController" in (tmp_path / "html" / "reference" / "rooms.html").read_text("utf-8")


def test_the_drawing_and_the_page_of_the_architecture_name_every_room():
    rooms = {folder.parent.name for folder in (ROOT / "plsing_ros").glob("*/__init__.py")}
    drawing = (DOCS / "figures" / "architecture.svg").read_text("utf-8")
    page = (DOCS / "architecture.md").read_text("utf-8")
    for room in rooms:
        assert re.search(rf">[^<]*\b{room}\b", drawing), room
        assert f"| `{room}` |" in page, room


def test_links_of_the_pages_lead_to_files():
    made = {DOCS / "reference" / name for name in ("parameters.md", "messages.md")}
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "QUALITY_DECLARATION.md", *DOCS.rglob("*.md")):
        for target in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", page.read_text("utf-8")):
            file = (page.parent / target).resolve()
            assert file.exists() or file in made, f"{page.relative_to(ROOT)}: there is no {target}"


def test_benchmarks_that_the_pages_name_are_there():
    named = {
        name
        for page in DOCS.rglob("*.md")
        for name in re.findall(r"(?:-m benchmark[. ]|make bench ARGS=)(\w+)", page.read_text("utf-8"))
    }
    assert {"alert_quality", "control_cycle"} <= named
    assert [name for name in named if not (ROOT / "benchmark" / f"{name}.py").exists()] == []


def test_the_scene_file_that_a_page_builds_up_is_one(tmp_path, capsys):
    blocks = re.findall(r"^```yaml\n(.*?)^```", (DOCS / "howto" / "own_lines.md").read_text("utf-8"), re.M | re.DOTALL)
    file = tmp_path / "my_scene.yaml"
    file.write_text("".join(reversed(blocks)), "utf-8")
    assert analyze.main([str(file), "--at", "0.6", "-3.0", "0.4"]) == 0
    assert "transversal" in capsys.readouterr().out
    sections = yaml.safe_load(file.read_text("utf-8"))
    for node, kind in NODES.items():
        if node == "arm_simulator":  # it needs the model of an object, not lines
            continue
        kind.from_values(
            {
                f"{group}.{name}" if isinstance(values, dict) else group: each
                for section in ("/**", f"/**/{node}")
                for group, values in sections.get(section, {}).get("ros__parameters", {}).items()
                for name, each in (values.items() if isinstance(values, dict) else [(group, values)])
            }
        )
