/* Effects as emitted C against conemap_shade: every one, every pair, everything together and a seeded sample, each with
   settings of its own. Built twice: first it prints the texts, each with a function that runs it; built with AGREE_TEXT,
   the name of a file that holds them, it runs these. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#define CONEMAP_IMPLEMENTATION
#include "conemap.h"

#include "../shade_compare.h"

enum { RAYS = 120, SAMPLE = 40, MOST_VARIANTS = 300 };

struct variant {
    unsigned flags;
    conemap_wrap wrap_u, wrap_v;
    conemap_texture texture;
    float aspect;
    int t_range;
};

static int make_variants(struct variant *variants)
{
    struct zoo_random random = zoo_seed(73);
    unsigned sets[MOST_VARIANTS];
    const int count = shade_sets(SAMPLE, &random, sets);
    int k;
    memset(variants, 0, MOST_VARIANTS * sizeof *variants);
    for (k = 0; k < count; ++k) {
        struct variant *v = &variants[k];
        v->flags = sets[k];
        v->wrap_u = (conemap_wrap)zoo_below(&random, 3);
        v->wrap_v = (conemap_wrap)zoo_below(&random, 3);
        v->texture.encoding = (conemap_encoding)zoo_below(&random, 3);
        v->texture.per_cell = zoo_below(&random, 3) == 0 && v->texture.encoding != CONEMAP_RADIUS;
        v->texture.sectors = zoo_below(&random, 3) * 4;
        v->aspect = zoo_below(&random, 2) ? 0.6f : 1.0f;
        v->t_range = zoo_below(&random, 3) == 0;
    }
    return count;
}

#ifndef AGREE_TEXT

static void write_variant(const struct variant *v, int number)
{
    static char text[100000];
    static const struct {
        unsigned flags;
        const char *line;
    } lines[] = {
        {CONEMAP_EFFECT_CURVED, "SHADE_CURVE"},
        {CONEMAP_EFFECT_CLIP, "SHADE_CLIPPED"},
        {CONEMAP_EFFECT_DEPTH, "SHADE_PROJECT"},
        {CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW, "SHADE_LIT"},
        {CONEMAP_EFFECT_SOFT_SHADOW, "SHADE_SOFT"},
        {CONEMAP_EFFECT_SKY, "SHADE_SKY"},
        {CONEMAP_EFFECT_HOLES, "SHADE_PIERCED"},
        {CONEMAP_EFFECT_LOD, "SHADE_LOD"},
        {CONEMAP_EFFECT_FADE, "SHADE_FADE"},
    };
    static const struct {
        unsigned flags;
        const char *line;
    } answers[] = {
        {CONEMAP_EFFECT_POSITION, "shade_put(a.s.position, s.position.x, s.position.y, s.position.z);"},
        {CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL, "shade_put(a.s.normal, s.normal.x, s.normal.y, s.normal.z);"},
        {CONEMAP_EFFECT_DEPTH, "a.s.depth = s.depth;"},
        {CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW, "a.s.shadow = s.shadow;"},
        {CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY, "a.s.occlusion = s.occlusion;"},
        {CONEMAP_EFFECT_LOD, "a.s.level = s.level;"},
        {CONEMAP_EFFECT_FADE, "a.s.fade = s.fade;"},
        {CONEMAP_EFFECT_UV, "CHECK(s.uv.x == s.box.x && s.uv.y == s.box.y && s.gradient.w == job->gradient.dvdy, \"uv\");"},
    };
    const int set = (v->flags & (CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW |
                                 CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY | CONEMAP_EFFECT_HOLES |
                                 CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE)) != 0;
    const int graded = (v->flags & (CONEMAP_EFFECT_UV | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE)) != 0;
    conemap_shader_desc d;
    conemap_result result;
    char p[8], fetch[24], cones[24];
    size_t k;
    sprintf(p, "v%03d", number);
    sprintf(fetch, "%s_fetch", p);
    sprintf(cones, "%s_cones", p);
    memset(&d, 0, sizeof d);
    d.dialect = CONEMAP_C99;
    d.flags = v->flags;
    d.prefix = p;
    d.fetch = fetch;
    d.fetch_cones = cones;
    d.map.wrap_u = v->wrap_u;
    d.map.wrap_v = v->wrap_v;
    d.map.texture = v->texture;
    d.map.aspect = v->aspect;
    d.t_range = v->t_range;
    result = conemap_emit(&d, text, sizeof text, NULL);
    if (result != CONEMAP_OK) {
        fprintf(stderr, "%s, flags %x: %s\n", p, v->flags, conemap_result_string(result));
        exit(1);
    }
    printf("%s\nSHADE_FETCH%s%s(%s)\n", text, v->texture.sectors ? "_SECTORS" : "",
           v->flags & CONEMAP_EFFECT_LOD ? "_LEVEL" : "", p);
    if (v->flags & CONEMAP_EFFECT_HOLES) printf("SHADE_ALPHA(%s)\n", p);
    printf("static struct shade_answer %s_run(const struct shade_job *job)\n{\n", p);
    if (set) printf("    %s_effects e;\n", p);
    printf("    SHADE_START(%s)\n", p);
    for (k = 0; k < sizeof lines / sizeof lines[0]; ++k)
        if (v->flags & lines[k].flags) printf("    %s(%s)\n", lines[k].line, p);
    printf("    s = %s_shade(%sframe, o, d%s%s", p, set ? "e, " : "",
           v->t_range ? ", job->ray.t_min, job->ray.t_max" : "", graded ? ", SHADE_GRADIENT(" : "");
    printf("%s%s, size);\n", graded ? p : "", graded ? ")" : "");
    for (k = 0; k < sizeof answers / sizeof answers[0]; ++k)
        if (v->flags & answers[k].flags) printf("    %s\n", answers[k].line);
    printf("    SHADE_FINISH\n}\n");
}

int main(void)
{
    static struct variant variants[MOST_VARIANTS];
    const int count = make_variants(variants);
    int k;
    for (k = 0; k < count; ++k) write_variant(&variants[k], k);
    printf("static struct shade_answer (*const runs[])(const struct shade_job *job) = {\n");
    for (k = 0; k < count; ++k) printf("    v%03d_run,\n", k);
    printf("};\n");
    return 0;
}

#else

static int failures;

static int check(int good, const char *format, ...)
{
    va_list arguments;
    if (good || ++failures > 20) return good;
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    printf("\n");
    return 0;
}
#define CHECK(good, ...) check(good, __VA_ARGS__)

static struct shade_bound shade_bound;

#include AGREE_TEXT

/* Builds the levels of a map of this variant's kind; 0 if that fails. */
static int build(const struct variant *v, int number)
{
    static const int sizes[][2] = {{17, 13}, {32, 32}, {48, 31}, {9, 40}};
    static const int kinds[] = {ZOO_RAMP, ZOO_BRICKS, ZOO_FBM, ZOO_SPIKES, ZOO_CLIFF, ZOO_SADDLE};
    static float heights[SHADE_MOST * SHADE_MOST];
    const int *size = sizes[number % 4];
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    zoo_fill(kinds[number % 6], size[0], size[1], (uint32_t)number, heights);
    desc.heights.pixels = heights;
    desc.heights.width = size[0];
    desc.heights.height = size[1];
    desc.wrap_u = v->wrap_u;
    desc.wrap_v = v->wrap_v;
    desc.aspect = v->aspect;
    desc.texture = v->texture;
    shade_alpha(size[0], size[1], shade_bound.alpha);
    return conemap_build_levels(&desc, shade_bound.levels, SHADE_LEVELS) == CONEMAP_OK;
}

int main(void)
{
    static struct variant variants[MOST_VARIANTS];
    const int count = make_variants(variants);
    struct zoo_random random = zoo_seed(17);
    struct shade_counts all;
    int n, k;
    memset(&all, 0, sizeof all);
    for (n = 0; n < count; ++n) {
        const struct variant *v = &variants[n];
        struct shade_counts counts;
        memset(&counts, 0, sizeof counts);
        if (!CHECK(build(v, n), "v%03d: build", n)) break;
        for (k = 0; k < RAYS; ++k) {
            conemap_effects e;
            conemap_frame shape;
            struct shade_job job;
            struct shade_answer answer;
            shade_settings(&random, v->flags, shade_bound.levels, SHADE_LEVELS, shade_bound.alpha, &e);
            shade_shape(&random, v->flags, v->aspect, &shape);
            shade_draw(&random, &e, &shape, v->t_range, &job);
            answer = runs[n](&job);
            CHECK(shade_compare(&shade_bound.levels[0], NULL, &job, &answer, &random, &counts), "v%03d: shade", n);
        }
        for (k = 0; k < SHADE_LEVELS; ++k) conemap_free(&shade_bound.levels[k]);
        CHECK(counts.hits * 6 > counts.rays, "v%03d, flags %x: %d hits of %d", n, v->flags, counts.hits, counts.rays);
        CHECK(counts.unexplained == 0 && counts.different * 20 < counts.rays,
              "v%03d, flags %x: %d of %d rays differ, %d off the edges (%x)", n, v->flags, counts.different, counts.rays,
              counts.unexplained, counts.what);
        all.rays += counts.rays;
        all.hits += counts.hits;
        all.different += counts.different;
        all.unexplained += counts.unexplained;
    }
    printf("effects as C: %d sets, %d rays, %d hits, %d differ from the CPU's, %d of them on no edge\n", count, all.rays,
           all.hits, all.different, all.unexplained);
    return failures != 0;
}

#endif
