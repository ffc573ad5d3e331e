/* Distances from a camera centre to the singular set, and the closest approach of a straight motion. */

#include "kernels.h"

#include <math.h>

PyObject *distances(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3, 3, -3, 3, 1};
    Py_buffer buffers[5];
    (void)self;
    if (!are_arguments(count, 5))
        return NULL;
    Py_ssize_t k = take_arrays(args, columns, 5, 2, buffers);
    if (k < 0)
        return NULL;
    const double *p = buffers[0].buf, *u = buffers[1].buf, *center = buffers[2].buf;
    double *closest = buffers[3].buf, *distance = buffers[4].buf;
    for (; k > 0; k--, p += 3, u += 3, closest += 3) {
        double offset[3], along;
        for (int i = 0; i < 3; i++)
            offset[i] = center[i] - p[i];
        along = dot3(offset, u);
        for (int i = 0; i < 3; i++) {
            closest[i] = p[i] + along * u[i];
            offset[i] = closest[i] - center[i];
        }
        *distance++ = sqrt(dot3(offset, offset));
    }
    int good = isfinite(center[0]) && isfinite(center[1]) && isfinite(center[2]);
    release_arrays(buffers, 5);
    return PyBool_FromLong(good);
}

PyObject *approach(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3, 1, 3, 1, -3, -3, -4};
    Py_buffer buffers[7];
    double horizon, at_rest, along_share;
    (void)self;
    if (!are_arguments(count, 10) || !take_number(args[7], &horizon) || !take_number(args[8], &at_rest) ||
        !take_number(args[9], &along_share))
        return NULL;
    Py_ssize_t k = take_arrays(args, columns, 7, 1, buffers);
    if (k < 0)
        return NULL;
    const double *closest = buffers[0].buf, *distance = buffers[1].buf, *u = buffers[2].buf, *role = buffers[3].buf;
    const double *center = buffers[4].buf, *velocity = buffers[5].buf;
    double *found = buffers[6].buf, speed = sqrt(dot3(velocity, velocity)), nearest = INFINITY, least = INFINITY;
    Py_ssize_t row = -1;
    found[0] = found[1] = found[2] = found[3] = NAN;
    for (Py_ssize_t i = 0; i < k && speed >= at_rest; i++) {
        const double *at = closest + 3 * i;
        double offset[3] = {at[0] - center[0], at[1] - center[1], at[2] - center[2]};
        double closing = dot3(offset, velocity), along = dot3(u + 3 * i, velocity);
        double rate = closing / fmax(distance[i], 1e-300);
        double square = role[i] == 1.0 ? rate * rate : speed * speed - along * along;
        int across = square > along_share * speed * along_share * speed;
        double time = across ? closing / square : NAN, rest = distance[i] * distance[i] - time * closing;
        if (role[i] < 0.0)
            continue;
        if (distance[i] < nearest) {
            nearest = distance[i];
            found[0] = time;
            found[1] = across ? rate / speed : NAN;
        }
        if (time > 0.0 && time <= horizon && rest < least) {
            least = rest;
            found[2] = time;
            found[3] = sqrt(fmax(rest, 0.0));
            row = i;
        }
    }
    release_arrays(buffers, 7);
    return PyLong_FromSsize_t(row);
}
