// conemap.h: one batch of the ring search for cones.
// size: the map's width and height in texels.
#include <math.h>

float kring_fetch(int i, int j);
float kring_state(int i, int j);

typedef struct kring_ivec2 {
    int x, y;
} kring_ivec2;

static int kring_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int kring_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float kring_texel(int i, int j, kring_ivec2 size) {
    return kring_fetch(kring_clampi(i, 0, size.x - 1), kring_repeat(j, size.y));
}

// Steepest slope, squared, from texel (i, j) to those of rings first..last, and of the rings before.
static float kring_ring(int i, int j, int first, int last, kring_ivec2 size) {
    float s = 0.0f, apex = kring_texel(i, j, size);
    float a = 1.0f / (float)(size.x), b = 7.5e-1f / (float)(size.y), shorter = fminf(a, b);
    if (first > 1) s = kring_state(i, j);
    for (int r = first; r <= last; ++r) {
        float d = shorter * (float)(r), room = 1.0f - apex;
        if (room * room <= s * d * d) break; // nothing so far away can be steeper
        for (int side = 0; side < 4; ++side) {
            for (int k = -r; k < r; ++k) {
                int x = i + (side == 0 ? k : side == 1 ? r : side == 2 ? -k : -r);
                int y = j + (side == 0 ? -r : side == 1 ? k : side == 2 ? r : -k);
                if (x < 0 || x >= size.x) continue;
                float u = a * (float)(x - i), v = b * (float)(y - j), rise = kring_texel(x, y, size) - apex;
                if (rise > 0.0f) s = fmaxf(s, rise * rise / (u * u + v * v));
            }
        }
    }
    return s;
}

