/* Cones with the bilinear guarantee and with slack, against dense sampling in double precision. A point test can miss a
   violation between its points (tests/verify.c proves cells by bounds), but it shares nothing with the code it judges. */
#include <math.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

#define MOST (61 * 44)
#define GRID 4 /* steps across a cell */
#define APEX (1.0 / 1048576.0)

struct relief {
    int kind, width, height;
    conemap_wrap wrap_u, wrap_v;
    int per_cell;
    float aspect;
    float heights[MOST], cones[MOST];
};

static const char *describe(const struct relief *r)
{
    static char text[128];
    snprintf(text, sizeof text, "%s %dx%d wraps %d %d aspect %g", zoo_name(r->kind), r->width, r->height,
             (int)r->wrap_u, (int)r->wrap_v, (double)r->aspect);
    return text;
}

static conemap_result build_with(struct relief *r, conemap_generator generator, conemap_guarantee guarantee, float slack,
                                 float max_tan)
{
    conemap_desc desc;
    conemap_map map;
    conemap_result result;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = r->heights;
    desc.heights.width = r->width;
    desc.heights.height = r->height;
    desc.wrap_u = r->wrap_u;
    desc.wrap_v = r->wrap_v;
    desc.aspect = r->aspect;
    desc.texture.per_cell = r->per_cell;
    desc.generator = generator;
    desc.guarantee = guarantee;
    desc.slack = slack;
    desc.max_tan = max_tan;
    result = conemap_build(&desc, &map);
    if (!CHECK(result == CONEMAP_OK, "%s: %s", describe(r), conemap_result_string(result))) return result;
    memcpy(r->cones, map.cones, sizeof(float) * (size_t)(r->width * r->height));
    conemap_free(&map);
    return result;
}

static conemap_result build(struct relief *r, conemap_guarantee guarantee, float slack, float max_tan)
{
    return build_with(r, CONEMAP_EXACT, guarantee, slack, max_tan);
}

static int texel(int i, int size, conemap_wrap wrap)
{
    if (wrap == CONEMAP_WRAP) return (i % size + size) % size;
    return i < 0 ? 0 : i >= size ? size - 1 : i;
}

/* The four values of a plane around cell (i, j). */
static void corners(const struct relief *r, const float *plane, int i, int j, double *c)
{
    int k;
    for (k = 0; k < 4; ++k) {
        c[k] = (double)plane[texel(j + (k >> 1), r->height, r->wrap_v) * r->width +
                             texel(i + (k & 1), r->width, r->wrap_u)];
    }
}

static double mix(const double *c, double x, double y)
{
    return (1.0 - y) * ((1.0 - x) * c[0] + x * c[1]) + y * ((1.0 - x) * c[2] + x * c[3]);
}

static void span(int size, conemap_wrap wrap, int images, int *low, int *high)
{
    *low = wrap == CONEMAP_WRAP ? -images * size : wrap == CONEMAP_CLAMP ? -1 : 0;
    *high = wrap == CONEMAP_WRAP ? (1 + images) * size - 1 : wrap == CONEMAP_CLAMP ? size - 1 : size - 2;
    if (wrap == CONEMAP_NOTHING && size == 1) *low = *high = 0;
}

/* The largest (h(q) - h(p) - d) t(p) / |q - p| over grid points of all cells, and t(p) |gradient| at cell corners: above 1
   is a cone that holds a point of the surface. */
static double worst_ratio(const struct relief *r, double widen)
{
    double a = 1.0 / (double)r->width, b = (double)r->aspect / (double)r->height, worst = 0.0;
    int i0, i1, j0, j1, k0, k1, l0, l1, i, j, k, l, x, y, p, q;
    span(r->width, r->wrap_u, 0, &i0, &i1);
    span(r->height, r->wrap_v, 0, &j0, &j1);
    span(r->width, r->wrap_u, 1, &k0, &k1);
    span(r->height, r->wrap_v, 1, &l0, &l1);
    for (j = j0; j <= j1; ++j) {
        for (i = i0; i <= i1; ++i) {
            double h[4], t[4];
            corners(r, r->heights, i, j, h);
            corners(r, r->cones, i, j, t);
            if (r->per_cell) t[1] = t[2] = t[3] = t[0];
            for (p = 0; p < 4; ++p) {
                double gx = (p & 2 ? h[3] - h[2] : h[1] - h[0]) / a, gy = (p & 1 ? h[3] - h[1] : h[2] - h[0]) / b;
                /* within d of the apex the cone may touch: only gradients that outgrow it count */
                double steep = t[p] * widen * sqrt(gx * gx + gy * gy);
                if (sqrt(gx * gx + gy * gy) * (a < b ? a : b) > 1e-3 && steep > worst) worst = steep;
            }
            for (y = 0; y <= GRID; ++y) {
                for (x = 0; x <= GRID; ++x) {
                    double px = i + (double)x / GRID, py = j + (double)y / GRID;
                    double ph = mix(h, (double)x / GRID, (double)y / GRID);
                    double pt = mix(t, (double)x / GRID, (double)y / GRID) * widen;
                    for (l = l0; l <= l1; ++l) {
                        for (k = k0; k <= k1; ++k) {
                            double g[4];
                            corners(r, r->heights, k, l, g);
                            if (g[0] <= ph && g[1] <= ph && g[2] <= ph && g[3] <= ph) continue;
                            for (q = 0; q < (GRID + 1) * (GRID + 1); ++q) {
                                double qx = (double)(q % (GRID + 1)) / GRID, qy = (double)(q / (GRID + 1)) / GRID;
                                double dx = (k + qx - px) * a, dy = (l + qy - py) * b, d = sqrt(dx * dx + dy * dy);
                                double rise = mix(g, qx, qy) - ph - APEX;
                                if (rise > 0.0 && d > 0.0 && rise * pt > worst * d) worst = rise * pt / d;
                            }
                        }
                    }
                }
            }
        }
    }
    return worst;
}

static void for_zoo(const int (*sizes)[2], int size_count, void (*visit)(struct relief *))
{
    static struct relief r;
    int n, wraps, turn = 0;
    for (n = 0; n < size_count; ++n) {
        for (r.kind = 0; r.kind < ZOO_KINDS; ++r.kind) {
            for (wraps = turn++ % 2; wraps < 9; wraps += 2) {
                r.width = sizes[n][0];
                r.height = sizes[n][1];
                r.wrap_u = (conemap_wrap)(wraps % 3);
                r.wrap_v = (conemap_wrap)(wraps / 3);
                r.aspect = wraps % 2 ? 1.0f : (float)r.height / (float)r.width;
                zoo_fill(r.kind, r.width, r.height, 3, r.heights);
                visit(&r);
            }
        }
    }
}

static const int small_sizes[][2] = {{1, 1}, {1, 7}, {6, 1}, {2, 2}, {3, 5}, {9, 8}};
static int touching, widened_caught, reliefs;

static void visit_safe(struct relief *r)
{
    double worst;
    if (build(r, CONEMAP_GUARANTEE_BILINEAR, 0.0f, 16.0f) != CONEMAP_OK) return;
    worst = worst_ratio(r, 1.0);
    CHECK(worst <= 1.0 + 1e-9, "%s: a cone reaches %.9g of the way", describe(r), worst);
    ++reliefs;
    if (worst > 0.9) ++touching;
    if (worst * 1.01 > 1.0) ++widened_caught;
}

static void interpolated_cones_are_empty(void)
{
    reliefs = touching = widened_caught = 0;
    for_zoo(small_sizes, 6, visit_safe);
    CHECK(touching > reliefs / 2, "only %d of %d maps have a cone that nearly touches", touching, reliefs);
    CHECK(widened_caught > 0, "nothing is caught when cones are widened by 1 %%");
    test_note("safe cones nearly touch in %d of %d maps, 1 %% wider ones cut in %d", touching, reliefs, widened_caught);
}

/* One cone for each cell: as safe, and wider than what its corners would have had to share. */
static void visit_cells(struct relief *r)
{
    static float shared[MOST];
    double worst;
    int k;
    if (build(r, CONEMAP_GUARANTEE_BILINEAR, 0.0f, 16.0f) != CONEMAP_OK) return;
    memcpy(shared, r->cones, sizeof shared);
    r->per_cell = 1;
    if (build(r, CONEMAP_GUARANTEE_BILINEAR, 0.0f, 16.0f) == CONEMAP_OK) {
        worst = worst_ratio(r, 1.0);
        CHECK(worst <= 1.0 + 1e-9, "%s: a cell's cone reaches %.9g of the way", describe(r), worst);
        ++reliefs;
        if (worst * 1.01 > 1.0) ++widened_caught;
        for (k = 0; k < r->width * r->height; ++k) {
            if (!CHECK(r->cones[k] >= shared[k], "%s texel %d: %.9g is narrower than %.9g", describe(r), k,
                       (double)r->cones[k], (double)shared[k]))
                break;
            if (r->cones[k] > shared[k]) ++touching;
        }
    }
    r->per_cell = 0;
}

static void cells_cones_are_empty(void)
{
    reliefs = touching = widened_caught = 0;
    for_zoo(small_sizes, 6, visit_cells);
    CHECK(touching > 1000 && widened_caught > reliefs / 4, "%d wider cones, %d of %d maps tight", touching, widened_caught,
          reliefs);
}

/* The same judge finds what vertex cones do, also after the 3x3 minimum [BV24 eq. 2]. */
static void vertex_cones_are_not_empty(void)
{
    /* A rising edge between two texels can beat both its ends; vertex slope .7, surface .99 */
    static const float edge[4] = {0.0f, 0.7f, 0.7f, 0.99f};
    struct relief r;
    double worst;
    memset(&r, 0, sizeof r);
    r.width = r.height = 2;
    r.aspect = 1.0f;
    memcpy(r.heights, edge, sizeof edge);
    if (build(&r, CONEMAP_GUARANTEE_VERTEX, 0.0f, 16.0f) != CONEMAP_OK) return;
    worst = worst_ratio(&r, 1.0);
    CHECK(worst > 1.35, "the vertex cone reaches only %g", worst);
    if (build(&r, CONEMAP_GUARANTEE_BILINEAR, 0.0f, 16.0f) != CONEMAP_OK) return;
    CHECK(worst_ratio(&r, 1.0) <= 1.0 && r.cones[0] * 2.0f * 0.99f > 0.99f, "bilinear: %g, cone %g", worst_ratio(&r, 1.0),
          (double)r.cones[0]);
}

/* Long texels go through their own branch of the generator. */
static void long_texels(void)
{
    static const float aspects[] = {0.02f, 0.3f, 1.5f, 3.0f, 40.0f};
    static struct relief r;
    int k;
    for (k = 0; k < 5; ++k) {
        for (r.kind = 0; r.kind < ZOO_KINDS; ++r.kind) {
            r.width = 8;
            r.height = 7;
            r.wrap_u = (conemap_wrap)(r.kind % 3);
            r.wrap_v = (conemap_wrap)(r.kind / 3 % 3);
            r.aspect = aspects[k];
            zoo_fill(r.kind, r.width, r.height, 3, r.heights);
            if (build(&r, CONEMAP_GUARANTEE_BILINEAR, 0.0f, 100.0f) != CONEMAP_OK) return;
            CHECK(worst_ratio(&r, 1.0) <= 1.0 + 1e-9, "%s: a cone reaches %.9g of the way", describe(&r),
                  worst_ratio(&r, 1.0));
        }
    }
}

static void visit_slack(struct relief *r)
{
    static const float slacks[] = {0.05f, 0.5f, 2.0f, 16.0f};
    static float exact[MOST];
    int g, k, n = r->width * r->height, e;
    for (g = 0; g < 2; ++g) {
        conemap_guarantee guarantee = g ? CONEMAP_GUARANTEE_BILINEAR : CONEMAP_GUARANTEE_VERTEX;
        if (build(r, guarantee, 0.0f, 16.0f) != CONEMAP_OK) return;
        memcpy(exact, r->cones, sizeof exact);
        for (e = 0; e < 4; ++e) {
            if (build(r, guarantee, slacks[e], 16.0f) != CONEMAP_OK) return;
            for (k = 0; k < n; ++k) {
                if (!(r->cones[k] <= exact[k]) ||
                    !((double)r->cones[k] * (1.0 + (double)slacks[e]) >= (double)exact[k] * (1.0 - 1e-5))) {
                    CHECK(0, "%s guarantee %d slack %g texel %d: %.9g of %.9g", describe(r), (int)guarantee,
                          (double)slacks[e], k, (double)r->cones[k], (double)exact[k]);
                    break;
                }
                if (r->cones[k] < exact[k]) ++touching;
            }
        }
    }
}

static void slack_is_bounded(void)
{
    static const int sizes[][2] = {{3, 5}, {12, 12}, {61, 44}}; /* the last has blocks that stand for their texels */
    touching = 0;
    for_zoo(sizes, 3, visit_slack);
    CHECK(touching > 100, "slack hardly ever narrows a cone (%d)", touching);
}

/* ---- relaxed cones ---- */

static double relaxed_sum, safe_sum;

static void visit_relaxed(struct relief *r)
{
    static float search[MOST];
    int k, n = r->width * r->height;
    if (build_with(r, CONEMAP_RELAXED_EXACT, CONEMAP_GUARANTEE_DEFAULT, 0.0f, 16.0f) != CONEMAP_OK) return;
    memcpy(search, r->cones, sizeof search);
    if (build_with(r, CONEMAP_RELAXED_EXACT_RING, CONEMAP_GUARANTEE_DEFAULT, 0.0f, 16.0f) != CONEMAP_OK) return;
    for (k = 0; k < n; ++k) {
        if (search[k] != r->cones[k]) {
            CHECK(0, "%s texel %d: %.9g, by rings %.9g", describe(r), k, (double)search[k], (double)r->cones[k]);
            break;
        }
    }
    if (build(r, CONEMAP_GUARANTEE_BILINEAR, 0.0f, 16.0f) != CONEMAP_OK) return;
    for (k = 0; k < n; ++k) {
        relaxed_sum += (double)(search[k] < 1.0f ? search[k] : 1.0f);
        safe_sum += (double)(r->cones[k] < 1.0f ? r->cones[k] : 1.0f);
    }
}

static void relaxed_search_is_ring_search(void)
{
    static const int sizes[][2] = {{1, 1}, {1, 7}, {6, 1}, {2, 2}, {3, 5}, {9, 8}, {12, 12}};
    relaxed_sum = safe_sum = 0.0;
    for_zoo(sizes, 7, visit_relaxed);
    CHECK(relaxed_sum > safe_sum, "relaxed cones are narrower: %g of %g", relaxed_sum, safe_sum);
    test_note("mean relaxed cone %.3f of the conservative one", relaxed_sum / safe_sum);
}

/* Height at texel coordinates; below everything beyond a border that does not wrap. */
static double height_at(const struct relief *r, double x, double y)
{
    double c[4], i = floor(x), j = floor(y);
    if (r->wrap_u != CONEMAP_WRAP && (x < -0.5 || x > r->width - 0.5)) return -1.0;
    if (r->wrap_v != CONEMAP_WRAP && (y < -0.5 || y > r->height - 0.5)) return -1.0;
    corners(r, r->heights, (int)i, (int)j, c);
    return mix(c, x - i, y - j);
}

/* How many of `count` random steps of descending rays come out of the solid again before they end. */
static int emerging_steps(const struct relief *r, struct zoo_random *random, int count)
{
    double a = 1.0 / (double)r->width, b = (double)r->aspect / (double)r->height;
    int n, k, emerging = 0;
    for (n = 0; n < count; ++n) {
        double x = (double)zoo_unit(random) * (r->width - 1), y = (double)zoo_unit(random) * (r->height - 1), t[4];
        double angle = (double)zoo_unit(random) * 6.283185307179586, i, j, h, tangent, gap, vz, step, dx, dy;
        int inside = 0;
        if (zoo_below(random, 2)) x = floor(x + 0.5); /* texel centres are the tightest places */
        if (zoo_below(random, 2)) y = floor(y + 0.5);
        if (zoo_below(random, 4) == 0) angle = floor(angle / 1.5707963267948966) * 1.5707963267948966;
        i = floor(x);
        j = floor(y);
        corners(r, r->cones, (int)i, (int)j, t);
        tangent = mix(t, x - i, y - j);
        h = height_at(r, x, y);
        gap = (1.0 - h) * (double)zoo_unit(random);
        vz = -pow(2.0, -12.0 * (double)zoo_unit(random));
        dx = cos(angle);
        dy = sin(angle);
        step = tangent * (gap - APEX) / (1.0 - tangent * vz); /* horizontal speed is 1 */
        for (k = 1; k <= 400 && gap > APEX; ++k) {
            double s = step * k / 400.0, z = h + gap + vz * s;
            double clearance = z - height_at(r, x + dx * s / a, y + dy * s / b);
            if (clearance < -1e-6) inside = 1;
            if (inside && clearance > 1e-6) {
                ++emerging;
                break;
            }
        }
    }
    return emerging;
}

static struct zoo_random emerging_random;
static int emerging_safe, emerging_papers;

static void visit_emerging(struct relief *r)
{
    if (r->width == 1 || r->height == 1) return;
    if (build_with(r, CONEMAP_RELAXED_EXACT, CONEMAP_GUARANTEE_DEFAULT, 0.0f, 16.0f) != CONEMAP_OK) return;
    emerging_safe = emerging_steps(r, &emerging_random, 300);
    CHECK(emerging_safe == 0, "%s: %d steps pass the surface more than once", describe(r), emerging_safe);
    if (build_with(r, CONEMAP_RELAXED, CONEMAP_GUARANTEE_DEFAULT, 0.0f, 16.0f) != CONEMAP_OK) return;
    emerging_papers += emerging_steps(r, &emerging_random, 300);
}

static void relaxed_steps_pass_the_surface_once(void)
{
    static const int sizes[][2] = {{3, 5}, {9, 8}, {12, 12}};
    emerging_random = zoo_seed(77);
    emerging_papers = 0;
    for_zoo(sizes, 3, visit_emerging);
    CHECK(emerging_papers > 0, "the judge finds nothing, not even in the paper's relaxed cones");
    test_note("steps that come out again: papers' relaxed cones %d, ours 0", emerging_papers);
}

/* Where [BV24 Algorithm 2] is 3.2 times too wide: a falling point lies higher than the near corner of its cell. */
static void relaxed_counterexample(void)
{
    static float heights[256 * 256];
    conemap_desc desc;
    conemap_map map;
    float paper, ours;
    int x, y;
    for (y = 0; y < 256; ++y)
        for (x = 0; x < 256; ++x)
            heights[y * 256 + x] = x < 10 ? 0.0f : y > 128 ? 1.0f : x == 10 ? 0.2f : 0.1f;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = 256;
    desc.generator = CONEMAP_RELAXED;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    paper = map.cones[128 * 256];
    conemap_free(&map);
    desc.generator = CONEMAP_RELAXED_EXACT;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    ours = map.cones[128 * 256];
    conemap_free(&map);
    /* the top of row 129 at x = 10 stands 10 texels away, 1 high: the cone must not reach it */
    CHECK(ours <= 10.05f / 256.0f, "our cone is %g", (double)ours);
    CHECK(paper > 2.0f * ours, "the paper's cone is %g, ours %g", (double)paper, (double)ours);
}

/* From the edge between a high and a low texel a spike is seen more steeply than from either of them: only looking down
   at the cells there from the spike, four texels away, narrows their cones. Texels are eight times as long as wide. */
static void relaxed_cells_seen_from_near(void)
{
    static struct relief r;
    double a = 1.0 / 11.0, worst = 0.0;
    int x, y, k;
    memset(&r, 0, sizeof r);
    r.kind = ZOO_FLAT_0;
    r.width = 11;
    r.height = 7;
    r.wrap_u = r.wrap_v = CONEMAP_NOTHING;
    r.aspect = 8.0f * 7.0f / 11.0f;
    for (y = 0; y < 7; ++y)
        for (x = 0; x < 2; ++x) r.heights[y * 11 + x] = (y <= 3 ? 0.66f : 0.2f) + 0.07f * (float)x;
    r.heights[3 * 11 + 4] = 1.0f;
    if (build_with(&r, CONEMAP_RELAXED_EXACT, CONEMAP_GUARANTEE_DEFAULT, 0.0f, 100.0f) != CONEMAP_OK) return;
    for (k = 0; k <= 64; ++k) {
        double h[4], t[4], down = k / 64.0, ratio;
        corners(&r, r.heights, 0, 3, h);
        corners(&r, r.cones, 0, 3, t);
        ratio = (1.0 - mix(h, 0.0, down)) * mix(t, 0.0, down) / (a * sqrt(16.0 + 64.0 * down * down));
        if (ratio > worst) worst = ratio;
    }
    CHECK(worst > 0.9 && worst <= 1.0, "a cone reaches %.9g of the way to the spike", worst);
}

/* ---- the exact tracer on relaxed maps, and any hit ---- */

static conemap_ray random_ray(struct zoo_random *random)
{
    conemap_ray ray;
    int k;
    memset(&ray, 0, sizeof ray);
    for (k = 0; k < 3; ++k) {
        ray.origin[k] = zoo_between(random, k < 2 ? -0.2f : 0.0f, 1.2f);
        ray.direction[k] = zoo_between(random, -1.0f, 1.0f);
    }
    if (zoo_below(random, 8) == 0) ray.direction[2] = 0.0f;
    return ray;
}

/* Rising and level rays must not step by relaxed cones, and say that they did not; all hits are those over safe cones, and
   any hit is one exactly where there is a first one. */
static void relaxed_maps_and_any_hit(void)
{
    static const int kinds[] = {ZOO_FBM, ZOO_SPIKES, ZOO_BRICKS, ZOO_SADDLE};
    static float heights[48 * 40];
    struct zoo_random random = zoo_seed(12);
    int kind, n, fallbacks = 0, hits = 0;
    for (kind = 0; kind < 4; ++kind) {
        conemap_desc desc;
        conemap_map safe, relaxed, vertex;
        zoo_fill(kinds[kind], 48, 40, 2, heights);
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = heights;
        desc.heights.width = 48;
        desc.heights.height = 40;
        REQUIRE(conemap_build(&desc, &safe) == CONEMAP_OK, "build");
        desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
        REQUIRE(conemap_build(&desc, &vertex) == CONEMAP_OK, "build");
        desc.guarantee = CONEMAP_GUARANTEE_DEFAULT;
        desc.generator = CONEMAP_RELAXED_EXACT;
        REQUIRE(conemap_build(&desc, &relaxed) == CONEMAP_OK, "build");
        CHECK(relaxed.info.guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR, "guarantee %d", (int)relaxed.info.guarantee);
        for (n = 0; n < 4000; ++n) {
            const conemap_ray ray = random_ray(&random);
            conemap_trace_desc any;
            conemap_hit a, b, c, d;
            memset(&any, 0, sizeof any);
            any.any_hit = 1;
            CHECK(conemap_trace(&safe, NULL, &ray, &a, 1) == CONEMAP_OK, "trace");
            CHECK(conemap_trace(&relaxed, NULL, &ray, &b, 1) == CONEMAP_OK, "trace");
            CHECK(conemap_trace(&safe, &any, &ray, &c, 1) == CONEMAP_OK, "trace");
            CHECK(conemap_trace(&vertex, &any, &ray, &d, 1) == CONEMAP_OK, "trace");
            CHECK(a.status == b.status && fabsf(a.t - b.t) < 1e-4f, "relaxed: status %d at %g, right %d at %g",
                  (int)b.status, (double)b.t, (int)a.status, (double)a.t);
            CHECK(a.status == c.status, "any hit: status %d, right %d", (int)c.status, (int)a.status);
            CHECK(d.status != CONEMAP_HIT || a.status == CONEMAP_HIT, "any hit where there is none");
            if (b.steps > 0)
                CHECK(!b.fallback == (ray.direction[2] < 0.0f), "fallback %d, direction %g", b.fallback,
                      (double)ray.direction[2]);
            CHECK(!a.fallback && !c.fallback, "a fallback on a safe map");
            fallbacks += b.fallback;
            hits += a.status == CONEMAP_HIT;
        }
        conemap_free(&safe);
        conemap_free(&relaxed);
        conemap_free(&vertex);
    }
    CHECK(fallbacks > 1000 && hits > 1000, "%d fallbacks, %d hits", fallbacks, hits);
}

/* Origins so far away that the entry point is all rounding, and step counts at their ends: defined, and bounded. */
static void far_origins_and_large_counts(void)
{
    static const float heights[4] = {0.0f, 0.5f, 0.5f, 1.0f};
    conemap_desc desc;
    conemap_map map;
    int k, tracer, wraps;
    for (wraps = 0; wraps < 3; ++wraps) {
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = heights;
        desc.heights.width = desc.heights.height = 2;
        desc.wrap_u = desc.wrap_v = (conemap_wrap)wraps;
        desc.keep_pyramid = 1;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        for (k = 0; k < 40; ++k) {
            for (tracer = 1; tracer < CONEMAP_TRACER_COUNT; ++tracer) {
                conemap_ray ray;
                conemap_hit hit;
                conemap_trace_desc trace;
                memset(&ray, 0, sizeof ray);
                memset(&trace, 0, sizeof trace);
                ray.origin[k % 3] = k % 2 ? 1e30f : -3e38f;
                ray.origin[(k + 1) % 3] = ray.origin[(k + 2) % 3] = 0.4f;
                ray.direction[k % 3] = (k % 2 ? -1.0f : 1.0f) * (1.0f + 0.1f * (float)k);
                ray.direction[(k + 1) % 3] = k % 5 ? 0.0f : 1e-9f;
                trace.tracer = (conemap_tracer)tracer;
                trace.max_steps = 1000;
                CHECK(conemap_trace(&map, &trace, &ray, &hit, 1) == CONEMAP_OK, "tracer %d ray %d", tracer, k);
                trace.max_steps = 2147483647;
                CHECK(conemap_trace(&map, &trace, &ray, &hit, 1) == CONEMAP_ERROR_PARAMETER, "tracer %d: too many steps",
                      tracer);
            }
        }
        conemap_free(&map);
    }
}

/* Bands meet at rows 16, 32, ...: cones there must be what they are in the middle of a band. */
static void bands_do_not_show(void)
{
    static float heights[24 * 40], shifted[24 * 40];
    conemap_desc desc;
    conemap_map map, other;
    int x, y;
    zoo_fill(ZOO_FBM, 24, 40, 3, heights);
    for (y = 0; y < 40; ++y) memcpy(shifted + (y + 7) % 40 * 24, heights + y * 24, 24 * sizeof(float));
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = 24;
    desc.heights.height = 40;
    desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    desc.heights.pixels = shifted;
    REQUIRE(conemap_build(&desc, &other) == CONEMAP_OK, "build");
    for (y = 0; y < 40; ++y)
        for (x = 0; x < 24; ++x)
            CHECK(map.cones[y * 24 + x] == other.cones[(y + 7) % 40 * 24 + x], "(%d, %d): %.9g, rolled by 7 rows %.9g",
                  x, y, (double)map.cones[y * 24 + x], (double)other.cones[(y + 7) % 40 * 24 + x]);
    conemap_free(&map);
    conemap_free(&other);
}

const struct test_case safe_tests[] = {
    {"interpolated cones are empty", interpolated_cones_are_empty},
    {"cells' cones are empty", cells_cones_are_empty},
    {"vertex cones are not", vertex_cones_are_not_empty},
    {"long texels", long_texels},
    {"slack is bounded", slack_is_bounded},
    {"bands do not show", bands_do_not_show},
    {"relaxed search is ring search", relaxed_search_is_ring_search},
    {"relaxed steps pass the surface once", relaxed_steps_pass_the_surface_once},
    {"relaxed counterexample", relaxed_counterexample},
    {"relaxed cells seen from near", relaxed_cells_seen_from_near},
    {"relaxed maps and any hit", relaxed_maps_and_any_hit},
    {"far origins and large counts", far_origins_and_large_counts},
    {NULL, NULL},
};
