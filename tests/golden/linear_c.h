// conemap.h: linear tracer.
// linear_trace(origin, direction, size): the first hit of a ray with the relief.
// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the direction.
// size: the map's width and height in texels.
// linear_fetch: the host's; height
#include <math.h>
#include <stdbool.h>


float linear_fetch(int i, int j);

typedef struct linear_vec3 {
    float x, y, z;
} linear_vec3;

typedef struct linear_hit {
    bool found;
    float t;       // in lengths of the direction
    linear_vec3 position; // u, v, z; u and v are not wrapped
    int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap
    int steps;
} linear_hit;

typedef struct linear_ivec2 {
    int x, y;
} linear_ivec2;

typedef struct linear_vec2 {
    float x, y;
} linear_vec2;

static linear_vec2 linear_make_vec2(float x, float y) {
    linear_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static linear_vec2 linear_clip(linear_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return linear_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return linear_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static linear_vec3 linear_make_vec3(float x, float y, float z) {
    linear_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

typedef struct linear_vec4 {
    float x, y, z, w;
} linear_vec4;

static linear_vec4 linear_make_vec4(float x, float y, float z, float w) {
    linear_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static int linear_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static float linear_texel(int i, int j, linear_ivec2 size) {
    return linear_fetch(linear_clampi(i, 0, size.x - 1), linear_clampi(j, 0, size.y - 1));
}

static float linear_mix(linear_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Equal steps.
static linear_hit linear_trace(linear_vec3 origin, linear_vec3 direction, linear_ivec2 size) {
    linear_vec2 range = linear_clip(linear_make_vec2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    range = linear_clip(linear_clip(range, origin.x, direction.x, 0.0f, 1.0f), origin.y, direction.y, 0.0f, 1.0f);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    linear_vec3 v = linear_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    int end_status = 1;
    float stride = (range.y - range.x) / (float)(200);
    float t = 0.0f, dt = range.x, gap = 0.0f, above = 0.0f;
    bool done = range.x > range.y, found = false, ends = false;
    for (; !done && steps < 200 + 1; ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        linear_vec4 heights = linear_make_vec4(linear_texel(i, j, size), linear_texel(i + si, j, size),
                            linear_texel(i, j + sj, size), linear_texel(i + si, j + sj, size));
        float height = linear_mix(heights, x, y);
        above = gap;
        gap = ends && range.y == ground ? fminf(z - height, 0.0f) : z - height;
        found = gap <= 0.0f;
        done = found || ends;
        if (done) break;
        ends = steps + 1 == 200;
        dt = stride;
    }
    bool bracketed = gap <= 0.0f && steps > 0; // between here and dt before
    if (bracketed) {
        dt *= above > gap ? gap / (above - gap) : 0.0f;
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
    }
    linear_hit result;
    result.found = found;
    result.t = t;
    result.position = linear_make_vec3(((float)(i) + (float)(si) * x + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * y + 0.5f) / (float)(size.y), z);
    result.status = result.found ? 0 : done ? end_status : 4;
    result.steps = steps;
    return result;
}
