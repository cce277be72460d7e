/* cells COUNT PART PARTS: proves bilinear cells of guaranteed maps by bound, COUNT of them over all parts, across the
   zoo, sizes, wraps, texel shapes, formats, encodings, and cones of either kind, on small maps also by sectors. Now and then
   the same cones are widened by 1 %, which must be found out. Prints `N cells, U unsafe, O unproven, W of wider ones
   caught`; fails if U or O is not 0, or W is. */
#include <stdio.h>
#include <stdlib.h>

#define CONEMAP_IMPLEMENTATION
#include "conemap.h"

#include "../zoo.h"

static const int sizes[][2] = {{128, 128}, {200, 77}, {256, 256}, {31, 300}, {512, 512}, {403, 344}};

/* Is there room to be too wide? Where all cones are at max_tan, 1 % more may still be safe. */
static size_t widened_unsafe(const conemap_map *map, size_t texels)
{
    size_t k, count = texels * (size_t)(map->info.texture.sectors > 1 ? map->info.texture.sectors : 1);
    float *wider = (float *)malloc(count * sizeof(float));
    conemap_report report;
    if (!wider) return 0;
    for (k = 0; k < count; ++k) wider[k] = map->cones[k] * 1.01f;
    if (conemap_verify(&map->info, map->heights, wider, NULL, &report) != CONEMAP_OK) report.unsafe = 0;
    free(wider);
    return report.unsafe;
}

int main(int argc, char **argv)
{
    double wanted = argc > 1 ? strtod(argv[1], NULL) : 1e7, cells = 0.0, unsafe = 0.0, unproven = 0.0, caught = 0.0;
    int part = argc > 3 ? atoi(argv[2]) : 0, parts = argc > 3 ? atoi(argv[3]) : 1, n;
    for (n = part; cells * parts < wanted; n += parts) {
        int w = sizes[n % 6][0], h = sizes[n % 6][1], kind = n % ZOO_KINDS;
        size_t texels = (size_t)w * (size_t)h;
        float *heights = (float *)malloc(texels * sizeof(float));
        conemap_desc desc;
        conemap_map map;
        conemap_report report;
        if (!heights) return 2;
        zoo_fill(kind, w, h, (uint32_t)n, heights);
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = heights;
        desc.heights.width = w;
        desc.heights.height = h;
        desc.wrap_u = (conemap_wrap)(n / 2 % 3);
        desc.wrap_v = (conemap_wrap)(n / 6 % 3);
        desc.aspect = n % 3 ? (float)h / (float)w : 0.0f;
        desc.max_tan = n % 4 ? 16.0f : 1.0f;
        desc.slack = n % 7 == 6 ? 0.25f : 0.0f;
        desc.texture.format = (conemap_format)(n / 3 % CONEMAP_FORMAT_COUNT);
        desc.texture.encoding = (conemap_encoding)(n / 5 % CONEMAP_ENCODING_COUNT);
        desc.texture.per_cell = n % 5 == 4 && desc.texture.encoding != CONEMAP_RADIUS;
        if (texels < 20000) desc.texture.sectors = n % 11 % 5 == 3 ? 4 : n % 11 == 5 ? 8 : 0;
        if (conemap_build(&desc, &map) != CONEMAP_OK || conemap_verify(&map.info, map.heights, map.cones, NULL, &report)) {
            printf("map %d: cannot be built or verified\n", n);
            return 1;
        }
        if (report.unsafe || report.unproven)
            printf("map %d: %s %d x %d, %lu unsafe, %lu unproven, worst %g at (%g, %g)\n", n, zoo_name(kind), w, h,
                   (unsigned long)report.unsafe, (unsigned long)report.unproven, report.worst, (double)report.u,
                   (double)report.v);
        cells += (double)report.cells;
        unsafe += (double)report.unsafe;
        unproven += (double)report.unproven;
        if (n % 6 < 2 && desc.texture.format == CONEMAP_F32) caught += (double)widened_unsafe(&map, texels);
        conemap_free(&map);
        free(heights);
    }
    printf("%.0f cells, %.0f unsafe, %.0f unproven, %.0f of wider ones caught\n", cells, unsafe, unproven, caught);
    return unsafe > 0.0 || unproven > 0.0 || !(caught > 0.0);
}
