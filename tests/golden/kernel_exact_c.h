// conemap.h: exact cones, by branch and bound over maxima.
// size: the map's width and height in texels.
#include <math.h>
#include <stdbool.h>

float kexact_fetch(int i, int j);
float kexact_state(int i, int j);
float kexact_maxima(int i, int j, int level);

typedef struct kexact_ivec2 {
    int x, y;
} kexact_ivec2;

static int kexact_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int kexact_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float kexact_texel(int i, int j, kexact_ivec2 size) {
    return kexact_fetch(kexact_clampi(i, 0, size.x - 1), kexact_repeat(j, size.y));
}

static float kexact_maximum(int x, int y, int k) {
    return kexact_maxima(x, y, k);
}

// Of a block and the one beside it that shares its parent, the nearer.
static int kexact_nearer(int at, int block, int k) {
    return kexact_clampi(at >> k, block & ~1, block | 1);
}

// The steepest slope, squared, from height `apex` at texel (i, j), which may lie beside the map, to the texels of a
// block; s is known already. Blocks that hold nothing steeper are left out, nearer ones come first.
static float kexact_steeper(float s, float apex, int i, int j, int level, int x, int y, kexact_ivec2 size) {
    float a = 1.0f / (float)(size.x), b = 7.5e-1f / (float)(size.y);
    int k = level, inside_i = kexact_clampi(i, 0, size.x - 1), inside_j = kexact_clampi(j, 0, size.y - 1);
    for (bool done = false; !done;) {
        float u = a * (float)(i - kexact_clampi(i, x << k, ((x + 1) << k) - 1));
        float v = b * (float)(j - kexact_clampi(j, y << k, ((y + 1) << k) - 1)), d2 = u * u + v * v;
        float rise = fmaxf(kexact_maximum(x, y, k) - apex, 0.0f);
        bool steeper = rise * rise > s * d2;
        if (steeper && k == 0) s = rise * rise / d2;
        if (steeper && k > 0) {
            --k;
            x = kexact_nearer(inside_i, 2 * x, k);
            y = kexact_nearer(inside_j, 2 * y, k);
        } else { // on to the next of the four, or of those around
            for (; k < level && x != kexact_nearer(inside_i, x, k) && y != kexact_nearer(inside_j, y, k); ++k) {
                x = x >> 1;
                y = y >> 1;
            }
            done = k == level;
            if (x != kexact_nearer(inside_i, x, k)) y = y ^ 1;
            x = x ^ 1;
        }
    }
    return s;
}

// Steepest slope, squared, from texel (i, j) to those of blocks first..last of a level, and of those before.
static float kexact_exact(int i, int j, int first, int last, int level, kexact_ivec2 size) {
    float s = kexact_state(i, j), apex = kexact_texel(i, j, size);
    int end = size.x - 1, across = (end >> level) + 1;
    for (int block = first; block <= last; ++block) {
        int x = (int)((unsigned)(block) % (unsigned)(across)), y = (int)((unsigned)(block) / (unsigned)(across));
        for (int copy = 0; copy < 3; ++copy) { // of the map, beside itself; as well the texel may move
            s = kexact_steeper(s, apex, i, j + ((int)((unsigned)(copy + 1) % 3u) - 1) * size.y, level, x, y, size);
        }
    }
    return s;
}

