// conemap.h: cones made safe for the bilinear surface.
// size: the map's width and height in texels.
#include <math.h>

float ksafe_fetch(int i, int j);
float ksafe_state(int i, int j);

typedef struct ksafe_ivec2 {
    int x, y;
} ksafe_ivec2;

static int ksafe_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int ksafe_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float ksafe_slope(int i, int j, ksafe_ivec2 size) {
    return ksafe_state(ksafe_clampi(i, 0, size.x - 1), ksafe_repeat(j, size.y));
}

static float ksafe_texel(int i, int j, ksafe_ivec2 size) {
    return ksafe_fetch(ksafe_clampi(i, 0, size.x - 1), ksafe_repeat(j, size.y));
}

// A slope, squared, that no point over the cells at texel (i, j) exceeds to any point of the bilinear surface:
// what vertices see, times sqrt(1 + V) for V the variance of where in a cell one is; in the cells around, the
// gradient.
static float ksafe_safe(int i, int j, ksafe_ivec2 size) {
    float a = 1.0f / (float)(size.x), b = 7.5e-1f / (float)(size.y), shorter = fminf(a, b), s = 0.0f, gradient = 0.0f;
    for (int dj = -1; dj <= 1; ++dj)
        for (int di = -1; di <= 1; ++di) s = fmaxf(s, ksafe_slope(i + di, j + dj, size));
    for (int cj = j - 2; cj <= j + 1; ++cj) {
        for (int ci = i - 2; ci <= i + 1; ++ci) {
            float h00 = ksafe_texel(ci, cj, size), h10 = ksafe_texel(ci + 1, cj, size);
            float h01 = ksafe_texel(ci, cj + 1, size), h11 = ksafe_texel(ci + 1, cj + 1, size);
            float x = fmaxf(fabsf(h10 - h00), fabsf(h11 - h01)) / a;
            float y = fmaxf(fabsf(h01 - h00), fabsf(h11 - h10)) / b;
            gradient = fmaxf(gradient, x * x + y * y);
        }
    }
    s = s * (1.0f + 0.25f * (a * a + b * b) / (shorter * shorter));
    return 1.0001f * fmaxf(gradient, s); // 1.0001: rounding
}

