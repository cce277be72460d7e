/* Rays chosen to break tracers, over maps chosen to break cones: the safe methods must miss nothing.

   A miss: the surface rises more than 2^-20 above the ray before the reported hit, or before the ray's end if no
   hit is reported. A false hit: the ray is more than 2^-20 above the surface wherever the reported hit can mean.

   What a reported hit can mean: a tracer works in double precision and reports the float nearest to its t. So its
   own t lies within half a unit in the last place of hit.t, give or take the time in which the ray moves by 1e-12,
   which is room for the rounding of doubles here and there (less than 2^-25 of height on a wall 2^14 steep). The
   true surface is asked over that whole interval and nothing beyond. Before the interval a rise is a miss; if the
   least clearance over it exceeds 2^-20 the hit is false. No slope enters: walls are judged as sharply as plains.

   A direction's component that is below 1e-30 once the longest is brought to 1..2 counts as 0, as the header has
   it: it would matter only to a ray that begins less than 1e-24 off a side of the box.

   STABILITY_RAYS decides how many rays are sent. A whole program of its own, for hundreds of millions of them:

       cc -O2 -std=c99 -ffp-contract=off -DSTABILITY_MAIN -DSTABILITY_RAYS=100000000 -I. tests/stability.c -lm
       ./a.out part parts         // part 0 .. parts - 1 of the rays, for as many processes
       ./a.out 0 1 round          // one round alone, as a logged failure names it */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifdef STABILITY_MAIN
#define CONEMAP_IMPLEMENTATION
#endif
#include "conemap.h"
#include "test.h"
#include "truth.h"
#include "zoo.h"

#ifndef STABILITY_RAYS
#define STABILITY_RAYS 100000 /* a few seconds */
#endif
#define ROUND_RAYS (STABILITY_RAYS >= 10000000 ? 16384 : 1024) /* on one map; few maps pay off in long runs only */
#define ROUNDS ((long)(STABILITY_RAYS / ROUND_RAYS) * 19 / 18 + 1) /* two of 19 maps get half the rays */

#define MISS (1.0 / 1048576.0)
#define MAX_TEXELS 49152

/* ---- maps ---- */

enum map_kind {
    MAP_IMPULSE, /* one texel of 1 on 0: no cone's neighbours warn of it, and it is gone in one long step */
    MAP_WALL,    /* a row or column of 1, one texel thick: thin enough to be stepped across */
    MAP_COLUMNS, /* 0 and 1 in turn: every second cell rises the whole height */
    MAP_SADDLES, /* a checkerboard of 0 and 1: hxy = 2, the most a patch can twist; peaks along its diagonals */
    MAP_FLAT_0,  /* the surface is the floor itself, where the box ends */
    MAP_FLAT_1,  /* the surface is the box's top, where rays begin */
    MAP_BORDER_STEP, /* only the border row is high: half of what rises lies in the outer half texel */
    MAP_CORNER_STEP, /* only a corner texel is high: both axes end there */
    MAP_SEAM,        /* a ramp that wraps: the only cliff lies across the seam */
    MAP_ULP,         /* heights one unit in the last place apart: cones from quotients of nothing but rounding */
    MAP_DENORMAL,    /* denormal heights: their differences squared are 0 */
    MAP_ROW,         /* W x 1: one axis has a single texel */
    MAP_COLUMN,      /* 1 x H: the other one */
    MAP_WIDE,        /* 16384 x 3: positions lose their low bits, walls are 16384 steep */
    MAP_TALL,        /* 2 x 16384: the same along v, on the fewest columns that interpolate */
    MAP_FBM,         /* smooth ground: cones reach far, and just touch */
    MAP_BRICKS,      /* plateaus and gaps: cones end at edges, peaks are as high as their neighbours */
    MAP_WHITE,       /* every cell another way up: the steepest random patches, cones of every width */
    MAP_SPIKES,      /* 0.5 % of the texels high: wide cones between them pass close by thin peaks */
    MAP_KINDS
};

static const char *const map_names[MAP_KINDS] = {
    "impulse",     "wall", "columns", "saddles",  "flat 0", "flat 1", "border step",
    "corner step", "seam", "ulp",     "denormal", "W x 1",  "1 x H",  "16384 x 3",
    "2 x 16384",   "fbm",  "bricks",  "white",    "spikes",
};

static float map_height(int kind, int w, int h, int x, int y, uint32_t seed) {
    const int across = (seed & 1u) != 0;
    switch (kind) {
    case MAP_IMPULSE:
        return x == (int)(seed / 2 % (uint32_t)w) && y == (int)(seed / 256 % (uint32_t)h) ? 1.0f : 0.0f;
    case MAP_WALL:
        return (across ? x == (int)(seed / 2 % (uint32_t)w) : y == (int)(seed / 2 % (uint32_t)h)) ? 1.0f : 0.0f;
    case MAP_COLUMNS: return (float)((across ? x : y) & 1);
    case MAP_SADDLES: return (float)((x + y) & 1);
    case MAP_FLAT_1: return 1.0f;
    case MAP_BORDER_STEP:
        return (seed & 2u ? (across ? x : y) == 0 : across ? x == w - 1 : y == h - 1) ? 1.0f : 0.0f;
    case MAP_CORNER_STEP:
        return x == (seed & 1u ? 0 : w - 1) && y == (seed & 2u ? 0 : h - 1) ? 1.0f : (seed & 4u ? 0.125f : 0.0f);
    case MAP_SEAM: return across ? (float)x / (float)w : (float)y / (float)h;
    case MAP_ULP:
        return (seed & 2u ? 0.5f : 1.0f - 4.0f / 16777216.0f) +
               (float)(zoo_hash(x, y, seed) > 0.8f) * (seed & 2u ? 1.0f / 16777216.0f : 2.0f / 16777216.0f);
    case MAP_DENORMAL: return (seed & 2u ? 1e-45f : FLT_MIN / 4.0f) * (float)(int)(4.0f * zoo_hash(x, y, seed));
    case MAP_WIDE:
    case MAP_TALL: /* walls, noise, a single step at the far end */
        if (seed % 3 == 0) return (float)((kind == MAP_WIDE ? x : y) % 5 == 4);
        if (seed % 3 == 1) return zoo_hash(x, y, seed);
        return (kind == MAP_WIDE ? x == 16382 : y == 16382) ? 1.0f : 0.0f;
    case MAP_ROW:
    case MAP_COLUMN:
    case MAP_WHITE: return zoo_hash(x, y, seed);
    case MAP_FBM: return zoo_height(ZOO_FBM, w, h, x, y, seed);
    case MAP_BRICKS: return zoo_height(ZOO_BRICKS, w, h, x, y, seed);
    case MAP_SPIKES: {
        const float value = zoo_hash(x, y, seed);
        return value > 0.995f ? 0.5f + 0.5f * zoo_hash(y, x, seed + 1) : 0.1f * value;
    }
    default: return 0.0f;
    }
}

/* ---- methods: a tracer over a map ---- */

enum method {
    METHOD_MAXMIP,    /* [TIS08] with the bilinear cell, no cones */
    METHOD_NARROW,    /* the exact tracer over cones that no slope of the map can reach, whatever made them */
    METHOD_BILINEAR,  /* the exact tracer over cones proven for the interpolated surface */
    METHOD_PREPARED,  /* the prepared tracer, which has a table of its own, in every instruction set there is */
    METHOD_VERTEX,    /* the rest may miss: the exact tracer over vertex cones [Dum06], uncorrected */
    METHOD_CORRECTED, /* ... over their 3 x 3 minimum [BV24] */
    METHOD_WIDENED,   /* ... over proven cones times 1.5 */
    METHOD_CELL_MAX,  /* the other tracers over proven cones */
    METHOD_EXACT_STEP,
    METHOD_LINEAR,
    METHOD_QDM,
    METHODS
};
#define SAFE_METHODS 4
#define UNSAFE_SHARE (STABILITY_RAYS >= 10000000 ? 64 : 8) /* of so many rays, one goes through the unsafe ones */

static const char *const method_names[METHODS] = {
    "max mip",      "exact, narrow",    "exact, proven", "prepared",   "exact, vertex",
    "exact, 3 x 3", "exact, 1.5 times", "cell max",      "exact step", "linear",
    "qdm",
};

enum built_map { BUILT_PROVEN, BUILT_NARROW, BUILT_VERTEX, BUILT_CORRECTED, BUILT_MAPS };

struct scene {
    long round;
    int kind;
    uint32_t seed;
    int reach; /* the most texels that a ray may cross, where the map does not end it soon */
    conemap_map built[BUILT_MAPS];
    conemap_map widened; /* a copy of the proven map with cones of its own */
    conemap_prepared prepared; /* the proven map */
    struct truth_map truth;
    double high;
};

static float scene_heights[MAX_TEXELS], scene_cones[8 * MAX_TEXELS];

/* The same round is the same scene and the same rays, wherever and whenever it is run. */
static int scene_build(struct scene *s, struct zoo_random *random, long round) {
    static const int sizes[][2] = {{2, 2}, {3, 5}, {7, 4}, {16, 16}, {17, 17}, {31, 20}, {12, 33}, {48, 48}};
    static const int sectors[] = {0, 0, 4, 8};
    const float square = zoo_below(random, 2) ? 1.0f : 0.0f;
    conemap_desc desc;
    conemap_prepare_desc prepare;
    int size = zoo_below(random, 8), w = sizes[size][0], h = sizes[size][1], x, y, k;
    double low = 1.0, slope, steepest;

    memset(s, 0, sizeof *s);
    s->round = round;
    s->kind = (int)(round % MAP_KINDS);
    s->seed = zoo_next(random) & 0xffffffu;
    if (s->kind >= MAP_FBM) {
        size = 4 + zoo_below(random, 4);
        w = sizes[size][0];
        h = sizes[size][1];
    }
    if (s->kind == MAP_ROW) {
        w = 1 + zoo_below(random, 64);
        h = 1;
    } else if (s->kind == MAP_COLUMN) {
        w = 1;
        h = 1 + zoo_below(random, 64);
    } else if (s->kind == MAP_WIDE) {
        w = 16384;
        h = 3;
    } else if (s->kind == MAP_TALL) {
        w = 2;
        h = 16384;
    }
    for (y = 0; y < h; ++y) {
        for (x = 0; x < w; ++x) scene_heights[y * w + x] = map_height(s->kind, w, h, x, y, s->seed);
    }

    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = scene_heights;
    desc.heights.width = w;
    desc.heights.height = h;
    desc.wrap_u = (conemap_wrap)zoo_below(random, CONEMAP_WRAP_COUNT);
    desc.wrap_v = (conemap_wrap)zoo_below(random, CONEMAP_WRAP_COUNT);
    if (s->kind == MAP_SEAM) desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    desc.aspect = square * (float)h / (float)w;
    desc.max_tan = zoo_below(random, 2) ? 1.0f : 16.0f;
    desc.texture.format = (conemap_format)zoo_below(random, CONEMAP_FORMAT_COUNT);
    desc.texture.encoding = (conemap_encoding)zoo_below(random, CONEMAP_ENCODING_COUNT);
    /* What only single precision can hold is what these maps are for. */
    if ((s->kind == MAP_ULP || s->kind == MAP_DENORMAL) && zoo_below(random, 4)) desc.texture.format = CONEMAP_F32;
    if (zoo_below(random, 4) == 0) desc.texture.layout = CONEMAP_CONE_ONLY;
    desc.generator = CONEMAP_EXACT;
    desc.guarantee = CONEMAP_GUARANTEE_BILINEAR;
    desc.keep_pyramid = 1;
    desc.texture.sectors = sectors[s->seed >> 12 & (s->kind == MAP_WIDE || s->kind == MAP_TALL ? 2u : 3u)];
    if (zoo_below(random, 8) == 0) desc.slack = zoo_between(random, 0.0f, 2.0f);
    if (!CHECK(conemap_build(&desc, &s->built[BUILT_PROVEN]) == CONEMAP_OK, "round %ld: proven cones", round))
        return 0;

    s->truth.width = w;
    s->truth.height = h;
    s->truth.wrap_u = (int)desc.wrap_u;
    s->truth.wrap_v = (int)desc.wrap_v;
    s->truth.heights = s->built[BUILT_PROVEN].heights; /* as the texture holds them */
    truth_bounds(&s->truth, &low, &s->high);

    /* No point of the surface is steeper than all the map's height over one texel along both axes. */
    slope = desc.aspect > 0.0f ? (double)h / (double)desc.aspect : (double)h;
    steepest = (s->high - low) * sqrt((double)w * (double)w + slope * slope);
    s->widened = s->built[BUILT_PROVEN];
    desc.max_tan = steepest > 1.0 / 16.0 ? (float)(0.999 / steepest) : 16.0f;
    desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
    desc.slack = 0.0f;
    desc.texture.sectors = 0;
    desc.keep_pyramid = 0;
    if (desc.max_tan < 1.0f / 65536.0f) desc.max_tan = 1.0f / 65536.0f;
    k = conemap_build(&desc, &s->built[BUILT_NARROW]) == CONEMAP_OK;
    desc.max_tan = s->widened.info.max_tan;
    k = k && conemap_build(&desc, &s->built[BUILT_VERTEX]) == CONEMAP_OK;
    desc.min3x3 = 1;
    k = k && conemap_build(&desc, &s->built[BUILT_CORRECTED]) == CONEMAP_OK;
    if (!CHECK(k, "round %ld: build", round)) return 0;
    memset(&prepare, 0, sizeof prepare);
    prepare.isa = (conemap_isa)(round / MAP_KINDS % CONEMAP_ISA_COUNT);
    if (!conemap_isa_available(prepare.isa)) prepare.isa = CONEMAP_ISA_DEFAULT;
    k = conemap_prepare(&s->built[BUILT_PROVEN], &prepare, &s->prepared) == CONEMAP_OK;
    if (!CHECK(k, "round %ld: prepare", round)) return 0;

    for (k = 0; k < w * h * (s->widened.info.texture.sectors > 1 ? s->widened.info.texture.sectors : 1); ++k) {
        scene_cones[k] = s->widened.cones[k] * (desc.texture.encoding == CONEMAP_SQRT ? 1.2247449f : 1.5f);
    }
    s->widened.cones = scene_cones;
    s->reach = s->kind == MAP_WIDE || s->kind == MAP_TALL                   ? 60
               : desc.wrap_u == CONEMAP_WRAP || desc.wrap_v == CONEMAP_WRAP ? w + h + 10
                                                                            : 0;
    return 1;
}

static void scene_free(struct scene *s) {
    int k;
    conemap_free_prepared(&s->prepared);
    for (k = 0; k < BUILT_MAPS; ++k) conemap_free(&s->built[k]);
}

static conemap_hit scene_trace(const struct scene *s, int method, const conemap_ray *ray) {
    static const conemap_tracer tracers[METHODS] = {
        CONEMAP_TRACE_MAXMIP, CONEMAP_TRACE_EXACT, CONEMAP_TRACE_EXACT,    CONEMAP_TRACE_EXACT,
        CONEMAP_TRACE_EXACT,  CONEMAP_TRACE_EXACT, CONEMAP_TRACE_EXACT,    CONEMAP_TRACE_CELL_MAX,
        CONEMAP_TRACE_EXACT_STEP, CONEMAP_TRACE_LINEAR, CONEMAP_TRACE_QDM,
    };
    const conemap_map *map = method == METHOD_NARROW      ? &s->built[BUILT_NARROW]
                             : method == METHOD_VERTEX    ? &s->built[BUILT_VERTEX]
                             : method == METHOD_CORRECTED ? &s->built[BUILT_CORRECTED]
                             : method == METHOD_WIDENED   ? &s->widened
                                                          : &s->built[BUILT_PROVEN];
    conemap_trace_desc desc;
    conemap_hit hit;
    memset(&desc, 0, sizeof desc);
    memset(&hit, 0x7b, sizeof hit);
    desc.tracer = tracers[method];
    if (method == METHOD_PREPARED) {
        if (conemap_trace_prepared(&s->prepared, ray, &hit, 1) != CONEMAP_OK) hit.status = CONEMAP_INVALID;
        return hit;
    }
    if (conemap_trace(map, &desc, ray, &hit, 1) != CONEMAP_OK) hit.status = CONEMAP_INVALID;
    return hit;
}

/* ---- rays ---- */

enum ray_kind {
    RAY_ABOVE,     /* from above to anywhere: what renderers send most */
    RAY_ANYWHERE,  /* from anywhere to anywhere, inside and upward included */
    RAY_CAMERA,    /* a fan from one eye: neighbours differ in the last bits only */
    RAY_PEAK,      /* at a vertex, its height +-1 ulp: the point that decides cones */
    RAY_EDGE,      /* at a cell's edge: whether the cell before or behind it has the hit is a matter of rounding */
    RAY_CORNER,    /* through the middle of a cell, where four texels meet and saddles pass through their mean */
    RAY_DIAGONAL,  /* at a cell's diagonal, where patches bulge above both their ends */
    RAY_GRAZING,   /* k 2^-24 to k 2^-20 above or below a peak, almost level: cones are as long as they come */
    RAY_GRIDLINE,  /* on u = (i + 0.5) / W as a float, +-1 ulp: within two cells at once, leaving neither */
    RAY_CROSSINGS, /* in steps of whole texels: leaves every cell through its corner, both axes at once */
    RAY_VERTICAL,  /* straight down or up: no horizontal speed to divide by */
    RAY_HORIZONTAL, /* level at a peak's height, +-1 ulp: hit or not is one bit */
    RAY_SURFACE,    /* begins on the surface, +-1 ulp: no gap to step from */
    RAY_INSIDE,     /* begins inside: hit at once */
    RAY_BELOW,      /* begins under the floor: enters the box from below */
    RAY_OUTSIDE,    /* enters through a side, from up to a thousand maps away */
    RAY_SCALES,     /* another one, 1e-20 or 1e20 long: squares of it are 0 or infinite */
    RAY_ZEROS,      /* another one with components of +-0 or denormal: next to no speed along an axis */
    RAY_RANGE,      /* another one between t_min and t_max: begins and ends in mid air or inside */
    RAY_KINDS
};
#define RAY_BASIC_KINDS RAY_SCALES

static const char *const ray_names[RAY_KINDS] = {
    "above",   "anywhere", "camera",    "peak",     "edge",       "corner",  "diagonal",
    "grazing", "gridline", "crossings", "vertical", "horizontal", "surface", "inside",
    "below",   "outside",  "scales",    "zeros",    "range",
};

static float nudge(float x, int ulps) {
    for (; ulps > 0; --ulps) x = nextafterf(x, 2.0f);
    for (; ulps < 0; ++ulps) x = nextafterf(x, -2.0f);
    return x;
}

static float centre(int i, int size) { return ((float)i + 0.5f) / (float)size; }

static float pick_height(const struct scene *s, int i, int j) { return s->truth.heights[j * s->truth.width + i]; }

/* A vertex, mostly a high one; in strips often near the far end, where a float has the fewest bits left. */
static void pick_vertex(const struct scene *s, struct zoo_random *random, int *i, int *j) {
    int k, tries = zoo_below(random, 4) ? 8 : 1;
    const int w = s->truth.width, h = s->truth.height, end = zoo_below(random, 2);
    for (k = 0; k < tries; ++k) {
        int x = zoo_below(random, w), y = zoo_below(random, h);
        if (w > 1000 && end) x = w - 1 - x % 20;
        if (h > 1000 && end) y = h - 1 - y % 20;
        if (k == 0 || pick_height(s, x, y) > pick_height(s, *i, *j)) {
            *i = x;
            *j = y;
        }
    }
}

/* Where rays to a target begin: above, or beside and higher; in strips near it. */
static void pick_origin(const struct scene *s, struct zoo_random *random, const float target[3], float origin[3]) {
    const float near_u = s->truth.width > 1000 ? 30.0f / (float)s->truth.width : 1.0f;
    const float near_v = s->truth.height > 1000 ? 30.0f / (float)s->truth.height : 1.0f;
    origin[0] = target[0] + near_u * zoo_between(random, -1.0f, 1.0f);
    origin[1] = target[1] + near_v * zoo_between(random, -1.0f, 1.0f);
    origin[2] = zoo_below(random, 4) ? 1.0f + 0.5f * zoo_unit(random) : zoo_unit(random);
}

static conemap_ray basic_ray(const struct scene *s, struct zoo_random *random, int kind, int number) {
    const int w = s->truth.width, h = s->truth.height, axis = zoo_below(random, 2);
    const float size[2] = {(float)w, (float)h};
    conemap_ray ray;
    float target[3], length, angle, rise;
    int i = 0, j = 0, k, steps;

    memset(&ray, 0, sizeof ray);
    pick_vertex(s, random, &i, &j);
    target[0] = centre(i, w);
    target[1] = centre(j, h);
    target[2] = pick_height(s, i, j);
    switch (kind) {
    case RAY_PEAK: target[2] = nudge(target[2], zoo_below(random, 3) - 1); break;
    case RAY_EDGE:
        target[axis] += zoo_between(random, -1.0f, 1.0f) / size[axis];
        target[2] = (float)truth_height(&s->truth, (double)target[0], (double)target[1]);
        break;
    case RAY_CORNER:
        target[0] = (float)i / size[0];
        target[1] = (float)j / size[1];
        target[2] = (float)truth_height(&s->truth, (double)target[0], (double)target[1]);
        break;
    case RAY_DIAGONAL:
        rise = zoo_unit(random);
        target[0] += rise / size[0];
        target[1] += (zoo_below(random, 2) ? rise : -rise) / size[1];
        target[2] = (float)truth_height(&s->truth, (double)target[0], (double)target[1]);
        break;
    case RAY_ABOVE:
    case RAY_ANYWHERE:
        for (k = 0; k < 3; ++k) target[k] = zoo_unit(random);
        break;
    default: break;
    }
    pick_origin(s, random, target, ray.origin);
    if (kind == RAY_ABOVE) ray.origin[2] = 1.0f + zoo_unit(random);
    if (kind == RAY_ANYWHERE) ray.origin[2] = zoo_between(random, -0.25f, 1.5f);
    for (k = 0; k < 3; ++k) ray.direction[k] = target[k] - ray.origin[k];

    switch (kind) {
    case RAY_CAMERA: { /* 16 x 16 pixels; the eye is the same for a whole round */
        struct zoo_random eye = zoo_seed((uint64_t)s->seed + 77);
        const float width = zoo_below(&eye, 2) ? 1.0f : 1.0f / 64.0f;
        ray.origin[0] = zoo_between(&eye, -0.5f, 1.5f);
        ray.origin[1] = zoo_between(&eye, -1.0f, 0.0f);
        ray.origin[2] = zoo_between(&eye, 0.5f, 2.0f);
        ray.direction[0] = 0.5f - ray.origin[0] + width * ((float)(number & 15) / 7.5f - 1.0f);
        ray.direction[1] = 0.5f - ray.origin[1];
        ray.direction[2] = 0.4f - ray.origin[2] + width * ((float)(number >> 4 & 15) / 7.5f - 1.0f);
        break;
    }
    case RAY_GRAZING:
        /* Level but for a last bit or so: origin and direction are chosen, and the true line is what they make. */
        angle = zoo_between(random, 0.0f, 6.2831853f);
        length = zoo_between(random, 1.0f, 20.0f);
        ray.direction[0] = cosf(angle) * length / size[0];
        ray.direction[1] = sinf(angle) * length / size[1];
        if (zoo_below(random, 4) == 0) ray.direction[axis] = 0.0f;
        if (zoo_below(random, 8) == 0) ray.direction[0] = length / size[0], ray.direction[1] = length / size[1];
        ray.direction[2] =
            zoo_below(random, 3) ? ldexpf(zoo_between(random, -1.0f, 1.0f), -zoo_below(random, 20)) : 0.0f;
        rise = ldexpf((float)(zoo_below(random, 33) - 16), -20 - zoo_below(random, 5));
        for (k = 0; k < 2; ++k) ray.origin[k] = target[k] - ray.direction[k];
        ray.origin[2] = target[2] - ray.direction[2] + rise;
        break;
    case RAY_GRIDLINE:
        ray.origin[axis] = nudge(target[axis], zoo_below(random, 3) - 1);
        ray.direction[axis] = 0.0f;
        if (zoo_below(random, 2)) ray.direction[2] *= zoo_below(random, 2) ? 0.01f : 0.0f;
        break;
    case RAY_CROSSINGS:
        steps = 1 + zoo_below(random, 24);
        k = zoo_below(random, 4);
        ray.direction[0] = (k & 1 ? 1.0f : -1.0f) / size[0];
        ray.direction[1] = (k & 2 ? 1.0f : -1.0f) / size[1];
        if (zoo_below(random, 4) == 0) ray.direction[axis] *= 2.0f;
        ray.direction[2] = (target[2] - zoo_unit(random) * 1.5f) / (float)steps;
        if (zoo_below(random, 3) == 0) ray.direction[2] = 0.0f;
        if (zoo_below(random, 3) == 0) { /* through the cells' middles, not the vertices */
            target[0] = (float)i / size[0];
            target[1] = (float)j / size[1];
        }
        for (k = 0; k < 3; ++k) ray.origin[k] = target[k] - (float)steps * ray.direction[k];
        break;
    case RAY_VERTICAL:
        k = zoo_below(random, 4);
        for (steps = 0; steps < 2; ++steps) {
            ray.origin[steps] = target[steps];
            if (k == 1 || (k == 2 && steps == axis)) ray.origin[steps] = zoo_unit(random);
            if (k == 3) ray.origin[steps] = nudge(target[steps], zoo_below(random, 3) - 1);
            ray.direction[steps] = zoo_below(random, 2) ? 0.0f : -0.0f;
        }
        ray.direction[2] = zoo_below(random, 4) ? -1.0f : 1.0f;
        ray.direction[2] *= zoo_between(random, 0.5f, 2.0f);
        break;
    case RAY_HORIZONTAL:
        ray.origin[2] = nudge(target[2], zoo_below(random, 3) - 1);
        ray.direction[2] = zoo_below(random, 2) ? 0.0f : -0.0f;
        if (zoo_below(random, 3) == 0) {
            ray.origin[axis] = target[axis];
            ray.direction[axis] = 0.0f;
        }
        break;
    case RAY_SURFACE:
    case RAY_INSIDE:
        for (k = 0; k < 2; ++k) {
            ray.origin[k] = zoo_below(random, 2) ? zoo_unit(random) : target[k];
            ray.direction[k] = zoo_between(random, -1.0f, 1.0f);
            if (size[k] > 1000.0f) ray.direction[k] *= 30.0f / size[k];
        }
        ray.direction[2] = zoo_between(random, -1.0f, 1.0f) * (zoo_below(random, 2) ? 1.0f : 0.01f);
        ray.origin[2] = (float)truth_height(&s->truth, (double)ray.origin[0], (double)ray.origin[1]);
        if (kind == RAY_SURFACE)
            ray.origin[2] = nudge(ray.origin[2], zoo_below(random, 3) - 1);
        else
            ray.origin[2] *= zoo_unit(random);
        break;
    case RAY_BELOW:
        ray.origin[2] = zoo_below(random, 2) ? -zoo_unit(random) : nudge(0.0f, -1 - zoo_below(random, 3));
        ray.direction[2] = zoo_between(random, -0.1f, 1.0f) * (zoo_below(random, 2) ? 1.0f : 0.01f);
        break;
    case RAY_OUTSIDE:
        length = zoo_below(random, 4) ? 4.0f : 1000.0f;
        for (k = 0; k < 3; ++k) {
            const float way = length * (k == 2 ? zoo_unit(random) : zoo_between(random, -1.0f, 1.0f));
            ray.origin[k] = k == 2 ? target[2] + way * 0.25f : target[k] + way;
            ray.direction[k] = target[k] - ray.origin[k];
        }
        break;
    default: break;
    }
    return ray;
}

/* Ends a ray soon enough after it comes into the box that it crosses no more than the scene's reach. */
static void keep_short(const struct scene *s, struct zoo_random *random, conemap_ray *ray) {
    double speed = fabs((double)ray->direction[0]) * (double)s->truth.width +
                   fabs((double)ray->direction[1]) * (double)s->truth.height;
    double reach = zoo_below(random, 4096) ? (double)s->reach : 20000.0, enter = 0.0,
           sink = (double)ray->direction[2];
    double z = (double)ray->origin[2];
    if (s->reach == 0 || speed <= 0.0) return;
    if (z > 1.0 && sink < 0.0) enter = (z - 1.0) / -sink;
    if (z < 0.0 && sink > 0.0) enter = -z / sink;
    if (sink != 0.0 && speed * (1.0 / fabs(sink)) <= reach) return; /* through the box's height in time */
    if (s->truth.wrap_u != 1 || s->truth.wrap_v != 1) { /* the way to the side of a map that does not wrap */
        int k;
        for (k = 0; k < 2; ++k) {
            const double o = (double)ray->origin[k], v = (double)ray->direction[k];
            if ((k ? s->truth.wrap_v : s->truth.wrap_u) == 1) continue;
            if (o < 0.0 && v > 0.0 && -o / v > enter) enter = -o / v;
            if (o > 1.0 && v < 0.0 && (1.0 - o) / v > enter) enter = (1.0 - o) / v;
        }
    }
    reach = enter + reach / speed;
    if (reach > 1e-37 && reach < 1e37) ray->t_max = (float)reach;
}

static conemap_ray make_ray(const struct scene *s, struct zoo_random *random, int kind, int number) {
    static const float tiny[] = {0.0f, -0.0f, 1e-45f, -1e-45f, 1e-40f, -1e-40f, 1e-30f, -1e-12f};
    conemap_ray ray =
        basic_ray(s, random, kind < RAY_BASIC_KINDS ? kind : zoo_below(random, RAY_BASIC_KINDS), number);
    int k;
    if (kind == RAY_ZEROS) {
        const int which = 1 + zoo_below(random, 6);
        for (k = 0; k < 3; ++k) {
            if (!(which & 1 << k)) continue;
            /* From outside, 0: a ray that flies 1e9 maps before it comes in has no position left. */
            ray.direction[k] =
                tiny[ray.origin[k] >= 0.0f && ray.origin[k] <= 1.0f ? zoo_below(random, 8) : zoo_below(random, 2)];
        }
    }
    for (k = 0; k < 3 && fabsf(ray.direction[k]) < 1e-9f; ++k) continue;
    if (k == 3) ray.direction[2] = -1.0f; /* t itself would be no float */
    keep_short(s, random, &ray);
    if (kind == RAY_RANGE) {
        ray.t_min = zoo_unit(random);
        if (ray.t_max == 0.0f || zoo_below(random, 2)) ray.t_max = ray.t_min + 0.5f * zoo_unit(random) + FLT_MIN;
        if (ray.t_max < ray.t_min) ray.t_min = ray.t_max * zoo_unit(random);
    }
    if (kind == RAY_SCALES) {
        const float scale = zoo_below(random, 2) ? 1e20f : 1e-20f;
        for (k = 0; k < 3; ++k) ray.direction[k] *= scale;
        ray.t_max /= scale;
    }
    return ray;
}

/* ---- verdicts ---- */

struct verdict {
    double o[3], d[3], begin, end; /* the part of the ray within the box, up to the highest texel */
    double grain;                  /* a time in which the ray moves by 1e-12 */
    double rise;                   /* before this, the surface rises nowhere 0.99 x 2^-20 above the ray */
};

/* Where the clearance first falls below -0.99 x 2^-20 on a way that a walk has come to; HUGE_VAL if nowhere. */
static double first_rise(struct truth_walk *walk) {
    do {
        const double a = walk->a, b = walk->b, c = walk->c + 0.99 * MISS;
        double r = -1.0, discriminant;
        if (c < 0.0) return walk->t_in;
        if (a + b + c >= 0.0 && !(a > 0.0 && b < 0.0 && -b < 2.0 * a)) continue; /* lowest at an end */
        discriminant = b * b - 4.0 * a * c;
        if (discriminant >= 0.0) {
            const double q = -0.5 * (b + (b < 0.0 ? -sqrt(discriminant) : sqrt(discriminant)));
            const double r1 = a != 0.0 ? q / a : -1.0, r2 = q != 0.0 ? c / q : -1.0;
            r = r1;
            if (r < 0.0 || (r2 >= 0.0 && r2 < r)) r = r2;
        }
        if (!(r >= 0.0 && r <= 1.0)) {
            if (a + b + c >= 0.0) continue;
            r = 1.0;
        }
        return walk->t_in + r * (walk->t_out - walk->t_in);
    } while (truth_walk_next(walk));
    return HUGE_VAL;
}

static struct verdict judge(const struct scene *s, const conemap_ray *ray) {
    struct verdict v;
    struct truth_walk walk;
    double longest = 0.0;
    int k, exponent = 0;
    for (k = 0; k < 3; ++k) {
        v.o[k] = (double)ray->origin[k];
        v.d[k] = (double)ray->direction[k];
        longest = fmax(longest, fabs(v.d[k]));
    }
    (void)frexp(longest, &exponent);
    for (k = 0; k < 3; ++k) {
        if (fabs(v.d[k]) < ldexp(1e-30, exponent - 1)) v.d[k] = 0.0;
    }
    v.grain = 1e-12 / longest;
    v.begin = (double)ray->t_min;
    v.end = ray->t_max > 0.0f ? (double)ray->t_max : HUGE_VAL;
    if (v.d[2] != 0.0) {
        const double t0 = (0.0 - v.o[2]) / v.d[2], t1 = (s->high - v.o[2]) / v.d[2];
        v.begin = fmax(v.begin, fmin(t0, t1));
        v.end = fmin(v.end, fmax(t0, t1));
    } else if (v.o[2] < 0.0 || v.o[2] > s->high) {
        v.end = -1.0;
    }
    v.rise = HUGE_VAL;
    if (v.begin <= v.end && truth_walk_begin(&walk, &s->truth, v.o, v.d, v.begin, v.end))
        v.rise = first_rise(&walk);
    return v;
}

/* Every t that a reported one can stand for: what rounds to this float, and a grain. */
static void round_to(const struct verdict *v, float t, double *low, double *high) {
    *low = 0.5 * ((double)t + (double)nextafterf(t, 0.0f)) - v->grain;
    *high = 0.5 * ((double)t + (double)nextafterf(t, FLT_MAX)) + v->grain;
}

/* Does the surface rise above the ray before what was reported? How far, at the most. */
static int is_miss(const struct scene *s, const struct verdict *v, const conemap_hit *hit, double *depth) {
    double low = v->end, high;
    *depth = 0.0;
    if (hit->status == CONEMAP_HIT || hit->status == CONEMAP_STEP_CAP) round_to(v, hit->t, &low, &high);
    if (!(v->rise < low)) return 0;
    *depth = -truth_clearance(&s->truth, v->o, v->d, v->begin, low < v->end ? low : v->end);
    return *depth > MISS;
}

static int is_false_hit(const struct scene *s, const struct verdict *v, const conemap_hit *hit) {
    double low, high, height;
    if (hit->status != CONEMAP_HIT) return 0;
    round_to(v, hit->t, &low, &high);
    height = truth_clearance(&s->truth, v->o, v->d, low, high);
    return !(height <= MISS);
}

static const char *describe(const struct scene *s, int kind, const conemap_ray *ray) {
    static char text[500];
    const conemap_info *info = &s->built[BUILT_PROVEN].info;
    snprintf(text, sizeof text,
             "round %ld: %s %dx%d seed %lu wraps %d %d aspect %a max_tan %g format %d encoding %d layout %d, %s "
             "{{%a, %a, %a}, {%a, %a, %a}, %a, %a}",
             s->round, map_names[s->kind], info->width, info->height, (unsigned long)s->seed, (int)info->wrap_u,
             (int)info->wrap_v, (double)info->aspect, (double)info->max_tan, (int)info->texture.format,
             (int)info->texture.encoding, (int)info->texture.layout, ray_names[kind], (double)ray->origin[0],
             (double)ray->origin[1], (double)ray->origin[2], (double)ray->direction[0], (double)ray->direction[1],
             (double)ray->direction[2], (double)ray->t_min, (double)ray->t_max);
    return text;
}

/* ---- the run ---- */

struct count {
    long rays, hits, misses, false_hits;
    double worst; /* penetration of a miss, in heights */
};

static struct count counts[MAP_KINDS][RAY_KINDS][METHODS];
static int counted;

static void add_count(struct count *sum, const struct count *more) {
    sum->rays += more->rays;
    sum->hits += more->hits;
    sum->misses += more->misses;
    sum->false_hits += more->false_hits;
    if (more->worst > sum->worst) sum->worst = more->worst;
}

/* Sums; -1 stands for all. */
static struct count count_of(int map, int ray, int method) {
    struct count sum;
    int i, j, k;
    memset(&sum, 0, sizeof sum);
    for (i = 0; i < MAP_KINDS; ++i) {
        for (j = 0; j < RAY_KINDS; ++j) {
            for (k = 0; k < METHODS; ++k) {
                if ((map < 0 || map == i) && (ray < 0 || ray == j) &&
                    (method < 0 ? k < SAFE_METHODS : method == k))
                    add_count(&sum, &counts[i][j][k]);
            }
        }
    }
    return sum;
}

static void run_ray(const struct scene *s, int kind, const conemap_ray *ray, int all) {
    const struct verdict v = judge(s, ray);
    int method;
    for (method = 0; method < (all ? METHODS : SAFE_METHODS); ++method) {
        const conemap_hit hit = scene_trace(s, method, ray);
        struct count one;
        memset(&one, 0, sizeof one);
        one.rays = 1;
        one.hits = hit.status == CONEMAP_HIT;
        one.misses = is_miss(s, &v, &hit, &one.worst);
        one.false_hits = is_false_hit(s, &v, &hit);
        if (!one.misses) one.worst = 0.0;
        add_count(&counts[s->kind][kind][method], &one);
        if (method >= SAFE_METHODS) continue;
        CHECK(!one.misses, "%s: %s: missed by %a: status %d t %a, surface rises at %a", describe(s, kind, ray),
              method_names[method], one.worst, (int)hit.status, (double)hit.t, v.rise);
        CHECK(!one.false_hits, "%s: %s: hit at %a is above the surface", describe(s, kind, ray),
              method_names[method], (double)hit.t);
        CHECK(hit.status != CONEMAP_INVALID, "%s: %s: invalid", describe(s, kind, ray), method_names[method]);
        CHECK(hit.status != CONEMAP_STEP_CAP, "%s: %s: a step cap without one", describe(s, kind, ray),
              method_names[method]);
    }
}

static void run_round(long round) {
    static struct scene s;
    struct zoo_random random = zoo_seed((uint64_t)round + 1000);
    int k, rays = ROUND_RAYS;
    if (scene_build(&s, &random, round)) {
        if (s.kind == MAP_WIDE || s.kind == MAP_TALL) rays /= 2; /* each crosses thousands of cells at times */
        for (k = 0; k < rays; ++k) {
            const int kind = k % RAY_KINDS;
            const conemap_ray ray = make_ray(&s, &random, kind, k / RAY_KINDS);
            run_ray(&s, kind, &ray, k / RAY_KINDS % UNSAFE_SHARE == 0);
        }
    }
    scene_free(&s);
}

static void run_part(long part, long parts) {
    long round;
    for (round = part; round < ROUNDS; round += parts) run_round(round);
    counted = 1;
}

/* ---- tests ---- */

static void safe_methods(void) {
    struct count sum;
    int map, method;
    if (!counted) run_part(0, 1);
    sum = count_of(-1, -1, -1);
    CHECK(sum.misses == 0 && sum.false_hits == 0, "%ld misses, %ld false hits in %ld traces", sum.misses,
          sum.false_hits, sum.rays);
    for (method = 0; method < SAFE_METHODS; ++method) {
        sum = count_of(-1, -1, method);
        CHECK(sum.hits > sum.rays / 4 && sum.hits < sum.rays * 9 / 10, "%s: %ld hits of %ld", method_names[method],
              sum.hits, sum.rays);
        test_note("%s misses %ld of %ld", method_names[method], sum.misses, sum.rays);
    }
    for (map = 0; map < MAP_KINDS; ++map) {
        sum = count_of(map, -1, METHOD_BILINEAR);
        CHECK(sum.rays > 0 && sum.hits > 0, "%s: %ld hits of %ld", map_names[map], sum.hits, sum.rays);
    }
}

/* What may miss does, or these rays and this judge would find nothing in the safe methods either. */
static void unsafe_methods(void) {
    int method;
    if (!counted) run_part(0, 1);
    for (method = SAFE_METHODS; method < METHODS; ++method) {
        const struct count sum = count_of(-1, -1, method);
        /* The 3 x 3 minimum fails too rarely for a short run: about once in 30000 rays. */
        CHECK(sum.misses > 0 || method == METHOD_CORRECTED, "%s misses nothing in %ld rays", method_names[method],
              sum.rays);
        test_note("%s %ld of %ld", method_names[method], sum.misses, sum.rays);
    }
}

/* A hit moved along its ray by 2^-17 of height is found out, later as a miss, earlier as false. */
static void judge_is_sharp(void) {
    static struct scene s;
    long round, late = 0, early = 0, hits = 0;
    for (round = 0; round < 3 * MAP_KINDS; ++round) {
        struct zoo_random random = zoo_seed((uint64_t)round + 5000);
        int k;
        if (scene_build(&s, &random, round)) {
            for (k = 0; k < 64; ++k) {
                const conemap_ray ray = make_ray(&s, &random, k % 2 ? RAY_ABOVE : RAY_PEAK, k);
                const struct verdict v = judge(&s, &ray);
                conemap_hit hit = scene_trace(&s, METHOD_MAXMIP, &ray);
                const double t = (double)hit.t;
                double depth, least, shift;
                if (v.rise < HUGE_VAL && v.rise > v.begin) {
                    least = truth_clearance(&s.truth, v.o, v.d, v.begin, v.rise * (1.0 - 1e-9));
                    CHECK(least > -0.991 * MISS, "%s: rises by %a before %a", describe(&s, RAY_ABOVE, &ray),
                          -least, v.rise);
                } else if (v.rise == HUGE_VAL && v.begin <= v.end) {
                    least = truth_clearance(&s.truth, v.o, v.d, v.begin, v.end);
                    CHECK(least > -0.991 * MISS, "%s: rises by %a", describe(&s, RAY_ABOVE, &ray), -least);
                }
                if (hit.status != CONEMAP_HIT || hit.inside || ray.direction[2] > -0.1f) continue;
                shift = 8.0 * MISS / -(double)ray.direction[2];
                if (t + shift < v.end && /* above the floor */
                    truth_clearance(&s.truth, v.o, v.d, t + shift, t + shift) < -2.0 * MISS) {
                    hit.t = (float)(t + shift);
                    CHECK(is_miss(&s, &v, &hit, &depth), "%s: late by %a, not seen", describe(&s, RAY_ABOVE, &ray),
                          shift);
                    ++late;
                }
                if (truth_clearance(&s.truth, v.o, v.d, v.begin, t - shift) > 2.0 * MISS && t > shift) {
                    hit.t = (float)(t - shift);
                    CHECK(is_false_hit(&s, &v, &hit), "%s: early by %a, not seen", describe(&s, RAY_ABOVE, &ray),
                          shift);
                    ++early;
                }
                hit.status = CONEMAP_LEFT;
                if (v.rise < HUGE_VAL)
                    CHECK(is_miss(&s, &v, &hit, &depth) || depth > 0.98 * MISS, "left, not seen");
                ++hits;
            }
        }
        scene_free(&s);
    }
    CHECK(late > hits / 2 && early > hits / 2, "%ld late, %ld early of %ld", late, early, hits);
}

const struct test_case stability_tests[] = {
    {"the judge is sharp", judge_is_sharp},
    {"safe methods miss nothing", safe_methods},
    {"unsafe methods are caught", unsafe_methods},
    {NULL, NULL},
};

/* ---- the program of its own ---- */

#ifdef STABILITY_MAIN
#include <stdarg.h>

static long failures;

int test_fail(const char *file, int line, const char *format, ...) {
    va_list arguments;
    if (++failures > 200) return 0;
    printf("%s:%d: ", file, line);
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    printf("\n");
    fflush(stdout);
    return 0;
}

void test_note(const char *format, ...) { (void)format; }

static void print_count(const char *name, int map, int ray, int method) {
    const struct count sum = count_of(map, ray, method);
    printf("  %-16s %10ld rays %9ld hits %8ld misses %7ld false hits", name, sum.rays, sum.hits, sum.misses,
           sum.false_hits);
    if (sum.misses) printf(", worst %.3g", sum.worst);
    printf("\n");
}

int main(int argument_count, char **arguments) {
    const long part = argument_count > 1 ? atol(arguments[1]) : 0,
               parts = argument_count > 2 ? atol(arguments[2]) : 1;
    struct count sum, safe;
    int map, ray, method;
    long rays;
    if (part < 0 || parts < 1 || part >= parts) {
        fprintf(stderr, "usage: stability [part parts [round]]\n");
        return 2;
    }
    if (argument_count > 3)
        run_round(atol(arguments[3]));
    else
        run_part(part, parts);
    for (method = 0; method < METHODS; ++method) {
        printf("%s\n", method_names[method]);
        for (map = 0; map < MAP_KINDS; ++map) {
            print_count(map_names[map], map, -1, method);
            for (ray = 0; ray < RAY_KINDS; ++ray) {
                sum = counts[map][ray][method];
                if (!sum.misses && !sum.false_hits) continue;
                printf("      %-12s %10ld rays %9ld hits %8ld misses %7ld false hits, worst %.3g\n",
                       ray_names[ray], sum.rays, sum.hits, sum.misses, sum.false_hits, sum.worst);
            }
        }
        for (ray = 0; ray < RAY_KINDS; ++ray) print_count(ray_names[ray], -1, ray, method);
    }
    printf("all\n");
    for (method = 0; method < METHODS; ++method) print_count(method_names[method], -1, -1, method);
    safe = count_of(-1, -1, -1);
    rays = count_of(-1, -1, METHOD_BILINEAR).rays; /* each ray is sent through every safe method */
    printf("%ld rays, %ld misses, %ld false hits\n", rays, safe.misses, safe.false_hits);
    return safe.misses || safe.false_hits || failures ? 1 : 0;
}
#endif
