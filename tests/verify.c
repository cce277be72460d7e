/* The verifier of interpolated cones: maps known to be safe, maps known not to be, and dense sampling in double. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

/* Side of the largest map whose unsafe cones are counted; the checks ask for 128 as well. */
#ifndef VERIFY_SIDE
#define VERIFY_SIDE 64
#endif
#define MOST (128 * 128)

static conemap_info plain_info(int width, int height)
{
    conemap_info info;
    memset(&info, 0, sizeof info);
    info.width = width;
    info.height = height;
    info.aspect = 1.0f;
    info.max_tan = 16.0f;
    return info;
}

/* Verifies; complains unless there is a report that adds up. */
static conemap_report look(const conemap_info *info, const float *heights, const float *cones)
{
    conemap_report report;
    size_t cells_u = (size_t)info->width, cells_v = (size_t)info->height;
    conemap_result result;
    memset(&report, 0x5a, sizeof report);
    result = conemap_verify(info, heights, cones, NULL, &report);
    if (info->wrap_u != CONEMAP_WRAP && cells_u > 1) --cells_u;
    if (info->wrap_v != CONEMAP_WRAP && cells_v > 1) --cells_v;
    CHECK(result == CONEMAP_OK, "verify: %s", conemap_result_string(result));
    CHECK(report.cells == cells_u * cells_v && report.unsafe + report.unproven <= report.cells,
          "%d cells of %d, %d unsafe, %d unproven", (int)report.cells, (int)(cells_u * cells_v), (int)report.unsafe,
          (int)report.unproven);
    CHECK((report.unsafe > 0) == (report.worst > 0.0), "%d unsafe, worst %g", (int)report.unsafe, report.worst);
    return report;
}

static void must_be_safe(const char *what, const conemap_info *info, const float *heights, const float *cones)
{
    conemap_report report = look(info, heights, cones);
    CHECK(report.unsafe == 0 && report.unproven == 0, "%s: %d unsafe, %d unproven, worst %g", what,
          (int)report.unsafe, (int)report.unproven, report.worst);
}

static void must_be_unsafe(const char *what, const conemap_info *info, const float *heights, const float *cones,
                           size_t at_least)
{
    conemap_report report = look(info, heights, cones);
    CHECK(report.unsafe >= at_least, "%s: %d unsafe, at least %d, %d unproven", what, (int)report.unsafe,
          (int)at_least, (int)report.unproven);
}

/* ---- dense sampling, from the definition ---- */

struct sampled {
    int unsafe;
    double worst;
};

static double texel(const conemap_info *info, const float *plane, int i, int j)
{
    const int w = info->width, h = info->height;
    i = info->wrap_u == CONEMAP_WRAP ? (i % w + w) % w : i < 0 ? 0 : i >= w ? w - 1 : i;
    j = info->wrap_v == CONEMAP_WRAP ? (j % h + h) % h : j < 0 ? 0 : j >= h ? h - 1 : j;
    return (double)plane[j * w + i];
}

static double mixed(const conemap_info *info, const float *plane, int i, int j, double x, double y)
{
    return (texel(info, plane, i, j) * (1.0 - x) + texel(info, plane, i + 1, j) * x) * (1.0 - y) +
           (texel(info, plane, i, j + 1) * (1.0 - x) + texel(info, plane, i + 1, j + 1) * x) * y;
}

static double decoded(const conemap_info *info, double height, double stored)
{
    if (info->texture.encoding == CONEMAP_SQRT) return stored * stored;
    if (info->texture.encoding == CONEMAP_RADIUS) {
        if (height >= 1.0) return 0.0;
        return fmin((double)info->max_tan, stored / (1.0 - height));
    }
    return stored;
}

/* Distance along an axis, of the nearest image; nothing along an axis of one texel. */
static double along(double texels, int size, conemap_wrap wrap)
{
    if (size == 1) return 0.0;
    texels = fabs(texels);
    if (wrap == CONEMAP_WRAP) texels = fmin(texels, (double)size - texels);
    return texels / (double)size;
}

/* How far the surface rises above the cone at one apex, at n x n points in every cell. */
static double deepest(const conemap_info *info, const float *heights, double px, double py, double height,
                      double tangent, int n)
{
    const int cu = info->wrap_u == CONEMAP_WRAP ? info->width : info->width - 1;
    const int cv = info->wrap_v == CONEMAP_WRAP ? info->height : info->height - 1;
    double most = -1.0;
    int i, j, a, b;
    for (j = 0; j < cv || j == 0; ++j) {
        for (i = 0; i < cu || i == 0; ++i) {
            for (b = 0; b < n; ++b) {
                for (a = 0; a < n; ++a) {
                    const double x = (double)a / (n - 1), y = (double)b / (n - 1);
                    const double rise = mixed(info, heights, i, j, x, y) - height - 1.0 / 1048576.0;
                    double du, dv, depth;
                    if (!(rise > 0.0) || rise <= most) continue;
                    du = along((double)i + x - px, info->width, info->wrap_u);
                    dv = along((double)j + y - py, info->height, info->wrap_v) * (double)info->aspect;
                    depth = rise - sqrt(du * du + dv * dv) / tangent;
                    if (depth > most) most = depth;
                }
            }
        }
    }
    return most;
}

static struct sampled sample_densely(const conemap_info *info, const float *heights, const float *cones, int n)
{
    const int cu = info->wrap_u == CONEMAP_WRAP ? info->width : info->width - 1;
    const int cv = info->wrap_v == CONEMAP_WRAP ? info->height : info->height - 1;
    struct sampled all = {0, 0.0};
    int i, j, a, b;
    for (j = 0; j < cv || j == 0; ++j) {
        for (i = 0; i < cu || i == 0; ++i) {
            double worst = 0.0;
            for (b = 0; b < n; ++b) {
                for (a = 0; a < n; ++a) {
                    const double x = (double)a / (n - 1), y = (double)b / (n - 1);
                    const double height = mixed(info, heights, i, j, x, y);
                    const double tangent = decoded(info, height, mixed(info, cones, i, j, x, y));
                    double depth;
                    if (!(tangent > 0.0)) continue;
                    depth = deepest(info, heights, (double)i + x, (double)j + y, height, tangent, n);
                    if (depth > worst) worst = depth;
                }
            }
            all.unsafe += worst > 1e-9; /* ties are not worth an argument */
            if (worst > all.worst) all.worst = worst;
        }
    }
    return all;
}

/* The report against samples: no violation escapes it, the deepest is about as deep as it says, and the apex that it
   names is indeed as bad. */
static conemap_report compare(const char *what, const conemap_info *info, const float *heights, const float *cones,
                              int n)
{
    const conemap_report report = look(info, heights, cones);
    const struct sampled samples = sample_densely(info, heights, cones, n);
    CHECK(samples.unsafe <= (int)report.unsafe, "%s: %d cells sampled unsafe, reported %d and %d unproven", what,
          samples.unsafe, (int)report.unsafe, (int)report.unproven);
    CHECK(samples.worst <= report.worst * (1.0 + 1.0 / 64.0) + 2e-6, "%s: sampled worst %g, reported %g", what,
          samples.worst, report.worst);
    if (report.worst > 1e-3) {
        const double x = (double)report.u * info->width - 0.5, y = (double)report.v * info->height - 0.5;
        const int i = (int)floor(x + 1e-6), j = (int)floor(y + 1e-6);
        const double fx = info->width > 1 ? x - i : 0.0, fy = info->height > 1 ? y - j : 0.0;
        const double height = mixed(info, heights, i, j, fx, fy);
        const double tangent = decoded(info, height, mixed(info, cones, i, j, fx, fy));
        const double again = deepest(info, heights, x, y, height, tangent, 65);
        CHECK(again >= 0.5 * report.worst && again <= report.worst * (1.0 + 1.0 / 64.0) + 1e-4,
              "%s: worst %g at (%g, %g), found %g there", what, report.worst, (double)report.u, (double)report.v,
              again);
    }
    return report;
}

static void against_samples(void)
{
    static const struct {
        int width, height, n;
        conemap_wrap wrap_u, wrap_v;
        float aspect, scale; /* of random cones */
        conemap_encoding encoding;
    } cases[] = {
        {8, 8, 9, CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 0.3f, CONEMAP_LINEAR},
        {8, 8, 9, CONEMAP_NOTHING, CONEMAP_CLAMP, 1.0f, 0.12f, CONEMAP_LINEAR},
        {8, 8, 9, CONEMAP_WRAP, CONEMAP_WRAP, 1.0f, 0.15f, CONEMAP_LINEAR},
        {8, 8, 9, CONEMAP_WRAP, CONEMAP_CLAMP, 0.25f, 0.1f, CONEMAP_SQRT},
        {8, 8, 9, CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 0.45f, CONEMAP_SQRT},
        {8, 8, 9, CONEMAP_CLAMP, CONEMAP_NOTHING, 3.0f, 0.2f, CONEMAP_RADIUS},
        {8, 8, 9, CONEMAP_WRAP, CONEMAP_WRAP, 1.0f, 0.05f, CONEMAP_RADIUS},
        {5, 3, 9, CONEMAP_WRAP, CONEMAP_CLAMP, 1.0f, 0.2f, CONEMAP_LINEAR},
        {2, 2, 17, CONEMAP_WRAP, CONEMAP_WRAP, 1.0f, 0.5f, CONEMAP_LINEAR},
        {2, 2, 17, CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 1.0f, CONEMAP_LINEAR},
        {1, 9, 17, CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 0.15f, CONEMAP_LINEAR},
        {9, 1, 17, CONEMAP_WRAP, CONEMAP_WRAP, 2.0f, 0.15f, CONEMAP_LINEAR},
    };
    struct zoo_random random = zoo_seed(5);
    float heights[64], cones[64];
    int k, t, kind, unproven = 0, safe = 0, unsafe = 0;
    for (k = 0; k < (int)(sizeof cases / sizeof cases[0]); ++k) {
        for (kind = 0; kind < 3; ++kind) { /* random, smooth and spiky */
            static const int kinds[] = {ZOO_WHITE, ZOO_SADDLE, ZOO_SPIKES};
            conemap_info info = plain_info(cases[k].width, cases[k].height);
            conemap_report report;
            char what[64];
            info.wrap_u = cases[k].wrap_u;
            info.wrap_v = cases[k].wrap_v;
            info.aspect = cases[k].aspect;
            info.max_tan = 1.0f;
            info.texture.encoding = cases[k].encoding;
            zoo_fill(kinds[kind], info.width, info.height, (uint32_t)k, heights);
            for (t = 0; t < info.width * info.height; ++t) cones[t] = zoo_between(&random, 0.0f, cases[k].scale);
            snprintf(what, sizeof what, "case %d, %s", k, zoo_name(kinds[kind]));
            report = compare(what, &info, heights, cones, kind == 0 ? cases[k].n : 5);
            unproven += (int)report.unproven;
            unsafe += (int)report.unsafe;
            safe += (int)(report.cells - report.unsafe - report.unproven);
        }
    }
    CHECK(safe > 100 && unsafe > 100, "too one-sided: %d safe, %d unsafe", safe, unsafe);
    CHECK(unproven <= (safe + unsafe) / 50, "%d unproven cells, %d others", unproven, safe + unsafe);
    test_note("%d cells safe, %d unsafe, %d unproven beside samples", safe, unsafe, unproven);
}

/* ---- maps whose answer is known ---- */

static int build(int kind, int size, conemap_generator generator, conemap_guarantee guarantee, int min3x3,
                 float *heights, conemap_map *map)
{
    conemap_desc desc;
    conemap_result result;
    memset(&desc, 0, sizeof desc);
    zoo_fill(kind, size, size, 3, heights);
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = size;
    desc.max_tan = 16.0f;
    desc.generator = generator;
    desc.guarantee = guarantee;
    desc.min3x3 = min3x3;
    result = conemap_build(&desc, map);
    return CHECK(result == CONEMAP_OK, "%s: %s", zoo_name(kind), conemap_result_string(result));
}

static void safe_maps(void)
{
    float *heights = (float *)test_alloc(MOST * sizeof *heights), *cones = (float *)test_alloc(MOST * sizeof *cones);
    conemap_info info = plain_info(33, 33);
    conemap_map map;
    int kind, k, wrap;
    for (kind = 0; kind < ZOO_KINDS; ++kind) { /* vertex cones far narrower than they may be */
        if (!build(kind, 33, CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 1, heights, &map)) break;
        for (k = 0; k < 33 * 33; ++k) cones[k] = 0.3f * fminf(map.cones[k], 1.0f);
        must_be_safe(zoo_name(kind), &map.info, map.heights, cones);
        conemap_free(&map);
    }
    for (wrap = 0; wrap < 3; ++wrap) {
        info.wrap_u = info.wrap_v = (conemap_wrap)wrap;
        info.max_tan = CONEMAP_TAN_LIMIT;
        for (k = 0; k < 33 * 33; ++k) {
            heights[k] = 0.5f;
            cones[k] = info.max_tan;
        }
        must_be_safe("flat", &info, heights, cones);
        memset(cones, 0, MOST * sizeof *cones);
        zoo_fill(ZOO_WHITE, 33, 33, 1, heights);
        must_be_safe("closed cones", &info, heights, cones);
    }
    /* Even slopes, tan = 1 / slope exactly: a rise of 1/32 per texel of 1/32, then along both axes. */
    info = plain_info(32, 32);
    for (k = 0; k < 32 * 32; ++k) {
        heights[k] = (float)(k % 32) / 32.0f;
        cones[k] = 1.0f;
    }
    must_be_safe("ramp", &info, heights, cones);
    info.wrap_v = CONEMAP_WRAP;
    must_be_safe("ramp, wrapping across", &info, heights, cones);
    info.wrap_u = CONEMAP_WRAP;
    must_be_unsafe("ramp, wrapping along", &info, heights, cones, 32);
    info = plain_info(32, 32);
    for (k = 0; k < 32 * 32; ++k) heights[k] = (float)(3 * (k % 32) + 4 * (k / 32)) / 256.0f;
    for (k = 0; k < 32 * 32; ++k) cones[k] = 1.6f; /* slope 5/8 */
    must_be_safe("tilted plane", &info, heights, cones);
    for (k = 0; k < 32 * 32; ++k) cones[k] = 1.601f;
    must_be_unsafe("tilted plane, too wide", &info, heights, cones, 16); /* only across some way */
    test_release(heights);
    test_release(cones);
}

/* Narrow texels, and one texel in a direction. */
static void shapes(void)
{
    float heights[64], cones[64];
    conemap_info info = plain_info(16, 4);
    int k;
    for (k = 0; k < 64; ++k) {
        heights[k] = (float)(k / 16) / 4.0f; /* slope 1 along v in uv, 1/4 with aspect 4 */
        cones[k] = 1.0f;
    }
    must_be_safe("slope along v", &info, heights, cones);
    info.aspect = 0.999f;
    must_be_unsafe("slope along v, aspect below 1", &info, heights, cones, 45);
    info.aspect = 4.0f;
    for (k = 0; k < 64; ++k) cones[k] = 4.0f;
    must_be_safe("slope along v, aspect 4", &info, heights, cones);
    info.aspect = 3.99f;
    must_be_unsafe("slope along v, aspect 3.99", &info, heights, cones, 45);
    info = plain_info(1, 64);
    for (k = 0; k < 64; ++k) {
        heights[k] = (float)k / 128.0f;
        cones[k] = 2.0f;
    }
    must_be_safe("a line", &info, heights, cones);
    for (k = 0; k < 64; ++k) cones[k] = 2.01f;
    must_be_unsafe("a line, too wide", &info, heights, cones, 50);
    info = plain_info(64, 1);
    info.wrap_v = CONEMAP_WRAP;
    must_be_unsafe("a line along u, too wide", &info, heights, cones, 50);
    for (k = 0; k < 64; ++k) cones[k] = 2.0f;
    must_be_safe("a line along u", &info, heights, cones);
    for (k = 0; k < 3; ++k) {
        info = plain_info(1, 1);
        info.wrap_u = info.wrap_v = (conemap_wrap)k;
        must_be_safe("one texel", &info, heights, cones);
    }
}

/* A spike on the far border is seen across the seam, and only there. */
static void seams(void)
{
    static const int at[][2] = {{15, 8}, {8, 15}, {15, 15}};
    float heights[256], cones[256];
    int k, t, d;
    for (k = 0; k < 3; ++k) {
        conemap_info info = plain_info(16, 16);
        memset(heights, 0, sizeof heights);
        heights[at[k][1] * 16 + at[k][0]] = 1.0f;
        /* Narrow by the spike's tent as seen without a seam: a texel off for the tent, halved for interpolation. */
        for (t = 0; t < 256; ++t) {
            double x = fabs((double)(t % 16 - at[k][0])), y = fabs((double)(t / 16 - at[k][1]));
            x = fmax(0.0, x - 2.0);
            y = fmax(0.0, y - 2.0);
            cones[t] = (float)(0.7 * sqrt(x * x + y * y) / 16.0);
        }
        for (d = 0; d < 9; ++d) { /* the neighbourhood of the spike has steep sides: no cones there at all */
            const int i = at[k][0] + d % 3 - 1, j = at[k][1] + d / 3 - 1;
            if (i >= 0 && i < 16 && j >= 0 && j < 16) cones[j * 16 + i] = 0.0f;
        }
        must_be_safe("spike at the border", &info, heights, cones);
        info.wrap_u = CONEMAP_WRAP;
        if (at[k][0] == 15) must_be_unsafe("spike across the seam in u", &info, heights, cones, 1);
        else must_be_safe("spike away from the seam in u", &info, heights, cones);
        info.wrap_u = CONEMAP_NOTHING;
        info.wrap_v = CONEMAP_WRAP;
        if (at[k][1] == 15) must_be_unsafe("spike across the seam in v", &info, heights, cones, 1);
        else must_be_safe("spike away from the seam in v", &info, heights, cones);
        info.wrap_u = CONEMAP_WRAP;
        must_be_unsafe("spike across the seams", &info, heights, cones, 1);
    }
}

/* Vertex cones cut the interpolated surface, corrected or not. */
static void known_failures(void)
{
    static const int kinds[] = {ZOO_FBM, ZOO_BRICKS, ZOO_WHITE, ZOO_SPIKES};
    static const float corner[4] = {0.0f, 0.7f, 0.7f, 0.99f};
    float *heights = (float *)test_alloc(MOST * sizeof *heights), cones[4];
    size_t counts[2] = {0, 0}, unproven = 0, cells = 0;
    conemap_map map;
    conemap_info info = plain_info(2, 2);
    int k, size, corrected;

    /* From the lowest corner the steepest vertex rises .7 / .5, the steepest way is the gradient, .99 / .5. */
    for (k = 0; k < 4; ++k) cones[k] = 0.5f / 0.99f * (k == 0 ? 0.999f : 0.0f);
    must_be_safe("by the gradient", &info, corner, cones);
    cones[0] = 0.5f / 0.7f;
    must_be_unsafe("by the vertices", &info, corner, cones, 1);

    for (size = 64; size <= VERIFY_SIDE; size *= 2) {
        for (k = 0; k < 4; ++k) {
            for (corrected = 0; corrected < 2; ++corrected) {
                conemap_report report;
                if (!build(kinds[k], size, CONEMAP_RING, CONEMAP_GUARANTEE_VERTEX, corrected, heights, &map)) break;
                report = look(&map.info, map.heights, map.cones);
                CHECK(report.unsafe > report.cells / 200, "%s %d%s: only %d cells unsafe", zoo_name(kinds[k]), size,
                      corrected ? ", corrected" : "", (int)report.unsafe);
                CHECK(report.unproven * 20 <= report.cells, "%s %d%s: %d cells unproven", zoo_name(kinds[k]), size,
                      corrected ? ", corrected" : "", (int)report.unproven);
                counts[corrected] += report.unsafe;
                unproven += report.unproven;
                cells += corrected ? 0 : report.cells;
                conemap_free(&map);
            }
        }
    }
    test_note("of %d cells %d unsafe with vertex cones, %d with corrected ones, %d unproven", (int)cells,
              (int)counts[0], (int)counts[1], (int)unproven);
    test_release(heights);
}

/* What the library promises to be safe is, and 1 % more is not. */
static void guaranteed_maps(void)
{
    float *heights = (float *)test_alloc(MOST * sizeof *heights), *cones = (float *)test_alloc(MOST * sizeof *cones);
    conemap_map map;
    int kind, encoding, wrap, k;
    size_t wide = 0;
    for (kind = 0; kind < ZOO_KINDS; ++kind) {
        if (!build(kind, 48, CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, heights, &map)) break;
        must_be_safe(zoo_name(kind), &map.info, map.heights, map.cones);
        for (k = 0; k < 48 * 48; ++k) cones[k] = 1.01f * map.cones[k];
        if (kind == ZOO_FBM || kind == ZOO_BRICKS || kind == ZOO_WHITE || kind == ZOO_SPIKES) {
            const conemap_report report = look(&map.info, map.heights, cones);
            CHECK(report.unsafe > 0, "%s: 1 %% wider cones pass", zoo_name(kind));
            wide += report.unsafe;
        }
        conemap_free(&map);
    }
    for (encoding = 0; encoding < (int)CONEMAP_ENCODING_COUNT; ++encoding) {
        for (wrap = 0; wrap < 3; ++wrap) {
            static const float aspects[] = {1.0f, 0.5f, 3.0f};
            conemap_desc desc;
            memset(&desc, 0, sizeof desc);
            zoo_fill(ZOO_FBM, 40, 25, 7, heights);
            desc.heights.pixels = heights;
            desc.heights.width = 40;
            desc.heights.height = 25;
            desc.wrap_u = (conemap_wrap)wrap;
            desc.wrap_v = (conemap_wrap)((wrap + encoding) % 3);
            desc.aspect = aspects[wrap];
            desc.guarantee = CONEMAP_GUARANTEE_BILINEAR;
            desc.texture.encoding = (conemap_encoding)encoding;
            desc.texture.format = (conemap_format)((wrap + 2 * encoding) % CONEMAP_FORMAT_COUNT);
            REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "encoding %d, wrap %d", encoding, wrap);
            must_be_safe("encoded", &map.info, map.heights, map.cones);
            conemap_free(&map);
        }
    }
    test_note("%d cells unsafe with guaranteed cones 1 %% wider", (int)wide);
    test_release(heights);
    test_release(cones);
}

/* ---- bad input ---- */

static struct {
    int alive, calls, fail;
} keeper;

static void *keeper_allocate(size_t size, void *user)
{
    (void)user;
    ++keeper.calls;
    if (keeper.fail) return NULL;
    ++keeper.alive;
    return test_alloc(size);
}

static void keeper_release(void *memory, void *user)
{
    (void)user;
    if (memory) --keeper.alive;
    test_release(memory);
}

static float small_heights[12], small_cones[12];

static void refuse(int line, const conemap_info *info, conemap_result right)
{
    static const conemap_report nothing = {0, 0, 0, 0.0, 0.0f, 0.0f};
    const conemap_allocator allocator = {keeper_allocate, keeper_release, NULL};
    conemap_report report;
    conemap_result result;
    memset(&report, 0x77, sizeof report);
    result = conemap_verify(info, small_heights, small_cones, &allocator, &report);
    CHECK(result == right, "line %d: %s", line, conemap_result_string(result));
    if (right != CONEMAP_OK) {
        CHECK(report.cells == nothing.cells && report.unsafe == 0 && report.unproven == 0 && !(report.worst != 0.0) &&
                  !(report.u != 0.0f) && !(report.v != 0.0f),
              "line %d: the report is not zeroed", line);
    }
    CHECK(keeper.alive == 0, "line %d: %d blocks stay", line, keeper.alive);
}

#define REFUSE(assignment, result)                                                                           \
    do {                                                                                                     \
        conemap_info info = plain_info(4, 3);                                                                \
        assignment;                                                                                          \
        refuse(__LINE__, &info, result);                                                                     \
    } while (0)

static void bad_inputs(void)
{
    const float nan = nanf(""), inf = HUGE_VALF, bad_heights[] = {nan, inf, -inf, -0.001f, 1.001f},
                bad_cones[] = {nan, inf, -inf, -0.001f};
    conemap_info good = plain_info(4, 3);
    conemap_allocator half = {keeper_allocate, NULL, NULL};
    conemap_report report;
    int k;
    for (k = 0; k < 12; ++k) {
        small_heights[k] = (float)k / 12.0f;
        small_cones[k] = 0.25f;
    }
    CHECK(conemap_verify(NULL, small_heights, small_cones, NULL, &report) == CONEMAP_ERROR_NULL, "no info");
    CHECK(conemap_verify(&good, NULL, small_cones, NULL, &report) == CONEMAP_ERROR_NULL, "no heights");
    CHECK(conemap_verify(&good, small_heights, NULL, NULL, &report) == CONEMAP_ERROR_NULL, "no cones");
    CHECK(conemap_verify(&good, small_heights, small_cones, NULL, NULL) == CONEMAP_ERROR_NULL, "no report");
    CHECK(conemap_verify(&good, small_heights, small_cones, &half, &report) == CONEMAP_ERROR_NULL,
          "half an allocator");
    REFUSE((void)info, CONEMAP_OK);
    REFUSE(info.width = 0, CONEMAP_ERROR_SIZE);
    REFUSE(info.height = -1, CONEMAP_ERROR_SIZE);
    REFUSE(info.width = CONEMAP_MAX_SIZE + 1, CONEMAP_ERROR_SIZE);
    REFUSE(info.height = CONEMAP_MAX_SIZE + 1, CONEMAP_ERROR_SIZE);
    REFUSE(info.wrap_u = CONEMAP_WRAP_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(info.wrap_v = CONEMAP_WRAP_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(info.texture.encoding = CONEMAP_ENCODING_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(info.aspect = 0.0f, CONEMAP_ERROR_PARAMETER);
    REFUSE(info.aspect = nan, CONEMAP_ERROR_PARAMETER);
    REFUSE(info.aspect = 32769.0f, CONEMAP_ERROR_PARAMETER);
    REFUSE(info.max_tan = 0.0f, CONEMAP_ERROR_PARAMETER);
    REFUSE(info.max_tan = inf, CONEMAP_ERROR_PARAMETER);
    REFUSE(info.max_tan = 65505.0f, CONEMAP_ERROR_PARAMETER);
    for (k = 0; k < 5; ++k) {
        small_heights[k + 7] = bad_heights[k];
        REFUSE((void)info, CONEMAP_ERROR_HEIGHT);
        small_heights[k + 7] = 0.5f;
    }
    for (k = 0; k < 4; ++k) {
        small_cones[k + 8] = bad_cones[k];
        REFUSE((void)info, CONEMAP_ERROR_PARAMETER);
        small_cones[k + 8] = 0.25f;
    }
    keeper.calls = 0;
    keeper.fail = 1;
    REFUSE((void)info, CONEMAP_ERROR_MEMORY);
    CHECK(keeper.calls == 1, "the allocator was asked %d times", keeper.calls);
    keeper.fail = 0;
    /* The widest numbers that pass: no crash, no overflow, nothing proven wrongly. */
    for (k = 0; k < 12; ++k) {
        small_heights[k] = k & 1 ? 1.0f : 0.0f;
        small_cones[k] = 3e38f;
    }
    for (k = 0; k < (int)CONEMAP_ENCODING_COUNT; ++k) {
        good = plain_info(4, 3);
        good.texture.encoding = (conemap_encoding)k;
        good.aspect = k & 1 ? 32768.0f : 1.0f / 32768.0f;
        must_be_unsafe("enormous cones", &good, small_heights, small_cones, 6);
    }
}

const struct test_case verify_tests[] = {
    {"safe maps", safe_maps},
    {"shapes", shapes},
    {"seams", seams},
    {"known failures", known_failures},
    {"against samples", against_samples},
    {"guaranteed maps", guaranteed_maps},
    {"bad inputs", bad_inputs},
    {NULL, NULL},
};
