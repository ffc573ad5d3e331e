"""The rules of the house that a folder listing promises, read off the imports."""

import ast
from pathlib import Path

import pytest

import plsing_ros

ROOT = Path(plsing_ros.__file__).resolve().parent
FILES = sorted(ROOT.rglob("*.py"))
ROS = {"rclpy", "plsing_msgs", "rcl_interfaces", "builtin_interfaces", "rosgraph_msgs", "domain_coordinator"}

# Each folder may import itself and those before it.
ORDER = [
    "kernels",
    "geometry",
    "features",
    "singularities",
    "parameters",
    "pose",
    "servoing",
    "experiments",
    "nodes",
    "cli",
]
TOP_LEVEL = {"errors", "arrays"}


def imported_modules(file):
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            yield node.module


def is_ros(module):
    package = module.split(".")[0]
    return package in ROS or package.endswith(("_msgs", "_srvs"))


def test_there_is_something_to_check():
    assert {file.parent.name for file in FILES} >= set(ORDER)
    assert any(is_ros(module) for file in (ROOT / "nodes").glob("*.py") for module in imported_modules(file))


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_only_nodes_import_ros(file):
    if file.parent.name != "nodes":
        assert [module for module in imported_modules(file) if is_ros(module)] == []


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_dependencies_go_one_way(file):
    if file.parent == ROOT:
        allowed = TOP_LEVEL
    else:
        allowed = TOP_LEVEL | set(ORDER[: ORDER.index(file.relative_to(ROOT).parts[0]) + 1])
    inner = {module.split(".")[1] for module in imported_modules(file) if module.startswith("plsing_ros.")}
    assert inner <= allowed
