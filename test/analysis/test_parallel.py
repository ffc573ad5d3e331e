# SPDX-License-Identifier: Apache-2.0
"""The same results on one process, on several, and on a cluster that loses a worker."""

import contextlib
import io
import json
import os
import signal

import numpy as np
import pytest

import plsing_ros as pl
from plsing_ros.analysis import line_selection, parallel
from plsing_ros.analysis.checkpoint import Checkpoint
from plsing_ros.analysis.parallel import SchedulerError, Workers, run_tasks
from plsing_ros.cli import evaluate
from plsing_ros.cli.survey import survey_chunk
from plsing_ros.parameters.config_files import config_file

TASKS = [(7, chunk, 300) for chunk in range(6)]


def count(task):
    return survey_chunk(*task)


@pytest.fixture(scope="module")
def expected():
    return [count(task) for task in TASKS]


def count_or_die(task):
    """Dies at the second task, the first time that it comes."""
    *task, file = task
    if task[1] == 1 and not file.exists():
        file.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return survey_chunk(*task)


@pytest.mark.slow
def test_processes_of_this_machine_give_the_same_to_the_last_digit_though_one_is_killed(
    expected, tmp_path, monkeypatch
):
    monkeypatch.setattr(parallel, "_WORTH", 0.0)
    died = tmp_path / "died"
    assert list(run_tasks(count_or_die, [(*task, died) for task in TASKS], processes=2)) == expected
    assert died.exists()
    assert list(run_tasks(count, TASKS[:1])) == expected[:1]


@pytest.fixture(scope="module")
def cluster():
    # Processes that are started for the tests import this file, too.
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        yield cluster


def kill_a_worker(cluster):
    os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)


@pytest.mark.slow
def test_a_killed_worker_changes_nothing(expected, cluster):
    results = run_tasks(count, TASKS, scheduler=cluster.scheduler_address)
    found = [next(results)]
    kill_a_worker(cluster)
    found += results
    assert found == expected


def choose(**options):
    rng = np.random.default_rng(4)
    lines = pl.LineSet.from_points_directions(*rng.normal(size=(2, 16, 3)), position_std=5e-3, direction_std=5e-3)
    path = [pl.Pose.look_at((4.0 * np.cos(t), 4.0 * np.sin(t), 1.5), (0, 0, 0)) for t in np.linspace(0.0, 1.0, 12)]
    chosen = pl.select_lines(lines, 4, path, clearance=2.5, **options)
    return {name: getattr(chosen, name) for name in chosen.__dataclass_fields__}


@pytest.mark.slow
def test_lines_are_chosen_alike_by_one_process_by_two_and_by_a_cluster_that_loses_a_worker(
    cluster, tmp_path, monkeypatch
):
    # Tasks of a size that takes seconds in real use.
    monkeypatch.setattr("plsing_ros.analysis.line_search._BATCH", 300)
    monkeypatch.setattr(parallel, "_WORTH", 0.0)
    expected = choose()
    assert expected["dropped"]
    assert choose(processes=2, resume=tmp_path) == expected
    (file,) = tmp_path.iterdir()
    whole = file.read_text().splitlines(keepends=True)
    # As after a kill: half the results, the last of them cut off.
    file.write_text("".join(whole[: len(whole) // 2]) + whole[len(whole) // 2][:9])
    killed = []

    def progress(done, total):
        if not killed and total > 1000 and done >= 1000:
            killed.append(kill_a_worker(cluster))

    assert choose(scheduler=cluster.scheduler_address, resume=tmp_path, progress=progress) == expected
    assert killed
    kept = [json.loads(line) for line in file.read_text().splitlines() if line.endswith("}")]
    assert len({each["task"] for each in kept[1:]}) == len(whole) - 1
    monkeypatch.setattr(line_selection, "run_search_task", None)
    assert choose(resume=tmp_path) == expected


def evaluate_file(*options):
    """Return the answer of `evaluate` with few runs, as JSON."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        evaluate.main(
            [
                str(config_file("small_object.yaml")),
                "--runs",
                "2",
                "--maps",
                "2",
                "--laws",
                "position",
                "--json",
                *options,
            ]
        )
    return out.getvalue()


@pytest.mark.slow
def test_an_evaluation_on_a_cluster_that_loses_a_worker_is_that_of_one_process(tmp_path, monkeypatch):
    """With a cluster of its own, so that both workers are alive when it begins."""
    from distributed import LocalCluster

    expected = evaluate_file("--processes", "1", "--output", str(tmp_path / "one"))
    assert len(json.loads(expected)["laws"]) == 2
    killed = []
    add = Checkpoint.add

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:

        def add_and_kill(*args):
            add(*args)
            if not killed:
                killed.append(kill_a_worker(cluster))

        monkeypatch.setattr(Checkpoint, "add", add_and_kill)
        found = evaluate_file("--scheduler", cluster.scheduler_address, "--output", str(tmp_path / "many"))
    assert killed and found == expected


def test_a_file_of_something_else_is_left_alone(tmp_path):
    file = tmp_path / "notes"
    for content in (b"my notes\n", b"\xff\xfe\x00", b'{"selection": "other"}\n'):
        file.write_bytes(content)
        with pytest.raises(pl.PlsingError, match="notes"):
            Checkpoint(file, {"selection": "this"})
        assert file.read_bytes() == content


def test_no_process_at_all_is_refused():
    with pytest.raises(pl.PlsingError, match="0 processes"):
        Workers(processes=0)


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_gets_a_sentence():
    with pytest.raises(SchedulerError, match="tcp://127.0.0.1:9"):
        list(run_tasks(count, TASKS, scheduler="tcp://127.0.0.1:9"))
