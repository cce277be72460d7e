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
       F R U S T A                 skeletons skinned with relief-mapped conical frusta
     and under CONEMAP_IMPLEMENTATION
       N U M E R I C S             small arithmetic, half floats, checked sizes
       S T O R A G E               texel decoding and encoding, rounding cones down
       P Y R A M I D               maxima over blocks, any size
       G E N E R A T I O N         ring search, exact, quick, relaxed, correction
       S A F E   C O N E S         for the bilinear surface, with the proof; relaxed cones that are safe
       B U I L D   P A S S E S     validation, memory plan, jobs, updates
       F I L E S                   texture and baked bytes
       S A M P L E R S             bilinear cells
       V E R I F I C A T I O N     rectangles of apices against rectangles of the surface
       T R A C E R S               the walk through cells, every tracer, refinement
       F R U S T U M   R A Y S     one frustum: rays, parametrisation, normals, bounds
       F R U S T A                 skinning, the relief's shell, a tree of boxes
       L I C E N C E               at the end of the file

   OPTIONS (define before including)
       CONEMAP_STATIC              every function static: private copies in several source files
       CONEMAP_API                 your own linkage, e.g. __declspec(dllexport)
       CONEMAP_MALLOC(size)        both or neither: replace malloc and free as the default allocator
       CONEMAP_FREE(pointer)

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
   desc: may be null; its allocator, memory and keep_pyramid are used, and its heights, if given, are compared
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
   construction of [BJCW09 eqs. 3-5]. The others are branches: they begin inside the parent, with a normal that `blend` can mix with
   the parent's. Which is which is settled by the joints as built, and stays.

   Limits. At a bent joint of tapered segments the two cuts share one axis only ([BJCW09 section 2.2]; see fit_steps),
   and u agrees exactly at u = 0 alone; elsewhere it is off by about taper times bend. Bends beyond 140 degrees, and
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
        struct conemap__node *tree;
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

static float conemap__half_to_float(uint32_t half) {
    uint32_t sign = (half & 0x8000u) << 16, exponent = (half >> 10) & 31u, mantissa = half & 1023u;
    if (exponent == 0) {
        float tiny = (float)mantissa * (1.0f / 16777216.0f);
        return sign ? -tiny : tiny;
    }
    return conemap__from_bits(sign | (exponent == 31 ? 0x7f800000u : (exponent + 112u) << 23) | mantissa << 13);
}

/* The largest half float at or below x, for 0 <= x <= 65504. */
static uint32_t conemap__half_down(float x) {
    if (x < 1.0f / 16384.0f) return (uint32_t)(x * 16777216.0f);
    return (conemap__bits(x) >> 13) - (112u << 10);
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

CONEMAP__INLINE float conemap__value(conemap_format format, uint32_t code) {
    switch (format) {
    case CONEMAP_F16: return conemap__half_to_float(code);
    case CONEMAP_UNORM16: return (float)code / 65535.0f;
    case CONEMAP_UNORM8: return (float)code / 255.0f;
    default: return conemap__from_bits(code);
    }
}

/* The code of the largest value at or below x, for 0 <= x. Unorm formats hold at most 1. */
static uint32_t conemap__code_down(conemap_format format, float x) {
    uint32_t code;
    switch (format) {
    case CONEMAP_F16: return conemap__half_down(conemap__min(x, 65504.0f));
    case CONEMAP_UNORM16: code = (uint32_t)(conemap__min(x, 1.0f) * 65535.0f); break;
    case CONEMAP_UNORM8: code = (uint32_t)(conemap__min(x, 1.0f) * 255.0f); break;
    default: return conemap__bits(x);
    }
    return code > 0 && conemap__value(format, code) > x ? code - 1 : code; /* the product may round up */
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
        float below = x - conemap__half_to_float(code);
        float above = code < 0x7bffu ? conemap__half_to_float(code + 1) - x : CONEMAP__FAR;
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

/* The widest stored value that decodes to no more than tan: rounding to nearest, as [Dum06] stores, widens. */
static float conemap__store_cone(const conemap_info *info, float height, float tangent) {
    const conemap_texture *texture = &info->texture;
    float value = texture->encoding == CONEMAP_SQRT     ? sqrtf(tangent)
                  : texture->encoding == CONEMAP_RADIUS ? (1.0f - height) * tangent
                                                        : tangent;
    uint32_t code = conemap__code_down(texture->format, value);
    while (code > 0 &&
           conemap__decode_tan(info, height, conemap__value(texture->format, code)) > tangent)
        --code;
    return conemap__value(texture->format, code);
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

/* The narrowest cone of the 3x3 block around a texel [BV24 eq. 2]. */
static float conemap__narrowest(const conemap_map *map, const float *cones, int i, int j) {
    float least = CONEMAP__FAR;
    int a, b;
    for (b = -1; b <= 1; ++b)
        for (a = -1; a <= 1; ++a) {
            int x = conemap__texel_index(i + a, map->info.width, map->info.wrap_u);
            int y = conemap__texel_index(j + b, map->info.height, map->info.wrap_v);
            least = conemap__min(least, cones[(size_t)y * (size_t)map->info.width + (size_t)x]);
        }
    return least;
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
        !CONEMAP__KNOWN(desc->generator, CONEMAP_GENERATOR_COUNT))
        return CONEMAP_ERROR_ENUM;
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

/* Reads a row of the caller's heights as the texture will hold them. */
static conemap_result conemap__decode_row(const conemap_info *info, const conemap_heights *h, int y, float *row) {
    const unsigned char *bytes = (const unsigned char *)h->pixels + (ptrdiff_t)y * h->row_stride;
    int x;
    for (x = 0; x < h->width; ++x, bytes += h->pixel_stride) {
        float value = conemap__value(h->format, conemap__read_code(h->format, bytes));
        if (!conemap__in_range(value, 0.0f, 1.0f)) return CONEMAP_ERROR_HEIGHT;
        value = h->is_depth ? 1.0f - value : value + 0.0f; /* -0 becomes 0 */
        if (info->texture.layout != CONEMAP_CONE_ONLY)
            value = conemap__value(info->texture.format, conemap__code_near(info->texture.format, value));
        row[x] = value;
    }
    return CONEMAP_OK;
}

static conemap_result conemap__decode_rows(conemap_map *map, const conemap_heights *h, int y0, int y1) {
    conemap_result result = CONEMAP_OK;
    int y;
    for (y = y0; y < y1 && result == CONEMAP_OK; ++y)
        result = conemap__decode_row(&map->info, h, y, map->build.heights + (size_t)y * (size_t)map->info.width);
    return result;
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

/* A texel's steepest slope over the bands that saw it: in one plane of rows and rims. */
static float conemap__merged_slope2(const conemap_map *map, const float *plane, const float *rims, int i, int j) {
    int h = map->info.height, bands = (h + CONEMAP__BAND - 1) / CONEMAP__BAND, band = j / CONEMAP__BAND;
    size_t w = (size_t)map->info.width, x = (size_t)i;
    int wraps = map->info.wrap_v == CONEMAP_WRAP;
    float slope2 = plane[(size_t)j * w + x];
    if (j == band * CONEMAP__BAND && (band > 0 || wraps)) {
        size_t before = (size_t)(band > 0 ? band - 1 : bands - 1);
        slope2 = conemap__max(slope2, rims[(2 * before + 1) * w + x]);
    }
    if (j == conemap__mini((band + 1) * CONEMAP__BAND, h) - 1 && (band < bands - 1 || wraps)) {
        size_t after = (size_t)(band < bands - 1 ? band + 1 : 0);
        slope2 = conemap__max(slope2, rims[2 * after * w + x]);
    }
    return slope2;
}

/* 1 / sqrt(s) as conemap__tangent, with the margin of step 8. */
static float conemap__safe_tangent(const conemap_map *map, int i, int j) {
    float slope2;
    if (map->info.texture.per_cell) { /* there is one cell less than texels: what lies beyond projects onto the last */
        if (map->info.wrap_u != CONEMAP_WRAP) i = conemap__mini(i, conemap__maxi(map->info.width - 2, 0));
        if (map->info.wrap_v != CONEMAP_WRAP) j = conemap__mini(j, conemap__maxi(map->info.height - 2, 0));
    }
    slope2 = conemap__merged_slope2(map, map->build.plane, map->build.rims, i, j);
    if (map->build.folds)
        slope2 = conemap__max(slope2, conemap__merged_slope2(map, map->build.folds,
                                                             map->build.folds + conemap__texels(map), i, j));
    return conemap__min(1.0f / sqrtf(slope2) * (1.0f - 1.0f / 65536.0f), map->info.max_tan);
}

static void conemap__store_rows(conemap_map *map, int y0, int y1) {
    int x, y;
    for (y = y0; y < y1; ++y)
        for (x = 0; x < map->info.width; ++x) {
            size_t at = (size_t)y * (size_t)map->info.width + (size_t)x;
            float tangent;
            if (!conemap__is_wanted(map, x, y, CONEMAP__STORE)) continue;
            tangent = map->build.rims    ? conemap__safe_tangent(map, x, y)
                      : map->info.min3x3 ? conemap__narrowest(map, map->build.plane, x, y)
                                         : map->build.plane[at];
            map->build.cones[at] = conemap__store_cone(&map->info, map->heights[at], tangent);
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
            result = conemap__decode_row(&work.info, &rectangle, k, work.build.plane);
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
typedef struct conemap__node {
    float low[3], high[3];
    int count; /* frusta of a leaf; 0: an inner node */
    int next;  /* a leaf's first place in `leaves`; an inner node's second child */
} conemap__node;

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
static double conemap__reach(const float *plane, conemap__cone inner, int high) {
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
        double y = conemap__reach(tk < 0.0 ? f->upper : f->lower, conemap__cone_at(f, 0.0), tk < 0.0);
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
        conemap__node *node = &skeleton->build.tree[i];
        int count = node->count ? node->count : 2;
        for (j = 0; j < count; ++j) {
            const conemap__node *child = j ? &skeleton->build.tree[node->next] : node + 1;
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
        !conemap__add_size(&size, 2 * count, sizeof(conemap__node)) ||
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
        conemap__node *node = &skeleton->build.tree[at];
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
    skeleton->build.tree = (conemap__node *)conemap__cut(&cursor, 2 * count, sizeof(conemap__node));
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
    return conemap__sample_cell(map, quad, (float)x, (float)y);
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
        double low = (double)f->t + (double)f->tk * conemap__reach(f->lower, outer, 0);
        double high = (double)f->t + (double)f->tk * conemap__reach(f->upper, outer, 1);
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
CONEMAP__INLINE double conemap__enter_box(const conemap__node *node, const conemap__world_ray *ray,
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
    const conemap__node *tree = skeleton->build.tree;
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
        const conemap__node *node = &tree[stack[--depth].node];
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
#undef CONEMAP__STEEPEST
#undef CONEMAP__CONE_ROOM
#undef CONEMAP__FOLD
#undef CONEMAP__FARTHEST
#undef CONEMAP__LEAF
#undef CONEMAP__CHAIN

#endif /* CONEMAP_IMPLEMENTATION */

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
