# SPDX-License-Identifier: Apache-2.0
"""Where a camera that observes n lines loses a motion: the singular set, and how far away it is."""

from plsing_ros.singularities.batch import FourLineBatch, solve_four_line_scenes
from plsing_ros.singularities.cases import Case
from plsing_ros.singularities.curves import Curve
from plsing_ros.singularities.four_lines import IsolatedStatus
from plsing_ros.singularities.loci import DistanceArrays, Kind, LocusDistance
from plsing_ros.singularities.locus import Locus
from plsing_ros.singularities.meshing import surface_triangles
from plsing_ros.singularities.nearest_transversal import NearestTransversal
from plsing_ros.singularities.proximity import Proximity
from plsing_ros.singularities.screw_curve import ScrewCurve
from plsing_ros.singularities.singular_centers import SingularSet
from plsing_ros.singularities.singular_set import singular_set
from plsing_ros.singularities.surfaces import Surface
from plsing_ros.singularities.transversals import Transversal, TransversalFamily
from plsing_ros.singularities.unobservable_motion import MotionKind, UnobservableMotion, unobservable_motions

__all__ = [
    "Case",
    "Curve",
    "DistanceArrays",
    "FourLineBatch",
    "IsolatedStatus",
    "Kind",
    "Locus",
    "LocusDistance",
    "MotionKind",
    "NearestTransversal",
    "Proximity",
    "ScrewCurve",
    "SingularSet",
    "Surface",
    "Transversal",
    "TransversalFamily",
    "UnobservableMotion",
    "singular_set",
    "solve_four_line_scenes",
    "surface_triangles",
    "unobservable_motions",
]
