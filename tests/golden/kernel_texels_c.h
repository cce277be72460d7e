// conemap.h: maxima over texels, the finest level.
// size: the map's width and height in texels.
#include <math.h>

float ktexels_fetch(int i, int j);

typedef struct ktexels_ivec2 {
    int x, y;
} ktexels_ivec2;

static int ktexels_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int ktexels_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float ktexels_texel(int i, int j, ktexels_ivec2 size) {
    return ktexels_fetch(ktexels_clampi(i, 0, size.x - 1), ktexels_repeat(j, size.y));
}

// The height; 0 beyond the map.
static float ktexels_padded(int i, int j, ktexels_ivec2 size) {
    return i < size.x && j < size.y ? ktexels_texel(i, j, size) : 0.0f;
}

