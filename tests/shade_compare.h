/* What an emitted conemap_shade answered, against the CPU's: random frames, rays and settings; what differs, and whether
   the ray lies on an edge, where the last bit decides. And the macros that run emitted C, whose names have a prefix. */
#ifndef SHADE_COMPARE_H
#define SHADE_COMPARE_H

#include <math.h>
#include <string.h>

#include "conemap.h"
#include "zoo.h"

enum { SHADE_LEVELS = 3, SHADE_MOST = 48, SHADE_EFFECTS = 15 };

/* One ray's own settings. Stays where it is: the effects point into it. */
struct shade_job {
    conemap_effects e;
    conemap_frame frame;
    conemap_gradient gradient;
    conemap_ray ray;
};

struct shade_answer {
    int found;
    float t, box[3];
    conemap_shading s;
};

struct shade_counts {
    int rays, hits, different, unexplained;
    unsigned what;
};

static inline void shade_put(float to[3], float x, float y, float z)
{
    to[0] = x;
    to[1] = y;
    to[2] = z;
}

static inline float shade_signed(struct zoo_random *random) { return zoo_between(random, -1.0f, 1.0f); }

/* Holes in squares of three texels. */
static inline void shade_alpha(int width, int height, unsigned char *alpha)
{
    int k;
    for (k = 0; k < width * height; ++k) alpha[k] = (k % width / 3 + k / width / 3) % 3 == 0 ? 0 : 255;
}

/* Settings of effects that hold for many rays. */
static inline void shade_settings(struct zoo_random *random, unsigned flags, const conemap_map *levels, int level_count,
                                  const unsigned char *alpha, conemap_effects *e)
{
    static const float projection[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0.1f, 0.2f, 0.3f, -1, 0, 0, 0.1f, 4};
    memset(e, 0, sizeof *e);
    e->flags = flags;
    e->clip[0] = 0.1f, e->clip[1] = -0.3f, e->clip[2] = 0.9f, e->clip[3] = 1.4f;
    e->alpha = alpha;
    e->levels = levels;
    e->level_count = level_count;
    e->lod_steps = 400;
    e->fade_begin = 1.5f;
    e->fade_end = 0.5f;
    e->view_projection = projection;
    e->light[0] = shade_signed(random), e->light[1] = shade_signed(random), e->light[2] = 0.2f + zoo_unit(random);
    e->light_is_point = zoo_below(random, 2);
    e->light_radius = 0.05f;
    e->sky_directions = 5;
    e->sky_reach = zoo_below(random, 2) ? 0.5f : 4.0f;
}

/* What a frame's shape is: uv_scale, depth, level and curvature. */
static inline void shade_shape(struct zoo_random *random, unsigned flags, float aspect, conemap_frame *f)
{
    int k;
    memset(f, 0, sizeof *f);
    for (k = 0; k < 3; ++k) f->curvature[k] = flags & CONEMAP_EFFECT_CURVED ? 0.6f * shade_signed(random) : 0.0f;
    f->curvature[1] *= 0.3f;
    f->uv_scale[0] = zoo_between(random, 0.7f, 1.5f);
    f->uv_scale[1] = zoo_between(random, 0.7f, 1.5f);
    f->aspect = aspect;
    f->depth = zoo_between(random, 0.1f, 0.4f);
    f->level = zoo_unit(random);
}

/* A ray in a frame of this shape: the rest of the frame, the ray and its gradient. */
static inline void shade_draw(struct zoo_random *random, const conemap_effects *e, const conemap_frame *shape, int ranged,
                              struct shade_job *job)
{
    conemap_frame *f = &job->frame;
    float at[2], side[2], up = zoo_between(random, 0.3f, 1.5f), fine = zoo_unit(random);
    int k;
    memset(job, 0, sizeof *job);
    *f = *shape;
    for (k = 0; k < 3; ++k) {
        f->origin[k] = 2.0f * shade_signed(random);
        f->tangent[k] = 0.2f * shade_signed(random) + (k == 0 ? 1.0f : 0.0f);
        f->bitangent[k] = 0.2f * shade_signed(random) + (k == 1 ? 1.2f : 0.0f);
        f->normal[k] = 0.2f * shade_signed(random) + (k == 2 ? 0.9f : 0.0f);
    }
    f->uv_offset[0] = 0.3f + 0.4f * zoo_unit(random);
    f->uv_offset[1] = 0.3f + 0.4f * zoo_unit(random);
    for (k = 0; k < 2; ++k) {
        at[k] = 0.4f * shade_signed(random);
        side[k] = 1.2f * shade_signed(random);
    }
    if ((e->flags & CONEMAP_EFFECT_TWO_SIDED) && zoo_below(random, 4) == 0) up = -up;
    for (k = 0; k < 3; ++k) {
        float target = f->origin[k] + f->tangent[k] * at[0] + f->bitangent[k] * at[1];
        job->ray.direction[k] = f->tangent[k] * side[0] + f->bitangent[k] * side[1] - f->normal[k] * up;
        job->ray.origin[k] = target - job->ray.direction[k] * 1.1f;
    }
    if (ranged) {
        job->ray.t_min = 0.2f;
        job->ray.t_max = 3.0f;
    }
    job->gradient.dudx = fine * 0.2f;
    job->gradient.dvdx = 0.02f * zoo_unit(random);
    job->gradient.dudy = 0.02f * zoo_unit(random);
    job->gradient.dvdy = fine * fine * 0.2f;
    job->e = *e;
    job->e.frames = f;
    job->e.gradients = &job->gradient;
}

static inline int shade_far(const float a[3], const float b[3], float tolerance)
{
    return !(fabsf(a[0] - b[0]) <= tolerance && fabsf(a[1] - b[1]) <= tolerance && fabsf(a[2] - b[2]) <= tolerance);
}

/* What differs, bit by bit; 0 if nothing does by more than single precision explains. */
static inline unsigned shade_differs(unsigned flags, const conemap_hit *hit, const conemap_shading *s,
                                     const struct shade_answer *a)
{
    const unsigned normals = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL;
    const unsigned shadows = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
    const unsigned skies = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY;
    const int capped = hit->status == CONEMAP_STEP_CAP && (flags & CONEMAP_EFFECT_LOD); /* shaders shade no others */
    const int found = hit->status == CONEMAP_HIT || capped;
    float place[3];
    if (found != a->found) return 1;
    if (!found) return 0;
    shade_put(place, hit->u, hit->v, hit->z);
    if (!(fabsf(hit->t - a->t) <= 1e-4f) || shade_far(place, a->box, 2e-4f)) return 2;
    if ((flags & CONEMAP_EFFECT_POSITION) && shade_far(s->position, a->s.position, 3e-4f)) return 4;
    if ((flags & normals) && shade_far(s->normal, a->s.normal, 5e-3f)) return 8;
    if ((flags & CONEMAP_EFFECT_DEPTH) && !(fabsf(s->depth - a->s.depth) <= 1e-4f)) return 16;
    if ((flags & shadows) && !(fabsf(s->shadow - a->s.shadow) <= 0.01f)) return 32;
    if ((flags & skies) && !(fabsf(s->occlusion - a->s.occlusion) <= 0.01f)) return 64;
    if ((flags & CONEMAP_EFFECT_LOD) && !(fabsf(s->level - a->s.level) <= 1e-4f)) return 128;
    if ((flags & CONEMAP_EFFECT_FADE) && !(fabsf(s->fade - a->s.fade) <= 1e-4f)) return 256;
    return 0;
}

/* Does conemap_shade give that answer to a ray a hair beside? Then the ray lies on an edge. */
static inline int shade_on_edge(const conemap_map *map, const conemap_trace_desc *trace, const struct shade_job *job,
                                const struct shade_answer *answer, struct zoo_random *random)
{
    int tries, axis;
    for (tries = 0; tries < 400; ++tries) {
        conemap_ray beside = job->ray;
        conemap_hit hit;
        conemap_shading s;
        const float hair = tries < 100 ? 1e-5f : tries < 250 ? 1e-4f : 1e-3f;
        memset(&s, 0, sizeof s);
        for (axis = 0; axis < 3; ++axis) beside.origin[axis] += hair * shade_signed(random);
        conemap_shade(map, trace, &job->e, &beside, &hit, &s, 1);
        if (answer->found && fabsf(hit.t - answer->t) < 1e-2f) { /* that it moved by a hair is no difference */
            hit.t = answer->t;
            hit.u = answer->box[0];
            hit.v = answer->box[1];
            hit.z = answer->box[2];
            memcpy(s.position, answer->s.position, sizeof s.position);
            s.depth = answer->s.depth;
        }
        if (!shade_differs(job->e.flags, &hit, &s, answer)) return 1;
    }
    return 0;
}

/* Compares one answer with the CPU's; 0 if the CPU refuses the ray. */
static inline int shade_compare(const conemap_map *map, const conemap_trace_desc *trace, const struct shade_job *job,
                                const struct shade_answer *answer, struct zoo_random *random,
                                struct shade_counts *counts)
{
    conemap_hit hit;
    conemap_shading shading;
    unsigned what;
    memset(&shading, 0, sizeof shading);
    if (conemap_shade(map, trace, &job->e, &job->ray, &hit, &shading, 1) != CONEMAP_OK) return 0;
    what = shade_differs(job->e.flags, &hit, &shading, answer);
    ++counts->rays;
    counts->hits += answer->found;
    if (!what) return 1;
    ++counts->different;
    if (shade_on_edge(map, trace, job, answer, random)) return 1;
    ++counts->unexplained;
    counts->what |= what;
    return 1;
}

/* ---- the sets of effects that are run: every one, every pair, everything together, and a sample -------------------- */

static inline int shade_excluded(unsigned flags)
{
    const unsigned pairs[3] = {CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL,
                               CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW,
                               CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY};
    return (flags & pairs[0]) == pairs[0] || (flags & pairs[1]) == pairs[1] || (flags & pairs[2]) == pairs[2];
}

/* Fills `sets`, room for 300; returns how many. Singles come first. */
static inline int shade_sets(int sample, struct zoo_random *random, unsigned *sets)
{
    int a, b, count = 0;
    for (a = 0; a < SHADE_EFFECTS; ++a) sets[count++] = 1u << a;
    for (a = 0; a < SHADE_EFFECTS; ++a)
        for (b = a + 1; b < SHADE_EFFECTS; ++b)
            if (!shade_excluded(1u << a | 1u << b)) sets[count++] = 1u << a | 1u << b;
    for (a = 0; a < 8; ++a)
        sets[count++] = CONEMAP_EFFECT_ALL_BITS &
                        ~(unsigned)(a & 1 ? CONEMAP_EFFECT_NORMAL : CONEMAP_EFFECT_SMOOTH_NORMAL) &
                        ~(unsigned)(a & 2 ? CONEMAP_EFFECT_SHADOW : CONEMAP_EFFECT_SOFT_SHADOW) &
                        ~(unsigned)(a & 4 ? CONEMAP_EFFECT_OCCLUSION : CONEMAP_EFFECT_SKY);
    while (sample > 0) {
        unsigned flags = 0;
        for (a = 0; a < SHADE_EFFECTS; ++a) flags |= zoo_below(random, 3) ? 0u : 1u << a;
        if (flags == 0 || shade_excluded(flags)) continue;
        sets[count++] = flags;
        --sample;
    }
    return count;
}

/* ---- emitted C, p its prefix; the map is shade_bound's ---------------------------------------------------------- */

struct shade_bound {
    conemap_map levels[SHADE_LEVELS];
    unsigned char alpha[SHADE_MOST * SHADE_MOST];
};

/* Where a plane of a level has a texel; -1 for what no shader may ask for. */
static inline int shade_at(const struct shade_bound *bound, int i, int j, int level)
{
    const conemap_info *info = &bound->levels[level >= 0 && level < SHADE_LEVELS ? level : 0].info;
    if (level < 0 || level >= SHADE_LEVELS || i < 0 || j < 0 || i >= info->width || j >= info->height) return -1;
    return j * info->width + i;
}

#define SHADE_VALUE(values, level) (at < 0 ? 0.0f : shade_bound.levels[level].values)
#define SHADE_PLACE(level)                               \
    const int at = shade_at(&shade_bound, i, j, level);  \
    CHECK(at >= 0, "fetch %d %d %d", i, j, level);
#define SHADE_TEXEL(p, level)                 \
    p##_vec2 v;                               \
    SHADE_PLACE(level)                        \
    v.x = SHADE_VALUE(heights[at], level);    \
    v.y = SHADE_VALUE(cones[at], level);      \
    return v;
#define SHADE_HEIGHT(level) SHADE_PLACE(level) return SHADE_VALUE(heights[at], level);
#define SHADE_SECTOR(level)                                                                             \
    const conemap_info *info = &shade_bound.levels[0].info;                                             \
    SHADE_PLACE(level)                                                                                  \
    if (!CHECK(sector >= 0 && sector < info->texture.sectors, "sector %d", sector)) return 0.0f;        \
    info = &shade_bound.levels[level].info;                                                             \
    return SHADE_VALUE(cones[sector * info->width * info->height + at], level);
#define SHADE_FETCH(p) p##_vec2 p##_fetch(int i, int j) { SHADE_TEXEL(p, 0) }
#define SHADE_FETCH_LEVEL(p) p##_vec2 p##_fetch(int i, int j, int level) { SHADE_TEXEL(p, level) }
#define SHADE_FETCH_SECTORS(p)                          \
    float p##_fetch(int i, int j) { SHADE_HEIGHT(0) }   \
    float p##_cones(int i, int j, int sector) { SHADE_SECTOR(0) }
#define SHADE_FETCH_SECTORS_LEVEL(p)                                \
    float p##_fetch(int i, int j, int level) { SHADE_HEIGHT(level) } \
    float p##_cones(int i, int j, int sector, int level) { SHADE_SECTOR(level) }
#define SHADE_ALPHA(p)                                                                                             \
    float p##_alpha(int i, int j)                                                                                  \
    {                                                                                                              \
        const conemap_info *info = &shade_bound.levels[0].info;                                                    \
        if (!CHECK(i >= 0 && j >= 0 && i < info->width && j < info->height, "alpha %d %d", i, j)) return 0.0f;     \
        return (float)shade_bound.alpha[j * info->width + i] / 255.0f;                                             \
    }

#define SHADE_START(p)                                                                                             \
    struct shade_answer a;                                                                                         \
    p##_shading s;                                                                                                 \
    p##_frame frame;                                                                                               \
    p##_ivec2 size;                                                                                                \
    p##_vec3 o, d;                                                                                                 \
    const conemap_frame *f = &job->frame;                                                                          \
    memset(&a, 0, sizeof a);                                                                                       \
    size.x = shade_bound.levels[0].info.width, size.y = shade_bound.levels[0].info.height;                         \
    o = p##_make_vec3(job->ray.origin[0], job->ray.origin[1], job->ray.origin[2]);                                 \
    d = p##_make_vec3(job->ray.direction[0], job->ray.direction[1], job->ray.direction[2]);                        \
    frame.origin = p##_make_vec3(f->origin[0], f->origin[1], f->origin[2]);                                        \
    frame.tangent = p##_make_vec3(f->tangent[0], f->tangent[1], f->tangent[2]);                                    \
    frame.bitangent = p##_make_vec3(f->bitangent[0], f->bitangent[1], f->bitangent[2]);                            \
    frame.normal = p##_make_vec3(f->normal[0], f->normal[1], f->normal[2]);                                        \
    frame.uv_offset = p##_make_vec2(f->uv_offset[0], f->uv_offset[1]);                                             \
    frame.uv_scale = p##_make_vec2(f->uv_scale[0], f->uv_scale[1]);                                                \
    frame.depth = f->depth;                                                                                        \
    frame.level = f->level;
#define SHADE_FINISH                                                                                               \
    a.found = s.found;                                                                                             \
    a.t = s.t;                                                                                                     \
    shade_put(a.box, s.box.x, s.box.y, s.box.z);                                                                   \
    return a;
#define SHADE_CURVE(p) frame.curvature = p##_make_vec3(f->curvature[0], f->curvature[1], f->curvature[2]);
#define SHADE_CLIPPED(p) e.clip = p##_make_vec4(job->e.clip[0], job->e.clip[1], job->e.clip[2], job->e.clip[3]);
#define SHADE_LIT(p) \
    e.light = p##_make_vec4(job->e.light[0], job->e.light[1], job->e.light[2], (float)job->e.light_is_point);
#define SHADE_SOFT(p) e.light_radius = job->e.light_radius;
#define SHADE_PIERCED(p) e.alpha_cut = 127.5f / 255.0f;
#define SHADE_SKY(p)                     \
    e.sky_reach = job->e.sky_reach;      \
    e.sky_directions = job->e.sky_directions;
#define SHADE_LOD(p)                  \
    e.lod_bias = job->e.lod_bias;     \
    e.lod_steps = job->e.lod_steps;   \
    e.level_count = job->e.level_count;
#define SHADE_FADE(p)                   \
    e.fade_begin = job->e.fade_begin;   \
    e.fade_end = job->e.fade_end;
#define SHADE_PROJECT(p)                                                                                           \
    e.clip_z = p##_make_vec4(job->e.view_projection[2], job->e.view_projection[6], job->e.view_projection[10],     \
                             job->e.view_projection[14]);                                                          \
    e.clip_w = p##_make_vec4(job->e.view_projection[3], job->e.view_projection[7], job->e.view_projection[11],     \
                             job->e.view_projection[15]);
#define SHADE_GRADIENT(p) \
    p##_make_vec4(job->gradient.dudx, job->gradient.dvdx, job->gradient.dudy, job->gradient.dvdy)

#endif
