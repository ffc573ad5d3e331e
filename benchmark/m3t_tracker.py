# SPDX-License-Identifier: Apache-2.0
"""M3T's region tracker: a program that is built here, and run as a separate process, where its sources are."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.tracking import PinholeCamera

# The folder M3T of a checkout of github.com/DLR-RM/3DObjectTracking (MIT).
_SOURCES = Path(os.environ.get("PLSING_M3T", "/nowhere"))
_FOLDER = Path(__file__).with_name("m3t")
_BUILD = Path("build/benchmark/m3t")
_PACKAGES = "cmake g++ libopencv-dev libeigen3-dev libglew-dev libglfw3-dev xvfb"


class M3tTracker:
    """The program."""

    def __init__(self, program: Path) -> None:
        self._program = program

    def follow(
        self, camera: PinholeCamera, folder: Path, count: int, model: Path, start: Pose
    ) -> list[tuple[Array, float]]:
        """Return T_camera_model, shape (3, 4), and the CPU time [s] of each image.

        Args:
            camera: Of the images.
            folder: Where color_image_0000.png and on are.
            count: Of the images.
            model: A file in OBJ format.
            start: T_camera_model of the first image.
        """
        numbers = [camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height]
        numbers += [float(start.translation[2]), *np.column_stack([start.rotation, start.translation]).ravel()]
        # It draws the model with OpenGL, also where there is no screen.
        screen = [] if "DISPLAY" in os.environ else ["xvfb-run", "-a"]
        arguments = [str(self._program), str(folder), str(count), str(model), str(_BUILD / f"{model.stem}.views")]
        done = subprocess.run(
            [*screen, *arguments], input=" ".join(map(str, numbers)), capture_output=True, text=True, check=True
        )
        rows = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("pose ")]
        return [(row[:12].reshape(3, 4), float(row[12])) for row in np.array(rows, dtype=float)]


def built_m3t() -> M3tTracker | str:
    """Build the program, for some minutes the first time; return the reason in words where that cannot be done."""
    if not _SOURCES.is_dir():
        return "set PLSING_M3T to the folder M3T of a checkout of github.com/DLR-RM/3DObjectTracking"
    if not (shutil.which("cmake") and ("DISPLAY" in os.environ or shutil.which("xvfb-run"))):
        return f"cmake or a screen is missing: sudo apt install {_PACKAGES}"
    commands = (
        ["cmake", "-S", str(_FOLDER), "-B", str(_BUILD), "-DCMAKE_BUILD_TYPE=Release", f"-DM3T={_SOURCES.resolve()}"],
        ["cmake", "--build", str(_BUILD), "--parallel"],
    )
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = [line for line in (done.stderr + done.stdout).splitlines() if "rror" in line]
            return f"does not build ({(said or ['no reason given'])[0].strip()}): sudo apt install {_PACKAGES}"
    return M3tTracker(_BUILD / "region_tracker")
