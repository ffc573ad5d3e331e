# SPDX-License-Identifier: Apache-2.0
"""Evaluations: of a task that is known to be unsafe, one that is safe, and the parts that they rest on."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from messages import mentions
from scipy.stats import binom
from strategies import line_sets, poses

import plsing_ros as pl
from plsing_ros.analysis import parallel
from plsing_ros.analysis.checkpoint import Checkpoint
from plsing_ros.analysis.evaluation.closed_loop import RunResult, RunTask, simulate_run
from plsing_ros.analysis.evaluation.evaluation import Evaluation, Safety, evaluate, name_of
from plsing_ros.analysis.evaluation.maps import MapResult
from plsing_ros.analysis.evaluation.setup import HARD, YOURS, Setup
from plsing_ros.analysis.parallel import Workers
from plsing_ros.analysis.rates import Rate
from plsing_ros.cli.evaluate import main
from plsing_ros.geometry.rotations import rotation_vector
from plsing_ros.parameters import ControllerParameters, MonitorParameters, PoseEstimatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.planning.rollout import Harm
from plsing_ros.simulation.segment_camera import SegmentCamera
from plsing_ros.simulation.simulated_robot import SimulatedRobot

PAPER, SMALL = str(config_file("paper_p4l.yaml")), str(config_file("small_object.yaml"))


def setup_of(file, **changes):
    values = {node: read_parameters(file, node) for node in ("controller", "singularity_monitor", "pose_estimator")}
    start = read_parameters(file, "feature_simulator")
    return Setup.of_parameters(
        ControllerParameters.from_values(values["controller"] | changes),
        MonitorParameters.from_values(values["singularity_monitor"]),
        PoseEstimatorParameters.from_values(values["pose_estimator"]),
        pl.Pose.from_quaternion(start["start.position"], start["start.orientation"]),
        0.04,
    )


@given(st.integers(1, 300), st.data())
def test_intervals_contain_the_shares_that_make_such_a_count_likely(total, data):
    """Wilson's interval is that of the score test: at its ends the count is 1.96 standard deviations off."""
    hits = data.draw(st.integers(0, total))
    low, high = Rate(hits, total).interval
    assert 0.0 <= low <= hits / total <= high <= 1.0
    for end in (low, high):
        if 0.0 < end < 1.0:
            off = abs(hits - binom.mean(total, end)) / binom.std(total, end)
            assert off == pytest.approx(1.959964, rel=1e-5)


@given(lines=line_sets(min_size=3, max_size=8), pose=poses(), half=st.floats(0.2, 1.5))
def test_what_is_in_view_is_what_points_of_the_segments_say(lines, pose, half):
    ends = np.stack([lines.pivot - lines.direction, lines.pivot + 2.0 * lines.direction], axis=1)
    camera = SegmentCamera(lines, ends, 0.0, (half, 0.7 * half), 0.1, 0.0, "camera")
    share = np.linspace(0.0, 1.0, 4001)[:, np.newaxis]
    for segment, seen in zip(ends, camera.visible(pose), strict=True):
        points = (segment[0] + share * (segment[1] - segment[0]) - pose.translation) @ pose.rotation
        z = points[:, 2]
        margin = np.min([z - 0.1, half * z - np.abs(points[:, 0]), 0.7 * half * z - np.abs(points[:, 1])], axis=0).max()
        if abs(margin) > 2e-3:
            assert seen == (margin > 0.0)


def test_image_noise_is_as_large_as_it_is_said_to_be():
    setup = setup_of(SMALL)
    camera, generator = setup.camera(setup.map), np.random.default_rng(1)
    exact = pl.LineObservation.of_lines(setup.map.transformed(setup.start.inverse(), "camera")).image_lines
    seen = np.array([camera.observe(setup.start, generator).image_lines for _ in range(500)])
    turn = exact[:, 0] * seen[:, :, 1] - exact[:, 1] * seen[:, :, 0]
    angle = np.arctan2(turn, (exact[:, :2] * seen[:, :, :2]).sum(axis=2))
    np.testing.assert_allclose([angle.std(), (seen[:, :, 2] - exact[:, 2]).std()], setup.noise, rtol=0.05)


def test_a_robot_is_late_lags_and_is_no_faster_than_it_can():
    twist = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])
    robot = SimulatedRobot(pl.Pose.look_at((0, 0, 0), (1, 0, 0)), 0.01, 3, 0.0, 0.1, (0.5, 1.0))
    for _ in range(3):
        robot.step(twist)
    assert np.linalg.norm(robot.T_world_camera.translation) == 0.0
    for _ in range(100):
        robot.step(twist)
    # v (t - T (1 - exp(-t / T))) of a first-order lag.
    assert np.linalg.norm(robot.T_world_camera.translation) == pytest.approx(
        0.5 * (1.0 - 0.1 * (1.0 - math.exp(-10.0))), rel=1e-9
    )


def test_true_lines_are_off_by_the_tolerances():
    setup = setup_of(SMALL)
    lines, generator = setup.map, np.random.default_rng(2)
    drawn = [setup.true_lines(generator) for _ in range(400)]
    turn = [np.arccos(np.minimum((each.direction * lines.direction).sum(axis=1), 1.0)) for each in drawn]
    # Two axes across the line, so that the squares have mean 2 std^2.
    assert np.sqrt(np.mean(np.square(turn)) / 2.0) == pytest.approx(2e-3, rel=0.05)
    offset = np.array([np.cross(each.point - lines.pivot, each.direction) for each in drawn])
    assert np.sqrt((offset**2).sum(axis=2).mean() / 2.0) == pytest.approx(5e-4, rel=0.06)


def test_runs_of_the_same_number_differ_by_the_law_alone_and_the_monitor_changes_nothing():
    setup = setup_of(SMALL)
    results = [
        RunResult(**simulate_run(RunTask(setup, law, YOURS, 3, watched)))
        for law, watched in (("guarded", False), ("guarded", True), ("position", False))
    ]
    assert results[0].trace == results[1].trace
    assert results[0].trace[0][:4] == results[2].trace[0][:4]
    assert results[0].trace[5] != results[2].trace[5]
    start = setup.start_of(YOURS, np.random.default_rng(4))
    assert 0.0 < np.linalg.norm(rotation_vector(start.rotation.T @ setup.start.rotation)) < 0.1


def test_hard_starts_lead_across_the_locus():
    setup = setup_of(PAPER)
    for number in range(5):
        start, target = setup.start_of(HARD, np.random.default_rng(number)).translation, setup.target.translation
        path = start + np.linspace(0.0, 1.0, 200)[:, np.newaxis] * (target - start)
        assert min(setup.singular.nearest_locus(center).distance for center in path) < 0.1


@pytest.mark.slow
def test_the_papers_task_is_not_safe_with_the_plain_law_and_is_with_another(tmp_path, capsys):
    """The paper's own Start 2: the plain law blows up; the way round the transversal does not."""
    arguments = [PAPER, "--runs", "4", "--maps", "2", "--laws", "detour", "--processes", "1"]
    assert main([*arguments, "--output", str(tmp_path)]) == 3
    said = capsys.readouterr().out
    assert mentions(said.splitlines()[0], "not safe", "4 of 4", "pinv", "harm")
    assert mentions(said, "law: detour", "transversal 1")
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 4
    assert "http" not in page.replace("http-equiv", "")
    # What is done is not done again, and the answer is the same.
    (kept,) = tmp_path.glob("*.jsonl")
    before = kept.read_bytes()
    lines = kept.read_text().splitlines(keepends=True)
    kept.write_text("".join(lines[:5]) + lines[5][:40])
    assert main([*arguments, "--output", str(tmp_path)]) == 3
    assert capsys.readouterr().out == said
    assert sorted(kept.read_text().splitlines()) != [] and set(before.splitlines()) <= set(
        kept.read_bytes().splitlines()
    )


@pytest.fixture(scope="module")
def small():
    return evaluate(setup_of(SMALL), 2, 2, laws=("position",), max_harm=0.7)


@pytest.mark.slow
def test_the_small_object_is_safe_as_far_as_the_runs_tell(small):
    assert small.safety is Safety.SAFE, small
    assert [small.harm(law) for law in small.laws] == [Rate(0, 2)] * 2
    assert 0.0 < small.end_error < 0.02 and 3.0 < small.nees < 12.0
    strict = dataclasses.replace(small, max_harm=0.1)
    assert strict.safety is Safety.UNKNOWN and "--runs" in " ".join(strict.advice)


@pytest.mark.slow
def test_processes_give_the_same_answer(small, monkeypatch):
    monkeypatch.setattr(parallel, "_WORTH", 0.0)
    with Workers(processes=2) as workers:
        found = evaluate(setup_of(SMALL), 2, 2, laws=("position",), workers=workers)
    assert found.runs == small.runs and found.maps == small.maps


def run_of(number, harm=Harm.NONE, law="pinv", **values):
    return RunResult(law, values.pop("kind", YOURS), number, int(harm), **values)


def test_the_verdict_follows_from_the_counts():
    setup = setup_of(SMALL, law="pinv")
    safe = [run_of(i, time=5.0, error=0.001, nees=6.0, poses=1) for i in range(60)]

    def verdict(runs, maps=()):
        return Evaluation(setup, tuple(runs), tuple(maps), 0.1, 0.1, 0.02)

    assert verdict(safe).safety is Safety.SAFE
    assert verdict(safe[:20]).safety is Safety.UNKNOWN
    harmed = [run_of(i, Harm.AWAY, time=3.0) for i in range(15)]
    assert verdict([*safe[:45], *harmed]).safety is Safety.UNSAFE
    near = verdict(safe, [MapResult(0, 0.03, "transversal 1"), MapResult(1, 0.2, "transversal 1")])
    assert near.safety is Safety.CARE and near.near_maps == Rate(1, 2)
    alerts = [
        run_of(0, Harm.AWAY, time=3.0, first_alert=2.6),  # 0.5 s are needed with a gain of 0.5
        run_of(1, Harm.AWAY, time=3.0, first_alert=2.4),
        run_of(2, Harm.AWAY, time=0.2, first_alert=0.0),
        run_of(3, Harm.LATE, time=9.0),
        run_of(4, first_alert=1.0, time=5.0),
        run_of(5, demand=1.5, demand_time=1.0, first_alert=1.0, time=5.0),
        run_of(6, time=5.0, kind=HARD),
    ]
    found = verdict(alerts)
    assert (found.announced, found.false_alarms) == (Rate(2, 4), Rate(1, 2))


def test_results_of_another_setup_are_not_taken(tmp_path):
    one, other = setup_of(SMALL), setup_of(SMALL, gain=0.6)
    assert name_of(one) == name_of(setup_of(SMALL)) != name_of(other)
    Checkpoint(tmp_path / "a", {"evaluation": name_of(one)})
    with pytest.raises(pl.PlsingError, match=r"\ba\b.*evaluation"):
        Checkpoint(tmp_path / "a", {"evaluation": name_of(other)})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["/nowhere.yaml"], "/nowhere.yaml"),
        ([PAPER, "--runs", "0"], "--runs is 0"),
        ([PAPER, "--noise", "nan"], "--noise is nan"),
        ([PAPER, "--target", "0", "inf", "0"], "--target"),
        pytest.param(
            [PAPER, "--scheduler", "tcp://127.0.0.1:9", "--runs", "1"], "tcp://127.0.0.1:9", marks=pytest.mark.slow
        ),
    ],
)
def test_bad_input_of_an_evaluation_is_one_sentence(arguments, words, capsys):
    assert main(arguments) == 1
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1


def test_a_file_without_a_start_says_what_is_missing(tmp_path, capsys):
    file = tmp_path / "scene.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    lines: {points: [0,0,0,1,0,0,0,1,0], directions: [1,0,0,0,1,0,0,0,1]}\n"
    )
    assert main([str(file)]) == 1
    assert "--target" in capsys.readouterr().err
    assert main([str(file), "--target", "3", "3", "3"]) == 1
    assert "--start" in capsys.readouterr().err
