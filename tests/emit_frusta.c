/* The emitted frusta: bad input, sizes, and the emitted C itself, run against the CPU's frusta. The environment's
   FRUSTA_RAYS asks for more than the quick number of rays. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "golden.h"
#include "test.h"
#include "zoo.h"

enum { WIDTH = 64, HEIGHT = 48 };

/* Between them two of the texts have every effect. */
enum {
    EFFECTS_HERE = CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_SMOOTH_NORMAL |
                   CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_UV |
                   CONEMAP_EFFECT_HOLES,
    LINEAR_HERE = CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY,
    REFUSED = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_CURVED
};

#ifndef TEST_WRITE
/* ---- what the emitted C reads, and the C itself --------------------------------------------------------------- */

static struct {
    const conemap_skeleton *skeleton;
    const conemap_map *map;
    conemap_effects effects;
    float pixel;
} bound;

struct seen {
    int found, inside, frustum, user, cap;
    float t, position[3], uvw[3], map[2], normal[3], true_normal[3];
    float depth, shadow, occlusion, gradient[4], level, fade;
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
#define COMMA ,
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
#define ANSWER(p, more)                                                                                           \
    static struct seen p##_answer(p##_frustum_hit hit)                                                            \
    {                                                                                                             \
        struct seen s;                                                                                            \
        memset(&s, 0, sizeof s);                                                                                  \
        s.found = hit.found, s.inside = hit.inside, s.frustum = hit.frustum, s.user = hit.user, s.cap = hit.cap;  \
        s.t = hit.t;                                                                                              \
        memcpy(s.position, &hit.position, 12);                                                                    \
        memcpy(s.uvw, &hit.uvw, 12);                                                                              \
        memcpy(s.normal, &hit.normal, 12);                                                                        \
        more return s;                                                                                            \
    }
/* effects: what is handed over as effects, and a comma */
#define RUN(p, effects)                                                                                           \
    static struct seen p##_trace(const conemap_ray *ray)                                                          \
    {                                                                                                             \
        const p##_vec3 o = {ray->origin[0], ray->origin[1], ray->origin[2]};                                      \
        const p##_vec3 d = {ray->direction[0], ray->direction[1], ray->direction[2]};                             \
        return p##_answer(p##_trace_frusta(effects 0, bound.skeleton->count, o, d, ray->t_min,                    \
                                           ray->t_max > 0.0f ? ray->t_max : 1e29f));                              \
    }                                                                                                             \
    static struct seen p##_see(int frustum, const float *place, const float *eye)                                 \
    {                                                                                                             \
        const p##_vec3 at = {place[0], place[1], place[2]};                                                       \
        const p##_vec4 e = {eye[0], eye[1], eye[2], eye[3]};                                                      \
        return p##_answer(p##_see_frustum(effects frustum, at, e));                                               \
    }                                                                                                             \
    static void p##_corner_of(int frustum, int number, float *place)                                              \
    {                                                                                                             \
        const p##_vec3 at = p##_bounds(frustum, number);                                                          \
        memcpy(place, &at, 12);                                                                                   \
    }

#include "build/written/frusta_plain_c.h"
#include "build/written/frusta_effects_c.h"
#include "build/written/frusta_linear_c.h"

static feffects_vec4 row_of(int k)
{
    const float *m = bound.effects.view_projection;
    return feffects_make_vec4(m[k], m[4 + k], m[8 + k], m[12 + k]);
}

static feffects_frusta_effects given(void)
{
    const conemap_effects *e = &bound.effects;
    feffects_frusta_effects f;
    f.clip_z = row_of(2);
    f.clip_w = row_of(3);
    f.light = feffects_make_vec4(e->light[0], e->light[1], e->light[2], e->light_is_point ? 1.0f : 0.0f);
    f.first = 0;
    f.count = bound.skeleton->count;
    f.alpha_cut = ((float)e->alpha_cut - 0.5f) / 255.0f;
    f.pixel = bound.pixel;
    f.fade_begin = e->fade_begin;
    f.fade_end = e->fade_end;
    return f;
}

static flinear_frusta_effects given_linear(void)
{
    const conemap_effects *e = &bound.effects;
    const flinear_vec4 light = {e->light[0], e->light[1], e->light[2], e->light_is_point ? 1.0f : 0.0f};
    flinear_frusta_effects f;
    f.light = light;
    f.first = 0;
    f.count = bound.skeleton->count;
    f.light_radius = e->light_radius;
    f.sky_reach = e->sky_reach;
    f.sky_directions = e->sky_directions;
    f.pixel = bound.pixel;
    f.lod_bias = e->lod_bias;
    f.lod_steps = e->lod_steps;
    return f;
}

float feffects_alpha(int i, int j)
{
    return INSIDE(i, j) ? (float)bound.effects.alpha[j * WIDTH + i] / 255.0f : 0.0f;
}

ROWS(fplain)
ROWS(feffects)
ROWS(flinear)
FETCH_CONES(feffects)
FETCH_HEIGHTS(flinear)
ANSWER(fplain, memcpy(s.map, &hit.map, 8); memcpy(s.true_normal, &hit.true_normal, 12);)
ANSWER(feffects, memcpy(s.map, &hit.map, 8); s.depth = hit.depth; s.shadow = hit.shadow; s.occlusion = hit.occlusion;
       memcpy(s.gradient, &hit.gradient, 16); s.fade = hit.fade;)
ANSWER(flinear, s.shadow = hit.shadow; s.occlusion = hit.occlusion; s.level = hit.level;)
RUN(fplain, )
RUN(feffects, given() COMMA)
RUN(flinear, given_linear() COMMA)

/* What the shadows of the effects ask, asked by itself. */
static struct seen fany_trace(const conemap_ray *ray)
{
    const feffects_vec3 o = {ray->origin[0], ray->origin[1], ray->origin[2]};
    const feffects_vec3 d = {ray->direction[0], ray->direction[1], ray->direction[2]};
    const feffects_detail all = {0.0f};
    struct seen s;
    memset(&s, 0, sizeof s);
    s.found =
        feffects_any_frusta(0, bound.skeleton->count, o, d, ray->t_min, ray->t_max > 0.0f ? ray->t_max : 1e29f, all, 0.0f);
    return s;
}
#define RUNS(p) p##_trace, p##_see, p##_corner_of
#else
#define RUNS(p) NULL, NULL, NULL
#endif

struct golden {
    const char *file, *prefix, *rows, *fetch;
    struct seen (*trace)(const conemap_ray *ray);
    struct seen (*see)(int frustum, const float *place, const float *eye);
    void (*corner)(int frustum, int number, float *place);
};

static const struct golden goldens[] = {
    {"frusta_plain_c.h", "fplain", "fplain_rows", NULL, RUNS(fplain)},
    {"frusta_effects_c.h", "feffects", "feffects_rows", "feffects_fetch", RUNS(feffects)},
    {"frusta_linear_c.h", "flinear", "flinear_rows", "flinear_fetch", RUNS(flinear)},
    {"frusta.vert", NULL, NULL, NULL, NULL, NULL, NULL},
    {"frusta.frag", NULL, NULL, NULL, NULL, NULL, NULL},
    {"frusta.hlsl", NULL, NULL, NULL, NULL, NULL, NULL},
#ifndef TEST_WRITE
    {"any hit", "feffects", NULL, NULL, fany_trace, NULL, feffects_corner_of}, /* of the second, no file of its own */
#endif
};
enum { PLAIN, EFFECTS, LINEAR, VERTEX, FRAGMENT, HLSL, ANY, GOLDENS = ANY };

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
    if (k == EFFECTS || k == ANY) d->flags = EFFECTS_HERE;
    if (k == EFFECTS || k == ANY) d->blend = 0.7f;
    if (k == EFFECTS || k == ANY) d->map.aspect = 0.75f;
    if (k == LINEAR) d->flags = LINEAR_HERE;
    if (k == LINEAR) d->march = CONEMAP_MARCH_STEPS;
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

static void golden_files(void)
{
    int k;
    for (k = 0; k < GOLDENS; ++k) {
        conemap_frusta_shader_desc desc;
        char *text;
        size_t size = 0;
        golden_desc(k, &desc);
        if (!CHECK(conemap_emit_frusta(&desc, NULL, 0, &size) == CONEMAP_OK && size > 100, "%s: size", goldens[k].file))
            continue;
        text = (char *)test_alloc(size);
        if (CHECK(conemap_emit_frusta(&desc, text, size, NULL) == CONEMAP_OK && strlen(text) + 1 == size, "%s: %d of %d",
                  goldens[k].file, (int)strlen(text), (int)size))
            golden_text(goldens[k].file, text);
        test_release(text);
    }
}

#ifndef TEST_WRITE
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
    plant->desc.exact_u = zoo_below(random, 2);
    plant->desc.fit = zoo_below(random, 2);
    plant->desc.round_joins = zoo_below(random, 4) ? 0 : 2 + zoo_below(random, 4);
    if (zoo_below(random, 4)) return;
    for (i = 0; i < count; ++i) { /* elliptical, and then without twist */
        plant->segments[i].flat = zoo_between(random, 0.3f, 1.0f);
        for (k = 0; k < 3; ++k) plant->segments[i].wide[k] = zoo_between(random, -1.0f, 1.0f);
        plant->segments[i].twist = 0.0f;
    }
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
static double outside(const conemap_frustum *f, const conemap_skeleton_trace_desc *trace, float fade, const float *world)
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
        height += (1.0 - (double)fade) * ((double)sample.height - height);
    }
    above = thickness > 0.0 ? ((double)uvw[2] - height) * thickness : (double)uvw[2];
    if (bound.effects.flags & CONEMAP_EFFECT_HOLES) { /* a hollow wall */
        const float v = uvw[1] < 0.0f ? 0.0f : uvw[1] > 1.0f ? 1.0f : uvw[1];
        const float map_u = (uvw[0] + v * f->twist) * (float)f->u_repeat, map_v = f->v_start + v * f->v_size;
        const int i = (int)((map_u - floorf(map_u)) * (float)WIDTH), j = (int)((map_v - floorf(map_v)) * (float)HEIGHT);
        const double core = -(double)uvw[2] * (thickness > 0.0 ? thickness : 1.0);
        if (core > above) above = core;
        if (bound.effects.alpha[j % HEIGHT * WIDTH + i % WIDTH] < bound.effects.alpha_cut) return HUGE_VAL;
    }
    x = (double)p[0], y = (double)p[1], z = (double)p[2];
    plane = (double)f->lower[0] * x + (double)f->lower[1] * z + (double)f->lower[2] - y;
    if (plane > above) above = plane;
    plane = y - (double)f->upper[0] * x - (double)f->upper[1] * z - (double)f->upper[2];
    return plane > above ? plane : above;
}

/* The CPU's ray, with the relief that is seen from there. */
static void follow(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *trace, const conemap_ray *ray,
                   conemap_skeleton_hit *hit)
{
    conemap_effects far_away = bound.effects;
    conemap_shading shading;
    far_away.flags &= CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_HOLES;
    CHECK(conemap_skeleton_shade(skeleton, trace, &far_away, bound.pixel, ray, hit, &shading, 1) == CONEMAP_OK, "shade");
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
            follow(skeleton, trace, &beside, &hit);
            t = hit.status != CONEMAP_HIT ? HUGE_VAL : trace->any_hit ? 0.0 : t_of(ray, hit.position);
            if (t < first) first = t;
            if (t > last) last = t;
        }
        if (gpu->found ? trace->any_hit && first < HUGE_VAL : !(last < HUGE_VAL)) return 1;
        if (!gpu->found || trace->any_hit || t_of(ray, gpu->position) > last + by) continue;
        for (code = 0; code < 27; ++code) {
            float place[3];
            nudge(gpu->position, by, code, place);
            away = outside(&skeleton->frusta[gpu->frustum], trace, gpu->fade, place);
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
    int exact; /* of the places, those with exact_u */
    int corners; /* rays that end elsewhere among holes */
    int shadows, occlusions, gradients, numbers, dark, faded; /* others than the CPU's; how many there are of some */
};

/* Effects of a hit of the same place, against the CPU's. */
static void compare_effects(unsigned flags, const conemap_shading *cpu, const struct seen *gpu, struct counts *counts)
{
    const float own[4] = {cpu->gradient.dudx, cpu->gradient.dvdx, cpu->gradient.dudy, cpu->gradient.dvdy};
    double longest = 1e-9, apart = 0.0;
    int k;
    if (flags & (CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW)) {
        counts->shadows += fabsf(cpu->shadow - gpu->shadow) > 0.01f;
        counts->dark += cpu->shadow < 0.5f;
    }
    if (flags & (CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY))
        counts->occlusions += fabsf(cpu->occlusion - gpu->occlusion) > 0.01f;
    for (k = 0; k < 4; ++k) {
        longest = fmax(longest, fabs((double)own[k]));
        apart = fmax(apart, fabs((double)own[k] - (double)gpu->gradient[k]));
    }
    counts->gradients += (flags & CONEMAP_EFFECT_UV) && apart > 0.01 * longest;
    counts->numbers += (flags & CONEMAP_EFFECT_FADE) && fabsf(cpu->fade - gpu->fade) > 0.001f;
    counts->numbers += (flags & CONEMAP_EFFECT_LOD) && fabsf(cpu->level - gpu->level) > 0.001f;
    counts->numbers += (flags & CONEMAP_EFFECT_DEPTH) &&
                       fabs((double)cpu->depth - (double)gpu->depth) > 1e-4 * fmax(1.0, fabs((double)cpu->depth));
    counts->faded += (flags & CONEMAP_EFFECT_FADE) && cpu->fade > 0.0f && cpu->fade < 1.0f;
}

static double turns_apart(float a, float b)
{
    const double apart = (double)a - (double)b;
    return fabs(apart - floor(apart + 0.5));
}

static void compare(const struct golden *g, const struct plant *plant, const conemap_skeleton *skeleton,
                    const conemap_skeleton_trace_desc *trace, const conemap_ray *ray, int pixel, struct counts *counts)
{
    const double grain = grain_of(plant, ray, pixel);
    const float *normal;
    int turned;
    conemap_skeleton_hit cpu;
    conemap_shading shading;
    struct seen gpu = pixel ? look(g, skeleton, ray) : g->trace(ray);
    memset(&shading, 0, sizeof shading);
    CHECK(conemap_skeleton_shade(skeleton, trace, &bound.effects, bound.pixel, ray, &cpu, &shading, 1) == CONEMAP_OK,
          "shade");
    normal = bound.effects.flags ? shading.normal : cpu.normal;
    ++counts->rays;
    counts->hits += gpu.found;
    if (!same(trace, ray, &cpu, &gpu, grain)) {
        ++counts->different;
        if (!on_edge(skeleton, trace, ray, &gpu, grain)) {
            const int holes = (bound.effects.flags & CONEMAP_EFFECT_HOLES) && bound.effects.alpha_cut > 1;
            counts->corners += holes;
            counts->unexplained += !holes;
        }
        return;
    }
    if (!gpu.found || trace->any_hit || cpu.segment != gpu.frustum || cpu.cap != gpu.cap) return;
    CHECK(gpu.user == skeleton->frusta[gpu.frustum].user, "user");
    CHECK(way(gpu.position, cpu.position) <= 4.0 * grain, "%s: %g apart", g->file, way(gpu.position, cpu.position));
    ++counts->places;
    counts->exact += (skeleton->frusta[gpu.frustum].flags & CONEMAP_FRUSTUM_EXACT_U) != 0;
    turned = way(gpu.normal, normal) > 0.01 || fabs((double)gpu.uvw[1] - (double)cpu.v) > 0.001;
    turned |= turns_apart(gpu.uvw[0], cpu.u) > 0.001;
    if (!bound.effects.flags) turned |= way(gpu.true_normal, cpu.true_normal) > 0.01;
    if (!bound.effects.flags || (bound.effects.flags & CONEMAP_EFFECT_UV))
        turned |= fabs((double)gpu.map[1] - (double)cpu.map_v) > 0.003 || turns_apart(gpu.map[0], cpu.map_u) > 0.003;
    counts->turned += turned;
    compare_effects(bound.effects.flags, &shading, &gpu, counts);
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

/* Numbers for effects: a light in or around the plant, pixels from none to so wide that the relief is gone. */
static void set_effects(struct zoo_random *random, const struct plant *plant, unsigned flags)
{
    static const float projection[16] = {0.7f, 0.1f, 0.3f, 0.2f, 0.0f, 1.2f, 0.1f, -0.1f,
                                         0.4f, 0.0f, 0.9f, 0.5f, 0.3f, 0.2f, 1.5f, 2500.0f};
    static unsigned char alpha[WIDTH * HEIGHT];
    conemap_effects *e = &bound.effects;
    int k;
    memset(e, 0, sizeof *e);
    e->flags = flags;
    for (k = 0; k < WIDTH * HEIGHT; ++k) /* in squares of 6 x 5 texels, some holes; or none */
        alpha[k] = (k % WIDTH / 6 * 7 + k / WIDTH / 5 * 3) % 5 ? 255 : 10;
    e->alpha = alpha;
    e->alpha_cut = zoo_below(random, 2) ? 128 : 1;
    e->view_projection = projection;
    e->light_is_point = zoo_below(random, 2);
    for (k = 0; k < 3; ++k) {
        e->light[k] = zoo_between(random, -1.0f, 1.0f);
        if (e->light_is_point) e->light[k] = plant->joints[0].position[k] + e->light[k] * plant->size;
    }
    e->light_radius = (e->light_is_point ? 0.2f * plant->size : 0.2f) * zoo_between(random, 0.01f, 1.0f);
    e->sky_directions = 1 + zoo_below(random, 6);
    e->sky_reach = zoo_below(random, 2) ? 0.0f : 0.3f * plant->size;
    e->lod_bias = zoo_between(random, -1.0f, 1.0f);
    e->lod_steps = zoo_below(random, 3) ? 20 + zoo_below(random, 80) : 0;
    e->fade_begin = zoo_between(random, 1.0f, 8.0f);
    e->fade_end = 0.3f;
    bound.pixel = zoo_below(random, 3) ? zoo_unit(random) * zoo_unit(random) * 0.5f : 0.0f;
}

static void runs_as_c(void)
{
    static const int wanted[4] = {PLAIN, EFFECTS, LINEAR, ANY};
    const int rays = ray_count(6000), rays_each = 25;
    struct counts all;
    int which, g, round, n;
    memset(&all, 0, sizeof all);
    for (which = 0; which < 4; ++which) {
        const unsigned skies = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
        struct zoo_random random = zoo_seed(900 + (uint32_t)which);
        conemap_frusta_shader_desc shader;
        struct counts counts;
        g = wanted[which];
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
            set_effects(&random, &plant, g == ANY ? 0 : shader.flags);
            for (n = 0; n < rays_each; ++n) {
                const conemap_frustum *f = &skeleton.frusta[zoo_below(&random, skeleton.count)];
                const conemap_ray ray = plant_ray(&random, &plant, f);
                compare(&goldens[g], &plant, &skeleton, &trace, &ray, goldens[g].see && (n & 1), &counts);
            }
            conemap_skeleton_free(&skeleton);
            if (round + ZOO_KINDS >= rays / rays_each) conemap_free(&maps[kind]);
        }
        CHECK(counts.shadows * 50 <= counts.places && counts.occlusions * 100 <= counts.places,
              "%s: %d shadows, %d occlusions of %d are others", goldens[g].file, counts.shadows, counts.occlusions,
              counts.places);
        CHECK(counts.gradients * 200 <= counts.places && counts.numbers * 100 <= counts.places, /* at a ray's own start */
              "%s: %d gradients, %d numbers of %d are others", goldens[g].file, counts.gradients, counts.numbers,
              counts.places);
        CHECK(!(shader.flags & skies) || g == ANY ||
              (counts.dark * 8 > counts.places && counts.dark * 8 < 7 * counts.places),
              "%s: %d of %d in shadow", goldens[g].file, counts.dark, counts.places);
        CHECK(!(shader.flags & CONEMAP_EFFECT_FADE) || g == ANY || counts.faded * 20 > counts.places, "%s: %d of %d fading",
              goldens[g].file, counts.faded, counts.places);
        all.rays += counts.rays;
        all.hits += counts.hits;
        all.different += counts.different;
        all.unexplained += counts.unexplained;
        CHECK(counts.hits > counts.rays / 4, "%s: %d hits of %d", goldens[g].file, counts.hits, counts.rays);
        CHECK(g == ANY || counts.exact * 4 > counts.places, "%s: %d of %d with exact_u", goldens[g].file, counts.exact,
              counts.places);
        /* Steps can pass over what is thin, on either side; linear v depends on where the shell is entered and left. */
        CHECK(counts.unexplained <= (g == PLAIN ? counts.rays / 100000 : 2 + counts.rays / (g == LINEAR ? 250 : 1000)),
              "%s: %d of %d rays differ, not on an edge", goldens[g].file, counts.unexplained, counts.rays);
        /* Steps pass over corners of holes that are less than a step thick. */
        CHECK(counts.corners * 200 <= counts.rays, "%s: %d of %d rays differ at holes", goldens[g].file, counts.corners,
              counts.rays);
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
                goldens[round % 3].corner(i, n, place);
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
            const feffects_frustum f = feffects_load(segment);
            const conemap_ray ray = plant_ray(&random, &plant, &skeleton.frusta[segment]);
            float span[2], from[3], a, b;
            feffects_vec3 o, v;
            feffects_vec2 first, second;
            feffects_uvw at;
            double moved_u, moved_v, speed;
            if (conemap_frustum_span(&skeleton.frusta[segment], 1.0f, &ray, span) != CONEMAP_OK || span[0] >= span[1])
                continue;
            local_point(&skeleton.frusta[segment], ray.origin, span[0], ray.direction, from);
            o.x = from[0], o.y = from[1], o.z = from[2];
            v = feffects_make_vec3(ray.direction[0], ray.direction[1], ray.direction[2]);
            v = feffects_into(f, v);
            a = zoo_unit(&random) * (span[1] - span[0]);
            b = a + 0.01f * (span[1] - span[0]);
            at = feffects_locate(f, feffects_along(o, v, a));
            if (!(at.w >= 0.0f && at.w <= 1.0f && at.v >= 0.0f && at.v <= 1.0f)) continue;
            first = feffects_map_place(f, at.u, at.v);
            at = feffects_locate(f, feffects_along(o, v, b));
            if (!(at.w >= 0.0f && at.w <= 1.0f && at.v >= 0.0f && at.v <= 1.0f)) continue;
            second = feffects_map_place(f, at.u, at.v);
            moved_u = (double)second.x - (double)first.x;
            moved_u -= (double)f.more.y * floor(moved_u / (double)f.more.y + 0.5);
            moved_v = 0.75 * ((double)second.y - (double)first.y); /* the aspect of that golden file */
            speed = (double)feffects_map_speed(f, feffects_bound_speed(f, o, v), o, v, a, b);
            CHECK(sqrt(moved_u * moved_u + moved_v * moved_v) <= 1.001 * speed * (double)(b - a) + 2e-5,
                  "moved %g, %g in %g at no more than %g", moved_u, moved_v, (double)(b - a), speed);
            ++all;
            tight += sqrt(moved_u * moved_u + moved_v * moved_v) > 0.8 * speed * (double)(b - a);
        }
        conemap_skeleton_free(&skeleton);
    }
    CHECK(all > 1000 && tight * 50 > all, "%d of %d near the bound", tight, all);
}

/* Two tapered segments with a steep cut between them, where exact_u stretches u most. */
static void exact_u(void)
{
    static const float joints[3][3] = {{0.0f, 0.0f, 0.0f}, {0.0f, 60.0f, 0.0f}, {20.0f, 55.0f, 0.0f}};
    struct zoo_random random = zoo_seed(64);
    struct plant plant;
    conemap_skeleton skeleton;
    conemap_map map;
    float stretched = 0.0f, nearest[2] = {0.0f, 0.0f};
    int i, k, n;
    memset(&plant, 0, sizeof plant);
    for (i = 0; i < 3; ++i) {
        memcpy(plant.joints[i].position, joints[i], sizeof joints[i]);
        plant.joints[i].radius = i == 1 ? 8.0f : 0.5f;
        plant.joints[i].thickness = 0.5f;
    }
    for (i = 0; i < 2; ++i) {
        plant.segments[i].base = i;
        plant.segments[i].top = i + 1;
        plant.segments[i].parent = i - 1;
        plant.segments[i].v_size = 1e-3f;
    }
    plant.desc.joints = plant.joints;
    plant.desc.joint_count = 3;
    plant.desc.segments = plant.segments;
    plant.desc.segment_count = 2;
    plant.desc.exact_u = 1;
    relief_map(ZOO_FBM, 5, &goldens[LINEAR], &map);
    REQUIRE(conemap_skeleton_build(&plant.desc, &skeleton) == CONEMAP_OK, "skeleton");
    bound.skeleton = &skeleton;
    bound.map = &map;
    for (n = 0; n < 400; ++n) {
        const conemap_frustum *f = &skeleton.frusta[n & 1];
        const feffects_frustum seen = feffects_load(n & 1);
        float uvw[3], world[3], at[3];
        feffects_uvw there;
        for (k = 0; k < 3; ++k) uvw[k] = zoo_unit(&random);
        if (n & 6) uvw[1] = (n & 1 ? 0.0f : 1.0f) + (n & 1 ? -0.3f : 0.3f) * uvw[1]; /* beyond the steep cut */
        if ((n & 6) == 4) uvw[1] = n & 1 ? 0.02f : 0.98f;                            /* or near it */
        REQUIRE(conemap_frustum_point(f, uvw, world) == CONEMAP_OK, "point");
        local_point(f, world, 0.0f, world, at);
        there = feffects_locate(seen, feffects_make_vec3(at[0], at[1], at[2]));
        CHECK(turns_apart(there.u, uvw[0]) < 1e-5, "u is %g, not %g", (double)there.u, (double)uvw[0]);
        stretched = fmaxf(stretched, (float)turns_apart(there.u, feffects_turns(at[0], at[2])));
        if (n & 2) continue;
        for (k = 0; k < 2; ++k) { /* how fast u changes around the axis and along it */
            const float step = 0.02f, growth = there.cone.y;
            const feffects_vec3 o = feffects_make_vec3(at[0], at[1], at[2]);
            const feffects_vec3 v = k ? feffects_make_vec3(growth * there.sine, 1.0f, growth * there.cosine)
                                      : feffects_make_vec3(there.cosine, 0.0f, -there.sine);
            const feffects_shell shell = feffects_bound_speed(seen, o, v);
            const float speed = feffects_map_speed(seen, shell, o, v, 0.0f, step);
            const float way = (float)turns_apart(feffects_locate(seen, feffects_along(o, v, step)).u, there.u) / step;
            CHECK(way <= 1.001f * speed + 2e-5f, "u changes by %g, at no more than %g", (double)way, (double)speed);
            nearest[k] = fmaxf(nearest[k], way / speed);
        }
        { /* v that is taken for linear moves u too: elsewhere on the same straight line, with the v of the place */
            const flinear_vec4 piece = {0.0f, 1.0f, uvw[1], uvw[1]};
            const float up = n & 1 ? -3.0f : 3.0f; /* where it is thicker */
            const flinear_vec3 p = {at[0] + up * there.cone.y * there.sine, at[1] + up,
                                    at[2] + up * there.cone.y * there.cosine};
            const flinear_vec3 v = {0.0f, 0.0f, 0.0f};
            conemap_sample sample;
            float above;
            REQUIRE(conemap_sample_at(&map, uvw[0], f->v_start + uvw[1] * f->v_size, &sample) == CONEMAP_OK, "sample");
            above = flinear_above(flinear_load(n & 1), p, v, 0.5f, piece);
            CHECK(fabsf(above - (uvw[2] - sample.height)) < 1e-3f, "%g above, not %g", (double)above,
                  (double)(uvw[2] - sample.height));
        }
    }
    CHECK(stretched > 0.04f && nearest[0] > 0.9f && nearest[1] > 0.2f, "u by %g, at %g and %g of the bound",
          (double)stretched, (double)nearest[0], (double)nearest[1]);
    conemap_skeleton_free(&skeleton);
    conemap_free(&map);
}

static unsigned clashing(unsigned flags)
{
    const unsigned normals = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL;
    const unsigned shadows = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
    const unsigned skies = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY;
    return (flags & REFUSED) || (flags & normals) == normals || (flags & shadows) == shadows || (flags & skies) == skies;
}

/* How many lines of a text are in none of the others; what hands arguments over may be. */
static int strange_lines(const char *text, const char *const *others, int count)
{
    int strange = 0, k;
    for (; *text; text += strcspn(text, "\n") + 1) {
        const size_t length = strcspn(text, "\n") + 1;
        for (k = 0; k < count; ++k) {
            const char *at = others[k];
            while (at && strncmp(at, text, length) != 0) {
                at = strchr(at, '\n');
                at = at && at[1] ? at + 1 : NULL;
            }
            if (at) break;
        }
        if (k < count) continue;
        for (k = 0; k < (int)length && strncmp(text + k, "conemap_", 8) != 0;) ++k;
        if (k < (int)length && (strncmp(text + k, "conemap_finish(", 15) == 0 ||
                                strncmp(text + k, "conemap_meet(", 13) == 0))
            continue;
        ++strange;
    }
    return strange;
}

/* Every effect's own word is in a text if the effect is, and not else. */
static void own_words(const char *text, unsigned flags)
{
    static const struct {
        unsigned flags;
        const char *word;
    } own[] = {
        {CONEMAP_EFFECT_HOLES, "alpha"},
        {CONEMAP_EFFECT_LOD, "lod_steps"},
        {CONEMAP_EFFECT_LOD, "hit.level"},
        {CONEMAP_EFFECT_FADE, "fade_begin"},
        {CONEMAP_EFFECT_FADE, "conemap_flatten"},
        {CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE, "conemap_detail"},
        {CONEMAP_EFFECT_SMOOTH_NORMAL, "conemap_end_normal"},
        {CONEMAP_EFFECT_SMOOTH_NORMAL, "conemap_mix_branches"},
        {CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_SKY, "conemap_find_normals"},
        {CONEMAP_EFFECT_DEPTH, "clip_z"},
        {CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW, "hit.shadow"},
        {CONEMAP_EFFECT_SOFT_SHADOW, "light_radius"},
        {CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY, "conemap_any_frusta"},
        {CONEMAP_EFFECT_OCCLUSION, "conemap_openness"},
        {CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY, "hit.occlusion"},
        {CONEMAP_EFFECT_SKY, "sky_directions"},
        {CONEMAP_EFFECT_UV, "conemap_footprint"},
        {CONEMAP_EFFECT_UV, "hit.map"},
    };
    int k;
    for (k = 0; k < (int)(sizeof own / sizeof own[0]); ++k)
        CHECK((strstr(text, own[k].word) != NULL) == ((flags & own[k].flags) != 0), "effects %x: %s", flags, own[k].word);
}

/* What an effect adds is not there without it: two effects need no line that none of them needs alone. And what runs
   above holds the lines of all effects, and of those ways through the shell that have no file of their own. */
static void effects_add_lines(void)
{
    static const int kept[3] = {PLAIN, EFFECTS, LINEAR};
    const size_t size = 1 << 17;
    conemap_frusta_shader_desc desc;
    char *text = (char *)test_alloc(size), *single[15];
    char *words[3];
    const char *alone[2], *run[3];
    int a, b, k;
    for (k = 0; k < 3; ++k) {
        words[k] = (char *)test_alloc(size);
        golden_desc(kept[k], &desc);
        desc.prefix = NULL;
        desc.fetch_frusta = "rows";
        desc.fetch = "fetch";
        REQUIRE(conemap_emit_frusta(&desc, words[k], size, NULL) == CONEMAP_OK, "run");
        run[k] = words[k];
    }
    golden_desc(EFFECTS, &desc);
    desc.prefix = NULL;
    desc.fetch_frusta = "rows";
    desc.fetch = "fetch";
    for (k = 0; k < 3; ++k) {
        conemap_frusta_shader_desc other = desc;
        other.flags = 0;
        if (k == 1) other.march = CONEMAP_MARCH_STEPS;
        if (k == 2) other.any_hit = 1;
        REQUIRE(conemap_emit_frusta(&other, text, size, NULL) == CONEMAP_OK, "no effects");
        a = strange_lines(text, run, 3);
        CHECK(a <= (k == 1 ? 8 : 5), "%d lines that do not run, of way %d", a, k); /* numbers of steps, a heading */
    }
    for (a = 0; a < 15; ++a) {
        single[a] = NULL;
        desc.flags = 1u << a;
        if (clashing(desc.flags)) continue;
        single[a] = (char *)test_alloc(size);
        REQUIRE(conemap_emit_frusta(&desc, single[a], size, NULL) == CONEMAP_OK, "effect %d", a);
        own_words(single[a], desc.flags);
        k = strange_lines(single[a], run, 3);
        CHECK(k <= 9, "effect %d: %d lines that do not run", a, k);
        alone[0] = single[a];
        for (b = 0; b < a; ++b) {
            desc.flags = 1u << a | 1u << b;
            if (!single[b] || clashing(desc.flags)) continue;
            REQUIRE(conemap_emit_frusta(&desc, text, size, NULL) == CONEMAP_OK, "effects %d, %d", a, b);
            own_words(text, desc.flags);
            alone[1] = single[b];
            k = strange_lines(text, alone, 2);
            CHECK(k <= 7, "effects %d, %d: %d lines that neither needs", a, b, k);
        }
    }
    for (a = 0; a < 15; ++a)
        if (single[a]) test_release(single[a]);
    for (k = 0; k < 3; ++k) test_release(words[k]);
    test_release(text);
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
        {"depth bound", CONEMAP_ERROR_ENUM},
        {"depth bound in ES", CONEMAP_ERROR_UNSUPPORTED},
        {"depth bound without depth", CONEMAP_ERROR_UNSUPPORTED},
        {"only depth, but none", CONEMAP_ERROR_UNSUPPORTED},
        {"clip", CONEMAP_ERROR_UNSUPPORTED},
        {"holes without relief", CONEMAP_ERROR_UNSUPPORTED},
        {"curved", CONEMAP_ERROR_UNSUPPORTED},
        {"unknown effects", CONEMAP_ERROR_UNSUPPORTED},
        {"two normals", CONEMAP_ERROR_UNSUPPORTED},
        {"two shadows", CONEMAP_ERROR_UNSUPPORTED},
        {"two skies", CONEMAP_ERROR_UNSUPPORTED},
        {"effects of any hit", CONEMAP_ERROR_UNSUPPORTED},
        {"levels without relief", CONEMAP_ERROR_UNSUPPORTED},
        {"fading without relief", CONEMAP_ERROR_UNSUPPORTED},
        {"occlusion without cones", CONEMAP_ERROR_UNSUPPORTED},
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
        case 29:
            desc.dialect = CONEMAP_GLSL_430;
            desc.filter = CONEMAP_FILTER_GATHER;
            desc.map.texture.per_cell = 1;
            break;
        case 30: desc.depth_bound = CONEMAP_DEPTH_BOUND_COUNT; break;
        case 31:
            desc.stage = CONEMAP_FRUSTA_FRAGMENT;
            desc.dialect = CONEMAP_ESSL_310;
            desc.depth_bound = CONEMAP_DEPTH_GREATER;
            break;
        case 32:
        case 33:
            desc.stage = CONEMAP_FRUSTA_FRAGMENT;
            desc.dialect = CONEMAP_GLSL_430;
            desc.flags = CONEMAP_EFFECT_UV;
            if (k == 32) desc.depth_bound = CONEMAP_DEPTH_LESS;
            if (k == 33) desc.depth_only = 1;
            break;
        case 34: desc.flags = CONEMAP_EFFECT_CLIP; break;
        case 35:
            desc.flags = CONEMAP_EFFECT_HOLES;
            desc.relief = 0;
            break;
        case 36: desc.flags = CONEMAP_EFFECT_CURVED; break;
        case 37: desc.flags = CONEMAP_EFFECT_ALL_BITS + 1; break;
        case 38: desc.flags = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL; break;
        case 39: desc.flags = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW; break;
        case 40: desc.flags = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY; break;
        case 41:
            desc.flags = CONEMAP_EFFECT_UV;
            desc.any_hit = 1;
            break;
        case 42:
        case 43:
            desc.flags = k == 42 ? CONEMAP_EFFECT_LOD : CONEMAP_EFFECT_FADE;
            desc.relief = 0;
            break;
        default:
            desc.flags = CONEMAP_EFFECT_OCCLUSION;
            desc.march = CONEMAP_MARCH_STEPS;
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
#endif

const struct test_case emit_frusta_tests[] = {
    {"golden files", golden_files},
#ifndef TEST_WRITE
    {"bounds", bounds},
    {"runs as C", runs_as_c},
    {"speed bound", speed_bound},
    {"exact u", exact_u},
    {"effects add lines", effects_add_lines},
    {"bad input", bad_input},
#endif
    {NULL, NULL},
};
