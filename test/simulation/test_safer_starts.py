# SPDX-License-Identifier: Apache-2.0
"""The paper's four starts with the laws guarded and detour: all arrive, slowly enough, and never far away."""

from dataclasses import replace

import numpy as np
import pytest

from paper.tasks import STARTS_FOUR, paper_tasks
from plsing_ros.simulation.servo_run import run_in_core
from plsing_ros.singularities import singular_set

# Start 1 by the plain law: test/ros/test_closed_loop.py and the README.
PLAIN_ITERATIONS, PLAIN_PEAK = 1637, 0.0621


@pytest.mark.parametrize("law", ["guarded", "detour"])
@pytest.mark.parametrize("task", paper_tasks()[STARTS_FOUR], ids=lambda task: task.name)
def test_a_safer_law_arrives_from_every_start(task, law):
    record = run_in_core(replace(task, law={"law": law}))
    assert record.arrived
    assert record.distance[-1] <= 1e-3
    assert len(record.time) <= 1.5 * PLAIN_ITERATIONS
    assert record.linear_speed.max() <= 3.0 * PLAIN_PEAK
    assert record.distance.max() <= 1.2 * record.distance[0]
    assert law == "detour" or np.all(np.diff(record.distance) < 0.0)


def test_with_noise_detour_keeps_clear_of_the_transversal_and_below_the_speed_limit():
    task = replace(paper_tasks()[STARTS_FOUR][1], law={"law": "detour"}, noise=5e-4, arrived=0.0)
    task = replace(task, path=replace(task.path, duration=18.0))
    record = run_in_core(task)
    transversal = singular_set(task.lines).transversals[0]
    apart = np.linalg.norm(np.cross(record.position - transversal.point, transversal.direction), axis=1)
    assert apart.min() > 0.1
    assert record.linear_speed.max() <= 0.15 + 1e-9
    assert record.distance.max() <= 1.2 * record.distance[0]
