/* Flying away from a map that repeats:  flight. The same view from ever higher, straight down, with levels of detail
   and fading. Consecutive frames differ, as everything moves; but no frame may differ from the one before by much more
   than its neighbours do, which is what is seen as popping. Levels that are not blended, for comparison, do pop. */
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "../zoo.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { SIDE = 128, PICTURE = 64, FRAMES = 300, LEVELS = 8 };

static float pictures[2][PICTURE * PICTURE];

static int render(const conemap_map *levels, float pixel, int snap, float *picture)
{
    static conemap_ray rays[PICTURE * PICTURE];
    static conemap_hit hits[PICTURE * PICTURE];
    static conemap_shading shadings[PICTURE * PICTURE];
    static conemap_gradient gradients[PICTURE * PICTURE];
    const float light[3] = {0.6f, 0.35f, 0.5f}, level = log2f(pixel * (float)SIDE);
    const float length = sqrtf(light[0] * light[0] + light[1] * light[1] + light[2] * light[2]);
    const float step = snap && level > 0.0f ? exp2f(floorf(level + 0.5f)) / (float)SIDE : pixel;
    conemap_effects e;
    conemap_frame frame;
    int x, y, k;
    memset(&e, 0, sizeof e);
    memset(&frame, 0, sizeof frame);
    memset(rays, 0, sizeof rays);
    memset(gradients, 0, sizeof gradients);
    frame.depth = 0.08f;
    e.flags = CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_SOFT_SHADOW;
    e.frames = &frame;
    e.gradients = gradients;
    e.levels = levels;
    e.level_count = LEVELS;
    e.light_radius = 0.05f;
    memcpy(e.light, light, sizeof light);
    for (y = 0; y < PICTURE; ++y)
        for (x = 0; x < PICTURE; ++x) {
            k = y * PICTURE + x;
            /* turned, so that rows of pixels do not move over rows of bricks together */
            const float right = pixel * (float)(x - PICTURE / 2), below = pixel * (float)(y - PICTURE / 2);
            rays[k].origin[0] = 0.37f + 0.8f * right - 0.6f * below;
            rays[k].origin[1] = 0.61f + 0.6f * right + 0.8f * below;
            rays[k].origin[2] = 1.0f;
            rays[k].direction[2] = -1.0f;
            gradients[k].dudx = gradients[k].dvdy = 0.8f * step;
            gradients[k].dvdx = 0.6f * step;
            gradients[k].dudy = -0.6f * step;
        }
    if (conemap_shade(&levels[0], NULL, &e, rays, hits, shadings, PICTURE * PICTURE) != CONEMAP_OK) return 0;
    for (k = 0; k < PICTURE * PICTURE; ++k) {
        const float *n = shadings[k].normal;
        const float sun = (n[0] * light[0] + n[1] * light[1] + n[2] * light[2]) / length;
        picture[k] = 0.3f + 0.7f * shadings[k].shadow * (sun > 0.0f ? sun : 0.0f);
    }
    return 1;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

/* The worst frame: its difference over the median of those up to 4 before and behind it. */
static double worst_step(const conemap_map *levels, int snap, int *where)
{
    static double steps[FRAMES];
    double worst = 0.0, around[9];
    int k, m, n;
    for (k = 0; k <= FRAMES; ++k) {
        double sum = 0.0;
        if (!render(levels, powf(1.004f, (float)k) * 2.3f / (float)SIDE, snap, pictures[k & 1])) exit(1);
        for (n = 0; k > 0 && n < PICTURE * PICTURE; ++n) {
            const double d = (double)(pictures[0][n] - pictures[1][n]);
            sum += d * d;
        }
        if (k > 0) steps[k - 1] = sqrt(sum / (PICTURE * PICTURE));
        if (k > 0 && getenv("FLIGHT_NOTE")) printf("%d %.5f\n", k, steps[k - 1]);
    }
    for (k = 0; k < FRAMES; ++k) {
        for (m = -4, n = 0; m <= 4; ++m)
            if (k + m >= 0 && k + m < FRAMES) around[n++] = steps[k + m];
        qsort(around, (size_t)n, sizeof *around, ascending);
        if (steps[k] / (around[n / 2] + 1.0 / 1024.0) > worst) {
            worst = steps[k] / (around[n / 2] + 1.0 / 1024.0);
            *where = k;
        }
    }
    return worst;
}

int main(void)
{
    static const int kinds[] = {ZOO_BRICKS, ZOO_FBM, ZOO_SPIKES};
    static float heights[SIDE * SIDE];
    int m, bad = 0;
    for (m = 0; m < 3; ++m) {
        conemap_map levels[LEVELS];
        conemap_desc desc;
        double blended, snapped;
        int k, at = 0, other = 0;
        memset(&desc, 0, sizeof desc);
        zoo_fill(kinds[m], SIDE, SIDE, 4, heights);
        desc.heights.pixels = heights;
        desc.heights.width = desc.heights.height = SIDE;
        desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
        if (conemap_build_levels(&desc, levels, LEVELS) != CONEMAP_OK) return 1;
        blended = worst_step(levels, 0, &at);
        snapped = worst_step(levels, 1, &other);
        printf("flight over %s, %d frames: the worst differs %.2f times as much as its neighbours (frame %d); %.2f "
               "without blending (frame %d)\n",
               zoo_name(kinds[m]), FRAMES, blended, at, snapped, other);
        bad |= blended > 1.6 || snapped < 2.5;
        for (k = 0; k < LEVELS; ++k) conemap_free(&levels[k]);
    }
    return bad;
}
