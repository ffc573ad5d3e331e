# SPDX-License-Identifier: Apache-2.0
"""The rules of the house that a folder listing promises, read off the imports."""

import ast
import re
import sys
from pathlib import Path

import pytest
from mutants import MUTANTS

import plsing_ros
from plsing_ros.cli.parameter_files import NODES

ROOT = Path(plsing_ros.__file__).resolve().parent
FILES = sorted(ROOT.rglob("*.py"))
ROS = {"rclpy", "plsing_msgs", "rcl_interfaces", "builtin_interfaces", "rosgraph_msgs", "domain_coordinator"}
WITH_ROS = {"nodes", "testing"}
# What `import plsing_ros` may need; the rest is imported by what needs it.
AT_IMPORT = {"numpy", "scipy"}

# Each room may import itself and those before it.
ORDER = [
    "_core",
    "geometry",
    "features",
    "singularities",
    "parameters",
    "pose",
    "tracking",
    "planning",
    "control",
    "monitoring",
    "simulation",
    "analysis",
    "figures",
    "nodes",
    "testing",
    "cli",
]
CORE = set(ORDER[: ORDER.index("simulation")]) - {"parameters"}
FILE_READERS = {"scene_file.py", "model_files.py", "yaml_file.py"}
TOP_LEVEL = {"errors", "arrays", "levels", "stamp_filter"}


def name_of(file):
    parts = file.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(file): file for file in FILES}


def imported_modules(file, at_import=False):
    """Yield the modules that a file imports; at_import leaves out what functions import when they are called."""
    tree = ast.parse(file.read_text())
    inside = {id(node) for each in ast.walk(tree) if isinstance(each, ast.FunctionDef) for node in ast.walk(each)}
    for node in ast.walk(tree):
        if at_import and id(node) in inside:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in MODULES else node.module


def is_ros(module):
    package = module.split(".")[0]
    return package in ROS or package.endswith(("_msgs", "_srvs"))


def room_of(file):
    return file.relative_to(ROOT).parts[0]


def test_there_is_something_to_check():
    assert any(is_ros(module) for file in (ROOT / "nodes").glob("*.py") for module in imported_modules(file))


def test_only_nodes_and_testing_import_ros():
    for file in FILES:
        if room_of(file) not in WITH_ROS:
            assert [module for module in imported_modules(file) if is_ros(module)] == [], file


def test_dependencies_go_one_way():
    for file in FILES:
        if file.parent == ROOT:
            if file.name == "__init__.py":
                continue
            allowed = TOP_LEVEL
        else:
            allowed = TOP_LEVEL | set(ORDER[: ORDER.index(room_of(file)) + 1])
        inner = {module.split(".")[1] for module in imported_modules(file) if module.startswith("plsing_ros.")}
        assert inner <= allowed, file


def test_the_core_does_not_know_what_is_not_installed():
    for file in FILES:
        assert not {module.split(".")[0] for module in imported_modules(file)} & {"paper", "benchmark", "test"}, file


def test_no_module_imports_itself_round_about():
    imports = {
        name: {module for module in imported_modules(file) if module in MODULES and module != name}
        for name, file in MODULES.items()
    }
    # Packages are left out: their __init__ gathers what is inside.
    packages = {name for name, file in MODULES.items() if file.name == "__init__.py"}
    done, active = set(), []

    def visit(name):
        if name in active:
            pytest.fail("import cycle: " + " -> ".join([*active[active.index(name) :], name]))
        if name in done or name in packages:
            return
        active.append(name)
        for module in sorted(imports[name]):
            visit(module)
        active.pop()
        done.add(name)

    sys.setrecursionlimit(10_000)
    for name in MODULES:
        visit(name)


def test_the_core_knows_no_parameter_by_its_name_with_dots():
    """Files of scenes and models have such names as their keys."""
    dotted = {name for kind in NODES.values() for name in kind.specifications() if "." in name}
    assert len(dotted) > 100
    for file in FILES:
        if room_of(file) not in CORE or file.name in FILE_READERS:
            continue
        tree = ast.parse(file.read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                node.value.value = ""  # a docstring, which may say what a parameter is called
        strings = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
        words = {word.strip("'\"`():;,") for text in strings if isinstance(text, str) for word in text.split()}
        assert not words & dotted and not any(word.endswith(".*") for word in words), file


def test_no_two_classes_share_a_name():
    places = {}
    for folder in (ROOT, *(Path(__file__).parents[1] / name for name in ("benchmark", "paper", "test", "tools"))):
        files = sorted(folder.rglob("*.py"))
        assert files, folder
        for file in files:
            for node in ast.parse(file.read_text()).body:
                if isinstance(node, ast.ClassDef):
                    places.setdefault(node.name, []).append(str(file))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


@pytest.mark.parametrize("name", MUTANTS)
def test_each_mutant_still_has_its_place(name):
    mutant = MUTANTS[name]
    text = (ROOT / mutant.file).read_text()
    changed, count = re.subn(mutant.pattern, mutant.replacement, text)
    assert count == 1 and changed != text
