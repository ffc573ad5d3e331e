# SPDX-License-Identifier: Apache-2.0
"""Claims about pose estimation on made-up errors."""

import numpy as np

from paper.pose_checks import check_poses, pose_table
from paper.pose_quadrifolium import EXPERIMENTS, QuadrifoliumErrors

SAMPLES = 41


def errors(number, first, refined, peak=1.0, rotation=1e-4):
    """Errors of those sizes, that many times larger where the pattern crosses its middle."""
    experiment = EXPERIMENTS[number]
    centers = np.array([pose.translation for pose in experiment.poses(SAMPLES)])
    near = np.linalg.norm(centers - experiment.center, axis=1) < 0.02
    factor = np.where(near, peak, 1.0)[np.newaxis]
    fields = {name: np.zeros((1, SAMPLES, 3)) for name in ("first_center", "refined_center")}
    fields.update(first_translation=first * factor, refined_translation=refined * factor)
    fields.update(first_rotation=rotation * factor, refined_rotation=rotation * factor)
    s = np.linspace(0.0, 2.0 * np.pi, SAMPLES)
    fields["verdict"] = np.zeros((1, SAMPLES), dtype=int)
    return QuadrifoliumErrors(experiment=experiment, parameter=s, true_center=centers, **fields)


AS_PRINTED = (
    errors(0, 1e-3, 1e-4),
    errors(1, 2e-3, 5e-5, peak=600.0),
    errors(2, 1e-2, 1e-3, peak=1e6),
    errors(3, 1e-2, 1e-3, peak=1e6),
    errors(4, 1e-3, 5e-5),
)


def test_errors_as_the_paper_tells_of_them_fulfil_all_claims():
    assert [paper_check.holds for paper_check in check_poses(AS_PRINTED)] == [True] * 7


def test_errors_that_are_the_same_everywhere_do_not():
    flat = tuple(errors(number, 0.02, 0.02, rotation=0.01) for number in range(5))
    assert [paper_check.holds for paper_check in check_poses(flat)] == [False, False, False, True, False, False, False]


def test_samples_without_a_pose_count_as_failures():
    without = errors(2, 1e-2, 1e-3)
    without.first_translation[0, 5] = without.refined_translation[0, 5] = np.inf
    paper_checks = check_poses((*AS_PRINTED[:2], without, *AS_PRINTED[3:]))
    assert paper_checks[4].holds and "no pose" in paper_checks[4].measured
    assert "| no pose |" in pose_table([without])
