// conemap.h: exact cones, by branch and bound over maxima.
// size: the map's width and height in texels.
#include <math.h>
#include <stdbool.h>

float koctant_fetch(int i, int j);
float koctant_state(int i, int j, int sector);
float koctant_maxima(int i, int j, int level);

typedef struct koctant_ivec2 {
    int x, y;
} koctant_ivec2;

static int koctant_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int koctant_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float koctant_texel(int i, int j, koctant_ivec2 size) {
    return koctant_fetch(koctant_clampi(i, 0, size.x - 1), koctant_repeat(j, size.y));
}

static float koctant_maximum(int x, int y, int k) {
    return koctant_maxima(x, y, k);
}

// Does a sector of directions from texel (i, j) meet the texels of a block?
static bool koctant_meets(int x, int y, int k, int i, int j, int sector) {
    int low_x = (x << k) - i, low_y = (y << k) - j, side = ((x + 1) << k) - 1 - i - low_x;
    int near_x = (sector & 1) == 0 ? low_x : -low_x - side, far_x = near_x + side;
    int near_y = (sector & 2) == 0 ? low_y : -low_y - side, far_y = near_y + side;
    int beyond = sector > 3 ? (near_x > 0 ? near_x : 0) - far_y : (near_y > 0 ? near_y : 0) - far_x;
    return far_x >= 0 && far_y >= 0 && beyond <= 0;
}

// Of a block and the one beside it that shares its parent, the nearer.
static int koctant_nearer(int at, int block, int k) {
    return koctant_clampi(at >> k, block & ~1, block | 1);
}

// The steepest slope, squared, from height `apex` at texel (i, j), which may lie beside the map, to the texels of a
// block; s is known already. Blocks that hold nothing steeper are left out, nearer ones come first.
static float koctant_steeper(float s, float apex, int i, int j, int level, int x, int y, int sector, koctant_ivec2 size) {
    float a = 1.0f / (float)(size.x), b = 7.5e-1f / (float)(size.y);
    int k = level, inside_i = koctant_clampi(i, 0, size.x - 1), inside_j = koctant_clampi(j, 0, size.y - 1);
    for (bool done = false; !done;) {
        float u = a * (float)(i - koctant_clampi(i, x << k, ((x + 1) << k) - 1));
        float v = b * (float)(j - koctant_clampi(j, y << k, ((y + 1) << k) - 1)), d2 = u * u + v * v;
        float rise = fmaxf(koctant_maximum(x, y, k) - apex, 0.0f);
        bool steeper = rise * rise > s * d2;
        if (!koctant_meets(x, y, k, i, j, sector)) steeper = false;
        if (steeper && k == 0) s = rise * rise / d2;
        if (steeper && k > 0) {
            --k;
            x = koctant_nearer(inside_i, 2 * x, k);
            y = koctant_nearer(inside_j, 2 * y, k);
        } else { // on to the next of the four, or of those around
            for (; k < level && x != koctant_nearer(inside_i, x, k) && y != koctant_nearer(inside_j, y, k); ++k) {
                x = x >> 1;
                y = y >> 1;
            }
            done = k == level;
            if (x != koctant_nearer(inside_i, x, k)) y = y ^ 1;
            x = x ^ 1;
        }
    }
    return s;
}

// Steepest slope, squared, from texel (i, j) to those of blocks first..last of a level, and of those before.
static float koctant_exact(int i, int j, int first, int last, int level, int sector, koctant_ivec2 size) {
    float s = koctant_state(i, j, sector), apex = koctant_texel(i, j, size);
    int end = size.x - 1, across = (end >> level) + 1;
    int step_v = (sector & 2) == 0 ? -size.y : size.y, copies_v = sector > 3 ? 3 + (int)((unsigned)(size.x) / (unsigned)(size.y)) : 2;
    for (int block = first; block <= last; ++block) {
        int x = (int)((unsigned)(block) % (unsigned)(across)), y = (int)((unsigned)(block) / (unsigned)(across));
        for (int copy = 0; copy < copies_v; ++copy) { // of the map, where the sector looks
            s = koctant_steeper(s, apex, i, j + copy * step_v, level, x, y, sector, size);
        }
    }
    return s;
}

