/* What the writers of variants share: names of dialects, the files they write (equal texts once), and the choice of
   variants: every value of every option, every pair of two, and a seeded random sample. Include zoo.h before. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { DIALECT_COUNT = CONEMAP_DIALECT_COUNT };
static const char *const dialects[DIALECT_COUNT] = {"glsl330", "glsl430", "glsl450", "vulkan", "es300",
                                                    "es310",   "hlsl50",  "hlsl60",  "c99",    "wgsl",
                                                    "msl"};
static const char *const versions[DIALECT_COUNT] = {"330 core", "430 core", "450 core", "450", "300 es",
                                                    "310 es",   "",         "",         "",    "",
                                                    ""};

static char text[131072], whole[262144];
static char (*seen)[20];
static int seen_count, written, refused, equal;
static const char *folder;

static int known(const char *content)
{
    uint64_t hash = 0xcbf29ce484222325u;
    char key[20];
    int k;
    for (; *content; ++content) hash = (hash ^ (unsigned char)*content) * 0x100000001b3u;
    sprintf(key, "%016llx", (unsigned long long)hash);
    for (k = 0; k < seen_count; ++k)
        if (memcmp(seen[k], key, 16) == 0) return 1;
    if (seen_count % 1024 == 0) seen = (char(*)[20])realloc(seen, (size_t)(seen_count + 1024) * 20);
    if (!seen) exit(2);
    memcpy(seen[seen_count++], key, 20);
    return 0;
}

/* What the emitter has said: 1 if there is a text. */
static int accepted(conemap_result result)
{
    if (result == CONEMAP_ERROR_UNSUPPORTED) {
        ++refused;
        return 0;
    }
    if (result != CONEMAP_OK) {
        fprintf(stderr, "variants: %s\n", conemap_result_string(result));
        exit(1);
    }
    return 1;
}

/* Writes `whole` as one more file of the folder, unless an equal one was written. kind: functions, fragment ... */
static void write_whole(conemap_dialect dialect, const char *kind)
{
    const char *ending = dialect == CONEMAP_C99                                     ? "c"
                         : dialect == CONEMAP_HLSL_50 || dialect == CONEMAP_HLSL_60 ? "hlsl"
                         : dialect == CONEMAP_WGSL                                  ? "wgsl"
                         : dialect == CONEMAP_MSL                                   ? "metal"
                         : strcmp(kind, "compute") == 0                             ? "comp"
                         : strcmp(kind, "vertex") == 0                              ? "vert"
                                                                                    : "frag";
    char path[600];
    FILE *file;
    if (known(whole)) {
        ++equal;
        return;
    }
    snprintf(path, sizeof path, "%s/%05d_%s.%s", folder, written++, kind, ending);
    file = fopen(path, "wb");
    if (!file || fputs(whole, file) < 0 || fclose(file) != 0) {
        fprintf(stderr, "variants: %s cannot be written\n", path);
        exit(1);
    }
}

struct option {
    const char *name;
    int values;
};

/* choice: room for as many numbers as there are options; all 0 at the end of the pairs. */
static void write_choices(conemap_dialect dialect, const struct option *options, int count, int *choice, int sample,
                          struct zoo_random *random, void (*variant)(conemap_dialect dialect, const int *choice))
{
    int a, b, x, y, k;
    memset(choice, 0, (size_t)count * sizeof *choice);
    variant(dialect, choice);
    for (a = 0; a < count; ++a)
        for (b = a; b < count; ++b)
            for (x = 1; x < options[a].values; ++x)
                for (y = 1; y < options[b].values; ++y) {
                    choice[a] = x;
                    choice[b] = y;
                    variant(dialect, choice);
                    choice[a] = choice[b] = 0;
                }
    for (k = 0; k < sample * 40 && sample > 0; ++k) { /* most of what is drawn is refused */
        const int before = written;
        for (a = 0; a < count; ++a) choice[a] = zoo_below(random, 3) ? 0 : zoo_below(random, options[a].values);
        variant(dialect, choice);
        sample -= written > before;
    }
}

/* Reads DIALECT FOLDER [random count]; the dialect, or DIALECT_COUNT if something is wrong. */
static int read_arguments(int argument_count, char **arguments, int *sample)
{
    int dialect = 0;
    if (argument_count < 3) return DIALECT_COUNT;
    while (dialect < DIALECT_COUNT && strcmp(dialects[dialect], arguments[1]) != 0) ++dialect;
    folder = arguments[2];
    *sample = argument_count > 3 ? atoi(arguments[3]) : 300;
    return dialect;
}
