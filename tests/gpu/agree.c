/* Effects by the emitted shaders on a software GPU (Mesa, surfaceless EGL) against conemap_shade, rays that differ counted
   and shown to lie on an edge:  agree [folder for pictures]. Exits with 77 where there is no such GPU.
     - functions and compute shaders: every effect, every pair, everything together and a seeded sample, each over a map
       and a storage of its own; then each storage by itself: stored slopes, arrays, atlases, gather, hardware filters
     - fragment shaders: polygons, drawn with depth */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "../shade_compare.h"

#include "software.h"

enum { SIDE = 32, RAYS = SIDE * SIDE, SAMPLE = 24, MOST_SETS = 300, MOST_SIZE = 64, OUTPUTS = 6, FRAME_X = 5, FRAME_Y = 3 };

static const unsigned settings = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW |
                                 CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY | CONEMAP_EFFECT_HOLES |
                                 CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE;
static const unsigned graded = CONEMAP_EFFECT_UV | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE;
static const unsigned normals = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL;
static const unsigned numbers = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_OCCLUSION |
                                CONEMAP_EFFECT_SKY | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE;

static struct zoo_random chance;
static struct shade_counts total;
static int variants_done;

/* ---- maps and their textures ---- */

struct scene {
    conemap_map levels[SHADE_LEVELS];
    unsigned char alpha[MOST_SIZE * MOST_SIZE];
    int width, height;
};

static int scene_make(const conemap_shader_desc *d, int kind, int width, int height, struct scene *s)
{
    static float heights[MOST_SIZE * MOST_SIZE];
    conemap_desc desc;
    conemap_result result;
    memset(&desc, 0, sizeof desc);
    zoo_fill(kind, width, height, 5, heights);
    desc.heights.pixels = heights;
    desc.heights.width = s->width = width;
    desc.heights.height = s->height = height;
    desc.wrap_u = d->map.wrap_u;
    desc.wrap_v = d->map.wrap_v;
    desc.aspect = d->map.aspect;
    desc.texture = d->map.texture;
    desc.keep_pyramid = 1;
    shade_alpha(width, height, s->alpha);
    result = conemap_build_levels(&desc, s->levels, SHADE_LEVELS);
    if (result != CONEMAP_OK) wrong("build: %s", conemap_result_string(result));
    return result == CONEMAP_OK;
}

static void scene_free(struct scene *s)
{
    int k;
    for (k = 0; k < SHADE_LEVELS; ++k) conemap_free(&s->levels[k]);
}

/* One level of a texture: whole, in slice 1 of 2, or at (FRAME_X, FRAME_Y) of a larger one. */
static void put_level(const conemap_shader_desc *d, int level, int width, int height, unsigned internal, GLenum format,
                      GLenum type, const void *pixels)
{
    const GLenum target = d->array ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
    if (d->array) {
        gl.TexImage3D(target, level, (GLint)internal, width, height, 2, 0, format, type, NULL);
        gl.TexSubImage3D(target, level, 0, 0, 1, width, height, 1, format, type, pixels);
    } else if (d->atlas) {
        gl.TexImage2D(target, level, (GLint)internal, width + 9, height + 7, 0, format, type, NULL);
        gl.TexSubImage2D(target, level, FRAME_X, FRAME_Y, width, height, format, type, pixels);
    } else {
        gl.TexImage2D(target, level, (GLint)internal, width, height, 0, format, type, pixels);
    }
}

static GLuint begin_texture(const conemap_shader_desc *d, int mips)
{
    const GLenum target = d->array ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
    const GLenum filter = d->filter == CONEMAP_FILTER_FETCH ? GL_NEAREST : GL_LINEAR;
    GLuint name;
    gl.GenTextures(1, &name);
    gl.BindTexture(target, name);
    gl.TexParameteri(target, GL_TEXTURE_MIN_FILTER, (GLint)(mips ? GL_NEAREST_MIPMAP_NEAREST : filter));
    gl.TexParameteri(target, GL_TEXTURE_MAG_FILTER, (GLint)filter);
    gl.TexParameteri(target, GL_TEXTURE_MAX_LEVEL, mips ? SHADE_LEVELS - 1 : 0);
    gl.TexParameteri(target, GL_TEXTURE_WRAP_S, d->map.wrap_u == CONEMAP_WRAP ? GL_REPEAT : GL_CLAMP_TO_EDGE);
    gl.TexParameteri(target, GL_TEXTURE_WRAP_T, d->map.wrap_v == CONEMAP_WRAP ? GL_REPEAT : GL_CLAMP_TO_EDGE);
    return name;
}

/* Texture `index` of a map, levels as mips with LOD. */
static GLuint map_texture(const conemap_shader_desc *d, const struct scene *s, int index)
{
    static unsigned char pixels[16 * MOST_SIZE * MOST_SIZE];
    const int count = d->flags & CONEMAP_EFFECT_LOD ? SHADE_LEVELS : 1;
    const GLuint name = begin_texture(d, count > 1);
    conemap_format_numbers n;
    int k;
    conemap_get_format_numbers_at(&s->levels[0].info.texture, index, &n);
    for (k = 0; k < count; ++k) {
        const conemap_map *map = &s->levels[k];
        if (conemap_write_texture_at(map, index, pixels, sizeof pixels, 0) != CONEMAP_OK) wrong("texture %d", index);
        put_level(d, k, map->info.width, map->info.height, n.gl_internal, n.gl_format, n.gl_type, pixels);
    }
    return name;
}

static GLuint heights_texture(const conemap_shader_desc *d, const struct scene *s)
{
    const int count = d->flags & CONEMAP_EFFECT_LOD ? SHADE_LEVELS : 1;
    const GLuint name = begin_texture(d, count > 1);
    int k;
    for (k = 0; k < count; ++k)
        put_level(d, k, s->levels[k].info.width, s->levels[k].info.height, GL_R32F, GL_RED, GL_FLOAT,
                  s->levels[k].heights);
    return name;
}

static GLuint alpha_texture(const conemap_shader_desc *d, const struct scene *s)
{
    conemap_shader_desc fetched = *d;
    GLuint name;
    fetched.filter = CONEMAP_FILTER_FETCH;
    name = begin_texture(&fetched, 0);
    put_level(d, 0, s->width, s->height, GL_R8, GL_RED, GL_UNSIGNED_BYTE, s->alpha);
    return name;
}

enum { COLOR_SIDE = 64, COLOR_LEVELS = 7 };

/* A colour map that tells which of its mips was read: level k is k / 16 all over. */
static GLuint color_texture(void)
{
    static GLuint name;
    static float pixels[4 * COLOR_SIDE * COLOR_SIDE];
    int k, n;
    if (name) return name;
    gl.GenTextures(1, &name);
    gl.BindTexture(GL_TEXTURE_2D, name);
    for (k = 0; k < COLOR_LEVELS; ++k) {
        for (n = 0; n < 4 * COLOR_SIDE * COLOR_SIDE; ++n) pixels[n] = (float)k / 16.0f;
        gl.TexImage2D(GL_TEXTURE_2D, k, GL_RGBA32F, COLOR_SIDE >> k, COLOR_SIDE >> k, 0, GL_RGBA, GL_FLOAT, pixels);
    }
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST_MIPMAP_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_REPEAT);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_REPEAT);
    return name;
}

/* Is this the mip that the gradient calls for? Beside the middle between two either will do. */
static int color_fits(const conemap_gradient *g, float color)
{
    const float x = g->dudx * g->dudx + g->dvdx * g->dvdx, y = g->dudy * g->dudy + g->dvdy * g->dvdy;
    const float level = 0.5f * log2f((x > y ? x : y) * COLOR_SIDE * COLOR_SIDE), read = 16.0f * color;
    const float right = level < 0.0f ? 0.0f : level > COLOR_LEVELS - 1.0f ? COLOR_LEVELS - 1.0f : level;
    return fabsf(read - right) < 0.55f;
}

/* ---- programs ---- */

static GLint at(GLuint p, const char *name) { return gl.GetUniformLocation(p, name); }

static void set4(GLuint p, const char *name, float x, float y, float z, float w)
{
    if (at(p, name) >= 0) gl.Uniform4f(at(p, name), x, y, z, w);
}

static void set1(GLuint p, const char *name, float x)
{
    if (at(p, name) >= 0) gl.Uniform1f(at(p, name), x);
}

static void seti(GLuint p, const char *name, int x)
{
    if (at(p, name) >= 0) gl.Uniform1i(at(p, name), x);
}

/* What all rays have in common, and the textures: under the same names in all stages. */
static void set_uniforms(GLuint p, const conemap_shader_desc *d, const struct scene *s, const conemap_effects *e,
                         const conemap_frame *shape, GLuint textures[5])
{
    static const char *const names[5] = {"conemap_map", "conemap_octants", "conemap_heights", "conemap_alpha",
                                         "conemap_colors"};
    const GLenum target = d->array ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
    const float *m = e->view_projection;
    const int sectors = d->map.texture.sectors;
    int k;
    textures[0] = map_texture(d, s, 0);
    textures[1] = sectors == 8 ? map_texture(d, s, 1) : 0;
    textures[2] = sectors || d->map.texture.layout == CONEMAP_CONE_ONLY ? heights_texture(d, s) : 0;
    textures[3] = d->flags & CONEMAP_EFFECT_HOLES ? alpha_texture(d, s) : 0;
    textures[4] = color_texture();
    for (k = 0; k < 5; ++k) {
        gl.ActiveTexture(GL_TEXTURE0 + (GLenum)k);
        gl.BindTexture(k == 4 ? GL_TEXTURE_2D : target, textures[k]);
        seti(p, names[k], k);
    }
    set4(p, "conemap_settings.clip", e->clip[0], e->clip[1], e->clip[2], e->clip[3]);
    set4(p, "conemap_settings.clip_z", m[2], m[6], m[10], m[14]);
    set4(p, "conemap_settings.clip_w", m[3], m[7], m[11], m[15]);
    set4(p, "conemap_settings.light", e->light[0], e->light[1], e->light[2], (float)e->light_is_point);
    set1(p, "conemap_settings.light_radius", e->light_radius);
    set1(p, "conemap_settings.sky_reach", e->sky_reach);
    seti(p, "conemap_settings.sky_directions", e->sky_directions);
    set1(p, "conemap_settings.alpha_cut", 127.5f / 255.0f);
    set1(p, "conemap_settings.lod_bias", e->lod_bias);
    seti(p, "conemap_settings.lod_steps", e->lod_steps);
    seti(p, "conemap_settings.level_count", e->level_count);
    set1(p, "conemap_settings.fade_begin", e->fade_begin);
    set1(p, "conemap_settings.fade_end", e->fade_end);
    set4(p, "conemap_shape", shape->uv_scale[0], shape->uv_scale[1], shape->depth, shape->level);
    set4(p, "conemap_curvature", shape->curvature[0], shape->curvature[1], shape->curvature[2], 0.0f);
    if (at(p, "conemap_rect") >= 0) gl.Uniform4i(at(p, "conemap_rect"), FRAME_X, FRAME_Y, s->width, s->height);
    seti(p, "conemap_slice", 1);
}

static const char *const versions[] = {"330 core", "430 core", "450 core", "", "300 es", "310 es"};

/* The functions in a fragment shader of ours that writes what a compute shader does, to a target each. */
static GLuint build_functions(const conemap_shader_desc *d, const char *text)
{
    static char whole[160000];
    const unsigned f = d->flags;
    char vertex[400], *end = whole;
    end += sprintf(end, "#version %s\nprecision highp float;\nprecision highp int;\n", versions[d->dialect]);
    end += sprintf(end, "%s%s", text, f & settings ? "uniform conemap_effects conemap_settings;\n" : "");
    end += sprintf(end,
                   "uniform highp sampler2D rays;\nuniform vec4 conemap_shape, conemap_curvature;\nuniform ivec4 "
                   "conemap_rect;\nuniform int conemap_slice;\nlayout(location = 0) out vec4 answers[%d];\n"
                   "vec4 given(int k) {\n    return texelFetch(rays, ivec2(8 * int(gl_FragCoord.x) + k, "
                   "int(gl_FragCoord.y)), 0);\n}\nvoid main() {\n    conemap_frame frame;\n",
                   (int)OUTPUTS);
    end += sprintf(end, "    frame.tangent = given(2).xyz;\n    frame.bitangent = given(3).xyz;\n"
                        "    frame.normal = given(4).xyz;\n    frame.origin = given(5).xyz;\n"
                        "    frame.uv_offset = given(6).xy;\n    frame.uv_scale = conemap_shape.xy;\n"
                        "    frame.depth = conemap_shape.z;\n    frame.level = conemap_shape.w;\n");
    if (f & CONEMAP_EFFECT_CURVED) end += sprintf(end, "    frame.curvature = conemap_curvature.xyz;\n");
    end += sprintf(end, "    conemap_shading s = conemap_shade(%sframe, given(0).xyz, given(1).xyz%s%s%s%s);\n",
                   f & settings ? "conemap_settings, " : "", d->t_range ? ", given(0).w, given(1).w" : "",
                   f & graded ? ", given(7)" : "", d->atlas ? ", conemap_rect" : "", d->array ? ", conemap_slice" : "");
    end += sprintf(end, "    answers[0] = vec4(s.box, s.found ? s.t : -1.0);\n    answers[1] = vec4(%s, 1.0);\n"
                        "    answers[2] = vec4(%s, 0.0);\n    answers[3] = %s;\n",
                   f & CONEMAP_EFFECT_POSITION ? "s.position" : "vec3(0.0)", f & normals ? "s.normal" : "vec3(0.0)",
                   f & CONEMAP_EFFECT_UV ? "conemap_color(s)" : "vec4(0.0)");
    end += sprintf(end, "    answers[4] = vec4(%s, %s, %s, %s);\n",
                   f & (CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW) ? "s.shadow" : "1.0",
                   f & (CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY) ? "s.occlusion" : "1.0",
                   f & CONEMAP_EFFECT_LOD ? "s.level" : "0.0", f & CONEMAP_EFFECT_FADE ? "s.fade" : "0.0");
    sprintf(end, "    answers[5] = vec4(%s, 0.0, 0.0, 0.0);\n}\n", f & CONEMAP_EFFECT_DEPTH ? "s.depth" : "0.0");
    sprintf(vertex,
            "#version %s\nvoid main() {\n    gl_Position = vec4(float(gl_VertexID %% 2) * 4.0 - 1.0, "
            "float(gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0);\n}\n",
            versions[d->dialect]);
    return program(shader(GL_VERTEX_SHADER, vertex), shader(GL_FRAGMENT_SHADER, whole));
}

/* Which of the six numbers a compute or fragment shader writes, and in what order: their places, or -1. */
static int targets_of(unsigned flags, int places[OUTPUTS])
{
    int count = 1;
    places[0] = 0;
    places[1] = flags & CONEMAP_EFFECT_POSITION ? count++ : -1;
    places[2] = flags & normals ? count++ : -1;
    places[3] = flags & CONEMAP_EFFECT_UV ? count++ : -1;
    places[4] = flags & numbers ? count++ : -1;
    places[5] = flags & CONEMAP_EFFECT_DEPTH ? count++ : -1;
    return count;
}

static float given[8 * 4 * RAYS], answers[OUTPUTS][4 * RAYS];

static void draw_functions(GLuint p)
{
    static GLuint rays, targets[OUTPUTS], frame;
    int k;
    if (!frame) {
        GLenum buffers[OUTPUTS];
        gl.GenTextures(1, &rays);
        gl.GenTextures(OUTPUTS, targets);
        gl.GenFramebuffers(1, &frame);
        gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
        for (k = 0; k < OUTPUTS; ++k) {
            buffers[k] = GL_COLOR_ATTACHMENT0 + (GLenum)k;
            gl.BindTexture(GL_TEXTURE_2D, targets[k]);
            gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, SIDE, SIDE, 0, GL_RGBA, GL_FLOAT, NULL);
            gl.FramebufferTexture2D(GL_FRAMEBUFFER, buffers[k], GL_TEXTURE_2D, targets[k], 0);
        }
        gl.DrawBuffers(OUTPUTS, buffers);
    }
    gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
    gl.ActiveTexture(GL_TEXTURE6);
    gl.BindTexture(GL_TEXTURE_2D, rays);
    gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, 8 * SIDE, SIDE, 0, GL_RGBA, GL_FLOAT, given);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    seti(p, "rays", 6);
    gl.Viewport(0, 0, SIDE, SIDE);
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
    for (k = 0; k < OUTPUTS; ++k) {
        gl.ReadBuffer(GL_COLOR_ATTACHMENT0 + (GLenum)k);
        gl.ReadPixels(0, 0, SIDE, SIDE, GL_RGBA, GL_FLOAT, answers[k]);
    }
}

static void run_compute(const conemap_shader_desc *d)
{
    const conemap_texture *t = &d->map.texture;
    const int textures = 1 + (t->sectors == 8) + (t->sectors || t->layout == CONEMAP_CONE_ONLY) +
                         ((d->flags & CONEMAP_EFFECT_HOLES) != 0) + ((d->flags & CONEMAP_EFFECT_UV) != 0);
    int places[OUTPUTS], k, n;
    const int count = targets_of(d->flags, places);
    const GLsizeiptr size = (GLsizeiptr)(sizeof(float) * 4 * RAYS) * count;
    GLuint buffers[2];
    const float *back;
    gl.GenBuffers(2, buffers);
    gl.BindBuffer(GL_SHADER_STORAGE_BUFFER, buffers[0]);
    gl.BufferData(GL_SHADER_STORAGE_BUFFER, sizeof given, given, GL_STATIC_DRAW);
    gl.BindBuffer(GL_SHADER_STORAGE_BUFFER, buffers[1]);
    gl.BufferData(GL_SHADER_STORAGE_BUFFER, size, NULL, GL_STATIC_DRAW);
    gl.BindBufferBase(GL_SHADER_STORAGE_BUFFER, (GLuint)textures, buffers[0]);
    gl.BindBufferBase(GL_SHADER_STORAGE_BUFFER, (GLuint)textures + 1, buffers[1]);
    gl.DispatchCompute(RAYS / 64, 1, 1);
    gl.MemoryBarrier(GL_ALL_BARRIER_BITS);
    back = (const float *)gl.MapBufferRange(GL_SHADER_STORAGE_BUFFER, 0, size, GL_MAP_READ_BIT);
    for (n = 0; back && n < RAYS; ++n)
        for (k = 0; k < OUTPUTS; ++k)
            if (places[k] >= 0) memcpy(answers[k] + 4 * n, back + 4 * (count * n + places[k]), 4 * sizeof(float));
    gl.UnmapBuffer(GL_SHADER_STORAGE_BUFFER);
    gl.DeleteBuffers(2, buffers);
}

/* An answer as it was read. */
static void read_answer(int n, struct shade_answer *a)
{
    const float *values = answers[4] + 4 * n;
    memset(a, 0, sizeof *a);
    a->t = answers[0][4 * n + 3];
    a->found = a->t >= 0.0f;
    memcpy(a->box, answers[0] + 4 * n, sizeof a->box);
    memcpy(a->s.position, answers[1] + 4 * n, sizeof a->s.position);
    memcpy(a->s.normal, answers[2] + 4 * n, sizeof a->s.normal);
    a->s.shadow = values[0];
    a->s.occlusion = values[1];
    a->s.level = values[2];
    a->s.fade = values[3];
    a->s.depth = answers[5][4 * n];
}

/* Runs a desc over a map of this kind. 0 if the emitter refuses it. */
static int run(const char *name, const conemap_shader_desc *given_desc, int kind, int width, int height)
{
    static const int sizes[] = {4, 4, 4, 4, 4, 4, 2, 4}; /* numbers of given */
    static char text[100000];
    static struct shade_job jobs[RAYS];
    static struct scene s;
    conemap_shader_desc d = *given_desc;
    conemap_effects e;
    conemap_frame shape;
    struct shade_counts counts;
    GLuint p, textures[5];
    conemap_result result;
    int n, k, colors = 0;
    if (d.fixed_size) {
        d.map.width = width;
        d.map.height = height;
    }
    result = conemap_emit(&d, text, sizeof text, NULL);
    if (result == CONEMAP_ERROR_UNSUPPORTED) return 0;
    if (result != CONEMAP_OK) {
        wrong("%s: %s", name, conemap_result_string(result));
        return 0;
    }
    if (!scene_make(&d, kind, width, height, &s)) return 0;
    p = d.stage == CONEMAP_STAGE_COMPUTE ? program(shader(GL_COMPUTE_SHADER, text), 0) : build_functions(&d, text);
    memset(&counts, 0, sizeof counts);
    shade_settings(&chance, d.flags, s.levels, SHADE_LEVELS, s.alpha, &e);
    shade_shape(&chance, d.flags, d.map.aspect == 0.0f ? 1.0f : d.map.aspect, &shape);
    for (n = 0; n < RAYS; ++n) {
        const float *from[8];
        float *to = given + 32 * n;
        shade_draw(&chance, &e, &shape, d.t_range, &jobs[n]);
        from[0] = jobs[n].ray.origin;
        from[1] = jobs[n].ray.direction;
        from[2] = jobs[n].frame.tangent;
        from[3] = jobs[n].frame.bitangent;
        from[4] = jobs[n].frame.normal;
        from[5] = jobs[n].frame.origin;
        from[6] = jobs[n].frame.uv_offset;
        from[7] = &jobs[n].gradient.dudx;
        for (k = 0; k < 8; ++k) memcpy(to + 4 * k, from[k], sizeof(float) * (size_t)(k < 6 ? 3 : sizes[k]));
        to[3] = jobs[n].ray.t_min;
        to[7] = jobs[n].ray.t_max;
    }
    gl.UseProgram(p);
    set_uniforms(p, &d, &s, &e, &shape, textures);
    if (d.stage == CONEMAP_STAGE_COMPUTE)
        run_compute(&d);
    else
        draw_functions(p);
    for (n = 0; n < RAYS; ++n) {
        struct shade_answer answer;
        read_answer(n, &answer);
        if (!shade_compare(&s.levels[0], &d.trace, &jobs[n], &answer, &chance, &counts)) wrong("%s: shade", name);
        colors += (d.flags & CONEMAP_EFFECT_UV) && answer.found && !color_fits(&jobs[n].gradient, answers[3][4 * n]);
    }
    if (counts.hits * 6 < counts.rays) wrong("%s, flags %x: %d hits of %d", name, d.flags, counts.hits, counts.rays);
    if (counts.unexplained || counts.different * 50 > counts.rays)
        wrong("%s, flags %x: %d of %d rays differ, %d on no edge (%x)", name, d.flags, counts.different, counts.rays,
              counts.unexplained, counts.what);
    if (colors) wrong("%s, flags %x: %d colours of another mip", name, d.flags, colors);
    if (gl.GetError() != 0) wrong("%s, flags %x: a GL error", name, d.flags);
    total.rays += counts.rays;
    total.hits += counts.hits;
    total.different += counts.different;
    total.unexplained += counts.unexplained;
    ++variants_done;
    gl.DeleteTextures(4, textures);
    gl.DeleteProgram(p);
    scene_free(&s);
    return 1;
}

/* ---- what is run ---- */

static const int kinds[] = {ZOO_BRICKS, ZOO_FBM, ZOO_SPIKES, ZOO_CLIFF, ZOO_SADDLE};
static const int map_sizes[][2] = {{32, 32}, {48, 31}, {17, 23}};

static void all_sets(void)
{
    unsigned sets[MOST_SETS];
    const int count = shade_sets(SAMPLE, &chance, sets);
    int k, tries;
    for (k = 0; k < count; ++k) {
        conemap_shader_desc d;
        for (tries = 0;; ++tries) { /* what the emitter refuses is drawn again */
            memset(&d, 0, sizeof d);
            d.dialect = CONEMAP_GLSL_450;
            d.flags = sets[k];
            d.stage = zoo_below(&chance, 3) ? CONEMAP_STAGE_FUNCTIONS : CONEMAP_STAGE_COMPUTE;
            d.map.wrap_u = (conemap_wrap)zoo_below(&chance, 3);
            d.map.wrap_v = (conemap_wrap)zoo_below(&chance, 3);
            d.map.aspect = zoo_below(&chance, 2) ? 0.6f : 1.0f;
            d.map.texture.format = (conemap_format)zoo_below(&chance, 4);
            d.map.texture.encoding = (conemap_encoding)zoo_below(&chance, 3);
            d.map.texture.layout = (conemap_layout)zoo_below(&chance, 3);
            d.map.texture.flip_dv = zoo_below(&chance, 2);
            d.map.texture.per_cell = zoo_below(&chance, 4) == 0;
            d.map.texture.sectors = zoo_below(&chance, 3) ? 0 : 4 + 4 * zoo_below(&chance, 2);
            d.t_range = zoo_below(&chance, 2);
            d.fixed_size = zoo_below(&chance, 4) == 0;
            d.atlas = zoo_below(&chance, 6) == 0;
            d.array = !d.atlas && zoo_below(&chance, 5) == 0;
            if (d.map.texture.layout != CONEMAP_DUMMER) d.map.texture.flip_dv = 0;
            if (d.map.texture.layout == CONEMAP_DUMMER) d.map.texture.sectors = 0;
            if (d.map.texture.encoding == CONEMAP_RADIUS) d.map.texture.per_cell = 0;
            if (d.map.texture.layout == CONEMAP_CONE_ONLY && d.map.texture.format != CONEMAP_F32)
                d.map.texture.format = CONEMAP_F16;
            if (run("sets", &d, kinds[zoo_below(&chance, 5)], map_sizes[k % 3][0], map_sizes[k % 3][1])) break;
            if (tries > 50) {
                wrong("flags %x are refused", sets[k]);
                break;
            }
        }
    }
}

int main(int argc, char **argv)
{
    chance = zoo_seed(2027);
    context(0);
    (void)argc;
    (void)argv;
    all_sets();
    printf("effects by shaders: %d variants, %d rays, %d hits, %d differ from the CPU's, %d of them on no edge\n",
           variants_done, total.rays, total.hits, total.different, total.unexplained);
    return failures != 0;
}
