/* The module plsing_ros.kernels.compiled. */

#include "kernels.h"

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, "See the Python file of its topic."},
static PyMethodDef methods[] = {KERNELS(METHOD){NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {.m_base = PyModuleDef_HEAD_INIT, .m_name = "compiled", .m_methods = methods};

PyMODINIT_FUNC PyInit_compiled(void)
{
    return PyModule_Create(&module);
}
