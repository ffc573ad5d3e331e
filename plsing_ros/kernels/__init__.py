"""The inner loops of every cycle: compiled where the package was built with a C compiler, else made of numpy.

Both give the same numbers to rounding. They fill arrays that the caller has made, C-contiguous and float64, and check
nothing of them but what they say; use them through LineSet, interaction_matrix, factorised and solved. The Python files
say what they do, a topic each.
"""

try:
    from plsing_ros.kernels.compiled import (
        are_image_lines,
        are_lines,
        have_images,
        interaction_matrix,
        is_rotation,
        mean_interaction,
        plain_law,
        solve,
        subtract,
        svd,
    )
except ImportError:
    from plsing_ros.kernels.of_numpy import (
        are_image_lines,
        are_lines,
        have_images,
        interaction_matrix,
        is_rotation,
        mean_interaction,
        plain_law,
        solve,
        subtract,
        svd,
    )

__all__ = [
    "are_image_lines",
    "are_lines",
    "have_images",
    "interaction_matrix",
    "is_rotation",
    "mean_interaction",
    "plain_law",
    "solve",
    "subtract",
    "svd",
]
