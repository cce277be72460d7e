/* bench [NAME]: speed, one line per figure: `name value unit`. Times are medians of interleaved rounds; a figure named
   a/b is the ratio of two times measured in the same rounds. NAME keeps the figures whose name holds it. */
#define CONEMAP_IMPLEMENTATION
#include "common.h"
#include "measure.h"

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

#include "bench_trace.h"

int main(int argc, char **argv) {
    program_name = "bench";
    if (argc > 1) wanted = argv[1];
    progress_begin(&progress, "bench");
    parts = 3.0 * ROUNDS * 12.0;
    for (int kind = FBM; kind <= SPIKES; ++kind) {
        const char *name = name_of(procedural_names, kind);
        struct image image;
        if (!procedural_image(kind, 256, 1, &image)) return 1;
        if (!bench_generators(name, &image) || !bench_tracers(name, &image)) return 1;
        image_free(&image);
    }
    if (!bench_trace()) return 1;
    progress_end(&progress);
    return 0;
}
