/* accuracy [MAPFILE]: what accuracy costs in time; see print_help. A method is a line of `methods`: cones (a line of
   `cones`), a tracer, a refinement and a step cap; adding a line is all that it takes. */
#define CONEMAP_IMPLEMENTATION
#include "common.h"
#include "../tests/aperture.h"
#include "../tests/truth.h"
#include "../tests/zoo.h"
#include "measure.h"
#include "report.h"

/* ---- what is compared ------------------------------------------------------------------------------- */

static const struct cone_kind kinds[] = {
    /* name, paper, generator, guarantee, slack, min3x3, per_cell, sectors, format, from: of a generator that is slow,
       the line before */
    {"none", "", CONEMAP_HEIGHTS, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, HEIGHTS_ONLY},
    {"vertex", "[Dum06]", CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"vertex 3x3", "[Dum06] [BV24]", CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0, 1, 0, 0, CONEMAP_F32, 0},
    {"ring", "[Dum06]", CONEMAP_RING, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"quick naive", "[VB22] 1", CONEMAP_QUICK_NAIVE, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"quick", "[VB22] 2", CONEMAP_QUICK, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"quick 3x3", "[VB22] [BV24]", CONEMAP_QUICK, CONEMAP_GUARANTEE_DEFAULT, 0, 1, 0, 0, CONEMAP_F32, 0},
    {"center", "[VB22]", CONEMAP_QUICK_CENTER, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"sampled", "[PO07]", CONEMAP_RELAXED_SAMPLED, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"sampled 3x3", "[PO07] [BV24]", CONEMAP_RELAXED_SAMPLED, CONEMAP_GUARANTEE_DEFAULT, 0, 1, 0, 0, CONEMAP_F32,
     FROM_BEFORE},
    {"relaxed", "[BV24] 2", CONEMAP_RELAXED, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"relaxed 3x3", "[BV24] 2", CONEMAP_RELAXED, CONEMAP_GUARANTEE_DEFAULT, 0, 1, 0, 0, CONEMAP_F32, FROM_BEFORE},
    {"hybrid", "[CHRS17]", CONEMAP_HYBRID, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"relaxed safe", "ours", CONEMAP_RELAXED_EXACT, CONEMAP_GUARANTEE_DEFAULT, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"safe", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 0, 0, CONEMAP_F32, 0},
    {"safe slack .1", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0.1f, 0, 0, 0, CONEMAP_F32, 0},
    {"safe slack .5", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0.5f, 0, 0, 0, CONEMAP_F32, 0},
    {"safe cells", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 1, 0, CONEMAP_F32, 0},
    {"safe f16", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 0, 0, CONEMAP_F16, 0},
    {"safe cells u16", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 1, 0, CONEMAP_UNORM16, 0},
    {"safe cells u8", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 1, 0, CONEMAP_UNORM8, 0},
    {"safe 4", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 0, 4, CONEMAP_F32, 0},
    {"safe 8", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 0, 8, CONEMAP_F32, 0},
    {"safe cells 4", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 1, 4, CONEMAP_F32, 0},
    {"safe cells 8", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_BILINEAR, 0, 0, 1, 8, CONEMAP_F32, 0},
    {"vertex 4", "ours", CONEMAP_EXACT, CONEMAP_GUARANTEE_VERTEX, 0, 0, 0, 4, CONEMAP_F32, 0},
};
enum { CONES = sizeof kinds / sizeof kinds[0] };
static struct cones cones[CONES];

/* The tracers, and the texels that one step of each reads on a GPU without filtering hardware: a filtered fetch is
   four. Cell walkers look at the cell's four heights and at its cone; the block walkers read one maximum, the prepared
   tracer a record as large as two, and both four heights for a cell that is entered (counted once a ray here: the walk
   does not tell how often). */
static const struct tracer tracers[] = {
    /* name, tracer, heights and cones a step, heights a ray besides, prepared */
    {"linear", CONEMAP_TRACE_LINEAR, 4, 0, 4, 0},         {"fixed", CONEMAP_TRACE_FIXED, 4, 4, 4, 0},
    {"loop", CONEMAP_TRACE_LOOP, 4, 4, 4, 0},             {"exact-step", CONEMAP_TRACE_EXACT_STEP, 4, 4, 0, 0},
    {"cell-max", CONEMAP_TRACE_CELL_MAX, 4, 4, 0, 0},     {"exact", CONEMAP_TRACE_EXACT, 4, 4, 0, 0},
    {"qdm", CONEMAP_TRACE_QDM, 1, 0, 4, 0},               {"maxmip", CONEMAP_TRACE_MAXMIP, 1, 0, 4, 0},
    {"prepared", CONEMAP_TRACE_EXACT, 2, 0, 4, 1},
};
enum { TRACERS = sizeof tracers / sizeof tracers[0] };

#define NONE CONEMAP_REFINE_NONE
#define SECANT CONEMAP_REFINE_SECANT
#define BISECT CONEMAP_REFINE_BISECT
static const struct method chosen[] = {
    /* cones, tracer, refinement, step cap, 1: a row of the summary, 1 or 2: on the contact sheet */
    {"none", "linear", SECANT, 32, 1},
    {"none", "linear", SECANT, 200, 2},
    {"none", "linear", BISECT, 200, 0},
    {"none", "qdm", NONE, 0, 1},
    {"none", "maxmip", NONE, 0, 1},
    {"none", "prepared", NONE, 0, 1},
    {"vertex", "fixed", NONE, 0, 0},
    {"vertex", "loop", NONE, 32, 0},
    {"vertex", "exact-step", SECANT, 0, 1},
    {"vertex 3x3", "exact-step", SECANT, 0, 0},
    {"vertex", "cell-max", SECANT, 0, 0},
    {"vertex 3x3", "cell-max", SECANT, 0, 1},
    {"vertex 3x3", "cell-max", SECANT, 32, 0},
    {"vertex", "exact", NONE, 0, 1},
    {"vertex 3x3", "exact", NONE, 0, 0},
    {"quick", "exact-step", SECANT, 0, 0},
    {"quick 3x3", "cell-max", SECANT, 0, 0},
    {"center", "exact-step", SECANT, 0, 0},
    {"quick", "exact", NONE, 0, 0},
    {"sampled", "exact-step", BISECT, 0, 2},
    {"sampled 3x3", "cell-max", BISECT, 0, 0},
    {"relaxed", "exact-step", BISECT, 0, 2},
    {"relaxed 3x3", "cell-max", BISECT, 0, 0},
    {"hybrid", "cell-max", BISECT, 0, 0},
    {"relaxed safe", "exact", NONE, 0, 0},
    {"safe", "cell-max", SECANT, 0, 0},
    {"safe", "exact", NONE, 32, 0},
    {"safe", "exact", NONE, 0, 1},
    {"safe slack .1", "exact", NONE, 0, 0},
    {"safe slack .5", "exact", NONE, 0, 0},
    {"safe cells", "exact", NONE, 0, 1},
    {"safe f16", "exact", NONE, 0, 0},
    {"safe cells u16", "exact", NONE, 0, 0},
    {"safe cells u8", "exact", NONE, 0, 0},
    {"safe 4", "exact", NONE, 0, 0},
    {"safe 8", "exact", NONE, 0, 0},
    {"safe cells 8", "exact", NONE, 0, 1},
};
enum { CHOSEN = sizeof chosen / sizeof chosen[0] };

/* ---- settings --------------------------------------------------------------------------------------- */

struct settings {
    const char *file;
    int size, full, camera, apertures, fit, plans, pictures;
    float elevation, azimuth, depth;
};

static void print_help(void) {
    puts("accuracy [MAPFILE]: what accuracy costs in time\n\n"
         "Measures methods (cones x tracer x refinement x step cap) on four procedural maps and on the elevation "
         "model, or on\n"
         "MAPFILE alone: generation time, bytes, steps, time a ray, rays that miss their first hit, rays that do not\n"
         "converge, texels read, error of the hit, and the error of a picture. out/accuracy.csv, .svg, .html, .png.\n\n"
         "  --size N             of the procedural maps (256)\n"
         "  --full               every generator x correction x tracer x refinement x cap that means something:\n"
         "                       763 methods a map, ten minutes\n"
         "  --camera E A         rays of a view from E degrees above the ground, azimuth A, instead of rays at random\n"
         "  --depth D            height of the relief; the map is 1 wide (0.25)\n"
         "  --apertures          how near our cones come to the widest safe ones, and their steps; nothing else\n"
         "  --fit                the planner's table for conemap.h, fitted on the procedural maps (make fit puts it\n"
         "                       there); nothing else\n"
         "  --plans              the planner's choices beside what they measure; nothing else\n"
         "  --no-pictures        leave the contact sheet out");
}

/* ---- maps, rays and the truth about them ---------------------------------------------------------------- */

enum { RAYS = 20000, VIEW_W = 240, VIEW_H = 160, VIEW = VIEW_W * VIEW_H, MOST_RAYS = VIEW, MOST = 1024 };

struct rays {
    int count;
    char name[64];
    conemap_ray list[MOST_RAYS];
    double truth[MOST_RAYS]; /* t of the first hit; of rays that meet nothing, where they end */
    int meets[MOST_RAYS];
};

struct scene {
    const char *name;
    const struct settings *settings;
    struct image *image;
    struct truth_map truth;
    double low, high; /* of the heights */
    struct rays random, view;
    struct rays *measured; /* one of the two */
    float picture[VIEW];   /* the view's true shades */
    struct result results[MOST];
    int count;
};

/* Where a ray ends that meets nothing: where it leaves the unit box. */
static double box_exit(const conemap_ray *ray) {
    double t0 = 0, t1 = 1e300;
    for (int k = 0; k < 3; ++k) {
        double o = (double)ray->origin[k], v = (double)ray->direction[k], a, b;
        if (ray->direction[k] == 0) {
            if (o < 0 || o > 1) return 0;
            continue;
        }
        a = ((v > 0 ? 0 : 1) - o) / v;
        b = ((v > 0 ? 1 : 0) - o) / v;
        t0 = fmax(t0, a);
        t1 = fmin(t1, b);
    }
    return t0 <= t1 ? t1 : 0;
}

/* The first meeting in double precision, cell by cell. */
static int true_hit(const struct scene *s, const conemap_ray *ray, double *t) {
    double origin[3], direction[3];
    for (int k = 0; k < 3; ++k) {
        origin[k] = (double)ray->origin[k];
        direction[k] = (double)ray->direction[k];
    }
    *t = box_exit(ray);
    return truth_trace_below(&s->truth, s->high, origin, direction, HUGE_VAL, t);
}

/* A miss: the surface rises more than 2^-20 above the ray before the hit that was reported. */
static int is_miss(const struct truth_map *map, const conemap_ray *ray, const conemap_hit *hit) {
    double origin[3], direction[3], texel = 1.0 / (double)(map->width > map->height ? map->width : map->height);
    for (int c = 0; c < 3; ++c) {
        origin[c] = (double)ray->origin[c];
        direction[c] = (double)ray->direction[c];
    }
    /* Where the hit itself lies below the surface, that is an error of refinement within a texel, not a miss. */
    double length = sqrt(direction[0] * direction[0] + direction[1] * direction[1]);
    double until =
        hit->status == CONEMAP_HIT ? (double)hit->t_before - (length > 0.0 ? texel / length : 0.0) : (double)hit->t;
    return until > 0.0 && truth_clearance(map, origin, direction, 0.0, until) < -1.0 / 1048576.0;
}

/* Rays of a view of the whole map, one a pixel; directions have length 1 in a world where the map is 1 wide. */
static void view_rays(const struct scene *s, struct rays *rays) {
    const float degree = 3.14159265f / 180;
    float e = s->settings->elevation * degree, a = s->settings->azimuth * degree, depth = s->settings->depth;
    float size_y = (float)s->truth.height / (float)s->truth.width, field = 0.27f;
    float back[3] = {cosf(e) * sinf(a), -cosf(e) * cosf(a), sinf(e)}, right[3] = {cosf(a), sinf(a), 0};
    float up[3] = {-sinf(e) * sinf(a), sinf(e) * cosf(a), cosf(e)};
    float middle[3] = {0.5f, 0.5f * size_y, 0.5f * depth * (float)(s->low + s->high)}, distance = 0.1f;
    for (int round = 0; round < 8; ++round) { /* far enough away for all corners of the box, and centred on them */
        float low = 0, high = 0, needed = 0.1f;
        for (int corner = 0; corner < 8; ++corner) {
            float p[3] = {(corner & 1 ? 1 : 0) - middle[0], (corner & 2 ? size_y : 0) - middle[1],
                          (corner & 4 ? depth * (float)s->high : 0) - middle[2]};
            float x = p[0] * right[0] + p[1] * right[1], y = p[0] * up[0] + p[1] * up[1] + p[2] * up[2];
            float toward = p[0] * back[0] + p[1] * back[1] + p[2] * back[2];
            needed = fmaxf(needed, toward + fmaxf(fabsf(x) * VIEW_H / VIEW_W, fabsf(y)) / (0.97f * field));
            low = fminf(low, y / (distance - toward > 0.1f ? distance - toward : 0.1f));
            high = fmaxf(high, y / (distance - toward > 0.1f ? distance - toward : 0.1f));
        }
        for (int k = 0; k < 3 && round > 0; ++k) middle[k] += 0.5f * distance * (low + high) * up[k];
        distance = needed;
    }
    memset(rays->list, 0, sizeof rays->list);
    rays->count = VIEW;
    snprintf(rays->name, sizeof rays->name, "view %g/%g", (double)s->settings->elevation, (double)s->settings->azimuth);
    for (int n = 0; n < VIEW; ++n) {
        float x = (2.0f * ((float)(n % VIEW_W) + 0.5f) / VIEW_W - 1) * field * VIEW_W / VIEW_H;
        float y = (1 - 2.0f * ((float)(n / VIEW_W) + 0.5f) / VIEW_H) * field, length = 0, d[3], eye[3];
        for (int k = 0; k < 3; ++k) {
            d[k] = right[k] * x + up[k] * y - back[k];
            length += d[k] * d[k];
            eye[k] = middle[k] + back[k] * distance;
        }
        conemap_ray *ray = &rays->list[n];
        ray->origin[0] = eye[0];
        ray->origin[1] = 1 - eye[1] / size_y;
        ray->origin[2] = eye[2] / depth;
        ray->direction[0] = d[0] / sqrtf(length);
        ray->direction[1] = -d[1] / sqrtf(length) / size_y;
        ray->direction[2] = d[2] / sqrtf(length) / depth;
    }
}

static void find_truth(const struct scene *s, struct rays *rays) {
    for (int k = 0; k < rays->count; ++k) rays->meets[k] = true_hit(s, &rays->list[k], &rays->truth[k]);
}

/* A shade for the place where a ray of the view ends: light from the left, and brighter where it is high; 1 is the
   background. */
static float shade(const struct scene *s, const conemap_map *map, const conemap_ray *ray, int meets, double t) {
    conemap_sample sample;
    float u = (float)((double)ray->origin[0] + t * (double)ray->direction[0]);
    float v = (float)((double)ray->origin[1] + t * (double)ray->direction[1]), depth = s->settings->depth;
    float size_y = (float)s->truth.height / (float)s->truth.width;
    if (!meets) return 1.0f;
    u = fminf(fmaxf(u, 0.0f), 1.0f);
    v = fminf(fmaxf(v, 0.0f), 1.0f);
    if (conemap_sample_at(map, u, v, &sample) != CONEMAP_OK) return 1.0f;
    if ((double)sample.height > (double)ray->origin[2] + t * (double)ray->direction[2] + 0.02)
        return 0.12f; /* the block's side */
    float n[3] = {-sample.dhdu * depth, sample.dhdv * depth / size_y, 1};
    float light = (-0.55f * n[0] + 0.25f * n[1] + 0.80f * n[2]) / sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    return 0.15f + 0.30f * fmaxf(light, 0.0f) +
           0.45f * (sample.height - (float)s->low) / (float)(s->high - s->low + 1e-9);
}

static void begin_scene(struct scene *s) {
    size_t texels = (size_t)s->truth.width * (size_t)s->truth.height;
    s->low = s->high = (double)s->truth.heights[0];
    for (size_t k = 0; k < texels; ++k) {
        s->low = fmin(s->low, (double)s->truth.heights[k]);
        s->high = fmax(s->high, (double)s->truth.heights[k]);
    }
    random_rays_from(s->random.list, RAYS, 11u, 5.0f, s->settings->depth);
    s->random.count = RAYS;
    snprintf(s->random.name, sizeof s->random.name, "random 5..85 degrees");
    view_rays(s, &s->view);
    find_truth(s, &s->random);
    find_truth(s, &s->view);
    s->measured = s->settings->camera ? &s->view : &s->random;
}

/* ---- building --------------------------------------------------------------------------------------- */

static struct cones *find_cones(const char *name) {
    for (int k = 0; k < CONES; ++k)
        if (strcmp(kinds[k].name, name) == 0) {
            cones[k].kind = &kinds[k];
            return &cones[k];
        }
    exit(fail("no cones are called '%s'", name) + 1);
}

static void describe(const struct cones *c, const struct image *image, conemap_desc *desc) {
    memset(desc, 0, sizeof *desc);
    desc->heights.pixels = image->pixels;
    desc->heights.format = image->format;
    desc->heights.width = image->width;
    desc->heights.height = image->height;
    desc->generator = c->kind->generator;
    desc->guarantee = c->kind->guarantee;
    desc->slack = c->kind->slack;
    desc->min3x3 = c->kind->min3x3;
    desc->texture.per_cell = c->kind->per_cell;
    desc->texture.sectors = c->kind->sectors;
    desc->texture.format = c->kind->format;
    desc->keep_pyramid = 1;
}

/* What only the maxima take: loading a baked map with them, less loading it without. */
static double pyramid_seconds(const conemap_map *map) {
    size_t size = conemap_save_size(map);
    void *bytes = malloc(size);
    double times[2][ROUNDS];
    conemap_desc desc;
    conemap_map loaded;
    memset(&desc, 0, sizeof desc);
    if (!bytes || conemap_save(map, bytes, size) != CONEMAP_OK) exit(fail("out of memory") + 1);
    for (int r = 0; r < ROUNDS; ++r)
        for (int keep = 0; keep < 2; ++keep) {
            desc.keep_pyramid = keep;
            double start = now();
            if (conemap_load(bytes, size, &desc, &loaded) != CONEMAP_OK) exit(fail("out of memory") + 1);
            times[keep][r] = now() - start;
            conemap_free(&loaded);
        }
    free(bytes);
    return fmax(median(times[1]) - median(times[0]), 1e-6);
}

static void free_cones(void) {
    for (int k = 0; k < CONES; ++k) {
        conemap_free_prepared(&cones[k].prepared);
        conemap_free(&cones[k].map);
        free(cones[k].own);
        cones[k].own = NULL;
        cones[k].built = 0;
    }
}

/* Fills a line of `cones` in; quick ones are built several times, in which the shortest time counts. */
static int build_cones(struct cones *c, const struct image *image) {
    conemap_desc desc;
    double start;
    if (c->built) return 1;
    if (c->kind->from == FROM_BEFORE) {
        const conemap_map *base = &c[-1].map;
        int w = image->width, h = image->height;
        if (!build_cones(find_cones(c->kind[-1].name), image)) return 0;
        c->own = (float *)malloc((size_t)w * (size_t)h * sizeof *c->own);
        if (!c->own) return fail("out of memory");
        start = now();
        for (int y = 0; y < h; ++y)
            for (int x = 0; x < w; ++x) {
                float least = 1e30f;
                for (int j = y > 0 ? y - 1 : 0; j <= y + 1 && j < h; ++j)
                    for (int i = x > 0 ? x - 1 : 0; i <= x + 1 && i < w; ++i)
                        least = fminf(least, base->cones[(size_t)j * (size_t)w + (size_t)i]);
                c->own[(size_t)y * (size_t)w + (size_t)x] = least;
            }
        c->seconds = c[-1].seconds + now() - start;
        describe(c, image, &desc);
        desc.generator = CONEMAP_HEIGHTS;
        conemap_result result = conemap_build(&desc, &c->map);
        if (result != CONEMAP_OK) return fail_result(c->kind->name, result);
        c->map.cones = c->own;
        c->map.info = base->info;
        c->map.info.min3x3 = 1;
    } else {
        describe(c, image, &desc);
        c->seconds = 1e30;
        for (int r = 0; r < ROUNDS && (r == 0 || c->seconds < 0.1); ++r) {
            conemap_free(&c->map);
            start = now();
            conemap_result result = conemap_build(&desc, &c->map);
            c->seconds = fmin(c->seconds, now() - start);
            if (result != CONEMAP_OK) return fail_result(c->kind->name, result);
        }
        if (c->kind->from == HEIGHTS_ONLY) {
            double times[ROUNDS];
            c->seconds = pyramid_seconds(&c->map);
            for (int r = 0; r < ROUNDS; ++r) {
                conemap_free_prepared(&c->prepared);
                start = now();
                conemap_result result = conemap_prepare(&c->map, NULL, &c->prepared);
                times[r] = now() - start;
                if (result != CONEMAP_OK) return fail_result(c->kind->name, result);
            }
            c->prepare_seconds = median(times);
        }
    }
    c->aperture = c->kind->from == HEIGHTS_ONLY ? 0 : mean_tan(&c->map);
    c->bytes = 0;
    for (int k = 0; k < conemap_texture_count(&c->map); ++k)
        c->bytes += (double)conemap_texture_size_at(&c->map, k, 0) / ((double)image->width * (double)image->height);
    c->built = 1;
    return 1;
}

/* ---- measuring -------------------------------------------------------------------------------------- */

static int by_int(const void *a, const void *b) { return *(const int *)a - *(const int *)b; }

static conemap_hit hits[MOST_RAYS];

static int trace(const struct result *r, const struct rays *rays) {
    conemap_trace_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.tracer = r->tracer->tracer;
    desc.refinement = r->method->refinement;
    desc.max_steps = r->method->max_steps;
    conemap_result result = r->tracer->prepared
                                ? conemap_trace_prepared(&r->cones->prepared, rays->list, hits, rays->count)
                                : conemap_trace(&r->cones->map, &desc, rays->list, hits, rays->count);
    return result == CONEMAP_OK ? 1 : fail_result(r->name, result);
}

/* Rays whose steps ran out. */
static int capped(const conemap_hit *hit) { return hit->status == CONEMAP_STEP_CAP; }

/* Everything but times, from the hits of the measured rays and then of the view. */
static int judge(const struct scene *s, struct result *r) {
    static int steps[MOST_RAYS];
    const struct rays *rays = s->measured;
    struct truth_map own =
        s->truth; /* a coarse format's surface is another: its misses are its own, its errors are not */
    double squares = 0, n = rays->count;
    own.heights = r->cones->map.heights;
    r->steps = r->missed = r->unconverged = r->mean_error = r->max_error = 0;
    for (int k = 0; k < rays->count; ++k) {
        const conemap_ray *ray = &rays->list[k];
        double error = fabs((double)hits[k].t - rays->truth[k]) * s->truth.width;
        if (!rays->meets[k] && hits[k].status != CONEMAP_HIT && !capped(&hits[k])) error = 0;
        steps[k] = hits[k].steps;
        r->steps += hits[k].steps / n;
        r->unconverged += capped(&hits[k]) / n;
        r->missed += (!capped(&hits[k]) && is_miss(&own, ray, &hits[k])) / n;
        r->mean_error += error / n;
        r->max_error = fmax(r->max_error, error);
    }
    qsort(steps, (size_t)rays->count, sizeof steps[0], by_int);
    r->steps999 = steps[(int)(0.999 * (n - 1))];
    int cone = r->cones->kind->per_cell ? r->tracer->cones / 4 : r->tracer->cones;
    r->heights = r->tracer->heights * r->steps + r->tracer->more;
    if (r->method->refinement == CONEMAP_REFINE_BISECT) r->heights += 7 * 4;
    r->cone_texels = cone * r->steps;
    r->generation = r->tracer->prepared                         ? r->cones->prepare_seconds
                    : r->tracer->cones                          ? r->cones->seconds
                    : r->tracer->tracer == CONEMAP_TRACE_LINEAR ? 0
                                                                : r->cones->seconds;
    r->bytes = r->cones->bytes;
    r->aperture = r->cones->aperture;
    if (r->tracer->prepared)
        r->bytes = 4 + r->cones->prepared.bytes_per_texel;
    else if (r->cones->kind->from == HEIGHTS_ONLY) { /* heights in f32, and the maxima that are kept */
        r->bytes = 4;
        for (int k = 0; k < r->cones->map.cells.levels && r->tracer->tracer != CONEMAP_TRACE_LINEAR; ++k)
            if (r->cones->map.cells.level[k])
                r->bytes += 4.0 * r->cones->map.cells.width[k] * r->cones->map.cells.height[k] /
                            ((double)s->truth.width * (double)s->truth.height);
    }
    if (!trace(r, &s->view)) return 0;
    for (int k = 0; k < VIEW; ++k) {
        float value = shade(s, &r->cones->map, &s->view.list[k], hits[k].status == CONEMAP_HIT || capped(&hits[k]),
                            (double)hits[k].t);
        squares += pow((double)(value - s->picture[k]), 2);
    }
    r->psnr = squares > 0 ? fmin(99.9, -10 * log10(squares / VIEW)) : 99.9;
    return 1;
}

static const struct tracer *find_tracer(const char *name) {
    for (int k = 0; k < TRACERS; ++k)
        if (strcmp(tracers[k].name, name) == 0) return &tracers[k];
    exit(fail("no tracer is called '%s'", name) + 1);
}

static int same_method(const struct method *a, const struct method *b) {
    return strcmp(a->cones, b->cones) == 0 && strcmp(a->tracer, b->tracer) == 0 && a->refinement == b->refinement &&
           a->max_steps == b->max_steps;
}

/* Every combination that means something. */
static int all_methods(struct method *list) {
    int count = 0;
    for (int c = 0; c < CONES; ++c)
        for (int t = 0; t < TRACERS; ++t)
            for (int refinement = NONE; refinement <= BISECT; ++refinement)
                for (int cap = 0; cap < 3; ++cap) {
                    static const int caps[] = {0, 32, 200};
                    conemap_tracer kind = tracers[t].tracer;
                    int one = kind == CONEMAP_TRACE_EXACT || kind == CONEMAP_TRACE_QDM || kind == CONEMAP_TRACE_MAXMIP;
                    int always = kind == CONEMAP_TRACE_LINEAR || kind == CONEMAP_TRACE_LOOP;
                    if ((kinds[c].from == HEIGHTS_ONLY) != (tracers[t].cones == 0)) continue;
                    if (one && refinement != NONE) continue;
                    if (tracers[t].prepared && cap > 0) continue; /* it knows no caps */
                    if (always ? cap == 0 : kind == CONEMAP_TRACE_FIXED && cap != 0) continue;
                    struct method m = {kinds[c].name, tracers[t].name, (conemap_refinement)refinement, caps[cap], 0};
                    for (int k = 0; k < CHOSEN; ++k)
                        if (same_method(&m, &chosen[k])) m.summary = chosen[k].summary;
                    if (count < MOST) list[count++] = m;
                }
    return count;
}

/* Measures a list of methods: times in interleaved rounds, the rest in the first round. */
static int measure(struct scene *s, const struct method *list, int count, int rounds, struct progress *progress,
                   double from, double to) {
    s->count = count;
    for (int m = 0; m < count; ++m) {
        struct result *r = &s->results[m];
        memset(r, 0, sizeof *r);
        r->method = &list[m];
        r->cones = find_cones(list[m].cones);
        r->tracer = find_tracer(list[m].tracer);
        method_name(r);
        if (!build_cones(r->cones, s->image)) return 0;
        progress_show(from + (to - from) * 0.4 * (m + 1) / count, progress);
    }
    for (int k = 0; k < VIEW; ++k)
        s->picture[k] = shade(s, &cones[0].map, &s->view.list[k], s->view.meets[k], s->view.truth[k]);
    for (int round = 0; round < rounds; ++round)
        for (int m = 0; m < count; ++m) {
            struct result *r = &s->results[m];
            double start = now();
            if (!trace(r, s->measured)) return 0;
            r->seconds[round] = (now() - start) / s->measured->count;
            if (round == 0 && !judge(s, r)) return 0;
            progress_show(from + (to - from) * (0.4 + 0.6 * (round * count + m + 1) / (rounds * count)), progress);
        }
    for (int m = 0; m < count; ++m) s->results[m].time = median_of(s->results[m].seconds, rounds);
    mark_pareto(s->results, count);
    return 1;
}

/* ---- how near our cones come to the widest ------------------------------------------------------------ */

/* The middle of a map. */
static void cut(struct image *image, int size) {
    int w = image->width < size ? image->width : size, h = image->height < size ? image->height : size;
    size_t texel = image_texel_size(image->format), row = (size_t)image->width * texel;
    unsigned char *to = (unsigned char *)image->pixels;
    const unsigned char *from = to + (size_t)((image->height - h) / 2) * row + (size_t)((image->width - w) / 2) * texel;
    for (int y = 0; y < h; ++y) memmove(to + (size_t)y * (size_t)w * texel, from + (size_t)y * row, (size_t)w * texel);
    image->width = w;
    image->height = h;
}

/* Map `index` of those the report is about: the procedural ones, then the elevation model. */
static int open_map(int index, int size, struct image *image, const char **name) {
    struct image_options options;
    memset(&options, 0, sizeof options);
    *name = index < WHITE ? name_of(procedural_names, FBM + index) : "jacksboro";
    if (index < WHITE) return procedural_image(FBM + index, size, 1, image);
    if (!image_read("examples/jacksboro_403x344_16bit.pgm", &options, image)) return 0;
    cut(image, size);
    return 1;
}

static int build_one(const char *name, const struct image *image, conemap_map *map) {
    conemap_desc desc;
    describe(find_cones(name), image, &desc);
    conemap_result result = conemap_build(&desc, map);
    return result == CONEMAP_OK ? 1 : fail_result(name, result);
}

static double steps_of(const conemap_map *map, const struct rays *rays) {
    double steps = 0;
    if (conemap_trace(map, NULL, rays->list, hits, rays->count) != CONEMAP_OK) return 0;
    for (int k = 0; k < rays->count; ++k) steps += hits[k].steps;
    return steps / rays->count;
}

static int report_apertures(struct progress *progress) {
    static const char *const shown[] = {"vertex 3x3", "vertex", "safe", "safe slack .1", "safe slack .5", "safe cells"};
    enum { KINDS = sizeof shown / sizeof shown[0], SAMPLE = 6000, JOINT = 128 };
    static const int sizes[] = {128, 512, 1024};
    static struct rays rays;
    struct image image;
    const char *name;
    random_rays(rays.list, RAYS, 11u);
    rays.count = RAYS;
    puts("Mean of min(tan, 1) of the safe cones over what the true supremum allows, which is bracketed to 1 %\n"
         "by halving pairs of patches (so two ratios: against the widest and the narrowest that the bracket\n"
         "leaves open). The best of a texel is that of the steepest cell that touches it; of a cell its own.\n"
         "Above 128: 6000 texels at random.\n");
    printf("  %-21s %11s %21s %12s %21s\n", "", "bilinear", "of the best", "per cell", "of the best");
    for (int index = 0; index < 5; ++index)
        for (int k = 0; k < 3; ++k) {
            char line[2][64];
            if (index == 4 && k == 1) continue; /* the whole model is smaller */
            if (!open_map(index, sizes[k], &image, &name)) return 0;
            for (int per_cell = 0; per_cell < 2; ++per_cell) {
                struct aperture_report report;
                conemap_map map;
                if (!build_one(per_cell ? "safe cells" : "safe", &image, &map)) return 0;
                if (!aperture_compare(image.width, image.height, map.heights, map.cones, per_cell,
                                      image.width > 128 ? SAMPLE : 0, 0.01, &report))
                    return fail("out of memory");
                snprintf(line[per_cell], sizeof line[per_cell], "%11.5f %9.4f .. %8.4f%s", report.stored,
                         report.stored / report.best_high, report.stored / report.best_low, report.open ? " open" : "");
                conemap_free(&map);
            }
            progress_end(progress);
            printf("  %-9s %4d x %-5d %s %s\n", name, image.width, image.height, line[0], line[1]);
            fflush(stdout);
            progress_show((index * 3 + k + 1) / 60.0, progress);
            image_free(&image);
        }
    puts("\nMean steps a ray of the exact tracer, and the ratio to the 3x3 minimum; in brackets the texels of\n"
         "heights and of cones that the steps read (four and four a step; per cell four and one). 20000 rays at\n"
         "random, 5 to 85 degrees.\n");
    printf("%-10s", "");
    for (int c = 0; c < KINDS; ++c) printf(" %14s", shown[c]);
    puts("");
    for (int index = 0; index < 5; ++index) {
        double steps[KINDS];
        if (!open_map(index, 1024, &image, &name)) return 0;
        for (int c = 0; c < KINDS; ++c) {
            conemap_map map;
            if (!build_one(shown[c], &image, &map)) return 0;
            steps[c] = steps_of(&map, &rays);
            conemap_free(&map);
            progress_show((15 + 4 * index + 4 * (c + 1) / KINDS) / 60.0, progress);
        }
        progress_end(progress);
        printf("%-10s", name);
        for (int c = 0; c < KINDS; ++c) printf(" %7.2f x%5.3f", steps[c], steps[c] / steps[0]);
        printf("\n%-10s", "");
        for (int c = 0; c < KINDS; ++c) {
            char texels[24];
            snprintf(texels, sizeof texels, "(%.0f + %.0f)", 4 * steps[c],
                     (find_cones(shown[c])->kind->per_cell ? 1 : 4) * steps[c]);
            printf(" %14s", texels);
        }
        puts("");
        fflush(stdout);
        image_free(&image);
    }
    puts("\nEXPERIMENT, not in the header: the four corner values of the cells chosen together instead of the\n"
         "steepest touching cell: texels of the safe map raised greedily while no cell's interpolated cone\n"
         "passes its supremum, in 4 x 4 parts a cell. Proven by conemap_verify; it takes about half a\n"
         "millisecond a texel.\n");
    printf("  %-18s %10s %18s %18s %10s %10s\n", "", "3x3 steps", "safe", "raised", "ms/texel", "unsafe");
    for (int index = 0; index < 3; ++index) {
        conemap_map corrected, safe, raised;
        conemap_report report;
        double steps[3], start;
        float *own = (float *)malloc(sizeof(float) * JOINT * JOINT);
        if (!own || !open_map(index, JOINT, &image, &name) || !build_one("vertex 3x3", &image, &corrected) ||
            !build_one("safe", &image, &safe))
            return 0;
        memcpy(own, safe.cones, sizeof(float) * JOINT * JOINT);
        start = now();
        if (!aperture_raise(JOINT, JOINT, safe.heights, own, 4, 0.01)) return fail("out of memory");
        start = now() - start;
        raised = safe;
        raised.cones = own;
        steps[0] = steps_of(&corrected, &rays);
        steps[1] = steps_of(&safe, &rays);
        steps[2] = steps_of(&raised, &rays);
        conemap_verify(&raised.info, raised.heights, raised.cones, NULL, &report);
        progress_show((35 + 8 * index + 8) / 60.0, progress);
        progress_end(progress);
        printf("  %-8s %3d x %-4d %10.2f %10.2f  x%5.3f %10.2f  x%5.3f %10.2f %10ld\n", name, (int)JOINT, (int)JOINT,
               steps[0], steps[1], steps[1] / steps[0], steps[2], steps[2] / steps[0], start * 1e3 / (JOINT * JOINT),
               (long)(report.unsafe + report.unproven));
        fflush(stdout);
        conemap_free(&corrected);
        conemap_free(&safe);
        free(own);
        image_free(&image);
    }
    return 1;
}

/* ---- the planner: fitted, and held against measurements ---------------------------------------------------- */

enum { PLAN_RAYS = 4000, PLANS = CONEMAP__PLAN_ROWS, TERMS = CONEMAP__PLAN_TERMS, PLAN_ROUNDS = 9, FIT_CASES = 216 };

/* One map under one kind of rays: what each line of the planner's table takes there. */
struct plan_case {
    conemap_statistics statistics;
    float depth, lowest;
    float terms[TERMS];
    double n, steps[PLANS], time[PLANS], missed[PLANS], error[PLANS], build[PLANS];
};

static conemap_map plan_maps[PLANS];
static conemap_prepared plan_prepared[PLANS];

static void describe_plan(const conemap__plan_row *row, const struct image *image, conemap_desc *desc) {
    memset(desc, 0, sizeof *desc);
    desc->heights.pixels = image->pixels;
    desc->heights.format = image->format;
    desc->heights.width = image->width;
    desc->heights.height = image->height;
    desc->generator = row->generator;
    desc->guarantee = row->guarantee;
    desc->min3x3 = row->min3x3;
    desc->texture.per_cell = row->per_cell;
    desc->texture.sectors = row->sectors;
    desc->keep_pyramid = 1;
}

/* Builds what the table's lines need; lines of the same cones share a map. build: seconds a texel. */
static int plan_build(const struct image *image, double *build) {
    for (int k = 0; k < PLANS; ++k) {
        const conemap__plan_row *row = &conemap__plan_rows[k];
        conemap_desc desc, other;
        double times[ROUNDS];
        int same = 0, rounds = 0;
        describe_plan(row, image, &desc);
        for (; same < k; ++same) {
            describe_plan(&conemap__plan_rows[same], image, &other);
            if (!row->prepared && !conemap__plan_rows[same].prepared && memcmp(&desc, &other, sizeof desc) == 0) break;
        }
        if (same < k) {
            plan_maps[k] = plan_maps[same];
            build[k] = build[same];
            continue;
        }
        while (rounds < ROUNDS && (rounds == 0 || times[0] < 0.05)) {
            conemap_free_prepared(&plan_prepared[k]);
            conemap_free(&plan_maps[k]);
            double start = now();
            conemap_result result = conemap_build(&desc, &plan_maps[k]);
            if (result == CONEMAP_OK && row->prepared) result = conemap_prepare(&plan_maps[k], NULL, &plan_prepared[k]);
            times[rounds++] = now() - start;
            if (result != CONEMAP_OK) return fail_result("build", result);
        }
        build[k] = median_of(times, rounds) / ((double)image->width * image->height);
    }
    return 1;
}

static void plan_free(void) {
    for (int k = 0; k < PLANS; ++k) {
        for (int n = k + 1; n < PLANS; ++n)
            if (plan_maps[n].heights == plan_maps[k].heights) memset(&plan_maps[n], 0, sizeof plan_maps[n]);
        conemap_free_prepared(&plan_prepared[k]);
        conemap_free(&plan_maps[k]);
    }
}

static void describe_heights(const struct image *image, conemap_heights *heights) {
    memset(heights, 0, sizeof *heights);
    heights->pixels = image->pixels;
    heights->format = image->format;
    heights->width = image->width;
    heights->height = image->height;
}

/* Times are in steps of the default tracer over the default cones on this very map, so that no machine comes in. */
static int plan_measure(const struct image *image, float depth, float lowest, const double *build,
                        struct plan_case *c) {
    static struct rays rays;
    static struct scene s;
    double seconds[PLANS][PLAN_ROUNDS], unit;
    conemap_heights heights;
    describe_heights(image, &heights);
    memset(c, 0, sizeof *c);
    if (conemap_get_statistics(&heights, &c->statistics) != CONEMAP_OK) return fail("no statistics");
    c->depth = depth;
    c->lowest = lowest;
    c->n = (double)conemap__plan_terms(&c->statistics, depth, lowest, c->terms);
    s.truth.width = image->width;
    s.truth.height = image->height;
    s.truth.heights = plan_maps[0].heights;
    s.high = (double)plan_maps[0].highest;
    random_rays_from(rays.list, PLAN_RAYS, 23u, lowest, depth);
    rays.count = PLAN_RAYS;
    find_truth(&s, &rays);
    for (int round = 0; round < PLAN_ROUNDS; ++round)
        for (int k = 0; k < PLANS; ++k) {
            const conemap__plan_row *row = &conemap__plan_rows[k];
            conemap_trace_desc trace;
            memset(&trace, 0, sizeof trace);
            trace.tracer = row->tracer;
            trace.refinement = row->refinement;
            trace.max_steps = row->max_steps;
            double start = now();
            conemap_result result =
                row->prepared ? conemap_trace_prepared(&plan_prepared[k], rays.list, hits, PLAN_RAYS)
                              : conemap_trace(&plan_maps[k], &trace, rays.list, hits, PLAN_RAYS);
            seconds[k][round] = now() - start;
            if (result != CONEMAP_OK) return fail_result("trace", result);
            if (round > 0) continue;
            for (int n = 0; n < PLAN_RAYS; ++n) {
                double error = fabs((double)hits[n].t - rays.truth[n]) * image->width;
                if (!rays.meets[n] && hits[n].status != CONEMAP_HIT && !capped(&hits[n])) error = 0;
                c->steps[k] += (double)hits[n].steps / PLAN_RAYS;
                c->error[k] += error / PLAN_RAYS;
                c->missed[k] += (double)is_miss(&s.truth, &rays.list[n], &hits[n]) / PLAN_RAYS;
            }
        }
    unit = median_of(seconds[0], PLAN_ROUNDS) / (c->steps[0] * PLAN_RAYS);
    for (int k = 0; k < PLANS; ++k) {
        c->time[k] = median_of(seconds[k], PLAN_ROUNDS) / (unit * PLAN_RAYS);
        c->build[k] = build[k] / unit;
    }
    return 1;
}

/* Weights that are not negative for the least sum of squared relative errors, one after the other until they rest. */
static void fit_weights(double (*features)[TERMS], const double *values, int count, int terms, double *weights) {
    for (int k = 0; k < terms; ++k) weights[k] = 0;
    for (int round = 0; round < 3000; ++round)
        for (int k = 0; k < terms; ++k) {
            double wanted = 0, room = 1e-30;
            for (int n = 0; n < count; ++n) {
                double predicted = 0, f = features[n][k] / values[n];
                for (int j = 0; j < terms; ++j) predicted += weights[j] * features[n][j];
                wanted += (1 - predicted / values[n]) * f;
                room += f * f;
            }
            weights[k] = fmax(0, weights[k] + wanted / room);
        }
}

static int zoo_image(int kind, int width, int height, uint32_t seed, struct image *image) {
    image->width = width;
    image->height = height;
    image->format = CONEMAP_F32;
    image->pixels = malloc(sizeof(float) * (size_t)width * (size_t)height);
    if (!image->pixels) return fail("out of memory");
    zoo_fill(kind, width, height, seed, (float *)image->pixels);
    return 1;
}

/* What a line of the table says of one class of maps; returns how far off its steps are as a mean. */
static double fit_class(const struct plan_case *cases, int count, int k, int rough, conemap__plan_fit *fit) {
    static double features[FIT_CASES][TERMS], values[FIT_CASES];
    const conemap__plan_row *row = &conemap__plan_rows[k];
    double weights[TERMS], off = 0;
    int used = 0;
    memset(fit, 0, sizeof *fit);
    for (int n = 0; n < count; ++n) {
        if (conemap__plan_rough(&cases[n].statistics) != rough) continue;
        if (row->max_steps && cases[n].steps[k] > 0.6 * row->max_steps) continue; /* it's the cap that counts there */
        for (int t = 0; t < TERMS; ++t) features[used][t] = (double)cases[n].terms[t];
        values[used++] = fmax(cases[n].steps[k], 0.1);
    }
    fit_weights(features, values, used, TERMS, weights);
    for (int n = 0; n < used; ++n) {
        double predicted = 0;
        for (int t = 0; t < TERMS; ++t) predicted += weights[t] * features[n][t];
        off += fabs(predicted / values[n] - 1) / used;
    }
    for (int t = 0; t < TERMS; ++t) fit->steps[t] = (float)weights[t];
    used = 0;
    for (int n = 0; n < count; ++n) {
        float risk = conemap__plan_risk(row, &cases[n].statistics, (float)cases[n].n);
        if (conemap__plan_rough(&cases[n].statistics) != rough) continue;
        features[used][0] = 1;
        features[used][1] = cases[n].steps[k];
        values[used++] = cases[n].time[k];
        fit->missed = fmaxf(fit->missed, 1.5f * (float)cases[n].missed[k] / risk);
        fit->error = fmaxf(fit->error, 1.5f * (float)cases[n].error[k] / risk);
    }
    fit_weights(features, values, used, 2, weights);
    fit->ray = (float)weights[0];
    fit->step = (float)weights[1];
    if (conemap__plan_sure(row)) fit->missed = fit->error = 0;
    return off;
}

/* The table of conemap.h, PLANS, anew. */
static int fit_planner(struct progress *progress) {
    static const float depths[] = {0.1f, 0.25f, 1}, lowests[] = {5, 20, 45};
    static struct plan_case cases[FIT_CASES];
    static const char *const traced[] = {"",         "EXACT",      "LINEAR",   "FIXED", "LOOP", "EXACT_STEP",
                                          "CELL_MAX", "MAXMIP", "QDM"};
    int count = 0;
    for (int kind = FBM; kind <= WHITE + 2; ++kind)
        for (int size = 64; size <= 512; size *= 2) {
            struct image image;
            double build[PLANS];
            if (kind <= WHITE ? !procedural_image(kind, size, 7, &image)
                              : !zoo_image(kind == WHITE + 1 ? ZOO_BRICKS : ZOO_SADDLE, size, size, 7, &image))
                return 0;
            if (!plan_build(&image, build)) return 0;
            for (int d = 0; d < 3; ++d)
                for (int l = 0; l < 3; ++l) {
                    if (!plan_measure(&image, depths[d], lowests[l], build, &cases[count++])) return 0;
                    progress_show((double)count / FIT_CASES, progress);
                }
            plan_free();
            image_free(&image);
        }
    progress_end(progress);
    puts("static const conemap__plan_row conemap__plan_rows[] = {");
    for (int k = 0; k < PLANS; ++k) {
        const conemap__plan_row *row = &conemap__plan_rows[k];
        double build = 0;
        for (int n = 0; n < count; ++n) build += log(cases[n].build[k]) / count;
        printf("    {CONEMAP_%s, CONEMAP_GUARANTEE_%s, %d, %d, %d, %d, ", row->generator == CONEMAP_HEIGHTS ? "HEIGHTS"
               : row->generator == CONEMAP_QUICK ? "QUICK" : "EXACT",
               row->guarantee == CONEMAP_GUARANTEE_BILINEAR ? "BILINEAR" : "VERTEX", row->min3x3, row->per_cell,
               row->sectors, row->prepared);
        printf("CONEMAP_TRACE_%s, CONEMAP_REFINE_%s, %d, %.1ff,\n", traced[row->tracer],
               row->refinement == CONEMAP_REFINE_SECANT ? "SECANT" : "NONE", row->max_steps, exp(build));
        for (int rough = 0; rough < 2; ++rough) {
            conemap__plan_fit fit;
            double off = fit_class(cases, count, k, rough, &fit);
            printf("     %s{{", rough ? "" : "{");
            for (int t = 0; t < TERMS; ++t) printf("%s%.3ff", t ? ", " : "", (double)fit.steps[t]);
            printf("}, %.2ff, %.2ff, %#.3gf, %#.3gf}%s /* %.0f %% */\n", (double)fit.ray, (double)fit.step,
                   (double)fit.missed, (double)fit.error, rough ? "}}," : ",", off * 100);
        }
    }
    puts("};");
    return 1;
}

struct need {
    const char *name;
    float missed, error;
};

static int plan_meets(const struct plan_case *c, int row, const struct need *need) {
    if (need->missed <= 0 && need->error <= 0) return !(c->missed[row] > 0) && c->error[row] < 1e-3;
    return (!(need->missed > 0) || c->missed[row] <= (double)need->missed) &&
           (!(need->error > 0) || c->error[row] <= (double)need->error);
}

/* Steps and time of a plan: of the line of the table that says the same. */
static int row_of_plan(const conemap_planned *plan) {
    for (int n = 0; n < PLANS; ++n) {
        const conemap__plan_row *r = &conemap__plan_rows[n];
        if (r->generator == plan->generator && r->guarantee == plan->guarantee && r->min3x3 == plan->min3x3 &&
            r->per_cell == plan->texture.per_cell && r->sectors == plan->texture.sectors &&
            r->prepared == plan->prepared && r->tracer == plan->trace.tracer && r->max_steps == plan->trace.max_steps)
            return n;
    }
    return 0;
}

static void plan_name(const conemap_planned *plan, char *name, size_t size) {
    char sectors[16] = "";
    if (plan->texture.sectors > 1) snprintf(sectors, sizeof sectors, " %d", plan->texture.sectors);
    snprintf(name, size, "%s%s%s%s%s", plan->prepared ? "prepared" : name_of(tracer_names, (int)plan->trace.tracer),
             plan->prepared || plan->keep_pyramid || plan->trace.tracer == CONEMAP_TRACE_LINEAR ? ""
             : plan->texture.per_cell                                                           ? ", cells"
             : plan->guarantee == CONEMAP_GUARANTEE_BILINEAR                                    ? ", safe"
             : plan->generator == CONEMAP_QUICK                                                 ? ", quick"
                                                                                                : ", vertex",
             plan->min3x3 ? " 3x3" : "", sectors,
             plan->texture.format == CONEMAP_UNORM8    ? " u8"
             : plan->texture.format == CONEMAP_UNORM16 ? " u16"
                                                       : "");
}

/* Maps that the planner was not fitted on: other seeds, other sizes, the elevation model, and the zoo of the tests. */
static int report_plans(struct progress *progress) {
    static const struct need needs[] = {{"no miss", 0, 0},        {"missed 0.1 %", 0.001f, 0}, {"missed 1 %", 0.01f, 0},
                                        {"missed 10 %", 0.1f, 0}, {"error 0.1", 0, 0.1f},      {"error 1", 0, 1}};
    static const int zoo[] = {ZOO_FBM, ZOO_SPIKES, ZOO_CLIFF, ZOO_CHECKERBOARD};
    enum { NEEDS = sizeof needs / sizeof needs[0], MAPS = 9, WAYS = 3 };
    static const char *const ways[WAYS] = {"every tracer, by statistics", "without the prepared one, by statistics",
                                           "without the prepared one, with trials"};
    double worst[WAYS] = {0}, step_error[WAYS] = {0};
    int broken[WAYS] = {0}, dear[WAYS] = {0}, plans = 0;
    puts("\nThe planner on maps that it was not fitted on, with trials and without the prepared tracer, which it\n"
         "would take everywhere else: prediction / measurement. time: of its choice over the cheapest of its\n"
         "methods that measures within the tolerance. 4000 rays at random, depth 0.25, from 5 degrees up; b:\n"
         "depth 0.5, from 15.\n");
    printf("  %-14s %-12s %-22s %11s %11s %11s %5s\n", "map", "tolerated", "chosen", "steps", "missed %", "error",
           "time");
    for (int m = 0; m < MAPS; ++m) {
        struct image image;
        const char *name;
        double build[PLANS];
        if (m < 5) {
            if (!open_map(m, m < WHITE ? 300 : CONEMAP_MAX_SIZE, &image, &name)) return 0;
        } else {
            if (!zoo_image(zoo[m - 5], 260, 200, 5, &image)) return 0;
            name = zoo_name(zoo[m - 5]);
        }
        if (!plan_build(&image, build)) return 0;
        for (int view = 0; view < 2; ++view) {
            static struct plan_case c;
            conemap_heights heights;
            describe_heights(&image, &heights);
            if (!plan_measure(&image, view ? 0.5f : 0.25f, view ? 15.0f : 5.0f, build, &c)) return 0;
            progress_show((2 * m + view + 1) / (2.0 * MAPS), progress);
            progress_end(progress);
            for (int k = 0; k < NEEDS; ++k, ++plans)
                for (int way = 0; way < WAYS; ++way) {
                    conemap_plan_desc desc;
                    conemap_planned plan;
                    double cheapest = 1e300;
                    char label[64], chosen_name[64];
                    memset(&desc, 0, sizeof desc);
                    desc.statistics = c.statistics;
                    desc.depth = c.depth;
                    desc.lowest_elevation = c.lowest;
                    desc.max_missed = needs[k].missed;
                    desc.max_error = needs[k].error;
                    desc.no_prepared = way > 0;
                    desc.heights = way == 2 ? &heights : NULL;
                    if (conemap_plan(&desc, &plan) != CONEMAP_OK) return fail("no plan");
                    for (int n = 0; n < PLANS; ++n)
                        if (plan_meets(&c, n, &needs[k]) && !(conemap__plan_rows[n].prepared && desc.no_prepared))
                            cheapest = fmin(cheapest, c.time[n]);
                    int row = row_of_plan(&plan), meets = plan_meets(&c, row, &needs[k]);
                    broken[way] += !meets;
                    worst[way] = fmax(worst[way], c.time[row] / cheapest);
                    dear[way] += c.time[row] > 1.25 * cheapest;
                    step_error[way] += fabs((double)plan.steps / c.steps[row] - 1);
                    if (way < 2) continue;
                    snprintf(label, sizeof label, "%s%s", name, view ? " b" : "");
                    plan_name(&plan, chosen_name, sizeof chosen_name);
                    printf("  %-14s %-12s %-22s %5.1f/%5.1f %5.2f/%5.2f %5.2g/%5.2g %5.2f%s\n", k ? "" : label,
                           needs[k].name, chosen_name, (double)plan.steps, c.steps[row], (double)plan.missed * 100,
                           c.missed[row] * 100, (double)plan.error, c.error[row] < 1e-4 ? 0.0 : c.error[row],
                           c.time[row] / cheapest, meets ? "" : " NOT MET");
                }
        }
        plan_free();
        image_free(&image);
    }
    puts("");
    for (int way = 0; way < WAYS; ++way)
        printf("  %s:\n    %d plans: %d break their tolerance; %d cost more than 1.25 of the cheapest,\n"
               "    the dearest %.2f; steps are off by %.0f %% as a mean\n",
               ways[way], plans, broken[way], dear[way], worst[way], step_error[way] * 100 / plans);
    return 1;
}

/* ---- the whole report ------------------------------------------------------------------------------- */

static struct scene scene;

/* The view once more for each method on the sheet, and the truth first. */
static int draw_sheet(struct scene *s, const char *path) {
    enum { COLUMNS = 3, CAPTION = 14, GAP = 6, CELL_W = 2 * VIEW_W + GAP, CELL_H = VIEW_H + CAPTION + GAP };
    int cell = 1, cells = 1;
    struct sheet sheet;
    for (int m = 0; m < s->count; ++m) cells += s->results[m].method->summary > 0;
    sheet.width = COLUMNS * CELL_W + GAP;
    sheet.height = (cells + COLUMNS - 1) / COLUMNS * CELL_H + GAP;
    sheet.pixels = (unsigned char *)malloc((size_t)sheet.width * (size_t)sheet.height * 3);
    if (!sheet.pixels) return fail("out of memory");
    memset(sheet.pixels, 255, (size_t)sheet.width * (size_t)sheet.height * 3);
    put_text(&sheet, GAP, GAP + 2, "TRUTH");
    static const char *const said[] = {
        "MAGENTA: FIRST HIT MISSED,",  "OR STEPS RAN OUT",      "", "RIGHT: STEPS A RAY,",
        "0 BLACK, 64 AND MORE WHITE,", "ON A SQUARE ROOT SCALE"};
    for (int k = 0; k < 6; ++k) put_text(&sheet, GAP + VIEW_W + 16, GAP + 44 + 14 * k, said[k]);
    for (int k = 0; k < VIEW; ++k) {
        double value = (double)s->picture[k];
        put_pixel(&sheet, GAP + k % VIEW_W, GAP + CAPTION + k / VIEW_W, value, value, value);
    }
    for (int m = 0; m < s->count; ++m) {
        struct result *r = &s->results[m];
        struct truth_map own = s->truth;
        char caption[96];
        int x = GAP + cell % COLUMNS * CELL_W, y = GAP + cell / COLUMNS * CELL_H, bad = 0;
        double steps = 0;
        if (r->method->summary == 0) continue;
        ++cell;
        if (!trace(r, &s->view)) return 0;
        own.heights = r->cones->map.heights;
        for (int k = 0; k < VIEW; ++k) {
            int px = x + k % VIEW_W, py = y + CAPTION + k / VIEW_W;
            int wrong = capped(&hits[k]) || is_miss(&own, &s->view.list[k], &hits[k]);
            double value =
                (double)shade(s, &r->cones->map, &s->view.list[k], hits[k].status == CONEMAP_HIT, (double)hits[k].t);
            put_pixel(&sheet, px, py, wrong ? 1 : value, wrong ? 0 : value, wrong ? 1 : value);
            put_heat(&sheet, px + VIEW_W, py, sqrt(hits[k].steps / 64.0));
            bad += wrong;
            steps += hits[k].steps;
        }
        snprintf(caption, sizeof caption, "%d: %s: %.2f %% wrong, %.1f steps", m + 1, r->name, bad * 100.0 / VIEW,
                 steps / VIEW);
        put_text(&sheet, x, y + 3, caption);
    }
    int good = png_write(path, sheet.pixels, sheet.width, sheet.height, 3);
    free(sheet.pixels);
    return good;
}

static struct plotted plotted[5];

/* ---- the fastest that misses nothing ---------------------------------------------------------------- */

static int is_ours(const struct result *r) {
    return r->tracer->prepared || strcmp(r->cones->kind->source, "ours") == 0;
}

/* Of the results of one map; returns whether it is ours, and ahead of the walks over maxima. */
static int print_fastest(const struct result *results, int count) {
    const struct result *best = NULL;
    for (int k = 0; k < count; ++k)
        if (!(results[k].missed > 0) && !(results[k].unconverged > 0) && (!best || results[k].time < best->time))
            best = &results[k];
    if (!best) return 0;
    int good = is_ours(best);
    printf("fastest of no miss: %s (%s)", best->name, good ? "ours" : best->cones->kind->source);
    for (int k = 0; k < count; ++k) {
        conemap_tracer tracer = results[k].tracer->tracer;
        if ((tracer != CONEMAP_TRACE_MAXMIP && tracer != CONEMAP_TRACE_QDM) || results[k].method->max_steps) continue;
        printf("; %s x%.2f, %.3g %% missed", results[k].name, results[k].time / best->time, results[k].missed * 100);
        good &= results[k].time > best->time;
    }
    puts(good ? "" : "  NOT OURS");
    return good;
}

/* The same on the zoo of the tests, small maps that each bring one kind of trouble. */
static int report_zoo(const struct settings *settings, struct progress *progress) {
    static const struct method list[] = {{"none", "prepared", NONE, 0, 0},   {"safe", "exact", NONE, 0, 0},
                                         {"safe cells", "exact", NONE, 0, 0}, {"safe 8", "exact", NONE, 0, 0},
                                         {"none", "maxmip", NONE, 0, 0},      {"none", "qdm", NONE, 0, 0}};
    static struct scene s;
    int good = 0;
    puts("\nThe zoo of the tests, 200 x 160, rays as above:\n");
    for (int kind = 0; kind < ZOO_KINDS; ++kind) {
        struct image image;
        if (!zoo_image(kind, 200, 160, 5, &image)) return 0;
        memset(&s, 0, sizeof s);
        s.name = zoo_name(kind);
        s.settings = settings;
        s.image = &image;
        if (!build_cones(find_cones("none"), &image)) return 0;
        s.truth.width = image.width;
        s.truth.height = image.height;
        s.truth.heights = cones[0].map.heights;
        begin_scene(&s);
        if (!measure(&s, list, (int)(sizeof list / sizeof list[0]), ROUNDS, progress, 0.9, 0.95)) return 0;
        progress_end(progress);
        printf("  %-13s ", s.name);
        good += print_fastest(s.results, s.count);
        fflush(stdout);
        free_cones();
        image_free(&image);
    }
    printf("\n  On %d of %d the fastest method without a miss is ours, ahead of maxmip and of qdm.\n", good,
           (int)ZOO_KINDS);
    return 1;
}

/* What the plots and the summary need of a map. */
static void keep_figures(const struct scene *s, struct plotted *to) {
    memset(to, 0, sizeof *to);
    snprintf(to->name, sizeof to->name, "%s", s->name);
    to->width = s->truth.width;
    to->height = s->truth.height;
    for (int k = 0; k < s->count; ++k) /* of --full only what the usual report shows, or there would be no reading it */
        for (int n = 0; n < CHOSEN; ++n)
            if (same_method(s->results[k].method, &chosen[n]) && to->count < 64) to->results[to->count++] = s->results[k];
    for (int k = 0; k < CONES && to->kinds < 32; ++k)
        if (cones[k].built && kinds[k].from != HEIGHTS_ONLY) {
            to->kind[to->kinds] = kinds[k].name;
            to->generation[to->kinds] = cones[k].seconds * 1e3;
            to->aperture[to->kinds++] = cones[k].aperture;
        }
}

/* Means over the maps of the rows so marked, as README shows them. */
static void print_summary(int maps) {
    double least = 1e300, time[64] = {0}, build = 1e300;
    if (maps < 2) return;
    puts("\nAll maps: times, steps and build times as geometric means; missed and capped rays: the worst map. Ratios: "
         "to the least.\n");
    for (int m = 0; m < plotted[0].count; ++m) {
        for (int k = 0; k < maps; ++k) time[m] += log(plotted[k].results[m].time / plotted[k].results[0].time) / maps;
        time[m] = exp(time[m]);
        if (plotted[0].results[m].method->summary == 1) least = fmin(least, time[m]);
        if (plotted[0].results[m].generation > 0) build = fmin(build, plotted[0].results[m].generation);
    }
    puts("| method | time | steps | build, ms | missed | capped | mean error, texels | PSNR, dB |");
    puts("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for (int m = 0; m < plotted[0].count; ++m) {
        double steps = 0, generation = 0, missed = 0, unconverged = 0, error = 0, psnr = 1e9;
        if (plotted[0].results[m].method->summary != 1) continue;
        for (int k = 0; k < maps; ++k) {
            const struct result *r = &plotted[k].results[m];
            steps += log(r->steps) / maps;
            generation += r->generation > 0 ? log(r->generation * 1e3) / maps : -1e9;
            missed = fmax(missed, r->missed);
            unconverged = fmax(unconverged, r->unconverged);
            error += r->mean_error / maps;
            psnr = fmin(psnr, r->psnr);
        }
        printf("| %s | %.2f | %.1f | %.1f | %.3f %% | %.1f %% | %.2g | %.1f |\n", plotted[0].results[m].name,
               time[m] / least, exp(steps), exp(generation), missed * 100, unconverged * 100, error, psnr);
    }
}

/* ---- the papers' tables ----------------------------------------------------------------------------- */

/* Build times over those of [Dum06]. */
static void print_generation_tables(void) {
    static const struct {
        const char *name, *said;
        double bv24, amd, nvidia; /* [BV24] Table 1; [VB22], 256 x 256 */
    } rows[] = {
        {"none", "[TIS08] maxima", 0.08 / 380, 0.026 / 227, 0.1 / 58.11},
        {"ring", "[Dum06]", 1, 1, 1},
        {"quick", "[VB22] Algorithm 2", 0.35 / 380, 0.028 / 227, 0.088 / 58.11},
        {"center", "[VB22] center", 0, 0.022 / 227, 0.08 / 58.11},
        {"sampled", "[PO07]", 592.0 / 380, 71.0 / 227, 145.15 / 58.11},
        {"relaxed", "[BV24] Algorithm 2", 11.29 / 380, 0, 0},
    };
    const struct cones *base = find_cones("ring");
    puts(
        "\nBuild times over [Dum06]'s: ours (one core), [BV24] Table 1, [VB22]'s table at 256 x 256 on its two GPUs\n");
    printf("  %-20s %10s %10s %10s %10s\n", "", "ours", "[BV24]", "AMD", "NVIDIA");
    for (int k = 0; k < (int)(sizeof rows / sizeof rows[0]); ++k) {
        const struct cones *c = find_cones(rows[k].name);
        if (!c->built) continue;
        printf("  %-20s %10.5f", rows[k].said, c->seconds / base->seconds);
        for (int n = 0; n < 3; ++n) {
            double theirs = n == 0 ? rows[k].bv24 : n == 1 ? rows[k].amd : rows[k].nvidia;
            if (theirs > 0)
                printf(" %10.5f", theirs);
            else
                printf(" %10s", "-");
        }
        puts("");
    }
}

/* [BV24] Table 2 and what its text tells; [VB22]'s table. */
static int report_papers(struct scene *s, struct progress *progress) {
    static const char *const columns[] = {"vertex",  "vertex 3x3",  "quick",   "quick 3x3",
                                          "sampled", "sampled 3x3", "relaxed", "relaxed 3x3"};
    static const double bv24[2][2][2][8] = {
        /* cap, refinement, trace */
        {{{0.59, 0.61, 0.63, 0.65, 0.51, 0.52, 0.58, 0.61}, {0.71, 0.77, 0.84, 0.90, 0.56, 0.57, 0.70, 0.75}},
         {{0.66, 0.69, 0.70, 0.73, 0.57, 0.58, 0.65, 0.68}, {0.76, 0.82, 0.89, 0.94, 0.60, 0.62, 0.75, 0.80}}},
        {{{0.74, 0.81, 0.92, 0.98, 0.57, 0.59, 0.72, 0.78}, {0.79, 0.87, 1.09, 1.24, 0.58, 0.60, 0.77, 0.85}},
         {{0.79, 0.85, 0.98, 1.04, 0.62, 0.64, 0.78, 0.84}, {0.84, 0.92, 1.10, 1.19, 0.62, 0.64, 0.82, 0.89}}}};
    static const struct {
        const char *name;
        double times[2];
    } others[] = {{"linear", {0.56, 1.88}}, {"qdm", {1.84, 2.31}}, {"maxmip", {1.89, 2.83}}};
    static const double vb22[2][2][5] = {/* cap, GPU: BFCM, RCMs, RCMb, QI, QC */
                                         {{0.18, 0.17, 0.19, 0.20, 0.19}, {0.45, 0.41, 0.45, 0.48, 0.46}},
                                         {{0.23, 0.20, 0.21, 0.26, 0.25}, {0.53, 0.46, 0.49, 0.62, 0.59}}};
    static const char *const labels[] = {"[Dum06]", "3x3", "[VB22]", "3x3", "[PO07]", "3x3", "[BV24]", "3x3"};
    static struct method list[80];
    static const int caps[2] = {32, 200};
    int count = 0, at = 0;
    double ours[2][2][2][8], other[3][2], center[2];
    for (int cap = 0; cap < 2; ++cap)
        for (int refine = 0; refine < 2; ++refine)
            for (int tracer = 0; tracer < 2; ++tracer)
                for (int c = 0; c < 8; ++c) {
                    struct method m = {columns[c], tracer ? "cell-max" : "exact-step", refine ? BISECT : SECANT,
                                       caps[cap], 0};
                    list[count++] = m;
                }
    for (int cap = 0; cap < 2; ++cap) {
        struct method m = {"center", "exact-step", SECANT, caps[cap], 0};
        list[count++] = m;
        for (int k = 0; k < 3; ++k) {
            struct method n = {"none", others[k].name, k ? NONE : SECANT, caps[cap], 0};
            list[count++] = n;
        }
    }
    s->measured = &s->view;
    if (!measure(s, list, count, ROUNDS, progress, 0.9, 1)) return 0;
    if (!build_cones(find_cones("ring"), s->image)) return 0;
    progress_end(progress);
    for (int cap = 0; cap < 2; ++cap)
        for (int refine = 0; refine < 2; ++refine)
            for (int tracer = 0; tracer < 2; ++tracer)
                for (int c = 0; c < 8; ++c) ours[cap][refine][tracer][c] = s->results[at++].time;
    for (int cap = 0; cap < 2; ++cap) {
        center[cap] = s->results[at++].time;
        for (int k = 0; k < 3; ++k) other[k][cap] = s->results[at++].time;
    }
    print_generation_tables();
    puts("\n  Where ours differ: our ring search stops as soon as nothing farther out can narrow the cone, which on\n"
         "  rough ground is soon, so that beside it everything else looks dearer than beside a GPU's brute force.");
    printf("\n[BV24] Table 2 as ratios, ours / theirs: to [Dum06] by its own trace, secant, 32 steps. Ours: %s, %s\n\n",
           s->name, s->view.name);
    printf("  %-15s", "");
    for (int c = 0; c < 8; ++c) printf("%10s", labels[c]);
    puts("");
    for (int cap = 0; cap < 2; ++cap)
        for (int refine = 0; refine < 2; ++refine)
            for (int tracer = 0; tracer < 2; ++tracer) {
                printf("  %3d %s %-8s", caps[cap], refine ? "bis" : "sec", tracer ? "cell-max" : "original");
                for (int c = 0; c < 8; ++c)
                    printf(" %4.2f/%4.2f", ours[cap][refine][tracer][c] / ours[0][0][0][0],
                           bv24[cap][refine][tracer][c] / 0.59);
                puts("");
            }
    for (int k = 0; k < 3; ++k)
        printf("  %-8s 32 steps %.2f/%.2f, 200 steps %.2f/%.2f\n", others[k].name, other[k][0] / ours[0][0][0][0],
               others[k].times[0] / 0.59, other[k][1] / ours[0][0][0][0], others[k].times[1] / 0.59);
    puts("\n  Where ours differ: cell-max costs us a few percent and them up to a third, for beside a sample on a CPU a\n"
         "  cell's border is cheap; 200 steps cost us hardly more than 32, for a ray of ours ends when it has hit,\n"
         "  while theirs wait for the slowest of their group; qdm and maxmip cost us up to a third more and them three to\n"
         "  five times as much for the same reason, and for maxima that must be fetched one after the other.");
    puts("\n[VB22]'s table as ratios to brute force (its own trace, secant): ours / AMD / NVIDIA\n");
    printf("  %-10s %18s %18s %18s %18s\n", "", "[PO07] secant", "[PO07] bisection", "Algorithm 2", "center");
    for (int cap = 0; cap < 2; ++cap) {
        double mine[5] = {ours[cap][0][0][0], ours[cap][0][0][4], ours[cap][1][0][4], ours[cap][0][0][2], center[cap]};
        printf("  %3d steps ", caps[cap]);
        for (int c = 1; c < 5; ++c)
            printf("   %4.2f / %4.2f / %4.2f", mine[c] / mine[0], vb22[cap][0][c] / vb22[cap][0][0],
                   vb22[cap][1][c] / vb22[cap][1][0]);
        puts("");
    }
    puts("\n  Where ours differ: our times are steps and nothing else, theirs hold the rest of a frame as well, which\n"
         "  draws their ratios towards 1; and bisection's samples are whole steps on a CPU.");
    return 1;
}

static int report_map(const struct settings *settings, struct image *image, const char *name, const struct method *list,
                      int count, FILE *csv, struct progress *progress, double from, double to) {
    struct scene *s = &scene;
    memset(s, 0, sizeof *s);
    s->name = name;
    s->settings = settings;
    s->image = image;
    if (!build_cones(find_cones("none"), image)) return 0;
    s->truth.width = image->width;
    s->truth.height = image->height;
    s->truth.heights = cones[0].map.heights;
    begin_scene(s);
    if (!measure(s, list, count, settings->full ? FULL_TIMES : TIMES, progress, from, to)) return 0;
    progress_end(progress);
    printf("\n%s, %d x %d, depth %g, %d rays: %s. * nothing is faster and nearer\n", name,
           image->width, image->height, (double)settings->depth, s->measured->count, s->measured->name);
    print_table(s->results, s->count);
    print_fastest(s->results, s->count);
    write_csv(csv, name, image->width, image->height, s->measured->name, s->results, s->count);
    fflush(stdout);
    return 1;
}

/* A file's name for a picture of a map, without what is odd. */
static void sheet_path(const char *name, char *path, size_t size) {
    snprintf(path, size, "out/accuracy-%.40s", name);
    for (char *c = path + 4; *c; ++c)
        if (!((*c >= 'a' && *c <= 'z') || (*c >= 'A' && *c <= 'Z') || (*c >= '0' && *c <= '9') || *c == '-')) *c = '-';
    strncat(path, ".png", size - strlen(path) - 1);
}

int main(int argc, char **argv) {
    static struct method every[MOST];
    static struct settings settings = {NULL, 256, 0, 0, 0, 0, 0, 1, 30, 45, 0.25f};
    struct args args = {argc, 0, argv, "", 0};
    struct progress progress;
    struct image image;
    const struct method *list = chosen;
    int count = CHOSEN;
    program_name = "accuracy";
    while (next_arg(&args)) {
        if (arg_is(&args, "--help") || arg_is(&args, "-h")) return print_help(), 0;
        if (arg_is(&args, "--size"))
            settings.size = arg_int(&args, 8, 4096);
        else if (arg_is(&args, "--full"))
            settings.full = 1;
        else if (arg_is(&args, "--depth"))
            settings.depth = arg_float(&args, 1e-4, 1e3);
        else if (arg_is(&args, "--apertures"))
            settings.apertures = 1;
        else if (arg_is(&args, "--fit"))
            settings.fit = 1;
        else if (arg_is(&args, "--plans"))
            settings.plans = 1;
        else if (arg_is(&args, "--no-pictures"))
            settings.pictures = 0;
        else if (arg_is(&args, "--camera")) {
            settings.camera = 1;
            settings.elevation = arg_float(&args, 1, 89);
            settings.azimuth = arg_float(&args, -360, 360);
        } else if (args.list[args.at][0] != '-' && !settings.file)
            settings.file = args.list[args.at];
        else
            arg_unknown(&args);
    }
    if (args.failed) return 1;
    make_directory("out");
    progress_begin(&progress, "accuracy");
    if (!settings.file && !settings.fit && !settings.plans && !report_apertures(&progress)) return 1;
    if (settings.apertures) return 0;
    if (settings.fit) return !fit_planner(&progress);
    if (settings.plans) return !report_plans(&progress);
    if (settings.full) {
        count = all_methods(every);
        list = every;
    }
    FILE *csv = fopen("out/accuracy.csv", "w");
    if (csv) fputs(csv_head, csv);
    static char paths[5][64];
    const char *sheets[5] = {NULL, NULL, NULL, NULL, NULL};
    int maps = settings.file ? 1 : 5, good = 1;
    for (int k = 0; good && k < maps; ++k) {
        const char *name = settings.file;
        if (name && strrchr(name, '/')) name = strrchr(name, '/') + 1;
        struct image_options options;
        memset(&options, 0, sizeof options);
        good = settings.file ? image_read(settings.file, &options, &image)
                             : open_map(k, k == WHITE ? CONEMAP_MAX_SIZE : settings.size, &image, &name);
        if (!good) break;
        good = report_map(&settings, &image, name, list, count, csv, &progress, 0.9 * k / maps, 0.9 * (k + 1) / maps);
        if (good) keep_figures(&scene, &plotted[k]);
        sheet_path(name, paths[k], sizeof paths[k]);
        if (settings.pictures) sheets[k] = paths[k];
        good = good && (!settings.pictures || draw_sheet(&scene, paths[k]));
        if (good && !settings.file && k == maps - 1) good = report_papers(&scene, &progress);
        free_cones();
        image_free(&image);
    }
    if (csv) fclose(csv);
    if (!good) return 1;
    print_summary(maps);
    if (!settings.file && !report_zoo(&settings, &progress)) return 1;
    if (!settings.file && !report_plans(&progress)) return 1;
    FILE *svg = fopen("out/accuracy.svg", "w"), *html = fopen("out/accuracy.html", "w");
    if (svg) write_svg(svg, plotted, maps);
    if (html) write_html(html, plotted, maps, sheets);
    if (svg) fclose(svg);
    if (html) fclose(html);
    printf("\nout/accuracy.csv, .svg and .html hold all figures%s\n",
           settings.pictures ? ", out/accuracy-*.png the views" : "");
    return !good;
}
