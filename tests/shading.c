/* Emitted effects: the C dialect against conemap_shade, bad input, and that an effect which is off adds nothing. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

/* ---- the emitted C; each golden file is one set of effects ---- */

enum { LEVELS = 3, MOST = 48 };

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
#define LIT(p)                                                                                                    \
    e.light =                                                                                                     \
        p##_make_vec4(job->e->light[0], job->e->light[1], job->e->light[2], (float)job->e->light_is_point)
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
     CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_POSITION |
         CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_DEPTH | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_OCCLUSION |
         CONEMAP_EFFECT_UV,
     CONEMAP_CLAMP, CONEMAP_WRAP, 0.6f, 0, CONEMAP_LINEAR},
    {"bent_c.h", "bent", bent_run,
     CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE |
         CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_DEPTH |
         CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_UV,
     CONEMAP_WRAP, CONEMAP_WRAP, 1.0f, 0, CONEMAP_SQRT},
    {"sky_c.h", "sky", sky_run,
     CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SKY, CONEMAP_NOTHING,
     CONEMAP_WRAP, 0.5f, 0, CONEMAP_LINEAR},
    {"mip_c.h", "mip", mip_run, CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_SHADOW,
     CONEMAP_CLAMP, CONEMAP_NOTHING, 1.0f, 0, CONEMAP_LINEAR},
    {"sieve_c.h", "sieve", sieve_run, CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW,
     CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 1, CONEMAP_RADIUS},
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
    const unsigned normals = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL;
    const unsigned shadows = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
    const unsigned skies = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY;
    const int found = hit->status == CONEMAP_HIT || hit->status == CONEMAP_STEP_CAP;
    float place[3];
    if (found != a->found) return 1;
    if (!found) return 0;
    put3(place, hit->u, hit->v, hit->z);
    if (fabsf(hit->t - a->t) > 1e-4f || far3(place, a->box, 2e-4f)) return 2;
    if ((flags & CONEMAP_EFFECT_POSITION) && far3(s->position, a->s.position, 3e-4f)) return 4;
    if ((flags & normals) && far3(s->normal, a->s.normal, 5e-3f)) return 8;
    if ((flags & CONEMAP_EFFECT_DEPTH) && fabsf(s->depth - a->s.depth) > 1e-4f) return 16;
    if ((flags & shadows) && fabsf(s->shadow - a->s.shadow) > 0.01f) return 32;
    if ((flags & skies) && fabsf(s->occlusion - a->s.occlusion) > 0.01f) return 64;
    if ((flags & CONEMAP_EFFECT_LOD) && fabsf(s->level - a->s.level) > 1e-4f) return 128;
    if ((flags & CONEMAP_EFFECT_FADE) && fabsf(s->fade - a->s.fade) > 1e-4f) return 256;
    return 0;
}

static const float projection[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0.1f, 0.2f, 0.3f, -1, 0, 0, 0.1f, 4};

struct counts {
    int rays, hits, different, unexplained, what;
};

/* Does conemap_shade give that answer to a ray a hair beside? Then the ray lies on an edge. */
static int on_edge(const struct set *set, const struct job *job, const struct answer *answer, struct zoo_random *random)
{
    int tries, axis;
    for (tries = 0; tries < 400; ++tries) {
        conemap_ray beside = *job->ray;
        conemap_hit hit;
        conemap_shading s;
        const float hair = tries < 100 ? 1e-5f : tries < 250 ? 1e-4f : 1e-3f;
        memset(&s, 0, sizeof s);
        for (axis = 0; axis < 3; ++axis) beside.origin[axis] += hair * signed_unit(random);
        conemap_shade(&bound.levels[0], NULL, job->e, &beside, &hit, &s, 1);
        if (answer->found && fabsf(hit.t - answer->t) < 1e-2f) { /* that it moved by a hair is no difference */
            hit.t = answer->t;
            hit.u = answer->box[0];
            hit.v = answer->box[1];
            hit.z = answer->box[2];
            memcpy(s.position, answer->s.position, sizeof s.position);
            s.depth = answer->s.depth;
        }
        if (!differs(set->flags, &hit, &s, answer)) return 1;
    }
    return 0;
}

static void compare_ray(const struct set *set, int levels, struct zoo_random *random, struct counts *counts)
{
    conemap_effects e;
    conemap_frame frame;
    conemap_gradient gradient;
    conemap_ray ray;
    conemap_hit hit;
    conemap_shading shading;
    struct job job;
    struct answer answer;
    float fine = zoo_unit(random);
    int what;
    memset(&e, 0, sizeof e);
    memset(&shading, 0, sizeof shading);
    random_frame(random, set, &frame);
    random_ray(random, &frame, (set->flags & CONEMAP_EFFECT_TWO_SIDED) != 0, &ray);
    if (set->t_range) {
        ray.t_min = 0.2f;
        ray.t_max = 3.0f;
    }
    gradient.dudx = fine * 0.2f;
    gradient.dvdx = 0.02f * zoo_unit(random);
    gradient.dudy = 0.02f * zoo_unit(random);
    gradient.dvdy = fine * fine * 0.2f;
    e.flags = set->flags;
    e.frames = &frame;
    e.gradients = &gradient;
    e.clip[0] = 0.1f, e.clip[1] = -0.3f, e.clip[2] = 0.9f, e.clip[3] = 1.4f;
    e.alpha = bound.alpha;
    e.levels = bound.levels;
    e.level_count = levels;
    e.lod_steps = 400;
    e.fade_begin = 1.5f;
    e.fade_end = 0.5f;
    e.view_projection = projection;
    e.light[0] = signed_unit(random), e.light[1] = signed_unit(random), e.light[2] = 0.2f + zoo_unit(random);
    e.light_is_point = zoo_below(random, 2);
    e.light_radius = 0.05f;
    e.sky_directions = 5;
    e.sky_reach = zoo_below(random, 2) ? 0.5f : 0.0f;
    job.e = &e;
    job.frame = &frame;
    job.gradient = &gradient;
    job.ray = &ray;
    REQUIRE(conemap_shade(&bound.levels[0], NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "%s: shade", set->prefix);
    answer = set->run(&job);
    what = differs(set->flags, &hit, &shading, &answer);
    ++counts->rays;
    counts->hits += answer.found;
    if (!what) return;
    ++counts->different;
    if (on_edge(set, &job, &answer, random)) return;
    ++counts->unexplained;
    counts->what |= what;
}

static void runs_as_c(void)
{
    static const int sizes[][2] = {{1, 5}, {17, 13}, {32, 32}, {48, 31}};
    static const int kinds[] = {ZOO_FLAT_1, ZOO_RAMP, ZOO_BRICKS, ZOO_FBM, ZOO_SPIKES, ZOO_CLIFF, ZOO_SADDLE};
    static float heights[MOST * MOST];
    int n, m, size, k, rays = 0, different = 0;
    for (n = 0; n < SETS; ++n) {
        const struct set *set = &sets[n];
        struct zoo_random random = zoo_seed(11 + (uint64_t)n);
        struct counts counts;
        memset(&counts, 0, sizeof counts);
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
                for (k = 0; k < 30; ++k) compare_ray(set, levels, &random, &counts);
                for (k = 0; k < levels; ++k) conemap_free(&bound.levels[k]);
            }
        CHECK(counts.hits * 4 > counts.rays, "%s: %d hits of %d", set->prefix, counts.hits, counts.rays);
        CHECK(counts.different * 100 < counts.rays, "%s: %d of %d differ", set->prefix, counts.different, counts.rays);
        CHECK(counts.unexplained == 0, "%s: %d of %d differ off the edges (%x)", set->prefix, counts.unexplained,
              counts.rays, (unsigned)counts.what);
        rays += counts.rays;
        different += counts.different;
    }
    test_note("%d rays in emitted C, %d on edges", rays, different);
}

/* ---- the text: an effect that is off leaves nothing behind, one that is on is there ---- */

static int has_word(const char *text, const char *word)
{
    const size_t length = strlen(word);
    const char *at = text;
    while ((at = strstr(at, word)) != NULL) {
        const char before = at == text ? ' ' : at[-1], after = at[length];
        const int inner = (before >= 'a' && before <= 'z') || before == '_';
        const int more = (after >= 'a' && after <= 'z') || after == '_';
        if (!inner && !more) return 1;
        at += length;
    }
    return 0;
}

/* For each effect a word that only its lines have. */
static const struct {
    unsigned flag;
    const char *word;
} marks[] = {
    {CONEMAP_EFFECT_CLIP, "e.clip.x"},
    {CONEMAP_EFFECT_HOLES, "conemap_alpha"},
    {CONEMAP_EFFECT_CURVED, "curvature"},
    {CONEMAP_EFFECT_LOD, "lod_bias"},
    {CONEMAP_EFFECT_LOD, "conemap_level_size"},
    {CONEMAP_EFFECT_FADE, "conemap_fade_of"},
    {CONEMAP_EFFECT_TWO_SIDED, "toward"},
    {CONEMAP_EFFECT_POSITION, "s.position"},
    {CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL, "s.normal"},
    {CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_OCCLUSION, "conemap_difference"},
    {CONEMAP_EFFECT_DEPTH, "clip_w"},
    {CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW, "conemap_toward"},
    {CONEMAP_EFFECT_SOFT_SHADOW, "conemap_soft_shadow"},
    {CONEMAP_EFFECT_SOFT_SHADOW | CONEMAP_EFFECT_SKY, "conemap_horizon"},
    {CONEMAP_EFFECT_OCCLUSION, "hill"},
    {CONEMAP_EFFECT_SKY, "conemap_sky"},
    {CONEMAP_EFFECT_UV, "conemap_color"},
    {CONEMAP_EFFECT_UV | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE, "gradient"},
    {CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_HOLES, "conemap_fly"},
};

static void off_is_off(void)
{
    int a, b, stage, count = 0;
    unsigned k;
    for (stage = CONEMAP_STAGE_FUNCTIONS; stage <= CONEMAP_STAGE_FRAGMENT; ++stage)
        for (a = 0; a < 15; ++a)
            for (b = a; b < 15; ++b) {
                conemap_shader_desc d;
                size_t size = 0;
                char *text;
                memset(&d, 0, sizeof d);
                d.stage = (conemap_stage)stage;
                d.flags = 1u << a | 1u << b;
                if (conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_UNSUPPORTED) continue;
                text = emit(&d);
                if (!text) return;
                ++count;
                for (k = 0; k < sizeof marks / sizeof marks[0]; ++k) {
                    const int on = (d.flags & marks[k].flag) != 0, there = has_word(text, marks[k].word);
                    CHECK(there == on, "flags %x: %s is %sthere", d.flags, marks[k].word, there ? "" : "not ");
                }
                test_release(text);
            }
    CHECK(count == 2 * (15 * 16 / 2 - 3), "%d texts", count);
}

static void bad_input(void)
{
    static const struct {
        unsigned flags;
        int dialect, stage, tracer, filter, field; /* field: what else is set */
    } cases[] = {
        {1u << 15, 0, 0, 0, 0, 0},
        {0x80000000u, 0, 0, 0, 0, 0},
        {CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL, 0, 0, 0, 0, 0},
        {CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW, 0, 0, 0, 0, 0},
        {CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY, 0, 0, 0, 0, 0},
        {CONEMAP_EFFECT_UV, CONEMAP_GLSL_450, CONEMAP_STAGE_COMPUTE, 0, 0, 0},
        {CONEMAP_EFFECT_NORMAL, CONEMAP_GLSL_450, 0, 0, CONEMAP_FILTER_GATHER, 0},
        {CONEMAP_EFFECT_LOD, CONEMAP_GLSL_450, 0, 0, CONEMAP_FILTER_GATHER, 0},
        {CONEMAP_EFFECT_SHADOW, 0, 0, CONEMAP_TRACE_LINEAR, 0, 0},
        {CONEMAP_EFFECT_CURVED, 0, 0, CONEMAP_TRACE_CELL_MAX, 0, 0},
        {CONEMAP_EFFECT_OCCLUSION, 0, 0, CONEMAP_TRACE_MAXMIP, 0, 0},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 1},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 2},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 3},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 4},
        {CONEMAP_EFFECT_LOD, 0, 0, 0, 0, 5},
        {CONEMAP_EFFECT_LOD, 0, 0, 0, 0, 6},
        {CONEMAP_EFFECT_CURVED, 0, 0, 0, 0, 7},
        {CONEMAP_EFFECT_POSITION, CONEMAP_GLSL_450, CONEMAP_STAGE_FRAGMENT, 0, 0, 8},
        {CONEMAP_EFFECT_DEPTH, CONEMAP_GLSL_450, CONEMAP_STAGE_FUNCTIONS, 0, 0, 8},
        {CONEMAP_EFFECT_DEPTH, CONEMAP_GLSL_330, CONEMAP_STAGE_FRAGMENT, 0, 0, 8},
        {CONEMAP_EFFECT_DEPTH, CONEMAP_ESSL_310, CONEMAP_STAGE_FRAGMENT, 0, 0, 8},
        {CONEMAP_EFFECT_POSITION, 0, 0, 0, 0, 9},
    };
    conemap_shader_desc d;
    size_t size = 7;
    char *text, *whole;
    int k;
    for (k = 0; k < (int)(sizeof cases / sizeof cases[0]); ++k) {
        const int field = cases[k].field;
        conemap_result result;
        memset(&d, 0, sizeof d);
        d.flags = cases[k].flags;
        d.dialect = (conemap_dialect)cases[k].dialect;
        d.stage = (conemap_stage)cases[k].stage;
        d.trace.tracer = (conemap_tracer)cases[k].tracer;
        d.filter = (conemap_filter)cases[k].filter;
        if (field == 1) d.trace.any_hit = 1;
        if (field == 2) d.steps = 1;
        if (field == 3) d.status = 1;
        if (field == 4) d.run_time_cap = 1;
        if (field == 5) d.fixed_size = 1, d.map.width = d.map.height = 64;
        if (field == 6) d.atlas = 1;
        if (field == 7) d.map.guarantee = CONEMAP_GUARANTEE_RELAXED;
        if (field == 8) d.depth_bound = CONEMAP_DEPTH_GREATER;
        if (field == 9) d.map.texture.sectors = 4;
        result = conemap_emit(&d, NULL, 0, &size);
        CHECK(result == CONEMAP_ERROR_UNSUPPORTED && size == 7, "case %d: %s", k, conemap_result_string(result));
    }
    memset(&d, 0, sizeof d);
    d.flags = CONEMAP_EFFECT_DEPTH;
    d.depth_bound = (conemap_depth_bound)CONEMAP_DEPTH_BOUND_COUNT;
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_ENUM, "depth bound");
    d.depth_bound = (conemap_depth_bound)-1;
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_ENUM, "depth bound");
    d.depth_bound = CONEMAP_DEPTH_ANY;
    d.prefix = "relief";
    d.map_name = "curvature"; /* a word of the text, but of no line that is written */
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_OK, "name");
    d.flags |= CONEMAP_EFFECT_CURVED;
    CHECK(conemap_emit(&d, NULL, 0, &size) == CONEMAP_ERROR_PARAMETER, "name");
    d.map_name = NULL;
    whole = emit(&d);
    if (!whole) return;
    for (k = 0; k < 3; ++k) { /* a byte too few writes nothing */
        const size_t needed = strlen(whole) + 1, capacity = k == 0 ? 1 : k == 1 ? needed - 1 : needed;
        conemap_result result;
        text = (char *)test_alloc(capacity);
        text[0] = 'x';
        result = conemap_emit(&d, text, capacity, NULL);
        CHECK(capacity < needed ? result == CONEMAP_ERROR_BUFFER && text[0] == 'x'
                                : result == CONEMAP_OK && strcmp(text, whole) == 0,
              "capacity %d", (int)capacity);
        test_release(text);
    }
    test_release(whole);
}

const struct test_case shading_tests[] = {
    {"off is off", off_is_off},
    {"bad input", bad_input},
    {"golden files", golden_files},
    {"runs as C", runs_as_c},
    {NULL, NULL},
};
