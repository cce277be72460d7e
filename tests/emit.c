/* The emitter: bad input, sizes, names, and the emitted C itself, run against the CPU's tracers. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "emit_compare.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

#define GOLDEN "tests/golden/"

/* ---- the emitted C: every tracer, and between them every option that C has ---- */

static struct {
    const conemap_map *map;
    float *maxima[8];
    int side;
    float radius_cones[64 * 64];
} bound;

#define TEXEL(i, j) ((size_t)(j) * (size_t)bound.map->info.width + (size_t)(i))
#define INSIDE(i, j) CHECK((i) >= 0 && (j) >= 0 && (i) < bound.map->info.width && (j) < bound.map->info.height, "fetch %d %d", i, j)
#define FETCH_CONES(p)                                     \
    p##_vec2 p##_fetch(int i, int j)                       \
    {                                                      \
        p##_vec2 v = {0.0f, 0.0f};                         \
        if (!INSIDE(i, j)) return v;                       \
        v.x = bound.map->heights[TEXEL(i, j)];             \
        v.y = bound.map->cones[TEXEL(i, j)];               \
        return v;                                          \
    }
#define FETCH_HEIGHTS(p)                                   \
    float p##_fetch(int i, int j)                          \
    {                                                      \
        return INSIDE(i, j) ? bound.map->heights[TEXEL(i, j)] : 0.0f; \
    }
#define FETCH_MAXIMA(p)                                                                              \
    float p##_maxima(int i, int j, int level)                                                        \
    {                                                                                                \
        int side = bound.side >> level;                                                              \
        if (!CHECK(i >= 0 && j >= 0 && side > 0 && i < side && j < side, "maxima %d %d %d", i, j, level)) return 0.0f; \
        return bound.maxima[level][(size_t)j * (size_t)side + (size_t)i];                            \
    }
#define ANSWER(p)                                                        \
    struct shader_hit answer;                                            \
    p##_vec3 o, d;                                                       \
    p##_ivec2 size;                                                      \
    p##_hit hit;                                                         \
    o.x = ray->origin[0], o.y = ray->origin[1], o.z = ray->origin[2];    \
    d.x = ray->direction[0], d.y = ray->direction[1], d.z = ray->direction[2]; \
    size.x = bound.map->info.width, size.y = bound.map->info.height;     \
    hit = p##_trace(o, d EXTRA, size);                                   \
    answer.found = hit.found;                                            \
    answer.t = hit.t;                                                    \
    answer.status = hit.status;                                          \
    answer.steps = hit.steps;                                            \
    answer.position[0] = hit.position.x;                                 \
    answer.position[1] = hit.position.y;                                 \
    answer.position[2] = hit.position.z;                                 \
    return answer;
#define RUN(p)                                                           \
    static struct shader_hit p##_run(const conemap_ray *ray) { ANSWER(p) }

#include "golden/exact_c.h"
#include "golden/back_c.h"
#include "golden/linear_c.h"
#include "golden/fixed_c.h"
#include "golden/loop_c.h"
#include "golden/step_c.h"
#include "golden/cellmax_c.h"
#include "golden/maxmip_c.h"
#include "golden/qdm_c.h"

FETCH_CONES(exact)
FETCH_CONES(back)
FETCH_HEIGHTS(linear)
FETCH_CONES(fixed)
FETCH_CONES(loop)
FETCH_CONES(step)
FETCH_CONES(cellmax)
FETCH_HEIGHTS(maxmip)
FETCH_HEIGHTS(qdm)
FETCH_MAXIMA(maxmip)
FETCH_MAXIMA(qdm)
#define EXTRA
RUN(exact)
RUN(back)
RUN(linear)
RUN(fixed)
RUN(loop)
RUN(step)
RUN(cellmax)
RUN(maxmip)
RUN(qdm)
#undef EXTRA

struct golden {
    const char *file;
    conemap_shader_desc desc;
    struct shader_hit (*run)(const conemap_ray *ray); /* null: text only */
    conemap_generator generator;
};

static struct golden goldens[16];
static int golden_count;

static conemap_shader_desc *golden_new(const char *file, const char *prefix, conemap_tracer tracer,
                                       struct shader_hit (*run)(const conemap_ray *ray))
{
    static char names[16][2][32];
    struct golden *g = &goldens[golden_count];
    memset(g, 0, sizeof *g);
    g->file = file;
    g->run = run;
    g->desc.trace.tracer = tracer;
    if (run) {
        snprintf(names[golden_count][0], 32, "%s_fetch", prefix);
        snprintf(names[golden_count][1], 32, "%s_maxima", prefix);
        g->desc.dialect = CONEMAP_C99;
        g->desc.prefix = prefix;
        g->desc.fetch = names[golden_count][0];
        if (tracer == CONEMAP_TRACE_MAXMIP || tracer == CONEMAP_TRACE_QDM) g->desc.fetch_maxima = names[golden_count][1];
        g->desc.steps = g->desc.status = 1;
    }
    ++golden_count;
    return &g->desc;
}

static void golden_table(void)
{
    conemap_shader_desc *d;
    golden_count = 0;
    d = golden_new("exact_c.h", "exact", CONEMAP_TRACE_EXACT, exact_run);
    d = golden_new("back_c.h", "back", CONEMAP_TRACE_EXACT, back_run);
    d->map.guarantee = CONEMAP_GUARANTEE_RELAXED_BILINEAR;
    d->map.wrap_u = CONEMAP_WRAP;
    d->map.wrap_v = CONEMAP_NOTHING;
    d->map.texture.encoding = CONEMAP_SQRT;
    goldens[golden_count - 1].generator = CONEMAP_RELAXED_EXACT;
    d = golden_new("linear_c.h", "linear", CONEMAP_TRACE_LINEAR, linear_run);
    d->trace.refinement = CONEMAP_REFINE_SECANT;
    d = golden_new("fixed_c.h", "fixed", CONEMAP_TRACE_FIXED, fixed_run);
    d->map.aspect = 0.5f;
    d = golden_new("loop_c.h", "loop", CONEMAP_TRACE_LOOP, loop_run);
    d->trace.refinement = CONEMAP_REFINE_BISECT;
    d->trace.adaptive_steps = 1;
    d->map.texture.encoding = CONEMAP_RADIUS;
    d = golden_new("step_c.h", "step", CONEMAP_TRACE_EXACT_STEP, step_run);
    d->map.wrap_u = CONEMAP_NOTHING;
    d = golden_new("cellmax_c.h", "cellmax", CONEMAP_TRACE_CELL_MAX, cellmax_run);
    d->trace.refinement = CONEMAP_REFINE_SECANT;
    d->map.texture.per_cell = 1;
    d = golden_new("maxmip_c.h", "maxmip", CONEMAP_TRACE_MAXMIP, maxmip_run);
    d = golden_new("qdm_c.h", "qdm", CONEMAP_TRACE_QDM, qdm_run);
    d->map.wrap_v = CONEMAP_WRAP;
    d = golden_new("exact.frag", NULL, CONEMAP_TRACE_EXACT, NULL);
    d->stage = CONEMAP_STAGE_FRAGMENT;
    d = golden_new("maxmip.hlsl", NULL, CONEMAP_TRACE_MAXMIP, NULL);
    d->stage = CONEMAP_STAGE_COMPUTE;
    d->dialect = CONEMAP_HLSL_50;
    d->map.wrap_u = CONEMAP_WRAP;
    d->array = 1;
}

static char *emit(const conemap_shader_desc *desc)
{
    size_t size = 0;
    char *text;
    conemap_result result = conemap_emit(desc, NULL, 0, &size);
    if (!CHECK(result == CONEMAP_OK && size > 100, "emit: %s", conemap_result_string(result))) return NULL;
    text = (char *)test_alloc(size);
    result = conemap_emit(desc, text, size, NULL);
    CHECK(result == CONEMAP_OK && strlen(text) + 1 == size, "emit: %s, %d of %d", conemap_result_string(result),
          (int)strlen(text), (int)size);
    return text;
}

/* The golden files hold what the emitter writes now, so what runs below is the emitter's text. */
static void golden_files(void)
{
    int k;
    golden_table();
    for (k = 0; k < golden_count; ++k) {
        char path[64], *text = emit(&goldens[k].desc), *file;
        size_t size, length;
        FILE *stream;
        if (!text) return;
        size = strlen(text);
        snprintf(path, sizeof path, GOLDEN "%s", goldens[k].file);
        if (getenv("CONEMAP_SYNC")) {
            stream = fopen(path, "wb");
            if (CHECK(stream != NULL, "%s", path)) {
                fwrite(text, 1, size, stream);
                fclose(stream);
            }
        }
        file = (char *)test_alloc(size + 2);
        stream = fopen(path, "rb");
        length = stream ? fread(file, 1, size + 1, stream) : 0;
        if (stream) fclose(stream);
        CHECK(length == size && memcmp(file, text, size) == 0, "%s: not what is emitted (make sync)", path);
        test_release(file);
        test_release(text);
    }
}

static void bind_map(const conemap_map *map)
{
    int k, levels = conemap_maxima_levels(map);
    bound.map = map;
    bound.side = 1 << (levels - 1);
    for (k = 0; k < levels; ++k) {
        size_t side = (size_t)(bound.side >> k), size = side * side * sizeof(float);
        bound.maxima[k] = (float *)test_alloc(size);
        CHECK(conemap_write_maxima(map, k, bound.maxima[k], size) == CONEMAP_OK, "maxima %d", k);
        CHECK(conemap_write_maxima(map, k, bound.maxima[k], size - 1) == CONEMAP_ERROR_BUFFER, "small maxima %d", k);
    }
}

static void unbind_map(void)
{
    int k;
    for (k = 0; bound.side >> k; ++k) test_release(bound.maxima[k]);
}

static void runs_as_c(void)
{
    static const int sizes[][2] = {{1, 1}, {1, 7}, {2, 2}, {17, 13}, {31, 20}, {64, 64}};
    static float heights[64 * 64];
    struct compare_counts all;
    int g, kind, size, k;
    memset(&all, 0, sizeof all);
    golden_table();
    for (g = 0; g < golden_count; ++g) {
        struct compare_counts counts;
        struct zoo_random random = zoo_seed(7);
        if (!goldens[g].run) continue;
        memset(&counts, 0, sizeof counts);
        for (kind = 0; kind < ZOO_KINDS; ++kind) {
            for (size = 0; size < (int)(sizeof sizes / sizeof sizes[0]); ++size) {
                const conemap_shader_desc *shader = &goldens[g].desc;
                conemap_desc desc;
                conemap_map map;
                struct truth_map truth;
                memset(&desc, 0, sizeof desc);
                zoo_fill(kind, sizes[size][0], sizes[size][1], 17, heights);
                desc.heights.pixels = heights;
                desc.heights.width = sizes[size][0];
                desc.heights.height = sizes[size][1];
                desc.wrap_u = shader->map.wrap_u;
                desc.wrap_v = shader->map.wrap_v;
                desc.aspect = shader->map.aspect;
                desc.texture = shader->map.texture;
                desc.generator = goldens[g].generator;
                desc.keep_pyramid = 1;
                if (!CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "%s %s", goldens[g].file, zoo_name(kind))) return;
                truth.width = sizes[size][0];
                truth.height = sizes[size][1];
                truth.wrap_u = (int)desc.wrap_u;
                truth.wrap_v = (int)desc.wrap_v;
                truth.heights = map.heights;
                bind_map(&map);
                for (k = 0; k < 48; ++k) {
                    conemap_ray ray = compare_ray(&random, truth.width, truth.height, k);
                    struct shader_hit hit;
                    if ((truth.wrap_u == 1 || truth.wrap_v == 1) && ray.direction[2] > -0.01f && ray.direction[2] < 0.01f)
                        continue;
                    hit = goldens[g].run(&ray);
                    compare_hit(&map, &truth, &shader->trace, &ray, &hit, &counts);
                }
                unbind_map();
                conemap_free(&map);
            }
        }
        CHECK(counts.hits > counts.rays / 4, "%s: %d hits of %d rays", goldens[g].file, counts.hits, counts.rays);
        CHECK(counts.different * 1000 <= counts.rays, "%s: %d of %d rays differ from the CPU's", goldens[g].file,
              counts.different, counts.rays);
        CHECK(counts.unexplained == 0, "%s: %d rays differ and lie on no edge", goldens[g].file, counts.unexplained);
        CHECK(counts.misses == 0, "%s: %d misses", goldens[g].file, counts.misses);
        if (getenv("CONEMAP_SHOW"))
            printf("%-12s rays %d hits %d different %d unexplained %d strict %d misses %d\n", goldens[g].file, counts.rays,
                   counts.hits, counts.different, counts.unexplained, counts.strict_misses, counts.misses);
        all.rays += counts.rays;
        all.different += counts.different;
        all.strict_misses += counts.strict_misses;
    }
    test_note("%d rays in emitted C, %d on edges", all.rays, all.different);
}

const struct test_case emit_tests[] = {
    {"golden files", golden_files},
    {"runs as C", runs_as_c},
    {NULL, NULL},
};
