// conemap.h: exact relaxed cones, by branch and bound over maxima.
// size: the map's width and height in texels.
#include <math.h>
#include <stdbool.h>

float krelaxed_fetch(int i, int j);
float krelaxed_state(int i, int j);
float krelaxed_maxima(int i, int j, int level);

typedef struct krelaxed_ivec2 {
    int x, y;
} krelaxed_ivec2;

static int krelaxed_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int krelaxed_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float krelaxed_texel(int i, int j, krelaxed_ivec2 size) {
    return krelaxed_fetch(krelaxed_clampi(i, 0, size.x - 1), krelaxed_repeat(j, size.y));
}

static float krelaxed_maximum(int x, int y, int k) {
    return krelaxed_maxima(x, y, k);
}

// Does a side of the cell between texels (i, j) and (x, y) fall, flown through from (i, j)?
static bool krelaxed_falls(int i, int j, int x, int y, krelaxed_ivec2 size) {
    float h00 = krelaxed_texel(i, j, size), h10 = krelaxed_texel(x, j, size);
    float h01 = krelaxed_texel(i, y, size), h11 = krelaxed_texel(x, y, size);
    if (x < 0 || x >= size.x) return true; // beyond a border everything does
    return h00 > h10 || h00 > h01 || h10 > h11 || h01 > h11;
}

// Does the surface fall behind texel (x, y), seen from (i, j)? Straight ahead there are two cells.
static bool krelaxed_limits(int x, int y, int i, int j, krelaxed_ivec2 size) {
    bool falls = false;
    for (int c = 0; c < 4 && !falls; ++c) {
        int di = 1 - 2 * (c & 1), dj = 1 - (c & 2);
        if (di * (x - i) >= 0 && dj * (y - j) >= 0) falls = krelaxed_falls(x, y, x + di, y + dj, size);
    }
    return falls;
}

// Of a block and the one beside it that shares its parent, the nearer.
static int krelaxed_nearer(int at, int block, int k) {
    return krelaxed_clampi(at >> k, block & ~1, block | 1);
}

// The steepest slope, squared, from height `apex` at texel (i, j), which may lie beside the map, to the texels of a
// block; s is known already. Blocks that hold nothing steeper are left out, nearer ones come first.
static float krelaxed_steeper(float s, float apex, int i, int j, int level, int x, int y, krelaxed_ivec2 size) {
    float a = 1.0f / (float)(size.x), b = 7.5e-1f / (float)(size.y);
    int k = level, inside_i = krelaxed_clampi(i, 0, size.x - 1), inside_j = krelaxed_clampi(j, 0, size.y - 1);
    for (bool done = false; !done;) {
        float u = a * (float)(i - krelaxed_clampi(i, x << k, ((x + 1) << k) - 1));
        float v = b * (float)(j - krelaxed_clampi(j, y << k, ((y + 1) << k) - 1)), d2 = u * u + v * v;
        float rise = fmaxf(krelaxed_maximum(x, y, k) - apex, 0.0f);
        bool steeper = rise * rise > s * d2;
        if (steeper && k == 0 && krelaxed_limits(x, y, i, j, size)) s = rise * rise / d2;
        if (steeper && k > 0) {
            --k;
            x = krelaxed_nearer(inside_i, 2 * x, k);
            y = krelaxed_nearer(inside_j, 2 * y, k);
        } else { // on to the next of the four, or of those around
            for (; k < level && x != krelaxed_nearer(inside_i, x, k) && y != krelaxed_nearer(inside_j, y, k); ++k) {
                x = x >> 1;
                y = y >> 1;
            }
            done = k == level;
            if (x != krelaxed_nearer(inside_i, x, k)) y = y ^ 1;
            x = x ^ 1;
        }
    }
    return s;
}

// Steepest slope, squared, from texel (i, j) to those of blocks first..last of a level, and of those before.
static float krelaxed_exact(int i, int j, int first, int last, int level, krelaxed_ivec2 size) {
    float s = krelaxed_state(i, j), apex = krelaxed_texel(i, j, size);
    int end = size.x - 1, across = (end >> level) + 1;
    for (int block = first; block <= last; ++block) {
        int x = (int)((unsigned)(block) % (unsigned)(across)), y = (int)((unsigned)(block) / (unsigned)(across));
        for (int copy = 0; copy < 3; ++copy) { // of the map, beside itself; as well the texel may move
            s = krelaxed_steeper(s, apex, i, j + ((int)((unsigned)(copy + 1) % 3u) - 1) * size.y, level, x, y, size);
        }
    }
    return s;
}

