/* The ground truth of a ray against the bilinear surface, in double precision and without any acceleration:
   it walks from bilinear cell to bilinear cell and solves each cell's quadratic.

   The surface, per axis (0 clamp, 1 wrap, 2 nothing): over 0..1 with the border texel going on for the outer
   half texel; without end; only between the outermost texel centres (an axis of one texel: as clamp). It is
   solid down to z = 0, the floor of its box; nothing happens below that. */
#ifndef TRUTH_H
#define TRUTH_H

#include <math.h>
#include <stddef.h>

struct truth_map {
    int width, height;
    int wrap_u, wrap_v; /* 0 clamp, 1 wrap, 2 nothing */
    const float *heights;
};

#define TRUTH_MAX_CELLS 4194304 /* an endless ray is given up after so many cells */

/* One axis of a ray, in texels: cell k lies between the centres of texels k and k + 1. */
struct truth_axis {
    int size, wraps;
    double low, high; /* where the surface ends; meaningless with wraps */
    double start, speed;
    double cell;     /* the cell of the ray; a double holds every integer that a ray can reach */
    double position; /* on the way through this cell: where the ray enters it */
    double next;     /* t at which the ray leaves this cell along this axis */
};

/* A walk: the cell that the ray is in, and the ray's height above the surface there,
   clearance(r) = (a r + b) r + c with t = t_in + r (t_out - t_in), 0 <= r <= 1. */
struct truth_walk {
    const struct truth_map *map;
    struct truth_axis u, v;
    double z, z_speed, t_in, t_out, t_end;
    double a, b, c;
    int cells;
};

static inline double truth_texel(const struct truth_map *map, double x, double y)
{
    double w = (double)map->width, h = (double)map->height;
    if (map->wrap_u == 1) x -= floor(x / w) * w;
    if (map->wrap_v == 1) y -= floor(y / h) * h;
    if (x < 0.0) x = 0.0;
    if (x > w - 1.0) x = w - 1.0;
    if (y < 0.0) y = 0.0;
    if (y > h - 1.0) y = h - 1.0;
    return (double)map->heights[(size_t)y * (size_t)map->width + (size_t)x];
}

static inline void truth_axis_domain(struct truth_axis *axis, int size, int wrap)
{
    axis->size = size;
    axis->wraps = wrap == 1;
    axis->low = wrap == 2 && size > 1 ? 0.0 : -0.5;
    axis->high = wrap == 2 && size > 1 ? (double)size - 1.0 : (double)size - 0.5;
}

/* The cell that holds a position, kept within the surface. */
static inline double truth_axis_cell(const struct truth_axis *axis, double *position)
{
    double cell;
    if (!axis->wraps) {
        if (*position < axis->low) *position = axis->low;
        if (*position > axis->high) *position = axis->high;
    }
    cell = floor(*position);
    if (!axis->wraps && cell >= axis->high) cell -= 1.0; /* only where high is a texel centre */
    return cell;
}

/* The height at (u, v); positions off the surface are moved to its border. */
static inline double truth_height(const struct truth_map *map, double u, double v)
{
    struct truth_axis au, av;
    double x = u * (double)map->width - 0.5, y = v * (double)map->height - 0.5, i, j, a, b;
    truth_axis_domain(&au, map->width, map->wrap_u);
    truth_axis_domain(&av, map->height, map->wrap_v);
    i = truth_axis_cell(&au, &x);
    j = truth_axis_cell(&av, &y);
    a = x - i;
    b = y - j;
    return (truth_texel(map, i, j) * (1.0 - a) + truth_texel(map, i + 1.0, j) * a) * (1.0 - b) +
           (truth_texel(map, i, j + 1.0) * (1.0 - a) + truth_texel(map, i + 1.0, j + 1.0) * a) * b;
}

static inline void truth_axis_clip(const struct truth_axis *axis, double *t0, double *t1)
{
    double enter, leave;
    if (axis->wraps) return;
    if (axis->speed == 0.0) {
        if (axis->start < axis->low || axis->start > axis->high) *t1 = -1.0;
        return;
    }
    enter = ((axis->speed > 0.0 ? axis->low : axis->high) - axis->start) / axis->speed;
    leave = ((axis->speed > 0.0 ? axis->high : axis->low) - axis->start) / axis->speed;
    if (enter > *t0) *t0 = enter;
    if (leave < *t1) *t1 = leave;
}

static inline void truth_axis_next(struct truth_axis *axis)
{
    axis->next = HUGE_VAL;
    if (axis->speed > 0.0) axis->next = (axis->cell + 1.0 - axis->start) / axis->speed;
    if (axis->speed < 0.0) axis->next = (axis->cell - axis->start) / axis->speed;
}

/* Position at t within the current cell. */
static inline double truth_axis_at(const struct truth_axis *axis, double t)
{
    double position = axis->start + axis->speed * t;
    if (axis->speed == 0.0) position = axis->start;
    if (t == axis->next) position = axis->speed > 0.0 ? axis->cell + 1.0 : axis->cell;
    if (position < axis->cell) position = axis->cell;
    if (position > axis->cell + 1.0) position = axis->cell + 1.0;
    return position;
}

static inline void truth_walk_cell(struct truth_walk *walk)
{
    double t_out = walk->t_end, h00, h10, h01, h11, c1, c2, c3, a, b, da, db, z0, z1;
    if (walk->u.next < t_out) t_out = walk->u.next;
    if (walk->v.next < t_out) t_out = walk->v.next;
    if (t_out < walk->t_in) t_out = walk->t_in;
    walk->t_out = t_out;

    h00 = truth_texel(walk->map, walk->u.cell, walk->v.cell);
    h10 = truth_texel(walk->map, walk->u.cell + 1.0, walk->v.cell);
    h01 = truth_texel(walk->map, walk->u.cell, walk->v.cell + 1.0);
    h11 = truth_texel(walk->map, walk->u.cell + 1.0, walk->v.cell + 1.0);
    c1 = h10 - h00;
    c2 = h01 - h00;
    c3 = h00 - h10 - h01 + h11;
    a = walk->u.position - walk->u.cell;
    b = walk->v.position - walk->v.cell;
    da = truth_axis_at(&walk->u, t_out) - walk->u.position;
    db = truth_axis_at(&walk->v, t_out) - walk->v.position;
    z0 = walk->z + walk->z_speed * walk->t_in;
    z1 = walk->z + walk->z_speed * t_out;
    walk->a = -c3 * da * db;
    walk->b = (z1 - z0) - c1 * da - c2 * db - c3 * (a * db + b * da);
    walk->c = z0 - (h00 + c1 * a + c2 * b + c3 * a * b);
}

/* Starts a walk over t0..t1; returns 0 if the ray is never over the surface there. */
static inline int truth_walk_begin(struct truth_walk *walk, const struct truth_map *map,
                                   const double origin[3], const double direction[3], double t0, double t1)
{
    walk->map = map;
    truth_axis_domain(&walk->u, map->width, map->wrap_u);
    truth_axis_domain(&walk->v, map->height, map->wrap_v);
    walk->u.start = origin[0] * (double)map->width - 0.5;
    walk->u.speed = direction[0] * (double)map->width;
    walk->v.start = origin[1] * (double)map->height - 0.5;
    walk->v.speed = direction[1] * (double)map->height;
    walk->z = origin[2];
    walk->z_speed = direction[2];
    truth_axis_clip(&walk->u, &t0, &t1);
    truth_axis_clip(&walk->v, &t0, &t1);
    if (!(t0 <= t1)) return 0;
    walk->t_in = t0;
    walk->t_end = t1;
    walk->u.position = walk->u.speed == 0.0 ? walk->u.start : walk->u.start + walk->u.speed * t0;
    walk->v.position = walk->v.speed == 0.0 ? walk->v.start : walk->v.start + walk->v.speed * t0;
    walk->u.cell = truth_axis_cell(&walk->u, &walk->u.position);
    walk->v.cell = truth_axis_cell(&walk->v, &walk->v.position);
    truth_axis_next(&walk->u);
    truth_axis_next(&walk->v);
    walk->cells = 0;
    truth_walk_cell(walk);
    return 1;
}

/* Goes on to the next cell; returns 0 at the end. */
static inline int truth_walk_next(struct truth_walk *walk)
{
    int step_u = walk->u.next <= walk->t_out, step_v = walk->v.next <= walk->t_out;
    double u = truth_axis_at(&walk->u, walk->t_out), v = truth_axis_at(&walk->v, walk->t_out);
    if (walk->t_out >= walk->t_end || ++walk->cells >= TRUTH_MAX_CELLS) return 0;
    if (step_u) walk->u.cell += walk->u.speed > 0.0 ? 1.0 : -1.0;
    if (step_v) walk->v.cell += walk->v.speed > 0.0 ? 1.0 : -1.0;
    walk->u.position = u;
    walk->v.position = v;
    truth_axis_next(&walk->u);
    truth_axis_next(&walk->v);
    walk->t_in = walk->t_out;
    truth_walk_cell(walk);
    return 1;
}

static inline void truth_bounds(const struct truth_map *map, double *low, double *high)
{
    size_t count = (size_t)map->width * (size_t)map->height, k;
    *low = *high = (double)map->heights[0];
    for (k = 1; k < count; ++k) {
        if ((double)map->heights[k] < *low) *low = (double)map->heights[k];
        if ((double)map->heights[k] > *high) *high = (double)map->heights[k];
    }
}

/* The part of t0..t1 on which the ray is not below the floor; with a grain of room for rounding. */
static inline void truth_above_floor(const double origin[3], const double direction[3], double *t0,
                                     double *t1)
{
    const double floor_z = -1e-9;
    if (direction[2] < 0.0) {
        double leave = (floor_z - origin[2]) / direction[2];
        if (leave < *t1) *t1 = leave;
    } else if (direction[2] > 0.0) {
        double enter = (floor_z - origin[2]) / direction[2];
        if (enter > *t0) *t0 = enter;
    } else if (origin[2] < floor_z) {
        *t1 = -1.0;
    }
}

/* truth_trace where the height of the highest texel is known, above which nothing happens. */
static inline int truth_trace_below(const struct truth_map *map, double high, const double origin[3],
                                    const double direction[3], double t_max, double *t)
{
    struct truth_walk walk;
    double t0 = 0.0, t1 = t_max;

    truth_above_floor(origin, direction, &t0, &t1);
    high += 1e-9;
    if (direction[2] < 0.0) {
        double enter = (high - origin[2]) / direction[2];
        if (enter > t0) t0 = enter;
    } else if (direction[2] > 0.0) {
        double leave = (high - origin[2]) / direction[2];
        if (leave < t1) t1 = leave;
    } else if (origin[2] > high) {
        return 0;
    }
    if (!(t0 <= t1) || !truth_walk_begin(&walk, map, origin, direction, t0, t1)) return 0;
    do {
        double r = -1.0, span = walk.t_out - walk.t_in;
        if (walk.c <= 0.0) {
            *t = walk.t_in;
            return 1;
        }
        if (walk.a == 0.0) {
            if (walk.b < 0.0) r = walk.c / -walk.b;
        } else {
            double d = walk.b * walk.b - 4.0 * walk.a * walk.c;
            if (d >= 0.0) {
                double q = -0.5 * (walk.b + (walk.b < 0.0 ? -sqrt(d) : sqrt(d)));
                double r1 = q / walk.a, r2 = q != 0.0 ? walk.c / q : -1.0;
                r = r1;
                if (r < 0.0 || (r2 >= 0.0 && r2 < r)) r = r2;
            }
        }
        if (!(r >= 0.0 && r <= 1.0) && walk.a + walk.b + walk.c <= 0.0) r = 1.0;
        if (r >= 0.0 && r <= 1.0) {
            *t = walk.t_in + r * span;
            return 1;
        }
    } while (truth_walk_next(&walk));
    return 0;
}

/* The first 0 <= t <= t_max at which the ray is at or below the surface: 1 and *t, or 0 if there is none.
   t_max may be HUGE_VAL; a ray that never ends is given up after TRUTH_MAX_CELLS cells. */
static inline int truth_trace(const struct truth_map *map, const double origin[3], const double direction[3],
                              double t_max, double *t)
{
    double low, high;
    truth_bounds(map, &low, &high);
    return truth_trace_below(map, high, origin, direction, t_max, t);
}

/* The least height of the ray above the surface over t0 <= t <= t1 (negative: below); HUGE_VAL if the ray is
   never over the surface there. t1 may be HUGE_VAL where the ray leaves the map. */
static inline double truth_clearance(const struct truth_map *map, const double origin[3],
                                     const double direction[3], double t0, double t1)
{
    struct truth_walk walk;
    double least = HUGE_VAL;
    if (!(t0 <= t1) || !truth_walk_begin(&walk, map, origin, direction, t0, t1)) return least;
    if (walk.t_end > 1e300) { /* endless: the height decides, unless there is no telling */
        double low, high;
        truth_bounds(map, &low, &high);
        if (direction[2] < 0.0) return -HUGE_VAL;
        if (direction[2] > 0.0) {
            double far = (high + 1.0 - origin[2]) / direction[2];
            if (!truth_walk_begin(&walk, map, origin, direction, t0, far > t0 ? far : t0)) return least;
        }
    }
    do {
        double end = walk.a + walk.b + walk.c;
        if (walk.c < least) least = walk.c;
        if (end < least) least = end;
        if (walk.a > 0.0 && walk.b < 0.0 && -walk.b < 2.0 * walk.a) {
            double vertex = walk.c - walk.b * walk.b / (4.0 * walk.a);
            if (vertex < least) least = vertex;
        }
    } while (truth_walk_next(&walk));
    return least;
}

#endif
