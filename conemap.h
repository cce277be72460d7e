/* conemap.h - relief from heightmaps through cone maps, in one header. C99 and C++11, no dependencies.

   Hand it a heightmap; it builds a cone map (on every texel an empty cone, [Dum06], by default safe to interpolate),
   writes it as a texture, traces rays through the relief on the CPU (picking, line of sight, baking), writes the
   shaders that do the same on a GPU, and skins skeletons with relief-mapped conical frusta.

   In ONE source file:                          Everywhere else:

       #define CONEMAP_IMPLEMENTATION               #include "conemap.h"
       #include "conemap.h"

   A whole program's worth (examples/hello.c):

       conemap_desc desc = {0};                     // every zero field means the default beside it
       desc.heights.pixels = pixels;                // your heightmap, 8 bit here
       desc.heights.format = CONEMAP_UNORM8;
       desc.heights.width  = 256;
       desc.heights.height = 256;

       conemap_map map;
       if (conemap_build(&desc, &map) != CONEMAP_OK) return 1;

       conemap_ray ray = {{0.2f, 0.2f, 1.0f}, {0.5f, 0.4f, -1.0f}, 0.0f, 0.0f};
       conemap_hit hit;
       conemap_trace(&map, NULL, &ray, &hit, 1);    // hit.status, hit.t, hit.u, hit.v, hit.z
       conemap_write_texture(&map, upload, upload_size, row_pitch);
       conemap_free(&map);

   Link with -lm where sqrtf needs it.

   CONTENTS (search for the banner)
       C O N V E N T I O N S       axes, units, what a cone is, what lies outside the map, what is promised
       R E S U L T S               the one result enum
       D E S C R I P T I O N S     heights, texture, build and trace settings; the map, rays and hits
       B U I L D I N G             conemap_build; memory; updates; progress; jobs for a host's own threads
       T E X T U R E S             upload, bake to bytes, load, format numbers
       S A M P L I N G             height, cone and normal at a point
       V E R I F Y I N G           proof that interpolated cones are empty
       P L A N N I N G             settings chosen for what a scene tolerates
       T R A C I N G               rays against the relief
       P R E P A R E D   T R A C I N G   the same for many rays: a table for each cell, rays side by side
       S H A D E R S               the tracers as GLSL, HLSL and C
       E F F E C T S               shading, shadows, silhouettes, curved bases, levels of detail, holes
       F R U S T A                 skeletons skinned with relief-mapped conical frusta
     and under CONEMAP_IMPLEMENTATION
       N U M E R I C S             small arithmetic, half floats, checked sizes
       S T O R A G E               texel decoding and encoding, rounding cones down
       P Y R A M I D               maxima over blocks, any size
       K E R N E L S               instruction sets; the kernels themselves come last in the file
       G E N E R A T I O N         ring search, exact, quick, relaxed, correction
       S A F E   C O N E S         for the bilinear surface, with the proof; relaxed cones that are safe
       B U I L D   P A S S E S     validation, memory plan, jobs, updates
       F I L E S                   texture and baked bytes
       S A M P L E R S             bilinear cells
       V E R I F I C A T I O N     rectangles of apices against rectangles of the surface
       P L A N S                   the planner's table and its model
       T R A C E R S               the walk through cells, every tracer, refinement
       P R E P A R A T I O N       the prepared tracer's table, with the proof; its rays' way in and out
       E M I T T E R               shaders from snippets
       E M I T T E D   E F F E C T S   the snippets of effects
       E F F E C T S               frames, levels, flights over bent and blended ground, light
       F R U S T U M   R A Y S     one frustum: rays, parametrisation, normals, bounds
       F R U S T A                 skinning, the relief's shell, a tree of boxes
       E M I T T E D   F R U S T A shaders that ray-cast packed frusta
       L I C E N C E               at the end of the file

   OPTIONS (define before including)
       CONEMAP_STATIC              every function static: private copies in several source files
       CONEMAP_API                 your own linkage, e.g. __declspec(dllexport)
       CONEMAP_MALLOC(size)        both or neither: replace malloc and free as the default allocator
       CONEMAP_FREE(pointer)
       CONEMAP_SELF                the name under which this file includes itself, if it is not "conemap.h"

   SOURCES
       [Dum06]  J. Dummer, Cone Step Mapping, 2006
       [PO07]   F. Policarpo and M. Oliveira, Relaxed Cone Stepping for Relief Mapping, GPU Gems 3, 2007
       [HSST08] A. Halli et al., Per-Pixel Displacement Mapping Using Cone Tracing, 2008
       [TIS08]  A. Tevs et al., Maximum Mipmaps for Dynamic Height Field Rendering, I3D 2008
       [BJCW09] D. Bhagvat et al., GPU Rendering of Relief Mapped Conical Frusta, Computer Graphics Forum 28, 2009
       [CHRS17] A. O. Chahdi et al., Per-pixel Displacement Mapping Using Hybrid Cone Approach, 2017
       [Dro18]  M. Drobot, Quadtree Displacement Mapping with Height Blending, GPU Pro 360, 2018
       [VB22]   G. Valasek and R. Ban, Quick Cone Map Generation on the GPU, Eurographics 2022
       [BV24]   R. Ban et al., Robust Cone Step Mapping, EGSR 2024
*/
#ifndef CONEMAP_H
#define CONEMAP_H

#include <stddef.h>
#include <stdint.h>

#ifndef CONEMAP_API
#ifdef CONEMAP_STATIC
#define CONEMAP_API static
#else
#define CONEMAP_API extern
#endif
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ======================================================================================================
   C O N V E N T I O N S

   The box. A map of W x H texels spans the unit square; texel (i, j) has its centre at u = (i + 0.5) / W,
   v = (j + 0.5) / H. Heights are 0..1. Rays live in that unit box, so how deep the relief looks belongs to
   the ray (scale its z), never to the map, and can change every frame without a rebuild.

   The surface is the bilinear interpolation of the texel centres. The square between four centres is a
   bilinear cell. The relief is solid down to z = 0, where the box ends: a point at or below the surface is
   inside, so a ray that enters the map's side or its floor below the surface hits there.

   Outside the outermost centres, for each axis by itself:
       CONEMAP_CLAMP    the border texel's height goes on for the outer half texel; at u = 0 and u = 1 the
                        map ends. There are W + 1 cells along the axis, the outer two half as wide.
       CONEMAP_WRAP     the map repeats without end; a ray never leaves along this axis, and is followed for
                        2^20 texels at most (single precision knows no cells beyond).
       CONEMAP_NOTHING  the surface ends at the outermost centres; the outer half texel is empty.
   An axis of a single texel is constant along its length; NOTHING there is treated as CLAMP.

   A cone stands on the surface, point down. What it holds nothing of is the map's guarantee (conemap_guarantee): by
   default the bilinear surface, with VERTEX the other texels' vertices. It is kept as the tangent of
   its half angle, horizontal distance in uv over height, never infinite: `max_tan` caps it. Distances are
   sqrt(du^2 + (aspect dv)^2): aspect 1 measures in uv as [Dum06] does; H / W makes texels square.

   Cones are built from the heights as the texture will hold them (decoded and quantised) and rounded down,
   so a stored cone is never wider than the computed one, which itself is never wider than the true one. Vertex cones
   are 1 / sqrt(s), less 2^-20 of themselves for the rounding of their arithmetic, where s is the maximum over vertices
   of the rounded quotient fl(dh^2 / d^2). Bilinear cones come from bounds at most 5.4 % above the true supremum, less
   2^-16 (see SAFE CONES); with sectors, less 2^-12. max_tan caps all of them.

   A miss, for a tracer, is a ray above which the true surface rises by more than 2^-20 somewhere before the hit that is
   reported. CONEMAP_TRACE_EXACT over cones with the bilinear guarantee, in any format, and CONEMAP_TRACE_MAXMIP have
   none.

   Bits. Results are the same to the bit however the work is split into jobs and whatever instruction set does it, on
   every strict IEEE build.

   Threads. There is no mutable global. A finished map is read-only: any number of threads may trace it.
   ====================================================================================================== */

#define CONEMAP_VERSION 1
#define CONEMAP_MAX_SIZE 32768   /* texels along an axis */
#define CONEMAP_TAN_LIMIT 65504.0f /* the widest max_tan: the largest finite half float */
#define CONEMAP_ALIGNMENT 8      /* bytes; what caller-owned memory must be aligned to */

/* ======================================================================================================
   R E S U L T S
   ====================================================================================================== */

/* Every result with its text. Expand with a macro of two arguments. */
#define CONEMAP_RESULTS(X)                                                                                 \
    X(CONEMAP_OK, "no error")                                                                              \
    X(CONEMAP_CANCELLED, "the progress callback asked to stop")                                            \
    X(CONEMAP_ERROR_NULL, "a required pointer is null")                                                    \
    X(CONEMAP_ERROR_SIZE, "width or height is below 1 or above CONEMAP_MAX_SIZE")                          \
    X(CONEMAP_ERROR_OVERFLOW, "a size does not fit in size_t")                                             \
    X(CONEMAP_ERROR_STRIDE, "a row or pixel stride is smaller than what it must step over")                \
    X(CONEMAP_ERROR_ENUM, "an enum field holds no known value")                                            \
    X(CONEMAP_ERROR_PARAMETER, "a numeric field is NaN or out of its range")                               \
    X(CONEMAP_ERROR_UNSUPPORTED, "these settings do not go together: see the fields' comments")             \
    X(CONEMAP_ERROR_HEIGHT, "a height is NaN, infinite or outside 0..1")                                   \
    X(CONEMAP_ERROR_MEMORY, "memory could not be allocated")                                               \
    X(CONEMAP_ERROR_BUFFER, "a buffer handed in is too small")                                             \
    X(CONEMAP_ERROR_ALIGNMENT, "a buffer handed in is not aligned to CONEMAP_ALIGNMENT bytes")             \
    X(CONEMAP_ERROR_ORDER, "a job or pass is out of range, or the build ended before all jobs were run")   \
    X(CONEMAP_ERROR_RAY_ORIGIN, "a ray origin is NaN or infinite")                                         \
    X(CONEMAP_ERROR_RAY_DIRECTION, "a ray direction is zero, NaN or infinite")                             \
    X(CONEMAP_ERROR_RAY_RANGE, "a ray's t range is NaN, negative or empty")                                \
    X(CONEMAP_ERROR_NO_HEIGHTS, "the baked bytes hold cones only: hand the heights over in a desc")        \
    X(CONEMAP_ERROR_NO_PYRAMID, "this tracer needs a map built with keep_pyramid")                         \
    X(CONEMAP_ERROR_POSITION, "a sample position is NaN, infinite or off the surface")                     \
    X(CONEMAP_ERROR_FILE_FORMAT, "these bytes are not a baked cone map")                                   \
    X(CONEMAP_ERROR_FILE_VERSION, "the baked bytes have an unknown version")                               \
    X(CONEMAP_ERROR_FILE_TRUNCATED, "the baked bytes end too early")                                       \
    X(CONEMAP_ERROR_FILE_CORRUPT, "the baked bytes contradict themselves")                                 \
    X(CONEMAP_ERROR_HASH, "the heights are not those that the baked cones were built from")                \
    X(CONEMAP_ERROR_JOINT, "a joint is NaN or infinite, or a segment names one that does not exist")       \
    X(CONEMAP_ERROR_RADIUS, "a radius or thickness is negative, or a segment has none at either end")      \
    X(CONEMAP_ERROR_LENGTH, "a segment is too short for its radius, or for its distance from the origin")  \
    X(CONEMAP_ERROR_PARENT, "a segment's parent does not exist or does not end where the segment begins")  \
    X(CONEMAP_ERROR_CYCLE, "segments are their own ancestors")

#define CONEMAP__ENUM_ITEM(name, text) name,
typedef enum conemap_result { CONEMAP_RESULTS(CONEMAP__ENUM_ITEM) CONEMAP_RESULT_COUNT } conemap_result;
#undef CONEMAP__ENUM_ITEM

/* The text of a result: a constant string, never null, also for values outside the enum. */
CONEMAP_API const char *conemap_result_string(conemap_result result);

/* ======================================================================================================
   D E S C R I P T I O N S

   Every desc is valid when zeroed; the comment beside a field says what zero means.
   ====================================================================================================== */

typedef enum conemap_format { /* one channel, of heights read or of textures written; native byte order */
    CONEMAP_F32 = 0,
    CONEMAP_F16,
    CONEMAP_UNORM16, /* u16 / 65535 */
    CONEMAP_UNORM8,  /* u8 / 255 */
    CONEMAP_FORMAT_COUNT
} conemap_format;

typedef enum conemap_wrap { /* what lies outside the outermost texel centres; see CONVENTIONS */
    CONEMAP_CLAMP = 0,
    CONEMAP_WRAP,
    CONEMAP_NOTHING,
    CONEMAP_WRAP_COUNT
} conemap_wrap;

typedef enum conemap_encoding { /* what the cone channel holds */
    CONEMAP_LINEAR = 0, /* tan; unorm formats hold at most 1, and what is below one step becomes 0 (safe) */
    CONEMAP_SQRT,       /* sqrt(tan), finer where cones are narrow [Dum06]; interpolates narrower: safe */
    CONEMAP_RADIUS,     /* (1 - height) tan, the cone's radius at the top of the box [HSST08] */
    CONEMAP_ENCODING_COUNT
} conemap_encoding;

typedef enum conemap_layout { /* the channels of a texel */
    CONEMAP_HEIGHT_CONE = 0, /* 2: height, cone */
    CONEMAP_CONE_ONLY,       /* 1: cone; the host samples its own heights, so these stay as they were read */
    CONEMAP_DUMMER,          /* 4: height, cone, dh/du, dh/dv as [Dum06]: 0.5 + (dh per texel), clamped to 0..1
                                in unorm formats; pair it with CONEMAP_SQRT for his files */
    CONEMAP_LAYOUT_COUNT
} conemap_layout;

typedef enum conemap_generator {
    CONEMAP_GENERATE_DEFAULT = 0,    /* CONEMAP_EXACT */
    CONEMAP_EXACT,                   /* by branch and bound over a max pyramid: the widest vertex cones, or bilinear
                                        ones from bounds tight to a few percent; slack makes them narrower */
    CONEMAP_RING,                    /* EXACT's vertex cones, to the bit, by ring search with early out [Dum06]; slow */
    CONEMAP_QUICK_NAIVE,             /* conservative, narrow: [VB22] Algorithm 1 */
    CONEMAP_QUICK,                   /* conservative, wider: [VB22] Algorithm 2 with its diagonals mended */
    CONEMAP_QUICK_NAIVE_CENTER,      /* texel-centre heuristic on Algorithm 1: wider, not safe [VB22] */
    CONEMAP_QUICK_CENTER,            /* texel-centre heuristic on Algorithm 2: wider, not safe [VB22] */
    CONEMAP_RELAXED_SAMPLED,         /* relaxed by marching rays from the top [PO07]; slowest, not safe */
    CONEMAP_RELAXED,                 /* relaxed, [BV24] Algorithm 2 with borders and axis cells mended; the
                                        near corner's height decides, which is not always safe */
    CONEMAP_RELAXED_EXACT,           /* relaxed cones that are safe for the bilinear surface, by branch and bound;
                                        where the ground is rough they are hardly wider than CONEMAP_EXACT's */
    CONEMAP_RELAXED_EXACT_RING,      /* the same by ring search; slow, the reference */
    CONEMAP_HYBRID,                  /* between RING and RELAXED by hybrid_weight [CHRS17] */
    CONEMAP_GENERATOR_COUNT
} conemap_generator;

typedef enum conemap_guarantee { /* what a map's cones promise, kept in its info; in a desc, what they shall promise */
    CONEMAP_GUARANTEE_DEFAULT = 0, /* desc: BILINEAR with CONEMAP_EXACT, else what the generator gives */
    CONEMAP_GUARANTEE_NONE,        /* info: heuristics, anything may happen */
    CONEMAP_GUARANTEE_VERTEX,      /* the cone of a texel holds no other texel's vertex, as in the papers */
    CONEMAP_GUARANTEE_BILINEAR,    /* the interpolated cone over any point, its apex raised by 2^-20, holds no
                                      point of the bilinear surface: proven in the implementation */
    CONEMAP_GUARANTEE_RELAXED,     /* info: [BV24]'s rule for descending rays: bisect between the last two steps */
    CONEMAP_GUARANTEE_RELAXED_BILINEAR, /* info: a step of a descending ray to the end of an interpolated cone passes
                                      the bilinear surface at most once; others must not step by these cones */
    CONEMAP_GUARANTEE_COUNT
} conemap_guarantee;

typedef enum conemap_isa { /* the instruction set that builds; bits do not depend on it */
    CONEMAP_ISA_DEFAULT = 0, /* the best that compiler, machine and system have */
    CONEMAP_ISA_SCALAR,      /* plain C */
    CONEMAP_ISA_SSE2,        /* x86, chosen at run time; no compiler flag is needed */
    CONEMAP_ISA_AVX2,
    CONEMAP_ISA_AVX512,      /* F, BW, DQ, VL */
    CONEMAP_ISA_NEON,        /* 64-bit ARM */
    CONEMAP_ISA_WASM,        /* SIMD128, compiled with -msimd128 */
    CONEMAP_ISA_COUNT
} conemap_isa;

/* A heightmap in the caller's memory. Read during the build only; never written. */
typedef struct conemap_heights {
    const void *pixels;     /* the first texel of row 0 */
    int width, height;      /* 1..CONEMAP_MAX_SIZE */
    conemap_format format;
    int is_depth;           /* nonzero: values are depths, height = 1 - value */
    ptrdiff_t row_stride;   /* bytes from row to row, may be negative; 0: rows touch */
    ptrdiff_t pixel_stride; /* bytes from texel to texel; 0: texels touch */
} conemap_heights;

/* What the texture will hold. The cones are built for exactly these heights and rounded down to this format. */
typedef struct conemap_texture {
    conemap_format format;
    conemap_encoding encoding;
    conemap_layout layout;
    int flip_dv;            /* CONEMAP_DUMMER: nonzero negates dh/dv, for v pointing up */
    int per_cell;           /* nonzero: one cone for each bilinear cell, wider and fetched without filtering: texel
                               floor(uv * size - 0.5), clamped or wrapped. For the bilinear guarantee; not with
                               RADIUS */
    int sectors;            /* 0 or 1: a cone for all directions. 4 or 8: one for each sector of horizontal directions,
                               which holds nothing in the directions of its sector (see conemap_sector): wider, for a
                               ray meets nothing else. In sectors / 4 RGBA textures, the heights in one of their own.
                               With CONEMAP_EXACT; not with CONEMAP_DUMMER. Steps of grazing rays, of those with 1: 4
                               takes 0.5 to 0.8, 8 takes 0.4 to 0.7; on white noise both 0.97 */
} conemap_texture;

/* Allocation callbacks, both or neither. `allocate` returns memory aligned to CONEMAP_ALIGNMENT, or null. */
typedef struct conemap_allocator {
    void *(*allocate)(size_t size, void *user);
    void (*release)(void *memory, void *user);
    void *user;
} conemap_allocator;

/* One job of a pass; `context` and `index` are handed through by the host. */
typedef void conemap_job(void *context, int index);

/* Everything that decides a cone map. */
typedef struct conemap_desc {
    conemap_heights heights;
    conemap_wrap wrap_u, wrap_v;
    float aspect;           /* metres per v over metres per u; 0: 1. 2^-15..2^15 */
    float max_tan;          /* widest cone; 0: 1, as the papers. Up to CONEMAP_TAN_LIMIT */
    conemap_texture texture;

    conemap_generator generator;
    conemap_guarantee guarantee; /* CONEMAP_EXACT: VERTEX or BILINEAR; others: VERTEX where it is what they give.
                               0: BILINEAR with CONEMAP_EXACT, else what the generator gives */
    float slack;            /* CONEMAP_EXACT: cones may be narrower by up to 1 / (1 + slack), in exchange for time;
                               0: exact, and so is what is below 0.5, for that would save nothing. Up to 16 */
    int min3x3;             /* nonzero: each cone becomes the narrowest of its 3x3 block [BV24 eq. 2] */
    int march_steps;        /* CONEMAP_RELAXED_SAMPLED: steps of a march; 0: 64. Up to 65536 */
    int ring_limit;         /* RING, RELAXED, RELAXED_SAMPLED, HYBRID: look at most so many texels far, which leaves
                               the later batches out [BV24 section 5] and drops the guarantee; 0: no limit */
    float hybrid_weight;    /* CONEMAP_HYBRID: 0..1 from conservative to relaxed; 0: 0.5 */
    int keep_pyramid;       /* nonzero: keep the maxima that CONEMAP_TRACE_MAXMIP and _QDM need */
    int keep_search;        /* nonzero: keep what lets conemap_update take time by the edit and not by the map; 1.4
                               bytes a texel. Of use where conemap_update searches a part only */

    conemap_allocator allocator; /* null: CONEMAP_MALLOC and CONEMAP_FREE */
    void *memory;           /* caller-owned memory for the map; null: allocate. Must outlive the map */
    size_t memory_size;     /* at least conemap_memory's memory_size */
    void *scratch;          /* caller-owned memory for the build only; null: allocate */
    size_t scratch_size;    /* at least conemap_memory's scratch_size */

    int (*progress)(double done, void *user); /* 0..1; a nonzero return cancels; null: none. Called from the
                               thread that runs the job; with parallel jobs `done` is not in order */
    void *progress_user;
    void (*parallel_for)(int count, conemap_job *job, void *context, void *user); /* run job(context, 0) to
                               job(context, count - 1) on any threads in any order, return when all are done;
                               null: this thread */
    void *parallel_user;

    conemap_isa isa;        /* 0: the best there is. One that conemap_isa_available denies is UNSUPPORTED */
} conemap_desc;

/* What a map is: travels with baked bytes so that no reader can disagree with them. */
typedef struct conemap_info {
    int width, height;
    conemap_wrap wrap_u, wrap_v;
    float aspect;
    float max_tan;
    conemap_texture texture;
    conemap_generator generator;
    conemap_guarantee guarantee;
    int min3x3;
    float slack;
    uint64_t height_hash;   /* of the decoded heights */
} conemap_info;

/* Maxima over square blocks, halved and rounded up per level until one block is left; each level in quads of
   2 x 2 blocks, row by row. */
typedef struct conemap_pyramid {
    int levels;             /* 0: none kept */
    int width[17], height[17];
    float *level[17];       /* level[0] may be null: computed when asked for */
} conemap_pyramid;

/* A cone map. Read-only for the caller; free it with conemap_free. A plain struct, which may be copied or moved: free
   one copy only. */
typedef struct conemap_map {
    conemap_info info;
    const float *heights;   /* width * height, row 0 first, as a texture fetch returns them */
    const float *cones;     /* width * height, encoded, as a texture fetch returns them: see conemap_decode. With
                               texture.sectors so many of these planes, sector 0 first */
    conemap_pyramid cells;  /* maxima over bilinear cells, with keep_pyramid */
    float highest;          /* of the heights */
    size_t memory_size;     /* bytes held */
    conemap_isa isa;        /* what it was built or loaded with; never DEFAULT */
    struct {                /* private */
        void *memory, *scratch;
        int owns_memory, owns_scratch;
        conemap_allocator allocator;
        conemap_desc desc;
        conemap_pyramid texels; /* maxima over texels, while building */
        conemap_pyramid falling[4]; /* and over the cells that fall to the right or left, and down or up */
        float *heights, *cones, *plane;
        float *cell_slopes;     /* bilinear guarantee: squared slopes inside cells, while `plane` has those from
                                   vertices */
        float texel_u, texel_v; /* a texel's size, aspect included */
        float search_u, search_v; /* the same as the search for cones counts it */
        float least_slope2;     /* 1 / max_tan^2, less so much that conemap__tangent's margin leaves max_tan whole */
        unsigned char *job_results;
        unsigned char *wanted;  /* while updating: what to do with each texel */
        float *survey;          /* with keep_search, two numbers for each block of CONEMAP__BAND^2 texels and each
                                   sector: see conemap__surveyed */
        int updating, keeps_search;
        int pass_jobs[8];
    } build;
} conemap_map;

typedef struct conemap_ray {
    float origin[3];        /* u, v, z in the unit box's coordinates; anywhere */
    float direction[3];     /* any length but 0; t counts in it. A component below 1e-30 of the longest counts as 0 */
    float t_min;            /* where the ray begins; 0 or more */
    float t_max;            /* where it ends; 0 or infinite: no end */
} conemap_ray;

typedef enum conemap_status {
    CONEMAP_HIT = 0,        /* the ray meets the surface at t, as near as the tracer and its refinement come */
    CONEMAP_LEFT,           /* it left the map through a side or the top, or never met it */
    CONEMAP_FLOOR,          /* it reached z = 0 where there is no surface */
    CONEMAP_T_MAX,          /* it reached t_max above the surface */
    CONEMAP_STEP_CAP,       /* max_steps, or 2^20 texels of a wrapping map, were spent: unconverged, t is how
                               far it came */
    CONEMAP_INVALID,        /* the ray itself is invalid; conemap_trace says how */
    CONEMAP_STATUS_COUNT
} conemap_status;

typedef struct conemap_hit {
    conemap_status status;
    int inside;             /* nonzero: the ray began or entered the map at or below the surface */
    float t;                /* along the ray, in lengths of its direction; infinite where a float cannot hold it */
    float u, v, z;          /* origin + t direction; u and v are not wrapped */
    float t_before, t_after;/* the bracket: above the surface before, at or below it after (equal when exact) */
    int steps;              /* iterations: cone steps, cells or blocks visited */
    int fallback;           /* nonzero: CONEMAP_TRACE_EXACT went without cones, because these are relaxed and the
                               ray rises or is level */
} conemap_hit;

typedef enum conemap_tracer {
    CONEMAP_TRACE_DEFAULT = 0,  /* CONEMAP_TRACE_EXACT */
    CONEMAP_TRACE_EXACT,        /* cone steps, and in every cell entered the bilinear patch itself: misses
                                   nothing that the cones do not step over */
    CONEMAP_TRACE_LINEAR,       /* equal steps from entry to exit; no cones; misses what lies between */
    CONEMAP_TRACE_FIXED,        /* [Dum06] _fixed: ten cone steps, then take what is there */
    CONEMAP_TRACE_LOOP,         /* [Dum06] _loop: max_steps cone steps, then take what is there */
    CONEMAP_TRACE_EXACT_STEP,   /* [Dum06] _exact: cone step plus one texel until below, back off one texel */
    CONEMAP_TRACE_CELL_MAX,     /* [BV24] Algorithm 1: the farther of cone step and cell border */
    CONEMAP_TRACE_MAXMIP,       /* [TIS08]: walk over maxima, exact hit with the bilinear cell; no cones */
    CONEMAP_TRACE_QDM,          /* [Dro18]: walk over maxima, linear hit in the cell; no cones */
    CONEMAP_TRACER_COUNT
} conemap_tracer;

typedef enum conemap_refinement { /* of the last bracket; EXACT, MAXMIP and QDM need none */
    CONEMAP_REFINE_NONE = 0,
    CONEMAP_REFINE_SECANT,      /* one secant step */
    CONEMAP_REFINE_BISECT,      /* refine_steps halvings */
    CONEMAP_REFINEMENT_COUNT
} conemap_refinement;

typedef struct conemap_trace_desc {
    conemap_tracer tracer;
    conemap_refinement refinement;
    int refine_steps;       /* CONEMAP_REFINE_BISECT; 0: 7, as [BV24]. Up to 64 */
    int max_steps;          /* 0: LINEAR 200, LOOP 20, others as many as it takes; FIXED always takes 10. Up to
                               2^30 */
    float step_scale;       /* cone steps times this; 0: 1. Above 1 is [VB22] section 4.1's experiment */
    int adaptive_steps;     /* LOOP: nonzero scales max_steps by 0.5 + |horizontal direction| [Dum06] */
    int any_hit;            /* nonzero: EXACT tells whether there is a hit, for shadows and line of sight; t is then
                               some point of the ray that is inside, not the first. Others ignore it. From a to b:
                               origin a, direction b - a, t_max 1, both ends lifted off the surface, which is inside;
                               anything but HIT and STEP_CAP is a clear line */
    float tolerance;        /* FIXED, LOOP: |z - height| that counts as converged; 0: 1/256 */
} conemap_trace_desc;

typedef struct conemap_sample {
    float height;
    float tan;              /* of the interpolated cone; with per_cell of the cell's */
    float dhdu, dhdv;       /* slope of the bilinear cell */
    float normal[3];        /* unit normal of the unit box's surface; scale dhdu, dhdv yourself for a depth */
} conemap_sample;

/* ======================================================================================================
   B U I L D I N G
   ====================================================================================================== */

/* Builds a cone map.
   desc: copied; desc->heights.pixels is read during the call only. map: overwritten, whatever it held.
   Returns CONEMAP_OK, CONEMAP_CANCELLED or what is wrong; unless OK, *map is zeroed and nothing stays
   allocated. Takes map memory, and scratch that is released at the end (conemap_memory tells both).
   Thread-safe for different maps. Sources: see conemap_generator. */
CONEMAP_API conemap_result conemap_build(const conemap_desc *desc, conemap_map *map);

/* Releases what the map owns and zeroes it. Null and zeroed maps are fine. Caller-owned memory stays. */
CONEMAP_API void conemap_free(conemap_map *map);

/* The bytes that a build needs: for the map's life, and during the build. Checks the whole desc but the
   heights' values. Either pointer may be null. */
CONEMAP_API conemap_result conemap_memory(const conemap_desc *desc, size_t *memory_size, size_t *scratch_size);

/* Brings a map up to date after its heights changed inside a rectangle of texels.
   desc: every setting as the map was built (ring_limit, march_steps and hybrid_weight cannot be checked), and the whole
   heightmap as it is now, of which only the rectangle is read. memory, scratch, keep_pyramid, keep_search, progress and
   parallel_for are ignored: it runs on this thread, allocates working memory from desc->allocator and frees it.
   CONEMAP_EXACT without slack, and without min3x3 on vertex cones, searches only as far as the old and the new heights
   reach; other settings search everything. On a map built with keep_search the time follows the texels searched. The
   result is that of a full build, to the bit.
   Errors: those of conemap_build; PARAMETER if desc has other settings than the map; SIZE if the rectangle is empty or
   not inside the map. On any error the map is as it was. Nothing else may use the map meanwhile. */
CONEMAP_API conemap_result conemap_update(conemap_map *map, const conemap_desc *desc, int x, int y, int width,
                                          int height);

/* Nonzero if a desc may ask for this instruction set here. Asks the processor, which takes a while in virtual
   machines. */
CONEMAP_API int conemap_isa_available(conemap_isa isa);
/* Its name: a constant string, never null, also for values outside the enum. */
CONEMAP_API const char *conemap_isa_name(conemap_isa isa);

/* The same build in pieces, for a host's own job system:
       conemap_begin(&desc, &map);
       for (pass = 0; pass < conemap_pass_count(&map); ++pass)
           for every job in 0 .. conemap_job_count(&map, pass) - 1, on any thread, in any order:
               conemap_run_job(&map, pass, job);
           // all jobs of a pass are done before the next pass begins
       conemap_end(&map);
   desc->heights.pixels must stay readable until the first pass is done. The bits do not depend on the split.
   Run each job exactly once. conemap_run_job is thread-safe for different jobs; it reports its own error, and
   conemap_end reports that of
   the first failed job, or CONEMAP_ERROR_ORDER if a job was never run. On any error conemap_end (and
   conemap_begin) frees the map. To give up early, call conemap_free. */
CONEMAP_API conemap_result conemap_begin(const conemap_desc *desc, conemap_map *map);
CONEMAP_API int conemap_pass_count(const conemap_map *map);
CONEMAP_API int conemap_job_count(const conemap_map *map, int pass);
CONEMAP_API conemap_result conemap_run_job(conemap_map *map, int pass, int job);
CONEMAP_API conemap_result conemap_end(conemap_map *map);

/* ======================================================================================================
   T E X T U R E S
   ====================================================================================================== */

/* The sector of a horizontal direction in a map with texture.sectors: whose cones a ray that flies so reads. With 4
       sector = (du < 0 ? 1 : 0) + (dv < 0 ? 2 : 0)
   is channel `sector` of texture 0. With 8, each of these quadrants is cut in two along the diagonal of a texel:
       sector += |dv| * height > |du| * width ? 4 : 0
   is channel sector % 4 of texture sector / 4. On the border of two sectors either will do. 0 if info is null or has no
   sectors. */
CONEMAP_API int conemap_sector(const conemap_info *info, float du, float dv);

/* The bytes of one row, and the texture's bytes at a row pitch (0: rows touch). 0 if map is null or empty, or
   the pitch is below a row. The last row takes a whole pitch too. */
CONEMAP_API size_t conemap_row_size(const conemap_map *map);
CONEMAP_API size_t conemap_texture_size(const conemap_map *map, size_t row_pitch);

/* Writes the texture, native byte order, into the caller's pixels. row_pitch: bytes from row to row, 0: rows
   touch; bytes between rows stay as they were, and none are needed behind the last row. Errors: NULL, STRIDE (pitch
   below a row), BUFFER, OVERFLOW. */
CONEMAP_API conemap_result conemap_write_texture(const conemap_map *map, void *pixels, size_t size,
                                                 size_t row_pitch);

/* The same for maps of several textures: how many there are (0 for a null or empty map), and texture `index` of them.
   With texture.sectors these are sectors / 4 of cones, then the heights unless CONEMAP_CONE_ONLY; otherwise the one.
   The functions above are those of index 0. A size is 0, and the error PARAMETER, if there is no such texture. */
CONEMAP_API int conemap_texture_count(const conemap_map *map);
CONEMAP_API size_t conemap_row_size_at(const conemap_map *map, int index);
CONEMAP_API size_t conemap_texture_size_at(const conemap_map *map, int index, size_t row_pitch);
CONEMAP_API conemap_result conemap_write_texture_at(const conemap_map *map, int index, void *pixels, size_t size,
                                                    size_t row_pitch);

/* Bakes the info and the texture into bytes that any machine reads back (little-endian, rows touch).
   conemap_save_size returns the bytes needed, 0 for a null or empty map. Errors: NULL, BUFFER. */
CONEMAP_API size_t conemap_save_size(const conemap_map *map);
CONEMAP_API conemap_result conemap_save(const conemap_map *map, void *bytes, size_t size);

/* Reads the info of baked bytes, checking all of them but the texels. */
CONEMAP_API conemap_result conemap_load_info(const void *bytes, size_t size, conemap_info *info);

/* Loads baked bytes as a map to sample and trace; the bytes are copied.
   desc: may be null; its allocator, memory, keep_pyramid, keep_search and isa are used, and its heights, if given, are
   compared with the hash (a must for CONEMAP_CONE_ONLY, which holds none). Errors: FILE_..., HASH, NO_HEIGHTS, and
   those of conemap_build; on any of them *map is zeroed. */
CONEMAP_API conemap_result conemap_load(const void *bytes, size_t size, const conemap_desc *desc,
                                        conemap_map *map);

/* The tangent that a cone channel's value stands for, at a height. Any thread. */
CONEMAP_API float conemap_decode(const conemap_info *info, float height, float stored);

/* The numbers that graphics APIs give to a texture. */
typedef struct conemap_format_numbers {
    int channels, bytes;            /* of a texel */
    unsigned dxgi, vulkan;          /* DXGI_FORMAT, VkFormat */
    unsigned gl_internal, gl_format, gl_type;
} conemap_format_numbers;
CONEMAP_API conemap_result conemap_get_format_numbers(const conemap_texture *texture,
                                                      conemap_format_numbers *numbers);
/* The same of texture `index`: see conemap_texture_count. */
CONEMAP_API conemap_result conemap_get_format_numbers_at(const conemap_texture *texture, int index,
                                                         conemap_format_numbers *numbers);

/* ======================================================================================================
   S A M P L I N G
   ====================================================================================================== */

/* Height, cone and slope at (u, v), bilinear; cones are interpolated as stored, then decoded, as a shader does; with
   per_cell the cell's own; with sectors the narrowest of them.
   On wrapping axes any finite coordinate is right; on others 0..1, or between the outermost centres with
   CONEMAP_NOTHING. Errors: NULL, POSITION. */
CONEMAP_API conemap_result conemap_sample_at(const conemap_map *map, float u, float v, conemap_sample *sample);

/* ======================================================================================================
   V E R I F Y I N G
   ====================================================================================================== */

/* What conemap_verify found. safe cells = cells - unsafe - unproven. */
typedef struct conemap_report {
    size_t cells;           /* bilinear cells looked at: those between texel centres */
    size_t unsafe;          /* cells in which some interpolated cone holds a point of the surface: with a witness */
    size_t unproven;        /* cells in which neither safety nor a witness was found within the work allowed */
    double worst;           /* deepest penetration among the witnesses, in height units: how far the surface rises
                               above the side of a cone whose apex stands at height + 2^-20 */
    float u, v;             /* where the apex of that cone stands */
} conemap_report;

/* Proves that bilinear sampling of a cone map is safe, or shows where it is not: by bounding whole rectangles of
   apices against whole rectangles of the surface, not by sampling. A cell is safe if for every apex p in it and
   every point q of the surface
       (height(q) - height(p) - 2^-20) tan(p) <= |q - p|
   with tan(p) as conemap_sample_at gives it, but for that sampler's rounding, which the 2^-20 is there for. With
   sectors, each sector's tan(p) has to hold for those q that it sees; with 8 of them and CLAMP or an axis of one texel,
   for those that its quadrant sees where p or q lies in a border cell.

   info: width, height, wrap_u, wrap_v, aspect, max_tan and texture are read. heights, cones: width * height each
   (cones: as many planes as sectors),
   row 0 first, as a texture fetch returns them (cones encoded), of our maps or of anybody's:
       conemap_verify(&map.info, map.heights, map.cones, NULL, &report);
   allocator: null for the default; under 2 bytes a texel (up to 9 on maps of one row or column) are held.
   report: overwritten. OK says only that the report is there; the map is safe if unsafe and unproven are both 0.
   `worst` is the deepest that was found; where the work sufficed, the deepest there is to within 2 % and 2^-20.
   Takes 1 to 10 us a cell on safe maps, more on unsafe ones; cones that follow long even slopes to the last bit
   take the longest and may stay unproven. Where many cells do, less work is put into each of the others.
   Errors: NULL, SIZE, ENUM, PARAMETER (aspect or max_tan as in a desc, but not 0; a cone NaN, infinite or negative),
   HEIGHT, OVERFLOW, MEMORY, ALIGNMENT; the report is then zeroed. Thread-safe; cannot be cancelled. */
CONEMAP_API conemap_result conemap_verify(const conemap_info *info, const float *heights, const float *cones,
                                          const conemap_allocator *allocator, conemap_report *report);

/* ======================================================================================================
   P L A N N I N G
   ====================================================================================================== */

/* What the planner needs to know of a heightmap. The arrays are for rays that move 1/32, 1/8, 1/2 and 2 map widths
   sideways on their way from the top of the box to its floor. */
typedef struct conemap_statistics {
    int width, height;
    float roughness;        /* root mean square difference of texels next to each other over that of heights from their
                               mean: 0 flat or smooth, 1.41 white noise */
    float steps[4];         /* mean steps of 96 rays that probe the map with vertex cones, from texel to texel */
    float safe_steps[4];    /* the same with cones that the neighbours' cones narrow, as safe ones are */
    float cells[4];         /* mean cells that they cross before they hit or leave the map */
    float way[4];           /* and the share of their way through the box that this is */
} conemap_statistics;

/* Looks at every texel of a heightmap once, and sends 768 rays through it that build their cones as they go: about
   10 ns a texel and 20 to 200 ms. Borders count as clamped, aspect as 1.
   heights: as in a desc, only read. statistics: overwritten; zeroed on errors. Allocates nothing; takes 17 KB of stack;
   thread-safe. Errors: NULL, SIZE, ENUM, STRIDE, OVERFLOW, HEIGHT. */
CONEMAP_API conemap_result conemap_get_statistics(const conemap_heights *heights, conemap_statistics *statistics);

/* What a scene needs. */
typedef struct conemap_plan_desc {
    conemap_statistics statistics;
    float depth;            /* how high the box stands over the width of the map, as rays see it; 0: 0.25 */
    float lowest_elevation; /* degrees above the ground of the flattest rays; steeper ones are taken to be as many at
                               every angle. 0: 5. 0.5..90 */
    float max_missed;       /* share of rays that may miss their first hit, 0..1; 0: no bound by misses */
    float max_error;        /* mean error of the hits, in texels along the ray; 0: no bound by error. If neither is
                               given, nothing may be missed and hits are exact */
    float max_steps;        /* budget of steps a ray, as a mean; 0: none */
    float max_time;         /* budget of time a ray, in steps of the default tracer over the default cones; 0: none */
    float rays_per_build;   /* how many rays a build is for: few where heights change every frame; 0: its time is
                               free */
    int no_prepared;        /* nonzero: conemap_trace or a shader traces, not conemap_trace_prepared */
    int no_sectors;         /* nonzero: one cone a texel, which is one texture instead of two or three */
    const conemap_heights *heights; /* only read. Null, or those of the statistics: what may miss is tried on them */
    conemap_allocator allocator; /* for trials; null: CONEMAP_MALLOC and CONEMAP_FREE */
} conemap_plan_desc;

/* What to build and how to trace it, and what that is predicted to take. */
typedef struct conemap_planned {
    conemap_generator generator; /* these five go to the conemap_desc */
    conemap_guarantee guarantee;
    int min3x3;
    conemap_texture texture;
    int keep_pyramid;
    int prepared;           /* nonzero: the map goes to conemap_prepare, and conemap_trace_prepared takes the place of
                               conemap_trace with the next */
    conemap_trace_desc trace;
    float steps;            /* mean of a ray */
    float time;             /* of a ray, in steps of the default tracer over the default cones */
    float build_time;       /* of the map, in the same */
    float missed, error;    /* at most: share of rays, mean texels along the ray */
    int within_budget;      /* zero: nothing that is tolerated fits the budgets; this is the quickest that is
                               tolerated */
} conemap_planned;

/* Chooses generator, guarantee, format, tracer, refinement and step cap: the cheapest that the tolerances allow, by a
   small model fitted to measurements (see PLANS in the implementation, and `accuracy --plans`, which prints predictions
   beside measurements). On a CPU that is the prepared tracer nearly always; a shader's plan needs no_prepared. Steps
   and times are off by a fifth as a mean.
   Without tolerances nothing is missed for certain. With them, bounds of misses and errors are the largest that were
   measured on like maps, times 1.5: cautious, but no proofs. With `heights` they are counted: what is cheapest by the
   model is built and traced with 16384 rays, then the next if that breaks a tolerance; a bound is then the count and
   two standard deviations more. That takes up to eight builds, half a second of rays, and a build's memory.
   Deterministic: nothing is timed. desc: only read. planned: overwritten; zeroed on errors. Errors: NULL, SIZE (also
   heights of another size than the statistics), PARAMETER (statistics that conemap_get_statistics does not give, or a
   field out of its range), and with heights those of conemap_build. Thread-safe. */
CONEMAP_API conemap_result conemap_plan(const conemap_plan_desc *desc, conemap_planned *planned);

/* ======================================================================================================
   T R A C I N G
   ====================================================================================================== */

/* Traces `count` rays; hits[k] answers rays[k]. desc: null for the defaults.
   A ray that is itself invalid gets CONEMAP_INVALID and the others are still traced; the result is that of the
   first such ray. With an invalid desc, a null pointer or a negative count nothing is written.
   What each tracer promises is written beside conemap_tracer, and counted by the tests. */
CONEMAP_API conemap_result conemap_trace(const conemap_map *map, const conemap_trace_desc *desc,
                                         const conemap_ray *rays, conemap_hit *hits, int count);

/* ======================================================================================================
   P R E P A R E D   T R A C I N G

   The same hits, many rays at a time: the map's surface gets a table of its own, 8 bytes for each bilinear cell, from
   which a ray reads how far it may fly into its quadrant; it then needs no cones. Rays are traced side by side, one in
   each lane of the instruction set, and every lane is exact by itself, so the bits depend neither on the instruction
   set nor on which rays are neighbours. Rays that come in a coherent order (an image's pixels) are the fastest.
   ====================================================================================================== */

typedef struct conemap_prepare_desc {
    conemap_isa isa;        /* 0: the best there is. One that conemap_isa_available denies is UNSUPPORTED */
    conemap_allocator allocator; /* null: CONEMAP_MALLOC and CONEMAP_FREE */
    void *memory;           /* caller-owned memory for the table; null: allocate. Must outlive *prepared */
    size_t memory_size;     /* at least conemap_prepare_memory's */
} conemap_prepare_desc;

/* Read-only for the caller. A plain struct, which may be copied or moved: free one copy only. */
typedef struct conemap_prepared {
    const conemap_map *map;
    const uint32_t *table;  /* 2 * width * height words, private in what they hold */
    int width, height;      /* cells; those in the outer half texel of CLAMP belong to their neighbours */
    size_t memory_size;     /* bytes held beside the map */
    double bytes_per_texel; /* the same for a texel of the map: 8 at most */
    conemap_isa isa;        /* never DEFAULT */
    struct {                /* private */
        void *memory;
        int owns_memory;
        conemap_allocator allocator;
    } own;
} conemap_prepared;

/* Rays and hits as arrays, one for each component: what conemap_ray and conemap_hit say of their fields holds. */
typedef struct conemap_ray_arrays {
    const float *origin[3];
    const float *direction[3];
    const float *t_min;     /* null: 0 */
    const float *t_max;     /* null: no end */
} conemap_ray_arrays;

typedef struct conemap_hit_arrays { /* any may be null: not wanted */
    unsigned char *status;  /* a conemap_status */
    unsigned char *inside;
    float *t, *u, *v, *z;
} conemap_hit_arrays;

/* Prepares a map for tracing. Needs heights only: whatever cones a map has or lacks, its prepared tracer misses
   nothing.
   map: stays where it is while *prepared is in use; after conemap_update, prepare again. desc: null for the defaults.
   prepared: overwritten; zeroed unless OK. Takes the table and, during the call, about twice as much again from the
   allocator. Errors: NULL, ENUM, UNSUPPORTED (isa), OVERFLOW (also of an axis beyond 2^21 texels), MEMORY, BUFFER,
   ALIGNMENT. Thread-safe. Source: the max pyramid of [TIS08] and the cones of [Dum06], by quadrant. */
CONEMAP_API conemap_result conemap_prepare(const conemap_map *map, const conemap_prepare_desc *desc,
                                           conemap_prepared *prepared);
/* The bytes of its table; 0 for a null or empty map. */
CONEMAP_API size_t conemap_prepare_memory(const conemap_map *map);
/* Releases what it owns and zeroes it; null and zeroed ones are fine. */
CONEMAP_API void conemap_free_prepared(conemap_prepared *prepared);

/* As conemap_trace with CONEMAP_TRACE_EXACT, and with its promise. t, u, v, z differ by rounding only; steps counts the
   steps of this walk, and fallback is 0. Rays and hits may not overlap. Errors: NULL, PARAMETER (count), and those of
   rays. Any thread; takes 24 KiB of stack. */
CONEMAP_API conemap_result conemap_trace_prepared(const conemap_prepared *prepared, const conemap_ray *rays,
                                                  conemap_hit *hits, int count);
CONEMAP_API conemap_result conemap_trace_arrays(const conemap_prepared *prepared, const conemap_ray_arrays *rays,
                                                const conemap_hit_arrays *hits, int count);

/* ======================================================================================================
   S H A D E R S

   The tracers as text, in the dialect of the host's shaders, holding only what was asked for. Each algorithm is
   written once, in words that all dialects share; the C that the tests run is the same text.

       conemap_shader_desc shader = {0};            // GLSL 330, exact tracer, functions to paste
       shader.dialect = CONEMAP_HLSL_50;
       shader.map = map.info;                       // wrap, format, encoding, layout, guarantee, aspect
       conemap_emit(&shader, NULL, 0, &size);       // the bytes that are needed
       conemap_emit(&shader, text, size, NULL);     // the text, closed by a zero

   A map with sectors has a texture of cones for each four of them (see conemap_texture_count) and one of heights; the
   shader finds the ray's sector once and reads one channel.

   The emitted function takes a ray of the unit box (see CONVENTIONS) and answers with the hit:

       conemap_hit hit = conemap_trace(origin, direction);  // hit.found, hit.t, hit.position (u, v, z)

   and with more options more arguments, in this order: t_min, t_max (t_range); max_steps (run_time_cap); rect (atlas);
   size (a host's fetch without fixed_size); slice (array). A comment at the top of the text says what they are and
   which textures it reads.

   Which guarantee holds. Shaders compute in single precision, and hardware filtering on most GPUs has 8-bit weights, so
   that a filtered height is off by up to 2^-9 of the difference between neighbours.
     - EXACT and MAXMIP read the corners of a cell (FETCH or GATHER) and solve for the patch: nothing is missed but what
       rounding moves the ray: its place is kept as a whole cell and a fraction, so it drifts from the true ray by no
       more than 2^-24 of the way it came in one step, and by half a bit of a fraction for each step. Origins beside the
       map and directions of sensible length (1e-3..1e3) keep their bits.
     - the others promise what they promise on the CPU, with FETCH and GATHER. With HARDWARE they see the surface that
       the texture unit shows, in steps of 1/256 texel: 0.2 % of the pixels of the test maps change by more than 1/16
       texel (`make check` counts them).
   hit.t is added up step by step, so it rounds off by half a bit a step; hit.position does not.
   A map without the bilinear guarantee makes EXACT go back where a cone ended below the surface, as on the CPU.

   Effects. With flags (conemap_effect bits) the text is conemap_shade's, and holds what these need and no line more:

       conemap_shading s = conemap_shade(effects, frame, origin, direction);   // a ray of the world

   with more arguments in this order: t_min, t_max (t_range); gradient (UV, LOD, FADE); rect (atlas); size (a host's
   fetch); slice (array). `effects` is there if one of the flags has settings. The structs are written in the text;
   fields are those of EFFECTS below, but nothing is 0 for a default, and
     - a frame's aspect is the map's; depth is the height scale, level the z of the surface: both may change per draw;
     - effects.light ends with 0 for a direction, 1 for a position; clip_z and clip_w are the rows of the matrix that
       make z and w of the clip position, for depth z / w; where depth is 0.5 + 0.5 z / w (GL's default) hand (z + w) /
       2 as clip_z. Reversed and infinite projections are in the matrix;
     - HOLES read a texture conemap_alpha (one channel, a texel for each of the map's; in GL a host's fetch is joined by
       its float conemap_alpha(i, j)), a texel is a hole below alpha_cut, (128 - 0.5) / 255 for the CPU's default;
     - LOD reads mip k of the map's textures as level k (conemap_build_levels); a host's fetch gets the level last;
     - UV also writes conemap_color(shading), which samples the texture conemap_colors by textureGrad or SampleGrad.
   What is found is shaded; where the step cap of LOD ends a ray, it is found and shaded where it is. CURVED, LOD, HOLES
   and both shadows and SKY need the EXACT tracer, FETCH and cones that are not relaxed; normals and OCCLUSION FETCH;
   LOD neither fixed_size nor atlas; else UNSUPPORTED, as with any_hit, steps, status and run_time_cap. With cones of
   sectors every ray, to a light or the sky as well, reads its own sector's; OCCLUSION the narrowest of all.

   FRAGMENT with effects gets per vertex: conemap_origin (the viewer) and conemap_direction (from there to the vertex,
   so t = 1 at the surface), conemap_frame_tangent, _bitangent and _normal, conemap_point (the vertex in the world),
   conemap_uv; in HLSL TEXCOORD0..6 in this order. Uniforms (Vulkan: the block conemap_block behind the textures; HLSL:
   cbuffer b at `binding`): conemap_settings (the effects), conemap_shape (uv_scale, depth, level), conemap_curvature,
   and the arguments.
   Targets: (u, v, z, t), then of position, normal, colour and (shadow, occlusion, level, fade) those that are asked
   for; and the depth. Fragments that hit nothing are discarded.

   COMPUTE with effects has the same uniforms and reads eight float4 a ray: origin and t_min, direction and t_max,
   tangent, bitangent, normal, point, uv, gradient. It writes the targets side by side, t -1 without a hit, and the
   depth as the first number of one more. Its buffers follow the textures and Vulkan's block.
   ====================================================================================================== */

typedef enum conemap_dialect {
    CONEMAP_GLSL_330 = 0,
    CONEMAP_GLSL_430,
    CONEMAP_GLSL_450,
    CONEMAP_GLSL_450_VULKAN, /* sets, bindings, push constants */
    CONEMAP_ESSL_300,        /* OpenGL ES 3.0, WebGL 2 */
    CONEMAP_ESSL_310,
    CONEMAP_HLSL_50,
    CONEMAP_HLSL_60,
    CONEMAP_C99,             /* for tests, tools and a debugger of the CPU; needs a `fetch`, FUNCTIONS only. Give it a
                                prefix where conemap.h is included */
    CONEMAP_DIALECT_COUNT
} conemap_dialect;

typedef enum conemap_stage {
    CONEMAP_STAGE_FUNCTIONS = 0, /* declarations and functions, to paste behind the host's own #version */
    CONEMAP_STAGE_FRAGMENT,      /* a whole fragment shader: rays from varyings, (u, v, z, t) to the first target, with
                                    steps or status these to the second; what hits nothing is discarded, unless
                                    status is asked for */
    CONEMAP_STAGE_COMPUTE,       /* a whole compute shader, 64 rays a group: two float4 a ray in (origin, t_min;
                                    direction, t_max), a float4 (u, v, z, t, or t = -1) out, and with steps or status a
                                    second (steps, status). Not GLSL 330 and ES 300 */
    CONEMAP_STAGE_COUNT
} conemap_stage;

typedef enum conemap_filter { /* how the surface between texels is read */
    CONEMAP_FILTER_FETCH = 0,    /* four texel fetches, interpolated in the shader */
    CONEMAP_FILTER_GATHER,       /* one gather per channel, the same bits; cones of sectors are fetched all the same.
                                    Not GLSL 330 and ES 300; the sampler wraps as the map does (edge for CLAMP and
                                    NOTHING) */
    CONEMAP_FILTER_HARDWARE,     /* the texture unit's own filter: fast, 8-bit weights. Not for EXACT, MAXMIP, QDM */
    CONEMAP_FILTER_COUNT
} conemap_filter;

typedef enum conemap_precision { /* of floats in ES */
    CONEMAP_HIGHP = 0,
    CONEMAP_MEDIUMP,             /* may be 16 bit: none of the guarantees, maps of a few hundred texels at most */
    CONEMAP_PRECISION_COUNT
} conemap_precision;

typedef enum conemap_depth_bound { /* a promise that keeps early depth tests: see conemap_depth */
    CONEMAP_DEPTH_ANY = 0,
    CONEMAP_DEPTH_GREATER,       /* never less than the polygon's: layout(depth_greater), SV_DepthGreaterEqual */
    CONEMAP_DEPTH_LESS,          /* never greater. Neither in GLSL 330 and ES */
    CONEMAP_DEPTH_BOUND_COUNT
} conemap_depth_bound;

typedef struct conemap_shader_desc {
    conemap_dialect dialect;
    conemap_stage stage;
    conemap_trace_desc trace;  /* as on the CPU, with bounded loops: max_steps 0: LINEAR 200, LOOP 20, others as many as
                                  a ray can need that does not wrap, and 16 times that if it does. any_hit: EXACT and
                                  MAXMIP; the function is then `bool conemap_any_hit(...)` */
    conemap_info map;          /* what the texture holds: a built map's info, or zero: clamped, (height, tan), f32,
                                  bilinear guarantee, aspect 1, max_tan 1. generator, slack and hash don't matter */
    int fixed_size;            /* nonzero: map.width and map.height are written as constants */
    conemap_filter filter;

    int steps, status;         /* nonzero: hit.steps, hit.status (the numbers of conemap_status) for debugging */
    int t_range;               /* nonzero: the ray is followed from t_min to t_max, else from 0 without end */
    int run_time_cap;          /* nonzero: max_steps is an argument */
    int atlas;                 /* nonzero: the map is a rectangle (x, y, width, height in texels) of the texture, an
                                  argument. FETCH only; not with fixed_size, MAXMIP or QDM */
    int array;                 /* nonzero: the textures are arrays; slice is an argument */

    conemap_precision precision;
    int external;              /* nonzero: the host declares the textures and the sampler itself; FUNCTIONS only */
    int set, binding, sampler_binding; /* the first texture's; further ones follow. Binding: GLSL 430 and up, ES 310,
                                  HLSL (registers t and s). Set: Vulkan; HLSL 6.0 (space) */
    const char *prefix;        /* of every emitted name; null: "conemap" */
    const char *map_name;      /* textures and sampler; null: prefix_map, prefix_octants, prefix_heights, prefix_maxima,
                                  prefix_sampler */
    const char *octants_name;  /* 8 sectors: the map's second texture */
    const char *heights_name;  /* CONE_ONLY and sectors: the heights, in the first channel; the host's or the map's */
    const char *maxima_name;   /* MAXMIP, QDM: see conemap_write_maxima */
    const char *sampler_name;  /* HLSL, with GATHER and HARDWARE */
    const char *fetch;         /* null: from the textures; or a function of the host, which gets whole texels inside the
                                  map, `vec2 NAME(int i, int j)`, or with HARDWARE `vec2 NAME(float u, float v)`: height
                                  and stored cone; without cones (LINEAR, MAXMIP, QDM) and with sectors `float
                                  NAME(...)`. Plus slice with array. Not with GATHER; with HARDWARE not per_cell */
    const char *fetch_cones;   /* sectors, with fetch: the stored cone, `float NAME(int i, int j, int sector)`, or with
                                  HARDWARE `float NAME(float u, float v, int sector)` */
    const char *fetch_maxima;  /* MAXMIP, QDM: the same for the maxima, `float NAME(int i, int j, int level)` */
    unsigned flags;            /* conemap_effect bits: conemap_shade as text, see below. 0: conemap_trace alone */
    conemap_depth_bound depth_bound; /* CONEMAP_EFFECT_DEPTH in FRAGMENT: what is promised of the depth */
} conemap_shader_desc;

/* Writes a shader.
   text: receives the text and a closing zero, `capacity` bytes at most; null: only the size is asked for.
   size: if not null, receives the bytes needed, the zero included, whenever the desc is valid.
   Errors, all without a byte written: NULL (desc, or both pointers); BUFFER (capacity below the size); ENUM; PARAMETER
   (a number out of range; a name that is no identifier, equals another or is a word of the text itself); UNSUPPORTED
   (the dialect lacks it, or two options exclude each other). The same desc gives the same text. Thread-safe, allocates
   nothing. */
CONEMAP_API conemap_result conemap_emit(const conemap_shader_desc *desc, char *text, size_t capacity, size_t *size);

/* The texture that MAXMIP and QDM read: maxima over bilinear cells, a square of 2^n texels, n levels below it.
   conemap_maxima_levels returns n + 1 (0: no map); level k has 2^(n - k) texels on a side. conemap_write_maxima writes
   one level as f32, rows touching; blocks beyond the map hold 0. The map must have been built with keep_pyramid.
   Errors: NULL, NO_PYRAMID, PARAMETER (level), BUFFER. */
CONEMAP_API int conemap_maxima_levels(const conemap_map *map);
CONEMAP_API conemap_result conemap_write_maxima(const conemap_map *map, int level, float *values, size_t size);

/* Cone maps made on the GPU: a few kernels, each a text of its own, and a list that says in what order to run them.
   Every pass reads textures and writes one value for each texel of one, so it can be a compute dispatch or, for WebGL 2
   and ES 3.0, a full-screen draw (the viewport is the pass's width x height). The state is a one-channel f32 texture,
   in two copies that passes read and write by turns; before the first pass the one that it reads holds 0. The maxima
   are one more, a square of 2^n texels that holds the map, with n levels below it, the smallest of one texel: over
   texels for generation, over bilinear cells for the tracers that walk over them (conemap_write_maxima's, to the bit).

   With desc->map.guarantee VERTEX what comes out are vertex cones as desc->map.generator makes them on the CPU, to
   within float rounding, and where that makes conservative ones never wider; else, with the SAFE pass, cones with
   CONEMAP_GUARANTEE_BILINEAR. Source: [VB22], and the branch and bound of CONEMAP_EXACT. */
typedef enum conemap_kernel {
    CONEMAP_KERNEL_RING = 0, /* steepest slope, squared, to the texels of rings first..last [Dum06]: needs the heights
                                and the state, writes the state */
    CONEMAP_KERNEL_MIN3X3,   /* of each 3x3 block the narrowest cone [BV24 eq. 2]: state to state */
    CONEMAP_KERNEL_SAFE,     /* vertex cones made safe for the bilinear surface, at once and not tightly: the steepest
                                slope of the 3x3 block times sqrt(2) on square texels, more on long ones. About 62 % of
                                the vertex cones' width is left on the test maps. Needs the heights and the state,
                                writes the state */
    CONEMAP_KERNEL_STORE,    /* state to the texture: encoded and rounded down, with the heights and slopes of its
                                layout */
    CONEMAP_KERNEL_CELLS,    /* level 0 of the maxima over bilinear cells: needs the heights */
    CONEMAP_KERNEL_TEXELS,   /* level 0 of the maxima over texels: needs the heights */
    CONEMAP_KERNEL_MAXIMA,   /* any further level: needs those below, and shall see no other where an API forbids to
                                read a texture that is written (a draw of OpenGL: TEXTURE_MAX_LEVEL; a view
                                elsewhere) */
    CONEMAP_KERNEL_QUICK,    /* [VB22]: Algorithm 2, or 1 or the centre heuristic by desc->map.generator, the diagonals
                                of 2 mended. Needs the heights and the maxima over texels, writes the state */
    CONEMAP_KERNEL_EXACT,    /* steepest slope, squared, to texels of blocks first..last of `level`, counted row by row,
                                by branch and bound, nearest blocks first: needs the heights, the maxima over texels and
                                the state, writes the state */
    CONEMAP_KERNEL_COUNT
} conemap_kernel;

/* One pass. Between passes the host waits for the writes of the one before (a barrier, or the next draw's order). */
typedef struct conemap_gpu_pass {
    conemap_kernel kernel;
    int first, last;     /* RING, EXACT: the arguments conemap_first and conemap_last */
    int level;           /* CELLS, TEXELS, MAXIMA: the level that is written; MAXIMA, EXACT: the argument
                            conemap_level */
    int reads, writes;   /* copies of the state, 0 and 1; writes 2: the texture; writes 3: a level of the maxima */
    int width, height;   /* of what is written, in texels */
    int groups_x, groups_y; /* of 8 x 8 threads */
} conemap_gpu_pass;

/* Writes a kernel. desc: dialect, stage, map (wraps, aspect, max_tan, texture, generator), fixed_size, prefix, binding,
   set, sampler_binding, heights_name (default prefix_heights), map_name (the state read; default prefix_state),
   maxima_name, precision, fetch and, for the state, fetch_cones, both `float NAME(int i, int j)`, and fetch_maxima;
   other fields are ignored. Bindings follow each other in the order state, heights, maxima, as far as there are any,
   and in GLSL what is written. Not for maps with sectors. FUNCTIONS are
       float conemap_ring(int i, int j, int first, int last[, ivec2 size])
       float conemap_steepest(int i, int j[, ivec2 size])
       float conemap_safe(int i, int j[, ivec2 size])
       float conemap_stored(int i, int j[, ivec2 size])     the cone channel; conemap_texel(i, j[, size]) is the height
       float conemap_highest(int i, int j[, ivec2 size])    CELLS
       float conemap_padded(int i, int j[, ivec2 size])     TEXELS
       float conemap_four(int i, int j, int level)          MAXIMA
       float conemap_quick(int i, int j[, ivec2 size])
       float conemap_exact(int i, int j, int first, int last, int level[, ivec2 size])
   Otherwise as conemap_emit. */
CONEMAP_API conemap_result conemap_emit_kernel(const conemap_shader_desc *desc, conemap_kernel kernel, char *text,
                                               size_t capacity, size_t *size);

/* The passes that make a map of desc->map.width x height by desc->map.generator (0 and EXACT: branch and bound; RING;
   the four QUICK ones): MIN3X3 among them if desc->map.min3x3 is set, SAFE unless desc->map.guarantee is VERTEX or
   NONE. With desc->trace.tracer MAXMIP or QDM: the passes that make the maxima which these read. batch: texels and
   blocks that one invocation looks at in a pass at the worst, so that no dispatch runs long; 0: 4096. RING stops early
   and EXACT prunes, so most look at far fewer. passes: null asks for the count alone. Errors: NULL, ENUM, SIZE,
   PARAMETER (batch below 0), UNSUPPORTED (other generators, sectors), BUFFER (capacity below the count; nothing is
   written). */
CONEMAP_API conemap_result conemap_gpu_passes(const conemap_shader_desc *desc, int batch, conemap_gpu_pass *passes,
                                              int capacity, int *count);

/* ======================================================================================================
   F R U S T A

   Skeletons skinned with relief-mapped conical frusta [BJCW09]: trees, cacti, columns, tentacles. Joints and the
   segments between them go in; for each segment a frustum comes out that is cut obliquely so that neighbours meet, with
   texture coordinates and normals that go on across joints, packed for a GPU buffer and ready to ray-cast here. Joints
   may move every frame: conemap_skeleton_update allocates nothing.

   A frustum's own frame has its origin in the base joint and y along the axis, up to the top joint at y = h. Its inner
   surface, where the relief has height 0, is
       x^2 + z^2 = (r + k y)^2,  r + k y >= 0
   with k = (r_top - r) / h: the quadric of [BJCW09 eq. 1] without its apex, so a cylinder (k = 0) is nothing special,
   and without the mirrored nappe. The shell above it is t + tk y thick; at relative height w of 0..1 it holds the cone
   of radius r + w t + (k + w tk) y. The cutting planes are y = a x + b z + c, so one that is parallel to the axis
   cannot be said; limits on the slope keep it far from that.

   u is the angle around the axis in turns, 0 towards z and 1/4 towards x; v goes from 0 at the lower cut to 1 at the
   upper one along the straight line through the point on its own cone [BJCW09 eq. 7]. The map is sampled at
   ((u + v twist) u_repeat, v_start + v v_size): it must wrap in u, and may wrap or clamp in v.

   Every frustum is a solid, closed by its cutting planes, and the skeleton is their union, so nothing is ever seen
   through a joint. Where a segment ends freely that plane is a cap. Of the segments that leave a joint the thickest
   (among equals the straightest, then the first) continues its parent: both are cut by one plane, the medial plane
   construction of [BJCW09 eqs. 3-5]. The others are branches: they begin inside the parent, with a normal that `blend`
   can mix with the parent's. Which is which is settled by the joints as built, and stays.

   Limits. At a bent joint of tapered segments the two cuts share one axis only ([BJCW09 section 2.2]; see fit_steps),
   and u agrees exactly at u = 0 alone; elsewhere it is off by about taper times bend (in the tests, with segments that
   halve their radius and bends of 20 degrees, 0.026 turns at most). Bends beyond 140 degrees, and
   segments too short for their bends, get planes of their own, flagged, and show a notch. Branches meet their parent in
   a crease, which `blend` hides from the light but not from the outline. Cross-sections are round.
   ====================================================================================================== */

typedef struct conemap_joint {
    float position[3];      /* in the world's units; up to 1e12 */
    float radius;           /* of the inner frustum, where relief height is 0. 0 or more: 0 is a point */
    float thickness;        /* of the shell: what relief height 1 adds to the radius. 0 or more: 0 is no relief */
} conemap_joint;

typedef struct conemap_segment {
    int base, top;          /* the joints it joins */
    int parent;             /* the segment whose top joint is this one's base; below 0: none, a root */
    int u_repeat;           /* how often the map goes around; 0: 1. Up to 4096. Equal along a chain, or u jumps */
    float twist;            /* turns of the texture from base to top. -1024..1024 */
    float radius;           /* at the base, for a branch thinner than its joint; 0: the joint's. The thickness shrinks
                               as the radius does */
    float v_size;           /* of the map along the segment; 0: see v_per_length of the desc */
    int user;               /* handed through to conemap_frustum: a material */
} conemap_segment;

enum { /* conemap_frustum.flags */
    CONEMAP_FRUSTUM_ROOT = 1,    /* the base ends freely */
    CONEMAP_FRUSTUM_BRANCH = 2,  /* the base lies inside the parent, uncut */
    CONEMAP_FRUSTUM_TIP = 4,     /* the top ends freely */
    CONEMAP_FRUSTUM_CLAMPED_LOWER = 8,  /* a cutting plane is tilted less than its joint asks for, because the bend */
    CONEMAP_FRUSTUM_CLAMPED_UPPER = 16, /* is too sharp or the planes would meet inside: the joint may show a notch */
    CONEMAP_FRUSTUM_C1 = 32      /* conemap_skeleton_desc.c1_normals */
};

/* One segment as packed for the GPU: nine 16-byte rows, so std430, std140 and HLSL structured buffers agree. A point
   goes into the frustum's frame as (dot(axis_x, p - o), dot(axis_y, p - o), dot(axis_z, p - o)) with the origin o =
   (axis_x[3], axis_y[3], axis_z[3]). Nothing that reads a frustum relies on the rows' length: they may be scaled for
   elliptical cross-sections, though conemap_skeleton_build makes round ones only. */
typedef struct conemap_frustum {
    float axis_x[4];        /* unit x axis; origin's x */
    float axis_y[4];        /* unit y axis; origin's y */
    float axis_z[4];        /* unit z axis; origin's z */
    float lower[4];         /* a, b, c of the lower cutting plane y = a x + b z + c; slope of the normal there */
    float upper[4];         /* the same of the upper plane */
    float r, k;             /* inner radius at y = 0, and what it grows by per y */
    float t, tk;            /* thickness of the shell at y = 0, and what it grows by per y */
    float h;                /* length of the axis */
    float v_start, v_size;  /* the map's v at the lower cut, and from there to the upper one */
    float twist;            /* turns from the lower cut to the upper one */
    int32_t parent, child;  /* segments before and after it; negative: none. child is the one that continues it */
    int32_t branch, sibling;/* the first branch that leaves its top; the next branch that leaves its base */
    int32_t flags;          /* CONEMAP_FRUSTUM_... */
    int32_t u_repeat;
    int32_t user;
    int32_t reserved;       /* 0 */
} conemap_frustum;

/* A skeleton and how to skin it. */
typedef struct conemap_skeleton_desc {
    const conemap_joint *joints;     /* read during the call */
    int joint_count;
    const conemap_segment *segments; /* read during the call; parents may come in any order */
    int segment_count;      /* 1 or more */
    int fit_steps;          /* rounds of [BJCW09 section 2.2]'s fit, which changes a segment's base radius until the
                               minor axes of the two cuts agree; 0: none. Up to 64 */
    float v_per_length;     /* v for each unit of a segment's length as built, carried on from parent to child;
                               0: each segment begins at 0, and spans 1 where it says no v_size. 0 or more */
    int slope_normals;      /* 0: [BJCW09 eq. 8]; nonzero: its end normals lean with the mean slope of the two cones
                               that meet, which is C0 as well and nearer to the surface (domes, tips) */
    int c1_normals;         /* nonzero: end normals are mixed by v^2 (3 - 2 v) instead of v, so that normals are C1
                               across joints as functions of (u, v); they change faster mid-segment */
    float blend;            /* how far from a branch's foot its normals and its parent's mix, in radii of its base;
                               0: not at all, a crease. Up to 16 */
    conemap_allocator allocator; /* null: CONEMAP_MALLOC and CONEMAP_FREE */
    void *memory;           /* caller-owned memory for the skeleton; null: allocate. Must outlive the skeleton */
    size_t memory_size;     /* at least what conemap_skeleton_memory says */
} conemap_skeleton_desc;

/* A skinned skeleton. Read-only for the caller; free it with conemap_skeleton_free. May be copied or moved: free one
   copy only. */
typedef struct conemap_skeleton {
    const conemap_frustum *frusta; /* one a segment, in the caller's order: count * sizeof(conemap_frustum) bytes to
                                      upload */
    int count;
    int clamped;            /* frusta with a CONEMAP_FRUSTUM_CLAMPED_... flag, as of the last update */
    float low[3], high[3];  /* a box around all shells */
    size_t memory_size;     /* bytes held */
    struct {                /* private */
        void *memory;
        int owns_memory;
        conemap_allocator allocator;
        int joint_count, fit_steps, slope_normals, nodes;
        float blend;
        conemap_frustum *frusta;
        struct conemap__bone *bones;
        struct conemap__branch *tree;
        int *order;         /* segments chain by chain, parents first */
        int *leaves;        /* segments as the tree's leaves name them */
        float (*boxes)[6];
    } build;
} conemap_skeleton;

typedef enum conemap_march { /* how a ray goes through the shell */
    CONEMAP_MARCH_DEFAULT = 0, /* CONES, or STEPS with linear_v or over relaxed cones */
    CONEMAP_MARCH_STEPS,     /* equal steps, then bisection, as the paper */
    CONEMAP_MARCH_CONES,     /* cone steps over the map's cones, never shorter than an equal step: with the bilinear
                                guarantee only those that had to be made longer can pass over anything */
    CONEMAP_MARCH_COUNT
} conemap_march;

typedef struct conemap_skeleton_trace_desc {
    const conemap_map *map; /* the relief, wrapping in u, wrapping or clamped in v; null: plain frusta */
    float height;           /* without a map: the plain surface's height in the shell, 0..1; 0: the inner frustum */
    conemap_march march;    /* CONEMAP_MARCH_CONES: not with relaxed cones */
    int steps;              /* equal steps from shell entry to exit; 0: 64 with STEPS, 256 with CONES. Up to 2^20 */
    int refine_steps;       /* halvings of the last step; 0: 10. Up to 64 */
    int linear_v;           /* nonzero: v is interpolated from shell entry to exit as the paper does, in one more piece
                               for every 45 degrees between the cutting planes; not with MARCH_CONES. 0: exact */
    int any_hit;            /* nonzero: stop at any hit, for shadows: of the hit only status, segment and t are told */
} conemap_skeleton_trace_desc;

typedef struct conemap_skeleton_hit {
    conemap_status status;  /* HIT; LEFT: met nothing; T_MAX: met nothing before t_max; INVALID */
    int inside;             /* nonzero: the ray began inside; t is then t_min */
    int segment;            /* that was hit; -1: none */
    int cap;                /* nonzero: the flat end of a segment: 1 lower, 2 upper */
    float t;                /* along the ray, in lengths of its direction */
    float position[3];
    float u, v, w;          /* of the frustum; v 0..1, w the height in the shell */
    float map_u, map_v;     /* of the map: u with the twist, neither wrapped */
    float normal[3];        /* unit, for shading: continuous across joints, with the relief's slope */
    float true_normal[3];   /* unit, of the surface as it was traced */
    int steps;              /* samples of the relief along the whole ray */
} conemap_skeleton_hit;

/* The bytes that conemap_skeleton_build needs. Checks the counts only. Errors: NULL, SIZE (a count below 1 or above
   2^28), OVERFLOW. */
CONEMAP_API conemap_result conemap_skeleton_memory(const conemap_skeleton_desc *desc, size_t *memory_size);

/* Skins a skeleton. skeleton: overwritten, whatever it held; zeroed unless OK.
   Errors: NULL, SIZE, OVERFLOW, PARAMETER (a field of desc or of a segment out of range, a position beyond 1e12),
   JOINT (a joint's position, radius or thickness is NaN or infinite, or a segment's joint does not exist), RADIUS
   (negative, or zero at both ends of a segment without shell), LENGTH (a segment shorter than 1e-6 of its greatest
   radius or of its distance from the world's origin), PARENT (it does not exist, or does not end where the segment
   begins), CYCLE, MEMORY, BUFFER, ALIGNMENT.
   Thread-safe for different skeletons. Source: [BJCW09 section 2]. */
CONEMAP_API conemap_result conemap_skeleton_build(const conemap_skeleton_desc *desc, conemap_skeleton *skeleton);

/* The same skeleton with its joints moved: frusta, bounds and box are brought up to date. Allocates nothing, in time
   proportional to the segments. joints: as many as it was built with. v_start and v_size stay as built, so that
   textures do not swim along stretching segments; u is carried along with the least rotation from the root outward.
   Errors: NULL, PARAMETER, JOINT, RADIUS, LENGTH; the skeleton is then as it was. Nothing else may use it meanwhile.
   */
CONEMAP_API conemap_result conemap_skeleton_update(conemap_skeleton *skeleton, const conemap_joint *joints);

/* Releases what the skeleton owns and zeroes it. Null and zeroed skeletons are fine. Caller-owned memory stays. */
CONEMAP_API void conemap_skeleton_free(conemap_skeleton *skeleton);

/* The bounding pyramidal frustum of the whole shell [BJCW09 section 2.6], to rasterise: eight corners, the lower four
   first, each four in the order (-,-) (+,-) (+,+) (-,+) of x and z. The proof that it holds the shell is in the
   implementation.
   conemap_frustum_triangles: twelve triangles of corners, counter-clockwise seen from outside where axis_x, axis_y
   and axis_z are right-handed, as conemap_skeleton_build makes them. Errors: NULL. */
CONEMAP_API conemap_result conemap_frustum_corners(const conemap_frustum *frustum, float corners[8][3]);
CONEMAP_API const unsigned char *conemap_frustum_triangles(void); /* 36 indices */

/* (u, v, w) of a point of the world in a frustum's parametrisation, u in 0..1, v and w unclamped; without a shell w
   is the distance from the surface. And back: the point at (u, v, w), u of any size; v and w far outside 0..1 may
   have none and give PARAMETER, as do NaN and infinities. On the axis u is 0. Errors: NULL, POSITION (a coordinate is
   NaN or infinite), PARAMETER. */
CONEMAP_API conemap_result conemap_frustum_uvw(const conemap_frustum *frustum, const float point[3], float uvw[3]);
CONEMAP_API conemap_result conemap_frustum_point(const conemap_frustum *frustum, const float uvw[3], float point[3]);

/* Where a ray is inside a frustum whose surface stands at a height of 0..1 in its shell, cutting planes included:
   enters at span[0], leaves at span[1], both within the ray's t_min and t_max (span[1] infinite where a ray never
   leaves); span[0] > span[1]: nowhere. Errors: NULL, PARAMETER (height), those of a ray. */
CONEMAP_API conemap_result conemap_frustum_span(const conemap_frustum *frustum, float height, const conemap_ray *ray,
                                                float span[2]);

/* Traces `count` rays of the world against a skeleton; hits[k] answers rays[k]. desc: null for plain inner frusta.
   An invalid ray gets CONEMAP_INVALID and the others are still traced; the result is that of the first such ray. With
   an invalid desc, a null pointer or a negative count nothing is written. Errors: NULL, PARAMETER, ENUM, UNSUPPORTED
   (a map that does not wrap in u or ends with NOTHING in v; cone steps over relaxed cones or with linear_v), those of
   rays.
   Any number of threads may trace one skeleton. Source: [BJCW09 sections 2.5 and 3]. */
CONEMAP_API conemap_result conemap_skeleton_trace(const conemap_skeleton *skeleton,
                                                  const conemap_skeleton_trace_desc *desc, const conemap_ray *rays,
                                                  conemap_skeleton_hit *hits, int count);

/* Frusta on the GPU: shaders that draw the packed frusta of a skeleton as they are traced here, [BJCW09 section 4] with
   the bounds made in the vertex stage. There are no vertex buffers: upload skeleton.frusta (144 bytes each, after every
   update), draw 36 vertices an instance, one instance a frustum, with one winding culled and the depth test on:

       conemap_frusta_shader_desc shader = {0};     // GLSL 330, plain frusta
       shader.relief = 1;                           // and with the relief of a map that wraps in u
       shader.map = map.info;
       shader.stage = CONEMAP_FRUSTA_VERTEX;        // then CONEMAP_FRUSTA_FRAGMENT
       conemap_emit_frusta(&shader, NULL, 0, &size);
       conemap_emit_frusta(&shader, text, size, NULL);

   FUNCTIONS to paste are
       conemap_frustum_hit conemap_trace_frusta(int first, int count, vec3 origin, vec3 direction, float t_min, float
       t_max)
       conemap_frustum_hit conemap_see_frustum(int frustum, vec3 place, vec4 eye)   what a pixel of the bounds sees; t
                                                         counts from the eye, for parallel rays from the bounds
       vec3 conemap_bounds(int frustum, int number)      vertex 0..35 of the bounds, in the frustum's frame: `place`
   or with any_hit, in place of the first two, bool conemap_any_frusta(...), arguments as those of conemap_trace_frusta.

   Single precision. Rays are followed in the frustum's own frame, from the bounds on where they were drawn, so that an
   error is a few 2^-24 of the frustum's size and its shell's, however far away the eye is. conemap_trace_frusta begins
   at the ray's origin: 2^-24 of its distance. Directions of sensible length (1e-3..1e3). Neighbours overlap by 1e-6 of
   their size, so that rounding opens no gap between them. Rows may be scaled for elliptical sections, as on the CPU. */
typedef enum conemap_frusta_stage {
    CONEMAP_FRUSTA_FUNCTIONS = 0, /* to paste behind the host's own #version */
    CONEMAP_FRUSTA_VERTEX,        /* a whole vertex shader */
    CONEMAP_FRUSTA_FRAGMENT,      /* a whole fragment shader, with depth: see `shade` */
    CONEMAP_FRUSTA_STAGE_COUNT
} conemap_frusta_stage;

typedef enum conemap_frusta_source { /* what the frusta are read from, always as integers (floats can lose small
                                        ones) */
    CONEMAP_FRUSTA_DEFAULT = 0,  /* BUFFER, but TEXELS in GLSL 330 and HLSL 5.0, TEXTURE in ES */
    CONEMAP_FRUSTA_BUFFER,       /* storage buffer (std430), structured buffer. Not GLSL 330, ES 300, HLSL 5.0 (some of
                                    its compilers refuse them beside SV_Depth) */
    CONEMAP_FRUSTA_UNIFORMS,     /* uniform block (std140), constant buffer */
    CONEMAP_FRUSTA_TEXTURE,      /* RGBA32I texture: nine texels a frustum, floor(width / 9) frusta a row. Not HLSL */
    CONEMAP_FRUSTA_TEXELS,       /* buffer texture, Buffer<int4>, RGBA32I. Not ES */
    CONEMAP_FRUSTA_SOURCE_COUNT
} conemap_frusta_source;

typedef struct conemap_frusta_shader_desc {
    conemap_dialect dialect;     /* C99: FUNCTIONS with fetch_frusta, and a prefix where conemap.h is included */
    conemap_frusta_stage stage;
    conemap_frusta_source source;
    int uniform_count;           /* UNIFORMS: frusta in the block; 0: 113, which are 16 KiB. 1..455 */

    int relief;                  /* nonzero: the relief of `map`; 0: plain frusta */
    conemap_info map;            /* what the texture holds: a built map's info. Wraps in u, wraps or clamps in v */
    int fixed_size;              /* nonzero: map.width and map.height are written as constants */
    conemap_filter filter;       /* GATHER: not GLSL 330, ES 300. HARDWARE: a sampler that wraps as the map does, 8-bit
                                    weights. Both not per_cell */
    float height;                /* without relief: as in conemap_skeleton_trace_desc, like these: */
    conemap_march march;
    int steps, refine_steps, linear_v;
    int any_hit;                 /* FUNCTIONS */
    float blend;                 /* conemap_skeleton_desc.blend; 0: creases, and far fewer reads */

    const char *shade;           /* FRAGMENT: a function of the host, `vec4 NAME(conemap_frustum_hit hit)`, whose answer
                                    goes to the target. Null: to the first target the shading normal and the height w in
                                    the shell, to the second u and v of the map, the frustum, and t */
    int depth_only;              /* FRAGMENT, nonzero: no target, for shadow maps */
    int zero_to_one;             /* nonzero: OpenGL with clip space z in 0..1 (glClipControl) */

    int set, binding, sampler_binding; /* as in conemap_shader_desc: the map's textures, then the frusta. HLSL: constant
                                    buffers are registers b: UNIFORMS, then the camera. Vulkan: it is push constants */
    const char *prefix;          /* of every emitted name; null: "conemap" */
    const char *frusta_name;     /* null: prefix_frusta */
    const char *map_name, *heights_name, *sampler_name; /* as in conemap_shader_desc */
    const char *fetch;           /* FUNCTIONS: as in conemap_shader_desc; with fixed_size, FETCH */
    const char *fetch_frusta;    /* FUNCTIONS: row 0..8 of a frustum, `ivec4 NAME(int frustum, int row)` */
} conemap_frusta_shader_desc;

/* Writes a shader, in the way and with the errors of conemap_emit. UNSUPPORTED too: a map that does not wrap in u or
   ends with NOTHING in v; cone steps over relaxed cones or with linear_v; a map with sectors. Thread-safe, allocates
   nothing. */
CONEMAP_API conemap_result conemap_emit_frusta(const conemap_frusta_shader_desc *desc, char *text, size_t capacity,
                                               size_t *size);

/* ======================================================================================================
   E F F E C T S

   What a picture of relief needs besides the first hit, each effect by itself: an effect that is not asked for costs
   nothing. Frames put the relief on a surface of the world; conemap_shade traces world rays through it and answers what
   its flags ask for. Depth and level belong to the frame and may change with every call, without a rebuild.

   What a host gets at the map's border, which makes the relief's silhouette:
       CONEMAP_CLAMP, CONEMAP_NOTHING   a ray that flies out over the border has LEFT: discard the fragment. One that
                                        meets the side of the solid has HIT with `inside`: draw it (a block) or
                                        discard it (a sheet)
       CONEMAP_WRAP                     tiles without end: the silhouette is the polygon's, or that of
                                        CONEMAP_EFFECT_CLIP (a floor of 4 x 3 tiles: clip 0, 0, 4, 3)
   ====================================================================================================== */

/* The effects, bit by bit. Cost: time on the CPU relative to conemap_trace with the defaults, whose own is 1; `make
   bench BENCH=effect` measures it. Any effect at all costs 0.04 for the frame. conemap_emit writes each as a shader
   too: `make check CHECK=effects` counts the instructions that it adds, and its time on a software GPU, which is the
   CPU's or less for all but HOLES (0.7) and SKY (6 for each direction). */
typedef enum conemap_effect {
    /* -- how rays are traced -- */
    CONEMAP_EFFECT_CLIP = 1 << 0,        /* the relief ends at a rectangle of uv. Nothing */
    CONEMAP_EFFECT_HOLES = 1 << 1,       /* rays pass through texels whose alpha is low, down to the floor; holes have
                                            solid sides. 0.3, more where many are hit */
    CONEMAP_EFFECT_CURVED = 1 << 2,      /* the base surface bends: silhouettes of balls and barrels. 0.3 */
    CONEMAP_EFFECT_LOD = 1 << 3,         /* coarser levels where texels are smaller than pixels, blended, so that none
                                            pops. 1 at level 0.5, nothing at 3.5, a gain beyond */
    CONEMAP_EFFECT_FADE = 1 << 4,        /* relief that is lower than a pixel flattens into a normal map. A gain: where
                                            all has faded 0.2 is left of the trace */
    CONEMAP_EFFECT_TWO_SIDED = 1 << 5,   /* seen from behind, the frame's normal turns to the viewer. Nothing */
    /* -- what is known of a hit -- */
    CONEMAP_EFFECT_POSITION = 1 << 6,    /* world position. Nothing */
    CONEMAP_EFFECT_NORMAL = 1 << 7,      /* world normal of the bilinear cell: facets. Four texels, 0.2 */
    CONEMAP_EFFECT_SMOOTH_NORMAL = 1 << 8, /* world normal of the derivatives that CONEMAP_DUMMER stores, interpolated:
                                            no facets. Instead of NORMAL. 0.3; on the GPU a fetch */
    CONEMAP_EFFECT_DEPTH = 1 << 9,       /* corrected depth, so that relief and scene cut each other. Nothing;
                                            on the GPU early depth tests, see conemap_depth */
    CONEMAP_EFFECT_SHADOW = 1 << 10,     /* 0 or 1: the relief's shadow on itself, exact. One more trace, 0.7 */
    CONEMAP_EFFECT_SOFT_SHADOW = 1 << 11, /* 0..1: the share of the light's disc that is seen. Five traces, more in
                                            penumbras: 3 to 15. Instead of SHADOW */
    CONEMAP_EFFECT_OCCLUSION = 1 << 12,  /* 0..1: how much of the sky is seen, guessed from the cone. 0.3 */
    CONEMAP_EFFECT_SKY = 1 << 13,        /* 0..1: the same by horizons in a number of directions:
                                            5 to 8 for each. Bake it if you can. Instead of OCCLUSION */
    CONEMAP_EFFECT_UV = 1 << 14,         /* displaced uv, and the surface's own gradients, for colour maps. Nothing */
    CONEMAP_EFFECT_ALL_BITS = (1 << 15) - 1
} conemap_effect;

/* How relief lies on a surface. World: any length units and handedness. Zeroed: the unit box itself.
       u = uv_offset[0] + uv_scale[0] x              x, y: along tangent and bitangent from the origin
       v = uv_offset[1] + uv_scale[1] y / aspect
       world = origin + tangent x + bitangent y + normal (depth (z - level) - bend(x, y))
   The vectors need be neither unit nor perpendicular; a mirrored frame is fine. */
typedef struct conemap_frame {
    float origin[3];        /* where the base surface has uv_offset */
    float tangent[3], bitangent[3], normal[3]; /* world per x, y and height; all nine 0: the world's axes */
    float uv_offset[2];
    float uv_scale[2];      /* map widths per unit of x, and of y; 0: 1 */
    float aspect;           /* metres per v over metres per u, as the map's; 0: 1. 2^-15..2^15 */
    float depth;            /* how high z = 1 stands over z = 0, in normals; 0: 1. Above 0 */
    float level;            /* 0..1: the z at which the surface lies: 0 relief rises from it, 1 it sinks below it */
    float curvature[3];     /* CONEMAP_EFFECT_CURVED: xx, xy, yy, per unit of x and y: the surface bends away from its
                               normal by bend = (xx x^2 + 2 xy x y + yy y^2) / 2. A ball of radius r: 1/r, 0, 1/r. See
                               conemap_shade for what the quadric is good for */
} conemap_frame;

/* Turns a ray of the world into the box, at the same t: a hit's t and t_before hold for both. Curvature is not
   looked at.
   Errors: NULL, PARAMETER (a frame's number out of range, or its vectors lie in a plane). */
CONEMAP_API conemap_result conemap_frame_ray(const conemap_frame *frame, const conemap_ray *world, conemap_ray *box);

/* The world position of (u, v, z) of the box, curvature included. Errors: as conemap_frame_ray. */
CONEMAP_API conemap_result conemap_frame_point(const conemap_frame *frame, const float box[3], float world[3]);

/* The world's unit normal, on the outer side, of a surface that has these slopes at (u, v) of the box:
   conemap_sample_at's, or conemap_smooth_slope's. Depth, aspect, curvature and skewed frames are in it. Errors: as
   conemap_frame_ray. */
CONEMAP_API conemap_result conemap_frame_normal(const conemap_frame *frame, float u, float v, const float slope[2],
                                                float normal[3]);

/* How uv moves from pixel to pixel: dFdx and dFdy of the base surface's uv. The displaced uv jumps at silhouettes,
   and a sampler that takes its own derivatives of it shows seams there: hand these to textureGrad or SampleGrad. */
typedef struct conemap_gradient {
    float dudx, dvdx, dudy, dvdy;
} conemap_gradient;

/* The same on the CPU: from a pixel's ray and those through its neighbours to the right and below, where they meet
   the base surface's tangent plane. Errors: NULL, PARAMETER (also where a ray is parallel to the plane or points
   away). */
CONEMAP_API conemap_result conemap_gradient_at(const conemap_frame *frame, const conemap_ray *ray,
                                               const conemap_ray *right, const conemap_ray *below,
                                               conemap_gradient *gradient);

/* dh/du and dh/dv at (u, v) as [Dum06] stores them: central differences of texels, one-sided at borders that do not
   wrap, interpolated. For CONEMAP_DUMMER as the texture returns them: rounded, clamped to one height per texel in
   unorm formats, and flip_dv undone. In a shader: slope = (texel.zw - 0.5) * size, the second negated with flip_dv.
   Positions and errors: as conemap_sample_at. */
CONEMAP_API conemap_result conemap_smooth_slope(const conemap_map *map, float u, float v, float slope[2]);

typedef enum conemap_depth_range {
    CONEMAP_DEPTH_ZERO_TO_ONE = 0, /* clip z / w as it is: Direct3D, Vulkan, Metal, GL with clip control */
    CONEMAP_DEPTH_MINUS_ONE_TO_ONE, /* 0.5 + 0.5 z / w: GL's default */
    CONEMAP_DEPTH_RANGE_COUNT
} conemap_depth_range;

/* The depth that a fragment at a world position has, for glFragDepth or SV_Depth; not clamped.
   view_projection: clip[k] = p[0] m[k] + p[1] m[4 + k] + p[2] m[8 + k] + m[12 + k], which is GL's column-major and
   Direct3D's row-major row-vector memory. Ordinary, reversed and infinite projections alike: the matrix knows.
   Relief that sinks below its polygon (level 1, seen from the front) is never nearer than the polygon, which lets a
   shader keep early depth tests: layout(depth_greater) or SV_DepthGreaterEqual, and depth_less or SV_DepthLessEqual
   with reversed depth. With level below 1 render the shell's top (z = 1) instead of the surface, and the same holds.
   Errors: NULL, ENUM, PARAMETER (w is not above 0: at or behind the viewer; or nothing finite). */
CONEMAP_API conemap_result conemap_depth(const float view_projection[16], const float position[3],
                                         conemap_depth_range range, float *depth);

/* How many levels halve a map down to one texel: 1 + floor(log2(longer side)). 0 for sizes out of range. */
CONEMAP_API int conemap_level_count(int width, int height);

/* Builds maps[0] as conemap_build does and each further level from the mean heights of the one before, with cones of
   its own: sizes are halved and rounded down, as textures' mip levels are, and texels are weighted by area, so
   nothing is dropped. Mip levels of cones themselves, filtered, are safe for nothing.
   Between two levels with weights 1 - f and f the surface is their blend. Each level has h(q) - h(p) <= |q - p| / tan,
   so their blend rises by no more than the blend of the slopes 1 / tan: a cone of 1 / ((1 - f) / tan0 + f / tan1) is
   safe, and so is the narrower of the two. The blend of the tangents themselves, which trilinear samplers return, is
   wider than that and not safe.
   maps: overwritten; free each with conemap_free. desc.memory and desc.scratch must be null (UNSUPPORTED). count: 1
   to conemap_level_count. progress runs once a level. Errors: those of conemap_build; PARAMETER; all maps are then
   zeroed. */
CONEMAP_API conemap_result conemap_build_levels(const conemap_desc *desc, conemap_map *maps, int count);

/* Everything that conemap_shade is told. Zeroed: no effects. Arrays stay the caller's. */
typedef struct conemap_effects {
    unsigned flags;         /* conemap_effect bits */
    const conemap_frame *frames; /* null: rays live in the unit box, which is the world */
    int frame_per_ray;      /* nonzero: frames[k] belongs to rays[k]; 0: frames[0] to all */

    float clip[4];          /* CLIP: least u, least v, greatest u, greatest v; all 0: 0, 0, 1, 1 */
    const unsigned char *alpha; /* HOLES: one byte a texel of the map, row 0 first */
    ptrdiff_t alpha_stride; /* bytes from row to row, may be negative; 0: rows touch */
    int alpha_cut;          /* texels below it are holes; 0: 128. Up to 255 */

    const conemap_map *levels; /* LOD: as conemap_build_levels makes them; traced instead of the map */
    int level_count;        /* 1 to 16 */
    const conemap_gradient *gradients; /* UV, LOD, FADE: gradients[k] belongs to rays[k] */
    float lod_bias;         /* added to the level; -16..16 */
    int lod_steps;          /* most steps of a ray at level 0, halved with each level, at least 8; where they end a ray
                               has STEP_CAP and is shaded where it is. 0: no cap. Up to 2^30 */
    float fade_begin;       /* FADE: pixels that z = 1 stands over z = 0, seen from the side, where fading begins; 0: 2.
                               Up to 1e6 */
    float fade_end;         /* and where only the normals are left; 0: fade_begin / 4. Below fade_begin */

    const float *view_projection; /* DEPTH: 16 numbers, see conemap_depth */
    conemap_depth_range depth_range;

    float light[3];         /* SHADOW, SOFT_SHADOW: towards the light, or its world position. Any length but 0 */
    int light_is_point;     /* nonzero: a position */
    float light_radius;     /* SOFT_SHADOW: radians as seen from the hit, up to 1, or the ball's radius if a position;
                               0: 0.00465, the sun's */
    int sky_directions;     /* SKY: 0: 8. Up to 1024 */
    float sky_reach;        /* SKY: what is farther away, in the world, hides nothing; 0: no end */
} conemap_effects;

/* What is known of a hit. Fields of effects that are off stay as they were, and so do all where there is no hit. */
typedef struct conemap_shading {
    float position[3];      /* POSITION, DEPTH: world */
    float normal[3];        /* NORMAL, SMOOTH_NORMAL: world, unit; of the side where the hit is `inside` by a side */
    float depth;            /* DEPTH; 0 for a point at or behind the viewer */
    float shadow;           /* SHADOW, SOFT_SHADOW: 0 dark to 1 lit */
    float occlusion;        /* OCCLUSION, SKY: 0 closed to 1 open */
    float uv[2];            /* UV: displaced; not wrapped */
    conemap_gradient gradient; /* UV */
    float level;            /* LOD: what was traced */
    float fade;             /* FADE: 0 relief to 1 normals only */
} conemap_shading;

/* Traces `count` rays of the world and shades their hits. With no flags it is conemap_trace and shadings may be
   null.
   map, trace: as for conemap_trace. With CURVED, with LOD between levels, and behind holes the tracer is always an
   exact one: cells are met as CONEMAP_TRACE_EXACT meets them, by the cones' guarantee without a miss (relaxed cones
   are not used).
   hits: in box coordinates; t is the ray's own. With CURVED z is the height over the bent base. HIT and STEP_CAP are
   shaded; a host discards the rest.

   CURVED. The base is a quadric over the tangent plane, a graph per fragment as in relief mapping of polygons
   (Oliveira and Policarpo, 2005), and relief stands on it along the frame's normal. In the box the ray is then a
   parabola, and cones and cells are stepped with that parabola itself: against this surface nothing is missed.
   Against a truly bent surface of curvature k it leaves out what is of third order in k times the way from the
   frame's origin, and that the texture stretches with height by 1 + k depth. |xx| + |xy| and |xy| + |yy| times depth
   must stay below 1 (PARAMETER), where a surface of that curvature would fold; keep below 0.1 for a good likeness,
   with a frame at each fragment. Measured on a cylinder, rays 10 to 80 degrees steep, a depth of 0.04 (0.16) of the
   radius: nine hits in ten lie within 0.02 (0.08) depths of the true ones, and none of 2000 rays (1 in 110) errs
   about the silhouette; over a flat base 0.07 (0.2) depths, and 1 ray in 400 (15). The quadric goes on for ever: a
   bowl (negative curvature) on a map that wraps has a far side which rays and shadows meet; end it with CLIP.

   Shadows and sky see the relief only, at the traced level and depth, from 2^-20 above the hit. A light's disc is
   cut by the horizons in five directions across it, and more where two differ by much: no dithering, no banding; off
   by 0.004 on average, 0.03 at worst, of an area light's 800 rays (tests/effects.c). Hard shadows: of 10^7 rays
   followed in double precision none leaks and none is false (tests/long/shadows.c).

   OCCLUSION takes the sky for free as far as the cone reaches, and guesses that the horizon all around stands 0.3
   times as steep as the steepest. What it never says is proven by the cone alone: no less than normal_z sin^2 of its
   half angle is open.

   Errors: those of conemap_trace; NULL (what a flag needs is missing), PARAMETER, ENUM, UNSUPPORTED (NORMAL with
   SMOOTH_NORMAL, SHADOW with SOFT_SHADOW, OCCLUSION with SKY; unknown bits; levels of differing wraps), of which
   nothing is written. A frame per ray or a gradient that is wrong makes its ray INVALID, with PARAMETER. */
CONEMAP_API conemap_result conemap_shade(const conemap_map *map, const conemap_trace_desc *trace,
                                         const conemap_effects *effects, const conemap_ray *rays, conemap_hit *hits,
                                         conemap_shading *shadings, int count);

/* The level, cap and fade that conemap_shade takes for a gradient. fade needs effects->frames[0], or the unit box. */
typedef struct conemap_lod {
    float level;            /* 0 and up, of effects->levels */
    int max_steps;          /* 0: no cap */
    float fade;             /* 0..1 */
} conemap_lod;
CONEMAP_API conemap_result conemap_lod_at(const conemap_map *map, const conemap_effects *effects,
                                          const conemap_gradient *gradient, conemap_lod *lod);

/* Bakes how much of the sky each texel's centre sees, 0..1, cosine-weighted about its smooth normal: by horizons
   that are exact in each of `directions` azimuths (0: 64; up to 1024). frame: of it only the vectors' lengths and
   angles, uv_scale, depth and aspect count; null: the unit box. sky: width * height floats, row 0 first. Each
   horizon takes 5 to 8 traces' time.
   Rows first_row .. first_row + rows - 1 are written (at their place), for a host's jobs; rows 0: all.
   Errors: NULL, PARAMETER. Thread-safe. */
CONEMAP_API conemap_result conemap_bake_sky(const conemap_map *map, const conemap_frame *frame, int directions,
                                            int first_row, int rows, float *sky);

#ifdef __cplusplus
}
#endif

#endif /* CONEMAP_H */

/* ####################################################################################################### */
#if defined(CONEMAP_IMPLEMENTATION) && !defined(CONEMAP_IMPLEMENTED)
#define CONEMAP_IMPLEMENTED

#include <math.h> /* sqrtf, sqrt */
#include <string.h>
#if defined(CONEMAP_MALLOC) != defined(CONEMAP_FREE)
#error "define both CONEMAP_MALLOC and CONEMAP_FREE, or neither"
#endif
#ifndef CONEMAP_MALLOC
#include <stdlib.h>
#define CONEMAP_MALLOC(size) malloc(size)
#define CONEMAP_FREE(pointer) free(pointer)
#endif

/* Fused multiply-add would change bits from one target to the next, so it is kept out. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

#if defined(__GNUC__) || defined(__clang__)
#define CONEMAP__INLINE static inline __attribute__((always_inline))
#define CONEMAP__UNUSED __attribute__((unused))
#elif defined(_MSC_VER)
#define CONEMAP__INLINE static __forceinline
#define CONEMAP__UNUSED
#else
#define CONEMAP__INLINE static inline
#define CONEMAP__UNUSED
#endif

#if defined(__GNUC__) || defined(__clang__)
#define CONEMAP__PREFETCH(address) __builtin_prefetch(address)
#else
#define CONEMAP__PREFETCH(address) ((void)(address))
#endif

#ifdef CONEMAP_STATIC
#define CONEMAP__DEF CONEMAP__UNUSED static
#elif defined(__cplusplus)
#define CONEMAP__DEF extern "C"
#else
#define CONEMAP__DEF
#endif

/* ======================================================================================================
   N U M E R I C S
   ====================================================================================================== */

#define CONEMAP__FAR 3.0e38f /* stands for infinity, which fast-math builds do not know */

CONEMAP__DEF const char *conemap_result_string(conemap_result result) {
#define CONEMAP__TEXT_ITEM(name, text) text,
    static const char *const texts[] = {CONEMAP_RESULTS(CONEMAP__TEXT_ITEM)};
#undef CONEMAP__TEXT_ITEM
    int index = (int)result;
    return index >= 0 && index < (int)CONEMAP_RESULT_COUNT ? texts[index] : "unknown result";
}

CONEMAP__INLINE uint32_t conemap__bits(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

CONEMAP__INLINE float conemap__from_bits(uint32_t bits) {
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

CONEMAP__INLINE double conemap__double_of(uint64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* By the bits, since fast-math builds assume that x == x. */
CONEMAP__INLINE int conemap__finite(float x) {
    return (conemap__bits(x) & 0x7f800000u) != 0x7f800000u;
}

CONEMAP__INLINE int conemap__in_range(float x, float low, float high) {
    return conemap__finite(x) && x >= low && x <= high;
}

CONEMAP__INLINE float conemap__min(float a, float b) { return a < b ? a : b; }
CONEMAP__INLINE float conemap__max(float a, float b) { return a > b ? a : b; }
CONEMAP__INLINE int conemap__mini(int a, int b) { return a < b ? a : b; }
CONEMAP__INLINE int conemap__maxi(int a, int b) { return a > b ? a : b; }

/* For |x| below 2^31. */
CONEMAP__INLINE int conemap__floor(float x) {
    int i = (int)x;
    return i - (x < (float)i);
}

/* The same for doubles. */
CONEMAP__INLINE int conemap__floord(double x) {
    int i = (int)x;
    return i - (x < (double)i);
}

CONEMAP__INLINE double conemap__clamp01(double x) { return x < 0.0 ? 0.0 : x > 1.0 ? 1.0 : x; }

CONEMAP__INLINE uint64_t conemap__bits_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* For |x| below 2^52. */
CONEMAP__INLINE double conemap__floor_wide(double x) {
    double whole = (double)(int64_t)x;
    return whole > x ? whole - 1.0 : whole;
}

/* x - floor(x) for any finite x; numbers of 2^52 and more are whole. */
static double conemap__fraction(double x) {
    double whole;
    if (x >= 4503599627370496.0 || x <= -4503599627370496.0) return 0.0;
    whole = (double)(int64_t)x;
    if (whole > x) whole -= 1.0;
    return x - whole;
}

/* The power of two 2^e with 1 <= x 2^e < 2, for normal positive x. */
static double conemap__normalising_power(double x) {
    uint64_t bits;
    double power;
    memcpy(&bits, &x, sizeof bits);
    bits = (2046u - ((bits >> 52) & 2047u)) << 52;
    memcpy(&power, &bits, sizeof power);
    return power;
}

/* Adds count * size bytes, rounded up to the alignment, to *total; 0 where size_t cannot hold it. */
static int conemap__add_size(size_t *total, size_t count, size_t size) {
    size_t bytes;
    if (size != 0 && count > (SIZE_MAX - CONEMAP_ALIGNMENT) / size) return 0;
    bytes = (count * size + CONEMAP_ALIGNMENT - 1) / CONEMAP_ALIGNMENT * CONEMAP_ALIGNMENT;
    if (bytes > SIZE_MAX - *total) return 0;
    *total += bytes;
    return 1;
}

/* A texel's part of the hash of all heights, which is the sum of them, so that an edit changes only its own. */
CONEMAP__INLINE uint64_t conemap__height_hash(float height, size_t at) {
    uint64_t x = ((uint64_t)conemap__bits(height) + 1u) * 0x9e3779b97f4a7c15u ^ (uint64_t)at * 0xd6e8feb86659fd93u;
    x = (x ^ x >> 29) * 0xff51afd7ed558ccdu;
    return x ^ x >> 32;
}

/* Word-wise FNV-1a; start from CONEMAP__HASH_START. */
#define CONEMAP__HASH_START 0xcbf29ce484222325u
CONEMAP__INLINE uint64_t conemap__hash(uint64_t hash, uint64_t word) {
    return (hash ^ word) * 0x100000001b3u;
}

/* ======================================================================================================
   S T O R A G E

   A channel's value is kept as a float that its format holds exactly, just as a texture fetch returns it.
   Its code is the bit pattern in the texture; codes of non-negative values are ordered as the values are.
   ====================================================================================================== */

static size_t conemap__format_size(conemap_format format) {
    return format == CONEMAP_F32 ? 4u : format == CONEMAP_UNORM8 ? 1u : 2u;
}

/* Kernels with one lane: see K E R N E L S. */
CONEMAP__INLINE float conemap__value_scalar(conemap_format format, int32_t code);
CONEMAP__INLINE int32_t conemap__code_down_scalar(conemap_format format, float x);

CONEMAP__INLINE float conemap__value(conemap_format format, uint32_t code) {
    return conemap__value_scalar(format, (int32_t)code);
}

/* The code of the largest value at or below x, for 0 <= x. Unorm formats hold at most 1. */
CONEMAP__INLINE uint32_t conemap__code_down(conemap_format format, float x) {
    return (uint32_t)conemap__code_down_scalar(format, x);
}

/* The code of the nearest value; unorm formats clamp to 0..1, halves to their finite range. */
static uint32_t conemap__code_near(conemap_format format, float x) {
    uint32_t sign = 0, code;
    if (format == CONEMAP_F32) return conemap__bits(x);
    if (x < 0.0f) {
        if (format != CONEMAP_F16) return 0;
        sign = 0x8000u;
        x = -x;
    }
    code = conemap__code_down(format, x);
    if (format == CONEMAP_F16) {
        float below = x - conemap__value(format, code);
        float above = code < 0x7bffu ? conemap__value(format, code + 1) - x : CONEMAP__FAR;
        return sign | (below > above || (below == above && (code & 1u)) ? code + 1 : code);
    }
    return format == CONEMAP_UNORM8 ? (uint32_t)(conemap__min(x, 1.0f) * 255.0f + 0.5f)
                                    : (uint32_t)(conemap__min(x, 1.0f) * 65535.0f + 0.5f);
}

CONEMAP__INLINE uint32_t conemap__read_code(conemap_format format, const unsigned char *bytes) {
    uint32_t word;
    uint16_t half;
    switch (format) {
    case CONEMAP_F32: memcpy(&word, bytes, 4); return word;
    case CONEMAP_UNORM8: return bytes[0];
    default: memcpy(&half, bytes, 2); return half;
    }
}

/* Of the lowest 8. */
CONEMAP__INLINE int conemap__count_bits(int bits) {
    bits -= bits >> 1 & 0x5555;
    bits = (bits & 0x3333) + (bits >> 2 & 0x3333);
    bits = (bits + (bits >> 4)) & 0x0f0f;
    return (bits + (bits >> 8)) & 31;
}

/* Any alignment. */
CONEMAP__INLINE int32_t conemap__four_bytes(const unsigned char *bytes) {
    int32_t word;
    memcpy(&word, bytes, 4);
    return word;
}

static void conemap__write_code(conemap_format format, unsigned char *bytes, uint32_t code) {
    uint16_t half = (uint16_t)(code & 0xffffu);
    switch (format) {
    case CONEMAP_F32: memcpy(bytes, &code, 4); break;
    case CONEMAP_UNORM8: bytes[0] = (unsigned char)(code & 0xffu); break;
    default: memcpy(bytes, &half, 2); break;
    }
}

CONEMAP__INLINE float conemap__decode_tan(const conemap_info *info, float height, float stored) {
    float top = 1.0f - height;
    switch (info->texture.encoding) {
    case CONEMAP_SQRT: return stored * stored;
    case CONEMAP_RADIUS: /* at the very top no cone has any room; just below, the quotient is all rounding */
        return stored < info->max_tan * top ? stored / top : top > 0.0f ? info->max_tan : 0.0f;
    default: return stored;
    }
}

CONEMAP__DEF float conemap_decode(const conemap_info *info, float height, float stored) {
    return info ? conemap__decode_tan(info, height, stored) : 0.0f;
}

/* ======================================================================================================
   P Y R A M I D

   Level k holds maxima over blocks of 2^k x 2^k; sizes are halved and rounded up, so the last row or column
   of blocks may be thinner and nothing is dropped. The four children of a block lie together (a quad).
   ====================================================================================================== */

CONEMAP__INLINE int conemap__repeat(int i, int size) {
    i %= size;
    return i < 0 ? i + size : i;
}

/* The texel that stands at index i of an axis, outside included. */
CONEMAP__INLINE int conemap__texel_index(int i, int size, conemap_wrap wrap) {
    if (wrap == CONEMAP_WRAP) return conemap__repeat(i, size);
    return i < 0 ? 0 : i >= size ? size - 1 : i;
}

CONEMAP__INLINE size_t conemap__texels(const conemap_map *map) {
    return (size_t)map->info.width * (size_t)map->info.height;
}

CONEMAP__INLINE float conemap__height(const conemap_map *map, int i, int j) {
    return map->heights[(size_t)j * (size_t)map->info.width + (size_t)i];
}

/* Bilinear cell c of an axis lies between texel centres c - first and c - first + 1 (see CONVENTIONS). */
CONEMAP__INLINE int conemap__first_cell(conemap_wrap wrap) { return wrap == CONEMAP_CLAMP ? 1 : 0; }
CONEMAP__INLINE int conemap__cell_count(int size, conemap_wrap wrap) {
    return wrap == CONEMAP_CLAMP ? size + 1 : wrap == CONEMAP_WRAP ? size : size - 1;
}

/* A cell's corner heights: the patch h00 + hx x + hy y + hxy x y over 0..1 x 0..1. */
typedef struct conemap__corners {
    float h00, h10, h01, h11;
} conemap__corners;

/* The four texels around cell (i, j), whose lower corner is the centre of texel (i, j). */
typedef struct conemap__quad {
    size_t at00, at10, at01, at11;
} conemap__quad;

CONEMAP__INLINE conemap__quad conemap__cell_quad(const conemap_map *map, int i, int j) {
    int w = map->info.width, h = map->info.height;
    size_t i0 = (size_t)conemap__texel_index(i, w, map->info.wrap_u);
    size_t i1 = (size_t)conemap__texel_index(i + 1, w, map->info.wrap_u);
    size_t j0 = (size_t)conemap__texel_index(j, h, map->info.wrap_v) * (size_t)w;
    size_t j1 = (size_t)conemap__texel_index(j + 1, h, map->info.wrap_v) * (size_t)w;
    conemap__quad quad;
    quad.at00 = j0 + i0;
    quad.at10 = j0 + i1;
    quad.at01 = j1 + i0;
    quad.at11 = j1 + i1;
    return quad;
}

CONEMAP__INLINE conemap__corners conemap__gather(const float *plane, conemap__quad quad) {
    conemap__corners c;
    c.h00 = plane[quad.at00];
    c.h10 = plane[quad.at10];
    c.h01 = plane[quad.at01];
    c.h11 = plane[quad.at11];
    return c;
}

CONEMAP__INLINE float conemap__highest(conemap__corners c) {
    return conemap__max(conemap__max(c.h00, c.h10), conemap__max(c.h01, c.h11));
}

/* Interpolates along x, then y; off by about 1e-7 at most. */
CONEMAP__INLINE float conemap__bilinear(conemap__corners c, float x, float y) {
    float low = c.h00 + (c.h10 - c.h00) * x, high = c.h01 + (c.h11 - c.h01) * x;
    return low + (high - low) * y;
}

static int conemap__levels(int width, int height) {
    int levels = 1;
    while (width > 1 || height > 1) {
        width = (width + 1) / 2;
        height = (height + 1) / 2;
        ++levels;
    }
    return levels;
}

/* Fills in the sizes and adds the bytes of the levels from `first` up to *bytes, for the caller to hand out. */
static int conemap__pyramid_plan(conemap_pyramid *pyramid, int width, int height, int first, size_t *bytes) {
    int k;
    memset(pyramid, 0, sizeof *pyramid);
    pyramid->levels = conemap__levels(width, height);
    for (k = 0; k < pyramid->levels; ++k) {
        pyramid->width[k] = width;
        pyramid->height[k] = height;
        width = (width + 1) / 2;
        height = (height + 1) / 2;
        if (k >= first && !conemap__add_size(bytes, (size_t)width * (size_t)height, 4 * sizeof(float))) return 0;
    }
    return 1;
}

/* The four children of block (x, y) of level k + 1. */
CONEMAP__INLINE float *conemap__children(const conemap_pyramid *pyramid, int k, int x, int y) {
    return pyramid->level[k] + 4 * ((size_t)y * (size_t)((pyramid->width[k] + 1) / 2) + (size_t)x);
}

CONEMAP__INLINE float conemap__block_max(const conemap_pyramid *pyramid, int k, int x, int y) {
    return conemap__children(pyramid, k, x / 2, y / 2)[2 * (y & 1) + (x & 1)];
}

CONEMAP__INLINE float conemap__cell_max(const conemap_map *map, int x, int y) {
    return conemap__highest(
        conemap__gather(map->heights, conemap__cell_quad(map, x - conemap__first_cell(map->info.wrap_u),
                                                         y - conemap__first_cell(map->info.wrap_v))));
}

/* A value of level 0 of the falling cells (see CONEMAP_RELAXED_EXACT). */
static float conemap__falling_cell(const conemap_map *map, int quadrant, int x, int y);

/* Blocks x0..x1 - 1, y0..y1 - 1 of level k from level k - 1. Level 0 of the cells is not stored. */
static void conemap__pyramid_blocks(const conemap_map *map, conemap_pyramid *pyramid, int k, int x0, int x1, int y0,
                                    int y1) {
    int w = pyramid->width[k], h = pyramid->height[k], x, y;
    for (y = y0; y < y1; ++y)
        for (x = x0; x < x1; ++x) {
            float *children = conemap__children(pyramid, k, x / 2, y / 2);
            float highest;
            if (k == 0) {
                highest = conemap__falling_cell(map, (int)(pyramid - map->build.falling), x, y);
            } else if (pyramid->level[k - 1]) {
                const float *below = conemap__children(pyramid, k - 1, x, y);
                highest = conemap__max(conemap__max(below[0], below[1]), conemap__max(below[2], below[3]));
            } else {
                int right = conemap__mini(2 * x + 1, pyramid->width[0] - 1);
                int under = conemap__mini(2 * y + 1, pyramid->height[0] - 1);
                highest = conemap__max(
                    conemap__max(conemap__cell_max(map, 2 * x, 2 * y), conemap__cell_max(map, right, 2 * y)),
                    conemap__max(conemap__cell_max(map, 2 * x, under), conemap__cell_max(map, right, under)));
            }
            children[2 * (y & 1) + (x & 1)] = highest;
            /* Blocks that complete the last quads lie below everything. */
            if (x == w - 1 && !(x & 1)) children[2 * (y & 1) + 1] = -1.0f;
            if (y == h - 1 && !(y & 1)) children[2 + (x & 1)] = -1.0f;
            if (x == w - 1 && y == h - 1 && !(x & 1) && !(y & 1)) children[3] = -1.0f;
        }
}

/* The blocks of CONEMAP__STRIP rows of level 0 depend on nothing outside, up to this level. */
#define CONEMAP__STRIP_LEVELS 6
#define CONEMAP__STRIP (1 << CONEMAP__STRIP_LEVELS)

static void conemap__pyramid_strip(const conemap_map *map, conemap_pyramid *pyramid, int strip) {
    int k;
    for (k = 0; k <= CONEMAP__STRIP_LEVELS && k < pyramid->levels; ++k) {
        int rows = CONEMAP__STRIP >> k;
        if (!pyramid->level[k]) continue;
        conemap__pyramid_blocks(map, pyramid, k, 0, pyramid->width[k], strip * rows,
                                conemap__mini((strip + 1) * rows, pyramid->height[k]));
    }
}

/* The maxima over texels are kept row by row instead, for the kernels; level 0 is the heights themselves. */
static int conemap__maxima_plan(conemap_pyramid *pyramid, int width, int height, size_t *bytes) {
    int k;
    size_t unused = 0;
    if (!conemap__pyramid_plan(pyramid, width, height, 0, &unused)) return 0;
    for (k = 1; k < pyramid->levels; ++k)
        if (!conemap__add_size(bytes, (size_t)pyramid->width[k] * (size_t)pyramid->height[k], sizeof(float))) return 0;
    return 1;
}

CONEMAP__INLINE float *conemap__maxima(const conemap_pyramid *pyramid, int k, int y) {
    return pyramid->level[k] + (size_t)y * (size_t)pyramid->width[k];
}

static void conemap__maxima_rows(const conemap_map *map, int k, int y0, int y1);

static void conemap__maxima_strip(const conemap_map *map, int strip) {
    int k;
    for (k = 1; k <= CONEMAP__STRIP_LEVELS && k < map->build.texels.levels; ++k) {
        int rows = CONEMAP__STRIP >> k;
        conemap__maxima_rows(map, k, strip * rows, conemap__mini((strip + 1) * rows, map->build.texels.height[k]));
    }
}

static void conemap__maxima_top(const conemap_map *map) {
    int k;
    for (k = CONEMAP__STRIP_LEVELS + 1; k < map->build.texels.levels; ++k)
        conemap__maxima_rows(map, k, 0, map->build.texels.height[k]);
}

/* Everything that depends on rows y0..y1 of the texels, both ends included. */
static void conemap__maxima_region(const conemap_map *map, int y0, int y1) {
    int k;
    for (k = 1; k < map->build.texels.levels; ++k) conemap__maxima_rows(map, k, y0 >> k, (y1 >> k) + 1);
}

static void conemap__pyramid_top(const conemap_map *map, conemap_pyramid *pyramid) {
    int k;
    for (k = CONEMAP__STRIP_LEVELS + 1; k < pyramid->levels; ++k)
        conemap__pyramid_blocks(map, pyramid, k, 0, pyramid->width[k], 0, pyramid->height[k]);
}

/* Everything that depends on x0..x1, y0..y1 of level 0, both ends included. */
static void conemap__pyramid_region(const conemap_map *map, conemap_pyramid *pyramid, int x0, int x1, int y0, int y1) {
    int k;
    for (k = 0; k < pyramid->levels; ++k)
        if (pyramid->level[k])
            conemap__pyramid_blocks(map, pyramid, k, x0 >> k, (x1 >> k) + 1, y0 >> k, (y1 >> k) + 1);
}

/* ======================================================================================================
   K E R N E L S

   What is done to row after row of texels is written once, at the end of this file, in the macros below, and compiled
   once
   for each instruction set: the file includes itself (by CONEMAP_SELF, its own name) with the macros defined anew each
   time. Lanes are neighbouring texels. Every macro rounds as C's operators do and nothing is fused, so all instruction
   sets give the same bits; with one lane it is plain C.

   Types CONEMAP__F, CONEMAP__I, CONEMAP__M hold CONEMAP__LANES floats, int32s and truth values:
       F1 I1              the same number in all lanes         LOADF LOADI STOREF STOREI   any alignment
       LOADU8 LOADU16     codes to int lanes                   GATHERF(base, indices)
       GATHERI            (base, p) uint32s at the int32s behind p
       ADD SUB MUL DIV SQRT MIN MAX                            floats; MIN is a < b ? a : b, MAX is a > b ? a : b
       IADD ISUB IMUL IAND IOR ISHL ISHR (logical)             ints
       LT LE IGT IEQ      compare; AND OR ANDNOT (a and not b) masks; PICK PICKI (mask ? a : b)
       ANY BITS           does some lane hold; one bit for each lane that holds, lane 0 lowest
       TOF TOI            between numbers, towards zero        BITSF BITSI   the same bits as another type
       EVEN ODD           every second lane of two vectors in a row
   Types CONEMAP__D, CONEMAP__L, CONEMAP__W hold CONEMAP__DLANES doubles, uint64s and truth values of doubles:
       D1 L1 LOADD STORED ADDD SUBD MULD DIVD SQRTD MIND MAXD LTD LED ANDW ORW ANDNOTW PICKD BITSW   as above
       STOREN STOREDF     doubles 0..2^31 - 1 as int32s; doubles as floats
       GATHERFD           (base, p) floats as doubles, at the int32s behind p
       WHOLE              towards zero, for 0..2^31 - 1
       LOADFD             DLANES floats as doubles
       FLOORD             for anything below 2^52
       LSUB LAND          uint64s; BITSD BITSL the same bits as another type
   To add a macro: define it in each of the sets and add its #undef where the kernels end. To add a
   kernel: write it there, and add its pointer to conemap__kernels and CONEMAP__KERNEL_LIST. Vectors are locals and
   never cross a call that is not inlined (MinGW does not align the stack for them). CONEMAP__FUNCTION and
   CONEMAP__HELPER carry the attribute that lets a function use its instruction set, so no compiler flag is needed.
   ====================================================================================================== */

#ifndef CONEMAP_SELF
#define CONEMAP_SELF "conemap.h"
#endif

/* What the compiler can make. 32-bit x86 without SSE2 rounds in its own way and gets plain C. */
#if defined(__TINYC__)
#elif (defined(__x86_64__) || (defined(__i386__) && defined(__SSE2__))) && (defined(__GNUC__) || defined(__clang__))
#define CONEMAP__X86
#include <immintrin.h>
#elif defined(_M_X64) && defined(_MSC_VER)
#define CONEMAP__X86
#include <intrin.h>
#include <immintrin.h>
#elif defined(__aarch64__) && defined(__ARM_NEON) && !defined(__AARCH64EB__)
#define CONEMAP__ARM
#include <arm_neon.h>
#elif defined(__wasm_simd128__)
#define CONEMAP__WASM
#include <wasm_simd128.h>
#endif

/* What the search for cones keeps from one tile to the next (see G E N E R A T I O N). */
#define CONEMAP__TILE 8      /* texels along a tile's side */
#define CONEMAP__NOTED 256
typedef struct conemap__search {
    float a, b;              /* a texel's size */
    float deflate;           /* V, taken off every squared distance: see the proof of safe cones, step 4 */
    float near2;             /* pairs closer than its root are left to others; 0 for vertex cones */
    float widen2;            /* (1 + slack)^2 */
    int seeds, seed_x[CONEMAP__TILE * CONEMAP__TILE], seed_y[CONEMAP__TILE * CONEMAP__TILE]; /* what decided last */
} conemap__search;

#define CONEMAP__TOLERANCE 0.1f /* V / D^2 from which a bound counts as tight: at most 5.4 % above the supremum */
#define CONEMAP__TINY 1.0e-30f

/* A tile's texels, row by row. */
typedef struct conemap__tile {
    float height[CONEMAP__TILE * CONEMAP__TILE]; /* 2 for texels that are not searched */
    float slope2[CONEMAP__TILE * CONEMAP__TILE]; /* in: what is known already; out: what was found */
    float folded[CONEMAP__TILE * CONEMAP__TILE]; /* the steepest bounds that slack alone pruned */
    int32_t decider[CONEMAP__TILE * CONEMAP__TILE]; /* number in `noted`, 0 for none */
    float lowest[16], bar[16]; /* of groups of 2 x 2 texels: lowest texel; least slope2, less CONEMAP__MARGIN */
    int noted, noted_x[CONEMAP__NOTED], noted_y[CONEMAP__NOTED];
    int x, y;                /* of its first texel, as the image at hand counts */
    int shift_x, shift_y;    /* that image's own shift */
} conemap__tile;

/* The lower corners of the 8 pieces of a patch, 4 along its longer side: twice, as all tables for lanes. */
#define CONEMAP__EIGHTHS 8
static const float conemap__piece_x[2 * CONEMAP__EIGHTHS] = {0, .25f, .5f, .75f, 0, .25f, .5f, .75f,
                                                            0, .25f, .5f, .75f, 0, .25f, .5f, .75f};
static const float conemap__piece_y[2 * CONEMAP__EIGHTHS] = {0, 0, 0, 0, .5f, .5f, .5f, .5f, 0, 0, 0, 0, .5f, .5f, .5f,
                                                             .5f};

/* The cells near a vertex that do not touch it: where their corners stand, and how they are cut into pieces for step 4
   of the proof of safe cones, FINEST / columns by FINEST / rows of them. Each corner of a piece has 1 / sqrt(D^2 - V),
   row by row. */
#define CONEMAP__SIGHTS 128 /* texels are at most 8:1: then there are 88, with 1024 numbers, up to 13 rows away */
#define CONEMAP__SIGHT_REACH 16
#define CONEMAP__FINEST 32 /* pieces along an axis */
typedef struct conemap__sights {
    int count, x[CONEMAP__SIGHTS], y[CONEMAP__SIGHTS], columns[CONEMAP__SIGHTS], rows[CONEMAP__SIGHTS];
    int first[CONEMAP__SIGHTS]; /* in `inverse` */
    int step_x, step_y;      /* from a corner to the next; 0 along an axis of one texel */
    float most[CONEMAP__SIGHTS]; /* the largest number of each, and a little more */
    float fraction[CONEMAP__FINEST + 1], inverse[2048];
} conemap__sights;

/* Where the texels of a tile's row stand: twice, for there are vectors of two rows. */
static const float conemap__places[2 * CONEMAP__TILE] = {0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7};
static const int32_t conemap__second_row[2 * CONEMAP__TILE] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1};

/* What [VB22] needs to know of one axis at one level of the pyramid, for the block before, a texel's own and the one
   after (see conemap__quick_axis): numbers of blocks, and squared distances of two kinds. */
typedef struct conemap__quick_level {
    float p[3], q[3];
    int32_t node[3], full; /* full: finer levels have seen everything */
} conemap__quick_level;

/* The same for 16 columns. */
typedef struct conemap__quick_columns {
    float p[17][3][16], q[17][3][16];
    int32_t node[17][3][16], full[17][16];
} conemap__quick_columns;

/* A block that may hold something steeper for some of the tile's groups, a bit for each. Only kernels with one lane
   ask. */
typedef struct conemap__node {
    int k, x, y, groups;
} conemap__node;

/* Comparing products saves the division of a quotient: with three roundings less than this margin apart, a block is
   dropped only if its rounded quotient is no more than s. */
#define CONEMAP__MARGIN (1.0f - 1.0f / 1048576.0f)

/* One lane asks groups of 2 x 2 texels first, by their lowest texel and least slope. */
CONEMAP__INLINE void conemap__lower_bar(conemap__tile *tile, int group) {
    const float *s = tile->slope2 + 2 * CONEMAP__TILE * (group >> 2) + 2 * (group & 3), *t = s + CONEMAP__TILE;
    tile->bar[group] = conemap__min(conemap__min(s[0], s[1]), conemap__min(t[0], t[1])) * CONEMAP__MARGIN;
}

CONEMAP__INLINE void conemap__sum_up(conemap__tile *tile, int group) {
    const float *s = tile->height + 2 * CONEMAP__TILE * (group >> 2) + 2 * (group & 3), *t = s + CONEMAP__TILE;
    tile->lowest[group] = conemap__min(conemap__min(s[0], s[1]), conemap__min(t[0], t[1]));
    conemap__lower_bar(tile, group);
}

/* Which of four blocks may texels of the group have to look into? Their squared distances from the tile's columns and
   rows: those of the left and right ones, and of the upper and lower. */
CONEMAP__INLINE int conemap__ask_group(const conemap__tile *tile, int group, const float *highest, const float *left,
                                       const float *right, const float *upper, const float *lower) {
    int c, i = 2 * (group & 3), j = 2 * (group >> 2), asked = 0;
    float x2[2], y2[2];
    x2[0] = conemap__min(left[i], left[i + 1]);
    x2[1] = conemap__min(right[i], right[i + 1]);
    y2[0] = conemap__min(upper[j], upper[j + 1]);
    y2[1] = conemap__min(lower[j], lower[j + 1]);
    for (c = 0; c < 4; ++c) {
        float dh = highest[c] - tile->lowest[group];
        if (dh > 0.0f && dh * dh > tile->bar[group] * (x2[c & 1] + y2[c >> 1])) asked |= 1 << c;
    }
    return asked;
}

/* Rays of the prepared tracer under way, a column for each of their numbers, CONEMAP__BLOCK of them side by side: see
   P R E P A R A T I O N. */
#define CONEMAP__SLOTS 64
#define CONEMAP__BLOCK 16
typedef struct conemap__way { /* along an axis, mirrored so that it is never flown backwards */
    double p[CONEMAP__BLOCK], v[CONEMAP__BLOCK];
    double per_v[CONEMAP__BLOCK], border[CONEMAP__BLOCK]; /* it comes to cell c at c per_v + border */
} conemap__way;

/* The same in floats: `behind` is p less the error e of a position, `late` is border and 2 e per_v, `early` is 4 e
   per_v. */
typedef struct conemap__fast_way {
    float behind[CONEMAP__BLOCK], v[CONEMAP__BLOCK], per_v[CONEMAP__BLOCK], late[CONEMAP__BLOCK], early[CONEMAP__BLOCK];
    float sign[CONEMAP__BLOCK];     /* -1 where mirrored */
} conemap__fast_way;

typedef struct conemap__block_of_rays {
    float state[CONEMAP__BLOCK];    /* CONEMAP__FLYING ... */
    float now[CONEMAP__BLOCK], steps[CONEMAP__BLOCK];
    float cell[2][CONEMAP__BLOCK];
    int32_t record[CONEMAP__BLOCK]; /* number of its cell in the table */
    float end[CONEMAP__BLOCK], z[CONEMAP__BLOCK], vz[CONEMAP__BLOCK]; /* end is late, z low */
    float sink[CONEMAP__BLOCK];     /* time to sink by 1; huge if it does not */
    float major[CONEMAP__BLOCK], per_major[CONEMAP__BLOCK]; /* speed along the faster axis; its inverse */
    float reach[CONEMAP__BLOCK];    /* 1 + 8 e */
    conemap__fast_way fast[2];
    /* for the patches */
    double t[CONEMAP__BLOCK];       /* where it was met */
    double t_end[CONEMAP__BLOCK], z_exact[CONEMAP__BLOCK], vz_exact[CONEMAP__BLOCK], z_end[CONEMAP__BLOCK];
    conemap__way way[2];
    int32_t corner[4][CONEMAP__BLOCK]; /* indices of its cell's texels, once it is close */
    /* the way back to the caller: as in conemap__walk; which of the stream's rays it is */
    double t_start[CONEMAP__BLOCK], t_gone[CONEMAP__BLOCK], t_scale[CONEMAP__BLOCK], end_status[CONEMAP__BLOCK];
    double number[CONEMAP__BLOCK];
    float fill[6 * CONEMAP__BLOCK]; /* blocks are no multiple of 4096 bytes apart, which processors take for the same
                                       place */
} conemap__block_of_rays;

typedef struct conemap__flight_axis {
    double size, cells, first;      /* in texels and in cells; as conemap__first_cell */
    double low;                     /* where the surface begins, in uv; it ends at 1 - low */
    int wraps;
    double period, per_period;      /* cells until it repeats, 0: never; 1 / period */
    float table_first, table_last;  /* numbers of the table's first and last cell */
    float table_period, per_table_period;
    double last_texel, texel_pitch; /* the same of the heights */
    double before, after;           /* the texels that stand beyond the first and the last */
} conemap__flight_axis;

/* Rays and hits as they come: as structs, or else as arrays. */
typedef struct conemap__stream {
    const conemap_ray *rays;
    conemap_hit *hits;
    const conemap_ray_arrays *ray_arrays;
    const conemap_hit_arrays *hit_arrays;
    int count, next;        /* the next ray to board */
    conemap_result result;
} conemap__stream;

typedef struct conemap__flight {
    const uint32_t *table;
    int32_t pitch;                  /* of its rows */
    const float *heights;
    conemap__flight_axis axis[2];
    conemap__stream stream;
    conemap__block_of_rays *blocks; /* CONEMAP__SLOTS rays under way */
    conemap__block_of_rays *waiting;
    int waiting_next, waiting_count;
} conemap__flight;

#define CONEMAP__FLYING 0.0f
#define CONEMAP__CLOSE 1.0f /* its cell is to be met with its patch */
#define CONEMAP__GONE 2.0f  /* t_end reached above the surface */
#define CONEMAP__MET 3.0f
#define CONEMAP__EMPTY 4.0f

#define CONEMAP__REACH 1048576.0 /* texels that a ray is followed on wrapping axes */
#define CONEMAP__NEVER 1e300     /* a time that does not come */

CONEMAP__INLINE conemap_result conemap__check_ray(const conemap_ray *ray) {
    int k;
    for (k = 0; k < 3; ++k)
        if (!conemap__finite(ray->origin[k])) return CONEMAP_ERROR_RAY_ORIGIN;
    for (k = 0; k < 3; ++k)
        if (!conemap__finite(ray->direction[k])) return CONEMAP_ERROR_RAY_DIRECTION;
    if (((conemap__bits(ray->direction[0]) | conemap__bits(ray->direction[1]) |
          conemap__bits(ray->direction[2])) & 0x7fffffffu) == 0)
        return CONEMAP_ERROR_RAY_DIRECTION;
    /* t_max may be infinite, which is no end; every other odd value is an error. */
    if (!conemap__finite(ray->t_min) || ray->t_min < 0.0f) return CONEMAP_ERROR_RAY_RANGE;
    if ((conemap__bits(ray->t_max) & 0x7fffffffu) > 0x7f800000u) return CONEMAP_ERROR_RAY_RANGE;
    if (ray->t_max != 0.0f && ray->t_max < ray->t_min) return CONEMAP_ERROR_RAY_RANGE;
    return CONEMAP_OK;
}

CONEMAP__INLINE void conemap__stream_hit(const conemap__stream *stream, int k, const conemap_hit *hit) {
    const conemap_hit_arrays *arrays = stream->hit_arrays;
    if (stream->hits) {
        stream->hits[k] = *hit;
        return;
    }
    if (arrays->status) arrays->status[k] = (unsigned char)hit->status;
    if (arrays->inside) arrays->inside[k] = (unsigned char)hit->inside;
    if (arrays->t) arrays->t[k] = hit->t;
    if (arrays->u) arrays->u[k] = hit->u;
    if (arrays->v) arrays->v[k] = hit->v;
    if (arrays->z) arrays->z[k] = hit->z;
}

/* The stream's next ray; an invalid one is answered. */
CONEMAP__INLINE conemap_result conemap__stream_ray(conemap__stream *stream, conemap_ray *ray) {
    const conemap_ray_arrays *arrays = stream->ray_arrays;
    conemap_result result;
    int c, k = stream->next++;
    if (stream->rays) {
        *ray = stream->rays[k];
    } else {
        for (c = 0; c < 3; ++c) {
            ray->origin[c] = arrays->origin[c][k];
            ray->direction[c] = arrays->direction[c][k];
        }
        ray->t_min = arrays->t_min ? arrays->t_min[k] : 0.0f;
        ray->t_max = arrays->t_max ? arrays->t_max[k] : 0.0f;
    }
    result = conemap__check_ray(ray);
    if (result != CONEMAP_OK) {
        conemap_hit hit;
        memset(&hit, 0, sizeof hit);
        hit.status = CONEMAP_INVALID;
        conemap__stream_hit(stream, k, &hit);
        if (stream->result == CONEMAP_OK) stream->result = result;
    }
    return result;
}

/* Answers a ray that has met the surface or is gone, as conemap__finish and conemap__miss. */
CONEMAP__INLINE void conemap__land(conemap__stream *stream, const conemap__block_of_rays *rays, int slot) {
    int met = rays->state[slot] == CONEMAP__MET, number = (int)rays->number[slot], c;
    double along = (met ? rays->t_start[slot] + rays->t[slot] : rays->t_gone[slot]) * rays->t_scale[slot], place[3];
    conemap_hit hit;
    for (c = 0; c < 3; ++c)
        place[c] = stream->rays ? (double)stream->rays[number].origin[c] +
                                      along * (double)stream->rays[number].direction[c]
                                : (double)stream->ray_arrays->origin[c][number] +
                                      along * (double)stream->ray_arrays->direction[c][number];
    hit.status = met ? CONEMAP_HIT : (conemap_status)(int)rays->end_status[slot];
    hit.inside = met && rays->t[slot] <= 0.0;
    hit.t = hit.t_before = hit.t_after = (float)along;
    hit.u = (float)place[0];
    hit.v = (float)place[1];
    hit.z = (float)place[2];
    hit.steps = (int)rays->steps[slot];
    hit.fallback = 0;
    conemap__stream_hit(stream, number, &hit);
}

#define CONEMAP__MOVE(column) to->column[to_slot] = from->column[slot]
CONEMAP__INLINE void conemap__move(const conemap__block_of_rays *from, int slot, conemap__block_of_rays *to,
                                   int to_slot) {
    int k;
    to->now[to_slot] = to->steps[to_slot] = 0.0f;
    to->t[to_slot] = 0.0;
    CONEMAP__MOVE(state);
    CONEMAP__MOVE(end);
    CONEMAP__MOVE(z);
    CONEMAP__MOVE(vz);
    CONEMAP__MOVE(sink);
    CONEMAP__MOVE(major);
    CONEMAP__MOVE(per_major);
    CONEMAP__MOVE(reach);
    CONEMAP__MOVE(record);
    CONEMAP__MOVE(t_end);
    CONEMAP__MOVE(z_exact);
    CONEMAP__MOVE(vz_exact);
    CONEMAP__MOVE(z_end);
    CONEMAP__MOVE(t_start);
    CONEMAP__MOVE(t_gone);
    CONEMAP__MOVE(t_scale);
    CONEMAP__MOVE(end_status);
    CONEMAP__MOVE(number);
    for (k = 0; k < 2; ++k) {
        CONEMAP__MOVE(cell[k]);
        CONEMAP__MOVE(fast[k].behind);
        CONEMAP__MOVE(fast[k].v);
        CONEMAP__MOVE(fast[k].per_v);
        CONEMAP__MOVE(fast[k].late);
        CONEMAP__MOVE(fast[k].early);
        CONEMAP__MOVE(fast[k].sign);
        CONEMAP__MOVE(way[k].p);
        CONEMAP__MOVE(way[k].v);
        CONEMAP__MOVE(way[k].per_v);
        CONEMAP__MOVE(way[k].border);
    }
}
#undef CONEMAP__MOVE

/* The kernels of one instruction set. `count` is always in texels. */
typedef struct conemap__kernels {
    /* Reads row y of the caller's heights as the texture will hold them; 0 if one is not a height. */
    int (*decode_row)(const conemap_info *info, const conemap_heights *heights, int y, float *row);
    /* Each the least of its 3x3: three rows of `width`, of which texels first..first + count - 1 are asked for. */
    void (*narrowest_row)(const float *const *rows, int width, int wraps, int first, int count, float *out);
    /* The cones of the steepest squared slopes among `rows` planes: 1 / sqrt(s) * margin, at most max_tan. */
    void (*tangent_row)(const float *const *slopes2, int rows, float margin, float max_tan, int count, float *out);
    /* The widest stored values that decode to no more than the tangents. */
    void (*store_row)(const conemap_info *info, const float *heights, const float *tangents, int count, float *cones);
    /* Maxima over 2 x 2 of two rows of `width`, which are the same row where the last has no partner. */
    void (*maxima_row)(const float *above, const float *below, int width, float *out);
    /* The steepest of the slopes to the 8 neighbours, at least `least`: squared, for texels of a x b. Missing rows are
       null. */
    void (*ring_row)(const float *const *rows, int width, int wraps, float a, float b, float least, float *out);
    /* Squares of the longest gradients of the cells between two rows. */
    void (*gradient_row)(const float *above, const float *below, int width, int wraps, float a, float b, float *out);
    /* Squares of what each texel sees of its own four cells, at least `least`. Missing rows are null. */
    void (*corners_row)(const float *const *rows, int width, int wraps, float a, float b, float least, float *out);
    /* The steepest that a few neighbours make of it: maxima of dh^2 * inverse[k] over height differences to the texel
       columns[k] to the right in rows[k]. */
    void (*near_row)(const float *row, const float *const *rows, const int *columns, const float *inverse, int n,
                     int width, int wraps, int first, int count, float *out);
    /* Raises `out` to the steepest squared slope, by step 4 of the proof of safe cones, from each texel up to the cells
       near it; or, given what is known of the texels in this row, from each cell, by its lower corner, up to the
       vertices near it. rows[k] is the k-th row from this one, null where there is none. */
    void (*sights_row)(const conemap__sights *sights, const float *const *rows, int width, int wraps,
                       const float *known, int first, int count, float *out);
    /* Step 4 of the proof of safe cones: the eye at the origin sees a patch whose corner k stands at
       (x + (k & 1) size_x, y + (k >> 1) size_y), h[k] above it. The larger of `best` and a bound of the squared slope.
       `above` is a bound that the whole patch has already, so that its pieces are never worse. */
    float (*patch)(const float *h, float x, float y, float size_x, float size_y, float above, float best);
    /* Maxima over n planes' rows, each shifted by so many columns; beyond a border it is repeated. */
    void (*steepest_row)(const float *const *rows, const int *columns, int n, int width, int wraps, int first,
                         int count, float *out);
    /* [VB22] for up to 16 columns of a row: squared slopes, at least `least`. */
    void (*quick_row)(const conemap_pyramid *pyramid, const conemap__quick_columns *columns,
                      const conemap__quick_level *levels, const float *heights, float least, int count, float *out);
    /* Raises a tile's slopes to the steepest there is. */
    void (*search_tile)(const conemap_map *map, conemap__search *search, conemap__tile *tile);
    /* The larger of two rows; and what a square, the larger of two places in a row, does to conemap__look's columns. */
    void (*larger_row)(const float *a, const float *b, int count, float *out);
    void (*rise_row)(const float *squares, int shift, const float *tops, float per_reach, int32_t code, int count,
                     float *slopes, int32_t *clear);
    /* Traces the flight's stream. */
    void (*fly)(conemap__flight *flight);
} conemap__kernels;

#define CONEMAP__KERNEL_LIST(isa)                                                                                  \
    { conemap__decode_row_##isa, conemap__narrowest_row_##isa, conemap__tangent_row_##isa, conemap__store_row_##isa, \
      conemap__maxima_row_##isa, conemap__ring_row_##isa, conemap__gradient_row_##isa, conemap__corners_row_##isa, \
      conemap__near_row_##isa, conemap__sights_row_##isa, conemap__patch_##isa, conemap__steepest_row_##isa,   \
      conemap__quick_row_##isa, conemap__search_tile_##isa,                                                         \
      conemap__larger_row_##isa, conemap__rise_row_##isa, conemap__fly_##isa }

/* ---- plain C ------------------------------------------------------------------------------------------------- */
#define CONEMAP__LANES 1
#define CONEMAP__KERNEL(name) conemap__##name##_scalar
#define CONEMAP__TARGET
#define CONEMAP__F float
#define CONEMAP__I int32_t
#define CONEMAP__M int
#define CONEMAP__F1(x) (x)
#define CONEMAP__I1(x) (x)
#define CONEMAP__LOADF(p) (*(p))
#define CONEMAP__STOREF(p, v) ((void)(*(p) = (v)))
#define CONEMAP__LOADI(p) (*(p))
#define CONEMAP__STOREI(p, v) ((void)(*(p) = (v)))
#define CONEMAP__LOADU8(p) ((int32_t)*(p))
#define CONEMAP__LOADU16(p) ((int32_t)conemap__read_code(CONEMAP_UNORM16, (p)))
#define CONEMAP__GATHERF(base, i) ((base)[i])
#define CONEMAP__ADD(a, b) ((a) + (b))
#define CONEMAP__SUB(a, b) ((a) - (b))
#define CONEMAP__MUL(a, b) ((a) * (b))
#define CONEMAP__DIV(a, b) ((a) / (b))
#define CONEMAP__SQRT(a) sqrtf(a)
#define CONEMAP__MIN(a, b) conemap__min((a), (b))
#define CONEMAP__MAX(a, b) conemap__max((a), (b))
#define CONEMAP__IADD(a, b) ((int32_t)((uint32_t)(a) + (uint32_t)(b)))
#define CONEMAP__ISUB(a, b) ((int32_t)((uint32_t)(a) - (uint32_t)(b)))
#define CONEMAP__IMUL(a, b) ((int32_t)((uint32_t)(a) * (uint32_t)(b)))
#define CONEMAP__IAND(a, b) ((a) & (b))
#define CONEMAP__IOR(a, b) ((a) | (b))
#define CONEMAP__ISHL(a, n) ((int32_t)((uint32_t)(a) << (n)))
#define CONEMAP__ISHR(a, n) ((int32_t)((uint32_t)(a) >> (n)))
#define CONEMAP__LT(a, b) ((a) < (b))
#define CONEMAP__LE(a, b) ((a) <= (b))
#define CONEMAP__IGT(a, b) ((a) > (b))
#define CONEMAP__IEQ(a, b) ((a) == (b))
#define CONEMAP__AND(a, b) ((a) & (b))
#define CONEMAP__OR(a, b) ((a) | (b))
#define CONEMAP__ANDNOT(a, b) ((a) & !(b))
#define CONEMAP__PICK(m, a, b) ((m) ? (a) : (b))
#define CONEMAP__PICKI(m, a, b) ((m) ? (a) : (b))
#define CONEMAP__ANY(m) (m)
#define CONEMAP__BITS(m) (m)
#define CONEMAP__TOF(i) ((float)(i))
#define CONEMAP__TOI(f) ((int32_t)(f))
#define CONEMAP__BITSF(i) conemap__from_bits((uint32_t)(i))
#define CONEMAP__BITSI(f) ((int32_t)conemap__bits(f))
#define CONEMAP__EVEN(a, b) (a)
#define CONEMAP__ODD(a, b) (b)
#define CONEMAP__DLANES 1
#define CONEMAP__D double
#define CONEMAP__L uint64_t
#define CONEMAP__W int
#define CONEMAP__D1(x) (x)
#define CONEMAP__L1(x) (x)
#define CONEMAP__LOADD(p) (*(p))
#define CONEMAP__STORED(p, v) ((void)(*(p) = (v)))
#define CONEMAP__STOREN(p, a) ((void)(*(p) = (int32_t)(a)))
#define CONEMAP__STOREDF(p, a) ((void)(*(p) = (float)(a)))
#define CONEMAP__GATHERI(base, p) ((int32_t)(base)[*(p)])
#define CONEMAP__GATHERFD(base, p) ((double)(base)[*(p)])
#define CONEMAP__ADDD(a, b) ((a) + (b))
#define CONEMAP__SUBD(a, b) ((a) - (b))
#define CONEMAP__MULD(a, b) ((a) * (b))
#define CONEMAP__DIVD(a, b) ((a) / (b))
#define CONEMAP__SQRTD(a) sqrt(a)
#define CONEMAP__MIND(a, b) ((a) < (b) ? (a) : (b))
#define CONEMAP__MAXD(a, b) ((a) > (b) ? (a) : (b))
#define CONEMAP__WHOLE(a) ((double)(int32_t)(a))
#define CONEMAP__LTD(a, b) ((a) < (b))
#define CONEMAP__LED(a, b) ((a) <= (b))
#define CONEMAP__ANDW(a, b) ((a) & (b))
#define CONEMAP__ORW(a, b) ((a) | (b))
#define CONEMAP__ANDNOTW(a, b) ((a) & !(b))
#define CONEMAP__PICKD(m, a, b) ((m) ? (a) : (b))
#define CONEMAP__BITSW(m) (m)
#define CONEMAP__LAND(a, b) ((a) & (b))
#define CONEMAP__BITSD(a) conemap__double_of(a)
#define CONEMAP__LOADFD(p) ((double)*(p))
#define CONEMAP__FLOORD(a) conemap__floor_wide(a)
#define CONEMAP__LSUB(a, b) ((a) - (b))
#define CONEMAP__BITSL(a) conemap__bits_of(a)
#include CONEMAP_SELF
static const conemap__kernels conemap__kernels_scalar = CONEMAP__KERNEL_LIST(scalar);

#ifdef CONEMAP__X86
#ifdef _MSC_VER
#define CONEMAP__ATTRIBUTE(features)
#else
#define CONEMAP__ATTRIBUTE(features) __attribute__((target(features)))
#endif

/* ---- SSE2 ---------------------------------------------------------------------------------------------------- */
#define CONEMAP__LANES 4
#define CONEMAP__KERNEL(name) conemap__##name##_sse2
#define CONEMAP__TARGET
#define CONEMAP__F __m128
#define CONEMAP__I __m128i
#define CONEMAP__M __m128
#define CONEMAP__F1(x) _mm_set1_ps(x)
#define CONEMAP__I1(x) _mm_set1_epi32(x)
#define CONEMAP__LOADF(p) _mm_loadu_ps(p)
#define CONEMAP__STOREF(p, v) _mm_storeu_ps(p, v)
#define CONEMAP__LOADI(p) _mm_loadu_si128((const __m128i *)(const void *)(p))
#define CONEMAP__STOREI(p, v) _mm_storeu_si128((__m128i *)(void *)(p), v)
#define CONEMAP__LOADU8(p)                                                                                 \
    _mm_unpacklo_epi16(_mm_unpacklo_epi8(_mm_cvtsi32_si128(conemap__four_bytes(p)), _mm_setzero_si128()),  \
                       _mm_setzero_si128())
#define CONEMAP__LOADU16(p) _mm_unpacklo_epi16(_mm_loadl_epi64((const __m128i *)(const void *)(p)), _mm_setzero_si128())
#define CONEMAP__GATHERF(base, i)                                                                          \
    _mm_set_ps((base)[_mm_cvtsi128_si32(_mm_shuffle_epi32(i, 255))],                                       \
               (base)[_mm_cvtsi128_si32(_mm_shuffle_epi32(i, 170))],                                       \
               (base)[_mm_cvtsi128_si32(_mm_shuffle_epi32(i, 85))], (base)[_mm_cvtsi128_si32(i)])
#define CONEMAP__ADD(a, b) _mm_add_ps(a, b)
#define CONEMAP__SUB(a, b) _mm_sub_ps(a, b)
#define CONEMAP__MUL(a, b) _mm_mul_ps(a, b)
#define CONEMAP__DIV(a, b) _mm_div_ps(a, b)
#define CONEMAP__SQRT(a) _mm_sqrt_ps(a)
#define CONEMAP__MIN(a, b) _mm_min_ps(a, b)
#define CONEMAP__MAX(a, b) _mm_max_ps(a, b)
#define CONEMAP__IADD(a, b) _mm_add_epi32(a, b)
#define CONEMAP__ISUB(a, b) _mm_sub_epi32(a, b)
#define CONEMAP__IMUL(a, b)                                                                                \
    _mm_unpacklo_epi32(_mm_shuffle_epi32(_mm_mul_epu32(a, b), 8),                                          \
                       _mm_shuffle_epi32(_mm_mul_epu32(_mm_srli_epi64(a, 32), _mm_srli_epi64(b, 32)), 8))
#define CONEMAP__IAND(a, b) _mm_and_si128(a, b)
#define CONEMAP__IOR(a, b) _mm_or_si128(a, b)
#define CONEMAP__ISHL(a, n) _mm_slli_epi32(a, n)
#define CONEMAP__ISHR(a, n) _mm_srli_epi32(a, n)
#define CONEMAP__LT(a, b) _mm_cmplt_ps(a, b)
#define CONEMAP__LE(a, b) _mm_cmple_ps(a, b)
#define CONEMAP__IGT(a, b) _mm_castsi128_ps(_mm_cmpgt_epi32(a, b))
#define CONEMAP__IEQ(a, b) _mm_castsi128_ps(_mm_cmpeq_epi32(a, b))
#define CONEMAP__AND(a, b) _mm_and_ps(a, b)
#define CONEMAP__OR(a, b) _mm_or_ps(a, b)
#define CONEMAP__ANDNOT(a, b) _mm_andnot_ps(b, a)
#define CONEMAP__PICK(m, a, b) _mm_or_ps(_mm_and_ps(m, a), _mm_andnot_ps(m, b))
#define CONEMAP__PICKI(m, a, b)                                                                            \
    _mm_or_si128(_mm_and_si128(_mm_castps_si128(m), a), _mm_andnot_si128(_mm_castps_si128(m), b))
#define CONEMAP__ANY(m) (_mm_movemask_ps(m) != 0)
#define CONEMAP__BITS(m) _mm_movemask_ps(m)
#define CONEMAP__TOF(i) _mm_cvtepi32_ps(i)
#define CONEMAP__TOI(f) _mm_cvttps_epi32(f)
#define CONEMAP__BITSF(i) _mm_castsi128_ps(i)
#define CONEMAP__BITSI(f) _mm_castps_si128(f)
#define CONEMAP__EVEN(a, b) _mm_shuffle_ps(a, b, 0x88)
#define CONEMAP__ODD(a, b) _mm_shuffle_ps(a, b, 0xdd)
#define CONEMAP__DLANES 2
#define CONEMAP__D __m128d
#define CONEMAP__L __m128i
#define CONEMAP__W __m128d
#define CONEMAP__D1(x) _mm_set1_pd(x)
#define CONEMAP__L1(x) _mm_set1_epi64x((long long)(x))
#define CONEMAP__LOADD(p) _mm_loadu_pd(p)
#define CONEMAP__STORED(p, v) _mm_storeu_pd(p, v)
#define CONEMAP__STOREN(p, a) _mm_storel_epi64((__m128i *)(void *)(p), _mm_cvttpd_epi32(a))
#define CONEMAP__STOREDF(p, a) _mm_storel_pd((double *)(void *)(p), _mm_castps_pd(_mm_cvtpd_ps(a)))
#define CONEMAP__GATHERI(base, p)                                                                          \
    _mm_set_epi32((int)(base)[(p)[3]], (int)(base)[(p)[2]], (int)(base)[(p)[1]], (int)(base)[(p)[0]])
#define CONEMAP__GATHERFD(base, p) _mm_set_pd((double)(base)[(p)[1]], (double)(base)[(p)[0]])
#define CONEMAP__ADDD(a, b) _mm_add_pd(a, b)
#define CONEMAP__SUBD(a, b) _mm_sub_pd(a, b)
#define CONEMAP__MULD(a, b) _mm_mul_pd(a, b)
#define CONEMAP__DIVD(a, b) _mm_div_pd(a, b)
#define CONEMAP__SQRTD(a) _mm_sqrt_pd(a)
#define CONEMAP__MIND(a, b) _mm_min_pd(a, b)
#define CONEMAP__MAXD(a, b) _mm_max_pd(a, b)
#define CONEMAP__WHOLE(a) _mm_cvtepi32_pd(_mm_cvttpd_epi32(a))
#define CONEMAP__LTD(a, b) _mm_cmplt_pd(a, b)
#define CONEMAP__LED(a, b) _mm_cmple_pd(a, b)
#define CONEMAP__ANDW(a, b) _mm_and_pd(a, b)
#define CONEMAP__ORW(a, b) _mm_or_pd(a, b)
#define CONEMAP__ANDNOTW(a, b) _mm_andnot_pd(b, a)
#define CONEMAP__PICKD(m, a, b) _mm_or_pd(_mm_and_pd(m, a), _mm_andnot_pd(m, b))
#define CONEMAP__BITSW(m) _mm_movemask_pd(m)
#define CONEMAP__LAND(a, b) _mm_and_si128(a, b)
#define CONEMAP__BITSD(a) _mm_castsi128_pd(a)
#define CONEMAP__LOADFD(p) _mm_set_pd((double)(p)[1], (double)(p)[0])
#define CONEMAP__FLOORD(a)                                                                                 \
    _mm_set_pd(conemap__floor_wide(_mm_cvtsd_f64(_mm_unpackhi_pd(a, a))), conemap__floor_wide(_mm_cvtsd_f64(a)))
#define CONEMAP__LSUB(a, b) _mm_sub_epi64(a, b)
#define CONEMAP__BITSL(a) _mm_castpd_si128(a)
#include CONEMAP_SELF
static const conemap__kernels conemap__kernels_sse2 = CONEMAP__KERNEL_LIST(sse2);

/* ---- AVX2 ---------------------------------------------------------------------------------------------------- */
#define CONEMAP__LANES 8
#define CONEMAP__KERNEL(name) conemap__##name##_avx2
#define CONEMAP__TARGET CONEMAP__ATTRIBUTE("avx2")
#define CONEMAP__F __m256
#define CONEMAP__I __m256i
#define CONEMAP__M __m256
#define CONEMAP__F1(x) _mm256_set1_ps(x)
#define CONEMAP__I1(x) _mm256_set1_epi32(x)
#define CONEMAP__LOADF(p) _mm256_loadu_ps(p)
#define CONEMAP__STOREF(p, v) _mm256_storeu_ps(p, v)
#define CONEMAP__LOADI(p) _mm256_loadu_si256((const __m256i *)(const void *)(p))
#define CONEMAP__STOREI(p, v) _mm256_storeu_si256((__m256i *)(void *)(p), v)
#define CONEMAP__LOADU8(p) _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)(const void *)(p)))
#define CONEMAP__LOADU16(p) _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)(const void *)(p)))
#define CONEMAP__GATHERF(base, i) _mm256_i32gather_ps(base, i, 4)
#define CONEMAP__ADD(a, b) _mm256_add_ps(a, b)
#define CONEMAP__SUB(a, b) _mm256_sub_ps(a, b)
#define CONEMAP__MUL(a, b) _mm256_mul_ps(a, b)
#define CONEMAP__DIV(a, b) _mm256_div_ps(a, b)
#define CONEMAP__SQRT(a) _mm256_sqrt_ps(a)
#define CONEMAP__MIN(a, b) _mm256_min_ps(a, b)
#define CONEMAP__MAX(a, b) _mm256_max_ps(a, b)
#define CONEMAP__IADD(a, b) _mm256_add_epi32(a, b)
#define CONEMAP__ISUB(a, b) _mm256_sub_epi32(a, b)
#define CONEMAP__IMUL(a, b) _mm256_mullo_epi32(a, b)
#define CONEMAP__IAND(a, b) _mm256_and_si256(a, b)
#define CONEMAP__IOR(a, b) _mm256_or_si256(a, b)
#define CONEMAP__ISHL(a, n) _mm256_slli_epi32(a, n)
#define CONEMAP__ISHR(a, n) _mm256_srli_epi32(a, n)
#define CONEMAP__LT(a, b) _mm256_cmp_ps(a, b, _CMP_LT_OQ)
#define CONEMAP__LE(a, b) _mm256_cmp_ps(a, b, _CMP_LE_OQ)
#define CONEMAP__IGT(a, b) _mm256_castsi256_ps(_mm256_cmpgt_epi32(a, b))
#define CONEMAP__IEQ(a, b) _mm256_castsi256_ps(_mm256_cmpeq_epi32(a, b))
#define CONEMAP__AND(a, b) _mm256_and_ps(a, b)
#define CONEMAP__OR(a, b) _mm256_or_ps(a, b)
#define CONEMAP__ANDNOT(a, b) _mm256_andnot_ps(b, a)
#define CONEMAP__PICK(m, a, b) _mm256_blendv_ps(b, a, m)
#define CONEMAP__PICKI(m, a, b) _mm256_blendv_epi8(b, a, _mm256_castps_si256(m))
#define CONEMAP__ANY(m) (_mm256_movemask_ps(m) != 0)
#define CONEMAP__BITS(m) _mm256_movemask_ps(m)
#define CONEMAP__TOF(i) _mm256_cvtepi32_ps(i)
#define CONEMAP__TOI(f) _mm256_cvttps_epi32(f)
#define CONEMAP__BITSF(i) _mm256_castsi256_ps(i)
#define CONEMAP__BITSI(f) _mm256_castps_si256(f)
#define CONEMAP__EVEN(a, b)                                                                                \
    _mm256_castpd_ps(_mm256_permute4x64_pd(_mm256_castps_pd(_mm256_shuffle_ps(a, b, 0x88)), 0xd8))
#define CONEMAP__ODD(a, b)                                                                                 \
    _mm256_castpd_ps(_mm256_permute4x64_pd(_mm256_castps_pd(_mm256_shuffle_ps(a, b, 0xdd)), 0xd8))
#define CONEMAP__DLANES 4
#define CONEMAP__D __m256d
#define CONEMAP__L __m256i
#define CONEMAP__W __m256d
#define CONEMAP__D1(x) _mm256_set1_pd(x)
#define CONEMAP__L1(x) _mm256_set1_epi64x((long long)(x))
#define CONEMAP__LOADD(p) _mm256_loadu_pd(p)
#define CONEMAP__STORED(p, v) _mm256_storeu_pd(p, v)
#define CONEMAP__STOREN(p, a) _mm_storeu_si128((__m128i *)(void *)(p), _mm256_cvttpd_epi32(a))
#define CONEMAP__LOADN(p) _mm_loadu_si128((const __m128i *)(const void *)(p))
#define CONEMAP__STOREDF(p, a) _mm_storeu_ps(p, _mm256_cvtpd_ps(a))
#define CONEMAP__GATHERI(base, p) _mm256_i32gather_epi32((const int *)(const void *)(base), CONEMAP__LOADI(p), 4)
#define CONEMAP__GATHERFD(base, p) _mm256_cvtps_pd(_mm_i32gather_ps(base, CONEMAP__LOADN(p), 4))
#define CONEMAP__ADDD(a, b) _mm256_add_pd(a, b)
#define CONEMAP__SUBD(a, b) _mm256_sub_pd(a, b)
#define CONEMAP__MULD(a, b) _mm256_mul_pd(a, b)
#define CONEMAP__DIVD(a, b) _mm256_div_pd(a, b)
#define CONEMAP__SQRTD(a) _mm256_sqrt_pd(a)
#define CONEMAP__MIND(a, b) _mm256_min_pd(a, b)
#define CONEMAP__MAXD(a, b) _mm256_max_pd(a, b)
#define CONEMAP__WHOLE(a) _mm256_round_pd(a, _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC)
#define CONEMAP__LTD(a, b) _mm256_cmp_pd(a, b, _CMP_LT_OQ)
#define CONEMAP__LED(a, b) _mm256_cmp_pd(a, b, _CMP_LE_OQ)
#define CONEMAP__ANDW(a, b) _mm256_and_pd(a, b)
#define CONEMAP__ORW(a, b) _mm256_or_pd(a, b)
#define CONEMAP__ANDNOTW(a, b) _mm256_andnot_pd(b, a)
#define CONEMAP__PICKD(m, a, b) _mm256_blendv_pd(b, a, m)
#define CONEMAP__BITSW(m) _mm256_movemask_pd(m)
#define CONEMAP__LAND(a, b) _mm256_and_si256(a, b)
#define CONEMAP__BITSD(a) _mm256_castsi256_pd(a)
#define CONEMAP__LOADFD(p) _mm256_cvtps_pd(_mm_loadu_ps(p))
#define CONEMAP__FLOORD(a) _mm256_round_pd(a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC)
#define CONEMAP__LSUB(a, b) _mm256_sub_epi64(a, b)
#define CONEMAP__BITSL(a) _mm256_castpd_si256(a)
#include CONEMAP_SELF
static const conemap__kernels conemap__kernels_avx2 = CONEMAP__KERNEL_LIST(avx2);

/* ---- AVX-512: masks are bits ----------------------------------------------------------------------------------- */
#define CONEMAP__LANES 16
#define CONEMAP__KERNEL(name) conemap__##name##_avx512
#define CONEMAP__TARGET CONEMAP__ATTRIBUTE("avx512f,avx512bw,avx512dq,avx512vl")
#define CONEMAP__F __m512
#define CONEMAP__I __m512i
#define CONEMAP__M __mmask16
#define CONEMAP__F1(x) _mm512_set1_ps(x)
#define CONEMAP__I1(x) _mm512_set1_epi32(x)
#define CONEMAP__LOADF(p) _mm512_loadu_ps(p)
#define CONEMAP__STOREF(p, v) _mm512_storeu_ps(p, v)
#define CONEMAP__LOADI(p) _mm512_loadu_si512(p)
#define CONEMAP__STOREI(p, v) _mm512_storeu_si512(p, v)
#define CONEMAP__ALL ((__mmask16)0xffff) /* gcc 12 warns about its own headers without a mask */
#define CONEMAP__LOADU8(p) _mm512_maskz_cvtepu8_epi32(CONEMAP__ALL, _mm_loadu_si128((const __m128i *)(const void *)(p)))
#define CONEMAP__LOADU16(p)                                                                                \
    _mm512_maskz_cvtepu16_epi32(CONEMAP__ALL, _mm256_loadu_si256((const __m256i *)(const void *)(p)))
#define CONEMAP__GATHERF(base, i) _mm512_mask_i32gather_ps(_mm512_setzero_ps(), CONEMAP__ALL, i, base, 4)
#define CONEMAP__ADD(a, b) _mm512_add_ps(a, b)
#define CONEMAP__SUB(a, b) _mm512_sub_ps(a, b)
#define CONEMAP__MUL(a, b) _mm512_mul_ps(a, b)
#define CONEMAP__DIV(a, b) _mm512_div_ps(a, b)
#define CONEMAP__SQRT(a) _mm512_maskz_sqrt_ps(CONEMAP__ALL, a)
#define CONEMAP__MIN(a, b) _mm512_maskz_min_ps(CONEMAP__ALL, a, b)
#define CONEMAP__MAX(a, b) _mm512_maskz_max_ps(CONEMAP__ALL, a, b)
#define CONEMAP__IADD(a, b) _mm512_add_epi32(a, b)
#define CONEMAP__ISUB(a, b) _mm512_sub_epi32(a, b)
#define CONEMAP__IMUL(a, b) _mm512_mullo_epi32(a, b)
#define CONEMAP__IAND(a, b) _mm512_and_si512(a, b)
#define CONEMAP__IOR(a, b) _mm512_or_si512(a, b)
#define CONEMAP__ISHL(a, n) _mm512_maskz_slli_epi32(CONEMAP__ALL, a, n)
#define CONEMAP__ISHR(a, n) _mm512_maskz_srli_epi32(CONEMAP__ALL, a, n)
#define CONEMAP__LT(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ)
#define CONEMAP__LE(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ)
#define CONEMAP__IGT(a, b) _mm512_cmpgt_epi32_mask(a, b)
#define CONEMAP__IEQ(a, b) _mm512_cmpeq_epi32_mask(a, b)
#define CONEMAP__AND(a, b) ((__mmask16)((a) & (b)))
#define CONEMAP__OR(a, b) ((__mmask16)((a) | (b)))
#define CONEMAP__ANDNOT(a, b) ((__mmask16)((a) & ~(b)))
#define CONEMAP__PICK(m, a, b) _mm512_mask_blend_ps(m, b, a)
#define CONEMAP__PICKI(m, a, b) _mm512_mask_blend_epi32(m, b, a)
#define CONEMAP__ANY(m) ((m) != 0)
#define CONEMAP__BITS(m) ((int)(m))
#define CONEMAP__TOF(i) _mm512_maskz_cvtepi32_ps(CONEMAP__ALL, i)
#define CONEMAP__TOI(f) _mm512_maskz_cvttps_epi32(CONEMAP__ALL, f)
#define CONEMAP__BITSF(i) _mm512_castsi512_ps(i)
#define CONEMAP__BITSI(f) _mm512_castps_si512(f)
#define CONEMAP__EVEN(a, b)                                                                                \
    _mm512_permutex2var_ps(a, _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30), b)
#define CONEMAP__ODD(a, b)                                                                                 \
    _mm512_permutex2var_ps(a, _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31), b)
#define CONEMAP__DLANES 8
#define CONEMAP__D __m512d
#define CONEMAP__L __m512i
#define CONEMAP__W __mmask8
#define CONEMAP__ALLD ((__mmask8)0xff)
#define CONEMAP__D1(x) _mm512_set1_pd(x)
#define CONEMAP__L1(x) _mm512_set1_epi64((long long)(x))
#define CONEMAP__LOADD(p) _mm512_loadu_pd(p)
#define CONEMAP__STORED(p, v) _mm512_storeu_pd(p, v)
#define CONEMAP__STOREN(p, a)                                                                              \
    _mm256_storeu_si256((__m256i *)(void *)(p), _mm512_maskz_cvttpd_epi32(CONEMAP__ALLD, a))
#define CONEMAP__LOADN(p) _mm256_loadu_si256((const __m256i *)(const void *)(p))
#define CONEMAP__STOREDF(p, a) _mm256_storeu_ps(p, _mm512_maskz_cvtpd_ps(CONEMAP__ALLD, a))
#define CONEMAP__GATHERI(base, p)                                                                          \
    _mm512_mask_i32gather_epi32(_mm512_setzero_si512(), CONEMAP__ALL, CONEMAP__LOADI(p), base, 4)
#define CONEMAP__GATHERFD(base, p)                                                                         \
    _mm512_maskz_cvtps_pd(CONEMAP__ALLD, _mm256_mmask_i32gather_ps(_mm256_setzero_ps(), CONEMAP__ALLD,     \
                                                                   CONEMAP__LOADN(p), base, 4))
#define CONEMAP__ADDD(a, b) _mm512_add_pd(a, b)
#define CONEMAP__SUBD(a, b) _mm512_sub_pd(a, b)
#define CONEMAP__MULD(a, b) _mm512_mul_pd(a, b)
#define CONEMAP__DIVD(a, b) _mm512_div_pd(a, b)
#define CONEMAP__SQRTD(a) _mm512_maskz_sqrt_pd(CONEMAP__ALLD, a)
#define CONEMAP__MIND(a, b) _mm512_maskz_min_pd(CONEMAP__ALLD, a, b)
#define CONEMAP__MAXD(a, b) _mm512_maskz_max_pd(CONEMAP__ALLD, a, b)
#define CONEMAP__WHOLE(a) _mm512_maskz_roundscale_pd(CONEMAP__ALLD, a, _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC)
#define CONEMAP__LTD(a, b) _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ)
#define CONEMAP__LED(a, b) _mm512_cmp_pd_mask(a, b, _CMP_LE_OQ)
#define CONEMAP__ANDW(a, b) ((__mmask8)((a) & (b)))
#define CONEMAP__ORW(a, b) ((__mmask8)((a) | (b)))
#define CONEMAP__ANDNOTW(a, b) ((__mmask8)((a) & ~(b)))
#define CONEMAP__PICKD(m, a, b) _mm512_mask_blend_pd(m, b, a)
#define CONEMAP__BITSW(m) ((int)(m))
#define CONEMAP__LAND(a, b) _mm512_and_si512(a, b)
#define CONEMAP__BITSD(a) _mm512_castsi512_pd(a)
#define CONEMAP__LOADFD(p) _mm512_maskz_cvtps_pd(CONEMAP__ALLD, _mm256_loadu_ps(p))
#define CONEMAP__FLOORD(a) _mm512_maskz_roundscale_pd(CONEMAP__ALLD, a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC)
#define CONEMAP__LSUB(a, b) _mm512_sub_epi64(a, b)
#define CONEMAP__BITSL(a) _mm512_castpd_si512(a)
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion" /* in gcc 12's own macro for gathers, without optimisation */
#endif
#include CONEMAP_SELF
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif
static const conemap__kernels conemap__kernels_avx512 = CONEMAP__KERNEL_LIST(avx512);
#undef CONEMAP__ALL
#undef CONEMAP__ALLD
#endif

#ifdef CONEMAP__ARM
/* ---- NEON, 64-bit: the 32-bit one has no division and flushes small numbers to zero ------------------------------ */
#define CONEMAP__LANES 4
#define CONEMAP__KERNEL(name) conemap__##name##_neon
#define CONEMAP__TARGET
#define CONEMAP__F float32x4_t
#define CONEMAP__I int32x4_t
#define CONEMAP__M uint32x4_t
#define CONEMAP__F1(x) vdupq_n_f32(x)
#define CONEMAP__I1(x) vdupq_n_s32(x)
#define CONEMAP__LOADF(p) vld1q_f32(p)
#define CONEMAP__STOREF(p, v) vst1q_f32(p, v)
#define CONEMAP__LOADI(p) vld1q_s32(p)
#define CONEMAP__STOREI(p, v) vst1q_s32(p, v)
#define CONEMAP__LOADU8(p)                                                                                 \
    vreinterpretq_s32_u32(vmovl_u16(vget_low_u16(vmovl_u8(vcreate_u8((uint32_t)conemap__four_bytes(p))))))
#define CONEMAP__LOADU16(p) vreinterpretq_s32_u32(vmovl_u16(vreinterpret_u16_u8(vld1_u8(p))))
#define CONEMAP__GATHERF(base, i)                                                                          \
    vsetq_lane_f32((base)[vgetq_lane_s32(i, 3)],                                                           \
        vsetq_lane_f32((base)[vgetq_lane_s32(i, 2)],                                                       \
            vsetq_lane_f32((base)[vgetq_lane_s32(i, 1)], vdupq_n_f32((base)[vgetq_lane_s32(i, 0)]), 1), 2), 3)
#define CONEMAP__ADD(a, b) vaddq_f32(a, b)
#define CONEMAP__SUB(a, b) vsubq_f32(a, b)
#define CONEMAP__MUL(a, b) vmulq_f32(a, b)
#define CONEMAP__DIV(a, b) vdivq_f32(a, b)
#define CONEMAP__SQRT(a) vsqrtq_f32(a)
#define CONEMAP__MIN(a, b) vminq_f32(a, b)
#define CONEMAP__MAX(a, b) vmaxq_f32(a, b)
#define CONEMAP__IADD(a, b) vaddq_s32(a, b)
#define CONEMAP__ISUB(a, b) vsubq_s32(a, b)
#define CONEMAP__IMUL(a, b) vmulq_s32(a, b)
#define CONEMAP__IAND(a, b) vandq_s32(a, b)
#define CONEMAP__IOR(a, b) vorrq_s32(a, b)
#define CONEMAP__ISHL(a, n) vshlq_n_s32(a, n)
#define CONEMAP__ISHR(a, n) vreinterpretq_s32_u32(vshrq_n_u32(vreinterpretq_u32_s32(a), n))
#define CONEMAP__LT(a, b) vcltq_f32(a, b)
#define CONEMAP__LE(a, b) vcleq_f32(a, b)
#define CONEMAP__IGT(a, b) vcgtq_s32(a, b)
#define CONEMAP__IEQ(a, b) vceqq_s32(a, b)
#define CONEMAP__AND(a, b) vandq_u32(a, b)
#define CONEMAP__OR(a, b) vorrq_u32(a, b)
#define CONEMAP__ANDNOT(a, b) vbicq_u32(a, b)
#define CONEMAP__PICK(m, a, b) vbslq_f32(m, a, b)
#define CONEMAP__PICKI(m, a, b) vbslq_s32(m, a, b)
#define CONEMAP__ANY(m) (vmaxvq_u32(m) != 0)
#define CONEMAP__BITS(m)                                                                                   \
    ((int)vaddvq_u32(vandq_u32(m, vcombine_u32(vcreate_u32(UINT64_C(0x200000001)),                         \
                                               vcreate_u32(UINT64_C(0x800000004))))))
#define CONEMAP__TOF(i) vcvtq_f32_s32(i)
#define CONEMAP__TOI(f) vcvtq_s32_f32(f)
#define CONEMAP__BITSF(i) vreinterpretq_f32_s32(i)
#define CONEMAP__BITSI(f) vreinterpretq_s32_f32(f)
#define CONEMAP__EVEN(a, b) vuzp1q_f32(a, b)
#define CONEMAP__ODD(a, b) vuzp2q_f32(a, b)
#define CONEMAP__DLANES 2
#define CONEMAP__D float64x2_t
#define CONEMAP__L uint64x2_t
#define CONEMAP__W uint64x2_t
#define CONEMAP__D1(x) vdupq_n_f64(x)
#define CONEMAP__L1(x) vdupq_n_u64(x)
#define CONEMAP__LOADD(p) vld1q_f64(p)
#define CONEMAP__STORED(p, v) vst1q_f64(p, v)
#define CONEMAP__STOREN(p, a) vst1_s32(p, vmovn_s64(vcvtq_s64_f64(a)))
#define CONEMAP__STOREDF(p, a) vst1_f32(p, vcvt_f32_f64(a))
#define CONEMAP__GATHERI(base, p)                                                                          \
    vcombine_s32(vcreate_s32((uint64_t)(base)[(p)[0]] | (uint64_t)(base)[(p)[1]] << 32),                   \
                 vcreate_s32((uint64_t)(base)[(p)[2]] | (uint64_t)(base)[(p)[3]] << 32))
#define CONEMAP__GATHERFD(base, p)                                                                         \
    vsetq_lane_f64((double)(base)[(p)[1]], vdupq_n_f64((double)(base)[(p)[0]]), 1)
#define CONEMAP__ADDD(a, b) vaddq_f64(a, b)
#define CONEMAP__SUBD(a, b) vsubq_f64(a, b)
#define CONEMAP__MULD(a, b) vmulq_f64(a, b)
#define CONEMAP__DIVD(a, b) vdivq_f64(a, b)
#define CONEMAP__SQRTD(a) vsqrtq_f64(a)
#define CONEMAP__MIND(a, b) vminq_f64(a, b)
#define CONEMAP__MAXD(a, b) vmaxq_f64(a, b)
#define CONEMAP__WHOLE(a) vrndq_f64(a)
#define CONEMAP__LTD(a, b) vcltq_f64(a, b)
#define CONEMAP__LED(a, b) vcleq_f64(a, b)
#define CONEMAP__ANDW(a, b) vandq_u64(a, b)
#define CONEMAP__ORW(a, b) vorrq_u64(a, b)
#define CONEMAP__ANDNOTW(a, b) vbicq_u64(a, b)
#define CONEMAP__PICKD(m, a, b) vbslq_f64(m, a, b)
#define CONEMAP__BITSW(m) ((int)(vgetq_lane_u64(m, 0) & 1u) | (int)(vgetq_lane_u64(m, 1) & 2u))
#define CONEMAP__LAND(a, b) vandq_u64(a, b)
#define CONEMAP__BITSD(a) vreinterpretq_f64_u64(a)
#define CONEMAP__LOADFD(p) vcvt_f64_f32(vld1_f32(p))
#define CONEMAP__FLOORD(a) vrndmq_f64(a)
#define CONEMAP__LSUB(a, b) vsubq_u64(a, b)
#define CONEMAP__BITSL(a) vreinterpretq_u64_f64(a)
#include CONEMAP_SELF
static const conemap__kernels conemap__kernels_neon = CONEMAP__KERNEL_LIST(neon);
#endif

#ifdef CONEMAP__WASM
/* ---- WebAssembly ----------------------------------------------------------------------------------------------- */
#define CONEMAP__LANES 4
#define CONEMAP__KERNEL(name) conemap__##name##_wasm
#define CONEMAP__TARGET
#define CONEMAP__F v128_t
#define CONEMAP__I v128_t
#define CONEMAP__M v128_t
#define CONEMAP__F1(x) wasm_f32x4_splat(x)
#define CONEMAP__I1(x) wasm_i32x4_splat(x)
#define CONEMAP__LOADF(p) wasm_v128_load(p)
#define CONEMAP__STOREF(p, v) wasm_v128_store(p, v)
#define CONEMAP__LOADI(p) wasm_v128_load(p)
#define CONEMAP__STOREI(p, v) wasm_v128_store(p, v)
#define CONEMAP__LOADU8(p) wasm_u32x4_extend_low_u16x8(wasm_u16x8_extend_low_u8x16(wasm_v128_load32_zero(p)))
#define CONEMAP__LOADU16(p) wasm_u32x4_load16x4(p)
#define CONEMAP__GATHERF(base, i)                                                                          \
    wasm_f32x4_make((base)[wasm_i32x4_extract_lane(i, 0)], (base)[wasm_i32x4_extract_lane(i, 1)],          \
                    (base)[wasm_i32x4_extract_lane(i, 2)], (base)[wasm_i32x4_extract_lane(i, 3)])
#define CONEMAP__ADD(a, b) wasm_f32x4_add(a, b)
#define CONEMAP__SUB(a, b) wasm_f32x4_sub(a, b)
#define CONEMAP__MUL(a, b) wasm_f32x4_mul(a, b)
#define CONEMAP__DIV(a, b) wasm_f32x4_div(a, b)
#define CONEMAP__SQRT(a) wasm_f32x4_sqrt(a)
#define CONEMAP__MIN(a, b) wasm_f32x4_pmin(b, a)
#define CONEMAP__MAX(a, b) wasm_f32x4_pmax(b, a)
#define CONEMAP__IADD(a, b) wasm_i32x4_add(a, b)
#define CONEMAP__ISUB(a, b) wasm_i32x4_sub(a, b)
#define CONEMAP__IMUL(a, b) wasm_i32x4_mul(a, b)
#define CONEMAP__IAND(a, b) wasm_v128_and(a, b)
#define CONEMAP__IOR(a, b) wasm_v128_or(a, b)
#define CONEMAP__ISHL(a, n) wasm_i32x4_shl(a, n)
#define CONEMAP__ISHR(a, n) wasm_u32x4_shr(a, n)
#define CONEMAP__LT(a, b) wasm_f32x4_lt(a, b)
#define CONEMAP__LE(a, b) wasm_f32x4_le(a, b)
#define CONEMAP__IGT(a, b) wasm_i32x4_gt(a, b)
#define CONEMAP__IEQ(a, b) wasm_i32x4_eq(a, b)
#define CONEMAP__AND(a, b) wasm_v128_and(a, b)
#define CONEMAP__OR(a, b) wasm_v128_or(a, b)
#define CONEMAP__ANDNOT(a, b) wasm_v128_andnot(a, b)
#define CONEMAP__PICK(m, a, b) wasm_v128_bitselect(a, b, m)
#define CONEMAP__PICKI(m, a, b) wasm_v128_bitselect(a, b, m)
#define CONEMAP__ANY(m) wasm_v128_any_true(m)
#define CONEMAP__BITS(m) ((int)wasm_i32x4_bitmask(m))
#define CONEMAP__TOF(i) wasm_f32x4_convert_i32x4(i)
#define CONEMAP__TOI(f) wasm_i32x4_trunc_sat_f32x4(f)
#define CONEMAP__BITSF(i) (i)
#define CONEMAP__BITSI(f) (f)
#define CONEMAP__EVEN(a, b) wasm_i32x4_shuffle(a, b, 0, 2, 4, 6)
#define CONEMAP__ODD(a, b) wasm_i32x4_shuffle(a, b, 1, 3, 5, 7)
#define CONEMAP__DLANES 2
#define CONEMAP__D v128_t
#define CONEMAP__L v128_t
#define CONEMAP__W v128_t
#define CONEMAP__D1(x) wasm_f64x2_splat(x)
#define CONEMAP__L1(x) wasm_i64x2_splat((int64_t)(x))
#define CONEMAP__LOADD(p) wasm_v128_load(p)
#define CONEMAP__STORED(p, v) wasm_v128_store(p, v)
#define CONEMAP__STOREN(p, a) wasm_v128_store64_lane(p, wasm_i32x4_trunc_sat_f64x2_zero(a), 0)
#define CONEMAP__STOREDF(p, a) wasm_v128_store64_lane(p, wasm_f32x4_demote_f64x2_zero(a), 0)
#define CONEMAP__GATHERI(base, p)                                                                          \
    wasm_i32x4_make((int32_t)(base)[(p)[0]], (int32_t)(base)[(p)[1]], (int32_t)(base)[(p)[2]], (int32_t)(base)[(p)[3]])
#define CONEMAP__GATHERFD(base, p) wasm_f64x2_make((double)(base)[(p)[0]], (double)(base)[(p)[1]])
#define CONEMAP__ADDD(a, b) wasm_f64x2_add(a, b)
#define CONEMAP__SUBD(a, b) wasm_f64x2_sub(a, b)
#define CONEMAP__MULD(a, b) wasm_f64x2_mul(a, b)
#define CONEMAP__DIVD(a, b) wasm_f64x2_div(a, b)
#define CONEMAP__SQRTD(a) wasm_f64x2_sqrt(a)
#define CONEMAP__MIND(a, b) wasm_f64x2_pmin(b, a)
#define CONEMAP__MAXD(a, b) wasm_f64x2_pmax(b, a)
#define CONEMAP__WHOLE(a) wasm_f64x2_trunc(a)
#define CONEMAP__LTD(a, b) wasm_f64x2_lt(a, b)
#define CONEMAP__LED(a, b) wasm_f64x2_le(a, b)
#define CONEMAP__ANDW(a, b) wasm_v128_and(a, b)
#define CONEMAP__ORW(a, b) wasm_v128_or(a, b)
#define CONEMAP__ANDNOTW(a, b) wasm_v128_andnot(a, b)
#define CONEMAP__PICKD(m, a, b) wasm_v128_bitselect(a, b, m)
#define CONEMAP__BITSW(m) ((int)wasm_i64x2_bitmask(m))
#define CONEMAP__LAND(a, b) wasm_v128_and(a, b)
#define CONEMAP__BITSD(a) (a)
#define CONEMAP__LOADFD(p) wasm_f64x2_make((double)(p)[0], (double)(p)[1])
#define CONEMAP__FLOORD(a) wasm_f64x2_floor(a)
#define CONEMAP__LSUB(a, b) wasm_i64x2_sub(a, b)
#define CONEMAP__BITSL(a) (a)
#include CONEMAP_SELF
static const conemap__kernels conemap__kernels_wasm = CONEMAP__KERNEL_LIST(wasm);
#endif

/* ---- which one ------------------------------------------------------------------------------------------------- */

#if defined(CONEMAP__X86) && defined(_MSC_VER)
static conemap_isa conemap__best_isa(void) {
    int leaf[4], saved; /* the register files that the system saves: bits 1 and 2 for AVX, 5 to 7 for AVX-512 */
    __cpuidex(leaf, 0, 0);
    if (leaf[0] < 7) return CONEMAP_ISA_SSE2;
    __cpuidex(leaf, 1, 0);
    if (!(leaf[2] & 1 << 27) || !(leaf[2] & 1 << 28)) return CONEMAP_ISA_SSE2;
    saved = (int)_xgetbv(0);
    __cpuidex(leaf, 7, 0);
    if ((saved & 6) != 6 || !(leaf[1] & 1 << 5)) return CONEMAP_ISA_SSE2;
    if ((saved & 0xe6) != 0xe6 || !(leaf[1] & 1 << 16) || !(leaf[1] & 1 << 17) || !(leaf[1] & 1 << 30) || leaf[1] >= 0)
        return CONEMAP_ISA_AVX2; /* F, DQ, BW, and the sign bit is VL */
    return CONEMAP_ISA_AVX512;
}
#elif defined(CONEMAP__X86)
/* By what the compiler's own library found out when the program started: cpuid, asked here for each small map, takes
   longer than the map where a virtual machine traps it. */
static conemap_isa conemap__best_isa(void) {
    __builtin_cpu_init();
    if (!__builtin_cpu_supports("avx2")) return CONEMAP_ISA_SSE2;
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
                   __builtin_cpu_supports("avx512vl")
               ? CONEMAP_ISA_AVX512
               : CONEMAP_ISA_AVX2;
}
#elif defined(CONEMAP__ARM)
static conemap_isa conemap__best_isa(void) { return CONEMAP_ISA_NEON; }
#elif defined(CONEMAP__WASM)
static conemap_isa conemap__best_isa(void) { return CONEMAP_ISA_WASM; }
#else
static conemap_isa conemap__best_isa(void) { return CONEMAP_ISA_SCALAR; }
#endif

CONEMAP__DEF int conemap_isa_available(conemap_isa isa) {
    conemap_isa best;
    if (isa == CONEMAP_ISA_DEFAULT || isa == CONEMAP_ISA_SCALAR) return 1;
    best = conemap__best_isa();
    return isa == best || (isa > CONEMAP_ISA_SCALAR && isa < best && best <= CONEMAP_ISA_AVX512);
}

CONEMAP__DEF const char *conemap_isa_name(conemap_isa isa) {
    static const char *const names[] = {"default", "scalar", "SSE2", "AVX2", "AVX-512", "NEON", "WASM SIMD128"};
    return (int)isa >= 0 && isa < CONEMAP_ISA_COUNT ? names[(int)isa] : "unknown";
}

/* The kernels of an instruction set that is available; a map keeps which. */
static const conemap__kernels *conemap__kernels_of(conemap_isa isa) {
    switch (isa) {
#ifdef CONEMAP__X86
    case CONEMAP_ISA_SSE2: return &conemap__kernels_sse2;
    case CONEMAP_ISA_AVX2: return &conemap__kernels_avx2;
    case CONEMAP_ISA_AVX512: return &conemap__kernels_avx512;
#elif defined(CONEMAP__ARM)
    case CONEMAP_ISA_NEON: return &conemap__kernels_neon;
#elif defined(CONEMAP__WASM)
    case CONEMAP_ISA_WASM: return &conemap__kernels_wasm;
#endif
    default: return &conemap__kernels_scalar;
    }
}

/* Writes the default out; 0 if it is not to be had here. */
static int conemap__resolve_isa(conemap_isa *isa) {
    if (*isa == CONEMAP_ISA_DEFAULT) *isa = conemap__best_isa();
    return conemap_isa_available(*isa);
}

/* ======================================================================================================
   G E N E R A T I O N

   Every generator looks for s, the steepest squared slope dh^2 / d^2 from a texel to what limits its cone.
   Each rounded operation in conemap__slope2 is monotone in dh, |di| and |dj|. So a bound for a whole region, from its
   greatest height and its nearest offsets, is at least every rounded quotient inside it: searches that stop
   or prune by such bounds return the same bits as one that visits everything.
   ====================================================================================================== */

/* Offsets from a texel within which everything that can limit its cone lies, both ends included. */
typedef struct conemap__window {
    int low_u, high_u, low_v, high_v;
} conemap__window;

/* With wrap the nearest image of a texel decides; relaxed cones look at one image on either side, because
   what falls away seen from the left may rise seen from the right. */
static void conemap__axis_window(int size, conemap_wrap wrap, int at, int both_sides, int *low, int *high) {
    *low = wrap != CONEMAP_WRAP ? -at : both_sides ? 1 - size : -(size / 2);
    *high = wrap != CONEMAP_WRAP ? size - 1 - at : both_sides ? size - 1 : size / 2;
}

static conemap__window conemap__texel_window(const conemap_map *map, int i, int j, int both_sides) {
    conemap__window w;
    conemap__axis_window(map->info.width, map->info.wrap_u, i, both_sides, &w.low_u, &w.high_u);
    conemap__axis_window(map->info.height, map->info.wrap_v, j, both_sides, &w.low_v, &w.high_v);
    return w;
}

/* ---- sectors of directions: see conemap_sector ----------------------------------------------------------------

   Offsets are turned so that their quadrant is the first. An octant takes from it what is no farther along the minor
   axis than along the major one, in whole texels, so that every test is exact. */

typedef struct conemap__sector {
    int su, sv;     /* signs of the quadrant; 0: all directions */
    int major;      /* of eight sectors: 1 along u, 2 along v; 0: the whole quadrant */
    int number;     /* counts planes. (tcc 0.9.27 returns structs of 12 bytes over what lies behind them; this has
                       16) */
} conemap__sector;

CONEMAP__INLINE int conemap__planes(const conemap_info *info) { return conemap__maxi(info->texture.sectors, 1); }

static conemap__sector conemap__make_sector(const conemap_info *info, int number) {
    conemap__sector sector;
    memset(&sector, 0, sizeof sector);
    sector.number = number;
    if (conemap__planes(info) == 1) return sector;
    sector.su = number & 1 ? -1 : 1;
    sector.sv = number & 2 ? -1 : 1;
    if (conemap__planes(info) == 8) sector.major = number & 4 ? 2 : 1;
    return sector;
}

CONEMAP__INLINE int conemap__sector_number(const conemap_info *info, double du, double dv) {
    int number = (du < 0.0 ? 1 : 0) + (dv < 0.0 ? 2 : 0);
    double x = (du < 0.0 ? -du : du) * (double)info->width, y = (dv < 0.0 ? -dv : dv) * (double)info->height;
    if (conemap__planes(info) == 1) return 0;
    return conemap__planes(info) == 8 && y > x ? number + 4 : number;
}

CONEMAP__DEF int conemap_sector(const conemap_info *info, float du, float dv) {
    return info ? conemap__sector_number(info, (double)du, (double)dv) : 0;
}

/* Do texels low..high of an axis reach one of the two on either border of CLAMP? Along an axis of one texel all do.
   What lies in the outer half texel is seen by its projection onto the border, which keeps the quadrant of a direction
   but not the octant. So border cells, and the vertices that they have, count for their whole quadrant. */
CONEMAP__INLINE int conemap__by_border(int low, int high, int size, conemap_wrap wrap) {
    return size == 1 || (wrap == CONEMAP_CLAMP && (low <= 1 || high >= size - 2));
}

CONEMAP__INLINE int conemap__texels_by_border(const conemap_info *info, int low_i, int high_i, int low_j, int high_j) {
    return conemap__by_border(low_i, high_i, info->width, info->wrap_u) ||
           conemap__by_border(low_j, high_j, info->height, info->wrap_v);
}

/* Is cell (i, j), by its lower corner, a border cell or one outside? */
CONEMAP__INLINE int conemap__border_cell(const conemap_info *info, int i, int j) {
    return conemap__by_border(i + 1, i, info->width, info->wrap_u) ||
           conemap__by_border(j + 1, j, info->height, info->wrap_v);
}

/* Do offsets x0..x1, y0..y1 meet the sector? An octant has `room` texels beyond its diagonal, and the whole quadrant
   with `whole`. *dx, *dy: the nearest offset of those. */
CONEMAP__INLINE int conemap__meets(conemap__sector sector, int room, int whole, int x0, int x1, int y0, int y1, int *dx,
                                   int *dy) {
    int far_x = sector.su > 0 ? x1 : -x0, far_y = sector.sv > 0 ? y1 : -y0;
    *dx = conemap__maxi(sector.su > 0 ? x0 : -x1, 0);
    *dy = conemap__maxi(sector.sv > 0 ? y0 : -y1, 0);
    if (far_x < 0 || far_y < 0) return 0;
    if (sector.major == 0 || whole) return 1;
    if (sector.major == 1) {
        *dx = conemap__maxi(*dx, *dy - room);
        return *dx <= far_x;
    }
    *dy = conemap__maxi(*dy, *dx - room);
    return *dy <= far_y;
}

/* Does a flight from vertex (k, l) to cell (i, j) lie in the sector, or with sign -1 one from the cell to the vertex? A
   cell lies in one quadrant; the diagonal's cells are in both octants. */
CONEMAP__INLINE int conemap__sees_cell(const conemap_map *map, conemap__sector sector, int i, int j, int k, int l,
                                       float sign) {
    int x = sign > 0.0f ? i - k : k - i - 1, y = sign > 0.0f ? j - l : l - j - 1;
    if (sector.su == 0) return 1;
    x = sector.su > 0 ? x : -x - 1;
    y = sector.sv > 0 ? y : -y - 1;
    if (x < 0 || y < 0) return 0;
    return sector.major == 0 || (sector.major == 1 ? x >= y : y >= x) || conemap__border_cell(&map->info, i, j) ||
           conemap__texels_by_border(&map->info, k, k, l, l);
}

/* The square of the steepest ascent of gradient (x, y) within the first quadrant, or the octant of it along `major`,
   for texels of a by b. */
static double conemap__ascent2(int major, double x, double y, double a, double b) {
    double along = major == 1 ? x : y, diagonal = x * a + y * b;
    if (major != 0 && !(x >= 0.0 && y >= 0.0 && (major == 1 ? y * a <= x * b : y * a >= x * b))) {
        along = along > 0.0 ? along * along : 0.0;
        diagonal = diagonal > 0.0 ? diagonal * diagonal / (a * a + b * b) : 0.0;
        return along > diagonal ? along : diagonal;
    }
    return (x > 0.0 ? x * x : 0.0) + (y > 0.0 ? y * y : 0.0);
}

/* fl(dh^2 / d^2) for offsets in texels. */
CONEMAP__INLINE float conemap__slope2(const conemap_map *map, float dh, float di, float dj) {
    float x = di * map->build.texel_u, y = dj * map->build.texel_v;
    return dh * dh / (x * x + y * y);
}

/* Is vertex (k, l) on the edge of a cell that falls away from the apex at offset (-di, -dj)? [BV24 Algorithm 2]:
   the cell behind it in the direction of flight has a side that falls, where behind a non-wrapping border
   everything falls. A vertex straight ahead along an axis is the near corner of two cells. */
static int conemap__falls_behind(const conemap_map *map, int k, int l, int di, int dj) {
    int w = map->info.width, h = map->info.height, sx, sy;
    for (sy = dj < 0 ? -1 : 1; sy >= (dj > 0 ? 1 : -1); sy -= 2)
        for (sx = di < 0 ? -1 : 1; sx >= (di > 0 ? 1 : -1); sx -= 2) {
            int k1 = k + sx, l1 = l + sy;
            float h00, h10, h01, h11;
            if (map->info.wrap_u == CONEMAP_WRAP) k1 = conemap__repeat(k1, w);
            if (map->info.wrap_v == CONEMAP_WRAP) l1 = conemap__repeat(l1, h);
            if (k1 < 0 || k1 >= w || l1 < 0 || l1 >= h) return 1;
            h00 = conemap__height(map, k, l);
            h10 = conemap__height(map, k1, l);
            h01 = conemap__height(map, k, l1);
            h11 = conemap__height(map, k1, l1);
            if (h00 > h10 || h00 > h01 || h10 > h11 || h01 > h11) return 1;
        }
    return 0;
}

/* Bilinear height at texel coordinates, centres at whole numbers. */
static float conemap__height_at(const conemap_map *map, float x, float y) {
    int i = conemap__floor(x), j = conemap__floor(y);
    return conemap__bilinear(conemap__gather(map->heights, conemap__cell_quad(map, i, j)), x - (float)i,
                             y - (float)j);
}

/* [PO07] as [BV24] describes it: a ray falls from the top of the box above the apex onto the vertex and goes on
   in equal steps to the floor; where it comes out of the surface again it limits the cone. */
static float conemap__march(const conemap_map *map, int i, int j, int di, int dj, float apex, float height) {
    int steps = map->build.desc.march_steps, k;
    float drop = 1.0f - height, reach = (float)conemap__maxi(map->info.width, map->info.height);
    /* Horizontal way from the vertex to the floor, as a multiple of the way to the vertex; a ray that skims
       the top of the box would go on forever, so it ends with the map. */
    float stretch = height <= drop * reach ? height / drop : reach;
    for (k = 1; k <= steps; ++k) {
        float f = (float)k / (float)steps, way = 1.0f + f * stretch;
        float x = (float)di * way, y = (float)dj * way, z = height - f * stretch * drop;
        float px = (float)i + x, py = (float)j + y;
        int out = (map->info.wrap_u != CONEMAP_WRAP && (px < 0.0f || px > (float)(map->info.width - 1))) ||
                  (map->info.wrap_v != CONEMAP_WRAP && (py < 0.0f || py > (float)(map->info.height - 1)));
        if (z <= apex) return 0.0f;
        if (out || conemap__height_at(map, px, py) < z) return conemap__slope2(map, z - apex, x, y);
    }
    return 0.0f;
}

/* The steeper of s and the slope to the texel at offset (di, dj), if that one limits the generator's cones. */
CONEMAP__INLINE float conemap__visit(const conemap_map *map, conemap_generator generator, int i, int j, int di,
                                     int dj, float apex, float s) {
    int k = i + di, l = j + dj;
    float height, dh, slope;
    if (map->info.wrap_u == CONEMAP_WRAP) k = conemap__repeat(k, map->info.width);
    if (map->info.wrap_v == CONEMAP_WRAP) l = conemap__repeat(l, map->info.height);
    height = conemap__height(map, k, l);
    dh = height - apex;
    if (!(dh > 0.0f)) return s;
    slope = conemap__slope2(map, dh, (float)di, (float)dj);
    if (slope <= s) return s;
    if (generator == CONEMAP_RELAXED && !conemap__falls_behind(map, k, l, di, dj)) return s;
    if (generator == CONEMAP_RELAXED_SAMPLED)
        return conemap__max(s, conemap__march(map, i, j, di, dj, apex, height));
    return slope;
}

/* Ring search with early out [Dum06 Appendix B]: squares of growing radius, until not even a texel of height 1
   on the next one could narrow the cone. Serves every generator that is defined by pairs of texels. */
CONEMAP__INLINE float conemap__ring(const conemap_map *map, conemap_generator generator, int i, int j) {
    conemap__window w = conemap__texel_window(map, i, j, generator != CONEMAP_RING);
    float apex = conemap__height(map, i, j), s = map->build.least_slope2;
    int r, d, last = conemap__maxi(conemap__maxi(-w.low_u, w.high_u), conemap__maxi(-w.low_v, w.high_v));
    if (map->build.desc.ring_limit) last = conemap__mini(last, map->build.desc.ring_limit);
    for (r = 1; r <= last; ++r) {
        float room = 1.0f - apex;
        if (conemap__max(conemap__slope2(map, room, (float)r, 0.0f),
                         conemap__slope2(map, room, 0.0f, (float)r)) <= s)
            break;
        for (d = conemap__maxi(-r, w.low_u); d <= conemap__mini(r, w.high_u); ++d) {
            if (-r >= w.low_v) s = conemap__visit(map, generator, i, j, d, -r, apex, s);
            if (r <= w.high_v) s = conemap__visit(map, generator, i, j, d, r, apex, s);
        }
        for (d = conemap__maxi(1 - r, w.low_v); d <= conemap__mini(r - 1, w.high_v); ++d) {
            if (-r >= w.low_u) s = conemap__visit(map, generator, i, j, -r, d, apex, s);
            if (r <= w.high_u) s = conemap__visit(map, generator, i, j, r, d, apex, s);
        }
    }
    return s;
}

static void conemap__maxima_rows(const conemap_map *map, int k, int y0, int y1) {
    const conemap_pyramid *pyramid = &map->build.texels;
    int y;
    for (y = y0; y < y1; ++y)
        conemap__kernels_of(map->isa)->maxima_row(
            conemap__maxima(pyramid, k - 1, 2 * y),
            conemap__maxima(pyramid, k - 1, conemap__mini(2 * y + 1, pyramid->height[k - 1] - 1)),
            pyramid->width[k - 1], conemap__maxima(pyramid, k, y));
}

/* Row j of a plane, by way of the wrap mode; null beyond the map. */
static const float *conemap__row_of(const conemap_map *map, const float *plane, int j) {
    if (map->info.wrap_v != CONEMAP_WRAP && (j < 0 || j >= map->info.height)) return NULL;
    return plane + (size_t)conemap__repeat(j, map->info.height) * (size_t)map->info.width;
}

/* ---- the search for the steepest slopes, a tile of texels at a time --------------------------------------------

   What ring search finds, by branch and bound over the max pyramid: the same quotients, pruned by bounds that are at
   least as large after rounding, so the same bits in any order. A tile of 8 x 8 texels shares one stack: four blocks of
   the pyramid are tested against every texel at once, whether or not it had a use for the block above, which costs less
   than asking. (One
   lane does ask: groups of 2 x 2 texels, by their lowest texel and least slope so far.) The search begins with what
   decided the tile before (neighbours often agree), goes on in the tile's own block and up from there, so near texels,
   which decide most often, come first, and ends with the images of a wrapping map.
   With slack, a texel drops a block that could raise its slope by no more than the factor, and folds the block's bound
   into its result, which from then on counts as found when blocks are dropped. What lies below a dropped block is no
   steeper, so a texel that is asked again changes nothing, and results are the same whatever the lanes. They depend on
   the order, which is
   always this one: a job's tiles row by row. */

#define CONEMAP__LEAST_SLACK 0.5f /* to fold bounds in takes more time than less slack spares */

static conemap__search conemap__make_search(const conemap_map *map) {
    const float slack = map->build.desc.slack;
    conemap__search search;
    memset(&search, 0, sizeof search);
    search.a = map->build.search_u;
    search.b = map->build.search_v;
    search.widen2 = slack < CONEMAP__LEAST_SLACK ? 1.0f : (1.0f + slack) * (1.0f + slack);
    return search;
}

#define CONEMAP__RUN 256 /* texels worked on at a time, on the stack */
enum { CONEMAP__SEARCH = 1, CONEMAP__STORE = 2 }; /* what an update does with a texel; a build does both with all */
CONEMAP__INLINE int conemap__is_wanted(const conemap_map *map, int sector, int x, int y, int what);

/* Cuts off what is not wanted at either end of a run of texels; 0 if nothing is left. */
static int conemap__cut_run(const conemap_map *map, int sector, int *x, int y, int *count, int what) {
    while (*count > 0 && !conemap__is_wanted(map, sector, *x + *count - 1, y, what)) --*count;
    while (*count > 0 && !conemap__is_wanted(map, sector, *x, y, what)) {
        ++*x;
        --*count;
    }
    return *count > 0;
}

/* Searches one tile: slopes holds what is known of each texel, row by row, and then what was found. */
static void conemap__search_tile(const conemap_map *map, conemap__search *search, int x0, int y0, float *slopes) {
    conemap__tile tile;
    int w = map->info.width, h = map->info.height, k, n, any = 0;
    unsigned char used[CONEMAP__NOTED];
    for (k = 0; k < CONEMAP__TILE * CONEMAP__TILE; ++k) {
        int x = x0 + k % CONEMAP__TILE, y = y0 + k / CONEMAP__TILE;
        tile.height[k] = 2.0f;
        tile.slope2[k] = map->build.least_slope2;
        tile.decider[k] = 0;
        tile.folded[k] = 0.0f;
        if (x >= w || y >= h || !conemap__is_wanted(map, 0, x, y, CONEMAP__SEARCH)) continue;
        tile.height[k] = conemap__height(map, x, y);
        tile.slope2[k] = slopes[(size_t)y * (size_t)w + (size_t)x];
        any = 1;
    }
    if (!any) return;
    tile.noted = 1;
    tile.x = x0;
    tile.y = y0;
    conemap__kernels_of(map->isa)->search_tile(map, search, &tile);
    memset(used, 0, sizeof used);
    search->seeds = 0;
    for (k = 0; k < CONEMAP__TILE * CONEMAP__TILE; ++k) {
        if (tile.height[k] > 1.0f) continue;
        slopes[(size_t)(y0 + k / CONEMAP__TILE) * (size_t)w + (size_t)(x0 + k % CONEMAP__TILE)] =
            conemap__max(tile.slope2[k], tile.folded[k]);
        n = tile.decider[k];
        if (n == 0 || used[n]) continue;
        used[n] = 1;
        search->seed_x[search->seeds] = tile.noted_x[n];
        search->seed_y[search->seeds++] = tile.noted_y[n];
    }
}

/* ---- the search in one sector of directions, texel by texel -----------------------------------------------------

   The same by itself for each texel, for a sector cuts through tiles and blocks. What slack prunes is folded in. */

/* A block that may hold something steeper, waiting its turn: dh^2 of its maximum and d^2 of its nearest texel. */
typedef struct conemap__candidate {
    float dh2, d2;
    int x, y, k;
} conemap__candidate;

/* One search after another, by one job. */
typedef struct conemap__sector_search {
    conemap__search common;
    conemap__sector sector; /* where it looks */
    int room;           /* eight sectors: 1 where a texel stands for the cells around it, 0 for vertex cones */
    int by_border;      /* the texel looks over its whole quadrant */
    float folded;       /* the steepest bound that was pruned by slack alone */
    int best_i, best_j; /* what decided the last texel: neighbours often agree */
} conemap__sector_search;

/* Do texels low..high of the map meet the sector of texel (i, j), which may lie outside for its images? As
   conemap__meets. */
CONEMAP__INLINE int conemap__search_meets(const conemap_map *map, const conemap__sector_search *search, int low_i,
                                          int high_i, int low_j, int high_j, int i, int j, int *dx, int *dy) {
    int whole = search->sector.major != 0 && search->room &&
                (search->by_border || conemap__texels_by_border(&map->info, low_i, high_i, low_j, high_j));
    return conemap__meets(search->sector, search->room, whole, low_i - i, high_i - i, low_j - j, high_j - j, dx, dy);
}

/* May something with this dh^2 and d^2 beat s? With slack, only by so much, and what is given up for it is folded
   in. */
CONEMAP__INLINE int conemap__may_beat(conemap__sector_search *search, float dh2, float d2, float s) {
    float bar = s * d2 * CONEMAP__MARGIN;
    const conemap__search *common = &search->common;
    if (!(dh2 > bar)) return 0;
    if (common->widen2 > 1.0f && d2 > 0.0f && d2 + common->deflate >= common->near2 && !(dh2 > bar * common->widen2)) {
        search->folded = conemap__max(search->folded, dh2 / d2);
        return 0;
    }
    return 1;
}

/* Pushes those of four sibling blocks, the children of (x, y) of level k + 1, that may beat s; the nearest to
   texel (i, j), which may lie outside the map for its images, comes last and so is popped first. */
static int conemap__push_seen(const conemap_map *map, conemap__sector_search *search, int k, int x, int y, int i, int j,
                              float apex, float s, int skip, conemap__candidate *out) {
    const conemap_pyramid *pyramid = &map->build.texels;
    int size = 1 << k, c, count = 0;
    int near_x = i >= size * (2 * x + 1), near_y = j >= size * (2 * y + 1);
    for (c = 3; c >= 0; --c) {
        int across = 2 * x + ((c & 1) ^ near_x), down = 2 * y + ((c >> 1) ^ near_y), left = size * across;
        int low = size * down, di, dj;
        float dh, dx, dy, d2;
        if (across >= pyramid->width[k] || down >= pyramid->height[k]) continue;
        dh = conemap__maxima(pyramid, k, down)[across] - apex;
        if (!(dh > 0.0f) || 2 * (down & 1) + (across & 1) == skip ||
            !conemap__search_meets(map, search, left, left + size - 1, low, low + size - 1, i, j, &di, &dj))
            continue;
        dx = (float)di * search->common.a;
        dy = (float)dj * search->common.b;
        d2 = dx * dx + dy * dy - search->common.deflate;
        if (!conemap__may_beat(search, dh * dh, d2, s)) continue;
        out[count].dh2 = dh * dh;
        out[count].d2 = d2;
        out[count].x = across;
        out[count].y = down;
        out[count].k = k;
        ++count;
    }
    return count;
}

/* Works the stack off: opens blocks until none can beat s. The map is shifted by (shift_i, shift_j) against texel (i,
   j). */
static float conemap__open_seen(const conemap_map *map, conemap__sector_search *search, int i, int j, int shift_i,
                                int shift_j, float apex, float s, conemap__candidate *stack, int count) {
    while (count > 0) {
        conemap__candidate c = stack[--count];
        float slope2;
        if (!conemap__may_beat(search, c.dh2, c.d2, s)) continue;
        if (c.k > 0) {
            count += conemap__push_seen(map, search, c.k - 1, c.x, c.y, i - shift_i, j - shift_j, apex, s, -1,
                                        stack + count);
            continue;
        }
        if (c.d2 + search->common.deflate < search->common.near2) continue; /* left to conemap__near_row */
        slope2 = c.dh2 / c.d2;
        if (slope2 > s) {
            s = slope2;
            search->best_i = c.x + shift_i;
            search->best_j = c.y + shift_j;
        }
    }
    return s;
}

/* How many periods away along an axis images may matter. In all directions and in a quadrant a texel's next image
   decides. In an octant it may be one that is as far as the other axis is long (which takes its time on long narrow
   maps), unless nothing so far away can beat s. */
static int conemap__images(const conemap_map *map, const conemap__sector_search *search, int along_v, float apex,
                           float s) {
    int size = along_v ? map->info.height : map->info.width, other = along_v ? map->info.width : map->info.height;
    float period = (float)size * (along_v ? search->common.b : search->common.a);
    float room = conemap__maxima(&map->build.texels, map->build.texels.levels - 1, 0)[0] - apex, reach;
    if ((along_v ? map->info.wrap_v : map->info.wrap_u) != CONEMAP_WRAP) return 0;
    if (search->sector.major == 0 || !(period > 0.0f)) return 1;
    reach = sqrtf(room * room / s + search->common.deflate) * 1.0001f / period;
    return 1 + (int)conemap__min(reach, (float)(2 + other / size));
}

/* The steepest squared slope that texel (i, j) sees in the sector; s is what is known. */
static float conemap__search_sector(const conemap_map *map, conemap__sector_search *search, int i, int j, float s) {
    conemap__candidate stack[3 * 17 + 4];
    const conemap_info *info = &map->info;
    int levels = map->build.texels.levels, w = info->width, h = info->height, k, a, b, images_u, images_v, di, dj;
    float apex = conemap__height(map, i, j), dh;
    search->folded = 0.0f;
    search->by_border = search->sector.major != 0 && conemap__texels_by_border(info, i, i, j, j);
    if ((search->best_i != i || search->best_j != j) &&
        conemap__search_meets(map, search, search->best_i, search->best_i, search->best_j, search->best_j, i, j, &di,
                              &dj)) {
        float x = (float)(search->best_i - i) * search->common.a, y = (float)(search->best_j - j) * search->common.b;
        float d2 = x * x + y * y;
        dh = conemap__height(map, conemap__texel_index(search->best_i, w, info->wrap_u),
                             conemap__texel_index(search->best_j, h, info->wrap_v)) - apex;
        if (dh > 0.0f && d2 > 0.0f && d2 >= search->common.near2)
            s = conemap__max(s, dh * dh / (d2 - search->common.deflate));
    }
    for (k = 0; k + 1 < levels; ++k) {
        int own = (j >> k & 1) << 1 | (i >> k & 1);
        int count = conemap__push_seen(map, search, k, i >> (k + 1), j >> (k + 1), i, j, apex, s, own, stack);
        s = conemap__open_seen(map, search, i, j, 0, 0, apex, s, stack, count);
    }
    images_u = conemap__images(map, search, 0, apex, s);
    images_v = conemap__images(map, search, 1, apex, s);
    for (b = -images_v; b <= images_v; ++b)
        for (a = -images_u; a <= images_u; ++a) {
            int count;
            if ((a == 0 && b == 0) || a * search->sector.su < 0 || b * search->sector.sv < 0) continue;
            count = conemap__push_seen(map, search, levels - 1, 0, 0, i - a * w, j - b * h, apex, s, -1, stack);
            s = conemap__open_seen(map, search, i, j, a * w, b * h, apex, s, stack, count);
        }
    return conemap__max(s, search->folded);
}

/* Along one axis, a texel's block at some level and its two neighbours: index 0 before, 1 own, 2 after. */
typedef struct conemap__blocks {
    int node[3];         /* block numbers, wrapped */
    int low[3], high[3]; /* offsets from the texel, both ends included, clipped to the window; empty: low > high */
    float center[3];     /* offset of the middle of the whole block */
} conemap__blocks;

/* Blocks of the last row or column may be thin; each repetition of a wrapping map has its own. */
static conemap__blocks conemap__axis_blocks(int size, conemap_wrap wrap, int at, int k, int low, int high) {
    conemap__blocks b;
    int own = at >> k, count = ((size - 1) >> k) + 1, side;
    for (side = 0; side < 3; ++side) {
        int node = own + side - 1, shift = 0, first, last;
        if (node < 0 || node >= count) {
            if (wrap != CONEMAP_WRAP) {
                b.node[side] = 0;
                b.low[side] = 1;
                b.high[side] = 0;
                b.center[side] = 0.0f;
                continue;
            }
            shift = node < 0 ? -size : size;
            node = node < 0 ? count - 1 : 0;
        }
        first = node * (1 << k) + shift - at;
        last = conemap__mini((node + 1) * (1 << k), size) - 1 + shift - at;
        b.node[side] = node;
        b.center[side] = 0.5f * (float)(first + last);
        b.low[side] = conemap__maxi(first, low);
        b.high[side] = conemap__mini(last, high);
    }
    return b;
}

/* The block's nearest offset: of the side before the texel its end, of the side after its beginning. */
CONEMAP__INLINE int conemap__nearest(const conemap__blocks *b, int side) {
    return side == 0 ? b->high[0] : side == 2 ? b->low[2] : 0;
}

/* The same for the part beyond what coarser steps have seen, `seen` texels on that side; 0 when there is none. */
CONEMAP__INLINE int conemap__nearest_unseen(const conemap__blocks *b, int side, int seen_low, int seen_high,
                                            int *offset) {
    if (side == 1) return 0;
    *offset = side == 0 ? conemap__mini(b->high[0], seen_low - 1) : conemap__maxi(b->low[2], seen_high + 1);
    return *offset >= b->low[side] && *offset <= b->high[side];
}

/* Quick cone maps [VB22]: from the finest level up, the 3x3 blocks around the texel, each with its maximum at
   its closest point. Algorithm 1 takes the closest point of the whole block; Algorithm 2 of what finer levels have
   not seen yet. That part of a diagonal block is an L: everything beyond the seen columns, or beyond the
   seen rows, so its closest point is the nearer of those two corners (the published code takes the far corner
   where both hold, which is not conservative). The centre heuristic takes the middle of the block.
   So a block's squared distance is the lesser of p + q' and q + p', where p is the distance along one axis to what is
   unseen, q that to the whole block, and p', q' those of the other axis; what does not exist is far away. The other
   algorithms have p = q. This writes one axis' share for the texel `at`, level by level. */
static void conemap__quick_axis(int size, conemap_wrap wrap, int at, int levels, float texel, int improved, int center,
                                conemap__quick_level *out) {
    int low, high, seen_low = 0, seen_high = 0, k, side;
    conemap__axis_window(size, wrap, at, 0, &low, &high);
    for (k = 0; k < levels; ++k) {
        conemap__blocks b = conemap__axis_blocks(size, wrap, at, k, low, high);
        out[k].full = seen_low <= low && seen_high >= high;
        for (side = 0; side < 3; ++side) {
            int unseen = 0, exists = b.low[side] <= b.high[side];
            float distance = center ? (side == 1 ? 0.0f : b.center[side]) : (float)conemap__nearest(&b, side);
            distance *= texel;
            out[k].node[side] = b.node[side];
            out[k].p[side] = out[k].q[side] = exists ? distance * distance : CONEMAP__FAR;
            if (!improved || center || !exists) continue;
            distance = conemap__nearest_unseen(&b, side, seen_low, seen_high, &unseen) ? (float)unseen * texel
                : 1.0e19f;
            out[k].p[side] = distance * distance;
        }
        seen_low = b.low[0] <= b.high[0] ? b.low[0] : b.low[1];
        seen_high = b.low[2] <= b.high[2] ? b.high[2] : b.high[1];
    }
}

/* 1 / sqrt(s), at most max_tan, and less 2^-20 of itself. The errors of texel_u, the products, the sum, the
   quotient, the root and the division add up to less than 10 * 2^-24 of the tangent, so the result is never wider
   than the true cone. */
#define CONEMAP__TANGENT_MARGIN 0.99999904632568359375f
CONEMAP__INLINE float conemap__tangent(const conemap_map *map, float s) {
    return conemap__min(1.0f / sqrtf(s) * CONEMAP__TANGENT_MARGIN, map->info.max_tan);
}

static float conemap__generate(const conemap_map *map, int i, int j) {
    switch (map->info.generator) {
    case CONEMAP_RING: return conemap__tangent(map, conemap__ring(map, CONEMAP_RING, i, j));
    case CONEMAP_RELAXED: return conemap__tangent(map, conemap__ring(map, CONEMAP_RELAXED, i, j));
    case CONEMAP_RELAXED_SAMPLED:
        return conemap__tangent(map, conemap__ring(map, CONEMAP_RELAXED_SAMPLED, i, j));
    case CONEMAP_HYBRID: {
        /* [CHRS17] puts a cone between the conservative and the relaxed one; the weight says where. */
        float narrow = conemap__tangent(map, conemap__ring(map, CONEMAP_RING, i, j));
        float wide = conemap__tangent(map, conemap__ring(map, CONEMAP_RELAXED, i, j));
        return conemap__max(narrow, conemap__min(narrow + (wide - narrow) * map->build.desc.hybrid_weight, wide));
    }
    default: return 0.0f; /* other generators work on rows */
    }
}

/* ======================================================================================================
   S A F E   C O N E S
   ====================================================================================================== */

/* ---- cones that are safe for the bilinear surface ------------------------------------------------------------

   Claim. For all points p, q of the surface, (h(q) - h(p) - d) t(p) <= |q - p|, where t(p) is the bilinear
   interpolation of the stored tangents and d = 2^-20: the cone at p, its apex raised by d, is empty.
   Texels are a by b, V = (a^2 + b^2) / 4, slope(p, q) = (h(q) - h(p)) / |q - p|, and f is a texel's squared slope.
   1. One end is a vertex. For p in cell P and q in cell Q, some corner of P seen with Q, or some corner of Q seen
      from P, has at least as large a slope (as a supremum). Fix r = q - p. Over the rectangle of p with p in P and
      p + r in Q, h(p + r) - h(p) is bilinear, so largest at a corner, where on each axis p or q lies on a grid line.
      If it is the same point on both axes, it is a vertex. Otherwise h(p) is affine in one coordinate and h(q) in
      the other, the difference is k + g.r, and along a ray of r = s n the slope k / s + g.n is monotone in s: it does
      not fall towards one of the ray's ends, where one more coordinate is at a vertex. If that end is s = 0, then p = q
      there, so k = 0 and the slope is the same at the other end.
   2. Same cell, P = Q: a slope is a mean of derivatives along the segment, so at most the longest gradient. h_x is
      affine in y and h_y in x, so its square is max(h_x0^2, h_x1^2) + max(h_y0^2, h_y1^2). Reached in the limit: exact.
   3. A corner u of another cell Q: along a ray from u the slope in Q is c1 + c2 s, largest for s -> 0, at most the
      rising part of the gradient at u, or on one of Q's two far edges. On an edge at distance c,
      (A + B y)^2 / (c^2 + y^2) <= A^2 / c^2 + B^2, reached at y = B c^2 / A; outside the edge, or with A <= 0, its
      ends.
   4. A vertex u and a patch Q apart from it, whose corners Q_j stand D_j away and rise dh_j above it. If
      dh_j <= S sqrt(D_j^2 - V) for all four, then for q = sum w_j Q_j, as the root is concave,
      h(q) - h(u) <= S sum w_j sqrt(D_j^2 - V) <= S sqrt(|q - u|^2 + Var_w - V) <= S |q - u|, for the variance of Q_j
      under the weights of q is x (1 - x) a^2 + y (1 - y) b^2 <= V. With heights negated: the same for u seen from p in
      P. A patch cut up is several patches with a smaller V; the largest of their bounds is a bound.
   5. Every pair is seen. Let p in P, q in Q; by 1 it is a vertex u and a patch. Own cell: step 2, given to P's corners.
      Q at u: step 3, given to the 3x3 texels around u, which hold the corners of all cells P at u. Else step 4, for
      the corner with the largest bound: far from u (V <= tolerance D^2) the search takes the corner's bound as it is,
      given to the 3x3 of u; nearer, every patch with such a corner is cut up (conemap__sights_rows), given to the 3x3
      of u, or to P's corners if it is P that is seen from v. In a sector conemap__near_row cuts up the patch with the
      largest bound alone, and where D_j^2 < 1.5 V, which only texels longer than 1.29:1 know, conemap__close_pairs
      looks at every patch. What a search from u prunes is at most what the 3x3 of u has already.
      With a cone for each cell, what was given to texels is given to P itself, or to the cells at u: a part of the 3x3.
   6. So every corner of P has 1 / t_i >= the slope bound of P, t(p) <= max t_i <= 1 / slope: the cone at p is empty.
      Storing sqrt(tan) or the radius interpolates to no more than that (Jensen; a weighted mean), rounding down to
      less.
   7. Outside the outermost centres (CLAMP): projecting p and q onto the rectangle of centres keeps heights and t(p)
      and shortens |q - p|. The same projection lets an axis of one texel count as having length 0, and texels longer
      than 8:1 count as 8:1 (shorter distances, so narrower cones; it keeps the near field small).
   8. Rounding. Absolute: dh is off by 2^-25, cutting a patch into pieces adds less than 6 times that, at most 4 times
      over, and the shader's own height 2^-23: together less than d. Relative: coordinates, squares and quotient are off
      by less than 2^-18 in D^2 and dh^2,
      D^2 - V >= D^2 / 3 makes that 3 times as much, pruning adds 2^-20; half the sum in the tangent, below 2^-17, and
      the sampler's few last bits: below 2^-16, which conemap__safe_tangent takes off.

   Sectors. A sector is a closed convex cone of directions r in texels, and the claim is made for q - p in it.
   1. holds as it is: r is fixed, then only scaled, so it stays in the sector.
   2. becomes the steepest ascent in the sector's directions. Of a quadrant, with both axes turned to it, the positive
      parts of the largest h_x and h_y; in an octant, where that ascent leads out, it is the steeper one of the axis and
      the diagonal.
   3. u's own cell in the quadrant is the only one; an octant has one of its two far edges.
   4. as it is, for patches that are met: from a vertex a patch lies in one closed quadrant, on the diagonal in two
      octants. P seen from v is met if v - p is in the sector.
   5. A corner counts if a patch it belongs to may be met: in the quadrant, border included, and in an octant up to one
      texel beyond its diagonal. Then all corners of a patch that is met count, and the one with the largest bound finds
      it. A border that does not wrap is the edge of cells on one side only, so the missing ones are added, level
      across: they have the edge's heights, farther away.
   7. A projection may turn r from one octant into the other, not out of its quadrant. So where p or q lies in a border
      cell of CLAMP, or in a map of one row or column, octants count as quadrants: for patches, vertices and gradients
      there.
   Wrapping: an image a whole period farther is met in the same quadrant and less steep, and in an octant along its
   minor axis. Along the major axis conemap__images goes on until the octant is wide enough to have held an image of
   everything. */

#define CONEMAP__BAND 16      /* rows of a cone job */
#define CONEMAP__LONGEST 8.0f /* texels longer than this count as so long */

/* A band of rows: a job. What a vertex sees goes to the plane, what is seen of a cell to cell_slopes; each job writes
   its own rows of both and conemap__collect brings them together. So jobs share nothing. */
typedef struct conemap__band {
    const conemap_map *map;
    int y0, y1;
    conemap__sector sector;
    float *plane, *cell_slopes; /* the sector's */
    float a, b, deflate;        /* texel size; V */
    int close_u, close_v;       /* how many texels away D^2 - V may mean little; 0: nowhere */
} conemap__band;

/* Heights at any whole coordinates, cells by their lower corner; an axis of one texel has one cell, constant across. */
CONEMAP__INLINE float conemap__vertex(const conemap_map *map, int i, int j) {
    return conemap__height(map, conemap__texel_index(i, map->info.width, map->info.wrap_u),
                           conemap__texel_index(j, map->info.height, map->info.wrap_v));
}

CONEMAP__INLINE int conemap__inner_cell(int i, int size, conemap_wrap wrap) {
    return wrap == CONEMAP_WRAP || (i >= 0 && i < conemap__maxi(size - 1, 1));
}

/* With sectors there is one cell more beyond each border, level across: it stands for the border's edge in the sectors
   that lead out, and beyond. */
CONEMAP__INLINE int conemap__cell_exists(const conemap_map *map, int i, int j) {
    if (map->info.texture.sectors > 1)
        return (map->info.wrap_u == CONEMAP_WRAP || (i >= -1 && i < map->info.width)) &&
               (map->info.wrap_v == CONEMAP_WRAP || (j >= -1 && j < map->info.height));
    return conemap__inner_cell(i, map->info.width, map->info.wrap_u) &&
           conemap__inner_cell(j, map->info.height, map->info.wrap_v);
}

/* Where the slope of cell (i, j) is kept: a cell beyond a border has the place of the last one, with per_cell its
   cone. */
CONEMAP__INLINE int conemap__cell_place(int i, int size, conemap_wrap wrap, int per_cell) {
    return wrap == CONEMAP_WRAP ? i : conemap__maxi(0, conemap__mini(i, size - 1 - (per_cell != 0)));
}

/* Does this band have the row of cell (i, j)? */
CONEMAP__INLINE int conemap__has_cell(const conemap__band *band, int i, int j) {
    const conemap_info *info = &band->map->info;
    (void)i;
    j = conemap__cell_place(j, info->height, info->wrap_v, info->texture.per_cell);
    return j >= band->y0 && j < band->y1;
}

CONEMAP__INLINE float *conemap__cell_at(const conemap__band *band, int i, int j) {
    const conemap_info *info = &band->map->info;
    i = conemap__repeat(conemap__cell_place(i, info->width, info->wrap_u, info->texture.per_cell), info->width);
    j = conemap__cell_place(j, info->height, info->wrap_v, info->texture.per_cell);
    return &band->cell_slopes[(size_t)j * (size_t)info->width + (size_t)i];
}

/* Raises the slope of a cell that the band has. */
CONEMAP__INLINE void conemap__raise_cell(const conemap__band *band, int i, int j, float slope2) {
    float *at = conemap__cell_at(band, i, j);
    *at = conemap__max(*at, slope2);
}

/* The rows, with shifts to the right, whose maxima are the slopes of the texels of row j, or of its cells with
   per_cell: of what rows y0 to y1 know. At most 13. */
static int conemap__collect(const conemap_map *map, int sector, int j, int y0, int y1, const float **rows,
                            int *columns) {
    int h = map->info.height, r, c, n = 0, cells = map->info.texture.per_cell != 0;
    size_t first = (size_t)sector * conemap__texels(map);
    for (r = cells ? 0 : -1; r <= 1; ++r) {
        int y = conemap__texel_index(j + r, h, map->info.wrap_v);
        if (y < y0 || y >= y1) continue;
        for (c = cells ? 0 : -1; c <= 1; ++c) {
            rows[n] = map->build.plane + first + (size_t)y * (size_t)map->info.width;
            columns[n++] = c;
        }
        for (c = cells ? 0 : -1; c <= 0 && r <= 0; ++c) {
            rows[n] = map->build.cell_slopes + first + (size_t)y * (size_t)map->info.width;
            columns[n++] = c;
        }
    }
    return n;
}

/* Slope along an axis whose texels may have no length. */
CONEMAP__INLINE float conemap__over(float rise, float length) { return length > 0.0f ? rise / length : 0.0f; }

/* Step 2: the square of the longest gradient in cell (i, j), or of the steepest ascent in the band's sector. */
static float conemap__own_slope2(const conemap__band *band, int i, int j) {
    conemap__corners h = conemap__gather(band->map->heights, conemap__cell_quad(band->map, i, j));
    float x0 = h.h10 - h.h00, x1 = h.h11 - h.h01, y0 = h.h01 - h.h00, y1 = h.h11 - h.h10, x, y;
    if (band->sector.su != 0) {
        float su = (float)band->sector.su, sv = (float)band->sector.sv;
        /* a corner of this cell may be one of a border cell's, seen from inside */
        int whole = conemap__texels_by_border(&band->map->info, i, i + 1, j, j + 1);
        x = conemap__over(conemap__max(su * x0, su * x1), band->a);
        y = conemap__over(conemap__max(sv * y0, sv * y1), band->b);
        return (float)conemap__ascent2(whole ? 0 : band->sector.major, (double)x, (double)y, (double)band->a,
                                       (double)band->b);
    }
    x = conemap__over(conemap__max(conemap__max(x0, -x0), conemap__max(x1, -x1)), band->a);
    y = conemap__over(conemap__max(conemap__max(y0, -y0), conemap__max(y1, -y1)), band->b);
    return x * x + y * y;
}

/* Step 3: an edge of length l at distance c, its ends `first` (at the foot of the perpendicular) and `last` above the
   eye. */
static float conemap__edge_slope2(float first, float last, float l, float c) {
    float slope2 = 0.0f, rise;
    if (!(l > 0.0f && c > 0.0f)) return 0.0f;
    rise = (last - first) / l;
    if (first > 0.0f) {
        slope2 = first * first / (c * c);
        if (rise > 0.0f && rise * c * c < first * l) return slope2 + rise * rise;
    }
    return last > 0.0f ? conemap__max(slope2, last * last / (l * l + c * c)) : slope2;
}

/* Step 3: vertex (i, j) looks over its own cell towards (i + si, j + sj). */
static float conemap__corner_slope2(const conemap__band *band, int i, int j, int si, int sj) {
    float apex = conemap__vertex(band->map, i, j);
    float along = conemap__vertex(band->map, i + si, j) - apex, across = conemap__vertex(band->map, i, j + sj) - apex;
    float opposite = conemap__vertex(band->map, i + si, j + sj) - apex;
    float x = conemap__over(conemap__max(along, 0.0f), band->a), y = conemap__over(conemap__max(across, 0.0f), band->b);
    int major = band->sector.major;
    if (major != 0 && !conemap__texels_by_border(&band->map->info, i, i, j, j) &&
        !conemap__border_cell(&band->map->info, conemap__mini(i, i + si), conemap__mini(j, j + sj))) {
        float steep = (float)conemap__ascent2(major, (double)conemap__over(along, band->a),
                                              (double)conemap__over(across, band->b), (double)band->a, (double)band->b);
        return conemap__max(steep, major == 1 ? conemap__edge_slope2(along, opposite, band->b, band->a)
                                              : conemap__edge_slope2(across, opposite, band->a, band->b));
    }
    return conemap__max(x * x + y * y, conemap__max(conemap__edge_slope2(along, opposite, band->b, band->a),
                                                    conemap__edge_slope2(across, opposite, band->a, band->b)));
}

/* Step 4: the eye at the origin sees a patch whose corner k stands at (x + (k & 1) size_x, y + (k >> 1) size_y), h[k]
   above it. The larger of `best` and a bound of the squared slope, in pieces where that is not tight. */
static float conemap__patch_slope2(const conemap_map *map, const float *h, float x, float y, float size_x, float size_y,
                                   float best) {
    float v = 0.25f * (size_x * size_x + size_y * size_y), above = CONEMAP__FAR, top = 0.0f, bound = 0.0f;
    float dx = conemap__max(conemap__max(x, -x - size_x), 0.0f), dy = conemap__max(conemap__max(y, -y - size_y), 0.0f);
    float d2 = dx * dx + dy * dy;
    int k;
    for (k = 0; k < 4; ++k) top = conemap__max(top, h[k]);
    if (top * top < above * d2) above = top * top / d2;
    if (above <= best) return best;
    if (d2 >= 2.0f * v) {
        for (k = 0; k < 4; ++k)
            if (h[k] > 0.0f) {
                float cx = k & 1 ? x + size_x : x, cy = k & 2 ? y + size_y : y;
                bound = conemap__max(bound, h[k] * h[k] / (cx * cx + cy * cy - v));
            }
        above = conemap__min(above, bound);
        if (above <= best || v <= CONEMAP__TOLERANCE * d2) return conemap__max(above, best);
    }
    return conemap__kernels_of(map->isa)->patch(h, x, y, size_x, size_y, above, best);
}

/* Cell (i, j) and vertex (k, l): the vertex looks up at the cell (sign 1), or the cell at the vertex (-1). */
static float conemap__cell_slope2(const conemap__band *band, int i, int j, int k, int l, float sign, float best) {
    float apex = conemap__vertex(band->map, k, l), h[4];
    int c;
    for (c = 0; c < 4; ++c) h[c] = sign * (conemap__vertex(band->map, i + (c & 1), j + (c >> 1)) - apex);
    return conemap__patch_slope2(band->map, h, (float)(i - k) * band->a, (float)(j - l) * band->b, band->a, band->b,
                                 best);
}

/* Step 4's bound for a corner that rises dh, or 0 where it means nothing (conemap__close_pairs sees to those). */
CONEMAP__INLINE float conemap__corner_bound(const conemap__band *band, float dh, int di, int dj) {
    float x = (float)di * band->a, y = (float)dj * band->b, d2 = x * x + y * y - band->deflate;
    return dh > 0.0f && d2 > 0.5f * band->deflate ? dh * dh / d2 : 0.0f;
}

CONEMAP__INLINE int conemap__touches(int i, int j, int k, int l) {
    return k >= i && k <= i + 1 && l >= j && l <= j + 1;
}

/* Does another corner of cell (i, j) have a larger bound with vertex (k, l)? Then the cell is looked at for that
   one. */
static int conemap__outdone(const conemap__band *band, int i, int j, int k, int l, float sign, float bound) {
    float apex = conemap__vertex(band->map, k, l);
    int c;
    for (c = 0; c < 4; ++c) {
        int x = i + (c & 1), y = j + (c >> 1);
        float dh = sign * (conemap__vertex(band->map, x, y) - apex);
        if (conemap__corner_bound(band, dh, x - k, y - l) > bound) return 1;
    }
    return 0;
}

/* Cell (i, j) as it is seen from vertex v. */
static void conemap__raise_seen_cell(const conemap__band *band, int i, int j, int vi, int vj, float least) {
    float *at;
    if (!conemap__has_cell(band, i, j)) return;
    at = conemap__cell_at(band, i, j);
    *at = conemap__max(*at, conemap__cell_slope2(band, i, j, vi, vj, -1.0f, conemap__max(least, *at)));
}

/* Step 5, near: vertices u and v, v the higher one. Looks at the cells of v from u, and at the cells of u from v.
   `least` is what all that is raised has already. */
static float conemap__near_pair(const conemap__band *band, int ui, int uj, int vi, int vj, float least, float best) {
    float dh = conemap__vertex(band->map, vi, vj) - conemap__vertex(band->map, ui, uj);
    float bound = conemap__corner_bound(band, dh, vi - ui, vj - uj);
    float most = bound * (1.0f + 1.0f / 65536.0f); /* of what is behind the bound, rounding included */
    int k, i, j;
    for (k = 0; k < 4; ++k) {
        i = vi - (k & 1);
        j = vj - (k >> 1);
        if (most > best && conemap__cell_exists(band->map, i, j) && !conemap__touches(i, j, ui, uj) &&
            conemap__sees_cell(band->map, band->sector, i, j, ui, uj, 1.0f) &&
            !conemap__outdone(band, i, j, ui, uj, 1.0f, bound))
            best = conemap__cell_slope2(band, i, j, ui, uj, 1.0f, best);
        i = ui - (k & 1);
        j = uj - (k >> 1);
        if (conemap__cell_exists(band->map, i, j) && !conemap__touches(i, j, vi, vj) &&
            conemap__has_cell(band, i, j) && most > *conemap__cell_at(band, i, j) &&
            conemap__sees_cell(band->map, band->sector, i, j, vi, vj, -1.0f) &&
            !conemap__outdone(band, i, j, vi, vj, -1.0f, bound))
            conemap__raise_seen_cell(band, i, j, vi, vj, least);
    }
    return best;
}

/* Step 5 for long texels: every patch that comes so close to a vertex that D^2 - V means little. */
static float conemap__close_pairs(const conemap__band *band, int i, int j, float best) {
    float near2 = 1.6f * band->deflate;
    int di, dj, k;
    for (dj = -band->close_v - 1; dj <= band->close_v; ++dj)
        for (di = -band->close_u - 1; di <= band->close_u; ++di) {
            float x = (float)conemap__maxi(0, conemap__maxi(di, -di - 1)) * band->a;
            float y = (float)conemap__maxi(0, conemap__maxi(dj, -dj - 1)) * band->b, d2 = x * x + y * y;
            if (d2 == 0.0f || d2 >= near2) continue;
            /* a cell seen from this vertex */
            if (conemap__cell_exists(band->map, i + di, j + dj) &&
                conemap__sees_cell(band->map, band->sector, i + di, j + dj, i, j, 1.0f))
                best = conemap__cell_slope2(band, i + di, j + dj, i, j, 1.0f, best);
            /* the mirrored offset: this vertex's cells, seen from the vertex there */
            for (k = 0; k < 4; ++k) {
                int ci = i - (k & 1), cj = j - (k >> 1), vi = ci - di, vj = cj - dj;
                if (!conemap__cell_exists(band->map, ci, cj)) continue;
                if ((band->map->info.wrap_u != CONEMAP_WRAP && (vi < 0 || vi >= band->map->info.width)) ||
                    (band->map->info.wrap_v != CONEMAP_WRAP && (vj < 0 || vj >= band->map->info.height)))
                    continue;
                if (conemap__sees_cell(band->map, band->sector, ci, cj, vi, vj, -1.0f))
                    conemap__raise_seen_cell(band, ci, cj, vi, vj, 0.0f);
            }
        }
    return best;
}

/* The least slope that is known of everything that vertices x.. of row j can raise; `above` leaves row j + 1 out. */
static void conemap__known(const conemap__band *band, int j, int x, int count, int above, float *out) {
    const conemap_map *map = band->map;
    const conemap__kernels *kernels = conemap__kernels_of(map->isa);
    float known[3][CONEMAP__RUN + 2];
    const float *rows[13], *three[3];
    int columns[13], r, n, wraps = map->info.wrap_u == CONEMAP_WRAP, low = j - 1, high = above ? j : j + 1;
    if (map->info.texture.per_cell) high = j;
    if (map->info.wrap_v != CONEMAP_WRAP) {
        low = conemap__maxi(low, 0);
        high = conemap__mini(high, map->info.height - 1);
    }
    for (r = low; r <= high; ++r) {
        n = conemap__collect(map, band->sector.number, r, band->y0, band->y1, rows, columns);
        if (n == 0) {
            memset(known[r - low], 0, sizeof known[0]);
            continue;
        }
        kernels->steepest_row(rows, columns, n, map->info.width, wraps, x - 1, count + 2, known[r - low]);
    }
    for (r = 0; r < 3; ++r) three[r] = known[conemap__mini(r, high - low)];
    kernels->narrowest_row(three, count + 2, 0, 1, count, out);
}

/* Step 5, near, in all directions: the cells with a corner nearer than the root of near2, cut until step 4's bound is
   tight. A corner of up to four pieces of the same V has one number for all. */
static void conemap__find_sights(const conemap__band *band, float near2, conemap__sights *sights) {
    const conemap_info *info = &band->map->info;
    double a = (double)band->a, b = (double)band->b;
    int reach_u = a > 0.0 ? (int)(sqrtf(near2) / band->a) + 1 : 0,
        reach_v = b > 0.0 ? (int)(sqrtf(near2) / band->b) + 1 : 0;
    int x, y, i, j, used = 0;
    memset(sights, 0, sizeof *sights);
    sights->step_x = info->width > 1;
    sights->step_y = info->height > 1;
    for (i = 0; i <= CONEMAP__FINEST; ++i) sights->fraction[i] = (float)i / (float)CONEMAP__FINEST;
    for (y = -reach_v - sights->step_y; y <= reach_v; ++y)
        for (x = -reach_u - sights->step_x; x <= reach_u; ++x) {
            double dx = a * (double)conemap__maxi(conemap__maxi(x, -x - sights->step_x), 0);
            double dy = b * (double)conemap__maxi(conemap__maxi(y, -y - sights->step_y), 0), v = 0.25 * (a * a + b * b);
            int columns = 1, rows = 1;
            if (dx * dx + dy * dy == 0.0 || dx * dx + dy * dy >= (double)near2 * (1.0 + 1.0 / 16384.0)) continue;
            while (v > (double)CONEMAP__TOLERANCE * (dx * dx + dy * dy)) {
                if (a / columns >= b / rows)
                    columns *= 2;
                else
                    rows *= 2;
                v = 0.25 * (a * a / (columns * columns) + b * b / (rows * rows));
            }
            sights->x[sights->count] = x;
            sights->y[sights->count] = y;
            sights->columns[sights->count] = CONEMAP__FINEST / columns;
            sights->rows[sights->count] = CONEMAP__FINEST / rows;
            sights->first[sights->count] = used;
            for (j = 0; j <= rows; ++j)
                for (i = 0; i <= columns; ++i) {
                    double px = a * ((double)x + (double)i / columns), py = b * ((double)y + (double)j / rows);
                    float inverse = (float)(1.000001 / (double)sqrtf((float)(px * px + py * py - v)));
                    sights->most[sights->count] = conemap__max(sights->most[sights->count], inverse * 1.00001f);
                    sights->inverse[used++] = inverse;
                }
            ++sights->count;
        }
}

/* The band's texels look up at cells, or its cells at vertices. */
static void conemap__sights_rows(const conemap__band *band, const conemap__sights *sights, int of_cells) {
    const conemap_map *map = band->map;
    const float *rows[2 * CONEMAP__SIGHT_REACH + 1];
    int w = map->info.width, wraps = map->info.wrap_u == CONEMAP_WRAP, j, k, x;
    int count = of_cells && !wraps ? conemap__maxi(w - 1, 1) : w;
    for (j = band->y0; j < band->y1; ++j) {
        float *plane = band->plane + (size_t)j * (size_t)w, *out = of_cells ? band->cell_slopes + (size_t)j * (size_t)w
            : plane;
        if (of_cells && !conemap__cell_exists(map, 0, j)) continue;
        for (k = -CONEMAP__SIGHT_REACH; k <= CONEMAP__SIGHT_REACH; ++k)
            rows[CONEMAP__SIGHT_REACH + k] = conemap__row_of(map, map->heights, j + k);
        for (x = 0; x < count; x += CONEMAP__RUN) {
            int first = x, run = conemap__mini(CONEMAP__RUN, count - x);
            if (conemap__cut_run(map, 0, &first, j, &run, CONEMAP__SEARCH))
                conemap__kernels_of(map->isa)->sights_row(sights, rows + CONEMAP__SIGHT_REACH, w, wraps,
                                                          of_cells ? plane : NULL, first, run, out + first);
        }
    }
}

/* The neighbours whose pairs are near ones, of at most so many rows above and below. */
#define CONEMAP__NEAR 64
typedef struct conemap__neighbours {
    int count, x[CONEMAP__NEAR], y[CONEMAP__NEAR];
    float inverse[CONEMAP__NEAR]; /* of D^2 - V, raised by more than rounding takes */
} conemap__neighbours;

static conemap__neighbours conemap__near_ones(const conemap__band *band, float near2) {
    conemap__neighbours n;
    int reach_u = band->a > 0.0f ? (int)(sqrtf(near2) / band->a) + 1 : 0;
    int reach_v = band->b > 0.0f ? (int)(sqrtf(near2) / band->b) + 1 : 0, x, y;
    n.count = 0;
    for (y = -reach_v; y <= reach_v; ++y)
        for (x = -reach_u; x <= reach_u; ++x) {
            float dx = (float)x * band->a, dy = (float)y * band->b, d2 = dx * dx + dy * dy;
            if (!(d2 < near2) || !(d2 - band->deflate > 0.5f * band->deflate) || n.count == CONEMAP__NEAR) continue;
            n.x[n.count] = x;
            n.y[n.count] = y;
            n.inverse[n.count++] = 1.0f / ((d2 - band->deflate) * CONEMAP__MARGIN);
        }
    return n;
}

/* Step 5, near, for row j: all pairs whose bound is above what is known. `below` is the row under the band, whose
   vertices concern its last cells. */
static void conemap__near_row(const conemap__band *band, const conemap__neighbours *near_ones, int j, int below) {
    const conemap_map *map = band->map;
    float known[CONEMAP__RUN], bounds[CONEMAP__RUN];
    const float *rows[CONEMAP__NEAR];
    float inverse[CONEMAP__NEAR];
    int columns[CONEMAP__NEAR], x, k, n, i, w = map->info.width;
    for (x = 0; x < w; x += CONEMAP__RUN) {
        int count = conemap__mini(CONEMAP__RUN, w - x);
        conemap__known(band, j, x, count, below, known);
        for (k = n = 0; k < near_ones->count; ++k) {
            rows[n] = conemap__row_of(map, map->heights, j + near_ones->y[k]);
            columns[n] = near_ones->x[k];
            inverse[n] = near_ones->inverse[k];
            n += rows[n] != NULL;
        }
        conemap__kernels_of(map->isa)->near_row(conemap__row_of(map, map->heights, j), rows, columns, inverse, n, w,
                                                map->info.wrap_u == CONEMAP_WRAP, x, count, bounds);
        for (i = 0; i < count; ++i) {
            float apex, best = known[i], *at;
            if (!(bounds[i] > known[i])) continue;
            if (!conemap__is_wanted(map, band->sector.number, x + i, conemap__repeat(j, map->info.height),
                                    CONEMAP__SEARCH)) continue;
            at = below ? NULL : &band->plane[(size_t)j * (size_t)w + (size_t)(x + i)];
            if (at) best = conemap__max(best, *at);
            apex = conemap__vertex(map, x + i, j);
            for (k = 0; k < near_ones->count; ++k) {
                int vi = x + i + near_ones->x[k], vj = j + near_ones->y[k];
                float dh;
                if (map->info.wrap_u != CONEMAP_WRAP && (vi < 0 || vi >= w)) continue;
                if (map->info.wrap_v != CONEMAP_WRAP && (vj < 0 || vj >= map->info.height)) continue;
                dh = conemap__vertex(map, vi, vj) - apex;
                if (dh > 0.0f && dh * dh * near_ones->inverse[k] > known[i])
                    best = conemap__near_pair(band, x + i, j, vi, vj, known[i], best);
            }
            if (at) *at = conemap__max(*at, best);
        }
    }
}

/* ---- relaxed cones that hold for the bilinear surface -----------------------------------------------------------

   A falling ray that starts over p and is inside the solid comes out of it at a point q only if the surface falls
   there more steeply than the ray, seen from p. So if the cone at p holds no surface point that falls seen from p
   [BV24 eq. 4], a step to the cone's end passes the surface at most once, and the way back finds where. A bilinear
   cell has such a point only if a flight direction from P to it and slopes of its sides give x h_x + y h_y < 0; all
   three are ranges, so the smallest products decide. (Their signs alone, one of four quadrants, are [BV24 Algorithm
   2]'s rule, and the pyramids': coarser, so it keeps more cells.) [BV24 Algorithm 2] tests the height of the cell's
   near corner; a falling point can lie higher, so here every corner of a cell that falls limits the cone, by the bounds
   of conemap__safe_vertex (steps 1 and 4 hold for each pair of cells as a whole). What touches P is taken whole: its
   longest gradient if a cell around it falls, and inside P itself the
   bend of the patch: where it falls, behind its top, the mean slope is at most half of the bend,
   |h_xy| X Y / sqrt(X^2 a^2 + Y^2 b^2), largest across the whole cell. Beyond a border that does not wrap, everything
   falls: cells outside, whose corners repeat the border, see to that. */

enum { CONEMAP__FALLS_RIGHT = 1, CONEMAP__FALLS_LEFT = 2, CONEMAP__FALLS_DOWN = 4, CONEMAP__FALLS_UP = 8 };

/* The directions in which some side of cell (i, j) falls; down is towards greater v. */
static int conemap__falling(const conemap_map *map, int i, int j) {
    float h00 = conemap__vertex(map, i, j), h10 = conemap__vertex(map, i + 1, j);
    float h01 = conemap__vertex(map, i, j + 1), h11 = conemap__vertex(map, i + 1, j + 1);
    int flags = 0;
    if (h10 < h00 || h11 < h01) flags |= CONEMAP__FALLS_RIGHT;
    if (h10 > h00 || h11 > h01) flags |= CONEMAP__FALLS_LEFT;
    if (h01 < h00 || h11 < h10) flags |= CONEMAP__FALLS_DOWN;
    if (h01 > h00 || h11 > h10) flags |= CONEMAP__FALLS_UP;
    if (map->info.wrap_u != CONEMAP_WRAP) {
        if (i < 0) flags |= CONEMAP__FALLS_LEFT;
        if (i >= map->info.width - 1) flags |= CONEMAP__FALLS_RIGHT;
    }
    if (map->info.wrap_v != CONEMAP_WRAP) {
        if (j < 0) flags |= CONEMAP__FALLS_UP;
        if (j >= map->info.height - 1) flags |= CONEMAP__FALLS_DOWN;
    }
    return flags;
}

/* The directions in which cells low_i..high_i, low_j..high_j are flown through, seen from the cells at vertex (i,
   j). */
CONEMAP__INLINE int conemap__flown(int low_i, int high_i, int low_j, int high_j, int i, int j) {
    return (high_i >= i - 1 ? CONEMAP__FALLS_RIGHT : 0) | (low_i <= i ? CONEMAP__FALLS_LEFT : 0) |
           (high_j >= j - 1 ? CONEMAP__FALLS_DOWN : 0) | (low_j <= j ? CONEMAP__FALLS_UP : 0);
}

/* The least product of numbers in two ranges. */
CONEMAP__INLINE float conemap__least_product(float a0, float a1, float b0, float b1) {
    return conemap__min(conemap__min(a0 * b0, a0 * b1), conemap__min(a1 * b0, a1 * b1));
}

/* Does cell (i, j) fall anywhere for a flight of x0..x1 texels to the right and y0..y1 down? */
static int conemap__falls_seen(const conemap_map *map, int i, int j, int x0, int x1, int y0, int y1) {
    conemap__corners h = conemap__gather(map->heights, conemap__cell_quad(map, i, j));
    if (map->info.wrap_u != CONEMAP_WRAP && ((i < 0 && x0 < 0) || (i >= map->info.width - 1 && x1 > 0))) return 1;
    if (map->info.wrap_v != CONEMAP_WRAP && ((j < 0 && y0 < 0) || (j >= map->info.height - 1 && y1 > 0))) return 1;
    return conemap__least_product((float)x0, (float)x1, h.h10 - h.h00, h.h11 - h.h01) +
               conemap__least_product((float)y0, (float)y1, h.h01 - h.h00, h.h11 - h.h10) < 0.0f;
}

/* The same seen from the cells at vertex (ui, uj). */
CONEMAP__INLINE int conemap__limits(const conemap_map *map, int i, int j, int ui, int uj) {
    return conemap__falls_seen(map, i, j, i - ui - 1, i - ui + 2, j - uj - 1, j - uj + 2);
}

/* Cells with those outside a border: numbered from `first` on along each axis. */
CONEMAP__INLINE int conemap__outer_first(conemap_wrap wrap) { return wrap == CONEMAP_WRAP ? 0 : -1; }
CONEMAP__INLINE int conemap__outer_count(int size, conemap_wrap wrap) { return wrap == CONEMAP_WRAP ? size : size + 1; }

CONEMAP__INLINE int conemap__outer_exists(const conemap_map *map, int i, int j) {
    return (map->info.wrap_u == CONEMAP_WRAP || (i >= -1 && i < map->info.width)) &&
           (map->info.wrap_v == CONEMAP_WRAP || (j >= -1 && j < map->info.height));
}

/* The highest corner of a cell that falls to the right or left (quadrant bit 0), or down or up (bit 1); else -1. */
static float conemap__falling_cell(const conemap_map *map, int quadrant, int x, int y) {
    int i = x + conemap__outer_first(map->info.wrap_u), j = y + conemap__outer_first(map->info.wrap_v);
    int wanted = (quadrant & 1 ? CONEMAP__FALLS_LEFT : CONEMAP__FALLS_RIGHT) |
                 (quadrant & 2 ? CONEMAP__FALLS_UP : CONEMAP__FALLS_DOWN);
    if (!(conemap__falling(map, i, j) & wanted)) return -1.0f;
    return conemap__highest(conemap__gather(map->heights, conemap__cell_quad(map, i, j)));
}

/* A far cell that limits: its corners, by step 4's bound. */
static float conemap__far_cell(const conemap__band *band, int i, int j, int ui, int uj, float apex, float s) {
    int c;
    if (!conemap__limits(band->map, i, j, ui, uj)) return s;
    for (c = 0; c < 4; ++c) {
        float dh = conemap__vertex(band->map, i + (c & 1), j + (c >> 1)) - apex;
        float x = (float)(i + (c & 1) - ui) * band->a, y = (float)(j + (c >> 1) - uj) * band->b;
        if (dh > 0.0f) s = conemap__max(s, dh * dh / (x * x + y * y - band->deflate));
    }
    return s;
}

/* Square of the distance from vertex (i, j) to the nearest corner of cells low..high. */
CONEMAP__INLINE float conemap__cells_near2(const conemap__band *band, int low_i, int high_i, int low_j, int high_j,
                                           int i, int j) {
    float x = (float)conemap__maxi(0, conemap__maxi(low_i - i, i - (high_i + 1))) * band->a;
    float y = (float)conemap__maxi(0, conemap__maxi(low_j - j, j - (high_j + 1))) * band->b;
    return x * x + y * y;
}

/* The cells near vertex (i, j): seen from it, and the cells at the vertex seen from theirs. */
static float conemap__relaxed_near(const conemap__band *band, int i, int j, float near2, float least, float best) {
    const conemap_map *map = band->map;
    int reach_u = band->a > 0.0f ? (int)(sqrtf(near2) / band->a) + 2 : 1;
    int reach_v = band->b > 0.0f ? (int)(sqrtf(near2) / band->b) + 2 : 1, x, y, k, c;
    for (y = j - 1 - reach_v; y <= j + reach_v; ++y)
        for (x = i - 1 - reach_u; x <= i + reach_u; ++x) {
            if (!conemap__outer_exists(map, x, y) || !(conemap__cells_near2(band, x, x, y, y, i, j) < near2)) continue;
            if (!conemap__limits(map, x, y, i, j)) continue;
            if (conemap__touches(x, y, i, j)) {
                best = conemap__max(best, conemap__corner_slope2(band, i, j, x < i ? -1 : 1, y < j ? -1 : 1));
                continue;
            }
            best = conemap__cell_slope2(band, x, y, i, j, 1.0f, best);
            for (k = 0; k < 4; ++k) {
                int p = i - (k & 1), q = j - (k >> 1);
                if (!conemap__cell_exists(map, p, q)) continue;
                for (c = 0; c < 4; ++c)
                    if (!conemap__touches(p, q, x + (c & 1), y + (c >> 1)))
                        conemap__raise_seen_cell(band, p, q, x + (c & 1), y + (c >> 1), least);
            }
        }
    return best;
}

/* The far cells by rings of growing radius, until not even a height of 1 could limit: the reference. */
static float conemap__relaxed_ring(const conemap__band *band, int i, int j, float near2, float s) {
    const conemap_map *map = band->map;
    float apex = conemap__height(map, i, j), room = 1.0f - apex;
    int wrap_u = map->info.wrap_u == CONEMAP_WRAP, wrap_v = map->info.wrap_v == CONEMAP_WRAP;
    int w = map->info.width, h = map->info.height, r, x, y;
    int low_i = wrap_u ? -w : -1, high_i = wrap_u ? 2 * w - 1 : w - 1;
    int low_j = wrap_v ? -h : -1, high_j = wrap_v ? 2 * h - 1 : h - 1;
    for (r = 0; r <= 2 * conemap__maxi(w, h); ++r) {
        float near_u = (float)r * band->a, near_v = (float)r * band->b;
        float d2 = conemap__min(band->a > 0.0f ? near_u * near_u : CONEMAP__FAR,
                                band->b > 0.0f ? near_v * near_v : CONEMAP__FAR) - band->deflate;
        if (d2 > 0.0f && !(room * room > s * d2 * CONEMAP__MARGIN)) break;
        for (y = j - 1 - r; y <= j + r; ++y) {
            int whole = y == j - 1 - r || y == j + r;
            if (y < low_j || y > high_j) continue;
            for (x = i - 1 - r; x <= i + r; x += whole ? 1 : 2 * r + 1) {
                if (x < low_i || x > high_i || conemap__cells_near2(band, x, x, y, y, i, j) < near2) continue;
                s = conemap__far_cell(band, x, y, i, j, apex, s);
            }
        }
    }
    return s;
}

/* The same by branch and bound over four pyramids, one for each pair of directions, of the cells that fall in one of
   the two. */
static float conemap__relaxed_search(const conemap__band *band, int i, int j, float near2, float s) {
    const conemap_map *map = band->map;
    const conemap_pyramid *pyramids = map->build.falling;
    int wrap_u = map->info.wrap_u == CONEMAP_WRAP, wrap_v = map->info.wrap_v == CONEMAP_WRAP, a, b;
    float apex = conemap__height(map, i, j);
    conemap__candidate stack[3 * 17 + 4];
    for (b = -wrap_v; b <= wrap_v; ++b)
        for (a = -wrap_u; a <= wrap_u; ++a) {
            int first_i = conemap__outer_first(map->info.wrap_u) + a * map->info.width;
            int first_j = conemap__outer_first(map->info.wrap_v) + b * map->info.height, count = 1;
            stack[0].x = stack[0].y = 0;
            stack[0].k = pyramids[0].levels;
            stack[0].dh2 = 1.0f;
            stack[0].d2 = 0.0f;
            while (count > 0) {
                conemap__candidate node = stack[--count];
                int c, k = node.k - 1;
                if (!(node.dh2 > s * node.d2 * CONEMAP__MARGIN)) continue;
                for (c = 3; c >= 0; --c) {
                    int x = 2 * node.x + (c & 1), y = 2 * node.y + (c >> 1), q, flown;
                    int low_i, high_i, low_j, high_j;
                    float highest = -1.0f, dh, d2;
                    if (x >= pyramids[0].width[k] || y >= pyramids[0].height[k]) continue;
                    low_i = first_i + x * (1 << k);
                    high_i = first_i + conemap__mini((x + 1) * (1 << k), pyramids[0].width[0]) - 1;
                    low_j = first_j + y * (1 << k);
                    high_j = first_j + conemap__mini((y + 1) * (1 << k), pyramids[0].height[0]) - 1;
                    flown = conemap__flown(low_i, high_i, low_j, high_j, i, j);
                    for (q = 0; q < 4; ++q)
                        if ((flown & (q & 1 ? CONEMAP__FALLS_LEFT : CONEMAP__FALLS_RIGHT)) &&
                            (flown & (q & 2 ? CONEMAP__FALLS_UP : CONEMAP__FALLS_DOWN)))
                            highest = conemap__max(highest, conemap__children(&pyramids[q], k, node.x, node.y)[c]);
                    dh = highest - apex;
                    d2 = conemap__cells_near2(band, low_i, high_i, low_j, high_j, i, j) - band->deflate;
                    if (!(dh > 0.0f) || !(dh * dh > s * d2 * CONEMAP__MARGIN)) continue;
                    if (k > 0) {
                        stack[count].x = x;
                        stack[count].y = y;
                        stack[count].k = k;
                        stack[count].dh2 = dh * dh;
                        stack[count].d2 = d2;
                        ++count;
                    } else if (d2 + band->deflate >= near2) {
                        s = conemap__far_cell(band, low_i, low_j, i, j, apex, s);
                    }
                }
            }
        }
    return s;
}

/* Inside and around cell (i, j): see the section's comment. */
static float conemap__relaxed_own(const conemap__band *band, int i, int j) {
    const conemap_map *map = band->map;
    float bend = conemap__vertex(map, i + 1, j + 1) - conemap__vertex(map, i, j + 1) -
                 (conemap__vertex(map, i + 1, j) - conemap__vertex(map, i, j));
    float own = band->a > 0.0f && band->b > 0.0f ? bend * bend / (band->a * band->a + band->b * band->b) : 0.0f;
    int x, y;
    for (y = -1; y <= 1; ++y)
        for (x = -1; x <= 1; ++x)
            if ((x || y) && conemap__falls_seen(map, i + x, j + y, x - 1, x + 1, y - 1, y + 1))
                return conemap__max(own, conemap__own_slope2(band, i, j));
    return own;
}

/* `below`: the row under the band, whose vertices concern its last cells. */
static void conemap__relaxed_vertex(const conemap__band *band, int i, int j, float near2, int below) {
    const conemap_map *map = band->map;
    float least = map->build.least_slope2 * (1.0f - 1.0f / 16384.0f), best;
    best = conemap__relaxed_near(band, i, j, near2, least, least);
    if (below) return;
    map->build.plane[(size_t)j * (size_t)map->info.width + (size_t)i] =
        map->info.generator == CONEMAP_RELAXED_EXACT ? conemap__relaxed_search(band, i, j, near2, best)
                                                     : conemap__relaxed_ring(band, i, j, near2, best);
}

/* ======================================================================================================
   B U I L D   P A S S E S
   ====================================================================================================== */

enum {
    CONEMAP__PASS_DECODE, /* strips: heights read, checked, quantised */
    CONEMAP__PASS_STRIPS, /* strips: maxima over texels, low levels */
    CONEMAP__PASS_TOP,    /* one job: the levels above */
    CONEMAP__PASS_CONES,  /* bands: the generator */
    CONEMAP__PASS_STORE,  /* bands: correction and rounding to the format */
    CONEMAP__PASS_CELLS,  /* strips: maxima over cells, low levels */
    CONEMAP__PASS_CELLS_TOP,
    CONEMAP__PASS_COUNT
};

static int conemap__needs_pyramid(conemap_generator generator) {
    return generator == CONEMAP_EXACT || generator == CONEMAP_QUICK || generator == CONEMAP_QUICK_NAIVE ||
           generator == CONEMAP_QUICK_CENTER || generator == CONEMAP_QUICK_NAIVE_CENTER;
}

/* Are the cones made for interpolation? Then bands collect slopes, and correction would be in vain. */
static int conemap__is_bilinear(const conemap_info *info) {
    return info->guarantee == CONEMAP_GUARANTEE_BILINEAR || info->guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR;
}

/* Correction and interpolation need the neighbours as they were, an update the cones that it leaves alone; otherwise
   slopes become cones in place. */
static int conemap__needs_plane(const conemap_map *map) {
    return map->build.updating || map->info.min3x3 || conemap__is_bilinear(&map->info);
}

/* Does an update search only what the edit reaches? Slack depends on the way of the search, and correction on cones
   that
   are no longer there: those start afresh. */
static int conemap__updates_partly(const conemap_desc *desc, const conemap_info *info) {
    return desc->generator == CONEMAP_EXACT && !(desc->slack > 0.0f) && (!desc->min3x3 || conemap__is_bilinear(info));
}

/* Blocks of CONEMAP__BAND texels along an axis. */
CONEMAP__INLINE int conemap__bands(int size) { return (size + CONEMAP__BAND - 1) / CONEMAP__BAND; }

/* The distances of BILINEAR step 7: an axis of one texel has no length, and no texel is longer than 8:1. */
static void conemap__safe_texel(conemap_map *map) {
    float a = map->info.width > 1 ? map->build.texel_u : 0.0f, b = map->info.height > 1 ? map->build.texel_v : 0.0f;
    map->build.search_u = b > 0.0f ? conemap__min(a, CONEMAP__LONGEST * b) : a;
    map->build.search_v = a > 0.0f ? conemap__min(b, CONEMAP__LONGEST * a) : b;
}

static conemap_guarantee conemap__guarantee_of(const conemap_desc *desc) {
    switch (desc->generator) {
    case CONEMAP_EXACT: return desc->guarantee;
    case CONEMAP_RELAXED_EXACT:
    case CONEMAP_RELAXED_EXACT_RING: return CONEMAP_GUARANTEE_RELAXED_BILINEAR;
    case CONEMAP_QUICK_NAIVE:
    case CONEMAP_QUICK: return CONEMAP_GUARANTEE_VERTEX;
    case CONEMAP_RING: return desc->ring_limit ? CONEMAP_GUARANTEE_NONE : CONEMAP_GUARANTEE_VERTEX;
    case CONEMAP_RELAXED:
    case CONEMAP_HYBRID: return desc->ring_limit ? CONEMAP_GUARANTEE_NONE : CONEMAP_GUARANTEE_RELAXED;
    default: return CONEMAP_GUARANTEE_NONE;
    }
}

#define CONEMAP__KNOWN(value, count) ((int)(value) >= 0 && (int)(value) < (int)(count))

static conemap_result conemap__check_texture(const conemap_texture *texture) {
    if (!CONEMAP__KNOWN(texture->format, CONEMAP_FORMAT_COUNT) ||
        !CONEMAP__KNOWN(texture->encoding, CONEMAP_ENCODING_COUNT) ||
        !CONEMAP__KNOWN(texture->layout, CONEMAP_LAYOUT_COUNT))
        return CONEMAP_ERROR_ENUM;
    if (texture->sectors != 0 && texture->sectors != 1 && texture->sectors != 4 && texture->sectors != 8)
        return CONEMAP_ERROR_PARAMETER;
    return texture->sectors > 1 && texture->layout == CONEMAP_DUMMER ? CONEMAP_ERROR_UNSUPPORTED : CONEMAP_OK;
}

/* Checks a heightmap desc and writes its defaults out. */
static conemap_result conemap__resolve_heights(conemap_heights *h) {
    ptrdiff_t row, stride;
    if (!h->pixels) return CONEMAP_ERROR_NULL;
    if (h->width < 1 || h->height < 1 || h->width > CONEMAP_MAX_SIZE || h->height > CONEMAP_MAX_SIZE)
        return CONEMAP_ERROR_SIZE;
    if (!CONEMAP__KNOWN(h->format, CONEMAP_FORMAT_COUNT)) return CONEMAP_ERROR_ENUM;
    if (h->pixel_stride == 0) h->pixel_stride = (ptrdiff_t)conemap__format_size(h->format);
    if (h->pixel_stride < (ptrdiff_t)conemap__format_size(h->format)) return CONEMAP_ERROR_STRIDE;
    if (h->pixel_stride > PTRDIFF_MAX / h->width) return CONEMAP_ERROR_OVERFLOW;
    row = h->pixel_stride * (h->width - 1) + (ptrdiff_t)conemap__format_size(h->format);
    if (h->row_stride == 0) h->row_stride = h->pixel_stride * h->width;
    if (h->row_stride < -PTRDIFF_MAX) return CONEMAP_ERROR_OVERFLOW;
    stride = h->row_stride < 0 ? -h->row_stride : h->row_stride;
    if (h->height > 1 && stride < row) return CONEMAP_ERROR_STRIDE;
    if (stride > (PTRDIFF_MAX - row) / h->height) return CONEMAP_ERROR_OVERFLOW;
    return CONEMAP_OK;
}

/* Checks a desc, apart from what the heights hold, and writes its defaults out. */
static conemap_result conemap__resolve(conemap_desc *desc) {
    conemap_result result = conemap__resolve_heights(&desc->heights);
    if (result != CONEMAP_OK) return result;
    if (!CONEMAP__KNOWN(desc->wrap_u, CONEMAP_WRAP_COUNT) || !CONEMAP__KNOWN(desc->wrap_v, CONEMAP_WRAP_COUNT) ||
        !CONEMAP__KNOWN(desc->generator, CONEMAP_GENERATOR_COUNT) || !CONEMAP__KNOWN(desc->isa, CONEMAP_ISA_COUNT))
        return CONEMAP_ERROR_ENUM;
    if (!conemap__resolve_isa(&desc->isa)) return CONEMAP_ERROR_UNSUPPORTED;
    result = conemap__check_texture(&desc->texture);
    if (result != CONEMAP_OK) return result;
    if (desc->aspect == 0.0f) desc->aspect = 1.0f;
    if (desc->max_tan == 0.0f) desc->max_tan = 1.0f;
    if (desc->hybrid_weight == 0.0f) desc->hybrid_weight = 0.5f;
    if (desc->march_steps == 0) desc->march_steps = 64;
    if (desc->generator == CONEMAP_GENERATE_DEFAULT) desc->generator = CONEMAP_EXACT;
    if (!CONEMAP__KNOWN(desc->guarantee, CONEMAP_GUARANTEE_COUNT)) return CONEMAP_ERROR_ENUM;
    if (desc->generator == CONEMAP_EXACT && desc->guarantee == CONEMAP_GUARANTEE_DEFAULT)
        desc->guarantee = CONEMAP_GUARANTEE_BILINEAR;
    if (desc->guarantee == CONEMAP_GUARANTEE_NONE || desc->guarantee >= CONEMAP_GUARANTEE_RELAXED ||
        (desc->guarantee != CONEMAP_GUARANTEE_DEFAULT && desc->generator != CONEMAP_EXACT &&
         desc->guarantee != conemap__guarantee_of(desc)))
        return CONEMAP_ERROR_UNSUPPORTED;
    if (desc->texture.per_cell &&
        (desc->guarantee != CONEMAP_GUARANTEE_BILINEAR || desc->texture.encoding == CONEMAP_RADIUS))
        return CONEMAP_ERROR_UNSUPPORTED;
    if (desc->texture.sectors > 1 && desc->generator != CONEMAP_EXACT) return CONEMAP_ERROR_UNSUPPORTED;
    if (!conemap__in_range(desc->aspect, 1.0f / 32768.0f, 32768.0f) ||
        !conemap__in_range(desc->max_tan, 1.0f / 65536.0f, CONEMAP_TAN_LIMIT) ||
        !conemap__in_range(desc->hybrid_weight, 0.0f, 1.0f) || !conemap__in_range(desc->slack, 0.0f, 16.0f) ||
        desc->march_steps < 0 ||
        desc->march_steps > 65536 || desc->ring_limit < 0)
        return CONEMAP_ERROR_PARAMETER;
    if ((desc->allocator.allocate == NULL) != (desc->allocator.release == NULL)) return CONEMAP_ERROR_NULL;
    if (desc->heights.width == 1 && desc->wrap_u == CONEMAP_NOTHING) desc->wrap_u = CONEMAP_CLAMP;
    if (desc->heights.height == 1 && desc->wrap_v == CONEMAP_NOTHING) desc->wrap_v = CONEMAP_CLAMP;
    return CONEMAP_OK;
}

/* Fills in the map's info, passes and pyramid sizes, and says how many bytes its planes take. */
static conemap_result conemap__plan(conemap_map *map, const conemap_desc *desc, size_t *memory_size,
                                    size_t *scratch_size) {
    int w = desc->heights.width, h = desc->heights.height, pass, *jobs = map->build.pass_jobs;
    int strips, q, bands = conemap__bands(h);
    size_t texels = (size_t)w * (size_t)h, memory = 0, scratch = 0, job_count = 0, planes;
    conemap_info *info = &map->info;
    info->width = w;
    info->height = h;
    info->wrap_u = desc->wrap_u;
    info->wrap_v = desc->wrap_v;
    info->aspect = desc->aspect;
    info->max_tan = desc->max_tan;
    info->texture = desc->texture;
    info->generator = desc->generator;
    info->guarantee = conemap__guarantee_of(desc);
    info->min3x3 = desc->min3x3 != 0;
    info->slack = desc->slack;
    map->isa = desc->isa;
    map->build.desc = *desc;
    map->build.allocator = desc->allocator;
    map->build.texel_u = 1.0f / (float)w;
    map->build.texel_v = desc->aspect / (float)h;
    map->build.search_u = map->build.texel_u;
    map->build.search_v = map->build.texel_v;
    map->build.least_slope2 = 1.0f / (desc->max_tan * desc->max_tan) * (1.0f - 1.0f / 262144.0f);
    planes = (size_t)conemap__planes(info);
    if (!conemap__add_size(&memory, texels, sizeof(float)) ||
        !conemap__add_size(&memory, texels, planes * sizeof(float)))
        return CONEMAP_ERROR_OVERFLOW;
    strips = (h + CONEMAP__STRIP - 1) / CONEMAP__STRIP;
    jobs[CONEMAP__PASS_DECODE] = strips;
    jobs[CONEMAP__PASS_CONES] = bands * (int)planes;
    jobs[CONEMAP__PASS_STORE] = bands * (int)planes;
    if (desc->keep_pyramid) {
        int cells_u = conemap__cell_count(w, desc->wrap_u), cells_v = conemap__cell_count(h, desc->wrap_v);
        if (!conemap__pyramid_plan(&map->cells, cells_u, cells_v, 1, &memory)) return CONEMAP_ERROR_OVERFLOW;
        jobs[CONEMAP__PASS_CELLS] = (cells_v + CONEMAP__STRIP - 1) / CONEMAP__STRIP;
        jobs[CONEMAP__PASS_CELLS_TOP] = 1;
    }
    map->build.keeps_search = desc->keep_search && conemap__updates_partly(desc, info);
    if (map->build.keeps_search &&
        !conemap__add_size(&memory, 2 * (size_t)conemap__planes(info) * (size_t)conemap__bands(w) * (size_t)bands,
                           sizeof(float)))
        return CONEMAP_ERROR_OVERFLOW;
    if (conemap__needs_pyramid(desc->generator)) {
        if (!conemap__maxima_plan(&map->build.texels, w, h, map->build.keeps_search ? &memory : &scratch))
            return CONEMAP_ERROR_OVERFLOW;
        jobs[CONEMAP__PASS_STRIPS] = strips;
        jobs[CONEMAP__PASS_TOP] = 1;
    }
    if (desc->generator == CONEMAP_RELAXED_EXACT) {
        int cells_u = conemap__outer_count(w, desc->wrap_u), cells_v = conemap__outer_count(h, desc->wrap_v);
        for (q = 0; q < 4; ++q)
            if (!conemap__pyramid_plan(&map->build.falling[q], cells_u, cells_v, 0, &scratch))
                return CONEMAP_ERROR_OVERFLOW;
        jobs[CONEMAP__PASS_STRIPS] = (cells_v + CONEMAP__STRIP - 1) / CONEMAP__STRIP;
        jobs[CONEMAP__PASS_TOP] = 1;
    }
    if (conemap__is_bilinear(info)) {
        conemap__safe_texel(map);
        if (!conemap__add_size(&scratch, texels, planes * sizeof(float))) return CONEMAP_ERROR_OVERFLOW;
    }
    if (conemap__needs_plane(map) && !conemap__add_size(&scratch, texels, planes * sizeof(float)))
        return CONEMAP_ERROR_OVERFLOW;
    for (pass = 0; pass < CONEMAP__PASS_COUNT; ++pass) job_count += (size_t)jobs[pass];
    if (!conemap__add_size(&scratch, job_count, 1)) return CONEMAP_ERROR_OVERFLOW;
    *memory_size = memory;
    *scratch_size = scratch;
    return CONEMAP_OK;
}

static conemap_result conemap__take(const conemap_allocator *allocator, void *given, size_t given_size,
                                    size_t size, void **memory, int *owns) {
    *memory = given;
    *owns = 0;
    if (given) {
        if ((uintptr_t)given % CONEMAP_ALIGNMENT != 0) return CONEMAP_ERROR_ALIGNMENT;
        return given_size < size ? CONEMAP_ERROR_BUFFER : CONEMAP_OK;
    }
    *memory = allocator->allocate ? allocator->allocate(size, allocator->user) : CONEMAP_MALLOC(size);
    *owns = *memory != NULL;
    if (!*memory) return CONEMAP_ERROR_MEMORY;
    return (uintptr_t)*memory % CONEMAP_ALIGNMENT != 0 ? CONEMAP_ERROR_ALIGNMENT : CONEMAP_OK;
}

static void conemap__release(const conemap_allocator *allocator, void *memory, int owns) {
    if (!owns) return;
    if (allocator->release)
        allocator->release(memory, allocator->user);
    else
        CONEMAP_FREE(memory);
}

/* Would the two descs behind these infos make the same cones of the same heights? */
static int conemap__same_settings(const conemap_info *a, const conemap_info *b) {
    return a->width == b->width && a->height == b->height && a->wrap_u == b->wrap_u && a->wrap_v == b->wrap_v &&
           conemap__bits(a->aspect) == conemap__bits(b->aspect) &&
           conemap__bits(a->max_tan) == conemap__bits(b->max_tan) &&
           a->texture.format == b->texture.format && a->texture.encoding == b->texture.encoding &&
           a->texture.layout == b->texture.layout && !a->texture.per_cell == !b->texture.per_cell &&
           conemap__planes(a) == conemap__planes(b) &&
           a->generator == b->generator && a->guarantee == b->guarantee &&
           a->min3x3 == b->min3x3 && conemap__bits(a->slack) == conemap__bits(b->slack) &&
           !a->texture.flip_dv == !b->texture.flip_dv;
}

static void *conemap__cut(unsigned char **cursor, size_t count, size_t size) {
    void *piece = *cursor;
    *cursor += (count * size + CONEMAP_ALIGNMENT - 1) / CONEMAP_ALIGNMENT * CONEMAP_ALIGNMENT;
    return piece;
}

static void conemap__cut_pyramid(conemap_pyramid *pyramid, int first, unsigned char **cursor) {
    int k;
    for (k = first; k < pyramid->levels; ++k)
        pyramid->level[k] = (float *)conemap__cut(
            cursor, (size_t)((pyramid->width[k] + 1) / 2) * (size_t)((pyramid->height[k] + 1) / 2), 4 * sizeof(float));
}

static void conemap__cut_maxima(conemap_map *map, unsigned char **cursor) {
    conemap_pyramid *texels = &map->build.texels;
    int k;
    texels->level[0] = map->build.heights;
    for (k = 1; k < texels->levels; ++k)
        texels->level[k] =
            (float *)conemap__cut(cursor, (size_t)texels->width[k] * (size_t)texels->height[k], sizeof(float));
}

CONEMAP__DEF void conemap_free(conemap_map *map) {
    if (!map) return;
    conemap__release(&map->build.allocator, map->build.memory, map->build.owns_memory);
    conemap__release(&map->build.allocator, map->build.scratch, map->build.owns_scratch);
    memset(map, 0, sizeof *map);
}

/* Takes memory for a planned map and cuts it up in the order in which conemap__plan counted. */
static conemap_result conemap__allocate(conemap_map *map, size_t memory_size, size_t scratch_size) {
    const conemap_desc *desc = &map->build.desc;
    size_t texels = conemap__texels(map), planes = (size_t)conemap__planes(&map->info);
    unsigned char *cursor;
    int q;
    conemap_result result = conemap__take(&map->build.allocator, desc->memory, desc->memory_size, memory_size,
                                          &map->build.memory, &map->build.owns_memory);
    if (result == CONEMAP_OK && scratch_size > 0)
        result = conemap__take(&map->build.allocator, desc->scratch, desc->scratch_size, scratch_size,
                               &map->build.scratch, &map->build.owns_scratch);
    if (result != CONEMAP_OK) return result;
    map->memory_size = memory_size;
    cursor = (unsigned char *)map->build.memory;
    map->heights = map->build.heights = (float *)conemap__cut(&cursor, texels, sizeof(float));
    map->cones = map->build.cones = (float *)conemap__cut(&cursor, texels, planes * sizeof(float));
    conemap__cut_pyramid(&map->cells, 1, &cursor);
    if (map->build.keeps_search) {
        size_t blocks = (size_t)conemap__bands(map->info.width) * (size_t)conemap__bands(map->info.height);
        map->build.survey = (float *)conemap__cut(&cursor, 2 * (size_t)conemap__planes(&map->info) * blocks,
                                                  sizeof(float));
        conemap__cut_maxima(map, &cursor);
    }
    if (scratch_size > 0) {
        cursor = (unsigned char *)map->build.scratch;
        if (!map->build.keeps_search) conemap__cut_maxima(map, &cursor);
        for (q = 0; q < 4; ++q) conemap__cut_pyramid(&map->build.falling[q], 0, &cursor);
        if (conemap__is_bilinear(&map->info))
            map->build.cell_slopes = (float *)conemap__cut(&cursor, texels, planes * sizeof(float));
        map->build.plane =
            conemap__needs_plane(map) ? (float *)conemap__cut(&cursor, texels, planes * sizeof(float))
                : map->build.cones;
        map->build.job_results = cursor;
        memset(cursor, 0, scratch_size - (size_t)(cursor - (unsigned char *)map->build.scratch));
    }
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_memory(const conemap_desc *desc, size_t *memory_size, size_t *scratch_size) {
    conemap_map map;
    conemap_desc resolved;
    conemap_result result;
    size_t memory = 0, scratch = 0;
    if (!desc) return CONEMAP_ERROR_NULL;
    memset(&map, 0, sizeof map);
    resolved = *desc;
    result = conemap__resolve(&resolved);
    if (result == CONEMAP_OK) result = conemap__plan(&map, &resolved, &memory, &scratch);
    if (result != CONEMAP_OK) return result;
    if (memory_size) *memory_size = memory;
    if (scratch_size) *scratch_size = scratch;
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_begin(const conemap_desc *desc, conemap_map *map) {
    conemap_desc resolved;
    conemap_result result;
    size_t memory_size, scratch_size;
    if (!map) return CONEMAP_ERROR_NULL;
    memset(map, 0, sizeof *map);
    if (!desc) return CONEMAP_ERROR_NULL;
    resolved = *desc;
    result = conemap__resolve(&resolved);
    if (result == CONEMAP_OK) result = conemap__plan(map, &resolved, &memory_size, &scratch_size);
    if (result == CONEMAP_OK) result = conemap__allocate(map, memory_size, scratch_size);
    if (result != CONEMAP_OK) conemap_free(map);
    return result;
}

CONEMAP__DEF int conemap_pass_count(const conemap_map *map) {
    return map && map->build.job_results ? (int)CONEMAP__PASS_COUNT : 0;
}

CONEMAP__DEF int conemap_job_count(const conemap_map *map, int pass) {
    return pass >= 0 && pass < conemap_pass_count(map) ? map->build.pass_jobs[pass] : 0;
}

static conemap_result conemap__decode_rows(conemap_map *map, const conemap_heights *h, int y0, int y1) {
    const conemap__kernels *kernels = conemap__kernels_of(map->isa);
    int y;
    for (y = y0; y < y1; ++y)
        if (!kernels->decode_row(&map->info, h, y, map->build.heights + (size_t)y * (size_t)map->info.width))
            return CONEMAP_ERROR_HEIGHT;
    return CONEMAP_OK;
}

CONEMAP__INLINE int conemap__is_wanted(const conemap_map *map, int sector, int x, int y, int what) {
    return !map->build.wanted || (map->build.wanted[(size_t)sector * conemap__texels(map) +
                                                    (size_t)y * (size_t)map->info.width + (size_t)x] & what);
}

/* The jobs of a sector's cones: one sector after the other. */

/* Tells the host how far the build is: almost all of the work is in the cones. */
static conemap_result conemap__report(const conemap_map *map, int pass, int sector, double done_rows) {
    const conemap_desc *desc = &map->build.desc;
    double cones = ((double)sector + done_rows / (double)map->info.height) / (double)conemap__planes(&map->info), done;
    if (!desc->progress) return CONEMAP_OK;
    done = pass < CONEMAP__PASS_CONES    ? 0.01 * (double)(pass + 1)
           : pass == CONEMAP__PASS_CONES ? 0.04 + 0.92 * cones
                                         : 0.96 + 0.01 * (double)(pass - CONEMAP__PASS_CONES);
    return desc->progress(done, desc->progress_user) ? CONEMAP_CANCELLED : CONEMAP_OK;
}

static conemap_result conemap__cone_rows(conemap_map *map, int y0, int y1) {
    int x, y, w = map->info.width;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < w; ++x) {
            if (!conemap__is_wanted(map, 0, x, y, CONEMAP__SEARCH)) continue;
            map->build.plane[(size_t)y * (size_t)w + (size_t)x] = conemap__generate(map, x, y);
            if (x % 256 == 255 || x == w - 1) { /* a single row of a slow generator can take seconds */
                conemap_result result =
                    conemap__report(map, CONEMAP__PASS_CONES, 0, (double)y + (double)(x + 1) / (double)w);
                if (result != CONEMAP_OK) return result;
            }
        }
    return CONEMAP_OK;
}

/* Searches the tiles of rows y0 to y1, tile rows whole; the plane of slopes holds what is known. */
static conemap_result conemap__search_rows(const conemap_map *map, conemap__search *search, int y0, int y1,
                                           float *slopes) {
    int x, y, w = map->info.width;
    for (y = y0; y < y1; y += CONEMAP__TILE)
        for (x = 0; x < w; x += CONEMAP__TILE) {
            conemap__search_tile(map, search, x, y, slopes);
            if (x % 512 == 512 - CONEMAP__TILE || x + CONEMAP__TILE >= w) {
                conemap_result result = conemap__report(
                    map, CONEMAP__PASS_CONES, 0,
                    (double)y + (double)conemap__mini(CONEMAP__TILE, y1 - y) *
                    (double)(x + 1) / (double)(w + CONEMAP__TILE));
                if (result != CONEMAP_OK) return result;
            }
        }
    return CONEMAP_OK;
}

/* Squared slopes become cones where they are. */
static void conemap__tangent_rows(const conemap_map *map, float *plane, int y0, int y1) {
    int y;
    for (y = y0; y < y1; ++y) {
        float *row = plane + (size_t)y * (size_t)map->info.width;
        const float *slopes = row;
        conemap__kernels_of(map->isa)->tangent_row(&slopes, 1, CONEMAP__TANGENT_MARGIN, map->info.max_tan,
                                                   map->info.width, row);
    }
}

static conemap_result conemap__quick_rows(const conemap_map *map, int y0, int y1) {
    conemap__quick_level levels[CONEMAP__BAND][17], column[17];
    conemap__quick_columns columns;
    const conemap_info *info = &map->info;
    int improved = info->generator == CONEMAP_QUICK || info->generator == CONEMAP_QUICK_CENTER;
    int center = info->generator == CONEMAP_QUICK_NAIVE_CENTER || info->generator == CONEMAP_QUICK_CENTER;
    int count = map->build.texels.levels, x, y, i, k, side, w = info->width;
    for (y = y0; y < y1; ++y)
        conemap__quick_axis(info->height, info->wrap_v, y, count, map->build.texel_v, improved, center, levels[y - y0]);
    memset(&columns, 0, sizeof columns);
    for (x = 0; x < w; x += 16) {
        for (i = 0; i < 16 && x + i < w; ++i) {
            conemap__quick_axis(w, info->wrap_u, x + i, count, map->build.texel_u, improved, center, column);
            for (k = 0; k < count; ++k) {
                columns.full[k][i] = column[k].full;
                for (side = 0; side < 3; ++side) {
                    columns.p[k][side][i] = column[k].p[side];
                    columns.q[k][side][i] = column[k].q[side];
                    columns.node[k][side][i] = column[k].node[side];
                }
            }
        }
        for (y = y0; y < y1; ++y) {
            size_t at = (size_t)y * (size_t)w + (size_t)x;
            conemap__kernels_of(map->isa)->quick_row(&map->build.texels, &columns, levels[y - y0], map->heights + at,
                                                     map->build.least_slope2, conemap__mini(16, w - x),
                                                     map->build.plane + at);
        }
        if (x % 256 == 240 || x + 16 >= w) {
            conemap_result result = conemap__report(map, CONEMAP__PASS_CONES, 0,
                                                    (double)y0 + (double)(y1 - y0) * (double)x / (double)w);
            if (result != CONEMAP_OK) return result;
        }
    }
    conemap__tangent_rows(map, map->build.plane, y0, y1);
    return CONEMAP_OK;
}

/* The same for one sector, texel by texel. */
static conemap_result conemap__sector_rows(const conemap_map *map, const conemap__search *common, int sector, int y0,
                                           int y1, float *slopes) {
    conemap__sector_search search;
    int x, y, w = map->info.width;
    memset(&search, 0, sizeof search);
    search.common = *common;
    search.sector = conemap__make_sector(&map->info, sector);
    search.room = map->build.cell_slopes != NULL;
    search.best_j = y0;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < w; ++x) {
            float *at = &slopes[(size_t)y * (size_t)w + (size_t)x];
            if (conemap__is_wanted(map, sector, x, y, CONEMAP__SEARCH))
                *at = conemap__search_sector(map, &search, x, y, *at);
            if (x % 256 == 255 || x == w - 1) {
                conemap_result result =
                    conemap__report(map, CONEMAP__PASS_CONES, sector, (double)y + (double)(x + 1) / (double)w);
                if (result != CONEMAP_OK) return result;
            }
        }
    return CONEMAP_OK;
}

static conemap_result conemap__exact_rows(const conemap_map *map, int sector, int y0, int y1) {
    conemap__search search = conemap__make_search(map);
    float *plane = map->build.plane + (size_t)sector * conemap__texels(map);
    conemap_result result;
    int x, y, k, w = map->info.width;
    for (y = y0; y < y1; ++y) {
        float *row = plane + (size_t)y * (size_t)w;
        const float *rows[3];
        for (k = 0; k < 3; ++k) rows[k] = conemap__row_of(map, map->heights, y + k - 1);
        for (x = 0; map->info.texture.sectors > 1 && x < w; ++x) row[x] = map->build.least_slope2;
        if (map->info.texture.sectors <= 1)
            conemap__kernels_of(map->isa)->ring_row(rows, w, map->info.wrap_u == CONEMAP_WRAP, search.a, search.b,
                                                    map->build.least_slope2, row);
    }
    result = map->info.texture.sectors > 1 ? conemap__sector_rows(map, &search, sector, y0, y1, plane)
                                           : conemap__search_rows(map, &search, y0, y1, plane);
    conemap__tangent_rows(map, plane, y0, y1);
    return result;
}

static conemap__band conemap__make_band(const conemap_map *map, int job) {
    conemap__band band;
    int sector = job / conemap__bands(map->info.height);
    float a = map->build.search_u, b = map->build.search_v;
    memset(&band, 0, sizeof band);
    band.map = map;
    band.sector = conemap__make_sector(&map->info, sector);
    band.plane = map->build.plane + (size_t)sector * conemap__texels(map);
    band.cell_slopes = map->build.cell_slopes + (size_t)sector * conemap__texels(map);
    band.y0 = (job - sector * conemap__bands(map->info.height)) * CONEMAP__BAND;
    band.y1 = conemap__mini(band.y0 + CONEMAP__BAND, map->info.height);
    band.a = a;
    band.b = b;
    band.deflate = 0.25f * (a * a + b * b);
    if (a > 0.0f && b > 0.0f && 1.55f * band.deflate > conemap__min(a, b) * conemap__min(a, b)) {
        band.close_u = (int)(sqrtf(1.6f * band.deflate) / a) + 1;
        band.close_v = (int)(sqrtf(1.6f * band.deflate) / b) + 1;
    }
    return band;
}

/* The margin of step 8. In a sector cones often touch along a whole edge of a cell, where the way out of the sector is
   steeper; a little more room there makes them much easier to prove. */
CONEMAP__INLINE float conemap__safe_margin(const conemap_map *map) {
    return map->info.texture.sectors > 1 ? 1.0f / 1024.0f : 1.0f / 65536.0f;
}

/* Own cells and own corners in a sector. */
static void conemap__sector_start(const conemap__band *band, float least) {
    const conemap_map *map = band->map;
    int x, y, k, w = map->info.width;
    size_t row = (size_t)band->y0 * (size_t)w;
    memset(band->cell_slopes + row, 0, (size_t)(band->y1 - band->y0) * (size_t)w * sizeof(float));
    for (y = band->y0 - 1; y <= band->y1; ++y)
        for (x = -1; x < w; ++x)
            if (conemap__cell_exists(map, x, y) && conemap__has_cell(band, x, y))
                conemap__raise_cell(band, x, y, conemap__own_slope2(band, x, y));
    for (y = band->y0; y < band->y1; ++y)
        for (x = 0; x < w; ++x) {
            float best = least;
            for (k = 0; k < 4; ++k) {
                int si = k & 1 ? 1 : -1, sj = k & 2 ? 1 : -1;
                if (si * band->sector.su < 0 || sj * band->sector.sv < 0) continue;
                if (conemap__cell_exists(map, conemap__mini(x, x + si), conemap__mini(y, y + sj)))
                    best = conemap__max(best, conemap__corner_slope2(band, x, y, si, sj));
            }
            band->plane[(size_t)y * (size_t)w + (size_t)x] = best;
        }
}

/* Own cells and own corners, in all directions. */
static void conemap__safe_start(const conemap__band *band, float least) {
    const conemap_map *map = band->map;
    const conemap__kernels *kernels = conemap__kernels_of(map->isa);
    int y, k, w = map->info.width, wraps = map->info.wrap_u == CONEMAP_WRAP;
    for (y = band->y0; y < band->y1; ++y) {
        size_t row = (size_t)y * (size_t)w;
        const float *rows[3];
        for (k = 0; k < 3; ++k) rows[k] = conemap__row_of(map, map->heights, y + k - 1);
        kernels->gradient_row(rows[1], rows[2] ? rows[2] : rows[1], w, wraps, band->a, band->b,
                              band->cell_slopes + row);
        kernels->corners_row(rows, w, wraps, band->a, band->b, least, band->plane + row);
    }
}

/* For long texels, close pairs. */
static void conemap__safe_close(const conemap__band *band, float least) {
    const conemap_map *map = band->map;
    int x, y, w = map->info.width;
    for (y = band->y0; (band->close_u || band->close_v) && y <= band->y1; ++y)
        for (x = 0; x < w; ++x) {
            int j = conemap__texel_index(y, map->info.height, map->info.wrap_v);
            float *at = &band->plane[(size_t)j * (size_t)w + (size_t)x], best;
            if (y == map->info.height && map->info.wrap_v != CONEMAP_WRAP) break;
            if (!conemap__is_wanted(map, band->sector.number, x, j, CONEMAP__SEARCH)) continue;
            best = conemap__close_pairs(band, x, y, least);
            if (y < band->y1) *at = conemap__max(*at, best);
        }
}

static conemap_result conemap__safe_band(const conemap_map *map, int job) {
    conemap__band band = conemap__make_band(map, job);
    conemap__search search = conemap__make_search(map);
    conemap__neighbours near_ones;
    conemap__sights sights;
    conemap_result result;
    float least = map->build.least_slope2 * (1.0f - 4.0f * conemap__safe_margin(map)); /* the margin leaves max_tan
                                                                                          whole */
    int y;
    search.deflate = band.deflate;
    search.near2 = band.deflate / CONEMAP__TOLERANCE * (1.0f - 1.0f / 4096.0f);
    if (band.sector.su != 0) {
        near_ones = conemap__near_ones(&band, search.near2);
        conemap__sector_start(&band, least);
        conemap__safe_close(&band, least);
    } else {
        conemap__find_sights(&band, search.near2, &sights);
        conemap__safe_start(&band, least);
        conemap__sights_rows(&band, &sights, 0);
        result = conemap__search_rows(map, &search, band.y0, band.y1, band.plane);
        if (result == CONEMAP_OK) conemap__sights_rows(&band, &sights, 1);
        return result;
    }
    result = conemap__sector_rows(map, &search, band.sector.number, band.y0, band.y1, band.plane);
    for (y = band.y0; result == CONEMAP_OK && y <= band.y1; ++y)
        if (y < map->info.height || map->info.wrap_v == CONEMAP_WRAP)
            conemap__near_row(&band, &near_ones, y, y == band.y1);
    return result;
}

static conemap_result conemap__relaxed_band(const conemap_map *map, int job) {
    conemap__band band = conemap__make_band(map, job);
    float near2 = band.deflate / CONEMAP__TOLERANCE;
    int x, y, w = map->info.width;
    for (y = band.y0; y < band.y1; ++y)
        for (x = 0; x < w; ++x)
            map->build.cell_slopes[(size_t)y * (size_t)w + (size_t)x] =
                conemap__cell_exists(map, x, y) ? conemap__relaxed_own(&band, x, y) : 0.0f;
    for (y = band.y0; y <= band.y1; ++y)
        for (x = 0; x < w && (y < map->info.height || map->info.wrap_v == CONEMAP_WRAP); ++x) {
            conemap__relaxed_vertex(&band, x, y, near2, y == band.y1);
            if (x % 256 == 255 || x == w - 1) {
                conemap_result result =
                    conemap__report(map, CONEMAP__PASS_CONES, 0, (double)y + (double)(x + 1) / (double)w);
                if (result != CONEMAP_OK) return result;
            }
        }
    return CONEMAP_OK;
}

/* 1 / sqrt(s) as conemap__tangent, with the margin of step 8. */
static void conemap__safe_tangents(const conemap_map *map, int sector, int x, int y, int count, float *tangents) {
    const conemap__kernels *kernels = conemap__kernels_of(map->isa);
    const float *rows[13], *slopes = tangents;
    int columns[13], n, w = map->info.width, wraps = map->info.wrap_u == CONEMAP_WRAP;
    if (map->info.texture.per_cell && map->info.wrap_v != CONEMAP_WRAP)
        y = conemap__mini(y, conemap__maxi(map->info.height - 2, 0));
    n = conemap__collect(map, sector, y, 0, map->info.height, rows, columns);
    kernels->steepest_row(rows, columns, n, w, wraps, x, count, tangents);
    if (map->info.texture.per_cell && !wraps && x + count == w && w > 1) /* there is one cell less than texels: what */
        kernels->steepest_row(rows, columns, n, w, wraps, w - 2, 1, tangents + count - 1); /* lies beyond projects onto
                                                                                              the last */
    kernels->tangent_row(&slopes, 1, 1.0f - conemap__safe_margin(map), map->info.max_tan, count, tangents);
}

static void conemap__store_run(conemap_map *map, int sector, int x, int y, int count) {
    const conemap__kernels *kernels = conemap__kernels_of(map->isa);
    float tangents[CONEMAP__RUN], cones[CONEMAP__RUN];
    size_t w = (size_t)map->info.width, at, first = (size_t)sector * conemap__texels(map);
    int k;
    if (!conemap__cut_run(map, sector, &x, y, &count, CONEMAP__STORE)) return;
    at = (size_t)y * w + (size_t)x;
    if (map->build.cell_slopes) {
        conemap__safe_tangents(map, sector, x, y, count, tangents);
    } else if (map->info.min3x3) { /* [BV24 eq. 2] */
        const float *rows[3];
        for (k = 0; k < 3; ++k)
            rows[k] = map->build.plane + first +
                      (size_t)conemap__texel_index(y + k - 1, map->info.height, map->info.wrap_v) * w;
        kernels->narrowest_row(rows, map->info.width, map->info.wrap_u == CONEMAP_WRAP, x, count, tangents);
    } else {
        memcpy(tangents, map->build.plane + first + at, (size_t)count * sizeof(float));
    }
    kernels->store_row(&map->info, map->heights + at, tangents, count, cones);
    for (k = 0; k < count; ++k)
        if (conemap__is_wanted(map, sector, x + k, y, CONEMAP__STORE))
            map->build.cones[first + at + (size_t)k] = cones[k];
}

static void conemap__store_rows(conemap_map *map, int sector, int y0, int y1) {
    int x, y;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < map->info.width; x += CONEMAP__RUN)
            conemap__store_run(map, sector, x, y, conemap__mini(CONEMAP__RUN, map->info.width - x));
}

/* A lower bound of a texel's squared slope, from its stored cone, which rounding made narrower by less than a step. */
static float conemap__slope_floor(const conemap_map *map, const float *cones, size_t at) {
    const conemap_texture *texture = &map->info.texture;
    uint32_t code = conemap__code_near(texture->format, cones[at]);
    float next = conemap__value(texture->format, code + 2), tangent;
    if (texture->format != CONEMAP_F32 && texture->format != CONEMAP_F16 && next > 1.0f) next = map->info.max_tan;
    tangent = conemap__finite(next) ? conemap__decode_tan(&map->info, map->heights[at], next) : map->info.max_tan;
    /* near the top a radius says nothing */
    if (texture->encoding == CONEMAP_RADIUS && map->heights[at] > 0.999f) tangent = map->info.max_tan;
    tangent = conemap__min(tangent, map->info.max_tan);
    return tangent > 0.0f ? 1.0f / (tangent * tangent) * (1.0f - 1.0f / 8192.0f) : 0.0f;
}

/* A sector's survey of a block: its lowest height, and the least that its texels' squared slopes can be. */
CONEMAP__INLINE float *conemap__surveyed(const conemap_map *map, int sector, int block_u, int block_v) {
    size_t bands_u = (size_t)conemap__bands(map->info.width), bands_v = (size_t)conemap__bands(map->info.height);
    return map->build.survey + 2 * (((size_t)sector * bands_v + (size_t)block_v) * bands_u + (size_t)block_u);
}

/* Surveys the blocks of a row of them, or of these the ones that an update has changed. */
static void conemap__survey_band(const conemap_map *map, int sector, int band) {
    const float *cones = map->cones + (size_t)sector * conemap__texels(map);
    int w = map->info.width, y1 = conemap__mini((band + 1) * CONEMAP__BAND, map->info.height), block, x, y;
    for (block = 0; block < conemap__bands(w); ++block) {
        float *survey = conemap__surveyed(map, sector, block, band);
        int x1 = conemap__mini((block + 1) * CONEMAP__BAND, w), wanted = 0;
        for (y = band * CONEMAP__BAND; y < y1; ++y)
            for (x = block * CONEMAP__BAND; x < x1; ++x)
                wanted |= conemap__is_wanted(map, sector, x, y, CONEMAP__STORE);
        if (!wanted) continue;
        survey[0] = survey[1] = CONEMAP__FAR;
        for (y = band * CONEMAP__BAND; y < y1; ++y)
            for (x = block * CONEMAP__BAND; x < x1; ++x) {
                size_t at = (size_t)y * (size_t)w + (size_t)x;
                survey[0] = conemap__min(survey[0], map->heights[at]);
                survey[1] = conemap__min(survey[1], conemap__slope_floor(map, cones, at));
            }
    }
}

/* Where a pass keeps the results of its jobs: 0 is not run, else 1 + result. */
static unsigned char *conemap__job_slots(const conemap_map *map, int pass) {
    unsigned char *slots = map->build.job_results;
    int p;
    for (p = 0; p < pass; ++p) slots += map->build.pass_jobs[p];
    return slots;
}

CONEMAP__DEF conemap_result conemap_run_job(conemap_map *map, int pass, int job) {
    conemap_result result = CONEMAP_OK;
    int h, q, sector, y0, y1;
    if (!map) return CONEMAP_ERROR_NULL;
    if (job < 0 || job >= conemap_job_count(map, pass)) return CONEMAP_ERROR_ORDER;
    h = map->info.height;
    sector = job / conemap__bands(map->info.height); /* of jobs that are bands */
    y0 = (job - sector * conemap__bands(map->info.height)) * CONEMAP__BAND;
    switch (pass) {
    case CONEMAP__PASS_DECODE:
        result = conemap__decode_rows(map, &map->build.desc.heights, job * CONEMAP__STRIP,
                                      conemap__mini((job + 1) * CONEMAP__STRIP, h));
        break;
    case CONEMAP__PASS_STRIPS:
        if (map->build.texels.levels) conemap__maxima_strip(map, job);
        for (q = 0; q < 4; ++q) conemap__pyramid_strip(map, &map->build.falling[q], job);
        break;
    case CONEMAP__PASS_TOP:
        if (map->build.texels.levels) conemap__maxima_top(map);
        for (q = 0; q < 4; ++q) conemap__pyramid_top(map, &map->build.falling[q]);
        break;
    case CONEMAP__PASS_CONES:
        y1 = conemap__mini(y0 + CONEMAP__BAND, h);
        result = map->info.guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR ? conemap__relaxed_band(map, job)
                 : map->build.cell_slopes                    ? conemap__safe_band(map, job)
                 : map->info.generator == CONEMAP_EXACT      ? conemap__exact_rows(map, sector, y0, y1)
                 : conemap__needs_pyramid(map->info.generator) ? conemap__quick_rows(map, y0, y1)
                                                             : conemap__cone_rows(map, y0, y1);
        break;
    case CONEMAP__PASS_STORE:
        conemap__store_rows(map, sector, y0, conemap__mini(y0 + CONEMAP__BAND, h));
        if (map->build.survey) conemap__survey_band(map, sector, y0 / CONEMAP__BAND);
        break;
    case CONEMAP__PASS_CELLS: conemap__pyramid_strip(map, &map->cells, job); break;
    default: conemap__pyramid_top(map, &map->cells); break;
    }
    if (result == CONEMAP_OK && pass != CONEMAP__PASS_CONES) result = conemap__report(map, pass, 0, 0.0);
    conemap__job_slots(map, pass)[job] = (unsigned char)(1 + (int)result);
    return result;
}

/* The hash of the heights, and the highest of them. */
static uint64_t conemap__survey_heights(const conemap_map *map, float *highest) {
    size_t count = conemap__texels(map), k;
    uint64_t hash = conemap__hash(CONEMAP__HASH_START, (uint64_t)map->info.width);
    hash = conemap__hash(hash, (uint64_t)map->info.height);
    *highest = 0.0f;
    for (k = 0; k < count; ++k) {
        hash += conemap__height_hash(map->heights[k], k);
        *highest = conemap__max(*highest, map->heights[k]);
    }
    return hash;
}

/* The result of the first job in a pass that is not done well. */
static conemap_result conemap__pass_result(const conemap_map *map, int pass) {
    const unsigned char *slots = conemap__job_slots(map, pass);
    int job;
    for (job = 0; job < map->build.pass_jobs[pass]; ++job)
        if (slots[job] != 1 + (int)CONEMAP_OK)
            return slots[job] == 0 ? CONEMAP_ERROR_ORDER : (conemap_result)(slots[job] - 1);
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_end(conemap_map *map) {
    int pass;
    if (!map) return CONEMAP_ERROR_NULL;
    if (!map->build.job_results) return CONEMAP_ERROR_ORDER;
    for (pass = 0; pass < CONEMAP__PASS_COUNT; ++pass) {
        conemap_result result = conemap__pass_result(map, pass);
        if (result != CONEMAP_OK) {
            conemap_free(map);
            return result;
        }
    }
    map->info.height_hash = conemap__survey_heights(map, &map->highest);
    conemap__release(&map->build.allocator, map->build.scratch, map->build.owns_scratch);
    map->build.scratch = NULL;
    map->build.owns_scratch = 0;
    map->build.job_results = NULL;
    map->build.plane = map->build.cell_slopes = NULL;
    if (!map->build.keeps_search) memset(&map->build.texels, 0, sizeof map->build.texels);
    memset(map->build.falling, 0, sizeof map->build.falling);
    memset(&map->build.desc, 0, sizeof map->build.desc);
    return CONEMAP_OK;
}

/* A pass as a host's parallel_for sees it. */
typedef struct conemap__pass {
    conemap_map *map;
    int pass;
} conemap__pass;

static void conemap__pass_job(void *context, int index) {
    const conemap__pass *pass = (const conemap__pass *)context;
    (void)conemap_run_job(pass->map, pass->pass, index); /* kept in job_results, for conemap_end */
}

CONEMAP__DEF conemap_result conemap_build(const conemap_desc *desc, conemap_map *map) {
    conemap__pass pass;
    int job, count;
    conemap_result result = conemap_begin(desc, map);
    if (result != CONEMAP_OK) return result;
    pass.map = map;
    for (pass.pass = 0; result == CONEMAP_OK && pass.pass < CONEMAP__PASS_COUNT; ++pass.pass) {
        count = map->build.pass_jobs[pass.pass];
        if (desc->parallel_for && count > 1) {
            desc->parallel_for(count, conemap__pass_job, &pass, desc->parallel_user);
            result = conemap__pass_result(map, pass.pass);
        } else {
            for (job = 0; result == CONEMAP_OK && job < count; ++job)
                result = conemap_run_job(map, pass.pass, job);
        }
    }
    return conemap_end(map);
}

/* ---- updates ------------------------------------------------------------------------------------------------- */

#define CONEMAP__NOWHERE (4 * CONEMAP_MAX_SIZE) /* texels: farther than anything */

/* Whole distance, in texels, from the texels first..last of an axis to low..high, or to the images of a wrapping one. A
   sign leaves out what lies wholly on the other side, by more than the cells around two texels. */
static int conemap__axis_distance(int first, int last, int low, int high, int size, conemap_wrap wrap, int sign) {
    int d = CONEMAP__NOWHERE, image, images = wrap == CONEMAP_WRAP;
    for (image = -images; image <= images; ++image) {
        int before = low + image * size - last, after = first - (high + image * size);
        if ((sign > 0 && after > 2) || (sign < 0 && before > 2)) continue;
        d = conemap__mini(d, conemap__maxi(0, conemap__maxi(before, after)));
    }
    return d;
}

/* An edit of rectangle (x, y, width, height), in which nothing was or is higher than `highest`. */
typedef struct conemap__edit {
    const conemap_map *map;
    int x, y, width, height;
    float highest, near2, deflate;
    conemap__sector sector;        /* an octant is treated as its quadrant */
    unsigned char *wanted, *bands; /* marks for each cone; nonzero for each band of rows that has some */
} conemap__edit;


static void conemap__mark_around(const conemap__edit *edit, int i, int j, int reach, unsigned char mark) {
    const conemap_info *info = &edit->map->info;
    unsigned char *wanted = edit->wanted + (size_t)edit->sector.number * conemap__texels(edit->map);
    int x, y;
    for (y = j - reach; y <= j + reach; ++y)
        for (x = i - reach; x <= i + reach; ++x) {
            int row = conemap__texel_index(y, info->height, info->wrap_v);
            edit->bands[edit->sector.number * conemap__bands(info->height) + row / CONEMAP__BAND] = 1;
            wanted[(size_t)row * (size_t)info->width + (size_t)conemap__texel_index(x, info->width, info->wrap_u)] |=
                mark;
        }
}

/* Square of the distance from texels i0..i1, j0..j1 to the rectangle; with the bilinear guarantee, to its cells. Very
   far where the sector does not see it. */
static float conemap__edit_distance2(const conemap__edit *edit, int i0, int i1, int j0, int j1) {
    const conemap_map *map = edit->map;
    int bilinear = conemap__is_bilinear(&map->info);
    int di = conemap__axis_distance(i0, i1, edit->x, edit->x + edit->width - 1, map->info.width, map->info.wrap_u,
                                    edit->sector.su);
    int dj = conemap__axis_distance(j0, j1, edit->y, edit->y + edit->height - 1, map->info.height, map->info.wrap_v,
                                    edit->sector.sv);
    float du = (float)conemap__maxi(0, di - bilinear) * map->build.search_u;
    float dv = (float)conemap__maxi(0, dj - bilinear) * map->build.search_v;
    return di < CONEMAP__NOWHERE && dj < CONEMAP__NOWHERE ? du * du + dv * dv : CONEMAP__FAR;
}

/* Can the edit change cones at this distance, with no apex lower than `lowest`, whose own slopes, and with the bilinear
   guarantee their neighbours', are at least sqrt(least)? Not if nothing as high as the edit's highest, before or after,
   standing that near, is as steep. */
CONEMAP__INLINE int conemap__edit_matters(const conemap__edit *edit, float d2, float lowest, float least) {
    float rise = edit->highest - lowest;
    return d2 < CONEMAP__FAR && rise > 0.0f && !(rise * rise < least * (d2 - edit->deflate));
}

/* The least slope_floor of the 3x3 texels around (i, j), or of the texel alone. */
static float conemap__least_floor(const conemap_map *map, const float *cones, int i, int j, int reach) {
    float least = CONEMAP__FAR;
    int a, b;
    for (b = -reach; b <= reach; ++b)
        for (a = -reach; a <= reach; ++a) {
            size_t row = (size_t)conemap__texel_index(j + b, map->info.height, map->info.wrap_v) *
                (size_t)map->info.width;
            least = conemap__min(least, conemap__slope_floor(
                                            map, cones, row + (size_t)conemap__texel_index(i + a, map->info.width,
                                                map->info.wrap_u)));
        }
    return least;
}

/* Can the edit reach a texel of this block? Where nothing was surveyed, perhaps. */
static int conemap__block_reached(const conemap__edit *edit, int block_u, int block_v) {
    const conemap_map *map = edit->map;
    int bands_u = conemap__bands(map->info.width), bands_v = conemap__bands(map->info.height), a, b;
    int i0 = block_u * CONEMAP__BAND, j0 = block_v * CONEMAP__BAND;
    float least = CONEMAP__FAR, d2;
    if (!map->build.survey) return 1;
    d2 = conemap__edit_distance2(edit, i0, conemap__mini(i0 + CONEMAP__BAND, map->info.width) - 1, j0,
                                 conemap__mini(j0 + CONEMAP__BAND, map->info.height) - 1);
    if (d2 <= edit->near2) return 1;
    for (b = -1; b <= 1; ++b)
        for (a = -1; a <= 1; ++a)
            least = conemap__min(least, conemap__surveyed(map, edit->sector.number,
                                                          conemap__texel_index(block_u + a, bands_u, map->info.wrap_u),
                                                          conemap__texel_index(block_v + b, bands_v,
                                                                               map->info.wrap_v))[1]);
    return conemap__edit_matters(edit, d2, conemap__surveyed(map, edit->sector.number, block_u, block_v)[0], least);
}

/* Marks what the edit can change, STORE, and whose searches can show it, SEARCH: with the bilinear guarantee a search
   serves its 3x3 texels, and what is nearest to the edit is looked at whatever its slope. */
static void conemap__mark(const conemap__edit *edit) {
    const conemap_map *map = edit->map;
    const float *cones = map->cones + (size_t)edit->sector.number * conemap__texels(map);
    int w = map->info.width, h = map->info.height, reach = conemap__is_bilinear(&map->info), block_u, block_v, i, j;
    for (block_v = 0; block_v < conemap__bands(h); ++block_v)
        for (block_u = 0; block_u < conemap__bands(w); ++block_u) {
            if (!conemap__block_reached(edit, block_u, block_v)) continue;
            for (j = block_v * CONEMAP__BAND; j < conemap__mini((block_v + 1) * CONEMAP__BAND, h); ++j)
                for (i = block_u * CONEMAP__BAND; i < conemap__mini((block_u + 1) * CONEMAP__BAND, w); ++i) {
                    float height = map->heights[(size_t)j * (size_t)w + (size_t)i];
                    float d2 = conemap__edit_distance2(edit, i, i, j, j);
                    if (d2 > edit->near2 &&
                        (height >= edit->highest ||
                         !conemap__edit_matters(edit, d2, height, conemap__least_floor(map, cones, i, j, reach))))
                        continue;
                    conemap__mark_around(edit, i, j, reach, CONEMAP__STORE);
                    conemap__mark_around(edit, i, j, 2 * reach, CONEMAP__SEARCH);
                }
        }
}

/* The maxima over cells that have a corner in the edit: on a wrapping axis the last cells are corners of the first
   texel. */
static void conemap__update_cells(conemap_map *map, const conemap__edit *edit) {
    int first_u = conemap__first_cell(map->info.wrap_u), first_v = conemap__first_cell(map->info.wrap_v);
    int x0 = edit->x - 1 + first_u, x1 = edit->x + edit->width - 1 + first_u, last_u = map->cells.width[0] - 1;
    int y0 = edit->y - 1 + first_v, y1 = edit->y + edit->height - 1 + first_v, last_v = map->cells.height[0] - 1, a, b;
    for (b = 0; b < 2; ++b)
        for (a = 0; a < 2; ++a) {
            if ((a && (x0 >= 0 || map->info.wrap_u != CONEMAP_WRAP)) ||
                (b && (y0 >= 0 || map->info.wrap_v != CONEMAP_WRAP)))
                continue;
            conemap__pyramid_region(map, &map->cells, a ? last_u : conemap__maxi(x0, 0),
                                    a ? last_u : conemap__mini(x1, last_u), b ? last_v : conemap__maxi(y0, 0),
                                    b ? last_v : conemap__mini(y1, last_v));
        }
}

static float conemap__rectangle_max(const conemap_map *map, int x, int y, int width, int height, float highest) {
    int i, j;
    for (j = y; j < y + height; ++j)
        for (i = x; i < x + width; ++i) highest = conemap__max(highest, conemap__height(map, i, j));
    return highest;
}

/* Puts the edit's new heights into the map; returns by how much the hash changes. */
static uint64_t conemap__replace_heights(conemap_map *map, const conemap__edit *edit, const unsigned char *heights) {
    uint64_t change = 0;
    int i, j;
    for (j = edit->y; j < edit->y + edit->height; ++j)
        for (i = edit->x; i < edit->x + edit->width; ++i, heights += sizeof(float)) {
            size_t at = (size_t)j * (size_t)map->info.width + (size_t)i;
            change -= conemap__height_hash(map->heights[at], at);
            memcpy(&map->build.heights[at], heights, sizeof(float));
            change += conemap__height_hash(map->heights[at], at);
        }
    return change;
}

CONEMAP__DEF conemap_result conemap_update(conemap_map *map, const conemap_desc *desc, int x, int y, int width,
                                           int height) {
    conemap_map work;
    conemap_desc settings;
    conemap_result result;
    conemap_heights rectangle;
    conemap__edit edit;
    size_t memory_size, scratch_size, marks, size;
    void *buffer = NULL; /* marks, and the rectangle's new heights until all of them are known to be good */
    unsigned char *heights = NULL;
    float was_highest;
    int pass, job, partly, k;
    if (!map || !map->heights || !desc) return CONEMAP_ERROR_NULL;
    settings = *desc;
    result = conemap__resolve(&settings);
    if (result != CONEMAP_OK) return result;
    settings.memory = map->build.memory;
    settings.memory_size = map->memory_size;
    settings.keep_pyramid = map->cells.levels > 0;
    settings.keep_search = map->build.keeps_search;
    settings.scratch = NULL; /* an update needs more than a build, so it takes its own */
    settings.progress = NULL;
    memset(&work, 0, sizeof work);
    work.build.updating = 1;
    result = conemap__plan(&work, &settings, &memory_size, &scratch_size);
    if (result != CONEMAP_OK) return result;
    if (!conemap__same_settings(&work.info, &map->info)) return CONEMAP_ERROR_PARAMETER;
    if (x < 0 || y < 0 || width < 1 || height < 1 || x >= map->info.width || y >= map->info.height ||
        width > map->info.width - x || height > map->info.height - y)
        return CONEMAP_ERROR_SIZE;
    marks = conemap__texels(map) * (size_t)conemap__planes(&map->info);
    size = marks + (size_t)work.build.pass_jobs[CONEMAP__PASS_CONES]; /* with a byte for each band */
    work.build.allocator = settings.allocator;
    result = conemap__allocate(&work, memory_size, scratch_size);
    if (result == CONEMAP_OK)
        result = conemap__take(&settings.allocator, NULL, 0, size + (size_t)width * (size_t)height * sizeof(float),
                               &buffer, &k);
    memset(&edit, 0, sizeof edit);
    if (result == CONEMAP_OK) {
        edit.map = &work;
        edit.x = x;
        edit.y = y;
        edit.width = width;
        edit.height = height;
        edit.wanted = (unsigned char *)buffer;
        edit.bands = edit.wanted + marks;
        heights = edit.wanted + size;
        rectangle = settings.heights;
        rectangle.pixels = (const unsigned char *)rectangle.pixels + (ptrdiff_t)y * rectangle.row_stride +
                           (ptrdiff_t)x * rectangle.pixel_stride;
        rectangle.width = width;
        for (k = 0; k < height && result == CONEMAP_OK; ++k) { /* by way of the plane: the buffer's end is not
                                                                  aligned */
            if (!conemap__kernels_of(work.isa)->decode_row(&work.info, &rectangle, k, work.build.plane))
                result = CONEMAP_ERROR_HEIGHT;
            memcpy(heights + (size_t)k * (size_t)width * sizeof(float), work.build.plane,
                   (size_t)width * sizeof(float));
        }
    }
    if (result == CONEMAP_OK) {
        /* Everything is known and at hand: from here on nothing can fail. */
        was_highest = conemap__rectangle_max(map, x, y, width, height, 0.0f);
        map->info.height_hash += conemap__replace_heights(&work, &edit, heights);
        edit.highest = conemap__rectangle_max(map, x, y, width, height, was_highest);
        partly = conemap__updates_partly(&settings, &work.info);
        memset(edit.wanted, partly ? 0 : CONEMAP__SEARCH | CONEMAP__STORE, size);
        if (conemap__is_bilinear(&work.info)) {
            edit.deflate = 0.25f * (work.build.search_u * work.build.search_u + work.build.search_v *
                                    work.build.search_v);
            edit.near2 = edit.deflate / CONEMAP__TOLERANCE;
        }
        for (k = 0; partly && k < conemap__planes(&map->info); ++k) {
            edit.sector = conemap__make_sector(&map->info, k);
            conemap__mark(&edit);
        }
        work.build.wanted = edit.wanted;
        if (work.build.keeps_search)
            conemap__maxima_region(&work, y, y + height - 1);
        else
            for (pass = CONEMAP__PASS_STRIPS; pass <= CONEMAP__PASS_TOP; ++pass)
                for (job = 0; job < work.build.pass_jobs[pass]; ++job) (void)conemap_run_job(&work, pass, job);
        for (pass = CONEMAP__PASS_CONES; pass <= CONEMAP__PASS_STORE; ++pass)
            for (job = 0; job < work.build.pass_jobs[pass]; ++job)
                if (edit.bands[job]) (void)conemap_run_job(&work, pass, job);
        if (map->cells.levels > 0) conemap__update_cells(map, &edit);
        if (edit.highest >= map->highest && work.build.keeps_search)
            map->highest = conemap__maxima(&work.build.texels, work.build.texels.levels - 1, 0)[0];
        else if (edit.highest >= map->highest)
            map->highest = conemap__rectangle_max(map, 0, 0, map->info.width, map->info.height, 0.0f);
    }
    if (buffer) conemap__release(&settings.allocator, buffer, 1);
    conemap__release(&work.build.allocator, work.build.scratch, work.build.owns_scratch);
    return result;
}

/* ======================================================================================================
   F I L E S

   Baked bytes: "CONEMAP" and a zero byte, CONEMAP__FILE_WORDS little-endian words (the info, hashes of the heights
   and of the texels, and last the hash of all words before it), then the textures, little-endian, rows touching.
   ====================================================================================================== */

#define CONEMAP__FILE_WORDS 23
#define CONEMAP__FILE_HEADER (8u + 4u * CONEMAP__FILE_WORDS)

static const char conemap__file_magic[8] = {'C', 'O', 'N', 'E', 'M', 'A', 'P', 0};

static int conemap__texture_count(const conemap_texture *texture) {
    return texture->sectors <= 1 ? 1 : texture->sectors / 4 + (texture->layout != CONEMAP_CONE_ONLY);
}

/* The channels of texture `index`. */
static int conemap__channels(const conemap_texture *texture, int index) {
    if (texture->sectors > 1) return index < texture->sectors / 4 ? 4 : 1;
    return texture->layout == CONEMAP_CONE_ONLY ? 1 : texture->layout == CONEMAP_DUMMER ? 4 : 2;
}

static size_t conemap__row_size(const conemap_info *info, int index) {
    return (size_t)info->width * (size_t)conemap__channels(&info->texture, index) *
           conemap__format_size(info->texture.format);
}

/* The bytes of a texel in all textures together. */
static size_t conemap__texel_size(const conemap_info *info) {
    size_t size = 0;
    int index;
    for (index = 0; index < conemap__texture_count(&info->texture); ++index)
        size += (size_t)conemap__channels(&info->texture, index) * conemap__format_size(info->texture.format);
    return size;
}

CONEMAP__DEF int conemap_texture_count(const conemap_map *map) {
    return map && map->heights ? conemap__texture_count(&map->info.texture) : 0;
}

CONEMAP__DEF size_t conemap_row_size_at(const conemap_map *map, int index) {
    return index >= 0 && index < conemap_texture_count(map) ? conemap__row_size(&map->info, index) : 0;
}

CONEMAP__DEF size_t conemap_row_size(const conemap_map *map) { return conemap_row_size_at(map, 0); }

CONEMAP__DEF size_t conemap_texture_size_at(const conemap_map *map, int index, size_t row_pitch) {
    size_t row = conemap_row_size_at(map, index);
    if (row_pitch == 0) row_pitch = row;
    if (row == 0 || row_pitch < row || row_pitch > SIZE_MAX / (size_t)map->info.height) return 0;
    return row_pitch * (size_t)map->info.height;
}

CONEMAP__DEF size_t conemap_texture_size(const conemap_map *map, size_t row_pitch) {
    return conemap_texture_size_at(map, 0, row_pitch);
}

/* Height difference per texel along an axis: central, one-sided at a border that does not wrap. [Dum06] halves
   the one-sided difference as well, which flattens the normals along borders. */
static float conemap__difference(const conemap_map *map, int i, int j, int along_v) {
    int size = along_v ? map->info.height : map->info.width, at = along_v ? j : i;
    conemap_wrap wrap = along_v ? map->info.wrap_v : map->info.wrap_u;
    int before = conemap__texel_index(at - 1, size, wrap), after = conemap__texel_index(at + 1, size, wrap);
    float difference = along_v ? conemap__height(map, i, after) - conemap__height(map, i, before)
                               : conemap__height(map, after, j) - conemap__height(map, before, j);
    int steps = wrap == CONEMAP_WRAP ? 2 : after - before;
    return steps > 1 ? 0.5f * difference : difference;
}

static void conemap__put_word(unsigned char *bytes, uint32_t word) {
    int k;
    for (k = 0; k < 4; ++k) bytes[k] = (unsigned char)(word >> (8 * k) & 0xffu);
}

static uint32_t conemap__get_word(const unsigned char *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

/* Turns codes in native byte order into little-endian ones, or back; does nothing on little-endian machines. */
static void conemap__swap_row(unsigned char *bytes, size_t size, size_t code_size) {
    const uint16_t probe = 1;
    size_t k, b;
    if (*(const unsigned char *)&probe == 1) return;
    for (k = 0; k < size; k += code_size)
        for (b = 0; b < code_size / 2; ++b) {
            unsigned char byte = bytes[k + b];
            bytes[k + b] = bytes[k + code_size - 1 - b];
            bytes[k + code_size - 1 - b] = byte;
        }
}

static void conemap__write_row(const conemap_map *map, int index, int y, unsigned char *bytes) {
    const conemap_texture *texture = &map->info.texture;
    size_t step = conemap__format_size(texture->format), texels = conemap__texels(map);
    int x, c, channels = conemap__channels(texture, index);
    for (x = 0; x < map->info.width; ++x) {
        size_t at = (size_t)y * (size_t)map->info.width + (size_t)x;
        float values[4];
        c = 0;
        if (texture->sectors > 1 && channels == 4) {
            for (c = 0; c < 4; ++c) values[c] = map->cones[(size_t)(4 * index + c) * texels + at];
        } else {
            if (texture->layout != CONEMAP_CONE_ONLY) values[c++] = map->heights[at];
            if (texture->sectors <= 1) values[c++] = map->cones[at];
        }
        if (texture->layout == CONEMAP_DUMMER) {
            float dv = conemap__difference(map, x, y, 1);
            values[c++] = 0.5f + conemap__difference(map, x, y, 0);
            values[c++] = texture->flip_dv ? 0.5f - dv : 0.5f + dv;
        }
        for (c = 0; c < channels; ++c, bytes += step)
            conemap__write_code(texture->format, bytes, conemap__code_near(texture->format, values[c]));
    }
}

CONEMAP__DEF conemap_result conemap_write_texture_at(const conemap_map *map, int index, void *pixels, size_t size,
                                                     size_t row_pitch) {
    size_t row, needed;
    int y;
    if (!map || !map->heights || !pixels) return CONEMAP_ERROR_NULL;
    if (index < 0 || index >= conemap_texture_count(map)) return CONEMAP_ERROR_PARAMETER;
    row = conemap_row_size_at(map, index);
    if (row_pitch == 0) row_pitch = row;
    if (row_pitch < row) return CONEMAP_ERROR_STRIDE;
    needed = conemap_texture_size_at(map, index, row_pitch);
    if (needed == 0) return CONEMAP_ERROR_OVERFLOW;
    needed -= row_pitch - row; /* the last row's padding is never written */
    if (size < needed) return CONEMAP_ERROR_BUFFER;
    for (y = 0; y < map->info.height; ++y)
        conemap__write_row(map, index, y, (unsigned char *)pixels + (size_t)y * row_pitch);
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_write_texture(const conemap_map *map, void *pixels, size_t size,
                                                  size_t row_pitch) {
    return conemap_write_texture_at(map, 0, pixels, size, row_pitch);
}

static uint64_t conemap__hash_bytes(const unsigned char *bytes, size_t size) {
    uint64_t hash = CONEMAP__HASH_START;
    size_t k;
    for (k = 0; k + 4 <= size; k += 4) hash = conemap__hash(hash, conemap__get_word(bytes + k));
    for (; k < size; ++k) hash = conemap__hash(hash, bytes[k]);
    return hash;
}

CONEMAP__DEF size_t conemap_save_size(const conemap_map *map) {
    size_t texels = map && map->heights ? conemap__texels(map) : 0, size;
    if (texels == 0) return 0;
    size = conemap__texel_size(&map->info);
    return texels > (SIZE_MAX - CONEMAP__FILE_HEADER) / size ? 0 : texels * size + CONEMAP__FILE_HEADER;
}

CONEMAP__DEF conemap_result conemap_save(const conemap_map *map, void *bytes, size_t size) {
    unsigned char *out = (unsigned char *)bytes, *texels;
    uint32_t words[CONEMAP__FILE_WORDS];
    const conemap_info *info;
    uint64_t data_hash;
    size_t row;
    int k, index;
    if (!map || !map->heights || !bytes) return CONEMAP_ERROR_NULL;
    if (conemap_save_size(map) == 0) return CONEMAP_ERROR_OVERFLOW;
    if (size < conemap_save_size(map)) return CONEMAP_ERROR_BUFFER;
    info = &map->info;
    texels = out + CONEMAP__FILE_HEADER;
    for (index = 0; index < conemap_texture_count(map); ++index) {
        row = conemap_row_size_at(map, index);
        for (k = 0; k < info->height; ++k, texels += row) {
            conemap__write_row(map, index, k, texels);
            conemap__swap_row(texels, row, conemap__format_size(info->texture.format));
        }
    }
    data_hash = conemap__hash_bytes(out + CONEMAP__FILE_HEADER, conemap__texel_size(info) * conemap__texels(map));
    words[0] = CONEMAP_VERSION;
    words[1] = CONEMAP__FILE_HEADER;
    words[2] = (uint32_t)info->width;
    words[3] = (uint32_t)info->height;
    words[4] = (uint32_t)info->wrap_u;
    words[5] = (uint32_t)info->wrap_v;
    words[6] = conemap__bits(info->aspect);
    words[7] = conemap__bits(info->max_tan);
    words[8] = (uint32_t)info->texture.format;
    words[9] = (uint32_t)info->texture.encoding;
    words[10] = (uint32_t)info->texture.layout;
    words[11] = info->texture.flip_dv != 0;
    words[12] = (uint32_t)info->generator;
    words[13] = (uint32_t)info->guarantee;
    words[14] = info->min3x3 != 0;
    words[15] = info->texture.per_cell != 0;
    words[16] = conemap__bits(info->slack);
    words[17] = (uint32_t)conemap__planes(info);
    words[18] = (uint32_t)(info->height_hash & 0xffffffffu);
    words[19] = (uint32_t)(info->height_hash >> 32);
    words[20] = (uint32_t)(data_hash & 0xffffffffu);
    words[21] = (uint32_t)(data_hash >> 32);
    memcpy(out, conemap__file_magic, 8);
    for (k = 0; k < CONEMAP__FILE_WORDS - 1; ++k) conemap__put_word(out + 8 + 4 * k, words[k]);
    conemap__put_word(out + 8 + 4 * k,
                      (uint32_t)(conemap__hash_bytes(out, CONEMAP__FILE_HEADER - 4u) & 0xffffffffu));
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_load_info(const void *bytes, size_t size, conemap_info *info) {
    const unsigned char *in = (const unsigned char *)bytes;
    uint32_t words[CONEMAP__FILE_WORDS];
    conemap_info read;
    int k;
    if (!bytes || !info) return CONEMAP_ERROR_NULL;
    for (k = 0; k < 8; ++k) {
        if (size <= (size_t)k) return k == 0 ? CONEMAP_ERROR_FILE_FORMAT : CONEMAP_ERROR_FILE_TRUNCATED;
        if (in[k] != (unsigned char)conemap__file_magic[k]) return CONEMAP_ERROR_FILE_FORMAT;
    }
    if (size < 12u) return CONEMAP_ERROR_FILE_TRUNCATED;
    if (conemap__get_word(in + 8) != CONEMAP_VERSION) return CONEMAP_ERROR_FILE_VERSION;
    if (size < CONEMAP__FILE_HEADER) return CONEMAP_ERROR_FILE_TRUNCATED;
    for (k = 0; k < CONEMAP__FILE_WORDS; ++k) words[k] = conemap__get_word(in + 8 + 4 * k);
    if (words[1] != CONEMAP__FILE_HEADER ||
        words[k - 1] != (uint32_t)(conemap__hash_bytes(in, CONEMAP__FILE_HEADER - 4u) & 0xffffffffu))
        return CONEMAP_ERROR_FILE_CORRUPT;
    /* The checksum held, but whoever wrote it may have been wrong: nothing is used unchecked. */
    if (words[2] < 1 || words[3] < 1 || words[2] > CONEMAP_MAX_SIZE || words[3] > CONEMAP_MAX_SIZE ||
        words[4] >= CONEMAP_WRAP_COUNT || words[5] >= CONEMAP_WRAP_COUNT || words[8] >= CONEMAP_FORMAT_COUNT ||
        words[9] >= CONEMAP_ENCODING_COUNT || words[10] >= CONEMAP_LAYOUT_COUNT || words[11] > 1 ||
        words[12] < 1 || words[12] >= CONEMAP_GENERATOR_COUNT || words[13] < 1 ||
        words[13] >= CONEMAP_GUARANTEE_COUNT ||
        words[14] > 1 || words[15] > 1 || words[17] > 8)
        return CONEMAP_ERROR_FILE_CORRUPT;
    memset(&read, 0, sizeof read);
    read.width = (int)words[2];
    read.height = (int)words[3];
    read.wrap_u = (conemap_wrap)words[4];
    read.wrap_v = (conemap_wrap)words[5];
    read.aspect = conemap__from_bits(words[6]);
    read.max_tan = conemap__from_bits(words[7]);
    read.texture.format = (conemap_format)words[8];
    read.texture.encoding = (conemap_encoding)words[9];
    read.texture.layout = (conemap_layout)words[10];
    read.texture.flip_dv = (int)words[11];
    read.texture.per_cell = (int)words[15];
    read.generator = (conemap_generator)words[12];
    read.guarantee = (conemap_guarantee)words[13];
    read.min3x3 = (int)words[14];
    read.slack = conemap__from_bits(words[16]);
    read.texture.sectors = words[17] > 1 ? (int)words[17] : 0;
    read.height_hash = (uint64_t)words[19] << 32 | words[18];
    if (words[17] < 1 || conemap__check_texture(&read.texture) != CONEMAP_OK ||
        !conemap__in_range(read.aspect, 1.0f / 32768.0f, 32768.0f) ||
        !conemap__in_range(read.max_tan, 1.0f / 65536.0f, CONEMAP_TAN_LIMIT) ||
        !conemap__in_range(read.slack, 0.0f, 16.0f) ||
        (read.width == 1 && read.wrap_u == CONEMAP_NOTHING) || (read.height == 1 && read.wrap_v == CONEMAP_NOTHING))
        return CONEMAP_ERROR_FILE_CORRUPT;
    if ((size - CONEMAP__FILE_HEADER) / ((size_t)read.width * conemap__texel_size(&read)) < (size_t)read.height)
        return CONEMAP_ERROR_FILE_TRUNCATED;
    *info = read;
    return CONEMAP_OK;
}

/* Reads the texels of baked bytes into the map's planes; heights only where the bytes hold them. */
static conemap_result conemap__load_texels(conemap_map *map, const unsigned char *bytes, int heights_too) {
    const conemap_texture *texture = &map->info.texture;
    size_t step = conemap__format_size(texture->format), texels = conemap__texels(map), at, b;
    int index, c, cone_channel = texture->layout == CONEMAP_CONE_ONLY ? 0 : 1;
    for (index = 0; index < conemap__texture_count(texture); ++index) {
        int channels = conemap__channels(texture, index), of_cones = texture->sectors <= 1 || channels == 4;
        for (at = 0; at < texels; ++at)
            for (c = 0; c < channels; ++c, bytes += step) {
                uint32_t code = 0;
                float value;
                for (b = 0; b < step; ++b) code |= (uint32_t)bytes[b] << (8 * b);
                value = conemap__value(texture->format, code);
                if (of_cones && (texture->sectors > 1 || c == cone_channel)) {
                    if (!conemap__in_range(value, 0.0f, CONEMAP_TAN_LIMIT)) return CONEMAP_ERROR_FILE_CORRUPT;
                    map->build.cones[(texture->sectors > 1 ? (size_t)(4 * index + c) * texels : 0) + at] = value;
                } else if (c == 0 && heights_too) {
                    if (!conemap__in_range(value, 0.0f, 1.0f)) return CONEMAP_ERROR_FILE_CORRUPT;
                    map->build.heights[at] = value;
                }
            }
    }
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_load(const void *bytes, size_t size, const conemap_desc *desc,
                                         conemap_map *map) {
    const unsigned char *texels;
    conemap_info info;
    conemap_desc load;
    conemap_result result;
    size_t memory_size, scratch_size;
    int given, job;
    if (!map) return CONEMAP_ERROR_NULL;
    memset(map, 0, sizeof *map);
    result = conemap_load_info(bytes, size, &info);
    if (result != CONEMAP_OK) return result;
    texels = (const unsigned char *)bytes + CONEMAP__FILE_HEADER;
    memset(&load, 0, sizeof load);
    if (desc) load = *desc;
    given = load.heights.pixels != NULL;
    if (!given && info.texture.layout == CONEMAP_CONE_ONLY) return CONEMAP_ERROR_NO_HEIGHTS;
    if (given) {
        result = conemap__resolve_heights(&load.heights);
        if (result != CONEMAP_OK) return result;
        if (load.heights.width != info.width || load.heights.height != info.height) return CONEMAP_ERROR_HASH;
    }
    if ((load.allocator.allocate == NULL) != (load.allocator.release == NULL)) return CONEMAP_ERROR_NULL;
    if (!CONEMAP__KNOWN(load.isa, CONEMAP_ISA_COUNT)) return CONEMAP_ERROR_ENUM;
    if (!conemap__resolve_isa(&load.isa)) return CONEMAP_ERROR_UNSUPPORTED;
    if (conemap__hash_bytes(texels, (size_t)info.width * (size_t)info.height * conemap__texel_size(&info)) !=
        ((uint64_t)conemap__get_word(texels - 8) << 32 | conemap__get_word(texels - 12)))
        return CONEMAP_ERROR_FILE_CORRUPT;
    load.heights.width = info.width;
    load.heights.height = info.height;
    load.wrap_u = info.wrap_u;
    load.wrap_v = info.wrap_v;
    load.aspect = info.aspect;
    load.max_tan = info.max_tan;
    load.texture = info.texture;
    load.generator = info.generator;
    load.guarantee = info.guarantee;
    load.slack = info.slack;
    load.min3x3 = info.min3x3;
    result = conemap__plan(map, &load, &memory_size, &scratch_size);
    if (result == CONEMAP_OK) result = conemap__allocate(map, memory_size, 0);
    map->info = info;
    if (result == CONEMAP_OK && given) result = conemap__decode_rows(map, &load.heights, 0, info.height);
    if (result == CONEMAP_OK) result = conemap__load_texels(map, texels, !given);
    if (result == CONEMAP_OK && conemap__survey_heights(map, &map->highest) != info.height_hash)
        result = given ? CONEMAP_ERROR_HASH : CONEMAP_ERROR_FILE_CORRUPT;
    if (result != CONEMAP_OK) {
        conemap_free(map);
        return result;
    }
    if (map->cells.levels > 0)
        conemap__pyramid_region(map, &map->cells, 0, map->cells.width[0] - 1, 0, map->cells.height[0] - 1);
    if (map->build.keeps_search) {
        conemap__maxima_region(map, 0, info.height - 1);
        for (job = 0; job < conemap__planes(&info) * conemap__bands(info.height); ++job)
            conemap__survey_band(map, job / conemap__bands(info.height), job % conemap__bands(info.height));
    } else {
        memset(&map->build.texels, 0, sizeof map->build.texels);
    }
    memset(map->build.falling, 0, sizeof map->build.falling);
    memset(&map->build.desc, 0, sizeof map->build.desc);
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_get_format_numbers_at(const conemap_texture *texture, int index,
                                                          conemap_format_numbers *numbers) {
    /* [format][1, 2 or 4 channels] */
    static const unsigned dxgi[CONEMAP_FORMAT_COUNT][3] = {{41, 16, 2}, {54, 34, 10}, {56, 35, 11}, {61, 49, 28}};
    static const unsigned vulkan[CONEMAP_FORMAT_COUNT][3] = {
        {100, 103, 109}, {76, 83, 97}, {70, 77, 91}, {9, 16, 37}};
    static const unsigned gl_internal[CONEMAP_FORMAT_COUNT][3] = {{0x822e, 0x8230, 0x8814},
                                                                  {0x822d, 0x822f, 0x881a},
                                                                  {0x822a, 0x822c, 0x805b},
                                                                  {0x8229, 0x822b, 0x8058}};
    static const unsigned gl_format[3] = {0x1903, 0x8227, 0x1908};                      /* RED, RG, RGBA */
    static const unsigned gl_type[CONEMAP_FORMAT_COUNT] = {0x1406, 0x140b, 0x1403, 0x1401};
    conemap_result result;
    int format, column;
    if (!texture || !numbers) return CONEMAP_ERROR_NULL;
    result = conemap__check_texture(texture);
    if (result != CONEMAP_OK) return result;
    if (index < 0 || index >= conemap__texture_count(texture)) return CONEMAP_ERROR_PARAMETER;
    format = (int)texture->format;
    numbers->channels = conemap__channels(texture, index);
    column = numbers->channels == 4 ? 2 : numbers->channels - 1;
    numbers->bytes = numbers->channels * (int)conemap__format_size(texture->format);
    numbers->dxgi = dxgi[format][column];
    numbers->vulkan = vulkan[format][column];
    numbers->gl_internal = gl_internal[format][column];
    numbers->gl_format = gl_format[column];
    numbers->gl_type = gl_type[format];
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_get_format_numbers(const conemap_texture *texture,
                                                       conemap_format_numbers *numbers) {
    return conemap_get_format_numbers_at(texture, 0, numbers);
}

/* ======================================================================================================
   S A M P L E R S
   ====================================================================================================== */

/* Height and cone at (x, y) of 0..1 x 0..1 in a cell, as a shader's texture unit would mix them. */
typedef struct conemap__mix {
    float height, tangent;
} conemap__mix;

CONEMAP__INLINE conemap__mix conemap__sample_cell(const conemap_map *map, const float *cones, conemap__quad quad,
                                                  float x, float y) {
    conemap__mix mix;
    float cone = map->info.texture.per_cell ? cones[quad.at00] : conemap__bilinear(conemap__gather(cones, quad), x, y);
    mix.height = conemap__bilinear(conemap__gather(map->heights, quad), x, y);
    mix.tangent = conemap__decode_tan(&map->info, mix.height, cone);
    return mix;
}

/* The same with the narrowest cone over all sectors. */
CONEMAP__INLINE conemap__mix conemap__sample_sectors(const conemap_map *map, conemap__quad quad, float x, float y) {
    conemap__mix mix = conemap__sample_cell(map, map->cones, quad, x, y);
    int k;
    for (k = 1; k < conemap__planes(&map->info); ++k) {
        const float *cones = map->cones + (size_t)k * conemap__texels(map);
        mix.tangent = conemap__min(mix.tangent, conemap__sample_cell(map, cones, quad, x, y).tangent);
    }
    return mix;
}

/* Turns a coordinate into a cell and a place in it; 0 where the surface does not reach. */
static int conemap__locate(float u, int size, conemap_wrap wrap, int *cell, float *place) {
    float x;
    if (!conemap__finite(u)) return 0;
    if (wrap == CONEMAP_WRAP)
        u = (float)conemap__fraction((double)u);
    else if (u < 0.0f || u > 1.0f)
        return 0;
    x = u * (float)size - 0.5f;
    if (wrap == CONEMAP_NOTHING && (x < 0.0f || x > (float)(size - 1))) return 0;
    *cell = conemap__floor(x);
    if (wrap == CONEMAP_NOTHING) *cell = conemap__mini(*cell, size - 2);
    *place = x - (float)*cell;
    return 1;
}

CONEMAP__DEF conemap_result conemap_sample_at(const conemap_map *map, float u, float v, conemap_sample *sample) {
    conemap__quad quad;
    conemap__corners c;
    conemap__mix mix;
    float x, y, dx, dy, length;
    int i, j;
    if (!map || !map->heights || !sample) return CONEMAP_ERROR_NULL;
    if (!conemap__locate(u, map->info.width, map->info.wrap_u, &i, &x) ||
        !conemap__locate(v, map->info.height, map->info.wrap_v, &j, &y))
        return CONEMAP_ERROR_POSITION;
    quad = conemap__cell_quad(map, i, j);
    c = conemap__gather(map->heights, quad);
    mix = conemap__sample_sectors(map, quad, x, y);
    dx = (c.h10 - c.h00) + ((c.h11 - c.h01) - (c.h10 - c.h00)) * y;
    dy = (c.h01 - c.h00) + ((c.h11 - c.h10) - (c.h01 - c.h00)) * x;
    sample->height = mix.height;
    sample->tan = mix.tangent;
    sample->dhdu = dx * (float)map->info.width;
    sample->dhdv = dy * (float)map->info.height;
    length = sqrtf(sample->dhdu * sample->dhdu + sample->dhdv * sample->dhdv + 1.0f);
    sample->normal[0] = -sample->dhdu / length;
    sample->normal[1] = -sample->dhdv / length;
    sample->normal[2] = 1.0f / length;
    return CONEMAP_OK;
}

/* ======================================================================================================
   V E R I F I C A T I O N

   To show: (h(q) - h(p) - d) t(p) <= |q - p| for all p in a cell and all q on the surface, d = 2^-20.

   Every cell of apices is held against blocks of the surface, and cell against cell; there the larger of two
   rectangles R (of p) and Q (of q) is halved until one of these settles the pair. Halves of bilinear patches
   are bilinear patches; i and j run over the corners, w_i w_j are the bilinear weights of p and q, and E and Cov
   are over these weights.
   (a) (max h(Q) - min h(R) - d) max t(R) <= the least distance.
   (b) t_i (h_j - h_i - d) + C <= sqrt(D_ij^2 - V) for all 16 corner pairs, C = range of t(R) * range of h(R) / 4,
       V = the sum of the squared sides of R and Q / 4. For E t_i (h_j - h_i - d) = T (h(q) - h(p) - d) - Cov(t, h)
       with T = E t_i, Cov <= C, and E sqrt(D_ij^2 - V) <= sqrt(E D_ij^2 - V) <= |q - p|, since the square root is
       concave and E D_ij^2 exceeds |q - p|^2 by the variances, V at most. Tight to second order.
   (c) max t(R) times the steepest ascent towards Q in all cells that R and Q span <= 1, with d for room: needed
       where cells touch, and on even slopes.
   A corner pair that breaks the claim is a witness.

   The tangents are those of the encoding. Each has its maximum over a rectangle at a corner: a bilinear tangent,
   the square of one, and a quotient of two bilinear functions, which is monotone along each axis.
   (b) takes T for t(p). LINEAR: they are the same. SQRT: t(p) <= T, the mean of squares. RADIUS below max_tan:
   r(p) = E t_i (1 - h_i) makes t(p) = T - Cov(t, h) / (1 - h(p)), so the left side becomes E t_i (h_j - h_i - d) +
   Cov(t, h) (1 - (h(q) - h(p) - d) / (1 - h(p))), and that last factor is in 0..1. Where max_tan caps a corner, the
   greatest t serves as all four.

   Sectors: a pair whose difference box misses the sector is skipped, and halving goes on to the sector's border. A
   quadrant's border runs through pairs that span the same interval of an axis. Of these only one half, a triangle of
   (p_x, q_x), is in the sector: (b) holds with weights on its three corners, which leave out the fourth, outside. The
   difference then has a variance of one squared side / 4, but p and q are no longer independent, and C gets
   Cov(t, h(q)) as well: range of t(R) * range of h(Q) / 4.

   Clamped borders: the outer half cells need no looking at. An apex or a surface point there has the height and
   the cone of its projection onto the rectangle of centres, and projecting both shortens |q - p|. So does an
   axis of one texel, whose cells have no length. Wrapping: of all images of q the nearest decides.

   Rounding: coordinates are dyadic and exact; all else is off by some 1e-15 of itself. Proofs get 2^-40 less than
   d, and witnesses need 2^-40 more.
   ====================================================================================================== */

#define CONEMAP__VERIFY_DEPTH 64       /* halvings of a pair of cells, four sides together */
#define CONEMAP__VERIFY_WORK (1 << 19) /* pairs of rectangles looked at in one pass over a cell */
#define CONEMAP__VERIFY_DEEPER (1 << 13) /* and once a witness is found, for a deeper one */
#define CONEMAP__VERIFY_CREDIT (1 << 28) /* pairs spent in vain, over all cells, from which on passes are cut to a
                                            32nd */
#define CONEMAP__VERIFY_APEX (1.0 / 1048576.0)
#define CONEMAP__VERIFY_GRAIN (1.0 / 1099511627776.0)

/* A rectangle within a cell. Corner k stands at (x + (k & 1) sx, y + (k >> 1) sy), in texels. */
typedef struct conemap__patch {
    double x, y, sx, sy;
    double h[4];
    double stored[4], t[4]; /* of apices: the encoded cones and their tangents */
    int i, j;               /* the cell; of another period beside a wrapping border */
} conemap__patch;

typedef struct conemap__proof {
    const conemap_map *map;
    const conemap_info *info; /* the caller's: the map's own has NOTHING for CLAMP */
    conemap__sector sector;
    conemap_report *report;
    double a, b;            /* a texel's size; 0 along an axis of one texel */
    double slack;           /* how far the surface may rise above a cone: once the cell has a witness, only a
                               deeper one is of interest */
    int depth, work;        /* halvings allowed; pairs that may still be looked at */
    int credit;             /* pairs that may still be spent in vain */
    int found, open;        /* a witness; a pair that nothing settled */
} conemap__proof;

CONEMAP__INLINE double conemap__mind(double a, double b) { return a < b ? a : b; }
CONEMAP__INLINE double conemap__maxd(double a, double b) { return a > b ? a : b; }

CONEMAP__INLINE double conemap__least4(const double *x) {
    return conemap__mind(conemap__mind(x[0], x[1]), conemap__mind(x[2], x[3]));
}

CONEMAP__INLINE double conemap__most4(const double *x) {
    return conemap__maxd(conemap__maxd(x[0], x[1]), conemap__maxd(x[2], x[3]));
}

/* conemap__decode_tan without its rounding. Where the surface touches the top of the box RADIUS has no limit but
   max_tan, unless the radius is 0: then the neighbours bound it. */
CONEMAP__INLINE double conemap__exact_tan(const conemap_info *info, double height, double stored) {
    double top = 1.0 - height;
    switch (info->texture.encoding) {
    case CONEMAP_SQRT: return stored * stored;
    case CONEMAP_RADIUS:
        return stored <= 0.0 ? 0.0 : stored < (double)info->max_tan * top ? stored / top : (double)info->max_tan;
    default: return stored;
    }
}

/* Cell (i, j); with cones if `apices`. */
static void conemap__whole_patch(const conemap__proof *proof, int i, int j, int apices, conemap__patch *patch) {
    const conemap_map *map = proof->map;
    conemap__quad quad = conemap__cell_quad(map, i, j);
    conemap__corners c = conemap__gather(map->heights, quad);
    int k;
    patch->i = i;
    patch->j = j;
    patch->x = (double)i;
    patch->y = (double)j;
    patch->sx = map->info.width > 1 ? 1.0 : 0.0;
    patch->sy = map->info.height > 1 ? 1.0 : 0.0;
    patch->h[0] = (double)c.h00;
    patch->h[1] = (double)c.h10;
    patch->h[2] = (double)c.h01;
    patch->h[3] = (double)c.h11;
    if (!apices) return;
    if (map->info.texture.per_cell) quad.at10 = quad.at01 = quad.at11 = quad.at00;
    c = conemap__gather(map->cones, quad);
    patch->stored[0] = (double)c.h00;
    patch->stored[1] = (double)c.h10;
    patch->stored[2] = (double)c.h01;
    patch->stored[3] = (double)c.h11;
    for (k = 0; k < 4; ++k) patch->t[k] = conemap__exact_tan(&map->info, patch->h[k], patch->stored[k]);
}

/* Halves a patch across its longer side. */
static void conemap__halve(const conemap__proof *proof, const conemap__patch *whole, int apices,
                           conemap__patch *low, conemap__patch *high) {
    int along = whole->sx * proof->a >= whole->sy * proof->b ? 1 : 2, k;
    *low = *whole;
    *high = *whole;
    if (along == 1) {
        low->sx = high->sx = 0.5 * whole->sx;
        high->x += low->sx;
    } else {
        low->sy = high->sy = 0.5 * whole->sy;
        high->y += low->sy;
    }
    for (k = 0; k < 2; ++k) { /* the middles of the two sides that are cut */
        int first = k * (3 - along), last = first + along;
        low->h[last] = high->h[first] = 0.5 * (whole->h[first] + whole->h[last]);
        if (!apices) continue;
        low->stored[last] = high->stored[first] = 0.5 * (whole->stored[first] + whole->stored[last]);
        low->t[last] = high->t[first] = conemap__exact_tan(&proof->map->info, low->h[last], low->stored[last]);
    }
}

/* The steepest rise per texel of slopes g0..g1 in directions d0..d1 along an axis. */
CONEMAP__INLINE double conemap__ascent(double g0, double g1, double d0, double d1) {
    double ahead = d1 > 0.0 ? conemap__maxd(g0, g1) : 0.0, back = d0 < 0.0 ? -conemap__mind(g0, g1) : 0.0;
    return conemap__maxd(0.0, conemap__maxd(ahead, back));
}

/* Do two cells count for each other's whole quadrants? See conemap__by_border. */
CONEMAP__INLINE int conemap__by_border_pair(const conemap__proof *proof, const conemap__patch *p,
                                            const conemap__patch *q) {
    return conemap__border_cell(proof->info, p->i, p->j) || conemap__border_cell(proof->info, q->i, q->j);
}

/* The steepest ascent in any direction that leads from p to q, over everything between them. */
static double conemap__steepest(const conemap__proof *proof, const conemap__patch *p, const conemap__patch *q) {
    double x0 = conemap__mind(p->x, q->x), x1 = conemap__maxd(p->x + p->sx, q->x + q->sx);
    double y0 = conemap__mind(p->y, q->y), y1 = conemap__maxd(p->y + p->sy, q->y + q->sy);
    double left = q->x - p->x - p->sx, right = q->x + q->sx - p->x, worst = 0.0;
    double down = q->y - p->y - p->sy, up = q->y + q->sy - p->y;
    int i, j, major = conemap__by_border_pair(proof, p, q) ? 0 : proof->sector.major;
    for (j = conemap__mini(p->j, q->j); j <= conemap__maxi(p->j, q->j); ++j)
        for (i = conemap__mini(p->i, q->i); i <= conemap__maxi(p->i, q->i); ++i) {
            conemap__corners c = conemap__gather(proof->map->heights, conemap__cell_quad(proof->map, i, j));
            double u0 = conemap__clamp01(x0 - (double)i), u1 = conemap__clamp01(x1 - (double)i);
            double v0 = conemap__clamp01(y0 - (double)j), v1 = conemap__clamp01(y1 - (double)j);
            double low = (double)c.h10 - (double)c.h00, high = (double)c.h11 - (double)c.h01;
            double rise_left = (double)c.h01 - (double)c.h00, rise_right = (double)c.h11 - (double)c.h10;
            double x0v = low + (high - low) * v0, x1v = low + (high - low) * v1, x, y;
            double y0v = rise_left + (rise_right - rise_left) * u0, y1v = rise_left + (rise_right - rise_left) * u1;
            if (proof->sector.su == 0) {
                x = conemap__ascent(x0v, x1v, left, right);
                y = conemap__ascent(y0v, y1v, down, up);
            } else {
                x = conemap__maxd(x0v * (double)proof->sector.su, x1v * (double)proof->sector.su);
                y = conemap__maxd(y0v * (double)proof->sector.sv, y1v * (double)proof->sector.sv);
            }
            x = proof->a > 0.0 ? x / proof->a : 0.0;
            y = proof->b > 0.0 ? y / proof->b : 0.0;
            worst = conemap__maxd(worst, conemap__ascent2(major, x, y, proof->a, proof->b));
        }
    return sqrt(worst);
}

static void conemap__witness(conemap__proof *proof, double u, double v, double depth) {
    conemap_report *report = proof->report;
    if (depth > report->worst) {
        report->worst = depth;
        report->u = (float)((u + 0.5) / (double)proof->map->info.width);
        report->v = (float)((v + 0.5) / (double)proof->map->info.height);
    }
    proof->found = 1;
    proof->work = conemap__mini(proof->work, CONEMAP__VERIFY_DEEPER);
    proof->slack = CONEMAP__VERIFY_APEX + (1.0 + 1.0 / 64.0) * report->worst + 1.0 / 1048576.0;
}

/* Do differences left..right, up..down from p to q reach into the sector, or with `whole` into its quadrant? Those that
   only touch it can be left: the same points lie in other rectangles too, or are the limit of points inside. */
CONEMAP__INLINE int conemap__sees_box(const conemap__proof *proof, double left, double right, double up, double down,
                                      int whole) {
    double x = proof->sector.su > 0 ? right : -left, y = proof->sector.sv > 0 ? down : -up;
    if ((x <= 0.0 && proof->info->width > 1) || (y <= 0.0 && proof->info->height > 1)) return 0;
    if (proof->sector.major == 0 || whole) return 1;
    return proof->sector.major == 1 ? x > (proof->sector.sv > 0 ? up : -down)
        : y > (proof->sector.su > 0 ? left : -right);
}

CONEMAP__INLINE int conemap__sees_patch(const conemap__proof *proof, const conemap__patch *p, const conemap__patch *q) {
    return proof->sector.su == 0 ||
           conemap__sees_box(proof, q->x - p->x - p->sx, q->x + q->sx - p->x, q->y - p->y - p->sy, q->y + q->sy - p->y,
                             proof->sector.major != 0 && conemap__by_border_pair(proof, p, q));
}

/* The same for points of theirs, (dx, dy) texels from p to q, border included. */
CONEMAP__INLINE int conemap__sees_point(const conemap__proof *proof, const conemap__patch *p, const conemap__patch *q,
                                        double dx, double dy) {
    double x = dx * (double)proof->sector.su, y = dy * (double)proof->sector.sv;
    if (x < 0.0 || y < 0.0) return 0;
    return proof->sector.major == 0 || (proof->sector.major == 1 ? x >= y : y >= x) ||
           conemap__by_border_pair(proof, p, q);
}

/* Settles apices p against the surface q, or halves one of them. */
static void conemap__prove(conemap__proof *proof, const conemap__patch *p, const conemap__patch *q, int depth) {
    const conemap_info *info = &proof->map->info;
    double a = proof->a, b = proof->b, aa = a * a, bb = b * b, slack = proof->slack;
    double t = conemap__most4(p->t), low = conemap__least4(p->h), gap = conemap__most4(q->h) - low - slack;
    double reach = gap * t, nx, ny, least2, spread, mixed;
    int i, j, done, spanned, capped, half_x, half_y;
    conemap__patch first, second;
    if (!(reach > 0.0) || !conemap__sees_patch(proof, p, q)) return;
    nx = conemap__maxd(0.0, conemap__maxd(q->x - p->x - p->sx, p->x - q->x - q->sx));
    ny = conemap__maxd(0.0, conemap__maxd(q->y - p->y - p->sy, p->y - q->y - q->sy));
    least2 = nx * nx * aa + ny * ny * bb;
    if (reach * reach <= least2) return; /* (a) */
    if (--proof->work < 0) {
        proof->open = 1;
        return;
    }
    capped = info->texture.encoding == CONEMAP_RADIUS && t >= (double)info->max_tan;
    half_x = proof->sector.su != 0 && p->x == q->x && p->sx == q->sx;
    half_y = proof->sector.sv != 0 && p->y == q->y && p->sy == q->sy;
    mixed = conemap__most4(p->h) - low;
    if (half_x || half_y) mixed += conemap__most4(q->h) - conemap__least4(q->h);
    mixed *= capped ? 0.0 : 0.25 * (t - conemap__least4(p->t));
    spread = 0.25 * (((half_x ? 0.0 : p->sx * p->sx) + q->sx * q->sx) * aa +
                     ((half_y ? 0.0 : p->sy * p->sy) + q->sy * q->sy) * bb);
    done = least2 > 1.25 * spread; /* below that the difference in (b) is all rounding */
    for (i = 0; i < 4; ++i)
        for (j = 0; j < 4; ++j) {
            double dx = q->x + (j & 1 ? q->sx : 0.0) - p->x - (i & 1 ? p->sx : 0.0);
            double dy = q->y + (j & 2 ? q->sy : 0.0) - p->y - (i & 2 ? p->sy : 0.0);
            double d2 = dx * dx * aa + dy * dy * bb, rise = q->h[j] - p->h[i] - slack, side;
            if ((half_x && dx * (double)proof->sector.su < 0.0) || (half_y && dy * (double)proof->sector.sv < 0.0))
                continue;
            side = (rise - 2.0 * CONEMAP__VERIFY_GRAIN) * p->t[i];
            if (side > 0.0 && side * side > d2 && conemap__sees_point(proof, p, q, dx, dy)) { /* the corner tangents are
                                                                                                 exact, so this one is
                                                                                                 real */
                conemap__witness(proof, p->x + (i & 1 ? p->sx : 0.0), p->y + (i & 2 ? p->sy : 0.0),
                                 q->h[j] - p->h[i] - CONEMAP__VERIFY_APEX - sqrt(d2) / p->t[i]);
                done = 0;
            }
            side = rise * (capped ? t : p->t[i]) + mixed;
            if (side > 0.0 && side * side > d2 - spread) done = 0; /* (b) */
        }
    if (done) return;
    spanned = (1 + (q->i < p->i ? p->i - q->i : q->i - p->i)) * (1 + (q->j < p->j ? p->j - q->j : q->j - p->j));
    /* (c): t (steepest D - slack) <= D for all D up to the reach, beyond which (a) holds. Across many cells it costs
       more than halving. */
    if ((spanned <= 4 || (spanned <= 81 && depth >= 4 && depth % 4 == 0)) &&
        (t * conemap__steepest(proof, p, q) - 1.0) * gap <= slack)
        return;
    if (depth >= proof->depth) {
        proof->open = 1;
        return;
    }
    if (p->sx * a + p->sy * b > q->sx * a + q->sy * b) {
        conemap__halve(proof, p, 1, &first, &second);
        conemap__prove(proof, &first, q, depth + 1);
        conemap__prove(proof, &second, q, depth + 1);
    } else {
        conemap__halve(proof, q, 0, &first, &second);
        conemap__prove(proof, p, &first, depth + 1);
        conemap__prove(proof, p, &second, depth + 1);
    }
}

/* Cells from a cell to a block that begins at `begin`: the ones between them. */
CONEMAP__INLINE int conemap__cells_between(int cell, int begin, int end) {
    return conemap__maxi(0, conemap__maxi(begin - cell - 1, cell - end));
}

/* A block of the cells' pyramid. */
typedef struct conemap__seen_block {
    int level, x, y;
} conemap__seen_block;

/* May a block `cells` cells away, beside a wrapping border, be left because another image of all of it is as near? Half
   the way round in all directions, the whole way in a quadrant and along an octant's minor axis. */
CONEMAP__INLINE int conemap__repeats(const conemap__proof *proof, int cells, int size, int axis) {
    if (proof->sector.su == 0) return 2 * cells > size;
    return proof->sector.major != axis && cells >= size;
}

/* Holds a cell of apices against one period of the surface. */
static void conemap__prove_period(conemap__proof *proof, const conemap__patch *apices, int period_u, int period_v) {
    const conemap_map *map = proof->map;
    const conemap_pyramid *cells = &map->cells;
    conemap__seen_block stack[1 + 4 * 17], block; /* three siblings a level wait */
    int count = 1, images_u = map->info.wrap_u == CONEMAP_WRAP && map->info.width > 1;
    int images_v = map->info.wrap_v == CONEMAP_WRAP && map->info.height > 1, k, i = apices->i, j = apices->j;
    double t = conemap__most4(apices->t), low = conemap__least4(apices->h);
    conemap__patch surface;
    stack[0].level = cells->levels - 1;
    stack[0].x = stack[0].y = 0;
    while (count > 0 && proof->work > 0) {
        int x0, y0, nu, nv, nearest;
        double highest, reach, du, dv;
        block = stack[--count];
        x0 = (block.x << block.level) + period_u * map->info.width;
        y0 = (block.y << block.level) + period_v * map->info.height;
        nu = conemap__cells_between(i, x0, x0 + (1 << block.level));
        nv = conemap__cells_between(j, y0, y0 + (1 << block.level));
        if ((images_u && conemap__repeats(proof, nu, map->info.width, 1)) ||
            (images_v && conemap__repeats(proof, nv, map->info.height, 2)))
            continue;
        if (proof->sector.su != 0) {
            int size = 1 << block.level, x = block.x << block.level, y = block.y << block.level;
            int whole = proof->sector.major != 0 &&
                        (conemap__border_cell(proof->info, i, j) ||
                         conemap__texels_by_border(proof->info, x + 1, x + size - 1, y + 1, y + size - 1));
            if (!conemap__sees_box(proof, (double)(x0 - i - 1), (double)(x0 + size - i), (double)(y0 - j - 1),
                                   (double)(y0 + size - j), whole))
                continue;
        }
        highest = block.level > 0 ? (double)conemap__block_max(cells, block.level, block.x, block.y)
                                  : (double)conemap__cell_max(map, block.x, block.y);
        reach = (highest - low - proof->slack) * t;
        du = (double)nu * proof->a;
        dv = (double)nv * proof->b;
        if (!(reach > 0.0) || reach * reach <= du * du + dv * dv) continue;
        if (block.level == 0) {
            conemap__whole_patch(proof, x0, y0, 0, &surface);
            conemap__prove(proof, apices, &surface, 0);
            continue;
        }
        --block.level;
        nearest = (i >= x0 + (1 << block.level) ? 1 : 0) + (j >= y0 + (1 << block.level) ? 2 : 0);
        for (k = 3; k >= 0; --k) { /* the nearest child comes off the stack first: it narrows the most */
            conemap__seen_block child = block;
            child.x = 2 * block.x + ((nearest ^ k) & 1);
            child.y = 2 * block.y + ((nearest ^ k) >> 1);
            if (child.x < cells->width[child.level] && child.y < cells->height[child.level]) stack[count++] = child;
        }
    }
    if (count > 0) proof->open = 1;
}

/* How many periods away along an axis something may be seen: see conemap__images. */
static int conemap__seen_periods(const conemap__proof *proof, const conemap__patch *apices, int along_v) {
    const conemap_info *info = &proof->map->info;
    int size = along_v ? info->height : info->width, other = along_v ? info->width : info->height;
    double period = (double)size * (along_v ? proof->b : proof->a), reach;
    if ((along_v ? info->wrap_v : info->wrap_u) != CONEMAP_WRAP || size == 1) return 0;
    if (proof->sector.major == 0) return 1;
    reach = conemap__most4(apices->t) * (1.0 - conemap__least4(apices->h)) / period;
    return 1 + (int)conemap__mind(reach, (double)(2 + other / size));
}

/* Holds a cell of apices against the whole surface, in one pass: the period itself first, then its neighbours. */
static void conemap__prove_pass(conemap__proof *proof, const conemap__patch *apices) {
    int periods_u = conemap__seen_periods(proof, apices, 0), periods_v = conemap__seen_periods(proof, apices, 1), a, b;
    conemap__prove_period(proof, apices, 0, 0);
    for (b = -periods_v; b <= periods_v; ++b)
        for (a = -periods_u; a <= periods_u; ++a)
            if ((a != 0 || b != 0) && a * proof->sector.su >= 0 && b * proof->sector.sv >= 0)
                conemap__prove_period(proof, apices, a, b);
}

/* Holds cell (i, j) with the cones of one sector against the whole surface. First passes that give up early find most
   witnesses at once, where one deep pass would spend its work on the first narrow place. */
static void conemap__prove_cell(conemap__proof *proof, const conemap__patch *apices) {
    static const int depths[] = {16, 24, 36, CONEMAP__VERIFY_DEPTH};
    int pass;
    proof->slack = CONEMAP__VERIFY_APEX - CONEMAP__VERIFY_GRAIN;
    proof->found = 0;
    proof->open = 1;
    for (pass = 0; pass < 4 && proof->open; ++pass) {
        int work = proof->credit > 0 ? CONEMAP__VERIFY_WORK : CONEMAP__VERIFY_WORK / 32;
        proof->depth = depths[pass];
        if (proof->found) work = conemap__mini(work, CONEMAP__VERIFY_DEEPER);
        proof->work = work;
        proof->open = 0;
        conemap__prove_pass(proof, apices);
        if (proof->found) work = conemap__mini(work, CONEMAP__VERIFY_DEEPER);
        if (proof->open) proof->credit = conemap__maxi(0, proof->credit - (work - conemap__maxi(proof->work, 0)));
    }
}

static conemap_result conemap__check_verify(const conemap_info *info, const float *heights, const float *cones) {
    size_t count, k;
    conemap_result result;
    if (info->width < 1 || info->height < 1 || info->width > CONEMAP_MAX_SIZE || info->height > CONEMAP_MAX_SIZE)
        return CONEMAP_ERROR_SIZE;
    if (!CONEMAP__KNOWN(info->wrap_u, CONEMAP_WRAP_COUNT) || !CONEMAP__KNOWN(info->wrap_v, CONEMAP_WRAP_COUNT))
        return CONEMAP_ERROR_ENUM;
    result = conemap__check_texture(&info->texture);
    if (result != CONEMAP_OK) return result;
    if (!conemap__in_range(info->aspect, 1.0f / 32768.0f, 32768.0f) ||
        !conemap__in_range(info->max_tan, 1.0f / 65536.0f, CONEMAP_TAN_LIMIT))
        return CONEMAP_ERROR_PARAMETER;
    if ((size_t)info->width > SIZE_MAX / sizeof(float) / (size_t)info->height) return CONEMAP_ERROR_OVERFLOW;
    count = (size_t)info->width * (size_t)info->height;
    if ((size_t)conemap__planes(info) > SIZE_MAX / sizeof(float) / count) return CONEMAP_ERROR_OVERFLOW;
    for (k = 0; k < count; ++k)
        if (!conemap__in_range(heights[k], 0.0f, 1.0f)) return CONEMAP_ERROR_HEIGHT;
    for (k = 0; k < count * (size_t)conemap__planes(info); ++k)
        if (!conemap__in_range(cones[k], 0.0f, CONEMAP__FAR)) return CONEMAP_ERROR_PARAMETER;
    return CONEMAP_OK;
}

/* The cells between centres along an axis; one that has no length stands for an axis of one texel. */
static int conemap__inner_cells(int size, conemap_wrap wrap) {
    return wrap == CONEMAP_WRAP ? size : conemap__maxi(1, size - 1);
}

/* The steepest ascent of the whole surface in the directions of the sector's quadrant. */
static double conemap__steepest_of_all(const conemap__proof *proof, int cells_u, int cells_v) {
    double rise_u = 0.0, rise_v = 0.0;
    double left = proof->sector.su > 0 ? 0.0 : -1.0, right = proof->sector.su < 0 ? 0.0 : 1.0;
    double up = proof->sector.sv > 0 ? 0.0 : -1.0, down = proof->sector.sv < 0 ? 0.0 : 1.0;
    int i, j;
    for (j = 0; j < cells_v; ++j)
        for (i = 0; i < cells_u; ++i) {
            conemap__corners c = conemap__gather(proof->map->heights, conemap__cell_quad(proof->map, i, j));
            double x0 = (double)c.h10 - (double)c.h00, x1 = (double)c.h11 - (double)c.h01;
            double y0 = (double)c.h01 - (double)c.h00, y1 = (double)c.h11 - (double)c.h10;
            rise_u = conemap__maxd(rise_u, conemap__ascent(x0, x1, left, right));
            rise_v = conemap__maxd(rise_v, conemap__ascent(y0, y1, up, down));
        }
    rise_u = proof->a > 0.0 ? rise_u / proof->a : 0.0;
    rise_v = proof->b > 0.0 ? rise_v / proof->b : 0.0;
    return sqrt(rise_u * rise_u + rise_v * rise_v);
}

CONEMAP__DEF conemap_result conemap_verify(const conemap_info *info, const float *heights, const float *cones,
                                           const conemap_allocator *allocator, conemap_report *report) {
    conemap_map map;
    conemap__proof proof;
    conemap_allocator memory_from;
    conemap_result result;
    void *memory = NULL;
    unsigned char *cursor;
    size_t bytes = 0;
    double steepest[8];
    int owns = 0, cells_u, cells_v, i, j, k;
    if (!report) return CONEMAP_ERROR_NULL;
    memset(report, 0, sizeof *report);
    if (!info || !heights || !cones) return CONEMAP_ERROR_NULL;
    memset(&memory_from, 0, sizeof memory_from);
    if (allocator) memory_from = *allocator;
    if ((memory_from.allocate == NULL) != (memory_from.release == NULL)) return CONEMAP_ERROR_NULL;
    result = conemap__check_verify(info, heights, cones);
    if (result != CONEMAP_OK) return result;

    memset(&map, 0, sizeof map);
    map.info = *info;
    map.heights = heights;
    map.cones = cones;
    if (info->wrap_u == CONEMAP_CLAMP) map.info.wrap_u = CONEMAP_NOTHING; /* without the outer half cells */
    if (info->wrap_v == CONEMAP_CLAMP) map.info.wrap_v = CONEMAP_NOTHING;
    cells_u = conemap__inner_cells(info->width, info->wrap_u);
    cells_v = conemap__inner_cells(info->height, info->wrap_v);
    if (!conemap__pyramid_plan(&map.cells, cells_u, cells_v, 1, &bytes)) return CONEMAP_ERROR_OVERFLOW;
    if (bytes > 0) {
        result = conemap__take(&memory_from, NULL, 0, bytes, &memory, &owns);
        if (result != CONEMAP_OK) {
            conemap__release(&memory_from, memory, owns);
            return result;
        }
        cursor = (unsigned char *)memory;
        conemap__cut_pyramid(&map.cells, 1, &cursor);
    }
    for (j = 0; j * CONEMAP__STRIP < cells_v; ++j) conemap__pyramid_strip(&map, &map.cells, j);
    conemap__pyramid_top(&map, &map.cells);

    memset(&proof, 0, sizeof proof);
    proof.credit = CONEMAP__VERIFY_CREDIT;
    proof.map = &map;
    proof.info = info;
    proof.report = report;
    proof.a = info->width > 1 ? 1.0 / (double)info->width : 0.0;
    proof.b = info->height > 1 ? (double)info->aspect / (double)info->height : 0.0;
    for (k = 0; k < conemap__planes(info); ++k) {
        proof.sector = conemap__make_sector(info, k);
        steepest[k] = conemap__steepest_of_all(&proof, cells_u, cells_v);
    }
    for (j = 0; j < cells_v; ++j)
        for (i = 0; i < cells_u; ++i) {
            conemap__patch patch;
            int found = 0, open = 0;
            for (k = 0; k < conemap__planes(info); ++k) {
                map.cones = cones + (size_t)k * conemap__texels(&map);
                proof.sector = conemap__make_sector(info, k);
                conemap__whole_patch(&proof, i, j, 1, &patch);
                /* (c) for the whole surface; no point of it rises by more than 1. */
                if (!(conemap__most4(patch.t) * steepest[k] > 1.0 + CONEMAP__VERIFY_APEX - CONEMAP__VERIFY_GRAIN))
                    continue;
                conemap__prove_cell(&proof, &patch);
                found |= proof.found;
                open |= proof.open;
            }
            if (found)
                ++report->unsafe;
            else if (open)
                ++report->unproven;
        }
    report->cells = (size_t)cells_u * (size_t)cells_v;
    conemap__release(&memory_from, memory, owns);
    return CONEMAP_OK;
}

/* ======================================================================================================
   P L A N S

   The statistics hold what rays of four slopes took that probed the map: steps with vertex cones and with narrowed
   ones, cells, share of the way. A ray of elevation e moves depth cot(e) sideways on its way down the box; P, S, C and
   W are the means of those four over eight elevations from the lowest up, between the four slopes straight over the
   logarithm. Mean steps are a sum, with weights that are not negative, of
       1,  P,  S,  sqrt(C),  W,  log2 of the map's size,
   and time is a share a ray and a share a step. Misses and errors of what can miss are taken to grow as the square of
   the roughness (and a little), and for equal steps as the cells that one of them crosses; their factors are the
   largest that were measured, times 1.5. All of it is fitted twice, for maps below 0.7 of roughness and for the others.
   Building takes a time for each texel. `accuracy --fit` measures this on procedural maps and prints the table anew;
   `make fit` puts it here.

   Misses follow roughness only to a factor of five or so, hence trials on the heights themselves.
   ====================================================================================================== */

enum { CONEMAP__PLAN_TERMS = 6, CONEMAP__PLAN_BLOCKS = 64, CONEMAP__PLAN_NEAR = 24, CONEMAP__PLAN_PROBES = 96,
       CONEMAP__PLAN_TRIAL = 16384, CONEMAP__PLAN_BATCH = 64 };

typedef struct conemap__plan_fit {
    float steps[CONEMAP__PLAN_TERMS];
    float ray, step;     /* time */
    float missed, error; /* factors */
} conemap__plan_fit;

typedef struct conemap__plan_row {
    conemap_generator generator;
    conemap_guarantee guarantee;
    int min3x3, per_cell, sectors, prepared;
    conemap_tracer tracer;
    conemap_refinement refinement;
    int max_steps;
    float build;              /* time a texel */
    conemap__plan_fit fit[2]; /* smooth and rough maps */
} conemap__plan_row;

/* Behind each row: how far off its steps are as a mean, on the maps that it was fitted on. */
static const conemap__plan_row conemap__plan_rows[] = {
    {CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 0, 0, CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 2.1f,
     {{{0.000f, 0.000f, 0.942f, 0.016f, 0.000f, 0.000f}, 0.00f, 1.00f, 0.00f, 0.00f}, /* 12 % */
     {{0.000f, 0.000f, 1.181f, 0.000f, 0.000f, 0.000f}, 0.00f, 1.00f, 0.00f, 0.00f}}}, /* 18 % */
    {CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 1, 0, 0, CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 2.1f,
     {{{0.000f, 0.000f, 0.882f, 0.052f, 0.000f, 0.000f}, 0.00f, 1.04f, 0.00f, 0.00f}, /* 10 % */
     {{0.000f, 0.000f, 1.137f, 0.000f, 0.000f, 0.000f}, 0.00f, 1.05f, 0.00f, 0.00f}}}, /* 16 % */
    {CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 1, 4, 0, CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 50.4f,
     {{{0.000f, 0.000f, 0.704f, 0.134f, 0.129f, 0.000f}, 0.00f, 1.25f, 0.00f, 0.00f}, /* 6 % */
     {{0.000f, 0.000f, 0.934f, 0.000f, 0.000f, 0.002f}, 0.00f, 1.22f, 0.00f, 0.00f}}}, /* 21 % */
    {CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 1, 8, 0, CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 109.5f,
     {{{0.000f, 0.000f, 0.633f, 0.141f, 0.442f, 0.000f}, 0.00f, 1.38f, 0.00f, 0.00f}, /* 6 % */
     {{0.000f, 0.000f, 0.774f, 0.000f, 0.000f, 0.078f}, 0.00f, 1.32f, 0.00f, 0.00f}}}, /* 24 % */
    {CONEMAP_QUICK_NAIVE, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 1, CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 2.8f,
     {{{0.324f, 0.095f, 0.959f, 0.000f, 0.000f, 0.000f}, 0.17f, 0.20f, 0.00f, 0.00f}, /* 6 % */
     {{0.000f, 0.000f, 0.436f, 0.000f, 0.000f, 0.475f}, 0.08f, 0.22f, 0.00f, 0.00f}}}, /* 36 % */
    {CONEMAP_QUICK_NAIVE, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_TRACE_MAXMIP, CONEMAP_REFINE_NONE, 0, 0.9f,
     {{{0.000f, 1.386f, 0.000f, 0.048f, 0.000f, 1.339f}, 2.16f, 0.21f, 0.00f, 0.00f}, /* 5 % */
     {{0.000f, 0.000f, 1.596f, 0.000f, 0.000f, 1.184f}, 0.00f, 0.44f, 0.00f, 0.00f}}}, /* 14 % */
    {CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 1.0f,
     {{{0.000f, 0.000f, 0.776f, 0.120f, 0.000f, 0.000f}, 0.00f, 0.98f, 0.298f, 17.5f}, /* 7 % */
     {{0.000f, 0.417f, 0.324f, 0.576f, 0.000f, 0.000f}, 0.00f, 1.14f, 0.450f, 28.4f}}}, /* 7 % */
    {CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 1, 0, 0, 0, CONEMAP_TRACE_CELL_MAX, CONEMAP_REFINE_SECANT, 0, 1.0f,
     {{{0.000f, 0.000f, 0.917f, 0.000f, 0.000f, 0.000f}, 0.11f, 1.00f, 0.125f, 8.70f}, /* 10 % */
     {{0.000f, 0.000f, 1.162f, 0.000f, 0.000f, 0.000f}, 0.01f, 0.84f, 0.0177f, 1.21f}}}, /* 17 % */
    {CONEMAP_QUICK, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_TRACE_EXACT, CONEMAP_REFINE_NONE, 0, 0.9f,
     {{{0.000f, 0.000f, 0.743f, 0.378f, 0.000f, 0.000f}, 0.06f, 0.94f, 0.209f, 6.15f}, /* 12 % */
     {{0.000f, 0.000f, 0.525f, 1.130f, 0.000f, 0.000f}, 0.00f, 1.13f, 0.430f, 26.1f}}}, /* 11 % */
    {CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_TRACE_CELL_MAX, CONEMAP_REFINE_SECANT, 0, 1.0f,
     {{{0.000f, 0.092f, 0.643f, 0.115f, 0.000f, 0.000f}, 0.00f, 0.99f, 0.507f, 58.0f}, /* 7 % */
     {{0.000f, 0.000f, 0.712f, 0.336f, 0.000f, 0.000f}, 0.00f, 1.04f, 0.749f, 52.3f}}}, /* 12 % */
    {CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_TRACE_EXACT_STEP, CONEMAP_REFINE_SECANT, 0, 1.0f,
     {{{0.000f, 0.381f, 0.335f, 0.030f, 0.000f, 0.000f}, 0.89f, 0.66f, 0.832f, 131.f}, /* 10 % */
     {{0.000f, 0.828f, 0.059f, 0.029f, 0.248f, 0.000f}, 0.29f, 0.98f, 0.803f, 55.2f}}}, /* 14 % */
    {CONEMAP_QUICK_NAIVE, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_TRACE_QDM, CONEMAP_REFINE_NONE, 0, 0.9f,
     {{{1.642f, 1.443f, 0.000f, 0.000f, 0.000f, 0.554f}, 0.51f, 0.43f, 0.125f, 10.3f}, /* 6 % */
     {{0.000f, 0.000f, 1.487f, 0.000f, 0.000f, 1.109f}, 0.00f, 0.55f, 0.0193f, 1.10f}}}, /* 15 % */
    {CONEMAP_QUICK_NAIVE, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_TRACE_LINEAR, CONEMAP_REFINE_SECANT, 200, 0.9f,
     {{{0.000f, 0.000f, 0.000f, 3.023f, 160.348f, 0.000f}, 2.23f, 0.17f, 0.691f, 43.3f}, /* 4 % */
     {{0.000f, 0.000f, 2.156f, 0.000f, 142.546f, 0.000f}, 0.00f, 0.28f, 9.29f, 242.f}}}, /* 12 % */
    {CONEMAP_QUICK_NAIVE, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_TRACE_LINEAR, CONEMAP_REFINE_SECANT, 32, 0.9f,
     {{{0.000f, 0.000f, 0.000f, 0.532f, 26.184f, 0.000f}, 1.58f, 0.17f, 0.558f, 55.5f}, /* 4 % */
     {{0.000f, 0.000f, 0.538f, 0.000f, 22.164f, 0.000f}, 0.57f, 0.37f, 2.91f, 107.f}}}, /* 11 % */
};
enum { CONEMAP__PLAN_ROWS = sizeof conemap__plan_rows / sizeof conemap__plan_rows[0] };

/* The height of a texel; negative where it is none. */
static float conemap__plan_height(const conemap_heights *h, int x, int y) {
    const unsigned char *bytes =
        (const unsigned char *)h->pixels + (ptrdiff_t)y * h->row_stride + (ptrdiff_t)x * h->pixel_stride;
    float value = conemap__value(h->format, conemap__read_code(h->format, bytes));
    if (!conemap__in_range(value, 0.0f, 1.0f)) return -1.0f;
    return h->is_depth ? 1.0f - value : value;
}

/* The narrower of `tangent` and of what a height at (dx, dy) texels allows. */
CONEMAP__INLINE double conemap__plan_narrow(double tangent, double rise, double dx, double dy, double a, double b) {
    double d2 = dx * dx * a * a + dy * dy * b * b;
    return rise > 0.0 && d2 < tangent * tangent * rise * rise ? sqrt(d2) / rise : tangent;
}

/* A vertex cone from below: texels near by one by one, others by maxima over blocks, which lie no nearer than both. */
static double conemap__plan_cone(const conemap_heights *h, const float *blocks, int block_u, int block_v, int x,
                                 int y) {
    double a = 1.0 / (double)h->width, b = 1.0 / (double)h->height, tangent = 1.0;
    double apex = (double)conemap__plan_height(h, x, y), margin = (double)(CONEMAP__PLAN_NEAR + 1);
    int i, j, reach = CONEMAP__PLAN_NEAR;
    for (j = conemap__maxi(0, y - reach); j <= conemap__mini(h->height - 1, y + reach); ++j)
        for (i = conemap__maxi(0, x - reach); i <= conemap__mini(h->width - 1, x + reach); ++i)
            tangent = conemap__plan_narrow(tangent, (double)conemap__plan_height(h, i, j) - apex, (double)(i - x),
                                           (double)(j - y), a, b);
    for (j = 0; j * block_v < h->height; ++j)
        for (i = 0; i * block_u < h->width; ++i) {
            double dx = (double)conemap__maxi(0, conemap__maxi(i * block_u - x, x - (i + 1) * block_u + 1));
            double dy = (double)conemap__maxi(0, conemap__maxi(j * block_v - y, y - (j + 1) * block_v + 1));
            int inside = i * block_u >= x - reach && (i + 1) * block_u <= x + reach + 1 && j * block_v >= y - reach &&
                         (j + 1) * block_v <= y + reach + 1;
            if (inside) continue;             /* every texel of it was near */
            if (dx < margin && dy < margin) { /* what is left of it lies outside the square of near texels */
                if (margin * margin * a * a + dy * dy * b * b < margin * margin * b * b + dx * dx * a * a)
                    dx = margin;
                else
                    dy = margin;
            }
            tangent = conemap__plan_narrow(tangent, (double)blocks[j * CONEMAP__PLAN_BLOCKS + i] - apex, dx, dy, a, b);
        }
    return tangent;
}

/* The narrowest cone that the texels within two of each of the 3x3 texels at (x, y) leave to any of them. */
static double conemap__plan_narrowest(const conemap_heights *h, int x, int y) {
    double a = 1.0 / (double)h->width, b = 1.0 / (double)h->height, tangent = 1.0;
    int i, j, k, l;
    for (j = conemap__maxi(0, y - 1); j <= conemap__mini(h->height - 1, y + 1); ++j)
        for (i = conemap__maxi(0, x - 1); i <= conemap__mini(h->width - 1, x + 1); ++i) {
            double apex = (double)conemap__plan_height(h, i, j);
            for (l = conemap__maxi(0, j - 2); l <= conemap__mini(h->height - 1, j + 2); ++l)
                for (k = conemap__maxi(0, i - 2); k <= conemap__mini(h->width - 1, i + 2); ++k)
                    tangent = conemap__plan_narrow(tangent, (double)conemap__plan_height(h, k, l) - apex,
                                                   (double)(k - i), (double)(l - j), a, b);
        }
    return tangent;
}

/* How far sideways the rays of the statistics move. */
CONEMAP__INLINE float conemap__plan_sideways(int slope) {
    static const float sideways[4] = {0.03125f, 0.125f, 0.5f, 2.0f};
    return sideways[slope];
}

/* Sends one ray from the top of the box, at texel (x, y) in direction (du, dv) of length 1, down one of the slopes. It
   steps to the end of the cone over the texel below it, or as far as cell borders lie apart if that is farther. */
static void conemap__plan_probe(const conemap_heights *h, const float *blocks, int block_u, int block_v, double u,
                                double v, double du, double dv, double sideways, int safe, double *steps, double *cells,
                                double *way) {
    double along = 0.0, end = sideways, least, size = (double)conemap__maxi(h->width, h->height);
    if (du > 0.0) end = conemap__mind(end, (1.0 - u) / du);
    if (du < 0.0) end = conemap__mind(end, -u / du);
    if (dv > 0.0) end = conemap__mind(end, (1.0 - v) / dv);
    if (dv < 0.0) end = conemap__mind(end, -v / dv);
    least = 1.0 / (size * ((du < 0.0 ? -du : du) + (dv < 0.0 ? -dv : dv))); /* from border to border, as a mean */
    while (along < end) {
        int x = conemap__mini((int)((u + du * along) * (double)h->width), h->width - 1);
        int y = conemap__mini((int)((v + dv * along) * (double)h->height), h->height - 1);
        double gap = 1.0 - along / sideways - (double)conemap__plan_height(h, x, y), tangent;
        *steps += 1.0;
        if (gap <= 0.0) break;
        tangent = conemap__plan_cone(h, blocks, block_u, block_v, x, y);
        if (safe) tangent = conemap__mind(tangent, conemap__plan_narrowest(h, x, y));
        along += conemap__maxd(least, tangent * gap * sideways / (sideways + tangent));
    }
    along = conemap__mind(along, end);
    *cells += along * size;
    *way += end > 0.0 ? along / end : 1.0;
}

CONEMAP__DEF conemap_result conemap_get_statistics(const conemap_heights *heights, conemap_statistics *statistics) {
    float blocks[CONEMAP__PLAN_BLOCKS * CONEMAP__PLAN_BLOCKS];
    conemap_heights h;
    conemap_result result;
    double sum = 0.0, squares = 0.0, differences = 0.0, pairs = 0.0, texels, mean, variance;
    int x, y, block_u, block_v, slope, k;
    if (!statistics) return CONEMAP_ERROR_NULL;
    memset(statistics, 0, sizeof *statistics);
    if (!heights) return CONEMAP_ERROR_NULL;
    h = *heights;
    result = conemap__resolve_heights(&h);
    if (result != CONEMAP_OK) return result;
    block_u = (h.width + CONEMAP__PLAN_BLOCKS - 1) / CONEMAP__PLAN_BLOCKS;
    block_v = (h.height + CONEMAP__PLAN_BLOCKS - 1) / CONEMAP__PLAN_BLOCKS;
    memset(blocks, 0, sizeof blocks);
    for (y = 0; y < h.height; ++y) {
        float before = 0.0f;
        for (x = 0; x < h.width; ++x) {
            float value = conemap__plan_height(&h, x, y),
                  *block = &blocks[y / block_v * CONEMAP__PLAN_BLOCKS + x / block_u];
            double difference = (double)value - (double)before;
            if (value < 0.0f) return CONEMAP_ERROR_HEIGHT;
            sum += (double)value;
            squares += (double)value * (double)value;
            if (x > 0) {
                differences += difference * difference;
                pairs += 1.0;
            }
            if (y > 0) {
                difference = (double)value - (double)conemap__plan_height(&h, x, y - 1);
                differences += difference * difference;
                pairs += 1.0;
            }
            if (value > *block) *block = value;
            before = value;
        }
    }
    texels = (double)h.width * (double)h.height;
    mean = sum / texels;
    variance = squares / texels - mean * mean;
    statistics->width = h.width;
    statistics->height = h.height;
    statistics->roughness = variance > 1e-12 && pairs > 0.0 ? (float)sqrt(differences / pairs / variance) : 0.0f;
    for (slope = 0; slope < 4; ++slope) {
        double steps = 0.0, safe_steps = 0.0, cells = 0.0, way = 0.0, unused = 0.0;
        for (k = 0; k < CONEMAP__PLAN_PROBES; ++k) { /* spread evenly by the powers of the plastic number */
            double u = conemap__fraction(0.5 + 0.7548776662466927 * (double)k),
                   du = 2.0 * conemap__fraction(0.1 + 0.4142135623730951 * (double)k) - 1.0;
            double v = conemap__fraction(0.5 + 0.5698402909980532 * (double)k), dv = 1.0 - (du < 0.0 ? -du : du),
                   length;
            if (k % 2) dv = -dv;
            length = sqrt(du * du + dv * dv);
            conemap__plan_probe(&h, blocks, block_u, block_v, u, v, du / length, dv / length,
                                (double)conemap__plan_sideways(slope), 0, &steps, &cells, &way);
            conemap__plan_probe(&h, blocks, block_u, block_v, u, v, du / length, dv / length,
                                (double)conemap__plan_sideways(slope), 1, &safe_steps, &unused, &unused);
        }
        statistics->steps[slope] = (float)(steps / (double)CONEMAP__PLAN_PROBES);
        statistics->safe_steps[slope] = (float)(safe_steps / (double)CONEMAP__PLAN_PROBES);
        statistics->cells[slope] = (float)(cells / (double)CONEMAP__PLAN_PROBES);
        statistics->way[slope] = (float)(way / (double)CONEMAP__PLAN_PROBES);
    }
    return CONEMAP_OK;
}

/* The cotangent of an elevation, by a table: it spares the header a function of the library. */
static float conemap__plan_cotangent(float degrees) {
    static const float tangents[10] = {0.0f,     0.17633f, 0.36397f, 0.57735f, 0.83910f,
                                       1.19175f, 1.73205f, 2.74748f, 5.67128f, 60.0f};
    int k = conemap__mini((int)(degrees / 10.0f), 8);
    return 1.0f / (tangents[k] + (tangents[k + 1] - tangents[k]) * (degrees / 10.0f - (float)k));
}

/* log2, straight between powers of two: 0.09 too small at most. For x of 2^-120 and more. */
static float conemap__plan_log2(float x) {
    uint32_t bits = conemap__bits(x);
    return (float)((int)(bits >> 23) - 127) + (float)(bits & 0x7fffffu) / 8388608.0f;
}

/* The six terms of mean steps; returns C. */
static float conemap__plan_terms(const conemap_statistics *s, float depth, float lowest, float *terms) {
    float probe = 0.0f, safe = 0.0f, cells = 0.0f, way = 0.0f;
    int k, slope;
    for (k = 0; k < 8; ++k) {
        float elevation = lowest + (90.0f - lowest) * ((float)k + 0.5f) / 8.0f;
        float at = 0.5f * (conemap__plan_log2(depth * conemap__plan_cotangent(elevation)) + 5.0f), part;
        at = conemap__max(0.0f, conemap__min(at, 3.0f));
        slope = conemap__mini((int)at, 2);
        part = at - (float)slope;
        probe += (s->steps[slope] + (s->steps[slope + 1] - s->steps[slope]) * part) / 8.0f;
        safe += (s->safe_steps[slope] + (s->safe_steps[slope + 1] - s->safe_steps[slope]) * part) / 8.0f;
        cells += (s->cells[slope] + (s->cells[slope + 1] - s->cells[slope]) * part) / 8.0f;
        way += (s->way[slope] + (s->way[slope + 1] - s->way[slope]) * part) / 8.0f;
    }
    terms[0] = 1.0f;
    terms[1] = probe;
    terms[2] = safe;
    terms[3] = sqrtf(cells);
    terms[4] = way;
    terms[5] = conemap__plan_log2((float)conemap__maxi(s->width, s->height));
    return cells;
}

/* What misses and errors are taken to grow with. */
static float conemap__plan_risk(const conemap__plan_row *row, const conemap_statistics *s, float cells) {
    float risk = 0.002f + s->roughness * s->roughness;
    return row->tracer == CONEMAP_TRACE_LINEAR ? (0.05f + risk) * (1.0f + cells) / (float)row->max_steps : risk;
}

CONEMAP__INLINE int conemap__plan_rough(const conemap_statistics *s) { return s->roughness >= 0.7f; }

/* The coarsest format whose heights are off by less than the error allowed: half a step, seen along the flattest
   ray. */
static conemap_format conemap__plan_format(const conemap_plan_desc *desc, float depth, float lowest, float error) {
    static const conemap_format formats[2] = {CONEMAP_UNORM8, CONEMAP_UNORM16};
    float size = (float)conemap__maxi(desc->statistics.width, desc->statistics.height);
    float along = size * (depth + depth * conemap__plan_cotangent(lowest));
    int k;
    for (k = 0; k < 2; ++k)
        if (desc->max_error > 0.0f && error + 0.5f * along / (k == 0 ? 255.0f : 65535.0f) <= desc->max_error)
            return formats[k];
    return CONEMAP_F32;
}

/* ---- trials ---------------------------------------------------------------------------------------------------- */

/* Ray k of a trial, from the box's top, places and angles spread evenly as the probes' are, elevations by the golden
   ratio. Returns its length over the map's width for each unit of t. */
static float conemap__plan_ray(int k, float depth, float lowest, conemap_ray *ray) {
    double du = 2.0 * conemap__fraction(0.1 + 0.4142135623730951 * (double)k) - 1.0;
    double dv = (k % 2 ? -1.0 : 1.0) * (1.0 - (du < 0.0 ? -du : du)), length = sqrt(du * du + dv * dv);
    float elevation = lowest + (90.0f - lowest) * (float)conemap__fraction(0.6180339887498949 * (double)k);
    float sideways = depth * conemap__plan_cotangent(elevation);
    memset(ray, 0, sizeof *ray);
    ray->origin[0] = (float)conemap__fraction(0.5 + 0.7548776662466927 * (double)k);
    ray->origin[1] = (float)conemap__fraction(0.5 + 0.5698402909980532 * (double)k);
    ray->origin[2] = 1.0f;
    ray->direction[0] = (float)(du / length) * sideways;
    ray->direction[1] = (float)(dv / length) * sideways;
    ray->direction[2] = -1.0f;
    return sqrtf(sideways * sideways + depth * depth);
}

/* Builds what is planned and traces it beside the walk over maxima, which misses nothing. Sets the bounds of misses and
   errors: what was counted, and two standard deviations more. */
static conemap_result conemap__plan_try(const conemap_plan_desc *desc, float depth, float lowest,
                                        conemap_planned *planned) {
    conemap_ray rays[CONEMAP__PLAN_BATCH];
    conemap_hit hits[CONEMAP__PLAN_BATCH], truth[CONEMAP__PLAN_BATCH];
    float lengths[CONEMAP__PLAN_BATCH];
    double missed = 0.0, sum = 0.0, squares = 0.0, count = (double)CONEMAP__PLAN_TRIAL;
    double size = (double)conemap__maxi(desc->statistics.width, desc->statistics.height);
    conemap_desc build;
    conemap_trace_desc walk;
    conemap_map map;
    conemap_result result;
    int first, k;
    memset(&build, 0, sizeof build);
    memset(&walk, 0, sizeof walk);
    build.heights = *desc->heights;
    build.allocator = desc->allocator;
    build.generator = planned->generator;
    build.guarantee = planned->guarantee;
    build.min3x3 = planned->min3x3;
    build.texture.per_cell = planned->texture.per_cell;
    build.keep_pyramid = 1;
    walk.tracer = CONEMAP_TRACE_MAXMIP;
    result = conemap_build(&build, &map);
    for (first = 0; result == CONEMAP_OK && first < CONEMAP__PLAN_TRIAL; first += CONEMAP__PLAN_BATCH) {
        for (k = 0; k < CONEMAP__PLAN_BATCH; ++k)
            lengths[k] = conemap__plan_ray(first + k, depth, lowest, &rays[k]);
        result = conemap_trace(&map, &walk, rays, truth, CONEMAP__PLAN_BATCH);
        if (result == CONEMAP_OK) result = conemap_trace(&map, &planned->trace, rays, hits, CONEMAP__PLAN_BATCH);
        for (k = 0; result == CONEMAP_OK && k < CONEMAP__PLAN_BATCH; ++k) {
            int met = truth[k].status == CONEMAP_HIT, meets = hits[k].status == CONEMAP_HIT;
            double apart = ((double)hits[k].t - (double)truth[k].t) * (double)lengths[k] * size;
            double before = ((double)(meets ? hits[k].t_before : hits[k].t) - (double)truth[k].t) * (double)lengths[k];
            if (!met && !meets) continue;         /* both see nothing, each to where it gives up */
            if (met && before * size > (meets ? 1.0 : 1e-3)) missed += 1.0; /* a hit's last texel is its refinement's */
            sum += apart < 0.0 ? -apart : apart;
            squares += apart * apart;
        }
    }
    conemap_free(&map);
    sum /= count;
    squares = squares / count - sum * sum;
    planned->missed = (float)conemap__mind((missed + 2.0 * sqrt(missed) + 1.0) / count, 1.0);
    planned->error = (float)(sum + 2.0 * sqrt(conemap__maxd(squares, 0.0) / count));
    return result;
}

/* ---- choices --------------------------------------------------------------------------------------------------- */

/* What a row of the table would take, and whether it could be chosen. cost: with its share of the build. */
static int conemap__plan_forecast(const conemap_plan_desc *desc, const conemap__plan_row *row, const float *terms,
                                  float cells, conemap_planned *planned, float *cost) {
    const conemap_statistics *s = &desc->statistics;
    const conemap__plan_fit *fit = &row->fit[conemap__plan_rough(s)];
    float risk = conemap__plan_risk(row, s, cells), texels = (float)s->width * (float)s->height;
    int term;
    memset(planned, 0, sizeof *planned);
    planned->generator = row->generator;
    planned->guarantee = row->guarantee;
    planned->min3x3 = row->min3x3;
    planned->texture.per_cell = row->per_cell;
    planned->texture.sectors = row->sectors;
    planned->keep_pyramid = row->tracer == CONEMAP_TRACE_MAXMIP || row->tracer == CONEMAP_TRACE_QDM;
    planned->prepared = row->prepared;
    planned->trace.tracer = row->tracer;
    planned->trace.refinement = row->refinement;
    planned->trace.max_steps = row->max_steps;
    for (term = 0; term < CONEMAP__PLAN_TERMS; ++term) planned->steps += fit->steps[term] * terms[term];
    if (row->max_steps) planned->steps = conemap__min(planned->steps, (float)row->max_steps);
    planned->time = fit->ray + fit->step * planned->steps;
    planned->build_time = row->build * texels;
    planned->missed = conemap__min(fit->missed * risk, 1.0f);
    planned->error = fit->error * risk;
    planned->within_budget = (desc->max_steps == 0.0f || planned->steps <= desc->max_steps) &&
                             (desc->max_time == 0.0f || planned->time <= desc->max_time);
    *cost = planned->time;
    if (desc->rays_per_build > 0.0f) *cost += planned->build_time / desc->rays_per_build;
    return !(row->prepared && desc->no_prepared) && !(row->sectors && desc->no_sectors);
}

/* Is it proven to miss nothing? */
CONEMAP__INLINE int conemap__plan_sure(const conemap__plan_row *row) {
    return row->prepared || row->tracer == CONEMAP_TRACE_MAXMIP ||
           (row->tracer == CONEMAP_TRACE_EXACT && row->guarantee == CONEMAP_GUARANTEE_BILINEAR);
}

CONEMAP__INLINE int conemap__plan_tolerates(const conemap_plan_desc *desc, const conemap_planned *planned) {
    return (desc->max_missed == 0.0f || planned->missed <= desc->max_missed) &&
           (desc->max_error == 0.0f || planned->error <= desc->max_error);
}

CONEMAP__DEF conemap_result conemap_plan(const conemap_plan_desc *desc, conemap_planned *planned) {
    const conemap_statistics *s;
    conemap_planned rows[CONEMAP__PLAN_ROWS];
    float depth, lowest, terms[CONEMAP__PLAN_TERMS], cells, costs[CONEMAP__PLAN_ROWS];
    int open[CONEMAP__PLAN_ROWS], k, best, tolerant;
    if (!planned) return CONEMAP_ERROR_NULL;
    memset(planned, 0, sizeof *planned);
    if (!desc) return CONEMAP_ERROR_NULL;
    s = &desc->statistics;
    if (s->width < 1 || s->height < 1 || s->width > CONEMAP_MAX_SIZE || s->height > CONEMAP_MAX_SIZE)
        return CONEMAP_ERROR_SIZE;
    if (desc->heights && (desc->heights->width != s->width || desc->heights->height != s->height))
        return CONEMAP_ERROR_SIZE;
    depth = desc->depth == 0.0f ? 0.25f : desc->depth;
    lowest = desc->lowest_elevation == 0.0f ? 5.0f : desc->lowest_elevation;
    for (k = 0; k < 4; ++k)
        if (!conemap__in_range(s->steps[k], 0.0f, 1e9f) || !conemap__in_range(s->safe_steps[k], 0.0f, 1e9f) ||
            !conemap__in_range(s->cells[k], 0.0f, 1e9f) || !conemap__in_range(s->way[k], 0.0f, 1.0f))
            return CONEMAP_ERROR_PARAMETER;
    if (!conemap__in_range(s->roughness, 0.0f, 1e6f) || !conemap__in_range(depth, 1e-6f, 1e6f) ||
        !conemap__in_range(lowest, 0.5f, 90.0f) || !conemap__in_range(desc->max_missed, 0.0f, 1.0f) ||
        !conemap__in_range(desc->max_error, 0.0f, 1e9f) || !conemap__in_range(desc->max_steps, 0.0f, 1e9f) ||
        !conemap__in_range(desc->max_time, 0.0f, 1e9f) || !conemap__in_range(desc->rays_per_build, 0.0f, 1e30f))
        return CONEMAP_ERROR_PARAMETER;
    tolerant = desc->max_missed > 0.0f || desc->max_error > 0.0f;
    cells = conemap__plan_terms(s, depth, lowest, terms);
    for (k = 0; k < (int)CONEMAP__PLAN_ROWS; ++k) {
        int sure = conemap__plan_sure(&conemap__plan_rows[k]);
        open[k] = conemap__plan_forecast(desc, &conemap__plan_rows[k], terms, cells, &rows[k], &costs[k]) &&
                  (sure || (tolerant && (desc->heights || conemap__plan_tolerates(desc, &rows[k]))));
    }
    for (;;) { /* until what is cheapest keeps the tolerances; the first row always does, and is always open */
        for (best = 0, k = 1; k < (int)CONEMAP__PLAN_ROWS; ++k)
            if (open[k] && (rows[k].within_budget > rows[best].within_budget ||
                            (rows[k].within_budget == rows[best].within_budget && costs[k] < costs[best])))
                best = k;
        if (desc->heights && !conemap__plan_sure(&conemap__plan_rows[best])) {
            conemap_result result = conemap__plan_try(desc, depth, lowest, &rows[best]);
            if (result != CONEMAP_OK) return result;
            open[best] = conemap__plan_tolerates(desc, &rows[best]);
        }
        if (open[best]) break;
    }
    *planned = rows[best];
    planned->texture.format = conemap__plan_format(desc, depth, lowest, planned->error);
    return CONEMAP_OK;
}

/* ======================================================================================================
   T R A C E R S

   A ray is clipped to the map once and followed in texel coordinates that start in the cell it enters, in a time
   scaled by a power of two so that its length does not matter. Times and positions are doubles: across 16384 texels a
   float is off by a thousandth of a texel, which on a wall is a thousandth of the box's height. The cell is
   walked, not recomputed: a step to a cell's border moves the cell index by one, and after a longer step the index
   never falls back. So every step gets somewhere, whatever the position's rounding says.
   ====================================================================================================== */

#define CONEMAP__APEX_SLACK (1.0f / 1048576.0f) /* cones are stepped from so far above their apex, whose own height is
                                                    off by about 1e-7 */

typedef struct conemap__walk {
    double px, py, pz;  /* at t = 0: texels from the centre of the base cell's lower corner, and height */
    double vx, vy, vz;  /* per t: texels, height */
    double speed;       /* horizontal, in uv with aspect, per t */
    double t, t_end;    /* now, and where the map or the ray ends */
    double z_end;       /* exact height at t_end */
    int base_i, base_j; /* the base cell on the map */
    int i, j;           /* the cell now, from the base cell */
    const float *cones; /* of the ray's sector */
    conemap_status end_status; /* of a ray that reaches t_end above the surface */
    /* back to the caller's units, and the ray for its positions */
    double t_start, t_scale;
    double t_gone;      /* where a ray that meets nothing ends: NOTHING's surface may end before the box does */
    const conemap_ray *ray;
} conemap__walk;

/* Narrows [t0, t1] to where low <= o + v t <= high; 0 if nothing is left. *axis_in and *axis_out, unless null, get
   `axis` where this slab decides. */
static int conemap__clip(double o, double v, double low, double high, int axis, double *t0, double *t1, int *axis_in,
                         int *axis_out) {
    double a, b;
    if (v == 0.0) return o >= low && o <= high;
    a = ((v > 0.0 ? low : high) - o) / v;
    b = ((v > 0.0 ? high : low) - o) / v;
    if (a > *t0) {
        *t0 = a;
        if (axis_in) *axis_in = axis;
    }
    if (b < *t1) {
        *t1 = b;
        if (axis_out) *axis_out = axis;
    }
    return *t0 <= *t1;
}

/* Puts a position on an axis of `cells` cells, which begin `shift` texels before the texels' own borders; returns the
   cell. */
static int conemap__enter_cells(double position, int size, conemap_wrap wrap, double shift, int cells, double *place) {
    double x;
    int cell, first = shift > 0.0 ? -conemap__first_cell(wrap) : 0;
    position = wrap == CONEMAP_WRAP ? conemap__fraction(position) : conemap__clamp01(position); /* far origins cancel
                                                                                                   badly */
    x = position * (double)size - shift;
    cell = conemap__floord(x);
    if (wrap != CONEMAP_WRAP) cell = conemap__maxi(first, conemap__mini(cell, first + cells - 1)); /* clipping is off by
                                                                                                      a last bit */
    *place = conemap__clamp01(x - (double)cell);
    return cell;
}

/* The same for bilinear cells: puts an axis of the walk into texels. */
static int conemap__enter_axis(double position, int size, conemap_wrap wrap, double *place) {
    return conemap__enter_cells(position, size, wrap, 0.5, conemap__cell_count(size, wrap), place);
}

/* Sets a walk up. Returns 0 for a ray that never gets above or below the surface; walk->end_status and t_end then
   say how it ends all the same. */
static int conemap__enter(const conemap_map *map, const conemap_ray *ray, conemap__walk *walk) {
    const conemap_info *info = &map->info;
    double o[3], v[3], longest = 0.0, power, t0, t1, box0, box1, low_u, low_v, reach, far_end;
    int k, out = 3, box_out = 3, meets, in_box;
    for (k = 0; k < 3; ++k) {
        o[k] = (double)ray->origin[k];
        v[k] = (double)ray->direction[k];
        if (v[k] > longest) longest = v[k];
        if (-v[k] > longest) longest = -v[k];
    }
    power = conemap__normalising_power(longest);
    for (k = 0; k < 3; ++k) {
        v[k] *= power;
        if (v[k] < 1e-30 && v[k] > -1e-30) v[k] = 0.0; /* too little to cross a texel, enough to overflow */
    }
    far_end = CONEMAP__NEVER;
    box0 = (double)ray->t_min / power;
    box1 = ray->t_max == 0.0f || !conemap__finite(ray->t_max) ? far_end : (double)ray->t_max / power;

    /* The unit box says how a ray that meets nothing ends; the surface may end half a texel before. */
    in_box = conemap__clip(o[2], v[2], 0.0, 1.0, 2, &box0, &box1, NULL, &box_out);
    if (info->wrap_u != CONEMAP_WRAP)
        in_box = conemap__clip(o[0], v[0], 0.0, 1.0, 0, &box0, &box1, NULL, &box_out) && in_box;
    if (info->wrap_v != CONEMAP_WRAP)
        in_box = conemap__clip(o[1], v[1], 0.0, 1.0, 1, &box0, &box1, NULL, &box_out) && in_box;
    t0 = box0;
    t1 = box1;
    out = box_out;
    low_u = info->wrap_u == CONEMAP_NOTHING ? 0.5 / (double)info->width : 0.0;
    low_v = info->wrap_v == CONEMAP_NOTHING ? 0.5 / (double)info->height : 0.0;
    meets = in_box;
    if (meets && info->wrap_u == CONEMAP_NOTHING)
        meets = conemap__clip(o[0], v[0], low_u, 1.0 - low_u, 0, &t0, &t1, NULL, &out);
    if (meets && info->wrap_v == CONEMAP_NOTHING)
        meets = conemap__clip(o[1], v[1], low_v, 1.0 - low_v, 1, &t0, &t1, NULL, &out);

    memset(walk, 0, sizeof *walk);
    walk->ray = ray;
    walk->cones = map->cones + (size_t)conemap__sector_number(info, v[0], v[1]) * conemap__texels(map);
    walk->t_scale = power;
    walk->end_status = !in_box                       ? CONEMAP_LEFT
                       : box_out == 3                ? CONEMAP_T_MAX
                       : box_out == 2 && v[2] < 0.0 ? CONEMAP_FLOOR
                                                     : CONEMAP_LEFT;
    walk->t_gone = in_box ? box1 : (double)ray->t_min / power;
    if (!meets) return 0;
    /* Past its reach a wrapping ray is given up. */
    reach = (double)CONEMAP__REACH / ((v[0] < 0.0 ? -v[0] : v[0]) * (double)info->width +
                                      (v[1] < 0.0 ? -v[1] : v[1]) * (double)info->height + 1e-30);
    if (t1 - t0 > reach) {
        t1 = t0 + reach;
        out = 3;
        walk->end_status = CONEMAP_STEP_CAP;
        walk->t_gone = t1;
    }
    walk->t_start = t0;
    walk->base_i = conemap__enter_axis(o[0] + v[0] * t0, info->width, info->wrap_u, &walk->px);
    walk->base_j = conemap__enter_axis(o[1] + v[1] * t0, info->height, info->wrap_v, &walk->py);
    walk->pz = conemap__clamp01(o[2] + v[2] * t0);
    walk->vx = v[0] * (double)info->width;
    walk->vy = v[1] * (double)info->height;
    walk->vz = v[2];
    walk->speed = sqrt(v[0] * v[0] + (double)info->aspect * (double)info->aspect * v[1] * v[1]);
    walk->t_end = t1 - t0;
    /* A ray that ends on the floor ends at 0 exactly, so that no rounding slips it through flat ground. */
    walk->z_end = out == 2 ? (v[2] < 0.0 ? 0.0 : 1.0) : conemap__clamp01(o[2] + v[2] * t1);
    return 1;
}

CONEMAP__INLINE double conemap__ray_z(const conemap__walk *walk, double t) {
    return t >= walk->t_end ? walk->z_end : walk->pz + walk->vz * t;
}

/* When the ray leaves the span [low, high] of cell borders along one axis. */
CONEMAP__INLINE double conemap__leave(double p, double v, int low, int high) {
    return v > 0.0 ? ((double)high - p) / v : v < 0.0 ? ((double)low - p) / v : CONEMAP__NEVER;
}

/* The cell of a position along one axis: never behind the cell before, whatever rounding says. */
CONEMAP__INLINE int conemap__advance(double p, double v, double t, int cell) {
    int next = conemap__floord(p + v * t);
    return v > 0.0 ? conemap__maxi(next, cell) : v < 0.0 ? conemap__mini(next, cell) : cell;
}

/* Moves the walk to t, beyond the borders of the present cell. */
CONEMAP__INLINE void conemap__jump(conemap__walk *walk, double t) {
    walk->i = conemap__advance(walk->px, walk->vx, t, walk->i);
    walk->j = conemap__advance(walk->py, walk->vy, t, walk->j);
    walk->t = t;
}

CONEMAP__INLINE conemap__quad conemap__walk_quad(const conemap_map *map, const conemap__walk *walk) {
    return conemap__cell_quad(map, walk->base_i + walk->i, walk->base_j + walk->j);
}

/* The place inside the present cell; rounding may put the position a little outside. */
CONEMAP__INLINE double conemap__place(double p, double v, double t, int cell) {
    return conemap__clamp01(p + v * t - (double)cell);
}

/* Height and cone under the ray in the present cell. */
CONEMAP__INLINE conemap__mix conemap__under(const conemap_map *map, const conemap__walk *walk) {
    return conemap__sample_cell(map, walk->cones, conemap__walk_quad(map, walk),
                                (float)conemap__place(walk->px, walk->vx, walk->t, walk->i),
                                (float)conemap__place(walk->py, walk->vy, walk->t, walk->j));
}

/* The same at any time of the walk, for tracers that do not walk cells. */
static conemap__mix conemap__mix_at(const conemap_map *map, const conemap__walk *walk, double t) {
    conemap__walk there = *walk;
    there.t = t;
    there.i = conemap__floord(walk->px + walk->vx * t);
    there.j = conemap__floord(walk->py + walk->vy * t);
    return conemap__under(map, &there);
}

/* Ray height over the surface. */
static double conemap__clearance(const conemap_map *map, const conemap__walk *walk, double t) {
    return conemap__ray_z(walk, t) - (double)conemap__mix_at(map, walk, t).height;
}

/* How far a ray that is `gap` over a cone's apex flies inside the cone: tan gap / (|v_xy| - tan v_z), the form of
   [BV24 Algorithm 1] that a cone of tan = 0 survives. A vertical ray meets the surface at its apex. */
CONEMAP__INLINE double conemap__cone_step(const conemap__walk *walk, float tangent, double gap) {
    double closing = walk->speed - (double)tangent * walk->vz;
    if (walk->speed == 0.0) return walk->vz < 0.0 ? gap / -walk->vz : CONEMAP__NEVER;
    return closing > 0.0 ? (double)tangent * gap / closing : CONEMAP__NEVER;
}

/* c + b x + a x^2 */
typedef struct conemap__quadratic {
    double c, b, a;
} conemap__quadratic;

/* The first x in 0..end at which the quadratic is 0 or below; NEVER if there is none. In the form that does not
   cancel. */
CONEMAP__INLINE double conemap__first_zero(conemap__quadratic p, double end) {
    double discriminant = p.b * p.b - 4.0 * p.a * p.c, q, first, second;
    if (p.c <= 0.0) return 0.0;
    if (discriminant < 0.0) return CONEMAP__NEVER;
    q = -0.5 * (p.b + (p.b < 0.0 ? -sqrt(discriminant) : sqrt(discriminant)));
    first = q != 0.0 ? p.c / q : CONEMAP__NEVER;
    second = p.a != 0.0 ? q / p.a : CONEMAP__NEVER;
    if (first < 0.0) first = CONEMAP__NEVER;
    if (second >= 0.0 && second < first) first = second;
    return first <= end ? first : CONEMAP__NEVER;
}

/* First t in [0, end] at which the ray meets the patch, from a point at (x, y, z) in the cell; -1 if none. The
   quadratic is the clearance along the ray. */
static double conemap__patch_hit(const conemap__walk *walk, conemap__corners h, double x, double y, double z,
                                 double end) {
    double h00 = (double)h.h00, hx = (double)h.h10 - h00, hy = (double)h.h01 - h00;
    double hxy = (double)h.h11 - (double)h.h01 - hx;
    conemap__quadratic clearance;
    double t;
    clearance.c = z - (h00 + hx * x + hy * y + hxy * (x * y));
    clearance.b = walk->vz - (hx * walk->vx + hy * walk->vy + hxy * (x * walk->vy + y * walk->vx));
    clearance.a = -hxy * (walk->vx * walk->vy);
    t = conemap__first_zero(clearance, end);
    return t < CONEMAP__NEVER ? t : -1.0;
}

/* ---- results ---------------------------------------------------------------------------------------- */

static float conemap__caller_t(const conemap__walk *walk, double t) {
    return (float)((walk->t_start + t) * walk->t_scale);
}

static void conemap__put_position(const conemap__walk *walk, double along, conemap_hit *hit) {
    hit->t = (float)along;
    hit->u = (float)((double)walk->ray->origin[0] + along * (double)walk->ray->direction[0]);
    hit->v = (float)((double)walk->ray->origin[1] + along * (double)walk->ray->direction[1]);
    hit->z = (float)((double)walk->ray->origin[2] + along * (double)walk->ray->direction[2]);
}

/* A hit, or a step cap where all three times are how far the ray came. */
static void conemap__finish(const conemap__walk *walk, conemap_status status, double before, double t,
                            double after, int steps, conemap_hit *hit) {
    conemap__put_position(walk, (walk->t_start + t) * walk->t_scale, hit);
    hit->status = status;
    hit->inside = status == CONEMAP_HIT && after <= 0.0;
    hit->t_before = conemap__caller_t(walk, before);
    hit->t_after = conemap__caller_t(walk, after);
    hit->steps = steps;
}

/* A ray that met nothing. */
static void conemap__miss(const conemap__walk *walk, int steps, conemap_hit *hit) {
    conemap__put_position(walk, walk->t_gone * walk->t_scale, hit);
    hit->status = walk->end_status;
    hit->inside = 0;
    hit->t_before = hit->t_after = hit->t;
    hit->steps = steps;
}

/* Narrows the bracket (above before, at or below after) and chooses the hit in it; `guess` without refinement. */
static void conemap__refine(const conemap_map *map, const conemap_trace_desc *desc, const conemap__walk *walk,
                            double before, double guess, double after, int steps, conemap_hit *hit) {
    int k;
    if (before < after && desc->refinement == CONEMAP_REFINE_SECANT) {
        double above = conemap__clearance(map, walk, before), below = conemap__clearance(map, walk, after);
        if (above > below) guess = before + (after - before) * (above / (above - below));
        guess = guess < before ? before : guess > after ? after : guess;
    } else if (before < after && desc->refinement == CONEMAP_REFINE_BISECT) {
        for (k = 0; k < desc->refine_steps; ++k) {
            double middle = 0.5 * (before + after);
            if (conemap__clearance(map, walk, middle) > 0.0)
                before = middle;
            else
                after = middle;
        }
        guess = 0.5 * (before + after);
    }
    conemap__finish(walk, CONEMAP_HIT, before, guess, after, steps, hit);
}

/* ---- tracers: each fills in *hit for a walk that meets the map ------------------------------------------- */

static void conemap__trace_linear(const conemap_map *map, const conemap_trace_desc *desc, conemap__walk *walk,
                                  conemap_hit *hit) {
    double before = 0.0, t = 0.0;
    int k;
    for (k = 0; k <= desc->max_steps; ++k) {
        t = k < desc->max_steps ? walk->t_end * ((double)k / (double)desc->max_steps) : walk->t_end;
        if (conemap__clearance(map, walk, t) <= 0.0) {
            conemap__refine(map, desc, walk, before, t, t, k, hit);
            return;
        }
        before = t;
    }
    conemap__miss(walk, desc->max_steps, hit);
}

/* [Dum06] _fixed and _loop: a number of cone steps without any test in between; steps may lead back. */
static void conemap__trace_loop(const conemap_map *map, const conemap_trace_desc *desc, conemap__walk *walk,
                                conemap_hit *hit) {
    double before = 0.0, t = 0.0, gap;
    int k, steps = desc->tracer == CONEMAP_TRACE_FIXED ? 10 : desc->max_steps;
    if (desc->tracer == CONEMAP_TRACE_LOOP && desc->adaptive_steps) {
        double x = walk->vx / (double)map->info.width, y = walk->vy / (double)map->info.height;
        steps = (int)((double)steps * (0.5 + sqrt((x * x + y * y) / (x * x + y * y + walk->vz * walk->vz))));
    }
    for (k = 0; k < steps; ++k) {
        conemap__mix mix = conemap__mix_at(map, walk, t);
        gap = conemap__ray_z(walk, t) - (double)mix.height;
        if (gap > 0.0) before = t;
        if (gap <= 0.0 && k == 0) { /* a ray that begins inside has hit */
            conemap__finish(walk, CONEMAP_HIT, t, t, t, k, hit);
            return;
        }
        t += (double)desc->step_scale * conemap__cone_step(walk, mix.tangent, gap);
        t = t < 0.0 ? 0.0 : t > walk->t_end ? walk->t_end : t;
    }
    gap = conemap__clearance(map, walk, t);
    if (gap <= 0.0 && before < t)
        conemap__refine(map, desc, walk, before, t, t, steps, hit);
    else if (gap <= (double)desc->tolerance)
        conemap__finish(walk, CONEMAP_HIT, t, t, t, steps, hit);
    else if (t >= walk->t_end)
        conemap__miss(walk, steps, hit);
    else
        conemap__finish(walk, CONEMAP_STEP_CAP, t, t, t, steps, hit);
}

/* [Dum06] _exact: a texel's width beyond the cone, so that the ray pierces the surface; then back off. */
static void conemap__trace_exact_step(const conemap_map *map, const conemap_trace_desc *desc, conemap__walk *walk,
                                      conemap_hit *hit) {
    double x = walk->vx / (double)map->info.width, y = walk->vy / (double)map->info.height;
    double texel = 1.0 / (double)conemap__maxi(map->info.width, map->info.height);
    double extra = texel / sqrt(x * x + y * y + walk->vz * walk->vz), before = 0.0, t = 0.0;
    int steps = 0;
    for (;;) {
        conemap__mix mix = conemap__mix_at(map, walk, t);
        double gap = conemap__ray_z(walk, t) - (double)mix.height;
        if (gap <= 0.0) {
            conemap__refine(map, desc, walk, before, t - extra > before ? t - extra : before, t, steps, hit);
            return;
        }
        if (t >= walk->t_end) break;
        if (desc->max_steps && steps >= desc->max_steps) {
            conemap__finish(walk, CONEMAP_STEP_CAP, t, t, t, steps, hit);
            return;
        }
        before = t;
        t += (double)desc->step_scale * conemap__cone_step(walk, mix.tangent, gap) + extra;
        if (t > walk->t_end) t = walk->t_end;
        ++steps;
    }
    conemap__miss(walk, steps, hit);
}

/* When the walk meets the first border of its cell or block: never before now. */
CONEMAP__INLINE double conemap__next_border(const conemap__walk *walk, double leave_i, double leave_j) {
    double leave = leave_i < leave_j ? leave_i : leave_j;
    return leave > walk->t ? leave : walk->t;
}

/* To the end of the cone or of the cell, whichever is farther, or to the ray's end. */
CONEMAP__INLINE void conemap__step_on(conemap__walk *walk, double cone, double leave_i, double leave_j,
                                      double leave) {
    int vertical = walk->vx == 0.0 && walk->vy == 0.0; /* meets no border: its cone ends on the surface */
    if (cone >= walk->t_end || (leave >= walk->t_end && !vertical) || (vertical && cone <= walk->t)) {
        conemap__jump(walk, walk->t_end);
    } else if (cone > leave || vertical) {
        conemap__jump(walk, cone);
    } else {
        if (leave_i <= leave_j) walk->i += walk->vx > 0.0 ? 1 : -1;
        if (leave_j <= leave_i) walk->j += walk->vy > 0.0 ? 1 : -1;
        walk->t = leave;
    }
}

/* [BV24] Algorithm 1: to the end of the cone or of the bilinear cell, whichever is farther. */
static void conemap__trace_cell_max(const conemap_map *map, const conemap_trace_desc *desc, conemap__walk *walk,
                                    conemap_hit *hit) {
    double before = 0.0;
    int steps = 0;
    for (;;) {
        conemap__mix mix = conemap__under(map, walk);
        double gap = conemap__ray_z(walk, walk->t) - (double)mix.height, leave_i, leave_j, leave, cone;
        if (gap <= 0.0) {
            conemap__refine(map, desc, walk, before, walk->t, walk->t, steps, hit);
            return;
        }
        if (walk->t >= walk->t_end) break;
        if (desc->max_steps && steps >= desc->max_steps) {
            conemap__finish(walk, CONEMAP_STEP_CAP, walk->t, walk->t, walk->t, steps, hit);
            return;
        }
        before = walk->t;
        leave_i = conemap__leave(walk->px, walk->vx, walk->i, walk->i + 1);
        leave_j = conemap__leave(walk->py, walk->vy, walk->j, walk->j + 1);
        leave = conemap__next_border(walk, leave_i, leave_j);
        cone = walk->t + (double)desc->step_scale * conemap__cone_step(walk, mix.tangent, gap);
        conemap__step_on(walk, cone, leave_i, leave_j, leave);
        ++steps;
    }
    conemap__miss(walk, steps, hit);
}

/* How long the walk flies until it meets the patch of its cell before `end`, exactly; -1 if it does not. */
CONEMAP__INLINE double conemap__walk_hit(const conemap__walk *walk, conemap__corners h, double end) {
    double x = conemap__place(walk->px, walk->vx, walk->t, walk->i);
    double y = conemap__place(walk->py, walk->vy, walk->t, walk->j);
    double hit = conemap__patch_hit(walk, h, x, y, conemap__ray_z(walk, walk->t), end - walk->t);
    /* On the ray's end the height is exact, which the quadratic's is not. */
    if (hit < 0.0 && end >= walk->t_end &&
        walk->z_end <= (double)conemap__bilinear(h, (float)conemap__place(walk->px, walk->vx, end, walk->i),
                                                 (float)conemap__place(walk->py, walk->vy, end, walk->j)))
        hit = end - walk->t;
    return hit;
}

/* The same with the clearance interpolated between the two ends of the way through the cell. */
CONEMAP__INLINE double conemap__linear_hit(const conemap__walk *walk, conemap__corners h, double end) {
    double above = conemap__ray_z(walk, walk->t) -
                   (double)conemap__bilinear(h, (float)conemap__place(walk->px, walk->vx, walk->t, walk->i),
                                             (float)conemap__place(walk->py, walk->vy, walk->t, walk->j));
    double below = conemap__ray_z(walk, end) -
                   (double)conemap__bilinear(h, (float)conemap__place(walk->px, walk->vx, end, walk->i),
                                             (float)conemap__place(walk->py, walk->vy, end, walk->j));
    if (above <= 0.0) return 0.0;
    return below <= 0.0 ? (end - walk->t) * (above / (above - below)) : -1.0;
}

/* Relaxed cones are for falling rays; others walk from cell to cell instead. */
static int conemap__falls_back(const conemap_map *map, const conemap__walk *walk) {
    return walk->vz >= 0.0 && (map->info.guarantee == CONEMAP_GUARANTEE_RELAXED ||
                               map->info.guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR);
}

/* Cone stepping that misses nothing: in every cell that the ray enters it is met with the bilinear patch itself,
   and only then goes on to the end of the cone or of the cell. No step is shorter than to a border, so W + H + 2 cells
   at most lie between two cones, and neither an epsilon nor a cap is needed. A hit is the first one if the
   interpolated cones are safe. A cone that ends below the surface was not, or was a relaxed one: then the way back is
   walked cell by cell, which finds the first meeting in it. */
static void conemap__trace_exact(const conemap_map *map, const conemap_trace_desc *desc, conemap__walk *walk,
                                 conemap_hit *hit) {
    double cone_t = 0.0, walk_until = -1.0; /* where the last cone began; no cones before this time */
    int cone_i = walk->i, cone_j = walk->j, steps = 0, cones = !conemap__falls_back(map, walk);
    for (;;) {
        conemap__quad quad = conemap__walk_quad(map, walk);
        conemap__corners h = conemap__gather(map->heights, quad);
        double leave_i = conemap__leave(walk->px, walk->vx, walk->i, walk->i + 1);
        double leave_j = conemap__leave(walk->py, walk->vy, walk->j, walk->j + 1);
        double leave = conemap__next_border(walk, leave_i, leave_j), end = leave < walk->t_end ? leave : walk->t_end;
        double z = conemap__ray_z(walk, walk->t), z_end = conemap__ray_z(walk, end), top = (double)conemap__highest(h);
        double t, gap, cone = walk->t;
        ++steps;
        /* A rising ray is lowest where it enters, a falling one where it leaves. */
        if (z <= top || z_end <= top) {
            t = conemap__walk_hit(walk, h, end);
            if (t == 0.0 && cone_t < walk->t && walk_until < walk->t && !desc->any_hit) {
                walk_until = walk->t;
                walk->t = cone_t;
                walk->i = cone_i;
                walk->j = cone_j;
                continue;
            }
            if (t >= 0.0) {
                t += walk->t;
                conemap__finish(walk, CONEMAP_HIT, t, t, t, steps, hit);
                return;
            }
        }
        if (end >= walk->t_end || (walk->vz >= 0.0 && z > (double)map->highest)) break;
        if (desc->max_steps && steps >= desc->max_steps) {
            conemap__finish(walk, CONEMAP_STEP_CAP, walk->t, walk->t, walk->t, steps, hit);
            return;
        }
        if (cones && walk->t >= walk_until) {
            conemap__mix mix = conemap__under(map, walk);
            gap = z - (double)mix.height - (double)CONEMAP__APEX_SLACK;
            if (gap > 0.0) cone += (double)desc->step_scale * conemap__cone_step(walk, mix.tangent, gap);
        }
        cone_t = walk->t;
        cone_i = walk->i;
        cone_j = walk->j;
        conemap__step_on(walk, cone, leave_i, leave_j, leave);
        if (cone <= leave) cone_t = walk->t; /* it was a step to a border, which passes nothing over */
    }
    conemap__miss(walk, steps, hit);
}

/* A block of the cell pyramid under the walk: its borders in walk coordinates and its maximum. */
typedef struct conemap__block {
    int low_i, high_i, low_j, high_j;
    float highest;
} conemap__block;

static void conemap__block_axis(int cell, int count, int k, int *node, int *low, int *high) {
    int wrapped = conemap__repeat(cell, count);
    *node = wrapped >> k;
    *low = (*node << k) - wrapped;
    *high = conemap__mini((*node + 1) << k, count) - wrapped;
}

static conemap__block conemap__block_under(const conemap_map *map, const conemap__walk *walk, int k) {
    conemap__block b;
    int node_i, node_j;
    conemap__block_axis(walk->base_i + walk->i + conemap__first_cell(map->info.wrap_u), map->cells.width[0], k,
                        &node_i, &b.low_i, &b.high_i);
    conemap__block_axis(walk->base_j + walk->j + conemap__first_cell(map->info.wrap_v), map->cells.height[0], k,
                        &node_j, &b.low_j, &b.high_j);
    b.low_i += walk->i;
    b.high_i += walk->i;
    b.low_j += walk->j;
    b.high_j += walk->j;
    b.highest = k == 0 ? conemap__cell_max(map, node_i, node_j) : conemap__block_max(&map->cells, k, node_i, node_j);
    return b;
}

/* Leaves a block at time t through the borders that come first: the cell behind them, and for the other axis the
   cell of the position, kept inside the block. */
static void conemap__leave_block(conemap__walk *walk, const conemap__block *b, double leave_i, double leave_j,
                                 double t) {
    int i = conemap__advance(walk->px, walk->vx, t, walk->i);
    int j = conemap__advance(walk->py, walk->vy, t, walk->j);
    walk->i = leave_i <= leave_j ? (walk->vx > 0.0 ? b->high_i : b->low_i - 1)
                                 : conemap__maxi(b->low_i, conemap__mini(i, b->high_i - 1));
    walk->j = leave_j <= leave_i ? (walk->vy > 0.0 ? b->high_j : b->low_j - 1)
                                 : conemap__maxi(b->low_j, conemap__mini(j, b->high_j - 1));
    walk->t = t;
}

/* Max-mipmap walk [TIS08] and quadtree displacement mapping [Dro18]: blocks that the ray flies over are left behind
   whole, others are entered a level deeper; after each block that is left, one level up. In a single cell,
   [TIS08] solves for the bilinear patch, [Dro18] interpolates between the cell's two ends. */
static void conemap__trace_blocks(const conemap_map *map, const conemap_trace_desc *desc, conemap__walk *walk,
                                  conemap_hit *hit) {
    int top = map->cells.levels - 1, k = top, steps = 0, exact = desc->tracer == CONEMAP_TRACE_MAXMIP;
    for (;;) {
        conemap__block b;
        double leave_i, leave_j, end, low, low_end;
        if (desc->max_steps && steps >= desc->max_steps) {
            conemap__finish(walk, CONEMAP_STEP_CAP, walk->t, walk->t, walk->t, steps, hit);
            return;
        }
        ++steps;
        b = conemap__block_under(map, walk, k);
        leave_i = conemap__leave(walk->px, walk->vx, b.low_i, b.high_i);
        leave_j = conemap__leave(walk->py, walk->vy, b.low_j, b.high_j);
        end = conemap__next_border(walk, leave_i, leave_j);
        if (end > walk->t_end) end = walk->t_end;
        low = conemap__ray_z(walk, walk->t);
        low_end = conemap__ray_z(walk, end);
        if (low_end < low) low = low_end;
        if (low <= (double)b.highest && k > 0) {
            if (!exact && walk->vz < 0.0) { /* [Dro18] goes on to the block's top before it goes deeper */
                double t = ((double)b.highest - walk->pz) / walk->vz;
                if (t > walk->t && t < end) {
                    walk->i = conemap__maxi(b.low_i, conemap__mini(conemap__advance(walk->px, walk->vx, t, walk->i),
                                                                   b.high_i - 1));
                    walk->j = conemap__maxi(b.low_j, conemap__mini(conemap__advance(walk->py, walk->vy, t, walk->j),
                                                                   b.high_j - 1));
                    walk->t = t;
                }
            }
            --k;
            continue;
        }
        if (low <= (double)b.highest) {
            conemap__corners h = conemap__gather(map->heights, conemap__walk_quad(map, walk));
            double t = exact ? conemap__walk_hit(walk, h, end) : conemap__linear_hit(walk, h, end);
            if (t >= 0.0) {
                t += walk->t;
                conemap__finish(walk, CONEMAP_HIT, t, t, t, steps, hit);
                return;
            }
        }
        if (end >= walk->t_end) {
            conemap__miss(walk, steps, hit);
            return;
        }
        conemap__leave_block(walk, &b, leave_i, leave_j, end);
        k = conemap__mini(k + 1, top);
    }
}

/* Checks trace settings and writes their defaults out. */
static conemap_result conemap__resolve_trace(conemap_trace_desc *desc) {
    if (!CONEMAP__KNOWN(desc->tracer, CONEMAP_TRACER_COUNT) ||
        !CONEMAP__KNOWN(desc->refinement, CONEMAP_REFINEMENT_COUNT))
        return CONEMAP_ERROR_ENUM;
    if (desc->refine_steps < 0 || desc->refine_steps > 64 || desc->max_steps < 0 ||
        desc->max_steps > (1 << 30) ||
        !conemap__in_range(desc->step_scale, 0.0f, 1e6f) || !conemap__in_range(desc->tolerance, 0.0f, 1.0f))
        return CONEMAP_ERROR_PARAMETER;
    if (desc->tracer == CONEMAP_TRACE_DEFAULT) desc->tracer = CONEMAP_TRACE_EXACT;
    if (desc->refine_steps == 0) desc->refine_steps = 7;
    if (desc->max_steps == 0 && desc->tracer == CONEMAP_TRACE_LINEAR) desc->max_steps = 200;
    if (desc->max_steps == 0 && desc->tracer == CONEMAP_TRACE_LOOP) desc->max_steps = 20;
    if (desc->step_scale == 0.0f) desc->step_scale = 1.0f;
    if (desc->tolerance == 0.0f) desc->tolerance = 1.0f / 256.0f;
    return CONEMAP_OK;
}

static void conemap__trace_ray(const conemap_map *map, const conemap_trace_desc *desc, const conemap_ray *ray,
                               conemap_hit *hit) {
    conemap__walk walk;
    hit->fallback = 0;
    if (!conemap__enter(map, ray, &walk)) {
        conemap__miss(&walk, 0, hit);
        return;
    }
    switch (desc->tracer) {
    case CONEMAP_TRACE_LINEAR: conemap__trace_linear(map, desc, &walk, hit); break;
    case CONEMAP_TRACE_FIXED:
    case CONEMAP_TRACE_LOOP: conemap__trace_loop(map, desc, &walk, hit); break;
    case CONEMAP_TRACE_EXACT_STEP: conemap__trace_exact_step(map, desc, &walk, hit); break;
    case CONEMAP_TRACE_MAXMIP:
    case CONEMAP_TRACE_QDM: conemap__trace_blocks(map, desc, &walk, hit); break;
    case CONEMAP_TRACE_CELL_MAX: conemap__trace_cell_max(map, desc, &walk, hit); break;
    default:
        conemap__trace_exact(map, desc, &walk, hit);
        hit->fallback = conemap__falls_back(map, &walk);
        break;
    }
}

CONEMAP__DEF conemap_result conemap_trace(const conemap_map *map, const conemap_trace_desc *desc,
                                          const conemap_ray *rays, conemap_hit *hits, int count) {
    conemap_trace_desc resolved;
    conemap_result result;
    int k;
    if (!map || !map->heights || ((!rays || !hits) && count != 0)) return CONEMAP_ERROR_NULL;
    if (count < 0) return CONEMAP_ERROR_PARAMETER;
    memset(&resolved, 0, sizeof resolved);
    if (desc) resolved = *desc;
    result = conemap__resolve_trace(&resolved);
    if (result != CONEMAP_OK) return result;
    if ((resolved.tracer == CONEMAP_TRACE_MAXMIP || resolved.tracer == CONEMAP_TRACE_QDM) && map->cells.levels == 0)
        return CONEMAP_ERROR_NO_PYRAMID;
    for (k = 0; k < count; ++k) {
        conemap_result ray_result = conemap__check_ray(&rays[k]);
        if (ray_result == CONEMAP_OK) {
            conemap__trace_ray(map, &resolved, &rays[k], &hits[k]);
        } else {
            memset(&hits[k], 0, sizeof hits[k]);
            hits[k].status = CONEMAP_INVALID;
            if (result == CONEMAP_OK) result = ray_result;
        }
    }
    return result;
}

/* ======================================================================================================
   P R E P A R A T I O N

   The table. A record belongs to a cell c of the map (the outer half cells of CLAMP have the same texels as their
   neighbours and share theirs). It is two words, for rays that fly forth and back along v, in a plane each, the second
   upside down, as those rays see it. A word holds the top in 12 bits, and for rays that fly forth and back along u a
   clear way and a slope in 5 bits each. Let R_k be the highest point of the square of cells whose corner is c and that
   reaches k cells beyond c along both axes of the quadrant, WRAP's images included. Then
       top >= R_0,   R_clear <= top,   R_k <= top + slope k  for all k >= 1.
   Distances and speeds are counted in cells along the faster axis, so no root is needed.

   Steps. A ray over c that has flown a distance s > 0 along its faster axis has flown no more along the other one, so
   it is over a cell at most ceil(s) cells from c along either. As the surface is continuous, what borders on a cell
   counts as the cell. So the surface under the ray is
       (a) at most top while it is over c;
       (b) at most top for s <= clear;
       (c) at most top + slope (s + 1) for every s, since ceil(s) < s + 1.
   At height z = top + gap, gap > 0, with vertical speed vz and V cells a time, it may therefore go on
       (a) to the border of c, or (b) for clear / V, but in both cases no longer than it stays above top: gap / -vz;
       (c) while gap + vz t >= slope (V t + 1), which is for (gap - slope) / (slope V - vz), or for ever.
   Flights are in floats, twice as many side by side. Where they do not get out of c for certain, the ray is close: the
   patch of c is met in doubles, as conemap__trace_exact meets it, for as long as the ray is over c. Each step leaves a
   cell behind, so no epsilon and no cap are needed. Cones play no part, and a ray that begins or ends at or below top
   is always judged by the patch.

   Flights in floats. Let N be the cells that a ray crosses (2^22 at most) and e = 2^-21 N. Positions, p + v t, are off
   by four roundings, e / 2 at most; so are times of borders, in cells. Heights are off by 2^-22, and by as much again
   through the two quotients, over whose times neither bound moves by more than 1: z begins 2^-19 too low. What holds at
   time t in cell c, with c counted from 0 along either axis as the ray flies, is
       (1) up to t, and up to where the ray comes to c, it is above the surface;
       (2) it is at c - 4 e at least, and at c + 1 + 4 e at most.
   By (2), s + 4 e counts for s: (b) flies clear - 8 e and (c) takes slope (s + 1 + 8 e), which pays for the roundings
   too. Then c becomes the cell of the position less e, whose error of e / 2 keeps it from being ahead of the ray: (1),
   and (2) as the position is e + e / 2 beyond that cell at most. (a) goes by the times of the two borders ahead, each
   moved to 2 e behind the border, `late`, and to 2 e before it, `early`. With the one late before the other is early
   there is no doubt which is met first, nor which cell comes next; with gap > 0 until late the rest of c is passed,
   which makes (1), and the time becomes early, (2). Otherwise, also along a border and through corners, the patch is
   met: in doubles c has an exact beginning and end, between which the ray is met from t on, if it is still there. The
   time after it is rounded down.

   Rounding. Heights are floats, top a multiple of 2^-12: rise, quotient and product in rise_row are off by less than
   3 2^-24 of themselves; the slope grows by 2^-19 of itself before it is rounded up to its 5 bits, the last of which
   stands for 1, and the ways are whole numbers. Between the reaches that these can tell, all squares up to the next
   reach count at the lower one. Patches are met in doubles: cell borders at times off by less than 4 2^-53 N cells'
   worth: on the steepest wall, a height of 1 in one cell, 2^-29 of height, far below the 2^-20 of a miss. Where a
   square wraps around the map more than once, it holds everything, and so does the last reach.
   ====================================================================================================== */

/* Distances that a record can tell: (4 + c % 4) / 4 * 2^(c / 4), where whole. */
static int conemap__reach(int code) {
    return ((4 + (code & 3)) << (code >> 2)) / 4;
}

static int conemap__next_reach(int code) {
    do ++code;
    while (code < 8 && ((4 + (code & 3)) << (code >> 2)) % 4 != 0);
    return code;
}

/* The table's cells along an axis. */
static int conemap__table_size(int size, conemap_wrap wrap) {
    return wrap == CONEMAP_WRAP ? size : conemap__maxi(size - 1, 1);
}

/* The work of a preparation: planes of the table's size, mirrored into the quadrant in question. */
typedef struct conemap__look {
    const conemap_map *map;
    const conemap__kernels *kernels;
    uint32_t *table;
    int w, h, flip_u, flip_v;
    float *tops;           /* of the cells, as the record will hold them */
    float *squares, *next; /* maxima over squares of cells from each cell on */
    int side;              /* of the squares */
    float *slopes;         /* the steepest seen so far */
    int32_t *clear;        /* the code of the widest clear way found */
    float *row;            /* 2 w */
} conemap__look;

/* The row `to`, beyond the table the last one or around it. */
CONEMAP__INLINE int conemap__look_index(int to, int size, conemap_wrap wrap) {
    return wrap == CONEMAP_WRAP ? to % size : conemap__mini(to, size - 1);
}

/* look->row[x] and look->row[x + d] become the maxima over rows y and y + d of what squares has; returns d along u. */
static int conemap__look_rows(const conemap__look *look, int y, int d) {
    const conemap_info *info = &look->map->info;
    size_t w = (size_t)look->w;
    int du = info->wrap_u == CONEMAP_WRAP ? d % look->w : conemap__mini(d, look->w), x;
    look->kernels->larger_row(look->squares + (size_t)y * w,
                              look->squares + (size_t)conemap__look_index(y + d, look->h, info->wrap_v) * w, look->w,
                              look->row);
    for (x = 0; x < du; ++x)
        look->row[look->w + x] = look->row[info->wrap_u == CONEMAP_WRAP ? x : look->w - 1];
    return du;
}

/* Squares twice as wide. */
static void conemap__look_double(conemap__look *look) {
    float *swap = look->next;
    int y;
    for (y = 0; y < look->h; ++y) {
        int du = conemap__look_rows(look, y, look->side);
        look->kernels->larger_row(look->row, look->row + du, look->w, look->next + (size_t)y * (size_t)look->w);
    }
    look->next = look->squares;
    look->squares = swap;
    look->side *= 2;
}

static void conemap__look_quadrant(conemap__look *look, int quadrant) {
    const conemap_map *map = look->map;
    int w = look->w, h = look->h, x, y, code, next;
    look->flip_u = quadrant & 1;
    look->flip_v = quadrant >> 1;
    look->side = 1;
    for (y = 0; y < h; ++y)
        for (x = 0; x < w; ++x) {
            size_t at = (size_t)y * (size_t)w + (size_t)x;
            float top = conemap__highest(conemap__gather(
                map->heights, conemap__cell_quad(map, look->flip_u ? w - 1 - x : x, look->flip_v ? h - 1 - y : y)));
            int level = (int)(top * 4096.0f);
            look->squares[at] = top;
            look->tops[at] = (float)(conemap__mini(level, 4095) + 1) / 4096.0f;
            look->slopes[at] = 0.0f;
            look->clear[at] = 0;
        }
    for (code = 0; conemap__reach(code) < conemap__maxi(w, h) && code < 63; code = next) {
        int side;
        next = conemap__next_reach(code);
        side = conemap__reach(next);
        while (2 * look->side < side) conemap__look_double(look);
        for (y = 0; y < h; ++y) {
            size_t at = (size_t)y * (size_t)w;
            int du = conemap__look_rows(look, y, side - look->side);
            look->kernels->rise_row(look->row, du, look->tops + at, 1.0f / (float)conemap__reach(code),
                                    conemap__mini(next, 31), w, look->slopes + at, look->clear + at);
        }
    }
    for (y = 0; y < h; ++y)
        for (x = 0; x < w; ++x) {
            size_t at = (size_t)y * (size_t)w + (size_t)x;
            uint32_t *record = &look->table[((size_t)(look->flip_v ? h : 0) + (size_t)y) * (size_t)w +
                                            (size_t)(look->flip_u ? w - 1 - x : x)];
            /* rounded up: what it stands for is no less, by 2^-20 at least */
            uint32_t bits = conemap__bits(look->slopes[at] * (1.0f + 1.0f / 524288.0f));
            int slope = (int)((bits + 0x1fffffu) >> 21) - 4 * (127 - 10);
            slope = conemap__maxi(0, conemap__mini(slope, 31));
            if (!look->flip_u) *record = ((uint32_t)(look->tops[at] * 4096.0f) - 1u) << 20;
            *record |= (uint32_t)(slope | look->clear[at] << 5) << (look->flip_u ? 10 : 0);
        }
}

CONEMAP__DEF size_t conemap_prepare_memory(const conemap_map *map) {
    size_t bytes = 0;
    if (!map || !map->heights ||
        !conemap__add_size(&bytes, (size_t)conemap__table_size(map->info.width, map->info.wrap_u) *
                                       (size_t)conemap__table_size(map->info.height, map->info.wrap_v),
                           2 * sizeof(uint32_t)))
        return 0;
    return bytes;
}

CONEMAP__DEF conemap_result conemap_prepare(const conemap_map *map, const conemap_prepare_desc *desc,
                                            conemap_prepared *prepared) {
    conemap_prepare_desc settings;
    conemap__look look;
    conemap_result result;
    void *work = NULL;
    size_t cells, bytes = 0;
    int quadrant, owns_work = 0;
    if (!prepared) return CONEMAP_ERROR_NULL;
    memset(prepared, 0, sizeof *prepared);
    if (!map || !map->heights) return CONEMAP_ERROR_NULL;
    memset(&settings, 0, sizeof settings);
    if (desc) settings = *desc;
    if ((settings.allocator.allocate == NULL) != (settings.allocator.release == NULL)) return CONEMAP_ERROR_NULL;
    if (!CONEMAP__KNOWN(settings.isa, CONEMAP_ISA_COUNT)) return CONEMAP_ERROR_ENUM;
    if (!conemap__resolve_isa(&settings.isa)) return CONEMAP_ERROR_UNSUPPORTED;

    memset(&look, 0, sizeof look);
    look.map = map;
    look.kernels = conemap__kernels_of(settings.isa);
    look.w = conemap__table_size(map->info.width, map->info.wrap_u);
    look.h = conemap__table_size(map->info.height, map->info.wrap_v);
    cells = (size_t)look.w * (size_t)look.h;
    prepared->memory_size = conemap_prepare_memory(map);
    if (prepared->memory_size == 0 || conemap__maxi(look.w, look.h) > 1 << 21 ||
        !conemap__add_size(&bytes, cells, 5 * sizeof(float)) ||
        !conemap__add_size(&bytes, (size_t)look.w, 2 * sizeof(float))) {
        memset(prepared, 0, sizeof *prepared);
        return CONEMAP_ERROR_OVERFLOW;
    }
    prepared->map = map;
    prepared->width = look.w;
    prepared->height = look.h;
    prepared->bytes_per_texel = (double)prepared->memory_size / (double)conemap__texels(map);
    prepared->isa = settings.isa;
    prepared->own.allocator = settings.allocator;
    result = conemap__take(&settings.allocator, settings.memory, settings.memory_size, prepared->memory_size,
                           &prepared->own.memory, &prepared->own.owns_memory);
    if (result == CONEMAP_OK) result = conemap__take(&settings.allocator, NULL, 0, bytes, &work, &owns_work);
    if (result == CONEMAP_OK) {
        prepared->table = look.table = (uint32_t *)prepared->own.memory;
        look.tops = (float *)work;
        look.squares = look.tops + cells;
        look.next = look.squares + cells;
        look.slopes = look.next + cells;
        look.clear = (int32_t *)(void *)(look.slopes + cells);
        look.row = look.slopes + 2 * cells;
        for (quadrant = 0; quadrant < 4; ++quadrant) conemap__look_quadrant(&look, quadrant);
    }
    conemap__release(&settings.allocator, work, owns_work);
    if (result != CONEMAP_OK) conemap_free_prepared(prepared);
    return result;
}

CONEMAP__DEF void conemap_free_prepared(conemap_prepared *prepared) {
    if (!prepared) return;
    conemap__release(&prepared->own.allocator, prepared->own.memory, prepared->own.owns_memory);
    memset(prepared, 0, sizeof *prepared);
}

/* ---- the way in and out ---------------------------------------------------------------------------------------- */

static void conemap__flight_axis_of(conemap__flight_axis *axis, int size, conemap_wrap wrap, int table_size,
                                    int texel_pitch) {
    axis->size = (double)size;
    axis->cells = (double)conemap__cell_count(size, wrap);
    axis->first = (double)conemap__first_cell(wrap);
    axis->low = wrap == CONEMAP_NOTHING ? 0.5 / (double)size : 0.0;
    axis->wraps = wrap == CONEMAP_WRAP;
    axis->period = axis->wraps ? (double)size : 0.0;
    axis->per_period = axis->wraps ? 1.0 / (double)size : 0.0;
    axis->table_first = (float)conemap__first_cell(wrap);
    axis->table_last = (float)(table_size - 1);
    axis->table_period = (float)size;
    axis->per_table_period = 1.0f / (float)size;
    axis->last_texel = (double)(size - 1);
    axis->texel_pitch = (double)texel_pitch;
    axis->before = axis->wraps ? (double)(size - 1) : 0.0;
    axis->after = axis->wraps ? 0.0 : (double)(size - 1);
}

static conemap_result conemap__fly_stream(const conemap_prepared *prepared, const conemap__stream *stream) {
    const conemap_info *info = &prepared->map->info;
    unsigned char room[(CONEMAP__SLOTS / CONEMAP__BLOCK + 1) * sizeof(conemap__block_of_rays) + 63];
    conemap__flight f;
    if (stream->count == 0) return CONEMAP_OK;
    f.blocks = (conemap__block_of_rays *)(void *)(room + (64 - (uintptr_t)room % 64) % 64); /* whole cache lines */
    f.waiting = f.blocks + CONEMAP__SLOTS / CONEMAP__BLOCK;
    f.table = prepared->table;
    f.pitch = prepared->width;
    f.heights = prepared->map->heights;
    f.stream = *stream;
    conemap__flight_axis_of(&f.axis[0], info->width, info->wrap_u, prepared->width, 1);
    conemap__flight_axis_of(&f.axis[1], info->height, info->wrap_v, prepared->height, info->width);
    conemap__kernels_of(prepared->isa)->fly(&f);
    return f.stream.result;
}

CONEMAP__DEF conemap_result conemap_trace_prepared(const conemap_prepared *prepared, const conemap_ray *rays,
                                                   conemap_hit *hits, int count) {
    conemap__stream stream;
    if (!prepared || !prepared->table || ((!rays || !hits) && count != 0)) return CONEMAP_ERROR_NULL;
    if (count < 0) return CONEMAP_ERROR_PARAMETER;
    memset(&stream, 0, sizeof stream);
    stream.rays = rays;
    stream.hits = hits;
    stream.count = count;
    return conemap__fly_stream(prepared, &stream);
}

CONEMAP__DEF conemap_result conemap_trace_arrays(const conemap_prepared *prepared, const conemap_ray_arrays *rays,
                                                 const conemap_hit_arrays *hits, int count) {
    conemap__stream stream;
    int k;
    if (!prepared || !prepared->table || !rays || !hits) return CONEMAP_ERROR_NULL;
    for (k = 0; k < 3; ++k)
        if ((!rays->origin[k] || !rays->direction[k]) && count != 0) return CONEMAP_ERROR_NULL;
    if (count < 0) return CONEMAP_ERROR_PARAMETER;
    memset(&stream, 0, sizeof stream);
    stream.ray_arrays = rays;
    stream.hit_arrays = hits;
    stream.count = count;
    return conemap__fly_stream(prepared, &stream);
}

/* ======================================================================================================
   E M I T T E R

   Snippets are written in words that GLSL, HLSL and C share, one table entry each. A snippet needs every other one that
   it names; the emitter follows these names from conemap_trace and writes what it met, needed ones first. So nothing
   unused comes out, and there is no list of needs to be kept.
     ?a,!b text    a line for emissions where flag a is set and b is not
     @move         lines that several tracers share; @<move the same, written four spaces to the left
     $NAME         a piece that depends on the desc
     conemap_x     gets the host's prefix; vec2, min, 1.0f and a few others become the dialect's words
   ====================================================================================================== */

#define CONEMAP__FLAGS(X)                                                                                           \
    X(glsl) X(hlsl) X(c) X(es) X(vulkan) X(exact) X(linear) X(loop) X(exact_step) X(cell_max) X(maxmip) X(qdm) X(blocks)\
    X(cones) X(secant) X(bisect) X(refined) X(adaptive) X(any) X(back) X(falling) X(wrap_u) X(wrap_v) X(wraps)      \
    X(nothing_u) X(nothing_v) X(nothing) X(per_cell) X(cone_only) X(hardware) X(gather) X(steps) X(status)          \
    X(t_range) X(cap) X(atlas) X(array) X(host) X(size_argument) X(size_asked) X(sqrt) X(radius) X(apart)           \
    X(debug) X(cone_texel) X(fragment) X(compute) X(located) X(uses_map) X(uses_heights) X(uses_maxima)             \
    X(sampler) X(arguments) X(discards) X(host_maxima) X(external) X(version) X(solves) X(kernel) X(ring)           \
    X(safe) X(store) X(steepest) X(unorm) X(half) X(pair) X(host_state) X(sectors) X(octants) X(both) X(uses_octants)\
    X(cells) X(texels) X(maxima) X(quick) X(search) X(improved) X(center) X(slopes) X(batched) X(levels) X(levelled)\
    X(argued)                                                                                                       \
    X(relief) X(cone_march) X(steps_march) X(linear_v) X(blends) X(vertex) X(camera) X(shaded) X(coded) X(halved)   \
    X(from_host) X(host_lines) X(from_buffer) X(from_uniforms) X(from_texture) X(from_texels) X(from_block)     \
    X(shading) X(clip) X(holes) X(curved) X(lod) X(fade) X(two_sided) X(world) X(smooth) X(normal_out) X(depth)     \
    X(hard) X(soft) X(lights) X(occlusion) X(sky) X(open) X(uv) X(colors) X(normal) X(gentle) X(place) X(looks)     \
    X(gradient) X(flight) X(numbers) X(settings) X(stored) X(walls) X(cuts) X(bounds) X(sized) X(greater) X(less)   \
    X(ranged) X(after) X(beside)
#define CONEMAP__FLAG_ITEM(name) conemap__flag_##name,
enum { CONEMAP__FLAGS(CONEMAP__FLAG_ITEM) conemap__flag_count };
#undef CONEMAP__FLAG_ITEM

typedef struct conemap__snippet {
    const char *name, *text;
} conemap__snippet;

static const conemap__snippet conemap__snippets[] = {
    /* The types that C lacks. */
    {"conemap_vec2", "typedef struct conemap_vec2 {\n"
                     "    float x, y;\n"
                     "} conemap_vec2;\n"},
    {"conemap_vec3", "typedef struct conemap_vec3 {\n"
                     "    float x, y, z;\n"
                     "} conemap_vec3;\n"},
    {"conemap_vec4", "typedef struct conemap_vec4 {\n"
                     "    float x, y, z, w;\n"
                     "} conemap_vec4;\n"},
    {"conemap_ivec2", "typedef struct conemap_ivec2 {\n"
                      "    int x, y;\n"
                      "} conemap_ivec2;\n"},
    {"conemap_ivec4", "typedef struct conemap_ivec4 {\n"
                      "    int x, y, z, w;\n"
                      "} conemap_ivec4;\n"},
    {"conemap_make_vec2", "static conemap_vec2 conemap_make_vec2(float x, float y) {\n"
                          "    conemap_vec2 v;\n"
                          "    v.x = x;\n"
                          "    v.y = y;\n"
                          "    return v;\n"
                          "}\n"},
    {"conemap_make_vec3", "static conemap_vec3 conemap_make_vec3(float x, float y, float z) {\n"
                          "    conemap_vec3 v;\n"
                          "    v.x = x;\n"
                          "    v.y = y;\n"
                          "    v.z = z;\n"
                          "    return v;\n"
                          "}\n"},
    {"conemap_make_vec4", "static conemap_vec4 conemap_make_vec4(float x, float y, float z, float w) {\n"
                          "    conemap_vec4 v;\n"
                          "    v.x = x;\n"
                          "    v.y = y;\n"
                          "    v.z = z;\n"
                          "    v.w = w;\n"
                          "    return v;\n"
                          "}\n"},
    {"conemap_make_ivec2", "static conemap_ivec2 conemap_make_ivec2(int x, int y) {\n"
                           "    conemap_ivec2 v;\n"
                           "    v.x = x;\n"
                           "    v.y = y;\n"
                           "    return v;\n"
                           "}\n"},
    {"conemap_clampi", "static int conemap_clampi(int i, int low, int high) {\n"
                       "    return i < low ? low : i > high ? high : i;\n"
                       "}\n"},

    /* ---- what comes back ---- */
    {"conemap_hit", "$STRUCT conemap_hit {\n"
                    "    bool found;\n"
                    "    float t;       // in lengths of the direction\n"
                    "    vec3 position; // u, v, z; u and v are not wrapped\n"
                    "?status     int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap\n"
                    "?steps     int steps;\n"
                    "?c } conemap_hit;\n"
                    "?!c };\n"},

    /* ---- the map ---- */
    {"conemap_size", "int2 conemap_size() {\n"
                     "    uint width, height$LAYERS;\n"
                     "    $ANY_TEXTURE.GetDimensions(width, height$LAYERS);\n"
                     "    return int2(int(width), int(height));\n"
                     "}\n"},
    {"conemap_repeat", "$FNint conemap_repeat(int i, int size) {\n"
                       "    return i - int(floor((float(i) + 0.5f) / float(size))) * size;\n"
                       "}\n"},
    {"conemap_texel", "$FN$TEXEL_TYPE conemap_texel(int i, int j$MAP_PARAMS) {\n"
                      "    return $TEXEL;\n"
                      "}\n"},
    {"conemap_cone", "// The cone as stored, for rays of a sector: see conemap_sector of conemap.h.\n"
                     "$FNfloat conemap_cone($CONE_PARAMS) {\n"
                     "?host     return $STORED_CONE;\n"
                     "?octants,!host     vec4 cones;\n"
                     "?octants,!host     if (sector > 3) cones = $OCTANTS;\n"
                     "?octants,!host     else cones = $QUADRANTS;\n"
                     "?octants,!host     return cones[sector & 3];\n"
                     "?!octants,!host     return $QUADRANTS[sector];\n"
                     "}\n"},
    {"conemap_turn", "// Gathered corners, the one behind the ray first.\n"
                     "vec4 conemap_turn(vec4 g, int si, int sj) {\n"
                     "    g = si > 0 ? g.wzxy : g.zwyx;\n"
                     "    return sj > 0 ? g : g.zwxy;\n"
                     "}\n"},
    {"conemap_mix", "$FNfloat conemap_mix(vec4 h, float x, float y) {\n"
                    "    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;\n"
                    "    return low + (high - low) * y;\n"
                    "}\n"},
    {"conemap_tangent", "// The tangent that a stored radius stands for, over a height.\n"
                        "$FNfloat conemap_tangent(float stored, float height) {\n"
                        "    float top = 1.0f - height;\n"
                        "    return stored < $MAX_TAN * top ? stored / top : top > 0.0f ? $MAX_TAN : 0.0f;\n"
                        "}\n"},

    /* ---- the ray ---- */
    {"conemap_clip", "// Narrows a range of t to where low <= o + v t <= high.\n"
                     "$FNvec2 conemap_clip(vec2 range, float o, float v, float low, float high) {\n"
                     "    float a = (low - o) / v, b = (high - o) / v;\n"
                     "    if (v == 0.0f) return vec2(range.x, o >= low && o <= high ? range.y : -1e30f);\n"
                     "    return vec2(max(range.x, min(a, b)), min(range.y, max(a, b)));\n"
                     "}\n"},
    {"conemap_cone_step", "// How long the ray flies inside a cone whose apex lies `gap` below it.\n"
                          "$FNfloat conemap_cone_step(float tangent, float gap, float speed, float vz) {\n"
                          "    float closing = speed - tangent * vz;\n"
                          "    if (speed == 0.0f) return vz < 0.0f ? (gap + 1e-6f) / -vz : 1e30f;\n"
                          "    return closing > 0.0f ? $SCALEtangent * gap / closing : 1e30f;\n"
                          "}\n"},
    {"conemap_patch_hit",
     "// First t in 0..end at which a ray meets a bilinear patch, from (x, y) with clearance c, or -1. Along the\n"
     "// ray the clearance is c + b t + a t t, solved in the form that does not cancel.\n"
     "$FNfloat conemap_patch_hit(vec4 h, float x, float y, float c, vec3 v, float end) {\n"
     "    float hx = h.y - h.x, hy = h.z - h.x, hxy = h.w - h.z - hx;\n"
     "    float b = v.z - hx * v.x - hy * v.y - hxy * (x * v.y + y * v.x), a = -hxy * v.x * v.y;\n"
     "    float d = b * b - 4.0f * a * c, root = sqrt(max(d, 0.0f));\n"
     "    float hit = b < 0.0f ? 2.0f * c / (root - b) : a < 0.0f ? -0.5f * (root + b) / a : -1.0f;\n"
     "    return c <= 0.0f ? 0.0f : d >= 0.0f && hit <= end ? hit : -1.0f;\n"
     "}\n"},
    {"conemap_line_hit",
     "// First t in 0..end at which a straight line from clearance c to the one at the end meets 0, or -1.\n"
     "$FNfloat conemap_line_hit(vec4 h, float x, float y, float z, float c, vec3 v, float end) {\n"
     "    float last = z + v.z * end - conemap_mix(h, x + v.x * end, y + v.y * end);\n"
     "    return c <= 0.0f ? 0.0f : last <= 0.0f ? end * (c / (c - last)) : -1.0f;\n"
     "}\n"},

    /* ---- maxima ---- */
    {"conemap_ahead",
     "// How many cells the block of level k goes on, in the ray's direction, from a cell of it.\n"
     "$FNint conemap_ahead(int cell, int count, int k, int s) {\n"
     "    int low = (cell >> k) << k, high = ((cell >> k) + 1) << k;\n"
     "    return s < 0 ? cell + 1 - low : (high < count ? high : count) - cell;\n"
     "}\n"},

    /* ---- kernels ---- */
    {"conemap_ring",
     "// Steepest slope, squared, from texel (i, j) to those of rings first..last, and of the rings before.\n"
     "$FNfloat conemap_ring(int i, int j, int first, int last$SIZE_PARAMS) {\n"
     "    float s = $KEPT, apex = conemap_texel(i, j$SIZE);\n"
     "    float a = 1.0f / $FW, b = $ASPECT / $FH, shorter = min(a, b);\n"
     "    for (int r = first; r <= last; ++r) {\n"
     "        float d = shorter * float(r), room = 1.0f - apex;\n"
     "        if (room * room <= s * d * d) break; // nothing so far away can be steeper\n"
     "        for (int side = 0; side < 4; ++side) {\n"
     "            for (int k = -r; k < r; ++k) {\n"
     "                int di = side == 0 ? k : side == 1 ? r : side == 2 ? -k : -r;\n"
     "                int dj = side == 0 ? -r : side == 1 ? k : side == 2 ? r : -k;\n"
     "?!wrap_u                 if (i + di < 0 || i + di >= $W) continue;\n"
     "?!wrap_v                 if (j + dj < 0 || j + dj >= $H) continue;\n"
     "                float x = a * float(di), y = b * float(dj), rise = conemap_texel(i + di, j + dj$SIZE) - "
     "apex;\n"
     "                if (rise > 0.0f) s = max(s, rise * rise / (x * x + y * y));\n"
     "            }\n"
     "        }\n"
     "    }\n"
     "    return s;\n"
     "}\n"},
    {"conemap_slope", "$FNfloat conemap_slope(int i, int j$SIZE_PARAMS) {\n"
                      "    return $SLOPE;\n"
                      "}\n"},
    {"conemap_steepest",
     "// The narrowest cone of the 3x3 block around a texel.\n"
     "$FNfloat conemap_steepest(int i, int j$SIZE_PARAMS) {\n"
     "    float s = 0.0f;\n"
     "    for (int dj = -1; dj <= 1; ++dj)\n"
     "        for (int di = -1; di <= 1; ++di) s = max(s, conemap_slope(i + di, j + dj$SIZE));\n"
     "    return s;\n"
     "}\n"},
    {"conemap_safe",
     "// A slope, squared, that no point over the cells at texel (i, j) exceeds to any point of the bilinear "
     "surface: what\n"
     "// vertices see, times sqrt(1 + V) for V the variance of where in a cell one is; in the cells around, the "
     "gradient.\n"
     "$FNfloat conemap_safe(int i, int j$SIZE_PARAMS) {\n"
     "    float a = 1.0f / $FW, b = $ASPECT / $FH, shorter = min(a, b), s = 0.0f, gradient = 0.0f;\n"
     "    for (int dj = -1; dj <= 1; ++dj)\n"
     "        for (int di = -1; di <= 1; ++di) s = max(s, conemap_slope(i + di, j + dj$SIZE));\n"
     "    for (int cj = j - 2; cj <= j + 1; ++cj) {\n"
     "        for (int ci = i - 2; ci <= i + 1; ++ci) {\n"
     "            float h00 = conemap_texel(ci, cj$SIZE), h10 = conemap_texel(ci + 1, cj$SIZE);\n"
     "            float h01 = conemap_texel(ci, cj + 1$SIZE), h11 = conemap_texel(ci + 1, cj + 1$SIZE);\n"
     "            float x = max(abs(h10 - h00), abs(h11 - h01)) / a, y = max(abs(h01 - h00), abs(h11 - h10)) / "
     "b;\n"
     "            gradient = max(gradient, x * x + y * y);\n"
     "        }\n"
     "    }\n"
     "    return 1.0001f * max(gradient, s * (1.0f + 0.5f * (a * a + b * b) / (shorter * shorter))); // 1.0001: "
     "rounding\n"
     "}\n"},
    {"conemap_highest", "// The highest corner of a bilinear cell; 0 beyond the map.\n"
                        "$FNfloat conemap_highest(int i, int j$SIZE_PARAMS) {\n"
                        "    int x = $FIRST_CELL_U, y = $FIRST_CELL_V;\n"
                        "    if (i >= $CELLS_U || j >= $CELLS_V) return 0.0f;\n"
                        "    return max(max(conemap_texel(x, y$SIZE), conemap_texel(x + 1, y$SIZE)),\n"
                        "               max(conemap_texel(x, y + 1$SIZE), conemap_texel(x + 1, y + 1$SIZE)));\n"
                        "}\n"},
    {"conemap_padded", "// The height; 0 beyond the map.\n"
                       "$FNfloat conemap_padded(int i, int j$SIZE_PARAMS) {\n"
                       "    return i < $W && j < $H ? conemap_texel(i, j$SIZE) : 0.0f;\n"
                       "}\n"},
    {"conemap_maximum", "$FNfloat conemap_maximum(int x, int y, int k) {\n"
                        "    return $MAXIMUM_AT;\n"
                        "}\n"},
    {"conemap_four", "// Block (i, j) of a level: the highest of the four of the level below.\n"
                     "$FNfloat conemap_four(int i, int j, int level) {\n"
                     "    int x = 2 * i, y = 2 * j, k = level - 1;\n"
                     "    return max(max(conemap_maximum(x, y, k), conemap_maximum(x + 1, y, k)),\n"
                     "               max(conemap_maximum(x, y + 1, k), conemap_maximum(x + 1, y + 1, k)));\n"
                     "}\n"},
    {"conemap_gradient", "// Height differences per texel; one-sided at a border.\n"
                         "$FNvec2 conemap_gradient(int i, int j$SIZE_PARAMS) {\n"
                         "    return vec2($SHARE_U * (conemap_texel(i + 1, j$SIZE) - conemap_texel(i - 1, j$SIZE)),\n"
                         "                $SHARE_V * (conemap_texel(i, j + 1$SIZE) - conemap_texel(i, j - 1$SIZE)));\n"
                         "}\n"},
    {"conemap_block", "$STRUCT conemap_block {\n"
                      "    int node, low, high; // its number; offsets of its texels from the texel's own\n"
                      "?center     float middle;\n"
                      "?c } conemap_block;\n"
                      "?!c };\n"},
    {"conemap_beside",
     "// On one axis the block of level k that is `side` blocks beside a texel's own; low > high: there is none. A wrapping\n"
     "// axis is seen from -size / 2 to size / 2.\n"
     "$FNconemap_block conemap_beside(int at, int side, int size, int k, bool repeats) {\n"
     "    int count = ((size - 1) >> k) + 1, node = (at >> k) + side;\n"
     "    int shift = node < 0 ? -size : node >= count ? size : 0, end = size - 1 + shift - at;\n"
     "    conemap_block b;\n"
     "    b.node = shift < 0 ? count - 1 : shift > 0 ? 0 : node;\n"
     "    b.low = (b.node << k) + shift - at;\n"
     "    b.high = ((b.node + 1) << k) - 1 + shift - at;\n"
     "    if (b.high > end) b.high = end;\n"
     "?center     b.middle = 0.5f * float(b.low + b.high);\n"
     "    if (repeats && b.low < -(size >> 1)) b.low = -(size >> 1);\n"
     "    if (repeats && b.high > size >> 1) b.high = size >> 1;\n"
     "    if (!repeats && shift != 0) b.high = b.low - 1;\n"
     "    return b;\n"
     "}\n"},
    {"conemap_seen", "// The offsets that the three blocks of level k around a texel reach.\n"
                     "$FNivec2 conemap_seen(int at, int size, int k, bool repeats) {\n"
                     "    conemap_block own = conemap_beside(at, 0, size, k, repeats);\n"
                     "    conemap_block before = conemap_beside(at, -1, size, k, repeats);\n"
                     "    conemap_block behind = conemap_beside(at, 1, size, k, repeats);\n"
                     "    return ivec2(before.low <= before.high ? before.low : own.low,\n"
                     "                 behind.low <= behind.high ? behind.high : own.high);\n"
                     "}\n"},
    {"conemap_axis",
     "// On one axis the squared distances to a block of level k, to what finer levels have not seen of it and to the whole,\n"
     "// and its number. 1e30: there is no such thing.\n"
     "$FNvec3 conemap_axis(int at, int side, int size, int k, bool repeats, float texel) {\n"
     "    conemap_block b = conemap_beside(at, side, size, k, repeats);\n"
     "?!center     int closest = side < 0 ? b.high : side > 0 ? b.low : 0;\n"
     "?center     float whole = side == 0 ? 0.0f : texel * b.middle;\n"
     "?!center     float whole = texel * float(closest);\n"
     "    if (b.low > b.high) return vec3(1e30f, 1e30f, 0.0f);\n"
     "?improved,!center     if (side == 0) return vec3(1e30f, 0.0f, float(b.node));\n"
     "?improved,!center     if (k > 0) {\n"
     "?improved,!center         ivec2 seen = conemap_seen(at, size, k - 1, repeats);\n"
     "?improved,!center         if (side < 0 && closest >= seen.x) closest = seen.x - 1;\n"
     "?improved,!center         if (side > 0 && closest <= seen.y) closest = seen.y + 1;\n"
     "?improved,!center         if (closest < b.low || closest > b.high) return vec3(1e30f, whole * whole, float(b.node));\n"
     "?improved,!center     }\n"
     "?improved,!center     float unseen = texel * float(closest);\n"
     "?improved,!center     return vec3(unseen * unseen, whole * whole, float(b.node));\n"
     "?!improved     return vec3(whole * whole, whole * whole, float(b.node));\n"
     "?improved,center     return vec3(whole * whole, whole * whole, float(b.node));\n"
     "}\n"},
    {"conemap_covers", "// Have finer levels than k seen all of an axis?\n"
                       "$FNbool conemap_covers(int at, int size, int k, bool repeats) {\n"
                       "    ivec2 seen = conemap_seen(at, size, k - 1, repeats);\n"
                       "    return seen.x <= (repeats ? -(size >> 1) : -at) && seen.y >= (repeats ? size >> 1 : size - 1 - at);\n"
                       "}\n"},
    {"conemap_quick",
     "// A slope, squared, that no texel exceeds: level by level the 3x3 blocks around, each with its maximum at its closest\n"
     "?center // point, taken to be its middle, so that some exceed it after all.\n"
     "?improved,!center // point that finer levels have not seen, which on a diagonal is the nearer of two corners.\n"
     "?!improved,!center // point.\n"
     "$FNfloat conemap_quick(int i, int j$SIZE_PARAMS) {\n"
     "    float s = 0.0f, apex = conemap_texel(i, j$SIZE), a = 1.0f / $FW, b = $ASPECT / $FH;\n"
     "    int longest = $W > $H ? $W : $H;\n"
     "    for (int k = 0; (2 * longest - 1) >> k > 0; ++k) {\n"
     "        if (k > 0 && conemap_covers(i, $W, k, $REPEATS_U) && conemap_covers(j, $H, k, $REPEATS_V)) break;\n"
     "        for (int y = -1; y <= 1; ++y) {\n"
     "            vec3 v = conemap_axis(j, y, $H, k, $REPEATS_V, b);\n"
     "            for (int x = -1; x <= 1; ++x) {\n"
     "                vec3 u = conemap_axis(i, x, $W, k, $REPEATS_U, a);\n"
     "                float d2 = min(u.x + v.y, u.y + v.x), rise = conemap_maximum(int(u.z), int(v.z), k) - apex;\n"
     "                if ((x != 0 || y != 0) && d2 < 1e29f && rise > 0.0f) s = max(s, rise * rise / d2);\n"
     "            }\n"
     "        }\n"
     "    }\n"
     "    return s;\n"
     "}\n"},
    {"conemap_nearer", "// Of a block and the one beside it that shares its parent, the nearer.\n"
                       "$FNint conemap_nearer(int at, int block, int k) {\n"
                       "    return clamp(at >> k, block & ~1, block | 1);\n"
                       "}\n"},
    {"conemap_steeper",
     "// The steepest slope, squared, from height `apex` at texel (i, j), which may lie beside the map, to the texels of a\n"
     "// block; s is known already. Blocks that hold nothing steeper are left out, nearer ones come first.\n"
     "$FNfloat conemap_steeper(float s, float apex, int i, int j, int level, int x, int y$SIZE_PARAMS) {\n"
     "    float a = 1.0f / $FW, b = $ASPECT / $FH;\n"
     "    int k = level, inside_i = clamp(i, 0, $W - 1), inside_j = clamp(j, 0, $H - 1);\n"
     "    for (bool done = false; !done;) {\n"
     "        float u = a * float(i - clamp(i, x << k, ((x + 1) << k) - 1));\n"
     "        float v = b * float(j - clamp(j, y << k, ((y + 1) << k) - 1)), d2 = u * u + v * v;\n"
     "        float rise = max(conemap_maximum(x, y, k) - apex, 0.0f);\n"
     "        bool steeper = rise * rise > s * d2;\n"
     "        if (steeper && k == 0) s = rise * rise / d2;\n"
     "        if (steeper && k > 0) {\n"
     "            --k;\n"
     "            x = conemap_nearer(inside_i, 2 * x, k);\n"
     "            y = conemap_nearer(inside_j, 2 * y, k);\n"
     "        } else { // on to the next of the four, or of those around\n"
     "            for (; k < level && x != conemap_nearer(inside_i, x, k) && y != conemap_nearer(inside_j, y, k); ++k) {\n"
     "                x = x >> 1;\n"
     "                y = y >> 1;\n"
     "            }\n"
     "            done = k == level;\n"
     "            if (x != conemap_nearer(inside_i, x, k)) y = y ^ 1;\n"
     "            x = x ^ 1;\n"
     "        }\n"
     "    }\n"
     "    return s;\n"
     "}\n"},
    {"conemap_exact",
     "// Steepest slope, squared, from texel (i, j) to those of blocks first..last of a level, and of those before.\n"
     "$FNfloat conemap_exact(int i, int j, int first, int last, int level$SIZE_PARAMS) {\n"
     "    float s = $KEPT, apex = conemap_texel(i, j$SIZE);\n"
     "    int end = $W - 1, across = (end >> level) + 1;\n"
     "    for (int block = first; block <= last; ++block) {\n"
     "        int x = int(uint(block) % uint(across)), y = int(uint(block) / uint(across));\n"
     "?!wraps         s = conemap_steeper(s, apex, i, j, level, x, y$SIZE);\n"
     "?wraps         for (int copy = 0; copy < $COPIES; ++copy) { // of the map, beside itself; as well the texel may move\n"
     "?wraps             s = conemap_steeper(s, apex, $COPY_U, $COPY_V, level, x, y$SIZE);\n"
     "?wraps         }\n"
     "    }\n"
     "    return s;\n"
     "}\n"},
    {"conemap_stored",
     "// The cone as the texture keeps it: 2^-20 narrower for all rounding, and rounded down.\n"
     "$FNfloat conemap_stored(int i, int j$SIZE_PARAMS) {\n"
     "    float s = conemap_slope(i, j$SIZE), tangent = $MAX_TAN;\n"
     "    if (s > 0.0f) tangent = min(tangent, 0.999999f / sqrt(s));\n"
     "?radius     float stored = (1.0f - conemap_texel(i, j$SIZE)) * tangent * 0.999999f;\n"
     "?sqrt     float stored = sqrt(tangent) * 0.999999f;\n"
     "?!radius,!sqrt     float stored = tangent;\n"
     "?unorm     float code = floor(min(stored, 1.0f) * $SCALE_MAX);\n"
     "?unorm     return (code / $SCALE_MAX > stored ? code - 1.0f : code) / $SCALE_MAX;\n"
     "?half     return max(stored * (1.0f - 1.0f / 1024.0f) - 6e-8f, 0.0f); // a half float is nearer than that\n"
     "?!unorm,!half     return stored;\n"
     "}\n"},
    {NULL, NULL},
};

/* conemap_trace: a head, the loop of one tracer, a tail. The ray flies through the cell between texels (i, j) and
   (i + si, j + sj), where si and sj are its directions, so that x and y, its place in the cell, always grow. */
static const char conemap__trace_head[] =
    "?exact // Cone steps; in every cell that the ray enters it is met with the bilinear patch itself.\n"
    "?linear // Equal steps.\n"
    "?loop // A number of cone steps without a test in between.\n"
    "?exact_step // Cone step and one texel more, until the ray is below the surface.\n"
    "?cell_max // To the end of the cone or of the cell, whichever is farther, until the ray is below the "
    "surface.\n"
    "?maxmip // Blocks under the ray are left behind whole, others are entered; in a cell the patch itself "
    "decides.\n"
    "?qdm // Blocks under the ray are left behind whole, others are entered; in a cell a straight line decides.\n"
    "?any $FNbool conemap_any_hit(vec3 origin, vec3 direction$PARAMS) {\n"
    "?!any $FNconemap_hit conemap_trace(vec3 origin, vec3 direction$PARAMS) {\n"
    "?size_asked     ivec2 size = $SIZE_ASKED;\n"
    "    vec2 range = conemap_clip(vec2($T_MIN, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map\n"
    "    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below\n"
    "?t_range     range.y = min(range.y, t_max);\n"
    "?status,nothing     vec2 box = range; // it says how a ray ends that meets nothing\n"
    "?status,nothing,!wrap_u     box = conemap_clip(box, origin.x, direction.x, 0.0f, 1.0f);\n"
    "?status,nothing,!wrap_v     box = conemap_clip(box, origin.y, direction.y, 0.0f, 1.0f);\n"
    "?nothing_u     float rim_u = $W > 1 ? 0.5f / $FW : 0.0f; // the surface ends at the outermost centres\n"
    "?nothing_v     float rim_v = $H > 1 ? 0.5f / $FH : 0.0f;\n"
    "?!wraps     range = conemap_clip($CLIP_U, origin.y, direction.y, $LOW_V, $HIGH_V);\n"
    "?!wrap_u,wrap_v     range = $CLIP_U;\n"
    "?wrap_u,!wrap_v     range = conemap_clip(range, origin.y, direction.y, $LOW_V, $HIGH_V);\n"
    "    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;\n"
    "    vec3 v = vec3(max(abs(direction.x) * $FW, 1e-20f), max(abs(direction.y) * $FH, 1e-20f), direction.z);\n"
    "?sectors     int sector = (direction.x < 0.0f ? 1 : 0) + (direction.y < 0.0f ? 2 : 0);\n"
    "?octants     if (v.y > v.x) sector += 4;\n"
    "    float x = float(si) * (origin.x * $FW - 0.5f), y = float(sj) * (origin.y * $FH - 0.5f), z = origin.z;\n"
    "?status,nothing     int end_status = box.x > box.y ? 1 : box.y == ground ? 2 : $T_MAX_STATUS;\n"
    "?status,!nothing     int end_status = $T_MAX_STATUS;\n"
    "?wraps     float reach_end = range.x + 1048576.0f / (v.x + v.y); // farther than a float can tell cells "
    "apart\n"
    "?wraps,status     if (range.y > reach_end) end_status = 4;\n"
    "?wraps     range.y = min(range.y, reach_end);\n"
    "?adaptive     float level = direction.x * direction.x + direction.y * direction.y;\n"
    "?blocks     int cells_u = $CELLS_U, cells_v = $CELLS_V, top = 0;\n"
    "?blocks     for (int side = 1; side < cells_u || side < cells_v; side *= 2) ++top;\n"
    "?blocks     int k = top;\n"
    "?exact_step     float extra = 1.0f / ($LONGEST * sqrt(direction.x * direction.x + direction.y * direction.y "
    "+\n"
    "?exact_step                                           direction.z * direction.z));\n"
    "?linear     float stride = (range.y - range.x) / float($CAP);\n"
    "?adaptive     int step_count = int(float($CAP) * (0.5f + sqrt(level / (level + direction.z * "
    "direction.z))));\n"
    "    float t = 0.0f, dt = range.x$STATE;\n"
    "    bool done = range.x > range.y$BOOLS;\n"
    "    for (; !done && steps < $LIMIT; ++steps) {\n"
    "@move\n";

static const char conemap__move_text[] =
    "        // Moves on by dt. Whole cells go to i and j: x and y stay small and keep their bits.\n"
    "        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt;\n"
    "        i += si * int(floor(x)); x -= floor(x); j += sj * int(floor(y)); y -= floor(y);\n";

static const char conemap__surface_text[] = /* the height below the ray, and with `cones` the cone there */
    "?both,!gather,!hardware         vec2 a = conemap_texel(i, j$MAP), b = conemap_texel(i + si, j$MAP);\n"
    "?both,!gather,!hardware         vec2 c = conemap_texel(i, j + sj$MAP), d = conemap_texel(i + si, j + "
    "sj$MAP);\n"
    "?both,!gather,!hardware         vec4 heights = vec4(a.x, b.x, c.x, d.x);\n"
    "?!both,!gather,!hardware         vec4 heights = vec4(conemap_texel(i, j$MAP), conemap_texel(i + si, "
    "j$MAP),\n"
    "?!both,!gather,!hardware                             conemap_texel(i, j + sj$MAP), conemap_texel(i + si, j "
    "+ sj$MAP));\n"
    "?gather         vec2 uv = vec2(float(i + (si > 0 ? 1 : 0)) / $FW, float(j + (sj > 0 ? 1 : 0)) / $FH);\n"
    "?gather         vec4 heights = conemap_turn($GATHER_HEIGHTS, si, sj);\n"
    "?hardware         vec2 uv = vec2((float(i) + float(si) * x + 0.5f) / $FW, (float(j) + float(sj) * y + 0.5f) "
    "/ $FH);\n"
    "?hardware,cones,!apart         vec2 both = $SAMPLE;\n"
    "?hardware,cones,!apart         float height = both.x;\n"
    "?hardware,apart         float height = $SAMPLE_HEIGHT;\n"
    "?hardware,!cones,!apart         float height = $SAMPLE_HEIGHT;\n"
    "?!hardware         float height = conemap_mix(heights, x, y);\n";

static const char conemap__cone_text[] =
    "?both,!gather,!hardware,!per_cell         float cone = conemap_mix(vec4(a.y, b.y, c.y, d.y), x, y);\n"
    "?both,!gather,!hardware,per_cell         float cone = sj > 0 ? (si > 0 ? a.y : b.y) : si > 0 ? c.y : d.y;\n"
    "?both,gather,!per_cell         float cone = conemap_mix(conemap_turn($GATHER_CONES, si, sj), x, y);\n"
    "?sectors,!hardware,!per_cell         vec4 cones = vec4(conemap_cone(i, j, sector$MAP),\n"
    "?sectors,!hardware,!per_cell                           conemap_cone(i + si, j, sector$MAP),\n"
    "?sectors,!hardware,!per_cell                           conemap_cone(i, j + sj, sector$MAP),\n"
    "?sectors,!hardware,!per_cell                           conemap_cone(i + si, j + sj, sector$MAP));\n"
    "?sectors,!hardware,!per_cell         float cone = conemap_mix(cones, x, y);\n"
    "?sectors,per_cell         float cone = conemap_cone(si > 0 ? i : i - 1, sj > 0 ? j : j - 1, sector$MAP);\n"
    "?cone_texel         float cone = conemap_texel(si > 0 ? i : i - 1, sj > 0 ? j : j - 1$MAP);\n"
    "?hardware,!apart         float cone = both.y;\n"
    "?hardware,apart,!per_cell         float cone = $SAMPLE_CONE;\n";

static const char conemap__loop_exact[] =
    "@surface\n"
    "@cone\n"
    "        float leave = min((1.000001f - x) / v.x, (1.000001f - y) / v.y), left = range.y - t; // just over "
    "the border\n"
    "        hit = conemap_patch_hit(heights, x, y, z - height, v, min(leave, left));\n"
    "?back         if (hit == 0.0f && flown > 0.0f) { // this cone was not empty: back, and cell by cell through "
    "it\n"
    "?back             walked = t;\n"
    "?back             dt = -flown;\n"
    "?back             flown = 0.0f;\n"
    "?back             hit = -1.0f;\n"
    "?back             continue;\n"
    "?back         }\n"
    "        float gap = z - height - 1.0f / 1048576.0f; // the apex is raised by more than its rounding\n"
    "        float closing = speed - $TANGENT * v.z;\n"
    "?!back         dt = max(leave, gap <= 0.0f ? 0.0f : closing > 0.0f ? $SCALE$TANGENT * gap / closing : "
    "1e30f);\n"
    "?back         dt = gap <= 0.0f$CONES_DENIED ? 0.0f : closing > 0.0f ? $SCALE$TANGENT * gap / closing : "
    "1e30f;\n"
    "?back         flown = dt > leave ? dt : 0.0f;\n"
    "?back         dt = max(dt, leave);\n"
    "        done = hit >= 0.0f || dt >= left;\n";

static const char conemap__loop_linear[] =
    "@surface\n"
    "?secant         above = gap;\n"
    "        gap = ends && range.y == ground ? min(z - height, 0.0f) : z - height;\n"
    "        found = gap <= 0.0f;\n"
    "        done = found || ends;\n"
    "        if (done) break;\n"
    "        ends = steps + 1 == $CAP;\n"
    "        dt = stride;\n";

static const char conemap__loop_loop[] =
    "@surface\n"
    "@cone\n"
    "        gap = ends && range.y == ground ? min(z - height, 0.0f) : z - height;\n"
    "        found = gap <= $TOLERANCE;\n"
    "        if (steps + 1 == $LIMIT || (steps == 0 && gap <= 0.0f)) break; // it begins inside\n"
    "?secant         if (gap > 0.0f) above = gap;\n"
    "?refined         if (gap > 0.0f) t_above = t;\n"
    "        dt = max(conemap_cone_step($TANGENT, gap, speed, v.z), range.x - t);\n"
    "        ends = dt >= range.y - t;\n"
    "        if (ends) dt = range.y - t;\n";

static const char conemap__loop_step[] = /* exact-step, cell-max */
    "@surface\n"
    "@cone\n"
    "?secant         above = gap;\n"
    "        gap = ends && range.y == ground ? min(z - height, 0.0f) : z - height;\n"
    "        found = gap <= 0.0f;\n"
    "        done = found || ends;\n"
    "        if (done) break;\n"
    "        dt = conemap_cone_step($TANGENT, gap, speed, v.z)$EXTRA;\n"
    "?cell_max         if (speed > 0.0f) dt = max(dt, min((1.000001f - x) / v.x, (1.000001f - y) / v.y));\n"
    "        ends = dt >= range.y - t;\n"
    "        if (ends) dt = range.y - t;\n";

static const char conemap__loop_blocks[] =
    "        int cell_u = $CELL_U, cell_v = $CELL_V;\n"
    "        int ahead_u = conemap_ahead(cell_u, cells_u, k, si), ahead_v = conemap_ahead(cell_v, cells_v, k, "
    "sj);\n"
    "        float leave = min((float(ahead_u) + 0.000001f - x) / v.x, (float(ahead_v) + 0.000001f - y) / v.y);\n"
    "        float left = range.y - t, end = min(leave, left), highest = $MAXIMUM;\n"
    "        bool over = min(z, z + v.z * end) > highest;\n"
    "        done = over && leave >= left;\n"
    "        if (done) break;\n"
    "        if (over || k > 0) {\n"
    "            dt = over ? leave : 0.0f;\n"
    "?qdm             float fall = v.z < 0.0f ? (highest - z) / v.z : 0.0f; // to the block's top\n"
    "?qdm             if (!over && fall > 0.0f && fall < end) dt = fall;\n"
    "            k = !over ? k - 1 : k < top ? k + 1 : top;\n"
    "            continue;\n"
    "        }\n"
    "@surface\n"
    "?maxmip         hit = conemap_patch_hit(heights, x, y, z - height, v, end);\n"
    "?qdm         hit = conemap_line_hit(heights, x, y, z, z - height, v, end);\n"
    "        done = hit >= 0.0f || leave >= left;\n"
    "        if (done) break;\n"
    "        dt = leave;\n"
    "        k = top > 0 ? 1 : 0;\n";

static const char conemap__trace_tail[] =
    "    }\n"
    "?solves     if (done && hit < 0.0f && range.y == ground && range.x <= range.y) hit = range.y - t;\n"
    "?any     return hit >= 0.0f;\n"
    "?solves,!any     dt = max(hit, 0.0f);\n"
    "?loop     done = ends;\n"
    "?loop,refined     dt = t - t_above;\n"
    "?refined     bool bracketed = gap <= 0.0f && steps > 0; // between here and dt before\n"
    "?secant,refined     if (bracketed) {\n"
    "?secant,refined         dt *= above > gap ? gap / (above - gap) : 0.0f;\n"
    "?secant,refined @move\n"
    "?secant,refined     }\n"
    "?bisect,refined     for (int k = 0; bracketed && k <= $REFINE_STEPS; ++k) {\n"
    "?bisect,refined         dt = gap > 0.0f ? 0.5f * abs(dt) : -0.5f * abs(dt);\n"
    "?bisect,refined @move\n"
    "?bisect,refined @surface\n"
    "?bisect,refined         gap = z - height;\n"
    "?bisect,refined     }\n"
    "?exact_step,!refined     dt = found && steps > 0 ? -min(extra, dt) : 0.0f; // a texel back\n"
    "?!any     conemap_hit result;\n"
    "?!any     result.found = $FOUND;\n"
    "?!any     result.t = $AT_T;\n"
    "?!any     result.position = vec3((float(i) + float(si) * $AT_X + 0.5f) / $FW, (float(j) + float(sj) * $AT_Y "
    "+ 0.5f) / $FH, $AT_Z);\n"
    "?status     result.status = result.found ? 0 : done ? end_status : 4;\n"
    "?steps     result.steps = steps;\n"
    "?!any     return result;\n"
    "}\n";

/* Words of GLSL, HLSL and C; the second form stands before a parenthesis. */
typedef struct conemap__word {
    const char *word, *hlsl, *hlsl_call, *c, *c_call;
} conemap__word;

static const conemap__word conemap__words[] = {
    {"vec2", "float2", "float2", "conemap_vec2", "conemap_make_vec2"},
    {"vec3", "float3", "float3", "conemap_vec3", "conemap_make_vec3"},
    {"vec4", "float4", "float4", "conemap_vec4", "conemap_make_vec4"},
    {"ivec2", "int2", "int2", "conemap_ivec2", "conemap_make_ivec2"},
    {"ivec4", "int4", "int4", "conemap_ivec4", "conemap_ivec4"},
    {"mat4", "float4x4", "float4x4", "mat4", "mat4"},
    {"float", "float", "float", "float", "(float)"},
    {"int", "int", "int", "int", "(int)"},
    {"uint", "uint", "uint", "unsigned", "(unsigned)"},
    {"clamp", "clamp", "clamp", "clamp", "conemap_clampi"},
    {"min", "min", "min", "min", "fminf"},
    {"max", "max", "max", "max", "fmaxf"},
    {"abs", "abs", "abs", "abs", "fabsf"},
    {"sqrt", "sqrt", "sqrt", "sqrt", "sqrtf"},
    {"floor", "floor", "floor", "floor", "floorf"},
    {"ceil", "ceil", "ceil", "ceil", "ceilf"},
    {"exp2", "exp2", "exp2", "exp2", "exp2f"},
    {"log2", "log2", "log2", "log2", "log2f"},
    {"sin", "sin", "sin", "sin", "sinf"},
    {"cos", "cos", "cos", "cos", "cosf"},
    {"atan", "atan", "atan", "atan", "atanf"},
    {"dot", "dot", "dot", "dot", "conemap_dot"},
    {"cross", "cross", "cross", "cross", "conemap_cross"},
    {"normalize", "normalize", "normalize", "normalize", "conemap_normalize"},
};

/* What a name after a dollar stands for. Text of the host's is raw: no word of it is changed. */
#define CONEMAP__PIECE_SIZE 400
typedef struct conemap__piece {
    const char *name;
    int raw;
    char text[CONEMAP__PIECE_SIZE];
} conemap__piece;

#define CONEMAP__PIECES 176
#define CONEMAP__NAME_SIZE 64
#define CONEMAP__TABLES 4      /* of snippets, each closed by a null name */
#define CONEMAP__TABLE_SIZE 96 /* snippets in one at most */
#define CONEMAP__GIVEN 9       /* names that a host can give */

typedef struct conemap__emitter {
    conemap_shader_desc desc;
    char *text;
    size_t size, capacity;
    unsigned char flags[conemap__flag_count];
    const conemap__snippet *tables[CONEMAP__TABLES]; /* where snippets are looked up after conemap__snippets; or null */
    unsigned char written[CONEMAP__TABLES][CONEMAP__TABLE_SIZE];
    conemap__piece pieces[CONEMAP__PIECES];
    int piece_count;
    const char *prefix;
    const char *given[CONEMAP__GIVEN];      /* the host's names, or null */
    char names[5][CONEMAP__NAME_SIZE + 16]; /* map, heights, maxima, sampler, octants */
    int commenting;
    int shift; /* how far lines are written to the left */
    int clash; /* a word of the text is also a name of the host's */
} conemap__emitter;

static void conemap__put(conemap__emitter *e, const char *text, size_t length) {
    if (e->text && e->size + length < e->capacity) memcpy(e->text + e->size, text, length);
    e->size += length;
}

static void conemap__puts(conemap__emitter *e, const char *text) { conemap__put(e, text, strlen(text)); }

/* Appends to a piece; what it is given always fits, as names are bounded. */
static void conemap__append(char *text, size_t size, const char *more) {
    size_t used = strlen(text), length = strlen(more);
    if (used + length < size) memcpy(text + used, more, length + 1);
}

static void conemap__append_int(char *text, size_t size, int value) {
    char digits[16];
    int at = 15;
    unsigned rest = value < 0 ? 0u - (unsigned)value : (unsigned)value;
    digits[at] = 0;
    do digits[--at] = (char)('0' + (int)(rest % 10u));
    while ((rest /= 10u) != 0);
    if (value < 0) digits[--at] = '-';
    conemap__append(text, size, digits + at);
}

/* Nine digits, which give a float back to the bit; with an f, that only C keeps. */
static void conemap__append_float(char *text, size_t size, float value) {
    double x = (double)value;
    char digits[24];
    int exponent = 0, k, last;
    uint32_t whole;
    if (!(x > 0.0)) { /* nothing below 0 is ever written */
        conemap__append(text, size, "0.0f");
        return;
    }
    while (x >= 10.0) x /= 10.0, ++exponent;
    while (x < 1.0) x *= 10.0, --exponent;
    whole = (uint32_t)(x * 1e8 + 0.5);
    if (whole >= 1000000000u) whole /= 10u, ++exponent;
    for (k = 9; k > 0; --k) digits[k] = (char)('0' + (int)(whole % 10u)), whole /= 10u;
    digits[0] = digits[1];
    digits[1] = '.';
    for (last = 9; last > 2 && digits[last] == '0';) --last;
    digits[last + 1] = 0;
    if (exponent > 0 && exponent < 7) { /* move the point */
        for (k = 1; k <= exponent; ++k) digits[k] = k + 1 <= last ? digits[k + 1] : '0';
        digits[exponent + 1] = '.';
        if (last <= exponent + 1) {
            digits[exponent + 2] = '0';
            digits[exponent + 3] = 0;
        }
    }
    conemap__append(text, size, digits);
    if (exponent < 0 || exponent >= 7) {
        conemap__append(text, size, "e");
        conemap__append_int(text, size, exponent);
    }
    conemap__append(text, size, "f");
}

static char *conemap__piece_new(conemap__emitter *e, const char *name, int raw) {
    conemap__piece *piece = &e->pieces[e->piece_count];
    if (e->piece_count < CONEMAP__PIECES - 1) ++e->piece_count; /* with too few, texts lack words: the compilers tell */
    piece->name = name;
    piece->raw = raw;
    piece->text[0] = 0;
    return piece->text;
}

static void conemap__piece_set(conemap__emitter *e, const char *name, int raw, const char *text) {
    conemap__append(conemap__piece_new(e, name, raw), CONEMAP__PIECE_SIZE, text);
}

CONEMAP__INLINE int conemap__is_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
}
CONEMAP__INLINE int conemap__is_digit(char c) { return c >= '0' && c <= '9'; }

CONEMAP__INLINE int conemap__same(const char *text, const char *name, size_t length) {
    return strncmp(text, name, length) == 0 && text[length] == 0;
}

static int conemap__flag(const conemap__emitter *e, const char *name, size_t length) {
#define CONEMAP__FLAG_ITEM(name) #name,
    static const char *const names[] = {CONEMAP__FLAGS(CONEMAP__FLAG_ITEM)};
#undef CONEMAP__FLAG_ITEM
    int k;
    for (k = 0; k < (int)conemap__flag_count; ++k)
        if (conemap__same(names[k], name, length)) return e->flags[k];
    return 0;
}

static void conemap__snippet_named(conemap__emitter *e, const char *name, size_t length);

/* One word of a snippet: in the first pass what it needs is written, in the second the word itself. */
static void conemap__token(conemap__emitter *e, const char *token, size_t length, int called, int needs) {
    int k, hlsl = e->flags[conemap__flag_hlsl], c = e->flags[conemap__flag_c];
    for (k = 0; (hlsl || c) && !e->commenting && k < (int)(sizeof conemap__words / sizeof conemap__words[0]);
         ++k) {
        const conemap__word *word = &conemap__words[k];
        if (!conemap__same(word->word, token, length)) continue;
        token = hlsl ? (called ? word->hlsl_call : word->hlsl) : called ? word->c_call : word->c;
        length = strlen(token);
        break;
    }
    if (!e->commenting && !needs)
        for (k = 0; k < CONEMAP__GIVEN; ++k) e->clash |= e->given[k] && conemap__same(e->given[k], token, length);
    if (needs) {
        if (!e->commenting) conemap__snippet_named(e, token, length);
    } else if (length > 8 && strncmp(token, "conemap_", 8) == 0) {
        conemap__puts(e, e->prefix);
        conemap__put(e, token + 7, length - 7);
    } else {
        conemap__put(e, token, length);
    }
}

/* Writes a text, its pieces put in, to its end or to the end of its line; returns where it stopped. */
static const char *conemap__expand(conemap__emitter *e, const char *text, int needs) {
    const int commenting = e->commenting;
    while (*text && *text != '\n') {
        size_t length = 1;
        if (text[0] == '/' && text[1] == '/') e->commenting = 1; /* comments need nothing and keep their words */
        if (text[0] == '$') {
            int k;
            while ((text[length] >= 'A' && text[length] <= 'Z') || text[length] == '_' ||
                   conemap__is_digit(text[length]))
                ++length;
            for (k = 0; k < e->piece_count; ++k)
                if (conemap__same(e->pieces[k].name, text + 1, length - 1)) break;
            if (k < e->piece_count && e->pieces[k].raw) {
                if (!needs) conemap__puts(e, e->pieces[k].text);
            } else if (k < e->piece_count) {
                conemap__expand(e, e->pieces[k].text, needs);
            }
        } else if (conemap__is_letter(text[0])) {
            while (conemap__is_letter(text[length]) || conemap__is_digit(text[length])) ++length;
            conemap__token(e, text, length, text[length] == '(', needs);
        } else if (conemap__is_digit(text[0]) && !e->commenting) { /* C alone keeps the f of 1.0f */
            while (conemap__is_letter(text[length]) || conemap__is_digit(text[length]) || text[length] == '.' ||
                   (text[length] == '-' && text[length - 1] == 'e'))
                ++length;
            if (!needs)
                conemap__put(e, text, text[length - 1] == 'f' && !e->flags[conemap__flag_c] ? length - 1 : length);
        } else if (!needs) {
            conemap__put(e, text, 1);
        }
        text += length;
    }
    e->commenting = commenting;
    return text;
}

/* All lines whose flags hold. */
static void conemap__lines(conemap__emitter *e, const char *text, int needs) {
    while (*text) {
        int wanted = 1;
        if (*text == '?') {
            do {
                size_t length = 0;
                int negated = *++text == '!';
                text += negated;
                while (text[length] != ',' && text[length] != ' ') ++length;
                wanted = wanted && conemap__flag(e, text, length) != negated;
                text += length;
            } while (*text == ',');
            ++text;
        }
        if (wanted && *text == '@') { /* a piece of several lines */
            const int shift = text[1] == '<' ? 4 : 0;
            const char kind = text[shift ? 2 : 1];
            const char *part = kind == 'm' ? conemap__move_text : kind == 's' ? conemap__surface_text
                : conemap__cone_text;
            e->shift += shift;
            conemap__lines(e, part, needs);
            e->shift -= shift;
            while (*text && *text != '\n') ++text;
        } else if (wanted) {
            int k;
            for (k = 0; k < e->shift && *text == ' '; ++k) ++text;
            text = conemap__expand(e, text, needs);
            if (!needs) conemap__put(e, "\n", 1);
        } else {
            while (*text && *text != '\n') ++text;
        }
        if (*text) ++text;
    }
}

/* Writes the snippet of that name, if there is one, once, and before it what it needs. */
static void conemap__snippet_named(conemap__emitter *e, const char *name, size_t length) {
    const int shift = e->shift;
    int table, k;
    e->shift = 0;
    for (table = 0; table < CONEMAP__TABLES; ++table) {
        const conemap__snippet *snippet = table ? e->tables[table] : conemap__snippets;
        for (k = 0; snippet && snippet->name; ++k, ++snippet) {
            if (e->written[table][k] || !conemap__same(snippet->name, name, length)) continue;
            e->written[table][k] = 1;
            conemap__lines(e, snippet->text, 1);
            conemap__lines(e, snippet->text, 0);
            conemap__put(e, "\n", 1);
        }
    }
    e->shift = shift;
}

/* What stands before and behind the functions. */
static const char conemap__head_text[] =
    "?version #version $VERSION\n"
    "?!shading // conemap.h: $TRACER tracer.\n"
    "?shading // conemap.h: $TRACER tracer, with effects.\n"
    "?shading // conemap_shade($SHADE_SIGNATURE): traces a ray of the world and shades what it meets.\n"
    "?ranged // t_min, t_max: the part of the ray that counts; t_min 0 or more.\n"
    "?gradient // gradient: dFdx and dFdy of the surface's own uv.\n"
    "?!any,!shading // conemap_trace($SIGNATURE): the first hit of a ray with the relief.\n"
    "?any // conemap_any_hit($SIGNATURE): does a ray meet the relief?\n"
    "?!shading // The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the "
    "direction.\n"
    "?t_range,!shading // t_min, t_max: the part of the ray that counts; t_min 0 or more.\n"
    "?cap // max_steps: where to give up.\n"
    "?atlas // rect: the map in the texture, (x, y, width, height) in texels.\n"
    "?size_argument // size: the map's width and height in texels.\n"
    "?array // slice: the texture array's.\n"
    "?uses_map // $MAP_NAME: $MAP_COMMENT\n"
    "?uses_octants // $OCTANTS_NAME: the same of sectors 4 to 7\n"
    "?uses_heights // $HEIGHTS_NAME: height in the first channel$FILTER_COMMENT\n"
    "?uses_maxima // $MAXIMA_NAME: maxima over bilinear cells, with all its mips; only fetched\n"
    "?host // $FETCH_NAME: the host's; $FETCH_COMMENT\n"
    "?host,sectors // $FETCH_CONES_NAME: the host's; the cone as stored, for a sector\n"
    "?c #include <math.h>\n"
    "?c #include <stdbool.h>\n"
    "\n"
    "?es precision $PRECISION float;\n"
    "?es precision highp int;\n"
    "?uses_map,!external,glsl $MAP_LAYOUTuniform $SAMPLER $MAP_NAME;\n"
    "?uses_octants,!external,glsl $OCTANTS_LAYOUTuniform $SAMPLER $OCTANTS_NAME;\n"
    "?uses_heights,!external,glsl $HEIGHTS_LAYOUTuniform $SAMPLER $HEIGHTS_NAME;\n"
    "?uses_maxima,!external,glsl $MAXIMA_LAYOUTuniform $SAMPLER $MAXIMA_NAME;\n"
    "?uses_map,!external,hlsl $TEXTURE<$MAP_TYPE> $MAP_NAME$MAP_LAYOUT;\n"
    "?uses_octants,!external,hlsl $TEXTURE<$MAP_TYPE> $OCTANTS_NAME$OCTANTS_LAYOUT;\n"
    "?uses_heights,!external,hlsl $TEXTURE<float> $HEIGHTS_NAME$HEIGHTS_LAYOUT;\n"
    "?uses_maxima,!external,hlsl $TEXTURE<float> $MAXIMA_NAME$MAXIMA_LAYOUT;\n"
    "?sampler,!external SamplerState $SAMPLER_NAME$SAMPLER_LAYOUT;\n"
    "\n";

static const char conemap__host_text[] =
    "$TEXEL_TYPE $FETCH_NAME($FETCH_PARAMS);\n"
    "?sectors float $FETCH_CONES_NAME($FETCH_PLACE, int sector$SLICE_PARAM$LEVEL_PARAM);\n"
    "?host_maxima float $FETCH_MAXIMA_NAME(int i, int j, int level$SLICE_PARAM);\n"
    "\n";

static const char conemap__fragment_text[] =
    "?glsl $IN_0in vec3 conemap_origin;\n"
    "?glsl $IN_1in vec3 conemap_direction;\n"
    "?glsl,located layout(location = 0) out vec4 conemap_color;\n"
    "?glsl,!located out vec4 conemap_color;\n"
    "?glsl,debug layout(location = 1) out vec4 conemap_debug; // steps, status\n"
    "?vulkan,arguments layout(push_constant) uniform conemap_arguments {\n"
    "?hlsl,arguments cbuffer conemap_arguments : register(b$BINDING) {\n"
    "?arguments,t_range $UNIFORMvec2 conemap_range; // t_min, t_max\n"
    "?arguments,cap $UNIFORMint conemap_max_steps;\n"
    "?arguments,atlas $UNIFORMivec4 conemap_rect;\n"
    "?arguments,size_argument $UNIFORMivec2 conemap_map_size;\n"
    "?arguments,array $UNIFORMint conemap_slice;\n"
    "?vulkan,arguments };\n"
    "?hlsl,arguments };\n"
    "\n"
    "?hlsl,debug struct conemap_targets {\n"
    "?hlsl,debug     float4 color : SV_Target0; // u, v, z, t\n"
    "?hlsl,debug     float4 debug : SV_Target1; // steps, status\n"
    "?hlsl,debug };\n"
    "?hlsl,debug \n"
    "?hlsl,debug conemap_targets main(float3 origin : TEXCOORD0, float3 direction : TEXCOORD1) {\n"
    "?hlsl,!debug float4 main(float3 origin : TEXCOORD0, float3 direction : TEXCOORD1) : SV_Target0 {\n"
    "?glsl void main() {\n"
    "?hlsl,!any     conemap_hit hit = conemap_trace(origin, direction$ARGS);\n"
    "?glsl,!any     conemap_hit hit = conemap_trace(conemap_origin, conemap_direction$ARGS);\n"
    "?discards     if (!hit.found) discard;\n"
    "?glsl,!any     conemap_color = vec4(hit.position, hit.t);\n"
    "?glsl,any     float light = conemap_any_hit(conemap_origin, conemap_direction$ARGS) ? 0.0f : 1.0f;\n"
    "?glsl,any     conemap_color = vec4(light, light, light, 1.0f);\n"
    "?glsl,debug     conemap_debug = vec4($DEBUG);\n"
    "?hlsl,debug     conemap_targets targets;\n"
    "?hlsl,debug     targets.color = vec4(hit.position, hit.t);\n"
    "?hlsl,debug     targets.debug = vec4($DEBUG);\n"
    "?hlsl,debug     return targets;\n"
    "?hlsl,!debug,!any     return vec4(hit.position, hit.t);\n"
    "?hlsl,any     float light = conemap_any_hit(origin, direction$ARGS) ? 0.0f : 1.0f;\n"
    "?hlsl,any     return vec4(light, light, light, 1.0f);\n"
    "}\n";

static const char conemap__compute_text[] =
    "?glsl layout(local_size_x = 64) in;\n"
    "?glsl layout(std430$RAYS_LAYOUT) readonly buffer conemap_ray_buffer {\n"
    "?glsl     vec4 conemap_rays[]; // origin, t_min; direction, t_max\n"
    "?glsl };\n"
    "?glsl layout(std430$HITS_LAYOUT) writeonly buffer conemap_hit_buffer {\n"
    "?glsl,!debug     vec4 conemap_hits[]; // u, v, z, t, which is -1 without a hit\n"
    "?glsl,debug     vec4 conemap_hits[]; // u, v, z, t, which is -1 without a hit; steps, status\n"
    "?glsl };\n"
    "?hlsl StructuredBuffer<float4> conemap_rays$RAYS_LAYOUT;   // origin, t_min; direction, t_max\n"
    "?hlsl,!debug RWStructuredBuffer<float4> conemap_hits$HITS_LAYOUT; // u, v, z, t, which is -1 without a hit\n"
    "?hlsl,debug RWStructuredBuffer<float4> conemap_hits$HITS_LAYOUT; // u, v, z, t, which is -1 without a hit; "
    "steps, status\n"
    "?vulkan,arguments layout(push_constant) uniform conemap_arguments {\n"
    "?hlsl,arguments cbuffer conemap_arguments : register(b$BINDING) {\n"
    "?arguments,cap $UNIFORMint conemap_max_steps;\n"
    "?arguments,atlas $UNIFORMivec4 conemap_rect;\n"
    "?arguments,size_argument $UNIFORMivec2 conemap_map_size;\n"
    "?arguments,array $UNIFORMint conemap_slice;\n"
    "?vulkan,arguments };\n"
    "?hlsl,arguments };\n"
    "\n"
    "?hlsl [numthreads(64, 1, 1)]\n"
    "?hlsl void main(uint3 thread : SV_DispatchThreadID) {\n"
    "?hlsl     uint count, stride;\n"
    "?hlsl     conemap_rays.GetDimensions(count, stride);\n"
    "?hlsl     uint ray = thread.x;\n"
    "?hlsl     if (ray >= count / 2) return;\n"
    "?glsl void main() {\n"
    "?glsl     int ray = int(gl_GlobalInvocationID.x);\n"
    "?glsl     if (ray >= conemap_rays.length() / 2) return;\n"
    "?!t_range     vec3 origin = conemap_rays[2$UNSIGNED * ray].xyz, direction = conemap_rays[2$UNSIGNED * ray + "
    "1$UNSIGNED].xyz;\n"
    "?t_range     vec4 origin = conemap_rays[2$UNSIGNED * ray], direction = conemap_rays[2$UNSIGNED * ray + "
    "1$UNSIGNED];\n"
    "?t_range,!any     conemap_hit hit = conemap_trace(origin.xyz, direction.xyz, origin.w, direction.w$ARGS);\n"
    "?!t_range,!any     conemap_hit hit = conemap_trace(origin, direction$ARGS);\n"
    "?t_range,any     bool met = conemap_any_hit(origin.xyz, direction.xyz, origin.w, direction.w$ARGS);\n"
    "?!t_range,any     bool met = conemap_any_hit(origin, direction$ARGS);\n"
    "?!any,!debug     conemap_hits[ray] = vec4(hit.position, hit.found ? hit.t : -1.0f);\n"
    "?debug     conemap_hits[2$UNSIGNED * ray] = vec4(hit.position, hit.found ? hit.t : -1.0f);\n"
    "?debug     conemap_hits[2$UNSIGNED * ray + 1$UNSIGNED] = vec4($DEBUG);\n"
    "?any     conemap_hits[ray] = vec4(0.0f, 0.0f, 0.0f, met ? 0.0f : -1.0f); // the ray meets something: no "
    "telling where\n"
    "}\n";

/* Null is fine and stands for a default; anything else must be an identifier that every dialect takes. */
static int conemap__is_name(const char *name) {
    size_t k;
    if (!name) return 1;
    if (!conemap__is_letter(name[0]) || strncmp(name, "gl_", 3) == 0) return 0;
    for (k = 0; name[k]; ++k)
        if (k >= CONEMAP__NAME_SIZE - 1 || (!conemap__is_letter(name[k]) && !conemap__is_digit(name[k])) ||
            (name[k] == '_' && name[k + 1] == '_'))
            return 0;
    return 1;
}

static conemap_result conemap__resolve_emitted_effects(conemap__emitter *e);
static void conemap__make_effect_pieces(conemap__emitter *e);
static void conemap__write_resources(conemap__emitter *e);
static void conemap__write_effects(conemap__emitter *e);

/* Checks a desc, writes its defaults out and sets the flags that depend on single fields. */
static conemap_result conemap__resolve_shader(conemap__emitter *e) {
    conemap_shader_desc *d = &e->desc;
    unsigned char *f = e->flags;
    conemap_result result;
    conemap_tracer tracer;
    int k, m, relaxed;
    if (!CONEMAP__KNOWN(d->dialect, CONEMAP_DIALECT_COUNT) || !CONEMAP__KNOWN(d->stage, CONEMAP_STAGE_COUNT) ||
        !CONEMAP__KNOWN(d->filter, CONEMAP_FILTER_COUNT) ||
        !CONEMAP__KNOWN(d->precision, CONEMAP_PRECISION_COUNT) ||
        !CONEMAP__KNOWN(d->map.wrap_u, CONEMAP_WRAP_COUNT) || !CONEMAP__KNOWN(d->map.wrap_v, CONEMAP_WRAP_COUNT) ||
        !CONEMAP__KNOWN(d->map.guarantee, CONEMAP_GUARANTEE_COUNT))
        return CONEMAP_ERROR_ENUM;
    result = conemap__resolve_trace(&d->trace);
    if (result == CONEMAP_OK) result = conemap__check_texture(&d->map.texture);
    if (result != CONEMAP_OK) return result;
    if (d->map.aspect == 0.0f) d->map.aspect = 1.0f;
    if (d->map.max_tan == 0.0f) d->map.max_tan = 1.0f;
    if (!conemap__in_range(d->map.aspect, 1.0f / 32768.0f, 32768.0f) ||
        !conemap__in_range(d->map.max_tan, 1e-30f, CONEMAP_TAN_LIMIT) || d->set < 0 || d->set > 1024 ||
        d->binding < 0 || d->binding > 65536 || d->sampler_binding < 0 || d->sampler_binding > 65536)
        return CONEMAP_ERROR_PARAMETER;
    if (d->fixed_size && (d->map.width < 1 || d->map.height < 1 || d->map.width > CONEMAP_MAX_SIZE ||
                          d->map.height > CONEMAP_MAX_SIZE))
        return CONEMAP_ERROR_SIZE;
    e->given[0] = d->prefix;
    e->given[1] = d->map_name;
    e->given[2] = d->heights_name;
    e->given[3] = d->maxima_name;
    e->given[4] = d->sampler_name;
    e->given[5] = d->fetch;
    e->given[6] = d->fetch_maxima;
    e->given[7] = d->octants_name;
    e->given[8] = d->fetch_cones;
    for (k = 0; k < CONEMAP__GIVEN; ++k) {
        if (!conemap__is_name(e->given[k])) return CONEMAP_ERROR_PARAMETER;
        for (m = 0; m < k; ++m)
            if (e->given[k] && e->given[m] && strcmp(e->given[k], e->given[m]) == 0)
                return CONEMAP_ERROR_PARAMETER;
    }

    tracer = d->trace.tracer;
    e->prefix = d->prefix ? d->prefix : "conemap";
    f[conemap__flag_c] = d->dialect == CONEMAP_C99;
    f[conemap__flag_hlsl] = d->dialect == CONEMAP_HLSL_50 || d->dialect == CONEMAP_HLSL_60;
    f[conemap__flag_glsl] = !f[conemap__flag_c] && !f[conemap__flag_hlsl];
    f[conemap__flag_es] = d->dialect == CONEMAP_ESSL_300 || d->dialect == CONEMAP_ESSL_310;
    f[conemap__flag_vulkan] = d->dialect == CONEMAP_GLSL_450_VULKAN;
    f[conemap__flag_exact] = tracer == CONEMAP_TRACE_EXACT;
    f[conemap__flag_linear] = tracer == CONEMAP_TRACE_LINEAR;
    f[conemap__flag_loop] = tracer == CONEMAP_TRACE_LOOP || tracer == CONEMAP_TRACE_FIXED;
    f[conemap__flag_exact_step] = tracer == CONEMAP_TRACE_EXACT_STEP;
    f[conemap__flag_cell_max] = tracer == CONEMAP_TRACE_CELL_MAX;
    f[conemap__flag_maxmip] = tracer == CONEMAP_TRACE_MAXMIP;
    f[conemap__flag_qdm] = tracer == CONEMAP_TRACE_QDM;
    f[conemap__flag_blocks] = f[conemap__flag_maxmip] || f[conemap__flag_qdm];
    f[conemap__flag_solves] = f[conemap__flag_exact] || f[conemap__flag_blocks];
    f[conemap__flag_cones] = !f[conemap__flag_blocks] && !f[conemap__flag_linear];
    f[conemap__flag_secant] = !f[conemap__flag_solves] && d->trace.refinement == CONEMAP_REFINE_SECANT;
    f[conemap__flag_bisect] = !f[conemap__flag_solves] && d->trace.refinement == CONEMAP_REFINE_BISECT;
    f[conemap__flag_refined] = !f[conemap__flag_solves] && d->trace.refinement != CONEMAP_REFINE_NONE;
    f[conemap__flag_adaptive] = tracer == CONEMAP_TRACE_LOOP && d->trace.adaptive_steps;
    f[conemap__flag_any] = d->trace.any_hit && (f[conemap__flag_exact] || f[conemap__flag_maxmip]);
    relaxed =
        d->map.guarantee == CONEMAP_GUARANTEE_RELAXED || d->map.guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR;
    f[conemap__flag_back] = f[conemap__flag_exact] && !f[conemap__flag_any] &&
                            d->map.guarantee != CONEMAP_GUARANTEE_DEFAULT &&
                            d->map.guarantee != CONEMAP_GUARANTEE_BILINEAR;
    f[conemap__flag_falling] = relaxed && f[conemap__flag_exact];
    f[conemap__flag_wrap_u] = d->map.wrap_u == CONEMAP_WRAP;
    f[conemap__flag_wrap_v] = d->map.wrap_v == CONEMAP_WRAP;
    f[conemap__flag_wraps] = f[conemap__flag_wrap_u] || f[conemap__flag_wrap_v];
    f[conemap__flag_nothing_u] = d->map.wrap_u == CONEMAP_NOTHING;
    f[conemap__flag_nothing_v] = d->map.wrap_v == CONEMAP_NOTHING;
    f[conemap__flag_nothing] = f[conemap__flag_nothing_u] || f[conemap__flag_nothing_v];
    f[conemap__flag_host] = d->fetch != NULL;
    f[conemap__flag_host_maxima] = d->fetch_maxima != NULL && f[conemap__flag_blocks];
    f[conemap__flag_per_cell] = d->map.texture.per_cell && f[conemap__flag_cones];
    f[conemap__flag_sectors] = d->map.texture.sectors > 1 && f[conemap__flag_cones];
    f[conemap__flag_octants] = d->map.texture.sectors == 8 && f[conemap__flag_cones];
    f[conemap__flag_uses_octants] = f[conemap__flag_octants] && !d->fetch;
    f[conemap__flag_both] = f[conemap__flag_cones] && !f[conemap__flag_sectors];
    f[conemap__flag_cone_only] = /* heights in a texture of their own */
        (d->map.texture.layout == CONEMAP_CONE_ONLY || d->map.texture.sectors > 1) && !d->fetch;
    f[conemap__flag_hardware] = d->filter == CONEMAP_FILTER_HARDWARE;
    f[conemap__flag_gather] = d->filter == CONEMAP_FILTER_GATHER;
    f[conemap__flag_apart] = f[conemap__flag_cone_only] || f[conemap__flag_per_cell] || f[conemap__flag_sectors];
    f[conemap__flag_cone_texel] = f[conemap__flag_both] && f[conemap__flag_per_cell] &&
                                  (f[conemap__flag_gather] || f[conemap__flag_hardware]);
    f[conemap__flag_steps] = d->steps != 0 && !f[conemap__flag_any];
    f[conemap__flag_status] = d->status != 0 && !f[conemap__flag_any];
    f[conemap__flag_debug] = f[conemap__flag_steps] || f[conemap__flag_status];
    f[conemap__flag_t_range] = d->t_range != 0;
    f[conemap__flag_cap] = d->run_time_cap != 0;
    f[conemap__flag_atlas] = d->atlas != 0;
    f[conemap__flag_array] = d->array != 0;
    f[conemap__flag_external] = d->external != 0;
    f[conemap__flag_size_argument] = d->fetch && !d->fixed_size && !d->atlas;
    f[conemap__flag_size_asked] = !d->fetch && !d->fixed_size && !d->atlas;
    f[conemap__flag_fragment] = d->stage == CONEMAP_STAGE_FRAGMENT;
    f[conemap__flag_compute] = d->stage == CONEMAP_STAGE_COMPUTE;
    f[conemap__flag_uses_map] = !d->fetch && (f[conemap__flag_cones] || !f[conemap__flag_cone_only]);
    f[conemap__flag_uses_heights] = f[conemap__flag_cone_only];
    f[conemap__flag_uses_maxima] = f[conemap__flag_blocks] && !d->fetch_maxima;
    f[conemap__flag_sampler] = f[conemap__flag_hlsl] && !d->fetch && d->filter != CONEMAP_FILTER_FETCH;
    f[conemap__flag_located] = d->dialect != CONEMAP_GLSL_330 && d->dialect != CONEMAP_ESSL_300;
    f[conemap__flag_version] = f[conemap__flag_glsl] && d->stage != CONEMAP_STAGE_FUNCTIONS;
    f[conemap__flag_discards] = f[conemap__flag_fragment] && !f[conemap__flag_any] && !f[conemap__flag_status];
    f[conemap__flag_arguments] = f[conemap__flag_cap] || f[conemap__flag_atlas] || f[conemap__flag_array] ||
                                 f[conemap__flag_size_argument] ||
                                 (f[conemap__flag_t_range] && !f[conemap__flag_compute]);
    {
        int old = !f[conemap__flag_located], exact = f[conemap__flag_solves];
        if ((old &&
             (d->stage == CONEMAP_STAGE_COMPUTE || d->filter == CONEMAP_FILTER_GATHER || d->binding != 0)) ||
            (d->set != 0 && !f[conemap__flag_vulkan] && d->dialect != CONEMAP_HLSL_60) ||
            (d->sampler_binding != 0 && !f[conemap__flag_hlsl]) ||
            (d->precision != CONEMAP_HIGHP && !f[conemap__flag_es]) ||
            (f[conemap__flag_c] && (d->stage != CONEMAP_STAGE_FUNCTIONS || !d->fetch || d->binding != 0)) ||
            (f[conemap__flag_c] && f[conemap__flag_blocks] && !d->fetch_maxima) ||
            (exact && f[conemap__flag_hardware]) || (d->fetch && f[conemap__flag_gather]) ||
            (d->fetch && f[conemap__flag_hardware] && f[conemap__flag_per_cell]) ||
            (d->fetch && f[conemap__flag_sectors] && !d->fetch_cones) ||
            (d->atlas && (d->filter != CONEMAP_FILTER_FETCH || d->fixed_size || f[conemap__flag_blocks])) ||
            (f[conemap__flag_per_cell] && d->map.texture.encoding == CONEMAP_RADIUS) ||
            (d->external && d->stage != CONEMAP_STAGE_FUNCTIONS) || (d->trace.any_hit && !f[conemap__flag_any]) ||
            (f[conemap__flag_any] && (d->steps || d->status)))
            return CONEMAP_ERROR_UNSUPPORTED;
    }
    return conemap__resolve_emitted_effects(e);
}

/* An expression that reads a texture: `place` is what the dialect wants between the brackets. */
static void conemap__read_texture(conemap__emitter *e, char *out, const char *texture, const char *how,
                                  const char *place, const char *swizzle) {
    if (e->flags[conemap__flag_hlsl]) {
        conemap__append(out, CONEMAP__PIECE_SIZE, texture);
        conemap__append(out, CONEMAP__PIECE_SIZE, how);
        conemap__append(out, CONEMAP__PIECE_SIZE, place);
    } else {
        conemap__append(out, CONEMAP__PIECE_SIZE, how);
        conemap__append(out, CONEMAP__PIECE_SIZE, texture);
        conemap__append(out, CONEMAP__PIECE_SIZE, place);
    }
    conemap__append(out, CONEMAP__PIECE_SIZE, swizzle);
}

/* layout(...), : register(...) for the next resource. */
static void conemap__place_resource(conemap__emitter *e, const char *name, char kind, int number) {
    char *out = conemap__piece_new(e, name, 1);
    const size_t size = CONEMAP__PIECE_SIZE;
    char letter[2];
    letter[0] = kind;
    letter[1] = 0;
    if (e->flags[conemap__flag_hlsl]) {
        conemap__append(out, size, " : register(");
        conemap__append(out, size, letter);
        conemap__append_int(out, size, number);
        if (e->desc.set != 0) {
            conemap__append(out, size, ", space");
            conemap__append_int(out, size, e->desc.set);
        }
        conemap__append(out, size, ")");
    } else if (e->flags[conemap__flag_located]) {
        conemap__append(out, size, kind == 'b' ? ", " : "layout(");
        if (e->flags[conemap__flag_vulkan]) {
            conemap__append(out, size, "set = ");
            conemap__append_int(out, size, e->desc.set);
            conemap__append(out, size, ", ");
        }
        conemap__append(out, size, "binding = ");
        conemap__append_int(out, size, number);
        if (kind != 'b') conemap__append(out, size, ") ");
    }
}

static const char *conemap__resource_name(conemap__emitter *e, int index, const char *given, const char *ending) {
    if (given) return given;
    e->names[index][0] = 0;
    conemap__append(e->names[index], sizeof e->names[index], e->prefix);
    conemap__append(e->names[index], sizeof e->names[index], ending);
    return e->names[index];
}

/* Says what every piece stands for. */
static void conemap__make_pieces(conemap__emitter *e) {
    static const char *const versions[CONEMAP_DIALECT_COUNT] = {
        "330 core", "430 core", "450 core", "450", "300 es", "310 es", "", "", ""};
    static const char *const tracers[CONEMAP_TRACER_COUNT] = {"exact",    "exact",      "linear",
                                                              "fixed",    "loop",       "exact-step",
                                                              "cell-max", "max-mipmap", "quadtree displacement"};
    static const char *const formats[CONEMAP_FORMAT_COUNT] = {"32f", "16f", "16", "8"};
    static const char *const encodings[CONEMAP_ENCODING_COUNT] = {"tan of the cone", "sqrt(tan) of the cone",
                                                                  "radius of the cone at z = 1"};
    const conemap_shader_desc *d = &e->desc;
    const unsigned char *f = e->flags;
    const size_t size = CONEMAP__PIECE_SIZE;
    const int hlsl = f[conemap__flag_hlsl], array = f[conemap__flag_array], cones = f[conemap__flag_cones];
    const int blocks = f[conemap__flag_blocks], host = f[conemap__flag_host],
              unorm = d->map.texture.format >= CONEMAP_UNORM16;
    const char *map = "$MAP_NAME",
               *heights = "$HEIGHTS_NAME"; /* pieces, so that no word of a host's name is changed */
    const char *height_texture = f[conemap__flag_cone_only] ? heights : map;
    const char *octants = "$OCTANTS_NAME";
    const int both = f[conemap__flag_both], filtered = f[conemap__flag_hardware] && !f[conemap__flag_per_cell];
    const char *cone_swizzle = f[conemap__flag_cone_only] ? ".r" : ".g";
    const char *w = "size.x", *h = "size.y", *fetch, *sample, *uv, *point, *gathers, *texel;
    char number_w[16], number_h[16];
    char *out;
    int binding = d->binding, k;

    /* Sizes, arguments, types. */
    if (d->fixed_size) {
        number_w[0] = number_h[0] = 0;
        conemap__append_int(number_w, sizeof number_w, d->map.width);
        conemap__append_int(number_h, sizeof number_h, d->map.height);
        w = number_w;
        h = number_h;
    } else if (d->atlas) {
        w = "rect.z";
        h = "rect.w";
    }
    conemap__piece_set(e, "W", 1, w);
    conemap__piece_set(e, "H", 1, h);
    for (k = 0; k < 3; ++k) { /* as floats: width, height, the longer */
        static const char *const names[3] = {"FW", "FH", "LONGEST"};
        const char *side = k == 0 || (k == 2 && d->map.width >= d->map.height) ? w : h;
        out = conemap__piece_new(e, names[k], 0);
        if (d->fixed_size) {
            conemap__append(out, size, side);
            conemap__append(out, size, ".0f");
        } else if (k == 2) {
            conemap__append(out, size,
                            d->atlas ? "float(rect.z > rect.w ? rect.z : rect.w)"
                                     : "float(size.x > size.y ? size.x : size.y)");
        } else {
            conemap__append(out, size, "float(");
            conemap__append(out, size, side);
            conemap__append(out, size, ")");
        }
    }
    out = conemap__piece_new(e, "SIZE_PARAMS", 0);
    conemap__append(out, size, d->fixed_size ? "" : d->atlas ? ", ivec4 rect" : ", ivec2 size");
    out = conemap__piece_new(e, "MAP_PARAMS", 0);
    conemap__append(out, size, "$SIZE_PARAMS$SLICE_PARAM$LEVEL_PARAM");
    conemap__piece_set(e, "SLICE_PARAM", 0, array ? ", int slice" : "");
    conemap__piece_set(e, "SLICE_ARG", 0, array ? ", slice" : "");
    conemap__piece_set(e, "LEVEL_PARAM", 0, f[conemap__flag_lod] ? ", int level" : "");
    conemap__piece_set(e, "LAYER", 0, f[conemap__flag_lod] ? "$SLICE_ARG, level" : "$SLICE_ARG");
    conemap__piece_set(e, "LOD", 0, f[conemap__flag_lod] ? "level" : "0");
    conemap__piece_set(e, "SIZE", 0, d->fixed_size ? "" : d->atlas ? ", rect" : ", size");
    conemap__piece_set(e, "MAP", 0, "$SIZE$LAYER");
    conemap__piece_set(e, "RANGE_PARAMS", 0, d->t_range ? ", float t_min, float t_max" : "");
    conemap__piece_set(e, "RANGE", 0, d->t_range ? ", t_min, t_max" : "");
    out = conemap__piece_new(e, "PARAMS", 0);
    conemap__append(out, size, "$RANGE_PARAMS");
    if (d->run_time_cap) conemap__append(out, size, ", int max_steps");
    conemap__append(out, size, f[conemap__flag_size_asked] ? "$SLICE_PARAM" : "$MAP_PARAMS");
    out = conemap__piece_new(e, "SIGNATURE", 0); /* of the comment */
    conemap__append(out, size, "origin, direction$RANGE");
    if (d->run_time_cap) conemap__append(out, size, ", max_steps");
    if (!f[conemap__flag_size_asked]) conemap__append(out, size, "$SIZE");
    if (array) conemap__append(out, size, ", slice");
    out = conemap__piece_new(e, "ARGS", 0); /* of the call in main */
    if (d->t_range && d->stage == CONEMAP_STAGE_FRAGMENT)
        conemap__append(out, size, ", conemap_range.x, conemap_range.y");
    if (d->run_time_cap) conemap__append(out, size, ", conemap_max_steps");
    if (d->atlas) conemap__append(out, size, ", conemap_rect");
    if (f[conemap__flag_size_argument]) conemap__append(out, size, ", conemap_map_size");
    if (array) conemap__append(out, size, ", conemap_slice");
    conemap__piece_set(e, "STRUCT", 0, f[conemap__flag_c] ? "typedef struct" : "struct");
    conemap__piece_set(e, "FN", 1, f[conemap__flag_c] ? "static " : "");

    out = conemap__piece_new(e, "SIZE_ASKED", 0);
    conemap__append(out, size,
                    hlsl    ? "conemap_size()"
                    : array ? "textureSize($ANY_TEXTURE, 0).xy"
                            : "textureSize($ANY_TEXTURE, 0)");

    /* The ray. */
    conemap__piece_set(e, "T_MIN", 0, d->t_range ? "t_min" : "0.0f");
    conemap__piece_set(e, "T_MAX_STATUS", 0,
                       !d->t_range                ? "1"
                       : f[conemap__flag_nothing] ? "(box.y == t_max ? 3 : 1)"
                                                  : "range.x <= range.y && range.y == t_max ? 3 : 1");
    conemap__piece_set(e, "CLIP_U", 0,
                       f[conemap__flag_nothing_u]
                           ? "conemap_clip(range, origin.x, direction.x, rim_u, 1.0f - rim_u)"
                           : "conemap_clip(range, origin.x, direction.x, 0.0f, 1.0f)");
    conemap__piece_set(e, "LOW_V", 0, f[conemap__flag_nothing_v] ? "rim_v" : "0.0f");
    conemap__piece_set(e, "HIGH_V", 0, f[conemap__flag_nothing_v] ? "1.0f - rim_v" : "1.0f");
    out = conemap__piece_new(e, "ASPECT2", 0);
    if (d->map.aspect != 1.0f) {
        conemap__append_float(out, size, d->map.aspect * d->map.aspect);
        conemap__append(out, size, " * ");
    }

    /* Steps. */
    out = conemap__piece_new(e, "CAP", 0);
    k = d->trace.tracer == CONEMAP_TRACE_FIXED ? 10 : d->trace.max_steps;
    if (d->run_time_cap) {
        conemap__append(out, size, "max_steps");
    } else if (k > 0) {
        conemap__append_int(out, size, k);
    } else {
        int times = (blocks ? 16 : 4) * (f[conemap__flag_wraps] ? 16 : 1);
        if (d->fixed_size) {
            conemap__append_int(out, size, times * (d->map.width + d->map.height));
        } else {
            conemap__append_int(out, size, times);
            conemap__append(out, size, d->atlas ? " * (rect.z + rect.w)" : " * (size.x + size.y)");
        }
    }
    conemap__piece_set(e, "LIMIT", 0,
                       f[conemap__flag_adaptive]                          ? "step_count + 1"
                       : f[conemap__flag_linear] || f[conemap__flag_loop] ? "$CAP + 1"
                                                                          : "$CAP");
    out = conemap__piece_new(e, "SCALE", 0);
    if (d->trace.step_scale != 1.0f) {
        conemap__append_float(out, size, d->trace.step_scale);
        conemap__append(out, size, " * ");
    }
    conemap__append_float(conemap__piece_new(e, "TOLERANCE", 0), size, d->trace.tolerance);
    conemap__append_int(conemap__piece_new(e, "REFINE_STEPS", 0), size, d->trace.refine_steps);
    conemap__append_float(conemap__piece_new(e, "MAX_TAN", 0), size, d->map.max_tan);
    conemap__piece_set(e, "TANGENT", 0,
                       d->map.texture.encoding == CONEMAP_SQRT     ? "cone * cone"
                       : d->map.texture.encoding == CONEMAP_RADIUS ? "conemap_tangent(cone, height)"
                                                                   : "cone");
    out = conemap__piece_new(e, "CONES_DENIED", 0);
    if (f[conemap__flag_falling]) conemap__append(out, size, " || v.z >= 0.0f");
    conemap__append(out, size, " || t < walked");
    conemap__piece_set(e, "FOUND", 0, f[conemap__flag_solves] ? "hit >= 0.0f" : "found");
    conemap__piece_set(e, "BOOLS", 0, f[conemap__flag_solves] ? "" : ", found = false, ends = false");
    out = conemap__piece_new(e, "STATE", 0);
    conemap__append(out, size, f[conemap__flag_solves] ? ", hit = -1.0f" : ", gap = 0.0f");
    if (cones)
        conemap__append(out, size,
                        ", speed = sqrt(direction.x * direction.x + $ASPECT2direction.y * direction.y)");
    if (f[conemap__flag_back]) conemap__append(out, size, ", flown = 0.0f, walked = -1.0f");
    if (f[conemap__flag_secant]) conemap__append(out, size, ", above = 0.0f");
    if (f[conemap__flag_loop] && f[conemap__flag_refined]) conemap__append(out, size, ", t_above = range.x");
    conemap__piece_set(e, "EXTRA", 0, f[conemap__flag_exact_step] ? " + extra" : "");
    k = f[conemap__flag_solves] ||
        (f[conemap__flag_exact_step] && !f[conemap__flag_refined]); /* dt is still to go */
    conemap__piece_set(e, "AT_X", 0, k ? "(x + v.x * dt)" : "x");
    conemap__piece_set(e, "AT_Y", 0, k ? "(y + v.y * dt)" : "y");
    conemap__piece_set(e, "AT_Z", 0, k ? "z + v.z * dt" : "z");
    conemap__piece_set(e, "AT_T", 0, k ? "t + dt" : "t");

    /* Blocks. */
    conemap__piece_set(e, "CELLS_U", 0,
                       f[conemap__flag_wrap_u]      ? "$W"
                       : f[conemap__flag_nothing_u] ? "($W > 1 ? $W - 1 : 1)"
                                                    : "$W + 1");
    conemap__piece_set(e, "CELLS_V", 0,
                       f[conemap__flag_wrap_v]      ? "$H"
                       : f[conemap__flag_nothing_v] ? "($H > 1 ? $H - 1 : 1)"
                                                    : "$H + 1");
    conemap__piece_set(e, "CELL_U", 0,
                       f[conemap__flag_wrap_u]      ? "conemap_repeat(si > 0 ? i : i - 1, $W)"
                       : f[conemap__flag_nothing_u] ? "clamp(si > 0 ? i : i - 1, 0, cells_u - 1)"
                                                    : "clamp(si > 0 ? i + 1 : i, 0, cells_u - 1)");
    conemap__piece_set(e, "CELL_V", 0,
                       f[conemap__flag_wrap_v]      ? "conemap_repeat(sj > 0 ? j : j - 1, $H)"
                       : f[conemap__flag_nothing_v] ? "clamp(sj > 0 ? j : j - 1, 0, cells_v - 1)"
                                                    : "clamp(sj > 0 ? j + 1 : j, 0, cells_v - 1)");

    /* Texture reads. */
    fetch = hlsl ? ".Load" : "texelFetch(";
    texel = hlsl    ? (array ? "(int4($I, $J, slice, $LOD))" : "(int3($I, $J, $LOD))")
            : array ? ", ivec3($I, $J, slice), $LOD)"
                    : ", ivec2($I, $J), $LOD)";
    for (k = 0; k < 2; ++k) { /* the texel of an index, inside the map and the atlas */
        out = conemap__piece_new(e, k == 0 ? "I" : "J", 0);
        if (d->atlas) conemap__append(out, size, k == 0 ? "rect.x + " : "rect.y + ");
        conemap__append(out, size,
                        f[k == 0 ? conemap__flag_wrap_u : conemap__flag_wrap_v]
                            ? (k == 0 ? "conemap_repeat(i, $W)" : "conemap_repeat(j, $H)")
                            : (k == 0 ? "clamp(i, 0, $W - 1)" : "clamp(j, 0, $H - 1)"));
    }
    sample = hlsl ? ".SampleLevel($SAMPLER_NAME" : "textureLod(";
    uv = hlsl    ? (array ? ", float3(uv, float(slice)), 0.0)" : ", uv, 0.0)")
         : array ? ", vec3(uv, float(slice)), 0.0)"
                 : ", uv, 0.0)";
    point = array ? ", vec3(u, v, float(slice)), 0.0)" : ", vec2(u, v), 0.0)";
    out = conemap__piece_new(e, "TEXEL", 0);
    if (host) {
        conemap__append(out, size, "$FETCH_NAME");
        conemap__append(out, size, "($I, $J$LAYER)");
    } else if (f[conemap__flag_cone_texel]) {
        conemap__read_texture(e, out, map, fetch, texel, cone_swizzle);
    } else if (!both) {
        conemap__read_texture(e, out, height_texture, fetch, texel, ".r");
    } else if (f[conemap__flag_cone_only]) {
        conemap__append(out, size, hlsl ? "float2(" : "vec2(");
        conemap__read_texture(e, out, heights, fetch, texel, ".r, ");
        conemap__read_texture(e, out, map, fetch, texel, ".r)");
    } else {
        conemap__read_texture(e, out, map, fetch, texel, ".rg");
    }
    conemap__piece_set(e, "CONE_PARAMS", 0,
                       filtered ? "$FETCH_PLACE, int sector$SLICE_PARAM" : "int i, int j, int sector$MAP_PARAMS");
    conemap__piece_set(e, "FETCH_PLACE", 0, f[conemap__flag_hardware] ? "float u, float v" : "int i, int j");
    conemap__piece_set(e, "STORED_CONE", 0,
                       filtered ? (array ? "$FETCH_CONES_NAME(u, v, sector, slice)" : "$FETCH_CONES_NAME(u, v, sector)")
                                : "$FETCH_CONES_NAME($I, $J, sector$LAYER)");
    for (k = 0; k < 2; ++k)
        conemap__read_texture(e, conemap__piece_new(e, k == 0 ? "QUADRANTS" : "OCTANTS", 0), k == 0 ? map : octants,
                              filtered ? sample : fetch, filtered ? point : texel, "");
    out = conemap__piece_new(e, "SAMPLE", 0);
    if (host) {
        conemap__append(out, size, "$FETCH_NAME");
        conemap__append(out, size, array ? "(uv.x, uv.y, slice)" : "(uv.x, uv.y)");
        conemap__piece_set(e, "SAMPLE_HEIGHT", 0, out);
    } else {
        conemap__read_texture(e, out, map, sample, uv, ".rg");
        conemap__read_texture(e, conemap__piece_new(e, "SAMPLE_HEIGHT", 0), height_texture, sample, uv, ".r");
    }
    if (both)
        conemap__read_texture(e, conemap__piece_new(e, "SAMPLE_CONE", 0), map, sample, uv, cone_swizzle);
    else
        conemap__piece_set(e, "SAMPLE_CONE", 0, array ? "conemap_cone(uv.x, uv.y, sector, slice)" : "conemap_cone(uv.x, uv.y, sector)");
    for (k = 0; k < 2; ++k) {
        const int green = k == 1 && !f[conemap__flag_cone_only];
        out = conemap__piece_new(e, k == 0 ? "GATHER_HEIGHTS" : "GATHER_CONES", 0);
        if (hlsl) {
            conemap__append(out, size, k == 0 ? height_texture : map);
            conemap__append(out, size, green ? ".GatherGreen(" : ".GatherRed(");
            conemap__append(out, size, "$SAMPLER_NAME");
            conemap__append(out, size, array ? ", float3(uv, float(slice)))" : ", uv)");
        } else {
            gathers = array ? ", vec3(uv, float(slice))" : ", uv";
            conemap__append(out, size, "textureGather(");
            conemap__append(out, size, k == 0 ? height_texture : map);
            conemap__append(out, size, gathers);
            conemap__append(out, size, green ? ", 1)" : ")");
        }
    }
    out = conemap__piece_new(e, "MAXIMUM", 0);
    if (d->fetch_maxima) {
        conemap__append(out, size, "$FETCH_MAXIMA_NAME");
        conemap__append(out, size,
                        array ? "(cell_u >> k, cell_v >> k, k, slice)" : "(cell_u >> k, cell_v >> k, k)");
    } else {
        conemap__read_texture(
            e, out, "$MAXIMA_NAME", fetch,
            hlsl ? (array ? "(int4(cell_u >> k, cell_v >> k, slice, k))" : "(int3(cell_u >> k, cell_v >> k, k))")
            : array ? ", ivec3(cell_u >> k, cell_v >> k, slice), k)"
                    : ", ivec2(cell_u >> k, cell_v >> k), k)",
            ".r");
    }
    if (f[conemap__flag_kernel]) {
        conemap__piece_set(e, "FIRST_CELL_U", 0, d->map.wrap_u == CONEMAP_CLAMP ? "i - 1" : "i");
        conemap__piece_set(e, "FIRST_CELL_V", 0, d->map.wrap_v == CONEMAP_CLAMP ? "j - 1" : "j");
        conemap__piece_set(e, "SHARE_U", 0, f[conemap__flag_wrap_u] ? "0.5f" : "(i > 0 && i < $W - 1 ? 0.5f : 1.0f)");
        conemap__piece_set(e, "SHARE_V", 0, f[conemap__flag_wrap_v] ? "0.5f" : "(j > 0 && j < $H - 1 ? 0.5f : 1.0f)");
        conemap__piece_set(e, "REPEATS_U", 0, f[conemap__flag_wrap_u] ? "true" : "false");
        conemap__piece_set(e, "REPEATS_V", 0, f[conemap__flag_wrap_v] ? "true" : "false");
        conemap__piece_set(e, "COPIES", 0, f[conemap__flag_wrap_u] && f[conemap__flag_wrap_v] ? "9" : "3");
        conemap__piece_set(e, "COPY_U", 0, f[conemap__flag_wrap_u] ? "i + (int(uint(copy + 1) % 3u) - 1) * $W" : "i");
        conemap__piece_set(e, "COPY_V", 0,
                           !f[conemap__flag_wrap_v]  ? "j"
                           : f[conemap__flag_wrap_u] ? "j + (int(uint(copy + 3) / 3u % 3u) - 1) * $H"
                                                     : "j + (int(uint(copy + 1) % 3u) - 1) * $H");
        if (d->fetch_maxima)
            conemap__piece_set(e, "MAXIMUM_AT", 0, "$FETCH_MAXIMA_NAME(x, y, k)");
        else
            conemap__read_texture(e, conemap__piece_new(e, "MAXIMUM_AT", 0), "$MAXIMA_NAME", fetch,
                                  hlsl ? "(int3(x, y, k))" : ", ivec2(x, y), k)", ".r");
        conemap__append(conemap__piece_new(e, "KEPT", 0), size,
                        f[conemap__flag_host_state] ? "$FETCH_CONES_NAME(i, j)"
                        : hlsl                      ? "$MAP_NAME.Load(int3(i, j, 0)).r"
                                                    : "texelFetch($MAP_NAME, ivec2(i, j), 0).r");
        conemap__append(conemap__piece_new(e, "SLOPE", 0), size,
                        f[conemap__flag_host_state] ? "$FETCH_CONES_NAME($I, $J)"
                        : hlsl                      ? "$MAP_NAME.Load(int3($I, $J, 0)).r"
                                                    : "texelFetch($MAP_NAME, ivec2($I, $J), 0).r");
        conemap__append_float(conemap__piece_new(e, "ASPECT", 0), size, d->map.aspect);
        conemap__piece_set(e, "SCALE_MAX", 0, d->map.texture.format == CONEMAP_UNORM8 ? "255.0f" : "65535.0f");
    }
    conemap__piece_set(e, "TEXEL_TYPE", 0, !both || f[conemap__flag_cone_texel] ? "float" : "vec2");
    conemap__piece_set(e, "ANY_TEXTURE", 0, f[conemap__flag_uses_map] ? map : heights);
    conemap__piece_set(e, "LAYERS", 1, array ? ", layers" : "");

    /* Resources. */
    conemap__piece_set(e, "VERSION", 1, versions[d->dialect]);
    conemap__piece_set(e, "TRACER", 1, tracers[d->trace.tracer]);
    conemap__piece_set(e, "PRECISION", 1, d->precision == CONEMAP_MEDIUMP ? "mediump" : "highp");
    conemap__piece_set(e, "MAP_NAME", 1,
                       conemap__resource_name(e, 0, d->map_name, f[conemap__flag_kernel] ? "_state" : "_map"));
    conemap__piece_set(e, "HEIGHTS_NAME", 1, conemap__resource_name(e, 1, d->heights_name, "_heights"));
    conemap__piece_set(e, "MAXIMA_NAME", 1, conemap__resource_name(e, 2, d->maxima_name, "_maxima"));
    conemap__piece_set(e, "SAMPLER_NAME", 1, conemap__resource_name(e, 3, d->sampler_name, "_sampler"));
    conemap__piece_set(e, "OCTANTS_NAME", 1, conemap__resource_name(e, 4, d->octants_name, "_octants"));
    conemap__piece_set(e, "FETCH_NAME", 1, host ? d->fetch : "");
    conemap__piece_set(e, "FETCH_MAXIMA_NAME", 1, d->fetch_maxima ? d->fetch_maxima : "");
    conemap__piece_set(e, "FETCH_CONES_NAME", 1, d->fetch_cones ? d->fetch_cones : "");
    conemap__piece_set(e, "FETCH_PARAMS", 0,
                       f[conemap__flag_hardware] ? "$FETCH_PLACE$SLICE_PARAM" : "$FETCH_PLACE$SLICE_PARAM$LEVEL_PARAM");
    conemap__piece_set(e, "FETCH_COMMENT", 1, both ? "height, and the cone as stored" : "height");
    conemap__piece_set(e, "FILTER_COMMENT", 1,
                       f[conemap__flag_hardware] ? "; linear filter"
                       : f[conemap__flag_gather] ? "; gathered"
                                                 : "; only fetched");
    out = conemap__piece_new(e, "MAP_COMMENT", 1);
    conemap__append(out, size,
                    f[conemap__flag_sectors]                     ? "rgba"
                    : d->map.texture.layout == CONEMAP_CONE_ONLY ? "r"
                    : d->map.texture.layout == CONEMAP_DUMMER    ? "rgba"
                                                                 : "rg");
    conemap__append(out, size, formats[d->map.texture.format]);
    conemap__append(out, size, f[conemap__flag_cone_only] ? ", " : ", height and ");
    conemap__append(out, size, encodings[d->map.texture.encoding]);
    if (f[conemap__flag_sectors]) conemap__append(out, size, " in sectors 0 to 3");
    if (d->map.texture.per_cell) conemap__append(out, size, ", one for each cell");
    if (d->map.texture.layout == CONEMAP_DUMMER)
        conemap__append(out, size, f[conemap__flag_stored] ? ", and slopes" : ", and slopes, not read here");
    if (f[conemap__flag_lod]) conemap__append(out, size, "; a level in each mip");
    conemap__append(out, size,
                    f[conemap__flag_hardware] ? "; linear filter"
                    : f[conemap__flag_gather] ? "; gathered"
                                              : "; only fetched");
    out = conemap__piece_new(e, "SAMPLER", 1);
    if (f[conemap__flag_es])
        conemap__append(out, size,
                        d->map.texture.format == CONEMAP_UNORM8 && d->precision == CONEMAP_MEDIUMP ? "mediump "
                                                                                                   : "highp ");
    conemap__append(out, size, array ? "sampler2DArray" : "sampler2D");
    conemap__piece_set(e, "TEXTURE", 1, array ? "Texture2DArray" : "Texture2D");
    out = conemap__piece_new(e, "MAP_TYPE", 1);
    if (unorm) conemap__append(out, size, "unorm ");
    conemap__append(out, size,
                    f[conemap__flag_sectors]                     ? "float4"
                    : d->map.texture.layout == CONEMAP_CONE_ONLY ? "float"
                    : d->map.texture.layout == CONEMAP_DUMMER    ? "float4"
                                                                 : "float2");
    conemap__place_resource(e, "MAP_LAYOUT", 't', binding);
    binding += f[conemap__flag_uses_map];
    conemap__place_resource(e, "OCTANTS_LAYOUT", 't', binding);
    binding += f[conemap__flag_uses_octants];
    conemap__place_resource(e, "HEIGHTS_LAYOUT", 't', binding);
    binding += f[conemap__flag_uses_heights];
    conemap__place_resource(e, "MAXIMA_LAYOUT", 't', binding);
    binding += f[conemap__flag_uses_maxima];
    conemap__place_resource(e, "SAMPLER_LAYOUT", 's', d->sampler_binding);
    conemap__place_resource(e, "RAYS_LAYOUT", hlsl ? 't' : 'b', binding);
    conemap__place_resource(e, "HITS_LAYOUT", hlsl ? 'u' : 'b', hlsl ? d->binding : binding + 1);
    conemap__append_int(conemap__piece_new(e, "BINDING", 1), size, d->binding);
    conemap__piece_set(e, "IN_0", 1, f[conemap__flag_located] ? "layout(location = 0) " : "");
    conemap__piece_set(e, "IN_1", 1, f[conemap__flag_located] ? "layout(location = 1) " : "");
    conemap__piece_set(e, "UNIFORM", 1, hlsl || f[conemap__flag_vulkan] ? "    " : "uniform ");
    conemap__piece_set(e, "UNSIGNED", 1, hlsl ? "u" : "");
    conemap__piece_set(e, "DEBUG", 0,
                       f[conemap__flag_steps]
                           ? (f[conemap__flag_status] ? "float(hit.steps), float(hit.status), 0.0f, 0.0f"
                                                      : "float(hit.steps), 0.0f, 0.0f, 0.0f")
                           : "0.0f, float(hit.status), 0.0f, 0.0f");
}

/* The function that was asked for, after all that it needs. */
static void conemap__write_trace(conemap__emitter *e) {
    const unsigned char *f = e->flags;
    const char *parts[3];
    int k;
    parts[0] = conemap__trace_head;
    parts[1] = f[conemap__flag_exact]    ? conemap__loop_exact
               : f[conemap__flag_linear] ? conemap__loop_linear
               : f[conemap__flag_loop]   ? conemap__loop_loop
               : f[conemap__flag_blocks] ? conemap__loop_blocks
                                         : conemap__loop_step;
    parts[2] = conemap__trace_tail;
    for (k = 0; k < 6; ++k) conemap__lines(e, parts[k % 3], k < 3);
    if (e->desc.stage != CONEMAP_STAGE_FUNCTIONS || f[conemap__flag_shading]) conemap__put(e, "\n", 1);
}

/* One pass of the emitter; with text null it only counts. */
static conemap_result conemap__emit_once(const conemap_shader_desc *desc, char *text, size_t capacity,
                                         size_t *size) {
    conemap__emitter e;
    conemap_result result;
    memset(&e, 0, sizeof e);
    e.desc = *desc;
    e.text = text;
    e.capacity = capacity;
    result = conemap__resolve_shader(&e);
    if (result != CONEMAP_OK) return result;
    conemap__make_pieces(&e);
    conemap__make_effect_pieces(&e);
    conemap__lines(&e, conemap__head_text, 0);
    conemap__write_resources(&e);
    if (desc->fetch) {
        conemap__lines(&e, conemap__host_text, 1); /* C: the types that it is declared with */
        conemap__lines(&e, conemap__host_text, 0);
    }
    if (!e.flags[conemap__flag_flight]) conemap__write_trace(&e);
    if (e.flags[conemap__flag_shading])
        conemap__write_effects(&e);
    else if (e.flags[conemap__flag_fragment])
        conemap__lines(&e, conemap__fragment_text, 0);
    else if (e.flags[conemap__flag_compute])
        conemap__lines(&e, conemap__compute_text, 0);
    if (e.clash) return CONEMAP_ERROR_PARAMETER;
    *size = e.size + 1;
    if (text && e.size < capacity) text[e.size] = 0;
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_emit(const conemap_shader_desc *desc, char *text, size_t capacity,
                                         size_t *size) {
    size_t needed = 0;
    conemap_result result;
    if (!desc || (!text && !size)) return CONEMAP_ERROR_NULL;
    result = conemap__emit_once(desc, NULL, 0, &needed);
    if (result != CONEMAP_OK) return result;
    if (size) *size = needed;
    if (!text) return CONEMAP_OK;
    if (capacity < needed) return CONEMAP_ERROR_BUFFER;
    return conemap__emit_once(desc, text, capacity, &needed);
}

/* ---- kernels ---- */

static const char conemap__kernel_head[] =
    "?version #version $VERSION\n"
    "?ring // conemap.h: one batch of the ring search for cones.\n"
    "?steepest // conemap.h: of each 3x3 block the narrowest cone.\n"
    "?safe // conemap.h: cones made safe for the bilinear surface.\n"
    "?store // conemap.h: cones as the texture keeps them.\n"
    "?cells // conemap.h: maxima over bilinear cells, the finest level.\n"
    "?texels // conemap.h: maxima over texels, the finest level.\n"
    "?maxima // conemap.h: maxima, a level from the one below.\n"
    "?quick // conemap.h: quick cones.\n"
    "?search // conemap.h: exact cones, by branch and bound over maxima.\n"
    "?uses_heights // $HEIGHTS_NAME: height in the first channel; only fetched\n"
    "?uses_map // $MAP_NAME: r32f, the state: slope squared; only fetched\n"
    "?uses_maxima,!maxima // $MAXIMA_NAME: r32f, maxima over texels, with all mips; only fetched\n"
    "?uses_maxima,maxima // $MAXIMA_NAME: r32f, the levels below; only fetched\n"
    "?size_argument // size: the map's width and height in texels.\n"
    "?c #include <math.h>\n"
    "?quick,c #include <stdbool.h>\n"
    "?search,c #include <stdbool.h>\n"
    "\n"
    "?es precision $PRECISION float;\n"
    "?es precision highp int;\n"
    "?uses_map,glsl $MAP_LAYOUTuniform $SAMPLER $MAP_NAME;\n"
    "?uses_heights,glsl $HEIGHTS_LAYOUTuniform $SAMPLER $HEIGHTS_NAME;\n"
    "?uses_maxima,glsl $MAXIMA_LAYOUTuniform $SAMPLER $MAXIMA_NAME;\n"
    "?uses_map,hlsl Texture2D<float> $MAP_NAME$MAP_LAYOUT;\n"
    "?uses_heights,hlsl Texture2D<float> $HEIGHTS_NAME$HEIGHTS_LAYOUT;\n"
    "?uses_maxima,hlsl Texture2D<float> $MAXIMA_NAME$MAXIMA_LAYOUT;\n"
    "?host float $FETCH_NAME(int i, int j);\n"
    "?host_state float $FETCH_CONES_NAME(int i, int j);\n"
    "?host_maxima float $FETCH_MAXIMA_NAME(int i, int j, int level);\n"
    "\n";

static const char conemap__kernel_main[] =
    "?vulkan,argued layout(push_constant) uniform conemap_arguments {\n"
    "?hlsl,argued cbuffer conemap_arguments : register(b$BINDING) {\n"
    "?batched $UNIFORMint conemap_first, conemap_last;\n"
    "?levelled $UNIFORMint conemap_level;\n"
    "?vulkan,argued };\n"
    "?hlsl,argued };\n"
    "?fragment,glsl,located layout(location = 0) out vec4 conemap_color;\n"
    "?fragment,glsl,!located out vec4 conemap_color;\n"
    "?compute,glsl layout(local_size_x = 8, local_size_y = 8) in;\n"
    "?compute,glsl layout($OUT_FORMAT$OUT_LAYOUT) writeonly uniform highp image2D conemap_out;\n"
    "?compute,hlsl RWTexture2D<$OUT_TYPE> conemap_out$OUT_LAYOUT;\n"
    "\n"
    "?fragment,hlsl float4 main(float4 place : SV_Position) : SV_Target {\n"
    "?compute,hlsl [numthreads(8, 8, 1)]\n"
    "?compute,hlsl void main(uint3 thread : SV_DispatchThreadID) {\n"
    "?glsl void main() {\n"
    "?size_asked     ivec2 size = $SIZE_ASKED;\n"
    "?fragment,glsl     int i = int(gl_FragCoord.x), j = int(gl_FragCoord.y);\n"
    "?fragment,hlsl     int i = int(place.x), j = int(place.y);\n"
    "?compute,glsl     int i = int(gl_GlobalInvocationID.x), j = int(gl_GlobalInvocationID.y);\n"
    "?compute,hlsl     int i = int(thread.x), j = int(thread.y);\n"
    "?compute,!levels     if (i >= $W || j >= $H) return;\n"
    "?compute,levels,glsl     ivec2 side = imageSize(conemap_out);\n"
    "?compute,levels,glsl     if (i >= side.x || j >= side.y) return;\n"
    "?compute,levels,hlsl     uint width, height;\n"
    "?compute,levels,hlsl     conemap_out.GetDimensions(width, height);\n"
    "?compute,levels,hlsl     if (thread.x >= width || thread.y >= height) return;\n"
    "?fragment,glsl     conemap_color = vec4($RESULT);\n"
    "?fragment,hlsl     return vec4($RESULT);\n"
    "?compute,glsl     imageStore(conemap_out, ivec2(i, j), vec4($RESULT));\n"
    "?compute,hlsl     conemap_out[uint2(thread.xy)] = $RESULT_HLSL;\n"
    "}\n";

/* Sets the emitter up for a kernel: only the fields that matter are taken over from the desc. */
static conemap_result conemap__resolve_kernel(conemap__emitter *e, const conemap_shader_desc *desc,
                                              conemap_kernel kernel) {
    conemap_shader_desc *d = &e->desc;
    unsigned char *f = e->flags;
    conemap_texture texture = desc->map.texture;
    conemap_result result;
    int state, heights, maxima, es_compute;
    d->dialect = desc->dialect;
    d->stage = desc->stage;
    d->map = desc->map;
    d->map.guarantee = CONEMAP_GUARANTEE_DEFAULT;
    d->map.texture.per_cell = 0;
    d->map.texture.layout = CONEMAP_CONE_ONLY; /* heights in a texture of their own */
    d->fixed_size = desc->fixed_size;
    d->prefix = desc->prefix;
    d->binding = desc->binding;
    d->set = desc->set;
    d->precision = desc->precision;
    d->map_name = desc->map_name;
    d->heights_name = desc->heights_name;
    d->maxima_name = desc->maxima_name;
    d->fetch = desc->fetch;
    d->fetch_maxima = desc->fetch_maxima;
    d->fetch_cones = desc->fetch_cones;
    d->trace.tracer = CONEMAP_TRACE_LINEAR; /* which reads heights alone */
    if (!CONEMAP__KNOWN(kernel, CONEMAP_KERNEL_COUNT)) return CONEMAP_ERROR_ENUM;
    result = conemap__check_texture(&texture);
    if (result == CONEMAP_OK) result = conemap__resolve_shader(e);
    if (result != CONEMAP_OK) return result;
    f[conemap__flag_kernel] = 1;
    f[conemap__flag_linear] = 0;
    f[conemap__flag_ring] = kernel == CONEMAP_KERNEL_RING;
    f[conemap__flag_steepest] = kernel == CONEMAP_KERNEL_MIN3X3;
    f[conemap__flag_safe] = kernel == CONEMAP_KERNEL_SAFE;
    f[conemap__flag_store] = kernel == CONEMAP_KERNEL_STORE;
    f[conemap__flag_sqrt] = texture.encoding == CONEMAP_SQRT;
    f[conemap__flag_radius] = texture.encoding == CONEMAP_RADIUS;
    f[conemap__flag_unorm] = texture.format == CONEMAP_UNORM16 || texture.format == CONEMAP_UNORM8;
    f[conemap__flag_half] = texture.format == CONEMAP_F16;
    f[conemap__flag_cells] = kernel == CONEMAP_KERNEL_CELLS;
    f[conemap__flag_texels] = kernel == CONEMAP_KERNEL_TEXELS;
    f[conemap__flag_maxima] = kernel == CONEMAP_KERNEL_MAXIMA;
    f[conemap__flag_quick] = kernel == CONEMAP_KERNEL_QUICK;
    f[conemap__flag_search] = kernel == CONEMAP_KERNEL_EXACT;
    f[conemap__flag_improved] = d->map.generator != CONEMAP_QUICK_NAIVE &&
        d->map.generator != CONEMAP_QUICK_NAIVE_CENTER;
    f[conemap__flag_center] =
        d->map.generator == CONEMAP_QUICK_CENTER || d->map.generator == CONEMAP_QUICK_NAIVE_CENTER;
    f[conemap__flag_batched] = f[conemap__flag_ring] || f[conemap__flag_search];
    f[conemap__flag_levelled] = f[conemap__flag_maxima] || f[conemap__flag_search];
    f[conemap__flag_argued] = f[conemap__flag_batched] || f[conemap__flag_levelled];
    f[conemap__flag_levels] = f[conemap__flag_cells] || f[conemap__flag_texels] || f[conemap__flag_maxima];
    f[conemap__flag_pair] = f[conemap__flag_store] && texture.layout == CONEMAP_HEIGHT_CONE;
    f[conemap__flag_slopes] = f[conemap__flag_store] && texture.layout == CONEMAP_DUMMER;
    state = !f[conemap__flag_levels] && !f[conemap__flag_quick];
    maxima = f[conemap__flag_maxima] || f[conemap__flag_quick] || f[conemap__flag_search];
    heights = f[conemap__flag_store] ? f[conemap__flag_radius] || f[conemap__flag_slopes] ||
                                           (f[conemap__flag_pair] && d->stage != CONEMAP_STAGE_FUNCTIONS)
                                     : !f[conemap__flag_steepest] && !f[conemap__flag_maxima];
    f[conemap__flag_host] = d->fetch && heights;
    f[conemap__flag_host_state] = d->fetch && state;
    f[conemap__flag_host_maxima] = d->fetch && maxima;
    f[conemap__flag_uses_map] = !d->fetch && state;
    f[conemap__flag_uses_heights] = !d->fetch && heights;
    f[conemap__flag_uses_maxima] = !d->fetch && maxima;
    es_compute = f[conemap__flag_es] && d->stage == CONEMAP_STAGE_COMPUTE; /* which has but few formats of images */
    if ((d->fetch && d->stage != CONEMAP_STAGE_FUNCTIONS) || (d->fetch && state && !d->fetch_cones) ||
        (d->fetch && maxima && !d->fetch_maxima) || (!d->fetch && (d->fetch_cones || d->fetch_maxima)) ||
        texture.sectors > 1 ||
        (es_compute && f[conemap__flag_store] &&
         (f[conemap__flag_slopes] ? texture.format == CONEMAP_UNORM16
                                  : f[conemap__flag_pair] || texture.format != CONEMAP_F32)))
        return CONEMAP_ERROR_UNSUPPORTED;
    f[conemap__flag_size_asked] = !d->fixed_size && !d->fetch && !f[conemap__flag_maxima];
    return CONEMAP_OK;
}

static conemap_result conemap__emit_kernel_once(const conemap_shader_desc *desc, conemap_kernel kernel, char *text,
                                                size_t capacity, size_t *size) {
    static const char *const functions[CONEMAP_KERNEL_COUNT] = {
        "conemap_ring",   "conemap_steepest", "conemap_safe",  "conemap_stored", "conemap_highest",
        "conemap_padded", "conemap_four",     "conemap_quick", "conemap_exact"};
    static const char *const calls[CONEMAP_KERNEL_COUNT] = {
        "conemap_ring(i, j, conemap_first, conemap_last$SIZE)",
        "conemap_steepest(i, j$SIZE)",
        "conemap_safe(i, j$SIZE)",
        "conemap_stored(i, j$SIZE)",
        "conemap_highest(i, j$SIZE)",
        "conemap_padded(i, j$SIZE)",
        "conemap_four(i, j, conemap_level)",
        "conemap_quick(i, j$SIZE)",
        "conemap_exact(i, j, conemap_first, conemap_last, conemap_level$SIZE)"};
    static const char *const formats[CONEMAP_FORMAT_COUNT][3] = {{"r32f", "rg32f", "rgba32f"},
                                                                 {"r16f", "rg16f", "rgba16f"},
                                                                 {"r16", "rg16", "rgba16"},
                                                                 {"r8", "rg8", "rgba8"}};
    static const char *const types[2][3] = {{"float", "float2", "float4"},
                                            {"unorm float", "unorm float2", "unorm float4"}};
    const char *slopes = desc->map.texture.flip_dv
                             ? ", 0.5f + conemap_gradient(i, j$SIZE).x, 0.5f - conemap_gradient(i, j$SIZE).y"
                             : ", 0.5f + conemap_gradient(i, j$SIZE).x, 0.5f + conemap_gradient(i, j$SIZE).y";
    conemap__emitter e;
    conemap_result result;
    char *out;
    int binding, wide, unorm;
    memset(&e, 0, sizeof e);
    e.text = text;
    e.capacity = capacity;
    result = conemap__resolve_kernel(&e, desc, kernel);
    if (result != CONEMAP_OK) return result;
    conemap__make_pieces(&e);
    wide = e.flags[conemap__flag_slopes] ? 2 : e.flags[conemap__flag_pair]; /* one channel, two, four */
    unorm = kernel == CONEMAP_KERNEL_STORE && e.flags[conemap__flag_unorm];
    binding = e.desc.binding + e.flags[conemap__flag_uses_map] + e.flags[conemap__flag_uses_heights] +
              e.flags[conemap__flag_uses_maxima];
    conemap__piece_set(&e, "OUT_FORMAT", 1,
                       formats[kernel == CONEMAP_KERNEL_STORE ? desc->map.texture.format : CONEMAP_F32][wide]);
    conemap__piece_set(&e, "OUT_TYPE", 1, types[unorm][wide]);
    conemap__place_resource(&e, "OUT_LAYOUT", e.flags[conemap__flag_hlsl] ? 'u' : 'b',
                            e.flags[conemap__flag_hlsl] ? e.desc.binding : binding);
    conemap__piece_set(&e, "CALL", 0, calls[kernel]);
    out = conemap__piece_new(&e, "RESULT", 0);
    if (wide) conemap__append(out, CONEMAP__PIECE_SIZE, "conemap_texel(i, j$SIZE), ");
    conemap__append(out, CONEMAP__PIECE_SIZE, "$CALL");
    conemap__append(out, CONEMAP__PIECE_SIZE, wide == 2 ? slopes : wide ? ", 0.0f, 0.0f" : ", 0.0f, 0.0f, 0.0f");
    conemap__piece_set(&e, "RESULT_HLSL", 0,
                       wide == 2 ? "vec4($RESULT)"
                       : wide    ? "vec2(conemap_texel(i, j$SIZE), $CALL)"
                                 : "$CALL");
    conemap__lines(&e, conemap__kernel_head, 0);
    conemap__lines(&e, conemap__kernel_head, 1);
    conemap__snippet_named(&e, functions[kernel], strlen(functions[kernel]));
    if (wide == 2) conemap__snippet_named(&e, "conemap_gradient", strlen("conemap_gradient"));
    if (e.desc.stage != CONEMAP_STAGE_FUNCTIONS) {
        conemap__lines(&e, conemap__kernel_main, 1);
        conemap__lines(&e, conemap__kernel_main, 0);
    }
    if (e.clash) return CONEMAP_ERROR_PARAMETER;
    *size = e.size + 1;
    if (text && e.size < capacity) text[e.size] = 0;
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_emit_kernel(const conemap_shader_desc *desc, conemap_kernel kernel, char *text,
                                                size_t capacity, size_t *size) {
    size_t needed = 0;
    conemap_result result;
    if (!desc || (!text && !size)) return CONEMAP_ERROR_NULL;
    result = conemap__emit_kernel_once(desc, kernel, NULL, 0, &needed);
    if (result != CONEMAP_OK) return result;
    if (size) *size = needed;
    if (!text) return CONEMAP_OK;
    if (capacity < needed) return CONEMAP_ERROR_BUFFER;
    return conemap__emit_kernel_once(desc, kernel, text, capacity, &needed);
}

typedef struct conemap__pass_list {
    conemap_gpu_pass *passes; /* null: they are only counted */
    int count, state;         /* the copy that holds the state now */
} conemap__pass_list;

static void conemap__list_pass(conemap__pass_list *list, conemap_kernel kernel, int level, int first, int last,
                               int width, int height) {
    conemap_gpu_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.kernel = kernel;
    pass.level = level;
    pass.first = first;
    pass.last = last;
    pass.reads = list->state;
    pass.writes = kernel == CONEMAP_KERNEL_STORE ? 2 : 1 - list->state;
    if (kernel == CONEMAP_KERNEL_CELLS || kernel == CONEMAP_KERNEL_TEXELS || kernel == CONEMAP_KERNEL_MAXIMA)
        pass.writes = 3;
    if (pass.writes < 2) list->state = pass.writes;
    pass.width = width;
    pass.height = height;
    pass.groups_x = (width + 7) / 8;
    pass.groups_y = (height + 7) / 8;
    if (list->passes) list->passes[list->count] = pass;
    ++list->count;
}

/* All levels of the maxima; returns the highest. */
static int conemap__list_maxima(conemap__pass_list *list, conemap_kernel finest, int width, int height) {
    int top = 0, level;
    while ((1 << top) < width || (1 << top) < height) ++top;
    for (level = 0; level <= top; ++level)
        conemap__list_pass(list, level == 0 ? finest : CONEMAP_KERNEL_MAXIMA, level, 0, 0, 1 << (top - level),
                           1 << (top - level));
    return top;
}

/* Rings first..last, of 8 r texels each. */
static void conemap__list_rings(conemap__pass_list *list, const conemap_info *info, int last_of_all, int64_t batch) {
    int first = 1, last;
    for (; first <= last_of_all; first = last + 1) {
        last = first;
        while (last < last_of_all && 4 * ((int64_t)(last + 1) * (last + 2) - (int64_t)first * (first - 1)) <= batch)
            ++last;
        conemap__list_pass(list, CONEMAP_KERNEL_RING, 0, first, last, info->width, info->height);
    }
}

/* Blocks in as many passes as it takes: of the highest level that keeps to the batch, if need be. */
static void conemap__list_blocks(conemap__pass_list *list, const conemap_info *info, int top, int64_t batch) {
    int64_t copies = (info->wrap_u == CONEMAP_WRAP ? 3 : 1) * (info->wrap_v == CONEMAP_WRAP ? 3 : 1), cost;
    int64_t first, blocks, at_once;
    int level = top;
    while (level > 0 && copies * (((int64_t)4 << (2 * level)) - 1) / 3 > batch) --level;
    cost = copies * (((int64_t)4 << (2 * level)) - 1) / 3;
    at_once = batch > cost ? batch / cost : 1;
    blocks = (int64_t)(((info->width - 1) >> level) + 1) * (((info->height - 1) >> level) + 1);
    for (first = 0; first < blocks; first += at_once)
        conemap__list_pass(list, CONEMAP_KERNEL_EXACT, level, (int)first,
                           (int)(first + at_once < blocks ? first + at_once - 1 : blocks - 1), info->width,
                           info->height);
}

static void conemap__list_all(conemap__pass_list *list, const conemap_shader_desc *desc, int batch) {
    const conemap_info *info = &desc->map;
    int w = info->width, h = info->height;
    list->count = list->state = 0;
    if (desc->trace.tracer == CONEMAP_TRACE_MAXMIP || desc->trace.tracer == CONEMAP_TRACE_QDM) {
        conemap__list_maxima(list, CONEMAP_KERNEL_CELLS, conemap__maxi(1, conemap__cell_count(w, info->wrap_u)),
                             conemap__maxi(1, conemap__cell_count(h, info->wrap_v)));
        return;
    }
    if (info->generator == CONEMAP_RING) { /* with wrap that is farther than the nearest image of any texel */
        conemap__list_rings(list, info, conemap__maxi(1, conemap__maxi(w, h) - 1), batch);
    } else {
        int top = conemap__list_maxima(list, CONEMAP_KERNEL_TEXELS, w, h);
        if (info->generator == CONEMAP_EXACT || info->generator == CONEMAP_GENERATE_DEFAULT) {
            conemap__list_rings(list, info, 1, batch); /* something steep to begin with prunes most */
            conemap__list_blocks(list, info, top, batch);
        } else {
            conemap__list_pass(list, CONEMAP_KERNEL_QUICK, 0, 0, 0, w, h);
        }
    }
    if (info->min3x3) conemap__list_pass(list, CONEMAP_KERNEL_MIN3X3, 0, 0, 0, w, h);
    if (info->guarantee != CONEMAP_GUARANTEE_VERTEX && info->guarantee != CONEMAP_GUARANTEE_NONE)
        conemap__list_pass(list, CONEMAP_KERNEL_SAFE, 0, 0, 0, w, h);
    conemap__list_pass(list, CONEMAP_KERNEL_STORE, 0, 0, 0, w, h);
}

CONEMAP__DEF conemap_result conemap_gpu_passes(const conemap_shader_desc *desc, int batch,
                                               conemap_gpu_pass *passes, int capacity, int *count) {
    conemap__pass_list list;
    const conemap_info *info;
    if (!desc || !count) return CONEMAP_ERROR_NULL;
    info = &desc->map;
    if (!CONEMAP__KNOWN(info->wrap_u, CONEMAP_WRAP_COUNT) || !CONEMAP__KNOWN(info->wrap_v, CONEMAP_WRAP_COUNT) ||
        !CONEMAP__KNOWN(info->generator, CONEMAP_GENERATOR_COUNT) ||
        !CONEMAP__KNOWN(desc->trace.tracer, CONEMAP_TRACER_COUNT))
        return CONEMAP_ERROR_ENUM;
    if (info->width < 1 || info->height < 1 || info->width > CONEMAP_MAX_SIZE || info->height > CONEMAP_MAX_SIZE)
        return CONEMAP_ERROR_SIZE;
    if (batch < 0) return CONEMAP_ERROR_PARAMETER;
    if (info->generator > CONEMAP_QUICK_CENTER || info->texture.sectors > 1) return CONEMAP_ERROR_UNSUPPORTED;
    list.passes = NULL;
    conemap__list_all(&list, desc, batch ? batch : 4096);
    *count = list.count;
    if (!passes) return CONEMAP_OK;
    if (capacity < list.count) return CONEMAP_ERROR_BUFFER;
    list.passes = passes;
    conemap__list_all(&list, desc, batch ? batch : 4096);
    return CONEMAP_OK;
}

/* How many levels a square of 2^n has that holds all cells. */
static int conemap__maxima_square(const conemap_map *map) {
    int top = 0;
    while ((1 << top) < map->cells.width[0] || (1 << top) < map->cells.height[0]) ++top;
    return top;
}

CONEMAP__DEF int conemap_maxima_levels(const conemap_map *map) {
    return map && map->cells.levels > 0 ? conemap__maxima_square(map) + 1 : 0;
}

CONEMAP__DEF conemap_result conemap_write_maxima(const conemap_map *map, int level, float *values, size_t size) {
    int side, x, y;
    if (!map || !map->heights || !values) return CONEMAP_ERROR_NULL;
    if (map->cells.levels == 0) return CONEMAP_ERROR_NO_PYRAMID;
    if (level < 0 || level > conemap__maxima_square(map)) return CONEMAP_ERROR_PARAMETER;
    side = 1 << (conemap__maxima_square(map) - level);
    if (size / sizeof *values < (size_t)side * (size_t)side) return CONEMAP_ERROR_BUFFER;
    for (y = 0; y < side; ++y)
        for (x = 0; x < side; ++x)
            values[(size_t)y * (size_t)side + (size_t)x] =
                x >= map->cells.width[level] || y >= map->cells.height[level] ? 0.0f
                : level == 0                                                  ? conemap__cell_max(map, x, y)
                             : conemap__block_max(&map->cells, level, x, y);
    return CONEMAP_OK;
}

/* ======================================================================================================
   E M I T T E D   E F F E C T S

   The effects of conemap_shade as snippets: each line belongs to the flags before it, so an effect that is off adds
   nothing. The flights are those of EFFECTS in single precision, their place kept as a whole cell and a fraction.
   ====================================================================================================== */

static const conemap__snippet conemap__effect_snippets[] = {
    /* ---- vectors, which C lacks ---- */
    {"conemap_dot",
     "$FNfloat conemap_dot(vec3 a, vec3 b) {\n"
     "    return a.x * b.x + a.y * b.y + a.z * b.z;\n"
     "}\n"},
    {"conemap_cross",
     "$FNvec3 conemap_cross(vec3 a, vec3 b) {\n"
     "    return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);\n"
     "}\n"},
    {"conemap_normalize",
     "$FNvec3 conemap_normalize(vec3 a) {\n"
     "    return conemap_scaled(a, 1.0f / sqrt(dot(a, a)));\n"
     "}\n"},
    {"conemap_scaled",
     "$FNvec3 conemap_scaled(vec3 a, float scale) {\n"
     "    return vec3(a.x * scale, a.y * scale, a.z * scale);\n"
     "}\n"},
    {"conemap_along",
     "// p + t d\n"
     "$FNvec3 conemap_along(vec3 p, float t, vec3 d) {\n"
     "    return vec3(p.x + t * d.x, p.y + t * d.y, p.z + t * d.z);\n"
     "}\n"},

    /* ---- what comes in and goes out ---- */
    {"conemap_frame",
     "$STRUCT conemap_frame {\n"
     "    vec3 origin;                     // where the surface has uv_offset\n"
     "    vec3 tangent, bitangent, normal; // world per x, y and height\n"
     "    vec2 uv_offset, uv_scale;        // map widths per unit of x, and of y\n"
     "    float depth, level;              // how high z = 1 stands over z = 0; the z of the surface\n"
     "?curved     vec3 curvature;                  // xx, xy, yy\n"
     "?c } conemap_frame;\n"
     "?!c };\n"},
    {"conemap_effects",
     "$STRUCT conemap_effects {\n"
     "?clip     vec4 clip;           // least u and v, greatest u and v\n"
     "?depth     vec4 clip_z, clip_w; // rows of the matrix: clip z and w of (position, 1)\n"
     "?lights     vec4 light;          // towards the light, 0; or its position, 1\n"
     "?soft     float light_radius;  // radians, or the radius of the ball at a position\n"
     "?sky     float sky_reach;      // what is farther away hides nothing\n"
     "?sky     int sky_directions;\n"
     "?holes     float alpha_cut;     // texels below it are holes\n"
     "?lod     float lod_bias;       // added to the level\n"
     "?lod     int lod_steps;         // the step cap at level 0; 0: none\n"
     "?lod     int level_count;\n"
     "?fade     float fade_begin;     // pixels that the relief is high\n"
     "?fade     float fade_end;\n"
     "?c } conemap_effects;\n"
     "?!c };\n"},
    {"conemap_shading",
     "$STRUCT conemap_shading {\n"
     "    bool found;\n"
     "    float t;\n"
     "    vec3 box;         // u, v, z\n"
     "?world     vec3 position;\n"
     "?normal_out     vec3 normal;\n"
     "?depth     float depth;\n"
     "?lights     float shadow;    // 0 dark to 1 lit\n"
     "?open     float occlusion; // 0 closed to 1 open\n"
     "?uv     vec2 uv;\n"
     "?uv     vec4 gradient;    // dFdx and dFdy of the surface's uv\n"
     "?lod     float level;\n"
     "?fade     float fade;      // 0 relief to 1 normals only\n"
     "?c } conemap_shading;\n"
     "?!c };\n"},

    /* ---- frames ---- */
    {"conemap_basis",
     "$STRUCT conemap_basis {\n"
     "    vec3 u, v, z;          // world per u, v and z\n"
     "    vec3 to_u, to_v, to_z; // and back\n"
     "    vec3 origin;\n"
     "    vec2 offset;\n"
     "    float level;\n"
     "?curved     vec3 bend;             // the base falls by (x u u + 2 y u v + z v v) / 2\n"
     "?c } conemap_basis;\n"
     "?!c };\n"},
    {"conemap_make_basis",
     "$FNconemap_basis conemap_make_basis(conemap_frame frame$TOWARD_PARAM) {\n"
     "    conemap_basis b;\n"
     "    float scale_v = frame.uv_scale.y$OVER_ASPECT;\n"
     "?two_sided     vec3 plane = cross(frame.tangent, frame.bitangent); // seen from behind its normal turns over\n"
     "?two_sided     float side = dot(plane, frame.normal) * dot(plane, toward) > 0.0f ? -1.0f : 1.0f;\n"
     "    b.u = conemap_scaled(frame.tangent, 1.0f / frame.uv_scale.x);\n"
     "    b.v = conemap_scaled(frame.bitangent, 1.0f / scale_v);\n"
     "    b.z = conemap_scaled(frame.normal, $SIDEframe.depth);\n"
     "    b.to_u = cross(b.v, b.z);\n"
     "    b.to_v = cross(b.z, b.u);\n"
     "    b.to_z = cross(b.u, b.v);\n"
     "    float volume = dot(b.u, b.to_u);\n"
     "    b.to_u = conemap_scaled(b.to_u, 1.0f / volume);\n"
     "    b.to_v = conemap_scaled(b.to_v, 1.0f / volume);\n"
     "    b.to_z = conemap_scaled(b.to_z, 1.0f / volume);\n"
     "    b.origin = frame.origin;\n"
     "    b.offset = frame.uv_offset;\n"
     "    b.level = frame.level;\n"
     "?curved     float x = 1.0f / frame.uv_scale.x, y = 1.0f / scale_v;\n"
     "?curved     b.bend = vec3(frame.curvature.x * x * x / frame.depth, frame.curvature.y * x * y / frame.depth,\n"
     "?curved                   frame.curvature.z * y * y / frame.depth);\n"
     "    return b;\n"
     "}\n"},
    {"conemap_box_direction",
     "// A direction, and a point, of the world in the box.\n"
     "$FNvec3 conemap_box_direction(conemap_basis b, vec3 d) {\n"
     "    return vec3(dot(b.to_u, d), dot(b.to_v, d), dot(b.to_z, d));\n"
     "}\n"},
    {"conemap_box_point",
     "$FNvec3 conemap_box_point(conemap_basis b, vec3 p) {\n"
     "    vec3 d = conemap_box_direction(b, conemap_along(p, -1.0f, b.origin));\n"
     "    return vec3(d.x + b.offset.x, d.y + b.offset.y, d.z + b.level);\n"
     "}\n"},
    {"conemap_drop",
     "// How far the base lies below its tangent plane, in z.\n"
     "$FNfloat conemap_drop(conemap_basis b, float u, float v) {\n"
     "    float x = u - b.offset.x, y = v - b.offset.y;\n"
     "    return 0.5f * (b.bend.x * x * x + 2.0f * b.bend.y * x * y + b.bend.z * y * y);\n"
     "}\n"},
    {"conemap_drop_along",
     "// How that grows along (du, dv), and half of how its growth grows.\n"
     "$FNfloat conemap_drop_along(conemap_basis b, float u, float v, float du, float dv) {\n"
     "    float x = u - b.offset.x, y = v - b.offset.y;\n"
     "    return (b.bend.x * x + b.bend.y * y) * du + (b.bend.y * x + b.bend.z * y) * dv;\n"
     "}\n"},
    {"conemap_bend_along",
     "$FNfloat conemap_bend_along(conemap_basis b, float du, float dv) {\n"
     "    return 0.5f * (b.bend.x * du * du + 2.0f * b.bend.y * du * dv + b.bend.z * dv * dv);\n"
     "}\n"},
    {"conemap_world_point",
     "$FNvec3 conemap_world_point(conemap_basis b, vec3 box) {\n"
     "    vec3 p = conemap_along(b.origin, box.x - b.offset.x, b.u);\n"
     "    p = conemap_along(p, box.y - b.offset.y, b.v);\n"
     "?!curved     return conemap_along(p, box.z - b.level, b.z);\n"
     "?curved     return conemap_along(p, box.z - b.level - conemap_drop(b, box.x, box.y), b.z);\n"
     "}\n"},
    {"conemap_world_normal",
     "// Of a surface with these slopes: rows of the way back are the gradients of u, v and z.\n"
     "$FNvec3 conemap_world_normal(conemap_basis b$BOX_PARAM, vec2 slope) {\n"
     "?!curved     vec3 n = conemap_along(conemap_along(b.to_z, -slope.x, b.to_u), -slope.y, b.to_v);\n"
     "?curved     float zu = slope.x - conemap_drop_along(b, box.x, box.y, 1.0f, 0.0f);\n"
     "?curved     float zv = slope.y - conemap_drop_along(b, box.x, box.y, 0.0f, 1.0f);\n"
     "?curved     vec3 n = conemap_along(conemap_along(b.to_z, -zu, b.to_u), -zv, b.to_v);\n"
     "    return normalize(n);\n"
     "}\n"},

    /* ---- levels and fading ---- */
    {"conemap_level_size",
     "$FNivec2 conemap_level_size(ivec2 size, int level) {\n"
     "    return ivec2((size.x >> level) > 1 ? size.x >> level : 1, (size.y >> level) > 1 ? size.y >> level : 1);\n"
     "}\n"},
    {"conemap_level_of",
     "// log2 of the texels under a pixel.\n"
     "$FNfloat conemap_level_of(vec4 gradient, float w, float h) {\n"
     "    float x = gradient.x * gradient.x * w * w + gradient.y * gradient.y * h * h;\n"
     "    float y = gradient.z * gradient.z * w * w + gradient.w * gradient.w * h * h;\n"
     "    return 0.5f * log2(max(max(x, y), 1e-30f));\n"
     "}\n"},
    {"conemap_fade_of",
     "// From how many pixels high the relief stands: a pixel is its footprint's area over its length.\n"
     "$FNfloat conemap_fade_of(conemap_basis b, vec4 gradient, float begin, float end) {\n"
     "    float x = gradient.x * gradient.x + $ASPECT2gradient.y * gradient.y;\n"
     "    float y = gradient.z * gradient.z + $ASPECT2gradient.w * gradient.w;\n"
     "    float area = $ASPECT_TIMESabs(gradient.x * gradient.w - gradient.y * gradient.z), longest = sqrt(max(x, "
     "y));\n"
     "    float pixel = longest > 0.0f ? area / longest : 0.0f;\n"
     "    float faded = (begin - sqrt(dot(b.z, b.z) / dot(b.u, b.u)) / max(pixel, 1e-30f)) / (begin - end);\n"
     "    faded = min(max(faded, 0.0f), 1.0f);\n"
     "    return faded * faded * (3.0f - 2.0f * faded);\n"
     "}\n"},
    {"conemap_base",
     "// Where a ray meets the base itself, from either side.\n"
     "$FNfloat conemap_base(conemap_basis b, vec3 o, vec3 d) {\n"
     "?!curved     float over = o.z - b.level, side = over < 0.0f ? -1.0f : 1.0f;\n"
     "?!curved     return conemap_fall(side * over, side * d.z);\n"
     "?curved     float over = o.z + conemap_drop(b, o.x, o.y) - b.level, side = over < 0.0f ? -1.0f : 1.0f;\n"
     "?curved     float rise = d.z + conemap_drop_along(b, o.x, o.y, d.x, d.y), bend = conemap_bend_along(b, d.x, "
     "d.y);\n"
     "?curved     return conemap_first_root(side * over, side * rise, side * bend);\n"
     "}\n"},

    /* ---- the surface ---- */
    {"conemap_difference",
     "// dh/du and dh/dv at a texel, per texel.\n"
     "$FNvec2 conemap_difference(int i, int j$MAP_PARAMS) {\n"
     "?stored     vec2 stored = $STORED;\n"
     "?stored     return vec2(stored.x - 0.5f, $STORED_V);\n"
     "?!stored,!wrap_u     i = clamp(i, 0, $W - 1);\n"
     "?!stored,!wrap_v     j = clamp(j, 0, $H - 1);\n"
     "?!stored     float x = conemap_texel(i + 1, j$MAP)$OF_HEIGHT - conemap_texel(i - 1, j$MAP)$OF_HEIGHT;\n"
     "?!stored     float y = conemap_texel(i, j + 1$MAP)$OF_HEIGHT - conemap_texel(i, j - 1$MAP)$OF_HEIGHT;\n"
     "?!stored,wrap_u     x *= 0.5f;\n"
     "?!stored,!wrap_u     if (i > 0 && i + 1 < $W) x *= 0.5f; // at the border it spans one texel\n"
     "?!stored,wrap_v     y *= 0.5f;\n"
     "?!stored,!wrap_v     if (j > 0 && j + 1 < $H) y *= 0.5f;\n"
     "?!stored     return vec2(x, y);\n"
     "}\n"},
    {"conemap_ground_at",
     "$STRUCT conemap_ground_at {\n"
     "    float height;\n"
     "    vec2 slope;      // of the cell\n"
     "?gentle     vec2 gentle;     // of the texels' derivatives, interpolated\n"
     "?occlusion     float steepness; // 1 / tan of the cone\n"
     "?c } conemap_ground_at;\n"
     "?!c };\n"},
    {"conemap_look",
     "$FNconemap_ground_at conemap_look(vec3 box$MAP_PARAMS) {\n"
     "    conemap_ground_at g;\n"
     "    float x = box.x * $FW - 0.5f, y = box.y * $FH - 0.5f;\n"
     "    int i = int(floor(x)), j = int(floor(y));\n"
     "?nothing_u     i = clamp(i, 0, $W - 2);\n"
     "?nothing_v     j = clamp(j, 0, $H - 2);\n"
     "    x -= float(i);\n"
     "    y -= float(j);\n"
     "?both     vec2 a = conemap_texel(i, j$MAP), b = conemap_texel(i + 1, j$MAP);\n"
     "?both     vec2 c = conemap_texel(i, j + 1$MAP), d = conemap_texel(i + 1, j + 1$MAP);\n"
     "?both     vec4 heights = vec4(a.x, b.x, c.x, d.x);\n"
     "?!both     vec4 heights = vec4(conemap_texel(i, j$MAP), conemap_texel(i + 1, j$MAP),\n"
     "?!both                         conemap_texel(i, j + 1$MAP), conemap_texel(i + 1, j + 1$MAP));\n"
     "    float hx = heights.y - heights.x, hy = heights.z - heights.x, hxy = heights.w - heights.z - hx;\n"
     "    float height = conemap_mix(heights, x, y);\n"
     "    g.height = height;\n"
     "    g.slope = vec2((hx + hxy * y) * $FW, (hy + hxy * x) * $FH);\n"
     "?gentle     vec2 p = conemap_difference(i, j$MAP), q = conemap_difference(i + 1, j$MAP);\n"
     "?gentle     vec2 r = conemap_difference(i, j + 1$MAP), s = conemap_difference(i + 1, j + 1$MAP);\n"
     "?gentle     g.gentle = vec2(conemap_mix(vec4(p.x, q.x, r.x, s.x), x, y) * $FW,\n"
     "?gentle                     conemap_mix(vec4(p.y, q.y, r.y, s.y), x, y) * $FH);\n"
     "?occlusion,both,!per_cell     float cone = conemap_mix(vec4(a.y, b.y, c.y, d.y), x, y);\n"
     "?occlusion,both,per_cell     float cone = a.y;\n"
     "?occlusion,sectors     float cone = 1e30f; // the narrowest of all sectors\n"
     "?occlusion,sectors     for (int sector = 0; sector < $SECTORS; ++sector) {\n"
     "?occlusion,sectors,per_cell         cone = min(cone, conemap_cone(i, j, sector$MAP));\n"
     "?occlusion,sectors,!per_cell         vec4 cones = vec4(conemap_cone(i, j, sector$MAP), conemap_cone(i + 1, j, "
     "sector$MAP),\n"
     "?occlusion,sectors,!per_cell                           conemap_cone(i, j + 1, sector$MAP),\n"
     "?occlusion,sectors,!per_cell                           conemap_cone(i + 1, j + 1, sector$MAP));\n"
     "?occlusion,sectors,!per_cell         cone = min(cone, conemap_mix(cones, x, y));\n"
     "?occlusion,sectors     }\n"
     "?occlusion     g.steepness = 1.0f / max($TANGENT, 1e-9f);\n"
     "    return g;\n"
     "}\n"},
    {"conemap_blend",
     "$FNconemap_ground_at conemap_blend(conemap_ground_at a, conemap_ground_at b, float weight) {\n"
     "    a.height += (b.height - a.height) * weight;\n"
     "    a.slope = vec2(a.slope.x + (b.slope.x - a.slope.x) * weight, a.slope.y + (b.slope.y - a.slope.y) * "
     "weight);\n"
     "?gentle     a.gentle = vec2(a.gentle.x + (b.gentle.x - a.gentle.x) * weight,\n"
     "?gentle                     a.gentle.y + (b.gentle.y - a.gentle.y) * weight);\n"
     "?occlusion     a.steepness += (b.steepness - a.steepness) * weight;\n"
     "    return a;\n"
     "}\n"},
    {"conemap_wall",
     "// The side of the rectangle through which a ray came in just where it hit: 1 for u, 2 for v, 0 for none.\n"
     "$FNint conemap_wall(vec3 o, vec3 d, vec4 bounds, float t) {\n"
     "    float in_u = conemap_clip(vec2(0.0f, 1e30f), o.x, d.x, bounds.x, bounds.z).x;\n"
     "    float in_v = conemap_clip(vec2(0.0f, 1e30f), o.y, d.y, bounds.y, bounds.w).x;\n"
     "    float enter = max(in_u, in_v);\n"
     "    return enter <= 0.0f || t > enter * 1.00001f ? 0 : in_v > in_u ? 2 : 1;\n"
     "}\n"},

    /* ---- flights: what conemap_trace does not know, that is blended levels, holes and rays over a bent base ---- */
    {"conemap_first_root",
     "// First t from 0 on at which c + b t + a t t is 0 or less, or 1e30.\n"
     "$FNfloat conemap_first_root(float c, float b, float a) {\n"
     "    float d = b * b - 4.0f * a * c, q = -0.5f * (b + (b < 0.0f ? -1.0f : 1.0f) * sqrt(max(d, 0.0f)));\n"
     "    float first = q != 0.0f ? c / q : -1.0f, second = a != 0.0f ? q / a : -1.0f;\n"
     "    if (first < 0.0f || (second >= 0.0f && second < first)) first = second;\n"
     "    return c <= 0.0f ? 0.0f : d >= 0.0f && first >= 0.0f ? first : 1e30f;\n"
     "}\n"},
    {"conemap_fall",
     "// The same without the bend.\n"
     "$FNfloat conemap_fall(float c, float b) {\n"
     "    return c <= 0.0f ? 0.0f : b < 0.0f ? c / -b : 1e30f;\n"
     "}\n"},
    {"conemap_lattice",
     "$STRUCT conemap_lattice {\n"
     "    int i, j;           // the texel behind; x and y, the place from there, grow along the ray\n"
     "    float x, y, vx, vy;\n"
     "?c } conemap_lattice;\n"
     "?!c };\n"},
    {"conemap_course",
     "$STRUCT conemap_course {\n"
     "    conemap_lattice cell;\n"
     "?lod     conemap_lattice coarse; // of the next level\n"
     "?lod     float weight;           // and its share\n"
     "?holes     conemap_lattice leaf;   // the texels of the alpha map, as squares\n"
     "?holes     float alpha_cut;\n"
     "?holes     int wall;               // whose border was crossed last\n"
     "?holes     bool hole;\n"
     "    int si, sj;\n"
     "    float t, end, z, rise, speed;\n"
     "?curved     float bend;             // its height is z + rise t + bend t t\n"
     "    bool found;\n"
     "?c } conemap_course;\n"
     "?!c };\n"},
    {"conemap_lay",
     "$FNconemap_lattice conemap_lay(vec3 o, vec3 d, float w, float h, float shift) {\n"
     "    conemap_lattice l;\n"
     "    l.i = 0;\n"
     "    l.j = 0;\n"
     "    l.x = (d.x < 0.0f ? -1.0f : 1.0f) * (o.x * w - shift);\n"
     "    l.y = (d.y < 0.0f ? -1.0f : 1.0f) * (o.y * h - shift);\n"
     "    l.vx = max(abs(d.x) * w, 1e-20f);\n"
     "    l.vy = max(abs(d.y) * h, 1e-20f);\n"
     "    return l;\n"
     "}\n"},
    {"conemap_move",
     "$FNconemap_lattice conemap_move(conemap_lattice l, float dt, int si, int sj) {\n"
     "    l.x += l.vx * dt; l.y += l.vy * dt;\n"
     "    l.i += si * int(floor(l.x)); l.x -= floor(l.x); l.j += sj * int(floor(l.y)); l.y -= floor(l.y);\n"
     "    return l;\n"
     "}\n"},
    {"conemap_stay",
     "// Until just over the next border.\n"
     "$FNfloat conemap_stay(conemap_lattice l) {\n"
     "    return min((1.000001f - l.x) / l.vx, (1.000001f - l.y) / l.vy);\n"
     "}\n"},
    {"conemap_fly_on",
     "$FNconemap_course conemap_fly_on(conemap_course c, float dt) {\n"
     "?holes     if (conemap_stay(c.leaf) <= dt) c.wall = (1.0f - c.leaf.x) * c.leaf.vy <= (1.0f - c.leaf.y) * "
     "c.leaf.vx ? 1 : 2;\n"
     "    c.cell = conemap_move(c.cell, dt, c.si, c.sj);\n"
     "?lod     c.coarse = conemap_move(c.coarse, dt, c.si, c.sj);\n"
     "?holes     c.leaf = conemap_move(c.leaf, dt, c.si, c.sj);\n"
     "    c.t += dt;\n"
     "?!curved     c.z += c.rise * dt;\n"
     "?curved     c.z += (c.rise + c.bend * dt) * dt;\n"
     "?curved     c.rise += 2.0f * c.bend * dt;\n"
     "    return c;\n"
     "}\n"},
    {"conemap_take_off",
     "// A flight from o, whose z counts from the base.\n"
     "$FNconemap_course conemap_take_off($B_PARAMvec3 o, vec3 d, vec2 range$LAUNCH_PARAMS) {\n"
     "    conemap_course c;\n"
     "?!lod     c.cell = conemap_lay(o, d, $FW, $FH, 0.5f);\n"
     "?lod     ivec2 fine = conemap_level_size(size, level), next = conemap_level_size(size, level + 1);\n"
     "?lod     c.cell = conemap_lay(o, d, float(fine.x), float(fine.y), 0.5f);\n"
     "?lod     c.coarse = conemap_lay(o, d, float(next.x), float(next.y), 0.5f);\n"
     "?lod     c.weight = weight;\n"
     "?holes     c.leaf = conemap_lay(o, d, $FW, $FH, 0.0f);\n"
     "?holes     c.leaf.x += 4e-7f * $FW; // a border on which it begins is behind it\n"
     "?holes     c.leaf.y += 4e-7f * $FH;\n"
     "?holes     c.alpha_cut = alpha_cut;\n"
     "?holes     c.wall = 0;\n"
     "?holes     c.hole = true; // what is met at once is met from outside\n"
     "    c.si = d.x < 0.0f ? -1 : 1;\n"
     "    c.sj = d.y < 0.0f ? -1 : 1;\n"
     "    c.t = 0.0f;\n"
     "    c.z = o.z;\n"
     "    c.speed = sqrt(d.x * d.x + $ASPECT2d.y * d.y);\n"
     "    c.found = false;\n"
     "?!curved     c.rise = d.z;\n"
     "?curved     c.rise = d.z + conemap_drop_along(b, o.x, o.y, d.x, d.y);\n"
     "?curved     c.bend = conemap_bend_along(b, d.x, d.y);\n"
     "    bool over = range.x <= range.y && range.x * (c.cell.vx + c.cell.vy) < 1e9f; // as far as an int goes\n"
     "    if (over) c = conemap_fly_on(c, range.x);\n"
     "    c.end = over ? range.y : -1.0f;\n"
     "?wraps     c.end = min(c.end, c.t + 1048576.0f / (c.cell.vx + c.cell.vy)); // a float knows no cells beyond\n"
     "    float up = $ROOT(-c.z, -c.rise$MINUS_BEND); // to the floor, from below\n"
     "    if (up > c.end - c.t) c.end = -1.0f;\n"
     "    if (c.end >= 0.0f) c = conemap_fly_on(c, up);\n"
     "?holes     c.wall = 0;\n"
     "    return c;\n"
     "}\n"},
    {"conemap_patch",
     "// Height, its growth and bend, and 1 / tan under a course.\n"
     "$FNvec4 conemap_patch(conemap_lattice l, int si, int sj$MAP_PARAMS) {\n"
     "?both     vec2 a = conemap_texel(l.i, l.j$MAP), b = conemap_texel(l.i + si, l.j$MAP);\n"
     "?both     vec2 c = conemap_texel(l.i, l.j + sj$MAP), d = conemap_texel(l.i + si, l.j + sj$MAP);\n"
     "?both     vec4 heights = vec4(a.x, b.x, c.x, d.x);\n"
     "?sectors     vec4 heights = vec4(conemap_texel(l.i, l.j$MAP), conemap_texel(l.i + si, l.j$MAP),\n"
     "?sectors                         conemap_texel(l.i, l.j + sj$MAP), conemap_texel(l.i + si, l.j + sj$MAP));\n"
     "    float hx = heights.y - heights.x, hy = heights.z - heights.x, hxy = heights.w - heights.z - hx;\n"
     "    float height = conemap_mix(heights, l.x, l.y);\n"
     "?both,!per_cell     float cone = conemap_mix(vec4(a.y, b.y, c.y, d.y), l.x, l.y);\n"
     "?both,per_cell     float cone = sj > 0 ? (si > 0 ? a.y : b.y) : si > 0 ? c.y : d.y;\n"
     "?sectors     int sector = (si < 0 ? 1 : 0) + (sj < 0 ? 2 : 0);\n"
     "?octants     if (l.vy > l.vx) sector += 4;\n"
     "?sectors,!per_cell     vec4 cones = vec4(conemap_cone(l.i, l.j, sector$MAP), conemap_cone(l.i + si, l.j, "
     "sector$MAP),\n"
     "?sectors,!per_cell                       conemap_cone(l.i, l.j + sj, sector$MAP),\n"
     "?sectors,!per_cell                       conemap_cone(l.i + si, l.j + sj, sector$MAP));\n"
     "?sectors,!per_cell     float cone = conemap_mix(cones, l.x, l.y);\n"
     "?sectors,per_cell     float cone = conemap_cone(si > 0 ? l.i : l.i - 1, sj > 0 ? l.j : l.j - 1, sector$MAP);\n"
     "    return vec4(height, hx * l.vx + hy * l.vy + hxy * (l.x * l.vy + l.y * l.vx), hxy * l.vx * l.vy,\n"
     "                1.0f / max($TANGENT, 1e-9f));\n"
     "}\n"},
    {"conemap_ground",
     "$FNvec4 conemap_ground(conemap_course c$MAP_PARAMS) {\n"
     "?!lod     return conemap_patch(c.cell, c.si, c.sj$MAP);\n"
     "?lod     vec4 a = conemap_patch(c.cell, c.si, c.sj, conemap_level_size(size, level)$SLICE_ARG, level);\n"
     "?lod     if (c.weight == 0.0f) return a;\n"
     "?lod     vec4 b = conemap_patch(c.coarse, c.si, c.sj, conemap_level_size(size, level + 1)$SLICE_ARG, level + "
     "1);\n"
     "?lod     return vec4(a.x + (b.x - a.x) * c.weight, a.y + (b.y - a.y) * c.weight, a.z + (b.z - a.z) * c.weight,\n"
     "?lod                 a.w + (b.w - a.w) * c.weight); // of slopes: the blend of tangents would be too wide\n"
     "}\n"},
    {"conemap_over_hole",
     "$FNbool conemap_over_hole(conemap_course c$FLAT_PARAMS) {\n"
     "    int i = c.si > 0 ? c.leaf.i : c.leaf.i - 1, j = c.sj > 0 ? c.leaf.j : c.leaf.j - 1;\n"
     "    return $ALPHA < c.alpha_cut;\n"
     "}\n"},
    {"conemap_border",
     "// How long the course stays in its cells.\n"
     "$FNfloat conemap_border(conemap_course c) {\n"
     "    float leave = conemap_stay(c.cell);\n"
     "?lod     if (c.weight > 0.0f) leave = min(leave, conemap_stay(c.coarse));\n"
     "?holes     leave = min(leave, conemap_stay(c.leaf));\n"
     "    return leave;\n"
     "}\n"},
    {"conemap_free_way",
     "// How far the course may go on unseen: down to the highest texel, or out of the cone.\n"
     "$FNfloat conemap_free_way(conemap_course c, float gap, float steepness) {\n"
     "    float room = gap - 1.0f / 1048576.0f;\n"
     "    if (c.z > 1.0f) return $ROOT(c.z - 1.0f, c.rise$PLUS_BEND);\n"
     "    return room > 0.0f ? $ROOT(room, c.rise - c.speed * steepness$PLUS_BEND) : 0.0f;\n"
     "}\n"},
    {"conemap_fly",
     "// To the first meeting.\n"
     "$FNconemap_course conemap_fly(conemap_course c, int max_steps$MAP_PARAMS) {\n"
     "    bool done = c.t > c.end;\n"
     "    for (int steps = 0; !done && steps < max_steps; ++steps) {\n"
     "        float leave = conemap_border(c), left = c.end - c.t;\n"
     "        vec4 ground = conemap_ground(c$MAP);\n"
     "        float gap = c.z - ground.x, dt = conemap_first_root(gap, c.rise - ground.y, $BEND_LESSground.z);\n"
     "?holes         bool hole = conemap_over_hole(c$FLAT), inside = gap <= 0.0f && c.hole;\n"
     "?holes         if (hole) dt = $ROOT(c.z, c.rise$PLUS_BEND); // the floor ends it\n"
     "        bool met = dt <= min(leave, left);\n"
     "        c.found = met$NO_HOLE;\n"
     "        if (!met) dt = max(leave, conemap_free_way(c, gap, ground.w));\n"
     "?holes         c.hole = hole && dt <= leave; // a jump ends over the surface\n"
     "        done = met || dt >= left;\n"
     "        if (c.found || !done) c = conemap_fly_on(c, dt);\n"
     "?holes         if (c.found && !inside) c.wall = 0;\n"
     "    }\n"
     "?lod     if (!done) c.found = true; // out of steps: shaded where it is\n"
     "    return c;\n"
     "}\n"},

    /* ---- light ---- */
    {"conemap_toward",
     "// The direction to the light, and how far it is.\n"
     "$FNvec4 conemap_toward(vec4 light, conemap_basis b, vec3 place) {\n"
     "    vec3 d = vec3(light.x, light.y, light.z);\n"
     "    if (light.w != 0.0f) d = conemap_along(d, -1.0f, conemap_world_point(b, place));\n"
     "    float length = sqrt(dot(d, d));\n"
     "    return vec4(d.x / length, d.y / length, d.z / length, light.w != 0.0f ? length : 1e30f);\n"
     "}\n"},
    {"conemap_horizon",
     "// The steepest rise, from low to high, at which a course still touches what lies under it. What was passed "
     "below the\n"
     "// lower flight is below the higher one.\n"
     "$FNfloat conemap_horizon(conemap_course c, float low, float high, float grain$MAP_PARAMS) {\n"
     "    float z0 = c.z, begin = c.t, rise = low;\n"
     "    bool done = c.t > c.end;\n"
     "    c.rise = low;\n"
     "    for (int steps = 0; !done && steps < $FLY_CAP; ++steps) {\n"
     "        float leave = conemap_border(c), left = c.end - c.t, end = min(leave, left), t = c.t - begin;\n"
     "        float above = 1.0f - z0$FALLEN; // what the highest texel could still do\n"
     "        if ($HOLLOWabove <= (rise + grain) * (above > 0.0f ? t : c.end - begin)) break;\n"
     "        vec4 ground = conemap_ground(c$MAP);\n"
     "        float gap = c.z - ground.x, b = c.rise - ground.y, a = $BEND_LESSground.z, most = rise;\n"
     "        if ($NOT_HOLEconemap_first_root(gap, b, a) <= end) { // the greatest of rise - gap / t in this cell\n"
     "            if (t == 0.0f && gap < 0.0f) return high;\n"
     "            float lowest = gap - b * t + a * t * t; // the gap with which the parabola left\n"
     "            if (t > 0.0f) most = max(most, rise - gap / t);\n"
     "            if (t + end > 0.0f && end < 1e30f) most = max(most, rise - (gap + (b + a * end) * end) / (t + "
     "end));\n"
     "            if (lowest > 0.0f && a > 0.0f) {\n"
     "                float dt = sqrt(lowest / a) - t;\n"
     "                if (dt > 0.0f && dt < end) most = max(most, rise - (gap + (b + a * dt) * dt) / (t + dt));\n"
     "            }\n"
     "            if (most >= high) return high;\n"
     "            c.z += (most - rise) * t;\n"
     "            c.rise += most - rise;\n"
     "            rise = most;\n"
     "            gap = c.z - ground.x;\n"
     "        }\n"
     "        float dt = max(leave, conemap_free_way(c, gap, ground.w));\n"
     "        done = dt >= left;\n"
     "        if (!done) c = conemap_fly_on(c, dt);\n"
     "    }\n"
     "    return rise;\n"
     "}\n"},
    {"conemap_look_along",
     "// A course towards a direction of the world.\n"
     "$FNconemap_course conemap_look_along(conemap_basis b, vec3 place, vec3 direction, float t_max,\n"
     "                                     vec4 bounds$LAUNCH_PARAMS) {\n"
     "    vec3 d = conemap_box_direction(b, direction);\n"
     "    vec2 range = conemap_clip(vec2(0.0f, t_max), place.x, d.x, bounds.x, bounds.z);\n"
     "    range = conemap_clip(range, place.y, d.y, bounds.y, bounds.w);\n"
     "    return conemap_take_off($B_ARGplace, d, range$LAUNCH);\n"
     "}\n"},
    {"conemap_disc",
     "// A light's disc: its middle, to its side, its radius; how much of it is up, and how a step up moves across "
     "it.\n"
     "$STRUCT conemap_disc {\n"
     "    vec3 light, side;\n"
     "    float radius, above, lift, height, reach;\n"
     "?c } conemap_disc;\n"
     "?!c };\n"},
    {"conemap_disc_horizon",
     "// The horizon, -1..1 radii from the disc's middle, y radii to the side of it.\n"
     "$FNfloat conemap_disc_horizon(conemap_basis b, vec3 place, conemap_disc disc, float y, vec4 "
     "bounds$COURSE_PARAMS) {\n"
     "    vec3 direction = conemap_along(disc.light, y * disc.radius, disc.side);\n"
     "    conemap_course c = conemap_look_along(b, place, direction, disc.reach, bounds$LAUNCH);\n"
     "    float rise = c.rise, r = disc.radius, down = r / ((disc.lift + r * disc.above) * disc.height);\n"
     "    float high = rise + r / ((disc.lift - r * disc.above) * disc.height);\n"
     "    float s = (conemap_horizon(c, rise - down, high, down / 1024.0f$MAP) - rise) * disc.height;\n"
     "    return min(max(s * disc.lift / (r * (1.0f + s * disc.above)), -1.0f), 1.0f);\n"
     "}\n"},
    {"conemap_strip",
     "// Of a strip of the unit disc: what stands above a horizon from (y0, x0) to (y1, x1), and its own area.\n"
     "$FNvec2 conemap_strip(float y0, float x0, float y1, float x1) {\n"
     "    float seen = 0.0f, area = 0.0f, part = 0.25f * (y1 - y0);\n"
     "    for (int k = 0; k < 4; ++k) {\n"
     "        float at = 0.25f * (float(k) + 0.5f), y = y0 + (y1 - y0) * at, x = x0 + (x1 - x0) * at;\n"
     "        float across = sqrt(1.0f - y * y);\n"
     "        seen += part * min(max(across - x, 0.0f), 2.0f * across);\n"
     "        area += part * 2.0f * across;\n"
     "    }\n"
     "    return vec2(seen, area);\n"
     "}\n"},
    {"conemap_soft_shadow",
     "// The share of the light's disc that is seen: cut by horizons in five directions, and by more between two that "
     "differ.\n"
     "$FNfloat conemap_soft_shadow(conemap_basis b, vec3 place, vec3 light, float radius, float reach,\n"
     "                             vec4 bounds$COURSE_PARAMS) {\n"
     "    float ends[12], horizons[12], y0 = -1.0f, x0 = 0.0f, seen = 0.0f, area = 0.0f; // 2: not looked at yet\n"
     "    conemap_disc disc;\n"
     "    int top = 5;\n"
     "    disc.height = sqrt(dot(b.z, b.z));\n"
     "    vec3 up = conemap_scaled(b.z, 1.0f / disc.height);\n"
     "    disc.light = light;\n"
     "    disc.above = dot(light, up);\n"
     "    disc.side = cross(light, up);\n"
     "    disc.lift = sqrt(dot(disc.side, disc.side));\n"
     "    if (disc.lift <= 1e-5f) return disc.above > 0.0f ? 1.0f : 0.0f; // overhead\n"
     "    disc.side = conemap_scaled(disc.side, 1.0f / disc.lift);\n"
     "    disc.radius = max(min(radius, 0.99f * disc.lift / max(abs(disc.above), 1e-6f)), 1e-6f); // without the "
     "zenith\n"
     "    disc.reach = reach;\n"
     "    for (int n = 0; n < 12; ++n) {\n"
     "        ends[n] = 1.0f - 0.5f * float(n);\n"
     "        horizons[n] = 2.0f;\n"
     "    }\n"
     "    for (int k = 0; k < 600 && top > 0; ++k) {\n"
     "        float y = ends[top - 1], x = horizons[top - 1];\n"
     "        if (x > 1.0f) x = conemap_disc_horizon(b, place, disc, y, bounds$COURSE);\n"
     "        horizons[top - 1] = x;\n"
     "        if (abs(x - x0) > 0.25f && y - y0 > 0.01f) { // half a strip, halved 6 times at most\n"
     "            ends[top] = 0.5f * (y0 + y);\n"
     "            horizons[top] = 2.0f;\n"
     "            ++top;\n"
     "        } else {\n"
     "            vec2 strip = conemap_strip(y0, x0, y, x);\n"
     "            seen += strip.x;\n"
     "            area += strip.y;\n"
     "            y0 = y;\n"
     "            x0 = x;\n"
     "            --top;\n"
     "        }\n"
     "    }\n"
     "    return min(max(seen / area, 0.0f), 1.0f);\n"
     "}\n"},
    {"conemap_sky",
     "// The share of the sky, by horizons: each leaves the cosine-weighted part of a half circle above its slope.\n"
     "$FNfloat conemap_sky(conemap_basis b, vec3 place, vec3 normal, int directions, float reach, vec4 "
     "bounds$COURSE_PARAMS) {\n"
     "    float height = sqrt(dot(b.z, b.z)), sum = 0.0f;\n"
     "    vec3 up = conemap_scaled(b.z, 1.0f / height), east = normalize(conemap_along(b.u, -dot(b.u, up), up));\n"
     "    vec3 north = cross(up, east);\n"
     "    for (int k = 0; k < directions; ++k) {\n"
     "        float angle = 6.2831853f * (float(k) + 0.5f) / float(directions), zenith = dot(normal, up);\n"
     "        vec3 direction = conemap_along(conemap_scaled(east, cos(angle)), sin(angle), north);\n"
     "        float across = dot(normal, direction); // what is behind the surface's own plane is hidden\n"
     "        float least = zenith > 1e-4f ? -across / zenith : across > 0.0f ? -1e4f : 1e4f;\n"
     "        conemap_course c = conemap_look_along(b, place, direction, reach, bounds$LAUNCH);\n"
     "        float rise = c.rise, low = min(max(least, -1e4f), 1e4f);\n"
     "        float slope = (conemap_horizon(c, rise + low / height, rise + 1e4f / height, 1.0f / (1024.0f * "
     "height)$MAP) -\n"
     "                       rise) * height;\n"
     "        float part = 1.0f / (1.0f + slope * slope);\n"
     "        sum += across * (0.785398163f - 0.5f * atan(slope) - 0.5f * slope * part) + 0.5f * zenith * part;\n"
     "    }\n"
     "    return min(max(2.0f * sum / float(directions), 0.0f), 1.0f);\n"
     "}\n"},

    /* ---- colours ---- */
    {"conemap_color",
     "// A colour map by the surface's own gradients: the displaced uv jumps at silhouettes.\n"
     "vec4 conemap_color(conemap_shading s) {\n"
     "?glsl     return textureGrad(conemap_colors, s.uv, s.gradient.xy, s.gradient.zw);\n"
     "?hlsl     return conemap_colors.SampleGrad(conemap_color_sampler, s.uv, s.gradient.xy, s.gradient.zw);\n"
     "}\n"},
    {NULL, NULL},
};

static const char conemap__shade_begin[] =
    "// Traces a ray of the world through the relief that the frame puts on a surface, and shades the hit.\n"
    "$FNconemap_shading conemap_shade($SETTINGS_PARAMconemap_frame frame, vec3 origin, vec3 direction$SHADE_PARAMS) "
    "{\n"
    "?sized     ivec2 size = $SIZE_ASKED;\n"
    "    conemap_shading s;\n"
    "?world     s.position = vec3(0.0f, 0.0f, 0.0f);\n"
    "?normal_out     s.normal = vec3(0.0f, 0.0f, 0.0f);\n"
    "?depth     s.depth = 0.0f;\n"
    "?lights     s.shadow = 1.0f;\n"
    "?open     s.occlusion = 1.0f;\n"
    "    conemap_basis basis = conemap_make_basis(frame$TOWARD);\n"
    "?lod     s.level = min(max(conemap_level_of(gradient, $FW, $FH) + e.lod_bias, 0.0f), float(e.level_count - 1));\n"
    "?lod     int level = int(s.level), cap = int(max(8.0f, ceil(float(e.lod_steps) * exp2(-s.level))));\n"
    "?lod     if (e.lod_steps == 0 || cap > $PRIMARY_CAP) cap = $PRIMARY_CAP;\n"
    "?lod     float weight = s.level - float(level);\n"
    "?fade,normal     conemap_basis upright = basis; // before it is flattened\n"
    "?fade     s.fade = conemap_fade_of(basis, gradient, e.fade_begin, e.fade_end);\n"
    "?fade     frame.depth *= 1.0f - min(s.fade, 0.9999f);\n"
    "?fade     basis = conemap_make_basis(frame$TOWARD);\n"
    "    vec3 o = conemap_box_point(basis, origin), d = conemap_box_direction(basis, direction);\n"
    "?ranged     vec2 range = vec2(t_min, t_max);\n"
    "?!ranged,t_range     vec2 range = vec2(0.0f, 1e30f);\n"
    "?bounds,nothing,!lod     vec2 rim = vec2($W > 1 ? 0.5f / $FW : 0.0f, $H > 1 ? 0.5f / $FH : 0.0f);\n"
    "?bounds,nothing,lod     ivec2 coarsest = conemap_level_size(size, weight > 0.0f ? level + 1 : level);\n"
    "?bounds,nothing,lod     vec2 rim = vec2(coarsest.x > 1 ? 0.5f / float(coarsest.x) : 0.0f,\n"
    "?bounds,nothing,lod                     coarsest.y > 1 ? 0.5f / float(coarsest.y) : 0.0f);\n"
    "?bounds     vec4 bounds = vec4($LEAST_U, $LEAST_V, $MOST_U, $MOST_V); // where there is a surface\n"
    "?cuts     range = conemap_clip(range, o.x, d.x, bounds.x, bounds.z);\n"
    "?cuts     range = conemap_clip(range, o.y, d.y, bounds.y, bounds.w);\n"
    "?fade     vec2 whole = range;\n"
    "?fade     if (s.fade >= 0.9999f) range.y = -1.0f; // only the base is left\n"
    "?!flight     conemap_hit hit = conemap_trace(o, d$TRACE_RANGE$TRACE_MAP);\n"
    "?!flight     s.found = hit.found;\n"
    "?!flight     s.t = hit.t;\n"
    "?!flight     s.box = hit.position;\n"
    "?flight,curved     vec3 from = vec3(o.x, o.y, o.z + conemap_drop(basis, o.x, o.y)); // z from the base on\n"
    "?flight     conemap_course c = conemap_take_off($BASIS_ARG$FROM, d, range$LAUNCH_FROM);\n"
    "?flight     c = conemap_fly(c, $CAP_HERE$MAP);\n"
    "?flight     s.found = c.found;\n"
    "?flight     s.t = c.t;\n"
    "?flight,!lod     s.box = vec3((float(c.cell.i) + float(c.si) * c.cell.x + 0.5f) / $FW,\n"
    "?flight,!lod                  (float(c.cell.j) + float(c.sj) * c.cell.y + 0.5f) / $FH, c.z);\n"
    "?flight,lod     ivec2 fine = conemap_level_size(size, level);\n"
    "?flight,lod     s.box = vec3((float(c.cell.i) + float(c.si) * c.cell.x + 0.5f) / float(fine.x),\n"
    "?flight,lod                  (float(c.cell.j) + float(c.sj) * c.cell.y + 0.5f) / float(fine.y), c.z);\n"
    "?fade     if (s.fade >= 0.9999f) {\n"
    "?fade         float base = conemap_base(basis, o, d);\n"
    "?fade         s.found = base >= whole.x * 0.9999f && base <= whole.y;\n"
    "?fade         s.t = max(base, whole.x);\n"
    "?fade         s.box = conemap_along(o, s.t, d);\n"
    "?fade         s.box.z = basis.level;\n"
    "?fade     }\n"
    "?uv     s.uv = vec2(s.box.x, s.box.y);\n"
    "?uv     s.gradient = gradient;\n";

static const char conemap__shade_end[] =
    "?after     if (s.found) {\n"
    "?world         s.position = conemap_along(origin, s.t, direction);\n"
    "?depth         vec3 seen = conemap_along(origin, s.t, direction);\n"
    "?depth         float w = e.clip_w.x * seen.x + e.clip_w.y * seen.y + e.clip_w.z * seen.z + e.clip_w.w;\n"
    "?depth         s.depth = (e.clip_z.x * seen.x + e.clip_z.y * seen.y + e.clip_z.z * seen.z + e.clip_z.w) / w;\n"
    "?depth         if (!(w > 0.0f)) s.depth = 0.0f;\n"
    "?looks,!lod         conemap_ground_at ground = conemap_look(s.box$MAP);\n"
    "?looks,lod         conemap_ground_at ground = conemap_look(s.box, conemap_level_size(size, level)$SLICE_ARG, "
    "level);\n"
    "?looks,lod         if (weight > 0.0f) {\n"
    "?looks,lod             ivec2 next = conemap_level_size(size, level + 1);\n"
    "?looks,lod             ground = conemap_blend(ground, conemap_look(s.box, next$SLICE_ARG, level + 1), weight);\n"
    "?looks,lod         }\n"
    "?normal         vec3 normal = conemap_world_normal($UPRIGHT$BOX_ARG, ground.$SLOPES);\n"
    "?occlusion         float stretch = dot(basis.z, basis.z), x = ground.gentle.x * ground.gentle.x / dot(basis.u, "
    "basis.u);\n"
    "?occlusion         float own = sqrt(stretch * (x + ground.gentle.y * ground.gentle.y / dot(basis.v, basis.v)));\n"
    "?occlusion         float steepest = sqrt(stretch / dot(basis.u, basis.u)) * (min(ground.steepness, 1e6f) - 1.0f "
    "/ $MAX_TAN);\n"
    "?occlusion         float hill = 0.3f * max(steepest - own, 0.0f);\n"
    "?occlusion         s.occlusion = 1.0f / (1.0f + hill * hill);\n"
    "?place         vec3 place = vec3(s.box.x, s.box.y, max(s.box.z, ground.height + 1.0f / 1048576.0f));\n"
    "?walls         int wall = conemap_wall(o, d, bounds, s.t);\n"
    "?walls,holes         if (c.wall > 0) wall = c.wall;\n"
    "?walls,fade         if (s.fade >= 0.9999f) wall = 0;\n"
    "?walls         if (wall > 0) { // on a side of the solid, or rather just beside it\n"
    "?walls,beside             float before = (wall == 1 ? d.x : d.y) > 0.0f ? -1.0f : 1.0f;\n"
    "?walls,normal             vec3 across = wall == 1 ? $UPRIGHT.to_u : $UPRIGHT.to_v;\n"
    "?walls,normal             normal = normalize(conemap_scaled(across, before));\n"
    "?walls,place             if (wall == 1) place.x += before * max(1.0f / 1048576.0f, abs(place.x) / 4194304.0f);\n"
    "?walls,place             if (wall == 2) place.y += before * max(1.0f / 1048576.0f, abs(place.y) / 4194304.0f);\n"
    "?walls,place             place.z = s.box.z;\n"
    "?walls,occlusion             s.occlusion = 0.5f;\n"
    "?walls         }\n"
    "?normal_out         s.normal = normal;\n"
    "?lights         vec4 light = conemap_toward(e.light, basis, place);\n"
    "?lights         vec3 ray = vec3(light.x, light.y, light.z);\n"
    "?hard,!flight         vec3 lit = conemap_box_direction(basis, ray);\n"
    "?hard,!flight         range = vec2(0.0f, light.w);\n"
    "?hard,!flight,clip         range = conemap_clip(range, place.x, lit.x, bounds.x, bounds.z);\n"
    "?hard,!flight,clip         range = conemap_clip(range, place.y, lit.y, bounds.y, bounds.w);\n"
    "?hard,!flight         hit = conemap_trace(place, lit, range.x, range.y$TRACE_MAP);\n"
    "?hard,!flight         s.shadow = hit.found ? 0.0f : 1.0f;\n"
    "?hard,flight         c = conemap_look_along(basis, place, ray, light.w, bounds$LAUNCH_FROM);\n"
    "?hard,flight         c = conemap_fly(c, $FLY_CAP$MAP);\n"
    "?hard,flight         s.shadow = c.found ? 0.0f : 1.0f;\n"
    "?soft         float radius = e.light.w != 0.0f ? min(e.light_radius / light.w, 1.0f) : e.light_radius;\n"
    "?soft         s.shadow = conemap_soft_shadow(basis, place, ray, radius, light.w, bounds$COURSE_FROM);\n"
    "?sky         float reach = e.sky_reach > 0.0f ? e.sky_reach : 1e30f;\n"
    "?sky         s.occlusion = conemap_sky(basis, place, normal, e.sky_directions, reach, bounds$COURSE_FROM);\n"
    "?after     }\n"
    "    return s;\n"
    "}\n";

static const char conemap__shade_resources[] =
    "?holes,!external,!host,glsl $ALPHA_LAYOUTuniform $SAMPLER conemap_alpha; // r, a texel for each of the map's\n"
    "?holes,!external,!host,hlsl $TEXTURE<float> conemap_alpha$ALPHA_LAYOUT; // a texel for each of the map's\n"
    "?colors,!external,glsl $COLORS_LAYOUTuniform $COLOR_SAMPLER conemap_colors; // a colour map\n"
    "?colors,!external,hlsl Texture2D<float4> conemap_colors$COLORS_LAYOUT;\n"
    "?colors,!external,hlsl SamplerState conemap_color_sampler$COLOR_SAMPLER_LAYOUT;\n"
    "?holes,host float conemap_alpha(int i, int j$SLICE_PARAM); // the host's\n"
    "?holes \n"
    "?colors,!holes \n";

static const char conemap__shade_inputs[] =
    "?glsl $IN_0in vec3 conemap_origin;    // of the ray, in the world\n"
    "?glsl $IN_1in vec3 conemap_direction; // t = 1 at the fragment, say\n"
    "?glsl $IN_2in vec3 conemap_frame_tangent;   // the frame at the fragment\n"
    "?glsl $IN_3in vec3 conemap_frame_bitangent;\n"
    "?glsl $IN_4in vec3 conemap_frame_normal;\n"
    "?glsl $IN_5in vec3 conemap_point;     // the fragment in the world\n"
    "?glsl $IN_6in vec2 conemap_uv;        // and on the map\n"
    "?glsl layout(location = 0) out vec4 conemap_target0; // u, v, z, t\n"
    "?glsl,world layout(location = 1) out vec4 conemap_target1; // position\n"
    "?glsl,normal_out layout(location = $TARGET_2) out vec4 conemap_target$TARGET_2; // normal\n"
    "?glsl,colors layout(location = $TARGET_3) out vec4 conemap_target$TARGET_3; // colour\n"
    "?glsl,numbers layout(location = $TARGET_4) out vec4 conemap_target$TARGET_4; // shadow, occlusion, level, fade\n"
    "?glsl,greater layout(depth_greater) out float gl_FragDepth;\n"
    "?glsl,less layout(depth_less) out float gl_FragDepth;\n";

static const char conemap__shade_buffers[] =
    "?glsl layout(local_size_x = 64) in;\n"
    "// Eight a ray: origin, t_min; direction, t_max; the frame's tangent, bitangent, normal and point; its uv;\n"
    "?gradient // the gradient.\n"
    "?!gradient // and one that is not read.\n"
    "?glsl layout(std430$SHADE_RAYS) readonly buffer conemap_ray_buffer {\n"
    "?glsl     vec4 conemap_rays[];\n"
    "?glsl };\n"
    "?hlsl StructuredBuffer<float4> conemap_rays$SHADE_RAYS;\n"
    "// $TARGETS a ray: u, v, z, t, which is -1 without a hit$TARGET_NAMES.\n"
    "?glsl layout(std430$SHADE_HITS) writeonly buffer conemap_hit_buffer {\n"
    "?glsl     vec4 conemap_hits[];\n"
    "?glsl };\n"
    "?hlsl RWStructuredBuffer<float4> conemap_hits$SHADE_HITS;\n";

static const char conemap__shade_block[] =
    "?vulkan $BLOCK_LAYOUTuniform conemap_block {\n"
    "?hlsl cbuffer conemap_block$BLOCK_LAYOUT {\n"
    "?settings $UNIFORMconemap_effects conemap_settings;\n"
    "$UNIFORMvec4 conemap_shape; // uv_scale, depth, level\n"
    "?curved $UNIFORMvec4 conemap_curvature;\n"
    "?ranged,fragment $UNIFORMvec2 conemap_range; // t_min, t_max\n"
    "?atlas $UNIFORMivec4 conemap_rect;\n"
    "?size_argument $UNIFORMivec2 conemap_map_size;\n"
    "?array $UNIFORMint conemap_slice;\n"
    "?vulkan };\n"
    "?hlsl };\n"
    "\n";

static const char conemap__shade_fragment[] =
    "?hlsl struct conemap_inputs {\n"
    "?hlsl     float3 origin : TEXCOORD0;    // of the ray, in the world\n"
    "?hlsl     float3 direction : TEXCOORD1; // t = 1 at the fragment, say\n"
    "?hlsl     float3 tangent : TEXCOORD2;   // the frame at the fragment\n"
    "?hlsl     float3 bitangent : TEXCOORD3;\n"
    "?hlsl     float3 normal : TEXCOORD4;\n"
    "?hlsl     float3 place : TEXCOORD5;     // the fragment in the world\n"
    "?hlsl     float2 uv : TEXCOORD6;        // and on the map\n"
    "?hlsl };\n"
    "?hlsl \n"
    "?hlsl struct conemap_targets {\n"
    "?hlsl     float4 box : SV_Target0; // u, v, z, t\n"
    "?hlsl,world     float4 position : SV_Target1;\n"
    "?hlsl,normal_out     float4 normal : SV_Target$TARGET_2;\n"
    "?hlsl,colors     float4 color : SV_Target$TARGET_3;\n"
    "?hlsl,numbers     float4 numbers : SV_Target$TARGET_4; // shadow, occlusion, level, fade\n"
    "?hlsl,depth     float depth : $SV_DEPTH;\n"
    "?hlsl };\n"
    "?hlsl \n"
    "?hlsl conemap_targets main(conemap_inputs inputs) {\n"
    "?glsl void main() {\n"
    "    conemap_frame frame;\n"
    "?glsl     frame.origin = conemap_point;\n"
    "?glsl     frame.tangent = conemap_frame_tangent;\n"
    "?glsl     frame.bitangent = conemap_frame_bitangent;\n"
    "?glsl     frame.normal = conemap_frame_normal;\n"
    "?glsl     frame.uv_offset = conemap_uv;\n"
    "?hlsl     frame.origin = inputs.place;\n"
    "?hlsl     frame.tangent = inputs.tangent;\n"
    "?hlsl     frame.bitangent = inputs.bitangent;\n"
    "?hlsl     frame.normal = inputs.normal;\n"
    "?hlsl     frame.uv_offset = inputs.uv;\n"
    "    frame.uv_scale = conemap_shape.xy;\n"
    "    frame.depth = conemap_shape.z;\n"
    "    frame.level = conemap_shape.w;\n"
    "?curved     frame.curvature = conemap_curvature.xyz;\n"
    "?gradient,glsl     vec4 gradient = vec4(dFdx(conemap_uv), dFdy(conemap_uv));\n"
    "?gradient,hlsl     vec4 gradient = vec4(ddx(inputs.uv), ddy(inputs.uv));\n"
    "?glsl     conemap_shading s = conemap_shade($SETTINGS_ARGframe, conemap_origin, conemap_direction$SHADE_ARGS);\n"
    "?hlsl     conemap_shading s = conemap_shade($SETTINGS_ARGframe, inputs.origin, inputs.direction$SHADE_ARGS);\n"
    "?colors     vec4 color = conemap_color(s);\n"
    "    if (!s.found) discard;\n"
    "?hlsl     conemap_targets targets;\n"
    "    $TARGET_BOX = vec4(s.box, s.t);\n"
    "?world     $TARGET_POSITION = vec4(s.position, 1.0f);\n"
    "?normal_out     $TARGET_NORMAL = vec4(s.normal, 0.0f);\n"
    "?colors     $TARGET_COLOR = color;\n"
    "?numbers     $TARGET_NUMBERS = vec4($NUMBERS);\n"
    "?glsl,depth     gl_FragDepth = s.depth;\n"
    "?hlsl,depth     targets.depth = s.depth;\n"
    "?hlsl     return targets;\n"
    "}\n";

static const char conemap__shade_compute[] =
    "?hlsl [numthreads(64, 1, 1)]\n"
    "?hlsl void main(uint3 thread : SV_DispatchThreadID) {\n"
    "?hlsl     uint count, stride;\n"
    "?hlsl     conemap_rays.GetDimensions(count, stride);\n"
    "?hlsl     uint ray = 8u * thread.x, answer = $TARGETSu * thread.x;\n"
    "?hlsl     if (ray + 7u >= count) return;\n"
    "?glsl void main() {\n"
    "?glsl     int ray = 8 * int(gl_GlobalInvocationID.x), answer = $TARGETS * int(gl_GlobalInvocationID.x);\n"
    "?glsl     if (ray + 7 >= conemap_rays.length()) return;\n"
    "    vec4 origin = conemap_rays[ray], direction = conemap_rays[ray + 1$UNSIGNED];\n"
    "    conemap_frame frame;\n"
    "    frame.tangent = conemap_rays[ray + 2$UNSIGNED].xyz;\n"
    "    frame.bitangent = conemap_rays[ray + 3$UNSIGNED].xyz;\n"
    "    frame.normal = conemap_rays[ray + 4$UNSIGNED].xyz;\n"
    "    frame.origin = conemap_rays[ray + 5$UNSIGNED].xyz;\n"
    "    frame.uv_offset = conemap_rays[ray + 6$UNSIGNED].xy;\n"
    "    frame.uv_scale = conemap_shape.xy;\n"
    "    frame.depth = conemap_shape.z;\n"
    "    frame.level = conemap_shape.w;\n"
    "?curved     frame.curvature = conemap_curvature.xyz;\n"
    "?gradient     vec4 gradient = conemap_rays[ray + 7$UNSIGNED];\n"
    "    conemap_shading s = conemap_shade($SETTINGS_ARGframe, origin.xyz, direction.xyz$SHADE_ARGS);\n"
    "    $TARGET_BOX = vec4(s.box, s.found ? s.t : -1.0f);\n"
    "?world     $TARGET_POSITION = vec4(s.position, 1.0f);\n"
    "?normal_out     $TARGET_NORMAL = vec4(s.normal, 0.0f);\n"
    "?colors     $TARGET_COLOR = conemap_color(s);\n"
    "?numbers     $TARGET_NUMBERS = vec4($NUMBERS);\n"
    "?depth     $TARGET_DEPTH = vec4(s.depth, 0.0f, 0.0f, 0.0f);\n"
    "}\n";

/* Unknown bits, or two effects of which one is instead of the other. */
static int conemap__effects_clash(unsigned flags) {
    const unsigned normals = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL;
    const unsigned shadows = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
    const unsigned skies = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY;
    return (flags & ~(unsigned)CONEMAP_EFFECT_ALL_BITS) || (flags & normals) == normals ||
           (flags & shadows) == shadows || (flags & skies) == skies;
}

/* Sets the flags of effects, and says what does not go with them. */
static conemap_result conemap__resolve_emitted_effects(conemap__emitter *e) {
    conemap_shader_desc *d = &e->desc;
    unsigned char *f = e->flags;
    const unsigned flags = d->flags;
    int asked;
    if (!CONEMAP__KNOWN(d->depth_bound, CONEMAP_DEPTH_BOUND_COUNT)) return CONEMAP_ERROR_ENUM;
    if (d->depth_bound != CONEMAP_DEPTH_ANY &&
        (!(flags & CONEMAP_EFFECT_DEPTH) || !f[conemap__flag_fragment] || f[conemap__flag_es] ||
         d->dialect == CONEMAP_GLSL_330))
        return CONEMAP_ERROR_UNSUPPORTED;
    if (flags == 0) return CONEMAP_OK;
    if (conemap__effects_clash(flags)) return CONEMAP_ERROR_UNSUPPORTED;
    e->tables[1] = conemap__effect_snippets;
    f[conemap__flag_shading] = 1;
    f[conemap__flag_clip] = (flags & CONEMAP_EFFECT_CLIP) != 0;
    f[conemap__flag_holes] = (flags & CONEMAP_EFFECT_HOLES) != 0;
    f[conemap__flag_curved] = (flags & CONEMAP_EFFECT_CURVED) != 0;
    f[conemap__flag_lod] = (flags & CONEMAP_EFFECT_LOD) != 0;
    f[conemap__flag_fade] = (flags & CONEMAP_EFFECT_FADE) != 0;
    f[conemap__flag_two_sided] = (flags & CONEMAP_EFFECT_TWO_SIDED) != 0;
    f[conemap__flag_world] = (flags & CONEMAP_EFFECT_POSITION) != 0;
    f[conemap__flag_smooth] = (flags & CONEMAP_EFFECT_SMOOTH_NORMAL) != 0;
    f[conemap__flag_normal_out] = (flags & CONEMAP_EFFECT_NORMAL) || f[conemap__flag_smooth];
    f[conemap__flag_depth] = (flags & CONEMAP_EFFECT_DEPTH) != 0;
    f[conemap__flag_hard] = (flags & CONEMAP_EFFECT_SHADOW) != 0;
    f[conemap__flag_soft] = (flags & CONEMAP_EFFECT_SOFT_SHADOW) != 0;
    f[conemap__flag_lights] = f[conemap__flag_hard] || f[conemap__flag_soft];
    f[conemap__flag_occlusion] = (flags & CONEMAP_EFFECT_OCCLUSION) != 0;
    f[conemap__flag_sky] = (flags & CONEMAP_EFFECT_SKY) != 0;
    f[conemap__flag_open] = f[conemap__flag_occlusion] || f[conemap__flag_sky];
    f[conemap__flag_uv] = (flags & CONEMAP_EFFECT_UV) != 0;
    f[conemap__flag_colors] = f[conemap__flag_uv] && !f[conemap__flag_c];
    f[conemap__flag_normal] = f[conemap__flag_normal_out] || f[conemap__flag_sky];
    f[conemap__flag_gentle] = f[conemap__flag_smooth] || f[conemap__flag_occlusion];
    f[conemap__flag_place] = f[conemap__flag_lights] || f[conemap__flag_sky];
    f[conemap__flag_beside] = f[conemap__flag_normal] || f[conemap__flag_place];
    f[conemap__flag_looks] = f[conemap__flag_normal_out] || f[conemap__flag_place] || f[conemap__flag_open];
    f[conemap__flag_after] = f[conemap__flag_world] || f[conemap__flag_depth] || f[conemap__flag_looks];
    f[conemap__flag_gradient] = f[conemap__flag_uv] || f[conemap__flag_lod] || f[conemap__flag_fade];
    f[conemap__flag_flight] = f[conemap__flag_curved] || f[conemap__flag_lod] || f[conemap__flag_holes];
    f[conemap__flag_numbers] =
        f[conemap__flag_lights] || f[conemap__flag_open] || f[conemap__flag_lod] || f[conemap__flag_fade];
    f[conemap__flag_settings] = f[conemap__flag_clip] || f[conemap__flag_depth] || f[conemap__flag_lights] ||
                                f[conemap__flag_sky] || f[conemap__flag_holes] || f[conemap__flag_lod] ||
                                f[conemap__flag_fade];
    f[conemap__flag_stored] = f[conemap__flag_gentle] && d->map.texture.layout == CONEMAP_DUMMER && !d->fetch;
    f[conemap__flag_walls] = f[conemap__flag_looks] &&
                             (f[conemap__flag_clip] || f[conemap__flag_holes] || !f[conemap__flag_wrap_u] ||
                              !f[conemap__flag_wrap_v]);
    f[conemap__flag_cuts] = f[conemap__flag_clip] || f[conemap__flag_fade] || f[conemap__flag_flight];
    f[conemap__flag_bounds] =
        f[conemap__flag_cuts] || f[conemap__flag_walls] || f[conemap__flag_soft] || f[conemap__flag_sky];
    f[conemap__flag_sized] = f[conemap__flag_size_asked] && (f[conemap__flag_looks] || f[conemap__flag_flight] ||
                                                             (f[conemap__flag_bounds] && f[conemap__flag_nothing]));
    f[conemap__flag_greater] = d->depth_bound == CONEMAP_DEPTH_GREATER;
    f[conemap__flag_less] = d->depth_bound == CONEMAP_DEPTH_LESS;
    f[conemap__flag_ranged] = d->t_range != 0;
    if (f[conemap__flag_cuts] || f[conemap__flag_hard]) /* conemap_trace's, whatever conemap_shade has */
        d->t_range = f[conemap__flag_t_range] = 1;
    asked = f[conemap__flag_flight] || f[conemap__flag_place]; /* a flight, or a second trace that must be exact */
    if (f[conemap__flag_any] || d->steps || d->status || d->run_time_cap ||
        (f[conemap__flag_looks] && d->filter != CONEMAP_FILTER_FETCH) || (asked && !f[conemap__flag_exact]) ||
        ((f[conemap__flag_flight] || f[conemap__flag_soft] || f[conemap__flag_sky]) &&
         (d->filter != CONEMAP_FILTER_FETCH || f[conemap__flag_falling])) ||
        (f[conemap__flag_occlusion] && !f[conemap__flag_cones]) ||
        (f[conemap__flag_lod] && (d->fixed_size || d->atlas)))
        return CONEMAP_ERROR_UNSUPPORTED;
    return CONEMAP_OK;
}

/* What the pieces of the texts above stand for. */
static void conemap__make_effect_pieces(conemap__emitter *e) {
    static const char *const least[2][2] = {{"LEAST_U", "MOST_U"}, {"LEAST_V", "MOST_V"}};
    static const char *const clip[2][2] = {{"e.clip.x", "e.clip.z"}, {"e.clip.y", "e.clip.w"}};
    static const char *const rim[2][2] = {{"rim.x", "1.0f - rim.x"}, {"rim.y", "1.0f - rim.y"}};
    static const char *const targets[6] = {"TARGET_BOX",   "TARGET_POSITION", "TARGET_NORMAL",
                                           "TARGET_COLOR", "TARGET_NUMBERS",  "TARGET_DEPTH"};
    static const char *const fields[5] = {"targets.box", "targets.position", "targets.normal", "targets.color",
                                          "targets.numbers"};
    static const char *const contents[6] = {"", "; position", "; normal", "; colour",
                                            "; shadow, occlusion, level, fade", "; depth"};
    const conemap_shader_desc *d = &e->desc;
    const unsigned char *f = e->flags;
    const size_t size = CONEMAP__PIECE_SIZE;
    const int hlsl = f[conemap__flag_hlsl], array = f[conemap__flag_array], lod = f[conemap__flag_lod];
    const int holes = f[conemap__flag_holes], curved = f[conemap__flag_curved], host = f[conemap__flag_host];
    int binding = d->binding + f[conemap__flag_uses_map] + f[conemap__flag_uses_octants] +
                  f[conemap__flag_uses_heights] + f[conemap__flag_uses_maxima];
    int axis, end, k, target = 0;
    char *out, *written;
    if (!f[conemap__flag_shading]) return;

    /* Arguments. */
    conemap__piece_set(e, "FLAT_PARAMS", 0, "$SIZE_PARAMS$SLICE_PARAM");
    conemap__piece_set(e, "FLAT", 0, "$SIZE$SLICE_ARG");
    conemap__piece_set(e, "SETTINGS_PARAM", 0, f[conemap__flag_settings] ? "conemap_effects e, " : "");
    conemap__piece_set(e, "SETTINGS_ARG", 0, f[conemap__flag_settings] ? "conemap_settings, " : "");
    out = conemap__piece_new(e, "SHADE_PARAMS", 0);
    if (f[conemap__flag_ranged]) conemap__append(out, size, ", float t_min, float t_max");
    if (f[conemap__flag_gradient]) conemap__append(out, size, ", vec4 gradient");
    conemap__append(out, size, f[conemap__flag_size_asked] ? "$SLICE_PARAM" : "$FLAT_PARAMS");
    out = conemap__piece_new(e, "SHADE_SIGNATURE", 0);
    conemap__append(out, size,
                    f[conemap__flag_settings] ? "effects, frame, origin, direction" : "frame, origin, direction");
    if (f[conemap__flag_ranged]) conemap__append(out, size, ", t_min, t_max");
    if (f[conemap__flag_gradient]) conemap__append(out, size, ", gradient");
    conemap__append(out, size, f[conemap__flag_size_asked] ? "$SLICE_ARG" : "$FLAT");
    out = conemap__piece_new(e, "SHADE_ARGS", 0);
    if (f[conemap__flag_ranged])
        conemap__append(out, size,
                        f[conemap__flag_compute] ? ", origin.w, direction.w" : ", conemap_range.x, conemap_range.y");
    if (f[conemap__flag_gradient]) conemap__append(out, size, ", gradient");
    if (d->atlas) conemap__append(out, size, ", conemap_rect");
    if (f[conemap__flag_size_argument]) conemap__append(out, size, ", conemap_map_size");
    if (array) conemap__append(out, size, ", conemap_slice");
    conemap__piece_set(e, "TRACE_RANGE", 0, d->t_range ? ", range.x, range.y" : "");
    conemap__piece_set(e, "TRACE_MAP", 0, f[conemap__flag_size_asked] ? "$SLICE_ARG" : "$FLAT");
    for (k = 0; k < 6; ++k) { /* of functions that begin flights: what is put in, and what goes on to the map */
        static const char *const names[6] = {"LAUNCH_PARAMS", "LAUNCH", "LAUNCH_FROM", "COURSE_PARAMS", "COURSE",
                                             "COURSE_FROM"};
        static const char *const cuts[3] = {", float alpha_cut", ", alpha_cut", ", e.alpha_cut"};
        out = conemap__piece_new(e, names[k], 0);
        if (lod) conemap__append(out, size, k % 3 ? ", weight" : ", float weight");
        if (holes) conemap__append(out, size, cuts[k % 3]);
        if (k >= 3)
            conemap__append(out, size, k % 3 ? "$MAP" : "$MAP_PARAMS");
        else
            conemap__append(out, size, k % 3 ? (lod ? "$SIZE, level" : "$SIZE") : "$SIZE_PARAMS$LEVEL_PARAM");
    }
    conemap__piece_set(e, "TOWARD_PARAM", 0, f[conemap__flag_two_sided] ? ", vec3 toward" : "");
    conemap__piece_set(e, "TOWARD", 0, f[conemap__flag_two_sided] ? ", direction" : "");
    conemap__piece_set(e, "SIDE", 0, f[conemap__flag_two_sided] ? "side * " : "");
    conemap__piece_set(e, "B_PARAM", 0, curved ? "conemap_basis b, " : "");
    conemap__piece_set(e, "B_ARG", 0, curved ? "b, " : "");
    conemap__piece_set(e, "BASIS_ARG", 0, curved ? "basis, " : "");
    conemap__piece_set(e, "BOX_PARAM", 0, curved ? ", vec3 box" : "");
    conemap__piece_set(e, "BOX_ARG", 0, curved ? ", s.box" : "");
    conemap__piece_set(e, "FROM", 0, curved ? "from" : "o");
    conemap__piece_set(e, "ROOT", 0, curved ? "conemap_first_root" : "conemap_fall");
    conemap__piece_set(e, "PLUS_BEND", 0, curved ? ", c.bend" : "");
    conemap__piece_set(e, "MINUS_BEND", 0, curved ? ", -c.bend" : "");
    conemap__piece_set(e, "BEND_LESS", 0, curved ? "c.bend - " : "-");
    conemap__piece_set(e, "FALLEN", 0, curved ? " - c.bend * t * t" : "");
    conemap__piece_set(e, "HOLLOW", 0, curved ? "c.bend >= 0.0f && " : "");
    conemap__piece_set(e, "UPRIGHT", 0, f[conemap__flag_fade] ? "upright" : "basis");
    conemap__piece_set(e, "SLOPES", 0, f[conemap__flag_smooth] ? "gentle" : "slope");
    conemap__piece_set(e, "NO_HOLE", 0, holes ? " && !hole" : "");
    conemap__piece_set(e, "NOT_HOLE", 0, holes ? "!conemap_over_hole(c$FLAT) && " : "");
    conemap__piece_set(e, "OF_HEIGHT", 0, f[conemap__flag_both] ? ".x" : "");
    conemap__append_int(conemap__piece_new(e, "SECTORS", 0), size, d->map.texture.sectors);
    for (k = 0; k < 2; ++k) {
        out = conemap__piece_new(e, k ? "OVER_ASPECT" : "ASPECT_TIMES", 0);
        if (d->map.aspect == 1.0f) continue;
        if (k) conemap__append(out, size, " / ");
        conemap__append_float(out, size, d->map.aspect);
        if (!k) conemap__append(out, size, " * ");
    }

    /* Step caps: a flight crosses the borders of up to three lattices. */
    out = conemap__piece_new(e, "FLY_CAP", 0);
    k = 8 * (f[conemap__flag_wraps] ? 16 : 1);
    conemap__append_int(out, size, d->fixed_size ? k * (d->map.width + d->map.height) : k);
    if (!d->fixed_size) conemap__append(out, size, d->atlas ? " * (rect.z + rect.w)" : " * (size.x + size.y)");
    if (d->trace.max_steps)
        conemap__append_int(conemap__piece_new(e, "PRIMARY_CAP", 0), size, d->trace.max_steps);
    else
        conemap__piece_set(e, "PRIMARY_CAP", 0, "$FLY_CAP");
    conemap__piece_set(e, "CAP_HERE", 0, lod ? "cap" : "$PRIMARY_CAP");

    /* Where there is a surface. */
    for (axis = 0; axis < 2; ++axis)
        for (end = 0; end < 2; ++end) {
            const int wraps = f[axis ? conemap__flag_wrap_v : conemap__flag_wrap_u];
            const int nothing = f[axis ? conemap__flag_nothing_v : conemap__flag_nothing_u];
            const int clips = f[conemap__flag_clip];
            const char *own = wraps ? (end ? "1e30f" : "-1e30f") : nothing ? rim[axis][end] : end ? "1.0f" : "0.0f";
            out = conemap__piece_new(e, least[axis][end], 0);
            if (clips && !wraps) conemap__append(out, size, end ? "min(" : "max(");
            if (clips) conemap__append(out, size, clip[axis][end]);
            if (clips && !wraps) conemap__append(out, size, ", ");
            if (!clips || !wraps) conemap__append(out, size, own);
            if (clips && !wraps) conemap__append(out, size, ")");
        }

    /* Texture reads and resources. */
    conemap__read_texture(e, conemap__piece_new(e, "STORED", 0), "$MAP_NAME", hlsl ? ".Load" : "texelFetch(",
                          hlsl    ? (array ? "(int4($I, $J, slice, $LOD))" : "(int3($I, $J, $LOD))")
                          : array ? ", ivec3($I, $J, slice), $LOD)"
                                  : ", ivec2($I, $J), $LOD)",
                          ".ba");
    conemap__piece_set(e, "STORED_V", 0, d->map.texture.flip_dv ? "0.5f - stored.y" : "stored.y - 0.5f");
    out = conemap__piece_new(e, "ALPHA", 0);
    if (host)
        conemap__append(out, size, "conemap_alpha($I, $J$SLICE_ARG)");
    else
        conemap__read_texture(e, out, "conemap_alpha", hlsl ? ".Load" : "texelFetch(",
                              hlsl    ? (array ? "(int4($I, $J, slice, 0))" : "(int3($I, $J, 0))")
                              : array ? ", ivec3($I, $J, slice), 0)"
                                      : ", ivec2($I, $J), 0)",
                              ".r");
    conemap__place_resource(e, "ALPHA_LAYOUT", 't', binding);
    binding += holes && !host;
    conemap__place_resource(e, "COLORS_LAYOUT", 't', binding);
    binding += f[conemap__flag_colors];
    conemap__piece_set(e, "COLOR_SAMPLER", 1, f[conemap__flag_es] ? "highp sampler2D" : "sampler2D");
    conemap__place_resource(e, "COLOR_SAMPLER_LAYOUT", 's', d->sampler_binding + f[conemap__flag_sampler]);
    if (f[conemap__flag_vulkan] || hlsl) /* beside the arguments of the tracer */
        conemap__place_resource(e, "BLOCK_LAYOUT", hlsl ? 'b' : 't', hlsl ? d->binding : binding);
    binding += f[conemap__flag_vulkan];
    conemap__place_resource(e, "SHADE_RAYS", hlsl ? 't' : 'b', binding);
    conemap__place_resource(e, "SHADE_HITS", hlsl ? 'u' : 'b', hlsl ? d->binding : binding + 1);
    for (k = 2; k < 7; ++k) {
        static const char *const names[7] = {"", "", "IN_2", "IN_3", "IN_4", "IN_5", "IN_6"};
        out = conemap__piece_new(e, names[k], 1);
        if (!f[conemap__flag_located]) continue;
        conemap__append(out, size, "layout(location = ");
        conemap__append_int(out, size, k);
        conemap__append(out, size, ") ");
    }
    written = conemap__piece_new(e, "TARGET_NAMES", 1);
    for (k = 0; k < 6; ++k) { /* targets that were asked for follow each other */
        static const char *const numbers[5] = {"", "", "TARGET_2", "TARGET_3", "TARGET_4"};
        const int compute = f[conemap__flag_compute];
        const int there = k == 0   ? 1
                          : k == 1 ? f[conemap__flag_world]
                          : k == 2 ? f[conemap__flag_normal_out]
                          : k == 3 ? f[conemap__flag_colors]
                          : k == 4 ? f[conemap__flag_numbers]
                                   : f[conemap__flag_depth] && compute; /* FRAGMENT has one of its own */
        if (k > 1 && k < 5) conemap__append_int(conemap__piece_new(e, numbers[k], 1), size, target);
        out = conemap__piece_new(e, targets[k], 0);
        if (compute) {
            conemap__append(out, size, "conemap_hits[answer + ");
            conemap__append_int(out, size, target);
            conemap__append(out, size, "$UNSIGNED]");
        } else {
            conemap__append(out, size, hlsl && k < 5 ? fields[k] : "conemap_target");
            if (!hlsl) conemap__append_int(out, size, target);
        }
        if (there) conemap__append(written, size, contents[k]);
        target += there;
    }
    conemap__append_int(conemap__piece_new(e, "TARGETS", 1), size, target);
    out = conemap__piece_new(e, "NUMBERS", 0);
    conemap__append(out, size, f[conemap__flag_lights] ? "s.shadow, " : "1.0f, ");
    conemap__append(out, size, f[conemap__flag_open] ? "s.occlusion, " : "1.0f, ");
    conemap__append(out, size, lod ? "s.level, " : "0.0f, ");
    conemap__append(out, size, f[conemap__flag_fade] ? "s.fade" : "0.0f");
    conemap__piece_set(e, "SV_DEPTH", 1,
                       f[conemap__flag_greater] ? "SV_DepthGreaterEqual"
                       : f[conemap__flag_less]  ? "SV_DepthLessEqual"
                                                : "SV_Depth");
}

static void conemap__write_resources(conemap__emitter *e) {
    if (e->flags[conemap__flag_shading]) conemap__lines(e, conemap__shade_resources, 0);
}

/* The function that shades, and the shader around it. */
static void conemap__write_effects(conemap__emitter *e) {
    conemap__lines(e, conemap__shade_begin, 1);
    conemap__lines(e, conemap__shade_end, 1);
    conemap__lines(e, conemap__shade_begin, 0);
    conemap__lines(e, conemap__shade_end, 0);
    conemap__put(e, "\n", 1);
    if (e->flags[conemap__flag_colors]) conemap__snippet_named(e, "conemap_color", 13);
    if (e->flags[conemap__flag_fragment]) conemap__lines(e, conemap__shade_inputs, 0);
    if (e->flags[conemap__flag_compute]) conemap__lines(e, conemap__shade_buffers, 0);
    if (e->desc.stage != CONEMAP_STAGE_FUNCTIONS) conemap__lines(e, conemap__shade_block, 0);
    if (e->flags[conemap__flag_fragment]) conemap__lines(e, conemap__shade_fragment, 0);
    if (e->flags[conemap__flag_compute]) conemap__lines(e, conemap__shade_compute, 0);
}

/* ======================================================================================================
   F R U S T U M   R A Y S

   One frustum, in its own frame and in doubles: the packed floats are what it is. `s` is the height of a cutting plane
   over its y-intercept per distance from the axis, in the direction of a point: s = a sin + b cos of its angle.
   ====================================================================================================== */

/* A cone x^2 + z^2 = (r + k y)^2, r + k y >= 0. */
typedef struct conemap__cone {
    double r, k;
} conemap__cone;

/* A ray in a frustum's frame. */
typedef struct conemap__local_ray {
    double o[3], v[3];
} conemap__local_ray;

/* A place in a frustum, with what it was computed from. */
typedef struct conemap__place_uvw {
    double u, v, w;
    double d, sine, cosine; /* distance from the axis; direction of the angle */
    conemap__cone own;      /* the cone of the shell that goes through the point */
    double lower, upper;    /* y where that cone's straight line through the point meets the cutting planes */
    double thickness;       /* of the shell at the point's y */
} conemap__place_uvw;

CONEMAP__INLINE double conemap__dot3(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

CONEMAP__INLINE void conemap__cross3(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

CONEMAP__INLINE double conemap__absd(double x) { return x < 0.0 ? -x : x; }

/* Divides by the length; 0 if there is none to speak of. */
static int conemap__normalise3(double *a) {
    double length = sqrt(conemap__dot3(a, a));
    int k;
    if (length < 1e-200) return 0;
    for (k = 0; k < 3; ++k) a[k] /= length;
    return 1;
}

CONEMAP__INLINE conemap__cone conemap__cone_at(const conemap_frustum *f, double w) {
    conemap__cone cone;
    cone.r = (double)f->r + w * (double)f->t;
    cone.k = (double)f->k + w * (double)f->tk;
    return cone;
}

/* The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. All four quadrants, which [BJCW09 eq. 6]'s arctangent
   of x / z does not tell apart. A series, so that the bits do not depend on the platform's atan2; off by 3e-13. */
static double conemap__turns(double x, double z) {
    double ax = conemap__absd(x), az = conemap__absd(z), a, a2, angle, base = 0.0;
    if (ax + az == 0.0) return 0.0;
    a = ax < az ? ax / az : az / ax;
    if (a > 0.41421356237309503) { /* tan(pi / 8): turn back by pi / 4 */
        a = (a - 1.0) / (a + 1.0);
        base = 0.125;
    }
    a2 = a * a;
    angle = a * (1.0 + a2 * (-1.0 / 3 + a2 * (1.0 / 5 + a2 * (-1.0 / 7 + a2 * (1.0 / 9 + a2 * (-1.0 / 11 +
            a2 * (1.0 / 13 + a2 * (-1.0 / 15 + a2 * (1.0 / 17 + a2 * (-1.0 / 19 + a2 * (1.0 / 21 +
            a2 * (-1.0 / 23 + a2 * (1.0 / 25 - a2 / 27.0)))))))))))));
    angle = base + angle * 0.15915494309189535;
    if (ax > az) angle = 0.25 - angle;
    if (z < 0.0) angle = 0.5 - angle;
    return x < 0.0 ? 1.0 - angle : angle;
}

/* Sine and cosine of an angle in turns. */
static void conemap__turn(double turns, double *sine, double *cosine) {
    double x = (conemap__fraction(turns + 0.125) - 0.125) * 4.0, s, c, x2, keep;
    int quarter = conemap__floord(x + 0.5);
    x = (x - (double)quarter) * 1.5707963267948966;
    x2 = x * x;
    s = x * (1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0 * (1.0 - x2 / 110.0 *
        (1.0 - x2 / 156.0))))));
    c = 1.0 - x2 / 2.0 * (1.0 - x2 / 12.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0 * (1.0 - x2 / 90.0 *
        (1.0 - x2 / 132.0 * (1.0 - x2 / 182.0))))));
    for (; quarter > 0; --quarter) {
        keep = s;
        s = c;
        c = -keep;
    }
    *sine = s;
    *cosine = c;
}

static void conemap__to_local(const conemap_frustum *f, const double *p, double *out) {
    double q[3];
    q[0] = p[0] - (double)f->axis_x[3];
    q[1] = p[1] - (double)f->axis_y[3];
    q[2] = p[2] - (double)f->axis_z[3];
    out[0] = (double)f->axis_x[0] * q[0] + (double)f->axis_x[1] * q[1] + (double)f->axis_x[2] * q[2];
    out[1] = (double)f->axis_y[0] * q[0] + (double)f->axis_y[1] * q[1] + (double)f->axis_y[2] * q[2];
    out[2] = (double)f->axis_z[0] * q[0] + (double)f->axis_z[1] * q[1] + (double)f->axis_z[2] * q[2];
}

/* A gradient, or normal, of the frustum's frame in the world's: for rows of any length. */
static void conemap__gradient_to_world(const conemap_frustum *f, const double *n, double *out) {
    int k;
    for (k = 0; k < 3; ++k)
        out[k] = (double)f->axis_x[k] * n[0] + (double)f->axis_y[k] * n[1] + (double)f->axis_z[k] * n[2];
}

CONEMAP__INLINE double conemap__origin(const conemap_frustum *f, int k) {
    return (double)(k == 0 ? f->axis_x : k == 1 ? f->axis_y : f->axis_z)[3];
}

/* What one step along each axis of the frame is in the world; the rows are at right angles, of any length. */
static void conemap__axes(const conemap_frustum *f, double axes[3][3]) {
    int k, r;
    for (r = 0; r < 3; ++r) {
        const float *row = r == 0 ? f->axis_x : r == 1 ? f->axis_y : f->axis_z;
        double x = (double)row[0], y = (double)row[1], z = (double)row[2], by = 1.0 / (x * x + y * y + z * z);
        for (k = 0; k < 3; ++k) axes[r][k] = by * (double)row[k];
    }
}

static conemap__local_ray conemap__local(const conemap_frustum *f, const double *o, const double *v) {
    conemap__local_ray ray;
    conemap__to_local(f, o, ray.o);
    ray.v[0] = (double)f->axis_x[0] * v[0] + (double)f->axis_x[1] * v[1] + (double)f->axis_x[2] * v[2];
    ray.v[1] = (double)f->axis_y[0] * v[0] + (double)f->axis_y[1] * v[1] + (double)f->axis_y[2] * v[2];
    ray.v[2] = (double)f->axis_z[0] * v[0] + (double)f->axis_z[1] * v[1] + (double)f->axis_z[2] * v[2];
    return ray;
}

/* y where the straight line of a cone in a direction meets a cutting plane: y = c + s (r + k y). The limits on the
   slope keep k s below 1. */
CONEMAP__INLINE double conemap__cut_y(const float *plane, double s, conemap__cone cone) {
    return ((double)plane[2] + s * cone.r) / (1.0 - cone.k * s);
}

/* Narrows [t0, t1] to where g0 + g1 t >= 0. Returns 1 if t0 moved. */
CONEMAP__INLINE int conemap__half_space(double g0, double g1, double *t0, double *t1) {
    double t;
    if (g1 == 0.0) {
        if (g0 < 0.0) *t1 = -CONEMAP__NEVER;
        return 0;
    }
    t = -g0 / g1;
    if (g1 < 0.0) {
        if (t < *t1) *t1 = t;
        return 0;
    }
    if (t <= *t0) return 0;
    *t0 = t;
    return 1;
}

/* Narrows [t0, t1] to the part of a ray inside a cone between the frustum's cutting planes; 0 if nothing is left. The
   solid is convex, so it is one piece. face: 0 if t0 stayed or lies on the cone, 1 or 2 on the lower or upper plane.

   With f(t) = x^2 + z^2 - (r + k y)^2 = A t^2 + 2 B t + C [BJCW09 eq. 10], inside is f <= 0 and r + k y >= 0: between
   the roots for A > 0, and for A < 0, where the ray is steeper than the cone, beyond the root on the nappe that is
   there; the other nappe's root is left alone. A = 0 has one root. The origin is moved to where the ray is nearest to
   the axis, so that B^2 - A C does not cancel for rays from afar, and the roots are q / A and C / q, neither of which
   does. */
static int conemap__solid_span(const conemap_frustum *f, conemap__cone cone, const conemap__local_ray *ray,
                               double *t0, double *t1, int *face) {
    double vx = ray->v[0], vy = ray->v[1], vz = ray->v[2], across = vx * vx + vz * vz;
    double shift, x, y, z, rho, rho_v, a, b, c, begin, end, discriminant, q, first, second;
    *face = 0;
    if (conemap__half_space(ray->o[1] - (double)f->lower[0] * ray->o[0] - (double)f->lower[1] * ray->o[2] -
                                (double)f->lower[2],
                            vy - (double)f->lower[0] * vx - (double)f->lower[1] * vz, t0, t1))
        *face = 1;
    if (conemap__half_space((double)f->upper[0] * ray->o[0] + (double)f->upper[1] * ray->o[2] +
                                (double)f->upper[2] - ray->o[1],
                            (double)f->upper[0] * vx + (double)f->upper[1] * vz - vy, t0, t1))
        *face = 2;
    if (!(*t0 <= *t1)) return 0;
    shift = across > 0.0 ? -(ray->o[0] * vx + ray->o[2] * vz) / across : *t0;
    shift = shift < *t0 ? *t0 : shift > *t1 ? *t1 : shift;
    x = ray->o[0] + shift * vx;
    y = ray->o[1] + shift * vy;
    z = ray->o[2] + shift * vz;
    rho = cone.r + cone.k * y;
    rho_v = cone.k * vy;
    begin = *t0 - shift;
    end = *t1 - shift;
    if (conemap__half_space(rho, rho_v, &begin, &end)) *face = 0;
    a = across - rho_v * rho_v;
    b = x * vx + z * vz - rho * rho_v;
    c = x * x + z * z - rho * rho;
    discriminant = b * b - a * c;
    if (discriminant < 0.0) {
        if (a > 0.0) return 0; /* passes beside the cone */
        discriminant = 0.0;    /* steeper than the cone it meets both nappes: rounding */
    }
    q = b < 0.0 ? sqrt(discriminant) - b : -sqrt(discriminant) - b;
    if (a == 0.0) { /* parallel to the cone's surface: f is linear */
        if (b == 0.0) {
            if (c > 0.0) return 0;
            first = -CONEMAP__NEVER;
            second = CONEMAP__NEVER;
        } else {
            first = b < 0.0 ? -0.5 * c / b : -CONEMAP__NEVER;
            second = b < 0.0 ? CONEMAP__NEVER : -0.5 * c / b;
        }
    } else {
        first = q / a;
        second = q != 0.0 ? c / q : first;
        if (first > second) {
            double keep = first;
            first = second;
            second = keep;
        }
        if (a < 0.0) {
            if (rho_v > 0.0) {
                first = second;
                second = CONEMAP__NEVER;
            } else {
                second = first;
                first = -CONEMAP__NEVER;
            }
        }
    }
    if (first > begin) {
        begin = first;
        *face = 0;
    }
    if (second < end) end = second;
    if (!(begin <= end)) return 0;
    if (begin + shift > *t0) *t0 = begin + shift;
    if (end + shift < *t1) *t1 = end + shift;
    return *t0 <= *t1;
}

/* u, v and w of a point [BJCW09 eqs. 6, 7, 11, 12]: w from the radii at the point's y, then v on the cone of the
   shell that the point lies on. Where there is no shell, w is the distance from the surface along the radius and v
   that of the surface. */
static conemap__place_uvw conemap__uvw(const conemap_frustum *f, const double *p) {
    conemap__place_uvw at;
    double above;
    at.d = sqrt(p[0] * p[0] + p[2] * p[2]);
    at.sine = at.d > 0.0 ? p[0] / at.d : 0.0;
    at.cosine = at.d > 0.0 ? p[2] / at.d : 1.0;
    at.thickness = (double)f->t + (double)f->tk * p[1];
    above = at.d - ((double)f->r + (double)f->k * p[1]);
    at.w = at.thickness > 0.0 ? above / at.thickness : above;
    /* Outside the shell the nearest half shell's cone serves: w means nothing far out, or where the shell thins out. */
    at.own = conemap__cone_at(f, !(at.thickness > 0.0) ? 0.0 : at.w < -0.5 ? -0.5 : at.w > 1.5 ? 1.5 : at.w);
    at.lower = conemap__cut_y(f->lower, (double)f->lower[0] * at.sine + (double)f->lower[1] * at.cosine, at.own);
    at.upper = conemap__cut_y(f->upper, (double)f->upper[0] * at.sine + (double)f->upper[1] * at.cosine, at.own);
    at.v = at.upper != at.lower ? (p[1] - at.lower) / (at.upper - at.lower) : 0.0;
    at.u = conemap__turns(at.sine, at.cosine);
    return at;
}

/* The gradient of the cut's y along one plane: y = (c + s r) / (1 - k s) moves with the angle through s, and with w
   through r and k. */
static void conemap__cut_gradient(const conemap_frustum *f, const float *plane, const conemap__place_uvw *at,
                                  double y, const double *grad_angle, const double *grad_w, double *out) {
    double s = (double)plane[0] * at->sine + (double)plane[1] * at->cosine, rest = 1.0 - at->own.k * s;
    double by_angle = (at->own.r + at->own.k * (double)plane[2]) / (rest * rest) *
                      ((double)plane[0] * at->cosine - (double)plane[1] * at->sine);
    double by_w = at->thickness > 0.0 ? s * ((double)f->t + (double)f->tk * y) / rest : 0.0;
    int k;
    for (k = 0; k < 3; ++k) out[k] = by_angle * grad_angle[k] + by_w * grad_w[k];
}

/* Gradients of u, v and w at a point off the axis, in the frustum's frame. */
static void conemap__uvw_gradients(const conemap_frustum *f, const conemap__place_uvw *at, double grad_u[3],
                                   double grad_v[3], double grad_w[3]) {
    double lower[3], upper[3], d = at->d > 1e-300 ? at->d : 1e-300, span = at->upper - at->lower;
    double over = at->thickness > 0.0 ? at->thickness : 1.0;
    int k;
    grad_w[0] = at->sine / over;
    grad_w[1] = -at->own.k / over;
    grad_w[2] = at->cosine / over;
    grad_u[0] = at->cosine / d;
    grad_u[1] = 0.0;
    grad_u[2] = -at->sine / d;
    conemap__cut_gradient(f, f->lower, at, at->lower, grad_u, grad_w, lower);
    conemap__cut_gradient(f, f->upper, at, at->upper, grad_u, grad_w, upper);
    for (k = 0; k < 3; ++k) {
        grad_v[k] = ((k == 1 ? 1.0 : 0.0) - (1.0 - at->v) * lower[k] - at->v * upper[k]) / span;
        grad_u[k] *= 0.15915494309189535;
    }
}

/* The surface normal that goes on across joints [BJCW09 eq. 8]: at the two cuts away from the joints, in between
   mixed by v. plane[3] lets an end's normal lean back along the cutting plane's own normal, the same from both sides
   of a joint. */
static void conemap__smooth_normal(const conemap_frustum *f, const conemap__place_uvw *at, double *n) {
    double end[2][3], v = conemap__clamp01(at->v), m;
    int e, k;
    for (e = 0; e < 2; ++e) {
        const float *plane = e ? f->upper : f->lower;
        double y = e ? at->upper : at->lower, rho = at->own.r + at->own.k * y, length;
        double a = (double)plane[0], b = (double)plane[1], lean;
        y -= e ? (double)f->h : 0.0;
        end[e][0] = rho * at->sine;
        end[e][1] = y;
        end[e][2] = rho * at->cosine;
        length = sqrt(rho * rho + y * y);
        if (!(rho >
              1e-9 * ((double)f->r + (double)f->t + (double)f->h))) { /* the end is a point: the limit is radial */
            end[e][0] = at->sine;
            end[e][1] = 0.0;
            end[e][2] = at->cosine;
            length = 1.0;
        }
        lean = (double)plane[3] * length / sqrt(1.0 + a * a + b * b);
        end[e][0] += lean * a;
        end[e][1] -= lean;
        end[e][2] += lean * b;
        conemap__normalise3(end[e]);
    }
    m = f->flags & CONEMAP_FRUSTUM_C1 ? v * v * (3.0 - 2.0 * v) : v;
    for (k = 0; k < 3; ++k) n[k] = (1.0 - m) * end[0][k] + m * end[1][k];
    if (!conemap__normalise3(n)) {
        n[0] = at->sine;
        n[1] = 0.0;
        n[2] = at->cosine;
    }
}

/* The pyramid |x|, |z| <= rho(y) of [BJCW09 section 2.6] around the outer cone, cut by the two planes. y of corner
   `i`. */
static double conemap__corner_y(const float *plane, conemap__cone cone, int i) {
    double sx = i == 1 || i == 2 ? 1.0 : -1.0, sz = i >= 2 ? 1.0 : -1.0;
    return conemap__cut_y(plane, (double)plane[0] * sx + (double)plane[1] * sz, cone);
}

/* Why the eight corners hold the shell. Every cone of the shell lies in the outer one, r + k y + t + tk y (thickness
   is not negative between the cuts: conemap__settle), and that in the convex pyramid P of four planes |x|, |z| <=
   rho(y), rho(y) >= 0. The shell is cut by both planes, so it lies in P between them. Each plane meets all four edges
   of P (slope limits), so it cuts P in a quadrilateral with those corners. Every lower corner lies on or below the
   upper one of its edge (conemap__settle again), so the lower quadrilateral, the hull of its corners, lies on one
   side of the upper plane, and the other way around. A point of P between the planes lies on a straight line through
   P's apex (or along the edges, where it has none) that meets the one quadrilateral below it and the other above it:
   so it is in the hull of the eight. The sides are flat, hence twelve triangles bound that hull. Rounding to floats
   can take away about 2^-22 of the coordinates. */
static void conemap__corners_of(const conemap_frustum *f, double corners[8][3]) {
    conemap__cone outer = conemap__cone_at(f, 1.0);
    double axes[3][3];
    int i, k;
    conemap__axes(f, axes);
    for (i = 0; i < 8; ++i) {
        double y = conemap__corner_y(i < 4 ? f->lower : f->upper, outer, i & 3), rho = outer.r + outer.k * y;
        double x = (i & 3) == 1 || (i & 3) == 2 ? rho : -rho, z = (i & 3) >= 2 ? rho : -rho;
        if (rho < 0.0) x = z = 0.0;
        for (k = 0; k < 3; ++k)
            corners[i][k] = conemap__origin(f, k) + x * axes[0][k] + y * axes[1][k] + z * axes[2][k];
    }
}

CONEMAP__DEF conemap_result conemap_frustum_corners(const conemap_frustum *frustum, float corners[8][3]) {
    double exact[8][3];
    int i, k;
    if (!frustum || !corners) return CONEMAP_ERROR_NULL;
    conemap__corners_of(frustum, exact);
    for (i = 0; i < 8; ++i)
        for (k = 0; k < 3; ++k) corners[i][k] = (float)exact[i][k];
    return CONEMAP_OK;
}

CONEMAP__DEF const unsigned char *conemap_frustum_triangles(void) {
    static const unsigned char triangles[36] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1,
                                                1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0};
    return triangles;
}

CONEMAP__DEF conemap_result conemap_frustum_uvw(const conemap_frustum *frustum, const float point[3],
                                                float uvw[3]) {
    conemap__place_uvw at;
    double world[3], p[3];
    int k;
    if (!frustum || !point || !uvw) return CONEMAP_ERROR_NULL;
    for (k = 0; k < 3; ++k) {
        if (!conemap__finite(point[k])) return CONEMAP_ERROR_POSITION;
        world[k] = (double)point[k];
    }
    conemap__to_local(frustum, world, p);
    at = conemap__uvw(frustum, p);
    uvw[0] = (float)at.u;
    uvw[1] = (float)at.v;
    uvw[2] = (float)at.w;
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_frustum_point(const conemap_frustum *frustum, const float uvw[3],
                                                  float point[3]) {
    conemap__cone cone;
    double sine, cosine, low, high, y, rho, p[3], axes[3][3];
    int k;
    if (!frustum || !uvw || !point) return CONEMAP_ERROR_NULL;
    for (k = 0; k < 3; ++k)
        if (!conemap__finite(uvw[k])) return CONEMAP_ERROR_PARAMETER;
    conemap__turn((double)uvw[0], &sine, &cosine);
    cone = conemap__cone_at(frustum, (double)uvw[2]);
    low = conemap__cut_y(frustum->lower, (double)frustum->lower[0] * sine + (double)frustum->lower[1] * cosine,
                         cone);
    high = conemap__cut_y(frustum->upper, (double)frustum->upper[0] * sine + (double)frustum->upper[1] * cosine,
                          cone);
    y = low + (double)uvw[1] * (high - low);
    rho = cone.r + cone.k * y;
    if (!(rho >= 0.0)) {
        if (!(rho >= -1e-6 * ((double)frustum->r + (double)frustum->t + (double)frustum->h)))
            return CONEMAP_ERROR_PARAMETER;
        rho = 0.0; /* the point of a cone, by rounding */
    }
    p[0] = rho * sine;
    p[1] = y;
    p[2] = rho * cosine;
    conemap__axes(frustum, axes);
    for (k = 0; k < 3; ++k)
        point[k] =
            (float)(conemap__origin(frustum, k) + p[0] * axes[0][k] + p[1] * axes[1][k] + p[2] * axes[2][k]);
    return CONEMAP_OK;
}

/* A ray of the world with its direction scaled by a power of two to about 1, and its range in that time. */
typedef struct conemap__world_ray {
    double o[3], v[3], t0, t1, scale;
} conemap__world_ray;

static conemap__world_ray conemap__prepare_ray(const conemap_ray *ray) {
    conemap__world_ray out;
    double longest = 0.0, power;
    int k;
    for (k = 0; k < 3; ++k) {
        out.o[k] = (double)ray->origin[k];
        out.v[k] = (double)ray->direction[k];
        longest = conemap__maxd(longest, conemap__absd(out.v[k]));
    }
    power = conemap__normalising_power(longest);
    for (k = 0; k < 3; ++k) {
        out.v[k] *= power;
        if (conemap__absd(out.v[k]) < 1e-30) out.v[k] = 0.0;
    }
    out.scale = power;
    out.t0 = (double)ray->t_min / power;
    out.t1 = ray->t_max == 0.0f || !conemap__finite(ray->t_max) ? CONEMAP__NEVER : (double)ray->t_max / power;
    return out;
}

CONEMAP__DEF conemap_result conemap_frustum_span(const conemap_frustum *frustum, float height,
                                                 const conemap_ray *ray, float span[2]) {
    conemap_result result;
    conemap__world_ray world;
    conemap__local_ray local;
    int face;
    if (!frustum || !ray || !span) return CONEMAP_ERROR_NULL;
    if (!conemap__in_range(height, 0.0f, 1.0f)) return CONEMAP_ERROR_PARAMETER;
    result = conemap__check_ray(ray);
    if (result != CONEMAP_OK) return result;
    world = conemap__prepare_ray(ray);
    local = conemap__local(frustum, world.o, world.v);
    span[0] = 1.0f;
    span[1] = 0.0f;
    if (!conemap__solid_span(frustum, conemap__cone_at(frustum, (double)height), &local, &world.t0, &world.t1,
                             &face))
        return CONEMAP_OK;
    world.t0 *= world.scale;
    world.t1 *= world.scale;
    span[0] = (float)world.t0;
    span[1] = world.t1 < 3.0e38 ? (float)world.t1 : conemap__from_bits(0x7f800000u);
    return CONEMAP_OK;
}

/* ======================================================================================================
   F R U S T A

   Skinning a skeleton, the ray through the relief's shell, and a tree of boxes over the frusta.
   ====================================================================================================== */

#define CONEMAP__STEEPEST                                                                                         \
    2.75 /* of a cutting plane: tan(70 degrees), so bends up to 140 degrees are cut as they should */
#define CONEMAP__CONE_ROOM                                                                                        \
    0.63 /* slope times |k| of the cone stays below: the planes then meet all edges of the pyramid,
                                     sqrt(2) further out */
#define CONEMAP__FOLD 0.01      /* boundary lines closer to parallel than so many radians: see conemap__boundary */
#define CONEMAP__FARTHEST 1e12f /* a joint's coordinate */
#define CONEMAP__LEAF 2         /* frusta in a leaf */
#define CONEMAP__CHAIN 4        /* segments of a chain that are searched for branches nearby */

/* What a segment keeps beside its frustum. */
typedef struct conemap__bone {
    int base, top;
    float radius;               /* at the base; 0: the joint's */
    float sine, cosine;         /* of the angle at the top where the texture's u is 0, twist included */
    float rest_y[3], rest_z[3]; /* roots: the frame as built, which turns with the axis from there */
} conemap__bone;

/* A node of the tree of boxes, in depth-first order: an inner node's first child follows it. */
typedef struct conemap__branch {
    float low[3], high[3];
    int count; /* frusta of a leaf; 0: an inner node */
    int next;  /* a leaf's first place in `leaves`; an inner node's second child */
} conemap__branch;

/* A segment while it is being skinned. */
typedef struct conemap__limb {
    int segment;
    double base[3], x[3], y[3], z[3]; /* its frame in the world */
    double h, r, r_top, k, t, t_top;
    double lower[3], upper[3]; /* cutting planes: a, b, c */
    double lean_lower, lean_upper;
    int flags;
} conemap__limb;

/* ---- skinning --------------------------------------------------------------------------------------- */

/* Where the boundary line of a cone meets that of the next [BJCW09 eq. 4, figure 2], in the medial plane, as the
   distance along the first axis from the joint. Radii r, r2 and growths k, k2 of the two cones at the joint, away
   from it along the axes; c and s: cosine and sine of the bend; the other side is that of -s.

   The lines r p1 + y (M1 + k p1) and r2 p2 + y2 (M2 + k2 p2) meet at y = N / D. Where they are parallel D = 0 and the
   meeting is anywhere: on straight chains of an even taper, which the paper answers with another axis, but also in
   bends by as much as the taper changes, where the paper's cut shoots off. So y is taken from the bisecting plane,
   whose y never does, and N / D only adds what differs from that. It is bounded by `most` and folded back to 0 where
   the lines become parallel, without a jump. Elsewhere it is exactly the paper's. */
static double conemap__boundary(double r, double k, double r2, double k2, double c, double s) {
    double bisecting = -r * s / (1.0 + c + k * s);
    double d = s * (1.0 + k * k2) + c * (k2 - k), n = r * (c - s * k2) - r2 - bisecting * d;
    double most = 2.0 * r * (conemap__absd(k) + conemap__absd(k2)),
           size = conemap__maxd(conemap__absd(d), CONEMAP__FOLD);
    if (!(most > 0.0)) return bisecting;
    size = conemap__maxd(size, conemap__absd(n) / most);
    return bisecting + n * d / (size * size);
}

/* Half the minor axis, squared, of the ellipse in which a cone of radius r + k y is cut by the plane n1 y + np p =
   dot, p across the axis: at the centre, between the two boundary lines' meetings with the plane, what the radius
   leaves besides the way from the axis. 0 if it is no ellipse. */
static double conemap__minor_axis(double r, double k, double n1, double np, double dot) {
    double over_a = n1 + k * np, over_b = n1 - k * np, a, b, y, rho, off;
    if (!(over_a > 1e-9 && over_b > 1e-9)) return 0.0;
    a = (dot - r * np) / over_a;
    b = (dot + r * np) / over_b;
    y = 0.5 * (a + b);
    rho = r + k * y;
    off = 0.5 * k * (a - b); /* half of (r + k a) - (r + k b) */
    return rho * rho - off * off;
}

/* Cuts two limbs that meet in a joint by one plane [BJCW09 eqs. 3-5], and fits the second one's radius [section 2.2].
   */
static void conemap__join(const conemap_skeleton *skeleton, conemap__limb *first, conemap__limb *next) {
    double normal[3], p1[3], p2[3], c = conemap__dot3(first->y, next->y), s, n1, np, dot, across, along, m;
    int round, k;
    conemap__cross3(first->y, next->y, normal);
    s = sqrt(conemap__dot3(normal, normal));
    if (s > 1e-12) /* eq. 3 */
        for (k = 0; k < 3; ++k) normal[k] /= s;
    else { /* axes in one line: any plane through them will do */
        s = 0.0;
        memcpy(normal, first->x, sizeof normal);
    }
    conemap__cross3(normal, first->y, p1); /* in the medial plane, across each axis */
    conemap__cross3(normal, next->y, p2);
    for (round = 0;; ++round) {
        n1 = 1.0 + c; /* the bisecting plane through the joint */
        np = s;
        dot = 0.0;
        if (n1 + s <= 1e-9) np = 1.0; /* straight back */
        if (c > -0.77 && n1 + first->k * s > 0.1 * n1 && n1 - first->k * s > 0.1 * n1) {
            double ya = conemap__boundary(first->r_top, first->k, next->r, next->k, c, s);
            double yb = conemap__boundary(first->r_top, first->k, next->r, next->k, c, -s);
            double a = first->r_top + first->k * ya, b = first->r_top + first->k * yb;
            if (a + b > 1e-6 * first->r_top &&
                a + b > 0.0) { /* eq. 5: A = (ya, a) and B = (yb, -b) lie on the plane */
                n1 = a + b;
                np = yb - ya;
                dot = n1 * ya + np * a;
                if (round < skeleton->build.fit_steps) {
                    double minor = conemap__minor_axis(first->r_top, first->k, n1, np, dot);
                    double minor2 = conemap__minor_axis(next->r, next->k, c * n1 + s * np, c * np - s * n1, dot);
                    if (minor > 0.0 && minor2 > 0.0 && conemap__absd(minor - minor2) > 1e-12 * minor) {
                        double ratio =
                            sqrt(sqrt(minor / minor2)); /* half of the way: whole ones can swing to and fro */
                        next->r *= ratio < 0.5 ? 0.5 : ratio > 2.0 ? 2.0 : ratio;
                        next->k = (next->r_top - next->r) / next->h;
                        continue;
                    }
                }
            }
        }
        break;
    }
    /* the same plane from both sides: n1 along the first axis and np along p1, and what that is along the second and
       p2 */
    m = conemap__maxd(n1, 1e-9 * conemap__absd(np));
    first->upper[0] = -np / m * conemap__dot3(p1, first->x);
    first->upper[1] = -np / m * conemap__dot3(p1, first->z);
    first->upper[2] = first->h + dot / m;
    along = c * n1 + s * np;
    across = c * np - s * n1;
    m = conemap__maxd(along, 1e-9 * conemap__absd(across));
    next->lower[0] = across / m; /* along p2, until the frame of `next` is known */
    next->lower[1] = 0.0;
    next->lower[2] = dot / m;
    /* u = 0 at the upper cut of the first limb, seen from the joint, is where u = 0 of the next begins [section 2.3] */
    {
        const conemap__bone *bone = &skeleton->build.bones[first->segment];
        double q[3], sine = (double)bone->sine, cosine = (double)bone->cosine, y, rho, slope, turn, length2;
        slope = first->upper[0] * sine + first->upper[1] * cosine;
        slope = conemap__mind(slope, CONEMAP__STEEPEST);
        y = (first->upper[2] + slope * first->r) / conemap__maxd(1.0 - first->k * slope, 0.1);
        rho = first->r + first->k * y;
        for (k = 0; k < 3; ++k)
            q[k] = rho * (sine * first->x[k] + cosine * first->z[k]) + (y - first->h) * first->y[k];
        turn = conemap__dot3(q, next->y);
        for (k = 0; k < 3; ++k) q[k] -= turn * next->y[k];
        length2 = conemap__dot3(q, q);
        if (!(length2 > 1e-6 * rho * rho &&
              rho > 0.0)) { /* it lies on the next axis: turn with the least rotation */
            double z[3];
            for (k = 0; k < 3; ++k) z[k] = sine * first->x[k] + cosine * first->z[k];
            turn = conemap__dot3(z, next->y) / conemap__maxd(1.0 + c, 1e-9);
            for (k = 0; k < 3; ++k) q[k] = z[k] - turn * (first->y[k] + next->y[k]);
        }
        memcpy(next->z, q, sizeof q);
    }
    for (k = 0; k < 3; ++k) p1[k] = p2[k];
    m = conemap__dot3(next->z, next->y);
    for (k = 0; k < 3; ++k) next->z[k] -= m * next->y[k];
    if (!conemap__normalise3(next->z)) memcpy(next->z, normal, sizeof normal);
    conemap__cross3(next->y, next->z, next->x);
    m = next->lower[0];
    next->lower[0] = -m * conemap__dot3(p1, next->x);
    next->lower[1] = -m * conemap__dot3(p1, next->z);
}

/* z of a frame whose y turns from one direction to another by the least rotation; straight back, z stays. */
static void conemap__carry(const double *from_y, const double *from_z, conemap__limb *limb) {
    double turn = 1.0 + conemap__dot3(from_y, limb->y), m;
    int k;
    turn = turn > 1e-9 ? conemap__dot3(from_z, limb->y) / turn : 0.0;
    for (k = 0; k < 3; ++k) limb->z[k] = from_z[k] - turn * (from_y[k] + limb->y[k]);
    m = conemap__dot3(limb->z, limb->y);
    for (k = 0; k < 3; ++k) limb->z[k] -= m * limb->y[k];
    if (!conemap__normalise3(limb->z)) { /* cannot be, but for the rounding of packed rows */
        limb->z[0] = -limb->y[1];
        limb->z[1] = limb->y[0];
        limb->z[2] = 0.0;
        if (!conemap__normalise3(limb->z)) limb->z[0] = 1.0;
    }
    conemap__cross3(limb->y, limb->z, limb->x);
}

/* Scales the slopes of both planes. */
static void conemap__tilt(conemap_frustum *f, const conemap__limb *limb, double by) {
    int k;
    for (k = 0; k < 2; ++k) {
        f->lower[k] = (float)(by * limb->lower[k]);
        f->upper[k] = (float)(by * limb->upper[k]);
    }
}

/* Whether every corner of the bounding pyramid is on the cone's nappe and its lower corners lie below the upper ones,
   by a hundredth of the axis, so that v stays well-defined. */
static int conemap__apart(const conemap_frustum *f) {
    conemap__cone outer = conemap__cone_at(f, 1.0);
    double grain = -1e-5 * (outer.r + conemap__absd(outer.r + outer.k * (double)f->h));
    int i;
    for (i = 0; i < 4; ++i) {
        double low = conemap__corner_y(f->lower, outer, i), high = conemap__corner_y(f->upper, outer, i);
        if (low + 0.01 * (double)f->h > high || outer.r + outer.k * low < grain ||
            outer.r + outer.k * high < grain)
            return 0;
    }
    return 1;
}

/* Limits the slope of one plane and how far from its joint it meets the axis, so that upright planes are apart with
   some radius left at both; returns whether it had to. */
static int conemap__limit_plane(const conemap__limb *limb, double *plane, double joint, double radius,
                                double steepest) {
    double slope = sqrt(plane[0] * plane[0] + plane[1] * plane[1]), off = plane[2] - joint, most = 0.45 * limb->h;
    int limited = 0;
    if (most * conemap__absd(limb->k) > 0.5 * radius) most = 0.5 * radius / conemap__absd(limb->k);
    if (slope > steepest) {
        plane[0] *= steepest / slope;
        plane[1] *= steepest / slope;
        limited = 1;
    }
    if (off > most || off < -most) {
        plane[2] = joint + (off > 0.0 ? most : -most);
        limited = 1;
    }
    return limited;
}

/* Where a plane's lowest or highest corner on the inner pyramid lies. */
static double conemap__cone_reach(const float *plane, conemap__cone inner, int high) {
    double y = conemap__corner_y(plane, inner, 0), other;
    int i;
    for (i = 1; i < 4; ++i) {
        other = conemap__corner_y(plane, inner, i);
        y = high ? conemap__maxd(y, other) : conemap__mind(y, other);
    }
    return y;
}

/* Packs a limb whose planes are known, and clamps these so that the proof of the corners holds. Returns its flags. */
static int conemap__settle(conemap_skeleton *skeleton, conemap__limb *limb) {
    conemap_frustum *f = &skeleton->build.frusta[limb->segment];
    float *box = skeleton->build.boxes[limb->segment];
    double tk = (limb->t_top - limb->t) / limb->h, t = limb->t, steepest = CONEMAP__STEEPEST, k_most,
           corners[8][3];
    int k, i;
    for (k = 0; k < 3; ++k) {
        f->axis_x[k] = (float)limb->x[k];
        f->axis_y[k] = (float)limb->y[k];
        f->axis_z[k] = (float)limb->z[k];
    }
    f->axis_x[3] = (float)limb->base[0];
    f->axis_y[3] = (float)limb->base[1];
    f->axis_z[3] = (float)limb->base[2];
    f->r = (float)limb->r;
    f->k = (float)limb->k;
    f->h = (float)limb->h;
    k_most = conemap__maxd(conemap__absd(limb->k), conemap__absd(limb->k + tk));
    if (k_most * steepest > CONEMAP__CONE_ROOM) steepest = CONEMAP__CONE_ROOM / k_most;
    if (conemap__limit_plane(limb, limb->lower, 0.0, limb->r, steepest))
        limb->flags |= CONEMAP_FRUSTUM_CLAMPED_LOWER;
    if (conemap__limit_plane(limb, limb->upper, limb->h, limb->r_top, steepest))
        limb->flags |= CONEMAP_FRUSTUM_CLAMPED_UPPER;
    f->lower[2] = (float)limb->lower[2];
    f->upper[2] = (float)limb->upper[2];
    f->lower[3] = (float)limb->lean_lower;
    f->upper[3] = (float)limb->lean_upper;
    conemap__tilt(f, limb, 1.0);
    f->t = (float)t;
    f->tk = (float)tk;
    if (tk < 0.0 ||
        tk > 0.0) { /* past a joint of little shell the thickness would be negative: it ends at the cut instead */
        double y = conemap__cone_reach(tk < 0.0 ? f->upper : f->lower, conemap__cone_at(f, 0.0), tk < 0.0);
        if (t + tk * y < 0.0) {
            if (tk < 0.0)
                tk = -t / y;
            else {
                tk = limb->t_top / (limb->h - y);
                t = -tk * y;
            }
            f->t = (float)t;
            f->tk = (float)tk;
        }
    }
    if (!conemap__apart(f)) { /* halve towards the tilt at which the planes just stay apart; upright they do */
        double good = 0.0, bad = 1.0;
        for (i = 0; i < 10; ++i) {
            double middle = 0.5 * (good + bad);
            conemap__tilt(f, limb, middle);
            if (conemap__apart(f))
                good = middle;
            else
                bad = middle;
        }
        conemap__tilt(f, limb, good);
        limb->flags |= CONEMAP_FRUSTUM_CLAMPED_LOWER | CONEMAP_FRUSTUM_CLAMPED_UPPER;
    }
    f->flags = limb->flags;
    conemap__corners_of(f, corners);
    for (k = 0; k < 3; ++k) {
        double low = corners[0][k], high = low, grain;
        for (i = 1; i < 8; ++i) {
            low = conemap__mind(low, corners[i][k]);
            high = conemap__maxd(high, corners[i][k]);
        }
        grain = 1e-6 * (conemap__absd(low) + conemap__absd(high) + limb->h);
        box[k] = (float)(low - grain);
        box[3 + k] = (float)(high + grain);
    }
    return limb->flags;
}

/* A limb's axis, radii and upright planes from the joints. */
static void conemap__set_limb(const conemap_skeleton *skeleton, const conemap_joint *joints, int segment,
                              conemap__limb *limb) {
    const conemap__bone *bone = &skeleton->build.bones[segment];
    const conemap_frustum *f = &skeleton->build.frusta[segment];
    const conemap_joint *base = &joints[bone->base], *top = &joints[bone->top];
    int k;
    memset(limb, 0, sizeof *limb);
    limb->segment = segment;
    for (k = 0; k < 3; ++k) {
        limb->base[k] = (double)base->position[k];
        limb->y[k] = (double)top->position[k] - (double)base->position[k];
    }
    limb->h = sqrt(conemap__dot3(limb->y, limb->y));
    for (k = 0; k < 3; ++k) limb->y[k] /= limb->h;
    limb->r = bone->radius > 0.0f ? (double)bone->radius : (double)base->radius;
    limb->r_top = (double)top->radius;
    limb->t = (double)base->thickness;
    if (bone->radius > 0.0f && base->radius > 0.0f) limb->t *= (double)bone->radius / (double)base->radius;
    limb->t_top = (double)top->thickness;
    limb->k = (limb->r_top - limb->r) / limb->h;
    limb->upper[2] = limb->h;
    limb->flags = (f->parent < 0 ? CONEMAP_FRUSTUM_ROOT : 0) | (f->child < 0 ? CONEMAP_FRUSTUM_TIP : 0) |
                  (f->flags & CONEMAP_FRUSTUM_C1);
    if (skeleton->build.slope_normals) limb->lean_lower = limb->lean_upper = limb->k;
}

/* Whether every segment can be skinned with these joints. */
static conemap_result conemap__check_joints(const conemap_skeleton *skeleton, const conemap_joint *joints) {
    int i, k;
    for (i = 0; i < skeleton->build.joint_count; ++i) {
        const conemap_joint *joint = &joints[i];
        for (k = 0; k < 3; ++k) {
            if (!conemap__finite(joint->position[k])) return CONEMAP_ERROR_JOINT;
            if (!conemap__in_range(joint->position[k], -CONEMAP__FARTHEST, CONEMAP__FARTHEST))
                return CONEMAP_ERROR_PARAMETER;
        }
        if (!conemap__finite(joint->radius) || !conemap__finite(joint->thickness)) return CONEMAP_ERROR_JOINT;
        if (joint->radius < 0.0f || joint->thickness < 0.0f) return CONEMAP_ERROR_RADIUS;
        if (joint->radius > CONEMAP__FARTHEST || joint->thickness > CONEMAP__FARTHEST)
            return CONEMAP_ERROR_PARAMETER;
    }
    for (i = 0; i < skeleton->count; ++i) {
        const conemap__bone *bone = &skeleton->build.bones[i];
        const conemap_joint *base = &joints[bone->base], *top = &joints[bone->top];
        double d[3], p[3], widest, reach;
        for (k = 0; k < 3; ++k) {
            p[k] = (double)top->position[k];
            d[k] = p[k] - (double)base->position[k];
        }
        widest = conemap__maxd(conemap__maxd((double)base->radius, (double)bone->radius) + (double)base->thickness,
                               (double)top->radius + (double)top->thickness);
        if (!(widest > 0.0)) return CONEMAP_ERROR_RADIUS;
        reach = conemap__maxd(widest, sqrt(conemap__dot3(p, p)));
        if (!(conemap__dot3(d, d) >= 1e-12 * reach * reach)) return CONEMAP_ERROR_LENGTH;
    }
    return CONEMAP_OK;
}

/* Fits the tree's boxes: children come after their parents, so from the last node to the first. */
static void conemap__refit(conemap_skeleton *skeleton) {
    int i, j, k;
    for (i = skeleton->build.nodes - 1; i >= 0; --i) {
        conemap__branch *node = &skeleton->build.tree[i];
        int count = node->count ? node->count : 2;
        for (j = 0; j < count; ++j) {
            const conemap__branch *child = j ? &skeleton->build.tree[node->next] : node + 1;
            const float *box = node->count ? skeleton->build.boxes[skeleton->build.leaves[node->next + j]] : NULL;
            for (k = 0; k < 3; ++k) {
                float low = box ? box[k] : child->low[k], high = box ? box[3 + k] : child->high[k];
                node->low[k] = j ? conemap__min(node->low[k], low) : low;
                node->high[k] = j ? conemap__max(node->high[k], high) : high;
            }
        }
    }
    for (k = 0; k < 3; ++k) {
        skeleton->low[k] = skeleton->build.tree[0].low[k];
        skeleton->high[k] = skeleton->build.tree[0].high[k];
    }
}

/* Skins every segment: chain by chain, so that a limb is settled as soon as the one that continues it has cut it. */
static void conemap__skin(conemap_skeleton *skeleton, const conemap_joint *joints) {
    conemap__limb limbs[2];
    const conemap_frustum *frusta = skeleton->build.frusta;
    int i, k, open = 0, clamped = 0; /* limbs[open & 1] waits for the one that continues it */
    for (i = 0; i < skeleton->count; ++i) {
        int segment = skeleton->build.order[i], parent = frusta[segment].parent;
        conemap__limb *limb = &limbs[i & 1], *before = &limbs[1 - (i & 1)];
        double y[3], z[3];
        conemap__set_limb(skeleton, joints, segment, limb);
        if (parent >= 0 && frusta[parent].child == segment) {
            conemap__join(skeleton, before, limb);
            if (skeleton->build.slope_normals) limb->lean_lower = before->lean_upper = 0.5 * (before->k + limb->k);
        } else if (parent >=
                   0) { /* a branch: the parent's frame, turned to where its u = 0 ends, is carried over */
            const conemap_frustum *f = &frusta[parent];
            const conemap__bone *bone = &skeleton->build.bones[parent];
            for (k = 0; k < 3; ++k) {
                y[k] = (double)f->axis_y[k];
                z[k] = (double)bone->sine * (double)f->axis_x[k] + (double)bone->cosine * (double)f->axis_z[k];
            }
            conemap__carry(y, z, limb);
            limb->flags |= CONEMAP_FRUSTUM_BRANCH;
        } else {
            const conemap__bone *bone = &skeleton->build.bones[segment];
            for (k = 0; k < 3; ++k) {
                y[k] = (double)bone->rest_y[k];
                z[k] = (double)bone->rest_z[k];
            }
            conemap__carry(y, z, limb);
        }
        if (open)
            clamped += (conemap__settle(skeleton, before) &
                        (CONEMAP_FRUSTUM_CLAMPED_LOWER | CONEMAP_FRUSTUM_CLAMPED_UPPER)) != 0;
        open = 1;
    }
    clamped += (conemap__settle(skeleton, &limbs[(skeleton->count - 1) & 1]) &
                (CONEMAP_FRUSTUM_CLAMPED_LOWER | CONEMAP_FRUSTUM_CLAMPED_UPPER)) != 0;
    skeleton->clamped = clamped;
}

/* ---- building --------------------------------------------------------------------------------------- */

static conemap_result conemap__skeleton_size(const conemap_skeleton_desc *desc, size_t *memory_size) {
    size_t count, size = 0;
    *memory_size = 0;
    if (desc->joint_count < 1 || desc->joint_count > (1 << 28) || desc->segment_count < 1 ||
        desc->segment_count > (1 << 28))
        return CONEMAP_ERROR_SIZE;
    count = (size_t)desc->segment_count;
    if (!conemap__add_size(&size, count, sizeof(conemap_frustum)) ||
        !conemap__add_size(&size, count, sizeof(conemap__bone)) ||
        !conemap__add_size(&size, 2 * count, sizeof(conemap__branch)) ||
        !conemap__add_size(&size, count, sizeof(int)) || !conemap__add_size(&size, count, sizeof(int)) ||
        !conemap__add_size(&size, count, 6 * sizeof(float)))
        return CONEMAP_ERROR_OVERFLOW;
    *memory_size = size;
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_skeleton_memory(const conemap_skeleton_desc *desc, size_t *memory_size) {
    if (!desc || !memory_size) return CONEMAP_ERROR_NULL;
    return conemap__skeleton_size(desc, memory_size);
}

/* Copies the segments into frusta and bones; children hang in their parent's list of branches. */
static conemap_result conemap__read_segments(const conemap_skeleton_desc *desc, conemap_skeleton *skeleton) {
    conemap_frustum *frusta = skeleton->build.frusta;
    int i;
    for (i = 0; i < skeleton->count; ++i) frusta[i].child = frusta[i].branch = frusta[i].sibling = -1;
    for (i = skeleton->count - 1; i >= 0; --i) { /* backwards, so that lists come out in order */
        const conemap_segment *s = &desc->segments[i];
        conemap__bone *bone = &skeleton->build.bones[i];
        double sine, cosine;
        if (s->base < 0 || s->base >= desc->joint_count || s->top < 0 || s->top >= desc->joint_count)
            return CONEMAP_ERROR_JOINT;
        if (s->u_repeat < 0 || s->u_repeat > 4096 || !conemap__in_range(s->twist, -1024.0f, 1024.0f) ||
            !conemap__in_range(s->v_size, -1e6f, 1e6f))
            return CONEMAP_ERROR_PARAMETER;
        if (!conemap__finite(s->radius) || s->radius < 0.0f) return CONEMAP_ERROR_RADIUS;
        if (s->radius > CONEMAP__FARTHEST) return CONEMAP_ERROR_PARAMETER;
        if (s->parent >= skeleton->count || (s->parent >= 0 && desc->segments[s->parent].top != s->base))
            return CONEMAP_ERROR_PARENT;
        bone->base = s->base;
        bone->top = s->top;
        bone->radius = s->radius;
        conemap__turn(-(double)s->twist, &sine, &cosine);
        bone->sine = (float)sine;
        bone->cosine = (float)cosine;
        frusta[i].parent = s->parent < 0 ? -1 : s->parent;
        frusta[i].twist = s->twist;
        frusta[i].u_repeat = s->u_repeat ? s->u_repeat : 1;
        frusta[i].user = s->user;
        frusta[i].v_size = s->v_size;
        frusta[i].flags = desc->c1_normals ? CONEMAP_FRUSTUM_C1 : 0;
        if (s->parent >= 0) {
            frusta[i].sibling = frusta[s->parent].branch;
            frusta[s->parent].branch = i;
        }
    }
    return CONEMAP_OK;
}

/* Of each segment's children one continues it; then the order of the work, chain by chain. A segment that no root leads
   to is part of a cycle. */
static conemap_result conemap__order_segments(conemap_skeleton *skeleton, const conemap_joint *joints) {
    conemap_frustum *frusta = skeleton->build.frusta;
    int *stack = skeleton->build.leaves, depth = 0, done = 0, i, at;
    for (i = 0; i < skeleton->count; ++i) {
        double thickest = -1.0, straightest = 0.0;
        int best = -1, *link;
        conemap__limb limb, other;
        if (frusta[i].branch < 0) continue;
        conemap__set_limb(skeleton, joints, i, &limb);
        for (at = frusta[i].branch; at >= 0; at = frusta[at].sibling) {
            double straight;
            conemap__set_limb(skeleton, joints, at, &other);
            straight = conemap__dot3(limb.y, other.y);
            if (other.r > thickest || (!(other.r < thickest) && straight > straightest)) {
                best = at;
                thickest = other.r;
                straightest = straight;
            }
        }
        for (link = &frusta[i].branch; *link != best; link = &frusta[*link].sibling) {
        }
        *link = frusta[best].sibling;
        frusta[best].sibling = -1;
        frusta[i].child = best;
    }
    for (i = 0; i < skeleton->count; ++i) {
        if (frusta[i].parent >= 0) continue;
        stack[depth++] = i;
        while (depth > 0) {
            for (at = stack[--depth]; at >= 0; at = frusta[at].child) {
                int branch;
                skeleton->build.order[done++] = at;
                for (branch = frusta[at].branch; branch >= 0; branch = frusta[branch].sibling)
                    stack[depth++] = branch;
            }
        }
    }
    return done == skeleton->count ? CONEMAP_OK : CONEMAP_ERROR_CYCLE;
}

/* What stays as it was built: the map's v along the chains, and the roots' frames. */
static conemap_result conemap__rest(const conemap_skeleton_desc *desc, conemap_skeleton *skeleton) {
    conemap_frustum *frusta = skeleton->build.frusta;
    int i, k;
    for (i = 0; i < skeleton->count; ++i) {
        int segment = skeleton->build.order[i], parent = frusta[segment].parent, least = 0;
        conemap__bone *bone = &skeleton->build.bones[segment];
        conemap__limb limb;
        conemap__set_limb(skeleton, desc->joints, segment, &limb);
        if (conemap__bits(frusta[segment].v_size) << 1 == 0)
            frusta[segment].v_size =
                desc->v_per_length > 0.0f ? (float)(limb.h * (double)desc->v_per_length) : 1.0f;
        if (parent >= 0 && desc->v_per_length > 0.0f)
            frusta[segment].v_start = frusta[parent].v_start + frusta[parent].v_size;
        if (!conemap__in_range(frusta[segment].v_start, -1e9f, 1e9f) ||
            !conemap__in_range(frusta[segment].v_size, -1e9f, 1e9f))
            return CONEMAP_ERROR_PARAMETER;
        if (parent >= 0) continue;
        for (k = 1; k < 3; ++k)
            if (conemap__absd(limb.y[k]) < conemap__absd(limb.y[least])) least = k;
        limb.x[least] = 1.0; /* z across the axis and the world axis that it leans to least */
        conemap__cross3(limb.x, limb.y, limb.z);
        conemap__normalise3(limb.z);
        for (k = 0; k < 3; ++k) {
            bone->rest_y[k] = (float)limb.y[k];
            bone->rest_z[k] = (float)limb.z[k];
        }
    }
    return CONEMAP_OK;
}

CONEMAP__INLINE float conemap__box_middle(const conemap_skeleton *skeleton, int segment, int axis) {
    const float *box = skeleton->build.boxes[segment];
    return 0.5f * box[axis] + 0.5f * box[3 + axis];
}

/* Moves the half of leaves[first .. last] with the lower middles along an axis to the front (quickselect). */
static void conemap__halve_leaves(conemap_skeleton *skeleton, int first, int last, int axis) {
    int *leaves = skeleton->build.leaves, middle = first + (last - first + 1) / 2;
    while (first < last) {
        float pivot = conemap__box_middle(skeleton, leaves[first + (last - first) / 2], axis);
        int i = first, j = last;
        while (i <= j) {
            while (conemap__box_middle(skeleton, leaves[i], axis) < pivot) ++i;
            while (conemap__box_middle(skeleton, leaves[j], axis) > pivot) --j;
            if (i <= j) {
                int keep = leaves[i];
                leaves[i++] = leaves[j];
                leaves[j--] = keep;
            }
        }
        if (middle <= j)
            last = j;
        else if (middle >= i)
            first = i;
        else
            return;
    }
}

/* The tree over the boxes as built: halves by count, so it is as deep as log2(count); later only refitted. */
static void conemap__plant(conemap_skeleton *skeleton) {
    struct {
        int first, count, parent;
    } stack[40];
    int depth = 0, i, k;
    for (i = 0; i < skeleton->count; ++i) skeleton->build.leaves[i] = i;
    skeleton->build.nodes = 0;
    stack[depth].first = 0;
    stack[depth].count = skeleton->count;
    stack[depth++].parent = -1;
    while (depth > 0) {
        int first = stack[--depth].first, count = stack[depth].count, axis = 0;
        int at = skeleton->build.nodes++;
        conemap__branch *node = &skeleton->build.tree[at];
        if (stack[depth].parent >= 0) skeleton->build.tree[stack[depth].parent].next = at;
        node->count = count <= CONEMAP__LEAF ? count : 0;
        node->next = first;
        if (node->count) continue;
        for (k = 0; k < 3; ++k) {
            node->low[k] = CONEMAP__FAR;
            node->high[k] = -CONEMAP__FAR;
            for (i = first; i < first + count; ++i) {
                float middle = conemap__box_middle(skeleton, skeleton->build.leaves[i], k);
                node->low[k] = conemap__min(node->low[k], middle);
                node->high[k] = conemap__max(node->high[k], middle);
            }
            if (node->high[k] - node->low[k] > node->high[axis] - node->low[axis]) axis = k;
        }
        conemap__halve_leaves(skeleton, first, first + count - 1, axis);
        stack[depth].first =
            first + count / 2; /* the second child: pushed first, so that the first one follows its parent */
        stack[depth].count = count - count / 2;
        stack[depth++].parent = at;
        stack[depth].first = first;
        stack[depth].count = count / 2;
        stack[depth++].parent = -1;
    }
}

static conemap_result conemap__build_skeleton(const conemap_skeleton_desc *desc, conemap_skeleton *skeleton) {
    unsigned char *cursor;
    size_t count, size;
    conemap_result result;
    if (!desc->joints || !desc->segments) return CONEMAP_ERROR_NULL;
    if ((desc->allocator.allocate == NULL) != (desc->allocator.release == NULL)) return CONEMAP_ERROR_NULL;
    result = conemap__skeleton_size(desc, &size);
    if (result != CONEMAP_OK) return result;
    if (desc->fit_steps < 0 || desc->fit_steps > 64 || !conemap__in_range(desc->v_per_length, 0.0f, 1e9f) ||
        !conemap__in_range(desc->blend, 0.0f, 16.0f))
        return CONEMAP_ERROR_PARAMETER;
    skeleton->build.allocator = desc->allocator;
    result = conemap__take(&skeleton->build.allocator, desc->memory, desc->memory_size, size,
                           &skeleton->build.memory, &skeleton->build.owns_memory);
    if (result != CONEMAP_OK) return result;
    memset(skeleton->build.memory, 0, size);
    count = (size_t)desc->segment_count;
    cursor = (unsigned char *)skeleton->build.memory;
    skeleton->build.frusta = (conemap_frustum *)conemap__cut(&cursor, count, sizeof(conemap_frustum));
    skeleton->build.bones = (conemap__bone *)conemap__cut(&cursor, count, sizeof(conemap__bone));
    skeleton->build.tree = (conemap__branch *)conemap__cut(&cursor, 2 * count, sizeof(conemap__branch));
    skeleton->build.order = (int *)conemap__cut(&cursor, count, sizeof(int));
    skeleton->build.leaves = (int *)conemap__cut(&cursor, count, sizeof(int));
    skeleton->build.boxes = (float(*)[6])conemap__cut(&cursor, count, 6 * sizeof(float));
    skeleton->frusta = skeleton->build.frusta;
    skeleton->count = desc->segment_count;
    skeleton->memory_size = size;
    skeleton->build.joint_count = desc->joint_count;
    skeleton->build.fit_steps = desc->fit_steps;
    skeleton->build.slope_normals = desc->slope_normals;
    skeleton->build.blend = desc->blend;
    result = conemap__read_segments(desc, skeleton);
    if (result == CONEMAP_OK) result = conemap__check_joints(skeleton, desc->joints);
    if (result == CONEMAP_OK) result = conemap__order_segments(skeleton, desc->joints);
    if (result == CONEMAP_OK) result = conemap__rest(desc, skeleton);
    if (result != CONEMAP_OK) return result;
    conemap__skin(skeleton, desc->joints);
    conemap__plant(skeleton);
    conemap__refit(skeleton);
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_skeleton_build(const conemap_skeleton_desc *desc, conemap_skeleton *skeleton) {
    conemap_result result;
    if (!skeleton) return CONEMAP_ERROR_NULL;
    memset(skeleton, 0, sizeof *skeleton);
    if (!desc) return CONEMAP_ERROR_NULL;
    result = conemap__build_skeleton(desc, skeleton);
    if (result != CONEMAP_OK) conemap_skeleton_free(skeleton);
    return result;
}

CONEMAP__DEF conemap_result conemap_skeleton_update(conemap_skeleton *skeleton, const conemap_joint *joints) {
    conemap_result result;
    if (!skeleton || !skeleton->frusta || !joints) return CONEMAP_ERROR_NULL;
    result = conemap__check_joints(skeleton, joints);
    if (result != CONEMAP_OK) return result;
    conemap__skin(skeleton, joints);
    conemap__refit(skeleton);
    return CONEMAP_OK;
}

CONEMAP__DEF void conemap_skeleton_free(conemap_skeleton *skeleton) {
    if (!skeleton) return;
    conemap__release(&skeleton->build.allocator, skeleton->build.memory, skeleton->build.owns_memory);
    memset(skeleton, 0, sizeof *skeleton);
}

/* ---- relief in the shell ---------------------------------------------------------------------------- */

/* A ray between the outer and the inner frustum. */
typedef struct conemap__shell {
    const conemap_frustum *f;
    const conemap_map *map;
    conemap__local_ray ray;
    int linear; /* v goes straight from v_a at t_a to v_b at t_b */
    double t_a, t_b, v_a, v_b;
    /* what bounds the parametrisation's speed along the ray: see conemap__shell_bounds */
    double across, turning, nearest; /* |(x, z)'|^2, x' z - x z', and when d is least */
    double angle_moves_cut, fixed_speed, span;
} conemap__shell;

/* The map's bilinear cell at a place of the frustum, and where in it. */
static conemap__quad conemap__relief_quad(const conemap_map *map, const conemap_frustum *f, double u, double v,
                                          double *x, double *y) {
    int i, j;
    v = conemap__clamp01(v);
    i = conemap__enter_axis((u + v * (double)f->twist) * (double)f->u_repeat, map->info.width, map->info.wrap_u,
                            x);
    j = conemap__enter_axis((double)f->v_start + v * (double)f->v_size, map->info.height, map->info.wrap_v, y);
    return conemap__cell_quad(map, i, j);
}

static conemap__mix conemap__relief(const conemap_map *map, const conemap_frustum *f, double u, double v) {
    double x, y;
    conemap__quad quad = conemap__relief_quad(map, f, u, v, &x, &y);
    return conemap__sample_sectors(map, quad, (float)x, (float)y);
}

CONEMAP__INLINE void conemap__along(const conemap__local_ray *ray, double t, double *p) {
    p[0] = ray->o[0] + t * ray->v[0];
    p[1] = ray->o[1] + t * ray->v[1];
    p[2] = ray->o[2] + t * ray->v[2];
}

/* u, v, w of the ray at t: exactly, or v interpolated as [BJCW09 section 3] proposes. (Its linear ri and ro are
   exact, as y is linear along a ray.) */
static conemap__place_uvw conemap__shell_at(const conemap__shell *shell, double t) {
    conemap__place_uvw at;
    const conemap_frustum *f = shell->f;
    double p[3];
    conemap__along(&shell->ray, t, p);
    if (!shell->linear) return conemap__uvw(f, p);
    memset(&at, 0, sizeof at);
    at.d = sqrt(p[0] * p[0] + p[2] * p[2]);
    at.thickness = (double)f->t + (double)f->tk * p[1];
    at.w = at.d - ((double)f->r + (double)f->k * p[1]);
    if (at.thickness > 0.0) at.w /= at.thickness;
    at.u = conemap__turns(p[0], p[2]);
    at.v = shell->v_a + (shell->v_b - shell->v_a) * ((t - shell->t_a) / (shell->t_b - shell->t_a));
    return at;
}

/* How far the ray is above the relief, in heights. */
static double conemap__above_relief(const conemap__shell *shell, double t) {
    conemap__place_uvw at = conemap__shell_at(shell, t);
    return at.w - (double)conemap__relief(shell->map, shell->f, at.u, at.v).height;
}

/* One piece for every 45 degrees between the cutting planes: the paper subdivides the segment, here its rays are. */
static int conemap__pieces(const conemap_frustum *f) {
    double al = (double)f->lower[0], bl = (double)f->lower[1], au = (double)f->upper[0], bu = (double)f->upper[1];
    double c = (1.0 + al * au + bl * bu) / sqrt((1.0 + al * al + bl * bl) * (1.0 + au * au + bu * bu));
    return c >= 0.7071 ? 1 : c >= 0.0 ? 2 : c >= -0.7071 ? 3 : 4;
}

/* Equal steps, then halvings [BJCW09 section 3]. The relief is met at t1 if `solid`. -1: not met. */
static double conemap__march_steps(conemap__shell *shell, const conemap_skeleton_trace_desc *desc, double t0,
                                   double t1, int solid, int *steps) {
    double before = t0, t = t0;
    int pieces = desc->linear_v && t1 > t0 ? conemap__pieces(shell->f) : 0, piece = 0, k, n;
    for (k = 0; k <= desc->steps; ++k) {
        t = k < desc->steps ? t0 + (t1 - t0) * ((double)k / (double)desc->steps) : t1;
        while (piece < pieces && (piece == 0 || t > shell->t_b)) {
            shell->linear = 0;
            shell->t_a = t0 + (t1 - t0) * ((double)piece / (double)pieces);
            ++piece;
            shell->t_b = piece < pieces ? t0 + (t1 - t0) * ((double)piece / (double)pieces) : t1;
            shell->v_a = conemap__shell_at(shell, shell->t_a).v;
            shell->v_b = conemap__shell_at(shell, shell->t_b).v;
            shell->linear = shell->t_b > shell->t_a;
        }
        ++*steps;
        if ((solid && k == desc->steps) || conemap__above_relief(shell, t) <= 0.0) {
            if (k == 0) return t;
            for (n = 0; n < desc->refine_steps; ++n) {
                double middle = 0.5 * (before + t);
                if (conemap__above_relief(shell, middle) > 0.0)
                    before = middle;
                else
                    t = middle;
            }
            return t;
        }
        before = t;
    }
    return -1.0;
}

/* What bounds how fast the map's coordinates change along a ray of the shell, for cone steps.

   The angle's speed is |x' z - x z'| / d^2, whose numerator is constant. A cut y = (c + s r) / (1 - k s) moves with
   the angle at |r + k c| / (1 - k s)^2 times |ds/dangle| <= the plane's slope n, and with w at n thickness / (1 - k
   n); w itself moves at no more than (|(x, z)'| + (|k| + |tk|) |y'|) / thickness. v = (y - lower) / (upper - lower)
   then moves at no more than (|y'| + the faster cut) / the least upper - lower, and that span is (c_u - c_l + d_l
   (s_u - s_l)) / (1 - k s_u) for d_l, the distance from the axis at the lower cut. */
static void conemap__shell_bounds(conemap__shell *shell) {
    const conemap_frustum *f = shell->f;
    conemap__cone inner = conemap__cone_at(f, 0.0), outer = conemap__cone_at(f, 1.0);
    double n_lower = sqrt((double)f->lower[0] * (double)f->lower[0] + (double)f->lower[1] * (double)f->lower[1]);
    double n_upper = sqrt((double)f->upper[0] * (double)f->upper[0] + (double)f->upper[1] * (double)f->upper[1]);
    double da = (double)f->upper[0] - (double)f->lower[0], db = (double)f->upper[1] - (double)f->lower[1];
    double k = conemap__maxd(conemap__absd(inner.k), conemap__absd(outer.k)), n = conemap__maxd(n_lower, n_upper);
    double rest = 1.0 - k * n, widest = conemap__maxd(inner.r, outer.r), vy = conemap__absd(shell->ray.v[1]),
           reach, speed;
    double c = conemap__maxd(conemap__absd((double)f->lower[2]), conemap__absd((double)f->upper[2]));
    double thickest = (double)f->t, thinnest = (double)f->t;
    shell->across = shell->ray.v[0] * shell->ray.v[0] + shell->ray.v[2] * shell->ray.v[2];
    shell->turning = conemap__absd(shell->ray.v[0] * shell->ray.o[2] - shell->ray.o[0] * shell->ray.v[2]);
    shell->nearest = shell->across > 0.0
                         ? -(shell->ray.o[0] * shell->ray.v[0] + shell->ray.o[2] * shell->ray.v[2]) / shell->across
                         : 0.0;
    shell->angle_moves_cut = n > 0.0 ? n * (widest + k * c) / (rest * rest) : 0.0;
    reach = conemap__maxd(outer.r + outer.k * (double)f->lower[2], inner.r + inner.k * (double)f->lower[2]);
    reach /= 1.0 - k * n_lower; /* d_l at most */
    shell->span =
        ((double)f->upper[2] - (double)f->lower[2] - reach * sqrt(da * da + db * db)) / (1.0 + k * n_upper);
    if (f->tk < 0.0f || f->tk > 0.0f) {
        double low = (double)f->t + (double)f->tk * conemap__cone_reach(f->lower, outer, 0);
        double high = (double)f->t + (double)f->tk * conemap__cone_reach(f->upper, outer, 1);
        thickest = conemap__maxd(low, high);
        thinnest = conemap__mind(low, high);
    }
    if (n > 0.0 && !(thinnest > 0.0)) shell->span = 0.0; /* w has no bound */
    speed = sqrt(shell->across) + (k + conemap__absd((double)f->tk)) * vy;
    shell->fixed_speed = vy + (n > 0.0 && thinnest > 0.0 ? n * thickest / rest * (speed / thinnest) : 0.0);
}

/* Bounds |d(map_u, map_v)/dt| in the map's metric from t to t1; NEVER if there is no bound. */
static double conemap__map_speed(const conemap__shell *shell, double t, double t1) {
    const conemap_frustum *f = shell->f;
    double p[3], d2, at, u, v, turning;
    at = shell->nearest < t ? t : shell->nearest > t1 ? t1 : shell->nearest;
    conemap__along(&shell->ray, at, p);
    d2 = p[0] * p[0] + p[2] * p[2];
    if (!(shell->span > 0.0) || !(d2 > 0.0)) return CONEMAP__NEVER;
    turning = shell->turning / d2;
    v = (shell->fixed_speed + shell->angle_moves_cut * turning) / shell->span;
    u = (turning * 0.15915494309189535 + v * conemap__absd((double)f->twist)) * (double)f->u_repeat;
    v *= conemap__absd((double)f->v_size) * (double)shell->map->info.aspect;
    return sqrt(u * u + v * v);
}

/* Cone steps. At t the ray is g = d - ri - T (h + 2^-20) above the cone's apex, in the world's units, with T the
   shell's thickness: d is convex along a ray and the rest linear, so g(t + dt) >= g + g' dt. The cone over the map
   bounds the relief by h + 2^-20 + |map way| / tan, and the way by speed dt. So nothing is met while g + g' dt > T
   speed dt / tan, with the largest T to come: dt = tan g / (T speed - tan g'). No step is shorter than one of the
   equal steps, so the march ends. */
static double conemap__march_cones(conemap__shell *shell, const conemap_skeleton_trace_desc *desc, double t0,
                                   double t1, int solid, int *steps) {
    const conemap_frustum *f = shell->f;
    double before = t0, t = t0, least = (t1 - t0) / (double)desc->steps, over_end;
    int n, taken = 0;
    conemap__shell_bounds(shell);
    over_end = (double)f->t + (double)f->tk * (shell->ray.o[1] + t1 * shell->ray.v[1]);
    for (;;) {
        conemap__place_uvw at = conemap__shell_at(shell, t);
        conemap__mix mix = conemap__relief(shell->map, f, at.u, at.v);
        double apex = (double)mix.height + (double)CONEMAP__APEX_SLACK, tangent = (double)mix.tangent, g, slope,
               closing, step;
        ++*steps;
        if (at.w <= (double)mix.height || (solid && t >= t1)) {
            if (t <= t0) return t;
            for (n = 0; n < desc->refine_steps; ++n) {
                double middle = 0.5 * (before + t);
                if (conemap__above_relief(shell, middle) > 0.0)
                    before = middle;
                else
                    t = middle;
            }
            return t;
        }
        if (t >= t1) return -1.0;
        g = (at.w - apex) * at.thickness;
        slope = at.sine * shell->ray.v[0] + at.cosine * shell->ray.v[2] -
                ((double)f->k + (double)f->tk * apex) * shell->ray.v[1];
        closing = conemap__maxd(at.thickness, over_end) * conemap__map_speed(shell, t, t1) - tangent * slope;
        step = g > 0.0 ? closing > 0.0 ? tangent * g / closing : CONEMAP__NEVER : 0.0;
        before = t;
        t += conemap__maxd(step, least);
        if (t > t1 || ++taken >= desc->steps) t = t1; /* far away a least step may not move t at all */
    }
}

/* ---- tracing ---------------------------------------------------------------------------------------- */

/* What a ray has met so far. */
typedef struct conemap__found {
    double t;
    int segment, face, inside, steps;
} conemap__found;

/* Meets one segment's surface before found->t, if it does. */
static void conemap__trace_segment(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *desc,
                                   const conemap__world_ray *world, int segment, conemap__found *found) {
    const conemap_frustum *f = &skeleton->frusta[segment];
    conemap__shell shell;
    double t0 = world->t0, t1 = found->t, end, inner0, inner1, t;
    int face, inner_face, solid;
    shell.ray = conemap__local(f, world->o, world->v);
    if (!desc->map || (f->t <= 0.0f && f->tk <= 0.0f)) {
        conemap__cone plain = conemap__cone_at(f, desc->map ? 0.0 : (double)desc->height);
        if (!conemap__solid_span(f, plain, &shell.ray, &t0, &t1, &face)) return;
        t = t0;
    } else {
        inner0 = t0;
        inner1 = t1;
        solid = conemap__solid_span(f, conemap__cone_at(f, 0.0), &shell.ray, &inner0, &inner1, &inner_face);
        if (!conemap__solid_span(f, conemap__cone_at(f, 1.0), &shell.ray, &t0, &t1, &face)) {
            if (!solid) return; /* inner without outer: by rounding, where there is no shell */
            t0 = inner0;
            face = inner_face;
        }
        end = solid ? inner0 : t1;
        if (end < t0) end = t0;
        shell.f = f;
        shell.map = desc->map;
        shell.linear = 0;
        shell.t_a = shell.t_b = shell.v_a = shell.v_b = 0.0;
        t = desc->march == CONEMAP_MARCH_CONES ? conemap__march_cones(&shell, desc, t0, end, solid, &found->steps)
                                               : conemap__march_steps(&shell, desc, t0, end, solid, &found->steps);
        if (t < 0.0) return;
        if (t > t0) face = 0;
    }
    if (!(t < found->t) && found->segment >= 0) return;
    found->t = t;
    found->segment = segment;
    found->face = face;
    found->inside = t <= world->t0;
}

/* When the ray enters a box; NEVER if it does not before `until`. */
CONEMAP__INLINE double conemap__enter_box(const conemap__branch *node, const conemap__world_ray *ray,
                                          const double *inverse, double until) {
    double t0 = ray->t0, t1 = until;
    int k;
    for (k = 0; k < 3; ++k) {
        double a = ((double)node->low[k] - ray->o[k]) * inverse[k],
               b = ((double)node->high[k] - ray->o[k]) * inverse[k];
        t0 = conemap__maxd(t0, conemap__mind(a, b));
        t1 = conemap__mind(t1, conemap__maxd(a, b));
    }
    return t0 <= t1 ? t0 : CONEMAP__NEVER;
}

static void conemap__walk_tree(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *desc,
                               const conemap__world_ray *ray, conemap__found *found) {
    const conemap__branch *tree = skeleton->build.tree;
    struct {
        int node;
        double t;
    } stack[64];
    double inverse[3];
    int depth = 0, k;
    for (k = 0; k < 3; ++k) inverse[k] = ray->v[k] != 0.0 ? 1.0 / ray->v[k] : 1e200;
    stack[0].node = 0;
    stack[0].t = conemap__enter_box(&tree[0], ray, inverse, found->t);
    if (stack[0].t < CONEMAP__NEVER) depth = 1;
    while (depth > 0) {
        const conemap__branch *node = &tree[stack[--depth].node];
        int first, second, keep;
        double t_first, t_second, keep_t;
        if (stack[depth].t > found->t) continue;
        if (node->count) {
            for (k = 0; k < node->count; ++k) {
                conemap__trace_segment(skeleton, desc, ray, skeleton->build.leaves[node->next + k], found);
                if (found->segment >= 0 && desc->any_hit) return;
            }
            continue;
        }
        first = (int)(node - tree) + 1;
        second = node->next;
        t_first = conemap__enter_box(&tree[first], ray, inverse, found->t);
        t_second = conemap__enter_box(&tree[second], ray, inverse, found->t);
        if (t_second < t_first) {
            keep = first;
            first = second;
            second = keep;
            keep_t = t_first;
            t_first = t_second;
            t_second = keep_t;
        }
        if (t_second < CONEMAP__NEVER) {
            stack[depth].node = second;
            stack[depth++].t = t_second;
        }
        if (t_first < CONEMAP__NEVER) {
            stack[depth].node = first;
            stack[depth++].t = t_first;
        }
    }
}

/* Unit normals of a segment's surface near a point, in the world: the shading normal and the true one. The surface is
   w = height(u, v), so its normal is grad w less the map's slopes times the gradients of the map's coordinates; the
   shading normal puts [BJCW09 eq. 8]'s direction in grad w's place. Returns how far the point is outside, in the
   world's units. */
static double conemap__normals(const conemap_frustum *f, const conemap_skeleton_trace_desc *desc, const double *p,
                               conemap__place_uvw *at, double smooth[3], double plain[3]) {
    double grad_u[3], grad_v[3], grad_w[3], steep, n[3], height = desc->map ? 0.0 : (double)desc->height;
    int k;
    *at = conemap__uvw(f, p);
    conemap__uvw_gradients(f, at, grad_u, grad_v, grad_w);
    steep = sqrt(conemap__dot3(grad_w, grad_w));
    conemap__smooth_normal(f, at, n);
    for (k = 0; k < 3; ++k) n[k] *= steep;
    if (desc->map && at->thickness > 0.0 && at->d > 1e-9 * (double)f->h) {
        double x, y, by_u, by_v;
        conemap__quad quad = conemap__relief_quad(desc->map, f, at->u, at->v, &x, &y);
        conemap__corners h = conemap__gather(desc->map->heights, quad);
        height = (double)conemap__bilinear(h, (float)x, (float)y);
        by_u = ((double)h.h10 - (double)h.h00) * (1.0 - y) + ((double)h.h11 - (double)h.h01) * y;
        by_v = ((double)h.h01 - (double)h.h00) * (1.0 - x) + ((double)h.h11 - (double)h.h10) * x;
        by_u *= (double)desc->map->info.width * (double)f->u_repeat; /* per turn, twist apart */
        by_v *= (double)desc->map->info.height * (double)f->v_size;
        by_v += by_u * (double)f->twist;
        for (k = 0; k < 3; ++k) {
            double slope = by_u * grad_u[k] + by_v * grad_v[k];
            grad_w[k] -= slope;
            n[k] -= slope;
        }
    }
    conemap__gradient_to_world(f, grad_w, plain);
    conemap__gradient_to_world(f, n, smooth);
    conemap__normalise3(plain);
    conemap__normalise3(smooth);
    return at->thickness > 0.0 ? (at->w - height) * at->thickness : at->w;
}

/* Adds the normal of a segment that comes near a point: as much as the point's own where it lies on both surfaces,
   nothing from `reach` away. `branch`: the segment begins inside the other one, and counts only above its foot. */
static void conemap__mix_normal(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *desc,
                                int segment, const double *point, double reach, int branch, double *sum) {
    const conemap_frustum *f = &skeleton->frusta[segment];
    conemap__place_uvw at;
    double p[3], smooth[3], plain[3], away, weight = 1.0;
    int k;
    conemap__to_local(f, point, p);
    if (branch) weight = conemap__clamp01(4.0 * p[1] / ((double)f->r + (double)f->t));
    if (!(weight > 0.0) || p[1] > (double)f->h + reach || p[1] < -reach - (double)f->h) return;
    away = conemap__normals(f, desc, p, &at, smooth, plain);
    if (away >= reach) return;
    away = away > 0.0 ? 1.0 - away / reach : 1.0;
    weight *= away * away * (3.0 - 2.0 * away);
    for (k = 0; k < 3; ++k) sum[k] += weight * smooth[k];
}

/* The segment of a chain that a point is beside, a few segments up or down from `segment`. */
static int conemap__beside(const conemap_frustum *frusta, int segment, const double *point) {
    int step;
    for (step = 0; step < CONEMAP__CHAIN; ++step) {
        const conemap_frustum *f = &frusta[segment];
        double p[3];
        conemap__to_local(f, point, p);
        if (p[1] > (double)f->upper[0] * p[0] + (double)f->upper[1] * p[2] + (double)f->upper[2] && f->child >= 0)
            segment = f->child;
        else if (p[1] < (double)f->lower[0] * p[0] + (double)f->lower[1] * p[2] + (double)f->lower[2] &&
                 f->parent >= 0 && !(f->flags & CONEMAP_FRUSTUM_BRANCH))
            segment = f->parent;
        else
            break;
    }
    return segment;
}

/* Mixes in the branches that leave a segment's top, but not `except`. */
static void conemap__mix_branches(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *desc,
                                  int segment, int except, const double *point, double *sum) {
    const conemap_frustum *frusta = skeleton->frusta;
    int branch;
    for (branch = frusta[segment].branch; branch >= 0; branch = frusta[branch].sibling) {
        int beside = branch != except ? conemap__beside(frusta, branch, point) : -1;
        if (beside >= 0)
            conemap__mix_normal(skeleton, desc, beside, point,
                                (double)skeleton->build.blend *
                                    ((double)frusta[branch].r + (double)frusta[branch].t),
                                beside == branch, sum);
    }
}

/* Where branches leave a chain, the normals of the surfaces that meet there are mixed: those of the branches that
   leave the segment's own chain nearby, and if that chain is itself a branch, of the chain it leaves and its other
   branches. */
static void conemap__blend_normal(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *desc,
                                  int segment, const double *point, double *normal) {
    const conemap_frustum *frusta = skeleton->frusta;
    int at, step;
    for (at = frusta[segment].child, step = 1; at >= 0 && step < CONEMAP__CHAIN; at = frusta[at].child, ++step)
        conemap__mix_branches(skeleton, desc, at, -1, point, normal);
    for (at = segment, step = 0; at >= 0 && step < CONEMAP__CHAIN; at = frusta[at].parent, ++step) {
        conemap__mix_branches(skeleton, desc, at, -1, point, normal);
        if (frusta[at].flags & CONEMAP_FRUSTUM_BRANCH) {
            int parent = frusta[at].parent;
            conemap__mix_normal(skeleton, desc, conemap__beside(frusta, parent, point), point,
                                (double)skeleton->build.blend * ((double)frusta[at].r + (double)frusta[at].t), 0,
                                normal);
            conemap__mix_branches(skeleton, desc, parent, at, point, normal);
            break;
        }
    }
}

static void conemap__put_surface(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *desc,
                                 const conemap__world_ray *ray, const conemap__found *found,
                                 conemap_skeleton_hit *hit) {
    static const int ends_freely[3] = {
        0, CONEMAP_FRUSTUM_ROOT | CONEMAP_FRUSTUM_BRANCH | CONEMAP_FRUSTUM_CLAMPED_LOWER,
        CONEMAP_FRUSTUM_TIP | CONEMAP_FRUSTUM_CLAMPED_UPPER};
    const conemap_frustum *f = &skeleton->frusta[found->segment];
    conemap__place_uvw at;
    double point[3], p[3], smooth[3], plain[3], v;
    int k;
    for (k = 0; k < 3; ++k) {
        point[k] = ray->o[k] + found->t * ray->v[k];
        hit->position[k] = (float)point[k];
    }
    conemap__to_local(f, point, p);
    conemap__normals(f, desc, p, &at, smooth, plain);
    if (f->flags & ends_freely[found->face]) { /* elsewhere a plane that shows is the rounding of a seam */
        const float *plane = found->face == 1 ? f->lower : f->upper;
        double n[3], sign = found->face == 1 ? -1.0 : 1.0;
        n[0] = -sign * (double)plane[0];
        n[1] = sign;
        n[2] = -sign * (double)plane[1];
        conemap__gradient_to_world(f, n, plain);
        conemap__normalise3(plain);
        memcpy(smooth, plain, sizeof smooth);
        hit->cap = found->face;
    } else if (skeleton->build.blend > 0.0f) {
        conemap__blend_normal(skeleton, desc, found->segment, point, smooth);
        conemap__normalise3(smooth);
    }
    v = conemap__clamp01(at.v);
    hit->u = (float)at.u;
    hit->v = (float)v;
    hit->w = (float)at.w;
    hit->map_u = (float)((at.u + v * (double)f->twist) * (double)f->u_repeat);
    hit->map_v = (float)((double)f->v_start + v * (double)f->v_size);
    for (k = 0; k < 3; ++k) {
        hit->normal[k] = (float)smooth[k];
        hit->true_normal[k] = (float)plain[k];
    }
}

/* Checks trace settings and writes their defaults out. */
static conemap_result conemap__resolve_skeleton_trace(conemap_skeleton_trace_desc *desc) {
    const conemap_map *map = desc->map;
    int by_steps;
    if (!CONEMAP__KNOWN(desc->march, CONEMAP_MARCH_COUNT)) return CONEMAP_ERROR_ENUM;
    if (!conemap__in_range(desc->height, 0.0f, 1.0f) || desc->steps < 0 || desc->steps > (1 << 20) ||
        desc->refine_steps < 0 || desc->refine_steps > 64)
        return CONEMAP_ERROR_PARAMETER;
    if (map && (!map->heights || !map->cones)) return CONEMAP_ERROR_NULL;
    if (map && (map->info.wrap_u != CONEMAP_WRAP || (map->info.wrap_v == CONEMAP_NOTHING && map->info.height > 1)))
        return CONEMAP_ERROR_UNSUPPORTED;
    by_steps = desc->linear_v || (map && (map->info.guarantee == CONEMAP_GUARANTEE_RELAXED ||
                                          map->info.guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR));
    if (by_steps && desc->march == CONEMAP_MARCH_CONES) return CONEMAP_ERROR_UNSUPPORTED;
    if (desc->march == CONEMAP_MARCH_DEFAULT) desc->march = by_steps ? CONEMAP_MARCH_STEPS : CONEMAP_MARCH_CONES;
    if (desc->steps == 0) desc->steps = desc->march == CONEMAP_MARCH_CONES ? 256 : 64;
    if (desc->refine_steps == 0) desc->refine_steps = 10;
    return CONEMAP_OK;
}

static void conemap__trace_skeleton_ray(const conemap_skeleton *skeleton, const conemap_skeleton_trace_desc *desc,
                                        const conemap_ray *ray, conemap_skeleton_hit *hit) {
    conemap__world_ray world = conemap__prepare_ray(ray);
    conemap__found found;
    double t;
    memset(&found, 0, sizeof found);
    found.t = world.t1;
    found.segment = -1;
    conemap__walk_tree(skeleton, desc, &world, &found);
    memset(hit, 0, sizeof *hit);
    hit->segment = found.segment;
    hit->steps = found.steps;
    t = found.t * world.scale;
    hit->t = t < 3.0e38 ? (float)t : conemap__from_bits(0x7f800000u);
    if (found.segment < 0) {
        hit->status = found.t < CONEMAP__NEVER ? CONEMAP_T_MAX : CONEMAP_LEFT;
        return;
    }
    hit->status = CONEMAP_HIT;
    hit->inside = found.inside;
    if (!desc->any_hit) conemap__put_surface(skeleton, desc, &world, &found, hit);
}

CONEMAP__DEF conemap_result conemap_skeleton_trace(const conemap_skeleton *skeleton,
                                                   const conemap_skeleton_trace_desc *desc,
                                                   const conemap_ray *rays, conemap_skeleton_hit *hits,
                                                   int count) {
    conemap_skeleton_trace_desc resolved;
    conemap_result result;
    int k;
    if (!skeleton || !skeleton->frusta || ((!rays || !hits) && count != 0)) return CONEMAP_ERROR_NULL;
    if (count < 0) return CONEMAP_ERROR_PARAMETER;
    memset(&resolved, 0, sizeof resolved);
    if (desc) resolved = *desc;
    result = conemap__resolve_skeleton_trace(&resolved);
    if (result != CONEMAP_OK) return result;
    for (k = 0; k < count; ++k) {
        conemap_result ray_result = conemap__check_ray(&rays[k]);
        if (ray_result == CONEMAP_OK) {
            conemap__trace_skeleton_ray(skeleton, &resolved, &rays[k], &hits[k]);
        } else {
            memset(&hits[k], 0, sizeof hits[k]);
            hits[k].status = CONEMAP_INVALID;
            hits[k].segment = -1;
            if (result == CONEMAP_OK) result = ray_result;
        }
    }
    return result;
}

/* ======================================================================================================
   E M I T T E D   F R U S T A

   Snippets of their own for the EMITTER: the same arithmetic as FRUSTUM RAYS and FRUSTA, in single precision.
   ====================================================================================================== */

static const conemap__snippet conemap__frusta_snippets[] = {
    {"conemap_real",
     "?c static float conemap_real(int bits) {\n"
     "?c     union {\n"
     "?c         int whole;\n"
     "?c         float real;\n"
     "?c     } both;\n"
     "?c     both.whole = bits;\n"
     "?c     return both.real;\n"
     "?c }\n"},
    {"conemap_frustum",
     "$STRUCT conemap_frustum {\n"
     "    vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates\n"
     "    vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there\n"
     "    vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth\n"
     "    vec4 extent; // length of the axis; start and size in the map's v; twist\n"
     "    ivec4 links; // parent, child, branch, sibling\n"
     "    ivec4 more; // flags, u_repeat, user\n"
     "?c } conemap_frustum;\n"
     "?!c };\n"},
    {"conemap_real4",
     "$FNvec4 conemap_real4(ivec4 bits) {\n"
     "    return vec4($REAL(bits.x), $REAL(bits.y), $REAL(bits.z), $REAL(bits.w));\n"
     "}\n"},
    {"conemap_row",
     "// One of a frustum's nine rows, as integers: as floats, a unit could flush its small ones to 0.\n"
     "$FNivec4 conemap_row(int frustum, int row) {\n"
     "?from_texture     int across = textureSize($FRUSTA_NAME, 0).x / 9;\n"
     "    return $ROW;\n"
     "}\n"},
    {"conemap_load",
     "$FNconemap_frustum conemap_load(int frustum) {\n"
     "    conemap_frustum f;\n"
     "    f.axis_x = conemap_real4(conemap_row(frustum, 0));\n"
     "    f.axis_y = conemap_real4(conemap_row(frustum, 1));\n"
     "    f.axis_z = conemap_real4(conemap_row(frustum, 2));\n"
     "    f.lower = conemap_real4(conemap_row(frustum, 3));\n"
     "    f.upper = conemap_real4(conemap_row(frustum, 4));\n"
     "    f.radii = conemap_real4(conemap_row(frustum, 5));\n"
     "    f.extent = conemap_real4(conemap_row(frustum, 6));\n"
     "    f.links = conemap_row(frustum, 7);\n"
     "    f.more = conemap_row(frustum, 8);\n"
     "    return f;\n"
     "}\n"},
    {"conemap_into",
     "// A direction of the world in the frustum's frame.\n"
     "$FNvec3 conemap_into(conemap_frustum f, vec3 d) {\n"
     "    return vec3(f.axis_x.x * d.x + f.axis_x.y * d.y + f.axis_x.z * d.z,\n"
     "                f.axis_y.x * d.x + f.axis_y.y * d.y + f.axis_y.z * d.z,\n"
     "                f.axis_z.x * d.x + f.axis_z.y * d.y + f.axis_z.z * d.z);\n"
     "}\n"},
    {"conemap_place_into",
     "$FNvec3 conemap_place_into(conemap_frustum f, vec3 p) {\n"
     "    return conemap_into(f, vec3(p.x - f.axis_x.w, p.y - f.axis_y.w, p.z - f.axis_z.w));\n"
     "}\n"},
    {"conemap_out_of",
     "// A gradient of the frame in the world's; with the axes divided by their lengths twice, a direction.\n"
     "$FNvec3 conemap_out_of(conemap_frustum f, vec3 n) {\n"
     "    return vec3(f.axis_x.x * n.x + f.axis_y.x * n.y + f.axis_z.x * n.z,\n"
     "                f.axis_x.y * n.x + f.axis_y.y * n.y + f.axis_z.y * n.z,\n"
     "                f.axis_x.z * n.x + f.axis_y.z * n.y + f.axis_z.z * n.z);\n"
     "}\n"},
    {"conemap_place_out_of",
     "$FNvec3 conemap_place_out_of(conemap_frustum f, vec3 p) {\n"
     "    vec4 x = f.axis_x, y = f.axis_y, z = f.axis_z;\n"
     "    vec3 d = conemap_out_of(f, vec3(p.x / (x.x * x.x + x.y * x.y + x.z * x.z),\n"
     "                                    p.y / (y.x * y.x + y.y * y.y + y.z * y.z),\n"
     "                                    p.z / (z.x * z.x + z.y * z.y + z.z * z.z)));\n"
     "    return vec3(x.w + d.x, y.w + d.y, z.w + d.z);\n"
     "}\n"},
    {"conemap_unit",
     "$FNvec3 conemap_unit(vec3 n) {\n"
     "    float by = sqrt(n.x * n.x + n.y * n.y + n.z * n.z);\n"
     "    by = by > 0.0f ? 1.0f / by : 0.0f;\n"
     "    return vec3(n.x * by, n.y * by, n.z * by);\n"
     "}\n"},
    {"conemap_cut",
     "// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its "
     "growth) in the\n"
     "// direction in which the plane rises by `tilt`.\n"
     "$FNfloat conemap_cut(vec4 plane, float tilt, vec2 cone, float base) {\n"
     "    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0f - cone.y * tilt);\n"
     "}\n"},
    {"conemap_corner",
     "// Corner 0..7 of the pyramid around the shell, cut by the planes, in the frame.\n"
     "$FNvec3 conemap_corner(conemap_frustum f, int corner) {\n"
     "    float sx = (corner & 3) == 1 || (corner & 3) == 2 ? 1.0f : -1.0f, sz = (corner & 3) >= 2 ? 1.0f : -1.0f;\n"
     "    vec2 cone = vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);\n"
     "    float low = conemap_cut(f.lower, f.lower.x * sx + f.lower.y * sz, cone, 0.0f);\n"
     "    float y = corner < 4 ? low : conemap_cut(f.upper, f.upper.x * sx + f.upper.y * sz, cone, 0.0f);\n"
     "    float reach = max(cone.x + cone.y * y, 0.0f);\n"
     "    return vec3(sx * reach, y, sz * reach);\n"
     "}\n"},
    {"conemap_half",
     "// Narrows (from, to, face) to where g + gv t >= 0; a ray that enters there enters through `face`.\n"
     "$FNvec3 conemap_half(vec3 span, float g, float gv, float face) {\n"
     "    float t = gv != 0.0f ? -g / gv : 0.0f;\n"
     "    if (gv > 0.0f && t > span.x) span = vec3(t, span.y, face);\n"
     "    if (gv < 0.0f) span.y = min(span.y, t);\n"
     "    if (gv == 0.0f && g < 0.0f) span.y = -1e30f;\n"
     "    return span;\n"
     "}\n"},
    {"conemap_span",
     "// Where a ray of the frame is between the cutting planes and inside a cone (radius at y = 0, its "
     "growth): from, to, and\n"
     "// the face that it enters through, 0 the cone, 1 the lower plane, 2 the upper; nowhere if from > to. "
     "The quadratic is\n"
     "// set up where the ray is nearest to the axis, its discriminant from the ray's moment about the axis, "
     "and solved in\n"
     "// the form that does not cancel. There is no apex, so cylinders are nothing special, and no mirrored nappe.\n"
     "$FNvec3 conemap_span(conemap_frustum f, vec2 cone, vec3 o, vec3 v, float t_min, float t_max) {\n"
     "    float seam = 1e-6f * (f.extent.x + cone.x); // by so much neighbours overlap: rounding opens no gap\n"
     "    vec3 span = vec3(t_min, t_max, 0.0f);\n"
     "    span = conemap_half(span, o.y - f.lower.x * o.x - f.lower.y * o.z - f.lower.z + seam,\n"
     "                        v.y - f.lower.x * v.x - f.lower.y * v.z, 1.0f);\n"
     "    span = conemap_half(span, f.upper.x * o.x + f.upper.y * o.z + f.upper.z - o.y + seam,\n"
     "                        f.upper.x * v.x + f.upper.y * v.z - v.y, 2.0f);\n"
     "    float across = v.x * v.x + v.z * v.z;\n"
     "    float at = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : span.x;\n"
     "    at = min(max(at, span.x), span.y);\n"
     "    float x = o.x + at * v.x, y = o.y + at * v.y, z = o.z + at * v.z, d = sqrt(x * x + z * z);\n"
     "    float radius = cone.x + cone.y * y, growth = cone.y * v.y, along = x * v.x + z * v.z;\n"
     "    vec3 inside = conemap_half(vec3(span.x - at, span.y - at, span.z), radius, growth, 0.0f);\n"
     "    float a = across - growth * growth, b = along - radius * growth, c = (d - radius) * (d + radius);\n"
     "    float reach = sqrt(across) * radius, moment = abs(x * v.z - z * v.x);\n"
     "    float root = (reach - moment) * (reach + moment) + growth * (growth * d * d - 2.0f * along * radius);\n"
     "    bool meets = span.x <= span.y && (root >= 0.0f || a <= 0.0f); // or passes beside\n"
     "    root = sqrt(max(root, 0.0f));\n"
     "    float q = b < 0.0f ? root - b : -root - b;\n"
     "    float one = a != 0.0f ? q / a : q > 0.0f ? 1e30f : -1e30f, two = q != 0.0f ? c / q : one;\n"
     "    float first = min(one, two), second = max(one, two);\n"
     "    if (a < 0.0f) { // steeper than the cone: inside it beyond one root, the other is the mirrored nappe's\n"
     "        second = growth > 0.0f ? 1e30f : first;\n"
     "        first = growth > 0.0f ? max(one, two) : -1e30f;\n"
     "    }\n"
     "    if (a == 0.0f && q == 0.0f) { // along its straight lines\n"
     "        first = -1e30f;\n"
     "        second = c > 0.0f ? -1e30f : 1e30f;\n"
     "    }\n"
     "    if (first > inside.x) inside = vec3(first, inside.y, 0.0f);\n"
     "    inside.y = min(inside.y, second);\n"
     "    span = vec3(max(span.x, inside.x + at), min(span.y, inside.y + at), inside.z);\n"
     "    return meets && inside.x <= inside.y ? span : vec3(1.0f, 0.0f, 0.0f);\n"
     "}\n"},
    {"conemap_turns",
     "// The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. Within 1e-7.\n"
     "$FNfloat conemap_turns(float x, float z) {\n"
     "    float ax = abs(x), az = abs(z), large = max(ax, az), a = large > 0.0f ? min(ax, az) / large : 0.0f;\n"
     "    float base = a > 0.414213562f ? 0.125f : 0.0f; // turned back by an eighth\n"
     "    if (base > 0.0f) a = (a - 1.0f) / (a + 1.0f);\n"
     "    float s = a * a;\n"
     "    float turns = base + a * (0.15915485f + s * (-0.05303445f + s * (0.03131805f - s * 0.01766679f)));\n"
     "    if (ax > az) turns = 0.25f - turns;\n"
     "    if (z < 0.0f) turns = 0.5f - turns;\n"
     "    return x < 0.0f ? 1.0f - turns : turns;\n"
     "}\n"},
    {"conemap_uvw",
     "$STRUCT conemap_uvw { // a place in a frustum, with what it was computed from\n"
     "    float u, v, w;\n"
     "    float d, sine, cosine, thickness; // distance from the axis, direction from it; of the shell there\n"
     "    vec2 cone; // that of the shell that goes through the place\n"
     "    float low, high; // y where its straight line there meets the cutting planes\n"
     "?c } conemap_uvw;\n"
     "?!c };\n"},
    {"conemap_locate",
     "$FNconemap_uvw conemap_locate(conemap_frustum f, vec3 p) {\n"
     "    conemap_uvw at;\n"
     "    at.d = sqrt(p.x * p.x + p.z * p.z);\n"
     "    at.sine = at.d > 0.0f ? p.x / at.d : 0.0f;\n"
     "    at.cosine = at.d > 0.0f ? p.z / at.d : 1.0f;\n"
     "    at.thickness = f.radii.z + f.radii.w * p.y;\n"
     "    at.w = at.d - (f.radii.x + f.radii.y * p.y);\n"
     "    if (at.thickness > 0.0f) at.w = at.w / at.thickness;\n"
     "    float w = at.thickness > 0.0f ? min(max(at.w, -0.5f), 1.5f) : 0.0f;\n"
     "    at.cone = vec2(f.radii.x + w * f.radii.z, f.radii.y + w * f.radii.w);\n"
     "    at.low = conemap_cut(f.lower, f.lower.x * at.sine + f.lower.y * at.cosine, at.cone, 0.0f);\n"
     "    at.high = conemap_cut(f.upper, f.upper.x * at.sine + f.upper.y * at.cosine, at.cone, 0.0f);\n"
     "    at.v = at.high != at.low ? (p.y - at.low) / (at.high - at.low) : 0.0f;\n"
     "    at.u = conemap_turns(p.x, p.z);\n"
     "    return at;\n"
     "}\n"},
    {"conemap_map_place",
     "// The map's u and v, not wrapped.\n"
     "$FNvec2 conemap_map_place(conemap_frustum f, float u, float v) {\n"
     "    float clamped = min(max(v, 0.0f), 1.0f);\n"
     "    return vec2((u + clamped * f.extent.w) * float(f.more.y), f.extent.y + clamped * f.extent.z);\n"
     "}\n"},
    {"conemap_texels",
     "// The same in texels, from the centre of texel (0, 0).\n"
     "$FNvec2 conemap_texels(conemap_frustum f, float u, float v$SIZE_PARAMS) {\n"
     "    vec2 at = conemap_map_place(f, u, v);\n"
     "?!wrap_v     at.y = min(max(at.y, 0.0f), 1.0f);\n"
     "?wrap_v     at.y -= floor(at.y);\n"
     "    return vec2((at.x - floor(at.x)) * $FW - 0.5f, at.y * $FH - 0.5f);\n"
     "}\n"},
    {"conemap_relief",
     "?cones // Height of the relief, and tangent of the cone there.\n"
     "?!cones // Height of the relief.\n"
     "$FN$RELIEF_TYPE conemap_relief(conemap_frustum f, float u, float v) {\n"
     "?size_asked     ivec2 size = $SIZE_ASKED;\n"
     "    vec2 at = conemap_texels(f, u, v$SIZE);\n"
     "    int i = int(floor(at.x)), j = int(floor(at.y)), si = 1, sj = 1;\n"
     "    float x = at.x - floor(at.x), y = at.y - floor(at.y);\n"
     "@<surface\n"
     "?cones @<cone\n"
     "?cones     return vec2(height, $TANGENT);\n"
     "?!cones     return height;\n"
     "}\n"},
    {"conemap_slopes",
     "// Height of the relief, and what it grows by per turn of u and per v of the frustum.\n"
     "$FNvec3 conemap_slopes(conemap_frustum f, float u, float v) {\n"
     "?size_asked     ivec2 size = $SIZE_ASKED;\n"
     "    vec2 at = conemap_texels(f, u, v$SIZE);\n"
     "    int i = int(floor(at.x)), j = int(floor(at.y));\n"
     "    float x = at.x - floor(at.x), y = at.y - floor(at.y);\n"
     "    float a = conemap_texel(i, j$MAP)$DOT_HEIGHT, b = conemap_texel(i + 1, j$MAP)$DOT_HEIGHT;\n"
     "    float c = conemap_texel(i, j + 1$MAP)$DOT_HEIGHT, d = conemap_texel(i + 1, j + 1$MAP)$DOT_HEIGHT;\n"
     "    float low = b - a, high = d - c, by_u = (low + (high - low) * y) * $FW * float(f.more.y);\n"
     "    float by_v = (c - a + (d - c - b + a) * x) * $FH * f.extent.z;\n"
     "    return vec3(a + low * x + (c - a + (high - low) * x) * y, by_u, by_v + by_u * f.extent.w);\n"
     "}\n"},
    {"conemap_along",
     "$FNvec3 conemap_along(vec3 o, vec3 v, float t) {\n"
     "    return vec3(o.x + t * v.x, o.y + t * v.y, o.z + t * v.z);\n"
     "}\n"},
    {"conemap_above",
     "// How far the ray is above the relief at t, in heights.\n"
     "?!linear_v $FNfloat conemap_above(conemap_frustum f, vec3 o, vec3 v, float t) {\n"
     "?linear_v $FNfloat conemap_above(conemap_frustum f, vec3 o, vec3 v, float t, vec4 piece) {\n"
     "    conemap_uvw at = conemap_locate(f, conemap_along(o, v, t));\n"
     "?linear_v     if (piece.y > piece.x) at.v = piece.z + (piece.w - piece.z) * ((t - piece.x) / (piece.y - "
     "piece.x));\n"
     "    return at.w - conemap_relief(f, at.u, at.v)$DOT_RELIEF;\n"
     "}\n"},
    {"conemap_piece",
     "// Piece k of n of a ray in the shell, along which v is taken for linear: t and v of its ends.\n"
     "$FNvec4 conemap_piece(conemap_frustum f, vec3 o, vec3 v, vec2 range, int k, int n) {\n"
     "    float a = range.x + (range.y - range.x) * (float(k) / float(n));\n"
     "    float b = k + 1 < n ? range.x + (range.y - range.x) * (float(k + 1) / float(n)) : range.y;\n"
     "    conemap_uvw from = conemap_locate(f, conemap_along(o, v, a)), to = conemap_locate(f, "
     "conemap_along(o, v, b));\n"
     "    return vec4(a, b, from.v, to.v);\n"
     "}\n"},
    {"conemap_pieces",
     "// One for every 45 degrees between the cutting planes.\n"
     "$FNint conemap_pieces(conemap_frustum f) {\n"
     "    vec4 a = f.lower, b = f.upper;\n"
     "    float c = (1.0f + a.x * b.x + a.y * b.y) / sqrt((1.0f + a.x * a.x + a.y * a.y) * (1.0f + b.x * b.x + "
     "b.y * b.y));\n"
     "    return c >= 0.7071f ? 1 : c >= 0.0f ? 2 : c >= -0.7071f ? 3 : 4;\n"
     "}\n"},
    {"conemap_shell",
     "$STRUCT conemap_shell { // what bounds how fast the map's place changes along a ray\n"
     "    float turning, nearest; // |x' z - x z'|; t where the ray is nearest to the axis\n"
     "    float by_turning, fixed_speed, span; // see conemap_bound_speed\n"
     "?c } conemap_shell;\n"
     "?!c };\n"},
    {"conemap_thickness",
     "// Of the shell where a plane has its lowest (side -1) or highest corner on the outer cone.\n"
     "$FNfloat conemap_thickness(conemap_frustum f, vec4 plane, vec2 cone, float side) {\n"
     "    float tilt = abs(plane.x) + abs(plane.y), y = conemap_cut(plane, tilt, cone, 0.0f);\n"
     "    float other = conemap_cut(plane, -tilt, cone, 0.0f), across = abs(plane.x) - abs(plane.y);\n"
     "    y = side > 0.0f ? max(y, other) : min(y, other);\n"
     "    other = conemap_cut(plane, across, cone, 0.0f);\n"
     "    y = side > 0.0f ? max(y, other) : min(y, other);\n"
     "    other = conemap_cut(plane, -across, cone, 0.0f);\n"
     "    return f.radii.z + f.radii.w * (side > 0.0f ? max(y, other) : min(y, other));\n"
     "}\n"},
    {"conemap_bound_speed",
     "// The angle turns at |x' z - x z'| / d^2. A cut y = (c + s r) / (1 - k s) moves with it by at most n (r "
     "+ k c) /\n"
     "// (1 - k n)^2, n the plane's slope, and with w by at most n thickness / (1 - k n). So v moves no faster than\n"
     "// (fixed_speed + by_turning * angle) / span, with span the least way between the cuts.\n"
     "$FNconemap_shell conemap_bound_speed(conemap_frustum f, vec3 o, vec3 v) {\n"
     "    conemap_shell s;\n"
     "    vec2 inner = vec2(f.radii.x, f.radii.y), outer = vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);\n"
     "    float lower = sqrt(f.lower.x * f.lower.x + f.lower.y * f.lower.y);\n"
     "    float upper = sqrt(f.upper.x * f.upper.x + f.upper.y * f.upper.y);\n"
     "    float da = f.upper.x - f.lower.x, db = f.upper.y - f.lower.y, n = max(lower, upper);\n"
     "    float k = max(abs(inner.y), abs(outer.y)), rest = 1.0f - k * n, vy = abs(v.y);\n"
     "    float c = max(abs(f.lower.z), abs(f.upper.z)), across = v.x * v.x + v.z * v.z;\n"
     "    float low = conemap_thickness(f, f.lower, outer, -1.0f), high = conemap_thickness(f, f.upper, outer, 1.0f);\n"
     "    float thinnest = min(low, high);\n"
     "    s.turning = abs(v.x * o.z - o.x * v.z);\n"
     "    s.nearest = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : 0.0f;\n"
     "    s.by_turning = n * (max(inner.x, outer.x) + k * c) / (rest * rest);\n"
     "    s.span = max(outer.x + outer.y * f.lower.z, inner.x + inner.y * f.lower.z) / (1.0f - k * lower);\n"
     "    s.span = (f.upper.z - f.lower.z - s.span * sqrt(da * da + db * db)) / (1.0f + k * upper);\n"
     "    s.fixed_speed = vy;\n"
     "    if (n > 0.0f && thinnest > 0.0f)\n"
     "        s.fixed_speed += n * max(low, high) / rest * ((sqrt(across) + (k + abs(f.radii.w)) * vy) / thinnest);\n"
     "    if (n > 0.0f && !(thinnest > 0.0f)) s.span = 0.0f; // no bound\n"
     "    return s;\n"
     "}\n"},
    {"conemap_map_speed",
     "// How fast the map's place changes at most, from t to t_end.\n"
     "$FNfloat conemap_map_speed(conemap_frustum f, conemap_shell s, vec3 o, vec3 v, float t, float t_end) {\n"
     "    vec3 p = conemap_along(o, v, min(max(s.nearest, t), t_end));\n"
     "    float d2 = p.x * p.x + p.z * p.z;\n"
     "    float angle = s.turning / max(d2, 1e-30f), by_v = (s.fixed_speed + s.by_turning * angle) / s.span;\n"
     "    float by_u = (angle * 0.159154943f + by_v * abs(f.extent.w)) * float(f.more.y);\n"
     "    by_v *= abs(f.extent.z)$TIMES_ASPECT;\n"
     "    return s.span > 0.0f && d2 > 0.0f ? sqrt(by_u * by_u + by_v * by_v) : 1e30f;\n"
     "}\n"},
    {"conemap_march",
     "?steps_march // Equal steps, then halvings [BJCW09 section 3]: t where the ray meets the relief in a "
     "range of t, at its end if\n"
     "?steps_march // `solid`; 1e30: it does not.\n"
     "?cone_march // Cone steps, none shorter than one of $CAP equal ones, then halvings: t where the ray "
     "meets the relief in a range\n"
     "?cone_march // of t, at its end if `solid`; 1e30: it does not. The ray is g above the cone's apex, in "
     "the world's units, and\n"
     "?cone_march // meets nothing while g + g' t > thickness speed t / tangent.\n"
     "$FNfloat conemap_march(conemap_frustum f, vec3 o, vec3 v, vec2 range, bool solid) {\n"
     "    float before = range.x, t = range.x;\n"
     "    bool met = false;\n"
     "?linear_v     int pieces = conemap_pieces(f), next = 1;\n"
     "?linear_v     vec4 piece = conemap_piece(f, o, v, range, 0, pieces);\n"
     "?cone_march     float least = (range.y - range.x) / float($CAP);\n"
     "?cone_march     float thick_end = f.radii.z + f.radii.w * (o.y + range.y * v.y);\n"
     "?cone_march     conemap_shell shell = conemap_bound_speed(f, o, v);\n"
     "    for (int k = 0; k <= $CAP; ++k) {\n"
     "?steps_march         t = k < $CAP ? range.x + (range.y - range.x) * (float(k) / float($CAP)) : range.y;\n"
     "?linear_v         if (t > piece.y && next < pieces) {\n"
     "?linear_v             piece = conemap_piece(f, o, v, range, next, pieces);\n"
     "?linear_v             ++next;\n"
     "?linear_v         }\n"
     "?steps_march         met = (solid && k == $CAP) || conemap_above(f, o, v, t$PIECE) <= 0.0f;\n"
     "?steps_march         if (met) break;\n"
     "?steps_march         before = t;\n"
     "?cone_march         conemap_uvw at = conemap_locate(f, conemap_along(o, v, t));\n"
     "?cone_march         vec2 relief = conemap_relief(f, at.u, at.v);\n"
     "?cone_march         met = at.w <= relief.x || (solid && t >= range.y);\n"
     "?cone_march         if (met || t >= range.y) break;\n"
     "?cone_march         float apex = relief.x + 1.0f / 1048576.0f, g = (at.w - apex) * at.thickness;\n"
     "?cone_march         float slope = at.sine * v.x + at.cosine * v.z - (f.radii.y + f.radii.w * apex) * v.y;\n"
     "?cone_march         float closing = max(at.thickness, thick_end) * conemap_map_speed(f, shell, o, v, t, "
     "range.y);\n"
     "?cone_march         closing -= relief.y * slope;\n"
     "?cone_march         before = t;\n"
     "?cone_march         t += max(g <= 0.0f ? 0.0f : closing > 0.0f ? relief.y * g / closing : 1e30f, least);\n"
     "?cone_march         if (t > range.y || k + 1 >= $CAP) t = range.y;\n"
     "    }\n"
     "    for (int n = 0; met && n < $REFINE_STEPS; ++n) {\n"
     "        float middle = 0.5f * (before + t);\n"
     "        bool over = conemap_above(f, o, v, middle$PIECE) > 0.0f;\n"
     "        before = over ? middle : before;\n"
     "        t = over ? t : middle;\n"
     "    }\n"
     "    return met ? t : 1e30f;\n"
     "}\n"},
    {"conemap_meet",
     "?relief // t where a ray of the frame meets the frustum's relief, 1e30 where it does not, and the face; "
     "see conemap_span.\n"
     "?!relief // t where a ray of the frame meets the frustum, 1e30 where it does not, and the face; see "
     "conemap_span.\n"
     "$FNvec2 conemap_meet(conemap_frustum f, vec3 o, vec3 v, float t_min, float t_max) {\n"
     "?!relief     vec2 cone = vec2(f.radii.x + $HEIGHT * f.radii.z, f.radii.y + $HEIGHT * f.radii.w);\n"
     "?!relief     vec3 span = conemap_span(f, cone, o, v, t_min, t_max);\n"
     "?!relief     return span.x <= span.y ? vec2(span.x, span.z) : vec2(1e30f, 0.0f);\n"
     "?relief     vec3 inner = conemap_span(f, vec2(f.radii.x, f.radii.y), o, v, t_min, t_max), outer = inner;\n"
     "?relief     bool solid = inner.x <= inner.y, shell = f.radii.z > 0.0f || f.radii.w > 0.0f;\n"
     "?relief     if (shell) outer = conemap_span(f, vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, "
     "t_min, t_max);\n"
     "?relief     if (solid && outer.x > outer.y) outer = inner; // by rounding, where there is no shell\n"
     "?relief     float t = outer.x <= outer.y ? outer.x : 1e30f;\n"
     "?relief     if (shell && outer.x <= outer.y)\n"
     "?relief         t = conemap_march(f, o, v, vec2(outer.x, solid ? max(inner.x, outer.x) : outer.y), solid);\n"
     "?relief     return vec2(t, t > outer.x ? 0.0f : outer.z);\n"
     "}\n"},
    {"conemap_cut_gradient",
     "// Gradient, times the thickness, of a cut's y: it moves with the angle and with w.\n"
     "$FNvec3 conemap_cut_gradient(conemap_frustum f, vec4 plane, conemap_uvw at, float y, vec3 angle, vec3 w) {\n"
     "    float tilt = plane.x * at.sine + plane.y * at.cosine, rest = 1.0f - at.cone.y * tilt;\n"
     "    float a = (at.cone.x + at.cone.y * plane.z) / (rest * rest) * (plane.x * at.cosine - plane.y * at.sine);\n"
     "    float b = at.thickness > 0.0f ? tilt * (f.radii.z + f.radii.w * y) / rest : 0.0f;\n"
     "    return vec3(a * angle.x + b * w.x, a * angle.y + b * w.y, a * angle.z + b * w.z);\n"
     "}\n"},
    {"conemap_end_normal",
     "// The surface normal at a cut [BJCW09 eq. 8]: away from the joint, leaning back along the plane's own normal.\n"
     "$FNvec3 conemap_end_normal(conemap_frustum f, vec4 plane, conemap_uvw at, float joint) {\n"
     "    float y = conemap_cut(plane, plane.x * at.sine + plane.y * at.cosine, at.cone, joint);\n"
     "    float radius = at.cone.x + at.cone.y * joint + at.cone.y * y, size = sqrt(radius * radius + y * y);\n"
     "    if (!(radius > 1e-6f * (f.radii.x + f.radii.z + f.extent.x))) { // the end is a point: the limit\n"
     "        radius = 1.0f;\n"
     "        y = 0.0f;\n"
     "        size = 1.0f;\n"
     "    }\n"
     "    float lean = plane.w * size / sqrt(1.0f + plane.x * plane.x + plane.y * plane.y);\n"
     "    return conemap_unit(vec3(radius * at.sine + lean * plane.x, y - lean, radius * at.cosine + lean * "
     "plane.y));\n"
     "}\n"},
    {"conemap_normals",
     "$STRUCT conemap_normals { // in the world, units\n"
     "    vec3 shading, plain; // continuous across joints; of the surface as it is\n"
     "    float away; // how far the place is outside the surface, in the world's units\n"
     "?c } conemap_normals;\n"
     "?!c };\n"},
    {"conemap_find_normals",
     "$FNconemap_normals conemap_find_normals(conemap_frustum f, conemap_uvw at) {\n"
     "    vec3 low = conemap_end_normal(f, f.lower, at, 0.0f), high = conemap_end_normal(f, f.upper, at, f.extent.x);\n"
     "    float m = min(max(at.v, 0.0f), 1.0f), l = 1.0f, height = $HEIGHT;\n"
     "    if ((f.more.x & 32) != 0) m = m * m * (3.0f - 2.0f * m); // C1\n"
     "    l = 1.0f - m;\n"
     "    vec3 smoothed = conemap_unit(vec3(l * low.x + m * high.x, l * low.y + m * high.y, l * low.z + m * high.z));\n"
     "    vec3 grad_w = vec3(at.sine, -at.cone.y, at.cosine); // all gradients times the thickness\n"
     "    float steep = sqrt(1.0f + at.cone.y * at.cone.y);\n"
     "    smoothed = vec3(smoothed.x * steep, smoothed.y * steep, smoothed.z * steep);\n"
     "?relief     if (at.thickness > 0.0f && at.d > 1e-6f * f.extent.x) { // the relief's slopes\n"
     "?relief         float by_d = at.thickness / at.d, span = at.high - at.low;\n"
     "?relief         vec3 angle = vec3(at.cosine * by_d, 0.0f, -at.sine * by_d), slopes = conemap_slopes(f, "
     "at.u, at.v);\n"
     "?relief         vec3 a = conemap_cut_gradient(f, f.lower, at, at.low, angle, grad_w);\n"
     "?relief         vec3 b = conemap_cut_gradient(f, f.upper, at, at.high, angle, grad_w);\n"
     "?relief         float by_u = slopes.y * 0.159154943f, by_v = slopes.z / span, rest = 1.0f - at.v;\n"
     "?relief         vec3 s = vec3(by_u * angle.x - by_v * (rest * a.x + at.v * b.x),\n"
     "?relief                       by_v * (at.thickness - rest * a.y - at.v * b.y),\n"
     "?relief                       by_u * angle.z - by_v * (rest * a.z + at.v * b.z));\n"
     "?relief         grad_w = vec3(grad_w.x - s.x, grad_w.y - s.y, grad_w.z - s.z);\n"
     "?relief         smoothed = vec3(smoothed.x - s.x, smoothed.y - s.y, smoothed.z - s.z);\n"
     "?relief         height = slopes.x;\n"
     "?relief     }\n"
     "    conemap_normals n;\n"
     "    n.shading = conemap_unit(conemap_out_of(f, smoothed));\n"
     "    n.plain = conemap_unit(conemap_out_of(f, grad_w));\n"
     "    n.away = at.thickness > 0.0f ? (at.w - height) * at.thickness : at.w;\n"
     "    return n;\n"
     "}\n"},
    {"conemap_mix_normal",
     "// Adds the normal of a frustum that comes near a place of the world: all of it where the place lies on "
     "it, nothing from\n"
     "// `reach` away. `branch`: it begins inside another one, and counts only above its foot.\n"
     "$FNvec3 conemap_mix_normal(int frustum, vec3 place, float reach, bool branch, vec3 sum) {\n"
     "    conemap_frustum f = conemap_load(frustum);\n"
     "    vec3 p = conemap_place_into(f, place);\n"
     "    float weight = branch ? min(max(4.0f * p.y / (f.radii.x + f.radii.z), 0.0f), 1.0f) : 1.0f;\n"
     "    if (weight > 0.0f && p.y <= f.extent.x + reach && p.y >= -reach - f.extent.x) {\n"
     "        conemap_normals n = conemap_find_normals(f, conemap_locate(f, p));\n"
     "        float near_by = min(max(1.0f - n.away / reach, 0.0f), 1.0f);\n"
     "        weight *= near_by * near_by * (3.0f - 2.0f * near_by);\n"
     "        sum = vec3(sum.x + weight * n.shading.x, sum.y + weight * n.shading.y, sum.z + weight * n.shading.z);\n"
     "    }\n"
     "    return sum;\n"
     "}\n"},
    {"conemap_row_beside",
     "// The frustum of a chain that a place is beside, a few up or down from `frustum`.\n"
     "$FNint conemap_row_beside(int frustum, vec3 place) {\n"
     "    for (int k = 0; k < 4; ++k) {\n"
     "        conemap_frustum f = conemap_load(frustum);\n"
     "        vec3 p = conemap_place_into(f, place);\n"
     "        int next = -1;\n"
     "        if (p.y < f.lower.x * p.x + f.lower.y * p.z + f.lower.z && (f.more.x & 2) == 0) next = f.links.x;\n"
     "        if (p.y > f.upper.x * p.x + f.upper.y * p.z + f.upper.z && f.links.y >= 0) next = f.links.y;\n"
     "        if (next < 0) break;\n"
     "        frustum = next;\n"
     "    }\n"
     "    return frustum;\n"
     "}\n"},
    {"conemap_mix_branches",
     "// Mixes in the branches that leave a frustum's top, but not `except`.\n"
     "$FNvec3 conemap_mix_branches(int first, int except, vec3 place, vec3 sum) {\n"
     "    int branch = first;\n"
     "    for (int k = 0; k < 64 && branch >= 0; ++k) {\n"
     "        vec4 radii = conemap_real4(conemap_row(branch, 5));\n"
     "        if (branch != except) {\n"
     "            int beside = conemap_row_beside(branch, place);\n"
     "            sum = conemap_mix_normal(beside, place, $BLEND * (radii.x + radii.z), beside == branch, sum);\n"
     "        }\n"
     "        branch = conemap_row(branch, 7).w;\n"
     "    }\n"
     "    return sum;\n"
     "}\n"},
    {"conemap_blend",
     "// Where branches leave a chain, the normals of the surfaces that meet there are mixed: those of the "
     "branches that leave\n"
     "// the frustum's own chain nearby, and if that chain is itself a branch, of the chain it leaves and its "
     "other branches.\n"
     "$FNvec3 conemap_blend(int frustum, vec3 place, vec3 normal) {\n"
     "    int at = conemap_row(frustum, 7).y;\n"
     "    for (int up = 1; up < 4 && at >= 0; ++up) {\n"
     "        ivec4 links = conemap_row(at, 7);\n"
     "        normal = conemap_mix_branches(links.z, -1, place, normal);\n"
     "        at = links.y;\n"
     "    }\n"
     "    at = frustum;\n"
     "    for (int down = 0; down < 4 && at >= 0; ++down) {\n"
     "        ivec4 links = conemap_row(at, 7);\n"
     "        normal = conemap_mix_branches(links.z, -1, place, normal);\n"
     "        if ((conemap_row(at, 8).x & 2) != 0) { // a branch\n"
     "            vec4 radii = conemap_real4(conemap_row(at, 5));\n"
     "            int beside = conemap_row_beside(links.x, place);\n"
     "            normal = conemap_mix_normal(beside, place, $BLEND * (radii.x + radii.z), false, normal);\n"
     "            normal = conemap_mix_branches(conemap_row(links.x, 7).z, at, place, normal);\n"
     "            links.x = -1;\n"
     "        }\n"
     "        at = links.x;\n"
     "    }\n"
     "    return conemap_unit(normal);\n"
     "}\n"},
    {"conemap_frustum_hit",
     "$STRUCT conemap_frustum_hit {\n"
     "    bool found;\n"
     "    bool inside; // the ray began inside\n"
     "    int frustum, user; // that was hit; its `user`\n"
     "    int cap; // 1, 2: the flat lower, upper end of a segment\n"
     "    float t; // in lengths of the direction\n"
     "    vec3 position;\n"
     "    vec3 uvw; // of the frustum; v 0..1, w the height in the shell\n"
     "    vec2 map; // u and v of the map, not wrapped\n"
     "    vec3 normal, true_normal; // units: for shading, continuous across joints; of the surface as it is\n"
     "?c } conemap_frustum_hit;\n"
     "?!c };\n"},
    {"conemap_surface",
     "// All about a place where a ray of the frame meets a frustum.\n"
     "$FNconemap_frustum_hit conemap_surface(conemap_frustum f, int frustum, vec3 p, int face) {\n"
     "    conemap_frustum_hit hit;\n"
     "    conemap_uvw at = conemap_locate(f, p);\n"
     "    conemap_normals n = conemap_find_normals(f, at);\n"
     "    int free_ends = face == 1 ? 1 + 2 + 8 : face == 2 ? 4 + 16 : 0;\n"
     "    hit.found = true;\n"
     "    hit.inside = false;\n"
     "    hit.frustum = frustum;\n"
     "    hit.user = f.more.z;\n"
     "    hit.cap = (f.more.x & free_ends) != 0 ? face : 0; // elsewhere a plane that shows is the rounding of a seam\n"
     "    hit.t = 0.0f;\n"
     "    hit.position = conemap_place_out_of(f, p);\n"
     "    hit.uvw = vec3(at.u, min(max(at.v, 0.0f), 1.0f), at.w);\n"
     "    hit.map = conemap_map_place(f, at.u, at.v);\n"
     "    hit.normal = n.shading;\n"
     "    hit.true_normal = n.plain;\n"
     "    if (hit.cap != 0) {\n"
     "        vec4 lower = f.lower, upper = f.upper;\n"
     "        vec3 flat_end = face == 1 ? vec3(lower.x, -1.0f, lower.y) : vec3(-upper.x, 1.0f, -upper.y);\n"
     "        hit.normal = conemap_unit(conemap_out_of(f, flat_end));\n"
     "        hit.true_normal = hit.normal;\n"
     "    }\n"
     "?blends     if (hit.cap == 0) hit.normal = conemap_blend(frustum, hit.position, hit.normal);\n"
     "    return hit;\n"
     "}\n"},
    {"conemap_no_frustum",
     "$FNconemap_frustum_hit conemap_no_frustum(float t) {\n"
     "    conemap_frustum_hit hit;\n"
     "    hit.found = false;\n"
     "    hit.inside = false;\n"
     "    hit.frustum = -1;\n"
     "    hit.user = 0;\n"
     "    hit.cap = 0;\n"
     "    hit.t = t;\n"
     "    hit.position = vec3(0.0f, 0.0f, 0.0f);\n"
     "    hit.uvw = hit.position;\n"
     "    hit.map = vec2(0.0f, 0.0f);\n"
     "    hit.normal = hit.position;\n"
     "    hit.true_normal = hit.position;\n"
     "    return hit;\n"
     "}\n"},
    {"conemap_trace_frusta",
     "// The first hit of a ray of the world with `count` frusta from `first`.\n"
     "$FNconemap_frustum_hit conemap_trace_frusta(int first, int count, vec3 origin, vec3 direction, float t_min,\n"
     "                                           float t_max) {\n"
     "    conemap_frustum_hit hit = conemap_no_frustum(t_max);\n"
     "    float t = t_max;\n"
     "    int nearest = -1, face = 0;\n"
     "    for (int k = first; k < first + count; ++k) {\n"
     "        conemap_frustum f = conemap_load(k);\n"
     "        vec2 met = conemap_meet(f, conemap_place_into(f, origin), conemap_into(f, direction), t_min, t);\n"
     "        if (met.x < t || (nearest < 0 && met.x <= t)) {\n"
     "            t = met.x;\n"
     "            nearest = k;\n"
     "            face = int(met.y);\n"
     "        }\n"
     "    }\n"
     "    if (nearest >= 0) {\n"
     "        conemap_frustum f = conemap_load(nearest);\n"
     "        vec3 p = conemap_along(conemap_place_into(f, origin), conemap_into(f, direction), t);\n"
     "        hit = conemap_surface(f, nearest, p, face);\n"
     "        hit.t = t;\n"
     "        hit.inside = t <= t_min;\n"
     "    }\n"
     "    return hit;\n"
     "}\n"},
    {"conemap_any_frusta",
     "// Does a ray of the world meet any of `count` frusta from `first`? For shadows.\n"
     "$FNbool conemap_any_frusta(int first, int count, vec3 origin, vec3 direction, float t_min, float t_max) {\n"
     "    bool found = false;\n"
     "    for (int k = first; k < first + count && !found; ++k) {\n"
     "        conemap_frustum f = conemap_load(k);\n"
     "        found = conemap_meet(f, conemap_place_into(f, origin), conemap_into(f, direction), t_min, "
     "t_max).x <= t_max;\n"
     "    }\n"
     "    return found;\n"
     "}\n"},
    {"conemap_see_frustum",
     "// What a pixel sees of a frustum whose bounds were drawn there: `place` of the frame, from "
     "conemap_bounds; eye as\n"
     "// conemap_eye, (position, 1) or for parallel rays (direction, 0). Rays begin at the bounds, not at the "
     "eye: single\n"
     "// precision then holds however far the eye is.\n"
     "$FNconemap_frustum_hit conemap_see_frustum(int frustum, vec3 place, vec4 eye) {\n"
     "    conemap_frustum f = conemap_load(frustum);\n"
     "    conemap_frustum_hit hit = conemap_no_frustum(0.0f);\n"
     "    vec3 v = conemap_into(f, vec3(eye.x, eye.y, eye.z));\n"
     "    float back = 1e30f; // how far the ray begins before the place\n"
     "    if (eye.w != 0.0f) {\n"
     "        vec3 from = conemap_place_into(f, vec3(eye.x, eye.y, eye.z));\n"
     "        v = vec3(place.x - from.x, place.y - from.y, place.z - from.z);\n"
     "        back = sqrt(v.x * v.x + v.y * v.y + v.z * v.z);\n"
     "    }\n"
     "    v = conemap_unit(v);\n"
     "    vec2 met = conemap_meet(f, place, v, -back, 1e30f);\n"
     "    if (met.x < 1e30f) {\n"
     "        hit = conemap_surface(f, frustum, conemap_along(place, v, met.x), int(met.y));\n"
     "        vec3 way = vec3(hit.position.x - eye.x, hit.position.y - eye.y, hit.position.z - eye.z);\n"
     "        hit.t = eye.w != 0.0f ? sqrt(way.x * way.x + way.y * way.y + way.z * way.z) : met.x;\n"
     "        hit.inside = met.x <= -back;\n"
     "    }\n"
     "    return hit;\n"
     "}\n"},
    {"conemap_bounds",
     "// Vertex 0..35 of the twelve triangles around a frustum's shell, in its frame; see conemap_frustum_triangles.\n"
     "$FNvec3 conemap_bounds(int frustum, int number) {\n"
     "    $CORNERS;\n"
     "    return conemap_corner(conemap_load(frustum), corners[number]);\n"
     "}\n"},
    {NULL, NULL}};

/* ---- what stands before, behind and around the functions ---- */

static const char conemap__frusta_head[] =
    "?version #version $VERSION\n"
    "?relief // conemap.h: frusta with relief$MARCH.\n"
    "?!relief // conemap.h: plain frusta.\n"
    "?vertex // Draw 36 vertices for each frustum, no vertex buffer, one winding culled: either will do.\n"
    "// $FRUSTA_NAME: $FRUSTA_COMMENT\n"
    "?uses_map // $MAP_NAME: $MAP_COMMENT\n"
    "?uses_heights // $HEIGHTS_NAME: height in the first channel$FILTER_COMMENT\n"
    "?host,relief // $FETCH_NAME: the host's; $FETCH_COMMENT\n"
    "?camera // conemap_view_projection takes a column (position, 1) of the world; conemap_eye: (position, 1), or for\n"
    "?camera // parallel rays (direction, 0); conemap_first: the frustum of instance 0.\n"
    "?c #include <math.h>\n"
    "?c #include <stdbool.h>\n"
    "\n"
    "?es precision highp float;\n"
    "?es precision highp int;\n"
    "?glsl,from_buffer layout(std430$FRUSTA_LAYOUT) readonly buffer conemap_frusta_block {\n"
    "?glsl,from_buffer     ivec4 $FRUSTA_NAME[];\n"
    "?glsl,from_uniforms layout(std140$FRUSTA_LAYOUT) uniform conemap_frusta_block {\n"
    "?glsl,from_uniforms     ivec4 $FRUSTA_NAME[$ROWS];\n"
    "?glsl,from_block };\n"
    "?glsl,from_texture $FRUSTA_LAYOUTuniform $HIGHPisampler2D $FRUSTA_NAME;\n"
    "?glsl,from_texels $FRUSTA_LAYOUTuniform isamplerBuffer $FRUSTA_NAME;\n"
    "?hlsl,from_buffer StructuredBuffer<int4> $FRUSTA_NAME$FRUSTA_LAYOUT;\n"
    "?hlsl,from_texels Buffer<int4> $FRUSTA_NAME$FRUSTA_LAYOUT;\n"
    "?hlsl,from_uniforms cbuffer conemap_frusta_block$FRUSTA_LAYOUT {\n"
    "?hlsl,from_uniforms     int4 $FRUSTA_NAME[$ROWS];\n"
    "?hlsl,from_uniforms };\n"
    "?uses_map,glsl $MAP_LAYOUTuniform $SAMPLER $MAP_NAME;\n"
    "?uses_heights,glsl $HEIGHTS_LAYOUTuniform $SAMPLER $HEIGHTS_NAME;\n"
    "?uses_map,hlsl $TEXTURE<$MAP_TYPE> $MAP_NAME$MAP_LAYOUT;\n"
    "?uses_heights,hlsl $TEXTURE<float> $HEIGHTS_NAME$HEIGHTS_LAYOUT;\n"
    "?sampler SamplerState $SAMPLER_NAME$SAMPLER_LAYOUT;\n"
    "?camera,vulkan layout(push_constant) uniform conemap_camera {\n"
    "?camera,hlsl cbuffer conemap_camera$CAMERA_LAYOUT {\n"
    "?camera $UNIFORMmat4 conemap_view_projection;\n"
    "?camera,fragment,!blocks $UNIFORMvec4 conemap_eye;\n"
    "?camera,vertex,!blocks $UNIFORMint conemap_first;\n"
    "?camera,blocks $UNIFORMvec4 conemap_eye;\n"
    "?camera,blocks $UNIFORMint conemap_first;\n"
    "?camera,blocks };\n"
    "\n";

static const char conemap__frusta_host[] = /* prototypes of the host's functions */
    "?from_host ivec4 $FETCH_FRUSTA_NAME(int frustum, int row);\n"
    "?host,relief $TEXEL_TYPE $FETCH_NAME(int i, int j);\n"
    "?host_lines \n";

static const char conemap__frusta_vertex[] =
    "?glsl $IN_0out vec3 conemap_place; // in the frustum's frame\n"
    "?glsl $IN_1flat out int conemap_segment;\n"
    "?hlsl struct conemap_vertex {\n"
    "?hlsl     float3 place : TEXCOORD0; // in the frustum's frame\n"
    "?hlsl     nointerpolation int segment : TEXCOORD1;\n"
    "?hlsl     float4 position : SV_Position;\n"
    "?hlsl };\n"
    "\n"
    "?glsl void main() {\n"
    "?hlsl conemap_vertex main(uint number : SV_VertexID, uint instance : SV_InstanceID) {\n"
    "    int frustum = conemap_first + $INSTANCE;\n"
    "    vec3 place = conemap_bounds(frustum, $NUMBER);\n"
    "    vec3 position = conemap_place_out_of(conemap_load(frustum), place);\n"
    "?glsl     conemap_place = place;\n"
    "?glsl     conemap_segment = frustum;\n"
    "?glsl     gl_Position = conemap_view_projection * vec4(position, 1.0f);\n"
    "?hlsl     conemap_vertex v;\n"
    "?hlsl     v.place = place;\n"
    "?hlsl     v.segment = frustum;\n"
    "?hlsl     v.position = mul(conemap_view_projection, vec4(position, 1.0f));\n"
    "?hlsl     return v;\n"
    "}\n";

static const char conemap__frusta_fragment[] =
    "?glsl $IN_0in vec3 conemap_place; // in the frustum's frame\n"
    "?glsl $IN_1flat in int conemap_segment;\n"
    "?glsl,shaded layout(location = 0) out vec4 conemap_color;\n"
    "?glsl,coded layout(location = 0) out vec4 conemap_normal; // for shading; w: height in the shell\n"
    "?glsl,coded layout(location = 1) out vec4 conemap_coordinates; // u, v of the map; frustum; t\n"
    "?hlsl struct conemap_targets {\n"
    "?hlsl,shaded     float4 color : SV_Target0;\n"
    "?hlsl,coded     float4 normal : SV_Target0;      // for shading; w: height in the shell\n"
    "?hlsl,coded     float4 coordinates : SV_Target1; // u, v of the map; frustum; t\n"
    "?hlsl     float depth : SV_Depth;\n"
    "?hlsl };\n"
    "?shaded vec4 $SHADE_NAME(conemap_frustum_hit hit);\n"
    "\n"
    "?glsl void main() {\n"
    "?hlsl conemap_targets main(float3 place : TEXCOORD0, nointerpolation int segment : TEXCOORD1) {\n"
    "?glsl     conemap_frustum_hit hit = conemap_see_frustum(conemap_segment, conemap_place, conemap_eye);\n"
    "?hlsl     conemap_frustum_hit hit = conemap_see_frustum(segment, place, conemap_eye);\n"
    "    if (!hit.found) discard;\n"
    "?glsl     vec4 clip = conemap_view_projection * vec4(hit.position, 1.0f);\n"
    "?hlsl     float4 clip = mul(conemap_view_projection, vec4(hit.position, 1.0f));\n"
    "?glsl,halved     gl_FragDepth = 0.5f * clip.z / clip.w + 0.5f;\n"
    "?glsl,!halved     gl_FragDepth = clip.z / clip.w;\n"
    "?glsl,shaded     conemap_color = $SHADE_NAME(hit);\n"
    "?glsl,coded     conemap_normal = vec4(hit.normal, hit.uvw.z);\n"
    "?glsl,coded     conemap_coordinates = vec4(hit.map, float(hit.frustum), hit.t);\n"
    "?hlsl     conemap_targets targets;\n"
    "?hlsl,shaded     targets.color = $SHADE_NAME(hit);\n"
    "?hlsl,coded     targets.normal = vec4(hit.normal, hit.uvw.z);\n"
    "?hlsl,coded     targets.coordinates = vec4(hit.map, float(hit.frustum), hit.t);\n"
    "?hlsl     targets.depth = clip.z / clip.w;\n"
    "?hlsl     return targets;\n"
    "}\n";

/* Checks a desc and sets the emitter up: what it shares with a tracer's shader goes into that one's desc. */
static conemap_result conemap__resolve_frusta(conemap__emitter *e, conemap_frusta_shader_desc *d) {
    static const unsigned char sources[CONEMAP_DIALECT_COUNT][CONEMAP_FRUSTA_SOURCE_COUNT] = {
        /* default, then whether there are buffer, uniforms, texture, texels */
        {CONEMAP_FRUSTA_TEXELS, 0, 1, 1, 1},  {CONEMAP_FRUSTA_BUFFER, 1, 1, 1, 1},
        {CONEMAP_FRUSTA_BUFFER, 1, 1, 1, 1},  {CONEMAP_FRUSTA_BUFFER, 1, 1, 1, 1},
        {CONEMAP_FRUSTA_TEXTURE, 0, 1, 1, 0}, {CONEMAP_FRUSTA_TEXTURE, 1, 1, 1, 0},
        {CONEMAP_FRUSTA_TEXELS, 0, 1, 0, 1},  {CONEMAP_FRUSTA_BUFFER, 1, 1, 0, 1},
        {CONEMAP_FRUSTA_DEFAULT, 0, 0, 0, 0}};
    conemap_shader_desc *s = &e->desc;
    unsigned char *f = e->flags;
    conemap_skeleton_trace_desc trace;
    conemap_result result;
    int relaxed, k;
    if (!CONEMAP__KNOWN(d->stage, CONEMAP_FRUSTA_STAGE_COUNT) || !CONEMAP__KNOWN(d->march, CONEMAP_MARCH_COUNT) ||
        !CONEMAP__KNOWN(d->source, CONEMAP_FRUSTA_SOURCE_COUNT) ||
        !CONEMAP__KNOWN(d->dialect, CONEMAP_DIALECT_COUNT))
        return CONEMAP_ERROR_ENUM;
    if (d->uniform_count == 0) d->uniform_count = 113;
    if (!conemap__in_range(d->blend, 0.0f, 16.0f) || d->uniform_count < 1 || d->uniform_count > 455)
        return CONEMAP_ERROR_PARAMETER;
    memset(&trace, 0, sizeof trace);
    trace.height = d->height;
    trace.march = d->march;
    trace.steps = d->steps;
    trace.refine_steps = d->refine_steps;
    trace.linear_v = d->linear_v;
    relaxed = d->relief && (d->map.guarantee == CONEMAP_GUARANTEE_RELAXED ||
                            d->map.guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR);
    if (relaxed && d->march == CONEMAP_MARCH_CONES) return CONEMAP_ERROR_UNSUPPORTED;
    if (relaxed) trace.march = CONEMAP_MARCH_STEPS;
    result = conemap__resolve_skeleton_trace(&trace);
    if (result != CONEMAP_OK) return result;

    s->dialect = d->dialect;
    if (d->relief) {
        s->map = d->map;
        s->fixed_size = d->fixed_size;
        s->filter = d->filter;
        s->map_name = d->map_name;
        s->heights_name = d->heights_name;
        s->sampler_name = d->sampler_name;
        s->sampler_binding = d->sampler_binding;
        s->fetch = d->fetch;
    } else {
        s->fetch = d->fetch_frusta; /* no textures */
    }
    s->fetch_maxima = d->relief ? d->fetch_frusta : NULL;
    s->maxima_name = d->frusta_name;
    s->prefix = d->prefix;
    s->binding = d->binding;
    s->set = d->set;
    s->trace.tracer =
        d->relief && trace.march == CONEMAP_MARCH_CONES ? CONEMAP_TRACE_CELL_MAX : CONEMAP_TRACE_LINEAR;
    s->trace.max_steps = trace.steps;
    s->trace.refine_steps = trace.refine_steps;
    result = conemap__resolve_shader(e);
    if (result != CONEMAP_OK) return result;
    for (k = 0; k < 7; ++k)
        if (d->shade && e->given[k] && strcmp(d->shade, e->given[k]) == 0) return CONEMAP_ERROR_PARAMETER;
    if (!conemap__is_name(d->shade)) return CONEMAP_ERROR_PARAMETER;
    e->given[7] = d->shade; /* there are no octants */
    if (d->source == CONEMAP_FRUSTA_DEFAULT)
        d->source = (conemap_frusta_source)sources[d->dialect][0];
    else if (!sources[d->dialect][d->source])
        return CONEMAP_ERROR_UNSUPPORTED;
    if ((d->relief && (d->map.wrap_u != CONEMAP_WRAP ||
                       (d->map.wrap_v == CONEMAP_NOTHING && !(d->map.height == 1)))) ||
        (d->relief && d->map.texture.sectors > 1) ||
        (d->relief && d->map.texture.per_cell && d->filter != CONEMAP_FILTER_FETCH) ||
        (d->relief && d->fetch && (!d->fixed_size || d->filter != CONEMAP_FILTER_FETCH)) ||
        (f[conemap__flag_c] && (d->stage != CONEMAP_FRUSTA_FUNCTIONS || !d->fetch_frusta)) ||
        (d->stage != CONEMAP_FRUSTA_FUNCTIONS && (d->fetch || d->fetch_frusta || d->any_hit)) ||
        (d->stage != CONEMAP_FRUSTA_FRAGMENT && (d->shade || d->depth_only)) || (d->shade && d->depth_only) ||
        (d->zero_to_one && !f[conemap__flag_glsl]))
        return CONEMAP_ERROR_UNSUPPORTED;
    f[conemap__flag_relief] = d->relief != 0;
    f[conemap__flag_cone_march] = d->relief && trace.march == CONEMAP_MARCH_CONES;
    f[conemap__flag_steps_march] = d->relief && trace.march == CONEMAP_MARCH_STEPS;
    f[conemap__flag_linear_v] = d->relief && d->linear_v;
    f[conemap__flag_blends] = d->blend > 0.0f;
    f[conemap__flag_vertex] = d->stage == CONEMAP_FRUSTA_VERTEX;
    f[conemap__flag_fragment] = d->stage == CONEMAP_FRUSTA_FRAGMENT;
    f[conemap__flag_camera] = d->stage != CONEMAP_FRUSTA_FUNCTIONS;
    f[conemap__flag_shaded] = f[conemap__flag_fragment] && d->shade;
    f[conemap__flag_coded] = f[conemap__flag_fragment] && !d->shade && !d->depth_only;
    f[conemap__flag_halved] = !f[conemap__flag_vulkan] && !d->zero_to_one;
    f[conemap__flag_blocks] = f[conemap__flag_hlsl] || f[conemap__flag_vulkan];
    f[conemap__flag_any] = d->any_hit != 0;
    f[conemap__flag_version] = f[conemap__flag_glsl] && d->stage != CONEMAP_FRUSTA_FUNCTIONS;
    f[conemap__flag_from_host] = d->fetch_frusta != NULL;
    f[conemap__flag_host_lines] = d->fetch_frusta || (d->relief && d->fetch);
    f[conemap__flag_from_buffer] = !d->fetch_frusta && d->source == CONEMAP_FRUSTA_BUFFER;
    f[conemap__flag_from_uniforms] = !d->fetch_frusta && d->source == CONEMAP_FRUSTA_UNIFORMS;
    f[conemap__flag_from_texture] = !d->fetch_frusta && d->source == CONEMAP_FRUSTA_TEXTURE;
    f[conemap__flag_from_texels] = !d->fetch_frusta && d->source == CONEMAP_FRUSTA_TEXELS;
    f[conemap__flag_from_block] = f[conemap__flag_from_buffer] || f[conemap__flag_from_uniforms];
    f[conemap__flag_host] = d->relief && d->fetch;
    if (!d->relief || f[conemap__flag_vertex])
        f[conemap__flag_uses_map] = f[conemap__flag_uses_heights] = f[conemap__flag_sampler] = 0;
    f[conemap__flag_uses_maxima] = 0;
    return CONEMAP_OK;
}

/* Says what the pieces stand for that a tracer's shader does not have. */
static void conemap__frusta_pieces(conemap__emitter *e, const conemap_frusta_shader_desc *d) {
    static const char *const comments[CONEMAP_FRUSTA_SOURCE_COUNT] = {
        "the host's: row 0..8 of a conemap_frustum, as four integers", "conemap_frustum, one after the other",
        "conemap_frustum, one after the other",
        "rgba32i, nine texels for each conemap_frustum, as many of these in a row as fit whole; only fetched",
        "rgba32i, nine texels for each conemap_frustum"};
    static const char *const corners = "0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, "
                                       "1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0";
    const unsigned char *f = e->flags;
    const size_t size = CONEMAP__PIECE_SIZE;
    const int hlsl = f[conemap__flag_hlsl], uniforms = f[conemap__flag_from_uniforms],
              after = f[conemap__flag_uses_map] + f[conemap__flag_uses_heights];
    char *out;
    conemap__piece_set(e, "FRUSTA_NAME", 1,
                       d->fetch_frusta ? d->fetch_frusta
                                       : conemap__resource_name(e, 2, d->frusta_name, "_frusta"));
    conemap__piece_set(e, "FETCH_FRUSTA_NAME", 1, d->fetch_frusta ? d->fetch_frusta : "");
    conemap__piece_set(e, "FRUSTA_COMMENT", 1, comments[d->fetch_frusta ? CONEMAP_FRUSTA_DEFAULT : d->source]);
    conemap__piece_set(e, "SHADE_NAME", 1, d->shade ? d->shade : "");
    conemap__piece_set(e, "MARCH", 1,
                       f[conemap__flag_cone_march] ? ", by cone steps"
                       : f[conemap__flag_linear_v] ? ", by equal steps with v linear"
                                                   : ", by equal steps");
    conemap__piece_set(e, "REAL", 0,
                       f[conemap__flag_c] ? "conemap_real" : hlsl ? "asfloat" : "intBitsToFloat");
    conemap__piece_set(e, "ROW", 0,
                       d->fetch_frusta                ? "$FETCH_FRUSTA_NAME(frustum, row)"
                       : f[conemap__flag_from_block]  ? "$FRUSTA_NAME[9 * frustum + row]"
                       : f[conemap__flag_from_texels] ? (hlsl ? "$FRUSTA_NAME.Load(9 * frustum + row)"
                                                              : "texelFetch($FRUSTA_NAME, 9 * frustum + row)")
                           : "texelFetch($FRUSTA_NAME, ivec2(9 * (frustum % across) + row, frustum / across), 0)");
    conemap__append_int(conemap__piece_new(e, "ROWS", 0), size, 9 * d->uniform_count);
    conemap__piece_set(e, "HIGHP", 1, f[conemap__flag_es] ? "highp " : "");
    out = conemap__piece_new(e, "CORNERS", 0);
    conemap__append(out, size, f[conemap__flag_c] || hlsl ? "static const int corners[36] = {" : "const int corners[36] = int[36](");
    conemap__append(out, size, corners);
    conemap__append(out, size, f[conemap__flag_c] || hlsl ? "}" : ")");
    conemap__piece_set(e, "RELIEF_TYPE", 0, f[conemap__flag_cones] ? "vec2" : "float");
    conemap__piece_set(e, "DOT_RELIEF", 0, f[conemap__flag_cones] ? ".x" : "");
    conemap__piece_set(e, "DOT_HEIGHT", 0, f[conemap__flag_cones] ? ".x" : "");
    conemap__piece_set(e, "PIECE", 0, f[conemap__flag_linear_v] ? ", piece" : "");
    conemap__append_float(conemap__piece_new(e, "HEIGHT", 0), size, d->relief ? 0.0f : d->height);
    conemap__append_float(conemap__piece_new(e, "BLEND", 0), size, d->blend);
    out = conemap__piece_new(e, "TIMES_ASPECT", 0);
    if (e->desc.map.aspect < 1.0f || e->desc.map.aspect > 1.0f) {
        conemap__append(out, size, " * ");
        conemap__append_float(out, size, e->desc.map.aspect);
    }
    conemap__piece_set(e, "INSTANCE", 0,
                       hlsl                      ? "int(instance)"
                       : f[conemap__flag_vulkan] ? "gl_InstanceIndex"
                                                 : "gl_InstanceID");
    conemap__piece_set(e, "NUMBER", 0,
                       hlsl                      ? "int(number)"
                       : f[conemap__flag_vulkan] ? "gl_VertexIndex"
                                                 : "gl_VertexID");
    /* The map's textures come first; constant buffers of HLSL count by themselves. */
    conemap__place_resource(e, "FRUSTA_LAYOUT", f[conemap__flag_from_block] && !(hlsl && !uniforms) ? 'b' : 't',
                            e->desc.binding + (hlsl && uniforms ? 0 : after));
    conemap__place_resource(e, "CAMERA_LAYOUT", 'b', e->desc.binding + uniforms);
}

/* One pass of the emitter; with text null it only counts. */
static conemap_result conemap__emit_frusta_once(const conemap_frusta_shader_desc *desc, char *text,
                                                size_t capacity, size_t *size) {
    static const char *const functions[] = {"conemap_trace_frusta", "conemap_any_frusta", "conemap_see_frustum",
                                            "conemap_bounds"};
    conemap_frusta_shader_desc d = *desc;
    conemap__emitter e;
    conemap_result result;
    int k;
    memset(&e, 0, sizeof e);
    e.text = text;
    e.capacity = capacity;
    e.tables[1] = conemap__frusta_snippets;
    result = conemap__resolve_frusta(&e, &d);
    if (result != CONEMAP_OK) return result;
    conemap__make_pieces(&e);
    conemap__frusta_pieces(&e, &d);
    conemap__lines(&e, conemap__frusta_head, 0);
    conemap__lines(&e, conemap__frusta_host, 1); /* C: the types that they are declared with */
    conemap__lines(&e, conemap__frusta_host, 0);
    for (k = 0; k < 4 && d.stage == CONEMAP_FRUSTA_FUNCTIONS; ++k)
        if (k == 3 || (k == 1) == (d.any_hit != 0)) conemap__snippet_named(&e, functions[k], strlen(functions[k]));
    for (k = 0; k < 2 && d.stage != CONEMAP_FRUSTA_FUNCTIONS; ++k)
        conemap__lines(&e, d.stage == CONEMAP_FRUSTA_VERTEX ? conemap__frusta_vertex : conemap__frusta_fragment,
                       1 - k);
    if (e.clash) return CONEMAP_ERROR_PARAMETER;
    *size = e.size + 1;
    if (text && e.size < capacity) text[e.size] = 0;
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_emit_frusta(const conemap_frusta_shader_desc *desc, char *text,
                                                size_t capacity, size_t *size) {
    size_t needed = 0;
    conemap_result result;
    if (!desc || (!text && !size)) return CONEMAP_ERROR_NULL;
    result = conemap__emit_frusta_once(desc, NULL, 0, &needed);
    if (result != CONEMAP_OK) return result;
    if (size) *size = needed;
    if (!text) return CONEMAP_OK;
    if (capacity < needed) return CONEMAP_ERROR_BUFFER;
    return conemap__emit_frusta_once(desc, text, capacity, &needed);
}

/* ======================================================================================================
   E F F E C T S

   Vectors and numbers per fragment are floats, in functions that read the same in a shader. Flights are the
   tracers' twin for surfaces and rays that those do not know: two levels blended, holes, rays bent by a base.
   ====================================================================================================== */

#define CONEMAP__LIFT (1.0 / 1048576.0)  /* shadows and sky start so far above the surface, which is inside */
#define CONEMAP__CHUNK 32                /* rays handed to conemap_trace together */

CONEMAP__INLINE float conemap__dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

CONEMAP__INLINE void conemap__cross(const float a[3], const float b[3], float c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

CONEMAP__INLINE void conemap__add_along(const float p[3], float t, const float d[3], float q[3]) {
    q[0] = p[0] + t * d[0];
    q[1] = p[1] + t * d[1];
    q[2] = p[2] + t * d[2];
}

/* Unit length; 0 for a vector that has none. Scaled first: squares of small numbers vanish. */
static int conemap__normalise(float a[3]) {
    float x = a[0] < 0.0f ? -a[0] : a[0], y = a[1] < 0.0f ? -a[1] : a[1], z = a[2] < 0.0f ? -a[2] : a[2];
    float longest = conemap__max(conemap__max(x, y), z), length;
    int k;
    if (!(longest > 0.0f) || !conemap__finite(longest)) return 0;
    for (k = 0; k < 3; ++k) a[k] /= longest;
    length = sqrtf(conemap__dot(a, a));
    for (k = 0; k < 3; ++k) a[k] /= length;
    return 1;
}

/* ---- frames ----------------------------------------------------------------------------------------- */

/* A frame made ready: how the world moves with u, v and z, the inverse, and the curvature in box units. */
typedef struct conemap__basis {
    float axis[3][3];    /* world per u, v, z */
    float inverse[3][3]; /* row k: u, v, z per world; the gradient of that coordinate */
    float origin[3], offset[2], level;
    float bend[3];       /* how far the base falls below its tangent plane is (b0 u^2 + 2 b1 u v + b2 v^2) / 2, in z */
} conemap__basis;

CONEMAP__INLINE int conemap__all_finite(const float *values, int count) {
    int k;
    for (k = 0; k < count; ++k)
        if (!conemap__finite(values[k])) return 0;
    return 1;
}

CONEMAP__INLINE float conemap__magnitude(float x) { return x < 0.0f ? -x : x; }

/* flatten: 0 the frame's own depth, towards 1 less of it. toward: the viewing direction if the frame is two-sided. */
static conemap_result conemap__resolve_frame(const conemap_frame *frame, float flatten, const float *toward, int curved,
                                             conemap__basis *basis) {
    static const float plain[3][3] = {{1.0f, 0.0f, 0.0f}, {0.0f, 1.0f, 0.0f}, {0.0f, 0.0f, 1.0f}};
    float scale_u, scale_v, depth, size, determinant, c0, c1, c2;
    int k, c;
    memset(basis, 0, sizeof *basis);
    memcpy(basis->axis, plain, sizeof plain);
    memcpy(basis->inverse, plain, sizeof plain);
    if (!frame) return CONEMAP_OK;
    if (!conemap__all_finite(frame->origin, 3) || !conemap__all_finite(frame->tangent, 3) ||
        !conemap__all_finite(frame->bitangent, 3) || !conemap__all_finite(frame->normal, 3) ||
        !conemap__all_finite(frame->uv_offset, 2) || !conemap__all_finite(frame->uv_scale, 2) ||
        !conemap__all_finite(frame->curvature, 3) || !conemap__in_range(frame->depth, 0.0f, 1e18f) ||
        !conemap__in_range(frame->level, 0.0f, 1.0f) ||
        (frame->aspect != 0.0f && !conemap__in_range(frame->aspect, 1.0f / 32768.0f, 32768.0f)))
        return CONEMAP_ERROR_PARAMETER;
    depth = frame->depth == 0.0f ? 1.0f : frame->depth;
    scale_u = frame->uv_scale[0] == 0.0f ? 1.0f : frame->uv_scale[0];
    scale_v = (frame->uv_scale[1] == 0.0f ? 1.0f : frame->uv_scale[1]) / (frame->aspect == 0.0f ? 1.0f : frame->aspect);
    c0 = conemap__magnitude(frame->curvature[0]);
    c1 = conemap__magnitude(frame->curvature[1]);
    c2 = conemap__magnitude(frame->curvature[2]);
    if (curved && !(conemap__max(c0, c2) + c1 < 1.0f / depth)) return CONEMAP_ERROR_PARAMETER;
    depth *= 1.0f - flatten;
    memcpy(basis->origin, frame->origin, sizeof basis->origin);
    memcpy(basis->offset, frame->uv_offset, sizeof basis->offset);
    basis->level = frame->level;
    if (conemap__dot(frame->tangent, frame->tangent) + conemap__dot(frame->bitangent, frame->bitangent) +
            conemap__dot(frame->normal, frame->normal) > 0.0f) {
        memcpy(basis->axis[0], frame->tangent, sizeof basis->axis[0]);
        memcpy(basis->axis[1], frame->bitangent, sizeof basis->axis[1]);
        memcpy(basis->axis[2], frame->normal, sizeof basis->axis[2]);
    }
    if (toward) { /* seen from behind: the plane's own normal decides, which a skewed frame's need not be */
        float normal[3];
        conemap__cross(basis->axis[0], basis->axis[1], normal);
        if (conemap__dot(normal, basis->axis[2]) * conemap__dot(normal, toward) > 0.0f)
            for (k = 0; k < 3; ++k) basis->axis[2][k] = -basis->axis[2][k];
    }
    for (k = 0; k < 3; ++k) {
        basis->axis[0][k] /= scale_u;
        basis->axis[1][k] /= scale_v;
        basis->axis[2][k] *= depth;
    }
    conemap__cross(basis->axis[1], basis->axis[2], basis->inverse[0]);
    conemap__cross(basis->axis[2], basis->axis[0], basis->inverse[1]);
    conemap__cross(basis->axis[0], basis->axis[1], basis->inverse[2]);
    determinant = conemap__dot(basis->axis[0], basis->inverse[0]);
    size = sqrtf(conemap__dot(basis->axis[0], basis->axis[0])) * sqrtf(conemap__dot(basis->axis[1], basis->axis[1])) *
           sqrtf(conemap__dot(basis->axis[2], basis->axis[2]));
    if (!(conemap__magnitude(determinant) > 1e-6f * size)) return CONEMAP_ERROR_PARAMETER;
    for (k = 0; k < 3; ++k)
        for (c = 0; c < 3; ++c) basis->inverse[k][c] /= determinant;
    if (curved) {
        basis->bend[0] = frame->curvature[0] / (scale_u * scale_u * depth);
        basis->bend[1] = frame->curvature[1] / (scale_u * scale_v * depth);
        basis->bend[2] = frame->curvature[2] / (scale_v * scale_v * depth);
    }
    for (k = 0; k < 3; ++k)
        if (!conemap__all_finite(basis->axis[k], 3) || !conemap__all_finite(basis->inverse[k], 3) ||
            !conemap__finite(basis->bend[k]))
            return CONEMAP_ERROR_PARAMETER;
    return CONEMAP_OK;
}

/* A world direction per u, v and z. */
CONEMAP__INLINE void conemap__direction_to_box(const conemap__basis *basis, const float world[3], float box[3]) {
    box[0] = conemap__dot(basis->inverse[0], world);
    box[1] = conemap__dot(basis->inverse[1], world);
    box[2] = conemap__dot(basis->inverse[2], world);
}

CONEMAP__INLINE void conemap__ray_to_box(const conemap__basis *basis, const conemap_ray *world, conemap_ray *box) {
    float from[3];
    conemap__add_along(world->origin, -1.0f, basis->origin, from);
    box->t_min = world->t_min;
    box->t_max = world->t_max;
    conemap__direction_to_box(basis, world->direction, box->direction);
    conemap__direction_to_box(basis, from, box->origin);
    box->origin[0] += basis->offset[0];
    box->origin[1] += basis->offset[1];
    box->origin[2] += basis->level;
}

/* How far the base lies below its tangent plane at (u, v), in z. */
CONEMAP__INLINE float conemap__drop(const conemap__basis *basis, float u, float v) {
    float x = u - basis->offset[0], y = v - basis->offset[1];
    return 0.5f * (basis->bend[0] * x * x + 2.0f * basis->bend[1] * x * y + basis->bend[2] * y * y);
}

/* How that grows along (du, dv). */
CONEMAP__INLINE float conemap__drop_along(const conemap__basis *basis, float u, float v, float du, float dv) {
    float x = u - basis->offset[0], y = v - basis->offset[1];
    return (basis->bend[0] * x + basis->bend[1] * y) * du + (basis->bend[1] * x + basis->bend[2] * y) * dv;
}

/* And half of how its growth grows: along a ray the height over the base is z0 + z1 t + bend t^2. */
CONEMAP__INLINE float conemap__bend_along(const conemap__basis *basis, float du, float dv) {
    return 0.5f * (basis->bend[0] * du * du + 2.0f * basis->bend[1] * du * dv + basis->bend[2] * dv * dv);
}

CONEMAP__INLINE void conemap__point_to_world(const conemap__basis *basis, const float box[3], float world[3]) {
    memcpy(world, basis->origin, sizeof basis->origin);
    conemap__add_along(world, box[0] - basis->offset[0], basis->axis[0], world);
    conemap__add_along(world, box[1] - basis->offset[1], basis->axis[1], world);
    conemap__add_along(world, box[2] - basis->level - conemap__drop(basis, box[0], box[1]), basis->axis[2], world);
}

/* Gradients of the box's coordinates are the rows of the inverse, so the surface z = h - drop has the gradient
   row2 - z_u row0 - z_v row1, which points to its outer side in mirrored frames too. */
CONEMAP__INLINE int conemap__normal_to_world(const conemap__basis *basis, float u, float v, float dhdu, float dhdv,
                                             float normal[3]) {
    float zu = dhdu - conemap__drop_along(basis, u, v, 1.0f, 0.0f);
    float zv = dhdv - conemap__drop_along(basis, u, v, 0.0f, 1.0f);
    conemap__add_along(basis->inverse[2], -zu, basis->inverse[0], normal);
    conemap__add_along(normal, -zv, basis->inverse[1], normal);
    return conemap__normalise(normal);
}

CONEMAP__DEF conemap_result conemap_frame_ray(const conemap_frame *frame, const conemap_ray *world, conemap_ray *box) {
    conemap__basis basis;
    conemap_ray ray;
    conemap_result result;
    if (!frame || !world || !box) return CONEMAP_ERROR_NULL;
    result = conemap__resolve_frame(frame, 0.0f, NULL, 0, &basis);
    if (result != CONEMAP_OK) return result;
    conemap__ray_to_box(&basis, world, &ray);
    *box = ray;
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_frame_point(const conemap_frame *frame, const float box[3], float world[3]) {
    conemap__basis basis;
    conemap_result result;
    float point[3];
    if (!frame || !box || !world) return CONEMAP_ERROR_NULL;
    result = conemap__resolve_frame(frame, 0.0f, NULL, 1, &basis);
    if (result != CONEMAP_OK) return result;
    conemap__point_to_world(&basis, box, point);
    memcpy(world, point, sizeof point);
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_frame_normal(const conemap_frame *frame, float u, float v, const float slope[2],
                                                 float normal[3]) {
    conemap__basis basis;
    conemap_result result;
    float n[3];
    if (!frame || !slope || !normal) return CONEMAP_ERROR_NULL;
    result = conemap__resolve_frame(frame, 0.0f, NULL, 1, &basis);
    if (result != CONEMAP_OK) return result;
    if (!conemap__finite(u) || !conemap__finite(v) || !conemap__all_finite(slope, 2) ||
        !conemap__normal_to_world(&basis, u, v, slope[0], slope[1], n))
        return CONEMAP_ERROR_PARAMETER;
    memcpy(normal, n, sizeof n);
    return CONEMAP_OK;
}

/* Where a ray meets the plane z = level; 0 if it does not, ahead. */
static int conemap__meet_plane(const conemap__basis *basis, const conemap_ray *world, float uv[2]) {
    conemap_ray box;
    float t;
    if (!conemap__all_finite(world->origin, 3) || !conemap__all_finite(world->direction, 3)) return 0;
    conemap__ray_to_box(basis, world, &box);
    t = (basis->level - box.origin[2]) / box.direction[2];
    if (box.direction[2] == 0.0f || !conemap__finite(t) || t < 0.0f) return 0;
    uv[0] = box.origin[0] + t * box.direction[0];
    uv[1] = box.origin[1] + t * box.direction[1];
    return 1;
}

CONEMAP__DEF conemap_result conemap_gradient_at(const conemap_frame *frame, const conemap_ray *ray,
                                                const conemap_ray *right, const conemap_ray *below,
                                                conemap_gradient *gradient) {
    conemap__basis basis;
    conemap_result result;
    float uv[3][2];
    if (!frame || !ray || !right || !below || !gradient) return CONEMAP_ERROR_NULL;
    result = conemap__resolve_frame(frame, 0.0f, NULL, 0, &basis);
    if (result != CONEMAP_OK) return result;
    if (!conemap__meet_plane(&basis, ray, uv[0]) || !conemap__meet_plane(&basis, right, uv[1]) ||
        !conemap__meet_plane(&basis, below, uv[2]))
        return CONEMAP_ERROR_PARAMETER;
    gradient->dudx = uv[1][0] - uv[0][0];
    gradient->dvdx = uv[1][1] - uv[0][1];
    gradient->dudy = uv[2][0] - uv[0][0];
    gradient->dvdy = uv[2][1] - uv[0][1];
    return CONEMAP_OK;
}

/* A derivative as the texture returns it, per texel. */
static float conemap__stored_difference(const conemap_map *map, size_t at, int along_v) {
    const conemap_texture *texture = &map->info.texture;
    size_t width = (size_t)map->info.width;
    float d = conemap__difference(map, (int)(at % width), (int)(at / width), along_v);
    int flip = along_v && texture->flip_dv;
    if (texture->layout != CONEMAP_DUMMER) return d;
    d = conemap__value(texture->format, conemap__code_near(texture->format, flip ? 0.5f - d : 0.5f + d)) - 0.5f;
    return flip ? -d : d;
}

CONEMAP__DEF conemap_result conemap_smooth_slope(const conemap_map *map, float u, float v, float slope[2]) {
    conemap__quad quad;
    float x, y;
    int i, j, k;
    if (!map || !map->heights || !slope) return CONEMAP_ERROR_NULL;
    if (!conemap__locate(u, map->info.width, map->info.wrap_u, &i, &x) ||
        !conemap__locate(v, map->info.height, map->info.wrap_v, &j, &y))
        return CONEMAP_ERROR_POSITION;
    quad = conemap__cell_quad(map, i, j);
    for (k = 0; k < 2; ++k) {
        conemap__corners c;
        c.h00 = conemap__stored_difference(map, quad.at00, k);
        c.h10 = conemap__stored_difference(map, quad.at10, k);
        c.h01 = conemap__stored_difference(map, quad.at01, k);
        c.h11 = conemap__stored_difference(map, quad.at11, k);
        slope[k] = conemap__bilinear(c, x, y) * (float)(k ? map->info.height : map->info.width);
    }
    return CONEMAP_OK;
}

CONEMAP__DEF conemap_result conemap_depth(const float view_projection[16], const float position[3],
                                          conemap_depth_range range, float *depth) {
    const float *m = view_projection, *p = position;
    float z, w, d;
    if (!m || !p || !depth) return CONEMAP_ERROR_NULL;
    if (!CONEMAP__KNOWN(range, CONEMAP_DEPTH_RANGE_COUNT)) return CONEMAP_ERROR_ENUM;
    z = p[0] * m[2] + p[1] * m[6] + p[2] * m[10] + m[14];
    w = p[0] * m[3] + p[1] * m[7] + p[2] * m[11] + m[15];
    if (!conemap__finite(z) || !conemap__finite(w) || !(w > 0.0f)) return CONEMAP_ERROR_PARAMETER;
    d = range == CONEMAP_DEPTH_ZERO_TO_ONE ? z / w : 0.5f + 0.5f * (z / w);
    if (!conemap__finite(d)) return CONEMAP_ERROR_PARAMETER;
    *depth = d;
    return CONEMAP_OK;
}

/* ---- levels ----------------------------------------------------------------------------------------- */

CONEMAP__DEF int conemap_level_count(int width, int height) {
    int count = 1, longest = conemap__maxi(width, height);
    if (width < 1 || height < 1 || longest > CONEMAP_MAX_SIZE) return 0;
    for (; longest > 1; longest >>= 1) ++count;
    return count;
}

/* Weight of texel k of `from` in texel i of `to`, over which the weights sum to `from`: the overlap of the two. */
CONEMAP__INLINE double conemap__overlap(int i, int to, int k, int from) {
    double low = (double)i * (double)from, high = low + (double)from;
    double a = (double)k * (double)to, b = a + (double)to;
    return (high < b ? high : b) - (low > a ? low : a);
}

/* The mean of the heights under each texel of the next level. */
static void conemap__next_level(const conemap_map *map, int width, int height, float *heights) {
    int w = map->info.width, h = map->info.height, x, y, i, j;
    for (y = 0; y < height; ++y)
        for (x = 0; x < width; ++x) {
            double sum = 0.0;
            int i0 = (int)((int64_t)x * w / width), i1 = (int)(((int64_t)(x + 1) * w + width - 1) / width);
            int j0 = (int)((int64_t)y * h / height), j1 = (int)(((int64_t)(y + 1) * h + height - 1) / height);
            for (j = j0; j < j1; ++j) {
                double row = 0.0;
                for (i = i0; i < i1; ++i) row += conemap__overlap(x, width, i, w) * (double)conemap__height(map, i, j);
                sum += conemap__overlap(y, height, j, h) * row;
            }
            heights[(size_t)y * (size_t)width + (size_t)x] =
                (float)conemap__clamp01(sum / ((double)w * (double)h));
        }
}

CONEMAP__DEF conemap_result conemap_build_levels(const conemap_desc *desc, conemap_map *maps, int count) {
    conemap_desc next;
    conemap_result result;
    void *buffer = NULL;
    int k, owns = 0;
    if (!desc || !maps) return CONEMAP_ERROR_NULL;
    if (count < 1) return CONEMAP_ERROR_PARAMETER;
    memset(maps, 0, (size_t)count * sizeof *maps);
    if (desc->memory || desc->scratch) return CONEMAP_ERROR_UNSUPPORTED;
    result = conemap_memory(desc, NULL, NULL);
    if (result == CONEMAP_OK && count > conemap_level_count(desc->heights.width, desc->heights.height))
        result = CONEMAP_ERROR_PARAMETER;
    if (result == CONEMAP_OK) result = conemap_build(desc, &maps[0]);
    next = *desc;
    if (result == CONEMAP_OK && count > 1)
        result = conemap__take(&desc->allocator, NULL, 0,
                               (size_t)conemap__maxi(desc->heights.width / 2, 1) *
                                   (size_t)conemap__maxi(desc->heights.height / 2, 1) * sizeof(float),
                               &buffer, &owns);
    for (k = 1; k < count && result == CONEMAP_OK; ++k) {
        memset(&next.heights, 0, sizeof next.heights);
        next.heights.pixels = buffer;
        next.heights.width = conemap__maxi(maps[k - 1].info.width / 2, 1);
        next.heights.height = conemap__maxi(maps[k - 1].info.height / 2, 1);
        conemap__next_level(&maps[k - 1], next.heights.width, next.heights.height, (float *)buffer);
        result = conemap_build(&next, &maps[k]);
    }
    if (buffer) conemap__release(&desc->allocator, buffer, owns);
    if (result != CONEMAP_OK)
        for (k = 0; k < count; ++k) conemap_free(&maps[k]);
    return result;
}

/* ---- flights ---------------------------------------------------------------------------------------- */

/* What rays fly over: a map, or two levels of one blended, within a rectangle of uv, perhaps with holes. */
typedef struct conemap__scene {
    const conemap_map *map[2];
    double weight[2];
    int maps;
    double low[2], high[2];     /* the rectangle that has a surface; endless: -NEVER, NEVER */
    const unsigned char *alpha; /* null: no holes */
    ptrdiff_t alpha_stride;
    int alpha_width, alpha_height, alpha_cut;
} conemap__scene;

/* One lattice under a flight: the bilinear cells of a level, or the squares of the alpha texels. */
typedef struct conemap__lattice {
    double px, py, vx, vy;   /* at t = 0, in cells from the base cell; per t */
    double leave_i, leave_j; /* when the present cell is left */
    int base_i, base_j, i, j;
    const float *cones;      /* of the level; with sectors, of the one that the flight goes into, bent or not */
} conemap__lattice;

/* A ray above a scene. Its height is a parabola: the base that the relief stands on is a quadric, and along a
   straight ray a quadric is a polynomial of degree two. Positions are straight, so in a cell the surface's height is
   of degree two as well, for two levels as for one, and the clearance is met exactly by one square root.

   Cones under a parabola. The cone at p holds nothing of the surface: h(q) <= h(p) + |q - p| / tan for every q. From
   t = 0 above p the ray has height z + z' t + b t^2 and distance s t from p, so it is clear of the surface wherever
       (z - h(p)) + (z' - s / tan) t + b t^2 > 0,
   that is up to the first positive root, or for ever if there is none. Nothing is lost to a bound on the curvature:
   the cone is not narrowed, the ray is bent. With b = 0 it is the cone step of [Dum06]. Between levels 1 / tan is
   blended, as conemap_build_levels proves. */
typedef struct conemap__course {
    const conemap__scene *scene;
    conemap__lattice lattice[3];
    int lattices, cones, solid, wall; /* wall: the axis, 1 u or 2 v, whose border was crossed last on entering solid */
    double z0, z1, z2, highest, speed;
    double t, t_end, t_start; /* t counts from t_start, the caller's from 0 */
    conemap_status end_status;
} conemap__course;

/* Where the surface of one map lies along an axis. */
static void conemap__extent(const conemap_info *info, int axis, double *low, double *high) {
    conemap_wrap wrap = axis ? info->wrap_v : info->wrap_u;
    int size = axis ? info->height : info->width;
    double border = wrap == CONEMAP_NOTHING && size > 1 ? 0.5 / (double)size : 0.0;
    *low = wrap == CONEMAP_WRAP ? -CONEMAP__NEVER : border;
    *high = wrap == CONEMAP_WRAP ? CONEMAP__NEVER : 1.0 - border;
}

static void conemap__add_map(conemap__scene *scene, const conemap_map *map, double weight) {
    int axis;
    for (axis = 0; axis < 2; ++axis) {
        double low, high;
        conemap__extent(&map->info, axis, &low, &high);
        if (scene->maps == 0 || low > scene->low[axis]) scene->low[axis] = low;
        if (scene->maps == 0 || high < scene->high[axis]) scene->high[axis] = high;
    }
    scene->map[scene->maps] = map;
    scene->weight[scene->maps++] = weight;
}

static void conemap__lay(const conemap_info *info, int width, int height, double shift, const double at[2],
                         const double v[2], conemap__lattice *l) {
    int cells_u = shift > 0.0 ? conemap__cell_count(width, info->wrap_u) : width;
    int cells_v = shift > 0.0 ? conemap__cell_count(height, info->wrap_v) : height;
    l->base_i = conemap__enter_cells(at[0], width, info->wrap_u, shift, cells_u, &l->px);
    l->base_j = conemap__enter_cells(at[1], height, info->wrap_v, shift, cells_v, &l->py);
    l->vx = v[0] * (double)width;
    l->vy = v[1] * (double)height;
    l->i = l->j = 0;
}

/* Sets a flight up; 0 if it never comes over the surface. z: height at t = 0, its growth, and the bend. t_max 0:
   none. */
static int conemap__take_off(const conemap__scene *scene, const double o[2], const double v[2], const double z[3],
                             double t_min, double t_max, conemap__course *f) {
    const conemap_info *info = &scene->map[0]->info;
    double t0 = t_min, t1 = t_max == 0.0 || t_max > (double)CONEMAP__FAR ? CONEMAP__NEVER : t_max, leave, reach, at[2];
    int k, relaxed = 0;
    memset(f, 0, sizeof *f);
    f->scene = scene;
    f->t_start = t0;
    f->t_end = 0.0;
    f->end_status = CONEMAP_LEFT;
    leave = t1;
    if (!conemap__clip(o[0], v[0], scene->low[0], scene->high[0], 1, &t0, &leave, &f->wall, NULL) ||
        !conemap__clip(o[1], v[1], scene->low[1], scene->high[1], 2, &t0, &leave, &f->wall, NULL))
        return 0;
    if (z[0] + (z[1] + z[2] * t0) * t0 < 0.0) { /* up to the floor, through which it comes in */
        conemap__quadratic below = {-(z[0] + (z[1] + z[2] * t0) * t0), -(z[1] + 2.0 * z[2] * t0), -z[2]};
        double up = conemap__first_zero(below, leave - t0);
        if (up >= CONEMAP__NEVER) return 0;
        t0 += up;
        f->wall = 0;
    }
    f->end_status = leave < t1 ? CONEMAP_LEFT : CONEMAP_T_MAX;
    reach = CONEMAP__REACH / ((v[0] < 0.0 ? -v[0] : v[0]) * (double)info->width +
                                     (v[1] < 0.0 ? -v[1] : v[1]) * (double)info->height + 1e-30);
    if ((info->wrap_u == CONEMAP_WRAP || info->wrap_v == CONEMAP_WRAP) && leave - t0 > reach) {
        leave = t0 + reach;
        f->end_status = CONEMAP_STEP_CAP;
    }
    f->t_start = t0;
    f->t_end = leave - t0;
    f->z0 = z[0] + (z[1] + z[2] * t0) * t0;
    f->z1 = z[1] + 2.0 * z[2] * t0;
    f->z2 = z[2];
    f->speed = sqrt(v[0] * v[0] + (double)info->aspect * (double)info->aspect * v[1] * v[1]);
    at[0] = o[0] + v[0] * t0;
    at[1] = o[1] + v[1] * t0;
    for (k = 0; k < scene->maps; ++k) {
        const conemap_map *map = scene->map[k];
        conemap__lay(&map->info, map->info.width, map->info.height, 0.5, at, v, &f->lattice[k]);
        f->lattice[k].cones =
            map->cones + (size_t)conemap__sector_number(&map->info, v[0], v[1]) * conemap__texels(map);
        f->highest += scene->weight[k] * (double)map->highest;
        relaxed |= map->info.guarantee == CONEMAP_GUARANTEE_RELAXED ||
                   map->info.guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR;
    }
    f->cones = !relaxed;
    f->lattices = scene->maps;
    if (scene->alpha) {
        for (k = 0; k < 2; ++k) at[k] += v[k] < 0.0 ? -1e-12 : 1e-12; /* a border on which it begins is behind it */
        conemap__lay(info, scene->alpha_width, scene->alpha_height, 0.0, at, v, &f->lattice[f->lattices++]);
    }
    return 1;
}

CONEMAP__INLINE double conemap__border(double p, double v, int cell) {
    return v > 0.0 ? ((double)(cell + 1) - p) / v : v < 0.0 ? ((double)cell - p) / v : CONEMAP__NEVER;
}

/* Until when the flight stays in its present cells. */
static double conemap__stay(conemap__course *f) {
    double end = CONEMAP__NEVER;
    int k;
    for (k = 0; k < f->lattices; ++k) {
        conemap__lattice *l = &f->lattice[k];
        l->leave_i = conemap__border(l->px, l->vx, l->i);
        l->leave_j = conemap__border(l->py, l->vy, l->j);
        if (l->leave_i < end) end = l->leave_i;
        if (l->leave_j < end) end = l->leave_j;
    }
    return end > f->t ? end : f->t;
}

/* Over a border, or farther: the cell of the position then, but never behind the cell before, whatever rounding
   says. */
CONEMAP__INLINE int conemap__onward(double p, double v, double t, double leave, int cell, int jump) {
    int next = v > 0.0 ? cell + (leave <= t) : v < 0.0 ? cell - (leave <= t) : cell, there;
    if (!jump || v == 0.0) return next;
    there = conemap__floord(p + v * t);
    return v > 0.0 ? conemap__maxi(next, there) : conemap__mini(next, there);
}

/* Moves to t, which is `end` or later. */
static void conemap__fly_on(conemap__course *f, double t, double end) {
    int k, jump = t > end;
    for (k = 0; k < f->lattices; ++k) {
        conemap__lattice *l = &f->lattice[k];
        if (k == f->scene->maps && (l->leave_i <= t || l->leave_j <= t)) f->wall = l->leave_i <= l->leave_j ? 1 : 2;
        l->i = conemap__onward(l->px, l->vx, t, l->leave_i, l->i, jump);
        l->j = conemap__onward(l->py, l->vy, t, l->leave_j, l->j, jump);
    }
    f->t = t;
}

/* Is the flight over a hole? */
static int conemap__over_hole(const conemap__course *f) {
    const conemap__scene *scene = f->scene;
    const conemap__lattice *l = &f->lattice[scene->maps];
    const conemap_info *info = &scene->map[0]->info;
    ptrdiff_t i, j;
    if (!scene->alpha) return 0;
    i = conemap__texel_index(l->base_i + l->i, scene->alpha_width, info->wrap_u);
    j = conemap__texel_index(l->base_j + l->j, scene->alpha_height, info->wrap_v);
    return (int)scene->alpha[j * scene->alpha_stride + i] < scene->alpha_cut;
}

/* The surface's height under the flight from now on, in the present cells; and the cones' tangent here, if asked
   for. */
static conemap__quadratic conemap__ground(const conemap__course *f, double *tangent) {
    conemap__quadratic sum = {0.0, 0.0, 0.0};
    double steepness = 0.0;
    int k, closed = 0;
    for (k = 0; k < f->scene->maps; ++k) {
        const conemap_map *map = f->scene->map[k];
        const conemap__lattice *l = &f->lattice[k];
        conemap__quad quad = conemap__cell_quad(map, l->base_i + l->i, l->base_j + l->j);
        conemap__corners h = conemap__gather(map->heights, quad);
        double x = conemap__clamp01(l->px + l->vx * f->t - (double)l->i);
        double y = conemap__clamp01(l->py + l->vy * f->t - (double)l->j), w = f->scene->weight[k];
        double h00 = (double)h.h00, hx = (double)h.h10 - h00, hy = (double)h.h01 - h00;
        double hxy = (double)h.h11 - (double)h.h01 - hx;
        sum.c += w * (h00 + hx * x + hy * y + hxy * (x * y));
        sum.b += w * (hx * l->vx + hy * l->vy + hxy * (x * l->vy + y * l->vx));
        sum.a += w * (hxy * (l->vx * l->vy));
        if (tangent) {
            double t = (double)conemap__sample_cell(map, l->cones, quad, (float)x, (float)y).tangent;
            if (t > 0.0)
                steepness += w / t;
            else
                closed |= w > 0.0;
        }
    }
    if (tangent) *tangent = closed ? 0.0 : 1.0 / steepness;
    return sum;
}

CONEMAP__INLINE double conemap__flight_z(const conemap__course *f, double t) { return f->z0 + (f->z1 + f->z2 * t) * t; }
CONEMAP__INLINE double conemap__flight_rise(const conemap__course *f, double t) { return f->z1 + 2.0 * f->z2 * t; }

/* How far the flight may go on from here without meeting anything: down to the highest texel, or to the end of the
   cone. `gap` over the surface. 0: no farther than the cell. */
static double conemap__free_way(const conemap__course *f, double gap, double tangent) {
    double z = conemap__flight_z(f, f->t), rise = conemap__flight_rise(f, f->t);
    conemap__quadratic room;
    room.a = f->z2;
    if (z > f->highest) {
        room.c = z - f->highest;
        room.b = rise;
        return conemap__first_zero(room, CONEMAP__NEVER);
    }
    if (!f->cones || !(tangent > 0.0) || gap <= CONEMAP__LIFT || f->speed == 0.0) return 0.0;
    room.c = gap - CONEMAP__LIFT; /* the interpolated apex is off by 1e-7, as in TRACERS */
    room.b = rise - f->speed / tangent;
    return conemap__first_zero(room, CONEMAP__NEVER);
}

/* Follows the flight to its first meeting. Returns how it ends; f->t is then where, f->solid whether inside. */
static conemap_status conemap__fly(conemap__course *f, int max_steps, int *steps) {
    int was_hole = 1; /* what is met at once is met from outside */
    for (*steps = 1;; ++*steps) {
        double end = conemap__stay(f), next, tangent = 0.0, gap;
        int hole = conemap__over_hole(f);
        conemap__quadratic way = conemap__ground(f, f->cones ? &tangent : NULL);
        if (end > f->t_end) end = f->t_end;
        gap = conemap__flight_z(f, f->t) - way.c;
        if (!hole) {
            double t;
            way.c = gap;
            way.b = conemap__flight_rise(f, f->t) - way.b;
            way.a = f->z2 - way.a;
            t = conemap__first_zero(way, end - f->t);
            f->solid = gap <= 0.0 && was_hole;
            if (t < CONEMAP__NEVER) {
                f->t += t;
                return CONEMAP_HIT;
            }
        } else { /* the floor is all there is to meet */
            conemap__quadratic fall = {conemap__flight_z(f, f->t), conemap__flight_rise(f, f->t), f->z2};
            double t = conemap__first_zero(fall, end - f->t);
            if (t < CONEMAP__NEVER) {
                f->t += t;
                return CONEMAP_FLOOR;
            }
        }
        was_hole = hole;
        if (end >= f->t_end) {
            f->t = f->t_end;
            return f->end_status;
        }
        if (max_steps && *steps >= max_steps) return CONEMAP_STEP_CAP;
        next = f->t + conemap__free_way(f, gap, tangent);
        if (next > end) was_hole = 0; /* what it flies down to from above is no wall, whatever rounding says */
        if (next >= f->t_end) {
            double z = conemap__flight_z(f, f->t_end);
            f->t = f->t_end;
            return f->t_end >= CONEMAP__NEVER || z > 1.0 ? CONEMAP_LEFT : f->end_status;
        }
        conemap__fly_on(f, next > end ? next : end, end);
    }
}

/* The steepest growth z1, from `low` to `high`, at which the flight still touches what lies under it: the horizon,
   as seen from where it takes off. It flies at `low`; whatever rises above it bends it up to touch, exactly, and so
   it goes on: what was passed below the lower flight is below the higher one. At `high` there is nothing left to
   learn, nor where the highest texel could raise the horizon by `grain` at most: on maps that wrap peaks of one
   height never end. */
static double conemap__horizon(conemap__course *f, double low, double high, double grain) {
    f->z1 = low;
    for (;;) {
        double end = conemap__stay(f), next, tangent = 0.0, gap;
        double above = f->highest - f->z0 - f->z2 * f->t * f->t; /* below 0 the horizon rises with t */
        if (f->z2 >= 0.0 && above <= (f->z1 + grain) * (above > 0.0 ? f->t : f->t_end)) return f->z1;
        int hole = conemap__over_hole(f);
        conemap__quadratic ground = conemap__ground(f, f->cones ? &tangent : NULL), way;
        if (end > f->t_end) end = f->t_end;
        gap = conemap__flight_z(f, f->t) - ground.c;
        way.c = gap;
        way.b = conemap__flight_rise(f, f->t) - ground.b;
        way.a = f->z2 - ground.a;
        if (!hole && conemap__first_zero(way, end - f->t) < CONEMAP__NEVER) {
            /* with ground - z0 - z2 t^2 = A + B t + C t^2 from t = 0: the greatest of A / t + B + C t */
            double c = ground.a - f->z2, b = ground.b - 2.0 * ground.a * f->t;
            double a = ground.c - f->z0 - (ground.b - ground.a * f->t) * f->t, rise = f->z1;
            if (a > 0.0 && f->t == 0.0) return high; /* begins inside */
            if (f->t > 0.0 && a / f->t + b + c * f->t > rise) rise = a / f->t + b + c * f->t;
            if (end > 0.0 && end < CONEMAP__NEVER && a / end + b + c * end > rise) rise = a / end + b + c * end;
            if (a < 0.0 && c < 0.0) {
                double t = sqrt(a / c);
                if (t > f->t && t < end && a / t + b + c * t > rise) rise = a / t + b + c * t;
            }
            if (rise >= high) return high;
            f->z1 = rise;
            gap = conemap__flight_z(f, f->t) - ground.c;
        }
        if (end >= f->t_end) return f->z1;
        next = f->t + conemap__free_way(f, gap, tangent);
        if (next >= f->t_end) return f->z1;
        conemap__fly_on(f, next > end ? next : end, end);
    }
}

/* ---- light ------------------------------------------------------------------------------------------ */

/* The share of a disc's strip from y0 to y1 that stands above a horizon which goes from x0 to x1 (all in radii, the
   disc's middle at 0; x -1..1), and the strip's own area. */
static void conemap__strip(double y0, double x0, double y1, double x1, double *seen, double *whole) {
    int k;
    for (k = 0; k < 4; ++k) {
        double at = ((double)k + 0.5) * 0.25, y = y0 + (y1 - y0) * at, x = x0 + (x1 - x0) * at;
        double half = sqrt(1.0 - y * y), part = half - x;
        *seen += (y1 - y0) * 0.25 * (part < 0.0 ? 0.0 : part > 2.0 * half ? 2.0 * half : part);
        *whole += (y1 - y0) * 0.25 * 2.0 * half;
    }
}

/* A point from which light and sky are looked at: in the box, on or beside the surface. */
typedef struct conemap__place_of {
    const conemap__scene *scene;
    const conemap__basis *basis;
    float u, v;
    double z;
} conemap__place_of;

/* Starts a flight from a place towards a direction of the world. Returns the flight's z1. */
static double conemap__look_along(const conemap__place_of *place, const float direction[3], double t_max,
                                  conemap__course *f,
                            int *meets) {
    double o[2], v[2], z[3];
    float d[3];
    conemap__direction_to_box(place->basis, direction, d);
    o[0] = (double)place->u;
    o[1] = (double)place->v;
    v[0] = (double)d[0];
    v[1] = (double)d[1];
    z[0] = place->z;
    z[1] = (double)(d[2] + conemap__drop_along(place->basis, place->u, place->v, d[0], d[1]));
    z[2] = (double)conemap__bend_along(place->basis, d[0], d[1]);
    *meets = conemap__take_off(place->scene, o, v, z, 0.0, t_max, f);
    return z[1];
}

/* A light's disc over a place: unit directions towards it and to its side, its radius at distance 1, how much it stands
   above the base's plane, and how far a step up moves across the line of sight. */
typedef struct conemap__disc {
    float light[3], side[3], radius, above, lift, height, t_max;
} conemap__disc;

/* The horizon, -1..1 radii from the disc's middle upwards, in the direction `y` radii to the side. A direction s
   units of height above the light's own is s lift / (1 + s above) off it. */
static double conemap__disc_horizon(const conemap__place_of *place, const conemap__disc *disc, double y) {
    double rise, down, s, x, r = (double)disc->radius, lift = (double)disc->lift, above = (double)disc->above;
    double height = (double)disc->height;
    conemap__course f;
    float direction[3];
    int meets;
    conemap__add_along(disc->light, (float)y * disc->radius, disc->side, direction);
    rise = conemap__look_along(place, direction, (double)disc->t_max, &f, &meets);
    if (!meets) return -1.0;
    down = r / ((lift + r * above) * height);
    s = (conemap__horizon(&f, rise - down, rise + r / ((lift - r * above) * height), down / 1024.0) - rise) * height;
    x = s * lift / (r * (1.0 + s * above));
    return x < -1.0 ? -1.0 : x > 1.0 ? 1.0 : x;
}

/* How much of a light's disc is seen: 0..1. light: unit, towards it. The disc is cut by the horizons in five
   directions, and between two that differ by much, such as beside a tower, by more, so that no edge moves by a whole
   strip at once. */
static float conemap__soft_shadow(const conemap__place_of *place, const float light[3], float radius, float t_max) {
    conemap__disc disc;
    float up[3];
    double y0 = -1.0, x0, seen = 0.0, whole = 0.0;
    double ends[12], horizons[12]; /* of the strips still to do, the next one last */
    int k, strips = 0;
    memcpy(up, place->basis->axis[2], sizeof up);
    memcpy(disc.light, light, sizeof disc.light);
    disc.height = sqrtf(conemap__dot(up, up));
    disc.t_max = t_max;
    for (k = 0; k < 3; ++k) up[k] /= disc.height;
    disc.above = conemap__dot(light, up);
    conemap__cross(light, up, disc.side);
    disc.lift = sqrtf(conemap__dot(disc.side, disc.side));
    if (!(disc.lift > 1e-5f) || !conemap__normalise(disc.side)) return disc.above > 0.0f ? 1.0f : 0.0f; /* overhead */
    /* A disc that holds the zenith is made smaller: beyond it horizons would be looked at upside down. */
    disc.radius = conemap__min(radius, 0.99f * disc.lift / conemap__max(conemap__magnitude(disc.above), 1e-6f));
    disc.radius = conemap__max(disc.radius, 1e-6f);
    x0 = conemap__disc_horizon(place, &disc, y0);
    for (k = 4; k > 0; --k, ++strips) {
        ends[strips] = 0.5 * (double)k - 1.0;
        horizons[strips] = conemap__disc_horizon(place, &disc, ends[strips]);
    }
    while (strips > 0) {
        double y = ends[strips - 1], x = horizons[strips - 1];
        if ((x - x0) * (x - x0) > 0.0625 && y - y0 > 0.01) { /* half a strip, halved 6 times at most */
            ends[strips] = 0.5 * (y0 + y);
            horizons[strips] = conemap__disc_horizon(place, &disc, ends[strips]);
            ++strips;
            continue;
        }
        conemap__strip(y0, x0, y, x, &seen, &whole);
        y0 = y;
        x0 = x;
        --strips;
    }
    return (float)conemap__clamp01(seen / whole);
}

/* The cosine-weighted part of one azimuth's half circle above a horizon of this slope, for a normal that has
   `across` towards the azimuth and `up` to the zenith: the integral over elevations e of (across cos e + up sin e)
   cos e de; twice its mean over all azimuths is the share of the sky. */
static double conemap__sky_slice(double across, double up, double slope) {
    double part = 1.0 / (1.0 + slope * slope);
    return across * (0.78539816339744831 - 0.5 * atan(slope) - 0.5 * slope * part) + 0.5 * up * part;
}

/* The share of the sky that a place sees about a unit normal of the world. reach: 0 for no end. */
static float conemap__sky(const conemap__place_of *place, const float normal[3], int directions, float reach) {
    float up[3], east[3], north[3], height, lean;
    double sum = 0.0;
    int k, c;
    memcpy(up, place->basis->axis[2], sizeof up);
    height = sqrtf(conemap__dot(up, up));
    for (k = 0; k < 3; ++k) up[k] /= height;
    lean = conemap__dot(place->basis->axis[0], up);
    conemap__add_along(place->basis->axis[0], -lean, up, east);
    if (!conemap__normalise(east)) return 1.0f;
    conemap__cross(up, east, north);
    for (k = 0; k < directions; ++k) {
        double angle = 6.283185307179586 * ((double)k + 0.5) / (double)directions, across, rise, slope, least;
        double zenith = (double)conemap__dot(normal, up);
        float direction[3];
        conemap__course f;
        int meets;
        for (c = 0; c < 3; ++c) direction[c] = (float)cos(angle) * east[c] + (float)sin(angle) * north[c];
        across = (double)conemap__dot(normal, direction);
        /* the surface's own plane hides what is behind it */
        least = zenith > 1e-4 ? -across / zenith : across > 0.0 ? -1e4 : 1e4;
        slope = least < -1e4 ? -1e4 : least > 1e4 ? 1e4 : least;
        rise = conemap__look_along(place, direction, (double)reach, &f, &meets);
        if (meets)
            slope = (conemap__horizon(&f, rise + slope / (double)height, rise + 1e4 / (double)height,
                                      1.0 / (1024.0 * (double)height)) -
                     rise) * (double)height;
        sum += conemap__sky_slice(across, zenith, slope);
    }
    return (float)conemap__clamp01(2.0 * sum / (double)directions);
}

/* Openness guessed from a cone. The cone proves that no horizon is steeper than 1 / tan, in the world `steepest`,
   and the surface's own slope explains `own` of it. 0.3 of what is left, all around, is the guess, which fits bricks
   and cliffs best; a cone at max_tan was not stopped by anything, so that much counts as nothing. cos^2 of that
   horizon is the share of the sky (conemap__sky_slice with across 0). */
CONEMAP__INLINE float conemap__cone_openness(float tangent, float max_tan, float per_tan, float own) {
    float steepest = per_tan * (1.0f / conemap__max(tangent, 1e-6f) - 1.0f / max_tan);
    float rise = 0.3f * conemap__max(steepest - own, 0.0f);
    return 1.0f / (1.0f + rise * rise);
}

/* ---- shading ---------------------------------------------------------------------------------------- */

/* Puts a hit that rounding moved past the border back on the surface. */
CONEMAP__INLINE float conemap__on_surface(float x, const conemap_info *info, int axis) {
    double low, high;
    conemap__extent(info, axis, &low, &high);
    return (double)x < low ? (float)low : (double)x > high ? (float)high : x;
}

/* The blended surface under a point: height in double precision, slopes, cone. */
typedef struct conemap__ground_at {
    double height;
    float slope[2], smooth[2], tangent, max_tan;
} conemap__ground_at;

static void conemap__look_up(const conemap__scene *scene, float u, float v, int smooth, conemap__ground_at *ground) {
    float steepness = 0.0f, least = 0.0f;
    int k;
    memset(ground, 0, sizeof *ground);
    for (k = 0; k < scene->maps; ++k) {
        const conemap_map *map = scene->map[k];
        float w = (float)scene->weight[k], s[2] = {0.0f, 0.0f}, x = conemap__on_surface(u, &map->info, 0);
        float y = conemap__on_surface(v, &map->info, 1);
        double at[2], still[2] = {0.0, 0.0}, px, py;
        conemap_sample sample;
        conemap__lattice l;
        conemap__corners h;
        memset(&sample, 0, sizeof sample);
        conemap_sample_at(map, x, y, &sample);
        if (smooth) conemap_smooth_slope(map, x, y, s);
        ground->slope[0] += w * sample.dhdu;
        ground->slope[1] += w * sample.dhdv;
        ground->smooth[0] += w * s[0];
        ground->smooth[1] += w * s[1];
        steepness += w / conemap__max(sample.tan, 1e-9f);
        least += w / map->info.max_tan;
        /* conemap_sample_at's height is off by the place's rounding, which on a cliff of a large map is far too much */
        at[0] = (double)x;
        at[1] = (double)y;
        conemap__lay(&map->info, map->info.width, map->info.height, 0.5, at, still, &l);
        h = conemap__gather(map->heights, conemap__cell_quad(map, l.base_i, l.base_j));
        px = (double)h.h00 + ((double)h.h10 - (double)h.h00) * l.px;
        py = (double)h.h01 + ((double)h.h11 - (double)h.h01) * l.px;
        ground->height += scene->weight[k] * (px + (py - px) * l.py);
    }
    ground->tangent = 1.0f / steepness;
    ground->max_tan = 1.0f / least;
}

CONEMAP__INLINE int conemap__finite_gradient(const conemap_gradient *g) {
    return conemap__finite(g->dudx) && conemap__finite(g->dvdx) && conemap__finite(g->dudy) && conemap__finite(g->dvdy);
}

/* The width of a pixel's footprint in map widths, v measured as the map measures it: its area over its length. At
   grazing angles the footprint is long, but relief stands upright and is as many pixels high as ever. */
CONEMAP__INLINE float conemap__footprint(const conemap_gradient *g, float aspect) {
    float x = g->dudx * g->dudx + aspect * aspect * g->dvdx * g->dvdx;
    float y = g->dudy * g->dudy + aspect * aspect * g->dvdy * g->dvdy;
    float area = aspect * conemap__magnitude(g->dudx * g->dvdy - g->dvdx * g->dudy);
    float longest = sqrtf(conemap__max(x, y));
    return longest > 0.0f ? area / longest : 0.0f;
}

/* log2 of the texels under a pixel, as texture units choose their mip level. */
CONEMAP__INLINE float conemap__level_of(const conemap_gradient *g, const conemap_info *info) {
    float w = (float)info->width, h = (float)info->height;
    float x = g->dudx * g->dudx * w * w + g->dvdx * g->dvdx * h * h;
    float y = g->dudy * g->dudy * w * w + g->dvdy * g->dvdy * h * h;
    return 0.5f * log2f(conemap__max(conemap__max(x, y), 1e-30f));
}

/* 0 while the relief is more than `begin` pixels high, 1 below `end`, smooth between. */
CONEMAP__INLINE float conemap__fade_of(float pixels, float begin, float end) {
    float x = (begin - pixels) / (begin - end);
    x = x < 0.0f ? 0.0f : x > 1.0f ? 1.0f : x;
    return x * x * (3.0f - 2.0f * x);
}

static void conemap__choose_lod(const conemap_map *map, const conemap_effects *e, const conemap__basis *basis,
                                const conemap_gradient *gradient, conemap_lod *lod) {
    memset(lod, 0, sizeof *lod);
    if (e->flags & CONEMAP_EFFECT_LOD) {
        float last = (float)(e->level_count - 1), level = conemap__level_of(gradient, &e->levels[0].info) + e->lod_bias;
        lod->level = level < 0.0f ? 0.0f : level > last ? last : level;
        if (e->lod_steps)
            lod->max_steps = conemap__maxi(8, (int)ceilf((float)e->lod_steps * powf(2.0f, -lod->level)));
    }
    if (e->flags & CONEMAP_EFFECT_FADE) {
        float high = sqrtf(conemap__dot(basis->axis[2], basis->axis[2]) / conemap__dot(basis->axis[0], basis->axis[0]));
        float pixel = conemap__footprint(gradient, map->info.aspect);
        lod->fade = conemap__fade_of(high / conemap__max(pixel, 1e-30f), e->fade_begin, e->fade_end);
    }
}

/* Does an axis of a level wrap as the map's? Where a single texel is left of it, NOTHING has become CLAMP. */
static int conemap__level_wraps(conemap_wrap wrap, int size, conemap_wrap map) {
    return wrap == map || (size == 1 && wrap == CONEMAP_CLAMP && map == CONEMAP_NOTHING);
}

/* Checks effects and writes their defaults out. */
static conemap_result conemap__resolve_effects(const conemap_map *map, conemap_effects *e) {
    const unsigned shadows = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
    ptrdiff_t stride;
    int k;
    if (conemap__effects_clash(e->flags)) return CONEMAP_ERROR_UNSUPPORTED;
    if (!e->frames && (e->frame_per_ray || (e->flags & (CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_TWO_SIDED))))
        return CONEMAP_ERROR_NULL;
    if (e->flags & CONEMAP_EFFECT_CLIP) {
        if (!conemap__all_finite(e->clip, 4)) return CONEMAP_ERROR_PARAMETER;
        if (e->clip[0] == 0.0f && e->clip[1] == 0.0f && e->clip[2] == 0.0f && e->clip[3] == 0.0f)
            e->clip[2] = e->clip[3] = 1.0f;
        if (!(e->clip[0] < e->clip[2]) || !(e->clip[1] < e->clip[3])) return CONEMAP_ERROR_PARAMETER;
    }
    if (e->flags & CONEMAP_EFFECT_HOLES) {
        if (!e->alpha) return CONEMAP_ERROR_NULL;
        if (e->alpha_stride == 0) e->alpha_stride = map->info.width;
        stride = e->alpha_stride < 0 ? -e->alpha_stride : e->alpha_stride;
        if (map->info.height > 1 && stride < map->info.width) return CONEMAP_ERROR_STRIDE;
        if (e->alpha_cut == 0) e->alpha_cut = 128;
        if (e->alpha_cut < 0 || e->alpha_cut > 255) return CONEMAP_ERROR_PARAMETER;
    }
    if ((e->flags & (CONEMAP_EFFECT_UV | CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE)) && !e->gradients)
        return CONEMAP_ERROR_NULL;
    if (e->flags & CONEMAP_EFFECT_LOD) {
        if (!e->levels) return CONEMAP_ERROR_NULL;
        if (e->level_count < 1 || e->level_count > 16 || !conemap__in_range(e->lod_bias, -16.0f, 16.0f) ||
            e->lod_steps < 0 || e->lod_steps > (1 << 30))
            return CONEMAP_ERROR_PARAMETER;
        for (k = 0; k < e->level_count; ++k) {
            if (!e->levels[k].heights) return CONEMAP_ERROR_NULL;
            if (!conemap__level_wraps(e->levels[k].info.wrap_u, e->levels[k].info.width, map->info.wrap_u) ||
                !conemap__level_wraps(e->levels[k].info.wrap_v, e->levels[k].info.height, map->info.wrap_v))
                return CONEMAP_ERROR_UNSUPPORTED;
        }
    }
    if (e->flags & CONEMAP_EFFECT_FADE) {
        if (!conemap__in_range(e->fade_begin, 0.0f, 1e6f) || !conemap__in_range(e->fade_end, 0.0f, 1e6f))
            return CONEMAP_ERROR_PARAMETER;
        if (e->fade_begin == 0.0f) e->fade_begin = 2.0f;
        if (e->fade_end == 0.0f) e->fade_end = 0.25f * e->fade_begin;
        if (!(e->fade_end < e->fade_begin)) return CONEMAP_ERROR_PARAMETER;
    }
    if (e->flags & CONEMAP_EFFECT_DEPTH) {
        if (!e->view_projection) return CONEMAP_ERROR_NULL;
        if (!CONEMAP__KNOWN(e->depth_range, CONEMAP_DEPTH_RANGE_COUNT)) return CONEMAP_ERROR_ENUM;
        if (!conemap__all_finite(e->view_projection, 16)) return CONEMAP_ERROR_PARAMETER;
    }
    if (e->flags & shadows) {
        if (!conemap__all_finite(e->light, 3) ||
            (!e->light_is_point && e->light[0] == 0.0f && e->light[1] == 0.0f && e->light[2] == 0.0f))
            return CONEMAP_ERROR_PARAMETER;
        if (!conemap__in_range(e->light_radius, 0.0f, e->light_is_point ? 1e18f : 1.0f)) return CONEMAP_ERROR_PARAMETER;
        if (e->light_radius == 0.0f) e->light_radius = 0.00465f;
    }
    if (e->flags & CONEMAP_EFFECT_SKY) {
        if (e->sky_directions == 0) e->sky_directions = 8;
        if (e->sky_directions < 1 || e->sky_directions > 1024 || !conemap__in_range(e->sky_reach, 0.0f, 1e18f))
            return CONEMAP_ERROR_PARAMETER;
    }
    return CONEMAP_OK;
}

/* What one ray of conemap_shade needs to know. */
typedef struct conemap__view {
    const conemap_ray *world;
    conemap_ray box;
    conemap__basis basis;   /* as it is traced: flattened by the fade */
    conemap__basis normals; /* not flattened */
    conemap__scene scene;
    conemap_lod lod;
    conemap_result result;  /* of the frame */
    int flight;             /* nonzero: not for conemap_trace */
    int wall;               /* axis of the side that was hit, 1 or 2; 0: none */
} conemap__view;

/* Does conemap_trace know this scene as it is? */
CONEMAP__INLINE int conemap__is_plain(const conemap_effects *e) {
    return !(e->flags & (CONEMAP_EFFECT_CURVED | CONEMAP_EFFECT_FADE | CONEMAP_EFFECT_LOD));
}

static void conemap__set_scene(const conemap_map *map, const conemap_effects *e, float level, conemap__scene *scene) {
    memset(scene, 0, sizeof *scene);
    if (e->flags & CONEMAP_EFFECT_LOD) {
        int k = conemap__mini((int)level, e->level_count - 1);
        double f = (double)(level - (float)k);
        conemap__add_map(scene, &e->levels[k], 1.0 - f);
        if (f > 0.0 && k + 1 < e->level_count) conemap__add_map(scene, &e->levels[k + 1], f);
    } else {
        conemap__add_map(scene, map, 1.0);
    }
    if (e->flags & CONEMAP_EFFECT_CLIP) {
        int axis;
        for (axis = 0; axis < 2; ++axis) {
            if ((double)e->clip[axis] > scene->low[axis]) scene->low[axis] = (double)e->clip[axis];
            if ((double)e->clip[axis + 2] < scene->high[axis]) scene->high[axis] = (double)e->clip[axis + 2];
        }
    }
    if (e->flags & CONEMAP_EFFECT_HOLES) {
        scene->alpha = e->alpha;
        scene->alpha_stride = e->alpha_stride;
        scene->alpha_width = map->info.width;
        scene->alpha_height = map->info.height;
        scene->alpha_cut = e->alpha_cut;
    }
}

/* Cuts a box ray to the scene's rectangle; 0 if nothing is left. A ray that then ends at t_max has left. */
static int conemap__cut_ray(const conemap__scene *scene, conemap_ray *ray) {
    double t0 = (double)ray->t_min, t1 = CONEMAP__NEVER;
    int axis;
    if (ray->t_max != 0.0f && conemap__finite(ray->t_max)) t1 = (double)ray->t_max;
    for (axis = 0; axis < 2; ++axis)
        if (!conemap__clip((double)ray->origin[axis], (double)ray->direction[axis], scene->low[axis],
                           scene->high[axis], 1, &t0, &t1, NULL, NULL))
            return 0;
    if (t0 >= (double)CONEMAP__FAR) return 0;
    ray->t_min = (float)t0;
    if (t1 < (double)CONEMAP__FAR) ray->t_max = conemap__max((float)t1, ray->t_min);
    return !(ray->t_max == 0.0f && t1 < (double)CONEMAP__FAR); /* an end at 0 would mean none */
}

static void conemap__put_hit(const conemap_ray *ray, double t, conemap_hit *hit) {
    hit->t = hit->t_before = hit->t_after = t >= (double)CONEMAP__FAR ? conemap__from_bits(0x7f800000u) : (float)t;
    hit->u = (float)((double)ray->origin[0] + t * (double)ray->direction[0]);
    hit->v = (float)((double)ray->origin[1] + t * (double)ray->direction[1]);
    hit->z = (float)((double)ray->origin[2] + t * (double)ray->direction[2]);
}

/* Follows a view's ray as a flight, from `from` on. */
static void conemap__fly_ray(conemap__view *view, double from, int max_steps, conemap_hit *hit) {
    const conemap_ray *r = &view->box;
    double o[2], v[2], z[3], longest = 0.0;
    conemap__course f;
    int k;
    for (k = 0; k < 3; ++k) {
        double size = (double)conemap__magnitude(r->direction[k]);
        if (size > longest) longest = size;
    }
    for (k = 0; k < 2; ++k) {
        o[k] = (double)r->origin[k];
        v[k] = (double)conemap__magnitude(r->direction[k]) < 1e-30 * longest ? 0.0 : (double)r->direction[k];
    }
    z[0] = (double)(r->origin[2] + conemap__drop(&view->basis, r->origin[0], r->origin[1]));
    z[1] = (double)(r->direction[2] + conemap__drop_along(&view->basis, r->origin[0], r->origin[1], r->direction[0],
                                                          r->direction[1]));
    z[2] = (double)conemap__bend_along(&view->basis, r->direction[0], r->direction[1]);
    memset(hit, 0, sizeof *hit);
    if (conemap__take_off(&view->scene, o, v, z, from, (double)r->t_max, &f))
        hit->status = conemap__fly(&f, max_steps, &hit->steps);
    else
        hit->status = f.end_status;
    conemap__put_hit(r, f.t_start + f.t, hit);
    if (f.t < CONEMAP__NEVER) hit->z = (float)(z[0] + (z[1] + z[2] * (f.t_start + f.t)) * (f.t_start + f.t));
    hit->inside = hit->status == CONEMAP_HIT && f.solid;
    view->wall = hit->inside ? f.wall : 0;
}

/* Where a view's ray meets the base itself, which is all that is left of relief that has faded. */
static void conemap__meet_base(conemap__view *view, conemap_hit *hit) {
    const conemap_ray *r = &view->box;
    conemap__quadratic over;
    double t, sign;
    over.c = (double)(r->origin[2] + conemap__drop(&view->basis, r->origin[0], r->origin[1]) - view->basis.level);
    over.b = (double)(r->direction[2] + conemap__drop_along(&view->basis, r->origin[0], r->origin[1], r->direction[0],
                                                            r->direction[1]));
    over.a = (double)conemap__bend_along(&view->basis, r->direction[0], r->direction[1]);
    sign = over.c < 0.0 ? -1.0 : 1.0; /* from behind as from before */
    over.c *= sign;
    over.b *= sign;
    over.a *= sign;
    t = conemap__first_zero(over, CONEMAP__NEVER);
    memset(hit, 0, sizeof *hit);
    hit->status = CONEMAP_LEFT;
    /* rays begin on the base often enough, and then a little behind it */
    if (t < (double)r->t_min) t = t < (double)r->t_min * (1.0 - 1e-4) ? CONEMAP__NEVER : (double)r->t_min;
    if (r->t_max != 0.0f && t > (double)r->t_max) {
        hit->status = CONEMAP_T_MAX;
        t = (double)r->t_max;
    } else if (t < CONEMAP__NEVER) {
        const conemap__scene *s = &view->scene;
        double u = (double)r->origin[0] + t * (double)r->direction[0];
        double v = (double)r->origin[1] + t * (double)r->direction[1];
        if (u >= s->low[0] && u <= s->high[0] && v >= s->low[1] && v <= s->high[1])
            hit->status = CONEMAP_HIT;
    }
    conemap__put_hit(r, t, hit);
    if (hit->status == CONEMAP_HIT) hit->z = view->basis.level;
}

/* Is there a hole under a hit, or just behind it? A flight from there on tells which. */
static int conemap__in_hole(const conemap__scene *scene, const conemap_ray *ray, const conemap_hit *hit) {
    const conemap_info *info = &scene->map[0]->info;
    double at[2], still[2] = {0.0, 0.0};
    conemap__course f;
    at[0] = (double)hit->u + (ray->direction[0] < 0.0f ? -1e-6 : 1e-6);
    at[1] = (double)hit->v + (ray->direction[1] < 0.0f ? -1e-6 : 1e-6);
    f.scene = scene;
    conemap__lay(info, scene->alpha_width, scene->alpha_height, 0.0, at, still, &f.lattice[scene->maps]);
    return conemap__over_hole(&f);
}

/* Prepares one ray: frame, level, scene, box ray. */
static void conemap__prepare(const conemap_map *map, const conemap_effects *e, const conemap_ray *ray, int index,
                             conemap__view *view) {
    const conemap_frame *frame = e->frames ? &e->frames[e->frame_per_ray ? index : 0] : NULL;
    const float *toward = e->flags & CONEMAP_EFFECT_TWO_SIDED ? ray->direction : NULL;
    int curved = (e->flags & CONEMAP_EFFECT_CURVED) != 0;
    view->world = ray;
    view->wall = 0;
    memset(&view->lod, 0, sizeof view->lod);
    view->result = conemap__resolve_frame(frame, 0.0f, toward, curved, &view->normals);
    if (view->result != CONEMAP_OK) return;
    view->basis = view->normals;
    if (e->flags & (CONEMAP_EFFECT_LOD | CONEMAP_EFFECT_FADE)) {
        if (!conemap__finite_gradient(&e->gradients[index])) {
            view->result = CONEMAP_ERROR_PARAMETER;
            return;
        }
        conemap__choose_lod(map, e, &view->normals, &e->gradients[index], &view->lod);
    }
    if (view->lod.fade > 0.0f) {
        conemap_frame unit;
        memset(&unit, 0, sizeof unit);
        conemap__resolve_frame(frame ? frame : &unit, conemap__min(view->lod.fade, 0.9999f), toward, curved,
                               &view->basis);
    }
    conemap__set_scene(map, e, view->lod.level, &view->scene);
    view->flight = curved || view->scene.maps > 1;
    conemap__ray_to_box(&view->basis, ray, &view->box);
}

/* The side of the scene's rectangle that an `inside` hit lies on. */
static int conemap__side_hit(const conemap__scene *scene, const conemap_ray *ray, const conemap_hit *hit) {
    double o[2], t0 = 0.0, t1 = CONEMAP__NEVER;
    int side = 0, axis;
    o[0] = (double)ray->origin[0];
    o[1] = (double)ray->origin[1];
    for (axis = 0; axis < 2; ++axis)
        conemap__clip(o[axis], (double)ray->direction[axis], scene->low[axis], scene->high[axis], axis + 1, &t0, &t1,
                      &side, NULL);
    /* only if the hit is where the rectangle is entered, and not where t_min or the floor is */
    return t0 > 0.0 && (double)hit->t <= t0 * (1.0 + 1e-5) ? side : 0;
}

/* Everything about a hit but its shadow. Returns the place that light is looked at from. */
static void conemap__shade_hit(const conemap_effects *e, conemap__view *view, const conemap_hit *hit, int index,
                               conemap__place_of *place, conemap_shading *s) {
    const unsigned lights = CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW;
    const unsigned skies = CONEMAP_EFFECT_OCCLUSION | CONEMAP_EFFECT_SKY;
    const unsigned normals = CONEMAP_EFFECT_NORMAL | CONEMAP_EFFECT_SMOOTH_NORMAL;
    conemap__ground_at ground;
    float position[3], normal[3] = {0.0f, 0.0f, 0.0f};
    if (e->flags & CONEMAP_EFFECT_UV) {
        s->uv[0] = hit->u;
        s->uv[1] = hit->v;
        s->gradient = e->gradients[index];
    }
    if (e->flags & CONEMAP_EFFECT_LOD) s->level = view->lod.level;
    if (e->flags & CONEMAP_EFFECT_FADE) s->fade = view->lod.fade;
    if (e->flags & (CONEMAP_EFFECT_POSITION | CONEMAP_EFFECT_DEPTH)) {
        conemap__add_along(view->world->origin, hit->t, view->world->direction, position);
        memcpy(s->position, position, sizeof position);
        if ((e->flags & CONEMAP_EFFECT_DEPTH) &&
            conemap_depth(e->view_projection, position, e->depth_range, &s->depth) != CONEMAP_OK)
            s->depth = 0.0f;
    }
    if (!(e->flags & (normals | lights | skies))) return;
    conemap__look_up(&view->scene, hit->u, hit->v,
                     (e->flags & (CONEMAP_EFFECT_SMOOTH_NORMAL | CONEMAP_EFFECT_OCCLUSION)) != 0, &ground);
    place->scene = &view->scene;
    place->basis = &view->basis;
    place->u = hit->u;
    place->v = hit->v;
    /* A hit of an inexact tracer may lie below the surface, one that ran out of steps above it. */
    place->z = (double)hit->z > ground.height + CONEMAP__LIFT ? (double)hit->z : ground.height + CONEMAP__LIFT;
    if (view->wall) { /* just beside the wall, on the ray's side */
        int axis = view->wall - 1, k;
        float sign = view->box.direction[axis] > 0.0f ? -1.0f : 1.0f, *at = axis ? &place->v : &place->u;
        *at += sign * conemap__max(1.0f / 1048576.0f, conemap__magnitude(*at) / 4194304.0f);
        place->z = (double)hit->z;
        for (k = 0; k < 3; ++k) normal[k] = sign * view->normals.inverse[axis][k];
        conemap__normalise(normal);
    } else {
        const float *slope = e->flags & CONEMAP_EFFECT_SMOOTH_NORMAL ? ground.smooth : ground.slope;
        conemap__normal_to_world(&view->normals, hit->u, hit->v, slope[0], slope[1], normal);
    }
    if (e->flags & normals) memcpy(s->normal, normal, sizeof normal);
    if (e->flags & CONEMAP_EFFECT_OCCLUSION) {
        const conemap__basis *b = &view->basis;
        float x = conemap__dot(b->axis[0], b->axis[0]), y = conemap__dot(b->axis[1], b->axis[1]);
        float z = conemap__dot(b->axis[2], b->axis[2]);
        float own = sqrtf(ground.smooth[0] * ground.smooth[0] * z / x + ground.smooth[1] * ground.smooth[1] * z / y);
        s->occlusion = view->wall ? 0.5f : conemap__cone_openness(ground.tangent, ground.max_tan, sqrtf(z / x), own);
    }
    if (e->flags & CONEMAP_EFFECT_SKY) s->occlusion = conemap__sky(place, normal, e->sky_directions, e->sky_reach);
}

/* Towards the light from a place: unit direction of the world, and the distance, 0 for a sun. */
static int conemap__toward_light(const conemap_effects *e, const conemap__place_of *place, float light[3],
                                 float *distance) {
    float from[3], box[3];
    memcpy(light, e->light, 3 * sizeof(float));
    *distance = 0.0f;
    if (e->light_is_point) {
        box[0] = place->u;
        box[1] = place->v;
        box[2] = (float)place->z;
        conemap__point_to_world(place->basis, box, from);
        conemap__add_along(light, -1.0f, from, light);
        *distance = sqrtf(conemap__dot(light, light));
        if (!(*distance > 0.0f)) return 0;
    }
    return conemap__normalise(light);
}

/* Traces the views' rays: those that conemap_trace knows in one call, the others one by one. */
static void conemap__trace_views(const conemap_map *map, const conemap_trace_desc *trace, const conemap_effects *e,
                                 conemap__view *views, int count, conemap_hit *hits, conemap_result *result) {
    conemap_ray rays[CONEMAP__CHUNK];
    int whole[CONEMAP__CHUNK], k, plain = conemap__is_plain(e);
    conemap_result answer;
    for (k = 0; k < count; ++k) {
        conemap__view *view = &views[k];
        rays[k] = view->box;
        whole[k] = 1;
        if (view->result != CONEMAP_OK) {
            memset(&rays[k], 0, sizeof rays[k]); /* INVALID by its direction; the frame's result counts */
            if (*result == CONEMAP_OK) *result = view->result;
        } else if ((e->flags & CONEMAP_EFFECT_CLIP) && conemap__check_ray(&rays[k]) == CONEMAP_OK) {
            whole[k] = conemap__cut_ray(&view->scene, &rays[k]);
            if (!whole[k]) rays[k].t_min = rays[k].t_max = 0.0f;
        }
    }
    if (plain) {
        answer = conemap_trace(map, trace, rays, hits, count);
        if (*result == CONEMAP_OK) *result = answer;
    }
    for (k = 0; k < count; ++k) {
        conemap__view *view = &views[k];
        int max_steps = view->lod.max_steps;
        if (trace && trace->max_steps && (max_steps == 0 || trace->max_steps < max_steps)) max_steps = trace->max_steps;
        if (!plain) {
            answer = conemap__check_ray(&rays[k]);
            if (answer != CONEMAP_OK) {
                memset(&hits[k], 0, sizeof hits[k]);
                hits[k].status = CONEMAP_INVALID;
                if (*result == CONEMAP_OK) *result = answer;
                continue;
            }
            if (view->lod.fade >= 0.9999f)
                conemap__meet_base(view, &hits[k]);
            else if (view->flight)
                conemap__fly_ray(view, (double)view->box.t_min, max_steps, &hits[k]);
            else {
                conemap_trace_desc capped;
                memset(&capped, 0, sizeof capped);
                if (trace) capped = *trace;
                capped.max_steps = max_steps;
                conemap_trace(view->scene.map[0], &capped, &rays[k], &hits[k], 1);
            }
        }
        if (hits[k].status == CONEMAP_INVALID || (!plain && (view->flight || view->lod.fade >= 0.9999f))) continue;
        if (!whole[k] || ((e->flags & CONEMAP_EFFECT_CLIP) && hits[k].status == CONEMAP_T_MAX &&
                          !(view->box.t_max != 0.0f && hits[k].t >= view->box.t_max)))
            hits[k].status = CONEMAP_LEFT;
        if (hits[k].status != CONEMAP_HIT) continue;
        if (view->scene.alpha && conemap__in_hole(&view->scene, &view->box, &hits[k])) {
            int steps = hits[k].steps;
            conemap__fly_ray(view, (double)hits[k].t, max_steps, &hits[k]);
            hits[k].steps += steps;
        } else if (hits[k].inside) {
            view->wall = conemap__side_hit(&view->scene, &view->box, &hits[k]);
        }
    }
}

/* Hard shadows of a chunk: by conemap_trace together where it knows the scene. */
static void conemap__shade_shadows(const conemap_map *map, const conemap_effects *e, const conemap__view *views,
                                   const conemap__place_of *places, const int *lit, int count,
                                   conemap_shading *shadings) {
    conemap_trace_desc any;
    conemap_ray rays[CONEMAP__CHUNK];
    conemap_hit hits[CONEMAP__CHUNK];
    int which[CONEMAP__CHUNK], k, n = 0, plain = conemap__is_plain(e) && !(e->flags & CONEMAP_EFFECT_HOLES);
    memset(&any, 0, sizeof any);
    any.any_hit = 1;
    for (k = 0; k < count; ++k) {
        const conemap__place_of *place = &places[k];
        float light[3], distance;
        if (!lit[k]) continue;
        if (!conemap__toward_light(e, place, light, &distance)) {
            shadings[k].shadow = 1.0f;
        } else if (e->flags & CONEMAP_EFFECT_SOFT_SHADOW) {
            float radius = e->light_is_point ? e->light_radius / distance : e->light_radius;
            shadings[k].shadow = conemap__soft_shadow(place, light, conemap__min(radius, 1.0f), distance);
        } else if (!plain) {
            conemap__course f;
            int meets, steps;
            conemap__look_along(place, light, (double)distance, &f, &meets);
            shadings[k].shadow = meets && conemap__fly(&f, 0, &steps) == CONEMAP_HIT ? 0.0f : 1.0f;
        } else {
            conemap_ray *ray = &rays[n];
            ray->origin[0] = place->u;
            ray->origin[1] = place->v;
            ray->origin[2] = (float)place->z;
            conemap__direction_to_box(&views[k].basis, light, ray->direction);
            ray->t_min = 0.0f;
            ray->t_max = distance;
            if ((e->flags & CONEMAP_EFFECT_CLIP) && !conemap__cut_ray(&views[k].scene, ray))
                shadings[k].shadow = 1.0f;
            else
                which[n++] = k;
        }
    }
    if (n == 0) return;
    conemap_trace(map, &any, rays, hits, n);
    for (k = 0; k < n; ++k) shadings[which[k]].shadow = hits[k].status == CONEMAP_HIT ? 0.0f : 1.0f;
}

CONEMAP__DEF conemap_result conemap_shade(const conemap_map *map, const conemap_trace_desc *trace,
                                          const conemap_effects *effects, const conemap_ray *rays, conemap_hit *hits,
                                          conemap_shading *shadings, int count) {
    conemap_effects e;
    conemap__view views[CONEMAP__CHUNK];
    conemap__place_of places[CONEMAP__CHUNK];
    conemap_result result;
    int first, k, lit[CONEMAP__CHUNK];
    if (!effects || effects->flags == 0) return conemap_trace(map, trace, rays, hits, count);
    result = conemap_trace(map, trace, rays, hits, count > 0 ? 0 : count); /* checks the rest of what is given */
    if (result != CONEMAP_OK) return result;
    if ((!rays || !hits || !shadings) && count > 0) return CONEMAP_ERROR_NULL;
    e = *effects;
    result = conemap__resolve_effects(map, &e);
    if (result == CONEMAP_OK && e.frames && !e.frame_per_ray) /* a wrong frame for all is a wrong call */
        result = conemap__resolve_frame(e.frames, 0.0f, NULL, (e.flags & CONEMAP_EFFECT_CURVED) != 0, &views[0].basis);
    if (result != CONEMAP_OK) return result;
    for (first = 0; first < count; first += CONEMAP__CHUNK) {
        int n = conemap__mini(count - first, CONEMAP__CHUNK);
        for (k = 0; k < n; ++k) conemap__prepare(map, &e, &rays[first + k], first + k, &views[k]);
        conemap__trace_views(map, trace, &e, views, n, &hits[first], &result);
        for (k = 0; k < n; ++k) {
            const conemap_hit *hit = &hits[first + k];
            lit[k] = hit->status == CONEMAP_HIT || hit->status == CONEMAP_STEP_CAP;
            if (lit[k]) conemap__shade_hit(&e, &views[k], hit, first + k, &places[k], &shadings[first + k]);
        }
        if (e.flags & (CONEMAP_EFFECT_SHADOW | CONEMAP_EFFECT_SOFT_SHADOW))
            conemap__shade_shadows(map, &e, views, places, lit, n, &shadings[first]);
    }
    return result;
}

CONEMAP__DEF conemap_result conemap_lod_at(const conemap_map *map, const conemap_effects *effects,
                                           const conemap_gradient *gradient, conemap_lod *lod) {
    conemap_effects e;
    conemap__basis basis;
    conemap_result result;
    conemap_gradient all;
    if (!map || !map->heights || !effects || !gradient || !lod) return CONEMAP_ERROR_NULL;
    e = *effects;
    all = *gradient;
    e.gradients = &all;
    result = conemap__resolve_effects(map, &e);
    if (result == CONEMAP_OK) result = conemap__resolve_frame(e.frames, 0.0f, NULL, 0, &basis);
    if (result == CONEMAP_OK && !conemap__finite_gradient(&all)) result = CONEMAP_ERROR_PARAMETER;
    if (result == CONEMAP_OK) conemap__choose_lod(map, &e, &basis, &all, lod);
    return result;
}

CONEMAP__DEF conemap_result conemap_bake_sky(const conemap_map *map, const conemap_frame *frame, int directions,
                                             int first_row, int rows, float *sky) {
    conemap__basis basis;
    conemap__scene scene;
    conemap__place_of place;
    conemap_result result;
    int x, y;
    if (!map || !map->heights || !sky) return CONEMAP_ERROR_NULL;
    if (directions < 0 || directions > 1024 || first_row < 0 || rows < 0 || first_row > map->info.height ||
        rows > map->info.height - first_row)
        return CONEMAP_ERROR_PARAMETER;
    if (directions == 0) directions = 64;
    if (rows == 0) rows = map->info.height - first_row;
    result = conemap__resolve_frame(frame, 0.0f, NULL, 0, &basis);
    if (result != CONEMAP_OK) return result;
    memset(&scene, 0, sizeof scene);
    conemap__add_map(&scene, map, 1.0);
    place.scene = &scene;
    place.basis = &basis;
    for (y = first_row; y < first_row + rows; ++y)
        for (x = 0; x < map->info.width; ++x) {
            float normal[3];
            place.u = ((float)x + 0.5f) / (float)map->info.width;
            place.v = ((float)y + 0.5f) / (float)map->info.height;
            place.z = (double)conemap__height(map, x, y) + CONEMAP__LIFT;
            conemap__normal_to_world(&basis, place.u, place.v,
                                     conemap__difference(map, x, y, 0) * (float)map->info.width,
                                     conemap__difference(map, x, y, 1) * (float)map->info.height, normal);
            sky[(size_t)y * (size_t)map->info.width + (size_t)x] = conemap__sky(&place, normal, directions, 0.0f);
        }
    return CONEMAP_OK;
}

#if defined(__clang__)
#pragma STDC FP_CONTRACT DEFAULT
#elif defined(__GNUC__)
#pragma GCC pop_options
#elif defined(_MSC_VER)
#pragma fp_contract(on)
#endif

#undef CONEMAP__DEF
#undef CONEMAP__INLINE
#undef CONEMAP__UNUSED
#undef CONEMAP__PREFETCH
#undef CONEMAP__FAR
#undef CONEMAP__HASH_START
#undef CONEMAP__STRIP_LEVELS
#undef CONEMAP__STRIP
#undef CONEMAP__BAND
#undef CONEMAP__RUN
#undef CONEMAP__NEAR
#undef CONEMAP__TILE
#undef CONEMAP__LEAST_SLACK
#undef CONEMAP__TINY
#undef CONEMAP__SIGHT_REACH
#undef CONEMAP__SIGHTS
#undef CONEMAP__GIVEN
#undef CONEMAP__FINEST
#undef CONEMAP__EIGHTHS
#undef CONEMAP__NOTED
#undef CONEMAP__TANGENT_MARGIN
#undef CONEMAP__KNOWN
#undef CONEMAP__VERIFY_DEPTH
#undef CONEMAP__VERIFY_WORK
#undef CONEMAP__VERIFY_DEEPER
#undef CONEMAP__VERIFY_CREDIT
#undef CONEMAP__VERIFY_APEX
#undef CONEMAP__VERIFY_GRAIN
#undef CONEMAP__FILE_WORDS
#undef CONEMAP__FILE_HEADER
#undef CONEMAP__REACH
#undef CONEMAP__MARGIN
#undef CONEMAP__TOLERANCE
#undef CONEMAP__LONGEST
#undef CONEMAP__NEVER
#undef CONEMAP__APEX_SLACK
#undef CONEMAP__NOWHERE
#undef CONEMAP__LIFT
#undef CONEMAP__CHUNK
#undef CONEMAP__KERNEL_LIST
#undef CONEMAP__MET
#undef CONEMAP__EMPTY
#undef CONEMAP__GONE
#undef CONEMAP__CLOSE
#undef CONEMAP__FLYING
#undef CONEMAP__SLOTS
#undef CONEMAP__BLOCK
#undef CONEMAP__ATTRIBUTE
#undef CONEMAP__X86
#undef CONEMAP__ARM
#undef CONEMAP__WASM
#undef CONEMAP__FLAGS
#undef CONEMAP__PIECE_SIZE
#undef CONEMAP__PIECES
#undef CONEMAP__NAME_SIZE
#undef CONEMAP__TABLES
#undef CONEMAP__TABLE_SIZE
#undef CONEMAP__STEEPEST
#undef CONEMAP__CONE_ROOM
#undef CONEMAP__FOLD
#undef CONEMAP__FARTHEST
#undef CONEMAP__LEAF
#undef CONEMAP__CHAIN

#endif /* CONEMAP_IMPLEMENTATION */

/* ####################################################################################################### */
#ifdef CONEMAP__LANES /* included by itself, once for each instruction set: see K E R N E L S */

#define CONEMAP__FUNCTION CONEMAP__TARGET static
#ifdef _MSC_VER
#define CONEMAP__HELPER static __forceinline
#elif defined(__GNUC__) || defined(__clang__)
#define CONEMAP__HELPER CONEMAP__TARGET static inline __attribute__((always_inline))
#else
#define CONEMAP__HELPER static inline
#endif

/* ---- rows whose last vector is not full: the missing lanes read zeros ------------------------------------------- */

CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(load)(const float *from, int count) {
    float lanes[CONEMAP__LANES] = {0};
    if (count >= CONEMAP__LANES) return CONEMAP__LOADF(from);
    memcpy(lanes, from, (size_t)count * sizeof(float));
    return CONEMAP__LOADF(lanes);
}

CONEMAP__HELPER void CONEMAP__KERNEL(store)(float *to, CONEMAP__F value, int count) {
    float lanes[CONEMAP__LANES];
    if (count >= CONEMAP__LANES) {
        CONEMAP__STOREF(to, value);
        return;
    }
    CONEMAP__STOREF(lanes, value);
    memcpy(to, lanes, (size_t)count * sizeof(float));
}

/* ---- codes and values ----------------------------------------------------------------------------- */

CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(value)(conemap_format format, CONEMAP__I code) {
    CONEMAP__I sign, exponent, mantissa, bits;
    switch (format) {
    case CONEMAP_UNORM16: return CONEMAP__DIV(CONEMAP__TOF(code), CONEMAP__F1(65535.0f));
    case CONEMAP_UNORM8: return CONEMAP__DIV(CONEMAP__TOF(code), CONEMAP__F1(255.0f));
    case CONEMAP_F16: break;
    default: return CONEMAP__BITSF(code);
    }
    sign = CONEMAP__ISHL(CONEMAP__IAND(code, CONEMAP__I1(0x8000)), 16);
    exponent = CONEMAP__IAND(CONEMAP__ISHR(code, 10), CONEMAP__I1(31));
    mantissa = CONEMAP__IAND(code, CONEMAP__I1(1023));
    bits = CONEMAP__ISHL(CONEMAP__IADD(exponent, CONEMAP__I1(112)), 23);
    bits = CONEMAP__PICKI(CONEMAP__IEQ(exponent, CONEMAP__I1(31)), CONEMAP__I1(0x7f800000), bits);
    bits = CONEMAP__IOR(bits, CONEMAP__ISHL(mantissa, 13));
    bits = CONEMAP__PICKI(CONEMAP__IEQ(exponent, CONEMAP__I1(0)),
                          CONEMAP__BITSI(CONEMAP__MUL(CONEMAP__TOF(mantissa), CONEMAP__F1(1.0f / 16777216.0f))), bits);
    return CONEMAP__BITSF(CONEMAP__IOR(bits, sign));
}

/* The code of the value nearest to a height, 0..1. */
CONEMAP__HELPER CONEMAP__I CONEMAP__KERNEL(code_near)(conemap_format format, CONEMAP__F x) {
    CONEMAP__I bits, half, tiny;
    CONEMAP__F scaled, rest;
    switch (format) {
    case CONEMAP_UNORM16:
        return CONEMAP__TOI(CONEMAP__ADD(CONEMAP__MUL(x, CONEMAP__F1(65535.0f)), CONEMAP__F1(0.5f)));
    case CONEMAP_UNORM8: return CONEMAP__TOI(CONEMAP__ADD(CONEMAP__MUL(x, CONEMAP__F1(255.0f)), CONEMAP__F1(0.5f)));
    case CONEMAP_F16: break;
    default: return CONEMAP__BITSI(x);
    }
    bits = CONEMAP__BITSI(x); /* ties to even */
    half = CONEMAP__IADD(bits, CONEMAP__IAND(CONEMAP__ISHR(bits, 13), CONEMAP__I1(1)));
    half = CONEMAP__ISUB(CONEMAP__ISHR(CONEMAP__IADD(half, CONEMAP__I1(0xfff)), 13), CONEMAP__I1(112 << 10));
    scaled = CONEMAP__MUL(CONEMAP__MIN(x, CONEMAP__F1(1.0f / 16384.0f)), CONEMAP__F1(16777216.0f));
    tiny = CONEMAP__TOI(scaled);
    rest = CONEMAP__SUB(scaled, CONEMAP__TOF(tiny));
    tiny = CONEMAP__IADD(
        tiny, CONEMAP__PICKI(CONEMAP__LT(CONEMAP__F1(0.5f), rest), CONEMAP__I1(1),
                             CONEMAP__PICKI(CONEMAP__LT(rest, CONEMAP__F1(0.5f)), CONEMAP__I1(0),
                                            CONEMAP__IAND(tiny, CONEMAP__I1(1)))));
    return CONEMAP__PICKI(CONEMAP__LT(x, CONEMAP__F1(1.0f / 16384.0f)), tiny, half);
}

/* The code of the largest value at or below x, 0 or more. */
CONEMAP__HELPER CONEMAP__I CONEMAP__KERNEL(code_down)(conemap_format format, CONEMAP__F x) {
    CONEMAP__I code, less;
    CONEMAP__M over;
    if (format == CONEMAP_F32) return CONEMAP__BITSI(x);
    if (format == CONEMAP_F16) {
        CONEMAP__M is_tiny = CONEMAP__LT(x, CONEMAP__F1(1.0f / 16384.0f));
        CONEMAP__I tiny = CONEMAP__TOI(CONEMAP__MUL(CONEMAP__MIN(x, CONEMAP__F1(1.0f)), CONEMAP__F1(16777216.0f)));
        x = CONEMAP__MIN(x, CONEMAP__F1(65504.0f));
        code = CONEMAP__ISUB(CONEMAP__ISHR(CONEMAP__BITSI(x), 13), CONEMAP__I1(112 << 10));
        return CONEMAP__PICKI(is_tiny, tiny, code);
    }
    code = CONEMAP__TOI(CONEMAP__MUL(CONEMAP__MIN(x, CONEMAP__F1(1.0f)),
                                     CONEMAP__F1(format == CONEMAP_UNORM8 ? 255.0f : 65535.0f)));
    less = CONEMAP__ISUB(code, CONEMAP__I1(1));
    over = CONEMAP__AND(CONEMAP__IGT(code, CONEMAP__I1(0)), CONEMAP__LT(x, CONEMAP__KERNEL(value)(format, code)));
    return CONEMAP__PICKI(over, less, code); /* the product may round up */
}

/* ---- heights in ------------------------------------------------------------------------------------------------- */

/* LANES codes, of which the last ones may be missing; those read as 0. */
CONEMAP__HELPER CONEMAP__I CONEMAP__KERNEL(read_codes)(conemap_format format, const unsigned char *bytes,
                                                       ptrdiff_t stride, int count) {
    int32_t codes[CONEMAP__LANES] = {0};
    int k;
    if (count >= CONEMAP__LANES && stride == (ptrdiff_t)conemap__format_size(format)) {
        if (format == CONEMAP_UNORM8) return CONEMAP__LOADU8(bytes);
        if (format != CONEMAP_F32) return CONEMAP__LOADU16(bytes);
        memcpy(codes, bytes, sizeof codes);
        return CONEMAP__LOADI(codes);
    }
    for (k = 0; k < CONEMAP__LANES && k < count; ++k)
        codes[k] = (int32_t)conemap__read_code(format, bytes + (ptrdiff_t)k * stride);
    return CONEMAP__LOADI(codes);
}

CONEMAP__FUNCTION int CONEMAP__KERNEL(decode_row)(const conemap_info *info, const conemap_heights *h, int y,
                                                  float *row) {
    const unsigned char *bytes = (const unsigned char *)h->pixels + (ptrdiff_t)y * h->row_stride;
    int x, quantise = info->texture.layout != CONEMAP_CONE_ONLY;
    for (x = 0; x < h->width; x += CONEMAP__LANES) {
        CONEMAP__F value = CONEMAP__KERNEL(value)(
            h->format, CONEMAP__KERNEL(read_codes)(h->format, bytes + (ptrdiff_t)x * h->pixel_stride, h->pixel_stride,
                                                   h->width - x));
        CONEMAP__I bits = CONEMAP__BITSI(value);
        /* by the bits, for fast-math builds: 0x80000000 is -0, which is a height; other negative ones are not */
        CONEMAP__M bad = CONEMAP__OR(CONEMAP__IGT(bits, CONEMAP__I1(0x3f800000)),
                                     CONEMAP__ANDNOT(CONEMAP__IGT(CONEMAP__I1(0), bits),
                                                     CONEMAP__IEQ(CONEMAP__ISHL(bits, 1), CONEMAP__I1(0))));
        if (CONEMAP__ANY(bad)) return 0;
        value = h->is_depth ? CONEMAP__SUB(CONEMAP__F1(1.0f), value)
                            : CONEMAP__ADD(value, CONEMAP__F1(0.0f)); /* -0 becomes 0 */
        if (quantise)
            value = CONEMAP__KERNEL(value)(info->texture.format,
                                           CONEMAP__KERNEL(code_near)(info->texture.format, value));
        CONEMAP__KERNEL(store)(row + x, value, h->width - x);
    }
    return 1;
}

/* ---- cones out -------------------------------------------------------------------------------------------------- */

CONEMAP__FUNCTION void CONEMAP__KERNEL(tangent_row)(const float *const *slopes2, int rows, float margin,
                                                    float max_tan, int count, float *out) {
    int x, k;
    for (x = 0; x < count; x += CONEMAP__LANES) {
        CONEMAP__F s = CONEMAP__KERNEL(load)(slopes2[0] + x, count - x);
        for (k = 1; k < rows; ++k) s = CONEMAP__MAX(s, CONEMAP__KERNEL(load)(slopes2[k] + x, count - x));
        s = CONEMAP__MUL(CONEMAP__DIV(CONEMAP__F1(1.0f), CONEMAP__SQRT(s)), CONEMAP__F1(margin));
        CONEMAP__KERNEL(store)(out + x, CONEMAP__MIN(s, CONEMAP__F1(max_tan)), count - x);
    }
}

CONEMAP__FUNCTION void CONEMAP__KERNEL(narrowest_row)(const float *const *rows, int width, int wraps, int first,
                                                      int count, float *out) {
    int x, k, end = first + count;
    for (x = first; x < end;) {
        CONEMAP__F least = CONEMAP__F1(CONEMAP__FAR);
        if (x > 0 && x + CONEMAP__LANES < width && x + CONEMAP__LANES <= end) {
            for (k = 0; k < 3; ++k) {
                least = CONEMAP__MIN(least, CONEMAP__LOADF(rows[k] + x - 1));
                least = CONEMAP__MIN(least, CONEMAP__LOADF(rows[k] + x));
                least = CONEMAP__MIN(least, CONEMAP__LOADF(rows[k] + x + 1));
            }
            CONEMAP__STOREF(out + (x - first), least);
            x += CONEMAP__LANES;
        } else { /* at the borders one by one */
            int before = x > 0 ? x - 1 : wraps ? width - 1 : 0;
            int after = x + 1 < width ? x + 1 : wraps ? 0 : width - 1;
            float narrowest = CONEMAP__FAR;
            for (k = 0; k < 3; ++k)
                narrowest = conemap__min(conemap__min(narrowest, rows[k][before]),
                                         conemap__min(rows[k][x], rows[k][after]));
            out[x - first] = narrowest;
            ++x;
        }
    }
}

CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(decode_tan)(const conemap_info *info, CONEMAP__F height, CONEMAP__F stored) {
    CONEMAP__F top = CONEMAP__SUB(CONEMAP__F1(1.0f), height), max_tan = CONEMAP__F1(info->max_tan);
    if (info->texture.encoding == CONEMAP_SQRT) return CONEMAP__MUL(stored, stored);
    if (info->texture.encoding == CONEMAP_LINEAR) return stored;
    return CONEMAP__PICK(CONEMAP__LT(stored, CONEMAP__MUL(max_tan, top)), CONEMAP__DIV(stored, top),
                         CONEMAP__PICK(CONEMAP__LT(CONEMAP__F1(0.0f), top), max_tan, CONEMAP__F1(0.0f)));
}

/* Rounding to nearest, as [Dum06] stores, widens. */
CONEMAP__FUNCTION void CONEMAP__KERNEL(store_row)(const conemap_info *info, const float *heights, const float *tangents,
                                                  int count, float *cones) {
    conemap_format format = info->texture.format;
    int x;
    for (x = 0; x < count; x += CONEMAP__LANES) {
        CONEMAP__F tangent = CONEMAP__KERNEL(load)(tangents + x, count - x), value = tangent;
        CONEMAP__F height = CONEMAP__KERNEL(load)(heights + x, count - x);
        CONEMAP__I code;
        if (info->texture.encoding == CONEMAP_SQRT) value = CONEMAP__SQRT(tangent);
        if (info->texture.encoding == CONEMAP_RADIUS)
            value = CONEMAP__MUL(CONEMAP__SUB(CONEMAP__F1(1.0f), height), tangent);
        code = CONEMAP__KERNEL(code_down)(format, value);
        value = CONEMAP__KERNEL(value)(format, code);
        for (;;) {
            CONEMAP__M wide = CONEMAP__AND(CONEMAP__IGT(code, CONEMAP__I1(0)),
                                           CONEMAP__LT(tangent, CONEMAP__KERNEL(decode_tan)(info, height, value)));
            if (!CONEMAP__ANY(wide)) break;
            code = CONEMAP__PICKI(wide, CONEMAP__ISUB(code, CONEMAP__I1(1)), code);
            value = CONEMAP__KERNEL(value)(format, code);
        }
        CONEMAP__KERNEL(store)(cones + x, value, count - x);
    }
}

/* ---- maxima and slopes ------------------------------------------------------------------------------------------- */

CONEMAP__FUNCTION void CONEMAP__KERNEL(maxima_row)(const float *above, const float *below, int width, float *out) {
    int x = 0;
    for (; 2 * (x + CONEMAP__LANES) <= width; x += CONEMAP__LANES) {
        CONEMAP__F first = CONEMAP__MAX(CONEMAP__LOADF(above + 2 * x), CONEMAP__LOADF(below + 2 * x));
        CONEMAP__F second = CONEMAP__MAX(CONEMAP__LOADF(above + 2 * x + CONEMAP__LANES),
                                         CONEMAP__LOADF(below + 2 * x + CONEMAP__LANES));
        CONEMAP__STOREF(out + x, CONEMAP__MAX(CONEMAP__EVEN(first, second), CONEMAP__ODD(first, second)));
    }
    for (; 2 * x < width; ++x) {
        int next = conemap__mini(2 * x + 1, width - 1);
        out[x] = conemap__max(conemap__max(above[2 * x], above[next]), conemap__max(below[2 * x], below[next]));
    }
}

/* The same as conemap__slope2. */
CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(slope2)(CONEMAP__F other, CONEMAP__F apex, float d2) {
    CONEMAP__F dh = CONEMAP__MAX(CONEMAP__SUB(other, apex), CONEMAP__F1(0.0f));
    return CONEMAP__DIV(CONEMAP__MUL(dh, dh), CONEMAP__F1(d2));
}

/* LANES of a row from column x on, which may lie beyond its ends; `missing` stands there unless the row wraps, or its
   ends are repeated. */
CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(beside)(const float *row, int x, int width, int wraps, int repeats,
                                                   float missing) {
    float lanes[CONEMAP__LANES];
    int t;
    if (x >= 0 && x + CONEMAP__LANES <= width) return CONEMAP__LOADF(row + x);
    for (t = 0; t < CONEMAP__LANES; ++t) {
        int at = x + t;
        if (wraps) at = conemap__repeat(at, width);
        if (repeats) at = at < 0 ? 0 : at >= width ? width - 1 : at;
        lanes[t] = at >= 0 && at < width ? row[at] : missing;
    }
    return CONEMAP__LOADF(lanes);
}

CONEMAP__FUNCTION void CONEMAP__KERNEL(ring_row)(const float *const *rows, int width, int wraps, float a, float b,
                                                 float least, float *out) {
    float d2[3];
    int x, k, c;
    d2[0] = a * a;
    d2[1] = b * b;
    d2[2] = a * a + b * b;
    for (x = 0; x < width; x += CONEMAP__LANES) {
        CONEMAP__F apex = CONEMAP__KERNEL(load)(rows[1] + x, width - x), best = CONEMAP__F1(least);
        for (k = 0; k < 3; ++k)
            for (c = -1; rows[k] && c <= 1; ++c)
                if (k != 1 || c != 0)
                    best = CONEMAP__MAX(best, CONEMAP__KERNEL(slope2)(
                                                  CONEMAP__KERNEL(beside)(rows[k], x + c, width, wraps, 0, -1.0f), apex,
                                                  d2[k == 1 ? 0 : c == 0 ? 1 : 2]));
        CONEMAP__KERNEL(store)(out + x, best, width - x);
    }
}

CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(larger)(CONEMAP__F a, CONEMAP__F b) { /* of the magnitudes */
    CONEMAP__F zero = CONEMAP__F1(0.0f);
    return CONEMAP__MAX(CONEMAP__MAX(a, CONEMAP__SUB(zero, a)), CONEMAP__MAX(b, CONEMAP__SUB(zero, b)));
}

/* A slope along an axis whose texels may have no length. */
CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(over)(CONEMAP__F rise, float length) {
    return length > 0.0f ? CONEMAP__DIV(rise, CONEMAP__F1(length)) : CONEMAP__F1(0.0f);
}

CONEMAP__FUNCTION void CONEMAP__KERNEL(gradient_row)(const float *above, const float *below, int width, int wraps,
                                                     float a, float b, float *out) {
    int x;
    for (x = 0; x < width; x += CONEMAP__LANES) {
        CONEMAP__F h00 = CONEMAP__KERNEL(load)(above + x, width - x), h01 = CONEMAP__KERNEL(load)(below + x, width - x);
        CONEMAP__F h10 = CONEMAP__KERNEL(beside)(above, x + 1, width, wraps, 1, 0.0f);
        CONEMAP__F h11 = CONEMAP__KERNEL(beside)(below, x + 1, width, wraps, 1, 0.0f);
        CONEMAP__F along = CONEMAP__KERNEL(larger)(CONEMAP__SUB(h10, h00), CONEMAP__SUB(h11, h01));
        CONEMAP__F across = CONEMAP__KERNEL(larger)(CONEMAP__SUB(h01, h00), CONEMAP__SUB(h11, h10));
        along = CONEMAP__KERNEL(over)(along, a);
        across = CONEMAP__KERNEL(over)(across, b);
        CONEMAP__KERNEL(store)(out + x, CONEMAP__ADD(CONEMAP__MUL(along, along), CONEMAP__MUL(across, across)),
                               width - x);
    }
}

/* Step 3 of the proof of safe cones: an edge of length l at distance c, its ends `first` (at the foot of the
   perpendicular) and `last` above the eye. */
CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(edge)(CONEMAP__F first, CONEMAP__F last, float l, float c) {
    CONEMAP__F zero = CONEMAP__F1(0.0f), rise, foot, end;
    CONEMAP__M inside;
    if (!(l > 0.0f && c > 0.0f)) return zero;
    rise = CONEMAP__DIV(CONEMAP__MAX(CONEMAP__SUB(last, first), zero), CONEMAP__F1(l));
    first = CONEMAP__MAX(first, zero);
    last = CONEMAP__MAX(last, zero);
    foot = CONEMAP__DIV(CONEMAP__MUL(first, first), CONEMAP__F1(c * c));
    end = CONEMAP__DIV(CONEMAP__MUL(last, last), CONEMAP__F1(l * l + c * c));
    inside = CONEMAP__LT(CONEMAP__MUL(rise, CONEMAP__F1(c * c)), CONEMAP__MUL(first, CONEMAP__F1(l)));
    return CONEMAP__PICK(inside, CONEMAP__ADD(foot, CONEMAP__MUL(rise, rise)), CONEMAP__MAX(foot, end));
}

/* Step 3: a texel looks over its own cells. What is missing stands low, so it adds nothing. */
CONEMAP__FUNCTION void CONEMAP__KERNEL(corners_row)(const float *const *rows, int width, int wraps, float a, float b,
                                                    float least, float *out) {
    int x, c, r;
    for (x = 0; x < width; x += CONEMAP__LANES) {
        CONEMAP__F apex = CONEMAP__KERNEL(load)(rows[1] + x, width - x), best = CONEMAP__F1(least), along[2],
            slope_x[2];
        for (c = 0; c < 2; ++c) {
            along[c] = CONEMAP__SUB(CONEMAP__KERNEL(beside)(rows[1], x + 2 * c - 1, width, wraps, 0, -1.0f), apex);
            slope_x[c] = CONEMAP__KERNEL(over)(CONEMAP__MAX(along[c], CONEMAP__F1(0.0f)), a);
            slope_x[c] = CONEMAP__MUL(slope_x[c], slope_x[c]);
            best = CONEMAP__MAX(best, slope_x[c]);
        }
        for (r = 0; r < 3; r += 2) {
            CONEMAP__F across, slope_y;
            if (!rows[r]) continue;
            across = CONEMAP__SUB(CONEMAP__KERNEL(load)(rows[r] + x, width - x), apex);
            slope_y = CONEMAP__KERNEL(over)(CONEMAP__MAX(across, CONEMAP__F1(0.0f)), b);
            slope_y = CONEMAP__MUL(slope_y, slope_y);
            for (c = 0; c < 2; ++c) {
                CONEMAP__F opposite =
                    CONEMAP__SUB(CONEMAP__KERNEL(beside)(rows[r], x + 2 * c - 1, width, wraps, 0, -1.0f), apex);
                best = CONEMAP__MAX(best, CONEMAP__ADD(slope_x[c], slope_y));
                best = CONEMAP__MAX(best, CONEMAP__KERNEL(edge)(along[c], opposite, b, a));
                best = CONEMAP__MAX(best, CONEMAP__KERNEL(edge)(across, opposite, a, b));
            }
        }
        CONEMAP__KERNEL(store)(out + x, best, width - x);
    }
}

CONEMAP__FUNCTION void CONEMAP__KERNEL(near_row)(const float *row, const float *const *rows, const int *columns,
                                                 const float *inverse, int n, int width, int wraps, int first,
                                                     int count,
                                                 float *out) {
    int x, k;
    for (x = 0; x < count; x += CONEMAP__LANES) {
        CONEMAP__F apex = CONEMAP__KERNEL(load)(row + first + x, count - x), best = CONEMAP__F1(0.0f);
        for (k = 0; k < n; ++k) {
            CONEMAP__F dh = CONEMAP__SUB(
                CONEMAP__KERNEL(beside)(rows[k], first + x + columns[k], width, wraps, 0, -1.0f), apex);
            dh = CONEMAP__MAX(dh, CONEMAP__F1(0.0f));
            best = CONEMAP__MAX(best, CONEMAP__MUL(CONEMAP__MUL(dh, dh), CONEMAP__F1(inverse[k])));
        }
        CONEMAP__KERNEL(store)(out + x, best, count - x);
    }
}

CONEMAP__FUNCTION void CONEMAP__KERNEL(sights_row)(const conemap__sights *sights, const float *const *rows, int width,
                                                   int wraps, const float *known, int first, int count, float *out) {
    const float missing = -1.0e30f;
    int x, k, i, j, of_cells = known != NULL;
    for (x = 0; x < count; x += CONEMAP__LANES) {
        CONEMAP__F best = CONEMAP__KERNEL(load)(out + x, count - x), sign = CONEMAP__F1(of_cells ? -1.0f : 1.0f);
        if (of_cells) { /* what its corners have is all the same as a cell's own */
            best = CONEMAP__MAX(best, CONEMAP__KERNEL(beside)(known, first + x, width, wraps, 1, 0.0f));
            best = CONEMAP__MAX(best, CONEMAP__KERNEL(beside)(known, first + x + sights->step_x, width, wraps, 1,
                                                              0.0f));
        }
        for (k = 0; k < sights->count; ++k) {
            int left = first + x + (of_cells ? 0 : sights->x[k]);
            int top = of_cells ? 0 : sights->y[k], eye = first + x - (of_cells ? sights->x[k] : 0);
            const float *upper = rows[top], *lower = rows[top + sights->step_y],
                *eyes = rows[of_cells ? -sights->y[k] : 0];
            const float *inverse = sights->inverse + sights->first[k];
            CONEMAP__F apex, h00, h10, h01, h11, least, seen;
            if (!upper || !lower || !eyes) continue;
            apex = CONEMAP__KERNEL(beside)(eyes, eye, width, wraps, 0, missing);
            h00 = CONEMAP__KERNEL(beside)(upper, left, width, wraps, 0, missing);
            h10 = CONEMAP__KERNEL(beside)(upper, left + sights->step_x, width, wraps, 0, missing);
            h01 = CONEMAP__KERNEL(beside)(lower, left, width, wraps, 0, missing);
            h11 = CONEMAP__KERNEL(beside)(lower, left + sights->step_x, width, wraps, 0, missing);
            least = CONEMAP__MIN(CONEMAP__MIN(h00, h10), CONEMAP__MIN(h01, h11));
            h00 = CONEMAP__MUL(CONEMAP__SUB(h00, apex), sign);
            h10 = CONEMAP__MUL(CONEMAP__SUB(h10, apex), sign);
            h01 = CONEMAP__MUL(CONEMAP__SUB(h01, apex), sign);
            h11 = CONEMAP__MUL(CONEMAP__SUB(h11, apex), sign);
            seen = CONEMAP__MAX(CONEMAP__MAX(h00, h10), CONEMAP__MAX(h01, h11)); /* can it matter, with room for
                                                                                    rounding? */
            seen = CONEMAP__MAX(CONEMAP__ADD(seen, CONEMAP__F1(1.0f / 2097152.0f)), CONEMAP__F1(0.0f));
            seen = CONEMAP__MUL(seen, CONEMAP__F1(sights->most[k]));
            if (!CONEMAP__ANY(CONEMAP__AND(CONEMAP__LT(best, CONEMAP__MUL(seen, seen)),
                                           CONEMAP__LT(CONEMAP__F1(0.5f * missing), least))))
                continue;
            seen = CONEMAP__F1(0.0f);
            h10 = CONEMAP__SUB(h10, h00); /* the patch h00 + h10 x + h01 y + h11 x y */
            h11 = CONEMAP__SUB(CONEMAP__SUB(h11, h01), h10);
            h01 = CONEMAP__SUB(h01, h00);
            for (j = 0; j <= CONEMAP__FINEST; j += sights->rows[k]) {
                CONEMAP__F f = CONEMAP__F1(sights->fraction[j]);
                CONEMAP__F rise = CONEMAP__ADD(h00, CONEMAP__MUL(h01, f)),
                    across = CONEMAP__ADD(h10, CONEMAP__MUL(h11, f));
                for (i = 0; i <= CONEMAP__FINEST; i += sights->columns[k]) {
                    f = CONEMAP__F1(sights->fraction[i]);
                    f = CONEMAP__MUL(CONEMAP__ADD(rise, CONEMAP__MUL(across, f)), CONEMAP__F1(*inverse++));
                    seen = CONEMAP__MAX(seen, f);
                }
            }
            seen = CONEMAP__PICK(CONEMAP__LT(CONEMAP__F1(0.5f * missing), least), seen, CONEMAP__F1(0.0f));
            best = CONEMAP__MAX(best, CONEMAP__MUL(seen, seen));
        }
        CONEMAP__KERNEL(store)(out + x, best, count - x);
    }
}

/* The square of the slope to a corner that rises `rise`, by step 4's bound. */
CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(corner)(CONEMAP__F rise, CONEMAP__F x, CONEMAP__F y, float v) {
    CONEMAP__F d2 = CONEMAP__SUB(CONEMAP__ADD(CONEMAP__MUL(x, x), CONEMAP__MUL(y, y)), CONEMAP__F1(v));
    rise = CONEMAP__MAX(rise, CONEMAP__F1(0.0f));
    return CONEMAP__DIV(CONEMAP__MUL(rise, rise), CONEMAP__MAX(d2, CONEMAP__F1(CONEMAP__TINY)));
}

/* Bounds for 8 pieces side by side, lengthwise; those whose bound is not tight yet and could matter go on in pieces of
   their own. */
CONEMAP__FUNCTION float CONEMAP__KERNEL(patch)(const float *h, float x, float y, float size_x, float size_y,
                                               float above, float best) {
    float corners[4][2 * CONEMAP__EIGHTHS], bounds[2 * CONEMAP__EIGHTHS], turned[4], wide = size_x * 0.25f,
        deep = size_y * 0.5f, v;
    int i, k, c, loose = 0, open = 0;
    if (size_x < size_y) { /* the other way about */
        turned[0] = h[0];
        turned[1] = h[2];
        turned[2] = h[1];
        turned[3] = h[3];
        return CONEMAP__KERNEL(patch)(turned, y, x, size_y, size_x, above, best);
    }
    v = 0.25f * (wide * wide + deep * deep);
    for (i = 0; i < CONEMAP__EIGHTHS; i += CONEMAP__LANES) {
        CONEMAP__F zero = CONEMAP__F1(0.0f), fx = CONEMAP__LOADF(conemap__piece_x + i),
            fy = CONEMAP__LOADF(conemap__piece_y + i);
        CONEMAP__F x0 = CONEMAP__ADD(CONEMAP__F1(x), CONEMAP__MUL(fx, CONEMAP__F1(size_x)));
        CONEMAP__F y0 = CONEMAP__ADD(CONEMAP__F1(y), CONEMAP__MUL(fy, CONEMAP__F1(size_y)));
        CONEMAP__F x1 = CONEMAP__ADD(x0, CONEMAP__F1(wide)), y1 = CONEMAP__ADD(y0, CONEMAP__F1(deep));
        CONEMAP__F gx = CONEMAP__ADD(fx, CONEMAP__F1(0.25f)), gy = CONEMAP__ADD(fy, CONEMAP__F1(0.5f));
        CONEMAP__F low = CONEMAP__F1(h[1] - h[0]), high = CONEMAP__F1(h[3] - h[2]);
        CONEMAP__F h00, h10, left, right, top, dx, dy, d2, bound;
        h00 = CONEMAP__ADD(CONEMAP__F1(h[0]), CONEMAP__MUL(low, fx));
        h10 = CONEMAP__ADD(CONEMAP__F1(h[0]), CONEMAP__MUL(low, gx));
        left = CONEMAP__SUB(CONEMAP__ADD(CONEMAP__F1(h[2]), CONEMAP__MUL(high, fx)), h00);
        right = CONEMAP__SUB(CONEMAP__ADD(CONEMAP__F1(h[2]), CONEMAP__MUL(high, gx)), h10);
        CONEMAP__STOREF(corners[0] + i, CONEMAP__ADD(h00, CONEMAP__MUL(left, fy)));
        CONEMAP__STOREF(corners[1] + i, CONEMAP__ADD(h10, CONEMAP__MUL(right, fy)));
        CONEMAP__STOREF(corners[2] + i, CONEMAP__ADD(h00, CONEMAP__MUL(left, gy)));
        CONEMAP__STOREF(corners[3] + i, CONEMAP__ADD(h10, CONEMAP__MUL(right, gy)));
        bound = CONEMAP__MAX(CONEMAP__MAX(CONEMAP__KERNEL(corner)(CONEMAP__LOADF(corners[0] + i), x0, y0, v),
                                          CONEMAP__KERNEL(corner)(CONEMAP__LOADF(corners[1] + i), x1, y0, v)),
                             CONEMAP__MAX(CONEMAP__KERNEL(corner)(CONEMAP__LOADF(corners[2] + i), x0, y1, v),
                                          CONEMAP__KERNEL(corner)(CONEMAP__LOADF(corners[3] + i), x1, y1, v)));
        dx = CONEMAP__MAX(CONEMAP__MAX(x0, CONEMAP__SUB(zero, x1)), zero);
        dy = CONEMAP__MAX(CONEMAP__MAX(y0, CONEMAP__SUB(zero, y1)), zero);
        d2 = CONEMAP__ADD(CONEMAP__MUL(dx, dx), CONEMAP__MUL(dy, dy));
        bound = CONEMAP__PICK(CONEMAP__LT(d2, CONEMAP__F1(2.0f * v)), CONEMAP__F1(CONEMAP__FAR), bound);
        top = CONEMAP__MAX(CONEMAP__MAX(CONEMAP__LOADF(corners[0] + i), CONEMAP__LOADF(corners[1] + i)),
                           CONEMAP__MAX(CONEMAP__LOADF(corners[2] + i), CONEMAP__LOADF(corners[3] + i)));
        top = CONEMAP__MAX(top, zero);
        bound = CONEMAP__MIN(bound, CONEMAP__DIV(CONEMAP__MUL(top, top), CONEMAP__MAX(d2, CONEMAP__F1(CONEMAP__TINY))));
        bound = CONEMAP__MIN(bound, CONEMAP__F1(above));
        CONEMAP__STOREF(bounds + i, bound);
        open |= CONEMAP__BITS(CONEMAP__LT(CONEMAP__F1(best), bound)) << i;
        loose |= CONEMAP__BITS(CONEMAP__LT(CONEMAP__MUL(d2, CONEMAP__F1(CONEMAP__TOLERANCE)), CONEMAP__F1(v))) << i;
    }
    open &= deep > 0.0f ? (1 << CONEMAP__EIGHTHS) - 1 : (1 << CONEMAP__EIGHTHS / 2) - 1; /* else the others are the
                                                                                            same */
    for (k = 0; open >> k; ++k)
        if ((open & ~loose) >> k & 1) best = conemap__max(best, bounds[k]);
    for (k = 0, open &= loose; open >> k; ++k) {
        if (!(open >> k & 1) || !(bounds[k] > best)) continue;
        for (c = 0; c < 4; ++c) turned[c] = corners[c][k];
        best = CONEMAP__KERNEL(patch)(turned, x + conemap__piece_x[k] * size_x, y + conemap__piece_y[k] * size_y, wide,
                                      deep, bounds[k], best);
    }
    return best;
}

CONEMAP__FUNCTION void CONEMAP__KERNEL(steepest_row)(const float *const *rows, const int *columns, int n, int width,
                                                     int wraps, int first, int count, float *out) {
    int x, k;
    for (x = 0; x < count; x += CONEMAP__LANES) {
        CONEMAP__F best = CONEMAP__F1(0.0f);
        for (k = 0; k < n; ++k)
            best = CONEMAP__MAX(best, CONEMAP__KERNEL(beside)(rows[k], first + x + columns[k], width, wraps, 1, 0.0f));
        CONEMAP__KERNEL(store)(out + x, best, count - x);
    }
}

/* See conemap__quick_axis. */
CONEMAP__FUNCTION void CONEMAP__KERNEL(quick_row)(const conemap_pyramid *pyramid, const conemap__quick_columns *columns,
                                                  const conemap__quick_level *levels, const float *heights, float least,
                                                  int count, float *out) {
    int i, k, a, b;
    for (i = 0; i < count; i += CONEMAP__LANES) {
        CONEMAP__F apex = CONEMAP__KERNEL(load)(heights + i, count - i), s = CONEMAP__F1(least);
        for (k = 0; k < pyramid->levels; ++k) {
            CONEMAP__M open = CONEMAP__IEQ(CONEMAP__LOADI(columns->full[k] + i), CONEMAP__I1(0));
            if (levels[k].full && !CONEMAP__ANY(open)) break;
            for (b = 0; b < 3; ++b) {
                const float *row = conemap__maxima(pyramid, k, levels[k].node[b]);
                if (levels[k].q[b] >= CONEMAP__FAR) continue; /* no such block */
                for (a = 0; a < 3; ++a) {
                    CONEMAP__F dh, d2, other;
                    if (a == 1 && b == 1) continue;
                    dh = CONEMAP__SUB(CONEMAP__GATHERF(row, CONEMAP__LOADI(columns->node[k][a] + i)), apex);
                    dh = CONEMAP__MAX(dh, CONEMAP__F1(0.0f));
                    d2 = CONEMAP__ADD(CONEMAP__LOADF(columns->p[k][a] + i), CONEMAP__F1(levels[k].q[b]));
                    other = CONEMAP__ADD(CONEMAP__LOADF(columns->q[k][a] + i), CONEMAP__F1(levels[k].p[b]));
                    d2 = CONEMAP__DIV(CONEMAP__MUL(dh, dh), CONEMAP__MIN(d2, other));
                    if (levels[k].full) d2 = CONEMAP__PICK(open, d2, CONEMAP__F1(0.0f));
                    s = CONEMAP__MAX(s, d2);
                }
            }
        }
        CONEMAP__KERNEL(store)(out + i, s, count - i);
    }
}

/* ---- the search of a tile: see G E N E R A T I O N
   ----------------------------------------------------------------- */

/* Squares of the distances from the tile's columns, or rows, to the places from first to last; `less` is taken off. */
CONEMAP__HELPER void CONEMAP__KERNEL(distances2)(int first, int last, float texel, float less, float *out) {
    int i;
    for (i = 0; i < CONEMAP__TILE; i += CONEMAP__LANES) {
        CONEMAP__F place = CONEMAP__LOADF(conemap__places + i), d;
        d = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1((float)first), place), CONEMAP__SUB(place, CONEMAP__F1((float)last)));
        d = CONEMAP__MUL(CONEMAP__MAX(d, CONEMAP__F1(0.0f)), CONEMAP__F1(texel));
        CONEMAP__STOREF(out + i, CONEMAP__SUB(CONEMAP__MUL(d, d), CONEMAP__F1(less)));
    }
}

/* A tile is gone through in parts: rows, or with one lane groups of 2 x 2 texels, of which those are left out for which
   a block was in vain above. */
#define CONEMAP__PART_WIDTH (CONEMAP__LANES == 1 ? 2 : CONEMAP__TILE)
#define CONEMAP__PART_HEIGHT (CONEMAP__LANES == 1 || CONEMAP__LANES > CONEMAP__TILE ? 2 : 1)
#define CONEMAP__LANE_WIDTH (CONEMAP__LANES < CONEMAP__TILE ? CONEMAP__LANES : CONEMAP__TILE)
#define CONEMAP__LANE_HEIGHT (CONEMAP__LANES > CONEMAP__TILE ? 2 : 1)

/* The number of the row, or of the two rows, in which a vector of texels lies. */
CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(of_row)(const float *row) {
    if (CONEMAP__LANES <= CONEMAP__TILE) return CONEMAP__F1(row[0]);
    return CONEMAP__PICK(CONEMAP__IGT(CONEMAP__LOADI(conemap__second_row), CONEMAP__I1(0)), CONEMAP__F1(row[1]),
                         CONEMAP__F1(row[0]));
}

/* Which texels may see something steeper than their bar in a block as high as this? Leaves dh^2 and d^2. One lane looks
   only where it is `asked` to. */
CONEMAP__HELPER CONEMAP__M CONEMAP__KERNEL(beats)(int asked, float highest, CONEMAP__F apex, CONEMAP__F bar,
                                                  CONEMAP__F x2, CONEMAP__F y2, int plain, CONEMAP__F *dh2,
                                                  CONEMAP__F *d2) {
    CONEMAP__F dh;
    if (CONEMAP__LANES == 1 && !asked) return CONEMAP__LT(apex, apex);
    dh = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1(highest), apex), CONEMAP__F1(0.0f));
    *dh2 = CONEMAP__MUL(dh, dh);
    *d2 = CONEMAP__ADD(x2, y2);
    if (!plain) *d2 = CONEMAP__MAX(*d2, CONEMAP__F1(0.0f)); /* V may have been more */
    return CONEMAP__LT(CONEMAP__MUL(bar, *d2), *dh2);
}

/* Of those the ones that do. */
CONEMAP__HELPER void CONEMAP__KERNEL(take)(const conemap__search *search, CONEMAP__M beats, CONEMAP__F dh2,
                                           CONEMAP__F d2, int number, int plain, CONEMAP__F *least, CONEMAP__F *s,
                                           CONEMAP__I *decider) {
    CONEMAP__F slope2;
    if (!plain) beats = CONEMAP__AND(beats, CONEMAP__LE(CONEMAP__F1(search->near2 - search->deflate), d2));
    if (CONEMAP__LANES == 1 && !CONEMAP__ANY(beats)) return;
    slope2 = CONEMAP__DIV(dh2, d2);
    beats = CONEMAP__AND(beats, CONEMAP__LT(*least, slope2));
    *least = CONEMAP__PICK(beats, slope2, *least);
    *s = CONEMAP__PICK(beats, slope2, *s);
    *decider = CONEMAP__PICKI(beats, CONEMAP__I1(number), *decider);
}

/* Texels from i on: tests up to four texels against them. Returns whether one is steeper for some. */
CONEMAP__HELPER int CONEMAP__KERNEL(look_from)(const conemap__search *search, conemap__tile *tile, int i,
                                               CONEMAP__F left, CONEMAP__F right, CONEMAP__F top, CONEMAP__F bottom,
                                               const float *heights, int texels, int number, int plain) {
    CONEMAP__F apex = CONEMAP__LOADF(tile->height + i), least = CONEMAP__LOADF(tile->slope2 + i), s = least, bar;
    CONEMAP__F zero = CONEMAP__F1(0.0f), dh2[4], d2[4];
    CONEMAP__M beats[4];
    CONEMAP__I decider;
    dh2[0] = dh2[1] = dh2[2] = dh2[3] = d2[0] = d2[1] = d2[2] = d2[3] = zero;
    if (!plain) least = CONEMAP__MAX(s, CONEMAP__LOADF(tile->folded + i));
    bar = CONEMAP__MUL(least, CONEMAP__F1(CONEMAP__MARGIN));
    beats[0] = CONEMAP__KERNEL(beats)(1, heights[0], apex, bar, left, top, 1, &dh2[0], &d2[0]);
    if (texels == 1) {
        if (!CONEMAP__ANY(beats[0])) return 0;
    } else {
        beats[1] = CONEMAP__KERNEL(beats)(1, heights[1], apex, bar, right, top, 1, &dh2[1], &d2[1]);
        beats[2] = CONEMAP__KERNEL(beats)(1, heights[2], apex, bar, left, bottom, 1, &dh2[2], &d2[2]);
        beats[3] = CONEMAP__KERNEL(beats)(1, heights[3], apex, bar, right, bottom, 1, &dh2[3], &d2[3]);
        if (!CONEMAP__ANY(CONEMAP__OR(CONEMAP__OR(beats[0], beats[1]), CONEMAP__OR(beats[2], beats[3])))) return 0;
    }
    decider = CONEMAP__LOADI(tile->decider + i);
    CONEMAP__KERNEL(take)(search, beats[0], dh2[0], d2[0], number, plain, &least, &s, &decider);
    if (texels > 1) {
        CONEMAP__KERNEL(take)(search, beats[1], dh2[1], d2[1], number + 1, plain, &least, &s, &decider);
        CONEMAP__KERNEL(take)(search, beats[2], dh2[2], d2[2], number + 2, plain, &least, &s, &decider);
        CONEMAP__KERNEL(take)(search, beats[3], dh2[3], d2[3], number + 3, plain, &least, &s, &decider);
    }
    CONEMAP__STOREF(tile->slope2 + i, s);
    CONEMAP__STOREI(tile->decider + i, decider);
    return 1;
}

/* Tests texels (x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1), or only the first, against the tile's. Places count from
   the tile's corner. `plain`: vertex cones without slack. */
CONEMAP__HELPER void CONEMAP__KERNEL(look_at)(const conemap__search *search, conemap__tile *tile, int groups, int x,
                                              int y, const float *heights, int texels, int plain) {
    float x2[2][2 * CONEMAP__TILE], y2[2][2 * CONEMAP__TILE];
    int c, u, v, i, j, noted, any = 0;
    if (tile->noted + 4 > CONEMAP__NOTED) tile->noted = 1; /* these are hints only */
    noted = tile->noted;
    for (c = 0; c < 2; ++c) {
        CONEMAP__KERNEL(distances2)(x + c, x + c, search->a, 0.0f, x2[c]);
        CONEMAP__KERNEL(distances2)(y + c, y + c, search->b, search->deflate, y2[c]);
    }
    for (v = 0; v < CONEMAP__TILE; v += CONEMAP__PART_HEIGHT)
        for (u = 0; u < CONEMAP__TILE; u += CONEMAP__PART_WIDTH) {
            int won = 0;
            if (CONEMAP__LANES == 1 && !(groups >> (2 * v + u / 2) & 1)) continue;
            for (j = v; j < v + CONEMAP__PART_HEIGHT; j += CONEMAP__LANE_HEIGHT) {
                CONEMAP__F top = CONEMAP__KERNEL(of_row)(y2[0] + j), bottom = CONEMAP__KERNEL(of_row)(y2[1] + j);
                for (i = u; i < u + CONEMAP__PART_WIDTH; i += CONEMAP__LANE_WIDTH)
                    won |= CONEMAP__KERNEL(look_from)(search, tile, CONEMAP__TILE * j + i, CONEMAP__LOADF(x2[0] + i),
                                                      CONEMAP__LOADF(x2[1] + i), top, bottom, heights, texels, noted,
                                                      plain);
            }
            if (CONEMAP__LANES == 1 && won) conemap__lower_bar(tile, 2 * v + u / 2);
            any |= won;
        }
    if (!any) return;
    for (c = 0; c < texels; ++c) {
        tile->noted_x[noted + c] = x + (c & 1) + tile->x + tile->shift_x;
        tile->noted_y[noted + c] = y + (c >> 1) + tile->y + tile->shift_y;
    }
    tile->noted += texels;
}

/* With slack, of the texels for which a block beats the bar those for which it does so by the factor; *folded: the
   others. */
CONEMAP__HELPER CONEMAP__M CONEMAP__KERNEL(beats_by_far)(const conemap__search *search, CONEMAP__M beats,
                                                         CONEMAP__F bar, CONEMAP__F dh2, CONEMAP__F d2,
                                                         CONEMAP__F *folded) {
    CONEMAP__M is_near = CONEMAP__LT(d2, CONEMAP__F1(search->near2 - search->deflate)), wide;
    if (CONEMAP__LANES == 1 && !CONEMAP__ANY(beats)) return beats;
    wide = CONEMAP__OR(is_near, CONEMAP__LT(CONEMAP__MUL(bar, d2), dh2));
    *folded = CONEMAP__MAX(*folded, CONEMAP__PICK(CONEMAP__ANDNOT(beats, wide), CONEMAP__DIV(dh2, d2),
                                                  CONEMAP__F1(0.0f)));
    return CONEMAP__AND(beats, wide);
}

/* Texels from i on: adds those that must look into each of four blocks to `some`. */
CONEMAP__HELPER void CONEMAP__KERNEL(ask_from)(const conemap__search *search, conemap__tile *tile, int i, int asked,
                                               CONEMAP__F left, CONEMAP__F right, CONEMAP__F top, CONEMAP__F bottom,
                                               const float *highest, CONEMAP__M *some, int plain) {
    CONEMAP__F apex = CONEMAP__LOADF(tile->height + i), s = CONEMAP__LOADF(tile->slope2 + i), bar = s;
    CONEMAP__F zero = CONEMAP__F1(0.0f), dh2[4], d2[4];
    CONEMAP__M beats[4];
    dh2[0] = dh2[1] = dh2[2] = dh2[3] = d2[0] = d2[1] = d2[2] = d2[3] = zero;
    if (!plain) bar = CONEMAP__MAX(s, CONEMAP__LOADF(tile->folded + i));
    bar = CONEMAP__MUL(bar, CONEMAP__F1(CONEMAP__MARGIN));
    beats[0] = CONEMAP__KERNEL(beats)(asked & 1, highest[0], apex, bar, left, top, plain, &dh2[0], &d2[0]);
    beats[1] = CONEMAP__KERNEL(beats)(asked & 2, highest[1], apex, bar, right, top, plain, &dh2[1], &d2[1]);
    beats[2] = CONEMAP__KERNEL(beats)(asked & 4, highest[2], apex, bar, left, bottom, plain, &dh2[2], &d2[2]);
    beats[3] = CONEMAP__KERNEL(beats)(asked & 8, highest[3], apex, bar, right, bottom, plain, &dh2[3], &d2[3]);
    if (!plain && search->widen2 > 1.0f &&
        CONEMAP__ANY(CONEMAP__OR(CONEMAP__OR(beats[0], beats[1]), CONEMAP__OR(beats[2], beats[3])))) {
        CONEMAP__F folded = CONEMAP__LOADF(tile->folded + i);
        bar = CONEMAP__MUL(CONEMAP__MUL(s, CONEMAP__F1(CONEMAP__MARGIN)), CONEMAP__F1(search->widen2));
        beats[0] = CONEMAP__KERNEL(beats_by_far)(search, beats[0], bar, dh2[0], d2[0], &folded);
        beats[1] = CONEMAP__KERNEL(beats_by_far)(search, beats[1], bar, dh2[1], d2[1], &folded);
        beats[2] = CONEMAP__KERNEL(beats_by_far)(search, beats[2], bar, dh2[2], d2[2], &folded);
        beats[3] = CONEMAP__KERNEL(beats_by_far)(search, beats[3], bar, dh2[3], d2[3], &folded);
        CONEMAP__STOREF(tile->folded + i, folded);
    }
    some[0] = CONEMAP__OR(some[0], beats[0]);
    some[1] = CONEMAP__OR(some[1], beats[1]);
    some[2] = CONEMAP__OR(some[2], beats[2]);
    some[3] = CONEMAP__OR(some[3], beats[3]);
}

/* Pushes those of four sibling blocks, the children of (x, y) of level k + 1, that some texel must look into; the one
   nearest to the tile comes last and so is popped first. `skip`: a child that is left out, or -1. */
CONEMAP__HELPER int CONEMAP__KERNEL(open)(const conemap_map *map, const conemap__search *search, conemap__tile *tile,
                                          int k, int x, int y, int groups, int skip, conemap__node *out, int plain) {
    const conemap_pyramid *pyramid = &map->build.texels;
    int size = 1 << k, left = 2 * size * x - tile->x, top = 2 * size * y - tile->y, c, u, v, i, j, count = 0;
    int near_x = left + size <= CONEMAP__TILE / 2, near_y = top + size <= CONEMAP__TILE / 2;
    int right_too = 2 * x + 1 < pyramid->width[k], below_too = 2 * y + 1 < pyramid->height[k], alive[4];
    const float *row = conemap__maxima(pyramid, k, 2 * y) + 2 * x;
    float highest[4], x2[2][2 * CONEMAP__TILE], y2[2][2 * CONEMAP__TILE];
    CONEMAP__M some[4], none = CONEMAP__LT(CONEMAP__F1(0.0f), CONEMAP__F1(0.0f));
    highest[0] = row[0];
    highest[1] = right_too ? row[1] : -1.0f;
    highest[2] = below_too ? row[pyramid->width[k]] : -1.0f;
    highest[3] = right_too && below_too ? row[pyramid->width[k] + 1] : -1.0f;
    if (skip >= 0) highest[skip] = -1.0f;
    for (c = 0; c < 2; ++c) {
        CONEMAP__KERNEL(distances2)(left + c * size, left + c * size + size - 1, search->a, 0.0f, x2[c]);
        CONEMAP__KERNEL(distances2)(top + c * size, top + c * size + size - 1, search->b, search->deflate, y2[c]);
    }
    alive[0] = alive[1] = alive[2] = alive[3] = 0;
    some[0] = some[1] = some[2] = some[3] = none;
    for (v = 0; v < CONEMAP__TILE; v += CONEMAP__PART_HEIGHT)
        for (u = 0; u < CONEMAP__TILE; u += CONEMAP__PART_WIDTH) {
            int asked = 15, group = 2 * v + u / 2;
            if (CONEMAP__LANES == 1) {
                if (!(groups >> group & 1)) continue;
                asked = conemap__ask_group(tile, group, highest, x2[0], x2[1], y2[0], y2[1]);
                if (!asked) continue;
                some[0] = some[1] = some[2] = some[3] = none;
            }
            for (j = v; j < v + CONEMAP__PART_HEIGHT; j += CONEMAP__LANE_HEIGHT) {
                CONEMAP__F first = CONEMAP__KERNEL(of_row)(y2[0] + j), second = CONEMAP__KERNEL(of_row)(y2[1] + j);
                for (i = u; i < u + CONEMAP__PART_WIDTH; i += CONEMAP__LANE_WIDTH)
                    CONEMAP__KERNEL(ask_from)(search, tile, CONEMAP__TILE * j + i, asked, CONEMAP__LOADF(x2[0] + i),
                                              CONEMAP__LOADF(x2[1] + i), first, second, highest, some, plain);
            }
            if (CONEMAP__LANES == 1)
                for (c = 0; c < 4; ++c) alive[c] |= CONEMAP__BITS(some[c]) << group;
        }
    if (CONEMAP__LANES > 1) {
        alive[0] = CONEMAP__ANY(some[0]);
        alive[1] = CONEMAP__ANY(some[1]);
        alive[2] = CONEMAP__ANY(some[2]);
        alive[3] = CONEMAP__ANY(some[3]);
    }
    for (c = 3; c >= 0; --c) {
        int across = (c & 1) ^ near_x, down = (c >> 1) ^ near_y;
        out[count].k = k;
        out[count].x = 2 * x + across;
        out[count].y = 2 * y + down;
        out[count].groups = alive[2 * down + across];
        count += alive[2 * down + across] != 0;
    }
    return count;
}

/* Works the stack off, down to blocks of 2 x 2 texels, which are looked at one by one. */
CONEMAP__HELPER void CONEMAP__KERNEL(work_off)(const conemap_map *map, const conemap__search *search,
                                               conemap__tile *tile, conemap__node *stack, int count, int plain) {
    while (count > 0) {
        conemap__node node = stack[--count];
        if (node.k > 1) {
            count += CONEMAP__KERNEL(open)(map, search, tile, node.k - 1, node.x, node.y, node.groups, -1,
                                           stack + count, plain);
        } else {
            int w = map->info.width, x = 2 * node.x, y = 2 * node.y;
            const float *row = map->heights + (size_t)y * (size_t)w + (size_t)x;
            int right_too = x + 1 < w, below_too = y + 1 < map->info.height;
            float heights[4];
            heights[0] = row[0];
            heights[1] = right_too ? row[1] : -1.0f;
            heights[2] = below_too ? row[w] : -1.0f;
            heights[3] = right_too && below_too ? row[w + 1] : -1.0f;
            CONEMAP__KERNEL(look_at)(search, tile, node.groups, x - tile->x, y - tile->y, heights, 4, plain);
        }
    }
}

CONEMAP__HELPER void CONEMAP__KERNEL(search_all)(const conemap_map *map, const conemap__search *search,
                                                 conemap__tile *tile, int plain) {
    conemap__node stack[3 * 17 + 4];
    const conemap_info *info = &map->info;
    int levels = map->build.texels.levels, x0 = tile->x, y0 = tile->y, k, a, b, all = 0xffff;
    int wrap_u = info->wrap_u == CONEMAP_WRAP, wrap_v = info->wrap_v == CONEMAP_WRAP;
    for (k = 0; CONEMAP__LANES == 1 && k < 16; ++k) conemap__sum_up(tile, k);
    tile->shift_x = tile->shift_y = 0;
    for (k = 0; k < search->seeds; ++k) {
        int x = search->seed_x[k], y = search->seed_y[k];
        float height = conemap__height(map, conemap__texel_index(x, info->width, info->wrap_u),
                                       conemap__texel_index(y, info->height, info->wrap_v));
        CONEMAP__KERNEL(look_at)(search, tile, all, x - x0, y - y0, &height, 1, plain);
    }
    if (levels == 1) return; /* a single texel and its images */
    k = conemap__mini(3, levels - 1);
    stack[0].k = k;
    stack[0].x = x0 >> k;
    stack[0].y = y0 >> k;
    stack[0].groups = all;
    CONEMAP__KERNEL(work_off)(map, search, tile, stack, 1, plain);
    for (; k + 1 < levels; ++k) {
        int own = (y0 >> k & 1) << 1 | (x0 >> k & 1);
        int count = CONEMAP__KERNEL(open)(map, search, tile, k, x0 >> (k + 1), y0 >> (k + 1), all, own, stack, plain);
        CONEMAP__KERNEL(work_off)(map, search, tile, stack, count, plain);
    }
    for (b = -wrap_v; b <= wrap_v; ++b)
        for (a = -wrap_u; a <= wrap_u; ++a) {
            int count;
            if (a == 0 && b == 0) continue;
            tile->shift_x = a * info->width;
            tile->shift_y = b * info->height;
            tile->x = x0 - tile->shift_x;
            tile->y = y0 - tile->shift_y;
            count = CONEMAP__KERNEL(open)(map, search, tile, levels - 1, 0, 0, all, -1, stack, plain);
            CONEMAP__KERNEL(work_off)(map, search, tile, stack, count, plain);
        }
    tile->x = x0;
    tile->y = y0;
}

CONEMAP__FUNCTION void CONEMAP__KERNEL(search_tile)(const conemap_map *map, conemap__search *search,
                                                    conemap__tile *tile) {
    if (search->deflate > 0.0f || search->near2 > 0.0f || search->widen2 > 1.0f)
        CONEMAP__KERNEL(search_all)(map, search, tile, 0);
    else
        CONEMAP__KERNEL(search_all)(map, search, tile, 1);
}

/* ---- the prepared tracer: see P R E P A R A T I O N ---------------------------------------------------------- */

CONEMAP__FUNCTION void CONEMAP__KERNEL(larger_row)(const float *a, const float *b, int count, float *out) {
    int x;
    for (x = 0; x < count; x += CONEMAP__LANES)
        CONEMAP__KERNEL(store)(out + x, CONEMAP__MAX(CONEMAP__KERNEL(load)(a + x, count - x),
                                                     CONEMAP__KERNEL(load)(b + x, count - x)), count - x);
}

CONEMAP__FUNCTION void CONEMAP__KERNEL(rise_row)(const float *squares, int shift, const float *tops, float per_reach,
                                                 int32_t code, int count, float *slopes, int32_t *clear) {
    int x;
    for (x = 0; x < count; x += CONEMAP__LANES) {
        CONEMAP__F highest = CONEMAP__MAX(CONEMAP__KERNEL(load)(squares + x, count - x),
                                          CONEMAP__KERNEL(load)(squares + shift + x, count - x));
        CONEMAP__F rise = CONEMAP__SUB(highest, CONEMAP__KERNEL(load)(tops + x, count - x));
        CONEMAP__F slope = CONEMAP__MAX(CONEMAP__KERNEL(load)(slopes + x, count - x),
                                        CONEMAP__MUL(rise, CONEMAP__F1(per_reach)));
        CONEMAP__F known = CONEMAP__KERNEL(load)((const float *)(const void *)(clear + x), count - x);
        CONEMAP__M is_clear = CONEMAP__LE(rise, CONEMAP__F1(0.0f));
        CONEMAP__KERNEL(store)(slopes + x, slope, count - x);
        known = CONEMAP__PICK(is_clear, CONEMAP__BITSF(CONEMAP__I1(code)), known);
        CONEMAP__KERNEL(store)((float *)(void *)(clear + x), known, count - x);
    }
}

CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(clamp01)(CONEMAP__D x) {
    return CONEMAP__MAXD(CONEMAP__MIND(x, CONEMAP__D1(1.0)), CONEMAP__D1(0.0));
}

/* A cell's number within the map's period. */
CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(repeated)(const conemap__flight_axis *axis, CONEMAP__D cell) {
    if (axis->period == 0.0) return cell;
    return CONEMAP__SUBD(cell, CONEMAP__MULD(CONEMAP__D1(axis->period),
                                             CONEMAP__WHOLE(CONEMAP__MULD(CONEMAP__ADDD(cell, CONEMAP__D1(0.5)),
                                                                          CONEMAP__D1(axis->per_period)))));
}

/* The number of a cell's record along an axis, mirrored. */
CONEMAP__HELPER CONEMAP__F CONEMAP__KERNEL(table_number)(const conemap__flight_axis *axis, CONEMAP__F cell) {
    CONEMAP__F number = cell;
    if (axis->wraps)
        number = CONEMAP__SUB(number, CONEMAP__MUL(CONEMAP__F1(axis->table_period),
                                                   CONEMAP__TOF(CONEMAP__TOI(CONEMAP__MUL(
                                                       CONEMAP__ADD(cell, CONEMAP__F1(0.5f)),
                                                       CONEMAP__F1(axis->per_table_period))))));
    number = CONEMAP__SUB(number, CONEMAP__F1(axis->table_first));
    return CONEMAP__MIN(CONEMAP__MAX(number, CONEMAP__F1(0.0f)), CONEMAP__F1(axis->table_last));
}

/* When the ray comes to the near border of a cell. The product is kept, so that it is rounded as the one in `border` was
   also where arithmetic is wider than doubles (x87): a slow ray on a border must not seem to come there late. */
CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(border)(const conemap__way *way, int at, CONEMAP__D cell) {
    CONEMAP__D product = CONEMAP__MULD(cell, CONEMAP__LOADD(way->per_v + at));
    return CONEMAP__ADDD(product, CONEMAP__LOADD(way->border + at));
}

CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(position)(const conemap__way *way, int at, CONEMAP__D t) {
    return CONEMAP__ADDD(CONEMAP__LOADD(way->p + at), CONEMAP__MULD(CONEMAP__LOADD(way->v + at), t));
}

/* The indices are read back from memory: taken out of a vector lane by lane they hold up the arithmetic. */
CONEMAP__HELPER void CONEMAP__KERNEL(fetch)(const void *base, size_t size, const volatile int32_t *index, int count) {
    const unsigned char *bytes = (const unsigned char *)base;
    int k;
    for (k = 0; k + 8 <= count; k += 8) { /* eight at once, as the compiler may leave a loop one */
        CONEMAP__PREFETCH(bytes + (size_t)index[k] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[k + 1] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[k + 2] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[k + 3] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[k + 4] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[k + 5] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[k + 6] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[k + 7] * size);
    }
    for (; k < count; ++k) CONEMAP__PREFETCH(bytes + (size_t)index[k] * size);
}

/* Notes where the records of the lanes' cells are, and has them fetched while other groups take their turns. */
CONEMAP__HELPER void CONEMAP__KERNEL(aim)(const conemap__flight *f, conemap__block_of_rays *rays, int at, CONEMAP__F i,
                                          CONEMAP__F j) {
    const CONEMAP__F zero = CONEMAP__F1(0.0f);
    CONEMAP__F u = CONEMAP__KERNEL(table_number)(&f->axis[0], i), v = CONEMAP__KERNEL(table_number)(&f->axis[1], j);
    u = CONEMAP__PICK(CONEMAP__LT(CONEMAP__LOADF(rays->fast[0].sign + at), zero),
                      CONEMAP__SUB(CONEMAP__F1(f->axis[0].table_last), u), u);
    v = CONEMAP__ADD(v, CONEMAP__PICK(CONEMAP__LT(CONEMAP__LOADF(rays->fast[1].sign + at), zero),
                                      CONEMAP__F1(f->axis[1].table_last + 1.0f), zero));
    CONEMAP__STOREI(rays->record + at, CONEMAP__IADD(CONEMAP__TOI(u),
                                                     CONEMAP__IMUL(CONEMAP__TOI(v), CONEMAP__I1(f->pitch))));
    CONEMAP__KERNEL(fetch)(f->table, sizeof *f->table, rays->record + at, CONEMAP__LANES);
}

/* The two texels of a cell along an axis, as indices. */
CONEMAP__HELPER void CONEMAP__KERNEL(cell_texels)(const conemap__flight_axis *axis, const float *sign, CONEMAP__D cell,
                                                  CONEMAP__D *near_texel, CONEMAP__D *far_texel) {
    const CONEMAP__D zero = CONEMAP__D1(0.0), one = CONEMAP__D1(1.0), last = CONEMAP__D1(axis->last_texel);
    CONEMAP__D direction = CONEMAP__LOADFD(sign), pitch = CONEMAP__MULD(direction, CONEMAP__D1(axis->texel_pitch));
    CONEMAP__W mirrored = CONEMAP__LTD(direction, zero);
    CONEMAP__D start = CONEMAP__PICKD(mirrored, CONEMAP__D1(axis->last_texel * axis->texel_pitch), zero);
    CONEMAP__D lower = CONEMAP__SUBD(CONEMAP__KERNEL(repeated)(axis, cell),
                                     axis->wraps ? CONEMAP__PICKD(mirrored, one, zero) : CONEMAP__D1(axis->first));
    CONEMAP__D upper = CONEMAP__ADDD(lower, one);
    lower = CONEMAP__MIND(CONEMAP__PICKD(CONEMAP__LTD(lower, zero), CONEMAP__D1(axis->before), lower), last);
    upper = CONEMAP__PICKD(CONEMAP__LTD(last, upper), CONEMAP__D1(axis->after), upper);
    *near_texel = CONEMAP__ADDD(start, CONEMAP__MULD(lower, pitch));
    *far_texel = CONEMAP__ADDD(start, CONEMAP__MULD(upper, pitch));
}

/* The same as aim for the heights of the cells. */
CONEMAP__HELPER void CONEMAP__KERNEL(aim_close)(const conemap__flight *f, conemap__block_of_rays *rays, int at) {
    CONEMAP__D i0, i1, j0, j1;
    CONEMAP__KERNEL(cell_texels)(&f->axis[0], rays->fast[0].sign + at, CONEMAP__LOADFD(rays->cell[0] + at), &i0, &i1);
    CONEMAP__KERNEL(cell_texels)(&f->axis[1], rays->fast[1].sign + at, CONEMAP__LOADFD(rays->cell[1] + at), &j0, &j1);
    CONEMAP__STOREN(rays->corner[0] + at, CONEMAP__ADDD(j0, i0));
    CONEMAP__STOREN(rays->corner[1] + at, CONEMAP__ADDD(j0, i1));
    CONEMAP__STOREN(rays->corner[2] + at, CONEMAP__ADDD(j1, i0));
    CONEMAP__STOREN(rays->corner[3] + at, CONEMAP__ADDD(j1, i1));
    CONEMAP__KERNEL(fetch)(f->heights, sizeof *f->heights, rays->corner[0] + at, CONEMAP__DLANES);
    CONEMAP__KERNEL(fetch)(f->heights, sizeof *f->heights, rays->corner[2] + at, CONEMAP__DLANES);
}

/* One step by the table for every flying lane of the group at slot `at`; returns the lanes that fly on. */
CONEMAP__HELPER int CONEMAP__KERNEL(fly_on)(const conemap__flight *f, conemap__block_of_rays *rays, int at) {
    const conemap__fast_way *u = &rays->fast[0], *v = &rays->fast[1];
    const CONEMAP__F zero = CONEMAP__F1(0.0f), one = CONEMAP__F1(1.0f);
    CONEMAP__F t = CONEMAP__LOADF(rays->now + at), t_end = CONEMAP__LOADF(rays->end + at);
    CONEMAP__F i = CONEMAP__LOADF(rays->cell[0] + at), j = CONEMAP__LOADF(rays->cell[1] + at);
    CONEMAP__F vz = CONEMAP__LOADF(rays->vz + at), state = CONEMAP__LOADF(rays->state + at);
    CONEMAP__F reach = CONEMAP__LOADF(rays->reach + at);
    CONEMAP__I record = CONEMAP__GATHERI(f->table, rays->record + at);
    CONEMAP__I quadrant = CONEMAP__PICKI(CONEMAP__LT(CONEMAP__LOADF(u->sign + at), zero), CONEMAP__ISHR(record, 10),
                                         record);
    CONEMAP__I slope_code = CONEMAP__IAND(quadrant, CONEMAP__I1(31));
    CONEMAP__F top = CONEMAP__MUL(CONEMAP__TOF(CONEMAP__IADD(CONEMAP__ISHR(record, 20), CONEMAP__I1(1))),
                                  CONEMAP__F1(1.0f / 4096.0f));
    CONEMAP__F slope, clear, gap, late_i, late_j, early_i, early_j, sink, cone, level, stop, to_i, to_j, over;
    CONEMAP__M flies, above, goes, far_on, next_i, next_j, passes;
    /* slope and clear way have a float's exponent and two bits of its fraction */
    slope = CONEMAP__PICK(CONEMAP__IGT(slope_code, CONEMAP__I1(30)), one,
                          CONEMAP__BITSF(CONEMAP__IADD(CONEMAP__ISHL(slope_code, 21), CONEMAP__I1((127 - 10) << 23))));
    clear = CONEMAP__BITSF(CONEMAP__IADD(CONEMAP__IAND(CONEMAP__ISHL(quadrant, 16), CONEMAP__I1(31 << 21)),
                                         CONEMAP__I1(127 << 23))); /* and 1 */
    gap = CONEMAP__SUB(CONEMAP__ADD(CONEMAP__LOADF(rays->z + at), CONEMAP__MUL(vz, t)), top);
    late_i = CONEMAP__ADD(CONEMAP__MUL(CONEMAP__ADD(i, one), CONEMAP__LOADF(u->per_v + at)),
                          CONEMAP__LOADF(u->late + at));
    late_j = CONEMAP__ADD(CONEMAP__MUL(CONEMAP__ADD(j, one), CONEMAP__LOADF(v->per_v + at)),
                          CONEMAP__LOADF(v->late + at));
    early_i = CONEMAP__SUB(late_i, CONEMAP__LOADF(u->early + at));
    early_j = CONEMAP__SUB(late_j, CONEMAP__LOADF(v->early + at));
    sink = CONEMAP__ADD(t, CONEMAP__MUL(gap, CONEMAP__LOADF(rays->sink + at)));
    cone = CONEMAP__ADD(t, CONEMAP__DIV(
        CONEMAP__MAX(CONEMAP__SUB(gap, CONEMAP__MUL(slope, reach)), zero),
        CONEMAP__MAX(CONEMAP__SUB(CONEMAP__MUL(CONEMAP__LOADF(rays->major + at), slope), vz), CONEMAP__F1(1e-30f))));
    level = CONEMAP__ADD(t, CONEMAP__MUL(CONEMAP__SUB(clear, reach), CONEMAP__LOADF(rays->per_major + at)));
    stop = CONEMAP__MAX(cone, CONEMAP__MIN(level, sink));
    over = CONEMAP__MIN(sink, CONEMAP__MIN(early_i, early_j));
    flies = CONEMAP__LT(state, CONEMAP__F1(0.5f));
    above = CONEMAP__AND(flies, CONEMAP__LT(zero, gap));
    goes = CONEMAP__AND(above, CONEMAP__LE(t_end, CONEMAP__MAX(stop, over)));
    stop = CONEMAP__MIN(stop, t_end);
    to_i = CONEMAP__TOF(CONEMAP__TOI(CONEMAP__ADD(CONEMAP__LOADF(u->behind + at),
                                                  CONEMAP__MUL(CONEMAP__LOADF(u->v + at), stop))));
    to_j = CONEMAP__TOF(CONEMAP__TOI(CONEMAP__ADD(CONEMAP__LOADF(v->behind + at),
                                                  CONEMAP__MUL(CONEMAP__LOADF(v->v + at), stop))));
    to_i = CONEMAP__MAX(to_i, i);
    to_j = CONEMAP__MAX(to_j, j);
    far_on = CONEMAP__OR(CONEMAP__LT(i, to_i), CONEMAP__LT(j, to_j));
    next_i = CONEMAP__ANDNOT(CONEMAP__AND(CONEMAP__LT(late_i, early_j), CONEMAP__LE(late_i, sink)), far_on);
    next_j = CONEMAP__ANDNOT(CONEMAP__AND(CONEMAP__LT(late_j, early_i), CONEMAP__LE(late_j, sink)), far_on);
    to_i = CONEMAP__PICK(next_i, CONEMAP__ADD(i, one), to_i);
    to_j = CONEMAP__PICK(next_j, CONEMAP__ADD(j, one), to_j);
    stop = CONEMAP__PICK(next_i, CONEMAP__MAX(early_i, t), stop);
    stop = CONEMAP__PICK(next_j, CONEMAP__MAX(early_j, t), stop);
    passes = CONEMAP__AND(above, CONEMAP__OR(far_on, CONEMAP__OR(next_i, next_j)));
    i = CONEMAP__PICK(passes, to_i, i);
    j = CONEMAP__PICK(passes, to_j, j);
    CONEMAP__KERNEL(aim)(f, rays, at, i, j);
    CONEMAP__STOREF(rays->cell[0] + at, i);
    CONEMAP__STOREF(rays->cell[1] + at, j);
    CONEMAP__STOREF(rays->now + at, CONEMAP__PICK(passes, stop, t));
    CONEMAP__STOREF(rays->steps + at, CONEMAP__ADD(CONEMAP__LOADF(rays->steps + at), CONEMAP__PICK(flies, one, zero)));
    state = CONEMAP__PICK(CONEMAP__ANDNOT(flies, passes), CONEMAP__F1(CONEMAP__CLOSE), state);
    CONEMAP__STOREF(rays->state + at, CONEMAP__PICK(goes, CONEMAP__F1(CONEMAP__GONE), state));
    return CONEMAP__BITS(CONEMAP__ANDNOT(passes, goes));
}

/* Meets every close lane with the patch of its cell, as conemap__walk_hit does; lanes that do not hit fly on. */
CONEMAP__HELPER void CONEMAP__KERNEL(meet)(const conemap__flight *f, conemap__block_of_rays *rays, int at) {
    conemap__way *u = &rays->way[0], *v = &rays->way[1];
    const CONEMAP__D zero = CONEMAP__D1(0.0), one = CONEMAP__D1(1.0), never = CONEMAP__D1(CONEMAP__NEVER);
    CONEMAP__D i = CONEMAP__LOADFD(rays->cell[0] + at), j = CONEMAP__LOADFD(rays->cell[1] + at);
    CONEMAP__D enter_i = CONEMAP__KERNEL(border)(u, at, i), leave_i = CONEMAP__KERNEL(border)(u, at,
        CONEMAP__ADDD(i, one));
    CONEMAP__D enter_j = CONEMAP__KERNEL(border)(v, at, j), leave_j = CONEMAP__KERNEL(border)(v, at,
        CONEMAP__ADDD(j, one));
    CONEMAP__D t_end = CONEMAP__LOADD(rays->t_end + at), leave = CONEMAP__MIND(leave_i, leave_j);
    CONEMAP__D enter = CONEMAP__MAXD(CONEMAP__PICKD(CONEMAP__LTD(enter_i, never), enter_i, zero),
                                     CONEMAP__PICKD(CONEMAP__LTD(enter_j, never), enter_j, zero));
    CONEMAP__D now = CONEMAP__LOADFD(rays->now + at), t = CONEMAP__MIND(CONEMAP__MAXD(now, enter), t_end);
    CONEMAP__D end = CONEMAP__MIND(CONEMAP__MAXD(leave, t), t_end);
    CONEMAP__D vx = CONEMAP__LOADD(u->v + at), vy = CONEMAP__LOADD(v->v + at), vz = CONEMAP__LOADD(rays->vz_exact + at);
    CONEMAP__D state = CONEMAP__LOADFD(rays->state + at);
    CONEMAP__D h00 = CONEMAP__GATHERFD(f->heights, rays->corner[0] + at);
    CONEMAP__D h10 = CONEMAP__GATHERFD(f->heights, rays->corner[1] + at);
    CONEMAP__D h01 = CONEMAP__GATHERFD(f->heights, rays->corner[2] + at);
    CONEMAP__D h11 = CONEMAP__GATHERFD(f->heights, rays->corner[3] + at);
    CONEMAP__D x = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(CONEMAP__KERNEL(position)(u, at, t), i));
    CONEMAP__D y = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(CONEMAP__KERNEL(position)(v, at, t), j));
    CONEMAP__D x1 = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(CONEMAP__KERNEL(position)(u, at, end), i));
    CONEMAP__D y1 = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(CONEMAP__KERNEL(position)(v, at, end), j));
    CONEMAP__D hx = CONEMAP__SUBD(h10, h00), hy = CONEMAP__SUBD(h01, h00);
    CONEMAP__D hxy = CONEMAP__SUBD(CONEMAP__SUBD(h11, h01), hx);
    CONEMAP__D z = CONEMAP__PICKD(CONEMAP__LED(t_end, t), CONEMAP__LOADD(rays->z_end + at),
                                  CONEMAP__ADDD(CONEMAP__LOADD(rays->z_exact + at), CONEMAP__MULD(vz, t)));
    CONEMAP__D c = CONEMAP__SUBD(
        z, CONEMAP__ADDD(CONEMAP__ADDD(CONEMAP__ADDD(h00, CONEMAP__MULD(hx, x)), CONEMAP__MULD(hy, y)),
                         CONEMAP__MULD(hxy, CONEMAP__MULD(x, y))));
    CONEMAP__D b = CONEMAP__SUBD(
        vz, CONEMAP__ADDD(CONEMAP__ADDD(CONEMAP__MULD(hx, vx), CONEMAP__MULD(hy, vy)),
                          CONEMAP__MULD(hxy, CONEMAP__ADDD(CONEMAP__MULD(x, vy), CONEMAP__MULD(y, vx)))));
    CONEMAP__D a = CONEMAP__SUBD(zero, CONEMAP__MULD(hxy, CONEMAP__MULD(vx, vy)));
    CONEMAP__D discriminant = CONEMAP__SUBD(CONEMAP__MULD(b, b), CONEMAP__MULD(CONEMAP__MULD(CONEMAP__D1(4.0), a), c));
    CONEMAP__D root = CONEMAP__SQRTD(CONEMAP__MAXD(discriminant, zero));
    CONEMAP__D q = CONEMAP__MULD(CONEMAP__D1(-0.5),
                                 CONEMAP__ADDD(b, CONEMAP__PICKD(CONEMAP__LTD(b, zero),
                                                                 CONEMAP__SUBD(zero, root), root)));
    CONEMAP__W no_q = CONEMAP__ANDW(CONEMAP__LED(q, zero), CONEMAP__LED(zero, q));
    CONEMAP__W no_a = CONEMAP__ANDW(CONEMAP__LED(a, zero), CONEMAP__LED(zero, a));
    CONEMAP__D first = CONEMAP__PICKD(no_q, never, CONEMAP__DIVD(c, CONEMAP__PICKD(no_q, never, q)));
    CONEMAP__D second = CONEMAP__PICKD(no_a, never, CONEMAP__DIVD(q, CONEMAP__PICKD(no_a, never, a)));
    CONEMAP__D way = CONEMAP__SUBD(end, t), low, high;
    CONEMAP__W meets, inside, ends = CONEMAP__LED(t_end, leave), close;
    first = CONEMAP__PICKD(CONEMAP__LTD(first, zero), never, first);
    first = CONEMAP__PICKD(CONEMAP__LED(zero, second), CONEMAP__MIND(second, first), first);
    meets = CONEMAP__ANDW(CONEMAP__LED(zero, discriminant), CONEMAP__LED(first, way));
    /* On the ray's end the height is exact, which the quadratic's is not. */
    low = CONEMAP__ADDD(h00, CONEMAP__MULD(hx, x1));
    high = CONEMAP__ADDD(h01, CONEMAP__MULD(CONEMAP__SUBD(h11, h01), x1));
    low = CONEMAP__ADDD(low, CONEMAP__MULD(CONEMAP__SUBD(high, low), y1));
    first = CONEMAP__PICKD(meets, first, way);
    meets = CONEMAP__ORW(meets, CONEMAP__ANDW(ends, CONEMAP__LED(CONEMAP__LOADD(rays->z_end + at), low)));
    inside = CONEMAP__LED(c, zero);
    first = CONEMAP__PICKD(inside, zero, first);
    meets = CONEMAP__ANDW(CONEMAP__ORW(meets, inside), CONEMAP__LED(t, leave));
    close = CONEMAP__ANDNOTW(CONEMAP__LTD(CONEMAP__D1(0.5), state), CONEMAP__LTD(CONEMAP__D1(1.5), state));
    CONEMAP__STOREDF(rays->steps + at, CONEMAP__ADDD(CONEMAP__LOADFD(rays->steps + at),
                                                     CONEMAP__PICKD(close, one, zero)));
    CONEMAP__STORED(rays->t + at, CONEMAP__PICKD(close, CONEMAP__ADDD(t, first), CONEMAP__LOADD(rays->t + at)));
    meets = CONEMAP__ANDW(close, meets);
    close = CONEMAP__ANDNOTW(close, meets);
    CONEMAP__STOREDF(rays->now + at, CONEMAP__PICKD(close, CONEMAP__MULD(end, CONEMAP__D1(1.0 - 1.0 / 4194304.0)),
                                                    now));
    i = CONEMAP__PICKD(CONEMAP__ANDW(close, CONEMAP__LED(leave_i, end)), CONEMAP__ADDD(i, one), i);
    j = CONEMAP__PICKD(CONEMAP__ANDW(close, CONEMAP__LED(leave_j, end)), CONEMAP__ADDD(j, one), j);
    CONEMAP__STOREDF(rays->cell[0] + at, i);
    CONEMAP__STOREDF(rays->cell[1] + at, j);
    state = CONEMAP__PICKD(meets, CONEMAP__D1((double)CONEMAP__MET), state);
    ends = CONEMAP__ANDW(close, ends);
    close = CONEMAP__ANDNOTW(close, ends);
    state = CONEMAP__PICKD(ends, CONEMAP__D1((double)CONEMAP__GONE), state);
    CONEMAP__STOREDF(rays->state + at, CONEMAP__PICKD(close, zero, state));
}

/* Narrows [t0, t1] to where a slab is crossed, as conemap__clip; returns the lanes where it is this slab that ends
   it. */
CONEMAP__HELPER CONEMAP__W CONEMAP__KERNEL(clip)(CONEMAP__D o, CONEMAP__D v, double low, double high, CONEMAP__D *t0,
                                                 CONEMAP__D *t1) {
    const CONEMAP__D zero = CONEMAP__D1(0.0), never = CONEMAP__D1(CONEMAP__NEVER);
    CONEMAP__W back = CONEMAP__LTD(v, zero), still = CONEMAP__ANDW(CONEMAP__LED(v, zero), CONEMAP__LED(zero, v));
    CONEMAP__W outside = CONEMAP__ORW(CONEMAP__LTD(o, CONEMAP__D1(low)), CONEMAP__LTD(CONEMAP__D1(high), o)), ends;
    /* Divided, not multiplied by an inverse: a ray through a corner leaves the one slab when it enters the other. */
    CONEMAP__D speed = CONEMAP__PICKD(still, CONEMAP__D1(1.0), v);
    CONEMAP__D a = CONEMAP__DIVD(CONEMAP__SUBD(CONEMAP__PICKD(back, CONEMAP__D1(high), CONEMAP__D1(low)), o), speed);
    CONEMAP__D b = CONEMAP__DIVD(CONEMAP__SUBD(CONEMAP__PICKD(back, CONEMAP__D1(low), CONEMAP__D1(high)), o), speed);
    /* a ray beside the slab that does not move towards it: t1 before any t0 */
    b = CONEMAP__PICKD(still, CONEMAP__PICKD(outside, CONEMAP__D1(-1.0), never), b);
    a = CONEMAP__PICKD(still, zero, a);
    *t0 = CONEMAP__MAXD(a, *t0);
    ends = CONEMAP__LTD(b, *t1);
    *t1 = CONEMAP__PICKD(ends, b, *t1);
    return ends;
}

CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(inverse)(CONEMAP__D v) {
    CONEMAP__W still = CONEMAP__ANDW(CONEMAP__LED(v, CONEMAP__D1(0.0)), CONEMAP__LED(CONEMAP__D1(0.0), v));
    return CONEMAP__PICKD(still, CONEMAP__D1(0.0), CONEMAP__DIVD(CONEMAP__D1(1.0),
                                                                 CONEMAP__PICKD(still, CONEMAP__D1(1.0), v)));
}

/* Puts the rays on their way along an axis, as conemap__enter_axis, mirrored; returns the farthest place. */
CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(board_axis)(const conemap__flight_axis *axis, conemap__way *way,
                                                       float *to_cell, float *sign, CONEMAP__D position, CONEMAP__D v,
                                                       CONEMAP__D per_v, CONEMAP__D t_end, CONEMAP__W meets) {
    const CONEMAP__D zero = CONEMAP__D1(0.0), one = CONEMAP__D1(1.0);
    CONEMAP__W flip = CONEMAP__LTD(v, zero), moves = CONEMAP__ORW(flip, CONEMAP__LTD(zero, v));
    CONEMAP__D cells = CONEMAP__D1(axis->cells), first = CONEMAP__D1(axis->first), x, cell, place, p;
    position = CONEMAP__PICKD(meets, position, zero);
    if (axis->wraps) {
        CONEMAP__W beyond = CONEMAP__ORW(CONEMAP__LED(CONEMAP__D1(4503599627370496.0), position),
                                      CONEMAP__LED(position, CONEMAP__D1(-4503599627370496.0)));
        position = CONEMAP__PICKD(beyond, zero, position);
        position = CONEMAP__SUBD(position, CONEMAP__FLOORD(position));
    } else {
        position = CONEMAP__KERNEL(clamp01)(position);
    }
    x = CONEMAP__SUBD(CONEMAP__MULD(position, CONEMAP__D1(axis->size)), CONEMAP__D1(0.5));
    cell = CONEMAP__FLOORD(x);
    place = CONEMAP__ADDD(cell, first);
    if (!axis->wraps)
        cell = CONEMAP__SUBD(CONEMAP__MAXD(CONEMAP__MIND(place, CONEMAP__SUBD(cells, one)), zero), first);
    place = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(x, cell));
    cell = CONEMAP__ADDD(cell, first);
    cell = CONEMAP__PICKD(CONEMAP__LTD(cell, zero), CONEMAP__ADDD(cell, cells), cell); /* across the seam */
    p = CONEMAP__ADDD(cell, place);
    p = CONEMAP__PICKD(flip, CONEMAP__SUBD(cells, p), p);
    cell = CONEMAP__PICKD(flip, CONEMAP__SUBD(CONEMAP__SUBD(cells, one), cell), cell);
    v = CONEMAP__MULD(v, CONEMAP__D1(axis->size));
    per_v = CONEMAP__MULD(per_v, CONEMAP__D1(1.0 / axis->size));
    v = CONEMAP__PICKD(flip, CONEMAP__SUBD(zero, v), v);
    per_v = CONEMAP__PICKD(flip, CONEMAP__SUBD(zero, per_v), per_v);
    CONEMAP__STOREDF(to_cell, cell);
    CONEMAP__STORED(way->p, p);
    v = CONEMAP__PICKD(meets, v, zero);
    CONEMAP__STORED(way->v, v);
    CONEMAP__STORED(way->per_v, CONEMAP__PICKD(meets, per_v, zero));
    CONEMAP__STORED(way->border, CONEMAP__PICKD(CONEMAP__ANDW(moves, meets),
                                                CONEMAP__SUBD(zero, CONEMAP__MULD(p, per_v)),
                                                CONEMAP__D1(CONEMAP__NEVER)));
    CONEMAP__STOREDF(sign, CONEMAP__PICKD(flip, CONEMAP__D1(-1.0), one));
    return CONEMAP__ADDD(p, CONEMAP__MULD(v, t_end));
}

/* The way in floats, whose positions are off by half of `error` at most. */
CONEMAP__HELPER void CONEMAP__KERNEL(board_fast)(const conemap__way *way, conemap__fast_way *fast, CONEMAP__D error) {
    CONEMAP__D per_v = CONEMAP__LOADD(way->per_v), twice = CONEMAP__MULD(CONEMAP__ADDD(error, error), per_v);
    CONEMAP__STOREDF(fast->behind, CONEMAP__SUBD(CONEMAP__LOADD(way->p), error));
    CONEMAP__STOREDF(fast->v, CONEMAP__LOADD(way->v));
    CONEMAP__STOREDF(fast->per_v, per_v);
    CONEMAP__STOREDF(fast->late, CONEMAP__MIND(CONEMAP__ADDD(CONEMAP__LOADD(way->border), twice), CONEMAP__D1(1e30)));
    CONEMAP__STOREDF(fast->early, CONEMAP__ADDD(twice, twice));
}

/* Boards the next rays of the stream, as conemap__enter does one, into the waiting block; invalid ones are answered. */
CONEMAP__FUNCTION void CONEMAP__KERNEL(board)(conemap__flight *f) {
    const CONEMAP__D zero = CONEMAP__D1(0.0), one = CONEMAP__D1(1.0), never = CONEMAP__D1(CONEMAP__NEVER);
    conemap__block_of_rays *rays = f->waiting;
    conemap__stream *stream = &f->stream;
    float columns[8][CONEMAP__DLANES] = {{0}};
    CONEMAP__D o[3], v[3], per_v[3], longest, power, per_power, t_min, t0, t1, box0, box1, status, z_out, reach, major,
        t_end, far_u, far_v, error, z;
    CONEMAP__W ends, meets, in_box;
    int lanes = 0, k;
    while (lanes < CONEMAP__DLANES && stream->next < stream->count) {
        conemap_ray ray;
        int number = stream->next;
        if (conemap__stream_ray(stream, &ray) != CONEMAP_OK) continue;
        for (k = 0; k < 3; ++k) {
            columns[k][lanes] = ray.origin[k];
            columns[3 + k][lanes] = ray.direction[k];
        }
        columns[6][lanes] = ray.t_min;
        columns[7][lanes] = conemap__finite(ray.t_max) ? ray.t_max : 0.0f;
        rays->number[lanes] = (double)number;
        ++lanes;
    }
    f->waiting_next = 0;
    f->waiting_count = lanes;
    if (lanes == 0) return;
    for (k = lanes; k < CONEMAP__DLANES; ++k) columns[5][k] = 1.0f; /* a direction */

    longest = CONEMAP__D1(1e-300);
    for (k = 0; k < 3; ++k) {
        o[k] = CONEMAP__LOADFD(columns[k]);
        v[k] = CONEMAP__LOADFD(columns[3 + k]);
        longest = CONEMAP__MAXD(longest, CONEMAP__MAXD(v[k], CONEMAP__SUBD(zero, v[k])));
    }
    /* the power of two that brings it to 1..2, as conemap__normalising_power */
    power = CONEMAP__BITSD(CONEMAP__LSUB(CONEMAP__L1(UINT64_C(2046) << 52),
                                         CONEMAP__LAND(CONEMAP__BITSL(longest), CONEMAP__L1(UINT64_C(2047) << 52))));
    for (k = 0; k < 3; ++k) {
        v[k] = CONEMAP__MULD(v[k], power);
        v[k] = CONEMAP__PICKD(CONEMAP__ANDW(CONEMAP__LTD(v[k], CONEMAP__D1(1e-30)),
                                            CONEMAP__LTD(CONEMAP__D1(-1e-30), v[k])), zero, v[k]);
        per_v[k] = CONEMAP__KERNEL(inverse)(v[k]);
    }
    per_power = CONEMAP__BITSD(CONEMAP__LAND(CONEMAP__BITSL(longest), CONEMAP__L1(UINT64_C(2047) << 52)));
    t_min = CONEMAP__MULD(CONEMAP__LOADFD(columns[6]), per_power);
    t1 = CONEMAP__LOADFD(columns[7]);
    box0 = t_min;
    box1 = CONEMAP__PICKD(CONEMAP__LED(t1, zero), never, CONEMAP__MULD(t1, per_power));

    /* The unit box says how a ray that meets nothing ends. */
    ends = CONEMAP__KERNEL(clip)(o[2], v[2], 0.0, 1.0, &box0, &box1);
    z_out = CONEMAP__PICKD(ends, one, zero);
    status = CONEMAP__PICKD(ends, CONEMAP__PICKD(CONEMAP__LTD(v[2], zero), CONEMAP__D1((double)CONEMAP_FLOOR),
                                                 CONEMAP__D1((double)CONEMAP_LEFT)),
                            CONEMAP__D1((double)CONEMAP_T_MAX));
    for (k = 0; k < 2; ++k) {
        if (f->axis[k].wraps) continue;
        ends = CONEMAP__KERNEL(clip)(o[k], v[k], 0.0, 1.0, &box0, &box1);
        z_out = CONEMAP__PICKD(ends, zero, z_out);
        status = CONEMAP__PICKD(ends, CONEMAP__D1((double)CONEMAP_LEFT), status);
    }
    in_box = CONEMAP__LED(box0, box1);
    t0 = box0;
    t1 = box1;
    for (k = 0; k < 2; ++k) {
        if (f->axis[k].low == 0.0) continue;
        ends = CONEMAP__KERNEL(clip)(o[k], v[k], f->axis[k].low, 1.0 - f->axis[k].low, &t0, &t1);
        z_out = CONEMAP__PICKD(ends, zero, z_out);
    }
    meets = CONEMAP__ANDW(in_box, CONEMAP__LED(t0, t1));
    status = CONEMAP__PICKD(in_box, status, CONEMAP__D1((double)CONEMAP_LEFT));
    box1 = CONEMAP__PICKD(in_box, box1, t_min);
    /* Past its reach a wrapping ray is given up. */
    if (f->axis[0].wraps || f->axis[1].wraps) {
        reach = CONEMAP__DIVD(
            CONEMAP__D1(CONEMAP__REACH),
            CONEMAP__ADDD(CONEMAP__ADDD(CONEMAP__MULD(CONEMAP__MAXD(v[0], CONEMAP__SUBD(zero, v[0])),
                                                      CONEMAP__D1(f->axis[0].size)),
                                        CONEMAP__MULD(CONEMAP__MAXD(v[1], CONEMAP__SUBD(zero, v[1])),
                                                      CONEMAP__D1(f->axis[1].size))),
                          CONEMAP__D1(1e-30)));
        ends = CONEMAP__ANDW(meets, CONEMAP__LTD(reach, CONEMAP__SUBD(t1, t0)));
        t1 = CONEMAP__PICKD(ends, CONEMAP__ADDD(t0, reach), t1);
        box1 = CONEMAP__PICKD(ends, t1, box1);
        z_out = CONEMAP__PICKD(ends, zero, z_out);
        status = CONEMAP__PICKD(ends, CONEMAP__D1((double)CONEMAP_STEP_CAP), status);
    }

    t_end = CONEMAP__PICKD(meets, CONEMAP__SUBD(t1, t0), zero);
    far_u = CONEMAP__KERNEL(board_axis)(&f->axis[0], &rays->way[0], rays->cell[0], rays->fast[0].sign,
                                        CONEMAP__ADDD(o[0], CONEMAP__MULD(v[0], t0)), v[0], per_v[0], t_end, meets);
    far_v = CONEMAP__KERNEL(board_axis)(&f->axis[1], &rays->way[1], rays->cell[1], rays->fast[1].sign,
                                        CONEMAP__ADDD(o[1], CONEMAP__MULD(v[1], t0)), v[1], per_v[1], t_end, meets);
    error = CONEMAP__MULD(CONEMAP__ADDD(CONEMAP__MAXD(far_u, far_v), one), CONEMAP__D1(1.0 / 2097152.0));
    CONEMAP__KERNEL(board_fast)(&rays->way[0], &rays->fast[0], error);
    CONEMAP__KERNEL(board_fast)(&rays->way[1], &rays->fast[1], error);
    CONEMAP__STOREDF(rays->reach, CONEMAP__ADDD(one, CONEMAP__MULD(CONEMAP__D1(8.0), error)));
    major = CONEMAP__MAXD(CONEMAP__LOADD(rays->way[0].v), CONEMAP__LOADD(rays->way[1].v));
    CONEMAP__STOREDF(rays->major, major);
    CONEMAP__STOREDF(rays->per_major, CONEMAP__PICKD(
        CONEMAP__LED(major, zero), CONEMAP__D1(1e30),
        CONEMAP__PICKD(CONEMAP__LED(major, CONEMAP__LOADD(rays->way[0].v)), CONEMAP__LOADD(rays->way[0].per_v),
                       CONEMAP__LOADD(rays->way[1].per_v))));
    z = CONEMAP__PICKD(meets, CONEMAP__KERNEL(clamp01)(CONEMAP__ADDD(o[2], CONEMAP__MULD(v[2], t0))), zero);
    CONEMAP__STORED(rays->z_exact, z);
    CONEMAP__STOREDF(rays->z, CONEMAP__SUBD(z, CONEMAP__D1(1.0 / 524288.0)));
    CONEMAP__STORED(rays->vz_exact, v[2]);
    CONEMAP__STOREDF(rays->vz, v[2]);
    /* A ray that ends on the floor ends at 0 exactly, so that no rounding slips it through flat ground. */
    CONEMAP__STORED(rays->z_end, CONEMAP__PICKD(
        CONEMAP__LTD(zero, z_out), CONEMAP__PICKD(CONEMAP__LTD(v[2], zero), zero, one),
        CONEMAP__KERNEL(clamp01)(CONEMAP__PICKD(meets, CONEMAP__ADDD(o[2], CONEMAP__MULD(v[2], t1)), zero))));
    CONEMAP__STOREDF(rays->sink, CONEMAP__PICKD(CONEMAP__LTD(v[2], zero), CONEMAP__SUBD(zero, per_v[2]),
                                                CONEMAP__D1(1e30)));
    CONEMAP__STORED(rays->t_end, t_end);
    CONEMAP__STOREDF(rays->end, CONEMAP__MULD(t_end, CONEMAP__D1(1.0 + 1.0 / 4194304.0)));
    CONEMAP__STOREDF(rays->state, CONEMAP__PICKD(meets, zero, CONEMAP__D1((double)CONEMAP__GONE)));
    CONEMAP__STORED(rays->t_start, CONEMAP__PICKD(meets, t0, zero));
    CONEMAP__STORED(rays->t_gone, box1);
    CONEMAP__STORED(rays->t_scale, power);
    CONEMAP__STORED(rays->end_status, status);
    CONEMAP__KERNEL(aim)(f, rays, 0, CONEMAP__LOADF(rays->cell[0]), CONEMAP__LOADF(rays->cell[1]));
}

/* Answers the rays of a group that have arrived and puts waiting ones into their places; returns how many are
   aboard. */
CONEMAP__HELPER int CONEMAP__KERNEL(change)(conemap__flight *f, conemap__block_of_rays *rays, int at) {
    CONEMAP__F state = CONEMAP__LOADF(rays->state + at);
    int arrived = CONEMAP__BITS(CONEMAP__LT(CONEMAP__F1(1.5f), state));
    int empty = CONEMAP__BITS(CONEMAP__LT(CONEMAP__F1(3.5f), state)), aboard = CONEMAP__LANES, k;
    for (k = at; arrived; ++k, arrived >>= 1, empty >>= 1) {
        if (!(arrived & 1)) continue;
        if (!(empty & 1)) conemap__land(&f->stream, rays, k);
        if (f->waiting_next == f->waiting_count && f->stream.next < f->stream.count) CONEMAP__KERNEL(board)(f);
        if (f->waiting_next < f->waiting_count) {
            conemap__move(f->waiting, f->waiting_next++, rays, k);
        } else {
            rays->state[k] = CONEMAP__EMPTY;
            --aboard;
        }
    }
    return aboard;
}

/* Groups take turns, so that what one waits for, memory, divisions and branches, is there when its turn comes again:
   what it will read is asked for in the turn before. A group in which half the lanes or fewer fly on has its close
   lanes meet their patches in the next turn, and its arrived rays make room in the one after. */
CONEMAP__FUNCTION void CONEMAP__KERNEL(fly)(conemap__flight *f) {
    enum { FLY, AIM, MEET, CHANGE, DONE };
    int turn[CONEMAP__SLOTS / CONEMAP__LANES];
    int groups = conemap__mini(CONEMAP__SLOTS / CONEMAP__LANES, (f->stream.count - 1) / CONEMAP__LANES + 1);
    int busy = groups, group, k;
    memset(f->blocks, 0, sizeof *f->blocks * (size_t)((groups * CONEMAP__LANES - 1) / CONEMAP__BLOCK + 1));
    memset(f->waiting, 0, sizeof *f->waiting);
    for (k = 0; k < groups * CONEMAP__LANES; ++k)
        f->blocks[k / CONEMAP__BLOCK].state[k % CONEMAP__BLOCK] = CONEMAP__EMPTY;
    for (group = 0; group < groups; ++group) turn[group] = CHANGE;
    f->waiting_next = f->waiting_count = 0;
    for (group = 0; busy > 0; group = group + 1 < groups ? group + 1 : 0) {
        conemap__block_of_rays *rays = &f->blocks[group * CONEMAP__LANES / CONEMAP__BLOCK];
        int at = group * CONEMAP__LANES % CONEMAP__BLOCK;
        if (turn[group] == FLY) {
            int flying = CONEMAP__KERNEL(fly_on)(f, rays, at);
            turn[group] = 2 * conemap__count_bits(flying) <= CONEMAP__LANES; /* FLY or AIM, without a branch */
        } else if (turn[group] == AIM) {
            for (k = 0; k < CONEMAP__LANES; k += CONEMAP__DLANES) CONEMAP__KERNEL(aim_close)(f, rays, at + k);
            turn[group] = MEET;
        } else if (turn[group] == MEET) {
            for (k = 0; k < CONEMAP__LANES; k += CONEMAP__DLANES) CONEMAP__KERNEL(meet)(f, rays, at + k);
            turn[group] = CHANGE;
        } else if (turn[group] == CHANGE) {
            turn[group] = FLY;
            CONEMAP__KERNEL(aim)(f, rays, at, CONEMAP__LOADF(rays->cell[0] + at), CONEMAP__LOADF(rays->cell[1] + at));
            if (CONEMAP__KERNEL(change)(f, rays, at) == 0) {
                turn[group] = DONE;
                --busy;
            }
        }
    }
}

/* For the next instruction set. */
#undef CONEMAP__FUNCTION
#undef CONEMAP__HELPER
#undef CONEMAP__ADD
#undef CONEMAP__AND
#undef CONEMAP__ANDNOT
#undef CONEMAP__ANY
#undef CONEMAP__BITS
#undef CONEMAP__BITSF
#undef CONEMAP__BITSI
#undef CONEMAP__DIV
#undef CONEMAP__EVEN
#undef CONEMAP__F
#undef CONEMAP__F1
#undef CONEMAP__GATHERF
#undef CONEMAP__I
#undef CONEMAP__I1
#undef CONEMAP__IADD
#undef CONEMAP__IAND
#undef CONEMAP__IEQ
#undef CONEMAP__IGT
#undef CONEMAP__IOR
#undef CONEMAP__ISHL
#undef CONEMAP__ISHR
#undef CONEMAP__ISUB
#undef CONEMAP__KERNEL
#undef CONEMAP__PART_WIDTH
#undef CONEMAP__PART_HEIGHT
#undef CONEMAP__LANE_WIDTH
#undef CONEMAP__LANE_HEIGHT
#undef CONEMAP__LANES
#undef CONEMAP__LE
#undef CONEMAP__LOADF
#undef CONEMAP__LOADI
#undef CONEMAP__LOADU16
#undef CONEMAP__LOADU8
#undef CONEMAP__LT
#undef CONEMAP__M
#undef CONEMAP__MAX
#undef CONEMAP__MIN
#undef CONEMAP__MUL
#undef CONEMAP__ODD
#undef CONEMAP__OR
#undef CONEMAP__PICK
#undef CONEMAP__PICKI
#undef CONEMAP__SQRT
#undef CONEMAP__STOREF
#undef CONEMAP__STOREI
#undef CONEMAP__SUB
#undef CONEMAP__TARGET
#undef CONEMAP__TOF
#undef CONEMAP__TOI
#undef CONEMAP__ADDD
#undef CONEMAP__ANDNOTW
#undef CONEMAP__ANDW
#undef CONEMAP__BITSD
#undef CONEMAP__BITSW
#undef CONEMAP__D
#undef CONEMAP__D1
#undef CONEMAP__DIVD
#undef CONEMAP__DLANES
#undef CONEMAP__GATHERFD
#undef CONEMAP__L
#undef CONEMAP__L1
#undef CONEMAP__LAND
#undef CONEMAP__LED
#undef CONEMAP__LOADD
#undef CONEMAP__LOADN
#undef CONEMAP__STOREN
#undef CONEMAP__STOREDF
#undef CONEMAP__GATHERI
#undef CONEMAP__IMUL
#undef CONEMAP__LOADFD
#undef CONEMAP__FLOORD
#undef CONEMAP__LSUB
#undef CONEMAP__BITSL
#undef CONEMAP__LTD
#undef CONEMAP__MAXD
#undef CONEMAP__MIND
#undef CONEMAP__MULD
#undef CONEMAP__ORW
#undef CONEMAP__PICKD
#undef CONEMAP__SQRTD
#undef CONEMAP__STORED
#undef CONEMAP__SUBD
#undef CONEMAP__W
#undef CONEMAP__WHOLE
#endif /* CONEMAP__LANES */

/* ======================================================================================================
   L I C E N C E

   This software is available under two licences; choose the one you like.
   ------------------------------------------------------------------------------------------------------
   MIT License. Copyright (c) 2026 the conemap.h authors
   Permission is hereby granted, free of charge, to any person obtaining a copy of this software and
   associated documentation files (the "Software"), to deal in the Software without restriction, including
   without limitation the rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
   copies of the Software, and to permit persons to whom the Software is furnished to do so, subject to the
   following conditions: The above copyright notice and this permission notice shall be included in all copies or
   substantial portions of the Software. THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS
   OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
   NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
   LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE
   SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
   ------------------------------------------------------------------------------------------------------
   Public Domain (www.unlicense.org). This is free and unencumbered software released into the public domain.
   Anyone is free to copy, modify, publish, use, compile, sell, or distribute this software, either in source code
   form or as a compiled binary, for any purpose, commercial or non-commercial, and by any means. In jurisdictions
   that recognise copyright laws, the authors dedicate any and all copyright interest in the software to the public
   domain. THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND.
   ====================================================================================================== */
