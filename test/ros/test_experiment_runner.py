# SPDX-License-Identifier: Apache-2.0
"""Servo tasks through the real nodes, against the same tasks in the core."""

from dataclasses import replace

import numpy as np
import pytest
from messages import mentions

from paper.document import max_difference, runs_agree
from paper.tasks import QUADRIFOLIA, STARTS_FIVE, STARTS_FOUR, TRAJECTORIES, paper_tasks
from plsing_msgs.msg import ControllerState, LineFeatureArray
from plsing_ros.errors import PlsingError
from plsing_ros.nodes import qos
from plsing_ros.planning.camera_path import SpeedLimits
from plsing_ros.planning.detour import DetourOptions
from plsing_ros.simulation import servo_run as core_run
from plsing_ros.simulation.servo_run import run_in_core
from plsing_ros.testing import experiment_runner
from plsing_ros.testing.experiment_runner import run_in_nodes
from plsing_ros.testing.harness import Harness

TASKS = paper_tasks()


def shortened(group, number, duration, **changes):
    task = TASKS[group][number]
    return replace(task, path=replace(task.path, duration=duration), **changes)


@pytest.mark.parametrize("executor", ["events", "single"])
@pytest.mark.parametrize(
    "task",
    [
        shortened(TRAJECTORIES, 0, 1.2),
        shortened(QUADRIFOLIA, 1, 1.2, noise_on="both"),
        shortened(STARTS_FIVE, 1, 1.2),
    ],
    ids=["moving", "noise in the image", "five lines"],
)
def test_nodes_and_core_give_the_same_run(task, executor):
    frames = []
    nodes = run_in_nodes(task, on_frame=lambda *values: frames.append(values), executor=executor)
    core = run_in_core(task)
    assert len(nodes.time) == 31 and nodes.ended == core.ended == "time is over"
    assert runs_agree(core, nodes)
    assert max_difference(core, nodes) < 1e-9
    np.testing.assert_allclose(nodes.twist, core.twist, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(nodes.error_norm, core.error_norm, rtol=1e-9)
    np.testing.assert_allclose(nodes.inverse_condition_number, core.inverse_condition_number, rtol=1e-6)
    np.testing.assert_array_equal(nodes.target, core.target)
    assert [number for number, _ in frames] == list(range(1, 32))
    np.testing.assert_allclose([distance for _, distance in frames], nodes.distance)


def test_a_changed_path_is_published_like_any_other():
    """A clover in 5 s, beside the isolated point in its centre."""
    task = shortened(QUADRIFOLIA, 1, 5.0, law={"law": "guarded", "max_linear_speed": 3.0})
    task = replace(task, avoidance=DetourOptions(margin=0.1, limits=SpeedLimits(2.0, 2.0)))
    nodes, core = run_in_nodes(task), run_in_core(task)
    assert len(core.changes) >= 3 and core.changes == nodes.changes
    assert len(nodes.time) == 126 and runs_agree(core, nodes)
    apart = np.linalg.norm(nodes.position - task.path.middle, axis=1)
    assert apart.min() > 0.06
    unchanged = run_in_core(replace(task, avoidance=None))
    assert np.linalg.norm(unchanged.position - task.path.middle, axis=1).min() < 0.03


def test_a_run_that_arrives_and_one_that_is_lost_end():
    arriving = replace(TASKS[STARTS_FOUR][0], arrived=0.65)
    assert run_in_nodes(arriving).ended == "arrived"
    lost = run_in_nodes(TASKS[QUADRIFOLIA][2])
    assert lost.ended.startswith("lost") and lost.distance[-1] > 100.0


def test_a_twist_that_cannot_be_integrated_ends_the_run(monkeypatch):
    monkeypatch.setattr(core_run, "LOST", 1e30)
    task = shortened(QUADRIFOLIA, 2, 20.0)
    nodes, core = run_in_nodes(task), run_in_core(task)
    for record in (nodes, core):
        assert mentions(record.ended, "lost", "twist", "1e+09")
    assert len(nodes.time) == len(core.time) < 500


def test_an_overtaken_target_is_noticed():
    task = TASKS[TRAJECTORIES][0]
    with Harness(log_level="FATAL") as ros:
        ros.collect(LineFeatureArray, "line_features")
        ros.collect(LineFeatureArray, "desired_line_features", qos.LATCHED)
        source = experiment_runner._TargetSource(ros, task)
        state = ControllerState(mode=ControllerState.MODE_SERVOING, error_norm=0.5)
        state.header.stamp.sec = 1
        source._error_norms[1_000_000_000] = 0.5
        source.check(state)
        source._error_norms[1_000_000_000] = 0.4
        with pytest.raises(PlsingError, match=r"error norm 0\.5\b.*\b0\.4\b"):
            source.check(state)
