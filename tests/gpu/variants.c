/* Writes shaders for the compilers:  variants DIALECT FOLDER [random count]
   Every value of every option, every pair of two, and a seeded random sample, or with -1 in its place the whole product
   of tracers, refinements, formats, encodings, wraps and effects; equal texts once. What the emitter refuses
   is skipped; the count of each is printed. Functions get what a host adds around them. */
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "../zoo.h"
#include "written.h"

static const struct option options[] = {
    {"stage", 3},    {"tracer", 8},    {"refinement", 3}, {"format", 4},    {"encoding", 3}, {"layout", 3},
    {"per_cell", 2}, {"wrap_u", 3},    {"wrap_v", 3},     {"guarantee", 2}, {"aspect", 2},   {"size", 2},
    {"filter", 3},   {"steps", 2},     {"status", 2},     {"t_range", 2},   {"cap", 3},      {"atlas", 2},
    {"array", 2},    {"precision", 2}, {"external", 2},   {"binding", 2},   {"set", 2},      {"names", 2},
    {"fetch", 2},    {"any", 2},       {"adaptive", 2},   {"scale", 2},     {"bisect", 2},   {"tolerance", 2},
    {"max_tan", 2},  {"sectors", 3},
};
enum { OPTIONS = sizeof options / sizeof options[0] };

static void fill(conemap_shader_desc *d, conemap_dialect dialect, const int *choice)
{
    int k = 0;
    memset(d, 0, sizeof *d);
    d->dialect = dialect;
    d->stage = (conemap_stage)choice[k++];
    d->trace.tracer = (conemap_tracer)(choice[k++] + 1);
    d->trace.refinement = (conemap_refinement)choice[k++];
    d->map.texture.format = (conemap_format)choice[k++];
    d->map.texture.encoding = (conemap_encoding)choice[k++];
    d->map.texture.layout = (conemap_layout)choice[k++];
    d->map.texture.per_cell = choice[k++];
    d->map.wrap_u = (conemap_wrap)choice[k++];
    d->map.wrap_v = (conemap_wrap)choice[k++];
    d->map.guarantee = choice[k++] ? CONEMAP_GUARANTEE_RELAXED : CONEMAP_GUARANTEE_DEFAULT;
    d->map.aspect = choice[k++] ? 0.3f : 0.0f;
    d->fixed_size = choice[k++];
    if (d->fixed_size) {
        d->map.width = 200;
        d->map.height = 100;
    }
    d->filter = (conemap_filter)choice[k++];
    d->steps = choice[k++];
    d->status = choice[k++];
    d->t_range = choice[k++];
    d->run_time_cap = choice[k] == 1;
    d->trace.max_steps = choice[k++] == 2 ? 77 : 0;
    d->atlas = choice[k++];
    d->array = choice[k++];
    d->precision = (conemap_precision)choice[k++];
    d->external = choice[k++];
    d->binding = choice[k++] ? 3 : 0;
    d->set = choice[k++] ? 2 : 0;
    if (choice[k++]) {
        d->prefix = "relief";
        d->map_name = "bumps";
        d->heights_name = "soil";
        d->maxima_name = "tops";
        d->octants_name = "eighths";
        d->sampler_name = "plain";
    }
    if (choice[k++] || dialect == CONEMAP_C99) {
        d->fetch = "host_fetch";
        d->fetch_maxima = "host_maxima";
        d->fetch_cones = "host_cones";
    }
    d->trace.any_hit = choice[k++];
    d->trace.adaptive_steps = choice[k++];
    d->trace.step_scale = choice[k++] ? 0.7f : 0.0f;
    d->trace.refine_steps = choice[k++] ? 3 : 0;
    d->trace.tolerance = choice[k++] ? 0.001f : 0.0f;
    d->map.max_tan = choice[k++] ? 2.5f : 0.0f;
    d->map.texture.sectors = choice[k++] * 4;
}

static void put(const char *more) { strcat(whole, more); }

/* The same around conemap_shade: its settings from the outside. */
static void shade_host(const conemap_shader_desc *d)
{
    const unsigned settings = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW |
                              CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_LOD |
                              CONEMAP_EFFECT_FADE;
    const unsigned gradients = CONEMAP_EFFECT_UV | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE;
    const int hlsl = d->dialect == CONEMAP_HLSL_50 || d->dialect == CONEMAP_HLSL_60, c = d->dialect == CONEMAP_C99;
    const int vulkan = d->dialect == CONEMAP_GLSL_450_VULKAN, set = (d->flags & settings) != 0;
    const int graded = (d->flags & gradients) != 0;
    const char *p = d->prefix ? d->prefix : "conemap", *two = hlsl ? "int2" : "ivec2", *four = hlsl ? "int4" : "ivec4";
    char line[600], call[300];
    sprintf(call, "%s_shade(%shost_frame, %s", p, set ? "host_effects, " : "", c ? "o, o" : "host_ray, -host_ray");
    if (d->t_range) strcat(call, c ? ", 0.1f, 2.0f" : ", 0.1, 2.0");
    if (graded) strcat(call, c ? ", g" : ", host_gradient");
    if (d->atlas) sprintf(call + strlen(call), c ? ", r" : ", %s(1, 2, 3, 4)", four);
    if (d->fetch && !d->fixed_size && !d->atlas) sprintf(call + strlen(call), c ? ", s" : ", %s(3, 4)", two);
    if (d->array) strcat(call, ", 1");
    strcat(call, ")");
    if (c) {
        sprintf(line, "%s%s%s_frame host_frame, %s_vec3 o%s%s%s%s%s%s)", set ? p : "",
                set ? "_effects host_effects, " : "",
                p, p, graded ? ", " : "", graded ? p : "", graded ? "_vec4 g" : "",
                d->atlas        ? ", "
                : d->fixed_size ? ""
                                : ", ",
                d->fixed_size ? "" : p,
                d->atlas        ? "_ivec4 r"
                : d->fixed_size ? ""
                                : "_ivec2 s");
        put("bool host(");
        put(line);
        put(";\nbool host(");
        put(line);
        sprintf(line, " {\n    return %s.found;\n}\n", call);
    } else if (hlsl) {
        sprintf(line, "cbuffer host_block {\n");
        if (set) sprintf(line + strlen(line), "    %s_effects host_effects;\n", p);
        sprintf(line + strlen(line), "    %s_frame host_frame;\n    float4 host_gradient;\n};\n", p);
        sprintf(line + strlen(line),
                "float4 main(float3 host_ray : TEXCOORD0) : SV_Target {\n    return float4(%s.box, 1.0);\n}\n",
                call);
    } else {
        sprintf(line, vulkan ? "layout(binding = 11) uniform host_block {\n" : "");
        if (set) sprintf(line + strlen(line), "%s%s_effects host_effects;\n", vulkan ? "    " : "uniform ", p);
        sprintf(line + strlen(line), "%s%s_frame host_frame;\n%svec4 host_gradient;\n%s", vulkan ? "    " : "uniform ",
                p, vulkan ? "    " : "uniform ", vulkan ? "};\n" : "");
        sprintf(line + strlen(line),
                "%sin vec3 host_ray;\n%sout vec4 host_color;\nvoid main() {\n    host_color = vec4(%s.box, 1.0);\n}\n",
                vulkan ? "layout(location = 0) " : "", vulkan ? "layout(location = 0) " : "", call);
    }
    put(line);
}

/* The same in WGSL and MSL, where a host that fetches or has textures has a struct around all. */
static void wrap_new(const conemap_shader_desc *d)
{
    const int wgsl = d->dialect == CONEMAP_WGSL, functions = d->stage == CONEMAP_STAGE_FUNCTIONS;
    const int cones = d->trace.tracer != CONEMAP_TRACE_LINEAR && d->trace.tracer < CONEMAP_TRACE_MAXMIP;
    const int heights = !cones || d->map.texture.sectors > 1, blocks = d->trace.tracer >= CONEMAP_TRACE_MAXMIP;
    const int lod = (d->flags & CONEMAP_EFFECT_LOD) != 0, own = !wgsl && (d->external || d->fetch);
    const int set = (d->flags & (CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW |
                                 CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY | CONEMAP_EFFECT_HOLES |
                                 CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE)) != 0;
    const int graded = (d->flags & (CONEMAP_EFFECT_UV | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE)) != 0;
    const char *p = d->prefix ? d->prefix : "conemap", *place = d->filter == CONEMAP_FILTER_HARDWARE ? "float" : "int";
    const char *array = d->array ? "_array" : "";
    char line[1000], call[400];
    int k;
    whole[0] = 0;
    if (own) put("#include <metal_stdlib>\nusing namespace metal;\nstruct host {\n");
    for (k = 0; d->external && k < 5; ++k) {
        static const char *const given[5] = {"bumps", "soil", "tops", "eighths", "alpha"},
                                 *const plain[5] = {"map", "heights", "maxima", "octants", "alpha"};
        sprintf(call, "%s%s%s", d->prefix && k < 4 ? "" : p, d->prefix && k < 4 ? "" : "_",
                d->prefix ? given[k] : plain[k]);
        if (k == 4 && (d->fetch || !d->flags)) continue;
        if (wgsl)
            sprintf(line, "@group(0) @binding(%d) var %s: texture_2d%s<f32>;\n", k + 7, call, array);
        else
            sprintf(line, "texture2d%s<float> %s;\n", array, call);
        put(line);
    }
    if (d->external) {
        sprintf(call, "%s", d->prefix ? "plain" : "conemap_sampler");
        sprintf(line, wgsl ? "@group(0) @binding(13) var %s: sampler;\n" : "sampler %s;\n", call);
        put(line);
    }
    if (d->flags && (d->external || own)) {
        sprintf(line,
                wgsl ? "@group(0) @binding(14) var %s_colors: texture_2d<f32>;\n"
                       "@group(0) @binding(15) var %s_color_sampler: sampler;\n"
                     : "texture2d<float> %s_colors;\nsampler %s_color_sampler;\n",
                p, p);
        put(line);
    }
    put(text);
    if (d->fetch) {
        static const char *const names[3] = {"host_fetch", "host_cones", "host_maxima"};
        for (k = 0; k < 4; ++k) {
            const int pair = k == 0 && !heights;
            if ((k == 1 && !(cones && heights)) || (k == 2 && !blocks) ||
                (k == 3 && !(d->flags & CONEMAP_EFFECT_HOLES)))
                continue;
            sprintf(call, "%s%s", k == 3 ? p : "", k == 3 ? "_alpha" : names[k]);
            if (wgsl)
                sprintf(line, "fn %s(i: %s, j: %s%s%s%s) -> %s {\n    return %s(0.01 * f32(i + j)%s);\n}\n", call,
                        k < 2 && place[0] == 'f' ? "f32" : "i32", k < 2 && place[0] == 'f' ? "f32" : "i32",
                        k == 1   ? ", sector: i32"
                        : k == 2 ? ", level: i32"
                                 : "",
                        d->array ? ", slice: i32" : "", lod && k == 0 ? ", level: i32" : "", pair ? "vec2f" : "f32",
                        pair ? "vec2f" : "f32", k == 1 ? " * f32(sector)" : "");
            else
                sprintf(line, "%s %s(%s i, %s j%s%s%s) {\n    return %s(0.01f * float(i + j)%s);\n}\n",
                        pair ? "float2" : "float", call, k < 2 ? place : "int", k < 2 ? place : "int",
                        k == 1   ? ", int sector"
                        : k == 2 ? ", int"
                                 : "",
                        d->array ? ", int" : "", lod && k == 0 ? ", int" : "", pair ? "float2" : "float",
                        k == 1 ? " * float(sector)" : "");
            put(line);
        }
    }
    if (!functions) return;
    if (d->flags)
        sprintf(call, "%s_shade(%shost_frame, host_ray, -host_ray", p, set ? "host_effects, " : "");
    else
        sprintf(call, wgsl ? "%s_%s(host_ray, vec3f(host_ray.xy, -1.0)" : "%s_%s(host_ray, float3(host_ray.xy, -1.0f)",
                p, d->trace.any_hit ? "any_hit" : "trace");
    if (d->t_range) strcat(call, wgsl ? ", 0.1, 2.0" : ", 0.1f, 2.0f");
    if (d->run_time_cap) strcat(call, ", 50");
    if (d->flags && graded) strcat(call, ", host_gradient");
    if (d->atlas) strcat(call, wgsl ? ", vec4i(1, 2, 3, 4)" : ", int4(1, 2, 3, 4)");
    if (d->fetch && !d->fixed_size && !d->atlas) strcat(call, wgsl ? ", vec2i(3, 4)" : ", int2(3, 4)");
    if (d->array) strcat(call, ", 1");
    strcat(call, d->trace.any_hit ? ")" : ").found");
    line[0] = 0;
    if (wgsl) {
        if (d->flags) {
            sprintf(line, "@group(1) @binding(0) var<uniform> host_frame: %s_frame;\n", p);
            if (set) sprintf(line + strlen(line), "@group(1) @binding(1) var<uniform> host_effects: %s_effects;\n", p);
            strcat(line, "@group(1) @binding(2) var<uniform> host_gradient: vec4f;\n");
        }
        sprintf(line + strlen(line),
                "@fragment\nfn host_main(@location(0) host_ray: vec3f) -> @location(0) vec4f {\n"
                "    return vec4f(select(0.0, 1.0, %s));\n}\n", call);
    } else {
        char more[200];
        more[0] = 0;
        if (d->flags) sprintf(more, ", %s%s_frame host_frame, float4 host_gradient", own ? "" : "S::", p);
        if (set) sprintf(more + strlen(more), ", %s%s_effects host_effects", own ? "" : "S::", p);
        if (own)
            sprintf(line, "float4 host_run(float3 host_ray%s) {\n%s    return float4(%s ? 1.0f : 0.0f);\n}\n};\n", more,
                    d->flags && !graded ? "    (void)host_gradient;\n" : "", call);
        else
            sprintf(line,
                    "typedef %s_shader S;\nfloat4 host_run(S shader, float3 host_ray%s);\n"
                    "float4 host_run(S shader, float3 host_ray%s) {\n"
                    "%s    return float4(shader.%s ? 1.0f : 0.0f);\n}\n",
                    p, more, more, d->flags && !graded ? "    (void)host_gradient;\n" : "", call);
    }
    put(line);
}

/* What a host writes around functions, and the functions that it was asked for. */
static void wrap(const conemap_shader_desc *d)
{
    const int hlsl = d->dialect == CONEMAP_HLSL_50 || d->dialect == CONEMAP_HLSL_60, c = d->dialect == CONEMAP_C99;
    const int cones = d->trace.tracer != CONEMAP_TRACE_LINEAR && d->trace.tracer < CONEMAP_TRACE_MAXMIP;
    const int heights = !cones || d->map.texture.sectors > 1;
    const int blocks = d->trace.tracer >= CONEMAP_TRACE_MAXMIP, functions = d->stage == CONEMAP_STAGE_FUNCTIONS;
    const int vulkan = d->dialect == CONEMAP_GLSL_450_VULKAN;
    const char *prefix = d->prefix ? d->prefix : "conemap", *slice = d->array ? ", int slice" : "";
    char line[600];
    if (d->dialect == CONEMAP_WGSL || d->dialect == CONEMAP_MSL) {
        wrap_new(d);
        return;
    }
    whole[0] = 0;
    if (functions && !hlsl && !c) {
        sprintf(line, "#version %s\n", versions[d->dialect]);
        put(line);
    }
    if (d->external && !c) { /* the host's own declarations */
        static const char *const given[4] = {"bumps", "soil", "tops", "eighths"},
                                 *const plain[4] = {"conemap_map", "conemap_heights", "conemap_maxima",
                                                    "conemap_octants"};
        int k;
        for (k = 0; k < 4; ++k) {
            const char *name = d->prefix ? given[k] : plain[k];
            if (hlsl)
                sprintf(line, "Texture2D%s<%s> %s : register(t%d);\n", d->array ? "Array" : "",
                        k == 0 || k == 3 ? "float4" : "float", name, k + 7);
            else if (vulkan)
                sprintf(line, "layout(binding = %d) uniform sampler2D%s %s;\n", k + 7, d->array ? "Array" : "",
                        name);
            else
                sprintf(line, "uniform highp sampler2D%s %s;\n", d->array ? "Array" : "", name);
            put(line);
        }
        if (d->flags) {
            const char *kind = d->array ? "Array" : "", *precise = vulkan ? "" : "highp ";
            line[0] = 0;
            if (!d->fetch) { /* else that is a function, too */
                if (hlsl)
                    sprintf(line, "Texture2D%s<float> %s_alpha : register(t12);\n", kind, prefix);
                else
                    sprintf(line, "%suniform %ssampler2D%s %s_alpha;\n", vulkan ? "layout(binding = 12) " : "", precise,
                            kind, prefix);
            }
            put(line);
            if (hlsl)
                sprintf(line,
                        "Texture2D<float4> %s_colors : register(t13);\nSamplerState %s_color_sampler : register(s8);\n",
                        prefix, prefix);
            else
                sprintf(line, "%suniform %ssampler2D %s_colors;\n", vulkan ? "layout(binding = 13) " : "", precise,
                        prefix);
            put(line);
        }
        if (hlsl) {
            sprintf(line, "SamplerState %s : register(s7);\n", d->prefix ? "plain" : "conemap_sampler");
            put(line);
        }
    }
    put(text);
    if (functions && d->flags) shade_host(d);
    if (functions && !d->flags) {
        char call[400];
        sprintf(call, "%s_%s(%s, %s", prefix, d->trace.any_hit ? "any_hit" : "trace",
                c      ? "o"
                : hlsl ? "p.xyz"
                       : "host_ray",
                c      ? "d"
                : hlsl ? "float3(p.yz, -p.w)"
                       : "vec3(host_ray.xy, -1.0)");
        if (d->t_range) strcat(call, c ? ", 0.1f, 2.0f" : ", 0.1, 2.0");
        if (d->run_time_cap) strcat(call, ", 50");
        if (d->atlas) strcat(call, c ? ", r" : hlsl ? ", int4(1, 2, 3, 4)" : ", ivec4(1, 2, 3, 4)");
        if (d->fetch && !d->fixed_size && !d->atlas)
            strcat(call, c ? ", s" : hlsl ? ", int2(3, 4)" : ", ivec2(3, 4)");
        if (d->array) strcat(call, ", 1");
        strcat(call, ")");
        if (c) {
            char size[100] = "";
            if (d->atlas || !d->fixed_size) sprintf(size, ", %s_%s", prefix, d->atlas ? "ivec4 r" : "ivec2 s");
            sprintf(line,
                    "bool host(%s_vec3 o, %s_vec3 d%s);\nbool host(%s_vec3 o, %s_vec3 d%s) {\n    return %s%s;\n}\n",
                    prefix, prefix, size, prefix, prefix, size, call, d->trace.any_hit ? "" : ".found");
        } else if (hlsl)
            sprintf(line, "float4 main(float4 p : TEXCOORD0) : SV_Target {\n    return %s%s ? 1.0 : 0.0;\n}\n",
                    call, d->trace.any_hit ? "" : ".found");
        else
            sprintf(line,
                    "%sin vec3 host_ray;\n%sout vec4 host_color;\nvoid main() {\n    host_color = vec4(%s%s ? 1.0 "
                    ": 0.0);\n}\n",
                    vulkan ? "layout(location = 0) " : "", vulkan ? "layout(location = 0) " : "", call,
                    d->trace.any_hit ? "" : ".found");
        put(line);
    }
    if (d->fetch) {
        const char *two = hlsl ? "float2"
                          : c  ? ""
                               : "vec2",
                   *index = d->filter == CONEMAP_FILTER_HARDWARE ? "float i, float j" : "int i, int j";
        const char *level = d->flags & CONEMAP_EFFECT_LOD ? ", int level" : "";
        char slices[40];
        sprintf(slices, "%s%s", slice, level);
        if (d->flags & CONEMAP_EFFECT_HOLES) {
            sprintf(line, "float %s_alpha(int i, int j%s) {\n    return %s(i + j%s) * 0.1%s;\n}\n", prefix, slice,
                    c ? "(float)" : "float", d->array ? " + slice" : "", c ? "f" : "");
            put(line);
        }
        slice = slices;
        if (c && !heights)
            sprintf(line,
                    "%s_vec2 host_fetch(%s%s) {\n    %s_vec2 v;\n    v.x = v.y = (float)i + (float)j%s%s;\n    "
                    "return v;\n}\n",
                    prefix, index, slice, prefix, level[0] ? " + (float)level" : "", d->array ? " + (float)slice" : "");
        else if (c)
            sprintf(line, "float host_fetch(%s%s) {\n    return (float)i + (float)j%s%s;\n}\n", index, slice,
                    d->array ? " + (float)slice" : "", level[0] ? " + (float)level" : "");
        else if (heights)
            sprintf(line, "float host_fetch(%s%s) {\n    return 0.01 * float(i + j)%s;\n}\n", index, slice,
                    d->array ? " * float(slice)" : "");
        else
            sprintf(line, "%s host_fetch(%s%s) {\n    return %s(0.01 * float(i + j)%s, 0.5);\n}\n", two, index,
                    slice, two, d->array ? " * float(slice)" : "");
        put(line);
        if (cones && heights) {
            sprintf(line, "float host_cones(%s, int sector%s) {\n    return %s(%ssector + 1%s%s);\n}\n", index, slice,
                    c ? "(float)" : "float", d->filter == CONEMAP_FILTER_HARDWARE ? "(i > j ? 1 : 0) + " : "i + j + ",
                    d->array ? " + slice" : "", level[0] ? " + level" : "");
            put(line);
        }
        if (blocks) {
            slice = d->array ? ", int slice" : "";
            sprintf(line, "float host_maxima(int i, int j, int level%s) {\n    return %s(i + j + level%s);\n}\n",
                    slice, c ? "(float)" : "float", d->array ? " + slice" : "");
            put(line);
        }
    }
}

static void effects(conemap_dialect dialect, const int *choice, unsigned flags, int bound);

static void variant(conemap_dialect dialect, const int *choice) { effects(dialect, choice, 0, 0); }

static void effects(conemap_dialect dialect, const int *choice, unsigned flags, int bound)
{
    static const char *const kinds[3] = {"functions", "fragment", "compute"};
    conemap_shader_desc desc;
    conemap_result result;
    size_t size = 0;
    fill(&desc, dialect, choice);
    desc.flags = flags;
    desc.depth_bound = (conemap_depth_bound)bound;
    result = conemap_emit(&desc, text, sizeof text, &size);
    if (!accepted(result)) return;
    wrap(&desc);
    write_whole(dialect, kinds[desc.stage]);
}

static void kernel_variant(const conemap_shader_desc *desc, conemap_kernel kernel)
{
    if (conemap_emit_kernel(desc, kernel, whole, sizeof whole, NULL) == CONEMAP_OK)
        write_whole(desc->dialect, desc->stage == CONEMAP_STAGE_COMPUTE ? "compute" : "fragment");
    else
        ++refused;
}

/* Relaxed cones and cones by direction: stage x wraps; the other options by turns. */
static void more_kernels(conemap_dialect dialect)
{
    static const struct {
        conemap_kernel kernel;
        conemap_generator generator;
        int sectors, safe;
    } kinds[] = {{CONEMAP_KERNEL_RING, CONEMAP_RELAXED, 0, 0},        {CONEMAP_KERNEL_RING, CONEMAP_RELAXED_EXACT, 0, 0},
                 {CONEMAP_KERNEL_EXACT, CONEMAP_RELAXED, 0, 0},       {CONEMAP_KERNEL_EXACT, CONEMAP_RELAXED_EXACT, 0, 0},
                 {CONEMAP_KERNEL_SAFE, CONEMAP_RELAXED_EXACT, 0, 0},  {CONEMAP_KERNEL_RING, CONEMAP_EXACT, 4, 1},
                 {CONEMAP_KERNEL_RING, CONEMAP_EXACT, 8, 0},          {CONEMAP_KERNEL_RING, CONEMAP_EXACT, 8, 1},
                 {CONEMAP_KERNEL_EXACT, CONEMAP_EXACT, 4, 1},         {CONEMAP_KERNEL_EXACT, CONEMAP_EXACT, 8, 0},
                 {CONEMAP_KERNEL_EXACT, CONEMAP_EXACT, 8, 1},         {CONEMAP_KERNEL_MIN3X3, CONEMAP_EXACT, 4, 0},
                 {CONEMAP_KERNEL_SAFE, CONEMAP_EXACT, 8, 1},          {CONEMAP_KERNEL_STORE, CONEMAP_EXACT, 4, 1},
                 {CONEMAP_KERNEL_STORE, CONEMAP_EXACT, 8, 0}};
    const int count = (int)(sizeof kinds / sizeof kinds[0]);
    int k;
    for (k = 0; dialect != CONEMAP_C99 && k < count * 8; ++k) {
        conemap_shader_desc desc;
        const int kind = k % count, turn = k / count;
        memset(&desc, 0, sizeof desc);
        desc.dialect = dialect;
        desc.stage = turn & 1 ? CONEMAP_STAGE_COMPUTE : CONEMAP_STAGE_FRAGMENT;
        desc.map.generator = kinds[kind].generator;
        desc.map.texture.sectors = kinds[kind].sectors;
        desc.map.guarantee = kinds[kind].safe ? CONEMAP_GUARANTEE_BILINEAR : CONEMAP_GUARANTEE_VERTEX;
        desc.map.texture.format = (conemap_format)(turn % 4);
        desc.map.texture.encoding = (conemap_encoding)(turn % 3);
        desc.map.wrap_u = turn & 2 ? CONEMAP_WRAP : CONEMAP_CLAMP;
        desc.map.wrap_v = turn & 4 ? CONEMAP_WRAP : CONEMAP_NOTHING;
        desc.fixed_size = kind % 2;
        desc.map.width = desc.map.height = 64;
        if ((kind + turn) % 3 == 0) desc.prefix = "relief";
        kernel_variant(&desc, kinds[kind].kernel);
    }
}

/* Kernels: stage x kernel x format x encoding x layout x wrap x constant size, and the quick one's four ways. */
static void kernels(conemap_dialect dialect)
{
    int k;
    more_kernels(dialect);
    for (k = 0; dialect != CONEMAP_C99 && k < 12 * 2 * 2 * 4 * 3 * 3 * 4 * 2; ++k) {
        conemap_shader_desc desc;
        const int kind = k % 12, kernel = kind < CONEMAP_KERNEL_COUNT ? kind : CONEMAP_KERNEL_QUICK;
        const int named = k / 12 % 2, compute = k / 24 % 2;
        memset(&desc, 0, sizeof desc);
        desc.dialect = dialect;
        desc.stage = compute ? CONEMAP_STAGE_COMPUTE : CONEMAP_STAGE_FRAGMENT;
        desc.map.generator = kind < CONEMAP_KERNEL_COUNT ? CONEMAP_QUICK
                             : kind == 9                 ? CONEMAP_QUICK_NAIVE
                             : kind == 10                ? CONEMAP_QUICK_CENTER
                                                         : CONEMAP_QUICK_NAIVE_CENTER;
        desc.map.texture.format = (conemap_format)(k / 48 % 4);
        desc.map.texture.encoding = (conemap_encoding)(k / 192 % 3);
        desc.map.texture.layout = (conemap_layout)(k / 576 % 3);
        desc.map.wrap_u = k / 1728 % 2 ? CONEMAP_WRAP : CONEMAP_CLAMP;
        desc.map.wrap_v = k / 3456 % 2 ? CONEMAP_WRAP : CONEMAP_NOTHING;
        desc.fixed_size = k / 6912;
        desc.map.width = desc.map.height = 64;
        if (named) {
            desc.prefix = "relief";
            desc.binding = dialect == CONEMAP_GLSL_330 || dialect == CONEMAP_ESSL_300 ? 0 : 2;
        }
        kernel_variant(&desc, (conemap_kernel)kernel);
    }
}

/* Effects: every one, every pair, everything together, and a sample with other options. */
static void all_effects(conemap_dialect dialect, int *choice, int sample, struct zoo_random *random)
{
    int stage, a, b, k;
    for (stage = 0; stage < 3; ++stage) {
        memset(choice, 0, OPTIONS * sizeof *choice);
        choice[0] = stage;
        choice[OPTIONS - 1] = stage == 2; /* and with compute, sectors */
        for (a = 0; a < 15; ++a)
            for (b = a; b < 15; ++b) effects(dialect, choice, 1u << a | 1u << b, 0);
        for (k = 0; k < 8; ++k) {
            unsigned most = CONEMAP_EFFECT_ALL_BITS;
            most &= ~(unsigned)(k & 1 ? CONEMAP_EFFECT_NORMAL : CONEMAP_EFFECT_SMOOTH_NORMAL);
            most &= ~(unsigned)(k & 2 ? CONEMAP_EFFECT_SHADOW : CONEMAP_EFFECT_SOFT_SHADOW);
            most &= ~(unsigned)(k & 4 ? CONEMAP_EFFECT_OCCLUSION : CONEMAP_EFFECT_SKY);
            effects(dialect, choice, most, k % 3);
            effects(dialect, choice, most, 0);
        }
        for (k = 0; k < 3; ++k) effects(dialect, choice, CONEMAP_EFFECT_DEPTH, k);
    }
    for (k = 0; k < sample * 40 && sample > 0; ++k) {
        const int before = written;
        unsigned flags = 0;
        for (a = 0; a < OPTIONS; ++a) choice[a] = zoo_below(random, 4) ? 0 : zoo_below(random, options[a].values);
        choice[1] = zoo_below(random, 4) ? 0 : choice[1]; /* mostly the exact tracer and fetches, which effects want */
        choice[12] = zoo_below(random, 4) ? 0 : choice[12];
        for (a = 0; a < 15; ++a) flags |= zoo_below(random, 4) ? 0u : 1u << a;
        effects(dialect, choice, flags, 0);
        sample -= written > before;
    }
}

/* Tracer x refinement x format x encoding x wraps x effect, the last being none or one of them. */
static void product(conemap_dialect dialect, int *choice)
{
    int k;
    for (k = 0; k < 8 * 3 * 4 * 3 * 3 * 3 * 16; ++k) {
        const int effect = k / 2592;
        memset(choice, 0, OPTIONS * sizeof *choice);
        choice[1] = k % 8;
        choice[2] = k / 8 % 3;
        choice[3] = k / 24 % 4;
        choice[4] = k / 96 % 3;
        choice[7] = k / 288 % 3;
        choice[8] = k / 864 % 3;
        effects(dialect, choice, effect ? 1u << (effect - 1) : 0, 0);
    }
}

int main(int argument_count, char **arguments)
{
    int choice[OPTIONS], before, sample, dialect = read_arguments(argument_count, arguments, &sample);
    struct zoo_random random = zoo_seed(2026);
    if (dialect == DIALECT_COUNT) return 1;
    write_choices((conemap_dialect)dialect, options, OPTIONS, choice, sample, &random, variant);
    kernels((conemap_dialect)dialect);
    before = written;
    all_effects((conemap_dialect)dialect, choice, sample / 3, &random);
    printf("%s: %d variants of effects\n", dialects[dialect], written - before);
    if (sample < 0) product((conemap_dialect)dialect, choice);
    printf("%s: %d variants, %d equal to others, %d refused\n", dialects[dialect], written, equal, refused);
    return 0;
}
