/* A contact sheet of the effects, one to a tile and all together in the last: out/effects.png, or the file named. */
#include "common.h"
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"

#ifndef EFFECTS_SHADE
#define EFFECTS_SHADE conemap_shade /* tests put a shader in its place */
#endif

enum { TILE_W = 320, TILE_H = 240, COLUMNS = 4, SAMPLES = 2, WIDE = TILE_W * SAMPLES };

enum shape { FLOOR, BARREL };

struct tile {
    const char *what;
    enum shape shape;
    int map;                /* 0 bricks, 1 towers, 2 grating */
    unsigned flags;
    float elevation, distance, depth, level;
    int with_ball;          /* a ball in the scene, to cut the relief by depth */
    int checker;            /* colours from a chequered colour map at the displaced uv */
};

static const float degree = 3.14159265f / 180.0f;

/* short names for the table */
enum {
    CLIP = CONEMAP_EFFECT_CLIP,
    HOLES = CONEMAP_EFFECT_HOLES,
    CURVED = CONEMAP_EFFECT_CURVED,
    LOD = CONEMAP_EFFECT_LOD,
    FADE = CONEMAP_EFFECT_FADE,
    TWO_SIDED = CONEMAP_EFFECT_TWO_SIDED,
    NORMAL = CONEMAP_EFFECT_NORMAL,
    SMOOTH = CONEMAP_EFFECT_SMOOTH_NORMAL,
    DEPTH = CONEMAP_EFFECT_DEPTH,
    SHADOW = CONEMAP_EFFECT_SHADOW,
    SOFT_SHADOW = CONEMAP_EFFECT_SOFT_SHADOW,
    OCCLUSION = CONEMAP_EFFECT_OCCLUSION,
    SKY = CONEMAP_EFFECT_SKY,
    UV = CONEMAP_EFFECT_UV
};

static const struct tile tiles[] = {
    {"no effect: heights only", FLOOR, 0, CLIP, 35, 1.9f, 0.08f, 1, 0, 0},
    {"normal: of the bilinear cells", FLOOR, 0, CLIP | NORMAL, 35, 1.9f, 0.08f, 1, 0, 0},
    {"smooth normal: of the stored derivatives", FLOOR, 0, CLIP | SMOOTH, 35, 1.9f, 0.08f, 1, 0, 0},
    {"uv: a chequered colour map, displaced", FLOOR, 0, CLIP | SMOOTH | UV, 35, 1.9f, 0.08f, 1, 0, 1},
    {"shadow: hard", FLOOR, 1, CLIP | SMOOTH | SHADOW, 35, 1.9f, 0.3f, 0, 0, 0},
    {"soft shadow", FLOOR, 1, CLIP | SMOOTH | SOFT_SHADOW, 35, 1.9f, 0.3f, 0, 0, 0},
    {"occlusion: guessed from the cones", FLOOR, 0, CLIP | OCCLUSION, 35, 1.9f, 0.08f, 1, 0, 0},
    {"sky: eight horizons", FLOOR, 0, CLIP | SKY, 35, 1.9f, 0.08f, 1, 0, 0},
    {"depth: a ball cuts the relief", FLOOR, 1, CLIP | SMOOTH | DEPTH | SHADOW, 35, 1.9f, 0.3f, 0, 1, 0},
    {"holes: a grating; rays pass through", FLOOR, 2, CLIP | SMOOTH | HOLES | SHADOW, 50, 1.9f, 0.06f, 0, 0, 0},
    {"curved: a barrel's silhouette", BARREL, 0, SMOOTH | CURVED | SHADOW, 5, 3.4f, 0.09f, 1, 0, 0},
    {"two-sided: a floor from below", FLOOR, 0, CLIP | SMOOTH | TWO_SIDED | SHADOW, -35, 1.9f, 0.08f, 1, 0, 0},
    {"no level of detail: far texels flicker", FLOOR, 0, SMOOTH, 6, 2.0f, 0.05f, 1, 0, 0},
    {"levels of detail", FLOOR, 0, SMOOTH | LOD, 6, 2.0f, 0.05f, 1, 0, 0},
    {"levels of detail and fade (reddish: faded)", FLOOR, 0, SMOOTH | LOD | FADE, 6, 2.0f, 0.05f, 1, 0, 0},
    {"all together", BARREL, 0, SMOOTH | CURVED | HOLES | LOD | FADE | DEPTH | SOFT_SHADOW | SKY | UV, 5, 3.4f, 0.09f,
     1, 1, 1},
};
enum { TILES = sizeof tiles / sizeof tiles[0], ROWS = (TILES + COLUMNS - 1) / COLUMNS, LEVELS = 9 };

struct world {
    conemap_map levels[3][LEVELS];
    int counts[3];
    unsigned char *alpha[3];
};

struct camera {
    float eye[3], right[3], up[3], forward[3], view_projection[16];
};

static float dot(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const float a[3], const float b[3], float c[3]) {
    for (int k = 0; k < 3; ++k) c[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static void unit(float a[3]) {
    float length = sqrtf(dot(a, a));
    for (int k = 0; k < 3; ++k) a[k] /= length;
}

/* Looks at `at` from a distance; reversed infinite depth, as engines use it. */
static void look(struct camera *c, const float at[3], float elevation, float azimuth, float distance) {
    const float near = 0.05f, tan_y = 0.32f, tan_x = tan_y * (float)TILE_W / (float)TILE_H, world_up[3] = {0, 0, 1};
    float e = elevation * degree, a = azimuth * degree, back[3] = {cosf(e) * sinf(a), -cosf(e) * cosf(a), sinf(e)};
    for (int k = 0; k < 3; ++k) {
        c->forward[k] = -back[k];
        c->eye[k] = at[k] + distance * back[k];
    }
    cross(world_up, back, c->right);
    unit(c->right);
    cross(back, c->right, c->up);
    for (int k = 0; k < 3; ++k) {
        c->view_projection[4 * k] = c->right[k] / tan_x;
        c->view_projection[4 * k + 1] = c->up[k] / tan_y;
        c->view_projection[4 * k + 2] = 0;
        c->view_projection[4 * k + 3] = c->forward[k];
    }
    c->view_projection[12] = -dot(c->right, c->eye) / tan_x;
    c->view_projection[13] = -dot(c->up, c->eye) / tan_y;
    c->view_projection[14] = near;
    c->view_projection[15] = -dot(c->forward, c->eye);
    for (int k = 0; k < 3; ++k) {
        c->right[k] *= tan_x;
        c->up[k] *= tan_y;
    }
}

static void camera_ray(const struct camera *c, float x, float y, conemap_ray *ray) {
    memset(ray, 0, sizeof *ray);
    for (int k = 0; k < 3; ++k) {
        ray->origin[k] = c->eye[k];
        ray->direction[k] = c->forward[k] + x * c->right[k] + y * c->up[k];
    }
    unit(ray->direction);
}

/* The frame of a ray's fragment, and where the polygon is; 0 if the ray misses it. */
static int floor_fragment(const struct tile *tile, const conemap_ray *ray, conemap_frame *frame, float *t) {
    memset(frame, 0, sizeof *frame);
    frame->tangent[0] = frame->bitangent[1] = frame->normal[2] = 1;
    frame->depth = tile->depth;
    frame->level = tile->level;
    *t = -ray->origin[2] / ray->direction[2];
    return tile->flags & CLIP ? 1 : *t > 0;
}

static int barrel_fragment(const struct tile *tile, const conemap_ray *ray, conemap_frame *frame, float *t) {
    float a = ray->direction[0] * ray->direction[0] + ray->direction[1] * ray->direction[1];
    float b = ray->origin[0] * ray->direction[0] + ray->origin[1] * ray->direction[1];
    float c = ray->origin[0] * ray->origin[0] + ray->origin[1] * ray->origin[1] - 1, d = b * b - a * c;
    memset(frame, 0, sizeof *frame);
    if (d < 0) return 0;
    *t = (-b - sqrtf(d)) / a;
    float x = ray->origin[0] + *t * ray->direction[0], y = ray->origin[1] + *t * ray->direction[1];
    float z = ray->origin[2] + *t * ray->direction[2];
    frame->origin[0] = frame->normal[0] = x;
    frame->origin[1] = frame->normal[1] = y;
    frame->origin[2] = z;
    frame->tangent[0] = -y;
    frame->tangent[1] = x;
    frame->bitangent[2] = 1;
    frame->uv_scale[0] = frame->uv_scale[1] = 3.0f / 6.2831853f; /* three maps around */
    frame->uv_offset[0] = atan2f(y, x) * frame->uv_scale[0];
    frame->uv_offset[1] = z * frame->uv_scale[1];
    frame->depth = tile->depth;
    frame->level = tile->level;
    frame->curvature[0] = 1;
    return 1;
}

static int fragment(const struct tile *tile, const conemap_ray *ray, conemap_frame *frame, float *t) {
    return tile->shape == FLOOR ? floor_fragment(tile, ray, frame, t) : barrel_fragment(tile, ray, frame, t);
}

/* How uv moves to the neighbours, from two more rays over the tangent plane; zero where they miss it. */
static void footprint(const struct camera *c, const conemap_frame *frame, const conemap_ray *ray, float x, float y,
                      conemap_gradient *gradient) {
    conemap_ray right, below;
    camera_ray(c, x + 2.0f / (float)TILE_W, y, &right);
    camera_ray(c, x, y - 2.0f / (float)TILE_H, &below);
    memset(gradient, 0, sizeof *gradient);
    conemap_gradient_at(frame, ray, &right, &below, gradient);
}

static float clamp01(float x) { return x < 0 ? 0 : x > 1 ? 1 : x; }

/* A chequered map filtered over its footprint by the integral of its sign along each axis. */
static float chequer(const float uv[2], const conemap_gradient *g) {
    float value = 1;
    for (int axis = 0; axis < 2; ++axis) {
        float w = 8 * (axis ? fabsf(g->dvdx) + fabsf(g->dvdy) : fabsf(g->dudx) + fabsf(g->dudy)) + 1e-4f;
        float a = 8 * uv[axis] - 0.5f * w, b = a + w;
        float fa = fabsf(a - 2 * floorf(0.5f * a) - 1), fb = fabsf(b - 2 * floorf(0.5f * b) - 1);
        value *= w > 2 ? 0 : (fb - fa) / w; /* the triangle wave is the integral of the square wave */
    }
    return 0.5f + 0.5f * value;
}

/* A ball: its depth for the depth test, and its colour; depth 0 is infinitely far. */
static float ball(const struct camera *c, const struct tile *tile, const conemap_ray *ray, const float light[3],
                  float color[3]) {
    const float center[2][3] = {{0.56f, 0.42f, 0.1f}, {0.2f, -0.85f, -0.25f}};
    const float *middle = center[tile->shape], radius = tile->shape == FLOOR ? 0.16f : 0.2f;
    float from[3], p[3], n[3], depth = 0;
    for (int k = 0; k < 3; ++k) from[k] = ray->origin[k] - middle[k];
    float b = dot(from, ray->direction), d = b * b - dot(from, from) + radius * radius;
    if (d < 0) return 0;
    for (int k = 0; k < 3; ++k) {
        p[k] = ray->origin[k] + (-b - sqrtf(d)) * ray->direction[k];
        n[k] = (p[k] - middle[k]) / radius;
    }
    float light_on = 0.35f + 0.75f * clamp01(dot(n, light));
    color[0] = 0.15f * light_on;
    color[1] = 0.35f * light_on;
    color[2] = 0.65f * light_on;
    conemap_depth(c->view_projection, p, CONEMAP_DEPTH_ZERO_TO_ONE, &depth);
    return depth;
}

static void shade(const struct tile *tile, const conemap_hit *hit, const conemap_shading *s, const float light[3],
                  float color[3]) {
    const int lit = (tile->flags & (NORMAL | SMOOTH)) != 0;
    const float low[3] = {0.30f, 0.22f, 0.18f}, high[3] = {0.72f, 0.46f, 0.30f};
    float sun = lit ? clamp01(dot(s->normal, light)) : 0, sky = lit ? 0.35f : 0.9f, tone = clamp01(hit->z);
    if (tile->flags & (SHADOW | SOFT_SHADOW)) sun *= s->shadow;
    if (tile->flags & (OCCLUSION | SKY)) sky *= s->occlusion;
    if (tile->checker) tone = 0.2f + 0.8f * chequer(s->uv, &s->gradient);
    for (int k = 0; k < 3; ++k) {
        float albedo = low[k] + (high[k] - low[k]) * tone;
        if (!lit && (tile->flags & (OCCLUSION | SKY))) albedo = 0.8f;
        color[k] = albedo * (sky * (k == 2 ? 1.1f : 0.95f) + 0.95f * sun * (k == 2 ? 0.85f : 1.0f));
    }
    if ((tile->flags & FADE) && !tile->checker) {
        color[1] *= 1 - 0.4f * s->fade;
        color[2] *= 1 - 0.6f * s->fade;
    }
}

static int render_tile(const struct world *w, const struct tile *tile, float *picture) {
    static conemap_ray rays[WIDE];
    static conemap_hit hits[WIDE];
    static conemap_shading shadings[WIDE];
    static conemap_frame frames[WIDE];
    static conemap_gradient gradients[WIDE];
    static int pixel[WIDE];
    static float polygon_t[WIDE];
    const conemap_map *map = &w->levels[tile->map][0];
    const float middles[2][3] = {{0.5f, 0.5f, 0.02f}, {0, 0, 0}};
    float light[3] = {-0.6f, -0.35f, 0.5f};
    struct camera camera;
    conemap_effects e;
    int is_wide = tile->shape == FLOOR && !(tile->flags & CLIP);
    memset(&e, 0, sizeof e);
    look(&camera, middles[tile->shape], tile->elevation, is_wide ? 20.0f : 30.0f, tile->distance);
    if (tile->shape == BARREL) {
        light[0] = -0.8f;
        light[1] = -0.5f;
        light[2] = 0.45f;
    }
    if (tile->elevation < 0) light[2] = -light[2];
    unit(light);
    e.flags = tile->flags;
    e.frames = frames;
    e.frame_per_ray = 1;
    e.gradients = gradients;
    e.levels = w->levels[tile->map];
    e.level_count = w->counts[tile->map];
    e.alpha = w->alpha[tile->map];
    e.view_projection = camera.view_projection;
    e.light_radius = 0.06f;
    memcpy(e.light, light, sizeof light);
    memset(picture, 0, sizeof(float) * 3 * TILE_W * TILE_H);
    for (int row = 0; row < TILE_H * SAMPLES; ++row) {
        int count = 0;
        float y = 1 - 2 * ((float)row + 0.5f) / (float)(TILE_H * SAMPLES);
        float *line = picture + 3 * TILE_W * (row / SAMPLES);
        for (int i = 0; i < WIDE; ++i) {
            float x = 2 * ((float)i + 0.5f) / (float)WIDE - 1, t = 0, color[3];
            conemap_ray *ray = &rays[count];
            camera_ray(&camera, x, y, ray);
            for (int k = 0; k < 3; ++k)
                line[3 * (i / SAMPLES) + k] += (0.42f + 0.2f * y + 0.06f * (float)k) / (float)(SAMPLES * SAMPLES);
            if (!fragment(tile, ray, &frames[count], &t)) {
                if (tile->with_ball && ball(&camera, tile, ray, light, color) > 0)
                    for (int k = 0; k < 3; ++k)
                        line[3 * (i / SAMPLES) + k] +=
                            (color[k] - (0.42f + 0.2f * y + 0.06f * (float)k)) / (float)(SAMPLES * SAMPLES);
                continue;
            }
            if (!(tile->flags & CLIP)) ray->t_min = t; /* the polygon is where the ray begins */
            footprint(&camera, &frames[count], ray, x, y, &gradients[count]);
            polygon_t[count] = t;
            pixel[count++] = i;
        }
        conemap_result result = EFFECTS_SHADE(map, NULL, &e, rays, hits, shadings, count);
        if (result != CONEMAP_OK) return fail_result(tile->what, result);
        for (int n = 0; n < count; ++n) {
            float color[3], ball_color[3], background[3], depth = 0, *to = line + 3 * (pixel[n] / SAMPLES);
            int seen = hits[n].status == CONEMAP_HIT || hits[n].status == CONEMAP_STEP_CAP;
            for (int k = 0; k < 3; ++k) color[k] = background[k] = 0.42f + 0.2f * y + 0.06f * (float)k;
            if (seen) {
                shade(tile, &hits[n], &shadings[n], light, color);
                if (is_wide) /* haze, so that the horizon is no edge */
                    for (int k = 0; k < 3; ++k)
                        color[k] += (background[k] - color[k]) * (1 - expf(-0.0015f * polygon_t[n] * polygon_t[n]));
                depth = shadings[n].depth;
            }
            if (tile->with_ball) {
                float there = ball(&camera, tile, &rays[n], light, ball_color);
                if (there > 0 && (!seen || there > depth)) memcpy(color, ball_color, sizeof color);
            }
            for (int k = 0; k < 3; ++k)
                to[k] += (clamp01(color[k]) - background[k]) / (float)(SAMPLES * SAMPLES);
        }
    }
    return 1;
}

static float smooth_noise(float x, float y) {
    const float turn = 6.2831853f;
    return 0.5f + 0.25f * (sinf(turn * (2 * x + y)) * cosf(turn * (y - x)) + sinf(turn * (x + 3 * y)));
}

/* Gentle ground with towers and domes, for shadows. */
static float towers_at(float x, float y) {
    static const float towers[6][4] = {{0.2f, 0.3f, 0.035f, 1.0f},  {0.45f, 0.62f, 0.06f, 0.75f},
                                       {0.75f, 0.2f, 0.025f, 0.9f}, {0.72f, 0.75f, 0.05f, 0.55f},
                                       {0.22f, 0.8f, 0.02f, 0.85f}, {0.5f, 0.2f, 0.09f, 0.5f}};
    float height = 0.12f + 0.13f * smooth_noise(x, y);
    for (int k = 0; k < 6; ++k) {
        float dx = fabsf(x - towers[k][0]), dy = fabsf(y - towers[k][1]), r = towers[k][2], top = towers[k][3];
        if (k & 1) {
            float d = (dx * dx + dy * dy) / (r * r), dome = d < 1 ? top * sqrtf(1 - d) : 0;
            if (dome > height) height = dome;
        } else if (dx < r && dy < r && top > height) height = top;
    }
    return height;
}

/* A grating for the holes: bars with round tops, and an alpha map that leaves what lies between them away. */
static float grating_at(float x, float y) {
    float a = cosf(x * 6.2831853f * 5), b = cosf(y * 6.2831853f * 4), bar = a > b ? a : b;
    return 0.5f + 0.5f * sqrtf(clamp01(bar));
}

static int own_image(int size, int grating, struct image *image, unsigned char *alpha) {
    uint16_t *heights = (uint16_t *)malloc((size_t)size * (size_t)size * 2);
    if (!heights) return fail("out of memory");
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            float u = ((float)x + 0.5f) / (float)size, v = ((float)y + 0.5f) / (float)size;
            float height = grating ? grating_at(u, v) : towers_at(u, v);
            heights[y * size + x] = (uint16_t)(65535.0f * height);
            if (grating && height < 0.75f) alpha[y * size + x] = 0;
        }
    memset(image, 0, sizeof *image);
    image->pixels = heights;
    image->width = image->height = size;
    image->format = CONEMAP_UNORM16;
    return 1;
}

static int make_world(struct world *w) {
    memset(w, 0, sizeof *w);
    for (int m = 0; m < 3; ++m) {
        struct image image;
        conemap_desc desc;
        const int size = 256;
        w->alpha[m] = (unsigned char *)malloc((size_t)size * (size_t)size);
        if (!w->alpha[m]) return fail("out of memory");
        memset(w->alpha[m], 255, (size_t)size * (size_t)size);
        if (!(m ? own_image(size, m == 2, &image, w->alpha[m]) : procedural_image(BRICKS, size, 3, &image))) return 0;
        if (m == 0) /* one brick has fallen out */
            for (int y = 36; y < 60; ++y)
                for (int x = 100; x < 156; ++x) w->alpha[m][y * size + x] = 0;
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = image.pixels;
        desc.heights.format = image.format;
        desc.heights.width = image.width;
        desc.heights.height = image.height;
        desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
        conemap_result result = conemap_build_levels(&desc, w->levels[m], LEVELS);
        image_free(&image);
        if (result != CONEMAP_OK) return fail_result("levels", result);
        w->counts[m] = LEVELS;
    }
    return 1;
}

int main(int argc, char **argv) {
    static struct world world;
    static float picture[3 * TILE_W * TILE_H];
    static unsigned char sheet[3 * TILE_W * COLUMNS * TILE_H * ROWS];
    const char *path = argc > 1 ? argv[1] : "out/effects.png";
    struct progress progress;
    int good;
    program_name = "effects";
    good = make_world(&world);
    progress_begin(&progress, "effects");
    for (int n = 0; good && n < TILES; ++n) {
        double start = seconds();
        good = render_tile(&world, &tiles[n], picture);
        for (int y = 0; good && y < TILE_H; ++y)
            for (int x = 0; x < TILE_W; ++x)
                for (int k = 0; k < 3; ++k) {
                    size_t line = (size_t)(n / COLUMNS * TILE_H + y), column = (size_t)(n % COLUMNS * TILE_W + x);
                    size_t at = 3 * (line * TILE_W * COLUMNS + column);
                    float value = picture[3 * (y * TILE_W + x) + k];
                    if (x == TILE_W - 1 || y == TILE_H - 1) value = 1; /* a thin line between tiles */
                    sheet[at + (size_t)k] = (unsigned char)(powf(clamp01(value), 1 / 2.2f) * 255 + 0.5f);
                }
        progress_show((n + 1) / (double)TILES, &progress);
        if (good)
            printf("row %d, column %d: %s (%.1f s)\n", n / COLUMNS + 1, n % COLUMNS + 1, tiles[n].what,
                   seconds() - start);
    }
    progress_end(&progress);
    good = good && png_write(path, sheet, TILE_W * COLUMNS, TILE_H * ROWS, 3);
    for (int m = 0; m < 3; ++m) {
        for (int k = 0; k < LEVELS; ++k) conemap_free(&world.levels[m][k]);
        free(world.alpha[m]);
    }
    return good ? 0 : 1;
}
