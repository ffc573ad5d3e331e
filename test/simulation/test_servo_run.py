# SPDX-License-Identifier: Apache-2.0
"""Runs in the core against a loop of plain numpy."""

from dataclasses import replace

import numpy as np
import pytest
from messages import mentions

from paper.tasks import QUADRIFOLIA, STARTS_FOUR, TRAJECTORIES, paper_tasks
from paper.variants import PLAIN, Variant, all_variants, run_variants
from plsing_ros.geometry import LineSet
from plsing_ros.simulation.servo_run import run_in_core
from plsing_ros.simulation.servo_task import LOST
from plsing_ros.singularities import singular_set

TASKS = paper_tasks()


def shortened(task, duration, **changes):
    return replace(task, path=replace(task.path, duration=duration), **changes)


def image_and_matrix(direction, moment):
    """l' and L of lines in the camera frame: the derivative of l / delta along dl = u x v + l x w."""
    depth = np.hypot(moment[:, 0], moment[:, 1])
    rows = []
    for u, m, d in zip(direction, moment, depth, strict=True):
        change = np.column_stack([np.cross(u, e) for e in np.eye(3)] + [np.cross(m, e) for e in np.eye(3)])
        in_plane = np.array([m[0], m[1], 0.0])
        rows.append((np.eye(3) / d - np.outer(m, in_plane) / d**3) @ change)
    return (moment / depth[:, np.newaxis]).ravel(), np.concatenate(rows)


def seen(lines, pose):
    direction = lines.direction @ pose.rotation
    return direction, (lines.moment - np.cross(pose.translation, lines.direction)) @ pose.rotation


def plain_loop(task, frames):
    """The noisy lines go into L, the true ones into s: the paper's experiment in its own words."""
    generator = np.random.default_rng(task.seed)
    pose, positions = task.start_pose(), []
    for k in range(frames):
        positions.append(pose.translation)
        direction, moment = seen(task.lines, pose)
        known, arm = direction, moment
        if task.noise:
            known = direction + generator.normal(scale=task.noise, size=direction.shape)
            arm = moment + generator.normal(scale=task.noise, size=moment.shape)
            known /= np.linalg.norm(known, axis=1, keepdims=True)
            arm -= (arm * known).sum(axis=1, keepdims=True) * known
        s, _ = image_and_matrix(direction, moment)
        wanted, _ = image_and_matrix(*seen(task.lines, task.target_pose(k * task.time_step)))
        _, L = image_and_matrix(known, arm)
        pose = pose.integrate(-task.gain * np.linalg.pinv(L) @ (s - wanted), task.time_step)
    return np.array(positions)


@pytest.mark.parametrize(
    ("group", "number"), [(STARTS_FOUR, 1), (TRAJECTORIES, 0), (TRAJECTORIES, 1), (QUADRIFOLIA, 1)]
)
def test_a_run_is_that_of_a_plain_loop(group, number):
    task = shortened(TASKS[group][number], 2.4, arrived=0.0)
    record = run_in_core(task)
    assert len(record.time) == 61 and record.ended == "time is over" and not record.arrived
    np.testing.assert_allclose(record.position, plain_loop(task, 61), atol=1e-8)
    np.testing.assert_allclose(record.time, 0.04 * np.arange(61), atol=1e-12)


def test_noise_in_the_image_is_another_run():
    task = shortened(TASKS[TRAJECTORIES][1], 2.0)
    runs = {kind: run_in_core(replace(task, noise_on=kind)).distance for kind in ("lines", "image", "both")}
    assert runs["image"].max() > 2.0 * runs["lines"].max()
    assert runs["both"].max() > 2.0 * runs["lines"].max()


def test_a_run_ends_when_it_has_arrived():
    task = replace(TASKS[STARTS_FOUR][0], arrived=0.6)
    record = run_in_core(task)
    assert record.arrived and record.ended == "arrived"
    assert record.distance[-1] <= 0.6 < record.distance[-2]


def test_a_camera_that_is_lost_ends_the_run():
    record = run_in_core(TASKS[QUADRIFOLIA][2])
    assert record.ended.startswith("lost") and not record.arrived
    assert record.distance[-1] > LOST >= record.distance[:-1].max()
    # It happens at the first crossing of the isolated point, which the paper calls a particularly large error.
    assert record.time[-1] == pytest.approx(3.0, abs=0.6)


def test_the_seed_decides_the_noise():
    task = shortened(TASKS[TRAJECTORIES][1], 1.0)
    first, second, other = (run_in_core(each) for each in (task, task, replace(task, seed=1)))
    np.testing.assert_array_equal(first.position, second.position)
    assert np.abs(first.position - other.position).max() > 1e-6


def test_going_round_keeps_a_path_through_a_transversal_away_from_it():
    task = shortened(TASKS[TRAJECTORIES][0], 32.0)
    variants = all_variants({TRAJECTORIES: (task,)})
    guarded, detour = (run_in_core(variants[Variant("law", law)][TRAJECTORIES][0]) for law in ("guarded", "detour"))
    (transversal,) = (t for t in singular_set(task.lines).transversals if t.name == "transversal 2")
    closest = [
        np.linalg.norm(np.cross(run.position - transversal.point, transversal.direction), axis=1).min()
        for run in (guarded, detour)
    ]
    # Noise and delay take a part of the margin of 0.1 m.
    assert closest[0] < 0.01 and closest[1] > 0.07
    assert detour.inverse_condition_number.min() > 10.0 * guarded.inverse_condition_number.min()
    # The error is still that to the unchanged path: larger where it goes round, and as before afterwards.
    np.testing.assert_array_equal(detour.target, guarded.target)
    assert 0.1 < detour.distance.max() < 0.3 and detour.linear_speed.max() <= 0.3
    assert detour.distance[-1] == pytest.approx(guarded.distance[-1], abs=0.02)
    assert guarded.changes == () and len(detour.changes) == 1
    assert mentions(detour.changes[0], "transversal 2", "joined again")


def test_every_variant_is_run_in_order():
    tasks = {TRAJECTORIES: tuple(shortened(task, 0.2) for task in TASKS[TRAJECTORIES])}
    variants = all_variants(tasks)
    chosen = {
        variant: of for variant, of in variants.items() if variant == PLAIN or variant.key in ("20 ms", "guarded")
    }
    calls = []
    records = run_variants(chosen, jobs=1, on_run=lambda: calls.append(1))
    assert len(calls) == 6 and list(records) == list(chosen)
    for variant, of in records.items():
        assert [run.name for run in of[TRAJECTORIES]] == ["Trajectory 1", "Trajectory 2"]
        assert len(of[TRAJECTORIES][0].time) == (11 if variant.key == "20 ms" else 6)
    assert isinstance(TASKS[TRAJECTORIES][0].lines, LineSet)
