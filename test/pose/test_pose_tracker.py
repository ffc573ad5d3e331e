# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from messages import mentions

from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import PoseEstimatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.pose import Verdict
from plsing_ros.pose.pose_tracker import PoseTracker

SCENE = read_scene(config_file("paper_p4l.yaml"))
SECOND = 1_000_000_000
CALM = Pose.look_at([5.0, 2.0, 3.0], [0.0, 0.0, 3.0], down=[0.0, 0.0, -1.0])


def parameters(**changes):
    return PoseEstimatorParameters(
        lines_points=tuple(SCENE.point.ravel()),
        lines_directions=tuple(SCENE.direction.ravel()),
        lines_ids=SCENE.ids,
        **{"noise_image": 1e-4, "lines_position_std": 0.0, "lines_direction_std": 0.0, **changes},
    )


def seen_from(pose):
    """Image lines only, as a tracker has them."""
    seen = LineObservation.of_lines(SCENE.transformed(pose.inverse(), "camera"))
    return dataclasses.replace(seen, lines_camera=None)


def test_an_image_gives_the_pose_and_its_lines_in_space():
    tracked = PoseTracker(parameters()).track(seen_from(CALM), SECOND, SECOND)
    assert tracked.estimate.verdict is Verdict.OK
    assert tracked.estimate.T_world_camera.translation == pytest.approx(CALM.translation, abs=1e-9)
    truth = SCENE.transformed(CALM.inverse(), "camera")
    assert tracked.completed.verdict is LinesVerdict.OK
    np.testing.assert_allclose(tracked.completed.lines_camera.direction, truth.direction, atol=1e-9)
    np.testing.assert_allclose(tracked.completed.lines_camera.moment, truth.moment, atol=1e-9)


def test_the_verdict_and_its_reason_travel_with_the_completed_features():
    uncertain = PoseTracker(parameters(max_position_deviation=1e-8)).track(seen_from(CALM), SECOND, SECOND)
    assert uncertain.estimate.verdict is Verdict.POOR
    assert uncertain.completed.verdict is LinesVerdict.POOR
    assert uncertain.completed.verdict_reason == uncertain.estimate.reason != ""


def test_without_a_pose_the_image_goes_on_without_3d_lines_and_says_why():
    few = seen_from(CALM)
    few = dataclasses.replace(few, usable=np.array([True, True, False, False]))
    tracked = PoseTracker(parameters()).track(few, SECOND, SECOND)
    assert tracked.estimate.verdict is Verdict.FAILED
    assert mentions(tracked.estimate.reason, "2 usable")
    assert tracked.completed.lines_camera is None and tracked.completed.usable_ids == few.usable_ids
    assert tracked.completed.verdict is LinesVerdict.POOR
    assert tracked.estimate.reason in tracked.completed.verdict_reason


@pytest.mark.parametrize(
    ("stamp", "now", "words"),
    [
        (0, SECOND, "no stamp"),
        (SECOND, 3 * SECOND, "2 s old"),
        (3 * SECOND, SECOND, "2 s ahead of the clock"),
    ],
)
def test_stamps_that_cannot_be_are_refused(stamp, now, words):
    tracked = PoseTracker(parameters()).track(seen_from(CALM), stamp, now)
    assert tracked.estimate.verdict is Verdict.FAILED
    assert words in tracked.estimate.reason
    assert tracked.completed is None


def test_silence_says_since_when_and_why():
    tracking = PoseTracker(parameters())
    assert mentions(tracking.silence(SECOND).estimate.reason, "features")
    tracking.track(seen_from(CALM), SECOND, SECOND)
    assert tracking.silence(SECOND + SECOND // 10) is None
    tracking.fail("the feature message has no lines")
    reason = tracking.silence(3 * SECOND).estimate.reason
    assert mentions(reason, "features", "refused", "2 s")
    assert mentions(reason, "no lines")


def test_a_scene_changed_while_running_is_used_at_the_next_image():
    tracking = PoseTracker(parameters())
    tracking.track(seen_from(CALM), SECOND, SECOND)
    moved = np.asarray(SCENE.point) + [1.0, 0.0, 0.0]
    tracking.parameters = dataclasses.replace(tracking.parameters, lines_points=tuple(moved.ravel()))
    tracked = tracking.track(seen_from(CALM), SECOND + 1, SECOND + 1)
    assert tracked.estimate.T_world_camera.translation == pytest.approx(CALM.translation + [1.0, 0.0, 0.0], abs=1e-8)


def without_line(number, observation):
    return dataclasses.replace(observation, usable=np.array([i != number for i in observation.ids]))


@pytest.mark.parametrize("by_filter", [True, False])
def test_what_three_lines_leave_open_the_motion_decides(by_filter):
    """Three lines have several poses; a camera that was seen a moment ago can be at one of them only."""
    three = without_line(4, seen_from(CALM))
    at_once = PoseTracker(parameters(filter=by_filter)).track(three, SECOND, SECOND)
    assert at_once.estimate.verdict is Verdict.AMBIGUOUS
    tracking = PoseTracker(parameters(filter=by_filter))
    tracking.track(seen_from(CALM), SECOND, SECOND)
    soon = SECOND + SECOND // 25
    tracked = tracking.track(three, soon, soon)
    assert tracked.estimate.verdict is not Verdict.AMBIGUOUS
    assert tracked.estimate.alternatives == ()
    assert tracked.estimate.T_world_camera.translation == pytest.approx(CALM.translation, abs=1e-5)
    assert tracked.completed.lines_source == tracked.estimate.source == ("filter" if by_filter else "image")


def test_a_camera_that_has_jumped_is_not_held_at_its_last_place():
    far = Pose.look_at([-4.0, 3.0, 2.0], [0.0, 0.0, 3.0], down=[0.0, 0.0, -1.0])
    tracking = PoseTracker(parameters(filter=False))
    tracking.track(seen_from(CALM), SECOND, SECOND)
    soon = SECOND + SECOND // 25
    tracked = tracking.track(seen_from(far), soon, soon)
    assert tracked.estimate.T_world_camera.translation == pytest.approx(far.translation, abs=1e-8)


def test_the_filter_says_that_it_is_lost_and_finds_a_camera_that_has_jumped():
    far = Pose.look_at([-4.0, 3.0, 2.0], [0.0, 0.0, 3.0], down=[0.0, 0.0, -1.0])
    tracking, frame = PoseTracker(parameters()), SECOND // 25
    for k in range(2):
        tracking.track(seen_from(CALM), SECOND + k * frame, SECOND + k * frame)
    verdicts = []
    for k in range(2, 12):
        tracked = tracking.track(seen_from(far), SECOND + k * frame, SECOND + k * frame)
        verdicts.append(tracked.estimate.verdict)
        assert (tracked.completed.lines_camera is None) == (tracked.estimate.verdict is Verdict.LOST)
    assert verdicts[0] is Verdict.LOST and verdicts[-1] is Verdict.OK
    assert tracked.estimate.T_world_camera.translation == pytest.approx(far.translation, abs=1e-4)


def test_the_filter_follows_the_twists_it_is_told_of():
    """Two frames of a camera that moves by a metre: far more than a filter that knows of no twist would expect."""
    twist, frame = np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.1]), SECOND // 10
    tracking = PoseTracker(parameters())
    tracking.track(seen_from(CALM), SECOND, SECOND)
    for k in range(1, 11):
        tracking.receive_twist(twist, SECOND + (k - 1) * frame)
        pose = CALM.integrate(twist, 0.1 * k)
        tracked = tracking.track(seen_from(pose), SECOND + k * frame, SECOND + k * frame)
        assert tracked.estimate.verdict is Verdict.OK and tracked.estimate.innovation < 1.0
    assert tracked.estimate.T_world_camera.translation == pytest.approx(pose.translation, abs=1e-4)


def test_changed_thresholds_keep_the_filter_where_it_is():
    tracking, frame = PoseTracker(parameters()), SECOND // 25
    for k in range(5):
        tracking.track(seen_from(CALM), SECOND + k * frame, SECOND + k * frame)
    tracking.parameters = dataclasses.replace(tracking.parameters, outlier_gate=6.0)
    three = without_line(4, seen_from(CALM))
    tracked = tracking.track(three, SECOND + 5 * frame, SECOND + 5 * frame)
    assert tracked.estimate.source == "filter" and tracked.estimate.alternatives == ()
