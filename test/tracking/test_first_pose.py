# SPDX-License-Identifier: Apache-2.0
"""Where LineTracker begins: among other things with edges, and at what is not the object."""

import numpy as np
import pytest
from rendered import CAMERA, box, error, orbit, renderer
from scipy.spatial.transform import Rotation

from plsing_ros.geometry import Pose
from plsing_ros.simulation.polygon_renderer import PolygonRenderer, random_patches
from plsing_ros.tracking import LineTracker, TrackingState

cv2 = pytest.importorskip("cv2")


def rectangles(random, image, count, sizes, greys):
    """Paint turned rectangles at random places."""
    for _ in range(count):
        center, size = random.uniform((0, 0), image.shape[::-1]), random.uniform(*sizes, 2)
        corners = cv2.boxPoints((tuple(map(float, center)), tuple(map(float, size)), float(random.uniform(0, 180))))
        cv2.fillConvexPoly(image, corners.astype(np.int32), float(random.choice(greys)))


def before(wall, drawn, model, pose):
    """Put what is drawn of the object before a wall."""
    corners = CAMERA.project(model.vertices @ pose.inverse().rotation.T + pose.inverse().translation)
    mask = np.zeros(drawn.shape, np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.round(16.0 * corners).astype(np.int32)), 255, cv2.LINE_AA, 4)
    share = cv2.GaussianBlur(mask, (0, 0), 0.7) / 255.0
    return share * drawn + (1.0 - share) * wall


@pytest.mark.parametrize("seed", [2, 17, 24, 30, 85, 201, 202, 203])
def test_the_object_is_found_among_other_things(seed):
    """The edges nearest to those of a first pose that is a little off may be those of the background."""
    random = np.random.default_rng(seed)
    model = box(*random.uniform(0.06, 0.13, 3))
    lights = tuple(random.permutation(np.linspace(0.12, 0.85, 6)))
    patches = int(random.choice([0, 10, 40]))
    painted = random_patches(model, patches, random) if patches else ()
    drawing = PolygonRenderer(model, CAMERA, lights, patches=painted, background=0.45)
    wall = np.full((720, 960), 110.0)
    rectangles(random, wall, 150, (15.0, 200.0), np.arange(30, 220))
    wall = cv2.GaussianBlur(wall, (0, 0), random.uniform(0.7, 2.5))
    first = int(random.integers(0, 200))
    off = Pose(Rotation.from_rotvec(random.normal(0.0, 0.02, 3)).as_matrix(), random.normal(0.0, 0.006, 3))
    tracker, found = LineTracker(model, CAMERA), 0
    for k in range(12):
        true, place = orbit(first + k), (60 + 3 * k, 100)
        behind = wall[place[1] : place[1] + 480, place[0] : place[0] + 640]
        image = before(behind, drawing.render(true.inverse(), 0.0, random), model, true)
        noisy = np.clip(image + random.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8)
        result = tracker.track(noisy, true @ off if found == 0 else None)
        if result.T_world_camera is None:
            continue
        found += 1
        distance, turn = error(result.T_world_camera, true)
        assert distance < 0.02 and turn < np.radians(5.0), (k, result.state, distance, np.degrees(turn))
    assert found >= 8


@pytest.mark.parametrize(("whole", "state"), [(False, TrackingState.LOST), (True, TrackingState.WEAK)])
def test_points_carry_on_only_what_the_edges_have_confirmed(whole, state):
    """A wall with spots has most lines of the object for one image, or all of them, and few of them afterwards."""
    random, pose = np.random.default_rng(1), orbit(0)
    seen = LineTracker(box(), CAMERA).track(renderer(background=0.02).render(pose.inverse(), 2.0, random), pose)
    lines = random.permutation(np.flatnonzero(seen.observation.usable))
    corners = CAMERA.project(box().vertices @ pose.inverse().rotation.T + pose.inverse().translation)
    hull = cv2.convexHull(corners.astype(np.float32))
    inside = np.zeros((480, 640), np.uint8)
    cv2.fillConvexPoly(inside, hull.astype(np.int32), 1)
    spots = np.full((480, 640), 120.0)
    rectangles(random, spots, 400, (8.0, 18.0), (60, 190))
    wall = np.where(cv2.erode(inside, np.ones((25, 25))) > 0, spots, 120.0)

    def image(count):
        drawn = wall.copy()
        for i, j in box().edges[lines[:count]]:
            cv2.line(drawn, corners[i].astype(int).tolist(), corners[j].astype(int).tolist(), 220.0, 4, cv2.LINE_AA)
        drawn = cv2.GaussianBlur(drawn, (0, 0), 0.8) + random.normal(0.0, 2.0, drawn.shape)
        return np.clip(drawn, 0, 255).astype(np.uint8)

    tracker = LineTracker(box(), CAMERA)
    assert tracker.track(np.zeros((480, 640), np.uint8), pose).state is TrackingState.LOST
    begun = tracker.track(image(len(lines) if whole else 7), pose)
    assert begun.state is not TrackingState.LOST
    assert (begun.support > 0.8) == whole, begun.support
    results = [tracker.track(image(3)) for _ in range(6)]
    assert [each.state for each in results] == 6 * [state], [each.reason for each in results]


def test_a_first_pose_is_kept_until_the_object_is_found():
    tracker = LineTracker(box(), CAMERA)
    assert tracker.track(np.zeros((480, 640), np.uint8), orbit(0)).state is TrackingState.LOST
    image = renderer(background=0.02).render(orbit(1).inverse(), 2.0, np.random.default_rng(2))
    result = tracker.track(image)
    assert result.state is TrackingState.TRACKING
    assert error(result.T_world_camera, orbit(1))[0] < 2e-3
