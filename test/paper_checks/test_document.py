# SPDX-License-Identifier: Apache-2.0
"""docs/results/paper.md: what is cheap to compute is up to date, and the document says what was measured."""

import re
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from messages import mentions

import plsing_ros
from paper.appendix import appendix_sections
from paper.document import PaperResults, document, max_difference, runs_agree
from paper.figures import save_law_figures
from paper.paper_checks import check_paper
from paper.special_scenes import agrees, case_examples, special_orthogonal_scenes
from paper.tables import markdown_table, vector_text, yes
from paper.tasks import TRAJECTORIES, paper_tasks
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.singularities import Case, singular_set

DOCS = Path(plsing_ros.__file__).resolve().parents[1] / "docs" / "results"


def committed():
    return (DOCS / "paper.md").read_text(encoding="utf-8")


def test_the_geometry_of_the_committed_page_is_what_is_computed_now():
    there = appendix_sections() in committed()
    assert there, "docs/results/paper.md is out of date: run make paper"


def test_the_committed_page_tells_of_all_runs_and_links_all_figures():
    text = committed()
    for tasks in paper_tasks().values():
        for task in tasks:
            assert f"| {task.name} | plain |" in text
    linked = set(re.findall(r"\]\((figures/paper/[^)]*)\)", text))
    assert linked == {f"figures/paper/{file.name}" for file in (DOCS / "figures" / "paper").glob("*.png")}
    assert max((DOCS / file).stat().st_size for file in linked) < 150_000


def test_nothing_of_the_geometry_disagrees():
    text = appendix_sections()
    assert "**no**" not in text
    # Two transversals, sixteen points, two of appendix B, eight cases, five special scenes.
    assert text.count("| yes |") == 33


@pytest.mark.parametrize("example", case_examples(), ids=lambda example: example.row)
def test_examples_of_cases_are_of_their_kind(example):
    assert agrees(example, singular_set(example.lines))


def test_a_scene_of_another_kind_is_noticed():
    hyperbolic, elliptic = (
        next(each for each in case_examples() if each.case is case) for case in (Case.P4L_HYPERBOLIC, Case.P4L_ELLIPTIC)
    )
    assert not agrees(hyperbolic, singular_set(elliptic.lines))
    assert not agrees(replace(hyperbolic, max_points=5), singular_set(hyperbolic.lines))


def test_the_papers_lines_of_orthogonal_scenes_meet_all_lines():
    from paper.scenes import orthogonal_and_parallel_lines

    for _, d, point, direction in special_orthogonal_scenes():
        lines = orthogonal_and_parallel_lines(d)
        moment = np.cross(point, direction)
        np.testing.assert_allclose(lines.moment @ np.array(direction) + lines.direction @ moment, 0.0, atol=1e-12)


def record(name, offset=0.0, frames=5):
    time = 0.04 * np.arange(frames)
    target = np.column_stack([time, 0.0 * time, 0.0 * time])
    position = target + [0.0, 0.1 + offset, 0.0]
    ones = np.ones(frames)
    return RunRecord(name, time, position, np.ones((frames, 6)), ones, 0.5 * ones, target, False, (), "time is over")


def results(**changes):
    records = {TRAJECTORIES: [record("Trajectory 1"), record("Trajectory 2")]}
    plain = PaperResults(records, {}, {}, check_paper(records), {}, (), {})
    return replace(plain, **changes)


def test_a_document_of_one_group(tmp_path):
    text = document(results(figures={TRAJECTORIES: [tmp_path / "figures" / "paper" / "a.png"]}), tmp_path)
    assert "](figures/paper/a.png)" in text
    assert "| Trajectory 1 | plain | 0.1 m away after 0 s | 0.1 | 0.1 | 1.73 | 5.0e-01 |" in text
    assert "| Trajectory 1: the translation error becomes as high as 1 m |" in text
    assert "**no**" in text
    assert "## Choices" not in text and "## Core and nodes" not in text


def test_changed_paths_are_told_of(tmp_path):
    changed = replace(record("Trajectory 1", 0.2), changes=("transversal 2 is near: left and joined again",))
    text = document(results(law_records={"detour": {TRAJECTORIES: [changed, record("Trajectory 2")]}}), tmp_path)
    assert "|  | detour | 0.3 m away after 0 s | 0.3 | 0.3 | 1.73 | 5.0e-01 |" in text
    assert "- Trajectory 1: transversal 2 is near: left and joined again" in text and "- Trajectory 2:" not in text
    assert mentions(text, "0.1 m")


def test_runs_with_all_laws_are_drawn_below_their_table(tmp_path):
    by_law = {
        law: {TRAJECTORIES: [record(f"Trajectory {number}", offset) for number in (1, 2)]}
        for law, offset in (("plain", 0.0), ("detour", 0.2))
    }
    figures = save_law_figures(by_law, tmp_path)
    (figure,) = figures[TRAJECTORIES]
    assert matplotlib.image.imread(figure)[..., :3].std() > 0.05
    text = document(results(law_records={"detour": by_law["detour"]}, law_figures=figures), tmp_path)
    assert text.index(f"]({figure.name})") > text.index("|  | detour |")


def test_choices_and_nodes_are_reported(tmp_path):
    paper_checks = check_paper({TRAJECTORIES: [record("Trajectory 1"), record("Trajectory 2")]})
    nodes = {TRAJECTORIES: [record("Trajectory 1", 1e-5), record("Trajectory 2", 1e-12)]}
    text = document(
        results(checks_by_choice={"plain": paper_checks, "20 ms": paper_checks}, node_records=nodes), tmp_path
    )
    assert "| statement | plain | 20 ms |" in text
    assert "| Four: Trajectory 1 | 5 | 5 | 9e-06 | **no** |" in text
    assert "| Four: Trajectory 2 | 5 | 5 | below 1e-9 | yes |" in text


def test_runs_agree_only_with_as_many_frames():
    assert runs_agree(record("a"), record("a", 1e-9))
    assert not runs_agree(record("a"), record("a", frames=4))
    assert max_difference(record("a"), record("a", 0.5, frames=3)) == pytest.approx(0.5 / 1.1)


def test_cells_are_escaped_and_zero_has_no_sign():
    assert markdown_table(["a"], [["|v|"]]) == "| a |\n| --- |\n| \\|v\\| |"
    assert vector_text([-1e-9, 1.23456], 3) == "(0.000, 1.235)"
    assert (yes(True), yes(False)) == ("yes", "**no**")
