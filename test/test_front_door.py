# SPDX-License-Identifier: Apache-2.0
"""`import plsing_ros as pl`: the names of the front door, used as a newcomer uses them."""

import subprocess
import sys

import numpy as np
import pytest
from messages import mentions

import plsing_ros as pl

POINTS = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0.5]]
DIRECTIONS = [[1, 0, 0], [0, 1, 0.2], [0, 0.3, 1], [1, 1, 0], [1, 0, 1]]
LINES = pl.LineSet.from_points_directions(POINTS, DIRECTIONS)
FOUR = pl.LineSet.from_points_directions(POINTS[:4], DIRECTIONS[:4], ids=[5, 7, 9, 11])
START, TARGET = pl.Pose.look_at((3, 2, 2), (0, 0, 0)), pl.Pose.look_at((2.5, 2.5, 2), (0, 0, 0))


def image_only(pose, lines=LINES):
    seen = pl.project(lines, pose)
    return pl.LineObservation.from_image_lines(seen.ids, seen.image_lines)


def moved_towards_target(twist):
    return np.linalg.norm(START.integrate(twist, 0.1).translation - TARGET.translation) < np.linalg.norm(
        START.translation - TARGET.translation
    )


def test_a_pose_is_accepted_wherever_a_centre_is():
    singular = pl.singular_set(FOUR)
    by_pose, by_center = singular.distances(START), singular.distances(START.translation)
    assert [each.distance for each in by_pose] == [each.distance for each in by_center]
    nearest = singular.nearest_locus(START)
    expected = np.linalg.norm(nearest.closest_point - START.translation)
    assert nearest.distance == pytest.approx(expected) and nearest.name in singular.locus_names
    assert singular.unobservable_motions(START) == singular.unobservable_motions(START.translation)


def test_the_optical_axis_passes_where_the_camera_looks_and_down_is_down():
    pose = pl.Pose.look_at((3, 2, 2), (0, 0, 0))
    np.testing.assert_allclose(np.cross(pose.rotation[:, 2], [3, 2, 2]), 0.0, atol=1e-12)
    assert pose.rotation[2, 1] < 0.0


@pytest.mark.parametrize("law", ["pinv", "guarded"])
def test_image_lines_are_lifted_by_the_pose_that_is_given_or_that_they_show(law):
    def command(seen, **known):
        return pl.ServoController(LINES, target=TARGET, law=law, gain=0.5).step(seen, time=0, **known)

    whole = command(pl.project(LINES, START))
    assert whole.mode.name == "SERVOING" and moved_towards_target(whole.twist)
    np.testing.assert_allclose(command(image_only(START), pose=START).twist, whole.twist, atol=1e-9)
    np.testing.assert_allclose(command(image_only(START)).twist, whole.twist, atol=1e-6)


def test_what_cannot_be_lifted_halts_with_the_reason():
    controller = pl.ServoController(target=pl.project(LINES, TARGET))
    halted = controller.step(image_only(START), time=0.0)
    assert halted.mode.name == "HALTED" and "3-D lines" in halted.reason and not halted.twist.any()
    assert controller.step(pl.project(LINES, START), time=0.1).mode.name == "SERVOING"
    assert "time" in controller.step(pl.project(LINES, START), time=np.nan).reason


def test_time_begins_anywhere_and_a_late_frame_changes_nothing():
    monitor = pl.SingularityMonitor(FOUR, target=TARGET)
    first = monitor.assess(pl.project(FOUR, START), time=0, pose=START, twist=[0.1, 0, 0, 0, 0, 0])
    assert first.level.name in ("OK", "WARN") and first.trend.name != "UNKNOWN"
    assert monitor.assess(image_only(TARGET, FOUR), time=-0.05, pose=TARGET) is first
    bare = monitor.assess(image_only(TARGET, FOUR), time=0.1)
    assert bare.level.name == "UNOBSERVABLE" and bare.reason


def test_options_with_dots_are_nested_and_errors_speak_of_the_argument():
    controller = pl.ServoController(LINES, target=TARGET, law="detour", detour={"margin": 0.3}, gain=np.float64(0.7))
    assert controller.parameters.detour_margin == 0.3 and controller.parameters.gain == 0.7
    for options in ({"gain": -1.0}, {"gian": 1.0}, {"detour": {"margn": 1.0}}):
        with pytest.raises(pl.PlsingError, match="argument"):
            pl.ServoController(LINES, target=TARGET, **options)
    with pytest.raises(pl.PlsingError, match="argument 'noise.image'"):
        pl.estimate_pose(LINES, image_only(START), noise={"image": -1.0})


def test_an_estimate_is_the_pose_of_the_camera():
    estimate = pl.estimate_pose(LINES, image_only(START))
    assert estimate.verdict.name == "OK" and estimate.covariance.shape == (6, 6)
    assert estimate.pose.is_close(START, 1e-6)


def test_a_simulated_run_arrives_and_can_be_drawn(tmp_path):
    run = pl.simulate(LINES, START, TARGET, gain=2.0)
    assert run.arrived and run.poses[-1].is_close(TARGET, 2e-3)
    assert run.twists.shape == (len(run.times), 6) == (len(run.poses), 6)
    moved = run.poses[0].integrate(run.twists[0], run.times[1])
    assert moved.is_close(run.poses[1], 1e-9)
    run.plot(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000
    short = pl.simulate(LINES, START, TARGET, gain=2.0, max_time=0.5)
    assert not short.arrived and "0.5 s" in short.reason


def test_results_print_as_a_summary():
    run = pl.simulate(LINES, START, TARGET, gain=2.0)
    seen = pl.project(LINES, START)
    texts = {
        "5 lines in frame world": LINES,
        "position (3, 2, 2) m": START,
        "isolated point 1": pl.singular_set(FOUR),
        "5 usable": seen,
        "SERVOING": pl.ServoController(LINES, target=TARGET).step(seen, time=0),
        "OK: ": pl.SingularityMonitor(LINES).assess(seen, time=0, pose=START),
        "standard deviation": pl.estimate_pose(LINES, seen),
        "arrived after": run,
    }
    for words, result in texts.items():
        assert words in str(result)
    assert f"{pl.ServoController(LINES, target=TARGET).step(seen, time=0).mode}" == "SERVOING"
    measured = pl.singular_set(pl.LineSet.from_points_directions(POINTS[:4], DIRECTIONS[:4], position_std=1e-3))
    assert measured.loci and all(str(locus).startswith(locus.name) for locus in measured.loci)
    assert "standard deviation" in str(measured.proximity(START)) and len(repr(measured.loci[0])) < 500


def test_an_argument_of_another_type_is_named():
    controller, monitor = pl.ServoController(LINES, target=TARGET), pl.SingularityMonitor(LINES, target=TARGET)
    halted = controller.step(None, time=0)
    assert halted.mode.name == "HALTED" and "observation" in halted.reason and not halted.twist.any()
    for call in (
        lambda: monitor.assess([1.0, 0.0, 0.0], time=0),
        lambda: pl.estimate_pose(LINES, None),
        lambda: pl.PoseFilter(LINES).update("seen", 0.0),
        lambda: pl.project(LINES, [1.0, 2.0, 3.0]),
    ):
        with pytest.raises(pl.PlsingError, match="LineObservation|Pose"):
            call()


def test_it_imports_with_numpy_and_scipy_alone():
    """In a process where every other package of the environment is out of reach."""
    script = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"yaml", "sympy", "mpmath", "matplotlib", "cv2", "mujoco", "dask", "rosbags", "rclpy",
                                  "tqdm", "plotly", "poselib"}:
            raise ImportError(name)
sys.meta_path.insert(0, Refuse())
import plsing_ros as pl
lines = pl.LineSet.from_points_directions([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0.2], [0, 0.3, 1]])
pose = pl.Pose.look_at((3, 2, 2), (0, 0, 0))
pl.singular_set(lines).nearest_locus(pose)
print(pl.ServoController(lines, target=pose).step(pl.project(lines, pose), time=0).mode.name)
for what in (pl.simulate(lines, pose, pose, max_time=0.1).plot, lambda: pl.read_model("box.yaml")):
    try:
        what()
    except pl.PlsingError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    mode, drawing, reading = done.stdout.splitlines()
    assert mode == "CONVERGED" and mentions(drawing, "matplotlib") and mentions(reading, "PyYAML")
