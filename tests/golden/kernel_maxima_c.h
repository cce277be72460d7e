// conemap.h: maxima, a level from the one below.
// size: the map's width and height in texels.
#include <math.h>

float kmaxima_maxima(int i, int j, int level);

static float kmaxima_maximum(int x, int y, int k) {
    return kmaxima_maxima(x, y, k);
}

// Block (i, j) of a level: the highest of the four of the level below.
static float kmaxima_four(int i, int j, int level) {
    int x = 2 * i, y = 2 * j, k = level - 1;
    return fmaxf(fmaxf(kmaxima_maximum(x, y, k), kmaxima_maximum(x + 1, y, k)),
               fmaxf(kmaxima_maximum(x, y + 1, k), kmaxima_maximum(x + 1, y + 1, k)));
}

