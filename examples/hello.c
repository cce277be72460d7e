/* Build a cone map, shoot one ray at it. Needs nothing but conemap.h. */
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"
#include <stdio.h>

int main(void) {
    static unsigned char pixels[256 * 256]; /* a crossing of waves */
    for (int i = 0; i < 256 * 256; ++i) pixels[i] = (unsigned char)((i * (i >> 8) >> 4) & 255);

    conemap_desc desc = {0};
    desc.heights.pixels = pixels;
    desc.heights.format = CONEMAP_UNORM8;
    desc.heights.width = 256;
    desc.heights.height = 256;

    conemap_map map;
    conemap_result result = conemap_build(&desc, &map);
    if (result != CONEMAP_OK) return fprintf(stderr, "hello: %s\n", conemap_result_string(result)), 1;

    conemap_ray ray = {{0.2f, 0.2f, 1.0f}, {0.5f, 0.4f, -1.0f}, 0.0f, 0.0f};
    conemap_hit hit;
    conemap_trace(&map, NULL, &ray, &hit, 1);
    if (hit.status == CONEMAP_HIT) printf("hit at u %.4f v %.4f z %.4f\n", hit.u, hit.v, hit.z);
    conemap_free(&map);
    return 0;
}
