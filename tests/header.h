/* What header_c.c, header_cc.cc, static_a.c and static_b.c all do with the library: use every function once,
   so that private copies leave none unused, and return a cone. Include conemap.h first. */
#ifndef HEADER_H
#define HEADER_H

#include <string.h>

static int header_progress(double done, void *user)
{
    (void)user;
    return done > 2.0;
}

static int header_skeleton(void)
{
    conemap_joint joints[2] = {{{0, 0, 0}, 1, 0}, {{0, 2, 0}, 1, 0}};
    conemap_segment segment;
    conemap_skeleton_desc desc;
    conemap_skeleton skeleton;
    conemap_ray ray = {{0, 1, 5}, {0, 0, -1}, 0, 0};
    conemap_skeleton_hit hit;
    float corners[8][3], span[2], uvw[3] = {0, 0, 0}, point[3] = {0, 1, 1};
    size_t size;
    int wrong = 0;

    memset(&segment, 0, sizeof segment);
    memset(&desc, 0, sizeof desc);
    segment.top = 1;
    segment.parent = -1;
    desc.joints = joints;
    desc.joint_count = 2;
    desc.segments = &segment;
    desc.segment_count = 1;
    wrong |= conemap_skeleton_memory(&desc, &size) != CONEMAP_OK;
    wrong |= conemap_skeleton_build(&desc, &skeleton) != CONEMAP_OK;
    if (wrong) return 0;
    wrong |= conemap_skeleton_update(&skeleton, joints) != CONEMAP_OK;
    wrong |= conemap_frustum_corners(skeleton.frusta, corners) != CONEMAP_OK || conemap_frustum_triangles()[35] != 0;
    wrong |= conemap_frustum_uvw(skeleton.frusta, point, uvw) != CONEMAP_OK;
    wrong |= conemap_frustum_point(skeleton.frusta, uvw, point) != CONEMAP_OK;
    wrong |= conemap_frustum_span(skeleton.frusta, 0.0f, &ray, span) != CONEMAP_OK || span[0] != 4.0f;
    wrong |= conemap_skeleton_trace(&skeleton, NULL, &ray, &hit, 1) != CONEMAP_OK || hit.t != 4.0f;
    wrong |= conemap_skeleton_shade(&skeleton, NULL, NULL, 0.0f, &ray, &hit, NULL, 1) != CONEMAP_OK || hit.t != 4.0f;
    conemap_skeleton_free(&skeleton);
    return !wrong;
}

static int header_prepared(const conemap_map *map)
{
    conemap_prepared prepared;
    conemap_ray ray = {{0.5f, 0.5f, 1.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
    conemap_hit hit;
    conemap_ray_arrays rays;
    conemap_hit_arrays hits;
    float t = 0.0f;
    int k, wrong = 0;
    memset(&rays, 0, sizeof rays);
    memset(&hits, 0, sizeof hits);
    for (k = 0; k < 3; ++k) {
        rays.origin[k] = &ray.origin[k];
        rays.direction[k] = &ray.direction[k];
    }
    hits.t = &t;
    if (conemap_prepare(map, NULL, &prepared) != CONEMAP_OK) return 0;
    wrong |= conemap_prepare_memory(map) != prepared.memory_size;
    wrong |= conemap_trace_prepared(&prepared, &ray, &hit, 1) != CONEMAP_OK || hit.status != CONEMAP_HIT;
    wrong |= conemap_trace_arrays(&prepared, &rays, &hits, 1) != CONEMAP_OK || t != hit.t;
    conemap_free_prepared(&prepared);
    return !wrong;
}

static int header_shaders(const conemap_info *info)
{
    conemap_shader_desc desc;
    conemap_frusta_shader_desc frusta;
    size_t size = 0;
    int count = 0, wrong = 0;
    memset(&desc, 0, sizeof desc);
    memset(&frusta, 0, sizeof frusta);
    desc.map = *info;
    wrong |= conemap_emit(&desc, NULL, 0, &size) != CONEMAP_OK || size == 0;
    wrong |= conemap_emit_kernel(&desc, CONEMAP_KERNEL_RING, NULL, 0, &size) != CONEMAP_OK || size == 0;
    wrong |= conemap_emit_frusta(&frusta, NULL, 0, &size) != CONEMAP_OK || size == 0;
    wrong |= conemap_gpu_passes(&desc, 0, NULL, 0, &count) != CONEMAP_OK || count < 1;
    return !wrong;
}

static int header_effects(const conemap_desc *desc, const conemap_map *map)
{
    static const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    conemap_map levels[2];
    conemap_frame frame;
    conemap_effects effects;
    conemap_ray ray = {{0.5f, 0.5f, 2.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f}, below = ray, box;
    conemap_hit hit;
    conemap_shading shading;
    conemap_gradient gradient;
    conemap_lod lod;
    float point[3] = {0.5f, 0.5f, 0.5f}, slope[2], normal[3], depth, sky[4];
    int wrong = 0;
    memset(&frame, 0, sizeof frame);
    memset(&effects, 0, sizeof effects);
    memset(&gradient, 0, sizeof gradient);
    wrong |= conemap_frame_ray(&frame, &ray, &box) != CONEMAP_OK;
    wrong |= conemap_frame_point(&frame, point, point) != CONEMAP_OK;
    wrong |= conemap_smooth_slope(map, 0.5f, 0.5f, slope) != CONEMAP_OK;
    wrong |= conemap_frame_normal(&frame, 0.5f, 0.5f, slope, normal) != CONEMAP_OK;
    below.origin[1] += 0.1f;
    box = ray;
    box.origin[0] += 0.1f;
    wrong |= conemap_gradient_at(&frame, &ray, &box, &below, &gradient) != CONEMAP_OK;
    wrong |= conemap_depth(matrix, point, CONEMAP_DEPTH_ZERO_TO_ONE, &depth) != CONEMAP_OK;
    wrong |= conemap_level_count(2, 2) != 2;
    wrong |= conemap_build_levels(desc, levels, 2) != CONEMAP_OK;
    if (wrong) return 0;
    effects.flags = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_LOD;
    effects.levels = levels;
    effects.level_count = 2;
    effects.gradients = &gradient;
    wrong |= conemap_lod_at(map, &effects, &gradient, &lod) != CONEMAP_OK;
    wrong |= conemap_shade(map, NULL, &effects, &ray, &hit, &shading, 1) != CONEMAP_OK || hit.status != CONEMAP_HIT;
    wrong |= conemap_bake_sky(map, NULL, 8, 0, 0, sky) != CONEMAP_OK || !(sky[3] > 0.0f);
    conemap_free(&levels[0]);
    conemap_free(&levels[1]);
    return !wrong;
}

static float header_cone(const float heights[4])
{
    conemap_desc desc;
    conemap_map map, loaded;
    conemap_info info;
    conemap_ray ray = {{0.5f, 0.5f, 1.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
    conemap_hit hit;
    conemap_sample sample;
    conemap_format_numbers numbers;
    conemap_plan_desc planning;
    conemap_planned plan;
    conemap_report report;
    unsigned char bytes[512];
    float maxima[16];
    size_t memory, scratch;
    float cone;
    int pass, job, wrong = 0;

    memset(&planning, 0, sizeof planning);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = 2;
    desc.heights.height = 2;
    desc.keep_pyramid = 1;
    desc.progress = header_progress;
    wrong |= conemap_memory(&desc, &memory, &scratch) != CONEMAP_OK;
    wrong |= conemap_begin(&desc, &map) != CONEMAP_OK;
    for (pass = 0; pass < conemap_pass_count(&map); ++pass) {
        for (job = 0; job < conemap_job_count(&map, pass); ++job) {
            wrong |= conemap_run_job(&map, pass, job) != CONEMAP_OK;
        }
    }
    wrong |= conemap_end(&map) != CONEMAP_OK;
    conemap_free(&map);
    if (wrong || conemap_build(&desc, &map) != CONEMAP_OK) return -1.0f;
    cone = conemap_decode(&map.info, map.heights[0], map.cones[0]);
    wrong |= conemap_trace(&map, NULL, &ray, &hit, 1) != CONEMAP_OK || hit.status != CONEMAP_HIT;
    wrong |= conemap_sample_at(&map, 0.5f, 0.5f, &sample) != CONEMAP_OK;
    wrong |= conemap_texture_size(&map, 0) != 2 * conemap_row_size(&map);
    wrong |= conemap_write_texture(&map, bytes, sizeof bytes, 0) != CONEMAP_OK;
    wrong |= conemap_save(&map, bytes, sizeof bytes) != CONEMAP_OK;
    wrong |= conemap_load_info(bytes, conemap_save_size(&map), &info) != CONEMAP_OK;
    wrong |= conemap_load(bytes, conemap_save_size(&map), NULL, &loaded) != CONEMAP_OK;
    wrong |= conemap_get_format_numbers(&info.texture, &numbers) != CONEMAP_OK;
    wrong |= conemap_get_format_numbers_at(&info.texture, 0, &numbers) != CONEMAP_OK;
    wrong |= conemap_texture_count(&map) != 1 || conemap_row_size_at(&map, 0) != conemap_row_size(&map);
    wrong |= conemap_texture_size_at(&map, 0, 0) != conemap_texture_size(&map, 0);
    wrong |= conemap_write_texture_at(&map, 0, bytes, sizeof bytes, 0) != CONEMAP_OK;
    wrong |= conemap_maxima_levels(&map) < 1 || conemap_write_maxima(&map, 0, maxima, sizeof maxima) != CONEMAP_OK;
    wrong |= conemap_verify(&info, map.heights, map.cones, NULL, &report) != CONEMAP_OK || report.unsafe != 0;
    wrong |= conemap_sector(&info, 1.0f, 0.0f) != 0;
    wrong |= !conemap_isa_available(map.isa) || strlen(conemap_isa_name(map.isa)) == 0;
    wrong |= !header_prepared(&map) || !header_shaders(&info) || !header_effects(&desc, &map);
    planning.lowest_elevation = 10.0f;
    wrong |= conemap_get_statistics(&desc.heights, &planning.statistics) != CONEMAP_OK;
    wrong |= conemap_plan(&planning, &plan) != CONEMAP_OK;
    wrong |= strcmp(conemap_result_string(CONEMAP_OK), "no error") != 0;
    wrong |= !header_skeleton();
    wrong |= conemap_update(&map, &desc, 0, 0, 1, 1) != CONEMAP_OK;
    conemap_free(&loaded);
    conemap_free(&map);
    return wrong ? -1.0f : cone;
}

#endif
