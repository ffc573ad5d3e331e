# SPDX-License-Identifier: Apache-2.0
import importlib.util
import re
import shutil
import sys
from pathlib import Path

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

NAME = "plsing_ros"
SHARE = Path("share") / NAME
CORE = Path(NAME) / "_core"


def header_folders() -> list[str]:
    """Return where Eigen and pybind11 are: in wheels if they are installed, else in the system's folder."""
    wheels = [Path(folder) / "cmeel.prefix" / "include" / "eigen3" for folder in sys.path]
    folders = [*map(str, filter(Path.is_dir, wheels)), "/usr/include/eigen3"]
    if importlib.util.find_spec("pybind11"):
        import pybind11

        folders.insert(0, pybind11.get_include())
    return folders


def included_by(source: Path) -> set[Path]:
    """Return a source or header of the core, and all headers of the core that it includes."""
    found, open_ones = {source}, [source]
    while open_ones:
        names = re.findall(r'^#include "(.+)"', open_ones.pop().read_text(), re.MULTILINE)
        new = {CORE / name for name in names if (CORE / name).exists()} - found
        found |= new
        open_ones += new
    return found


def is_outdated(built: str, source: str) -> bool:
    """Return whether an object file is older than its source or than a header that it includes."""
    newest = max(file.stat().st_mtime for file in included_by(Path(source)))
    return not Path(built).exists() or Path(built).stat().st_mtime < newest


class BuildCore(build_ext):
    """Compiles the native core, or says what is missing for it."""

    def build_extensions(self) -> None:
        compiler = self.compiler.compiler_cxx[0]
        headers = ["Eigen/Core", "pybind11/pybind11.h"]
        searched = [*header_folders(), "/usr/include", "/usr/local/include"]
        missing = [name for name in headers if not any(Path(folder, name).exists() for folder in searched)]
        if shutil.which(compiler) is None:
            missing.insert(0, f"the C++ compiler {compiler}")
        if missing:
            raise SystemExit(
                f"plsing_ros cannot be compiled without {' and '.join(missing)}: "
                "sudo apt install g++ libeigen3-dev pybind11-dev"
            )
        super().build_extensions()


if importlib.util.find_spec("pybind11"):
    from pybind11.setup_helpers import ParallelCompile

    # setuptools compiles every file anew, one after the other.
    ParallelCompile(needs_recompile=is_outdated, default=2).install()


def shared_files() -> list[tuple[str, list[str]]]:
    """Return what is installed in share/plsing_ros as data_files entries: each folder with the files in it."""
    files_of: dict[Path, list[str]] = {}
    for pattern in ("config/**/*.*", "launch/*.launch.py", "docs/**/*.md", "docs/howto/*.py"):
        for file in sorted(Path().glob(pattern)):
            files_of.setdefault(file.parent, []).append(str(file))
    return [(str(SHARE / folder), files) for folder, files in files_of.items()]


setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (str(SHARE), ["package.xml"]),
        *shared_files(),
    ],
    package_data={NAME: ["py.typed"], f"{NAME}._core": ["*.pyi"]},
    cmdclass={"build_ext": BuildCore},
    ext_modules=[
        Extension(
            f"{NAME}._core.compiled",
            [str(file) for file in sorted(CORE.glob("*.cpp"))],
            include_dirs=header_folders(),
            depends=[str(file) for file in sorted(CORE.glob("*.hpp"))],
            language="c++",
            extra_compile_args=[
                "-std=c++17",
                # With -O3 one file takes 2 GB and minutes to compile.
                "-O2",
                "-fno-math-errno",
                "-g0",
                "-Wno-maybe-uninitialized",
                "-fvisibility=hidden",
            ],
        ),
    ],
    install_requires=["numpy>=1.26,<3", "scipy>=1.11,<2"],
    extras_require={
        "arm": ["mujoco>=3.1,<3.4", "opencv-python-headless>=4.6,<5"],
        "bags": ["rosbags>=0.10,<0.12"],
        "dask": ["distributed>=2024.1"],
        "files": ["PyYAML>=6,<7", "tqdm>=4,<5", "matplotlib>=3.6,<4"],
        "page": ["plotly>=5,<7"],
        "proofs": ["sympy>=1.12,<2", "mpmath>=1.3,<2"],
        # Without it `colcon test` finds no way to run the tests, and reports success.
        "test": ["pytest", "hypothesis"],
    },
    zip_safe=False,
    maintainer="plsing_ros developers",
    maintainer_email="maintainers@plsing-ros.invalid",
    description="Visual servoing on straight lines with its singularities known beforehand",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "feature_simulator = plsing_ros.nodes.feature_simulator:main",
            "controller = plsing_ros.nodes.controller:main",
            "singularity_monitor = plsing_ros.nodes.singularity_monitor:main",
            "pose_estimator = plsing_ros.nodes.pose_estimator:main",
            "line_tracker = plsing_ros.nodes.line_tracker:main",
            "arm_simulator = plsing_ros.nodes.arm_simulator:main",
            "container = plsing_ros.nodes.container:main",
            "demo = plsing_ros.cli.demo:main",
            "evaluate = plsing_ros.cli.evaluate:main",
            "demo_camera = plsing_ros.cli.demo_camera:main",
            "analyze = plsing_ros.cli.analyze:main",
            "replay = plsing_ros.cli.replay:main",
            "select_lines = plsing_ros.cli.select_lines:main",
            "survey = plsing_ros.cli.survey:main",
        ],
    },
)
