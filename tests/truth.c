/* The ground truth itself, against dense sampling and hand-made cases. */
#include "truth.h"

#include <stdlib.h>

#include "test.h"
#include "zoo.h"

/* Height in double, written out a second time. */
static double plain_height(const struct truth_map *map, double u, double v)
{
    double x = u * map->width - 0.5, y = v * map->height - 0.5, sum = 0.0;
    int i = (int)floor(x), j = (int)floor(y), di, dj;
    for (dj = 0; dj < 2; ++dj) {
        for (di = 0; di < 2; ++di) {
            int p = i + di, q = j + dj;
            double wx = di ? x - i : 1.0 - (x - i), wy = dj ? y - j : 1.0 - (y - j);
            if (map->wrap_u == 1) p = ((p % map->width) + map->width) % map->width;
            if (map->wrap_v == 1) q = ((q % map->height) + map->height) % map->height;
            p = p < 0 ? 0 : p > map->width - 1 ? map->width - 1 : p;
            q = q < 0 ? 0 : q > map->height - 1 ? map->height - 1 : q;
            sum += wx * wy * (double)map->heights[q * map->width + p];
        }
    }
    return sum;
}

static int on_surface(const struct truth_map *map, double u, double v)
{
    double lu = map->wrap_u == 2 && map->width > 1 ? 0.5 / map->width : 0.0;
    double lv = map->wrap_v == 2 && map->height > 1 ? 0.5 / map->height : 0.0;
    return (map->wrap_u == 1 || (u >= lu && u <= 1.0 - lu)) &&
           (map->wrap_v == 1 || (v >= lv && v <= 1.0 - lv));
}

static void dense_marching(void)
{
    struct zoo_random random = zoo_seed(11);
    static const int sizes[][2] = {{1, 1}, {1, 7}, {2, 2}, {3, 5}, {17, 17}};
    int round, hits = 0;
    for (round = 0; round < 1500; ++round) {
        float heights[17 * 17];
        struct truth_map map;
        double origin[3], direction[3], t = 0.0, previous = 0.0, least = HUGE_VAL, clearance, low, high;
        int size = zoo_below(&random, 5), kind = zoo_below(&random, ZOO_KINDS), k, found = 0, hit;
        map.width = sizes[size][0];
        map.height = sizes[size][1];
        map.wrap_u = zoo_below(&random, 3);
        map.wrap_v = zoo_below(&random, 3);
        map.heights = heights;
        zoo_fill(kind, map.width, map.height, 5, heights);
        for (k = 0; k < 3; ++k) {
            origin[k] = (double)zoo_between(&random, -0.5f, 1.5f);
            direction[k] = (double)zoo_unit(&random) - origin[k];
        }
        hit = truth_trace(&map, origin, direction, 2.0, &t);
        clearance = truth_clearance(&map, origin, direction, 0.0, 2.0);
        for (k = 0; k <= 4000; ++k) {
            double at = k * (2.0 / 4000.0), u = origin[0] + at * direction[0],
                   v = origin[1] + at * direction[1];
            double above;
            if (!on_surface(&map, u, v)) continue;
            above = origin[2] + at * direction[2] - plain_height(&map, u, v);
            if (above < least) least = above;
            if (above <= 0.0 && !found && origin[2] + at * direction[2] >= 0.0) {
                found = 1;
                previous = at;
            }
        }
        hits += hit;
        CHECK(clearance <= least + 1e-9 && clearance >= least - 0.06, "round %d: clearance %g, marched %g",
              round, clearance, least);
        low = 0.0; /* what is under the floor does not count */
        high = 2.0;
        truth_above_floor(origin, direction, &low, &high);
        clearance = truth_clearance(&map, origin, direction, low, high);
        CHECK(hit == (clearance <= 0.0) || fabs(clearance) < 2e-9, "round %d: hit %d, clearance %g", round,
              hit, clearance);
        if (found && CHECK(hit, "round %d: a marched hit at %g is missed", round, previous)) {
            CHECK(t <= previous + 1e-9, "round %d: hit %g after the marched %g", round, t, previous);
        }
        if (hit) {
            double u = origin[0] + t * direction[0], v = origin[1] + t * direction[1];
            double above = origin[2] + t * direction[2] - truth_height(&map, u, v);
            double above_floor = origin[2] < 0.0 ? -origin[2] / direction[2] : 0.0;
            double before = truth_clearance(&map, origin, direction, above_floor, t - 1e-8);
            CHECK(above <= 1e-9, "round %d: the hit is %g above the surface", round, above);
            CHECK(before >= -1e-9, "round %d: %g below the surface before the hit", round, before);
        }
    }
    CHECK(hits > 300 && hits < 1400, "%d hits of 1500", hits);
}

static void by_hand(void)
{
    static const float ramp[2] = {0.0f, 1.0f}, peak[3] = {0.0f, 1.0f, 0.0f};
    struct truth_map map = {2, 1, 0, 0, NULL}, three = {3, 1, 0, 0, NULL};
    double origin[3] = {0.5, 0.5, 2.0}, direction[3] = {0.0, 0.0, -1.0}, t = -1.0;
    map.heights = ramp;
    three.heights = peak;

    CHECK(truth_trace(&map, origin, direction, HUGE_VAL, &t) && fabs(t - 1.5) < 1e-12, "vertical: %g", t);
    CHECK(!truth_trace(&map, origin, direction, 1.4, &t), "vertical, ends before");
    direction[2] = 1.0;
    CHECK(!truth_trace(&map, origin, direction, HUGE_VAL, &t), "upward from above");
    origin[2] = -3.0;
    CHECK(truth_trace(&map, origin, direction, HUGE_VAL, &t) && fabs(t - 3.0) < 1e-8, "upward from below: %g",
          t);
    origin[2] = 0.5;
    CHECK(truth_trace(&map, origin, direction, HUGE_VAL, &t) && t == 0.0, "upward from the surface");
    origin[0] = -1.0;
    origin[2] = 0.25;
    direction[0] = 1.0;
    direction[2] = 0.0;
    CHECK(truth_trace(&map, origin, direction, HUGE_VAL, &t) && fabs(t - 1.375) < 1e-12, "horizontal: %g", t);
    origin[2] = 0.0;
    CHECK(truth_trace(&map, origin, direction, HUGE_VAL, &t) && fabs(t - 1.0) < 1e-12, "at height 0: %g", t);
    map.wrap_u = 2;
    CHECK(truth_trace(&map, origin, direction, HUGE_VAL, &t) && fabs(t - 1.25) < 1e-12, "nothing: %g", t);
    origin[0] = 3.0;
    direction[0] = -1e-20;
    CHECK(truth_trace(&map, origin, direction, HUGE_VAL, &t) && fabs(t * 1e-20 - 2.25) < 1e-12,
          "from the high side: %g", t);
    map.wrap_u = 1;
    origin[2] = 0.999;
    direction[0] = 1e20;
    CHECK(truth_trace(&map, origin, direction, HUGE_VAL, &t) && t > 0.0 && t * 1e20 < 1.0, "wrap: %g", t);

    origin[0] = 0.0;
    origin[2] = 0.5;
    direction[0] = 1.0;
    direction[2] = 0.25;
    CHECK(fabs(truth_clearance(&three, origin, direction, 0.0, HUGE_VAL) - -0.375) < 1e-12, "clearance %g",
          truth_clearance(&three, origin, direction, 0.0, HUGE_VAL));
    CHECK(truth_clearance(&three, origin, direction, 2.0, 3.0) > 1e300, "clearance off the map");
}

/* A ray along a gridline or through corners sees one and the same surface from either side. */
static void gridlines(void)
{
    struct zoo_random random = zoo_seed(12);
    int round;
    for (round = 0; round < 400; ++round) {
        float heights[8 * 8];
        struct truth_map map = {8, 8, 0, 0, NULL};
        double origin[3], direction[3], near[3], t = -1.0, s = -1.0, c0, c1;
        int axis = zoo_below(&random, 2), hit, other;
        map.heights = heights;
        zoo_fill(zoo_below(&random, ZOO_KINDS), 8, 8, (uint32_t)round, heights);
        origin[axis] = (zoo_below(&random, 8) + 0.5) / 8.0;
        origin[1 - axis] = 0.0;
        origin[2] = (double)zoo_unit(&random);
        direction[axis] = zoo_below(&random, 2) ? 0.0 : (origin[axis] < 0.5 ? 1.0 : -1.0);
        if (direction[axis] != 0.0)
            origin[1 - axis] = direction[axis] > 0.0 ? origin[axis] : 1.0 - origin[axis];
        direction[1 - axis] = 1.0;
        direction[2] = zoo_below(&random, 3) ? (double)zoo_between(&random, -1.0f, 1.0f) : 0.0;
        near[0] = origin[0];
        near[1] = origin[1];
        near[2] = origin[2];
        near[axis] += zoo_below(&random, 2) ? 1e-13 : -1e-13;
        c0 = truth_clearance(&map, origin, direction, 0.0, HUGE_VAL);
        c1 = truth_clearance(&map, near, direction, 0.0, HUGE_VAL);
        CHECK(fabs(c0 - c1) < 1e-10, "round %d: clearance %g on the line, %g beside it", round, c0, c1);
        hit = truth_trace(&map, origin, direction, HUGE_VAL, &t);
        other = truth_trace(&map, near, direction, HUGE_VAL, &s);
        CHECK(hit == other || fabs(c0) < 1e-10, "round %d: hits differ", round);
    }
}

const struct test_case truth_tests[] = {
    {"agrees with dense marching", dense_marching},
    {"cases by hand", by_hand},
    {"gridlines and corners", gridlines},
    {NULL, NULL},
};
