/* Prints a shader:  emit --dialect hlsl50 --tracer exact > trace.hlsl     (--help lists the options)
   or frusta's:       emit --frusta relief --stage fragment > frusta.frag
   With --kernel one of those that make cone maps on the GPU. */
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"
#include <stdio.h>
#include <stdlib.h>

static const char *const dialects[] = {"glsl330", "glsl430", "glsl450", "vulkan", "es300",
                                       "es310",   "hlsl50",  "hlsl60",  "c99",    "wgsl",
                                       "msl",     NULL};
static const char *const stages[] = {"functions", "fragment", "compute", "vertex", NULL};
static const char *const tracers[] = {"default",    "exact",    "linear", "fixed", "loop",
                                      "exact-step", "cell-max", "maxmip", "qdm",   NULL};
static const char *const refinements[] = {"none", "secant", "bisect", NULL};
static const char *const formats[] = {"f32", "f16", "unorm16", "unorm8", NULL};
static const char *const encodings[] = {"linear", "sqrt", "radius", NULL};
static const char *const layouts[] = {"height-cone", "cone-only", "dummer", NULL};
static const char *const wraps[] = {"clamp", "wrap", "nothing", NULL};
static const char *const filters[] = {"fetch", "gather", "hardware", NULL};
static const char *const guarantees[] = {"default",          "none", "vertex", "bilinear", "relaxed",
                                         "relaxed-bilinear", NULL};
static const char *const kernels[] = {"none",  "ring",   "min3x3", "safe",  "store", "cells",
                                      "texels", "maxima", "quick",  "exact", NULL};
static const char *const generators[] = {"default", "exact", "ring", "quick-naive", "quick", "quick-naive-center",
                                         "quick-center", "relaxed-sampled", "relaxed", "relaxed-exact", NULL};
static const char *const precisions[] = {"highp", "mediump", NULL};
static const char *const frusta_kinds[] = {"no", "plain", "relief", NULL};
static const char *const sources[] = {"default", "buffer", "uniforms", "texture", "texels", NULL};
static const char *const marches[] = {"default", "steps", "cones", NULL};
static const char *const depth_bounds[] = {"any", "greater", "less", NULL};
static const char *const effects[] = { /* as the bits of conemap_effect */
    "clip",   "holes",         "curved", "lod",    "fade",        "two-sided", "position", "normal",
    "smooth-normal", "depth",  "shadow", "soft-shadow", "occlusion", "sky",    "uv",       NULL};

struct option {
    const char *name;
    const char *const *words; /* null: a number or a text */
    int *number;
    float *real;
    const char **text;
    const char *help;
};

/* A list of names with commas between them, as bits; -1 for one that is unknown. */
static int effect_bits(const char *list) {
    int bits = 0, k;
    while (*list) {
        const size_t length = strcspn(list, ",");
        for (k = 0; effects[k] && (strlen(effects[k]) != length || strncmp(effects[k], list, length) != 0);) ++k;
        if (!effects[k]) return -1;
        bits |= 1 << k;
        list += length + (list[length] == ',');
    }
    return bits;
}

static void help(const struct option *options) {
    int k, w;
    printf("emit [options]: prints a shader that traces rays through a cone map, or that draws frusta\n\n");
    for (k = 0; options[k].name; ++k) {
        printf("  %-18s", options[k].name);
        for (w = 0; options[k].words && options[k].words[w]; ++w)
            printf("%s%s", w ? " | " : "", options[k].words[w]);
        printf("%s\n", options[k].help);
    }
}

/* Words of kernels count from 1. */
static conemap_result emit(const conemap_shader_desc *desc, int kernel, char *text, size_t capacity, size_t *size) {
    if (kernel == 0) return conemap_emit(desc, text, capacity, size);
    return conemap_emit_kernel(desc, (conemap_kernel)(kernel - 1), text, capacity, size);
}

int main(int argument_count, char **arguments) {
    conemap_shader_desc desc = {0};
    conemap_frusta_shader_desc frusta = {0};
    int dialect = 0, stage = 0, tracer = 0, refinement = 0, format = 0, encoding = 0, layout = 0, wrap_u = 0,
        wrap_v = 0;
    int filter = 0, guarantee = 0, precision = 0, kernel = 0, generator = 0, kind = 0, source = 0, march = 0;
    int depth_bound = 0, k, m;
    const char *effect_list = "";
    const struct option options[] = {
        {"--dialect", dialects, &dialect, NULL, NULL, ""},
        {"--stage", stages, &stage, NULL, NULL, ""},
        {"--tracer", tracers, &tracer, NULL, NULL, ""},
        {"--refinement", refinements, &refinement, NULL, NULL, ""},
        {"--refine-steps", NULL, &desc.trace.refine_steps, NULL, NULL, "halvings of bisect"},
        {"--max-steps", NULL, &desc.trace.max_steps, NULL, NULL, "a constant step cap"},
        {"--step-scale", NULL, NULL, &desc.trace.step_scale, NULL, "cone steps times this"},
        {"--tolerance", NULL, NULL, &desc.trace.tolerance, NULL, "fixed and loop: what counts as converged"},
        {"--adaptive", NULL, &desc.trace.adaptive_steps, NULL, NULL, "1: loop's steps by the ray's slope"},
        {"--any-hit", NULL, &desc.trace.any_hit, NULL, NULL, "1: only whether there is a hit"},
        {"--format", formats, &format, NULL, NULL, ""},
        {"--encoding", encodings, &encoding, NULL, NULL, ""},
        {"--layout", layouts, &layout, NULL, NULL, ""},
        {"--per-cell", NULL, &desc.map.texture.per_cell, NULL, NULL, "1: a cone for each cell"},
        {"--sectors", NULL, &desc.map.texture.sectors, NULL, NULL, "4 or 8: cones by direction"},
        {"--guarantee", guarantees, &guarantee, NULL, NULL, ""},
        {"--kernel", kernels, &kernel, NULL, NULL, ": of the GPU's generation, instead of a tracer"},
        {"--generator", generators, &generator, NULL, NULL, ": which cones a kernel is for"},
        {"--wrap-u", wraps, &wrap_u, NULL, NULL, ""},
        {"--wrap-v", wraps, &wrap_v, NULL, NULL, ""},
        {"--aspect", NULL, NULL, &desc.map.aspect, NULL, "as in the map's desc"},
        {"--max-tan", NULL, NULL, &desc.map.max_tan, NULL, "as in the map's desc"},
        {"--width", NULL, &desc.map.width, NULL, NULL, "with --fixed-size"},
        {"--height", NULL, &desc.map.height, NULL, NULL, "with --fixed-size"},
        {"--fixed-size", NULL, &desc.fixed_size, NULL, NULL, "1: the size as constants"},
        {"--filter", filters, &filter, NULL, NULL, ""},
        {"--steps", NULL, &desc.steps, NULL, NULL, "1: tell the steps"},
        {"--status", NULL, &desc.status, NULL, NULL, "1: tell how the ray ended"},
        {"--t-range", NULL, &desc.t_range, NULL, NULL, "1: t_min and t_max are arguments"},
        {"--run-time-cap", NULL, &desc.run_time_cap, NULL, NULL, "1: the step cap is an argument"},
        {"--atlas", NULL, &desc.atlas, NULL, NULL, "1: the rectangle in the texture is an argument"},
        {"--array", NULL, &desc.array, NULL, NULL, "1: the slice of the texture array is an argument"},
        {"--effects", NULL, NULL, NULL, &effect_list,
         "some of clip,holes,curved,lod,fade,two-sided,position,normal,smooth-normal,depth,shadow,"
         "soft-shadow,occlusion,sky,uv"},
        {"--depth-bound", depth_bounds, &depth_bound, NULL, NULL, ""},
        {"--precision", precisions, &precision, NULL, NULL, ""},
        {"--external", NULL, &desc.external, NULL, NULL, "1: no declarations of textures"},
        {"--set", NULL, &desc.set, NULL, NULL, "descriptor set or register space"},
        {"--binding", NULL, &desc.binding, NULL, NULL, "of the first texture"},
        {"--sampler-binding", NULL, &desc.sampler_binding, NULL, NULL, "HLSL"},
        {"--prefix", NULL, NULL, NULL, &desc.prefix, "of all names"},
        {"--map-name", NULL, NULL, NULL, &desc.map_name, "texture"},
        {"--octants-name", NULL, NULL, NULL, &desc.octants_name, "texture, with 8 sectors"},
        {"--heights-name", NULL, NULL, NULL, &desc.heights_name, "texture"},
        {"--maxima-name", NULL, NULL, NULL, &desc.maxima_name, "texture"},
        {"--sampler-name", NULL, NULL, NULL, &desc.sampler_name, "HLSL"},
        {"--fetch", NULL, NULL, NULL, &desc.fetch, "a function of the host that reads texels"},
        {"--fetch-cones", NULL, NULL, NULL, &desc.fetch_cones, "the same for cones of sectors"},
        {"--fetch-maxima", NULL, NULL, NULL, &desc.fetch_maxima, "the same for maxima"},
        {"--frusta", frusta_kinds, &kind, NULL, NULL, ": stages functions, vertex, fragment; a map wraps in u"},
        {"--source", sources, &source, NULL, NULL, ": what the frusta are read from"},
        {"--march", marches, &march, NULL, NULL, ""},
        {"--march-steps", NULL, &frusta.steps, NULL, NULL, "equal steps through the shell"},
        {"--linear-v", NULL, &frusta.linear_v, NULL, NULL, "1: v as [BJCW09] approximates it"},
        {"--surface", NULL, NULL, &frusta.height, NULL, "of plain frusta: height in the shell"},
        {"--blend", NULL, NULL, &frusta.blend, NULL, "as in the skeleton's desc"},
        {"--shade", NULL, NULL, NULL, &frusta.shade, "a function of the host that colours a hit"},
        {"--depth-only", NULL, &frusta.depth_only, NULL, NULL, "1: no targets"},
        {"--frusta-name", NULL, NULL, NULL, &frusta.frusta_name, "buffer or texture"},
        {"--fetch-frusta", NULL, NULL, NULL, &frusta.fetch_frusta, "a function of the host that reads rows"},
        {NULL, NULL, NULL, NULL, NULL, NULL},
    };
    conemap_result result;
    size_t size = 0;
    char *text;
    for (k = 1; k < argument_count; k += 2) {
        const struct option *option = options;
        char *end = NULL;
        if (strcmp(arguments[k], "--help") == 0) {
            help(options);
            return 0;
        }
        while (option->name && strcmp(option->name, arguments[k]) != 0) ++option;
        if (!option->name || k + 1 == argument_count) {
            fprintf(stderr, "emit: %s: %s (--help lists the options)\n", arguments[k],
                    option->name ? "needs a value" : "unknown");
            return 1;
        }
        if (option->words) {
            for (m = 0; option->words[m] && strcmp(option->words[m], arguments[k + 1]) != 0;) ++m;
            *option->number = option->words[m] ? m : -1;
            end = option->words[m] ? arguments[k + 1] + strlen(arguments[k + 1]) : arguments[k + 1];
        } else if (option->number) {
            *option->number = (int)strtol(arguments[k + 1], &end, 10);
        } else if (option->real) {
            *option->real = strtof(arguments[k + 1], &end);
        } else {
            *option->text = arguments[k + 1];
        }
        if (end && (*end || end == arguments[k + 1])) {
            fprintf(stderr, "emit: %s %s: no such value\n", arguments[k], arguments[k + 1]);
            return 1;
        }
    }
    desc.dialect = (conemap_dialect)dialect;
    desc.stage = (conemap_stage)stage;
    desc.trace.tracer = (conemap_tracer)tracer;
    desc.trace.refinement = (conemap_refinement)refinement;
    desc.map.texture.format = (conemap_format)format;
    desc.map.texture.encoding = (conemap_encoding)encoding;
    desc.map.texture.layout = (conemap_layout)layout;
    desc.map.wrap_u = (conemap_wrap)wrap_u;
    desc.map.wrap_v = (conemap_wrap)wrap_v;
    desc.map.guarantee = (conemap_guarantee)guarantee;
    desc.filter = (conemap_filter)filter;
    desc.precision = (conemap_precision)precision;
    if (kind == 0 && stage == 3) desc.stage = CONEMAP_STAGE_COUNT; /* there is none */
    frusta.dialect = desc.dialect;
    frusta.stage = stage == 1   ? CONEMAP_FRUSTA_FRAGMENT
                   : stage == 3 ? CONEMAP_FRUSTA_VERTEX
                   : stage == 0 ? CONEMAP_FRUSTA_FUNCTIONS
                                : CONEMAP_FRUSTA_STAGE_COUNT;
    frusta.source = (conemap_frusta_source)source;
    frusta.relief = kind == 2;
    frusta.map = desc.map;
    frusta.fixed_size = desc.fixed_size;
    frusta.filter = desc.filter;
    frusta.march = (conemap_march)march;
    frusta.refine_steps = desc.trace.refine_steps;
    frusta.any_hit = desc.trace.any_hit;
    frusta.set = desc.set;
    frusta.binding = desc.binding;
    frusta.sampler_binding = desc.sampler_binding;
    frusta.prefix = desc.prefix;
    frusta.map_name = desc.map_name;
    frusta.heights_name = desc.heights_name;
    frusta.sampler_name = desc.sampler_name;
    frusta.fetch = desc.fetch;
    if (kind == 2 && wrap_u == 0) frusta.map.wrap_u = CONEMAP_WRAP;
    desc.map.generator = (conemap_generator)generator;
    desc.depth_bound = (conemap_depth_bound)depth_bound;
    if (effect_bits(effect_list) < 0) {
        fprintf(stderr, "emit: --effects %s: no such effect (--help lists them)\n", effect_list);
        return 1;
    }
    desc.flags = frusta.flags = (unsigned)effect_bits(effect_list);
    frusta.depth_bound = desc.depth_bound;
    result = kind ? conemap_emit_frusta(&frusta, NULL, 0, &size) : emit(&desc, kernel, NULL, 0, &size);
    text = result == CONEMAP_OK ? (char *)malloc(size) : NULL;
    if (result == CONEMAP_OK)
        result = !text ? CONEMAP_ERROR_MEMORY
                 : kind ? conemap_emit_frusta(&frusta, text, size, NULL)
                        : emit(&desc, kernel, text, size, NULL);
    if (result != CONEMAP_OK) {
        fprintf(stderr, "emit: %s\n", conemap_result_string(result));
        return 1;
    }
    fputs(text, stdout);
    free(text);
    return 0;
}
