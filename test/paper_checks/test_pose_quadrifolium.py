# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from paper.pose_quadrifolium import EXPERIMENTS, pose_error, run, save_figure
from plsing_ros.geometry import Pose
from plsing_ros.pose import Verdict
from plsing_ros.singularities import singular_set


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda experiment: experiment.name)
def test_trajectory_is_a_quadrifolium_about_its_center(experiment):
    poses = experiment.poses(401)
    offset = np.array([pose.translation for pose in poses]) - experiment.center
    flat = offset[:, 2 if experiment.turned else 0]
    np.testing.assert_allclose(flat, 0.0, atol=1e-12)
    assert np.linalg.norm(offset, axis=1).max() == pytest.approx(0.3)
    assert np.linalg.norm(offset[50]) == pytest.approx(0.0, abs=1e-12)
    seen = experiment.scene.transformed(poses[0].inverse(), "camera")
    assert np.hypot(seen.moment[:, 0], seen.moment[:, 1]).min() > 0.1


@pytest.mark.parametrize(
    ("number", "distance"), [(0, 1.0), (1, 0.0), (2, 0.0), (3, 0.0), (4, 0.1)], ids=["1", "P1", "L_M", "5 L_M", "5"]
)
def test_centers_are_where_the_paper_says(number, distance):
    experiment = EXPERIMENTS[number]
    loci = [each for each in singular_set(experiment.scene).distances(experiment.center) if "line" not in each.name]
    found = loci[0].distance
    assert found > distance if distance else found < 2e-3


def test_errors_are_those_that_the_noise_allows():
    away, on_locus = (run(EXPERIMENTS[i], (1,), 24) for i in (0, 2))
    assert (away.verdict == Verdict.OK.value).all()
    assert away.refined_translation.max() < 0.005
    assert away.refined_rotation.max() < 0.001
    ok = on_locus.verdict == Verdict.OK.value
    assert not ok.all()
    assert on_locus.refined_translation[ok].max() < 0.1
    assert on_locus.summary(on_locus.refined_translation)[0] > away.summary(away.refined_translation)[0]


def test_the_same_seed_gives_the_same_errors_and_a_figure(tmp_path):
    first, second = (run(EXPERIMENTS[4], (3,), 8) for _ in range(2))
    np.testing.assert_array_equal(first.refined_translation, second.refined_translation)
    save_figure(first, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_pose_error_is_distance_and_angle():
    first = Pose(np.eye(3), np.zeros(3))
    assert pose_error(first, first.integrate([3.0, 4.0, 0.0, 0.0, 0.0, 0.0], 1.0)) == pytest.approx((5.0, 0.0))
    assert pose_error(first, first.integrate([0.0, 0.0, 0.0, 0.0, 0.3, 0.4], 1.0)) == pytest.approx((0.0, 0.5))
