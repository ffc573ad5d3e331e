# SPDX-License-Identifier: Apache-2.0
"""Arrays of another shape, type or order than a native function asks for."""

import numpy as np
import pytest

from plsing_ros import _core

COSTS = np.array([20.0, 12.0])
FOUR = np.ones((4, 11)), np.ones((4, 6)), np.ones(3)
POSES = np.ones((2, 3, 3)), np.ones((2, 3))
SCENE, FORMS, MAPS = np.ones((2, 1, 4, 3)), np.ones((2, 3)), (np.eye(15), np.ones((3, 10, 15)))


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("svd", (np.ones((12, 7)),)),
        ("svd", (np.ones((6, 12)).T,)),
        ("svd", (np.ones((12, 6), dtype=np.float32),)),
        ("svd", (np.ones((12, 6), dtype=complex),)),
        ("svd", (np.ones(12),)),
        ("svd", ([[1.0, 2.0], [3.0, 4.0]],)),
        ("solve", (np.ones((12, 6)), np.ones(11), 1.0, 0.0)),
        ("solve", (np.ones((12, 7)), np.ones(12), 1.0, 0.0)),
        ("compute_twist", (*np.ones((2, 4, 3)), np.ones(12), np.ones(9), 1e-9, 0.1, 0.0)),
        ("subtract", (np.ones(4), np.ones(3))),
        ("interaction_matrix", (np.ones((2, 3)), np.ones((3, 3)), 1e-9)),
        ("interaction_matrix", (np.ones((2, 4)), np.ones((2, 4)), 1e-9)),
        ("interaction_conditioning", (None, np.ones((2, 3)), 1e-9)),
        ("image_residuals", (np.ones((3, 11)), *FOUR[1:], *POSES)),
        ("image_residuals", (np.ones((0, 11)), np.ones((0, 6)), np.ones(3), *POSES)),
        ("image_residuals", (*FOUR[:2], np.ones(4), *POSES)),
        ("image_jacobians", (*FOUR, np.ones((2, 9)), POSES[1])),
        ("refine_poses", (*FOUR, np.ones((2, 3)), *POSES, 3)),
        ("search_poses", (*FOUR, POSES[0], np.ones((3, 3)), COSTS)),
        ("search_poses", (*FOUR, *POSES, np.ones(3))),
        ("cheapest_different", (POSES[0], np.ones(3), 2)),
        ("translations", (POSES[0], np.ones((4, 3)), np.ones((5, 3)))),
        ("translations", (POSES[0], np.ones((0, 3)), np.ones((0, 3)))),
        ("pose_uncertainty", (*FOUR, np.eye(3), np.ones(3), np.ones(5))),
        ("triplet_rotations", (np.ones((2, 3, 3)), np.ones((3, 3, 3)), np.eye(9))),
        ("same_pose", (np.eye(3), np.ones(3), np.eye(3), np.ones(2), 1e-3)),
        ("singularity_ratios", (*SCENE, np.zeros((2, 3)), 0.0)),
        ("singularity_ratios", (*np.ones((2, 1, 2, 3)), np.zeros((2, 3), complex), 0.0)),
        ("singularity_ratios", (*np.ones((2, 2, 4, 3)), np.zeros((3, 3), complex), 0.0)),
        ("scene_coordinates", (np.ones((2, 4, 3)), np.ones((2, 3, 3)), 0.0, 0.0)),
        ("scene_coordinates", (np.ones(9), np.ones(9), 0.0, 0.0)),
        ("isolated_points", (*SCENE, FORMS, np.ones((14, 3)), *MAPS, 0.0, 0.0, 0.0)),
        ("isolated_points", (*np.ones((2, 1, 5, 3)), FORMS, np.ones((15, 3)), *MAPS, 0.0, 0.0, 0.0)),
    ],
)
def test_arrays_that_do_not_fit_are_refused(name, arguments):
    with pytest.raises(ValueError, match="must"):
        getattr(_core, name)(*arguments)
