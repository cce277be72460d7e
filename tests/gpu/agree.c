/* Effects by the emitted shaders on a software GPU (Mesa, surfaceless EGL) against conemap_shade, rays that differ counted
   and shown to lie on an edge:  agree [es] [folder for pictures]. Exits with 77 where there is no such GPU.
     - functions and compute shaders: every effect, every pair, everything together and a seeded sample, each over a map
       and a storage of its own; then each storage by itself: stored slopes, arrays, atlases, gather, hardware filters
     - fragment shaders: polygons, drawn with depth */
#include "../../examples/common.h"
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

static void add_up(const struct shade_counts *counts)
{
    total.rays += counts->rays;
    total.hits += counts->hits;
    total.different += counts->different;
    total.unexplained += counts->unexplained;
    ++variants_done;
}

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
    add_up(&counts);
    gl.DeleteTextures(4, textures);
    gl.DeleteProgram(p);
    scene_free(&s);
    return 1;
}

/* ---- polygons, drawn with the fragment stage ---- */

enum { PICTURE_W = 160, PICTURE_H = 120, PIXELS = PICTURE_W * PICTURE_H, FACETS = 12, MOST_VERTICES = 6 * FACETS };
enum projection { ORDINARY, OF_GL, REVERSED, INFINITE_FAR, REVERSED_INFINITE };

struct shot {
    const char *name;
    unsigned flags;
    conemap_dialect dialect[2]; /* of GL, of ES */
    conemap_depth_bound bound;
    enum projection projection;
    int barrel, kind;           /* what is drawn, and its map */
    conemap_wrap wrap;
    float elevation, distance, depth, level;
};

static const struct shot shots[] = {
    {"a block's border", CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_POSITION |
                             CONEMAP_EFFECT_DEPTH,
     {CONEMAP_GLSL_450, CONEMAP_ESSL_310}, CONEMAP_DEPTH_GREATER, ORDINARY, 0, ZOO_BRICKS, CONEMAP_CLAMP, 35, 1.9f, 0.15f,
     1},
    {"a sheet's border", CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_OCCLUSION,
     {CONEMAP_GLSL_330, CONEMAP_ESSL_300}, CONEMAP_DEPTH_ANY, OF_GL, 0, ZOO_FBM, CONEMAP_NOTHING, 30, 1.9f, 0.2f, 0.4f},
    {"holes", CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_DEPTH |
                  CONEMAP_EFFECT_UV | CONEMAP_EFFECT_SHADOW,
     {CONEMAP_GLSL_450, CONEMAP_ESSL_310}, CONEMAP_DEPTH_LESS, REVERSED_INFINITE, 0, ZOO_FBM, CONEMAP_WRAP, 50, 1.9f, 0.1f,
     1},
    {"from below", CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_DEPTH |
                       CONEMAP_EFFECT_SOFT_SHADOW,
     {CONEMAP_GLSL_430, CONEMAP_ESSL_300}, CONEMAP_DEPTH_GREATER, INFINITE_FAR, 0, ZOO_BRICKS, CONEMAP_CLAMP, -40, 1.9f,
     0.1f, 1},
    {"a barrel", CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW |
                     CONEMAP_EFFECT_UV,
     {CONEMAP_GLSL_450, CONEMAP_ESSL_310}, CONEMAP_DEPTH_ANY, REVERSED, 1, ZOO_BRICKS, CONEMAP_WRAP, 5, 3.4f, 0.1f, 1},
    {"levels, far away", CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_DEPTH |
                             CONEMAP_EFFECT_UV,
     {CONEMAP_GLSL_330, CONEMAP_ESSL_300}, CONEMAP_DEPTH_ANY, INFINITE_FAR, 0, ZOO_BRICKS, CONEMAP_WRAP, 9, 2.2f, 0.05f,
     1},
    {"all together", CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE |
                         CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_SMOOTH_NORMAL |
                         CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY | CONEMAP_EFFECT_UV,
     {CONEMAP_GLSL_450, CONEMAP_ESSL_310}, CONEMAP_DEPTH_ANY, REVERSED_INFINITE, 1, ZOO_BRICKS, CONEMAP_WRAP, 5, 3.4f, 0.1f,
     1},
};
enum { SHOTS = sizeof shots / sizeof shots[0] };

/* A vertex: position, tangent, bitangent, normal, uv. */
static float mesh[5][4 * MOST_VERTICES];

static void put_vertex(int n, const float place[3], const float tangent[3], const float bitangent[3],
                       const float normal[3], float u, float v)
{
    memcpy(mesh[0] + 4 * n, place, 3 * sizeof(float));
    memcpy(mesh[1] + 4 * n, tangent, 3 * sizeof(float));
    memcpy(mesh[2] + 4 * n, bitangent, 3 * sizeof(float));
    memcpy(mesh[3] + 4 * n, normal, 3 * sizeof(float));
    mesh[4][4 * n] = u;
    mesh[4][4 * n + 1] = v;
}

/* Two triangles, wider than the map; far wider where it wraps without an end. */
static int floor_mesh(const struct shot *shot)
{
    static const float corners[6][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 0}, {1, 1}, {0, 1}};
    static const float x[3] = {1, 0, 0}, y[3] = {0, 1, 0}, z[3] = {0, 0, 1};
    const float margin = shot->wrap == CONEMAP_WRAP && !(shot->flags & CONEMAP_EFFECT_CLIP) ? 20.0f : 0.3f;
    int k;
    for (k = 0; k < 6; ++k) {
        float place[3] = {0, 0, 0};
        place[0] = corners[k][0] * (1 + 2 * margin) - margin;
        place[1] = corners[k][1] * (1 + 2 * margin) - margin;
        put_vertex(k, place, x, y, z, place[0], place[1]);
    }
    return 6;
}

/* The front of a barrel around the z axis, seen along y, in facets. */
static int barrel_mesh(void)
{
    static const float up[3] = {0, 0, 1};
    int k, n;
    for (k = 0; k < FACETS; ++k)
        for (n = 0; n < 6; ++n) {
            const int right = n == 1 || n == 2 || n == 4, top = n == 2 || n == 4 || n == 5;
            const float angle = (float)(k + right) / (float)FACETS * 2.4f - 1.2f;
            float place[3], tangent[3], normal[3];
            normal[0] = sinf(angle), normal[1] = -cosf(angle), normal[2] = 0;
            tangent[0] = cosf(angle), tangent[1] = sinf(angle), tangent[2] = 0;
            memcpy(place, normal, sizeof place);
            place[2] = top ? 1.0f : -1.0f;
            put_vertex(6 * k + n, place, tangent, up, normal, 0.5f * angle, 0.5f * place[2]);
        }
    return 6 * FACETS;
}

/* clip[k] = p[0] m[k] + p[1] m[4 + k] + p[2] m[8 + k] + m[12 + k], for a viewer south of the middle. */
static void look_at(const struct shot *shot, float eye[3], float m[16])
{
    const float near = 0.1f, far = 60.0f, tan_y = 0.36f, tan_x = tan_y * PICTURE_W / PICTURE_H;
    const float e = shot->elevation * 3.14159265f / 180.0f, c = cosf(e), s = sinf(e);
    const float forward[3] = {0, c, -s}, up[3] = {0, s, c}, middle = shot->barrel ? 0.0f : 0.5f;
    const float a = shot->projection == REVERSED       ? -near / (far - near)
                    : shot->projection == INFINITE_FAR ? 1.0f
                    : shot->projection == REVERSED_INFINITE ? 0.0f
                                                            : far / (far - near);
    const float b = shot->projection == REVERSED            ? near * far / (far - near)
                    : shot->projection == INFINITE_FAR      ? -near
                    : shot->projection == REVERSED_INFINITE ? near
                                                            : -near * far / (far - near);
    int k;
    eye[0] = middle + 0.07f;
    eye[1] = middle - shot->distance * c;
    eye[2] = shot->distance * s;
    memset(m, 0, 16 * sizeof m[0]);
    m[0] = 1.0f / tan_x;
    m[12] = -eye[0] / tan_x;
    for (k = 1; k < 3; ++k) {
        m[4 * k + 1] = up[k] / tan_y;
        m[4 * k + 2] = a * forward[k];
        m[4 * k + 3] = forward[k];
        m[13] -= eye[k] * m[4 * k + 1];
        m[15] -= eye[k] * m[4 * k + 3];
    }
    m[14] = a * m[15] + b;
    if (shot->projection == OF_GL)
        for (k = 2; k < 16; k += 4) m[k] = 2 * m[k] - m[k + 1];
}

/* A vertex shader, and a fragment shader that writes down what the emitted one is given. */
static void own_shaders(const struct shot *shot, int es, char *vertex, char *fragment)
{
    static const char *const names[7] = {"origin",       "direction", "frame_tangent", "frame_bitangent",
                                         "frame_normal", "point",     "uv"};
    const conemap_dialect dialect = shot->dialect[es];
    const int located = dialect != CONEMAP_GLSL_330 && dialect != CONEMAP_ESSL_300;
    int k;
    vertex += sprintf(vertex, "#version %s\nprecision highp float;\nuniform highp sampler2D mesh;\nuniform mat4 matrix;\n"
                              "uniform vec3 eye;\n", versions[dialect]);
    fragment += sprintf(fragment, "#version %s\nprecision highp float;\nlayout(location = 0) out vec4 seen[8];\n",
                        versions[dialect]);
    for (k = 0; k < 7; ++k) {
        char place[40] = "";
        if (located) sprintf(place, "layout(location = %d) ", k);
        vertex += sprintf(vertex, "%sout vec%d conemap_%s;\n", place, k < 6 ? 3 : 2, names[k]);
        fragment += sprintf(fragment, "%sin vec%d conemap_%s;\n", place, k < 6 ? 3 : 2, names[k]);
    }
    sprintf(vertex, "vec4 given(int k) {\n    return texelFetch(mesh, ivec2(gl_VertexID, k), 0);\n}\nvoid main() {\n"
                    "    conemap_point = given(0).xyz;\n    conemap_origin = eye;\n"
                    "    conemap_direction = conemap_point - eye;\n    conemap_frame_tangent = given(1).xyz;\n"
                    "    conemap_frame_bitangent = given(2).xyz;\n    conemap_frame_normal = given(3).xyz;\n"
                    "    conemap_uv = given(4).xy;\n    gl_Position = matrix * vec4(conemap_point, 1.0);\n}\n");
    fragment += sprintf(fragment, "void main() {\n");
    for (k = 0; k < 6; ++k) fragment += sprintf(fragment, "    seen[%d] = vec4(conemap_%s, 1.0);\n", k, names[k]);
    sprintf(fragment, "    seen[6] = vec4(conemap_uv, 0.0, 1.0);\n    seen[7] = vec4(dFdx(conemap_uv), dFdy(conemap_uv));\n"
                      "}\n");
}

static float seen[8][4 * PIXELS], drawn[OUTPUTS][4 * PIXELS], polygon_depth[PIXELS], relief_depth[PIXELS];

/* Draws the mesh into `count` targets and a depth buffer; reads all. */
static void draw_mesh(const struct shot *shot, int es, GLuint p, int vertices, const float eye[3], const float m[16],
                      int count, float (*into)[4 * PIXELS], float *depth)
{
    static GLuint frame, targets[8], depths, mesh_name;
    static float as_color[4 * PIXELS];
    const float nothing[4] = {-1, -1, -1, -1};
    const float farthest = shot->projection == REVERSED || shot->projection == REVERSED_INFINITE ? 0.0f : 1.0f;
    GLenum buffers[8];
    int k;
    if (!frame) {
        gl.GenFramebuffers(1, &frame);
        gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
        gl.GenTextures(8, targets);
        gl.GenTextures(1, &depths);
        gl.GenTextures(1, &mesh_name);
        for (k = 0; k < 8; ++k) {
            gl.BindTexture(GL_TEXTURE_2D, targets[k]);
            gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, PICTURE_W, PICTURE_H, 0, GL_RGBA, GL_FLOAT, NULL);
            gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0 + (GLenum)k, GL_TEXTURE_2D, targets[k], 0);
        }
        gl.BindTexture(GL_TEXTURE_2D, depths);
        gl.TexImage2D(GL_TEXTURE_2D, 0, GL_DEPTH_COMPONENT32F, PICTURE_W, PICTURE_H, 0, GL_DEPTH_COMPONENT, GL_FLOAT,
                      NULL);
        gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, depths, 0);
    }
    gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
    for (k = 0; k < 8; ++k) buffers[k] = k < count ? GL_COLOR_ATTACHMENT0 + (GLenum)k : GL_NONE;
    gl.DrawBuffers(8, buffers);
    gl.ActiveTexture(GL_TEXTURE7);
    gl.BindTexture(GL_TEXTURE_2D, mesh_name);
    gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, MOST_VERTICES, 5, 0, GL_RGBA, GL_FLOAT, mesh);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    seti(p, "mesh", 7);
    gl.UniformMatrix4fv(at(p, "matrix"), 1, GL_FALSE, m);
    gl.Uniform3f(at(p, "eye"), eye[0], eye[1], eye[2]);
    gl.Viewport(0, 0, PICTURE_W, PICTURE_H);
    gl.Enable(GL_DEPTH_TEST);
    gl.DepthFunc(farthest == 0.0f ? GL_GREATER : GL_LESS);
    if (!es)
        gl.ClipControl(GL_LOWER_LEFT, shot->projection == OF_GL ? GL_NEGATIVE_ONE_TO_ONE : GL_ZERO_TO_ONE);
    for (k = 0; k < count; ++k) gl.ClearBufferfv(GL_COLOR, k, nothing);
    gl.ClearBufferfv(GL_DEPTH, 0, &farthest);
    gl.DrawArrays(GL_TRIANGLES, 0, vertices);
    gl.Disable(GL_DEPTH_TEST);
    for (k = 0; k < count; ++k) {
        gl.ReadBuffer(GL_COLOR_ATTACHMENT0 + (GLenum)k);
        gl.ReadPixels(0, 0, PICTURE_W, PICTURE_H, GL_RGBA, GL_FLOAT, into[k]);
    }
    (void)as_color;
    if (!es) gl.ReadPixels(0, 0, PICTURE_W, PICTURE_H, GL_DEPTH_COMPONENT, GL_FLOAT, depth);
}

/* A pixel as light falls on it. */
static void paint(unsigned char *to, unsigned flags, int found, const conemap_shading *s)
{
    const float sun = 0.5f * s->normal[2] - 0.6f * s->normal[1] - 0.5f * s->normal[0];
    float light = flags & (CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW) ? s->shadow : 1.0f;
    float sky = flags & (CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY) ? s->occlusion : 1.0f;
    float value = 0.25f * sky + 0.7f * light * (sun < 0 ? 0 : sun);
    to[0] = (unsigned char)(found ? 255.0f * (value < 0 ? 0 : value > 1 ? 1 : value) : 70.0f);
    to[1] = (unsigned char)(found ? 0.85f * (float)to[0] : 90.0f);
    to[2] = (unsigned char)(found ? 0.7f * (float)to[0] : 130.0f);
}

/* Draws a shot and the same on the CPU, from what each fragment was given. picture: the CPU's beside the GPU's. */
static void draw_shot(const struct shot *shot, int es, unsigned char *picture)
{
    static char text[100000], vertex[4000], fragment[4000];
    static struct scene s;
    struct shade_counts counts;
    struct shade_job job;
    conemap_shader_desc d;
    conemap_frame shape;
    conemap_effects e;
    GLuint p, textures[5];
    float eye[3], m[16], worst = 0;
    int places[OUTPUTS], targets, n, k, vertices, covered = 0, colors = 0, bounds = 0, deep = 0;
    memset(&d, 0, sizeof d);
    memset(&counts, 0, sizeof counts);
    d.dialect = shot->dialect[es];
    d.stage = CONEMAP_STAGE_FRAGMENT;
    d.flags = shot->flags;
    d.map.wrap_u = d.map.wrap_v = shot->wrap;
    if (d.dialect == CONEMAP_GLSL_430 || d.dialect == CONEMAP_GLSL_450) d.depth_bound = shot->bound;
    if (conemap_emit(&d, text, sizeof text, NULL) != CONEMAP_OK || !scene_make(&d, shot->kind, 64, 64, &s)) {
        wrong("%s: refused", shot->name);
        return;
    }
    shade_settings(&chance, d.flags, s.levels, SHADE_LEVELS, s.alpha, &e);
    e.clip[0] = e.clip[1] = 0;
    e.clip[2] = e.clip[3] = 1;
    e.lod_steps = 0;
    e.fade_begin = 4;
    e.fade_end = 1;
    e.light_is_point = 0;
    e.light[0] = -0.5f, e.light[1] = -0.6f, e.light[2] = shot->elevation < 0 ? -0.5f : 0.5f;
    e.sky_reach = 1;
    memset(&shape, 0, sizeof shape);
    shape.uv_scale[0] = shape.uv_scale[1] = shot->barrel ? 0.5f : 1.0f;
    shape.depth = shot->depth;
    shape.level = shot->level;
    if (shot->barrel) shape.curvature[0] = 1;
    vertices = shot->barrel ? barrel_mesh() : floor_mesh(shot);
    look_at(shot, eye, m);
    e.view_projection = m;
    e.depth_range = shot->projection == OF_GL ? CONEMAP_DEPTH_MINUS_ONE_TO_ONE : CONEMAP_DEPTH_ZERO_TO_ONE;
    own_shaders(shot, es, vertex, fragment);
    p = program(shader(GL_VERTEX_SHADER, vertex), shader(GL_FRAGMENT_SHADER, fragment));
    gl.UseProgram(p);
    draw_mesh(shot, es, p, vertices, eye, m, 8, seen, polygon_depth);
    gl.DeleteProgram(p);
    p = program(shader(GL_VERTEX_SHADER, vertex), shader(GL_FRAGMENT_SHADER, text));
    gl.UseProgram(p);
    set_uniforms(p, &d, &s, &e, &shape, textures);
    if (shot->projection == OF_GL)
        set4(p, "conemap_settings.clip_z", 0.5f * (m[2] + m[3]), 0.5f * (m[6] + m[7]), 0.5f * (m[10] + m[11]),
             0.5f * (m[14] + m[15]));
    targets = targets_of(d.flags, places) - 1; /* depth has none */
    draw_mesh(shot, es, p, vertices, eye, m, targets, drawn, relief_depth);
    for (n = 0; n < PIXELS; ++n) {
        struct shade_answer answer;
        conemap_hit hit;
        conemap_shading right;
        const float *values = places[4] >= 0 ? drawn[places[4]] + 4 * n : NULL;
        unsigned char *to = picture + 3 * ((PICTURE_H - 1 - n / PICTURE_W) * 2 * PICTURE_W + n % PICTURE_W);
        memset(&answer, 0, sizeof answer);
        memset(&right, 0, sizeof right);
        answer.t = drawn[0][4 * n + 3];
        answer.found = answer.t >= 0;
        if (seen[0][4 * n + 3] != 1.0f) { /* no polygon */
            if (answer.found) wrong("%s: pixel %d is drawn without a polygon", shot->name, n);
            paint(to, d.flags, 0, &right);
            paint(to + 3 * PICTURE_W, d.flags, 0, &right);
            continue;
        }
        ++covered;
        memcpy(answer.box, drawn[0] + 4 * n, sizeof answer.box);
        if (places[1] >= 0) memcpy(answer.s.position, drawn[places[1]] + 4 * n, sizeof answer.s.position);
        if (places[2] >= 0) memcpy(answer.s.normal, drawn[places[2]] + 4 * n, sizeof answer.s.normal);
        if (values) answer.s.shadow = values[0], answer.s.occlusion = values[1];
        if (values) answer.s.level = values[2], answer.s.fade = values[3];
        memset(&job, 0, sizeof job);
        job.frame = shape;
        memcpy(job.ray.origin, seen[0] + 4 * n, sizeof job.ray.origin);
        memcpy(job.ray.direction, seen[1] + 4 * n, sizeof job.ray.direction);
        memcpy(job.frame.tangent, seen[2] + 4 * n, sizeof job.frame.tangent);
        memcpy(job.frame.bitangent, seen[3] + 4 * n, sizeof job.frame.bitangent);
        memcpy(job.frame.normal, seen[4] + 4 * n, sizeof job.frame.normal);
        memcpy(job.frame.origin, seen[5] + 4 * n, sizeof job.frame.origin);
        memcpy(job.frame.uv_offset, seen[6] + 4 * n, sizeof job.frame.uv_offset);
        memcpy(&job.gradient, seen[7] + 4 * n, sizeof job.gradient);
        job.e = e;
        job.e.frames = &job.frame;
        job.e.gradients = &job.gradient;
        if (answer.found) { /* the depth buffer against the depth of the point that was found */
            float point[3], depth = 0;
            for (k = 0; k < 3; ++k) point[k] = job.ray.origin[k] + answer.t * job.ray.direction[k];
            conemap_depth(m, point, e.depth_range, &depth);
            answer.s.depth = es ? depth : relief_depth[n];
            if (!es && !(fabsf(depth - relief_depth[n]) <= 1e-5f * (0.01f + depth))) ++deep;
            if (!es && shot->bound == CONEMAP_DEPTH_GREATER && relief_depth[n] < polygon_depth[n] - 1e-6f) ++bounds;
            if (!es && shot->bound == CONEMAP_DEPTH_LESS && relief_depth[n] > polygon_depth[n] + 1e-6f) ++bounds;
            if (fabsf(relief_depth[n] - polygon_depth[n]) > worst) worst = fabsf(relief_depth[n] - polygon_depth[n]);
        }
        if (!shade_compare(&s.levels[0], NULL, &job, &answer, &chance, &counts)) wrong("%s: shade", shot->name);
        colors += places[3] >= 0 && answer.found && !color_fits(&job.gradient, drawn[places[3]][4 * n]);
        conemap_shade(&s.levels[0], NULL, &job.e, &job.ray, &hit, &right, 1);
        paint(to, d.flags, hit.status == CONEMAP_HIT || hit.status == CONEMAP_STEP_CAP, &right);
        paint(to + 3 * PICTURE_W, d.flags, answer.found, &answer.s);
    }
    if (counts.unexplained || counts.different * 200 > counts.rays)
        wrong("%s: %d of %d fragments differ, %d on no edge (%x)", shot->name, counts.different, counts.rays,
              counts.unexplained, counts.what);
    if (covered * 5 < PIXELS || counts.hits * 5 < covered) wrong("%s: %d pixels, %d hits", shot->name, covered, counts.hits);
    if (!shot->barrel && shot->wrap != CONEMAP_WRAP && counts.hits == covered) wrong("%s: no silhouette", shot->name);
    if (colors || deep || bounds || (!es && worst < 1e-4f))
        wrong("%s: %d colours, %d depths, %d of them against the promise, moved by %g", shot->name, colors, deep, bounds,
              (double)worst);
    if (gl.GetError() != 0) wrong("%s: a GL error", shot->name);
    add_up(&counts);
    gl.DeleteTextures(4, textures);
    gl.DeleteProgram(p);
    scene_free(&s);
}

static void polygons(int es, const char *folder)
{
    static unsigned char pictures[SHOTS][3 * 2 * PIXELS];
    char path[400];
    int k;
    for (k = 0; k < SHOTS; ++k) draw_shot(&shots[k], es, pictures[k]);
    if (!folder) return;
    snprintf(path, sizeof path, "%s/polygons%s.png", folder, es ? "_es" : "");
    png_write(path, pictures[0], 2 * PICTURE_W, SHOTS * PICTURE_H, 3);
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

static void must_run(const char *name, const conemap_shader_desc *d, int k)
{
    if (!run(name, d, kinds[k % 5], map_sizes[k % 3][0], map_sizes[k % 3][1])) wrong("%s is refused", name);
}

/* Each storage and each way to read it, by itself. es: the dialects of ES, else those of GL. */
static void storages(int es)
{
    static const conemap_tracer tracers[] = {CONEMAP_TRACE_LINEAR, CONEMAP_TRACE_LOOP, CONEMAP_TRACE_EXACT_STEP,
                                             CONEMAP_TRACE_CELL_MAX};
    const unsigned most = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_DEPTH |
                          CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_UV; /* that no fetch is needed for */
    conemap_shader_desc plain, d;
    int k;
    memset(&plain, 0, sizeof plain);
    plain.dialect = es ? CONEMAP_ESSL_310 : CONEMAP_GLSL_450;
    for (k = 0; k < 12; ++k) { /* slopes as [Dum06] stores them: borders, rounding, both ways up */
        d = plain;
        d.flags = k % 3 == 0 ? CONEMAP_EFFECT_SMOOTH_NORMAL
                  : k % 3 == 1 ? CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_OCCLUSION
                               : CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_LOD;
        d.map.texture.layout = CONEMAP_DUMMER;
        d.map.texture.encoding = CONEMAP_SQRT;
        d.map.texture.flip_dv = k & 1;
        d.map.texture.format = (conemap_format)(k / 2 % 4);
        d.map.wrap_u = (conemap_wrap)(k % 3);
        d.map.wrap_v = (conemap_wrap)(k / 2 % 3);
        d.array = k == 6;
        d.atlas = k == 9;
        must_run("stored slopes", &d, k);
        if (es && k == 2) break;
    }
    for (k = 0; k < 6; ++k) {
        d = plain;
        d.flags = k & 1 ? CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW
                        : CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_UV;
        if (k >= 4) d.flags = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_SMOOTH_NORMAL;
        d.array = k < 4;
        d.atlas = k >= 4; /* its clamps must not read what lies beside */
        d.map.wrap_u = (conemap_wrap)(k % 3);
        d.map.wrap_v = (conemap_wrap)((k + k / 3) % 3);
        d.map.texture.layout = k == 3 ? CONEMAP_CONE_ONLY : CONEMAP_HEIGHT_CONE;
        must_run(k < 4 ? "array" : "atlas", &d, k);
        if (es && k == 1) break;
    }
    for (k = 0; k < 4; ++k) {
        d = plain;
        d.flags = most;
        d.filter = k == 3 ? CONEMAP_FILTER_HARDWARE : CONEMAP_FILTER_GATHER;
        d.map.wrap_u = d.map.wrap_v = k & 1 ? CONEMAP_WRAP : CONEMAP_CLAMP;
        d.array = k == 2;
        if (k == 3) d.trace.tracer = CONEMAP_TRACE_LINEAR;
        if (k < 3) must_run("gather", &d, k);
        if (k < 3) continue;
        for (k = 0; k < 4; ++k) { /* the other tracers, by the texture unit's filter and by fetches */
            d.trace.tracer = tracers[k];
            d.trace.refinement = CONEMAP_REFINE_BISECT;
            d.trace.refine_steps = 16;
            d.filter = CONEMAP_FILTER_HARDWARE;
            must_run("hardware filter", &d, k);
            d.filter = CONEMAP_FILTER_FETCH;
            d.flags = most | CONEMAP_EFFECT_SMOOTH_NORMAL;
            must_run("other tracers", &d, k);
            d.flags = most;
            if (es) break;
        }
        break;
    }
    for (k = 0; k < 3; ++k) { /* relaxed cones: the exact tracer goes back where one was not empty */
        d = plain;
        d.flags = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW | (k == 2 ? (unsigned)CONEMAP_EFFECT_CLIP : 0u);
        d.map.guarantee = CONEMAP_GUARANTEE_VERTEX;
        d.map.texture.sectors = k == 1 ? 8 : 0;
        must_run("vertex cones", &d, k);
        if (es) break;
    }
    for (k = 0; k < 3; ++k) { /* the other dialects */
        static const conemap_dialect dialects[2][3] = {{CONEMAP_GLSL_330, CONEMAP_GLSL_430, CONEMAP_GLSL_430},
                                                       {CONEMAP_ESSL_300, CONEMAP_ESSL_300, CONEMAP_ESSL_310}};
        d = plain;
        d.dialect = dialects[es][k];
        d.flags = k == 0 ? most | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_SHADOW
                         : most | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_OCCLUSION |
                               CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_CURVED;
        d.stage = k == 2 ? CONEMAP_STAGE_COMPUTE : CONEMAP_STAGE_FUNCTIONS;
        must_run("dialects", &d, k);
    }
}

int main(int argc, char **argv)
{
    const int es = argc > 1 && strcmp(argv[1], "es") == 0;
    const char *folder = argc > 1 + es ? argv[1 + es] : NULL;
    chance = zoo_seed(2027);
    context(es);
    polygons(es, folder);
    storages(es);
    if (!es) all_sets();
    printf("effects by shaders: %d variants, %d rays, %d hits, %d differ from the CPU's, %d of them on no edge\n",
           variants_done, total.rays, total.hits, total.different, total.unexplained);
    return failures != 0;
}
