/* Directional cones: sectors against a ring search written here, the verifier's word on the bilinear ones, rays, storage,
   updates and bad input. */
#include <math.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

#define MOST (48 * 40)

static float heights[MOST];

static conemap_desc make_desc(int kind, int w, int h, int wraps, float aspect, int sectors)
{
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    zoo_fill(kind, w, h, 3, heights);
    desc.heights.pixels = heights;
    desc.heights.width = w;
    desc.heights.height = h;
    desc.wrap_u = (conemap_wrap)(wraps % 3);
    desc.wrap_v = (conemap_wrap)(wraps / 3 % 3);
    desc.aspect = aspect;
    desc.texture.sectors = sectors;
    return desc;
}

static const char *describe(const conemap_desc *desc)
{
    static char text[160];
    snprintf(text, sizeof text, "%d sectors %dx%d wraps %d %d aspect %g max_tan %g format %d encoding %d per_cell %d",
             desc->texture.sectors, desc->heights.width, desc->heights.height, (int)desc->wrap_u, (int)desc->wrap_v,
             (double)desc->aspect, (double)desc->max_tan, (int)desc->texture.format, (int)desc->texture.encoding,
             desc->texture.per_cell);
    return text;
}

/* ---- which direction is in which sector ---- */

static void sectors_of_directions(void)
{
    static const struct {
        float du, dv;
        int four, eight; /* on a map twice as wide as high, in texels */
    } cases[] = {
        {1, 0.5f, 0, 0},     {1, 3, 0, 4},     {-1, 0.5f, 1, 1},    {-1, 3, 1, 5},    {1, -0.5f, 2, 2},  {1, -3, 2, 6},
        {-1, -0.5f, 3, 3},   {-1, -3, 3, 7},   {1, 1.9f, 0, 0},     {1, 2.1f, 0, 4},  {1, 0, 0, 0},      {0, 1, 0, 4},
        {-1, 0, 1, 1},       {0, -1, 2, 6},    {1e-30f, 3e-30f, 0, 4}, {-1e30f, 3e30f, 1, 5},
    };
    conemap_info info;
    int k;
    memset(&info, 0, sizeof info);
    info.width = 64;
    info.height = 32;
    for (k = 0; k < (int)(sizeof cases / sizeof cases[0]); ++k) {
        info.texture.sectors = 4;
        CHECK(conemap_sector(&info, cases[k].du, cases[k].dv) == cases[k].four, "case %d of 4: %d", k,
              conemap_sector(&info, cases[k].du, cases[k].dv));
        info.texture.sectors = 8;
        CHECK(conemap_sector(&info, cases[k].du, cases[k].dv) == cases[k].eight, "case %d of 8: %d", k,
              conemap_sector(&info, cases[k].du, cases[k].dv));
        info.texture.sectors = 0;
        CHECK(conemap_sector(&info, cases[k].du, cases[k].dv) == 0, "case %d of 0", k);
    }
    CHECK(conemap_sector(NULL, 1.0f, 1.0f) == 0, "null");
}

/* Is an offset of whole texels in the closed sector? */
static int in_sector(int sectors, int number, int di, int dj)
{
    int x = number & 1 ? -di : di, y = number & 2 ? -dj : dj;
    if (x < 0 || y < 0) return 0;
    return sectors == 4 || (number & 4 ? y >= x : x >= y);
}

/* ---- vertex cones: every pair of texels, every image that can matter, in rings of nothing cleverer than loops ---- */

static float ring(const conemap_desc *desc, int number, int i, int j)
{
    int w = desc->heights.width, h = desc->heights.height, k, l, a, b, most = w > h ? w : h;
    int images_u = desc->wrap_u == CONEMAP_WRAP ? 2 + most / w + 1 : 0;
    int images_v = desc->wrap_v == CONEMAP_WRAP ? 2 + most / h + 1 : 0;
    float texel_u = 1.0f / (float)w, texel_v = desc->aspect / (float)h, tangent;
    float s = 1.0f / (desc->max_tan * desc->max_tan) * (1.0f - 1.0f / 262144.0f);
    for (b = -images_v; b <= images_v; ++b)
        for (a = -images_u; a <= images_u; ++a)
            for (l = 0; l < h; ++l)
                for (k = 0; k < w; ++k) {
                    int di = k + a * w - i, dj = l + b * h - j;
                    float rise = heights[l * w + k] - heights[j * w + i], x = (float)di * texel_u, y = (float)dj * texel_v;
                    float slope2;
                    if (!(rise > 0.0f) || !in_sector(desc->texture.sectors, number, di, dj)) continue;
                    slope2 = rise * rise / (x * x + y * y);
                    if (slope2 > s) s = slope2;
                }
    tangent = 1.0f / sqrtf(s) * 0.99999904632568359375f;
    return tangent < desc->max_tan ? tangent : desc->max_tan;
}

static void vertex_cones_equal_rings(void)
{
    static const int sizes[][2] = {{1, 1}, {1, 7}, {6, 1}, {2, 2}, {3, 5}, {9, 8}, {2, 11}};
    static const float aspects[] = {1.0f, 0.3f, 3.0f};
    int n, kind, k, turn = 0, wider = 0;
    for (n = 0; n < 7; ++n)
        for (kind = 0; kind < ZOO_KINDS; ++kind) {
            int w = sizes[n][0], h = sizes[n][1], count = w * h, sectors = turn % 2 ? 4 : 8, s;
            conemap_desc desc = make_desc(kind, w, h, turn * 4 + n, aspects[turn % 3], sectors);
            conemap_map map, plain;
            desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
            desc.max_tan = turn % 5 ? 16.0f : 1.0f;
            ++turn;
            REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "%s", describe(&desc));
            desc.texture.sectors = 0;
            REQUIRE(conemap_build(&desc, &plain) == CONEMAP_OK, "%s", describe(&desc));
            desc.texture.sectors = sectors;
            for (k = 0; k < count; ++k) {
                float narrowest = map.cones[k];
                for (s = 0; s < sectors; ++s) {
                    float cone = map.cones[s * count + k], right = ring(&desc, s, k % w, k / w);
                    if (cone < narrowest) narrowest = cone;
                    if (cone > plain.cones[k]) ++wider;
                    if (!CHECK(cone == right, "%s %s sector %d texel %d: %.9g, by rings %.9g", zoo_name(kind),
                               describe(&desc), s, k, (double)cone, (double)right))
                        break;
                }
                if (!CHECK(narrowest == plain.cones[k], "%s %s texel %d: narrowest %.9g, of all directions %.9g",
                           zoo_name(kind), describe(&desc), k, (double)narrowest, (double)plain.cones[k]))
                    break;
            }
            conemap_free(&map);
            conemap_free(&plain);
        }
    CHECK(wider > 1000, "only %d cones are wider than those for all directions", wider);
}

/* The correction of each plane by itself. */
static void corrected_planes(void)
{
    conemap_desc desc = make_desc(ZOO_FBM, 13, 11, 5, 1.0f, 8);
    conemap_map map, raw;
    int s, x, y, a, b;
    desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
    REQUIRE(conemap_build(&desc, &raw) == CONEMAP_OK, "build");
    desc.min3x3 = 1;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    for (s = 0; s < 8; ++s)
        for (y = 1; y < 10; ++y)
            for (x = 1; x < 12; ++x) {
                float least = 1e30f;
                for (b = -1; b <= 1; ++b)
                    for (a = -1; a <= 1; ++a) {
                        float cone = raw.cones[s * 143 + (y + b) * 13 + x + a];
                        if (cone < least) least = cone;
                    }
                CHECK(map.cones[s * 143 + y * 13 + x] == least, "sector %d texel %d %d", s, x, y);
            }
    conemap_free(&raw);
    conemap_free(&map);
}

/* ---- bilinear cones: proven by bound, tight, and no narrower than those for all directions ---- */

static void bilinear_cones_are_proven(void)
{
    static const int sizes[][2] = {{1, 1}, {1, 7}, {6, 1}, {2, 2}, {3, 5}, {9, 8}, {17, 12}};
    static const float aspects[] = {0.0f, 0.3f, 4.0f, 0.0f, 40.0f};
    static float wider[MOST];
    size_t cells = 0;
    int n, kind, k, s, turn = 0, widened = 0, caught = 0;
    for (n = 0; n < 7; ++n)
        for (kind = 0; kind < ZOO_KINDS; ++kind)
            for (k = 0; k < (n < 6 ? 3 : 1); ++k) {
                conemap_desc desc = make_desc(kind, sizes[n][0], sizes[n][1], turn * 5 + k, aspects[turn % 5],
                                              turn % 2 ? 4 : 8);
                conemap_map map;
                conemap_report report;
                size_t texels = (size_t)sizes[n][0] * (size_t)sizes[n][1], c;
                desc.max_tan = turn % 3 ? 16.0f : 1.0f;
                if (n == 6) desc.aspect = (float)sizes[n][1] / (float)sizes[n][0];
                desc.texture.format = (conemap_format)(turn / 2 % CONEMAP_FORMAT_COUNT);
                desc.texture.encoding = (conemap_encoding)(turn / 3 % CONEMAP_ENCODING_COUNT);
                desc.texture.per_cell = turn % 7 < 3 && desc.texture.encoding != CONEMAP_RADIUS;
                desc.slack = turn % 11 == 10 ? 0.6f : 0.0f;
                ++turn;
                REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "%s", describe(&desc));
                REQUIRE(conemap_verify(&map.info, map.heights, map.cones, NULL, &report) == CONEMAP_OK, "verify");
                cells += report.cells;
                CHECK(report.unsafe == 0 && report.unproven == 0, "%s %s: %d unsafe by %g, %d unproven of %d",
                      zoo_name(kind), describe(&desc), (int)report.unsafe, report.worst, (int)report.unproven,
                      (int)report.cells);
                if (n == 5 && desc.texture.format == CONEMAP_F32) /* one plane after the other made too wide */
                    for (s = 0; s < desc.texture.sectors; ++s) {
                        memcpy(wider, map.cones, texels * (size_t)desc.texture.sectors * sizeof(float));
                        for (c = 0; c < texels; ++c) wider[(size_t)s * texels + c] *= 1.01f;
                        REQUIRE(conemap_verify(&map.info, map.heights, wider, NULL, &report) == CONEMAP_OK, "verify");
                        ++widened;
                        if (report.unsafe) ++caught;
                    }
                conemap_free(&map);
            }
    { /* along a border a proof has the least room */
        conemap_desc desc = make_desc(ZOO_WHITE, 9, 8, 7, 4.0f, 8);
        conemap_map map;
        conemap_report report;
        desc.max_tan = 16.0f;
        desc.texture.format = CONEMAP_UNORM8;
        desc.texture.per_cell = 1;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "%s", describe(&desc));
        REQUIRE(conemap_verify(&map.info, map.heights, map.cones, NULL, &report) == CONEMAP_OK, "verify");
        CHECK(report.unsafe == 0 && report.unproven == 0, "%s: %d unproven", describe(&desc), (int)report.unproven);
        conemap_free(&map);
    }
    CHECK(caught * 3 > widened && caught > 10, "%d of %d planes that are 1 %% too wide are caught", caught, widened);
    test_note("%d cells proven, %d of %d wider planes caught", (int)cells, caught, widened);
}

/* What the verifier cannot skip: a spike one texel beyond a sector raises a tent inside it. */
static void tents_beyond_the_border(void)
{
    conemap_desc desc = make_desc(ZOO_FLAT_0, 12, 12, 8, 1.0f, 4);
    conemap_map map;
    conemap_report report;
    int at = 5 * 12 + 5, s;
    heights[4 * 12 + 8] = 1.0f; /* 3 to the right, 1 up: in sector 2, its tent also in sector 0 */
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    CHECK(map.cones[2 * 144 + at] < 0.3f && map.cones[at] < 0.5f, "cones %g, %g", (double)map.cones[2 * 144 + at],
          (double)map.cones[at]);
    for (s = 1; s < 4; s += 2) CHECK(map.cones[s * 144 + at] == 1.0f, "sector %d: %g", s, (double)map.cones[s * 144 + at]);
    conemap_free(&map);
    desc.guarantee = CONEMAP_GUARANTEE_VERTEX; /* which knows of vertices only */
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    CHECK(map.cones[at] == 1.0f, "vertex cone %g", (double)map.cones[at]);
    REQUIRE(conemap_verify(&map.info, map.heights, map.cones, NULL, &report) == CONEMAP_OK, "verify");
    CHECK(report.unsafe > 0, "vertex cones are not safe");
    conemap_free(&map);
}

static void beside_all_directions(void)
{
    int kind, k, s, sectors, wraps = 0;
    for (kind = 0; kind < ZOO_KINDS; ++kind)
        for (sectors = 4; sectors <= 8; sectors += 4) {
            conemap_desc desc = make_desc(kind, 24, 20, wraps++, 20.0f / 24.0f, sectors);
            conemap_map map, plain;
            conemap_sample sample;
            desc.max_tan = 16.0f;
            REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "%s", describe(&desc));
            desc.texture.sectors = 1; /* the same as 0 */
            REQUIRE(conemap_build(&desc, &plain) == CONEMAP_OK, "%s", describe(&desc));
            for (k = 0; k < 480; ++k) {
                float narrowest = 1e30f;
                for (s = 0; s < sectors; ++s) {
                    float cone = map.cones[s * 480 + k];
                    if (cone < narrowest) narrowest = cone;
                }
                /* both are within 5.4 % of the supremum */
                if (!CHECK(narrowest >= plain.cones[k] * 0.94f && narrowest <= plain.cones[k] * 1.06f,
                           "%s sectors %d texel %d: narrowest %.9g beside %.9g", zoo_name(kind), sectors, k,
                           (double)narrowest, (double)plain.cones[k]))
                    break;
                REQUIRE(conemap_sample_at(&map, ((float)(k % 24) + 0.5f) / 24.0f, ((float)(k / 24) + 0.5f) / 20.0f,
                                          &sample) == CONEMAP_OK,
                        "sample");
                CHECK(fabsf(sample.tan - narrowest) <= 1e-4f * narrowest, "texel %d: sampled %g, narrowest %g", k,
                      (double)sample.tan, (double)narrowest);
            }
            conemap_free(&map);
            conemap_free(&plain);
        }
}

/* ---- rays ---- */

static void rays_miss_nothing(void)
{
    static const int kinds[] = {ZOO_FBM, ZOO_BRICKS, ZOO_WHITE, ZOO_SPIKES, ZOO_IMPULSE, ZOO_CORNER_SPIKE};
    struct zoo_random random = zoo_seed(8);
    double steps = 0.0, plain_steps = 0.0;
    int k, n, c, misses = 0, others = 0, hits = 0;
    for (k = 0; k < 36; ++k) {
        conemap_desc desc = make_desc(kinds[k % 6], 24, 20, k, k % 2 ? 1.0f : 20.0f / 24.0f, k % 4 < 2 ? 4 : 8);
        conemap_map map, plain;
        struct truth_map truth = {24, 20, 0, 0, NULL};
        desc.texture.format = (conemap_format)(k % CONEMAP_FORMAT_COUNT);
        desc.texture.encoding = (conemap_encoding)(k / 4 % 2);
        desc.texture.per_cell = k % 3 == 2;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "%s", describe(&desc));
        desc.texture.sectors = 0;
        REQUIRE(conemap_build(&desc, &plain) == CONEMAP_OK, "%s", describe(&desc));
        truth.wrap_u = (int)desc.wrap_u;
        truth.wrap_v = (int)desc.wrap_v;
        truth.heights = map.heights;
        for (n = 0; n < 1000; ++n) {
            conemap_ray ray;
            conemap_hit hit, other;
            double origin[3], direction[3], until;
            memset(&ray, 0, sizeof ray);
            for (c = 0; c < 3; ++c) ray.origin[c] = zoo_unit(&random);
            for (c = 0; c < 3; ++c) ray.direction[c] = zoo_between(&random, -1.0f, 1.0f);
            ray.direction[2] *= n % 3 ? 0.2f : 1.0f;
            if (n % 8 == 0) ray.direction[n / 8 % 2] = 0.0f;                                 /* along a quadrant's border */
            if (n % 8 == 1) ray.direction[1] = (n & 8 ? 24.0f : -24.0f) / 20.0f * ray.direction[0]; /* an octant's */
            if (n % 8 == 2) ray.origin[n / 8 % 2] = n & 16 ? 0.003f : 0.997f;                /* the outer half texel */
            if (n % 64 == 3) ray.direction[0] = ray.direction[1] = 0.0f;
            if (n % 16 == 4) ray.t_max = zoo_unit(&random) + 0.01f;
            REQUIRE(conemap_trace(&map, NULL, &ray, &hit, 1) == CONEMAP_OK &&
                    conemap_trace(&plain, NULL, &ray, &other, 1) == CONEMAP_OK,
                    "trace");
            for (c = 0; c < 3; ++c) origin[c] = (double)ray.origin[c], direction[c] = (double)ray.direction[c];
            until = hit.status == CONEMAP_HIT ? (double)hit.t * (1.0 - 1e-6) : (double)hit.t;
            if (truth_clearance(&truth, origin, direction, 0.0, until) < -1.0 / 1048576.0 && !hit.inside) ++misses;
            /* on a crest that a ray just touches, the last bits may tell a hit from none */
            if (hit.status != other.status ||
                fabs((double)hit.t - (double)other.t) > 1e-5 * (1.0 + (double)other.t))
                ++others;
            if (hit.status == CONEMAP_HIT) ++hits;
            steps += hit.steps;
            plain_steps += other.steps;
        }
        conemap_free(&map);
        conemap_free(&plain);
    }
    CHECK(misses == 0, "%d misses", misses);
    CHECK(others == 0, "%d rays meet something else over plain cones", others);
    CHECK(hits > 10000, "only %d hits", hits);
    CHECK(steps < 0.95 * plain_steps, "%g steps, %g over plain cones", steps, plain_steps);
    test_note("steps %.2f of those with plain cones", steps / plain_steps);
}

/* The other tracers read the same plane: over cones that only one sector has, rays of that sector alone step far. */
static void tracers_read_their_sector(void)
{
    static const conemap_tracer tracers[] = {CONEMAP_TRACE_EXACT, CONEMAP_TRACE_FIXED, CONEMAP_TRACE_LOOP,
                                             CONEMAP_TRACE_EXACT_STEP, CONEMAP_TRACE_CELL_MAX};
    static float cones[8 * 32 * 16];
    int s, k, sectors;
    for (sectors = 4; sectors <= 8; sectors += 4)
        for (s = 0; s < sectors; ++s) {
            conemap_desc desc = make_desc(ZOO_FLAT_0, 32, 16, 0, 1.0f, sectors);
            conemap_map map;
            conemap_ray rays[8];
            conemap_hit hits[8];
            int r, t;
            REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
            memset(cones, 0, sizeof cones);
            for (k = 0; k < 512; ++k) cones[s * 512 + k] = 1.0f;
            map.cones = cones;
            memset(rays, 0, sizeof rays);
            for (r = 0; r < sectors; ++r) {
                float u = r & 4 ? 0.1f : 0.3f, v = r & 4 ? 0.3f : 0.1f; /* in texels the diagonal is (1, 2) */
                rays[r].origin[0] = rays[r].origin[1] = rays[r].origin[2] = 0.5f;
                rays[r].direction[0] = r & 1 ? -u : u;
                rays[r].direction[1] = r & 2 ? -v : v;
                rays[r].direction[2] = -0.5f;
                CHECK(conemap_sector(&map.info, rays[r].direction[0], rays[r].direction[1]) == r, "ray %d", r);
            }
            for (t = 0; t < 5; ++t) {
                conemap_trace_desc trace;
                memset(&trace, 0, sizeof trace);
                trace.tracer = tracers[t];
                if (trace.tracer == CONEMAP_TRACE_LOOP) trace.max_steps = 64;
                REQUIRE(conemap_trace(&map, &trace, rays, hits, sectors) == CONEMAP_OK, "trace");
                for (r = 0; r < sectors; ++r)
                    if (trace.tracer == CONEMAP_TRACE_FIXED || trace.tracer == CONEMAP_TRACE_LOOP)
                        CHECK((hits[r].status == CONEMAP_HIT) == (r == s), "tracer %d sector %d ray %d: %d", t, s, r,
                              (int)hits[r].status);
                    else if (r != s)
                        CHECK(hits[r].steps > hits[s].steps, "tracer %d sector %d ray %d: %d steps, %d", t, s, r,
                              hits[r].steps, hits[s].steps);
            }
            conemap_free(&map);
        }
}

/* ---- storage ---- */

static float channel(conemap_format format, const unsigned char *bytes)
{
    conemap_info info;
    float value;
    uint16_t code;
    memset(&info, 0, sizeof info);
    switch (format) {
    case CONEMAP_F32: memcpy(&value, bytes, 4); return value;
    case CONEMAP_UNORM8: return (float)bytes[0] / 255.0f;
    default: break;
    }
    memcpy(&code, bytes, 2);
    if (format == CONEMAP_UNORM16) return (float)code / 65535.0f;
    return code >> 10 ? ldexpf((float)((code & 1023) | 1024), (code >> 10 & 31) - 25) : ldexpf((float)code, -24);
}

static void storage(void)
{
    static const size_t sizes[CONEMAP_FORMAT_COUNT] = {4, 2, 2, 1};
    int k;
    for (k = 0; k < 32; ++k) {
        conemap_desc desc = make_desc(ZOO_FBM, 13, 9, k, 1.0f, k % 2 ? 4 : 8);
        conemap_map map, loaded;
        conemap_info info;
        size_t step, size, pitch;
        unsigned char *bytes;
        int sectors = desc.texture.sectors, t, c, x, y, n = 13 * 9, count;
        desc.texture.format = (conemap_format)(k / 2 % 4);
        desc.texture.layout = k & 8 ? CONEMAP_CONE_ONLY : CONEMAP_HEIGHT_CONE;
        desc.texture.encoding = k & 16 ? CONEMAP_SQRT : CONEMAP_LINEAR;
        step = sizes[desc.texture.format];
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "%s", describe(&desc));
        count = sectors / 4 + !(k & 8);
        CHECK(conemap_texture_count(&map) == count && map.info.texture.sectors == sectors, "%d textures",
              conemap_texture_count(&map));
        CHECK(conemap_row_size(&map) == 13 * 4 * step && conemap_texture_size(&map, 0) == 13 * 9 * 4 * step, "texture 0");
        for (t = 0; t < count; ++t) {
            int channels = t < sectors / 4 ? 4 : 1;
            conemap_format_numbers numbers;
            size = conemap_texture_size_at(&map, t, 0);
            CHECK(conemap_row_size_at(&map, t) == 13 * (size_t)channels * step && size == 9 * conemap_row_size_at(&map, t),
                  "texture %d", t);
            CHECK(conemap_get_format_numbers_at(&desc.texture, t, &numbers) == CONEMAP_OK && numbers.channels == channels &&
                      numbers.bytes == channels * (int)step,
                  "numbers of texture %d", t);
            pitch = conemap_row_size_at(&map, t) + 7;
            bytes = (unsigned char *)test_alloc(pitch * 9 - 7);
            CHECK(conemap_write_texture_at(&map, t, bytes, pitch * 9 - 8, pitch) == CONEMAP_ERROR_BUFFER, "a byte less");
            REQUIRE(conemap_write_texture_at(&map, t, bytes, pitch * 9 - 7, pitch) == CONEMAP_OK, "texture %d", t);
            for (y = 0; y < 9; ++y)
                for (x = 0; x < 13; ++x)
                    for (c = 0; c < channels; ++c) {
                        float value = channel(desc.texture.format,
                                              bytes + (size_t)y * pitch + (size_t)(x * channels + c) * step);
                        float right = channels == 4 ? map.cones[(4 * t + c) * n + y * 13 + x] : map.heights[y * 13 + x];
                        if (!CHECK(value == right, "%s texture %d (%d, %d) channel %d: %g, not %g", describe(&desc), t,
                                   x, y, c, (double)value, (double)right))
                            return;
                    }
            test_release(bytes);
        }
        CHECK(conemap_texture_size_at(&map, count, 0) == 0 && conemap_row_size_at(&map, -1) == 0, "no such texture");

        size = conemap_save_size(&map);
        bytes = (unsigned char *)test_alloc(size);
        CHECK(conemap_save(&map, bytes, size - 1) == CONEMAP_ERROR_BUFFER, "a byte less");
        REQUIRE(conemap_save(&map, bytes, size) == CONEMAP_OK, "save");
        CHECK(conemap_load_info(bytes, size, &info) == CONEMAP_OK && info.texture.sectors == sectors, "info");
        CHECK(conemap_load_info(bytes, size - 1, &info) == CONEMAP_ERROR_FILE_TRUNCATED, "a byte less");
        if (k & 8) CHECK(conemap_load(bytes, size, NULL, &loaded) == CONEMAP_ERROR_NO_HEIGHTS, "no heights");
        desc.keep_pyramid = 1;
        REQUIRE(conemap_load(bytes, size, &desc, &loaded) == CONEMAP_OK, "load");
        CHECK(!memcmp(loaded.cones, map.cones, sizeof(float) * (size_t)(n * sectors)) &&
                  !memcmp(loaded.heights, map.heights, sizeof(float) * (size_t)n) && loaded.cells.levels > 0,
              "%s: loaded as something else", describe(&desc));
        conemap_free(&loaded);
        bytes[size - 1] ^= 1;
        CHECK(conemap_load(bytes, size, &desc, &loaded) == CONEMAP_ERROR_FILE_CORRUPT, "a bit of the last plane");
        test_release(bytes);
        conemap_free(&map);
    }
}

/* ---- jobs and updates ---- */

static void backwards(int count, conemap_job *job, void *context, void *user)
{
    (void)user;
    while (count-- > 0) job(context, count);
}

static int last_done, falls;

static int watch(double done, void *user)
{
    (void)user;
    if ((int)(done * 1e6) < last_done) ++falls;
    last_done = (int)(done * 1e6);
    return done > 1.0;
}

static void jobs_do_not_show(void)
{
    int k;
    for (k = 0; k < 8; ++k) {
        conemap_desc desc = make_desc(ZOO_FBM, 31, 40, k * 4, 1.0f, k % 2 ? 4 : 8);
        conemap_map map, other;
        desc.guarantee = k & 2 ? CONEMAP_GUARANTEE_VERTEX : CONEMAP_GUARANTEE_BILINEAR;
        desc.slack = k & 4 ? 0.5f : 0.0f;
        desc.progress = watch;
        last_done = falls = 0;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "%s", describe(&desc));
        CHECK(falls == 0 && last_done > 900000, "progress fell %d times, ended at %d", falls, last_done);
        desc.progress = NULL;
        desc.parallel_for = backwards;
        REQUIRE(conemap_build(&desc, &other) == CONEMAP_OK, "%s", describe(&desc));
        CHECK(!memcmp(map.cones, other.cones, sizeof(float) * (size_t)(31 * 40 * desc.texture.sectors)), "%s: jobs show",
              describe(&desc));
        conemap_free(&map);
        conemap_free(&other);
    }
}

static void updates_equal_builds(void)
{
    struct zoo_random random = zoo_seed(4);
    static const int kinds[] = {ZOO_FBM, ZOO_SPIKES, ZOO_RAMP, ZOO_BRICKS, ZOO_IMPULSE};
    int k, n, i, j;
    for (k = 0; k < 36; ++k) {
        conemap_desc desc = make_desc(kinds[k % 5], 29, 23, k, k % 2 ? 1.0f : 23.0f / 29.0f, k % 4 < 2 ? 4 : 8);
        conemap_map map, whole;
        desc.max_tan = k % 3 ? 4.0f : 1.0f;
        desc.texture.format = (conemap_format)(k % CONEMAP_FORMAT_COUNT);
        desc.texture.encoding = (conemap_encoding)(k / 4 % CONEMAP_ENCODING_COUNT);
        desc.guarantee = k % 5 == 3 ? CONEMAP_GUARANTEE_VERTEX : CONEMAP_GUARANTEE_BILINEAR;
        desc.texture.per_cell = k % 3 == 1 && desc.guarantee == CONEMAP_GUARANTEE_BILINEAR &&
                                desc.texture.encoding != CONEMAP_RADIUS;
        desc.slack = k % 17 == 16 ? 0.5f : 0.0f;
        desc.keep_search = k / 2 % 2;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "%s", describe(&desc));
        for (n = 0; n < 4; ++n) {
            int w = 1 + zoo_below(&random, 5), h = 1 + zoo_below(&random, 5);
            int x = zoo_below(&random, 30 - w), y = zoo_below(&random, 24 - h);
            float level = zoo_unit(&random);
            for (j = y; j < y + h; ++j)
                for (i = x; i < x + w; ++i) heights[j * 29 + i] = n % 2 ? heights[j * 29 + i] * level : level;
            REQUIRE(conemap_update(&map, &desc, x, y, w, h) == CONEMAP_OK, "%s", describe(&desc));
            REQUIRE(conemap_build(&desc, &whole) == CONEMAP_OK, "%s", describe(&desc));
            CHECK(!memcmp(map.cones, whole.cones, sizeof(float) * (size_t)(29 * 23 * desc.texture.sectors)) &&
                      !memcmp(map.heights, whole.heights, sizeof(float) * 29 * 23),
                  "%s edit %d (%d, %d, %d x %d): not what a full build gives", describe(&desc), n, x, y, w, h);
            conemap_free(&whole);
        }
        conemap_free(&map);
    }
}

/* ---- bad input ---- */

static void bad_input(void)
{
    static const int bad[] = {3, 2, 5, 7, 16, -1, -4, 2147483647};
    conemap_desc desc = make_desc(ZOO_FBM, 8, 8, 0, 0.0f, 4), other;
    conemap_format_numbers numbers;
    conemap_map map;
    conemap_report report;
    conemap_info info;
    float pixels[256];
    size_t memory, scratch, plain_memory, plain_scratch;
    int k;
    for (k = 0; k < 8; ++k) {
        other = desc;
        other.texture.sectors = bad[k];
        CHECK(conemap_build(&other, &map) == CONEMAP_ERROR_PARAMETER, "%d sectors", bad[k]);
        CHECK(conemap_get_format_numbers(&other.texture, &numbers) == CONEMAP_ERROR_PARAMETER, "%d sectors", bad[k]);
    }
    for (k = CONEMAP_EXACT + 1; k < CONEMAP_GENERATOR_COUNT; ++k) {
        other = desc;
        other.generator = (conemap_generator)k;
        CHECK(conemap_build(&other, &map) == CONEMAP_ERROR_UNSUPPORTED, "generator %d", k);
    }
    other = desc;
    other.texture.layout = CONEMAP_DUMMER;
    CHECK(conemap_build(&other, &map) == CONEMAP_ERROR_UNSUPPORTED, "dummer");
    CHECK(conemap_get_format_numbers(&other.texture, &numbers) == CONEMAP_ERROR_UNSUPPORTED, "dummer");
    CHECK(conemap_get_format_numbers_at(&desc.texture, 2, &numbers) == CONEMAP_ERROR_PARAMETER, "no such texture");
    CHECK(conemap_get_format_numbers_at(&desc.texture, -1, &numbers) == CONEMAP_ERROR_PARAMETER, "no such texture");
    CHECK(conemap_texture_count(NULL) == 0, "null");

    other = desc;
    other.texture.sectors = 0;
    REQUIRE(conemap_memory(&desc, &memory, &scratch) == CONEMAP_OK &&
                conemap_memory(&other, &plain_memory, &plain_scratch) == CONEMAP_OK,
            "memory");
    CHECK(memory == plain_memory + 3 * 64 * sizeof(float) && scratch > plain_scratch, "%d bytes, %d", (int)memory,
          (int)plain_memory);
    desc.memory = test_alloc(memory);
    desc.memory_size = memory;
    desc.scratch = test_alloc(scratch);
    desc.scratch_size = scratch;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "own memory");
    test_release(desc.scratch);
    desc.scratch = NULL;
    CHECK(conemap_write_texture_at(&map, 2, pixels, sizeof pixels, 0) == CONEMAP_ERROR_PARAMETER, "no such texture");
    CHECK(conemap_write_texture_at(&map, -1, pixels, sizeof pixels, 0) == CONEMAP_ERROR_PARAMETER, "no such texture");
    CHECK(conemap_write_texture_at(&map, 1, NULL, 0, 0) == CONEMAP_ERROR_NULL, "null");
    CHECK(conemap_write_texture_at(&map, 1, pixels, sizeof pixels, 31) == CONEMAP_ERROR_STRIDE, "pitch");
    CHECK(conemap_update(&map, &other, 0, 0, 1, 1) == CONEMAP_ERROR_PARAMETER, "other sectors");
    info = map.info;
    info.texture.sectors = 5;
    CHECK(conemap_verify(&info, map.heights, map.cones, NULL, &report) == CONEMAP_ERROR_PARAMETER, "verify 5 sectors");
    memcpy(pixels, map.cones, sizeof pixels);
    pixels[255] = -1.0f;
    CHECK(conemap_verify(&map.info, map.heights, pixels, NULL, &report) == CONEMAP_ERROR_PARAMETER,
          "the last plane's last cone");
    conemap_free(&map);
    test_release(desc.memory);
}

const struct test_case directional_tests[] = {
    {"sectors of directions", sectors_of_directions},
    {"vertex cones equal rings", vertex_cones_equal_rings},
    {"corrected planes", corrected_planes},
    {"bilinear cones are proven", bilinear_cones_are_proven},
    {"tents beyond the border", tents_beyond_the_border},
    {"beside all directions", beside_all_directions},
    {"rays miss nothing", rays_miss_nothing},
    {"tracers read their sector", tracers_read_their_sector},
    {"storage", storage},
    {"jobs do not show", jobs_do_not_show},
    {"updates equal builds", updates_equal_builds},
    {"bad input", bad_input},
    {NULL, NULL},
};
