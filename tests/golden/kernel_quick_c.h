// conemap.h: quick cones.
// size: the map's width and height in texels.
#include <math.h>
#include <stdbool.h>

float kquick_fetch(int i, int j);
float kquick_maxima(int i, int j, int level);

typedef struct kquick_ivec2 {
    int x, y;
} kquick_ivec2;

static int kquick_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int kquick_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float kquick_texel(int i, int j, kquick_ivec2 size) {
    return kquick_fetch(kquick_clampi(i, 0, size.x - 1), kquick_repeat(j, size.y));
}

typedef struct kquick_block {
    int node, low, high; // its number; offsets of its texels from the texel's own
} kquick_block;

// On one axis the block of level k that is `side` blocks beside a texel's own; low > high: there is none. A wrapping
// axis is seen from -size / 2 to size / 2.
static kquick_block kquick_beside(int at, int side, int size, int k, bool repeats) {
    int count = ((size - 1) >> k) + 1, node = (at >> k) + side;
    int shift = node < 0 ? -size : node >= count ? size : 0, end = size - 1 + shift - at;
    kquick_block b;
    b.node = shift < 0 ? count - 1 : shift > 0 ? 0 : node;
    b.low = (b.node << k) + shift - at;
    b.high = ((b.node + 1) << k) - 1 + shift - at;
    if (b.high > end) b.high = end;
    if (repeats && b.low < -(size >> 1)) b.low = -(size >> 1);
    if (repeats && b.high > size >> 1) b.high = size >> 1;
    if (!repeats && shift != 0) b.high = b.low - 1;
    return b;
}

static kquick_ivec2 kquick_make_ivec2(int x, int y) {
    kquick_ivec2 v;
    v.x = x;
    v.y = y;
    return v;
}

// The offsets that the three blocks of level k around a texel reach.
static kquick_ivec2 kquick_seen(int at, int size, int k, bool repeats) {
    kquick_block own = kquick_beside(at, 0, size, k, repeats);
    kquick_block before = kquick_beside(at, -1, size, k, repeats);
    kquick_block behind = kquick_beside(at, 1, size, k, repeats);
    return kquick_make_ivec2(before.low <= before.high ? before.low : own.low,
                 behind.low <= behind.high ? behind.high : own.high);
}

// Have finer levels than k seen all of an axis?
static bool kquick_covers(int at, int size, int k, bool repeats) {
    kquick_ivec2 seen = kquick_seen(at, size, k - 1, repeats);
    return seen.x <= (repeats ? -(size >> 1) : -at) && seen.y >= (repeats ? size >> 1 : size - 1 - at);
}

typedef struct kquick_vec3 {
    float x, y, z;
} kquick_vec3;

static kquick_vec3 kquick_make_vec3(float x, float y, float z) {
    kquick_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

// On one axis the squared distances to a block of level k, to what finer levels have not seen of it and to the whole,
// and its number. 1e30: there is no such thing.
static kquick_vec3 kquick_axis(int at, int side, int size, int k, bool repeats, float texel) {
    kquick_block b = kquick_beside(at, side, size, k, repeats);
    int closest = side < 0 ? b.high : side > 0 ? b.low : 0;
    float whole = texel * (float)(closest);
    if (b.low > b.high) return kquick_make_vec3(1e30f, 1e30f, 0.0f);
    if (side == 0) return kquick_make_vec3(1e30f, 0.0f, (float)(b.node));
    if (k > 0) {
        kquick_ivec2 seen = kquick_seen(at, size, k - 1, repeats);
        if (side < 0 && closest >= seen.x) closest = seen.x - 1;
        if (side > 0 && closest <= seen.y) closest = seen.y + 1;
        if (closest < b.low || closest > b.high) return kquick_make_vec3(1e30f, whole * whole, (float)(b.node));
    }
    float unseen = texel * (float)(closest);
    return kquick_make_vec3(unseen * unseen, whole * whole, (float)(b.node));
}

static float kquick_maximum(int x, int y, int k) {
    return kquick_maxima(x, y, k);
}

// A slope, squared, that no texel exceeds: level by level the 3x3 blocks around, each with its maximum at its closest
// point that finer levels have not seen, which on a diagonal is the nearer of two corners.
static float kquick_quick(int i, int j, kquick_ivec2 size) {
    float s = 0.0f, apex = kquick_texel(i, j, size), a = 1.0f / (float)(size.x), b = 7.5e-1f / (float)(size.y);
    int longest = size.x > size.y ? size.x : size.y;
    for (int k = 0; (2 * longest - 1) >> k > 0; ++k) {
        if (k > 0 && kquick_covers(i, size.x, k, false) && kquick_covers(j, size.y, k, true)) break;
        for (int y = -1; y <= 1; ++y) {
            kquick_vec3 v = kquick_axis(j, y, size.y, k, true, b);
            for (int x = -1; x <= 1; ++x) {
                kquick_vec3 u = kquick_axis(i, x, size.x, k, false, a);
                float d2 = fminf(u.x + v.y, u.y + v.x), rise = kquick_maximum((int)(u.z), (int)(v.z), k) - apex;
                if ((x != 0 || y != 0) && d2 < 1e29f && rise > 0.0f) s = fmaxf(s, rise * rise / d2);
            }
        }
    }
    return s;
}

