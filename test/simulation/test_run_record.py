# SPDX-License-Identifier: Apache-2.0
import numpy as np
from messages import mentions

from plsing_ros.levels import Level
from plsing_ros.simulation.run_record import Alert, RunRecord, summary_table


def record(positions, alerts=(), arrived=True):
    k = len(positions)
    twist = np.zeros((k, 6))
    twist[:, 0] = [0.1, 3.0, 0.2][:k]
    position = np.column_stack([positions, np.zeros(k), np.zeros(k)])
    return RunRecord(
        "a run", 0.5 * np.arange(k), position, twist, np.ones(k), np.full(k, 0.25), np.zeros(3), arrived, tuple(alerts)
    )


def test_summary_numbers():
    run = record([2.0, 3.0, 0.0], [Alert(-1.0, Level.STALE, ""), Alert(0.1, Level.OK, ""), Alert(0.2, Level.WARN, "w")])
    assert run.time_of_peak == 0.5 and not run.distance_is_monotone
    assert run.first_alert.level is Level.WARN
    row = summary_table([run]).splitlines()[-1]
    assert row.split() == ["a", "run", "3", "3", "0.25", "3", "no", "WARN", "at", "0.20", "s", "0.30"]


def test_a_run_without_alerts_that_does_not_arrive():
    row = summary_table([record([3.0, 2.0, 1.0], arrived=False)]).splitlines()[-1]
    assert mentions(row, 3, "not arrived", "yes", "none")
