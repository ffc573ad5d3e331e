"""The inner loops of every cycle: compiled where the package was built with a C compiler, else made of numpy.

Both give the same numbers to rounding, but for what is not unique: signs of singular vectors, and bases of spaces.
They fill arrays that the caller has made, C-contiguous, float64 or complex128. The compiled ones check lengths and
types, those of numpy nothing, and neither checks values but where that is said; use them through what the package makes
of them (LineSet, factorised, solved, align_lines, singular_set, SingularSet, PoseEstimator ...). The Python files say
what they do, a topic each.
"""

from plsing_ros.kernels.of_numpy import __all__ as __all__

try:
    from plsing_ros.kernels.compiled import *  # noqa: F403, the same names as those of of_numpy
except ImportError:
    from plsing_ros.kernels.of_numpy import *  # noqa: F403
