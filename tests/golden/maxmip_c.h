// conemap.h: max-mipmap tracer.
// maxmip_trace(origin, direction, size): the first hit of a ray with the relief.
// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the direction.
// size: the map's width and height in texels.
// maxmip_fetch: the host's; height
#include <math.h>
#include <stdbool.h>


float maxmip_fetch(int i, int j);
float maxmip_maxima(int i, int j, int level);

typedef struct maxmip_vec3 {
    float x, y, z;
} maxmip_vec3;

typedef struct maxmip_hit {
    bool found;
    float t;       // in lengths of the direction
    maxmip_vec3 position; // u, v, z; u and v are not wrapped
    int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap
    int steps;
} maxmip_hit;

typedef struct maxmip_ivec2 {
    int x, y;
} maxmip_ivec2;

typedef struct maxmip_vec2 {
    float x, y;
} maxmip_vec2;

static maxmip_vec2 maxmip_make_vec2(float x, float y) {
    maxmip_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static maxmip_vec2 maxmip_clip(maxmip_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return maxmip_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return maxmip_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static maxmip_vec3 maxmip_make_vec3(float x, float y, float z) {
    maxmip_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static int maxmip_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

// How many cells the block of level k goes on, in the ray's direction, from a cell of it.
static int maxmip_ahead(int cell, int count, int k, int s) {
    int low = (cell >> k) << k, high = ((cell >> k) + 1) << k;
    return s < 0 ? cell + 1 - low : (high < count ? high : count) - cell;
}

typedef struct maxmip_vec4 {
    float x, y, z, w;
} maxmip_vec4;

static maxmip_vec4 maxmip_make_vec4(float x, float y, float z, float w) {
    maxmip_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float maxmip_texel(int i, int j, maxmip_ivec2 size) {
    return maxmip_fetch(maxmip_clampi(i, 0, size.x - 1), maxmip_clampi(j, 0, size.y - 1));
}

static float maxmip_mix(maxmip_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// First t in 0..end at which a ray from (x, y), c above a bilinear patch, meets it, or -1: a root of c + b t + a t t.
static float maxmip_patch_hit(maxmip_vec4 h, float x, float y, float c, maxmip_vec3 v, float end) {
    float hx = h.y - h.x, hy = h.z - h.x, hxy = h.w - h.z - hx;
    float b = v.z - hx * v.x - hy * v.y - hxy * (x * v.y + y * v.x), a = -hxy * v.x * v.y;
    float d = b * b - 4.0f * a * c, root = sqrtf(fmaxf(d, 0.0f));
    float hit = b < 0.0f ? 2.0f * c / (root - b) : a < 0.0f ? -0.5f * (root + b) / a : -1.0f;
    return c <= 0.0f ? 0.0f : d >= 0.0f && hit <= end ? hit : -1.0f;
}

// Blocks under the ray are left behind whole, others are entered; in a cell the patch itself decides.
static maxmip_hit maxmip_trace(maxmip_vec3 origin, maxmip_vec3 direction, maxmip_ivec2 size) {
    maxmip_vec2 range = maxmip_clip(maxmip_make_vec2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    range = maxmip_clip(maxmip_clip(range, origin.x, direction.x, 0.0f, 1.0f), origin.y, direction.y, 0.0f, 1.0f);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    maxmip_vec3 v = maxmip_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    int end_status = 1;
    int cells_u = size.x + 1, cells_v = size.y + 1, top = 0;
    for (int side = 1; side < cells_u || side < cells_v; side *= 2) ++top;
    int k = top;
    float t = 0.0f, dt = range.x, hit = -1.0f;
    bool done = range.x > range.y;
    for (; !done && steps < 16 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        int cell_u = maxmip_clampi(si > 0 ? i + 1 : i, 0, cells_u - 1), cell_v = maxmip_clampi(sj > 0 ? j + 1 : j, 0, cells_v - 1);
        int ahead_u = maxmip_ahead(cell_u, cells_u, k, si), ahead_v = maxmip_ahead(cell_v, cells_v, k, sj);
        float leave = fminf(((float)(ahead_u) + 0.000001f - x) / v.x, ((float)(ahead_v) + 0.000001f - y) / v.y);
        float left = range.y - t, end = fminf(leave, left), highest = maxmip_maxima(cell_u >> k, cell_v >> k, k);
        bool over = fminf(z, z + v.z * end) > highest;
        done = over && leave >= left;
        if (done) break;
        if (over || k > 0) {
            dt = over ? leave : 0.0f;
            k = !over ? k - 1 : k < top ? k + 1 : top;
            continue;
        }
        maxmip_vec4 heights = maxmip_make_vec4(maxmip_texel(i, j, size), maxmip_texel(i + si, j, size),
                            maxmip_texel(i, j + sj, size), maxmip_texel(i + si, j + sj, size));
        float height = maxmip_mix(heights, x, y);
        hit = maxmip_patch_hit(heights, x, y, z - height, v, end);
        done = hit >= 0.0f || leave >= left;
        if (done) break;
        dt = leave;
        k = top > 0 ? 1 : 0;
    }
    if (done && hit < 0.0f && range.y == ground && range.x <= range.y) hit = range.y - t;
    dt = fmaxf(hit, 0.0f);
    maxmip_hit result;
    result.found = hit >= 0.0f;
    result.t = t + dt;
    result.position = maxmip_make_vec3(((float)(i) + (float)(si) * (x + v.x * dt) + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * (y + v.y * dt) + 0.5f) / (float)(size.y), z + v.z * dt);
    result.status = result.found ? 0 : done ? end_status : 4;
    result.steps = steps;
    return result;
}
