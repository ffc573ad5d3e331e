# SPDX-License-Identifier: Apache-2.0
"""The camera poses that an offline command is asked about: a target, a path from a file, or a workspace box."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from plsing_ros.arrays import Array
from plsing_ros.errors import PlsingError, SceneFileError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.pose import checked_position

_IN_BOX = 50
_STEPS = 50
_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")

PATH_HELP = (
    """--path is a CSV file with a header and the columns x, y, z [m], qx, qy, qz, qw: T_world_camera of each pose."""
)


def add_pose_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which poses; exactly one of path, target and box is needed by camera_poses."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--path", type=Path, metavar="CSV", help="poses from a file: columns " + ", ".join(_COLUMNS))
    where.add_argument("--target", nargs=3, type=float, metavar=("X", "Y", "Z"), help="camera centre of the target [m]")
    where.add_argument(
        "--box", nargs=6, type=float, metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"), help="workspace: two corners [m]"
    )
    parser.add_argument(
        "--start", nargs=3, type=float, metavar=("X", "Y", "Z"), help="with --target: straight from here"
    )
    parser.add_argument(
        "--look-at",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="point on the optical axis, with --target and --box (the middle of the lines)",
    )


def camera_poses(options: argparse.Namespace, middle: Array) -> list[Pose]:
    """Return the poses that the options ask for, T_world_camera.

    Args:
        options: Parsed with add_pose_options.
        middle: Where the camera looks unless --look-at says so, shape (3,) [m].

    Raises:
        SceneFileError: If the file cannot be read.
        GeometryError: If a pose is none.
        PlsingError: If no poses are asked for.
    """
    at = checked_position("--look-at", middle if options.look_at is None else options.look_at)
    if options.path is not None:
        return _read_path(options.path)
    if options.target is not None:
        target = checked_position("--target", options.target)
        if options.start is None:
            return [Pose.look_at(target, at)]
        start = checked_position("--start", options.start)
        return [Pose.look_at(start + share * (target - start), at) for share in np.linspace(0.0, 1.0, _STEPS)]
    if options.box is not None:
        corners = np.array([checked_position("--box", options.box[:3]), checked_position("--box", options.box[3:])])
        low, high = corners.min(axis=0), corners.max(axis=0)
        # The first point of the sequence is the corner itself.
        shares = qmc.Halton(3, scramble=False).random(_IN_BOX + 1)[1:]
        return [Pose.look_at(low + (high - low) * share, at) for share in shares]
    raise PlsingError("which poses? give --target X Y Z, --path CSV or --box X0 Y0 Z0 X1 Y1 Z1")


def _read_path(file: Path) -> list[Pose]:
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SceneFileError(f"cannot read path file {file}: {error}") from None
    if not rows:
        raise SceneFileError(
            f"path file {file} has no poses; expected a header {', '.join(_COLUMNS)} and a row for each"
        )
    poses = []
    for number, row in enumerate(rows, start=2):
        try:
            values = [float(row[column]) for column in _COLUMNS]
            poses.append(Pose.from_quaternion(values[:3], values[3:]))
        except KeyError as error:
            raise SceneFileError(f"path file {file} has no column {error}; expected {', '.join(_COLUMNS)}") from None
        except (TypeError, ValueError, PlsingError) as error:
            raise SceneFileError(f"path file {file}, line {number}: {error}") from None
    return poses
