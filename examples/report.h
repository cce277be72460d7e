/* What accuracy measures and how it is shown: the table, the comma-separated file, the plots, the contact sheet. Include
   after common.h and measure.h. */
#ifndef EXAMPLES_REPORT_H
#define EXAMPLES_REPORT_H

#define TIMES 11 /* rounds of times, interleaved */

enum { HEIGHTS_ONLY = 1, FROM_BEFORE = 2 }; /* struct cones, from */

struct cone_kind {
    const char *name, *source;
    conemap_generator generator;
    conemap_guarantee guarantee;
    float slack;
    int min3x3, per_cell;
    conemap_format format;
    int from; /* 0: built; HEIGHTS_ONLY: none; FROM_BEFORE: the 3x3 minimum of the line before, whose building is slow */
};

struct cones {
    const struct cone_kind *kind;
    int built;
    conemap_map map;
    float *own;
    double seconds, aperture, bytes; /* to build; mean of min(tan, 1); a texel */
};

struct tracer {
    const char *name;
    conemap_tracer tracer;
    int heights, cones, more; /* texels read: of heights and of cones a step, of heights a ray besides */
};

struct method {
    const char *cones, *tracer;
    conemap_refinement refinement;
    int max_steps;
    int summary; /* one of the rows of the summary over all maps */
};

struct result {
    char name[48];
    const struct method *method;
    struct cones *cones;
    const struct tracer *tracer;
    double seconds[TIMES];
    double time, steps, steps999, missed, unconverged, heights, cone_texels, mean_error, max_error, psnr;
    double generation, bytes;
    int pareto;
};

/* Of the results of one map: the cheapest of each figure, what ratios are against. */
struct cheapest {
    double time, steps, steps999, texels, generation, bytes;
};

static struct cheapest cheapest_of(const struct result *results, int count) {
    struct cheapest least = {1e300, 1e300, 1e300, 1e300, 1e300, 1e300};
    for (int k = 0; k < count; ++k) {
        const struct result *r = &results[k];
        least.time = fmin(least.time, r->time);
        least.steps = fmin(least.steps, r->steps);
        least.steps999 = fmin(least.steps999, r->steps999);
        least.texels = fmin(least.texels, r->heights + r->cone_texels);
        if (r->generation > 0) least.generation = fmin(least.generation, r->generation);
        least.bytes = fmin(least.bytes, r->bytes);
    }
    return least;
}

/* Nothing is both faster and nearer to the truth. */
static void mark_pareto(struct result *results, int count) {
    for (int k = 0; k < count; ++k) {
        results[k].pareto = 1;
        for (int n = 0; n < count; ++n)
            if (n != k && results[n].time <= results[k].time && results[n].mean_error <= results[k].mean_error &&
                (results[n].time < results[k].time || results[n].mean_error < results[k].mean_error))
                results[k].pareto = 0;
    }
}

static void method_name(struct result *r) {
    static const char *const refinements[] = {"", "+sec", "+bis"};
    char cap[16] = "";
    if (r->method->max_steps) snprintf(cap, sizeof cap, " %d", r->method->max_steps);
    snprintf(r->name, sizeof r->name, "%s%s%s%s%s", r->tracer->name, refinements[r->method->refinement], cap,
             r->cones->kind->from == HEIGHTS_ONLY ? "" : ", ", r->cones->kind->from == HEIGHTS_ONLY ? "" : r->cones->kind->name);
}

static void print_table(const struct result *results, int count) {
    struct cheapest least = cheapest_of(results, count);
    printf("    %-29s %13s %9s %12s %5s %6s %7s %6s %6s %6s %5s\n", "", "generation", "bytes", "steps", "99.9",
           "time", "missed", "capped", "texels", "error", "PSNR");
    printf("    %-29s %7s %5s %4s %4s %6s %5s %5s %6s %7s %6s %6s %6s %5s\n", "", "ms", "ratio", "tx", "rat.", "mean", "ratio",
           "%", "ratio", "%", "%", "ratio", "texels", "dB");
    for (int k = 0; k < count; ++k) {
        const struct result *r = &results[k];
        char generation[24] = "      -     -";
        if (r->generation > 0)
            snprintf(generation, sizeof generation, "%7.1f %5.0f", r->generation * 1e3, r->generation / least.generation);
        printf("%2d%s %-29.29s %13.13s %4.3g %4.3g %6.2f %5.2f %5.0f %6.2f %7.3f %6.2f %6.2f %6.3g %5.1f\n", k + 1,
               r->pareto ? "*" : " ", r->name, generation, r->bytes, r->bytes / least.bytes, r->steps,
               r->steps / least.steps, r->steps999, r->time / least.time, r->missed * 100, r->unconverged * 100,
               (r->heights + r->cone_texels) / least.texels, r->mean_error, r->psnr);
    }
}

static const char csv_head[] =
    "map,width,height,rays,method,cones,source,pareto,generation_ms,generation_ratio,bytes_per_texel,bytes_ratio,"
    "steps_mean,steps_mean_ratio,steps_999,steps_999_ratio,time_ratio,missed,unconverged,height_texels,cone_texels,"
    "texels_ratio,error_mean_texels,error_max_texels,psnr_db,mean_aperture\n";

static void write_csv(FILE *csv, const char *map, int width, int height, const char *rays, const struct result *results,
                      int count) {
    struct cheapest least = cheapest_of(results, count);
    for (int k = 0; csv && k < count; ++k) {
        const struct result *r = &results[k];
        fprintf(csv,
                "%s,%d,%d,\"%s\",\"%s\",\"%s\",\"%s\",%d,%.3f,%.3f,%.4f,%.4f,%.4f,%.4f,%.0f,%.4f,%.4f,%.6f,%.6f,%.3f,%.3f,%.4f,"
                "%.6g,%.6g,%.2f,%.6f\n",
                map, width, height, rays, r->name, r->cones->kind->name, r->cones->kind->source, r->pareto, r->generation * 1e3,
                r->generation / least.generation, r->bytes, r->bytes / least.bytes, r->steps, r->steps / least.steps,
                r->steps999, r->steps999 / least.steps999, r->time / least.time, r->missed, r->unconverged, r->heights,
                r->cone_texels, (r->heights + r->cone_texels) / least.texels, r->mean_error, r->max_error, r->psnr,
                r->cones->aperture);
    }
}

#endif
