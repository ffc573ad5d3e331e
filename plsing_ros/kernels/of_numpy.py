"""The same functions as in `compiled`, made of numpy."""

from plsing_ros.kernels.alignment import align, least_cosine
from plsing_ros.kernels.interaction import interaction_matrix, mean_interaction
from plsing_ros.kernels.least_squares import plain_law, solve, subtract
from plsing_ros.kernels.lines import are_image_lines, are_lines, have_images, is_rotation
from plsing_ros.kernels.loci import approach, distances
from plsing_ros.kernels.newton import bilinear_newton
from plsing_ros.kernels.preview import image_deviation, law_step, lines_seen
from plsing_ros.kernels.quartics import quartic_functionals
from plsing_ros.kernels.refinement import refine_poses
from plsing_ros.kernels.residuals import image_jacobians, image_residuals
from plsing_ros.kernels.scene_frame import scene_coordinates
from plsing_ros.kernels.search import search_poses
from plsing_ros.kernels.singular_values import interaction_svd, svd
from plsing_ros.kernels.singularity import singularity_ratios
from plsing_ros.kernels.ten_points import axis_centers, with_conjugates
from plsing_ros.kernels.triplets import translations, triplet_rotations
from plsing_ros.kernels.uncertainty import pose_uncertainty

__all__ = [
    "align",
    "approach",
    "are_image_lines",
    "are_lines",
    "axis_centers",
    "bilinear_newton",
    "distances",
    "have_images",
    "image_deviation",
    "image_jacobians",
    "image_residuals",
    "interaction_matrix",
    "interaction_svd",
    "is_rotation",
    "law_step",
    "least_cosine",
    "lines_seen",
    "mean_interaction",
    "plain_law",
    "pose_uncertainty",
    "quartic_functionals",
    "refine_poses",
    "scene_coordinates",
    "search_poses",
    "singularity_ratios",
    "solve",
    "subtract",
    "svd",
    "translations",
    "triplet_rotations",
    "with_conjugates",
]
