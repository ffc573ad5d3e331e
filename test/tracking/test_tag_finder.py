# SPDX-License-Identifier: Apache-2.0
"""The first pose from a tag: against the pose that it is drawn at, with both of OpenCV's interfaces."""

import types

import numpy as np
import pytest
from messages import mentions
from rendered import CAMERA, LENS, box, error, orbit, renderer
from scipy.spatial.transform import Rotation

from plsing_ros.errors import ParameterError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.tag import FAMILIES, Tag
from plsing_ros.tracking.session import SessionState, TrackingSession
from plsing_ros.tracking.tag_finder import TagFinder

cv2 = pytest.importorskip("cv2")

T_world_tag = Pose(Rotation.from_euler("z", 30, degrees=True).as_matrix(), [0.065, 0.095, -0.035])
SIZE = 0.05


def printed(family, number):
    """The tag with its white border, and the side of the picture over that of the black square."""
    name = getattr(cv2.aruco, FAMILIES[family])
    if hasattr(cv2.aruco, "generateImageMarker"):
        marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(name), number, 400)
    else:
        marker = cv2.aruco.drawMarker(cv2.aruco.Dictionary_get(name), number, 400)
    return cv2.copyMakeBorder(marker, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255), 520 / 400


def drawn(image, pose, family="tag36h11", number=7, camera=CAMERA):
    """Lay the tag into an image: each pixel's ray is met with the tag's plane."""
    picture, share = printed(family, number)
    rows, columns = np.indices(image.shape)
    pixels = np.column_stack([columns.ravel(), rows.ravel()]).astype(float)
    rays = np.column_stack([camera.normalised(pixels), np.ones(len(pixels))])
    T_tag_camera = T_world_tag.inverse() @ pose
    rays, origin = rays @ T_tag_camera.rotation.T, T_tag_camera.translation
    at = origin[:2] - rays[:, :2] * (origin[2] / rays[:, 2])[:, np.newaxis]
    place = np.column_stack([at[:, 0], -at[:, 1]]) / (SIZE * share) + 0.5
    on_tag = ((place > 0) & (place < 1)).all(axis=1) & (origin[2] / rays[:, 2] < 0)
    x, y = (place * len(picture) - 0.5).T.astype(np.float32)
    blurred = cv2.GaussianBlur(picture, (0, 0), 2)
    seen = cv2.remap(blurred, x.reshape(image.shape), y.reshape(image.shape), cv2.INTER_LINEAR)
    return np.where(on_tag.reshape(image.shape), seen, image)


def old_interface(monkeypatch):
    """As in OpenCV 4.6, which Ubuntu 24.04 has."""
    if not hasattr(cv2.aruco, "ArucoDetector"):
        return
    new = cv2.aruco
    constants = {name: getattr(new, name) for name in dir(new) if name.startswith(("DICT_", "CORNER_"))}
    old = types.SimpleNamespace(
        **constants,
        Dictionary_get=new.getPredefinedDictionary,
        DetectorParameters_create=new.DetectorParameters,
        detectMarkers=lambda image, dictionary, parameters: new.ArucoDetector(dictionary, parameters).detectMarkers(
            image
        ),
    )
    monkeypatch.setattr(cv2, "aruco", old)


@pytest.mark.parametrize("old", [False, True], ids=["as installed", "as before 4.7"])
@pytest.mark.parametrize(("family", "camera"), [("tag36h11", CAMERA), ("tag25h9", LENS), ("aruco4x4", CAMERA)])
def test_the_pose_of_a_drawn_tag_is_found(monkeypatch, old, family, camera):
    image = drawn(np.full((480, 640), 90, np.uint8), orbit(0), family, camera=camera)
    if old:
        old_interface(monkeypatch)
    found = TagFinder(Tag(family, 7, SIZE, T_world_tag)).find(image, camera)
    off, turn = error(found[0], orbit(0))
    assert off < 2e-3 and turn < np.radians(0.3)
    assert TagFinder(Tag(family, 8, SIZE, T_world_tag)).find(image, camera) == []


def test_the_tag_gives_the_first_pose_and_a_new_one_after_a_loss():
    drawing, random = renderer(background=0.02), np.random.default_rng(3)
    session = TrackingSession(box(), tag=Tag("tag36h11", 7, SIZE, T_world_tag))
    session.set_camera(CAMERA)
    far = orbit(80)
    without = drawing.render(orbit(0).inverse(), 1.0, random)
    report = session.process(without)
    assert report.state is SessionState.WAITING_FOR_POSE and mentions(report.reason, "tag")
    for pose in (orbit(0), far):
        report = session.process(drawn(drawing.render(pose.inverse(), 1.0, random), pose))
        assert report.state is SessionState.TRACKING, report.reason
        assert error(report.tracking.T_world_camera, pose)[0] < 3e-3


def test_a_tag_that_the_family_does_not_have_and_an_opencv_without_tags_are_named(monkeypatch):
    with pytest.raises(ParameterError, match=r"\b0 to 34\b"):
        TagFinder(Tag("tag25h9", 35, SIZE, T_world_tag))
    monkeypatch.delattr(cv2, "aruco")
    with pytest.raises(ParameterError, match="OpenCV.*aruco"):
        TagFinder(Tag("tag36h11", 0, SIZE, T_world_tag))
