from typing import Any

import numpy.typing as npt

from plsing_ros.arrays import Array

def are_lines(direction: Array, moment: Array, tolerance: float, /) -> bool: ...
def are_image_lines(image_lines: Array, tolerance: float, /) -> bool: ...
def have_images(moment: Array, least_depth: float, /) -> bool: ...
def is_rotation(rotation: Array, tolerance: float, /) -> bool: ...
def interaction_matrix(direction: Array, moment: Array, matrix: Array, least_depth: float, /) -> bool: ...
def svd(matrix: Array, left: Array, singular_values: Array, right: Array, /) -> bool: ...
def mean_interaction(
    image: Array,
    desired_image: Array,
    interaction: Array,
    desired_interaction: Array,
    mean: Array,
    columns: int,
    /,
) -> None: ...
def plain_law(
    direction: Array,
    moment: Array,
    image: Array,
    desired: Array,
    singular_values: Array,
    twist: Array,
    least_depth: float,
    gain: float,
    threshold: float,
    /,
) -> float | None: ...
def subtract(a: Array, b: Array, difference: Array, /) -> float: ...
def solve(
    matrix: Array,
    right_side: Array,
    singular_values: Array,
    right: Array,
    components: Array,
    solution: Array,
    factor: float,
    threshold: float,
    /,
) -> bool: ...
def image_residuals(
    lines: Array, image_lines: Array, settings: Array, rotation: Array, translation: Array, table: Array, /
) -> None: ...
def image_jacobians(table: Array, raw: Array, value: Array, /) -> None: ...
def refine_poses(
    lines: Array,
    image_lines: Array,
    settings: Array,
    weight: Array,
    rotation: Array,
    translation: Array,
    gain: Array,
    final: Array,
    iterations: int,
    /,
) -> None: ...
def search_poses(
    lines: Array,
    image_lines: Array,
    settings: Array,
    rotation: Array,
    translation: Array,
    costs: Array,
    found: Array,
    /,
) -> int: ...
def pose_uncertainty(
    lines: Array,
    image_lines: Array,
    settings: Array,
    rotation: Array,
    translation: Array,
    weight: Array,
    deviation: Array,
    axes: Array,
    covariance: Array,
    figures: Array,
    /,
) -> bool: ...
def triplet_rotations(
    frame: Array,
    others: Array,
    normals: Array,
    sampling: Array,
    rotation: Array,
    triplet: Array,
    degenerate: Array,
    /,
) -> int: ...
def translations(rotation: Array, normals: Array, points: Array, t: Array, /) -> None: ...
def distances(point: Array, direction: Array, center: Array, closest: Array, distance: Array, /) -> bool: ...
def approach(
    closest: Array,
    distance: Array,
    direction: Array,
    role: Array,
    center: Array,
    velocity: Array,
    found: Array,
    horizon: float,
    at_rest: float,
    along_share: float,
    /,
) -> int: ...
def align(
    direction: Array,
    moment: Array,
    seen_direction: Array,
    seen_moment: Array,
    rotation: Array,
    translation: Array,
    quality: Array,
    /,
) -> bool: ...
def least_cosine(direction: Array, rotation: Array, seen_direction: Array, /) -> float: ...
def law_step(
    lines: Array,
    desired: Array,
    twist: Array,
    moved: Array,
    next_twist: Array,
    duration: float,
    gain: float,
    least_depth: float,
    fastest: float,
    /,
) -> bool: ...
def lines_seen(direction: Array, moment: Array, rotation: Array, translation: Array, seen: Array, /) -> None: ...
def image_deviation(moment: Array, image: Array, /) -> float: ...
def bilinear_newton(
    tensor: npt.NDArray[Any],
    h: npt.NDArray[Any],
    k: npt.NDArray[Any],
    steps: int,
    enough: float,
    small: float,
    longest: float,
    /,
) -> bool: ...
def singularity_ratios(
    direction: Array, point: Array, centers: npt.NDArray[Any], ratio: Array, distance: Array, on_line: float, /
) -> None: ...
def scene_coordinates(
    direction: Array, foot: Array, center: Array, length: Array, relative: Array, share: float, smallest: float, /
) -> bool: ...
def quartic_functionals(
    direction: Array, point: Array, samples: Array, interpolate: Array, functionals: Array, margin: Array, /
) -> None: ...
def axis_centers(
    imaginary: Array,
    functionals: Array,
    multiply: Array,
    direction: Array,
    point: Array,
    vectors: npt.NDArray[Any],
    w: npt.NDArray[Any],
    h: npt.NDArray[Any],
    center: npt.NDArray[Any],
    at_infinity: float,
    /,
) -> None: ...
def with_conjugates(
    imaginary: Array,
    h: npt.NDArray[Any],
    center: npt.NDArray[Any],
    residual: Array,
    ten: npt.NDArray[Any],
    residuals: Array,
    real: Array,
    overlap: Array,
    is_real: float,
    /,
) -> None: ...
