/* The module plsing_ros.kernels.compiled. */

#include "kernels.h"

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, "See the Python file of its topic."}
static PyMethodDef methods[] = {
    METHOD(align),
    METHOD(approach),
    METHOD(are_image_lines),
    METHOD(are_lines),
    METHOD(axis_centers),
    METHOD(bilinear_newton),
    METHOD(distances),
    METHOD(have_images),
    METHOD(image_deviation),
    METHOD(image_jacobians),
    METHOD(image_residuals),
    METHOD(interaction_matrix),
    METHOD(is_rotation),
    METHOD(law_step),
    METHOD(least_cosine),
    METHOD(lines_seen),
    METHOD(mean_interaction),
    METHOD(plain_law),
    METHOD(pose_uncertainty),
    METHOD(quartic_functionals),
    METHOD(refine_poses),
    METHOD(scene_coordinates),
    METHOD(search_poses),
    METHOD(singularity_ratios),
    METHOD(solve),
    METHOD(subtract),
    METHOD(svd),
    METHOD(translations),
    METHOD(triplet_rotations),
    METHOD(with_conjugates),
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {.m_base = PyModuleDef_HEAD_INIT, .m_name = "compiled", .m_methods = methods};

PyMODINIT_FUNC PyInit_compiled(void)
{
    return PyModule_Create(&module);
}
