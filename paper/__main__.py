# SPDX-License-Identifier: Apache-2.0
"""Command paper: run every experiment of the paper and write the page that compares."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from tqdm import tqdm

from paper.document import PaperResults, document, runs_agree
from paper.figures import save_figure, save_law_figures, save_paper_figures
from paper.maps import save_maps
from paper.paper_checks import check_paper
from paper.pose_checks import draw_pose_errors
from paper.pose_quadrifolium import EXPERIMENTS
from paper.scenes import four_lines, three_lines
from paper.tasks import paper_tasks
from paper.variants import PLAIN, all_variants, run_pose_experiments, run_variants
from plsing_ros.cli.command import make_folder, run_command
from plsing_ros.errors import PlsingError
from plsing_ros.figures.scene_page import require_plotly, save_scene_page
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.simulation.servo_task import ServoTask
from plsing_ros.singularities import singular_set
from plsing_ros.testing.experiment_runner import run_in_nodes

_EPILOG = """examples:
  paper                                          everything: docs/results/, paper_output/scene.html
  paper --docs /tmp/docs                         write the page somewhere else
  paper --docs /tmp/docs --only trajectories     one group of runs, without choices and laws, to look at"""

_GROUPS = tuple(paper_tasks())


def main(argv: Sequence[str] | None = None) -> int:
    """Run the experiments; return the exit code."""
    parser = argparse.ArgumentParser(
        description="Run every experiment of the paper, in the core and through the real nodes, and write a page with "
        "figures, the paper's statements, what we measure, and whether they hold.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--docs", type=Path, default=Path("docs/results"), help="folder of paper.md and figures/ (%(default)s)"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("paper_output"), help="folder of the interactive page (%(default)s)"
    )
    parser.add_argument("--only", nargs="+", choices=_GROUPS, help="only these groups of runs, plain, in the core")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="processes for the runs in the core (%(default)s)"
    )
    options = parser.parse_args(argv)
    return run_command("paper", lambda: 0 if _run(options) else 1)


def _run(options: argparse.Namespace) -> bool:
    if options.jobs < 1:
        raise PlsingError(f"--jobs is {options.jobs}; at least 1 process is needed")
    # Before the long part, like the folders.
    require_plotly()
    figures = options.docs / "figures" / "paper"
    for folder in (figures, options.output):
        make_folder(folder, "write", "--docs or --output")
    tasks = {group: each for group, each in paper_tasks().items() if options.only is None or group in options.only}
    complete = options.only is None
    variants = all_variants(tasks) if complete else {PLAIN: tasks}
    in_nodes = tasks if complete else {}
    total = sum(len(each) for variant in (*variants.values(), in_nodes) for each in variant.values())
    total += len(EXPERIMENTS) if complete else 0
    with tqdm(total=total, unit="run", file=sys.stdout, desc="runs in the core") as bar:
        records = run_variants(variants, options.jobs, bar.update)
        bar.set_description("pose estimation ")
        pose_errors = run_pose_experiments(options.jobs, bar.update) if complete else []
        bar.set_description("runs in nodes   ")
        node_records = {group: [_in_nodes(task, bar.update) for task in each] for group, each in in_nodes.items()}
    plain = records[PLAIN]
    paper_checks = check_paper(plain)
    scene = singular_set(four_lines())
    files = save_paper_figures(plain, {group: singular_set(tasks[group][0].lines) for group in tasks}, figures)
    by_law = {variant.key: of for variant, of in records.items() if variant.kind == "law"}
    if complete:
        files["map"] = [save_maps(figures, plain)]
        files["pose"] = [save_figure(draw_pose_errors(pose_errors), figures / "pose.png")]
    law_files = save_law_figures({"plain": plain, **by_law}, figures) if complete else {}
    results = PaperResults(
        plain,
        node_records,
        by_law,
        paper_checks,
        {
            "plain": paper_checks,
            **{variant.key: check_paper(of) for variant, of in records.items() if variant.kind == "choice"},
        },
        pose_errors,
        files,
        law_files,
    )
    page = options.docs / "paper.md"
    page.write_text(document(results, options.docs), encoding="utf-8")
    paths = [(f"{group}: {run.name}", run.position) for group, each in plain.items() for run in each]
    scene_page = save_scene_page(
        options.output / "scene.html", "The paper's four lines", scene, singular_set(three_lines()).surfaces, paths
    )
    return _report(results, page, scene_page)


def _in_nodes(task: ServoTask, on_run: Callable[[], object]) -> RunRecord:
    record = run_in_nodes(task)
    on_run()
    return record


def _report(results: PaperResults, page: Path, scene_page: Path) -> bool:
    """Print what does not hold, and return whether core and nodes agree."""
    paper_checks = [(group, paper_check) for group, each in results.paper_checks.items() for paper_check in each]
    print(f"{sum(paper_check.holds for _, paper_check in paper_checks)} of {len(paper_checks)} statements hold.")
    for group, paper_check in paper_checks:
        if not paper_check.holds:
            print(f"  does not hold, {group}: {paper_check.statement}: {paper_check.measured}")
    agree = [
        runs_agree(core, nodes)
        for group, each in results.node_records.items()
        for core, nodes in zip(results.records[group], each, strict=True)
    ]
    if agree:
        print(f"{sum(agree)} of {len(agree)} runs agree between core and nodes.")
    print(f"page: {page}\ninteractive page: {scene_page}")
    return all(agree)


if __name__ == "__main__":
    sys.exit(main())
