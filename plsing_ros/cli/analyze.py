# SPDX-License-Identifier: Apache-2.0
"""Command analyze: what is singular in a scene, and how near a camera is to it."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.analysis.accuracy import Camera
from plsing_ros.analysis.loci_text import scene_in_words
from plsing_ros.analysis.path_report import report_path
from plsing_ros.analysis.path_risk import PathRisk, path_risk
from plsing_ros.arrays import Array, vector_text
from plsing_ros.cli.camera_poses import add_pose_options, camera_poses
from plsing_ros.cli.command import make_folder, run_command
from plsing_ros.figures.path_report import save_path_figure
from plsing_ros.figures.scene_page import save_scene_page
from plsing_ros.geometry import Pose
from plsing_ros.geometry.pose import checked_position
from plsing_ros.geometry.scene_file import read_scene, read_segment_ends
from plsing_ros.parameters import MonitorParameters
from plsing_ros.parameters.law import LAWS
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.parameters.scene import scene_values
from plsing_ros.singularities import Proximity, SingularSet, singular_set
from plsing_ros.singularities.proofs.certify import certify

_EPILOG = """examples:
  analyze config/paper_p4l.yaml
  analyze config/paper_p4l.yaml --at 0.6962 -4.637 7.8    also how near a camera there is
  analyze config/paper_p4l.yaml --page scene.html         also a page to turn it around in a browser
  analyze config/paper_p4l.yaml --start 0.1 -4.0 7.2 --target 0.7 -4.6 7.8 --output report    what awaits a camera
  analyze config/paper_p4l.yaml --box 0 -5 7 1 -4 8 --json                                    likewise in a workspace"""

# z below which a camera may be singular, and relative inverse condition number up to which it is.
_MAY_BE, _LOST = 3.0, 1e-6

# How far from the middle of the scene lines and surfaces are drawn, in mean distances of the lines from it.
_DRAWN = (8.0, 3.0)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the singular set of a scene file; return the exit code."""
    parser = argparse.ArgumentParser(
        description="Compute the singular set of the lines in a ROS parameter file: transversals and isolated points "
        "at which a camera that servoes on them loses a motion.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scene", help="parameter file with lines.points and lines.directions")
    parser.add_argument("--at", nargs=3, type=float, metavar=("X", "Y", "Z"), help="camera centre, scene frame [m]")
    parser.add_argument("--certify", action="store_true", help="prove what can be proved; takes seconds")
    parser.add_argument("--page", type=Path, metavar="HTML", help="write an interactive 3-D page, without network use")
    add_pose_options(parser)
    parser.add_argument("--noise", type=float, default=1e-3, help="standard deviation of image lines (%(default)g)")
    parser.add_argument("--view", type=float, default=60.0, help="field of view, whole angle in degrees (%(default)g)")
    parser.add_argument("--clearance", type=float, default=0.1, help="distance from loci to keep [m] (%(default)g)")
    parser.add_argument("--accuracy", type=float, default=0.02, help="position accuracy needed [m] (%(default)g)")
    parser.add_argument(
        "--law",
        choices=LAWS,
        metavar="LAW",
        help="of runs to the target (the file's); with --box, look at such runs at all",
    )
    parser.add_argument("--json", action="store_true", help="print the report of the poses as JSON, and nothing else")
    parser.add_argument("--output", type=Path, metavar="DIR", help="folder for a figure of the poses")
    options = parser.parse_args(argv)
    return run_command("analyze", lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    singular = singular_set(read_scene(options.scene))
    if any(each is not None for each in (options.path, options.target, options.box)) or options.json:
        return _report(singular, options)
    print("\n".join([*scene_in_words(singular), ""]))
    print(singular)
    if options.certify:
        print("\n".join(_proofs(singular)))
    if options.at is not None:
        print("\n".join(_situation(singular, checked_position("--at", options.at))))
    if options.page is not None:
        lines, surfaces = (size * singular.frame.length for size in _DRAWN)
        save_scene_page(options.page, options.scene, singular, (), (), lines, surfaces)
        print(f"\npage: {options.page}")
    return 0


def _report(singular: SingularSet, options: argparse.Namespace) -> int:
    """Print what awaits a camera at the poses asked for."""
    if options.output is not None:
        make_folder(options.output, "write the figure", "--output")
    poses = camera_poses(options, singular.lines.pivot.mean(axis=0))
    camera = Camera(options.noise, math.radians(options.view) / 2.0)
    report = report_path(
        singular,
        poses,
        camera,
        read_segment_ends(options.scene, len(singular.lines)),
        options.clearance,
        options.accuracy,
        _risk(singular, poses, camera, options),
    )
    if options.json:
        print(json.dumps(report.as_json(), indent=2))
    else:
        print("\n".join([*scene_in_words(singular), "", str(report)]))
    written = []
    if options.output is not None:
        written.append(f"figure: {save_path_figure(report, Path(options.scene).name, options.output / 'path.png')}")
    if options.page is not None:
        lines, surfaces = (size * singular.frame.length for size in _DRAWN)
        paths = [] if options.box is not None else [("poses", report.center)]
        save_scene_page(options.page, options.scene, singular, (), paths, lines, surfaces)
        written.append(f"page: {options.page}")
    if written and not options.json:
        print("\n".join(written))
    return 0


def _risk(singular: SingularSet, poses: Sequence[Pose], camera: Camera, options: argparse.Namespace) -> PathRisk | None:
    """Return what runs along the poses come to, by the nodes' parameters in the scene's file; None without a target."""
    known = MonitorParameters.specifications()
    values: dict[str, Any] = {}
    if Path(options.scene).suffix.lower() in (".yaml", ".yml"):
        for node in ("singularity_monitor", "controller"):
            values |= {k: v for k, v in read_parameters(options.scene, node).items() if k in known}
    if options.law is not None:
        values["law"] = options.law
    parameters = MonitorParameters.from_values(values | scene_values(singular.lines))
    if options.box is not None and (options.law is None or "target.position" not in values):
        return None
    target = poses[-1] if options.box is None else parameters.target_pose()
    return path_risk(singular, poses, target, parameters, camera.image_std, camera.max_angle)


def _proofs(singular: SingularSet) -> list[str]:
    proofs = certify(singular)
    lines = ["", proofs.statement]
    for proof in proofs.certificates:
        radius = f", radius {proof.radius:.1e}" if np.isfinite(proof.radius) else ""
        lines.append(f"  {proof.name}, lines {', '.join(map(str, proof.lines))}: {proof.statement}{radius}")
    return lines


def _situation(singular: SingularSet, center: Array) -> list[str]:
    lines = ["", f"camera at {vector_text(center)} m"]
    lines += [f"  {each.distance:10.4f} m from {each.name}" for each in singular.distances(center)]
    lines += _proximity(singular.proximity(center))
    motions = singular.unobservable_motions(center)
    lines += [f"  unobservable motion: {motion}" for motion in motions]
    return lines


def _proximity(near: Proximity) -> list[str]:
    """Return how near a camera is to a singular centre, whether or not a locus is named there."""
    lines = [
        f"  1/cond is {near.relative_condition:.2g} of normal; to first order the nearest singular centre is "
        f"{near.distance:.3g} m away, at {vector_text(near.closest_point)} m",
        f"  for each mrad of image noise the pose is off by {near.position_std:.2g} m and {near.rotation_std:.2g} rad "
        f"along its least observable motion {vector_text(near.least_observable_motion)}",
    ]
    if near.z is None:
        return [*lines, "  no motion is lost there" if near.relative_condition > _LOST else "  a motion is lost there"]
    may = "the camera may be singular" if near.z < _MAY_BE else "it is not singular"
    return [*lines, f"  z = {near.z:.3g}: as far as is known of the lines, {may}"]
