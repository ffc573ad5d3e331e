/* From first estimates of a camera pose to the few refined ones that explain an image. */

#include "kernels.h"

#include <math.h>
#include <string.h>

/* Refined first estimates, and how many of the best are looked at to find ones that differ. */
#define MOST 6
#define MOST_COMPARED 24
/* First estimates that differ by a rotation of less than 0.03 rad are taken for the same one with different noise. */
#define SAME_TRACE 2.9991000674979751
/* Costs are in squared standard deviations; kernels/search.py says what these are for. */
#define FAR 1e4
#define OPTIMISM 3.0
#define IMPLAUSIBLE 30.0
#define EQUAL 1e-3
#define STAGES 3
/* Of a pose found: rotation, translation, cost, which first estimate it comes from. */
#define FOUND_COLUMNS 14
static const struct {
    long iterations;
    double far;
} stages[STAGES] = {{3, FAR}, {8, 1e3}, {40, 1e3}};

struct candidate {
    double rotation[9], translation[3], cost, gain;
    Py_ssize_t start;
    int final;
};

/* -2 log of the likelihood of the image at a pose. */
static double cost_at(const struct image *image, const double *costs, const double *rotation, const double *translation)
{
    double sum = 0.0;
    residuals_at(image, rotation, translation, image->room);
    for (Py_ssize_t i = 0; i < image->count; i++) {
        const struct residual *line = image->room + i;
        double value[2];
        whiten(line->whitening, line->raw, value);
        sum += value[0] * value[0] + value[1] * value[1] + log(line->determinant) + costs[0] * line->hidden +
               costs[1] * line->reversed;
    }
    return isfinite(sum) ? sum : INFINITY;
}

/* Fill up to MOST of the cheapest poses whose rotations differ, cheapest first, and return how many. */
static int choose(const double *cost, const double *rotation, Py_ssize_t k, Py_ssize_t *chosen)
{
    Py_ssize_t order[MOST_COMPARED];
    int compared = 0, count = 0;
    for (Py_ssize_t i = 0; i < k; i++) {
        int place = compared < MOST_COMPARED ? compared++ : MOST_COMPARED;
        for (; place > 0 && cost[i] < cost[order[place - 1]]; place--)
            if (place < MOST_COMPARED)
                order[place] = order[place - 1];
        if (place < MOST_COMPARED)
            order[place] = i;
    }
    for (int i = 0; i < compared && count < MOST; i++) {
        int differs = 1;
        for (int j = 0; j < count && differs; j++) {
            double trace = 0.0;
            for (int e = 0; e < 9; e++)
                trace += rotation[9 * order[i] + e] * rotation[9 * chosen[j] + e];
            differs = !(trace > SAME_TRACE);
        }
        if (differs)
            chosen[count++] = order[i];
    }
    return count;
}

/* Whether two poses are the same to what refinement leaves. */
static int are_same(const struct candidate *first, const struct candidate *second)
{
    double largest = 0.0, difference = 0.0;
    for (int e = 0; e < 9; e++)
        if (!(fabs(first->rotation[e] - second->rotation[e]) < EQUAL))
            return 0;
    for (int i = 0; i < 3; i++) {
        double center[2] = {0.0, 0.0};
        for (int j = 0; j < 3; j++) {
            center[0] -= first->rotation[3 * j + i] * first->translation[j];
            center[1] -= second->rotation[3 * j + i] * second->translation[j];
        }
        largest = fmax(largest, fabs(center[0]));
        difference = fmax(difference, fabs(center[0] - center[1]));
    }
    return difference < EQUAL * (1.0 + largest);
}

/* Refine all candidates in stages, dropping those that cannot catch up any more; return how many are left. */
static int refine_all(const struct image *image, const double *costs, struct candidate *all, int count)
{
    for (int stage = 0; stage < STAGES; stage++) {
        double least = INFINITY;
        int kept = 0, done = 1;
        for (int i = 0; i < count; i++) {
            struct candidate *each = all + i;
            if (!each->final)
                each->final = refine(image, NULL, stages[stage].iterations, each->rotation, each->translation,
                                     &each->gain);
            each->cost = cost_at(image, costs, each->rotation, each->translation);
            least = fmin(least, each->cost);
        }
        for (int i = 0; i < count; i++) {
            /* What is still to be gained is less certain the more it is. */
            double promised = all[i].cost - (all[i].final ? 0.0 : OPTIMISM * all[i].gain);
            if (promised <= least + IMPLAUSIBLE && all[i].cost <= least + stages[stage].far) {
                done = done && all[i].final;
                all[kept++] = all[i];
            }
        }
        count = kept;
        if (done)
            break;
    }
    return count;
}

/* Bring candidates into order, best first, and leave out those that are the same; return how many are left.
 *
 * Costs that are the same but for rounding leave candidates in the order of their first estimates. */
static int sort(struct candidate *all, int count)
{
    int kept = 0;
    for (int i = 0; i < count; i++) {
        struct candidate each = all[i];
        int place = kept;
        if (!isfinite(each.cost))
            continue;
        for (; place > 0 && nearbyint(1e3 * each.cost) < nearbyint(1e3 * all[place - 1].cost); place--)
            all[place] = all[place - 1];
        all[place] = each;
        kept++;
    }
    count = kept;
    kept = 0;
    for (int i = 0; i < count; i++) {
        int differs = 1;
        for (int j = 0; j < kept && differs; j++)
            differs = !are_same(all + j, all + i);
        if (differs)
            all[kept++] = all[i];
    }
    return kept;
}

static int search(const struct image *image, const double *costs, const double *rotation, const double *translation,
                  Py_ssize_t k, double *cost, double *found)
{
    Py_ssize_t chosen[MOST];
    struct candidate all[MOST];
    int count = 0;
    for (Py_ssize_t i = 0; i < k; i++)
        cost[i] = cost_at(image, costs, rotation + 9 * i, translation + 3 * i);
    int different = choose(cost, rotation, k, chosen);
    for (int i = 0; i < different; i++)
        if (cost[chosen[i]] <= cost[chosen[0]] + FAR) {
            struct candidate *each = all + count++;
            memcpy(each->rotation, rotation + 9 * chosen[i], sizeof each->rotation);
            memcpy(each->translation, translation + 3 * chosen[i], sizeof each->translation);
            each->start = chosen[i];
            each->final = 0;
        }
    count = sort(all, refine_all(image, costs, all, count));
    for (int i = 0; i < count; i++, found += FOUND_COLUMNS) {
        memcpy(found, all[i].rotation, sizeof all[i].rotation);
        memcpy(found + 9, all[i].translation, sizeof all[i].translation);
        found[12] = all[i].cost;
        found[13] = all[i].start;
    }
    return count;
}

PyObject *search_poses(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct image image;
    (void)self;
    const int n = are_arguments(count, 7) ? count_lines(args[1]) : -1;
    const struct signature expected = {7, 1, 0, {IMAGE(n), 9, 3, -2, -FOUND_COLUMNS * MOST}};
    if (n < 0 || !take_image(args, count, &expected, &image))
        return NULL;
    void *const *array = image.given.array;
    double *cost = PyMem_RawMalloc((image.given.rows + 1) * sizeof *cost);
    int found = cost ? search(&image, array[5], array[3], array[4], image.given.rows, cost, array[6]) : -1;
    PyMem_RawFree(cost);
    release_image(&image);
    return found < 0 ? PyErr_NoMemory() : PyLong_FromLong(found);
}
