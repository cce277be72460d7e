/* What each effect costs: its time over that of the plain trace of the same rays, interleaved. Included by bench.c. */
#ifndef EXAMPLES_BENCH_EFFECTS_H
#define EXAMPLES_BENCH_EFFECTS_H

#include "bench_off.h"

enum { EFFECT_RAYS = 1 << 14, OFF_ROUNDS = 11 };

static const struct {
    const char *name;
    unsigned flags;
    float level; /* of the gradients: log2 of texels to a pixel */
} effect_cases[] = {
    {"off", 0, 0},
    {"position", CONEMAP_EFFECT_POSITION, 0},
    {"clip", CONEMAP_EFFECT_CLIP, 0},
    {"uv", CONEMAP_EFFECT_UV, 0},
    {"normal", CONEMAP_EFFECT_NORMAL, 0},
    {"smooth-normal", CONEMAP_EFFECT_SMOOTH_NORMAL, 0},
    {"depth", CONEMAP_EFFECT_DEPTH, 0},
    {"shadow", CONEMAP_EFFECT_SHADOW, 0},
    {"soft-shadow", CONEMAP_EFFECT_SOFT_SHADOW, 0},
    {"occlusion", CONEMAP_EFFECT_OCCLUSION, 0},
    {"sky-8", CONEMAP_EFFECT_SKY, 0},
    {"two-sided", CONEMAP_EFFECT_TWO_SIDED, 0},
    {"holes", CONEMAP_EFFECT_HOLES, 0},
    {"curved", CONEMAP_EFFECT_CURVED, 0},
    {"lod-0", CONEMAP_EFFECT_LOD, 0},
    {"lod-0.5", CONEMAP_EFFECT_LOD, 0.5f},
    {"lod-3.5", CONEMAP_EFFECT_LOD, 3.5f},
    {"fade-all", CONEMAP_EFFECT_FADE, 7.5f},
};

static int bench_effects(const char *map_name, const struct image *image) {
    enum { COUNT = sizeof effect_cases / sizeof effect_cases[0], LEVELS = 6 };
    static conemap_ray rays[EFFECT_RAYS], world[EFFECT_RAYS];
    static conemap_hit hits[EFFECT_RAYS];
    static conemap_shading shadings[EFFECT_RAYS];
    static conemap_gradient gradients[EFFECT_RAYS];
    static const float projection[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 0, 0.1f, 4};
    double times[COUNT][ROUNDS], base[ROUNDS], off[2], shares[OFF_ROUNDS];
    size_t texels = (size_t)image->width * (size_t)image->height;
    unsigned char *alpha = (unsigned char *)malloc(texels);
    conemap_map levels[LEVELS];
    conemap_desc desc;
    conemap_frame frame;
    conemap_effects e;
    if (!alpha) return fail("out of memory");
    for (size_t k = 0; k < texels; ++k) /* a quarter of the texels, in squares of 8 x 8 */
        alpha[k] = (k / 8 & 1) && (k / (size_t)image->width / 8 & 1) ? 0 : 255;
    describe(&desc, image);
    desc.keep_pyramid = 0;
    desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    conemap_result result = conemap_build_levels(&desc, levels, LEVELS);
    if (result != CONEMAP_OK) {
        free(alpha);
        return fail_result("build", result);
    }
    random_rays(rays, EFFECT_RAYS, 7u);
    memset(&frame, 0, sizeof frame);
    frame.depth = 0.25f;
    frame.curvature[0] = 0.4f;
    memcpy(world, rays, sizeof rays);
    for (int k = 0; k < EFFECT_RAYS; ++k) {
        world[k].origin[2] *= frame.depth;
        world[k].direction[2] *= frame.depth;
    }
    memset(&e, 0, sizeof e);
    e.frames = &frame;
    e.alpha = alpha;
    e.levels = levels;
    e.level_count = LEVELS;
    e.gradients = gradients;
    e.view_projection = projection;
    e.light[0] = 0.6f;
    e.light[1] = 0.3f;
    e.light[2] = 0.5f;
    e.light_radius = 0.03f;
    for (int r = 0; r < OFF_ROUNDS; ++r) { /* effects that are off, and a build without effects, in turns */
        off[0] = off[1] = 0;
        e.flags = 0;
        for (int turn = 0; turn < 8 && result == CONEMAP_OK; ++turn) {
            const int without = (turn + turn / 2) & 1;
            double start = now();
            result = without ? trace_without_effects(&levels[0], rays, hits, EFFECT_RAYS)
                             : trace_effects_off(&levels[0], &e, rays, hits, shadings, EFFECT_RAYS);
            off[without] += now() - start;
        }
        shares[r] = off[1] / off[0];
    }
    if (result == CONEMAP_OK) goal("effect.without/off", map_name, median_of(shares, OFF_ROUNDS), 0, 0.97);
    for (int r = 0; r < ROUNDS && result == CONEMAP_OK; ++r) {
        double start = now();
        result = conemap_trace(&levels[0], NULL, rays, hits, EFFECT_RAYS);
        base[r] = now() - start;
        for (int c = 0; c < COUNT && result == CONEMAP_OK; ++c) {
            float texel = powf(2.0f, effect_cases[c].level) / (float)image->width;
            for (int k = 0; k < EFFECT_RAYS; ++k) {
                gradients[k].dudx = gradients[k].dvdy = texel;
                gradients[k].dvdx = gradients[k].dudy = 0;
            }
            e.flags = effect_cases[c].flags;
            start = now();
            result = conemap_shade(&levels[0], NULL, &e, e.flags ? world : rays, hits, shadings, EFFECT_RAYS);
            times[c][r] = now() - start;
        }
        part_done();
    }
    if (result == CONEMAP_OK)
        for (int c = 0; c < COUNT; ++c) {
            char name[64];
            snprintf(name, sizeof name, "effect.%s/trace", effect_cases[c].name);
            figure(name, map_name, median_ratio(times[c], base), "ratio (time with it over the plain trace)");
        }
    for (int k = 0; k < LEVELS; ++k) conemap_free(&levels[k]);
    free(alpha);
    return result == CONEMAP_OK ? 1 : fail_result("effects", result);
}

#endif
