// conemap.h: exact tracer.
// back_trace(origin, direction, size): the first hit of a ray with the relief.
// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the direction.
// size: the map's width and height in texels.
// back_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct back_vec2 {
    float x, y;
} back_vec2;

back_vec2 back_fetch(int i, int j);

typedef struct back_vec3 {
    float x, y, z;
} back_vec3;

typedef struct back_hit {
    bool found;
    float t;       // in lengths of the direction
    back_vec3 position; // u, v, z; u and v are not wrapped
    int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap
    int steps;
} back_hit;

typedef struct back_ivec2 {
    int x, y;
} back_ivec2;

static back_vec2 back_make_vec2(float x, float y) {
    back_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static back_vec2 back_clip(back_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return back_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return back_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static back_vec3 back_make_vec3(float x, float y, float z) {
    back_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static int back_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static int back_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static back_vec2 back_texel(int i, int j, back_ivec2 size) {
    return back_fetch(back_repeat(i, size.x), back_clampi(j, 0, size.y - 1));
}

typedef struct back_vec4 {
    float x, y, z, w;
} back_vec4;

static back_vec4 back_make_vec4(float x, float y, float z, float w) {
    back_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float back_mix(back_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// First t in 0..end at which a ray from (x, y), c above a bilinear patch, meets it, or -1: a root of c + b t + a t t.
static float back_patch_hit(back_vec4 h, float x, float y, float c, back_vec3 v, float end) {
    float hx = h.y - h.x, hy = h.z - h.x, hxy = h.w - h.z - hx;
    float b = v.z - hx * v.x - hy * v.y - hxy * (x * v.y + y * v.x), a = -hxy * v.x * v.y;
    float d = b * b - 4.0f * a * c, root = sqrtf(fmaxf(d, 0.0f));
    float hit = b < 0.0f ? 2.0f * c / (root - b) : a < 0.0f ? -0.5f * (root + b) / a : -1.0f;
    return c <= 0.0f ? 0.0f : d >= 0.0f && hit <= end ? hit : -1.0f;
}

// Cone steps; in every cell that the ray enters it is met with the bilinear patch itself.
static back_hit back_trace(back_vec3 origin, back_vec3 direction, back_ivec2 size) {
    back_vec2 range = back_clip(back_make_vec2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    back_vec2 box = range; // it says how a ray ends that meets nothing
    box = back_clip(box, origin.y, direction.y, 0.0f, 1.0f);
    float rim_v = size.y > 1 ? 0.5f / (float)(size.y) : 0.0f;
    range = back_clip(range, origin.y, direction.y, rim_v, 1.0f - rim_v);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    back_vec3 v = back_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    int end_status = box.x > box.y ? 1 : box.y == ground ? 2 : 1;
    float reach_end = range.x + 1048576.0f / (v.x + v.y); // farther than a float can tell cells apart
    if (range.y > reach_end) end_status = 4;
    range.y = fminf(range.y, reach_end);
    float t = 0.0f, dt = range.x, hit = -1.0f, speed = sqrtf(direction.x * direction.x + direction.y * direction.y), flown = 0.0f, walked = -1.0f;
    bool done = range.x > range.y;
    for (; !done && steps < 64 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        back_vec2 a = back_texel(i, j, size), b = back_texel(i + si, j, size);
        back_vec2 c = back_texel(i, j + sj, size), d = back_texel(i + si, j + sj, size);
        back_vec4 heights = back_make_vec4(a.x, b.x, c.x, d.x);
        float height = back_mix(heights, x, y);
        float cone = back_mix(back_make_vec4(a.y, b.y, c.y, d.y), x, y);
        float leave = fminf((1.000001f - x) / v.x, (1.000001f - y) / v.y), left = range.y - t; // just over the border
        hit = back_patch_hit(heights, x, y, z - height, v, fminf(leave, left));
        if (hit == 0.0f && flown > 0.0f) { // this cone was not empty: back, and cell by cell through it
            walked = t;
            dt = -flown;
            flown = 0.0f;
            hit = -1.0f;
            continue;
        }
        float gap = z - height - 1.0f / 1048576.0f, closing = speed - cone * cone * v.z; // to an apex raised by more than rounding
        dt = gap <= 0.0f || v.z >= 0.0f || t < walked ? 0.0f : closing > 0.0f ? cone * cone * gap / closing : 1e30f;
        flown = dt > leave ? dt : 0.0f;
        dt = fmaxf(dt, leave);
        done = hit >= 0.0f || dt >= left;
    }
    if (done && hit < 0.0f && range.y == ground && range.x <= range.y) hit = range.y - t;
    dt = fmaxf(hit, 0.0f);
    back_hit result;
    result.found = hit >= 0.0f;
    result.t = t + dt;
    result.position = back_make_vec3(((float)(i) + (float)(si) * (x + v.x * dt) + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * (y + v.y * dt) + 0.5f) / (float)(size.y), z + v.z * dt);
    result.status = result.found ? 0 : done ? end_status : 4;
    result.steps = steps;
    return result;
}
