/* Builds: memory, failures, cancelling, jobs in any order. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

#define W 45
#define H 70
#define TEXELS (W * H)

static float heights[TEXELS];

static conemap_desc plain_desc(void)
{
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    zoo_fill(ZOO_FBM, W, H, 2, heights);
    desc.heights.pixels = heights;
    desc.heights.width = W;
    desc.heights.height = H;
    desc.wrap_u = CONEMAP_WRAP;
    return desc;
}

/* Descs that take different ways through the passes. */
static conemap_desc variant(int k)
{
    static const conemap_generator generators[] = {CONEMAP_EXACT,  CONEMAP_RING,  CONEMAP_RELAXED,
                                                   CONEMAP_HYBRID, CONEMAP_QUICK, CONEMAP_QUICK_NAIVE};
    conemap_desc desc = plain_desc();
    desc.generator = generators[k % 6];
    desc.min3x3 = k & 1;
    desc.keep_pyramid = k >> 1 & 1;
    desc.texture.format = (conemap_format)(k % CONEMAP_FORMAT_COUNT);
    desc.texture.layout = (conemap_layout)(k % CONEMAP_LAYOUT_COUNT);
    return desc;
}
#define VARIANTS 12

static int same(const conemap_map *a, const conemap_map *b)
{
    return a->info.width == b->info.width && a->info.height == b->info.height &&
           a->info.height_hash == b->info.height_hash && a->info.guarantee == b->info.guarantee &&
           !memcmp(a->heights, b->heights, sizeof(float) * TEXELS) &&
           !memcmp(a->cones, b->cones, sizeof(float) * TEXELS);
}

static int is_zeroed(const conemap_map *map)
{
    return !map->heights && !map->cones && !map->memory_size && !map->info.width && !map->info.height &&
           !map->cells.levels;
}

/* ---- an allocator that counts, guards its blocks and can fail ---- */

struct keeper {
    int calls, alive, fail_at, foreign;
    size_t bytes, most;
    void *user_seen;
};

static void *keeper_allocate(size_t size, void *user)
{
    struct keeper *keeper = (struct keeper *)user;
    char *memory;
    if (++keeper->calls == keeper->fail_at) return NULL;
    memory = (char *)test_alloc(size + 16);
    memcpy(memory, &size, sizeof size);
    keeper->bytes += size;
    if (keeper->bytes > keeper->most) keeper->most = keeper->bytes;
    ++keeper->alive;
    return memory + 16;
}

static void keeper_release(void *memory, void *user)
{
    struct keeper *keeper = (struct keeper *)user;
    size_t size;
    if (!memory) return;
    memcpy(&size, (char *)memory - 16, sizeof size);
    keeper->bytes -= size;
    --keeper->alive;
    test_release((char *)memory - 16);
}

static void keep(conemap_desc *desc, struct keeper *keeper)
{
    memset(keeper, 0, sizeof *keeper);
    desc->allocator.allocate = keeper_allocate;
    desc->allocator.release = keeper_release;
    desc->allocator.user = keeper;
}

static void allocators(void)
{
    int k;
    for (k = 0; k < VARIANTS; ++k) {
        struct keeper keeper;
        conemap_desc desc = variant(k);
        conemap_map map;
        size_t memory = 0, scratch = 0;
        int calls;
        keep(&desc, &keeper);
        CHECK(conemap_memory(&desc, &memory, &scratch) == CONEMAP_OK && memory > 0, "variant %d: sizes", k);
        CHECK(keeper.calls == 0, "asking for sizes allocates");
        memset(&map, 0x3c, sizeof map);
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "variant %d", k);
        CHECK(keeper.bytes == memory && map.memory_size == memory, "variant %d: holds %d, said %d and %d", k,
              (int)keeper.bytes, (int)memory, (int)map.memory_size);
        CHECK(keeper.most <= memory + scratch, "variant %d: took %d, said %d", k, (int)keeper.most,
              (int)(memory + scratch));
        calls = keeper.calls;
        conemap_free(&map);
        CHECK(keeper.alive == 0 && is_zeroed(&map), "variant %d: %d blocks stay", k, keeper.alive);
        conemap_free(&map);
        conemap_free(NULL);

        for (keep(&desc, &keeper); keeper.fail_at < calls;) {
            const int fail_at = keeper.fail_at + 1;
            keep(&desc, &keeper);
            keeper.fail_at = fail_at;
            memset(&map, 0x3c, sizeof map);
            CHECK(conemap_build(&desc, &map) == CONEMAP_ERROR_MEMORY, "variant %d: allocation %d fails", k,
                  fail_at);
            CHECK(keeper.alive == 0 && is_zeroed(&map), "variant %d: allocation %d fails, %d stay", k,
                  fail_at, keeper.alive);
            memset(&map, 0x3c, sizeof map);
            keeper.calls = 0;
            CHECK(conemap_begin(&desc, &map) == CONEMAP_ERROR_MEMORY && keeper.alive == 0 && is_zeroed(&map),
                  "variant %d: allocation %d fails in begin", k, fail_at);
        }
    }
}

static void allocators_of_loading(void)
{
    conemap_desc desc = plain_desc(), options;
    conemap_map map, loaded;
    struct keeper keeper;
    unsigned char *bytes;
    size_t size;
    int calls, fail_at;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    size = conemap_save_size(&map);
    bytes = (unsigned char *)test_alloc(size);
    CHECK(conemap_save(&map, bytes, size) == CONEMAP_OK, "save");
    memset(&options, 0, sizeof options);
    options.keep_pyramid = 1;
    keep(&options, &keeper);
    if (CHECK(conemap_load(bytes, size, &options, &loaded) == CONEMAP_OK, "load")) {
        CHECK(same(&loaded, &map), "another map");
        CHECK(loaded.memory_size == keeper.bytes, "holds %d, says %d", (int)keeper.bytes,
              (int)loaded.memory_size);
        conemap_free(&loaded);
    }
    CHECK(keeper.alive == 0, "%d stay", keeper.alive);
    calls = keeper.calls;
    for (fail_at = 1; fail_at <= calls; ++fail_at) {
        keep(&options, &keeper);
        keeper.fail_at = fail_at;
        CHECK(conemap_load(bytes, size, &options, &loaded) == CONEMAP_ERROR_MEMORY && keeper.alive == 0 &&
                  is_zeroed(&loaded),
              "allocation %d fails", fail_at);
    }
    test_release(bytes);
    conemap_free(&map);
}

static char *aligned(char *memory)
{
    return memory + (CONEMAP_ALIGNMENT - (uintptr_t)memory % CONEMAP_ALIGNMENT) % CONEMAP_ALIGNMENT;
}

/* Exactly the bytes asked for, between guard bytes; one byte less is refused. */
static void caller_memory(void)
{
    int k;
    for (k = 0; k < VARIANTS; ++k) {
        conemap_desc desc = variant(k);
        conemap_map map, right;
        size_t memory = 0, scratch = 0, n;
        char *held, *worked;
        int spoiled = 0;
        REQUIRE(conemap_build(&desc, &right) == CONEMAP_OK, "variant %d", k);
        CHECK(conemap_memory(&desc, &memory, &scratch) == CONEMAP_OK, "variant %d: sizes", k);
        CHECK(conemap_memory(&desc, NULL, NULL) == CONEMAP_OK, "sizes to nowhere");
        held = (char *)test_alloc(memory + 3 * CONEMAP_ALIGNMENT);
        worked = (char *)test_alloc(scratch + 3 * CONEMAP_ALIGNMENT);
        desc.memory = aligned(held) + CONEMAP_ALIGNMENT;
        desc.memory_size = memory;
        desc.scratch = aligned(worked) + CONEMAP_ALIGNMENT;
        desc.scratch_size = scratch;
        if (CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "variant %d: caller memory", k)) {
            CHECK(same(&map, &right), "variant %d: other bits", k);
            CHECK((const char *)map.cones >= (char *)desc.memory &&
                      (const char *)map.cones < (char *)desc.memory + memory,
                  "variant %d: the cones are elsewhere", k);
            for (n = 0; n < CONEMAP_ALIGNMENT; ++n) {
                spoiled += ((char *)desc.memory)[-1 - (ptrdiff_t)n] != (char)0xa5;
                spoiled += ((char *)desc.memory)[memory + n] != (char)0xa5;
                spoiled += ((char *)desc.scratch)[-1 - (ptrdiff_t)n] != (char)0xa5;
                spoiled += ((char *)desc.scratch)[scratch + n] != (char)0xa5;
            }
            CHECK(!spoiled, "variant %d: %d bytes around the caller's memory were written", k, spoiled);
            /* the scratch is free for other use once the map is built */
            memset(desc.scratch, 0x77, scratch);
            CHECK(same(&map, &right), "variant %d: the map lives in the scratch", k);
            conemap_free(&map);
        }
        desc.memory_size = memory - 1;
        CHECK(conemap_build(&desc, &map) == CONEMAP_ERROR_BUFFER && is_zeroed(&map),
              "variant %d: a byte less", k);
        desc.memory_size = memory;
        if (scratch) {
            desc.scratch_size = scratch - 1;
            CHECK(conemap_build(&desc, &map) == CONEMAP_ERROR_BUFFER && is_zeroed(&map),
                  "variant %d: a byte of scratch less", k);
            desc.scratch_size = scratch;
            desc.scratch = (char *)desc.scratch + 1;
            CHECK(conemap_build(&desc, &map) == CONEMAP_ERROR_ALIGNMENT && is_zeroed(&map),
                  "variant %d: scratch out of line", k);
            desc.scratch = (char *)desc.scratch - 1;
        }
        desc.memory = (char *)desc.memory + CONEMAP_ALIGNMENT / 2;
        CHECK(conemap_build(&desc, &map) == CONEMAP_ERROR_ALIGNMENT && is_zeroed(&map),
              "variant %d: out of line", k);
        test_release(held);
        test_release(worked);
        conemap_free(&right);
    }
}

/* ---- progress ---- */

struct watch {
    int calls, stop_at, backwards;
    double last;
};

static int watch_progress(double done, void *user)
{
    struct watch *watch = (struct watch *)user;
    if (!(done >= watch->last && done <= 1.0)) ++watch->backwards;
    watch->last = done;
    return ++watch->calls == watch->stop_at;
}

static void progress(void)
{
    int k;
    for (k = 0; k < VARIANTS; ++k) {
        conemap_desc desc = variant(k);
        conemap_map map, right;
        struct keeper keeper;
        struct watch watch;
        int calls, stop, part;
        REQUIRE(conemap_build(&desc, &right) == CONEMAP_OK, "variant %d", k);
        memset(&watch, 0, sizeof watch);
        keep(&desc, &keeper);
        desc.progress = watch_progress;
        desc.progress_user = &watch;
        if (CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "variant %d: watched", k)) {
            CHECK(same(&map, &right), "variant %d: watched, other bits", k);
            conemap_free(&map);
        }
        calls = watch.calls;
        CHECK(calls >= 5, "variant %d: %d calls", k, calls);
        CHECK(!watch.backwards, "variant %d: %d times backwards or beyond 1", k, watch.backwards);
        CHECK(watch.last == 1.0, "variant %d: ends at %g", k, watch.last);
        for (part = 0; part <= 7; ++part) { /* from the first call to the last */
            stop = 1 + (calls - 1) * part / 7;
            memset(&watch, 0, sizeof watch);
            watch.stop_at = stop;
            memset(&map, 0x3c, sizeof map);
            CHECK(conemap_build(&desc, &map) == CONEMAP_CANCELLED, "variant %d: stopped at call %d", k, stop);
            CHECK(keeper.alive == 0 && is_zeroed(&map), "variant %d: stopped, %d blocks stay", k,
                  keeper.alive);
            CHECK(watch.calls == stop, "variant %d: %d calls after the stop", k, watch.calls - stop);
        }
        conemap_free(&right);
    }
}

/* ---- jobs ---- */

static void run_pass(conemap_map *map, int pass, int order, int k)
{
    const int count = conemap_job_count(map, pass);
    int job;
    CHECK(count >= 0, "variant %d pass %d: %d jobs", k, pass, count);
    for (job = 0; job < count; ++job) {
        int at = job;
        if (order == 1) at = count - 1 - job;
        if (order == 2) at = job % 2 ? count - 1 - job / 2 : job / 2;
        if (order == 3 && count > 1)
            at = (int)(((int64_t)job * 7919) % count); /* 7919 is prime: a permutation */
        CHECK(conemap_run_job(map, pass, at) == CONEMAP_OK, "variant %d pass %d job %d", k, pass, at);
    }
}

static void job_orders(void)
{
    int k, order, pass, jobs = 0;
    for (k = 0; k < VARIANTS; ++k) {
        conemap_desc desc = variant(k);
        conemap_map map, right;
        REQUIRE(conemap_build(&desc, &right) == CONEMAP_OK, "variant %d", k);
        for (order = 0; order < 4; ++order) {
            if (!CHECK(conemap_begin(&desc, &map) == CONEMAP_OK, "variant %d: begin", k)) continue;
            for (pass = 0; pass < conemap_pass_count(&map); ++pass) {
                jobs += conemap_job_count(&map, pass);
                run_pass(&map, pass, order, k);
            }
            if (CHECK(conemap_end(&map) == CONEMAP_OK, "variant %d: end", k)) {
                CHECK(same(&map, &right), "variant %d, order %d: other bits", k, order);
                conemap_free(&map);
            }
        }
        conemap_free(&right);
    }
    CHECK(jobs > 4 * VARIANTS * 4, "%d jobs: nothing to be split", jobs);
}

static void two_builds_interleaved(void)
{
    conemap_desc a = variant(1), b = variant(6);
    conemap_map map_a, map_b, right_a, right_b;
    int pass, job;
    REQUIRE(conemap_build(&a, &right_a) == CONEMAP_OK && conemap_build(&b, &right_b) == CONEMAP_OK, "alone");
    REQUIRE(conemap_begin(&a, &map_a) == CONEMAP_OK && conemap_begin(&b, &map_b) == CONEMAP_OK, "begin");
    for (pass = 0; pass < conemap_pass_count(&map_a) || pass < conemap_pass_count(&map_b); ++pass) {
        const int jobs_a = pass < conemap_pass_count(&map_a) ? conemap_job_count(&map_a, pass) : 0;
        const int jobs_b = pass < conemap_pass_count(&map_b) ? conemap_job_count(&map_b, pass) : 0;
        for (job = 0; job < jobs_a || job < jobs_b; ++job) {
            if (job < jobs_a) CHECK(conemap_run_job(&map_a, pass, job) == CONEMAP_OK, "a %d %d", pass, job);
            if (job < jobs_b)
                CHECK(conemap_run_job(&map_b, pass, jobs_b - 1 - job) == CONEMAP_OK, "b %d %d", pass, job);
        }
    }
    if (CHECK(conemap_end(&map_a) == CONEMAP_OK, "end a")) CHECK(same(&map_a, &right_a), "a: other bits");
    if (CHECK(conemap_end(&map_b) == CONEMAP_OK, "end b")) CHECK(same(&map_b, &right_b), "b: other bits");
    conemap_free(&map_a);
    conemap_free(&map_b);
    conemap_free(&right_a);
    conemap_free(&right_b);
}

static void jobs_left_out(void)
{
    struct keeper keeper;
    conemap_desc desc = variant(3);
    conemap_map map;
    int pass, passes, skipped;
    REQUIRE(conemap_begin(&desc, &map) == CONEMAP_OK, "begin");
    passes = conemap_pass_count(&map);
    CHECK(conemap_run_job(&map, -1, 0) == CONEMAP_ERROR_ORDER, "pass -1");
    CHECK(conemap_run_job(&map, passes, 0) == CONEMAP_ERROR_ORDER, "a pass too far");
    CHECK(conemap_run_job(&map, 0, -1) == CONEMAP_ERROR_ORDER, "job -1");
    CHECK(conemap_run_job(&map, 0, conemap_job_count(&map, 0)) == CONEMAP_ERROR_ORDER, "a job too far");
    CHECK(conemap_job_count(&map, -1) == 0 && conemap_job_count(&map, passes) == 0, "jobs of no pass");
    CHECK(conemap_run_job(NULL, 0, 0) == CONEMAP_ERROR_NULL, "no map");
    CHECK(conemap_pass_count(NULL) == 0 && conemap_job_count(NULL, 0) == 0, "passes of nothing");
    conemap_free(&map);

    for (skipped = 0; skipped < passes; ++skipped) {
        keep(&desc, &keeper);
        if (!CHECK(conemap_begin(&desc, &map) == CONEMAP_OK, "begin")) continue;
        if (conemap_job_count(&map, skipped) == 0) {
            conemap_free(&map);
            continue;
        }
        for (pass = 0; pass < passes; ++pass) {
            int job, left_out = pass == skipped ? conemap_job_count(&map, pass) / 2 : -1;
            for (job = 0; job < conemap_job_count(&map, pass); ++job) {
                if (job != left_out) (void)conemap_run_job(&map, pass, job);
            }
        }
        CHECK(conemap_end(&map) == CONEMAP_ERROR_ORDER, "a job of pass %d left out", skipped);
        CHECK(keeper.alive == 0 && is_zeroed(&map), "a job of pass %d left out: %d blocks stay", skipped,
              keeper.alive);
    }

    keep(&desc, &keeper);
    REQUIRE(conemap_begin(&desc, &map) == CONEMAP_OK, "begin");
    CHECK(conemap_end(&map) == CONEMAP_ERROR_ORDER && keeper.alive == 0, "ended at once");
    REQUIRE(conemap_begin(&desc, &map) == CONEMAP_OK, "begin");
    run_pass(&map, 0, 0, 0);
    conemap_free(&map);
    CHECK(keeper.alive == 0 && is_zeroed(&map), "given up: %d blocks stay", keeper.alive);
    memset(&map, 0, sizeof map);
    CHECK(conemap_end(&map) != CONEMAP_OK && conemap_end(NULL) == CONEMAP_ERROR_NULL,
          "ended without a begin");
}

/* A bad height is found by some job of the first pass, and told by end. */
static void jobs_that_fail(void)
{
    struct keeper keeper;
    conemap_desc desc = variant(1);
    conemap_map map;
    int pass, job, failed = 0;
    heights[TEXELS - 7] = 1.5f;
    keep(&desc, &keeper);
    heights[TEXELS - 7] = 1.5f;
    REQUIRE(conemap_begin(&desc, &map) == CONEMAP_OK, "begin");
    for (pass = 0; pass < conemap_pass_count(&map); ++pass) {
        for (job = 0; job < conemap_job_count(&map, pass); ++job) {
            const conemap_result result = conemap_run_job(&map, pass, job);
            failed += pass == 0 && result == CONEMAP_ERROR_HEIGHT;
        }
    }
    CHECK(failed == 1, "%d jobs tell of the height", failed);
    CHECK(conemap_end(&map) == CONEMAP_ERROR_HEIGHT && keeper.alive == 0 && is_zeroed(&map),
          "end tells of the height");
    CHECK(conemap_build(&desc, &map) == CONEMAP_ERROR_HEIGHT && keeper.alive == 0 && is_zeroed(&map),
          "so does build");
}

/* ---- parallel_for ---- */

struct crew {
    int calls, jobs;
};

static void backwards_for(int count, conemap_job *job, void *context, void *user)
{
    struct crew *crew = (struct crew *)user;
    int k;
    ++crew->calls;
    crew->jobs += count;
    for (k = count - 1; k >= 0; --k) job(context, k);
}

static void parallel_for(void)
{
    int k;
    for (k = 0; k < VARIANTS; ++k) {
        conemap_desc desc = variant(k);
        conemap_map map, right;
        struct crew crew = {0, 0};
        struct watch watch;
        REQUIRE(conemap_build(&desc, &right) == CONEMAP_OK, "variant %d", k);
        desc.parallel_for = backwards_for;
        desc.parallel_user = &crew;
        if (CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "variant %d: in parallel", k)) {
            CHECK(same(&map, &right), "variant %d: other bits", k);
            CHECK(crew.calls >= 1 && crew.jobs > crew.calls, "variant %d: %d jobs in %d calls", k, crew.jobs,
                  crew.calls);
            conemap_free(&map);
        }
        memset(&watch, 0, sizeof watch);
        watch.stop_at = 2;
        desc.progress = watch_progress;
        desc.progress_user = &watch;
        CHECK(conemap_build(&desc, &map) == CONEMAP_CANCELLED && is_zeroed(&map), "variant %d: cancelled", k);
        conemap_free(&right);
    }
}

/* What a map is built from may go away afterwards. */
static void input_may_go(void)
{
    conemap_desc desc = plain_desc();
    conemap_map map, right;
    float *copy = (float *)test_alloc(sizeof heights);
    memcpy(copy, heights, sizeof heights);
    REQUIRE(conemap_build(&desc, &right) == CONEMAP_OK, "build");
    desc.heights.pixels = copy;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build of a copy");
    CHECK(!memcmp(copy, heights, sizeof heights), "the input was written");
    memset(copy, 0xff, sizeof heights);
    test_release(copy);
    memset(&desc, 0xff, sizeof desc);
    CHECK(same(&map, &right), "the map reads its input later on");
    conemap_free(&map);
    conemap_free(&right);
}

/* Heights and maxima without a search: cones have no width in any format, and whatever traces agrees with safe ones. */
static void heights_alone(void)
{
    static const conemap_tracer tracers[] = {CONEMAP_TRACE_EXACT, CONEMAP_TRACE_MAXMIP};
    struct zoo_random random = zoo_seed(4);
    int format, encoding, k, n, hits = 0;
    for (format = 0; format < CONEMAP_FORMAT_COUNT; ++format)
        for (encoding = 0; encoding < CONEMAP_ENCODING_COUNT; ++encoding) {
            conemap_desc desc = plain_desc();
            conemap_map map, safe;
            conemap_report report;
            desc.keep_pyramid = 1;
            desc.min3x3 = encoding & 1;
            desc.texture.format = (conemap_format)format;
            desc.texture.encoding = (conemap_encoding)encoding;
            REQUIRE(conemap_build(&desc, &safe) == CONEMAP_OK, "build");
            desc.generator = CONEMAP_HEIGHTS;
            REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build of heights");
            CHECK(map.info.generator == CONEMAP_HEIGHTS && map.info.guarantee == CONEMAP_GUARANTEE_BILINEAR, "promise %d",
                  (int)map.info.guarantee);
            CHECK(!memcmp(map.heights, safe.heights, sizeof(float) * TEXELS) && map.highest == safe.highest, "heights");
            for (k = 0; k < TEXELS; ++k)
                if (!CHECK(map.cones[k] == 0.0f, "format %d: cone %g", format, (double)map.cones[k])) break;
            REQUIRE(conemap_verify(&map.info, map.heights, map.cones, NULL, &report) == CONEMAP_OK, "verify");
            CHECK(report.unsafe == 0 && report.unproven == 0, "%d unsafe", (int)report.unsafe);
            for (n = 0; n < 200; ++n) {
                conemap_trace_desc trace;
                conemap_ray ray;
                conemap_hit hit, right;
                memset(&trace, 0, sizeof trace);
                memset(&ray, 0, sizeof ray);
                for (k = 0; k < 3; ++k) ray.origin[k] = k < 2 ? zoo_unit(&random) : 1.0f;
                for (k = 0; k < 3; ++k) ray.direction[k] = k < 2 ? zoo_between(&random, -1.0f, 1.0f) : -0.4f;
                REQUIRE(conemap_trace(&safe, NULL, &ray, &right, 1) == CONEMAP_OK, "trace");
                for (k = 0; k < 2; ++k) {
                    trace.tracer = tracers[k];
                    REQUIRE(conemap_trace(&map, &trace, &ray, &hit, 1) == CONEMAP_OK, "trace");
                    CHECK(hit.status == right.status && fabsf(hit.t - right.t) < 1e-5f,
                          "tracer %d: status %d at %g, right %d at %g",
                          (int)tracers[k], (int)hit.status, (double)hit.t, (int)right.status, (double)right.t);
                }
                hits += right.status == CONEMAP_HIT;
            }
            conemap_free(&map);
            conemap_free(&safe);
        }
    CHECK(hits > 500, "%d hits", hits);
    {
        conemap_desc desc = plain_desc();
        conemap_map map;
        desc.generator = CONEMAP_HEIGHTS;
        desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
        CHECK(conemap_build(&desc, &map) == CONEMAP_ERROR_UNSUPPORTED, "another guarantee");
        desc.guarantee = CONEMAP_GUARANTEE_DEFAULT;
        desc.texture.sectors = 4;
        CHECK(conemap_build(&desc, &map) == CONEMAP_ERROR_UNSUPPORTED, "sectors");
    }
}

const struct test_case builds_tests[] = {
    {"heights alone", heights_alone},
    {"allocators, and each allocation failing", allocators},
    {"allocators of loading", allocators_of_loading},
    {"caller memory, to the byte", caller_memory},
    {"progress and cancelling", progress},
    {"jobs in any order", job_orders},
    {"two builds at once", two_builds_interleaved},
    {"jobs left out", jobs_left_out},
    {"jobs that fail", jobs_that_fail},
    {"parallel_for", parallel_for},
    {"the input may go away", input_may_go},
    {NULL, NULL},
};
