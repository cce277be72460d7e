// conemap.h: of each 3x3 block the narrowest cone.
// size: the map's width and height in texels.
#include <math.h>

float kmin_state(int i, int j);

typedef struct kmin_ivec2 {
    int x, y;
} kmin_ivec2;

static int kmin_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int kmin_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float kmin_slope(int i, int j, kmin_ivec2 size) {
    return kmin_state(kmin_clampi(i, 0, size.x - 1), kmin_repeat(j, size.y));
}

// The narrowest cone of the 3x3 block around a texel.
static float kmin_steepest(int i, int j, kmin_ivec2 size) {
    float s = 0.0f;
    for (int dj = -1; dj <= 1; ++dj)
        for (int di = -1; di <= 1; ++di) s = fmaxf(s, kmin_slope(i + di, j + dj, size));
    return s;
}

