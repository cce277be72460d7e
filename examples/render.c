/* Renders a heightmap or a baked cone map in perspective, one ray a sample. */
#include "common.h"
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"
#include "../tests/truth.h"

enum { SHADED, STEPS, UNCONVERGED, DIFFERENCE };
static const struct name mode_names[] = {{"shaded", SHADED},
                                         {"steps", STEPS},
                                         {"unconverged", UNCONVERGED},
                                         {"difference", DIFFERENCE},
                                         {NULL, 0}};

enum { TERRAIN, CLAY, GREY };
static const struct name palette_names[] = {{"terrain", TERRAIN}, {"clay", CLAY}, {"grey", GREY}, {NULL, 0}};

struct rgb {
    float r, g, b;
};

struct scene {
    const conemap_map *map;
    conemap_trace_desc trace;
    int mode, palette, tile, shadows, covered; /* covered: no way to the floor past the surface */
    float depth, size_y;                       /* the map in the world: 1 x size_y x depth */
    float low, high;                           /* of the heights */
    float eye[3], right[3], up[3], back[3], sun[3];
    float tan_x, tan_y, distance;
    float steps_white;
};

static float dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static float clamp01(float x) {
    return x < 0 ? 0 : x > 1 ? 1 : x;
}

static struct rgb mix(struct rgb a, struct rgb b, float t) {
    struct rgb c = {a.r + (b.r - a.r) * t, a.g + (b.g - a.g) * t, a.b + (b.b - a.b) * t};
    return c;
}

static struct rgb scale(struct rgb a, float s) {
    struct rgb c = {a.r * s, a.g * s, a.b * s};
    return c;
}

/* Colours are chosen as a screen shows them, and lit and averaged in linear light. */
static struct rgb linear(float r, float g, float b) {
    struct rgb c = {powf(r, 2.2f), powf(g, 2.2f), powf(b, 2.2f)};
    return c;
}

static unsigned char screen(float x) {
    return (unsigned char)(powf(clamp01(x), 1.0f / 2.2f) * 255.0f + 0.5f);
}

/* Evenly spaced colours, t in 0..1. */
static struct rgb ramp(const float (*colors)[3], int count, float t) {
    float at = clamp01(t) * (float)(count - 1);
    int i = (int)at < count - 2 ? (int)at : count - 2;
    float w = at - (float)i, c[3];
    for (int k = 0; k < 3; ++k) c[k] = colors[i][k] + (colors[i + 1][k] - colors[i][k]) * w;
    return linear(c[0], c[1], c[2]);
}

static struct rgb surface_color(const struct scene *s, float height) {
    static const float terrain[6][3] = {{0.36f, 0.50f, 0.33f}, {0.56f, 0.65f, 0.40f}, {0.80f, 0.76f, 0.53f},
                                        {0.73f, 0.59f, 0.42f}, {0.62f, 0.52f, 0.46f}, {0.96f, 0.95f, 0.94f}};
    static const float clay[3][3] = {{0.44f, 0.37f, 0.34f}, {0.68f, 0.43f, 0.33f}, {0.82f, 0.62f, 0.48f}};
    float t = s->high > s->low ? (height - s->low) / (s->high - s->low) : 0.5f;
    if (s->palette == GREY) return linear(0.78f, 0.78f, 0.78f);
    return s->palette == CLAY ? ramp(clay, 3, t) : ramp(terrain, 6, t);
}

/* Luminance grows all the way, so that more steps always look brighter. */
static struct rgb heat(float t) {
    static const float colors[6][3] = {{0.02f, 0.02f, 0.08f}, {0.25f, 0.07f, 0.38f}, {0.58f, 0.13f, 0.40f},
                                       {0.87f, 0.34f, 0.24f}, {0.97f, 0.66f, 0.20f}, {1.00f, 0.97f, 0.76f}};
    return ramp(colors, 6, t);
}

/* Over a tiled map the horizon is where the haze ends; behind a block it is a backdrop for the picture. */
static struct rgb sky(const struct scene *s, const float direction[3]) {
    static const float open[3][3] = {{0.86f, 0.88f, 0.90f}, {0.66f, 0.77f, 0.89f}, {0.40f, 0.58f, 0.80f}};
    static const float backdrop[2][3] = {{0.95f, 0.94f, 0.92f}, {0.66f, 0.75f, 0.85f}};
    if (s->tile) return ramp(open, 3, 1.5f * direction[2]);
    return ramp(backdrop, 2, 0.5f - 0.5f * dot(direction, s->up) / (dot(direction, s->back) * s->tan_y));
}

/* World: x to the right of the picture of the map, y to its top, z up; so v = 1 - y / size_y. */
static void to_box(const struct scene *s, const float point[3], const float direction[3], conemap_ray *ray) {
    ray->origin[0] = point[0];
    ray->origin[1] = 1.0f - point[1] / s->size_y;
    ray->origin[2] = point[2] / s->depth;
    ray->direction[0] = direction[0];
    ray->direction[1] = -direction[1] / s->size_y;
    ray->direction[2] = direction[2] / s->depth;
    ray->t_min = 0;
    ray->t_max = 0;
}

static void ray_through(const struct scene *s, float x, float y, float direction[3]) {
    float length;
    for (int k = 0; k < 3; ++k)
        direction[k] = s->right[k] * x * s->tan_x + s->up[k] * y * s->tan_y - s->back[k];
    length = sqrtf(dot(direction, direction));
    for (int k = 0; k < 3; ++k) direction[k] /= length;
}

/* A hit just past the border, by rounding, is sampled on it. */
static float on_surface(float x, int size, conemap_wrap wrap) {
    float low = wrap == CONEMAP_NOTHING && size > 1 ? 0.5f / (float)size : 0.0f;
    if (wrap == CONEMAP_WRAP) return x;
    return x < low ? low : x > 1 - low ? 1 - low : x;
}

/* The world's unit normal at a hit, and the height there. */
static float normal_at(const struct scene *s, const conemap_hit *hit, float normal[3]) {
    const conemap_info *info = &s->map->info;
    conemap_sample sample;
    memset(&sample, 0, sizeof sample);
    conemap_sample_at(s->map, on_surface(hit->u, info->width, info->wrap_u),
                      on_surface(hit->v, info->height, info->wrap_v), &sample);
    normal[0] = -sample.dhdu * s->depth;
    normal[1] = sample.dhdv * s->depth / s->size_y;
    normal[2] = 1;
    float length = sqrtf(dot(normal, normal));
    for (int k = 0; k < 3; ++k) normal[k] /= length;
    return sample.height;
}

/* The side of the block that a ray entered through: outward normal of the nearest side. */
static void side_normal(const conemap_hit *hit, float normal[3]) {
    float distance[4] = {fabsf(hit->u), fabsf(1 - hit->u), fabsf(1 - hit->v), fabsf(hit->v)};
    static const float normals[4][3] = {{-1, 0, 0}, {1, 0, 0}, {0, -1, 0}, {0, 1, 0}};
    int nearest = 0;
    for (int k = 1; k < 4; ++k)
        if (distance[k] < distance[nearest]) nearest = k;
    memcpy(normal, normals[nearest], sizeof normals[nearest]);
}

static struct rgb shade(const struct scene *s, const conemap_hit *hit, const float direction[3]) {
    float normal[3], light, lit = 1;
    struct rgb color, background = sky(s, direction), sunlight = {1.05f, 0.96f, 0.82f},
                      skylight = {0.30f, 0.36f, 0.46f};
    if (hit->status == CONEMAP_LEFT || hit->status == CONEMAP_T_MAX || hit->status == CONEMAP_INVALID)
        return background;
    if (hit->status == CONEMAP_FLOOR) return linear(0.30f, 0.29f, 0.28f);
    if (hit->inside && hit->status == CONEMAP_HIT) {
        side_normal(hit, normal);
        color = linear(0.60f, 0.48f, 0.38f);
    } else {
        float height = normal_at(s, hit, normal);
        color = surface_color(s, height);
        if (s->shadows) {
            /* from the surface itself: an unrefined hit can lie well below it */
            float point[3] = {hit->u, (1 - hit->v) * s->size_y, height * s->depth};
            conemap_ray ray;
            conemap_hit blocker;
            conemap_trace_desc exact;
            memset(&exact, 0, sizeof exact);
            exact.tracer = CONEMAP_TRACE_MAXMIP; /* relaxed cones are for descending rays only */
            for (int k = 0; k < 3; ++k) point[k] += normal[k] * 2e-4f;
            to_box(s, point, s->sun, &ray);
            if (conemap_trace(s->map, &exact, &ray, &blocker, 1) == CONEMAP_OK &&
                blocker.status == CONEMAP_HIT)
                lit = 0;
        }
    }
    light = dot(normal, s->sun);
    light = light > 0 ? light * lit : 0;
    float open = 0.65f + 0.35f * normal[2];
    color.r *= sunlight.r * light + skylight.r * open;
    color.g *= sunlight.g * light + skylight.g * open;
    color.b *= sunlight.b * light + skylight.b * open;
    if (s->tile)
        color = mix(color, background, 1 - expf(-0.12f * hit->t * hit->t / (s->distance * s->distance)));
    return color;
}

/* The first meeting in double precision, cell by cell. */
static int true_hit(const struct scene *s, const conemap_ray *ray, double *t) {
    struct truth_map map = {s->map->info.width, s->map->info.height, (int)s->map->info.wrap_u,
                            (int)s->map->info.wrap_v, s->map->heights};
    double origin[3], direction[3];
    for (int k = 0; k < 3; ++k) {
        origin[k] = (double)ray->origin[k];
        direction[k] = (double)ray->direction[k];
    }
    return truth_trace_below(&map, (double)s->high, origin, direction,
                             ray->t_max > 0 ? (double)ray->t_max : HUGE_VAL, t);
}

static void print_help(void) {
    puts(
        "render INPUT -o OUT.png: a perspective view of a heightmap or of a baked .cone file\n\n"
        "Picture\n"
        "  -o FILE                 where the PNG goes (render.png)\n"
        "  --size WxH              in pixels (960x640)\n"
        "  --mode NAME             shaded (default)\n"
        "                          steps: iterations of every ray, dark to bright\n"
        "                          unconverged: shaded, magenta where the steps ran out\n"
        "                          difference: distance from the exact hit, magenta where only one hits\n"
        "  --samples N             N x N rays a pixel (2 in shaded, else 1)\n"
        "  --palette NAME          terrain (default), clay, grey\n"
        "  --no-shadows            do not trace rays to the sun\n"
        "  --steps-white N         mode steps: this many and more are white (so that 0.5 % of the rays are)\n"
        "View\n"
        "  --depth D               height of the relief; the map is 1 wide (0.25)\n"
        "  --elevation A           degrees above the ground, 0..90 (30)\n"
        "  --azimuth A             where the viewer stands: 0 bottom edge of the map, 90 right edge (45)\n"
        "  --distance D            from the middle of the map (all of it in view)\n"
        "  --tile                  repeat the map without end\n"
        "Tracing\n"
        "  --tracer NAME           exact (default; misses nothing), cell-max, linear, fixed, loop, exact-step,\n"
        "                          qdm, maxmip (misses nothing, uses no cones)\n"
        "  --refine NAME           bisect (default), secant, none\n"
        "  --refine-steps N        halvings (7)\n"
        "  --max-steps N           0: linear 200, loop 20, others as many as it takes (0)\n"
        "  --step-scale S          cone steps times this (1)\n"
        "  --adaptive              loop: fewer steps for steep rays");
    print_input_help();
    puts("  --heights FILE          the image of a .cone file that holds cones only");
    print_build_help();
    puts("Examples\n"
         "  render jacksboro_403x344_16bit.pgm -o view.png --azimuth 20 --depth 0.15\n"
         "  render --procedural bricks 512 --tile --depth 0.05 --palette clay -o wall.png\n"
         "  render terrain.cone --mode steps --tracer loop --max-steps 64 -o steps.png");
}

/* Where the viewer stands; a distance of 0 brings the whole box into view. */
static void place_camera(struct scene *s, float elevation, float azimuth, float distance, int width,
                         int height) {
    const float degree = 3.14159265f / 180;
    float e = elevation * degree, a = azimuth * degree;
    float middle[3] = {0.5f, 0.5f * s->size_y, 0.5f * (s->low + s->high) * s->depth};
    s->back[0] = cosf(e) * sinf(a);
    s->back[1] = -cosf(e) * cosf(a);
    s->back[2] = sinf(e);
    s->right[0] = cosf(a);
    s->right[1] = sinf(a);
    s->right[2] = 0;
    s->up[0] = s->back[1] * s->right[2] - s->back[2] * s->right[1];
    s->up[1] = s->back[2] * s->right[0] - s->back[0] * s->right[2];
    s->up[2] = s->back[0] * s->right[1] - s->back[1] * s->right[0];
    s->tan_y = tanf(16 * degree);
    s->tan_x = s->tan_y * (float)width / (float)height;
    s->distance = distance > 0 ? distance : s->tile ? 2 : 0.1f;
    for (int round = 0; round < 8 && !s->tile && distance <= 0; ++round) {
        float needed = 0, x_low = 0, x_high = 0, y_low = 0, y_high = 0;
        for (int pass = 0; pass < 2; ++pass) /* first far enough away for all corners, then centred on them */
            for (int corner = 0; corner < 8; ++corner) {
                float p[3] = {(corner & 1 ? 1 : 0) - middle[0], (corner & 2 ? s->size_y : 0) - middle[1],
                              (corner & 4 ? s->high * s->depth : 0) - middle[2]};
                float x = dot(p, s->right), y = dot(p, s->up), toward = dot(p, s->back);
                float x_room = fabsf(x) / (s->tan_x * 0.92f), y_room = fabsf(y) / (s->tan_y * 0.92f);
                float room = toward + (x_room > y_room ? x_room : y_room);
                if (pass == 0) {
                    needed = room > needed ? room : needed;
                    s->distance = needed > 0.1f ? needed : 0.1f;
                    continue;
                }
                x /= s->distance - toward;
                y /= s->distance - toward;
                x_low = x < x_low ? x : x_low;
                x_high = x > x_high ? x : x_high;
                y_low = y < y_low ? y : y_low;
                y_high = y > y_high ? y : y_high;
                if (corner == 7)
                    for (int k = 0; k < 3; ++k)
                        middle[k] += 0.5f * s->distance *
                                     ((x_low + x_high) * s->right[k] + (y_low + y_high) * s->up[k]);
            }
    }
    for (int k = 0; k < 3; ++k) s->eye[k] = middle[k] + s->back[k] * s->distance;
    /* The sun stands over the viewer's left shoulder, so that relief throws its shadow to the right. */
    float toward_viewer[2] = {sinf(a), -cosf(a)};
    for (int k = 0; k < 2; ++k) s->sun[k] = -0.75f * s->right[k] + 0.30f * toward_viewer[k];
    s->sun[2] = 0.75f;
    float length = sqrtf(dot(s->sun, s->sun));
    for (int k = 0; k < 3; ++k) s->sun[k] /= length;
}

struct totals {
    double steps, difference, worst;
    long rays, hits, unconverged, most_steps, one_only, both;
    long by_steps[4096]; /* rays by their steps; the last counts all from there on */
};

/* Traces the rays of a row of samples, and counts. `found` gets one t a ray: the exact hit's, or below 0. */
static void trace_row(const struct scene *s, int row, int columns, int rows, conemap_ray *rays,
                      conemap_hit *hits, double *exact, struct totals *totals) {
    for (int i = 0; i < columns; ++i) {
        float direction[3];
        ray_through(s, 2 * ((float)i + 0.5f) / (float)columns - 1, 1 - 2 * ((float)row + 0.5f) / (float)rows,
                    direction);
        to_box(s, s->eye, direction, &rays[i]);
        if (s->tile)
            rays[i].t_max = 60 * s->distance; /* the horizon; haze has swallowed everything by then */
    }
    conemap_trace(s->map, &s->trace, rays, hits, columns);
    for (int i = 0; i < columns; ++i) {
        ++totals->rays;
        totals->hits += hits[i].status == CONEMAP_HIT;
        totals->steps += hits[i].steps;
        if (hits[i].steps > totals->most_steps) totals->most_steps = hits[i].steps;
        ++totals->by_steps[hits[i].steps < 4095 ? hits[i].steps : 4095];
        totals->unconverged +=
            hits[i].status == CONEMAP_STEP_CAP || (hits[i].status == CONEMAP_FLOOR && s->covered);
        if (s->mode != DIFFERENCE) continue;
        if (!true_hit(s, &rays[i], &exact[i])) exact[i] = -1;
        if ((exact[i] >= 0) != (hits[i].status == CONEMAP_HIT)) ++totals->one_only;
        else if (exact[i] >= 0) {
            double difference = fabs(exact[i] - (double)hits[i].t) * s->map->info.width;
            totals->difference += difference;
            if (difference > totals->worst) totals->worst = difference;
            ++totals->both;
        }
    }
}

static struct rgb sample_color(const struct scene *s, const conemap_ray *ray, const conemap_hit *hit,
                               double exact) {
    float direction[3] = {ray->direction[0], -ray->direction[1] * s->size_y, ray->direction[2] * s->depth};
    struct rgb magenta = {1, 0, 1};
    if (s->mode == STEPS) return heat((float)hit->steps / s->steps_white);
    if (s->mode == UNCONVERGED &&
        (hit->status == CONEMAP_STEP_CAP || (hit->status == CONEMAP_FLOOR && s->covered)))
        return magenta;
    if (s->mode == DIFFERENCE) {
        if ((exact >= 0) != (hit->status == CONEMAP_HIT)) return magenta;
        struct rgb shaded = shade(s, hit, direction);
        float grey = 0.25f * (0.21f * shaded.r + 0.72f * shaded.g + 0.07f * shaded.b);
        struct rgb dim = {grey, grey, grey}, green = {0.2f, 1, 0.1f};
        if (exact < 0) return dim;
        /* a thousandth of a texel is black, one texel is full green */
        float texels = (float)(fabs(exact - (double)hit->t) * s->map->info.width);
        return mix(dim, green, texels > 1e-3f ? clamp01(1 + log10f(texels) / 3) : 0);
    }
    return shade(s, hit, direction);
}

int main(int argc, char **argv) {
    program_name = "render";
    struct args args = {argc, 0, argv, "", 0};
    struct map_options options = {0};
    struct scene s;
    memset(&s, 0, sizeof s);
    const char *out = "render.png";
    int width = 960, height = 640, samples = 0;
    float elevation = 30, azimuth = 45, distance = 0;
    options.seed = 1;
    s.depth = 0.25f;
    s.shadows = 1;
    s.trace.refinement = CONEMAP_REFINE_BISECT;
    while (next_arg(&args)) {
        if (arg_is(&args, "--help") || arg_is(&args, "-h")) return print_help(), 0;
        if (arg_is(&args, "-o")) out = arg_text(&args);
        else if (arg_is(&args, "--size")) arg_size(&args, 16384, &width, &height);
        else if (arg_is(&args, "--mode")) s.mode = arg_name(&args, mode_names);
        else if (arg_is(&args, "--palette")) s.palette = arg_name(&args, palette_names);
        else if (arg_is(&args, "--samples")) samples = arg_int(&args, 1, 8);
        else if (arg_is(&args, "--no-shadows")) s.shadows = 0;
        else if (arg_is(&args, "--steps-white")) s.steps_white = arg_float(&args, 1, 1e9);
        else if (arg_is(&args, "--depth")) s.depth = arg_float(&args, 1e-4, 1e3);
        else if (arg_is(&args, "--elevation")) elevation = arg_float(&args, 0, 90);
        else if (arg_is(&args, "--azimuth")) azimuth = arg_float(&args, -360, 360);
        else if (arg_is(&args, "--distance")) distance = arg_float(&args, 1e-3, 1e3);
        else if (arg_is(&args, "--tile")) s.tile = 1;
        else if (arg_is(&args, "--tracer")) s.trace.tracer = (conemap_tracer)arg_name(&args, tracer_names);
        else if (arg_is(&args, "--refine"))
            s.trace.refinement = (conemap_refinement)arg_name(&args, refinement_names);
        else if (arg_is(&args, "--refine-steps")) s.trace.refine_steps = arg_int(&args, 1, 64);
        else if (arg_is(&args, "--max-steps")) s.trace.max_steps = arg_int(&args, 0, INT_MAX);
        else if (arg_is(&args, "--step-scale")) s.trace.step_scale = arg_float(&args, 1e-3, 1e3);
        else if (arg_is(&args, "--adaptive")) s.trace.adaptive_steps = 1;
        else if (!map_option(&args, &options)) arg_unknown(&args);
    }
    if (args.failed) return 1;

    conemap_map map;
    if (s.tile && !(options.input && has_extension(options.input, ".cone")))
        options.desc.wrap_u = options.desc.wrap_v = CONEMAP_WRAP;
    if (!map_open(&options, 1, &map)) return 1;
    if (s.tile && (map.info.wrap_u != CONEMAP_WRAP || map.info.wrap_v != CONEMAP_WRAP)) {
        conemap_free(&map);
        return fail("%s was not baked with --wrap wrap: it cannot be tiled", options.input), 1;
    }
    s.map = &map;
    s.size_y = (float)map.info.height / (float)map.info.width;
    s.covered = map.info.wrap_u != CONEMAP_NOTHING && map.info.wrap_v != CONEMAP_NOTHING;
    size_t texels = (size_t)map.info.width * (size_t)map.info.height;
    s.low = s.high = map.heights[0];
    for (size_t i = 1; i < texels; ++i) {
        if (map.heights[i] < s.low) s.low = map.heights[i];
        if (map.heights[i] > s.high) s.high = map.heights[i];
    }
    place_camera(&s, elevation, azimuth, distance, width, height);

    if (!samples) samples = s.mode == SHADED ? 2 : 1;
    int columns = width * samples, rows = height * samples;
    size_t pixels = (size_t)width * (size_t)height;
    unsigned char *picture = (unsigned char *)malloc(pixels * 3);
    conemap_ray *rays = (conemap_ray *)malloc((size_t)columns * sizeof *rays);
    conemap_hit *hits = (conemap_hit *)malloc((size_t)columns * sizeof *hits);
    double *exact = (double *)calloc((size_t)columns, sizeof *exact);
    struct rgb *sums = (struct rgb *)malloc((size_t)width * sizeof *sums);
    int good = picture && rays && hits && exact && sums;
    if (!good) fail("a picture of %d x %d is too large for the memory at hand", width, height);

    static struct totals totals;
    memset(&totals, 0, sizeof totals);
    if (good) { /* one ray tells whether the trace settings are right */
        to_box(&s, s.eye, s.back, rays);
        rays->t_max = 1;
        conemap_result result = conemap_trace(&map, &s.trace, rays, hits, 1);
        good = result == CONEMAP_OK || fail_result("these rays cannot be traced", result);
    }
    double start = seconds();
    struct progress progress;
    progress_begin(&progress, "tracing");
    if (good && s.mode == STEPS && !(s.steps_white > 0)) {
        /* the scale must be known before the first pixel */
        for (int row = 0; row < rows; ++row) trace_row(&s, row, columns, rows, rays, hits, exact, &totals);
        long above = totals.rays / 200;
        int white = 4095;
        while (white > 1 && (above -= totals.by_steps[white]) >= 0) --white;
        s.steps_white = (float)white;
        memset(&totals, 0, sizeof totals);
    }
    for (int y = 0; good && y < height; ++y) {
        memset(sums, 0, (size_t)width * sizeof *sums);
        for (int sub = 0; sub < samples; ++sub) {
            trace_row(&s, y * samples + sub, columns, rows, rays, hits, exact, &totals);
            for (int i = 0; i < columns; ++i) {
                struct rgb color = sample_color(&s, &rays[i], &hits[i], exact[i]), *sum = &sums[i / samples];
                sum->r += clamp01(color.r);
                sum->g += clamp01(color.g);
                sum->b += clamp01(color.b);
            }
        }
        for (int x = 0; x < width; ++x) {
            struct rgb color = scale(sums[x], 1.0f / (float)(samples * samples));
            unsigned char *pixel = picture + 3 * ((size_t)y * (size_t)width + (size_t)x);
            pixel[0] = screen(color.r);
            pixel[1] = screen(color.g);
            pixel[2] = screen(color.b);
        }
        progress_show((y + 1) / (double)height, &progress);
    }
    progress_end(&progress);
    good = good && png_write(out, picture, width, height, 3);
    if (good) {
        printf("%s: %ld rays, %ld hits, %ld unconverged, %.1f steps a ray, %ld at most, %.2f s\n", out,
               totals.rays, totals.hits, totals.unconverged, totals.steps / (double)totals.rays,
               totals.most_steps, seconds() - start);
        if (s.mode == STEPS) printf("black: no steps, white: %g steps or more\n", (double)s.steps_white);
        if (s.mode == DIFFERENCE)
            printf("against the exact hits: %ld rays hit in one only; of the others mean %.3g, worst %.3g "
                   "texels "
                   "apart (full green: 1 texel or more)\n",
                   totals.one_only, totals.both ? totals.difference / (double)totals.both : 0.0,
                   totals.worst);
    }
    free(sums);
    free(exact);
    free(hits);
    free(rays);
    free(picture);
    conemap_free(&map);
    return good ? 0 : 1;
}
