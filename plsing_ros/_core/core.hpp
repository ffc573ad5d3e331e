// SPDX-License-Identifier: Apache-2.0
// What the files of the native core share. Each file adds its functions to the module by one bind_... function.
#pragma once

#include <pybind11/pybind11.h>

namespace plsing {}  // namespace plsing
