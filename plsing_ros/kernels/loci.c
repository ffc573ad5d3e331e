/* Distances from a camera centre to the singular set, and the closest approach of a straight motion. */

#include "kernels.h"

#include <math.h>

PyObject *distances(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {5, 2, 0, {3, 3, -3, 3, 1}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    Py_ssize_t k = given.rows;
    const double *p = given.array[0], *u = given.array[1], *center = given.array[2];
    double *closest = given.array[3], *distance = given.array[4];
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
    release_arguments(&given);
    return PyBool_FromLong(good);
}

PyObject *approach(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {8, 1, 3, {3, 1, 3, 1, -9, -3, -6, -4}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    const double horizon = given.number[0], at_rest = given.number[1], along_share = given.number[2];
    Py_ssize_t k = given.rows;
    const double *closest = given.array[0], *distance = given.array[1], *u = given.array[2], *role = given.array[3];
    const double *center = given.array[5];
    double *found = given.array[7], velocity[3], nearest = INFINITY, least = INFINITY;
    times3(given.array[4], given.array[6], velocity);
    double speed = sqrt(dot3(velocity, velocity));
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
    release_arguments(&given);
    return PyLong_FromSsize_t(row);
}
