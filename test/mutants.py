# SPDX-License-Identifier: Apache-2.0
"""Break central rules one at a time, and show that the tests notice each: python3 test/mutants.py [NAME ...].

Each mutant is made in a copy of the sources, the tests named with it run there, and at least one must fail. Without
the mutant they must pass.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
COPIED = ("plsing_ros", "test", "config", "paper", "benchmark", "pyproject.toml")


class Mutant(NamedTuple):
    """A rule that is broken.

    Attributes:
        rule: What is broken.
        file: Where, in plsing_ros/.
        pattern: Regular expression that matches once there.
        replacement: What stands there instead.
        tests: What to run.
    """

    rule: str
    file: str
    pattern: str
    replacement: str
    tests: str


MUTANTS = {
    "twist_sign": Mutant(
        "the sign of the twist",
        "control/compute_twist.py",
        r", -gain, parameters\.pinv_threshold",
        ", gain, parameters.pinv_threshold",
        "test/control",
    ),
    "interaction_sign": Mutant(
        "the sign of the image's velocity when the camera moves",
        "features/interaction.py",
        r"return matrix\n",
        "return -matrix\n",
        "test/features/test_interaction.py",
    ),
    "contradictions": Mutant(
        "features that contradict themselves, the scene or a pose are refused",
        "features/consistency.py",
        r"        pose, near = \(_SOMEWHERE",
        "        return True\n        pose, near = (_SOMEWHERE",
        "test/features/test_consistency.py",
    ),
    "hysteresis": Mutant(
        "a level is left above the exit threshold only",
        "monitoring/hysteresis.py",
        r"self\.warn_exit or DEFAULT_EXIT \* self\.warn",
        "self.warn",
        "test/monitoring/test_hysteresis.py",
    ),
    "transversal_dropped": Mutant(
        "every transversal is a locus",
        "singularities/singular_set.py",
        r"transversals=transversals,",
        "transversals=transversals[:1],",
        "test/singularities/test_loci.py test/singularities/test_paper_p3l_p4l.py",
    ),
    "isolated_point_dropped": Mutant(
        "every real isolated point is a locus",
        "singularities/singular_set.py",
        r"isolated_points=points\[: len\(rows\)\]",
        "isolated_points=points[: len(rows) - 1]",
        "test/singularities/test_loci.py test/singularities/test_paper_p3l_p4l.py",
    ),
    "clamp": Mutant(
        "one factor holds both speeds below their limits",
        "control/saturation.py",
        r"factor = min\(factor, limit / speed\)",
        "factor = limit / speed",
        "test/control/test_saturation.py",
    ),
    "watchdog": Mutant(
        "old features are noticed when no new ones come",
        "stamp_filter.py",
        r"age is not None and age <= self\.timeout:",
        "age is not None and age <= 2.0 * self.timeout:",
        "test/test_stamp_filter.py test/control",
    ),
    "stamp_order": Mutant(
        "features that overtook others are refused",
        "stamp_filter.py",
        r"stamp < self\._last_stamp:",
        "stamp < 0:",
        "test/test_stamp_filter.py",
    ),
    "gate": Mutant(
        "a level worse than allowed closes the gate",
        "control/gate.py",
        r"self\._level > self\.worst",
        "self._level < self.worst",
        "test/control",
    ),
    "gate_silence": Mutant(
        "a monitor that is silent closes the gate",
        "control/gate.py",
        r"if silence is not None:",
        "if False:",
        "test/control",
    ),
    "reversed_line": Mutant(
        "a line seen against its direction is refused",
        "geometry/line_alignment.py",
        r"if ids := (.*):",
        r"if False and \1:",
        "test/geometry",
    ),
    "closest_approach": Mutant(
        "only what is ahead within the horizon counts as an approach",
        "monitoring/approach.py",
        r"nearest_time > 0\.0",
        "nearest_time < 0.0",
        "test/monitoring/test_approach.py",
    ),
    "not_finite": Mutant(
        "a twist that is not finite is never commanded",
        "control/servo_cycle.py",
        r"if not \(math\.isfinite\(speed\) and math\.isfinite\(error_norm\)\):",
        "if False:",
        "test/control/test_servo_controller.py test/control/test_laws.py test/control/test_guard.py",
    ),
    "range": Mutant(
        "a parameter above its range is refused",
        "parameters/parameter_set.py",
        r"number > spec\.maximum",
        "number > 10 * spec.maximum + 1",
        "test/parameters",
    ),
    "ambiguous": Mutant(
        "a pose that another one is as likely as is AMBIGUOUS",
        "pose/verdict.py",
        r"return Verdict\.AMBIGUOUS,",
        "return Verdict.OK,",
        "test/pose",
    ),
    "message_rows": Mutant(
        "directions and moments keep their places in messages",
        "nodes/conversions.py",
        r"message\.directions = flat\(directions\)",
        "message.directions = flat(moments)",
        "test/ros/test_feature_simulator.py test/ros/test_controller.py",
    ),
    "message_axes": Mutant(
        "the axes of a twist keep their order in messages",
        "nodes/conversions.py",
        r"linear\.x, linear\.y, (linear\.z, angular\.x, angular\.y, angular\.z = )",
        r"linear.y, linear.x, \1",
        "test/ros/test_controller.py",
    ),
}


def run_tests(folder: Path, tests: str) -> tuple[bool, str]:
    """Return whether all tests pass in a copy, and the first that fails."""
    environment = dict(os.environ, PYTHONPATH=str(folder), PYTHONDONTWRITEBYTECODE="1")
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider", *tests.split()]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise SystemExit(f"pytest ended with {done.returncode}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    # Without the values that the test was run with.
    failed = re.search(r"^(?:FAILED|ERROR) ([^\s\[]+)", done.stdout, re.MULTILINE)
    return done.returncode == 0, failed[1] if failed else ""


def main(names: list[str]) -> int:
    """Print a row for each mutant; return 1 if one is not noticed."""
    missed = 0
    print("| rule that is broken | in `plsing_ros/` | first test that fails |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for name in COPIED:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, folder / name)
        for name in names or MUTANTS:
            mutant = MUTANTS[name]
            file = folder / "plsing_ros" / mutant.file
            text = file.read_text(encoding="utf-8")
            changed, count = re.subn(mutant.pattern, mutant.replacement, text)
            if count != 1 or changed == text:
                raise SystemExit(f"mutant {name}: its pattern matches {count} times in {mutant.file}")
            file.write_text(changed, encoding="utf-8")
            survived, test = run_tests(folder, mutant.tests)
            file.write_text(text, encoding="utf-8")
            if survived:
                missed += 1
                test = "**none**"
            elif not run_tests(folder, test or mutant.tests)[0]:
                raise SystemExit(f"mutant {name}: {test or mutant.tests} fails without it, too")
            print(f"| {mutant.rule} | `{mutant.file}` | {test.removeprefix('test/')} |", flush=True)
    print(f"\n{len(names or MUTANTS) - missed} of {len(names or MUTANTS)} noticed")
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
