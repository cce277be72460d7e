/* The prepared tracer: the same hits as conemap_trace with CONEMAP_TRACE_EXACT, none missed, the same bits from every
   instruction set, however many rays come at once and in whatever company; its table is what it is meant to be. The
   stability suite sends its chosen rays through it too. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

#define MISS (1.0 / 1048576.0)
#define RAYS 320
#define PEAKS ZOO_KINDS /* a kind of map: flat ground, on which a few texels stand alone */

static conemap_ray rays[RAYS];
static conemap_hit expected[RAYS], hits[RAYS];

static int build(int kind, int w, int h, int wraps, uint32_t seed, conemap_map *map)
{
    static float heights[80 * 80];
    conemap_desc desc;
    if (kind == PEAKS) {
        struct zoo_random random = zoo_seed(seed);
        int k;
        for (k = 0; k < w * h; ++k)
            heights[k] = zoo_below(&random, 150) == 0 ? zoo_between(&random, 0.2f, 1.0f)
                         : k % w < w / 4 ? 0.125f : 0.0f;
    } else {
        zoo_fill(kind, w, h, seed, heights);
    }
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = w;
    desc.heights.height = h;
    desc.wrap_u = (conemap_wrap)(wraps % 3);
    desc.wrap_v = (conemap_wrap)(wraps / 3);
    desc.aspect = 1.5f;
    desc.keep_pyramid = wraps % 2;
    return CHECK(conemap_build(&desc, map) == CONEMAP_OK, "build %s", kind == PEAKS ? "peaks" : zoo_name(kind));
}

/* Rays from above and beside, inside, level, along the axes, through vertices, corner to corner, short, and some that are
   invalid. */
static void make_rays(struct zoo_random *random, const conemap_map *map)
{
    const float w = (float)map->info.width, h = (float)map->info.height;
    int k, c;
    for (k = 0; k < RAYS; ++k) {
        conemap_ray *ray = &rays[k];
        int kind = zoo_below(random, 12);
        float u = (floorf(zoo_unit(random) * w) + 0.5f) / w, v = (floorf(zoo_unit(random) * h) + 0.5f) / h;
        memset(ray, 0, sizeof *ray);
        for (c = 0; c < 3; ++c) {
            ray->origin[c] = zoo_between(random, -0.5f, 1.5f);
            ray->direction[c] = zoo_between(random, -1.0f, 1.0f);
        }
        ray->t_max = 8.0f;
        if (kind < 4) {
            ray->origin[2] = 1.0f;
            ray->direction[2] = -zoo_unit(random) - 0.01f;
        } else if (kind == 4) {
            ray->origin[0] = u;
            ray->direction[0] = zoo_below(random, 2) ? 0.0f : -0.0f;
        } else if (kind == 5) {
            ray->origin[1] = v;
            ray->direction[1] = 0.0f;
        } else if (kind == 6) {
            ray->direction[0] = ray->direction[1] = 0.0f;
            if (ray->direction[2] == 0.0f) ray->direction[2] = -1.0f;
            if (zoo_below(random, 2)) ray->origin[0] = u, ray->origin[1] = v;
        } else if (kind == 7) {
            ray->direction[2] = 0.0f;
        } else if (kind == 8) { /* corner to corner */
            ray->direction[0] = (zoo_below(random, 2) ? 1.0f : -1.0f) / w;
            ray->direction[1] = (zoo_below(random, 2) ? 1.0f : -1.0f) / h;
            ray->direction[2] = -zoo_unit(random) * 0.1f;
            ray->origin[0] = u - 4.0f * ray->direction[0];
            ray->origin[1] = v - 4.0f * ray->direction[1];
            ray->origin[2] = zoo_unit(random);
            ray->t_max = 200.0f;
        } else if (kind == 9) {
            ray->t_min = zoo_unit(random);
            ray->t_max = ray->t_min + zoo_unit(random);
        } else if (kind == 10 && zoo_below(random, 4) == 0) {
            if (zoo_below(random, 2)) ray->origin[zoo_below(random, 3)] = (float)NAN;
            else memset(ray->direction, 0, sizeof ray->direction);
        } else if (kind == 11) {
            for (c = 0; c < 3; ++c) ray->direction[c] *= zoo_below(random, 2) ? 1e18f : 1e-18f;
            ray->t_max = 0.0f;
            if (ray->direction[2] == 0.0f) ray->direction[2] = -1e-18f;
        }
    }
}

static struct truth_map truth_of(const conemap_map *map)
{
    struct truth_map truth;
    truth.width = map->info.width;
    truth.height = map->info.height;
    truth.wrap_u = (int)map->info.wrap_u;
    truth.wrap_v = (int)map->info.wrap_v;
    truth.heights = map->heights;
    return truth;
}

/* The least height of a ray over the surface within the box and up to t, give or take what a float t leaves open. */
static double clearance(const struct truth_map *truth, const conemap_ray *ray, double t)
{
    double o[3], d[3], begin = (double)ray->t_min, end = t;
    int k;
    for (k = 0; k < 3; ++k) {
        o[k] = (double)ray->origin[k];
        d[k] = (double)ray->direction[k];
    }
    truth_above_floor(o, d, &begin, &end);
    if (d[2] > 0.0) begin = fmax(begin, -o[2] / d[2]); /* the truth's grain below the floor is no part of the way */
    if (d[2] < 0.0) begin = fmax(begin, (1.0 - o[2]) / d[2]);
    if (d[2] > 0.0) end = fmin(end, (1.0 - o[2]) / d[2]);
    if (d[2] == 0.0 && o[2] > 1.0) return HUGE_VAL;
    if (end > begin + 1e-9) end -= 1e-9;
    return begin <= end ? truth_clearance(truth, o, d, begin, end) : HUGE_VAL;
}

static void compare(const conemap_map *map, const char *what)
{
    const struct truth_map truth = truth_of(map);
    conemap_trace_desc desc;
    int k, same = 0;
    memset(&desc, 0, sizeof desc);
    desc.tracer = CONEMAP_TRACE_MAXMIP;
    (void)conemap_trace(map, map->cells.levels ? &desc : NULL, rays, expected, RAYS);
    for (k = 0; k < RAYS; ++k) {
        const conemap_hit *a = &hits[k], *b = &expected[k];
        double texels, end;
        CHECK((a->status == CONEMAP_INVALID) == (b->status == CONEMAP_INVALID), "%s: ray %d: status %d, not %d", what, k,
              (int)a->status, (int)b->status);
        if (a->status == CONEMAP_INVALID) continue;
        /* a hit is no hit early: the truth is at or below the surface there, or just above */
        if (a->status == CONEMAP_HIT && !a->inside) {
            double over = (double)a->z - truth_height(&truth, (double)a->u, (double)a->v);
            double steep = 2e-6 * (double)(map->info.width + map->info.height) *
                           (1.0 + fabs((double)a->u) + fabs((double)a->v));
            CHECK(over < MISS + steep, "%s: ray %d: a hit %g above the surface", what, k, over);
        }
        end = a->status == CONEMAP_HIT ? (double)a->t * (1.0 - 1e-6) - 1e-9
              : a->status == CONEMAP_T_MAX || a->status == CONEMAP_STEP_CAP ? (double)a->t
              : rays[k].t_max > 0.0f ? (double)rays[k].t_max : HUGE_VAL;
        if (end < 1e9 || (truth.wrap_u != 1 && truth.wrap_v != 1)) {
            double least = clearance(&truth, &rays[k], end);
            CHECK(least > -MISS, "%s: ray %d: missed by %g, status %d, t %g", what, k, -least, (int)a->status,
                  (double)a->t);
        }
        /* and the same as the other tracer's, but where they graze */
        if (a->status != b->status) {
            double least = clearance(&truth, &rays[k], (double)(a->t > b->t ? a->t : b->t) * 1.000001);
            CHECK(fabs(least) < 2.0 * MISS, "%s: ray %d: status %d, not %d, %g from the surface", what, k,
                  (int)a->status, (int)b->status, least);
            continue;
        }
        texels = fabs((double)a->u - (double)b->u) * (double)map->info.width +
                 fabs((double)a->v - (double)b->v) * (double)map->info.height;
        CHECK(texels < 1.0 / 16.0 || fabs((double)a->z - (double)b->z) < MISS || a->t > 1e6f,
              "%s: ray %d: t %.9g, not %.9g: %g texels away", what, k, (double)a->t, (double)b->t, texels);
        same += a->t == b->t && a->inside == b->inside;
    }
    CHECK(same > RAYS / 2, "%s: only %d of %d are the same", what, same, RAYS);
}

static void same_hits(void)
{
    static const int sizes[][2] = {{1, 1}, {2, 1}, {1, 5}, {2, 3}, {17, 9}, {33, 31}, {64, 20}};
    struct zoo_random random = zoo_seed(71);
    conemap_result a, b;
    int kind, wraps, size, k;
    for (kind = 0; kind < ZOO_KINDS; ++kind) {
        for (wraps = 0; wraps < 9; ++wraps) {
            conemap_map map;
            conemap_prepared prepared;
            char what[80];
            size = (kind + wraps) % 7;
            if (!build(kind, sizes[size][0], sizes[size][1], wraps, (uint32_t)kind, &map)) return;
            snprintf(what, sizeof what, "%s %d x %d wraps %d %d", zoo_name(kind), sizes[size][0], sizes[size][1], wraps % 3,
                     wraps / 3);
            if (CHECK(conemap_prepare(&map, NULL, &prepared) == CONEMAP_OK, "%s: prepare", what)) {
                make_rays(&random, &map);
                memset(hits, 0x7b, sizeof hits);
                a = conemap_trace_prepared(&prepared, rays, hits, RAYS);
                b = conemap_trace(&map, NULL, rays, expected, RAYS);
                CHECK(a == b || (a != CONEMAP_OK && b != CONEMAP_OK), "%s: %s", what, conemap_result_string(a));
                compare(&map, what);
                CHECK(prepared.memory_size == conemap_prepare_memory(&map), "%s: memory", what);
                CHECK(prepared.bytes_per_texel <= 8.0, "%s: %g bytes", what, prepared.bytes_per_texel);
                for (k = 0; k < RAYS; ++k) CHECK(hits[k].fallback == 0, "%s: fallback", what);
                conemap_free_prepared(&prepared);
            }
            conemap_free(&map);
        }
    }
}

/* Maps whose records leave a texel out: rays fly past it or meet it, wherever it stands, also at borders and seams. */
static void peaks(void)
{
    static const int sizes[][2] = {{64, 40}, {25, 19}, {7, 5}};
    struct zoo_random random = zoo_seed(74);
    int wraps, size, seed, around, k;
    for (wraps = 0; wraps < 9; ++wraps)
        for (size = 0; size < 3; ++size) {
            conemap_map map;
            conemap_prepared prepared;
            char what[80];
            snprintf(what, sizeof what, "%d x %d wraps %d %d", sizes[size][0], sizes[size][1], wraps % 3, wraps / 3);
            for (seed = 0;; ++seed) { /* until peaks are what suits it */
                if (!build(PEAKS, sizes[size][0], sizes[size][1], wraps, (uint32_t)(9 * seed + wraps), &map)) return;
                REQUIRE(conemap_prepare(&map, NULL, &prepared) == CONEMAP_OK, "%s: prepare", what);
                if (prepared.own.peaks || seed == 99) break;
                conemap_free_prepared(&prepared);
                conemap_free(&map);
            }
            CHECK(prepared.own.peaks, "%s: no peaks", what);
            /* no clear way leads around the map, to the peak itself */
            around = 64;
            if (map.info.wrap_u == CONEMAP_WRAP) around = sizes[size][0];
            if (map.info.wrap_v == CONEMAP_WRAP && sizes[size][1] < around) around = sizes[size][1];
            for (k = 0; (size_t)k < prepared.memory_size / sizeof *prepared.table; ++k) {
                int one = (int)(prepared.table[k] >> 8 & 15), other = (int)(prepared.table[k] >> 20 & 15);
                CHECK(2 * one + 2 <= around && 2 * other + 2 <= around, "%s: record %d: %d %d", what, k, one, other);
            }
            make_rays(&random, &map);
            for (k = RAYS / 3; k < RAYS; ++k) { /* low ones, that meet a peak or pass it closely */
                float a = zoo_between(&random, 0.0f, 6.2831853f);
                memset(&rays[k], 0, sizeof rays[k]);
                rays[k].origin[0] = k % 4 ? zoo_unit(&random) : 0.0f;
                rays[k].origin[1] = k % 4 == 1 ? 0.0f : zoo_unit(&random);
                rays[k].origin[2] = zoo_between(&random, 0.01f, 0.6f);
                rays[k].direction[0] = k % 8 == 3 ? 0.0f : cosf(a);
                rays[k].direction[1] = k % 8 == 7 ? 0.0f : sinf(a);
                rays[k].direction[2] = zoo_between(&random, -0.2f, 0.02f);
                rays[k].t_max = 3.0f;
            }
            (void)conemap_trace_prepared(&prepared, rays, hits, RAYS);
            compare(&map, what);
            conemap_free_prepared(&prepared);
            conemap_free(&map);
        }
}

/* Level rays that go round and round a map, for up to 2^20 texels, until they meet the one texel that stands out: flights in
   floats know their place there only roughly. */
static void far_flights(void)
{
    enum { SIDE = 512, FAR_RAYS = 96 };
    struct zoo_random random = zoo_seed(73);
    static float heights[SIDE * SIDE];
    conemap_map map;
    conemap_prepared prepared;
    conemap_desc desc;
    conemap_trace_desc trace;
    int k, hit_count = 0;
    memset(heights, 0, sizeof heights);
    heights[77 * SIDE + 300] = 1.0f;
    memset(&desc, 0, sizeof desc);
    memset(&trace, 0, sizeof trace);
    trace.tracer = CONEMAP_TRACE_MAXMIP;
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = SIDE;
    desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    desc.generator = CONEMAP_QUICK;
    desc.keep_pyramid = 1;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    REQUIRE(conemap_prepare(&map, NULL, &prepared) == CONEMAP_OK, "prepare");
    memset(rays, 0, sizeof rays);
    for (k = 0; k < FAR_RAYS; ++k) {
        rays[k].origin[0] = zoo_unit(&random);
        rays[k].origin[1] = zoo_unit(&random);
        rays[k].origin[2] = 0.3f;
        rays[k].direction[0] = zoo_between(&random, -1.0f, 1.0f);
        rays[k].direction[1] = k % 4 ? zoo_between(&random, -1.0f, 1.0f) : rays[k].direction[0] * (1.0f + 1.0f / 4096.0f);
    }
    CHECK(conemap_trace(&map, &trace, rays, expected, FAR_RAYS) == CONEMAP_OK, "trace");
    CHECK(conemap_trace_prepared(&prepared, rays, hits, FAR_RAYS) == CONEMAP_OK, "trace prepared");
    for (k = 0; k < FAR_RAYS; ++k) {
        CHECK(hits[k].status == expected[k].status &&
                  fabs((double)hits[k].t - (double)expected[k].t) <= 1e-6 * (double)expected[k].t,
              "ray %d: status %d at t %.9g, not %d at %.9g", k, (int)hits[k].status, (double)hits[k].t,
              (int)expected[k].status, (double)expected[k].t);
        hit_count += hits[k].status == CONEMAP_HIT;
    }
    CHECK(hit_count > FAR_RAYS / 2, "only %d hits", hit_count);
    conemap_free_prepared(&prepared);
    conemap_free(&map);
}

/* Which cones a map has is nothing to the table. */
static void any_cones(void)
{
    static const conemap_generator generators[] = {CONEMAP_QUICK, CONEMAP_QUICK_NAIVE_CENTER, CONEMAP_RELAXED};
    static float heights[19 * 14];
    conemap_prepared first, other;
    conemap_map map;
    conemap_desc desc;
    int k;
    zoo_fill(ZOO_WHITE, 19, 14, 9u, heights);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = 19;
    desc.heights.height = 14;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    CHECK(conemap_prepare(&map, NULL, &first) == CONEMAP_OK, "prepare");
    for (k = 0; k < 3; ++k) {
        conemap_map unsafe;
        desc.generator = generators[k];
        REQUIRE(conemap_build(&desc, &unsafe) == CONEMAP_OK, "build");
        CHECK(conemap_prepare(&unsafe, NULL, &other) == CONEMAP_OK, "prepare");
        CHECK(memcmp(first.table, other.table, first.memory_size) == 0, "generator %d", (int)generators[k]);
        conemap_free_prepared(&other);
        conemap_free(&unsafe);
    }
    conemap_free_prepared(&first);
    conemap_free(&map);
}

/* Every instruction set makes the same table and the same hits, for every count, alone and in company, as structs and as
   arrays, and writes nothing beyond. */
static void same_bits(void)
{
    struct zoo_random random = zoo_seed(72);
    int kind, isa, count, k, c;
    for (kind = ZOO_FBM; kind <= PEAKS; ++kind) {
        const char *kind_name = kind == PEAKS ? "peaks" : zoo_name(kind);
        conemap_map map;
        conemap_prepared first;
        if (kind > ZOO_CLIFF && kind < PEAKS) continue;
        if (!build(kind, 31, 22, kind % 9, 3u, &map)) return;
        make_rays(&random, &map);
        memset(&first, 0, sizeof first);
        for (isa = CONEMAP_ISA_SCALAR; isa < CONEMAP_ISA_COUNT; ++isa) {
            conemap_prepare_desc desc;
            conemap_prepared prepared;
            const char *name = conemap_isa_name((conemap_isa)isa);
            memset(&desc, 0, sizeof desc);
            desc.isa = (conemap_isa)isa;
            if (!conemap_isa_available(desc.isa)) {
                CHECK(conemap_prepare(&map, &desc, &prepared) == CONEMAP_ERROR_UNSUPPORTED, "%s", name);
                continue;
            }
            REQUIRE(conemap_prepare(&map, &desc, &prepared) == CONEMAP_OK, "prepare for %s", name);
            CHECK(prepared.isa == desc.isa && (prepared.own.peaks != 0) == (kind == PEAKS), "%s: %s", kind_name, name);
            if (isa == CONEMAP_ISA_SCALAR) {
                first = prepared;
                memset(expected, 0x7b, sizeof expected);
                (void)conemap_trace_prepared(&first, rays, expected, RAYS);
            }
            CHECK(memcmp(prepared.table, first.table, first.memory_size) == 0, "%s: %s: another table", kind_name,
                  name);
            for (count = 0; count <= RAYS; count = count < 41 ? count + 1 : count < RAYS ? RAYS : RAYS + 1) {
                conemap_ray_arrays in;
                conemap_hit_arrays out;
                static float columns[8][RAYS], t[RAYS + 1], u[RAYS], v[RAYS], z[RAYS];
                static unsigned char status[RAYS], inside[RAYS];
                conemap_result result;
                memset(hits, 0x7b, sizeof hits);
                result = conemap_trace_prepared(&prepared, rays, hits, count);
                CHECK(memcmp(hits, expected, (size_t)count * sizeof hits[0]) == 0, "%s: %s: %d rays: other hits",
                      kind_name, name, count);
                if (count < RAYS) {
                    unsigned char untouched[sizeof hits[0]];
                    memset(untouched, 0x7b, sizeof untouched);
                    CHECK(memcmp(&hits[count], untouched, sizeof untouched) == 0, "%s: wrote beyond %d", name, count);
                }
                for (k = 0; k < count; ++k) {
                    for (c = 0; c < 3; ++c) {
                        columns[c][k] = rays[k].origin[c];
                        columns[3 + c][k] = rays[k].direction[c];
                    }
                    columns[6][k] = rays[k].t_min;
                    columns[7][k] = rays[k].t_max;
                }
                for (c = 0; c < 3; ++c) {
                    in.origin[c] = columns[c];
                    in.direction[c] = columns[3 + c];
                }
                in.t_min = columns[6];
                in.t_max = columns[7];
                out.status = status;
                out.inside = inside;
                out.t = t;
                out.u = u;
                out.v = v;
                out.z = z;
                t[count] = 77.0f;
                CHECK(conemap_trace_arrays(&prepared, &in, &out, count) == result, "%s: arrays", name);
                CHECK(t[count] == 77.0f, "%s: arrays: wrote beyond %d", name, count);
                for (k = 0; k < count; ++k) {
                    const conemap_hit *hit = &expected[k];
                    CHECK((int)status[k] == (int)hit->status && (int)inside[k] == hit->inside &&
                              memcmp(&t[k], &hit->t, 4) == 0 && memcmp(&u[k], &hit->u, 4) == 0 &&
                              memcmp(&v[k], &hit->v, 4) == 0 && memcmp(&z[k], &hit->z, 4) == 0,
                          "%s: ray %d as arrays", name, k);
                }
            }
            if (isa != CONEMAP_ISA_SCALAR) conemap_free_prepared(&prepared);
        }
        for (k = 0; k < 40; ++k) { /* alone */
            int which = zoo_below(&random, RAYS);
            (void)conemap_trace_prepared(&first, &rays[which], hits, 1);
            CHECK(memcmp(hits, &expected[which], sizeof hits[0]) == 0, "ray %d alone", which);
        }
        conemap_free_prepared(&first);
        conemap_free(&map);
    }
}

static void *allocated;
static size_t allowed;
static int releases;

static void *count_down(size_t size, void *user)
{
    (void)user;
    if (allowed == 0) return NULL;
    --allowed;
    allocated = malloc(size);
    return allocated;
}

static void count_release(void *memory, void *user)
{
    (void)user;
    ++releases;
    free(memory);
}

static void bad_input(void)
{
    conemap_map map, wide;
    conemap_prepared prepared, zero;
    conemap_prepare_desc desc;
    conemap_ray_arrays in;
    conemap_hit_arrays out;
    size_t size;
    unsigned char *memory;
    int k;
    if (!build(ZOO_FBM, 16, 9, 0, 1u, &map)) return;
    memset(&zero, 0, sizeof zero);
    memset(&desc, 0, sizeof desc);
    memset(&in, 0, sizeof in);
    memset(&out, 0, sizeof out);
    memset(rays, 0, sizeof rays);
    CHECK(conemap_prepare(NULL, NULL, &prepared) == CONEMAP_ERROR_NULL, "no map");
    CHECK(memcmp(&prepared, &zero, sizeof zero) == 0, "not zeroed");
    CHECK(conemap_prepare(&map, NULL, NULL) == CONEMAP_ERROR_NULL, "nowhere to put it");
    desc.isa = CONEMAP_ISA_COUNT;
    CHECK(conemap_prepare(&map, &desc, &prepared) == CONEMAP_ERROR_ENUM, "no such instruction set");
    desc.isa = CONEMAP_ISA_DEFAULT;
    desc.allocator.allocate = count_down;
    CHECK(conemap_prepare(&map, &desc, &prepared) == CONEMAP_ERROR_NULL, "half an allocator");
    desc.allocator.release = count_release;
    for (k = 0; k < 3; ++k) {
        allowed = (size_t)k;
        releases = 0;
        CHECK(conemap_prepare(&map, &desc, &prepared) == (k < 2 ? CONEMAP_ERROR_MEMORY : CONEMAP_OK), "allocation %d", k);
        if (k < 2) CHECK(memcmp(&prepared, &zero, sizeof zero) == 0, "not zeroed");
        conemap_free_prepared(&prepared);
        CHECK(releases == k, "%d of %d released", releases, k);
    }
    wide = map;
    wide.info.width = (1 << 21) + 2;
    CHECK(conemap_prepare(&wide, NULL, &prepared) == CONEMAP_ERROR_OVERFLOW, "too wide");
    CHECK(memcmp(&prepared, &zero, sizeof zero) == 0, "not zeroed");
    size = conemap_prepare_memory(&map);
    CHECK(size == 15 * 8 * 8 && conemap_prepare_memory(NULL) == 0, "%lu bytes", (unsigned long)size);
    memory = (unsigned char *)test_alloc(size);
    memset(&desc, 0, sizeof desc);
    desc.memory = memory;
    desc.memory_size = size - 1;
    CHECK(conemap_prepare(&map, &desc, &prepared) == CONEMAP_ERROR_BUFFER, "a byte too few");
    desc.memory_size = size;
    CHECK(conemap_prepare(&map, &desc, &prepared) == CONEMAP_OK, "own memory");
    CHECK(conemap_trace_prepared(&prepared, NULL, hits, 1) == CONEMAP_ERROR_NULL, "no rays");
    CHECK(conemap_trace_prepared(&prepared, rays, NULL, 1) == CONEMAP_ERROR_NULL, "no hits");
    CHECK(conemap_trace_prepared(&prepared, NULL, NULL, 0) == CONEMAP_OK, "nothing asked for");
    CHECK(conemap_trace_prepared(&prepared, rays, hits, -1) == CONEMAP_ERROR_PARAMETER, "fewer than none");
    CHECK(conemap_trace_prepared(&prepared, rays, hits, 1) == CONEMAP_ERROR_RAY_DIRECTION, "no direction");
    CHECK(hits[0].status == CONEMAP_INVALID, "status %d", (int)hits[0].status);
    CHECK(conemap_trace_prepared(&zero, rays, hits, 1) == CONEMAP_ERROR_NULL, "not prepared");
    CHECK(conemap_trace_prepared(NULL, rays, hits, 1) == CONEMAP_ERROR_NULL, "not prepared");
    CHECK(conemap_trace_arrays(&prepared, &in, &out, 1) == CONEMAP_ERROR_NULL, "no arrays");
    CHECK(conemap_trace_arrays(&prepared, &in, &out, 0) == CONEMAP_OK, "nothing asked for");
    conemap_free_prepared(&prepared);
    conemap_free_prepared(&prepared);
    conemap_free_prepared(NULL);
    test_release(memory);
    conemap_free(&map);
}

/* The same rays are invalid as to conemap_trace, whichever number is odd, and a stream's first one is told of. */
static void odd_rays(void)
{
    const float odd[] = {(float)NAN, (float)INFINITY, -(float)INFINITY, -1.0f, -0.0f, 1e-40f, 3e38f};
    enum { ODD = (int)(sizeof odd / sizeof *odd), COUNT = 8 * ODD };
    conemap_map map;
    int isa, k, c;
    if (!build(ZOO_FBM, 17, 16, 0, 4u, &map)) return;
    for (k = 0; k < COUNT; ++k) {
        conemap_ray *ray = &rays[k];
        float value = odd[k % ODD];
        for (c = 0; c < 3; ++c) {
            ray->origin[c] = k / ODD == c ? value : 0.5f;
            ray->direction[c] = k / ODD == 3 + c ? value : 0.0f;
        }
        if (k / ODD != 5 && k / ODD != 4) ray->direction[2] = -1.0f; /* else there may be no direction */
        ray->t_min = k / ODD == 6 ? value : 0.25f;
        ray->t_max = k / ODD == 7 ? value : 0.0f;
    }
    for (isa = CONEMAP_ISA_SCALAR; isa < CONEMAP_ISA_COUNT; ++isa) {
        conemap_prepare_desc desc;
        conemap_prepared prepared;
        memset(&desc, 0, sizeof desc);
        desc.isa = (conemap_isa)isa;
        if (!conemap_isa_available(desc.isa)) continue;
        REQUIRE(conemap_prepare(&map, &desc, &prepared) == CONEMAP_OK, "prepare");
        for (k = 0; k < COUNT; ++k) {
            conemap_result right = conemap_trace(&map, NULL, &rays[k], expected, COUNT - k);
            CHECK(conemap_trace_prepared(&prepared, &rays[k], hits, COUNT - k) == right, "isa %d: rays from %d", isa, k);
            CHECK((hits[0].status == CONEMAP_INVALID) == (expected[0].status == CONEMAP_INVALID),
                  "isa %d: ray %d: status %d", isa, k, (int)hits[0].status);
            CHECK(hits[0].status != CONEMAP_INVALID || memcmp(hits, expected, sizeof *hits) == 0,
                  "isa %d: ray %d: more than a status", isa, k);
        }
        conemap_free_prepared(&prepared);
    }
    conemap_free(&map);
}

const struct test_case packets_tests[] = {
    {"the exact tracer's hits", same_hits},
    {"peaks", peaks},
    {"far flights", far_flights},
    {"whatever the cones", any_cones},
    {"the same bits everywhere", same_bits},
    {"odd rays", odd_rays},
    {"bad input", bad_input},
    {NULL, NULL},
};
