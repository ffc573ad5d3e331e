# SPDX-License-Identifier: Apache-2.0
"""Line tracker: errors, losses and CPU time on public image sequences, beside trackers of ViSP and M3T."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.board_poses import BoardPoses, board_poses
from benchmark.cube_figure import draw
from benchmark.m3t_tracker import built_m3t
from benchmark.texture_points import deviations, follow_points, poses_of_points
from plsing_ros.arrays import minus_skew
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.geometry.model_files import read_model
from plsing_ros.geometry.rotations import exponential, rotation_vector, turned_covariance
from plsing_ros.geometry.scene_file import DIRECTION_STD, POSITION_STD
from plsing_ros.tracking import LineTracker, PinholeCamera, Tracking, TrackingState

_VISP_IMAGES = Path("/usr/share/visp-images-data/ViSP-images")
# The folder rbt/sequence of lagadic/visp-images, beside rbt/models, or one that has model/cube.obj in itself:
# color_image_*.png, cam.json, apriltag_data.json, init/.
_RBT_CUBE = Path(os.environ.get("PLSING_RBT_CUBE", "/nowhere"))
_SOURCE = Path(__file__).with_name("visp_line_tracker.cpp")
_LIBRARIES = ("-lvisp_core", "-lvisp_io", "-lvisp_mbt", "-lvisp_me", "-lvisp_klt", "-lvisp_vision")
_LOST = 0.02, np.radians(5.0)
_TURNS = 3  # of the two whose times are compared
_LEAST_TIME = 0.1  # of an image [ms]: a tracker that takes less has given up
_AGREE = 0.005
_PERIOD = 1.0 / 30.0  # [s]
_BY_DEFAULT = "all rows at once, edges as well known as lines are by default"
_BY_ROWS = "row by row, edges so, too"
_M3T = "M3T, region only"
_STILL = 9  # images of the textured cube before anything moves
# Where ViSP's example puts the cube of the rendered sequence in the castle's frame.
_CUBE_IN_CASTLE = np.array([[-1.0, 0, 0, -0.2], [0, 0, 1.0, 0.12], [0, 1.0, 0, -0.15]])


@dataclass(frozen=True)
class Result:
    """Where the object is said to be in an image, and for how long that was computed."""

    pose: Pose | None
    seconds: float
    state: TrackingState
    tracking: Tracking | None = None


@dataclass(frozen=True)
class TestSequence:
    """Images, the camera, the object, the first pose, and what ViSP needs."""

    camera: PinholeCamera
    images: Sequence[Any]
    model: Model
    start: Pose
    visp_models: Sequence[tuple[Path, Any]]
    angles: tuple[float, float]


def follow(given: TestSequence, images: Sequence[Any], step: int = 1, **options: Any) -> dict[int, Result]:
    """Return what our tracker says of every step-th image; the time between images is _PERIOD."""
    tracker = LineTracker(given.model, given.camera, **options)
    results = {}
    for k in range(0, len(images), step):
        begin = time.process_time()
        found = tracker.track(images[k], given.start.inverse() if k == 0 else None, _PERIOD * k)
        seconds = time.process_time() - begin
        pose = None if found.T_world_camera is None else found.T_world_camera.inverse()
        results[k] = Result(pose, seconds, found.state, found)
    return results


def in_turn(*runs: Callable[[], dict[int, Result]]) -> list[dict[int, Result]]:
    """Return what runs say that take turns, each image with the least of its times: a processor's speed changes."""
    results = [run() for run in runs]
    for _ in range(_TURNS - 1):
        for result, run in zip(results, runs, strict=True):
            for k, again in run().items():
                result[k] = replace(result[k], seconds=min(result[k].seconds, again.seconds))
    return results


class VispTracker:
    """ViSP's tracker, a program that is compiled here and run as a separate process."""

    def __init__(self, program: Path) -> None:
        self._program = program

    def follow(self, mode: str, given: TestSequence, images: Sequence[Any], step: int = 1) -> dict[int, Result]:
        """Return what a mode (edge, scanline, klt) says of every step-th image."""
        import cv2

        camera, chosen = given.camera, list(range(0, len(images), step))
        with tempfile.TemporaryDirectory() as folder:
            files = [str(Path(folder) / f"{k:04d}.pgm") for k in chosen]
            for file, k in zip(files, chosen, strict=True):
                cv2.imwrite(file, images[k])
            words: list[Any] = [mode, camera.fx, camera.fy, camera.cx, camera.cy, *given.angles, len(given.visp_models)]
            for path, pose in given.visp_models:
                words += [path, *np.ravel(pose)]
            start = np.column_stack([given.start.rotation, given.start.translation])
            words += [*start.ravel(), len(files), *files]
            text = " ".join(map(str, words))
            done = subprocess.run([str(self._program)], input=text, capture_output=True, text=True, check=True)
        rows = [[float(word) for word in line.split()] for line in done.stdout.splitlines()]
        results = {}
        for k, row in zip(chosen, rows, strict=True):
            state = TrackingState.TRACKING if row[0] else TrackingState.LOST
            results[k] = Result(_pose(np.reshape(row[1:13], (3, 4))) if row[0] else None, row[13], state)
        return results


@contextmanager
def compiled_visp() -> Iterator[VispTracker | str]:
    """Compile ViSP's tracker, and remove it in the end; give the reason in words where that cannot be done."""
    if not (shutil.which("pkg-config") and shutil.which("g++")):
        yield "not measured: pkg-config or g++ is missing"
        return
    flags = subprocess.run(["pkg-config", "--cflags", "visp"], capture_output=True, text=True, check=False)
    if flags.returncode != 0:
        yield "not installed: sudo apt install libvisp-dev"
        return
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "visp_line_tracker"
        command = ["g++", "-O3", str(_SOURCE), "-o", str(program), *flags.stdout.split(), *_LIBRARIES]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        if built.returncode != 0:
            yield f"does not compile: {(built.stderr.strip() or 'no reason given').splitlines()[0]}"
            return
        yield VispTracker(program)


def castle(visp: VispTracker | str) -> None:
    """Print errors against the exact truth of the rendered sequence."""
    given, truth = _castle()
    print("Castle-simu, 40 rendered images, exact truth: median / largest error, NEES of OK poses, CPU time")
    runs: dict[str, Callable[[], dict[int, Result]]] = {"plsing_ros": lambda: follow(given, given.images)}
    if isinstance(visp, VispTracker):
        for mode in ("edge", "scanline"):
            runs[f"ViSP {mode}"] = partial(visp.follow, mode, given, given.images)
    figures = {}
    for name, results in zip(runs, in_turn(*runs.values()), strict=True):
        off = np.array([_error(each.pose, truth[k]) for k, each in results.items() if each.pose is not None])
        figures[name] = (
            *np.median(off, axis=0),
            *off.max(axis=0),
            np.median([each.seconds for each in results.values()]),
        )
        middle, turn, most, most_turn, seconds = figures[name]
        squares = [_squares(each.tracking, truth[k]) for k, each in results.items() if _is_ok(each)]
        nees = f"NEES {np.median(squares):.1f}, " if squares else ""
        print(
            f"  {name:14} {1e3 * middle:6.3f} / {1e3 * most:5.2f} mm, {np.degrees(turn):.3f} / "
            f"{np.degrees(most_turn):.2f} degrees, {nees}{1e3 * seconds:.2f} ms"
        )
    if "ViSP scanline" in figures:
        ratios = np.array(figures["plsing_ros"]) / np.array(figures["ViSP scanline"])
        text = ", ".join(f"{ratio:.3f}" for ratio in ratios)
        print(f"  of ViSP scanline (translation, rotation, their largest, time): {text}")


def cube(visp: VispTracker | str, quick: bool) -> None:
    """Print the share of frames lost on the disturbed cube."""
    if not isinstance(visp, VispTracker):
        print(f"cube: needs ViSP as the second of two independent trackers, and it is {visp}")
        return
    given = _cube()
    reference, own = visp.follow("klt", given, given.images), follow(given, given.images)
    counted = {
        k
        for k, each in own.items()
        if each.pose is not None and reference[k].pose is not None and _error(each.pose, reference[k].pose)[0] < _AGREE
    }
    print(f"cube, {len(given.images)} real images, {len(counted)} on which two trackers agree within 5 mm: share lost")
    print(
        f"  {'':22}{'plsing_ros':>12} {'unannounced':>12} {'CPU ms':>8} {'of scanline':>12}"
        + "".join(f"{'ViSP ' + mode:>15}" for mode in ("edge", "scanline", "klt"))
    )
    for name, disturb in _DISTURBANCES.items():
        if quick and name not in ("as is", "25 % occluded", "contrast a quarter"):
            continue
        step = int(name.split()[1][0]) if name.startswith("every") else 1
        images = [disturb(k, image, reference[k].pose, given) for k, image in enumerate(given.images)]
        ours, scanline = in_turn(
            partial(follow, given, images, step), partial(visp.follow, "scanline", given, images, step)
        )
        edge, points = (visp.follow(mode, given, images, step) for mode in ("edge", "klt"))
        rivals = [edge, scanline, points]
        lost = [
            k for k in ours if k in counted and not _is_black(name, k) and _is_lost(ours[k].pose, reference[k].pose)
        ]
        of = sum(1 for k in ours if k in counted and not _is_black(name, k))
        silent = sum(ours[k].state == TrackingState.TRACKING for k in lost)
        shares = [
            sum(_is_lost(run[k].pose, reference[k].pose) for k in run if k in counted and not _is_black(name, k)) / of
            for run in rivals
        ]
        times = [1e3 * np.median([each.seconds for each in run.values()]) for run in (ours, *rivals)]
        rest = "".join(f"{share:>8.0%} {spent:4.1f}ms" for share, spent in zip(shares, times[1:], strict=True))
        ratio = f"{times[0] / times[2]:.2f}" if times[2] > _LEAST_TIME else "-"
        print(f"  {name:22}{len(lost) / of:>12.0%} {silent:>12} {times[0]:>8.2f} {ratio:>12}  {rest}")


def textured_cube() -> None:
    """Print errors on the textured cube against the published poses of a board of tags beside it.

    The camera has a rolling shutter and is held by hand: the board's poses are also taken from its corners with the
    time of each row. Where the cube is on the board was clicked by hand; ViSP's own test takes it from the first ten
    tracked poses instead.
    """
    import cv2

    info = json.loads((_RBT_CUBE / "cam.json").read_text())
    camera = PinholeCamera(info["w"], info["h"], info["px"], info["py"], info["u0"], info["v0"])
    files = sorted(_RBT_CUBE.glob("color_image_*.png"))
    tags = json.loads((_RBT_CUBE / "apriltag_data.json").read_text())
    grid = [_pose(np.array(each)[:3]) for each in tags["grid"]]
    clicked = _pose(np.array(json.loads((_RBT_CUBE / "init" / "cube.json").read_text()))[:3])
    images = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files]
    models = next(each for each in (_RBT_CUBE / "model", _RBT_CUBE.parent / "models" / "cube") if each.is_dir())
    given = TestSequence(camera, images, read_model(models / "cube.obj"), clicked, (), (0, 0))
    # As row and column, counted from a pixel's corner.
    corners = [
        {name: np.array(tag["tag_corners"])[:, ::-1] - 0.5 for name, tag in each.items()} for each in tags["detections"]
    ]
    still, rolling = (board_poses(camera, corners, grid, each) for each in (False, True))
    print(
        f"rbt cube, {len(files)} images; corners of the board's tags are {still.deviation:.2f} px from where one pose "
        f"for all rows has them, {rolling.deviation:.2f} px if rows are read one by one in {rolling.readout:.1f} of "
        "the time between images"
    )
    edge_std = np.tile((POSITION_STD, DIRECTION_STD), (len(given.model), 1))
    runs = {
        "all rows at once, edges exact": follow(given, images),
        _BY_DEFAULT: follow(given, images, edge_std=edge_std),
        _BY_ROWS: follow(given, images, edge_std=edge_std, readout_time=_PERIOD * rolling.readout),
    }
    m3t = built_m3t()
    if isinstance(m3t, str):
        print(f"  M3T's region tracker: not measured; {m3t}")
    else:
        by_m3t = m3t.follow(camera, _RBT_CUBE, len(files), models / "cube.obj", clicked)
        runs[_M3T] = {k: Result(_pose(each), time, TrackingState.TRACKING) for k, (each, time) in enumerate(by_m3t)}
    for tracker, results in runs.items():
        found = {k: each.pose for k, each in results.items() if each.pose is not None}
        states = [each.state.name for each in results.values()]
        time_taken = 1e3 * np.median([each.seconds for each in results.values()])
        said = ", ".join(f"{states.count(each)} {each}" for each in sorted(set(states)))
        verdict = "no verdict" if tracker == _M3T else said
        print(f"  {tracker}: {time_taken:.2f} ms of CPU in the median; {verdict}")
        rows = {k: camera.project(pose.translation[np.newaxis])[0, 1] for k, pose in found.items()}
        boards = {"published": grid, "row by row": [rolling.at(k, rows.get(k, 240.0)) for k in range(len(files))]}
        for name, board in boards.items():
            tracked = {k: board[k].inverse() @ pose for k, pose in found.items()}
            places = {
                "clicked": grid[0].inverse() @ clicked,
                "of the first ten poses": _mean([each for k, each in tracked.items() if k < 10]),
                "of all poses": _mean(list(tracked.values())),
            }
            for where, place in places.items():
                true = {k: board[k] @ place for k in found}
                off = np.array([_error(pose, true[k]) for k, pose in found.items()])
                good = (off[:, 0] < 0.03) & (off[:, 1] < np.radians(10.0))
                squares = [
                    (
                        _squares(each.tracking, true[k]),
                        _squares(each.tracking, true[k], rolling.covariance_at(k, rows[k])),
                        *_parts(each.tracking, true[k]),
                    )
                    for k, each in results.items()
                    if _is_ok(each)
                ]
                print(
                    f"    board {name}, place {where}: {good.sum() / len(files):.0%} within 30 mm and 10 degrees; "
                    f"{_spread(found, true)} (median, 90 %, largest)",
                    end="; " if squares else "\n",
                )
                if not squares:
                    continue
                alone, both, turn = np.median(squares, axis=0)[:3]
                x, y, z = np.sqrt(np.mean(np.array(squares)[:, 3:], axis=0))
                print(
                    f"NEES of OK poses {alone:.0f}, {both:.1f} with "
                    f"the covariance of the board's poses, {turn:.1f} of the turn alone; the cube's middle is off by "
                    f"{x:.1f}, {y:.1f} standard deviations sideways, {z:.1f} along the view"
                )
    shown = {"tracked": runs[_BY_DEFAULT], "tracked, readout_time given": runs[_BY_ROWS]}
    if _M3T in runs:
        shown[_M3T] = runs[_M3T]
    without_edges(given, grid, rolling, shown)


def without_edges(
    given: TestSequence, grid: Sequence[Pose], rolling: BoardPoses, runs: Mapping[str, Mapping[int, Result]]
) -> None:
    """Print what points painted on the textured cube say of poses; draw it in the file PLSING_CUBE_FIGURE.

    Args:
        given: The sequence.
        grid: The published poses of the board.
        rolling: Its poses with the time of each row.
        runs: Of trackers, by name; of the first one, images without a pose are taken for those before.
    """
    camera, images = given.camera, given.images
    found = {name: {k: each.pose for k, each in run.items() if each.pose is not None} for name, run in runs.items()}
    first = next(iter(found.values()))
    tracked = {k: first[max(each for each in first if each <= k)] for k in range(len(images))}
    tracks = follow_points(given.model, camera, images, list(tracked.values()))
    off = {
        "published poses": deviations(camera, tracks, lambda k, row: grid[k]),
        "row by row": deviations(camera, tracks, rolling.at),
    }
    for name, poses in found.items():
        kept = [{k: pixel for k, pixel in track.items() if k in poses} for track in tracks]
        off[name] = deviations(camera, [each for each in kept if len(each) > 1], lambda k, row, of=poses: of[k])
    print(f"  {len(tracks)} points painted on the cube, off if they stay where they are, median and 90 % [px]:")
    for name, (_, pixels) in off.items():
        print(f"    {name}: {np.median(pixels):.2f}, {np.percentile(pixels, 90):.2f}")
    board = [rolling.at(k, camera.project(pose.translation[np.newaxis])[0, 1]) for k, pose in tracked.items()]
    place = _mean([board[k].inverse() @ tracked[k] for k in range(_STILL)])
    exact = {k: pose @ place for k, pose in enumerate(board)}
    clicked = grid[0].inverse() @ given.start
    published = {k: grid[k] @ clicked for k in tracked}
    turns = {}
    for name, poses in {
        **found,
        "points alone, fixed at the first pose": poses_of_points(given.model, camera, tracks, tracked[0], len(images)),
        "board row by row, place of the still images": exact,
    }.items():
        print(f"    {name}: {_spread(poses, exact)} from the last row; {_spread(poses, published)} from the published")
        turns[name] = list(poses), [np.degrees(_error(pose, exact[k])[1]) for k, pose in poses.items()]
    if "PLSING_CUBE_FIGURE" in os.environ:
        draw({name: each for name, each in off.items() if name != list(found)[1]}, turns)


def main(quick: bool = False) -> None:
    """Measure what is installed, and say what is missing."""
    import cv2

    cv2.setNumThreads(1)
    with compiled_visp() as visp:
        if isinstance(visp, str):
            print(f"ViSP: {visp}")
        if _VISP_IMAGES.is_dir():
            castle(visp)
            cube(visp, quick)
        else:
            print(f"no images in {_VISP_IMAGES}: sudo apt install visp-images-data (GPL-2)")
    if _RBT_CUBE.is_dir():
        textured_cube()
    else:
        print("rbt cube: not measured; set PLSING_RBT_CUBE to the folder rbt/sequence of a checkout of")
        print("  github.com/lagadic/visp-images (GPL-2)")


def _castle() -> tuple[TestSequence, list[Pose]]:
    import cv2

    folder = _VISP_IMAGES / "mbt-depth" / "Castle-simu"
    models = folder / "Models" / "chateau.cao", folder / "Models" / "cube.cao"
    first, second = map(read_model, models)
    n = len(first.vertices)
    placed = second.vertices @ _CUBE_IN_CASTLE[:, :3].T + _CUBE_IN_CASTLE[:, 3]
    both = Model(
        np.vstack([first.vertices, placed]),
        np.vstack([first.edges, second.edges + n]),
        first.faces + tuple(tuple(row + n for row in face) for face in second.faces),
    )
    images = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted((folder / "Images").glob("*"))]
    truth = [_pose(np.loadtxt(file)[:3]) for file in sorted((folder / "CameraPose").glob("*"))]
    # The file says 320, 240, counted from the corner of a pixel.
    camera = PinholeCamera(640, 480, 700.0, 700.0, 319.5, 239.5)
    visp_models = [(models[0], np.eye(4)[:3]), (models[1], _CUBE_IN_CASTLE)]
    return TestSequence(camera, images, both, truth[0], visp_models, (85.0, 89.0)), truth


def _cube() -> TestSequence:
    import cv2

    folder = _VISP_IMAGES / "mbt"
    images = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted((folder / "cube").glob("*.pgm"))]
    numbers = np.array((folder / "cube.0.pos").read_text().split(), dtype=float)
    camera = PinholeCamera(640, 480, 547.7367575, 542.0744058, 338.7036994, 234.5083345)
    start = Pose(exponential(numbers[3:])[0], numbers[:3])
    return TestSequence(
        camera, images, read_model(folder / "cube.cao"), start, [(folder / "cube.cao", np.eye(4)[:3])], (65.0, 75.0)
    )


def _pose(matrix: Any) -> Pose:
    left, _, right = np.linalg.svd(matrix[:, :3])
    return Pose(left @ right, matrix[:, 3])


def _mean(poses: Sequence[Pose]) -> Pose:
    rotation = sum(pose.rotation for pose in poses)
    return _pose(np.column_stack([rotation, np.mean([pose.translation for pose in poses], axis=0)]))


def _error(a: Pose, b: Pose) -> tuple[float, float]:
    turn = rotation_vector(a.rotation @ b.rotation.T)
    return float(np.linalg.norm(a.translation - b.translation)), float(np.linalg.norm(turn))


def _is_ok(result: Result) -> bool:
    return result.tracking is not None and result.state == TrackingState.TRACKING


def _squares(tracking: Any, true: Pose, of_true: Any = 0.0) -> float:
    """Return the squared error in the covariance of both; `of_true` is of a motion in the camera frame."""
    T_world_camera = true.inverse()
    turn = rotation_vector(tracking.T_world_camera.rotation @ T_world_camera.rotation.T)
    off = np.concatenate([tracking.T_world_camera.translation - T_world_camera.translation, turn])
    both = tracking.covariance + (turned_covariance(of_true, T_world_camera.rotation) if np.ndim(of_true) else 0.0)
    return float(off @ np.linalg.solve(both, off))


def _parts(tracking: Any, true: Pose) -> list[float]:
    """Return the squared error of the turn in its covariance, and those of the model's middle along x, y, z."""
    rotation = tracking.T_world_camera.rotation
    turn = rotation.T @ rotation_vector(rotation @ true.rotation)
    covariance = turned_covariance(tracking.covariance, rotation.T)
    middle = tracking.T_world_camera.inverse().translation
    off = rotation.T @ (tracking.T_world_camera.translation - true.inverse().translation)
    by_motion = np.hstack([np.eye(3), minus_skew(middle)])
    shift = by_motion @ np.concatenate([off, turn])
    variances = np.diag(by_motion @ covariance @ by_motion.T)
    return [float(turn @ np.linalg.solve(covariance[3:, 3:], turn)), *(shift * shift / variances)]


def _spread(poses: Mapping[int, Pose], true: Mapping[int, Pose]) -> str:
    off = np.array([_error(pose, true[k]) for k, pose in poses.items()])
    return ", ".join(
        " / ".join(f"{each:.1f}" for each in np.percentile(column, [50, 90, 100])) + f" {unit}"
        for column, unit in ((1e3 * off[:, 0], "mm"), (np.degrees(off[:, 1]), "degrees"))
    )


def _is_lost(pose: Pose | None, reference: Any) -> bool:
    return pose is None or any(off > limit for off, limit in zip(_error(pose, reference), _LOST, strict=True))


def _is_black(name: str, k: int) -> bool:
    return name == "5 black frames" and 60 <= k < 65


def _as_image(values: Any) -> Any:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def _occluded(share: float) -> Callable[..., Any]:
    """Cover a share of the object's box, from the left, from the 20th image on."""

    def disturb(k: int, image: Any, pose: Pose, given: TestSequence) -> Any:
        if k < 20:
            return image
        pixels = given.camera.project(given.model.vertices @ pose.rotation.T + pose.translation)
        low, high = np.floor(pixels.min(axis=0)).astype(int) - 3, np.ceil(pixels.max(axis=0)).astype(int) + 3
        low = np.maximum(low, 0)
        covered = image.copy()
        covered[low[1] : high[1], low[0] : low[0] + int((high[0] - low[0]) * share)] = 90
        return covered

    return disturb


def _blurred(image: Any) -> Any:
    import cv2

    return cv2.GaussianBlur(image, (0, 0), 2)


_DISTURBANCES: dict[str, Callable[..., Any]] = {
    "as is": lambda k, image, *_: image,
    "every 3rd image": lambda k, image, *_: image,
    "every 5th image": lambda k, image, *_: image,
    "25 % occluded": _occluded(0.25),
    "50 % occluded": _occluded(0.5),
    "contrast a quarter": lambda k, image, *_: _as_image(120 + (image.astype(float) - 120) / 4),
    "noise 15": lambda k, image, *_: _as_image(image + np.random.default_rng(k).normal(0, 15, image.shape)),
    "blur 2 px": lambda k, image, *_: _blurred(image),
    "5 black frames": lambda k, image, *_: np.zeros_like(image) if 60 <= k < 65 else image,
    "light +-50 %": lambda k, image, *_: _as_image(image * (1 + 0.5 * np.sin(k / 8))),
}
