// conemap.h: cell-max tracer.
// cellmax_trace(origin, direction, size): the first hit of a ray with the relief.
// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the direction.
// size: the map's width and height in texels.
// cellmax_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct cellmax_vec2 {
    float x, y;
} cellmax_vec2;

cellmax_vec2 cellmax_fetch(int i, int j);

typedef struct cellmax_vec3 {
    float x, y, z;
} cellmax_vec3;

typedef struct cellmax_hit {
    bool found;
    float t;       // in lengths of the direction
    cellmax_vec3 position; // u, v, z; u and v are not wrapped
    int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap
    int steps;
} cellmax_hit;

typedef struct cellmax_ivec2 {
    int x, y;
} cellmax_ivec2;

static cellmax_vec2 cellmax_make_vec2(float x, float y) {
    cellmax_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static cellmax_vec2 cellmax_clip(cellmax_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return cellmax_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return cellmax_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static cellmax_vec3 cellmax_make_vec3(float x, float y, float z) {
    cellmax_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static int cellmax_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static cellmax_vec2 cellmax_texel(int i, int j, cellmax_ivec2 size) {
    return cellmax_fetch(cellmax_clampi(i, 0, size.x - 1), cellmax_clampi(j, 0, size.y - 1));
}

typedef struct cellmax_vec4 {
    float x, y, z, w;
} cellmax_vec4;

static cellmax_vec4 cellmax_make_vec4(float x, float y, float z, float w) {
    cellmax_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float cellmax_mix(cellmax_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// How long the ray flies inside a cone whose apex lies `gap` below it.
static float cellmax_cone_step(float tangent, float gap, float speed, float vz) {
    float closing = speed - tangent * vz;
    if (speed == 0.0f) return vz < 0.0f ? (gap + 1e-6f) / -vz : 1e30f;
    return closing > 0.0f ? tangent * gap / closing : 1e30f;
}

// To the end of the cone or of the cell, whichever is farther, until the ray is below the surface.
static cellmax_hit cellmax_trace(cellmax_vec3 origin, cellmax_vec3 direction, cellmax_ivec2 size) {
    cellmax_vec2 range = cellmax_clip(cellmax_make_vec2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    range = cellmax_clip(cellmax_clip(range, origin.x, direction.x, 0.0f, 1.0f), origin.y, direction.y, 0.0f, 1.0f);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    cellmax_vec3 v = cellmax_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    int end_status = 1;
    float t = 0.0f, dt = range.x, gap = 0.0f, speed = sqrtf(direction.x * direction.x + direction.y * direction.y), above = 0.0f;
    bool done = range.x > range.y, found = false, ends = false;
    for (; !done && steps < 4 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        cellmax_vec2 a = cellmax_texel(i, j, size), b = cellmax_texel(i + si, j, size);
        cellmax_vec2 c = cellmax_texel(i, j + sj, size), d = cellmax_texel(i + si, j + sj, size);
        cellmax_vec4 heights = cellmax_make_vec4(a.x, b.x, c.x, d.x);
        float height = cellmax_mix(heights, x, y);
        float cone = sj > 0 ? (si > 0 ? a.y : b.y) : si > 0 ? c.y : d.y;
        above = gap;
        gap = ends && range.y == ground ? fminf(z - height, 0.0f) : z - height;
        found = gap <= 0.0f;
        done = found || ends;
        if (done) break;
        dt = cellmax_cone_step(cone, gap, speed, v.z);
        if (speed > 0.0f) dt = fmaxf(dt, fminf((1.000001f - x) / v.x, (1.000001f - y) / v.y));
        ends = dt >= range.y - t;
        if (ends) dt = range.y - t;
    }
    bool bracketed = gap <= 0.0f && steps > 0; // between here and dt before
    if (bracketed) {
        dt *= above > gap ? gap / (above - gap) : 0.0f;
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
    }
    cellmax_hit result;
    result.found = found;
    result.t = t;
    result.position = cellmax_make_vec3(((float)(i) + (float)(si) * x + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * y + 0.5f) / (float)(size.y), z);
    result.status = result.found ? 0 : done ? end_status : 4;
    result.steps = steps;
    return result;
}
