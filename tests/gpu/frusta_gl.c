/* Emitted frusta on a software GPU (Mesa, surfaceless EGL): models of examples/tree.c drawn depth-tested through the
   emitted shaders, against the same pictures by the CPU. Exits with 77 where there is no such GPU.
   frusta_gl [FOLDER [effects]]: also writes the pictures there; only those of effects. */
#define main tree_main
#include "../../examples/tree.c"
#undef main
#include "software.h"

static GLuint texture(int width, int height, GLenum internal, GLenum format, GLenum type, GLenum filter,
                      const void *pixels) {
    GLuint name;
    gl.GenTextures(1, &name);
    gl.BindTexture(GL_TEXTURE_2D, name);
    gl.TexImage2D(GL_TEXTURE_2D, 0, (GLint)internal, width, height, 0, format, type, pixels);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, (GLint)filter);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, (GLint)filter);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_REPEAT);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_REPEAT);
    return name;
}

/* ---- one picture by both ------------------------------------------------------------------------------------------ */

struct view {
    int width, height, parallel;
    struct vec eye, right, up, back;
};

static struct view view_of(const struct scene *scene, int width, int height, int parallel) {
    struct view view;
    view.width = width;
    view.height = height;
    view.parallel = parallel;
    view.eye = scene->eye;
    view.back = unit(add(scene->eye, scene->target, -1));
    view.right = unit(cross(vec(0, 1, 0), view.back));
    view.up = cross(view.back, view.right);
    return view;
}

enum { REACH = 4 }; /* of parallel rays, up and down */

static conemap_ray pixel_ray(const struct view *view, float x, float y) {
    float px = x / (float)view->width * 2 - 1, py = 1 - y / (float)view->height * 2;
    float wide = (float)view->width / (float)view->height, scale = view->parallel ? (float)REACH : 0.42f;
    struct vec d = add(vec(0, 0, 0), view->back, -1), o = view->eye, *moved = view->parallel ? &o : &d;
    conemap_ray ray;
    *moved = add(add(*moved, view->right, scale * px * wide), view->up, scale * py);
    d = unit(d);
    ray.origin[0] = o.x;
    ray.origin[1] = o.y;
    ray.origin[2] = o.z;
    ray.direction[0] = d.x;
    ray.direction[1] = d.y;
    ray.direction[2] = d.z;
    ray.t_min = ray.t_max = 0;
    return ray;
}

/* Column after column: what takes a place of the world into clip space. */
static void projection(const struct view *view, float m[16]) {
    float wide = (float)view->width / (float)view->height, near_by = 0.5f, far_out = 60, n = far_out - near_by;
    const struct vec rows[3] = {view->right, view->up, view->back};
    float place[3];
    for (int k = 0; k < 3; ++k) place[k] = -dot(rows[k], view->eye);
    for (int c = 0; c < 4; ++c) {
        float r[3];
        for (int k = 0; k < 3; ++k)
            r[k] = c == 0 ? rows[k].x : c == 1 ? rows[k].y : c == 2 ? rows[k].z : place[k];
        float scale = view->parallel ? (float)REACH : 0.42f, last = c == 3 ? 1.0f : 0.0f;
        m[4 * c] = r[0] / (scale * wide);
        m[4 * c + 1] = r[1] / scale;
        m[4 * c + 2] = view->parallel ? -2 * r[2] / n - last * (far_out + near_by) / n
                                      : -r[2] * (far_out + near_by) / n - last * 2 * far_out * near_by / n;
        m[4 * c + 3] = view->parallel ? last : -r[2];
    }
}

static struct vec seen_by_cpu(const struct scene *scene, const conemap_ray *from, float *t) {
    static const struct settings settings = {0, 0, 1, 1, CONEMAP_MARCH_DEFAULT, 0};
    conemap_skeleton_hit best, hit;
    const struct layer *layer = NULL;
    conemap_ray ray = *from;
    memset(&best, 0, sizeof best);
    for (int k = 0; k < scene->layer_count; ++k) {
        conemap_skeleton_trace_desc trace;
        set_trace(&settings, &scene->layers[k], 0, &trace);
        conemap_skeleton_trace(&scene->layers[k].skeleton, &trace, &ray, &hit, 1);
        if (hit.status != CONEMAP_HIT) continue;
        best = hit;
        layer = &scene->layers[k];
        ray.t_max = hit.t;
    }
    *t = layer ? best.t : 0;
    if (!layer) return vec(0, 0, 0);
    float w = layer->relief != SMOOTH ? best.w : 0.8f;
    struct vec color = add(layer->deep, add(layer->color, layer->deep, -1), w < 0 ? 0 : w > 1 ? 1 : w);
    color = vec(color.x * color.x, color.y * color.y, color.z * color.z);
    return lit(scene, color, vec(best.normal[0], best.normal[1], best.normal[2]), 1);
}

static const char host_shade[] = /* the same */
    "uniform vec3 host_color, host_deep, host_sun;\n"
    "uniform int host_plain;\n"
    "vec4 host_shade(conemap_frustum_hit hit) {\n"
    "    float w = host_plain != 0 ? 0.8 : clamp(hit.uvw.z, 0.0, 1.0);\n"
    "    vec3 color = host_deep + (host_color - host_deep) * w, n = hit.normal;\n"
    "    float direct = max(dot(n, host_sun), 0.0), sky = 0.5 + 0.5 * n.y;\n"
    "    color *= color;\n"
    "    return vec4(color.x * (1.9 * direct + 0.42 * sky + 0.12), color.y * (1.8 * direct + 0.48 * sky + 0.11),\n"
    "                color.z * (1.55 * direct + 0.62 * sky + 0.10), 1.0);\n"
    "}\n";

/* The frusta of a layer where the shader reads them. */
static GLuint bind_frusta(const conemap_skeleton *skeleton, conemap_frusta_source source, GLuint *buffer) {
    const int count = skeleton->count, across = 64; /* frusta in a row of the texture */
    const GLsizeiptr size = (GLsizeiptr)count * (GLsizeiptr)sizeof(conemap_frustum);
    GLuint name = 0;
    *buffer = 0;
    gl.ActiveTexture(GL_TEXTURE2);
    if (source == CONEMAP_FRUSTA_TEXTURE) {
        const int rows = (count + across - 1) / across;
        char *whole = (char *)calloc((size_t)rows * (size_t)across, sizeof(conemap_frustum));
        if (!whole) exit(2);
        memcpy(whole, skeleton->frusta, (size_t)size);
        name = texture(9 * across, rows, GL_RGBA32I, GL_RGBA_INTEGER, GL_INT, GL_NEAREST, whole);
        free(whole);
    } else {
        const GLenum target = source == CONEMAP_FRUSTA_BUFFER     ? GL_SHADER_STORAGE_BUFFER
                              : source == CONEMAP_FRUSTA_UNIFORMS ? GL_UNIFORM_BUFFER
                                                                  : GL_TEXTURE_BUFFER;
        gl.GenBuffers(1, buffer);
        gl.BindBuffer(target, *buffer);
        gl.BufferData(target, size, skeleton->frusta, GL_STATIC_DRAW);
        if (source == CONEMAP_FRUSTA_TEXELS) {
            gl.GenTextures(1, &name);
            gl.BindTexture(GL_TEXTURE_BUFFER, name);
            gl.TexBuffer(GL_TEXTURE_BUFFER, GL_RGBA32I, *buffer);
        } else {
            gl.BindBufferBase(target, 2, *buffer);
        }
    }
    return name;
}

struct run {
    const char *name;
    conemap_frusta_shader_desc desc;
    int parallel, front; /* front: the other winding is culled */
    const conemap_effects *effects;
    float pixel;
};

/* Effects as the shader's uniforms; those that it does not have are not there. */
static void set_effects(GLuint p, const conemap_effects *e, float pixel, int count) {
    gl.Uniform4f(gl.GetUniformLocation(p, "conemap_settings.light"), e->light[0], e->light[1], e->light[2],
                 e->light_is_point ? 1.0f : 0.0f);
    gl.Uniform1i(gl.GetUniformLocation(p, "conemap_settings.first"), 0);
    gl.Uniform1i(gl.GetUniformLocation(p, "conemap_settings.count"), count);
    gl.Uniform1f(gl.GetUniformLocation(p, "conemap_settings.light_radius"), e->light_radius);
    gl.Uniform1f(gl.GetUniformLocation(p, "conemap_settings.sky_reach"), e->sky_reach);
    gl.Uniform1i(gl.GetUniformLocation(p, "conemap_settings.sky_directions"), e->sky_directions);
    gl.Uniform1f(gl.GetUniformLocation(p, "conemap_settings.pixel"), pixel);
    gl.Uniform1f(gl.GetUniformLocation(p, "conemap_settings.lod_bias"), e->lod_bias);
    gl.Uniform1i(gl.GetUniformLocation(p, "conemap_settings.lod_steps"), e->lod_steps);
    gl.Uniform1f(gl.GetUniformLocation(p, "conemap_settings.fade_begin"), e->fade_begin);
    gl.Uniform1f(gl.GetUniformLocation(p, "conemap_settings.fade_end"), e->fade_end);
    gl.Uniform1f(gl.GetUniformLocation(p, "conemap_settings.alpha_cut"), 127.5f / 255);
    gl.Uniform1i(gl.GetUniformLocation(p, "conemap_colors"), 3);
    gl.Uniform1i(gl.GetUniformLocation(p, "conemap_alpha"), 4);
}

static void draw_layer(const struct scene *scene, const struct layer *layer, const struct run *r,
                       const struct view *view) {
    static char text[131072], whole[131072 + 4096];
    conemap_frusta_shader_desc d = r->desc;
    GLuint names[2], p, buffer, frusta, map = 0;
    const char *shade = r->desc.flags ? NULL : "host_shade";
    GLint at;
    float m[16];
    const int old = d.dialect == CONEMAP_GLSL_330 || d.dialect == CONEMAP_ESSL_300;
    d.relief = layer->relief != SMOOTH;
    d.map = layer->map.info;
    d.blend = 0.7f;
    d.shade = NULL;
    d.binding = old ? 0 : 2 - d.relief; /* the map at 1, the frusta at 2 */
    d.uniform_count = layer->skeleton.count < 455 ? layer->skeleton.count : 455;
    for (int k = 0; k < 2; ++k) {
        d.stage = k ? CONEMAP_FRUSTA_FRAGMENT : CONEMAP_FRUSTA_VERTEX;
        d.shade = k ? shade : NULL;
        if (!k && !old) d.binding = 2; /* no map there */
        if (k && !old) d.binding = 2 - d.relief;
        conemap_result result = conemap_emit_frusta(&d, text, sizeof text, NULL);
        if (result != CONEMAP_OK) {
            wrong("%s: %s", r->name, conemap_result_string(result));
            exit(1);
        }
        sprintf(whole, "%s%s", text, k && shade ? host_shade : "");
        names[k] = shader(k ? GL_FRAGMENT_SHADER : GL_VERTEX_SHADER, whole);
    }
    p = program(names[0], names[1]);
    gl.UseProgram(p);
    if (d.relief) {
        conemap_format_numbers numbers;
        size_t size = conemap_texture_size(&layer->map, 0);
        void *pixels = malloc(size);
        if (!pixels) exit(2);
        conemap_get_format_numbers(&layer->map.info.texture, &numbers);
        conemap_write_texture(&layer->map, pixels, size, 0);
        gl.ActiveTexture(GL_TEXTURE1);
        map = texture(SIDE, SIDE, numbers.gl_internal, numbers.gl_format, numbers.gl_type,
                      d.filter == CONEMAP_FILTER_FETCH ? GL_NEAREST : GL_LINEAR, pixels);
        free(pixels);
        if ((at = gl.GetUniformLocation(p, "conemap_map")) >= 0) gl.Uniform1i(at, 1);
    }
    frusta = bind_frusta(&layer->skeleton, d.source, &buffer);
    if ((at = gl.GetUniformLocation(p, "conemap_frusta")) >= 0) gl.Uniform1i(at, 2);
    if (d.source == CONEMAP_FRUSTA_UNIFORMS)
        gl.UniformBlockBinding(p, gl.GetUniformBlockIndex(p, "conemap_frusta_block"), 2);
    projection(view, m);
    gl.UniformMatrix4fv(gl.GetUniformLocation(p, "conemap_view_projection"), 1, GL_FALSE, m);
    if (view->parallel)
        gl.Uniform4f(gl.GetUniformLocation(p, "conemap_eye"), -view->back.x, -view->back.y, -view->back.z, 0);
    else
        gl.Uniform4f(gl.GetUniformLocation(p, "conemap_eye"), view->eye.x, view->eye.y, view->eye.z, 1);
    gl.Uniform3f(gl.GetUniformLocation(p, "host_color"), layer->color.x, layer->color.y, layer->color.z);
    gl.Uniform3f(gl.GetUniformLocation(p, "host_deep"), layer->deep.x, layer->deep.y, layer->deep.z);
    gl.Uniform3f(gl.GetUniformLocation(p, "host_sun"), scene->sun.x, scene->sun.y, scene->sun.z);
    gl.Uniform1i(gl.GetUniformLocation(p, "host_plain"), layer->relief == SMOOTH);
    if (d.flags) set_effects(p, r->effects, r->pixel, layer->skeleton.count);
    for (int k = 0; k < layer->skeleton.count; k += 1000) { /* in pieces, for conemap_first */
        int count = layer->skeleton.count - k < 1000 ? layer->skeleton.count - k : 1000;
        gl.Uniform1i(gl.GetUniformLocation(p, "conemap_first"), k);
        gl.DrawArraysInstanced(GL_TRIANGLES, 0, 36, count);
    }
    gl.DeleteProgram(p);
    gl.DeleteShader(names[0]);
    gl.DeleteShader(names[1]);
    gl.DeleteTextures(1, &frusta);
    gl.DeleteTextures(1, &map);
    gl.DeleteBuffers(1, &buffer);
    if (gl.GetError() != 0) wrong("%s: a GL error", r->name);
}

static void save(const char *folder, const char *name, const unsigned char *pixels, int width, int height) {
    char path[512];
    if (!folder) return;
    snprintf(path, sizeof path, "%s/frusta-%s.png", folder, name);
    png_write(path, pixels, width, height, 3);
}

static int near_enough(const unsigned char *a, const unsigned char *b) {
    return abs(a[0] - b[0]) <= 1 && abs(a[1] - b[1]) <= 1 && abs(a[2] - b[2]) <= 1;
}

static void to_screen(struct vec color, unsigned char *pixel) {
    pixel[0] = screen(color.x);
    pixel[1] = screen(color.y);
    pixel[2] = screen(color.z);
}

/* Whether the CPU shows about that color, or something lighter and something darker, a fiftieth of a pixel beside. */
static int on_edge(const struct scene *scene, const struct view *view, int x, int y, const unsigned char *gpu) {
    int low[3] = {255, 255, 255}, high[3] = {0, 0, 0};
    for (int k = 0; k < 9; ++k) {
        conemap_ray ray = pixel_ray(view, (float)x + 0.5f + 0.02f * (float)(k % 3 - 1),
                                    (float)y + 0.5f + 0.02f * (float)(k / 3 - 1));
        unsigned char pixel[3];
        float t;
        to_screen(seen_by_cpu(scene, &ray, &t), pixel);
        for (int c = 0; c < 3; ++c) {
            low[c] = pixel[c] < low[c] ? pixel[c] : low[c];
            high[c] = pixel[c] > high[c] ? pixel[c] : high[c];
        }
    }
    for (int c = 0; c < 3; ++c)
        if (gpu[c] < low[c] - 1 || gpu[c] > high[c] + 1) return 0;
    return 1;
}

static void compare(const struct scene *scene, const char *model, const struct run *r, int width, int height,
                    const char *folder) {
    const size_t count = (size_t)width * (size_t)height;
    float *colors = (float *)malloc(count * 4 * sizeof(float)), *depths = (float *)malloc(count * sizeof(float));
    unsigned char *cpu = (unsigned char *)malloc(count * 3), *gpu = (unsigned char *)malloc(count * 3);
    struct view view = view_of(scene, width, height, r->parallel);
    int covered = 0, different = 0, unexplained = 0, depth_wrong = 0;
    float m[16];
    if (!colors || !depths || !cpu || !gpu) exit(2);
    gl.Viewport(0, 0, width, height);
    gl.Enable(GL_DEPTH_TEST);
    gl.Enable(GL_CULL_FACE);
    gl.CullFace(r->front ? GL_BACK : GL_FRONT);
    gl.ClearColor(0, 0, 0, 0);
    gl.Clear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    for (int k = 0; k < scene->layer_count; ++k) draw_layer(scene, &scene->layers[k], r, &view);
    gl.ReadPixels(0, 0, width, height, GL_RGBA, GL_FLOAT, colors);
    if (r->desc.dialect < CONEMAP_ESSL_300)
        gl.ReadPixels(0, 0, width, height, GL_DEPTH_COMPONENT, GL_FLOAT, depths);
    projection(&view, m);
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const size_t at = (size_t)y * (size_t)width + (size_t)x;
            const size_t from = (size_t)(height - 1 - y) * (size_t)width + (size_t)x;
            const conemap_ray ray = pixel_ray(&view, (float)x + 0.5f, (float)y + 0.5f);
            float t;
            to_screen(seen_by_cpu(scene, &ray, &t), cpu + 3 * at);
            to_screen(vec(colors[4 * from], colors[4 * from + 1], colors[4 * from + 2]), gpu + 3 * at);
            covered += t > 0;
            if (!near_enough(cpu + 3 * at, gpu + 3 * at)) {
                ++different;
                unexplained += !on_edge(scene, &view, x, y, gpu + 3 * at);
            } else if (t > 0 && r->desc.dialect < CONEMAP_ESSL_300) {
                double clip[4];
                for (int k = 0; k < 4; ++k)
                    clip[k] = (double)m[k] * ((double)ray.origin[0] + (double)t * (double)ray.direction[0]) +
                              (double)m[4 + k] * ((double)ray.origin[1] + (double)t * (double)ray.direction[1]) +
                              (double)m[8 + k] * ((double)ray.origin[2] + (double)t * (double)ray.direction[2]) +
                              (double)m[12 + k];
                depth_wrong += fabs(0.5 * clip[2] / clip[3] + 0.5 - (double)depths[from]) > 2e-5;
            }
        }
    }
    printf("%s, %s: %d of %d pixels covered, %d differ by more than 1/255, %d of them not on an edge; %d depths\n", model,
           r->name, covered, width * height, different, unexplained, depth_wrong);
    fflush(stdout);
    if (covered < width * height / 50 || different * 100 > covered * 2 || unexplained * 2000 > covered ||
        depth_wrong * 1000 > covered)
        wrong("%s, %s: too many", model, r->name);
    if (r->name[0] == '*') {
        char name[64];
        snprintf(name, sizeof name, "%s-cpu", model);
        save(folder, name, cpu, width, height);
        snprintf(name, sizeof name, "%s-gpu", model);
        save(folder, name, gpu, width, height);
    }
    free(colors);
    free(depths);
    free(cpu);
    free(gpu);
}

/* Colour targets and a depth target for a context. */
static void targets(int width, int height, int count) {
    GLenum buffers[5];
    GLuint frame, depth;
    gl.ActiveTexture(GL_TEXTURE0);
    depth = texture(width, height, GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT, GL_NEAREST, NULL);
    gl.GenFramebuffers(1, &frame);
    gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
    for (int k = 0; k < count; ++k) {
        GLuint color = texture(width, height, GL_RGBA32F, GL_RGBA, GL_FLOAT, GL_NEAREST, NULL);
        buffers[k] = GL_COLOR_ATTACHMENT0 + (GLenum)k;
        gl.FramebufferTexture2D(GL_FRAMEBUFFER, buffers[k], GL_TEXTURE_2D, color, 0);
    }
    gl.DrawBuffers(count, buffers);
    gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, depth, 0);
    if (gl.CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
        printf("no float targets\n");
        exit(77);
    }
}

static struct run fresh(const char *name, conemap_dialect dialect, conemap_frusta_source source) {
    struct run r;
    memset(&r, 0, sizeof r);
    r.name = name;
    r.desc.dialect = dialect;
    r.desc.source = source;
    return r;
}

/* ---- effects: what they tell of each pixel ------------------------------------------------------------------------- */

/* A texture whose every level holds its own number, so that a colour says which levels a gradient asks for. */
static void level_texture(void) {
    static float pixels[64 * 64];
    GLuint name;
    gl.ActiveTexture(GL_TEXTURE3);
    gl.GenTextures(1, &name);
    gl.BindTexture(GL_TEXTURE_2D, name);
    for (int level = 0; level < 7; ++level) {
        for (int k = 0; k < 64 * 64; ++k) pixels[k] = (float)level;
        gl.TexImage2D(GL_TEXTURE_2D, level, GL_R32F, 64 >> level, 64 >> level, 0, GL_RED, GL_FLOAT, pixels);
    }
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
}

/* An alpha map for the layers' maps: lozenges are holes. */
static unsigned char lozenges[SIDE * SIDE];

static void alpha_texture(void) {
    for (int k = 0; k < SIDE * SIDE; ++k) {
        int x = abs(k % SIDE % 32 - 16), y = abs(k / SIDE % 32 - 16);
        lozenges[k] = x + y < 11 ? 0 : 255;
    }
    gl.ActiveTexture(GL_TEXTURE4);
    texture(SIDE, SIDE, GL_R8, GL_RED, GL_UNSIGNED_BYTE, GL_NEAREST, lozenges);
}

static float level_of(const conemap_gradient *g) {
    float a = sqrtf(g->dudx * g->dudx + g->dvdx * g->dvdx), b = sqrtf(g->dudy * g->dudy + g->dvdy * g->dvdy);
    float level = log2f(64 * (a > b ? a : b));
    return level < 0 ? 0 : level > 6 ? 6 : level;
}

enum { SMALL_WIDTH = 96, SMALL_HEIGHT = 72, SMALL = SMALL_WIDTH * SMALL_HEIGHT };

static int apart(const float *a, const float *b, int count, float tolerance) {
    for (int k = 0; k < count; ++k)
        if (!(fabsf(a[k] - b[k]) <= tolerance)) return 1;
    return 0;
}

/* A small picture by both with some effects. Depth is always among them, as bounds overlap. */
static void compare_effects(const struct scene *scene, unsigned flags, int *pixels, const char *folder) {
    static float told[5][SMALL * 4], none[4] = {-1, 0, 0, 0};
    const struct layer *layer = &scene->layers[0];
    const unsigned normals = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_SKY;
    const unsigned lights = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
    const unsigned skies = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY;
    const unsigned far_away = CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE;
    struct view view = view_of(scene, SMALL_WIDTH, SMALL_HEIGHT, 0);
    conemap_skeleton_trace_desc trace;
    conemap_effects e;
    struct run r = fresh("effects", CONEMAP_GLSL_430, CONEMAP_FRUSTA_BUFFER);
    struct scene one = *scene;
    int hits = 0, others = 0, turned = 0, dark = 0, closed = 0, levels = 0, numbers = 0, last = 0;
    float m[16], projected[16];
    memset(&e, 0, sizeof e);
    memset(&trace, 0, sizeof trace);
    flags |= CONEMAP_EFFECT_DEPTH;
    e.flags = flags;
    e.alpha = lozenges;
    e.light[0] = scene->sun.x;
    e.light[1] = scene->sun.y;
    e.light[2] = scene->sun.z;
    e.light_radius = 0.2f;
    e.sky_directions = 6;
    e.lod_steps = 100;
    e.fade_begin = 3;
    e.fade_end = 0.5f;
    projection(&view, m);
    for (int k = 0; k < 16; ++k) projected[k] = m[k];
    e.view_projection = projected;
    e.depth_range = CONEMAP_DEPTH_MINUS_ONE_TO_ONE;
    trace.map = &layer->map;
    r.desc.flags = flags;
    r.effects = &e;
    r.pixel = 2 * 0.42f / SMALL_HEIGHT;
    one.layer_count = 1;
    for (int k = 0; k < 5; ++k) gl.ClearBufferfv(GL_COLOR, k, none);
    gl.Clear(GL_DEPTH_BUFFER_BIT);
    draw_layer(&one, layer, &r, &view);
    last = 0;
    for (int k = 0; k < 5; ++k) { /* those that are asked for, in this order */
        const unsigned asked[5] = {~0u, CONEMAP_EFFECT_POSITION, normals, CONEMAP_EFFECT_UV, lights | skies | far_away};
        if (!(flags & asked[k])) continue;
        gl.ReadBuffer(GL_COLOR_ATTACHMENT0 + (GLenum)last++);
        gl.ReadPixels(0, 0, SMALL_WIDTH, SMALL_HEIGHT, GL_RGBA, GL_FLOAT, told[k]);
    }
    for (int k = 0; k < SMALL; ++k) {
        const int x = k % SMALL_WIDTH, y = SMALL_HEIGHT - 1 - k / SMALL_WIDTH;
        const conemap_ray ray = pixel_ray(&view, (float)x + 0.5f, (float)y + 0.5f);
        const float *at = told[0] + 4 * k;
        conemap_skeleton_hit hit;
        conemap_shading s;
        memset(&s, 0, sizeof s);
        if (conemap_skeleton_shade(&layer->skeleton, &trace, &e, r.pixel, &ray, &hit, &s, 1) != CONEMAP_OK) wrong("shade");
        if ((hit.status == CONEMAP_HIT) != (at[0] >= 0) || (at[0] >= 0 && fabsf(hit.t - at[3]) > 2e-3f)) {
            ++others;
            continue;
        }
        if (hit.status != CONEMAP_HIT) continue;
        ++hits;
        numbers += (flags & CONEMAP_EFFECT_POSITION) && apart(told[1] + 4 * k, s.position, 3, 2e-3f);
        if (flags & (CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL))
            turned += apart(told[2] + 4 * k, s.normal, 3, 0.02f);
        if (flags & CONEMAP_EFFECT_UV) levels += fabsf(told[3][4 * k] - level_of(&s.gradient)) > 0.6f;
        if (flags & lights) dark += fabsf(told[4][4 * k] - s.shadow) > 0.07f;
        if (flags & skies) closed += fabsf(told[4][4 * k + 1] - s.occlusion) > 0.02f;
        if (flags & CONEMAP_EFFECT_LOD) numbers += fabsf(told[4][4 * k + 2] - s.level) > 0.01f;
        if (flags & CONEMAP_EFFECT_FADE) numbers += fabsf(told[4][4 * k + 3] - s.fade) > 0.01f;
    }
    *pixels += hits;
    if (folder) { /* normal, shadow and occlusion as grey, levels of colour and fading */
        static unsigned char sheet[SMALL * 4 * 3];
        char name[64];
        for (int k = 0; k < SMALL * 4; ++k) {
            const int part = k / SMALL_WIDTH % 4, x = k % SMALL_WIDTH, y = SMALL_HEIGHT - 1 - k / SMALL_WIDTH / 4;
            const int at = 4 * (y * SMALL_WIDTH + x);
            for (int c = 0; c < 3 && told[0][at] >= 0; ++c) {
                float v = part == 0   ? 0.5f + 0.5f * told[2][at + c]
                          : part == 1 ? told[4][at]
                          : part == 2 ? told[4][at + 1]
                          : c == 0    ? told[3][at] / 6
                                      : told[4][at + 3];
                sheet[3 * k + c] = (unsigned char)(255 * (v < 0 ? 0 : v > 1 ? 1 : v));
            }
            if (told[0][at] < 0) memset(sheet + 3 * k, 90, 3);
        }
        snprintf(name, sizeof name, "effects-%x", flags);
        save(folder, name, sheet, SMALL_WIDTH * 4, SMALL_HEIGHT);
    }
    if (hits < SMALL / 50 || others * 50 > hits || turned * 50 > hits || dark * 50 > hits || closed * 50 > hits ||
        levels * 50 > hits || numbers * 50 > hits)
        wrong("effects %x: of %d hits %d are others, %d normals, %d shadows, %d skies, %d levels of colour, %d numbers",
              flags, hits, others, turned, dark, closed, levels, numbers);
}

static int make_scene(const char *model, struct scene *scene) {
    int good = 1, k = 0;
    while (strcmp(models[k].name, model) != 0) ++k;
    memset(scene, 0, sizeof *scene);
    scene->sun = unit(vec(0.62f, 0.80f, 0.45f));
    seed_now = 1;
    models[k].grow(scene);
    for (k = 0; good && k < scene->layer_count; ++k) good = make_relief(&scene->layers[k]) && skin(&scene->layers[k]);
    return good;
}

/* Every effect, pairs of them, and two sets that have all. */
static void effects(const char *folder) {
    const unsigned never = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_CURVED;
    const unsigned normals = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL;
    const unsigned shadows = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
    const unsigned skies = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY, all = CONEMAP_EFFECT_ALL_BITS & ~never;
    /* Pairs of these are not run: depth is always there, and position touches nothing that another reads. */
    const unsigned quiet = CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_POSITION;
    struct scene scene;
    int pixels = 0, sets = 0;
    if (!make_scene("saguaro", &scene)) return;
    scene.eye = add(scene.target, add(scene.eye, scene.target, -1), 0.45f); /* nearer by */
    context(0);
    targets(SMALL_WIDTH, SMALL_HEIGHT, 5);
    level_texture();
    alpha_texture();
    gl.Viewport(0, 0, SMALL_WIDTH, SMALL_HEIGHT);
    gl.Enable(GL_DEPTH_TEST);
    gl.Enable(GL_CULL_FACE);
    gl.CullFace(GL_FRONT);
    for (int a = 0; a < 15; ++a)
        for (int b = 0; b <= a; ++b) {
            unsigned flags = 1u << a | 1u << b;
            if (a != b && (flags & quiet)) continue;
            if ((flags & never) || (flags & normals) == normals || (flags & shadows) == shadows || (flags & skies) == skies)
                continue;
            compare_effects(&scene, flags, &pixels, NULL);
            ++sets;
        }
    compare_effects(&scene, all & ~(CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY), &pixels,
                    folder);
    compare_effects(&scene, all & ~(CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_OCCLUSION),
                    &pixels, folder);
    printf("frusta: %d sets of effects, %d pixels like the CPU's\n", sets + 2, pixels);
}

int main(int argc, char **argv) {
    static const struct {
        const char *name;
        conemap_dialect dialect;
        conemap_frusta_source source;
    } ways[] = {
        {"GLSL 330, texels", CONEMAP_GLSL_330, CONEMAP_FRUSTA_TEXELS},
        {"GLSL 330, uniforms", CONEMAP_GLSL_330, CONEMAP_FRUSTA_UNIFORMS},
        {"GLSL 430, buffer", CONEMAP_GLSL_430, CONEMAP_FRUSTA_BUFFER},
        {"GLSL 450, texture", CONEMAP_GLSL_450, CONEMAP_FRUSTA_TEXTURE},
        {"ES 300, texture", CONEMAP_ESSL_300, CONEMAP_FRUSTA_TEXTURE},
        {"ES 310, uniforms", CONEMAP_ESSL_310, CONEMAP_FRUSTA_UNIFORMS},
        {"ES 310, buffer", CONEMAP_ESSL_310, CONEMAP_FRUSTA_BUFFER},
    };
    static const char *const names[] = {"elm", "well", "aloe", "desert", "cacti", "coconut", "pine", "oasis",
                                        "olives"};
    const char *folder = argc > 1 ? argv[1] : NULL;
    if (argc > 2) {
        effects(folder);
        return failures != 0;
    }
    struct scene scene;
    int es = -1;
    program_name = "frusta_gl";
    if (!make_scene("saguaro", &scene)) return 1;
    for (int k = 0; k < (int)(sizeof ways / sizeof ways[0]); ++k) {
        struct run r = fresh(ways[k].name, ways[k].dialect, ways[k].source);
        if (es != (ways[k].dialect >= CONEMAP_ESSL_300)) {
            es = ways[k].dialect >= CONEMAP_ESSL_300;
            context(es);
            targets(400, 300, 1);
        }
        compare(&scene, "saguaro", &r, 160, 120, NULL);
    }
    context(0);
    targets(400, 300, 1);
    for (int k = 0; k < 4; ++k) {
        struct run r = fresh("", CONEMAP_GLSL_430, CONEMAP_FRUSTA_BUFFER);
        r.name = k == 0 ? "gathered" : k == 1 ? "parallel rays" : k == 2 ? "front faces" : "*";
        if (k == 0) r.desc.filter = CONEMAP_FILTER_GATHER;
        r.parallel = k == 1;
        r.front = k == 2;
        compare(&scene, "saguaro", &r, k < 3 ? 160 : 400, k < 3 ? 120 : 300, folder);
    }
    for (int k = 0; k < (int)(sizeof names / sizeof names[0]); ++k) {
        struct run r = fresh("*", CONEMAP_GLSL_430, CONEMAP_FRUSTA_BUFFER);
        if (make_scene(names[k], &scene)) compare(&scene, names[k], &r, k < 3 ? 400 : 240, k < 3 ? 300 : 180, folder);
    }
    effects(folder);
    return failures != 0;
}
