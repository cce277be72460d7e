/* Bad input of every kind: the documented result, nothing written, nothing kept. */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

static const float plain[12] = {0.0f, 0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f, 0.8f, 0.9f, 1.0f, 0.5f};

static conemap_desc plain_desc(void)
{
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = plain;
    desc.heights.width = 4;
    desc.heights.height = 3;
    return desc;
}

static int live_blocks;

static void *count_allocate(size_t size, void *user)
{
    (void)user;
    ++live_blocks;
    return malloc(size);
}

static void count_release(void *memory, void *user)
{
    (void)user;
    if (memory) --live_blocks;
    free(memory);
}

/* Every way to build refuses the desc with the same result. */
static void refuse(int line, const conemap_desc *given, conemap_result right, int in_plan)
{
    conemap_desc desc = *given;
    conemap_map map;
    conemap_result result;
    size_t memory = 12345, scratch = 54321;
    const unsigned char *bytes = (const unsigned char *)&map;
    size_t k;
    int dirty = 0;
    if (!desc.allocator.allocate && !desc.allocator.release) {
        desc.allocator.allocate = count_allocate;
        desc.allocator.release = count_release;
    }
    live_blocks = 0;
    memset(&map, 0xdb, sizeof map);
    result = conemap_build(&desc, &map);
    CHECK(result == right, "line %d: build: %s", line, conemap_result_string(result));
    for (k = 0; k < sizeof map; ++k) dirty += bytes[k] != 0;
    CHECK(result == CONEMAP_OK || !dirty, "line %d: the map is not zeroed", line);
    if (result == CONEMAP_OK) conemap_free(&map);
    CHECK(live_blocks == 0, "line %d: %d blocks stay", line, live_blocks);
    if (!in_plan) return;
    memset(&map, 0xdb, sizeof map);
    result = conemap_begin(&desc, &map);
    CHECK(result == right, "line %d: begin: %s", line, conemap_result_string(result));
    if (result == CONEMAP_OK) conemap_free(&map);
    CHECK(live_blocks == 0, "line %d: %d blocks stay after begin", line, live_blocks);
    result = conemap_memory(&desc, &memory, &scratch);
    CHECK(result == right, "line %d: memory: %s", line, conemap_result_string(result));
}

#define REFUSE(assignment, result)                                                                           \
    do {                                                                                                     \
        conemap_desc desc = plain_desc();                                                                    \
        assignment;                                                                                          \
        refuse(__LINE__, &desc, result, 1);                                                                  \
    } while (0)

static void descs(void)
{
    const float nan = nanf(""), inf = HUGE_VALF;
    conemap_desc good = plain_desc();
    conemap_map map;
    size_t size;

    CHECK(conemap_build(NULL, &map) == CONEMAP_ERROR_NULL, "no desc");
    CHECK(conemap_build(&good, NULL) == CONEMAP_ERROR_NULL, "no map");
    CHECK(conemap_begin(NULL, &map) == CONEMAP_ERROR_NULL && conemap_begin(&good, NULL) == CONEMAP_ERROR_NULL,
          "begin with nothing");
    CHECK(conemap_memory(NULL, &size, &size) == CONEMAP_ERROR_NULL, "memory of nothing");

    REFUSE(desc.heights.pixels = NULL, CONEMAP_ERROR_NULL);
    REFUSE(desc.heights.width = 0, CONEMAP_ERROR_SIZE);
    REFUSE(desc.heights.height = 0, CONEMAP_ERROR_SIZE);
    REFUSE(desc.heights.width = -1, CONEMAP_ERROR_SIZE);
    REFUSE(desc.heights.height = -1, CONEMAP_ERROR_SIZE);
    REFUSE(desc.heights.width = INT_MIN, CONEMAP_ERROR_SIZE);
    REFUSE(desc.heights.height = INT_MAX, CONEMAP_ERROR_SIZE);
    REFUSE(desc.heights.width = CONEMAP_MAX_SIZE + 1, CONEMAP_ERROR_SIZE);
    REFUSE(desc.heights.height = CONEMAP_MAX_SIZE + 1, CONEMAP_ERROR_SIZE);

    REFUSE(desc.heights.pixel_stride = 3, CONEMAP_ERROR_STRIDE);
    REFUSE(desc.heights.pixel_stride = -4, CONEMAP_ERROR_STRIDE);
    REFUSE(desc.heights.row_stride = 12, CONEMAP_ERROR_STRIDE);
    REFUSE(desc.heights.row_stride = 1, CONEMAP_ERROR_STRIDE);
    REFUSE(desc.heights.row_stride = -12, CONEMAP_ERROR_STRIDE);
    REFUSE(desc.heights.row_stride = PTRDIFF_MIN;
           desc.heights.pixel_stride = PTRDIFF_MAX, CONEMAP_ERROR_OVERFLOW);
    REFUSE(desc.heights.pixel_stride = PTRDIFF_MAX / 2, CONEMAP_ERROR_OVERFLOW);

    REFUSE(desc.heights.format = (conemap_format)CONEMAP_FORMAT_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(desc.heights.format = (conemap_format)77, CONEMAP_ERROR_ENUM);
    REFUSE(desc.wrap_u = (conemap_wrap)CONEMAP_WRAP_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(desc.wrap_v = (conemap_wrap)99, CONEMAP_ERROR_ENUM);
    REFUSE(desc.texture.format = (conemap_format)CONEMAP_FORMAT_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(desc.texture.encoding = (conemap_encoding)CONEMAP_ENCODING_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(desc.texture.layout = (conemap_layout)CONEMAP_LAYOUT_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(desc.generator = (conemap_generator)CONEMAP_GENERATOR_COUNT, CONEMAP_ERROR_ENUM);
    {
        const unsigned wild = 0xfffffff0u; /* whatever the enum's own type, its bits can be anything */
        REFUSE(memcpy(&desc.generator, &wild, sizeof wild), CONEMAP_ERROR_ENUM);
        REFUSE(memcpy(&desc.wrap_u, &wild, sizeof wild), CONEMAP_ERROR_ENUM);
        REFUSE(memcpy(&desc.heights.format, &wild, sizeof wild), CONEMAP_ERROR_ENUM);
        REFUSE(memcpy(&desc.texture.encoding, &wild, sizeof wild), CONEMAP_ERROR_ENUM);
    }

    REFUSE(desc.aspect = nan, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.aspect = inf, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.aspect = -1.0f, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.aspect = 32769.0f, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.aspect = 1e-6f, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.aspect = 32768.0f, CONEMAP_OK);
    REFUSE(desc.aspect = 1.0f / 32768.0f, CONEMAP_OK);
    REFUSE(desc.max_tan = nan, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.max_tan = inf, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.max_tan = -1.0f, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.max_tan = 65505.0f, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.max_tan = CONEMAP_TAN_LIMIT, CONEMAP_OK);
    REFUSE(desc.max_tan = 1e-3f, CONEMAP_OK);
    REFUSE(desc.hybrid_weight = nan; desc.generator = CONEMAP_HYBRID, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.hybrid_weight = -0.1f; desc.generator = CONEMAP_HYBRID, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.hybrid_weight = 1.1f; desc.generator = CONEMAP_HYBRID, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.hybrid_weight = 1.0f; desc.generator = CONEMAP_HYBRID, CONEMAP_OK);
    REFUSE(desc.texture.per_cell = 1, CONEMAP_OK);
    REFUSE(desc.texture.per_cell = 1; desc.guarantee = CONEMAP_GUARANTEE_VERTEX, CONEMAP_ERROR_UNSUPPORTED);
    REFUSE(desc.texture.per_cell = 1; desc.generator = CONEMAP_QUICK, CONEMAP_ERROR_UNSUPPORTED);
    REFUSE(desc.texture.per_cell = 1; desc.texture.encoding = CONEMAP_RADIUS, CONEMAP_ERROR_UNSUPPORTED);
    REFUSE(desc.slack = nan, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.slack = -0.1f, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.slack = 17.0f, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.slack = 16.0f, CONEMAP_OK);
    REFUSE(desc.guarantee = (conemap_guarantee)CONEMAP_GUARANTEE_COUNT, CONEMAP_ERROR_ENUM);
    REFUSE(desc.guarantee = (conemap_guarantee)-1, CONEMAP_ERROR_ENUM);
    REFUSE(desc.guarantee = CONEMAP_GUARANTEE_NONE, CONEMAP_ERROR_UNSUPPORTED);
    REFUSE(desc.guarantee = CONEMAP_GUARANTEE_RELAXED, CONEMAP_ERROR_UNSUPPORTED);
    REFUSE(desc.guarantee = CONEMAP_GUARANTEE_BILINEAR; desc.generator = CONEMAP_RING, CONEMAP_ERROR_UNSUPPORTED);
    REFUSE(desc.guarantee = CONEMAP_GUARANTEE_VERTEX; desc.generator = CONEMAP_RELAXED, CONEMAP_ERROR_UNSUPPORTED);
    REFUSE(desc.guarantee = CONEMAP_GUARANTEE_VERTEX; desc.generator = CONEMAP_QUICK, CONEMAP_OK);
    REFUSE(desc.march_steps = -1; desc.generator = CONEMAP_RELAXED_SAMPLED, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.march_steps = 65537; desc.generator = CONEMAP_RELAXED_SAMPLED, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.march_steps = 1; desc.generator = CONEMAP_RELAXED_SAMPLED, CONEMAP_OK);
    REFUSE(desc.ring_limit = -1; desc.generator = CONEMAP_RING, CONEMAP_ERROR_PARAMETER);
    REFUSE(desc.ring_limit = INT_MAX; desc.generator = CONEMAP_RING, CONEMAP_OK);

    REFUSE(desc.allocator.allocate = count_allocate, CONEMAP_ERROR_NULL);
    REFUSE(desc.allocator.release = count_release, CONEMAP_ERROR_NULL);
}

/* The widest and flattest maps, and what does not fit in memory, without touching it. */
static void extreme_sizes(void)
{
    static float row[CONEMAP_MAX_SIZE];
    conemap_desc desc = plain_desc();
    conemap_map map;
    size_t memory = 0, scratch = 0;
    int k, tall;
    for (k = 0; k < CONEMAP_MAX_SIZE; ++k) row[k] = (float)(k % 1000) / 1000.0f;
    desc.heights.pixels = row;
    for (tall = 0; tall < 2; ++tall) {
        desc.heights.width = tall ? 1 : CONEMAP_MAX_SIZE;
        desc.heights.height = tall ? CONEMAP_MAX_SIZE : 1;
        desc.keep_pyramid = 1;
        desc.wrap_u = CONEMAP_NOTHING;
        if (CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "%d x %d", desc.heights.width,
                  desc.heights.height)) {
            conemap_sample sample;
            conemap_ray ray = {{0.5f, 0.5f, 2.0f}, {0.0f, 0.0f, -1.0f}, 0.0f, 0.0f};
            conemap_trace_desc trace;
            conemap_hit hit;
            memset(&trace, 0, sizeof trace);
            trace.tracer = CONEMAP_TRACE_MAXMIP;
            CHECK(conemap_sample_at(&map, 0.5f, 0.5f, &sample) == CONEMAP_OK, "a sample");
            CHECK(conemap_trace(&map, &trace, &ray, &hit, 1) == CONEMAP_OK && hit.status == CONEMAP_HIT,
                  "a ray");
            conemap_free(&map);
        }
    }
    desc.heights.width = desc.heights.height = CONEMAP_MAX_SIZE;
    if (sizeof(size_t) > 4) {
        CHECK(conemap_memory(&desc, &memory, &scratch) == CONEMAP_OK &&
                  memory > (size_t)CONEMAP_MAX_SIZE * 32768 * 8,
              "the largest map");
    } else {
        CHECK(conemap_memory(&desc, &memory, &scratch) == CONEMAP_ERROR_OVERFLOW, "the largest map");
    }
}

static void bad_heights(void)
{
    static const float bad[] = {-1e-7f, 1.0000002f, -1.0f, 1e30f};
    static const uint16_t bad_halves[] = {0x8001, 0xbc00, 0x3c01, 0x7c00, 0xfc00, 0x7e00, 0xfe01};
    const float nan = nanf(""), inf = HUGE_VALF;
    int spot, k, depth;
    for (depth = 0; depth < 2; ++depth) {
        for (spot = 0; spot < 12; spot += 11) {
            for (k = 0; k < 7; ++k) {
                conemap_desc desc = plain_desc();
                float heights[12];
                memcpy(heights, plain, sizeof plain);
                heights[spot] = k < 4 ? bad[k] : k == 4 ? nan : k == 5 ? inf : -inf;
                desc.heights.pixels = heights;
                desc.heights.is_depth = depth;
                refuse(__LINE__, &desc, CONEMAP_ERROR_HEIGHT, 0);
                desc.texture.format = CONEMAP_UNORM8;
                refuse(__LINE__, &desc, CONEMAP_ERROR_HEIGHT, 0);
            }
            for (k = 0; k < 7; ++k) {
                conemap_desc desc = plain_desc();
                uint16_t halves[12];
                memset(halves, 0, sizeof halves);
                halves[spot] = bad_halves[k];
                desc.heights.pixels = halves;
                desc.heights.format = CONEMAP_F16;
                desc.heights.is_depth = depth;
                refuse(__LINE__, &desc, CONEMAP_ERROR_HEIGHT, 0);
            }
        }
    }
}

/* Minus zero is zero, subnormal heights are heights. */
static void odd_heights(void)
{
    float heights[4] = {-0.0f, 1e-40f, 1e-30f, 1.0f};
    conemap_desc desc = plain_desc();
    conemap_map map;
    int k;
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = 2;
    desc.max_tan = CONEMAP_TAN_LIMIT;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    for (k = 0; k < 4; ++k) {
        CHECK(map.cones[k] > 0.0f && map.cones[k] <= CONEMAP_TAN_LIMIT && map.heights[k] >= 0.0f,
              "cone %d is %g", k, (double)map.cones[k]);
    }
    conemap_free(&map);
}

static int build_plain(conemap_map *map, int wrap, int keep_pyramid)
{
    conemap_desc desc = plain_desc();
    desc.wrap_u = desc.wrap_v = (conemap_wrap)wrap;
    desc.keep_pyramid = keep_pyramid;
    return CHECK(conemap_build(&desc, map) == CONEMAP_OK, "build");
}

static void bad_rays(void)
{
    const float nan = nanf(""), inf = HUGE_VALF;
    conemap_map map;
    int tracer, k, c;
    if (!build_plain(&map, 0, 1)) return;
    for (tracer = 0; tracer < CONEMAP_TRACER_COUNT; ++tracer) {
        conemap_trace_desc desc;
        memset(&desc, 0, sizeof desc);
        desc.tracer = (conemap_tracer)tracer;
        for (k = 0; k < 17; ++k) {
            const conemap_ray good = {{0.5f, 0.5f, 1.5f}, {0.1f, 0.2f, -1.0f}, 0.0f, 0.0f};
            conemap_ray rays[3];
            conemap_hit *hits = (conemap_hit *)test_alloc(3 * sizeof *hits);
            conemap_result right = CONEMAP_OK, result;
            rays[0] = rays[1] = rays[2] = good;
            c = k % 3;
            if (k < 3) rays[1].origin[c] = nan, right = CONEMAP_ERROR_RAY_ORIGIN;
            else if (k < 6) rays[1].origin[c] = c & 1 ? inf : -inf, right = CONEMAP_ERROR_RAY_ORIGIN;
            else if (k < 9) rays[1].direction[c] = nan, right = CONEMAP_ERROR_RAY_DIRECTION;
            else if (k < 12) rays[1].direction[c] = c & 1 ? inf : -inf, right = CONEMAP_ERROR_RAY_DIRECTION;
            else if (k == 12)
                memset(rays[1].direction, 0, sizeof rays[1].direction), right = CONEMAP_ERROR_RAY_DIRECTION;
            else if (k == 13) rays[1].t_min = -1e-6f, right = CONEMAP_ERROR_RAY_RANGE;
            else if (k == 14) rays[1].t_min = 0.5f, rays[1].t_max = 0.25f, right = CONEMAP_ERROR_RAY_RANGE;
            else if (k == 15) rays[1].t_min = nan, right = CONEMAP_ERROR_RAY_RANGE;
            else rays[1].t_max = nan, right = CONEMAP_ERROR_RAY_RANGE;
            result = conemap_trace(&map, &desc, rays, hits, 3);
            CHECK(result == right, "tracer %d, case %d: %s", tracer, k, conemap_result_string(result));
            CHECK(hits[1].status == CONEMAP_INVALID, "tracer %d, case %d: status %d", tracer, k,
                  (int)hits[1].status);
            CHECK(hits[0].status != CONEMAP_INVALID && hits[0].status == hits[2].status &&
                      hits[0].t == hits[2].t,
                  "tracer %d, case %d: the rays beside it", tracer, k);
            test_release(hits);
        }
    }
    conemap_free(&map);
}

static void bad_traces(void)
{
    const float nan = nanf("");
    const conemap_ray ray = {{0.5f, 0.5f, 1.5f}, {0.1f, 0.2f, -1.0f}, 0.0f, 0.0f};
    conemap_map map, empty;
    conemap_trace_desc desc;
    conemap_hit hit, untouched;
    int k;
    if (!build_plain(&map, 0, 0)) return;
    memset(&empty, 0, sizeof empty);
    memset(&untouched, 0x42, sizeof untouched);
    hit = untouched;
    CHECK(conemap_trace(NULL, NULL, &ray, &hit, 1) == CONEMAP_ERROR_NULL, "no map");
    CHECK(conemap_trace(&empty, NULL, &ray, &hit, 1) == CONEMAP_ERROR_NULL, "an empty map");
    CHECK(conemap_trace(&map, NULL, NULL, &hit, 1) == CONEMAP_ERROR_NULL, "no rays");
    CHECK(conemap_trace(&map, NULL, &ray, NULL, 1) == CONEMAP_ERROR_NULL, "no hits");
    CHECK(conemap_trace(&map, NULL, &ray, &hit, -1) == CONEMAP_ERROR_PARAMETER, "a negative count");
    for (k = 0; k < 12; ++k) {
        conemap_result right = CONEMAP_ERROR_PARAMETER, result;
        memset(&desc, 0, sizeof desc);
        if (k == 0) desc.tracer = (conemap_tracer)CONEMAP_TRACER_COUNT, right = CONEMAP_ERROR_ENUM;
        if (k == 1)
            desc.refinement = (conemap_refinement)CONEMAP_REFINEMENT_COUNT, right = CONEMAP_ERROR_ENUM;
        if (k == 2) desc.tracer = CONEMAP_TRACE_MAXMIP, right = CONEMAP_ERROR_NO_PYRAMID;
        if (k == 3) desc.tracer = CONEMAP_TRACE_QDM, right = CONEMAP_ERROR_NO_PYRAMID;
        if (k == 4) desc.refine_steps = -1;
        if (k == 5) desc.refine_steps = 65;
        if (k == 6) desc.max_steps = -1;
        if (k == 7) desc.step_scale = nan;
        if (k == 8) desc.step_scale = -1.0f;
        if (k == 9) desc.tolerance = nan;
        if (k == 10) desc.tolerance = -1.0f;
        if (k == 11) desc.step_scale = HUGE_VALF;
        hit = untouched;
        result = conemap_trace(&map, &desc, &ray, &hit, 1);
        CHECK(result == right, "case %d: %s", k, conemap_result_string(result));
        CHECK(!memcmp(&hit, &untouched, sizeof hit), "case %d: written all the same", k);
    }
    conemap_free(&map);
}

static void bad_textures(void)
{
    conemap_map map, empty;
    conemap_texture texture;
    conemap_format_numbers numbers;
    conemap_info info;
    unsigned char bytes[1024];
    memset(&empty, 0, sizeof empty);
    if (!build_plain(&map, 0, 0)) return;
    CHECK(conemap_row_size(NULL) == 0 && conemap_row_size(&empty) == 0, "a row of nothing");
    CHECK(conemap_texture_size(NULL, 0) == 0 && conemap_texture_size(&empty, 64) == 0,
          "a texture of nothing");
    CHECK(conemap_texture_size(&map, SIZE_MAX / 2) == 0, "a texture beyond size_t");
    CHECK(conemap_write_texture(NULL, bytes, sizeof bytes, 0) == CONEMAP_ERROR_NULL, "no map");
    CHECK(conemap_write_texture(&empty, bytes, sizeof bytes, 0) == CONEMAP_ERROR_NULL, "an empty map");
    CHECK(conemap_write_texture(&map, NULL, sizeof bytes, 0) == CONEMAP_ERROR_NULL, "no pixels");
    CHECK(conemap_write_texture(&map, bytes, sizeof bytes, SIZE_MAX) != CONEMAP_OK, "an endless pitch");
    memset(bytes, 0x21, sizeof bytes);
    CHECK(conemap_write_texture(&map, bytes, 4 * 3 * 8 - 1, 0) == CONEMAP_ERROR_BUFFER && bytes[0] == 0x21,
          "too small, yet written");
    CHECK(conemap_save_size(NULL) == 0 && conemap_save_size(&empty) == 0, "nothing to save");
    CHECK(conemap_save(NULL, bytes, sizeof bytes) == CONEMAP_ERROR_NULL, "save without a map");
    CHECK(conemap_save(&empty, bytes, sizeof bytes) == CONEMAP_ERROR_NULL, "save an empty map");
    CHECK(conemap_save(&map, NULL, sizeof bytes) == CONEMAP_ERROR_NULL, "save to nowhere");
    CHECK(conemap_save(&map, bytes, 10) == CONEMAP_ERROR_BUFFER && bytes[0] == 0x21, "saved into too little");
    conemap_free(&map);

    CHECK(conemap_load_info(NULL, 100, &info) == CONEMAP_ERROR_NULL, "info of nothing");
    CHECK(conemap_load_info(bytes, 100, NULL) == CONEMAP_ERROR_NULL, "info to nowhere");
    CHECK(conemap_load_info(bytes, sizeof bytes, &info) == CONEMAP_ERROR_FILE_FORMAT, "info of rubbish");
    CHECK(conemap_load(NULL, 100, NULL, &map) == CONEMAP_ERROR_NULL, "load nothing");
    CHECK(conemap_load(bytes, 100, NULL, NULL) == CONEMAP_ERROR_NULL, "load to nowhere");
    CHECK(conemap_load(bytes, sizeof bytes, NULL, &map) == CONEMAP_ERROR_FILE_FORMAT && !map.heights,
          "load rubbish");

    memset(&texture, 0, sizeof texture);
    CHECK(conemap_get_format_numbers(NULL, &numbers) == CONEMAP_ERROR_NULL, "numbers of nothing");
    CHECK(conemap_get_format_numbers(&texture, NULL) == CONEMAP_ERROR_NULL, "numbers to nowhere");
    texture.layout = (conemap_layout)CONEMAP_LAYOUT_COUNT;
    CHECK(conemap_get_format_numbers(&texture, &numbers) == CONEMAP_ERROR_ENUM, "numbers of no layout");
    texture.layout = CONEMAP_CONE_ONLY;
    texture.format = (conemap_format)CONEMAP_FORMAT_COUNT;
    CHECK(conemap_get_format_numbers(&texture, &numbers) == CONEMAP_ERROR_ENUM, "numbers of no format");
}

static void result_strings(void)
{
    int k, j;
    for (k = 0; k < CONEMAP_RESULT_COUNT; ++k) {
        const char *text = conemap_result_string((conemap_result)k);
        if (!CHECK(text && strlen(text) > 5, "result %d has no text", k)) continue;
        for (j = 0; j < k; ++j) {
            CHECK(strcmp(text, conemap_result_string((conemap_result)j)) != 0,
                  "results %d and %d read the same", j, k);
        }
    }
    CHECK(!strcmp(conemap_result_string(CONEMAP_OK), "no error"), "the text of OK");
    CHECK(!strcmp(conemap_result_string(CONEMAP_ERROR_HASH),
                  "the heights are not those that the baked cones were built from"),
          "the text of the last one");
    CHECK(conemap_result_string(CONEMAP_RESULT_COUNT) &&
              strlen(conemap_result_string(CONEMAP_RESULT_COUNT)) > 0,
          "beyond the end");
    for (k = -5; k < 100; k += 35) {
        conemap_result wild;
        memcpy(&wild, &k, sizeof wild);
        CHECK(conemap_result_string(wild) != NULL, "result %d", k);
    }
}

const struct test_case inputs_tests[] = {
    {"descs", descs},
    {"extreme sizes", extreme_sizes},
    {"bad heights", bad_heights},
    {"odd heights", odd_heights},
    {"bad rays", bad_rays},
    {"bad trace settings", bad_traces},
    {"bad buffers and bytes", bad_textures},
    {"result strings", result_strings},
    {NULL, NULL},
};
