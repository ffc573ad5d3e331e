# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from pose_scenes import arrays, image_covariances, image_of, random_view, views
from strategies import twists

from plsing_ros.features import interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.pose.residuals import ImageResiduals, LineNoise, known_lines, residual_settings

NOISES = [LineNoise(1e-3), LineNoise(0.0, 1e-3), LineNoise(2e-3, 1e-3, 3e-3)]


def image_residuals(lines, image, noise, *angle):
    return ImageResiduals(known_lines(lines), image, residual_settings(noise, *angle))


def residuals_of(lines, image, noise, *poses):
    return image_residuals(lines, image, noise).at(*arrays(*poses))


@settings(max_examples=40)
@given(view=views(), twist=twists())
def test_residuals_are_differences_of_projections_and_jacobians_their_derivatives(view, twist):
    lines, pose = view
    image = image_of(lines, pose.integrate(0.01 * twist, 1.0)).image_lines
    step = 1e-6
    at = residuals_of(lines, image, NOISES[0], pose, pose.integrate(twist, step), pose.integrate(twist, -step))
    line = image_of(lines, pose).image_lines.copy()
    against = np.einsum("ij,ij->i", line[:, :2], image[:, :2]) < 0.0
    line[against] *= -1.0
    turn = np.arctan2(line[:, 1], line[:, 0]) - np.arctan2(image[:, 1], image[:, 0])
    np.testing.assert_allclose(np.exp(1j * at.raw[0, 0]), np.exp(1j * turn), atol=1e-9)
    np.testing.assert_allclose(at.raw[0, 1], line[:, 2] - image[:, 2], atol=1e-9 * (1.0 + np.abs(line[:, 2]).max()))
    assert (at.reversed[0] == against).all()
    expected = (at.raw[1] - at.raw[2]) / (2.0 * step)
    found = NOISES[0].image * at.jacobian[0] @ twist
    np.testing.assert_allclose(found, expected, atol=1e-4 * (1.0 + np.abs(expected).max()))


def test_jacobian_has_the_singular_values_of_the_interaction_matrix():
    lines, pose = random_view(np.random.default_rng(4), 5)
    at = residuals_of(lines, image_of(lines, pose).image_lines, NOISES[0], pose)
    matrix = interaction_matrix(lines.transformed(pose.inverse(), "camera"))
    np.testing.assert_allclose(
        np.linalg.svd(NOISES[0].image * at.jacobian[0].reshape(-1, 6), compute_uv=False),
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


def assert_whitened(lines, image, pose, at, covariance):
    """The whitened residuals and Jacobians are those of the covariance, shape (n, 2, 2)."""
    inverse, raw = np.linalg.inv(covariance), at.raw[0]
    expected = np.einsum("in,nij,jn->n", raw, inverse, raw)
    np.testing.assert_allclose(at.squared[0], expected, rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(at.log_determinant[0], np.log(np.linalg.det(covariance)), atol=1e-4)
    exact = LineSet(lines.direction, lines.moment, lines.frame)
    slope = NOISES[0].image * residuals_of(exact, image, NOISES[0], pose).jacobian[0]
    normal = np.einsum("ina,nij,jnb->nab", slope, inverse, slope)
    found = np.einsum("ina,inb->nab", at.jacobian[0], at.jacobian[0])
    size = np.abs(normal).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found / size, normal / size, atol=1e-4)


@pytest.mark.parametrize("noise", NOISES, ids=["image", "scene", "all"])
@pytest.mark.parametrize("seed", range(5))
def test_what_is_whitened_has_the_covariance_of_the_noise(seed, noise):
    lines, pose = random_view(np.random.default_rng(seed), 6)
    image = image_of(lines, pose.integrate(np.full(6, 0.01), 1.0)).image_lines
    covariance = image_covariances(lines, pose, noise.image, noise.scene, noise.camera)
    assert_whitened(lines, image, pose, residuals_of(lines, image, noise, pose), covariance)


def map_covariances(lines, pose):
    """What the tolerances of the lines make of angle and offset, by central differences, shape (n, 2, 2)."""
    total = np.zeros((len(lines), 2, 2))
    for i, u in enumerate(lines.direction):
        for across in np.linalg.svd(u[np.newaxis])[2][1:]:
            for shift, turn in ((lines.position_std[i] * across, 0.0 * u), (0.0 * u, lines.direction_std[i] * across)):
                ends = []
                for sign in (-1e-3, 1e-3):
                    moved = LineSet.from_points_directions([lines.pivot[i] + sign * shift], [u + sign * turn])
                    ends.append(image_of(moved, pose).image_lines[0])
                sine = ends[0][0] * ends[1][1] - ends[0][1] * ends[1][0]
                change = np.array([np.arcsin(sine), ends[1][2] - ends[0][2]]) / 2e-3
                total[i] += np.outer(change, change)
    return total


@pytest.mark.parametrize("seed", range(5))
def test_what_is_whitened_has_the_covariance_of_image_and_map(seed):
    generator = np.random.default_rng(seed)
    lines, pose = random_view(generator, 5)
    lines = LineSet.from_points_directions(
        lines.point + lines.direction * generator.normal(size=(5, 1)),
        lines.direction,
        position_std=generator.uniform(0.0, 0.02, size=5),
        direction_std=generator.uniform(0.0, 0.02, size=5),
    )
    root = 1e-3 * generator.normal(size=(5, 2, 2))
    own = root @ root.transpose(0, 2, 1) + 1e-8 * np.eye(2)
    image = image_of(lines, pose).image_lines
    columns = np.stack([own[:, 0, 0], own[:, 0, 1], own[:, 1, 1]], axis=1)
    at = ImageResiduals(known_lines(lines), image, residual_settings(LineNoise(0.0)), columns).at(*arrays(pose))
    assert_whitened(lines, image, pose, at, own + map_covariances(lines, pose))


@pytest.mark.parametrize(("height", "angle", "hidden"), [(3.0, 1.57, False), (-3.0, 1.04, True), (-3.0, 1.52, False)])
def test_a_line_behind_the_camera_is_hidden_unless_it_comes_into_the_field_of_view(height, angle, hidden):
    lines = LineSet.from_points_directions([[0.0, 1.0, height]], [[1.0, 0.0, 0.1]], "world")
    camera = Pose(np.eye(3), np.zeros(3))
    at = image_residuals(lines, image_of(lines, camera).image_lines, NOISES[0], angle).at(*arrays(camera))
    assert at.hidden[0, 0] == hidden


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
    image = image_of(lines, pose).image_lines
    hidden = image_residuals(lines, image, NOISES[0], largest).at(*arrays(pose)).hidden[0]
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
