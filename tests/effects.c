/* Effects, each against a reference of its own in double precision: points of the world by solving the frame, dense
   marching over the surface as it is defined, dense samples of a light's disc and of the sky. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

#define MISS (1.0 / 1048576.0)
#define PI 3.14159265358979323846

/* Of pairs that exclude each other; without these everything goes together. */
#define SECOND_CHOICES (CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SKY)

/* ---- a map with its truth -------------------------------------------------------------------------- */

struct scene {
    conemap_map map;
    struct truth_map truth;
    float *heights;
};

static int scene_make(struct scene *s, int kind, int width, int height, int wrap, uint32_t seed,
                      const conemap_desc *settings)
{
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    if (settings) desc = *settings;
    s->heights = (float *)test_alloc((size_t)width * (size_t)height * sizeof(float));
    zoo_fill(kind, width, height, seed, s->heights);
    desc.heights.pixels = s->heights;
    desc.heights.width = width;
    desc.heights.height = height;
    desc.wrap_u = desc.wrap_v = (conemap_wrap)wrap;
    if (!CHECK(conemap_build(&desc, &s->map) == CONEMAP_OK, "build")) {
        test_release(s->heights);
        return 0;
    }
    s->truth.width = width;
    s->truth.height = height;
    s->truth.wrap_u = s->truth.wrap_v = wrap;
    s->truth.heights = s->map.heights;
    return 1;
}

static void scene_free(struct scene *s)
{
    conemap_free(&s->map);
    test_release(s->heights);
}

/* ---- frames ---------------------------------------------------------------------------------------- */

static float signed_unit(struct zoo_random *random) { return zoo_between(random, -1.0f, 1.0f); }

/* Any frame at all: skewed, mirrored, of uneven lengths; or `neat`: perpendicular unit vectors. */
static void random_frame(struct zoo_random *random, int neat, conemap_frame *f)
{
    int k;
    memset(f, 0, sizeof *f);
    for (k = 0; k < 3; ++k) {
        f->origin[k] = 3.0f * signed_unit(random);
        f->tangent[k] = 0.3f * signed_unit(random) + (k == 0 ? 1.0f : 0.0f);
        f->bitangent[k] = 0.3f * signed_unit(random) + (k == 1 ? 1.0f : 0.0f);
        f->normal[k] = 0.3f * signed_unit(random) + (k == 2 ? 1.0f : 0.0f);
    }
    if (zoo_below(random, 2)) /* mirrored */
        for (k = 0; k < 3; ++k) f->bitangent[k] = -f->bitangent[k];
    if (neat) {
        float a = zoo_between(random, 0.0f, 6.28f), c = cosf(a), s = sinf(a);
        const float t[3] = {c, 0.0f, s}, n[3] = {-s, 0.0f, c}, b[3] = {0.0f, 1.0f, 0.0f};
        memcpy(f->tangent, t, sizeof t);
        memcpy(f->bitangent, b, sizeof b);
        memcpy(f->normal, n, sizeof n);
    } else {
        float scale = zoo_between(random, 0.5f, 2.0f);
        for (k = 0; k < 3; ++k) f->tangent[k] *= scale;
    }
    f->uv_offset[0] = zoo_unit(random);
    f->uv_offset[1] = zoo_unit(random);
    f->uv_scale[0] = zoo_between(random, 0.5f, 2.0f);
    f->uv_scale[1] = zoo_between(random, 0.5f, 2.0f);
    f->aspect = zoo_between(random, 0.5f, 2.0f);
    f->depth = zoo_between(random, 0.05f, 0.5f);
    f->level = zoo_unit(random);
}

/* Solves origin + tangent x + bitangent y + normal n = p by Cramer's rule. */
static void solve_frame(const conemap_frame *f, const double p[3], double xyn[3])
{
    double m[3][3], d[3], whole = 0.0;
    int k, c;
    for (c = 0; c < 3; ++c) {
        m[0][c] = (double)f->tangent[c];
        m[1][c] = (double)f->bitangent[c];
        m[2][c] = (double)f->normal[c];
        d[c] = p[c] - (double)f->origin[c];
    }
#define DETERMINANT(a, b, c)                                                                                 \
    ((a)[0] * ((b)[1] * (c)[2] - (b)[2] * (c)[1]) - (a)[1] * ((b)[0] * (c)[2] - (b)[2] * (c)[0]) +           \
     (a)[2] * ((b)[0] * (c)[1] - (b)[1] * (c)[0]))
    whole = DETERMINANT(m[0], m[1], m[2]);
    xyn[0] = DETERMINANT(d, m[1], m[2]) / whole;
    xyn[1] = DETERMINANT(m[0], d, m[2]) / whole;
    xyn[2] = DETERMINANT(m[0], m[1], d) / whole;
#undef DETERMINANT
    for (k = 0; k < 3; ++k) CHECK(xyn[k] == xyn[k], "singular frame");
}

static double bend_of(const conemap_frame *f, double x, double y)
{
    return 0.5 * ((double)f->curvature[0] * x * x + 2.0 * (double)f->curvature[1] * x * y +
                  (double)f->curvature[2] * y * y);
}

/* (u, v, z) of a world point, z over the bent base. */
static void world_to_box(const conemap_frame *f, const double p[3], double box[3])
{
    double xyn[3];
    solve_frame(f, p, xyn);
    box[0] = (double)f->uv_offset[0] + (double)f->uv_scale[0] * xyn[0];
    box[1] = (double)f->uv_offset[1] + (double)f->uv_scale[1] * xyn[1] / (double)f->aspect;
    box[2] = (double)f->level + (xyn[2] + bend_of(f, xyn[0], xyn[1])) / (double)f->depth;
}

static void ray_at(const conemap_ray *ray, double t, double p[3])
{
    int k;
    for (k = 0; k < 3; ++k) p[k] = (double)ray->origin[k] + t * (double)ray->direction[k];
}

/* A ray from above towards a point near the frame's origin. */
static void random_world_ray(struct zoo_random *random, const conemap_frame *f, conemap_ray *ray)
{
    float at[2], side[2], up = zoo_between(random, 0.2f, 1.5f);
    int k;
    memset(ray, 0, sizeof *ray);
    for (k = 0; k < 2; ++k) {
        at[k] = 0.4f * signed_unit(random);
        side[k] = 1.5f * signed_unit(random);
    }
    for (k = 0; k < 3; ++k) {
        float target = f->origin[k] + f->tangent[k] * at[0] + f->bitangent[k] * at[1];
        ray->direction[k] = f->tangent[k] * side[0] + f->bitangent[k] * side[1] - f->normal[k] * up;
        ray->origin[k] = target - ray->direction[k] * 1.2f;
    }
}

static void frames(void)
{
    struct zoo_random random = zoo_seed(1);
    int round, k;
    for (round = 0; round < 400; ++round) {
        conemap_frame f;
        conemap_ray world, box;
        double p[3], right[3], edge[2][3], out[3], t = (double)zoo_between(&random, 0.0f, 3.0f);
        float at[3], back[3], normal[3], slope[2], high[3], h = 1e-2f;
        random_frame(&random, round & 1, &f);
        random_world_ray(&random, &f, &world);
        world.t_min = 0.25f;
        world.t_max = 7.0f;
        REQUIRE(conemap_frame_ray(&f, &world, &box) == CONEMAP_OK, "round %d: frame_ray", round);
        CHECK(box.t_min == world.t_min && box.t_max == world.t_max, "round %d: t range", round);
        ray_at(&world, t, p);
        world_to_box(&f, p, right);
        for (k = 0; k < 3; ++k) {
            double is = (double)box.origin[k] + t * (double)box.direction[k];
            CHECK(fabs(is - right[k]) < 2e-5 * (1.0 + fabs(right[k])), "round %d: box %d is %.9g, right %.9g", round, k,
                  is, right[k]);
        }
        /* and back, with a bent base */
        for (k = 0; k < 3; ++k) f.curvature[k] = 0.6f * signed_unit(&random);
        world_to_box(&f, p, right);
        for (k = 0; k < 3; ++k) at[k] = (float)right[k];
        REQUIRE(conemap_frame_point(&f, at, back) == CONEMAP_OK, "round %d: frame_point", round);
        for (k = 0; k < 3; ++k)
            CHECK(fabs((double)back[k] - p[k]) < 2e-5 * (1.0 + fabs(right[2])),
                  "round %d: world %d is %.9g, right %.9g", round, k, (double)back[k], p[k]);
        /* the normal stands on two edges of the surface, and points to its outer side */
        slope[0] = 3.0f * signed_unit(&random);
        slope[1] = 3.0f * signed_unit(&random);
        at[2] = 0.5f;
        REQUIRE(conemap_frame_normal(&f, at[0], at[1], slope, normal) == CONEMAP_OK, "round %d: normal", round);
        for (k = 0; k < 2; ++k) {
            float a[3], b[3], wa[3], wb[3];
            int c;
            memcpy(a, at, sizeof a);
            memcpy(b, at, sizeof b);
            a[k] -= h;
            a[2] -= h * slope[k];
            b[k] += h;
            b[2] += h * slope[k];
            conemap_frame_point(&f, a, wa);
            conemap_frame_point(&f, b, wb);
            for (c = 0; c < 3; ++c) edge[k][c] = (double)wb[c] - (double)wa[c];
        }
        memcpy(high, at, sizeof high);
        high[2] += 0.1f;
        conemap_frame_point(&f, at, back);
        conemap_frame_point(&f, high, high);
        for (k = 0; k < 3; ++k) out[k] = (double)high[k] - (double)back[k];
        for (k = 0; k < 2; ++k) {
            double length = sqrt(edge[k][0] * edge[k][0] + edge[k][1] * edge[k][1] + edge[k][2] * edge[k][2]);
            double along = edge[k][0] * (double)normal[0] + edge[k][1] * (double)normal[1] +
                           edge[k][2] * (double)normal[2];
            CHECK(fabs(along) < 1e-3 * length, "round %d: normal leans %g along edge %d", round, along / length, k);
        }
        CHECK(out[0] * (double)normal[0] + out[1] * (double)normal[1] + out[2] * (double)normal[2] > 0.0,
              "round %d: normal points inside", round);
        CHECK(fabs((double)(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]) - 1.0) < 1e-5,
              "round %d: normal is not unit", round);
    }
}

/* A hit's t is the world ray's own, its position is on the surface, in any frame. */
static void world_hits(void)
{
    struct zoo_random random = zoo_seed(2);
    struct scene s;
    int round, hits = 0;
    if (!scene_make(&s, ZOO_FBM, 32, 24, 1, 5, NULL)) return;
    for (round = 0; round < 300; ++round) {
        conemap_frame f;
        conemap_effects e;
        conemap_ray ray;
        conemap_hit hit;
        conemap_shading shading;
        double p[3], box[3];
        int k;
        memset(&e, 0, sizeof e);
        random_frame(&random, round & 1, &f);
        random_world_ray(&random, &f, &ray);
        e.flags = CONEMAP_EFFECT_POSITION;
        e.frames = &f;
        if (!CHECK(conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade")) break;
        if (hit.status != CONEMAP_HIT || hit.inside) continue;
        ++hits;
        ray_at(&ray, (double)hit.t, p);
        world_to_box(&f, p, box);
        for (k = 0; k < 3; ++k)
            CHECK(fabs((double)shading.position[k] - p[k]) < 1e-5, "round %d: position %d", round, k);
        CHECK(fabs(box[0] - (double)hit.u) + fabs(box[1] - (double)hit.v) + fabs(box[2] - (double)hit.z) < 1e-4,
              "round %d: hit is %g %g %g, right %g %g %g", round, (double)hit.u, (double)hit.v, (double)hit.z, box[0],
              box[1], box[2]);
        CHECK(fabs(box[2] - truth_height(&s.truth, box[0], box[1])) < 1e-3, "round %d: %g over the surface", round,
              box[2] - truth_height(&s.truth, box[0], box[1]));
    }
    CHECK(hits > 200, "%d hits", hits);
    scene_free(&s);
}

/* ---- depth ----------------------------------------------------------------------------------------- */

/* kind: 0 ordinary 0..1, 1 GL -1..1, 2 reversed, 3 infinite, 4 reversed infinite. Looks down -z from the origin. */
static void projection(int kind, double near, double far, float m[16])
{
    double a = 0.0, b = 0.0;
    memset(m, 0, 16 * sizeof m[0]);
    m[0] = 1.2f;
    m[5] = 1.7f;
    m[11] = -1.0f;
    switch (kind) {
    case 0: a = far / (near - far); b = near * far / (near - far); break;
    case 1: a = (near + far) / (near - far); b = 2.0 * near * far / (near - far); break;
    case 2: a = near / (far - near); b = near * far / (far - near); break;
    case 3: a = -1.0; b = -near; break;
    default: a = 0.0; b = near; break;
    }
    m[10] = (float)a;
    m[14] = (float)b;
}

static void depths(void)
{
    const double near = 0.25, far = 200.0;
    struct zoo_random random = zoo_seed(3);
    float m[16], p[3] = {0.0f, 0.0f, -1.0f}, depth = 7.0f;
    int kind, k;
    for (kind = 0; kind < 5; ++kind) {
        projection(kind, near, far, m);
        for (k = 0; k < 200; ++k) {
            double d = near + (double)zoo_unit(&random) * (far - near), right;
            p[0] = (float)d * signed_unit(&random);
            p[1] = (float)d * signed_unit(&random);
            p[2] = -(float)d;
            d = -(double)p[2];
            right = kind == 2   ? near * (far - d) / (d * (far - near))
                    : kind == 3 ? (d - near) / d
                    : kind == 4 ? near / d
                                : far * (d - near) / (d * (far - near));
            if (!CHECK(conemap_depth(m, p, kind == 1 ? CONEMAP_DEPTH_MINUS_ONE_TO_ONE : CONEMAP_DEPTH_ZERO_TO_ONE,
                                     &depth) == CONEMAP_OK,
                       "depth"))
                return;
            CHECK(fabs((double)depth - right) < 3e-6, "kind %d, %g away: %.9g, right %.9g", kind, d, (double)depth,
                  right);
            /* relative, where the format keeps it: far things of reversed depth */
            if (kind == 4)
                CHECK(fabs((double)depth / right - 1.0) < 1e-6, "%g away: %.9g, right %.9g", d, (double)depth, right);
        }
    }
    p[2] = 1.0f;
    depth = 7.0f;
    CHECK(conemap_depth(m, p, CONEMAP_DEPTH_ZERO_TO_ONE, &depth) == CONEMAP_ERROR_PARAMETER, "behind");
    p[2] = nanf("");
    CHECK(conemap_depth(m, p, CONEMAP_DEPTH_ZERO_TO_ONE, &depth) == CONEMAP_ERROR_PARAMETER, "nan");
    CHECK(conemap_depth(NULL, p, CONEMAP_DEPTH_ZERO_TO_ONE, &depth) == CONEMAP_ERROR_NULL, "null");
    CHECK(conemap_depth(m, NULL, CONEMAP_DEPTH_ZERO_TO_ONE, &depth) == CONEMAP_ERROR_NULL, "null");
    CHECK(conemap_depth(m, p, CONEMAP_DEPTH_ZERO_TO_ONE, NULL) == CONEMAP_ERROR_NULL, "null");
    CHECK(conemap_depth(m, p, CONEMAP_DEPTH_RANGE_COUNT, &depth) == CONEMAP_ERROR_ENUM, "enum");
    CHECK(depth == 7.0f, "an error writes");
}

/* ---- slopes ---------------------------------------------------------------------------------------- */

/* What a texture unit and the shader line of the documentation make of the written texture. */
static double fetched_slope(const conemap_map *map, const unsigned char *bytes, int axis, double u, double v)
{
    const conemap_info *info = &map->info;
    const size_t row = conemap_row_size(map), texel = row / (size_t)info->width;
    double x = u * info->width - 0.5, y = v * info->height - 0.5, sum = 0.0, fx = x - floor(x), fy = y - floor(y);
    int c;
    for (c = 0; c < 4; ++c) {
        double i = floor(x) + (c & 1), j = floor(y) + (c >> 1), value;
        const unsigned char *at;
        uint16_t word;
        if (info->wrap_u == CONEMAP_WRAP) i -= floor(i / info->width) * info->width;
        if (info->wrap_v == CONEMAP_WRAP) j -= floor(j / info->height) * info->height;
        i = i < 0.0 ? 0.0 : i > info->width - 1.0 ? info->width - 1.0 : i;
        j = j < 0.0 ? 0.0 : j > info->height - 1.0 ? info->height - 1.0 : j;
        at = bytes + (size_t)j * row + (size_t)i * texel + (texel / 4) * (size_t)(2 + axis);
        if (info->texture.format == CONEMAP_F32) {
            float f;
            memcpy(&f, at, 4);
            value = (double)f;
        } else if (info->texture.format == CONEMAP_UNORM8) {
            value = at[0] / 255.0;
        } else {
            memcpy(&word, at, 2);
            value = word / 65535.0;
        }
        value = (value - 0.5) * (axis ? info->height : info->width);
        if (axis && info->texture.flip_dv) value = -value;
        sum += value * (c & 1 ? fx : 1.0 - fx) * (c >> 1 ? fy : 1.0 - fy);
    }
    return sum;
}

static void slopes(void)
{
    static const conemap_format formats[] = {CONEMAP_F32, CONEMAP_UNORM8, CONEMAP_UNORM16};
    struct zoo_random random = zoo_seed(4);
    int round, point;
    for (round = 0; round < 36; ++round) {
        conemap_desc desc;
        struct scene s;
        unsigned char bytes[16 * 9 * 16];
        memset(&desc, 0, sizeof desc);
        desc.texture.layout = CONEMAP_DUMMER;
        desc.texture.encoding = CONEMAP_SQRT;
        desc.texture.flip_dv = round & 1;
        desc.texture.format = formats[round % 3];
        if (!scene_make(&s, round < 12 ? ZOO_CLIFF : ZOO_FBM, 16, 9, round / 2 % 3, (uint32_t)round, &desc)) return;
        CHECK(conemap_write_texture(&s.map, bytes, sizeof bytes, 0) == CONEMAP_OK, "write");
        for (point = 0; point < 100; ++point) {
            float u = zoo_between(&random, 0.04f, 0.96f), v = zoo_between(&random, 0.06f, 0.94f), slope[2];
            int axis;
            if (point < 2 && s.map.info.wrap_u == CONEMAP_CLAMP) u = v = point ? 1.0f : 0.0f;
            if (!CHECK(conemap_smooth_slope(&s.map, u, v, slope) == CONEMAP_OK, "slope")) break;
            for (axis = 0; axis < 2; ++axis) {
                double right = fetched_slope(&s.map, bytes, axis, (double)u, (double)v);
                CHECK(fabs((double)slope[axis] - right) < 1e-4, "round %d: axis %d at %g, %g is %g, right %g", round,
                      axis, (double)u, (double)v, (double)slope[axis], right);
            }
        }
        scene_free(&s);
    }
    { /* a plane has the same slope everywhere, borders included: one-sided differences are not halved */
        struct scene s;
        float slope[2];
        if (!scene_make(&s, ZOO_RAMP, 9, 5, 0, 0, NULL)) return;
        CHECK(conemap_smooth_slope(&s.map, 0.01f, 0.5f, slope) == CONEMAP_OK && fabsf(slope[0] - 9.0f / 8.0f) < 1e-5f,
              "slope at the border is %g", (double)slope[0]);
        CHECK(conemap_smooth_slope(&s.map, -0.5f, 0.5f, slope) == CONEMAP_ERROR_POSITION, "off");
        CHECK(conemap_smooth_slope(NULL, 0.5f, 0.5f, slope) == CONEMAP_ERROR_NULL, "null");
        CHECK(conemap_smooth_slope(&s.map, 0.5f, 0.5f, NULL) == CONEMAP_ERROR_NULL, "null");
        scene_free(&s);
    }
}

/* ---- marching over any surface --------------------------------------------------------------------- */

/* A surface for the march: one or two levels, holes, in a frame. */
struct ground {
    const struct truth_map *map[2];
    double share; /* of map[1] */
    const unsigned char *alpha;
    int alpha_width, alpha_height;
    double low[2], high[2];
};

static double ground_height(const struct ground *g, double u, double v)
{
    double h = truth_height(g->map[0], u, v);
    return g->share > 0.0 ? (1.0 - g->share) * h + g->share * truth_height(g->map[1], u, v) : h;
}

static int ground_hole(const struct ground *g, double u, double v)
{
    double i = floor((u - floor(u)) * g->alpha_width), j = floor((v - floor(v)) * g->alpha_height);
    return g->alpha && g->alpha[(int)j * g->alpha_width + (int)i] < 128;
}

static int ground_has(const struct ground *g, const double box[3])
{
    return box[0] >= g->low[0] && box[0] <= g->high[0] && box[1] >= g->low[1] && box[1] <= g->high[1];
}

static void ground_plain(struct ground *g, const struct scene *s)
{
    int axis;
    memset(g, 0, sizeof *g);
    g->map[0] = &s->truth;
    for (axis = 0; axis < 2; ++axis) {
        int wrap = axis ? s->truth.wrap_v : s->truth.wrap_u, size = axis ? s->truth.height : s->truth.width;
        double border = wrap == 2 && size > 1 ? 0.5 / size : 0.0;
        g->low[axis] = wrap == 1 ? -1e30 : border;
        g->high[axis] = wrap == 1 ? 1e30 : 1.0 - border;
    }
}

/* How far the ground rises above the ray, at most, over t0..t1, in `steps` steps; -1 if never. With holes only where
   it is solid at this very spot. */
static double march(const struct ground *g, const conemap_frame *f, const conemap_ray *ray, double t0, double t1,
                    int steps, double *where)
{
    double worst = -1.0;
    int k;
    for (k = 0; k <= steps; ++k) {
        double t = t0 + (t1 - t0) * k / steps, p[3], box[3], rise;
        ray_at(ray, t, p);
        world_to_box(f, p, box);
        if (!ground_has(g, box) || box[2] < 0.0 || ground_hole(g, box[0], box[1])) continue;
        rise = ground_height(g, box[0], box[1]) - box[2];
        if (rise > worst) {
            worst = rise;
            *where = t;
        }
    }
    return worst;
}

/* Rays against the march: nothing before the hit, the hit on the surface, nothing on the way of those that leave. */
static void check_rays(const char *what, struct ground *g, const conemap_frame *f, const conemap_map *map,
                       const conemap_effects *e, struct zoo_random *random, int count, double tolerance)
{
    int k, hits = 0;
    for (k = 0; k < count; ++k) {
        conemap_ray ray;
        conemap_hit hit;
        conemap_shading shading;
        double p[3], box[3], where = 0.0, worst, t_end;
        random_world_ray(random, f, &ray);
        ray.t_max = 4.0f;
        if (!CHECK(conemap_shade(map, NULL, e, &ray, &hit, &shading, 1) == CONEMAP_OK, "%s: shade", what)) return;
        t_end = hit.status == CONEMAP_HIT || hit.status == CONEMAP_FLOOR ? (double)hit.t : 4.0;
        if (hit.inside) t_end -= 1e-5; /* before the side that it comes in by */
        worst = t_end > 0.0 ? march(g, f, &ray, 0.0, t_end * (1.0 - 1e-6), 800, &where) : -1.0;
        CHECK(worst < tolerance, "%s: ray %d: %s at %.9g, but %g under the surface at %.9g", what, k,
              hit.status == CONEMAP_HIT ? "hit" : "no hit", t_end, worst, where);
        if (hit.status != CONEMAP_HIT) continue;
        ++hits;
        if (hit.inside) continue;
        ray_at(&ray, (double)hit.t, p);
        world_to_box(f, p, box);
        CHECK(fabs(box[2] - ground_height(g, box[0], box[1])) < 1e-3, "%s: ray %d: hit %g over the surface", what, k,
              box[2] - ground_height(g, box[0], box[1]));
        CHECK(fabs(box[2] - (double)hit.z) < 1e-4, "%s: ray %d: z %g, right %g", what, k, (double)hit.z, box[2]);
    }
    CHECK(hits > count / 12, "%s: %d hits of %d", what, hits, count);
}

static const int shapes[] = {ZOO_FBM, ZOO_SPIKES, ZOO_BRICKS, ZOO_WHITE};

static void curved(void)
{
    static const int sizes[][2] = {{24, 20}, {24, 20}, {24, 20}, {1, 1}, {1, 7}, {9, 1}, {2, 2}, {40, 3}};
    struct zoo_random random = zoo_seed(6);
    int round, dark = 0, lit = 0;
    for (round = 0; round < 32; ++round) {
        const int *size = sizes[round < 24 ? 0 : round - 24];
        struct scene s;
        struct ground g;
        conemap_frame f;
        conemap_effects e;
        conemap_desc desc;
        int k;
        memset(&desc, 0, sizeof desc);
        if (round % 5 == 4) desc.generator = CONEMAP_RELAXED; /* whose cones are not for bent rays */
        if (!scene_make(&s, shapes[round % 4], size[0], size[1], round % 3, (uint32_t)round, &desc)) return;
        ground_plain(&g, &s);
        memset(&e, 0, sizeof e);
        random_frame(&random, round % 4 == 0, &f);
        for (k = 0; k < 3; ++k)
            f.curvature[k] = (round % 8 < 6 ? 1.0f : -1.0f) * (k == 1 ? 0.3f : 0.6f) * zoo_unit(&random);
        e.flags = CONEMAP_EFFECT_CURVED;
        e.frames = &f;
        check_rays("curved", &g, &f, &s.map, &e, &random, 60, 2e-5);
        e.flags |= CONEMAP_EFFECT_SHADOW;
        for (k = 0; k < 20; ++k) { /* shadows on the bent base, which throws its own too */
            conemap_ray ray, light;
            conemap_hit hit;
            conemap_shading shading;
            double p[3], box[3], where, rise;
            int c;
            random_world_ray(&random, &f, &ray);
            for (c = 0; c < 3; ++c) /* low over the base, where the bend matters */
                e.light[c] = f.normal[c] * 0.4f * zoo_unit(&random) + f.tangent[c] * signed_unit(&random) +
                             f.bitangent[c] * signed_unit(&random);
            CHECK(conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade");
            if (hit.status != CONEMAP_HIT || hit.inside) continue;
            light = ray;
            memcpy(light.direction, e.light, sizeof e.light);
            ray_at(&ray, (double)hit.t, p);
            for (c = 0; c < 3; ++c) light.origin[c] = (float)p[c];
            world_to_box(&f, p, box);
            rise = march(&g, &f, &light, 0.002, 3.0, 1500, &where);
            if (rise > 1e-4 || (rise < -1e-3 && round % 8 < 6)) { /* a bowl has its own far side, beyond the march */
                CHECK((shading.shadow == 0.0f) == (rise > 0.0), "round %d: shadow %g, but %g over the light's ray", round,
                      (double)shading.shadow, rise);
                dark += rise > 0.0;
                lit += rise < 0.0;
            }
        }
        scene_free(&s);
    }
    CHECK(dark > 50 && lit > 50, "%d dark, %d lit", dark, lit);
}

/* Bent rays, and shadows from where they hit, by the cones of their sectors: the same answers in fewer steps. */
static void sectors(void)
{
    static const int counts[3] = {0, 4, 8};
    struct zoo_random random = zoo_seed(31);
    struct scene s[3];
    int k, n, steps[3] = {0, 0, 0}, hits = 0;
    for (k = 0; k < 3; ++k) {
        conemap_desc desc;
        memset(&desc, 0, sizeof desc);
        desc.texture.sectors = counts[k];
        if (!scene_make(&s[k], ZOO_FBM, 40, 28, CONEMAP_WRAP, 7, &desc)) return;
    }
    for (n = 0; n < 300; ++n) {
        conemap_frame f;
        conemap_effects e;
        conemap_ray ray;
        conemap_hit hit[3];
        conemap_shading shading[3];
        memset(&e, 0, sizeof e);
        random_frame(&random, 1, &f);
        f.curvature[0] = f.curvature[2] = 0.5f;
        random_world_ray(&random, &f, &ray);
        e.flags = CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_SHADOW;
        e.frames = &f;
        e.light[0] = signed_unit(&random), e.light[1] = signed_unit(&random), e.light[2] = 0.4f;
        for (k = 0; k < 3; ++k) {
            shading[k].shadow = 0.0f;
            REQUIRE(conemap_shade(&s[k].map, NULL, &e, &ray, &hit[k], &shading[k], 1) == CONEMAP_OK, "shade");
            steps[k] += hit[k].steps;
        }
        hits += hit[0].status == CONEMAP_HIT;
        for (k = 1; k < 3; ++k)
            CHECK(hit[k].status == hit[0].status && shading[k].shadow == shading[0].shadow &&
                      (hit[0].status != CONEMAP_HIT || fabsf(hit[k].t - hit[0].t) < 1e-5f),
                  "ray %d, %d sectors: status %d, at %g, shadow %g; right %d, %g, %g", n, counts[k], (int)hit[k].status,
                  (double)hit[k].t, (double)shading[k].shadow, (int)hit[0].status, (double)hit[0].t,
                  (double)shading[0].shadow);
    }
    CHECK(hits > 150 && steps[1] < steps[0] && steps[2] < steps[1], "%d hits; steps %d, 4 sectors %d, 8 sectors %d", hits,
          steps[0], steps[1], steps[2]);
    for (k = 0; k < 3; ++k) scene_free(&s[k]);
}

static void blended_levels(void)
{
    struct zoo_random random = zoo_seed(7);
    int round;
    for (round = 0; round < 16; ++round) {
        struct scene s;
        struct truth_map truths[3];
        struct ground g;
        conemap_map levels[3];
        conemap_desc desc;
        conemap_frame f;
        conemap_effects e;
        conemap_gradient gradient = {0.0f, 0.0f, 0.0f, 0.0f};
        float level = zoo_between(&random, 0.0f, 2.0f);
        int k, odd = round & 4 ? 1 : 0;
        memset(&desc, 0, sizeof desc);
        if (!scene_make(&s, shapes[round % 4], 24 + odd, 20 + odd, round & 1, (uint32_t)round, NULL)) return;
        desc.heights.pixels = s.heights;
        desc.heights.width = 24 + odd;
        desc.heights.height = 20 + odd;
        desc.wrap_u = desc.wrap_v = (conemap_wrap)(round & 1);
        REQUIRE(conemap_build_levels(&desc, levels, 3) == CONEMAP_OK, "levels");
        ground_plain(&g, &s);
        for (k = 0; k < 3; ++k) {
            truths[k] = s.truth;
            truths[k].width = levels[k].info.width;
            truths[k].height = levels[k].info.height;
            truths[k].heights = levels[k].heights;
        }
        g.map[0] = &truths[(int)level];
        g.map[1] = &truths[(int)level + 1];
        g.share = (double)(level - floorf(level));
        random_frame(&random, 1, &f);
        f.level = 1.0f;
        memset(&e, 0, sizeof e);
        gradient.dudx = powf(2.0f, level) / (float)(24 + odd);
        e.flags = CONEMAP_EFFECT_LOD | (round % 5 == 0 ? (unsigned)CONEMAP_EFFECT_CURVED : 0u);
        if (round % 5 == 0) f.curvature[0] = 0.5f;
        e.frames = &f;
        e.levels = levels;
        e.level_count = 3;
        e.gradients = &gradient;
        check_rays("levels", &g, &f, &s.map, &e, &random, 60, 2e-5);
        for (k = 0; k < 3; ++k) conemap_free(&levels[k]);
        scene_free(&s);
    }
}

/* Levels of a map that ends with NOTHING, down to the one texel where that means nothing. */
static void levels_to_one_texel(void)
{
    static const float heights[8] = {0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f, 0.8f};
    const conemap_ray ray = {{0.5f, 0.5f, 1.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
    const conemap_gradient gradient = {1.0f, 0.0f, 0.0f, 1.0f};
    conemap_map levels[3];
    conemap_desc desc;
    conemap_effects e;
    conemap_hit hit;
    conemap_shading shading;
    int k;
    memset(&desc, 0, sizeof desc);
    memset(&e, 0, sizeof e);
    desc.heights.pixels = heights;
    desc.heights.width = 4;
    desc.heights.height = 2;
    desc.wrap_u = desc.wrap_v = CONEMAP_NOTHING;
    REQUIRE(conemap_build_levels(&desc, levels, 3) == CONEMAP_OK, "levels");
    e.flags = CONEMAP_EFFECT_LOD;
    e.levels = levels;
    e.level_count = 3;
    e.gradients = &gradient;
    CHECK(conemap_shade(&levels[0], NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK && hit.status == CONEMAP_HIT &&
              shading.level == 2.0f && fabsf(hit.z - 0.45f) < 1e-5f,
          "status %d at %g, level %g", (int)hit.status, (double)hit.z, (double)shading.level);
    for (k = 0; k < 3; ++k) conemap_free(&levels[k]);
}

static void holes(void)
{
    struct zoo_random random = zoo_seed(8);
    int round, walls = 0, floors = 0, plain_hits = 0;
    for (round = 0; round < 16; ++round) {
        struct scene s;
        struct ground g;
        conemap_frame f;
        conemap_effects e;
        unsigned char alpha[20][32];
        int x, y, k;
        if (!scene_make(&s, shapes[round % 4], 24, 20, round & 1, (uint32_t)round, NULL)) return;
        for (y = 0; y < 20; ++y)
            for (x = 0; x < 32; ++x) alpha[y][x] = (unsigned char)(zoo_below(&random, 3) == 0 ? 127 - x : 128 + x);
        ground_plain(&g, &s);
        memset(&e, 0, sizeof e);
        random_frame(&random, 0, &f);
        if (round % 4 == 3) f.curvature[0] = f.curvature[2] = 0.4f;
        e.flags = CONEMAP_EFFECT_HOLES | (round % 4 == 3 ? (unsigned)CONEMAP_EFFECT_CURVED : 0u);
        e.frames = &f;
        e.alpha = &alpha[0][0];
        e.alpha_stride = 32;
        { /* the march reads rows that touch */
            static unsigned char packed[20 * 24];
            for (y = 0; y < 20; ++y) memcpy(packed + y * 24, alpha[y], 24);
            g.alpha = packed;
            g.alpha_width = 24;
            g.alpha_height = 20;
        }
        check_rays("holes", &g, &f, &s.map, &e, &random, 60, 1e-3);
        /* what is hit is solid, a wall is the side of a hole, and the floor is reached through holes only */
        for (k = 0; k < 100; ++k) {
            conemap_ray ray;
            conemap_hit hit;
            conemap_shading shading;
            double p[3], box[3], d[3], before[3];
            int a;
            random_world_ray(&random, &f, &ray);
            REQUIRE(conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade");
            ray_at(&ray, (double)hit.t + 1e-4, p);
            world_to_box(&f, p, box);
            ray_at(&ray, (double)hit.t - 1e-4, p);
            world_to_box(&f, p, before);
            for (a = 0; a < 3; ++a) d[a] = box[a] - before[a];
            if (hit.status == CONEMAP_HIT && ground_has(&g, box) && ground_has(&g, before)) {
                CHECK(!ground_hole(&g, box[0], box[1]), "round %d: ray %d hits a hole at %g %g", round, k, box[0],
                      box[1]);
                if (hit.inside) ++walls;
                else ++plain_hits;
                if (hit.inside)
                    CHECK(ground_hole(&g, before[0], before[1]), "round %d: ray %d: wall without a hole, moving %g %g",
                          round, k, d[0], d[1]);
            }
            if (hit.status == CONEMAP_FLOOR && ground_has(&g, before)) {
                ++floors;
                CHECK(ground_hole(&g, before[0], before[1]), "round %d: ray %d: floor without a hole", round, k);
            }
        }
        scene_free(&s);
    }
    CHECK(walls > 50 && floors > 20 && plain_hits > 200, "%d walls, %d floors, %d hits", walls, floors, plain_hits);
}

/* A level ray into the side of a map that wraps and is cut to one copy: what counts is the texel that it flies into, not
   the one beside it in the next copy. */
static void holes_at_the_border(void)
{
    unsigned char alpha[8 * 8];
    struct scene s;
    int way, where, curved, k;
    if (!scene_make(&s, ZOO_FLAT_1, 8, 8, CONEMAP_WRAP, 0, NULL)) return;
    for (way = 0; way < 4; ++way) /* along u, v; backwards */
        for (where = 0; where < 2; ++where)
            for (curved = 0; curved < 2; ++curved) {
                const int axis = way & 1, back = way >> 1, gap = back == where ? 0 : 7; /* the row of holes */
                const float right = where ? (back ? 1.0f : 0.0f) : back ? 0.875f : 0.125f;
                conemap_frame f;
                conemap_effects e;
                conemap_ray ray;
                conemap_hit hit;
                conemap_shading shading;
                for (k = 0; k < 64; ++k) alpha[k] = (axis ? k / 8 : k % 8) == gap ? 0 : 255;
                memset(&e, 0, sizeof e);
                memset(&f, 0, sizeof f);
                memset(&ray, 0, sizeof ray);
                f.curvature[0] = 1e-6f;
                e.flags = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_HOLES | (curved ? (unsigned)CONEMAP_EFFECT_CURVED : 0u);
                e.frames = &f;
                e.alpha = alpha;
                ray.origin[axis] = back ? 1.7f : -0.7f;
                ray.origin[!axis] = 0.3f;
                ray.origin[2] = 0.4f;
                ray.direction[axis] = back ? -0.9f : 0.9f;
                REQUIRE(conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade");
                CHECK(hit.status == CONEMAP_HIT && hit.inside && fabsf((axis ? hit.v : hit.u) - right) < 1e-5f,
                      "way %d, holes at %d, curved %d: status %d, at %g, right %g", way, gap, curved, (int)hit.status,
                      (double)(axis ? hit.v : hit.u), (double)right);
            }
    scene_free(&s);
}

/* A step cap ends a ray above the surface, and what is there is shaded. */
static void caps(void)
{
    struct zoo_random random = zoo_seed(18);
    struct scene s;
    conemap_frame f;
    conemap_effects e;
    conemap_gradient gradient = {0.03f, 0.0f, 0.0f, 0.03f};
    int k, capped[2] = {0, 0};
    if (!scene_make(&s, ZOO_WHITE, 32, 32, 1, 3, NULL)) return;
    memset(&e, 0, sizeof e);
    memset(&f, 0, sizeof f);
    f.curvature[0] = 0.001f;
    e.frames = &f;
    e.gradients = &gradient;
    e.levels = &s.map;
    e.level_count = 1;
    e.lod_steps = 9;
    for (k = 0; k < 200; ++k) {
        conemap_ray ray = {{0.0f, 0.3f, 1.2f}, {1.0f, 0.1f, -0.12f}, 0.0f, 0.0f};
        conemap_hit hit;
        conemap_shading shading;
        ray.origin[0] = zoo_unit(&random);
        shading.position[0] = -99.0f;
        e.flags = CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_LOD | (k & 1 ? (unsigned)CONEMAP_EFFECT_CURVED : 0u);
        CHECK(conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade");
        CHECK(hit.steps <= 9, "%d steps", hit.steps);
        if (hit.status != CONEMAP_STEP_CAP) continue;
        ++capped[k & 1];
        CHECK(hit.steps == 9 && (double)hit.z >= truth_height(&s.truth, (double)hit.u, (double)hit.v) - 1e-4,
              "ray %d: %d steps, %g over", k, hit.steps,
              (double)hit.z - truth_height(&s.truth, (double)hit.u, (double)hit.v));
        CHECK(shading.position[0] != -99.0f, "ray %d: not shaded", k);
    }
    CHECK(capped[0] > 20 && capped[1] > 20, "%d and %d capped", capped[0], capped[1]);
    scene_free(&s);
}

/* Any finite numbers at all: it ends, and every answer is one. */
static void extremes(void)
{
    struct zoo_random random = zoo_seed(19);
    int round, k, valid = 0;
    for (round = 0; round < 60; ++round) {
        static const int sizes[][2] = {{1, 1}, {2, 1}, {1, 5}, {7, 3}, {16, 16}};
        const int *size = sizes[zoo_below(&random, 5)];
        unsigned char alpha[16 * 16];
        struct scene s;
        if (!scene_make(&s, zoo_below(&random, ZOO_KINDS), size[0], size[1], zoo_below(&random, 3), 3, NULL)) return;
        for (k = 0; k < 256; ++k) alpha[k] = (unsigned char)zoo_below(&random, 256);
        for (k = 0; k < 60; ++k) {
            conemap_ray ray;
            conemap_hit hit;
            conemap_shading shading;
            conemap_frame f;
            conemap_effects e;
            conemap_gradient g;
            conemap_result result;
            int c;
#define ANY (signed_unit(&random) * powf(10.0f, (zoo_below(&random, 3) ? 1.0f : 12.0f) * signed_unit(&random)) *  \
             (float)(zoo_below(&random, 4) != 0))
            random_frame(&random, 0, &f);
            memset(&e, 0, sizeof e);
            memset(&ray, 0, sizeof ray);
            memset(&shading, 0, sizeof shading);
            f.depth = fabsf(ANY);
            for (c = 0; c < 3; ++c) {
                f.curvature[c] = ANY * 0.1f;
                ray.origin[c] = ANY;
                ray.direction[c] = ANY;
                e.light[c] = ANY;
            }
            ray.t_min = fabsf(ANY);
            ray.t_max = zoo_below(&random, 2) ? 0.0f : ray.t_min + fabsf(ANY);
            g.dudx = ANY;
            g.dudy = ANY;
            g.dvdx = ANY;
            g.dvdy = ANY;
            e.flags = zoo_next(&random) & (CONEMAP_EFFECT_ALL_BITS & ~(unsigned)CONEMAP_EFFECT_DEPTH);
            if (zoo_below(&random, 2)) e.flags &= ~(unsigned)SECOND_CHOICES;
            e.frames = &f;
            e.gradients = &g;
            e.levels = &s.map;
            e.level_count = 1;
            e.alpha = alpha;
            e.sky_directions = 3;
            e.light_is_point = zoo_below(&random, 2);
#undef ANY
            shading.shadow = shading.occlusion = 0.5f;
            result = conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1);
            if (result != CONEMAP_OK) continue;
            ++valid;
            CHECK((int)hit.status >= 0 && hit.status < CONEMAP_INVALID, "status %d", (int)hit.status);
            CHECK(shading.shadow >= 0.0f && shading.shadow <= 1.0f && shading.occlusion >= 0.0f &&
                      shading.occlusion <= 1.0f && shading.fade >= 0.0f && shading.fade <= 1.0f,
                  "round %d: ray %d: shadow %g, occlusion %g, fade %g", round, k, (double)shading.shadow,
                  (double)shading.occlusion, (double)shading.fade);
            if (hit.status == CONEMAP_HIT)
                for (c = 0; c < 3; ++c) CHECK(shading.normal[c] >= -1.001f && shading.normal[c] <= 1.001f, "normal");
        }
        scene_free(&s);
    }
    CHECK(valid > 300, "%d of 3600 were valid", valid);
}

/* ---- levels ---------------------------------------------------------------------------------------- */

static void level_means(void)
{
    static const int sizes[][2] = {{8, 8}, {7, 5}, {1, 6}, {13, 1}, {5, 16}};
    int k, level;
    for (k = 0; k < 5; ++k) {
        float heights[16 * 16];
        conemap_desc desc;
        conemap_map maps[6];
        int count = conemap_level_count(sizes[k][0], sizes[k][1]);
        double first = 0.0;
        memset(&desc, 0, sizeof desc);
        zoo_fill(ZOO_WHITE, sizes[k][0], sizes[k][1], 3, heights);
        desc.heights.pixels = heights;
        desc.heights.width = sizes[k][0];
        desc.heights.height = sizes[k][1];
        REQUIRE(conemap_build_levels(&desc, maps, count) == CONEMAP_OK, "levels");
        CHECK(maps[count - 1].info.width == 1 && maps[count - 1].info.height == 1, "%d levels", count);
        for (level = 0; level < count; ++level) {
            const conemap_info *info = &maps[level].info;
            double mean = 0.0;
            int i;
            for (i = 0; i < info->width * info->height; ++i) mean += (double)maps[level].heights[i];
            mean /= info->width * info->height;
            if (level == 0) first = mean;
            CHECK(fabs(mean - first) < 1e-6, "%d x %d: mean of level %d is %g, was %g", sizes[k][0], sizes[k][1], level,
                  mean, first);
            CHECK(info->guarantee == CONEMAP_GUARANTEE_BILINEAR, "guarantee");
        }
        if (k == 1) { /* 7 texels to 3: the first is texels 0, 1 and a third of 2; 5 rows to 2: 0, 1 and half of 2 */
            double right = 0.0, wx[3] = {3.0 / 7.0, 3.0 / 7.0, 1.0 / 7.0}, wy[3] = {0.4, 0.4, 0.2};
            int x, y;
            for (y = 0; y < 3; ++y)
                for (x = 0; x < 3; ++x) right += wx[x] * wy[y] * (double)heights[y * 7 + x];
            CHECK(fabs((double)maps[1].heights[0] - right) < 1e-6, "odd: %g, right %g", (double)maps[1].heights[0],
                  right);
        }
        for (level = 0; level < count; ++level) conemap_free(&maps[level]);
    }
}

/* The rule for two levels holds no point of their blend; the blend of the tangents, which looks as good, does. */
static void level_cones(void)
{
    struct zoo_random random = zoo_seed(9);
    conemap_desc desc;
    conemap_map maps[2];
    struct truth_map t[2];
    float heights[32 * 32];
    int x, y, k, bad = 0, bad_blend = 0;
    /* stripes two texels wide that the next level keeps, under noise that it does not */
    for (y = 0; y < 32; ++y)
        for (x = 0; x < 32; ++x)
            heights[y * 32 + x] = (x / 8 & 1 ? 0.75f : 0.0f) + ((x ^ y) & 1 ? 0.2f : 0.0f) * (y < 16 ? 1.0f : 0.0f);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = 32;
    desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    desc.max_tan = 16.0f;
    REQUIRE(conemap_build_levels(&desc, maps, 2) == CONEMAP_OK, "levels");
    for (k = 0; k < 2; ++k) {
        t[k].width = maps[k].info.width;
        t[k].height = maps[k].info.height;
        t[k].wrap_u = t[k].wrap_v = 1;
        t[k].heights = maps[k].heights;
    }
    for (k = 0; k < 100000; ++k) {
        float u = zoo_unit(&random), v = zoo_unit(&random), f = zoo_unit(&random);
        double du = 0.2 * (double)signed_unit(&random), dv = 0.2 * (double)signed_unit(&random);
        double rise, way, w = (double)f;
        conemap_sample a, b;
        conemap_sample_at(&maps[0], u, v, &a);
        conemap_sample_at(&maps[1], u, v, &b);
        rise = (1.0 - w) * truth_height(&t[0], (double)u + du, (double)v + dv) +
               w * truth_height(&t[1], (double)u + du, (double)v + dv) -
               ((1.0 - w) * truth_height(&t[0], (double)u, (double)v) + w * truth_height(&t[1], (double)u, (double)v)) -
               MISS;
        way = sqrt(du * du + dv * dv);
        bad += rise / ((1.0 - w) / (double)a.tan + w / (double)b.tan) > way * (1.0 + 1e-6);
        bad_blend += rise * ((1.0 - w) * (double)a.tan + w * (double)b.tan) > way;
    }
    CHECK(bad == 0, "%d points in blended cones", bad);
    CHECK(bad_blend > 0, "the map is too tame to tell a wrong rule");
    conemap_free(&maps[0]);
    conemap_free(&maps[1]);
}

/* Nothing jumps as a surface moves away: level, fade and the hit change smoothly, and end on the base itself. */
static void no_popping(void)
{
    struct scene s;
    conemap_map levels[5];
    conemap_desc desc;
    conemap_frame f;
    conemap_effects e;
    float last_u = 0.0f, last_n[3] = {0.0f, 0.0f, 0.0f};
    int k;
    memset(&desc, 0, sizeof desc);
    memset(&e, 0, sizeof e);
    memset(&f, 0, sizeof f);
    if (!scene_make(&s, ZOO_FBM, 32, 32, 1, 2, NULL)) return;
    desc.heights.pixels = s.heights;
    desc.heights.width = desc.heights.height = 32;
    desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    REQUIRE(conemap_build_levels(&desc, levels, 5) == CONEMAP_OK, "levels");
    f.depth = 0.1f;
    f.level = 1.0f;
    e.frames = &f;
    e.levels = levels;
    e.level_count = 5;
    e.flags = CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_SMOOTH_NORMAL;
    for (k = 0; k <= 4000; ++k) {
        conemap_ray ray = {{0.21f, 0.33f, 0.0f}, {0.8f, 0.1f, -0.35f}, 0.0f, 0.0f};
        conemap_gradient gradient = {0.0f, 0.0f, 0.0f, 0.0f};
        conemap_hit hit;
        conemap_shading shading;
        gradient.dvdy = gradient.dudx = 0.01f * powf(2.0f, (float)k / 500.0f);
        e.gradients = &gradient;
        memset(&shading, 0, sizeof shading);
        REQUIRE(conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade");
        CHECK(hit.status == CONEMAP_HIT, "step %d: status %d", k, (int)hit.status);
        if (k > 0) {
            float turn = last_n[0] * shading.normal[0] + last_n[1] * shading.normal[1] + last_n[2] * shading.normal[2];
            CHECK(fabsf(hit.u - last_u) < 4e-3f, "step %d: u jumps from %g to %g at level %g, fade %g", k,
                  (double)last_u, (double)hit.u, (double)shading.level, (double)shading.fade);
            CHECK(turn > 0.998f, "step %d: the normal turns by %g at level %g, fade %g", k, acos((double)turn),
                  (double)shading.level, (double)shading.fade);
        }
        last_u = hit.u;
        memcpy(last_n, shading.normal, sizeof last_n);
    }
    { /* a grazing look: long footprints, but relief stands as many pixels high */
        conemap_gradient gradient = {0.01f, 0.0f, 0.0f, 0.6f};
        conemap_lod lod;
        CHECK(conemap_lod_at(&s.map, &e, &gradient, &lod) == CONEMAP_OK && lod.fade == 0.0f && lod.level == 4.0f,
              "fade %g, level %g", (double)lod.fade, (double)lod.level);
    }
    CHECK(fabsf(last_u - 0.21f) < 1e-4f, "the faded hit is at %g, the base at 0.21", (double)last_u);
    for (k = 0; k < 5; ++k) conemap_free(&levels[k]);
    scene_free(&s);
}

/* ---- light ----------------------------------------------------------------------------------------- */

static void shadows(void)
{
    struct zoo_random random = zoo_seed(10);
    int round, wrong = 0, dark = 0, total = 0;
    for (round = 0; round < 16; ++round) {
        struct scene s;
        int k, point = round % 5 >= 3;
        if (!scene_make(&s, shapes[round % 4], 24, 20, round % 3, (uint32_t)round, NULL)) return;
        for (k = 0; k < 200; ++k) {
            conemap_ray ray;
            conemap_hit hit;
            conemap_shading shading;
            conemap_effects e;
            conemap_frame f;
            double from[3], to[3], t, depth = 0.3;
            int c, shadow;
            memset(&ray, 0, sizeof ray);
            memset(&e, 0, sizeof e);
            memset(&f, 0, sizeof f);
            f.depth = 0.3f;
            e.frames = &f;
            e.flags = CONEMAP_EFFECT_SHADOW | (k & 1 ? (unsigned)CONEMAP_EFFECT_CURVED : 0u);
            e.light_is_point = point;
            ray.origin[0] = zoo_unit(&random);
            ray.origin[1] = zoo_unit(&random);
            ray.origin[2] = 0.4f;
            ray.direction[2] = -1.0f;
            for (c = 0; c < 3; ++c) e.light[c] = point ? zoo_unit(&random) : signed_unit(&random);
            e.light[2] = point ? zoo_between(&random, 0.05f, 0.35f) : 0.7f * zoo_unit(&random) + 0.01f;
            if (!CHECK(conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade")) break;
            if (hit.status != CONEMAP_HIT) continue;
            from[0] = (double)hit.u;
            from[1] = (double)hit.v;
            from[2] = truth_height(&s.truth, from[0], from[1]) + MISS;
            for (c = 0; c < 3; ++c) to[c] = (double)e.light[c];
            to[2] /= depth;
            if (point)
                for (c = 0; c < 3; ++c) to[c] -= from[c];
            shadow = truth_trace(&s.truth, from, to, point ? 1.0 : HUGE_VAL, &t);
            ++total;
            dark += shadow;
            CHECK(shading.shadow == 0.0f || shading.shadow == 1.0f, "shadow %g", (double)shading.shadow);
            if ((shading.shadow == 0.0f) == shadow) continue;
            { /* the two may differ where the light only just touches: where a little lower and higher they do */
                double low[3], high[3], up[3], down[3];
                for (c = 0; c < 3; ++c) {
                    low[c] = from[c] - (c == 2 ? 0.5 * MISS : 0.0);
                    high[c] = from[c] + (c == 2 ? 0.5 * MISS : 0.0);
                    down[c] = to[c] - (c == 2 ? 2e-6 : 0.0);
                    up[c] = to[c] + (c == 2 ? 2e-6 : 0.0);
                }
                if (truth_trace(&s.truth, low, down, point ? 1.0 : HUGE_VAL, &t) ==
                    truth_trace(&s.truth, high, up, point ? 1.0 : HUGE_VAL, &t))
                    ++wrong;
            }
        }
        scene_free(&s);
    }
    CHECK(wrong == 0, "%d of %d shadows are wrong", wrong, total);
    CHECK(dark > total / 8 && dark < total * 7 / 8, "%d of %d dark: the test shows little", dark, total);
    test_note("shadows %d/%d dark", dark, total);
}

/* The share of a disc seen from a point, by rays over a lattice on it. */
static double disc_seen(const struct truth_map *map, const double from[3], const double light[3], double radius,
                        double depth)
{
    const int n = 32;
    double side[3], up[3], length = sqrt(light[0] * light[0] + light[1] * light[1] + light[2] * light[2]), l[3], flat;
    int i, j, c, seen = 0, all = 0;
    for (c = 0; c < 3; ++c) l[c] = light[c] / length;
    flat = sqrt(l[0] * l[0] + l[1] * l[1]);
    side[0] = l[1] / flat;
    side[1] = -l[0] / flat;
    side[2] = 0.0;
    up[0] = side[1] * l[2] - side[2] * l[1];
    up[1] = side[2] * l[0] - side[0] * l[2];
    up[2] = side[0] * l[1] - side[1] * l[0];
    for (j = 0; j < n; ++j)
        for (i = 0; i < n; ++i) {
            double x = (2.0 * i + 1.0) / n - 1.0, y = (2.0 * j + 1.0) / n - 1.0, d[3], t;
            if (x * x + y * y > 1.0) continue;
            for (c = 0; c < 3; ++c) d[c] = l[c] + radius * (x * side[c] + y * up[c]);
            d[2] /= depth;
            ++all;
            seen += !truth_trace(map, from, d, HUGE_VAL, &t);
        }
    return (double)seen / all;
}

static float shadow_at(const struct scene *s, const conemap_effects *e, float u, float v, conemap_hit *hit)
{
    conemap_ray ray = {{0.0f, 0.0f, 2.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
    conemap_shading shading;
    ray.origin[0] = u;
    ray.origin[1] = v;
    shading.shadow = -1.0f;
    CHECK(conemap_shade(&s->map, NULL, e, &ray, hit, &shading, 1) == CONEMAP_OK, "shade");
    return shading.shadow;
}

static void soft_shadows(void)
{
    struct zoo_random random = zoo_seed(11);
    int round, part = 0, k;
    double sum = 0.0, worst = 0.0;
    conemap_effects e;
    conemap_frame f;
    conemap_hit hit;
    struct scene s;
    memset(&e, 0, sizeof e);
    memset(&f, 0, sizeof f);
    f.depth = 0.3f;
    e.frames = &f;
    e.flags = CONEMAP_EFFECT_SOFT_SHADOW;
    for (round = 0; round < 600 && part < 60; ++round) {
        double from[3], light[3], right, is;
        if (!scene_make(&s, round % 3 == 2 ? ZOO_SPIKES : round & 1 ? ZOO_FBM : ZOO_BRICKS, 16, 16, round & 1,
                        (uint32_t)round, NULL))
            return;
        e.light[0] = signed_unit(&random);
        e.light[1] = signed_unit(&random);
        e.light[2] = zoo_between(&random, 0.2f, 1.0f);
        e.light_radius = zoo_between(&random, 0.02f, 0.12f);
        is = (double)shadow_at(&s, &e, zoo_unit(&random), zoo_unit(&random), &hit);
        CHECK(is >= 0.0 && is <= 1.0, "shadow %g", is);
        for (k = 0; k < 3; ++k) light[k] = (double)e.light[k];
        from[0] = (double)hit.u;
        from[1] = (double)hit.v;
        from[2] = truth_height(&s.truth, from[0], from[1]) + MISS;
        if (is <= 0.0 || is >= 1.0) { /* corners of the disc must agree with a full answer */
            if (round % 6 == 0) {
                right = disc_seen(&s.truth, from, light, 0.9 * (double)e.light_radius, 0.3);
                CHECK(fabs(right - is) < 0.08, "round %d: %g, right %g", round, is, right);
            }
        } else {
            right = disc_seen(&s.truth, from, light, (double)e.light_radius, 0.3);
            ++part;
            sum += fabs(is - right);
            if (fabs(is - right) > worst) worst = fabs(is - right);
        }
        scene_free(&s);
    }
    CHECK(part >= 40, "%d half shadows", part);
    CHECK(sum / part < 0.01 && worst < 0.06, "off by %g, at worst by %g", sum / part, worst);
    test_note("half shadows off by %.3f, worst %.3f", sum / part, worst);

    { /* a tower: no bands, neither along its shadow's end nor across its sides */
        float heights[64 * 64], last = -1.0f, most = 0.0f;
        conemap_desc desc;
        int axis, x, y, between = 0;
        memset(&desc, 0, sizeof desc);
        for (y = 0; y < 64; ++y)
            for (x = 0; x < 64; ++x) heights[y * 64 + x] = x >= 8 && x < 12 && y >= 24 && y < 40 ? 0.9f : 0.1f;
        desc.heights.pixels = heights;
        desc.heights.width = desc.heights.height = 64;
        REQUIRE(conemap_build(&desc, &s.map) == CONEMAP_OK, "build");
        f.depth = 0.5f;
        e.light[0] = -1.0f;
        e.light[1] = 0.0f;
        e.light[2] = 0.8f;
        e.light_radius = 0.1f;
        for (axis = 0; axis < 2; ++axis) {
            last = -1.0f;
            most = 0.0f;
            for (k = 0; k < 2000; ++k) {
                float at = (float)k / 2000.0f, lit;
                lit = axis ? shadow_at(&s, &e, 0.5f, at, &hit) : shadow_at(&s, &e, 0.25f + 0.7f * at, 0.5f, &hit);
                if (last >= 0.0f && fabsf(lit - last) > most) most = fabsf(lit - last);
                last = lit;
                between += lit > 0.02f && lit < 0.98f;
            }
            CHECK(most < 0.02f, "axis %d: a step of %g", axis, (double)most);
        }
        CHECK(between > 100, "%d in the penumbra", between);
        conemap_free(&s.map);
    }
}

/* Horizons by dense marching, and their integral. */
static double sky_seen(const struct truth_map *map, double u, double v, double z, const double n[3], double depth,
                       int directions)
{
    double sum = 0.0;
    int k, step, part;
    for (k = 0; k < directions; ++k) {
        double a = 2.0 * PI * (k + 0.5) / directions, c = cos(a), s = sin(a), horizon = -1e9, low, dark = 0.0;
        for (step = 1; step <= 8000; ++step) {
            double r = 10.0 * step * step / 64e6, x = u + r * c, y = v + r * s, slope;
            if (horizon * r > depth) break; /* nothing is higher */
            if (map->wrap_u != 1 && (x < 0.0 || x > 1.0 || y < 0.0 || y > 1.0)) break;
            slope = depth * (truth_height(map, x, y) - z) / r;
            if (slope > horizon) horizon = slope;
        }
        low = atan(horizon);
        for (part = 0; part < 400; ++part) { /* (n . w) cos e de, w at elevation e */
            double e = low + (0.5 * PI - low) * (part + 0.5) / 400.0;
            double w = (n[0] * c + n[1] * s) * cos(e) + n[2] * sin(e);
            if (w > 0.0) dark += w * cos(e) * (0.5 * PI - low) / 400.0;
        }
        sum += dark * 2.0 * PI / directions;
    }
    return sum / PI;
}

static void skies(void)
{
    int round, k;
    double worst = 0.0;
    conemap_frame f;
    memset(&f, 0, sizeof f);
    f.depth = 0.2f;
    for (round = 0; round < 6; ++round) {
        struct scene s;
        float sky[24 * 24];
        if (!scene_make(&s, shapes[round % 3], 24, 24, round & 1, (uint32_t)round, NULL)) return;
        memset(sky, 0x7f, sizeof sky);
        CHECK(conemap_bake_sky(&s.map, &f, 16, 0, 10, sky) == CONEMAP_OK, "sky");
        CHECK(conemap_bake_sky(&s.map, &f, 16, 10, 0, sky) == CONEMAP_OK, "sky");
        for (k = round; k < 24 * 24; k += 31) {
            conemap_sample sample;
            double n[3], right, u = (k % 24 + 0.5) / 24.0, v = (k / 24 + 0.5) / 24.0, length;
            float slope[2];
            conemap_smooth_slope(&s.map, (float)u, (float)v, slope);
            conemap_sample_at(&s.map, (float)u, (float)v, &sample);
            n[0] = -(double)(slope[0] * f.depth);
            n[1] = -(double)(slope[1] * f.depth);
            length = sqrt(n[0] * n[0] + n[1] * n[1] + 1.0);
            n[0] /= length;
            n[1] /= length;
            n[2] = 1.0 / length;
            right = sky_seen(&s.truth, u, v, (double)s.map.heights[k] + MISS, n, (double)f.depth, 16);
            if (fabs(right - (double)sky[k]) > worst) worst = fabs(right - (double)sky[k]);
            CHECK(fabs(right - (double)sky[k]) < 3e-3, "round %d: texel %d: %g, right %g", round, k, (double)sky[k],
                  right);
        }
        scene_free(&s);
    }
    { /* what is out of reach hides nothing: a tower, seen from 0.3 away */
        float heights[32 * 32], seen[3];
        conemap_desc desc;
        conemap_map map;
        memset(&desc, 0, sizeof desc);
        memset(heights, 0, sizeof heights);
        for (k = 0; k < 32; ++k) heights[k * 32 + 20] = 1.0f;
        desc.heights.pixels = heights;
        desc.heights.width = desc.heights.height = 32;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        for (k = 0; k < 3; ++k) {
            conemap_ray ray = {{0.3f, 0.5f, 3.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
            conemap_hit hit;
            conemap_shading shading;
            conemap_effects e;
            memset(&e, 0, sizeof e);
            e.flags = CONEMAP_EFFECT_SKY;
            e.sky_directions = 64;
            e.sky_reach = k == 0 ? 0.2f : k == 1 ? 0.4f : 0.0f;
            CHECK(conemap_shade(&map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade");
            seen[k] = shading.occlusion;
        }
        CHECK(seen[0] > 0.999f && seen[1] < 0.9f && seen[2] < seen[1] - 0.05f, "reach: %g %g %g", (double)seen[0],
              (double)seen[1], (double)seen[2]);
        conemap_free(&map);
    }
    test_note("sky off by %.4f", worst);
}

/* What is guessed from a cone alone is dark where it is dark; and what the cone proves open is open. */
static void cone_openness(void)
{
    static const int kinds[] = {ZOO_BRICKS, ZOO_CLIFF, ZOO_FBM};
    double off = 0.0;
    int round, k;
    for (round = 0; round < 3; ++round) {
        enum { SIZE = 64, COUNT = SIZE * SIZE };
        static float sky[COUNT];
        struct scene s;
        conemap_frame f;
        double a = 0.0, b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0, like;
        memset(&f, 0, sizeof f);
        f.depth = 0.1f;
        if (!scene_make(&s, kinds[round], SIZE, SIZE, 1, (uint32_t)round, NULL)) return;
        CHECK(conemap_bake_sky(&s.map, &f, 12, 0, 0, sky) == CONEMAP_OK, "sky");
        for (k = 0; k < COUNT; ++k) {
            conemap_ray ray = {{0.0f, 0.0f, 1.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
            conemap_hit hit;
            conemap_shading shading;
            conemap_effects e;
            conemap_sample sample;
            double x, y, tangent;
            memset(&e, 0, sizeof e);
            e.frames = &f;
            e.flags = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SMOOTH_NORMAL;
            ray.origin[0] = ((float)(k % SIZE) + 0.5f) / (float)SIZE;
            ray.origin[1] = ((float)(k / SIZE) + 0.5f) / (float)SIZE;
            if (!CHECK(conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1) == CONEMAP_OK, "shade")) break;
            conemap_sample_at(&s.map, hit.u, hit.v, &sample);
            tangent = (double)sample.tan / (double)f.depth;
            x = (double)shading.occlusion;
            y = (double)sky[k];
            CHECK(x >= 0.0 && x <= 1.0, "guess %g", x);
            /* the cone alone proves so much of the sky open, around the zenith */
            CHECK(y > (double)shading.normal[2] * tangent * tangent / (1.0 + tangent * tangent) - 2e-2,
                  "round %d: texel %d sees %g, its cone more", round, k, y);
            off += fabs(x - y) / (3.0 * (double)COUNT);
            a += x / (double)COUNT;
            b += y / (double)COUNT;
            aa += x * x / (double)COUNT;
            bb += y * y / (double)COUNT;
            ab += x * y / (double)COUNT;
        }
        like = (ab - a * b) / sqrt((aa - a * a) * (bb - b * b) + 1e-12);
        CHECK(round == 2 || like > 0.7, "round %d: guess and truth correlate by %g", round, like);
        scene_free(&s);
    }
    CHECK(off < 0.06, "the cone's guess is off by %g", off);
    test_note("cones' guess by %.3f", off);
}

/* ---- border, sides, off ---------------------------------------------------------------------------- */

/* Clipping to tiles: as a map that ends there. */
static void clips(void)
{
    struct zoo_random random = zoo_seed(13);
    struct scene s;
    struct ground g;
    conemap_effects e;
    conemap_frame f;
    int k, left = 0;
    if (!scene_make(&s, ZOO_FBM, 16, 16, 1, 4, NULL)) return;
    ground_plain(&g, &s);
    memset(&e, 0, sizeof e);
    random_frame(&random, 0, &f);
    e.frames = &f;
    e.flags = CONEMAP_EFFECT_CLIP;
    e.clip[0] = (float)(g.low[0] = 0.25);
    e.clip[1] = (float)(g.low[1] = -0.5);
    e.clip[2] = (float)(g.high[0] = 1.75);
    e.clip[3] = (float)(g.high[1] = 1.5);
    check_rays("clips", &g, &f, &s.map, &e, &random, 300, 2e-4);
    e.flags |= CONEMAP_EFFECT_CURVED;
    f.curvature[0] = 0.5f;
    check_rays("clips", &g, &f, &s.map, &e, &random, 200, 2e-4);
    f.curvature[0] = 0.0f;
    for (k = 0; k < 300; ++k) { /* a bent base of no curvature is the plain trace; sides face the ray */
        conemap_ray ray;
        conemap_hit a, b;
        conemap_shading sa, sb;
        random_world_ray(&random, &f, &ray);
        e.flags = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SHADOW;
        e.light[2] = 1.0f;
        CHECK(conemap_shade(&s.map, NULL, &e, &ray, &a, &sa, 1) == CONEMAP_OK, "shade");
        e.flags |= CONEMAP_EFFECT_CURVED;
        CHECK(conemap_shade(&s.map, NULL, &e, &ray, &b, &sb, 1) == CONEMAP_OK, "shade");
        CHECK(a.status == b.status && a.inside == b.inside, "ray %d: %d %d and %d %d", k, (int)a.status, a.inside,
              (int)b.status, b.inside);
        left += a.status == CONEMAP_LEFT;
        if (a.status != CONEMAP_HIT || b.status != CONEMAP_HIT) continue;
        CHECK(fabsf(a.t - b.t) < 1e-5f * a.t, "ray %d: %g and %g", k, (double)a.t, (double)b.t);
        if (a.inside) {
            float toward = sa.normal[0] * ray.direction[0] + sa.normal[1] * ray.direction[1] +
                           sa.normal[2] * ray.direction[2];
            CHECK(toward < 1e-5f, "ray %d: a side's normal looks away", k);
            CHECK(fabsf(sa.normal[0] - sb.normal[0]) + fabsf(sa.normal[1] - sb.normal[1]) < 1e-4f, "ray %d: side", k);
        }
    }
    CHECK(left > 20, "%d left", left);
    { /* a wall behind the clip throws no shadow; a side's normal is that of the side */
        float heights[16 * 16];
        conemap_desc desc;
        conemap_map map;
        conemap_ray down = {{0.5f, 0.5f, 2.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
        conemap_ray level = {{-1.0f, 0.5f, 0.05f}, {1.0f, 0.01f, 0.0f}, 0.0f, 0.0f};
        conemap_hit hit;
        conemap_shading shading;
        memset(&desc, 0, sizeof desc);
        memset(&e, 0, sizeof e);
        for (k = 0; k < 256; ++k) heights[k] = k % 16 == 12 ? 1.0f : 0.1f;
        desc.heights.pixels = heights;
        desc.heights.width = desc.heights.height = 16;
        desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        e.flags = CONEMAP_EFFECT_CLIP | CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_NORMAL;
        e.light[0] = 1.0f;
        e.light[2] = 0.3f;
        e.clip[2] = 0.65f;
        e.clip[3] = 1.0f;
        CHECK(conemap_shade(&map, NULL, &e, &down, &hit, &shading, 1) == CONEMAP_OK && shading.shadow == 1.0f,
              "clipped wall");
        CHECK(conemap_shade(&map, NULL, &e, &level, &hit, &shading, 1) == CONEMAP_OK && hit.inside &&
                  shading.normal[0] == -1.0f && shading.shadow == 0.0f,
              "side: normal %g, shadow %g", (double)shading.normal[0], (double)shading.shadow);
        e.clip[2] = 1.0f;
        CHECK(conemap_shade(&map, NULL, &e, &down, &hit, &shading, 1) == CONEMAP_OK && shading.shadow == 0.0f, "wall");
        conemap_free(&map);
    }
    scene_free(&s);
}

/* From behind, a two-sided surface looks as from before. */
static void two_sides(void)
{
    struct zoo_random random = zoo_seed(14);
    struct scene s;
    conemap_effects e;
    conemap_frame f;
    int k;
    if (!scene_make(&s, ZOO_FBM, 16, 16, 1, 4, NULL)) return;
    memset(&e, 0, sizeof e);
    memset(&f, 0, sizeof f);
    f.depth = 0.2f;
    f.level = 1.0f;
    e.frames = &f;
    e.flags = CONEMAP_EFFECT_TWO_SIDED | CONEMAP_EFFECT_NORMAL;
    for (k = 0; k < 100; ++k) {
        conemap_ray rays[2];
        conemap_hit hits[2];
        conemap_shading shadings[2];
        random_world_ray(&random, &f, &rays[0]);
        rays[0].origin[2] = 0.5f;
        rays[0].direction[2] = -0.5f;
        rays[1] = rays[0];
        rays[1].origin[2] = -rays[0].origin[2];
        rays[1].direction[2] = -rays[0].direction[2];
        CHECK(conemap_shade(&s.map, NULL, &e, rays, hits, shadings, 2) == CONEMAP_OK, "shade");
        CHECK(hits[0].status == CONEMAP_HIT && hits[1].status == CONEMAP_HIT && hits[0].t == hits[1].t,
              "ray %d: t %g and %g", k, (double)hits[0].t, (double)hits[1].t);
        CHECK(shadings[0].normal[2] == -shadings[1].normal[2] && shadings[0].normal[2] > 0.0f, "ray %d: normals", k);
    }
    scene_free(&s);
}

static void gradients(void)
{
    struct zoo_random random = zoo_seed(15);
    int k, c;
    for (k = 0; k < 200; ++k) {
        conemap_frame f;
        conemap_ray r[3];
        conemap_gradient g;
        double uv[3][2];
        random_frame(&random, 0, &f);
        random_world_ray(&random, &f, &r[0]);
        r[1] = r[2] = r[0];
        for (c = 0; c < 3; ++c) {
            r[1].direction[c] += 0.01f * f.tangent[c];
            r[2].direction[c] += 0.01f * f.bitangent[c];
        }
        REQUIRE(conemap_gradient_at(&f, &r[0], &r[1], &r[2], &g) == CONEMAP_OK, "gradient");
        for (c = 0; c < 3; ++c) {
            double o[3], d[3], p[3], a[3], b[3];
            int axis;
            ray_at(&r[c], 0.0, p);
            world_to_box(&f, p, a);
            ray_at(&r[c], 1.0, p);
            world_to_box(&f, p, b);
            for (axis = 0; axis < 3; ++axis) {
                o[axis] = a[axis];
                d[axis] = b[axis] - a[axis];
            }
            uv[c][0] = o[0] + d[0] * ((double)f.level - o[2]) / d[2];
            uv[c][1] = o[1] + d[1] * ((double)f.level - o[2]) / d[2];
        }
        CHECK(fabs((double)g.dudx - (uv[1][0] - uv[0][0])) < 1e-5 &&
                  fabs((double)g.dvdx - (uv[1][1] - uv[0][1])) < 1e-5 &&
                  fabs((double)g.dudy - (uv[2][0] - uv[0][0])) < 1e-5 &&
                  fabs((double)g.dvdy - (uv[2][1] - uv[0][1])) < 1e-5,
              "round %d", k);
    }
}

/* Without flags it is conemap_trace to the bit; with one, what the others would write stays. */
static void off_is_off(void)
{
    struct zoo_random random = zoo_seed(16);
    struct scene s;
    conemap_ray rays[70];
    conemap_hit a[70], b[70];
    conemap_shading shadings[70], untouched;
    conemap_effects e;
    int k;
    if (!scene_make(&s, ZOO_FBM, 16, 16, 1, 4, NULL)) return;
    memset(rays, 0, sizeof rays);
    memset(&e, 0, sizeof e);
    memset(a, 1, sizeof a);
    memset(b, 1, sizeof b);
    for (k = 0; k < 70; ++k) {
        rays[k].origin[0] = zoo_unit(&random);
        rays[k].origin[2] = 1.0f;
        rays[k].direction[0] = signed_unit(&random);
        rays[k].direction[2] = k == 40 ? nanf("") : k == 41 ? 0.3f : -0.3f;
    }
    CHECK(conemap_trace(&s.map, NULL, rays, a, 70) == CONEMAP_ERROR_RAY_DIRECTION, "trace");
    CHECK(conemap_shade(&s.map, NULL, &e, rays, b, NULL, 70) == CONEMAP_ERROR_RAY_DIRECTION, "shade");
    CHECK(memcmp(a, b, sizeof a) == 0, "no flags: not the plain trace");
    CHECK(conemap_shade(&s.map, NULL, NULL, rays, b, NULL, 70) == CONEMAP_ERROR_RAY_DIRECTION, "shade");
    CHECK(memcmp(a, b, sizeof a) == 0, "no effects: not the plain trace");
    memset(&untouched, 0x5a, sizeof untouched);
    for (k = 0; k < 70; ++k) shadings[k] = untouched;
    e.flags = CONEMAP_EFFECT_NORMAL;
    CHECK(conemap_shade(&s.map, NULL, &e, rays, b, shadings, 70) == CONEMAP_ERROR_RAY_DIRECTION, "shade");
    for (k = 0; k < 70; ++k) {
        CHECK(a[k].status == b[k].status && (a[k].status == CONEMAP_INVALID || a[k].t == b[k].t), "hit %d", k);
        if (a[k].status == CONEMAP_HIT)
            memcpy(shadings[k].normal, untouched.normal, sizeof untouched.normal);
        CHECK(memcmp(&shadings[k], &untouched, sizeof untouched) == 0, "shading %d was touched", k);
    }
    scene_free(&s);
}

static void bad_input(void)
{
    const float nan = nanf(""), inf = HUGE_VALF;
    static const float identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    unsigned char alpha[64];
    conemap_gradient gradient = {0.1f, 0.0f, 0.0f, 0.1f};
    conemap_ray ray = {{0.5f, 0.5f, 1.0f}, {0.1f, 0.0f, -1.0f}, 0.0f, 0.0f};
    conemap_ray flat = {{0.5f, 0.5f, 1.0f}, {0.1f, 0.0f, 0.0f}, 0.0f, 0.0f}, away;
    conemap_hit hit;
    conemap_shading shading;
    conemap_frame f;
    conemap_effects good, e;
    conemap_lod lod;
    conemap_map empty, levels[4];
    conemap_desc desc;
    struct scene s;
    float point[3] = {0.0f, 0.0f, 0.0f}, slope[2] = {0.0f, 0.0f}, sky[64];
    int k;
    if (!scene_make(&s, ZOO_FBM, 8, 8, 1, 4, NULL)) return;
    memset(&empty, 0, sizeof empty);
    memset(alpha, 255, sizeof alpha);
    memset(&f, 0, sizeof f);
    memset(&good, 0, sizeof good);
    good.frames = &f;
    good.alpha = alpha;
    good.gradients = &gradient;
    good.levels = &s.map;
    good.level_count = 1;
    good.view_projection = identity;
    good.light[2] = 1.0f;
    good.flags = CONEMAP_EFFECT_ALL_BITS & ~(unsigned)SECOND_CHOICES;
    CHECK(conemap_shade(&s.map, NULL, &good, &ray, &hit, &shading, 1) == CONEMAP_OK, "all effects");
#define BAD(change, right)                                                                                   \
    do {                                                                                                     \
        conemap_result got;                                                                                  \
        e = good;                                                                                            \
        memset(&f, 0, sizeof f);                                                                             \
        change;                                                                                              \
        memset(&hit, 0x33, sizeof hit);                                                                      \
        got = conemap_shade(&s.map, NULL, &e, &ray, &hit, &shading, 1);                                      \
        CHECK(got == right, "line %d: %s", __LINE__, conemap_result_string(got));                            \
        CHECK(hit.steps == 0x33333333, "line %d: written", __LINE__);                                        \
    } while (0)
    BAD(e.flags |= CONEMAP_EFFECT_NORMAL, CONEMAP_ERROR_UNSUPPORTED);
    BAD(e.flags |= CONEMAP_EFFECT_SHADOW, CONEMAP_ERROR_UNSUPPORTED);
    BAD(e.flags |= CONEMAP_EFFECT_SKY, CONEMAP_ERROR_UNSUPPORTED);
    BAD(e.flags |= 1u << 20, CONEMAP_ERROR_UNSUPPORTED);
    BAD(e.frames = NULL, CONEMAP_ERROR_NULL);
    BAD(e.alpha = NULL, CONEMAP_ERROR_NULL);
    BAD(e.gradients = NULL, CONEMAP_ERROR_NULL);
    BAD(e.levels = NULL, CONEMAP_ERROR_NULL);
    BAD(e.levels = &empty, CONEMAP_ERROR_NULL);
    BAD(e.view_projection = NULL, CONEMAP_ERROR_NULL);
    BAD(e.level_count = 0, CONEMAP_ERROR_PARAMETER);
    BAD(e.level_count = 17, CONEMAP_ERROR_PARAMETER);
    BAD(e.lod_bias = nan, CONEMAP_ERROR_PARAMETER);
    BAD(e.lod_steps = -1, CONEMAP_ERROR_PARAMETER);
    BAD(e.fade_begin = -1.0f, CONEMAP_ERROR_PARAMETER);
    BAD(e.fade_end = inf, CONEMAP_ERROR_PARAMETER);
    BAD(e.fade_end = 3.0f, CONEMAP_ERROR_PARAMETER);
    BAD(e.alpha_stride = 7, CONEMAP_ERROR_STRIDE);
    BAD(e.alpha_stride = -7, CONEMAP_ERROR_STRIDE);
    BAD(e.alpha_cut = 256, CONEMAP_ERROR_PARAMETER);
    BAD(e.alpha_cut = -1, CONEMAP_ERROR_PARAMETER);
    BAD(e.clip[2] = nan, CONEMAP_ERROR_PARAMETER);
    BAD(e.clip[2] = -1.0f, CONEMAP_ERROR_PARAMETER);
    BAD(e.depth_range = CONEMAP_DEPTH_RANGE_COUNT, CONEMAP_ERROR_ENUM);
    BAD(e.light[2] = 0.0f, CONEMAP_ERROR_PARAMETER);
    BAD(e.light[1] = nan, CONEMAP_ERROR_PARAMETER);
    BAD(e.light_radius = -0.1f, CONEMAP_ERROR_PARAMETER);
    BAD(e.light_radius = 1.1f, CONEMAP_ERROR_PARAMETER);
    BAD((e.flags ^= CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY, e.sky_directions = 1025), CONEMAP_ERROR_PARAMETER);
    BAD((e.flags ^= CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY, e.sky_reach = nan), CONEMAP_ERROR_PARAMETER);
    BAD(f.origin[1] = inf, CONEMAP_ERROR_PARAMETER);
    BAD(f.tangent[1] = nan, CONEMAP_ERROR_PARAMETER);
    BAD(f.tangent[1] = 1.0f, CONEMAP_ERROR_PARAMETER); /* the others are 0 */
    BAD(f.depth = -0.1f, CONEMAP_ERROR_PARAMETER);
    BAD(f.level = 1.1f, CONEMAP_ERROR_PARAMETER);
    BAD(f.aspect = -1.0f, CONEMAP_ERROR_PARAMETER);
    BAD(f.uv_scale[0] = inf, CONEMAP_ERROR_PARAMETER);
    BAD(f.uv_scale[1] = 3e38f, CONEMAP_ERROR_PARAMETER);
    BAD(f.uv_scale[1] = 1e-20f, CONEMAP_ERROR_PARAMETER);
    BAD(f.uv_offset[1] = nan, CONEMAP_ERROR_PARAMETER);
    BAD(f.curvature[0] = 1.0f, CONEMAP_ERROR_PARAMETER); /* times depth 1: folds */
    BAD((f.curvature[1] = 0.6f, f.curvature[2] = -0.6f), CONEMAP_ERROR_PARAMETER);
    BAD((f.tangent[0] = 1.0f, f.bitangent[0] = 1.0f, f.normal[2] = 1.0f), CONEMAP_ERROR_PARAMETER); /* in a plane */
#undef BAD
    memset(&f, 0, sizeof f);
    CHECK(conemap_shade(NULL, NULL, &good, &ray, &hit, &shading, 1) == CONEMAP_ERROR_NULL, "null");
    CHECK(conemap_shade(&s.map, NULL, &good, NULL, &hit, &shading, 1) == CONEMAP_ERROR_NULL, "null");
    CHECK(conemap_shade(&s.map, NULL, &good, &ray, NULL, &shading, 1) == CONEMAP_ERROR_NULL, "null");
    CHECK(conemap_shade(&s.map, NULL, &good, &ray, &hit, NULL, 1) == CONEMAP_ERROR_NULL, "null");
    CHECK(conemap_shade(&s.map, NULL, &good, &ray, &hit, &shading, -1) == CONEMAP_ERROR_PARAMETER, "count");
    CHECK(conemap_shade(&s.map, NULL, &good, NULL, NULL, NULL, 0) == CONEMAP_OK, "no rays");
    { /* a bad ray, frame or gradient spoils its own ray only */
        conemap_frame two[3];
        conemap_gradient both[3];
        conemap_ray rays[3];
        conemap_hit hits[3];
        conemap_shading shadings[3];
        memset(two, 0, sizeof two);
        for (k = 0; k < 3; ++k) {
            rays[k] = ray;
            both[k] = gradient;
        }
        two[1].depth = nan;
        e = good;
        e.frames = two;
        e.frame_per_ray = 1;
        e.gradients = both;
        CHECK(conemap_shade(&s.map, NULL, &e, rays, hits, shadings, 3) == CONEMAP_ERROR_PARAMETER, "frame");
        CHECK(hits[0].status == CONEMAP_HIT && hits[1].status == CONEMAP_INVALID && hits[2].status == CONEMAP_HIT,
              "%d %d %d", (int)hits[0].status, (int)hits[1].status, (int)hits[2].status);
        two[1].depth = 0.0f;
        both[0].dvdy = inf;
        rays[2].origin[0] = nan;
        CHECK(conemap_shade(&s.map, NULL, &e, rays, hits, shadings, 3) == CONEMAP_ERROR_PARAMETER, "gradient");
        CHECK(hits[0].status == CONEMAP_INVALID && hits[1].status == CONEMAP_HIT && hits[2].status == CONEMAP_INVALID,
              "%d %d %d", (int)hits[0].status, (int)hits[1].status, (int)hits[2].status);
        both[0] = gradient;
        CHECK(conemap_shade(&s.map, NULL, &e, rays, hits, shadings, 3) == CONEMAP_ERROR_RAY_ORIGIN, "ray");
    }
    CHECK(conemap_frame_ray(NULL, &ray, &ray) == CONEMAP_ERROR_NULL &&
              conemap_frame_ray(&f, NULL, &ray) == CONEMAP_ERROR_NULL &&
              conemap_frame_ray(&f, &ray, NULL) == CONEMAP_ERROR_NULL,
          "frame_ray");
    CHECK(conemap_frame_point(NULL, point, point) == CONEMAP_ERROR_NULL &&
              conemap_frame_point(&f, NULL, point) == CONEMAP_ERROR_NULL &&
              conemap_frame_point(&f, point, NULL) == CONEMAP_ERROR_NULL,
          "frame_point");
    CHECK(conemap_frame_normal(NULL, 0, 0, slope, point) == CONEMAP_ERROR_NULL &&
              conemap_frame_normal(&f, 0, 0, NULL, point) == CONEMAP_ERROR_NULL &&
              conemap_frame_normal(&f, 0, 0, slope, NULL) == CONEMAP_ERROR_NULL &&
              conemap_frame_normal(&f, nan, 0, slope, point) == CONEMAP_ERROR_PARAMETER,
          "frame_normal");
    away = ray; /* it meets the plane where no float is */
    away.origin[0] = 3e38f;
    away.direction[0] = 3e38f;
    CHECK(conemap_gradient_at(&f, &ray, &flat, &ray, &gradient) == CONEMAP_ERROR_PARAMETER &&
              conemap_gradient_at(&f, &ray, &ray, &away, &gradient) == CONEMAP_ERROR_PARAMETER &&
              conemap_gradient_at(NULL, &ray, &ray, &ray, &gradient) == CONEMAP_ERROR_NULL &&
              conemap_gradient_at(&f, &ray, &ray, &ray, NULL) == CONEMAP_ERROR_NULL,
          "gradient_at");
    CHECK(conemap_lod_at(&s.map, &good, &gradient, &lod) == CONEMAP_OK, "lod");
    CHECK(conemap_lod_at(NULL, &good, &gradient, &lod) == CONEMAP_ERROR_NULL &&
              conemap_lod_at(&s.map, NULL, &gradient, &lod) == CONEMAP_ERROR_NULL &&
              conemap_lod_at(&s.map, &good, NULL, &lod) == CONEMAP_ERROR_NULL &&
              conemap_lod_at(&s.map, &good, &gradient, NULL) == CONEMAP_ERROR_NULL,
          "lod null");
    CHECK(conemap_bake_sky(&s.map, NULL, 1025, 0, 0, sky) == CONEMAP_ERROR_PARAMETER &&
              conemap_bake_sky(&s.map, NULL, 4, 5, 4, sky) == CONEMAP_ERROR_PARAMETER &&
              conemap_bake_sky(&s.map, NULL, 4, -1, 1, sky) == CONEMAP_ERROR_PARAMETER &&
              conemap_bake_sky(NULL, NULL, 4, 0, 0, sky) == CONEMAP_ERROR_NULL &&
              conemap_bake_sky(&s.map, NULL, 4, 0, 0, NULL) == CONEMAP_ERROR_NULL,
          "bake_sky");
    CHECK(conemap_level_count(0, 4) == 0 && conemap_level_count(1, 1) == 1 && conemap_level_count(8, 3) == 4 &&
              conemap_level_count(CONEMAP_MAX_SIZE + 1, 1) == 0,
          "level_count");
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = s.heights;
    desc.heights.width = desc.heights.height = 8;
    memset(levels, 0x11, sizeof levels);
    CHECK(conemap_build_levels(NULL, levels, 1) == CONEMAP_ERROR_NULL &&
              conemap_build_levels(&desc, NULL, 1) == CONEMAP_ERROR_NULL &&
              conemap_build_levels(&desc, levels, 0) == CONEMAP_ERROR_PARAMETER,
          "build_levels");
    desc.heights.width = 4;
    desc.heights.height = 2;
    CHECK(conemap_build_levels(&desc, levels, 4) == CONEMAP_ERROR_PARAMETER && !levels[0].heights && !levels[3].heights,
          "too many levels");
    desc.scratch = sky;
    CHECK(conemap_build_levels(&desc, levels, 2) == CONEMAP_ERROR_UNSUPPORTED, "own memory");
    desc.scratch = NULL;
    desc.aspect = nan;
    CHECK(conemap_build_levels(&desc, levels, 2) == CONEMAP_ERROR_PARAMETER, "bad desc");
    scene_free(&s);
}

static int blocks_left, blocks_live;

static void *few_blocks(size_t size, void *user)
{
    (void)user;
    if (blocks_left-- <= 0) return NULL;
    ++blocks_live;
    return malloc(size);
}

static void release_block(void *memory, void *user)
{
    (void)user;
    if (memory) --blocks_live;
    free(memory);
}

/* Whatever allocation fails, nothing is left and all maps are zeroed. */
static void scarce_memory(void)
{
    float heights[64];
    conemap_desc desc;
    conemap_map maps[3];
    int given, k;
    zoo_fill(ZOO_FBM, 8, 8, 1, heights);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = 8;
    desc.allocator.allocate = few_blocks;
    desc.allocator.release = release_block;
    for (given = 0; given < 100; ++given) {
        conemap_result result;
        blocks_left = given;
        blocks_live = 0;
        result = conemap_build_levels(&desc, maps, 3);
        if (result == CONEMAP_OK) break;
        CHECK(result == CONEMAP_ERROR_MEMORY, "%d blocks: %s", given, conemap_result_string(result));
        CHECK(blocks_live == 0, "%d blocks: %d stay", given, blocks_live);
        for (k = 0; k < 3; ++k) CHECK(!maps[k].heights, "map %d is not zeroed", k);
    }
    CHECK(given > 3 && given < 100, "%d blocks", given);
    for (k = 0; k < 3; ++k) conemap_free(&maps[k]);
    CHECK(blocks_live == 0, "%d blocks stay", blocks_live);
}

const struct test_case effects_tests[] = {
    {"frames", frames},
    {"world hits", world_hits},
    {"depth", depths},
    {"slopes", slopes},
    {"curved", curved},
    {"sectors", sectors},
    {"blended levels", blended_levels},
    {"levels to one texel", levels_to_one_texel},
    {"holes", holes},
    {"holes at the border", holes_at_the_border},
    {"caps", caps},
    {"extremes", extremes},
    {"level means", level_means},
    {"cones between levels", level_cones},
    {"no popping", no_popping},
    {"shadows", shadows},
    {"soft shadows", soft_shadows},
    {"skies", skies},
    {"cone openness", cone_openness},
    {"clips", clips},
    {"two sides", two_sides},
    {"gradients", gradients},
    {"off is off", off_is_off},
    {"bad input", bad_input},
    {"scarce memory", scarce_memory},
    {NULL, NULL},
};
