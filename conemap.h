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
       S H A D E R S               the tracers as GLSL, HLSL and C
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
       E M I T T E R               shaders from snippets
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
   S H A D E R S

   The tracers as text, in the dialect of the host's shaders, holding only what was asked for. Each algorithm is
   written once, in words that all dialects share; the C that the tests run is the same text.

       conemap_shader_desc shader = {0};            // GLSL 330, exact tracer, functions to paste
       shader.dialect = CONEMAP_HLSL_50;
       shader.map = map.info;                       // wrap, format, encoding, layout, guarantee, aspect
       conemap_emit(&shader, NULL, 0, &size);       // the bytes that are needed
       conemap_emit(&shader, text, size, NULL);     // the text, closed by a zero

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
    CONEMAP_FILTER_GATHER,       /* one gather per channel, the same bits. Not GLSL 330 and ES 300; the sampler wraps
                                    as the map does (edge for CLAMP and NOTHING) */
    CONEMAP_FILTER_HARDWARE,     /* the texture unit's own filter: fast, 8-bit weights. Not for EXACT, MAXMIP, QDM */
    CONEMAP_FILTER_COUNT
} conemap_filter;

typedef enum conemap_precision { /* of floats in ES */
    CONEMAP_HIGHP = 0,
    CONEMAP_MEDIUMP,             /* may be 16 bit: none of the guarantees, maps of a few hundred texels at most */
    CONEMAP_PRECISION_COUNT
} conemap_precision;

typedef struct conemap_shader_desc {
    conemap_dialect dialect;
    conemap_stage stage;
    conemap_trace_desc trace;  /* as on the CPU, with bounded loops: max_steps 0: LINEAR 200, LOOP 20, others as many as a
                                  ray can need that does not wrap, and 16 times that if it does. any_hit: EXACT and
                                  MAXMIP; the function is then `bool conemap_any_hit(...)` */
    conemap_info map;          /* what the texture holds: a built map's info, or zero: clamped, (height, tan), f32,
                                  bilinear guarantee, aspect 1, max_tan 1. generator, slack and hash don't matter */
    int fixed_size;            /* nonzero: map.width and map.height are written as constants */
    conemap_filter filter;
    int sectors;               /* cones per texel by direction; 0 and 1: one. 4 and 8 are reserved: sector s of N is
                                  chosen by the signs of the direction, counted 0..N - 1 */

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
    const char *map_name;      /* textures and sampler; null: prefix_map, prefix_heights, prefix_maxima, prefix_sampler */
    const char *heights_name;  /* CONE_ONLY: the host's heights, in the first channel */
    const char *maxima_name;   /* MAXMIP, QDM: see conemap_write_maxima */
    const char *sampler_name;  /* HLSL, with GATHER and HARDWARE */
    const char *fetch;         /* null: from the textures; or a function of the host, which gets whole texels inside the
                                  map, `vec2 NAME(int i, int j)`, or with HARDWARE `vec2 NAME(float u, float v)`: height and
                                  stored cone; without cones (LINEAR, MAXMIP, QDM) `float NAME(...)`. Plus slice with
                                  array. Not with GATHER; with HARDWARE not per_cell */
    const char *fetch_maxima;  /* MAXMIP, QDM: the same for the maxima, `float NAME(int i, int j, int level)` */
    unsigned flags;            /* reserved for effects and frusta; 0 */
} conemap_shader_desc;

/* Writes a shader.
   text: receives the text and a closing zero, `capacity` bytes at most; null: only the size is asked for.
   size: if not null, receives the bytes needed, the zero included, whenever the desc is valid.
   Errors, all without a byte written: NULL (desc, or both pointers); BUFFER (capacity below the size); ENUM; PARAMETER (a
   number out of range; a name that is no identifier, equals another or is a word of the text itself); UNSUPPORTED (the
   dialect lacks it, or two options exclude each other). The same desc gives the same text. Thread-safe, allocates nothing. */
CONEMAP_API conemap_result conemap_emit(const conemap_shader_desc *desc, char *text, size_t capacity, size_t *size);

/* The texture that MAXMIP and QDM read: maxima over bilinear cells, a square of 2^n texels, n levels below it.
   conemap_maxima_levels returns n + 1 (0: no map); level k has 2^(n - k) texels on a side. conemap_write_maxima writes
   one level as f32, rows touching; blocks beyond the map hold 0. The map must have been built with keep_pyramid. Errors:
   NULL, NO_PYRAMID, PARAMETER (level), BUFFER. */
CONEMAP_API int conemap_maxima_levels(const conemap_map *map);
CONEMAP_API conemap_result conemap_write_maxima(const conemap_map *map, int level, float *values, size_t size);

/* Cone maps made on the GPU: a few kernels, each a text of its own, and a list that says in what order to run them. Every
   pass reads textures and writes one value for each texel of the map, so it can be a compute dispatch or, for WebGL 2 and
   ES 3.0, a full-screen draw (the viewport is the map's size). The state is a one-channel f32 texture, in two copies that
   passes read and write by turns; before the first pass the one that it reads holds 0. With desc->map.guarantee VERTEX
   what comes out are vertex cones as CONEMAP_RING makes them, to within float rounding and never wider; else, with the
   SAFE pass, cones with CONEMAP_GUARANTEE_BILINEAR. */
typedef enum conemap_kernel {
    CONEMAP_KERNEL_RING = 0, /* steepest slope, squared, to the texels of rings first..last [Dum06]: needs the heights
                                and the state, writes the state */
    CONEMAP_KERNEL_MIN3X3,   /* of each 3x3 block the narrowest cone [BV24 eq. 2]: state to state */
    CONEMAP_KERNEL_SAFE,     /* vertex cones made safe for the bilinear surface, at once and not tightly: the steepest slope
                                of the 3x3 block times sqrt(2) on square texels, more on long ones. About 62 % of the
                                vertex cones' width is left on the test maps. Needs the heights and the state, writes the
                                state */
    CONEMAP_KERNEL_STORE,    /* state to the texture: encoded and rounded down. Not DUMMER */
    CONEMAP_KERNEL_COUNT
} conemap_kernel;

/* One pass. Between passes the host waits for the writes of the one before (a barrier, or the next draw's order). */
typedef struct conemap_gpu_pass {
    conemap_kernel kernel;
    int first, last;     /* RING: the two arguments */
    int reads, writes;   /* copies of the state, 0 and 1; writes 2: the texture */
    int groups_x, groups_y; /* of 8 x 8 threads */
} conemap_gpu_pass;

/* Writes a kernel. desc: dialect, stage, map (wraps, aspect, max_tan, texture), fixed_size, prefix, binding, set,
   sampler_binding, heights_name (default prefix_heights), map_name (the state read; default prefix_state), precision, fetch
   and, for the state, fetch_maxima, both `float NAME(int i, int j)`; other fields are ignored. FUNCTIONS are
       float conemap_ring(int i, int j, int first, int last[, ivec2 size])
       float conemap_steepest(int i, int j[, ivec2 size])
       float conemap_safe(int i, int j[, ivec2 size])
       float conemap_stored(int i, int j[, ivec2 size])     the cone channel; conemap_texel(i, j[, size]) is the height
   Otherwise as conemap_emit. */
CONEMAP_API conemap_result conemap_emit_kernel(const conemap_shader_desc *desc, conemap_kernel kernel, char *text,
                                               size_t capacity, size_t *size);

/* The passes that make a map of desc->map.width x height: MIN3X3 among them if desc->map.min3x3 is set, SAFE unless
   desc->map.guarantee is VERTEX. batch: texels that
   one invocation looks at in a pass, so that no dispatch runs long; 0: 4096. passes: null asks for the count alone. Errors:
   NULL, SIZE, PARAMETER (batch below 0), BUFFER (capacity below the count; nothing is written). */
CONEMAP_API conemap_result conemap_gpu_passes(const conemap_shader_desc *desc, int batch, conemap_gpu_pass *passes, int capacity,
                                              int *count);

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
   E M I T T E R

   Snippets are written in words that GLSL, HLSL and C share, one table entry each. A snippet needs every other one that
   it names; the emitter follows these names from conemap_trace and writes what it met, needed ones first. So nothing
   unused comes out, and there is no list of needs to be kept.
     ?a,!b text    a line for emissions where flag a is set and b is not
     @move         lines that several tracers share
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
    X(safe) X(store) X(steepest) X(unorm) X(half) X(pair) X(host_state)
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
     "    float d = b * b - 4.0f * a * c, q = -0.5f * (b + (b < 0.0f ? -1.0f : 1.0f) * sqrt(max(d, 0.0f)));\n"
     "    float first = q != 0.0f ? c / q : -1.0f, second = a != 0.0f ? q / a : -1.0f;\n"
     "    if (first < 0.0f || (second >= 0.0f && second < first)) first = second;\n"
     "    return c <= 0.0f ? 0.0f : d >= 0.0f && first <= end ? first : -1.0f;\n"
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

static const char conemap__move[] =
    "        // Moves on by dt. Whole cells go to i and j: x and y stay small and keep their bits.\n"
    "        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt;\n"
    "        i += si * int(floor(x)); x -= floor(x); j += sj * int(floor(y)); y -= floor(y);\n";

static const char conemap__surface[] = /* the height below the ray, and with `cones` the cone there */
    "?cones,!gather,!hardware         vec2 a = conemap_texel(i, j$MAP), b = conemap_texel(i + si, j$MAP);\n"
    "?cones,!gather,!hardware         vec2 c = conemap_texel(i, j + sj$MAP), d = conemap_texel(i + si, j + "
    "sj$MAP);\n"
    "?cones,!gather,!hardware         vec4 heights = vec4(a.x, b.x, c.x, d.x);\n"
    "?!cones,!gather,!hardware         vec4 heights = vec4(conemap_texel(i, j$MAP), conemap_texel(i + si, "
    "j$MAP),\n"
    "?!cones,!gather,!hardware                             conemap_texel(i, j + sj$MAP), conemap_texel(i + si, j "
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

static const char conemap__cone[] =
    "?!gather,!hardware,!per_cell         float cone = conemap_mix(vec4(a.y, b.y, c.y, d.y), x, y);\n"
    "?!gather,!hardware,per_cell         float cone = sj > 0 ? (si > 0 ? a.y : b.y) : si > 0 ? c.y : d.y;\n"
    "?gather,!per_cell         float cone = conemap_mix(conemap_turn($GATHER_CONES, si, sj), x, y);\n"
    "?cone_texel         float cone = conemap_texel(si > 0 ? i : i - 1, sj > 0 ? j : j - 1$MAP);\n"
    "?hardware,!apart         float cone = both.y;\n"
    "?hardware,apart,!per_cell         float cone = $SAMPLE_CONE;\n";

static const char conemap__loop_exact[] =
    "@surface\n"
    "@cone\n"
    "        float leave = min((1.000001f - x) / v.x, (1.000001f - y) / v.y), left = range.y - t; // just over "
    "the border\n"
    "        float gap = z - height, closing = speed - $TANGENT * v.z;\n"
    "        hit = conemap_patch_hit(heights, x, y, gap, v, min(leave, left));\n"
    "?back         if (hit == 0.0f && flown > 0.0f) { // this cone was not empty: back, and cell by cell through "
    "it\n"
    "?back             walked = t;\n"
    "?back             dt = -flown;\n"
    "?back             flown = 0.0f;\n"
    "?back             hit = -1.0f;\n"
    "?back             continue;\n"
    "?back         }\n"
    "        gap -= 1.0f / 1048576.0f; // the apex is raised by more than its rounding\n"
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
    {"float", "float", "float", "float", "(float)"},
    {"int", "int", "int", "int", "(int)"},
    {"clamp", "clamp", "clamp", "clamp", "conemap_clampi"},
    {"min", "min", "min", "min", "fminf"},
    {"max", "max", "max", "max", "fmaxf"},
    {"abs", "abs", "abs", "abs", "fabsf"},
    {"sqrt", "sqrt", "sqrt", "sqrt", "sqrtf"},
    {"floor", "floor", "floor", "floor", "floorf"},
};

/* What a name after a dollar stands for. Text of the host's is raw: no word of it is changed. */
#define CONEMAP__PIECE_SIZE 400
typedef struct conemap__piece {
    const char *name;
    int raw;
    char text[CONEMAP__PIECE_SIZE];
} conemap__piece;

#define CONEMAP__PIECES 96
#define CONEMAP__NAME_SIZE 64

typedef struct conemap__emitter {
    conemap_shader_desc desc;
    char *text;
    size_t size, capacity;
    unsigned char flags[conemap__flag_count];
    unsigned char written[sizeof conemap__snippets / sizeof conemap__snippets[0]];
    conemap__piece pieces[CONEMAP__PIECES];
    int piece_count;
    const char *prefix;
    const char *given[7];                   /* the host's names, or null */
    char names[4][CONEMAP__NAME_SIZE + 16]; /* map, heights, maxima, sampler */
    int commenting;
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
    conemap__piece *piece = &e->pieces[e->piece_count++];
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
        for (k = 0; k < 7; ++k) e->clash |= e->given[k] && conemap__same(e->given[k], token, length);
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
            const char *part = text[1] == 'm' ? conemap__move : text[1] == 's' ? conemap__surface : conemap__cone;
            conemap__lines(e, part, needs);
            while (*text && *text != '\n') ++text;
        } else if (wanted) {
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
    int k;
    for (k = 0; k < (int)(sizeof conemap__snippets / sizeof conemap__snippets[0]); ++k) {
        if (e->written[k] || !conemap__same(conemap__snippets[k].name, name, length)) continue;
        e->written[k] = 1;
        conemap__lines(e, conemap__snippets[k].text, 1);
        conemap__lines(e, conemap__snippets[k].text, 0);
        conemap__put(e, "\n", 1);
    }
}

/* What stands before and behind the functions. */
static const char conemap__head_text[] =
    "?version #version $VERSION\n"
    "// conemap.h: $TRACER tracer.\n"
    "?!any // conemap_trace($SIGNATURE): the first hit of a ray with the relief.\n"
    "?any // conemap_any_hit($SIGNATURE): does a ray meet the relief?\n"
    "// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the "
    "direction.\n"
    "?t_range // t_min, t_max: the part of the ray that counts; t_min 0 or more.\n"
    "?cap // max_steps: where to give up.\n"
    "?atlas // rect: the map in the texture, (x, y, width, height) in texels.\n"
    "?size_argument // size: the map's width and height in texels.\n"
    "?array // slice: the texture array's.\n"
    "?uses_map // $MAP_NAME: $MAP_COMMENT\n"
    "?uses_heights // $HEIGHTS_NAME: height in the first channel$FILTER_COMMENT\n"
    "?uses_maxima // $MAXIMA_NAME: maxima over bilinear cells, with all its mips; only fetched\n"
    "?host // $FETCH_NAME: the host's; $FETCH_COMMENT\n"
    "?c #include <math.h>\n"
    "?c #include <stdbool.h>\n"
    "\n"
    "?es precision $PRECISION float;\n"
    "?es precision highp int;\n"
    "?uses_map,!external,glsl $MAP_LAYOUTuniform $SAMPLER $MAP_NAME;\n"
    "?uses_heights,!external,glsl $HEIGHTS_LAYOUTuniform $SAMPLER $HEIGHTS_NAME;\n"
    "?uses_maxima,!external,glsl $MAXIMA_LAYOUTuniform $SAMPLER $MAXIMA_NAME;\n"
    "?uses_map,!external,hlsl $TEXTURE<$MAP_TYPE> $MAP_NAME$MAP_LAYOUT;\n"
    "?uses_heights,!external,hlsl $TEXTURE<float> $HEIGHTS_NAME$HEIGHTS_LAYOUT;\n"
    "?uses_maxima,!external,hlsl $TEXTURE<float> $MAXIMA_NAME$MAXIMA_LAYOUT;\n"
    "?sampler,!external SamplerState $SAMPLER_NAME$SAMPLER_LAYOUT;\n"
    "\n";

static const char conemap__host_text[] =
    "$TEXEL_TYPE $FETCH_NAME($FETCH_PARAMS);\n"
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
        d->binding < 0 || d->binding > 65536 || d->sampler_binding < 0 || d->sampler_binding > 65536 ||
        d->sectors < 0)
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
    for (k = 0; k < 7; ++k) {
        if (!conemap__is_name(e->given[k])) return CONEMAP_ERROR_PARAMETER;
        for (m = 0; m < k; ++m)
            if (e->given[k] && e->given[m] && strcmp(e->given[k], e->given[m]) == 0)
                return CONEMAP_ERROR_PARAMETER;
    }
    if (d->flags != 0 || d->sectors > 1) return CONEMAP_ERROR_UNSUPPORTED;

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
    f[conemap__flag_cone_only] = d->map.texture.layout == CONEMAP_CONE_ONLY && !d->fetch;
    f[conemap__flag_hardware] = d->filter == CONEMAP_FILTER_HARDWARE;
    f[conemap__flag_gather] = d->filter == CONEMAP_FILTER_GATHER;
    f[conemap__flag_apart] = f[conemap__flag_cone_only] || f[conemap__flag_per_cell];
    f[conemap__flag_cone_texel] = f[conemap__flag_cones] && f[conemap__flag_per_cell] &&
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
            (d->atlas && (d->filter != CONEMAP_FILTER_FETCH || d->fixed_size || f[conemap__flag_blocks])) ||
            (f[conemap__flag_per_cell] && d->map.texture.encoding == CONEMAP_RADIUS) ||
            (d->external && d->stage != CONEMAP_STAGE_FUNCTIONS) || (d->trace.any_hit && !f[conemap__flag_any]) ||
            (f[conemap__flag_any] && (d->steps || d->status)))
            return CONEMAP_ERROR_UNSUPPORTED;
    }
    return CONEMAP_OK;
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
    const char *cone_swizzle = f[conemap__flag_cone_only] ? ".r" : ".g";
    const char *w = "size.x", *h = "size.y", *fetch, *sample, *uv, *gathers, *texel;
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
    conemap__append(out, size, "$SIZE_PARAMS$SLICE_PARAM");
    conemap__piece_set(e, "SLICE_PARAM", 0, array ? ", int slice" : "");
    conemap__piece_set(e, "SIZE", 0, d->fixed_size ? "" : d->atlas ? ", rect" : ", size");
    conemap__piece_set(e, "MAP", 0, array ? "$SIZE, slice" : "$SIZE");
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
    texel = hlsl    ? (array ? "(int4($I, $J, slice, 0))" : "(int3($I, $J, 0))")
            : array ? ", ivec3($I, $J, slice), 0)"
                    : ", ivec2($I, $J), 0)";
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
    out = conemap__piece_new(e, "TEXEL", 0);
    if (host) {
        conemap__append(out, size, "$FETCH_NAME");
        conemap__append(out, size, array ? "($I, $J, slice)" : "($I, $J)");
    } else if (f[conemap__flag_cone_texel]) {
        conemap__read_texture(e, out, map, fetch, texel, cone_swizzle);
    } else if (!cones) {
        conemap__read_texture(e, out, height_texture, fetch, texel, ".r");
    } else if (f[conemap__flag_cone_only]) {
        conemap__append(out, size, hlsl ? "float2(" : "vec2(");
        conemap__read_texture(e, out, heights, fetch, texel, ".r, ");
        conemap__read_texture(e, out, map, fetch, texel, ".r)");
    } else {
        conemap__read_texture(e, out, map, fetch, texel, ".rg");
    }
    out = conemap__piece_new(e, "SAMPLE", 0);
    if (host) {
        conemap__append(out, size, "$FETCH_NAME");
        conemap__append(out, size, array ? "(uv.x, uv.y, slice)" : "(uv.x, uv.y)");
        conemap__piece_set(e, "SAMPLE_HEIGHT", 0, out);
    } else {
        conemap__read_texture(e, out, map, sample, uv, ".rg");
        conemap__read_texture(e, conemap__piece_new(e, "SAMPLE_HEIGHT", 0), height_texture, sample, uv, ".r");
    }
    conemap__read_texture(e, conemap__piece_new(e, "SAMPLE_CONE", 0), map, sample, uv, cone_swizzle);
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
        conemap__append(conemap__piece_new(e, "KEPT", 0), size,
                        f[conemap__flag_host_state] ? "$FETCH_MAXIMA_NAME(i, j)"
                        : hlsl                      ? "$MAP_NAME.Load(int3(i, j, 0)).r"
                                                    : "texelFetch($MAP_NAME, ivec2(i, j), 0).r");
        conemap__append(conemap__piece_new(e, "SLOPE", 0), size,
                        f[conemap__flag_host_state] ? "$FETCH_MAXIMA_NAME($I, $J)"
                        : hlsl                      ? "$MAP_NAME.Load(int3($I, $J, 0)).r"
                                                    : "texelFetch($MAP_NAME, ivec2($I, $J), 0).r");
        conemap__append_float(conemap__piece_new(e, "ASPECT", 0), size, d->map.aspect);
        conemap__piece_set(e, "SCALE_MAX", 0, d->map.texture.format == CONEMAP_UNORM8 ? "255.0f" : "65535.0f");
    }
    conemap__piece_set(e, "TEXEL_TYPE", 0, !cones || f[conemap__flag_cone_texel] ? "float" : "vec2");
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
    conemap__piece_set(e, "FETCH_NAME", 1, host ? d->fetch : "");
    conemap__piece_set(e, "FETCH_MAXIMA_NAME", 1, d->fetch_maxima ? d->fetch_maxima : "");
    conemap__piece_set(e, "FETCH_PARAMS", 0,
                       f[conemap__flag_hardware] ? "float u, float v$SLICE_PARAM" : "int i, int j$SLICE_PARAM");
    conemap__piece_set(e, "FETCH_COMMENT", 1, cones ? "height, and the cone as stored" : "height");
    conemap__piece_set(e, "FILTER_COMMENT", 1,
                       f[conemap__flag_hardware] ? "; linear filter"
                       : f[conemap__flag_gather] ? "; gathered"
                                                 : "; only fetched");
    out = conemap__piece_new(e, "MAP_COMMENT", 1);
    conemap__append(out, size,
                    d->map.texture.layout == CONEMAP_CONE_ONLY ? "r"
                    : d->map.texture.layout == CONEMAP_DUMMER  ? "rgba"
                                                               : "rg");
    conemap__append(out, size, formats[d->map.texture.format]);
    conemap__append(out, size, d->map.texture.layout == CONEMAP_CONE_ONLY ? ", " : ", height and ");
    conemap__append(out, size, encodings[d->map.texture.encoding]);
    if (d->map.texture.per_cell) conemap__append(out, size, ", one for each cell");
    if (d->map.texture.layout == CONEMAP_DUMMER) conemap__append(out, size, ", and slopes, not read here");
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
                    d->map.texture.layout == CONEMAP_CONE_ONLY ? "float"
                    : d->map.texture.layout == CONEMAP_DUMMER  ? "float4"
                                                               : "float2");
    conemap__place_resource(e, "MAP_LAYOUT", 't', binding);
    binding += f[conemap__flag_uses_map];
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
    if (e->desc.stage != CONEMAP_STAGE_FUNCTIONS) conemap__put(e, "\n", 1);
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
    conemap__lines(&e, conemap__head_text, 0);
    if (desc->fetch) {
        conemap__lines(&e, conemap__host_text, 1); /* C: the types that it is declared with */
        conemap__lines(&e, conemap__host_text, 0);
    }
    conemap__write_trace(&e);
    if (e.flags[conemap__flag_fragment]) conemap__lines(&e, conemap__fragment_text, 0);
    if (e.flags[conemap__flag_compute]) conemap__lines(&e, conemap__compute_text, 0);
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
    "?uses_heights // $HEIGHTS_NAME: height in the first channel; only fetched\n"
    "?!host_state // $MAP_NAME: r32f, the state: slope squared; only fetched\n"
    "?size_argument // size: the map's width and height in texels.\n"
    "?c #include <math.h>\n"
    "\n"
    "?es precision $PRECISION float;\n"
    "?es precision highp int;\n"
    "?!host_state,glsl $MAP_LAYOUTuniform $SAMPLER $MAP_NAME;\n"
    "?uses_heights,glsl $HEIGHTS_LAYOUTuniform $SAMPLER $HEIGHTS_NAME;\n"
    "?!host_state,hlsl Texture2D<float> $MAP_NAME$MAP_LAYOUT;\n"
    "?uses_heights,hlsl Texture2D<float> $HEIGHTS_NAME$HEIGHTS_LAYOUT;\n"
    "?host float $FETCH_NAME(int i, int j);\n"
    "?host_state float $FETCH_MAXIMA_NAME(int i, int j);\n"
    "\n";

static const char conemap__kernel_main[] =
    "?ring,glsl,!vulkan uniform int conemap_first, conemap_last;\n"
    "?ring,vulkan layout(push_constant) uniform conemap_arguments {\n"
    "?ring,hlsl cbuffer conemap_arguments : register(b$BINDING) {\n"
    "?ring,vulkan     int conemap_first, conemap_last;\n"
    "?ring,hlsl     int conemap_first, conemap_last;\n"
    "?ring,vulkan };\n"
    "?ring,hlsl };\n"
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
    "?compute     if (i >= $W || j >= $H) return;\n"
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
    d->fetch = desc->fetch;
    d->fetch_maxima = desc->fetch_maxima;
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
    f[conemap__flag_pair] = f[conemap__flag_store] && texture.layout == CONEMAP_HEIGHT_CONE;
    f[conemap__flag_host_state] = d->fetch_maxima != NULL;
    f[conemap__flag_uses_map] = !d->fetch_maxima;
    f[conemap__flag_uses_heights] =
        !d->fetch &&
        (f[conemap__flag_ring] || f[conemap__flag_safe] ||
         (f[conemap__flag_store] &&
          (f[conemap__flag_radius] || (f[conemap__flag_pair] && d->stage != CONEMAP_STAGE_FUNCTIONS))));
    f[conemap__flag_host] = d->fetch && (f[conemap__flag_ring] || f[conemap__flag_safe] ||
                                         (f[conemap__flag_store] && f[conemap__flag_radius]));
    if ((d->fetch == NULL) != (d->fetch_maxima == NULL) || (d->fetch && d->stage != CONEMAP_STAGE_FUNCTIONS) ||
        (f[conemap__flag_store] && texture.layout == CONEMAP_DUMMER) ||
        (f[conemap__flag_store] && f[conemap__flag_es] && d->stage == CONEMAP_STAGE_COMPUTE &&
         (f[conemap__flag_pair] || texture.format != CONEMAP_F32))) /* ES 3.1 has no such images */
        return CONEMAP_ERROR_UNSUPPORTED;
    if (!d->fixed_size && !d->fetch) f[conemap__flag_size_asked] = 1;
    return CONEMAP_OK;
}

static conemap_result conemap__emit_kernel_once(const conemap_shader_desc *desc, conemap_kernel kernel, char *text,
                                                size_t capacity, size_t *size) {
    static const char *const functions[CONEMAP_KERNEL_COUNT] = {"conemap_ring", "conemap_steepest", "conemap_safe",
                                                                "conemap_stored"};
    static const char *const calls[CONEMAP_KERNEL_COUNT] = {
        "conemap_ring(i, j, conemap_first, conemap_last$SIZE)", "conemap_steepest(i, j$SIZE)",
        "conemap_safe(i, j$SIZE)", "conemap_stored(i, j$SIZE)"};
    static const char *const formats[CONEMAP_FORMAT_COUNT][2] = {
        {"r32f", "rg32f"}, {"r16f", "rg16f"}, {"r16", "rg16"}, {"r8", "rg8"}};
    conemap__emitter e;
    conemap_result result;
    char *out;
    int binding, pair;
    memset(&e, 0, sizeof e);
    e.text = text;
    e.capacity = capacity;
    result = conemap__resolve_kernel(&e, desc, kernel);
    if (result != CONEMAP_OK) return result;
    conemap__make_pieces(&e);
    pair = e.flags[conemap__flag_pair];
    binding = e.desc.binding + 1 + e.flags[conemap__flag_uses_heights];
    conemap__piece_set(&e, "OUT_FORMAT", 1,
                       formats[kernel == CONEMAP_KERNEL_STORE ? desc->map.texture.format : CONEMAP_F32][pair]);
    conemap__piece_set(&e, "OUT_TYPE", 1,
                       pair ? (e.flags[conemap__flag_unorm] ? "unorm float2" : "float2")
                       : kernel == CONEMAP_KERNEL_STORE && e.flags[conemap__flag_unorm] ? "unorm float"
                                                                                        : "float");
    conemap__place_resource(&e, "OUT_LAYOUT", e.flags[conemap__flag_hlsl] ? 'u' : 'b',
                            e.flags[conemap__flag_hlsl] ? e.desc.binding : binding);
    out = conemap__piece_new(&e, "RESULT", 0);
    if (pair) conemap__append(out, CONEMAP__PIECE_SIZE, "conemap_texel(i, j$SIZE), ");
    conemap__append(out, CONEMAP__PIECE_SIZE, calls[kernel]);
    conemap__append(out, CONEMAP__PIECE_SIZE, pair ? ", 0.0f, 0.0f" : ", 0.0f, 0.0f, 0.0f");
    out = conemap__piece_new(&e, "RESULT_HLSL", 0);
    if (pair) conemap__append(out, CONEMAP__PIECE_SIZE, "vec2(conemap_texel(i, j$SIZE), ");
    conemap__append(out, CONEMAP__PIECE_SIZE, calls[kernel]);
    if (pair) conemap__append(out, CONEMAP__PIECE_SIZE, ")");
    conemap__lines(&e, conemap__kernel_head, 0);
    conemap__lines(&e, conemap__kernel_head, 1);
    conemap__snippet_named(&e, functions[kernel], strlen(functions[kernel]));
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

CONEMAP__DEF conemap_result conemap_gpu_passes(const conemap_shader_desc *desc, int batch,
                                               conemap_gpu_pass *passes, int capacity, int *count) {
    int first = 1, made = 0, write, reach, w, h;
    if (!desc || !count) return CONEMAP_ERROR_NULL;
    w = desc->map.width;
    h = desc->map.height;
    if (w < 1 || h < 1 || w > CONEMAP_MAX_SIZE || h > CONEMAP_MAX_SIZE) return CONEMAP_ERROR_SIZE;
    if (batch < 0) return CONEMAP_ERROR_PARAMETER;
    if (batch == 0) batch = 4096;
    reach = conemap__maxi(1, conemap__maxi(w, h) -
                                 1);      /* with wrap that is farther than the nearest image of any texel */
    for (write = 0; write < 2; ++write) { /* first count them */
        int steps;
        if (write && (!passes || capacity < made)) break;
        for (first = 1, steps = 0; first <= reach + 3; ++steps) {
            conemap_gpu_pass pass;
            int last = first;
            memset(&pass, 0, sizeof pass);
            while (last < reach &&
                   (int64_t)4 * ((int64_t)(last + 1) * (last + 2) - (int64_t)first * (first - 1)) <= batch)
                ++last;
            pass.kernel = first <= reach       ? CONEMAP_KERNEL_RING
                          : first == reach + 1 ? CONEMAP_KERNEL_MIN3X3
                          : first == reach + 2 ? CONEMAP_KERNEL_SAFE
                                               : CONEMAP_KERNEL_STORE;
            if (pass.kernel == CONEMAP_KERNEL_RING) {
                pass.first = first;
                pass.last = last;
            }
            first = pass.kernel == CONEMAP_KERNEL_RING ? last + 1 : first + 1;
            if ((pass.kernel == CONEMAP_KERNEL_MIN3X3 && !desc->map.min3x3) ||
                (pass.kernel == CONEMAP_KERNEL_SAFE && desc->map.guarantee == CONEMAP_GUARANTEE_VERTEX)) {
                --steps;
                continue;
            }
            pass.reads = steps & 1;
            pass.writes = pass.kernel == CONEMAP_KERNEL_STORE ? 2 : 1 - pass.reads;
            pass.groups_x = (w + 7) / 8;
            pass.groups_y = (h + 7) / 8;
            if (write) passes[steps] = pass;
        }
        made = steps;
    }
    *count = made;
    return passes && capacity < made ? CONEMAP_ERROR_BUFFER : CONEMAP_OK;
}

/* How many levels a square of 2^n has that holds all cells. */
static int conemap__maxima_top(const conemap_map *map) {
    int top = 0;
    while ((1 << top) < map->cells.width[0] || (1 << top) < map->cells.height[0]) ++top;
    return top;
}

CONEMAP__DEF int conemap_maxima_levels(const conemap_map *map) {
    return map && map->cells.levels > 0 ? conemap__maxima_top(map) + 1 : 0;
}

CONEMAP__DEF conemap_result conemap_write_maxima(const conemap_map *map, int level, float *values, size_t size) {
    int side, x, y;
    if (!map || !map->heights || !values) return CONEMAP_ERROR_NULL;
    if (map->cells.levels == 0) return CONEMAP_ERROR_NO_PYRAMID;
    if (level < 0 || level > conemap__maxima_top(map)) return CONEMAP_ERROR_PARAMETER;
    side = 1 << (conemap__maxima_top(map) - level);
    if (size / sizeof *values < (size_t)side * (size_t)side) return CONEMAP_ERROR_BUFFER;
    for (y = 0; y < side; ++y)
        for (x = 0; x < side; ++x)
            values[(size_t)y * (size_t)side + (size_t)x] =
                x >= map->cells.width[level] || y >= map->cells.height[level] ? 0.0f
                : level == 0                                                  ? conemap__cell_max(map, x, y)
                             : conemap__block_max(&map->cells, level, x, y);
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
#undef CONEMAP__FLAGS
#undef CONEMAP__PIECE_SIZE
#undef CONEMAP__PIECES
#undef CONEMAP__NAME_SIZE

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
