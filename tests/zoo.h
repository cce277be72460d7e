/* The zoo: small maps that each bring one kind of trouble, at any size, the same on every machine. */
#ifndef ZOO_H
#define ZOO_H

#include <stddef.h>
#include <stdint.h>

/* A small integer generator (splitmix64). */
struct zoo_random {
    uint64_t state;
};

static inline struct zoo_random zoo_seed(uint64_t seed)
{
    struct zoo_random random;
    random.state = seed * UINT64_C(0x9e3779b97f4a7c15) + UINT64_C(0x1234567);
    return random;
}

static inline uint32_t zoo_next(struct zoo_random *random)
{
    uint64_t z = (random->state += UINT64_C(0x9e3779b97f4a7c15));
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return (uint32_t)((z ^ (z >> 31)) >> 32);
}

/* 0 .. count - 1 */
static inline int zoo_below(struct zoo_random *random, int count)
{
    return (int)(((uint64_t)zoo_next(random) * (uint64_t)count) >> 32);
}

/* 0 <= value <= 1, in steps of 2^-24 (both ends can come) */
static inline float zoo_unit(struct zoo_random *random)
{
    uint32_t bits = zoo_next(random);
    return (float)((bits >> 8) + (bits & 1u)) / 16777216.0f;
}

static inline float zoo_between(struct zoo_random *random, float low, float high)
{
    return low + (high - low) * zoo_unit(random);
}

enum zoo_kind {
    ZOO_FLAT_0,
    ZOO_FLAT_1,
    ZOO_RAMP,
    ZOO_DIAGONAL,
    ZOO_IMPULSE,
    ZOO_BORDER_SPIKE,
    ZOO_CORNER_SPIKE,
    ZOO_CHECKERBOARD,
    ZOO_BRICKS,
    ZOO_FBM,
    ZOO_WHITE,
    ZOO_SPIKES,
    ZOO_CLIFF,
    ZOO_SADDLE,
    ZOO_KINDS
};

static inline const char *zoo_name(int kind)
{
    static const char *const names[ZOO_KINDS] = {
        "flat 0",       "flat 1", "ramp", "diagonal", "impulse", "border spike", "corner spike",
        "checkerboard", "bricks", "fbm",  "white",    "spikes",  "cliff",        "saddle",
    };
    return kind >= 0 && kind < ZOO_KINDS ? names[kind] : "?";
}

static inline float zoo_hash(int x, int y, uint32_t seed)
{
    struct zoo_random random = zoo_seed(((uint64_t)(uint32_t)x << 32 | (uint32_t)y) ^ ((uint64_t)seed << 17));
    return zoo_unit(&random);
}

/* Smooth value noise on an integer lattice; repeats with (period_x, period_y). */
static inline float zoo_noise(float x, float y, int period_x, int period_y, uint32_t seed)
{
    int i = (int)x, j = (int)y;
    float a = x - (float)i, b = y - (float)j;
    int i0 = i % period_x, i1 = (i + 1) % period_x, j0 = j % period_y, j1 = (j + 1) % period_y;
    float low, high;
    a = a * a * (3.0f - 2.0f * a);
    b = b * b * (3.0f - 2.0f * b);
    low = zoo_hash(i0, j0, seed) * (1.0f - a) + zoo_hash(i1, j0, seed) * a;
    high = zoo_hash(i0, j1, seed) * (1.0f - a) + zoo_hash(i1, j1, seed) * a;
    return low * (1.0f - b) + high * b;
}

static inline float zoo_height(int kind, int width, int height, int x, int y, uint32_t seed)
{
    int right = width > 1 ? width - 1 : 1, bottom = height > 1 ? height - 1 : 1;
    float u = (float)x / (float)right, v = (float)y / (float)bottom, value = 0.0f, share = 0.5f;
    int octave, brick;

    switch (kind) {
    case ZOO_FLAT_1: return 1.0f;
    case ZOO_RAMP: return u;
    case ZOO_DIAGONAL: return (float)(x + y) / (float)(right + bottom);
    case ZOO_IMPULSE: return x == width / 2 && y == height / 3 ? 1.0f : 0.0f;
    case ZOO_BORDER_SPIKE: return x == width - 1 && y == height / 2 ? 1.0f : 0.0f;
    case ZOO_CORNER_SPIKE: return x == 0 && y == height - 1 ? 1.0f : 0.125f;
    case ZOO_CHECKERBOARD: return (x + y) & 1 ? 0.75f : 0.25f;
    case ZOO_BRICKS:
        brick = y * 4 / height;
        value = (float)((x * 3 + (brick & 1) * width / 2) % width) / (float)width;
        if ((y * 4) % height < 4 || value < 3.5f / (float)width) return 0.2f;
        return 0.8f + 0.2f * zoo_hash(x, y, seed);
    case ZOO_FBM:
        for (octave = 2; octave <= 32; octave *= 2) {
            float fu = (float)x / (float)width * (float)octave, fv = (float)y / (float)height * (float)octave;
            value += share * zoo_noise(fu, fv, octave, octave, seed + (uint32_t)octave);
            share *= 0.5f;
        }
        return value > 1.0f ? 1.0f : value;
    case ZOO_WHITE: return zoo_hash(x, y, seed);
    case ZOO_SPIKES:
        value = zoo_hash(x, y, seed);
        return value > 0.96f ? 0.5f + 0.5f * zoo_hash(y, x, seed + 1) : 0.1f * value;
    case ZOO_CLIFF: return u + 0.3f * v > 0.6f ? 0.9f : 0.1f;
    case ZOO_SADDLE: return u * (1.0f - v) + v * (1.0f - u);
    default: return 0.0f;
    }
}

static inline void zoo_fill(int kind, int width, int height, uint32_t seed, float *heights)
{
    int x, y;
    for (y = 0; y < height; ++y) {
        for (x = 0; x < width; ++x) {
            heights[(size_t)y * (size_t)width + (size_t)x] = zoo_height(kind, width, height, x, y, seed);
        }
    }
}

#endif
