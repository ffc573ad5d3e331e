"""Where a camera that observes n lines loses a motion: the singular set, and how far away it is."""

from plsing_ros.singularities.batch import FourLineBatch, solve_four_line_scenes
from plsing_ros.singularities.cases import Case
from plsing_ros.singularities.certificate import Certificate
from plsing_ros.singularities.four_lines import IsolatedStatus
from plsing_ros.singularities.loci import DistanceArrays, Kind, LocusDistance
from plsing_ros.singularities.lost_motion import LostMotion, MotionKind, lost_motions
from plsing_ros.singularities.meshing import surface_triangles
from plsing_ros.singularities.nearest_transversal import NearestTransversal
from plsing_ros.singularities.singular_set import SingularSet, singular_set
from plsing_ros.singularities.surfaces import Surface
from plsing_ros.singularities.transversals import Transversal, TransversalFamily

__all__ = [
    "Case",
    "Certificate",
    "DistanceArrays",
    "FourLineBatch",
    "IsolatedStatus",
    "Kind",
    "LocusDistance",
    "LostMotion",
    "MotionKind",
    "NearestTransversal",
    "SingularSet",
    "Surface",
    "Transversal",
    "TransversalFamily",
    "lost_motions",
    "singular_set",
    "solve_four_line_scenes",
    "surface_triangles",
]
