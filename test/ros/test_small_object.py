# SPDX-License-Identifier: Apache-2.0
"""The scene for a real camera: the whole chain with an estimated pose arrives, through the nodes."""

import numpy as np

from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.testing.lockstep import run_lockstep

FILE = config_file("small_object.yaml")


def test_it_is_an_object_of_a_third_of_a_metre_and_the_nodes_bring_the_camera_to_its_target():
    lines = read_scene(FILE)
    assert 6 <= len(lines) <= 8
    assert np.ptp(lines.point, axis=0).max() <= 0.3
    run = run_lockstep("small object", FILE, {}, {}, 0.02, 1000, estimate_pose=True)
    assert run.arrived
    assert np.linalg.norm(run.twist[:, :3], axis=1).max() <= 0.1 + 1e-9
    assert run.inverse_condition_number.min() > 0.05
