# SPDX-License-Identifier: Apache-2.0
"""Line features of the image: projection, interaction matrix, rank basis, conditioning."""

from plsing_ros.features.conditioning import Conditioning, conditioning, inverse_condition_number
from plsing_ros.features.decomposition import Decomposition, decompose, smallest_over_largest
from plsing_ros.features.interaction import interaction_conditioning, interaction_matrix
from plsing_ros.features.least_squares import LeastSquaresSolution, feature_error, solve_least_squares
from plsing_ros.features.observation import LineObservation, LinesVerdict, checked_observation, project
from plsing_ros.features.projection import degenerate_projections, image_depth, project_lines
from plsing_ros.features.rank_basis import rank_basis

__all__ = [
    "Conditioning",
    "Decomposition",
    "LeastSquaresSolution",
    "LineObservation",
    "LinesVerdict",
    "checked_observation",
    "conditioning",
    "decompose",
    "degenerate_projections",
    "feature_error",
    "image_depth",
    "interaction_conditioning",
    "interaction_matrix",
    "inverse_condition_number",
    "project",
    "project_lines",
    "rank_basis",
    "smallest_over_largest",
    "solve_least_squares",
]
