# SPDX-License-Identifier: Apache-2.0
"""The least observable direction in words, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from messages import mentions

from paper.scenes import four_lines
from plsing_ros.geometry import Pose
from plsing_ros.monitoring.unobservable_motion_text import unobservable_motion_text
from plsing_ros.singularities import Kind, LocusDistance, singular_set

SINGULAR = singular_set(four_lines())
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
# A screw of pitch 0.5 m/rad about the axis through (4, 6, 0) along z, with 2 rad/s, as a camera at (1, 2, 3) moves.
SCREW = np.array([8.0, -6.0, 1.0, 0.0, 0.0, 2.0])


@pytest.mark.parametrize("rotation", [np.eye(3), QUARTER])
def test_a_screw_is_told_by_its_axis_in_the_scene(rotation):
    in_camera = np.concatenate([rotation.T @ SCREW[:3], rotation.T @ SCREW[3:]])
    text = unobservable_motion_text(in_camera, Pose(rotation, np.array([1.0, 2.0, 3.0])), SINGULAR, None)
    assert mentions(text, "screw", "(4, 6, 3)", "(0, 0, 1)", "0.5 m/rad") and "camera" not in text


def test_without_a_pose_it_is_told_in_the_camera_frame():
    text = unobservable_motion_text(SCREW, None, SINGULAR, None)
    assert mentions(text, "screw", "(3, 4, 0)", "(0, 0, 1)", "0.5 m/rad", "camera frame")
    along = np.concatenate([2.0 * SINGULAR.transversals[0].direction, np.zeros(3)])
    assert mentions(unobservable_motion_text(along, None, SINGULAR, None), "translation", "camera frame")


def test_of_two_transversals_along_the_motion_the_nearest_locus_is_named():
    first = SINGULAR.transversals[0]
    both = replace(SINGULAR, transversals=(first, replace(first, name="transversal 2")))
    along, pose = np.concatenate([first.direction, np.zeros(3)]), Pose(np.eye(3), np.zeros(3))
    nearest = LocusDistance(Kind.TRANSVERSAL, "transversal 2", 0.1, np.zeros(3))
    for near, name, other in ((nearest, "transversal 2", "transversal 1"), (None, "transversal 1", "transversal 2")):
        text = unobservable_motion_text(along, pose, both, near)
        assert mentions(text, "translation", name) and other not in text


def test_another_translation_is_told_by_its_direction():
    across = np.cross(SINGULAR.transversals[0].direction, SINGULAR.transversals[1].direction)
    sideways = np.concatenate([-across, np.zeros(3)])
    x, y, z = -across / np.linalg.norm(across)
    text = unobservable_motion_text(sideways, Pose(np.eye(3), np.zeros(3)), SINGULAR, None)
    assert mentions(text, "translation", f"({x:.3g}, {y:.3g}, {z:.3g})") and "transversal" not in text
