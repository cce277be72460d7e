/* Cones against brute force: every texel against every other, written from the documented definition. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

#define MAX_TEXELS 4096

static const int sizes[][2] = {{1, 1}, {1, 7}, {2, 2}, {3, 5}, {17, 17}, {31, 64}, {64, 16}, {64, 64}};
#define SIZES ((int)(sizeof sizes / sizeof sizes[0]))

struct subject {
    int width, height, kind;
    conemap_wrap wrap_u, wrap_v;
    float aspect, max_tan;
    const float *heights;
};

static const char *describe(const struct subject *s)
{
    static char text[160];
    static const char *const wraps[] = {"clamp", "wrap", "nothing"};
    snprintf(text, sizeof text, "%s %dx%d %s/%s aspect %g max_tan %g", zoo_name(s->kind), s->width, s->height,
             wraps[s->wrap_u], wraps[s->wrap_v], (double)s->aspect, (double)s->max_tan);
    return text;
}

/* Builds F32 linear cones; fails the test and returns 0 if that does not work. */
static int build(const struct subject *s, conemap_generator generator, int min3x3, float *cones)
{
    conemap_desc desc;
    conemap_map map;
    conemap_result result;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = s->heights;
    desc.heights.width = s->width;
    desc.heights.height = s->height;
    desc.wrap_u = s->wrap_u;
    desc.wrap_v = s->wrap_v;
    desc.aspect = s->aspect;
    desc.max_tan = s->max_tan;
    desc.generator = generator;
    if (generator == CONEMAP_EXACT || generator == CONEMAP_GENERATE_DEFAULT)
        desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
    desc.min3x3 = min3x3;
    result = conemap_build(&desc, &map);
    if (!CHECK(result == CONEMAP_OK, "%s: %s", describe(s), conemap_result_string(result))) return 0;
    memcpy(cones, map.cones, (size_t)s->width * (size_t)s->height * sizeof *cones);
    conemap_free(&map);
    return 1;
}

static int periodic(int k, int size)
{
    return ((k % size) + size) % size;
}

/* The greatest rounded quotient over all vertices, for every texel. */
static void brute_quotients(const struct subject *s, float *quotients)
{
    const int w = s->width, h = s->height, wrap_u = s->wrap_u == CONEMAP_WRAP,
              wrap_v = s->wrap_v == CONEMAP_WRAP;
    const float su = 1.0f / (float)w, sv = s->aspect / (float)h;
    int i, j, di, dj;
    for (j = 0; j < h; ++j) {
        for (i = 0; i < w; ++i) {
            const float own = s->heights[j * w + i];
            float most = 0.0f;
            const int i0 = wrap_u ? -(w / 2) : -i, i1 = wrap_u ? w / 2 : w - 1 - i;
            const int j0 = wrap_v ? -(h / 2) : -j, j1 = wrap_v ? h / 2 : h - 1 - j;
            for (dj = j0; dj <= j1; ++dj) {
                const float *row = s->heights + (size_t)periodic(j + dj, h) * (size_t)w;
                const float y = (float)dj * sv, y2 = y * y;
                for (di = i0; di <= i1; ++di) {
                    int k = i + di;
                    float dh, x, d2, q;
                    if (k < 0) k += w;
                    if (k >= w) k -= w;
                    dh = row[k] - own;
                    if (!(dh > 0.0f)) continue;
                    x = (float)di * su;
                    d2 = x * x + y2;
                    q = (dh * dh) / d2;
                    if (q > most) most = q;
                }
            }
            quotients[j * w + i] = most;
        }
    }
}

/* [BV24] Algorithm 2, mended: cells in the apex's row or column count on both sides, missing cells fall,
   and a wrapping axis brings every image within one period, each in its own quadrant. */
static void brute_relaxed_quotients(const struct subject *s, float *quotients)
{
    const int w = s->width, h = s->height, wrap_u = s->wrap_u == CONEMAP_WRAP,
              wrap_v = s->wrap_v == CONEMAP_WRAP;
    const float su = 1.0f / (float)w, sv = s->aspect / (float)h;
    int i, j, di, dj, sx, sy;
    for (j = 0; j < h; ++j) {
        for (i = 0; i < w; ++i) {
            const float own = s->heights[j * w + i];
            float most = 0.0f;
            const int i0 = wrap_u ? 1 - w : -i, i1 = wrap_u ? w - 1 : w - 1 - i;
            const int j0 = wrap_v ? 1 - h : -j, j1 = wrap_v ? h - 1 : h - 1 - j;
            for (dj = j0; dj <= j1; ++dj) {
                for (di = i0; di <= i1; ++di) {
                    const int k = periodic(i + di, w), l = periodic(j + dj, h);
                    const float h00 = s->heights[l * w + k], dh = h00 - own;
                    int limits = 0;
                    if (!(dh > 0.0f)) continue;
                    for (sy = -1; sy <= 1; sy += 2) {
                        for (sx = -1; sx <= 1; sx += 2) {
                            int p = k + sx, q = l + sy;
                            if (sx * di < 0 || sy * dj < 0) continue; /* not the apex's side */
                            if ((!wrap_u && (p < 0 || p >= w)) || (!wrap_v && (q < 0 || q >= h))) {
                                limits = 1;
                            } else {
                                float h10, h01, h11;
                                p = periodic(p, w);
                                q = periodic(q, h);
                                h10 = s->heights[l * w + p];
                                h01 = s->heights[q * w + k];
                                h11 = s->heights[q * w + p];
                                if (h00 > h10 || h00 > h01 || h10 > h11 || h01 > h11) limits = 1;
                            }
                        }
                    }
                    if (limits) {
                        const float x = (float)di * su, y = (float)dj * sv;
                        const float q = (dh * dh) / (x * x + y * y);
                        if (q > most) most = q;
                    }
                }
            }
            quotients[j * w + i] = most;
        }
    }
}

static float cone_of_quotient(float quotient, float max_tan)
{
    const float least = 1.0f / (max_tan * max_tan) * (1.0f - 1.0f / 262144.0f), s = quotient > least ? quotient : least;
    const float tangent = (1.0f / sqrtf(s)) * (1.0f - 1.0f / 1048576.0f);
    return tangent < max_tan ? tangent : max_tan;
}

static void check_equal(const struct subject *s, const char *what, const float *quotients, const float *cones)
{
    int k, count = s->width * s->height;
    for (k = 0; k < count; ++k) {
        float right = cone_of_quotient(quotients[k], s->max_tan);
        if (right != cones[k]) {
            CHECK(0, "%s: %s at (%d, %d) is %.9g, right %.9g", describe(s), what, k % s->width, k / s->width,
                  (double)cones[k], (double)right);
            return;
        }
    }
}

static void check_at_most(const struct subject *s, const char *what, const float *cones, const float *limit)
{
    int k, count = s->width * s->height;
    for (k = 0; k < count; ++k) {
        if (!(cones[k] >= 0.0f && cones[k] <= limit[k])) {
            CHECK(0, "%s: %s at (%d, %d) is %.9g, at most %.9g", describe(s), what, k % s->width,
                  k / s->width, (double)cones[k], (double)limit[k]);
            return;
        }
    }
}

static double mean(const struct subject *s, const float *cones)
{
    int k, count = s->width * s->height;
    double sum = 0.0;
    for (k = 0; k < count; ++k) sum += cones[k] < 1.0f ? (double)cones[k] : 1.0;
    return sum / count;
}

/* Does any cone hold a vertex? Everything in double, so that no rounding of the definition hides it. */
static void check_empty(const struct subject *s, const float *cones)
{
    const int w = s->width, h = s->height, wrap_u = s->wrap_u == CONEMAP_WRAP,
              wrap_v = s->wrap_v == CONEMAP_WRAP;
    int i, j, di, dj;
    for (j = 0; j < h; ++j) {
        for (i = 0; i < w; ++i) {
            const double own = (double)s->heights[j * w + i], tangent = (double)cones[j * w + i];
            const int i0 = wrap_u ? -w : -i, i1 = wrap_u ? w : w - 1 - i;
            const int j0 = wrap_v ? -h : -j, j1 = wrap_v ? h : h - 1 - j;
            for (dj = j0; dj <= j1; ++dj) {
                for (di = i0; di <= i1; ++di) {
                    const double dh = (double)s->heights[periodic(j + dj, h) * w + periodic(i + di, w)] - own;
                    const double x = (double)di / w, y = (double)dj * (double)s->aspect / h;
                    if (dh > 0.0 && tangent * dh * (tangent * dh) > x * x + y * y) {
                        CHECK(0, "%s: the cone of (%d, %d) holds (%d, %d)", describe(s), i, j, i + di,
                              j + dj);
                        return;
                    }
                }
            }
        }
    }
}

/* Calls visit for the whole zoo; the largest size comes with two wraps and one setting only. */
static void for_zoo(int largest, void (*visit)(const struct subject *))
{
    static float heights[MAX_TEXELS];
    struct subject s;
    int size, u, v, setting;
    s.heights = heights;
    for (s.kind = 0; s.kind < ZOO_KINDS; ++s.kind) {
        for (size = 0; size < SIZES && sizes[size][0] * sizes[size][1] <= largest; ++size) {
            const int big = sizes[size][0] * sizes[size][1] > 2048;
            s.width = sizes[size][0];
            s.height = sizes[size][1];
            zoo_fill(s.kind, s.width, s.height, 3, heights);
            for (u = 0; u < 3; ++u) {
                for (v = 0; v < 3; ++v) {
                    if (big && (u != v || u == 2)) continue;
                    s.wrap_u = (conemap_wrap)u;
                    s.wrap_v = (conemap_wrap)v;
                    for (setting = 0; setting < 2; ++setting) {
                        if (big && setting) continue;
                        s.aspect = setting ? (float)s.height / (float)s.width * 0.7f : 1.0f;
                        s.max_tan = (setting ^ ((u + v) & 1)) ? 100.0f : 1.0f;
                        visit(&s);
                    }
                }
            }
        }
    }
}

static void visit_ring(const struct subject *s)
{
    static float quotients[MAX_TEXELS], cones[MAX_TEXELS];
    brute_quotients(s, quotients);
    if (build(s, CONEMAP_RING, 0, cones)) check_equal(s, "ring", quotients, cones);
    if (build(s, CONEMAP_EXACT, 0, cones)) check_equal(s, "exact", quotients, cones);
}

static void ring_is_brute_force(void)
{
    for_zoo(MAX_TEXELS, visit_ring);
}

/* Larger maps, where the two searches check each other: more levels, and blocks cut off at any place. */
static void exact_is_ring(void)
{
    static const int shapes[][2] = {{97, 70}, {257, 3}, {1, 300}, {65, 96}};
    static float heights[97 * 96], ring[97 * 96], exact[97 * 96];
    struct subject s;
    int shape, k;
    s.heights = heights;
    s.aspect = 0.8f;
    for (shape = 0; shape < 4; ++shape) {
        s.width = shapes[shape][0];
        s.height = shapes[shape][1];
        for (s.kind = 0; s.kind < ZOO_KINDS; ++s.kind) {
            s.wrap_u = s.kind & 1 ? CONEMAP_WRAP : CONEMAP_CLAMP;
            s.wrap_v = s.kind & 2 ? CONEMAP_WRAP : CONEMAP_NOTHING;
            s.max_tan = shape == 0 ? 1.0f : 3.0f;
            zoo_fill(s.kind, s.width, s.height, 3, heights);
            if (!build(&s, CONEMAP_RING, 0, ring) || !build(&s, CONEMAP_EXACT, 0, exact)) return;
            for (k = 0; k < s.width * s.height && exact[k] == ring[k]; ++k) {
            }
            CHECK(k == s.width * s.height, "%s: (%d, %d) is %.9g, by ring search %.9g", describe(&s),
                  k % s.width, k / s.width, (double)exact[k], (double)ring[k]);
        }
    }
}

static void visit_empty(const struct subject *s)
{
    static float cones[MAX_TEXELS];
    if (build(s, CONEMAP_RING, 0, cones)) check_empty(s, cones);
}

static void ring_cones_are_empty(void)
{
    for_zoo(1024, visit_empty);
}

static double naive_sum, quick_sum, ring_sum;

static void visit_conservative(const struct subject *s)
{
    static float ring[MAX_TEXELS], naive[MAX_TEXELS], quick[MAX_TEXELS], fallback[MAX_TEXELS];
    if (!build(s, CONEMAP_RING, 0, ring) || !build(s, CONEMAP_QUICK_NAIVE, 0, naive) ||
        !build(s, CONEMAP_QUICK, 0, quick) || !build(s, CONEMAP_GENERATE_DEFAULT, 0, fallback)) {
        return;
    }
    check_at_most(s, "quick naive", naive, ring);
    check_at_most(s, "quick", quick, ring);
    CHECK(mean(s, naive) <= mean(s, quick) * (1.0 + 1e-6), "%s: naive %g is wider than quick %g", describe(s),
          mean(s, naive), mean(s, quick));
    CHECK(!memcmp(ring, fallback, sizeof(float) * (size_t)(s->width * s->height)), "%s: exact is the default",
          describe(s));
    if (s->width * s->height > 200) {
        naive_sum += mean(s, naive);
        quick_sum += mean(s, quick);
        ring_sum += mean(s, ring);
    }
}

static void quick_is_conservative(void)
{
    naive_sum = quick_sum = ring_sum = 0.0;
    for_zoo(MAX_TEXELS, visit_conservative);
    CHECK(naive_sum > 0.05 * ring_sum && naive_sum < 0.95 * quick_sum && quick_sum > 0.4 * ring_sum,
          "mean cones: naive %.3f, quick %.3f of ring", naive_sum / ring_sum, quick_sum / ring_sum);
    test_note("mean cones naive %.2f, quick %.2f of ring", naive_sum / ring_sum, quick_sum / ring_sum);
}

/* One vertex alone decides every cone, wherever it is: the distance to a block must never be too long. */
static void quick_distances(void)
{
    static const int shapes[][2] = {{16, 16}, {13, 11}, {5, 20}};
    static float heights[256], quotients[256], naive[256], quick[256];
    struct subject s;
    int shape, spot, k, u;
    s.kind = ZOO_IMPULSE;
    s.aspect = 1.0f;
    s.max_tan = 100.0f;
    s.heights = heights;
    for (shape = 0; shape < 3; ++shape) {
        s.width = shapes[shape][0];
        s.height = shapes[shape][1];
        for (u = 0; u < 4; ++u) {
            s.wrap_u = u & 1 ? CONEMAP_WRAP : CONEMAP_CLAMP;
            s.wrap_v = u & 2 ? CONEMAP_WRAP : CONEMAP_NOTHING;
            for (spot = 0; spot < s.width * s.height; ++spot) {
                for (k = 0; k < s.width * s.height; ++k) heights[k] = k == spot ? 1.0f : 0.0f;
                brute_quotients(&s, quotients);
                for (k = 0; k < s.width * s.height; ++k)
                    quotients[k] = cone_of_quotient(quotients[k], 100.0f);
                if (!build(&s, CONEMAP_QUICK, 0, quick) || !build(&s, CONEMAP_QUICK_NAIVE, 0, naive)) return;
                check_at_most(&s, "quick", quick, quotients);
                check_at_most(&s, "quick naive", naive, quotients);
            }
        }
    }
}

/* Every 3 x 3 map of three levels. */
static void every_small_map(void)
{
    static const float levels[3] = {0.0f, 0.4f, 1.0f};
    int code, wrap, k, digits;
    for (wrap = 0; wrap < 2; ++wrap) {
        for (code = 0; code < 19683; ++code) {
            float heights[9], quotients[9], ring[9], exact[9], quick[9];
            struct subject s = {3, 3, ZOO_WHITE, CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 100.0f, NULL};
            for (k = 0, digits = code; k < 9; ++k, digits /= 3) heights[k] = levels[digits % 3];
            s.heights = heights;
            s.wrap_u = s.wrap_v = wrap ? CONEMAP_WRAP : CONEMAP_CLAMP;
            brute_quotients(&s, quotients);
            if (!build(&s, CONEMAP_RING, 0, ring) || !build(&s, CONEMAP_EXACT, 0, exact) ||
                !build(&s, CONEMAP_QUICK, 0, quick)) {
                return;
            }
            check_equal(&s, "ring", quotients, ring);
            check_equal(&s, "exact", quotients, exact);
            check_at_most(&s, "quick", quick, ring);
        }
    }
}

static const conemap_generator generators[] = {
    CONEMAP_EXACT,
    CONEMAP_RING,
    CONEMAP_QUICK_NAIVE,
    CONEMAP_QUICK,
    CONEMAP_QUICK_NAIVE_CENTER,
    CONEMAP_QUICK_CENTER,
    CONEMAP_RELAXED_SAMPLED,
    CONEMAP_RELAXED,
    CONEMAP_HYBRID,
};
#define GENERATORS ((int)(sizeof generators / sizeof generators[0]))

static void visit_min3x3(const struct subject *s)
{
    static float plain[MAX_TEXELS], narrow[MAX_TEXELS];
    const int w = s->width, h = s->height;
    int g, i, j, di, dj;
    for (g = 0; g < GENERATORS; ++g) {
        if (generators[g] == CONEMAP_RELAXED_SAMPLED && w * h > 64) continue;
        if (!build(s, generators[g], 0, plain) || !build(s, generators[g], 1, narrow)) return;
        for (j = 0; j < h; ++j) {
            for (i = 0; i < w; ++i) {
                float least = plain[j * w + i];
                for (dj = -1; dj <= 1; ++dj) {
                    for (di = -1; di <= 1; ++di) {
                        int p = i + di, q = j + dj;
                        if (s->wrap_u == CONEMAP_WRAP) p = periodic(p, w);
                        if (s->wrap_v == CONEMAP_WRAP) q = periodic(q, h);
                        if (p < 0 || p >= w || q < 0 || q >= h) continue;
                        if (plain[q * w + p] < least) least = plain[q * w + p];
                    }
                }
                if (narrow[j * w + i] != least) {
                    CHECK(0, "%s, generator %d: (%d, %d) is %g, right %g", describe(s), (int)generators[g], i,
                          j, (double)narrow[j * w + i], (double)least);
                    return;
                }
            }
        }
    }
}

static void min3x3_is_a_minimum(void)
{
    for_zoo(300, visit_min3x3);
}

static void visit_relaxed(const struct subject *s)
{
    static float quotients[MAX_TEXELS], relaxed[MAX_TEXELS], ring[MAX_TEXELS], hybrid[MAX_TEXELS];
    brute_relaxed_quotients(s, quotients);
    if (!build(s, CONEMAP_RELAXED, 0, relaxed) || !build(s, CONEMAP_RING, 0, ring) ||
        !build(s, CONEMAP_HYBRID, 0, hybrid)) {
        return;
    }
    check_equal(s, "relaxed", quotients, relaxed);
    check_at_most(s, "ring against relaxed", ring, relaxed);
    check_at_most(s, "ring against hybrid", ring, hybrid);
    check_at_most(s, "hybrid against relaxed", hybrid, relaxed);
}

static void relaxed_is_brute_force(void)
{
    for_zoo(1024, visit_relaxed);
}

static void relaxed_borders(void)
{
    static float heights[32 * 32], cones[32 * 32];
    struct subject s = {32, 32, ZOO_BORDER_SPIKE, CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 1.0f, NULL};
    int side;
    s.heights = heights;
    for (side = 0; side < 4; ++side) {
        const int i = side == 0 ? 0 : side == 1 ? 31 : 16, j = side == 2 ? 0 : side == 3 ? 31 : 16;
        const int ni = i == 0 ? 1 : i == 31 ? 30 : i, nj = j == 0 ? 1 : j == 31 ? 30 : j;
        memset(heights, 0, sizeof heights);
        heights[j * 32 + i] = 1.0f;
        if (!build(&s, CONEMAP_RELAXED, 0, cones)) return;
        CHECK(cones[nj * 32 + ni] < 0.0313f && cones[nj * 32 + ni] > 0.0312f,
              "beside a spike on border %d: %g, right 0.03125", side, (double)cones[nj * 32 + ni]);
    }
    /* a ridge that goes on along the apex's own row, falling on one side of it only: both sides count */
    memset(heights, 0, sizeof heights);
    for (side = 0; side < 32 * 32; ++side) {
        const int x = side % 32, y = side / 32;
        heights[side] = x < 10 ? 0.0f : y <= 16 ? 0.5f : (x == 10 ? 0.5f : 0.0f);
    }
    if (!build(&s, CONEMAP_RELAXED, 0, cones)) return;
    CHECK(cones[16 * 32] < 10.0f / 32.0f / 0.5f, "a fall on one side of the row: %g", (double)cones[16 * 32]);
}

/* A pit in a plateau that wraps: nothing falls on the near way to the plateau, so the way round decides. */
static void relaxed_images(void)
{
    static float heights[13 * 7], quotients[13 * 7], cones[13 * 7];
    struct subject s = {13, 7, ZOO_FLAT_1, CONEMAP_WRAP, CONEMAP_WRAP, 1.0f, 100.0f, NULL};
    int along, at, k;
    s.heights = heights;
    for (along = 0; along < 2; ++along) {
        for (at = 0; at < (along ? 7 : 13); ++at) {
            for (k = 0; k < 13 * 7; ++k) { /* a trench of three texels, so that nothing falls to its sides */
                const int size = along ? 7 : 13, from = periodic((along ? k / 13 : k % 13) - at, size);
                heights[k] = from < 3 ? 0.0f : 1.0f;
            }
            brute_relaxed_quotients(&s, quotients);
            if (!build(&s, CONEMAP_RELAXED, 0, cones)) return;
            check_equal(&s, along ? "across v" : "across u", quotients, cones);
        }
    }
}

static void hybrid_weights(void)
{
    static float heights[31 * 17];
    const float weights[3] = {1e-6f, 0.25f, 1.0f};
    conemap_desc desc;
    conemap_map ring, relaxed, hybrid;
    int weight, k;
    zoo_fill(ZOO_FBM, 31, 17, 8, heights);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = 31;
    desc.heights.height = 17;
    desc.max_tan = 8.0f;
    desc.generator = CONEMAP_RING;
    REQUIRE(conemap_build(&desc, &ring) == CONEMAP_OK, "ring");
    desc.generator = CONEMAP_RELAXED;
    if (CHECK(conemap_build(&desc, &relaxed) == CONEMAP_OK, "relaxed")) {
        desc.generator = CONEMAP_HYBRID;
        for (weight = 0; weight < 3; ++weight) {
            desc.hybrid_weight = weights[weight];
            if (!CHECK(conemap_build(&desc, &hybrid) == CONEMAP_OK, "hybrid")) break;
            for (k = 0; k < 31 * 17; ++k) {
                const double a = (double)ring.cones[k], b = (double)relaxed.cones[k];
                const double right = a + (b - a) * (double)weights[weight];
                if (!(fabs((double)hybrid.cones[k] - right) <= 4e-6 * right)) {
                    CHECK(0, "weight %g at %d: %g between %g and %g", (double)weights[weight], k,
                          (double)hybrid.cones[k], a, b);
                    break;
                }
            }
            conemap_free(&hybrid);
        }
        conemap_free(&relaxed);
    }
    conemap_free(&ring);
}

/* What is said to be unsafe must show as unsafe, or the checks above could not fail. */
static void heuristics_are_unsafe(void)
{
    static float heights[31 * 64], ring[31 * 64], cones[31 * 64];
    static const conemap_generator unsafe[2] = {CONEMAP_QUICK_NAIVE_CENTER, CONEMAP_QUICK_CENTER};
    struct subject s = {31, 64, 0, CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 1.0f, NULL};
    int g, k, wider[2] = {0, 0}, texels = 0;
    s.heights = heights;
    for (s.kind = 0; s.kind < ZOO_KINDS; ++s.kind) {
        zoo_fill(s.kind, s.width, s.height, 3, heights);
        if (!build(&s, CONEMAP_RING, 0, ring)) return;
        for (g = 0; g < 2; ++g) {
            if (!build(&s, unsafe[g], 0, cones)) return;
            for (k = 0; k < 31 * 64; ++k) wider[g] += cones[k] > ring[k];
        }
        texels += 31 * 64;
    }
    CHECK(wider[0] > 0 && wider[1] > 0, "of %d texels %d and %d are too wide", texels, wider[0], wider[1]);
    test_note("centre heuristics too wide %d and %d of %d", wider[0], wider[1], texels);
}

static void sampled_relaxed_is_unsafe(void)
{
    static float heights[17 * 17], ring[17 * 17], relaxed[17 * 17], sampled[17 * 17];
    struct subject s = {17, 17, 0, CONEMAP_CLAMP, CONEMAP_CLAMP, 1.0f, 1.0f, NULL};
    int k, wider = 0, narrower = 0, texels = 0;
    s.heights = heights;
    for (s.kind = 0; s.kind < ZOO_KINDS; ++s.kind) {
        zoo_fill(s.kind, s.width, s.height, 3, heights);
        if (!build(&s, CONEMAP_RING, 0, ring) || !build(&s, CONEMAP_RELAXED, 0, relaxed) ||
            !build(&s, CONEMAP_RELAXED_SAMPLED, 0, sampled)) {
            return;
        }
        for (k = 0; k < 17 * 17; ++k) {
            wider += sampled[k] > relaxed[k];
            narrower += sampled[k] < ring[k] * 0.99f;
        }
        texels += 17 * 17;
    }
    CHECK(wider > 0, "no sampled relaxed cone is wider than the exact one");
    CHECK(narrower < texels / 10, "%d of %d sampled relaxed cones are narrower than conservative ones",
          narrower, texels);
    test_note("sampled relaxed wider than relaxed %d, narrower than ring %d of %d", wider, narrower, texels);
}

/* A limit of the search leaves out far vertices only, and drops the guarantee. */
static void ring_limits(void)
{
    static float heights[31 * 17];
    conemap_desc desc;
    conemap_map map, whole;
    int k, limit, wider = 0;
    zoo_fill(ZOO_FBM, 31, 17, 8, heights);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = 31;
    desc.heights.height = 17;
    desc.generator = CONEMAP_RING;
    REQUIRE(conemap_build(&desc, &whole) == CONEMAP_OK, "whole");
    CHECK(whole.info.guarantee == CONEMAP_GUARANTEE_VERTEX, "ring promises its vertices");
    for (limit = 1; limit <= 31; limit += 5) {
        desc.ring_limit = limit;
        if (!CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "limit %d", limit)) break;
        CHECK(limit >= 30 || map.info.guarantee == CONEMAP_GUARANTEE_NONE, "limit %d keeps the guarantee",
              limit);
        for (k = 0; k < 31 * 17; ++k) {
            float most = 0.0f;
            int i, j;
            wider += map.cones[k] > whole.cones[k];
            for (j = 0; j < 17; ++j) {
                for (i = 0; i < 31; ++i) {
                    const int di = i - k % 31, dj = j - k / 31;
                    const float dh = heights[j * 31 + i] - heights[k];
                    const float x = (float)di * (1.0f / 31.0f), y = (float)dj * (1.0f / 17.0f);
                    if (abs(di) > limit || abs(dj) > limit || !(dh > 0.0f)) continue;
                    if (dh * dh / (x * x + y * y) > most) most = dh * dh / (x * x + y * y);
                }
            }
            if (map.cones[k] != cone_of_quotient(most, 1.0f)) {
                CHECK(0, "limit %d at %d: %.9g, right %.9g", limit, k, (double)map.cones[k],
                      (double)cone_of_quotient(most, 1.0f));
                break;
            }
        }
        conemap_free(&map);
    }
    CHECK(wider > 0, "a limit changes nothing");
    conemap_free(&whole);
}

static void guarantees(void)
{
    static const float heights[6] = {0.0f, 0.5f, 1.0f, 0.25f, 0.75f, 0.1f};
    int g;
    for (g = 0; g < GENERATORS; ++g) {
        conemap_desc desc;
        conemap_map map;
        conemap_guarantee right = CONEMAP_GUARANTEE_NONE;
        const conemap_generator generator = generators[g];
        if (generator == CONEMAP_EXACT || generator == CONEMAP_RING || generator == CONEMAP_QUICK ||
            generator == CONEMAP_QUICK_NAIVE) {
            right = CONEMAP_GUARANTEE_VERTEX;
        }
        if (generator == CONEMAP_RELAXED || generator == CONEMAP_HYBRID) right = CONEMAP_GUARANTEE_RELAXED;
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = heights;
        desc.heights.width = 3;
        desc.heights.height = 2;
        desc.generator = generator;
        desc.wrap_v = CONEMAP_WRAP;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "generator %d", (int)generator);
        if (generator == CONEMAP_EXACT) right = CONEMAP_GUARANTEE_BILINEAR;
        CHECK(map.info.guarantee == right, "generator %d promises %d", (int)generator,
              (int)map.info.guarantee);
        CHECK(map.info.generator == generator && map.info.width == 3 && map.info.height == 2 &&
                  map.info.wrap_u == CONEMAP_CLAMP && map.info.wrap_v == CONEMAP_WRAP &&
                  map.info.aspect == 1.0f && map.info.max_tan == 1.0f && !map.info.min3x3,
              "generator %d: the info", (int)generator);
        CHECK(!memcmp(map.heights, heights, sizeof heights), "generator %d: the heights", (int)generator);
        conemap_free(&map);
    }
}

const struct test_case oracle_tests[] = {
    {"ring search and exact are brute force to the bit", ring_is_brute_force},
    {"exact is ring search on larger maps", exact_is_ring},
    {"ring cones hold no vertex", ring_cones_are_empty},
    {"quick cones are never wider than ring cones", quick_is_conservative},
    {"quick distances, one vertex at a time", quick_distances},
    {"every 3 x 3 map of three levels", every_small_map},
    {"min3x3 is the minimum of 3 x 3", min3x3_is_a_minimum},
    {"relaxed is brute force to the bit", relaxed_is_brute_force},
    {"relaxed at borders and along rows", relaxed_borders},
    {"relaxed around a wrapping map", relaxed_images},
    {"hybrid weights", hybrid_weights},
    {"texel-centre heuristics are unsafe", heuristics_are_unsafe},
    {"sampled relaxed cones are unsafe", sampled_relaxed_is_unsafe},
    {"ring limit", ring_limits},
    {"guarantees and info", guarantees},
    {NULL, NULL},
};
