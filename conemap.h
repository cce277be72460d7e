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
       P R E P A R E D   T R A C I N G   the same for many rays: a table for each cell, rays side by side
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
       P R E P A R A T I O N       the prepared tracer's table, with the proof; its rays' way in and out
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
   SAFE CONES). max_tan caps all of them.

   A miss, for a tracer, is a ray above which the true surface rises by more than 2^-20 somewhere before the hit that is
   reported. CONEMAP_TRACE_EXACT over cones with the bilinear guarantee, in any format, and CONEMAP_TRACE_MAXMIP have none.

   Bits. Results are the same to the bit however the work is split into jobs, on every strict IEEE build.

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
    const float *cones;     /* width * height, encoded, as a texture fetch returns them: see conemap_decode */
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
        float *folds;           /* the same with slack: plane and rims of the bounds that were folded in */
        float *rims;            /* bilinear guarantee: what each band knows of the rows above and below it */
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

/* The bytes of one row, and the texture's bytes at a row pitch (0: rows touch). 0 if map is null or empty, or
   the pitch is below a row. The last row takes a whole pitch too. */
CONEMAP_API size_t conemap_row_size(const conemap_map *map);
CONEMAP_API size_t conemap_texture_size(const conemap_map *map, size_t row_pitch);

/* Writes the texture, native byte order, into the caller's pixels. row_pitch: bytes from row to row, 0: rows
   touch; bytes between rows stay as they were, and none are needed behind the last row. Errors: NULL, STRIDE (pitch
   below a row), BUFFER, OVERFLOW. */
CONEMAP_API conemap_result conemap_write_texture(const conemap_map *map, void *pixels, size_t size,
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

/* ======================================================================================================
   S A M P L I N G
   ====================================================================================================== */

/* Height, cone and slope at (u, v), bilinear; cones are interpolated as stored, then decoded, as a shader does; with
   per_cell the cell's own.
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
   with tan(p) as conemap_sample_at gives it, but for that sampler's rounding, which the 2^-20 is there for.

   info: width, height, wrap_u, wrap_v, aspect, max_tan and texture are read. heights, cones: width * height each,
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

/* ======================================================================================================
   P R E P A R E D   T R A C I N G

   The same hits, many rays at a time: the map's surface gets a table of its own, 8 bytes for each bilinear cell, from
   which a ray reads how far it may fly into its quadrant; it then needs no cones. Rays are traced side by side, one in each
   lane of the instruction set, and every lane is exact by itself, so the bits depend neither on the instruction set nor on
   which rays are neighbours. Rays that come in a coherent order (an image's pixels) are the fastest.
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
    const uint64_t *table;  /* width * height records, private in what they hold */
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

/* Prepares a map for tracing. Needs heights only: whatever cones a map has or lacks, its prepared tracer misses nothing.
   map: stays where it is while *prepared is in use; after conemap_update, prepare again. desc: null for the defaults.
   prepared: overwritten; zeroed unless OK. Takes the table and, during the call, about twice as much again from the
   allocator. Errors: NULL, ENUM, UNSUPPORTED (isa), OVERFLOW, MEMORY, BUFFER,
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
    bits -= bits >> 1 & 0x55;
    bits = (bits & 0x33) + (bits >> 2 & 0x33);
    return (bits + (bits >> 4)) & 15;
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

/* A value of level 0: a texel's height, or with `falling` a cell's highest corner if it falls (see CONEMAP_RELAXED_EXACT). */
static float conemap__falling_cell(const conemap_map *map, int quadrant, int x, int y);

CONEMAP__INLINE float conemap__lowest_level(const conemap_map *map, const conemap_pyramid *pyramid, int x, int y) {
    return pyramid == &map->build.texels ? conemap__height(map, x, y)
                                         : conemap__falling_cell(map, (int)(pyramid - map->build.falling), x, y);
}

/* Level k from level k - 1. Level 0 of the texels is a copy of the heights; that of the cells is not stored. */
static void conemap__pyramid_rows(const conemap_map *map, conemap_pyramid *pyramid, int k, int y0, int y1) {
    int w = pyramid->width[k], h = pyramid->height[k], x, y;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < w; ++x) {
            float *children = conemap__children(pyramid, k, x / 2, y / 2);
            float highest;
            if (k == 0) {
                highest = conemap__lowest_level(map, pyramid, x, y);
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
   Types CONEMAP__D, CONEMAP__L, CONEMAP__W hold CONEMAP__DLANES doubles, uint64s and truth values of doubles:
       D1 L1 LOADD STORED LOADL ADDD SUBD MULD DIVD SQRTD MIND MAXD LTD LED ANDW ORW ANDNOTW PICKD BITSW   as above
       STOREN             doubles 0..2^31 - 1 as int32s
       GATHERL GATHERFD   (base, p) uint64s or floats, these as doubles, at the int32s behind p
       WHOLE              towards zero, for 0..2^31 - 1
       LOADFD             DLANES floats as doubles
       FLOORD             for anything below 2^52
       LADD LSUB LAND LSHL    uint64s; LSHRL shifts each lane by its own count; BITSD BITSL the same bits as another type
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

/* Rays of the prepared tracer under way, a column for each of their numbers, CONEMAP__BLOCK of them side by side: see
   P R E P A R A T I O N. */
#define CONEMAP__SLOTS 64
#define CONEMAP__BLOCK 8
typedef struct conemap__way { /* along an axis, mirrored so that it is never flown backwards */
    double p[CONEMAP__BLOCK], v[CONEMAP__BLOCK];
    double per_v[CONEMAP__BLOCK], border[CONEMAP__BLOCK]; /* it comes to cell c at c per_v + border */
    double sign[CONEMAP__BLOCK];    /* -1 where mirrored */
} conemap__way;

/* What a step writes comes first and what it reads next: a block is 2240 bytes, so that neither lies a multiple of 4096
   bytes from what the two blocks before have just written, which processors take for the same place for a while. */
typedef struct conemap__block_of_rays {
    double state[CONEMAP__BLOCK];   /* CONEMAP__FLYING ... */
    double t[CONEMAP__BLOCK], steps[CONEMAP__BLOCK], cell[2][CONEMAP__BLOCK];
    int32_t record[CONEMAP__BLOCK]; /* index of its cell in the table */
    int32_t fill[CONEMAP__BLOCK];   /* to whole cache lines */
    double t_end[CONEMAP__BLOCK], z[CONEMAP__BLOCK], vz[CONEMAP__BLOCK];
    double sink[CONEMAP__BLOCK];    /* time to sink by 1; huge if it does not */
    double major[CONEMAP__BLOCK], per_major[CONEMAP__BLOCK]; /* speed along the faster axis; its inverse */
    double table_start[CONEMAP__BLOCK]; /* index of cell 0, mirrored */
    uint64_t shift[CONEMAP__BLOCK]; /* to its quadrant's part of a record */
    conemap__way way[2];
    double z_end[CONEMAP__BLOCK];
    double texel_start[CONEMAP__BLOCK]; /* as table_start, of the heights */
    double lower[2][CONEMAP__BLOCK];    /* a cell's number less that of the texel at its near border */
    int32_t corner[4][CONEMAP__BLOCK];  /* indices of its cell's texels, once it is close */
    /* the way back to the caller: as in conemap__walk; which of the stream's rays it is */
    double t_start[CONEMAP__BLOCK], t_gone[CONEMAP__BLOCK], t_scale[CONEMAP__BLOCK], end_status[CONEMAP__BLOCK];
    double number[CONEMAP__BLOCK];
} conemap__block_of_rays;

typedef struct conemap__flight_axis {
    double size, cells, first;      /* in texels and in cells; as conemap__first_cell */
    double low;                     /* where the surface begins, in uv; it ends at 1 - low */
    int wraps;
    double period, per_period;      /* cells until it repeats, 0: never; 1 / period */
    double last, pitch;             /* the table's: its last cell, records from one to the next */
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
    const uint64_t *table;
    const float *heights;
    conemap__flight_axis axis[2];
    conemap__stream stream;
    conemap__block_of_rays *blocks; /* CONEMAP__SLOTS rays under way */
    conemap__block_of_rays *waiting;
    int waiting_next, waiting_count;
} conemap__flight;

#define CONEMAP__FLYING 0.0
#define CONEMAP__CLOSE 1.0 /* the next cell is to be met with its patch */
#define CONEMAP__GONE 2.0  /* t_end reached above the surface */
#define CONEMAP__MET 3.0
#define CONEMAP__EMPTY 4.0

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
CONEMAP__INLINE void conemap__move(const conemap__block_of_rays *from, int slot, conemap__block_of_rays *to, int to_slot) {
    int k;
    CONEMAP__MOVE(state);
    CONEMAP__MOVE(t);
    CONEMAP__MOVE(t_end);
    CONEMAP__MOVE(steps);
    CONEMAP__MOVE(z);
    CONEMAP__MOVE(vz);
    CONEMAP__MOVE(z_end);
    CONEMAP__MOVE(sink);
    CONEMAP__MOVE(major);
    CONEMAP__MOVE(per_major);
    CONEMAP__MOVE(table_start);
    CONEMAP__MOVE(texel_start);
    CONEMAP__MOVE(record);
    CONEMAP__MOVE(shift);
    CONEMAP__MOVE(t_start);
    CONEMAP__MOVE(t_gone);
    CONEMAP__MOVE(t_scale);
    CONEMAP__MOVE(end_status);
    CONEMAP__MOVE(number);
    for (k = 0; k < 2; ++k) {
        CONEMAP__MOVE(cell[k]);
        CONEMAP__MOVE(way[k].p);
        CONEMAP__MOVE(way[k].v);
        CONEMAP__MOVE(way[k].per_v);
        CONEMAP__MOVE(way[k].border);
        CONEMAP__MOVE(way[k].sign);
        CONEMAP__MOVE(lower[k]);
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
    /* The larger of two rows; and what a square, the larger of two places in a row, does to conemap__look's columns. */
    void (*larger_row)(const float *a, const float *b, int count, float *out);
    void (*rise_row)(const float *squares, int shift, const float *tops, float per_reach, int32_t code, int count,
                     float *slopes, int32_t *clear);
    /* Traces the flight's stream. */
    void (*fly)(conemap__flight *flight);
} conemap__kernels;

#define CONEMAP__KERNEL_LIST(isa)                                                                          \
    { conemap__decode_row_##isa, conemap__narrowest_row_##isa, conemap__tangent_row_##isa, conemap__store_row_##isa, \
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
#define CONEMAP__LOADL(p) (*(p))
#define CONEMAP__STOREN(p, a) ((void)(*(p) = (int32_t)(a)))
#define CONEMAP__GATHERL(base, p) ((base)[*(p)])
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
#define CONEMAP__LADD(a, b) ((a) + (b))
#define CONEMAP__LAND(a, b) ((a) & (b))
#define CONEMAP__LSHL(a, n) ((a) << (n))
#define CONEMAP__LSHRL(a, n) ((a) >> (n))
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
#define CONEMAP__LOADL(p) _mm_loadu_si128((const __m128i *)(const void *)(p))
#define CONEMAP__STOREN(p, a) _mm_storel_epi64((__m128i *)(void *)(p), _mm_cvttpd_epi32(a))
#define CONEMAP__GATHERL(base, p) _mm_set_epi64x((long long)(base)[(p)[1]], (long long)(base)[(p)[0]])
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
#define CONEMAP__LADD(a, b) _mm_add_epi64(a, b)
#define CONEMAP__LAND(a, b) _mm_and_si128(a, b)
#define CONEMAP__LSHL(a, n) _mm_slli_epi64(a, n)
#define CONEMAP__LSHRL(a, n)                                                                               \
    _mm_castpd_si128(_mm_move_sd(_mm_castsi128_pd(_mm_srl_epi64(a, _mm_unpackhi_epi64(n, n))),             \
                                 _mm_castsi128_pd(_mm_srl_epi64(a, n))))
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
#define CONEMAP__LOADL(p) _mm256_loadu_si256((const __m256i *)(const void *)(p))
#define CONEMAP__STOREN(p, a) _mm_storeu_si128((__m128i *)(void *)(p), _mm256_cvttpd_epi32(a))
#define CONEMAP__LOADN(p) _mm_loadu_si128((const __m128i *)(const void *)(p))
#define CONEMAP__GATHERL(base, p) _mm256_i32gather_epi64((const long long *)(const void *)(base), CONEMAP__LOADN(p), 8)
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
#define CONEMAP__LADD(a, b) _mm256_add_epi64(a, b)
#define CONEMAP__LAND(a, b) _mm256_and_si256(a, b)
#define CONEMAP__LSHL(a, n) _mm256_slli_epi64(a, n)
#define CONEMAP__LSHRL(a, n) _mm256_srlv_epi64(a, n)
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
#define CONEMAP__LOADL(p) _mm512_loadu_si512(p)
#define CONEMAP__STOREN(p, a)                                                                              \
    _mm256_storeu_si256((__m256i *)(void *)(p), _mm512_maskz_cvttpd_epi32(CONEMAP__ALLD, a))
#define CONEMAP__LOADN(p) _mm256_loadu_si256((const __m256i *)(const void *)(p))
/* one by one: a gather waits long for indices that were just stored */
#define CONEMAP__GATHERL(base, p)                                                                          \
    _mm512_set_epi64((long long)(base)[(p)[7]], (long long)(base)[(p)[6]], (long long)(base)[(p)[5]],      \
                     (long long)(base)[(p)[4]], (long long)(base)[(p)[3]], (long long)(base)[(p)[2]],      \
                     (long long)(base)[(p)[1]], (long long)(base)[(p)[0]])
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
#define CONEMAP__LADD(a, b) _mm512_add_epi64(a, b)
#define CONEMAP__LAND(a, b) _mm512_and_si512(a, b)
#define CONEMAP__LSHL(a, n) _mm512_maskz_slli_epi64(CONEMAP__ALLD, a, n)
#define CONEMAP__LSHRL(a, n) _mm512_maskz_srlv_epi64(CONEMAP__ALLD, a, n)
#define CONEMAP__BITSD(a) _mm512_castsi512_pd(a)
#define CONEMAP__LOADFD(p) _mm512_maskz_cvtps_pd(CONEMAP__ALLD, _mm256_loadu_ps(p))
#define CONEMAP__FLOORD(a) _mm512_maskz_roundscale_pd(CONEMAP__ALLD, a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC)
#define CONEMAP__LSUB(a, b) _mm512_sub_epi64(a, b)
#define CONEMAP__BITSL(a) _mm512_castpd_si512(a)
#include CONEMAP_SELF
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
#define CONEMAP__DLANES 2
#define CONEMAP__D float64x2_t
#define CONEMAP__L uint64x2_t
#define CONEMAP__W uint64x2_t
#define CONEMAP__D1(x) vdupq_n_f64(x)
#define CONEMAP__L1(x) vdupq_n_u64(x)
#define CONEMAP__LOADD(p) vld1q_f64(p)
#define CONEMAP__STORED(p, v) vst1q_f64(p, v)
#define CONEMAP__LOADL(p) vld1q_u64(p)
#define CONEMAP__STOREN(p, a) vst1_s32(p, vmovn_s64(vcvtq_s64_f64(a)))
#define CONEMAP__GATHERL(base, p) vcombine_u64(vcreate_u64((base)[(p)[0]]), vcreate_u64((base)[(p)[1]]))
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
#define CONEMAP__LADD(a, b) vaddq_u64(a, b)
#define CONEMAP__LAND(a, b) vandq_u64(a, b)
#define CONEMAP__LSHL(a, n) vshlq_n_u64(a, n)
#define CONEMAP__LSHRL(a, n) vshlq_u64(a, vnegq_s64(vreinterpretq_s64_u64(n)))
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
#define CONEMAP__LOADL(p) wasm_v128_load(p)
#define CONEMAP__STOREN(p, a) wasm_v128_store64_lane(p, wasm_i32x4_trunc_sat_f64x2_zero(a), 0)
#define CONEMAP__GATHERL(base, p) wasm_i64x2_make((int64_t)(base)[(p)[0]], (int64_t)(base)[(p)[1]])
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
#define CONEMAP__LADD(a, b) wasm_i64x2_add(a, b)
#define CONEMAP__LAND(a, b) wasm_v128_and(a, b)
#define CONEMAP__LSHL(a, n) wasm_i64x2_shl(a, n)
#define CONEMAP__LSHRL(a, n)                                                                               \
    wasm_i64x2_make((int64_t)((uint64_t)wasm_i64x2_extract_lane(a, 0) >> wasm_i64x2_extract_lane(n, 0)),   \
                    (int64_t)((uint64_t)wasm_i64x2_extract_lane(a, 1) >> wasm_i64x2_extract_lane(n, 1)))
#define CONEMAP__BITSD(a) (a)
#define CONEMAP__LOADFD(p) wasm_f64x2_make((double)(p)[0], (double)(p)[1])
#define CONEMAP__FLOORD(a) wasm_f64x2_floor(a)
#define CONEMAP__LSUB(a, b) wasm_i64x2_sub(a, b)
#define CONEMAP__BITSL(a) (a)
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

/* A block that may hold something steeper, waiting its turn: dh^2 of its maximum and d^2 of its nearest texel. */
typedef struct conemap__candidate {
    float dh2, d2;
    int x, y, k;
} conemap__candidate;

/* Comparing products saves the division of a quotient: with three roundings less than this margin apart, a block is
   dropped only if its rounded quotient is no more than s. */
#define CONEMAP__MARGIN (1.0f - 1.0f / 1048576.0f)

/* One search after another, by one job. `band` is null for vertex cones. */
struct conemap__band;
typedef struct conemap__search {
    const struct conemap__band *band;
    float deflate;      /* V, taken off every squared distance: see the proof of conemap__safe_vertex, step 4 */
    float near2;        /* pairs closer than its root are looked at closely; 0 for vertex cones */
    float widen2;       /* (1 + slack)^2 */
    float folded;       /* the steepest bound that was pruned by slack alone */
    int best_i, best_j; /* what decided the last texel: neighbours often agree */
} conemap__search;

static conemap__search conemap__make_search(const conemap_map *map) {
    conemap__search search;
    memset(&search, 0, sizeof search);
    search.widen2 = (1.0f + map->build.desc.slack) * (1.0f + map->build.desc.slack);
    return search;
}

/* May something with this dh^2 and d^2 beat s? With slack, only by so much, and what is given up for it is folded in;
   near pairs are exempt, for their bound alone can be further off than that. */
CONEMAP__INLINE int conemap__may_beat(conemap__search *search, float dh2, float d2, float s) {
    float bar = s * d2 * CONEMAP__MARGIN;
    if (!(dh2 > bar)) return 0;
    if (search->widen2 > 1.0f && d2 > 0.0f && d2 + search->deflate >= search->near2 && !(dh2 > bar * search->widen2)) {
        search->folded = conemap__max(search->folded, dh2 / d2);
        return 0;
    }
    return 1;
}

/* Pushes those of four sibling blocks, the children of (x, y) of level k + 1, that may beat s; the nearest to
   texel (i, j), which may lie outside the map for its images, comes last and so is popped first. */
CONEMAP__INLINE int conemap__push_children(const conemap_map *map, conemap__search *search, int k, int x, int y, int i,
                                           int j, float apex, float s, int skip, conemap__candidate *out) {
    const float *maxima = conemap__children(&map->build.texels, k, x, y);
    int size = 1 << k, left = 2 * size * x, low = 2 * size * y, c, count = 0;
    int near_x = i >= left + size, near_y = j >= low + size;
    float dx[2], dy[2], a = map->build.search_u, b = map->build.search_v;
    dx[0] = (float)conemap__maxi(0, conemap__maxi(left - i, i - (left + size - 1))) * a;
    dx[1] = (float)conemap__maxi(0, conemap__maxi(left + size - i, i - (left + 2 * size - 1))) * a;
    dy[0] = (float)conemap__maxi(0, conemap__maxi(low - j, j - (low + size - 1))) * b;
    dy[1] = (float)conemap__maxi(0, conemap__maxi(low + size - j, j - (low + 2 * size - 1))) * b;
    dx[0] *= dx[0];
    dx[1] *= dx[1];
    dy[0] *= dy[0];
    dy[1] *= dy[1];
    for (c = 3; c >= 0; --c) {
        int across = (c & 1) ^ near_x, down = (c >> 1) ^ near_y;
        float dh = maxima[2 * down + across] - apex, dh2 = dh * dh, d2 = dx[across] + dy[down] - search->deflate;
        if (dh > 0.0f && 2 * down + across != skip && conemap__may_beat(search, dh2, d2, s)) {
            out[count].dh2 = dh2;
            out[count].d2 = d2;
            out[count].x = 2 * x + across;
            out[count].y = 2 * y + down;
            out[count].k = k;
            ++count;
        }
    }
    return count;
}

static float conemap__near_pair(const struct conemap__band *band, int ui, int uj, int vi, int vj, float best);

/* Works the stack off: opens blocks until none can beat s. The map is shifted by (shift_i, shift_j) against texel (i, j). */
CONEMAP__INLINE float conemap__open(const conemap_map *map, conemap__search *search, int i, int j, int shift_i,
                                    int shift_j, float apex, float s, conemap__candidate *stack, int count) {
    while (count > 0) {
        conemap__candidate c = stack[--count];
        float slope2;
        if (!conemap__may_beat(search, c.dh2, c.d2, s)) continue;
        if (c.k > 0) {
            count += conemap__push_children(map, search, c.k - 1, c.x, c.y, i - shift_i, j - shift_j, apex, s, -1,
                                            stack + count);
            continue;
        }
        if (c.d2 + search->deflate < search->near2) {
            s = conemap__max(s, conemap__near_pair(search->band, i, j, c.x + shift_i, c.y + shift_j, s));
            continue;
        }
        slope2 = c.dh2 / c.d2;
        if (slope2 > s) {
            s = slope2;
            search->best_i = c.x + shift_i;
            search->best_j = c.y + shift_j;
        }
    }
    return s;
}

/* What ring search finds, by branch and bound over the max pyramid: the same quotients, pruned by bounds that are
   at least as large after rounding, so the same bits in any order. It starts at the texel's own block and goes up, so
   near texels, which decide most often, come first; then the images of a wrapping map. s is what is known already.
   With slack the order matters, and it is always this one: a job's texels, row by row, each with the guess of the one
   before. */
static float conemap__exact(const conemap_map *map, conemap__search *search, int i, int j, float s) {
    conemap__candidate stack[3 * 17 + 4];
    const conemap_info *info = &map->info;
    int levels = map->build.texels.levels, w = info->width, h = info->height, k, a, b;
    int wrap_u = info->wrap_u == CONEMAP_WRAP, wrap_v = info->wrap_v == CONEMAP_WRAP;
    float apex = conemap__height(map, i, j), dh;
    search->folded = 0.0f;
    if (search->best_i != i || search->best_j != j) {
        float x = (float)(search->best_i - i) * map->build.search_u, y = (float)(search->best_j - j) * map->build.search_v;
        float d2 = x * x + y * y;
        dh = conemap__height(map, conemap__texel_index(search->best_i, w, info->wrap_u),
                             conemap__texel_index(search->best_j, h, info->wrap_v)) - apex;
        if (dh > 0.0f && d2 > 0.0f && d2 >= search->near2)
            s = conemap__max(s, dh * dh / (d2 - search->deflate));
    }
    for (k = 0; k + 1 < levels; ++k) {
        int own = (j >> k & 1) << 1 | (i >> k & 1);
        int count = conemap__push_children(map, search, k, i >> (k + 1), j >> (k + 1), i, j, apex, s, own, stack);
        s = conemap__open(map, search, i, j, 0, 0, apex, s, stack, count);
    }
    for (b = -wrap_v; b <= wrap_v; ++b)
        for (a = -wrap_u; a <= wrap_u; ++a) {
            int count;
            if (a == 0 && b == 0) continue;
            count = conemap__push_children(map, search, levels - 1, 0, 0, i - a * w, j - b * h, apex, s, -1, stack);
            s = conemap__open(map, search, i, j, a * w, b * h, apex, s, stack, count);
        }
    return s;
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
   where both hold, which is not conservative). The centre heuristic takes the middle of the block. */
static float conemap__quick(const conemap_map *map, int i, int j, int improved, int center) {
    conemap__window w = conemap__texel_window(map, i, j, 0);
    const conemap_pyramid *pyramid = &map->build.texels;
    float apex = conemap__height(map, i, j), s = map->build.least_slope2;
    int seen_low_u = 0, seen_high_u = 0, seen_low_v = 0, seen_high_v = 0, k, a, b;
    for (k = 0; k < pyramid->levels; ++k) {
        conemap__blocks u = conemap__axis_blocks(map->info.width, map->info.wrap_u, i, k, w.low_u, w.high_u);
        conemap__blocks v = conemap__axis_blocks(map->info.height, map->info.wrap_v, j, k, w.low_v, w.high_v);
        if (seen_low_u <= w.low_u && seen_high_u >= w.high_u && seen_low_v <= w.low_v && seen_high_v >= w.high_v)
            break;
        for (b = 0; b < 3; ++b)
            for (a = 0; a < 3; ++a) {
                int unseen_u = 0, unseen_v = 0, has_u, has_v;
                float dh, slope = 0.0f;
                if ((a == 1 && b == 1) || u.low[a] > u.high[a] || v.low[b] > v.high[b]) continue;
                dh = conemap__block_max(pyramid, k, u.node[a], v.node[b]) - apex;
                if (!(dh > 0.0f)) continue;
                has_u = conemap__nearest_unseen(&u, a, seen_low_u, seen_high_u, &unseen_u);
                has_v = conemap__nearest_unseen(&v, b, seen_low_v, seen_high_v, &unseen_v);
                if (improved && !has_u && !has_v) continue;
                if (center) {
                    slope = conemap__slope2(map, dh, a == 1 ? 0.0f : u.center[a], b == 1 ? 0.0f : v.center[b]);
                } else if (!improved) {
                    slope = conemap__slope2(map, dh, (float)conemap__nearest(&u, a),
                                            (float)conemap__nearest(&v, b));
                } else {
                    if (has_u)
                        slope = conemap__slope2(map, dh, (float)unseen_u, (float)conemap__nearest(&v, b));
                    if (has_v)
                        slope = conemap__max(slope, conemap__slope2(map, dh, (float)conemap__nearest(&u, a),
                                                                    (float)unseen_v));
                }
                s = conemap__max(s, slope);
            }
        seen_low_u = u.low[0] <= u.high[0] ? u.low[0] : u.low[1];
        seen_high_u = u.low[2] <= u.high[2] ? u.high[2] : u.high[1];
        seen_low_v = v.low[0] <= v.high[0] ? v.low[0] : v.low[1];
        seen_high_v = v.low[2] <= v.high[2] ? v.high[2] : v.high[1];
    }
    return s;
}

/* 1 / sqrt(s), at most max_tan, and less 2^-20 of itself. The errors of texel_u, the products, the sum, the
   quotient, the root and the division add up to less than 10 * 2^-24 of the tangent, so the result is never wider
   than the true cone. */
CONEMAP__INLINE float conemap__tangent(const conemap_map *map, float s) {
    return conemap__min(1.0f / sqrtf(s) * 0.99999904632568359375f, map->info.max_tan);
}

static float conemap__generate(const conemap_map *map, conemap__search *search, int i, int j) {
    switch (map->info.generator) {
    case CONEMAP_RING: return conemap__tangent(map, conemap__ring(map, CONEMAP_RING, i, j));
    case CONEMAP_QUICK_NAIVE: return conemap__tangent(map, conemap__quick(map, i, j, 0, 0));
    case CONEMAP_QUICK_NAIVE_CENTER: return conemap__tangent(map, conemap__quick(map, i, j, 0, 1));
    case CONEMAP_QUICK_CENTER: return conemap__tangent(map, conemap__quick(map, i, j, 1, 1));
    case CONEMAP_RELAXED: return conemap__tangent(map, conemap__ring(map, CONEMAP_RELAXED, i, j));
    case CONEMAP_RELAXED_SAMPLED:
        return conemap__tangent(map, conemap__ring(map, CONEMAP_RELAXED_SAMPLED, i, j));
    case CONEMAP_HYBRID: {
        /* [CHRS17] puts a cone between the conservative and the relaxed one; the weight says where. */
        float narrow = conemap__tangent(map, conemap__ring(map, CONEMAP_RING, i, j));
        float wide = conemap__tangent(map, conemap__ring(map, CONEMAP_RELAXED, i, j));
        return conemap__max(narrow, conemap__min(narrow + (wide - narrow) * map->build.desc.hybrid_weight, wide));
    }
    case CONEMAP_QUICK: return conemap__tangent(map, conemap__quick(map, i, j, 1, 0));
    default: {
        float s = conemap__exact(map, search, i, j, map->build.least_slope2);
        return conemap__tangent(map, conemap__max(s, search->folded));
    }
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
      sampler's few last bits: below 2^-16, which conemap__safe_tangent takes off. */

#define CONEMAP__BAND 16      /* rows of a cone job */
#define CONEMAP__LONGEST 8.0f /* texels longer than this count as so long */
#define CONEMAP__TOLERANCE 0.1f /* V / D^2 from which a bound counts as tight: at most 5.4 % above the supremum */

/* A band of rows in which slopes are collected: its own rows, and one above and one below, which other bands own too
   and conemap__merged_slope2 brings together. So jobs share nothing. */
typedef struct conemap__band {
    const conemap_map *map;
    int y0, y1;
    int reach;                  /* what vertex (i, j) finds concerns (i - 1..i + reach, ...): 1 for texels, 0 for cells */
    float a, b, deflate;        /* texel size; V */
    int close_u, close_v;       /* how many texels away D^2 - V may mean little; 0: nowhere */
    float *rows[CONEMAP__BAND + 2];
    float *folds[CONEMAP__BAND + 2]; /* with slack: bounds that were folded in, apart from the slopes, for pruning
                                        against them would let slack upon slack grow */
} conemap__band;

/* Heights at any whole coordinates, cells by their lower corner; an axis of one texel has one cell, constant across. */
CONEMAP__INLINE float conemap__vertex(const conemap_map *map, int i, int j) {
    return conemap__height(map, conemap__texel_index(i, map->info.width, map->info.wrap_u),
                           conemap__texel_index(j, map->info.height, map->info.wrap_v));
}

CONEMAP__INLINE int conemap__inner_cell(int i, int size, conemap_wrap wrap) {
    return wrap == CONEMAP_WRAP || (i >= 0 && i < conemap__maxi(size - 1, 1));
}

CONEMAP__INLINE int conemap__cell_exists(const conemap_map *map, int i, int j) {
    return conemap__inner_cell(i, map->info.width, map->info.wrap_u) &&
           conemap__inner_cell(j, map->info.height, map->info.wrap_v);
}

/* Where the band keeps texel (i, j); null for what is not on the map. j is at most one row outside the band. */
CONEMAP__INLINE float *conemap__slope_at(const conemap__band *band, float *const *rows, int i, int j) {
    const conemap_info *info = &band->map->info;
    if (info->wrap_u == CONEMAP_WRAP) i = i < 0 ? i + info->width : i >= info->width ? i - info->width : i;
    if (i < 0 || i >= info->width || (info->wrap_v != CONEMAP_WRAP && (j < 0 || j >= info->height))) return NULL;
    return &rows[j - (band->y0 - 1)][i];
}

CONEMAP__INLINE void conemap__raise(const conemap__band *band, float *const *rows, int i0, int i1, int j0, int j1,
                                    float slope2) {
    int i, j;
    for (j = j0; j <= j1; ++j)
        for (i = i0; i <= i1; ++i) {
            float *at = conemap__slope_at(band, rows, i, j);
            if (at && *at < slope2) *at = slope2;
        }
}

CONEMAP__INLINE float conemap__least(const conemap__band *band, int i0, int i1, int j0, int j1) {
    float least = CONEMAP__FAR;
    int i, j;
    for (j = j0; j <= j1; ++j)
        for (i = i0; i <= i1; ++i) {
            const float *at = conemap__slope_at(band, band->rows, i, j);
            if (at) least = conemap__min(least, *at);
        }
    return least;
}

/* Slope along an axis whose texels may have no length. */
CONEMAP__INLINE float conemap__over(float rise, float length) { return length > 0.0f ? rise / length : 0.0f; }

/* Step 2: the square of the longest gradient in cell (i, j). */
static float conemap__own_slope2(const conemap__band *band, int i, int j) {
    conemap__corners h = conemap__gather(band->map->heights, conemap__cell_quad(band->map, i, j));
    float x0 = h.h10 - h.h00, x1 = h.h11 - h.h01, y0 = h.h01 - h.h00, y1 = h.h11 - h.h10;
    float x = conemap__over(conemap__max(conemap__max(x0, -x0), conemap__max(x1, -x1)), band->a);
    float y = conemap__over(conemap__max(conemap__max(y0, -y0), conemap__max(y1, -y1)), band->b);
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

/* The cells of u as one of them, (i, j), is seen from vertex v: concerns the cell's own corners. */
static void conemap__raise_seen_cell(const conemap__band *band, int i, int j, int vi, int vj) {
    float least = conemap__least(band, i, i + band->reach, j, j + band->reach);
    float slope2 = conemap__cell_slope2(band, i, j, vi, vj, -1.0f, least);
    if (slope2 > least) conemap__raise(band, band->rows, i, i + band->reach, j, j + band->reach, slope2);
}

/* Step 5, near: vertices u and v, v the higher one. Looks at the cells of v from u, and at the cells of u from v. */
static float conemap__near_pair(const conemap__band *band, int ui, int uj, int vi, int vj, float best) {
    float dh = conemap__vertex(band->map, vi, vj) - conemap__vertex(band->map, ui, uj);
    float bound = conemap__corner_bound(band, dh, vi - ui, vj - uj);
    int k, i, j;
    for (k = 0; k < 4; ++k) {
        i = vi - (k & 1);
        j = vj - (k >> 1);
        if (conemap__cell_exists(band->map, i, j) && !conemap__touches(i, j, ui, uj) &&
            !conemap__outdone(band, i, j, ui, uj, 1.0f, bound))
            best = conemap__cell_slope2(band, i, j, ui, uj, 1.0f, best);
        i = ui - (k & 1);
        j = uj - (k >> 1);
        if (conemap__cell_exists(band->map, i, j) && !conemap__touches(i, j, vi, vj) &&
            !conemap__outdone(band, i, j, vi, vj, -1.0f, bound))
            conemap__raise_seen_cell(band, i, j, vi, vj);
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
            if (conemap__cell_exists(band->map, i + di, j + dj))
                best = conemap__cell_slope2(band, i + di, j + dj, i, j, 1.0f, best);
            /* the mirrored offset: this vertex's cells, seen from the vertex there */
            for (k = 0; k < 4; ++k) {
                int ci = i - (k & 1), cj = j - (k >> 1), vi = ci - di, vj = cj - dj;
                if (!conemap__cell_exists(band->map, ci, cj)) continue;
                if ((band->map->info.wrap_u != CONEMAP_WRAP && (vi < 0 || vi >= band->map->info.width)) ||
                    (band->map->info.wrap_v != CONEMAP_WRAP && (vj < 0 || vj >= band->map->info.height)))
                    continue;
                conemap__raise_seen_cell(band, ci, cj, vi, vj);
            }
        }
    return best;
}

/* Everything that vertex (i, j) sees and that is steeper than what its 3x3 texels have already. */
static void conemap__safe_vertex(const conemap__band *band, int i, int j, conemap__search *search) {
    int k, r = band->reach;
    float least = conemap__least(band, i - 1, i + r, j - 1, j + r), best = least;
    for (k = 0; k < 4; ++k) {
        int si = k & 1 ? 1 : -1, sj = k & 2 ? 1 : -1;
        if (conemap__cell_exists(band->map, conemap__mini(i, i + si), conemap__mini(j, j + sj)))
            best = conemap__max(best, conemap__corner_slope2(band, i, j, si, sj));
    }
    if (band->close_u || band->close_v) best = conemap__close_pairs(band, i, j, best);
    best = conemap__exact(band->map, search, i, j, best);
    if (best > least) conemap__raise(band, band->rows, i - 1, i + r, j - 1, j + r, best);
    if (search->folded > best) conemap__raise(band, band->folds, i - 1, i + r, j - 1, j + r, search->folded);
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
static float conemap__relaxed_near(const conemap__band *band, int i, int j, float near2, float best) {
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
                        conemap__raise_seen_cell(band, p, q, x + (c & 1), y + (c >> 1));
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

static void conemap__relaxed_vertex(const conemap__band *band, int i, int j, float near2) {
    float least = conemap__least(band, i - 1, i + 1, j - 1, j + 1);
    float best = conemap__relaxed_near(band, i, j, near2, least);
    best = band->map->info.generator == CONEMAP_RELAXED_EXACT ? conemap__relaxed_search(band, i, j, near2, best)
                                                              : conemap__relaxed_ring(band, i, j, near2, best);
    if (best > least) conemap__raise(band, band->rows, i - 1, i + 1, j - 1, j + 1, best);
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

/* Correction and cells at a border need their neighbours as they were, an update the cones that it leaves alone;
   otherwise they are worked on in place. */
static int conemap__needs_plane(const conemap_map *map) {
    return map->build.updating || map->info.texture.per_cell || (map->info.min3x3 && !conemap__is_bilinear(&map->info));
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
    return CONEMAP__KNOWN(texture->format, CONEMAP_FORMAT_COUNT) &&
                   CONEMAP__KNOWN(texture->encoding, CONEMAP_ENCODING_COUNT) &&
                   CONEMAP__KNOWN(texture->layout, CONEMAP_LAYOUT_COUNT)
               ? CONEMAP_OK
               : CONEMAP_ERROR_ENUM;
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
    size_t texels = (size_t)w * (size_t)h, memory = 0, scratch = 0, job_count = 0;
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
    if (!conemap__add_size(&memory, texels, sizeof(float)) || !conemap__add_size(&memory, texels, sizeof(float)))
        return CONEMAP_ERROR_OVERFLOW;
    strips = (h + CONEMAP__STRIP - 1) / CONEMAP__STRIP;
    jobs[CONEMAP__PASS_DECODE] = strips;
    jobs[CONEMAP__PASS_CONES] = bands;
    jobs[CONEMAP__PASS_STORE] = bands;
    if (desc->keep_pyramid) {
        int cells_u = conemap__cell_count(w, desc->wrap_u), cells_v = conemap__cell_count(h, desc->wrap_v);
        if (!conemap__pyramid_plan(&map->cells, cells_u, cells_v, 1, &memory)) return CONEMAP_ERROR_OVERFLOW;
        jobs[CONEMAP__PASS_CELLS] = (cells_v + CONEMAP__STRIP - 1) / CONEMAP__STRIP;
        jobs[CONEMAP__PASS_CELLS_TOP] = 1;
    }
    if (conemap__needs_pyramid(desc->generator)) {
        if (!conemap__pyramid_plan(&map->build.texels, w, h, 0, &scratch)) return CONEMAP_ERROR_OVERFLOW;
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
        if (!conemap__add_size(&scratch, 2 * (size_t)bands * (size_t)w, sizeof(float)) ||
            (desc->slack > 0.0f && !conemap__add_size(&scratch, texels + 2 * (size_t)bands * (size_t)w, sizeof(float))))
            return CONEMAP_ERROR_OVERFLOW;
    }
    if (conemap__needs_plane(map) && !conemap__add_size(&scratch, texels, sizeof(float)))
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
    size_t texels = conemap__texels(map);
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
    map->cones = map->build.cones = (float *)conemap__cut(&cursor, texels, sizeof(float));
    conemap__cut_pyramid(&map->cells, 1, &cursor);
    if (scratch_size > 0) {
        cursor = (unsigned char *)map->build.scratch;
        conemap__cut_pyramid(&map->build.texels, 0, &cursor);
        for (q = 0; q < 4; ++q) conemap__cut_pyramid(&map->build.falling[q], 0, &cursor);
        if (conemap__is_bilinear(&map->info)) {
            size_t rims = 2 * (size_t)map->build.pass_jobs[CONEMAP__PASS_CONES] * (size_t)map->info.width;
            map->build.rims = (float *)conemap__cut(&cursor, rims, sizeof(float));
            if (desc->slack > 0.0f) map->build.folds = (float *)conemap__cut(&cursor, texels + rims, sizeof(float));
        }
        map->build.plane =
            conemap__needs_plane(map) ? (float *)conemap__cut(&cursor, texels, sizeof(float)) : map->build.cones;
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

enum { CONEMAP__SEARCH = 1, CONEMAP__STORE = 2 }; /* what an update does with a texel; a build does both with all */

CONEMAP__INLINE int conemap__is_wanted(const conemap_map *map, int x, int y, int what) {
    return !map->build.wanted || (map->build.wanted[(size_t)y * (size_t)map->info.width + (size_t)x] & what);
}

/* Tells the host how far the build is: almost all of the work is in the cones. */
static conemap_result conemap__report(const conemap_map *map, int pass, double done_rows) {
    const conemap_desc *desc = &map->build.desc;
    double cones = done_rows / (double)map->info.height, done;
    if (!desc->progress) return CONEMAP_OK;
    done = pass < CONEMAP__PASS_CONES    ? 0.01 * (double)(pass + 1)
           : pass == CONEMAP__PASS_CONES ? 0.04 + 0.92 * cones
                                         : 0.96 + 0.01 * (double)(pass - CONEMAP__PASS_CONES);
    return desc->progress(done, desc->progress_user) ? CONEMAP_CANCELLED : CONEMAP_OK;
}

static conemap_result conemap__cone_rows(conemap_map *map, int y0, int y1) {
    conemap__search search = conemap__make_search(map);
    int x, y, w = map->info.width;
    search.best_j = y0;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < w; ++x) {
            if (!conemap__is_wanted(map, x, y, CONEMAP__SEARCH)) continue;
            map->build.plane[(size_t)y * (size_t)w + (size_t)x] = conemap__generate(map, &search, x, y);
            if (x % 256 == 255 || x == w - 1) { /* a single row of a slow generator can take seconds */
                conemap_result result =
                    conemap__report(map, CONEMAP__PASS_CONES, (double)y + (double)(x + 1) / (double)w);
                if (result != CONEMAP_OK) return result;
            }
        }
    return CONEMAP_OK;
}

/* The band of a job, its rows in the plane and in the rims. */
static conemap__band conemap__make_band(const conemap_map *map, int job) {
    conemap__band band;
    size_t w = (size_t)map->info.width;
    int y;
    float a = map->build.search_u, b = map->build.search_v;
    memset(&band, 0, sizeof band);
    band.map = map;
    band.reach = !map->info.texture.per_cell;
    band.y0 = job * CONEMAP__BAND;
    band.y1 = conemap__mini(band.y0 + CONEMAP__BAND, map->info.height);
    band.a = a;
    band.b = b;
    band.deflate = 0.25f * (a * a + b * b);
    if (a > 0.0f && b > 0.0f && 1.55f * band.deflate > conemap__min(a, b) * conemap__min(a, b)) {
        band.close_u = (int)(sqrtf(1.6f * band.deflate) / a) + 1;
        band.close_v = (int)(sqrtf(1.6f * band.deflate) / b) + 1;
    }
    for (y = band.y0 - 1; y <= band.y1; ++y) {
        size_t rim = (2 * (size_t)job + (y == band.y1)) * w, row = (size_t)conemap__maxi(y, 0) * w;
        int outside = y < band.y0 || y >= band.y1, k = y - (band.y0 - 1);
        band.rows[k] = outside ? map->build.rims + rim : map->build.plane + row;
        if (map->build.folds)
            band.folds[k] = outside ? map->build.folds + conemap__texels(map) + rim : map->build.folds + row;
    }
    return band;
}

static conemap_result conemap__safe_band(const conemap_map *map, int job) {
    conemap__band band = conemap__make_band(map, job);
    conemap__search search = conemap__make_search(map);
    float least = map->build.least_slope2 * (1.0f - 1.0f / 16384.0f); /* so that step 8's margin leaves max_tan whole */
    int x, y, w = map->info.width, relaxed = map->info.guarantee == CONEMAP_GUARANTEE_RELAXED_BILINEAR;
    search.band = &band;
    search.deflate = band.deflate;
    search.near2 = band.deflate / CONEMAP__TOLERANCE;
    for (y = band.y0 - 1; y <= band.y1; ++y)
        for (x = 0; x < w; ++x) {
            band.rows[y - (band.y0 - 1)][x] = least;
            if (map->build.folds) band.folds[y - (band.y0 - 1)][x] = 0.0f;
        }
    for (y = band.y0 - 1; y < band.y1; ++y) /* cells that touch the band */
        for (x = map->info.wrap_u == CONEMAP_WRAP ? -1 : 0; x < w; ++x)
            if (conemap__cell_exists(map, x, y))
                conemap__raise(&band, band.rows, x, x + band.reach, y, y + band.reach,
                               relaxed ? conemap__relaxed_own(&band, x, y) : conemap__own_slope2(&band, x, y));
    for (y = band.y0; y < band.y1; ++y)
        for (x = 0; x < w; ++x) {
            if (!conemap__is_wanted(map, x, y, CONEMAP__SEARCH)) continue;
            if (relaxed)
                conemap__relaxed_vertex(&band, x, y, search.near2);
            else
                conemap__safe_vertex(&band, x, y, &search);
            if (x % 256 == 255 || x == w - 1) {
                conemap_result result =
                    conemap__report(map, CONEMAP__PASS_CONES, (double)y + (double)(x + 1) / (double)w);
                if (result != CONEMAP_OK) return result;
            }
        }
    return CONEMAP_OK;
}

/* The rows in which bands noted what concerns row j, in one plane of rows and rims; returns how many, 3 at most. */
static int conemap__merged_rows(const conemap_map *map, const float *plane, const float *rims, int j,
                                const float **rows) {
    int h = map->info.height, bands = (h + CONEMAP__BAND - 1) / CONEMAP__BAND, band = j / CONEMAP__BAND, count = 0;
    size_t w = (size_t)map->info.width;
    int wraps = map->info.wrap_v == CONEMAP_WRAP;
    rows[count++] = plane + (size_t)j * w;
    if (j == band * CONEMAP__BAND && (band > 0 || wraps)) {
        size_t before = (size_t)(band > 0 ? band - 1 : bands - 1);
        rows[count++] = rims + (2 * before + 1) * w;
    }
    if (j == conemap__mini((band + 1) * CONEMAP__BAND, h) - 1 && (band < bands - 1 || wraps)) {
        size_t after = (size_t)(band < bands - 1 ? band + 1 : 0);
        rows[count++] = rims + 2 * after * w;
    }
    return count;
}

#define CONEMAP__RUN 256 /* texels worked on at a time, on the stack */

/* 1 / sqrt(s) as conemap__tangent, with the margin of step 8. */
static void conemap__safe_tangents(const conemap_map *map, int x, int y, int count, float *tangents) {
    const float *rows[6];
    int w = map->info.width, k, n;
    int last = map->info.texture.per_cell && map->info.wrap_u != CONEMAP_WRAP && x + count == w && w > 1;
    if (map->info.texture.per_cell && map->info.wrap_v != CONEMAP_WRAP)
        y = conemap__mini(y, conemap__maxi(map->info.height - 2, 0));
    n = conemap__merged_rows(map, map->build.plane, map->build.rims, y, rows);
    if (map->build.folds)
        n += conemap__merged_rows(map, map->build.folds, map->build.folds + conemap__texels(map), y, rows + n);
    for (k = 0; k < n; ++k) rows[k] += x;
    conemap__kernels_of(map->isa)->tangent_row(rows, n, 1.0f - 1.0f / 65536.0f, map->info.max_tan, count, tangents);
    if (last) { /* there is one cell less than texels: what lies beyond projects onto the last */
        for (k = 0; k < n; ++k) rows[k] += count - 2;
        conemap__kernels_of(map->isa)->tangent_row(rows, n, 1.0f - 1.0f / 65536.0f, map->info.max_tan, 1,
                                                   tangents + count - 1);
    }
}

static void conemap__store_run(conemap_map *map, int x, int y, int count) {
    const conemap__kernels *kernels = conemap__kernels_of(map->isa);
    float tangents[CONEMAP__RUN], cones[CONEMAP__RUN];
    size_t w = (size_t)map->info.width, at = (size_t)y * w + (size_t)x;
    int k;
    if (map->build.rims) {
        conemap__safe_tangents(map, x, y, count, tangents);
    } else if (map->info.min3x3) { /* [BV24 eq. 2] */
        const float *rows[3];
        for (k = 0; k < 3; ++k)
            rows[k] = map->build.plane +
                      (size_t)conemap__texel_index(y + k - 1, map->info.height, map->info.wrap_v) * w;
        kernels->narrowest_row(rows, map->info.width, map->info.wrap_u == CONEMAP_WRAP, x, count, tangents);
    } else {
        memcpy(tangents, map->build.plane + at, (size_t)count * sizeof(float));
    }
    kernels->store_row(&map->info, map->heights + at, tangents, count, cones);
    for (k = 0; k < count; ++k)
        if (conemap__is_wanted(map, x + k, y, CONEMAP__STORE)) map->build.cones[at + (size_t)k] = cones[k];
}

static void conemap__store_rows(conemap_map *map, int y0, int y1) {
    int x, y;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < map->info.width; x += CONEMAP__RUN)
            conemap__store_run(map, x, y, conemap__mini(CONEMAP__RUN, map->info.width - x));
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
    int h, q;
    if (!map) return CONEMAP_ERROR_NULL;
    if (job < 0 || job >= conemap_job_count(map, pass)) return CONEMAP_ERROR_ORDER;
    h = map->info.height;
    switch (pass) {
    case CONEMAP__PASS_DECODE:
        result = conemap__decode_rows(map, &map->build.desc.heights, job * CONEMAP__STRIP,
                                      conemap__mini((job + 1) * CONEMAP__STRIP, h));
        break;
    case CONEMAP__PASS_STRIPS:
        conemap__pyramid_strip(map, &map->build.texels, job);
        for (q = 0; q < 4; ++q) conemap__pyramid_strip(map, &map->build.falling[q], job);
        break;
    case CONEMAP__PASS_TOP:
        conemap__pyramid_top(map, &map->build.texels);
        for (q = 0; q < 4; ++q) conemap__pyramid_top(map, &map->build.falling[q]);
        break;
    case CONEMAP__PASS_CONES:
        result = map->build.rims ? conemap__safe_band(map, job)
                                 : conemap__cone_rows(map, job * CONEMAP__BAND,
                                                      conemap__mini((job + 1) * CONEMAP__BAND, h));
        break;
    case CONEMAP__PASS_STORE:
        conemap__store_rows(map, job * CONEMAP__BAND, conemap__mini((job + 1) * CONEMAP__BAND, h));
        break;
    case CONEMAP__PASS_CELLS: conemap__pyramid_strip(map, &map->cells, job); break;
    default: conemap__pyramid_top(map, &map->cells); break;
    }
    if (result == CONEMAP_OK && pass != CONEMAP__PASS_CONES) result = conemap__report(map, pass, 0.0);
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
    map->build.plane = map->build.rims = map->build.folds = NULL;
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
static float conemap__slope_floor(const conemap_map *map, size_t at) {
    const conemap_texture *texture = &map->info.texture;
    uint32_t code = conemap__code_near(texture->format, map->cones[at]);
    float next = conemap__value(texture->format, code + 2), tangent;
    if (texture->format != CONEMAP_F32 && texture->format != CONEMAP_F16 && next > 1.0f) next = map->info.max_tan;
    tangent = conemap__finite(next) ? conemap__decode_tan(&map->info, map->heights[at], next) : map->info.max_tan;
    /* near the top a radius says nothing */
    if (texture->encoding == CONEMAP_RADIUS && map->heights[at] > 0.999f) tangent = map->info.max_tan;
    tangent = conemap__min(tangent, map->info.max_tan);
    return tangent > 0.0f ? 1.0f / (tangent * tangent) * (1.0f - 1.0f / 8192.0f) : 0.0f;
}

/* Whole distance, in texels, from `at` to the texels low..high of an axis, or to the images of a wrapping one. */
static int conemap__axis_distance(int at, int low, int high, int size, conemap_wrap wrap) {
    int d = conemap__maxi(0, conemap__maxi(low - at, at - high));
    if (wrap == CONEMAP_WRAP) {
        d = conemap__mini(d, conemap__maxi(0, conemap__maxi(low - size - at, at - (high - size))));
        d = conemap__mini(d, conemap__maxi(0, conemap__maxi(low + size - at, at - (high + size))));
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
   serves its 3x3 texels. */
static void conemap__mark(const conemap_map *map, unsigned char *wanted, int x, int y, int width, int height,
                            float highest) {
    int bilinear = conemap__is_bilinear(&map->info), i, j, a, b, w = map->info.width, h = map->info.height;
    float near2 = 0.0f, deflate = 0.0f;
    size_t at;
    if (bilinear) {
        deflate = 0.25f * (map->build.search_u * map->build.search_u + map->build.search_v * map->build.search_v);
        near2 = deflate / CONEMAP__TOLERANCE;
    }
    for (j = 0; j < h; ++j)
        for (i = 0; i < w; ++i) {
            float du = (float)conemap__maxi(0, conemap__axis_distance(i, x, x + width - 1, w, map->info.wrap_u) - bilinear) *
                       map->build.search_u;
            float dv = (float)conemap__maxi(0, conemap__axis_distance(j, y, y + height - 1, h, map->info.wrap_v) - bilinear) *
                       map->build.search_v;
            float d2 = du * du + dv * dv, rise = highest - map->heights[(size_t)j * (size_t)w + (size_t)i];
            float least = CONEMAP__FAR;
            int hit = d2 <= near2;
            if (!hit && rise <= 0.0f) continue;
            for (b = -bilinear; !hit && b <= bilinear; ++b)
                for (a = -bilinear; a <= bilinear; ++a) {
                    size_t beside = (size_t)conemap__texel_index(j + b, h, map->info.wrap_v) * (size_t)w +
                                    (size_t)conemap__texel_index(i + a, w, map->info.wrap_u);
                    least = conemap__min(least, conemap__slope_floor(map, beside));
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
    size_t memory_size, scratch_size, texels;
    unsigned char *wanted;
    void *buffer = NULL; /* a byte a texel, and the rectangle's new heights until all of them are known to be good */
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
    work.build.allocator = settings.allocator;
    result = conemap__allocate(&work, memory_size, scratch_size);
    if (result == CONEMAP_OK)
        result = conemap__take(&settings.allocator, NULL, 0, texels + (size_t)width * (size_t)height * sizeof(float),
                               &buffer, &k);
    wanted = (unsigned char *)buffer;
    if (result == CONEMAP_OK) {
        unsigned char *cursor = wanted + texels;
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
        memset(wanted, 0, texels);
        highest = conemap__rectangle_max(map, x, y, width, height, 0.0f);
        for (k = 0; k < height; ++k)
            memcpy(work.build.heights + (size_t)(y + k) * (size_t)map->info.width + (size_t)x,
                   wanted + texels + (size_t)k * (size_t)width * sizeof(float), (size_t)width * sizeof(float));
        highest = conemap__rectangle_max(map, x, y, width, height, highest);
        /* Slack depends on the way of the search, and correction on cones that are no longer there: those start afresh. */
        partial = settings.generator == CONEMAP_EXACT && !(settings.slack > 0.0f) && !(settings.min3x3 && !work.build.rims);
        if (partial)
            conemap__mark(&work, wanted, x, y, width, height, highest);
        else
            memset(wanted, CONEMAP__SEARCH | CONEMAP__STORE, texels);
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
   and of the texels, and last the hash of all words before it), then the texels, little-endian, rows touching.
   ====================================================================================================== */

#define CONEMAP__FILE_WORDS 22
#define CONEMAP__FILE_HEADER (8u + 4u * CONEMAP__FILE_WORDS)

static const char conemap__file_magic[8] = {'C', 'O', 'N', 'E', 'M', 'A', 'P', 0};

static int conemap__channels(conemap_layout layout) {
    return layout == CONEMAP_CONE_ONLY ? 1 : layout == CONEMAP_DUMMER ? 4 : 2;
}

static size_t conemap__row_size(const conemap_info *info) {
    return (size_t)info->width * (size_t)conemap__channels(info->texture.layout) *
           conemap__format_size(info->texture.format);
}

CONEMAP__DEF size_t conemap_row_size(const conemap_map *map) {
    return map && map->heights ? conemap__row_size(&map->info) : 0;
}

CONEMAP__DEF size_t conemap_texture_size(const conemap_map *map, size_t row_pitch) {
    size_t row = conemap_row_size(map);
    if (row_pitch == 0) row_pitch = row;
    if (row == 0 || row_pitch < row || row_pitch > SIZE_MAX / (size_t)map->info.height) return 0;
    return row_pitch * (size_t)map->info.height;
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

static void conemap__write_row(const conemap_map *map, int y, unsigned char *bytes) {
    const conemap_texture *texture = &map->info.texture;
    size_t step = conemap__format_size(texture->format);
    int x, c, channels = conemap__channels(texture->layout);
    for (x = 0; x < map->info.width; ++x) {
        size_t at = (size_t)y * (size_t)map->info.width + (size_t)x;
        float values[4];
        c = 0;
        if (texture->layout != CONEMAP_CONE_ONLY) values[c++] = map->heights[at];
        values[c++] = map->cones[at];
        if (texture->layout == CONEMAP_DUMMER) {
            float dv = conemap__difference(map, x, y, 1);
            values[c++] = 0.5f + conemap__difference(map, x, y, 0);
            values[c++] = texture->flip_dv ? 0.5f - dv : 0.5f + dv;
        }
        for (c = 0; c < channels; ++c, bytes += step)
            conemap__write_code(texture->format, bytes, conemap__code_near(texture->format, values[c]));
    }
}

CONEMAP__DEF conemap_result conemap_write_texture(const conemap_map *map, void *pixels, size_t size,
                                                  size_t row_pitch) {
    size_t row, needed;
    int y;
    if (!map || !map->heights || !pixels) return CONEMAP_ERROR_NULL;
    row = conemap_row_size(map);
    if (row_pitch == 0) row_pitch = row;
    if (row_pitch < row) return CONEMAP_ERROR_STRIDE;
    needed = conemap_texture_size(map, row_pitch);
    if (needed == 0) return CONEMAP_ERROR_OVERFLOW;
    needed -= row_pitch - row; /* the last row's padding is never written */
    if (size < needed) return CONEMAP_ERROR_BUFFER;
    for (y = 0; y < map->info.height; ++y)
        conemap__write_row(map, y, (unsigned char *)pixels + (size_t)y * row_pitch);
    return CONEMAP_OK;
}

static uint64_t conemap__hash_bytes(const unsigned char *bytes, size_t size) {
    uint64_t hash = CONEMAP__HASH_START;
    size_t k;
    for (k = 0; k + 4 <= size; k += 4) hash = conemap__hash(hash, conemap__get_word(bytes + k));
    for (; k < size; ++k) hash = conemap__hash(hash, bytes[k]);
    return hash;
}

CONEMAP__DEF size_t conemap_save_size(const conemap_map *map) {
    size_t texels = conemap_texture_size(map, 0);
    return texels == 0 || texels > SIZE_MAX - CONEMAP__FILE_HEADER ? 0 : texels + CONEMAP__FILE_HEADER;
}

CONEMAP__DEF conemap_result conemap_save(const conemap_map *map, void *bytes, size_t size) {
    unsigned char *out = (unsigned char *)bytes, *texels;
    uint32_t words[CONEMAP__FILE_WORDS];
    const conemap_info *info;
    uint64_t data_hash;
    size_t row;
    int k;
    if (!map || !map->heights || !bytes) return CONEMAP_ERROR_NULL;
    if (conemap_save_size(map) == 0) return CONEMAP_ERROR_OVERFLOW;
    if (size < conemap_save_size(map)) return CONEMAP_ERROR_BUFFER;
    info = &map->info;
    texels = out + CONEMAP__FILE_HEADER;
    row = conemap_row_size(map);
    for (k = 0; k < info->height; ++k) {
        conemap__write_row(map, k, texels + (size_t)k * row);
        conemap__swap_row(texels + (size_t)k * row, row, conemap__format_size(info->texture.format));
    }
    data_hash = conemap__hash_bytes(texels, row * (size_t)info->height);
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
    words[17] = (uint32_t)(info->height_hash & 0xffffffffu);
    words[18] = (uint32_t)(info->height_hash >> 32);
    words[19] = (uint32_t)(data_hash & 0xffffffffu);
    words[20] = (uint32_t)(data_hash >> 32);
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
    size_t row;
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
        words[14] > 1 || words[15] > 1)
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
    read.height_hash = (uint64_t)words[18] << 32 | words[17];
    if (!conemap__in_range(read.aspect, 1.0f / 32768.0f, 32768.0f) ||
        !conemap__in_range(read.max_tan, 1.0f / 65536.0f, CONEMAP_TAN_LIMIT) ||
        !conemap__in_range(read.slack, 0.0f, 16.0f) ||
        (read.width == 1 && read.wrap_u == CONEMAP_NOTHING) || (read.height == 1 && read.wrap_v == CONEMAP_NOTHING))
        return CONEMAP_ERROR_FILE_CORRUPT;
    row = conemap__row_size(&read);
    if ((size - CONEMAP__FILE_HEADER) / row < (size_t)read.height) return CONEMAP_ERROR_FILE_TRUNCATED;
    *info = read;
    return CONEMAP_OK;
}

/* Reads the texels of baked bytes into the map's planes; heights only where the bytes hold them. */
static conemap_result conemap__load_texels(conemap_map *map, const unsigned char *texels, int heights_too) {
    const conemap_texture *texture = &map->info.texture;
    int x, y, cone_channel = texture->layout == CONEMAP_CONE_ONLY ? 0 : 1;
    size_t step = conemap__format_size(texture->format), b;
    size_t pixel = step * (size_t)conemap__channels(texture->layout);
    for (y = 0; y < map->info.height; ++y)
        for (x = 0; x < map->info.width; ++x, texels += pixel) {
            size_t at = (size_t)y * (size_t)map->info.width + (size_t)x;
            uint32_t codes[2] = {0, 0};
            int c;
            for (c = 0; c <= cone_channel; ++c)
                for (b = 0; b < step; ++b) codes[c] |= (uint32_t)texels[(size_t)c * step + b] << (8 * b);
            map->build.cones[at] = conemap__value(texture->format, codes[cone_channel]);
            if (!conemap__in_range(map->build.cones[at], 0.0f, CONEMAP_TAN_LIMIT))
                return CONEMAP_ERROR_FILE_CORRUPT;
            if (!heights_too) continue;
            map->build.heights[at] = conemap__value(texture->format, codes[0]);
            if (!conemap__in_range(map->build.heights[at], 0.0f, 1.0f)) return CONEMAP_ERROR_FILE_CORRUPT;
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
    if (conemap__hash_bytes(texels, conemap__row_size(&info) * (size_t)info.height) !=
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

CONEMAP__DEF conemap_result conemap_get_format_numbers(const conemap_texture *texture,
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
    format = (int)texture->format;
    column = texture->layout == CONEMAP_CONE_ONLY ? 0 : texture->layout == CONEMAP_DUMMER ? 2 : 1;
    numbers->channels = conemap__channels(texture->layout);
    numbers->bytes = numbers->channels * (int)conemap__format_size(texture->format);
    numbers->dxgi = dxgi[format][column];
    numbers->vulkan = vulkan[format][column];
    numbers->gl_internal = gl_internal[format][column];
    numbers->gl_format = gl_format[column];
    numbers->gl_type = gl_type[format];
    return CONEMAP_OK;
}

/* ======================================================================================================
   S A M P L E R S
   ====================================================================================================== */

/* Height and cone at (x, y) of 0..1 x 0..1 in a cell, as a shader's texture unit would mix them. */
typedef struct conemap__mix {
    float height, tangent;
} conemap__mix;

CONEMAP__INLINE conemap__mix conemap__sample_cell(const conemap_map *map, conemap__quad quad, float x, float y) {
    conemap__mix mix;
    float cone = map->info.texture.per_cell ? map->cones[quad.at00]
                                            : conemap__bilinear(conemap__gather(map->cones, quad), x, y);
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
    int i, j;
    if (!map || !map->heights || !sample) return CONEMAP_ERROR_NULL;
    if (!conemap__locate(u, map->info.width, map->info.wrap_u, &i, &x) ||
        !conemap__locate(v, map->info.height, map->info.wrap_v, &j, &y))
        return CONEMAP_ERROR_POSITION;
    quad = conemap__cell_quad(map, i, j);
    c = conemap__gather(map->heights, quad);
    mix = conemap__sample_cell(map, quad, x, y);
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

/* The steepest ascent in any direction that leads from p to q, over everything between them. */
static double conemap__steepest(const conemap__proof *proof, const conemap__patch *p, const conemap__patch *q) {
    double x0 = conemap__mind(p->x, q->x), x1 = conemap__maxd(p->x + p->sx, q->x + q->sx);
    double y0 = conemap__mind(p->y, q->y), y1 = conemap__maxd(p->y + p->sy, q->y + q->sy);
    double left = q->x - p->x - p->sx, right = q->x + q->sx - p->x, worst = 0.0;
    double down = q->y - p->y - p->sy, up = q->y + q->sy - p->y;
    int i, j;
    for (j = conemap__mini(p->j, q->j); j <= conemap__maxi(p->j, q->j); ++j)
        for (i = conemap__mini(p->i, q->i); i <= conemap__maxi(p->i, q->i); ++i) {
            conemap__corners c = conemap__gather(proof->map->heights, conemap__cell_quad(proof->map, i, j));
            double u0 = conemap__clamp01(x0 - (double)i), u1 = conemap__clamp01(x1 - (double)i);
            double v0 = conemap__clamp01(y0 - (double)j), v1 = conemap__clamp01(y1 - (double)j);
            double low = (double)c.h10 - (double)c.h00, high = (double)c.h11 - (double)c.h01;
            double rise_left = (double)c.h01 - (double)c.h00, rise_right = (double)c.h11 - (double)c.h10;
            double x = conemap__ascent(low + (high - low) * v0, low + (high - low) * v1, left, right);
            double y = conemap__ascent(rise_left + (rise_right - rise_left) * u0,
                                       rise_left + (rise_right - rise_left) * u1, down, up);
            x = proof->a > 0.0 ? x / proof->a : 0.0;
            y = proof->b > 0.0 ? y / proof->b : 0.0;
            worst = conemap__maxd(worst, x * x + y * y);
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

/* Settles apices p against the surface q, or halves one of them. */
static void conemap__prove(conemap__proof *proof, const conemap__patch *p, const conemap__patch *q, int depth) {
    const conemap_info *info = &proof->map->info;
    double a = proof->a, b = proof->b, aa = a * a, bb = b * b, slack = proof->slack;
    double t = conemap__most4(p->t), low = conemap__least4(p->h), gap = conemap__most4(q->h) - low - slack;
    double reach = gap * t, nx, ny, least2, spread, mixed;
    int i, j, done, spanned, capped;
    conemap__patch first, second;
    if (!(reach > 0.0)) return;
    nx = conemap__maxd(0.0, conemap__maxd(q->x - p->x - p->sx, p->x - q->x - q->sx));
    ny = conemap__maxd(0.0, conemap__maxd(q->y - p->y - p->sy, p->y - q->y - q->sy));
    least2 = nx * nx * aa + ny * ny * bb;
    if (reach * reach <= least2) return; /* (a) */
    if (--proof->work < 0) {
        proof->open = 1;
        return;
    }
    capped = info->texture.encoding == CONEMAP_RADIUS && t >= (double)info->max_tan;
    mixed = capped ? 0.0 : 0.25 * (t - conemap__least4(p->t)) * (conemap__most4(p->h) - low);
    spread = 0.25 * ((p->sx * p->sx + q->sx * q->sx) * aa + (p->sy * p->sy + q->sy * q->sy) * bb);
    done = least2 > 1.25 * spread; /* below that the difference in (b) is all rounding */
    for (i = 0; i < 4; ++i)
        for (j = 0; j < 4; ++j) {
            double dx = q->x + (j & 1 ? q->sx : 0.0) - p->x - (i & 1 ? p->sx : 0.0);
            double dy = q->y + (j & 2 ? q->sy : 0.0) - p->y - (i & 2 ? p->sy : 0.0);
            double d2 = dx * dx * aa + dy * dy * bb, rise = q->h[j] - p->h[i] - slack, side;
            side = (rise - 2.0 * CONEMAP__VERIFY_GRAIN) * p->t[i];
            if (side > 0.0 && side * side > d2) { /* the corner tangents are exact, so this one is real */
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

/* A block of the cells' pyramid and the period that it is seen in. */
typedef struct conemap__seen_block {
    int level, x, y, period_u, period_v;
} conemap__seen_block;

/* Holds a cell of apices against the whole surface, in one pass. */
static void conemap__prove_pass(conemap__proof *proof, const conemap__patch *apices) {
    const conemap_map *map = proof->map;
    const conemap_pyramid *cells = &map->cells;
    conemap__seen_block stack[9 + 4 * 17], block; /* every period's root; three siblings a level wait */
    int count = 0, images_u = map->info.wrap_u == CONEMAP_WRAP && map->info.width > 1;
    int images_v = map->info.wrap_v == CONEMAP_WRAP && map->info.height > 1, k, i = apices->i, j = apices->j;
    double t = conemap__most4(apices->t), low = conemap__least4(apices->h);
    conemap__patch surface;
    for (k = 8; k >= 0; --k) { /* the period itself comes off the stack first */
        static const int period[9] = {0, 0, 0, -1, 1, -1, -1, 1, 1}, other[9] = {0, -1, 1, 0, 0, -1, 1, -1, 1};
        if ((period[k] != 0 && !images_u) || (other[k] != 0 && !images_v)) continue;
        block.level = cells->levels - 1;
        block.x = block.y = 0;
        block.period_u = period[k] * map->info.width;
        block.period_v = other[k] * map->info.height;
        stack[count++] = block;
    }
    while (count > 0 && proof->work > 0) {
        int x0, y0, nu, nv, nearest;
        double highest, reach, du, dv;
        block = stack[--count];
        x0 = (block.x << block.level) + block.period_u;
        y0 = (block.y << block.level) + block.period_v;
        nu = conemap__cells_between(i, x0, x0 + (1 << block.level));
        nv = conemap__cells_between(j, y0, y0 + (1 << block.level));
        if ((images_u && 2 * nu > map->info.width) || (images_v && 2 * nv > map->info.height))
            continue; /* another image of all this is nearer */
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

/* Holds cell (i, j) against the whole surface. First passes that give up early find most witnesses at once, where
   one deep pass would spend its work on the first narrow place. */
static void conemap__prove_cell(conemap__proof *proof, int i, int j) {
    static const int depths[] = {16, 24, 36, CONEMAP__VERIFY_DEPTH};
    conemap__patch apices;
    int pass;
    conemap__whole_patch(proof, i, j, 1, &apices);
    proof->slack = CONEMAP__VERIFY_APEX - CONEMAP__VERIFY_GRAIN;
    proof->found = 0;
    proof->open = 1;
    for (pass = 0; pass < 4 && proof->open; ++pass) {
        proof->depth = depths[pass];
        proof->work = CONEMAP__VERIFY_WORK;
        proof->open = 0;
        conemap__prove_pass(proof, &apices);
    }
    if (proof->found)
        ++proof->report->unsafe;
    else if (proof->open)
        ++proof->report->unproven;
}

static conemap_result conemap__check_verify(const conemap_info *info, const float *heights, const float *cones) {
    size_t count, k;
    if (info->width < 1 || info->height < 1 || info->width > CONEMAP_MAX_SIZE || info->height > CONEMAP_MAX_SIZE)
        return CONEMAP_ERROR_SIZE;
    if (!CONEMAP__KNOWN(info->wrap_u, CONEMAP_WRAP_COUNT) || !CONEMAP__KNOWN(info->wrap_v, CONEMAP_WRAP_COUNT) ||
        conemap__check_texture(&info->texture) != CONEMAP_OK)
        return CONEMAP_ERROR_ENUM;
    if (!conemap__in_range(info->aspect, 1.0f / 32768.0f, 32768.0f) ||
        !conemap__in_range(info->max_tan, 1.0f / 65536.0f, CONEMAP_TAN_LIMIT))
        return CONEMAP_ERROR_PARAMETER;
    if ((size_t)info->width > SIZE_MAX / sizeof(float) / (size_t)info->height) return CONEMAP_ERROR_OVERFLOW;
    count = (size_t)info->width * (size_t)info->height;
    for (k = 0; k < count; ++k) {
        if (!conemap__in_range(heights[k], 0.0f, 1.0f)) return CONEMAP_ERROR_HEIGHT;
        if (!conemap__in_range(cones[k], 0.0f, CONEMAP__FAR)) return CONEMAP_ERROR_PARAMETER;
    }
    return CONEMAP_OK;
}

/* The cells between centres along an axis; one that has no length stands for an axis of one texel. */
static int conemap__inner_cells(int size, conemap_wrap wrap) {
    return wrap == CONEMAP_WRAP ? size : conemap__maxi(1, size - 1);
}

/* The steepest ascent of the whole surface. */
static double conemap__steepest_of_all(const conemap__proof *proof, int cells_u, int cells_v) {
    double rise_u = 0.0, rise_v = 0.0;
    int i, j;
    for (j = 0; j < cells_v; ++j)
        for (i = 0; i < cells_u; ++i) {
            conemap__corners c = conemap__gather(proof->map->heights, conemap__cell_quad(proof->map, i, j));
            double low = (double)c.h10 - (double)c.h00, high = (double)c.h11 - (double)c.h01;
            double left = (double)c.h01 - (double)c.h00, right = (double)c.h11 - (double)c.h10;
            rise_u = conemap__maxd(rise_u, conemap__ascent(low, high, -1.0, 1.0));
            rise_v = conemap__maxd(rise_v, conemap__ascent(left, right, -1.0, 1.0));
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
    double steepest;
    int owns = 0, cells_u, cells_v, i, j;
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
    proof.report = report;
    proof.a = info->width > 1 ? 1.0 / (double)info->width : 0.0;
    proof.b = info->height > 1 ? (double)info->aspect / (double)info->height : 0.0;
    steepest = conemap__steepest_of_all(&proof, cells_u, cells_v);
    for (j = 0; j < cells_v; ++j)
        for (i = 0; i < cells_u; ++i) {
            conemap__patch patch;
            conemap__whole_patch(&proof, i, j, 1, &patch);
            /* (c) for the whole surface; no point of it rises by more than 1. */
            if (conemap__most4(patch.t) * steepest > 1.0 + CONEMAP__VERIFY_APEX - CONEMAP__VERIFY_GRAIN)
                conemap__prove_cell(&proof, i, j);
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
    return conemap__sample_cell(map, conemap__walk_quad(map, walk),
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

/* ======================================================================================================
   P R E P A R A T I O N

   The table. A record belongs to a cell c of the map (the outer half cells of CLAMP have the same texels as their
   neighbours and share theirs) and holds its top, and for each of the four quadrants into which a ray can fly a clear way
   and a slope. Let R_k be the highest point of the square of cells whose corner is c and that reaches k cells beyond c
   along both axes of the quadrant, WRAP's images included. Then
       top >= R_0,   R_clear <= top,   R_k <= top + slope k  for all k >= 1.
   Distances and speeds are counted in cells along the faster axis, so no root is needed.

   Steps. A ray over c that has flown a distance s > 0 along its faster axis has flown no more along the other one, so it
   is over a cell at most ceil(s) cells from c along either. As the surface is continuous, what borders on a cell counts as
   the cell. So the surface under the ray is
       (a) at most top while it is over c;
       (b) at most top for s <= clear;
       (c) at most top + slope (s + 1) for every s, since ceil(s) < s + 1.
   At height z = top + gap, gap > 0, with vertical speed vz and V cells a time, it may therefore go on
       (a) to the border of c, or (b) for clear / V, but in both cases no longer than it stays above top: gap / -vz;
       (c) while gap + vz t >= slope (V t + 1), which is for (gap - slope) / (slope V - vz), or for ever.
   If the farthest of these does not reach the border of c, the cell is entered: its patch is met as conemap__trace_exact
   meets it. Each step leaves a cell behind, so no epsilon and no cap are needed. What is skipped holds nothing of the
   surface, cones play no part, and a ray that begins or ends at or below top is always judged by the patch.

   Rounding. Heights are floats, top a multiple of 2^-16: rise, quotient and product in rise_row are off by less than
   3 2^-24 of themselves; the slope grows by 2^-19 of itself before it is rounded up to its 6 bits, and the ways are whole
   numbers. Between the reaches that 6 bits can tell, all squares up to the next reach count at the lower one. Everything
   along the ray is in doubles. With N the cells that it may cross (2^21 at most, with WRAP; else 2^16), cell borders are met
   at times off by less than 4 2^-53 N cells' worth: on the steepest wall, a height of 1 in one cell, 2^-30 of height. z and gap
   are off by 2^-51, the two times of (b) and (c) by 2^-50 of themselves, at whose ends z is off by no more, as it stays
   in 0..1; slope V - vz cancels only where the ray rises about as fast as the bound, where an error of 2^-52 of either
   term over a time in which z moves by 1 at most is 2^-51 of height. Together far below the 2^-20 of a miss. That a position
   rounds into the next cell too early moves the ray by 2^-30 cells, and never back: the cell is kept as a number that
   only grows. Where a square wraps around the map more than once, it holds everything, and so does the last reach.
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
    uint64_t *table;
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
            int level = (int)(top * 65536.0f);
            look->squares[at] = top;
            look->tops[at] = (float)(conemap__mini(level, 65535) + 1) / 65536.0f;
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
            look->kernels->rise_row(look->row, du, look->tops + at, 1.0f / (float)conemap__reach(code), next, w,
                                    look->slopes + at, look->clear + at);
        }
    }
    for (y = 0; y < h; ++y)
        for (x = 0; x < w; ++x) {
            size_t at = (size_t)y * (size_t)w + (size_t)x;
            uint64_t *record = &look->table[(size_t)(look->flip_v ? h - 1 - y : y) * (size_t)w +
                                            (size_t)(look->flip_u ? w - 1 - x : x)];
            /* rounded up: what it stands for is no less, by 2^-20 at least */
            uint32_t bits = conemap__bits(look->slopes[at] * (1.0f + 1.0f / 524288.0f));
            int slope = (int)((bits + 0x1fffffu) >> 21) - 4 * (127 - 15);
            slope = conemap__maxi(0, conemap__mini(slope, 63));
            if (quadrant == 0) *record = (uint64_t)(look->tops[at] * 65536.0f) - 1u;
            *record |= (uint64_t)(unsigned)(slope | look->clear[at] << 6) << (16 + 12 * quadrant);
        }
}

CONEMAP__DEF size_t conemap_prepare_memory(const conemap_map *map) {
    size_t bytes = 0;
    if (!map || !map->heights ||
        !conemap__add_size(&bytes, (size_t)conemap__table_size(map->info.width, map->info.wrap_u) *
                                       (size_t)conemap__table_size(map->info.height, map->info.wrap_v),
                           sizeof(uint64_t)))
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
    if (prepared->memory_size == 0 || !conemap__add_size(&bytes, cells, 5 * sizeof(float)) ||
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
        prepared->table = look.table = (uint64_t *)prepared->own.memory;
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
                                    int pitch, int texel_pitch) {
    axis->size = (double)size;
    axis->cells = (double)conemap__cell_count(size, wrap);
    axis->first = (double)conemap__first_cell(wrap);
    axis->low = wrap == CONEMAP_NOTHING ? 0.5 / (double)size : 0.0;
    axis->wraps = wrap == CONEMAP_WRAP;
    axis->period = axis->wraps ? (double)size : 0.0;
    axis->per_period = axis->wraps ? 1.0 / (double)size : 0.0;
    axis->last = (double)(table_size - 1);
    axis->pitch = (double)pitch;
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
    f.heights = prepared->map->heights;
    f.stream = *stream;
    conemap__flight_axis_of(&f.axis[0], info->width, info->wrap_u, prepared->width, 1, 1);
    conemap__flight_axis_of(&f.axis[1], info->height, info->wrap_v, prepared->height, prepared->width, info->width);
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

/* What is added to the table's first index for a cell along an axis. */
CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(table_step)(const conemap__flight_axis *axis,
                                                       const conemap__way *way, int at,
                                                       CONEMAP__D cell) {
    CONEMAP__D number = CONEMAP__SUBD(CONEMAP__KERNEL(repeated)(axis, cell), CONEMAP__D1(axis->first));
    number = CONEMAP__MIND(CONEMAP__MAXD(number, CONEMAP__D1(0.0)), CONEMAP__D1(axis->last));
    return CONEMAP__MULD(number, CONEMAP__MULD(CONEMAP__LOADD(way->sign + at), CONEMAP__D1(axis->pitch)));
}

/* When the ray comes to the far border of its cell. */
CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(leave)(const conemap__way *way, int at, CONEMAP__D cell) {
    return CONEMAP__ADDD(CONEMAP__MULD(CONEMAP__ADDD(cell, CONEMAP__D1(1.0)), CONEMAP__LOADD(way->per_v + at)),
                         CONEMAP__LOADD(way->border + at));
}

CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(position)(const conemap__way *way, int at, CONEMAP__D t) {
    return CONEMAP__ADDD(CONEMAP__LOADD(way->p + at), CONEMAP__MULD(CONEMAP__LOADD(way->v + at), t));
}

/* The cell at time t, not before the border at `leave`: one farther at least where that was reached. */
CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(advance)(const conemap__way *way, int at, CONEMAP__D cell,
                                                    CONEMAP__D leave, CONEMAP__D t) {
    CONEMAP__D next = CONEMAP__PICKD(CONEMAP__LED(leave, t), CONEMAP__ADDD(cell, CONEMAP__D1(1.0)), cell);
    return CONEMAP__MAXD(CONEMAP__WHOLE(CONEMAP__KERNEL(position)(way, at, t)), next);
}

CONEMAP__HELPER void CONEMAP__KERNEL(fetch)(const void *base, size_t size, const int32_t *index) {
    const unsigned char *bytes = (const unsigned char *)base;
    int k;
    if (CONEMAP__DLANES == 8) { /* no loop, which the compiler may leave one */
        CONEMAP__PREFETCH(bytes + (size_t)index[0] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[1] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[2] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[3] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[4] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[5] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[6] * size);
        CONEMAP__PREFETCH(bytes + (size_t)index[7] * size);
    } else {
        for (k = 0; k < CONEMAP__DLANES; ++k) CONEMAP__PREFETCH(bytes + (size_t)index[k] * size);
    }
}

/* Notes where the records of the lanes' cells are, and has them fetched while other groups take their turns. */
CONEMAP__HELPER void CONEMAP__KERNEL(aim)(const conemap__flight *f, conemap__block_of_rays *rays, int at, CONEMAP__D i,
                                          CONEMAP__D j) {
    CONEMAP__STOREN(rays->record + at,
                    CONEMAP__ADDD(CONEMAP__LOADD(rays->table_start + at),
                                  CONEMAP__ADDD(CONEMAP__KERNEL(table_step)(&f->axis[0], &rays->way[0], at, i),
                                                CONEMAP__KERNEL(table_step)(&f->axis[1], &rays->way[1], at, j))));
    CONEMAP__KERNEL(fetch)(f->table, sizeof *f->table, rays->record + at);
}

/* The two texels of a cell along an axis, as numbers. */
CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(near_texel)(const conemap__flight_axis *axis,
                                                       const double *lower, CONEMAP__D cell) {
    CONEMAP__D number = CONEMAP__SUBD(CONEMAP__KERNEL(repeated)(axis, cell), CONEMAP__LOADD(lower));
    number = CONEMAP__PICKD(CONEMAP__LTD(number, CONEMAP__D1(0.0)), CONEMAP__D1(axis->before), number);
    return CONEMAP__MIND(number, CONEMAP__D1(axis->last_texel));
}

CONEMAP__HELPER CONEMAP__D CONEMAP__KERNEL(far_texel)(const conemap__flight_axis *axis,
                                                      const double *lower, CONEMAP__D cell) {
    CONEMAP__D number = CONEMAP__ADDD(
        CONEMAP__SUBD(CONEMAP__KERNEL(repeated)(axis, cell), CONEMAP__LOADD(lower)), CONEMAP__D1(1.0));
    return CONEMAP__PICKD(CONEMAP__LTD(CONEMAP__D1(axis->last_texel), number), CONEMAP__D1(axis->after), number);
}

/* The same for the heights of the cells. */
CONEMAP__HELPER void CONEMAP__KERNEL(aim_close)(const conemap__flight *f, conemap__block_of_rays *rays, int at) {
    conemap__way *u = &rays->way[0], *v = &rays->way[1];
    CONEMAP__D i = CONEMAP__LOADD(rays->cell[0] + at), j = CONEMAP__LOADD(rays->cell[1] + at);
    CONEMAP__D pitch_u = CONEMAP__MULD(CONEMAP__LOADD(u->sign + at), CONEMAP__D1(f->axis[0].texel_pitch));
    CONEMAP__D pitch_v = CONEMAP__MULD(CONEMAP__LOADD(v->sign + at), CONEMAP__D1(f->axis[1].texel_pitch));
    CONEMAP__D start = CONEMAP__LOADD(rays->texel_start + at);
    CONEMAP__D i0 = CONEMAP__MULD(CONEMAP__KERNEL(near_texel)(&f->axis[0], rays->lower[0] + at, i), pitch_u);
    CONEMAP__D i1 = CONEMAP__MULD(CONEMAP__KERNEL(far_texel)(&f->axis[0], rays->lower[0] + at, i), pitch_u);
    CONEMAP__D j0 = CONEMAP__ADDD(CONEMAP__MULD(CONEMAP__KERNEL(near_texel)(&f->axis[1], rays->lower[1] + at, j), pitch_v), start);
    CONEMAP__D j1 = CONEMAP__ADDD(CONEMAP__MULD(CONEMAP__KERNEL(far_texel)(&f->axis[1], rays->lower[1] + at, j), pitch_v), start);
    CONEMAP__STOREN(rays->corner[0] + at, CONEMAP__ADDD(j0, i0));
    CONEMAP__STOREN(rays->corner[1] + at, CONEMAP__ADDD(j0, i1));
    CONEMAP__STOREN(rays->corner[2] + at, CONEMAP__ADDD(j1, i0));
    CONEMAP__STOREN(rays->corner[3] + at, CONEMAP__ADDD(j1, i1));
    CONEMAP__KERNEL(fetch)(f->heights, sizeof *f->heights, rays->corner[0] + at);
    CONEMAP__KERNEL(fetch)(f->heights, sizeof *f->heights, rays->corner[2] + at);
}

/* One step by the table for every flying lane of the group at slot `at`; returns the lanes that fly on. */
CONEMAP__HELPER int CONEMAP__KERNEL(fly_on)(const conemap__flight *f, conemap__block_of_rays *rays, int at) {
    conemap__way *u = &rays->way[0], *v = &rays->way[1];
    CONEMAP__D t = CONEMAP__LOADD(rays->t + at), t_end = CONEMAP__LOADD(rays->t_end + at);
    CONEMAP__D i = CONEMAP__LOADD(rays->cell[0] + at), j = CONEMAP__LOADD(rays->cell[1] + at);
    CONEMAP__D vz = CONEMAP__LOADD(rays->vz + at), state = CONEMAP__LOADD(rays->state + at);
    CONEMAP__D major = CONEMAP__LOADD(rays->major + at);
    CONEMAP__L record = CONEMAP__GATHERL(f->table, rays->record + at);
    CONEMAP__L quadrant = CONEMAP__LSHRL(record, CONEMAP__LOADL(rays->shift + at));
    /* top + 2^52 as a double's bits; slope and clear way have a double's exponent and two bits of its fraction */
    CONEMAP__D top = CONEMAP__MULD(
        CONEMAP__SUBD(CONEMAP__BITSD(CONEMAP__LADD(CONEMAP__LAND(record, CONEMAP__L1(65535u)),
                                                   CONEMAP__L1(UINT64_C(0x4330000000000000)))),
                      CONEMAP__D1(4503599627370495.0)),
        CONEMAP__D1(1.0 / 65536.0));
    CONEMAP__D slope = CONEMAP__BITSD(CONEMAP__LADD(CONEMAP__LSHL(CONEMAP__LAND(quadrant, CONEMAP__L1(63u)), 50),
                                                    CONEMAP__L1(UINT64_C(1008) << 52)));
    CONEMAP__D clear = CONEMAP__SUBD(
        CONEMAP__BITSD(CONEMAP__LADD(CONEMAP__LAND(CONEMAP__LSHL(quadrant, 44), CONEMAP__L1(UINT64_C(63) << 50)),
                                     CONEMAP__L1(UINT64_C(1023) << 52))),
        CONEMAP__D1(1.0));
    CONEMAP__D gap = CONEMAP__SUBD(CONEMAP__ADDD(CONEMAP__LOADD(rays->z + at), CONEMAP__MULD(vz, t)), top);
    CONEMAP__D leave_i = CONEMAP__KERNEL(leave)(u, at, i), leave_j = CONEMAP__KERNEL(leave)(v, at, j);
    CONEMAP__D leave = CONEMAP__MAXD(CONEMAP__MIND(leave_i, leave_j), t);
    CONEMAP__D sink = CONEMAP__ADDD(t, CONEMAP__MULD(gap, CONEMAP__LOADD(rays->sink + at)));
    CONEMAP__D cone = CONEMAP__ADDD(
        t, CONEMAP__DIVD(CONEMAP__MAXD(CONEMAP__SUBD(gap, slope), CONEMAP__D1(0.0)),
                         CONEMAP__MAXD(CONEMAP__SUBD(CONEMAP__MULD(major, slope), vz), CONEMAP__D1(1e-290))));
    CONEMAP__D level = CONEMAP__ADDD(t, CONEMAP__MULD(clear, CONEMAP__LOADD(rays->per_major + at)));
    CONEMAP__D stop = CONEMAP__MAXD(cone, CONEMAP__MIND(CONEMAP__MAXD(level, leave), sink));
    CONEMAP__W flies = CONEMAP__LTD(state, CONEMAP__D1(0.5));
    CONEMAP__W passes = CONEMAP__ANDW(flies, CONEMAP__ANDW(CONEMAP__LED(leave, stop),
                                                           CONEMAP__LTD(CONEMAP__D1(0.0), gap)));
    CONEMAP__W goes = CONEMAP__ANDW(passes, CONEMAP__LED(t_end, stop));
    stop = CONEMAP__MIND(stop, t_end);
    CONEMAP__STORED(rays->steps + at, CONEMAP__ADDD(CONEMAP__LOADD(rays->steps + at),
                                                 CONEMAP__PICKD(flies, CONEMAP__D1(1.0), CONEMAP__D1(0.0))));
    i = CONEMAP__PICKD(passes, CONEMAP__KERNEL(advance)(u, at, i, leave_i, stop), i);
    j = CONEMAP__PICKD(passes, CONEMAP__KERNEL(advance)(v, at, j, leave_j, stop), j);
    CONEMAP__KERNEL(aim)(f, rays, at, i, j);
    CONEMAP__STORED(rays->cell[0] + at, i);
    CONEMAP__STORED(rays->cell[1] + at, j);
    CONEMAP__STORED(rays->t + at, CONEMAP__PICKD(passes, stop, t));
    flies = CONEMAP__ANDNOTW(flies, passes);
    state = CONEMAP__PICKD(flies, CONEMAP__D1(CONEMAP__CLOSE), state);
    CONEMAP__STORED(rays->state + at, CONEMAP__PICKD(goes, CONEMAP__D1(CONEMAP__GONE), state));
    return CONEMAP__BITSW(CONEMAP__ANDNOTW(passes, goes));
}

/* Meets every close lane with the patch of its cell, as conemap__walk_hit does; lanes that do not hit fly on. */
CONEMAP__HELPER void CONEMAP__KERNEL(meet)(const conemap__flight *f, conemap__block_of_rays *rays, int at) {
    conemap__way *u = &rays->way[0], *v = &rays->way[1];
    const CONEMAP__D zero = CONEMAP__D1(0.0), never = CONEMAP__D1(1e300);
    CONEMAP__D t = CONEMAP__LOADD(rays->t + at), t_end = CONEMAP__LOADD(rays->t_end + at);
    CONEMAP__D i = CONEMAP__LOADD(rays->cell[0] + at), j = CONEMAP__LOADD(rays->cell[1] + at);
    CONEMAP__D vx = CONEMAP__LOADD(u->v + at), vy = CONEMAP__LOADD(v->v + at), vz = CONEMAP__LOADD(rays->vz + at);
    CONEMAP__D state = CONEMAP__LOADD(rays->state + at);
    CONEMAP__D h00 = CONEMAP__GATHERFD(f->heights, rays->corner[0] + at);
    CONEMAP__D h10 = CONEMAP__GATHERFD(f->heights, rays->corner[1] + at);
    CONEMAP__D h01 = CONEMAP__GATHERFD(f->heights, rays->corner[2] + at);
    CONEMAP__D h11 = CONEMAP__GATHERFD(f->heights, rays->corner[3] + at);
    CONEMAP__D leave_i = CONEMAP__KERNEL(leave)(u, at, i), leave_j = CONEMAP__KERNEL(leave)(v, at, j);
    CONEMAP__D leave = CONEMAP__MAXD(CONEMAP__MIND(leave_i, leave_j), t), end = CONEMAP__MIND(leave, t_end);
    CONEMAP__D x = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(CONEMAP__KERNEL(position)(u, at, t), i));
    CONEMAP__D y = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(CONEMAP__KERNEL(position)(v, at, t), j));
    CONEMAP__D x1 = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(CONEMAP__KERNEL(position)(u, at, end), i));
    CONEMAP__D y1 = CONEMAP__KERNEL(clamp01)(CONEMAP__SUBD(CONEMAP__KERNEL(position)(v, at, end), j));
    CONEMAP__D hx = CONEMAP__SUBD(h10, h00), hy = CONEMAP__SUBD(h01, h00);
    CONEMAP__D hxy = CONEMAP__SUBD(CONEMAP__SUBD(h11, h01), hx);
    CONEMAP__D z = CONEMAP__PICKD(CONEMAP__LED(t_end, t), CONEMAP__LOADD(rays->z_end + at),
                                  CONEMAP__ADDD(CONEMAP__LOADD(rays->z + at), CONEMAP__MULD(vz, t)));
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
    meets = CONEMAP__ORW(meets, inside);
    close = CONEMAP__ANDNOTW(CONEMAP__LTD(CONEMAP__D1(0.5), state), CONEMAP__LTD(CONEMAP__D1(1.5), state));
    CONEMAP__STORED(rays->steps + at, CONEMAP__ADDD(CONEMAP__LOADD(rays->steps + at),
                                                 CONEMAP__PICKD(close, CONEMAP__D1(1.0), zero)));
    CONEMAP__STORED(rays->t + at, CONEMAP__PICKD(close, CONEMAP__PICKD(meets, CONEMAP__ADDD(t, first), end), t));
    meets = CONEMAP__ANDW(close, meets);
    close = CONEMAP__ANDNOTW(close, meets);
    i = CONEMAP__PICKD(CONEMAP__ANDW(close, CONEMAP__LED(leave_i, end)), CONEMAP__ADDD(i, CONEMAP__D1(1.0)), i);
    j = CONEMAP__PICKD(CONEMAP__ANDW(close, CONEMAP__LED(leave_j, end)), CONEMAP__ADDD(j, CONEMAP__D1(1.0)), j);
    CONEMAP__KERNEL(aim)(f, rays, at, i, j);
    CONEMAP__STORED(rays->cell[0] + at, i);
    CONEMAP__STORED(rays->cell[1] + at, j);
    state = CONEMAP__PICKD(meets, CONEMAP__D1(CONEMAP__MET), state);
    ends = CONEMAP__ANDW(close, ends);
    close = CONEMAP__ANDNOTW(close, ends);
    state = CONEMAP__PICKD(ends, CONEMAP__D1(CONEMAP__GONE), state);
    CONEMAP__STORED(rays->state + at, CONEMAP__PICKD(close, CONEMAP__D1(CONEMAP__FLYING), state));
}

/* Narrows [t0, t1] to where a slab is crossed, as conemap__clip; returns the lanes where it is this slab that ends it. */
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

/* Puts the rays on their way along an axis, as conemap__enter_axis, mirrored; returns the lanes that are. */
CONEMAP__HELPER CONEMAP__W CONEMAP__KERNEL(board_axis)(const conemap__flight_axis *axis, conemap__way *way,
                                                       double *to_cell, double *lower, CONEMAP__D position, CONEMAP__D v, CONEMAP__D per_v,
                                                       CONEMAP__W meets) {
    const CONEMAP__D zero = CONEMAP__D1(0.0), one = CONEMAP__D1(1.0);
    CONEMAP__W flip = CONEMAP__LTD(v, zero), moves = CONEMAP__ORW(flip, CONEMAP__LTD(zero, v));
    CONEMAP__D cells = CONEMAP__D1(axis->cells), first = CONEMAP__D1(axis->first), x, cell, place, p;
    position = CONEMAP__PICKD(meets, position, zero);
    if (axis->wraps) {
        CONEMAP__W far = CONEMAP__ORW(CONEMAP__LED(CONEMAP__D1(4503599627370496.0), position),
                                      CONEMAP__LED(position, CONEMAP__D1(-4503599627370496.0)));
        position = CONEMAP__PICKD(far, zero, position);
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
    CONEMAP__STORED(to_cell, cell);
    CONEMAP__STORED(way->p, p);
    CONEMAP__STORED(way->v, CONEMAP__PICKD(meets, v, zero));
    CONEMAP__STORED(way->per_v, CONEMAP__PICKD(meets, per_v, zero));
    CONEMAP__STORED(way->border, CONEMAP__PICKD(CONEMAP__ANDW(moves, meets),
                                                CONEMAP__SUBD(zero, CONEMAP__MULD(p, per_v)),
                                                CONEMAP__D1(CONEMAP__NEVER)));
    CONEMAP__STORED(way->sign, CONEMAP__PICKD(flip, CONEMAP__D1(-1.0), one));
    CONEMAP__STORED(lower, axis->wraps ? CONEMAP__PICKD(flip, one, zero) : first);
    return flip;
}

/* Boards the next rays of the stream, as conemap__enter does one, into the waiting block; invalid ones are answered. */
CONEMAP__FUNCTION void CONEMAP__KERNEL(board)(conemap__flight *f) {
    const CONEMAP__D zero = CONEMAP__D1(0.0), one = CONEMAP__D1(1.0), never = CONEMAP__D1(CONEMAP__NEVER);
    conemap__block_of_rays *rays = f->waiting;
    conemap__stream *stream = &f->stream;
    float columns[8][CONEMAP__DLANES] = {{0}};
    CONEMAP__D o[3], v[3], per_v[3], longest, power, t_min, t0, t1, box0, box1, status, z_out, reach, major;
    CONEMAP__W ends, meets, in_box, flip_u, flip_v;
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
    t_min = CONEMAP__DIVD(CONEMAP__LOADFD(columns[6]), power);
    t1 = CONEMAP__LOADFD(columns[7]);
    box0 = t_min;
    box1 = CONEMAP__PICKD(CONEMAP__LED(t1, zero), never, CONEMAP__DIVD(t1, power));

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

    flip_u = CONEMAP__KERNEL(board_axis)(&f->axis[0], &rays->way[0], rays->cell[0], rays->lower[0],
                                         CONEMAP__ADDD(o[0], CONEMAP__MULD(v[0], t0)), v[0],
                                         per_v[0], meets);
    flip_v = CONEMAP__KERNEL(board_axis)(&f->axis[1], &rays->way[1], rays->cell[1], rays->lower[1],
                                         CONEMAP__ADDD(o[1], CONEMAP__MULD(v[1], t0)), v[1],
                                         per_v[1], meets);
    major = CONEMAP__MAXD(CONEMAP__LOADD(rays->way[0].v), CONEMAP__LOADD(rays->way[1].v));
    CONEMAP__STORED(rays->major, major);
    CONEMAP__STORED(rays->per_major, CONEMAP__PICKD(CONEMAP__LED(major, zero), CONEMAP__D1(1e290),
                                                    CONEMAP__KERNEL(inverse)(major)));
    CONEMAP__STORED(rays->z, CONEMAP__PICKD(
        meets, CONEMAP__KERNEL(clamp01)(CONEMAP__ADDD(o[2], CONEMAP__MULD(v[2], t0))), zero));
    CONEMAP__STORED(rays->vz, v[2]);
    /* A ray that ends on the floor ends at 0 exactly, so that no rounding slips it through flat ground. */
    CONEMAP__STORED(rays->z_end, CONEMAP__PICKD(
        CONEMAP__LTD(zero, z_out), CONEMAP__PICKD(CONEMAP__LTD(v[2], zero), zero, one),
        CONEMAP__KERNEL(clamp01)(CONEMAP__PICKD(meets, CONEMAP__ADDD(o[2], CONEMAP__MULD(v[2], t1)), zero))));
    CONEMAP__STORED(rays->sink, CONEMAP__PICKD(CONEMAP__LTD(v[2], zero), CONEMAP__SUBD(zero, per_v[2]),
                                               CONEMAP__D1(1e290)));
    CONEMAP__STORED(rays->t, zero);
    CONEMAP__STORED(rays->t_end, CONEMAP__PICKD(meets, CONEMAP__SUBD(t1, t0), zero));
    CONEMAP__STORED(rays->steps, zero);
    CONEMAP__STORED(rays->state, CONEMAP__PICKD(meets, CONEMAP__D1(CONEMAP__FLYING), CONEMAP__D1(CONEMAP__GONE)));
    CONEMAP__STORED(rays->t_start, CONEMAP__PICKD(meets, t0, zero));
    CONEMAP__STORED(rays->t_gone, box1);
    CONEMAP__STORED(rays->t_scale, power);
    CONEMAP__STORED(rays->end_status, status);
    CONEMAP__STORED(rays->table_start, CONEMAP__ADDD(
        CONEMAP__PICKD(flip_u, CONEMAP__D1(f->axis[0].last), zero),
        CONEMAP__PICKD(flip_v, CONEMAP__D1(f->axis[1].last * f->axis[1].pitch), zero)));
    CONEMAP__STORED(rays->texel_start, CONEMAP__ADDD(
        CONEMAP__PICKD(flip_u, CONEMAP__D1(f->axis[0].last_texel), zero),
        CONEMAP__PICKD(flip_v, CONEMAP__D1(f->axis[1].last_texel * f->axis[1].texel_pitch), zero)));
    CONEMAP__KERNEL(aim)(f, rays, 0, CONEMAP__LOADD(rays->cell[0]), CONEMAP__LOADD(rays->cell[1]));
    for (k = 0; k < lanes; ++k)
        rays->shift[k] = 16u + (rays->way[0].sign[k] < 0.0 ? 12u : 0u) + (rays->way[1].sign[k] < 0.0 ? 24u : 0u);
}

/* Answers the rays of a group that have arrived and puts waiting ones into their places; returns how many are aboard. */
CONEMAP__HELPER int CONEMAP__KERNEL(change)(conemap__flight *f, conemap__block_of_rays *rays, int at) {
    CONEMAP__D state = CONEMAP__LOADD(rays->state + at);
    int arrived = CONEMAP__BITSW(CONEMAP__LTD(CONEMAP__D1(1.5), state));
    int empty = CONEMAP__BITSW(CONEMAP__LTD(CONEMAP__D1(3.5), state)), aboard = CONEMAP__DLANES, k;
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

/* Groups take turns, so that what one waits for, memory, divisions and branches, is there when its turn comes again: what
   it will read is asked for in the turn before. A group in which half the lanes or fewer fly on has its close lanes meet
   their patches in the next turn, and its arrived rays make room in the one after. */
CONEMAP__FUNCTION void CONEMAP__KERNEL(fly)(conemap__flight *f) {
    enum { FLY, AIM, MEET, CHANGE, DONE };
    int turn[CONEMAP__SLOTS / CONEMAP__DLANES];
    int groups = conemap__mini(CONEMAP__SLOTS / CONEMAP__DLANES, (f->stream.count - 1) / CONEMAP__DLANES + 1);
    int busy = groups, group, k;
    memset(f->blocks, 0, sizeof *f->blocks * (size_t)((groups * CONEMAP__DLANES - 1) / CONEMAP__BLOCK + 1));
    for (k = 0; k < groups * CONEMAP__DLANES; ++k)
        f->blocks[k / CONEMAP__BLOCK].state[k % CONEMAP__BLOCK] = CONEMAP__EMPTY;
    for (group = 0; group < groups; ++group) turn[group] = CHANGE;
    f->waiting_next = f->waiting_count = 0;
    for (group = 0; busy > 0; group = group + 1 < groups ? group + 1 : 0) {
        conemap__block_of_rays *rays = &f->blocks[group * CONEMAP__DLANES / CONEMAP__BLOCK];
        int at = group * CONEMAP__DLANES % CONEMAP__BLOCK;
        if (turn[group] == FLY) {
            int flying = CONEMAP__KERNEL(fly_on)(f, rays, at);
            turn[group] = 2 * conemap__count_bits(flying) <= CONEMAP__DLANES; /* FLY or AIM, without a branch */
        } else if (turn[group] == AIM) {
            CONEMAP__KERNEL(aim_close)(f, rays, at);
            turn[group] = MEET;
        } else if (turn[group] == MEET) {
            CONEMAP__KERNEL(meet)(f, rays, at);
            turn[group] = CHANGE;
        } else if (turn[group] == CHANGE) {
            turn[group] = FLY;
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
#undef CONEMAP__GATHERL
#undef CONEMAP__L
#undef CONEMAP__L1
#undef CONEMAP__LADD
#undef CONEMAP__LAND
#undef CONEMAP__LED
#undef CONEMAP__LOADD
#undef CONEMAP__LOADL
#undef CONEMAP__LSHL
#undef CONEMAP__LOADN
#undef CONEMAP__STOREN
#undef CONEMAP__LOADFD
#undef CONEMAP__FLOORD
#undef CONEMAP__LSUB
#undef CONEMAP__BITSL
#undef CONEMAP__LSHRL
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
