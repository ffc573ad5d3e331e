# SPDX-License-Identifier: Apache-2.0
"""The three nodes together, in lockstep over real topics, against two independent implementations' results."""

import numpy as np
import pytest
from builders import compute_plain_twist, start_pose
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from messages import mentions

from plsing_msgs.msg import LineFeatureArray
from plsing_ros.errors import PlsingError
from plsing_ros.levels import Level
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.simulation import near_transversal as experiment
from plsing_ros.simulation.servo_task import TIME_STEP
from plsing_ros.testing.lockstep import run_lockstep


def run(number, paper, executor="events", **options):
    return run_lockstep(
        f"Start {number}",
        paper,
        start={
            "start.position": experiment.STARTS[number - 1].position.tolist(),
            "start.orientation": experiment.ORIENTATION.tolist(),
            **options.pop("simulator", {}),
        },
        target={
            "target.position": experiment.TARGET_POSITION.tolist(),
            "target.orientation": experiment.ORIENTATION.tolist(),
            **options.pop("controller", {}),
        },
        arrived=experiment.ARRIVED,
        max_steps=options.pop("max_steps", experiment.MAX_STEPS),
        executor=executor,
        **options,
    )


def test_start_1_goes_straight_to_the_target_without_an_alert(paper):
    record = run(1, paper)
    assert record.arrived and record.distance_is_monotone
    # Measured for this set-up with ViSP and with plain numpy: 1636 iterations, 0.062 m/s, 4.1e-4, 0.68 m.
    assert len(record.time) == pytest.approx(1636, rel=0.01)
    assert record.linear_speed.max() == pytest.approx(0.062, rel=0.02)
    assert record.inverse_condition_number.min() == pytest.approx(4.1e-4, rel=0.02)
    assert record.distance.max() == pytest.approx(0.678, rel=0.02)
    assert record.first_alert is None
    # The error decays as exp(-lambda t), which no part of the loop computes.
    decay = np.polyfit(record.time, np.log(record.error_norm), 1)[0]
    assert decay == pytest.approx(-experiment.GAIN, rel=0.02)


def test_start_2_blows_up_at_the_transversal_and_is_announced(paper):
    record = run(2, paper)
    assert record.arrived and not record.distance_is_monotone
    # Chaotic, so by ratio: 1792 iterations, 18 m/s, 3.0e-6, 3.7 m.
    assert 1600 < len(record.time) < 2000
    assert record.linear_speed.max() > 100 * record.linear_speed[0]
    assert record.inverse_condition_number.min() < 1e-5
    assert 2.0 < record.distance.max() < 6.0
    # Law, start and target are known, so the harm is said as soon as the first roll-out is done.
    critical = next(alert for alert in record.alerts if alert.level is Level.CRITICAL)
    ten_fold = record.time[np.argmax(record.linear_speed > 10 * record.linear_speed[0])]
    assert critical.time < ten_fold - 0.5 and record.alerts[-1].level is Level.OK


def test_the_wrong_sign_of_the_twist_diverges_from_start_1(ros, paper):
    """What the loop would do if L had the paper's sign: the same numbers, the other way."""
    position = experiment.STARTS[0].position.tolist()
    ros.add(FeatureSimulatorNode, paper, {"mode": "lockstep", "publish_clock": True, "start.position": position})
    ros.add(ControllerNode, paper, {"use_sim_time": True}, remap={"cmd_twist": "right_twist"})
    poses = ros.collect(PoseWithCovarianceStamped, "camera_pose")
    features = ros.collect(LineFeatureArray, "line_features")
    wrong = ros.publisher(TwistStamped, "cmd_twist")

    def turn(message):
        v, w = message.twist.linear, message.twist.angular
        v.x, v.y, v.z, w.x, w.y, w.z = -v.x, -v.y, -v.z, -w.x, -w.y, -w.z
        wrong.publish(message)

    ros.node.create_subscription(TwistStamped, "right_twist", turn, 10)
    ros.spin_until(lambda: features and features[-1].header.stamp.sec >= 5, "four seconds of simulation", 30.0)
    distances = [
        np.linalg.norm(np.array([p.x, p.y, p.z]) - experiment.TARGET_POSITION)
        for p in (each.pose.pose.position for each in poses)
    ]
    assert distances[-1] > 1.2 * distances[0]


@pytest.mark.parametrize("executor", ["events", "single"])
def test_both_executors_give_the_same_run(paper, executor):
    record = run(4, paper, executor, max_steps=60)
    # The same run in plain numpy, without nodes.
    pose = start_pose(4)
    for row in range(60):
        np.testing.assert_allclose(record.position[row], pose.translation, atol=1e-9)
        expected = compute_plain_twist(pose)
        np.testing.assert_allclose(record.twist[row], expected, rtol=1e-5, atol=1e-8)
        pose = pose.integrate(expected, TIME_STEP)


def test_noise_makes_the_run_another_one_but_the_same_seed_the_same(paper):
    noisy = {"noise": 1e-4, "seed": 3}
    first, second, exact = (run(1, paper, simulator=each, max_steps=30) for each in (noisy, noisy, {}))
    np.testing.assert_array_equal(first.position, second.position)
    assert np.abs(first.position - exact.position).max() > 1e-6


def test_a_loop_that_stops_says_what_it_received(paper):
    with pytest.raises(PlsingError, match=r"\bframe 2\b.*Start 1\b") as caught:
        run(1, paper, controller={"camera_frame": "another_camera"})
    assert mentions(str(caught.value), "'another_camera'")


def test_progress_and_alerts_are_reported_as_they_come(paper):
    frames, alerts = [], []
    run(4, paper, max_steps=20, on_frame=lambda *values: frames.append(values), on_alert=alerts.append)
    assert [number for number, _ in frames] == list(range(1, 21))
    assert frames[0][1] == pytest.approx(0.412, abs=0.001)
    assert {Level.WARN, Level.CRITICAL} & {alert.level for alert in alerts}


def test_builders_do_not_share_the_law_with_the_nodes():
    """The textbook law that other tests compare with brings a camera to the target by itself."""
    pose = start_pose(1)
    for _ in range(400):
        pose = pose.integrate(compute_plain_twist(pose, gain=1.0), 0.04)
    np.testing.assert_allclose(pose.translation, experiment.TARGET_POSITION, atol=1e-4)
