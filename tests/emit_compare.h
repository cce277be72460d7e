/* What an emitted tracer answered, against the CPU's tracer and against the truth. */
#ifndef EMIT_COMPARE_H
#define EMIT_COMPARE_H

#include <math.h>
#include <string.h>

#include "conemap.h"
#include "truth.h"
#include "zoo.h"

struct shader_hit {
    int found, status, steps; /* status, steps: -1 where they were not asked for */
    float t, position[3];
};

struct compare_counts {
    int rays, hits, different, unexplained, strict_misses, misses;
};

static inline float compare_unit(struct zoo_random *random) { return zoo_unit(random); }

/* A ray that ends: from above, from the side, rising, vertical, level, along texel centres, axes and diagonals. */
static inline conemap_ray compare_ray(struct zoo_random *random, int width, int height, int kind)
{
    conemap_ray ray;
    float target[3];
    int k, axis = zoo_below(random, 2);
    memset(&ray, 0, sizeof ray);
    for (k = 0; k < 3; ++k) {
        ray.origin[k] = compare_unit(random);
        target[k] = compare_unit(random);
    }
    switch (kind % 8) {
    case 0:
    case 1: ray.origin[2] = 1.0f; break;
    case 2: ray.origin[0] = ray.origin[0] * 2.0f - 0.5f; break;
    case 3: target[2] = ray.origin[2] + 0.05f + 0.3f * target[2]; break;
    case 4: /* straight down */
        target[0] = ray.origin[0];
        target[1] = ray.origin[1];
        ray.origin[2] = 1.0f;
        target[2] = 0.0f;
        break;
    case 5: /* grazing */
        ray.origin[2] = 0.3f + 0.6f * ray.origin[2];
        target[2] = ray.origin[2] - 0.05f * target[2];
        break;
    case 6: /* along texel centres */
        ray.origin[axis] =
            ((float)zoo_below(random, axis ? height : width) + 0.5f) / (float)(axis ? height : width);
        target[axis] = ray.origin[axis];
        ray.origin[2] = 0.8f;
        target[2] *= 0.5f;
        break;
    default: /* from corner to corner */
        ray.origin[0] = (float)zoo_below(random, 2);
        ray.origin[1] = (float)zoo_below(random, 2);
        target[0] = 1.0f - ray.origin[0];
        target[1] = 1.0f - ray.origin[1];
        break;
    }
    for (k = 0; k < 3; ++k) ray.direction[k] = target[k] - ray.origin[k];
    if (ray.direction[0] == 0.0f && ray.direction[1] == 0.0f && ray.direction[2] == 0.0f) ray.direction[2] = -1.0f;
    return ray;
}

/* Exactly along the rim of a surface that ends at its outermost centres: the last bit decides whether it meets it. */
static inline int compare_on_rim(const struct truth_map *truth, const conemap_ray *ray)
{
    int k;
    for (k = 0; k < 2; ++k) {
        const float size = (float)(k ? truth->height : truth->width), place = ray->origin[k] * size;
        if ((k ? truth->wrap_v : truth->wrap_u) == 2 && ray->direction[k] == 0.0f &&
            (fabsf(place - 0.5f) < 1e-4f || fabsf(place - size + 0.5f) < 1e-4f))
            return 1;
    }
    return 0;
}

/* Does it go on and on over a map that repeats? */
static inline int compare_is_endless(const struct truth_map *truth, const conemap_ray *ray)
{
    return (truth->wrap_u == 1 || truth->wrap_v == 1) && ray->direction[2] > -0.01f && ray->direction[2] < 0.01f;
}

/* Builds what a shader is written for, from heights of the zoo. */
static inline conemap_result compare_build(const conemap_shader_desc *shader, conemap_generator generator, int kind,
                                           int width, int height, uint32_t seed, float *heights, conemap_map *map,
                                           struct truth_map *truth)
{
    conemap_desc desc;
    conemap_result result;
    memset(&desc, 0, sizeof desc);
    zoo_fill(kind, width, height, seed, heights);
    desc.heights.pixels = heights;
    desc.heights.width = width;
    desc.heights.height = height;
    desc.wrap_u = shader->map.wrap_u;
    desc.wrap_v = shader->map.wrap_v;
    desc.aspect = shader->map.aspect;
    desc.max_tan = shader->map.max_tan;
    desc.texture = shader->map.texture;
    desc.generator = generator;
    desc.keep_pyramid = 1;
    result = conemap_build(&desc, map);
    truth->width = width;
    truth->height = height;
    truth->wrap_u = (int)desc.wrap_u;
    truth->wrap_v = (int)desc.wrap_v;
    truth->heights = map->heights;
    return result;
}

/* Length in t of 1/16 texel along the ray; for steep rays of 1/16 texel of height. */
static inline double compare_grain(const conemap_map *map, const conemap_ray *ray)
{
    double x = (double)ray->direction[0] * map->info.width, y = (double)ray->direction[1] * map->info.height;
    double z =
        (double)ray->direction[2] * (map->info.width > map->info.height ? map->info.width : map->info.height);
    return 1.0 / 16.0 / sqrt(x * x + y * y + z * z);
}

static inline int compare_same(const conemap_map *map, const conemap_ray *ray, const conemap_hit *cpu,
                               const struct shader_hit *gpu)
{
    if ((cpu->status == CONEMAP_HIT) != gpu->found) return 0;
    if (!gpu->found) return gpu->status < 0 || gpu->status == (int)cpu->status;
    return fabs((double)gpu->t - (double)cpu->t) <= compare_grain(map, ray);
}

/* Does the CPU give that answer to a ray that is a hair beside? Then the ray lies on an edge. */
static inline int compare_on_edge(const conemap_map *map, const conemap_trace_desc *desc, const conemap_ray *ray,
                                  const struct shader_hit *gpu)
{
    static const float sizes[2] = {1e-5f, 3e-4f};
    int k, size;
    for (size = 0; size < 2; ++size) {
        for (k = 0; k < 26; ++k) {
            conemap_ray beside = *ray;
            conemap_hit hit;
            int code = k < 13 ? k : k + 1;
            beside.origin[0] += (float)(code % 3 - 1) * sizes[size] / (float)map->info.width;
            beside.origin[1] += (float)(code / 3 % 3 - 1) * sizes[size] / (float)map->info.height;
            beside.origin[2] += (float)(code / 9 - 1) * sizes[size] * 0.1f;
            conemap_trace(map, desc, &beside, &hit, 1);
            if (compare_same(map, ray, &hit, gpu)) return 1;
        }
    }
    return 0;
}

/* How far the surface rises above the ray before the shader's hit, beyond what single precision can tell: the ray's place
   is off by up to 2^-22 of the texels that it crossed, and the steepest slope turns that into height. */
static inline void compare_truth(const conemap_map *map, const struct truth_map *truth, const conemap_ray *ray,
                                 const struct shader_hit *gpu, struct compare_counts *counts)
{
    double o[3], d[3], t = 0.0, end, begin = 0.0, clearance, x, y, way, limit;
    int k;
    for (k = 0; k < 3; ++k) {
        d[k] = (double)ray->direction[k];
        o[k] = (double)ray->origin[k] + d[k] * (double)ray->t_min; /* times from here on count from t_min */
    }
    end = ray->t_max > 0.0f ? (double)ray->t_max - (double)ray->t_min : 1e30;
    if (!truth_trace(truth, o, d, ray->t_max > 0.0f ? end : HUGE_VAL, &t)) return;
    truth_above_floor(o, d, &begin, &end);
    if (gpu->found) { /* t is added up step by step; the place is more exact far along a ray */
        double t_here, slack = 0.0;
        end = (double)gpu->t * (1.0 - 1.0 / 4194304.0) - (double)ray->t_min;
        for (k = 0; k < 2; ++k) { /* the side through which the surface is entered */
            if ((k ? truth->wrap_v : truth->wrap_u) == 2 && d[k] != 0.0 && 1.2e-7 / fabs(d[k]) > slack)
                slack = 1.2e-7 / fabs(d[k]);
        }
        k = fabs(d[1]) > fabs(d[0]);
        if (fabs(d[k]) > 0.01 * fabs(d[2])) {
            t_here = ((double)gpu->position[k] - o[k]) / d[k];
            slack += 3e-7 * (1.0 + fabs((double)gpu->position[k])) / fabs(d[k]);
            if (t_here < end) end = t_here;
        }
        end -= slack;
    }
    if (end <= begin || end < t) return;
    clearance = truth_clearance(truth, o, d, begin, end);
    if (clearance >= -1.0 / 1048576.0) return;
    ++counts->strict_misses;
    x = fabs(d[0]) * map->info.width;
    y = fabs(d[1]) * map->info.height;
    way = (x + y) * (t < 1e6 ? t : 1e6) + map->info.width + map->info.height;
    limit = 1.0 / 1048576.0 + way / 4194304.0;
    if (clearance < -limit) ++counts->misses;
}

static inline void compare_hit(const conemap_map *map, const struct truth_map *truth,
                               const conemap_trace_desc *desc, const conemap_ray *ray,
                               const struct shader_hit *gpu, struct compare_counts *counts)
{
    conemap_hit cpu;
    conemap_trace(map, desc, ray, &cpu, 1);
    ++counts->rays;
    counts->hits += gpu->found;
    if (!compare_same(map, ray, &cpu, gpu)) {
        ++counts->different;
        if (!compare_on_edge(map, desc, ray, gpu)) ++counts->unexplained;
    }
    if (desc->tracer == CONEMAP_TRACE_EXACT || desc->tracer == CONEMAP_TRACE_MAXMIP)
        compare_truth(map, truth, ray, gpu, counts);
}

#endif
