# SPDX-License-Identifier: Apache-2.0
"""What commands have in common: exit codes, last words, and folders to write to."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

from plsing_ros.errors import PlsingError


def run_command(name: str, action: Callable[[], int]) -> int:
    """Do what a command does; return its exit code.

    Args:
        name: Of the command, for messages.
        action: Returns the exit code.

    Returns:
        That of action; 1 with one line on standard error if it raises a PlsingError or a file cannot be written; 130
        if it is interrupted.
    """
    try:
        code = action()
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read the output has seen enough, as head does; what is still buffered has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (PlsingError, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"\n{name}: interrupted", file=sys.stderr)
        return 130
    return code


def make_folder(folder: Path, what: str, options: str) -> None:
    """Make a folder before the long part of a command, so that nothing is lost.

    Args:
        folder: May exist.
        what: What cannot be done without it, for the message: "write the figures".
        options: What to choose another one with.

    Raises:
        PlsingError: If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PlsingError(f"cannot {what} to {folder}: {error}; choose another {options}") from None


def add_worker_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say who does the work, for plsing_ros.analysis.parallel.Workers."""
    parser.add_argument("--processes", type=int, help="on this machine (as many as cores)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster to run on: tcp://host:8786")
