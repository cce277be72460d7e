/* The frusta's part of bench: updates, rays, exact against linear v, equal steps against cone steps. Include after
   bench.c's figure(). */
#ifndef BENCH_FRUSTA_H
#define BENCH_FRUSTA_H

static float frusta_random(uint32_t k, uint32_t what) { return (float)(hash3(k, what, 11u) >> 8) / 16777216.0f; }

/* Chains of ten slightly bent, tapered segments, scattered over a square. */
static int frusta_plant(int most, float bend, conemap_joint *joints, conemap_segment *segments, int *joint_count) {
    int count = 0, joint = 0;
    uint32_t random = 0;
    memset(segments, 0, (size_t)most * sizeof *segments);
    for (int chain = 0; count < most; ++chain) {
        float side = sqrtf((float)most / 10.0f) * 3.0f, direction[3] = {0, 1, 0};
        int parent = -1;
        joints[joint].position[0] = side * frusta_random(random++, 1);
        joints[joint].position[1] = 0;
        joints[joint].position[2] = side * frusta_random(random++, 2);
        joints[joint].radius = 0.4f;
        joints[joint++].thickness = 0.1f;
        for (int k = 0; k < 10 && count < most; ++k) {
            conemap_joint *to = &joints[joint];
            for (int c = 0; c < 3; ++c) direction[c] += bend * (frusta_random(random++, 3) - 0.5f);
            float length =
                sqrtf(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
            for (int c = 0; c < 3; ++c) {
                direction[c] /= length;
                to->position[c] = to[-1].position[c] + direction[c];
            }
            to->radius = 0.4f * (1 - 0.08f * (float)(k + 1));
            to->thickness = 0.25f * to->radius;
            segments[count].base = joint - 1;
            segments[count].top = joint++;
            segments[count].parent = parent;
            parent = count++;
        }
    }
    *joint_count = joint;
    return count;
}

static int bench_updates(void) {
    enum { COUNT = 100000 };
    conemap_joint *joints = (conemap_joint *)malloc((COUNT + COUNT / 10 + 2) * sizeof *joints);
    conemap_segment *segments = (conemap_segment *)malloc(COUNT * sizeof *segments);
    conemap_skeleton skeleton;
    conemap_skeleton_desc desc;
    double times[ROUNDS];
    memset(&desc, 0, sizeof desc);
    memset(&skeleton, 0, sizeof skeleton);
    int good = joints && segments;
    if (good) {
        desc.joints = joints;
        desc.segments = segments;
        desc.segment_count = frusta_plant(COUNT, 0.4f, joints, segments, &desc.joint_count);
        conemap_result result = conemap_skeleton_build(&desc, &skeleton);
        good = result == CONEMAP_OK || fail_result("skeleton", result);
    }
    for (int r = 0; good && r < ROUNDS; ++r) {
        for (int k = 0; k < desc.joint_count; ++k) joints[k].position[k % 3] += 0.01f;
        double start = now();
        good = conemap_skeleton_update(&skeleton, joints) == CONEMAP_OK;
        times[r] = now() - start;
        part_done();
    }
    if (good) figure("frusta.update", "100000", median(times) / COUNT * 1e9, "ns/segment");
    conemap_skeleton_free(&skeleton);
    free(joints);
    free(segments);
    return good;
}

/* Rays from outside towards random points of the chains. */
static void frusta_rays(const conemap_joint *joints, int joint_count, conemap_ray *rays, int count) {
    memset(rays, 0, (size_t)count * sizeof *rays);
    for (int k = 0; k < count; ++k) {
        const conemap_joint *to =
            &joints[(int)(frusta_random((uint32_t)k, 20) * (float)joint_count) % joint_count];
        float azimuth = 6.2831853f * frusta_random((uint32_t)k, 21),
              up = 0.2f + 0.8f * frusta_random((uint32_t)k, 22);
        float aim[3] = {cosf(azimuth), up, sinf(azimuth)};
        for (uint32_t c = 0; c < 3; ++c) {
            rays[k].direction[c] = -aim[c];
            rays[k].origin[c] = to->position[c] + 4 * aim[c] + 0.6f * (frusta_random((uint32_t)k, 23 + c) - 0.5f);
        }
    }
}

/* Share of hits that are wrong: further than a hundredth of the radius from where very many exact steps end, or
   missing. */
static double frusta_wrong(const conemap_skeleton_hit *hits, const conemap_skeleton_hit *right, int count) {
    int wrong = 0, all = 0;
    for (int k = 0; k < count; ++k) {
        if (right[k].status != CONEMAP_HIT) continue;
        ++all;
        wrong += hits[k].status != CONEMAP_HIT || fabsf(hits[k].t - right[k].t) > 0.003f;
    }
    return all ? 100.0 * wrong / all : 0;
}

/* The relief's height at a place of a frustum. */
static float frusta_height(const conemap_map *map, const conemap_frustum *f, float u, float v) {
    conemap_sample sample;
    v = v < 0 ? 0 : v > 1 ? 1 : v;
    conemap_sample_at(map, (u + v * f->twist) * (float)f->u_repeat, f->v_start + v * f->v_size, &sample);
    return sample.height;
}

/* The same relief as displaced meshes, as [BJCW09 section 4] compares with, of `side` quads around a segment and as many
   along it as make them square on the map: the share of their points that are wrong, by frusta_wrong's measure. */
static double frusta_mesh_wrong(const conemap_skeleton *skeleton, const conemap_map *map, int side, int rows) {
    enum { POINTS = 20000 };
    int wrong = 0;
    for (uint32_t k = 0; k < POINTS; ++k) {
        const conemap_frustum *f = &skeleton->frusta[(int)(k * 31u % (uint32_t)skeleton->count)];
        float x = frusta_random(k, 41), y = frusta_random(k, 42), place[3] = {0, 0, 0}, at[3];
        float weights[3] = {1 - x - y, x, y};
        int i = (int)(frusta_random(k, 43) * (float)side), j = (int)(frusta_random(k, 44) * (float)rows);
        int flip = x + y > 1; /* the other triangle of the quad */
        if (flip) {
            weights[0] = x + y - 1;
            weights[1] = 1 - x;
            weights[2] = 1 - y;
        }
        for (int n = 0; n < 3; ++n) {
            float uvw[3] = {(float)(i + (flip ? n != 1 : n == 1)) / (float)side,
                            (float)(j + (flip ? n != 2 : n == 2)) / (float)rows, 0};
            float corner[3];
            uvw[2] = frusta_height(map, f, uvw[0], uvw[1]);
            conemap_frustum_point(f, uvw, corner);
            for (int c = 0; c < 3; ++c) place[c] += weights[n] * corner[c];
        }
        conemap_frustum_uvw(f, place, at);
        wrong += fabsf(at[2] - frusta_height(map, f, at[0], at[1])) * (f->t + 0.5f * f->tk * f->h) > 0.003f;
    }
    return 100.0 * wrong / POINTS;
}

static int bench_relief(const char *map_name, const struct image *image) {
    static const struct {
        const char *name;
        conemap_march march;
        int steps, linear, relief;
    } ways[] = {{"plain", CONEMAP_MARCH_STEPS, 0, 0, 0},       {"steps16", CONEMAP_MARCH_STEPS, 16, 0, 1},
                {"steps32", CONEMAP_MARCH_STEPS, 32, 0, 1},    {"steps64", CONEMAP_MARCH_STEPS, 64, 0, 1},
                {"linear64", CONEMAP_MARCH_STEPS, 64, 1, 1},   {"steps256", CONEMAP_MARCH_STEPS, 256, 0, 1},
                {"linear256", CONEMAP_MARCH_STEPS, 256, 1, 1}, {"cones32", CONEMAP_MARCH_CONES, 32, 0, 1},
                {"cones64", CONEMAP_MARCH_CONES, 64, 0, 1},    {"cones256", CONEMAP_MARCH_CONES, 256, 0, 1},
                {"cones1024", CONEMAP_MARCH_CONES, 1024, 0, 1}};
    enum { WAYS = sizeof ways / sizeof ways[0], COUNT = 1000, RAYS = 8192, AGAINST = 3 };
    static conemap_joint joints[COUNT + COUNT / 10 + 2];
    static conemap_segment segments[COUNT];
    static conemap_ray rays[RAYS];
    static conemap_skeleton_hit hits[RAYS], right[RAYS];
    double times[WAYS][ROUNDS], wrong[WAYS], steps[WAYS];
    conemap_skeleton skeleton;
    conemap_skeleton_desc desc;
    conemap_skeleton_trace_desc trace;
    conemap_desc build;
    conemap_map map;
    describe(&build, image);
    build.wrap_u = build.wrap_v = CONEMAP_WRAP;
    build.max_tan = 16;
    conemap_result result = conemap_build(&build, &map);
    if (result != CONEMAP_OK) return fail_result("build", result);
    memset(&desc, 0, sizeof desc);
    desc.joints = joints;
    desc.segments = segments;
    desc.segment_count = frusta_plant(COUNT, 0.5f, joints, segments, &desc.joint_count);
    desc.v_per_length = 0.4f;
    result = conemap_skeleton_build(&desc, &skeleton);
    if (result != CONEMAP_OK) return fail_result("skeleton", result);
    frusta_rays(joints, desc.joint_count, rays, RAYS);
    memset(&trace, 0, sizeof trace);
    trace.map = &map;
    trace.steps = 4096;
    trace.refine_steps = 20;
    conemap_skeleton_trace(&skeleton, &trace, rays, right, RAYS);
    for (int r = 0; r < ROUNDS; ++r)
        for (int k = 0; k < WAYS; ++k) {
            memset(&trace, 0, sizeof trace);
            trace.map = ways[k].relief ? &map : NULL;
            trace.march = ways[k].march;
            trace.steps = ways[k].steps;
            trace.linear_v = ways[k].linear;
            double start = now();
            conemap_skeleton_trace(&skeleton, &trace, rays, hits, RAYS);
            times[k][r] = now() - start;
            if (r == 0) {
                wrong[k] = frusta_wrong(hits, right, RAYS);
                steps[k] = 0;
                for (int n = 0; n < RAYS; ++n) steps[k] += (double)hits[n].steps / RAYS;
            }
            part_done();
        }
    for (int k = 0; k < WAYS; ++k) {
        char name[64];
        snprintf(name, sizeof name, "frusta.%s", ways[k].name);
        figure(name, map_name, (double)RAYS / median(times[k]) * 1e-6, "Mrays/s");
        if (!ways[k].relief) continue;
        snprintf(name, sizeof name, "frusta.%s.wrong", ways[k].name);
        figure(name, map_name, wrong[k], "% of the hits");
        snprintf(name, sizeof name, "frusta.%s.steps", ways[k].name);
        figure(name, map_name, steps[k], "a ray");
        snprintf(name, sizeof name, "frusta.%s/steps64", ways[k].name);
        if (k != AGAINST)
            figure(name, map_name, median_ratio(times[k], times[AGAINST]), "ratio (below 1: faster)");
    }
    int side = 4; /* how fine a mesh must be to be no more often wrong than the steps that others are compared with */
    float along = desc.v_per_length; /* of the map for each segment: their length is 1 */
    while (side < 4096 && frusta_mesh_wrong(&skeleton, &map, side, (int)((float)side * along) + 1) > wrong[AGAINST])
        side *= 2;
    figure("frusta.triangles", map_name, 2.0 * side * (int)((float)side * along + 1), "a segment, as right as steps64");
    conemap_skeleton_free(&skeleton);
    conemap_free(&map);
    return 1;
}

#endif
