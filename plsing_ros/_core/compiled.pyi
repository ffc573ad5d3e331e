# SPDX-License-Identifier: Apache-2.0
"""What the native core computes: no checks of values but where it is said, and no units of its own.

Arrays are C-contiguous and float64 or complex128, and what comes back is new. An array of another type or shape raises
ValueError; None comes back for what has no answer. SI units, (v, omega) for twists, (direction, moment) for lines.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray

IndexArray = npt.NDArray[np.intp]
ComplexArray = npt.NDArray[np.complex128]

# lines.cpp

def are_lines(direction: Array, moment: Array, tolerance: float) -> bool:
    """Return whether all rows are finite, directions of unit length, and moments orthogonal to them.

    Args:
        direction: Shape (n, 3).
        moment: Shape (n, 3) [m].
        tolerance: Of the squared length, and of the product relative to 1 m plus the moment's largest element.
    """

def are_image_lines(image_lines: Array, tolerance: float) -> bool:
    """Return whether all rows (n, 3) are finite with l'_x^2 + l'_y^2 = 1, whose root may be off by the tolerance."""

def have_images(moment: Array, min_depth: float) -> bool:
    """Return whether all lines of these moments in the camera frame, shape (n, 3) [m], have an image.

    A line has none if |(l_x, l_y)| is below min_depth times the larger of 1 m and the moment's largest element, or if
    that or l_z is not finite.
    """

def is_rotation(rotation: Array, tolerance: float) -> bool:
    """Return whether a matrix (3, 3) is a rotation, its product with its transpose being off by up to the tolerance."""

def align_lines(
    direction: Array, moment: Array, seen_direction: Array, seen_moment: Array
) -> tuple[Array, Array, float, float, float] | None:
    """Return T_world_camera from n lines; None if they do not fix it or are not finite.

    Args:
        direction: In the world frame, shape (n, 3).
        moment: Likewise, shape (n, 3) [m].
        seen_direction: In the camera frame, shape (n, 3).
        seen_moment: Likewise, shape (n, 3) [m].

    Returns:
        Rotation (3, 3), translation (3,) [m], second singular value of the directions' correlation, least cosine
        between a direction and the seen one, root mean square misfit of the moments [m].

    Source: geometry.align_lines.
    """

def are_consistent(
    image_lines: Array,
    direction: Array,
    moment: Array,
    scene_direction: Array,
    scene_moment: Array,
    min_image_cosine: float,
    min_cosine: float,
    max_offset: float,
    rotation: Array,
    translation: Array,
    min_turn_cosine: float,
    max_distance: float,
    frame_ratio: float,
) -> int:
    """Return whether image lines and 3-D lines are certain to agree with each other, the scene and a camera pose.

    0: not certain; 1: they do; 2: and no two lines hold so much of the square misfit of the images that exchanging them
    could leave frame_ratio of it.

    Args:
        image_lines: Shape (n, 3).
        direction: Of the 3-D lines, in the camera frame, shape (n, 3).
        moment: Likewise, shape (n, 3) [m].
        scene_direction: Of the same lines in the scene frame, shape (n, 3); (0, 3) if the scene is not known.
        scene_moment: Likewise [m].
        min_image_cosine: Of the angle between an image line and its moment.
        min_cosine: Of the angle between a direction and that in the scene, at the pose that align_lines gives.
        max_offset: Root of the sum of the squared misfits of moments there [m].
        rotation: Of T_scene_camera, if that is known from elsewhere, shape (3, 3); all four of these or none.
        translation: Likewise, shape (3,) [m].
        min_turn_cosine: Of the angle between the two rotations.
        max_distance: Between the two positions [m].

    Source: new, docs/refusals.md; what is not certain is looked at by features.consistency.
    """

def exchanged_pair(
    image_lines: Array,
    moment: Array,
    covariances: Array,
    map_std: float,
    min_cosine: float,
    log_ratio: float,
    pair_ratio: float,
    frame_ratio: float,
) -> tuple[int, int] | None:
    """Return the rows of two image lines that fit much better with each other's 3-D line, or None.

    Args:
        image_lines: Shape (n, 3).
        moment: Of their 3-D lines in the camera frame, shape (n, 3) [m].
        covariances: Of angle and offset of each image line, shape (n, 3); (0, 3): not known.
        map_std: Of a line in the map [m].
        min_cosine: Between the planes of two lines that are looked at.
        log_ratio: By which exchanging them must be more likely by their covariances, or
        pair_ratio: what it must leave of the square misfit of the two at most, and
        frame_ratio: of that of all lines.

    Source: features.near_pairs.
    """

# features.cpp

def subtract(a: Array, b: Array) -> tuple[Array, float]:
    """Return a - b, shape (m,), and its norm: infinite only if an element is, or if the norm itself is too large."""

def interaction_matrix(direction: Array, moment: Array, min_depth: float) -> Array | None:
    """Return the interaction matrix of n lines in the camera frame, shape (3n, 6); None if one has no image.

    Source: features.interaction_matrix.
    """

def svd(matrix: Array) -> tuple[Array, Array, Array] | None:
    """Return the thin singular value decomposition (left (m, k), values (k,), right (k, k)) of a matrix (m, k).

    Values are the largest first, right singular vectors are rows. None if the matrix or a singular value is not
    finite. k is 1 to 6; with m < k the missing values are zero, and their left vectors of no use.
    """

def interaction_conditioning(direction: Array, moment: Array, min_depth: float) -> tuple[Array, Array] | None:
    """Return singular values and right singular vectors of interaction_matrix(...); None where it or svd is None."""

def solve(
    matrix: Array, right_side: Array, factor: float, threshold: float
) -> tuple[Array, Array, Array, Array] | None:
    """Return least squares by the singular value decomposition; None where svd is None.

    Args:
        matrix: Shape (m, k), k from 1 to 6.
        right_side: Shape (m,).
        factor: Multiplies the right side.
        threshold: Singular values up to this times the largest are taken as zero.

    Returns:
        Singular values (k,); right singular vectors as rows (k, k); factor times the components of the right side
        along the left singular vectors (k,); factor times pinv(matrix) @ right_side (k,).
    """

def compute_twist(
    direction: Array,
    moment: Array,
    image: Array,
    target_image: Array,
    min_depth: float,
    gain: float,
    threshold: float,
) -> tuple[Array, float, Array, float] | None:
    """Return the twist -gain pinv(L) (s - s*), its norm, the singular values of L and |s - s*|; None as solve.

    Args:
        direction: Of n lines in the camera frame, shape (n, 3), n from 2 on.
        moment: Likewise, shape (n, 3) [m].
        image: s, shape (3n,).
        target_image: s*, shape (3n,).
        min_depth: As for interaction_matrix.
        gain: [1/s].
        threshold: As for solve.

    Source: eq. velocity_input.
    """

# minimal_solver.cpp

def triplet_rotations(directions: Array, normals: Array, interpolate: Array) -> tuple[Array, IndexArray, BoolArray]:
    """Return all rotations R_camera_world with n_i . (R u_i) = 0 for the three lines of each of T triplets.

    Args:
        directions: Unit directions u_i, shape (T, 3, 3).
        normals: Unit normals n_i of the lines' interpretation planes in the camera frame, shape (T, 3, 3).
        interpolate: From nine samples of the polynomial to its coefficients, shape (9, 9): pose.minimal_solver.

    Returns:
        The rotations, one triplet after the other, shape (k, 3, 3), k <= 8 T: a pair of complex solutions counts as
        one, its nearest real rotation, as noise turns the two solutions near a singularity of the triplet into such a
        pair; the triplet of each, shape (k,); which triplets any rotation about an axis solves, shape (T,).

    Source: the eight solutions are those of Chen 1991 and of Xu, Zhang, Cheng, Koch 2017; the sampling is new,
    docs/pose.md section "Three lines".
    """

def translations(rotation: Array, normals: Array, points: Array) -> Array:
    """Return the least-squares t of n_i . (R x_i + t) = 0 of n lines, for k rotations, shape (k, 3) [m].

    Where the planes leave a direction of t open, its component along it is zero.

    Args:
        rotation: R_camera_world, shape (k, 3, 3).
        normals: Unit normals of the interpretation planes in the camera frame, shape (n, 3).
        points: A point x_i of each line in the world, shape (n, 3) [m].
    """

# image_residuals.cpp and pose_estimation.cpp: an image of n lines is given by
#   lines: unit directions and moments [m] in the world, the pivot of their errors [m], its standard deviation across a
#     line [m] and that of the direction [rad], shape (n, 11), n >= 1;
#   image_lines: observed l', and its covariance (angle angle, angle offset, offset offset), shape (n, 6);
#   settings: standard deviations of Plücker coordinates in the world and in the camera frame, and the cosine of half of
#     the field of view, shape (3,);
# and k poses T_camera_world by rotation (k, 3, 3) and translation (k, 3) [m].

def image_residuals(lines: Array, image_lines: Array, settings: Array, rotation: Array, translation: Array) -> Array:
    """Return what poses make of image lines, shape (k, 7, n).

    Of each line: angle [rad] and offset minus the observed ones; the same whitened, uncorrelated and in standard
    deviations; 1 if it is seen against its direction; 1 if it has no part that can be seen; logarithm of its
    covariance's determinant.

    Source: eq. plucker2dline in the coordinates (angle, offset) of an image line, and its covariance: docs/pose.md.
    """

def image_jacobians(lines: Array, image_lines: Array, settings: Array, rotation: Array, translation: Array) -> Array:
    """Return the derivatives of angle and offset, whitened, shape (k, 2, n, 6).

    By the twist (v, omega) of the camera in its own frame.

    Source: eq. MPlucker in the coordinates (angle, offset) of an image line: docs/pose.md.
    """

def refine_poses(
    lines: Array,
    image_lines: Array,
    settings: Array,
    weight: Array,
    rotation: Array,
    translation: Array,
    iterations: int,
) -> tuple[Array, Array]:
    """Return rotations and translations after Levenberg-Marquardt steps, each until it is at a minimum of the misfit.

    Args:
        lines: See above, like image_lines and settings.
        image_lines: Of the lines.
        settings: Noise and field of view.
        weight: Of each line for each pose, 0 or 1, shape (k, n).
        rotation: To begin with.
        translation: Likewise.
        iterations: At most so many steps.

    Source: the undamped, unweighted step is Marchand and Chaumette's virtual visual servoing (section "Pose Estimation
    along a quadrifolium trajectory"); the damping is Levenberg's and Marquardt's.
    """

def search_poses(
    lines: Array, image_lines: Array, settings: Array, rotation: Array, translation: Array, costs: Array
) -> list[tuple[Array, Array, float, int]]:
    """Refine the best of k first estimates on all lines, and return the poses that explain the image, best first.

    Cheap ones that differ are refined together, in stages; those that cannot catch up any more are dropped.

    Args:
        lines: See above, like image_lines and settings.
        image_lines: Of the lines.
        settings: Noise and field of view.
        rotation: First estimates.
        translation: Likewise.
        costs: Of a line that cannot be seen, and of one that is seen against its direction, shape (2,).

    Returns:
        Up to six times rotation (3, 3), translation (3,), -2 log of the likelihood up to a constant, and the row of the
        first estimate it comes from.
    """

def cheapest_different(rotation: Array, cost: Array, most: int) -> IndexArray:
    """Return the rows of up to `most` of the cheapest poses whose rotations differ, cheapest first.

    Looked at are the 24 cheapest.

    Args:
        rotation: Shape (k, 3, 3).
        cost: Shape (k,).
        most: See above.
    """

def pose_uncertainty(
    lines: Array, image_lines: Array, settings: Array, rotation: Array, translation: Array, weight: Array
) -> tuple[Array, Array, Array, float, float, float, float, float] | None:
    """Return the uncertainty of a pose at a minimum of the misfit, or None if it is not determined.

    Args:
        lines: See above, like image_lines and settings.
        image_lines: Of the lines.
        settings: Noise and field of view.
        rotation: Shape (3, 3).
        translation: Shape (3,) [m].
        weight: Of each line, 0 or 1, shape (n,).

    Returns:
        Standard deviations along the axes, largest first, shape (6,); the axes, unit twists (v, omega) of the camera in
        its frame, as rows, shape (6, 6); covariance as in geometry_msgs/PoseWithCovariance, shape (6, 6); standard
        deviations of position [m] and orientation [rad] in their worst directions; the largest relative difference of
        the misfit from a quadratic two standard deviations away, both ways along the two weakest axes, at most 1e6;
        inverse condition number of the interaction matrix; sum of squared residuals.

    Source: first-order propagation, docs/pose.md.
    """

def same_pose(rotation: Array, center: Array, other_rotation: Array, other_center: Array, tolerance: float) -> bool:
    """Return whether two poses differ by less than a tolerance, in every element.

    The centre's tolerance is this times (1 m + the first centre's largest element).
    """

# monitoring.cpp

def step_law(
    lines: Array,
    target_image: Array,
    twist: Array,
    duration: float,
    gain: float,
    min_depth: float,
    max_speed: float,
) -> tuple[Array, Array] | None:
    """Return what a camera sees after a motion, and the twist -gain pinv(L) (s - s*) that the law commands there.

    Args:
        lines: n lines in the camera frame, direction and moment, shape (2, n, 3).
        target_image: Image lines at the target, shape (n, 3).
        twist: With which the camera moves, shape (6,) [m/s, rad/s].
        duration: Of the motion [s].
        gain: [1/s].
        min_depth: As for have_images.
        max_speed: Length that the twist must not reach with gain 1.

    Returns:
        The lines after the motion, exactly, shape (2, n, 3), and the twist (6,); None if L is singular to working
        precision, a line has no image, or the twist is too long.
    """

def compare_lines(
    direction: Array,
    moment: Array,
    rotation: Array,
    translation: Array,
    seen_direction: Array,
    seen_moment: Array,
) -> tuple[Array, Array]:
    """Return lines in the frame of a camera, and those that it sees minus these, shapes (2, n, 3).

    Args:
        direction: In the world frame, shape (n, 3).
        moment: Likewise, shape (n, 3) [m].
        rotation: Of T_world_camera, shape (3, 3).
        translation: Likewise, shape (3,) [m].
        seen_direction: Of the same lines as the camera sees them, in its frame, shape (n, 3).
        seen_moment: Likewise, shape (n, 3) [m].
    """

def pose_covariance(values: Array) -> Array | None:
    """Return the symmetric part of a matrix, shape (6, 6), or None if that is zero, not finite, or no covariance."""

def image_deviation(moment: Array, image_lines: Array) -> float:
    """Return the sum of squares of the images of lines of these moments (n, 3) [m] minus image lines (n, 3).

    Infinite or NaN if a line has no image.
    """

def closest_points(point: Array, direction: Array, center: Array) -> tuple[Array, Array]:
    """Return the closest points on k lines, and points, shape (k, 3) [m], and their distances, shape (k,) [m].

    Args:
        point: A point of each, shape (k, 3) [m].
        direction: Unit directions, zero for points, shape (k, 3).
        center: Camera centre, shape (3,) [m].
    """

def closest_approach(
    closest: Array,
    distance: Array,
    direction: Array,
    role: Array,
    rotation: Array,
    center: Array,
    twist: Array,
    horizon: float,
    at_rest: float,
    along_share: float,
) -> tuple[int, float, float, float, float]:
    """Return what a straight motion comes nearest to, or row -1 if nothing is approached.

    Args:
        closest: The point of each locus closest to the centre, shape (k, 3) [m].
        distance: Of the centre from each, shape (k,) [m].
        direction: Unit directions of lines, zero for others, shape (k, 3).
        role: 0 for lines and points, 1 for surfaces, -1 for what is left out, shape (k,).
        rotation: Of T_world_camera, shape (3, 3).
        center: Camera centre, shape (3,) [m].
        twist: Of the camera in its frame, shape (6,) [m/s, rad/s].
        horizon: Approaches after this time do not count [s].
        at_rest: A centre slower than this does not move [m/s].
        along_share: A motion across a locus by no more than this share of the speed is along it.

    Returns:
        The row with the least distance ahead; the time to the closest point of the nearest locus [s] and the rate at
        which it comes nearer, as a share of the speed, or NaN if the motion does not change that distance; the time to
        the closest approach [s] and its distance [m], or NaN if there is none.
    """

# bind_tracking.cpp: edge_tracker.cpp, brightness.cpp, visible_edges.cpp, edge_search.cpp, line_fit.cpp, line_pose.cpp.
# Poses are T_camera_model; a camera is PinholeCamera.numbers; informations are of a motion of the model in the camera
# frame.

GreyImage = npt.NDArray[np.uint8]
IntArray = npt.NDArray[np.int32]

class _Pose(Protocol):
    """A Pose, or what has its attributes."""

    @property
    def rotation(self) -> Array: ...
    @property
    def translation(self) -> Array: ...

class EdgeFit:
    """What the edges of an image say of the pose.

    Attributes:
        pose: Rotation and translation.
        information: Of the pose, that of the start included, shape (6, 6).
        scale: Robust size of the residuals, in the deviations that lines claim.
        squares: Weighted sum of the squared residuals.
        residuals: In these deviations, two of each line, shape (k, 2).
        weights: Of the lines, in [0, 1], shape (k,).
        edges: Rows of the model's edges that have a line, shape (k,).
        visible: Rows of the visible edges.
        lines: phi, rho, and var phi, cov, var rho of each line, shape (k, 5).
        totals: Samples, those with a step of brightness at the pose, how many would have one by chance, and those
            without one where something is in the way.
    """

    pose: tuple[Array, Array]
    information: Array
    scale: float
    squares: float
    residuals: Array
    weights: Array
    edges: IntArray
    visible: IntArray
    lines: Array
    totals: tuple[float, float, float, float]
    def freedom(self, prior: Array) -> float:
        """Return the degrees of freedom of the residuals: what lines decide of the pose they cannot contradict."""

class Readout:
    """How the rows of an image are read if the object moved evenly since the one before.

    Args:
        before: The pose in the image before.
        share: Of the time from image to image in which a unit of the normalised image is read.
        center: Of the object, in the model frame, shape (3,) [m].
    """

    def __init__(self, before: _Pose, share: float, center: Array) -> None: ...
    def of(self, pose: _Pose) -> tuple[Array, float]:
        """Return the motion while a unit of the normalised image is read, and the row of the object's middle there."""

class EdgeTracker:
    """Edges of an object followed in the images of one camera.

    Args:
        vertices: Of the object, shape (n, 3) [m].
        edges: Rows of vertices, shape (m, 2).
        triangles: Rows of vertices, shape (k, 3).
        edge_triangles: Of each edge, the triangles that cannot hide it.
        camera: Its numbers.
        width: Of the images [px].
        height: Of the images [px].
        gamma: Exponent from grey levels to light.
    """

    def __init__(
        self,
        vertices: Array,
        edges: IntArray,
        triangles: IntArray,
        edge_triangles: Sequence[Sequence[int]],
        camera: Array,
        width: int,
        height: int,
        gamma: float,
    ) -> None: ...
    def forget(self, contrast: bool) -> None:
        """Know no brightness beside edges any more, nor, with `contrast`, the steps across them."""

    def samples(self, pose: _Pose) -> list[tuple[int, list[Array]]]:
        """Return the visible edges, and their samples in the normalised image."""

    def fit(
        self,
        image: GreyImage,
        noise: float,
        start: _Pose,
        information: Array,
        ranges: Sequence[int],
        readout: Readout | None,
    ) -> EdgeFit | None:
        """Return what one search range after another finds [px], from a pose with this information; None if no edge is
        in sight."""

    def other(self, fit: EdgeFit, start: _Pose) -> tuple[tuple[Array, Array], float]:
        """Return the pose near another start that fits the same lines, and how many samples it explains."""

    def learn(self, fit: EdgeFit, pose: _Pose, contrast: bool) -> None:
        """Learn how bright it is beside edges that agree, and, with `contrast`, the steps across them."""

    def seen_lines(self, fit: EdgeFit, pose: _Pose, share: float) -> tuple[Array, npt.NDArray[np.bool_], Array, Array]:
        """Return image lines, usable, covariances, times `share`, and ends of a LineObservation."""

class FaceMemory:
    """How bright an object's faces were, place by place.

    Args:
        places: On the faces, shape (n, 3) [m].
        triangles: On which triangle of the object each is.
        apart: How far they are from each other [m].
    """

    def __init__(self, places: Array, triangles: Sequence[int], apart: float) -> None: ...
    def covered(
        self,
        image: GreyImage,
        faces: GreyImage,
        triangles: Sequence[int],
        left: int,
        top: int,
        pose: _Pose,
        camera: Array,
    ) -> IntArray:
        """Return where something is in the way, as circles, x, y, radius, shape (k, 3), and learn from the rest.

        Args:
            image: Grey.
            faces: Which triangle is seen at each pixel of a part of the image, from 1, as an index of `triangles`; 0
                for none.
            triangles: Rows of the object's triangles.
            left: Column of the part's first pixel; circles are counted from it.
            top: Row of that pixel.
            pose: Of the object.
            camera: Its numbers.
        """

def project(points_camera: Array, camera: Array) -> Array:
    """Return the pixels of points (n, 3) before the camera, shape (n, 2)."""

def uncertainty(information: Array, pose: _Pose, center: Array, share: float) -> tuple[Array, float, float]:
    """Return the covariance, shape (6, 6), that an information stands for, times `share`, and the standard deviation
    of the center's position where it is largest [m], and of the rotation [rad]."""

def fit_points(points: Array, seen: Array, deviation: float, pose: _Pose) -> tuple[Array, Array, Array, float, Array]:
    """Return the pose that fits points of the model, shape (n, 3), to their images on z = 1, shape (n, 2): rotation,
    translation, information, scale of the residuals, and the points' weights, shape (n,)."""

def motion_between(before: _Pose, after: _Pose) -> Array:
    """Return the motion (v, omega) in the camera frame from one pose to another."""

def image_noise(image: GreyImage) -> float:
    """Return the standard deviation of an image's noise [grey levels]."""

# proximity.cpp

def proximity(
    direction: Array,
    pivot: Array,
    position_std: Array,
    direction_std: Array,
    center: Array,
    length: float,
    image_std: float,
    normal: float,
    rotation: Array,
    covariance: Array,
) -> tuple[float | None, float, Array, float, float, float, Array] | None:
    """Return how near a camera centre is to a singular one; None if something is not finite.

    Args:
        direction: Unit directions of n lines, shape (n, 3).
        pivot: The point of each that its errors are about, shape (n, 3) [m].
        position_std: Shape (n,) [m].
        direction_std: Shape (n,) [rad].
        center: Shape (3,) [m].
        length: That translations are divided by [m].
        image_std: Standard deviation of the normals of the interpretation planes [rad].
        normal: What the smallest over the largest singular value is divided by; nothing for 0, then the result is 0.
        rotation: Of T_world_camera, shape (3, 3).
        covariance: (angle, both, offset) of each image line, shape (n, 3), in place of image_std; (0, 3): not known.

    Returns:
        z (None without errors of the lines), distance [m], closest point (3,) [m], smallest over largest singular
        value over normal; standard deviations of position [m] and rotation [rad] along the least observable motion,
        and that motion (v, omega) (6,), v in metres for a length of one in units of length.

    Source: singularities.proximity.
    """

# pose_filter.cpp, pose_mixture.cpp and pose_filter_binding.cpp

class FilterMap:
    """The lines of a scene in the world with their tolerances, as the filter needs them."""

    count: int
    exact: bool

    def __init__(self, direction: Array, pivot: Array, position_std: Array, direction_std: Array) -> None:
        """Take unit directions (n, 3), a point of each (n, 3) [m], and how well both are known, (n,) [m], [rad]."""

class Innovation:
    """What an image of k lines says about a state, and what an update made of it.

    Attributes:
        good: Whether the update was finite and converged; if not, the state is as it was.
        squared: Squared Mahalanobis distance of the innovation of all used lines, where the update ended.
        of_line: The same of each line alone, against the state before, shape (k,).
        reversed: 1 if a line is seen against its direction, shape (k,).
        log_determinant: Of the covariance of the used lines' innovation.
        iterations: Of the update.
    """

    good: bool
    squared: float
    of_line: Array
    reversed: Array
    log_determinants: Array
    log_determinant: float
    iterations: int

    def removal(self) -> Array:
        """Return by how much `squared` would fall without each line; 0 if it was not used; shape (k,)."""

class Curvature:
    """How an image differs from a linear one.

    Attributes:
        nonlinearity: Of the misfit two standard deviations away in the direction of which it told least, as a share of
            what a linear image makes of it.
        by_pose: That direction, as a linear function of the error of the pose before the image, shape (6,).
    """

    nonlinearity: float
    by_pose: Array

class FitGates:
    """When a state and an image agree."""

    def __init__(self, of_line: float, by_count: list[float], reversal_cost: float) -> None:
        """Take gates for squared Mahalanobis distances.

        Args:
            of_line: Of each line.
            by_count: Of all lines, by how many are used.
            reversal_cost: Of a line that is seen against its direction, as -2 log of its probability.
        """

class Fit:
    """A state after an image with which it agrees.

    Attributes:
        state: The state.
        innovation: What the image said.
        used: Which lines were used.
        cost: -2 log likelihood of the image.
    """

    state: FilterState
    innovation: Innovation
    used: list[bool]
    cost: float

class FilterState:
    """A pose T_world_camera, and the drift of the twist: by what it differs for a while from the one given.

    Attributes:
        rotation: Shape (3, 3).
        position: Shape (3,) [m].
        drift: As predict is told, shape (6,).
        covariance: Of position and orientation as in geometry_msgs/PoseWithCovariance, shape (6, 6).
    """

    rotation: Array
    position: Array
    drift: Array
    covariance: Array

    def __init__(
        self, rotation: Array, position: Array, covariance: Array, drift_covariance: Array, map_lines: int
    ) -> None:
        """Begin with a pose and no drift.

        Args:
            rotation: Shape (3, 3).
            position: Shape (3,) [m].
            covariance: Of the pose, shape (6, 6).
            drift_covariance: Of the drift, shape (6, 6).
            map_lines: Count of the map's lines, or 0 for a map without errors.
        """

    @staticmethod
    def interact(
        states: list[FilterState],
        weights: list[float],
        arrivals: list[float],
        drift_std: list[float],
        negligible: float,
    ) -> tuple[list[FilterState], list[float]]:
        """Return states and weights of n kinds of robots after some may have become of another kind.

        Args:
            states: Of each kind.
            weights: Of each kind.
            arrivals: With what probability a robot of another kind becomes one of this.
            drift_std: Of each kind's drift, as nothing is known of it for a robot of another kind.
            negligible: What comes from a kind with less than this share changes nothing.
        """

    @staticmethod
    def mixture(states: list[FilterState], weights: list[float]) -> FilterState:
        """Return the one state with mean and covariance of a mixture, whose weights sum to 1."""

    def copy(self) -> FilterState:
        """Return a state that is the same."""

    def predict(
        self, twist: Array, noise: Array, drift_twist: Array, drift_std: float, duration: float, memory: float
    ) -> None:
        """Move on with a twist (v, omega) in the camera's frame, shape (6,).

        Args:
            twist: [m/s, rad/s].
            noise: Standard deviation of this step's own error of the twist, shape (6,).
            drift_twist: Times the drift, the lasting error of the twist, shape (6, 6).
            drift_std: Standard deviation of each number of the drift where nothing is known of it.
            duration: [s].
            memory: What is left of the drift at the end, in [0, 1].
        """

    def inflate(self, pose: Array) -> None:
        """Add to the covariance of the pose, shape (6, 6)."""

    def forget_drift(self, drift_std: float) -> None:
        """Know nothing of the drift any more, but the standard deviation of its numbers."""

    def part(self, by_pose: Array, offset: float, std: float) -> FilterState:
        """Return a part of this state: parts are a mixture that stands for it.

        Args:
            by_pose: A linear function of the error of the pose, shape (6,).
            offset: By how many of its standard deviations that is off from its mean in the part.
            std: To how many of them it is known there.
        """

    def curvature(
        self,
        before: FilterState,
        map_lines: FilterMap,
        rows: list[int],
        image: Array,
        covariances: Array,
        used: list[bool],
    ) -> Curvature:
        """Return where the image that led from a state before to this one told least, and how linear it is there."""

    def merging_cost(self, other: FilterState, own_weight: float, other_weight: float) -> float:
        """Return a bound of what is lost, as a divergence, when two parts of a mixture become one.

        Source: Runnalls (2007).
        """

    def fit(
        self,
        map_lines: FilterMap,
        rows: list[int],
        image: Array,
        covariances: Array,
        removable: int,
        gates: FitGates,
        iterations: int,
    ) -> Fit | None:
        """Return this after an image, without up to so many lines that do not agree; None if more do not.

        Args:
            map_lines, rows, image, covariances, iterations: As for update.
            removable: How many lines may be left out, the worst one first.
            gates: When it agrees.
        """

    def update(
        self, map_lines: FilterMap, rows: list[int], image: Array, covariances: Array, used: list[bool], iterations: int
    ) -> Innovation:
        """Use an image.

        Args:
            map_lines: The scene.
            rows: Of the k seen lines in it.
            image: Their l', shape (k, 3).
            covariances: As in LineObservation, shape (k, 3).
            used: Which of them are used, of length k.
            iterations: At most so many Gauss-Newton steps, each with the prior.

        Source: the iterated extended Kalman filter (Bell, Cathey 1993) on SO(3) x R^3, with the map's errors considered
        but not estimated (Schmidt 1966); docs/filter.md.
        """

# singularity.cpp

def scene_coordinates(
    direction: Array, foot: Array, concurrent: float, smallest: float
) -> tuple[Array, Array, Array] | None:
    """Return the scene frames of S scenes of n lines; None if one is not finite.

    Args:
        direction: Unit directions, shape (S, n, 3).
        foot: A point on each line, shape (S, n, 3) [m].
        concurrent: Share of the centre's distance to the origin up to which a mean distance is that of concurrent
            lines,
        smallest: and the same for centres near the origin [m].

    Returns:
        Centres, the points with the smallest sum of squared distances to the lines, shape (S, 3) [m], where parallel
        lines leave it free along them the one nearest to the mean of the feet; the mean distance of the lines to it,
        0 for concurrent lines, shape (S,) [m]; the point of each line closest to the centre, from there and in that
        unit, in metres for concurrent lines, shape (S, n, 3).
    """

def singularity_ratios(direction: Array, point: Array, centers: ComplexArray, on_line: float) -> tuple[Array, Array]:
    """Return the smallest over the largest singular value of the rank basis about k centres, and distances, (k,) each.

    As exact as rounding of the rank basis allows.

    Args:
        direction: Unit directions, shape (1, n, 3), or (k, n, 3) if each centre has lines of its own; n >= 3.
        point: A point on each line, of the same shape.
        centers: Camera centres, shape (k, 3).
        on_line: Distance up to which a centre is on a line, in the root mean square one.

    Returns:
        The ratios, 1 for a centre that is not finite or so far that products of lengths overflow; the distance of the
        nearest line, in the root mean square distance, infinite for those.
    """

# isolated_points.cpp

def isolated_points(
    direction: Array,
    point: Array,
    forms: Array,
    samples: Array,
    interpolate: Array,
    multiply: Array,
    on_line: float,
    merged: float,
    at_infinity: float,
) -> tuple[ComplexArray, ComplexArray, ComplexArray, Array, Array]:
    """Return the ten isolated singularities of each of S scenes of four lines, before Newton's method.

    Args:
        direction: Unit directions, shape (S, 4, 3).
        point: The point of each line closest to the scene's centre, scene coordinates, shape (S, 4, 3).
        forms: Two linear forms of the axis direction, numerator and denominator, shape (2, 3).
        samples: Axis directions at which quartics are evaluated, shape (15, 3).
        interpolate: From values there to coefficients, shape (15, 15).
        multiply: From the coefficients of a functional on quartics to its values at x, y and z times each of the ten
            cubic monomials, shape (3, 10, 15).
        on_line: As for singularity_ratios; a centre on a line has residual 1.
        merged: A residual over the distance of the nearest line above this counts as 1, too.
        at_infinity: |C_0| up to which a centre is at infinity.

    Returns:
        Centres, shape (S, 10, 3), NaN at infinity and where a direction leaves more than one; homogeneous centres
        (C_0, C) of unit length, shape (S, 10, 4), zero where there is more than one; axis directions, shape
        (S, 10, 3); singularity ratios of the centres, 1 where there is none, shape (S, 10); how far the five quartics
        are from being dependent, in [0, 1], shape (S,), NaN if not finite. The second of a pair of conjugates follows
        the first.

    Source: singularities/isolated_points.py.
    """

# rollout_binding.cpp

# A run is over within these of the target for so long [m], [rad], [s]; harm AWAY is farther from it than so many times
# the start's distance and so much more [m].
ARRIVED_DISTANCE: float
ARRIVED_ANGLE: float
ARRIVED_TIME: float
AWAY_FACTOR: float
AWAY_MARGIN: float

def roll_out(
    direction: Array,
    moment: Array,
    ends: Array,
    target: object,
    covariances: Array,
    residuals: Array | None,
    believed: object,
    loci: Array | None,
    path: Sequence[object],
    law: object,
    loop: object,
    state: object,
    rotations: Array,
    translations: Array,
    seed: int,
) -> dict[str, Any]:
    """Run the closed loop ahead once from each of k starts, without the interpreter's lock.

    Args:
        direction: Of n lines in the scene frame, shape (n, 3), n from 3 on.
        moment: Likewise, shape (n, 3) [m].
        ends: Of their segments, shape (2n, 3) [m].
        target: A Pose, T_world_target.
        covariances: Shape (3n,), or (0,): as RolloutTask.covariances.
        loci: Shape (m, 6): as RolloutTask.loci.
        path: Poses, T_world_camera.
        law: A RolloutLaw.
        loop: A LoopModel.
        state: A RunState.
        rotations: Of T_world_camera at the starts, shape (k, 3, 3).
        translations: Likewise, shape (k, 3) [m].
        seed: Of all noise.

    Returns:
        The fields of planning.rollout.Outcomes.
    """

def compute_rollout_twist(
    direction: Array,
    moment: Array,
    ends: Array,
    target: object,
    loci: Array | None,
    law: object,
    loop: object,
    camera: object,
    image: Array,
) -> Array:
    """Return the twist (6,) that a roll-out commands for image lines (n, 3), zeros where a line is not detected.

    With no rows: for what a camera, a Pose, sees without noise.
    """
