"""Distances from a camera centre to the singular set, and the closest approach of a straight motion: see loci.c."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array


def distances(point: Array, direction: Array, center: Array, closest: Array, distance: Array) -> bool:
    """Fill the closest points on k lines, and points, and their distances; return whether the centre is finite.

    Args:
        point: A point of each, shape (k, 3) [m].
        direction: Unit directions, zero for points, shape (k, 3).
        center: Camera centre, shape (3,) [m].
        closest: Filled, shape (k, 3) [m].
        distance: Filled, shape (k,) [m].
    """
    with np.errstate(invalid="ignore", over="ignore"):
        along = np.einsum("ij,ij->i", center - point, direction)
        np.add(point, along[:, np.newaxis] * direction, out=closest)
        offset = closest - center
        np.sqrt(np.einsum("ij,ij->i", offset, offset), out=distance)
    return bool(np.isfinite(center).all())


def approach(
    closest: Array,
    distance: Array,
    direction: Array,
    role: Array,
    rotation: Array,
    center: Array,
    twist: Array,
    found: Array,
    horizon: float,
    at_rest: float,
    along_share: float,
) -> int:
    """Return the row of the least distance that a straight motion will reach, or -1 if nothing is approached.

    Args:
        closest: The point of each locus closest to the centre, shape (k, 3) [m].
        distance: Of the centre from each, shape (k,) [m].
        direction: Unit directions of lines, zero for others, shape (k, 3).
        role: 0 for lines and points, 1 for surfaces, -1 for what is left out, shape (k,).
        rotation: Of T_world_camera, shape (3, 3).
        center: Camera centre, shape (3,) [m].
        twist: Of the camera in its frame, shape (6,) [m/s, rad/s].
        found: Filled, shape (4,): the time to the closest point of the nearest locus [s] and the rate at which it comes
            nearer, as a share of the speed, or NaN if the motion does not change that distance; the time to the closest
            approach [s] and its distance [m], or NaN if there is none.
        horizon: Approaches after this time do not count [s].
        at_rest: A centre slower than this does not move [m/s].
        along_share: A motion across a locus by no more than this share of the speed is along it.
    """
    found[:] = math.nan
    velocity = rotation @ twist[:3]
    speed = math.sqrt(float(velocity @ velocity))
    if not speed >= at_rest:
        return -1
    # Only what moves the camera across a locus changes its distance, and the way to the closest point is across.
    closing = (closest - center) @ velocity
    rate = closing / np.maximum(distance, 1e-300)
    along = direction @ velocity
    # To a plane the distance changes along its normal only.
    square = np.where(role == 1.0, rate * rate, speed * speed - along * along)
    square[(role < 0.0) | (square <= (along_share * speed) ** 2)] = np.nan
    time = closing / square
    nearest = int(np.where(role < 0.0, np.inf, distance).argmin())
    if math.isfinite(time[nearest]):
        found[:2] = time[nearest], rate[nearest] / speed
    # Pythagoras: of the offset, what the motion does not close.
    rest = np.where((time > 0.0) & (time <= horizon), distance * distance - time * closing, np.inf)
    row = int(rest.argmin())
    if not math.isfinite(rest[row]):
        return -1
    found[2:] = time[row], math.sqrt(max(float(rest[row]), 0.0))
    return row
