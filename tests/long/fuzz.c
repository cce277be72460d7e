/* Fuzz target (clang -fsanitize=fuzzer): the first byte chooses between baked bytes, as they are or with their checksums
   mended so that the checks behind those are reached, and a build with traces whose settings come from the data. */
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void trace_some(const conemap_map *map, const uint8_t *data, size_t size)
{
    conemap_trace_desc desc;
    conemap_ray ray;
    conemap_hit hit;
    conemap_sample sample;
    memset(&desc, 0, sizeof desc);
    while (size >= sizeof ray + 2) {
        desc.tracer = (conemap_tracer)(data[0] % 9);
        desc.refinement = (conemap_refinement)(data[1] % 4);
        desc.max_steps = 500;
        memcpy(&ray, data + 2, sizeof ray);
        (void)conemap_trace(map, &desc, &ray, &hit, 1);
        (void)conemap_sample_at(map, ray.origin[0], ray.origin[1], &sample);
        data += sizeof ray + 2;
        size -= sizeof ray + 2;
    }
}

/* The file header as conemap_save writes it; tests/formats.c fails if this is no longer its size. */
enum { HEADER = 100 };

static void mend_checksums(uint8_t *bytes, size_t size)
{
    uint64_t hash;
    if (size < HEADER) return;
    memcpy(bytes, conemap__file_magic, 8);
    conemap__put_word(bytes + 8, CONEMAP_VERSION);
    conemap__put_word(bytes + 12, HEADER);
    hash = conemap__hash_bytes(bytes + HEADER, size - HEADER);
    conemap__put_word(bytes + HEADER - 12, (uint32_t)hash);
    conemap__put_word(bytes + HEADER - 8, (uint32_t)(hash >> 32));
    conemap__put_word(bytes + HEADER - 4, (uint32_t)conemap__hash_bytes(bytes, HEADER - 4));
}

static void load(const uint8_t *data, size_t size, int mended)
{
    conemap_map map;
    conemap_desc desc;
    uint8_t *copy = (uint8_t *)malloc(size + 1); /* exact size, so that reading past it is seen */
    if (!copy) return;
    memset(&desc, 0, sizeof desc);
    desc.keep_pyramid = 1;
    memcpy(copy, data, size);
    if (mended) mend_checksums(copy, size);
    if (conemap_load(copy, size, &desc, &map) == CONEMAP_OK) {
        trace_some(&map, data, size);
        conemap_free(&map);
    }
    free(copy);
}

static void build(const uint8_t *data, size_t size)
{
    conemap_map map;
    conemap_desc desc;
    size_t pixels;
    if (size < 24) return;
    memset(&desc, 0, sizeof desc);
    desc.heights.width = data[0] % 9;
    desc.heights.height = data[1] % 9;
    desc.heights.format = (conemap_format)(data[2] % 5);
    desc.heights.is_depth = data[3] & 1;
    desc.wrap_u = (conemap_wrap)(data[4] % 4);
    desc.wrap_v = (conemap_wrap)(data[5] % 4);
    desc.texture.format = (conemap_format)(data[6] % 5);
    desc.texture.encoding = (conemap_encoding)(data[7] % 4);
    desc.texture.layout = (conemap_layout)(data[8] % 4);
    desc.generator = (conemap_generator)(data[9] % (CONEMAP_GENERATOR_COUNT + 1));
    desc.min3x3 = data[10] & 1;
    desc.ring_limit = data[11] % 5;
    desc.texture.sectors = data[10] >> 1 & 7 ? 0 : data[11] / 5 % 10;
    desc.keep_pyramid = 1;
    memcpy(&desc.aspect, data + 12, 4);
    memcpy(&desc.max_tan, data + 16, 4);
    memcpy(&desc.hybrid_weight, data + 20, 4);
    data += 24;
    size -= 24;
    pixels = (size_t)desc.heights.width * (size_t)desc.heights.height * 4;
    if (size < pixels) return;
    desc.heights.pixels = data;
    if (conemap_build(&desc, &map) != CONEMAP_OK) return;
    trace_some(&map, data + pixels, size - pixels);
    conemap_free(&map);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0) return 0;
    switch (data[0] % 3) {
    case 0: load(data + 1, size - 1, 0); break;
    case 1: load(data + 1, size - 1, 1); break;
    default: build(data + 1, size - 1); break;
    }
    return 0;
}
