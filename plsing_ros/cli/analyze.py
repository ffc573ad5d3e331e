"""Command analyze: what is singular in a scene, and how near a camera is to it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.cli.command import run_command
from plsing_ros.figures.scene_page import save_scene_page
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.singularities import Curve, Kind, SingularSet, Surface, singular_set
from plsing_ros.singularities.proofs.certify import certify

_EPILOG = """examples:
  analyze config/paper_p4l.yaml
  analyze config/paper_p4l.yaml --at 0.6962 -4.637 7.8    also how near a camera there is
  analyze config/paper_p4l.yaml --page scene.html         also a page to turn it around in a browser"""

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
    options = parser.parse_args(argv)
    return run_command("analyze", lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    singular = singular_set(read_scene(options.scene))
    print("\n".join(_description(singular)))
    if options.certify:
        print("\n".join(_proofs(singular)))
    if options.at is not None:
        print("\n".join(_situation(singular, np.array(options.at))))
    if options.page is not None:
        lines, surfaces = (size * singular.frame.length for size in _DRAWN)
        save_scene_page(options.page, options.scene, singular, singular.surfaces, (), lines, surfaces)
        print(f"\npage: {options.page}")
    return 0


def _description(singular: SingularSet) -> list[str]:
    lines = [singular.description, ""]
    for transversal in singular.transversals:
        lines.append(
            f"{transversal.name}: through {_vector(transversal.point)} m along {_vector(transversal.direction)}, "
            f"residual {transversal.residual:.1e}"
        )
    for number, (point, residual) in enumerate(
        zip(singular.isolated_points, singular.isolated_point_residuals, strict=True), start=1
    ):
        lines.append(f"isolated point {number}: {_vector(point)} m, residual {residual:.1e}")
    lines += [f"{surface.name}: {_equation(surface)}" for surface in singular.surfaces]
    lines += [f"{curve.name}: {_parametrisation(curve)}" for curve in singular.curves]
    return lines


def _equation(surface: Surface) -> str:
    if surface.kind is not Kind.PLANE:
        return f"degree {surface.degree}"
    constant, *normal = surface.coefficients / np.linalg.norm(surface.coefficients[1:])
    return f"{_vector(normal)} . C = {-constant:.6g} m"


def _parametrisation(curve: Curve) -> str:
    if curve.kind is Kind.STRAIGHT_LINE:
        return f"through {_vector(curve.point)} m along {_vector(curve.axes[0])}"
    first, second = curve.axes
    return f"in the plane through {_vector(curve.point)} m spanned by {_vector(first)} and {_vector(second)}"


def _proofs(singular: SingularSet) -> list[str]:
    proofs = certify(singular)
    lines = ["", proofs.statement]
    for proof in proofs.certificates:
        radius = f", radius {proof.radius:.1e}" if np.isfinite(proof.radius) else ""
        lines.append(f"  {proof.name}, lines {', '.join(map(str, proof.lines))}: {proof.statement}{radius}")
    return lines


def _situation(singular: SingularSet, center: Array) -> list[str]:
    lines = ["", f"camera at {_vector(center)} m"]
    lines += [f"  {each.distance:10.4f} m from {each.name}" for each in singular.distances(center)]
    motions = singular.unobservable_motions(center)
    lines += [f"  unobservable motion: {motion}" for motion in motions] or ["  no motion is lost there"]
    return lines


def _vector(values: npt.ArrayLike) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in np.asarray(values)) + ")"
