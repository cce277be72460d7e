/* Writes what a cone map holds as pictures, and tells how its cones are spread. */
#include "common.h"
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"

static void print_help(void) {
    puts(
        "inspect FILE: pictures and histograms of a baked .cone file, or of a heightmap's cones\n\n"
        "Output\n"
        "  -o PREFIX               begins every file's name (out/NAME-)\n"
        "  --slope-gain G          slopes are drawn as 0.5 + G (dh per texel); 1 is what the dummer layout\n"
        "                          holds (so that the steepest but 0.1 % just fit)\n"
        "  --compare A B           build with generators A and B, and draw the difference of their cones in\n"
        "                          green, full where they are 1 / G apart\n"
        "  --gain G                of that green (1)");
    print_input_help();
    puts("  --heights FILE          the image of a .cone file that holds cones only");
    print_build_help();
    puts("Examples\n"
         "  inspect jacksboro.cone\n"
         "  inspect --procedural fbm 512 --generator ring -o fbm-\n"
         "  inspect jacksboro_403x344_16bit.pgm --compare ring quick --gain 2");
}

static unsigned char grey(double x) {
    return x > 0 ? x < 1 ? (unsigned char)(x * 255.0 + 0.5) : 255 : 0; /* also for NaN */
}

static int write_picture(const char *prefix, const char *name, const unsigned char *pixels, int width,
                         int height, int channels) {
    char path[1024];
    int length = snprintf(path, sizeof path, "%s%s.png", prefix, name);
    if (length < 0 || (size_t)length >= sizeof path) return fail("the name of a picture is too long");
    if (!png_write(path, pixels, width, height, channels)) return 0;
    puts(path);
    return 1;
}

#define BINS 64

static int draw_histogram(const char *prefix, const char *name, const unsigned long *bins) {
    enum { WIDTH = BINS * 8, HEIGHT = 256 };
    static unsigned char pixels[WIDTH * HEIGHT * 3];
    unsigned long most = 1;
    for (int i = 0; i < BINS; ++i)
        if (bins[i] > most) most = bins[i];
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x) {
            unsigned char *pixel = pixels + 3 * (y * WIDTH + x);
            double top = (double)bins[x / 8] / (double)most * (HEIGHT - 8);
            int filled = x % 8 != 7 && (HEIGHT - y) <= top;
            int line = x % (WIDTH / 4) == WIDTH / 4 - 1; /* the quarters */
            pixel[0] = filled ? 62 : line ? 205 : 246;
            pixel[1] = filled ? 105 : line ? 205 : 246;
            pixel[2] = filled ? 145 : line ? 205 : 246;
        }
    return write_picture(prefix, name, pixels, WIDTH, HEIGHT, 3);
}

/* Bins of 0..1; what is wider counts in the last. */
static void count_bins(const float *values, size_t count, unsigned long *bins) {
    memset(bins, 0, BINS * sizeof *bins);
    for (size_t i = 0; i < count; ++i) {
        float at = values[i] * BINS;
        ++bins[at > 0 ? at < BINS - 1 ? (int)at : BINS - 1 : 0];
    }
}

static void print_histogram(const char *name, const unsigned long *bins, size_t count) {
    unsigned long groups[16] = {0}, most = 1;
    for (int i = 0; i < BINS; ++i) groups[i * 16 / BINS] += bins[i];
    for (int i = 0; i < 16; ++i)
        if (groups[i] > most) most = groups[i];
    printf("%s\n", name);
    for (int i = 0; i < 16; ++i) {
        int length = (int)((double)groups[i] / (double)most * 50 + 0.5);
        printf("  %6.4f%c %6.2f %% %.*s\n", i / 16.0, i == 15 ? '+' : ' ',
               100.0 * (double)groups[i] / (double)count, length,
               "##################################################");
    }
}

static int compare_floats(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The factor that brings all values but the largest 0.1 % below `full`; 1 where they are zero. */
static float fitting_gain(const float *values, size_t count, float full) {
    float *sorted = (float *)malloc(count * sizeof *sorted), gain = 1;
    if (!sorted) return gain;
    memcpy(sorted, values, count * sizeof *sorted);
    qsort(sorted, count, sizeof *sorted, compare_floats);
    float large = sorted[count - 1 - count / 1000];
    free(sorted);
    return large > 0 ? full / large : gain;
}

static void print_spread(const char *name, const float *values, size_t count) {
    double sum = 0;
    float low = values[0], high = values[0];
    for (size_t i = 0; i < count; ++i) {
        sum += (double)values[i];
        if (values[i] < low) low = values[i];
        if (values[i] > high) high = values[i];
    }
    printf("%-10s min %.6g, mean %.6g, max %.6g\n", name, (double)low, sum / (double)count, (double)high);
}

/* The slopes as the library itself stores them: a map of the same heights in the dummer layout. Its cones are
   of no interest, so they come from the fastest generator. Returns width * height * 4 floats. */
static float *slopes_of(const conemap_map *map) {
    conemap_desc desc;
    conemap_map slopes;
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = map->heights;
    desc.heights.width = map->info.width;
    desc.heights.height = map->info.height;
    desc.wrap_u = map->info.wrap_u;
    desc.wrap_v = map->info.wrap_v;
    desc.texture.layout = CONEMAP_DUMMER;
    desc.texture.flip_dv = map->info.texture.flip_dv;
    desc.generator = CONEMAP_QUICK_NAIVE;
    conemap_result result = conemap_build(&desc, &slopes);
    float *texels = NULL;
    if (result == CONEMAP_OK) {
        size_t size = conemap_texture_size(&slopes, 0);
        texels = (float *)malloc(size);
        result = texels ? conemap_write_texture(&slopes, texels, size, 0) : CONEMAP_ERROR_MEMORY;
        conemap_free(&slopes);
    }
    if (result != CONEMAP_OK) {
        fail_result("the slopes cannot be had", result);
        free(texels);
        return NULL;
    }
    return texels;
}

static int draw_slopes(const conemap_map *map, const char *prefix, float gain, unsigned char *pixels,
                       float *values) {
    size_t count = (size_t)map->info.width * (size_t)map->info.height;
    float *texels = slopes_of(map);
    if (!texels) return 0;
    if (!(gain > 0)) {
        for (size_t i = 0; i < count; ++i) {
            float u = fabsf(texels[4 * i + 2] - 0.5f), v = fabsf(texels[4 * i + 3] - 0.5f);
            values[i] = u > v ? u : v;
        }
        gain = fitting_gain(values, count, 0.5f);
    }
    int good = 1;
    for (int axis = 0; axis < 2 && good; ++axis) {
        for (size_t i = 0; i < count; ++i)
            pixels[i] = grey(0.5 + (double)gain * ((double)texels[4 * i + 2 + (size_t)axis] - 0.5));
        good = write_picture(prefix, axis ? "dhdv" : "dhdu", pixels, map->info.width, map->info.height, 1);
    }
    if (good) printf("slopes     drawn as 0.5 + %.4g (dh per texel)\n", (double)gain);
    free(texels);
    return good;
}

static int inspect(const conemap_map *map, const char *prefix, float slope_gain) {
    const conemap_info *info = &map->info;
    size_t count = (size_t)info->width * (size_t)info->height;
    int sectors = info->texture.sectors > 1 ? info->texture.sectors : 1;
    size_t cones = count * (size_t)sectors;
    unsigned char *pixels = (unsigned char *)malloc(count);
    float *tans = (float *)malloc(cones * sizeof *tans), *roots = (float *)malloc(cones * sizeof *roots);
    unsigned long bins[BINS], root_bins[BINS];
    int good = pixels && tans && roots;
    if (!good) fail("too large for the memory at hand");
    if (good) {
        for (size_t i = 0; i < cones; ++i) {
            tans[i] = conemap_decode(info, map->heights[i % count], map->cones[i]);
            roots[i] = sqrtf(tans[i]);
        }
        for (size_t i = 0; i < count; ++i) pixels[i] = grey((double)map->heights[i]);
        good = write_picture(prefix, "height", pixels, info->width, info->height, 1);
    }
    for (int s = 0; s < sectors && good; ++s) { /* a sector's pictures end in its number */
        const float *tan = tans + (size_t)s * count, *root = roots + (size_t)s * count;
        char name[32], root_name[32];
        snprintf(name, sizeof name, sectors > 1 ? "tan-%d" : "tan", s);
        snprintf(root_name, sizeof root_name, sectors > 1 ? "sqrt-tan-%d" : "sqrt-tan", s);
        for (size_t i = 0; i < count; ++i) pixels[i] = grey((double)tan[i]);
        good = write_picture(prefix, name, pixels, info->width, info->height, 1);
        for (size_t i = 0; i < count; ++i) pixels[i] = grey((double)root[i]);
        good = good && write_picture(prefix, root_name, pixels, info->width, info->height, 1);
    }
    if (good) {
        count_bins(tans, cones, bins);
        count_bins(roots, cones, root_bins);
        good = draw_histogram(prefix, "histogram-tan", bins) &&
               draw_histogram(prefix, "histogram-sqrt-tan", root_bins);
    }
    if (good) {
        print_spread("height", map->heights, count);
        print_spread("tan", tans, cones);
        print_spread("sqrt(tan)", roots, cones);
        printf("min(tan,1) mean %.6f\n", mean_tan(map));
        print_histogram("tan", bins, cones);
        print_histogram("sqrt(tan)", root_bins, cones);
        good = draw_slopes(map, prefix, slope_gain, pixels, roots);
    }
    free(roots);
    free(tans);
    free(pixels);
    return good;
}

static int compare(const conemap_map *map, const conemap_desc *settings,
                   const conemap_generator generators[2], const char *prefix, float gain) {
    size_t count = (size_t)map->info.width * (size_t)map->info.height;
    conemap_map maps[2];
    double means[2], worst = 0;
    memset(maps, 0, sizeof maps);
    for (int k = 0; k < 2; ++k) {
        conemap_desc desc = *settings; /* the same heights, exactly as the map holds them */
        memset(&desc.heights, 0, sizeof desc.heights);
        desc.heights.pixels = map->heights;
        desc.heights.width = map->info.width;
        desc.heights.height = map->info.height;
        desc.wrap_u = map->info.wrap_u;
        desc.wrap_v = map->info.wrap_v;
        desc.aspect = map->info.aspect;
        desc.max_tan = map->info.max_tan;
        desc.texture = map->info.texture;
        desc.texture.layout = CONEMAP_HEIGHT_CONE;
        desc.texture.sectors = 0; /* which few generators know */
        desc.generator = generators[k];
        if (!build_with_progress(&desc, &maps[k], name_of(generator_names, (int)generators[k]))) {
            conemap_free(&maps[0]);
            return 0;
        }
        means[k] = mean_tan(&maps[k]);
    }
    size_t wider[2] = {0, 0};
    unsigned char *pixels = count <= (size_t)-1 / 3 ? (unsigned char *)calloc(count, 3) : NULL;
    float *differences = (float *)malloc(count * sizeof *differences);
    int good = pixels && differences;
    if (!good) fail("too large for the memory at hand");
    for (size_t i = 0; good && i < count; ++i) {
        double tan[2];
        for (int k = 0; k < 2; ++k) {
            tan[k] = (double)conemap_decode(&maps[k].info, maps[k].heights[i], maps[k].cones[i]);
            if (tan[k] > 1) tan[k] = 1;
        }
        differences[i] = (float)fabs(tan[0] - tan[1]);
        if ((double)differences[i] > worst) worst = (double)differences[i];
        wider[0] += tan[0] > tan[1];
        wider[1] += tan[1] > tan[0];
    }
    if (good && !(gain > 0)) gain = fitting_gain(differences, count, 1);
    for (size_t i = 0; good && i < count; ++i) pixels[3 * i + 1] = grey((double)(differences[i] * gain));
    const char *a = name_of(generator_names, (int)generators[0]),
               *b = name_of(generator_names, (int)generators[1]);
    char name[128];
    snprintf(name, sizeof name, "difference-%s-%s", a, b);
    good = good && write_picture(prefix, name, pixels, map->info.width, map->info.height, 3);
    if (good) {
        printf("%-20s mean min(tan, 1) %.6f, wider at %.3f %% of the texels\n", a, means[0],
               100.0 * (double)wider[0] / (double)count);
        printf("%-20s mean min(tan, 1) %.6f, wider at %.3f %% of the texels\n", b, means[1],
               100.0 * (double)wider[1] / (double)count);
        printf("green      full where %.4g apart\n", 1 / (double)gain);
        printf("ratio %s / %s %.4f, largest difference %.6f\n", b, a,
               means[0] > 0 ? means[1] / means[0] : 0.0, worst);
    }
    free(differences);
    free(pixels);
    conemap_free(&maps[0]);
    conemap_free(&maps[1]);
    return good;
}

int main(int argc, char **argv) {
    program_name = "inspect";
    struct args args = {argc, 0, argv, "", 0};
    struct map_options options = {0};
    const char *prefix = NULL;
    conemap_generator generators[2] = {CONEMAP_GENERATE_DEFAULT, CONEMAP_GENERATE_DEFAULT};
    int comparing = 0;
    float slope_gain = 0, gain = 0;
    char name[512];
    options.seed = 1;
    while (next_arg(&args)) {
        if (arg_is(&args, "--help") || arg_is(&args, "-h")) return print_help(), 0;
        if (arg_is(&args, "-o")) prefix = arg_text(&args);
        else if (arg_is(&args, "--slope-gain")) slope_gain = arg_float(&args, 1e-6, 1e9);
        else if (arg_is(&args, "--gain")) gain = arg_float(&args, 1e-6, 1e9);
        else if (arg_is(&args, "--compare")) {
            comparing = 1;
            generators[0] = (conemap_generator)arg_name(&args, generator_names);
            generators[1] = (conemap_generator)arg_name(&args, generator_names);
        } else if (!map_option(&args, &options)) arg_unknown(&args);
    }
    if (args.failed) return 1;

    conemap_map map;
    if (comparing && !options.desc.generator) options.desc.generator = CONEMAP_QUICK_NAIVE; /* thrown away */
    if (!map_open(&options, 0, &map)) return 1;
    if (!prefix) {
        const char *base = options.input ? options.input : name_of(procedural_names, options.procedural);
        for (const char *at = base; *at; ++at)
            if (*at == '/' || *at == '\\') base = at + 1;
        const char *dot = strrchr(base, '.');
        int length = dot && dot != base ? (int)(dot - base) : (int)strlen(base);
        snprintf(name, sizeof name, "out/%.*s-", length < 400 ? length : 400, base);
        prefix = name;
        make_directory("out");
    }
    int good = comparing ? compare(&map, &options.desc, generators, prefix, gain)
                         : inspect(&map, prefix, slope_gain);
    conemap_free(&map);
    return good ? 0 : 1;
}
