# SPDX-License-Identifier: Apache-2.0
"""The monitor by itself: status, distances, alerts, and what it says when it knows nothing."""

import numpy as np
import pytest
from builders import SCENE, start_pose
from messages import mentions
from monitor_loop import MonitorLoop, beside_transversal
from std_msgs.msg import Header

from plsing_msgs.msg import (
    LineFeatureArray,
    LocusDistance,
    SingularityAlert,
    SingularityStatus,
    SingularLoci,
)
from plsing_ros.features import rank_basis
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode


@pytest.fixture
def loop(ros, paper):
    return MonitorLoop(ros, paper)


def test_numbers_of_a_status_against_numpy(loop):
    status = loop.status_at(start_pose(1))
    assert status.level == SingularityStatus.LEVEL_OK and status.line_count == 4
    values = np.array(status.singular_values)
    assert status.inverse_condition_number == pytest.approx(values[-1] / values[0])
    assert status.inverse_condition_number == pytest.approx(6.553e-4, rel=1e-3)  # an independent implementation's
    assert status.header.frame_id == "camera_optical_frame"
    assert status.unobservable_motion_valid
    lost = status.unobservable_motion.linear
    # Near the transversal the least observable direction is the translation along it.
    assert np.linalg.norm([lost.x, lost.y, lost.z]) == pytest.approx(1.0, abs=1e-3)


def test_distances_are_those_to_where_the_rank_drops(loop):
    """Each closest point, put into the rank basis, makes it singular: nothing of the solver is used for that."""
    loci = loop.ros.collect(SingularLoci, "singular_loci", qos.LATCHED)
    loop.ros.spin_until(lambda: loci, "the latched loci")
    assert len(loci[0].transversal_names) == 2 and len(loci[0].isolated_point_names) == 6
    points = [
        *np.reshape(loci[0].transversal_points, (-1, 3)),
        *np.reshape(loci[0].isolated_points, (-1, 3)),
    ]
    for point in points:
        values = np.linalg.svd(rank_basis(SCENE, point, normalized=True))[1]
        assert values[-1] / values[0] < 1e-9

    status = loop.status_at(start_pose(1))
    assert status.distances_valid
    names = [*loci[0].transversal_names, *loci[0].isolated_point_names]
    assert list(status.locus_names)[: len(names)] == names
    center = start_pose(1).translation
    for k, (point, direction) in enumerate(
        zip(
            np.reshape(loci[0].transversal_points, (-1, 3)),
            np.reshape(loci[0].transversal_directions, (-1, 3)),
            strict=False,
        )
    ):
        expected = np.linalg.norm(np.cross(center - point, direction))
        assert status.locus_distances[k] == pytest.approx(expected, rel=1e-9)
    assert status.nearest.kind == LocusDistance.KIND_TRANSVERSAL and status.nearest.frame_id == "world"
    assert status.nearest.distance == pytest.approx(min(status.locus_distances[: len(names)]))


ONLY_TRANSVERSALS = {
    "warn.relative_inverse_condition_number": 0.0,
    "warn.relative_inverse_condition_number_exit": 0.0,
    "critical.relative_inverse_condition_number": 0.0,
    "warn.transversal_distance": 0.1,
    "critical.transversal_distance": 0.02,
    "prediction.horizon": 0.0,
}


def test_alerts_come_at_changes_of_level_only(ros, paper):
    at_once = {"debounce.raise": 1, "debounce.lower": 1}
    loop = MonitorLoop(ros, paper, **ONLY_TRANSVERSALS, **at_once)
    for distance in (0.6, 0.5, 0.09, 0.08, 0.07, 0.01, 0.009, 0.09, 0.6, 0.5):
        loop.status_at(beside_transversal(distance))
    ros.spin_for(0.1)
    levels = [each.level for each in loop.alerts if each.level != SingularityStatus.LEVEL_STALE]
    expected = [
        SingularityStatus.LEVEL_OK,
        SingularityStatus.LEVEL_WARN,
        SingularityStatus.LEVEL_CRITICAL,
        SingularityStatus.LEVEL_WARN,
    ]
    assert levels == [*expected, SingularityStatus.LEVEL_OK]
    for before, after in zip(loop.alerts, loop.alerts[1:], strict=False):
        assert after.previous_level == before.level
    critical = next(each for each in loop.alerts if each.level == SingularityStatus.LEVEL_CRITICAL)
    assert critical.text.startswith("CRITICAL: ")
    assert "transversal 1" in critical.text
    assert critical.nearest.distance == pytest.approx(0.02, abs=0.02)


def test_levels_change_only_after_some_cycles_of_the_same_opinion(ros, paper):
    loop = MonitorLoop(ros, paper, **ONLY_TRANSVERSALS, **{"debounce.raise": 3, "debounce.lower": 5})
    levels = [loop.status_at(beside_transversal(distance)).level for distance in (0.5, 0.05, 0.5, 0.05, 0.05, 0.05)]
    assert levels == [SingularityStatus.LEVEL_OK] * 5 + [SingularityStatus.LEVEL_WARN]
    levels = [loop.status_at(beside_transversal(0.5)).level for _ in range(6)]
    assert levels[3:] == [SingularityStatus.LEVEL_WARN, SingularityStatus.LEVEL_OK, SingularityStatus.LEVEL_OK]


def test_a_late_subscriber_receives_the_present_level(loop):
    loop.status_at(beside_transversal(0.01))
    late = loop.ros.collect(SingularityAlert, "singularity_alerts", qos.LATCHED)
    loop.ros.spin_until(lambda: late, "the latched alert")
    assert [each.level for each in late] == [SingularityStatus.LEVEL_CRITICAL]


def test_the_risk_of_the_run_is_published_before_the_camera_moves(ros, paper):
    law = {"prediction.controller": "law", "gain": 0.5, "max_linear_speed": 0.0, "max_angular_speed": 0.0}
    loop = MonitorLoop(ros, paper, **law, **{"camera.half_view": [0.02, 0.02]})

    def has_risk():
        return loop.status_at(start_pose(1)).risk_valid

    loop.ros.spin_until(has_risk, "the first answer of the roll-outs")
    status = loop.statuses[-1]
    assert status.risk > 0.9 and status.harm == SingularityStatus.HARM_FEW_LINES
    assert status.time_to_harm_valid and 0.0 <= status.time_to_harm <= 24.0
    assert mentions(status.harm_text, "three lines", "view") and "probability of harm 0.9" in status.reason


def test_without_any_features_it_says_so(loop):
    loop.ros.spin_until(lambda: len(loop.statuses) >= 2, "heartbeats")
    assert loop.statuses[-1].level == SingularityStatus.LEVEL_STALE
    assert "features" in loop.statuses[-1].reason
    assert not loop.statuses[-1].unobservable_motion_valid and len(loop.statuses[-1].singular_values) == 0


def test_features_that_stop_are_stale_and_the_old_numbers_are_gone(ros, paper):
    loop = MonitorLoop(ros, paper, features_timeout=0.5, heartbeat_period=0.05)
    loop.status_at(start_pose(1))
    loop.ros.spin_until(
        lambda: loop.statuses[-1].level == loop.alerts[-1].level == SingularityStatus.LEVEL_STALE,
        "the heartbeat to notice",
    )
    stale = loop.statuses[-1]
    assert mentions(stale.reason, "features")
    assert stale.inverse_condition_number == 0.0 and not stale.distances_valid
    assert loop.status_at(start_pose(1)).level == SingularityStatus.LEVEL_OK


def test_without_a_pose_it_takes_the_features_and_says_so(loop):
    status = loop.status_at(start_pose(1), with_pose=False)
    assert status.distances_valid
    assert status.position_source == "features"
    nearest = np.linalg.norm(start_pose(1).translation - point_of(status.nearest.closest_point))
    assert status.nearest.distance == pytest.approx(nearest, abs=1e-9)
    assert status.inverse_condition_number > 0.0


def test_a_pose_in_another_frame_is_not_used(loop):
    stamp = loop.now()
    loop.publish_pose(start_pose(2), stamp, frame="map")
    loop.ros.spin_for(0.1)
    assert loop.status_at(start_pose(1), with_pose=False).position_source == "features"


def point_of(message):
    return np.array([message.x, message.y, message.z])


def spoil_numbers(message):
    message.moments[0] = float("nan")


def spoil_visibility(message):
    message.visible = [1, 1, 0, 0]


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (spoil_numbers, "moments[0, 0] is nan"),
        (spoil_visibility, "2 of 4 lines are usable ([1, 2]); at least 3 are needed"),
    ],
)
def test_unusable_features_are_unobservable_with_the_reason(loop, spoil, reason):
    status = loop.status_at(start_pose(1), spoil)
    assert status.level == SingularityStatus.LEVEL_UNOBSERVABLE
    assert reason in status.reason
    assert loop.status_at(start_pose(1)).level == SingularityStatus.LEVEL_OK


def test_a_scene_singular_everywhere_is_unobservable(ros):
    """Four parallel lines, a corridor: translation along it is never seen."""
    parallel = {
        "lines.points": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0],
        "lines.directions": [0.0, 0.0, 1.0] * 4,
    }
    statuses = ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
    ros.add(SingularityMonitorNode, parameters={**parallel, "features_timeout": 5.0})
    publisher = ros.publisher(LineFeatureArray, "line_features")
    from plsing_ros.features import project_lines
    from plsing_ros.geometry import LineSet

    scene = LineSet.from_points_directions(
        np.reshape(parallel["lines.points"], (4, 3)), np.reshape(parallel["lines.directions"], (4, 3))
    )
    lines = scene.transformed(Pose.look_at([0.3, 0.4, -2.0], [0.6, 0.6, 0.0], down=(0, 1, 0)).inverse(), "camera")
    message = LineFeatureArray(
        header=Header(stamp=ros.node.get_clock().now().to_msg(), frame_id="camera_optical_frame"),
        ids=[1, 2, 3, 4],
        image_lines=project_lines(lines).tolist(),
        directions=lines.direction.ravel().tolist(),
        moments=lines.moment.ravel().tolist(),
    )
    publisher.publish(message)
    ros.spin_until(lambda: statuses and statuses[-1].header.stamp == message.header.stamp, "the status")
    assert statuses[-1].level == SingularityStatus.LEVEL_UNOBSERVABLE
    assert mentions(statuses[-1].reason, "singular", "every camera")
    assert statuses[-1].inverse_condition_number < 1e-12


def test_the_rate_is_the_difference_quotient(loop):
    first = loop.status_at(start_pose(1))
    second = loop.status_at(start_pose(3))
    assert not first.rate_valid and second.rate_valid
    seconds = second.header.stamp.sec - first.header.stamp.sec
    seconds += 1e-9 * (second.header.stamp.nanosec - first.header.stamp.nanosec)
    change = second.inverse_condition_number - first.inverse_condition_number
    assert second.inverse_condition_number_rate == pytest.approx(change / seconds)
