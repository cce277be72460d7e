/* What the examples share: reading images, writing PNG, procedural maps, options and a progress bar.
   Include it before anything else; it brings conemap.h along. */
#ifndef EXAMPLES_COMMON_H
#define EXAMPLES_COMMON_H

#if (defined(__unix__) || defined(__APPLE__)) && !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 200112L /* isatty, fileno and mkdir under -std=c99 */
#endif
#ifdef _MSC_VER
#define _CRT_SECURE_NO_WARNINGS
#endif

#include "../conemap.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#if defined(__unix__) || defined(__APPLE__)
#include <sys/stat.h>
#include <unistd.h>
#elif defined(_WIN32)
#include <direct.h>
#include <io.h>
#endif

#ifdef HAVE_STB_IMAGE
#define STBI_NO_STDIO
#include <stb/stb_image.h>
#endif

#if defined(__GNUC__) || defined(__clang__)
#define EXAMPLE_UNUSED __attribute__((unused))
#define EXAMPLE_PRINTF __attribute__((unused, format(printf, 1, 2)))
#else
#define EXAMPLE_UNUSED
#define EXAMPLE_PRINTF
#endif

/* ---- messages ---------------------------------------------------------------------------------------- */

static const char *program_name = "example";

/* One line on stderr. Returns 0, so that `return fail(...)` reads well in functions that return success. */
static EXAMPLE_PRINTF int fail(const char *format, ...) {
    va_list list;
    va_start(list, format);
    fprintf(stderr, "%s: ", program_name);
    vfprintf(stderr, format, list);
    fputc('\n', stderr);
    va_end(list);
    return 0;
}

static EXAMPLE_UNUSED int fail_result(const char *what, conemap_result result) {
    return fail("%s: %s", what, conemap_result_string(result));
}

/* ---- names of the enums ------------------------------------------------------------------------------ */

struct name {
    const char *text;
    int value;
};

static const struct name generator_names[] = {{"exact", CONEMAP_EXACT},
                                              {"ring", CONEMAP_RING},
                                              {"quick-naive", CONEMAP_QUICK_NAIVE},
                                              {"quick", CONEMAP_QUICK},
                                              {"quick-naive-center", CONEMAP_QUICK_NAIVE_CENTER},
                                              {"quick-center", CONEMAP_QUICK_CENTER},
                                              {"relaxed-sampled", CONEMAP_RELAXED_SAMPLED},
                                              {"relaxed", CONEMAP_RELAXED},
                                              {"relaxed-exact", CONEMAP_RELAXED_EXACT},
                                              {"relaxed-exact-ring", CONEMAP_RELAXED_EXACT_RING},
                                              {"hybrid", CONEMAP_HYBRID},
                                              {"heights", CONEMAP_HEIGHTS},
                                              {NULL, 0}};
static const struct name tracer_names[] = {
    {"exact", CONEMAP_TRACE_EXACT},           {"linear", CONEMAP_TRACE_LINEAR},
    {"fixed", CONEMAP_TRACE_FIXED},           {"loop", CONEMAP_TRACE_LOOP},
    {"exact-step", CONEMAP_TRACE_EXACT_STEP}, {"cell-max", CONEMAP_TRACE_CELL_MAX},
    {"maxmip", CONEMAP_TRACE_MAXMIP},         {"qdm", CONEMAP_TRACE_QDM},
    {NULL, 0}};
static const struct name format_names[] = {{"f32", CONEMAP_F32},
                                           {"f16", CONEMAP_F16},
                                           {"unorm16", CONEMAP_UNORM16},
                                           {"unorm8", CONEMAP_UNORM8},
                                           {NULL, 0}};
static const struct name encoding_names[] = {
    {"linear", CONEMAP_LINEAR}, {"sqrt", CONEMAP_SQRT}, {"radius", CONEMAP_RADIUS}, {NULL, 0}};
static const struct name layout_names[] = {
    {"height-cone", CONEMAP_HEIGHT_CONE}, {"cone", CONEMAP_CONE_ONLY}, {"dummer", CONEMAP_DUMMER}, {NULL, 0}};
static const struct name wrap_names[] = {
    {"clamp", CONEMAP_CLAMP}, {"wrap", CONEMAP_WRAP}, {"nothing", CONEMAP_NOTHING}, {NULL, 0}};
static const struct name refinement_names[] = {{"none", CONEMAP_REFINE_NONE},
                                               {"secant", CONEMAP_REFINE_SECANT},
                                               {"bisect", CONEMAP_REFINE_BISECT},
                                               {NULL, 0}};
static const struct name guarantee_names[] = {{"none", CONEMAP_GUARANTEE_NONE},
                                              {"vertex", CONEMAP_GUARANTEE_VERTEX},
                                              {"bilinear", CONEMAP_GUARANTEE_BILINEAR},
                                              {"relaxed", CONEMAP_GUARANTEE_RELAXED},
                                              {"relaxed-bilinear", CONEMAP_GUARANTEE_RELAXED_BILINEAR},
                                              {NULL, 0}};

static EXAMPLE_UNUSED const char *name_of(const struct name *names, int value) {
    for (; names->text; ++names)
        if (names->value == value) return names->text;
    return "default";
}

/* The tables above that a program has no use for would warn otherwise. */
static EXAMPLE_UNUSED const struct name *const all_names[] = {generator_names,  tracer_names,   format_names,
                                                              encoding_names,   layout_names,   wrap_names,
                                                              refinement_names, guarantee_names};

/* ---- options ----------------------------------------------------------------------------------------- */

struct args {
    int count, at;
    char **list;
    const char *option; /* the option that values are being taken for */
    int failed;         /* sticky: parsing stops, and the one line about it has been written */
};

static EXAMPLE_UNUSED int next_arg(struct args *args) {
    if (args->failed || ++args->at >= args->count) return 0;
    args->option = args->list[args->at];
    return 1;
}

static EXAMPLE_UNUSED int arg_is(const struct args *args, const char *name) {
    return strcmp(args->list[args->at], name) == 0;
}

/* The value after the option; never null, empty once parsing has failed. */
static EXAMPLE_UNUSED const char *arg_text(struct args *args) {
    if (args->failed) return "";
    if (args->at + 1 >= args->count || strncmp(args->list[args->at + 1], "--", 2) == 0) {
        fail("%s needs more after it; see --help", args->option);
        args->failed = 1;
        return "";
    }
    return args->list[++args->at];
}

static EXAMPLE_UNUSED int arg_int(struct args *args, long low, long high) {
    const char *name = args->option, *text = arg_text(args);
    if (args->failed) return 0;
    char *end;
    errno = 0;
    long value = strtol(text, &end, 10);
    if (end == text || *end || errno || value < low || value > high) {
        fail("%s needs a whole number from %ld to %ld, not '%s'", name, low, high, text);
        args->failed = 1;
        return 0;
    }
    return (int)value;
}

static EXAMPLE_UNUSED float arg_float(struct args *args, double low, double high) {
    const char *name = args->option, *text = arg_text(args);
    if (args->failed) return 0;
    char *end;
    double value = strtod(text, &end);
    if (end == text || *end || !(value >= low && value <= high)) {
        fail("%s needs a number from %g to %g, not '%s'", name, low, high, text);
        args->failed = 1;
        return 0;
    }
    return (float)value;
}

/* WxH */
static EXAMPLE_UNUSED void arg_size(struct args *args, long most, int *width, int *height) {
    const char *name = args->option, *text = arg_text(args);
    if (args->failed) return;
    char *end, *end_height = NULL;
    errno = 0;
    long w = strtol(text, &end, 10), h = 0;
    if (end != text && *end == 'x') h = strtol(end + 1, &end_height, 10);
    if (!end_height || *end_height || errno || w < 1 || h < 1 || w > most || h > most) {
        fail("%s needs a size such as 640x480, at most %ld each way, not '%s'", name, most, text);
        args->failed = 1;
        return;
    }
    *width = (int)w;
    *height = (int)h;
}

static EXAMPLE_UNUSED int arg_name(struct args *args, const struct name *names) {
    const char *option = args->option, *text = arg_text(args);
    if (args->failed) return 0;
    for (const struct name *at = names; at->text; ++at)
        if (strcmp(at->text, text) == 0) return at->value;
    fprintf(stderr, "%s: %s does not know '%s'; it takes", program_name, option, text);
    for (const struct name *at = names; at->text; ++at)
        fprintf(stderr, "%s %s", at == names ? "" : ",", at->text);
    fputc('\n', stderr);
    args->failed = 1;
    return 0;
}

static EXAMPLE_UNUSED void arg_unknown(struct args *args) {
    if (!args->failed) fail("unknown option '%s'; see --help", args->list[args->at]);
    args->failed = 1;
}

/* ---- files ------------------------------------------------------------------------------------------- */

/* The whole file, or null after one line on stderr. */
static EXAMPLE_UNUSED unsigned char *read_file(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    if (!file) {
        fail("%s: %s", path, strerror(errno));
        return NULL;
    }
    unsigned char *bytes = NULL;
    size_t used = 0, room = 0;
    for (;;) {
        if (used == room) {
            size_t larger = room ? room * 2 : 65536;
            unsigned char *moved = larger > room ? (unsigned char *)realloc(bytes, larger) : NULL;
            if (!moved) {
                fail("%s: too large for the memory at hand", path);
                break;
            }
            bytes = moved;
            room = larger;
        }
        size_t got = fread(bytes + used, 1, room - used, file);
        used += got;
        if (got) continue;
        if (ferror(file)) fail("%s: %s", path, strerror(errno));
        else if (!used) fail("%s: the file is empty", path);
        else {
            fclose(file);
            *size = used;
            return bytes;
        }
        break;
    }
    fclose(file);
    free(bytes);
    return NULL;
}

static EXAMPLE_UNUSED int write_file(const char *path, const void *bytes, size_t size) {
    FILE *file = fopen(path, "wb");
    if (!file) return fail("%s: %s", path, strerror(errno));
    int written = fwrite(bytes, 1, size, file) == size;
    written = fclose(file) == 0 && written;
    if (written) return 1;
    return fail("%s: %s; what is there is incomplete", path, strerror(errno));
}

static EXAMPLE_UNUSED void make_directory(const char *path) {
#if defined(__unix__) || defined(__APPLE__)
    (void)mkdir(path, 0777);
#elif defined(_WIN32)
    (void)_mkdir(path);
#else
    (void)path;
#endif
}

static EXAMPLE_UNUSED int has_extension(const char *path, const char *extension) {
    size_t length = strlen(path), tail = strlen(extension);
    if (length < tail) return 0;
    for (size_t i = 0; i < tail; ++i) {
        char c = path[length - tail + i];
        if (c >= 'A' && c <= 'Z') c = (char)(c - 'A' + 'a');
        if (c != extension[i]) return 0;
    }
    return 1;
}

/* ---- images in --------------------------------------------------------------------------------------- */

struct image {
    int width, height;
    conemap_format format; /* F32, UNORM16 or UNORM8; rows touch, row 0 is the top */
    void *pixels;
};

struct image_options {
    int normalize;             /* stretch the lowest..highest value to 0..1 */
    int raw_width, raw_height; /* of .r16 and .r32f files; 0: they are square */
};

static EXAMPLE_UNUSED void image_free(struct image *image) {
    free(image->pixels);
    memset(image, 0, sizeof *image);
}

static EXAMPLE_UNUSED size_t image_texel_size(conemap_format format) {
    return format == CONEMAP_F32 ? 4 : format == CONEMAP_UNORM16 ? 2 : 1;
}

/* Luma with weights that add up to one exactly, so that grey stays grey. */
static EXAMPLE_UNUSED unsigned luma(unsigned red, unsigned green, unsigned blue) {
    return (13933u * red + 46871u * green + 4732u * blue + 32768u) >> 16;
}

struct cursor {
    const unsigned char *at, *end;
};

static void skip_space(struct cursor *in) {
    while (in->at < in->end) {
        unsigned char c = *in->at;
        if (c == '#')
            while (in->at < in->end && *in->at != '\n') ++in->at;
        else if (c == ' ' || (c >= '\t' && c <= '\r')) ++in->at;
        else break;
    }
}

/* A whole number; past the largest that fits a header it stays there. Returns 0 where there is none. */
static int read_number(struct cursor *in, uint32_t *value) {
    skip_space(in);
    const unsigned char *start = in->at;
    uint32_t sum = 0;
    for (; in->at < in->end && *in->at >= '0' && *in->at <= '9'; ++in->at)
        sum = sum > 99999999u ? 999999999u : sum * 10u + (uint32_t)(*in->at - '0');
    *value = sum;
    return in->at != start;
}

/* Width and height from a header, and memory for that many texels, but only if the file is long enough to
   fill them: `least` is the fewest bytes that can stand for one texel. */
static int image_reserve(struct image *image, const char *path, uint32_t width, uint32_t height,
                         conemap_format format, size_t least, size_t left) {
    if (width < 1 || height < 1 || width > CONEMAP_MAX_SIZE || height > CONEMAP_MAX_SIZE)
        return fail("%s: %lu x %lu texels; from 1 to %d each way can be read", path, (unsigned long)width,
                    (unsigned long)height, CONEMAP_MAX_SIZE);
    if (left / least / width < height)
        return fail("%s: the file is truncated: %lu x %lu texels do not fit in it", path,
                    (unsigned long)width, (unsigned long)height);
    size_t texel = image_texel_size(format);
    if ((size_t)-1 / texel / width < height) return fail("%s: too large for the memory at hand", path);
    image->width = (int)width;
    image->height = (int)height;
    image->format = format;
    image->pixels = malloc((size_t)width * height * texel);
    return image->pixels ? 1 : fail("%s: too large for the memory at hand", path);
}

/* P2, P3, P5 and P6: any maxval. Only 255 stays at 8 bits; others are scaled to 16. */
static int read_pnm(struct image *image, const char *path, const unsigned char *bytes, size_t size) {
    struct cursor in = {bytes + 2, bytes + size};
    int plain = bytes[1] == '2' || bytes[1] == '3', color = bytes[1] == '3' || bytes[1] == '6';
    uint32_t width, height, maxval;
    if (!read_number(&in, &width) || !read_number(&in, &height) || !read_number(&in, &maxval))
        return fail("%s: the header of this P%c file is broken or cut short", path, bytes[1]);
    if (maxval < 1 || maxval > 65535)
        return fail("%s: maxval is %lu; 1 to 65535 can be", path, (unsigned long)maxval);
    if (!plain && in.at < in.end) ++in.at; /* exactly one white space before the texels */

    size_t channels = color ? 3 : 1, bytes_each = maxval > 255 ? 2 : 1;
    if (!image_reserve(image, path, width, height, maxval == 255 ? CONEMAP_UNORM8 : CONEMAP_UNORM16,
                       plain ? channels * 2 - 1 : channels * bytes_each, (size_t)(in.end - in.at)))
        return 0;
    size_t count = (size_t)width * height;
    for (size_t i = 0; i < count; ++i) {
        uint32_t value[3] = {0, 0, 0};
        for (size_t c = 0; c < channels; ++c) {
            if (plain) {
                if (!read_number(&in, &value[c])) {
                    skip_space(&in);
                    return in.at == in.end ? fail("%s: the file is truncated", path)
                                           : fail("%s: a texel is not a number", path);
                }
            } else {
                value[c] = bytes_each == 2 ? (uint32_t)in.at[0] << 8 | in.at[1] : in.at[0];
                in.at += bytes_each;
            }
            if (value[c] > maxval) return fail("%s: a texel is above the header's maxval", path);
        }
        uint32_t scaled[3];
        for (size_t c = 0; c < channels; ++c)
            scaled[c] = maxval == 255 ? value[c] : (value[c] * 65535u + maxval / 2) / maxval;
        uint32_t grey = color ? luma(scaled[0], scaled[1], scaled[2]) : scaled[0];
        if (maxval == 255) ((uint8_t *)image->pixels)[i] = (uint8_t)grey;
        else ((uint16_t *)image->pixels)[i] = (uint16_t)grey;
    }
    return 1;
}

static float read_float(const unsigned char *at, int big_endian) {
    uint32_t bits = 0;
    for (int i = 0; i < 4; ++i) bits |= (uint32_t)at[i] << 8 * (big_endian ? 3 - i : i);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* PFM: the sign of the scale tells the byte order; its size is a unit that heights have no use for. */
static int read_pfm(struct image *image, const char *path, const unsigned char *bytes, size_t size) {
    struct cursor in = {bytes + 2, bytes + size};
    int channels = bytes[1] == 'F' ? 3 : 1;
    uint32_t width, height;
    int whole = read_number(&in, &width) && read_number(&in, &height);
    skip_space(&in);
    char text[32];
    size_t length = 0;
    while (in.at<in.end && * in.at> ' ' && length + 1 < sizeof text) text[length++] = (char)*in.at++;
    text[length] = 0;
    char *end;
    double scale = strtod(text, &end);
    if (!whole || end == text || *end || !(scale < 0 || scale > 0) || in.at == in.end)
        return fail("%s: the header of this PFM file is broken or cut short", path);
    ++in.at;
    if (!image_reserve(image, path, width, height, CONEMAP_F32, 4 * (size_t)channels,
                       (size_t)(in.end - in.at)))
        return 0;
    for (uint32_t row = height; row-- > 0;) { /* the bottom row comes first */
        float *out = (float *)image->pixels + (size_t)row * width;
        for (uint32_t i = 0; i < width; ++i, in.at += 4 * channels) {
            float value[3];
            for (int c = 0; c < channels; ++c) value[c] = read_float(in.at + 4 * c, scale > 0);
            out[i] = value[0];
            if (channels == 3 && (value[1] < value[0] || value[1] > value[0] || value[2] < value[0] ||
                                  value[2] > value[0] || value[1] != value[1] || value[2] != value[2]))
                out[i] = 0.2126f * value[0] + 0.7152f * value[1] + 0.0722f * value[2];
        }
    }
    return 1;
}

/* Bare little-endian texels, 16-bit or float. */
static int read_raw(struct image *image, const char *path, const unsigned char *bytes, size_t size,
                    int is_float, const struct image_options *options) {
    size_t texel = is_float ? 4 : 2, count = size / texel;
    uint32_t width = (uint32_t)options->raw_width, height = (uint32_t)options->raw_height;
    if (!width) {
        while (width <= CONEMAP_MAX_SIZE && (size_t)width * width < count) ++width;
        height = width;
        if ((size_t)width * width * texel != size)
            return fail("%s: %zu bytes are no square of %zu-byte texels; give --raw-size WxH", path, size,
                        texel);
    } else if (size % texel || count / width < height || (size_t)width * height != count)
        return fail("%s: %zu bytes are not the %lu x %lu texels of --raw-size", path, size,
                    (unsigned long)width, (unsigned long)height);
    if (!image_reserve(image, path, width, height, is_float ? CONEMAP_F32 : CONEMAP_UNORM16, texel, size))
        return 0;
    for (size_t i = 0; i < count; ++i)
        if (is_float) ((float *)image->pixels)[i] = read_float(bytes + 4 * i, 0);
        else ((uint16_t *)image->pixels)[i] = (uint16_t)(bytes[2 * i] | bytes[2 * i + 1] << 8);
    return 1;
}

#ifdef HAVE_STB_IMAGE
static int read_stb(struct image *image, const char *path, const unsigned char *bytes, size_t size) {
    int width, height, channels;
    if (size > INT_MAX) return fail("%s: the file is too large", path);
    int length = (int)size;
    if (!stbi_info_from_memory(bytes, length, &width, &height, &channels))
        return fail("%s: not an image that can be read (%s)", path, stbi_failure_reason());
    image->format = stbi_is_hdr_from_memory(bytes, length)      ? CONEMAP_F32
                    : stbi_is_16_bit_from_memory(bytes, length) ? CONEMAP_UNORM16
                                                                : CONEMAP_UNORM8;
    /* The pixels are copied to the examples' own memory: stb_image's may come from another allocator. */
    if (!image_reserve(image, path, width > 0 ? (uint32_t)width : 0, height > 0 ? (uint32_t)height : 0,
                       image->format, 1, (size_t)-1))
        return 0;
    void *pixels = image->format == CONEMAP_F32
                       ? (void *)stbi_loadf_from_memory(bytes, length, &width, &height, &channels, 1)
                   : image->format == CONEMAP_UNORM16
                       ? (void *)stbi_load_16_from_memory(bytes, length, &width, &height, &channels, 1)
                       : (void *)stbi_load_from_memory(bytes, length, &width, &height, &channels, 1);
    if (!pixels) return fail("%s: the image is damaged (%s)", path, stbi_failure_reason());
    int same = width == image->width && height == image->height;
    if (same) memcpy(image->pixels, pixels, (size_t)width * (size_t)height * image_texel_size(image->format));
    stbi_image_free(pixels);
    return same ? 1 : fail("%s: the image contradicts its own header", path);
}
#endif

/* Floats must be heights; with `normalize` every format is stretched to 0..1. */
static int image_range(struct image *image, const char *path, int normalize) {
    size_t count = (size_t)image->width * (size_t)image->height;
    if (image->format != CONEMAP_F32 && !normalize) return 1;
    if (image->format != CONEMAP_F32) {
        float *floats = count <= (size_t)-1 / 4 ? (float *)malloc(count * 4) : NULL;
        if (!floats) return fail("%s: too large for the memory at hand", path);
        for (size_t i = 0; i < count; ++i)
            floats[i] = image->format == CONEMAP_UNORM16 ? (float)((const uint16_t *)image->pixels)[i]
                                                         : (float)((const uint8_t *)image->pixels)[i];
        free(image->pixels);
        image->pixels = floats;
        image->format = CONEMAP_F32;
    }
    float *pixels = (float *)image->pixels;
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (size_t i = 0; i < count; ++i) {
        if (!(pixels[i] - pixels[i] >= 0)) return fail("%s: a value is NaN or infinite", path);
        if (pixels[i] < low) low = pixels[i];
        if (pixels[i] > high) high = pixels[i];
    }
    if (normalize) {
        for (size_t i = 0; i < count; ++i)
            pixels[i] = high > low ? (float)(((double)pixels[i] - low) / (high - low)) : 0.0f;
        return 1;
    }
    if (low < 0 || high > 1)
        return fail("%s: values run from %g to %g, heights from 0 to 1; --normalize stretches them", path,
                    low, high);
    return 1;
}

/* Reads an image from bytes; on failure one line has been written and *image is zeroed. */
static EXAMPLE_UNUSED int image_decode(const char *path, const unsigned char *bytes, size_t size,
                                       const struct image_options *options, struct image *image) {
    int good;
    memset(image, 0, sizeof *image);
    if (has_extension(path, ".r16")) good = read_raw(image, path, bytes, size, 0, options);
    else if (has_extension(path, ".r32f")) good = read_raw(image, path, bytes, size, 1, options);
    else if (size > 2 && bytes[0] == 'P' && strchr("2356", bytes[1]) && bytes[1])
        good = read_pnm(image, path, bytes, size);
    else if (size > 2 && bytes[0] == 'P' && (bytes[1] == 'f' || bytes[1] == 'F'))
        good = read_pfm(image, path, bytes, size);
    else if (size > 2 && bytes[0] == 'P' && (bytes[1] == '1' || bytes[1] == '4'))
        good = fail("%s: a P%c bitmap holds no heights", path, bytes[1]);
    else {
#ifdef HAVE_STB_IMAGE
        good = read_stb(image, path, bytes, size);
#else
        good =
            fail("%s: PNG, JPG, TGA and HDR need stb_image.h at build time; this build reads PGM, PPM, PFM, "
                 "r16 and r32f",
                 path);
#endif
    }
    good = good && image_range(image, path, options->normalize);
    if (!good) image_free(image);
    return good;
}

static EXAMPLE_UNUSED int image_read(const char *path, const struct image_options *options,
                                     struct image *image) {
    size_t size;
    memset(image, 0, sizeof *image);
    unsigned char *bytes = read_file(path, &size);
    int good = bytes && image_decode(path, bytes, size, options, image);
    free(bytes);
    return good;
}

/* ---- PNG out ----------------------------------------------------------------------------------------- */

struct bits {
    unsigned char *at;
    uint32_t held;
    int count;
};

static void put_bits(struct bits *out, uint32_t value, int count) {
    out->held |= value << out->count;
    for (out->count += count; out->count >= 8; out->count -= 8, out->held >>= 8)
        *out->at++ = (unsigned char)(out->held & 255u);
}

/* Huffman codes go out with their highest bit first, unlike all other numbers in deflate. */
static void put_code(struct bits *out, uint32_t code, int count) {
    uint32_t turned = 0;
    for (int i = 0; i < count; ++i) turned |= (code >> i & 1u) << (count - 1 - i);
    put_bits(out, turned, count);
}

static void put_symbol(struct bits *out, uint32_t symbol) {
    if (symbol < 144) put_code(out, 0x30 + symbol, 8);
    else if (symbol < 256) put_code(out, 0x190 + symbol - 144, 9);
    else if (symbol < 280) put_code(out, symbol - 256, 7);
    else put_code(out, 0xc0 + symbol - 280, 8);
}

static int top_bit(uint32_t value) {
    int bit = 0;
    while (value >>= 1) ++bit;
    return bit;
}

static void put_match(struct bits *out, uint32_t length, uint32_t distance) {
    uint32_t l = length - 3, d = distance - 1;
    if (length == 258) put_symbol(out, 285);
    else if (l < 8) put_symbol(out, 257 + l);
    else {
        int extra = top_bit(l) - 2;
        put_symbol(out, 257 + 4 * (uint32_t)(extra + 1) + (l >> extra & 3u));
        put_bits(out, l & ((1u << extra) - 1), extra);
    }
    if (d < 4) put_code(out, d, 5);
    else {
        int extra = top_bit(d) - 1;
        put_code(out, 2 * (uint32_t)(extra + 1) + (d >> extra & 1u), 5);
        put_bits(out, d & ((1u << extra) - 1), extra);
    }
}

/* A zlib stream of one block with the fixed codes; of earlier text it knows the last place of every 3-byte
   hash. `out` has room for 9 / 8 of the size and 16 bytes more: no literal takes over 9 bits, and no match
   takes more than the literals it replaces. */
static size_t zlib_pack(const unsigned char *in, size_t size, unsigned char *out) {
    struct bits bits = {out, 0, 0};
    static size_t last[8192]; /* position + 1 */
    memset(last, 0, sizeof last);
    put_bits(&bits, 0x0178, 16);
    put_bits(&bits, 1 | 1 << 1, 3);
    for (size_t i = 0; i < size;) {
        size_t length = 0, from = 0;
        if (i + 3 <= size) {
            uint32_t hash =
                ((uint32_t)in[i] << 16 | (uint32_t)in[i + 1] << 8 | in[i + 2]) * 2654435761u >> 19;
            from = last[hash];
            last[hash] = i + 1;
            if (from && i + 1 - from <= 32768)
                while (length < 258 && i + length < size && in[from - 1 + length] == in[i + length]) ++length;
        }
        if (length >= 4) { /* a match of 3 can cost more bits than its literals */
            put_match(&bits, (uint32_t)length, (uint32_t)(i + 1 - from));
            i += length;
        } else put_symbol(&bits, in[i++]);
    }
    put_symbol(&bits, 256);
    if (bits.count) put_bits(&bits, 0, 8 - bits.count);
    uint32_t a = 1, b = 0;
    for (size_t i = 0; i < size; ++i) {
        a = (a + in[i]) % 65521u;
        b = (b + a) % 65521u;
    }
    for (int shift = 24; shift >= 0; shift -= 8) *bits.at++ = (unsigned char)((b << 16 | a) >> shift & 255u);
    return (size_t)(bits.at - out);
}

static int png_chunk(FILE *file, const char *kind, const unsigned char *data, size_t size) {
    unsigned char head[8], tail[4];
    for (int i = 0; i < 4; ++i) head[i] = (unsigned char)(size >> (24 - 8 * i) & 255u);
    memcpy(head + 4, kind, 4);
    uint32_t table[256], crc = 0xffffffffu;
    for (uint32_t n = 0; n < 256; ++n) {
        table[n] = n;
        for (int k = 0; k < 8; ++k) table[n] = table[n] & 1u ? 0xedb88320u ^ table[n] >> 1 : table[n] >> 1;
    }
    for (size_t i = 4; i < 8; ++i) crc = table[(crc ^ head[i]) & 255u] ^ crc >> 8;
    for (size_t i = 0; i < size; ++i) crc = table[(crc ^ data[i]) & 255u] ^ crc >> 8;
    crc = ~crc;
    for (int i = 0; i < 4; ++i) tail[i] = (unsigned char)(crc >> (24 - 8 * i) & 255u);
    return fwrite(head, 1, 8, file) == 8 && (!size || fwrite(data, 1, size, file) == size) &&
           fwrite(tail, 1, 4, file) == 4;
}

/* 8-bit grey (1 channel) or RGB (3), rows touching, top row first. */
static EXAMPLE_UNUSED int png_write(const char *path, const unsigned char *pixels, int width, int height,
                                    int channels) {
    size_t row = (size_t)width * (size_t)channels;
    if ((size_t)0x70000000 / (row + 1) < (size_t)height)
        return fail("%s: too large a picture for this writer", path);
    size_t size = (row + 1) * (size_t)height;
    unsigned char *plain = (unsigned char *)malloc(size),
                  *packed = (unsigned char *)malloc(size + size / 8 + 64);
    if (!plain || !packed) {
        free(plain);
        free(packed);
        return fail("%s: too large for the memory at hand", path);
    }
    for (size_t y = 0; y < (size_t)height; ++y) {
        plain[y * (row + 1)] = 0; /* row filter: none */
        memcpy(plain + y * (row + 1) + 1, pixels + y * row, row);
    }
    size_t packed_size = zlib_pack(plain, size, packed);
    free(plain);

    unsigned char head[13] = {0};
    for (int i = 0; i < 4; ++i) {
        head[i] = (unsigned char)(width >> (24 - 8 * i) & 255);
        head[4 + i] = (unsigned char)(height >> (24 - 8 * i) & 255);
    }
    head[8] = 8;
    head[9] = channels == 3 ? 2 : 0;
    static const unsigned char signature[8] = {137, 'P', 'N', 'G', 13, 10, 26, 10};
    FILE *file = fopen(path, "wb");
    if (!file) {
        free(packed);
        return fail("%s: %s", path, strerror(errno));
    }
    int good = fwrite(signature, 1, 8, file) == 8 && png_chunk(file, "IHDR", head, 13) &&
               png_chunk(file, "IDAT", packed, packed_size) && png_chunk(file, "IEND", NULL, 0);
    free(packed);
    good = fclose(file) == 0 && good;
    if (good) return 1;
    return fail("%s: %s; what is there is incomplete", path, strerror(errno));
}

/* ---- progress ---------------------------------------------------------------------------------------- */

struct progress {
    const char *what;
    int percent, visible;
};

static EXAMPLE_UNUSED void progress_begin(struct progress *progress, const char *what) {
    progress->what = what;
    progress->percent = -1;
#if defined(__unix__) || defined(__APPLE__)
    progress->visible = isatty(fileno(stderr));
#elif defined(_WIN32)
    progress->visible = _isatty(_fileno(stderr));
#else
    progress->visible = 0;
#endif
}

/* Fits conemap_desc.progress. Never cancels. */
static EXAMPLE_UNUSED int progress_show(double done, void *user) {
    struct progress *progress = (struct progress *)user;
    int percent = (int)(done * 100.0);
    if (!progress->visible || percent <= progress->percent) return 0;
    progress->percent = percent;
    int full = percent * 30 / 100;
    fprintf(stderr, "\r%s [%.*s%*s] %3d%%", progress->what, full, "##############################", 30 - full,
            "", percent);
    fflush(stderr);
    return 0;
}

static EXAMPLE_UNUSED void progress_end(struct progress *progress) {
    if (progress->visible && progress->percent >= 0) fprintf(stderr, "\r%60s\r", "");
    progress->percent = -1;
}

/* ---- procedural maps --------------------------------------------------------------------------------- */

enum { FBM = 1, BRICKS, SPIKES, WHITE };
static const struct name procedural_names[] = {
    {"fbm", FBM}, {"bricks", BRICKS}, {"spikes", SPIKES}, {"white", WHITE}, {NULL, 0}};

static uint32_t hash3(uint32_t x, uint32_t y, uint32_t seed) {
    uint32_t h = x * 0x9e3779b1u ^ (y * 0x85ebca77u + 0x165667b1u) ^ (seed * 0xc2b2ae3du);
    for (int i = 0; i < 2; ++i) {
        h ^= h >> 15;
        h *= 0x2c1b3c6du;
        h ^= h >> 13;
        h *= 0x297a2d39u;
    }
    return h ^ h >> 16;
}

/* Value noise with `cells` cells along the period, 0..65535, in whole numbers: the same on every machine. */
static uint32_t value_noise(uint32_t i, uint32_t j, uint32_t size, uint32_t cells, uint32_t seed) {
    uint64_t position[2] = {(uint64_t)i * cells * 65536u / size, (uint64_t)j * cells * 65536u / size};
    uint32_t cell[2], next[2];
    uint64_t weight[2];
    for (int k = 0; k < 2; ++k) {
        uint64_t part = position[k] & 65535u;
        cell[k] = (uint32_t)(position[k] >> 16) % cells;
        next[k] = (cell[k] + 1) % cells;
        weight[k] = part * part * (3u * 65536u - 2u * part) >> 32;
    }
    uint64_t a = hash3(cell[0], cell[1], seed) >> 16, b = hash3(next[0], cell[1], seed) >> 16;
    uint64_t c = hash3(cell[0], next[1], seed) >> 16, d = hash3(next[0], next[1], seed) >> 16;
    uint64_t top = a * (65536u - weight[0]) + b * weight[0],
             bottom = c * (65536u - weight[0]) + d * weight[0];
    return (uint32_t)((top * (65536u - weight[1]) + bottom * weight[1]) >> 32);
}

/* Octaves from 4 cells across to 2 texels a cell, each of half the height. */
static uint32_t fbm_at(uint32_t i, uint32_t j, uint32_t size, uint32_t seed) {
    uint32_t sum = 0, octave = 0;
    for (uint32_t cells = 4; octave < 12 && (octave == 0 || cells <= size / 2); cells *= 2, ++octave)
        sum += value_noise(i, j, size, cells, seed + octave) >> octave;
    return sum;
}

/* Eight courses of four bricks, each a little higher or lower, with bevelled edges and rough faces. */
static uint32_t bricks_at(uint32_t i, uint32_t j, uint32_t size, uint32_t seed) {
    uint32_t y = (uint32_t)((uint64_t)j * 8u * 65536u / size), course = y >> 16;
    uint32_t x = (uint32_t)(((uint64_t)i * 4u * 65536u / size + (course & 1u) * 32768u) % (4u * 65536u));
    uint32_t brick = x >> 16;
    uint32_t across = (x & 65535u) * 2, down = y & 65535u; /* in the brick, the course's height being 65536 */
    uint32_t edge = across < 131072 - across ? across : 131072 - across;
    if (down < edge) edge = down;
    if (65536 - down < edge) edge = 65536 - down;
    uint32_t top = 50000 + hash3(brick, course, seed) % 12000u, mortar = 12000;
    uint32_t rough = value_noise(i, j, size, 64, seed + 1) >> 5;
    if (edge < 4000) return mortar + rough;
    if (edge >= 9000) return top + rough;
    return mortar + rough + (uint32_t)((uint64_t)(top - mortar) * (edge - 4000) / 5000);
}

/* A tileable square map of 16 bits. */
static EXAMPLE_UNUSED int procedural_image(int kind, int size, uint32_t seed, struct image *image) {
    size_t count = (size_t)size * (size_t)size;
    memset(image, 0, sizeof *image);
    uint16_t *pixels = (uint16_t *)malloc(count * 2);
    uint32_t *sums = kind == FBM ? (uint32_t *)malloc(count * 4) : NULL;
    if (!pixels || (kind == FBM && !sums)) {
        free(pixels);
        free(sums);
        return fail("a map of %d x %d is too large for the memory at hand", size, size);
    }
    uint32_t low = UINT32_MAX, high = 0, n = (uint32_t)size;
    for (size_t k = 0; k < count; ++k) {
        uint32_t i = (uint32_t)k % n, j = (uint32_t)(k / n);
        if (kind == BRICKS) pixels[k] = (uint16_t)bricks_at(i, j, n, seed);
        else if (kind == SPIKES) {
            uint32_t h = hash3(i, j, seed);
            pixels[k] = (uint16_t)(h % 1000u < 5 ? 32768u + (h >> 17) : 0);
        } else if (kind == WHITE) pixels[k] = (uint16_t)(hash3(i, j, seed) >> 16);
        else {
            sums[k] = fbm_at(i, j, n, seed);
            if (sums[k] < low) low = sums[k];
            if (sums[k] > high) high = sums[k];
        }
    }
    for (size_t k = 0; sums && k < count; ++k)
        pixels[k] = (uint16_t)(high > low ? (uint64_t)(sums[k] - low) * 65535u / (high - low) : 0);
    free(sums);
    image->width = image->height = size;
    image->format = CONEMAP_UNORM16;
    image->pixels = pixels;
    return 1;
}

/* ---- a map from options ------------------------------------------------------------------------------ */

struct map_options {
    const char *input;        /* an image or a baked map; null: procedural */
    const char *heights;      /* the image of a baked map that holds cones only */
    const char *build_option; /* the first option that only a build can obey */
    struct image_options image;
    int procedural, procedural_size;
    uint32_t seed;
    int square; /* aspect from the size */
    conemap_desc desc;
};

static EXAMPLE_UNUSED void print_input_help(void) {
    puts("Input\n"
         "  FILE                    PGM, PPM, PFM, .r16, .r32f (raw, little-endian)"
#ifdef HAVE_STB_IMAGE
         ", PNG, JPG, TGA, HDR, BMP"
#endif
         "\n"
         "  --procedural KIND SIZE  fbm, bricks, spikes or white noise instead of a file\n"
         "  --seed N                of the procedural map (1)\n"
         "  --raw-size WxH          size of an .r16 or .r32f file (square)\n"
         "  --normalize             stretch the lowest..highest value to 0..1\n"
         "  --depth-map             values are depths: height = 1 - value");
}

static EXAMPLE_UNUSED void print_build_help(void) {
    puts("Cones\n"
         "  --generator NAME        exact (default): the widest; quick, quick-naive: narrower, no vertex in a\n"
         "                          cone; ring: exact vertex cones, slowly\n"
         "                          quick-center, quick-naive-center: wider heuristics, not safe\n"
         "                          relaxed-exact: safe for descending rays; relaxed, relaxed-sampled, hybrid: not\n"
         "  --guarantee NAME        exact: bilinear (default), no interpolated cone cuts the surface; vertex\n"
         "  --slack E               exact: cones narrower by up to 1 / (1 + E), for time (0)\n"
         "  --min3x3                each cone the narrowest of its 3x3 block\n"
         "  --wrap KIND             beyond the border: clamp (default), wrap, nothing; both axes\n"
         "  --wrap-u KIND, --wrap-v KIND\n"
         "  --aspect A|square       length of v over length of u (1); square: square texels\n"
         "  --max-tan T             widest cone, as tan of half the angle (1)\n"
         "  --ring-limit N          ring and relaxed: look at most N texels far, no longer safe (0: no "
         "limit)\n"
         "  --hybrid-weight W       hybrid: 0 conservative .. 1 relaxed (0.5)\n"
         "  --march-steps N         relaxed-sampled: steps of a march (64)\n"
         "Texture\n"
         "  --format NAME           f32 (default), f16, unorm16, unorm8\n"
         "  --encoding NAME         linear (default), sqrt, radius\n"
         "  --layout NAME           height-cone (default), cone, dummer\n"
         "  --per-cell              one cone for each bilinear cell, to be fetched without filtering\n"
         "  --sectors 1|4|8         one cone for each sector of directions, in textures of four channels (1)");
}

/* Takes the current argument if it is about the input or the build. */
static EXAMPLE_UNUSED int map_option(struct args *args, struct map_options *o) {
    const char *name = args->list[args->at];
    conemap_desc *desc = &o->desc;
    if (name[0] != '-') {
        if (o->input || o->procedural) {
            fail("one input is enough: '%s' is too many", name);
            args->failed = 1;
        }
        o->input = name;
    } else if (arg_is(args, "--procedural")) {
        if (o->input) {
            fail("one input is enough: leave out '%s' or --procedural", o->input);
            args->failed = 1;
        }
        o->procedural = arg_name(args, procedural_names);
        o->procedural_size = arg_int(args, 1, CONEMAP_MAX_SIZE);
    } else if (arg_is(args, "--seed")) o->seed = (uint32_t)arg_int(args, 0, INT_MAX);
    else if (arg_is(args, "--raw-size"))
        arg_size(args, CONEMAP_MAX_SIZE, &o->image.raw_width, &o->image.raw_height);
    else if (arg_is(args, "--normalize")) o->image.normalize = 1;
    else if (arg_is(args, "--depth-map")) desc->heights.is_depth = 1;
    else if (arg_is(args, "--heights")) o->heights = arg_text(args);
    else {
        if (arg_is(args, "--generator")) desc->generator = (conemap_generator)arg_name(args, generator_names);
        else if (arg_is(args, "--guarantee"))
            desc->guarantee = (conemap_guarantee)arg_name(args, guarantee_names);
        else if (arg_is(args, "--per-cell")) desc->texture.per_cell = 1;
        else if (arg_is(args, "--sectors")) desc->texture.sectors = arg_int(args, 1, 8);
        else if (arg_is(args, "--slack")) desc->slack = arg_float(args, 0.0, 16.0);
        else if (arg_is(args, "--min3x3")) desc->min3x3 = 1;
        else if (arg_is(args, "--wrap"))
            desc->wrap_u = desc->wrap_v = (conemap_wrap)arg_name(args, wrap_names);
        else if (arg_is(args, "--wrap-u")) desc->wrap_u = (conemap_wrap)arg_name(args, wrap_names);
        else if (arg_is(args, "--wrap-v")) desc->wrap_v = (conemap_wrap)arg_name(args, wrap_names);
        else if (arg_is(args, "--aspect")) {
            if (args->at + 1 < args->count && strcmp(args->list[args->at + 1], "square") == 0) {
                ++args->at;
                o->square = 1;
            } else desc->aspect = arg_float(args, 1.0 / 32768.0, 32768.0);
        } else if (arg_is(args, "--max-tan"))
            desc->max_tan = arg_float(args, 1e-6, (double)CONEMAP_TAN_LIMIT);
        else if (arg_is(args, "--ring-limit")) desc->ring_limit = arg_int(args, 0, CONEMAP_MAX_SIZE);
        else if (arg_is(args, "--hybrid-weight")) {
            float weight = arg_float(args, 0.0, 1.0);
            desc->hybrid_weight = weight > 0 ? weight : 1e-30f; /* zero in the desc stands for the default */
        } else if (arg_is(args, "--march-steps")) desc->march_steps = arg_int(args, 1, 65536);
        else if (arg_is(args, "--format"))
            desc->texture.format = (conemap_format)arg_name(args, format_names);
        else if (arg_is(args, "--encoding"))
            desc->texture.encoding = (conemap_encoding)arg_name(args, encoding_names);
        else if (arg_is(args, "--layout"))
            desc->texture.layout = (conemap_layout)arg_name(args, layout_names);
        else return 0;
        if (!o->build_option) o->build_option = name;
    }
    return 1;
}

/* The heights of the input, and desc filled in to build from them. */
static EXAMPLE_UNUSED int map_image(struct map_options *o, struct image *image) {
    int good = o->procedural ? procedural_image(o->procedural, o->procedural_size, o->seed, image)
                             : image_read(o->input, &o->image, image);
    if (!good) return 0;
    o->desc.heights.pixels = image->pixels;
    o->desc.heights.width = image->width;
    o->desc.heights.height = image->height;
    o->desc.heights.format = image->format;
    if (o->square) o->desc.aspect = (float)image->height / (float)image->width;
    return 1;
}

static EXAMPLE_UNUSED int build_with_progress(conemap_desc *desc, conemap_map *map, const char *what) {
    struct progress progress;
    progress_begin(&progress, what);
    desc->progress = progress_show;
    desc->progress_user = &progress;
    conemap_result result = conemap_build(desc, map);
    progress_end(&progress);
    desc->progress = NULL;
    desc->progress_user = NULL;
    return result == CONEMAP_OK ? 1 : fail_result("the cones cannot be built", result);
}

/* A map from whatever the options name: built from an image, or loaded from baked bytes. */
static EXAMPLE_UNUSED int map_open(struct map_options *o, int keep_pyramid, conemap_map *map) {
    struct image image = {0, 0, CONEMAP_F32, NULL};
    memset(map, 0, sizeof *map);
    if (!o->input && !o->procedural) return fail("no input: name a file, or --procedural; see --help");
    o->desc.keep_pyramid = keep_pyramid;
    if (o->procedural || !has_extension(o->input, ".cone")) {
        int good = map_image(o, &image) && build_with_progress(&o->desc, map, "building");
        image_free(&image);
        return good;
    }
    if (o->build_option)
        return fail("%s is baked already: %s comes too late for it", o->input, o->build_option);
    size_t size;
    unsigned char *bytes = read_file(o->input, &size);
    if (!bytes) return 0;
    conemap_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.keep_pyramid = keep_pyramid;
    int good = 1;
    if (o->heights) {
        good = image_read(o->heights, &o->image, &image);
        desc.heights.pixels = image.pixels;
        desc.heights.width = image.width;
        desc.heights.height = image.height;
        desc.heights.format = image.format;
        desc.heights.is_depth = o->desc.heights.is_depth;
    }
    if (good) {
        conemap_result result = conemap_load(bytes, size, &desc, map);
        if (result == CONEMAP_ERROR_NO_HEIGHTS)
            good = fail("%s holds cones only: name the image of its heights with --heights", o->input);
        else if (result != CONEMAP_OK) good = fail_result(o->input, result);
    }
    image_free(&image);
    free(bytes);
    return good;
}

/* ---- small things ------------------------------------------------------------------------------------ */

/* The usual measure of how wide cones are: the mean of min(tan, 1). */
static EXAMPLE_UNUSED double mean_tan(const conemap_map *map) {
    size_t count = (size_t)map->info.width * (size_t)map->info.height;
    int sectors = map->info.texture.sectors > 1 ? map->info.texture.sectors : 1;
    double sum = 0;
    for (int s = 0; s < sectors; ++s)
        for (size_t i = 0; i < count; ++i) {
            double tan = (double)conemap_decode(&map->info, map->heights[i], map->cones[(size_t)s * count + i]);
            sum += tan < 1 ? tan : 1;
        }
    return sum / ((double)count * sectors);
}

static EXAMPLE_UNUSED double seconds(void) {
    return (double)clock() / CLOCKS_PER_SEC;
}

#endif
