# SPDX-License-Identifier: Apache-2.0
"""Run benchmarks: all of speed, or those named."""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import platform
from pathlib import Path

# Before numpy is imported: comparisons are of one thread against one thread.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Studies of behaviour rather than speed, of many minutes each: only when named.
STUDIES = (
    *("alert_quality", "alerts", "camera_loop", "law_suite", "laws", "memory", "node_memory"),
    *("pose_filter", "pose_quality", "stop_time"),
)
NAMES = sorted(file.stem for file in Path(__file__).parent.glob("*.py") if "\ndef main(" in file.read_text())


def run(names: list[str], quick: bool) -> None:
    """Run the named benchmarks; those that can be quick and large are, as asked."""
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    for name in names:
        module = importlib.import_module(f"benchmark.{name}")
        print(f"\n== {name}: {(module.__doc__ or '').splitlines()[0]}\n", flush=True)
        before = _processor_time()
        if inspect.signature(module.main).parameters:
            module.main(quick)
        else:
            module.main()
        spent = [after - each for each, after in zip(before, _processor_time(), strict=True)]
        print(
            f"\nMeanwhile this benchmark and all else on the machine took {spent[0] / spent[2]:.0%} of its processor "
            f"time, and the host of a virtual machine kept {spent[1] / spent[2]:.0%} for others: with more than a few "
            "per cent kept, the slowest figures are the host's."
        )


def _processor_time() -> tuple[float, float, float]:
    """Return what was used, what a host kept for others (steal), and all there was, in ticks since the start."""
    ticks = [int(each) for each in Path("/proc/stat").read_text().splitlines()[0].split()[1:9]]
    idle, stolen, total = ticks[3] + ticks[4], ticks[7], sum(ticks)
    return total - idle - stolen, stolen, total


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="benchmark",
        description="Measure the speed of plsing_ros beside that of others, in one run.",
        epilog="examples:\n  make bench\n  make bench ARGS=control_cycle\n  make bench ARGS=laws",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"which (default: all but the studies of many minutes, {', '.join(STUDIES)}): {', '.join(NAMES)}",
    )
    parser.add_argument("--quick", action="store_true", help="a small part of the studies that have one")
    options = parser.parse_args()
    unknown = sorted(set(options.names) - set(NAMES))
    if unknown:
        parser.error(f"no benchmark '{unknown[0]}'; there are {', '.join(NAMES)}")
    run(options.names or [name for name in NAMES if name not in STUDIES], options.quick)
