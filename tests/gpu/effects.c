/* The contact sheet of examples/effects.c through the emitted shader on a software GPU (Mesa, surfaceless EGL) against
   the same sheet from the CPU:  effects [folder for both pictures]. Exits with 77 where there is no such GPU.
   `effects cost FOLDER` prints what each effect costs: instructions of the whole fragment shader in SPIR-V (where
   glslangValidator is found), time on the CPU and on the software GPU over the plain trace's. */
#define EFFECTS_SHADE shade_rays
#define main sheet_main
#include "../../examples/common.h"
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
static int on_gpu;
static conemap_result shade_rays(const conemap_map *map, const conemap_trace_desc *trace,
                                 const conemap_effects *effects,
                                 const conemap_ray *rays, conemap_hit *hits, conemap_shading *shadings, int count);
#include "../../examples/effects.c"
#undef main

#include "software.h"

enum { INPUTS = 11, OUTPUTS = 4, PROGRAMS = 40, TEXTURES = 8, ROWS_TIMED = 24, TIMES = 5 };
static int rows = 1; /* how often the rays are drawn, under each other */

static GLuint targets[OUTPUTS], input_texture;
static struct {
    unsigned flags;
    GLuint name;
} programs[PROGRAMS];
static struct {
    const void *of;
    GLuint name;
} textures[TEXTURES];

/* What conemap_shade is told of each ray lies in a texture, one ray a column; its answer goes to the targets. */
static GLuint program_of(unsigned flags)
{
    static const char vertex[] =
        "#version 450 core\nvoid main() {\n    gl_Position = vec4(float(gl_VertexID % 2) * 4.0 - 1.0, "
        "float(gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0);\n}\n";
    static char text[100000], whole[110000];
    const unsigned settings = CLIP | HOLES | LOD | FADE | DEPTH | SHADOW | SOFT_SHADOW | SKY;
    conemap_shader_desc desc;
    conemap_result result;
    int k;
    for (k = 0; k < PROGRAMS && programs[k].name; ++k)
        if (programs[k].flags == flags) return programs[k].name;
    memset(&desc, 0, sizeof desc);
    desc.dialect = CONEMAP_GLSL_450;
    desc.flags = flags;
    desc.t_range = 1;
    desc.map.wrap_u = desc.map.wrap_v = CONEMAP_WRAP;
    result = conemap_emit(&desc, text, sizeof text, NULL);
    if (result != CONEMAP_OK) {
        printf("flags %x: %s\n", flags, conemap_result_string(result));
        exit(1);
    }
    snprintf(whole, sizeof whole, "#version 450 core\n%s%s%s", text,
             flags & settings ? "uniform conemap_effects e;\n" : "",
             "layout(binding = 5) uniform sampler2D rays;\nlayout(location = 0) out vec4 answer[4];\n"
             "vec4 given(int row) {\n    return texelFetch(rays, ivec2(int(gl_FragCoord.x), row), 0);\n}\n"
             "void main() {\n    vec4 origin = given(0), direction = given(1), place = given(6), more = given(7);\n"
             "    conemap_frame frame;\n    frame.origin = given(2).xyz;\n    frame.tangent = given(3).xyz;\n"
             "    frame.bitangent = given(4).xyz;\n    frame.normal = given(5).xyz;\n    frame.uv_offset = place.xy;\n"
             "    frame.uv_scale = place.zw;\n    frame.depth = more.x;\n    frame.level = more.y;\n");
    if (flags & CURVED) strcat(whole, "    frame.curvature = given(8).xyz;\n");
    if (flags == 0) /* a main of its own */
        snprintf(whole, sizeof whole, "#version 450 core\n%s%s", text,
                 "layout(binding = 5) uniform sampler2D rays;\nlayout(location = 0) out vec4 answer[4];\n"
                 "vec4 given(int row) {\n    return texelFetch(rays, ivec2(int(gl_FragCoord.x), row), 0);\n}\n"
                 "void main() {\n    vec3 stretch = vec3(1.0, 1.0, 1.0 / given(7).x);\n"
                 "    conemap_hit hit = conemap_trace(given(0).xyz * stretch, given(1).xyz * stretch, 0.0, 1e30);\n"
                 "    answer[0] = vec4(hit.found ? 1.0 : 0.0, hit.position);\n"
                 "    answer[1] = answer[2] = answer[3] = vec4(hit.t);\n}\n");
    if (flags) {
        char *end = whole + strlen(whole);
        end += sprintf(end, "    conemap_shading s = conemap_shade(%sframe, origin.xyz, direction.xyz,",
                       flags & settings ? "e, " : "");
        end += sprintf(end, " origin.w, direction.w%s);\n", flags & (UV | LOD | FADE) ? ", given(9)" : "");
        end += sprintf(end, "    answer[0] = vec4(s.found ? 1.0 : 0.0, s.box);\n");
        end += sprintf(end, "    answer[1] = vec4(%s, %s, %s, s.t);\n",
                       flags & (SHADOW | SOFT_SHADOW) ? "s.shadow" : "1.0",
                       flags & (OCCLUSION | SKY) ? "s.occlusion" : "1.0", flags & DEPTH ? "s.depth" : "0.0");
        sprintf(end, "    answer[2] = vec4(%s, %s);\n    answer[3] = vec4(%s, 0.0);\n}\n",
                flags & (NORMAL | SMOOTH) ? "s.normal" : "vec3(0.0)", flags & LOD ? "s.level" : "0.0",
                flags & FADE ? "s.fade, 0.0, 0.0" : "vec3(0.0)");
    }
    programs[k].flags = flags;
    programs[k].name = program(shader(GL_VERTEX_SHADER, vertex), shader(GL_FRAGMENT_SHADER, whole));
    return programs[k].name;
}

/* The texture of a map with its levels as mips, or of an alpha map. */
static GLuint texture_of(const conemap_map *levels, int count, const unsigned char *alpha)
{
    const void *of = levels ? (const void *)levels : (const void *)alpha;
    static float pixels[2 * 256 * 256];
    int k, level;
    for (k = 0; k < TEXTURES && textures[k].name; ++k)
        if (textures[k].of == of) return textures[k].name;
    textures[k].of = of;
    gl.GenTextures(1, &textures[k].name);
    gl.BindTexture(GL_TEXTURE_2D, textures[k].name);
    gl.PixelStorei(GL_UNPACK_ALIGNMENT, 1);
    if (!levels) gl.TexImage2D(GL_TEXTURE_2D, 0, GL_R8, 256, 256, 0, GL_RED, GL_UNSIGNED_BYTE, alpha);
    for (level = 0; levels && level < count; ++level) {
        conemap_write_texture(&levels[level], pixels, sizeof pixels, 0);
        gl.TexImage2D(GL_TEXTURE_2D, level, GL_RG32F, levels[level].info.width, levels[level].info.height, 0, GL_RG,
                     GL_FLOAT, pixels);
    }
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, levels ? GL_NEAREST_MIPMAP_NEAREST : GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return textures[k].name;
}

static double gpu_time; /* of the last draw */

static GLint at(GLuint program, const char *name) { return gl.GetUniformLocation(program, name); }

static void set4(float *row, int column, float x, float y, float z, float w)
{
    float *to = row + 4 * column;
    to[0] = x;
    to[1] = y;
    to[2] = z;
    to[3] = w;
}

static conemap_result shade_rays(const conemap_map *map, const conemap_trace_desc *trace, const conemap_effects *e,
                                 const conemap_ray *rays, conemap_hit *hits, conemap_shading *shadings, int count)
{
    static float in[INPUTS][4 * WIDE], out[OUTPUTS][4 * WIDE];
    const unsigned flags = e->flags;
    const float *m = e->view_projection;
    GLuint p;
    int k;
    if (!on_gpu) return conemap_shade(map, trace, e, rays, hits, shadings, count);
    for (k = 0; k < count; ++k) {
        const conemap_frame *f = &e->frames[k];
        const conemap_ray *r = &rays[k];
        const conemap_gradient *g = &e->gradients[k];
        set4(in[0], k, r->origin[0], r->origin[1], r->origin[2], r->t_min);
        set4(in[1], k, r->direction[0], r->direction[1], r->direction[2], r->t_max == 0 ? 1e30f : r->t_max);
        set4(in[2], k, f->origin[0], f->origin[1], f->origin[2], 0);
        set4(in[3], k, f->tangent[0], f->tangent[1], f->tangent[2], 0);
        set4(in[4], k, f->bitangent[0], f->bitangent[1], f->bitangent[2], 0);
        set4(in[5], k, f->normal[0], f->normal[1], f->normal[2], 0);
        set4(in[6], k, f->uv_offset[0], f->uv_offset[1], f->uv_scale[0] == 0 ? 1 : f->uv_scale[0],
             f->uv_scale[1] == 0 ? 1 : f->uv_scale[1]);
        set4(in[7], k, f->depth, f->level, 0, 0);
        set4(in[8], k, f->curvature[0], f->curvature[1], f->curvature[2], 0);
        set4(in[9], k, g->dudx, g->dvdx, g->dudy, g->dvdy);
    }
    p = program_of(flags);
    gl.UseProgram(p);
    gl.ActiveTexture(GL_TEXTURE5);
    gl.BindTexture(GL_TEXTURE_2D, input_texture);
    gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, WIDE, INPUTS, 0, GL_RGBA, GL_FLOAT, in);
    gl.ActiveTexture(GL_TEXTURE0);
    gl.BindTexture(GL_TEXTURE_2D, texture_of(map, LEVELS, NULL));
    gl.ActiveTexture(GL_TEXTURE1);
    gl.BindTexture(GL_TEXTURE_2D, texture_of(NULL, 0, e->alpha));
    gl.Uniform4f(at(p, "e.clip"), 0, 0, 1, 1);
    gl.Uniform4f(at(p, "e.clip_z"), m[2], m[6], m[10], m[14]);
    gl.Uniform4f(at(p, "e.clip_w"), m[3], m[7], m[11], m[15]);
    gl.Uniform4f(at(p, "e.light"), e->light[0], e->light[1], e->light[2], 0);
    gl.Uniform1f(at(p, "e.light_radius"), e->light_radius);
    gl.Uniform1f(at(p, "e.sky_reach"), e->sky_reach);
    gl.Uniform1i(at(p, "e.sky_directions"), 8);
    gl.Uniform1f(at(p, "e.alpha_cut"), 127.5f / 255.0f);
    gl.Uniform1f(at(p, "e.lod_bias"), e->lod_bias);
    gl.Uniform1i(at(p, "e.lod_steps"), e->lod_steps);
    gl.Uniform1i(at(p, "e.level_count"), e->level_count);
    gl.Uniform1f(at(p, "e.fade_begin"), 2);
    gl.Uniform1f(at(p, "e.fade_end"), 0.5f);
    gl.Viewport(0, 0, count, rows);
    if (rows > 1) gl.Finish();
    gpu_time = seconds();
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
    if (rows > 1) gl.Finish();
    gpu_time = seconds() - gpu_time;
    for (k = 0; k < OUTPUTS; ++k) {
        gl.ReadBuffer((GLenum)(GL_COLOR_ATTACHMENT0 + k));
        gl.ReadPixels(0, 0, count, 1, GL_RGBA, GL_FLOAT, out[k]);
    }
    for (k = 0; k < count; ++k) {
        conemap_hit *hit = &hits[k];
        conemap_shading *s = &shadings[k];
        const float *a = out[0] + 4 * k, *b = out[1] + 4 * k, *c = out[2] + 4 * k;
        memset(hit, 0, sizeof *hit);
        hit->status = a[0] > 0.5f ? CONEMAP_HIT : CONEMAP_LEFT;
        hit->u = s->uv[0] = a[1];
        hit->v = s->uv[1] = a[2];
        hit->z = a[3];
        hit->t = b[3];
        s->shadow = b[0];
        s->occlusion = b[1];
        s->depth = b[2];
        memcpy(s->normal, c, sizeof s->normal);
        s->level = c[3];
        s->fade = out[3][4 * k];
        s->gradient = e->gradients[k];
    }
    return gl.GetError() ? CONEMAP_ERROR_UNSUPPORTED : CONEMAP_OK;
}

static void put_tile(unsigned char *sheet, int n, const float *picture)
{
    for (int y = 0; y < TILE_H; ++y)
        for (int x = 0; x < TILE_W; ++x)
            for (int k = 0; k < 3; ++k) {
                size_t line = (size_t)(n / COLUMNS * TILE_H + y), column = (size_t)(n % COLUMNS * TILE_W + x);
                float value = picture[3 * (y * TILE_W + x) + k];
                sheet[3 * (line * TILE_W * COLUMNS + column) + (size_t)k] =
                    (unsigned char)(powf(clamp01(value), 1 / 2.2f) * 255 + 0.5f);
            }
}

/* Is a pixel of the CPU's picture on an edge? Then a neighbour differs from it visibly. */
static int beside_edge(const unsigned char *sheet, int line, int column)
{
    const unsigned char *at0 = sheet + 3 * (line * TILE_W * COLUMNS + column);
    for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
            for (int k = 0; k < 3; ++k) {
                int y = line + dy, x = column + dx;
                if (y < 0 || x < 0 || y >= TILE_H * ROWS || x >= TILE_W * COLUMNS) continue;
                if (abs(sheet[3 * (y * TILE_W * COLUMNS + x) + k] - at0[k]) > 3) return 1;
            }
    return 0;
}

static int open_gpu(void)
{
    static const GLenum buffers[OUTPUTS] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1, GL_COLOR_ATTACHMENT2,
                                            GL_COLOR_ATTACHMENT3};
    GLuint frame;
    context(0);
    gl.GenFramebuffers(1, &frame);
    gl.BindFramebuffer(GL_FRAMEBUFFER, frame);
    gl.GenTextures(OUTPUTS, targets);
    gl.GenTextures(1, &input_texture);
    gl.BindTexture(GL_TEXTURE_2D, input_texture);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    for (int k = 0; k < OUTPUTS; ++k) {
        gl.BindTexture(GL_TEXTURE_2D, targets[k]);
        gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, WIDE, ROWS_TIMED, 0, GL_RGBA, GL_FLOAT, NULL);
        gl.FramebufferTexture2D(GL_FRAMEBUFFER, buffers[k], GL_TEXTURE_2D, targets[k], 0);
    }
    gl.DrawBuffers(OUTPUTS, buffers);
    return gl.CheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
}

/* ---- what effects cost ---- */

/* Instructions of a Vulkan fragment shader with these effects; 0 without a compiler. */
static int spirv_count(const char *folder, unsigned flags)
{
    static char text[100000];
    conemap_shader_desc desc;
    char path[300], command[700];
    uint32_t word;
    int count = 0;
    FILE *file;
    memset(&desc, 0, sizeof desc);
    desc.dialect = CONEMAP_GLSL_450_VULKAN;
    desc.stage = CONEMAP_STAGE_FRAGMENT;
    desc.flags = flags;
    desc.map.wrap_u = desc.map.wrap_v = CONEMAP_WRAP;
    if (conemap_emit(&desc, text, sizeof text, NULL) != CONEMAP_OK) return 0;
    snprintf(path, sizeof path, "%s/cost_%x.frag", folder, flags);
    file = fopen(path, "wb");
    if (!file) return 0;
    fputs(text, file);
    fclose(file);
    snprintf(command, sizeof command, "glslangValidator -V '%s' -o '%s.spv' >/dev/null 2>&1", path, path);
    if (system(command) != 0) return 0;
    strcat(path, ".spv");
    file = fopen(path, "rb");
    if (!file) return 0;
    fseek(file, 20, SEEK_SET); /* behind the header; an instruction begins with its length */
    while (fread(&word, 4, 1, file) == 1) {
        ++count;
        fseek(file, 4 * ((long)(word >> 16) - 1), SEEK_CUR);
    }
    fclose(file);
    return count;
}

static int upward(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static int cost(const struct world *world, const char *folder)
{
    static const struct {
        const char *name;
        unsigned flags;
    } cases[] = {
        {"plain trace", 0},
        {"position", CONEMAP_EFFECT_POSITION},
        {"clip", CLIP},
        {"uv", UV},
        {"two-sided", TWO_SIDED},
        {"depth", DEPTH},
        {"normal", NORMAL},
        {"smooth normal", SMOOTH},
        {"shadow", SHADOW},
        {"soft shadow", SOFT_SHADOW},
        {"occlusion", OCCLUSION},
        {"sky, 8", SKY},
        {"holes", HOLES},
        {"curved", CURVED},
        {"lod, level 0.5", LOD},
        {"fade", FADE},
        {"all together", CLIP | HOLES | CURVED | LOD | FADE | TWO_SIDED | CONEMAP_EFFECT_POSITION | SMOOTH | DEPTH |
                             SOFT_SHADOW | SKY | UV},
    };
    enum { COUNT = sizeof cases / sizeof cases[0] };
    static conemap_ray rays[WIDE], boxes[WIDE];
    static conemap_hit hits[WIDE];
    static conemap_shading shadings[WIDE];
    static conemap_frame frames[WIDE];
    static conemap_gradient gradients[WIDE];
    static double times[2][COUNT][TIMES];
    static const float projection[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 0, 0.1f, 4};
    const conemap_map *map = &world->levels[0][0];
    conemap_effects e;
    uint32_t random = 1;
    memset(&e, 0, sizeof e);
    memset(rays, 0, sizeof rays);
    memset(frames, 0, sizeof frames);
    memset(gradients, 0, sizeof gradients);
    for (int k = 0; k < WIDE; ++k) {
        float given[4];
        for (int c = 0; c < 4; ++c) {
            random = random * 1664525u + 1013904223u;
            given[c] = (float)(random >> 8) / 16777216.0f;
        }
        frames[k].tangent[0] = frames[k].bitangent[1] = frames[k].normal[2] = 1;
        frames[k].depth = 0.1f;
        frames[k].curvature[0] = 0.4f;
        gradients[k].dudx = gradients[k].dvdy = sqrtf(2.0f) / 256.0f;
        rays[k].origin[0] = given[0];
        rays[k].origin[1] = given[1];
        rays[k].origin[2] = 0.1f;
        rays[k].direction[0] = 0.5f * given[2];
        rays[k].direction[1] = 0.5f * given[3];
        rays[k].direction[2] = -0.1f;
        boxes[k] = rays[k];
        boxes[k].origin[2] = 1;
        boxes[k].direction[2] = -1;
    }
    e.frames = frames;
    e.frame_per_ray = 1;
    e.gradients = gradients;
    e.levels = map;
    e.level_count = LEVELS;
    e.alpha = world->alpha[0];
    e.view_projection = projection;
    e.light[0] = -0.6f;
    e.light[1] = -0.35f;
    e.light[2] = 0.5f;
    e.light_radius = 0.06f;
    rows = ROWS_TIMED;
    for (int t = 0; t < TIMES; ++t)
        for (int c = 0; c < COUNT; ++c) {
            double start = seconds();
            e.flags = cases[c].flags;
            for (int k = 0; k < 20; ++k)
                if (conemap_shade(map, NULL, &e, e.flags ? rays : boxes, hits, shadings, WIDE) != CONEMAP_OK) return 1;
            times[0][c][t] = seconds() - start;
            on_gpu = 1;
            if (shade_rays(map, NULL, &e, rays, hits, shadings, WIDE) != CONEMAP_OK) return 1;
            times[1][c][t] = gpu_time;
        }
    printf("%-16s %8s %10s %10s\n", "", "SPIR-V", "CPU", "GPU");
    for (int c = 0; c < COUNT; ++c) {
        double ratios[2][TIMES];
        for (int g = 0; g < 2; ++g) {
            for (int t = 0; t < TIMES; ++t) ratios[g][t] = times[g][c][t] / times[g][0][t];
            qsort(ratios[g], TIMES, sizeof(double), upward);
        }
        printf("%-16s %8d %9.2fx %9.2fx\n", cases[c].name, spirv_count(folder, cases[c].flags), ratios[0][TIMES / 2],
               ratios[1][TIMES / 2]);
    }
    return 0;
}

int main(int argc, char **argv)
{
    static struct world world;
    static float picture[2][3 * TILE_W * TILE_H];
    static unsigned char sheets[2][3 * TILE_W * COLUMNS * TILE_H * ROWS];
    const char *folder = argc > 1 ? argv[1] : NULL;
    int pixels = 0, near_same = 0, off_edges = 0, bad = 0;
    if (!open_gpu()) {
        printf("no software GPU\n");
        return 77;
    }
    if (!make_world(&world)) return 1;
    if (argc > 2 && strcmp(argv[1], "cost") == 0) return cost(&world, argv[2]);
    for (int n = 0; n < TILES; ++n) {
        int same = 0, off = 0, worst = 0;
        double times[2];
        for (on_gpu = 0; on_gpu < 2; ++on_gpu) {
            double start = seconds();
            if (!render_tile(&world, &tiles[n], picture[on_gpu])) return 1;
            times[on_gpu] = seconds() - start;
            put_tile(sheets[on_gpu], n, picture[on_gpu]);
        }
        for (int y = 0; y < TILE_H; ++y)
            for (int x = 0; x < TILE_W; ++x) {
                const int line = n / COLUMNS * TILE_H + y, column = n % COLUMNS * TILE_W + x;
                int most = 0;
                for (int k = 0; k < 3; ++k) {
                    const int to = 3 * (line * TILE_W * COLUMNS + column) + k, d = abs(sheets[0][to] - sheets[1][to]);
                    if (d > most) most = d;
                }
                same += most <= 1;
                off += most > 1 && !beside_edge(sheets[0], line, column);
                if (most > worst) worst = most;
            }
        printf("%-44s %7.4f %% differ by more than 1/255, worst %3d, %d off the edges (%.1f s, %.1f s)\n",
               tiles[n].what,
               100 - 100.0 * same / (TILE_W * TILE_H), worst, off, times[0], times[1]);
        fflush(stdout);
        if (same < 0.999 * TILE_W * TILE_H || off) ++bad;
        pixels += TILE_W * TILE_H;
        near_same += same;
        off_edges += off;
    }
    if (folder)
        for (int k = 0; k < 2; ++k) {
            char path[300];
            snprintf(path, sizeof path, "%s/effects_%s.png", folder, k ? "gpu" : "cpu");
            png_write(path, sheets[k], TILE_W * COLUMNS, TILE_H * ROWS, 3);
        }
    printf("effects on a software GPU: %d pixels, %d differ by more than 1/255 from the CPU's, %d of them on no edge\n",
           pixels,
           pixels - near_same, off_edges);
    return bad != 0;
}
