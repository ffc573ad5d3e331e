# SPDX-License-Identifier: Apache-2.0
"""LineTracker on drawn images, whose truth is exact."""

import numpy as np
import pytest
from messages import mentions
from rendered import CAMERA, LENS, LIGHTS, QUADS, box, error, orbit, renderer
from scipy.spatial.transform import Rotation

from plsing_ros._core import compiled
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import project_lines
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.simulation.polygon_renderer import PolygonRenderer
from plsing_ros.tracking import LineTracker, PinholeCamera, TrackingState

pytest.importorskip("cv2")


def followed(tracker, images, start):
    return [tracker.track(image, start if k == 0 else None) for k, image in enumerate(images)]


@pytest.mark.parametrize(("distance", "state"), [(0.3, TrackingState.TRACKING), (1.0, TrackingState.WEAK)])
def test_a_face_seen_straight_on_from_afar_leaves_the_rotation_uncertain(distance, state):
    true, random = Pose.look_at([0.0, 0.001, distance], [0.0, 0.0, 0.0]), np.random.default_rng(0)
    drawing, tracker = renderer(background=0.02), LineTracker(box(), CAMERA)
    result = followed(tracker, [drawing.render(true.inverse(), 2.0, random) for _ in range(3)], true)[-1]
    assert result.state == state, result.reason
    assert ("rotation" in result.reason) == (state is TrackingState.WEAK)
    off = Rotation.from_matrix(result.T_world_camera.rotation @ true.rotation.T).as_rotvec()
    assert off @ np.linalg.solve(result.covariance[3:, 3:], off) < 12.0


@pytest.mark.parametrize(("camera", "patches", "noise"), [(CAMERA, 0, 2.0), (LENS, 25, 4.0)])
def test_a_moving_box_is_tracked_and_its_uncertainty_is_honest(camera, patches, noise):
    drawing = renderer(camera=camera, patches=patches, background=0.02)
    random = np.random.default_rng(1)
    true = [orbit(k) for k in range(90)]
    images = [drawing.render(pose.inverse(), noise, random) for pose in true]
    results = followed(LineTracker(box(), camera), images, true[0])
    assert all(each.state == TrackingState.TRACKING for each in results)
    errors = np.array([error(each.T_world_camera, pose) for each, pose in zip(results, true, strict=True)])
    assert np.median(errors[:, 0]) < 1.0e-3 and errors[:, 0].max() < 5e-3
    assert np.median(errors[:, 1]) < np.radians(0.1) and errors[:, 1].max() < np.radians(0.6)
    squares, squares_of_lines = [], []
    for each, pose in zip(results, true, strict=True):
        turn = Rotation.from_matrix(each.T_world_camera.rotation @ pose.rotation.T).as_rotvec()
        off = np.concatenate([each.T_world_camera.translation - pose.translation, turn])
        squares.append(off @ np.linalg.solve(each.covariance, off))
        image = project_lines(box().lines().transformed(pose.inverse(), "camera")).reshape(-1, 3)
        for row in np.flatnonzero(each.observation.usable):
            seen, (pp, pr, rr) = each.observation.image_lines[row], each.observation.covariances[row]
            angle = np.arctan2(np.linalg.det([image[row, :2], seen[:2]]), image[row, :2] @ seen[:2])
            d = np.array([angle, seen[2] - image[row, 2]])
            squares_of_lines.append(d @ np.linalg.solve([[pp, pr], [pr, rr]], d))
    # Of six and two degrees of freedom: neither over- nor much under-confident.
    assert 2.5 < np.mean(squares) < 9.0
    assert 0.2 < np.median(squares_of_lines) < 3.0


def test_edges_that_contradict_each_other_are_said_to():
    """A face that comes into view as a sliver has two edges side by side, and the wrong one may be taken."""
    drawing, random = renderer(background=0.02), np.random.default_rng(5)
    tracker = LineTracker(box(), CAMERA)
    tracker.start(orbit(24))
    for k in range(24, 42):
        result = tracker.track(drawing.render(orbit(k).inverse(), 2.0, random))
        if result.state == TrackingState.TRACKING:
            assert error(result.T_world_camera, orbit(k))[0] < 5e-3, k
    assert result.state == TrackingState.TRACKING


@pytest.mark.parametrize(("before", "now"), [(-0.008, 0.004), (0.0, 0.006), (-0.004, 0.01), (0.004, 0.012)])
def test_two_edges_do_not_rest_on_one_step_of_the_image(before, now):
    """A camera that comes out of a face's plane sees two edges side by side: both on one line is a pose, and wrong."""
    for seed in (0, 3, 7, 10):
        random = np.random.default_rng(seed)
        lights = tuple(random.permutation(np.linspace(0.12, 0.85, 6)))
        drawing = PolygonRenderer(box(), CAMERA, lights, 0.02)
        poses = [Pose.look_at((0.06 + out, 0.4, 0.2), (0.0, 0.0, 0.0)) for out in (before, now)]
        images = [drawing.render(pose.inverse(), 1.0, random) for pose in poses]
        result = followed(LineTracker(box(), CAMERA), images, poses[0])[-1]
        assert result.state != TrackingState.LOST
        off = result.T_world_camera.translation - poses[-1].translation
        assert off @ np.linalg.solve(result.covariance[:3, :3], off) < 25.0, (seed, 1e3 * np.linalg.norm(off))


def covered(image, pose, share, across, level, texture):
    """Cover a share of what is seen of the box: from one side, or in the middle if negative; grey, or painted."""
    corners = box().vertices @ pose.inverse().rotation.T + pose.inverse().translation
    low, high = (CAMERA.project(corners).min(axis=0), CAMERA.project(corners).max(axis=0))
    begin = low[across] - 3.0 if share > 0.0 else 0.5 * (low + high + share * (high - low))[across]
    end = begin + abs(share) * (high - low)[across]
    place: list[slice] = [slice(int(a) - 3, int(b) + 4) for a, b in zip(low[::-1], high[::-1], strict=True)]
    place[1 - across] = slice(int(begin), int(end))
    result = image.copy()
    rows, columns = np.mgrid[place[0], place[1]] - np.reshape([place[0].start, place[1].start], (2, 1, 1))
    result[tuple(place)] = level + 60 * ((rows // 9 + columns // 9) % 2) if texture else level
    return result


@pytest.mark.parametrize(("share", "across"), [(0.25, 0), (0.25, 1), (-0.25, 0)])
@pytest.mark.parametrize("patches", [0, 25])
def test_what_is_in_the_way_is_not_taken_for_the_object(share, across, patches):
    """A cover that goes with the object has edges of its own, near and parallel to the object's, and corners."""
    drawing, random = renderer(patches=patches, background=0.02), np.random.default_rng(4)
    for level, texture in ((30, False), (120, True)):
        tracker = LineTracker(box(), CAMERA)
        for k in range(45):
            image = drawing.render(orbit(k).inverse(), 2.0, random)
            if k >= 5:
                image = covered(image, orbit(k), share, across, level, texture)
            result = tracker.track(image, orbit(0) if k == 0 else None)
            if result.state == TrackingState.TRACKING:
                off = error(result.T_world_camera, orbit(k))
                assert off[0] < 0.02, (k, level, off, np.sqrt(np.trace(result.covariance[:3, :3])))


@pytest.mark.parametrize(("patches", "noise", "followed_points"), [(0, 3.0, False), (0, 8.0, False), (25, 8.0, True)])
def test_noise_on_a_plain_face_is_no_texture(patches, noise, followed_points):
    """Its corners are elsewhere in each image, and a pose by them would contradict the edges."""
    drawing, random = renderer(patches=patches, background=0.02), np.random.default_rng(3)
    images = [drawing.render(orbit(k).inverse(), noise, random) for k in range(4)]
    results = followed(LineTracker(box(), CAMERA), images, orbit(0))
    assert [each.point_count > 0 for each in results[1:]] == 3 * [followed_points]
    assert all(each.state == TrackingState.TRACKING for each in results)


def test_hidden_edges_are_those_that_a_ray_does_not_reach():
    corners = box(0.1, 0.1, 0.1)
    near = 0.4 * corners.vertices + [0.12, 0.02, 0.03]
    model = Model(
        np.vstack([corners.vertices, near]),
        np.vstack([corners.edges, corners.edges + 8]),
        corners.faces + tuple(tuple(i + 8 for i in face) for face in corners.faces),
    )
    camera = CAMERA.numbers, CAMERA.width, CAMERA.height, 2.2
    core = compiled.EdgeTracker(model.vertices, model.edges, model.triangles, model.edge_triangles, *camera)
    counts = [0, 0]
    for k in range(0, 200, 20):
        T_camera_world = orbit(k).inverse()
        seen = dict(core.samples(T_camera_world))
        corners_camera = model.vertices @ T_camera_world.rotation.T + T_camera_world.translation
        for row, (a, b) in enumerate(corners_camera[model.edges]):
            for share in np.linspace(0.2, 0.8, 4):
                # Moved towards the camera, so that the faces an edge borders do not hide it.
                near_by = [0.999 * (a + (share + step) * (b - a)) for step in (-0.05, 0.0, 0.05)]
                hidden = [_is_hidden(point, corners_camera[model.triangles]) for point in near_by]
                if len(set(hidden)) > 1 or np.linalg.norm(b[:2] / b[2] - a[:2] / a[2]) * 600 < 30:
                    continue
                image = near_by[1][:2] / near_by[1][2]
                there = row in seen and np.linalg.norm(seen[row] - image, axis=1).min() < 4 / 600
                assert there != hidden[1], (k, row, share)
                counts[hidden[1]] += 1
    assert min(counts) > 100


def _is_hidden(point, triangles):
    """Moeller and Trumbore's test of the segment from the camera to a point."""
    for a, b, c in triangles:
        matrix = np.column_stack([point, a - b, a - c])
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        distance, u, v = np.linalg.solve(matrix, a)
        if 0.0 < distance < 1.0 and u >= 0.0 and v >= 0.0 and u + v <= 1.0:
            return True
    return False


def test_what_is_not_seen_is_announced_and_found_again():
    drawing, random = renderer(patches=25), np.random.default_rng(2)
    tracker = LineTracker(box(), CAMERA)
    images = [drawing.render(orbit(k).inverse(), 2.0, random) for k in range(12)]
    for k, nothing in ((4, 0), (5, 0), (6, 255)):
        images[k] = np.full_like(images[k], nothing)
    results = followed(tracker, images, orbit(0))
    for k, result in enumerate(results):
        if 4 <= k <= 6:
            assert result.state == TrackingState.LOST and result.reason and not result.observation.usable.any()
        else:
            assert result.state == TrackingState.TRACKING and error(result.T_world_camera, orbit(k))[0] < 5e-3


@pytest.mark.parametrize("patches", [0, 25])
def test_after_a_jump_the_pose_is_right_or_there_is_none(patches):
    """A box that is seen from elsewhere in the next image looks much like one that has not moved."""
    drawing, random = renderer(background=0.02, patches=patches), np.random.default_rng(3)
    first, states = drawing.render(orbit(0).inverse(), 1.0, random), []
    for k in (12, 30, 38, 42, 50, 62, 66, 92, 110, 114):
        tracker = LineTracker(box(), CAMERA)
        tracker.track(first, orbit(0))
        image = drawing.render(orbit(k).inverse(), 1.0, random)
        for _ in range(3):
            result = tracker.track(image)
            states.append(result.state)
            if result.T_world_camera is not None:
                assert error(result.T_world_camera, orbit(k))[0] < 5e-3, k
            else:
                assert mentions(result.reason, "visible edges") and not result.observation.usable.any()
    assert {TrackingState.TRACKING, TrackingState.LOST} == set(states)


def test_faces_that_turn_away_from_a_shaking_camera_do_not_end_the_track():
    """Where images are far apart some edges are out of the usual range, and the rest leaves the pose open."""
    drawing, random = renderer(background=0.02), np.random.default_rng(1)
    images = [drawing.render(orbit(k).inverse(), 1.0, random) for k in range(44, 84)]
    for k, result in enumerate(followed(LineTracker(box(), CAMERA), images, orbit(44)), 44):
        assert result.state == TrackingState.TRACKING and error(result.T_world_camera, orbit(k))[0] < 5e-3, k


def test_a_first_pose_that_is_off_is_searched_for():
    drawing, random = renderer(background=0.02), np.random.default_rng(3)
    image = drawing.render(orbit(0).inverse(), 2.0, random)
    for _ in range(6):
        turn = Rotation.from_rotvec(np.radians(4.0) * random.normal(size=3) / np.sqrt(3.0)).as_matrix()
        tracker = LineTracker(box(), CAMERA)
        start = Pose(turn, 0.008 * random.normal(size=3) / np.sqrt(3.0)) @ orbit(0)
        tracker.start(start)
        result = tracker.track(image)
        assert result.state == TrackingState.TRACKING and error(result.T_world_camera, orbit(0))[0] < 5e-3


def test_a_flat_object_seen_from_afar_and_a_fine_prism_are_ambiguous():
    plate = Model.from_faces(
        0.5 * np.array([[-0.1, -0.07, 0], [0.1, -0.07, 0], [0.1, 0.07, 0], [-0.1, 0.07, 0]]), [range(4)]
    )
    afar = Pose.look_at((0.1, 0.15, 1.6), (0, 0, 0))
    image = renderer(plate).render(afar.inverse(), 1.0, np.random.default_rng(4))
    result = LineTracker(plate, CAMERA).track(image, afar)
    assert result.state == TrackingState.AMBIGUOUS and mentions(result.reason, "pose", "edges")
    angles = np.arange(16) * np.pi / 8
    ring = 0.06 * np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.vstack([np.column_stack([ring, np.full(16, z)]) for z in (-0.04, 0.04)])
    sides = [(i, (i + 1) % 16, 16 + (i + 1) % 16, 16 + i) for i in range(16)]
    prism = Model.from_faces(vertices, [tuple(range(15, -1, -1)), tuple(range(16, 32)), *sides])
    drawing = renderer(prism)
    drawing._lights = (0.3, 0.8, *np.tile((0.3, 0.6), 8))
    result = LineTracker(prism, CAMERA).track(drawing.render(orbit(0).inverse()), orbit(0))
    assert result.state == TrackingState.AMBIGUOUS and "22 degrees" in result.reason


def test_an_object_without_symmetry_is_not_called_ambiguous():
    corners = box().vertices.copy()
    corners[6] += [0.02, 0.015, 0.03]
    faces = [half for a, b, c, d in QUADS for half in ((a, b, c), (a, c, d))]
    tracker = LineTracker(Model.from_faces(corners, faces), CAMERA)
    assert tracker.min_symmetry > np.pi
    assert LineTracker(box(), CAMERA).min_symmetry == pytest.approx(np.pi)
    assert LIGHTS


@pytest.mark.parametrize(
    "image", [np.zeros((480, 640)), np.zeros((480, 641), np.uint8), np.zeros((480, 640, 3), np.uint8)]
)
def test_an_image_of_another_camera_is_refused(image):
    with pytest.raises(ObservationError, match="camera"):
        LineTracker(box(), CAMERA).track(image, orbit(0))


def test_tracking_needs_a_start():
    with pytest.raises(ObservationError, match="pose"):
        LineTracker(box(), CAMERA).track(np.zeros((480, 640), np.uint8))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"model": "equidistant"}, "known are plumb_bob, rational_polynomial"),
        ({"matrix": [0.0] * 9}, "calibrated"),
        ({"coefficients": [0.1] * 4}, "expected 5"),
        ({"width": 0}, "at least 16"),
        ({"matrix": [float("nan")] * 9}, "finite"),
    ],
)
def test_a_calibration_that_is_none_is_refused(changes, said):
    given = {"width": 640, "height": 480, "matrix": [600, 0, 320, 0, 600, 240, 0, 0, 1], "model": "plumb_bob"}
    with pytest.raises(GeometryError, match=said):
        PinholeCamera.from_calibration(**{**given, "coefficients": [0.0] * 5, **changes})


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"readout_time": -0.01}, ("readout_time", "-0.01")),
        ({"readout_time": np.nan}, ("readout_time", "nan")),
        ({"edge_std": np.zeros((3, 2))}, ("edge_std", "3", "12")),
        ({"edge_std": np.full((12, 2), -1e-3)}, ("edge_std", "-0.001")),
        ({"edge_std": np.full((12, 2), np.inf)}, ("edge_std", "inf")),
    ],
)
def test_a_tolerance_or_a_readout_that_is_none_is_refused(options, said):
    with pytest.raises(GeometryError) as error:
        LineTracker(box(), CAMERA, **options)
    assert mentions(str(error.value), *said)


def test_a_lens_is_undone():
    pixels = np.array([[20.0, 30.0], [320.0, 240.0], [600.0, 460.0]])
    points = np.column_stack([LENS.normalised(pixels), np.ones(3)])
    np.testing.assert_allclose(LENS.project(2.0 * points), pixels, atol=1e-6)


@pytest.mark.parametrize(("light", "background"), [(0.6, 0.02), (0.3, 0.9)])
def test_an_object_is_found_by_its_outline_alone_where_that_leaves_no_other_pose(light, background):
    """Between faces that are equally bright no edge is seen: less than 80 % are explained."""
    drawing, random = PolygonRenderer(box(), CAMERA, (light,) * 6, background), np.random.default_rng(2)
    true = Pose.look_at((0.27, 0.27, 0.25), (0.0, 0.0, 0.0))
    given = Pose(true.rotation @ Rotation.from_rotvec([0.02, -0.02, 0.02]).as_matrix(), true.translation + 0.004)
    tracker = LineTracker(box(), CAMERA)
    tracker.start(given)
    result = tracker.track(drawing.render(true.inverse(), 2.0, random))
    assert result.state == TrackingState.WEAK, result.reason
    assert result.support < 0.8
    assert error(result.T_world_camera, true)[0] < 3e-3
