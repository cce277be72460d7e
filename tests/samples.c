/* conemap_sample_at: height, cone, slope and normal at a point, against double precision. */
#include <math.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

static const int sizes[][2] = {{1, 1}, {1, 7}, {2, 2}, {3, 5}, {17, 17}, {31, 20}};

/* The stored cones, interpolated as if they were heights. */
static double plain_cone(const conemap_map *map, double u, double v)
{
    struct truth_map cones;
    cones.width = map->info.width;
    cones.height = map->info.height;
    cones.wrap_u = (int)map->info.wrap_u;
    cones.wrap_v = (int)map->info.wrap_v;
    cones.heights = map->cones;
    return truth_height(&cones, u, v);
}

static void random_points(void)
{
    struct zoo_random random = zoo_seed(31);
    float heights[31 * 20];
    int round, point;
    for (round = 0; round < 300; ++round) {
        const int size = zoo_below(&random, 6), kind = zoo_below(&random, ZOO_KINDS);
        struct truth_map truth = {0, 0, 0, 0, NULL};
        conemap_desc desc;
        conemap_map map;
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = heights;
        truth.width = desc.heights.width = sizes[size][0];
        truth.height = desc.heights.height = sizes[size][1];
        truth.wrap_u = zoo_below(&random, 3);
        truth.wrap_v = zoo_below(&random, 3);
        desc.wrap_u = (conemap_wrap)truth.wrap_u;
        desc.wrap_v = (conemap_wrap)truth.wrap_v;
        desc.max_tan = round & 1 ? 16.0f : 1.0f;
        desc.texture.encoding = (conemap_encoding)zoo_below(&random, CONEMAP_ENCODING_COUNT);
        desc.texture.format = (conemap_format)zoo_below(&random, CONEMAP_FORMAT_COUNT);
        zoo_fill(kind, truth.width, truth.height, (uint32_t)round, heights);
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        truth.heights = map.heights;
        for (point = 0; point < 60; ++point) {
            const int nu = truth.wrap_u == 2 && truth.width > 1, nv = truth.wrap_v == 2 && truth.height > 1;
            const float lu = nu ? 0.5f / (float)truth.width : 0.0f,
                        lv = nv ? 0.5f / (float)truth.height : 0.0f;
            float u = zoo_between(&random, lu, 1.0f - lu), v = zoo_between(&random, lv, 1.0f - lv);
            double right, slope_u, slope_v, e = 1e-4, length, x, y, slack;
            conemap_sample s;
            conemap_result result;
            if (truth.wrap_u == 1) u = zoo_between(&random, -3.0f, 3.0f);
            if (truth.wrap_v == 1) v = zoo_between(&random, -3.0f, 3.0f);
            if (point < 4 && truth.wrap_u != 1) u = point & 1 ? 1.0f - lu : lu;
            if (point < 4 && truth.wrap_v != 1) v = point & 2 ? 1.0f - lv : lv;
            memset(&s, 0x7f, sizeof s);
            result = conemap_sample_at(&map, u, v, &s);
            if (!CHECK(result == CONEMAP_OK, "round %d: (%g, %g): %s", round, (double)u, (double)v,
                       conemap_result_string(result))) {
                break;
            }
            right = truth_height(&truth, (double)u, (double)v);
            slack = 3e-7 * (1.0 + 3.0 * (truth.width + truth.height));
            CHECK(fabs((double)s.height - right) <= slack, "round %d: height at (%.9g, %.9g) is %g, right %g",
                  round, (double)u, (double)v, (double)s.height, right);
            {
                const double stored = plain_cone(&map, (double)u, (double)v);
                const double tangent = (double)conemap_decode(&map.info, s.height, (float)stored);
                /* (1 - height) in a divisor magnifies the rounding */
                const double amplify = map.info.texture.encoding == CONEMAP_RADIUS
                                           ? 1.0 / ((1.0 - right) * (1.0 - right) + 1e-3)
                                           : 1.0;
                CHECK(fabs((double)s.tan - tangent) <= 20.0 * slack * (1.0 + tangent) * amplify,
                      "round %d: cone at (%.9g, %.9g) is %g, right %g", round, (double)u, (double)v,
                      (double)s.tan, tangent);
                CHECK(s.tan >= 0.0f && s.tan <= desc.max_tan, "round %d: cone %g", round, (double)s.tan);
            }
            /* slopes jump at the cells' borders: away from them only */
            x = (double)u * truth.width - 0.5;
            y = (double)v * truth.height - 0.5;
            if (fabs(x - floor(x + 0.5)) < 1e-3 * truth.width ||
                fabs(y - floor(y + 0.5)) < 1e-3 * truth.height)
                continue;
            if (point < 4) continue;
            slope_u = (truth_height(&truth, (double)u + e, (double)v) -
                       truth_height(&truth, (double)u - e, (double)v)) /
                      (2.0 * e);
            slope_v = (truth_height(&truth, (double)u, (double)v + e) -
                       truth_height(&truth, (double)u, (double)v - e)) /
                      (2.0 * e);
            CHECK(fabs((double)s.dhdu - slope_u) <= 1e-3 * (1.0 + fabs(slope_u)) &&
                      fabs((double)s.dhdv - slope_v) <= 1e-3 * (1.0 + fabs(slope_v)),
                  "round %d: slope at (%.9g, %.9g) is %g %g, right %g %g", round, (double)u, (double)v,
                  (double)s.dhdu, (double)s.dhdv, slope_u, slope_v);
            length = sqrt(slope_u * slope_u + slope_v * slope_v + 1.0);
            CHECK(fabs((double)s.normal[0] + slope_u / length) < 2e-3 &&
                      fabs((double)s.normal[1] + slope_v / length) < 2e-3 &&
                      fabs((double)s.normal[2] - 1.0 / length) < 2e-3,
                  "round %d: normal %g %g %g", round, (double)s.normal[0], (double)s.normal[1],
                  (double)s.normal[2]);
            CHECK(fabs(sqrt((double)s.normal[0] * (double)s.normal[0] +
                            (double)s.normal[1] * (double)s.normal[1] +
                            (double)s.normal[2] * (double)s.normal[2]) -
                       1.0) < 1e-5,
                  "round %d: the normal is not a unit", round);
        }
        conemap_free(&map);
    }
}

/* At the centres a sample is the texel: to the bit, but for the last one where a surface ends there, which is
   the far end of its cell. */
static void centres(void)
{
    float heights[16 * 8];
    conemap_desc desc;
    conemap_map map;
    int wrap, k;
    zoo_fill(ZOO_WHITE, 16, 8, 9, heights);
    for (wrap = 0; wrap < 3; ++wrap) {
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = heights;
        desc.heights.width = 16;
        desc.heights.height = 8;
        desc.wrap_u = desc.wrap_v = (conemap_wrap)wrap;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        for (k = 0; k < 128; ++k) {
            conemap_sample s;
            const float u = ((float)(k % 16) + 0.5f) / 16.0f, v = ((float)(k / 16) + 0.5f) / 8.0f;
            const float slack = wrap == 2 && (k % 16 == 15 || k / 16 == 7) ? 3e-7f : 0.0f;
            CHECK(conemap_sample_at(&map, u, v, &s) == CONEMAP_OK && fabsf(s.height - heights[k]) <= slack &&
                      fabsf(s.tan - map.cones[k]) <= slack,
                  "wrap %d texel %d: height %.9g of %.9g, cone %.9g of %.9g", wrap, k, (double)s.height,
                  (double)heights[k], (double)s.tan, (double)map.cones[k]);
            if (wrap == 1) {
                CHECK(conemap_sample_at(&map, u - 2.0f, v + 1.0f, &s) == CONEMAP_OK && s.height == heights[k],
                      "texel %d, two periods off: %.9g", k, (double)s.height);
            }
        }
        conemap_free(&map);
    }
}

static void positions(void)
{
    static const float heights[4] = {0.1f, 0.2f, 0.3f, 0.4f};
    static const float bad[] = {-0.001f, 1.001f, -1e30f, 1e30f};
    const float nan = nanf(""), inf = HUGE_VALF;
    conemap_desc desc;
    conemap_map map;
    conemap_sample s;
    int wrap, k;
    for (wrap = 0; wrap < 3; ++wrap) {
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = heights;
        desc.heights.width = desc.heights.height = 2;
        desc.wrap_u = desc.wrap_v = (conemap_wrap)wrap;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        CHECK(conemap_sample_at(&map, nan, 0.5f, &s) == CONEMAP_ERROR_POSITION, "wrap %d: u NaN", wrap);
        CHECK(conemap_sample_at(&map, 0.5f, nan, &s) == CONEMAP_ERROR_POSITION, "wrap %d: v NaN", wrap);
        CHECK(conemap_sample_at(&map, inf, 0.5f, &s) == CONEMAP_ERROR_POSITION, "wrap %d: u infinite", wrap);
        CHECK(conemap_sample_at(&map, 0.5f, -inf, &s) == CONEMAP_ERROR_POSITION, "wrap %d: v infinite", wrap);
        CHECK(conemap_sample_at(&map, 0.5f, 0.5f, NULL) == CONEMAP_ERROR_NULL, "no sample");
        CHECK(conemap_sample_at(NULL, 0.5f, 0.5f, &s) == CONEMAP_ERROR_NULL, "no map");
        for (k = 0; k < 4; ++k) {
            const conemap_result right = wrap == 1 ? CONEMAP_OK : CONEMAP_ERROR_POSITION;
            CHECK(conemap_sample_at(&map, bad[k], 0.5f, &s) == right, "wrap %d: u %g", wrap, (double)bad[k]);
            CHECK(conemap_sample_at(&map, 0.5f, bad[k], &s) == right, "wrap %d: v %g", wrap, (double)bad[k]);
            if (right == CONEMAP_OK) {
                CHECK(s.height >= 0.1f && s.height <= 0.4001f && s.tan >= 0.0f, "far away: %g",
                      (double)s.height);
            }
        }
        CHECK(conemap_sample_at(&map, 0.2f, 0.5f, &s) == (wrap == 2 ? CONEMAP_ERROR_POSITION : CONEMAP_OK),
              "wrap %d: in the outer half texel", wrap);
        conemap_free(&map);
    }
}

/* What lies on the border lies there as a float, too: the outermost centres, and hits on the map's sides. */
static void borders(void)
{
    static float heights[512];
    struct zoo_random random = zoo_seed(4);
    conemap_desc desc;
    conemap_map map;
    conemap_sample s;
    int width, k, wrap, sides = 0;
    for (k = 0; k < 512; ++k) heights[k] = zoo_unit(&random);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.height = 1;
    desc.generator = CONEMAP_HEIGHTS;
    desc.wrap_u = CONEMAP_NOTHING;
    for (width = 2; width <= 512; ++width) {
        const float w = (float)width, at[4] = {0.5f / w, (w - 0.5f) / w, 1.0f - 0.5f / w, 0.5f * (1.0f / w)};
        desc.heights.width = width;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        for (k = 0; k < 4; ++k) {
            float centre = heights[k == 1 || k == 2 ? width - 1 : 0], slope[2];
            if (CHECK(conemap_sample_at(&map, at[k], 0.5f, &s) == CONEMAP_OK, "width %d, u %.9g", width, (double)at[k]))
                CHECK(fabsf(s.height - centre) <= 4e-7f * w, "width %d: %g, not %g", width, (double)s.height,
                      (double)centre);
            CHECK(conemap_smooth_slope(&map, at[k], 0.5f, slope) == CONEMAP_OK, "width %d, slope", width);
        }
        CHECK(conemap_sample_at(&map, at[0] - 1e-6f, 0.5f, &s) == CONEMAP_ERROR_POSITION, "width %d: before", width);
        CHECK(conemap_sample_at(&map, at[1] + 1e-6f, 0.5f, &s) == CONEMAP_ERROR_POSITION, "width %d: behind", width);
        conemap_free(&map);
    }
    desc.heights.width = 20;
    desc.heights.height = 25;
    for (wrap = CONEMAP_CLAMP; wrap <= CONEMAP_NOTHING; wrap += CONEMAP_NOTHING - CONEMAP_CLAMP) {
        desc.wrap_u = desc.wrap_v = (conemap_wrap)wrap;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        for (k = 0; k < 1000; ++k) {
            conemap_ray ray = {{0, 0, 0}, {0, 0, 0}, 0, 0};
            conemap_hit hit;
            ray.origin[0] = zoo_between(&random, -0.5f, 1.5f);
            ray.origin[1] = zoo_between(&random, -0.5f, 1.5f);
            ray.origin[2] = zoo_unit(&random);
            ray.direction[0] = zoo_unit(&random) - ray.origin[0];
            ray.direction[1] = zoo_unit(&random) - ray.origin[1];
            ray.direction[2] = -ray.origin[2];
            REQUIRE(conemap_trace(&map, NULL, &ray, &hit, 1) == CONEMAP_OK, "trace");
            if (hit.status != CONEMAP_HIT) continue;
            CHECK(conemap_sample_at(&map, hit.u, hit.v, &s) == CONEMAP_OK, "a hit at %.9g, %.9g", (double)hit.u,
                  (double)hit.v);
            sides += hit.inside;
        }
        conemap_free(&map);
    }
    CHECK(sides > 300, "%d hits on sides", sides);
}

const struct test_case samples_tests[] = {
    {"random points against double precision", random_points},
    {"texel centres to the bit", centres},
    {"positions", positions},
    {"borders", borders},
    {NULL, NULL},
};
