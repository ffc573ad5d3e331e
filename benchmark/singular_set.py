# SPDX-License-Identifier: Apache-2.0
"""The singular set of four lines: one scene, many scenes, distances, and computer algebra on the same scenes."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.timing import median_seconds
from plsing_ros.geometry import LineSet
from plsing_ros.singularities import singular_set, solve_four_line_scenes
from plsing_ros.singularities.isolated_points import solve_ten_points
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.transversals import analyze_transversals

# Integer scenes, so that every program gets exactly the same input: the paper's example and three at random.
SCENES = [([[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13]])]
SCENES += [tuple(np.random.default_rng(seed).integers(-9, 10, size=(2, 4, 3)).tolist()) for seed in (1, 2, 3)]
BATCH = 5000
_TIME_LIMIT = 20.0


def main() -> None:
    """Measure and print."""
    ours = _one_scene()
    _where_time_goes()
    _many_scenes()
    _peers(ours)


def _lines(scene: tuple[list[list[int]], list[list[int]]]) -> LineSet:
    return LineSet.from_points_directions(*scene)


def _one_scene() -> list[float]:
    print("one scene, everything (transversals, isolated points, classification), median [ms]")
    medians = []
    for number, scene in enumerate(SCENES):
        lines = _lines(scene)
        singular = singular_set(lines)
        seconds = median_seconds({"set": lambda lines=lines: singular_set(lines)}, rounds=300, calls=3)["set"]
        medians.append(seconds)
        points = f"{len(singular.isolated_points)} real of {len(singular.isolated_points_complex)} points"
        print(f"  scene {number}: {1e3 * seconds:6.2f}   {points}, {len(singular.transversals)} transversals")
    singular = singular_set(_lines(SCENES[0]))
    center = np.array([0.3, 0.2, 1.0])
    medians_of = median_seconds(
        {"arrays": lambda: singular.distance_arrays(center), "list": lambda: singular.distances(center)}, calls=50
    )
    print(
        f"distances from one camera centre to {len(singular.locus_names)} loci: {1e6 * medians_of['arrays']:.0f} us as "
        f"arrays, {1e6 * medians_of['list']:.0f} us as a sorted list"
    )
    return medians


def _where_time_goes() -> None:
    lines = _lines(SCENES[0])
    frame = SceneFrame.of(lines)
    direction, point = frame.direction[np.newaxis], frame.point[np.newaxis]
    square = np.random.default_rng(0).normal(size=(1, 10, 10))
    larger = np.random.default_rng(0).normal(size=(1, 20, 20))
    ten = solve_ten_points(direction, point).center[0]
    parts: dict[str, Callable[[], object]] = {
        "singular_set": lambda: singular_set(lines),
        "ten points": lambda: solve_ten_points(direction, point),
        "transversals": lambda: analyze_transversals(frame),
        "scene frame": lambda: SceneFrame.of(lines),
        "a 10 x 10 eigenproblem alone": lambda: np.linalg.eig(square),
        "a 20 x 20 eigenproblem alone": lambda: np.linalg.eig(larger),
        "residuals of ten points": lambda: singularity_residuals(frame.point, frame.direction, ten),
    }
    medians = median_seconds(parts, rounds=300)
    print("\nwhere the time goes [us], share of the whole")
    for name, seconds in medians.items():
        print(f"  {name:48s} {1e6 * seconds:6.0f}  {seconds / medians['singular_set']:5.0%}")


def _many_scenes() -> None:
    points, directions = np.random.default_rng(1).normal(size=(2, BATCH, 4, 3))
    start = time.perf_counter()
    batch = solve_four_line_scenes(points, directions)
    batch_rate = BATCH / (time.perf_counter() - start)
    some = BATCH // 10
    scenes = [LineSet.from_points_directions(points[i], directions[i]) for i in range(some)]
    start = time.perf_counter()
    for lines in scenes:
        singular_set(lines)
    loop_rate = some / (time.perf_counter() - start)
    print(
        f"\n{BATCH} random scenes: batch {batch_rate:.0f} scenes/s, loop over singular_set {loop_rate:.0f} scenes/s "
        f"({batch_rate / loop_rate:.1f} times); {int(batch.generic.sum())} with all ten points, largest residual "
        f"{batch.residual[batch.generic].max():.1e}"
    )


def _peers(ours: list[float]) -> None:
    print(f"\ncomputer algebra on the same scenes, wall time [s] (limit {_TIME_LIMIT:.0f} s), and its ratio to ours")
    systems = [_polynomials(scene) for scene in SCENES]
    saturated = {id(system): _saturated(system) for system in systems}
    peers: list[tuple[str, Callable[[tuple[list[str], list[str]]], str | None]]] = [
        ("msolve, saturated system", lambda system: _msolve(saturated[id(system)], 4)),
        ("msolve, unsaturated", lambda system: _msolve(system[0], 3)),
        ("Singular, saturated", _singular),
        ("sympy groebner, saturated", lambda system: _sympy(saturated[id(system)])),
    ]
    for name, run in peers:
        row = []
        for system, seconds in zip(systems, ours, strict=True):
            start = time.perf_counter()
            outcome = run(system)
            elapsed = time.perf_counter() - start
            if outcome is None:
                row = ["not installed"]
                break
            row.append("over the limit" if outcome == "limit" else f"{elapsed:.3f} ({elapsed / seconds:.0f} x)")
            if outcome == "limit":
                break
        print(f"  {name:28s} {'  '.join(row)}")


def _polynomials(scene: tuple[list[list[int]], list[list[int]]]) -> tuple[list[str], list[str]]:
    """Return the cubics H and quintics K of the paper, and the quadrics G, as text."""
    from sympy import QQ, ring

    _, *center = ring("X, Y, Z", QQ)

    def cross(a: list[Any], b: list[Any]) -> list[Any]:
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    def determinant(a: list[Any], b: list[Any], c: list[Any]) -> Any:
        return sum(x * y for x, y in zip(a, cross(b, c), strict=True))

    f, m, moment = [], [], []
    for point, direction in zip(*scene, strict=True):
        f.append(cross(direction, [p - c for p, c in zip(point, center, strict=True)]))
        m.append(cross(direction, f[-1]))
        moment.append(cross(point, f[-1]))
    triples = list(combinations(range(4), 3))
    h = [determinant(*(m[i] for i in triple)) for triple in triples]
    g = [determinant(*(f[i] for i in triple)) for triple in triples]
    # The 6 x 6 minors with all four f_i, expanded along them: triples[3 - i] leaves out line i.
    k = [
        sum((-1) ** i * g[3 - i] * determinant(moment[i], m[a], m[b]) for i in range(4))
        for a, b in combinations(range(4), 2)
    ]
    text = [[str(p).replace("**", "^") for p in group] for group in (h + k, g)]
    return text[0], text[1]


def _saturated(system: tuple[list[str], list[str]]) -> list[str]:
    import sympy

    # Every observed line is on one of these two quadrics, every transversal on both.
    condition = sympy.sympify(f"T*({system[1][0]})*({system[1][3]})-1".replace("^", "**"))
    return [*system[0], str(sympy.expand(condition)).replace("**", "^")]


def _msolve(polynomials: list[str], variables: int) -> str | None:
    binary = shutil.which("msolve")
    package = importlib.util.find_spec("sage_wheels")
    if binary is None and package is not None and package.submodule_search_locations:
        candidate = Path(next(iter(package.submodule_search_locations))) / "bin" / "msolve"
        binary = str(candidate) if candidate.exists() else None
    if binary is None:
        return None
    names = "X,Y,Z,T" if variables == 4 else "X,Y,Z"
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "system.ms"
        source.write_text(f"{names}\n0\n" + ",\n".join(polynomials) + "\n")
        return _run([binary, "-t", "1", "-f", str(source), "-o", str(Path(folder) / "out")], None)


def _singular(system: tuple[list[str], list[str]]) -> str | None:
    binary = shutil.which("Singular")
    if binary is None:
        return None
    commands = (
        'LIB "elim.lib"; ring r = 0, (X, Y, Z), dp;'
        f"ideal I = {','.join(system[0])}; ideal g = {system[1][0]}; ideal h = {system[1][3]};"
        "I = sat(std(I), g)[1]; I = sat(I, h)[1]; vdim(std(I)); quit;\n"
    )
    return _run([binary, "-q", "--no-rc"], commands)


def _sympy(polynomials: list[str]) -> str | None:
    code = (
        "import sympy, sys\n"
        "X, Y, Z, T = sympy.symbols('X Y Z T')\n"
        "system = [sympy.sympify(p.replace('^', '**')) for p in sys.stdin.read().split(',')]\n"
        "sympy.groebner(system, X, Y, Z, T, order='grevlex')\n"
    )
    return _run([sys.executable, "-c", code], ",".join(polynomials))


def _run(command: list[str], text: str | None) -> str:
    try:
        subprocess.run(command, input=text, capture_output=True, text=True, timeout=_TIME_LIMIT, check=True)
    except subprocess.TimeoutExpired:
        return "limit"
    return "done"


if __name__ == "__main__":
    main()
