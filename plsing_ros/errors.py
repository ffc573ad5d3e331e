# SPDX-License-Identifier: Apache-2.0
"""Every error this package raises on purpose, under one base class."""

from __future__ import annotations


class PlsingError(Exception):
    """Base of all errors raised on purpose; the message says what was wrong, where it came from, what is allowed."""


class GeometryError(PlsingError):
    """A line, pose or scene that is not one: non-finite, wrong shape, zero direction, inconsistent rows."""


class DegenerateProjectionError(PlsingError):
    """A line passes through the camera centre or lies in its focal plane z = 0, so that it has no image line.

    Attributes:
        ids: Ids of the lines without an image.
    """

    def __init__(self, message: str, ids: tuple[int, ...]) -> None:
        super().__init__(message)
        self.ids = ids


class ObservationError(PlsingError):
    """A feature message that cannot be used: wrong lengths, unknown or repeated ids, no 3-D lines, non-finite."""


class ParameterError(PlsingError):
    """A parameter outside its range or in conflict with another one."""


class SceneFileError(PlsingError):
    """A scene or parameter file that cannot be read or does not describe a scene."""


class StartError(PlsingError):
    """A node that cannot start: it cannot be configured or activated, or shared memory is in its way."""
