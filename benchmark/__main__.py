"""Run benchmarks: all of speed, or those named."""

from __future__ import annotations

import argparse
import importlib
import os
import platform
from pathlib import Path

# Before numpy is imported: comparisons are of one thread against one thread.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Studies of behaviour rather than speed, of many minutes each: only when named.
STUDIES = ("alert_quality", "laws", "noisy_alerts", "pose_quality")
NAMES = sorted(file.stem for file in Path(__file__).parent.glob("*.py") if "\ndef main() -> None:" in file.read_text())


def run(names: list[str]) -> None:
    """Run the named benchmarks."""
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    for name in names:
        module = importlib.import_module(f"benchmark.{name}")
        print(f"\n== {name}: {(module.__doc__ or '').splitlines()[0]}\n", flush=True)
        module.main()


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
    options = parser.parse_args()
    unknown = sorted(set(options.names) - set(NAMES))
    if unknown:
        parser.error(f"no benchmark '{unknown[0]}'; there are {', '.join(NAMES)}")
    run(options.names or [name for name in NAMES if name not in STUDIES])
