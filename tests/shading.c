/* Emitted effects: the C dialect against conemap_shade, bad input, and that an effect which is off adds nothing. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "golden.h"
#include "shade_compare.h"
#include "test.h"
#include "zoo.h"

#ifndef TEST_WRITE
/* ---- the emitted C; each text is one set of effects ---- */

static struct shade_bound shade_bound;

#include "build/written/plain_c.h"
#include "build/written/bent_c.h"
#include "build/written/sky_c.h"
#include "build/written/mip_c.h"
#include "build/written/sieve_c.h"

SHADE_FETCH(plain)
SHADE_FETCH_LEVEL(bent)
SHADE_ALPHA(bent)
SHADE_FETCH(sky)
SHADE_FETCH_LEVEL(mip)
SHADE_FETCH(sieve)
SHADE_ALPHA(sieve)

static struct shade_answer plain_run(const struct shade_job *job)
{
    plain_effects e;
    SHADE_START(plain)
    SHADE_CLIPPED(plain)
    SHADE_LIT(plain)
    SHADE_PROJECT(plain)
    SHADE_FADE(plain)
    s = plain_shade(e, frame, o, d, SHADE_GRADIENT(plain), size);
    shade_put(a.s.position, s.position.x, s.position.y, s.position.z);
    shade_put(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.depth = s.depth;
    a.s.shadow = s.shadow;
    a.s.occlusion = s.occlusion;
    a.s.fade = s.fade;
    CHECK(s.uv.x == s.box.x && s.uv.y == s.box.y && s.gradient.w == job->gradient.dvdy, "uv");
    SHADE_FINISH
}

static struct shade_answer bent_run(const struct shade_job *job)
{
    bent_effects e;
    SHADE_START(bent)
    SHADE_CURVE(bent)
    SHADE_CLIPPED(bent)
    SHADE_LIT(bent)
    SHADE_PROJECT(bent)
    SHADE_SOFT(bent)
    SHADE_PIERCED(bent)
    SHADE_LOD(bent)
    SHADE_FADE(bent)
    s = bent_shade(e, frame, o, d, SHADE_GRADIENT(bent), size);
    shade_put(a.s.position, s.position.x, s.position.y, s.position.z);
    shade_put(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.depth = s.depth;
    a.s.shadow = s.shadow;
    a.s.occlusion = s.occlusion;
    a.s.level = s.level;
    a.s.fade = s.fade;
    SHADE_FINISH
}

static struct shade_answer sky_run(const struct shade_job *job)
{
    sky_effects e;
    SHADE_START(sky)
    SHADE_CURVE(sky)
    SHADE_LIT(sky)
    SHADE_SKY(sky)
    s = sky_shade(e, frame, o, d, size);
    shade_put(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.shadow = s.shadow;
    a.s.occlusion = s.occlusion;
    SHADE_FINISH
}

static struct shade_answer mip_run(const struct shade_job *job)
{
    mip_effects e;
    SHADE_START(mip)
    SHADE_LIT(mip)
    SHADE_LOD(mip)
    s = mip_shade(e, frame, o, d, SHADE_GRADIENT(mip), size);
    shade_put(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.shadow = s.shadow;
    a.s.level = s.level;
    SHADE_FINISH
}

static struct shade_answer sieve_run(const struct shade_job *job)
{
    sieve_effects e;
    SHADE_START(sieve)
    SHADE_LIT(sieve)
    SHADE_PIERCED(sieve)
    s = sieve_shade(e, frame, o, d, job->ray.t_min, job->ray.t_max, size);
    shade_put(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.shadow = s.shadow;
    SHADE_FINISH
}
#define RUN_OF(p) p##_run
#else
#define RUN_OF(p) NULL
#endif

static const struct set {
    const char *file, *prefix;
    struct shade_answer (*run)(const struct shade_job *job);
    unsigned flags;
    conemap_wrap wrap_u, wrap_v;
    float aspect;
    int t_range;
    conemap_encoding encoding;
} sets[] = {
    {"plain_c.h", "plain", RUN_OF(plain),
     CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_POSITION |
         CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_OCCLUSION |
         CONEMAP_EFFECT_UV,
     CONEMAP_CLAMP, CONEMAP_WRAP, 0.6f, 0, CONEMAP_LINEAR},
    {"bent_c.h", "bent", RUN_OF(bent),
     CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE |
         CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_DEPTH |
         CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_UV,
     CONEMAP_WRAP, CONEMAP_WRAP, 1.0f, 0, CONEMAP_SQRT},
    {"sky_c.h", "sky", RUN_OF(sky),
     CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SKY, CONEMAP_NOTHING,
     CONEMAP_WRAP, 0.5f, 0, CONEMAP_LINEAR},
    {"mip_c.h", "mip", RUN_OF(mip), CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_SHADOW,
     CONEMAP_CLAMP, CONEMAP_NOTHING, 1.0f, 0, CONEMAP_LINEAR},
    {"sieve_c.h", "sieve", RUN_OF(sieve), CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW,
     CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 1, CONEMAP_RADIUS},
};
enum { SETS = sizeof sets / sizeof sets[0] };

static void set_desc(const struct set *set, char *fetch, size_t size, conemap_shader_desc *d)
{
    memset(d, 0, sizeof *d);
    d->dialect = CONEMAP_C99;
    d->prefix = set->prefix;
    snprintf(fetch, size, "%s_fetch", set->prefix);
    d->fetch = fetch;
    d->flags = set->flags;
    d->map.wrap_u = set->wrap_u;
    d->map.wrap_v = set->wrap_v;
    d->map.aspect = set->aspect;
    d->map.texture.encoding = set->encoding;
    d->t_range = set->t_range;
}

static char *emit(const conemap_shader_desc *desc)
{
    size_t size = 0;
    char *text;
    conemap_result result = conemap_emit(desc, NULL, 0, &size);
    if (!CHECK(result == CONEMAP_OK && size > 100, "emit: %s", conemap_result_string(result))) return NULL;
    text = (char *)test_alloc(size);
    result = conemap_emit(desc, text, size, NULL);
    CHECK(result == CONEMAP_OK && strlen(text) + 1 == size, "emit: %s", conemap_result_string(result));
    return text;
}

static void golden_files(void)
{
    int k;
    for (k = 0; k < SETS; ++k) {
        conemap_shader_desc desc;
        char fetch[32], *text;
        set_desc(&sets[k], fetch, sizeof fetch, &desc);
        text = emit(&desc);
        if (!text) return;
        golden_text(sets[k].file, text);
        test_release(text);
    }
}

#ifndef TEST_WRITE
/* ---- against conemap_shade ---- */

static void runs_as_c(void)
{
    static const int sizes[][2] = {{1, 5}, {17, 13}, {32, 32}, {48, 31}};
    static const int kinds[] = {ZOO_FLAT_1, ZOO_RAMP, ZOO_BRICKS, ZOO_FBM, ZOO_SPIKES, ZOO_CLIFF, ZOO_SADDLE};
    static float heights[SHADE_MOST * SHADE_MOST];
    int n, m, size, k, rays = 0, different = 0;
    for (n = 0; n < SETS; ++n) {
        const struct set *set = &sets[n];
        struct zoo_random random = zoo_seed(11 + (uint64_t)n);
        struct shade_counts counts;
        memset(&counts, 0, sizeof counts);
        for (m = 0; m < (int)(sizeof kinds / sizeof kinds[0]); ++m)
            for (size = 0; size < 4; ++size) {
                const int w = sizes[size][0], h = sizes[size][1], levels = size == 0 ? 1 : SHADE_LEVELS;
                conemap_desc desc;
                memset(&desc, 0, sizeof desc);
                zoo_fill(kinds[m], w, h, 5, heights);
                desc.heights.pixels = heights;
                desc.heights.width = w;
                desc.heights.height = h;
                desc.wrap_u = set->wrap_u;
                desc.wrap_v = set->wrap_v;
                desc.aspect = set->aspect;
                desc.texture.encoding = set->encoding;
                shade_alpha(w, h, shade_bound.alpha);
                REQUIRE(conemap_build_levels(&desc, shade_bound.levels, levels) == CONEMAP_OK, "build");
                for (k = 0; k < 30; ++k) {
                    struct shade_job job;
                    struct shade_answer answer;
                    conemap_effects e;
                    conemap_frame shape;
                    shade_settings(&random, set->flags, shade_bound.levels, levels, shade_bound.alpha, &e);
                    shade_shape(&random, set->flags, set->aspect, &shape);
                    shade_draw(&random, &e, &shape, set->t_range, &job);
                    answer = set->run(&job);
                    CHECK(shade_compare(&shade_bound.levels[0], NULL, &job, &answer, &random, &counts), "%s: shade",
                          set->prefix);
                }
                for (k = 0; k < levels; ++k) conemap_free(&shade_bound.levels[k]);
            }
        CHECK(counts.hits * 4 > counts.rays, "%s: %d hits of %d", set->prefix, counts.hits, counts.rays);
        CHECK(counts.different * 100 < counts.rays, "%s: %d of %d differ", set->prefix, counts.different, counts.rays);
        CHECK(counts.unexplained == 0, "%s: %d of %d differ off the edges (%x)", set->prefix, counts.unexplained,
              counts.rays, counts.what);
        rays += counts.rays;
        different += counts.different;
    }
    test_note("%d rays in emitted C, %d on edges", rays, different);
}

/* ---- the text: an effect that is off leaves nothing behind, one that is on is there ---- */

static int has_word(const char *text, const char *word)
{
    const size_t length = strlen(word);
    const char *at = text;
    while ((at = strstr(at, word)) != NULL) {
        const char before = at == text ? ' ' : at[-1], after = at[length];
        const int inner = (before >= 'a' && before <= 'z') || before == '_';
        const int more = (after >= 'a' && after <= 'z') || after == '_';
        if (!inner && !more) return 1;
        at += length;
    }
    return 0;
}

/* For each effect a word that only its lines have. */
static const struct {
    unsigned flag;
    const char *word;
} marks[] = {
    {CONEMAP_EFFECT_CLIP, "e.clip.x"},
    {CONEMAP_EFFECT_HOLES, "conemap_alpha"},
    {CONEMAP_EFFECT_CURVED, "curvature"},
    {CONEMAP_EFFECT_LOD, "lod_bias"},
    {CONEMAP_EFFECT_LOD, "conemap_level_size"},
    {CONEMAP_EFFECT_FADE, "conemap_fade_of"},
    {CONEMAP_EFFECT_TWO_SIDED, "toward"},
    {CONEMAP_EFFECT_POSITION, "s.position"},
    {CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL, "s.normal"},
    {CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_OCCLUSION, "conemap_difference"},
    {CONEMAP_EFFECT_DEPTH, "clip_w"},
    {CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW, "conemap_toward"},
    {CONEMAP_EFFECT_SOFT_SHADOW, "conemap_soft_shadow"},
    {CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY, "conemap_horizon"},
    {CONEMAP_EFFECT_OCCLUSION, "hill"},
    {CONEMAP_EFFECT_SKY, "conemap_sky"},
    {CONEMAP_EFFECT_UV, "conemap_color"},
    {CONEMAP_EFFECT_UV | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE, "gradient"},
    {CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_HOLES, "conemap_fly"},
};

static void off_is_off(void)
{
    int a, b, stage, count = 0;
    unsigned k;
    for (stage = CONEMAP_STAGE_FUNCTIONS; stage <= CONEMAP_STAGE_COMPUTE; ++stage)
        for (a = 0; a < 15; ++a)
            for (b = a; b < 15; ++b) {
                conemap_shader_desc d;
                size_t size = 0;
                char *text;
                memset(&d, 0, sizeof d);
                d.dialect = CONEMAP_GLSL_450;
                d.stage = (conemap_stage)stage;
                d.map.texture.sectors = stage == CONEMAP_STAGE_COMPUTE ? 8 : 0;
                d.flags = 1u << a | 1u << b;
                if (conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED) continue;
                text = emit(&d);
                if (!text) return;
                ++count;
                for (k = 0; k < sizeof marks / sizeof marks[0]; ++k) {
                    const int on = (d.flags & marks[k].flag) != 0, there = has_word(text, marks[k].word);
                    CHECK(there == on, "flags %x: %s is %sthere", d.flags, marks[k].word, there ? "" : "not ");
                }
                test_release(text);
            }
    CHECK(count == 3 * (15 * 16 / 2 - 3), "%d texts", count);
}

static void bad_input(void)
{
    static const struct {
        unsigned flags;
        int dialect, stage, tracer, filter, field; /* field: what else is set */
    } cases[] = {
        {1u << 15, 0, 0, 0, 0, 0},
        {0x80000000u, 0, 0, 0, 0, 0},
        {CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL, 0, 0, 0, 0, 0},
        {CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW, 0, 0, 0, 0, 0},
        {CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY, 0, 0, 0, 0, 0},
        {CONEMAP_EFFECT_UV, CONEMAP_GLSL_330, CONEMAP_STAGE_COMPUTE, 0, 0, 0},
        {CONEMAP_EFFECT_UV, CONEMAP_ESSL_300, CONEMAP_STAGE_COMPUTE, 0, 0, 0},
        {CONEMAP_EFFECT_DEPTH, CONEMAP_GLSL_450, CONEMAP_STAGE_COMPUTE, 0, 0, 8},
        {CONEMAP_EFFECT_NORMAL, CONEMAP_GLSL_450, 0, 0, CONEMAP_FILTER_GATHER, 0},
        {CONEMAP_EFFECT_LOD, CONEMAP_GLSL_450, 0, 0, CONEMAP_FILTER_GATHER, 0},
        {CONEMAP_EFFECT_SHADOW, 0, 0, CONEMAP_TRACE_LINEAR, 0, 0},
        {CONEMAP_EFFECT_CURVED, 0, 0, CONEMAP_TRACE_CELL_MAX, 0, 0},
        {CONEMAP_EFFECT_OCCLUSION, 0, 0, CONEMAP_TRACE_MAXMIP, 0, 0},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 1},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 2},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 3},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 4},
        {CONEMAP_EFFECT_LOD, 0, 0, 0, 0, 5},
        {CONEMAP_EFFECT_LOD, 0, 0, 0, 0, 6},
        {CONEMAP_EFFECT_CURVED, 0, 0, 0, 0, 7},
        {CONEMAP_EFFECT_POSITION, CONEMAP_GLSL_450, CONEMAP_STAGE_FRAGMENT, 0, 0, 8},
        {CONEMAP_EFFECT_DEPTH, CONEMAP_GLSL_450, CONEMAP_STAGE_FUNCTIONS, 0, 0, 8},
        {CONEMAP_EFFECT_DEPTH, CONEMAP_GLSL_330, CONEMAP_STAGE_FRAGMENT, 0, 0, 8},
        {CONEMAP_EFFECT_DEPTH, CONEMAP_ESSL_310, CONEMAP_STAGE_FRAGMENT, 0, 0, 8},
        {CONEMAP_EFFECT_SHADOW, 0, 0, CONEMAP_TRACE_LOOP, 0, 9},
    };
    conemap_shader_desc d;
    size_t size = 7;
    char *text, *whole;
    int k;
    for (k = 0; k < (int)(sizeof cases / sizeof cases[0]); ++k) {
        const int field = cases[k].field;
        conemap_result result;
        memset(&d, 0, sizeof d);
        d.flags = cases[k].flags;
        d.dialect = (conemap_dialect)cases[k].dialect;
        d.stage = (conemap_stage)cases[k].stage;
        d.trace.tracer = (conemap_tracer)cases[k].tracer;
        d.filter = (conemap_filter)cases[k].filter;
        if (field == 1) d.trace.any_hit = 1;
        if (field == 2) d.steps = 1;
        if (field == 3) d.status = 1;
        if (field == 4) d.run_time_cap = 1;
        if (field == 5) d.fixed_size = 1, d.map.width = d.map.height = 64;
        if (field == 6) d.atlas = 1;
        if (field == 7) d.map.guarantee = CONEMAP_GUARANTEE_RELAXED;
        if (field == 8) d.depth_bound = CONEMAP_DEPTH_GREATER;
        if (field == 9) d.map.texture.sectors = 4;
        result = conemap_emit(&d, NULL, 0, &size);
        CHECK(result == CONEMAP_ERROR_UNSUPPORTED && size == 7, "case %d: %s", k, conemap_result_string(result));
    }
    memset(&d, 0, sizeof d);
    d.flags = CONEMAP_EFFECT_DEPTH;
    d.depth_bound = (conemap_depth_bound)CONEMAP_DEPTH_BOUND_COUNT;
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_ENUM, "depth bound");
    d.depth_bound = (conemap_depth_bound)-1;
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_ENUM, "depth bound");
    d.depth_bound = CONEMAP_DEPTH_ANY;
    d.prefix = "relief";
    d.map_name = "curvature"; /* a word of the text, but of no line that is written */
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_OK, "name");
    d.flags |= CONEMAP_EFFECT_CURVED;
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_PARAMETER, "name");
    d.map_name = NULL;
    whole = emit(&d);
    if (!whole) return;
    for (k = 0; k < 3; ++k) { /* a byte too few writes nothing */
        const size_t needed = strlen(whole) + 1, capacity = k == 0 ? 1 : k == 1 ? needed - 1 : needed;
        conemap_result result;
        text = (char *)test_alloc(capacity);
        text[0] = 'x';
        result = conemap_emit(&d, text, capacity, NULL);
        CHECK(capacity < needed ? result == CONEMAP_ERROR_BUFFER && text[0] == 'x'
                                : result == CONEMAP_OK && strcmp(text, whole) == 0,
              "capacity %d", (int)capacity);
        test_release(text);
    }
    test_release(whole);
}
#endif

const struct test_case shading_tests[] = {
    {"golden files", golden_files},
#ifndef TEST_WRITE
    {"off is off", off_is_off},
    {"bad input", bad_input},
    {"runs as C", runs_as_c},
#endif
    {NULL, NULL},
};
