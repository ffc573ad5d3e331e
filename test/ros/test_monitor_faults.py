# SPDX-License-Identifier: Apache-2.0
"""What can go wrong around a monitor on a robot, each over real topics."""

import numpy as np
import pytest
from builders import change, features, seen, set_number, start_pose, twist
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped
from messages import mentions
from monitor_loop import MonitorLoop, beside_transversal
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from plsing_msgs.msg import LineFeatureArray, SingularityStatus, SingularLoci
from plsing_msgs.srv import CheckPose
from plsing_ros.features import interaction_matrix
from plsing_ros.nodes import qos
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode

CALM = start_pose(1)


@pytest.fixture
def loop(ros, paper):
    return MonitorLoop(ros, paper)


def numbers_of(status):
    return [
        status.inverse_condition_number,
        status.scaled_inverse_condition_number,
        status.inverse_condition_number_rate,
        status.target_inverse_condition_number,
        status.time_to_critical,
        status.time_to_approach,
        status.nearest.distance,
        status.approach_distance,
        *status.singular_values,
        *status.locus_distances,
    ]


def assert_recovers(loop):
    assert loop.status_at(CALM).level == SingularityStatus.LEVEL_OK
    for status in loop.statuses:
        assert np.isfinite(numbers_of(status)).all()
        assert status.reason


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (set_number("image_lines", 4, float("nan")), "image_lines[1, 1] is nan"),
        (set_number("moments", 0, float("inf")), "moments[0, 0] is inf"),
        (change(image_lines=[1.0] * 9), "'image_lines' of the feature message has 9 numbers"),
        (change(directions=[1.0] * 3), "'directions' of the feature message has 3 numbers"),
        (change(visible=[1]), "'visible' of the feature message has 1 numbers"),
        (change(ids=[1, 2, 3, 3]), "id 3 is given to more than one line"),
        (change(ids=[]), "no lines"),
        (change(directions=[], moments=[]), "no 3-D lines"),
    ],
)
def test_features_that_cannot_be_used(loop, spoil, words):
    status = loop.status_at(CALM, spoil)
    assert status.level == SingularityStatus.LEVEL_UNOBSERVABLE
    assert words in status.reason
    assert not status.unobservable_motion_valid
    assert not status.distances_valid
    assert_recovers(loop)


def test_a_stream_that_is_refused_is_one_state_one_alert_and_one_line(loop):
    lines = loop.ros.collect(Log, "/rosout", qos.LATCHED)
    loop.status_at(CALM)
    loop.ros.spin_until(lambda: loop.alerts[-1].level == SingularityStatus.LEVEL_OK, "the alert of it")
    alerts = len(loop.alerts)
    for frame in range(40):
        # The numbers in the reason change with each message, and what is wrong with it does not.
        status = loop.status_at(CALM, set_number("image_lines", 5, 300.0 + frame))
        assert status.level == SingularityStatus.LEVEL_UNOBSERVABLE
    loop.ros.spin_for(0.3)
    assert len(loop.alerts) == alerts + 1
    of_monitor = [each.msg for each in lines if each.name.endswith("singularity_monitor")]
    assert sum("UNOBSERVABLE" in each for each in of_monitor) == 1, of_monitor


def test_a_line_that_is_not_in_the_scene_is_left_out_and_said(loop):
    status = loop.status_at(CALM, change(ids=[1, 2, 3, 77]))
    assert status.line_count == 3
    assert mentions(status.reason, "id 77", "scene")


def test_lines_in_another_order_are_the_same_lines(loop):
    expected = loop.status_at(CALM)
    stamp = loop.now()
    loop.publish_pose(CALM, stamp)
    loop.ros.spin_for(0.05)
    loop.features.publish(features(CALM, stamp, ids=(3, 1, 4, 2)))
    loop.ros.spin_until(lambda: loop.statuses[-1].header.stamp == stamp, "the status")
    status = loop.statuses[-1]
    assert status.level == SingularityStatus.LEVEL_OK
    np.testing.assert_allclose(status.singular_values, expected.singular_values, rtol=1e-9)


def test_a_line_that_is_reversed_is_named(loop):
    def reverse_line_3(message):
        for field in ("image_lines", "directions", "moments"):
            values = getattr(message, field)
            values[6:9] = type(values)("d", [-each for each in values[6:9]])

    status = loop.status_at(CALM, reverse_line_3)
    assert "line 3" in status.reason
    assert "reversed" in status.reason
    assert_recovers(loop)


@pytest.mark.parametrize("shift", [-3600, -6, 6, 3600])
def test_stamps_far_from_the_clock_are_stale(ros, paper, shift):
    loop = MonitorLoop(ros, paper, features_timeout=5.0, heartbeat_period=0.05)
    stamp = loop.now()
    stamp.sec += shift
    loop.features.publish(features(CALM, stamp))
    loop.ros.spin_until(lambda: loop.statuses and "are refused" in loop.statuses[-1].reason, "a status that says so")
    assert loop.statuses[-1].level == SingularityStatus.LEVEL_STALE
    assert mentions(loop.statuses[-1].reason, "old") or mentions(loop.statuses[-1].reason, "clock")
    assert_recovers(loop)


def test_a_zero_stamp_is_stale(loop):
    loop.features.publish(features(CALM, 0))
    loop.ros.spin_until(lambda: loop.statuses and "no stamp" in loop.statuses[-1].reason, "a status that says so")
    assert loop.statuses[-1].level == SingularityStatus.LEVEL_STALE
    assert_recovers(loop)


def test_a_single_stamp_that_goes_back_changes_nothing(loop):
    earlier = loop.now()
    loop.status_at(CALM)
    count = len(loop.statuses)
    loop.features.publish(features(beside_transversal(0.01), earlier))
    loop.ros.spin_for(0.1)
    assert len(loop.statuses) == count
    assert_recovers(loop)


def test_a_pose_that_stops_is_replaced_by_the_features(loop):
    loop.status_at(CALM)
    assert loop.statuses[-1].position_source == "camera_pose"
    expected = list(loop.statuses[-1].locus_distances)
    loop.ros.spin_for(0.3)  # longer than pose_tolerance
    status = loop.status_at(CALM, with_pose=False)
    assert status.position_source == "features"
    np.testing.assert_allclose(status.locus_distances, expected, atol=1e-6)


def test_a_clock_that_jumps_back(ros, paper):
    clock = ros.node.create_publisher(Clock, "/clock", qos.CLOCK)
    loop = MonitorLoop(ros, paper, use_sim_time=True)
    for seconds in (1000.0, 1000.1, 10.0, 10.1):
        message = features(CALM, seconds)
        for _ in range(3):  # best effort
            clock.publish(Clock(clock=message.header.stamp))
            loop.ros.spin_for(0.05)
        loop.features.publish(message)
        loop.ros.spin_until(
            lambda: any(each.header.stamp == message.header.stamp and each.line_count == 4 for each in loop.statuses),
            f"a status of the features at {seconds} s",
        )
        assert loop.statuses[-1].level == SingularityStatus.LEVEL_OK


def test_a_flood_of_features_is_answered_up_to_date(loop):
    last = None
    for _ in range(1000):
        last = loop.now()
        loop.features.publish(features(CALM, last))
        loop.ros.spin_for(0.001)
    loop.ros.spin_until(
        lambda: loop.alerts and loop.statuses and loop.statuses[-1].header.stamp == last, "the status of the last one"
    )
    assert loop.statuses[-1].level == SingularityStatus.LEVEL_OK
    levels = [each.level for each in loop.alerts]
    assert levels.count(SingularityStatus.LEVEL_OK) == 1


def test_a_subscriber_that_never_reads_holds_up_nobody(loop):
    deaf = Node("deaf", context=loop.ros.context, use_global_arguments=False)  # in no executor
    deaf.create_subscription(SingularityStatus, "singularity_status", lambda message: None, qos.STATUS)
    for _ in range(50):
        assert loop.status_at(CALM, with_pose=False).level == SingularityStatus.LEVEL_OK
    deaf.destroy_node()


def test_a_monitor_that_dies_and_comes_back(ros, paper):
    loop = MonitorLoop(ros, paper)
    loop.status_at(beside_transversal(0.005))
    ros.remove(loop.node)
    loop.statuses.clear()
    loop.alerts.clear()
    loop.node = ros.add(SingularityMonitorNode, paper, {"features_timeout": 5.0})
    loci = ros.collect(SingularLoci, "singular_loci", qos.LATCHED)
    markers = ros.collect(MarkerArray, "singularity_markers", qos.LATCHED)
    ros.spin_until(lambda: loci and markers and loop.alerts, "the latched topics again")
    loop.until_level(beside_transversal(0.005), SingularityStatus.LEVEL_CRITICAL)
    ros.spin_until(lambda: loop.alerts[-1].level == SingularityStatus.LEVEL_CRITICAL, "the alert of it")


def test_two_monitors_in_two_namespaces(ros, paper):
    statuses = {name: ros.collect(SingularityStatus, f"/{name}/singularity_status", qos.STATUS) for name in "ab"}
    for name in "ab":
        ros.add(SingularityMonitorNode, paper, {"features_timeout": 5.0}, namespace=name)
    publisher = ros.publisher(LineFeatureArray, "/a/line_features")
    message = features(CALM, ros.node.get_clock().now().to_msg())
    publisher.publish(message)
    ros.spin_until(
        lambda: statuses["a"] and statuses["a"][-1].header.stamp == message.header.stamp, "the status of monitor a"
    )
    ros.spin_until(lambda: statuses["b"], "a heartbeat of monitor b")
    assert {each.level for each in statuses["b"]} == {SingularityStatus.LEVEL_STALE}


def test_switched_off_it_says_disabled_and_never_falls_silent(ros, paper):
    loop = MonitorLoop(ros, paper, heartbeat_period=0.05)
    loop.status_at(CALM)
    assert ros.call(SetBool, "singularity_monitor/enable", SetBool.Request(data=False)).success
    ros.spin_until(lambda: loop.statuses[-1].level == SingularityStatus.LEVEL_DISABLED, "DISABLED")
    count = len(loop.statuses)
    ros.spin_until(lambda: len(loop.statuses) > count + 3, "heartbeats while disabled")
    ros.spin_until(lambda: loop.alerts[-1].level == SingularityStatus.LEVEL_DISABLED, "the alert of it")
    assert ros.call(SetBool, "singularity_monitor/enable", SetBool.Request(data=True)).success
    assert_recovers(loop)


def check(ros, pose, frame="world"):
    request = CheckPose.Request(pose=PoseStamped(header=Header(frame_id=frame)))
    p, q = request.pose.pose.position, request.pose.pose.orientation
    p.x, p.y, p.z = map(float, pose.translation)
    q.x, q.y, q.z, q.w = map(float, pose.quaternion_xyzw)
    return ros.call(CheckPose, "singularity_monitor/check_pose", request)


def test_a_pose_can_be_asked_about_before_going_there(loop):
    loop.status_at(CALM)
    answer = check(loop.ros, beside_transversal(0.005))
    assert answer.success
    assert answer.status.level == SingularityStatus.LEVEL_CRITICAL
    assert answer.status.nearest.name == "transversal 1"
    values = np.linalg.svd(interaction_matrix(seen(beside_transversal(0.005))))[1]
    assert answer.status.inverse_condition_number == pytest.approx(values[-1] / values[0], rel=1e-6)
    # Nothing has happened to the monitor itself.
    assert loop.status_at(CALM).level == SingularityStatus.LEVEL_OK
    assert SingularityStatus.LEVEL_CRITICAL not in [each.level for each in loop.alerts]


def test_a_pose_that_is_none_is_refused_by_check_pose(loop):
    answer = check(loop.ros, CALM, frame="map")
    assert not answer.success
    assert mentions(answer.message, "'map'", "'world'")
    request = CheckPose.Request()
    request.pose.pose.orientation.w = 0.0
    answer = loop.ros.call(CheckPose, "singularity_monitor/check_pose", request)
    assert not answer.success
    assert mentions(answer.message, "length 0", 1)


def test_the_present_motion_is_judged(loop):
    twists = loop.ros.publisher(TwistStamped, "cmd_twist")
    pose = beside_transversal(0.6)
    away = pose.rotation.T @ (pose.translation - beside_transversal(0.0).translation)
    for sign, trend in ((-1.0, SingularityStatus.TREND_APPROACHING), (1.0, SingularityStatus.TREND_LEAVING)):
        for _ in range(3):
            twists.publish(twist([*(sign * 0.1 * away / np.linalg.norm(away)), 0, 0, 0], loop.now()))
            loop.ros.spin_for(0.05)
            status = loop.status_at(pose)
        assert status.trend == trend
    assert status.position_source == "camera_pose"


def test_diagnostics_come_once_a_second(ros, paper):
    loop = MonitorLoop(ros, paper)
    diagnostics = ros.collect(DiagnosticArray, "/diagnostics", qos.STATUS)
    for _ in range(25):
        loop.status_at(CALM)
        ros.spin_for(0.05)
    mine = [each.status[0] for each in diagnostics if "singularity_monitor" in each.status[0].name]
    assert 2 <= len(mine) <= 5
    values = {each.key: each.value for each in mine[-1].values}
    assert mine[-1].level == DiagnosticStatus.OK
    assert float(values["rate [Hz]"]) > 1.0
    assert 0.0 <= float(values["largest latency [s]"]) < 5.0
    assert values["level"] == "OK"
    assert values["nearest locus"].startswith("transversal 1")


def test_camera_markers_reach_a_late_viewer(loop):
    loop.status_at(CALM)
    late = loop.ros.collect(MarkerArray, "camera_markers", qos.LATCHED)
    loop.ros.spin_until(lambda: late, "the latched markers")
    assert {marker.ns for marker in late[0].markers} == {"camera", "camera_path", "status", "unobservable_motion"}
