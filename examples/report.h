/* What accuracy measures and how it is shown: the table, the comma-separated file, the plots, the contact sheet.
   Include after common.h and measure.h. */
#ifndef EXAMPLES_REPORT_H
#define EXAMPLES_REPORT_H

#define TIMES 11     /* rounds of times, interleaved */
#define FULL_TIMES 3 /* with --full, where a round takes minutes */

enum { HEIGHTS_ONLY = 1, FROM_BEFORE = 2 }; /* struct cones, from */

struct cone_kind {
    const char *name, *source;
    conemap_generator generator;
    conemap_guarantee guarantee;
    float slack;
    int min3x3, per_cell, sectors;
    conemap_format format;
    int from; /* 0: built; HEIGHTS_ONLY: none; FROM_BEFORE: the 3x3 minimum of the line before, which is slow to build */
};

struct cones {
    const struct cone_kind *kind;
    int built;
    conemap_map map;
    conemap_prepared prepared; /* of heights only */
    float *own;
    double seconds, aperture, bytes; /* to build; mean of min(tan, 1); a texel */
    double prepare_seconds;
};

struct tracer {
    const char *name;
    conemap_tracer tracer;
    int heights, cones, more; /* texels read: of heights and of cones a step, of heights a ray besides */
    int prepared;
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
    double generation, bytes, aperture;
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
             r->cones->kind->from == HEIGHTS_ONLY ? "" : ", ",
             r->cones->kind->from == HEIGHTS_ONLY ? "" : r->cones->kind->name);
}

/* In 100 columns; what does not fit is in the other two files. */
static void print_table(const struct result *results, int count) {
    struct cheapest least = cheapest_of(results, count);
    printf("%30s %12s %4s %12s %4s %5s %5s %4s %5s %5s %4s\n", "", "build", "byte", "steps", "99.9", "time", "miss", "cap",
           "texel", "error", "PSNR");
    printf("%30s %6s %5s %4s %6s %5s %4s %5s %5s %4s %5s %5s %4s\n", "", "ms", "ratio", "/tx", "mean", "ratio", "%",
           "ratio", "%", "%", "ratio", "texel", "dB");
    for (int k = 0; k < count; ++k) {
        const struct result *r = &results[k];
        char build[24] = "     -     -", error[16];
        if (r->generation > 0)
            snprintf(build, sizeof build, "%6.*f %5.0f", r->generation < 1 ? 1 : 0, r->generation * 1e3,
                     r->generation / least.generation);
        snprintf(error, sizeof error, r->mean_error < 1e-3 ? "%5.0e" : "%5.1g", r->mean_error);
        printf("%2d%s%-27.27s %12.12s %4.3g %6.2f %5.2f %4.0f %5.2f %5.2f %4.1f %5.2f %5s %4.1f\n", k + 1,
               r->pareto ? "*" : " ", r->name, build, r->bytes, r->steps, r->steps / least.steps, r->steps999,
               r->time / least.time, r->missed * 100, r->unconverged * 100,
               (r->heights + r->cone_texels) / least.texels, error, r->psnr);
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
                "%s,%d,%d,\"%s\",\"%s\",\"%s\",\"%s\",%d,%.3f,%.3f,%.4f,%.4f,%.4f,%.4f,%.0f,%.4f,%.4f,%.6f,%.6f,%.3f,%."
                "3f,%.4f,"
                "%.6g,%.6g,%.2f,%.6f\n",
                map, width, height, rays, r->name, r->cones->kind->name, r->cones->kind->source, r->pareto,
                r->generation * 1e3, r->generation / least.generation, r->bytes, r->bytes / least.bytes, r->steps,
                r->steps / least.steps, r->steps999, r->steps999 / least.steps999, r->time / least.time, r->missed,
                r->unconverged, r->heights, r->cone_texels, (r->heights + r->cone_texels) / least.texels, r->mean_error,
                r->max_error, r->psnr, r->aperture);
    }
}

/* ---- plots ------------------------------------------------------------------------------------------ */

/* A map's figures, kept for the plots after its cones are gone. */
struct plotted {
    char name[48];
    int width, height, count, kinds;
    struct result results[64];
    const char *kind[32];
    double generation[32], aperture[32];
    double plan[4]; /* the planner: see accuracy.c */
};

struct panel {
    FILE *svg;
    double x, y, w, h;     /* in the picture */
    double x0, x1, y0, y1; /* decades */
    double taken[512][4];  /* boxes that labels must not cover */
    int boxes;
};

static double panel_x(const struct panel *p, double value) {
    return p->x + p->w * (log10(value) - p->x0) / (p->x1 - p->x0);
}
static double panel_y(const struct panel *p, double value) {
    return p->y + p->h - p->h * (log10(value) - p->y0) / (p->y1 - p->y0);
}

static void take_box(struct panel *p, double x, double y, double w, double h) {
    double *box = p->taken[p->boxes < 511 ? p->boxes++ : 511];
    box[0] = x;
    box[1] = y;
    box[2] = w;
    box[3] = h;
}

static int is_free(const struct panel *p, double x, double y, double w, double h) {
    if (x < p->x + 2 || y < p->y + 2 || x + w > p->x + p->w - 2 || y + h > p->y + p->h - 2) return 0;
    for (int k = 0; k < p->boxes; ++k) {
        const double *b = p->taken[k];
        if (x < b[0] + b[2] && b[0] < x + w && y < b[1] + b[3] && b[1] < y + h) return 0;
    }
    return 1;
}

/* A label near a mark, where it covers nothing; with a line to its mark if it had to go farther. */
static void put_label(struct panel *p, double x, double y, const char *text, int bold) {
    double w = 6.3 * (double)strlen(text) + 2, h = 12;
    for (double far = 8; far < 170; far += 5)
        for (int k = 0; k < 16; ++k) {
            double angle = 0.3927 * (k % 2 ? (k + 1) / 2 : -k / 2), cx = x + far * cos(angle),
                   cy = y - far * sin(angle);
            double left = cos(angle) > 0.3 ? cx : cos(angle) < -0.3 ? cx - w : cx - w / 2, top = cy - h / 2;
            if (!is_free(p, left, top, w, h)) continue;
            if (far > 12)
                fprintf(p->svg, "<line x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f' stroke='#777' stroke-width='.6'/>\n", x,
                        y,
                        cos(angle) > 0.3    ? left
                        : cos(angle) < -0.3 ? left + w
                                            : cx,
                        sin(angle) > 0.8    ? top + h
                        : sin(angle) < -0.8 ? top
                                            : cy);
            fprintf(p->svg, "<text x='%.1f' y='%.1f'%s>%s</text>\n", left + 1, top + 10,
                    bold ? " font-weight='bold'" : "", text);
            take_box(p, left, top, w, h);
            return;
        }
    fprintf(p->svg, "<text x='%.1f' y='%.1f'>%s</text>\n", x + 8, y,
            text); /* nowhere is free: better covered than lost */
}

static void put_frame(struct panel *p, const char *title, const char *x_name, const char *y_name, const double *x_ticks,
                      int x_count, const double *y_ticks, int y_count) {
    fprintf(p->svg, "<rect x='%.1f' y='%.1f' width='%.1f' height='%.1f' fill='none' stroke='#000'/>\n", p->x, p->y,
            p->w, p->h);
    fprintf(p->svg, "<text x='%.1f' y='%.1f' font-size='13' font-weight='bold'>%s</text>\n", p->x, p->y - 8, title);
    for (int k = 0; k < x_count; ++k) {
        double x = panel_x(p, x_ticks[k]);
        if (x < p->x - 0.5 || x > p->x + p->w + 0.5) continue;
        fprintf(p->svg, "<line x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f' stroke='#ddd'/>\n", x, p->y, x, p->y + p->h);
        fprintf(p->svg, "<text x='%.1f' y='%.1f' text-anchor='middle'>%g</text>\n", x, p->y + p->h + 14, x_ticks[k]);
    }
    for (int k = 0; k < y_count; ++k) {
        double y = panel_y(p, y_ticks[k]);
        if (y < p->y - 0.5 || y > p->y + p->h + 0.5) continue;
        fprintf(p->svg, "<line x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f' stroke='#ddd'/>\n", p->x, y, p->x + p->w, y);
        fprintf(p->svg, "<text x='%.1f' y='%.1f' text-anchor='end'>%g</text>\n", p->x - 4, y + 4, y_ticks[k]);
    }
    fprintf(p->svg, "<text x='%.1f' y='%.1f' text-anchor='middle'>%s</text>\n", p->x + p->w / 2, p->y + p->h + 29,
            x_name);
    fprintf(p->svg, "<text transform='translate(%.1f %.1f) rotate(-90)' text-anchor='middle'>%s</text>\n", p->x - 44,
            p->y + p->h / 2, y_name);
}

/* Shapes tell tracers apart, without colour. */
static void put_mark(FILE *svg, const char *tracer, double x, double y) {
    if (strcmp(tracer, "linear") == 0)
        fprintf(svg, "<path d='M%.1f %.1f l5 9 h-10 z' fill='#fff' stroke='#000'/>\n", x, y - 6);
    else if (strcmp(tracer, "maxmip") == 0 || strcmp(tracer, "qdm") == 0)
        fprintf(svg, "<path d='M%.1f %.1f l5 5 l-5 5 l-5 -5 z' fill='#bbb' stroke='#000'/>\n", x, y - 5);
    else if (strcmp(tracer, "exact") == 0)
        fprintf(svg, "<circle cx='%.1f' cy='%.1f' r='4' stroke='#000'/>\n", x, y);
    else if (strcmp(tracer, "cell-max") == 0)
        fprintf(svg, "<circle cx='%.1f' cy='%.1f' r='4' fill='#fff' stroke='#000'/>\n", x, y);
    else if (strcmp(tracer, "exact-step") == 0)
        fprintf(svg, "<rect x='%.1f' y='%.1f' width='7' height='7' fill='#fff' stroke='#000'/>\n", x - 3.5, y - 3.5);
    else if (strcmp(tracer, "prepared") == 0)
        fprintf(svg, "<rect x='%.1f' y='%.1f' width='8' height='8' stroke='#000'/>\n", x - 4, y - 4);
    else
        fprintf(svg, "<path d='M%.1f %.1f l8 8 m0 -8 l-8 8' stroke='#000' stroke-width='1.6'/>\n", x - 4, y - 4);
}

#define LEAST_ERROR 1e-6

static int by_first(const void *a, const void *b) { return by_value(a, b); }

/* A staircase through what nothing beats: points sorted by x, smaller y better where `down`, else larger. */
static void put_front(struct panel *p, double (*given)[2], int count, int down) {
    double best = 0, points[64][2], x = 0, y = 0;
    int begun = 0;
    memcpy(points, given, (size_t)count * sizeof points[0]);
    qsort(points, (size_t)count, sizeof points[0], by_first);
    fprintf(p->svg, "<polyline fill='none' stroke='#000' stroke-width='1.4' stroke-dasharray='5 3' points='");
    for (int k = 0; k <= count; ++k) {
        double to = k < count ? panel_x(p, points[k][0]) : p->x + p->w;
        if (k < count && begun && (down ? points[k][1] >= best : points[k][1] <= best)) continue;
        if (begun) {
            fprintf(p->svg, "%.1f,%.1f ", to, y);
            take_box(p, x, y - 1, to - x, 2);
        }
        x = to;
        if (k == count) break;
        best = points[k][1];
        if (begun) take_box(p, x - 1, fmin(y, panel_y(p, best)), 2, fabs(y - panel_y(p, best)));
        y = panel_y(p, best);
        begun = 1;
        fprintf(p->svg, "%.1f,%.1f ", x, y);
    }
    fprintf(p->svg, "'/>\n");
}

static double clamp_to(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

static void plot_errors(FILE *svg, const struct plotted *m, double x, double y, double w, double h) {
    static const double errors[] = {1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1, 10, 100};
    static const double times[] = {1, 1.2, 1.5, 2, 3, 4, 6, 8, 12};
    static struct panel p;
    double least = 1e300, most = 0, points[64][2];
    char title[128], label[16];
    memset(&p, 0, sizeof p);
    for (int k = 0; k < m->count; ++k) {
        least = fmin(least, m->results[k].time);
        most = fmax(most, m->results[k].time);
    }
    p.svg = svg;
    p.x = x;
    p.y = y;
    p.w = w;
    p.h = h;
    p.x0 = -0.03;
    p.x1 = log10(most / least) + 0.03;
    p.y0 = -6.8;
    p.y1 = 1.8;
    snprintf(title, sizeof title, "%s, %d x %d: error against time", m->name, m->width, m->height);
    put_frame(&p, title, "time a ray over the fastest", "mean error, texels", times, 9, errors, 9);
    for (int k = 0; k < m->count; ++k) {
        points[k][0] = m->results[k].time / least;
        points[k][1] = clamp_to(m->results[k].mean_error, LEAST_ERROR, 50);
        take_box(&p, panel_x(&p, points[k][0]) - 5, panel_y(&p, points[k][1]) - 5, 10, 10);
        put_mark(svg, m->results[k].tracer->name, panel_x(&p, points[k][0]), panel_y(&p, points[k][1]));
    }
    put_front(&p, points, m->count, 1);
    for (int pass = 1; pass >= 0; --pass)
        for (int k = 0; k < m->count; ++k) {
            if (m->results[k].pareto != pass) continue;
            snprintf(label, sizeof label, "%d", k + 1);
            put_label(&p, panel_x(&p, points[k][0]), panel_y(&p, points[k][1]), label, pass);
        }
}

static void plot_apertures(FILE *svg, const struct plotted *m, double x, double y, double w, double h) {
    static const double apertures[] = {0.001, 0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1};
    static const double times[] = {1, 3, 10, 30, 100, 300, 1000, 3000, 10000, 30000};
    static struct panel p;
    double least = 1e300, most = 0, low = 1, high = 0, points[32][2];
    memset(&p, 0, sizeof p);
    for (int k = 0; k < m->kinds; ++k) {
        least = fmin(least, m->generation[k]);
        most = fmax(most, m->generation[k]);
        low = fmin(low, m->aperture[k]);
        high = fmax(high, m->aperture[k]);
    }
    p.svg = svg;
    p.x = x;
    p.y = y;
    p.w = w;
    p.h = h;
    p.x0 = log10(least) - 0.08;
    p.x1 = log10(most) + 0.3;
    p.y0 = log10(low) - 0.1;
    p.y1 = log10(high) + 0.1;
    put_frame(&p, "aperture against generation", "milliseconds to build", "mean of min(tan, 1)", times, 10, apertures, 12);
    for (int k = 0; k < m->kinds; ++k) {
        points[k][0] = m->generation[k];
        points[k][1] = m->aperture[k];
        take_box(&p, panel_x(&p, points[k][0]) - 4, panel_y(&p, points[k][1]) - 4, 8, 8);
        fprintf(svg, "<circle cx='%.1f' cy='%.1f' r='3.5' fill='#fff' stroke='#000'/>\n", panel_x(&p, points[k][0]),
                panel_y(&p, points[k][1]));
    }
    put_front(&p, points, m->kinds, 0);
    for (int k = 0; k < m->kinds; ++k)
        put_label(&p, panel_x(&p, m->generation[k]), panel_y(&p, m->aperture[k]), m->kind[k], 0);
}

/* [BV24] Figure 4: a cut through a step, the cones of its two texels, and between them the interpolated one; black is
   what of the surface that one holds. From a map of one row. */
static int plot_cut(FILE *svg, const char *title, conemap_guarantee guarantee, int min3x3, double x, double y, double w,
                    double h) {
    static const float heights[6] = {0.10f, 0.10f, 0.55f, 0.40f, 0.70f, 0.70f};
    static const double at[3] = {1.5 / 6, 2.5 / 6, 2.0 / 6};
    enum { COLUMNS = 240 };
    conemap_desc desc;
    conemap_map map;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = 6;
    desc.heights.height = 1;
    desc.guarantee = guarantee;
    desc.min3x3 = min3x3;
    conemap_result result = conemap_build(&desc, &map);
    if (result != CONEMAP_OK) return fail_result(title, result);
    fprintf(svg, "<rect x='%.1f' y='%.1f' width='%.1f' height='%.1f' fill='none' stroke='#000'/>\n", x, y, w, h);
    fprintf(svg, "<text x='%.1f' y='%.1f' font-size='13' font-weight='bold'>%s</text>\n", x, y - 8, title);
    fprintf(svg, "<polygon fill='#ddd' stroke='none' points='%.1f,%.1f ", x, y + h);
    for (int k = 0; k <= COLUMNS; ++k) {
        conemap_sample sample;
        if (conemap_sample_at(&map, (float)k / COLUMNS, 0.5f, &sample) != CONEMAP_OK) break;
        fprintf(svg, "%.1f,%.1f ", x + w * k / COLUMNS, y + h - w * (double)sample.height);
    }
    fprintf(svg, "%.1f,%.1f'/>\n", x + w, y + h);
    for (int c = 0; c < 3; ++c) {
        conemap_sample apex, sample;
        if (conemap_sample_at(&map, (float)at[c], 0.5f, &apex) != CONEMAP_OK) break;
        double top = h / w, up = top - (double)apex.height, side = up * (double)apex.tan;
        double left = fmin(side, at[c]), right = fmin(side, 1 - at[c]);
        fprintf(svg, "<polyline fill='none' stroke='#000' %s points='%.1f,%.1f %.1f,%.1f %.1f,%.1f'/>\n",
                c == 2 ? "stroke-width='2'" : "stroke-dasharray='4 3'", x + w * (at[c] - left),
                y + h - w * ((double)apex.height + left / (double)apex.tan), x + w * at[c],
                y + h - w * (double)apex.height, x + w * (at[c] + right),
                y + h - w * ((double)apex.height + right / (double)apex.tan));
        if (c < 2) continue;
        fprintf(svg, "<polygon fill='#000' stroke='none' points='");
        for (int k = 0; k <= 2 * COLUMNS; ++k) { /* there along the lower of cone and surface, back along the surface */
            double u = (double)(k <= COLUMNS ? k : 2 * COLUMNS - k) / COLUMNS;
            if (conemap_sample_at(&map, (float)u, 0.5f, &sample) != CONEMAP_OK) break;
            double z = (double)sample.height, cone = (double)apex.height + fabs(u - at[c]) / (double)apex.tan;
            fprintf(svg, "%.1f,%.1f ", x + w * u, y + h - w * (k <= COLUMNS ? fmin(cone, z) : z));
        }
        fprintf(svg, "'/>\n");
    }
    conemap_free(&map);
    return 1;
}

/* The whole picture: the key of the numbers, two plots a map, and the cuts. */
static void write_svg(FILE *svg, const struct plotted *maps, int count) {
    static const char *const shapes[] = {"linear", "qdm", "exact", "prepared", "cell-max", "exact-step", "loop"};
    static const char *const said[] = {"linear",   "maxima (maxmip, qdm)", "exact",      "prepared",
                                       "cell-max", "exact-step",           "loop, fixed"};
    int rows = (maps[0].count + 2) / 3, width = 1240, row = 460, top = 70 + 15 * rows;
    int height = top + 40 + row * count + 330;
    fprintf(
        svg,
        "<svg xmlns='http://www.w3.org/2000/svg' width='%d' height='%d' viewBox='0 0 %d %d' font-family='sans-serif' "
        "font-size='11'>\n<rect width='100%%' height='100%%' fill='#fff'/>\n",
        width, height, width, height);
    fprintf(svg,
            "<text x='60' y='26' font-size='16' font-weight='bold'>conemap.h: what accuracy costs in time</text>\n");
    for (int k = 0; k < 7; ++k) {
        put_mark(svg, shapes[k], 66 + 120 * k + (k > 1 ? 40 : 0), 44);
        fprintf(svg, "<text x='%d' y='48'>%s</text>\n", 76 + 120 * k + (k > 1 ? 40 : 0), said[k]);
    }
    fprintf(svg, "<text x='1000' y='48'>dashed: nothing is better in both</text>\n");
    for (int k = 0; k < maps[0].count; ++k)
        fprintf(svg, "<text x='%d' y='%d'>%d  %s</text>\n", 60 + 380 * (k / rows), 74 + 15 * (k % rows), k + 1,
                maps[0].results[k].name);
    for (int k = 0; k < count; ++k) {
        double y = top + 40 + row * k;
        plot_errors(svg, &maps[k], 62, y, 600, row - 80);
        plot_apertures(svg, &maps[k], 745, y, 475, row - 80);
    }
    double y = top + 40 + row * count;
    plot_cut(svg, "vertex cones, interpolated ([BV24] Figure 4)", CONEMAP_GUARANTEE_VERTEX, 0, 62, y, 360, 288);
    plot_cut(svg, "after the 3x3 minimum", CONEMAP_GUARANTEE_VERTEX, 1, 462, y, 360, 288);
    plot_cut(svg, "safe cones", CONEMAP_GUARANTEE_BILINEAR, 0, 862, y, 360, 288);
    fprintf(svg, "</svg>\n");
}

/* ---- contact sheet ---------------------------------------------------------------------------------- */

struct sheet {
    int width, height;
    unsigned char *pixels; /* RGB */
};

static void put_pixel(struct sheet *s, int x, int y, double r, double g, double b) {
    unsigned char *at = s->pixels + 3 * ((size_t)y * (size_t)s->width + (size_t)x);
    if (x < 0 || y < 0 || x >= s->width || y >= s->height) return;
    at[0] = (unsigned char)(clamp_to(r, 0, 1) * 255 + 0.5);
    at[1] = (unsigned char)(clamp_to(g, 0, 1) * 255 + 0.5);
    at[2] = (unsigned char)(clamp_to(b, 0, 1) * 255 + 0.5);
}

/* 5 x 7 letters, rows from the top, five bits each; small letters are shown as capitals. */
static void put_text(struct sheet *s, int x, int y, const char *text) {
    static const char known[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.,+-%/():=";
    static const unsigned char rows[][7] = {
        {14, 17, 17, 31, 17, 17, 17}, {30, 17, 17, 30, 17, 17, 30}, {14, 17, 16, 16, 16, 17, 14},
        {30, 17, 17, 17, 17, 17, 30}, {31, 16, 16, 30, 16, 16, 31}, {31, 16, 16, 30, 16, 16, 16},
        {14, 17, 16, 23, 17, 17, 15}, {17, 17, 17, 31, 17, 17, 17}, {14, 4, 4, 4, 4, 4, 14},
        {7, 2, 2, 2, 2, 18, 12},      {17, 18, 20, 24, 20, 18, 17}, {16, 16, 16, 16, 16, 16, 31},
        {17, 27, 21, 21, 17, 17, 17}, {17, 25, 21, 19, 17, 17, 17}, {14, 17, 17, 17, 17, 17, 14},
        {30, 17, 17, 30, 16, 16, 16}, {14, 17, 17, 17, 21, 18, 13}, {30, 17, 17, 30, 20, 18, 17},
        {15, 16, 16, 14, 1, 1, 30},   {31, 4, 4, 4, 4, 4, 4},       {17, 17, 17, 17, 17, 17, 14},
        {17, 17, 17, 17, 17, 10, 4},  {17, 17, 17, 21, 21, 27, 17}, {17, 17, 10, 4, 10, 17, 17},
        {17, 17, 10, 4, 4, 4, 4},     {31, 1, 2, 4, 8, 16, 31},     {14, 17, 19, 21, 25, 17, 14},
        {4, 12, 4, 4, 4, 4, 14},      {14, 17, 1, 6, 8, 16, 31},    {31, 2, 4, 2, 1, 17, 14},
        {2, 6, 10, 18, 31, 2, 2},     {31, 16, 30, 1, 1, 17, 14},   {6, 8, 16, 30, 17, 17, 14},
        {31, 1, 2, 4, 8, 8, 8},       {14, 17, 17, 14, 17, 17, 14}, {14, 17, 17, 15, 1, 2, 12},
        {0, 0, 0, 0, 0, 12, 12},      {0, 0, 0, 0, 12, 4, 8},       {0, 4, 4, 31, 4, 4, 0},
        {0, 0, 0, 31, 0, 0, 0},       {24, 25, 2, 4, 8, 19, 3},     {0, 1, 2, 4, 8, 16, 0},
        {2, 4, 8, 8, 8, 4, 2},        {8, 4, 2, 2, 2, 4, 8},        {0, 12, 12, 0, 12, 12, 0},
        {0, 0, 31, 0, 31, 0, 0},
    };
    for (; *text; ++text, x += 6) {
        char c = *text >= 'a' && *text <= 'z' ? (char)(*text - 'a' + 'A') : *text;
        const char *at = strchr(known, c);
        if (!at) continue;
        for (int j = 0; j < 7; ++j)
            for (int i = 0; i < 5; ++i)
                if (rows[at - known][j] >> (4 - i) & 1) put_pixel(s, x + i, y + j, 0, 0, 0);
    }
}

/* Dark to bright all the way, so that it reads without colour too. */
static void put_heat(struct sheet *s, int x, int y, double t) {
    static const double ramp[5][3] = {
        {0, 0, 0.1}, {0.35, 0.05, 0.4}, {0.8, 0.25, 0.25}, {0.98, 0.65, 0.2}, {1, 1, 0.85}};
    double at = clamp_to(t, 0, 1) * 4, part;
    int k = at < 3 ? (int)at : 3;
    part = at - k;
    put_pixel(s, x, y, ramp[k][0] + (ramp[k + 1][0] - ramp[k][0]) * part,
              ramp[k][1] + (ramp[k + 1][1] - ramp[k][1]) * part, ramp[k][2] + (ramp[k + 1][2] - ramp[k][2]) * part);
}

/* ---- one page with everything -------------------------------------------------------------------------- */

static void write_base64(FILE *to, const unsigned char *bytes, size_t size) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t k = 0; k < size; k += 3) {
        unsigned long word = (unsigned long)bytes[k] << 16;
        char out[5] = "====";
        if (k + 1 < size) word |= (unsigned long)bytes[k + 1] << 8;
        if (k + 2 < size) word |= bytes[k + 2];
        for (unsigned c = 0; c < 4; ++c)
            if (c < 2 || k + c - 1 < size) out[c] = digits[word >> (18 - 6 * c) & 63];
        fputs(out, to);
    }
}

static void write_html(FILE *html, const struct plotted *maps, int count, const char *const *sheets) {
    fprintf(html, "<!doctype html><html lang='en'><meta charset='utf-8'><title>conemap.h: what accuracy costs</title>\n"
                  "<style>body{font:14px sans-serif;margin:2em;max-width:1260px}table{border-collapse:collapse}"
                  "td,th{border:1px solid #999;padding:2px 6px;text-align:right}td:nth-child(2){text-align:left}"
                  "tr.p{font-weight:bold}svg,img{max-width:100%%}small{color:#555;font-weight:normal}</style>\n");
    write_svg(html, maps, count);
    for (int m = 0; m < count; ++m) {
        struct cheapest least = cheapest_of(maps[m].results, maps[m].count);
        fprintf(html,
                "<h2>%s, %d x %d</h2><p>Bold: nothing is both faster and nearer to the truth. Small: over the "
                "cheapest.</p>\n"
                "<table><tr><th><th>method<th>build ms<th>bytes/texel<th>steps<th>99.9 %%<th>time<th>missed %%"
                "<th>capped %%<th>height texels<th>cone texels<th>mean error<th>max error<th>PSNR</tr>\n",
                maps[m].name, maps[m].width, maps[m].height);
        for (int k = 0; k < maps[m].count; ++k) {
            const struct result *r = &maps[m].results[k];
            fprintf(
                html,
                "<tr%s><td>%d<td>%s<td>%.1f <small>%.3g</small><td>%.3g <small>%.2g</small><td>%.2f <small>%.2f</small>"
                "<td>%.0f <small>%.2f</small><td>%.2f<td>%.3f<td>%.2f<td>%.1f<td>%.1f <small>%.2f</small><td>%.3g"
                "<td>%.3g<td>%.1f</tr>\n",
                r->pareto ? " class='p'" : "", k + 1, r->name, r->generation * 1e3, r->generation / least.generation,
                r->bytes, r->bytes / least.bytes, r->steps, r->steps / least.steps, r->steps999,
                r->steps999 / least.steps999, r->time / least.time, r->missed * 100, r->unconverged * 100, r->heights,
                r->cone_texels, (r->heights + r->cone_texels) / least.texels, r->mean_error, r->max_error, r->psnr);
        }
        fprintf(html, "</table>\n");
        size_t size;
        unsigned char *png = sheets[m] ? read_file(sheets[m], &size) : NULL;
        if (png) {
            fprintf(html,
                    "<p>Left: the view, rays that miss their first hit or do not converge in magenta. Right: steps.</p>"
                    "<img alt='%s by method' src='data:image/png;base64,",
                    maps[m].name);
            write_base64(html, png, size);
            fprintf(html, "'>\n");
            free(png);
        }
    }
    fprintf(html, "</html>\n");
}

#endif
