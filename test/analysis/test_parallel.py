# SPDX-License-Identifier: Apache-2.0
"""The same results on one process, on several, and on a cluster that loses a worker."""

import os
import signal

import pytest
from distributed import LocalCluster

from plsing_ros.analysis.parallel import SchedulerError, run_tasks
from plsing_ros.cli.survey import survey_chunk

TASKS = [(7, chunk, 300) for chunk in range(6)]


def count(task):
    return survey_chunk(*task)


@pytest.fixture(scope="module")
def expected():
    return [count(task) for task in TASKS]


def test_processes_of_this_machine_give_the_same_to_the_last_digit(expected):
    assert list(run_tasks(count, TASKS, processes=2)) == expected
    assert list(run_tasks(count, TASKS[:1])) == expected[:1]


def test_a_killed_worker_changes_nothing(expected):
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        results = run_tasks(count, TASKS, scheduler=cluster.scheduler_address)
        found = [next(results)]
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        found += results
    assert found == expected


def test_a_scheduler_that_is_not_there_gets_a_sentence():
    with pytest.raises(SchedulerError, match="tcp://127.0.0.1:9"):
        list(run_tasks(count, TASKS, scheduler="tcp://127.0.0.1:9"))
