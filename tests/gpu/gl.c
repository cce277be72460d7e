/* Emitted GLSL on a software GPU (Mesa, surfaceless EGL) against the CPU's tracers and the truth. Builds and runs only
   in check.sh; exits with 77 where there is no such GPU. */
#define _POSIX_C_SOURCE 199309L /* clock_gettime */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "../emit_compare.h"

#include "software.h"

#define SIDE 64 /* rays: SIDE * SIDE */
#define RAYS (SIDE * SIDE)

/* A context to draw and read SIDE x SIDE pixels with. */
static void open_context(int es)
{
    context(es);
    gl.Viewport(0, 0, SIDE, SIDE);
    if (!es) gl.Enable(GL_PROGRAM_POINT_SIZE);
}

static GLuint texture(int array, int mips, int width, int height, GLenum internal, GLenum format, GLenum type,
                      int atlas, GLenum filter, GLenum wrap_u, GLenum wrap_v, const void *pixels)
{
    const GLenum target = array ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
    GLuint name;
    gl.GenTextures(1, &name);
    gl.BindTexture(target, name);
    if (array) { /* slice 1 of 2 */
        gl.TexImage3D(target, 0, (GLint)internal, width, height, 2, 0, format, type, NULL);
        gl.TexSubImage3D(target, 0, 0, 0, 1, width, height, 1, format, type, pixels);
    } else if (atlas) { /* at (5, 3) of a larger one */
        gl.TexImage2D(target, 0, (GLint)internal, width + 9, height + 7, 0, format, type, NULL);
        gl.TexSubImage2D(target, 0, 5, 3, width, height, format, type, pixels);
    } else {
        gl.TexImage2D(target, 0, (GLint)internal, width, height, 0, format, type, pixels);
    }
    gl.TexParameteri(target, GL_TEXTURE_MIN_FILTER, (GLint)(mips ? GL_NEAREST_MIPMAP_NEAREST : filter));
    gl.TexParameteri(target, GL_TEXTURE_MAG_FILTER, (GLint)(mips ? GL_NEAREST : filter));
    gl.TexParameteri(target, GL_TEXTURE_WRAP_S, (GLint)wrap_u);
    gl.TexParameteri(target, GL_TEXTURE_WRAP_T, (GLint)wrap_v);
    return name;
}

/* HLSL and Vulkan's GLSL cannot be run here, but what a compiler of them makes can: in a first run the texts are written
   into a folder, then compiled to SPIR-V and translated to GLSL by others (shaders.sh), and a second run takes these in
   the same order. */
static const char *hlsl_folder;
static int hlsl_writes, hlsl_count;

static int is_hlsl(conemap_dialect dialect) { return dialect == CONEMAP_HLSL_50 || dialect == CONEMAP_HLSL_60; }
static int is_translated(conemap_dialect dialect) { return is_hlsl(dialect) || dialect == CONEMAP_GLSL_450_VULKAN; }
static int is_es(conemap_dialect dialect) { return dialect == CONEMAP_ESSL_300 || dialect == CONEMAP_ESSL_310; }

static GLuint translated_program(conemap_dialect dialect, const char *text)
{
    static char glsl[200000];
    char path[600];
    FILE *file;
    size_t size;
    sprintf(path, "%.500s/%03d_compute.%s", hlsl_folder, hlsl_count++,
            !hlsl_writes       ? "comp"
            : is_hlsl(dialect) ? "hlsl"
                               : "vulkan");
    file = fopen(path, hlsl_writes ? "wb" : "rb");
    size = !file ? 0 : hlsl_writes ? fwrite(text, 1, strlen(text), file) : fread(glsl, 1, sizeof glsl - 1, file);
    glsl[size] = 0;
    if (file) fclose(file);
    if (size == 0) {
        wrong("%s: cannot be opened", path);
        exit(1);
    }
    return hlsl_writes ? 0 : program(shader(GL_COMPUTE_SHADER, glsl), 0);
}

/* A fetch of the host's that filters as most GPUs do: weights rounded to 8 bits. */
static const char eight_bits[] =
    "uniform highp sampler2D conemap_map;\n"
    "vec2 host_texel(ivec2 p, ivec2 size) {\n"
    "    return texelFetch(conemap_map, clamp(p, ivec2(0), size - 1), 0).rg;\n"
    "}\n"
    "vec2 host_fetch(float u, float v) {\n"
    "    ivec2 size = textureSize(conemap_map, 0);\n"
    "    vec2 p = floor((vec2(u, v) * vec2(size) - 0.5) * 256.0 + 0.5) / 256.0;\n"
    "    ivec2 c = ivec2(floor(p));\n"
    "    p -= vec2(c);\n"
    "    return mix(mix(host_texel(c, size), host_texel(c + ivec2(1, 0), size), p.x),\n"
    "               mix(host_texel(c + ivec2(0, 1), size), host_texel(c + 1, size), p.x), p.y);\n"
    "}\n";

struct run {
    const char *name;
    conemap_shader_desc desc;
    conemap_generator generator;
    int count_only; /* differences are counted, not judged: coarse filter weights */
};

static float rays_o[RAYS * 4], rays_d[RAYS * 4], answers[2][RAYS * 4];
static conemap_ray rays[RAYS];
static struct compare_counts total;
static int runs_done;

static const char *sampler_of_hlsl = "conemap_sampler";

static void uniform_i(GLuint p, const char *name, int value)
{
    GLint at = gl.GetUniformLocation(p, name);
    if (at < 0 && hlsl_folder) { /* textures by themselves, and with a sampler */
        char combined[160];
        sprintf(combined, "SPIRV_Cross_Combined%.60sSPIRV_Cross_DummySampler", name);
        at = gl.GetUniformLocation(p, combined);
        if (at >= 0) gl.Uniform1i(at, value);
        sprintf(combined, "SPIRV_Cross_Combined%.60s%.40s", name, sampler_of_hlsl);
        at = gl.GetUniformLocation(p, combined);
    }
    if (at >= 0) gl.Uniform1i(at, value);
}

static GLuint build(const struct run *r)
{
    static char text[70000], whole[90000], name[64];
    static const char *const versions[] = {"330 core", "430 core", "450 core", "", "300 es", "310 es"};
    const conemap_shader_desc *d = &r->desc;
    conemap_result result = conemap_emit(d, text, sizeof text, NULL);
    if (result != CONEMAP_OK) {
        wrong("%s: %s", r->name, conemap_result_string(result));
        exit(1);
    }
    if (is_translated(d->dialect)) return translated_program(d->dialect, text);
    if (d->stage == CONEMAP_STAGE_COMPUTE) return program(shader(GL_COMPUTE_SHADER, text), 0);
    if (d->stage == CONEMAP_STAGE_FRAGMENT) {
        const char *place =
            d->dialect == CONEMAP_GLSL_330 || d->dialect == CONEMAP_ESSL_300 ? "" : "layout(location = %d) ";
        char places[2][64];
        sprintf(places[0], place, 0);
        sprintf(places[1], place, 1);
        sprintf(
            whole,
            "#version %s\nprecision highp float;\nuniform highp sampler2D rays_o, rays_d;\n%sout vec3 "
            "conemap_origin;\n%sout vec3 conemap_direction;\n"
            "void main() {\n    ivec2 p = ivec2(gl_VertexID %% %d, gl_VertexID / %d);\n"
            "    conemap_origin = texelFetch(rays_o, p, 0).xyz;\n    conemap_direction = texelFetch(rays_d, p, "
            "0).xyz;\n"
            "    gl_PointSize = 1.0;\n    gl_Position = vec4((vec2(p) + 0.5) / %d.0 * 2.0 - 1.0, 0.0, 1.0);\n}\n",
            versions[d->dialect], places[0], places[1], SIDE, SIDE, SIDE);
        return program(shader(GL_VERTEX_SHADER, whole), shader(GL_FRAGMENT_SHADER, text));
    }
    sprintf(whole, "#version %s\nprecision highp float;\n", versions[d->dialect]);
    if (d->external)
        sprintf(whole + strlen(whole), "uniform highp %s conemap_map;\n",
                d->array ? "sampler2DArray" : "sampler2D");
    strcat(whole, text);
    if (d->fetch && d->filter == CONEMAP_FILTER_HARDWARE)
        strcat(whole, eight_bits);
    else if (d->fetch)
        strcat(whole, "uniform highp sampler2D conemap_map;\nvec2 host_fetch(int i, int j) {\n    return "
                      "texelFetch(conemap_map, ivec2(i, j), 0).rg;\n}\n");
    sprintf(name, "%s_%s", d->prefix ? d->prefix : "conemap", d->trace.any_hit ? "any_hit" : "trace");
    sprintf(whole + strlen(whole),
            "uniform highp sampler2D rays_o, rays_d;\nuniform highp ivec4 given_rect;\nuniform highp ivec2 "
            "given_size;\n"
            "uniform highp int given_cap, given_slice;\n"
            "layout(location = 0) out vec4 answer;\nlayout(location = 1) out vec4 more;\nvoid main() {\n"
            "    ivec2 p = ivec2(gl_FragCoord.xy);\n    vec4 o = texelFetch(rays_o, p, 0), d = texelFetch(rays_d, "
            "p, 0);\n"
            "    %s hit = %s(o.xyz, d.xyz%s%s%s%s%s);\n",
            d->trace.any_hit ? "bool"
            : d->prefix      ? "relief_hit"
                             : "conemap_hit",
            name, d->t_range ? ", o.w, d.w" : "", d->run_time_cap ? ", given_cap" : "",
            d->atlas ? ", given_rect" : "", d->fetch && !d->fixed_size && !d->atlas ? ", given_size" : "",
            d->array ? ", given_slice" : "");
    if (d->trace.any_hit)
        strcat(whole, "    answer = vec4(0.0, 0.0, 0.0, hit ? 0.0 : -1.0);\n    more = vec4(hit ? 1.0 : 0.0, 0.0, "
                      "0.0, 0.0);\n}\n");
    else
        sprintf(whole + strlen(whole),
                "    answer = vec4(hit.position, hit.found ? hit.t : -1.0);\n    more = vec4(hit.found ? 1.0 : "
                "0.0, %s, %s, 0.0);\n}\n",
                d->status ? "float(hit.status)" : "-1.0", d->steps ? "float(hit.steps)" : "-1.0");
    {
        char vertex[400];
        sprintf(vertex,
                "#version %s\nvoid main() {\n    gl_Position = vec4(float(gl_VertexID %% 2) * 4.0 - 1.0, "
                "float(gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0);\n}\n",
                versions[d->dialect]);
        return program(shader(GL_VERTEX_SHADER, vertex), shader(GL_FRAGMENT_SHADER, whole));
    }
}

static GLuint maxima_texture(const conemap_map *map, int array)
{
    const GLenum target = array ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
    int k, levels = conemap_maxima_levels(map);
    GLuint name;
    gl.GenTextures(1, &name);
    gl.BindTexture(target, name);
    for (k = 0; k < levels; ++k) {
        int side = 1 << (levels - 1 - k);
        float *values = (float *)malloc((size_t)side * (size_t)side * sizeof(float));
        conemap_write_maxima(map, k, values, (size_t)side * (size_t)side * sizeof(float));
        if (array) {
            gl.TexImage3D(target, k, GL_R32F, side, side, 2, 0, GL_RED, GL_FLOAT, NULL);
            gl.TexSubImage3D(target, k, 0, 0, 1, side, side, 1, GL_RED, GL_FLOAT, values);
        } else {
            gl.TexImage2D(target, k, GL_R32F, side, side, 0, GL_RED, GL_FLOAT, values);
        }
        free(values);
    }
    gl.TexParameteri(target, GL_TEXTURE_MIN_FILTER, GL_NEAREST_MIPMAP_NEAREST);
    gl.TexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return name;
}

static void draw(const struct run *r, GLuint p, const conemap_map *map, GLuint targets[2], GLuint ray_textures[2])
{
    const conemap_shader_desc *d = &r->desc;
    const GLenum target = d->array ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
    const GLenum filter = d->filter == CONEMAP_FILTER_FETCH ? GL_NEAREST : GL_LINEAR;
    const GLenum wrap_u = d->map.wrap_u == CONEMAP_WRAP ? GL_REPEAT : GL_CLAMP_TO_EDGE,
                 wrap_v = d->map.wrap_v == CONEMAP_WRAP ? GL_REPEAT : GL_CLAMP_TO_EDGE;
    const char *prefix = d->prefix ? d->prefix : "conemap";
    conemap_format_numbers numbers;
    GLuint names[6] = {0, 0, 0, 0, 0, 0}, buffers[3]; /* 3 and 4 are the rays' */
    char name[80];
    size_t size = conemap_texture_size(map, 0);
    void *pixels = malloc(size);
    int k;
    const float empty[4] = {0.0f, 0.0f, 0.0f, -1.0f};
    conemap_get_format_numbers(&map->info.texture, &numbers);
    conemap_write_texture(map, pixels, size, 0);
    names[0] = texture(d->array, 0, map->info.width, map->info.height, numbers.gl_internal, numbers.gl_format,
                       numbers.gl_type, d->atlas, filter, wrap_u, wrap_v, pixels);
    if (map->info.texture.sectors == 8) {
        conemap_write_texture_at(map, 1, pixels, size, 0);
        names[5] = texture(d->array, 0, map->info.width, map->info.height, numbers.gl_internal, numbers.gl_format,
                           numbers.gl_type, d->atlas, filter, wrap_u, wrap_v, pixels);
    }
    names[1] = texture(d->array, 0, map->info.width, map->info.height, GL_R32F, GL_RED, GL_FLOAT, d->atlas, filter,
                       wrap_u, wrap_v, map->heights);
    free(pixels);
    names[2] = maxima_texture(map, d->array);
    gl.UseProgram(p);
    for (k = 0; k < 6; ++k) {
        static const char *const endings[6] = {"map", "heights", "maxima", "", "", "octants"};
        if (!endings[k][0]) continue;
        gl.ActiveTexture(GL_TEXTURE0 + (GLenum)k);
        gl.BindTexture(target, names[k]);
        sprintf(name, "%s_%s", prefix, endings[k]);
        uniform_i(p,
                  k == 0 && d->map_name       ? d->map_name
                  : k == 1 && d->heights_name ? d->heights_name
                  : k == 2 && d->maxima_name  ? d->maxima_name
                  : k == 5 && d->octants_name ? d->octants_name
                                              : name,
                  k);
    }
    for (k = 0; k < 2; ++k) {
        gl.ActiveTexture(GL_TEXTURE3 + (GLenum)k);
        gl.BindTexture(GL_TEXTURE_2D, ray_textures[k]);
        uniform_i(p, k ? "rays_d" : "rays_o", 3 + k);
    }
    for (k = 0; k < 2; ++k) { /* functions get arguments from our main, whole shaders have uniforms */
        GLint at;
        uniform_i(p, k ? "conemap_slice" : "given_slice", 1);
        uniform_i(p, k ? "conemap_max_steps" : "given_cap", 100000);
        if ((at = gl.GetUniformLocation(p, k ? "conemap_rect" : "given_rect")) >= 0)
            gl.Uniform4i(at, 5, 3, map->info.width, map->info.height);
        if ((at = gl.GetUniformLocation(p, k ? "conemap_map_size" : "given_size")) >= 0)
            gl.Uniform2i(at, map->info.width, map->info.height);
        if ((at = gl.GetUniformLocation(p, "conemap_range")) >= 0) gl.Uniform2f(at, 0.1f, 0.7f);
    }
    if (d->stage == CONEMAP_STAGE_COMPUTE) {
        const int wide = d->steps || d->status ? 2 : 1, sectors = d->map.texture.sectors;
        const int first = d->binding + (sectors > 1 ? sectors / 4 + 1
                                      : 1 + (d->map.texture.layout == CONEMAP_CONE_ONLY ||
                                             d->trace.tracer >= CONEMAP_TRACE_MAXMIP));
        float *both = (float *)malloc(RAYS * 8 * sizeof(float));
        const float *back;
        for (k = 0; k < RAYS; ++k) {
            memcpy(both + 8 * k, rays_o + 4 * k, 16);
            memcpy(both + 8 * k + 4, rays_d + 4 * k, 16);
        }
        gl.GenBuffers(3, buffers);
        gl.BindBuffer(GL_SHADER_STORAGE_BUFFER, buffers[0]);
        gl.BufferData(GL_SHADER_STORAGE_BUFFER, RAYS * 8 * sizeof(float), both, GL_STATIC_DRAW);
        gl.BindBuffer(GL_SHADER_STORAGE_BUFFER, buffers[1]);
        gl.BufferData(GL_SHADER_STORAGE_BUFFER, (GLsizeiptr)(RAYS * 4 * sizeof(float)) * wide, NULL,
                      GL_STATIC_DRAW);
        gl.BindBufferBase(GL_SHADER_STORAGE_BUFFER, (GLuint)first, buffers[0]);
        if (is_hlsl(d->dialect)) /* where glslang puts it */
            gl.BindBufferBase(GL_SHADER_STORAGE_BUFFER, (GLuint)first + 8, buffers[0]);
        gl.BindBufferBase(GL_SHADER_STORAGE_BUFFER, is_hlsl(d->dialect) ? 8 : (GLuint)first + 1, buffers[1]);
        if (d->dialect == CONEMAP_GLSL_450_VULKAN) { /* push constants, as a block */
            const GLint values[4] = {100000, 1, 0, 0};
            gl.BindBuffer(GL_UNIFORM_BUFFER, buffers[2]);
            gl.BufferData(GL_UNIFORM_BUFFER, sizeof values, values, GL_STATIC_DRAW);
            gl.BindBufferBase(GL_UNIFORM_BUFFER, 0, buffers[2]);
        }
        gl.DispatchCompute(RAYS / 64, 1, 1);
        gl.MemoryBarrier(GL_ALL_BARRIER_BITS);
        back = (const float *)gl.MapBufferRange(GL_SHADER_STORAGE_BUFFER, 0,
                                                (GLsizeiptr)(RAYS * 4 * sizeof(float)) * wide, GL_MAP_READ_BIT);
        for (k = 0; back && k < RAYS; ++k) {
            memcpy(answers[0] + 4 * k, back + 4 * wide * k, 16);
            answers[1][4 * k] = answers[0][4 * k + 3] >= 0.0f;
            answers[1][4 * k + 2] = d->steps ? back[8 * k + 4] : -1.0f;
            answers[1][4 * k + 1] = d->status ? back[8 * k + 5] : -1.0f;
        }
        gl.UnmapBuffer(GL_SHADER_STORAGE_BUFFER);
        gl.DeleteBuffers(3, buffers);
        free(both);
    } else {
        (void)targets;
        gl.ClearBufferfv(GL_COLOR, 0, empty);
        gl.ClearBufferfv(GL_COLOR, 1, empty);
        if (d->stage == CONEMAP_STAGE_FRAGMENT)
            gl.DrawArrays(GL_POINTS, 0, RAYS);
        else
            gl.DrawArrays(GL_TRIANGLES, 0, 3);
        gl.ReadBuffer(GL_COLOR_ATTACHMENT0);
        gl.ReadPixels(0, 0, SIDE, SIDE, GL_RGBA, GL_FLOAT, answers[0]);
        gl.ReadBuffer(GL_COLOR_ATTACHMENT1);
        gl.ReadPixels(0, 0, SIDE, SIDE, GL_RGBA, GL_FLOAT, answers[1]);
        if (d->stage == CONEMAP_STAGE_FRAGMENT)
            for (k = 0; k < RAYS; ++k) {
                float steps = answers[1][4 * k], status = answers[1][4 * k + 1];
                answers[1][4 * k] = d->status ? status == 0.0f : answers[0][4 * k + 3] >= 0.0f;
                answers[1][4 * k + 1] = d->status ? status : -1.0f;
                answers[1][4 * k + 2] = steps;
            }
    }
    gl.DeleteTextures(6, names);
    if (gl.GetError() != 0) wrong("%s: a GL error", r->name);
}

static void run(const struct run *r)
{
    static const int sizes[2][2] = {{64, 48}, {17, 23}};
    static float heights[64 * 64];
    static GLuint targets[2], ray_textures[2], frame;
    static int es_of_targets = -1;
    const int es = is_es(r->desc.dialect);
    struct zoo_random random = zoo_seed(99);
    struct compare_counts counts;
    conemap_shader_desc desc = r->desc;
    struct run here = *r;
    GLuint p = 0;
    int kind, k, size;
    memset(&counts, 0, sizeof counts);
    if (es != es_of_targets) {
        const GLenum both[2] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
        open_context(es);
        es_of_targets = es;
        gl.GenFramebuffers(1, &frame);
        gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
        for (k = 0; k < 2; ++k) {
            targets[k] = texture(0, 0, SIDE, SIDE, GL_RGBA32F, GL_RGBA, GL_FLOAT, 0, GL_NEAREST, GL_CLAMP_TO_EDGE,
                                 GL_CLAMP_TO_EDGE, NULL);
            gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0 + (GLenum)k, GL_TEXTURE_2D, targets[k],
                                    0);
        }
        gl.DrawBuffers(2, both);
        if (gl.CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
            printf("no float targets\n");
            exit(77);
        }
    }
    for (kind = 0; kind < ZOO_KINDS; ++kind) {
        conemap_map map;
        struct truth_map truth;
        size = desc.fixed_size ? 0 : kind & 1;
        if (compare_build(&desc, r->generator, kind, sizes[size][0], sizes[size][1], 23, heights, &map, &truth) !=
            CONEMAP_OK) {
            wrong("%s: build", r->name);
            return;
        }
        if (!p) {
            const int fixed = desc.fixed_size;
            here.desc.map = map.info;
            here.desc.fixed_size = fixed;
            p = build(&here);
            if (is_translated(desc.dialect) && hlsl_writes) {
                conemap_free(&map);
                return;
            }
        }
        for (k = 0; k < RAYS; ++k) {
            do rays[k] = compare_ray(&random, truth.width, truth.height, k);
            while (compare_on_rim(&truth, &rays[k]) || compare_is_endless(&truth, &rays[k]));
            if (desc.t_range) {
                rays[k].t_min = 0.1f;
                rays[k].t_max = 0.7f;
            }
            memcpy(rays_o + 4 * k, rays[k].origin, 12);
            memcpy(rays_d + 4 * k, rays[k].direction, 12);
            rays_o[4 * k + 3] = rays[k].t_min;
            rays_d[4 * k + 3] = rays[k].t_max;
        }
        ray_textures[0] = texture(0, 0, SIDE, SIDE, GL_RGBA32F, GL_RGBA, GL_FLOAT, 0, GL_NEAREST, GL_CLAMP_TO_EDGE,
                                  GL_CLAMP_TO_EDGE, rays_o);
        ray_textures[1] = texture(0, 0, SIDE, SIDE, GL_RGBA32F, GL_RGBA, GL_FLOAT, 0, GL_NEAREST, GL_CLAMP_TO_EDGE,
                                  GL_CLAMP_TO_EDGE, rays_d);
        draw(&here, p, &map, targets, ray_textures);
        gl.DeleteTextures(2, ray_textures);
        for (k = 0; k < RAYS; ++k) {
            struct shader_hit hit;
            hit.found = answers[1][4 * k] > 0.5f;
            hit.status = desc.status ? (int)answers[1][4 * k + 1] : -1;
            hit.steps = (int)answers[1][4 * k + 2];
            hit.t = answers[0][4 * k + 3];
            memcpy(hit.position, answers[0] + 4 * k, 12);
            if (desc.trace.any_hit) {
                conemap_hit cpu;
                conemap_trace(&map, &desc.trace, &rays[k], &cpu, 1);
                ++counts.rays;
                counts.hits += hit.found;
                counts.different += hit.found != (cpu.status == CONEMAP_HIT);
            } else {
                compare_hit(&map, &truth, &desc.trace, &rays[k], &hit, &counts);
            }
        }
        conemap_free(&map);
    }
    gl.DeleteProgram(p);
    ++runs_done;
    total.rays += counts.rays;
    total.different += counts.different;
    total.strict_misses += counts.strict_misses;
    total.misses += counts.misses;
    printf("%-40s %6d rays, %6d hits, %3d differ, %2d not on an edge, misses: %d by 2^-20, %d beyond single "
           "precision\n",
           r->name, counts.rays, counts.hits, counts.different, counts.unexplained, counts.strict_misses,
           counts.misses);
    fflush(stdout);
    if (r->count_only) return;
    if (counts.hits < counts.rays / 5) wrong("%s: too few hits", r->name);
    if (counts.different * 1000 > counts.rays)
        wrong("%s: %d of %d rays differ", r->name, counts.different, counts.rays);
    if (counts.unexplained) wrong("%s: %d rays differ and lie on no edge", r->name, counts.unexplained);
    if (counts.misses) wrong("%s: %d misses", r->name, counts.misses);
}

static struct run fresh(const char *format, ...)
{
    static char names[256][48];
    static int used;
    struct run r;
    va_list arguments;
    memset(&r, 0, sizeof r);
    va_start(arguments, format);
    vsnprintf(names[used % 256], 48, format, arguments);
    va_end(arguments);
    r.name = names[used++ % 256];
    r.desc.dialect = CONEMAP_GLSL_450;
    r.desc.status = r.desc.steps = 1;
    return r;
}

/* A texture that can be an image too: ES wants those immutable. */
static GLuint storage(int width, int height, GLenum internal, GLenum format, const void *pixels)
{
    GLuint name;
    gl.GenTextures(1, &name);
    gl.BindTexture(GL_TEXTURE_2D, name);
    gl.TexStorage2D(GL_TEXTURE_2D, 1, internal, width, height);
    if (pixels) gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, format, GL_FLOAT, pixels);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return name;
}

enum { MAKE_RING, MAKE_MIN3X3, MAKE_SAFE, MAKE_EXACT, MAKE_NAIVE, MAKE_QUICK, MAKE_NAIVE_CENTER, MAKE_QUICK_CENTER,
       MAKE_SLOPES, MAKE_RELAXED, MAKE_RELAXED_EXACT, MAKE_QUADRANTS, MAKE_OCTANTS, MAKE_SAFE_QUADRANTS,
       MAKE_SAFE_OCTANTS, MAKE_COUNT };
static const char *const make_names[MAKE_COUNT] = {
    "ring",  "3x3",  "safe", "exact", "naive", "quick", "naive centre", "quick centre", "exact with slopes",
    "relaxed", "relaxed exact", "4 sectors", "8 sectors", "4 sectors, safe", "8 sectors, safe"};

/* CONEMAP_GUARANTEE_RELAXED_BILINEAR by its definition, over places picked at random: how many points of the surface that
   fall seen from there, or lie on a border that they are seen to end at, are inside the interpolated cone. */
static int relaxed_violations(const conemap_map *map, const float *cones)
{
    const conemap_info *info = &map->info;
    const int w = info->width, h = info->height, wraps_u = info->wrap_u == CONEMAP_WRAP,
              wraps_v = info->wrap_v == CONEMAP_WRAP;
    conemap_map of_cones = *map;
    struct zoo_random random = zoo_seed(5);
    int n, i, j, bad = 0;
    of_cones.heights = cones;
    for (n = 0; n < 60; ++n) {
        const float px = zoo_unit(&random) * (float)(w - 1), py = zoo_unit(&random) * (float)(h - 1);
        const double apex = (double)conemap__height_at(map, px, py) + 1.0 / 1048576.0;
        const double tangent = (double)conemap__height_at(&of_cones, px, py);
        for (j = wraps_v ? -2 * h : 0; j <= (wraps_v ? 4 * h : 2 * (h - 1)); ++j)
            for (i = wraps_u ? -2 * w : 0; i <= (wraps_u ? 4 * w : 2 * (w - 1)); ++i) { /* twice a texel */
                const float qx = 0.5f * (float)i, qy = 0.5f * (float)j, dx = qx - px, dy = qy - py;
                const double high = (double)conemap__height_at(map, qx, qy);
                const double u = (double)dx / w, v = (double)dy / h * (double)info->aspect;
                const float step = 0.01f / (fabsf(dx) + fabsf(dy) + 1e-6f);
                const int ends = (!wraps_u && ((i == 0 && dx < 0.0f) || (i == 2 * (w - 1) && dx > 0.0f))) ||
                                 (!wraps_v && ((j == 0 && dy < 0.0f) || (j == 2 * (h - 1) && dy > 0.0f)));
                if (!((high - apex) * tangent > sqrt(u * u + v * v) * (1.0 + 1e-5))) continue;
                bad += ends || (double)conemap__height_at(map, qx + dx * step, qy + dy * step) < high - 1e-6;
            }
    }
    return bad;
}

/* Whole cone maps made pass by pass, as draws or dispatches, against the CPU's; with `cells` the maxima that tracers
   read. */
static void make_maps(conemap_dialect dialect, conemap_stage stage, int what, conemap_wrap wrap)
{
    static const char *const versions[] = {"330 core", "430 core", "450 core", "", "300 es", "310 es"};
    static const conemap_generator generators[MAKE_COUNT] = {
        CONEMAP_RING,  CONEMAP_RING,  CONEMAP_RING,  CONEMAP_EXACT, CONEMAP_QUICK_NAIVE, CONEMAP_QUICK,
        CONEMAP_QUICK_NAIVE_CENTER, CONEMAP_QUICK_CENTER, CONEMAP_EXACT, CONEMAP_RELAXED, CONEMAP_RELAXED_EXACT,
        CONEMAP_EXACT, CONEMAP_EXACT, CONEMAP_EXACT, CONEMAP_EXACT};
    static float heights[40 * 28], cones[8 * 40 * 28];
    static float back[64 * 64 * 4], right[64 * 64], slopes[40 * 28 * 4];
    const int odd = what >= MAKE_RELAXED, w = odd ? 37 : 40, h = odd ? 27 : 28, sizes = w * h;
    const int es = is_es(dialect), hlsl = is_hlsl(dialect), translated = is_translated(dialect);
    const int compute = stage == CONEMAP_STAGE_COMPUTE;
    const int safe = what == MAKE_SAFE || what == MAKE_RELAXED_EXACT || what >= MAKE_SAFE_QUADRANTS;
    const int sectors = what < MAKE_QUADRANTS ? 0 : what == MAKE_OCTANTS || what == MAKE_SAFE_OCTANTS ? 8 : 4;
    const int slopes_too = what == MAKE_SLOPES, four = slopes_too || sectors;
    char text[16000], vertex[400];
    GLuint programs[CONEMAP_KERNEL_COUNT], frame, states[2], outs[2], source, maxima, arguments;
    int kind, k, c, pass, cells, compared = 0, wide = 0, narrow = 0, dispatches = 0, blocks = 0;
    double kept = 0.0, whole = 0.0;
    conemap_shader_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.dialect = dialect;
    desc.stage = stage;
    if (dialect == CONEMAP_GLSL_450_VULKAN) desc.set = 1;
    desc.map.wrap_u = wrap;
    if (odd) desc.map.wrap_v = wrap == CONEMAP_CLAMP ? CONEMAP_NOTHING : CONEMAP_WRAP;
    desc.map.aspect = 0.6f;
    desc.map.min3x3 = what == MAKE_MIN3X3;
    desc.map.guarantee = safe ? CONEMAP_GUARANTEE_BILINEAR : CONEMAP_GUARANTEE_VERTEX;
    desc.map.generator = generators[what];
    desc.map.width = w;
    desc.map.height = h;
    desc.map.texture.layout = slopes_too ? CONEMAP_DUMMER : es ? CONEMAP_CONE_ONLY : CONEMAP_HEIGHT_CONE;
    desc.map.texture.flip_dv = slopes_too && wrap == CONEMAP_WRAP;
    desc.map.texture.sectors = sectors;
    open_context(es);
    sprintf(vertex,
            "#version %s\nvoid main() {\n    gl_Position = vec4(float(gl_VertexID %% 2) * 4.0 - 1.0, "
            "float(gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0);\n}\n",
            translated ? "" : versions[dialect]);
    for (k = 0; k < CONEMAP_KERNEL_COUNT; ++k) {
        if (k == CONEMAP_KERNEL_QUICK && sectors) continue;
        if (conemap_emit_kernel(&desc, (conemap_kernel)k, text, sizeof text, NULL) != CONEMAP_OK) {
            wrong("kernel %d in dialect %d", k, (int)dialect);
            return;
        }
        programs[k] = translated ? translated_program(dialect, text)
                      : compute ? program(shader(GL_COMPUTE_SHADER, text), 0)
                                : program(shader(GL_VERTEX_SHADER, vertex), shader(GL_FRAGMENT_SHADER, text));
    }
    if (translated && hlsl_writes) return;
    gl.GenBuffers(1, &arguments);
    gl.GenFramebuffers(1, &frame);
    gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
    for (kind = 0; kind < ZOO_KINDS + 1; ++kind) {
        const GLenum out_format = four ? GL_RGBA32F : es ? GL_R32F : GL_RG32F;
        const GLenum state_format = sectors ? GL_RGBA32F : GL_R32F;
        conemap_desc build_desc;
        conemap_map map;
        static conemap_gpu_pass passes[256];
        int count = 0;
        const int by_definition = what == MAKE_RELAXED_EXACT && kind == ZOO_KINDS; /* the CPU takes touching cells whole */
        memset(&build_desc, 0, sizeof build_desc);
        if (kind < ZOO_KINDS)
            zoo_fill(kind, w, h, 3, heights);
        else /* walls at two borders: behind them everything falls, in front of them nothing does */
            for (k = 0; k < sizes; ++k) heights[k] = k % w == w - 1 ? 1.0f : k / w == h - 1 ? 0.75f : 0.0f;
        build_desc.heights.pixels = heights;
        build_desc.heights.width = w;
        build_desc.heights.height = h;
        build_desc.wrap_u = wrap;
        build_desc.wrap_v = desc.map.wrap_v;
        build_desc.aspect = 0.6f;
        build_desc.min3x3 = desc.map.min3x3;
        build_desc.generator = generators[what];
        build_desc.texture = desc.map.texture;
        build_desc.keep_pyramid = 1;
        if (build_desc.generator == CONEMAP_EXACT) build_desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
        if (conemap_build(&build_desc, &map) != CONEMAP_OK) {
            wrong("kernels: no map");
            return;
        }
        source = storage(w, h, GL_R32F, GL_RED, heights);
        for (k = 0; k < 4 * sizes; ++k) cones[k] = 1e9f; /* what is in the state at first shall not matter */
        for (k = 0; k < 2; ++k) {
            states[k] = storage(w, h, state_format, sectors ? GL_RGBA : GL_RED, cones);
            outs[k] = storage(w, h, out_format, GL_RED, NULL);
        }
        gl.GenTextures(1, &maxima);
        gl.BindTexture(GL_TEXTURE_2D, maxima);
        gl.TexStorage2D(GL_TEXTURE_2D, 7, GL_R32F, 64, 64);
        gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST_MIPMAP_NEAREST);
        gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
        for (cells = 0; cells < (what == MAKE_EXACT ? 2 : 1); ++cells) {
            desc.trace.tracer = cells ? CONEMAP_TRACE_MAXMIP : CONEMAP_TRACE_DEFAULT;
            if (conemap_gpu_passes(&desc, what == MAKE_SLOPES ? 1 << 20 : sectors ? 6000 : 900, passes, 256, &count) !=
                CONEMAP_OK) {
                wrong("kernels: no passes");
                return;
            }
            for (pass = 0; pass < count; ++pass) {
                const conemap_gpu_pass *now = &passes[pass];
                const GLuint p = programs[now->kernel],
                             target = now->writes == 2   ? outs[now->sector / 4]
                                      : now->writes == 3 ? maxima
                                                         : states[now->writes];
                const int level = now->writes == 3 ? now->level : 0;
                int unit = 0;
                gl.UseProgram(p);
                gl.ActiveTexture(GL_TEXTURE0);
                gl.BindTexture(GL_TEXTURE_2D, states[now->reads]);
                gl.ActiveTexture(GL_TEXTURE1);
                gl.BindTexture(GL_TEXTURE_2D, source);
                gl.ActiveTexture(GL_TEXTURE2);
                gl.BindTexture(GL_TEXTURE_2D, maxima);
                gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL,
                                 now->kernel == CONEMAP_KERNEL_MAXIMA && !compute ? level - 1 : 6);
                uniform_i(p, "conemap_state", 0);
                uniform_i(p, "conemap_heights", 1);
                uniform_i(p, "conemap_maxima", 2);
                uniform_i(p, "conemap_first", now->first);
                uniform_i(p, "conemap_last", now->last);
                uniform_i(p, "conemap_level", now->level);
                uniform_i(p, "conemap_sector", now->sector);
                if (translated) {
                    GLint values[4] = {0, 0, 0, 0};
                    values[0] = now->kernel == CONEMAP_KERNEL_MAXIMA ? now->level : now->first;
                    values[1] = now->last;
                    values[2] = now->kernel == CONEMAP_KERNEL_RING ? now->sector : now->level;
                    values[3] = now->sector;
                    gl.BindBuffer(GL_UNIFORM_BUFFER, arguments);
                    gl.BufferData(GL_UNIFORM_BUFFER, sizeof values, values, GL_STATIC_DRAW);
                    gl.BindBufferBase(GL_UNIFORM_BUFFER, hlsl ? 24 : 0, arguments);
                }
                if (compute) { /* images come behind the textures that are there */
                    unit += gl.GetUniformLocation(p, "conemap_state") >= 0;
                    unit += gl.GetUniformLocation(p, "conemap_heights") >= 0;
                    unit += gl.GetUniformLocation(p, "conemap_maxima") >= 0;
                    gl.BindImageTexture(hlsl ? 8 : (GLuint)unit, target, level, GL_FALSE, 0, GL_WRITE_ONLY,
                                        now->writes == 2   ? out_format
                                        : now->writes == 3 ? GL_R32F
                                                           : state_format);
                    gl.DispatchCompute((GLuint)now->groups_x, (GLuint)now->groups_y, 1);
                    gl.MemoryBarrier(GL_ALL_BARRIER_BITS);
                } else {
                    gl.Viewport(0, 0, now->width, now->height);
                    gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, target, level);
                    gl.DrawArrays(GL_TRIANGLES, 0, 3);
                }
                ++dispatches;
            }
            if (cells) {
                for (k = 0; k < 7; ++k) {
                    const int side = 64 >> k;
                    int at;
                    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 6);
                    gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, maxima, k);
                    gl.ReadPixels(0, 0, side, side, GL_RGBA, GL_FLOAT, back);
                    conemap_write_maxima(&map, k, right, sizeof right);
                    for (at = 0; at < side * side; ++at, ++blocks)
                        if (back[4 * at] != right[at]) wrong("kernels: maxima differ at level %d", k);
                }
                continue;
            }
            if (slopes_too) conemap_write_texture(&map, slopes, sizeof slopes, 0);
            for (c = 0; c < (sectors ? sectors : 1); ++c) {
                if (c % 4 == 0) {
                    gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, outs[c / 4], 0);
                    gl.ReadBuffer(GL_COLOR_ATTACHMENT0);
                    gl.ReadPixels(0, 0, w, h, GL_RGBA, GL_FLOAT, back);
                }
                for (k = 0; k < sizes; ++k) {
                    const float cone = back[4 * k + (sectors ? c % 4 : es && !four ? 0 : 1)];
                    const float of_cpu = map.cones[c * sizes + k];
                    ++compared;
                    wide += cone > of_cpu && !by_definition;
                    narrow += !safe && cone < of_cpu * (1.0f - 1e-5f);
                    kept += (double)cone;
                    whole += (double)of_cpu;
                    cones[c * sizes + k] = cone;
                    if (sectors) continue;
                    if ((four || !es) && back[4 * k] != heights[k]) wrong("kernels: a height is not the map's");
                    if (four && (fabsf(back[4 * k + 2] - slopes[4 * k + 2]) > 1e-7f ||
                                 fabsf(back[4 * k + 3] - slopes[4 * k + 3]) > 1e-7f))
                        wrong("kernels: slopes differ");
                }
            }
            if (what == MAKE_RELAXED_EXACT && relaxed_violations(&map, cones)) wrong("kernels: relaxed cones are not safe");
            if (safe && what != MAKE_RELAXED_EXACT) {
                conemap_report report;
                if (conemap_verify(&map.info, heights, cones, NULL, &report) != CONEMAP_OK || report.unsafe ||
                    report.unproven)
                    wrong("kernels: cones are not safe");
            }
        }
        gl.DeleteTextures(2, states);
        gl.DeleteTextures(1, &source);
        gl.DeleteTextures(2, outs);
        gl.DeleteTextures(1, &maxima);
        conemap_free(&map);
    }
    if (gl.GetError() != 0) wrong("kernels: a GL error");
    gl.DeleteBuffers(1, &arguments);
    printf("kernels, dialect %d, %s, wrap %d, %s: %d cones%s in %d passes, %d wider than the CPU's, %d narrower by "
           "more than 1e-5; of the CPU's width %.0f %%\n",
           (int)dialect, compute ? "compute" : "fragment", (int)wrap, make_names[what], compared,
           blocks ? " and all maxima" : "", dispatches, wide, narrow, 100.0 * kept / whole);
    fflush(stdout);
    if (wide || narrow) wrong("kernels: cones differ");
}

static const conemap_dialect all[] = {CONEMAP_GLSL_330, CONEMAP_GLSL_430, CONEMAP_GLSL_450, CONEMAP_ESSL_300,
                                      CONEMAP_ESSL_310};

static void trace_maps(void)
{
    static const char *const tracers[] = {"",           "exact",    "linear", "fixed", "loop",
                                          "exact-step", "cell-max", "maxmip", "qdm"};
    static const char *const refinements[] = {"none", "secant", "bisect"};
    static const char *const filters[] = {"fetch", "gather", "hardware"};
    static const char *const formats[] = {"f32", "f16", "unorm16", "unorm8"};
    static const char *const encodings[] = {"linear", "sqrt", "radius"};
    struct run r;
    int k, m, n;
    for (k = 1; k < 9; ++k)
        for (m = 0; m < 3; ++m)
            for (n = 0; n < 3; ++n) { /* tracer x refinement x filter */
                const int solves = k == CONEMAP_TRACE_EXACT || k >= CONEMAP_TRACE_MAXMIP;
                if (solves && (m > 0 || n == CONEMAP_FILTER_HARDWARE)) continue;
                r = fresh("%s, %s, %s", tracers[k], refinements[m], filters[n]);
                r.desc.trace.tracer = (conemap_tracer)k;
                r.desc.trace.refinement = (conemap_refinement)m;
                r.desc.filter = (conemap_filter)n;
                /* 200 equal steps from z = 1 meet the zoo's plateaus exactly, where the last bit decides; 197 do not. */
                if (k == CONEMAP_TRACE_LINEAR) r.desc.trace.max_steps = 197;
                run(&r);
            }
    for (k = 0; k < 9; ++k)
        for (m = 1; m < 9; m += 3) { /* wraps, on a tracer of each family */
            const int tracer = m == 1   ? CONEMAP_TRACE_EXACT
                               : m == 4 ? CONEMAP_TRACE_CELL_MAX
                                        : CONEMAP_TRACE_MAXMIP;
            r = fresh("wraps %d %d, %s", k / 3, k % 3, tracers[tracer]);
            r.desc.trace.tracer = (conemap_tracer)tracer;
            r.desc.map.wrap_u = (conemap_wrap)(k / 3);
            r.desc.map.wrap_v = (conemap_wrap)(k % 3);
            run(&r);
        }
    for (k = 0; k < 4; ++k)
        for (m = 0; m < 3; ++m) {
            r = fresh("%s, %s", formats[k], encodings[m]);
            r.desc.map.texture.format = (conemap_format)k;
            r.desc.map.texture.encoding = (conemap_encoding)m;
            r.desc.map.max_tan = m == 2 ? 0.75f : 0.0f;
            run(&r);
        }
    for (k = 0; k < 2; ++k)
        for (m = 0; m < 3; ++m)
            for (n = 0; n < 2; ++n) {
                r = fresh("layout %d%s, %s", k + 1, n ? ", per cell" : "", filters[m]);
                r.desc.map.texture.layout = k ? CONEMAP_DUMMER : CONEMAP_CONE_ONLY;
                r.desc.map.texture.encoding = k ? CONEMAP_SQRT : CONEMAP_LINEAR;
                r.desc.map.texture.per_cell = n;
                r.desc.filter = (conemap_filter)m;
                if (m == CONEMAP_FILTER_HARDWARE) r.desc.trace.tracer = CONEMAP_TRACE_CELL_MAX;
                run(&r);
            }
    for (k = 4; k <= 8; k += 4) { /* sectors: every tracer with cones, and with the exact one the rest */
        for (m = 0; m < 4; ++m)
            for (n = 0; n < 3; ++n) {
                static const conemap_tracer with_cones[] = {CONEMAP_TRACE_EXACT, CONEMAP_TRACE_LOOP,
                                                            CONEMAP_TRACE_EXACT_STEP, CONEMAP_TRACE_CELL_MAX};
                if (m == 0 && n == CONEMAP_FILTER_HARDWARE) continue;
                r = fresh("%d sectors, %s, %s", k, tracers[with_cones[m]], filters[n]);
                r.desc.map.texture.sectors = k;
                r.desc.trace.tracer = with_cones[m];
                r.desc.filter = (conemap_filter)n;
                r.desc.map.wrap_u = n == 0 ? CONEMAP_WRAP : CONEMAP_CLAMP;
                run(&r);
            }
        for (m = 0; m < 8; ++m) {
            static const char *const names[] = {"per cell", "per cell, gather", "unorm8, sqrt", "unorm16, radius",
                                                "array",    "atlas",            "compute",      "fragment, ES"};
            r = fresh("%d sectors, %s", k, names[m]);
            r.desc.map.texture.sectors = k;
            r.desc.map.texture.per_cell = m < 2;
            if (m == 1) r.desc.filter = CONEMAP_FILTER_GATHER;
            if (m == 2) r.desc.map.texture.format = CONEMAP_UNORM8, r.desc.map.texture.encoding = CONEMAP_SQRT;
            if (m == 3) r.desc.map.texture.format = CONEMAP_UNORM16, r.desc.map.texture.encoding = CONEMAP_RADIUS;
            if (m == 4) r.desc.array = 1;
            if (m == 5) r.desc.atlas = 1, r.desc.map.texture.layout = CONEMAP_CONE_ONLY;
            if (m == 6) r.desc.stage = CONEMAP_STAGE_COMPUTE;
            if (m == 7) r.desc.stage = CONEMAP_STAGE_FRAGMENT, r.desc.dialect = CONEMAP_ESSL_300;
            run(&r);
        }
    }
    for (k = 0; k < 5; ++k)
        for (m = 0; m < 3; ++m) {
            static const char *const stages[] = {"functions", "fragment", "compute"};
            const int old = all[k] == CONEMAP_GLSL_330 || all[k] == CONEMAP_ESSL_300;
            if (m == CONEMAP_STAGE_COMPUTE && old) continue;
            for (n = 0; n < 3; ++n) {
                r = fresh("dialect %d, %s, %s", (int)all[k], stages[m],
                          n == 0   ? "exact"
                          : n == 1 ? "maxmip"
                                   : "t range");
                r.desc.dialect = all[k];
                r.desc.stage = (conemap_stage)m;
                r.desc.trace.tracer = n == 1 ? CONEMAP_TRACE_MAXMIP : CONEMAP_TRACE_EXACT;
                r.desc.t_range = n == 2;
                if (n == 0) r.desc.status = r.desc.steps = 0;
                run(&r);
            }
        }
    for (k = 0; k < 19; ++k) {
        static const char *const names[] = {
            "fixed size",   "atlas",     "array",         "run-time cap",     "names",      "external",
            "host fetch",   "relaxed",   "aspect",        "adaptive loop",    "step scale", "any hit",
            "any hit, maxmip", "refine steps", "vertex cones", "medium precision", "binding", "names, 8 sectors",
            "names, maxmip"};
        r = fresh("%s", names[k]);
        if (k == 0) {
            r.desc.fixed_size = 1;
        } else if (k == 1) {
            r.desc.atlas = 1;
        } else if (k == 2) {
            r.desc.array = 1;
        } else if (k == 3) {
            r.desc.run_time_cap = 1;
        } else if (k == 4) {
            r.desc.prefix = "relief";
            r.desc.map_name = "bumps";
        } else if (k == 5) {
            r.desc.external = 1;
        } else if (k == 6) {
            r.desc.fetch = "host_fetch";
        } else if (k == 7) {
            r.generator = CONEMAP_RELAXED_EXACT;
        } else if (k == 8) {
            r.desc.map.aspect = 0.4f;
        } else if (k == 9) {
            r.desc.trace.tracer = CONEMAP_TRACE_LOOP;
            r.desc.trace.adaptive_steps = 1;
            r.desc.trace.tolerance = 0.01f;
        } else if (k == 10) {
            r.desc.trace.step_scale = 0.7f;
        } else if (k == 13) {
            r.desc.trace.tracer = CONEMAP_TRACE_CELL_MAX;
            r.desc.trace.refinement = CONEMAP_REFINE_BISECT;
            r.desc.trace.refine_steps = 3;
        } else if (k == 14) { /* no guarantee between texels: what a step passes depends on its last bit */
            r.generator = CONEMAP_RING;
            r.count_only = 1;
        } else if (k == 15) { /* 16 bits on this GPU: no guarantee at all */
            r.desc.dialect = CONEMAP_ESSL_300;
            r.desc.precision = CONEMAP_MEDIUMP;
            r.count_only = 1;
        } else if (k == 16) {
            r.desc.stage = CONEMAP_STAGE_COMPUTE;
            r.desc.binding = 3;
        } else if (k >= 17) {
            r.desc.map_name = "bumps";
            r.desc.heights_name = "soil";
            r.desc.maxima_name = "tops";
            r.desc.octants_name = "eighths";
            if (k == 17) r.desc.map.texture.sectors = 8;
            if (k == 18) r.desc.trace.tracer = CONEMAP_TRACE_MAXMIP;
        } else {
            r.desc.trace.any_hit = 1;
            r.desc.status = r.desc.steps = 0;
            if (k == 12) r.desc.trace.tracer = CONEMAP_TRACE_MAXMIP;
        }
        run(&r);
    }
    for (k = CONEMAP_TRACE_LINEAR; k <= CONEMAP_TRACE_CELL_MAX; ++k) { /* what coarse filter weights cost */
        r = fresh("8-bit weights: %s", tracers[k]);
        r.desc.trace.tracer = (conemap_tracer)k;
        r.desc.trace.refinement = CONEMAP_REFINE_BISECT;
        r.desc.filter = CONEMAP_FILTER_HARDWARE;
        r.desc.fetch = "host_fetch";
        r.count_only = 1;
        if (k != CONEMAP_TRACE_LINEAR) run(&r);
    }
}

/* Every tracer and kernel in HLSL, compute shaders all of them, with each way of reading textures. */
static void run_hlsl(void)
{
    struct run r;
    int k;
    for (k = 0; k < 20; ++k) {
        static const char *const names[20] = {"exact",        "linear",    "fixed",   "loop",     "exact-step",
                                              "cell-max",     "maxmip",    "qdm",     "gather",   "hardware",
                                              "4 sectors",    "8 sectors", "wraps",   "per cell", "unorm16, cones only",
                                              "t range, sqrt", "model 5.0, sampler", "Vulkan", "Vulkan, array and cap",
                                              "Vulkan, 8 sectors"};
        const int vulkan = k >= 17;
        r = fresh("%s%s", vulkan ? "" : "HLSL: ", names[k]);
        r.desc.dialect = vulkan ? CONEMAP_GLSL_450_VULKAN : k == 16 ? CONEMAP_HLSL_50 : CONEMAP_HLSL_60;
        r.desc.stage = CONEMAP_STAGE_COMPUTE;
        if (k < 8) r.desc.trace.tracer = (conemap_tracer)(k + 1);
        if (k == 1) r.desc.trace.max_steps = 197;
        if (k == 3 || k == 5) r.desc.trace.refinement = k == 3 ? CONEMAP_REFINE_BISECT : CONEMAP_REFINE_SECANT;
        if (k == 8) r.desc.filter = CONEMAP_FILTER_GATHER;
        if (k == 9) r.desc.filter = CONEMAP_FILTER_HARDWARE, r.desc.trace.tracer = CONEMAP_TRACE_CELL_MAX;
        if (k == 10 || k == 11) r.desc.map.texture.sectors = k == 10 ? 4 : 8;
        if (k == 12) r.desc.map.wrap_u = CONEMAP_WRAP, r.desc.map.wrap_v = CONEMAP_NOTHING;
        if (k == 13) r.desc.map.texture.per_cell = 1, r.desc.filter = CONEMAP_FILTER_GATHER;
        if (k == 14) r.desc.map.texture.format = CONEMAP_UNORM16, r.desc.map.texture.layout = CONEMAP_CONE_ONLY;
        if (k == 15) r.desc.t_range = 1, r.desc.map.texture.encoding = CONEMAP_SQRT;
        if (k == 16) r.desc.filter = CONEMAP_FILTER_GATHER, r.desc.sampler_name = "plain", r.desc.sampler_binding = 2;
        if (vulkan) r.desc.set = k - 16, r.desc.binding = k - 16;
        if (k == 18) r.desc.array = r.desc.run_time_cap = 1;
        if (k == 19) r.desc.map.texture.sectors = 8;
        sampler_of_hlsl = r.desc.sampler_name ? r.desc.sampler_name : "conemap_sampler";
        run(&r);
    }
    for (k = 0; k < MAKE_COUNT; ++k)
        make_maps(CONEMAP_HLSL_60, CONEMAP_STAGE_COMPUTE, k, k % 2 ? CONEMAP_WRAP : CONEMAP_CLAMP);
    for (k = MAKE_EXACT; k < MAKE_COUNT; k += 3) /* of Vulkan a few: but for bindings and arguments it is GLSL 450 */
        make_maps(CONEMAP_GLSL_450_VULKAN, CONEMAP_STAGE_COMPUTE, k, k % 2 ? CONEMAP_CLAMP : CONEMAP_WRAP);
    if (!hlsl_writes)
        printf("HLSL and Vulkan's GLSL on a software GPU: %d shaders, %d rays, %d differ from the CPU, "
               "misses: %d beyond single precision\n",
               hlsl_count, total.rays, total.different, total.misses);
}

/* ---- timings: the exact tracer against others at equal error, `name value unit` a line -------------------------------

   A pixel is off if its hit is farther than 1/4 texel from the true one. A rival with a number of steps gets the fewest
   by which at most 0.1 % of the pixels are off, or, if no number of them does, the most; `off` says which. */

#define TIMES 7

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(const double *values)
{
    double sorted[TIMES];
    memcpy(sorted, values, sizeof sorted);
    qsort(sorted, TIMES, sizeof *sorted, by_value);
    return sorted[TIMES / 2];
}

static GLuint timed_program(const conemap_shader_desc *desc, int side)
{
    static char text[40000], whole[50000];
    static const char vertex[] = "#version 450 core\nvoid main() {\n    gl_Position = vec4(float(gl_VertexID % 2) * 4.0 - "
                                 "1.0, float(gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0);\n}\n";
    GLuint p;
    if (conemap_emit(desc, text, sizeof text, NULL) != CONEMAP_OK) {
        wrong("timings: no text");
        exit(1);
    }
    sprintf(whole,
            "#version 450 core\n%s\nlayout(location = 0) out vec4 answer;\nvoid main() {\n    vec3 o = vec3(0.5, -0.6, "
            "1.6);\n    conemap_hit hit = conemap_trace(o, vec3(gl_FragCoord.xy / %d.0, 0.0) - o);\n    answer = "
            "vec4(hit.position, hit.t);\n}\n",
            text, side);
    p = program(shader(GL_VERTEX_SHADER, vertex), shader(GL_FRAGMENT_SHADER, whole));
    gl.UseProgram(p);
    uniform_i(p, "conemap_map", desc->filter == CONEMAP_FILTER_HARDWARE);
    uniform_i(p, "conemap_maxima", 2);
    return p;
}

static void time_map(int kind, int size, int side)
{
    static const struct {
        const char *name;
        conemap_tracer tracer;
        int least, most; /* steps; 0: as many as it takes */
    } rivals[] = {{"exact", CONEMAP_TRACE_EXACT, 0, 0},         {"linear", CONEMAP_TRACE_LINEAR, 16, 2048},
                  {"qdm", CONEMAP_TRACE_QDM, 0, 0},             {"dummer_loop", CONEMAP_TRACE_LOOP, 5, 640},
                  {"cell_max", CONEMAP_TRACE_CELL_MAX, 0, 0},   {"maxmip", CONEMAP_TRACE_MAXMIP, 0, 0}};
    enum { COUNT = sizeof rivals / sizeof rivals[0] };
    const size_t pixels = (size_t)side * (size_t)side;
    float *heights = (float *)malloc((size_t)size * (size_t)size * sizeof(float)), *back = (float *)malloc(pixels * 16);
    float *truth = (float *)malloc(pixels * 4), *both;
    double times[COUNT][TIMES], off[COUNT];
    GLuint programs[COUNT], names[3], target, frame;
    conemap_desc build_desc;
    conemap_map map;
    int k, t, x, y, steps[COUNT];
    zoo_fill(kind, size, size, 23, heights);
    memset(&build_desc, 0, sizeof build_desc);
    build_desc.heights.pixels = heights;
    build_desc.heights.width = build_desc.heights.height = size;
    build_desc.keep_pyramid = 1;
    if (conemap_build(&build_desc, &map) != CONEMAP_OK) {
        wrong("timings: no map");
        return;
    }
    both = (float *)malloc(conemap_texture_size(&map, 0));
    conemap_write_texture(&map, both, conemap_texture_size(&map, 0), 0);
    for (k = 0; k < 2; ++k)
        names[k] = texture(0, 0, size, size, GL_RG32F, GL_RG, GL_FLOAT, 0, k ? GL_LINEAR : GL_NEAREST, GL_CLAMP_TO_EDGE,
                           GL_CLAMP_TO_EDGE, both);
    names[2] = maxima_texture(&map, 0);
    target = texture(0, 0, side, side, GL_RGBA32F, GL_RGBA, GL_FLOAT, 0, GL_NEAREST, GL_CLAMP_TO_EDGE, GL_CLAMP_TO_EDGE,
                     NULL);
    for (k = 0; k < 3; ++k) {
        gl.ActiveTexture(GL_TEXTURE0 + (GLenum)k);
        gl.BindTexture(GL_TEXTURE_2D, names[k]);
    }
    gl.GenFramebuffers(1, &frame);
    gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
    gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, target, 0);
    gl.Viewport(0, 0, side, side);
    for (y = 0; y < side; ++y)
        for (x = 0; x < side; ++x) {
            conemap_ray ray;
            conemap_hit hit;
            memset(&ray, 0, sizeof ray);
            ray.origin[0] = 0.5f;
            ray.origin[1] = -0.6f;
            ray.origin[2] = 1.6f;
            ray.direction[0] = ((float)x + 0.5f) / (float)side - ray.origin[0];
            ray.direction[1] = ((float)y + 0.5f) / (float)side - ray.origin[1];
            ray.direction[2] = -ray.origin[2];
            conemap_trace(&map, NULL, &ray, &hit, 1);
            truth[(size_t)y * (size_t)side + (size_t)x] = hit.t;
        }
    for (k = 0; k < COUNT; ++k) {
        const int solves = rivals[k].tracer == CONEMAP_TRACE_EXACT || rivals[k].tracer >= CONEMAP_TRACE_MAXMIP;
        for (steps[k] = rivals[k].least;; steps[k] *= 2) {
            conemap_shader_desc desc;
            size_t at, wrong_ones = 0;
            memset(&desc, 0, sizeof desc);
            desc.dialect = CONEMAP_GLSL_450;
            desc.map = map.info;
            desc.trace.tracer = rivals[k].tracer;
            desc.trace.max_steps = steps[k];
            desc.trace.tolerance = 1e-5f;
            desc.trace.refinement = solves ? CONEMAP_REFINE_NONE : CONEMAP_REFINE_BISECT;
            desc.filter = solves ? CONEMAP_FILTER_FETCH : CONEMAP_FILTER_HARDWARE;
            programs[k] = timed_program(&desc, side);
            gl.DrawArrays(GL_TRIANGLES, 0, 3);
            gl.ReadPixels(0, 0, side, side, GL_RGBA, GL_FLOAT, back);
            for (at = 0; at < pixels; ++at) /* a ray is about 2 long */
                wrong_ones += !(fabsf(back[4 * at + 3] - truth[at]) * 2.0f * (float)size <= 0.25f);
            off[k] = 100.0 * (double)wrong_ones / (double)pixels;
            if (off[k] <= 0.1 || steps[k] >= rivals[k].most) break;
            gl.DeleteProgram(programs[k]);
        }
    }
    for (t = 0; t < TIMES; ++t)
        for (k = 0; k < COUNT; ++k) {
            double start;
            gl.UseProgram(programs[k]);
            gl.Finish();
            start = seconds();
            gl.DrawArrays(GL_TRIANGLES, 0, 3);
            gl.Finish();
            times[k][t] = seconds() - start;
        }
    for (k = 0; k < COUNT; ++k) {
        double ratios[TIMES];
        for (t = 0; t < TIMES; ++t) ratios[t] = times[k][t] / times[0][t];
        printf("%s_%s_time %.3g ms\n", zoo_name(kind), rivals[k].name, 1000.0 * median(times[k]));
        printf("%s_%s_off %.3g %%\n", zoo_name(kind), rivals[k].name, off[k]);
        if (steps[k]) printf("%s_%s_steps %d steps\n", zoo_name(kind), rivals[k].name, steps[k]);
        if (k) printf("%s_%s_over_exact %.3g times\n", zoo_name(kind), rivals[k].name, median(ratios));
        gl.DeleteProgram(programs[k]);
    }
    fflush(stdout);
    if (gl.GetError() != 0) wrong("timings: a GL error");
    if (off[0] > 0.1) wrong("timings: the exact tracer is off");
    gl.DeleteTextures(3, names);
    gl.DeleteTextures(1, &target);
    conemap_free(&map);
    free(both);
    free(truth);
    free(back);
    free(heights);
}

/* Arguments pick a part: "trace", "make", "time" (with the sides of map and picture: 256 256), or "hlsl-write" or
   "hlsl-run" with a folder. */
int main(int argument_count, char **arguments)
{
    int k, m, n;
    if (argument_count > 1 && strcmp(arguments[1], "time") == 0) {
        static const int kinds[] = {ZOO_FBM, ZOO_BRICKS, ZOO_SPIKES};
        open_context(0);
        for (k = 0; k < 3; ++k)
            time_map(kinds[k], argument_count > 2 ? atoi(arguments[2]) : 256, argument_count > 3 ? atoi(arguments[3]) : 256);
        return failures != 0;
    }
    if (argument_count > 2) {
        hlsl_folder = arguments[2];
        hlsl_writes = strcmp(arguments[1], "hlsl-write") == 0;
        run_hlsl();
        return failures != 0;
    }
    if (argument_count < 2 || strcmp(arguments[1], "make") != 0) trace_maps();
    for (k = 0; k < 5 && (argument_count < 2 || strcmp(arguments[1], "trace") != 0); ++k)
        for (m = 1; m < 3; ++m)
            for (n = 0; n < MAKE_COUNT; ++n)
                if (m == CONEMAP_STAGE_FRAGMENT || (all[k] != CONEMAP_GLSL_330 && all[k] != CONEMAP_ESSL_300))
                    make_maps(all[k], (conemap_stage)m, n, (n + k) % 2 ? CONEMAP_WRAP : CONEMAP_CLAMP);
    printf("software GPU: %d shaders, %d rays, %d differ from the CPU, misses: %d by 2^-20, %d beyond single "
           "precision\n",
           runs_done, total.rays, total.different, total.strict_misses, total.misses);
    return failures != 0;
}
