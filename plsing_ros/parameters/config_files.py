# SPDX-License-Identifier: Apache-2.0
"""Where the package's parameter files are."""

from __future__ import annotations

from pathlib import Path

from plsing_ros.errors import SceneFileError


def config_file(name: str) -> Path:
    """Return the path of a parameter file: in the source tree, or in the prefix this module is installed in.

    Raises:
        SceneFileError: If it is in neither.
    """
    folders = Path(__file__).resolve().parents
    for folder in [folders[2] / "config", *(each / "share" / "plsing_ros" / "config" for each in folders)]:
        if (folder / name).is_file():
            return folder / name
    raise SceneFileError(
        f"parameter file {name} is neither in {folders[2] / 'config'} nor in an installed share folder"
    )
