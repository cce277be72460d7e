/* Writes the emitted frusta for the compilers:  frusta_variants DIALECT FOLDER [six times the random count]
   Every value of every option, every pair of two, and a seeded random sample; every effect in functions, every pair of
   effects in fragment shaders; equal texts once. What the emitter refuses is skipped; the count of each is printed.
   Functions get what a host adds around them. */
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "../zoo.h"
#include "written.h"

static const struct option options[] = {
    {"stage", 3},     {"source", 5},     {"count", 2},       {"relief", 2}, {"march", 3},  {"linear_v", 2},
    {"steps", 2},     {"refine", 2},     {"format", 4},      {"encoding", 3}, {"layout", 3}, {"per_cell", 2},
    {"wrap_v", 2},    {"guarantee", 2},  {"aspect", 2},      {"size", 2},   {"filter", 3}, {"height", 2},
    {"any", 2},       {"blend", 2},      {"shade", 2},       {"depth", 2},  {"zero", 2},   {"names", 2},
    {"binding", 2},   {"set", 2},        {"fetch", 2},       {"fetch_frusta", 2},
    {"bound", 3},     {"effects", 5}, /* the last */
};
enum { OPTIONS = sizeof options / sizeof options[0] };

/* Of the last option: none, all but those that another is instead of, those, some. */
static const unsigned effects_of[5] = {0, 0x577a, 0x6afa, CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE,
                                       CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_UV};
static unsigned chosen_effects; /* not 0: instead of the option's */

static void fill(conemap_frusta_shader_desc *d, conemap_dialect dialect, const int *choice)
{
    int k = 0;
    memset(d, 0, sizeof *d);
    d->dialect = dialect;
    d->stage = (conemap_frusta_stage)choice[k++];
    d->source = (conemap_frusta_source)choice[k++];
    d->uniform_count = choice[k++] ? 20 : 0;
    d->relief = choice[k++] == 0; /* the first is the one that most options matter to */
    d->march = (conemap_march)choice[k++];
    d->linear_v = choice[k++];
    d->steps = choice[k++] ? 33 : 0;
    d->refine_steps = choice[k++] ? 4 : 0;
    d->map.texture.format = (conemap_format)choice[k++];
    d->map.texture.encoding = (conemap_encoding)choice[k++];
    d->map.texture.layout = (conemap_layout)choice[k++];
    d->map.texture.per_cell = choice[k++];
    d->map.wrap_u = CONEMAP_WRAP;
    d->map.wrap_v = choice[k++] ? CONEMAP_CLAMP : CONEMAP_WRAP;
    d->map.guarantee = choice[k++] ? CONEMAP_GUARANTEE_RELAXED : CONEMAP_GUARANTEE_DEFAULT;
    d->map.aspect = choice[k++] ? 0.3f : 0.0f;
    d->fixed_size = choice[k++];
    d->filter = (conemap_filter)choice[k++];
    d->height = choice[k++] ? 0.7f : 0.0f;
    d->any_hit = choice[k++];
    d->blend = choice[k++] ? 0.5f : 0.0f;
    d->shade = choice[k++] ? "host_shade" : NULL;
    d->depth_only = choice[k++];
    d->zero_to_one = choice[k++];
    if (choice[k++]) {
        d->prefix = "tree";
        d->frusta_name = "limbs";
        d->map_name = "bark";
        d->heights_name = "soil";
        d->sampler_name = "nearest_texel";
    }
    d->binding = choice[k++] ? 3 : 0;
    d->set = choice[k++] ? 2 : 0;
    if (choice[k++] || (dialect == CONEMAP_C99 && d->relief)) {
        d->fetch = "host_fetch";
        d->fixed_size = 1;
    }
    if (d->fixed_size) {
        d->map.width = 200;
        d->map.height = 100;
    }
    if (choice[k++] || dialect == CONEMAP_C99) d->fetch_frusta = "host_rows";
    d->depth_bound = (conemap_depth_bound)choice[k++];
    d->flags = chosen_effects ? chosen_effects : effects_of[choice[k++]];
    if (!d->relief)
        d->flags &= ~(unsigned)(CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_OCCLUSION |
                                CONEMAP_EFFECT_HOLES);
}

/* The same in WGSL and MSL, where a host that fetches has a struct around all. */
static void wrap_new(const conemap_frusta_shader_desc *d)
{
    const int wgsl = d->dialect == CONEMAP_WGSL, cones = strstr(text, "by cone steps") != NULL;
    const int own = !wgsl && (d->fetch_frusta || (d->relief && d->fetch));
    const int functions = d->stage == CONEMAP_FRUSTA_FUNCTIONS;
    const char *p = d->prefix ? d->prefix : "conemap";
    const char *three = wgsl ? "vec3f" : "float3", *four = wgsl ? "vec4f" : "float4";
    char *at = whole, call[600];
    if (own)
        at += sprintf(at,
                      "#include <metal_stdlib>\nusing namespace metal;\nstruct host {\n    texture2d<float> %s, %s;\n"
                      "    sampler %s;\n    %s%s;\n",
                      d->prefix ? "bark" : "conemap_map", d->prefix ? "soil" : "conemap_heights",
                      d->prefix ? "nearest_texel" : "conemap_sampler",
                      d->source == CONEMAP_FRUSTA_TEXTURE    ? "texture2d<int> "
                      : d->source == CONEMAP_FRUSTA_UNIFORMS ? "constant int4 *"
                                                             : "device const int4 *",
                      d->prefix ? "limbs" : "conemap_frusta");
    at += sprintf(at, "%s", text);
    if (d->fetch && d->relief)
        at += wgsl ? sprintf(at, "fn host_fetch(i: i32, j: i32) -> %s {\n    return %s(0.01 * f32(i + j));\n}\n",
                             cones ? "vec2f" : "f32", cones ? "vec2f" : "f32")
                   : sprintf(at, "%s host_fetch(int i, int j) {\n    return %s(0.01f * float(i + j));\n}\n",
                             cones ? "float2" : "float", cones ? "float2" : "float");
    if (d->fetch_frusta)
        at += sprintf(at,
                      wgsl ? "fn host_rows(frustum: i32, row: i32) -> vec4i {\n"
                             "    return vec4i(frustum, row, 1, 2);\n}\n"
                           : "int4 host_rows(int frustum, int row) {\n    return int4(frustum, row, 1, 2);\n}\n");
    if (d->shade)
        at += wgsl ? sprintf(at,
                             "fn host_shade(hit: %s_frustum_hit) -> vec4f {\n    return vec4f(hit.normal, 1.0);\n}\n",
                             p)
                   : sprintf(at,
                             "inline float4 %s_shader::host_shade(%s_frustum_hit hit) {\n"
                             "    return float4(hit.normal, 1.0f);\n}\n", p, p);
    if (!functions) return;
    sprintf(call, "%s%s_%s_frusta(0, 5, place, %s%s_bounds(2, 7), 0.0, 9.0)%s", wgsl || own ? "" : "shader.", p,
            d->any_hit ? "any" : "trace", wgsl || own ? "" : "shader.", p, d->any_hit ? "" : ".found");
    if (!d->any_hit)
        sprintf(call + strlen(call), " || %s%s_see_frustum(1, place, %s(place, 1.0)).found",
                wgsl || own ? "" : "shader.", p, four);
    if (wgsl)
        sprintf(at,
                "@fragment\nfn host_main(@location(0) place: %s) -> @location(0) %s {\n"
                "    return %s(select(0.0, 1.0, %s));\n}\n", three, four, four, call);
    else if (own)
        sprintf(at, "%s host_run(%s place) {\n    return %s(%s ? 1.0f : 0.0f);\n}\n};\n", four, three, four, call);
    else
        sprintf(at, "inline %s host_run(%s_shader shader, %s place) {\n    return %s(%s ? 1.0f : 0.0f);\n}\n", four, p,
                three, four, call);
}

/* What a host writes around functions, and the functions that it was asked for. */
static void wrap(const conemap_frusta_shader_desc *d)
{
    const int hlsl = d->dialect == CONEMAP_HLSL_50 || d->dialect == CONEMAP_HLSL_60, c = d->dialect == CONEMAP_C99;
    const int cones = strstr(text, "by cone steps") != NULL, vulkan = d->dialect == CONEMAP_GLSL_450_VULKAN;
    const char *prefix = d->prefix ? d->prefix : "conemap";
    const char *vec2 = hlsl ? "float2" : "vec2", *vec3 = hlsl ? "float3" : "vec3", *vec4 = hlsl ? "float4" : "vec4";
    const int effects = d->stage == CONEMAP_FRUSTA_FUNCTIONS && strstr(text, "frusta_effects e") != NULL;
    const char *e = effects ? "host_effects, " : "";
    char *at = whole;
    whole[0] = 0;
    if (d->dialect == CONEMAP_WGSL || d->dialect == CONEMAP_MSL) {
        wrap_new(d);
        return;
    }
    if (d->stage == CONEMAP_FRUSTA_FUNCTIONS && !hlsl && !c) at += sprintf(at, "#version %s\n", versions[d->dialect]);
    at += sprintf(at, "%s", text);
    if (d->stage == CONEMAP_FRUSTA_FUNCTIONS) {
        if (c) {
            at += sprintf(at, "int host(int k, %s_vec3 o, %s_vec4 e);\nint host(int k, %s_vec3 o, %s_vec4 e) {\n", prefix,
                          prefix, prefix, prefix);
            if (effects) at += sprintf(at, "    static const %s_frusta_effects host_effects;\n", prefix);
            if (d->any_hit)
                at += sprintf(at, "    (void)e;\n    return %s_any_frusta(0, k, o, %s_bounds(k, 0), 0.0f, 1.0f);\n}\n",
                              prefix, prefix);
            else
                at += sprintf(at,
                              "    return %s_trace_frusta(%s0, k, o, %s_bounds(k, 0), 0.0f, 1.0f).found +\n           "
                              "%s_see_frustum(%sk, o, e).found;\n}\n",
                              prefix, e, prefix, prefix, e);
        } else {
            char call[600];
            const char *place = hlsl ? "place" : "host_place";
            sprintf(call, "%s_%s_frusta(%s0, 5, %s.xyz, %s_bounds(2, 7), 0.0, 9.0)%s", prefix,
                    d->any_hit ? "any" : "trace", e, place, prefix, d->any_hit ? "" : ".found");
            if (!d->any_hit)
                sprintf(call + strlen(call), " || %s_see_frustum(%s1, %s.xyz, %s).found", prefix, e, place, place);
            if (effects && hlsl)
                at += sprintf(at, "cbuffer host_settings : register(b9) {\n    %s_frusta_effects host_effects;\n};\n",
                              prefix);
            else if (effects && vulkan)
                at += sprintf(at,
                              "layout(set = 3, binding = 9) uniform host_settings {\n"
                              "    %s_frusta_effects host_effects;\n};\n",
                              prefix);
            else if (effects)
                at += sprintf(at, "uniform %s_frusta_effects host_effects;\n", prefix);
            if (hlsl)
                at += sprintf(at, "float4 main(float4 place : TEXCOORD0) : SV_Target {\n    return %s ? 1.0 : 0.0;\n}\n",
                              call);
            else
                at += sprintf(at,
                              "%sin vec4 host_place;\n%sout vec4 host_color;\nvoid main() {\n    host_color = vec4(%s ? "
                              "1.0 : 0.0);\n}\n",
                              vulkan ? "layout(location = 0) " : "", vulkan ? "layout(location = 0) " : "", call);
        }
    }
    if (d->shade)
        at += sprintf(at, "%s host_shade(%s_frustum_hit hit) {\n    return %s(hit.position, 1.0);\n}\n", vec4, prefix, vec4);
    if (d->fetch && d->relief) {
        if (d->flags & CONEMAP_EFFECT_HOLES)
            at += sprintf(at, "float %s_alpha(int i, int j) {\n    return 0.1%s * %s(i + j);\n}\n", prefix, c ? "f" : "",
                          c ? "(float)" : "float");
        if (c && cones)
            at += sprintf(at, "%s_vec2 host_fetch(int i, int j) {\n    %s_vec2 v;\n    v.x = v.y = (float)(i + j);\n    "
                              "return v;\n}\n",
                          prefix, prefix);
        else if (c || !cones)
            at += sprintf(at, "float host_fetch(int i, int j) {\n    return %s(i + j);\n}\n", c ? "(float)" : "float");
        else
            at += sprintf(at, "%s host_fetch(int i, int j) {\n    return %s(0.01 * float(i + j), 0.5);\n}\n", vec2, vec2);
    }
    if (d->fetch_frusta) {
        const char *ivec4 = hlsl ? "int4" : c ? "_ivec4" : "ivec4";
        if (hlsl) at += sprintf(at, "cbuffer host_block : register(b7) {\n    int4 host_given;\n};\n");
        else if (vulkan) at += sprintf(at, "layout(push_constant) uniform host_block {\n    ivec4 host_given;\n};\n");
        else if (!c) at += sprintf(at, "uniform ivec4 host_given;\n");
        at += sprintf(at, "%s%s host_rows(int frustum, int row) {\n", c ? prefix : "", ivec4);
        at += c ? sprintf(at, "    %s_ivec4 v;\n    v.x = v.y = v.z = v.w = frustum + row;\n    return v;\n}\n", prefix)
                : sprintf(at, "    return host_given + %s(frustum, row, 1, 2);\n}\n", ivec4);
    }
    (void)vec3;
    (void)at;
}

static void variant(conemap_dialect dialect, const int *choice)
{
    static const char *const kinds[3] = {"functions", "vertex", "fragment"};
    conemap_frusta_shader_desc desc;
    conemap_result result;
    size_t size = 0;
    fill(&desc, dialect, choice);
    result = conemap_emit_frusta(&desc, text, sizeof text, &size);
    if (!accepted(result)) return;
    wrap(&desc);
    write_whole(dialect, kinds[desc.stage]);
}

int main(int argument_count, char **arguments)
{
    int choice[OPTIONS], sample, a, b, dialect = read_arguments(argument_count, arguments, &sample);
    struct zoo_random random = zoo_seed(2027);
    if (dialect == DIALECT_COUNT) return 1;
    write_choices((conemap_dialect)dialect, options, OPTIONS, choice, sample / 6, &random, variant);
    memset(choice, 0, sizeof choice);
    for (choice[0] = 0; choice[0] < 3; choice[0] += 2) /* the stage */
        for (a = 0; a < 15; ++a)
            for (b = choice[0] ? 0 : a; b <= a; ++b) {
                chosen_effects = 1u << a | 1u << b;
                variant((conemap_dialect)dialect, choice);
            }
    printf("frusta, %s: %d variants, %d equal to others, %d refused\n", dialects[dialect], written, equal, refused);
    return 0;
}
