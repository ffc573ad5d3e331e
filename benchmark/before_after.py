# SPDX-License-Identifier: Apache-2.0
"""The native core in C++ beside the C kernels that it replaced and ViSP: both trees in one run, taking turns.

The former commit is checked out into a temporary work tree and compiled there; both trees run with the packages of this
environment, each in a process of its own, and are asked in turns.
"""

from __future__ import annotations

import math
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmark import visp
from benchmark.control_cycle import START, TARGET
from plsing_ros.geometry import LineSet

FORMER = "d524f18"
_HERE = Path(__file__).resolve().parents[1]
_WORKER = Path(__file__).with_name("before_after_worker.py")
# Each row: what it is called, the worker's name for it, and what the two times are allowed to be.
_CORE, _STEP = "control step, core", "control step, whole"
_ROWS = [
    *((f"{_CORE}, {n} lines", f"core {n}", "ViSP") for n in (4, 20)),
    *((f"{_STEP}, {n} lines", f"step {n}", "ViSP") for n in (4, 20)),
    *((f"observation from a message, {n} lines", f"input {n}", "") for n in (4, 20)),
    *((f"pose from {n} lines", f"pose {n}", "1.3") for n in (4, 8)),
    *((f"one monitor status, {n} lines", f"monitor {n}", "1.3") for n in (4, 20)),
    ("singular set of four lines", "singular set", "eigenproblem"),
    ("batch of scenes, for each scene", "batch", "1.25"),
    ("20 x 20 eigenproblem, LAPACK", "eigenproblem", ""),
]
ROUNDS, QUICK_ROUNDS = 40, 8


class _Tree:
    """A work tree, measured in a process of its own."""

    def __init__(self, folder: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, str(_WORKER), str(folder)]
        self._process = subprocess.Popen(
            command, cwd=folder, env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def seconds(self, name: str) -> float:
        """Return the time of one call of a candidate [s]."""
        assert self._process.stdin is not None and self._process.stdout is not None
        print(name, file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise SystemExit(f"the process that measures {name} ended with {self._process.wait()}")
        return float(answer)

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def main(quick: bool) -> None:
    """Measure and print."""
    with _former_tree() as folder, visp.compiled() as peer:
        print(f"ViSP: {peer if isinstance(peer, str) else f'{peer.version}, its own vpFeatureLine and vpServo, C++'}")
        before, now = _Tree(folder), _Tree(_HERE)
        times: dict[str, list[list[float]]] = {name: [[], [], []] for _, name, _ in _ROWS}
        for _ in tqdm(range(QUICK_ROUNDS if quick else ROUNDS), leave=False):
            for _, name, _ in _ROWS:
                # Closest together in time what is compared.
                times[name][0].append(before.seconds(name))
                times[name][1].append(now.seconds(name))
                kind, _, n = name.partition(" ")
                if kind == "core" and isinstance(peer, visp.Visp):
                    times[name][2].append(peer.step(_lines(int(n)), START, TARGET)[0])
        before.close()
        now.close()
    _print_table(times)


def _print_table(times: dict[str, list[list[float]]]) -> None:
    medians = {name: [1e6 * statistics.median(each) if each else math.nan for each in of] for name, of in times.items()}
    eigenproblem = medians["eigenproblem"][1]
    print(f"\nmedians [us]; before: commit {FORMER}\n")
    print("| what | before | now | now / before | ViSP | now / ViSP | target |\n|---|---|---|---|---|---|---|")
    for text, name, target in _ROWS:
        before, now, _ = medians[name]
        kind, _, n = name.partition(" ")
        theirs = medians[f"core {n}"][2] if target == "ViSP" else math.nan
        beside = f"{theirs:.1f} | {now / theirs:.2f}" if math.isfinite(theirs) else " | "
        said = {
            "ViSP": f"{'1.5' if n == '4' else '1'} x ViSP",
            "eigenproblem": f"3 eigenproblems; {now / eigenproblem:.2f}",
        }.get(target, f"{target} x before" if target else "")
        print(f"| {text} | {before:.1f} | {now:.1f} | {now / before:.2f} | {beside} | {said} |")


def _lines(n: int) -> LineSet:
    """Return the lines that the workers use, too."""
    generator = np.random.default_rng(n)
    return LineSet.from_points_directions(generator.normal(size=(n, 3)), generator.normal(size=(n, 3)))


@contextmanager
def _former_tree() -> Iterator[Path]:
    """Check out and compile the former commit; remove it in the end."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "former"
        git = ["git", "-C", str(_HERE), "worktree"]
        try:
            subprocess.run([*git, "add", "-q", "--detach", str(folder), FORMER], check=True)
            build = [sys.executable, "setup.py", "-q", "build_ext", "--inplace"]
            subprocess.run(build, cwd=folder, check=True)
            if not any((folder / "plsing_ros" / "kernels").glob("compiled*.so")):
                raise SystemExit(f"the C kernels of {FORMER} do not compile here")
            yield folder
        finally:
            subprocess.run([*git, "remove", "--force", str(folder)], check=False)
