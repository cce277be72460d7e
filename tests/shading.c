/* Emitted effects: the C dialect against conemap_shade, bad input, and that an effect which is off adds nothing. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

/* ---- the emitted C; each golden file is one set of effects ---- */

enum { LEVELS = 4, MOST = 48 };

static struct {
    conemap_map levels[LEVELS];
    unsigned char alpha[MOST * MOST];
} bound;

#define FETCH(p)                                                                                                  \
    p##_vec2 p##_fetch(int i, int j)                                                                              \
    {                                                                                                             \
        const conemap_map *map = &bound.levels[0];                                                                \
        p##_vec2 v = {0.0f, 0.0f};                                                                                \
        if (!CHECK(i >= 0 && j >= 0 && i < map->info.width && j < map->info.height, "fetch %d %d", i, j)) return v; \
        v.x = map->heights[j * map->info.width + i];                                                              \
        v.y = map->cones[j * map->info.width + i];                                                                \
        return v;                                                                                                 \
    }
#define FETCH_LEVEL(p)                                                                                            \
    p##_vec2 p##_fetch(int i, int j, int level)                                                                   \
    {                                                                                                             \
        const conemap_map *map = &bound.levels[level < 0 || level >= LEVELS ? 0 : level];                         \
        p##_vec2 v = {0.0f, 0.0f};                                                                                \
        if (!CHECK(level >= 0 && level < LEVELS && i >= 0 && j >= 0 && i < map->info.width && j < map->info.height, \
                   "fetch %d %d %d", i, j, level))                                                                \
            return v;                                                                                             \
        v.x = map->heights[j * map->info.width + i];                                                              \
        v.y = map->cones[j * map->info.width + i];                                                                \
        return v;                                                                                                 \
    }
#define ALPHA(p)                                                                                                  \
    float p##_alpha(int i, int j)                                                                                 \
    {                                                                                                             \
        const conemap_info *info = &bound.levels[0].info;                                                         \
        if (!CHECK(i >= 0 && j >= 0 && i < info->width && j < info->height, "alpha %d %d", i, j)) return 0.0f;    \
        return (float)bound.alpha[j * info->width + i] / 255.0f;                                                  \
    }

#include "golden/plain_c.h"
#include "golden/bent_c.h"
#include "golden/sky_c.h"
#include "golden/mip_c.h"
#include "golden/sieve_c.h"

FETCH(plain)
FETCH_LEVEL(bent)
ALPHA(bent)
FETCH(sky)
FETCH_LEVEL(mip)
FETCH(sieve)
ALPHA(sieve)

/* One ray's own settings. */
struct job {
    const conemap_effects *e;
    const conemap_frame *frame;
    const conemap_gradient *gradient;
    const conemap_ray *ray;
};

struct answer {
    int found;
    float t, box[3];
    conemap_shading s;
};

static void put3(float to[3], float x, float y, float z)
{
    to[0] = x;
    to[1] = y;
    to[2] = z;
}

#define START(p)                                                                                                  \
    struct answer a;                                                                                              \
    p##_shading s;                                                                                                \
    p##_frame frame;                                                                                              \
    p##_ivec2 size;                                                                                               \
    p##_vec3 o, d;                                                                                                \
    const conemap_frame *f = job->frame;                                                                          \
    memset(&a, 0, sizeof a);                                                                                      \
    size.x = bound.levels[0].info.width, size.y = bound.levels[0].info.height;                                    \
    o = p##_make_vec3(job->ray->origin[0], job->ray->origin[1], job->ray->origin[2]);                             \
    d = p##_make_vec3(job->ray->direction[0], job->ray->direction[1], job->ray->direction[2]);                    \
    frame.origin = p##_make_vec3(f->origin[0], f->origin[1], f->origin[2]);                                       \
    frame.tangent = p##_make_vec3(f->tangent[0], f->tangent[1], f->tangent[2]);                                   \
    frame.bitangent = p##_make_vec3(f->bitangent[0], f->bitangent[1], f->bitangent[2]);                           \
    frame.normal = p##_make_vec3(f->normal[0], f->normal[1], f->normal[2]);                                       \
    frame.uv_offset = p##_make_vec2(f->uv_offset[0], f->uv_offset[1]);                                            \
    frame.uv_scale = p##_make_vec2(f->uv_scale[0], f->uv_scale[1]);                                               \
    frame.depth = f->depth;                                                                                       \
    frame.level = f->level;
#define FINISH                                                                                                    \
    a.found = s.found;                                                                                            \
    a.t = s.t;                                                                                                    \
    put3(a.box, s.box.x, s.box.y, s.box.z);                                                                       \
    return a;
#define CURVE(p) frame.curvature = p##_make_vec3(f->curvature[0], f->curvature[1], f->curvature[2])
#define CLIPPED(p) e.clip = p##_make_vec4(job->e->clip[0], job->e->clip[1], job->e->clip[2], job->e->clip[3])
#define LIT(p) e.light = p##_make_vec4(job->e->light[0], job->e->light[1], job->e->light[2], (float)job->e->light_is_point)
#define PROJECT(p)                                                                                                \
    e.clip_z = p##_make_vec4(job->e->view_projection[2], job->e->view_projection[6], job->e->view_projection[10], \
                             job->e->view_projection[14]);                                                        \
    e.clip_w = p##_make_vec4(job->e->view_projection[3], job->e->view_projection[7], job->e->view_projection[11], \
                             job->e->view_projection[15])
#define GRADIENT(p)                                                                                               \
    p##_make_vec4(job->gradient->dudx, job->gradient->dvdx, job->gradient->dudy, job->gradient->dvdy)

static struct answer plain_run(const struct job *job)
{
    plain_effects e;
    START(plain)
    CLIPPED(plain);
    LIT(plain);
    PROJECT(plain);
    e.fade_begin = job->e->fade_begin;
    e.fade_end = job->e->fade_end;
    s = plain_shade(e, frame, o, d, GRADIENT(plain), size);
    put3(a.s.position, s.position.x, s.position.y, s.position.z);
    put3(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.depth = s.depth;
    a.s.shadow = s.shadow;
    a.s.occlusion = s.occlusion;
    a.s.fade = s.fade;
    CHECK(s.uv.x == s.box.x && s.uv.y == s.box.y && s.gradient.w == job->gradient->dvdy, "uv");
    FINISH
}

static struct answer bent_run(const struct job *job)
{
    bent_effects e;
    START(bent)
    CURVE(bent);
    CLIPPED(bent);
    LIT(bent);
    PROJECT(bent);
    e.light_radius = job->e->light_radius;
    e.alpha_cut = 127.5f / 255.0f;
    e.lod_bias = job->e->lod_bias;
    e.lod_steps = job->e->lod_steps;
    e.level_count = job->e->level_count;
    e.fade_begin = job->e->fade_begin;
    e.fade_end = job->e->fade_end;
    s = bent_shade(e, frame, o, d, GRADIENT(bent), size);
    put3(a.s.position, s.position.x, s.position.y, s.position.z);
    put3(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.depth = s.depth;
    a.s.shadow = s.shadow;
    a.s.occlusion = s.occlusion;
    a.s.level = s.level;
    a.s.fade = s.fade;
    FINISH
}

static struct answer sky_run(const struct job *job)
{
    sky_effects e;
    START(sky)
    CURVE(sky);
    LIT(sky);
    e.sky_reach = job->e->sky_reach;
    e.sky_directions = job->e->sky_directions;
    s = sky_shade(e, frame, o, d, size);
    put3(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.shadow = s.shadow;
    a.s.occlusion = s.occlusion;
    FINISH
}

static struct answer mip_run(const struct job *job)
{
    mip_effects e;
    START(mip)
    LIT(mip);
    e.lod_bias = job->e->lod_bias;
    e.lod_steps = job->e->lod_steps;
    e.level_count = job->e->level_count;
    s = mip_shade(e, frame, o, d, GRADIENT(mip), size);
    put3(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.shadow = s.shadow;
    a.s.level = s.level;
    FINISH
}

static struct answer sieve_run(const struct job *job)
{
    sieve_effects e;
    START(sieve)
    LIT(sieve);
    e.alpha_cut = 127.5f / 255.0f;
    s = sieve_shade(e, frame, o, d, job->ray->t_min, job->ray->t_max, size);
    put3(a.s.normal, s.normal.x, s.normal.y, s.normal.z);
    a.s.shadow = s.shadow;
    FINISH
}

static const struct set {
    const char *file, *prefix;
    struct answer (*run)(const struct job *job);
    unsigned flags;
    conemap_wrap wrap_u, wrap_v;
    float aspect;
    int t_range;
    conemap_encoding encoding;
} sets[] = {
    {"plain_c.h", "plain", plain_run,
     CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_NORMAL |
         CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_UV,
     CONEMAP_CLAMP, CONEMAP_WRAP, 0.6f, 0, CONEMAP_LINEAR},
    {"bent_c.h", "bent", bent_run,
     CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE |
         CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_DEPTH |
         CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_UV,
     CONEMAP_WRAP, CONEMAP_WRAP, 1.0f, 0, CONEMAP_SQRT},
    {"sky_c.h", "sky", sky_run,
     CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SKY, CONEMAP_NOTHING,
     CONEMAP_WRAP, 0.5f, 0, CONEMAP_LINEAR},
    {"mip_c.h", "mip", mip_run, CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_SHADOW, CONEMAP_CLAMP,
     CONEMAP_NOTHING, 1.0f, 0, CONEMAP_LINEAR},
    {"sieve_c.h", "sieve", sieve_run, CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW, CONEMAP_CLAMP,
     CONEMAP_CLAMP, 1.0f, 1, CONEMAP_RADIUS},
};
enum { SETS = sizeof sets / sizeof sets[0] };

static void set_desc(const struct set *set, char *fetch, size_t size, conemap_shader_desc *d)
{
    memset(d, 0, sizeof *d);
    d->dialect = CONEMAP_C99;
    d->prefix = set->prefix;
    snprintf(fetch, size, "%s_fetch", set->prefix);
    d->fetch = fetch;
    d->flags = set->flags;
    d->map.wrap_u = set->wrap_u;
    d->map.wrap_v = set->wrap_v;
    d->map.aspect = set->aspect;
    d->map.texture.encoding = set->encoding;
    d->t_range = set->t_range;
}

static char *emit(const conemap_shader_desc *desc)
{
    size_t size = 0;
    char *text;
    conemap_result result = conemap_emit(desc, NULL, 0, &size);
    if (!CHECK(result == CONEMAP_OK && size > 100, "emit: %s", conemap_result_string(result))) return NULL;
    text = (char *)test_alloc(size);
    result = conemap_emit(desc, text, size, NULL);
    CHECK(result == CONEMAP_OK && strlen(text) + 1 == size, "emit: %s", conemap_result_string(result));
    return text;
}

static void golden_files(void)
{
    int k;
    for (k = 0; k < SETS; ++k) {
        conemap_shader_desc desc;
        char path[64], fetch[32], *text, *file;
        size_t size, length;
        FILE *stream;
        set_desc(&sets[k], fetch, sizeof fetch, &desc);
        text = emit(&desc);
        if (!text) return;
        size = strlen(text);
        snprintf(path, sizeof path, "tests/golden/%s", sets[k].file);
        if (getenv("CONEMAP_SYNC")) {
            stream = fopen(path, "wb");
            if (CHECK(stream != NULL, "%s", path)) {
                fwrite(text, 1, size, stream);
                fclose(stream);
            }
        }
        file = (char *)test_alloc(size + 2);
        stream = fopen(path, "rb");
        length = stream ? fread(file, 1, size + 1, stream) : 0;
        if (stream) fclose(stream);
        CHECK(length == size && memcmp(file, text, size) == 0, "%s: not what is emitted (make sync)", path);
        test_release(file);
        test_release(text);
    }
}

/* ---- against conemap_shade ---- */

static float signed_unit(struct zoo_random *random) { return zoo_between(random, -1.0f, 1.0f); }

static void random_frame(struct zoo_random *random, const struct set *set, conemap_frame *f)
{
    const int bent = (set->flags & CONEMAP_EFFECT_CURVED) != 0;
    int k;
    memset(f, 0, sizeof *f);
    for (k = 0; k < 3; ++k) {
        f->origin[k] = 2.0f * signed_unit(random);
        f->tangent[k] = 0.2f * signed_unit(random) + (k == 0 ? 1.0f : 0.0f);
        f->bitangent[k] = 0.2f * signed_unit(random) + (k == 1 ? 1.2f : 0.0f);
        f->normal[k] = 0.2f * signed_unit(random) + (k == 2 ? 0.9f : 0.0f);
        f->curvature[k] = bent ? 0.6f * signed_unit(random) : 0.0f;
    }
    f->curvature[1] *= 0.3f;
    f->uv_offset[0] = 0.3f + 0.4f * zoo_unit(random);
    f->uv_offset[1] = 0.3f + 0.4f * zoo_unit(random);
    f->uv_scale[0] = zoo_between(random, 0.7f, 1.5f);
    f->uv_scale[1] = zoo_between(random, 0.7f, 1.5f);
    f->aspect = set->aspect;
    f->depth = zoo_between(random, 0.1f, 0.4f);
    f->level = zoo_unit(random);
}

static void random_ray(struct zoo_random *random, const conemap_frame *f, int under, conemap_ray *ray)
{
    float at[2], side[2], up = zoo_between(random, 0.3f, 1.5f);
    int k;
    memset(ray, 0, sizeof *ray);
    for (k = 0; k < 2; ++k) {
        at[k] = 0.4f * signed_unit(random);
        side[k] = 1.2f * signed_unit(random);
    }
    if (under && zoo_below(random, 4) == 0) up = -up;
    for (k = 0; k < 3; ++k) {
        float target = f->origin[k] + f->tangent[k] * at[0] + f->bitangent[k] * at[1];
        ray->direction[k] = f->tangent[k] * side[0] + f->bitangent[k] * side[1] - f->normal[k] * up;
        ray->origin[k] = target - ray->direction[k] * 1.1f;
    }
}

static int far3(const float a[3], const float b[3], float tolerance)
{
    return fabsf(a[0] - b[0]) > tolerance || fabsf(a[1] - b[1]) > tolerance || fabsf(a[2] - b[2]) > tolerance;
}

/* What differs, bit by bit; 0 if nothing does by more than single precision explains. */
static int differs(unsigned flags, const conemap_hit *hit, const conemap_shading *s, const struct answer *a)
{
    const int found = hit->status == CONEMAP_HIT || hit->status == CONEMAP_STEP_CAP;
    float place[3];
    if (found != a->found) return 1;
    if (!found) return 0;
    put3(place, hit->u, hit->v, hit->z);
    if (fabsf(hit->t - a->t) > 1e-4f || far3(place, a->box, 2e-4f)) return 2;
    if ((flags & CONEMAP_EFFECT_POSITION) && far3(s->position, a->s.position, 3e-4f)) return 4;
    if ((flags & (CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL)) && far3(s->normal, a->s.normal, 5e-3f)) return 8;
    if ((flags & CONEMAP_EFFECT_DEPTH) && fabsf(s->depth - a->s.depth) > 1e-4f) return 16;
    if ((flags & (CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW)) && fabsf(s->shadow - a->s.shadow) > 0.01f) return 32;
    if ((flags & (CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY)) && fabsf(s->occlusion - a->s.occlusion) > 0.01f) return 64;
    if ((flags & CONEMAP_EFFECT_LOD) && fabsf(s->level - a->s.level) > 1e-4f) return 128;
    if ((flags & CONEMAP_EFFECT_FADE) && fabsf(s->fade - a->s.fade) > 1e-4f) return 256;
    return 0;
}

static void runs_as_c(void)
{
    static const int sizes[][2] = {{1, 5}, {17, 13}, {32, 32}, {48, 31}};
    static const int kinds[] = {ZOO_FLAT_1, ZOO_RAMP, ZOO_BRICKS, ZOO_FBM, ZOO_SPIKES, ZOO_CLIFF, ZOO_SADDLE};
    static float heights[MOST * MOST];
    static const float projection[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0.1f, 0.2f, 0.3f, -1, 0, 0, 0.1f, 4};
    int n, m, size, k, rays = 0;
    for (n = 0; n < SETS; ++n) {
        const struct set *set = &sets[n];
        struct zoo_random random = zoo_seed(11 + (uint64_t)n);
        int all = 0, hits = 0, different = 0, unexplained = 0, mask = 0;
        for (m = 0; m < (int)(sizeof kinds / sizeof kinds[0]); ++m)
            for (size = 0; size < 4; ++size) {
                const int w = sizes[size][0], h = sizes[size][1], levels = size == 0 ? 1 : LEVELS;
                conemap_desc desc;
                memset(&desc, 0, sizeof desc);
                zoo_fill(kinds[m], w, h, 5, heights);
                desc.heights.pixels = heights;
                desc.heights.width = w;
                desc.heights.height = h;
                desc.wrap_u = set->wrap_u;
                desc.wrap_v = set->wrap_v;
                desc.aspect = set->aspect;
                desc.texture.encoding = set->encoding;
                for (k = 0; k < w * h; ++k) bound.alpha[k] = (k % w / 3 + k / w / 3) % 3 == 0 ? 0 : 255;
                REQUIRE(conemap_build_levels(&desc, bound.levels, levels) == CONEMAP_OK, "build");
                for (k = 0; k < 30; ++k) {
                    conemap_effects e;
                    conemap_frame frame;
                    conemap_gradient gradient;
                    conemap_ray ray;
                    conemap_hit hit;
                    conemap_shading shading;
                    struct job job;
                    struct answer answer;
                    float fine = zoo_unit(&random);
                    int what, tries;
                    memset(&e, 0, sizeof e);
                    memset(&shading, 0, sizeof shading);
                    random_frame(&random, set, &frame);
                    random_ray(&random, &frame, (set->flags & CONEMAP_EFFECT_TWO_SIDED) != 0, &ray);
                    if (set->t_range) {
                        ray.t_min = 0.2f;
                        ray.t_max = 3.0f;
                    }
                    gradient.dudx = fine * 0.2f;
                    gradient.dvdx = 0.02f * zoo_unit(&random);
                    gradient.dudy = 0.02f * zoo_unit(&random);
                    gradient.dvdy = fine * fine * 0.2f;
                    e.flags = set->flags;
                    e.frames = &frame;
                    e.gradients = &gradient;
                    e.clip[0] = 0.1f, e.clip[1] = -0.3f, e.clip[2] = 0.9f, e.clip[3] = 1.4f;
                    e.alpha = bound.alpha;
                    e.levels = bound.levels;
                    e.level_count = levels;
                    e.lod_steps = 40;
                    e.fade_begin = 1.5f;
                    e.fade_end = 0.5f;
                    e.view_projection = projection;
                    e.light[0] = signed_unit(&random), e.light[1] = signed_unit(&random), e.light[2] = 0.2f + zoo_unit(&random);
                    e.light_is_point = zoo_below(&random, 2);
                    e.light_radius = 0.05f;
                    e.sky_directions = 5;
                    e.sky_reach = zoo_below(&random, 2) ? 0.5f : 0.0f;
                    job.e = &e;
                    job.frame = &frame;
                    job.gradient = &gradient;
                    job.ray = &ray;
                    REQUIRE(conemap_shade(&bound.levels[0], NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "%s: shade",
                            set->prefix);
                    answer = set->run(&job);
                    ++all;
                    hits += answer.found;
                    what = differs(set->flags, &hit, &shading, &answer);
                    if (!what) continue;
                    ++different;
                    /* on an edge? then a ray a hair beside gets that answer */
                    for (tries = 0; what && tries < 400; ++tries) {
                        conemap_ray beside = ray;
                        float hair = tries < 100 ? 1e-5f : tries < 250 ? 1e-4f : 1e-3f;
                        int axis;
                        for (axis = 0; axis < 3; ++axis) beside.origin[axis] += hair * signed_unit(&random);
                        conemap_shade(&bound.levels[0], NULL, &e, &beside, &hit, &shading, 1);
                        if ((hit.status == CONEMAP_HIT || hit.status == CONEMAP_STEP_CAP) && answer.found) { /* it moved by a hair */
                            if (fabsf(hit.t - answer.t) < 1e-2f) hit.t = answer.t;
                            if (fabsf(hit.u - answer.box[0]) < 1e-2f) hit.u = answer.box[0];
                            if (fabsf(hit.v - answer.box[1]) < 1e-2f) hit.v = answer.box[1];
                            if (fabsf(hit.z - answer.box[2]) < 1e-2f) hit.z = answer.box[2];
                            memcpy(shading.position, answer.s.position, sizeof shading.position);
                            shading.depth = answer.s.depth;
                        }
                        what = differs(set->flags, &hit, &shading, &answer);
                    }
                    unexplained += what != 0;
                    mask |= what;
                }
                for (k = 0; k < levels; ++k) conemap_free(&bound.levels[k]);
            }
        CHECK(hits * 4 > all, "%s: %d hits of %d", set->prefix, hits, all);
        CHECK(different * 50 < all, "%s: %d of %d differ", set->prefix, different, all);
        CHECK(unexplained == 0, "%s: %d of %d differ off the edges (%x)", set->prefix, unexplained, all, (unsigned)mask);
        if (getenv("SHADING_NOTE")) printf("%s: %d rays, %d hits, %d differ, %d unexplained %x\n", set->prefix, all, hits, different, unexplained, (unsigned)mask);
        rays += all;
    }
    test_note("%d rays in emitted C", rays);
}

const struct test_case shading_tests[] = {
    {"golden files", golden_files},
    {"runs as C", runs_as_c},
    {NULL, NULL},
};
