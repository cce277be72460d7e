// conemap.h: exact-step tracer.
// step_trace(origin, direction, size): the first hit of a ray with the relief.
// The ray lives in the unit box over the map: u, v, and z from 0 to 1; t counts in lengths of the direction.
// size: the map's width and height in texels.
// step_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct step_vec2 {
    float x, y;
} step_vec2;

step_vec2 step_fetch(int i, int j);

typedef struct step_vec3 {
    float x, y, z;
} step_vec3;

typedef struct step_hit {
    bool found;
    float t;       // in lengths of the direction
    step_vec3 position; // u, v, z; u and v are not wrapped
    int status;    // 0 hit, 1 left the map, 2 floor, 3 t_max, 4 step cap
    int steps;
} step_hit;

typedef struct step_ivec2 {
    int x, y;
} step_ivec2;

static step_vec2 step_make_vec2(float x, float y) {
    step_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static step_vec2 step_clip(step_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return step_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return step_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static step_vec3 step_make_vec3(float x, float y, float z) {
    step_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static int step_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static step_vec2 step_texel(int i, int j, step_ivec2 size) {
    return step_fetch(step_clampi(i, 0, size.x - 1), step_clampi(j, 0, size.y - 1));
}

typedef struct step_vec4 {
    float x, y, z, w;
} step_vec4;

static step_vec4 step_make_vec4(float x, float y, float z, float w) {
    step_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float step_mix(step_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// How long the ray flies inside a cone whose apex lies `gap` below it.
static float step_cone_step(float tangent, float gap, float speed, float vz) {
    float closing = speed - tangent * vz;
    if (speed == 0.0f) return vz < 0.0f ? (gap + 1e-6f) / -vz : 1e30f;
    return closing > 0.0f ? tangent * gap / closing : 1e30f;
}

// Cone step and one texel more, until the ray is below the surface.
static step_hit step_trace(step_vec3 origin, step_vec3 direction, step_ivec2 size) {
    step_vec2 range = step_clip(step_make_vec2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    step_vec2 box = range; // it says how a ray ends that meets nothing
    box = step_clip(box, origin.x, direction.x, 0.0f, 1.0f);
    box = step_clip(box, origin.y, direction.y, 0.0f, 1.0f);
    float rim_u = size.x > 1 ? 0.5f / (float)(size.x) : 0.0f; // the surface ends at the outermost centres
    range = step_clip(step_clip(range, origin.x, direction.x, rim_u, 1.0f - rim_u), origin.y, direction.y, 0.0f, 1.0f);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    step_vec3 v = step_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    int end_status = box.x > box.y ? 1 : box.y == ground ? 2 : 1;
    float extra = 1.0f / ((float)(size.x > size.y ? size.x : size.y) * sqrtf(direction.x * direction.x + direction.y * direction.y +
                                          direction.z * direction.z));
    float t = 0.0f, dt = range.x, gap = 0.0f, speed = sqrtf(direction.x * direction.x + direction.y * direction.y);
    bool done = range.x > range.y, found = false, ends = false;
    for (; !done && steps < 4 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        step_vec2 a = step_texel(i, j, size), b = step_texel(i + si, j, size);
        step_vec2 c = step_texel(i, j + sj, size), d = step_texel(i + si, j + sj, size);
        step_vec4 heights = step_make_vec4(a.x, b.x, c.x, d.x);
        float height = step_mix(heights, x, y);
        float cone = step_mix(step_make_vec4(a.y, b.y, c.y, d.y), x, y);
        gap = ends && range.y == ground ? fminf(z - height, 0.0f) : z - height;
        found = gap <= 0.0f;
        done = found || ends;
        if (done) break;
        dt = step_cone_step(cone, gap, speed, v.z) + extra;
        ends = dt >= range.y - t;
        if (ends) dt = range.y - t;
    }
    dt = found && steps > 0 ? -fminf(extra, dt) : 0.0f; // a texel back
    step_hit result;
    result.found = found;
    result.t = t + dt;
    result.position = step_make_vec3(((float)(i) + (float)(si) * (x + v.x * dt) + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * (y + v.y * dt) + 0.5f) / (float)(size.y), z + v.z * dt);
    result.status = result.found ? 0 : done ? end_status : 4;
    result.steps = steps;
    return result;
}
