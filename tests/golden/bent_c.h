// conemap.h: exact tracer, with effects.
// bent_shade(effects, frame, origin, direction, gradient, size): traces a ray of the world and shades what it meets.
// gradient: dFdx and dFdy of the surface's own uv.
// size: the map's width and height in texels.
// bent_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


float bent_alpha(int i, int j); // the host's

typedef struct bent_vec2 {
    float x, y;
} bent_vec2;

bent_vec2 bent_fetch(int i, int j, int level);

typedef struct bent_vec3 {
    float x, y, z;
} bent_vec3;

typedef struct bent_vec4 {
    float x, y, z, w;
} bent_vec4;

typedef struct bent_shading {
    bool found;
    float t;
    bent_vec3 box;         // u, v, z
    bent_vec3 position;
    bent_vec3 normal;
    float depth;
    float shadow;    // 0 dark to 1 lit
    float occlusion; // 0 closed to 1 open
    bent_vec2 uv;
    bent_vec4 gradient;    // dFdx and dFdy of the surface's uv
    float level;
    float fade;      // 0 relief to 1 normals only
} bent_shading;

typedef struct bent_effects {
    bent_vec4 clip;           // least u and v, greatest u and v
    bent_vec4 clip_z, clip_w; // rows of the matrix: clip z and w of (position, 1)
    bent_vec4 light;          // towards the light, 0; or its position, 1
    float light_radius;  // radians, or the radius of the ball at a position
    float alpha_cut;     // texels below it are holes
    float lod_bias;       // added to the level
    int lod_steps;         // the step cap at level 0; 0: none
    int level_count;
    float fade_begin;     // pixels that the relief is high
    float fade_end;
} bent_effects;

typedef struct bent_frame {
    bent_vec3 origin;                     // where the surface has uv_offset
    bent_vec3 tangent, bitangent, normal; // world per x, y and height
    bent_vec2 uv_offset, uv_scale;        // map widths per unit of x, and of y
    float depth, level;              // how high z = 1 stands over z = 0; the z of the surface
    bent_vec3 curvature;                  // xx, xy, yy
} bent_frame;

typedef struct bent_ivec2 {
    int x, y;
} bent_ivec2;

static bent_vec3 bent_make_vec3(float x, float y, float z) {
    bent_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

typedef struct bent_basis {
    bent_vec3 u, v, z;          // world per u, v and z
    bent_vec3 to_u, to_v, to_z; // and back
    bent_vec3 origin;
    bent_vec2 offset;
    float level;
    bent_vec3 bend;             // the base falls by (x u u + 2 y u v + z v v) / 2
} bent_basis;

static bent_vec3 bent_cross(bent_vec3 a, bent_vec3 b) {
    return bent_make_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static float bent_dot(bent_vec3 a, bent_vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static bent_vec3 bent_scaled(bent_vec3 a, float scale) {
    return bent_make_vec3(a.x * scale, a.y * scale, a.z * scale);
}

static bent_basis bent_make_basis(bent_frame frame, bent_vec3 toward) {
    bent_basis b;
    float scale_v = frame.uv_scale.y;
    bent_vec3 plane = bent_cross(frame.tangent, frame.bitangent); // seen from behind its normal turns over
    float side = bent_dot(plane, frame.normal) * bent_dot(plane, toward) > 0.0f ? -1.0f : 1.0f;
    b.u = bent_scaled(frame.tangent, 1.0f / frame.uv_scale.x);
    b.v = bent_scaled(frame.bitangent, 1.0f / scale_v);
    b.z = bent_scaled(frame.normal, side * frame.depth);
    b.to_u = bent_cross(b.v, b.z);
    b.to_v = bent_cross(b.z, b.u);
    b.to_z = bent_cross(b.u, b.v);
    float volume = bent_dot(b.u, b.to_u);
    b.to_u = bent_scaled(b.to_u, 1.0f / volume);
    b.to_v = bent_scaled(b.to_v, 1.0f / volume);
    b.to_z = bent_scaled(b.to_z, 1.0f / volume);
    b.origin = frame.origin;
    b.offset = frame.uv_offset;
    b.level = frame.level;
    float x = 1.0f / frame.uv_scale.x, y = 1.0f / scale_v;
    b.bend = bent_make_vec3(frame.curvature.x * x * x / frame.depth, frame.curvature.y * x * y / frame.depth,
                  frame.curvature.z * y * y / frame.depth);
    return b;
}

// log2 of the texels under a pixel.
static float bent_level_of(bent_vec4 gradient, float w, float h) {
    float x = gradient.x * gradient.x * w * w + gradient.y * gradient.y * h * h;
    float y = gradient.z * gradient.z * w * w + gradient.w * gradient.w * h * h;
    return 0.5f * log2f(fmaxf(fmaxf(x, y), 1e-30f));
}

// From how many pixels high the relief stands: a pixel is its footprint's area over its length.
static float bent_fade_of(bent_basis b, bent_vec4 gradient, float begin, float end) {
    float x = gradient.x * gradient.x + gradient.y * gradient.y;
    float y = gradient.z * gradient.z + gradient.w * gradient.w;
    float area = fabsf(gradient.x * gradient.w - gradient.y * gradient.z), longest = sqrtf(fmaxf(x, y));
    float pixel = longest > 0.0f ? area / longest : 0.0f;
    float faded = (begin - sqrtf(bent_dot(b.z, b.z) / bent_dot(b.u, b.u)) / fmaxf(pixel, 1e-30f)) / (begin - end);
    faded = fminf(fmaxf(faded, 0.0f), 1.0f);
    return faded * faded * (3.0f - 2.0f * faded);
}

// A direction, and a point, of the world in the box.
static bent_vec3 bent_box_direction(bent_basis b, bent_vec3 d) {
    return bent_make_vec3(bent_dot(b.to_u, d), bent_dot(b.to_v, d), bent_dot(b.to_z, d));
}

// p + t d
static bent_vec3 bent_along(bent_vec3 p, float t, bent_vec3 d) {
    return bent_make_vec3(p.x + t * d.x, p.y + t * d.y, p.z + t * d.z);
}

static bent_vec3 bent_box_point(bent_basis b, bent_vec3 p) {
    bent_vec3 d = bent_box_direction(b, bent_along(p, -1.0f, b.origin));
    return bent_make_vec3(d.x + b.offset.x, d.y + b.offset.y, d.z + b.level);
}

static bent_vec2 bent_make_vec2(float x, float y) {
    bent_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static bent_vec4 bent_make_vec4(float x, float y, float z, float w) {
    bent_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static bent_vec2 bent_clip(bent_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return bent_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return bent_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

// How far the base lies below its tangent plane, in z.
static float bent_drop(bent_basis b, float u, float v) {
    float x = u - b.offset.x, y = v - b.offset.y;
    return 0.5f * (b.bend.x * x * x + 2.0f * b.bend.y * x * y + b.bend.z * y * y);
}

typedef struct bent_lattice {
    int i, j;           // the texel behind; x and y, the place from there, grow along the ray
    float x, y, vx, vy;
} bent_lattice;

typedef struct bent_course {
    bent_lattice cell;
    bent_lattice coarse; // of the next level
    float weight;           // and its share
    bent_lattice leaf;   // the texels of the alpha map, as squares
    float alpha_cut;
    int wall;               // whose border was crossed last
    bool hole;
    int si, sj;
    float t, end, z, rise, speed;
    float bend;             // its height is z + rise t + bend t t
    bool found;
} bent_course;

static bent_ivec2 bent_make_ivec2(int x, int y) {
    bent_ivec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static bent_ivec2 bent_level_size(bent_ivec2 size, int level) {
    return bent_make_ivec2((size.x >> level) > 1 ? size.x >> level : 1, (size.y >> level) > 1 ? size.y >> level : 1);
}

static bent_lattice bent_lay(bent_vec3 o, bent_vec3 d, float w, float h, float shift) {
    bent_lattice l;
    l.i = 0;
    l.j = 0;
    l.x = (d.x < 0.0f ? -1.0f : 1.0f) * (o.x * w - shift);
    l.y = (d.y < 0.0f ? -1.0f : 1.0f) * (o.y * h - shift);
    l.vx = fmaxf(fabsf(d.x) * w, 1e-20f);
    l.vy = fmaxf(fabsf(d.y) * h, 1e-20f);
    return l;
}

// How that grows along (du, dv), and half of how its growth grows.
static float bent_drop_along(bent_basis b, float u, float v, float du, float dv) {
    float x = u - b.offset.x, y = v - b.offset.y;
    return (b.bend.x * x + b.bend.y * y) * du + (b.bend.y * x + b.bend.z * y) * dv;
}

static float bent_bend_along(bent_basis b, float du, float dv) {
    return 0.5f * (b.bend.x * du * du + 2.0f * b.bend.y * du * dv + b.bend.z * dv * dv);
}

// Until just over the next border.
static float bent_stay(bent_lattice l) {
    return fminf((1.000001f - l.x) / l.vx, (1.000001f - l.y) / l.vy);
}

static bent_lattice bent_move(bent_lattice l, float dt, int si, int sj) {
    l.x += l.vx * dt; l.y += l.vy * dt;
    l.i += si * (int)(floorf(l.x)); l.x -= floorf(l.x); l.j += sj * (int)(floorf(l.y)); l.y -= floorf(l.y);
    return l;
}

static bent_course bent_fly_on(bent_course c, float dt) {
    if (bent_stay(c.leaf) <= dt) c.wall = (1.0f - c.leaf.x) * c.leaf.vy <= (1.0f - c.leaf.y) * c.leaf.vx ? 1 : 2;
    c.cell = bent_move(c.cell, dt, c.si, c.sj);
    c.coarse = bent_move(c.coarse, dt, c.si, c.sj);
    c.leaf = bent_move(c.leaf, dt, c.si, c.sj);
    c.t += dt;
    c.z += (c.rise + c.bend * dt) * dt;
    c.rise += 2.0f * c.bend * dt;
    return c;
}

// First t from 0 on at which c + b t + a t t is 0 or less, or 1e30.
static float bent_first_root(float c, float b, float a) {
    float d = b * b - 4.0f * a * c, q = -0.5f * (b + (b < 0.0f ? -1.0f : 1.0f) * sqrtf(fmaxf(d, 0.0f)));
    float first = q != 0.0f ? c / q : -1.0f, second = a != 0.0f ? q / a : -1.0f;
    if (first < 0.0f || (second >= 0.0f && second < first)) first = second;
    return c <= 0.0f ? 0.0f : d >= 0.0f && first >= 0.0f ? first : 1e30f;
}

// A flight from o, whose z counts from the base.
static bent_course bent_take_off(bent_basis b, bent_vec3 o, bent_vec3 d, bent_vec2 range, float weight, float alpha_cut, bent_ivec2 size, int level) {
    bent_course c;
    bent_ivec2 fine = bent_level_size(size, level), next = bent_level_size(size, level + 1);
    c.cell = bent_lay(o, d, (float)(fine.x), (float)(fine.y), 0.5f);
    c.coarse = bent_lay(o, d, (float)(next.x), (float)(next.y), 0.5f);
    c.weight = weight;
    c.leaf = bent_lay(o, d, (float)(size.x), (float)(size.y), 0.0f);
    c.alpha_cut = alpha_cut;
    c.wall = 0;
    c.hole = true; // what is met at once is met from outside
    c.si = d.x < 0.0f ? -1 : 1;
    c.sj = d.y < 0.0f ? -1 : 1;
    c.t = 0.0f;
    c.z = o.z;
    c.speed = sqrtf(d.x * d.x + d.y * d.y);
    c.found = false;
    c.rise = d.z + bent_drop_along(b, o.x, o.y, d.x, d.y);
    c.bend = bent_bend_along(b, d.x, d.y);
    bool over = range.x <= range.y && range.x * (c.cell.vx + c.cell.vy) < 1e9f; // as far as an int goes
    if (over) c = bent_fly_on(c, range.x);
    c.end = over ? range.y : -1.0f;
    c.end = fminf(c.end, c.t + 1048576.0f / (c.cell.vx + c.cell.vy)); // a float knows no cells beyond
    float up = bent_first_root(-c.z, -c.rise, -c.bend); // to the floor, from below
    if (up > c.end - c.t) c.end = -1.0f;
    if (c.end >= 0.0f) c = bent_fly_on(c, up);
    c.wall = 0;
    return c;
}

// How long the course stays in its cells.
static float bent_border(bent_course c) {
    float leave = bent_stay(c.cell);
    if (c.weight > 0.0f) leave = fminf(leave, bent_stay(c.coarse));
    leave = fminf(leave, bent_stay(c.leaf));
    return leave;
}

static int bent_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static bent_vec2 bent_texel(int i, int j, bent_ivec2 size, int level) {
    return bent_fetch(bent_repeat(i, size.x), bent_repeat(j, size.y), level);
}

static float bent_mix(bent_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height, its growth and bend, and 1 / tan under a course.
static bent_vec4 bent_patch(bent_lattice l, int si, int sj, bent_ivec2 size, int level) {
    bent_vec2 a = bent_texel(l.i, l.j, size, level), b = bent_texel(l.i + si, l.j, size, level);
    bent_vec2 c = bent_texel(l.i, l.j + sj, size, level), d = bent_texel(l.i + si, l.j + sj, size, level);
    float hx = b.x - a.x, hy = c.x - a.x, hxy = d.x - c.x - hx;
    float height = bent_mix(bent_make_vec4(a.x, b.x, c.x, d.x), l.x, l.y);
    float cone = bent_mix(bent_make_vec4(a.y, b.y, c.y, d.y), l.x, l.y);
    return bent_make_vec4(height, hx * l.vx + hy * l.vy + hxy * (l.x * l.vy + l.y * l.vx), hxy * l.vx * l.vy,
                1.0f / fmaxf(cone * cone, 1e-9f));
}

static bent_vec4 bent_ground(bent_course c, bent_ivec2 size, int level) {
    bent_vec4 a = bent_patch(c.cell, c.si, c.sj, bent_level_size(size, level), level);
    if (c.weight == 0.0f) return a;
    bent_vec4 b = bent_patch(c.coarse, c.si, c.sj, bent_level_size(size, level + 1), level + 1);
    return bent_make_vec4(a.x + (b.x - a.x) * c.weight, a.y + (b.y - a.y) * c.weight, a.z + (b.z - a.z) * c.weight,
                a.w + (b.w - a.w) * c.weight); // of slopes: the blend of tangents would be too wide
}

static bool bent_over_hole(bent_course c, bent_ivec2 size) {
    int i = c.si > 0 ? c.leaf.i : c.leaf.i - 1, j = c.sj > 0 ? c.leaf.j : c.leaf.j - 1;
    return bent_alpha(bent_repeat(i, size.x), bent_repeat(j, size.y)) < c.alpha_cut;
}

// How far the course may go on unseen: down to the highest texel, or out of the cone.
static float bent_free_way(bent_course c, float gap, float steepness) {
    float room = gap - 1.0f / 1048576.0f;
    if (c.z > 1.0f) return bent_first_root(c.z - 1.0f, c.rise, c.bend);
    return room > 0.0f ? bent_first_root(room, c.rise - c.speed * steepness, c.bend) : 0.0f;
}

// To the first meeting.
static bent_course bent_fly(bent_course c, int max_steps, bent_ivec2 size, int level) {
    bool done = c.t > c.end;
    for (int steps = 0; !done && steps < max_steps; ++steps) {
        float leave = bent_border(c), left = c.end - c.t;
        bent_vec4 ground = bent_ground(c, size, level);
        float gap = c.z - ground.x, dt = bent_first_root(gap, c.rise - ground.y, c.bend - ground.z);
        bool hole = bent_over_hole(c, size), inside = gap <= 0.0f && c.hole;
        if (hole) dt = bent_first_root(c.z, c.rise, c.bend); // the floor ends it
        bool met = dt <= fminf(leave, left);
        c.found = met && !hole;
        if (!met) dt = fmaxf(leave, bent_free_way(c, gap, ground.w));
        c.hole = hole && dt <= leave; // a jump ends over the surface
        done = met || dt >= left;
        if (c.found || !done) c = bent_fly_on(c, dt);
        if (c.found && !inside) c.wall = 0;
    }
    if (!done) c.found = true; // out of steps: shaded where it is
    return c;
}

// Where a ray meets the base itself, from either side.
static float bent_base(bent_basis b, bent_vec3 o, bent_vec3 d) {
    float over = o.z + bent_drop(b, o.x, o.y) - b.level, side = over < 0.0f ? -1.0f : 1.0f;
    float rise = d.z + bent_drop_along(b, o.x, o.y, d.x, d.y), bend = bent_bend_along(b, d.x, d.y);
    return bent_first_root(side * over, side * rise, side * bend);
}

typedef struct bent_ground_at {
    float height;
    bent_vec2 slope;      // of the cell
    bent_vec2 gentle;     // of the texels' derivatives, interpolated
    float steepness; // 1 / tan of the cone
} bent_ground_at;

// dh/du and dh/dv at a texel, per texel.
static bent_vec2 bent_difference(int i, int j, bent_ivec2 size, int level) {
    float x = bent_texel(i + 1, j, size, level).x - bent_texel(i - 1, j, size, level).x;
    float y = bent_texel(i, j + 1, size, level).x - bent_texel(i, j - 1, size, level).x;
    x *= 0.5f;
    y *= 0.5f;
    return bent_make_vec2(x, y);
}

static bent_ground_at bent_look(bent_vec3 box, bent_ivec2 size, int level) {
    bent_ground_at g;
    float x = box.x * (float)(size.x) - 0.5f, y = box.y * (float)(size.y) - 0.5f;
    int i = (int)(floorf(x)), j = (int)(floorf(y));
    x -= (float)(i);
    y -= (float)(j);
    bent_vec2 a = bent_texel(i, j, size, level), b = bent_texel(i + 1, j, size, level);
    bent_vec2 c = bent_texel(i, j + 1, size, level), d = bent_texel(i + 1, j + 1, size, level);
    bent_vec4 heights = bent_make_vec4(a.x, b.x, c.x, d.x);
    float hx = heights.y - heights.x, hy = heights.z - heights.x, hxy = heights.w - heights.z - hx;
    float height = bent_mix(heights, x, y);
    g.height = height;
    g.slope = bent_make_vec2((hx + hxy * y) * (float)(size.x), (hy + hxy * x) * (float)(size.y));
    bent_vec2 p = bent_difference(i, j, size, level), q = bent_difference(i + 1, j, size, level);
    bent_vec2 r = bent_difference(i, j + 1, size, level), s = bent_difference(i + 1, j + 1, size, level);
    g.gentle = bent_make_vec2(bent_mix(bent_make_vec4(p.x, q.x, r.x, s.x), x, y) * (float)(size.x),
                    bent_mix(bent_make_vec4(p.y, q.y, r.y, s.y), x, y) * (float)(size.y));
    float cone = bent_mix(bent_make_vec4(a.y, b.y, c.y, d.y), x, y);
    g.steepness = 1.0f / fmaxf(cone * cone, 1e-9f);
    return g;
}

static bent_ground_at bent_blend(bent_ground_at a, bent_ground_at b, float weight) {
    a.height += (b.height - a.height) * weight;
    a.slope = bent_make_vec2(a.slope.x + (b.slope.x - a.slope.x) * weight, a.slope.y + (b.slope.y - a.slope.y) * weight);
    a.gentle = bent_make_vec2(a.gentle.x + (b.gentle.x - a.gentle.x) * weight,
                    a.gentle.y + (b.gentle.y - a.gentle.y) * weight);
    a.steepness += (b.steepness - a.steepness) * weight;
    return a;
}

static bent_vec3 bent_normalize(bent_vec3 a) {
    return bent_scaled(a, 1.0f / sqrtf(bent_dot(a, a)));
}

// Of a surface with these slopes: rows of the way back are the gradients of u, v and z.
static bent_vec3 bent_world_normal(bent_basis b, bent_vec3 box, bent_vec2 slope) {
    float zu = slope.x - bent_drop_along(b, box.x, box.y, 1.0f, 0.0f);
    float zv = slope.y - bent_drop_along(b, box.x, box.y, 0.0f, 1.0f);
    bent_vec3 n = bent_along(bent_along(b.to_z, -zu, b.to_u), -zv, b.to_v);
    return bent_normalize(n);
}

// The side of the rectangle through which a ray came in just where it hit: 1 for u, 2 for v, 0 for none.
static int bent_wall(bent_vec3 o, bent_vec3 d, bent_vec4 bounds, float t) {
    float in_u = bent_clip(bent_make_vec2(0.0f, 1e30f), o.x, d.x, bounds.x, bounds.z).x;
    float in_v = bent_clip(bent_make_vec2(0.0f, 1e30f), o.y, d.y, bounds.y, bounds.w).x;
    float enter = fmaxf(in_u, in_v);
    return enter <= 0.0f || t > enter * 1.00001f ? 0 : in_v > in_u ? 2 : 1;
}

static bent_vec3 bent_world_point(bent_basis b, bent_vec3 box) {
    bent_vec3 p = bent_along(b.origin, box.x - b.offset.x, b.u);
    p = bent_along(p, box.y - b.offset.y, b.v);
    return bent_along(p, box.z - b.level - bent_drop(b, box.x, box.y), b.z);
}

// The direction to the light, and how far it is.
static bent_vec4 bent_toward(bent_vec4 light, bent_basis b, bent_vec3 place) {
    bent_vec3 d = bent_make_vec3(light.x, light.y, light.z);
    if (light.w != 0.0f) d = bent_along(d, -1.0f, bent_world_point(b, place));
    float length = sqrtf(bent_dot(d, d));
    return bent_make_vec4(d.x / length, d.y / length, d.z / length, light.w != 0.0f ? length : 1e30f);
}

// A light's disc: its middle, to its side, its radius; how much of it is up, and how a step up moves across it.
typedef struct bent_disc {
    bent_vec3 light, side;
    float radius, above, lift, height, reach;
} bent_disc;

// A course towards a direction of the world.
static bent_course bent_look_along(bent_basis b, bent_vec3 place, bent_vec3 direction, float t_max,
                                     bent_vec4 bounds, float weight, float alpha_cut, bent_ivec2 size, int level) {
    bent_vec3 d = bent_box_direction(b, direction);
    bent_vec2 range = bent_clip(bent_make_vec2(0.0f, t_max), place.x, d.x, bounds.x, bounds.z);
    range = bent_clip(range, place.y, d.y, bounds.y, bounds.w);
    return bent_take_off(b, place, d, range, weight, alpha_cut, size, level);
}

// The steepest rise, from low to high, at which a course still touches what lies under it. What was passed below the
// lower flight is below the higher one.
static float bent_horizon(bent_course c, float low, float high, float grain, bent_ivec2 size, int level) {
    float z0 = c.z, begin = c.t, rise = low;
    bool done = c.t > c.end;
    c.rise = low;
    for (int steps = 0; !done && steps < 128 * (size.x + size.y); ++steps) {
        float leave = bent_border(c), left = c.end - c.t, end = fminf(leave, left), t = c.t - begin;
        float above = 1.0f - z0 - c.bend * t * t; // what the highest texel could still do
        if (c.bend >= 0.0f && above <= (rise + grain) * (above > 0.0f ? t : c.end - begin)) break;
        bent_vec4 ground = bent_ground(c, size, level);
        float gap = c.z - ground.x, b = c.rise - ground.y, a = c.bend - ground.z, most = rise;
        if (!bent_over_hole(c, size) && bent_first_root(gap, b, a) <= end) { // the greatest of rise - gap / t in this cell
            if (t == 0.0f && gap < 0.0f) return high;
            float lowest = gap - b * t + a * t * t; // the gap with which the parabola left
            if (t > 0.0f) most = fmaxf(most, rise - gap / t);
            if (t + end > 0.0f && end < 1e30f) most = fmaxf(most, rise - (gap + (b + a * end) * end) / (t + end));
            if (lowest > 0.0f && a > 0.0f) {
                float dt = sqrtf(lowest / a) - t;
                if (dt > 0.0f && dt < end) most = fmaxf(most, rise - (gap + (b + a * dt) * dt) / (t + dt));
            }
            if (most >= high) return high;
            c.z += (most - rise) * t;
            c.rise += most - rise;
            rise = most;
            gap = c.z - ground.x;
        }
        float dt = fmaxf(leave, bent_free_way(c, gap, ground.w));
        done = dt >= left;
        if (!done) c = bent_fly_on(c, dt);
    }
    return rise;
}

// The horizon, -1..1 radii from the disc's middle, y radii to the side of it.
static float bent_disc_horizon(bent_basis b, bent_vec3 place, bent_disc disc, float y, bent_vec4 bounds, float weight, float alpha_cut, bent_ivec2 size, int level) {
    bent_vec3 direction = bent_along(disc.light, y * disc.radius, disc.side);
    bent_course c = bent_look_along(b, place, direction, disc.reach, bounds, weight, alpha_cut, size, level);
    float rise = c.rise, r = disc.radius, down = r / ((disc.lift + r * disc.above) * disc.height);
    float high = rise + r / ((disc.lift - r * disc.above) * disc.height);
    float s = (bent_horizon(c, rise - down, high, down / 1024.0f, size, level) - rise) * disc.height;
    return fminf(fmaxf(s * disc.lift / (r * (1.0f + s * disc.above)), -1.0f), 1.0f);
}

// Of a strip of the unit disc: what stands above a horizon from (y0, x0) to (y1, x1), and its own area.
static bent_vec2 bent_strip(float y0, float x0, float y1, float x1) {
    float seen = 0.0f, area = 0.0f, part = 0.25f * (y1 - y0);
    for (int k = 0; k < 4; ++k) {
        float at = 0.25f * ((float)(k) + 0.5f), y = y0 + (y1 - y0) * at, x = x0 + (x1 - x0) * at;
        float across = sqrtf(1.0f - y * y);
        seen += part * fminf(fmaxf(across - x, 0.0f), 2.0f * across);
        area += part * 2.0f * across;
    }
    return bent_make_vec2(seen, area);
}

// The share of the light's disc that is seen: cut by horizons in five directions, and by more between two that differ.
static float bent_soft_shadow(bent_basis b, bent_vec3 place, bent_vec3 light, float radius, float reach,
                             bent_vec4 bounds, float weight, float alpha_cut, bent_ivec2 size, int level) {
    float ends[12], horizons[12], y0 = -1.0f, x0 = 0.0f, seen = 0.0f, area = 0.0f; // 2: not looked at yet
    bent_disc disc;
    int top = 5;
    disc.height = sqrtf(bent_dot(b.z, b.z));
    bent_vec3 up = bent_scaled(b.z, 1.0f / disc.height);
    disc.light = light;
    disc.above = bent_dot(light, up);
    disc.side = bent_cross(light, up);
    disc.lift = sqrtf(bent_dot(disc.side, disc.side));
    if (disc.lift <= 1e-5f) return disc.above > 0.0f ? 1.0f : 0.0f; // overhead
    disc.side = bent_scaled(disc.side, 1.0f / disc.lift);
    disc.radius = fmaxf(fminf(radius, 0.99f * disc.lift / fmaxf(fabsf(disc.above), 1e-6f)), 1e-6f); // without the zenith
    disc.reach = reach;
    for (int n = 0; n < 12; ++n) {
        ends[n] = 1.0f - 0.5f * (float)(n);
        horizons[n] = 2.0f;
    }
    for (int k = 0; k < 600 && top > 0; ++k) {
        float y = ends[top - 1], x = horizons[top - 1];
        if (x > 1.0f) x = bent_disc_horizon(b, place, disc, y, bounds, weight, alpha_cut, size, level);
        horizons[top - 1] = x;
        if (fabsf(x - x0) > 0.25f && y - y0 > 0.01f) { // half a strip, halved 6 times at most
            ends[top] = 0.5f * (y0 + y);
            horizons[top] = 2.0f;
            ++top;
        } else {
            bent_vec2 strip = bent_strip(y0, x0, y, x);
            seen += strip.x;
            area += strip.y;
            y0 = y;
            x0 = x;
            --top;
        }
    }
    return fminf(fmaxf(seen / area, 0.0f), 1.0f);
}

// Traces a ray of the world through the relief that the frame puts on a surface, and shades the hit.
static bent_shading bent_shade(bent_effects e, bent_frame frame, bent_vec3 origin, bent_vec3 direction, bent_vec4 gradient, bent_ivec2 size) {
    bent_shading s;
    s.position = bent_make_vec3(0.0f, 0.0f, 0.0f);
    s.normal = bent_make_vec3(0.0f, 0.0f, 0.0f);
    s.depth = 0.0f;
    s.shadow = 1.0f;
    s.occlusion = 1.0f;
    bent_basis basis = bent_make_basis(frame, direction);
    s.level = fminf(fmaxf(bent_level_of(gradient, (float)(size.x), (float)(size.y)) + e.lod_bias, 0.0f), (float)(e.level_count - 1));
    int level = (int)(s.level), cap = (int)(fmaxf(8.0f, ceilf((float)(e.lod_steps) * exp2f(-s.level))));
    if (e.lod_steps == 0 || cap > 128 * (size.x + size.y)) cap = 128 * (size.x + size.y);
    float weight = s.level - (float)(level);
    bent_basis upright = basis; // before it is flattened
    s.fade = bent_fade_of(basis, gradient, e.fade_begin, e.fade_end);
    frame.depth *= 1.0f - fminf(s.fade, 0.9999f);
    basis = bent_make_basis(frame, direction);
    bent_vec3 o = bent_box_point(basis, origin), d = bent_box_direction(basis, direction);
    bent_vec2 range = bent_make_vec2(0.0f, 1e30f);
    bent_vec4 bounds = bent_make_vec4(e.clip.x, e.clip.y, e.clip.z, e.clip.w); // where there is a surface
    range = bent_clip(range, o.x, d.x, bounds.x, bounds.z);
    range = bent_clip(range, o.y, d.y, bounds.y, bounds.w);
    bent_vec2 whole = range;
    if (s.fade >= 0.9999f) range.y = -1.0f; // only the base is left
    bent_vec3 from = bent_make_vec3(o.x, o.y, o.z + bent_drop(basis, o.x, o.y)); // z from the base on
    bent_course c = bent_take_off(basis, from, d, range, weight, e.alpha_cut, size, level);
    c = bent_fly(c, cap, size, level);
    s.found = c.found;
    s.t = c.t;
    bent_ivec2 fine = bent_level_size(size, level);
    s.box = bent_make_vec3(((float)(c.cell.i) + (float)(c.si) * c.cell.x + 0.5f) / (float)(fine.x),
                 ((float)(c.cell.j) + (float)(c.sj) * c.cell.y + 0.5f) / (float)(fine.y), c.z);
    if (s.fade >= 0.9999f) {
        float base = bent_base(basis, o, d);
        s.found = base >= whole.x * 0.9999f && base <= whole.y;
        s.t = fmaxf(base, whole.x);
        s.box = bent_along(o, s.t, d);
        s.box.z = basis.level;
    }
    s.uv = bent_make_vec2(s.box.x, s.box.y);
    s.gradient = gradient;
    if (s.found) {
        s.position = bent_along(origin, s.t, direction);
        bent_vec3 seen = bent_along(origin, s.t, direction);
        float w = e.clip_w.x * seen.x + e.clip_w.y * seen.y + e.clip_w.z * seen.z + e.clip_w.w;
        s.depth = (e.clip_z.x * seen.x + e.clip_z.y * seen.y + e.clip_z.z * seen.z + e.clip_z.w) / w;
        if (!(w > 0.0f)) s.depth = 0.0f;
        bent_ground_at ground = bent_look(s.box, bent_level_size(size, level), level);
        if (weight > 0.0f) {
            bent_ivec2 next = bent_level_size(size, level + 1);
            ground = bent_blend(ground, bent_look(s.box, next, level + 1), weight);
        }
        bent_vec3 normal = bent_world_normal(upright, s.box, ground.gentle);
        float stretch = bent_dot(basis.z, basis.z), x = ground.gentle.x * ground.gentle.x / bent_dot(basis.u, basis.u);
        float own = sqrtf(stretch * (x + ground.gentle.y * ground.gentle.y / bent_dot(basis.v, basis.v)));
        float steepest = sqrtf(stretch / bent_dot(basis.u, basis.u)) * (fminf(ground.steepness, 1e6f) - 1.0f / 1.0f);
        float hill = 0.3f * fmaxf(steepest - own, 0.0f);
        s.occlusion = 1.0f / (1.0f + hill * hill);
        bent_vec3 place = bent_make_vec3(s.box.x, s.box.y, fmaxf(s.box.z, ground.height + 1.0f / 1048576.0f));
        int wall = bent_wall(o, d, bounds, s.t);
        if (c.wall > 0) wall = c.wall;
        if (s.fade >= 0.9999f) wall = 0;
        if (wall > 0) { // on a side of the solid, or rather just beside it
            float before = (wall == 1 ? d.x : d.y) > 0.0f ? -1.0f : 1.0f;
            bent_vec3 across = wall == 1 ? upright.to_u : upright.to_v;
            normal = bent_normalize(bent_scaled(across, before));
            if (wall == 1) place.x += before * fmaxf(1.0f / 1048576.0f, fabsf(place.x) / 4194304.0f);
            if (wall == 2) place.y += before * fmaxf(1.0f / 1048576.0f, fabsf(place.y) / 4194304.0f);
            place.z = s.box.z;
            s.occlusion = 0.5f;
        }
        s.normal = normal;
        bent_vec4 light = bent_toward(e.light, basis, place);
        bent_vec3 ray = bent_make_vec3(light.x, light.y, light.z);
        float radius = e.light.w != 0.0f ? fminf(e.light_radius / light.w, 1.0f) : e.light_radius;
        s.shadow = bent_soft_shadow(basis, place, ray, radius, light.w, bounds, weight, e.alpha_cut, size, level);
    }
    return s;
}

