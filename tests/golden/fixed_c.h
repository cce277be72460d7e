// conemap.h: fixed tracer.
// fixed_trace(origin, direction, size): the first hit of a ray with the relief.
// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the direction.
// size: the map's width and height in texels.
// fixed_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct fixed_vec2 {
    float x, y;
} fixed_vec2;

fixed_vec2 fixed_fetch(int i, int j);

typedef struct fixed_vec3 {
    float x, y, z;
} fixed_vec3;

typedef struct fixed_hit {
    bool found;
    float t;       // in lengths of the direction
    fixed_vec3 position; // u, v, z; u and v are not wrapped
    int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap
    int steps;
} fixed_hit;

typedef struct fixed_ivec2 {
    int x, y;
} fixed_ivec2;

static fixed_vec2 fixed_make_vec2(float x, float y) {
    fixed_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static fixed_vec2 fixed_clip(fixed_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return fixed_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return fixed_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static fixed_vec3 fixed_make_vec3(float x, float y, float z) {
    fixed_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static int fixed_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static fixed_vec2 fixed_texel(int i, int j, fixed_ivec2 size) {
    return fixed_fetch(fixed_clampi(i, 0, size.x - 1), fixed_clampi(j, 0, size.y - 1));
}

typedef struct fixed_vec4 {
    float x, y, z, w;
} fixed_vec4;

static fixed_vec4 fixed_make_vec4(float x, float y, float z, float w) {
    fixed_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float fixed_mix(fixed_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// How long the ray flies inside a cone whose apex lies `gap` below it.
static float fixed_cone_step(float tangent, float gap, float speed, float vz) {
    float closing = speed - tangent * vz;
    if (speed == 0.0f) return vz < 0.0f ? (gap + 1e-6f) / -vz : 1e30f;
    return closing > 0.0f ? tangent * gap / closing : 1e30f;
}

// A number of cone steps without a test in between.
static fixed_hit fixed_trace(fixed_vec3 origin, fixed_vec3 direction, fixed_ivec2 size) {
    fixed_vec2 range = fixed_clip(fixed_make_vec2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    range = fixed_clip(fixed_clip(range, origin.x, direction.x, 0.0f, 1.0f), origin.y, direction.y, 0.0f, 1.0f);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    fixed_vec3 v = fixed_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    int end_status = 1;
    float t = 0.0f, dt = range.x, gap = 0.0f, speed = sqrtf(direction.x * direction.x + 2.5e-1f * direction.y * direction.y);
    bool done = range.x > range.y, found = false, ends = false;
    for (; !done && steps < 10 + 1; ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        fixed_vec2 a = fixed_texel(i, j, size), b = fixed_texel(i + si, j, size);
        fixed_vec2 c = fixed_texel(i, j + sj, size), d = fixed_texel(i + si, j + sj, size);
        fixed_vec4 heights = fixed_make_vec4(a.x, b.x, c.x, d.x);
        float height = fixed_mix(heights, x, y);
        float cone = fixed_mix(fixed_make_vec4(a.y, b.y, c.y, d.y), x, y);
        gap = ends && range.y == ground ? fminf(z - height, 0.0f) : z - height;
        found = gap <= 3.90625e-3f;
        if (steps + 1 == 10 + 1 || (steps == 0 && gap <= 0.0f)) break; // it begins inside
        dt = fmaxf(fixed_cone_step(cone, gap, speed, v.z), range.x - t);
        ends = dt >= range.y - t;
        if (ends) dt = range.y - t;
    }
    done = ends;
    fixed_hit result;
    result.found = found;
    result.t = t;
    result.position = fixed_make_vec3(((float)(i) + (float)(si) * x + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * y + 0.5f) / (float)(size.y), z);
    result.status = result.found ? 0 : done ? end_status : 4;
    result.steps = steps;
    return result;
}
