/* What goes in and what comes out: input formats and strides, quantised cones, textures, baked bytes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "conemap.h"
#include "test.h"
#include "zoo.h"

#define W 19
#define H 13
#define TEXELS (W * H)

static double half_value(unsigned bits)
{
    const int exponent = (int)(bits >> 10 & 31u);
    const double mantissa = (double)(bits & 1023u);
    const double value = exponent ? ldexp(1024.0 + mantissa, exponent - 25) : ldexp(mantissa, -24);
    return bits & 0x8000u ? -value : value;
}

static conemap_desc plain_desc(const void *pixels, conemap_format format)
{
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = pixels;
    desc.heights.width = W;
    desc.heights.height = H;
    desc.heights.format = format;
    return desc;
}

static int same_maps(const conemap_map *a, const conemap_map *b)
{
    const size_t bytes = (size_t)a->info.width * (size_t)a->info.height * sizeof(float);
    return a->info.width == b->info.width && a->info.height == b->info.height &&
           !memcmp(a->heights, b->heights, bytes) && !memcmp(a->cones, b->cones, bytes);
}

static int same_info(const conemap_info *a, const conemap_info *b)
{
    return a->width == b->width && a->height == b->height && a->wrap_u == b->wrap_u &&
           a->wrap_v == b->wrap_v && a->aspect == b->aspect && a->max_tan == b->max_tan &&
           a->texture.format == b->texture.format && a->texture.encoding == b->texture.encoding &&
           a->texture.layout == b->texture.layout && !a->texture.flip_dv == !b->texture.flip_dv &&
           a->generator == b->generator && a->guarantee == b->guarantee && !a->min3x3 == !b->min3x3 &&
           a->height_hash == b->height_hash;
}

/* ---- heights read ---- */

/* Every value of a format decodes to the nearest float; 256 columns. */
static void every_value(void)
{
    static uint16_t pixels[65536];
    static uint8_t bytes[256];
    conemap_desc desc = plain_desc(bytes, CONEMAP_UNORM8);
    conemap_map map;
    int k, wrong = 0;

    for (k = 0; k < 256; ++k) bytes[k] = (uint8_t)k;
    desc.heights.width = 256;
    desc.heights.height = 1;
    desc.generator = CONEMAP_QUICK_NAIVE;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "u8");
    for (k = 0; k < 256; ++k) wrong += map.heights[k] != (float)k / 255.0f;
    CHECK(!wrong, "%d u8 values decode wrongly", wrong);
    conemap_free(&map);

    for (k = 0; k < 65536; ++k) pixels[k] = (uint16_t)k;
    desc.heights.pixels = pixels;
    desc.heights.format = CONEMAP_UNORM16;
    desc.heights.height = 256;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "u16");
    for (wrong = 0, k = 0; k < 65536; ++k) wrong += map.heights[k] != (float)k / 65535.0f;
    CHECK(!wrong, "%d u16 values decode wrongly", wrong);
    conemap_free(&map);

    desc.heights.format = CONEMAP_F16;
    desc.heights.height = 60; /* 0 .. 0x3bff: every half from 0 to below 1 */
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "f16");
    for (wrong = 0, k = 0; k < 0x3c00; ++k) wrong += map.heights[k] != (float)half_value((unsigned)k);
    CHECK(!wrong, "%d halves decode wrongly", wrong);
    conemap_free(&map);
    pixels[0] = 0x3c00;
    desc.heights.width = desc.heights.height = 1;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "half 1.0");
    CHECK(map.heights[0] == 1.0f, "half 1.0 is %g", (double)map.heights[0]);
    conemap_free(&map);
}

/* The same heights through every format and stride give the same map. */
static void strides(void)
{
    static const size_t bytes[CONEMAP_FORMAT_COUNT] = {4, 2, 2, 1};
    struct zoo_random random = zoo_seed(21);
    float reference[TEXELS];
    unsigned codes[TEXELS];
    int format, k, round;

    for (format = 0; format < CONEMAP_FORMAT_COUNT; ++format) {
        conemap_desc desc;
        conemap_map right, map;
        for (k = 0; k < TEXELS; ++k) {
            if (format == CONEMAP_UNORM8) codes[k] = zoo_next(&random) & 255u;
            else if (format == CONEMAP_UNORM16) codes[k] = zoo_next(&random) & 65535u;
            else codes[k] = zoo_next(&random) % 0x3c01u;
            if (format == CONEMAP_UNORM8) reference[k] = (float)codes[k] / 255.0f;
            else if (format == CONEMAP_UNORM16) reference[k] = (float)codes[k] / 65535.0f;
            else reference[k] = (float)half_value(codes[k]);
        }
        desc = plain_desc(reference, CONEMAP_F32);
        REQUIRE(conemap_build(&desc, &right) == CONEMAP_OK, "reference");

        for (round = 0; round < 8; ++round) {
            const size_t pixel = bytes[format] + (size_t)(round & 1 ? 3 * bytes[format] : round == 4 ? 1 : 0);
            const size_t row = W * pixel + (round & 2 ? 37u : 0u);
            const int flipped = round >= 5;
            unsigned char *pixels = (unsigned char *)test_alloc(row * H);
            for (k = 0; k < TEXELS; ++k) {
                const int line = flipped ? H - 1 - k / W : k / W;
                unsigned char *at = pixels + (size_t)line * row + (size_t)(k % W) * pixel;
                const uint16_t word = (uint16_t)codes[k];
                if (format == CONEMAP_F32) memcpy(at, &reference[k], 4);
                else if (format == CONEMAP_UNORM8) *at = (unsigned char)codes[k];
                else memcpy(at, &word, 2);
            }
            desc = plain_desc(pixels, (conemap_format)format);
            if (pixel != bytes[format]) desc.heights.pixel_stride = (ptrdiff_t)pixel;
            if (row != W * pixel || flipped) desc.heights.row_stride = (ptrdiff_t)row;
            if (flipped) {
                desc.heights.pixels = pixels + (H - 1) * row;
                desc.heights.row_stride = -(ptrdiff_t)row;
            }
            if (CHECK(conemap_build(&desc, &map) == CONEMAP_OK, "format %d, strides %d", format, round)) {
                CHECK(same_maps(&map, &right), "format %d, strides %d: a different map", format, round);
                conemap_free(&map);
            }
            test_release(pixels);
        }
        conemap_free(&right);
    }
}

static void depths(void)
{
    static float depths_read[TEXELS];
    uint8_t bytes[TEXELS];
    conemap_desc desc = plain_desc(depths_read, CONEMAP_F32);
    conemap_map map;
    int k;
    zoo_fill(ZOO_WHITE, W, H, 4, depths_read);
    for (k = 0; k < TEXELS; ++k) bytes[k] = (uint8_t)(k & 255);
    desc.heights.is_depth = 1;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "f32");
    for (k = 0; k < TEXELS; ++k) {
        CHECK(map.heights[k] == 1.0f - depths_read[k], "depth %g: height %g", (double)depths_read[k],
              (double)map.heights[k]);
    }
    conemap_free(&map);
    desc.heights.pixels = bytes;
    desc.heights.format = CONEMAP_UNORM8;
    desc.texture.format = CONEMAP_UNORM8;
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "u8");
    for (k = 0; k < TEXELS; ++k) {
        CHECK(map.heights[k] == (float)(255 - bytes[k]) / 255.0f, "depth %d / 255: height %g", (int)bytes[k],
              (double)map.heights[k]);
    }
    conemap_free(&map);
}

/* ---- what the texture holds ---- */

/* The stored number that follows a stored cone upwards in its format. */
static float next_up(conemap_format format, float stored)
{
    if (format == CONEMAP_F32) return nextafterf(stored, 1e30f);
    if (format == CONEMAP_UNORM8) return (floorf(stored * 255.0f + 0.5f) + 1.0f) / 255.0f;
    if (format == CONEMAP_UNORM16) return (floorf(stored * 65535.0f + 0.5f) + 1.0f) / 65535.0f;
    if (stored < 6.1035156e-5f) return stored + 5.9604645e-8f;
    {
        int exponent;
        (void)frexpf(stored, &exponent);
        return stored + ldexpf(1.0f, exponent - 11);
    }
}

static double channel(const unsigned char *at, conemap_format format)
{
    uint16_t word;
    float value;
    if (format == CONEMAP_UNORM8) return (double)((float)*at / 255.0f);
    if (format == CONEMAP_F32) {
        memcpy(&value, at, sizeof value);
        return (double)value;
    }
    memcpy(&word, at, sizeof word);
    return format == CONEMAP_F16 ? half_value(word) : (double)((float)word / 65535.0f);
}

/* Visits every texture with some maps. */
static void for_textures(void (*visit)(const conemap_map *map, const conemap_desc *desc))
{
    static const int kinds[] = {ZOO_FBM, ZOO_WHITE, ZOO_IMPULSE, ZOO_FLAT_1, ZOO_RAMP};
    static const int shapes[][2] = {{W, H}, {1, 1}, {2, 5}};
    static float heights[TEXELS];
    int kind, format, encoding, layout, wide, shape;
    for (shape = 0; shape < 3; ++shape) {
        for (kind = 0; kind < 5; ++kind) {
            zoo_fill(kinds[kind], shapes[shape][0], shapes[shape][1], 6, heights);
            for (format = 0; format < CONEMAP_FORMAT_COUNT; ++format) {
                for (encoding = 0; encoding < CONEMAP_ENCODING_COUNT; ++encoding) {
                    for (layout = 0; layout < CONEMAP_LAYOUT_COUNT; ++layout) {
                        for (wide = 0; wide < 2; ++wide) {
                            conemap_desc desc = plain_desc(heights, CONEMAP_F32);
                            conemap_map map;
                            conemap_result result;
                            desc.heights.width = shapes[shape][0];
                            desc.heights.height = shapes[shape][1];
                            desc.texture.format = (conemap_format)format;
                            desc.texture.encoding = (conemap_encoding)encoding;
                            desc.texture.layout = (conemap_layout)layout;
                            desc.max_tan = wide ? 300.0f : 1.0f;
                            desc.wrap_u = wide ? CONEMAP_WRAP : CONEMAP_CLAMP;
                            desc.generator = CONEMAP_RING;
                            desc.texture.flip_dv = wide;
                            result = conemap_build(&desc, &map);
                            if (!CHECK(result == CONEMAP_OK, "format %d encoding %d layout %d: %s", format,
                                       encoding, layout, conemap_result_string(result))) {
                                continue;
                            }
                            visit(&map, &desc);
                            conemap_free(&map);
                        }
                    }
                }
            }
        }
    }
}

#define NAME_TEXTURE(map)                                                                                    \
    (int)(map)->info.texture.format, (int)(map)->info.texture.encoding, (int)(map)->info.texture.layout

static void visit_rounding(const conemap_map *map, const conemap_desc *desc)
{
    const conemap_format format = map->info.texture.format;
    const int count = map->info.width * map->info.height;
    conemap_desc plain = *desc;
    conemap_map right;
    int k, step;
    plain.heights.pixels = map->heights;
    plain.texture.format = CONEMAP_F32;
    plain.texture.encoding = CONEMAP_LINEAR;
    plain.texture.layout = CONEMAP_CONE_ONLY;
    REQUIRE(conemap_build(&plain, &right) == CONEMAP_OK, "reference");
    for (k = 0; k < count; ++k) {
        const float h = map->heights[k], stored = map->cones[k],
                    tangent = conemap_decode(&map->info, h, stored);
        float above = stored;
        if (map->info.texture.layout == CONEMAP_CONE_ONLY) {
            CHECK(h == ((const float *)desc->heights.pixels)[k], "cone only: a height was changed");
        } else if (format == CONEMAP_UNORM8 || format == CONEMAP_UNORM16) {
            const float most = format == CONEMAP_UNORM8 ? 255.0f : 65535.0f;
            const float given = ((const float *)desc->heights.pixels)[k];
            CHECK(h == floorf(given * most + 0.5f) / most || fabsf(h - given) * most < 0.5001f,
                  "height %.9g is stored as %.9g", (double)given, (double)h);
        }
        if (!(tangent >= 0.0f && tangent <= right.cones[k])) {
            CHECK(0,
                  "format %d encoding %d layout %d at %d, height %g: stored %.9g decodes to %.9g, not to <= "
                  "%.9g",
                  NAME_TEXTURE(map), k, (double)h, (double)stored, (double)tangent, (double)right.cones[k]);
            break;
        }
        /* and not a needless step lower */
        if (map->info.texture.encoding == CONEMAP_RADIUS && (h > 0.999f || right.cones[k] >= map->info.max_tan))
            continue; /* decoding ends at max_tan, so higher values would say the same */
        for (step = 0; step < (format == CONEMAP_F32 ? 4 : 2); ++step) above = next_up(format, above);
        if ((format == CONEMAP_UNORM8 || format == CONEMAP_UNORM16) && above > 1.0f) continue;
        if (!(conemap_decode(&map->info, h, above) > right.cones[k])) {
            CHECK(0,
                  "format %d encoding %d layout %d at %d, height %g: stored %.9g is needlessly low for %.9g",
                  NAME_TEXTURE(map), k, (double)h, (double)stored, (double)right.cones[k]);
            break;
        }
    }
    conemap_free(&right);
}

static void cones_round_down(void)
{
    for_textures(visit_rounding);
}

static float right_difference(const conemap_map *map, int i, int j, int along_v)
{
    const int w = map->info.width, h = map->info.height, size = along_v ? h : w, at = along_v ? j : i;
    const int wraps = (along_v ? map->info.wrap_v : map->info.wrap_u) == CONEMAP_WRAP;
    int before = at - 1, after = at + 1, span = 2;
    float a, b;
    if (wraps) {
        before = (before + size) % size;
        after %= size;
    } else {
        if (before < 0) {
            before = 0;
            --span;
        }
        if (after > size - 1) {
            after = size - 1;
            --span;
        }
    }
    a = map->heights[along_v ? before * w + i : j * w + before];
    b = map->heights[along_v ? after * w + i : j * w + after];
    return span ? (b - a) / (float)span : 0.0f;
}

static void visit_write(const conemap_map *map, const conemap_desc *desc)
{
    static const size_t bytes_of[CONEMAP_FORMAT_COUNT] = {4, 2, 2, 1};
    static const double slack[CONEMAP_FORMAT_COUNT] = {1e-6, 1.0 / 2048.0, 0.51 / 65535.0, 0.51 / 255.0};
    const conemap_format format = map->info.texture.format;
    const conemap_layout layout = map->info.texture.layout;
    const size_t bytes = bytes_of[format];
    const size_t texel = bytes * (layout == CONEMAP_CONE_ONLY ? 1u : layout == CONEMAP_DUMMER ? 4u : 2u);
    const size_t row = texel * (size_t)map->info.width, height = (size_t)map->info.height;
    const size_t pitches[] = {0, row, row + 1, row + 7, (row + 255) / 256 * 256};
    int round;
    size_t i, j;
    (void)desc;
    CHECK(conemap_row_size(map) == row, "a row is %d bytes, said %d", (int)row, (int)conemap_row_size(map));
    for (round = 0; round < 5; ++round) {
        const size_t pitch = pitches[round] ? pitches[round] : row;
        unsigned char *pixels = (unsigned char *)test_alloc(pitch * height);
        int wrong = 0, padding = 0;
        CHECK(conemap_texture_size(map, pitches[round]) == pitch * height, "a texture of %d bytes is %d",
              (int)(pitch * height), (int)conemap_texture_size(map, pitches[round]));
        if (CHECK(conemap_write_texture(map, pixels, pitch * height, pitches[round]) == CONEMAP_OK,
                  "format %d encoding %d layout %d: write", NAME_TEXTURE(map))) {
            for (j = 0; j < height; ++j) {
                for (i = row; i < pitch; ++i) padding += pixels[j * pitch + i] != 0xa5;
                for (i = 0; i < (size_t)map->info.width; ++i) {
                    const unsigned char *at = pixels + j * pitch + i * texel;
                    const size_t k = j * (size_t)map->info.width + i;
                    const size_t cone = layout == CONEMAP_CONE_ONLY ? 0 : 1;
                    if (cone) wrong += channel(at, format) != (double)map->heights[k];
                    wrong += channel(at + cone * bytes, format) != (double)map->cones[k];
                    if (layout == CONEMAP_DUMMER) {
                        const double sign = map->info.texture.flip_dv ? -1.0 : 1.0;
                        double du = 0.5 + (double)right_difference(map, (int)i, (int)j, 0);
                        double dv = 0.5 + sign * (double)right_difference(map, (int)i, (int)j, 1);
                        if (format == CONEMAP_UNORM8 || format == CONEMAP_UNORM16) {
                            du = du < 0.0 ? 0.0 : du > 1.0 ? 1.0 : du;
                            dv = dv < 0.0 ? 0.0 : dv > 1.0 ? 1.0 : dv;
                        }
                        if (!(fabs(channel(at + 2 * bytes, format) - du) <= slack[format])) {
                            CHECK(0, "format %d, %dx%d wraps %d: du at (%d, %d) is %g, right %g", (int)format,
                                  map->info.width, map->info.height, (int)map->info.wrap_u, (int)i, (int)j,
                                  channel(at + 2 * bytes, format), du);
                        }
                        if (!(fabs(channel(at + 3 * bytes, format) - dv) <= slack[format])) {
                            CHECK(0, "format %d, %dx%d: dv at (%d, %d) is %g, right %g", (int)format,
                                  map->info.width, map->info.height, (int)i, (int)j,
                                  channel(at + 3 * bytes, format), dv);
                        }
                    }
                }
            }
        }
        CHECK(!padding, "%d bytes of padding were written", padding);
        CHECK(!wrong, "format %d encoding %d layout %d: %d channels are not what the map says",
              NAME_TEXTURE(map), wrong);
        if (pitch * height > 0) { /* nothing is needed behind the last row */
            size_t least = pitch * (height - 1) + conemap_row_size(map);
            CHECK(conemap_write_texture(map, pixels, least, pitches[round]) == CONEMAP_OK, "as much as needed");
            CHECK(conemap_write_texture(map, pixels, least - 1, pitches[round]) == CONEMAP_ERROR_BUFFER,
                  "a byte less than needed");
        }
        test_release(pixels);
    }
    if (row > 1) {
        unsigned char one[1];
        CHECK(conemap_texture_size(map, row - 1) == 0, "a pitch below a row has a size");
        CHECK(conemap_write_texture(map, one, (size_t)1 << 20, row - 1) == CONEMAP_ERROR_STRIDE,
              "a low pitch");
    }
}

static void textures(void)
{
    for_textures(visit_write);
}

static void decoding(void)
{
    conemap_info info;
    memset(&info, 0, sizeof info);
    info.width = info.height = 1;
    info.aspect = 1.0f;
    info.max_tan = 8.0f;
    CHECK(conemap_decode(&info, 0.5f, 0.25f) == 0.25f, "linear");
    info.texture.encoding = CONEMAP_SQRT;
    CHECK(conemap_decode(&info, 0.5f, 0.5f) == 0.25f, "sqrt");
    info.texture.encoding = CONEMAP_RADIUS;
    CHECK(fabs((double)conemap_decode(&info, 0.5f, 0.25f) - 0.5) < 1e-6, "radius: %g",
          (double)conemap_decode(&info, 0.5f, 0.25f));
    CHECK(conemap_decode(&info, 1.0f, 0.0f) >= 0.0f && conemap_decode(&info, 1.0f, 0.0f) <= 8.0f,
          "radius at the top: %g", (double)conemap_decode(&info, 1.0f, 0.0f));
    CHECK(conemap_decode(&info, 0.9999999f, 0.5f) <= 8.0f, "radius near the top: %g",
          (double)conemap_decode(&info, 0.9999999f, 0.5f));
}

/* ---- baked bytes ---- */

static void visit_bake(const conemap_map *map, const conemap_desc *desc)
{
    const size_t size = conemap_save_size(map);
    unsigned char *bytes = (unsigned char *)test_alloc(size), *again = (unsigned char *)test_alloc(size);
    conemap_info info;
    conemap_map loaded;
    conemap_result result;
    const int cone_only = map->info.texture.layout == CONEMAP_CONE_ONLY;
    memset(again, 0x5a, size);
    CHECK(conemap_save(map, bytes, size) == CONEMAP_OK, "save");
    CHECK(bytes[12] == 100, "the file header's size, which tests/long/fuzz.c repeats, is %d", (int)bytes[12]);
    CHECK(conemap_save(map, again, size) == CONEMAP_OK && !memcmp(bytes, again, size), "save, twice");
    CHECK(conemap_save(map, again, size - 1) == CONEMAP_ERROR_BUFFER, "save into too little");
    memset(&info, 0xee, sizeof info);
    result = conemap_load_info(bytes, size, &info);
    CHECK(result == CONEMAP_OK && same_info(&info, &map->info), "format %d encoding %d layout %d: info: %s",
          NAME_TEXTURE(map), conemap_result_string(result));
    result = conemap_load(bytes, size, desc, &loaded);
    if (CHECK(result == CONEMAP_OK, "format %d encoding %d layout %d: %s", NAME_TEXTURE(map),
              conemap_result_string(result))) {
        CHECK(same_maps(&loaded, map) && same_info(&loaded.info, &map->info),
              "format %d encoding %d layout %d: a different map", NAME_TEXTURE(map));
        if (CHECK(conemap_save_size(&loaded) == size, "saved again, another size")) {
            CHECK(conemap_save(&loaded, again, size) == CONEMAP_OK && !memcmp(bytes, again, size),
                  "format %d encoding %d layout %d: saved again, other bytes", NAME_TEXTURE(map));
        }
        conemap_free(&loaded);
    }
    result = conemap_load(bytes, size, NULL, &loaded);
    if (cone_only) {
        CHECK(result == CONEMAP_ERROR_NO_HEIGHTS, "no heights anywhere: %s", conemap_result_string(result));
    } else if (CHECK(result == CONEMAP_OK, "without a desc: %s", conemap_result_string(result))) {
        CHECK(same_maps(&loaded, map), "format %d encoding %d layout %d: without a desc a different map",
              NAME_TEXTURE(map));
        conemap_free(&loaded);
    }
    test_release(bytes);
    test_release(again);
}

static void baked_bytes(void)
{
    for_textures(visit_bake);
}

static void broken_bytes(void)
{
    static float heights[TEXELS], others[TEXELS];
    int layout, accepted = 0, flips = 0;
    zoo_fill(ZOO_FBM, W, H, 7, heights);
    memcpy(others, heights, sizeof heights);
    others[TEXELS - 1] = 0.123f;
    for (layout = 0; layout < 2; ++layout) {
        conemap_desc desc = plain_desc(heights, CONEMAP_F32), other;
        conemap_map map, loaded;
        conemap_info info;
        unsigned char *bytes;
        size_t size, header, n;
        desc.texture.layout = layout ? CONEMAP_CONE_ONLY : CONEMAP_HEIGHT_CONE;
        desc.wrap_v = CONEMAP_WRAP;
        REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
        size = conemap_save_size(&map);
        header = size - conemap_texture_size(&map, 0);
        CHECK(header > 16 && header < 512, "a header of %d bytes", (int)header);
        bytes = (unsigned char *)test_alloc(size);
        CHECK(conemap_save(&map, bytes, size) == CONEMAP_OK, "save");

        for (n = 0; n < size; ++n) { /* a copy of exactly n bytes, so that reading on is seen by a checker */
            unsigned char *part = (unsigned char *)test_alloc(n);
            conemap_result result;
            memcpy(part, bytes, n);
            result = conemap_load(part, n, &desc, &loaded);
            if (!CHECK(result == CONEMAP_ERROR_FILE_TRUNCATED ||
                           (n < 8 && result == CONEMAP_ERROR_FILE_FORMAT),
                       "%d of %d bytes: %s", (int)n, (int)size, conemap_result_string(result))) {
                n = size - 1;
            }
            if (result == CONEMAP_OK) conemap_free(&loaded);
            CHECK(!loaded.heights && !loaded.cones && !loaded.memory_size, "%d bytes: the map is not zeroed",
                  (int)n);
            if (n < header) {
                result = conemap_load_info(part, n, &info);
                CHECK(result == CONEMAP_ERROR_FILE_TRUNCATED ||
                          (n < 8 && result == CONEMAP_ERROR_FILE_FORMAT),
                      "info of %d bytes: %s", (int)n, conemap_result_string(result));
            }
            test_release(part);
        }

        for (n = 0; n < header * 8; ++n) {
            conemap_result result, told;
            bytes[n / 8] ^= (unsigned char)(1u << (n % 8));
            memset(&info, 0, sizeof info);
            told = conemap_load_info(bytes, size, &info);
            result = conemap_load(bytes, size, &desc, &loaded);
            ++flips;
            if (told == CONEMAP_OK) {
                CHECK(info.width > 0 && info.height > 0 && info.width <= CONEMAP_MAX_SIZE &&
                          info.height <= CONEMAP_MAX_SIZE && (unsigned)info.wrap_u < CONEMAP_WRAP_COUNT &&
                          (unsigned)info.wrap_v < CONEMAP_WRAP_COUNT && info.aspect > 0.0f &&
                          info.max_tan > 0.0f && info.max_tan <= CONEMAP_TAN_LIMIT &&
                          (unsigned)info.texture.format < CONEMAP_FORMAT_COUNT &&
                          (unsigned)info.texture.encoding < CONEMAP_ENCODING_COUNT &&
                          (unsigned)info.texture.layout < CONEMAP_LAYOUT_COUNT &&
                          (unsigned)info.generator < CONEMAP_GENERATOR_COUNT &&
                          (unsigned)info.guarantee < CONEMAP_GUARANTEE_COUNT,
                      "bit %d of the header flipped: impossible info", (int)n);
            }
            if (n < 32) {
                CHECK(result == CONEMAP_ERROR_FILE_FORMAT, "bit %d of the magic flipped: %s", (int)n,
                      conemap_result_string(result));
            }
            if (result == CONEMAP_OK) {
                ++accepted;
                conemap_free(&loaded);
            } else {
                CHECK(result == CONEMAP_ERROR_FILE_FORMAT || result == CONEMAP_ERROR_FILE_VERSION ||
                          result == CONEMAP_ERROR_FILE_TRUNCATED || result == CONEMAP_ERROR_FILE_CORRUPT ||
                          result == CONEMAP_ERROR_HASH,
                      "bit %d of the header flipped: %s", (int)n, conemap_result_string(result));
            }
            bytes[n / 8] ^= (unsigned char)(1u << (n % 8));
        }

        other = desc;
        other.heights.pixels = others;
        CHECK(conemap_load(bytes, size, &other, &loaded) == CONEMAP_ERROR_HASH, "other heights");
        other = desc;
        other.heights.width = H;
        other.heights.height = W;
        CHECK(conemap_load(bytes, size, &other, &loaded) != CONEMAP_OK, "heights of another shape");
        CHECK(conemap_load(bytes, size, &desc, &loaded) == CONEMAP_OK, "the same heights");
        conemap_free(&loaded);
        if (!layout) {
            unsigned char *at = bytes + header; /* the first height */
            at[1] ^= 4;
            CHECK(conemap_load(bytes, size, NULL, &loaded) != CONEMAP_OK, "a changed height is not seen");
            conemap_free(&loaded);
        }
        test_release(bytes);
        conemap_free(&map);
    }
    test_note("header bit flips accepted %d of %d", accepted, flips);
}

static void load_options(void)
{
    static float heights[TEXELS];
    conemap_desc desc = plain_desc(heights, CONEMAP_F32), options;
    conemap_map map, loaded;
    unsigned char *bytes;
    size_t size;
    zoo_fill(ZOO_BRICKS, W, H, 7, heights);
    REQUIRE(conemap_build(&desc, &map) == CONEMAP_OK, "build");
    size = conemap_save_size(&map);
    bytes = (unsigned char *)test_alloc(size);
    CHECK(conemap_save(&map, bytes, size) == CONEMAP_OK, "save");
    memset(&options, 0, sizeof options);
    options.keep_pyramid = 1;
    if (CHECK(conemap_load(bytes, size, &options, &loaded) == CONEMAP_OK, "with a pyramid")) {
        conemap_trace_desc trace;
        conemap_ray ray = {{0.5f, 0.5f, 1.5f}, {0.1f, 0.1f, -1.0f}, 0.0f, 0.0f};
        conemap_hit hit;
        memset(&trace, 0, sizeof trace);
        trace.tracer = CONEMAP_TRACE_MAXMIP;
        CHECK(conemap_trace(&loaded, &trace, &ray, &hit, 1) == CONEMAP_OK && hit.status == CONEMAP_HIT,
              "a loaded pyramid traces");
        CHECK(conemap_trace(&map, &trace, &ray, &hit, 1) == CONEMAP_ERROR_NO_PYRAMID, "no pyramid was kept");
        conemap_free(&loaded);
    }
    options.memory = test_alloc(16);
    options.memory_size = 16;
    CHECK(conemap_load(bytes, size, &options, &loaded) == CONEMAP_ERROR_BUFFER ||
              ((uintptr_t)options.memory % CONEMAP_ALIGNMENT) != 0,
          "loaded into too little");
    test_release(options.memory);
    test_release(bytes);
    conemap_free(&map);
}

static void format_numbers(void)
{
    static const struct {
        conemap_layout layout;
        conemap_format format;
        int channels, bytes;
        unsigned dxgi, vulkan, internal, external, type;
    } rows[] = {
        {CONEMAP_CONE_ONLY, CONEMAP_F32, 1, 4, 41, 100, 0x822e, 0x1903, 0x1406},
        {CONEMAP_CONE_ONLY, CONEMAP_F16, 1, 2, 54, 76, 0x822d, 0x1903, 0x140b},
        {CONEMAP_CONE_ONLY, CONEMAP_UNORM16, 1, 2, 56, 70, 0x822a, 0x1903, 0x1403},
        {CONEMAP_CONE_ONLY, CONEMAP_UNORM8, 1, 1, 61, 9, 0x8229, 0x1903, 0x1401},
        {CONEMAP_HEIGHT_CONE, CONEMAP_F32, 2, 8, 16, 103, 0x8230, 0x8227, 0x1406},
        {CONEMAP_HEIGHT_CONE, CONEMAP_F16, 2, 4, 34, 83, 0x822f, 0x8227, 0x140b},
        {CONEMAP_HEIGHT_CONE, CONEMAP_UNORM16, 2, 4, 35, 77, 0x822c, 0x8227, 0x1403},
        {CONEMAP_HEIGHT_CONE, CONEMAP_UNORM8, 2, 2, 49, 16, 0x822b, 0x8227, 0x1401},
        {CONEMAP_DUMMER, CONEMAP_F32, 4, 16, 2, 109, 0x8814, 0x1908, 0x1406},
        {CONEMAP_DUMMER, CONEMAP_F16, 4, 8, 10, 97, 0x881a, 0x1908, 0x140b},
        {CONEMAP_DUMMER, CONEMAP_UNORM16, 4, 8, 11, 91, 0x805b, 0x1908, 0x1403},
        {CONEMAP_DUMMER, CONEMAP_UNORM8, 4, 4, 28, 37, 0x8058, 0x1908, 0x1401},
    };
    int k;
    for (k = 0; k < (int)(sizeof rows / sizeof rows[0]); ++k) {
        conemap_texture texture;
        conemap_format_numbers n;
        memset(&texture, 0, sizeof texture);
        texture.layout = rows[k].layout;
        texture.format = rows[k].format;
        if (!CHECK(conemap_get_format_numbers(&texture, &n) == CONEMAP_OK, "row %d", k)) continue;
        CHECK(n.channels == rows[k].channels && n.bytes == rows[k].bytes, "row %d: size", k);
        CHECK(n.dxgi == rows[k].dxgi, "row %d: dxgi %u, right %u", k, n.dxgi, rows[k].dxgi);
        CHECK(n.vulkan == rows[k].vulkan, "row %d: vulkan %u, right %u", k, n.vulkan, rows[k].vulkan);
        CHECK(n.gl_internal == rows[k].internal && n.gl_format == rows[k].external &&
                  n.gl_type == rows[k].type,
              "row %d: gl %x %x %x", k, n.gl_internal, n.gl_format, n.gl_type);
    }
}

const struct test_case formats_tests[] = {
    {"every value of every input format", every_value},
    {"strides", strides},
    {"depth maps", depths},
    {"cones are rounded down, by a step at most", cones_round_down},
    {"textures at any pitch", textures},
    {"decoding", decoding},
    {"baked bytes come back", baked_bytes},
    {"broken bytes", broken_bytes},
    {"load options", load_options},
    {"format numbers", format_numbers},
    {NULL, NULL},
};
