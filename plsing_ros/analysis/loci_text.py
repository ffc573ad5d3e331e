# SPDX-License-Identifier: Apache-2.0
"""The singular set of a scene in words that need no mathematics."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.singularities import Kind, SingularSet, Surface
from plsing_ros.singularities.curves import Curve
from plsing_ros.singularities.locus import Locus, StraightPart
from plsing_ros.singularities.screw_curve import ScrewCurve

_MEANING = "Where a scene is singular, the camera can make a motion that changes no image line: nothing can control it."
# Parts of a unit vector below this are written as 0.
_SMALL = 5e-4
# Scene lengths up to which a locus is told of.
_FAR = 20.0
_NOUNS = {Kind.QUADRIC: "a surface of degree two", Kind.CUBIC: "a surface of degree three"}


def scene_in_words(singular: SingularSet) -> list[str]:
    """Return what is singular in a scene, a sentence each, nearest to the scene's centre first."""
    lines, center = singular.lines, singular.frame.center
    known = (
        f"With {1e3 * lines.position_std.max():.3g} mm and {1e3 * lines.direction_std.max():.3g} mrad"
        if not lines.exact
        else "With lines that are known exactly"
    )
    tell = "as far as the map can tell, " if not lines.exact else ""
    if singular.singular_everywhere:
        return [_MEANING, f"{known} this scene is, {tell}singular wherever the camera is: more lines are needed."]
    if not singular.loci:
        return [_MEANING, f"{known} this scene has, {tell}no point, line or surface that is singular."]
    loci = sorted(singular.loci, key=lambda locus: locus.distance(center))
    near = [locus for locus in loci if locus.distance(center) <= _FAR * singular.frame.length]
    rows = [f"  {locus_in_words(each)}" for each in near]
    if len(near) < len(loci):
        rows.append(f"  and at {len(loci) - len(near)} places farther than {_FAR:g} times the size of the scene")
    return [_MEANING, f"{known} this scene is, {tell}singular:", *rows]


def locus_in_words(locus: Locus) -> str:
    """Return where a locus is and how wide the trouble beside it is, as a clause."""
    width = locus.half_width
    near = f"; a camera within {_length(width)} of it sees that motion badly" if math.isfinite(width) else ""
    return f"{place_in_words(locus)} ({locus.name}){near}"


def place_in_words(locus: Locus) -> str:
    """Return where a locus is: "in the plane y = 0"."""
    part = locus.part
    if isinstance(part, StraightPart):
        if not part.direction.any():
            return f"at the point {_vector(part.point)} m"
        return f"on the straight line through {_vector(part.point)} m along {_direction(part.direction)}"
    if isinstance(part, Surface):
        return f"in the plane {_plane(part)}" if part.kind is Kind.PLANE else f"on {_NOUNS[part.kind]}"
    if isinstance(part, Curve) and part.kind is Kind.STRAIGHT_LINE:
        return f"on the straight line through {_vector(part.point)} m along {_direction(part.axes[0])}"
    if isinstance(part, Curve | ScrewCurve):
        return f"on the {str(part).replace(': ', ', ', 1)}"
    return "everywhere"


def _plane(surface: Surface) -> str:
    """Return the equation of a plane; its largest factor is 1 or positive."""
    constant, *normal = surface.coefficients / np.linalg.norm(surface.coefficients[1:])
    sign = 1.0 if normal[int(np.argmax(np.abs(normal)))] > 0.0 else -1.0
    terms = [(sign * each, axis) for each, axis in zip(normal, "xyz", strict=True) if abs(each) > _SMALL]
    value = -sign * constant
    if len(terms) == 1:
        return f"{terms[0][1]} = {_number(value / terms[0][0])} m"
    text = " ".join(f"{'+' if each > 0.0 else '-'} {abs(each):.3g} {axis}" for each, axis in terms)
    return f"{text.removeprefix('+ ')} = {_number(value)} m"


def _direction(direction: Array) -> str:
    rounded = np.where(np.abs(direction) > _SMALL, direction, 0.0)
    if np.count_nonzero(rounded) == 1:
        return f"the {'xyz'[int(np.argmax(np.abs(rounded)))]} axis"
    return _vector(rounded)


def _vector(values: Array) -> str:
    return f"({', '.join(_number(each) for each in values.tolist())})"


def _number(value: float) -> str:
    return "0" if abs(value) < _SMALL else f"{value:.3g}"


def _length(value: float) -> str:
    return f"{value:.2g} m" if value >= 0.1 else f"{1e3 * value:.2g} mm"
