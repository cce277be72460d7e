/* For bench.c: the tracer with effects that are off, and in a build without effects. One of the two, each a program's
   worth of its own: private copies of what it calls, and of nothing else. */
#define CONEMAP_STATIC
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"
#include "bench_off.h"

#ifdef WITH_EFFECTS
conemap_result trace_effects_off(const conemap_map *map, const conemap_effects *effects, const conemap_ray *rays,
                                 conemap_hit *hits, conemap_shading *shadings, int count) {
    return conemap_shade(map, NULL, effects, rays, hits, shadings, count);
}
#else
conemap_result trace_without_effects(const conemap_map *map, const conemap_ray *rays, conemap_hit *hits, int count) {
    return conemap_trace(map, NULL, rays, hits, count);
}
#endif
