/* The tracing part of bench: our tracers against two plain ones, written here as carefully as they allow, on the same
   rays. Include after common.h and measure.h. */
#ifndef EXAMPLES_BENCH_TRACE_H
#define EXAMPLES_BENCH_TRACE_H

#include "../tests/truth.h"

#ifndef BENCH_SIDE
#define BENCH_SIDE 500 /* the camera has so many pixels each way, and there are as many random rays */
#endif

/* ---- the plain tracers ----------------------------------------------------------------------------------

   Both know CLAMP only. Cell (i, j) lies between the centres of texels i - 1 and i; one texel of border all around
   saves them every test for the map's ends. Positions are in texels, so that cell i spans i..i + 1. */
struct plain {
    int width, height, stride; /* cells; texels of a padded row */
    float *heights;            /* (width + 1) x (height + 1), padded */
    float highest;
    int levels;                /* maxima over blocks of 4^k x 4^k cells; level 0: the cells themselves */
    int level_width[9];
    float *level[9];
};

static void plain_free(struct plain *p) {
    for (int k = 0; k < p->levels; ++k) free(p->level[k]);
    free(p->heights);
    memset(p, 0, sizeof *p);
}

static int plain_make(const conemap_map *map, struct plain *p) {
    int w = map->info.width, h = map->info.height;
    memset(p, 0, sizeof *p);
    p->width = w + 1;
    p->height = h + 1;
    p->stride = w + 2;
    p->highest = map->highest;
    p->heights = (float *)malloc((size_t)(w + 2) * (size_t)(h + 2) * sizeof(float));
    if (!p->heights) return 0;
    for (int y = 0; y < h + 2; ++y)
        for (int x = 0; x < w + 2; ++x) {
            int i = x < 1 ? 0 : x > w ? w - 1 : x - 1, j = y < 1 ? 0 : y > h ? h - 1 : y - 1;
            p->heights[(size_t)y * (size_t)p->stride + (size_t)x] = map->heights[(size_t)j * (size_t)w + (size_t)i];
        }
    int bw = p->width, bh = p->height, below = 0;
    for (;;) {
        int k = p->levels++;
        float *at = p->level[k] = (float *)malloc((size_t)bw * (size_t)bh * sizeof(float));
        if (!at) {
            plain_free(p);
            return 0;
        }
        p->level_width[k] = bw;
        for (int y = 0; y < bh; ++y)
            for (int x = 0; x < bw; ++x) {
                float most = 0.0f;
                if (k == 0) {
                    const float *c = p->heights + (size_t)y * (size_t)p->stride + (size_t)x;
                    most = fmaxf(fmaxf(c[0], c[1]), fmaxf(c[p->stride], c[p->stride + 1]));
                } else {
                    int cw = p->level_width[k - 1], ch = below;
                    for (int b = 4 * y; b < 4 * y + 4 && b < ch; ++b)
                        for (int a = 4 * x; a < 4 * x + 4 && a < cw; ++a)
                            most = fmaxf(most, p->level[k - 1][(size_t)b * (size_t)cw + (size_t)a]);
                }
                at[(size_t)y * (size_t)bw + (size_t)x] = most;
            }
        if (bw == 1 && bh == 1) break;
        below = bh;
        bw = (bw + 3) / 4;
        bh = (bh + 3) / 4;
    }
    return 1;
}

/* The first way to a zero of c + b s + a s^2 in 0..end; -1 if none. */
#define PLAIN_ROOT(name, real, root)                                                                        \
    static real name(real a, real b, real c, real end) {                                                     \
        real d = b * b - 4 * a * c, q, first, second;                                                        \
        if (c <= 0) return 0;                                                                                \
        if (d < 0) return -1;                                                                                \
        q = (real)-0.5 * (b + (b < 0 ? -root(d) : root(d)));                                                 \
        first = q != 0 ? c / q : -1;                                                                         \
        second = a != 0 ? q / a : -1;                                                                        \
        if (first < 0 || (second >= 0 && second < first)) first = second;                                    \
        return first >= 0 && first <= end ? first : -1;                                                      \
    }
PLAIN_ROOT(plain_rootf, float, sqrtf)
PLAIN_ROOT(plain_root, double, sqrt)

/* A walk over maxima of 4 x 4 blocks down to the exact bilinear cell, in single precision: [TIS08] with fewer levels. A
   block that the ray flies over is left behind whole; otherwise the walk goes on inside it, from where the ray comes
   down to its top. */
static int plain_pyramid(const struct plain *p, const conemap_ray *ray, float *hit_t) {
    float ox = ray->origin[0] * (float)(p->width - 1) + 0.5f, oy = ray->origin[1] * (float)(p->height - 1) + 0.5f;
    float dx = ray->direction[0] * (float)(p->width - 1), dy = ray->direction[1] * (float)(p->height - 1);
    float oz = ray->origin[2], dz = ray->direction[2], t = ray->t_min, end = ray->t_max > 0.0f ? ray->t_max : 3e38f;
    float ix = dx != 0.0f ? 1.0f / dx : 3e38f, iy = dy != 0.0f ? 1.0f / dy : 3e38f, iz = dz != 0.0f ? 1.0f / dz : 3e38f;
    float low, high;
    int i, j, k = p->levels - 1, right = dx > 0.0f, down = dy > 0.0f, on_floor;
    if (dx != 0.0f) {
        low = (0.5f - ox) * ix, high = ((float)p->width - 0.5f - ox) * ix;
        t = fmaxf(t, fminf(low, high)), end = fminf(end, fmaxf(low, high));
    } else if (ox < 0.5f || ox > (float)p->width - 0.5f) return 0;
    if (dy != 0.0f) {
        low = (0.5f - oy) * iy, high = ((float)p->height - 0.5f - oy) * iy;
        t = fmaxf(t, fminf(low, high)), end = fminf(end, fmaxf(low, high));
    } else if (oy < 0.5f || oy > (float)p->height - 0.5f) return 0;
    if (dz != 0.0f) {
        low = (0.0f - oz) * iz, high = (p->highest - oz) * iz;
        t = fmaxf(t, fminf(low, high)), end = fminf(end, fmaxf(low, high));
    } else if (oz < 0.0f || oz > p->highest) return 0;
    if (!(t <= end)) return 0;
    on_floor = dz < 0.0f && end == (0.0f - oz) * iz; /* the relief is solid down to there */
    i = (int)(ox + dx * t), j = (int)(oy + dy * t);
    i = i < 0 ? 0 : i >= p->width ? p->width - 1 : i;
    j = j < 0 ? 0 : j >= p->height ? p->height - 1 : j;
    for (;;) {
        int s = 2 * k, bi = i >> s, bj = j >> s, to_i = (bi + right) << s, to_j = (bj + down) << s;
        float most = p->level[k][(size_t)bj * (size_t)p->level_width[k] + (size_t)bi];
        float tx = dx != 0.0f ? ((float)to_i - ox) * ix : 3e38f, ty = dy != 0.0f ? ((float)to_j - oy) * iy : 3e38f;
        float leave = tx < ty ? tx : ty, to = leave < end ? leave : end;
        float z = oz + dz * (dz < 0.0f ? to : t);
        if (to < t) to = t;
        if (z <= most) {
            if (k > 0) {
                if (dz < 0.0f) {
                    float top = (most - oz) * iz;
                    if (top > t && top < to) {
                        int a = (int)(ox + dx * top), b = (int)(oy + dy * top);
                        i = right ? (a > i ? a < to_i ? a : to_i - 1 : i) : (a < i ? a > to_i ? a : to_i : i);
                        j = down ? (b > j ? b < to_j ? b : to_j - 1 : j) : (b < j ? b > to_j ? b : to_j : j);
                        t = top;
                    }
                }
                --k;
                continue;
            }
            {
                const float *c = p->heights + (size_t)j * (size_t)p->stride + (size_t)i;
                float h00 = c[0], hx = c[1] - h00, hy = c[p->stride] - h00, hxy = c[p->stride + 1] - c[p->stride] - hx;
                float x = ox + dx * t - (float)i, y = oy + dy * t - (float)j;
                float s0 = plain_rootf(-hxy * dx * dy, dz - (hx * dx + hy * dy + hxy * (x * dy + y * dx)),
                                       oz + dz * t - (h00 + hx * x + hy * y + hxy * x * y), to - t);
                if (s0 >= 0.0f) {
                    *hit_t = t + s0;
                    return 1;
                }
            }
        }
        if (to >= end) {
            *hit_t = end;
            return on_floor;
        }
        t = to;
        {
            int from_i = i, from_j = j;
            if (tx < ty) {
                int b = (int)(oy + dy * t);
                i = right ? to_i : to_i - 1;
                j = down ? (b > j ? b < to_j ? b : to_j - 1 : j) : (b < j ? b > to_j ? b : to_j : j);
            } else {
                int a = (int)(ox + dx * t);
                j = down ? to_j : to_j - 1;
                i = right ? (a > i ? a < to_i ? a : to_i - 1 : i) : (a < i ? a > to_i ? a : to_i : i);
            }
            if (i < 0 || j < 0 || i >= p->width || j >= p->height) return 0;
            if (k + 1 < p->levels && (((i ^ from_i) | (j ^ from_j)) >> (s + 2)) != 0) ++k;
        }
    }
}

/* From cell to cell in double precision, the patch solved in every cell that the ray does not fly over. */
static int plain_cells(const struct plain *p, const conemap_ray *ray, float *hit_t) {
    double ox = (double)ray->origin[0] * (p->width - 1) + 0.5, oy = (double)ray->origin[1] * (p->height - 1) + 0.5;
    double dx = (double)ray->direction[0] * (p->width - 1), dy = (double)ray->direction[1] * (p->height - 1);
    double oz = (double)ray->origin[2], dz = (double)ray->direction[2], t = (double)ray->t_min;
    double end = ray->t_max > 0.0f ? (double)ray->t_max : 1e300, low, high, tx, ty, step_x, step_y;
    double ix = dx != 0.0 ? 1.0 / dx : 1e300, iy = dy != 0.0 ? 1.0 / dy : 1e300, iz = dz != 0.0 ? 1.0 / dz : 1e300;
    int i, j, si = dx > 0.0 ? 1 : -1, sj = dy > 0.0 ? 1 : -1, on_floor;
    if (dx != 0.0) {
        low = (0.5 - ox) * ix, high = (p->width - 0.5 - ox) * ix;
        t = fmax(t, fmin(low, high)), end = fmin(end, fmax(low, high));
    } else if (ox < 0.5 || ox > p->width - 0.5) return 0;
    if (dy != 0.0) {
        low = (0.5 - oy) * iy, high = (p->height - 0.5 - oy) * iy;
        t = fmax(t, fmin(low, high)), end = fmin(end, fmax(low, high));
    } else if (oy < 0.5 || oy > p->height - 0.5) return 0;
    if (dz != 0.0) {
        low = (0.0 - oz) * iz, high = ((double)p->highest - oz) * iz;
        t = fmax(t, fmin(low, high)), end = fmin(end, fmax(low, high));
    } else if (oz < 0.0 || oz > (double)p->highest) return 0;
    if (!(t <= end)) return 0;
    on_floor = dz < 0.0 && end == (0.0 - oz) * iz;
    i = (int)(ox + dx * t), j = (int)(oy + dy * t);
    i = i < 0 ? 0 : i >= p->width ? p->width - 1 : i;
    j = j < 0 ? 0 : j >= p->height ? p->height - 1 : j;
    tx = dx != 0.0 ? (i + (dx > 0.0) - ox) * ix : 1e300;
    ty = dy != 0.0 ? (j + (dy > 0.0) - oy) * iy : 1e300;
    step_x = fabs(ix), step_y = fabs(iy);
    for (;;) {
        const float *c = p->heights + (size_t)j * (size_t)p->stride + (size_t)i;
        double to = fmin(fmin(tx, ty), end), z = oz + dz * (dz < 0.0 ? to : t);
        if (z <= (double)fmaxf(fmaxf(c[0], c[1]), fmaxf(c[p->stride], c[p->stride + 1]))) {
            double h00 = (double)c[0], hx = (double)c[1] - h00, hy = (double)c[p->stride] - h00;
            double hxy = (double)c[p->stride + 1] - (double)c[p->stride] - hx;
            double x = ox + dx * t - i, y = oy + dy * t - j;
            double s = plain_root(-hxy * dx * dy, dz - (hx * dx + hy * dy + hxy * (x * dy + y * dx)),
                                  oz + dz * t - (h00 + hx * x + hy * y + hxy * x * y), to - t);
            if (s >= 0.0) {
                *hit_t = (float)(t + s);
                return 1;
            }
        }
        if (to >= end) {
            *hit_t = (float)end;
            return on_floor;
        }
        t = to;
        if (tx < ty) i += si, tx += step_x;
        else j += sj, ty += step_y;
        if ((unsigned)i >= (unsigned)p->width || (unsigned)j >= (unsigned)p->height) return 0;
    }
}

/* ---- the figures ----------------------------------------------------------------------------------------

   1024 x 1024 texels, heights a quarter of the side. camera: a pinhole with 45 degrees from edge to edge that looks 30
   degrees down, its eye before the near side and 0.45 of the side high. random: random_rays. One thread; a ratio
   above 1 says that ours is the faster. */
enum { TRACE_PYRAMID, TRACE_CELLS, TRACE_EXACT, TRACE_PREPARED, TRACE_ARRAYS, TRACE_COUNT };
static const char *const trace_names[TRACE_COUNT] = {"pyramid", "cells", "exact", "prepared", "arrays"};

static void camera_rays(conemap_ray *rays) {
    const float down = 0.52359878f, half = 0.41421356f;
    memset(rays, 0, (size_t)(BENCH_SIDE * BENCH_SIDE) * sizeof rays[0]);
    for (int k = 0; k < BENCH_SIDE * BENCH_SIDE; ++k) {
        float x = half * (((float)(k % BENCH_SIDE) + 0.5f) / (0.5f * (float)BENCH_SIDE) - 1.0f);
        float y = half * (1.0f - ((float)(k / BENCH_SIDE) + 0.5f) / (0.5f * (float)BENCH_SIDE));
        rays[k].origin[0] = 0.5f;
        rays[k].origin[1] = -0.15f;
        rays[k].origin[2] = 0.45f / 0.25f;
        rays[k].direction[0] = x;
        rays[k].direction[1] = cosf(down) + y * sinf(down);
        rays[k].direction[2] = (y * cosf(down) - sinf(down)) / 0.25f;
    }
}

/* How many of some rays were missed, and by how many texels hits are off at the most, against the ground truth. */
static void trace_check(const conemap_map *map, const conemap_ray *rays, const float *t, int count, int *missed,
                        double *off) {
    struct truth_map truth;
    truth.width = map->info.width;
    truth.height = map->info.height;
    truth.wrap_u = truth.wrap_v = 0;
    truth.heights = map->heights;
    *missed = 0;
    *off = 0.0;
    for (int k = 0; k < count; k += count / 1000) {
        double o[3], d[3], at;
        for (int c = 0; c < 3; ++c) {
            o[c] = (double)rays[k].origin[c];
            d[c] = (double)rays[k].direction[c];
        }
        int hits = truth_trace(&truth, o, d, HUGE_VAL, &at);
        double length = sqrt(d[0] * d[0] + d[1] * d[1]) * (double)map->info.width;
        double far = t[k] >= 0.0f ? (double)t[k] * (1.0 - 1e-7) : -o[2] / d[2];
        if (truth_clearance(&truth, o, d, (1.0 - o[2]) / d[2], far) < -1.0 / 1048576.0) ++*missed;
        if (hits && t[k] >= 0.0f && fabs((double)t[k] - at) * length > *off) *off = fabs((double)t[k] - at) * length;
    }
}

static int bench_trace_rays(const char *map_name, const conemap_map *map, const conemap_prepared *prepared,
                            const struct plain *plain, int camera, const double goals[2]) {
    enum { RAYS = BENCH_SIDE * BENCH_SIDE };
    static conemap_ray rays[RAYS];
    static conemap_hit hits[RAYS];
    static float t[RAYS], columns[6][RAYS];
    static unsigned char status[RAYS];
    const char *kind = camera ? "camera" : "random";
    double times[TRACE_COUNT][ROUNDS], off[TRACE_COUNT];
    int missed[TRACE_COUNT];
    conemap_ray_arrays in;
    conemap_hit_arrays out;
    char name[64];
    if (camera) camera_rays(rays);
    else random_rays(rays, RAYS, 7u);
    memset(&in, 0, sizeof in);
    memset(&out, 0, sizeof out);
    out.status = status;
    out.t = t;
    for (int c = 0; c < 3; ++c) {
        in.origin[c] = columns[c];
        in.direction[c] = columns[3 + c];
        for (int k = 0; k < RAYS; ++k) {
            columns[c][k] = rays[k].origin[c];
            columns[3 + c][k] = rays[k].direction[c];
        }
    }
    for (int r = 0; r < ROUNDS; ++r)
        for (int method = 0; method < TRACE_COUNT; ++method) {
            double start = now();
            if (method == TRACE_EXACT) (void)conemap_trace(map, NULL, rays, hits, RAYS);
            else if (method == TRACE_PREPARED) (void)conemap_trace_prepared(prepared, rays, hits, RAYS);
            else if (method == TRACE_ARRAYS) (void)conemap_trace_arrays(prepared, &in, &out, RAYS);
            else
                for (int k = 0; k < RAYS; ++k) {
                    float at = -1.0f;
                    int hit = method == TRACE_PYRAMID ? plain_pyramid(plain, &rays[k], &at)
                                                      : plain_cells(plain, &rays[k], &at);
                    t[k] = hit ? at : -1.0f;
                }
            times[method][r] = now() - start;
            if (r > 0) continue;
            for (int k = 0; k < RAYS; ++k) {
                if (method == TRACE_EXACT || method == TRACE_PREPARED)
                    t[k] = hits[k].status == CONEMAP_HIT ? hits[k].t : -1.0f;
                if (method == TRACE_ARRAYS && status[k] != CONEMAP_HIT) t[k] = -1.0f;
            }
            trace_check(map, rays, t, RAYS, &missed[method], &off[method]);
        }
    for (int method = 0; method < TRACE_COUNT; ++method) {
        snprintf(name, sizeof name, "trace1024.%s.%s", trace_names[method], kind);
        figure(name, map_name, (double)RAYS / median(times[method]) * 1e-6, "Mrays/s");
        snprintf(name, sizeof name, "trace1024.%s.%s.misses", trace_names[method], kind);
        figure(name, map_name, (double)missed[method], method >= TRACE_EXACT ? "of 1000 rays, goal 0" : "of 1000 rays");
        snprintf(name, sizeof name, "trace1024.%s.%s.off", trace_names[method], kind);
        figure(name, map_name, off[method], "texels at most");
    }
    for (int k = 0; k < 2; ++k) {
        int base = k ? TRACE_CELLS : TRACE_PYRAMID;
        double best = median_ratio(times[base], times[TRACE_PREPARED]);
        double arrays = median_ratio(times[base], times[TRACE_ARRAYS]);
        char unit[64];
        if (arrays > best) best = arrays;
        snprintf(unit, sizeof unit, "ratio, goal %g: %s", goals[k], best >= goals[k] ? "met" : "missed");
        snprintf(name, sizeof name, "trace1024.best/%s.%s", trace_names[base], kind);
        figure(name, map_name, best, unit);
    }
    snprintf(name, sizeof name, "trace1024.pyramid/cells.%s", kind);
    figure(name, map_name, median_ratio(times[TRACE_CELLS], times[TRACE_PYRAMID]), "ratio");
    return missed[TRACE_PREPARED] == 0 && missed[TRACE_ARRAYS] == 0;
}

static int bench_trace(void) {
    /* over the pyramid, over the cells */
    static const double goals[2][2][2] = {{{3.0, 14.0}, {1.5, 7.0}}, {{9.0, 11.0}, {6.0, 6.0}}};
    int good = 1;
    for (int k = 0; k < 2; ++k) {
        int kind = k ? SPIKES : FBM;
        const char *name = name_of(procedural_names, kind);
        struct image image;
        struct plain plain;
        conemap_desc desc;
        conemap_map map;
        conemap_prepared prepared;
        if (!procedural_image(kind, 1024, 1, &image)) return 0;
        describe(&desc, &image);
        desc.texture.per_cell = 1;
        desc.max_tan = 16.0f;
        conemap_result result = conemap_build(&desc, &map);
        if (result != CONEMAP_OK) return fail_result("build", result);
        double start = now();
        result = conemap_prepare(&map, NULL, &prepared);
        double time = now() - start;
        if (result != CONEMAP_OK) return fail_result("prepare", result);
        if (!plain_make(&map, &plain)) return fail("no memory");
        figure("trace1024.prepare", name, time / (1024.0 * 1024.0) * 1e9, "ns/texel");
        figure("trace1024.prepare.size", name, prepared.bytes_per_texel,
               prepared.bytes_per_texel <= 8.0 ? "bytes/texel, goal 8: met" : "bytes/texel, goal 8: missed");
        good = bench_trace_rays(name, &map, &prepared, &plain, 1, goals[k][0]) && good;
        good = bench_trace_rays(name, &map, &prepared, &plain, 0, goals[k][1]) && good;
        plain_free(&plain);
        conemap_free_prepared(&prepared);
        conemap_free(&map);
        image_free(&image);
    }
    return good ? 1 : fail("the prepared tracer missed the surface");
}

#endif
