/* Bakes a heightmap into a cone map file, or into a bare texture. */
#include "common.h"
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"

static void print_help(void) {
    puts("bake INPUT -o OUT.cone: bake a heightmap into a cone map\n\n"
         "Output\n"
         "  -o FILE.cone            baked bytes for conemap_load\n"
         "  --raw FILE              the bare texture as well, or instead, for an upload as it is; with --sectors\n"
         "                          its textures one after the other\n"
         "  --pitch BYTES           of the bare texture: bytes from row to row (rows touch)\n"
         "  --info FILE.cone        tell what is in a baked file, and do nothing else\n"
         "  --verify                prove that no interpolated cone cuts the surface, and fail if one does;\n"
         "                          with a .cone file as INPUT (and --heights if it has none), nothing else");
    print_input_help();
    print_build_help();
    puts("Examples\n"
         "  bake jacksboro_403x344_16bit.pgm -o jacksboro.cone --generator ring --aspect square\n"
         "  bake --procedural bricks 1024 --wrap wrap --format unorm16 --encoding sqrt -o bricks.cone\n"
         "  bake terrain.r16 --layout cone --format unorm8 --raw terrain.bin --pitch 256\n"
         "  bake --verify jacksboro.cone\n"
         "  bake --info jacksboro.cone");
}

static int print_info(const char *path) {
    size_t size;
    unsigned char *bytes = read_file(path, &size);
    if (!bytes) return 0;
    conemap_info info;
    conemap_result result = conemap_load_info(bytes, size, &info);
    if (result != CONEMAP_OK) {
        free(bytes);
        return fail_result(path, result);
    }
    printf("size       %d x %d, %zu bytes\n", info.width, info.height, size);
    printf("wrap       u %s, v %s\n", name_of(wrap_names, (int)info.wrap_u),
           name_of(wrap_names, (int)info.wrap_v));
    printf("aspect     %g\n", (double)info.aspect);
    printf("generator  %s%s, guarantee %s\n", name_of(generator_names, (int)info.generator),
           info.min3x3 ? " with min3x3" : "", name_of(guarantee_names, (int)info.guarantee));
    printf("cones      up to tan %g, stored %s\n", (double)info.max_tan,
           name_of(encoding_names, (int)info.texture.encoding));
    printf("texture    %s, %s%s\n", name_of(layout_names, (int)info.texture.layout),
           name_of(format_names, (int)info.texture.format), info.texture.per_cell ? ", a cone for each cell" : "");
    if (info.texture.sectors > 1) printf("sectors    %d\n", info.texture.sectors);
    printf("heights    hash %08lx%08lx\n", (unsigned long)(info.height_hash >> 32),
           (unsigned long)(info.height_hash & 0xffffffffu));
    conemap_map map;
    result = conemap_load(bytes, size, NULL, &map);
    if (result == CONEMAP_OK) {
        printf("mean       %.6f of min(tan, 1)\n", mean_tan(&map));
        conemap_free(&map);
    } else if (result != CONEMAP_ERROR_NO_HEIGHTS) fail_result(path, result);
    free(bytes);
    return result == CONEMAP_OK || result == CONEMAP_ERROR_NO_HEIGHTS;
}

/* What is in the file must be what was built. */
static int check_file(const char *path, const unsigned char *bytes, size_t size) {
    size_t read_size;
    unsigned char *read = read_file(path, &read_size);
    if (!read) return 0;
    int same = read_size == size && memcmp(read, bytes, size) == 0;
    conemap_info info;
    conemap_result result = conemap_load_info(read, read_size, &info);
    free(read);
    if (!same) return fail("%s: the file does not hold what was written", path);
    return result == CONEMAP_OK ? 1 : fail_result(path, result);
}

static int write_cone(const conemap_map *map, const char *path, size_t *size) {
    *size = conemap_save_size(map);
    unsigned char *bytes = (unsigned char *)malloc(*size);
    if (!bytes) return fail("%s: too large for the memory at hand", path);
    conemap_result result = conemap_save(map, bytes, *size);
    int good = result == CONEMAP_OK ? write_file(path, bytes, *size) && check_file(path, bytes, *size)
                                    : fail_result(path, result);
    free(bytes);
    return good;
}

static int write_raw(const conemap_map *map, const char *path, size_t pitch, size_t *size) {
    *size = 0;
    for (int t = 0; t < conemap_texture_count(map); ++t) {
        size_t bytes = conemap_texture_size_at(map, t, pitch);
        if (!bytes) return fail("--pitch %zu is below a row's %zu bytes", pitch, conemap_row_size_at(map, t));
        if (bytes > SIZE_MAX - *size) return fail("%s: too large for the memory at hand", path);
        *size += bytes;
    }
    unsigned char *bytes = (unsigned char *)calloc(*size, 1), *next = bytes;
    if (!bytes) return fail("%s: too large for the memory at hand", path);
    conemap_result result = CONEMAP_OK;
    for (int t = 0; t < conemap_texture_count(map) && result == CONEMAP_OK; ++t) {
        size_t part = conemap_texture_size_at(map, t, pitch);
        result = conemap_write_texture_at(map, t, next, part, pitch);
        next += part;
    }
    int good = result == CONEMAP_OK ? write_file(path, bytes, *size) : fail_result(path, result);
    free(bytes);
    return good;
}

/* Prints what the verifier found; true if the map is safe. */
static int verify(const conemap_map *map) {
    conemap_report report;
    conemap_result result = conemap_verify(&map->info, map->heights, map->cones, NULL, &report);
    if (result != CONEMAP_OK) return fail_result("verify", result);
    printf("%zu of %zu cells have a cone that cuts the surface, %zu are unproven", report.unsafe, report.cells,
           report.unproven);
    if (report.unsafe)
        printf("; the deepest by %.3g of the height, over u %.5f v %.5f", report.worst, (double)report.u,
               (double)report.v);
    puts("");
    if (report.unsafe || report.unproven) return fail("the cones are not proven safe for bilinear sampling");
    return 1;
}

int main(int argc, char **argv) {
    program_name = "bake";
    struct args args = {argc, 0, argv, "", 0};
    struct map_options options = {0};
    const char *out = NULL, *raw = NULL, *info = NULL;
    size_t pitch = 0;
    int verifies = 0;
    options.seed = 1;
    while (next_arg(&args)) {
        if (arg_is(&args, "--help") || arg_is(&args, "-h")) return print_help(), 0;
        if (arg_is(&args, "-o")) out = arg_text(&args);
        else if (arg_is(&args, "--raw")) raw = arg_text(&args);
        else if (arg_is(&args, "--pitch")) pitch = (size_t)arg_int(&args, 1, INT_MAX);
        else if (arg_is(&args, "--info")) info = arg_text(&args);
        else if (arg_is(&args, "--verify")) verifies = 1;
        else if (arg_is(&args, "--depth")) options.desc.heights.is_depth = 1; /* short for --depth-map */
        else if (!map_option(&args, &options)) arg_unknown(&args);
    }
    if (args.failed) return 1;
    if (info) return print_info(info) ? 0 : 1;
    if (!options.input && !options.procedural)
        return fail("no input: name a file, or --procedural; see --help"), 1;
    if (options.input && has_extension(options.input, ".cone") && !verifies)
        return fail("%s is baked already; --info tells what is in it", options.input), 1;
    if (!out && !raw && !verifies) return fail("nowhere to write: give -o OUT.cone or --raw OUT.bin"), 1;
    if (pitch && !raw) return fail("--pitch is for the bare texture: give --raw OUT.bin"), 1;

    conemap_map map;
    double start = seconds();
    if (!map_open(&options, 0, &map)) return 1;
    double took = seconds() - start;
    size_t size = 0, raw_size = 0;
    int good = (!out || write_cone(&map, out, &size)) && (!raw || write_raw(&map, raw, pitch, &raw_size));
    if (good) {
        const conemap_texture *texture = &map.info.texture;
        printf("%d x %d, %s%s%s, %s %s %s, mean min(tan, 1) %.4f, %zu bytes, %.2f s\n", map.info.width,
               map.info.height, name_of(generator_names, (int)map.info.generator), map.info.min3x3 ? " min3x3" : "",
               texture->sectors > 1 ? texture->sectors == 4 ? " 4 sectors" : " 8 sectors" : "",
               name_of(layout_names, (int)texture->layout),
               name_of(format_names, (int)texture->format), name_of(encoding_names, (int)texture->encoding),
               mean_tan(&map), out ? size : raw ? raw_size : conemap_save_size(&map), took);
        if (out) puts(out);
        if (verifies) good = verify(&map);
        if (raw) {
            conemap_format_numbers numbers;
            puts(raw);
            for (int t = 0; t < conemap_texture_count(&map); ++t)
                if (conemap_get_format_numbers_at(texture, t, &numbers) == CONEMAP_OK)
                    printf("  row pitch %zu, %d channels, DXGI_FORMAT %u, VkFormat %u, GL 0x%04X 0x%04X 0x%04X\n",
                           pitch ? pitch : conemap_row_size_at(&map, t), numbers.channels, numbers.dxgi, numbers.vulkan,
                           numbers.gl_internal, numbers.gl_format, numbers.gl_type);
        }
    }
    conemap_free(&map);
    return good ? 0 : 1;
}
