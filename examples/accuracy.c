/* accuracy [MAPFILE]: what accuracy costs in time. For each tracer, on plain vertex cones, on cones corrected to the 3x3
   minimum, and on cones that are safe for the bilinear surface: the share of rays whose first hit was missed (judged by a walk in double precision), the
   share unconverged, mean steps, and time against the fastest. Also written to out/accuracy.csv. */
#define CONEMAP_IMPLEMENTATION
#include "common.h"
#include "../tests/truth.h"
#include "measure.h"

enum { RAYS = 20000 };

struct method {
    const char *name;
    conemap_tracer tracer;
    conemap_refinement refinement;
    int max_steps, cones; /* cones: 0 vertex, 1 corrected, 2 safe, 3 safe for each cell */
    double seconds[ROUNDS], missed, unconverged, steps;
};

static struct method methods[] = {
    {"linear 32, secant", CONEMAP_TRACE_LINEAR, CONEMAP_REFINE_SECANT, 32, 0, {0}, 0, 0, 0},
    {"linear 200, secant", CONEMAP_TRACE_LINEAR, CONEMAP_REFINE_SECANT, 200, 0, {0}, 0, 0, 0},
    {"fixed 10", CONEMAP_TRACE_FIXED, CONEMAP_REFINE_NONE, 0, 0, {0}, 0, 0, 0},
    {"loop 32", CONEMAP_TRACE_LOOP, CONEMAP_REFINE_NONE, 32, 0, {0}, 0, 0, 0},
    {"exact-step", CONEMAP_TRACE_EXACT_STEP, CONEMAP_REFINE_SECANT, 0, 0, {0}, 0, 0, 0},
    {"exact-step, 3x3", CONEMAP_TRACE_EXACT_STEP, CONEMAP_REFINE_SECANT, 0, 1, {0}, 0, 0, 0},
    {"cell-max", CONEMAP_TRACE_CELL_MAX, CONEMAP_REFINE_SECANT, 0, 0, {0}, 0, 0, 0},
    {"cell-max, 3x3", CONEMAP_TRACE_CELL_MAX, CONEMAP_REFINE_SECANT, 0, 1, {0}, 0, 0, 0},
    {"exact", CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 0, {0}, 0, 0, 0},
    {"exact, 3x3", CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 1, {0}, 0, 0, 0},
    {"exact, safe", CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 2, {0}, 0, 0, 0},
    {"exact, safe cells", CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 3, {0}, 0, 0, 0},
    {"qdm", CONEMAP_TRACE_QDM, CONEMAP_REFINE_NONE, 0, 0, {0}, 0, 0, 0},
    {"maxmip", CONEMAP_TRACE_MAXMIP, CONEMAP_REFINE_NONE, 0, 0, {0}, 0, 0, 0},
};
enum { METHODS = sizeof methods / sizeof methods[0] };

static conemap_ray rays[RAYS];
static conemap_hit hits[RAYS];

/* A miss: the surface rises more than 2^-20 above the ray before the hit that was reported. */
static int is_miss(const struct truth_map *map, const conemap_ray *ray, const conemap_hit *hit) {
    double origin[3], direction[3], texel = 1.0 / (double)(map->width > map->height ? map->width : map->height);
    for (int c = 0; c < 3; ++c) {
        origin[c] = (double)ray->origin[c];
        direction[c] = (double)ray->direction[c];
    }
    /* Where the hit itself lies below the surface, that is an error of refinement within a texel, not a miss. */
    double length = sqrt(direction[0] * direction[0] + direction[1] * direction[1]);
    double until = hit->status == CONEMAP_HIT ? (double)hit->t_before - (length > 0.0 ? texel / length : 0.0) : 1e30;
    return until > 0.0 && truth_clearance(map, origin, direction, 0.0, until) < -1.0 / 1048576.0;
}

static int measure(const char *name, const struct image *image, FILE *csv, struct progress *progress, double part) {
    conemap_map maps[4];
    struct truth_map truth = {image->width, image->height, 0, 0, NULL};
    double fastest = 1e30;
    for (int k = 0; k < 4; ++k) {
        conemap_desc desc;
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = image->pixels;
        desc.heights.format = image->format;
        desc.heights.width = image->width;
        desc.heights.height = image->height;
        desc.guarantee = k >= 2 ? CONEMAP_GUARANTEE_BILINEAR : CONEMAP_GUARANTEE_VERTEX;
        desc.keep_pyramid = 1;
        desc.min3x3 = k == 1;
        desc.texture.per_cell = k == 3;
        conemap_result result = conemap_build(&desc, &maps[k]);
        if (result != CONEMAP_OK) return fail_result(name, result);
    }
    truth.heights = maps[0].heights;
    random_rays(rays, RAYS, 11u);
    for (int r = 0; r < ROUNDS; ++r)
        for (int m = 0; m < METHODS; ++m) {
            struct method *method = &methods[m];
            const conemap_map *map = &maps[method->cones];
            conemap_trace_desc desc;
            memset(&desc, 0, sizeof desc);
            desc.tracer = method->tracer;
            desc.refinement = method->refinement;
            desc.max_steps = method->max_steps;
            double start = now();
            conemap_result result = conemap_trace(map, &desc, rays, hits, RAYS);
            method->seconds[r] = now() - start;
            if (result != CONEMAP_OK) return fail_result(name, result);
            progress_show((part + ((double)r + (double)m / METHODS) / ROUNDS) / 4.0, progress);
            if (r > 0) continue;
            method->missed = method->unconverged = method->steps = 0.0;
            for (int k = 0; k < RAYS; ++k) {
                int capped = hits[k].status == CONEMAP_STEP_CAP;
                method->steps += hits[k].steps;
                method->unconverged += capped;
                method->missed += !capped && is_miss(&truth, &rays[k], &hits[k]);
            }
        }
    for (int m = 0; m < METHODS; ++m)
        if (median(methods[m].seconds) < fastest) fastest = median(methods[m].seconds);
    progress_end(progress);
    printf("\n%s, %d x %d, %d rays\n  %-20s %10s %12s %10s %12s\n", name, image->width, image->height, (int)RAYS, "method",
           "missed", "unconverged", "steps", "time/fastest");
    for (int m = 0; m < METHODS; ++m) {
        struct method *method = &methods[m];
        double ratio = median(method->seconds) / fastest;
        printf("  %-20s %8.3f %% %10.3f %% %10.2f %12.2f\n", method->name, method->missed * 100.0 / RAYS,
               method->unconverged * 100.0 / RAYS, method->steps / RAYS, ratio);
        if (csv)
            fprintf(csv, "%s,\"%s\",%.6f,%.6f,%.4f,%.4f\n", name, method->name, method->missed / RAYS,
                    method->unconverged / RAYS, method->steps / RAYS, ratio);
    }
    conemap_free(&maps[0]);
    conemap_free(&maps[1]);
    conemap_free(&maps[2]);
    conemap_free(&maps[3]);
    return 1;
}

int main(int argc, char **argv) {
    struct progress progress;
    struct image_options options;
    struct image image;
    program_name = "accuracy";
    memset(&options, 0, sizeof options);
    make_directory("out");
    FILE *csv = fopen("out/accuracy.csv", "w");
    if (csv) fprintf(csv, "map,method,missed,unconverged,steps,time_over_fastest\n");
    progress_begin(&progress, "accuracy");
    for (int kind = FBM; argc < 2 && kind <= SPIKES; ++kind) {
        if (!procedural_image(kind, 256, 1, &image)) return 1;
        if (!measure(name_of(procedural_names, kind), &image, csv, &progress, (double)(kind - FBM))) return 1;
        image_free(&image);
    }
    const char *path = argc > 1 ? argv[1] : "examples/jacksboro_403x344_16bit.pgm";
    if (!image_read(path, &options, &image)) return 1;
    if (!measure(path, &image, csv, &progress, 3.0)) return 1;
    image_free(&image);
    if (csv && fclose(csv) == 0) printf("\nout/accuracy.csv holds the same figures\n");
    return 0;
}
