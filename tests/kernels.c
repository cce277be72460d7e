/* Instruction sets: every one that this machine has against plain C, to the bit; and what a desc may ask for. */
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

static const char *wrap_names[] = {"clamp", "wrap", "nothing"};

/* Builds with plain C and with every other set; compares heights, cones and the pyramid's top. */
static void compare(const conemap_desc *settings, const char *what)
{
    conemap_desc desc = *settings;
    conemap_map plain, map;
    conemap_result result;
    size_t texels, count, k;
    int isa;
    desc.isa = CONEMAP_ISA_SCALAR;
    result = conemap_build(&desc, &plain);
    texels = (size_t)desc.heights.width * (size_t)desc.heights.height;
    count = texels * (desc.texture.sectors ? (size_t)desc.texture.sectors : 1u);
    for (isa = CONEMAP_ISA_SCALAR + 1; isa < CONEMAP_ISA_COUNT; ++isa) {
        conemap_result other;
        if (!conemap_isa_available((conemap_isa)isa)) continue;
        desc.isa = (conemap_isa)isa;
        other = conemap_build(&desc, &map);
        CHECK(other == result, "%s: %s gives %s", what, conemap_isa_name(desc.isa), conemap_result_string(other));
        if (other != CONEMAP_OK) continue;
        CHECK(map.isa == desc.isa, "%s: the map says %s", what, conemap_isa_name(map.isa));
        CHECK(memcmp(&map.info, &plain.info, sizeof map.info) == 0, "%s: infos differ", what);
        for (k = 0; result == CONEMAP_OK && k < count; ++k) {
            const size_t at = k % texels;
            if (memcmp(&map.heights[at], &plain.heights[at], 4) == 0 &&
                memcmp(&map.cones[k], &plain.cones[k], 4) == 0)
                continue;
            CHECK(0, "%s: %s at (%d, %d), sector %d: height %.9g, cone %.9g; plain %.9g, %.9g", what,
                  conemap_isa_name(desc.isa), (int)at % desc.heights.width, (int)at / desc.heights.width, (int)(k / texels),
                  (double)map.heights[at], (double)map.cones[k], (double)plain.heights[at], (double)plain.cones[k]);
            break;
        }
        conemap_free(&map);
    }
    conemap_free(&plain);
}

/* Every code of every format, decoded, quantised to every format, in rows of odd lengths and strides. */
static void codes(void)
{
    const int count = 65536 + 13;
    unsigned char *pixels = (unsigned char *)test_alloc((size_t)count * 7);
    int format, to, stride, k, depth;
    char what[96];
    for (format = 0; format < CONEMAP_FORMAT_COUNT; ++format) {
        for (stride = 0; stride <= 7; stride += 7) {
            const int size = format == CONEMAP_F32 ? 4 : format == CONEMAP_UNORM8 ? 1 : 2, step = stride ? stride : size;
            for (k = 0; k < count; ++k) {
                const uint16_t half = (uint16_t)(k % 0x3c01), word = (uint16_t)k;
                const float value = (float)k / 65549.0f;
                const unsigned char byte = (unsigned char)(k & 255);
                const void *pixel = format == CONEMAP_F32      ? (const void *)&value
                                    : format == CONEMAP_F16    ? (const void *)&half
                                    : format == CONEMAP_UNORM8 ? (const void *)&byte
                                                               : (const void *)&word;
                memcpy(pixels + k * step, pixel, (size_t)size);
            }
            for (to = 0; to < CONEMAP_FORMAT_COUNT; ++to) {
                for (depth = 0; depth < 2; ++depth) {
                    conemap_desc desc;
                    memset(&desc, 0, sizeof desc);
                    desc.heights.pixels = pixels;
                    desc.heights.width = 2017;
                    desc.heights.height = 32;
                    desc.heights.format = (conemap_format)format;
                    desc.heights.pixel_stride = stride;
                    desc.heights.is_depth = depth;
                    desc.texture.format = (conemap_format)to;
                    desc.texture.encoding = (conemap_encoding)((format + to + depth) % CONEMAP_ENCODING_COUNT);
                    desc.generator = CONEMAP_RING;
                    desc.ring_limit = 1;
                    snprintf(what, sizeof what, "format %d to %d, stride %d, depth %d", format, to, stride, depth);
                    compare(&desc, what);
                }
            }
        }
    }
    test_release(pixels);
}

/* What is no height is found in every lane, what is one passes. */
static void bad_heights(void)
{
    static const float bad[] = {-1e-45f, 1.0000001f, -1.0f, 2.0f};
    float heights[41];
    int isa, at, b;
    for (isa = CONEMAP_ISA_SCALAR; isa < CONEMAP_ISA_COUNT; ++isa) {
        if (!conemap_isa_available((conemap_isa)isa)) continue;
        for (at = 0; at < 41; ++at) {
            for (b = 0; b < 7; ++b) {
                conemap_desc desc;
                conemap_map map;
                conemap_result result;
                uint32_t bits = b == 4 ? 0x7f800000u : b == 5 ? 0x7fc00000u : 0x80000000u;
                memset(heights, 0, sizeof heights);
                if (b < 4) heights[at] = bad[b];
                else memcpy(&heights[at], &bits, 4);
                memset(&desc, 0, sizeof desc);
                desc.heights.pixels = heights;
                desc.heights.width = 41;
                desc.heights.height = 1;
                desc.isa = (conemap_isa)isa;
                result = conemap_build(&desc, &map);
                CHECK(result == (b == 6 ? CONEMAP_OK : CONEMAP_ERROR_HEIGHT), "%s, %d in lane %d: %s",
                      conemap_isa_name((conemap_isa)isa), b, at, conemap_result_string(result));
                if (result == CONEMAP_OK) {
                    memcpy(&bits, &map.heights[at], 4);
                    CHECK(bits == 0, "-0 stays");
                    conemap_free(&map);
                }
            }
        }
    }
}

/* Every generator on small maps of all kinds, wraps and shapes. */
static void generators(void)
{
    static const float aspects[] = {1.0f, 0.37f, 3.0f};
    float heights[40 * 40];
    int kind, round, generator, number = 0;
    char what[160];
    for (kind = 0; kind < ZOO_KINDS; ++kind) {
        for (round = 0; round < 30; ++round) {
            struct zoo_random random = zoo_seed((uint64_t)(kind * 100 + round));
            conemap_desc desc;
            memset(&desc, 0, sizeof desc);
            desc.heights.width = 1 + zoo_below(&random, 40);
            desc.heights.height = 1 + zoo_below(&random, 40);
            desc.wrap_u = (conemap_wrap)zoo_below(&random, 3);
            desc.wrap_v = (conemap_wrap)zoo_below(&random, 3);
            desc.aspect = aspects[zoo_below(&random, 3)];
            desc.max_tan = round % 5 == 4 ? 60000.0f : 1.0f;
            desc.heights.pixels = heights;
            desc.keep_pyramid = round & 1;
            zoo_fill(kind, desc.heights.width, desc.heights.height, 5u + (uint32_t)round, heights);
            generator = number++ % 8;
            desc.generator = generator < 5 ? CONEMAP_EXACT : generator == 5 ? CONEMAP_QUICK
                           : generator == 6 ? CONEMAP_QUICK_NAIVE : CONEMAP_RELAXED_EXACT;
            if (generator == 0 || generator == 1) desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
            if (generator == 1 || generator == 3) desc.slack = round & 1 ? 0.1f : 0.6f;
            if (round == 20) desc.generator = CONEMAP_QUICK_CENTER;
            if (round == 21) desc.generator = CONEMAP_QUICK_NAIVE_CENTER;
            if (round == 20 || round == 21) desc.guarantee = CONEMAP_GUARANTEE_DEFAULT, desc.slack = 0.0f;
            desc.texture.per_cell = generator == 4 && round != 20 && round != 21;
            if (desc.generator == CONEMAP_EXACT && round % 3) desc.texture.sectors = 4 * (round % 3);
            desc.min3x3 = zoo_below(&random, 2);
            desc.texture.format = (conemap_format)zoo_below(&random, 4);
            desc.texture.encoding = (conemap_encoding)zoo_below(&random, desc.texture.per_cell ? 2 : 3);
            snprintf(what, sizeof what,
                     "%s %dx%d %s/%s aspect %g, generator %d, guarantee %d, sectors %d, slack %g, seed %d",
                     zoo_name(kind), desc.heights.width, desc.heights.height, wrap_names[desc.wrap_u],
                     wrap_names[desc.wrap_v], (double)desc.aspect, (int)desc.generator, (int)desc.guarantee,
                     desc.texture.sectors, (double)desc.slack, round);
            compare(&desc, what);
        }
    }
}

/* Maps larger than the blocks that searches work on. */
static void larger(void)
{
    static const int sizes[][2] = {{257, 61}, {64, 128}, {100, 131}, {1, 300}, {300, 2}};
    float *heights = (float *)test_alloc(300 * 300 * sizeof(float));
    int kind, size, generator;
    char what[160];
    for (kind = ZOO_BRICKS; kind <= ZOO_SPIKES; ++kind) {
        for (size = 0; size < 5; ++size) {
            for (generator = 0; generator < 6; ++generator) {
                conemap_desc desc;
                if ((generator == 2 || generator == 3 || generator == 5) && (kind + size + generator) % 3) continue;
                memset(&desc, 0, sizeof desc);
                desc.heights.pixels = heights;
                desc.heights.width = sizes[size][0];
                desc.heights.height = sizes[size][1];
                desc.wrap_u = (conemap_wrap)((kind + size) % 3);
                desc.wrap_v = (conemap_wrap)(size % 3);
                desc.generator = generator == 4 ? CONEMAP_QUICK : generator == 5 ? CONEMAP_RELAXED_EXACT : CONEMAP_EXACT;
                if (generator < 4) desc.guarantee = generator & 1 ? CONEMAP_GUARANTEE_BILINEAR : CONEMAP_GUARANTEE_VERTEX;
                if (generator < 4) desc.slack = size & 1 ? kind & 1 ? 0.6f : 0.1f : 0.0f;
                if (generator == 2 || generator == 3) desc.texture.sectors = kind & 1 ? 8 : 4;
                zoo_fill(kind, desc.heights.width, desc.heights.height, 9u, heights);
                snprintf(what, sizeof what, "%s %dx%d generator %d slack %g", zoo_name(kind), desc.heights.width,
                         desc.heights.height, generator, (double)desc.slack);
                compare(&desc, what);
            }
        }
    }
    test_release(heights);
}

/* Sets that are not to be had are refused, the default is one that is. */
static void choice(void)
{
    const float heights[4] = {0.0f, 0.25f, 0.5f, 1.0f};
    conemap_desc desc;
    conemap_map map;
    int isa, sets = 0;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = 2;
    desc.heights.height = 2;
    for (isa = -1; isa <= CONEMAP_ISA_COUNT; ++isa) {
        conemap_result result, right = CONEMAP_ERROR_ENUM;
        desc.isa = (conemap_isa)isa;
        CHECK(conemap_isa_name(desc.isa) != NULL, "no name for %d", isa);
        if (isa >= 0 && isa < CONEMAP_ISA_COUNT) {
            const int available = conemap_isa_available(desc.isa);
            right = available ? CONEMAP_OK : CONEMAP_ERROR_UNSUPPORTED;
            sets += available && isa != CONEMAP_ISA_DEFAULT;
            if (available && isa > CONEMAP_ISA_SCALAR) test_note("%s", conemap_isa_name(desc.isa));
        } else {
            CHECK(!conemap_isa_available(desc.isa), "%d is available", isa);
        }
        result = conemap_build(&desc, &map);
        CHECK(result == right, "%d: %s", isa, conemap_result_string(result));
        if (result != CONEMAP_OK) continue;
        CHECK(isa == CONEMAP_ISA_DEFAULT ? map.isa != CONEMAP_ISA_DEFAULT && conemap_isa_available(map.isa)
                                         : map.isa == desc.isa, "%d became %d", isa, (int)map.isa);
        conemap_free(&map);
    }
    CHECK(conemap_isa_available(CONEMAP_ISA_DEFAULT) && conemap_isa_available(CONEMAP_ISA_SCALAR), "no plain C");
    CHECK(sets >= 1, "%d sets", sets);
}

const struct test_case kernels_tests[] = {
    {"choice", choice},
    {"codes", codes},
    {"bad heights", bad_heights},
    {"generators", generators},
    {"larger maps", larger},
    {NULL, NULL},
};
