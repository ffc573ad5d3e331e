// SPDX-License-Identifier: Apache-2.0
// Arrays that nobody can write to, which arrays.py takes without a copy.
#pragma once

#include "core.hpp"

namespace plsing {

template <typename Scalar>
py::array_t<Scalar> locked(py::array_t<Scalar> array)
{
    py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
    return array;
}

}  // namespace plsing
