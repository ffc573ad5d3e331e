"""Line features of the image: projection, interaction matrix, rank basis, conditioning."""

from plsing_ros.features.conditioning import Conditioning, conditioning, inverse_condition_number
from plsing_ros.features.factorisation import Factorisation, factorised, smallest_over_largest
from plsing_ros.features.interaction import interaction_factors, interaction_matrix
from plsing_ros.features.least_squares import Solution, difference, solved
from plsing_ros.features.observation import LineObservation, LinesVerdict
from plsing_ros.features.projection import degenerate_projections, image_depth, project_lines
from plsing_ros.features.rank_basis import rank_basis

__all__ = [
    "Conditioning",
    "Factorisation",
    "LineObservation",
    "LinesVerdict",
    "Solution",
    "conditioning",
    "degenerate_projections",
    "difference",
    "factorised",
    "image_depth",
    "interaction_factors",
    "interaction_matrix",
    "inverse_condition_number",
    "project_lines",
    "rank_basis",
    "smallest_over_largest",
    "solved",
]
