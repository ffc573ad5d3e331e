# SPDX-License-Identifier: Apache-2.0
"""How commands end."""

import os
import subprocess
import sys

import pytest

from plsing_ros.cli.command import run_command
from plsing_ros.errors import PlsingError


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (PlsingError("gain is -1"), 1, "x: gain is -1\n"),
        (
            FileNotFoundError(2, "No such file or directory", "a.md"),
            1,
            "x: [Errno 2] No such file or directory: 'a.md'\n",
        ),
        (KeyboardInterrupt(), 130, "\nx: interrupted\n"),
    ],
)
def test_a_failure_is_one_line(capsys, error, code, said):
    def action():
        raise error

    assert run_command("x", action) == code
    assert capsys.readouterr().err == said


@pytest.mark.parametrize("code", [0, 1])
def test_else_the_code_is_that_of_the_action(code):
    assert run_command("x", lambda: code) == code


def test_a_reader_that_has_seen_enough_is_no_fault():
    program = (
        "import sys; from plsing_ros.cli.command import run_command; sys.exit(run_command('x', lambda: print(1) or 0))"
    )
    reading, writing = os.pipe()
    os.close(reading)
    ended = subprocess.run([sys.executable, "-c", program], stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (1, b"")
