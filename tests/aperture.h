/* How wide could cones that are safe for the bilinear surface be? For a rectangle R of apices within one bilinear cell
   this brackets the supremum over p in R and all points q of the surface of slope(p, q) = (h(q) - h(p)) / |q - p|, in
   double precision and independently of the header: from below by slopes of real pairs of points, from above by bounds
   for pairs of patches, halving the pair with the largest bound first until both agree.

   Bounds for a pair of patches R and Q, i and j running over their corners:
   (a) (max h(Q) - min h(R)) over the least distance.
   (b) the largest (h_j - h_i) / sqrt(D_ij^2 - V), V the sum of the squared sides of both over 4: corner heights and
       squared corner distances average, under the bilinear weights, to h(q) - h(p) and to |q - p|^2 plus at most V,
       and the square root is concave.
   (c) for patches that touch, the longest gradient in the directions that lead from R to Q, over everything between
       them: a slope is the mean of derivatives along the segment.
   Only clamped maps, aspect 1. The outer half cells need no looking at: apices and points there have the heights of
   their projection onto the rectangle of centres, which only shortens |q - p|. */
#ifndef APERTURE_H
#define APERTURE_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

struct aperture_patch {
    int i, j;            /* its cell */
    double x, y, sx, sy; /* in texels; corner k at (x + (k & 1) sx, y + (k >> 1) sy) */
    double h[4];
};

/* A pair of patches, or of a patch and a block of cells that is still to be opened. */
struct aperture_pair {
    double bound;
    int level, x, y; /* a block; level -1: two patches */
    struct aperture_patch r, q;
};

struct aperture {
    int width, height; /* texels */
    double a, b;       /* a texel's size */
    const float *heights;
    int levels, cells_u[17], cells_v[17];
    float *maxima[17]; /* over blocks of cells */
    struct aperture_pair *heap;
    int count, room, failed;
    double low; /* the steepest real pair so far */
    long work;  /* pairs looked at, in all */
};

static inline void aperture_free(struct aperture *ap)
{
    int k;
    for (k = 0; k < ap->levels; ++k) free(ap->maxima[k]);
    free(ap->heap);
    memset(ap, 0, sizeof *ap);
}

/* heights: width * height, at least 2 x 2; kept, not copied. Returns 0 without memory. */
static inline int aperture_begin(struct aperture *ap, int width, int height, const float *heights)
{
    int k, x, y, c;
    memset(ap, 0, sizeof *ap);
    ap->width = width;
    ap->height = height;
    ap->a = 1.0 / (double)width;
    ap->b = 1.0 / (double)height;
    ap->heights = heights;
    for (k = 0; k == 0 || ap->cells_u[k - 1] > 1 || ap->cells_v[k - 1] > 1; ++k) {
        int w = k ? (ap->cells_u[k - 1] + 1) / 2 : width - 1, h = k ? (ap->cells_v[k - 1] + 1) / 2 : height - 1;
        float *to = (float *)malloc((size_t)w * (size_t)h * sizeof(float));
        if (!to) {
            aperture_free(ap);
            return 0;
        }
        ap->cells_u[k] = w;
        ap->cells_v[k] = h;
        ap->maxima[k] = to;
        ap->levels = k + 1;
        for (y = 0; y < h; ++y)
            for (x = 0; x < w; ++x) {
                float most = -1.0f;
                for (c = 0; c < 4; ++c) {
                    int i = (k ? 2 * x : x) + (c & 1), j = (k ? 2 * y : y) + (c >> 1);
                    float value;
                    if (k && (i >= ap->cells_u[k - 1] || j >= ap->cells_v[k - 1])) continue;
                    value = k ? ap->maxima[k - 1][(size_t)j * (size_t)ap->cells_u[k - 1] + (size_t)i]
                              : heights[(size_t)j * (size_t)width + (size_t)i];
                    if (value > most) most = value;
                }
                to[(size_t)y * (size_t)w + (size_t)x] = most;
            }
    }
    return 1;
}

static inline double aperture_texel(const struct aperture *ap, int i, int j)
{
    return (double)ap->heights[(size_t)j * (size_t)ap->width + (size_t)i];
}

/* The part x0..x0 + sx, y0..y0 + sy (0..1) of cell (i, j). */
static inline struct aperture_patch aperture_part(const struct aperture *ap, int i, int j, double x0, double y0,
                                                  double sx, double sy)
{
    struct aperture_patch patch;
    double h00 = aperture_texel(ap, i, j), h10 = aperture_texel(ap, i + 1, j);
    double h01 = aperture_texel(ap, i, j + 1), h11 = aperture_texel(ap, i + 1, j + 1);
    int k;
    patch.i = i;
    patch.j = j;
    patch.x = (double)i + x0;
    patch.y = (double)j + y0;
    patch.sx = sx;
    patch.sy = sy;
    for (k = 0; k < 4; ++k) {
        double x = k & 1 ? x0 + sx : x0, y = k & 2 ? y0 + sy : y0;
        patch.h[k] = (h00 * (1.0 - x) + h10 * x) * (1.0 - y) + (h01 * (1.0 - x) + h11 * x) * y;
    }
    return patch;
}

static inline double aperture_gap(double low0, double size0, double low1, double size1)
{
    double gap = low1 - (low0 + size0) > low0 - (low1 + size1) ? low1 - (low0 + size0) : low0 - (low1 + size1);
    return gap > 0.0 ? gap : 0.0;
}

static inline double aperture_most(const double *h) { return fmax(fmax(h[0], h[1]), fmax(h[2], h[3])); }

static inline double aperture_least(const double *h) { return fmin(fmin(h[0], h[1]), fmin(h[2], h[3])); }

/* The steepest ascent per uv along one axis, for slopes g0..g1 a texel, where the way may lead forth and back. */
static inline double aperture_ascent(double g0, double g1, int forth, int back, double size)
{
    double ascent = 0.0;
    if (forth) ascent = fmax(ascent, fmax(g0, g1));
    if (back) ascent = fmax(ascent, fmax(-g0, -g1));
    return ascent / size;
}

/* Bound (c). */
static inline double aperture_gradient(const struct aperture *ap, const struct aperture_patch *r,
                                       const struct aperture_patch *q)
{
    double x0 = fmin(r->x, q->x), x1 = fmax(r->x + r->sx, q->x + q->sx), most = 0.0;
    double y0 = fmin(r->y, q->y), y1 = fmax(r->y + r->sy, q->y + q->sy);
    int forth_u = q->x + q->sx > r->x, back_u = q->x < r->x + r->sx;
    int forth_v = q->y + q->sy > r->y, back_v = q->y < r->y + r->sy, i, j;
    for (j = q->j < r->j ? q->j : r->j; j <= (q->j > r->j ? q->j : r->j); ++j)
        for (i = q->i < r->i ? q->i : r->i; i <= (q->i > r->i ? q->i : r->i); ++i) {
            double h00 = aperture_texel(ap, i, j), h10 = aperture_texel(ap, i + 1, j);
            double h01 = aperture_texel(ap, i, j + 1), h11 = aperture_texel(ap, i + 1, j + 1);
            double u0 = fmax(x0 - i, 0.0), u1 = fmin(x1 - i, 1.0), v0 = fmax(y0 - j, 0.0), v1 = fmin(y1 - j, 1.0);
            double gx0 = (h10 - h00) * (1.0 - v0) + (h11 - h01) * v0, gx1 = (h10 - h00) * (1.0 - v1) + (h11 - h01) * v1;
            double gy0 = (h01 - h00) * (1.0 - u0) + (h11 - h10) * u0, gy1 = (h01 - h00) * (1.0 - u1) + (h11 - h10) * u1;
            double gx = aperture_ascent(gx0, gx1, forth_u, back_u, ap->a);
            double gy = aperture_ascent(gy0, gy1, forth_v, back_v, ap->b);
            most = fmax(most, gx * gx + gy * gy);
        }
    return sqrt(most);
}

/* Real pairs where the patches touch: from a corner of R that is in Q, a short way up Q's slope without leaving Q. */
static inline void aperture_climb(struct aperture *ap, const struct aperture_patch *r, const struct aperture_patch *q)
{
    int k;
    for (k = 0; k < 8; ++k) {
        const struct aperture_patch *from = k < 4 ? r : q, *in = k < 4 ? q : r;
        double x = from->x + (k & 1 ? from->sx : 0.0), y = from->y + (k & 2 ? from->sy : 0.0);
        double u, v, gx, gy, length, step, rise, hxy;
        if (x < in->x || x > in->x + in->sx || y < in->y || y > in->y + in->sy) continue;
        u = (x - q->x) / q->sx;
        v = (y - q->y) / q->sy;
        hxy = q->h[3] - q->h[2] - q->h[1] + q->h[0];
        gx = (q->h[1] - q->h[0] + hxy * v) / (q->sx * ap->a);
        gy = (q->h[2] - q->h[0] + hxy * u) / (q->sy * ap->b);
        if ((gx < 0.0 && u <= 0.0) || (gx > 0.0 && u >= 1.0)) gx = 0.0;
        if ((gy < 0.0 && v <= 0.0) || (gy > 0.0 && v >= 1.0)) gy = 0.0;
        length = sqrt(gx * gx + gy * gy);
        if (!(length > ap->low)) continue;
        /* the step in units of the patch; u and v move by less than what is left if it is short */
        step = 1.0 / 4096.0;
        gx = gx / length * fmin(q->sx * ap->a, q->sy * ap->b) * step / (q->sx * ap->a);
        gy = gy / length * fmin(q->sx * ap->a, q->sy * ap->b) * step / (q->sy * ap->b);
        if (u + gx < 0.0 || u + gx > 1.0 || v + gy < 0.0 || v + gy > 1.0) continue;
        rise = (q->h[1] - q->h[0]) * gx + (q->h[2] - q->h[0]) * gy + hxy * ((u + gx) * (v + gy) - u * v);
        length = sqrt(gx * gx * q->sx * q->sx * ap->a * ap->a + gy * gy * q->sy * q->sy * ap->b * ap->b);
        if (rise > ap->low * length) ap->low = rise / length;
    }
}

/* The bound of a pair of patches; raises ap->low by its real pairs. */
static inline double aperture_bound(struct aperture *ap, const struct aperture_patch *r, const struct aperture_patch *q)
{
    double nx = aperture_gap(r->x, r->sx, q->x, q->sx) * ap->a, ny = aperture_gap(r->y, r->sy, q->y, q->sy) * ap->b;
    double rise = aperture_most(q->h) - aperture_least(r->h), least2 = nx * nx + ny * ny, bound, corners = 0.0;
    double v =
        0.25 * ((r->sx * r->sx + q->sx * q->sx) * ap->a * ap->a + (r->sy * r->sy + q->sy * q->sy) * ap->b * ap->b);
    int i, j;
    ++ap->work;
    for (i = 0; i < 4; ++i)
        for (j = 0; j < 4; ++j) {
            double dx = (q->x + (j & 1 ? q->sx : 0.0) - r->x - (i & 1 ? r->sx : 0.0)) * ap->a;
            double dy = (q->y + (j & 2 ? q->sy : 0.0) - r->y - (i & 2 ? r->sy : 0.0)) * ap->b;
            double d2 = dx * dx + dy * dy, dh = q->h[j] - r->h[i];
            if (!(dh > 0.0)) continue;
            if (d2 > 0.0 && dh * dh > ap->low * ap->low * d2) ap->low = dh / sqrt(d2);
            corners = d2 > v ? fmax(corners, dh * dh / (d2 - v)) : HUGE_VAL;
        }
    if (!(rise > 0.0)) return 0.0;
    bound = least2 > 0.0 ? rise / sqrt(least2) : HUGE_VAL;
    if (corners < bound * bound) bound = sqrt(corners);
    if (least2 <= 0.0) {
        aperture_climb(ap, r, q);
        bound = fmin(bound, aperture_gradient(ap, r, q));
    }
    return bound;
}

static inline void aperture_push(struct aperture *ap, const struct aperture_pair *pair)
{
    int k;
    if (!(pair->bound > ap->low)) return;
    if (ap->count == ap->room) {
        int room = ap->room ? 2 * ap->room : 256;
        struct aperture_pair *heap = (struct aperture_pair *)realloc(ap->heap, (size_t)room * sizeof *heap);
        if (!heap) {
            ap->failed = 1;
            return;
        }
        ap->heap = heap;
        ap->room = room;
    }
    for (k = ap->count++; k > 0 && ap->heap[(k - 1) / 2].bound < pair->bound; k = (k - 1) / 2)
        ap->heap[k] = ap->heap[(k - 1) / 2];
    ap->heap[k] = *pair;
}

static inline struct aperture_pair aperture_pop(struct aperture *ap)
{
    struct aperture_pair top = ap->heap[0], last = ap->heap[--ap->count];
    int k = 0, child;
    while ((child = 2 * k + 1) < ap->count) {
        if (child + 1 < ap->count && ap->heap[child + 1].bound > ap->heap[child].bound) ++child;
        if (ap->heap[child].bound <= last.bound) break;
        ap->heap[k] = ap->heap[child];
        k = child;
    }
    ap->heap[k] = last;
    return top;
}

static inline void aperture_push_block(struct aperture *ap, const struct aperture_patch *r, int level, int x, int y)
{
    struct aperture_pair pair;
    double nx, ny, rise, size = (double)(1 << level);
    if (x >= ap->cells_u[level] || y >= ap->cells_v[level]) return;
    pair.level = level;
    pair.x = x;
    pair.y = y;
    pair.r = pair.q = *r;
    rise = (double)ap->maxima[level][(size_t)y * (size_t)ap->cells_u[level] + (size_t)x] - aperture_least(r->h);
    nx = aperture_gap(r->x, r->sx, (double)x * size, size) * ap->a;
    ny = aperture_gap(r->y, r->sy, (double)y * size, size) * ap->b;
    pair.bound = !(rise > 0.0) ? 0.0 : nx + ny > 0.0 ? rise / sqrt(nx * nx + ny * ny) : HUGE_VAL;
    aperture_push(ap, &pair);
}

/* Brackets max(at_least, the supremum over p in r and q anywhere) to within the factor 1 + tolerance. Returns 1, or 0
   without memory or where a million pairs do not do; *low and *high are true bounds in any case but that of memory. */
static inline int aperture_bracket(struct aperture *ap, const struct aperture_patch *r, double at_least,
                                   double tolerance, double *low, double *high)
{
    long stop = ap->work + 1000000;
    ap->count = 0;
    ap->low = at_least;
    aperture_push_block(ap, r, ap->levels - 1, 0, 0);
    while (ap->count > 0 && ap->heap[0].bound > ap->low * (1.0 + tolerance) && ap->work < stop && !ap->failed) {
        struct aperture_pair top = aperture_pop(ap), next;
        int k;
        if (top.level > 0) {
            for (k = 0; k < 4; ++k)
                aperture_push_block(ap, r, top.level - 1, 2 * top.x + (k & 1), 2 * top.y + (k >> 1));
            continue;
        }
        next.level = -1;
        next.x = next.y = 0;
        if (top.level == 0) {
            next.r = top.r;
            next.q = aperture_part(ap, top.x, top.y, 0.0, 0.0, 1.0, 1.0);
            next.bound = fmin(top.bound, aperture_bound(ap, &next.r, &next.q));
            aperture_push(ap, &next);
            continue;
        }
        for (k = 0; k < 2; ++k) { /* the longest of the four sides is halved */
            double rx = top.r.sx * ap->a, ry = top.r.sy * ap->b, qx = top.q.sx * ap->a, qy = top.q.sy * ap->b;
            struct aperture_patch *part;
            int across, c;
            next.r = top.r;
            next.q = top.q;
            part = fmax(rx, ry) > fmax(qx, qy) ? &next.r : &next.q;
            across = part->sx * ap->a >= part->sy * ap->b ? 1 : 2;
            for (c = 0; c < 4; ++c) {
                int low_corner = c & ~across, high_corner = c | across;
                int wanted = k ? !(c & across) : !!(c & across);
                if (wanted) {
                    const double *h = part == &next.r ? top.r.h : top.q.h;
                    part->h[c] = 0.5 * (h[low_corner] + h[high_corner]);
                }
            }
            if (across == 1) {
                part->sx *= 0.5;
                if (k) part->x += part->sx;
            } else {
                part->sy *= 0.5;
                if (k) part->y += part->sy;
            }
            next.bound = fmin(top.bound, aperture_bound(ap, &next.r, &next.q));
            aperture_push(ap, &next);
        }
    }
    *low = ap->low;
    *high = ap->count > 0 ? fmax(ap->low, ap->heap[0].bound) : ap->low;
    return !ap->failed && *high <= *low * (1.0 + tolerance);
}

/* What a map's cones are against the widest that the supremum allows: a texel's best is 1 / the steepest supremum of
   the cells that touch it, a cell's best 1 / its own. Means of min(tan, 1) over the texels looked at; best_low <=
   best <= best_high. */
struct aperture_report {
    long texels, open; /* looked at; with a cell whose bracket stayed open */
    long wider;        /* stored cones wider than 1 / the steepest real pair, by more than 2^-20 of that */
    double stored, best_low, best_high;
    double pairs; /* of patches looked at for a cell */
};

/* tangents: one for each texel, or for each cell by its lower corner. sample: so many texels at random (with
   repetition), or 0 for all. Returns 0 without memory. */
static inline int aperture_compare(int width, int height, const float *heights, const float *tangents, int per_cell,
                                   long sample, double tolerance, struct aperture_report *report)
{
    struct aperture ap;
    size_t cells = (size_t)(width - 1) * (size_t)(height - 1), k;
    long n, texels = sample ? sample : (long)width * (long)height, brackets = 0;
    double *known; /* of each cell: low and high, or 0 */
    uint64_t random = 1;
    int good = 1;
    memset(report, 0, sizeof *report);
    if (!aperture_begin(&ap, width, height, heights)) return 0;
    known = (double *)calloc(cells, 2 * sizeof *known);
    if (!known) {
        aperture_free(&ap);
        return 0;
    }
    for (n = 0; good && n < texels; ++n) {
        size_t at = (size_t)n;
        int x, y, i, j, open = 0;
        double low = 1.0, high = 1.0, stored;
        if (sample) {
            random = random * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
            at = (size_t)((random >> 33) % ((uint64_t)width * (uint64_t)height));
        }
        x = (int)(at % (size_t)width);
        y = (int)(at / (size_t)width);
        if (per_cell && (x >= width - 1 || y >= height - 1)) continue;
        for (j = per_cell ? y : y - 1; j <= y; ++j)
            for (i = per_cell ? x : x - 1; i <= x; ++i) {
                if (i < 0 || j < 0 || i >= width - 1 || j >= height - 1) continue;
                k = 2 * ((size_t)j * (size_t)(width - 1) + (size_t)i);
                if (!(known[k] > 0.0)) {
                    struct aperture_patch cell = aperture_part(&ap, i, j, 0.0, 0.0, 1.0, 1.0);
                    if (!aperture_bracket(&ap, &cell, 1.0, tolerance, &known[k], &known[k + 1])) good = !ap.failed;
                    ++brackets;
                }
                low = fmax(low, known[k]);
                high = fmax(high, known[k + 1]);
                open |= known[k + 1] > known[k] * (1.0 + tolerance);
            }
        stored = (double)tangents[at];
        ++report->texels;
        report->open += open;
        report->wider += low > 1.0 && stored * low > 1.0 + 1.0 / 1048576.0;
        report->stored += fmin(stored, 1.0);
        report->best_low += 1.0 / high;
        report->best_high += 1.0 / low;
    }
    report->stored /= (double)report->texels;
    report->best_low /= (double)report->texels;
    report->best_high /= (double)report->texels;
    report->pairs = (double)ap.work / (double)(brackets ? brackets : 1);
    free(known);
    aperture_free(&ap);
    return good;
}

/* EXPERIMENT: the corner values of cells chosen together. What interpolation must obey is a tangent of at most 1 /
   slope at every point of a cell, not at its corners. Each cell is cut into parts x parts; nowhere in a part may the
   tangent exceed 1 / the part's own supremum, so at the part's corners; and since a bilinear function over the part
   is at most its largest corner, that is enough. Starting from safe `tangents`, texels are raised greedily, in an
   order without pattern, at first by a share of the room that their four cells leave, in the end by all of it.
   Returns 0 without memory. */
static inline int aperture_raise(int width, int height, const float *heights, float *tangents, int parts,
                                 double tolerance)
{
    struct aperture ap;
    size_t columns = (size_t)(width - 1) * (size_t)parts + 1, rows = (size_t)(height - 1) * (size_t)parts + 1, k;
    double *most, share = 1.0 / (double)parts;
    int i, j, x, y, round, good = 1;
    if (!aperture_begin(&ap, width, height, heights)) return 0;
    most = (double *)malloc(columns * rows * sizeof *most);
    if (!most) {
        aperture_free(&ap);
        return 0;
    }
    for (k = 0; k < columns * rows; ++k) most[k] = 1.0;
    for (j = 0; good && j < (height - 1) * parts; ++j)
        for (i = 0; good && i < (width - 1) * parts; ++i) {
            struct aperture_patch part = aperture_part(&ap, i / parts, j / parts, (double)(i % parts) * share,
                                                       (double)(j % parts) * share, share, share);
            double low, high;
            int c;
            if (!aperture_bracket(&ap, &part, 1.0, tolerance, &low, &high)) good = !ap.failed;
            for (c = 0; c < 4; ++c) {
                double *at = &most[(size_t)(j + (c >> 1)) * columns + (size_t)(i + (c & 1))];
                *at = fmin(*at, (1.0 - 1e-6) / high);
            }
        }
    for (round = 0; good && round < 12; ++round)
        for (k = 0; k < (size_t)width * (size_t)height; ++k) {
            size_t at = k * 7919 % ((size_t)width * (size_t)height); /* a prime that divides neither side */
            int tx = (int)(at % (size_t)width), ty = (int)(at / (size_t)width);
            double room = 1.0 - (double)tangents[at];
            for (y = (ty - 1) * parts + 1; y < (ty + 1) * parts; ++y)
                for (x = (tx - 1) * parts + 1; x < (tx + 1) * parts; ++x) {
                    double u = (double)x * share - (double)tx, v = (double)y * share - (double)ty, weight, t;
                    int nx = tx + (u < 0.0 ? -1 : 1), ny = ty + (v < 0.0 ? -1 : 1);
                    if (x < 0 || y < 0 || x >= (int)columns || y >= (int)rows) continue;
                    nx = nx < 0 || nx >= width ? tx : nx;
                    ny = ny < 0 || ny >= height ? ty : ny;
                    u = fabs(u);
                    v = fabs(v);
                    weight = (1.0 - u) * (1.0 - v);
                    t = weight * (double)tangents[at] +
                        u * (1.0 - v) * (double)tangents[(size_t)ty * (size_t)width + (size_t)nx] +
                        (1.0 - u) * v * (double)tangents[(size_t)ny * (size_t)width + (size_t)tx] +
                        u * v * (double)tangents[(size_t)ny * (size_t)width + (size_t)nx];
                    room = fmin(room, (most[(size_t)y * columns + (size_t)x] - t) / weight);
                }
            if (room > 0.0)
                tangents[at] = (float)((double)tangents[at] + (round < 9 ? 0.25 : 1.0) * room * (1.0 - 1e-6));
        }
    free(most);
    aperture_free(&ap);
    return good;
}

#endif
