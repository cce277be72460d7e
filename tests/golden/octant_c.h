// conemap.h: exact tracer.
// octant_trace(origin, direction, size): the first hit of a ray with the relief.
// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the direction.
// size: the map's width and height in texels.
// octant_fetch: the host's; height
// octant_cones: the host's; the cone as stored, for a sector
#include <math.h>
#include <stdbool.h>


float octant_fetch(int i, int j);
float octant_cones(int i, int j, int sector);

typedef struct octant_vec3 {
    float x, y, z;
} octant_vec3;

typedef struct octant_hit {
    bool found;
    float t;       // in lengths of the direction
    octant_vec3 position; // u, v, z; u and v are not wrapped
    int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap
    int steps;
} octant_hit;

typedef struct octant_ivec2 {
    int x, y;
} octant_ivec2;

typedef struct octant_vec2 {
    float x, y;
} octant_vec2;

static octant_vec2 octant_make_vec2(float x, float y) {
    octant_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static octant_vec2 octant_clip(octant_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return octant_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return octant_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static octant_vec3 octant_make_vec3(float x, float y, float z) {
    octant_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

typedef struct octant_vec4 {
    float x, y, z, w;
} octant_vec4;

static octant_vec4 octant_make_vec4(float x, float y, float z, float w) {
    octant_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static int octant_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static int octant_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static float octant_texel(int i, int j, octant_ivec2 size) {
    return octant_fetch(octant_repeat(i, size.x), octant_clampi(j, 0, size.y - 1));
}

static float octant_mix(octant_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// The cone as stored, for rays of a sector: see octant_sector of conemap.h.
static float octant_cone(int i, int j, int sector, octant_ivec2 size) {
    return octant_cones(octant_repeat(i, size.x), octant_clampi(j, 0, size.y - 1), sector);
}

// First t in 0..end at which a ray from (x, y), c above a bilinear patch, meets it, or -1: a root of c + b t + a t t.
static float octant_patch_hit(octant_vec4 h, float x, float y, float c, octant_vec3 v, float end) {
    float hx = h.y - h.x, hy = h.z - h.x, hxy = h.w - h.z - hx;
    float b = v.z - hx * v.x - hy * v.y - hxy * (x * v.y + y * v.x), a = -hxy * v.x * v.y;
    float d = b * b - 4.0f * a * c, root = sqrtf(fmaxf(d, 0.0f));
    float hit = b < 0.0f ? 2.0f * c / (root - b) : a < 0.0f ? -0.5f * (root + b) / a : -1.0f;
    return c <= 0.0f ? 0.0f : d >= 0.0f && hit <= end ? hit : -1.0f;
}

// The tangent that a stored radius stands for, over a height.
static float octant_tangent(float stored, float height) {
    float top = 1.0f - height;
    return stored < 1.0f * top ? stored / top : top > 0.0f ? 1.0f : 0.0f;
}

// Cone steps; in every cell that the ray enters it is met with the bilinear patch itself.
static octant_hit octant_trace(octant_vec3 origin, octant_vec3 direction, octant_ivec2 size) {
    octant_vec2 range = octant_clip(octant_make_vec2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    range = octant_clip(range, origin.y, direction.y, 0.0f, 1.0f);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    octant_vec3 v = octant_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    int sector = (direction.x < 0.0f ? 1 : 0) + (direction.y < 0.0f ? 2 : 0);
    if (v.y > v.x) sector += 4;
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    int end_status = 1;
    float reach_end = range.x + 1048576.0f / (v.x + v.y); // farther than a float can tell cells apart
    if (range.y > reach_end) end_status = 4;
    range.y = fminf(range.y, reach_end);
    float t = 0.0f, dt = range.x, hit = -1.0f, speed = sqrtf(direction.x * direction.x + direction.y * direction.y);
    bool done = range.x > range.y;
    for (; !done && steps < 64 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        octant_vec4 heights = octant_make_vec4(octant_texel(i, j, size), octant_texel(i + si, j, size),
                            octant_texel(i, j + sj, size), octant_texel(i + si, j + sj, size));
        float height = octant_mix(heights, x, y);
        octant_vec4 cones = octant_make_vec4(octant_cone(i, j, sector, size),
                          octant_cone(i + si, j, sector, size),
                          octant_cone(i, j + sj, sector, size),
                          octant_cone(i + si, j + sj, sector, size));
        float cone = octant_mix(cones, x, y);
        float leave = fminf((1.000001f - x) / v.x, (1.000001f - y) / v.y), left = range.y - t; // just over the border
        hit = octant_patch_hit(heights, x, y, z - height, v, fminf(leave, left));
        float gap = z - height - 1.0f / 1048576.0f, closing = speed - octant_tangent(cone, height) * v.z; // to an apex raised by more than rounding
        dt = fmaxf(leave, gap <= 0.0f ? 0.0f : closing > 0.0f ? octant_tangent(cone, height) * gap / closing : 1e30f);
        done = hit >= 0.0f || dt >= left;
    }
    if (done && hit < 0.0f && range.y == ground && range.x <= range.y) hit = range.y - t;
    dt = fmaxf(hit, 0.0f);
    octant_hit result;
    result.found = hit >= 0.0f;
    result.t = t + dt;
    result.position = octant_make_vec3(((float)(i) + (float)(si) * (x + v.x * dt) + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * (y + v.y * dt) + 0.5f) / (float)(size.y), z + v.z * dt);
    result.status = result.found ? 0 : done ? end_status : 4;
    result.steps = steps;
    return result;
}
