"""The inner loops of every cycle: compiled where the package was built with a C compiler, else made of numpy.

Both give the same numbers to rounding. They fill arrays that the caller has made, C-contiguous and float64, and check
nothing of them but what they say; use them through LineSet, interaction_matrix, factorised, solved and PoseEstimator.
The Python files say what they do, a topic each.
"""

try:
    from plsing_ros.kernels.compiled import (
        are_image_lines,
        are_lines,
        have_images,
        image_jacobians,
        image_residuals,
        interaction_matrix,
        is_rotation,
        mean_interaction,
        plain_law,
        pose_uncertainty,
        refine_poses,
        search_poses,
        solve,
        subtract,
        svd,
        translations,
        triplet_rotations,
    )
except ImportError:
    from plsing_ros.kernels.of_numpy import (
        are_image_lines,
        are_lines,
        have_images,
        image_jacobians,
        image_residuals,
        interaction_matrix,
        is_rotation,
        mean_interaction,
        plain_law,
        pose_uncertainty,
        refine_poses,
        search_poses,
        solve,
        subtract,
        svd,
        translations,
        triplet_rotations,
    )

__all__ = [
    "are_image_lines",
    "are_lines",
    "have_images",
    "image_jacobians",
    "image_residuals",
    "interaction_matrix",
    "is_rotation",
    "mean_interaction",
    "plain_law",
    "pose_uncertainty",
    "refine_poses",
    "search_poses",
    "solve",
    "subtract",
    "svd",
    "translations",
    "triplet_rotations",
]
