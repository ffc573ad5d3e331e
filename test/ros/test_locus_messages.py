# SPDX-License-Identifier: Apache-2.0
"""singular_loci against what makes a locus one: at its points the interaction matrix of the lines loses rank."""

import numpy as np
import pytest
from std_msgs.msg import Header

from plsing_msgs.msg import LocusDistance
from plsing_ros.features import interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.nodes.locus_conversions import loci_message
from plsing_ros.parameters.config_files import config_file
from plsing_ros.singularities import singular_set

PAPER = read_scene(config_file("paper_p4l.yaml"))
SCENES = {
    "four lines": PAPER,
    "three lines": PAPER.select([0, 1, 2]),
    "window": LineSet.from_points_directions(
        [[0, 0, 0], [0, 0, 1.2], [0, 0, 0], [0.9, 0, 0], [0.4, 0, 0]], [[1, 0, 0]] * 2 + [[0, 0, 1]] * 3
    ),
    "shaft": LineSet.from_points_directions(
        [[0, 0, 0], [4, 0, 0], [0, 3, 0], [4, 3, 0], [2, 0, 8], [2, 3, 8]], [[0, 0, 1]] * 4 + [[1, 0, 0]] * 2
    ),
}
# In no special place of any of these scenes.
BESIDE = np.array([[0.7, 0.9, 0.4], [-0.5, 0.8, 0.6], [0.3, -0.7, 0.9]])


def condition(lines, center):
    """The inverse condition number of a camera there, looking past all lines."""
    pose = Pose.look_at(center, center + np.array([0.3, 0.5, 0.8]))
    values = np.linalg.svd(interaction_matrix(lines.transformed(pose.inverse(), "camera")), compute_uv=False)
    return values[5] / values[0]


@pytest.mark.parametrize("name", SCENES)
def test_each_locus_is_there_with_a_shape_that_is_singular(name):
    lines = SCENES[name]
    singular = singular_set(lines)
    message = loci_message(singular, Header(frame_id="world"))
    assert [each.name for each in message.loci] == [
        each for each in singular.locus_names if not each.startswith("line ")
    ]
    beside = np.median([condition(lines, singular.frame.center + singular.frame.length * each) for each in BESIDE])
    for locus in message.loci:
        assert locus.frame_id == "world" and locus.half_width_valid and locus.half_width > 0.0
        numbers = np.concatenate([locus.segments, locus.triangles, locus.coefficients])
        assert len(numbers) and np.isfinite(numbers).all()
        points = np.reshape(locus.segments, (-1, 3))
        if len(locus.triangles):
            assert locus.kind in (LocusDistance.KIND_PLANE, LocusDistance.KIND_QUADRIC, LocusDistance.KIND_CUBIC)
            points = on_the_zeros(locus, np.reshape(locus.triangles, (-1, 3))[::97], singular.frame.length)
        for point in points[:: max(1, len(points) // 10)]:
            assert condition(lines, point) < 1e-5 * beside


def on_the_zeros(locus, points, length):
    """The points moved onto the zeros of the message's polynomial, which are less than a cell away."""
    exponents, coefficients = np.reshape(locus.exponents, (-1, 3)).astype(int), np.array(locus.coefficients)

    def value_and_gradient(point):
        value = coefficients @ np.prod(point**exponents, axis=1)
        gradient = [
            coefficients
            @ (exponents[:, axis] * np.prod(point ** np.maximum(exponents - np.eye(3, dtype=int)[axis], 0), axis=1))
            for axis in range(3)
        ]
        return value, np.array(gradient)

    moved = points.copy()
    for row in range(len(points)):
        for _ in range(20):
            value, gradient = value_and_gradient(moved[row])
            moved[row] -= value * gradient / max(gradient @ gradient, 1e-30)
    near = np.linalg.norm(moved - points, axis=1) < 0.2 * length
    assert near.mean() > 0.9
    return moved[near]


def test_a_scene_that_is_singular_everywhere_says_so():
    lines = LineSet.from_points_directions([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1]] * 3)
    (locus,) = loci_message(singular_set(lines), Header(frame_id="world")).loci
    assert (locus.kind, locus.name, locus.half_width_valid) == (LocusDistance.KIND_EVERYWHERE, "everywhere", False)
    assert not len(locus.segments) and not len(locus.triangles)
