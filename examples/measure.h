/* What bench and accuracy share: medians, and rays at random. Include after common.h. */
#ifndef EXAMPLES_MEASURE_H
#define EXAMPLES_MEASURE_H

#include <time.h>

#define ROUNDS 5 /* every time is the median of so many interleaved rounds */

static EXAMPLE_UNUSED double now(void) { return (double)clock() / (double)CLOCKS_PER_SEC; }

static EXAMPLE_UNUSED int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Of up to 32 values. */
static EXAMPLE_UNUSED double median_of(const double *values, int count) {
    double sorted[32];
    memcpy(sorted, values, (size_t)count * sizeof sorted[0]);
    qsort(sorted, (size_t)count, sizeof sorted[0], by_value);
    return sorted[count / 2];
}

static EXAMPLE_UNUSED double median(const double *values) { return median_of(values, ROUNDS); }

/* From random points of the box's top, `lowest` to 85 degrees, on a map `depth` times as high as it is wide. */
static EXAMPLE_UNUSED void random_rays_from(conemap_ray *rays, int count, uint32_t seed, float lowest, float depth) {
    memset(rays, 0, (size_t)count * sizeof rays[0]);
    for (int k = 0; k < count; ++k) {
        float random[4];
        for (uint32_t c = 0; c < 4; ++c) random[c] = (float)(hash3((uint32_t)k, c, seed) >> 8) / 16777216.0f;
        float azimuth = random[2] * 6.2831853f, elevation = (lowest + (85.0f - lowest) * random[3]) * 0.017453293f;
        rays[k].origin[0] = random[0];
        rays[k].origin[1] = random[1];
        rays[k].origin[2] = 1.0f;
        rays[k].direction[0] = cosf(azimuth) * cosf(elevation);
        rays[k].direction[1] = sinf(azimuth) * cosf(elevation);
        rays[k].direction[2] = -sinf(elevation) / depth;
    }
}

/* The usual ones: 5 to 85 degrees, on a map a quarter as high as it is wide. */
static EXAMPLE_UNUSED void random_rays(conemap_ray *rays, int count, uint32_t seed) {
    random_rays_from(rays, count, seed, 5.0f, 0.25f);
}

#endif
