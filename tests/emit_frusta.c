/* The emitted frusta: bad input, sizes, and the emitted C itself, run against the CPU's frusta. The environment's
   FRUSTA_RAYS asks for more than the quick number of rays. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

#define GOLDEN "tests/golden/"
enum { WIDTH = 64, HEIGHT = 48 };

/* ---- what the emitted C reads, and the C itself --------------------------------------------------------------- */

static struct {
    const conemap_skeleton *skeleton;
    const conemap_map *map;
} bound;

struct seen {
    int found, inside, frustum, user, cap;
    float t, position[3], uvw[3], map[2], normal[3], true_normal[3];
};

#define ROWS(p)                                                                                                   \
    p##_ivec4 p##_rows(int frustum, int row)                                                                      \
    {                                                                                                             \
        p##_ivec4 v = {0, 0, 0, 0};                                                                               \
        if (CHECK(frustum >= 0 && frustum < bound.skeleton->count && row >= 0 && row < 9, "row %d of %d", row,    \
                  frustum))                                                                                       \
            memcpy(&v, (const char *)&bound.skeleton->frusta[frustum] + 16 * row, 16);                            \
        return v;                                                                                                 \
    }
#define INSIDE(i, j) CHECK((i) >= 0 && (j) >= 0 && (i) < WIDTH && (j) < HEIGHT, "fetch %d %d", i, j)
#define FETCH_CONES(p)                                                                                            \
    p##_vec2 p##_fetch(int i, int j)                                                                              \
    {                                                                                                             \
        p##_vec2 v = {0.0f, 0.0f};                                                                                \
        if (!INSIDE(i, j)) return v;                                                                              \
        v.x = bound.map->heights[j * WIDTH + i];                                                                  \
        v.y = bound.map->cones[j * WIDTH + i];                                                                    \
        return v;                                                                                                 \
    }
#define FETCH_HEIGHTS(p)                                                                                          \
    float p##_fetch(int i, int j) { return INSIDE(i, j) ? bound.map->heights[j * WIDTH + i] : 0.0f; }
#define RUN(p)                                                                                                    \
    static struct seen p##_answer(p##_frustum_hit hit)                                                            \
    {                                                                                                             \
        struct seen s;                                                                                            \
        s.found = hit.found, s.inside = hit.inside, s.frustum = hit.frustum, s.user = hit.user, s.cap = hit.cap;  \
        s.t = hit.t;                                                                                              \
        memcpy(s.position, &hit.position, 12);                                                                    \
        memcpy(s.uvw, &hit.uvw, 12);                                                                              \
        memcpy(s.map, &hit.map, 8);                                                                               \
        memcpy(s.normal, &hit.normal, 12);                                                                        \
        memcpy(s.true_normal, &hit.true_normal, 12);                                                              \
        return s;                                                                                                 \
    }                                                                                                             \
    static struct seen p##_trace(const conemap_ray *ray)                                                          \
    {                                                                                                             \
        const p##_vec3 o = {ray->origin[0], ray->origin[1], ray->origin[2]};                                      \
        const p##_vec3 d = {ray->direction[0], ray->direction[1], ray->direction[2]};                             \
        return p##_answer(p##_trace_frusta(0, bound.skeleton->count, o, d, ray->t_min,                            \
                                           ray->t_max > 0.0f ? ray->t_max : 1e29f));                              \
    }                                                                                                             \
    static struct seen p##_see(int frustum, const float *place, const float *eye)                                 \
    {                                                                                                             \
        const p##_vec3 at = {place[0], place[1], place[2]};                                                       \
        const p##_vec4 e = {eye[0], eye[1], eye[2], eye[3]};                                                      \
        return p##_answer(p##_see_frustum(frustum, at, e));                                                       \
    }                                                                                                             \
    static void p##_corner_of(int frustum, int number, float *place)                                              \
    {                                                                                                             \
        const p##_vec3 at = p##_bounds(frustum, number);                                                          \
        memcpy(place, &at, 12);                                                                                   \
    }

#include "golden/frusta_plain_c.h"
#include "golden/frusta_cones_c.h"
#include "golden/frusta_steps_c.h"
#include "golden/frusta_linear_c.h"
#include "golden/frusta_any_c.h"

ROWS(fplain)
ROWS(fcones)
ROWS(fsteps)
ROWS(flinear)
ROWS(fany)
FETCH_CONES(fcones)
FETCH_HEIGHTS(fsteps)
FETCH_HEIGHTS(flinear)
FETCH_CONES(fany)
RUN(fplain)
RUN(fcones)
RUN(fsteps)
RUN(flinear)

static struct seen fany_trace(const conemap_ray *ray)
{
    const fany_vec3 o = {ray->origin[0], ray->origin[1], ray->origin[2]};
    const fany_vec3 d = {ray->direction[0], ray->direction[1], ray->direction[2]};
    struct seen s;
    memset(&s, 0, sizeof s);
    s.found =
        fany_any_frusta(0, bound.skeleton->count, o, d, ray->t_min, ray->t_max > 0.0f ? ray->t_max : 1e29f);
    return s;
}

static void fany_corner_of(int frustum, int number, float *place)
{
    const fany_vec3 at = fany_bounds(frustum, number);
    memcpy(place, &at, 12);
}

struct golden {
    const char *file, *prefix, *rows, *fetch;
    struct seen (*trace)(const conemap_ray *ray);
    struct seen (*see)(int frustum, const float *place, const float *eye);
    void (*corner)(int frustum, int number, float *place);
};

static const struct golden goldens[] = {
    {"frusta_plain_c.h", "fplain", "fplain_rows", NULL, fplain_trace, fplain_see, fplain_corner_of},
    {"frusta_cones_c.h", "fcones", "fcones_rows", "fcones_fetch", fcones_trace, fcones_see, fcones_corner_of},
    {"frusta_steps_c.h", "fsteps", "fsteps_rows", "fsteps_fetch", fsteps_trace, fsteps_see, fsteps_corner_of},
    {"frusta_linear_c.h", "flinear", "flinear_rows", "flinear_fetch", flinear_trace, flinear_see,
     flinear_corner_of},
    {"frusta_any_c.h", "fany", "fany_rows", "fany_fetch", fany_trace, NULL, fany_corner_of},
    {"frusta.vert", NULL, NULL, NULL, NULL, NULL, NULL},
    {"frusta.frag", NULL, NULL, NULL, NULL, NULL, NULL},
    {"frusta.hlsl", NULL, NULL, NULL, NULL, NULL, NULL},
};
enum { GOLDENS = sizeof goldens / sizeof goldens[0], PLAIN = 0, CONES, STEPS, LINEAR, ANY, VERTEX, FRAGMENT, HLSL };

static void golden_desc(int k, conemap_frusta_shader_desc *d)
{
    memset(d, 0, sizeof *d);
    d->relief = k != PLAIN;
    d->map.wrap_u = d->map.wrap_v = CONEMAP_WRAP;
    if (goldens[k].prefix) {
        d->dialect = CONEMAP_C99;
        d->prefix = goldens[k].prefix;
        d->fetch_frusta = goldens[k].rows;
        d->fetch = goldens[k].fetch;
        d->fixed_size = 1;
        d->map.width = WIDTH;
        d->map.height = HEIGHT;
    }
    if (k == PLAIN) d->height = 0.4f;
    if (k == CONES) d->blend = 0.7f;
    if (k == CONES) d->map.aspect = 0.75f;
    if (k == STEPS || k == LINEAR) d->march = CONEMAP_MARCH_STEPS;
    if (k == LINEAR) d->map.wrap_v = CONEMAP_CLAMP;
    if (k == LINEAR) d->linear_v = 1;
    if (k == LINEAR) d->steps = 100;
    if (k == ANY) d->any_hit = 1;
    if (k == VERTEX) d->stage = CONEMAP_FRUSTA_VERTEX;
    if (k == FRAGMENT) d->stage = CONEMAP_FRUSTA_FRAGMENT;
    if (k == HLSL) d->stage = CONEMAP_FRUSTA_FRAGMENT;
    if (k == HLSL) d->dialect = CONEMAP_HLSL_50;
    if (k == HLSL) d->shade = "shade";
    if (k == HLSL) d->blend = 0.5f;
}

/* The golden files hold what the emitter writes now, so what runs below is the emitter's text. */
static void golden_files(void)
{
    int k;
    for (k = 0; k < GOLDENS; ++k) {
        conemap_frusta_shader_desc desc;
        char path[64], *text, *file;
        size_t size = 0, length;
        FILE *stream;
        golden_desc(k, &desc);
        snprintf(path, sizeof path, GOLDEN "%s", goldens[k].file);
        if (!CHECK(conemap_emit_frusta(&desc, NULL, 0, &size) == CONEMAP_OK && size > 100, "%s: size", path)) continue;
        text = (char *)test_alloc(size);
        CHECK(conemap_emit_frusta(&desc, text, size, NULL) == CONEMAP_OK && strlen(text) + 1 == size, "%s: %d of %d",
              path, (int)strlen(text), (int)size);
        if (getenv("CONEMAP_SYNC")) {
            stream = fopen(path, "wb");
            if (CHECK(stream != NULL, "%s", path)) {
                fwrite(text, 1, size - 1, stream);
                fclose(stream);
            }
        }
        file = (char *)test_alloc(size + 1);
        stream = fopen(path, "rb");
        length = stream ? fread(file, 1, size, stream) : 0;
        if (stream) fclose(stream);
        CHECK(length == size - 1 && memcmp(file, text, size - 1) == 0, "%s: not what is emitted (make sync)", path);
        test_release(file);
        test_release(text);
    }
}

/* ---- skeletons and rays ---------------------------------------------------------------------------------------- */

enum { JOINTS = 24 };
struct plant {
    conemap_joint joints[JOINTS];
    conemap_segment segments[JOINTS];
    conemap_skeleton_desc desc;
    float size;
};

/* A chain with branches: cylinders, taper, points, long and thin, far from the origin, short and bent. */
static void make_plant(struct zoo_random *random, int kind, struct plant *plant)
{
    static const float bends[4] = {0.0f, 0.02f, 0.4f, 1.5f};
    const float length = kind == 3 ? 500.0f : kind == 5 ? 0.4f : 2.0f, radius = kind == 3 ? 0.05f : 0.5f;
    const int count = 1 + zoo_below(random, 10), trunk = 1 + count / 2;
    const float bend = bends[zoo_below(random, 4)];
    int i, k;
    memset(plant, 0, sizeof *plant);
    plant->size = length * (float)(count + 1);
    for (i = 0; i <= count; ++i) {
        conemap_joint *joint = &plant->joints[i];
        const int from = i <= trunk ? i - 1 : i == trunk + 1 ? trunk / 2 : i - 1;
        float d[3] = {0, 1, 0};
        joint->radius = kind == 0 ? radius : radius * zoo_between(random, 0.5f, 1.5f);
        if (kind == 1) joint->radius = radius * (1.0f - (float)i / (float)(count + 1));
        if (kind == 2 && (i == count || i == trunk)) joint->radius = 0.0f;
        joint->thickness = kind == 0 ? 0.3f * radius : 0.4f * joint->radius * zoo_unit(random);
        if (kind == 4 && zoo_below(random, 4) == 0) joint->thickness = 0.0f;
        for (k = 0; k < 3; ++k) {
            if (i == 0) joint->position[k] = kind == 4 ? 300.0f : zoo_between(random, -2.0f, 2.0f);
            d[k] += zoo_between(random, -bend, bend) + (i == trunk + 1 && k == 0 ? 1.0f : 0.0f);
        }
        if (i == 0) continue;
        for (k = 0; k < 3; ++k) joint->position[k] = plant->joints[from].position[k] + length * d[k];
        plant->segments[i - 1].base = from;
        plant->segments[i - 1].top = i;
        plant->segments[i - 1].parent = from - 1;
        plant->segments[i - 1].user = 7 * i;
        plant->segments[i - 1].u_repeat = 1 + zoo_below(random, 3);
        plant->segments[i - 1].twist = zoo_below(random, 3) ? 0.0f : zoo_between(random, -1.0f, 1.0f);
    }
    plant->desc.joints = plant->joints;
    plant->desc.joint_count = count + 1;
    plant->desc.segments = plant->segments;
    plant->desc.segment_count = count;
    plant->desc.v_per_length = zoo_below(random, 2) ? 1.0f / length : 0.0f;
    plant->desc.slope_normals = zoo_below(random, 2);
    plant->desc.c1_normals = zoo_below(random, 2);
}

/* Through two places of the shell, from some way before; along the axis, across a tip, tangent. */
static conemap_ray plant_ray(struct zoo_random *random, const struct plant *plant, const conemap_frustum *f)
{
    float from[3], to[3], a[3], b[3], length = 0.0f, before;
    const int kind = zoo_below(random, 8);
    conemap_ray ray;
    int k;
    memset(&ray, 0, sizeof ray);
    for (k = 0; k < 3; ++k) {
        from[k] = zoo_unit(random);
        to[k] = zoo_unit(random);
    }
    from[2] = kind == 0 ? 2.5f : from[2];
    if (kind == 1) from[0] = to[0], from[2] = to[2] = 0.0f; /* along a side */
    if (kind == 2) from[1] = to[1] = zoo_below(random, 2) ? 1.0f : 0.0f;
    if (conemap_frustum_point(f, from, a) != CONEMAP_OK || conemap_frustum_point(f, to, b) != CONEMAP_OK)
        for (k = 0; k < 3; ++k) a[k] = b[k] + zoo_between(random, -1.0f, 1.0f);
    for (k = 0; k < 3; ++k) {
        ray.direction[k] = kind == 3 ? f->axis_y[k] : b[k] - a[k];
        length += ray.direction[k] * ray.direction[k];
    }
    if (!(length > 1e-20f)) ray.direction[0] = length = 1.0f;
    length = sqrtf(length);
    /* From afar, but not at the long and thin: a float would not tell such a ray from those beside it. */
    before = kind == 4 ? 0.0f : kind == 5 && plant->size < 100.0f ? 300.0f * plant->size : 0.4f * plant->size;
    for (k = 0; k < 3; ++k) {
        ray.direction[k] /= length;
        ray.origin[k] = a[k] - ray.direction[k] * before;
    }
    return ray;
}

/* Elliptical sections: a row of another length, as conemap_frustum allows; longer ones stay inside the boxes. */
static void squash(conemap_skeleton *skeleton)
{
    int i, k;
    for (i = 0; i < skeleton->count; ++i)
        for (k = 0; k < 3; ++k) skeleton->build.frusta[i].axis_x[k] *= 1.4f;
}

static double way(const float *a, const float *b)
{
    double sum = 0;
    int k;
    for (k = 0; k < 3; ++k) sum += ((double)a[k] - (double)b[k]) * ((double)a[k] - (double)b[k]);
    return sqrt(sum);
}

/* What single precision can tell apart: of the frusta and their place in the world, and of the ray's start, but where
   rays begin at the bounds the eye's distance costs nothing. */
static double grain_of(const struct plant *plant, const conemap_ray *ray, int pixel)
{
    double reach = (double)plant->size;
    int k;
    for (k = 0; k < 3; ++k) {
        reach += 0.5 * fabs((double)plant->joints[0].position[k]);
        if (!pixel) reach += fabs((double)ray->origin[k] - (double)plant->joints[0].position[k]);
    }
    return 1e-6 * reach;
}

/* t of a place: the hit's own has as many bits as a float leaves at that distance. */
static double t_of(const conemap_ray *ray, const float *position)
{
    double sum = 0;
    int k;
    for (k = 0; k < 3; ++k)
        sum += ((double)position[k] - (double)ray->origin[k]) * (double)ray->direction[k];
    return sum;
}

static int same(const conemap_skeleton_trace_desc *trace, const conemap_ray *ray, const conemap_skeleton_hit *cpu,
                const struct seen *gpu, double grain)
{
    if ((cpu->status == CONEMAP_HIT) != gpu->found) return 0;
    return !gpu->found || trace->any_hit || fabs(t_of(ray, cpu->position) - t_of(ray, gpu->position)) <= grain;
}

/* The place of o + t v in a frustum's frame. */
static void local_point(const conemap_frustum *f, const float *o, float t, const float *v, float *out)
{
    const float *rows[3];
    int r, k;
    rows[0] = f->axis_x;
    rows[1] = f->axis_y;
    rows[2] = f->axis_z;
    for (r = 0; r < 3; ++r) {
        double sum = 0;
        for (k = 0; k < 3; ++k)
            sum += (double)rows[r][k] * ((double)o[k] + (double)t * (double)v[k] - (double)rows[k][3]);
        out[r] = (float)sum;
    }
}

/* Below 0 in the solid that a frustum's relief bounds, told from the public functions. */
static double outside(const conemap_frustum *f, const conemap_skeleton_trace_desc *trace, const float *world)
{
    float p[3], uvw[3];
    double height = (double)trace->height, above, thickness, plane, x, y, z;
    local_point(f, world, 0.0f, world, p);
    if (conemap_frustum_uvw(f, world, uvw) != CONEMAP_OK) return HUGE_VAL;
    thickness = (double)f->t + (double)f->tk * (double)p[1];
    if (trace->map && thickness > 0.0) {
        const float v = uvw[1] < 0.0f ? 0.0f : uvw[1] > 1.0f ? 1.0f : uvw[1];
        float map_v = f->v_start + v * f->v_size;
        conemap_sample sample;
        if (trace->map->info.wrap_v == CONEMAP_CLAMP) map_v = map_v < 0.0f ? 0.0f : map_v > 1.0f ? 1.0f : map_v;
        if (conemap_sample_at(trace->map, (uvw[0] + v * f->twist) * (float)f->u_repeat, map_v, &sample) !=
            CONEMAP_OK)
            return HUGE_VAL;
        height = (double)sample.height;
    }
    above = thickness > 0.0 ? ((double)uvw[2] - height) * thickness : (double)uvw[2];
    x = (double)p[0], y = (double)p[1], z = (double)p[2];
    plane = (double)f->lower[0] * x + (double)f->lower[1] * z + (double)f->lower[2] - y;
    if (plane > above) above = plane;
    plane = y - (double)f->upper[0] * x - (double)f->upper[1] * z - (double)f->upper[2];
    return plane > above ? plane : above;
}

static void nudge(const float *from, double by, int code, float *to)
{
    to[0] = from[0] + (float)(by * (code % 3 - 1));
    to[1] = from[1] + (float)(by * (code / 3 % 3 - 1));
    to[2] = from[2] + (float)(by * (code / 9 - 1));
}

/* Is the place on the surface, and not behind all that the CPU's rays meet which are a hair beside? Or misses one? */
static int on_edge(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *trace, const conemap_ray *ray,
                   const struct seen *gpu, double grain)
{
    int code, size;
    for (size = 1; size <= 4; size *= 4) {
        const double by = grain * (double)size;
        double first = HUGE_VAL, last = 0.0, away;
        int in = 0, out = 0;
        for (code = 0; code < 27; ++code) {
            conemap_ray beside = *ray;
            conemap_skeleton_hit hit;
            double t;
            nudge(ray->origin, by, code, beside.origin);
            conemap_skeleton_trace(skeleton, trace, &beside, &hit, 1);
            t = hit.status != CONEMAP_HIT ? HUGE_VAL : trace->any_hit ? 0.0 : t_of(ray, hit.position);
            if (t < first) first = t;
            if (t > last) last = t;
        }
        if (gpu->found ? trace->any_hit && first < HUGE_VAL : !(last < HUGE_VAL)) return 1;
        if (!gpu->found || trace->any_hit || t_of(ray, gpu->position) > last + by) continue;
        for (code = 0; code < 27; ++code) {
            float place[3];
            nudge(gpu->position, by, code, place);
            away = outside(&skeleton->frusta[gpu->frustum], trace, place);
            in |= away <= by;
            out |= away >= -by;
        }
        if (in && out) return 1;
    }
    return 0;
}

/* What a picture shows of all frusta: bounds drawn one after the other, the nearest hit kept. */
static struct seen look(const struct golden *g, const conemap_skeleton *skeleton, const conemap_ray *ray)
{
    const float eye[4] = {ray->origin[0], ray->origin[1], ray->origin[2], 1.0f};
    struct seen best;
    int i;
    memset(&best, 0, sizeof best);
    for (i = 0; i < skeleton->count; ++i) {
        const conemap_frustum *f = &skeleton->frusta[i];
        struct seen seen;
        float span[2], place[3];
        if (conemap_frustum_span(f, 1.0f, ray, span) != CONEMAP_OK || span[0] > span[1]) continue;
        local_point(f, ray->origin, span[1], ray->direction, place);
        seen = g->see(i, place, eye);
        if (seen.found && (!best.found || seen.t < best.t)) best = seen;
    }
    return best;
}

static int ray_count(int quick)
{
    const char *text = getenv("FRUSTA_RAYS");
    const long wanted = text ? strtol(text, NULL, 10) : 0;
    return wanted > 0 && wanted < 1000000000 ? (int)wanted : quick;
}

struct counts {
    int rays, hits, different, unexplained, places, turned; /* normals that point elsewhere */
};

static void compare(const struct golden *g, const struct plant *plant, const conemap_skeleton *skeleton,
                    const conemap_skeleton_trace_desc *trace, const conemap_ray *ray, int pixel, struct counts *counts)
{
    const double grain = grain_of(plant, ray, pixel);
    conemap_skeleton_hit cpu;
    struct seen gpu = pixel ? look(g, skeleton, ray) : g->trace(ray);
    conemap_skeleton_trace(skeleton, trace, ray, &cpu, 1);
    ++counts->rays;
    counts->hits += gpu.found;
    if (!same(trace, ray, &cpu, &gpu, grain)) {
        ++counts->different;
        counts->unexplained += !on_edge(skeleton, trace, ray, &gpu, grain);
        return;
    }
    if (!gpu.found || trace->any_hit || cpu.segment != gpu.frustum || cpu.cap != gpu.cap) return;
    CHECK(gpu.user == skeleton->frusta[gpu.frustum].user, "user");
    CHECK(way(gpu.position, cpu.position) <= 4.0 * grain, "%s: %g apart", g->file, way(gpu.position, cpu.position));
    ++counts->places;
    counts->turned += way(gpu.normal, cpu.normal) > 0.01 || way(gpu.true_normal, cpu.true_normal) > 0.01 ||
                      fabs((double)gpu.uvw[1] - (double)cpu.v) > 0.001 ||
                      fabs((double)gpu.map[1] - (double)cpu.map_v) > 0.003;
}

static void relief_map(int kind, uint32_t seed, const struct golden *g, conemap_map *map)
{
    static float heights[WIDTH * HEIGHT];
    conemap_frusta_shader_desc shader;
    conemap_desc desc;
    golden_desc((int)(g - goldens), &shader);
    zoo_fill(kind, WIDTH, HEIGHT, seed, heights);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = WIDTH;
    desc.heights.height = HEIGHT;
    desc.wrap_u = shader.map.wrap_u;
    desc.wrap_v = shader.map.wrap_v;
    desc.aspect = shader.map.aspect;
    CHECK(conemap_build(&desc, map) == CONEMAP_OK, "map");
}

static void runs_as_c(void)
{
    const int rays = ray_count(6000), rays_each = 25;
    struct counts all;
    int g, round, n;
    memset(&all, 0, sizeof all);
    for (g = PLAIN; g <= ANY; ++g) {
        struct zoo_random random = zoo_seed(900 + (uint32_t)g);
        conemap_frusta_shader_desc shader;
        struct counts counts;
        golden_desc(g, &shader);
        memset(&counts, 0, sizeof counts);
        for (round = 0; round < rays / rays_each; ++round) {
            conemap_skeleton_trace_desc trace;
            conemap_skeleton skeleton;
            struct plant plant;
            static conemap_map maps[ZOO_KINDS];
            const int kind = round % ZOO_KINDS;
            make_plant(&random, round % 6, &plant);
            plant.desc.blend = shader.blend;
            if (!CHECK(conemap_skeleton_build(&plant.desc, &skeleton) == CONEMAP_OK, "skeleton")) return;
            if (round % 5 == 4) squash(&skeleton);
            if (shader.relief && !maps[kind].heights) relief_map(kind, 5, &goldens[g], &maps[kind]);
            memset(&trace, 0, sizeof trace);
            trace.map = shader.relief ? &maps[kind] : NULL;
            trace.height = shader.height;
            trace.march = shader.march;
            trace.steps = shader.steps;
            trace.linear_v = shader.linear_v;
            trace.any_hit = shader.any_hit;
            bound.skeleton = &skeleton;
            bound.map = trace.map;
            for (n = 0; n < rays_each; ++n) {
                const conemap_frustum *f = &skeleton.frusta[zoo_below(&random, skeleton.count)];
                const conemap_ray ray = plant_ray(&random, &plant, f);
                compare(&goldens[g], &plant, &skeleton, &trace, &ray, goldens[g].see && (n & 1), &counts);
            }
            conemap_skeleton_free(&skeleton);
            if (round + ZOO_KINDS >= rays / rays_each) conemap_free(&maps[kind]);
        }
        all.rays += counts.rays;
        all.hits += counts.hits;
        all.different += counts.different;
        all.unexplained += counts.unexplained;
        CHECK(counts.hits > counts.rays / 4, "%s: %d hits of %d", goldens[g].file, counts.hits, counts.rays);
        /* Steps can pass over what is thin, on either side; linear v depends on where the shell is entered and left. */
        CHECK(counts.unexplained <= (g == PLAIN ? counts.rays / 100000 : 2 + counts.rays / (g == LINEAR ? 250 : 1000)),
              "%s: %d of %d rays differ, not on an edge", goldens[g].file, counts.unexplained, counts.rays);
        /* Slopes jump between bilinear cells. */
        CHECK(counts.turned * 100 <= counts.places, "%s: %d of %d normals or coordinates are others", goldens[g].file,
              counts.turned, counts.places);
    }
    test_note("%d rays in emitted C, %d hits, %d on edges, %d others", all.rays, all.hits,
              all.different - all.unexplained, all.unexplained);
}

/* The bounds are conemap_frustum_corners in the order of conemap_frustum_triangles. */
static void bounds(void)
{
    const unsigned char *triangles = conemap_frustum_triangles();
    struct zoo_random random = zoo_seed(77);
    int round, i, n;
    for (round = 0; round < 60; ++round) {
        struct plant plant;
        conemap_skeleton skeleton;
        make_plant(&random, round % 6, &plant);
        REQUIRE(conemap_skeleton_build(&plant.desc, &skeleton) == CONEMAP_OK, "skeleton");
        if (round % 5 == 4) squash(&skeleton);
        bound.skeleton = &skeleton;
        for (i = 0; i < skeleton.count; ++i) {
            float corners[8][3], place[3], right[3];
            conemap_frustum_corners(&skeleton.frusta[i], corners);
            for (n = 0; n < 36; ++n) {
                goldens[round % 5].corner(i, n, place);
                local_point(&skeleton.frusta[i], corners[triangles[n]], 0.0f, place, right);
                CHECK(way(place, right) <= 3e-6 * (double)plant.size + 1e-6 * (double)fabsf(corners[0][0]),
                      "frustum %d, vertex %d: %g away", i, n, way(place, right));
            }
        }
        conemap_skeleton_free(&skeleton);
    }
}

/* Cone steps rest on a bound of how fast the map's place changes: never slower than it is seen to. */
static void speed_bound(void)
{
    struct zoo_random random = zoo_seed(31);
    int round, n, tight = 0, all = 0;
    for (round = 0; round < 400; ++round) {
        struct plant plant;
        conemap_skeleton skeleton;
        make_plant(&random, round % 6 == 3 ? 0 : round % 6, &plant); /* thin ones leave no bits for differences */
        REQUIRE(conemap_skeleton_build(&plant.desc, &skeleton) == CONEMAP_OK, "skeleton");
        bound.skeleton = &skeleton;
        for (n = 0; n < 20; ++n) {
            const int segment = zoo_below(&random, skeleton.count);
            const fcones_frustum f = fcones_load(segment);
            const conemap_ray ray = plant_ray(&random, &plant, &skeleton.frusta[segment]);
            float span[2], from[3], a, b;
            fcones_vec3 o, v;
            fcones_vec2 first, second;
            fcones_uvw at;
            double moved_u, moved_v, speed;
            if (conemap_frustum_span(&skeleton.frusta[segment], 1.0f, &ray, span) != CONEMAP_OK || span[0] >= span[1])
                continue;
            local_point(&skeleton.frusta[segment], ray.origin, span[0], ray.direction, from);
            o.x = from[0], o.y = from[1], o.z = from[2];
            v = fcones_make_vec3(ray.direction[0], ray.direction[1], ray.direction[2]);
            v = fcones_into(f, v);
            a = zoo_unit(&random) * (span[1] - span[0]);
            b = a + 0.01f * (span[1] - span[0]);
            at = fcones_locate(f, fcones_along(o, v, a));
            if (!(at.w >= 0.0f && at.w <= 1.0f && at.v >= 0.0f && at.v <= 1.0f)) continue;
            first = fcones_map_place(f, at.u, at.v);
            at = fcones_locate(f, fcones_along(o, v, b));
            if (!(at.w >= 0.0f && at.w <= 1.0f && at.v >= 0.0f && at.v <= 1.0f)) continue;
            second = fcones_map_place(f, at.u, at.v);
            moved_u = (double)second.x - (double)first.x;
            moved_u -= (double)f.more.y * floor(moved_u / (double)f.more.y + 0.5);
            moved_v = 0.75 * ((double)second.y - (double)first.y); /* the aspect of that golden file */
            speed = (double)fcones_map_speed(f, fcones_bound_speed(f, o, v), o, v, a, b);
            CHECK(sqrt(moved_u * moved_u + moved_v * moved_v) <= 1.001 * speed * (double)(b - a) + 2e-5,
                  "moved %g, %g in %g at no more than %g", moved_u, moved_v, (double)(b - a), speed);
            ++all;
            tight += sqrt(moved_u * moved_u + moved_v * moved_v) > 0.8 * speed * (double)(b - a);
        }
        conemap_skeleton_free(&skeleton);
    }
    CHECK(all > 1000 && tight * 50 > all, "%d of %d near the bound", tight, all);
}

static void bad_input(void)
{
    static const struct {
        const char *what;
        conemap_result result;
    } cases[] = {
        {"dialect", CONEMAP_ERROR_ENUM},
        {"stage", CONEMAP_ERROR_ENUM},
        {"source", CONEMAP_ERROR_ENUM},
        {"march", CONEMAP_ERROR_ENUM},
        {"filter", CONEMAP_ERROR_ENUM},
        {"height", CONEMAP_ERROR_PARAMETER},
        {"blend", CONEMAP_ERROR_PARAMETER},
        {"steps", CONEMAP_ERROR_PARAMETER},
        {"refine_steps", CONEMAP_ERROR_PARAMETER},
        {"uniform_count", CONEMAP_ERROR_PARAMETER},
        {"NaN", CONEMAP_ERROR_PARAMETER},
        {"a name that is none", CONEMAP_ERROR_PARAMETER},
        {"a name twice", CONEMAP_ERROR_PARAMETER},
        {"a name of the text", CONEMAP_ERROR_PARAMETER},
        {"shade is no name", CONEMAP_ERROR_PARAMETER},
        {"size", CONEMAP_ERROR_SIZE},
        {"clamped in u", CONEMAP_ERROR_UNSUPPORTED},
        {"nothing in v", CONEMAP_ERROR_UNSUPPORTED},
        {"relaxed cones", CONEMAP_ERROR_UNSUPPORTED},
        {"linear cones", CONEMAP_ERROR_UNSUPPORTED},
        {"C without fetch", CONEMAP_ERROR_UNSUPPORTED},
        {"a storage buffer in GLSL 330", CONEMAP_ERROR_UNSUPPORTED},
        {"a texel buffer in ES", CONEMAP_ERROR_UNSUPPORTED},
        {"a texture in HLSL", CONEMAP_ERROR_UNSUPPORTED},
        {"any hit in a fragment shader", CONEMAP_ERROR_UNSUPPORTED},
        {"shade in functions", CONEMAP_ERROR_UNSUPPORTED},
        {"a fetch without size", CONEMAP_ERROR_UNSUPPORTED},
        {"sectors", CONEMAP_ERROR_UNSUPPORTED},
        {"shade is a word of the text", CONEMAP_ERROR_PARAMETER},
        {"gathered cells", CONEMAP_ERROR_UNSUPPORTED},
    };
    static char text[65536];
    conemap_frusta_shader_desc good, desc;
    size_t size = 1;
    int k;
    memset(&good, 0, sizeof good);
    good.relief = 1;
    good.map.wrap_u = CONEMAP_WRAP;
    for (k = 0; k < (int)(sizeof cases / sizeof cases[0]); ++k) {
        desc = good;
        size = 1;
        switch (k) {
        case 0: desc.dialect = CONEMAP_DIALECT_COUNT; break;
        case 1: desc.stage = (conemap_frusta_stage)-1; break;
        case 2: desc.source = CONEMAP_FRUSTA_SOURCE_COUNT; break;
        case 3: desc.march = CONEMAP_MARCH_COUNT; break;
        case 4: desc.filter = CONEMAP_FILTER_COUNT; break;
        case 5: desc.height = 1.5f; break;
        case 6: desc.blend = -1.0f; break;
        case 7: desc.steps = -1; break;
        case 8: desc.refine_steps = 65; break;
        case 9: desc.uniform_count = 456; break;
        case 10: desc.blend = (float)NAN; break;
        case 11: desc.frusta_name = "9frusta"; break;
        case 12: desc.frusta_name = desc.map_name = "name"; break;
        case 13: desc.frusta_name = "float"; break;
        case 14:
            desc.stage = CONEMAP_FRUSTA_FRAGMENT;
            desc.shade = "";
            break;
        case 15: desc.fixed_size = 1; break;
        case 16: desc.map.wrap_u = CONEMAP_CLAMP; break;
        case 17: desc.map.wrap_v = CONEMAP_NOTHING; break;
        case 18:
            desc.map.guarantee = CONEMAP_GUARANTEE_RELAXED;
            desc.march = CONEMAP_MARCH_CONES;
            break;
        case 19:
            desc.linear_v = 1;
            desc.march = CONEMAP_MARCH_CONES;
            break;
        case 20: desc.dialect = CONEMAP_C99; break;
        case 21: desc.source = CONEMAP_FRUSTA_BUFFER; break;
        case 22:
            desc.dialect = CONEMAP_ESSL_310;
            desc.source = CONEMAP_FRUSTA_TEXELS;
            break;
        case 23:
            desc.dialect = CONEMAP_HLSL_50;
            desc.source = CONEMAP_FRUSTA_TEXTURE;
            break;
        case 24:
            desc.stage = CONEMAP_FRUSTA_FRAGMENT;
            desc.any_hit = 1;
            break;
        case 25: desc.shade = "shade"; break;
        case 26: desc.fetch = "fetch"; break;
        case 27: desc.map.texture.sectors = 4; break;
        case 28:
            desc.stage = CONEMAP_FRUSTA_FRAGMENT;
            desc.shade = "inner";
            break;
        default:
            desc.dialect = CONEMAP_GLSL_430;
            desc.filter = CONEMAP_FILTER_GATHER;
            desc.map.texture.per_cell = 1;
            break;
        }
        CHECK(conemap_emit_frusta(&desc, text, sizeof text, &size) == cases[k].result && size == 1 && !text[0],
              "%s: %s", cases[k].what, conemap_result_string(conemap_emit_frusta(&desc, NULL, 0, &size)));
    }
    for (k = CONEMAP_WGSL; k <= CONEMAP_MSL; ++k) {
        desc = good;
        desc.dialect = (conemap_dialect)k;
        CHECK(conemap_emit_frusta(&desc, NULL, 0, &size) == CONEMAP_OK, "dialect %d", k);
        desc.source = CONEMAP_FRUSTA_TEXELS;
        CHECK(conemap_emit_frusta(&desc, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED, "texels in dialect %d", k);
    }
    CHECK(conemap_emit_frusta(NULL, text, sizeof text, &size) == CONEMAP_ERROR_NULL, "desc");
    CHECK(conemap_emit_frusta(&good, NULL, 0, NULL) == CONEMAP_ERROR_NULL, "both");
    REQUIRE(conemap_emit_frusta(&good, NULL, 0, &size) == CONEMAP_OK, "size");
    {
        char *exact = (char *)test_alloc(size);
        exact[0] = 'x';
        CHECK(conemap_emit_frusta(&good, exact, size - 1, NULL) == CONEMAP_ERROR_BUFFER && exact[0] == 'x', "small");
        CHECK(conemap_emit_frusta(&good, exact, size, NULL) == CONEMAP_OK && strlen(exact) + 1 == size, "exact");
        test_release(exact);
    }
    memset(&desc, 0, sizeof desc); /* a zeroed desc is a shader for plain frusta */
    CHECK(conemap_emit_frusta(&desc, text, sizeof text, NULL) == CONEMAP_OK && strstr(text, "conemap_trace_frusta(") &&
              !strstr(text, "sampler2D") && !strstr(text, "conemap_march"),
          "zeroed");
}

const struct test_case emit_frusta_tests[] = {
    {"golden", golden_files},     {"bounds", bounds},       {"runs as C", runs_as_c},
    {"speed bound", speed_bound}, {"bad input", bad_input}, {NULL, NULL},
};
