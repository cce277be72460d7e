#ifndef EXAMPLES_BENCH_OFF_H
#define EXAMPLES_BENCH_OFF_H

conemap_result trace_effects_off(const conemap_map *map, const conemap_effects *effects, const conemap_ray *rays,
                                 conemap_hit *hits, conemap_shading *shadings, int count);
conemap_result trace_without_effects(const conemap_map *map, const conemap_ray *rays, conemap_hit *hits, int count);

#endif
