/* Relief-mapped frusta: rays against a convex search in double precision, bounds, seams, relief against dense
   marching, the equations of [BJCW09], bad inputs. The environment's FRUSTA_RAYS asks for more than the quick number
   of rays. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define CONEMAP_STATIC /* a private copy: one test looks at a bound from inside */
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

#define TURN 6.283185307179586

static int ray_count(int quick)
{
    const char *text = getenv("FRUSTA_RAYS");
    const long wanted = text ? strtol(text, NULL, 10) : 0;
    return wanted > 0 && wanted < 1000000000 ? (int)wanted : quick;
}

/* ---- what a packed frustum means, told a second time ------------------------------------------------------ */

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double unit(double *a)
{
    const double length = sqrt(dot(a, a));
    int k;
    for (k = 0; k < 3 && length > 0; ++k) a[k] /= length;
    return length;
}

static void local_point(const conemap_frustum *f, const double *p, double *out)
{
    const float *rows[3];
    int r, k;
    rows[0] = f->axis_x;
    rows[1] = f->axis_y;
    rows[2] = f->axis_z;
    for (r = 0; r < 3; ++r) {
        out[r] = 0;
        for (k = 0; k < 3; ++k) out[r] += (double)rows[r][k] * (p[k] - (double)rows[k][3]);
    }
}

/* Below 0 inside, in lengths, and convex along any straight line. */
static double outside(const conemap_frustum *f, double height, const double *world)
{
    double p[3], rho, far_out, plane;
    local_point(f, world, p);
    rho = (double)f->r + height * (double)f->t + ((double)f->k + height * (double)f->tk) * p[1];
    far_out = sqrt(p[0] * p[0] + p[2] * p[2]) - rho;
    plane = (double)f->lower[0] * p[0] + (double)f->lower[1] * p[2] + (double)f->lower[2] - p[1];
    if (plane > far_out) far_out = plane;
    plane = p[1] - (double)f->upper[0] * p[0] - (double)f->upper[1] * p[2] - (double)f->upper[2];
    return plane > far_out ? plane : far_out;
}

struct line {
    double o[3], v[3];
};

static double outside_at(const conemap_frustum *f, double height, const struct line *line, double t)
{
    double p[3];
    int k;
    for (k = 0; k < 3; ++k) p[k] = line->o[k] + t * line->v[k];
    return outside(f, height, p);
}

/* Where the line is as low as it gets between a and b. */
static double lowest(const conemap_frustum *f, double height, const struct line *line, double a, double b)
{
    int i;
    for (i = 0; i < 130; ++i) {
        const double c = a + (b - a) * 0.381966, d = b - (b - a) * 0.381966;
        if (outside_at(f, height, line, c) <= outside_at(f, height, line, d)) b = d;
        else a = c;
    }
    return 0.5 * (a + b);
}

/* Where it passes `level` between `low`, below it, and `high`, above it. */
static double passes(const conemap_frustum *f, double height, const struct line *line, double low, double high,
                     double level)
{
    int i;
    if (outside_at(f, height, line, high) <= level) return high;
    for (i = 0; i < 80; ++i) {
        const double middle = 0.5 * (low + high);
        if (outside_at(f, height, line, middle) <= level) low = middle;
        else high = middle;
    }
    return low;
}

/* ---- skeletons --------------------------------------------------------------------------------------------- */

enum shape { CYLINDERS, TAPERED, POINTED, THIN, BENT, FLARED, SHAPES };

struct chain {
    conemap_joint joints[16];
    conemap_segment segments[16];
    conemap_skeleton_desc desc;
};

static float spread(struct zoo_random *random, float by)
{
    return zoo_between(random, -by, by);
}

/* A random chain of a kind; `bend` is how far directions may turn aside, as a share of the length. */
static void make_chain(struct zoo_random *random, int shape, float bend, int count, struct chain *chain)
{
    float direction[3] = {0, 1, 0}, length = shape == THIN ? 3000.0f : shape == FLARED ? 0.4f : 3.0f;
    float radius = shape == THIN ? 0.01f : 0.5f;
    int i, k;
    memset(chain, 0, sizeof *chain);
    for (k = 0; k < 3; ++k) {
        chain->joints[0].position[k] = spread(random, 3.0f);
        direction[k] += spread(random, 1.0f);
    }
    for (i = 0; i <= count; ++i) {
        conemap_joint *joint = &chain->joints[i];
        joint->radius = shape == CYLINDERS || shape == BENT ? radius : radius * zoo_between(random, 0.4f, 1.6f);
        if (shape == TAPERED) joint->radius = radius * (1.0f - (float)i / (float)(count + 1));
        if (shape == POINTED && (i == count || (i == 0 && count > 1))) joint->radius = 0;
        joint->thickness = shape == CYLINDERS ? 0.3f * radius
                           : shape == POINTED ? 0.3f * joint->radius
                                              : radius * zoo_unit(random);
        if (shape != CYLINDERS && shape != TAPERED && zoo_below(random, 6) == 0) joint->thickness = 0;
        if (i == 0) continue;
        for (k = 0; k < 3; ++k) {
            direction[k] += spread(random, bend);
            joint->position[k] = chain->joints[i - 1].position[k] + length * direction[k];
        }
        chain->segments[i - 1].base = i - 1;
        chain->segments[i - 1].top = i;
        chain->segments[i - 1].parent = i - 2;
    }
    chain->desc.joints = chain->joints;
    chain->desc.joint_count = count + 1;
    chain->desc.segments = chain->segments;
    chain->desc.segment_count = count;
}

/* Makes a chain's sections elliptical; its segments' twist goes. */
static void flatten(struct zoo_random *random, float flat, struct chain *chain)
{
    int i, k;
    for (k = 0; k < 3; ++k) chain->segments[0].wide[k] = spread(random, 1.0f);
    for (i = 0; i < chain->desc.segment_count; ++i) {
        chain->segments[i].flat = flat;
        chain->segments[i].twist = 0;
    }
}

static int random_skeleton(struct zoo_random *random, struct chain *chain, conemap_skeleton *skeleton)
{
    const int shape = zoo_below(random, SHAPES);
    const float bends[] = {0.0f, 1e-7f, 1e-3f, 0.1f, 0.5f, 2.0f};
    make_chain(random, shape, bends[zoo_below(random, 6)], 1 + zoo_below(random, 6), chain);
    if (zoo_below(random, 3) == 0) flatten(random, zoo_between(random, 0.05f, 1.0f), chain);
    return CHECK(conemap_skeleton_build(&chain->desc, skeleton) == CONEMAP_OK, "shape %d: %s", shape,
                 conemap_result_string(conemap_skeleton_build(&chain->desc, skeleton)));
}

/* A ray that means trouble for a frustum: through it at random, along its axis or its side, from inside, across a
   tip. */
static conemap_ray hard_ray(struct zoo_random *random, const conemap_frustum *f)
{
    conemap_ray ray;
    float from[3], to[3], a[3], b[3];
    const int kind = zoo_below(random, 10);
    int k;
    memset(&ray, 0, sizeof ray);
    from[0] = zoo_unit(random);
    from[1] = zoo_between(random, -0.2f, 1.2f);
    from[2] = zoo_below(random, 2) ? 0.0f : zoo_between(random, -0.5f, 2.0f);
    to[0] = zoo_unit(random);
    to[1] = zoo_between(random, -0.2f, 1.2f);
    to[2] = zoo_below(random, 2) ? 0.0f : zoo_between(random, -0.5f, 1.0f);
    if (kind == 0) to[0] = from[0]; /* along a side, or nearly so */
    if (kind == 0) to[2] = from[2] = 0.0f;
    if (conemap_frustum_point(f, from, a) != CONEMAP_OK || conemap_frustum_point(f, to, b) != CONEMAP_OK) {
        for (k = 0; k < 3; ++k) {
            a[k] = spread(random, 4.0f);
            b[k] = spread(random, 4.0f);
        }
    }
    for (k = 0; k < 3; ++k) {
        const float axis[3] = {f->axis_x[3], f->axis_y[3], f->axis_z[3]};
        ray.origin[k] = a[k];
        ray.direction[k] = b[k] - a[k];
        if (kind == 1) { /* on the axis */
            ray.origin[k] = axis[k] - f->axis_y[k] * f->h;
            ray.direction[k] = f->axis_y[k];
        }
        if (kind == 2) ray.direction[k] = f->axis_y[k]; /* parallel to it */
        if (kind == 3) ray.direction[k] = k == 1 ? 1.0f : 0.0f;
    }
    if (kind >= 5) /* from before the first point */
        for (k = 0; k < 3; ++k) ray.origin[k] -= ray.direction[k] * (kind == 9 ? 20.0f : 2.0f);
    if (!(fabsf(ray.direction[0]) + fabsf(ray.direction[1]) + fabsf(ray.direction[2]) > 1e-12f))
        ray.direction[0] = 1.0f;
    return ray;
}

/* Compares a span with the convex search; `scale` of the row x, for elliptical sections. */
static void check_span(const conemap_frustum *f, float height, const conemap_ray *ray, int round, int *hits)
{
    struct line line;
    float span[2];
    double size = 0, length, reach, a, b, middle, least, grain;
    int k;
    if (!CHECK(conemap_frustum_span(f, height, ray, span) == CONEMAP_OK, "round %d: span", round)) return;
    for (k = 0; k < 3; ++k) {
        line.o[k] = (double)ray->origin[k];
        line.v[k] = (double)ray->direction[k];
        size += fabs(line.o[k] - (double)(k == 0 ? f->axis_x : k == 1 ? f->axis_y : f->axis_z)[3]);
    }
    length = sqrt(dot(line.v, line.v));
    reach = (size + 3.0 * (double)f->h + 20.0 * (fabs((double)f->r) + fabs((double)f->t)) +
             20.0 * (double)f->h * (fabs((double)f->k) + fabs((double)f->tk)) + fabs((double)f->upper[2])) /
            length;
    a = 0;
    b = reach;
    middle = lowest(f, (double)height, &line, a, b);
    least = outside_at(f, (double)height, &line, middle);
    grain = 4e-7 * (size + length * (double)(span[0] <= span[1] ? span[0] : 0.0f)) + 1e-12;
    if (span[0] > span[1]) {
        CHECK(least > -grain, "round %d: missed, %g deep (r %g k %g h %g)", round, -least, (double)f->r,
              (double)f->k, (double)f->h);
        return;
    }
    ++*hits;
    if (!CHECK(least <= grain, "round %d: hit from %g to %g, %g away", round, (double)span[0], (double)span[1],
               least))
        return;
    if (least > -grain) return; /* grazing: anything near is right */
    {
        const double soon = passes(f, (double)height, &line, middle, a, grain);
        const double late = passes(f, (double)height, &line, middle, a, -grain);
        const double out_soon = passes(f, (double)height, &line, middle, b, -grain);
        const double out_late = passes(f, (double)height, &line, middle, b, grain);
        const double fine = 2e-7 * (double)span[1] + 1e-9 / length;
        CHECK((double)span[0] >= soon - fine && (double)span[0] <= late + fine,
              "round %d: enters at %.9g, right %.9g..%.9g", round, (double)span[0], soon, late);
        CHECK((double)span[1] >= out_soon - fine && (double)span[1] <= out_late + fine,
              "round %d: leaves at %.9g, right %.9g..%.9g", round, (double)span[1], out_soon, out_late);
    }
}

static void spans(void)
{
    struct zoo_random random = zoo_seed(501);
    const int rays = ray_count(12000);
    struct chain chain;
    conemap_skeleton skeleton;
    int round, hits = 0;
    memset(&skeleton, 0, sizeof skeleton);
    for (round = 0; round < rays; ++round) {
        conemap_frustum f;
        conemap_ray ray;
        if (round % 64 == 0) {
            conemap_skeleton_free(&skeleton);
            if (!random_skeleton(&random, &chain, &skeleton)) return;
        }
        f = skeleton.frusta[zoo_below(&random, skeleton.count)];
        ray = hard_ray(&random, &f);
        if (round % 16 == 0) { /* a wider section: another linear map, nothing else */
            int k;
            for (k = 0; k < 3; ++k) f.axis_x[k] *= 1.7f;
        }
        if (round % 32 == 1)
            f.upper[2] += 2.0f * f.h; /* beyond the point of a cone: the other nappe must stay away */
        check_span(&f, round & 1 ? zoo_unit(&random) : 0.0f, &ray, round, &hits);
    }
    conemap_skeleton_free(&skeleton);
    CHECK(hits > rays / 4, "only %d of %d rays hit", hits, rays);
    test_note("%d rays, %d hits", rays, hits);
}

/* Rays that the arithmetic likes least, on an upright cylinder and a cone: parallel to the surface, exactly, and from
   very far. */
static void exact_cases(void)
{
    conemap_joint joints[2] = {{{0, 0, 0}, 1, 0}, {{0, 2, 0}, 1, 0}};
    conemap_segment segment;
    conemap_skeleton_desc desc;
    conemap_skeleton skeleton;
    static const struct {
        conemap_ray ray;
        float enter, leave;
        float top;
    } cases[] = {
        {{{0, -1, 0}, {0, 1, 0}, 0, 0}, 1, 3, 1},       /* along the axis */
        {{{0.5f, -1, 0}, {0, 1, 0}, 0, 0}, 1, 3, 1},    /* parallel to it */
        {{{1, -1, 0}, {0, 1, 0}, 0, 0}, 1, 3, 1},       /* on the surface */
        {{{1.0001f, -1, 0}, {0, 1, 0}, 0, 0}, 1, 0, 1}, /* beside it */
        {{{0, 1, 0}, {0, 1, 0}, 0, 0}, 0, 1, 1},        /* from inside */
        {{{0, 1, 0}, {1, 0, 0}, 0, 0}, 0, 1, 1},
        {{{-3, 1, 1}, {1, 0, 0}, 0, 0}, 3, 3, 1}, /* touching */
        {{{-3, 1, 1.0001f}, {1, 0, 0}, 0, 0}, 1, 0, 1},
        {{{-3, 0, 0}, {1, 0, 0}, 0, 0}, 2, 4, 1}, /* in the plane of the end */
        {{{-3, 1, 0}, {1, 0, 0}, 2.5f, 3.5f}, 2.5f, 3.5f, 1},
        {{{-3, 1, 0}, {1, 0, 0}, 0, 1.5f}, 1, 0, 1}, /* ends before */
        {{{0, -1, 0}, {0, 1, 0}, 0, 0}, 1, 3, 0},    /* a cone through its point */
        {{{0, 3, 0}, {0, -1, 0}, 0, 0}, 1, 3, 0},
        {{{1, 0, 0}, {-0.5f, 1, 0}, 0, 0}, 0, 2, 0},       /* along its side */
        {{{0.5f, 0, 0}, {-0.5f, 1, 0}, 0, 0}, 0, 1.5f, 0}, /* parallel to a side, from inside */
        {{{2, 0, 0}, {-0.5f, 1, 0}, 0, 0}, 1, 0, 0},       /* and outside: only the mirrored cone is met */
        {{{-1, 2, 0}, {1, 0, 0}, 0, 0}, 1, 1, 0},          /* across its point */
    };
    int n, top;
    memset(&segment, 0, sizeof segment);
    memset(&desc, 0, sizeof desc);
    segment.top = 1;
    segment.parent = -1;
    desc.joints = joints;
    desc.joint_count = 2;
    desc.segments = &segment;
    desc.segment_count = 1;
    for (top = 0; top < 2; ++top) {
        joints[1].radius = (float)top;
        REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "build");
        for (n = 0; n < (int)(sizeof cases / sizeof cases[0]); ++n) {
            float span[2];
            if (cases[n].top != (float)top) continue;
            REQUIRE(conemap_frustum_span(skeleton.frusta, 0.0f, &cases[n].ray, span) == CONEMAP_OK, "span");
            if (cases[n].enter > cases[n].leave)
                CHECK(span[0] > span[1], "case %d: hit from %g to %g", n, (double)span[0], (double)span[1]);
            else
                CHECK(fabsf(span[0] - cases[n].enter) < 1e-5f && fabsf(span[1] - cases[n].leave) < 1e-5f,
                      "case %d: from %g to %g, right %g to %g", n, (double)span[0], (double)span[1],
                      (double)cases[n].enter, (double)cases[n].leave);
        }
        conemap_skeleton_free(&skeleton);
    }
    joints[0].radius = joints[1].radius = 1e-3f;
    REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "build");
    for (n = 0; n < 2; ++n) { /* a hair's breadth, from a million away */
        conemap_ray ray = {{0, 1, 1e6f}, {0, 0, -1}, 0, 0};
        float span[2];
        ray.origin[0] = n ? 1.001e-3f : 0.999e-3f;
        REQUIRE(conemap_frustum_span(skeleton.frusta, 0.0f, &ray, span) == CONEMAP_OK, "span");
        CHECK((span[0] <= span[1]) == (n == 0), "from afar: case %d", n);
    }
    conemap_skeleton_free(&skeleton);
}

/* ---- bounds -------------------------------------------------------------------------------------------------- */

static void contained(void)
{
    struct zoo_random random = zoo_seed(502);
    const unsigned char *triangles = conemap_frustum_triangles();
    int round, i, n, k, points = 0;
    for (round = 0; round < 600; ++round) {
        struct chain chain;
        conemap_skeleton skeleton;
        if (!random_skeleton(&random, &chain, &skeleton)) return;
        if (round & 1) {
            chain.desc.fit = 1;
            conemap_skeleton_free(&skeleton);
            REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "fitted");
        }
        for (i = 0; i < skeleton.count; ++i) {
            const conemap_frustum *f = &skeleton.frusta[i];
            const double grain = 4e-6 * ((double)f->h + fabs((double)f->axis_x[3]) + fabs((double)f->axis_y[3]) +
                                         fabs((double)f->axis_z[3]));
            float corners[8][3];
            REQUIRE(conemap_frustum_corners(f, corners) == CONEMAP_OK, "corners");
            CHECK(fabsf(f->r + f->k * f->h - chain.joints[i + 1].radius) <= 1e-5f,
                  "round %d: the radius at the top is %g, right %g", round, (double)(f->r + f->k * f->h),
                  (double)chain.joints[i + 1].radius);
            for (n = 0; n < 40; ++n) {
                float uvw[3], p[3];
                uvw[0] = n & 4 ? (float)zoo_below(&random, 8) / 8.0f : zoo_unit(&random);
                uvw[1] = n & 1 ? (float)zoo_below(&random, 2) : zoo_unit(&random);
                uvw[2] = n & 2 ? (float)zoo_below(&random, 2) : zoo_unit(&random);
                if (!CHECK(conemap_frustum_point(f, uvw, p) == CONEMAP_OK, "round %d: no point at %g %g %g", round,
                           (double)uvw[0], (double)uvw[1], (double)uvw[2]))
                    continue;
                ++points;
                for (k = 0; k < 3; ++k)
                    CHECK((double)p[k] >= (double)skeleton.low[k] - grain &&
                              (double)p[k] <= (double)skeleton.high[k] + grain,
                          "round %d: outside the box", round);
                for (k = 0; k < 12; ++k) {
                    double a[3], b[3], q[3], normal[3], away;
                    int c;
                    for (c = 0; c < 3; ++c) {
                        const double origin = (double)corners[triangles[3 * k]][c];
                        a[c] = (double)corners[triangles[3 * k + 1]][c] - origin;
                        b[c] = (double)corners[triangles[3 * k + 2]][c] - origin;
                        q[c] = (double)p[c] - origin;
                    }
                    cross(a, b, normal);
                    if (unit(normal) < 1e-4 * (double)f->h * ((double)f->r + (double)f->t))
                        continue; /* shrunk to a line */
                    away = dot(normal, q);
                    CHECK(away <= grain,
                          "round %d, segment %d: %g outside triangle %d at u %g v %g w %g, flags %d", round, i,
                          away, k, (double)uvw[0], (double)uvw[1], (double)uvw[2], (int)f->flags);
                }
            }
        }
        conemap_skeleton_free(&skeleton);
    }
    test_note("%d points contained", points);
}

/* ---- joints -------------------------------------------------------------------------------------------------- */

static double turns_apart(double a, double b)
{
    const double d = fabs(a - b);
    return d - floor(d) < 0.5 ? d - floor(d) : 1.0 - (d - floor(d));
}

/* Points of one side of a seam in the other side's coordinates. Cylinders and straight chains fit exactly, bent cones
   as growth times bend lets them. */
static void seams(void)
{
    struct zoo_random random = zoo_seed(503);
    double worst = 0;
    int round, i, n;
    for (round = 0; round < 200; ++round) {
        const int shape = round % 3; /* cylinders, tapered, pointed */
        const float bend = shape == CYLINDERS ? 0.4f : round & 4 ? 0.2f : 0.0f;
        struct chain chain;
        conemap_skeleton skeleton;
        make_chain(&random, shape, bend, 4, &chain);
        for (i = 0; i < 5; ++i) chain.joints[i].thickness += 0.05f;
        chain.desc.v_per_length = 0.25f;
        for (i = 0; i < 4; ++i) chain.segments[i].twist = round & 1 ? 0.3f * (float)i : 0.0f;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        for (i = 0; i + 1 < 4; ++i) {
            const conemap_frustum *f = &skeleton.frusta[i], *g = &skeleton.frusta[i + 1];
            const double taper =
                fabs((double)f->k) + fabs((double)g->k) + fabs((double)f->tk) + fabs((double)g->tk);
            const double turn =
                1.0 - ((double)f->axis_y[0] * (double)g->axis_y[0] + (double)f->axis_y[1] * (double)g->axis_y[1] +
                       (double)f->axis_y[2] * (double)g->axis_y[2]);
            const double allowed = 2e-5 + (shape == CYLINDERS ? 0.0 : 3.0 * taper * sqrt(fabs(turn) * 2.0));
            if ((f->flags & CONEMAP_FRUSTUM_CLAMPED_UPPER) || (g->flags & CONEMAP_FRUSTUM_CLAMPED_LOWER)) continue;
            CHECK(f->child == i + 1 && g->parent == i, "links");
            CHECK(fabsf(f->v_start + f->v_size - g->v_start) < 1e-6f, "v goes on");
            for (n = 0; n < 16; ++n) {
                float uvw[3], p[3], back[3];
                double apart;
                uvw[0] = (float)n / 16.0f;
                uvw[1] = 1.0f;
                uvw[2] = (float)(n & 1);
                REQUIRE(conemap_frustum_point(f, uvw, p) == CONEMAP_OK, "point");
                REQUIRE(conemap_frustum_uvw(g, p, back) == CONEMAP_OK, "uvw");
                CHECK(fabs((double)back[1]) <= 1e-5, "round %d: v is %g beyond the seam", round, (double)back[1]);
                apart = turns_apart((double)uvw[0] + (double)f->twist, (double)back[0]);
                CHECK(apart <= allowed, "round %d: u %g apart at the seam, allowed %g", round,
                      apart, allowed);
                if (apart > worst) worst = apart;
                CHECK(fabs((double)back[2] - (double)uvw[2]) * ((double)f->t + (double)f->tk * (double)f->h) <=
                          (2e-5 + allowed) * 2.0,
                      "round %d: the surface is %g apart at the seam", round, (double)back[2] - (double)uvw[2]);
            }
        }
        conemap_skeleton_free(&skeleton);
    }
    test_note("u at bent cones' seams at most %.4f turns apart", worst);
}

/* u on the common cut of fitted cones: by the angle it differs alike to both sides of the bend, so that no turn of the
   texture could do better, and with exact_u not at all. */
static void exact_u(void)
{
    struct zoo_random random = zoo_seed(518);
    double worst[2] = {0, 0}, paper = 0, shell = 0;
    int round, exact, i, n;
    for (round = 0; round < 100; ++round) {
        struct chain chain;
        make_chain(&random, TAPERED, 0.3f, 4, &chain);
        for (i = 0; i < 5; ++i) chain.joints[i].radius = zoo_between(&random, 0.2f, 0.8f);
        for (i = 0; i < 5; ++i) chain.joints[i].thickness = round & 2 ? 0.2f : 0.1f + 0.1f * zoo_unit(&random);
        for (i = 0; i < 4; ++i) chain.segments[i].twist = round & 1 ? 0.3f * (float)i : 0.0f;
        chain.desc.fit = 1;
        for (exact = 0; exact < 2; ++exact) {
            conemap_skeleton skeleton;
            chain.desc.exact_u = exact;
            REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
            for (i = 0; i + 1 < 4; ++i) {
                const conemap_frustum *f = &skeleton.frusta[i], *g = &skeleton.frusta[i + 1];
                double low = 1, high = -1;
                for (n = 0; n < 64; ++n) {
                    float uvw[3], p[3], back[3];
                    double apart;
                    uvw[0] = (float)n / 64.0f;
                    uvw[1] = 1.0f;
                    uvw[2] = 0.0f;
                    REQUIRE(conemap_frustum_point(f, uvw, p) == CONEMAP_OK, "point");
                    REQUIRE(conemap_frustum_uvw(g, p, back) == CONEMAP_OK, "uvw");
                    CHECK(fabsf(back[2]) < 2e-4f, "round %d: w is %g at the seam", round, (double)back[2]);
                    apart = (double)uvw[0] + (double)f->twist - (double)back[0];
                    apart -= floor(apart + 0.5);
                    if (apart < low) low = apart;
                    if (apart > high) high = apart;
                    uvw[2] = 1.0f;
                    REQUIRE(conemap_frustum_point(f, uvw, p) == CONEMAP_OK, "point");
                    REQUIRE(conemap_frustum_uvw(g, p, back) == CONEMAP_OK, "uvw");
                    apart = turns_apart((double)uvw[0] + (double)f->twist, (double)back[0]);
                    if (exact && apart > shell) shell = apart;
                    uvw[1] = zoo_unit(&random); /* and there and back anywhere */
                    uvw[2] = zoo_unit(&random);
                    REQUIRE(conemap_frustum_point(f, uvw, p) == CONEMAP_OK, "point");
                    REQUIRE(conemap_frustum_uvw(f, p, back) == CONEMAP_OK, "uvw");
                    CHECK(turns_apart((double)uvw[0], (double)back[0]) < 2e-5, "round %d: u %g, back %g", round,
                          (double)uvw[0], (double)back[0]);
                }
                CHECK(low + high < 0.05 * (high - low) + 1e-5 && low + high > -0.05 * (high - low) - 1e-5,
                      "round %d: u differs by %g to %g: a turn would lessen that", round, low, high);
                if (high > worst[exact]) worst[exact] = high;
                if (!exact && high - low > paper) paper = high - low;
            }
            conemap_skeleton_free(&skeleton);
        }
    }
    CHECK(worst[0] > 0.01, "angles differ by %g: the bends are too tame to tell", worst[0]);
    CHECK(worst[1] < 1e-5, "u differs by %g with exact_u", worst[1]);
    test_note("u of fitted cones apart: aligned at a point %.4f, least rotation %.4f, exact %.1g (outer surface %.4f)",
              paper, worst[0], worst[1], shell);
}

/* Sections with two radii: they are as wide as told, towards where told; their seams close and u goes on, in any bend
   if the radii do not change, and if they do, with fit and exact_u, in bends along an axis of the section; and normals
   go on with them. */
static void elliptical(void)
{
    struct zoo_random random = zoo_seed(520);
    double apart_u = 0, apart_w = 0, jump = 0, jump_true = 0;
    int round, i, n, k, looked = 0;
    for (round = 0; round < 60; ++round) {
        const float flat = zoo_between(&random, 0.1f, 0.9f);
        const int tapered = round & 1;
        struct chain chain;
        conemap_skeleton skeleton;
        double wide[3], y[3], z[3], across;
        make_chain(&random, tapered ? TAPERED : CYLINDERS, 0.25f, 3, &chain);
        for (i = 0; i < 4; ++i) chain.joints[i].thickness = 0;
        flatten(&random, flat, &chain);
        if (tapered) { /* bent in one plane */
            for (i = 0; i < 4; ++i) chain.joints[i].position[2] = 0;
            for (k = 0; k < 3; ++k) chain.segments[0].wide[k] = (k == 2) == (round / 2 % 2) ? 1.0f : 0.0f;
        }
        chain.desc.fit = chain.desc.exact_u = tapered;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        looked += skeleton.clamped == 0;
        for (k = 0; k < 3; ++k) {
            y[k] = (double)chain.joints[1].position[k] - (double)chain.joints[0].position[k];
            wide[k] = (double)chain.segments[0].wide[k];
        }
        unit(y);
        across = dot(wide, y);
        for (k = 0; k < 3; ++k) wide[k] -= across * y[k];
        unit(wide);
        cross(wide, y, z);
        for (n = 0; n < 2; ++n) { /* the ends of both axes of the root's section */
            float uvw[3] = {0, 0, 0}, p[3];
            double off[3], right = (double)(chain.joints[0].radius * (n ? flat : 1.0f));
            uvw[0] = n ? 0.0f : 0.25f;
            REQUIRE(conemap_frustum_point(&skeleton.frusta[0], uvw, p) == CONEMAP_OK, "point");
            for (k = 0; k < 3; ++k) off[k] = (double)p[k] - (double)chain.joints[0].position[k];
            CHECK(fabs(fabs(dot(off, n ? z : wide)) - right) < 1e-5 && fabs(sqrt(dot(off, off)) - right) < 1e-5,
                  "round %d: an axis is %g long, right %g", round, sqrt(dot(off, off)), right);
        }
        for (i = 0; i + 1 < 3 && skeleton.clamped == 0; ++i) {
            const conemap_frustum *f = &skeleton.frusta[i], *g = &skeleton.frusta[i + 1];
            for (n = 0; n < 32; ++n) {
                float uvw[3] = {0, 1, 0}, p[3], back[3];
                double at[3], world[3], smooth[2][3], plain[2][3], between = 0, between_true = 0;
                conemap_skeleton_trace_desc trace;
                conemap__place_uvw place;
                memset(&trace, 0, sizeof trace);
                uvw[0] = (float)n / 32.0f;
                REQUIRE(conemap_frustum_point(f, uvw, p) == CONEMAP_OK, "point");
                REQUIRE(conemap_frustum_uvw(g, p, back) == CONEMAP_OK, "uvw");
                apart_u = fmax(apart_u, turns_apart((double)uvw[0], (double)back[0]));
                apart_w = fmax(apart_w, fabs((double)back[2]));
                for (k = 0; k < 3; ++k) world[k] = (double)p[k];
                local_point(f, world, at);
                conemap__normals(f, &trace, at, &place, smooth[0], plain[0]);
                local_point(g, world, at);
                conemap__normals(g, &trace, at, &place, smooth[1], plain[1]);
                for (k = 0; k < 3; ++k) {
                    between += (smooth[0][k] - smooth[1][k]) * (smooth[0][k] - smooth[1][k]);
                    between_true += (plain[0][k] - plain[1][k]) * (plain[0][k] - plain[1][k]);
                }
                if (!tapered) jump = fmax(jump, sqrt(between));
                jump_true = fmax(jump_true, sqrt(between_true));
            }
        }
        conemap_skeleton_free(&skeleton);
    }
    CHECK(looked > 30, "only %d are not clamped", looked);
    CHECK(apart_u < 1e-5 && apart_w < 1e-5, "seams: u %g apart, surfaces %g", apart_u, apart_w);
    CHECK(jump < 1e-5 && jump_true > 0.1, "normals jump by %g, true ones by %g", jump, jump_true);
}

/* A branch's section lies as told, and turns along when joints move. */
static void elliptical_branch(void)
{
    conemap_joint joints[4] = {{{0, 0, 0}, 1, 0}, {{0, 4, 0}, 1, 0}, {{0, 8, 0}, 1, 0}, {{5, 4, 0}, 0.4f, 0}};
    conemap_segment segments[3];
    conemap_skeleton_desc desc;
    conemap_skeleton skeleton;
    float before[3];
    int k;
    memset(segments, 0, sizeof segments);
    memset(&desc, 0, sizeof desc);
    segments[0].top = 1;
    segments[0].parent = -1;
    segments[1].base = 1;
    segments[1].top = 2;
    segments[2].base = 1;
    segments[2].top = 3;
    segments[2].radius = 0.5f;
    segments[2].flat = 0.25f;
    segments[2].wide[0] = 1;
    segments[2].wide[1] = 2;
    segments[2].wide[2] = 2;
    segments[0].flat = 0.5f;
    segments[1].flat = 0.5f;
    desc.joints = joints;
    desc.joint_count = 4;
    desc.segments = segments;
    desc.segment_count = 3;
    REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "build");
    CHECK(fabsf(skeleton.frusta[2].axis_x[1] - 0.70710678f) < 1e-6f &&
              fabsf(skeleton.frusta[2].axis_x[2] - 0.70710678f) < 1e-6f,
          "the branch is wide along %g %g %g", (double)skeleton.frusta[2].axis_x[0],
          (double)skeleton.frusta[2].axis_x[1], (double)skeleton.frusta[2].axis_x[2]);
    memcpy(before, skeleton.frusta[2].axis_x, sizeof before);
    REQUIRE(conemap_skeleton_update(&skeleton, joints) == CONEMAP_OK, "update");
    CHECK(memcmp(before, skeleton.frusta[2].axis_x, sizeof before) == 0, "an update that moves nothing");
    for (k = 1; k < 4; ++k) { /* a quarter turn of everything about z: (x, y) to (-y, x) */
        const float x = joints[k].position[0];
        joints[k].position[0] = -joints[k].position[1];
        joints[k].position[1] = x;
    }
    REQUIRE(conemap_skeleton_update(&skeleton, joints) == CONEMAP_OK, "update");
    CHECK(fabsf(skeleton.frusta[2].axis_x[0] + before[1]) < 1e-6f &&
              fabsf(skeleton.frusta[2].axis_x[2] - before[2]) < 1e-6f,
          "the section turns along");
    conemap_skeleton_free(&skeleton);
}

/* A ray straight at the axis, towards the point (u, v). */
static conemap_ray ray_at(const conemap_frustum *f, float u, float v, float w)
{
    conemap_ray ray;
    float uvw[3], p[3];
    int k;
    memset(&ray, 0, sizeof ray);
    uvw[0] = u;
    uvw[1] = v;
    uvw[2] = w;
    conemap_frustum_point(f, uvw, p);
    for (k = 0; k < 3; ++k) {
        const double angle = TURN * (double)u;
        ray.direction[k] = (float)(-sin(angle) * (double)f->axis_x[k] - cos(angle) * (double)f->axis_z[k]);
        ray.origin[k] = p[k] - 3.0f * ray.direction[k];
    }
    return ray;
}

static double apart3(const float *a, const float *b)
{
    return sqrt(((double)a[0] - (double)b[0]) * ((double)a[0] - (double)b[0]) +
                ((double)a[1] - (double)b[1]) * ((double)a[1] - (double)b[1]) +
                ((double)a[2] - (double)b[2]) * ((double)a[2] - (double)b[2]));
}

/* [BJCW09 eq. 8]: normals from both sides of a joint agree, and with c1_normals they do not change along v there. */
static void joint_normals(void)
{
    struct zoo_random random = zoo_seed(504);
    double jump_true = 0;
    int round, n;
    for (round = 0; round < 120; ++round) {
        const int slope = round & 1, c1 = (round >> 1) & 1;
        struct chain chain;
        conemap_skeleton skeleton;
        make_chain(&random, round % 3 ? TAPERED : CYLINDERS, 0.15f, 3, &chain);
        for (n = 0; n < 4 && round & 4; ++n) chain.joints[n].radius = zoo_between(&random, 0.3f, 0.6f);
        chain.desc.slope_normals = slope;
        chain.desc.c1_normals = c1;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        for (n = 0; n < 8; ++n) {
            const float u = (float)n / 8.0f, step = 1e-3f;
            conemap_ray rays[4];
            conemap_skeleton_hit hits[4];
            rays[0] = ray_at(&skeleton.frusta[0], u, 1.0f - 2.0f * step, 0.0f);
            rays[1] = ray_at(&skeleton.frusta[0], u, 1.0f - step, 0.0f);
            rays[2] = ray_at(&skeleton.frusta[1], u, step, 0.0f);
            rays[3] = ray_at(&skeleton.frusta[1], u, 2.0f * step, 0.0f);
            REQUIRE(conemap_skeleton_trace(&skeleton, NULL, rays, hits, 4) == CONEMAP_OK, "trace");
            if (hits[1].segment != 0 || hits[2].segment != 1 || hits[0].segment != 0 || hits[3].segment != 1)
                continue; /* hidden in a bend */
            CHECK(apart3(hits[1].normal, hits[2].normal) < 0.06, "round %d: normals jump by %g", round,
                  apart3(hits[1].normal, hits[2].normal));
            if (c1)
                CHECK(
                    apart3(hits[0].normal, hits[1].normal) < 2e-5 && apart3(hits[2].normal, hits[3].normal) < 2e-5,
                    "round %d: normals change by %g at the joint", round, apart3(hits[0].normal, hits[1].normal));
            if (apart3(hits[1].true_normal, hits[2].true_normal) > jump_true)
                jump_true = apart3(hits[1].true_normal, hits[2].true_normal);
        }
        conemap_skeleton_free(&skeleton);
    }
    CHECK(jump_true > 0.1, "true normals should jump in bends, which shows that the test looks at bends: %g",
          jump_true);
}

/* The derivatives of normals from both sides of a joint, along the surface's u, agree as the normals do, and along v
   too with c1_normals, as both are 0 then; without, they do not. */
static void c1_normals(void)
{
    struct zoo_random random = zoo_seed(523);
    double along_u = 0, along_v[2] = {0, 0}, turns = 0;
    int round, n, side, k;
    for (round = 0; round < 60; ++round) {
        const int c1 = round & 1;
        struct chain chain;
        conemap_skeleton skeleton;
        make_chain(&random, round & 2 ? TAPERED : CYLINDERS, 0.2f, 3, &chain);
        for (k = 0; k < 4; ++k) chain.joints[k].thickness = 0;
        if (round % 6 >= 4) flatten(&random, 0.5f, &chain);
        if (round & 2 && round % 6 >= 4) continue; /* tapered elliptical cuts differ */
        chain.desc.slope_normals = round / 4 % 2;
        chain.desc.c1_normals = c1;
        chain.desc.fit = chain.desc.exact_u = 1;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        for (n = 0; n < 16 && skeleton.clamped == 0; ++n) {
            double at_u[2][3], at_v[2][3];
            for (side = 0; side < 2; ++side) { /* one-sided along v, both from the same u */
                const conemap_frustum *f = &skeleton.frusta[side];
                const float places[4][2] = {{-2e-3f, 0}, {2e-3f, 0}, {0, 0}, {0, side ? 2e-3f : -2e-3f}};
                double normals[4][3];
                int i;
                for (i = 0; i < 4; ++i) {
                    conemap_skeleton_trace_desc trace;
                    conemap__place_uvw place;
                    float uvw[3] = {0, 0, 0}, point[3];
                    double world[3], p[3], plain[3];
                    memset(&trace, 0, sizeof trace);
                    uvw[0] = (float)n / 16.0f + places[i][0];
                    uvw[1] = (side ? 0.0f : 1.0f) + places[i][1];
                    REQUIRE(conemap_frustum_point(f, uvw, point) == CONEMAP_OK, "point");
                    for (k = 0; k < 3; ++k) world[k] = (double)point[k];
                    local_point(f, world, p);
                    conemap__normals(f, &trace, p, &place, normals[i], plain);
                }
                for (k = 0; k < 3; ++k) {
                    at_u[side][k] = (normals[1][k] - normals[0][k]) / 4e-3;
                    at_v[side][k] = (normals[3][k] - normals[2][k]) / (side ? 2e-3 : -2e-3);
                }
            }
            turns = fmax(turns, sqrt(dot(at_u[0], at_u[0])));
            for (k = 0; k < 3; ++k) {
                along_u = fmax(along_u, fabs(at_u[0][k] - at_u[1][k]));
                along_v[c1] = fmax(along_v[c1], fabs(at_v[0][k] - at_v[1][k]));
            }
        }
        conemap_skeleton_free(&skeleton);
    }
    CHECK(turns > 3 && along_u < 0.01 * turns, "along u normals change by %g, differently by %g", turns, along_u);
    CHECK(along_v[1] < 0.02 && along_v[0] > 0.1, "along v by %g differently, without C1 by %g", along_v[1],
          along_v[0]);
}

/* Where a branch leaves near a trunk's joint, blended normals go on across that joint and across the branch's own. */
static void blend_across_joints(void)
{
    conemap_joint joints[6] = {{{0, 0, 0}, 1, 0},    {{0, 4, 0}, 1, 0},    {{0.4f, 8, 0}, 1, 0},
                               {{1.8f, 5, 0}, 0.5f, 0}, {{5, 7.5f, 0}, 0.5f, 0}, {{0.3f, 5, 0}, 1, 0}};
    conemap_segment segments[5];
    conemap_skeleton_desc desc;
    conemap_skeleton skeleton;
    double jump = 0, least = 1;
    int i, n, k, seams = 0;
    memset(segments, 0, sizeof segments);
    memset(&desc, 0, sizeof desc);
    segments[0].top = 1;
    segments[0].parent = -1;
    segments[1].base = 1; /* the trunk goes on, with a joint above the branch's foot */
    segments[1].top = 5;
    segments[2].base = 5;
    segments[2].top = 2;
    segments[2].parent = 1;
    segments[3].base = 1; /* the branch */
    segments[3].top = 3;
    segments[3].radius = 0.5f;
    segments[4].base = 3;
    segments[4].top = 4;
    segments[4].parent = 3;
    desc.joints = joints;
    desc.joint_count = 6;
    desc.segments = segments;
    desc.segment_count = 5;
    desc.blend = 3.0f;
    REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "build");
    for (i = 1; i < 5; i += 3) { /* pairs of hits at both sides of the seams 1-2 and 3-4 */
        const int below = i == 1 ? 1 : 3;
        for (n = 0; n < 64; ++n) {
            conemap_ray rays[2];
            conemap_skeleton_hit hits[2];
            rays[0] = ray_at(&skeleton.frusta[below], (float)n / 64.0f, 0.9995f, 0.0f);
            rays[1] = ray_at(&skeleton.frusta[below + 1], (float)n / 64.0f, 0.0005f, 0.0f);
            REQUIRE(conemap_skeleton_trace(&skeleton, NULL, rays, hits, 2) == CONEMAP_OK, "trace");
            if (hits[0].segment != below || hits[1].segment != below + 1) continue; /* hidden */
            if (apart3(hits[0].position, hits[1].position) > 0.02) continue;
            ++seams;
            jump = fmax(jump, apart3(hits[0].normal, hits[1].normal));
            { /* and the blend does something there */
                double along = 0;
                for (k = 0; k < 3; ++k) along += (double)hits[0].normal[k] * (double)hits[0].true_normal[k];
                least = fmin(least, along);
            }
        }
    }
    CHECK(seams > 40 && jump < 0.03 && least < 0.97, "%d pairs: normals jump by %g, leave the surface's by %g", seams,
          jump, least);
    conemap_skeleton_free(&skeleton);
}

/* Normals of the crease around a branch's foot come near each other with blend, and not without. */
static void branch_normals(void)
{
    conemap_joint joints[4] = {{{0, 0, 0}, 1, 0}, {{0, 4, 0}, 1, 0}, {{0, 8, 0}, 1, 0}, {{5, 5, 0}, 0.4f, 0}};
    conemap_segment segments[3];
    int blend;
    memset(segments, 0, sizeof segments);
    segments[0].top = 1;
    segments[0].parent = -1;
    segments[1].base = 1;
    segments[1].top = 2;
    segments[2].base = 1;
    segments[2].top = 3;
    segments[2].radius = 0.5f;
    for (blend = 0; blend < 2; ++blend) {
        conemap_skeleton_desc desc;
        conemap_skeleton skeleton;
        double jump = 0;
        int i, crossings = 0, before = -1;
        float normal[3] = {0, 0, 0}, x = 0;
        memset(&desc, 0, sizeof desc);
        desc.joints = joints;
        desc.joint_count = 4;
        desc.segments = segments;
        desc.segment_count = 3;
        desc.blend = blend ? 1.0f : 0.0f;
        REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "build");
        CHECK((skeleton.frusta[2].flags & CONEMAP_FRUSTUM_BRANCH) && skeleton.frusta[0].branch == 2 &&
                  skeleton.frusta[0].child == 1,
              "the branch is one");
        for (i = 0; i < 4000; ++i) { /* down a line beside the trunk's middle, over the branch and off it again */
            conemap_ray ray = {{9, 0, 0.2f}, {-1, 0, 0}, 0, 0};
            conemap_skeleton_hit hit;
            ray.origin[1] = 2.0f + (float)i * 1e-3f;
            REQUIRE(conemap_skeleton_trace(&skeleton, NULL, &ray, &hit, 1) == CONEMAP_OK &&
                        hit.status == CONEMAP_HIT,
                    "hit");
            if (before >= 0 && hit.segment != before && (before == 2 || hit.segment == 2) &&
                fabsf(hit.position[0] - x) < 0.05f) {
                const double step = apart3(normal, hit.normal);
                if (step > jump) jump = step;
                ++crossings;
            }
            memcpy(normal, hit.normal, sizeof normal);
            before = hit.segment;
            x = hit.position[0];
        }
        CHECK(crossings >= 1, "the line crosses the crease");
        CHECK(blend ? jump < 0.02 : jump > 0.3, "normals jump by %g with blend %d", jump, blend);
        conemap_skeleton_free(&skeleton);
    }
}

/* ---- the paper's equations ------------------------------------------------------------------------------------- */

/* Eqs. 3-5 in three dimensions: A and B, where the boundary lines meet, lie on both segments' cutting planes. */
static void equations_of_the_cut(void)
{
    struct zoo_random random = zoo_seed(505);
    int round, tried = 0;
    for (round = 0; round < 400; ++round) {
        struct chain chain;
        conemap_skeleton skeleton;
        double m1[3], m2[3], n[3], side, h1, h2;
        int k;
        make_chain(&random, TAPERED, 0.3f, 2, &chain);
        for (k = 0; k < 3; ++k) chain.joints[k].radius = zoo_between(&random, 0.3f, 0.6f);
        chain.desc.fit = round & 1; /* then of the second segment with its new radius */
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        for (k = 0; k < 3; ++k) {
            m1[k] = (double)chain.joints[1].position[k] - (double)chain.joints[0].position[k];
            m2[k] = (double)chain.joints[2].position[k] - (double)chain.joints[1].position[k];
        }
        h1 = unit(m1);
        h2 = unit(m2);
        cross(m1, m2, n);
        if (unit(n) > 0.25 && skeleton.clamped == 0) { /* well away from parallel boundary lines */
            ++tried;
            for (side = -1; side <= 1; side += 2) {
                const double r0 = (double)chain.joints[0].radius, r1 = (double)chain.joints[1].radius,
                             r2 = (double)chain.joints[2].radius;
                double o1[3], o2[3], l1[3], l2[3], d1[3], d2[3], w[3], c[3], t, A[3], p[3];
                cross(m1, n, o1);
                cross(m2, n, o2);
                for (k = 0; k < 3; ++k) { /* eq. 4: L1 = C1 - r1 (M1 x Nm), and the other three */
                    l1[k] = (double)chain.joints[0].position[k] - side * r0 * o1[k];
                    d1[k] = (double)chain.joints[1].position[k] - side * r1 * o1[k] - l1[k];
                    l2[k] = (double)chain.joints[1].position[k] - side * (double)skeleton.frusta[1].r * o2[k];
                    d2[k] = (double)chain.joints[2].position[k] - side * r2 * o2[k] - l2[k];
                    w[k] = l2[k] - l1[k];
                }
                cross(d1, d2, c);
                if (fabs(dot(c, n)) < 0.1 * h1 * h2) continue;
                cross(w, d2, p);
                t = dot(p, n) / dot(c, n);
                for (k = 0; k < 3; ++k) A[k] = l1[k] + t * d1[k];
                for (k = 0; k < 2; ++k) {
                    const conemap_frustum *f = &skeleton.frusta[k];
                    const float *plane = k ? f->lower : f->upper;
                    local_point(f, A, p);
                    CHECK(fabs((double)plane[0] * p[0] + (double)plane[1] * p[2] + (double)plane[2] - p[1]) < 2e-5,
                          "round %d: A or B is %g off the plane of segment %d", round,
                          (double)plane[0] * p[0] + (double)plane[1] * p[2] + (double)plane[2] - p[1], k);
                }
            }
            /* eq. 5: the plane's normal lies in the medial plane */
            CHECK(fabs(((double)skeleton.frusta[0].upper[0] * ((double)skeleton.frusta[0].axis_x[0] * n[0] +
                                                               (double)skeleton.frusta[0].axis_x[1] * n[1] +
                                                               (double)skeleton.frusta[0].axis_x[2] * n[2]) +
                        (double)skeleton.frusta[0].upper[1] * ((double)skeleton.frusta[0].axis_z[0] * n[0] +
                                                               (double)skeleton.frusta[0].axis_z[1] * n[1] +
                                                               (double)skeleton.frusta[0].axis_z[2] * n[2]))) <
                      1e-5,
                  "round %d: the cutting plane leans out of the medial plane", round);
        }
        conemap_skeleton_free(&skeleton);
    }
    CHECK(tried > 50, "only %d bends", tried);
}

/* Eqs. 2, 6, 7, 8, 10, 11, 12 as the paper writes them, with its apex, where it has one. */
static void equations_of_the_frustum(void)
{
    struct zoo_random random = zoo_seed(506);
    int round, tried = 0, hits = 0;
    for (round = 0; round < 600; ++round) {
        struct chain chain;
        conemap_skeleton skeleton;
        const conemap_frustum *f;
        double h, r1, r2, apex, ri, ro, w, d, p[3], world[3], v[2], pl[3], pu[3], e[3], dir[3], a, b, c;
        float uvw[3], point[3], back[3], span[2];
        conemap_ray ray;
        int k;
        make_chain(&random, TAPERED, 0.2f, 3, &chain);
        for (k = 0; k < 4; ++k) chain.joints[k].thickness = 0.2f; /* as the paper: both cones grow alike */
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        f = &skeleton.frusta[1];
        uvw[0] = zoo_unit(&random);
        uvw[1] = zoo_unit(&random);
        uvw[2] = zoo_unit(&random);
        REQUIRE(conemap_frustum_point(f, uvw, point) == CONEMAP_OK, "point");
        REQUIRE(conemap_frustum_uvw(f, point, back) == CONEMAP_OK, "uvw");
        for (k = 0; k < 3; ++k) world[k] = (double)point[k];
        local_point(f, world, p);
        h = (double)f->h;
        r1 = (double)f->r;
        r2 = (double)chain.joints[2].radius;
        apex = r1 * h / (r1 - r2); /* eq. 2 */
        d = sqrt(p[0] * p[0] + p[2] * p[2]);
        ri = r1 * (apex - p[1]) / apex; /* eq. 11 */
        ro = (r1 + 0.2) * ((r1 + 0.2) * h / (r1 - r2) - p[1]) / ((r1 + 0.2) * h / (r1 - r2));
        w = (d - ri) / (ro - ri); /* eq. 12 */
        CHECK(fabs(w - (double)back[2]) < 2e-4 && fabs(w - (double)uvw[2]) < 2e-4, "round %d: w %g, eq. 12 %g",
              round, (double)back[2], w);
        CHECK(turns_apart((double)back[0], atan2(p[0], p[2]) / TURN) < 2e-6, "round %d: u %g, eq. 6 %g", round,
              (double)back[0], atan2(p[0], p[2]) / TURN);
        /* eq. 7: cut the line from P to the apex of P's own cone with both planes */
        {
            const double own = p[1] + d * h / (r1 - r2), line[3] = {-p[0], own - p[1], -p[2]};
            int side;
            for (side = 0; side < 2; ++side) {
                const float *plane = side ? f->upper : f->lower;
                const double at = (double)plane[0] * p[0] + (double)plane[1] * p[2] + (double)plane[2] - p[1];
                const double along = line[1] - (double)plane[0] * line[0] - (double)plane[1] * line[2];
                double *out = side ? pu : pl;
                for (k = 0; k < 3; ++k) out[k] = p[k] + at / along * line[k];
            }
            for (k = 0; k < 3; ++k) {
                e[k] = p[k] - pl[k];
                dir[k] = pu[k] - pl[k];
            }
            v[0] = sqrt(dot(e, e)) / sqrt(dot(dir, dir));
        }
        CHECK(fabs(v[0] - (double)back[1]) < 2e-5, "round %d: v %g, eq. 7 %g", round, (double)back[1], v[0]);
        /* eq. 8 and eq. 10, against a hit of the inner cone */
        ray = ray_at(f, uvw[0], uvw[1], 0.0f);
        for (k = 0; k < 3; ++k) ray.direction[k] += spread(&random, 0.05f);
        for (k = 0; k < 3; ++k) {
            world[k] = (double)ray.origin[k];
            dir[k] = (double)ray.origin[k] + (double)ray.direction[k];
        }
        local_point(f, world, e);
        local_point(f, dir, p);
        for (k = 0; k < 3; ++k) p[k] -= e[k];
        a = p[0] * p[0] + p[2] * p[2] - p[1] * p[1] * (r1 / apex) * (r1 / apex);
        b = 2 * e[0] * p[0] + 2 * e[2] * p[2] - 2 * p[1] * (e[1] - apex) * (r1 / apex) * (r1 / apex);
        c = e[0] * e[0] + e[2] * e[2] - (e[1] - apex) * (e[1] - apex) * (r1 / apex) * (r1 / apex);
        REQUIRE(conemap_frustum_span(f, 0.0f, &ray, span) == CONEMAP_OK, "span");
        ++tried;
        if (span[0] <= span[1]) {
            conemap_skeleton_hit hit;
            const double t = (-b - sqrt(b * b - 4 * a * c)) / (2 * a);
            double nl[3], nu[3], n[3];
            REQUIRE(conemap_skeleton_trace(&skeleton, NULL, &ray, &hit, 1) == CONEMAP_OK, "trace");
            if (hit.segment != 1 || hit.cap) {
                conemap_skeleton_free(&skeleton);
                continue;
            }
            for (k = 0; k < 3; ++k) world[k] = (double)hit.position[k];
            local_point(f, world, p);
            if (fabs(sqrt(p[0] * p[0] + p[2] * p[2]) - r1 - (double)f->k * p[1]) >
                1e-4) { /* a cut in a seam's rounding */
                conemap_skeleton_free(&skeleton);
                continue;
            }
            ++hits;
            CHECK(fabs(t - (double)hit.t) < 2e-4, "round %d: hit at %g, eq. 10 %g", round, (double)hit.t, t);
            {
                const double line[3] = {-p[0], apex - p[1], -p[2]};
                int side;
                for (side = 0; side < 2; ++side) {
                    const float *plane = side ? f->upper : f->lower;
                    const double at = (double)plane[0] * p[0] + (double)plane[1] * p[2] + (double)plane[2] - p[1];
                    const double along = line[1] - (double)plane[0] * line[0] - (double)plane[1] * line[2];
                    double *out = side ? nu : nl;
                    for (k = 0; k < 3; ++k) out[k] = p[k] + at / along * line[k];
                }
                nu[1] -= h;
                unit(nl);
                unit(nu);
                for (k = 0; k < 3; ++k) n[k] = (1 - (double)hit.v) * nl[k] + (double)hit.v * nu[k];
                unit(n);
                for (k = 0; k < 3; ++k) {
                    const double right =
                        n[0] * (double)f->axis_x[k] + n[1] * (double)f->axis_y[k] + n[2] * (double)f->axis_z[k];
                    CHECK(fabs(right - (double)hit.normal[k]) < 1e-4, "round %d: normal %g, eq. 8 %g", round,
                          (double)hit.normal[k], right);
                }
            }
        }
        conemap_skeleton_free(&skeleton);
    }
    CHECK(hits > tried / 2, "only %d of %d hit", hits, tried);
}

/* Section 2.2's fit: the two cuts are one ellipse afterwards, and were not before; with axes in one line or nearly so,
   and where boundary lines are parallel, as well as elsewhere. */
static void fit(void)
{
    struct zoo_random random = zoo_seed(507);
    static const float bends[] = {0.0f, 1e-7f, 1e-5f, 1e-3f, 0.02f, 0.1f, 0.3f, 0.8f};
    double before = 0, after = 0, changed = 0;
    int round, fitted, n;
    for (round = 0; round < 160; ++round) {
        struct chain chain;
        make_chain(&random, TAPERED, bends[round % 8], 2, &chain);
        for (n = 0; n < 3; ++n) chain.joints[n].radius = zoo_between(&random, 0.3f, 0.9f);
        for (n = 0; n < 3; ++n) chain.joints[n].thickness = 0.0f;
        if (round % 16 >= 8) { /* an even taper: parallel boundary lines where it is straight */
            chain.joints[1].radius = 0.5f * (chain.joints[0].radius + chain.joints[2].radius);
        }
        for (fitted = 0; fitted < 2; ++fitted) {
            conemap_skeleton skeleton;
            const conemap_frustum *f, *g;
            double apart = 0;
            chain.desc.fit = fitted;
            REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
            f = &skeleton.frusta[0];
            g = &skeleton.frusta[1];
            if (skeleton.clamped == 0) {
                for (n = 0; n < 64; ++n) {
                    float uvw[3] = {0, 1, 0}, p[3], back[3];
                    uvw[0] = (float)n / 64.0f;
                    REQUIRE(conemap_frustum_point(f, uvw, p) == CONEMAP_OK, "point");
                    REQUIRE(conemap_frustum_uvw(g, p, back) == CONEMAP_OK, "uvw");
                    if (fabs((double)back[2]) > apart) apart = fabs((double)back[2]); /* no shell: a distance */
                }
                if (fitted && apart > after) after = apart;
                if (!fitted && apart > before) before = apart;
                CHECK(!fitted || apart < 1e-5, "round %d: cuts are %g apart, bend %g", round, apart,
                      (double)bends[round % 8]);
            } else
                CHECK(bends[round % 8] > 0.5f, "round %d: clamped in a bend of %g", round,
                      (double)bends[round % 8]);
            if (fitted && fabs((double)(g->r / chain.joints[1].radius) - 1) > changed)
                changed = fabs((double)(g->r / chain.joints[1].radius) - 1);
            conemap_skeleton_free(&skeleton);
        }
    }
    CHECK(before > 0.003, "cuts are apart without the fit: %g", before);
    CHECK(changed > 0.001 && changed < 0.2, "the fit changes radii by %g", changed);
    test_note("cuts %.4f apart, fitted %.1g; radii changed by %.1f %%", before, after, 100 * changed);
    { /* a dome's steep taper is none that could be fitted: its radius stays */
        conemap_joint joints[3] = {{{0, 0, 0}, 1, 0}, {{0, 2, 0}, 1, 0}, {{0.1f, 2.3f, 0}, 0.1f, 0}};
        struct chain chain;
        conemap_skeleton skeleton;
        make_chain(&random, CYLINDERS, 0, 2, &chain);
        memcpy(chain.joints, joints, sizeof joints);
        chain.desc.fit = 1;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        CHECK(skeleton.frusta[1].r == 1.0f, "a steep taper's radius is changed to %g", (double)skeleton.frusta[1].r);
        conemap_skeleton_free(&skeleton);
    }
}

/* ---- relief ------------------------------------------------------------------------------------------------------ */

#define SIDE 24

static int relief_map(int kind, uint32_t seed, float *heights, conemap_map *map, struct truth_map *truth)
{
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    zoo_fill(kind, SIDE, SIDE, seed, heights);
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = SIDE;
    desc.wrap_u = CONEMAP_WRAP;
    desc.max_tan = 1000.0f; /* cones as wide as they can be: nothing hides a wrong bound */
    desc.wrap_v = seed & 1 ? CONEMAP_WRAP : CONEMAP_CLAMP;
    if (!CHECK(conemap_build(&desc, map) == CONEMAP_OK, "map")) return 0;
    truth->width = truth->height = SIDE;
    truth->wrap_u = (int)desc.wrap_u;
    truth->wrap_v = (int)desc.wrap_v;
    truth->heights = map->heights;
    return 1;
}

/* How far a point of the shell is above the relief, in heights; all in other words than the header's. */
static double clearance(const conemap_frustum *f, const struct truth_map *truth, const double *world)
{
    double p[3], d, w, u, v, low, high, own_r, own_k, s, c, map_v;
    local_point(f, world, p);
    d = sqrt(p[0] * p[0] + p[2] * p[2]);
    w = (d - (double)f->r - (double)f->k * p[1]) / ((double)f->t + (double)f->tk * p[1]);
    u = atan2(p[0], p[2]);
    s = sin(u);
    c = cos(u);
    own_k = (double)f->k + w * (double)f->tk;
    own_r = d - own_k * p[1];
    low = ((double)f->lower[0] * s + (double)f->lower[1] * c);
    low = ((double)f->lower[2] + low * own_r) / (1 - low * own_k);
    high = ((double)f->upper[0] * s + (double)f->upper[1] * c);
    high = ((double)f->upper[2] + high * own_r) / (1 - high * own_k);
    v = (p[1] - low) / (high - low);
    v = v < 0 ? 0 : v > 1 ? 1 : v;
    map_v = (double)f->v_start + v * (double)f->v_size;
    if (f->flags & CONEMAP_FRUSTUM_EXACT_U) { /* the eccentric anomaly, by half angles */
        double along[2] = {0, 0}, length, around;
        int side;
        for (side = 0; side < 2; ++side) {
            const float *plane = side ? f->upper : f->lower;
            const double n = sqrt((double)plane[0] * (double)plane[0] + (double)plane[1] * (double)plane[1]);
            const double m = sqrt((1 + (double)f->k * n) / (1 - (double)f->k * n)), share = side ? v : 1 - v;
            if (n > 0) along[0] += share * (m - 1) / (m + 1) * (double)plane[0] / n;
            if (n > 0) along[1] += share * (m - 1) / (m + 1) * (double)plane[1] / n;
        }
        length = sqrt(along[0] * along[0] + along[1] * along[1]);
        around = u - atan2(along[0], along[1]);
        u += 2 * atan2(length * sin(around), 1 - length * cos(around));
    }
    if (truth->wrap_v != 1) map_v = map_v < 0 ? 0 : map_v > 1 ? 1 : map_v;
    return w - truth_height(truth, (u / TURN + v * (double)f->twist) * f->u_repeat, map_v);
}

/* The first place below the relief by dense marching, with how deep it goes within the next stretch; negative: none. */
static double dense_march(const conemap_frustum *f, const struct truth_map *truth, const struct line *line,
                          double t0, double t1, int samples, double deep)
{
    int k;
    for (k = 0; k <= samples; ++k) {
        const double t = t0 + (t1 - t0) * k / samples;
        double p[3];
        int c;
        for (c = 0; c < 3; ++c) p[c] = line->o[c] + t * line->v[c];
        if (clearance(f, truth, p) < -deep) return t;
    }
    return -1;
}

struct relief_counts {
    int rays, hits, missed, false_hits;
    double steps;
};

static void relief_rays(const conemap_skeleton_trace_desc *trace, int rounds, int rays_each, int samples,
                        double deep, struct relief_counts *counts)
{
    struct zoo_random random = zoo_seed(508);
    static float heights[SIDE * SIDE];
    static const int kinds[] = {ZOO_FBM, ZOO_BRICKS, ZOO_SPIKES, ZOO_WHITE, ZOO_CLIFF};
    int round, n, k;
    memset(counts, 0, sizeof *counts);
    for (round = 0; round < rounds; ++round) {
        struct chain chain;
        conemap_skeleton skeleton;
        conemap_map map;
        struct truth_map truth;
        conemap_skeleton_trace_desc desc = *trace;
        const int shape = zoo_below(&random, 3);
        make_chain(&random, shape, round & 1 ? 0.6f : 0.05f, 3, &chain);
        for (k = 0; k < 4; ++k) chain.joints[k].thickness *= 1.0f + (float)(round & 2);
        chain.joints[0].position[0] = chain.joints[0].position[1] = 0;
        for (k = 0; k < 3; ++k) {
            chain.segments[k].twist = round % 3 == 0 ? 0.5f : 0.0f;
            chain.segments[k].u_repeat = 1 + round % 2;
        }
        chain.desc.exact_u = round / 2 % 2;
        if (round % 5 == 4) flatten(&random, 0.4f, &chain);
        if (!relief_map(kinds[round % 5], (uint32_t)round, heights, &map, &truth)) return;
        if (!CHECK(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build")) return;
        desc.map = &map;
        for (n = 0; n < rays_each; ++n) {
            const int segment = zoo_below(&random, 3);
            const conemap_frustum *f = &skeleton.frusta[segment];
            conemap_ray ray;
            conemap_skeleton_hit hit;
            struct line line;
            float uvw[3], p[3], q[3], outer[2], inner[2];
            double end, first;
            uvw[0] = zoo_unit(&random);
            uvw[1] = zoo_unit(&random);
            uvw[2] = 1.0f;
            conemap_frustum_point(f, uvw, p);
            uvw[0] += spread(&random, 0.35f);
            uvw[1] = zoo_unit(&random);
            uvw[2] = zoo_unit(&random);
            conemap_frustum_point(f, uvw, q);
            memset(&ray, 0, sizeof ray);
            for (k = 0; k < 3; ++k) {
                ray.direction[k] = q[k] - p[k];
                ray.origin[k] = p[k] - 0.25f * ray.direction[k];
                line.o[k] = (double)ray.origin[k];
                line.v[k] = (double)ray.direction[k];
            }
            if (apart3(p, q) < 1e-3) continue;
            conemap_frustum_span(f, 1.0f, &ray, outer);
            conemap_frustum_span(f, 0.0f, &ray, inner);
            if (outer[0] > outer[1]) continue;
            ++counts->rays;
            end = inner[0] <= inner[1] ? (double)inner[0] : (double)outer[1];
            /* this segment only: the ray stops where it leaves it */
            ray.t_min = outer[0];
            ray.t_max = (float)end;
            if (!(ray.t_max > ray.t_min)) continue;
            REQUIRE(conemap_skeleton_trace(&skeleton, &desc, &ray, &hit, 1) == CONEMAP_OK, "trace");
            counts->steps += hit.steps;
            first = dense_march(f, &truth, &line, (double)outer[0], end, samples, deep);
            if (hit.status == CONEMAP_HIT) ++counts->hits;
            if (hit.status == CONEMAP_HIT && hit.segment == segment &&
                !hit.inside) { /* what is reported is on the relief */
                double at[3], before[3], gap, gap_before;
                const double back = 1e-3 * (end - (double)outer[0]) + 2e-6;
                for (k = 0; k < 3; ++k) {
                    at[k] = line.o[k] + ((double)hit.t + 2e-6) * line.v[k];
                    before[k] = line.o[k] + ((double)hit.t - back) * line.v[k];
                }
                gap = clearance(f, &truth, at);
                gap_before = clearance(f, &truth, before);
                if (gap > 2e-3 && (double)hit.t < end - 1e-4 && !(gap_before > -1e-3)) ++counts->false_hits;
                if (gap > 0.02 && (double)hit.t < end - 1e-4) ++counts->false_hits;
            }
            if (first >= 0 && !(hit.status == CONEMAP_HIT && (double)hit.t <= first + 1e-5 * (end + 1)))
                ++counts->missed;
        }
        conemap_skeleton_free(&skeleton);
        conemap_free(&map);
    }
}

/* Steps as dense as the reference find what it finds. */
static void relief_by_steps(void)
{
    conemap_skeleton_trace_desc desc;
    struct relief_counts fine, coarse;
    memset(&desc, 0, sizeof desc);
    desc.march = CONEMAP_MARCH_STEPS;
    desc.steps = 1500;
    relief_rays(&desc, 10, 60, 500, 2e-3, &fine);
    CHECK(fine.hits > fine.rays / 4, "%d of %d hit", fine.hits, fine.rays);
    CHECK(fine.missed == 0, "%d of %d missed with dense steps", fine.missed, fine.rays);
    CHECK(fine.false_hits == 0, "%d false hits", fine.false_hits);
    desc.steps = 8;
    relief_rays(&desc, 10, 60, 500, 2e-3, &coarse);
    CHECK(coarse.missed > 0, "eight steps must miss something, or the test is blind");
}

/* Cone steps pass over nothing: with the least step so short that it does not matter, none is missed; and with the
   same cones read as if they were three times as wide, some are. */
static void relief_by_cones(void)
{
    conemap_skeleton_trace_desc desc;
    struct relief_counts counts;
    const int more = ray_count(0) > 0 ? 10 : 1;
    memset(&desc, 0, sizeof desc);
    desc.march = CONEMAP_MARCH_CONES;
    desc.steps = 1 << 12;
    relief_rays(&desc, 60 * more, 60, 400, 1e-4, &counts);
    CHECK(counts.missed == 0, "%d of %d missed by cone steps", counts.missed, counts.rays);
    CHECK(counts.false_hits == 0, "%d false hits", counts.false_hits);
    CHECK(counts.steps / counts.rays < 2000, "%g steps a ray: the cones do nothing", counts.steps / counts.rays);
    test_note("cones: %.0f steps a ray, 4096 equal ones", counts.steps / counts.rays);
}

/* What cone steps rely on: the map's coordinates never change faster along a ray than conemap__map_speed says for
   what is to come. */
static void speed_bound(void)
{
    struct zoo_random random = zoo_seed(515);
    static float heights[SIDE * SIDE];
    struct truth_map truth;
    conemap_map map;
    double tightest = 0;
    int round, n, k, looked = 0;
    REQUIRE(relief_map(ZOO_FBM, 1, heights, &map, &truth), "map");
    map.info.aspect = 0.5f;
    for (round = 0; round < 150; ++round) {
        struct chain chain;
        conemap_skeleton skeleton;
        make_chain(&random, zoo_below(&random, 3), round % 5 ? 0.6f : 0.0f, 3, &chain);
        for (k = 0; k < 4; ++k) chain.joints[k].radius *= zoo_between(&random, 0.5f, 2.0f);
        for (k = 0; k < 4; ++k) chain.joints[k].thickness = round & 8 ? 0.4f : zoo_unit(&random);
        for (k = 0; k < 3; ++k) {
            chain.segments[k].twist = round & 1 ? spread(&random, 3.0f) : 0.0f;
            chain.segments[k].u_repeat = 1 + zoo_below(&random, 3);
            chain.segments[k].v_size = round & 2 ? 9.0f : 0.1f;
        }
        chain.desc.exact_u = round / 4 % 2;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        for (n = 0; n < 60; ++n) {
            const conemap_frustum *f = &skeleton.frusta[1];
            conemap__shell shell;
            conemap_ray ray = hard_ray(&random, f);
            float outer[2], inner[2];
            double o[3], v[3], end, t, step, fastest, way;
            conemap__place_uvw a, b;
            conemap_frustum_span(f, 1.0f, &ray, outer);
            conemap_frustum_span(f, 0.0f, &ray, inner);
            if (outer[0] > outer[1]) continue;
            end = inner[0] <= inner[1] ? (double)inner[0] : (double)outer[1];
            if (end - (double)outer[0] < 1e-3) continue;
            for (k = 0; k < 3; ++k) {
                o[k] = (double)ray.origin[k];
                v[k] = (double)ray.direction[k];
            }
            memset(&shell, 0, sizeof shell);
            shell.f = f;
            shell.map = &map;
            shell.ray = conemap__local(f, o, v);
            conemap__shell_bounds(&shell);
            t = (double)outer[0] + (end - (double)outer[0]) * (double)zoo_unit(&random) * 0.99;
            fastest = conemap__map_speed(&shell, t, end);
            step = 1e-6 * (end - (double)outer[0]);
            t += (end - t) * (double)zoo_unit(&random) * 0.99;
            a = conemap__shell_at(&shell, t);
            b = conemap__shell_at(&shell, t + step);
            if (!(a.thickness > 1e-3) || a.w < 0 || a.w > 1) continue;
            way = turns_apart(b.u + (b.v - a.v) * (double)f->twist, a.u) * f->u_repeat;
            way =
                sqrt(way * way + 0.25 * (b.v - a.v) * (b.v - a.v) * (double)f->v_size * (double)f->v_size) / step;
            CHECK(way <= fastest * (1 + 1e-4) + 1e-5, "round %d: the map goes by at %g, bound %g", round, way,
                  fastest);
            if (fastest < 1e100) tightest += way / fastest;
            ++looked;
        }
        conemap_skeleton_free(&skeleton);
    }
    conemap_free(&map);
    CHECK(looked > 2000 && tightest / looked > 0.3, "%d looked at, on average %.2f of the bound", looked,
          tightest / looked);
    test_note("speeds are %.0f %% of their bound", 100 * tightest / looked);
}

/* The bound's parts by themselves, each where it is nearly reached, so that none can be less than it is: v along a
   steep cut's slope, v along the axis, u around the axis, u where exact_u stretches it most, and u along the axis where
   exact_u twists it. */
static void tight_speed_bound(void)
{
    static float heights[SIDE * SIDE];
    struct truth_map truth;
    struct chain chain;
    struct zoo_random random = zoo_seed(519);
    conemap_map map;
    static const struct {
        const char *name;
        int straight;
        float top, v_size;
        int exact_u, along;
    } parts[5] = {
        {"up a cut", 0, 0.5f, 100.0f, 0, 0},
        {"along the axis", 1, 0.5f, 100.0f, 0, 1},
        {"around the axis", 0, 0.5f, 1e-3f, 0, 0},
        {"stretched", 0, 8.0f, 1e-3f, 1, 0},
        {"twisted", 0, 2.0f, 1e-3f, 1, 1},
    };
    int part, n, k;
    REQUIRE(relief_map(ZOO_FBM, 1, heights, &map, &truth), "map");
    for (part = 0; part < 5; ++part) {
        conemap_skeleton skeleton;
        const conemap_frustum *f;
        double nearest = 0;
        make_chain(&random, CYLINDERS, 0.0f, 2, &chain);
        for (k = 0; k < 3; ++k) {
            chain.joints[k].position[0] = parts[part].straight || k < 2 ? 0.0f : 20.0f;
            chain.joints[k].position[1] = k == 2 && !parts[part].straight ? 25.0f : 30.0f * (float)k;
            chain.joints[k].position[2] = 0;
            chain.joints[k].radius = k > 0 ? parts[part].top : 0.5f;
            chain.joints[k].thickness = 0.5f;
        }
        chain.segments[0].v_size = parts[part].v_size;
        chain.desc.exact_u = parts[part].exact_u;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK && skeleton.clamped == 0, "build");
        f = &skeleton.frusta[0];
        for (n = 0; n < 400; ++n) {
            const double steep = sqrt((double)f->upper[0] * (double)f->upper[0] +
                                      (double)f->upper[1] * (double)f->upper[1]);
            const double step = 1e-6, y = 0.96 * (double)f->h;
            const double d = (double)f->r + (double)f->k * y + 0.4 * (double)zoo_unit(&random);
            double sine = sin(TURN * n / 400), cosine = cos(TURN * n / 400), way, bound;
            conemap__shell shell;
            conemap__place_uvw a, b;
            memset(&shell, 0, sizeof shell);
            shell.f = f;
            shell.map = &map;
            if (part == 0) {
                sine = (double)f->upper[0] / steep;
                cosine = (double)f->upper[1] / steep;
                shell.ray.v[0] = -sine;
                shell.ray.v[2] = -cosine;
            } else if (parts[part].along)
                shell.ray.v[1] = 1;
            else {
                shell.ray.v[0] = cosine;
                shell.ray.v[2] = -sine;
            }
            shell.ray.o[0] = d * sine;
            shell.ray.o[1] = y;
            shell.ray.o[2] = d * cosine;
            conemap__shell_bounds(&shell);
            a = conemap__shell_at(&shell, 0);
            b = conemap__shell_at(&shell, step);
            bound = conemap__map_speed(&shell, 0, 0.01);
            way = turns_apart(b.u, a.u) * f->u_repeat;
            way = sqrt(way * way + (b.v - a.v) * (b.v - a.v) * (double)f->v_size * (double)f->v_size) / step;
            CHECK(way <= bound * (1 + 1e-4), "%s: the map goes by at %g, bound %g", parts[part].name, way, bound);
            if (way / bound > nearest) nearest = way / bound;
        }
        CHECK(nearest > 0.7, "%s: at most %.2f of the bound", parts[part].name, nearest);
        conemap_skeleton_free(&skeleton);
    }
    conemap_free(&map);
}

/* From so far away that a least step is less than the last bit of t: the march ends all the same. */
static void far_relief(void)
{
    static float heights[SIDE * SIDE];
    struct zoo_random random = zoo_seed(516);
    struct truth_map truth;
    struct chain chain;
    conemap_map map;
    conemap_skeleton skeleton;
    conemap_skeleton_trace_desc desc;
    int march;
    REQUIRE(relief_map(ZOO_FBM, 3, heights, &map, &truth), "map");
    make_chain(&random, CYLINDERS, 0.0f, 1, &chain);
    memset(chain.joints, 0, sizeof chain.joints);
    chain.joints[1].position[1] = 2e-5f;
    chain.joints[0].radius = chain.joints[1].radius = 1e-5f;
    chain.joints[0].thickness = chain.joints[1].thickness = 1e-6f;
    REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
    memset(&desc, 0, sizeof desc);
    desc.map = &map;
    desc.steps = 1 << 20;
    for (march = CONEMAP_MARCH_STEPS; march <= CONEMAP_MARCH_CONES; ++march) {
        conemap_ray ray = {{0, 1e-5f, 1e6f}, {0, 0, -1}, 0, 0};
        conemap_skeleton_hit hit;
        desc.march = (conemap_march)march;
        REQUIRE(conemap_skeleton_trace(&skeleton, &desc, &ray, &hit, 1) == CONEMAP_OK, "trace");
        CHECK(hit.status == CONEMAP_HIT && hit.steps <= (1 << 20) + 2, "march %d: status %d, %d steps", march,
              (int)hit.status, hit.steps);
    }
    conemap_skeleton_free(&skeleton);
    conemap_free(&map);
}

/* Where the cutting planes are parallel and the shell's rays are in no hurry, the paper's linear v is right. */
static void linear_v(void)
{
    static float heights[SIDE * SIDE];
    struct zoo_random random = zoo_seed(509);
    struct chain chain;
    struct truth_map truth;
    conemap_map map;
    int bent, n;
    REQUIRE(relief_map(ZOO_FBM, 3, heights, &map, &truth), "map");
    for (bent = 0; bent < 2; ++bent) {
        conemap_skeleton skeleton;
        double worst = 0;
        int k;
        make_chain(&random, CYLINDERS, 0.0f, 3, &chain);
        if (bent) chain.joints[2].position[0] += 3.0f;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        for (n = 0; n < 300; ++n) {
            conemap_skeleton_trace_desc desc;
            conemap_skeleton_hit exact, linear;
            conemap_ray ray;
            memset(&desc, 0, sizeof desc);
            desc.map = &map;
            desc.march = CONEMAP_MARCH_STEPS;
            ray = ray_at(&skeleton.frusta[1], zoo_unit(&random), zoo_unit(&random), 1.0f);
            for (k = 0; k < 3; ++k) ray.direction[k] += spread(&random, 0.2f);
            REQUIRE(conemap_skeleton_trace(&skeleton, &desc, &ray, &exact, 1) == CONEMAP_OK, "trace");
            desc.linear_v = 1;
            REQUIRE(conemap_skeleton_trace(&skeleton, &desc, &ray, &linear, 1) == CONEMAP_OK, "trace");
            if (exact.status != CONEMAP_HIT || linear.status != CONEMAP_HIT) continue;
            if (fabs((double)exact.t - (double)linear.t) > worst) worst = fabs((double)exact.t - (double)linear.t);
        }
        CHECK(bent ? worst > 1e-4 : worst < 1e-5, "%s: exact and linear differ by %g", bent ? "bent" : "straight",
              worst);
        conemap_skeleton_free(&skeleton);
    }
    conemap_free(&map);
}

/* The normal of a relief hit is the gradient of the clearance. */
static void relief_normals(void)
{
    static float heights[SIDE * SIDE];
    struct zoo_random random = zoo_seed(510);
    struct chain chain;
    struct truth_map truth;
    conemap_map map;
    conemap_skeleton skeleton;
    conemap_skeleton_trace_desc desc;
    int n, k, checked = 0, apart = 0;
    memset(&desc, 0, sizeof desc);
    REQUIRE(relief_map(ZOO_FBM, 5, heights, &map, &truth), "map");
    make_chain(&random, TAPERED, 0.1f, 3, &chain);
    chain.joints[3].position[0] += 4.0f;
    for (k = 0; k < 3; ++k) chain.segments[k].twist = 0.2f;
    for (k = 0; k < 4; ++k) chain.joints[k].thickness = 0.3f + 0.05f * (float)k;
    chain.joints[1].radius = 0.6f;
    chain.desc.exact_u = 1;
    REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
    desc.map = &map;
    for (n = 0; n < 400; ++n) {
        conemap_skeleton_hit hit;
        double gradient[3], off = 0;
        conemap_ray ray = ray_at(&skeleton.frusta[1], zoo_unit(&random), zoo_unit(&random), 1.0f);
        REQUIRE(conemap_skeleton_trace(&skeleton, &desc, &ray, &hit, 1) == CONEMAP_OK, "trace");
        if (hit.status != CONEMAP_HIT || hit.segment != 1 || hit.cap || hit.v < 0.02f || hit.v > 0.98f) continue;
        for (k = 0; k < 3; ++k) {
            double a[3], b[3];
            int c;
            for (c = 0; c < 3; ++c) a[c] = b[c] = (double)hit.position[c];
            a[k] -= 1e-5;
            b[k] += 1e-5;
            gradient[k] = clearance(&skeleton.frusta[1], &truth, b) - clearance(&skeleton.frusta[1], &truth, a);
        }
        unit(gradient);
        for (k = 0; k < 3; ++k) off += fabs(gradient[k] - (double)hit.true_normal[k]);
        ++checked;
        apart += off >= 2e-4; /* across a cell's border the difference quotient is of neither side */
    }
    CHECK(checked > 150 && apart < checked / 20, "%d of %d normals are not the gradient", apart, checked);
    conemap_skeleton_free(&skeleton);
    conemap_free(&map);
}

/* ---- many segments, updates -------------------------------------------------------------------------------------- */

static void make_tree(struct zoo_random *random, int count, conemap_joint *joints, conemap_segment *segments,
                      conemap_skeleton_desc *desc)
{
    int i, k;
    memset(desc, 0, sizeof *desc);
    memset(segments, 0, (size_t)count * sizeof *segments);
    memset(joints, 0, (size_t)(count + 1) * sizeof *joints);
    joints[0].radius = 0.3f;
    for (i = 0; i < count; ++i) {
        const int parent = i == 0 ? -1 : zoo_below(random, i);
        const int base = parent < 0 ? 0 : segments[parent].top;
        segments[i].base = base;
        segments[i].top = i + 1;
        segments[i].parent = parent;
        for (k = 0; k < 3; ++k) joints[i + 1].position[k] = joints[base].position[k] + spread(random, 2.0f);
        if (i % 5 == 3) segments[i].flat = segments[i].wide[i % 3] = 0.5f;
        joints[i + 1].radius = 0.05f + 0.2f * zoo_unit(random);
        joints[i + 1].thickness = 0.05f;
    }
    desc->joints = joints;
    desc->joint_count = count + 1;
    desc->segments = segments;
    desc->segment_count = count;
}

enum { TREE = 300 };

/* The tree of boxes finds what a loop over all segments finds, also after joints moved. */
static void tree_of_boxes(void)
{
    struct zoo_random random = zoo_seed(511);
    static conemap_joint joints[TREE + 1];
    static conemap_segment segments[TREE];
    conemap_skeleton_desc desc;
    conemap_skeleton skeleton;
    int n, i, k, moved, hits = 0;
    make_tree(&random, TREE, joints, segments, &desc);
    REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "build");
    for (moved = 0; moved < 2; ++moved) {
        if (moved) {
            for (i = 0; i <= TREE; ++i)
                for (k = 0; k < 3; ++k) joints[i].position[k] += spread(&random, 0.5f);
            REQUIRE(conemap_skeleton_update(&skeleton, joints) == CONEMAP_OK, "update");
        }
        for (n = 0; n < 800; ++n) {
            conemap_ray ray;
            conemap_skeleton_hit hit, any;
            conemap_skeleton_trace_desc trace;
            float first = 1e30f;
            memset(&ray, 0, sizeof ray);
            memset(&trace, 0, sizeof trace);
            for (k = 0; k < 3; ++k) {
                ray.origin[k] = n % 3 ? spread(&random, 20.0f) : joints[zoo_below(&random, TREE)].position[k];
                ray.direction[k] = (n % 5 ? 0.0f : spread(&random, 1.0f)) +
                                   joints[zoo_below(&random, TREE)].position[k] - ray.origin[k];
            }
            if (n % 7 == 0) {
                memset(ray.direction, 0, sizeof ray.direction);
                ray.direction[n % 3] = 1;
            }
            if (n % 11 == 0) ray.t_max = zoo_between(&random, 0.1f, 2.0f);
            for (i = 0; i < TREE; ++i) {
                float span[2];
                REQUIRE(conemap_frustum_span(&skeleton.frusta[i], 0.0f, &ray, span) == CONEMAP_OK, "span");
                if (span[0] <= span[1] && span[0] < first) first = span[0];
            }
            REQUIRE(conemap_skeleton_trace(&skeleton, &trace, &ray, &hit, 1) == CONEMAP_OK, "trace");
            trace.any_hit = 1;
            REQUIRE(conemap_skeleton_trace(&skeleton, &trace, &ray, &any, 1) == CONEMAP_OK, "trace");
            CHECK((hit.status == CONEMAP_HIT) == (first < 1e30f), "ray %d: %d, by a loop %g", n, (int)hit.status,
                  (double)first);
            CHECK((any.status == CONEMAP_HIT) == (hit.status == CONEMAP_HIT), "ray %d: any hit differs", n);
            if (hit.status != CONEMAP_HIT) {
                CHECK(hit.status == (ray.t_max > 0 ? CONEMAP_T_MAX : CONEMAP_LEFT), "ray %d: status %d", n,
                      (int)hit.status);
                continue;
            }
            ++hits;
            CHECK(hit.t == first, "ray %d: at %.9g, by a loop %.9g", n, (double)hit.t, (double)first);
            CHECK(any.t >= hit.t, "ray %d: any hit is before the first", n);
        }
    }
    CHECK(hits > 400, "only %d hits", hits);
    conemap_skeleton_free(&skeleton);
}

static void updates(void)
{
    struct zoo_random random = zoo_seed(512);
    static conemap_joint joints[TREE + 1], moved[TREE + 1];
    static conemap_segment segments[TREE];
    static conemap_frustum rest[TREE], now[TREE];
    conemap_skeleton_desc desc;
    conemap_skeleton skeleton, other;
    size_t size;
    void *memory;
    int i, k;
    make_tree(&random, TREE, joints, segments, &desc);
    desc.v_per_length = 1.0f;
    REQUIRE(conemap_skeleton_memory(&desc, &size) == CONEMAP_OK, "memory");
    memory = test_alloc(size);
    desc.memory = memory;
    desc.memory_size = size;
    REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "build");
    memcpy(rest, skeleton.frusta, sizeof rest);
    memcpy(moved, joints, sizeof moved);
    for (i = 0; i <= TREE; ++i)
        for (k = 0; k < 3; ++k) moved[i].position[k] += spread(&random, 0.3f);
    REQUIRE(conemap_skeleton_update(&skeleton, moved) == CONEMAP_OK, "update");
    CHECK(memcmp(rest, skeleton.frusta, sizeof rest) != 0, "frusta moved");
    for (i = 0; i < TREE; ++i)
        CHECK(rest[i].v_size == skeleton.frusta[i].v_size && rest[i].v_start == skeleton.frusta[i].v_start,
              "v stays");
    moved[17].position[1] = (float)NAN;
    memcpy(now, skeleton.frusta, sizeof now);
    CHECK(conemap_skeleton_update(&skeleton, moved) == CONEMAP_ERROR_JOINT, "NaN");
    CHECK(memcmp(now, skeleton.frusta, sizeof now) == 0, "after an error the skeleton is as it was");
    moved[17] = joints[17];
    moved[segments[40].base] = moved[segments[40].top];
    CHECK(conemap_skeleton_update(&skeleton, moved) == CONEMAP_ERROR_LENGTH, "no length");
    CHECK(conemap_skeleton_update(&skeleton, joints) == CONEMAP_OK, "back");
    CHECK(memcmp(rest, skeleton.frusta, sizeof rest) == 0, "there and back again gives the same bits");
    desc.memory = NULL;
    REQUIRE(conemap_skeleton_build(&desc, &other) == CONEMAP_OK, "build");
    CHECK(memcmp(rest, other.frusta, sizeof rest) == 0, "a build gives the same bits");
    conemap_skeleton_free(&other);
    conemap_skeleton_free(&skeleton);
    test_release(memory);
}

/* A full turn of bending must not make textures jump: from frame to frame u on the surface moves as little as the
   joints do. */
static void no_popping(void)
{
    struct chain chain;
    struct zoo_random random = zoo_seed(513);
    conemap_skeleton skeleton;
    conemap_frustum before[2];
    double worst = 0;
    int n, k, i;
    make_chain(&random, TAPERED, 0.0f, 2, &chain);
    for (k = 0; k < 3; ++k) { /* straight at first, along y */
        chain.joints[k].position[0] = chain.joints[k].position[2] = 0;
        chain.joints[k].position[1] = 3.0f * (float)k;
    }
    REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
    for (n = 0; n <= 4000; ++n) { /* a spiral out of the straight line and back through it */
        const double bend = 1.2 * sin(TURN * n / 2000.0), around = TURN * n / 3000.0;
        chain.joints[2].position[0] = (float)(3 * sin(bend) * cos(around));
        chain.joints[2].position[1] = (float)(3 + 3 * cos(bend));
        chain.joints[2].position[2] = (float)(3 * sin(bend) * sin(around));
        memcpy(before, skeleton.frusta, sizeof before);
        REQUIRE(conemap_skeleton_update(&skeleton, chain.joints) == CONEMAP_OK, "update");
        for (i = 0; n > 0 && i < 2; ++i)
            for (k = 0; k < 8; ++k) {
                float uvw[3], a[3], b[3];
                uvw[0] = (float)k / 8.0f;
                uvw[1] = k & 1 ? 0.9f : 0.1f;
                uvw[2] = 0.0f;
                conemap_frustum_point(&before[i], uvw, a);
                conemap_frustum_point(&skeleton.frusta[i], uvw, b);
                if (apart3(a, b) > worst) worst = apart3(a, b);
            }
    }
    CHECK(worst < 0.06, "a point of the surface jumps by %g between frames", worst);
    conemap_skeleton_free(&skeleton);
}

/* Bends of every angle: none is missed by the flags, frusta stay closed. */
static void sharp_bends(void)
{
    int degrees, clamped_at = 181;
    for (degrees = 0; degrees <= 180; ++degrees) {
        const double angle = degrees / 360.0 * TURN;
        conemap_joint joints[3] = {{{0, 0, 0}, 0.5f, 0.1f}, {{0, 6, 0}, 0.5f, 0.1f}, {{0, 0, 0}, 0.5f, 0.1f}};
        conemap_segment segments[2];
        conemap_skeleton_desc desc;
        conemap_skeleton skeleton;
        conemap_ray ray = {{0, 6, 9}, {0, 0, -1}, 0, 0};
        conemap_skeleton_hit hit;
        int clamped;
        memset(segments, 0, sizeof segments);
        memset(&desc, 0, sizeof desc);
        joints[2].position[0] = (float)(6 * sin(angle));
        joints[2].position[1] = (float)(6 + 6 * cos(angle));
        segments[0].top = 1;
        segments[0].parent = -1;
        segments[1].base = 1;
        segments[1].top = 2;
        desc.joints = joints;
        desc.joint_count = 3;
        desc.segments = segments;
        desc.segment_count = 2;
        REQUIRE(conemap_skeleton_build(&desc, &skeleton) == CONEMAP_OK, "%d degrees", degrees);
        clamped = skeleton.clamped != 0;
        if (clamped && clamped_at > degrees) clamped_at = degrees;
        CHECK(clamped == (degrees >= clamped_at), "%d degrees: clamped %d", degrees, clamped);
        REQUIRE(conemap_skeleton_trace(&skeleton, NULL, &ray, &hit, 1) == CONEMAP_OK, "trace");
        CHECK(hit.status == CONEMAP_HIT && fabs((double)hit.position[2] - 0.5) < 0.01,
              "%d degrees: the joint is hit at z %g", degrees, (double)hit.position[2]);
        conemap_skeleton_free(&skeleton);
    }
    CHECK(clamped_at > 120 && clamped_at < 150, "bends are clamped from %d degrees", clamped_at);
    test_note("bends clamped from %d degrees", clamped_at);
}

/* Whether a point lies in any plain frustum of a skeleton. */
static int within(const conemap_skeleton *skeleton, const double *world)
{
    int i;
    for (i = 0; i < skeleton->count; ++i)
        if (outside(&skeleton->frusta[i], 0.0, world) <= 0) return 1;
    return 0;
}

/* A joint with a round join holds a ball of its radius, in bends of every angle, and none has a notch. */
static void round_joins(void)
{
    int degrees, n, k, rounded_at = 181, notches[2] = {0, 0};
    for (degrees = 0; degrees <= 180; degrees += 4) {
        const double angle = degrees / 360.0 * TURN;
        struct zoo_random random = zoo_seed(521);
        struct chain chain;
        int pieces;
        make_chain(&random, CYLINDERS, 0, 2, &chain);
        memset(chain.joints, 0, sizeof chain.joints);
        for (k = 0; k < 3; ++k) {
            chain.joints[k].radius = 0.5f;
            chain.joints[k].thickness = 0.1f;
        }
        chain.joints[1].position[1] = 6;
        chain.joints[2].position[0] = (float)(6 * sin(angle));
        chain.joints[2].position[1] = (float)(6 + 6 * cos(angle));
        chain.segments[0].v_size = 2.0f;
        for (pieces = 0; pieces <= 8; pieces = pieces ? 2 * pieces : 2) {
            conemap_skeleton skeleton;
            int outside_count = 0;
            chain.desc.round_joins = pieces;
            REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "%d degrees", degrees);
            CHECK(skeleton.rounded <= 1 && skeleton.count == 2 + pieces * skeleton.rounded, "%d frusta",
                  skeleton.count);
            if (pieces) {
                CHECK(skeleton.clamped == 0, "%d degrees: clamped", degrees);
                if (skeleton.rounded && degrees < rounded_at) rounded_at = degrees;
                CHECK(skeleton.rounded == (degrees >= rounded_at), "%d degrees: %d round", degrees, skeleton.rounded);
            }
            if (skeleton.rounded) {
                const conemap_frustum *f = &skeleton.frusta[2];
                float length = 0;
                CHECK(skeleton.frusta[0].child == 2 && f->parent == 0 && (f->flags & CONEMAP_FRUSTUM_ROUND) &&
                          skeleton.frusta[0].branch == 1 && (skeleton.frusta[1].flags & CONEMAP_FRUSTUM_BRANCH),
                      "links of a round join");
                for (k = 0; k < pieces; ++k) length += f[k].h;
                CHECK(fabsf(f->v_size / f->h - 2.0f / 6.0f) < 1e-6f && fabsf(f->v_start - 2.0f) < 1e-6f &&
                          length > 0.5f && length < 0.75f,
                      "v goes on over the join, %g long", (double)length);
            }
            for (n = 0; n < 300; ++n) {
                double p[3], at[3];
                for (k = 0; k < 3; ++k) p[k] = (double)spread(&random, 1.0f);
                unit(p);
                for (k = 0; k < 3; ++k) at[k] = (double)chain.joints[1].position[k] + 0.495 * p[k];
                if (degrees > 60) outside_count += !within(&skeleton, at);
            }
            notches[pieces != 0] += outside_count;
            conemap_skeleton_free(&skeleton);
        }
    }
    CHECK(rounded_at > 120 && rounded_at < 145, "joins are round from %d degrees", rounded_at);
    CHECK(notches[0] > 0 && notches[1] == 0, "notches: %d, with round joins %d", notches[0], notches[1]);
    test_note("joins round from %d degrees", rounded_at);
}

/* The guarantee of round joins, over skeletons as jagged as they come: cutting planes do not meet inside a shell,
   nothing is clamped, and the memory asked for is enough. And they move as the rest does. */
static void rounded_skeletons(void)
{
    struct zoo_random random = zoo_seed(522);
    const int rounds = ray_count(0) > 0 ? 20000 : 1000;
    int round, i, k, clamped = 0, rounded = 0, segments = 0;
    for (round = 0; round < rounds; ++round) {
        const int count = 2 + zoo_below(&random, 8);
        struct chain chain;
        conemap_skeleton skeleton;
        conemap_joint moved[16];
        static conemap_frustum rest[128];
        void *memory;
        size_t size;
        make_chain(&random, zoo_below(&random, SHAPES), 0.3f, count, &chain);
        for (i = 1; i <= count; ++i)
            for (k = 0; k < 3; ++k)
                chain.joints[i].position[k] = chain.joints[i - 1].position[k] + (k == 1 ? 0.01f : 0.0f) +
                                              (round % 3 == 0 ? (float)(zoo_below(&random, 3) - 1)
                                                              : spread(&random, round % 3 == 1 ? 1.0f : 6.0f));
        if (round % 4 == 1) flatten(&random, zoo_between(&random, 0.1f, 1.0f), &chain);
        for (i = 2; i < count && round % 5 == 0; ++i) { /* branches too */
            chain.segments[i].parent = zoo_below(&random, i);
            chain.segments[i].base = chain.segments[chain.segments[i].parent].top;
        }
        if (conemap_skeleton_build(&chain.desc, &skeleton) != CONEMAP_OK) continue;
        clamped += skeleton.clamped;
        conemap_skeleton_free(&skeleton);
        chain.desc.round_joins = 2 + zoo_below(&random, 7);
        REQUIRE(conemap_skeleton_memory(&chain.desc, &size) == CONEMAP_OK, "memory");
        memory = test_alloc(size);
        chain.desc.memory = memory;
        chain.desc.memory_size = size;
        REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
        rounded += skeleton.rounded;
        segments += count;
        CHECK(skeleton.clamped == 0, "round %d: %d clamped", round, skeleton.clamped);
        for (i = 0; i < skeleton.count; ++i) {
            const conemap_frustum *f = &skeleton.frusta[i];
            const conemap__cone outer = conemap__cone_at(f, 1.0);
            for (k = 0; k < 32; ++k) {
                const double s = sin(TURN * k / 32), c = cos(TURN * k / 32);
                const double low = conemap__cut_y(f->lower, (double)f->lower[0] * s + (double)f->lower[1] * c, outer);
                const double high = conemap__cut_y(f->upper, (double)f->upper[0] * s + (double)f->upper[1] * c, outer);
                CHECK(low < high, "round %d: planes meet in frustum %d, from %g to %g", round, i, low, high);
            }
        }
        memcpy(rest, skeleton.frusta, (size_t)skeleton.count * sizeof *rest);
        memcpy(moved, chain.joints, sizeof moved);
        for (i = 0; i <= count; ++i)
            for (k = 0; k < 3; ++k) moved[i].position[k] += spread(&random, 0.01f);
        i = skeleton.count;
        if (conemap_skeleton_update(&skeleton, moved) == CONEMAP_OK) {
            CHECK(memcmp(rest, skeleton.frusta, (size_t)i * sizeof *rest) != 0, "round %d: nothing moved", round);
            CHECK(skeleton.count == i, "round %d: the count changed", round);
        }
        CHECK(conemap_skeleton_update(&skeleton, chain.joints) == CONEMAP_OK &&
                  memcmp(rest, skeleton.frusta, (size_t)i * sizeof *rest) == 0,
              "round %d: there and back gives other bits", round);
        conemap_skeleton_free(&skeleton);
        test_release(memory);
    }
    CHECK(clamped > rounds && rounded > rounds, "%d clamped, %d round: too tame", clamped, rounded);
    test_note("%d of %d clamped, with round joins none", clamped, segments);
}

static float wild(struct zoo_random *random, float size)
{
    const int kind = zoo_below(random, 6);
    if (kind == 0) return 0;
    if (kind == 1) return 1e-6f * size * zoo_unit(random);
    if (kind == 2) return 1e6f * size * zoo_unit(random);
    return size * zoo_unit(random);
}

/* Skeletons that nobody would draw, at any scale: what the proof of the corners needs holds for each frustum, and
   whatever is hit has an answer. */
static void wild_skeletons(void)
{
    struct zoo_random random = zoo_seed(517);
    static float heights[SIDE * SIDE];
    struct truth_map truth;
    conemap_map map;
    const int rounds = ray_count(0) > 0 ? 40000 : 1500;
    int round, i, k, built_ok = 0, clamped = 0;
    REQUIRE(relief_map(ZOO_WHITE, 3, heights, &map, &truth), "map");
    for (round = 0; round < rounds; ++round) {
        const int count = 1 + zoo_below(&random, 8);
        const float scale = round % 5 ? 1.0f : powf(10.0f, spread(&random, 9.0f));
        struct chain chain;
        conemap_skeleton skeleton;
        memset(&chain, 0, sizeof chain);
        for (i = 0; i <= count; ++i) {
            const int tame = zoo_below(&random, 3);
            for (k = 0; k < 3; ++k)
                chain.joints[i].position[k] =
                    scale * (tame ? spread(&random, 1.0f) : (float)(zoo_below(&random, 3) - 1));
            chain.joints[i].radius = scale * (tame ? 0.3f * zoo_unit(&random) : wild(&random, 0.5f));
            chain.joints[i].thickness = scale * (tame ? 0.1f * zoo_unit(&random) : wild(&random, 0.2f));
        }
        for (i = 0; i < count; ++i) {
            const int parent = i == 0 ? -1 : zoo_below(&random, 3) ? i - 1 : zoo_below(&random, i + 1) - 1;
            chain.segments[i].parent = parent;
            chain.segments[i].base = parent < 0 ? 0 : chain.segments[parent].top;
            chain.segments[i].top = i + 1;
            chain.segments[i].twist = spread(&random, 2.0f);
            if (zoo_below(&random, 4) == 0) chain.segments[i].radius = scale * wild(&random, 0.3f);
        }
        chain.desc.joints = chain.joints;
        chain.desc.joint_count = count + 1;
        chain.desc.segments = chain.segments;
        chain.desc.segment_count = count;
        if (round % 4 == 3) flatten(&random, zoo_between(&random, 0.01f, 1.0f), &chain);
        chain.desc.fit = zoo_below(&random, 2);
        chain.desc.exact_u = zoo_below(&random, 2);
        chain.desc.round_joins = zoo_below(&random, 3) ? 0 : 2 + zoo_below(&random, 7);
        chain.desc.slope_normals = round & 1;
        chain.desc.blend = (float)(round % 3);
        if (conemap_skeleton_build(&chain.desc, &skeleton) != CONEMAP_OK) continue;
        ++built_ok;
        clamped += skeleton.clamped != 0;
        for (i = 0; i < skeleton.count; ++i) {
            const conemap_frustum *f = &skeleton.frusta[i];
            const conemap__cone outer = conemap__cone_at(f, 1.0), inner = conemap__cone_at(f, 0.0);
            const double grain = 1e-4 * (outer.r + fabs(outer.r + outer.k * (double)f->h));
            for (k = 0; k < 4; ++k) {
                const double low = conemap__corner_y(f->lower, outer, k),
                             high = conemap__corner_y(f->upper, outer, k);
                const double thin_low = (double)f->t + (double)f->tk * conemap__corner_y(f->lower, inner, k);
                const double thin_high = (double)f->t + (double)f->tk * conemap__corner_y(f->upper, inner, k);
                CHECK(low <= high, "round %d: the planes meet inside: %g %g", round, low, high);
                CHECK(outer.r + outer.k * low >= -grain && outer.r + outer.k * high >= -grain,
                      "round %d: past the point", round);
                CHECK(thin_low >= -grain && thin_high >= -grain, "round %d: thickness %g %g", round, thin_low,
                      thin_high);
            }
        }
        for (i = 0; i < 8; ++i) {
            conemap_skeleton_trace_desc desc;
            conemap_skeleton_hit hit;
            conemap_ray ray;
            memset(&desc, 0, sizeof desc);
            memset(&ray, 0, sizeof ray);
            for (k = 0; k < 3; ++k) {
                ray.origin[k] = scale * spread(&random, i == 0 ? 1e5f : 2.0f);
                ray.direction[k] = chain.joints[zoo_below(&random, count + 1)].position[k] - ray.origin[k];
            }
            desc.map = i & 1 ? &map : NULL;
            desc.march = (conemap_march)zoo_below(&random, 3);
            desc.steps = 1 + zoo_below(&random, 100);
            if (conemap_skeleton_trace(&skeleton, &desc, &ray, &hit, 1) != CONEMAP_OK || hit.status != CONEMAP_HIT)
                continue;
            for (k = 0; k < 3; ++k)
                CHECK(hit.normal[k] >= -1.001f && hit.normal[k] <= 1.001f && hit.true_normal[k] >= -1.001f &&
                          hit.true_normal[k] <= 1.001f && hit.v >= 0 && hit.v <= 1 && hit.u >= 0 && hit.u <= 1 &&
                          hit.t >= 0,
                      "round %d: a hit without a normal or place", round);
        }
        conemap_skeleton_free(&skeleton);
    }
    conemap_free(&map);
    CHECK(built_ok > rounds / 2 && clamped > rounds / 10, "%d of %d built, %d clamped", built_ok, rounds, clamped);
}

/* ---- errors, layout ------------------------------------------------------------------------------------------- */

static void layout(void)
{
    const size_t at[6] = {offsetof(conemap_frustum, lower), offsetof(conemap_frustum, r),
                          offsetof(conemap_frustum, h),     offsetof(conemap_frustum, parent),
                          offsetof(conemap_frustum, flags), sizeof(conemap_frustum)};
    static const size_t right[6] = {48, 80, 96, 112, 128, 144};
    int k;
    for (k = 0; k < 6; ++k) CHECK(at[k] == right[k], "row %d at byte %d", k, (int)at[k]);
}

static conemap_result built(const conemap_skeleton_desc *desc)
{
    conemap_skeleton skeleton;
    conemap_result result;
    memset(&skeleton, 0x55, sizeof skeleton);
    result = conemap_skeleton_build(desc, &skeleton);
    CHECK(result == CONEMAP_OK || (!skeleton.frusta && skeleton.count == 0), "zeroed after an error");
    conemap_skeleton_free(&skeleton);
    return result;
}

#define EXPECT(change, code)                                                                                      \
    do {                                                                                                          \
        struct zoo_random again = zoo_seed(9);                                                                    \
        conemap_result got;                                                                                       \
        make_chain(&again, CYLINDERS, 0.1f, 4, &chain);                                                           \
        change;                                                                                                   \
        got = built(&chain.desc);                                                                                 \
        CHECK(got == (code), "%s: %s", #change, conemap_result_string(got));                                      \
    } while (0)

static void *refuse(size_t size, void *user)
{
    (void)size;
    (void)user;
    return NULL;
}

static void ignore(void *memory, void *user)
{
    (void)memory;
    (void)user;
}

static void bad_skeletons(void)
{
    struct chain chain;
    conemap_skeleton skeleton;
    unsigned char *memory = (unsigned char *)test_alloc(4096);
    size_t size;
    EXPECT((void)0, CONEMAP_OK);
    EXPECT(chain.desc.joints = NULL, CONEMAP_ERROR_NULL);
    EXPECT(chain.desc.segments = NULL, CONEMAP_ERROR_NULL);
    EXPECT(chain.desc.allocator.allocate = refuse, CONEMAP_ERROR_NULL);
    EXPECT((chain.desc.allocator.allocate = refuse, chain.desc.allocator.release = ignore), CONEMAP_ERROR_MEMORY);
    EXPECT(chain.desc.segment_count = 0, CONEMAP_ERROR_SIZE);
    EXPECT(chain.desc.segment_count = -1, CONEMAP_ERROR_SIZE);
    EXPECT(chain.desc.joint_count = 0, CONEMAP_ERROR_SIZE);
    EXPECT(chain.desc.joint_count = 4, CONEMAP_ERROR_JOINT);
    EXPECT(chain.desc.v_per_length = -1.0f, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.desc.round_joins = 1, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.desc.round_joins = 9, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.desc.round_joins = 8, CONEMAP_OK);
    EXPECT((chain.desc.round_joins = 2, chain.joints[2].position[1] = (float)NAN), CONEMAP_ERROR_JOINT);
    EXPECT((chain.desc.round_joins = 2, chain.segments[3].top = 5), CONEMAP_ERROR_JOINT);
    EXPECT((chain.desc.round_joins = 2, chain.segments[2].parent = 4), CONEMAP_ERROR_PARENT);
    EXPECT((chain.desc.round_joins = 2, chain.joints[3] = chain.joints[2]), CONEMAP_ERROR_LENGTH);
    EXPECT((chain.desc.round_joins = 2, chain.segments[3].top = 0, chain.segments[0].parent = 3), CONEMAP_ERROR_CYCLE);
    EXPECT(chain.desc.blend = (float)NAN, CONEMAP_ERROR_PARAMETER);
    EXPECT((chain.desc.memory = memory, chain.desc.memory_size = 16), CONEMAP_ERROR_BUFFER);
    EXPECT((chain.desc.memory = memory + 4, chain.desc.memory_size = 4000), CONEMAP_ERROR_ALIGNMENT);
    EXPECT((chain.desc.memory = memory, chain.desc.memory_size = 4096), CONEMAP_OK);
    EXPECT(chain.joints[2].position[1] = (float)NAN, CONEMAP_ERROR_JOINT);
    EXPECT(chain.joints[2].position[1] = (float)INFINITY, CONEMAP_ERROR_JOINT);
    EXPECT(chain.joints[2].position[1] = 1e20f, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.joints[2].radius = (float)NAN, CONEMAP_ERROR_JOINT);
    EXPECT(chain.joints[2].thickness = (float)INFINITY, CONEMAP_ERROR_JOINT);
    EXPECT(chain.joints[2].radius = -0.1f, CONEMAP_ERROR_RADIUS);
    EXPECT(chain.joints[2].thickness = -0.1f, CONEMAP_ERROR_RADIUS);
    EXPECT(chain.joints[2].radius = 0.0f, CONEMAP_OK);
    EXPECT((chain.joints[2].radius = chain.joints[3].radius = 0,
            chain.joints[2].thickness = chain.joints[3].thickness = 0),
           CONEMAP_ERROR_RADIUS);
    EXPECT((chain.joints[2].radius = chain.joints[3].radius = 0), CONEMAP_OK);
    EXPECT(chain.joints[3] = chain.joints[2], CONEMAP_ERROR_LENGTH);
    EXPECT((chain.joints[2].radius = 1e-30f, chain.segments[2].radius = 1e10f), CONEMAP_ERROR_LENGTH);
    EXPECT((chain.joints[2].radius = 1e-30f, chain.segments[2].radius = 0.1f), CONEMAP_ERROR_LENGTH); /* the shell */
    EXPECT(chain.segments[2].base = -1, CONEMAP_ERROR_JOINT);
    EXPECT(chain.segments[3].top = 5, CONEMAP_ERROR_JOINT);
    EXPECT(chain.segments[2].parent = 4, CONEMAP_ERROR_PARENT);
    EXPECT(chain.segments[2].parent = 0, CONEMAP_ERROR_PARENT);
    EXPECT(chain.segments[2].parent = -7, CONEMAP_OK);
    EXPECT((chain.segments[3].top = 0, chain.segments[0].parent = 3), CONEMAP_ERROR_CYCLE);
    EXPECT((chain.segments[3].top = 3, chain.segments[3].parent = 3), CONEMAP_ERROR_LENGTH); /* its own parent */
    EXPECT(chain.segments[2].twist = (float)NAN, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.segments[2].flat = (float)NAN, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.segments[2].flat = -0.5f, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.segments[2].flat = 2.0f, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.segments[2].wide[1] = (float)INFINITY, CONEMAP_ERROR_PARAMETER);
    EXPECT((chain.segments[2].flat = 0.5f, chain.segments[1].twist = 0.5f), CONEMAP_ERROR_UNSUPPORTED);
    EXPECT((chain.segments[2].flat = 0.5f, chain.segments[2].twist = 0.5f), CONEMAP_OK);
    EXPECT(chain.segments[2].u_repeat = -1, CONEMAP_ERROR_PARAMETER);
    EXPECT(chain.segments[2].radius = -1.0f, CONEMAP_ERROR_RADIUS);
    EXPECT(chain.segments[2].v_size = (float)INFINITY, CONEMAP_ERROR_PARAMETER);
    CHECK(conemap_skeleton_build(NULL, &skeleton) == CONEMAP_ERROR_NULL, "no desc");
    CHECK(conemap_skeleton_build(&chain.desc, NULL) == CONEMAP_ERROR_NULL, "no skeleton");
    CHECK(conemap_skeleton_memory(NULL, &size) == CONEMAP_ERROR_NULL &&
              conemap_skeleton_memory(&chain.desc, NULL) == CONEMAP_ERROR_NULL,
          "memory's pointers");
    CHECK(conemap_skeleton_update(NULL, chain.joints) == CONEMAP_ERROR_NULL, "no skeleton to update");
    conemap_skeleton_free(NULL);
    test_release(memory);
}

static void bad_traces(void)
{
    struct chain chain;
    struct zoo_random random = zoo_seed(514);
    static float heights[SIDE * SIDE];
    struct truth_map truth;
    conemap_skeleton skeleton;
    conemap_skeleton_trace_desc desc;
    conemap_map map, clamped;
    conemap_desc build;
    conemap_skeleton_hit hits[2];
    conemap_ray rays[2] = {{{0, 0, 0}, {0, 0, 0}, 0, 0}, {{50, 50, 50}, {0, 1, 0}, 0, 0}};
    float span[2], point[3], uvw[3] = {0, 0, 0};
    make_chain(&random, CYLINDERS, 0.1f, 2, &chain);
    REQUIRE(conemap_skeleton_build(&chain.desc, &skeleton) == CONEMAP_OK, "build");
    REQUIRE(relief_map(ZOO_FBM, 1, heights, &map, &truth), "map");
    memset(&build, 0, sizeof build);
    build.heights.pixels = heights;
    build.heights.width = build.heights.height = SIDE;
    REQUIRE(conemap_build(&build, &clamped) == CONEMAP_OK, "map");
    CHECK(conemap_skeleton_trace(&skeleton, NULL, rays, hits, 2) == CONEMAP_ERROR_RAY_DIRECTION &&
              hits[0].status == CONEMAP_INVALID && hits[1].status == CONEMAP_LEFT,
          "the good ray is traced");
    memset(&desc, 0, sizeof desc);
    desc.height = 1.5f;
    CHECK(conemap_skeleton_trace(&skeleton, &desc, rays, hits, 2) == CONEMAP_ERROR_PARAMETER, "height");
    memset(&desc, 0, sizeof desc);
    desc.march = CONEMAP_MARCH_COUNT;
    CHECK(conemap_skeleton_trace(&skeleton, &desc, rays, hits, 2) == CONEMAP_ERROR_ENUM, "march");
    memset(&desc, 0, sizeof desc);
    desc.map = &clamped;
    CHECK(conemap_skeleton_trace(&skeleton, &desc, rays, hits, 2) == CONEMAP_ERROR_UNSUPPORTED, "clamped in u");
    desc.map = &map;
    desc.march = CONEMAP_MARCH_CONES;
    desc.linear_v = 1;
    CHECK(conemap_skeleton_trace(&skeleton, &desc, rays, hits, 2) == CONEMAP_ERROR_UNSUPPORTED, "linear cones");
    desc.linear_v = 0;
    desc.steps = -1;
    CHECK(conemap_skeleton_trace(&skeleton, &desc, rays, hits, 2) == CONEMAP_ERROR_PARAMETER, "steps");
    CHECK(conemap_skeleton_trace(&skeleton, NULL, rays, hits, -1) == CONEMAP_ERROR_PARAMETER, "count");
    CHECK(conemap_skeleton_trace(&skeleton, NULL, NULL, hits, 1) == CONEMAP_ERROR_NULL, "rays");
    CHECK(conemap_skeleton_trace(NULL, NULL, rays, hits, 1) == CONEMAP_ERROR_NULL, "skeleton");
    CHECK(conemap_frustum_span(skeleton.frusta, -1.0f, rays + 1, span) == CONEMAP_ERROR_PARAMETER, "span height");
    CHECK(conemap_frustum_span(skeleton.frusta, 0.0f, rays, span) == CONEMAP_ERROR_RAY_DIRECTION, "span ray");
    CHECK(conemap_frustum_point(NULL, uvw, uvw) == CONEMAP_ERROR_NULL &&
              conemap_frustum_uvw(skeleton.frusta, NULL, uvw) == CONEMAP_ERROR_NULL &&
              conemap_frustum_corners(NULL, NULL) == CONEMAP_ERROR_NULL,
          "null");
    uvw[1] = (float)NAN;
    CHECK(conemap_frustum_point(skeleton.frusta, uvw, point) == CONEMAP_ERROR_PARAMETER, "NaN v");
    CHECK(conemap_frustum_uvw(skeleton.frusta, uvw, uvw) == CONEMAP_ERROR_POSITION, "NaN point");
    conemap_skeleton_free(&skeleton);
    conemap_free(&map);
    conemap_free(&clamped);
}

const struct test_case frusta_tests[] = {
    {"layout", layout},
    {"spans", spans},
    {"exact cases", exact_cases},
    {"contained", contained},
    {"seams", seams},
    {"exact u", exact_u},
    {"elliptical", elliptical},
    {"elliptical branch", elliptical_branch},
    {"joint normals", joint_normals},
    {"c1 normals", c1_normals},
    {"branch normals", branch_normals},
    {"blend across joints", blend_across_joints},
    {"equations of the cut", equations_of_the_cut},
    {"equations of the frustum", equations_of_the_frustum},
    {"fit", fit},
    {"relief by steps", relief_by_steps},
    {"relief by cones", relief_by_cones},
    {"speed bound", speed_bound},
    {"tight speed bound", tight_speed_bound},
    {"far relief", far_relief},
    {"linear v", linear_v},
    {"relief normals", relief_normals},
    {"tree of boxes", tree_of_boxes},
    {"updates", updates},
    {"no popping", no_popping},
    {"sharp bends", sharp_bends},
    {"round joins", round_joins},
    {"rounded skeletons", rounded_skeletons},
    {"wild skeletons", wild_skeletons},
    {"bad skeletons", bad_skeletons},
    {"bad traces", bad_traces},
    {NULL, NULL},
};
