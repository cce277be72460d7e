/* Emitted WGSL and MSL, run and compared with the CPU.
     WGSL: `write FOLDER` writes texts and inputs, wgsl.mjs runs them, `compare FOLDER` reads the answers.
     MSL:  `texts FOLDER` writes texts and calls.h; compiled with these as C++ (-DCALLS='"calls.h"', and
           tests/gpu/metal_stdlib in Metal's place) this same program runs them itself: `run`. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "../emit_compare.h"

enum { RAYS = 1024, MOST = 40 };

/* Textures are of four floats, whatever the map's are: slice 1 of 2 of an array, at (5, 3) of an atlas. */
struct image {
    float *texels;
    int width, height, slices, levels;
};
struct inputs { /* images: map, octants, heights, maxima, alpha */
    struct image images[4];
    float rays[RAYS * 8];
    int width, height;
};

struct grid { /* what kernels read and write */
    struct image heights, states[2], maxima, out;
};

#ifdef CALLS
#include <metal_stdlib>
using namespace metal;
template <class T> static T as_texture(const struct image *image)
{
    T texture;
    texture.texels = (float4 *)image->texels;
    texture.width = (uint)image->width;
    texture.height = (uint)image->height;
    texture.levels = (uint)image->levels;
    texture.slices = (uint)image->slices;
    return texture;
}
/* Where a pass writes. */
static texture2d<float, access::write> target(struct grid *g, const conemap_gpu_pass *pass)
{
    struct image *image = pass->writes == 2 ? &g->out : pass->writes == 3 ? &g->maxima : &g->states[pass->writes];
    texture2d<float, access::write> texture = as_texture<texture2d<float, access::write>>(image);
    for (int k = 0; pass->writes == 3 && k < pass->level; ++k) {
        texture.texels += texture.width * texture.height;
        texture.width /= 2;
        texture.height /= 2;
    }
    return texture;
}
#include CALLS
#undef kernel /* words of Metal, which mean nothing from here on */
#undef fragment
#undef vertex
#undef thread
#endif

struct item {
    const char *name;
    conemap_shader_desc desc;
    conemap_generator generator;
};
static struct item items[MOST];
static int item_count, failures;
static long rays_done, different_done;

static void wrong(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    printf("\n");
    ++failures;
}

static conemap_shader_desc *item_new(const char *name, conemap_tracer tracer)
{
    struct item *item = &items[item_count++];
    memset(item, 0, sizeof *item);
    item->name = name;
    item->desc.stage = CONEMAP_STAGE_COMPUTE;
    item->desc.trace.tracer = tracer;
    item->desc.steps = item->desc.status = 1;
    return &item->desc;
}

static void list_items(conemap_dialect dialect)
{
    conemap_shader_desc *d;
    int k;
    item_new("exact", CONEMAP_TRACE_EXACT);
    d = item_new("exact, relaxed, sqrt, wrap, nothing", CONEMAP_TRACE_EXACT);
    d->map.guarantee = CONEMAP_GUARANTEE_RELAXED_BILINEAR;
    d->map.wrap_u = CONEMAP_WRAP;
    d->map.wrap_v = CONEMAP_NOTHING;
    d->map.texture.encoding = CONEMAP_SQRT;
    items[item_count - 1].generator = CONEMAP_RELAXED_EXACT;
    d = item_new("linear, secant", CONEMAP_TRACE_LINEAR);
    d->trace.refinement = CONEMAP_REFINE_SECANT;
    d = item_new("fixed, aspect", CONEMAP_TRACE_FIXED);
    d->map.aspect = 0.5f;
    d = item_new("loop, bisect, adaptive, radius", CONEMAP_TRACE_LOOP);
    d->trace.refinement = CONEMAP_REFINE_BISECT;
    d->trace.adaptive_steps = 1;
    d->map.texture.encoding = CONEMAP_RADIUS;
    d = item_new("exact step, nothing", CONEMAP_TRACE_EXACT_STEP);
    d->map.wrap_u = CONEMAP_NOTHING;
    d = item_new("cell max, secant, a cone a cell", CONEMAP_TRACE_CELL_MAX);
    d->trace.refinement = CONEMAP_REFINE_SECANT;
    d->map.texture.per_cell = 1;
    d = item_new("max-mipmap, gather, range, cap", CONEMAP_TRACE_MAXMIP);
    d->filter = CONEMAP_FILTER_GATHER;
    d->t_range = d->run_time_cap = 1;
    d = item_new("quadtree, wrap", CONEMAP_TRACE_QDM);
    d->map.wrap_v = CONEMAP_WRAP;
    d = item_new("four sectors, a cone a cell", CONEMAP_TRACE_EXACT);
    d->map.texture.sectors = 4;
    d->map.texture.per_cell = 1;
    d->map.aspect = 0.5f;
    d = item_new("eight sectors, radius, wrap", CONEMAP_TRACE_EXACT);
    d->map.texture.sectors = 8;
    d->map.texture.encoding = CONEMAP_RADIUS;
    d->map.wrap_u = CONEMAP_WRAP;
    d = item_new("array, gather, cones alone", CONEMAP_TRACE_EXACT);
    d->array = 1;
    d->filter = CONEMAP_FILTER_GATHER;
    d->map.texture.layout = CONEMAP_CONE_ONLY;
    d->t_range = 1;
    d = item_new("atlas, array, Dummer's layout", CONEMAP_TRACE_EXACT);
    d->atlas = d->array = 1;
    d->map.texture.layout = CONEMAP_DUMMER;
    d->map.wrap_v = CONEMAP_WRAP;
    d = item_new("hardware, cell max", CONEMAP_TRACE_CELL_MAX);
    d->filter = CONEMAP_FILTER_HARDWARE;
    d = item_new("names, fixed size", CONEMAP_TRACE_EXACT);
    d->prefix = "relief";
    d->map_name = "bumps";
    d->binding = 3;
    d->fixed_size = 1;
    d = item_new("any hit", CONEMAP_TRACE_EXACT);
    d->trace.any_hit = 1;
    d->steps = d->status = 0;
    d = item_new("fragments", CONEMAP_TRACE_EXACT);
    d->stage = CONEMAP_STAGE_FRAGMENT;
    for (k = 0; k < item_count; ++k) items[k].desc.dialect = dialect;
}

static struct image image_new(const conemap_shader_desc *d, int width, int height, int levels)
{
    struct image image;
    size_t size = 0;
    int k;
    image.slices = d->array ? 2 : 1;
    image.levels = levels;
    image.width = width + (d->atlas ? 9 : 0);
    image.height = height + (d->atlas ? 7 : 0);
    for (k = 0; k < levels; ++k)
        size += (size_t)(image.width >> k) * (size_t)(image.height >> k) * (size_t)image.slices * 4 * sizeof(float);
    image.texels = (float *)calloc(1, size + 64);
    if (!image.texels) exit(2);
    return image;
}

/* Puts values of a few channels into a level. */
static void image_fill(const conemap_shader_desc *d, struct image *image, int level, int width, int height,
                       int channels, const float *values)
{
    float *from = image->texels;
    int i, j, k;
    for (k = 0; k < level; ++k) from += (image->width >> k) * (image->height >> k) * image->slices * 4;
    if (d->array) from += (image->width >> level) * (image->height >> level) * 4;
    for (j = 0; j < height; ++j)
        for (i = 0; i < width; ++i) {
            const int at = (j + (d->atlas ? 3 : 0)) * (image->width >> level) + i + (d->atlas ? 5 : 0);
            for (k = 0; k < channels; ++k) from[at * 4 + k] = values[(j * width + i) * channels + k];
        }
}

static void prepare(const conemap_shader_desc *d, const conemap_map *map, const conemap_ray *rays, struct inputs *in)
{
    const int w = map->info.width, h = map->info.height, levels = conemap_maxima_levels(map);
    const size_t size = conemap_texture_size(map, 0);
    const int channels = (int)(size / (size_t)(w * h) / sizeof(float)), side = 1 << (levels - 1);
    float *values = (float *)malloc(size + (size_t)side * (size_t)side * sizeof(float));
    int k;
    if (!values) exit(2);
    in->width = w;
    in->height = h;
    for (k = 0; k < 3; ++k) in->images[k] = image_new(d, w, h, 1);
    conemap_write_texture(map, values, size, 0);
    image_fill(d, &in->images[0], 0, w, h, channels, values);
    if (map->info.texture.sectors == 8) {
        conemap_write_texture_at(map, 1, values, size, 0);
        image_fill(d, &in->images[1], 0, w, h, channels, values);
    }
    image_fill(d, &in->images[2], 0, w, h, 1, map->heights);
    in->images[3] = image_new(d, side, side, levels);
    for (k = 0; k < levels; ++k) {
        conemap_write_maxima(map, k, values, (size_t)side * (size_t)side * sizeof(float));
        image_fill(d, &in->images[3], k, side >> k, side >> k, 1, values);
    }
    for (k = 0; k < RAYS; ++k) {
        memcpy(in->rays + 8 * k, rays[k].origin, 12);
        memcpy(in->rays + 8 * k + 4, rays[k].direction, 12);
        in->rays[8 * k + 3] = rays[k].t_min;
        in->rays[8 * k + 7] = rays[k].t_max;
    }
    free(values);
}

/* Which of the images a shader has. */
static int has_image(const conemap_shader_desc *d, int k)
{
    const int blocks = d->trace.tracer >= CONEMAP_TRACE_MAXMIP;
    const int cones = !blocks && d->trace.tracer != CONEMAP_TRACE_LINEAR;
    const int apart = d->map.texture.layout == CONEMAP_CONE_ONLY || d->map.texture.sectors > 1;
    return k == 0   ? cones || !apart
           : k == 1 ? cones && d->map.texture.sectors == 8
           : k == 2 ? apart
                    : blocks;
}

static char text[200000];

static FILE *create(const char *folder, int number, const char *ending)
{
    char path[600];
    FILE *file;
    if (number < 0)
        snprintf(path, sizeof path, "%s/%s", folder, ending);
    else
        snprintf(path, sizeof path, "%s/%d%s", folder, number, ending);
    file = fopen(path, "wb");
    if (!file) {
        printf("%s cannot be written\n", path);
        exit(1);
    }
    return file;
}

static void write_text(const char *folder, int number, const conemap_shader_desc *d)
{
    FILE *file = create(folder, number, d->dialect == CONEMAP_WGSL ? ".wgsl" : ".metal");
    const conemap_result result = conemap_emit(d, text, sizeof text, NULL);
    if (result != CONEMAP_OK) wrong("%s: %s", items[number].name, conemap_result_string(result));
    fputs(text, file);
    fclose(file);
}

/* WGSL: what wgsl.mjs has to bind. In the order of the docs: textures, sampler, rays, hits, arguments. */
static void write_bindings(const char *folder, int number, const conemap_shader_desc *d)
{
    FILE *file = create(folder, number, ".json");
    const int compute = d->stage == CONEMAP_STAGE_COMPUTE;
    int binding = d->binding, k;
    fprintf(file, "{\"compute\": %d, \"entry\": \"%s_main\", \"images\": [", compute,
            d->prefix ? d->prefix : "conemap");
    for (k = 0; k < 4; ++k) fprintf(file, "%s%d", k ? ", " : "", has_image(d, k) ? binding++ : -1);
    fprintf(file, "], \"array\": %d, \"sampler\": %d, ", d->array, d->filter != CONEMAP_FILTER_FETCH ? binding++ : -1);
    fprintf(file, "\"wrap\": [%d, %d], \"rays\": %d, \"given\": %d, ", d->map.wrap_u == CONEMAP_WRAP,
            d->map.wrap_v == CONEMAP_WRAP, binding,
            d->run_time_cap || d->atlas || d->array || (d->t_range && !compute) ? binding + (compute ? 2 : 0) : -1);
    fprintf(file, "\"targets\": %d, \"rays_count\": %d}\n", d->steps || d->status ? 2 : 1, RAYS);
    fclose(file);
}

/* And the data: the arguments, the textures, the rays. */
static void write_inputs(const char *folder, int number, int kind, const conemap_shader_desc *d,
                         const struct inputs *in)
{
    char ending[32];
    FILE *file;
    int given[12], count = 0, k;
    snprintf(ending, sizeof ending, "_%d.in", kind);
    file = create(folder, number, ending);
    memset(given, 0, sizeof given);
    if (d->run_time_cap) given[count++] = 100000;
    if (d->atlas) {
        count = (count + 3) / 4 * 4;
        given[count++] = 5;
        given[count++] = 3;
        given[count++] = in->width;
        given[count++] = in->height;
    }
    if (d->array) given[count++] = 1;
    fwrite(given, sizeof given, 1, file);
    for (k = 0; k < 4; ++k) {
        const struct image *image = &in->images[k];
        size_t size = 0;
        int numbers[4], level;
        numbers[0] = image->width;
        numbers[1] = image->height;
        numbers[2] = image->slices;
        numbers[3] = image->levels;
        for (level = 0; level < image->levels; ++level)
            size += (size_t)((image->width >> level) * (image->height >> level) * image->slices);
        fwrite(numbers, sizeof numbers, 1, file);
        fwrite(image->texels, 16, size, file);
    }
    fwrite(in->rays, sizeof in->rays, 1, file);
    fclose(file);
}

/* MSL: a call of the entry point for each ray, as C++. */
static void write_call(FILE *file, int number, const conemap_shader_desc *d)
{
    const char *p = d->prefix ? d->prefix : "conemap", *array = d->array ? "_array" : "";
    const int compute = d->stage == CONEMAP_STAGE_COMPUTE, two = d->steps || d->status;
    const int given = compute || d->run_time_cap || d->atlas || d->array || d->t_range;
    int k;
    fprintf(file, "namespace item%d {\n#include \"%d.metal\"\n", number, number);
    fprintf(file, "static void call(const struct inputs *in, float *answers) {\n");
    if (given) fprintf(file, "    %s_shader::%s_arguments given;\n", p, p);
    if (compute) fprintf(file, "    given.%s_ray_count = RAYS;\n", p);
    if (d->run_time_cap) fprintf(file, "    given.%s_max_steps = 100000;\n", p);
    if (d->atlas) fprintf(file, "    given.%s_rect = int4(5, 3, in->width, in->height);\n", p);
    if (d->array) fprintf(file, "    given.%s_slice = 1;\n", p);
    if (d->filter != CONEMAP_FILTER_FETCH)
        fprintf(file, "    sampler s = {%d, %d};\n", d->map.wrap_u == CONEMAP_WRAP, d->map.wrap_v == CONEMAP_WRAP);
    fprintf(file, "    for (uint ray = 0; ray < RAYS; ++ray) {\n");
    if (!compute)
        fprintf(file, "        float4 *answer = (float4 *)answers + %d * ray, *r = (float4 *)in->rays + 2 * ray;\n"
                      "        %s_inputs inputs = {r[0].xyz, r[1].xyz};\n        discarded = false;\n"
                      "        auto out = ", two + 1, p);
    else
        fprintf(file, "        ");
    fprintf(file, "%s_main(", p);
    for (k = 0; k < 4; ++k)
        if (has_image(d, k)) fprintf(file, "as_texture<texture2d%s<float>>(&in->images[%d]), ", array, k);
    if (d->filter != CONEMAP_FILTER_FETCH) fprintf(file, "s, ");
    if (given) fprintf(file, "given, ");
    fprintf(file, compute ? "(const float4 *)in->rays, (float4 *)answers, ray);\n" : "inputs);\n");
    if (!compute && two) fprintf(file, "        answer[0] = out.color;\n        answer[1] = out.debug;\n");
    if (!compute && !two) fprintf(file, "        answer[0] = out;\n        if (discarded) answer[0].w = -1.0f;\n");
    fprintf(file, "    }\n}\n}\n");
}

static int read_answers(const char *folder, int number, int kind, float *answers, size_t size)
{
    char path[600];
    FILE *file;
    size_t got;
    snprintf(path, sizeof path, "%s/%d_%d.out", folder, number, kind);
    file = fopen(path, "rb");
    if (!file) return 0;
    got = fread(answers, 1, size, file);
    fclose(file);
    return got == size;
}

static void compare(const struct item *item, const conemap_map *map, const struct truth_map *truth,
                    const conemap_ray *rays, const float *answers, struct compare_counts *counts)
{
    const conemap_shader_desc *d = &item->desc;
    const int wide = d->steps || d->status ? 8 : 4;
    int k;
    for (k = 0; k < RAYS; ++k) {
        const float *answer = answers + wide * k;
        struct shader_hit hit;
        hit.steps = d->steps ? (int)answer[4] : -1;
        hit.status = d->status ? (int)answer[5] : -1;
        hit.found = d->stage == CONEMAP_STAGE_FRAGMENT && d->status ? hit.status == 0 : answer[3] >= 0.0f;
        hit.t = answer[3];
        memcpy(hit.position, answer, 12);
        if (d->trace.any_hit) {
            conemap_hit cpu;
            conemap_trace(map, &d->trace, &rays[k], &cpu, 1);
            ++counts->rays;
            counts->hits += hit.found;
            counts->different += hit.found != (cpu.status == CONEMAP_HIT);
        } else {
            compare_hit(map, truth, &d->trace, &rays[k], &hit, counts);
        }
    }
}

/* ---- kernels: whole maps are made, pass by pass ---- */

enum { WIDE = 40, HIGH = 28, SIDE = 64, LEVELS = 7, MADE = 6, MOST_PASSES = 64 };
static const struct making {
    const char *name;
    conemap_generator generator;
    conemap_guarantee guarantee;
    conemap_layout layout;
    conemap_wrap wrap_u;
    int min3x3;
} makings[MADE] = {
    {"ring search", CONEMAP_RING, CONEMAP_GUARANTEE_VERTEX, CONEMAP_HEIGHT_CONE, CONEMAP_CLAMP, 0},
    {"ring search, 3x3, wrap", CONEMAP_RING, CONEMAP_GUARANTEE_VERTEX, CONEMAP_CONE_ONLY, CONEMAP_WRAP, 1},
    {"exact, wrap", CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, CONEMAP_HEIGHT_CONE, CONEMAP_WRAP, 0},
    {"exact, with slopes", CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, CONEMAP_DUMMER, CONEMAP_CLAMP, 0},
    {"exact, made safe", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, CONEMAP_HEIGHT_CONE, CONEMAP_CLAMP, 0},
    {"quick", CONEMAP_QUICK, CONEMAP_GUARANTEE_VERTEX, CONEMAP_HEIGHT_CONE, CONEMAP_CLAMP, 0}};

static void fill_making(conemap_shader_desc *d, const struct making *m, conemap_dialect dialect)
{
    memset(d, 0, sizeof *d);
    d->dialect = dialect;
    d->stage = CONEMAP_STAGE_COMPUTE;
    d->map.wrap_u = m->wrap_u;
    d->map.aspect = 0.6f;
    d->map.min3x3 = m->min3x3;
    d->map.guarantee = m->guarantee;
    d->map.generator = m->generator;
    d->map.width = WIDE;
    d->map.height = HIGH;
    d->map.texture.layout = m->layout;
}

/* Which textures a kernel reads, as bits: the state, the heights, the maxima. */
static int kernel_reads(const struct making *m, int kernel)
{
    switch (kernel) {
    case CONEMAP_KERNEL_RING:
    case CONEMAP_KERNEL_SAFE: return 1 + 2;
    case CONEMAP_KERNEL_MIN3X3: return 1;
    case CONEMAP_KERNEL_STORE: return m->layout == CONEMAP_CONE_ONLY ? 1 : 1 + 2;
    case CONEMAP_KERNEL_MAXIMA: return 4;
    case CONEMAP_KERNEL_QUICK: return 2 + 4;
    case CONEMAP_KERNEL_EXACT: return 1 + 2 + 4;
    default: return 2;
    }
}

/* The texts of a making that its passes need, numbered from 100 on, and how they are called. */
static void write_making(const char *folder, int n, const conemap_shader_desc *d, const conemap_gpu_pass *passes,
                         int count, FILE *calls)
{
    const struct making *m = &makings[n];
    FILE *file = calls ? NULL : create(folder, 100 * (n + 1), ".json");
    int kernel, pass, k, done = 0;
    for (kernel = 0; kernel < CONEMAP_KERNEL_COUNT; ++kernel) {
        const int number = 100 * (n + 1) + kernel, reads = kernel_reads(m, kernel);
        static const char *const names[3] = {"states[pass->reads]", "heights", "maxima"};
        FILE *out = create(folder, number, calls ? ".metal" : ".wgsl.text");
        if (conemap_emit_kernel(d, (conemap_kernel)kernel, text, sizeof text, NULL) != CONEMAP_OK)
            wrong("%s: kernel %d", m->name, kernel);
        fputs(text, out);
        fclose(out);
        if (!calls) continue;
        fprintf(calls, "namespace item%d {\n#include \"%d.metal\"\n", number, number);
        fprintf(calls, "static void call(struct grid *g, const conemap_gpu_pass *pass) {\n");
        if (kernel == CONEMAP_KERNEL_RING || kernel == CONEMAP_KERNEL_EXACT || kernel == CONEMAP_KERNEL_MAXIMA)
            fprintf(calls, "    conemap_shader::conemap_arguments given;\n");
        if (kernel == CONEMAP_KERNEL_RING || kernel == CONEMAP_KERNEL_EXACT)
            fprintf(calls, "    given.conemap_first = pass->first;\n    given.conemap_last = pass->last;\n");
        if (kernel == CONEMAP_KERNEL_EXACT || kernel == CONEMAP_KERNEL_MAXIMA)
            fprintf(calls, "    given.conemap_level = pass->level;\n");
        fprintf(calls, "    texture2d<float, access::write> out = target(g, pass);\n"
                       "    for (int j = 0; j < 8 * pass->groups_y; ++j)\n"
                       "        for (int i = 0; i < 8 * pass->groups_x; ++i)\n            conemap_main(");
        for (k = 0; k < 3; ++k)
            if (reads >> k & 1) fprintf(calls, "as_texture<texture2d<float>>(&g->%s), ", names[k]);
        if (kernel == CONEMAP_KERNEL_RING || kernel == CONEMAP_KERNEL_EXACT || kernel == CONEMAP_KERNEL_MAXIMA)
            fprintf(calls, "given, ");
        fprintf(calls, "out, uint2(i, j));\n}\n}\n");
    }
    if (calls) return;
    fprintf(file, "{\"width\": %d, \"height\": %d, \"side\": %d, \"levels\": %d, ", WIDE, HIGH, SIDE, LEVELS);
    fprintf(file, "\"format\": \"%s\", \"passes\": [",
            m->layout == CONEMAP_CONE_ONLY ? "r32float"
            : m->layout == CONEMAP_DUMMER  ? "rgba32float"
                                           : "rg32float");
    for (pass = 0; pass < count; ++pass) {
        const conemap_gpu_pass *now = &passes[pass];
        const int levels = now->kernel == CONEMAP_KERNEL_MAXIMA;
        fprintf(file, "%s\n{\"text\": \"%d.wgsl.text\", \"given\": [%d, %d, %d], \"argued\": %d, ", done++ ? "," : "",
                100 * (n + 1) + (int)now->kernel, levels ? now->level : now->first, now->last, now->level,
                levels || now->kernel == CONEMAP_KERNEL_RING || now->kernel == CONEMAP_KERNEL_EXACT);
        fprintf(file, "\"own\": %d, \"level\": %d, \"bits\": %d, \"reads\": %d, \"writes\": %d, \"groups\": [%d, %d]}",
                levels, now->level, kernel_reads(m, (int)now->kernel), now->reads, now->writes, now->groups_x,
                now->groups_y);
    }
    fprintf(file, "]}\n");
    fclose(file);
}

static void clear_grid(struct grid *g, const float *heights)
{
    conemap_shader_desc plain;
    memset(&plain, 0, sizeof plain);
    g->heights = image_new(&plain, WIDE, HIGH, 1);
    g->states[0] = image_new(&plain, WIDE, HIGH, 1);
    g->states[1] = image_new(&plain, WIDE, HIGH, 1);
    g->maxima = image_new(&plain, SIDE, SIDE, LEVELS);
    g->out = image_new(&plain, WIDE, HIGH, 1);
    image_fill(&plain, &g->heights, 0, WIDE, HIGH, 1, heights);
}

static void free_grid(struct grid *g)
{
    free(g->heights.texels);
    free(g->states[0].texels);
    free(g->states[1].texels);
    free(g->maxima.texels);
    free(g->out.texels);
}

static long cones_made;

/* Of four floats a texel, as the texture's channels. */
static void judge_making(const struct making *m, const conemap_map *map, const float *heights, const float *made,
                         int channels)
{
    static float cones[WIDE * HIGH], right[WIDE * HIGH * 4];
    const int safe = m->guarantee == CONEMAP_GUARANTEE_BILINEAR, at = m->layout == CONEMAP_CONE_ONLY ? 0 : 1;
    int k, wide = 0, narrow = 0, other = 0;
    if (m->layout == CONEMAP_DUMMER) conemap_write_texture(map, right, sizeof right, 0);
    for (k = 0; k < WIDE * HIGH; ++k) {
        const float *texel = made + channels * k;
        cones[k] = texel[at];
        wide += !(cones[k] <= map->cones[k]);
        narrow += !safe && !(cones[k] >= map->cones[k] * (1.0f - 1e-5f));
        other += at && !(texel[0] <= heights[k] && texel[0] >= heights[k]);
        if (m->layout == CONEMAP_DUMMER)
            other += !(fabsf(texel[2] - right[4 * k + 2]) <= 1e-7f && fabsf(texel[3] - right[4 * k + 3]) <= 1e-7f);
    }
    cones_made += WIDE * HIGH;
    if (safe) {
        conemap_report report;
        if (conemap_verify(&map->info, heights, cones, NULL, &report) != CONEMAP_OK || report.unsafe || report.unproven)
            wrong("%s: %d cells are not safe", m->name, (int)(report.unsafe + report.unproven));
        wide = 0; /* the CPU's are others */
    }
    if (wide || narrow || other)
        wrong("%s: %d cones wider, %d narrower, %d heights or slopes", m->name, wide, narrow, other);
}

static int read_answers(const char *folder, int number, int kind, float *answers, size_t size);

static void kernels(const char *folder, conemap_dialect dialect, int writes, FILE *calls, int runs)
{
    static float heights[WIDE * HIGH], made[WIDE * HIGH * 4];
    int n, kind, pass;
    for (n = 0; n < MADE; ++n) {
        const struct making *m = &makings[n];
        const int channels = m->layout == CONEMAP_CONE_ONLY ? 1 : m->layout == CONEMAP_DUMMER ? 4 : 2;
        conemap_shader_desc d;
        conemap_gpu_pass passes[MOST_PASSES];
        int count = 0;
        fill_making(&d, m, dialect);
        if (conemap_gpu_passes(&d, 900, passes, MOST_PASSES, &count) != CONEMAP_OK) wrong("%s: no passes", m->name);
        if (writes || calls) write_making(folder, n, &d, passes, count, calls);
        for (kind = 0; kind < ZOO_KINDS && !calls; ++kind) {
            conemap_desc build;
            conemap_map map;
            zoo_fill(kind, WIDE, HIGH, 3, heights);
            if (writes) {
                char ending[32];
                FILE *file;
                snprintf(ending, sizeof ending, "_%d.in", kind);
                file = create(folder, 100 * (n + 1), ending);
                fwrite(heights, sizeof heights, 1, file);
                fclose(file);
                continue;
            }
            memset(&build, 0, sizeof build);
            build.heights.pixels = heights;
            build.heights.width = WIDE;
            build.heights.height = HIGH;
            build.wrap_u = m->wrap_u;
            build.aspect = 0.6f;
            build.min3x3 = m->min3x3;
            build.generator = m->generator;
            build.guarantee = m->generator == CONEMAP_EXACT ? m->guarantee : CONEMAP_GUARANTEE_DEFAULT;
            build.texture = d.map.texture;
            if (conemap_build(&build, &map) != CONEMAP_OK) {
                wrong("%s: build", m->name);
                continue;
            }
            if (runs) {
                struct grid g;
                int k, c;
                clear_grid(&g, heights);
#ifdef CALLS
                for (pass = 0; pass < count; ++pass) kernel_calls[n][passes[pass].kernel](&g, &passes[pass]);
#else
                (void)pass;
#endif
                for (k = 0; k < WIDE * HIGH; ++k)
                    for (c = 0; c < channels; ++c) made[channels * k + c] = g.out.texels[4 * k + c];
                free_grid(&g);
            } else if (!read_answers(folder, 100 * (n + 1), kind, made, WIDE * HIGH * 4 * (size_t)channels)) {
                wrong("%s: no answers", m->name);
            }
            judge_making(m, &map, heights, made, channels);
            conemap_free(&map);
        }
    }
}

/* Exactly along the rim of a surface that ends at its outermost centres: the last bit decides whether it meets it. */
static int on_rim(const struct truth_map *truth, const conemap_ray *ray)
{
    int k;
    for (k = 0; k < 2; ++k) {
        const float size = (float)(k ? truth->height : truth->width), place = ray->origin[k] * size;
        if ((k ? truth->wrap_v : truth->wrap_u) == 2 && ray->direction[k] == 0.0f &&
            (fabsf(place - 0.5f) < 1e-4f || fabsf(place - size + 0.5f) < 1e-4f))
            return 1;
    }
    return 0;
}

int main(int argument_count, char **arguments)
{
    static const int sizes[2][2] = {{64, 48}, {17, 23}};
    static float heights[64 * 64], answers[RAYS * 8];
    static struct inputs in __attribute__((aligned(16)));
    static conemap_ray rays[RAYS];
    const char *what = argument_count > 1 ? arguments[1] : "", *folder = argument_count > 2 ? arguments[2] : ".";
    const int writes = strcmp(what, "write") == 0, texts = strcmp(what, "texts") == 0, runs = strcmp(what, "run") == 0;
    const char *dialect = texts || runs ? "MSL" : "WGSL";
    FILE *calls = NULL;
    int n, kind, k;
    list_items(texts || runs ? CONEMAP_MSL : CONEMAP_WGSL);
    if (texts) calls = create(folder, -1, "calls.h");
    for (n = 0; n < item_count; ++n) {
        const struct item *item = &items[n];
        struct compare_counts counts;
        struct zoo_random random = zoo_seed(99);
        memset(&counts, 0, sizeof counts);
        for (kind = 0; kind < ZOO_KINDS; ++kind) {
            conemap_shader_desc d = item->desc;
            const int size = d.fixed_size ? 0 : kind & 1;
            conemap_desc build;
            conemap_map map;
            struct truth_map truth;
            memset(&build, 0, sizeof build);
            zoo_fill(kind, sizes[size][0], sizes[size][1], 23, heights);
            build.heights.pixels = heights;
            build.heights.width = sizes[size][0];
            build.heights.height = sizes[size][1];
            build.wrap_u = d.map.wrap_u;
            build.wrap_v = d.map.wrap_v;
            build.aspect = d.map.aspect;
            build.texture = d.map.texture;
            build.generator = item->generator;
            build.keep_pyramid = 1;
            if (conemap_build(&build, &map) != CONEMAP_OK) {
                wrong("%s: build", item->name);
                break;
            }
            d.map = map.info;
            if ((writes || texts) && kind == 0) {
                write_text(folder, n, &d);
                if (writes) write_bindings(folder, n, &d);
                if (texts) write_call(calls, n, &d);
            }
            truth.width = map.info.width;
            truth.height = map.info.height;
            truth.wrap_u = (int)map.info.wrap_u;
            truth.wrap_v = (int)map.info.wrap_v;
            truth.heights = map.heights;
            for (k = 0; k < RAYS; ++k) {
                do rays[k] = compare_ray(&random, truth.width, truth.height, k);
                while (on_rim(&truth, &rays[k]) || ((truth.wrap_u == 1 || truth.wrap_v == 1) &&
                                                    rays[k].direction[2] > -0.01f && rays[k].direction[2] < 0.01f));
                if (d.t_range) {
                    rays[k].t_min = 0.1f;
                    rays[k].t_max = 0.7f;
                }
            }
            if (!texts) prepare(&d, &map, rays, &in);
            if (writes) write_inputs(folder, n, kind, &d, &in);
            if (!writes && !texts) {
#ifdef CALLS
                if (runs) item_calls[n](&in, answers);
#endif
                if (!runs && !read_answers(folder, n, kind, answers, RAYS * (d.steps || d.status ? 32u : 16u)))
                    wrong("%s: no answers", item->name);
                compare(item, &map, &truth, rays, answers, &counts);
            }
            for (k = 0; k < 4 && !texts; ++k) free(in.images[k].texels);
            conemap_free(&map);
        }
        if (writes || texts) continue;
        rays_done += counts.rays;
        different_done += counts.different;
        printf("%s %-38s %6d rays, %6d hits, %3d differ, %2d not on an edge, misses: %d by 2^-20, %d beyond single "
               "precision\n",
               dialect, item->name, counts.rays, counts.hits, counts.different, counts.unexplained,
               counts.strict_misses, counts.misses);
        if (counts.hits < counts.rays / 5) wrong("%s: too few hits", item->name);
        if (item->desc.filter == CONEMAP_FILTER_HARDWARE) {
            if (counts.different * 50 > counts.rays) wrong("%s: %d rays differ", item->name, counts.different);
            continue;
        }
        if (counts.different * 1000 > counts.rays) wrong("%s: %d rays differ", item->name, counts.different);
        if (counts.unexplained) wrong("%s: %d rays differ and lie on no edge", item->name, counts.unexplained);
        if (counts.misses) wrong("%s: %d misses", item->name, counts.misses);
    }
    kernels(folder, texts || runs ? CONEMAP_MSL : CONEMAP_WGSL, writes, calls, runs);
    if (texts) {
        fprintf(calls, "static void (*const kernel_calls[][%d])(struct grid *, const conemap_gpu_pass *) = {",
                (int)CONEMAP_KERNEL_COUNT);
        for (n = 0; n < MADE; ++n)
            for (k = 0; k < CONEMAP_KERNEL_COUNT; ++k)
                fprintf(calls, "%sitem%d::call%s", k ? ", " : n ? ", {" : "{", 100 * (n + 1) + k,
                        k + 1 == CONEMAP_KERNEL_COUNT ? "}" : "");
        fprintf(calls, "};\n");
        fprintf(calls, "static void (*const item_calls[])(const struct inputs *, float *) = {");
        for (n = 0; n < item_count; ++n) fprintf(calls, "%sitem%d::call", n ? ", " : "", n);
        fprintf(calls, "};\n");
        fclose(calls);
    }
#ifdef CALLS
    if (faults) wrong("%ld reads beyond a texture", faults);
#endif
    if (!writes && !texts)
        printf("%s run: %ld rays, %ld differ; %ld cones by kernels\n", dialect, rays_done, different_done, cones_made);
    return failures != 0;
}
