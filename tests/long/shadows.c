/* Hard shadows against the truth:  shadows RAYS PART PARTS. Every shadow ray of conemap_shade is followed in double
   precision through each cell. A leak: lit, though the surface rises by more than 2^-20 above the ray. A false shadow:
   dark, though the ray clears the surface everywhere by more than what rounding moves a double. Half the rays go
   through conemap_trace, half through the flights of curved bases (with no curvature, so that the truth knows them). */
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "../truth.h"
#include "../zoo.h"
#include <stdio.h>
#include <stdlib.h>

#define MISS (1.0 / 1048576.0)
#define CLEAR 1e-9

enum { RAYS = 2048, SIDE = 64 };

static long rays_done, dark, leaks, false_shadows, grazing;

/* The light ray as conemap_shade takes it from a hit: the same floats. */
static double light_ray(const conemap_effects *e, const conemap__basis *basis, const struct truth_map *truth,
                        const conemap_hit *hit, double from[3], double to[3])
{
    float light[3], box[3], world[3], d[3], distance = 0.0f;
    const int flight = (e->flags & CONEMAP_EFFECT_CURVED) != 0;
    int c;
    from[0] = (double)hit->u;
    from[1] = (double)hit->v;
    from[2] = truth_height(truth, from[0], from[1]) + MISS;
    if ((double)hit->z > from[2]) from[2] = (double)hit->z;
    memcpy(light, e->light, sizeof light);
    if (e->light_is_point) {
        box[0] = hit->u;
        box[1] = hit->v;
        box[2] = (float)from[2];
        conemap__point_to_world(basis, box, world);
        conemap__add_along(light, -1.0f, world, light);
        distance = sqrtf(conemap__dot(light, light));
    }
    conemap__normalise(light);
    conemap__direction_to_box(basis, light, d);
    for (c = 0; c < 3; ++c) to[c] = (double)d[c];
    if (!flight) from[2] = (double)(float)from[2];
    return e->light_is_point ? (double)distance : HUGE_VAL;
}

static int round_of(long round)
{
    static const int kinds[] = {ZOO_BRICKS, ZOO_FBM, ZOO_SPIKES, ZOO_WHITE, ZOO_CHECKERBOARD, ZOO_SADDLE, ZOO_CLIFF,
                                ZOO_IMPULSE, ZOO_BORDER_SPIKE, ZOO_RAMP};
    static float heights[SIDE * SIDE];
    static conemap_ray rays[RAYS];
    static conemap_hit hits[RAYS];
    static conemap_shading shadings[RAYS];
    struct zoo_random random = zoo_seed(900 + (uint64_t)round);
    const int w = 2 + zoo_below(&random, 40), h = 2 + zoo_below(&random, 40);
    struct truth_map truth;
    conemap_desc desc;
    conemap_map map;
    conemap_effects e;
    conemap_frame frame;
    conemap__basis basis;
    double low, high;
    int k;
    memset(&desc, 0, sizeof desc);
    zoo_fill(kinds[round % 10], w, h, (uint32_t)round, heights);
    desc.heights.pixels = heights;
    desc.heights.width = w;
    desc.heights.height = h;
    desc.wrap_u = (conemap_wrap)(round / 10 % 3);
    desc.wrap_v = (conemap_wrap)(round / 30 % 3);
    desc.texture.format = (conemap_format)zoo_below(&random, CONEMAP_FORMAT_COUNT);
    if (conemap_build(&desc, &map) != CONEMAP_OK) return 0;
    truth.width = w;
    truth.height = h;
    truth.wrap_u = (int)desc.wrap_u;
    truth.wrap_v = (int)desc.wrap_v;
    truth.heights = map.heights;
    truth_bounds(&truth, &low, &high);
    memset(&e, 0, sizeof e);
    memset(&frame, 0, sizeof frame);
    memset(rays, 0, sizeof rays);
    frame.depth = zoo_between(&random, 0.05f, 1.0f);
    frame.level = zoo_unit(&random);
    e.frames = &frame;
    e.flags = CONEMAP_EFFECT_SHADOW | (round & 1 ? (unsigned)CONEMAP_EFFECT_CURVED : 0u);
    e.light_is_point = zoo_below(&random, 3) == 0;
    for (k = 0; k < 2; ++k) e.light[k] = e.light_is_point ? zoo_unit(&random) : zoo_between(&random, -1.0f, 1.0f);
    e.light[2] = frame.depth * zoo_unit(&random);
    e.light[2] = e.light_is_point ? (1.0f - frame.level) * e.light[2] : e.light[2] + 0.01f;
    if (conemap__resolve_frame(&frame, 0.0f, NULL, 0, &basis) != CONEMAP_OK) return 0;
    for (k = 0; k < RAYS; ++k) { /* to places all over the map, from above */
        const float x = zoo_between(&random, -0.2f, 0.2f), y = zoo_between(&random, -0.2f, 0.2f);
        rays[k].origin[0] = zoo_unit(&random) - x;
        rays[k].origin[1] = zoo_unit(&random) - y;
        rays[k].origin[2] = frame.depth * (1.0f - frame.level) + 0.5f;
        rays[k].direction[0] = x;
        rays[k].direction[1] = y;
        rays[k].direction[2] = -0.5f - frame.depth;
    }
    if (conemap_shade(&map, NULL, &e, rays, hits, shadings, RAYS) != CONEMAP_OK) return 0;
    for (k = 0; k < RAYS; ++k) {
        double from[3], to[3], end, clearance;
        if (hits[k].status != CONEMAP_HIT || hits[k].inside) continue; /* sides of the solid have no truth here */
        end = light_ray(&e, &basis, &truth, &hits[k], from, to);
        if (to[2] > 0.0 && (high + 1.0 - from[2]) / to[2] < end) end = (high + 1.0 - from[2]) / to[2];
        clearance = truth_clearance(&truth, from, to, 0.0, end);
        ++rays_done;
        dark += shadings[k].shadow == 0.0f;
        grazing += clearance <= CLEAR && clearance >= -MISS;
        if ((shadings[k].shadow != 0.0f && clearance < -MISS) || (shadings[k].shadow == 0.0f && clearance > CLEAR)) {
            long *count = shadings[k].shadow == 0.0f ? &false_shadows : &leaks;
            if (++*count < 4)
                printf("round %ld, ray %d: %s, clearance %.3g from (%.9g, %.9g, %.9g) to (%.9g, %.9g, %.9g)\n", round,
                       k, shadings[k].shadow == 0.0f ? "false shadow" : "leak", clearance, from[0], from[1], from[2],
                       to[0], to[1], to[2]);
        }
    }
    conemap_free(&map);
    return 1;
}

int main(int argc, char **argv)
{
    const long wanted = argc > 1 ? atol(argv[1]) : 100000, part = argc > 2 ? atol(argv[2]) : 0;
    const long parts = argc > 3 ? atol(argv[3]) : 1;
    long round;
    for (round = part; rays_done < wanted / parts; round += parts)
        if (!round_of(round)) {
            printf("round %ld: an error\n", round);
            return 1;
        }
    printf("%ld shadow rays, %ld dark, %ld grazing, %ld leaks, %ld false shadows\n", rays_done, dark, grazing, leaks,
           false_shadows);
    return leaks || false_shadows;
}
