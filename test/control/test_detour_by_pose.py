# SPDX-License-Identifier: Apache-2.0
"""The law detour in a closed loop past a transversal: straight where the pose is known, else round."""

import dataclasses

import numpy as np
import pytest

from plsing_ros.control.servo_controller import ServoController
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.planning.detour import Decision
from plsing_ros.simulation import near_transversal
from plsing_ros.singularities import singular_set

LINES = read_scene(config_file("paper_p4l.yaml"))
TARGET = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)
TRANSVERSAL = singular_set(LINES).transversals[0]
FOOT = TRANSVERSAL.point + TRANSVERSAL.direction * (TRANSVERSAL.direction @ (TARGET.translation - TRANSVERSAL.point))
# As far beyond the transversal as the target is before it.
START = Pose(TARGET.rotation, 2.0 * FOOT - TARGET.translation)
PERIOD = 1.0 / 30.0


def run(seconds, covariance=None, source="", first="", frames_of_it=0):
    """Go by lines of a source, and of another one in the first frames.

    Return the controller, how far from the target the camera ends [m], how long its path was [m], and the laws."""
    servo = ServoController(LINES, TARGET, law="detour", gain=1.0)
    camera, length, laws = START, 0.0, set()
    for k in range(round(seconds / PERIOD)):
        stamp = 10**12 + round(k * PERIOD * 1e9)
        seen = LineObservation.of_lines(LINES.transformed(camera.inverse(), "camera"))
        if covariance is not None:
            servo.receive_pose(camera, stamp, covariance)
        command = servo.answer(
            dataclasses.replace(seen, lines_source=first if k < frames_of_it else source), stamp, stamp
        )
        laws.add(servo.law)
        length += float(np.linalg.norm(command.twist[:3])) * PERIOD
        camera = camera.integrate(command.twist, PERIOD)
    return servo, float(np.linalg.norm(camera.translation - TARGET.translation)), length, laws


@pytest.mark.parametrize("source", ["", "filter"])
def test_a_known_pose_leads_straight_across(source):
    servo, off, length, laws = run(12.0, 1e-6 * np.eye(6), source)
    assert servo.plan.by_pose and laws == {"fused"}
    way = float(np.linalg.norm(START.translation - TARGET.translation))
    assert off < 1e-3 and length < 1.01 * way


@pytest.mark.parametrize(("covariance", "source"), [(None, ""), (1e-6 * np.eye(6), "image")])
def test_a_pose_that_the_image_alone_shows_leads_round(covariance, source):
    servo, _, _, laws = run(0.2, covariance, source)
    assert servo.plan.decision is Decision.DETOUR and not servo.plan.by_pose and laws == {"detour"}


def test_a_filter_that_begins_with_an_image_leads_straight_across_as_well():
    servo, off, length, laws = run(14.0, 1e-6 * np.eye(6), "filter", "image", 3)
    assert servo.plan.by_pose and laws == {"detour", "fused"}
    assert off < 1e-3 and length < 1.05 * float(np.linalg.norm(START.translation - TARGET.translation))
