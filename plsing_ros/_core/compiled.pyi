"""What the native core computes: no checks of values but where it is said, and no units of its own.

Arrays are C-contiguous and float64 or complex128, and what comes back is new. An array of another type or shape raises
ValueError; None comes back for what has no answer. SI units, (v, omega) for twists, (direction, moment) for lines.
"""

from plsing_ros.arrays import Array

# features.cpp

def subtract(a: Array, b: Array) -> tuple[Array, float]:
    """Return a - b, shape (m,), and its norm: infinite only if an element is, or if the norm itself is too large."""

def interaction_matrix(direction: Array, moment: Array, min_depth: float) -> Array | None:
    """Return the interaction matrix of n lines in the camera frame, shape (3n, 6); None if one has no image.

    Source: features.interaction_matrix.
    """

def svd(matrix: Array) -> tuple[Array, Array, Array] | None:
    """Return the thin singular value decomposition (left (m, k), values (k,), right (k, k)) of a matrix (m, k).

    Values are the largest first, right singular vectors are rows. None if the matrix or a singular value is not finite,
    or m < k; k is 1 to 6.
    """

def interaction_svd(direction: Array, moment: Array, min_depth: float) -> tuple[Array, Array, Array] | None:
    """Return svd(interaction_matrix(...)); None where one of them is None."""

def solve(
    matrix: Array, right_side: Array, factor: float, threshold: float
) -> tuple[Array, Array, Array, Array] | None:
    """Return least squares by the singular value decomposition; None where svd is None.

    Args:
        matrix: Shape (m, k), k from 1 to 6, m >= k.
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
    desired: Array,
    min_depth: float,
    gain: float,
    threshold: float,
) -> tuple[Array, Array, float] | None:
    """Return the twist -gain pinv(L) (s - s*), the singular values of L and |s - s*|; None where solve would be.

    Args:
        direction: Of n lines in the camera frame, shape (n, 3), n from 2 on.
        moment: Likewise, shape (n, 3) [m].
        image: s, shape (3n,).
        desired: s*, shape (3n,).
        min_depth: As for interaction_matrix.
        gain: [1/s].
        threshold: As for solve.

    Source: eq. velocity_input.
    """

def mean_interaction(image: Array, desired_image: Array, interaction: Array, desired_interaction: Array) -> Array:
    """Return the mean of L and L* (3n, k), whose rows are turned to the image lines of L before.

    Args:
        image: s, shape (3n,).
        desired_image: s*, shape (3n,).
        interaction: L, or some columns of it, shape (3n, k).
        desired_interaction: L*, likewise.

    Source: docs/controller.md.
    """
