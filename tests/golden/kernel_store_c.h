// conemap.h: cones as the texture keeps them.
// size: the map's width and height in texels.
#include <math.h>

float kstore_fetch(int i, int j);
float kstore_state(int i, int j);

typedef struct kstore_ivec2 {
    int x, y;
} kstore_ivec2;

static int kstore_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int kstore_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float kstore_slope(int i, int j, kstore_ivec2 size) {
    return kstore_state(kstore_clampi(i, 0, size.x - 1), kstore_repeat(j, size.y));
}

static float kstore_texel(int i, int j, kstore_ivec2 size) {
    return kstore_fetch(kstore_clampi(i, 0, size.x - 1), kstore_repeat(j, size.y));
}

// The cone as the texture keeps it: 2^-20 narrower for all rounding, and rounded down.
static float kstore_stored(int i, int j, kstore_ivec2 size) {
    float s = kstore_slope(i, j, size), tangent = 1.0f;
    if (s > 0.0f) tangent = fminf(tangent, 0.999999f / sqrtf(s));
    float stored = (1.0f - kstore_texel(i, j, size)) * tangent * 0.999999f;
    float code = floorf(fminf(stored, 1.0f) * 65535.0f);
    return (code / 65535.0f > stored ? code - 1.0f : code) / 65535.0f;
}

