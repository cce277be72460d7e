/* Every tracer against the ground truth: what it promises is demanded, what it does not is counted. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

#define MISS (1.0 / 1048576.0) /* the surface rises more than this above the ray before the reported hit */

static const int sizes[][2] = {{1, 1}, {1, 7}, {2, 2}, {3, 5}, {17, 17}, {31, 20}, {64, 64}};
#define SIZES ((int)(sizeof sizes / sizeof sizes[0]))
#define MAX_TEXELS 4096

struct relief {
    float heights[MAX_TEXELS];
    int kind;
    float max_tan; /* 0: the default */
    conemap_map map;
    struct truth_map truth;
};

static int relief_build(struct relief *r, int kind, const int size[2], int wrap_u, int wrap_v,
                        conemap_generator generator, int min3x3)
{
    conemap_desc desc;
    r->kind = kind;
    zoo_fill(kind, size[0], size[1], 17, r->heights);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = r->heights;
    desc.heights.width = size[0];
    desc.heights.height = size[1];
    desc.wrap_u = (conemap_wrap)wrap_u;
    desc.wrap_v = (conemap_wrap)wrap_v;
    desc.generator = generator;
    desc.min3x3 = min3x3;
    desc.keep_pyramid = 1;
    desc.max_tan = r->max_tan;
    r->truth.width = size[0];
    r->truth.height = size[1];
    r->truth.wrap_u = wrap_u;
    r->truth.wrap_v = wrap_v;
    r->truth.heights = r->heights;
    return CHECK(conemap_build(&desc, &r->map) == CONEMAP_OK, "%s: build", zoo_name(kind));
}

enum ray_kind {
    RAY_ABOVE,
    RAY_SIDE,
    RAY_UPWARD,
    RAY_VERTICAL,
    RAY_HORIZONTAL,
    RAY_INSIDE,
    RAY_GRIDLINE,
    RAY_CORNERS,
    RAY_AXIS,
    RAY_GRAZING,
    RAY_RANGE,
    RAY_KINDS
};

static float unit(struct zoo_random *random)
{
    return zoo_unit(random);
}

/* A ray for this relief; never an endless one. */
static conemap_ray random_ray(struct zoo_random *random, const struct relief *r, int kind)
{
    const int w = r->truth.width, h = r->truth.height;
    conemap_ray ray;
    float target[3], scale = 1.0f;
    int k, axis = zoo_below(random, 2);
    memset(&ray, 0, sizeof ray);
    for (k = 0; k < 3; ++k) {
        ray.origin[k] = unit(random);
        target[k] = unit(random);
    }
    if (kind == RAY_ABOVE) ray.origin[2] += 1.0f;
    if (kind == RAY_SIDE || kind == RAY_RANGE) {
        ray.origin[0] = ray.origin[0] * 2.0f - 0.5f;
        ray.origin[1] = ray.origin[1] * 2.0f - 0.5f;
    }
    if (kind == RAY_INSIDE) ray.origin[2] = ray.origin[2] * 0.6f - 0.2f;
    for (k = 0; k < 3; ++k) ray.direction[k] = target[k] - ray.origin[k];
    switch (kind) {
    case RAY_UPWARD: ray.direction[2] = unit(random) + 0.01f; break;
    case RAY_VERTICAL:
        ray.origin[2] = 2.0f * ray.origin[2];
        ray.direction[0] = ray.direction[1] = 0.0f;
        ray.direction[2] = zoo_below(random, 4) ? -1.0f : 1.0f;
        break;
    case RAY_HORIZONTAL:
        ray.origin[0] = ray.origin[0] * 2.0f - 0.5f;
        ray.direction[2] = 0.0f;
        break;
    case RAY_GRIDLINE:
        ray.origin[axis] = ((float)zoo_below(random, axis ? h : w) + 0.5f) / (float)(axis ? h : w);
        ray.origin[2] += 0.25f;
        ray.direction[axis] = 0.0f;
        break;
    case RAY_CORNERS:
        ray.origin[0] = (float)zoo_below(random, 2);
        ray.origin[1] = (float)zoo_below(random, 2);
        ray.origin[2] = (float)zoo_below(random, 5) * 0.25f;
        ray.direction[0] = 1.0f - 2.0f * ray.origin[0];
        ray.direction[1] = 1.0f - 2.0f * ray.origin[1];
        ray.direction[2] = (float)zoo_below(random, 3) * -0.5f;
        break;
    case RAY_AXIS:
        ray.origin[axis] = zoo_below(random, 2) ? -0.25f : 1.25f;
        ray.direction[axis] = ray.origin[axis] < 0.0f ? 1.0f : -1.0f;
        ray.direction[1 - axis] = zoo_below(random, 3) ? 0.0f : -0.0f;
        ray.direction[2] = (float)(zoo_below(random, 3) - 1) * 0.125f;
        break;
    case RAY_GRAZING: ray.direction[2] = (unit(random) - 0.75f) * 0.04f; break;
    default: break;
    }
    if (ray.direction[0] == 0.0f && ray.direction[1] == 0.0f && ray.direction[2] == 0.0f)
        ray.direction[2] = -1.0f;
    if (kind == RAY_RANGE) {
        ray.t_min = unit(random) * 0.7f;
        ray.t_max = ray.t_min + unit(random) * 0.7f + 1e-3f;
    }
    if (ray.t_max == 0.0f && (r->truth.wrap_u == 1 || r->truth.wrap_v == 1) &&
        fabsf(ray.direction[2]) < 0.01f) {
        const float speed = fabsf(ray.direction[0]) + fabsf(ray.direction[1]);
        ray.t_max = 3.0f / (speed > 0.01f ? speed : 0.01f);
    }
    if (zoo_below(random, 4) == 0) scale = zoo_below(random, 2) ? 1e20f : 1e-20f;
    for (k = 0; k < 3; ++k) ray.direction[k] *= scale;
    ray.t_min /= scale;
    ray.t_max /= scale;
    return ray;
}

struct verdict {
    double o[3], d[3], begin, end; /* the part of the ray that is not below the floor */
    double slack;                  /* how far t may be off for being single precision */
    int truth_hit;
    double truth_t;
};

static struct verdict judge(const struct relief *r, const conemap_ray *ray)
{
    struct verdict v;
    double start[3], horizontal, end;
    int k;
    for (k = 0; k < 3; ++k) {
        v.o[k] = (double)ray->origin[k];
        v.d[k] = (double)ray->direction[k];
        start[k] = v.o[k] + v.d[k] * (double)ray->t_min;
    }
    v.begin = (double)ray->t_min;
    v.end = end = ray->t_max > 0.0f ? (double)ray->t_max : HUGE_VAL;
    v.truth_t = 0.0;
    v.truth_hit = truth_trace(&r->truth, start, v.d, v.end - v.begin, &v.truth_t);
    v.truth_t += v.begin;
    truth_above_floor(v.o, v.d, &v.begin, &end);
    horizontal = sqrt(v.d[0] * v.d[0] + v.d[1] * v.d[1]);
    v.slack = 3e-7 * (horizontal > 0.0 ? 1.0 / horizontal : 0.0);
    return v;
}

static double slack_at(const struct verdict *v, double t)
{
    return 2.0 / 8388608.0 * t + v->slack;
}

/* Clearance of the ray at t, at the most and at the least within what single precision can tell. */
static double clearance_near(const struct relief *r, const struct verdict *v, double t, int most)
{
    const double slack = slack_at(v, t);
    double best = 0.0;
    int k;
    for (k = -1; k <= 1; ++k) {
        const double at = t + k * slack < 0.0 ? 0.0 : t + k * slack;
        const double above =
            v->o[2] + v->d[2] * at - truth_height(&r->truth, v->o[0] + v->d[0] * at, v->o[1] + v->d[1] * at);
        if (k == -1 || (most ? above > best : above < best)) best = above;
    }
    return best;
}

/* Does the surface rise above the ray before what was reported? */
static int is_miss(const struct relief *r, const struct verdict *v, const conemap_hit *hit)
{
    double end = v->end;
    if (!v->truth_hit) return 0;
    if (hit->status == CONEMAP_HIT) {
        end = (double)hit->t;
        end -= slack_at(v, end);
    }
    if (end <= v->begin) return 0; /* the ray begins inside, and that was said */
    return truth_clearance(&r->truth, v->o, v->d, v->begin, end) < -MISS;
}

static const char *describe(const struct relief *r, const conemap_ray *ray)
{
    static char text[400];
    snprintf(text, sizeof text, "%s %dx%d wraps %d %d ray {%.9g, %.9g, %.9g}, {%.9g, %.9g, %.9g}, %.9g, %.9g",
             zoo_name(r->kind), r->truth.width, r->truth.height, r->truth.wrap_u, r->truth.wrap_v,
             (double)ray->origin[0], (double)ray->origin[1], (double)ray->origin[2],
             (double)ray->direction[0], (double)ray->direction[1], (double)ray->direction[2],
             (double)ray->t_min, (double)ray->t_max);
    return text;
}

static conemap_hit trace_one(const struct relief *r, const conemap_trace_desc *desc, const conemap_ray *ray)
{
    conemap_hit hit;
    conemap_result result;
    memset(&hit, 0x7b, sizeof hit);
    result = conemap_trace(&r->map, desc, ray, &hit, 1);
    CHECK(result == CONEMAP_OK, "%s: tracer %d: %s", describe(r, ray), desc ? (int)desc->tracer : 0,
          conemap_result_string(result));
    return hit;
}

static conemap_trace_desc tracer_desc(conemap_tracer tracer)
{
    conemap_trace_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.tracer = tracer;
    return desc;
}

/* What holds for every tracer and every ray. */
static void check_sane(const struct relief *r, const conemap_trace_desc *desc, const conemap_ray *ray,
                       const struct verdict *v, const conemap_hit *hit)
{
    const float p[3] = {hit->u, hit->v, hit->z};
    int k;
    if (!CHECK((unsigned)hit->status < CONEMAP_STATUS_COUNT && hit->status != CONEMAP_INVALID,
               "%s: tracer %d: status %d", describe(r, ray), (int)desc->tracer, (int)hit->status)) {
        return;
    }
    CHECK(hit->steps >= 0, "%s: tracer %d: %d steps", describe(r, ray), (int)desc->tracer, hit->steps);
    if (!CHECK(hit->t >= ray->t_min && hit->t <= 3e38f && (double)hit->t <= v->end * (1.0 + 1e-7),
               "%s: tracer %d: status %d t %g", describe(r, ray), (int)desc->tracer, (int)hit->status,
               (double)hit->t)) {
        return;
    }
    for (k = 0; k < 3; ++k) {
        const double right = v->o[k] + v->d[k] * (double)hit->t;
        const double slack = 3e-7 * (1.0 + fabs(v->o[k]) + fabs(v->d[k] * (double)hit->t));
        CHECK(fabs((double)p[k] - right) <= slack,
              "%s: tracer %d: status %d, coordinate %d is %.9g, right %.9g", describe(r, ray),
              (int)desc->tracer, (int)hit->status, k, (double)p[k], right);
    }
    if (hit->status == CONEMAP_T_MAX) {
        CHECK(hit->t == ray->t_max && ray->t_max > 0.0f,
              "%s: tracer %d: T_MAX at %g", describe(r, ray), (int)desc->tracer, (double)hit->t);
    }
    if (hit->status == CONEMAP_FLOOR) {
        CHECK((r->truth.wrap_u == 2 || r->truth.wrap_v == 2) && fabs((double)hit->z) < 1e-5,
              "%s: tracer %d: a floor at z %g", describe(r, ray), (int)desc->tracer, (double)hit->z);
    }
    if (hit->status == CONEMAP_HIT) {
        CHECK(hit->t_before <= hit->t && hit->t <= hit->t_after && hit->t_before >= ray->t_min,
              "%s: tracer %d: bracket %.9g %.9g %.9g", describe(r, ray), (int)desc->tracer,
              (double)hit->t_before, (double)hit->t, (double)hit->t_after);
    }
    if (hit->inside) {
        CHECK(hit->status == CONEMAP_HIT, "%s: tracer %d: inside, status %d", describe(r, ray),
              (int)desc->tracer, (int)hit->status);
        CHECK(clearance_near(r, v, (double)hit->t, 0) <= MISS, "%s: tracer %d: inside, but %g above",
              describe(r, ray), (int)desc->tracer, clearance_near(r, v, (double)hit->t, 0));
    }
}

/* ---- the exact tracer ---- */

static void check_exact(conemap_tracer tracer, float max_tan)
{
    static struct relief r;
    struct zoo_random random = zoo_seed(41);
    const conemap_trace_desc desc = tracer_desc(tracer);
    int kind, size, wraps, k, rays = 0, hits = 0, misses = 0;
    r.max_tan = max_tan;
    for (kind = 0; kind < ZOO_KINDS; ++kind) {
        for (size = 0; size < SIZES; ++size) {
            for (wraps = 0; wraps < 9; ++wraps) {
                if (!relief_build(&r, kind, sizes[size], wraps / 3, wraps % 3, CONEMAP_QUICK_NAIVE, 0))
                    return;
                for (k = 0; k < 8 * RAY_KINDS; ++k) {
                    const conemap_ray ray = random_ray(&random, &r, k % RAY_KINDS);
                    const struct verdict v = judge(&r, &ray);
                    const conemap_hit hit = trace_one(&r, &desc, &ray);
                    ++rays;
                    hits += hit.status == CONEMAP_HIT;
                    check_sane(&r, &desc, &ray, &v, &hit);
                    CHECK(hit.status != CONEMAP_STEP_CAP, "%s: a step cap without one", describe(&r, &ray));
                    if (is_miss(&r, &v, &hit)) {
                        ++misses;
                        CHECK(0, "%s: missed: status %d t %.9g, right %.9g", describe(&r, &ray),
                              (int)hit.status, (double)hit.t, v.truth_t);
                    }
                    if (hit.status == CONEMAP_HIT) {
                        CHECK(clearance_near(&r, &v, (double)hit.t, 0) <= MISS,
                              "%s: hit %.9g is %g above the surface", describe(&r, &ray), (double)hit.t,
                              clearance_near(&r, &v, (double)hit.t, 0));
                        if (v.truth_hit) {
                            const int began = v.truth_t <= v.begin + 1e-8 / fabs(v.d[2]) ||
                                              truth_clearance(&r.truth, v.o, v.d, v.begin,
                                                              v.truth_t - slack_at(&v, v.truth_t)) > 1e30;
                            const double above = v.o[2] + v.d[2] * v.truth_t -
                                                 truth_height(&r.truth, v.o[0] + v.d[0] * v.truth_t,
                                                              v.o[1] + v.d[1] * v.truth_t);
                            if (began && above < -1e-6) {
                                CHECK(hit.inside, "%s: entered below the surface at %.9g, not said",
                                      describe(&r, &ray), (double)hit.t);
                            } else if (!began && (double)hit.t > v.truth_t * (1.0 - 1e-6) && hit.z < 0.999f) {
                                CHECK(!hit.inside, "%s: said to enter below the surface", describe(&r, &ray));
                            }
                        }
                    } else {
                        CHECK(hit.status != CONEMAP_T_MAX || ray.t_max > 0.0f, "%s: T_MAX without t_max",
                              describe(&r, &ray));
                    }
                }
                conemap_free(&r.map);
            }
        }
    }
    CHECK(hits > rays / 4 && hits < rays * 9 / 10, "%d hits of %d rays", hits, rays);
    test_note("%s misses %d of %d rays", tracer == CONEMAP_TRACE_EXACT ? "exact" : "maxmip", misses, rays);
}

static void exact_over_maxima(void)
{
    check_exact(CONEMAP_TRACE_MAXMIP, 0.0f);
}

/* Cones so narrow that they hold no part of any patch: whatever is missed then is the tracer's own fault. */
static void exact_over_narrow_cones(void)
{
    check_exact(CONEMAP_TRACE_EXACT, 1.0f / 65536.0f);
}

/* Where a ray ends without a hit. */
static void ends(void)
{
    static struct relief r;
    static const int size[2] = {8, 8};
    int tracer, wrap;
    for (wrap = 0; wrap < 3; ++wrap) {
        if (!relief_build(&r, ZOO_FLAT_0, size, wrap, wrap, CONEMAP_RING, 0)) return;
        for (tracer = 0; tracer < CONEMAP_TRACER_COUNT; ++tracer) {
            conemap_trace_desc desc = tracer_desc((conemap_tracer)tracer);
            conemap_ray up = {{0.5f, 0.5f, 0.5f}, {0.125f, 0.0f, 1.0f}, 0.0f, 0.0f};
            conemap_ray aside = {{0.5f, 0.5f, 0.5f}, {1.0f, 0.0f, 0.0f}, 0.0f, 0.0f};
            conemap_ray never = {{-0.5f, 3.0f, 0.5f}, {0.0f, 1.0f, -0.125f}, 0.0f, 0.0f};
            conemap_ray outer = {{0.03125f, 0.5f, 1.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
            conemap_ray through = {{0.03125f, 0.5f, 0.125f}, {0.0625f, 0.0f, -1.0f}, 0.0f, 0.0f};
            conemap_ray limited = {{0.5f, 0.5f, 0.5f}, {0.25f, 0.0f, -0.25f}, 0.0f, 1.0f};
            conemap_hit hit;
            if (tracer == CONEMAP_TRACE_LOOP || tracer == CONEMAP_TRACE_LINEAR) desc.max_steps = 2000;
            hit = trace_one(&r, &desc, &up);
            CHECK(hit.status == CONEMAP_LEFT || tracer == CONEMAP_TRACE_FIXED, "tracer %d: upward: status %d",
                  tracer, (int)hit.status);
            hit = trace_one(&r, &desc, &limited);
            CHECK((hit.status == CONEMAP_T_MAX && hit.t == 1.0f) || tracer == CONEMAP_TRACE_FIXED,
                  "tracer %d: limited: status %d", tracer, (int)hit.status);
            hit = trace_one(&r, &desc, &outer);
            if (wrap == 2) {
                CHECK(hit.status == CONEMAP_FLOOR && fabsf(hit.t - 1.0f) < 1e-5f,
                      "tracer %d: in the outer half texel: status %d t %g", tracer, (int)hit.status,
                      (double)hit.t);
                hit = trace_one(&r, &desc, &through);
                CHECK(hit.status == CONEMAP_FLOOR && fabsf(hit.t - 0.125f) < 1e-5f,
                      "tracer %d: through the outer half texel: status %d t %g", tracer, (int)hit.status,
                      (double)hit.t);
            } else {
                CHECK(hit.status == CONEMAP_HIT &&
                          fabsf(hit.t - 1.0f) < (tracer == CONEMAP_TRACE_EXACT_STEP ? 0.126f : 1e-2f),
                      "tracer %d: in the outer half texel: status %d t %g", tracer, (int)hit.status,
                      (double)hit.t);
            }
            if (wrap != 1) {
                hit = trace_one(&r, &desc, &aside);
                CHECK(hit.status == CONEMAP_LEFT || tracer == CONEMAP_TRACE_FIXED,
                      "tracer %d: aside: status %d", tracer, (int)hit.status);
                hit = trace_one(&r, &desc, &never);
                CHECK(hit.status == CONEMAP_LEFT, "tracer %d: never: status %d", tracer, (int)hit.status);
            } else if (tracer != CONEMAP_TRACE_FIXED && tracer != CONEMAP_TRACE_LOOP &&
                       tracer != CONEMAP_TRACE_LINEAR) {
                hit = trace_one(&r, &desc, &aside);
                CHECK(hit.status == CONEMAP_STEP_CAP && hit.u > 1000.0f, "tracer %d: endless: status %d u %g",
                      tracer, (int)hit.status, (double)hit.u);
                desc.max_steps = 50;
                hit = trace_one(&r, &desc, &aside);
                CHECK(hit.status == CONEMAP_STEP_CAP && hit.steps <= 50,
                      "tracer %d: endless with a cap: status %d", tracer, (int)hit.status);
            }
        }
        conemap_free(&r.map);
    }
}

static void verticals(void)
{
    static struct relief r;
    struct zoo_random random = zoo_seed(43);
    int kind, size, tracer, k;
    for (kind = 0; kind < ZOO_KINDS; ++kind) {
        for (size = 0; size < SIZES; ++size) {
            if (!relief_build(&r, kind, sizes[size], size % 3, kind % 2, CONEMAP_RING, 0)) return;
            for (tracer = 0; tracer < CONEMAP_TRACER_COUNT; ++tracer) {
                for (k = 0; k < 6; ++k) {
                    conemap_trace_desc desc = tracer_desc((conemap_tracer)tracer);
                    conemap_ray ray = {{0.0f, 0.0f, 1.25f}, {0.0f, 0.0f, -2.0f}, 0.0f, 0.0f};
                    conemap_hit hit;
                    struct verdict v;
                    double allowed = 3e-6;
                    desc.refinement = (conemap_refinement)(k % 3);
                    desc.refine_steps = 30;
                    ray.origin[0] = k == 5 ? 0.5f : 0.1f + 0.8f * unit(&random);
                    ray.origin[1] = k == 5 ? 0.5f : 0.1f + 0.8f * unit(&random);
                    if (sizes[size][0] < 17) ray.origin[0] = 0.5f;
                    if (sizes[size][1] < 17) ray.origin[1] = 0.5f;
                    v = judge(&r, &ray);
                    hit = trace_one(&r, &desc, &ray);
                    check_sane(&r, &desc, &ray, &v, &hit);
                    if (tracer == CONEMAP_TRACE_LINEAR) allowed = 1.3 / 200.0;
                    if (tracer == CONEMAP_TRACE_FIXED || tracer == CONEMAP_TRACE_LOOP) allowed = 1.0 / 256.0;
                    if (tracer == CONEMAP_TRACE_EXACT_STEP)
                        allowed = 2.5; /* a texel's width, and maps of one texel */
                    if (desc.refinement == CONEMAP_REFINE_NONE && tracer != CONEMAP_TRACE_EXACT_STEP &&
                        (double)hit.t > v.truth_t) {
                        allowed = 2.5; /* unrefined: somewhere below */
                    }
                    CHECK(hit.status == CONEMAP_HIT && v.truth_hit &&
                              fabs((double)hit.t - v.truth_t) * 2.0 <= allowed,
                          "%s: tracer %d refinement %d: status %d t %g, right %g", describe(&r, &ray), tracer,
                          (int)desc.refinement, (int)hit.status, (double)hit.t, v.truth_t);
                }
            }
            conemap_free(&r.map);
        }
    }
}

/* A direction times a power of two: the same point to the bit, t over that power. */
static void scaled_directions(void)
{
    static struct relief r;
    static const int powers[] = {-60, -10, -1, 1, 7, 60};
    struct zoo_random random = zoo_seed(44);
    int round, tracer, k, p, c;
    for (round = 0; round < 60; ++round) {
        const int wrap_u = zoo_below(&random, 3), wrap_v = zoo_below(&random, 3);
        if (!relief_build(&r, round % ZOO_KINDS, sizes[zoo_below(&random, SIZES)], wrap_u, wrap_v,
                          CONEMAP_QUICK, 1)) {
            return;
        }
        for (k = 0; k < RAY_KINDS; ++k) {
            conemap_ray ray = random_ray(&random, &r, k);
            for (c = 0; c < 3; ++c) {
                if (fabsf(ray.direction[c]) > 1e10f ||
                    (ray.direction[c] != 0.0f && fabsf(ray.direction[c]) < 1e-10f)) {
                    break;
                }
            }
            if (c < 3) continue;
            for (tracer = 1; tracer < CONEMAP_TRACER_COUNT; ++tracer) {
                conemap_trace_desc desc = tracer_desc((conemap_tracer)tracer);
                conemap_hit right;
                desc.refinement = (conemap_refinement)zoo_below(&random, 3);
                right = trace_one(&r, &desc, &ray);
                for (p = 0; p < 6; ++p) {
                    conemap_ray scaled = ray;
                    conemap_hit hit;
                    for (c = 0; c < 3; ++c) scaled.direction[c] = ldexpf(ray.direction[c], powers[p]);
                    scaled.t_min = ldexpf(ray.t_min, -powers[p]);
                    scaled.t_max = ldexpf(ray.t_max, -powers[p]);
                    hit = trace_one(&r, &desc, &scaled);
                    CHECK(hit.status == right.status && hit.inside == right.inside &&
                              hit.steps == right.steps && hit.u == right.u && hit.v == right.v &&
                              hit.z == right.z && hit.t == ldexpf(right.t, -powers[p]) &&
                              hit.t_before == ldexpf(right.t_before, -powers[p]) &&
                              hit.t_after == ldexpf(right.t_after, -powers[p]),
                          "%s: tracer %d times 2^%d: status %d (%.9g, %.9g), right %d (%.9g, %.9g)",
                          describe(&r, &ray), tracer, powers[p], (int)hit.status, (double)hit.u,
                          (double)hit.v, (int)right.status, (double)right.u, (double)right.v);
                }
            }
        }
        conemap_free(&r.map);
    }
}

/* ---- steps ---- */

static void step_bounds(void)
{
    static struct relief r;
    struct zoo_random random = zoo_seed(45);
    static const conemap_generator generators[] = {CONEMAP_RING, CONEMAP_QUICK_NAIVE, CONEMAP_RELAXED};
    int kind, size, g, k, wraps;
    for (kind = 0; kind < ZOO_KINDS; ++kind) {
        for (size = 0; size < SIZES; ++size) {
            for (g = 0; g < 3; ++g) {
                wraps = zoo_below(&random, 9);
                if (size == 6 && g == 2) continue;
                if (!relief_build(&r, kind, sizes[size], wraps / 3, wraps % 3, generators[g], g & 1)) return;
                for (k = 0; k < 3 * RAY_KINDS; ++k) {
                    const conemap_ray ray = random_ray(&random, &r, k % RAY_KINDS);
                    const struct verdict v = judge(&r, &ray);
                    int tracer;
                    for (tracer = 0; tracer < CONEMAP_TRACER_COUNT; ++tracer) {
                        conemap_trace_desc desc = tracer_desc((conemap_tracer)tracer);
                        conemap_hit hit = trace_one(&r, &desc, &ray), again;
                        const int cells = sizes[size][0] + sizes[size][1] + 3;
                        check_sane(&r, &desc, &ray, &v, &hit);
                        if (tracer == CONEMAP_TRACE_FIXED) {
                            CHECK(hit.steps <= 10, "%s: %d fixed steps", describe(&r, &ray), hit.steps);
                            continue;
                        }
                        if (tracer == CONEMAP_TRACE_LINEAR) {
                            CHECK(hit.steps <= 201, "%s: %d linear steps", describe(&r, &ray), hit.steps);
                            continue;
                        }
                        if (tracer == CONEMAP_TRACE_LOOP) {
                            CHECK(hit.steps <= 20, "%s: %d loop steps", describe(&r, &ray), hit.steps);
                            continue;
                        }
                        CHECK(hit.status != CONEMAP_STEP_CAP, "%s: tracer %d: a step cap without one",
                              describe(&r, &ray), tracer);
                        if (r.truth.wrap_u != 1 && r.truth.wrap_v != 1 &&
                            (tracer == CONEMAP_TRACE_CELL_MAX || tracer == CONEMAP_TRACE_DEFAULT)) {
                            CHECK(hit.steps <= cells, "%s: %d cell steps", describe(&r, &ray), hit.steps);
                        }
                        if (hit.steps < 1) continue;
                        desc.max_steps = hit.steps; /* the last allowed step is as good as any */
                        again = trace_one(&r, &desc, &ray);
                        CHECK(again.status == hit.status && again.t == hit.t && again.steps == hit.steps,
                              "%s: tracer %d: %d steps end with status %d t %.9g, a cap of as many with %d t "
                              "%.9g",
                              describe(&r, &ray), tracer, hit.steps, (int)hit.status, (double)hit.t,
                              (int)again.status, (double)again.t);
                        if (hit.steps < 2) continue;
                        desc.max_steps = hit.steps - 1;
                        again = trace_one(&r, &desc, &ray);
                        CHECK(again.status == CONEMAP_STEP_CAP && again.steps <= desc.max_steps &&
                                  again.t <= hit.t_after * 1.000001f,
                              "%s: tracer %d: one step less of %d: status %d t %.9g steps %d",
                              describe(&r, &ray), tracer, hit.steps, (int)again.status, (double)again.t,
                              again.steps);
                    }
                }
                conemap_free(&r.map);
            }
        }
    }
}

/* Thousands of cells on a wrapping map: positions lose their low bits, the walk must not lose its way. */
static void long_walks(void)
{
    static struct relief r;
    static const int size[2] = {64, 64};
    static const conemap_tracer tracers[] = {CONEMAP_TRACE_CELL_MAX, CONEMAP_TRACE_MAXMIP, CONEMAP_TRACE_QDM};
    struct zoo_random random = zoo_seed(50);
    conemap_desc desc;
    int k, tracer;
    r.kind = ZOO_WHITE;
    zoo_fill(ZOO_WHITE, 64, 64, 17, r.heights);
    for (k = 0; k < MAX_TEXELS; ++k) r.heights[k] *= 0.5f;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = r.heights;
    desc.heights.width = size[0];
    desc.heights.height = size[1];
    desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    desc.max_tan = 1e-4f; /* no cone reaches as far as a cell */
    desc.keep_pyramid = 1;
    r.truth.width = size[0];
    r.truth.height = size[1];
    r.truth.wrap_u = r.truth.wrap_v = 1;
    r.truth.heights = r.heights;
    REQUIRE(conemap_build(&desc, &r.map) == CONEMAP_OK, "build");
    for (k = 0; k < 60; ++k) {
        conemap_ray ray = {{0.5f, 0.5f, 0.75f}, {0.0f, 0.0f, 0.0f}, 0.0f, 40.0f};
        double cells;
        ray.origin[0] = unit(&random);
        ray.origin[1] = k % 5 ? unit(&random) : ray.origin[0];
        ray.direction[0] = zoo_between(&random, -1.0f, 1.0f);
        ray.direction[1] = k % 5 ? zoo_between(&random, -1.0f, 1.0f) : ray.direction[0];
        if (k % 7 == 1) ray.direction[1] = ray.direction[0] * 1e-4f;
        if (k & 1) ray.direction[2] = -0.02f;
        cells = (fabs((double)ray.direction[0]) + fabs((double)ray.direction[1])) * 64.0 * 40.0 + 4.0;
        for (tracer = 0; tracer < 3; ++tracer) {
            const conemap_trace_desc trace = tracer_desc(tracers[tracer]);
            const struct verdict v = judge(&r, &ray);
            const conemap_hit hit = trace_one(&r, &trace, &ray);
            check_sane(&r, &trace, &ray, &v, &hit);
            CHECK(hit.status == (v.truth_hit ? CONEMAP_HIT : CONEMAP_T_MAX), "%s: tracer %d: status %d",
                  describe(&r, &ray), (int)trace.tracer, (int)hit.status);
            CHECK(hit.steps <= cells * (trace.tracer == CONEMAP_TRACE_CELL_MAX ? 1.0 : 8.0),
                  "%s: tracer %d: %d steps for %g cells", describe(&r, &ray), (int)trace.tracer, hit.steps,
                  cells);
            if (hit.status == CONEMAP_HIT && trace.tracer == CONEMAP_TRACE_MAXMIP) {
                /* 2^-24 of the way from where the ray entered, in cells as steep as 32 */
                CHECK(fabs(((double)hit.t - v.truth_t) * (double)ray.direction[2]) < 0.01,
                      "%s: t %.9g, right %.9g", describe(&r, &ray), (double)hit.t, v.truth_t);
            }
        }
    }
    conemap_free(&r.map);
}

/* ---- counts ---- */

/* Misses and errors of a tracer over dense maps; descending rays from above. */
static int count_misses(struct relief *r, const conemap_trace_desc *settings, int rays, int *far_off)
{
    conemap_trace_desc bisecting = *settings,
                       *desc = &bisecting; /* a hit is then at the end of its bracket */
    struct zoo_random random = zoo_seed(46);
    int k, misses = 0;
    bisecting.refinement = CONEMAP_REFINE_BISECT;
    bisecting.refine_steps = 30;
    for (k = 0; k < rays; ++k) {
        conemap_ray ray = random_ray(&random, r, k & 1 ? RAY_ABOVE : RAY_SIDE);
        struct verdict v;
        conemap_hit hit;
        if (ray.direction[2] > -0.01f * fabsf(ray.direction[0])) continue;
        v = judge(r, &ray);
        hit = trace_one(r, desc, &ray);
        check_sane(r, desc, &ray, &v, &hit);
        misses += is_miss(r, &v, &hit);
        if (hit.status == CONEMAP_HIT && !hit.inside && far_off) {
            *far_off += clearance_near(r, &v, (double)hit.t, 0) > MISS ||
                        clearance_near(r, &v, (double)hit.t, 1) < -MISS;
        }
    }
    return misses;
}

static void unsafe_tracers_miss(void)
{
    static struct relief r;
    static const int size[2] = {64, 64};
    static const int kinds[] = {ZOO_SPIKES, ZOO_WHITE};
    int kind, tracer;
    int misses[CONEMAP_TRACER_COUNT], off[CONEMAP_TRACER_COUNT];
    memset(misses, 0, sizeof misses);
    memset(off, 0, sizeof off);
    for (kind = 0; kind < 2; ++kind) {
        if (!relief_build(&r, kinds[kind], size, 0, 0, CONEMAP_RING, 0)) return;
        for (tracer = 1; tracer < CONEMAP_TRACER_COUNT; ++tracer) {
            const conemap_trace_desc desc = tracer_desc((conemap_tracer)tracer);
            misses[tracer] += count_misses(&r, &desc, 2000, &off[tracer]);
        }
        conemap_free(&r.map);
    }
    CHECK(misses[CONEMAP_TRACE_LINEAR] > 0, "linear misses nothing");
    CHECK(misses[CONEMAP_TRACE_EXACT_STEP] > 0, "exact step misses nothing");
    CHECK(misses[CONEMAP_TRACE_CELL_MAX] > 0, "cell max misses nothing");
    CHECK(misses[CONEMAP_TRACE_CELL_MAX] < 4000 / 4, "cell max misses %d", misses[CONEMAP_TRACE_CELL_MAX]);
    CHECK(misses[CONEMAP_TRACE_QDM] + off[CONEMAP_TRACE_QDM] > 0, "qdm is exact");
    CHECK(misses[CONEMAP_TRACE_MAXMIP] == 0 && off[CONEMAP_TRACE_MAXMIP] == 0, "maxmip misses %d, off %d",
          misses[CONEMAP_TRACE_MAXMIP], off[CONEMAP_TRACE_MAXMIP]);
    test_note("misses of 4000: linear %d, fixed %d, loop %d, exact step %d, cell max %d, exact %d, maxmip "
              "%d, qdm %d",
              misses[CONEMAP_TRACE_LINEAR], misses[CONEMAP_TRACE_FIXED], misses[CONEMAP_TRACE_LOOP],
              misses[CONEMAP_TRACE_EXACT_STEP], misses[CONEMAP_TRACE_CELL_MAX], misses[CONEMAP_TRACE_EXACT],
              misses[CONEMAP_TRACE_MAXMIP], misses[CONEMAP_TRACE_QDM]);
}

/* The 3 x 3 minimum makes cone steps fail more rarely [BV24 section 4], solving cells more rarely still. */
static void correction_helps(void)
{
    static struct relief r;
    static const int size[2] = {64, 64};
    static const int kinds[] = {ZOO_FBM, ZOO_WHITE, ZOO_BRICKS};
    static const conemap_tracer tracers[2] = {CONEMAP_TRACE_CELL_MAX, CONEMAP_TRACE_EXACT};
    int kind, corrected, t, misses[2][2] = {{0, 0}, {0, 0}};
    for (kind = 0; kind < 3; ++kind) {
        for (corrected = 0; corrected < 2; ++corrected) {
            if (!relief_build(&r, kinds[kind], size, 0, 0, CONEMAP_RING, corrected)) return;
            for (t = 0; t < 2; ++t) {
                const conemap_trace_desc desc = tracer_desc(tracers[t]);
                misses[t][corrected] += count_misses(&r, &desc, 3000, NULL);
            }
            conemap_free(&r.map);
        }
    }
    CHECK(misses[0][0] > 2 * misses[0][1], "cell max: %d misses, corrected %d", misses[0][0], misses[0][1]);
    CHECK(misses[0][1] < 9000 / 40, "cell max, corrected: %d misses", misses[0][1]);
    CHECK(misses[1][1] < misses[0][1], "exact: %d misses, corrected %d", misses[1][0], misses[1][1]);
    test_note("of 9000: cell max %d, with min3x3 %d; exact %d, with min3x3 %d", misses[0][0], misses[0][1],
              misses[1][0], misses[1][1]);
}

/* Reported hits are where they are said to be, for every tracer and refinement. */
static void hits_are_hits(void)
{
    static struct relief r;
    struct zoo_random random = zoo_seed(47);
    int kind, size, wraps, k, tracer, refinement, hits = 0;
    for (kind = 0; kind < ZOO_KINDS; ++kind) {
        for (size = 3; size < SIZES; ++size) {
            wraps = zoo_below(&random, 9);
            if (!relief_build(&r, kind, sizes[size], wraps / 3, wraps % 3, CONEMAP_RING, 1)) return;
            for (k = 0; k < 6 * RAY_KINDS; ++k) {
                const conemap_ray ray = random_ray(&random, &r, k % RAY_KINDS);
                const struct verdict v = judge(&r, &ray);
                for (tracer = 1; tracer < CONEMAP_TRACER_COUNT; ++tracer) {
                    for (refinement = 0; refinement < CONEMAP_REFINEMENT_COUNT; ++refinement) {
                        conemap_trace_desc desc = tracer_desc((conemap_tracer)tracer);
                        const double tolerance =
                            tracer == CONEMAP_TRACE_FIXED || tracer == CONEMAP_TRACE_LOOP ? 1.0 / 256.0 : 0.0;
                        conemap_hit hit;
                        desc.refinement = (conemap_refinement)refinement;
                        desc.refine_steps = 30;
                        hit = trace_one(&r, &desc, &ray);
                        check_sane(&r, &desc, &ray, &v, &hit);
                        if (hit.status != CONEMAP_HIT) continue;
                        ++hits;
                        if (tracer == CONEMAP_TRACE_QDM) continue; /* linear in its last cell */
                        CHECK(clearance_near(&r, &v, (double)hit.t_after, 0) <= tolerance + MISS,
                              "%s: tracer %d refinement %d: %g above the surface after the hit",
                              describe(&r, &ray), tracer, refinement,
                              clearance_near(&r, &v, (double)hit.t_after, 0));
                        if (hit.inside) continue;
                        if (hit.t_before < hit.t_after) {
                            CHECK(clearance_near(&r, &v, (double)hit.t_before, 1) >= -MISS,
                                  "%s: tracer %d refinement %d: %g under the surface before the hit",
                                  describe(&r, &ray), tracer, refinement,
                                  clearance_near(&r, &v, (double)hit.t_before, 1));
                        }
                        if (refinement == CONEMAP_REFINE_BISECT) {
                            CHECK(fabs(clearance_near(&r, &v, (double)hit.t, 0)) <= tolerance + MISS ||
                                      clearance_near(&r, &v, (double)hit.t, 0) *
                                              clearance_near(&r, &v, (double)hit.t, 1) <=
                                          0.0,
                                  "%s: tracer %d bisected: %g above the surface", describe(&r, &ray), tracer,
                                  clearance_near(&r, &v, (double)hit.t, 0));
                        }
                    }
                }
            }
            conemap_free(&r.map);
        }
    }
    CHECK(hits > 10000, "%d hits", hits);
}

/* Descending rays over relaxed cones: bisection finds the hit where vertex cones would do no harm. */
static void relaxed_cones_and_bisection(void)
{
    static struct relief r;
    static const int size[2] = {64, 64};
    static const int kinds[] = {ZOO_FBM, ZOO_RAMP, ZOO_SADDLE, ZOO_CLIFF};
    conemap_trace_desc desc = tracer_desc(CONEMAP_TRACE_CELL_MAX);
    int kind, misses = 0;
    desc.refinement = CONEMAP_REFINE_BISECT;
    desc.refine_steps = 30;
    for (kind = 0; kind < 4; ++kind) {
        if (!relief_build(&r, kinds[kind], size, 0, 0, CONEMAP_RELAXED, 1)) return;
        misses += count_misses(&r, &desc, 2000, NULL);
        conemap_free(&r.map);
    }
    CHECK(misses < 8000 / 50, "%d misses of 8000", misses);
    test_note("relaxed and bisected %d of 8000", misses);
}

static void options(void)
{
    static struct relief r;
    static const int size[2] = {31, 20};
    struct zoo_random random = zoo_seed(48);
    int k, faster = 0;
    if (!relief_build(&r, ZOO_FBM, size, 0, 0, CONEMAP_RING, 1)) return;
    for (k = 0; k < 200; ++k) {
        const conemap_ray ray = random_ray(&random, &r, RAY_ABOVE);
        conemap_trace_desc desc = tracer_desc(CONEMAP_TRACE_EXACT),
                           other = tracer_desc(CONEMAP_TRACE_DEFAULT);
        conemap_hit hit = trace_one(&r, &desc, &ray), again = trace_one(&r, &other, &ray);
        CHECK(!memcmp(&hit.t, &again.t, sizeof hit.t) && hit.steps == again.steps, "exact is the default");
        again = trace_one(&r, NULL, &ray);
        CHECK(hit.t == again.t && hit.steps == again.steps, "no desc means the defaults");
        desc = tracer_desc(CONEMAP_TRACE_CELL_MAX);
        hit = trace_one(&r, &desc, &ray);
        desc.step_scale = 1.0f;
        again = trace_one(&r, &desc, &ray);
        CHECK(hit.t == again.t && hit.steps == again.steps, "a scale of 1 is the default");
        desc.step_scale = 4.0f;
        again = trace_one(&r, &desc, &ray);
        faster += again.steps < hit.steps;
        desc = tracer_desc(CONEMAP_TRACE_LOOP);
        desc.max_steps = 10;
        desc.adaptive_steps = 1;
        again = trace_one(&r, &desc, &ray);
        CHECK(again.steps <= 15, "adaptive: %d steps of 10", again.steps);
        desc = tracer_desc(CONEMAP_TRACE_LINEAR);
        desc.max_steps = 7;
        again = trace_one(&r, &desc, &ray);
        CHECK(again.steps <= 8, "linear: %d steps of 7", again.steps);
    }
    CHECK(faster > 0, "scaled steps are never fewer");
    conemap_free(&r.map);
}

/* Many rays at once are the rays one by one; a bad one among them does not hurt the others. */
static void batches(void)
{
    static struct relief r;
    static const int size[2] = {17, 17};
    struct zoo_random random = zoo_seed(49);
    conemap_ray rays[64];
    conemap_hit *hits = (conemap_hit *)test_alloc(64 * sizeof *hits);
    int k;
    if (!relief_build(&r, ZOO_WHITE, size, 0, 1, CONEMAP_QUICK, 0)) return;
    for (k = 0; k < 64; ++k) rays[k] = random_ray(&random, &r, k % RAY_KINDS);
    CHECK(conemap_trace(&r.map, NULL, rays, hits, 64) == CONEMAP_OK, "64 rays");
    for (k = 0; k < 64; ++k) {
        const conemap_hit hit = trace_one(&r, NULL, &rays[k]);
        CHECK(hit.status == hits[k].status && hit.t == hits[k].t && hit.steps == hits[k].steps,
              "ray %d of many", k);
    }
    rays[5].direction[1] = nanf("");
    rays[9].origin[1] = HUGE_VALF;
    CHECK(conemap_trace(&r.map, NULL, rays, hits, 64) == CONEMAP_ERROR_RAY_DIRECTION,
          "the first bad ray decides");
    for (k = 0; k < 64; ++k) {
        if (k == 5 || k == 9) {
            CHECK(hits[k].status == CONEMAP_INVALID, "ray %d is invalid", k);
        } else {
            const conemap_hit hit = trace_one(&r, NULL, &rays[k]);
            CHECK(hit.status == hits[k].status && hit.t == hits[k].t, "ray %d beside bad ones", k);
        }
    }
    memset(hits, 0x11, 64 * sizeof *hits);
    CHECK(conemap_trace(&r.map, NULL, rays, hits, 0) == CONEMAP_OK, "no rays");
    CHECK(((unsigned char *)hits)[0] == 0x11, "no rays, yet written");
    test_release(hits);
    conemap_free(&r.map);
}

const struct test_case tracers_tests[] = {
    {"exact over maxima misses nothing", exact_over_maxima},
    {"exact over narrow cones misses nothing", exact_over_narrow_cones},
    {"where rays end", ends},
    {"vertical rays", verticals},
    {"directions times powers of two", scaled_directions},
    {"steps are bounded, the last one counts", step_bounds},
    {"long walks", long_walks},
    {"unsafe tracers miss", unsafe_tracers_miss},
    {"the 3 x 3 minimum helps", correction_helps},
    {"hits are hits", hits_are_hits},
    {"relaxed cones and bisection", relaxed_cones_and_bisection},
    {"options", options},
    {"batches", batches},
    {NULL, NULL},
};
