# SPDX-License-Identifier: Apache-2.0
"""ViSP's control step for straight lines, compiled here where ViSP and its headers are installed."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from plsing_ros.geometry import LineSet, Pose

CYCLES = 500
_SOURCE = Path(__file__).with_name("visp_control_step.cpp")
_LIBRARIES = ("-lvisp_core", "-lvisp_visual_features", "-lvisp_vs")


class Visp:
    """The compiled program."""

    def __init__(self, program: Path, version: str) -> None:
        self.version = version
        self._program = program

    def step(self, lines: LineSet, start: Pose, target: Pose) -> tuple[float, float]:
        """Return the median time of a control step [s], and the inverse condition number that it had.

        Args:
            lines: In the world.
            start: Where the camera is, its axes parallel to the world's.
            target: Where it shall go, likewise.
        """
        numbers = [*start.translation, *target.translation, *np.hstack([lines.point, lines.direction]).ravel()]
        given = " ".join([str(CYCLES), str(len(lines)), *(repr(float(each)) for each in numbers)])
        done = subprocess.run([str(self._program)], input=given, capture_output=True, text=True, check=True)
        microseconds, inverse_condition_number = map(float, done.stdout.split()[:2])
        return 1e-6 * microseconds, inverse_condition_number


@contextmanager
def compiled() -> Iterator[Visp | str]:
    """Compile the program, and remove it in the end; give the reason in words where that cannot be done."""
    if not (shutil.which("pkg-config") and shutil.which("g++")):
        yield "not measured: pkg-config or g++ is missing"
        return
    found = subprocess.run(["pkg-config", "--modversion", "visp"], capture_output=True, text=True, check=False)
    if found.returncode != 0:
        yield "not installed: sudo apt install libvisp-dev"
        return
    flags = subprocess.run(["pkg-config", "--cflags", "visp"], capture_output=True, text=True, check=True)
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "visp_control_step"
        command = ["g++", "-O3", str(_SOURCE), "-o", str(program), *flags.stdout.split(), *_LIBRARIES]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        if built.returncode != 0:
            yield f"does not compile: {(built.stderr.strip() or 'no reason given').splitlines()[0]}"
            return
        yield Visp(program, found.stdout.strip())
