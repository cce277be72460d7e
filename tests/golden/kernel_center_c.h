// conemap.h: quick cones.
// size: the map's width and height in texels.
#include <math.h>
#include <stdbool.h>

float kcenter_fetch(int i, int j);
float kcenter_maxima(int i, int j, int level);

typedef struct kcenter_ivec2 {
    int x, y;
} kcenter_ivec2;

static int kcenter_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int kcenter_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float kcenter_texel(int i, int j, kcenter_ivec2 size) {
    return kcenter_fetch(kcenter_clampi(i, 0, size.x - 1), kcenter_repeat(j, size.y));
}

typedef struct kcenter_block {
    int node, low, high; // its number; offsets of its texels from the texel's own
    float middle;
} kcenter_block;

// On one axis the block of level k that is `side` blocks beside a texel's own; low > high: there is none. A wrapping
// axis is seen from -size / 2 to size / 2.
static kcenter_block kcenter_beside(int at, int side, int size, int k, bool repeats) {
    int count = ((size - 1) >> k) + 1, node = (at >> k) + side;
    int shift = node < 0 ? -size : node >= count ? size : 0, end = size - 1 + shift - at;
    kcenter_block b;
    b.node = shift < 0 ? count - 1 : shift > 0 ? 0 : node;
    b.low = (b.node << k) + shift - at;
    b.high = ((b.node + 1) << k) - 1 + shift - at;
    if (b.high > end) b.high = end;
    b.middle = 0.5f * (float)(b.low + b.high);
    if (repeats && b.low < -(size >> 1)) b.low = -(size >> 1);
    if (repeats && b.high > size >> 1) b.high = size >> 1;
    if (!repeats && shift != 0) b.high = b.low - 1;
    return b;
}

static kcenter_ivec2 kcenter_make_ivec2(int x, int y) {
    kcenter_ivec2 v;
    v.x = x;
    v.y = y;
    return v;
}

// The offsets that the three blocks of level k around a texel reach.
static kcenter_ivec2 kcenter_seen(int at, int size, int k, bool repeats) {
    kcenter_block own = kcenter_beside(at, 0, size, k, repeats);
    kcenter_block before = kcenter_beside(at, -1, size, k, repeats);
    kcenter_block behind = kcenter_beside(at, 1, size, k, repeats);
    return kcenter_make_ivec2(before.low <= before.high ? before.low : own.low,
                 behind.low <= behind.high ? behind.high : own.high);
}

// Have finer levels than k seen all of an axis?
static bool kcenter_covers(int at, int size, int k, bool repeats) {
    kcenter_ivec2 seen = kcenter_seen(at, size, k - 1, repeats);
    return seen.x <= (repeats ? -(size >> 1) : -at) && seen.y >= (repeats ? size >> 1 : size - 1 - at);
}

typedef struct kcenter_vec3 {
    float x, y, z;
} kcenter_vec3;

static kcenter_vec3 kcenter_make_vec3(float x, float y, float z) {
    kcenter_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

// On one axis the squared distances to a block of level k, to what finer levels have not seen of it and to the whole,
// and its number. 1e30: there is no such thing.
static kcenter_vec3 kcenter_axis(int at, int side, int size, int k, bool repeats, float texel) {
    kcenter_block b = kcenter_beside(at, side, size, k, repeats);
    float whole = side == 0 ? 0.0f : texel * b.middle;
    if (b.low > b.high) return kcenter_make_vec3(1e30f, 1e30f, 0.0f);
    return kcenter_make_vec3(whole * whole, whole * whole, (float)(b.node));
}

static float kcenter_maximum(int x, int y, int k) {
    return kcenter_maxima(x, y, k);
}

// A slope, squared, that no texel exceeds: level by level the 3x3 blocks around, each with its maximum at its closest
// point, taken to be its middle, so that some exceed it after all.
static float kcenter_quick(int i, int j, kcenter_ivec2 size) {
    float s = 0.0f, apex = kcenter_texel(i, j, size), a = 1.0f / (float)(size.x), b = 7.5e-1f / (float)(size.y);
    int longest = size.x > size.y ? size.x : size.y;
    for (int k = 0; (2 * longest - 1) >> k > 0; ++k) {
        if (k > 0 && kcenter_covers(i, size.x, k, false) && kcenter_covers(j, size.y, k, true)) break;
        for (int y = -1; y <= 1; ++y) {
            kcenter_vec3 v = kcenter_axis(j, y, size.y, k, true, b);
            for (int x = -1; x <= 1; ++x) {
                kcenter_vec3 u = kcenter_axis(i, x, size.x, k, false, a);
                float d2 = fminf(u.x + v.y, u.y + v.x), rise = kcenter_maximum((int)(u.z), (int)(v.z), k) - apex;
                if ((x != 0 || y != 0) && d2 < 1e29f && rise > 0.0f) s = fmaxf(s, rise * rise / d2);
            }
        }
    }
    return s;
}

