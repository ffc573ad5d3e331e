# SPDX-License-Identifier: Apache-2.0
"""Node line_tracker: images in, line features out, and a sentence for everything that can be wrong."""

import sys
from pathlib import Path

import numpy as np
import pytest
from builders import twist_values
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from messages import mentions
from rcl_interfaces.msg import Log
from sensor_msgs.msg import CameraInfo, Image

from plsing_msgs.msg import LineFeatureArray
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.conversions import header
from plsing_ros.nodes.image_conversions import grey_from_message, image_message
from plsing_ros.nodes.line_tracker import LineTrackerNode
from plsing_ros.nodes.pose_conversions import camera_pose_message
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.simulation.polygon_renderer import PolygonRenderer

sys.path.insert(0, str(Path(__file__).parents[1] / "tracking"))
from rendered import CAMERA, LIGHTS, box, orbit

pytest.importorskip("cv2")

START = orbit(0)
FRAME = "camera_optical_frame"


def camera_info(width=640, model="plumb_bob"):
    return CameraInfo(
        width=width,
        height=480,
        k=[CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0],
        d=[0.0] * 5,
        distortion_model=model,
    )


class TrackerLoop:
    """Sends images to a tracker and receives what it says of them."""

    def __init__(self, ros, model=None, lights=LIGHTS, **parameters):
        model = model or box()
        faces = [row for face in model.faces for row in (*face, -1)]
        vertices = model.vertices.ravel().tolist()
        self.ros = ros
        self.features = ros.collect(LineFeatureArray, "line_features")
        self.poses = ros.collect(PoseWithCovarianceStamped, "tracked_camera_pose")
        self.states = ros.collect(DiagnosticArray, "line_tracker/state", qos.STATUS)
        given = {"model.vertices": vertices, "model.faces": faces, "image_timeout": 20.0, "max_repeats": 3}
        self.node = ros.add(LineTrackerNode, None, given | parameters)
        self.images = ros.publisher(Image, "image")
        self.infos = ros.publisher(CameraInfo, "camera_info")
        self.starts = ros.publisher(PoseWithCovarianceStamped, "initial_pose")
        self.drawing = PolygonRenderer(model, CAMERA, lights[: len(model.faces)], 0.02)
        self.random = np.random.default_rng(1)

    def calibrate(self, **options):
        self.infos.publish(camera_info(**options))
        self.ros.spin_for(0.3)

    def begin(self, pose=START):
        self.starts.publish(camera_pose_message(pose, header(self.node.now(), "world")))
        self.ros.spin_for(0.3)

    def picture(self, pose=START):
        return self.drawing.render(pose.inverse(), 1.0, self.random)

    def parameters(self):
        """The object, for other nodes."""
        return {name: self.node.parameters.values()[name] for name in ("model.vertices", "model.faces")}

    def answer(self, picture, change=lambda message: None):
        """Send an image, and return the state that answers it and the features."""
        message = image_message(picture, header(self.node.now(), FRAME))
        change(message)
        stamp = message.header.stamp
        self.images.publish(message)
        self.ros.spin_until(
            lambda: any(each.header.stamp == stamp for each in self.states)
            and any(each.header.stamp == stamp for each in self.features),
            "the state and the features of this image",
        )
        status = next(each for each in self.states if each.header.stamp == stamp).status[0]
        return status, next(each for each in self.features if each.header.stamp == stamp)


@pytest.fixture
def loop(ros):
    return TrackerLoop(ros)


def test_images_become_line_features_and_a_pose(loop):
    status, features = loop.answer(loop.picture())
    assert status.name == "WAITING_FOR_CAMERA_INFO" and not any(features.visible)
    loop.calibrate()
    assert loop.answer(loop.picture())[0].name == "WAITING_FOR_POSE"
    loop.begin(Pose(np.eye(3), [0.004, -0.003, 0.002]) @ START)
    status, features = loop.answer(loop.picture())
    assert (status.name, status.message) == ("TRACKING", "") and sum(features.visible) >= 6
    assert len(features.covariances) == 3 * len(features.ids) and min(np.array(features.covariances)[::3]) >= 0.0
    seen, image = np.array(features.visible, dtype=bool), np.reshape(features.image_lines, (-1, 3))
    for end in np.reshape(features.ends, (-1, 2, 2)).swapaxes(0, 1):
        off = np.sum(image[:, :2] * end, axis=1) + image[:, 2]
        assert np.abs(off[seen]).max() < 3e-3 and not end[~seen].any()
    loop.ros.spin_until(lambda: loop.poses, "the pose")
    p = loop.poses[-1].pose.pose.position
    assert [p.x, p.y, p.z] == pytest.approx(START.translation, abs=3e-3)
    lines = box().lines().transformed(START.inverse(), "camera")
    expected = lines.moment / np.linalg.norm(lines.moment[:, :2], axis=1, keepdims=True)
    seen = np.array(features.visible, dtype=bool)
    np.testing.assert_allclose(np.reshape(features.image_lines, (-1, 3))[seen], expected[seen], atol=0.02)


def test_a_first_pose_in_another_frame_is_refused_by_its_own_name(loop):
    said = loop.ros.collect(Log, "/rosout", qos.STATUS)
    loop.starts.publish(camera_pose_message(START, header(loop.node.now(), "elsewhere")))
    expected = "initial_pose is in frame 'elsewhere', expected 'world'"
    loop.ros.spin_until(lambda: any(expected in each.msg for each in said), "the refusal")


def test_every_bad_image_is_named_and_gives_no_usable_line_and_tracking_goes_on(loop):
    loop.calibrate()
    loop.begin()
    assert loop.answer(loop.picture())[0].name == "TRACKING"
    black = np.zeros((480, 640), np.uint8)
    cases = [
        ("encoding is '16UC1'", loop.picture(), lambda m: setattr(m, "encoding", "16UC1")),
        ("cut off", loop.picture(), lambda m: setattr(m, "height", 481)),
        ("320 x 240", np.ascontiguousarray(loop.picture()[::2, ::2]), lambda m: None),
        ("black", black, lambda m: None),
        ("overexposed", black + 255, lambda m: None),
        ("frame 'elsewhere'", loop.picture(), lambda m: setattr(m.header, "frame_id", "elsewhere")),
        ("explains", np.full_like(black, 90), lambda m: None),
    ]
    for said, picture, change in cases:
        status, features = loop.answer(picture, change)
        assert status.name == "LOST" and said in status.message and status.level == b"\x02", said
        assert not any(features.visible), said
    assert loop.answer(loop.picture())[0].name == "TRACKING"
    frozen = loop.picture()
    names = [loop.answer(frozen)[0] for _ in range(4)]
    assert names[0].name == "TRACKING" and names[-1].name == "LOST" and "stands still" in names[-1].message


@pytest.mark.parametrize(
    ("options", "said"), [({"model": "equidistant"}, "known are plumb_bob"), ({"width": 641}, "calibration is for 641")]
)
def test_a_calibration_that_does_not_fit_is_named(loop, options, said):
    loop.calibrate(**options)
    loop.begin()
    status, features = loop.answer(loop.picture())
    assert status.name in ("WAITING_FOR_CAMERA_INFO", "SEARCHING") and said in status.message
    assert not any(features.visible)


def test_late_images_and_silence_are_announced(ros):
    loop = TrackerLoop(ros, image_timeout=0.4)
    loop.calibrate()
    loop.begin()
    status, features = loop.answer(loop.picture(), lambda m: setattr(m.header.stamp, "sec", m.header.stamp.sec - 5))
    assert status.name == "LOST" and "old" in status.message and not any(features.visible)
    count = len(loop.features)
    ros.spin_until(lambda: len(loop.features) > count and not any(loop.features[-1].visible), "the silence")


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8"])
def test_colours_become_grey_as_opencv_does_it(encoding):
    import cv2

    picture = np.random.default_rng(0).integers(0, 256, (40, 60, 3), dtype=np.uint8)
    message = image_message(picture, header(1, FRAME))
    message.encoding = encoding
    expected = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY if encoding == "bgr8" else cv2.COLOR_RGB2GRAY)
    assert np.abs(grey_from_message(message).astype(int) - expected).max() <= 1


def plate():
    corners = [[-0.05, -0.035, 0.0], [0.05, -0.035, 0.0], [0.05, 0.035, 0.0], [-0.05, 0.035, 0.0]]
    return Model.from_faces(corners, [(0, 1, 2, 3)])


def prism():
    angles = np.arange(16) * np.pi / 8
    ring = 0.06 * np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.vstack([np.column_stack([ring, np.full(16, z)]) for z in (-0.04, 0.04)])
    sides = [(i, (i + 1) % 16, 16 + (i + 1) % 16, 16 + i) for i in range(16)]
    return Model.from_faces(vertices, [tuple(range(15, -1, -1)), tuple(range(16, 32)), *sides])


@pytest.mark.parametrize(
    ("model", "lights", "pose"),
    [(plate(), (0.8,), Pose.look_at((0.1, 0.15, 1.6), (0, 0, 0))), (prism(), (0.3, 0.8, *(0.3, 0.6) * 8), START)],
    ids=["one face, from afar", "a prism of many sides"],
)
def test_an_object_that_looks_the_same_from_elsewhere_is_ambiguous_and_gives_no_usable_line(ros, model, lights, pose):
    loop = TrackerLoop(ros, model, lights)
    loop.calibrate()
    loop.begin(pose)
    status, features = loop.answer(loop.picture(pose))
    assert status.name == "AMBIGUOUS" and mentions(status.message, "pose", "edges")
    assert not any(features.visible)


def test_one_face_from_near_by_is_tracked(ros):
    loop = TrackerLoop(ros, plate(), (0.8,))
    near = Pose.look_at((0.08, 0.12, 0.16), (0, 0, 0))
    loop.calibrate()
    loop.begin(near)
    status, features = loop.answer(loop.picture(near))
    assert status.name == "TRACKING" and sum(features.visible) == 4


def test_after_no_bad_image_does_the_robot_move(loop):
    """Tracker, estimator and controller: the twist that answers an image, or the lack of one, is zero."""
    ros = loop.ros
    target = START @ Pose(np.eye(3), [0.0, 0.0, 0.03])
    goal = {"target.position": target.translation.tolist(), "target.orientation": target.quaternion_xyzw.tolist()}
    ros.add(PoseEstimatorNode, None, loop.parameters())
    remap = {"line_features": "completed_line_features"}
    ros.add(ControllerNode, None, {**loop.parameters(), **goal, "features_timeout": 0.5}, remap)
    twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)

    def moving():
        loop.answer(loop.picture())
        ros.spin_for(0.05)
        return bool(twists) and np.any(twist_values(twists[-1]))

    loop.calibrate()
    loop.begin()
    black = np.zeros((480, 640), np.uint8)
    for said, picture, change in [
        ("black", black, lambda m: None),
        ("overexposed", black + 255, lambda m: None),
        ("explains", black + 90, lambda m: None),
        ("encoding", loop.picture(), lambda m: setattr(m, "encoding", "16UC1")),
        ("cut off", loop.picture(), lambda m: setattr(m, "height", 481)),
        ("320 x 240", np.ascontiguousarray(loop.picture()[::2, ::2]), lambda m: None),
        ("old", loop.picture(), lambda m: setattr(m.header.stamp, "sec", m.header.stamp.sec - 60)),
    ]:
        ros.spin_until(moving, f"a twist before the image that is {said}", 20.0)
        status, _ = loop.answer(picture, change)
        assert said in status.message, status
        ros.spin_until(lambda: not np.any(twist_values(twists[-1])), f"a halt after the image that is {said}")
        count = len(twists)
        ros.spin_for(0.3)
        assert not any(np.any(twist_values(each)) for each in twists[count:]), said
