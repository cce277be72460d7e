/* Emitted frusta on a software GPU (Mesa, surfaceless EGL): models of examples/tree.c drawn depth-tested through the
   emitted shaders, against the same pictures by the CPU. Exits with 77 where there is no such GPU.
   frusta_gl [FOLDER]: also writes the pictures there. */
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
};

static void draw_layer(const struct scene *scene, const struct layer *layer, const struct run *r,
                       const struct view *view) {
    static char text[131072], whole[131072 + 4096];
    conemap_frusta_shader_desc d = r->desc;
    GLuint names[2], p, buffer, frusta, map = 0;
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
        d.shade = k ? "host_shade" : NULL;
        if (!k && !old) d.binding = 2; /* no map there */
        if (k && !old) d.binding = 2 - d.relief;
        conemap_result result = conemap_emit_frusta(&d, text, sizeof text, NULL);
        if (result != CONEMAP_OK) {
            wrong("%s: %s", r->name, conemap_result_string(result));
            exit(1);
        }
        sprintf(whole, "%s%s", text, k ? host_shade : "");
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
            const size_t at = (size_t)y * (size_t)width + (size_t)x, from = (size_t)(height - 1 - y) * (size_t)width + (size_t)x;
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

/* A colour and a depth target for a context. */
static void targets(int width, int height) {
    GLuint frame, color = texture(width, height, GL_RGBA32F, GL_RGBA, GL_FLOAT, GL_NEAREST, NULL);
    GLuint depth = texture(width, height, GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT, GL_NEAREST, NULL);
    gl.GenFramebuffers(1, &frame);
    gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
    gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, color, 0);
    gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, depth, 0);
    if (gl.CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
        printf("no float targets\n");
        exit(77);
    }
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

static struct run fresh(const char *name, conemap_dialect dialect, conemap_frusta_source source) {
    struct run r;
    memset(&r, 0, sizeof r);
    r.name = name;
    r.desc.dialect = dialect;
    r.desc.source = source;
    return r;
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
    const char *folder = argc > 1 ? argv[1] : NULL;
    struct scene scene;
    int es = -1;
    program_name = "frusta_gl";
    if (!make_scene("saguaro", &scene)) return 1;
    for (int k = 0; k < (int)(sizeof ways / sizeof ways[0]); ++k) {
        struct run r = fresh(ways[k].name, ways[k].dialect, ways[k].source);
        if (es != (ways[k].dialect >= CONEMAP_ESSL_300)) {
            es = ways[k].dialect >= CONEMAP_ESSL_300;
            context(es);
            targets(400, 300);
        }
        compare(&scene, "saguaro", &r, 160, 120, NULL);
    }
    context(0);
    targets(400, 300);
    for (int k = 0; k < 4; ++k) {
        struct run r = fresh("", CONEMAP_GLSL_430, CONEMAP_FRUSTA_BUFFER);
        r.name = k == 0 ? "gathered" : k == 1 ? "parallel rays" : k == 2 ? "front faces" : "*";
        if (k == 0) r.desc.filter = CONEMAP_FILTER_GATHER;
        r.parallel = k == 1;
        r.front = k == 2;
        compare(&scene, "saguaro", &r, k < 3 ? 160 : 400, k < 3 ? 120 : 300, folder);
    }
    for (int k = 0; k < 3; ++k) {
        static const char *const names[] = {"elm", "well", "aloe"};
        struct run r = fresh("*", CONEMAP_GLSL_430, CONEMAP_FRUSTA_BUFFER);
        if (make_scene(names[k], &scene)) compare(&scene, names[k], &r, 400, 300, folder);
    }
    return failures != 0;
}
