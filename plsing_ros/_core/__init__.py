# SPDX-License-Identifier: Apache-2.0
"""The native core: inner loops in C++17 with Eigen, bound by pybind11. Each file of the folder is one topic.

compiled.pyi says what each function does. core.hpp has the views of numpy arrays, least_squares.hpp the decomposition,
jacobi.hpp its rotations, lines.hpp lines and poses, tracking.hpp what the line tracker's files share; each other file
adds its functions in its bind_... function, which module.cpp calls.
"""

from plsing_ros._core.compiled import *  # noqa: F403
