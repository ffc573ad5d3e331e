# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from pose_scenes import image_of, random_view, views
from strategies import twists

from plsing_ros.features import interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.pose.residuals import ImageResiduals, LineNoise, known_lines, residual_settings

NOISES = [LineNoise(1e-3), LineNoise(0.0, 1e-3), LineNoise(2e-3, 1e-3, 3e-3)]


def image_residuals(lines, image, noise, *angle):
    return ImageResiduals(known_lines(lines), image, residual_settings(noise, *angle))


def residuals_of(lines, image, noise, *poses):
    seen = [pose.inverse() for pose in poses]
    return image_residuals(lines, image, noise).at(
        np.array([each.rotation for each in seen]), np.array([each.translation for each in seen])
    )


@settings(max_examples=40)
@given(view=views(), twist=twists())
def test_jacobian_matches_central_differences(view, twist):
    lines, pose = view
    image = image_of(lines, pose.integrate(0.01 * twist, 1.0)).image_lines
    step = 1e-6
    at = residuals_of(lines, image, NOISES[0], pose, pose.integrate(twist, step), pose.integrate(twist, -step))
    expected = (at.raw[1] - at.raw[2]) / (2.0 * step)
    found = np.einsum("ija,a->ij", at.raw_jacobian[0], twist)
    np.testing.assert_allclose(found, expected, atol=1e-4 * (1.0 + np.abs(expected).max()))


def test_jacobian_has_the_singular_values_of_the_interaction_matrix():
    lines, pose = random_view(np.random.default_rng(4), 5)
    at = residuals_of(lines, image_of(lines, pose).image_lines, NOISES[0], pose)
    matrix = interaction_matrix(lines.transformed(pose.inverse(), "camera"))
    np.testing.assert_allclose(
        np.linalg.svd(at.raw_jacobian[0].reshape(-1, 6), compute_uv=False),
        np.linalg.svd(matrix, compute_uv=False),
        rtol=1e-9,
    )


@settings(max_examples=30)
@given(view=views(3, 5))
def test_the_true_pose_has_none_and_reversed_lines_are_named(view):
    lines, pose = view
    image = image_of(lines, pose).image_lines.copy()
    image[1] *= -1.0
    at = residuals_of(lines, image, NOISES[0], pose)
    np.testing.assert_allclose(at.raw, 0.0, atol=1e-6)
    assert at.reversed[0].tolist() == [i == 1 for i in range(len(lines))]


@pytest.mark.parametrize("scene", [True, False], ids=["scene", "camera"])
def test_covariance_is_that_of_noisy_lines(scene):
    generator = np.random.default_rng(2)
    lines, pose = random_view(generator, 4)
    image = image_of(lines, pose).image_lines
    sigma, count = 1e-4, 4000
    noise = LineNoise(0.0, sigma, 0.0) if scene else LineNoise(0.0, 0.0, sigma)
    values = []
    for _ in range(count):
        exact = lines if scene else lines.transformed(pose.inverse(), "camera")
        direction = exact.direction + generator.normal(scale=sigma, size=(4, 3))
        moment = exact.moment + generator.normal(scale=sigma, size=(4, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        moment -= np.einsum("ij,ij->i", moment, direction)[:, np.newaxis] * direction
        noisy = LineSet(direction, moment, exact.frame)
        noisy = noisy if scene else noisy.transformed(pose, "world")
        values.append(residuals_of(noisy, image, noise, pose).value[0])
    values = np.array(values)
    # Whitened by the covariance of each noisy scene: independent and of variance 1, within five standard deviations.
    product = np.einsum("kin,kjn->nij", values, values) / count
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(2), (4, 2, 2)), atol=5.0 * np.sqrt(2.0 / count))


@settings(max_examples=40)
@given(view=views(3, 5))
def test_visible_is_what_sampling_the_lines_says(view):
    lines, pose = view
    seen = lines.transformed(pose.inverse(), "camera")
    largest = 0.6
    along = np.tan(np.linspace(-1.57, 1.57, 20001))
    points = seen.point[:, np.newaxis] + along[:, np.newaxis] * seen.direction[:, np.newaxis] * np.linalg.norm(
        seen.point, axis=1
    ).reshape(-1, 1, 1)
    cosine = (points[..., 2] / np.linalg.norm(points, axis=2)).max(axis=1)
    inverse = pose.inverse()
    image = image_of(lines, pose).image_lines
    model = image_residuals(lines, image, NOISES[0], largest)
    hidden = model.at(inverse.rotation[np.newaxis], inverse.translation[np.newaxis]).hidden[0]
    # Image lines that miss the field of view altogether are none that a tracker reports.
    reported = np.abs(image[:, 2]) / np.hypot(1.0, image[:, 2]) < np.sin(largest) - 1e-3
    clear = np.abs(cosine - np.cos(largest)) > 1e-3
    expected = cosine > np.cos(largest)
    assert (~hidden)[reported & clear].tolist() == expected[reported & clear].tolist()


def test_without_a_field_of_view_every_line_has_a_visible_part():
    for seed in range(5):
        lines, pose = random_view(np.random.default_rng(seed), 6)
        turned = Pose(pose.rotation @ np.diag([1.0, -1.0, -1.0]), pose.translation)
        for each in (pose, turned):
            assert not residuals_of(lines, image_of(lines, each).image_lines, NOISES[0], each).hidden.any()
