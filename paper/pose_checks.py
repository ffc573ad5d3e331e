# SPDX-License-Identifier: Apache-2.0
"""What the paper says about pose estimation near singularities, and whether our estimator agrees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from paper.paper_checks import PaperCheck
from paper.pose_quadrifolium import QuadrifoliumErrors
from paper.tables import markdown_table
from plsing_ros.arrays import Array

# How near the middle of the pattern counts as very near the singularity [m].
_VERY_NEAR = 0.02


def check_poses(results: Sequence[QuadrifoliumErrors]) -> tuple[PaperCheck, ...]:
    """Return the checks for the results of all of pose_quadrifolium.EXPERIMENTS, in that order."""
    generic, point, line, line_of_five, generic_of_five = results
    near = np.linalg.norm(point.true_center - point.experiment.center, axis=1) < _VERY_NEAR
    refined, first = point.refined_translation, point.first_translation
    in_first = float(first[np.isfinite(first)].max())
    at_point = float(np.median(refined[:, near]))
    return (
        PaperCheck(
            "Four lines, Ex. 1: near-zero errors of both methods",
            "largest below 5 mm, at 6 m from the origin",
            f"{1e3 * _largest(generic.first_translation):.2g} mm, refined "
            f"{1e3 * _largest(generic.refined_translation):.2g} mm",
            max(_largest(generic.first_translation), _largest(generic.refined_translation)) < 5e-3,
        ),
        PaperCheck(
            "Ex. 2, isolated point: the first estimate is off by up to 10 cm",
            "largest error at least 0.1 m",
            f"{in_first:.2g} m",
            in_first >= 0.1,
        ),
        PaperCheck(
            "Ex. 2: refinement brings it below 0.1 mm, except very near the singular point",
            "median below 0.1 mm",
            f"median {1e3 * float(np.median(refined)):.2g} mm",
            float(np.median(refined)) < 1e-4,
        ),
        PaperCheck(
            "Ex. 2: very near the point an error of about 3 cm remains",
            f"median at least 1 cm within {1e2 * _VERY_NEAR:g} cm of it",
            f"median {1e2 * at_point:.2g} cm",
            at_point >= 0.01,
        ),
        _blow_up("Ex. 3, on L_M: both methods fail near the singularity, by orders of magnitude", line),
        _blow_up("Five lines on L_M: both methods fail near the singularity", line_of_five),
        PaperCheck(
            "Five lines, away from singularities: accurate to 0.1 mm and 2e-3 rad",
            "largest refined errors below that",
            f"{1e3 * _largest(generic_of_five.refined_translation):.2g} mm, "
            f"{_largest(generic_of_five.refined_rotation):.1e} rad",
            _largest(generic_of_five.refined_translation) < 1e-4 and _largest(generic_of_five.refined_rotation) < 2e-3,
        ),
    )


def _blow_up(statement: str, results: QuadrifoliumErrors) -> PaperCheck:
    ratios = []
    for errors in (results.first_translation, results.refined_translation):
        found = errors[np.isfinite(errors)]
        ratios.append(np.inf if len(found) < errors.size else float(found.max() / np.median(found)))
    text = " and ".join("no pose at some samples" if np.isinf(ratio) else f"{ratio:.0f} times" for ratio in ratios)
    return PaperCheck(
        statement,
        "largest error at least 100 times the median, or no pose",
        f"{text} (first estimate, refined)",
        min(ratios) >= 100.0,
    )


def _largest(errors: Array) -> float:
    return float(errors.max())


def pose_table(results: Sequence[QuadrifoliumErrors]) -> str:
    """Return medians and largest errors in Markdown."""
    errors_of = (
        "first: median [m]",
        "largest [m]",
        "refined: median [m]",
        "largest [m]",
        "median [rad]",
        "largest [rad]",
    )
    return markdown_table(
        ["experiment", *errors_of],
        [
            [
                each.experiment.name,
                *(
                    "no pose" if np.isinf(value) else f"{value:.1e}"
                    for errors in (each.first_translation, each.refined_translation, each.refined_rotation)
                    for value in (float(np.median(errors)), float(errors.max()))
                ),
            ]
            for each in results
        ],
    )


def draw_pose_errors(results: Sequence[QuadrifoliumErrors]) -> Any:
    """Draw the translation errors of the first seed over s; return the matplotlib figure."""
    figure = plt.figure(figsize=(10, 5), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    for axes, each in zip(panels.flat, results, strict=False):
        for errors, color, label in (
            (each.first_translation[0], "tab:blue", "first estimate"),
            (each.refined_translation[0], "tab:orange", "refined"),
        ):
            shown = np.where(np.isfinite(errors), np.maximum(errors, 1e-9), np.nan)
            axes.semilogy(each.parameter, shown, color=color, linewidth=0.8, label=label)
        for crossing in np.pi / 4 + np.arange(4) * np.pi / 2:
            axes.axvline(crossing, color="black", linestyle=":", linewidth=0.8)
        axes.set_title(each.experiment.name, fontsize="small")
        axes.grid(alpha=0.3)
    for axes in panels[1]:
        axes.set_xlabel("s")
    for axes in panels[:, 0]:
        axes.set_ylabel("translation error [m]")
    panels[1, 2].set_axis_off()
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="lower right", bbox_to_anchor=(0.95, 0.25))
    return figure
