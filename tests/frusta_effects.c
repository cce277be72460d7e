/* Effects of skeletons: bad input, and what light, distance and footprints say of shapes whose answers are known. */
#include <math.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

enum { SIDE = 32 };

/* Upright cylinders of length 4 on the plane y = 0. */
struct posts {
    conemap_joint joints[4];
    conemap_segment segments[2];
    conemap_skeleton skeleton;
};

static int make_posts(struct posts *posts, int count, float x, float radius, float thickness)
{
    conemap_skeleton_desc desc;
    int k;
    memset(posts, 0, sizeof *posts);
    memset(&desc, 0, sizeof desc);
    for (k = 0; k < 2 * count; ++k) {
        posts->joints[k].position[0] = k < 2 ? 0.0f : x;
        posts->joints[k].position[1] = k & 1 ? 4.0f : 0.0f;
        posts->joints[k].radius = radius;
        posts->joints[k].thickness = thickness;
        posts->segments[k / 2].base = k & ~1;
        posts->segments[k / 2].top = k | 1;
        posts->segments[k / 2].parent = -1;
        posts->segments[k / 2].u_repeat = 3;
    }
    desc.joints = posts->joints;
    desc.joint_count = 2 * count;
    desc.segments = posts->segments;
    desc.segment_count = count;
    return CHECK(conemap_skeleton_build(&desc, &posts->skeleton) == CONEMAP_OK, "posts");
}

static int make_map(int kind, conemap_map *map)
{
    static float heights[SIDE * SIDE];
    conemap_desc desc;
    zoo_fill(kind, SIDE, SIDE, 3, heights);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = SIDE;
    desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    return CHECK(conemap_build(&desc, map) == CONEMAP_OK, "map");
}

static conemap_ray ray_to(const float *from, const float *to)
{
    conemap_ray ray;
    float length = 0.0f;
    int k;
    memset(&ray, 0, sizeof ray);
    for (k = 0; k < 3; ++k) {
        ray.origin[k] = from[k];
        ray.direction[k] = to[k] - from[k];
        length += ray.direction[k] * ray.direction[k];
    }
    for (k = 0; k < 3; ++k) ray.direction[k] /= sqrtf(length);
    return ray;
}

static void bad_input(void)
{
    enum { CASES = 27 };
    static const unsigned refused[] = {
        CONEMAP_EFFECT_CLIP,
        CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_UV,
        CONEMAP_EFFECT_CURVED,
        CONEMAP_EFFECT_ALL_BITS + 1,
        CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL,
        CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW,
        CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY,
    };
    const float from[3] = {0, 2, -9}, to[3] = {0, 2, 0};
    conemap_ray ray = ray_to(from, to);
    conemap_skeleton_trace_desc trace;
    conemap_skeleton_hit hit;
    conemap_shading shading;
    conemap_effects good, e;
    conemap_map map;
    struct posts posts;
    int k;
    if (!make_posts(&posts, 1, 0.0f, 1.0f, 0.3f) || !make_map(0, &map)) return;
    memset(&trace, 0, sizeof trace);
    trace.map = &map;
    memset(&good, 0, sizeof good);
    good.flags = CONEMAP_EFFECT_POSITION;
    good.light[1] = 1.0f;
    for (k = 0; k < CASES; ++k) {
        const conemap_skeleton_trace_desc whole = trace;
        conemap_result wanted = CONEMAP_ERROR_UNSUPPORTED, got;
        float pixel = 0.01f;
        const int plain = (k >= 7 && k <= 9) || k == 24;
        e = good;
        if (k < 7) e.flags = refused[k];
        if (k >= 7) wanted = CONEMAP_ERROR_PARAMETER;
        if (plain) wanted = CONEMAP_ERROR_UNSUPPORTED;
        if (plain) trace.map = NULL;
        switch (k) {
        case 7: e.flags = CONEMAP_EFFECT_LOD; break;
        case 8: e.flags = CONEMAP_EFFECT_FADE; break;
        case 9: e.flags = CONEMAP_EFFECT_OCCLUSION; break;
        case 10:
            e.flags = CONEMAP_EFFECT_OCCLUSION;
            trace.march = CONEMAP_MARCH_STEPS;
            wanted = CONEMAP_ERROR_UNSUPPORTED;
            break;
        case 11:
            trace.any_hit = 1;
            wanted = CONEMAP_ERROR_UNSUPPORTED;
            break;
        case 12:
        case 13:
        case 14:
            e.flags = k == 12 ? CONEMAP_EFFECT_UV : k == 13 ? CONEMAP_EFFECT_LOD : CONEMAP_EFFECT_FADE;
            pixel = k == 12 ? (float)NAN : k == 13 ? -1.0f : HUGE_VALF;
            break;
        case 15:
            e.flags = CONEMAP_EFFECT_LOD;
            e.lod_steps = -1;
            break;
        case 16:
            e.flags = CONEMAP_EFFECT_LOD;
            e.lod_bias = 17.0f;
            break;
        case 17:
            e.flags = CONEMAP_EFFECT_FADE;
            e.fade_begin = 1.0f;
            e.fade_end = 2.0f;
            break;
        case 18:
            e.flags = CONEMAP_EFFECT_SHADOW;
            e.light[1] = 0.0f;
            break;
        case 19:
            e.flags = CONEMAP_EFFECT_SOFT_SHADOW;
            e.light_radius = 2.0f;
            break;
        case 20:
            e.flags = CONEMAP_EFFECT_SKY;
            e.sky_directions = 1025;
            break;
        case 21:
            e.flags = CONEMAP_EFFECT_DEPTH;
            wanted = CONEMAP_ERROR_NULL;
            break;
        case 22:
            trace.steps = -1;
            break;
        case 23:
            trace.march = CONEMAP_MARCH_COUNT;
            wanted = CONEMAP_ERROR_ENUM;
            break;
        case 24: e.flags = CONEMAP_EFFECT_HOLES; break;
        case 25:
            e.flags = CONEMAP_EFFECT_HOLES;
            wanted = CONEMAP_ERROR_NULL;
            break;
        case 26:
            e.flags = CONEMAP_EFFECT_HOLES;
            e.alpha = (const unsigned char *)map.heights;
            e.alpha_stride = SIDE - 1;
            wanted = CONEMAP_ERROR_STRIDE;
            break;
        default: break;
        }
        memset(&hit, 0x55, sizeof hit);
        memset(&shading, 0x55, sizeof shading);
        got = conemap_skeleton_shade(&posts.skeleton, &trace, &e, pixel, &ray, &hit, &shading, 1);
        CHECK(got == wanted, "case %d: %s", k, conemap_result_string(got));
        CHECK(hit.segment == 0x55555555 && *(const unsigned char *)&shading == 0x55, "case %d: written", k);
        trace = whole;
    }
    e = good;
    CHECK(conemap_skeleton_shade(NULL, &trace, &e, 0, &ray, &hit, &shading, 1) == CONEMAP_ERROR_NULL, "skeleton");
    CHECK(conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, NULL, &hit, &shading, 1) == CONEMAP_ERROR_NULL, "rays");
    CHECK(conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, &ray, NULL, &shading, 1) == CONEMAP_ERROR_NULL, "hits");
    CHECK(conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, &ray, &hit, NULL, 1) == CONEMAP_ERROR_NULL, "shadings");
    CHECK(conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, &ray, &hit, &shading, -1) == CONEMAP_ERROR_PARAMETER, "-1");
    CHECK(conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, NULL, NULL, NULL, 0) == CONEMAP_OK, "none");
    CHECK(conemap_skeleton_shade(&posts.skeleton, NULL, NULL, 0, &ray, &hit, NULL, 1) == CONEMAP_OK &&
              hit.status == CONEMAP_HIT,
          "no effects");
    {
        conemap_ray two[2];
        conemap_skeleton_hit hits[2];
        conemap_shading shadings[2];
        two[0] = two[1] = ray;
        two[0].direction[0] = (float)NAN;
        CHECK(conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, two, hits, shadings, 2) != CONEMAP_OK &&
                  hits[0].status == CONEMAP_INVALID && hits[1].status == CONEMAP_HIT,
              "a wrong ray beside a good one");
    }
    conemap_free(&map);
    conemap_skeleton_free(&posts.skeleton);
}

/* A post, and another one between it and the light. */
static void light_and_sky(void)
{
    const float eye[3] = {0, 2, -9}, near_by[3] = {0, 2, -5}, aside[3] = {2, 2, -3}, at[3] = {0, 2, 0};
    conemap_skeleton_hit hit;
    conemap_shading s, inside;
    conemap_effects e;
    struct posts one, two;
    conemap_ray ray = ray_to(eye, at);
    int k;
    if (!make_posts(&one, 1, 0.0f, 1.0f, 0.0f) || !make_posts(&two, 2, 4.0f, 1.0f, 0.0f)) return;
    memset(&e, 0, sizeof e);
    e.flags = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SKY;
    e.sky_directions = 200;
    for (k = 0; k < 64; ++k) { /* towards lights all around: lit in front of the tangent plane z = -1 */
        const float angle = 6.2831853f * ((float)k + 0.5f) / 64.0f;
        e.light[0] = cosf(angle);
        e.light[2] = sinf(angle);
        conemap_skeleton_shade(&one.skeleton, NULL, &e, 0, &ray, &hit, &s, 1);
        CHECK(s.shadow == (e.light[2] < 0.0f ? 1.0f : 0.0f), "%d: %g", k, (double)s.shadow);
        CHECK(s.occlusion == 1.0f, "a post hides nothing of its own sky: %g", (double)s.occlusion);
    }
    /* The other post covers the directions whose line passes its axis, (4, -1) away, by less than 1. */
    for (k = 0; k < 400; ++k) {
        const float angle = -3.14159265f * ((float)k + 0.5f) / 400.0f;
        const float beside = fabsf(4.0f * sinf(angle) - 1.0f * cosf(angle));
        e.flags = CONEMAP_EFFECT_SHADOW;
        e.light[0] = cosf(angle);
        e.light[2] = sinf(angle);
        conemap_skeleton_shade(&two.skeleton, NULL, &e, 0, &ray, &hit, &s, 1);
        if (fabsf(beside - 1.0f) < 1e-3f) continue;
        CHECK(s.shadow == (beside < 1.0f && e.light[0] > 0.0f ? 0.0f : 1.0f), "%g: %g", (double)angle, (double)s.shadow);
        e.light_is_point = 1; /* one before the other post, from the hit at (0, 2, -1) */
        e.light[1] = 2.0f;
        e.light[2] -= 1.0f;
        conemap_skeleton_shade(&two.skeleton, NULL, &e, 0, &ray, &hit, &s, 1);
        CHECK(s.shadow == 1.0f, "a near light: %g", (double)s.shadow);
        e.light[1] = 0.0f;
        e.light_is_point = 0;
    }
    /* Half of a disc on the horizon of the post itself. */
    e.flags = CONEMAP_EFFECT_SOFT_SHADOW;
    e.light[0] = 1.0f;
    e.light[2] = 0.0f;
    e.light_radius = 0.3f;
    conemap_skeleton_shade(&one.skeleton, NULL, &e, 0, &ray, &hit, &s, 1);
    CHECK(fabsf(s.shadow - 0.5f) <= 1.0f / 16.0f, "half: %g", (double)s.shadow);
    /* Sky beyond the reach hides nothing; within it the other post does. */
    e.flags = CONEMAP_EFFECT_SKY;
    ray = ray_to(aside, at);
    conemap_skeleton_shade(&two.skeleton, NULL, &e, 0, &ray, &hit, &s, 1);
    CHECK(s.occlusion < 0.99f && s.occlusion > 0.8f, "beside a post: %g", (double)s.occlusion);
    e.sky_reach = 1.0f;
    conemap_skeleton_shade(&two.skeleton, NULL, &e, 0, &ray, &hit, &s, 1);
    CHECK(s.occlusion == 1.0f, "beyond the reach: %g", (double)s.occlusion);
    /* From inside, seen from either side. */
    ray = ray_to(at, near_by);
    e.flags = CONEMAP_EFFECT_NORMAL;
    conemap_skeleton_shade(&one.skeleton, NULL, &e, 0, &ray, &hit, &s, 1);
    e.flags |= CONEMAP_EFFECT_TWO_SIDED;
    conemap_skeleton_shade(&one.skeleton, NULL, &e, 0, &ray, &hit, &inside, 1);
    CHECK(hit.inside, "inside");
    for (k = 0; k < 3; ++k)
        CHECK(inside.normal[k] == -s.normal[k], "%g, from the other side %g", (double)s.normal[k], (double)inside.normal[k]);
    conemap_skeleton_free(&one.skeleton);
    conemap_skeleton_free(&two.skeleton);
}

/* Lights in the open air are seen over relief, and within it none is seen through what stands higher. */
static void relief_shadows(void)
{
    struct zoo_random random = zoo_seed(5);
    conemap_skeleton_trace_desc trace;
    conemap_map map;
    struct posts posts;
    int n, lit = 0, dark = 0, wrong = 0;
    if (!make_posts(&posts, 1, 0.0f, 1.0f, 0.5f) || !make_map(0, &map)) return;
    memset(&trace, 0, sizeof trace);
    trace.map = &map;
    for (n = 0; n < 600; ++n) {
        const float from[3] = {zoo_between(&random, -2, 2), zoo_between(&random, 1, 3), -9}, to[3] = {0, 2, 0};
        const conemap_frustum *f = posts.skeleton.frusta;
        conemap_ray ray = ray_to(from, to);
        conemap_skeleton_hit hit;
        conemap_shading s;
        conemap_effects e;
        double lowest = 1.0;
        int k;
        memset(&e, 0, sizeof e);
        e.flags = CONEMAP_EFFECT_SHADOW;
        for (k = 0; k < 3; ++k) e.light[k] = zoo_between(&random, -1, 1);
        e.light[2] -= 0.5f;
        if (conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, &ray, &hit, &s, 1) != CONEMAP_OK ||
            hit.status != CONEMAP_HIT)
            continue;
        for (k = 1; k < 2000; ++k) { /* how far the way to the light is above the relief, at least */
            float place[3], uvw[3];
            conemap_sample sample;
            int c;
            for (c = 0; c < 3; ++c) place[c] = hit.position[c] + e.light[c] * (0.001f * (float)k + 0.002f);
            conemap_frustum_uvw(f, place, uvw);
            if (uvw[1] < 0.0f || uvw[1] > 1.0f || uvw[2] > 1.0f) break;
            conemap_sample_at(&map, uvw[0] * 3.0f, uvw[1] * f->v_size + f->v_start, &sample);
            if ((double)uvw[2] - (double)sample.height < lowest) lowest = (double)uvw[2] - (double)sample.height;
        }
        lit += s.shadow == 1.0f;
        dark += s.shadow == 0.0f;
        wrong += s.shadow == 1.0f ? lowest < -0.02 : lowest > 0.02;
    }
    CHECK(lit > 100 && dark > 50 && wrong * 100 <= lit + dark, "%d lit, %d dark, %d wrongly", lit, dark, wrong);
    conemap_free(&map);
    conemap_skeleton_free(&posts.skeleton);
}

/* Far away relief is a plain frustum; near by it is all there. Caps and levels follow the pixel. */
static void distance(void)
{
    struct zoo_random random = zoo_seed(6);
    conemap_skeleton_trace_desc trace, plain;
    conemap_map map;
    struct posts posts;
    int n, fading = 0;
    if (!make_posts(&posts, 1, 0.0f, 1.0f, 0.25f) || !make_map(2, &map)) return;
    memset(&trace, 0, sizeof trace);
    memset(&plain, 0, sizeof plain);
    trace.map = &map;
    trace.height = plain.height = 0.4f;
    for (n = 0; n < 200; ++n) {
        const float from[3] = {zoo_between(&random, -4, 4), zoo_between(&random, 0, 4), -9};
        const float to[3] = {zoo_between(&random, -1, 1), 2, 0};
        conemap_ray ray = ray_to(from, to);
        conemap_skeleton_hit hit, other;
        conemap_shading s;
        conemap_effects e;
        float pixel = zoo_unit(&random) * 0.05f, level, between;
        memset(&e, 0, sizeof e);
        e.flags = CONEMAP_EFFECT_FADE;
        conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0.0f, &ray, &hit, &s, 1);
        conemap_skeleton_trace(&posts.skeleton, &trace, &ray, &other, 1);
        if (other.status != CONEMAP_HIT || other.cap) continue;
        CHECK(hit.t == other.t && s.fade == 0.0f, "near by: %g, %g", (double)hit.t, (double)other.t);
        between = other.t;
        conemap_skeleton_shade(&posts.skeleton, &trace, &e, 1.0f, &ray, &hit, &s, 1);
        conemap_skeleton_trace(&posts.skeleton, &plain, &ray, &other, 1);
        CHECK(hit.status == other.status && fabsf(hit.t - other.t) < 1e-4f, "far away: %g, %g", (double)hit.t,
              (double)other.t);
        if (other.status != CONEMAP_HIT || other.cap || hit.cap) continue;
        CHECK(s.fade == 1.0f, "fade %g", (double)s.fade);
        /* The shell is 0.25 thick, at a distance that the outer cone of radius 1.25 tells. */
        conemap_skeleton_shade(&posts.skeleton, &trace, &e, pixel, &ray, &hit, &s, 1);
        if (hit.status == CONEMAP_HIT && !hit.cap && s.fade > 0.0f && s.fade < 1.0f) {
            float span[2], high, x;
            conemap_frustum_span(posts.skeleton.frusta, 1.0f, &ray, span);
            high = 0.25f / (pixel * span[0]);
            x = (2.0f - high) / 1.5f;
            CHECK(fabsf(s.fade - x * x * (3.0f - 2.0f * x)) < 1e-3f, "%g pixels high: %g", (double)high, (double)s.fade);
            ++fading;
            if ((between < other.t) == (between + 0.02f < other.t) && (between > other.t) == (between > other.t + 0.02f))
                CHECK((hit.t - between) * (hit.t - other.t) < 0.03f, "%g not between %g and %g", (double)hit.t,
                      (double)between, (double)other.t);
        }
        e.flags = CONEMAP_EFFECT_LOD;
        e.lod_steps = 64;
        e.lod_bias = 0.5f;
        conemap_skeleton_shade(&posts.skeleton, &trace, &e, pixel, &ray, &hit, &s, 1);
        if (hit.status != CONEMAP_HIT) continue;
        {
            float span[2], u = 3.0f * (float)SIDE / (6.2831853f * 1.25f), v = (float)SIDE / 4.0f;
            conemap_frustum_span(posts.skeleton.frusta, 1.0f, &ray, span);
            level = log2f(fmaxf(pixel * span[0] * fmaxf(u, v), 1e-9f)) + 0.5f;
            CHECK(fabsf(s.level - fmaxf(level, 0.0f)) < 1e-3f, "level %g, %g", (double)s.level, (double)level);
            CHECK(hit.steps <= 12 + (int)(64.0f * exp2f(-s.level)) + 1, "%d steps at level %g", hit.steps, (double)s.level);
        }
    }
    CHECK(fading > 20, "%d fading", fading);
    conemap_free(&map);
    conemap_skeleton_free(&posts.skeleton);
}

/* Where the ray of a pixel beside meets the map, as the gradients say. */
static void footprints(void)
{
    struct zoo_random random = zoo_seed(7);
    int n, seen = 0;
    for (n = 0; n < 300; ++n) {
        const float pixel = 1e-3f, from[3] = {zoo_between(&random, -4, 4), zoo_between(&random, -2, 6), -9};
        const float to[3] = {zoo_between(&random, -0.8f, 0.8f), zoo_between(&random, 1, 3), 0};
        conemap_joint joints[2];
        conemap_segment segment;
        conemap_skeleton_desc desc;
        conemap_skeleton skeleton;
        conemap_skeleton_hit hit, beside;
        conemap_shading s, none;
        conemap_effects e;
        conemap_ray ray = ray_to(from, to), other = ray;
        float across[3], moved[2], facing = 0.0f, length = 0.0f;
        int k;
        memset(joints, 0, sizeof joints);
        memset(&segment, 0, sizeof segment);
        memset(&desc, 0, sizeof desc);
        joints[0].radius = 1.5f;
        joints[1].radius = zoo_between(&random, 0.5f, 2.0f);
        joints[1].position[1] = 4.0f;
        joints[0].thickness = joints[1].thickness = 0.2f;
        segment.top = 1;
        segment.parent = -1;
        segment.u_repeat = 2;
        segment.twist = zoo_between(&random, -1, 1);
        desc.joints = joints;
        desc.joint_count = 2;
        desc.segments = &segment;
        desc.segment_count = 1;
        memset(&e, 0, sizeof e);
        e.flags = CONEMAP_EFFECT_UV | CONEMAP_EFFECT_NORMAL;
        REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "cone");
        conemap_skeleton_shade(&skeleton, NULL, &e, pixel, &ray, &hit, &s, 1);
        for (k = 0; k < 3; ++k) facing += s.normal[k] * ray.direction[k];
        if (hit.status != CONEMAP_HIT || hit.cap || facing > -0.2f) goto next;
        /* across: at right angles to the normal and the ray. The other axis: away from the viewer, along the surface. */
        for (k = 0; k < 3; ++k)
            across[k] = s.normal[(k + 1) % 3] * ray.direction[(k + 2) % 3] -
                        s.normal[(k + 2) % 3] * ray.direction[(k + 1) % 3];
        for (k = 0; k < 3; ++k) length += across[k] * across[k];
        for (k = 0; k < 3; ++k) other.direction[k] += pixel * across[k] / sqrtf(length);
        conemap_skeleton_shade(&skeleton, NULL, &e, pixel, &other, &beside, &none, 1);
        moved[0] = beside.map_u - hit.map_u;
        moved[1] = beside.map_v - hit.map_v;
        if (beside.status != CONEMAP_HIT || beside.cap || fabsf(moved[0]) > 0.5f) goto next;
        length = hypotf(s.gradient.dudy, s.gradient.dvdy);
        CHECK(fabsf(moved[0] - s.gradient.dudy) + fabsf(moved[1] - s.gradient.dvdy) < 0.03f * length, "%g %g, not %g %g",
              (double)s.gradient.dudy, (double)s.gradient.dvdy, (double)moved[0], (double)moved[1]);
        other = ray;
        for (k = 0; k < 3; ++k)
            other.direction[k] += pixel * (s.normal[k] - facing * ray.direction[k]) / sqrtf(1.0f - facing * facing);
        conemap_skeleton_shade(&skeleton, NULL, &e, pixel, &other, &beside, &none, 1);
        moved[0] = beside.map_u - hit.map_u;
        moved[1] = beside.map_v - hit.map_v;
        if (beside.status != CONEMAP_HIT || beside.cap || fabsf(moved[0]) > 0.5f) goto next;
        length = hypotf(s.gradient.dudx, s.gradient.dvdx);
        CHECK(fabsf(moved[0] - s.gradient.dudx) + fabsf(moved[1] - s.gradient.dvdx) < 0.08f * length, "%g %g, not %g %g",
              (double)s.gradient.dudx, (double)s.gradient.dvdx, (double)moved[0], (double)moved[1]);
        CHECK(s.uv[0] == hit.map_u && s.uv[1] == hit.map_v, "uv");
        ++seen;
    next:
        conemap_skeleton_free(&skeleton);
    }
    CHECK(seen > 100, "%d seen", seen);
}

/* A hollow post of which every other eighth is open: rays meet the near wall, the far one from within, or none. */
static void holes(void)
{
    struct zoo_random random = zoo_seed(8);
    static unsigned char alpha[SIDE * SIDE];
    conemap_skeleton_trace_desc trace;
    conemap_effects e;
    conemap_map map;
    struct posts posts;
    int n, counts[3] = {0, 0, 0};
    for (n = 0; n < SIDE * SIDE; ++n) alpha[n] = n % SIDE / 4 % 2 ? 0 : 255;
    memset(&trace, 0, sizeof trace);
    memset(&e, 0, sizeof e);
    trace.map = &map;
    e.flags = CONEMAP_EFFECT_HOLES | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_SHADOW;
    e.alpha = alpha;
    e.light[1] = 1e-3f;
    if (!make_map(0, &map)) return;
    for (n = 0; n < 900; ++n) {
        const float from[3] = {zoo_between(&random, -4, 4), 2.0f, -9}, to[3] = {zoo_between(&random, -0.9f, 0.9f), 2.01f, 0};
        const float light[3] = {zoo_between(&random, -1, 1), 0, zoo_between(&random, -1, 1)};
        conemap_ray ray = ray_to(from, to);
        conemap_skeleton_hit hit;
        conemap_shading s;
        float span[2], uvw[2][3], place[3], facing = 0.0f;
        int open[2], k, c, wanted, near_edge = 0;
        if (n % 300 == 0) { /* a thin shell, none, and by steps */
            if (n > 0) conemap_skeleton_free(&posts.skeleton);
            if (!make_posts(&posts, 1, 0.0f, 1.0f, n == 300 ? 0.0f : 0.002f)) return;
            posts.skeleton.build.frusta[0].u_repeat = 1;
            if (n == 600) trace.march = CONEMAP_MARCH_STEPS;
        }
        memcpy(e.light, light, sizeof light);
        conemap_frustum_span(posts.skeleton.frusta, 0.0f, &ray, span);
        for (k = 0; k < 2; ++k) {
            for (c = 0; c < 3; ++c) place[c] = ray.origin[c] + span[k] * ray.direction[c];
            conemap_frustum_uvw(posts.skeleton.frusta, place, uvw[k]);
            open[k] = (int)(uvw[k][0] * 8.0f) % 2;
            near_edge |= fabsf(uvw[k][0] * 8.0f - floorf(uvw[k][0] * 8.0f + 0.5f)) < 0.05f;
        }
        if (near_edge) continue;
        wanted = !open[0] ? 0 : !open[1] ? 1 : 2;
        CHECK(conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, &ray, &hit, &s, 1) == CONEMAP_OK, "shade");
        ++counts[wanted];
        CHECK((hit.status == CONEMAP_HIT) == (wanted < 2), "%d, status %d", wanted, (int)hit.status);
        if (wanted == 2 || hit.status != CONEMAP_HIT) continue;
        CHECK(hit.inside == wanted && fabsf(hit.t - span[wanted]) < 0.02f, "%d: %g, not %g", wanted, (double)hit.t,
              (double)span[wanted]);
        for (k = 0; k < 3; ++k) facing += s.normal[k] * ray.direction[k];
        CHECK(facing < 0.1f, "the normal looks away: %g", (double)facing);
        /* A light level with it reaches the place from within through a hole, from without past the post's side. */
        {
            conemap_ray way;
            float between[3], u = 0.0f;
            memset(&way, 0, sizeof way);
            for (k = 0; k < 3; ++k) {
                way.direction[k] = light[k];
                way.origin[k] = hit.position[k] - 0.01f * (k == 1 ? 0.0f : hit.position[k]) * (wanted ? 1.0f : -1.0f);
                facing += light[k] * (k == 1 ? 0.0f : hit.position[k]) * (wanted ? -1.0f : 1.0f);
            }
            facing = (light[0] * hit.position[0] + light[2] * hit.position[2]) * (wanted ? -1.0f : 1.0f);
            if (fabsf(facing) < 0.2f) continue;
            conemap_frustum_span(posts.skeleton.frusta, 0.0f, &way, span);
            for (k = 0; k < 3; ++k) between[k] = way.origin[k] + span[1] * light[k];
            conemap_frustum_uvw(posts.skeleton.frusta, between, uvw[0]);
            u = uvw[0][0] * 8.0f;
            if (wanted == 1 && facing > 0.0f && fabsf(u - floorf(u + 0.5f)) > 0.05f)
                CHECK(s.shadow == ((int)u % 2 ? 1.0f : 0.0f), "within, u %g: %g", (double)u, (double)s.shadow);
            if (wanted == 0 && facing > 0.0f) CHECK(s.shadow == 1.0f, "without: %g", (double)s.shadow);
            if (wanted == 1 && facing < 0.0f) CHECK(s.shadow == 0.0f, "through the wall: %g", (double)s.shadow);
        }
    }
    CHECK(counts[0] > 100 && counts[1] > 50 && counts[2] > 50, "%d near, %d far, %d through", counts[0], counts[1],
          counts[2]);
    conemap_free(&map);
    conemap_skeleton_free(&posts.skeleton);
}

/* A shell of nothing but holes whose v lies a hair below 0: no texel beyond the map's is read, which are not holes. */
static void holes_below_zero(void)
{
    static unsigned char alpha[(SIDE + 1) * SIDE];
    const float from[3] = {0.3f, 2, -9}, to[3] = {0.2f, 2, 0};
    conemap_ray ray = ray_to(from, to);
    conemap_skeleton_trace_desc trace;
    conemap_skeleton_hit hit;
    conemap_shading s;
    conemap_effects e;
    conemap_map map;
    struct posts posts;
    memset(&trace, 0, sizeof trace);
    memset(&e, 0, sizeof e);
    memset(alpha + SIDE * SIDE, 255, SIDE);
    e.flags = CONEMAP_EFFECT_HOLES;
    e.alpha = alpha;
    trace.map = &map;
    if (!make_map(0, &map)) return;
    if (make_posts(&posts, 1, 0.0f, 1.0f, 0.5f)) {
        posts.skeleton.build.frusta[0].v_size = -1e-20f;
        CHECK(conemap_skeleton_shade(&posts.skeleton, &trace, &e, 0, &ray, &hit, &s, 1) == CONEMAP_OK, "shade");
        CHECK(hit.status == CONEMAP_LEFT, "status %d", (int)hit.status);
        conemap_skeleton_free(&posts.skeleton);
    }
    conemap_free(&map);
}

const struct test_case frusta_effects_tests[] = {
    {"bad input", bad_input}, {"light and sky", light_and_sky}, {"relief shadows", relief_shadows},
    {"distance", distance},   {"footprints", footprints},       {"holes", holes},
    {"holes below zero", holes_below_zero},
    {NULL, NULL},
};
