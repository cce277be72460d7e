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
#include "../shade_compare.h"

enum { RAYS = 1024, MOST = 40 };
enum { LIT_RAYS = 256, LIT_WIDE = 24, LIT_HIGH = 16, LIT_IMAGES = 6, LIT_FIRST = 50, LIT_KINDS = 4, LIT_TARGETS = 6 };

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

struct lit_inputs { /* of effects; the sixth image: colours. Eight float4 a ray */
    float rays[LIT_RAYS * 32];
    struct image images[LIT_IMAGES];
    int width, height;
    conemap_effects e;
    conemap_frame shape;
};

/* What the arguments hold, one number after the other, as `conemap_settings.clip` and as text of MSL. */
struct lit_argument {
    const char *name;
    int count, whole; /* whole: integers */
    float values[4];
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
static long rays_done, different_done, shaded;

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

static void write_text(const char *folder, int number, const char *name, const conemap_shader_desc *d)
{
    FILE *file = create(folder, number, d->dialect == CONEMAP_WGSL ? ".wgsl" : ".metal");
    const conemap_result result = conemap_emit(d, text, sizeof text, NULL);
    if (result != CONEMAP_OK) wrong("%s: %s", name, conemap_result_string(result));
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

static void write_image(FILE *file, const struct image *image)
{
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
    for (k = 0; k < 4; ++k) write_image(file, &in->images[k]);
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

/* ---- effects ---- */

#define LIT_NUMBERS                                                                                                    \
    (CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY |              \
     CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE)
#define LIT_ALL                                                                                                        \
    ((unsigned)CONEMAP_EFFECT_ALL_BITS &                                                                               \
     ~(unsigned)(CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_OCCLUSION))
enum { LIT_ARRAY = 1, LIT_ATLAS = 2, LIT_RANGE = 4, LIT_FRAGMENT = 8 };
static const struct lighting {
    const char *name;
    unsigned flags;
    int with, sectors;
    conemap_layout layout;
    conemap_wrap wrap_u;
} lightings[] = {
    {"all effects", LIT_ALL, 0, 1, CONEMAP_HEIGHT_CONE, CONEMAP_CLAMP},
    {"mips, fade, hard shadows, colours",
     CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_UV |
         CONEMAP_EFFECT_OCCLUSION,
     LIT_ARRAY, 1, CONEMAP_CONE_ONLY, CONEMAP_NOTHING},
    {"bent, wrap, a range", CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_TWO_SIDED |
                                CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW,
     LIT_RANGE, 1, CONEMAP_HEIGHT_CONE, CONEMAP_WRAP},
    {"atlas, stored slopes", CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_OCCLUSION,
     LIT_ATLAS, 1, CONEMAP_DUMMER, CONEMAP_CLAMP},
    {"eight sectors, clip, holes, soft shadows",
     CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SMOOTH_NORMAL,
     0, 8, CONEMAP_HEIGHT_CONE, CONEMAP_CLAMP},
    {"position alone", CONEMAP_EFFECT_POSITION, LIT_ARRAY | LIT_RANGE, 1, CONEMAP_HEIGHT_CONE, CONEMAP_CLAMP},
    {"fragments", CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_POSITION |
                      CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY,
     LIT_FRAGMENT | LIT_RANGE, 1, CONEMAP_HEIGHT_CONE, CONEMAP_CLAMP},
    {"fragments, sectors, colours", CONEMAP_EFFECT_UV | CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SMOOTH_NORMAL,
     LIT_FRAGMENT, 4, CONEMAP_HEIGHT_CONE, CONEMAP_WRAP}};
#define LIT ((int)(sizeof lightings / sizeof lightings[0]))

static void fill_lighting(conemap_shader_desc *d, const struct lighting *l, conemap_dialect dialect)
{
    memset(d, 0, sizeof *d);
    d->dialect = dialect;
    d->stage = l->with & LIT_FRAGMENT ? CONEMAP_STAGE_FRAGMENT : CONEMAP_STAGE_COMPUTE;
    d->flags = l->flags;
    d->array = (l->with & LIT_ARRAY) != 0;
    d->atlas = (l->with & LIT_ATLAS) != 0;
    d->t_range = (l->with & LIT_RANGE) != 0;
    d->map.wrap_u = l->wrap_u;
    d->map.aspect = 0.8f;
    d->map.texture.layout = l->layout;
    d->map.texture.sectors = l->sectors > 1 ? l->sectors : 0;
    if (dialect == CONEMAP_MSL && d->stage == CONEMAP_STAGE_FRAGMENT) d->flags |= CONEMAP_EFFECT_DEPTH;
}

static int has_lit_image(const conemap_shader_desc *d, int k)
{
    return k < 4 ? has_image(d, k) : (d->flags & (k == 4 ? CONEMAP_EFFECT_HOLES : CONEMAP_EFFECT_UV)) != 0;
}

/* Where the six targets stand among those that there are, or -1. Returns how many. The depth of fragments: behind. */
static int lit_targets(unsigned flags, int places[LIT_TARGETS])
{
    int count = 1;
    places[0] = 0;
    places[1] = flags & CONEMAP_EFFECT_POSITION ? count++ : -1;
    places[2] = flags & (CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL) ? count++ : -1;
    places[3] = flags & CONEMAP_EFFECT_UV ? count++ : -1;
    places[4] = flags & LIT_NUMBERS ? count++ : -1;
    places[5] = flags & CONEMAP_EFFECT_DEPTH ? count++ : -1;
    return count;
}

static int lit_arguments(const conemap_shader_desc *d, const struct lit_inputs *in, struct lit_argument *list)
{
    static const struct {
        const char *name;
        unsigned flags;
        int count, whole;
    } all[] = {{"settings.clip", CONEMAP_EFFECT_CLIP, 4, 0},
               {"settings.clip_z", CONEMAP_EFFECT_DEPTH, 4, 0},
               {"settings.clip_w", CONEMAP_EFFECT_DEPTH, 4, 0},
               {"settings.light", CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW, 4, 0},
               {"settings.light_radius", CONEMAP_EFFECT_SOFT_SHADOW, 1, 0},
               {"settings.sky_reach", CONEMAP_EFFECT_SKY, 1, 0},
               {"settings.sky_directions", CONEMAP_EFFECT_SKY, 1, 1},
               {"settings.alpha_cut", CONEMAP_EFFECT_HOLES, 1, 0},
               {"settings.lod_bias", CONEMAP_EFFECT_LOD, 1, 0},
               {"settings.lod_steps", CONEMAP_EFFECT_LOD, 1, 1},
               {"settings.level_count", CONEMAP_EFFECT_LOD, 1, 1},
               {"settings.fade_begin", CONEMAP_EFFECT_FADE, 1, 0},
               {"settings.fade_end", CONEMAP_EFFECT_FADE, 1, 0},
               {"shape", ~0u, 4, 0},
               {"curvature", CONEMAP_EFFECT_CURVED, 4, 0},
               {"range", 0, 2, 0},
               {"rect", 0, 4, 1},
               {"slice", 0, 1, 1}};
    const conemap_effects *e = &in->e;
    const conemap_frame *f = &in->shape;
    const float *m = e->view_projection;
    const float values[][4] = {{e->clip[0], e->clip[1], e->clip[2], e->clip[3]},
                               {m ? m[2] : 0, m ? m[6] : 0, m ? m[10] : 0, m ? m[14] : 0},
                               {m ? m[3] : 0, m ? m[7] : 0, m ? m[11] : 0, m ? m[15] : 0},
                               {e->light[0], e->light[1], e->light[2], (float)e->light_is_point},
                               {e->light_radius},
                               {e->sky_reach},
                               {(float)e->sky_directions},
                               {127.5f / 255.0f},
                               {e->lod_bias},
                               {(float)e->lod_steps},
                               {(float)e->level_count},
                               {e->fade_begin},
                               {e->fade_end},
                               {f->uv_scale[0], f->uv_scale[1], f->depth, f->level},
                               {f->curvature[0], f->curvature[1], f->curvature[2]},
                               {0.2f, 3.0f}, /* shade_draw's */
                               {5, 3, (float)in->width, (float)in->height},
                               {1}};
    int k, count = 0;
    for (k = 0; k < 18; ++k) {
        const int there = k == 15   ? d->t_range && d->stage == CONEMAP_STAGE_FRAGMENT
                          : k == 16 ? d->atlas
                          : k == 17 ? d->array
                                    : (d->flags & all[k].flags) != 0;
        if (!there) continue;
        list[count].name = all[k].name;
        list[count].count = all[k].count;
        list[count].whole = all[k].whole;
        memcpy(list[count++].values, values[k], sizeof values[k]);
    }
    return count;
}

/* The same as bytes of WGSL's uniform buffer: whole vectors at multiples of their size, and what follows the settings
   behind all of them. Returns how many, in floats. */
static int lit_bytes(const conemap_shader_desc *d, const struct lit_inputs *in, float *bytes)
{
    struct lit_argument list[20];
    const int count = lit_arguments(d, in, list);
    int k, c, at = 0;
    for (k = 0; k < count; ++k) {
        at = (at + list[k].count - 1) / list[k].count * list[k].count;
        for (c = 0; c < list[k].count; ++c, ++at) {
            const int number = (int)list[k].values[c];
            memcpy(bytes + at, list[k].whole ? (const void *)&number : (const void *)&list[k].values[c], sizeof number);
        }
    }
    return (at + 3) / 4 * 4;
}

/* A scene for a lighting over a map of this kind, the same in every run. 0: no map. */
static int lit_scene(const conemap_shader_desc *d, int n, int kind, conemap_map *levels, unsigned char *alpha,
                     struct shade_job *jobs, struct lit_inputs *in)
{
    static float heights[LIT_WIDE * LIT_HIGH], values[LIT_WIDE * LIT_HIGH * 8];
    struct zoo_random random = zoo_seed(7u * (unsigned)n + (unsigned)kind);
    const int mips = d->flags & CONEMAP_EFFECT_LOD ? SHADE_LEVELS : 1;
    conemap_desc build;
    int k, level, c;
    memset(&build, 0, sizeof build);
    zoo_fill(kind, LIT_WIDE, LIT_HIGH, 5, heights);
    build.heights.pixels = heights;
    build.heights.width = in->width = LIT_WIDE;
    build.heights.height = in->height = LIT_HIGH;
    build.wrap_u = d->map.wrap_u;
    build.aspect = d->map.aspect;
    build.texture = d->map.texture;
    if (conemap_build_levels(&build, levels, SHADE_LEVELS) != CONEMAP_OK) return 0;
    shade_alpha(LIT_WIDE, LIT_HIGH, alpha);
    shade_settings(&random, d->flags, levels, SHADE_LEVELS, alpha, &in->e);
    shade_shape(&random, d->flags, d->map.aspect, &in->shape);
    for (k = 0; k < LIT_RAYS; ++k) {
        float *ray = in->rays + 32 * k;
        memset(ray, 0, 32 * sizeof *ray);
        shade_draw(&random, &in->e, &in->shape, d->t_range, &jobs[k]);
        if (d->stage == CONEMAP_STAGE_FRAGMENT) memset(&jobs[k].gradient, 0, sizeof jobs[k].gradient);
        memcpy(ray, jobs[k].ray.origin, 12);
        ray[3] = jobs[k].ray.t_min;
        memcpy(ray + 4, jobs[k].ray.direction, 12);
        ray[7] = jobs[k].ray.t_max;
        memcpy(ray + 8, jobs[k].frame.tangent, 12);
        memcpy(ray + 12, jobs[k].frame.bitangent, 12);
        memcpy(ray + 16, jobs[k].frame.normal, 12);
        memcpy(ray + 20, jobs[k].frame.origin, 12);
        memcpy(ray + 24, jobs[k].frame.uv_offset, 8);
        memcpy(ray + 28, &jobs[k].gradient, 16);
    }
    for (k = 0; k < 5; ++k) in->images[k] = image_new(d, LIT_WIDE, LIT_HIGH, mips);
    for (level = 0; level < mips; ++level) {
        const int w = levels[level].info.width, h = levels[level].info.height;
        for (k = 0; k < 2; ++k) {
            const size_t size = conemap_texture_size(&levels[level], 0);
            if (k == 1 && d->map.texture.sectors != 8) continue;
            conemap_write_texture_at(&levels[level], k, values, sizeof values, 0);
            image_fill(d, &in->images[k], level, w, h, (int)(size / sizeof(float)) / (w * h), values);
        }
        image_fill(d, &in->images[2], level, w, h, 1, levels[level].heights);
    }
    for (k = 0; k < LIT_WIDE * LIT_HIGH; ++k) values[k] = (float)alpha[k] / 255.0f;
    image_fill(d, &in->images[4], 0, LIT_WIDE, LIT_HIGH, 1, values);
    {
        conemap_shader_desc plain;
        memset(&plain, 0, sizeof plain);
        in->images[5] = image_new(&plain, 4, 4, 1);
        for (k = 0; k < 16; ++k)
            for (c = 0; c < 4; ++c) values[4 * k + c] = 0.25f * (float)(c + 1);
        image_fill(&plain, &in->images[5], 0, 4, 4, 4, values);
    }
    return 1;
}

static void write_lit_call(FILE *file, int number, const conemap_shader_desc *d, const struct lit_inputs *in)
{
    static const char *const names[LIT_TARGETS] = {"box", "position", "normal", "color", "numbers", "depth"};
    const int compute = d->stage == CONEMAP_STAGE_COMPUTE, array = d->array;
    struct lit_argument list[20];
    const int count = lit_arguments(d, in, list);
    int places[LIT_TARGETS], k, targets;
    targets = lit_targets(d->flags, places);
    fprintf(file, "namespace item%d {\n#include \"%d.metal\"\n", number, number);
    fprintf(file, "static void call(const struct lit_inputs *in, const struct lit_argument *list, float *answers) {\n");
    fprintf(file, "    conemap_shader::conemap_arguments given;\n    sampler s = {1, 1};\n    (void)s;\n");
    if (compute) fprintf(file, "    given.conemap_ray_count = LIT_RAYS;\n");
    for (k = 0; k < count; ++k) {
        static const char *const makers[5] = {"", "", "float2", "", "float4"};
        const char *maker = list[k].whole ? (list[k].count > 1 ? "int4" : "(int)") : makers[list[k].count];
        fprintf(file, "    given.conemap_%s = %s(list[%d].values[0]", list[k].name, maker, k);
        if (list[k].count > 1) fprintf(file, ", list[%d].values[1]", k);
        if (list[k].count > 2) fprintf(file, ", list[%d].values[2], list[%d].values[3]", k, k);
        fprintf(file, ");\n");
    }
    fprintf(file, "    for (uint ray = 0; ray < LIT_RAYS; ++ray) {\n");
    if (!compute)
        fprintf(file, "        float4 *answer = (float4 *)answers + %d * ray, *r = (float4 *)in->rays + 8 * ray;\n"
                      "        conemap_shader::conemap_inputs inputs = {r[0].xyz, r[1].xyz, r[2].xyz, r[3].xyz,\n"
                      "            r[4].xyz, r[5].xyz, r[6].xy};\n        discarded = false;\n        auto out = ",
                targets);
    fprintf(file, "conemap_main(");
    for (k = 0; k < LIT_IMAGES; ++k)
        if (has_lit_image(d, k))
            fprintf(file, "as_texture<texture2d%s<float>>(&in->images[%d]), ", array && k < 5 ? "_array" : "", k);
    if (has_lit_image(d, 5)) fprintf(file, "s, ");
    fprintf(file, compute ? "given, (const float4 *)in->rays, (float4 *)answers, ray);\n" : "given, inputs);\n");
    for (k = 0; k < LIT_TARGETS && !compute; ++k)
        if (places[k] >= 0) fprintf(file, "        answer[%d] = make_float4(out.%s);\n", places[k], names[k]);
    if (!compute) fprintf(file, "        if (discarded) answer[0].w = -1.0f;\n");
    fprintf(file, "    }\n}\n}\n");
}

static void write_lit_json(const char *folder, int number, const conemap_shader_desc *d, int bytes)
{
    FILE *file = create(folder, number, ".json");
    const int compute = d->stage == CONEMAP_STAGE_COMPUTE;
    int places[LIT_TARGETS], binding = 0, k;
    fprintf(file, "{\"compute\": %d, \"lit\": 1, \"entry\": \"conemap_main\", \"images\": [", compute);
    for (k = 0; k < LIT_IMAGES; ++k) fprintf(file, "%s%d", k ? ", " : "", has_lit_image(d, k) ? binding++ : -1);
    fprintf(file, "], \"array\": %d, \"sampler\": %d, \"wrap\": [1, 1], ", d->array,
            has_lit_image(d, 5) ? binding++ : -1);
    fprintf(file, "\"given\": %d, \"given_size\": %d, \"rays\": %d, ", binding, 4 * bytes, binding + 1);
    fprintf(file, "\"targets\": %d, \"rays_count\": %d}\n", lit_targets(d->flags, places), LIT_RAYS);
    fclose(file);
}

static void write_lit_inputs(const char *folder, int number, int kind, const float *bytes, int count,
                             const struct lit_inputs *in)
{
    char ending[32];
    FILE *file;
    int k;
    snprintf(ending, sizeof ending, "_%d.in", kind);
    file = create(folder, number, ending);
    fwrite(bytes, sizeof *bytes, (size_t)count, file);
    for (k = 0; k < LIT_IMAGES; ++k) write_image(file, &in->images[k]);
    fwrite(in->rays, sizeof in->rays, 1, file);
    fclose(file);
}

static void judge_lighting(const struct lighting *l, const conemap_shader_desc *d, const conemap_map *map,
                           const struct shade_job *jobs, const float *answers, struct shade_counts *counts)
{
    struct zoo_random random = zoo_seed(3);
    int places[LIT_TARGETS], k, colors = 0;
    const int targets = lit_targets(d->flags, places);
    for (k = 0; k < LIT_RAYS; ++k) {
        const float *answer = answers + 4 * targets * k, *numbers = answer + 4 * places[4];
        struct shade_answer a;
        memset(&a, 0, sizeof a);
        a.t = answer[3];
        a.found = a.t >= 0.0f;
        memcpy(a.box, answer, sizeof a.box);
        if (places[1] >= 0) memcpy(a.s.position, answer + 4 * places[1], sizeof a.s.position);
        if (places[2] >= 0) memcpy(a.s.normal, answer + 4 * places[2], sizeof a.s.normal);
        if (places[3] >= 0 && a.found) {
            const float *color = answer + 4 * places[3];
            colors += !(color[0] == 0.25f && color[1] == 0.5f && color[2] == 0.75f && color[3] == 1.0f);
        }
        if (places[4] >= 0) {
            a.s.shadow = numbers[0];
            a.s.occlusion = numbers[1];
            a.s.level = numbers[2];
            a.s.fade = numbers[3];
        }
        if (places[5] >= 0) a.s.depth = answer[4 * places[5]];
        if (!shade_compare(map, NULL, &jobs[k], &a, &random, counts)) wrong("%s: refused on the CPU", l->name);
    }
    if (colors) wrong("%s: %d other colours", l->name, colors);
}

static void lights(const char *folder, conemap_dialect dialect, int writes, FILE *calls, int runs)
{
    static float answers[LIT_RAYS * 4 * LIT_TARGETS], bytes[80];
    static struct lit_inputs in __attribute__((aligned(16)));
    static struct shade_job jobs[LIT_RAYS];
    static unsigned char alpha[LIT_WIDE * LIT_HIGH];
    int n, kind, k;
    for (n = 0; n < LIT; ++n) {
        const struct lighting *l = &lightings[n];
        const int number = LIT_FIRST + n;
        struct shade_counts counts;
        int places[LIT_TARGETS], size;
        conemap_shader_desc d;
        fill_lighting(&d, l, dialect);
        memset(&counts, 0, sizeof counts);
        for (kind = 0; kind < LIT_KINDS; ++kind) {
            conemap_map levels[SHADE_LEVELS];
            if (!lit_scene(&d, n, kind, levels, alpha, jobs, &in)) {
                wrong("%s: build", l->name);
                break;
            }
            d.map = levels[0].info;
            d.map.width = d.map.height = 0;
            size = lit_bytes(&d, &in, bytes);
            if (kind == 0 && (writes || calls)) write_text(folder, number, l->name, &d);
            if (kind == 0 && writes) write_lit_json(folder, number, &d, size);
            if (kind == 0 && calls) write_lit_call(calls, number, &d, &in);
            if (writes) write_lit_inputs(folder, number, kind, bytes, size, &in);
#ifdef CALLS
            if (runs) {
                struct lit_argument list[20];
                lit_arguments(&d, &in, list);
                lit_calls[n](&in, list, answers);
            }
#endif
            if (!writes && !calls) {
                if (!runs && !read_answers(folder, number, kind, answers,
                                           LIT_RAYS * 16u * (unsigned)lit_targets(d.flags, places)))
                    wrong("%s: no answers", l->name);
                judge_lighting(l, &d, &levels[0], jobs, answers, &counts);
            }
            for (k = 0; k < LIT_IMAGES; ++k) free(in.images[k].texels);
            for (k = 0; k < SHADE_LEVELS; ++k) conemap_free(&levels[k]);
        }
        if (writes || calls) continue;
        printf("%s %-42s %5d rays, %5d hits, %3d differ, %d not on an edge\n", dialect == CONEMAP_MSL ? "MSL" : "WGSL",
               l->name, counts.rays, counts.hits, counts.different, counts.unexplained);
        shaded += counts.rays;
        if (counts.hits * 6 < counts.rays) wrong("%s: too few hits", l->name);
        /* A ray to a light that starts 2^-20 over steep ground, or beside a side of the solid, may meet it by the last
           bit, off any edge: one in a thousand, and in nothing but its shadow (32). */
        if (counts.unexplained * 1000 > counts.rays || (counts.what & ~32u) || counts.different * 50 > counts.rays)
            wrong("%s: %d rays differ, %d on no edge (%x)", l->name, counts.different, counts.unexplained, counts.what);
    }
}

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
            conemap_map map;
            struct truth_map truth;
            if (compare_build(&d, item->generator, kind, sizes[size][0], sizes[size][1], 23, heights, &map, &truth) !=
                CONEMAP_OK) {
                wrong("%s: build", item->name);
                break;
            }
            d.map = map.info;
            if ((writes || texts) && kind == 0) {
                write_text(folder, n, item->name, &d);
                if (writes) write_bindings(folder, n, &d);
                if (texts) write_call(calls, n, &d);
            }
            for (k = 0; k < RAYS; ++k) {
                do rays[k] = compare_ray(&random, truth.width, truth.height, k);
                while (compare_on_rim(&truth, &rays[k]) || compare_is_endless(&truth, &rays[k]));
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
    lights(folder, texts || runs ? CONEMAP_MSL : CONEMAP_WGSL, writes, calls, runs);
    if (texts) {
        fprintf(calls, "static void (*const kernel_calls[][%d])(struct grid *, const conemap_gpu_pass *) = {",
                (int)CONEMAP_KERNEL_COUNT);
        for (n = 0; n < MADE; ++n)
            for (k = 0; k < CONEMAP_KERNEL_COUNT; ++k)
                fprintf(calls, "%sitem%d::call%s", k ? ", " : n ? ", {" : "{", 100 * (n + 1) + k,
                        k + 1 == CONEMAP_KERNEL_COUNT ? "}" : "");
        fprintf(calls, "};\n");
        fprintf(calls, "static void (*const lit_calls[])(const struct lit_inputs *, const struct lit_argument *, "
                       "float *) = {");
        for (n = 0; n < LIT; ++n) fprintf(calls, "%sitem%d::call", n ? ", " : "", LIT_FIRST + n);
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
        printf("%s run: %ld rays, %ld differ; %ld cones by kernels; %ld shaded\n", dialect, rays_done, different_done,
               cones_made, shaded);
    return failures != 0;
}
