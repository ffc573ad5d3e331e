// SPDX-License-Identifier: Apache-2.0
// The interaction matrix, and the motion that makes up for a difference of features best: what a control cycle is.
#include <cmath>

#include "core.hpp"
#include "least_squares.hpp"
#include "lines.hpp"

namespace plsing {
namespace {

double norm_of(const Eigen::Ref<const Eigen::VectorXd> &vector)
{
    const double norm = vector.norm();
    return norm > 1e-140 && norm < 1e140 ? norm : vector.stableNorm();
}

py::tuple subtract(const Values &a, const Values &b)
{
    require(a.size() == b.size(), "the vectors must be as long as each other");
    const Eigen::VectorXd difference = a - b;
    return py::make_tuple(array_of(difference), norm_of(difference));
}

py::object interaction_matrix(const Vectors &direction, const Vectors &moment, double min_depth)
{
    Tall rows;
    if (!fill_rows(direction, moment, min_depth, rows))
        return py::none();
    return array_of(expand(moment, rows));
}

void require_few_columns(const View<Dynamic, Dynamic> &matrix)
{
    require(matrix.cols() >= 1 && matrix.cols() <= max_unknowns, "a matrix must have 1 to 6 columns");
}

py::object svd(const View<Dynamic, Dynamic> &matrix)
{
    require_few_columns(matrix);
    const Svd decomposed{Tall(matrix)};
    if (!decomposed.is_finite())
        return py::none();
    return py::make_tuple(array_of(decomposed.left()), array_of(decomposed.values()),
                          array_of(decomposed.right().transpose()));
}

py::object interaction_conditioning(const Vectors &direction, const Vectors &moment, double min_depth)
{
    Tall rows;
    if (!fill_rows(direction, moment, min_depth, rows))
        return py::none();
    const Svd decomposed(rows, false);
    if (!decomposed.is_finite())
        return py::none();
    return py::make_tuple(array_of(decomposed.values()), array_of(decomposed.right().transpose()));
}

py::object solve(const View<Dynamic, Dynamic> &matrix, const Values &right_side, double factor, double threshold)
{
    require_few_columns(matrix);
    require(right_side.size() == matrix.rows(), "the right side must be as long as the matrix");
    const Svd decomposed{Tall(matrix)};
    if (!decomposed.is_finite())
        return py::none();
    const Unknowns components = factor * decomposed.components(right_side);
    return py::make_tuple(array_of(decomposed.values()), array_of(decomposed.right().transpose()),
                          array_of(components), array_of(decomposed.solve(components, threshold)));
}

py::object compute_twist(const Vectors &direction, const Vectors &moment, const Values &image, const Values &target_image,
                         double min_depth, double gain, double threshold)
{
    const Index n = direction.rows();
    require(moment.rows() == n && image.size() == 3 * n && target_image.size() == 3 * n, "there must be n lines in each");
    Tall rows;
    if (!fill_rows(direction, moment, min_depth, rows))
        return py::none();
    const Eigen::VectorXd error = image - target_image;
    const Svd decomposed(rows);
    if (!decomposed.is_finite())
        return py::none();
    const Unknowns twist = decomposed.solve(-gain * decomposed.components(reduce(moment, error)), threshold);
    return py::make_tuple(array_of(twist), norm_of(twist), array_of(decomposed.values()), norm_of(error));
}

}  // namespace

void bind_features(py::module_ &module)
{
    module.def("subtract", &subtract);
    module.def("interaction_matrix", &interaction_matrix);
    module.def("svd", &svd);
    module.def("interaction_conditioning", &interaction_conditioning);
    module.def("solve", &solve);
    module.def("compute_twist", &compute_twist);
}

}  // namespace plsing
