# SPDX-License-Identifier: Apache-2.0
"""Draw the figures of docs/theory.md: python docs/figures/theory_figures.py [survey.jsonl]."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from plsing_ros.figures.segments import segments_in_ball
from plsing_ros.geometry import LineSet
from plsing_ros.singularities import singular_set, surface_triangles

HERE = Path(__file__).parent
POINTS, DIRECTIONS = [[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13]]
FOUR = LineSet.from_points_directions(POINTS, DIRECTIONS)
OBSERVED, TRANSVERSAL, ISOLATED, OTHER = "#1f4e79", "#c55a11", "#b00020", "#6b6b6b"


def segment(axes: plt.Axes, point: np.ndarray, direction: np.ndarray, size: float, **style: object) -> None:
    """Draw the part of a line inside the ball around the origin."""
    for ends in segments_in_ball(point[np.newaxis], direction[np.newaxis], np.zeros(3), size):
        axes.plot(*ends.T, **style)


def scene() -> None:
    """The paper's four lines, their transversals and the isolated points near them."""
    singular = singular_set(FOUR)
    figure = plt.figure(figsize=(6.4, 5.4))
    axes = figure.add_subplot(projection="3d")
    size = 3.0
    for i in range(4):
        label = "observed lines" if i == 0 else None
        segment(axes, FOUR.point[i], FOUR.direction[i], size, color=OBSERVED, linewidth=2, label=label)
    for i, line in enumerate(singular.transversals):
        label = "transversals" if i == 0 else None
        segment(axes, line.point, line.direction, size, color=TRANSVERSAL, linewidth=1.5, linestyle="--", label=label)
    near = singular.isolated_points[(np.abs(singular.isolated_points) < size).all(axis=1)]
    axes.scatter(*near.T, color=ISOLATED, s=30, label="isolated points", depthshade=False)
    for point in near:
        motion = singular.unobservable_motions(point)[0]
        axes.quiver(*point, *(0.9 * motion.angular), color=ISOLATED, linewidth=1)
    axes.set(xlabel="X [m]", ylabel="Y [m]", zlabel="Z [m]", xlim=(-size, size), ylim=(-size, size), zlim=(-size, size))
    axes.legend(loc="upper left")
    axes.set_title(f"{len(near)} of the six isolated points, with the axes of the lost screws")
    save(figure, "theory_scene")


def three_lines() -> None:
    """The quadric and the cubic of the first three lines."""
    singular = singular_set(FOUR.select([0, 1, 2]))
    figure = plt.figure(figsize=(9.6, 4.6))
    for column, surface in enumerate(singular.surfaces):
        axes = figure.add_subplot(1, 2, column + 1, projection="3d")
        triangles = surface_triangles(surface, [0, 0, 0], 4.0, 28)
        color = "#8fb0d0" if column == 0 else "#d9b38c"
        mesh = Poly3DCollection(triangles, facecolor=color, edgecolor="none", alpha=0.55)
        axes.add_collection3d(mesh)
        for i in range(3):
            segment(axes, FOUR.point[i], FOUR.direction[i], 4.0, color=OBSERVED, linewidth=2)
        axes.set(xlim=(-4, 4), ylim=(-4, 4), zlim=(-4, 4), xlabel="X [m]", ylabel="Y [m]", zlabel="Z [m]")
        axes.set_title("G = 0: a common transversal" if column == 0 else "H = 0: coplanar perpendiculars")
    save(figure, "theory_three_lines")


def sampled_forms(w: np.ndarray, direction: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Q and R of the text at axis directions w (k, 3)."""
    across = w[:, np.newaxis] - (w @ direction.T)[..., np.newaxis] * direction
    rows = np.concatenate([across, (across * point).sum(axis=2, keepdims=True)], axis=2)
    turn = -(w @ direction.T)[..., np.newaxis] * np.cross(w[:, np.newaxis], direction)
    turned = np.concatenate([turn, (turn * point).sum(axis=2, keepdims=True)], axis=2)
    quintic = np.zeros(len(w))
    for i in range(4):
        replaced = rows.copy()
        replaced[:, i] = turned[:, i]
        quintic += np.linalg.det(replaced)
    return np.linalg.det(rows), quintic


def axis_plane() -> None:
    """The quartic and the quintic in the plane of axis directions, drawn on a hemisphere seen from above."""
    singular = singular_set(FOUR)
    frame = singular.frame
    axis = np.array([singular.unobservable_motions(p)[0].angular for p in singular.isolated_points])
    marked = np.concatenate([frame.direction, axis, at_infinity(frame.direction)])
    # Seen from where the marks are closest to the middle.
    view = np.linalg.eigh(marked.T @ marked)[1].T
    view = view if np.linalg.det(view) > 0 else -view
    ticks = np.linspace(-1, 1, 901)
    x, y = np.meshgrid(ticks, ticks)
    z = np.sqrt(np.maximum(0.0, 1.0 - x * x - y * y))
    w = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    quartic, quintic = sampled_forms(w @ view, frame.direction, frame.point)
    outside = (x * x + y * y > 1.0).ravel()
    figure, axes = plt.subplots(figsize=(6.2, 6.2))
    for values, color in ((quartic, OBSERVED), (quintic, TRANSVERSAL)):
        shown = np.where(outside, np.nan, values).reshape(x.shape)
        axes.contour(x, y, shown, levels=[0.0], colors=[color], linewidths=1.3)
    axes.plot([], [], color=OBSERVED, label="Q = 0 (quartic)")
    axes.plot([], [], color=TRANSVERSAL, label="R = 0 (quintic)")
    axes.add_patch(plt.Circle((0, 0), 1, fill=False, color="k", linewidth=0.8))
    for group, mark, color, label in (
        (frame.direction, "s", OTHER, "w = u_i"),
        (axis, "o", ISOLATED, "isolated singularities"),
        (at_infinity(frame.direction), "^", "k", "camera at infinity"),
    ):
        seen = group @ view.T
        seen = np.where(seen[:, 2:] < 0, -1, 1) * seen
        axes.plot(*seen[:, :2].T, mark, color=color, markersize=8, label=label)
    axes.set(aspect="equal", xticks=[], yticks=[], title="Half the sphere of axis directions w")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, 0.02), ncol=2, fontsize=8, frameon=False)
    save(figure, "theory_axis_plane")


def at_infinity(direction: np.ndarray) -> np.ndarray:
    """The real w, upper hemisphere, with all P_i w in one plane: w and c of rank-two tensors across all P_i."""
    projections = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    index = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    rows = np.array([[(1 if i == j else 2) * p[i, j] for i, j in index] for p in projections])
    null = np.linalg.svd(rows)[2][4:]
    first, second = (tensor_of(v, index) for v in null)
    grid = np.array([0.0, 1.0, -1.0, 2.0])
    cubic = np.polyfit(grid, [np.linalg.det(first + t * second) for t in grid], 3)
    found = []
    for root in np.roots(cubic):
        if abs(root.imag) > 1e-9:
            continue
        value, vector = np.linalg.eigh(first + root.real * second)
        if value[0] * value[2] < 0:
            for sign in (-1, 1):
                w = np.sqrt(value[2]) * vector[:, 2] + sign * np.sqrt(-value[0]) * vector[:, 0]
                w /= np.linalg.norm(w)
                found.append(w if w[2] > 0 else -w)
    return np.array(found).reshape(-1, 3)


def tensor_of(v: np.ndarray, index: list[tuple[int, int]]) -> np.ndarray:
    """The symmetric matrix with the given upper entries."""
    tensor = np.zeros((3, 3))
    for value, (i, j) in zip(v, index, strict=True):
        tensor[i, j] = tensor[j, i] = value
    return tensor


def histogram(survey: Path) -> None:
    """How many real isolated points occur."""
    records = [json.loads(line) for line in survey.read_text().splitlines()][1:]
    elliptic = np.sum([record["elliptic"] for record in records], axis=0)
    hyperbolic = np.sum([record["hyperbolic"] for record in records], axis=0)
    total = elliptic.sum() + hyperbolic.sum()
    figure, axes = plt.subplots(figsize=(6.4, 3.8))
    counts = np.arange(11)
    axes.bar(counts, 100 * elliptic / total, color=OBSERVED, label="no real transversal")
    axes.bar(counts, 100 * hyperbolic / total, bottom=100 * elliptic / total, color=TRANSVERSAL, label="two")
    for count in counts[::2]:
        share = 100 * (elliptic + hyperbolic)[count] / total
        axes.text(count, share + 0.6, f"{share:.2f} %", ha="center", fontsize=9)
    axes.set(xlabel="real isolated points", ylabel="share of scenes [%]", xticks=counts, ylim=(0, 48))
    axes.set_title(f"{total:,} random scenes of four lines")
    axes.legend()
    save(figure, "theory_histogram")


def save(figure: plt.Figure, name: str) -> None:
    """Write a figure next to this file."""
    figure.tight_layout()
    figure.savefig(HERE / f"{name}.png", dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    scene()
    three_lines()
    axis_plane()
    if len(sys.argv) > 1:
        histogram(Path(sys.argv[1]))
