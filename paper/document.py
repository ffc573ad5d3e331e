# SPDX-License-Identifier: Apache-2.0
"""The text of docs/results/paper.md, made from results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from paper.appendix import appendix_sections
from paper.paper_checks import PaperCheck
from paper.pose_checks import check_poses, pose_table
from paper.pose_quadrifolium import QuadrifoliumErrors
from paper.sensitivity import ARRIVED, CHOICES, IMAGE_NOISE
from paper.tables import markdown_table, yes
from paper.tasks import QUADRIFOLIA, STARTS_FIVE, STARTS_FOUR, TRAJECTORIES
from paper.variants import AVOIDANCE, SPEED_LIMIT_ON_PATHS
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.simulation.servo_task import LOST, TIME_STEP

# Two runs of a task agree when their positions differ by less than this times (1 m + the distance to the target).
AGREEMENT = 1e-6

_TITLES = {
    STARTS_FOUR: "Four lines: Starts 1 to 4 near L_M",
    TRAJECTORIES: "Four lines: trajectories through L_N and beside it",
    QUADRIFOLIA: "Four lines: quadrifolia around the isolated points",
    STARTS_FIVE: "Five lines: Starts 1 to 4 near L_M",
}
_INTRODUCTIONS = {
    STARTS_FOUR: "Section *VS towards a desired pose near singularity line L_M*: λ = 0.1, no noise. Dotted: exp(-λ t).",
    TRAJECTORIES: "Section *Trajectory following across singularity line L_N*: λ = 1, noise 2e-3. Dotted: the wanted "
    "paths. The vertical line is s = 0.",
    QUADRIFOLIA: "Section *VS around the isolated point singularities*: λ = 5, noise 1e-3. Vertical lines: the wanted "
    "position is at the centre.",
    STARTS_FIVE: "Section *VS near the singularity line* of five lines with d7 ≈ 7.7177: λ = 0.1, noise 2e-3. The "
    "inverse condition number is that of the noisy matrix, as the controller sees it.",
}


@dataclass(frozen=True, eq=False)
class PaperResults:
    """All that the document is made of.

    Attributes:
        records: The plain runs in the core, by group.
        node_records: The same runs through the nodes, by group; empty if they were left out.
        law_records: The same runs with other laws, by law and group; empty if they were left out.
        paper_checks: Of the plain runs, by group.
        checks_by_choice: By key of the choice and group; empty if they were left out.
        pose_errors: Of pose_quadrifolium.EXPERIMENTS; empty if they were left out.
        figures: PNG files by group, and under "map" and "pose" those.
        law_figures: PNG files of runs with all laws, by group.
    """

    records: Mapping[str, Sequence[RunRecord]]
    node_records: Mapping[str, Sequence[RunRecord]]
    law_records: Mapping[str, Mapping[str, Sequence[RunRecord]]]
    paper_checks: Mapping[str, Sequence[PaperCheck]]
    checks_by_choice: Mapping[str, Mapping[str, Sequence[PaperCheck]]]
    pose_errors: Sequence[QuadrifoliumErrors]
    figures: Mapping[str, Sequence[Path]]
    law_figures: Mapping[str, Sequence[Path]] = field(default_factory=dict)


def document(results: PaperResults, folder: Path) -> str:
    """Return the document in Markdown; figures are linked relative to its folder."""
    parts = [_introduction(results), "## Geometry", appendix_sections()]
    parts += [_group(results, group, folder) for group in results.records]
    if results.pose_errors:
        parts.append(_pose(results, folder))
    if results.figures.get("map"):
        parts.append(_map(results.figures["map"], folder))
    if len(results.checks_by_choice) > 1:
        parts.append(_sensitivity(results.checks_by_choice))
    if results.node_records:
        parts.append(_agreement(results))
    return "\n\n".join(parts) + "\n"


def _introduction(results: PaperResults) -> str:
    held = [paper_check.holds for paper_checks in results.paper_checks.values() for paper_check in paper_checks]
    held += [paper_check.holds for paper_check in check_poses(results.pose_errors)] if results.pose_errors else []
    return f"""# The paper, reproduced

Everything in J. García Fontán, A. Nayak, S. Briot, M. Safey El Din, "Singularity Analysis for the Perspective-Four and
Five-Line Problems" that can be computed, computed. `make paper` writes this page and its figures anew; nothing in it is
typed by hand, and all seeds are fixed. We have the paper's text and not its figures, so its statements are what we
compare with.

Of {len(held)} statements about servoing and pose, {sum(held)} hold in our plain runs. Each is listed with the criterion
that we made of it, knowing the runs; bold says where it does not hold. The section *Choices* says which of them depend
on what.

What the paper leaves open, and we chose:

- **Orientation.** It says that all lines are visible. Ours is constant in each run, with the optical axis from P_M or
  the path's middle to the origin of the scene.
- **Time step.** {TIME_STEP:g} s, with exact motion in between.
- **Noise.** "Added to the 3D coordinates of the observed lines", of which the paper says that they are measured for the
  interaction matrix: independent Gaussian noise at each frame on unit directions and moments in the camera frame, in
  the interaction matrix and not in the image. With noise in the image as well, Trajectory 2 has errors that the paper
  does not tell of (see *Choices*). This is the reading, of eight that were tried, nearest to the paper's words and
  results; the paper itself does not settle it.
- **End.** A run to a fixed target ends 1 mm from it. A camera more than {LOST:g} m from where it shall be is lost, and
  its run ends."""


def _group(results: PaperResults, group: str, folder: Path) -> str:
    parts = [f"## {_TITLES[group]}", _INTRODUCTIONS[group]]
    parts += _images(results.figures.get(group, ()), folder)
    parts.append(_checks_table(results.paper_checks[group]))
    moving = results.records[group][0].target.ndim == 2 and group in (TRAJECTORIES, QUADRIFOLIA)
    parts.append(_laws_text(moving) if results.law_records else "In numbers:")
    parts.append(_runs_table({"plain": results.records, **results.law_records}, group, moving))
    parts += _images(results.law_figures.get(group, ()), folder)
    parts += _changes(results.law_records, group)
    return "\n\n".join(parts)


def _images(files: Sequence[Path], folder: Path) -> list[str]:
    return [f"![{file.stem.replace('_', ' ')}]({file.relative_to(folder)})" for file in files]


def _checks_table(paper_checks: Sequence[PaperCheck]) -> str:
    return markdown_table(
        ["the paper says", "our criterion", "we measure", "holds"],
        [
            [paper_check.statement, paper_check.criterion, paper_check.measured, yes(paper_check.holds)]
            for paper_check in paper_checks
        ],
    )


def _pose(results: PaperResults, folder: Path) -> str:
    noise = sorted({each.experiment.noise for each in results.pose_errors}, reverse=True)
    return "\n\n".join(
        [
            "## Pose estimation along quadrifolia",
            "Sections *Pose Estimation along a quadrifolium trajectory* and *... near the singularity line*: exact "
            f"images, and lines known with noise ({noise[0]:g} for four lines, {noise[-1]:g} for five) on the six "
            "Plücker coordinates in the scene frame. The paper used RPnL and virtual visual servoing; this is the "
            "estimator of `plsing_ros.pose`, before and after its refinement.",
            *(f"![translation errors]({file.relative_to(folder)})" for file in results.figures.get("pose", ())),
            _checks_table(check_poses(results.pose_errors)),
            pose_table(results.pose_errors),
            "The refined errors are those that this noise allows (`test/experiments/test_pose_quadrifolium.py`), so "
            "the paper's 0.1 mm may come from another noise model, or another estimator.",
        ]
    )


def _runs_table(by_law: Mapping[str, Mapping[str, Sequence[RunRecord]]], group: str, moving: bool) -> str:
    headings = ["run", "law", "ended", "largest error [m]", "median error [m]", "peak |v| [m/s]", "lowest 1/cond"]
    if not moving:
        headings[3:5] = ["longest distance [m]", "way [m]"]
    rows = []
    for number in range(len(by_law["plain"][group])):
        for law, records in by_law.items():
            if group not in records:
                continue
            run = records[group][number]
            way = float(np.linalg.norm(np.diff(run.position, axis=0), axis=1).sum())
            rows.append(
                [
                    run.name if law == "plain" else "",
                    law,
                    _ending(run),
                    _number(float(run.distance.max())),
                    _number(float(np.median(run.distance)) if moving else way),
                    _number(float(run.linear_speed.max())),
                    f"{run.inverse_condition_number.min():.1e}",
                ]
            )
    return markdown_table(headings, rows)


def _laws_text(moving: bool) -> str:
    if moving:
        return (
            f"The same runs with the package's *guarded* law, its speed limited to {SPEED_LIMIT_ON_PATHS:g} m/s; for "
            f"*detour*, what comes nearer than {AVOIDANCE.margin:g} m to a transversal, an isolated point or an "
            "observed line is first taken out of the wanted path and a planned path round put in its place, which the "
            "guarded law follows. Errors are to the paper's path, and so larger where it goes round:"
        )
    return (
        "The same runs with the package's own laws. *guarded* limits the nearly unobservable motion, and the speed to "
        "0.15 m/s; *detour* plans a path round the singular set and follows it at 0.1 m/s:"
    )


def _changes(law_records: Mapping[str, Mapping[str, Sequence[RunRecord]]], group: str) -> list[str]:
    """Return what was changed of the paths of a group, as no paragraph or one."""
    runs = [run for records in law_records.values() for run in records.get(group, ()) if run.changes]
    lines = [f"- {run.name}: {'; '.join(run.changes)}." for run in runs]
    return ["What was changed of the wanted paths:\n\n" + "\n".join(lines)] if lines else []


def _ending(run: RunRecord) -> str:
    if run.arrived:
        return f"arrived after {run.time[-1]:.1f} s"
    if run.ended.startswith("lost"):
        return f"**lost** after {run.time[-1]:.1f} s"
    return f"{run.distance[-1]:.2g} m away after {run.time[-1]:.0f} s"


def _number(value: float) -> str:
    return f"{value:.3g}" if value <= LOST else f"over {LOST:g}"


def _map(files: Sequence[Path], folder: Path) -> str:
    images = "\n\n".join(f"![inverse condition number on planes]({file.relative_to(folder)})" for file in files)
    return f"""## A map

The inverse condition number of the four lines for cameras on four planes, each looking at the origin. White and blue:
quadric and cubic of the first three lines, on which *three* lines are singular; four are only where all triplets are.

{images}

The two dark spots of the last map that have no mark are no singularities: there line 2 lies in the plane z = 0 of a
camera that looks at the origin, and has no image. The rank depends only on where the camera is, the condition number
also on how it is turned.

`make paper` also writes `paper_output/scene.html`, a page to turn the scene around in a browser, with lines,
transversals, isolated points, the hyperboloid and the cubic surface of the first three lines, and the cameras' ways.
It needs no network."""


def _sensitivity(checks_by_choice: Mapping[str, Mapping[str, Sequence[PaperCheck]]]) -> str:
    keys = list(checks_by_choice)
    rows: list[list[str]] = []
    exceptions: list[str] = []
    for group, paper_checks in checks_by_choice[keys[0]].items():
        lines = _TITLES[group].split()[0]
        for number, paper_check in enumerate(paper_checks):
            of_choices = {key: checks_by_choice[key][group][number] for key in keys}
            rows.append(
                [f"{lines}: {paper_check.statement}", *("+" if each.holds else "**-**" for each in of_choices.values())]
            )
            failed = [f"{key}: {each.measured}" for key, each in of_choices.items() if not each.holds]
            if failed:
                exceptions.append(f"- {lines}, *{paper_check.statement}*: {'; '.join(failed)}.")
    holding = [sum(row[1 + column] == "+" for row in rows) for column in range(len(keys))]
    without_image_noise = sum(
        all(cell == "+" for key, cell in zip(keys, row[1:], strict=True) if key not in IMAGE_NOISE) for row in rows
    )
    described = {"plain": "as in the sections above", **{choice.key: choice.description for choice in CHOICES}}
    return "\n\n".join(
        [
            "## Choices",
            f"Each statement again with one thing decided otherwise (runs to a fixed target end {ARRIVED:g} m from it "
            f"here); + holds, - does not. {len(rows) - len(exceptions)} of {len(rows)} hold for all choices, "
            f"{without_image_noise} for all but noise on the image.",
            "\n".join(f"- *{key}*: {described[key]}" for key in keys),
            markdown_table(["statement", *keys], [*rows, ["number that hold", *map(str, holding)]]),
            "Where statements do not hold:",
            "\n".join(exceptions) if exceptions else "Nowhere.",
        ]
    )


def _agreement(results: PaperResults) -> str:
    rows = []
    for group, records in results.node_records.items():
        for core, nodes in zip(results.records[group], records, strict=True):
            difference = max_difference(core, nodes)
            rows.append(
                [
                    f"{_TITLES[group].split()[0]}: {core.name}",
                    f"{len(core.time)}",
                    f"{len(nodes.time)}",
                    _size(difference),
                    yes(runs_agree(core, nodes)),
                ]
            )
    return "\n\n".join(
        [
            "## Core and nodes",
            "Each run twice: the core alone, and the real simulator and controller over ROS topics, in lockstep; a "
            "moving target is published on `desired_line_features` for each frame. The largest difference of camera "
            f"positions, over 1 m plus the distance to the target, must be below {AGREEMENT:g}, for as many frames.",
            markdown_table(["run", "frames, core", "frames, nodes", "largest difference", "agree"], rows),
        ]
    )


def max_difference(first: RunRecord, second: RunRecord) -> float:
    """Return the largest difference of camera positions at equal times, over 1 m plus the distance to the target."""
    common = min(len(first.time), len(second.time))
    difference = np.linalg.norm(first.position[:common] - second.position[:common], axis=1)
    return float((difference / (1.0 + first.distance[:common])).max())


def runs_agree(first: RunRecord, second: RunRecord) -> bool:
    """Return whether two runs of one task agree to AGREEMENT and have as many frames."""
    return len(first.time) == len(second.time) and max_difference(first, second) <= AGREEMENT


def _size(difference: float) -> str:
    # So that rounding errors look the same on every machine.
    return "below 1e-9" if difference < 1e-9 else f"{difference:.0e}"
