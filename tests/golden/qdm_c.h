// conemap.h: quadtree displacement tracer.
// qdm_trace(origin, direction, size): the first hit of a ray with the relief.
// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the direction.
// size: the map's width and height in texels.
// qdm_fetch: the host's; height
#include <math.h>
#include <stdbool.h>


float qdm_fetch(int i, int j);
float qdm_maxima(int i, int j, int level);

typedef struct qdm_vec3 {
    float x, y, z;
} qdm_vec3;

typedef struct qdm_hit {
    bool found;
    float t;       // in lengths of the direction
    qdm_vec3 position; // u, v, z; u and v are not wrapped
    int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap
    int steps;
} qdm_hit;

typedef struct qdm_ivec2 {
    int x, y;
} qdm_ivec2;

typedef struct qdm_vec2 {
    float x, y;
} qdm_vec2;

static qdm_vec2 qdm_make_vec2(float x, float y) {
    qdm_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static qdm_vec2 qdm_clip(qdm_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return qdm_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return qdm_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static qdm_vec3 qdm_make_vec3(float x, float y, float z) {
    qdm_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static int qdm_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int qdm_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

// How many cells the block of level k goes on, in the ray's direction, from a cell of it.
static int qdm_ahead(int cell, int count, int k, int s) {
    int low = (cell >> k) << k, high = ((cell >> k) + 1) << k;
    return s < 0 ? cell + 1 - low : (high < count ? high : count) - cell;
}

typedef struct qdm_vec4 {
    float x, y, z, w;
} qdm_vec4;

static qdm_vec4 qdm_make_vec4(float x, float y, float z, float w) {
    qdm_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float qdm_texel(int i, int j, qdm_ivec2 size) {
    return qdm_fetch(qdm_clampi(i, 0, size.x - 1), qdm_repeat(j, size.y));
}

static float qdm_mix(qdm_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// First t in 0..end at which a straight line from clearance c to the one at the end meets 0, or -1.
static float qdm_line_hit(qdm_vec4 h, float x, float y, float z, float c, qdm_vec3 v, float end) {
    float last = z + v.z * end - qdm_mix(h, x + v.x * end, y + v.y * end);
    return c <= 0.0f ? 0.0f : last <= 0.0f ? end * (c / (c - last)) : -1.0f;
}

// Blocks under the ray are left behind whole, others are entered; in a cell a straight line decides.
static qdm_hit qdm_trace(qdm_vec3 origin, qdm_vec3 direction, qdm_ivec2 size) {
    qdm_vec2 range = qdm_clip(qdm_make_vec2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    range = qdm_clip(range, origin.x, direction.x, 0.0f, 1.0f);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    qdm_vec3 v = qdm_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    int end_status = 1;
    float reach_end = range.x + 1048576.0f / (v.x + v.y); // farther than a float can tell cells apart
    if (range.y > reach_end) end_status = 4;
    range.y = fminf(range.y, reach_end);
    int cells_u = size.x + 1, cells_v = size.y, top = 0;
    for (int side = 1; side < cells_u || side < cells_v; side *= 2) ++top;
    int k = top;
    float t = 0.0f, dt = range.x, hit = -1.0f;
    bool done = range.x > range.y;
    for (; !done && steps < 256 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        int cell_u = qdm_clampi(si > 0 ? i + 1 : i, 0, cells_u - 1), cell_v = qdm_repeat(sj > 0 ? j : j - 1, size.y);
        int ahead_u = qdm_ahead(cell_u, cells_u, k, si), ahead_v = qdm_ahead(cell_v, cells_v, k, sj);
        float leave = fminf(((float)(ahead_u) + 0.000001f - x) / v.x, ((float)(ahead_v) + 0.000001f - y) / v.y);
        float left = range.y - t, end = fminf(leave, left), highest = qdm_maxima(cell_u >> k, cell_v >> k, k);
        bool over = fminf(z, z + v.z * end) > highest;
        done = over && leave >= left;
        if (done) break;
        if (over || k > 0) {
            dt = over ? leave : 0.0f;
            float fall = v.z < 0.0f ? (highest - z) / v.z : 0.0f; // to the block's top
            if (!over && fall > 0.0f && fall < end) dt = fall;
            k = !over ? k - 1 : k < top ? k + 1 : top;
            continue;
        }
        qdm_vec4 heights = qdm_make_vec4(qdm_texel(i, j, size), qdm_texel(i + si, j, size),
                            qdm_texel(i, j + sj, size), qdm_texel(i + si, j + sj, size));
        float height = qdm_mix(heights, x, y);
        hit = qdm_line_hit(heights, x, y, z, z - height, v, end);
        done = hit >= 0.0f || leave >= left;
        if (done) break;
        dt = leave;
        k = top > 0 ? 1 : 0;
    }
    if (done && hit < 0.0f && range.y == ground && range.x <= range.y) hit = range.y - t;
    dt = fmaxf(hit, 0.0f);
    qdm_hit result;
    result.found = hit >= 0.0f;
    result.t = t + dt;
    result.position = qdm_make_vec3(((float)(i) + (float)(si) * (x + v.x * dt) + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * (y + v.y * dt) + 0.5f) / (float)(size.y), z + v.z * dt);
    result.status = result.found ? 0 : done ? end_status : 4;
    result.steps = steps;
    return result;
}
