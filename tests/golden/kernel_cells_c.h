// conemap.h: maxima over bilinear cells, the finest level.
// size: the map's width and height in texels.
#include <math.h>

float kcells_fetch(int i, int j);

typedef struct kcells_ivec2 {
    int x, y;
} kcells_ivec2;

static int kcells_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int kcells_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float kcells_texel(int i, int j, kcells_ivec2 size) {
    return kcells_fetch(kcells_clampi(i, 0, size.x - 1), kcells_repeat(j, size.y));
}

// The highest corner of a bilinear cell; 0 beyond the map.
static float kcells_highest(int i, int j, kcells_ivec2 size) {
    int x = i - 1, y = j;
    if (i >= size.x + 1 || j >= size.y) return 0.0f;
    return fmaxf(fmaxf(kcells_texel(x, y, size), kcells_texel(x + 1, y, size)),
               fmaxf(kcells_texel(x, y + 1, size), kcells_texel(x + 1, y + 1, size)));
}

