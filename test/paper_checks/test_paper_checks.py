# SPDX-License-Identifier: Apache-2.0
"""Claims on made-up runs: those that hold, and those that do not."""

from dataclasses import replace

import numpy as np

from paper.paper_checks import check_paper
from paper.scenes import PRINTED_L_M
from paper.tasks import STARTS_FIVE, STARTS_FOUR, TRAJECTORIES
from plsing_ros.simulation.run_record import RunRecord

TIME = np.arange(0.0, 60.0, 0.1)
ALONG = np.array(PRINTED_L_M[:3])


def run(name, position, inverse, target=(0.0, 0.0, 0.0), rate=0.1):
    velocity = np.gradient(position, TIME, axis=0)
    twist = np.column_stack([velocity, np.zeros_like(velocity)])
    error = 0.1 * np.exp(-rate * TIME)
    return RunRecord(name, TIME, position, twist, error, np.asarray(inverse), np.array(target), True, (), "arrived")


def straight(name, rate=0.1):
    return run(name, np.outer(np.exp(-rate * TIME), [0.6, 0.0, 0.0]), np.full(len(TIME), 1e-3), rate=rate)


def with_a_bump(name, height, width=0.15):
    bump = height * np.exp(-(((TIME - 7.0) / width) ** 2))
    position = np.outer(np.exp(-0.1 * TIME), [0.6, 0.0, 0.0]) + bump[:, np.newaxis] * ALONG
    return run(name, position, 1e-3 - 0.999e-3 * np.exp(-(((TIME - 7.0) / width) ** 2)))


def held(group, *records):
    return {
        paper_check.statement.split(":")[0] + str(i): paper_check.holds
        for i, paper_check in enumerate(check_paper({group: records})[group])
    }


def test_runs_as_the_paper_tells_of_them_fulfil_all_claims():
    runs = [straight("1"), with_a_bump("2", 3.0), straight("3"), with_a_bump("4", 0.3, 1.0)]
    assert all(held(STARTS_FOUR, *runs).values())


def test_four_calm_runs_do_not():
    answers = list(held(STARTS_FOUR, *(straight(name) for name in "1234")).values())
    assert answers == [True, True, True, False, False, False, True, False]


def test_a_wrong_rate_and_a_run_that_does_not_arrive_are_noticed():
    runs = [straight("1", rate=0.12), replace(with_a_bump("2", 3.0), arrived=False), straight("3"), straight("4")]
    answers = list(held(STARTS_FOUR, *runs).values())
    assert answers[1] is False and answers[2] is False and answers[0] is True


def test_five_lines_need_large_deviations():
    calm = held(STARTS_FIVE, *(straight(name) for name in "1234"))
    assert list(calm.values()) == [True, True, False, False, False]
    wild = held(STARTS_FIVE, straight("1"), with_a_bump("2", 3.0), straight("3"), with_a_bump("4", 3.0))
    assert list(wild.values()) == [True] * 5


def test_trajectories_are_judged_by_error_and_place():
    target = np.column_stack([0.05 * TIME, 0.0 * TIME, 0.0 * TIME])
    bump = np.exp(-(((TIME - 25.0) / 0.2) ** 2))[:, np.newaxis] * [0.0, 1.0, 0.0]
    lag = np.array([0.0, 0.0, 0.1])

    def following(extra):
        return replace(run("t", target + lag + extra, np.full(len(TIME), 1e-3)), target=target)

    assert list(held(TRAJECTORIES, following(bump), following(0.0 * bump)).values()) == [True] * 4
    assert list(held(TRAJECTORIES, following(0.0 * bump), following(bump)).values()) == [False] * 4
    late = np.roll(bump, 200, axis=0)
    assert list(held(TRAJECTORIES, following(late), following(0.0 * bump)).values()) == [True, True, True, False]
