# SPDX-License-Identifier: Apache-2.0
"""A camera on a target beside a singularity, with noise: detour stays, led by the image alone it wanders off."""

import numpy as np
import pytest

from plsing_ros.control.servo_controller import ServoController
from plsing_ros.features import interaction_matrix
from plsing_ros.geometry import Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation import near_transversal
from plsing_ros.simulation.simulated_camera import SimulatedCamera
from plsing_ros.singularities import singular_set

LINES = read_scene(config_file("paper_p4l.yaml"))
TRANSVERSAL = singular_set(LINES).transversals[0]
START = np.array(near_transversal.STARTS[1].position)
FOOT = TRANSVERSAL.point + TRANSVERSAL.direction * (TRANSVERSAL.direction @ (START - TRANSVERSAL.point))
TARGET = Pose.from_quaternion(FOOT + 0.05 * (START - FOOT) / np.linalg.norm(START - FOOT), near_transversal.ORIENTATION)
NOISE, TIME_STEP, FRAMES = 2e-3, 0.04, 600
ROWS = {"lines.points": tuple(LINES.point.ravel()), "lines.directions": tuple(LINES.direction.ravel())}
TARGET_VALUES = {"target.position": tuple(TARGET.translation), "target.orientation": tuple(TARGET.quaternion_xyzw)}


def distances(values, start=TARGET, frames=FRAMES, noise=NOISE):
    """How far from the target the camera is, frame by frame [m]."""
    servo = ServoController.from_parameters(ControllerParameters.from_values({**ROWS, **TARGET_VALUES, **values}))
    camera, result = SimulatedCamera(LINES, start, "camera_optical_frame", noise, seed=1), []
    for k in range(frames):
        stamp = 10**12 + round(k * TIME_STEP * 1e9)
        camera.move(servo.answer(camera.observe(), stamp, stamp).twist, TIME_STEP)
        result.append(np.linalg.norm(camera.T_world_camera.translation - TARGET.translation))
    return np.array(result)


def test_the_goal_is_beside_a_singularity():
    L = interaction_matrix(LINES.transformed(TARGET.inverse(), "camera"))
    assert np.linalg.svd(L, compute_uv=False)[-1] < 1e-3


def test_detour_holds_it():
    assert distances({"law": "detour"}).max() < 0.01


@pytest.mark.parametrize("values", [{"law": "adaptive_dls"}, {"law": "detour", "detour.pose_onset": 0.0}])
def test_the_image_alone_does_not(values):
    assert distances(values).max() > 0.05
