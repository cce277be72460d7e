/* conemap_update: after edits anywhere, the same bits as a full build; on errors, the map as it was. */
#include <math.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

#define W 45
#define H 37

static float heights[W * H];

static conemap_desc make_desc(int k)
{
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = W;
    desc.heights.height = H;
    desc.wrap_u = (conemap_wrap)(k % 3);
    desc.wrap_v = (conemap_wrap)(k / 3 % 3);
    desc.aspect = k % 2 ? 1.0f : (float)H / (float)W;
    desc.max_tan = k % 5 ? 4.0f : 0.0f;
    desc.texture.format = (conemap_format)(k % CONEMAP_FORMAT_COUNT);
    desc.texture.encoding = (conemap_encoding)(k / 4 % CONEMAP_ENCODING_COUNT);
    desc.texture.layout = (conemap_layout)(k / 2 % CONEMAP_LAYOUT_COUNT);
    desc.guarantee = k % 4 == 3 ? CONEMAP_GUARANTEE_VERTEX : CONEMAP_GUARANTEE_BILINEAR;
    desc.keep_pyramid = k % 2;
    desc.keep_search = k / 2 % 3 > 0;
    return desc;
}

static int same_maps(const conemap_map *a, const conemap_map *b)
{
    int k;
    if (a->info.height_hash != b->info.height_hash || memcmp(a->heights, b->heights, sizeof heights) ||
        memcmp(a->cones, b->cones, sizeof heights) || a->cells.levels != b->cells.levels || a->highest < b->highest ||
        a->highest > b->highest)
        return 0;
    for (k = 1; k < a->cells.levels; ++k) {
        size_t quads = (size_t)((a->cells.width[k] + 1) / 2) * (size_t)((a->cells.height[k] + 1) / 2);
        if (memcmp(a->cells.level[k], b->cells.level[k], quads * 4 * sizeof(float))) return 0;
    }
    return 1;
}

/* One edit: raises, lowers, flattens or roughens a rectangle. */
static void edit(struct zoo_random *random, int *x, int *y, int *w, int *h)
{
    int how = zoo_below(random, 4), i, j;
    float level = zoo_unit(random);
    *w = 1 + zoo_below(random, zoo_below(random, 4) ? 6 : W);
    *h = 1 + zoo_below(random, zoo_below(random, 4) ? 6 : H);
    *x = zoo_below(random, W - *w + 1);
    *y = zoo_below(random, H - *h + 1);
    for (j = *y; j < *y + *h; ++j)
        for (i = *x; i < *x + *w; ++i) {
            float *at = &heights[j * W + i];
            *at = how == 0 ? *at + (1.0f - *at) * level : how == 1 ? *at * level : how == 2 ? level : zoo_unit(random);
        }
}

static void updates_equal_builds(void)
{
    static const int kinds[] = {ZOO_FBM, ZOO_SPIKES, ZOO_RAMP, ZOO_IMPULSE, ZOO_BRICKS, ZOO_WHITE, ZOO_FLAT_0};
    struct zoo_random random = zoo_seed(5);
    int k, n;
    for (k = 0; k < 108; ++k) {
        conemap_desc desc = make_desc(k), other;
        conemap_map map, whole;
        conemap_isa isa;
        if (k % 9 == 8) desc.min3x3 = desc.guarantee == CONEMAP_GUARANTEE_VERTEX; /* these start afresh */
        if (k % 11 == 10) desc.slack = 0.5f;
        desc.texture.per_cell = k % 3 == 1 && desc.guarantee == CONEMAP_GUARANTEE_BILINEAR &&
                                desc.texture.encoding != CONEMAP_RADIUS;
        zoo_fill(kinds[k % 7], W, H, (uint32_t)k, heights);
        isa = (conemap_isa)(k % CONEMAP_ISA_COUNT); /* the builds take the best one */
        desc.isa = conemap_isa_available(isa) ? isa : CONEMAP_ISA_DEFAULT;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build %d", k);
        for (n = 0; n < 4; ++n) {
            int x, y, w, h;
            edit(&random, &x, &y, &w, &h);
            if (!CHECK(conemap_update(&map, &desc, x, y, w, h) == CONEMAP_OK, "update %d", k)) break;
            other = desc;
            other.isa = CONEMAP_ISA_DEFAULT;
            REQUIRE(conemap_build(&other, &whole) == CONEMAP_OK, "build %d", k);
            CHECK(same_maps(&map, &whole), "map %d edit %d (%d, %d, %d x %d): not what a full build gives", k, n, x, y,
                  w, h);
            conemap_free(&whole);
        }
        conemap_free(&map);
    }
}

/* The same map by way of its baked bytes. */
static int reload(conemap_map *map)
{
    size_t size = conemap_save_size(map);
    void *bytes = test_alloc(size);
    conemap_desc desc;
    conemap_map loaded;
    int ok;
    memset(&desc, 0, sizeof desc);
    desc.keep_search = 1;
    ok = conemap_save(map, bytes, size) == CONEMAP_OK && conemap_load(bytes, size, &desc, &loaded) == CONEMAP_OK;
    test_release(bytes);
    if (!ok) return 0;
    conemap_free(map);
    *map = loaded;
    return 1;
}

/* What a map keeps for its updates must follow them: rough ground, whose cones nothing far away can narrow, is smoothed,
   and then hills are raised that reach it. */
static void kept_searches_follow(void)
{
    enum { SIDE_U = 150, SIDE_V = 110, LARGE = 60, SMALL = 16 };
    static float land[SIDE_U * SIDE_V];
    struct zoo_random random = zoo_seed(7);
    int k, n, i, j;
    for (k = 0; k < 4; ++k) {
        conemap_desc desc = make_desc(k);
        conemap_map map, whole;
        desc.heights.pixels = land;
        desc.heights.width = SIDE_U;
        desc.heights.height = SIDE_V;
        desc.texture.layout = CONEMAP_HEIGHT_CONE;
        desc.keep_search = 1;
        if (k > 1 && desc.texture.encoding != CONEMAP_RADIUS) desc.texture.sectors = k == 2 ? 4 : 8;
        for (i = 0; i < SIDE_U * SIDE_V; ++i) land[i] = 0.45f + 0.1f * zoo_unit(&random);
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build %d", k);
        for (n = 0; n < 10; ++n) {
            int size = n % 2 ? SMALL : LARGE;
            int x = zoo_below(&random, SIDE_U - size + 1), y = zoo_below(&random, SIDE_V - size + 1);
            if (n == 6) CHECK(reload(&map), "map %d: reloading", k);
            for (j = y; j < y + size; ++j)
                for (i = x; i < x + size; ++i) land[j * SIDE_U + i] = n % 2 ? 0.6f + 0.04f * (float)n : 0.45f;
            CHECK(conemap_update(&map, &desc, x, y, size, size) == CONEMAP_OK, "update %d", k);
            REQUIRE(conemap_build(&desc, &whole) == CONEMAP_OK, "build %d", k);
            CHECK(!memcmp(map.cones, whole.cones, sizeof land * (size_t)(desc.texture.sectors ? desc.texture.sectors : 1)) &&
                      map.info.height_hash == whole.info.height_hash,
                  "map %d edit %d: not what a full build gives", k, n);
            conemap_free(&whole);
        }
        conemap_free(&map);
    }
}

/* A block's cones are decided from texels around it too: here only the texels beside a high block, 0.1 lower, see the
   edit as steeply as the block's cones allow. Their own block and those between have pits, whose cones nothing so far
   away can narrow. */
static void neighbours_are_surveyed(void)
{
    enum { ACROSS = 32, DOWN = 48 };
    static float land[ACROSS * DOWN];
    conemap_desc desc = make_desc(0);
    conemap_map map, whole;
    int i, j, at = 14 * ACROSS + 15;
    float before;
    for (j = 0; j < DOWN; ++j)
        for (i = 0; i < ACROSS; ++i)
            land[j * ACROSS + i] = j < 16 && i < 16 ? 0.5f : j % 2 == 0 || (j < 16 && i == 16) ? 0.4f : 0.1f;
    desc.heights.pixels = land;
    desc.heights.width = ACROSS;
    desc.heights.height = DOWN;
    desc.aspect = (float)DOWN / (6.0f * (float)ACROSS); /* texels are six times as wide as high */
    desc.max_tan = 1.0f / (6.0f * (float)ACROSS) / 0.0212f;
    desc.keep_search = 1;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    before = map.cones[at];
    land[42 * ACROSS + 16] = 1.0f;
    CHECK(conemap_update(&map, &desc, 16, 42, 1, 1) == CONEMAP_OK, "update");
    REQUIRE(conemap_build(&desc, &whole) == CONEMAP_OK, "build");
    CHECK(whole.cones[at] < before, "the edit narrows nothing");
    CHECK(!memcmp(map.cones, whole.cones, sizeof land), "%.9g, a full build gives %.9g", (double)map.cones[at],
          (double)whole.cones[at]);
    conemap_free(&whole);
    conemap_free(&map);
}

/* Generators without a partial way of their own are built again, in the memory that the map has. */
static void other_generators(void)
{
    int g;
    for (g = CONEMAP_EXACT; g < CONEMAP_GENERATOR_COUNT; ++g) {
        conemap_desc desc = make_desc(0);
        conemap_map map, whole;
        if (g == CONEMAP_RELAXED_SAMPLED) continue; /* slow */
        desc.generator = (conemap_generator)g;
        desc.guarantee = CONEMAP_GUARANTEE_DEFAULT;
        zoo_fill(ZOO_FBM, W, H, 9, heights);
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build %d", g);
        heights[20 * W + 20] = 1.0f;
        heights[21 * W + 20] = 0.0f;
        CHECK(conemap_update(&map, &desc, 20, 20, 1, 2) == CONEMAP_OK, "update %d", g);
        REQUIRE(conemap_build(&desc, &whole) == CONEMAP_OK, "build %d", g);
        CHECK(same_maps(&map, &whole), "generator %d: not what a full build gives", g);
        conemap_free(&whole);
        conemap_free(&map);
    }
}

static int allocations_left;

static void *scarce(size_t size, void *user)
{
    (void)user;
    return allocations_left-- > 0 ? test_alloc(size) : NULL;
}

static void give_back(void *memory, void *user)
{
    (void)user;
    test_release(memory);
}

static void errors_leave_the_map(void)
{
    conemap_desc desc = make_desc(1), other;
    conemap_map map, before, whole;
    static float cones[W * H], old[W * H];
    int n;
    zoo_fill(ZOO_FBM, W, H, 1, heights);
    desc.allocator.allocate = scarce;
    desc.allocator.release = give_back;
    allocations_left = 1000;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    before = map;
    memcpy(cones, map.cones, sizeof cones);
    memcpy(old, map.heights, sizeof old);
#define REFUSED(call, right)                                                                                           \
    do {                                                                                                               \
        conemap_result result = call;                                                                                  \
        CHECK(result == (right), "%s: %s", #call, conemap_result_string(result));                                      \
        CHECK(!memcmp(cones, map.cones, sizeof cones) && !memcmp(old, map.heights, sizeof old) &&                      \
                  map.info.height_hash == before.info.height_hash,                                                     \
              "%s changed the map", #call);                                                                            \
    } while (0)
    REFUSED(conemap_update(NULL, &desc, 0, 0, 1, 1), CONEMAP_ERROR_NULL);
    REFUSED(conemap_update(&map, NULL, 0, 0, 1, 1), CONEMAP_ERROR_NULL);
    REFUSED(conemap_update(&map, &desc, -1, 0, 1, 1), CONEMAP_ERROR_SIZE);
    REFUSED(conemap_update(&map, &desc, 0, 0, 0, 1), CONEMAP_ERROR_SIZE);
    REFUSED(conemap_update(&map, &desc, W, 0, 1, 1), CONEMAP_ERROR_SIZE);
    REFUSED(conemap_update(&map, &desc, 1, 0, W, 1), CONEMAP_ERROR_SIZE);
    REFUSED(conemap_update(&map, &desc, 0, 1, 1, H), CONEMAP_ERROR_SIZE);
    REFUSED(conemap_update(&map, &desc, 1, 1, 2147483647, 2147483647), CONEMAP_ERROR_SIZE);
    other = desc;
    other.max_tan = 2.0f;
    REFUSED(conemap_update(&map, &other, 0, 0, 1, 1), CONEMAP_ERROR_PARAMETER);
    other = desc;
    other.slack = 0.5f;
    REFUSED(conemap_update(&map, &other, 0, 0, 1, 1), CONEMAP_ERROR_PARAMETER);
    other = desc;
    other.texture.flip_dv = 1;
    REFUSED(conemap_update(&map, &other, 0, 0, 1, 1), CONEMAP_ERROR_PARAMETER);
    other = desc;
    other.generator = CONEMAP_QUICK;
    other.guarantee = CONEMAP_GUARANTEE_DEFAULT;
    REFUSED(conemap_update(&map, &other, 0, 0, 1, 1), CONEMAP_ERROR_PARAMETER);
    other = desc;
    other.heights.width = 0;
    REFUSED(conemap_update(&map, &other, 0, 0, 1, 1), CONEMAP_ERROR_SIZE);
    heights[3 * W + 4] = NAN;
    REFUSED(conemap_update(&map, &desc, 2, 2, 5, 5), CONEMAP_ERROR_HEIGHT);
    heights[3 * W + 4] = 1.0f;
    for (n = 0; n < 2; ++n) {
        allocations_left = n;
        REFUSED(conemap_update(&map, &desc, 2, 2, 5, 5), CONEMAP_ERROR_MEMORY);
    }
    allocations_left = 2;
    CHECK(conemap_update(&map, &desc, 2, 2, 5, 5) == CONEMAP_OK, "two allocations are enough");
    allocations_left = 1000;
    REQUIRE(conemap_build(&desc, &whole) == CONEMAP_OK, "build");
    CHECK(same_maps(&map, &whole), "not what a full build gives");
    conemap_free(&whole);
    conemap_free(&map);
}

/* The desc of a build in the caller's own memory can be used as it is: an update takes scratch of its own. */
static void in_own_memory(void)
{
    conemap_desc desc = make_desc(4);
    conemap_map map, whole;
    size_t memory_size, scratch_size;
    zoo_fill(ZOO_FBM, W, H, 3, heights);
    REQUIRE(conemap_memory(&desc, &memory_size, &scratch_size) == CONEMAP_OK, "memory");
    desc.memory = test_alloc(memory_size);
    desc.memory_size = memory_size;
    desc.scratch = test_alloc(scratch_size);
    desc.scratch_size = scratch_size;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    heights[5 * W + 5] = 1.0f;
    CHECK(conemap_update(&map, &desc, 5, 5, 1, 1) == CONEMAP_OK, "update");
    test_release(desc.scratch);
    desc.scratch = NULL;
    {
        conemap_desc other = desc;
        other.memory = NULL;
        REQUIRE(conemap_build(&other, &whole) == CONEMAP_OK, "build");
    }
    CHECK(same_maps(&map, &whole), "not what a full build gives");
    conemap_free(&whole);
    conemap_free(&map);
    test_release(desc.memory);
}

const struct test_case updates_tests[] = {
    {"kept searches follow", kept_searches_follow},
    {"updates equal builds", updates_equal_builds},
    {"neighbours are surveyed", neighbours_are_surveyed},
    {"other generators", other_generators},
    {"errors leave the map", errors_leave_the_map},
    {"in own memory", in_own_memory},
    {NULL, NULL},
};
