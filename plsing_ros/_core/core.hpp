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
#include <new>
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
    using Base = Eigen::Map<const RowMajor<Scalar, Rows, Columns>>;
    using Base::Base;
};

// A numpy array (k, Rows, Columns): k matrices.
template <int Rows, int Columns, typename Scalar = double>
class Stack {
public:
    using Matrix = Eigen::Map<const RowMajor<Scalar, Rows, Columns>>;
    Stack(const Scalar *first, Index size, Index rows) : first_(first), size_(size), rows_(rows) {}
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
template <typename Scalar, std::size_t dimensions>
const PyArray_Proxy *checked_array(handle source, const int (&shape)[dimensions])
{
    const auto *array = array_proxy(source.ptr());
    bool good = npy_api::get().PyArray_Check_(source.ptr()) && array->nd == static_cast<int>(dimensions) &&
                check_flags(source.ptr(), npy_api::NPY_ARRAY_C_CONTIGUOUS_ | npy_api::NPY_ARRAY_ALIGNED_) &&
                npy_api::get().PyArray_EquivTypes_(array->descr, dtype::of<Scalar>().ptr());
    for (std::size_t i = 0; i < dimensions && good; i++)
        good = shape[i] < 0 || array->dimensions[i] == shape[i];
    if (good)
        return array;
    std::string expected;
    for (int size : shape)
        expected += (expected.empty() ? "" : ", ") + (size < 0 ? std::string("any") : std::to_string(size));
    std::string given = "no array but " + std::string(Py_TYPE(source.ptr())->tp_name);
    if (npy_api::get().PyArray_Check_(source.ptr())) {
        auto given_array = reinterpret_borrow<pybind11::array>(source);
        given = str(given_array.dtype()).cast<std::string>() + " " + str(given_array.attr("shape")).cast<std::string>();
    }
    throw value_error("an array must be C-contiguous, of type " +
                      str(handle(dtype::of<Scalar>())).cast<std::string>() + " and shape (" + expected +
                      "), given is " + given);
}

template <int Rows, int Columns, typename Scalar>
struct type_caster<plsing::View<Rows, Columns, Scalar>> {
    using Type = plsing::View<Rows, Columns, Scalar>;
    static constexpr auto name = const_name("numpy.ndarray");
    template <typename>
    using cast_op_type = const Type &;
    operator const Type &() { return value; }

    bool load(handle source, bool)
    {
        const PyArray_Proxy *array;
        if constexpr (Columns == 1)
            array = checked_array<Scalar>(source, {Rows});
        else
            array = checked_array<Scalar>(source, {Rows, Columns});
        // Eigen's way to let a map refer to something else.
        new (&value) Type(reinterpret_cast<const Scalar *>(array->data), array->dimensions[0],
                          Columns == 1 ? 1 : array->dimensions[1]);
        return true;
    }

private:
    Type value{nullptr, Rows < 0 ? 0 : Rows, Columns < 0 ? 0 : Columns};
};

template <int Rows, int Columns, typename Scalar>
struct type_caster<plsing::Stack<Rows, Columns, Scalar>> {
    using Type = plsing::Stack<Rows, Columns, Scalar>;
    static constexpr auto name = const_name("numpy.ndarray");
    template <typename>
    using cast_op_type = const Type &;
    operator const Type &() { return value; }

    bool load(handle source, bool)
    {
        const auto *array = checked_array<Scalar>(source, {-1, Rows, Columns});
        value = Type(reinterpret_cast<const Scalar *>(array->data), array->dimensions[0], array->dimensions[1]);
        return true;
    }

private:
    Type value{nullptr, 0, 0};
};

}  // namespace pybind11::detail
