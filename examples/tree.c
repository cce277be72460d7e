/* Grows plants and other things of the kinds in [BJCW09 table 1] as skeletons, skins them with relief-mapped frusta
   and ray-casts them, with shadows; the cacti dance. */
#include "common.h"
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"

#define PI 3.14159265f

/* ---- vectors ----------------------------------------------------------------------------------------- */

struct vec {
    float x, y, z;
};

static struct vec vec(float x, float y, float z) {
    struct vec v = {x, y, z};
    return v;
}

static struct vec add(struct vec a, struct vec b, float scale) {
    return vec(a.x + b.x * scale, a.y + b.y * scale, a.z + b.z * scale);
}

static float dot(struct vec a, struct vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static struct vec cross(struct vec a, struct vec b) {
    return vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static struct vec unit(struct vec a) {
    float length = sqrtf(dot(a, a));
    return length > 0 ? vec(a.x / length, a.y / length, a.z / length) : vec(0, 1, 0);
}

/* A direction at an angle from `along`, turned around it. */
static struct vec aside(struct vec along, float angle, float around) {
    struct vec x = unit(cross(along, fabsf(along.y) < 0.9f ? vec(0, 1, 0) : vec(1, 0, 0))), z = cross(x, along);
    struct vec out = add(vec(0, 0, 0), along, cosf(angle));
    out = add(out, x, sinf(angle) * cosf(around));
    return add(out, z, sinf(angle) * sinf(around));
}

/* ---- random numbers ---------------------------------------------------------------------------------- */

static uint32_t seed_now = 1;

static float random01(void) { return (float)(hash3(seed_now++, 77u, 5u) >> 8) / 16777216.0f; }

static float vary(float about, float by) { return about * (1 + by * (2 * random01() - 1)); }

/* ---- layers: a skeleton with one relief and one colour ------------------------------------------------- */

enum relief { SMOOTH, RIBS, BARK, RINGS, STONES, LEAF, TILES };

struct layer {
    enum relief relief;
    struct vec color, deep; /* on the relief's top and at its bottom */
    float thickness;        /* of the shell, in radii */
    int u_repeat;
    float v_per_length;
    float flat;      /* of the sections; 0: round */
    int round_joins; /* pieces */
    int fitted;      /* joints are one ellipse, and u goes on exactly */
    conemap_joint *joints;
    conemap_segment *segments;
    int joint_count, segment_count, room;
    conemap_skeleton skeleton;
    conemap_map map;
};

#define LAYERS 6
struct scene {
    struct layer layers[LAYERS];
    int layer_count, failed;
    struct vec eye, target, ground, sun;
    float pool; /* of water; 0: none */
};

static struct layer *add_layer(struct scene *scene, enum relief relief, struct vec color, struct vec deep,
                               float thickness, int u_repeat, float v_per_length) {
    struct layer *layer = &scene->layers[scene->layer_count++];
    memset(layer, 0, sizeof *layer);
    layer->relief = relief;
    layer->color = color;
    layer->deep = deep;
    layer->thickness = thickness;
    layer->u_repeat = u_repeat;
    layer->v_per_length = v_per_length;
    return layer;
}

static int total_segments(const struct scene *scene) {
    int total = 0;
    for (int k = 0; k < scene->layer_count; ++k) total += scene->layers[k].segment_count;
    return total;
}

static int add_joint(struct layer *layer, struct vec at, float radius) {
    if (layer->joint_count + 1 >= layer->room) {
        int room = layer->room ? 2 * layer->room : 256;
        conemap_joint *joints = (conemap_joint *)realloc(layer->joints, (size_t)room * sizeof *joints);
        if (joints) layer->joints = joints;
        conemap_segment *segments = (conemap_segment *)realloc(layer->segments, (size_t)room * sizeof *segments);
        if (segments) layer->segments = segments;
        if (!joints || !segments) {
            fail("out of memory");
            exit(1);
        }
        layer->room = room;
    }
    conemap_joint *joint = &layer->joints[layer->joint_count];
    joint->position[0] = at.x;
    joint->position[1] = at.y;
    joint->position[2] = at.z;
    joint->radius = radius;
    joint->thickness = layer->thickness * radius;
    return layer->joint_count++;
}

/* A segment from the end of another (or from a joint of its own, parent -1) to a new joint; returns its index. */
static int add_segment(struct layer *layer, int parent, int base, struct vec to, float radius) {
    int top = add_joint(layer, to, radius);
    conemap_segment *s = &layer->segments[layer->segment_count];
    memset(s, 0, sizeof *s);
    s->base = parent >= 0 ? layer->segments[parent].top : base;
    s->top = top;
    s->parent = parent;
    s->u_repeat = layer->u_repeat;
    s->flat = layer->flat;
    return layer->segment_count++;
}

static struct vec joint_at(const struct layer *layer, int joint) {
    const float *p = layer->joints[joint].position;
    return vec(p[0], p[1], p[2]);
}

/* A limb of `count` segments, each turned by `bend` towards `toward`, its radius going from r0 to r1. Returns the
   last segment. */
static int grow(struct layer *layer, int parent, int base, struct vec direction, float length, int count, float r0,
                float r1, struct vec toward, float bend, float wobble) {
    struct vec at = joint_at(layer, parent >= 0 ? layer->segments[parent].top : base);
    for (int k = 1; k <= count; ++k) {
        float t = (float)k / (float)count;
        direction = unit(add(direction, toward, bend));
        if (wobble > 0)
            direction = unit(add(direction, vec(random01() - 0.5f, random01() - 0.5f, random01() - 0.5f), wobble));
        at = add(at, direction, length / (float)count);
        int made = add_segment(layer, parent, base, at, r0 + (r1 - r0) * t);
        if (k == 1 && parent >= 0 && r0 < layer->joints[layer->segments[parent].top].radius)
            layer->segments[made].radius = r0; /* thinner than what it leaves */
        parent = made;
    }
    return parent;
}

/* A rounded end of `count` segments on a limb. */
static void dome(struct layer *layer, int parent, float radius, int count) {
    struct vec from = joint_at(layer, layer->segments[parent].base),
               at = joint_at(layer, layer->segments[parent].top);
    struct vec direction = unit(add(at, from, -1)), centre = at;
    for (int k = 1; k <= count; ++k) {
        float angle = 0.5f * PI * (float)k / (float)count;
        at = add(centre, direction, radius * sinf(angle));
        parent = add_segment(layer, parent, 0, at, k < count ? radius * cosf(angle) : 0.0f);
    }
}

/* ---- models ------------------------------------------------------------------------------------------- */

static const struct vec GREEN = {0.30f, 0.47f, 0.20f}, DARK_GREEN = {0.13f, 0.24f, 0.10f};

static void saguaro_at(struct layer *layer, struct vec at, float size, int trunk, int arms, int arm_segments) {
    float r = 0.42f * size;
    int root = add_joint(layer, at, r * 0.9f);
    int last = grow(layer, -1, root, vec(0, 1, 0), 5.2f * size, trunk - 4, r, r, vec(0, 1, 0), 0, 0.02f),
        first = last - (trunk - 5);
    dome(layer, last, r, 4);
    for (int k = 0; k < arms; ++k) {
        int from = first + (trunk - 4) * (k + 3) / (arms + 5);
        float around = PI * (float)k + 0.4f, ra = 0.27f * size;
        int arm = grow(layer, from, 0, vec(cosf(around), 0.08f, sinf(around)), 2.9f * size, arm_segments - 3, ra,
                       ra, vec(0, 1, 0), 2.2f / (float)arm_segments, 0);
        dome(layer, arm, ra, 3);
    }
}

static void saguaro(struct scene *scene) {
    struct layer *layer = add_layer(scene, RIBS, GREEN, DARK_GREEN, 0.22f, 1, 0.4f);
    saguaro_at(layer, vec(0, 0, 0), 1, 12, 2, 9); /* 30 segments */
    scene->eye = vec(4, 4.5f, 8.5f);
    scene->target = vec(0, 2.9f, 0);
}

static void aloe_at(struct layer *layer, struct vec at, float size, int leaves, int each) {
    for (int k = 0; k < leaves; ++k) {
        float t = (float)k / (float)leaves, around = 2.39996f * (float)k, up = 0.25f + 1.1f * t;
        struct vec out = vec(cosf(around) * cosf(up), sinf(up), sinf(around) * cosf(up));
        int root = add_joint(layer, add(at, out, 0.1f * size), 0.11f * size);
        grow(layer, -1, root, out, vary((1.5f - 0.5f * t) * size, 0.1f), each, 0.13f * size, 0.0f, vec(0, 1, 0),
             0.09f, 0.03f);
    }
}

static void aloe(struct scene *scene) {
    struct layer *layer =
        add_layer(scene, LEAF, vec(0.38f, 0.52f, 0.33f), vec(0.20f, 0.33f, 0.22f), 0.25f, 1, 1.0f);
    int root = add_joint(layer, vec(0, -0.05f, 0), 0.2f);
    add_segment(layer, -1, root, vec(0, 0.2f, 0), 0.05f);
    aloe_at(layer, vec(0, 0.1f, 0), 1, 38, 6); /* 229 segments */
    scene->eye = vec(1.3f, 1.9f, 2.5f);
    scene->target = vec(0, 0.52f, 0);
}

/* Branches off branches, breadth first, until there are enough. */
static void elm(struct scene *scene) {
    struct layer *layer =
        add_layer(scene, BARK, vec(0.52f, 0.42f, 0.32f), vec(0.20f, 0.15f, 0.11f), 0.30f, 2, 0.6f);
    struct {
        int segment, level;
        float length, radius;
    } queue[2048];
    int head = 0, tail = 0, wanted = 1833;
    int root = add_joint(layer, vec(0, 0, 0), 0.5f);
    int trunk = grow(layer, -1, root, vec(0, 1, 0), 2.4f, 6, 0.5f, 0.3f, vec(0, 1, 0), 0, 0.08f);
    for (int k = 0; k < 6; ++k)
        layer->joints[k].radius *= 1.0f + 0.5f / (1.0f + 4.0f * (float)k); /* roots' flare */
    queue[tail].segment = trunk;
    queue[tail].level = 0;
    queue[tail].length = 2.1f;
    queue[tail++].radius = 0.3f;
    while (head < tail && layer->segment_count < wanted) {
        int from = queue[head].segment, level = queue[head].level, parts = level < 3 ? 5 : 4,
            children = level < 2 ? 4 : 3;
        float length = queue[head].length, radius = queue[head++].radius, turn = 6.28f * random01();
        struct vec d =
            unit(add(joint_at(layer, layer->segments[from].top), joint_at(layer, layer->segments[from].base), -1));
        for (int k = 0; k < children && layer->segment_count < wanted; ++k) {
            float share = k == 0 ? 1.0f : 0.62f;
            struct vec out =
                aside(d, k == 0 ? 0.2f : vary(0.75f, 0.2f), turn + 6.28f * (float)k / (float)children);
            int left = wanted - layer->segment_count, made = parts < left ? parts : left;
            int last = grow(layer, from, 0, out, vary(length, 0.2f), made, radius * share,
                            radius * (k == 0 ? 0.66f : 0.42f), vec(0, 1, 0), 0.05f, 0.16f);
            if (tail < 2048) {
                queue[tail].segment = last;
                queue[tail].level = level + 1;
                queue[tail].length = length * 0.76f;
                queue[tail++].radius = radius * (k == 0 ? 0.66f : 0.42f);
            }
        }
    }
    scene->eye = vec(4.5f, 3.2f, 12.0f);
    scene->target = vec(0, 4.3f, 0);
}

static void palm_at(struct scene *scene, struct layer *trunk, struct layer *leaves, struct vec at, float size,
                    int fronds, int leaflets) {
    struct vec lean = unit(vec(0.25f * (random01() - 0.5f), 1, 0.25f * (random01() - 0.5f)));
    int root = add_joint(trunk, at, 0.24f * size);
    int top = grow(trunk, -1, root, lean, 5.5f * size, 14, 0.19f * size, 0.12f * size, vec(0, 1, 0), 0.02f, 0.06f);
    struct vec crown = joint_at(trunk, trunk->segments[top].top);
    (void)scene;
    for (int k = 0; k < fronds; ++k) {
        float around = 2.39996f * (float)k, up = 0.9f - 1.2f * (float)k / (float)fronds;
        struct vec out = vec(cosf(around) * cosf(up), sinf(up), sinf(around) * cosf(up));
        int base = add_joint(leaves, crown, 0.04f * size), rib = -1, parts = 9;
        struct vec p = crown, d = out;
        for (int j = 1; j <= parts; ++j) { /* the rib, and along it pairs of leaflets */
            d = unit(add(d, vec(0, -1, 0), 0.17f));
            p = add(p, d, 2.6f * size / (float)parts);
            rib = add_segment(leaves, rib, base, p, 0.035f * size * (1 - 0.9f * (float)j / (float)parts));
            for (int m = 0; j > 1 && m < leaflets; ++m) {
                float side = m & 1 ? 1.0f : -1.0f, t = (float)(m / 2) / (0.5f * (float)leaflets);
                struct vec across = unit(cross(d, vec(0, 1, 0))),
                           from = add(p, d, -t * 2.6f * size / (float)parts);
                float length = 0.75f * size * sinf(PI * ((float)j - t) / ((float)parts + 1.2f)) + 0.12f * size;
                struct vec tip = add(add(add(from, across, side * length * 0.8f), d, 0.5f * length), vec(0, -1, 0),
                                     0.35f * length * (0.6f + random01()));
                int foot = add_joint(leaves, from, 0.018f * size);
                add_segment(leaves, -1, foot, tip, 0.002f * size);
            }
        }
    }
}

static void coconut(struct scene *scene) {
    struct layer *trunk =
        add_layer(scene, RINGS, vec(0.60f, 0.50f, 0.38f), vec(0.28f, 0.21f, 0.15f), 0.30f, 1, 1.0f);
    struct layer *leaves = add_layer(scene, SMOOTH, vec(0.27f, 0.45f, 0.14f), vec(0.20f, 0.34f, 0.10f), 0, 1, 1);
    palm_at(scene, trunk, leaves, vec(0, 0, 0), 1, 27, 16); /* 14 + 27 (9 + 8 16) = 3713 */
    scene->eye = vec(4.5f, 3.4f, 9.0f);
    scene->target = vec(0, 3.9f, 0);
}

static void pine(struct scene *scene) {
    struct layer *trunk =
        add_layer(scene, BARK, vec(0.47f, 0.33f, 0.23f), vec(0.19f, 0.12f, 0.09f), 0.35f, 1, 0.7f);
    struct layer *needles = add_layer(scene, SMOOTH, vec(0.13f, 0.29f, 0.14f), vec(0.13f, 0.29f, 0.14f), 0, 1, 1);
    int root = add_joint(trunk, vec(0, 0, 0), 0.32f), levels = 24, wanted = 16997;
    int first = 0, top = grow(trunk, -1, root, vec(0, 1, 0), 8.5f, levels, 0.28f, 0.03f, vec(0, 1, 0), 0, 0.01f);
    (void)top;
    for (int k = 2; k < levels; ++k)
        for (int b = 0; b < 6; ++b) {
            float t = (float)k / (float)levels, around = 1.05f * (float)b + 0.7f * (float)k,
                  length = vary(2.7f * (1 - t) + 0.2f, 0.15f);
            struct vec out = vec(cosf(around), 0.15f + 0.5f * t, sinf(around));
            float r = 0.055f * (1.1f - t);
            int last = grow(trunk, first + k, 0, unit(out), length, 5, r, r * 0.2f, vec(0, 1, 0), 0.03f, 0.05f);
            for (int j = 0; j < 5; ++j) { /* twigs of needles along it */
                int at = last - 4 + j;
                struct vec a = joint_at(trunk, trunk->segments[at].base),
                           d = add(joint_at(trunk, trunk->segments[at].top), a, -1);
                int many = 26;
                for (int n = 0; n < many && total_segments(scene) < wanted; ++n) {
                    struct vec from = add(a, d, random01()),
                               way = aside(unit(d), vary(0.9f, 0.3f), 6.2832f * random01());
                    int foot = add_joint(needles, from, 0.011f);
                    add_segment(needles, -1, foot, add(from, way, vary(0.30f, 0.3f)), 0.003f);
                }
            }
        }
    scene->eye = vec(4.0f, 4.5f, 11.5f);
    scene->target = vec(0, 4.1f, 0);
}

static void desert(struct scene *scene) {
    struct layer *cacti = add_layer(scene, RIBS, GREEN, DARK_GREEN, 0.22f, 1, 0.4f);
    struct layer *aloes =
        add_layer(scene, LEAF, vec(0.38f, 0.50f, 0.36f), vec(0.20f, 0.31f, 0.22f), 0.25f, 1, 1.0f);
    struct layer *stones =
        add_layer(scene, BARK, vec(0.60f, 0.47f, 0.36f), vec(0.36f, 0.26f, 0.19f), 0.25f, 1, 0.5f);
    for (int k = 0; k < 9; ++k) /* 270 */
        saguaro_at(cacti, vec(-9 + 2.4f * (float)k + random01(), 0, -2.0f - 7 * random01()), vary(0.9f, 0.3f), 12,
                   2, 9);
    for (int k = 0; k < 5; ++k) /* 460 */
        aloe_at(aloes, vec(-5 + 2.5f * (float)k + random01(), 0, 1.5f + 2.5f * random01()), vary(0.6f, 0.3f), 23,
                4);
    for (int k = 0; total_segments(scene) + 3 <= 799; ++k) {
        struct vec at = vec(-8 + 16 * random01(), -0.05f, -5 + 9 * random01());
        float r = vary(0.25f, 0.5f);
        int root = add_joint(stones, at, r);
        int last = add_segment(stones, -1, root, add(at, vec(0.1f, 1, 0), 0.6f * r), 0.85f * r);
        last = add_segment(stones, last, 0, add(at, vec(0.15f, 1, 0), 0.95f * r), 0.5f * r);
        add_segment(stones, last, 0, add(at, vec(0.15f, 1, 0), 1.08f * r), 0.0f);
    }
    scene->ground = vec(0.62f, 0.50f, 0.35f);
    scene->eye = vec(1.5f, 2.6f, 9.5f);
    scene->target = vec(0, 1.6f, -1);
}

static void oasis(struct scene *scene) {
    struct layer *trunk =
        add_layer(scene, RINGS, vec(0.60f, 0.50f, 0.38f), vec(0.28f, 0.21f, 0.15f), 0.30f, 1, 1.0f);
    struct layer *leaves = add_layer(scene, SMOOTH, vec(0.27f, 0.45f, 0.14f), vec(0.20f, 0.34f, 0.10f), 0, 1, 1);
    static const float places[7][3] = {{-3, -1, 1},      {-1.6f, -3, 1.1f}, {1.5f, -2, 0.9f}, {3.4f, -4, 1.1f},
                                       {4.5f, -1, 0.8f}, {-5, -5, 1.2f},    {0.4f, -6, 1.2f}};
    for (int k = 0; k < 7; ++k)
        palm_at(scene, trunk, leaves, vec(places[k][0], 0, places[k][1]), places[k][2], 20, 14);
    while (total_segments(scene) + 3 <= 18557) { /* grass */
        float around = 6.2832f * random01(), far_out = 3.2f + 1.6f * random01() * random01();
        struct vec at = vec(far_out * cosf(around), 0, 1.2f + 0.7f * far_out * sinf(around));
        int root = add_joint(leaves, at, 0.014f);
        grow(leaves, -1, root, unit(vec(random01() - 0.5f, 1.5f, random01() - 0.5f)), vary(0.55f, 0.5f), 3, 0.012f,
             0.002f, vec(random01() - 0.5f, 0, random01() - 0.5f), 0.3f, 0);
    }
    scene->ground = vec(0.64f, 0.54f, 0.38f);
    scene->pool = 3.1f;
    scene->eye = vec(1.0f, 3.0f, 12.0f);
    scene->target = vec(0, 2.6f, -1.5f);
}

static void well(struct scene *scene) {
    struct layer *stone =
        add_layer(scene, STONES, vec(0.66f, 0.62f, 0.56f), vec(0.30f, 0.27f, 0.24f), 0.12f, 3, 0.4f);
    struct layer *wood =
        add_layer(scene, BARK, vec(0.50f, 0.36f, 0.22f), vec(0.24f, 0.16f, 0.10f), 0.20f, 1, 0.8f);
    struct layer *roof =
        add_layer(scene, TILES, vec(0.58f, 0.27f, 0.18f), vec(0.30f, 0.12f, 0.08f), 0.07f, 6, 1.2f);
    struct layer *plain = add_layer(scene, SMOOTH, vec(0.09f, 0.13f, 0.15f), vec(0, 0, 0), 0, 1, 1);
    int j = add_joint(stone, vec(0, 0, 0), 1.25f);
    add_segment(stone, -1, j, vec(0, 1.1f, 0), 1.15f);
    j = add_joint(plain, vec(0, 1.05f, 0), 0.95f);
    add_segment(plain, -1, j, vec(0, 1.115f, 0), 0.95f);
    for (int k = -1; k <= 1; k += 2) {
        j = add_joint(wood, vec(1.05f * (float)k, 0.6f, 0), 0.11f);
        add_segment(wood, -1, j, vec(1.05f * (float)k, 2.9f, 0), 0.09f);
    }
    j = add_joint(wood, vec(-1.25f, 2.2f, 0), 0.07f);
    add_segment(wood, -1, j, vec(1.25f, 2.2f, 0), 0.07f);
    j = add_joint(roof, vec(0, 2.7f, 0), 1.75f);
    add_segment(roof, -1, j, vec(0, 3.9f, 0), 0.0f);
    j = add_joint(plain, vec(0.2f, 1.75f, 0), 0.016f);
    add_segment(plain, -1, j, vec(0.2f, 2.2f, 0), 0.016f);
    j = add_joint(wood, vec(0.2f, 1.42f, 0), 0.15f);
    add_segment(wood, -1, j, vec(0.2f, 1.75f, 0), 0.19f);
    scene->eye = vec(3.2f, 3.3f, 5.2f);
    scene->target = vec(0, 1.75f, 0);
}

/* Three old olive trees with trunks half as thick as they are wide, whose boughs double back, on round joins; and
   agaves, whose leaves are flatter still. */
static void olives(struct scene *scene) {
    struct layer *wood =
        add_layer(scene, BARK, vec(0.55f, 0.49f, 0.40f), vec(0.21f, 0.17f, 0.13f), 0.28f, 2, 0.7f);
    struct layer *leaves =
        add_layer(scene, LEAF, vec(0.42f, 0.53f, 0.44f), vec(0.24f, 0.36f, 0.30f), 0.25f, 1, 1.0f);
    static const float places[3][3] = {{-1.7f, -0.6f, 1.0f}, {1.5f, -1.6f, 1.15f}, {0.5f, 1.1f, 0.7f}};
    wood->flat = 0.5f;
    wood->round_joins = 4;
    wood->fitted = 1;
    leaves->flat = 0.22f;
    for (int k = 0; k < 3; ++k) {
        float size = places[k][2], turn = 1.2f * (float)k + 0.5f;
        int root = add_joint(wood, vec(places[k][0], -0.1f, places[k][1]), 0.46f * size), first = wood->segment_count;
        int top = grow(wood, -1, root, vec(0.1f, 1, 0), 1.7f * size, 6, 0.42f * size, 0.34f * size,
                       vec(cosf(turn), 0.6f, sinf(turn)), 0.12f, 0.1f);
        wood->segments[first].wide[0] = cosf(turn + 1.0f);
        wood->segments[first].wide[2] = sinf(turn + 1.0f);
        for (int b = 0; b < 5; ++b) {
            float around = turn + 1.2566f * (float)b, up = b == 0 ? 1.0f : 0.55f, r = (b ? 0.19f : 0.26f) * size;
            struct vec out = vec(cosf(around), up, sinf(around)), back = vec(-sinf(around), 0.9f, cosf(around));
            int made = wood->segment_count;
            int bough =
                grow(wood, top, 0, unit(out), vary(0.9f, 0.2f) * size, 3, r, 0.7f * r, vec(0, 1, 0), 0.1f, 0.2f);
            wood->segments[made].wide[1] = 1;
            bough = grow(wood, bough, 0, unit(back), 0.6f * size, 2, 0.7f * r, 0.5f * r, vec(0, 1, 0), 0.1f, 0.2f);
            out = vec(cosf(around + 2.6f), -0.35f, sinf(around + 2.6f)); /* and doubles back */
            bough = grow(wood, bough, 0, unit(out), 0.45f * size, 2, 0.5f * r, 0.35f * r, vec(0, 1, 0), 0.2f, 0.1f);
            out = vec(cosf(around), 1.2f, sinf(around));
            grow(wood, bough, 0, out, 0.5f * size, 3, 0.35f * r, 0, vec(0, 1, 0), 0.1f, 0.1f);
        }
    }
    for (int k = 0; k < 4; ++k) {
        struct vec at = vec(-2.4f + 1.5f * (float)k, 0, 1.9f + 0.5f * random01());
        int from = leaves->segment_count;
        aloe_at(leaves, at, 0.8f, 21, 5);
        for (int j = from; j < leaves->segment_count; ++j) { /* across the way that a leaf points */
            struct vec way =
                add(joint_at(leaves, leaves->segments[j].top), joint_at(leaves, leaves->segments[j].base), -1);
            leaves->segments[j].wide[0] = -way.z;
            leaves->segments[j].wide[2] = way.x;
        }
    }
    scene->eye = vec(1.0f, 2.4f, 7.2f);
    scene->target = vec(-0.1f, 1.25f, 0);
}

/* A hundred cacti of 21 or 22 segments, 2158 in all. They are grown straight; dance() bends them. */
#define DANCERS 100
static int dancer_segments(int k) { return k < 58 ? 22 : 21; }

static void dance(struct layer *layer, float time) {
    int joint = 0;
    for (int k = 0; k < DANCERS; ++k) {
        int segments = dancer_segments(k), body = segments - 3;
        struct vec at =
            vec(1.5f * (float)(k % 10) - 6.75f + (k / 10 % 2 ? 0.75f : 0), 0, 1.5f * (float)(k / 10) - 9.0f);
        float phase = 6.2832f * (float)(hash3((uint32_t)k, 3, 9) >> 8) / 16777216.0f, r = 0.2f, bend = 0,
              way = phase;
        struct vec d = vec(0, 1, 0);
        for (int i = 0; i <= segments; ++i) {
            conemap_joint *to = &layer->joints[joint++];
            float radius = i <= body ? r * (0.85f + 0.25f * sinf(PI * (float)i / (float)body))
                                     : r * 0.85f * cosf(0.5f * PI * (float)(i - body) / 3.0f);
            if (i == segments) radius = 0;
            if (i > 0) {
                float step = 1.6f / (float)body;
                if (i > body)
                    step = r * 0.85f *
                           (sinf(0.5f * PI * (float)(i - body) / 3.0f) -
                            sinf(0.5f * PI * (float)(i - body - 1) / 3.0f));
                else {
                    bend = 1.1f * sinf(6.2832f * time + phase + 4.0f * (float)i / (float)body) * (float)i /
                           (float)body;
                    way = phase + 0.8f * sinf(6.2832f * time);
                    d = unit(vec(sinf(bend) * cosf(way), cosf(bend), sinf(bend) * sinf(way)));
                }
                at = add(at, d, step);
            }
            to->position[0] = at.x;
            to->position[1] = at.y;
            to->position[2] = at.z;
            to->radius = radius;
            to->thickness = layer->thickness * radius;
        }
    }
}

static void cacti(struct scene *scene) {
    struct layer *layer = add_layer(scene, RIBS, GREEN, DARK_GREEN, 0.25f, 1, 0.8f);
    for (int k = 0; k < DANCERS; ++k) {
        int parent = -1, base = add_joint(layer, vec((float)k, 0, 0), 0.1f);
        for (int i = 0; i < dancer_segments(k); ++i)
            parent = add_segment(layer, parent, base, vec((float)k, (float)(i + 1), 0), 0.1f);
    }
    dance(layer, 0);
    scene->ground = vec(0.62f, 0.50f, 0.35f);
    scene->eye = vec(2.5f, 3.6f, 8.5f);
    scene->target = vec(-0.2f, 0.5f, 0);
}

/* ---- reliefs: 128 x 128 heights that wrap ---------------------------------------------------------------- */

#define SIDE 128
static float wave(float x) { return 0.5f - 0.5f * cosf(6.2831853f * x); }

static float noise(int i, int j, uint32_t cells, uint32_t seed) {
    return (float)value_noise((uint32_t)i, (uint32_t)j, SIDE, cells, seed) / 65535.0f;
}

static float relief_height(enum relief relief, int i, int j) {
    float u = ((float)i + 0.5f) / SIDE, v = ((float)j + 0.5f) / SIDE, x, y;
    switch (relief) {
    case RIBS: /* twelve ribs, with tufts along their ridges */
        x = 0.75f * powf(wave(12 * u), 0.6f);
        y = wave(12 * u) > 0.85f && wave(6 * v) > 0.8f ? 0.25f : 0;
        return x + y * noise(i, j, 64, 3);
    case BARK: /* furrows along the trunk */
        x = fabsf(2 * noise(4 * i % SIDE, j, 4, 1) - 1) + 0.3f * noise(i, j, 16, 2);
        y = fabsf(2 * noise(3 * i % SIDE, j, 8, 2) - 1) + 0.3f * noise(i, j, 32, 3);
        return 1 - 0.55f * expf(-5 * x) - 0.3f * expf(-6 * y) - 0.15f * noise(i, j, 64, 4);
    case RINGS: /* what fallen fronds leave */
        x = v * 6 + 0.15f * wave(2 * u);
        x -= floorf(x);
        return 0.25f + 0.65f * x * x + 0.1f * noise(i, j, 64, 5);
    case STONES: return (float)bricks_at((uint32_t)i, (uint32_t)j, SIDE, 7) / 65535.0f;
    case LEAF: /* thorns in two rows, faint veins */
        x = wave(u) > 0.97f || wave(u) < 0.03f ? 1.0f : 0;
        return 0.45f + 0.05f * wave(20 * u) + (x > 0 && wave(8 * v) > 0.75f ? 0.5f * wave(8 * v) : 0);
    case TILES: /* overlapping rows */
        y = v * 8;
        x = u * 6 + 0.5f * (float)((int)y & 1);
        x -= floorf(x);
        y -= floorf(y);
        return 0.2f + 0.75f * (1 - y) * powf(wave(x), 0.3f);
    default: return 0;
    }
}

static int make_relief(struct layer *layer) {
    static float heights[SIDE * SIDE];
    conemap_desc desc;
    if (layer->relief == SMOOTH) return 1;
    for (int k = 0; k < SIDE * SIDE; ++k) {
        float h = relief_height(layer->relief, k % SIDE, k / SIDE);
        heights[k] = h < 0 ? 0 : h > 1 ? 1 : h;
    }
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.width = desc.heights.height = SIDE;
    desc.wrap_u = desc.wrap_v = CONEMAP_WRAP;
    desc.max_tan = 4;
    conemap_result result = conemap_build(&desc, &layer->map);
    return result == CONEMAP_OK || fail_result("the relief", result);
}

static int skin(struct layer *layer) {
    conemap_skeleton_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.joints = layer->joints;
    desc.joint_count = layer->joint_count;
    desc.segments = layer->segments;
    desc.segment_count = layer->segment_count;
    desc.v_per_length = layer->v_per_length;
    desc.slope_normals = 1;
    desc.round_joins = layer->round_joins;
    desc.fit = desc.exact_u = layer->fitted;
    desc.blend = 0.7f;
    conemap_result result = conemap_skeleton_build(&desc, &layer->skeleton);
    return result == CONEMAP_OK || fail_result("the skeleton", result);
}

/* ---- pictures ------------------------------------------------------------------------------------------- */

struct settings {
    int width, height, samples, relief;
    conemap_march march;
    int steps;
};

static void set_trace(const struct settings *settings, const struct layer *layer, int any_hit,
                      conemap_skeleton_trace_desc *trace) {
    memset(trace, 0, sizeof *trace);
    if (settings->relief && layer->relief != SMOOTH) trace->map = &layer->map;
    trace->height = layer->relief == SMOOTH ? 0.0f : 0.5f;
    trace->march = settings->march;
    trace->steps = settings->steps;
    trace->any_hit = any_hit;
}

/* 1 where the sun reaches, 0 in a shadow. */
static float sunlight(const struct scene *scene, const struct settings *settings, struct vec at,
                      struct vec normal) {
    conemap_ray ray;
    conemap_skeleton_hit hit;
    struct vec from = add(add(at, normal, 2e-3f), scene->sun, 4e-3f);
    ray.origin[0] = from.x;
    ray.origin[1] = from.y;
    ray.origin[2] = from.z;
    ray.direction[0] = scene->sun.x;
    ray.direction[1] = scene->sun.y;
    ray.direction[2] = scene->sun.z;
    ray.t_min = ray.t_max = 0;
    for (int k = 0; k < scene->layer_count; ++k) {
        conemap_skeleton_trace_desc trace;
        set_trace(settings, &scene->layers[k], 1, &trace);
        conemap_skeleton_trace(&scene->layers[k].skeleton, &trace, &ray, &hit, 1);
        if (hit.status == CONEMAP_HIT) return 0;
    }
    return 1;
}

static struct vec lit(const struct scene *scene, struct vec color, struct vec normal, float sun) {
    float facing = dot(normal, scene->sun), direct = sun * (facing > 0 ? facing : 0), sky = 0.5f + 0.5f * normal.y;
    return vec(color.x * (1.9f * direct + 0.42f * sky + 0.12f), color.y * (1.8f * direct + 0.48f * sky + 0.11f),
               color.z * (1.55f * direct + 0.62f * sky + 0.10f));
}

static struct vec look(const struct scene *scene, const struct settings *settings, struct vec eye, struct vec d) {
    conemap_ray ray;
    conemap_skeleton_hit best, hit;
    const struct layer *layer = NULL;
    float t_ground = d.y < 0 ? -eye.y / d.y : 0;
    ray.origin[0] = eye.x;
    ray.origin[1] = eye.y;
    ray.origin[2] = eye.z;
    ray.direction[0] = d.x;
    ray.direction[1] = d.y;
    ray.direction[2] = d.z;
    ray.t_min = 0;
    ray.t_max = t_ground;
    memset(&best, 0, sizeof best);
    for (int k = 0; k < scene->layer_count; ++k) {
        conemap_skeleton_trace_desc trace;
        set_trace(settings, &scene->layers[k], 0, &trace);
        conemap_skeleton_trace(&scene->layers[k].skeleton, &trace, &ray, &hit, 1);
        if (hit.status != CONEMAP_HIT) continue;
        best = hit;
        layer = &scene->layers[k];
        ray.t_max = hit.t;
    }
    if (layer) {
        struct vec at = vec(best.position[0], best.position[1], best.position[2]);
        struct vec n = vec(best.normal[0], best.normal[1], best.normal[2]);
        struct vec flat = vec(best.true_normal[0], best.true_normal[1], best.true_normal[2]);
        float w = settings->relief && layer->relief != SMOOTH ? best.w : 0.8f, sun;
        struct vec color = add(layer->deep, add(layer->color, layer->deep, -1), w < 0 ? 0 : w > 1 ? 1 : w);
        color = vec(color.x * color.x, color.y * color.y, color.z * color.z); /* to linear light */
        sun = dot(n, scene->sun) > 0 ? sunlight(scene, settings, at, flat) : 0;
        return lit(scene, color, n, sun);
    }
    if (t_ground > 0) {
        struct vec at = add(eye, d, t_ground), color = scene->ground, haze = vec(0.62f, 0.70f, 0.80f), shade;
        float far_out = 1 - expf(-0.0004f * t_ground * t_ground),
              sun = t_ground < 60 ? sunlight(scene, settings, at, vec(0, 1, 0)) : 1;
        if (at.x * at.x + 2.0f * (at.z - 1.2f) * (at.z - 1.2f) < scene->pool * scene->pool)
            color = vec(0.24f, 0.38f, 0.46f);
        shade = lit(scene, vec(color.x * color.x, color.y * color.y, color.z * color.z), vec(0, 1, 0), sun);
        return add(shade, add(haze, shade, -1), far_out);
    }
    return add(vec(0.62f, 0.70f, 0.80f), vec(-0.36f, -0.30f, -0.12f), d.y > 0.6f ? 1 : d.y / 0.6f);
}

static unsigned char screen(float x) {
    x = x < 0 ? 0 : x > 1 ? 1 : x;
    return (unsigned char)(sqrtf(x) * 255.0f + 0.5f);
}

static int picture(const struct scene *scene, const struct settings *settings, const char *path) {
    int width = settings->width, height = settings->height, n = settings->samples;
    unsigned char *pixels = (unsigned char *)malloc((size_t)width * (size_t)height * 3);
    struct vec back = unit(add(scene->eye, scene->target, -1)), right = unit(cross(vec(0, 1, 0), back)),
               up = cross(back, right);
    struct progress progress;
    if (!pixels) return fail("a picture of %d x %d is too large for the memory at hand", width, height);
    progress_begin(&progress, path);
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            struct vec sum = vec(0, 0, 0);
            for (int k = 0; k < n * n; ++k) {
                float px = ((float)x + ((float)(k % n) + 0.5f) / (float)n) / (float)width * 2 - 1;
                float py = 1 - ((float)y + ((float)(k / n) + 0.5f) / (float)n) / (float)height * 2;
                struct vec d =
                    add(add(add(vec(0, 0, 0), back, -1), right, 0.42f * px * (float)width / (float)height), up,
                        0.42f * py);
                struct vec c = look(scene, settings, scene->eye, unit(d));
                sum =
                    add(sum, vec(c.x > 1 ? 1 : c.x, c.y > 1 ? 1 : c.y, c.z > 1 ? 1 : c.z), 1.0f / (float)(n * n));
            }
            unsigned char *pixel = pixels + 3 * ((size_t)y * (size_t)width + (size_t)x);
            pixel[0] = screen(sum.x);
            pixel[1] = screen(sum.y);
            pixel[2] = screen(sum.z);
        }
        progress_show((y + 1) / (double)height, &progress);
    }
    progress_end(&progress);
    int good = png_write(path, pixels, width, height, 3);
    free(pixels);
    return good;
}

/* ---- the program ------------------------------------------------------------------------------------------ */

static const struct {
    const char *name;
    void (*grow)(struct scene *scene);
} models[] = {{"saguaro", saguaro}, {"aloe", aloe},       {"well", well}, {"desert", desert}, {"elm", elm},
              {"cacti", cacti},     {"coconut", coconut}, {"pine", pine}, {"oasis", oasis},
              {"olives", olives}};
enum { MODELS = sizeof models / sizeof models[0] };

static int render_model(int model, struct settings settings, int relief_only, int frames, const char *folder) {
    struct scene scene;
    char path[512];
    int good = 1;
    memset(&scene, 0, sizeof scene);
    scene.ground = vec(0.52f, 0.50f, 0.40f);
    scene.sun = unit(vec(0.62f, 0.80f, 0.45f));
    seed_now = 1;
    models[model].grow(&scene);
    for (int k = 0; good && k < scene.layer_count; ++k)
        good = make_relief(&scene.layers[k]) && skin(&scene.layers[k]);
    if (good) printf("%s: %d segments\n", models[model].name, total_segments(&scene));
    for (int plain = 0; good && plain < (relief_only ? 1 : 2); ++plain) {
        double start = seconds();
        int clamped = 0;
        settings.relief = !plain;
        snprintf(path, sizeof path, "%s/%s%s.png", folder, models[model].name, plain ? "-plain" : "");
        good = picture(&scene, &settings, path);
        for (int k = 0; k < scene.layer_count; ++k) clamped += scene.layers[k].skeleton.clamped;
        if (good) printf("  %s: %.2f s, %d clamped\n", path, seconds() - start, clamped);
    }
    settings.relief = 1;
    for (int frame = 1; good && models[model].grow == cacti && frame < frames; ++frame) {
        struct layer *layer = &scene.layers[0];
        dance(layer, (float)frame / (float)frames);
        double start = seconds();
        conemap_result result = conemap_skeleton_update(&layer->skeleton, layer->joints);
        double took = seconds() - start;
        good = result == CONEMAP_OK || fail_result("the dance", result);
        snprintf(path, sizeof path, "%s/cacti-%d.png", folder, frame);
        good = good && picture(&scene, &settings, path);
        if (good) printf("  %s: updated in %.2f ms, %d clamped\n", path, took * 1e3, layer->skeleton.clamped);
    }
    for (int k = 0; k < scene.layer_count; ++k) {
        conemap_skeleton_free(&scene.layers[k].skeleton);
        conemap_free(&scene.layers[k].map);
        free(scene.layers[k].joints);
        free(scene.layers[k].segments);
    }
    return good;
}

static void print_help(void) {
    printf(
        "usage: tree [options] [MODEL...]\n"
        "Grows models as skeletons, skins them with relief-mapped frusta, renders them with and without relief.\n"
        "  MODEL          one of:");
    for (int k = 0; k < MODELS; ++k) printf(" %s", models[k].name);
    printf(" (default: all)\n"
           "  --size WxH     pixels (400x300)\n"
           "  --samples N    squared: rays a pixel (2)\n"
           "  --relief-only  not the pictures without relief\n"
           "  --frames N     of the cacti's dance (4)\n"
           "  --march NAME   steps or cones (cones)\n"
           "  --steps N      through the shell (64, cones 256)\n"
           "  -o FOLDER      where the pictures go (out)\n");
}

int main(int argc, char **argv) {
    static const struct name march_names[] = {
        {"steps", CONEMAP_MARCH_STEPS}, {"cones", CONEMAP_MARCH_CONES}, {NULL, 0}};
    struct args args = {argc, 0, argv, "", 0};
    struct settings settings;
    const char *folder = "out";
    int frames = 4, wanted[MODELS] = {0}, any = 0, relief_only = 0;
    program_name = "tree";
    memset(&settings, 0, sizeof settings);
    settings.width = 400;
    settings.height = 300;
    settings.samples = 2;
    while (next_arg(&args)) {
        int model = 0;
        if (arg_is(&args, "--help") || arg_is(&args, "-h")) return print_help(), 0;
        while (model < MODELS && !arg_is(&args, models[model].name)) ++model;
        if (model < MODELS)
            wanted[model] = any = 1;
        else if (arg_is(&args, "--size"))
            arg_size(&args, 16384, &settings.width, &settings.height);
        else if (arg_is(&args, "--samples"))
            settings.samples = arg_int(&args, 1, 8);
        else if (arg_is(&args, "--relief-only"))
            relief_only = 1;
        else if (arg_is(&args, "--frames"))
            frames = arg_int(&args, 1, 10000);
        else if (arg_is(&args, "--march"))
            settings.march = (conemap_march)arg_name(&args, march_names);
        else if (arg_is(&args, "--steps"))
            settings.steps = arg_int(&args, 1, 1 << 20);
        else if (arg_is(&args, "-o"))
            folder = arg_text(&args);
        else
            arg_unknown(&args);
    }
    if (args.failed) return 1;
    make_directory(folder);
    for (int k = 0; k < MODELS; ++k)
        if ((wanted[k] || !any) && !render_model(k, settings, relief_only, frames, folder)) return 1;
    return 0;
}
