/* The planner: what it refuses, what it must choose without tolerances, and that its choices keep them on maps it
   does not know. */
#include <math.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

enum { RAYS = 1500 };

static conemap_heights described(const void *pixels, int width, int height)
{
    conemap_heights heights;
    memset(&heights, 0, sizeof heights);
    heights.pixels = pixels;
    heights.width = width;
    heights.height = height;
    return heights;
}

static void statistics_are_right(void)
{
    enum { W = 40, H = 24 };
    float *pixels = (float *)test_alloc(sizeof(float) * W * H), *other = (float *)test_alloc(sizeof(float) * W * H * 2);
    conemap_heights heights = described(pixels, W, H), changed;
    conemap_statistics flat, rough, same;
    int k, x, y;

    zoo_fill(ZOO_FLAT_0, W, H, 1, pixels);
    REQUIRE(conemap_get_statistics(&heights, &flat) == CONEMAP_OK, "flat");
    CHECK(flat.width == W && flat.height == H && !(flat.roughness > 0.0f), "flat: %g", (double)flat.roughness);
    for (k = 0; k < 4; ++k) { /* every cone is as wide as they get, and nothing is hit before the floor or a side */
        CHECK(flat.way[k] > 0.99f, "flat: way %g", (double)flat.way[k]);
        CHECK(!(fabsf(flat.steps[k] - flat.safe_steps[k]) > 0.0f), "flat: safe cones are no narrower");
        CHECK(k == 0 || flat.cells[k] > flat.cells[k - 1], "flatter rays cross more cells");
    }
    zoo_fill(ZOO_WHITE, W, H, 1, pixels);
    REQUIRE(conemap_get_statistics(&heights, &rough) == CONEMAP_OK, "white");
    CHECK(fabsf(rough.roughness - 1.41f) < 0.1f, "white noise: %g", (double)rough.roughness);
    CHECK(rough.safe_steps[2] > rough.steps[2] && rough.way[2] < 0.9f, "white noise: %g, %g, %g",
          (double)rough.safe_steps[2], (double)rough.steps[2], (double)rough.way[2]);

    /* the same texels, upside down in memory, with room between, and as depths */
    changed = heights;
    for (y = 0; y < H; ++y)
        for (x = 0; x < W; ++x) other[((H - 1 - y) * W + x) * 2] = 1.0f - pixels[y * W + x];
    for (k = 0; k < W * H; ++k) pixels[k] = 1.0f - (1.0f - pixels[k]);
    changed.pixels = other + (H - 1) * W * 2;
    changed.row_stride = -(ptrdiff_t)(W * 2 * sizeof(float));
    changed.pixel_stride = 2 * sizeof(float);
    changed.is_depth = 1;
    REQUIRE(conemap_get_statistics(&heights, &rough) == CONEMAP_OK, "white again");
    REQUIRE(conemap_get_statistics(&changed, &same) == CONEMAP_OK, "strides");
    CHECK(memcmp(&rough, &same, sizeof same) == 0, "strides and depths give other statistics");

    for (k = 1; k <= 3; ++k) { /* small maps, and one texel */
        heights.width = k;
        heights.height = 4 - k;
        CHECK(conemap_get_statistics(&heights, &same) == CONEMAP_OK && same.width == k, "%d x %d", k, 4 - k);
    }
    heights.width = heights.height = 1;
    CHECK(conemap_get_statistics(&heights, &same) == CONEMAP_OK, "one texel");
    test_release(pixels);
    test_release(other);
}

static int is_zero(const void *bytes, size_t size)
{
    const unsigned char *at = (const unsigned char *)bytes;
    size_t k;
    for (k = 0; k < size; ++k)
        if (at[k]) return 0;
    return 1;
}

static void bad_input_is_refused(void)
{
    enum { W = 16 };
    static float pixels[W * W];
    conemap_heights heights = described(pixels, W, W), bad;
    conemap_statistics statistics;
    conemap_plan_desc desc, wrong;
    conemap_planned plan;
    float nan_value = (float)NAN, *field;
    int k;

    zoo_fill(ZOO_FBM, W, W, 1, pixels);
    CHECK(conemap_get_statistics(&heights, NULL) == CONEMAP_ERROR_NULL, "no statistics");
    CHECK(conemap_get_statistics(NULL, &statistics) == CONEMAP_ERROR_NULL, "no heights");
#define REFUSED(change, result)                                                                                        \
    bad = heights;                                                                                                     \
    memset(&statistics, 1, sizeof statistics);                                                                         \
    bad.change;                                                                                                        \
    CHECK(conemap_get_statistics(&bad, &statistics) == result && is_zero(&statistics, sizeof statistics), #change)
    REFUSED(pixels = NULL, CONEMAP_ERROR_NULL);
    REFUSED(width = 0, CONEMAP_ERROR_SIZE);
    REFUSED(height = CONEMAP_MAX_SIZE + 1, CONEMAP_ERROR_SIZE);
    REFUSED(format = CONEMAP_FORMAT_COUNT, CONEMAP_ERROR_ENUM);
    REFUSED(row_stride = 5, CONEMAP_ERROR_STRIDE);
    pixels[W * W - 1] = 1.5f;
    REFUSED(is_depth = 0, CONEMAP_ERROR_HEIGHT);
    pixels[W * W - 1] = nan_value;
    REFUSED(is_depth = 1, CONEMAP_ERROR_HEIGHT);
    pixels[W * W - 1] = 0.5f;

    memset(&desc, 0, sizeof desc);
    REQUIRE(conemap_get_statistics(&heights, &desc.statistics) == CONEMAP_OK, "statistics");
    CHECK(conemap_plan(&desc, NULL) == CONEMAP_ERROR_NULL, "no plan");
    CHECK(conemap_plan(NULL, &plan) == CONEMAP_ERROR_NULL, "no desc");
#define WRONG(change, result)                                                                                          \
    wrong = desc;                                                                                                      \
    memset(&plan, 1, sizeof plan);                                                                                     \
    wrong.change;                                                                                                      \
    CHECK(conemap_plan(&wrong, &plan) == result && is_zero(&plan, sizeof plan), #change)
    WRONG(statistics.width = 0, CONEMAP_ERROR_SIZE);
    WRONG(statistics.height = -1, CONEMAP_ERROR_SIZE);
    WRONG(statistics.roughness = -1.0f, CONEMAP_ERROR_PARAMETER);
    WRONG(statistics.way[3] = 1.5f, CONEMAP_ERROR_PARAMETER);
    WRONG(max_missed = 2.0f, CONEMAP_ERROR_PARAMETER);
    WRONG(lowest_elevation = 91.0f, CONEMAP_ERROR_PARAMETER);
    for (k = 0; k < 7; ++k) { /* no field takes a NaN, an infinity or a negative number */
        int n;
        for (n = 0; n < 3; ++n) {
            wrong = desc;
            field = k == 0   ? &wrong.depth
                    : k == 1 ? &wrong.lowest_elevation
                    : k == 2 ? &wrong.max_missed
                    : k == 3 ? &wrong.max_error
                    : k == 4 ? &wrong.max_steps
                    : k == 5 ? &wrong.max_time
                             : &wrong.rays_per_build;
            *field = n == 0 ? nan_value : n == 1 ? (float)HUGE_VAL : -1.0f;
            CHECK(conemap_plan(&wrong, &plan) == CONEMAP_ERROR_PARAMETER, "field %d, value %g", k, (double)*field);
        }
    }
}

/* Builds and traces what was planned; the shares of rays missed. */
static double missed_share(const float *pixels, int width, int height, const conemap_planned *plan, double *steps)
{
    static conemap_ray rays[RAYS];
    static conemap_hit hits[RAYS];
    struct zoo_random random = zoo_seed(77);
    struct truth_map truth = {width, height, 0, 0, NULL};
    conemap_desc desc;
    conemap_map map;
    conemap_prepared prepared;
    double missed = 0.0;
    int k, c;
    memset(&desc, 0, sizeof desc);
    desc.heights = described(pixels, width, height);
    desc.generator = plan->generator;
    desc.guarantee = plan->guarantee;
    desc.min3x3 = plan->min3x3;
    desc.texture = plan->texture;
    desc.keep_pyramid = plan->keep_pyramid;
    if (!CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "the plan cannot be built")) return 1.0;
    memset(rays, 0, sizeof rays);
    for (k = 0; k < RAYS; ++k) {
        float azimuth = zoo_between(&random, 0.0f, 6.2831853f), elevation = zoo_between(&random, 0.0873f, 1.5f);
        rays[k].origin[0] = zoo_unit(&random);
        rays[k].origin[1] = zoo_unit(&random);
        rays[k].origin[2] = 1.0f;
        rays[k].direction[0] = cosf(azimuth) * cosf(elevation);
        rays[k].direction[1] = sinf(azimuth) * cosf(elevation);
        rays[k].direction[2] = -sinf(elevation) / 0.25f;
    }
    if (plan->prepared) {
        CHECK(conemap_prepare(&map, NULL, &prepared) == CONEMAP_OK, "the plan cannot be prepared");
        CHECK(conemap_trace_prepared(&prepared, rays, hits, RAYS) == CONEMAP_OK, "the plan cannot be traced");
        conemap_free_prepared(&prepared);
    } else CHECK(conemap_trace(&map, &plan->trace, rays, hits, RAYS) == CONEMAP_OK, "the plan cannot be traced");
    truth.heights = map.heights;
    *steps = 0.0;
    for (k = 0; k < RAYS; ++k) {
        double origin[3], direction[3], flat, until = (double)hits[k].t_before;
        for (c = 0; c < 3; ++c) {
            origin[c] = (double)rays[k].origin[c];
            direction[c] = (double)rays[k].direction[c];
        }
        flat = sqrt(direction[0] * direction[0] + direction[1] * direction[1]);
        if (hits[k].status == CONEMAP_HIT) until -= 1.0 / (flat * (double)(width > height ? width : height));
        *steps += (double)hits[k].steps / RAYS;
        missed +=
            until > 0.0 && truth_clearance(&truth, origin, direction, 0.0, until) < -1.0 / 1048576.0 ? 1.0 / RAYS : 0.0;
    }
    conemap_free(&map);
    return missed;
}

static void choices_keep_their_tolerance(void)
{
    enum { W = 96, H = 72 };
    static const int kinds[] = {ZOO_FBM, ZOO_BRICKS, ZOO_WHITE, ZOO_SPIKES, ZOO_CLIFF, ZOO_RAMP};
    static const float tolerances[] = {0.0f, 0.002f, 0.02f, 0.2f, 1.0f};
    float pixels[W * H];
    double off = 0.0;
    int k, n, way, plans = 0;
    for (k = 0; k < (int)(sizeof kinds / sizeof kinds[0]); ++k)
        for (way = 0; way < 2; ++way) {
            conemap_heights heights = described(pixels, W, H);
            conemap_plan_desc desc;
            float before = 0.0f;
            zoo_fill(kinds[k], W, H, 9, pixels);
            memset(&desc, 0, sizeof desc);
            desc.no_prepared = way;
            REQUIRE(conemap_get_statistics(&heights, &desc.statistics) == CONEMAP_OK, "%s", zoo_name(kinds[k]));
            for (n = 0; n < 5; ++n) {
                conemap_planned plan, again;
                double missed, steps = 0.0;
                desc.max_missed = tolerances[n];
                memset(&plan, 1, sizeof plan);
                memset(&again, 2, sizeof again);
                REQUIRE(conemap_plan(&desc, &plan) == CONEMAP_OK && conemap_plan(&desc, &again) == CONEMAP_OK,
                        "no plan");
                CHECK(memcmp(&plan, &again, sizeof plan) == 0, "two plans for the same needs differ");
                CHECK(plan.within_budget && plan.missed <= tolerances[n], "%s: the plan breaks its own tolerance",
                      zoo_name(kinds[k]));
                CHECK(n == 0 || plan.time <= before, "%s: tolerating more costs more", zoo_name(kinds[k]));
                CHECK(!plan.prepared || !way, "%s: prepared though that is ruled out", zoo_name(kinds[k]));
                before = plan.time;
                missed = missed_share(pixels, W, H, &plan, &steps);
                CHECK(n == 0 ? !(missed > 0.0) : missed <= (double)tolerances[n], "%s: %g of rays missed, %g tolerated",
                      zoo_name(kinds[k]), missed, (double)tolerances[n]);
                if (steps > 0.0) off += fabs((double)plan.steps / steps - 1.0);
                ++plans;
            }
        }
    CHECK(off / plans < 0.5, "steps are off by %g as a mean", off / plans);
    test_note("steps planned are off by %.0f %% as a mean", off / plans * 100.0);
}

static void *no_memory(size_t size, void *user)
{
    (void)size;
    ++*(int *)user;
    return NULL;
}

static void no_release(void *memory, void *user)
{
    (void)memory;
    (void)user;
}

/* Bounds from statistics rule out what a trial finds to be good enough. */
static void trials_count(void)
{
    enum { W = 200, H = 150 };
    static float pixels[W * H];
    conemap_heights heights = described(pixels, W, H);
    conemap_plan_desc desc;
    conemap_planned guessed, tried, again;
    double missed, steps;
    int asked = 0;
    zoo_fill(ZOO_FBM, W, H, 9, pixels);
    memset(&desc, 0, sizeof desc);
    REQUIRE(conemap_get_statistics(&heights, &desc.statistics) == CONEMAP_OK, "statistics");
    desc.no_prepared = 1;
    desc.max_missed = 0.0005f;
    REQUIRE(conemap_plan(&desc, &guessed) == CONEMAP_OK, "no plan");
    desc.heights = &heights;
    memset(&tried, 1, sizeof tried);
    memset(&again, 2, sizeof again);
    REQUIRE(conemap_plan(&desc, &tried) == CONEMAP_OK && conemap_plan(&desc, &again) == CONEMAP_OK, "no trial");
    CHECK(memcmp(&tried, &again, sizeof tried) == 0, "two trials of the same differ");
    CHECK(tried.time < guessed.time, "trials find nothing cheaper: %g, %g", (double)tried.time, (double)guessed.time);
    CHECK(tried.missed > 0.0f && tried.missed <= desc.max_missed, "a bound of misses: %g", (double)tried.missed);
    missed = missed_share(pixels, W, H, &tried, &steps);
    CHECK(missed <= (double)desc.max_missed, "%g of rays missed", missed);

    zoo_fill(ZOO_WHITE, W, H, 9, pixels); /* statistics that promise too much don't deceive a trial */
    REQUIRE(conemap_plan(&desc, &tried) == CONEMAP_OK, "no trial");
    missed = missed_share(pixels, W, H, &tried, &steps);
    CHECK(missed <= (double)desc.max_missed, "white noise: %g of rays missed", missed);
    desc.max_missed = 0.0f;
    desc.max_error = 0.5f;
    REQUIRE(conemap_plan(&desc, &tried) == CONEMAP_OK, "no trial");
    CHECK(tried.error > 0.0f && tried.error <= 0.5f, "white noise: error %g", (double)tried.error);

    heights.height = H - 1;
    CHECK(conemap_plan(&desc, &tried) == CONEMAP_ERROR_SIZE && is_zero(&tried, sizeof tried), "another size");
    heights.height = H;
    desc.allocator.allocate = no_memory;
    desc.allocator.user = &asked;
    CHECK(conemap_plan(&desc, &tried) == CONEMAP_ERROR_NULL && is_zero(&tried, sizeof tried), "half an allocator");
    desc.allocator.release = no_release;
    CHECK(conemap_plan(&desc, &tried) == CONEMAP_ERROR_MEMORY && asked > 0 && is_zero(&tried, sizeof tried),
          "no memory for a trial");
    desc.max_error = 0.0f;
    CHECK(conemap_plan(&desc, &tried) == CONEMAP_OK, "without a tolerance nothing is tried");
}

static void budgets_and_builds_count(void)
{
    enum { W = 128 };
    static float pixels[W * W];
    conemap_heights heights = described(pixels, W, W);
    conemap_plan_desc desc;
    conemap_planned plan, once;
    zoo_fill(ZOO_FBM, W, W, 3, pixels);
    memset(&desc, 0, sizeof desc);
    REQUIRE(conemap_get_statistics(&heights, &desc.statistics) == CONEMAP_OK, "statistics");
    REQUIRE(conemap_plan(&desc, &once) == CONEMAP_OK && once.within_budget && once.prepared, "no prepared plan");
    desc.no_prepared = 1;
    REQUIRE(conemap_plan(&desc, &plan) == CONEMAP_OK && !plan.prepared, "no plan without the prepared tracer");
    CHECK(once.time < plan.time, "the prepared tracer is the fastest");
    desc.max_steps = 0.9f * plan.steps; /* too few for one cone in all directions */
    REQUIRE(conemap_plan(&desc, &once) == CONEMAP_OK, "no plan");
    CHECK(once.within_budget && once.texture.sectors > 1, "few steps are for sectors");
    desc.no_sectors = 1;
    REQUIRE(conemap_plan(&desc, &once) == CONEMAP_OK, "no plan");
    CHECK(once.texture.sectors <= 1, "sectors though they are ruled out");
    desc.max_steps = 0.0f;
    once = plan;
    CHECK(once.guarantee == CONEMAP_GUARANTEE_BILINEAR && once.trace.tracer == CONEMAP_TRACE_EXACT,
          "a smooth map that is built once is for cones");
    CHECK(once.texture.format == CONEMAP_F32, "exact hits need exact heights");
    desc.max_error = 4.0f;
    REQUIRE(conemap_plan(&desc, &plan) == CONEMAP_OK, "no plan");
    CHECK(plan.texture.format != CONEMAP_F32, "an error of four texels lets heights be coarse");
    desc.max_error = 0.0f;
    desc.max_time = 0.01f;
    REQUIRE(conemap_plan(&desc, &plan) == CONEMAP_OK, "no plan");
    CHECK(!plan.within_budget && plan.guarantee == once.guarantee, "a budget that nothing keeps is told");
    desc.max_time = 0.0f;
    desc.max_steps = 1e6f;
    REQUIRE(conemap_plan(&desc, &plan) == CONEMAP_OK, "no plan");
    CHECK(plan.within_budget, "a large budget is kept");
    desc.rays_per_build = 1.0f; /* a build for a single ray: the cheapest one to make */
    REQUIRE(conemap_plan(&desc, &plan) == CONEMAP_OK, "no plan");
    CHECK(plan.build_time <= once.build_time && plan.trace.tracer == CONEMAP_TRACE_MAXMIP,
          "one ray a build is for maxima");
    CHECK(once.time <= plan.time, "what is built once is the quickest to trace");
}

const struct test_case plan_tests[] = {
    {"statistics are right", statistics_are_right},
    {"bad input is refused", bad_input_is_refused},
    {"choices keep their tolerance", choices_keep_their_tolerance},
    {"trials count", trials_count},
    {"budgets and builds count", budgets_and_builds_count},
    {NULL, NULL},
};
