"""The native core: inner loops in C++17 with Eigen, bound by pybind11. Each file of the folder is one topic."""
