// SPDX-License-Identifier: Apache-2.0
#include "core.hpp"

PYBIND11_MODULE(compiled, module)
{
    module.doc() = "Inner loops of every cycle; plsing_ros/_core says what is in which file.";
}
