/* bench [NAME]: speed, one line per figure: `name value unit`. Times are medians of interleaved rounds; a figure named
   a/b is the ratio of two times measured in the same rounds. NAME keeps the figures whose name holds it. */
#define CONEMAP_IMPLEMENTATION
#include "common.h"
#include "measure.h"
#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#define HAVE_THREADS
#endif

static const char *wanted = "";
static struct progress progress;
static double parts_done, parts;

static double median_ratio(const double *a, const double *b) {
    double ratios[ROUNDS];
    for (int r = 0; r < ROUNDS; ++r) ratios[r] = a[r] / b[r];
    return median(ratios);
}

static void figure(const char *name, const char *map, double value, const char *unit) {
    char full[128];
    snprintf(full, sizeof full, "%s.%s", name, map);
    if (!strstr(full, wanted)) return;
    progress_end(&progress);
    printf("%-44s %10.3f %s\n", full, value, unit);
    fflush(stdout);
}

/* A figure with what it should reach. */
static void goal(const char *name, const char *map, double value, int at_most, double bar) {
    char text[64];
    snprintf(text, sizeof text, "ratio, goal %s %g: %s", at_most ? "<=" : ">=", bar,
             (at_most ? value <= bar : value >= bar) ? "met" : "missed");
    figure(name, map, value, text);
}

/* Does this part of the bench hold wanted figures? A NAME that begins with a part's name is only in that part. */
static const char *const part_names[] = {"build.", "trace.", "lanes.", "update.", "trace1024.", "frusta.", "effect."};

static int is_wanted(const char *part) {
    for (size_t k = 0; k < sizeof part_names / sizeof part_names[0]; ++k)
        if (*wanted && (strncmp(part_names[k], wanted, strlen(part_names[k])) == 0 ||
                        strncmp(part_names[k], wanted, strlen(wanted)) == 0))
            return strncmp(part, wanted, strlen(part)) == 0 || strncmp(part, wanted, strlen(wanted)) == 0;
    return 1;
}

static void part_done(void) {
    parts_done += 1.0;
    progress_show(parts_done / parts, &progress);
}

static void describe(conemap_desc *desc, const struct image *image) {
    memset(desc, 0, sizeof *desc);
    desc->heights.pixels = image->pixels;
    desc->heights.format = image->format;
    desc->heights.width = image->width;
    desc->heights.height = image->height;
    desc->keep_pyramid = 1;
}

static int bench_generators(const char *map_name, const struct image *image) {
    static const conemap_generator generators[] = {CONEMAP_RING,  CONEMAP_QUICK_NAIVE,  CONEMAP_QUICK,
                                                   CONEMAP_EXACT, CONEMAP_QUICK_CENTER, CONEMAP_RELAXED};
    enum { COUNT = sizeof generators / sizeof generators[0], QUICK_AT = 2 };
    double times[COUNT][ROUNDS], texels = (double)image->width * (double)image->height;
    for (int r = 0; r < ROUNDS; ++r)
        for (int g = 0; g < COUNT; ++g) {
            conemap_desc desc;
            conemap_map map;
            describe(&desc, image);
            desc.generator = generators[g];
            double start = now();
            conemap_result result = conemap_build(&desc, &map);
            times[g][r] = now() - start;
            if (result != CONEMAP_OK) return fail_result("build", result);
            conemap_free(&map);
            part_done();
        }
    for (int g = 0; g < COUNT; ++g) {
        char name[64];
        snprintf(name, sizeof name, "build.%s", name_of(generator_names, (int)generators[g]));
        figure(name, map_name, median(times[g]) / texels * 1e9, "ns/texel");
        if (g == QUICK_AT) continue;
        snprintf(name, sizeof name, "build.%s/quick", name_of(generator_names, (int)generators[g]));
        figure(name, map_name, median_ratio(times[g], times[QUICK_AT]), "ratio");
    }
    return 1;
}

/* ---- generation in lanes: make bench BENCH=lanes -------------------------------------------------------------- */

struct variant {
    const char *name;
    conemap_isa isa;
    conemap_generator generator;
    conemap_guarantee guarantee;
    float slack;
};

enum { QUICK_WIDE, EXACT_WIDE, SLACK_WIDE, SAFE_WIDE, QUICK_PLAIN, EXACT_PLAIN, VARIANTS };
static const struct variant variants[VARIANTS] = {
    {"quick", CONEMAP_ISA_DEFAULT, CONEMAP_QUICK, CONEMAP_GUARANTEE_DEFAULT, 0.0f},
    {"exact", CONEMAP_ISA_DEFAULT, CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0.0f},
    {"slack", CONEMAP_ISA_DEFAULT, CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0.1f},
    {"safe", CONEMAP_ISA_DEFAULT, CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0.0f},
    {"plain-quick", CONEMAP_ISA_SCALAR, CONEMAP_QUICK, CONEMAP_GUARANTEE_DEFAULT, 0.0f},
    {"plain-exact", CONEMAP_ISA_SCALAR, CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0.0f},
};

/* The set that the goals speak of, where there is one. */
static conemap_isa wide_isa(void) {
    return conemap_isa_available(CONEMAP_ISA_AVX2) ? CONEMAP_ISA_AVX2 : CONEMAP_ISA_DEFAULT;
}

static int timed_build(const struct image *image, const struct variant *variant, double *time, double *mean_tan) {
    conemap_desc desc;
    conemap_map map;
    describe(&desc, image);
    desc.keep_pyramid = 0;
    desc.isa = variant->isa == CONEMAP_ISA_SCALAR ? CONEMAP_ISA_SCALAR : wide_isa();
    desc.generator = variant->generator;
    desc.guarantee = variant->guarantee;
    desc.slack = variant->slack;
    double start = now();
    conemap_result result = conemap_build(&desc, &map);
    *time = now() - start;
    if (result != CONEMAP_OK) return fail_result("build", result);
    size_t count = (size_t)image->width * (size_t)image->height;
    *mean_tan = 0.0;
    for (size_t k = 0; k < count; ++k)
        *mean_tan += map.cones[k] < 1.0f ? (double)map.cones[k] / (double)count : 1.0 / (double)count;
    conemap_free(&map);
    part_done();
    return 1;
}

static int bench_lanes(const char *map_name, const struct image *image) {
    double times[VARIANTS][ROUNDS], means[VARIANTS], texels = (double)image->width * (double)image->height;
    for (int r = 0; r < ROUNDS; ++r)
        for (int v = 0; v < VARIANTS; ++v)
            if (!timed_build(image, &variants[v], &times[v][r], &means[v])) return 0;
    for (int v = 0; v < VARIANTS; ++v) {
        char name[64];
        snprintf(name, sizeof name, "lanes.%s", variants[v].name);
        figure(name, map_name, median(times[v]) / texels * 1e9, "ns/texel");
    }
    goal("lanes.quick/exact", map_name, median_ratio(times[QUICK_WIDE], times[EXACT_WIDE]), 0, 1.0);
    goal("lanes.quick/slack", map_name, median_ratio(times[QUICK_WIDE], times[SLACK_WIDE]), 0, 1.5);
    goal("lanes.mean-tan-slack/quick", map_name, means[SLACK_WIDE] / means[QUICK_WIDE], 0, 1.0);
    goal("lanes.safe/exact", map_name, median_ratio(times[SAFE_WIDE], times[EXACT_WIDE]), 1, 1.5);
    goal("lanes.quick-plain/wide", map_name, median_ratio(times[QUICK_PLAIN], times[QUICK_WIDE]), 0, 4.0);
    goal("lanes.exact-plain/wide", map_name, median_ratio(times[EXACT_PLAIN], times[EXACT_WIDE]), 0, 4.0);
    goal("lanes.plain-exact/quick", map_name, median_ratio(times[EXACT_PLAIN], times[QUICK_PLAIN]), 1, 1.5);
    return 1;
}

/* Rows of the correction and of rounding to the format, by themselves. */
static int bench_rows(void) {
    enum { WIDTH = 1024, PASSES = 4000 };
    static float rows[3][WIDTH], out[WIDTH];
    double times[4][ROUNDS];
    conemap_info info;
    memset(&info, 0, sizeof info);
    info.max_tan = 1.0f;
    info.texture.format = CONEMAP_UNORM8;
    for (int x = 0; x < WIDTH; ++x)
        for (int k = 0; k < 3; ++k) rows[k][x] = (float)(hash3((uint32_t)x, (uint32_t)k, 3u) >> 8) / 16777216.0f;
    for (int r = 0; r < ROUNDS; ++r)
        for (int wide = 0; wide < 2; ++wide) {
            const conemap__kernels *kernels = conemap__kernels_of(conemap__best_isa());
            const float *three[3] = {rows[0], rows[1], rows[2]};
            if (conemap_isa_available(CONEMAP_ISA_AVX2)) kernels = conemap__kernels_of(CONEMAP_ISA_AVX2);
            if (!wide) kernels = conemap__kernels_of(CONEMAP_ISA_SCALAR);
            double start = now();
            for (int k = 0; k < PASSES; ++k) kernels->narrowest_row(three, WIDTH, 1, 0, WIDTH, out);
            times[wide][r] = now() - start;
            start = now();
            for (int k = 0; k < PASSES; ++k) kernels->store_row(&info, rows[0], rows[1], WIDTH, out);
            times[2 + wide][r] = now() - start;
        }
    goal("lanes.minimum-plain/wide", "row", median_ratio(times[0], times[1]), 0, 4.0);
    goal("lanes.quantise-plain/wide", "row", median_ratio(times[2], times[3]), 0, 4.0);
    return 1;
}

#ifdef HAVE_THREADS
struct crew {
    conemap_job *job;
    void *context;
    int count, first;
};

static void *work(void *argument) {
    struct crew *crew = (struct crew *)argument;
    for (int k = crew->first; k < crew->count; k += 2) crew->job(crew->context, k);
    return NULL;
}

static void in_two(int count, conemap_job *job, void *context, void *user) {
    struct crew crews[2] = {{job, context, count, 0}, {job, context, count, 1}};
    pthread_t other;
    (void)user;
    if (pthread_create(&other, NULL, work, &crews[1]) != 0) {
        work(&crews[1]);
        work(&crews[0]);
        return;
    }
    work(&crews[0]);
    pthread_join(other, NULL);
}

static double wall(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static int bench_threads(const struct image *image) {
    double times[2][ROUNDS];
    for (int r = 0; r < ROUNDS; ++r)
        for (int two = 0; two < 2; ++two) {
            conemap_desc desc;
            conemap_map map;
            describe(&desc, image);
            if (two) desc.parallel_for = in_two;
            double start = wall();
            conemap_result result = conemap_build(&desc, &map);
            times[two][r] = wall() - start;
            if (result != CONEMAP_OK) return fail_result("build", result);
            conemap_free(&map);
        }
    goal("lanes.one-thread/two", "fbm", median_ratio(times[0], times[1]), 0, 1.9);
    return 1;
}
#endif

/* Against the searches that define the results, and on a large smooth map. */
static int bench_large(void) {
    static const struct variant slow[] = {
        {"ring", CONEMAP_ISA_SCALAR, CONEMAP_RING, CONEMAP_GUARANTEE_DEFAULT, 0.0f},
        {"relaxed", CONEMAP_ISA_DEFAULT, CONEMAP_RELAXED_EXACT, CONEMAP_GUARANTEE_DEFAULT, 0.0f},
        {"relaxed-ring", CONEMAP_ISA_DEFAULT, CONEMAP_RELAXED_EXACT_RING, CONEMAP_GUARANTEE_DEFAULT, 0.0f}};
    struct image image;
    double exact[3], other[3], mean_tan;
    static const int sizes[3] = {512, 1024, 4096};
    for (int k = 2; k >= 0; --k) {
        double times[ROUNDS];
        if (!procedural_image(FBM, sizes[k], 1, &image)) return 0;
        for (int r = 0; r < ROUNDS; ++r)
            if (!timed_build(&image, &variants[EXACT_WIDE], &times[r], &mean_tan)) return 0;
        exact[k] = median(times) / (double)sizes[k] / (double)sizes[k];
        if (k > 0) image_free(&image);
    }
    for (int k = 0; k < 3; ++k) /* these take many times as long: once */
        if (!timed_build(&image, &slow[k], &other[k], &mean_tan)) return 0;
    image_free(&image);
    goal("lanes.fbm4096/fbm1024", "exact", exact[2] / exact[1], 1, 1.5);
    goal("lanes.ring/exact", "fbm512", other[0] / (exact[0] * 512.0 * 512.0), 0, 100.0);
    goal("lanes.relaxed-ring/relaxed", "fbm512", other[2] / other[1], 0, 50.0);
    return 1;
}

/* Cones of so many sectors, against those of all directions. */
static int bench_sectors(const char *map_name, const struct image *image) {
    static const int sectors[3] = {0, 4, 8};
    double times[3][ROUNDS];
    for (int r = 0; r < ROUNDS; ++r)
        for (int k = 0; k < 3; ++k) {
            conemap_desc desc;
            conemap_map map;
            describe(&desc, image);
            desc.keep_pyramid = 0;
            desc.isa = wide_isa();
            desc.texture.sectors = sectors[k];
            double start = now();
            conemap_result result = conemap_build(&desc, &map);
            times[k][r] = now() - start;
            if (result != CONEMAP_OK) return fail_result("build", result);
            conemap_free(&map);
            part_done();
        }
    goal("lanes.sectors-4/safe", map_name, median_ratio(times[1], times[0]), 1, 8.0);
    goal("lanes.sectors-8/safe", map_name, median_ratio(times[2], times[0]), 1, 12.0);
    return 1;
}

static int bench_all_lanes(void) {
    parts += 4.0 * ROUNDS * (double)VARIANTS + 3.0 * ROUNDS + 3.0 + 12.0 * ROUNDS;
    for (int kind = FBM; kind <= SPIKES + 1; ++kind) {
        struct image image;
        const char *name = kind > SPIKES ? "white" : name_of(procedural_names, kind);
        if (!procedural_image(kind > SPIKES ? FBM : kind, 1024, 1, &image)) return 0;
        for (uint32_t k = 0; kind > SPIKES && k < 1024u * 1024u; ++k)
            ((uint16_t *)image.pixels)[k] = (uint16_t)(hash3(k % 1024u, k / 1024u, 1u) >> 16);
        if (!bench_lanes(name, &image)) return 0;
#ifdef HAVE_THREADS
        if (kind == FBM && !bench_threads(&image)) return 0;
#endif
        image_free(&image);
    }
    for (int kind = FBM; kind <= WHITE; ++kind) {
        struct image image;
        if (!procedural_image(kind, 512, 1, &image)) return 0;
        if (!bench_sectors(name_of(procedural_names, kind), &image)) return 0;
        image_free(&image);
    }
    return bench_rows() && bench_large();
}

static int bench_tracers(const char *map_name, const struct image *image) {
    static const conemap_tracer tracers[] = {CONEMAP_TRACE_LINEAR,   CONEMAP_TRACE_LOOP,  CONEMAP_TRACE_EXACT_STEP,
                                             CONEMAP_TRACE_CELL_MAX, CONEMAP_TRACE_EXACT, CONEMAP_TRACE_MAXMIP,
                                             CONEMAP_TRACE_QDM};
    enum { COUNT = sizeof tracers / sizeof tracers[0], MAXMIP_AT = 5, RAYS = 1 << 16 };
    static conemap_ray rays[RAYS];
    static conemap_hit hits[RAYS];
    double times[COUNT][ROUNDS];
    conemap_desc desc;
    conemap_map map;
    describe(&desc, image);
    desc.min3x3 = 1;
    conemap_result result = conemap_build(&desc, &map);
    if (result != CONEMAP_OK) return fail_result("build", result);
    random_rays(rays, RAYS, 7u);
    for (int r = 0; r < ROUNDS; ++r)
        for (int k = 0; k < COUNT; ++k) {
            conemap_trace_desc trace;
            memset(&trace, 0, sizeof trace);
            trace.tracer = tracers[k];
            trace.refinement = CONEMAP_REFINE_SECANT;
            double start = now();
            result = conemap_trace(&map, &trace, rays, hits, RAYS);
            times[k][r] = now() - start;
            if (result != CONEMAP_OK) return fail_result("trace", result);
            part_done();
        }
    for (int k = 0; k < COUNT; ++k) {
        char name[64];
        snprintf(name, sizeof name, "trace.%s", name_of(tracer_names, (int)tracers[k]));
        figure(name, map_name, (double)RAYS / median(times[k]) * 1e-6, "Mrays/s");
        if (k == MAXMIP_AT) continue;
        snprintf(name, sizeof name, "trace.maxmip/%s", name_of(tracer_names, (int)tracers[k]));
        figure(name, map_name, median_ratio(times[MAXMIP_AT], times[k]), "ratio (above 1: faster than maxmip)");
    }
    conemap_free(&map);
    return 1;
}

/* conemap_update of a 64 x 64 rectangle of 2048 x 2048, on maps that keep their search, against the build. */
static int bench_edits(void) {
    enum { SIDE = 2048, EDIT = 64 };
    for (int kind = FBM; kind <= SPIKES; ++kind) {
        struct image image;
        conemap_desc desc;
        conemap_map map;
        double times[ROUNDS];
        if (!procedural_image(kind, SIDE, 1, &image)) return 0;
        describe(&desc, &image);
        desc.keep_pyramid = 0;
        desc.keep_search = 1;
        double start = now();
        conemap_result result = conemap_build(&desc, &map);
        double whole = now() - start;
        if (result != CONEMAP_OK) return fail_result("build", result);
        for (int r = 0; r < ROUNDS; ++r) { /* a hill grows */
            int x0 = SIDE / 3, y0 = SIDE / 2;
            for (int y = 0; y < EDIT; ++y)
                for (int x = 0; x < EDIT; ++x) {
                    float a = ((float)x - 31.5f) / 32.0f, b = ((float)y - 31.5f) / 32.0f, hill = 1.0f - a * a - b * b;
                    uint16_t *at = (uint16_t *)image.pixels + (size_t)(y0 + y) * SIDE + (size_t)(x0 + x);
                    float higher = (float)*at + (hill > 0.0f ? 655.0f * hill : 0.0f);
                    *at = (uint16_t)(higher < 65535.0f ? higher : 65535.0f);
                }
            start = now();
            result = conemap_update(&map, &desc, x0, y0, EDIT, EDIT);
            times[r] = now() - start;
            if (result != CONEMAP_OK) return fail_result("update", result);
        }
        goal("update.build/edit64", name_of(procedural_names, kind), whole / median(times), 0, 100.0);
        conemap_free(&map);
        image_free(&image);
    }
    return 1;
}

#include "bench_frusta.h"
#include "bench_effects.h"
#include "bench_trace.h"

int main(int argc, char **argv) {
    program_name = "bench";
    if (argc > 1) wanted = argv[1];
    progress_begin(&progress, "bench");
    parts = 3.0 * ROUNDS * 26.0 + ROUNDS;
    for (int kind = FBM; kind <= SPIKES; ++kind) {
        const char *name = name_of(procedural_names, kind);
        struct image image;
        if (!procedural_image(kind, 256, 1, &image)) return 1;
        if ((is_wanted("build.") && !bench_generators(name, &image)) ||
            (is_wanted("trace.") && !bench_tracers(name, &image)) || (is_wanted("frusta.") && !bench_relief(name, &image)) ||
            (is_wanted("effect.") && !bench_effects(name, &image)))
            return 1;
        image_free(&image);
    }
    if ((is_wanted("frusta.") && !bench_updates()) || (is_wanted("update.") && !bench_edits()) ||
        (is_wanted("trace1024.") && !bench_trace()) || (is_wanted("lanes.") && !bench_all_lanes()))
        return 1;
    progress_end(&progress);
    return 0;
}
