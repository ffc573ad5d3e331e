// SPDX-License-Identifier: Apache-2.0
// What the files of the native core share: numpy arrays in, numpy arrays out. Each file of functions adds its own to
// the module in one bind_... function, which module.cpp calls.
//
// Views have the shapes that Python sees: a row for each line or pose. They are read where numpy keeps them, so an
// array must be C-contiguous and of the very type; another one is refused with a sentence, before it is touched.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <complex>
#include <optional>
#include <stdexcept>
#include <string>

namespace plsing {

namespace py = pybind11;
using Eigen::Dynamic;
using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Complex = std::complex<double>;

template <typename Scalar, int Rows, int Columns>
using RowMajor = Eigen::Matrix<Scalar, Rows, Columns, Columns == 1 ? Eigen::ColMajor : Eigen::RowMajor>;

// A numpy array (Rows, Columns), or (Rows,) for one column; Dynamic stands for any number.
template <int Rows, int Columns = 1, typename Scalar = double>
class View : public Eigen::Map<const RowMajor<Scalar, Rows, Columns>> {
public:
    using Number = Scalar;
    static constexpr int dimensions = Columns == 1 ? 1 : 2, shape[] = {Rows, Columns};
    View(const Scalar *first, const Index *size)
        : Eigen::Map<const RowMajor<Scalar, Rows, Columns>>(first, size[0], Columns == 1 ? 1 : size[1])
    {
    }
};

// A numpy array (k, Rows, Columns): k matrices.
template <int Rows, int Columns, typename Scalar = double>
class Stack {
public:
    using Number = Scalar;
    using Matrix = Eigen::Map<const RowMajor<Scalar, Rows, Columns>>;
    static constexpr int dimensions = 3, shape[] = {Dynamic, Rows, Columns};
    Stack(const Scalar *first, const Index *size) : first_(first), size_(size[0]), rows_(size[1]) {}
    Index size() const { return size_; }
    Index rows() const { return rows_; }
    Matrix operator[](Index i) const { return Matrix(first_ + i * rows_ * Columns, rows_, Columns); }

private:
    const Scalar *first_;
    Index size_, rows_;
};

// n vectors of three: points, directions, moments, or image lines.
using Vectors = View<Dynamic, 3>;
using Values = View<Dynamic>;

// Raise ValueError unless `good`.
inline void require(bool good, const char *message)
{
    if (!good)
        throw std::invalid_argument(message);
}

// Return a copy as a numpy array, of one dimension for a vector.
template <typename Derived>
py::array_t<typename Derived::Scalar> array_of(const Eigen::MatrixBase<Derived> &matrix)
{
    using Scalar = typename Derived::Scalar;
    if constexpr (Derived::IsVectorAtCompileTime) {
        py::array_t<Scalar> array(matrix.size());
        Eigen::Map<Eigen::Matrix<Scalar, Dynamic, 1>>(array.mutable_data(), matrix.size()) = matrix;
        return array;
    } else {
        py::array_t<Scalar> array({matrix.rows(), matrix.cols()});
        Eigen::Map<RowMajor<Scalar, Dynamic, Dynamic>>(array.mutable_data(), matrix.rows(), matrix.cols()) = matrix;
        return array;
    }
}

}  // namespace plsing

namespace pybind11::detail {

// Return the array behind an argument, or raise what is wrong with it; -1 in `shape` stands for any size.
template <typename Scalar>
const PyArray_Proxy *checked_array(handle source, const int *shape, int dimensions)
{
    const auto *array = array_proxy(source.ptr());
    bool good = npy_api::get().PyArray_Check_(source.ptr()) && array->nd == dimensions &&
                check_flags(source.ptr(), npy_api::NPY_ARRAY_C_CONTIGUOUS_ | npy_api::NPY_ARRAY_ALIGNED_) &&
                npy_api::get().PyArray_EquivTypes_(array->descr, dtype::of<Scalar>().ptr());
    for (int i = 0; i < dimensions && good; i++)
        good = shape[i] < 0 || array->dimensions[i] == shape[i];
    if (good)
        return array;
    std::string expected;
    for (int i = 0; i < dimensions; i++)
        expected += (i == 0 ? "" : ", ") + (shape[i] < 0 ? std::string("any") : std::to_string(shape[i]));
    std::string given = "no array but " + std::string(Py_TYPE(source.ptr())->tp_name);
    if (npy_api::get().PyArray_Check_(source.ptr())) {
        auto given_array = reinterpret_borrow<pybind11::array>(source);
        given = str(given_array.dtype()).cast<std::string>() + " " + str(given_array.attr("shape")).cast<std::string>();
    }
    throw value_error("an array must be C-contiguous, of type " +
                      str(handle(dtype::of<Scalar>())).cast<std::string>() + " and shape (" + expected +
                      "), given is " + given);
}

template <typename Type>
struct strict_caster {
    static constexpr auto name = const_name("numpy.ndarray");
    template <typename>
    using cast_op_type = const Type &;
    operator const Type &() { return *value; }

    bool load(handle source, bool)
    {
        using Number = typename Type::Number;
        const PyArray_Proxy *array = checked_array<Number>(source, Type::shape, Type::dimensions);
        value.emplace(reinterpret_cast<const Number *>(array->data), array->dimensions);
        return true;
    }

private:
    std::optional<Type> value;
};

template <int Rows, int Columns, typename Scalar>
struct type_caster<plsing::View<Rows, Columns, Scalar>> : strict_caster<plsing::View<Rows, Columns, Scalar>> {};

template <int Rows, int Columns, typename Scalar>
struct type_caster<plsing::Stack<Rows, Columns, Scalar>> : strict_caster<plsing::Stack<Rows, Columns, Scalar>> {};

}  // namespace pybind11::detail
