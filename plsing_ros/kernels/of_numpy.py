"""The same functions as in `compiled`, made of numpy."""

from plsing_ros.kernels.interaction import interaction_matrix, mean_interaction
from plsing_ros.kernels.least_squares import plain_law, solve, subtract
from plsing_ros.kernels.lines import are_image_lines, are_lines, have_images, is_rotation
from plsing_ros.kernels.singular_values import svd

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
