# SPDX-License-Identifier: Apache-2.0
"""Draws docs/figures/concept_frames.png: python3 docs/figures/concept_figures.py."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from plsing_ros.features import project_lines
from plsing_ros.geometry import LineSet

# The camera is drawn from behind, above and to the left: image of x (right), y (down) and z (forward) on the page.
PAGE = np.array([[0.80, 0.0, 0.66], [-0.16, -0.80, 0.40]])
POINT, DIRECTION = np.array([0.35, 0.35, 2.0]), np.array([0.55, -0.85, 0.2])
BLUE, RED, GREEN, GRAY = "#35618e", "#b03030", "#2f7d3b", "#666666"


def main() -> None:
    lines = LineSet.from_points_directions([POINT], [DIRECTION])
    direction, moment = lines.direction[0], lines.moment[0]
    ends = np.array([POINT + a * direction for a in (-0.5, 1.6)])
    figure, axes = plt.subplots(figsize=(7.2, 4.4), dpi=130)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_xlim(-0.75, 3.1)
    axes.set_ylim(-0.75, 1.85)

    corners = np.array([[-0.75, -0.62, 1], [0.75, -0.62, 1], [0.75, 0.62, 1], [-0.75, 0.62, 1]])
    axes.fill(*PAGE @ corners.T, facecolor="#eef3f8", edgecolor=BLUE, alpha=0.9)
    label(axes, corners[0], "image plane z = 1", BLUE, (-10, 8))
    axes.fill(*PAGE @ np.array([np.zeros(3), *ends]).T, facecolor="#f3d9a0", edgecolor="none", alpha=0.45)
    draw(axes, ends, RED, 2.5)
    arrow(axes, POINT, POINT + 0.55 * direction, RED)
    label(axes, POINT + 0.55 * direction, "u: direction, with sign", RED, (8, 0))
    label(axes, POINT, "x: a point of the line", RED, (8, -8))
    dot(axes, POINT, RED)

    seen = project_lines(lines)
    # Points of the image line at the upper and lower edge of the image: l'_x X + l'_y Y + l'_z = 0.
    image = np.array([[-(seen[1] * y + seen[2]) / seen[0], y, 1.0] for y in (0.62, -0.62)])
    draw(axes, image, GREEN, 2.5)
    label(axes, image[1], "image line l'", GREEN, (-20, 8))
    normal = 0.6 * moment / np.linalg.norm(moment)
    arrow(axes, np.zeros(3), normal, GREEN)
    label(axes, normal, "l = x × u: normal of the plane\nthrough camera centre and line", GREEN, (8, -14))
    for end, name in ((np.array([0.55, 0, 0]), "x: right"), (np.array([0, 0.6, 0]), "y: down")):
        arrow(axes, np.zeros(3), end, GRAY)
        label(axes, end, name, GRAY, (4, -3) if end[0] else (-50, 4))
    arrow(axes, np.zeros(3), np.array([0, 0, 1.45]), GRAY)
    label(axes, np.array([0, 0, 1.45]), "z: forward", GRAY, (4, 4))
    dot(axes, np.zeros(3), "black")
    label(axes, np.zeros(3), "camera centre", "black", (-78, 4))
    figure.savefig(Path(__file__).parent / "concept_frames.png", bbox_inches="tight", metadata={"Software": None})


def draw(axes, points, color, width):
    axes.plot(*PAGE @ np.asarray(points).T, color=color, linewidth=width, solid_capstyle="round")


def arrow(axes, start, end, color):
    style = {"arrowstyle": "-|>", "color": color, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 14}
    axes.annotate("", xy=PAGE @ end, xytext=PAGE @ start, arrowprops=style)


def dot(axes, point, color):
    axes.plot(*PAGE @ point, "o", color=color, markersize=5)


def label(axes, point, text, color, offset):
    axes.annotate(text, PAGE @ point, offset, textcoords="offset points", color=color, fontsize=9)


if __name__ == "__main__":
    main()
