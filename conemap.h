/* conemap.h - relief from heightmaps through cone maps, in one header. C99 and C++11, no dependencies.

   Hand it a heightmap; it builds a cone map (on every texel an empty cone, [Dum06], by default safe to interpolate),
   writes it as a texture, and traces rays through the relief on the CPU: picking, line of sight, baking.

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
       T R A C I N G               rays against the relief
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
       T R A C E R S               the walk through cells, every tracer, refinement
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
   so a stored cone is never wider than the computed one, which itself is never wider than the true one. Vertex cones are
   1 / sqrt(s), less 2^-20 of themselves for the rounding of their arithmetic, where s is the maximum over vertices of the
   rounded quotient fl(dh^2 / d^2). Bilinear cones come from bounds at most 5.4 % above the true supremum, less 2^-16 (see
   SAFE CONES); with sectors, less 2^-12. max_tan caps all of them.

   A miss, for a tracer, is a ray above which the true surface rises by more than 2^-20 somewhere before the hit that is
   reported. CONEMAP_TRACE_EXACT over cones with the bilinear guarantee, in any format, and CONEMAP_TRACE_MAXMIP have none.

   Bits. Results are the same to the bit however the work is split into jobs and whatever instruction set does it, on every
   strict IEEE build.

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
    X(CONEMAP_ERROR_HASH, "the heights are not those that the baked cones were built from")

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
                               floor(uv * size - 0.5), clamped or wrapped. For the bilinear guarantee; not with RADIUS */
    int sectors;            /* 0 or 1: a cone for all directions. 4 or 8: one for each sector of horizontal directions,
                               which holds nothing in the directions of its sector (see conemap_sector): wider, for a ray
                               meets nothing else. In sectors / 4 RGBA textures, the heights in one of their own. With
                               CONEMAP_EXACT; not with CONEMAP_DUMMER. Steps of grazing rays, of those with 1: 4 takes
                               0.5 to 0.8, 8 takes 0.4 to 0.7 */
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
                               0: exact. Up to 16 */
    int min3x3;             /* nonzero: each cone becomes the narrowest of its 3x3 block [BV24 eq. 2] */
    int march_steps;        /* CONEMAP_RELAXED_SAMPLED: steps of a march; 0: 64. Up to 65536 */
    int ring_limit;         /* RING, RELAXED, RELAXED_SAMPLED, HYBRID: look at most so many texels far, which leaves
                               the later batches out [BV24 section 5] and drops the guarantee; 0: no limit */
    float hybrid_weight;    /* CONEMAP_HYBRID: 0..1 from conservative to relaxed; 0: 0.5 */
    int keep_pyramid;       /* nonzero: keep the maxima that CONEMAP_TRACE_MAXMIP and _QDM need */

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

/* A cone map. Read-only for the caller; free it with conemap_free. A plain struct, which may be copied or moved: free one
   copy only. */
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
        float *cell_slopes;     /* bilinear guarantee: squared slopes inside cells, while `plane` has those from vertices */
        float texel_u, texel_v; /* a texel's size, aspect included */
        float search_u, search_v; /* the same as the search for cones counts it */
        float least_slope2;     /* 1 / max_tan^2, less so much that conemap__tangent's margin leaves max_tan whole */
        unsigned char *job_results;
        unsigned char *wanted;  /* while updating: what to do with each texel */
        int updating;
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
   heightmap as it is now, of which only the rectangle is read. memory, scratch, keep_pyramid, progress and
   parallel_for are ignored: it runs on this thread, allocates working memory from desc->allocator and frees it.
   CONEMAP_EXACT without slack, and without min3x3 on vertex cones, searches only as far as the old and the new heights
   reach; other settings search everything. The result is that of a full build, to the bit.
   Errors: those of conemap_build; PARAMETER if desc has other settings than the map; SIZE if the rectangle is empty or
   not inside the map. On any error the map is as it was. Nothing else may use the map meanwhile. */
CONEMAP_API conemap_result conemap_update(conemap_map *map, const conemap_desc *desc, int x, int y, int width,
                                          int height);

/* Nonzero if a desc may ask for this instruction set here. Asks the processor, which takes a while in virtual machines. */
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
   desc: may be null; its allocator, memory, keep_pyramid and isa are used, and its heights, if given, are compared
   with the hash (a must for CONEMAP_CONE_ONLY, which holds none). Errors: FILE_..., HASH, NO_HEIGHTS, and those
   of conemap_build; on any of them *map is zeroed. */
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
   with tan(p) as conemap_sample_at gives it, but for that sampler's rounding, which the 2^-20 is there for. With sectors,
   each sector's tan(p) has to hold for those q that it sees; with 8 of them and CLAMP or an axis of one texel, for
   those that its quadrant sees where p or q lies in a border cell.

   info: width, height, wrap_u, wrap_v, aspect, max_tan and texture are read. heights, cones: width * height each (cones:
   as many planes as sectors),
   row 0 first, as a texture fetch returns them (cones encoded), of our maps or of anybody's:
       conemap_verify(&map.info, map.heights, map.cones, NULL, &report);
   allocator: null for the default; under 2 bytes a texel (up to 9 on maps of one row or column) are held.
   report: overwritten. OK says only that the report is there; the map is safe if unsafe and unproven are both 0.
   `worst` is the deepest there is to within 2 % and 2^-20, unless a cell's work ran out.
   Takes 1 to 10 us a cell on safe maps, more on unsafe ones; cones that follow long even slopes to the last bit
   take the longest and may stay unproven.
   Errors: NULL, SIZE, ENUM, PARAMETER (aspect or max_tan as in a desc, but not 0; a cone NaN, infinite or negative),
   HEIGHT, OVERFLOW, MEMORY, ALIGNMENT; the report is then zeroed. Thread-safe; cannot be cancelled. */
CONEMAP_API conemap_result conemap_verify(const conemap_info *info, const float *heights, const float *cones,
                                          const conemap_allocator *allocator, conemap_report *report);

/* ======================================================================================================
   T R A C I N G
   ====================================================================================================== */

/* Traces `count` rays; hits[k] answers rays[k]. desc: null for the defaults.
   A ray that is itself invalid gets CONEMAP_INVALID and the others are still traced; the result is that of the
   first such ray. With an invalid desc, a null pointer or a negative count nothing is written.
   What each tracer promises is written beside conemap_tracer, and counted by the tests. */
CONEMAP_API conemap_result conemap_trace(const conemap_map *map, const conemap_trace_desc *desc,
                                         const conemap_ray *rays, conemap_hit *hits, int count);

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

/* Level k from level k - 1. Level 0 of the cells is not stored. */
static void conemap__pyramid_rows(const conemap_map *map, conemap_pyramid *pyramid, int k, int y0, int y1) {
    int w = pyramid->width[k], h = pyramid->height[k], x, y;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < w; ++x) {
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
        conemap__pyramid_rows(map, pyramid, k, strip * rows,
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

static void conemap__pyramid_top(const conemap_map *map, conemap_pyramid *pyramid) {
    int k;
    for (k = CONEMAP__STRIP_LEVELS + 1; k < pyramid->levels; ++k)
        conemap__pyramid_rows(map, pyramid, k, 0, pyramid->height[k]);
}

/* ======================================================================================================
   K E R N E L S

   What is done to row after row of texels is written once, at the end of this file, in the macros below, and compiled once
   for each instruction set: the file includes itself (by CONEMAP_SELF, its own name) with the macros defined anew each
   time. Lanes are neighbouring texels. Every macro rounds as C's operators do and nothing is fused, so all instruction
   sets give the same bits; with one lane it is plain C.

   Types CONEMAP__F, CONEMAP__I, CONEMAP__M hold CONEMAP__LANES floats, int32s and truth values:
       F1 I1              the same number in all lanes         LOADF LOADI STOREF STOREI   any alignment
       LOADU8 LOADU16     codes to int lanes                   GATHERF(base, indices)
       ADD SUB MUL DIV SQRT MIN MAX                            floats; MIN is a < b ? a : b, MAX is a > b ? a : b
       IADD ISUB IAND IOR ISHL ISHR (logical)                  ints
       LT LE IGT IEQ      compare; AND OR ANDNOT (a and not b) masks; PICK PICKI (mask ? a : b)
       ANY BITS           does some lane hold; one bit for each lane that holds, lane 0 lowest
       TOF TOI            between numbers, towards zero        BITSF BITSI   the same bits as another type
       EVEN ODD           every second lane of two vectors in a row
   To add a macro: define it in each of the sets and add its #undef where the kernels end. To add a
   kernel: write it there, and add its pointer to conemap__kernels and CONEMAP__KERNEL_LIST. Vectors are locals and never
   cross a call that is not inlined (MinGW does not align the stack for them). CONEMAP__FUNCTION and CONEMAP__HELPER
   carry the attribute that lets a function use its instruction set, so no compiler flag is needed.
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

/* A tile's texels in Morton order, so that any 4 of them are a group of 2 x 2, any 16 a block of 4 x 4. */
typedef struct conemap__tile {
    float height[CONEMAP__TILE * CONEMAP__TILE]; /* 2 for texels that are not searched */
    float slope2[CONEMAP__TILE * CONEMAP__TILE]; /* in: what is known already; out: what was found */
    float lowest[16], bar[16]; /* of each group: lowest texel; least slope2, less CONEMAP__MARGIN */
    float folded[16], lane_folded[CONEMAP__TILE * CONEMAP__TILE]; /* the steepest bounds that slack alone pruned */
    int32_t decider[CONEMAP__TILE * CONEMAP__TILE]; /* number in `noted`, 0 for none */
    int noted, noted_x[CONEMAP__NOTED], noted_y[CONEMAP__NOTED];
    int x, y;                /* of its first texel, as the image at hand counts */
    int shift_x, shift_y;    /* that image's own shift */
} conemap__tile;

/* Where a tile's texels and groups lie: Morton order. */
static const float conemap__lane_x[CONEMAP__TILE * CONEMAP__TILE] = {
    0, 1, 0, 1, 2, 3, 2, 3, 0, 1, 0, 1, 2, 3, 2, 3, 4, 5, 4, 5, 6, 7, 6, 7, 4, 5, 4, 5, 6, 7, 6, 7,
    0, 1, 0, 1, 2, 3, 2, 3, 0, 1, 0, 1, 2, 3, 2, 3, 4, 5, 4, 5, 6, 7, 6, 7, 4, 5, 4, 5, 6, 7, 6, 7};
static const float conemap__lane_y[CONEMAP__TILE * CONEMAP__TILE] = {
    0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 2, 2, 3, 3, 0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 2, 2, 3, 3,
    4, 4, 5, 5, 4, 4, 5, 5, 6, 6, 7, 7, 6, 6, 7, 7, 4, 4, 5, 5, 4, 4, 5, 5, 6, 6, 7, 7, 6, 6, 7, 7};
static const int32_t conemap__lane_bit[CONEMAP__TILE * CONEMAP__TILE] = { /* of the lane's group */
    1, 1, 1, 1, 2, 2, 2, 2, 4, 4, 4, 4, 8, 8, 8, 8, 16, 16, 16, 16, 32, 32, 32, 32, 64, 64, 64, 64,
    128, 128, 128, 128, 256, 256, 256, 256, 512, 512, 512, 512, 1024, 1024, 1024, 1024, 2048, 2048,
    2048, 2048, 4096, 4096, 4096, 4096, 8192, 8192, 8192, 8192, 16384, 16384, 16384, 16384, 32768,
    32768, 32768, 32768};
static const int32_t conemap__group_bit[16] = {1, 1 << 1, 1 << 2, 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7,
                                               1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15};
static const float conemap__group_x[16] = {0, 2, 0, 2, 4, 6, 4, 6, 0, 2, 0, 2, 4, 6, 4, 6};
static const float conemap__group_y[16] = {0, 0, 2, 2, 0, 0, 2, 2, 4, 4, 6, 6, 4, 4, 6, 6};

/* What [VB22] needs to know of one axis at one level of the pyramid, for the block before, a texel's own and the one after
   (see conemap__quick_axis): numbers of blocks, and squared distances of two kinds. */
typedef struct conemap__quick_level {
    float p[3], q[3];
    int32_t node[3], full; /* full: finer levels have seen everything */
} conemap__quick_level;

/* The same for 16 columns. */
typedef struct conemap__quick_columns {
    float p[17][3][16], q[17][3][16];
    int32_t node[17][3][16], full[17][16];
} conemap__quick_columns;

/* A block that may hold something steeper for some of the tile's groups, a bit for each. */
typedef struct conemap__node {
    int k, x, y, groups;
} conemap__node;

/* Comparing products saves the division of a quotient: with three roundings less than this margin apart, a block is
   dropped only if its rounded quotient is no more than s. */
#define CONEMAP__MARGIN (1.0f - 1.0f / 1048576.0f)

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
    /* The steepest of the slopes to the 8 neighbours, at least `least`: squared, for texels of a x b. Missing rows are null. */
    void (*ring_row)(const float *const *rows, int width, int wraps, float a, float b, float least, float *out);
    /* Squares of the longest gradients of the cells between two rows. */
    void (*gradient_row)(const float *above, const float *below, int width, int wraps, float a, float b, float *out);
    /* Squares of what each texel sees of its own four cells, at least `least`. Missing rows are null. */
    void (*corners_row)(const float *const *rows, int width, int wraps, float a, float b, float least, float *out);
    /* The steepest that a few neighbours make of it: maxima of dh^2 * inverse[k] over height differences to the texel
       columns[k] to the right in rows[k]. */
    void (*near_row)(const float *row, const float *const *rows, const int *columns, const float *inverse, int n, int width,
                     int wraps, int first, int count, float *out);
    /* Maxima over n planes' rows, each shifted by so many columns; beyond a border it is repeated. */
    void (*steepest_row)(const float *const *rows, const int *columns, int n, int width, int wraps, int first, int count,
                         float *out);
    /* [VB22] for up to 16 columns of a row: squared slopes, at least `least`. */
    void (*quick_row)(const conemap_pyramid *pyramid, const conemap__quick_columns *columns, const conemap__quick_level *levels,
                      const float *heights, float least, int count, float *out);
    /* Raises a tile's slopes to the steepest there is. */
    void (*search_tile)(const conemap_map *map, conemap__search *search, conemap__tile *tile);
} conemap__kernels;

#define CONEMAP__KERNEL_LIST(isa)                                                                                  \
    { conemap__decode_row_##isa, conemap__narrowest_row_##isa, conemap__tangent_row_##isa, conemap__store_row_##isa, \
      conemap__maxima_row_##isa, conemap__ring_row_##isa, conemap__gradient_row_##isa, conemap__corners_row_##isa, \
      conemap__near_row_##isa, conemap__steepest_row_##isa, conemap__quick_row_##isa, \
      conemap__search_tile_##isa }

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
#define CONEMAP__GATHERF(base, i) _mm512_i32gather_ps(i, base, 4)
#define CONEMAP__ADD(a, b) _mm512_add_ps(a, b)
#define CONEMAP__SUB(a, b) _mm512_sub_ps(a, b)
#define CONEMAP__MUL(a, b) _mm512_mul_ps(a, b)
#define CONEMAP__DIV(a, b) _mm512_div_ps(a, b)
#define CONEMAP__SQRT(a) _mm512_maskz_sqrt_ps(CONEMAP__ALL, a)
#define CONEMAP__MIN(a, b) _mm512_maskz_min_ps(CONEMAP__ALL, a, b)
#define CONEMAP__MAX(a, b) _mm512_maskz_max_ps(CONEMAP__ALL, a, b)
#define CONEMAP__IADD(a, b) _mm512_add_epi32(a, b)
#define CONEMAP__ISUB(a, b) _mm512_sub_epi32(a, b)
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
    ((int)vaddvq_u32(vandq_u32(m, vcombine_u32(vcreate_u32(UINT64_C(0x200000001)), vcreate_u32(UINT64_C(0x800000004))))))
#define CONEMAP__TOF(i) vcvtq_f32_s32(i)
#define CONEMAP__TOI(f) vcvtq_s32_f32(f)
#define CONEMAP__BITSF(i) vreinterpretq_f32_s32(i)
#define CONEMAP__BITSI(f) vreinterpretq_s32_f32(f)
#define CONEMAP__EVEN(a, b) vuzp1q_f32(a, b)
#define CONEMAP__ODD(a, b) vuzp2q_f32(a, b)
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
#include CONEMAP_SELF
static const conemap__kernels conemap__kernels_wasm = CONEMAP__KERNEL_LIST(wasm);
#endif

/* ---- which one ------------------------------------------------------------------------------------------------- */

#ifdef CONEMAP__X86
static void conemap__cpuid(int leaf, uint32_t *registers) {
#ifdef _MSC_VER
    int words[4], k;
    __cpuidex(words, leaf, 0);
    for (k = 0; k < 4; ++k) registers[k] = (uint32_t)words[k];
#else
    __asm__ volatile("cpuid"
                     : "=a"(registers[0]), "=b"(registers[1]), "=c"(registers[2]), "=d"(registers[3])
                     : "a"(leaf), "c"(0));
#endif
}

/* The register files that the system saves: bits 1 and 2 for AVX, 5 to 7 for AVX-512. */
static uint32_t conemap__saved_registers(void) {
#ifdef _MSC_VER
    return (uint32_t)_xgetbv(0);
#else
    uint32_t low, high;
    __asm__ volatile(".byte 0x0f, 0x01, 0xd0" : "=a"(low), "=d"(high) : "c"(0)); /* xgetbv, also for old assemblers */
    (void)high;
    return low;
#endif
}

static conemap_isa conemap__best_isa(void) {
    const uint32_t osxsave_avx = 3u << 27, avx512 = 1u << 16 | 1u << 17 | 1u << 30 | 1u << 31; /* F, DQ, BW, VL */
    uint32_t leaf[4], features, saved;
    conemap__cpuid(0, leaf);
    if (leaf[0] < 7) return CONEMAP_ISA_SSE2;
    conemap__cpuid(1, leaf);
    if ((leaf[2] & osxsave_avx) != osxsave_avx) return CONEMAP_ISA_SSE2;
    saved = conemap__saved_registers();
    conemap__cpuid(7, leaf);
    features = leaf[1];
    if ((saved & 6u) != 6u || !(features & 1u << 5)) return CONEMAP_ISA_SSE2;
    return (saved & 0xe6u) == 0xe6u && (features & avx512) == avx512 ? CONEMAP_ISA_AVX512 : CONEMAP_ISA_AVX2;
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
} conemap__sector;

CONEMAP__INLINE int conemap__planes(const conemap_info *info) { return conemap__maxi(info->texture.sectors, 1); }

static conemap__sector conemap__make_sector(const conemap_info *info, int number) {
    conemap__sector sector;
    memset(&sector, 0, sizeof sector);
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

/* Do texels low..high of an axis reach one of the two on either border of CLAMP? Along an axis of one texel all do. What
   lies in the outer half texel is seen by its projection onto the border, which keeps the quadrant of a direction but
   not the octant. So border cells, and the vertices that they have, count for their whole quadrant. */
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

/* Do offsets x0..x1, y0..y1 meet the sector? An octant has `room` texels beyond its diagonal, and the whole quadrant with
   `whole`. *dx, *dy: the nearest offset of those. */
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

/* The square of the steepest ascent of gradient (x, y) within the first quadrant, or the octant of it along `major`, for
   texels of a by b. */
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

   What ring search finds, by branch and bound over the max pyramid: the same quotients, pruned by bounds that are at least
   as large after rounding, so the same bits in any order. A tile of 8 x 8 texels shares one stack: a block of the pyramid
   is tested against the 16 groups of 2 x 2 texels, each with its lowest texel and its least slope so far, then against the
   texels of those groups that are left; a group for which the block is in vain is left out below it. Texels are tested
   against texels only at the bottom. The search
   begins with what decided the tile before (neighbours often agree), goes on in the tile's own block and up from there, so
   near texels, which decide most often, come first, and ends with the images of a wrapping map.
   With slack, a group or texel drops a block that could raise its slope by no more than the factor, and folds the block's
   bound into its result. That depends on the order, which is always this one, whatever the lanes: a job's tiles row by row. */

static conemap__search conemap__make_search(const conemap_map *map) {
    conemap__search search;
    memset(&search, 0, sizeof search);
    search.a = map->build.search_u;
    search.b = map->build.search_v;
    search.widen2 = (1.0f + map->build.desc.slack) * (1.0f + map->build.desc.slack);
    return search;
}

#define CONEMAP__RUN 256 /* texels worked on at a time, on the stack */
enum { CONEMAP__SEARCH = 1, CONEMAP__STORE = 2 }; /* what an update does with a texel; a build does both with all */
CONEMAP__INLINE int conemap__is_wanted(const conemap_map *map, int sector, int x, int y, int what);
CONEMAP__INLINE int conemap__bands(const conemap_map *map);

/* Searches one tile: slopes holds what is known of each texel, row by row, and then what was found. */
static void conemap__search_tile(const conemap_map *map, conemap__search *search, int x0, int y0, float *slopes) {
    conemap__tile tile;
    int w = map->info.width, h = map->info.height, k, n, any = 0;
    unsigned char used[CONEMAP__NOTED];
    for (k = 0; k < CONEMAP__TILE * CONEMAP__TILE; ++k) {
        int x = x0 + (int)conemap__lane_x[k], y = y0 + (int)conemap__lane_y[k];
        tile.height[k] = 2.0f;
        tile.slope2[k] = map->build.least_slope2;
        tile.decider[k] = 0;
        tile.lane_folded[k] = 0.0f;
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
        slopes[(size_t)(y0 + (int)conemap__lane_y[k]) * (size_t)w + (size_t)(x0 + (int)conemap__lane_x[k])] =
            conemap__max(tile.slope2[k], conemap__max(tile.folded[k / 4], tile.lane_folded[k]));
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

/* Do texels low..high of the map meet the sector of texel (i, j), which may lie outside for its images? As conemap__meets. */
CONEMAP__INLINE int conemap__search_meets(const conemap_map *map, const conemap__sector_search *search, int low_i, int high_i,
                                          int low_j, int high_j, int i, int j, int *dx, int *dy) {
    int whole = search->sector.major != 0 && search->room &&
                (search->by_border || conemap__texels_by_border(&map->info, low_i, high_i, low_j, high_j));
    return conemap__meets(search->sector, search->room, whole, low_i - i, high_i - i, low_j - j, high_j - j, dx, dy);
}

/* May something with this dh^2 and d^2 beat s? With slack, only by so much, and what is given up for it is folded in. */
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

/* Works the stack off: opens blocks until none can beat s. The map is shifted by (shift_i, shift_j) against texel (i, j). */
static float conemap__open_seen(const conemap_map *map, conemap__sector_search *search, int i, int j, int shift_i,
                                int shift_j, float apex, float s, conemap__candidate *stack, int count) {
    while (count > 0) {
        conemap__candidate c = stack[--count];
        float slope2;
        if (!conemap__may_beat(search, c.dh2, c.d2, s)) continue;
        if (c.k > 0) {
            count += conemap__push_seen(map, search, c.k - 1, c.x, c.y, i - shift_i, j - shift_j, apex, s, -1, stack + count);
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

/* How many periods away along an axis images may matter. In all directions and in a quadrant a texel's next image decides.
   In an octant it may be one that is as far as the other axis is long (which takes its time on long narrow maps), unless
   nothing so far away can beat s. */
static int conemap__images(const conemap_map *map, const conemap__sector_search *search, int along_v, float apex, float s) {
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
        conemap__search_meets(map, search, search->best_i, search->best_i, search->best_j, search->best_j, i, j, &di, &dj)) {
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
            distance = conemap__nearest_unseen(&b, side, seen_low, seen_high, &unseen) ? (float)unseen * texel : 1.0e19f;
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
      the other, the difference is k + g.r, and along a ray of r = s n the slope k / s + g.n is monotone in s: it does not
      fall towards one of the ray's ends, where one more coordinate is at a vertex. If that end is s = 0, then p = q
      there, so k = 0 and the slope is the same at the other end.
   2. Same cell, P = Q: a slope is a mean of derivatives along the segment, so at most the longest gradient. h_x is affine
      in y and h_y in x, so its square is max(h_x0^2, h_x1^2) + max(h_y0^2, h_y1^2). Reached in the limit: exact.
   3. A corner u of another cell Q: along a ray from u the slope in Q is c1 + c2 s, largest for s -> 0, at most the
      rising part of the gradient at u, or on one of Q's two far edges. On an edge at distance c,
      (A + B y)^2 / (c^2 + y^2) <= A^2 / c^2 + B^2, reached at y = B c^2 / A; outside the edge, or with A <= 0, its ends.
   4. A vertex u and a patch Q apart from it, whose corners Q_j stand D_j away and rise dh_j above it. If
      dh_j <= S sqrt(D_j^2 - V) for all four, then for q = sum w_j Q_j, as the root is concave,
      h(q) - h(u) <= S sum w_j sqrt(D_j^2 - V) <= S sqrt(|q - u|^2 + Var_w - V) <= S |q - u|, for the variance of Q_j under
      the weights of q is x (1 - x) a^2 + y (1 - y) b^2 <= V. With heights negated: the same for u seen from p in P.
      A patch halved is two patches with midpoint corners and a smaller V; the larger of their bounds is a bound.
   5. Every pair is seen. Let p in P, q in Q; by 1 it is a vertex u and a patch. Own cell: step 2, given to P's corners.
      Q at u: step 3, given to the 3x3 texels around u, which hold the corners of all cells P at u. Else step 4, for
      the corner with the largest bound: far from u (V <= tolerance D^2) the search takes the corner's bound as it is,
      given to the 3x3 of u; nearer, it bounds that very patch by halving, given to the 3x3 of u, or to P's corners if it is P
      that is seen from v. Where D_j^2 < 1.5 V, which only texels longer than 1.29:1 know, conemap__close_pairs looks at
      every patch. What a search from u prunes is at most what the 3x3 of u has already.
      With a cone for each cell, what was given to texels is given to P itself, or to the cells at u: a part of the 3x3.
   6. So every corner of P has 1 / t_i >= the slope bound of P, t(p) <= max t_i <= 1 / slope: the cone at p is empty. Storing
      sqrt(tan) or the radius interpolates to no more than that (Jensen; a weighted mean), rounding down to less.
   7. Outside the outermost centres (CLAMP): projecting p and q onto the rectangle of centres keeps heights and t(p)
      and shortens |q - p|. The same projection lets an axis of one texel count as having length 0, and texels longer than
      8:1 count as 8:1 (shorter distances, so narrower cones; it keeps the near field small).
   8. Rounding. Absolute: dh is off by 2^-25 and each of at most 12 halvings adds 2^-25, the shader's own height 2^-23:
      together less than d. Relative: coordinates, squares and quotient are off by less than 2^-18 in D^2 and dh^2,
      D^2 - V >= D^2 / 3 makes that 3 times as much, pruning adds 2^-20; half the sum in the tangent, below 2^-17, and the
      sampler's few last bits: below 2^-16, which conemap__safe_tangent takes off.

   Sectors. A sector is a closed convex cone of directions r in texels, and the claim is made for q - p in it.
   1. holds as it is: r is fixed, then only scaled, so it stays in the sector.
   2. becomes the steepest ascent in the sector's directions. Of a quadrant, with both axes turned to it, the positive parts
      of the largest h_x and h_y; in an octant, where that ascent leads out, it is the steeper one of the axis and the diagonal.
   3. u's own cell in the quadrant is the only one; an octant has one of its two far edges.
   4. as it is, for patches that are met: from a vertex a patch lies in one closed quadrant, on the diagonal in two octants.
      P seen from v is met if v - p is in the sector.
   5. A corner counts if a patch it belongs to may be met: in the quadrant, border included, and in an octant up to one
      texel beyond its diagonal. Then all corners of a patch that is met count, and the one with the largest bound finds it.
      A border that does not wrap is the edge of cells on one side only, so the missing ones are added, level across: they
      have the edge's heights, farther away.
   7. A projection may turn r from one octant into the other, not out of its quadrant. So where p or q lies in a border cell
      of CLAMP, or in a map of one row or column, octants count as quadrants: for patches, vertices and gradients there.
   Wrapping: an image a whole period farther is met in the same quadrant and less steep, and in an octant along its minor
   axis. Along the major axis conemap__images goes on until the octant is wide enough to have held an image of everything. */

#define CONEMAP__BAND 16      /* rows of a cone job */
#define CONEMAP__LONGEST 8.0f /* texels longer than this count as so long */
#define CONEMAP__TOLERANCE 0.1f /* V / D^2 from which a bound counts as tight: at most 5.4 % above the supremum */

/* A band of rows: a job. What a vertex sees goes to the plane, what is seen of a cell to cell_slopes; each job writes its own
   rows of both and conemap__collect brings them together. So jobs share nothing. */
typedef struct conemap__band {
    const conemap_map *map;
    int y0, y1;
    conemap__sector sector;
    float *plane, *cell_slopes; /* the sector's */
    int number;                 /* of the sector */
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

/* Where the slope of cell (i, j) is kept: a cell beyond a border has the place of the last one, with per_cell its cone. */
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

/* The rows, with shifts to the right, whose maxima are the slopes of the texels of row j, or of its cells with per_cell: of
   what rows y0 to y1 know. At most 13. */
static int conemap__collect(const conemap_map *map, int sector, int j, int y0, int y1, const float **rows, int *columns) {
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

/* Step 4: the eye at the origin sees a patch whose corner k stands at (x + (k & 1) size_x, y + (k >> 1) size_y), h[k] above
   it. Returns the larger of `best` and a bound of the squared slope, halving until that is tight. `above` is a bound
   that the whole patch has already, so that halves are never worse. */
static float conemap__patch_slope2(const float *h, float x, float y, float size_x, float size_y, float above,
                                   float best) {
    float v = 0.25f * (size_x * size_x + size_y * size_y), halves[2][4], top, d2;
    float dx = conemap__max(conemap__max(x, -x - size_x), 0.0f), dy = conemap__max(conemap__max(y, -y - size_y), 0.0f);
    int k, step = size_x >= size_y ? 1 : 2, other = 3 - step;
    top = conemap__max(conemap__max(conemap__max(h[0], h[1]), conemap__max(h[2], h[3])), 0.0f);
    d2 = dx * dx + dy * dy;
    if (top * top < above * d2) above = top * top / d2;
    if (d2 >= 2.0f * v) {
        float bound = 0.0f;
        for (k = 0; k < 4; ++k)
            if (h[k] > 0.0f) {
                float cx = k & 1 ? x + size_x : x, cy = k & 2 ? y + size_y : y;
                bound = conemap__max(bound, h[k] * h[k] / (cx * cx + cy * cy - v));
            }
        above = conemap__min(above, bound);
        if (above <= best || v <= CONEMAP__TOLERANCE * d2) return conemap__max(above, best);
    }
    if (above <= best) return best;
    for (k = 0; k < 2; ++k) {
        int low = k * other, high = low + step;
        float middle = 0.5f * (h[low] + h[high]);
        halves[0][low] = h[low];
        halves[0][high] = halves[1][low] = middle;
        halves[1][high] = h[high];
    }
    if (step == 1) {
        size_x *= 0.5f;
        best = conemap__patch_slope2(halves[0], x, y, size_x, size_y, above, best);
        return conemap__patch_slope2(halves[1], x + size_x, y, size_x, size_y, above, best);
    }
    size_y *= 0.5f;
    best = conemap__patch_slope2(halves[0], x, y, size_x, size_y, above, best);
    return conemap__patch_slope2(halves[1], x, y + size_y, size_x, size_y, above, best);
}

/* Cell (i, j) and vertex (k, l): the vertex looks up at the cell (sign 1), or the cell at the vertex (-1). */
static float conemap__cell_slope2(const conemap__band *band, int i, int j, int k, int l, float sign, float best) {
    float apex = conemap__vertex(band->map, k, l), h[4];
    int c;
    for (c = 0; c < 4; ++c) h[c] = sign * (conemap__vertex(band->map, i + (c & 1), j + (c >> 1)) - apex);
    return conemap__patch_slope2(h, (float)(i - k) * band->a, (float)(j - l) * band->b, band->a, band->b,
                                 CONEMAP__FAR, best);
}

/* Step 4's bound for a corner that rises dh, or 0 where it means nothing (conemap__close_pairs sees to those). */
CONEMAP__INLINE float conemap__corner_bound(const conemap__band *band, float dh, int di, int dj) {
    float x = (float)di * band->a, y = (float)dj * band->b, d2 = x * x + y * y - band->deflate;
    return dh > 0.0f && d2 > 0.5f * band->deflate ? dh * dh / d2 : 0.0f;
}

CONEMAP__INLINE int conemap__touches(int i, int j, int k, int l) {
    return k >= i && k <= i + 1 && l >= j && l <= j + 1;
}

/* Does another corner of cell (i, j) have a larger bound with vertex (k, l)? Then the cell is looked at for that one. */
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

/* Step 5, near: vertices u and v, v the higher one. Looks at the cells of v from u, and at the cells of u from v. `least` is
   what all that is raised has already. */
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
        n = conemap__collect(map, band->number, r, band->y0, band->y1, rows, columns);
        if (n == 0) {
            memset(known[r - low], 0, sizeof known[0]);
            continue;
        }
        kernels->steepest_row(rows, columns, n, map->info.width, wraps, x - 1, count + 2, known[r - low]);
    }
    for (r = 0; r < 3; ++r) three[r] = known[conemap__mini(r, high - low)];
    kernels->narrowest_row(three, count + 2, 0, 1, count, out);
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

/* Step 5, near, for row j: all pairs whose bound is above what is known. `below` is the row under the band, whose vertices
   concern its last cells. */
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
            if (!conemap__is_wanted(map, band->number, x + i, conemap__repeat(j, map->info.height), CONEMAP__SEARCH)) continue;
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
   three are ranges, so the smallest products decide. (Their signs alone, one of four quadrants, are [BV24 Algorithm 2]'s
   rule, and the pyramids': coarser, so it keeps more cells.) [BV24 Algorithm 2] tests the height of the cell's near
   corner; a falling point can lie higher, so here every corner of a cell that falls limits the cone, by the bounds of
   conemap__safe_vertex (steps 1 and 4 hold for each pair of cells as a whole). What touches P is taken whole: its longest gradient if a cell around it falls, and inside P itself the
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

/* The directions in which cells low_i..high_i, low_j..high_j are flown through, seen from the cells at vertex (i, j). */
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
CONEMAP__INLINE float conemap__cells_near2(const conemap__band *band, int low_i, int high_i, int low_j, int high_j, int i,
                                           int j) {
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
        !conemap__in_range(desc->hybrid_weight, 0.0f, 1.0f) || !conemap__in_range(desc->slack, 0.0f, 16.0f) || desc->march_steps < 0 ||
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
    int strips, q, bands = (h + CONEMAP__BAND - 1) / CONEMAP__BAND;
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
    if (!conemap__add_size(&memory, texels, sizeof(float)) || !conemap__add_size(&memory, texels, planes * sizeof(float)))
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
    if (conemap__needs_pyramid(desc->generator)) {
        if (!conemap__maxima_plan(&map->build.texels, w, h, &scratch)) return CONEMAP_ERROR_OVERFLOW;
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
           conemap__bits(a->aspect) == conemap__bits(b->aspect) && conemap__bits(a->max_tan) == conemap__bits(b->max_tan) &&
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
    int q, k;
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
    if (scratch_size > 0) {
        cursor = (unsigned char *)map->build.scratch;
        map->build.texels.level[0] = map->build.heights;
        for (k = 1; k < map->build.texels.levels; ++k)
            map->build.texels.level[k] = (float *)conemap__cut(
                &cursor, (size_t)map->build.texels.width[k] * (size_t)map->build.texels.height[k], sizeof(float));
        for (q = 0; q < 4; ++q) conemap__cut_pyramid(&map->build.falling[q], 0, &cursor);
        if (conemap__is_bilinear(&map->info))
            map->build.cell_slopes = (float *)conemap__cut(&cursor, texels, planes * sizeof(float));
        map->build.plane =
            conemap__needs_plane(map) ? (float *)conemap__cut(&cursor, texels, planes * sizeof(float)) : map->build.cones;
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
CONEMAP__INLINE int conemap__bands(const conemap_map *map) { return (map->info.height + CONEMAP__BAND - 1) / CONEMAP__BAND; }

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
                    (double)y + (double)conemap__mini(CONEMAP__TILE, y1 - y) * (double)(x + 1) / (double)(w + CONEMAP__TILE));
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
        conemap__kernels_of(map->isa)->tangent_row(&slopes, 1, CONEMAP__TANGENT_MARGIN, map->info.max_tan, map->info.width,
                                                   row);
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
static conemap_result conemap__sector_rows(const conemap_map *map, const conemap__search *common, int sector, int y0, int y1,
                                           float *slopes) {
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
    int sector = job / conemap__bands(map);
    float a = map->build.search_u, b = map->build.search_v;
    memset(&band, 0, sizeof band);
    band.map = map;
    band.sector = conemap__make_sector(&map->info, sector);
    band.number = sector;
    band.plane = map->build.plane + (size_t)sector * conemap__texels(map);
    band.cell_slopes = map->build.cell_slopes + (size_t)sector * conemap__texels(map);
    band.y0 = (job - sector * conemap__bands(map)) * CONEMAP__BAND;
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
    return map->info.texture.sectors > 1 ? 1.0f / 4096.0f : 1.0f / 65536.0f;
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
            if (!conemap__is_wanted(map, band->number, x, j, CONEMAP__SEARCH)) continue;
            best = conemap__close_pairs(band, x, y, least);
            if (y < band->y1) *at = conemap__max(*at, best);
        }
}

static conemap_result conemap__safe_band(const conemap_map *map, int job) {
    conemap__band band = conemap__make_band(map, job);
    conemap__search search = conemap__make_search(map);
    conemap__neighbours near_ones;
    conemap_result result;
    float least = map->build.least_slope2 * (1.0f - 4.0f * conemap__safe_margin(map)); /* the margin leaves max_tan whole */
    int y;
    search.deflate = band.deflate;
    search.near2 = band.deflate / CONEMAP__TOLERANCE;
    near_ones = conemap__near_ones(&band, search.near2);
    if (band.sector.su != 0)
        conemap__sector_start(&band, least);
    else
        conemap__safe_start(&band, least);
    conemap__safe_close(&band, least);
    result = band.sector.su != 0 ? conemap__sector_rows(map, &search, band.number, band.y0, band.y1, band.plane)
                                 : conemap__search_rows(map, &search, band.y0, band.y1, band.plane);
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
        kernels->steepest_row(rows, columns, n, w, wraps, w - 2, 1, tangents + count - 1); /* lies beyond projects onto the last */
    kernels->tangent_row(&slopes, 1, 1.0f - conemap__safe_margin(map), map->info.max_tan, count, tangents);
}

static void conemap__store_run(conemap_map *map, int sector, int x, int y, int count) {
    const conemap__kernels *kernels = conemap__kernels_of(map->isa);
    float tangents[CONEMAP__RUN], cones[CONEMAP__RUN];
    size_t w = (size_t)map->info.width, at = (size_t)y * w + (size_t)x, first = (size_t)sector * conemap__texels(map);
    int k;
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
        if (conemap__is_wanted(map, sector, x + k, y, CONEMAP__STORE)) map->build.cones[first + at + (size_t)k] = cones[k];
}

static void conemap__store_rows(conemap_map *map, int sector, int y0, int y1) {
    int x, y;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < map->info.width; x += CONEMAP__RUN)
            conemap__store_run(map, sector, x, y, conemap__mini(CONEMAP__RUN, map->info.width - x));
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
    sector = job / conemap__bands(map); /* of jobs that are bands */
    y0 = (job - sector * conemap__bands(map)) * CONEMAP__BAND;
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
    case CONEMAP__PASS_STORE: conemap__store_rows(map, sector, y0, conemap__mini(y0 + CONEMAP__BAND, h)); break;
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
        hash = conemap__hash(hash, conemap__bits(map->heights[k]));
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
    memset(&map->build.texels, 0, sizeof map->build.texels);
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

/* Whole distance, in texels, from `at` to the texels low..high of an axis, or to the images of a wrapping one. A sign
   leaves out what lies wholly on the other side, by more than the cells around two texels. */
static int conemap__axis_distance(int at, int low, int high, int size, conemap_wrap wrap, int sign) {
    int d = 4 * CONEMAP_MAX_SIZE, image, images = wrap == CONEMAP_WRAP;
    for (image = -images; image <= images; ++image) {
        int before = low + image * size - at, after = at - (high + image * size);
        if ((sign > 0 && after > 2) || (sign < 0 && before > 2)) continue;
        d = conemap__mini(d, conemap__maxi(0, conemap__maxi(before, after)));
    }
    return d;
}

static void conemap__mark_around(const conemap_map *map, unsigned char *wanted, int i, int j, unsigned char mark) {
    int x, y;
    for (y = j - 1; y <= j + 1; ++y)
        for (x = i - 1; x <= i + 1; ++x)
            wanted[(size_t)conemap__texel_index(y, map->info.height, map->info.wrap_v) * (size_t)map->info.width +
                   (size_t)conemap__texel_index(x, map->info.width, map->info.wrap_u)] |= mark;
}

/* Marks what an edit of rectangle (x, y, width, height) can change: a texel is safe from it if nothing as high as `highest`,
   before or after, standing at the rectangle's nearest texel, is as steep as what the texel's cone has already. With the
   bilinear guarantee the rectangle's cells count, the nearest of all are looked at whatever their slope, and a search
   serves its 3x3 texels. An octant is treated as its quadrant. */
static void conemap__mark(const conemap_map *map, int number, unsigned char *wanted, int x, int y, int width, int height,
                          float highest) {
    int bilinear = conemap__is_bilinear(&map->info), i, j, a, b, w = map->info.width, h = map->info.height;
    conemap__sector sector = conemap__make_sector(&map->info, number);
    const float *cones = map->cones + (size_t)number * conemap__texels(map);
    float near2 = 0.0f, deflate = 0.0f;
    size_t at;
    if (bilinear) {
        deflate = 0.25f * (map->build.search_u * map->build.search_u + map->build.search_v * map->build.search_v);
        near2 = deflate / CONEMAP__TOLERANCE;
    }
    for (j = 0; j < h; ++j)
        for (i = 0; i < w; ++i) {
            int far_u = conemap__axis_distance(i, x, x + width - 1, w, map->info.wrap_u, sector.su);
            int far_v = conemap__axis_distance(j, y, y + height - 1, h, map->info.wrap_v, sector.sv);
            float du = (float)conemap__maxi(0, far_u - bilinear) * map->build.search_u;
            float dv = (float)conemap__maxi(0, far_v - bilinear) * map->build.search_v;
            float d2 = du * du + dv * dv, rise = highest - map->heights[(size_t)j * (size_t)w + (size_t)i];
            float least = CONEMAP__FAR;
            int hit = d2 <= near2;
            if (far_u >= 4 * CONEMAP_MAX_SIZE || far_v >= 4 * CONEMAP_MAX_SIZE) continue; /* not in this sector */
            if (!hit && rise <= 0.0f) continue;
            for (b = -bilinear; !hit && b <= bilinear; ++b)
                for (a = -bilinear; a <= bilinear; ++a) {
                    size_t beside = (size_t)conemap__texel_index(j + b, h, map->info.wrap_v) * (size_t)w +
                                    (size_t)conemap__texel_index(i + a, w, map->info.wrap_u);
                    least = conemap__min(least, conemap__slope_floor(map, cones, beside));
                }
            if (!hit && rise * rise < least * (d2 - deflate)) continue;
            if (bilinear)
                conemap__mark_around(map, wanted, i, j, CONEMAP__STORE);
            else
                wanted[(size_t)j * (size_t)w + (size_t)i] = CONEMAP__STORE;
        }
    for (j = 0; j < h; ++j)
        for (i = 0; i < w; ++i) {
            at = (size_t)j * (size_t)w + (size_t)i;
            if (!(wanted[at] & CONEMAP__STORE)) continue;
            if (bilinear)
                conemap__mark_around(map, wanted, i, j, CONEMAP__SEARCH);
            else
                wanted[at] |= CONEMAP__SEARCH;
        }
}

static float conemap__rectangle_max(const conemap_map *map, int x, int y, int width, int height, float highest) {
    int i, j;
    for (j = y; j < y + height; ++j)
        for (i = x; i < x + width; ++i) highest = conemap__max(highest, conemap__height(map, i, j));
    return highest;
}

CONEMAP__DEF conemap_result conemap_update(conemap_map *map, const conemap_desc *desc, int x, int y, int width,
                                           int height) {
    conemap_map work;
    conemap_desc settings;
    conemap_result result;
    conemap_heights rectangle;
    size_t memory_size, scratch_size, texels, marks;
    unsigned char *wanted;
    void *buffer = NULL; /* a byte for each cone, and the rectangle's new heights until all of them are known to be good */
    float highest;
    int pass, job, partial, k;
    if (!map || !map->heights || !desc) return CONEMAP_ERROR_NULL;
    settings = *desc;
    result = conemap__resolve(&settings);
    if (result != CONEMAP_OK) return result;
    settings.memory = map->build.memory;
    settings.memory_size = map->memory_size;
    settings.keep_pyramid = map->cells.levels > 0;
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
    texels = conemap__texels(map);
    marks = texels * (size_t)conemap__planes(&map->info);
    work.build.allocator = settings.allocator;
    result = conemap__allocate(&work, memory_size, scratch_size);
    if (result == CONEMAP_OK)
        result = conemap__take(&settings.allocator, NULL, 0, marks + (size_t)width * (size_t)height * sizeof(float),
                               &buffer, &k);
    wanted = (unsigned char *)buffer;
    if (result == CONEMAP_OK) {
        unsigned char *cursor = wanted + marks;
        rectangle = settings.heights;
        rectangle.pixels = (const unsigned char *)rectangle.pixels + (ptrdiff_t)y * rectangle.row_stride +
                           (ptrdiff_t)x * rectangle.pixel_stride;
        rectangle.width = width;
        for (k = 0; k < height && result == CONEMAP_OK; ++k) { /* by way of the plane: the buffer's end is not aligned */
            if (!conemap__kernels_of(work.isa)->decode_row(&work.info, &rectangle, k, work.build.plane))
                result = CONEMAP_ERROR_HEIGHT;
            memcpy(cursor, work.build.plane, (size_t)width * sizeof(float));
            cursor += (size_t)width * sizeof(float);
        }
    }
    if (result == CONEMAP_OK) {
        /* Everything is known and at hand: from here on nothing can fail. */
        memset(wanted, 0, marks);
        highest = conemap__rectangle_max(map, x, y, width, height, 0.0f);
        for (k = 0; k < height; ++k)
            memcpy(work.build.heights + (size_t)(y + k) * (size_t)map->info.width + (size_t)x,
                   wanted + marks + (size_t)k * (size_t)width * sizeof(float), (size_t)width * sizeof(float));
        highest = conemap__rectangle_max(map, x, y, width, height, highest);
        /* Slack depends on the way of the search, and correction on cones that are no longer there: those start afresh. */
        partial = settings.generator == CONEMAP_EXACT && !(settings.slack > 0.0f) && !(settings.min3x3 && !work.build.cell_slopes);
        if (!partial) memset(wanted, CONEMAP__SEARCH | CONEMAP__STORE, marks);
        for (k = 0; partial && k < conemap__planes(&map->info); ++k)
            conemap__mark(&work, k, wanted + (size_t)k * texels, x, y, width, height, highest);
        work.build.wanted = wanted;
        for (pass = CONEMAP__PASS_STRIPS; pass < CONEMAP__PASS_COUNT; ++pass)
            for (job = 0; job < work.build.pass_jobs[pass]; ++job) (void)conemap_run_job(&work, pass, job);
        map->info.height_hash = conemap__survey_heights(map, &map->highest);
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
        words[12] < 1 || words[12] >= CONEMAP_GENERATOR_COUNT || words[13] < 1 || words[13] >= CONEMAP_GUARANTEE_COUNT ||
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
    load.min3x3 = 0;
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
    for (job = 0; job < map->build.pass_jobs[CONEMAP__PASS_CELLS]; ++job)
        conemap__pyramid_strip(map, &map->cells, job);
    if (map->cells.levels > 0) conemap__pyramid_top(map, &map->cells);
    memset(&map->build.texels, 0, sizeof map->build.texels);
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

CONEMAP__INLINE conemap__mix conemap__sample_cell(const conemap_map *map, const float *cones, conemap__quad quad, float x,
                                                  float y) {
    conemap__mix mix;
    float cone = map->info.texture.per_cell ? cones[quad.at00] : conemap__bilinear(conemap__gather(cones, quad), x, y);
    mix.height = conemap__bilinear(conemap__gather(map->heights, quad), x, y);
    mix.tangent = conemap__decode_tan(&map->info, mix.height, cone);
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
    int i, j, k;
    if (!map || !map->heights || !sample) return CONEMAP_ERROR_NULL;
    if (!conemap__locate(u, map->info.width, map->info.wrap_u, &i, &x) ||
        !conemap__locate(v, map->info.height, map->info.wrap_v, &j, &y))
        return CONEMAP_ERROR_POSITION;
    quad = conemap__cell_quad(map, i, j);
    c = conemap__gather(map->heights, quad);
    mix = conemap__sample_cell(map, map->cones, quad, x, y);
    for (k = 1; k < conemap__planes(&map->info); ++k)
        mix.tangent = conemap__min(
            mix.tangent,
            conemap__sample_cell(map, map->cones + (size_t)k * conemap__texels(map), quad, x, y).tangent);
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
CONEMAP__INLINE int conemap__by_border_pair(const conemap__proof *proof, const conemap__patch *p, const conemap__patch *q) {
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
    proof->slack = CONEMAP__VERIFY_APEX + (1.0 + 1.0 / 64.0) * report->worst + 1.0 / 1048576.0;
}

/* Do differences left..right, up..down from p to q reach into the sector, or with `whole` into its quadrant? Those that
   only touch it can be left: the same points lie in other rectangles too, or are the limit of points inside. */
CONEMAP__INLINE int conemap__sees_box(const conemap__proof *proof, double left, double right, double up, double down,
                                      int whole) {
    double x = proof->sector.su > 0 ? right : -left, y = proof->sector.sv > 0 ? down : -up;
    if ((x <= 0.0 && proof->info->width > 1) || (y <= 0.0 && proof->info->height > 1)) return 0;
    if (proof->sector.major == 0 || whole) return 1;
    return proof->sector.major == 1 ? x > (proof->sector.sv > 0 ? up : -down) : y > (proof->sector.su > 0 ? left : -right);
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
            if ((half_x && dx * (double)proof->sector.su < 0.0) || (half_y && dy * (double)proof->sector.sv < 0.0)) continue;
            side = (rise - 2.0 * CONEMAP__VERIFY_GRAIN) * p->t[i];
            if (side > 0.0 && side * side > d2 && conemap__sees_point(proof, p, q, dx, dy)) { /* the corner tangents are exact, so this one is real */
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

/* May a block `cells` cells away, beside a wrapping border, be left because another image of all of it is as near? Half the
   way round in all directions, the whole way in a quadrant and along an octant's minor axis. */
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
        proof->depth = depths[pass];
        proof->work = CONEMAP__VERIFY_WORK;
        proof->open = 0;
        conemap__prove_pass(proof, apices);
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
                if (!(conemap__most4(patch.t) * steepest[k] > 1.0 + CONEMAP__VERIFY_APEX - CONEMAP__VERIFY_GRAIN)) continue;
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
   T R A C E R S

   A ray is clipped to the map once and followed in texel coordinates that start in the cell it enters, in a time
   scaled by a power of two so that its length does not matter. Times and positions are doubles: across 16384 texels a
   float is off by a thousandth of a texel, which on a wall is a thousandth of the box's height. The cell is
   walked, not recomputed: a step to a cell's border moves the cell index by one, and after a longer step the index
   never falls back. So every step gets somewhere, whatever the position's rounding says.
   ====================================================================================================== */

#define CONEMAP__REACH 1048576.0 /* texels that a ray is followed on wrapping axes */
#define CONEMAP__NEVER 1e300     /* a time that does not come */
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

/* Narrows [t0, t1] to where low <= o + v t <= high; 0 if nothing is left. *axis_in and *axis_out get `axis` where
   this slab decides. */
static int conemap__clip(double o, double v, double low, double high, int axis, double *t0, double *t1,
                         int *axis_out) {
    double a, b;
    if (v == 0.0) return o >= low && o <= high;
    a = ((v > 0.0 ? low : high) - o) / v;
    b = ((v > 0.0 ? high : low) - o) / v;
    if (a > *t0) *t0 = a;
    if (b < *t1) {
        *t1 = b;
        *axis_out = axis;
    }
    return *t0 <= *t1;
}

static conemap_result conemap__check_ray(const conemap_ray *ray) {
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

/* Puts an axis of the walk into texels; returns the base cell. */
static int conemap__enter_axis(double position, int size, conemap_wrap wrap, double *place) {
    double x;
    int cell;
    position = wrap == CONEMAP_WRAP ? conemap__fraction(position) : conemap__clamp01(position); /* far origins cancel badly */
    x = position * (double)size - 0.5;
    cell = conemap__floord(x);
    if (wrap != CONEMAP_WRAP) { /* clipping is off by a last bit */
        int first = -conemap__first_cell(wrap);
        cell = conemap__maxi(first, conemap__mini(cell, first + conemap__cell_count(size, wrap) - 1));
    }
    *place = conemap__clamp01(x - (double)cell);
    return cell;
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
    in_box = conemap__clip(o[2], v[2], 0.0, 1.0, 2, &box0, &box1, &box_out);
    if (info->wrap_u != CONEMAP_WRAP)
        in_box = conemap__clip(o[0], v[0], 0.0, 1.0, 0, &box0, &box1, &box_out) && in_box;
    if (info->wrap_v != CONEMAP_WRAP)
        in_box = conemap__clip(o[1], v[1], 0.0, 1.0, 1, &box0, &box1, &box_out) && in_box;
    t0 = box0;
    t1 = box1;
    out = box_out;
    low_u = info->wrap_u == CONEMAP_NOTHING ? 0.5 / (double)info->width : 0.0;
    low_v = info->wrap_v == CONEMAP_NOTHING ? 0.5 / (double)info->height : 0.0;
    meets = in_box;
    if (meets && info->wrap_u == CONEMAP_NOTHING)
        meets = conemap__clip(o[0], v[0], low_u, 1.0 - low_u, 0, &t0, &t1, &out);
    if (meets && info->wrap_v == CONEMAP_NOTHING)
        meets = conemap__clip(o[1], v[1], low_v, 1.0 - low_v, 1, &t0, &t1, &out);

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

/* First t in [0, end] at which the ray meets the patch, from a point at (x, y, z) in the cell; -1 if none. The
   clearance along the ray is c + b t + a t^2, solved in the form that does not cancel. */
static double conemap__patch_hit(const conemap__walk *walk, conemap__corners h, double x, double y, double z,
                                 double end) {
    double h00 = (double)h.h00, hx = (double)h.h10 - h00, hy = (double)h.h01 - h00;
    double hxy = (double)h.h11 - (double)h.h01 - hx;
    double c = z - (h00 + hx * x + hy * y + hxy * (x * y));
    double b = walk->vz - (hx * walk->vx + hy * walk->vy + hxy * (x * walk->vy + y * walk->vx));
    double a = -hxy * (walk->vx * walk->vy);
    double discriminant = b * b - 4.0 * a * c, q, first, second;
    if (c <= 0.0) return 0.0;
    if (discriminant < 0.0) return -1.0;
    q = -0.5 * (b + (b < 0.0 ? -sqrt(discriminant) : sqrt(discriminant)));
    first = q != 0.0 ? c / q : CONEMAP__NEVER;
    second = a != 0.0 ? q / a : CONEMAP__NEVER;
    if (first < 0.0) first = CONEMAP__NEVER;
    if (second >= 0.0 && second < first) first = second;
    return first <= end ? first : -1.0;
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
#undef CONEMAP__FAR
#undef CONEMAP__HASH_START
#undef CONEMAP__STRIP_LEVELS
#undef CONEMAP__STRIP
#undef CONEMAP__BAND
#undef CONEMAP__RUN
#undef CONEMAP__NEAR
#undef CONEMAP__TILE
#undef CONEMAP__NOTED
#undef CONEMAP__TANGENT_MARGIN
#undef CONEMAP__KNOWN
#undef CONEMAP__VERIFY_DEPTH
#undef CONEMAP__VERIFY_WORK
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
#undef CONEMAP__KERNEL_LIST
#undef CONEMAP__ATTRIBUTE
#undef CONEMAP__X86
#undef CONEMAP__ARM
#undef CONEMAP__WASM

#endif /* CONEMAP_IMPLEMENTATION */

/* ####################################################################################################### */
#ifdef CONEMAP__LANES /* included by itself, once for each instruction set: see K E R N E L S */

#define CONEMAP__FUNCTION CONEMAP__TARGET static
#define CONEMAP__LANE_GROUPS (CONEMAP__LANES < 4 ? 1 : (1 << CONEMAP__LANES / 4) - 1) /* of a tile, in a vector */
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

/* LANES of a row from column x on, which may lie beyond its ends; `missing` stands there unless the row wraps, or its ends are
   repeated. */
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

CONEMAP__FUNCTION void CONEMAP__KERNEL(gradient_row)(const float *above, const float *below, int width, int wraps, float a,
                                                     float b, float *out) {
    int x;
    for (x = 0; x < width; x += CONEMAP__LANES) {
        CONEMAP__F h00 = CONEMAP__KERNEL(load)(above + x, width - x), h01 = CONEMAP__KERNEL(load)(below + x, width - x);
        CONEMAP__F h10 = CONEMAP__KERNEL(beside)(above, x + 1, width, wraps, 1, 0.0f);
        CONEMAP__F h11 = CONEMAP__KERNEL(beside)(below, x + 1, width, wraps, 1, 0.0f);
        CONEMAP__F along = CONEMAP__KERNEL(larger)(CONEMAP__SUB(h10, h00), CONEMAP__SUB(h11, h01));
        CONEMAP__F across = CONEMAP__KERNEL(larger)(CONEMAP__SUB(h01, h00), CONEMAP__SUB(h11, h10));
        along = CONEMAP__KERNEL(over)(along, a);
        across = CONEMAP__KERNEL(over)(across, b);
        CONEMAP__KERNEL(store)(out + x, CONEMAP__ADD(CONEMAP__MUL(along, along), CONEMAP__MUL(across, across)), width - x);
    }
}

/* Step 3 of the proof of safe cones: an edge of length l at distance c, its ends `first` (at the foot of the perpendicular)
   and `last` above the eye. */
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
        CONEMAP__F apex = CONEMAP__KERNEL(load)(rows[1] + x, width - x), best = CONEMAP__F1(least), along[2], slope_x[2];
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
                                                 const float *inverse, int n, int width, int wraps, int first, int count,
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

/* ---- the search of a tile: see G E N E R A T I O N ----------------------------------------------------------------- */

/* A group's lowest texel and least slope, for the groups of a block. */
CONEMAP__HELPER void CONEMAP__KERNEL(sum_up)(conemap__tile *tile, int first) {
    int g;
    for (g = first; g < first + 4; ++g) {
        const float *s = tile->slope2 + 4 * g;
        tile->bar[g] = conemap__min(conemap__min(s[0], s[1]), conemap__min(s[2], s[3])) * CONEMAP__MARGIN;
    }
}

/* Tests texels (x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1), or only the first, against the blocks of some groups. Places
   count from the tile's corner. `plain`: vertex cones. */
CONEMAP__HELPER void CONEMAP__KERNEL(look_at)(const conemap__search *search, conemap__tile *tile, int groups, int x, int y,
                                              const float *heights, int texels, int plain) {
    int block, i, c, noted, any = 0;
    if (tile->noted + 4 > CONEMAP__NOTED) tile->noted = 1; /* these are hints only */
    noted = tile->noted;
    for (block = 0; block < 4; ++block) {
        int won = 0;
        if (!(groups >> (4 * block) & 15)) continue;
        for (i = 16 * block; i < 16 * block + 16; i += CONEMAP__LANES) {
            CONEMAP__F lane_x = CONEMAP__LOADF(conemap__lane_x + i), lane_y = CONEMAP__LOADF(conemap__lane_y + i);
            CONEMAP__F apex = CONEMAP__LOADF(tile->height + i), s = CONEMAP__LOADF(tile->slope2 + i);
            CONEMAP__F bar = CONEMAP__MUL(s, CONEMAP__F1(CONEMAP__MARGIN));
            CONEMAP__F dx[2], dy[2];
            CONEMAP__M asked;
            if (!(groups >> i / 4 & CONEMAP__LANE_GROUPS)) continue;
            asked = CONEMAP__IGT(CONEMAP__IAND(CONEMAP__I1(groups), CONEMAP__LOADI(conemap__lane_bit + i)), CONEMAP__I1(0));
            for (c = 0; c < (texels > 1 ? 2 : 1); ++c) {
                dx[c] = CONEMAP__MUL(CONEMAP__SUB(CONEMAP__F1((float)(x + c)), lane_x), CONEMAP__F1(search->a));
                dy[c] = CONEMAP__MUL(CONEMAP__SUB(CONEMAP__F1((float)(y + c)), lane_y), CONEMAP__F1(search->b));
                dx[c] = CONEMAP__MUL(dx[c], dx[c]);
                dy[c] = CONEMAP__MUL(dy[c], dy[c]);
            }
            for (c = 0; c < texels; ++c) {
                CONEMAP__F dh = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1(heights[c]), apex), CONEMAP__F1(0.0f));
                CONEMAP__F dh2 = CONEMAP__MUL(dh, dh), d2 = CONEMAP__ADD(dx[c & 1], dy[c >> 1]);
                CONEMAP__M beats;
                if (plain) {
                    beats = CONEMAP__LT(CONEMAP__MUL(bar, d2), dh2);
                } else {
                    CONEMAP__M is_far = CONEMAP__LE(CONEMAP__F1(search->near2), d2);
                    d2 = CONEMAP__SUB(d2, CONEMAP__F1(search->deflate));
                    beats = CONEMAP__AND(is_far, CONEMAP__LT(CONEMAP__MUL(bar, d2), dh2));
                    beats = CONEMAP__AND(beats, asked); /* with slack it matters which lanes look */
                }
                if (CONEMAP__ANY(beats)) {
                    CONEMAP__F slope2 = CONEMAP__DIV(dh2, d2);
                    CONEMAP__I decider = CONEMAP__LOADI(tile->decider + i);
                    beats = CONEMAP__AND(beats, CONEMAP__LT(s, slope2));
                    s = CONEMAP__PICK(beats, slope2, s);
                    bar = CONEMAP__MUL(s, CONEMAP__F1(CONEMAP__MARGIN));
                    CONEMAP__STOREI(tile->decider + i, CONEMAP__PICKI(beats, CONEMAP__I1(noted + c), decider));
                    CONEMAP__STOREF(tile->slope2 + i, s);
                    won = 1;
                }
            }
        }
        if (won) CONEMAP__KERNEL(sum_up)(tile, 4 * block);
        any |= won;
    }
    if (!any) return;
    for (c = 0; c < texels; ++c) {
        tile->noted_x[noted + c] = x + (c & 1) + tile->x + tile->shift_x;
        tile->noted_y[noted + c] = y + (c >> 1) + tile->y + tile->shift_y;
    }
    tile->noted += texels;
}

/* The groups of `groups` of which some texel must look into a block: its highest texel, its columns x0 to x1, rows y0 to y1. */
CONEMAP__HELPER int CONEMAP__KERNEL(look_into)(const conemap__search *search, conemap__tile *tile, int groups,
                                               float highest, float x0, float x1, float y0, float y1, int plain) {
    int i, k, alive = 0;
    for (i = 0; i < CONEMAP__TILE * CONEMAP__TILE; i += CONEMAP__LANES) {
        CONEMAP__F x = CONEMAP__LOADF(conemap__lane_x + i), y = CONEMAP__LOADF(conemap__lane_y + i), dx, dy, dh2, d2, bar;
        CONEMAP__M beats;
        int bits;
        if (!(groups >> i / 4 & CONEMAP__LANE_GROUPS) || (plain && CONEMAP__LANES == 1 && (alive >> i / 4 & 1))) continue;
        dx = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1(x0), x), CONEMAP__SUB(x, CONEMAP__F1(x1)));
        dy = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1(y0), y), CONEMAP__SUB(y, CONEMAP__F1(y1)));
        dx = CONEMAP__MUL(CONEMAP__MAX(dx, CONEMAP__F1(0.0f)), CONEMAP__F1(search->a));
        dy = CONEMAP__MUL(CONEMAP__MAX(dy, CONEMAP__F1(0.0f)), CONEMAP__F1(search->b));
        d2 = CONEMAP__ADD(CONEMAP__MUL(dx, dx), CONEMAP__MUL(dy, dy));
        dh2 = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1(highest), CONEMAP__LOADF(tile->height + i)), CONEMAP__F1(0.0f));
        dh2 = CONEMAP__MUL(dh2, dh2);
        bar = CONEMAP__MUL(CONEMAP__LOADF(tile->slope2 + i), CONEMAP__F1(CONEMAP__MARGIN));
        if (plain) {
            beats = CONEMAP__LT(CONEMAP__MUL(bar, d2), dh2);
        } else {
            CONEMAP__M is_near = CONEMAP__LT(d2, CONEMAP__F1(search->near2)), wide;
            d2 = CONEMAP__MAX(CONEMAP__SUB(d2, CONEMAP__F1(search->deflate)), CONEMAP__F1(0.0f));
            bar = CONEMAP__MUL(bar, d2);
            beats = CONEMAP__LT(bar, dh2);
            if (search->widen2 > 1.0f && CONEMAP__ANY(beats)) {
                CONEMAP__F folded = CONEMAP__LOADF(tile->lane_folded + i);
                wide = CONEMAP__LT(CONEMAP__MUL(bar, CONEMAP__F1(search->widen2)), dh2);
                wide = CONEMAP__AND(beats, CONEMAP__OR(is_near, wide));
                folded = CONEMAP__PICK(CONEMAP__ANDNOT(beats, wide), CONEMAP__MAX(folded, CONEMAP__DIV(dh2, d2)), folded);
                CONEMAP__STOREF(tile->lane_folded + i, folded);
                beats = wide;
            }
        }
        bits = CONEMAP__BITS(beats);
        for (k = 0; k < CONEMAP__LANES; k += 4) alive |= (bits >> k & 15 ? 1 : 0) << (i + k) / 4;
    }
    return alive & groups;
}

/* Pushes those of four sibling blocks, the children of (x, y) of level k + 1, that some of `groups` must look into; the
   one nearest to the tile comes last and so is popped first. `skip`: a child that is left out, or -1. */
CONEMAP__HELPER int CONEMAP__KERNEL(open)(const conemap_map *map, const conemap__search *search, conemap__tile *tile, int k,
                                          int x, int y, int groups, int skip, conemap__node *out, int plain) {
    const conemap_pyramid *pyramid = &map->build.texels;
    int size = 1 << k, left = 2 * size * x - tile->x, top = 2 * size * y - tile->y, g, c, count = 0;
    int near_x = left + size <= CONEMAP__TILE / 2, near_y = top + size <= CONEMAP__TILE / 2;
    int right_too = 2 * x + 1 < pyramid->width[k], below_too = 2 * y + 1 < pyramid->height[k], alive[4];
    const float *row = conemap__maxima(pyramid, k, 2 * y) + 2 * x;
    float maxima[4];
    maxima[0] = row[0];
    maxima[1] = right_too ? row[1] : -1.0f;
    maxima[2] = below_too ? row[pyramid->width[k]] : -1.0f;
    maxima[3] = right_too && below_too ? row[pyramid->width[k] + 1] : -1.0f;
    alive[0] = alive[1] = alive[2] = alive[3] = 0;
    for (g = 0; g < 16; g += CONEMAP__LANES) {
        CONEMAP__F x0 = CONEMAP__LOADF(conemap__group_x + g), y0 = CONEMAP__LOADF(conemap__group_y + g);
        CONEMAP__F x1 = CONEMAP__ADD(x0, CONEMAP__F1(1.0f)), y1 = CONEMAP__ADD(y0, CONEMAP__F1(1.0f));
        CONEMAP__F lowest = CONEMAP__LOADF(tile->lowest + g), bar = CONEMAP__LOADF(tile->bar + g), dx[2], dy[2];
        if (!(groups >> g & ((1 << CONEMAP__LANES) - 1))) continue;
        for (c = 0; c < 2; ++c) {
            float first_x = (float)(left + c * size), first_y = (float)(top + c * size), extent = (float)(size - 1);
            dx[c] = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1(first_x), x1), CONEMAP__SUB(x0, CONEMAP__F1(first_x + extent)));
            dy[c] = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1(first_y), y1), CONEMAP__SUB(y0, CONEMAP__F1(first_y + extent)));
            dx[c] = CONEMAP__MUL(CONEMAP__MAX(dx[c], CONEMAP__F1(0.0f)), CONEMAP__F1(search->a));
            dy[c] = CONEMAP__MUL(CONEMAP__MAX(dy[c], CONEMAP__F1(0.0f)), CONEMAP__F1(search->b));
            dx[c] = CONEMAP__MUL(dx[c], dx[c]);
            dy[c] = CONEMAP__MUL(dy[c], dy[c]);
        }
        for (c = 0; c < 4; ++c) {
            CONEMAP__F dh = CONEMAP__MAX(CONEMAP__SUB(CONEMAP__F1(maxima[c]), lowest), CONEMAP__F1(0.0f));
            CONEMAP__F dh2 = CONEMAP__MUL(dh, dh), d2 = CONEMAP__ADD(dx[c & 1], dy[c >> 1]), product;
            if (plain) {
                alive[c] |= CONEMAP__BITS(CONEMAP__LT(CONEMAP__MUL(bar, d2), dh2)) << g;
            } else {
                CONEMAP__I asked = CONEMAP__IAND(CONEMAP__I1(groups), CONEMAP__LOADI(conemap__group_bit + g));
                CONEMAP__M beats, is_near, wide, dropped;
                is_near = CONEMAP__LT(d2, CONEMAP__F1(search->near2));
                d2 = CONEMAP__MAX(CONEMAP__SUB(d2, CONEMAP__F1(search->deflate)), CONEMAP__F1(0.0f));
                product = CONEMAP__MUL(bar, d2);
                beats = CONEMAP__LT(product, dh2);
                if (search->widen2 > 1.0f && CONEMAP__ANY(beats)) {
                    CONEMAP__F folded = CONEMAP__LOADF(tile->folded + g);
                    wide = CONEMAP__AND(beats, CONEMAP__OR(is_near, CONEMAP__LT(CONEMAP__MUL(product,
                                                                             CONEMAP__F1(search->widen2)), dh2)));
                    dropped = CONEMAP__ANDNOT(CONEMAP__ANDNOT(beats, wide), CONEMAP__IEQ(asked, CONEMAP__I1(0)));
                    folded = CONEMAP__PICK(dropped, CONEMAP__MAX(folded, CONEMAP__DIV(dh2, d2)), folded);
                    CONEMAP__STOREF(tile->folded + g, folded);
                    beats = wide;
                }
                alive[c] |= CONEMAP__BITS(beats) << g;
            }
        }
    }
    for (c = 3; c >= 0; --c) {
        int across = (c & 1) ^ near_x, down = (c >> 1) ^ near_y, child = 2 * down + across;
        float first_x = (float)(left + across * size), first_y = (float)(top + down * size), extent = (float)(size - 1);
        if (!(alive[child] & groups) || child == skip) continue;
        out[count].k = k;
        out[count].x = 2 * x + across;
        out[count].y = 2 * y + down;
        out[count].groups = CONEMAP__KERNEL(look_into)(search, tile, alive[child] & groups, maxima[child], first_x,
                                                       first_x + extent, first_y, first_y + extent, plain);
        count += out[count].groups != 0;
    }
    return count;
}

/* Works the stack off, down to blocks of 2 x 2 texels, which are looked at one by one. */
CONEMAP__HELPER void CONEMAP__KERNEL(work_off)(const conemap_map *map, const conemap__search *search, conemap__tile *tile,
                                               conemap__node *stack, int count, int plain) {
    while (count > 0) {
        conemap__node node = stack[--count];
        if (node.k > 1) {
            count += CONEMAP__KERNEL(open)(map, search, tile, node.k - 1, node.x, node.y, node.groups, -1, stack + count,
                                           plain);
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
    for (k = 0; k < 16; ++k) {
        const float *h = tile->height + 4 * k;
        tile->lowest[k] = conemap__min(conemap__min(h[0], h[1]), conemap__min(h[2], h[3]));
        tile->folded[k] = 0.0f;
    }
    for (k = 0; k < 16; k += 4) CONEMAP__KERNEL(sum_up)(tile, k);
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

CONEMAP__FUNCTION void CONEMAP__KERNEL(search_tile)(const conemap_map *map, conemap__search *search, conemap__tile *tile) {
    if (search->deflate > 0.0f || search->near2 > 0.0f || search->widen2 > 1.0f)
        CONEMAP__KERNEL(search_all)(map, search, tile, 0);
    else
        CONEMAP__KERNEL(search_all)(map, search, tile, 1);
}

/* For the next instruction set. */
#undef CONEMAP__FUNCTION
#undef CONEMAP__LANE_GROUPS
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
