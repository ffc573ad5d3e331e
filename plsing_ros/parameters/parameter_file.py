# SPDX-License-Identifier: Apache-2.0
"""A node's values in a ROS parameter file, for use without ROS."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plsing_ros.errors import SceneFileError
from plsing_ros.parameters.options import flatten_options


def read_parameters(path: str | Path, node: str) -> dict[str, Any]:
    """Return the values that a parameter file has for a node in the root namespace, by ROS name.

    Args:
        path: YAML file as for --params-file; sections that match are "/**", "/**/node", "node", "/node".
        node: Name of the node.

    Raises:
        SceneFileError: If the file cannot be read or is no parameter file.
    """
    values: dict[str, Any] = {}
    # Only where a file is read: the package imports without yaml.
    from plsing_ros.geometry.yaml_file import read_yaml

    content = read_yaml(path, "parameter file")
    for section, body in content.items() if isinstance(content, dict) else ():
        if not isinstance(body, Mapping) or not isinstance(body.get("ros__parameters"), Mapping):
            raise SceneFileError(f"parameter file {path}, section {section!r}: expected ros__parameters: in it")
        # In ROS "**" stands for any number of names, also for none.
        pattern = f"/{section}".replace("//", "/").replace("/**/", "/*").replace("/**", "/*")
        if fnmatch.fnmatchcase(f"/{node}", pattern):
            values |= flatten_options(body["ros__parameters"])
    return values
