/* The emitter: bad input, sizes, names, and the emitted C itself, run against the CPU's tracers. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "emit_compare.h"
#include "golden.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

#ifndef TEST_WRITE
/* ---- the emitted C: every tracer, and between them every option that C has ---- */

static struct {
    const conemap_map *map;
    float *maxima[8];
    int side;
    float radius_cones[64 * 64];
} bound;

#define TEXEL(i, j) ((size_t)(j) * (size_t)bound.map->info.width + (size_t)(i))
#define INSIDE(i, j)                                                                                              \
    CHECK((i) >= 0 && (j) >= 0 && (i) < bound.map->info.width && (j) < bound.map->info.height, "fetch %d %d", i, j)
#define FETCH_CONES(p)                                                                                            \
    p##_vec2 p##_fetch(int i, int j)                                                                              \
    {                                                                                                             \
        p##_vec2 v = {0.0f, 0.0f};                                                                                \
        if (!INSIDE(i, j)) return v;                                                                              \
        v.x = bound.map->heights[TEXEL(i, j)];                                                                    \
        v.y = bound.map->cones[TEXEL(i, j)];                                                                      \
        return v;                                                                                                 \
    }
#define FETCH_HEIGHTS(p)                                                                                          \
    float p##_fetch(int i, int j) { return INSIDE(i, j) ? bound.map->heights[TEXEL(i, j)] : 0.0f; }
#define FETCH_SECTORS(p)                                                                                          \
    FETCH_HEIGHTS(p)                                                                                              \
    float p##_cones(int i, int j, int sector)                                                                     \
    {                                                                                                             \
        size_t plane = (size_t)bound.map->info.width * (size_t)bound.map->info.height * (size_t)sector;           \
        CHECK(sector >= 0 && sector < bound.map->info.texture.sectors, "sector %d", sector);                      \
        return INSIDE(i, j) ? bound.map->cones[plane + TEXEL(i, j)] : 0.0f;                                       \
    }
#define FETCH_MAXIMA(p)                                                                                           \
    float p##_maxima(int i, int j, int level)                                                                     \
    {                                                                                                             \
        int side = bound.side >> level;                                                                           \
        if (!CHECK(i >= 0 && j >= 0 && side > 0 && i < side && j < side, "maxima %d %d %d", i, j, level))         \
            return 0.0f;                                                                                          \
        return bound.maxima[level][(size_t)j * (size_t)side + (size_t)i];                                         \
    }
#define ANSWER(p)                                                                                                 \
    struct shader_hit answer;                                                                                     \
    p##_vec3 o, d;                                                                                                \
    p##_ivec2 size;                                                                                               \
    p##_hit hit;                                                                                                  \
    o.x = ray->origin[0], o.y = ray->origin[1], o.z = ray->origin[2];                                             \
    d.x = ray->direction[0], d.y = ray->direction[1], d.z = ray->direction[2];                                    \
    size.x = bound.map->info.width, size.y = bound.map->info.height;                                              \
    hit = p##_trace(o, d EXTRA, size);                                                                            \
    answer.found = hit.found;                                                                                     \
    answer.t = hit.t;                                                                                             \
    answer.status = hit.status;                                                                                   \
    answer.steps = hit.steps;                                                                                     \
    answer.position[0] = hit.position.x;                                                                          \
    answer.position[1] = hit.position.y;                                                                          \
    answer.position[2] = hit.position.z;                                                                          \
    return answer;
#define RUN(p)                                                                                                    \
    static struct shader_hit p##_run(const conemap_ray *ray) { ANSWER(p) }

#include "build/written/exact_c.h"
#include "build/written/back_c.h"
#include "build/written/linear_c.h"
#include "build/written/fixed_c.h"
#include "build/written/loop_c.h"
#include "build/written/step_c.h"
#include "build/written/cellmax_c.h"
#include "build/written/maxmip_c.h"
#include "build/written/qdm_c.h"
#include "build/written/quadrant_c.h"
#include "build/written/octant_c.h"

FETCH_CONES(exact)
FETCH_CONES(back)
FETCH_HEIGHTS(linear)
FETCH_CONES(fixed)
FETCH_CONES(loop)
FETCH_CONES(step)
FETCH_CONES(cellmax)
FETCH_HEIGHTS(maxmip)
FETCH_HEIGHTS(qdm)
FETCH_SECTORS(quadrant)
FETCH_SECTORS(octant)
FETCH_MAXIMA(maxmip)
FETCH_MAXIMA(qdm)

/* ---- the kernels, run as C pass by pass ---- */

#include "build/written/kernel_ring_c.h"
#include "build/written/kernel_min_c.h"
#include "build/written/kernel_safe_c.h"
#include "build/written/kernel_store_c.h"
#include "build/written/kernel_cells_c.h"
#include "build/written/kernel_texels_c.h"
#include "build/written/kernel_maxima_c.h"
#include "build/written/kernel_quick_c.h"
#include "build/written/kernel_center_c.h"
#include "build/written/kernel_exact_c.h"
#include "build/written/kernel_relaxed_c.h"
#include "build/written/kernel_octant_c.h"

static struct {
    int width, height;
    const float *heights;
    float *state;      /* the copy that is read */
    int sector;        /* whose state that is */
    float maxima[7][64 * 64];
    int top;           /* the level of one block */
} grid;

static float grid_height(int i, int j)
{
    return CHECK(i >= 0 && j >= 0 && i < grid.width && j < grid.height, "height %d %d", i, j)
               ? grid.heights[j * grid.width + i]
               : 0.0f;
}

static float grid_state(int i, int j)
{
    return CHECK(i >= 0 && j >= 0 && i < grid.width && j < grid.height, "state %d %d", i, j)
               ? grid.state[j * grid.width + i]
               : 0.0f;
}

static float grid_maximum(int i, int j, int level)
{
    const int side = 1 << (grid.top - level);
    return CHECK(level >= 0 && level <= grid.top && i >= 0 && j >= 0 && i < side && j < side, "maxima %d %d %d", i, j,
                 level)
               ? grid.maxima[level][j * side + i]
               : 0.0f;
}

float kcells_fetch(int i, int j) { return grid_height(i, j); }
float ktexels_fetch(int i, int j) { return grid_height(i, j); }
float kquick_fetch(int i, int j) { return grid_height(i, j); }
float kcenter_fetch(int i, int j) { return grid_height(i, j); }
float kexact_fetch(int i, int j) { return grid_height(i, j); }
float kexact_state(int i, int j) { return grid_state(i, j); }
float krelaxed_fetch(int i, int j) { return grid_height(i, j); }
float krelaxed_state(int i, int j) { return grid_state(i, j); }
float krelaxed_maxima(int i, int j, int level) { return grid_maximum(i, j, level); }
float koctant_fetch(int i, int j) { return grid_height(i, j); }
float koctant_state(int i, int j, int sector)
{
    CHECK(sector == grid.sector, "sector %d", sector);
    return grid_state(i, j);
}
float koctant_maxima(int i, int j, int level) { return grid_maximum(i, j, level); }
float kmaxima_maxima(int i, int j, int level) { return grid_maximum(i, j, level); }
float kquick_maxima(int i, int j, int level) { return grid_maximum(i, j, level); }
float kcenter_maxima(int i, int j, int level) { return grid_maximum(i, j, level); }
float kexact_maxima(int i, int j, int level) { return grid_maximum(i, j, level); }
float kring_fetch(int i, int j) { return grid_height(i, j); }
float ksafe_fetch(int i, int j) { return grid_height(i, j); }
float ksafe_state(int i, int j) { return grid_state(i, j); }
float kstore_fetch(int i, int j) { return grid_height(i, j); }
float kring_state(int i, int j) { return grid_state(i, j); }
float kmin_state(int i, int j) { return grid_state(i, j); }
float kstore_state(int i, int j) { return grid_state(i, j); }

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
RUN(quadrant)
RUN(octant)
#undef EXTRA
#define RUN_OF(p) p##_run
#else
#define RUN_OF(p) NULL
#endif

struct golden {
    const char *file;
    conemap_shader_desc desc;
    struct shader_hit (*run)(const conemap_ray *ray); /* null: text only */
    conemap_generator generator;
    int kernel; /* -1: a tracer */
};

static struct golden goldens[32];
static int golden_count;

static conemap_shader_desc *golden_new(const char *file, const char *prefix, conemap_tracer tracer,
                                       struct shader_hit (*run)(const conemap_ray *ray))
{
    static char names[32][3][32];
    struct golden *g = &goldens[golden_count];
    memset(g, 0, sizeof *g);
    g->file = file;
    g->kernel = -1;
    g->run = run;
    g->desc.trace.tracer = tracer;
    if (prefix) {
        snprintf(names[golden_count][0], 32, "%s_fetch", prefix);
        snprintf(names[golden_count][1], 32, "%s_maxima", prefix);
        g->desc.dialect = CONEMAP_C99;
        g->desc.prefix = prefix;
        snprintf(names[golden_count][2], 32, "%s_cones", prefix);
        g->desc.fetch_cones = names[golden_count][2];
        g->desc.fetch = names[golden_count][0];
        if (tracer == CONEMAP_TRACE_MAXMIP || tracer == CONEMAP_TRACE_QDM)
            g->desc.fetch_maxima = names[golden_count][1];
        g->desc.steps = g->desc.status = 1;
    }
    ++golden_count;
    return &g->desc;
}

static void golden_table(void)
{
    conemap_shader_desc *d;
    int k;
    golden_count = 0;
    d = golden_new("exact_c.h", "exact", CONEMAP_TRACE_EXACT, RUN_OF(exact));
    d = golden_new("back_c.h", "back", CONEMAP_TRACE_EXACT, RUN_OF(back));
    d->map.guarantee = CONEMAP_GUARANTEE_RELAXED_BILINEAR;
    d->map.wrap_u = CONEMAP_WRAP;
    d->map.wrap_v = CONEMAP_NOTHING;
    d->map.texture.encoding = CONEMAP_SQRT;
    goldens[golden_count - 1].generator = CONEMAP_RELAXED_EXACT;
    d = golden_new("linear_c.h", "linear", CONEMAP_TRACE_LINEAR, RUN_OF(linear));
    d->trace.refinement = CONEMAP_REFINE_SECANT;
    d = golden_new("fixed_c.h", "fixed", CONEMAP_TRACE_FIXED, RUN_OF(fixed));
    d->map.aspect = 0.5f;
    d = golden_new("loop_c.h", "loop", CONEMAP_TRACE_LOOP, RUN_OF(loop));
    d->trace.refinement = CONEMAP_REFINE_BISECT;
    d->trace.adaptive_steps = 1;
    d->map.texture.encoding = CONEMAP_RADIUS;
    d = golden_new("step_c.h", "step", CONEMAP_TRACE_EXACT_STEP, RUN_OF(step));
    d->map.wrap_u = CONEMAP_NOTHING;
    d = golden_new("cellmax_c.h", "cellmax", CONEMAP_TRACE_CELL_MAX, RUN_OF(cellmax));
    d->trace.refinement = CONEMAP_REFINE_SECANT;
    d->map.texture.per_cell = 1;
    d = golden_new("maxmip_c.h", "maxmip", CONEMAP_TRACE_MAXMIP, RUN_OF(maxmip));
    d = golden_new("qdm_c.h", "qdm", CONEMAP_TRACE_QDM, RUN_OF(qdm));
    d->map.wrap_v = CONEMAP_WRAP;
    d = golden_new("quadrant_c.h", "quadrant", CONEMAP_TRACE_EXACT, RUN_OF(quadrant));
    d->map.texture.sectors = 4;
    d->map.texture.per_cell = 1;
    d->map.aspect = 0.5f;
    d = golden_new("octant_c.h", "octant", CONEMAP_TRACE_EXACT, RUN_OF(octant));
    d->map.texture.sectors = 8;
    d->map.texture.encoding = CONEMAP_RADIUS;
    d->map.wrap_u = CONEMAP_WRAP;
    d = golden_new("exact.frag", NULL, CONEMAP_TRACE_EXACT, NULL);
    d->stage = CONEMAP_STAGE_FRAGMENT;
    d = golden_new("maxmip.hlsl", NULL, CONEMAP_TRACE_MAXMIP, NULL);
    d->stage = CONEMAP_STAGE_COMPUTE;
    d->dialect = CONEMAP_HLSL_50;
    d->map.wrap_u = CONEMAP_WRAP;
    d->array = 1;
    d = golden_new("exact.wgsl", NULL, CONEMAP_TRACE_EXACT, NULL);
    d->dialect = CONEMAP_WGSL;
    d->stage = CONEMAP_STAGE_FRAGMENT;
    d = golden_new("qdm.metal", NULL, CONEMAP_TRACE_QDM, NULL);
    d->dialect = CONEMAP_MSL;
    d->stage = CONEMAP_STAGE_COMPUTE;
    for (k = 0; k < 12; ++k) {
        static const struct {
            const char *file, *prefix;
            conemap_kernel kernel;
            conemap_generator generator;
        } kernels[12] = {{"kernel_ring_c.h", "kring", CONEMAP_KERNEL_RING, CONEMAP_RING},
                         {"kernel_min_c.h", "kmin", CONEMAP_KERNEL_MIN3X3, CONEMAP_RING},
                         {"kernel_safe_c.h", "ksafe", CONEMAP_KERNEL_SAFE, CONEMAP_RING},
                         {"kernel_store_c.h", "kstore", CONEMAP_KERNEL_STORE, CONEMAP_RING},
                         {"kernel_cells_c.h", "kcells", CONEMAP_KERNEL_CELLS, CONEMAP_RING},
                         {"kernel_texels_c.h", "ktexels", CONEMAP_KERNEL_TEXELS, CONEMAP_RING},
                         {"kernel_maxima_c.h", "kmaxima", CONEMAP_KERNEL_MAXIMA, CONEMAP_RING},
                         {"kernel_quick_c.h", "kquick", CONEMAP_KERNEL_QUICK, CONEMAP_QUICK},
                         {"kernel_center_c.h", "kcenter", CONEMAP_KERNEL_QUICK, CONEMAP_QUICK_NAIVE_CENTER},
                         {"kernel_exact_c.h", "kexact", CONEMAP_KERNEL_EXACT, CONEMAP_EXACT},
                         {"kernel_relaxed_c.h", "krelaxed", CONEMAP_KERNEL_EXACT, CONEMAP_RELAXED},
                         {"kernel_octant_c.h", "koctant", CONEMAP_KERNEL_EXACT, CONEMAP_EXACT}};
        static char names[12][3][32];
        d = golden_new(kernels[k].file, NULL, CONEMAP_TRACE_DEFAULT, NULL);
        goldens[golden_count - 1].kernel = (int)kernels[k].kernel;
        snprintf(names[k][0], 32, "%s_fetch", kernels[k].prefix);
        snprintf(names[k][1], 32, "%s_state", kernels[k].prefix);
        snprintf(names[k][2], 32, "%s_maxima", kernels[k].prefix);
        d->dialect = CONEMAP_C99;
        d->prefix = kernels[k].prefix;
        d->fetch = names[k][0];
        d->fetch_cones = names[k][1];
        d->fetch_maxima = names[k][2];
        d->map.generator = kernels[k].generator;
        d->map.wrap_v = CONEMAP_WRAP;
        d->map.aspect = 0.75f;
        d->map.texture.format = CONEMAP_UNORM16;
        d->map.texture.encoding = CONEMAP_RADIUS;
        if (k == 11) {
            d->map.texture.sectors = 8;
            d->map.guarantee = CONEMAP_GUARANTEE_VERTEX;
        }
    }
}

static char *emit_any(const conemap_shader_desc *desc, int kernel)
{
    size_t size = 0;
    char *text;
    conemap_result result = kernel < 0 ? conemap_emit(desc, NULL, 0, &size)
                                       : conemap_emit_kernel(desc, (conemap_kernel)kernel, NULL, 0, &size);
    if (!CHECK(result == CONEMAP_OK && size > 100, "emit: %s", conemap_result_string(result))) return NULL;
    text = (char *)test_alloc(size);
    result = kernel < 0 ? conemap_emit(desc, text, size, NULL)
                        : conemap_emit_kernel(desc, (conemap_kernel)kernel, text, size, NULL);
    CHECK(result == CONEMAP_OK && strlen(text) + 1 == size, "emit: %s, %d of %d", conemap_result_string(result),
          (int)strlen(text), (int)size);
    return text;
}

static void golden_files(void)
{
    int k;
    golden_table();
    for (k = 0; k < golden_count; ++k) {
        char *text = emit_any(&goldens[k].desc, goldens[k].kernel);
        if (!text) return;
        golden_text(goldens[k].file, text);
        test_release(text);
    }
}

#ifndef TEST_WRITE
static char *emit(const conemap_shader_desc *desc) { return emit_any(desc, -1); }

static void bind_map(const conemap_map *map)
{
    int k, levels = conemap_maxima_levels(map);
    bound.map = map;
    bound.side = 1 << (levels - 1);
    for (k = 0; k < levels; ++k) {
        size_t side = (size_t)(bound.side >> k), size = side * side * sizeof(float);
        bound.maxima[k] = (float *)test_alloc(size);
        CHECK(conemap_write_maxima(map, k, bound.maxima[k], size) == CONEMAP_OK, "maxima %d", k);
        CHECK(conemap_write_maxima(map, k, bound.maxima[k], size - 1) == CONEMAP_ERROR_BUFFER, "small maxima %d",
              k);
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
                conemap_map map;
                struct truth_map truth;
                conemap_result result = compare_build(shader, goldens[g].generator, kind, sizes[size][0],
                                                      sizes[size][1], 17, heights, &map, &truth);
                REQUIRE(result == CONEMAP_OK, "%s %s", goldens[g].file, zoo_name(kind));
                bind_map(&map);
                for (k = 0; k < 48; ++k) {
                    conemap_ray ray = compare_ray(&random, truth.width, truth.height, k);
                    struct shader_hit hit;
                    if (compare_is_endless(&truth, &ray)) continue;
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
        CHECK(counts.unexplained == 0, "%s: %d rays differ and lie on no edge", goldens[g].file,
              counts.unexplained);
        CHECK(counts.misses == 0, "%s: %d misses", goldens[g].file, counts.misses);
        if (getenv("CONEMAP_SHOW"))
            printf("%-12s rays %d hits %d different %d unexplained %d strict %d misses %d\n", goldens[g].file,
                   counts.rays, counts.hits, counts.different, counts.unexplained, counts.strict_misses,
                   counts.misses);
        all.rays += counts.rays;
        all.different += counts.different;
        all.strict_misses += counts.strict_misses;
    }
    test_note("%d rays in emitted C, %d on edges", all.rays, all.different);
}

/* One texel of what a pass writes. */
static float kernel_texel(const conemap_gpu_pass *pass, const conemap_info *info, int i, int j)
{
    const conemap_generator generator = info->generator;
    const int plain = generator != CONEMAP_RELAXED && info->texture.sectors <= 1;
    const int w = grid.width, h = grid.height;
    kring_ivec2 ring = {w, h};
    kmin_ivec2 least = {w, h};
    ksafe_ivec2 safe = {w, h};
    kstore_ivec2 store = {w, h};
    kcells_ivec2 cells = {w, h};
    ktexels_ivec2 texels = {w, h};
    kquick_ivec2 quick = {w, h};
    kcenter_ivec2 center = {w, h};
    kexact_ivec2 exact = {w, h};
    krelaxed_ivec2 relaxed = {w, h};
    koctant_ivec2 octant = {w, h};
    switch (pass->kernel) {
    case CONEMAP_KERNEL_RING: /* what the others begin with, if anything */
        return plain ? kring_ring(i, j, pass->first, pass->last, ring) : 0.0f;
    case CONEMAP_KERNEL_MIN3X3: return kmin_steepest(i, j, least);
    case CONEMAP_KERNEL_SAFE: return ksafe_safe(i, j, safe);
    case CONEMAP_KERNEL_CELLS: return kcells_highest(i, j, cells);
    case CONEMAP_KERNEL_TEXELS: return ktexels_padded(i, j, texels);
    case CONEMAP_KERNEL_MAXIMA: return kmaxima_four(i, j, pass->level);
    case CONEMAP_KERNEL_QUICK:
        return generator == CONEMAP_QUICK ? kquick_quick(i, j, quick) : kcenter_quick(i, j, center);
    case CONEMAP_KERNEL_EXACT:
        if (generator == CONEMAP_RELAXED) return krelaxed_exact(i, j, pass->first, pass->last, pass->level, relaxed);
        if (!plain) return koctant_exact(i, j, pass->first, pass->last, pass->level, grid.sector, octant);
        return kexact_exact(i, j, pass->first, pass->last, pass->level, exact);
    default: return kstore_stored(i, j, store);
    }
}

/* Runs all passes; the cones, if there are any, come out last. */
static void kernel_passes(const conemap_shader_desc *shader, int batch, float *cones)
{
    static float states[2][4][24 * 31];
    conemap_gpu_pass passes[512];
    int count = 0, k, q, i, j;
    CHECK(conemap_gpu_passes(shader, batch, NULL, 0, &count) == CONEMAP_OK && count >= 2 && count <= 512, "%d passes",
          count);
    passes[count - 1].kernel = CONEMAP_KERNEL_COUNT;
    CHECK(conemap_gpu_passes(shader, batch, passes, count - 1, &count) == CONEMAP_ERROR_BUFFER &&
              passes[count - 1].kernel == CONEMAP_KERNEL_COUNT,
          "too few passes");
    if (!CHECK(conemap_gpu_passes(shader, batch, passes, 512, &count) == CONEMAP_OK, "passes")) return;
    memset(states, 0x7f, sizeof states); /* large numbers: what the state holds at first does not matter */
    for (k = 0; k < count; ++k) {
        const conemap_gpu_pass *pass = &passes[k];
        CHECK(pass->reads != pass->writes && (pass->writes == 2) == (pass->kernel == CONEMAP_KERNEL_STORE), "pass %d", k);
        CHECK(k < count - 1 || pass->writes >= 2, "the last pass");
        CHECK(pass->groups_x * 8 >= pass->width && pass->groups_y * 8 >= pass->height, "pass %d: groups", k);
        if (pass->writes == 3 && pass->level == 0)
            for (grid.top = 0; 1 << grid.top < pass->width;) ++grid.top;
        for (q = 0; q < (shader->map.texture.sectors > 1 && pass->writes != 3 ? 4 : 1); ++q) {
            float *out = pass->writes == 3 ? grid.maxima[pass->level] : states[pass->writes & 1][q];
            grid.sector = pass->sector + q;
            if (pass->writes == 2) out = cones + grid.sector * pass->width * pass->height;
            grid.state = states[pass->reads][q];
            for (j = 0; j < pass->height; ++j)
                for (i = 0; i < pass->width; ++i) out[j * pass->width + i] = kernel_texel(pass, &shader->map, i, j);
        }
    }
}

/* The passes, each texel in turn: cones against the CPU's of the same generator, never wider and narrower by rounding
   only; those made safe against the verifier, which proves them; and the maxima against those that the CPU writes. */
static void kernels_as_c(void)
{
    static const int sizes[][2] = {{1, 1}, {1, 7}, {2, 2}, {17, 13}, {24, 31}};
    static const conemap_generator generators[] = {CONEMAP_RING, CONEMAP_RING,  CONEMAP_RING,
                                                   CONEMAP_EXACT, CONEMAP_QUICK, CONEMAP_QUICK_NAIVE_CENTER,
                                                   CONEMAP_RELAXED, CONEMAP_EXACT};
    static float heights[24 * 31], cones[8 * 24 * 31];
    int kind, size, mode, k, compared = 0, unsafe = 0, levels = 0;
    double aperture = 0.0, safe_aperture = 0.0;
    for (mode = 0; mode < 8; ++mode)
        for (kind = 0; kind < ZOO_KINDS; ++kind)
            for (size = 0; size < (int)(sizeof sizes / sizeof sizes[0]); ++size) {
                const int w = sizes[size][0], h = sizes[size][1], batch = size == 3 ? 1 : size == 4 ? 300 : 0;
                const int safe = mode == 2, planes = mode == 7 ? 8 : 1;
                conemap_desc desc;
                conemap_shader_desc shader;
                conemap_map map;
                if (mode == 7 && size == 4) continue; /* eight times as long */
                memset(&desc, 0, sizeof desc);
                memset(&shader, 0, sizeof shader);
                zoo_fill(kind, w, h, 31, heights);
                desc.heights.pixels = heights;
                desc.heights.width = w;
                desc.heights.height = h;
                desc.wrap_v = CONEMAP_WRAP;
                desc.aspect = 0.75f;
                desc.generator = generators[mode];
                if (desc.generator == CONEMAP_EXACT) desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
                desc.min3x3 = mode == 1;
                desc.keep_pyramid = 1;
                desc.texture.format = CONEMAP_UNORM16;
                desc.texture.encoding = CONEMAP_RADIUS;
                desc.texture.sectors = planes > 1 ? planes : 0;
                if (!CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "%s", zoo_name(kind))) return;
                shader.map = map.info;
                if (safe) shader.map.guarantee = CONEMAP_GUARANTEE_BILINEAR;
                grid.width = w;
                grid.height = h;
                grid.heights = map.heights;
                kernel_passes(&shader, batch, cones);
                if (mode == 1) { /* what the verifier is there for: the correction of [BV24] is not enough */
                    conemap_report report;
                    if (conemap_verify(&map.info, map.heights, cones, NULL, &report) == CONEMAP_OK)
                        unsafe += (int)report.unsafe;
                }
                if (safe) {
                    conemap_report report;
                    CHECK(conemap_verify(&map.info, map.heights, cones, NULL, &report) == CONEMAP_OK &&
                              report.unsafe == 0 && report.unproven == 0,
                          "%s %dx%d: %d cells unsafe, %d unproven", zoo_name(kind), w, h, (int)report.unsafe,
                          (int)report.unproven);
                }
                for (k = 0; k < w * h && safe; ++k) {
                    CHECK(cones[k] <= map.cones[k], "a safe cone is wider");
                    aperture += (double)map.cones[k];
                    safe_aperture += (double)cones[k];
                }
                for (k = 0; k < planes * w * h && !safe; ++k) {
                    const float right = map.cones[k];
                    CHECK(cones[k] <= right && cones[k] >= right - 2.0f / 65535.0f,
                          "%s %dx%d mode %d texel %d: %.9g, right %.9g", zoo_name(kind), w, h, mode, k,
                          (double)cones[k], (double)right);
                    ++compared;
                }
                shader.trace.tracer = CONEMAP_TRACE_MAXMIP;
                if (mode > 5) { /* as before */
                    conemap_free(&map);
                    continue;
                }
                kernel_passes(&shader, batch, NULL);
                CHECK(grid.top + 1 == conemap_maxima_levels(&map), "levels");
                for (k = 0; k <= grid.top; ++k) {
                    static float right[64 * 64];
                    const size_t bytes = sizeof(float) << (2 * (grid.top - k));
                    CHECK(conemap_write_maxima(&map, k, right, bytes) == CONEMAP_OK &&
                              memcmp(right, grid.maxima[k], bytes) == 0,
                          "%s %dx%d: maxima differ at level %d", zoo_name(kind), w, h, k);
                    ++levels;
                }
                conemap_free(&map);
            }
    CHECK(unsafe > 0, "3x3 minima pass as safe");
    test_note("%d cones by kernels, %d levels of maxima; made safe they keep %.0f %%", compared, levels,
              100.0 * safe_aperture / aperture);
}

static void bad_kernels(void)
{
    conemap_shader_desc d;
    conemap_gpu_pass pass;
    size_t size = 5;
    int count = 7;
    memset(&d, 0, sizeof d);
    CHECK(conemap_emit_kernel(NULL, CONEMAP_KERNEL_RING, NULL, 0, &size) == CONEMAP_ERROR_NULL, "null desc");
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_RING, NULL, 0, NULL) == CONEMAP_ERROR_NULL,
          "nothing to write to");
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_COUNT, NULL, 0, &size) == CONEMAP_ERROR_ENUM, "kernel");
    d.map.texture.sectors = 4;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_QUICK, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED, "quick sectors");
    d.map.generator = CONEMAP_RELAXED;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_EXACT, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED,
          "relaxed sectors");
    d.map.generator = CONEMAP_GENERATE_DEFAULT;
    d.map.texture.sectors = 2;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_RING, NULL, 0, &size) == CONEMAP_ERROR_PARAMETER, "two sectors");
    d.map.texture.sectors = 0;
    d.stage = CONEMAP_STAGE_COMPUTE;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_RING, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED,
          "compute in GLSL 330");
    d.dialect = CONEMAP_ESSL_310;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_STORE, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED,
          "two channels in ES");
    d.map.texture.layout = CONEMAP_DUMMER;
    d.map.texture.format = CONEMAP_UNORM16;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_STORE, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED,
          "16-bit images in ES");
    d.dialect = CONEMAP_WGSL;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_STORE, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED,
          "16-bit images in WGSL");
    d.map.texture.layout = CONEMAP_HEIGHT_CONE;
    d.map.texture.format = CONEMAP_F16;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_STORE, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED,
          "two channels of 16 bits in WGSL");
    d.dialect = CONEMAP_ESSL_310;
    d.map.texture.layout = CONEMAP_DUMMER;
    d.map.texture.format = CONEMAP_F32;
    d.stage = CONEMAP_STAGE_FUNCTIONS;
    d.fetch = "heights_of_mine";
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_EXACT, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED, "no state");
    d.fetch_cones = "state_of_mine";
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_EXACT, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED, "no maxima");
    d.fetch = NULL;
    CHECK(conemap_emit_kernel(&d, CONEMAP_KERNEL_RING, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED, "no heights");
    d.fetch_cones = NULL;
    CHECK(size == 5, "a size was written");
    CHECK(conemap_gpu_passes(NULL, 0, &pass, 1, &count) == CONEMAP_ERROR_NULL, "null desc");
    CHECK(conemap_gpu_passes(&d, 0, &pass, 1, &count) == CONEMAP_ERROR_SIZE, "no size");
    d.map.width = d.map.height = 4;
    CHECK(conemap_gpu_passes(&d, -1, &pass, 1, &count) == CONEMAP_ERROR_PARAMETER && count == 7, "batch");
    d.map.generator = CONEMAP_HYBRID;
    CHECK(conemap_gpu_passes(&d, 0, &pass, 1, &count) == CONEMAP_ERROR_UNSUPPORTED && count == 7, "hybrid");
    d.map.generator = CONEMAP_RELAXED_SAMPLED;
    CHECK(conemap_gpu_passes(&d, 0, &pass, 1, &count) == CONEMAP_ERROR_UNSUPPORTED && count == 7, "sampled");
    d.map.generator = CONEMAP_GENERATOR_COUNT;
    CHECK(conemap_gpu_passes(&d, 0, &pass, 1, &count) == CONEMAP_ERROR_ENUM, "generator");
    d.map.generator = CONEMAP_EXACT;
    d.trace.tracer = (conemap_tracer)-1;
    CHECK(conemap_gpu_passes(&d, 0, &pass, 1, &count) == CONEMAP_ERROR_ENUM, "tracer");
    d.trace.tracer = CONEMAP_TRACE_DEFAULT;
    d.map.wrap_u = CONEMAP_WRAP_COUNT;
    CHECK(conemap_gpu_passes(&d, 0, &pass, 1, &count) == CONEMAP_ERROR_ENUM, "wrap");
    d.map.wrap_u = CONEMAP_CLAMP;
    d.map.texture.sectors = 4;
    d.map.generator = CONEMAP_RING;
    CHECK(conemap_gpu_passes(&d, 0, &pass, 1, &count) == CONEMAP_ERROR_UNSUPPORTED, "sectors by rings");
    d.map.texture.sectors = 3;
    CHECK(conemap_gpu_passes(&d, 0, &pass, 1, &count) == CONEMAP_ERROR_PARAMETER && count == 7, "three sectors");
}

/* ---- what is refused, and sizes ---- */

static void bad_input(void)
{
    static const struct {
        int what;
        conemap_result result;
    } cases[] = {
        {0, CONEMAP_ERROR_ENUM},         {1, CONEMAP_ERROR_ENUM},         {2, CONEMAP_ERROR_ENUM},
        {3, CONEMAP_ERROR_ENUM},         {4, CONEMAP_ERROR_ENUM},         {5, CONEMAP_ERROR_ENUM},
        {6, CONEMAP_ERROR_ENUM},         {7, CONEMAP_ERROR_PARAMETER},    {8, CONEMAP_ERROR_PARAMETER},
        {9, CONEMAP_ERROR_PARAMETER},    {10, CONEMAP_ERROR_PARAMETER},   {11, CONEMAP_ERROR_PARAMETER},
        {12, CONEMAP_ERROR_PARAMETER},   {13, CONEMAP_ERROR_PARAMETER},   {14, CONEMAP_ERROR_SIZE},
        {15, CONEMAP_ERROR_UNSUPPORTED}, {16, CONEMAP_ERROR_UNSUPPORTED}, {17, CONEMAP_ERROR_UNSUPPORTED},
        {18, CONEMAP_ERROR_UNSUPPORTED}, {19, CONEMAP_ERROR_UNSUPPORTED}, {20, CONEMAP_ERROR_UNSUPPORTED},
        {21, CONEMAP_ERROR_UNSUPPORTED}, {22, CONEMAP_ERROR_UNSUPPORTED}, {23, CONEMAP_ERROR_UNSUPPORTED},
        {24, CONEMAP_ERROR_UNSUPPORTED}, {25, CONEMAP_ERROR_PARAMETER},   {26, CONEMAP_ERROR_PARAMETER},
        {27, CONEMAP_ERROR_PARAMETER},   {28, CONEMAP_ERROR_PARAMETER},   {29, CONEMAP_ERROR_PARAMETER},
        {30, CONEMAP_ERROR_PARAMETER},   {31, CONEMAP_ERROR_PARAMETER},   {32, CONEMAP_ERROR_PARAMETER},
        {33, CONEMAP_ERROR_UNSUPPORTED}, {34, CONEMAP_ERROR_PARAMETER},   {35, CONEMAP_ERROR_PARAMETER},
        {36, CONEMAP_ERROR_UNSUPPORTED}, {37, CONEMAP_ERROR_UNSUPPORTED}, {38, CONEMAP_ERROR_UNSUPPORTED},
        {39, CONEMAP_ERROR_UNSUPPORTED},
    };
    static const char long_name[] =
        "abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuvwxyz";
    char text[8] = "unhurt";
    size_t size = 77;
    int k;
    for (k = 0; k < (int)(sizeof cases / sizeof cases[0]); ++k) {
        conemap_shader_desc d;
        conemap_result result;
        memset(&d, 0, sizeof d);
        switch (cases[k].what) {
        case 0: d.dialect = (conemap_dialect)CONEMAP_DIALECT_COUNT; break;
        case 1: d.stage = (conemap_stage)-1; break;
        case 2: d.filter = (conemap_filter)3; break;
        case 3: d.map.wrap_v = (conemap_wrap)3; break;
        case 4: d.trace.tracer = (conemap_tracer)99; break;
        case 5: d.map.texture.encoding = (conemap_encoding)3; break;
        case 6: d.precision = (conemap_precision)2; break;
        case 7: d.map.aspect = NAN; break;
        case 8: d.map.max_tan = -1.0f; break;
        case 9: d.binding = -1; break;
        case 10: d.prefix = "1a"; break;
        case 11: d.prefix = long_name; break;
        case 12: d.map_name = "a b"; break;
        case 13: d.prefix = "one", d.map_name = "one"; break;
        case 14: d.fixed_size = 1; break;
        case 15: d.stage = CONEMAP_STAGE_COMPUTE; break;
        case 16: d.filter = CONEMAP_FILTER_HARDWARE; break;
        case 17: d.filter = CONEMAP_FILTER_GATHER; break;
        case 18: /* no fetch_cones */
            d.dialect = CONEMAP_C99;
            d.fetch = "given";
            d.map.texture.sectors = 4;
            break;
        case 19: d.flags = 1u << 31; break;
        case 20: d.dialect = CONEMAP_C99; break;
        case 21: d.set = 1; break;
        case 22: d.sampler_binding = 1; break;
        case 23: d.precision = CONEMAP_MEDIUMP; break;
        case 24: d.atlas = d.fixed_size = 1, d.map.width = d.map.height = 4; break;
        case 25: d.map_name = "ground"; break; /* a name that the text uses itself */
        case 26: d.map_name = "gl_map"; break;
        case 27: d.prefix = "a__b"; break;
        case 28: d.map_name = ""; break;
        case 29: d.trace.step_scale = INFINITY; break;
        case 30: d.map.texture.sectors = 2; break;
        case 31: d.fetch_cones = "a b"; break;
        case 32: d.octants_name = d.heights_name = "one"; break;
        case 34: d.dialect = CONEMAP_WGSL, d.map_name = "select"; break; /* words of the translation */
        case 35: d.dialect = CONEMAP_WGSL, d.map_name = "let"; break;
        case 36: d.dialect = CONEMAP_MSL, d.stage = CONEMAP_STAGE_FRAGMENT, d.fetch = "given"; break;
        case 37: d.dialect = CONEMAP_MSL, d.set = 1; break;
        case 38: /* WGSL promises nothing of depth */
            d.dialect = CONEMAP_WGSL;
            d.stage = CONEMAP_STAGE_FRAGMENT;
            d.flags = CONEMAP_EFFECT_DEPTH;
            d.depth_bound = CONEMAP_DEPTH_GREATER;
            break;
        case 39: d.dialect = CONEMAP_WGSL, d.precision = CONEMAP_MEDIUMP; break;
        default: d.map.texture.sectors = 8, d.map.texture.layout = CONEMAP_DUMMER; break;
        }
        result = conemap_emit(&d, text, sizeof text, &size);
        CHECK(result == cases[k].result, "case %d: %s", cases[k].what, conemap_result_string(result));
        CHECK(size == 77 && strcmp(text, "unhurt") == 0, "case %d: something was written", cases[k].what);
    }
    {
        conemap_shader_desc d;
        memset(&d, 0, sizeof d);
        CHECK(conemap_emit(NULL, text, sizeof text, &size) == CONEMAP_ERROR_NULL, "null desc");
        CHECK(conemap_emit(&d, NULL, 0, NULL) == CONEMAP_ERROR_NULL, "nothing to write to");
        CHECK(conemap_maxima_levels(NULL) == 0 && conemap_write_maxima(NULL, 0, NULL, 0) == CONEMAP_ERROR_NULL,
              "no map");
    }
}

static void cut_short(conemap_dialect dialect)
{
    conemap_shader_desc d;
    size_t size = 0, again = 0, capacity;
    char *whole;
    memset(&d, 0, sizeof d);
    d.dialect = dialect;
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_OK, "size");
    whole = emit(&d);
    if (!whole) return;
    for (capacity = 0; capacity <= size;
         capacity += capacity + 2 < size || capacity == size ? 1 + size / 37 : size - capacity) {
        char *text = (char *)test_alloc(capacity); /* guarded on both sides */
        conemap_result result;
        memset(text, 'x', capacity);
        again = 0;
        result = conemap_emit(&d, text, capacity, &again);
        CHECK(again == size, "size %d, then %d", (int)size, (int)again);
        if (capacity < size)
            CHECK(result == CONEMAP_ERROR_BUFFER && (capacity == 0 || text[0] == 'x'), "capacity %d",
                  (int)capacity);
        else
            CHECK(result == CONEMAP_OK && strcmp(text, whole) == 0, "capacity %d", (int)capacity);
        test_release(text);
    }
    test_release(whole);
}

static void sizes_and_truncation(void)
{
    cut_short(CONEMAP_GLSL_330);
    cut_short(CONEMAP_WGSL);
    cut_short(CONEMAP_MSL);
}

/* Names as long as they may be, with everything on: what WGSL collects has room for all. */
static void long_names(void)
{
    static char names[8][64];
    int k;
    for (k = 0; k < 8; ++k) {
        memset(names[k], 'a' + k, 63);
        names[k][63] = 0;
    }
    for (k = 0; k < 4; ++k) {
        conemap_shader_desc d;
        memset(&d, 0, sizeof d);
        d.dialect = k & 1 ? CONEMAP_WGSL : CONEMAP_MSL;
        d.stage = CONEMAP_STAGE_FRAGMENT;
        d.prefix = names[0];
        d.map_name = names[1];
        d.heights_name = names[2];
        d.map.texture.layout = CONEMAP_CONE_ONLY;
        d.array = d.t_range = 1;
        if (k & 2) {
            d.flags = CONEMAP_EFFECT_ALL_BITS & ~(unsigned)(CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW |
                                                             CONEMAP_EFFECT_OCCLUSION);
        } else {
            d.map.texture.sectors = 8;
            d.octants_name = names[3];
            d.status = d.steps = d.run_time_cap = 1;
        }
        test_release(emit(&d));
    }
}

/* ---- the text itself ---- */

static int letter(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || (c >= '0' && c <= '9');
}

/* Takes the comments out. */
static void strip(char *text)
{
    char *to = text;
    while (*text) {
        if (text[0] == '/' && text[1] == '/')
            while (*text && *text != '\n') ++text;
        if (*text) *to++ = *text++;
    }
    *to = 0;
}

static int uses(const char *text, const char *name, size_t length)
{
    const char *at = text;
    int count = 0;
    while ((at = strstr(at, name)) != NULL) {
        if ((at == text || !letter(at[-1])) && !letter(at[length])) ++count;
        at += length;
    }
    return count;
}

/* Braces balance, lines are indented by them, and what is declared is used: names behind a type occur once more. */
static void check_text(const char *what, char *text, int functions)
{
    static const char *const types[] = {"float",        "int",   "bool",        "vec2",      "vec3",
                                        "vec4",         "ivec2", "ivec4",       "float2",    "float3",
                                        "float4",       "int2",  "int4",        "sampler2D", "sampler2DArray",
                                        "SamplerState", "uint",  "conemap_hit", "Texture2D",
                                        "let",          "var",   "sampler",     "texture2d<float>"};
    int depth = 0, round = 0, k;
    const char *at;
    strip(text);
    for (at = text; *at; ++at) {
        if (*at == '\n' && at[1] && at[1] != '\n' && at[1] != '#') {
            int spaces = 0;
            while (at[1 + spaces] == ' ') ++spaces;
            CHECK(round > 0 || spaces == 4 * (depth - (at[1 + spaces] == '}')) || at[1 + spaces] == 'v',
                  "%s: indented by %d at depth %d: %.40s", what, spaces, depth, at + 1);
        }
        if (*at == '?') CHECK(!strstr(text, "fn "), "%s: a ? in WGSL", what);
        if (*at == '$' || *at == '?')
            CHECK(*at == '?' && at[-1] == ' ' && at[1] == ' ', "%s: a %c is left: %.30s", what, *at, at);
        depth += (*at == '{') - (*at == '}');
        round += (*at == '(') - (*at == ')');
        CHECK(depth >= 0 && round >= 0, "%s: closes too much", what);
    }
    CHECK(depth == 0 && round == 0, "%s: %d braces, %d brackets open", what, depth, round);
    CHECK(!strstr(text, "\nout "), "%s: an output without a location, of which ES 3.0 allows no two", what);
    for (k = 0; k < (int)(sizeof types / sizeof types[0]); ++k) {
        const size_t length = strlen(types[k]);
        for (at = strstr(text, types[k]); at; at = strstr(at + 1, types[k])) {
            const char *name = at + length, *end;
            char word[80];
            if ((at > text && letter(at[-1])) || *name != ' ') continue;
            ++name;
            for (end = name; letter(*end); ++end) continue;
            if (end == name || end - name >= 80) continue;
            memcpy(word, name, (size_t)(end - name));
            word[end - name] = 0;
            if (strcmp(word, "main") == 0 || strcmp(word, "conemap_main") == 0 ||
                (functions && (strcmp(word, "conemap_trace") == 0 || strcmp(word, "conemap_any_hit") == 0)))
                continue;
            /* fields of the answer are for the host */
            if (strcmp(word, "found") == 0 || strcmp(word, "position") == 0 || strcmp(word, "t") == 0 ||
                strcmp(word, "status") == 0)
                continue;
            CHECK(uses(text, word, (size_t)(end - name)) > 1, "%s: %s is never used", what, word);
        }
    }
}

static void texts(void)
{
    int dialect, stage, tracer, refinement, option, count = 0;
    for (dialect = 0; dialect < CONEMAP_DIALECT_COUNT; ++dialect)
        for (stage = 0; stage < CONEMAP_STAGE_COUNT; ++stage)
            for (tracer = 1; tracer < CONEMAP_TRACER_COUNT; ++tracer)
                for (refinement = 0; refinement < CONEMAP_REFINEMENT_COUNT; ++refinement)
                    for (option = 0; option < 16; ++option) {
                        conemap_shader_desc d;
                        size_t size = 0;
                        char what[80], *text;
                        memset(&d, 0, sizeof d);
                        d.dialect = (conemap_dialect)dialect;
                        d.stage = (conemap_stage)stage;
                        d.trace.tracer = (conemap_tracer)tracer;
                        d.trace.refinement = (conemap_refinement)refinement;
                        if (option == 1) d.map.wrap_u = CONEMAP_WRAP;
                        if (option == 2) d.map.wrap_v = CONEMAP_NOTHING, d.status = 1;
                        if (option == 3) d.filter = CONEMAP_FILTER_GATHER;
                        if (option == 4) d.filter = CONEMAP_FILTER_HARDWARE;
                        if (option == 5) d.map.texture.layout = CONEMAP_CONE_ONLY;
                        if (option == 6) d.map.texture.per_cell = 1, d.array = 1;
                        if (option == 7) d.atlas = 1, d.t_range = 1;
                        if (option == 8) d.map.guarantee = CONEMAP_GUARANTEE_VERTEX, d.steps = 1;
                        if (option == 9) d.fixed_size = 1, d.map.width = 64, d.map.height = 32;
                        if (option == 10) d.trace.any_hit = 1;
                        if (option == 11)
                            d.map.texture.encoding = CONEMAP_RADIUS, d.run_time_cap = 1,
                            d.trace.adaptive_steps = 1;
                        if (option == 12) d.map.texture.sectors = 4;
                        if (option == 13) d.map.texture.sectors = 8, d.array = 1;
                        if (option == 14) d.map.texture.sectors = 8, d.filter = CONEMAP_FILTER_HARDWARE;
                        if (option == 15)
                            d.map.texture.sectors = 4, d.map.texture.per_cell = 1,
                            d.filter = CONEMAP_FILTER_GATHER;
                        if (conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED) continue;
                        text = emit(&d);
                        if (!text) return;
                        snprintf(what, sizeof what, "dialect %d stage %d tracer %d refinement %d option %d",
                                 dialect, stage, tracer, refinement, option);
                        check_text(what, text, stage == CONEMAP_STAGE_FUNCTIONS);
                        test_release(text);
                        ++count;
                    }
    CHECK(count > 1000, "%d texts", count);
    test_note("%d texts", count);
}

static int lines_of(const char *text)
{
    int lines = 0;
    for (; *text; ++text) lines += *text == '\n';
    return lines;
}

/* The defaults stay short: a person reads them in a debugger. A whole fragment shader, comments and all, is under 60
   lines, and none of them is so for its length. */
static void length(void)
{
    conemap_shader_desc d;
    char *text, *at;
    int lines = 0, columns = 0, whole, widest = 0;
    memset(&d, 0, sizeof d);
    d.stage = CONEMAP_STAGE_FRAGMENT;
    text = emit(&d);
    if (!text) return;
    whole = lines_of(text);
    CHECK(whole < 60, "%d lines", whole);
    CHECK(strstr(text, "// conemap_trace(origin, direction): ") != NULL, "no comment");
    for (at = text; *at; ++at) {
        columns = *at == '\n' ? 0 : columns + 1;
        if (columns > widest) widest = columns;
    }
    CHECK(widest <= 125, "%d columns", widest);
    test_release(text);
    d.stage = CONEMAP_STAGE_FUNCTIONS;
    text = emit(&d);
    if (!text) return;
    strip(text);
    for (columns = 0, at = text; *at; ++at) {
        columns = *at == '\n' ? 0 : columns + (*at != ' ');
        lines += columns == 1 && *at != ' ';
    }
    CHECK(lines < 60, "%d lines of code", lines);
    test_note("a default fragment shader is %d lines, functions are %d of code", whole, lines);
    test_release(text);
}

/* Numbers come back to the bit: step_scale and aspect stand in the text with nine digits. */
static void numbers(void)
{
    struct zoo_random random = zoo_seed(3);
    int k;
    for (k = 0; k < 400; ++k) {
        conemap_shader_desc d;
        char *text, *at;
        float scale = zoo_unit(&random) * (k % 4 == 0   ? 1e6f
                                           : k % 4 == 1 ? 1e-6f
                                           : k % 4 == 2 ? 3.0f
                                                        : 1000.0f),
              back;
        if (k < 8) scale = (float)k * 0.25f + 0.25f;
        if (scale == 0.0f || scale == 1.0f) continue;
        memset(&d, 0, sizeof d);
        d.trace.step_scale = scale;
        text = emit(&d);
        if (!text) return;
        at = strstr(text, "closing > 0.0 ? ");
        back = at ? strtof(at + 16, NULL) : 0.0f;
        CHECK(back == scale, "%.9g is written %.20s", (double)scale, at ? at + 16 : "nowhere");
        test_release(text);
    }
}
#endif

const struct test_case emit_tests[] = {
    {"golden files", golden_files},
#ifndef TEST_WRITE
    {"kernels as C", kernels_as_c},
    {"bad kernels", bad_kernels},
    {"bad input", bad_input},
    {"sizes and truncation", sizes_and_truncation},
    {"long names", long_names},
    {"texts", texts},
    {"length", length},
    {"numbers", numbers},
    {"runs as C", runs_as_c},
#endif
    {NULL, NULL},
};
