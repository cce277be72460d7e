// conemap.h: exact tracer, with effects.
// mip_shade(effects, frame, origin, direction, gradient, size): traces a ray of the world and shades what it meets.
// gradient: dFdx and dFdy of the surface's own uv.
// size: the map's width and height in texels.
// mip_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct mip_vec2 {
    float x, y;
} mip_vec2;

mip_vec2 mip_fetch(int i, int j, int level);

typedef struct mip_vec3 {
    float x, y, z;
} mip_vec3;

typedef struct mip_shading {
    bool found;
    float t;
    mip_vec3 box;         // u, v, z
    mip_vec3 normal;
    float shadow;    // 0 dark to 1 lit
    float level;
} mip_shading;

typedef struct mip_vec4 {
    float x, y, z, w;
} mip_vec4;

typedef struct mip_effects {
    mip_vec4 light;          // towards the light, 0; or its position, 1
    float lod_bias;       // added to the level
    int lod_steps;         // the step cap at level 0; 0: none
    int level_count;
} mip_effects;

typedef struct mip_frame {
    mip_vec3 origin;                     // where the surface has uv_offset
    mip_vec3 tangent, bitangent, normal; // world per x, y and height
    mip_vec2 uv_offset, uv_scale;        // map widths per unit of x, and of y
    float depth, level;              // how high z = 1 stands over z = 0; the z of the surface
} mip_frame;

typedef struct mip_ivec2 {
    int x, y;
} mip_ivec2;

static mip_vec3 mip_make_vec3(float x, float y, float z) {
    mip_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

typedef struct mip_basis {
    mip_vec3 u, v, z;          // world per u, v and z
    mip_vec3 to_u, to_v, to_z; // and back
    mip_vec3 origin;
    mip_vec2 offset;
    float level;
} mip_basis;

static mip_vec3 mip_scaled(mip_vec3 a, float scale) {
    return mip_make_vec3(a.x * scale, a.y * scale, a.z * scale);
}

static mip_vec3 mip_cross(mip_vec3 a, mip_vec3 b) {
    return mip_make_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static float mip_dot(mip_vec3 a, mip_vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static mip_basis mip_make_basis(mip_frame frame) {
    mip_basis b;
    float scale_v = frame.uv_scale.y;
    b.u = mip_scaled(frame.tangent, 1.0f / frame.uv_scale.x);
    b.v = mip_scaled(frame.bitangent, 1.0f / scale_v);
    b.z = mip_scaled(frame.normal, frame.depth);
    b.to_u = mip_cross(b.v, b.z);
    b.to_v = mip_cross(b.z, b.u);
    b.to_z = mip_cross(b.u, b.v);
    float volume = mip_dot(b.u, b.to_u);
    b.to_u = mip_scaled(b.to_u, 1.0f / volume);
    b.to_v = mip_scaled(b.to_v, 1.0f / volume);
    b.to_z = mip_scaled(b.to_z, 1.0f / volume);
    b.origin = frame.origin;
    b.offset = frame.uv_offset;
    b.level = frame.level;
    return b;
}

// log2 of the texels under a pixel.
static float mip_level_of(mip_vec4 gradient, float w, float h) {
    float x = gradient.x * gradient.x * w * w + gradient.y * gradient.y * h * h;
    float y = gradient.z * gradient.z * w * w + gradient.w * gradient.w * h * h;
    return 0.5f * log2f(fmaxf(fmaxf(x, y), 1e-30f));
}

// A direction, and a point, of the world in the box.
static mip_vec3 mip_box_direction(mip_basis b, mip_vec3 d) {
    return mip_make_vec3(mip_dot(b.to_u, d), mip_dot(b.to_v, d), mip_dot(b.to_z, d));
}

// p + t d
static mip_vec3 mip_along(mip_vec3 p, float t, mip_vec3 d) {
    return mip_make_vec3(p.x + t * d.x, p.y + t * d.y, p.z + t * d.z);
}

static mip_vec3 mip_box_point(mip_basis b, mip_vec3 p) {
    mip_vec3 d = mip_box_direction(b, mip_along(p, -1.0f, b.origin));
    return mip_make_vec3(d.x + b.offset.x, d.y + b.offset.y, d.z + b.level);
}

static mip_vec2 mip_make_vec2(float x, float y) {
    mip_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static mip_ivec2 mip_make_ivec2(int x, int y) {
    mip_ivec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static mip_ivec2 mip_level_size(mip_ivec2 size, int level) {
    return mip_make_ivec2((size.x >> level) > 1 ? size.x >> level : 1, (size.y >> level) > 1 ? size.y >> level : 1);
}

static mip_vec4 mip_make_vec4(float x, float y, float z, float w) {
    mip_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static mip_vec2 mip_clip(mip_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return mip_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return mip_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

typedef struct mip_lattice {
    int i, j;           // the texel behind; x and y, the place from there, grow along the ray
    float x, y, vx, vy;
} mip_lattice;

typedef struct mip_course {
    mip_lattice cell;
    mip_lattice coarse; // of the next level
    float weight;           // and its share
    int si, sj;
    float t, end, z, rise, speed;
    bool found;
} mip_course;

static mip_lattice mip_lay(mip_vec3 o, mip_vec3 d, float w, float h, float shift) {
    mip_lattice l;
    l.i = 0;
    l.j = 0;
    l.x = (d.x < 0.0f ? -1.0f : 1.0f) * (o.x * w - shift);
    l.y = (d.y < 0.0f ? -1.0f : 1.0f) * (o.y * h - shift);
    l.vx = fmaxf(fabsf(d.x) * w, 1e-20f);
    l.vy = fmaxf(fabsf(d.y) * h, 1e-20f);
    return l;
}

static mip_lattice mip_move(mip_lattice l, float dt, int si, int sj) {
    l.x += l.vx * dt; l.y += l.vy * dt;
    l.i += si * (int)(floorf(l.x)); l.x -= floorf(l.x); l.j += sj * (int)(floorf(l.y)); l.y -= floorf(l.y);
    return l;
}

static mip_course mip_fly_on(mip_course c, float dt) {
    c.cell = mip_move(c.cell, dt, c.si, c.sj);
    c.coarse = mip_move(c.coarse, dt, c.si, c.sj);
    c.t += dt;
    c.z += c.rise * dt;
    return c;
}

// The same without the bend.
static float mip_fall(float c, float b) {
    return c <= 0.0f ? 0.0f : b < 0.0f ? c / -b : 1e30f;
}

// A flight from o, whose z counts from the base.
static mip_course mip_take_off(mip_vec3 o, mip_vec3 d, mip_vec2 range, float weight, mip_ivec2 size, int level) {
    mip_course c;
    mip_ivec2 fine = mip_level_size(size, level), next = mip_level_size(size, level + 1);
    c.cell = mip_lay(o, d, (float)(fine.x), (float)(fine.y), 0.5f);
    c.coarse = mip_lay(o, d, (float)(next.x), (float)(next.y), 0.5f);
    c.weight = weight;
    c.si = d.x < 0.0f ? -1 : 1;
    c.sj = d.y < 0.0f ? -1 : 1;
    c.t = 0.0f;
    c.z = o.z;
    c.speed = sqrtf(d.x * d.x + d.y * d.y);
    c.found = false;
    c.rise = d.z;
    bool over = range.x <= range.y && range.x * (c.cell.vx + c.cell.vy) < 1e9f; // as far as an int goes
    if (over) c = mip_fly_on(c, range.x);
    c.end = over ? range.y : -1.0f;
    float up = mip_fall(-c.z, -c.rise); // to the floor, from below
    if (up > c.end - c.t) c.end = -1.0f;
    if (c.end >= 0.0f) c = mip_fly_on(c, up);
    return c;
}

// Until just over the next border.
static float mip_stay(mip_lattice l) {
    return fminf((1.000001f - l.x) / l.vx, (1.000001f - l.y) / l.vy);
}

// How long the course stays in its cells.
static float mip_border(mip_course c) {
    float leave = mip_stay(c.cell);
    if (c.weight > 0.0f) leave = fminf(leave, mip_stay(c.coarse));
    return leave;
}

static int mip_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static mip_vec2 mip_texel(int i, int j, mip_ivec2 size, int level) {
    return mip_fetch(mip_clampi(i, 0, size.x - 1), mip_clampi(j, 0, size.y - 1), level);
}

static float mip_mix(mip_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height, its growth and bend, and 1 / tan under a course.
static mip_vec4 mip_patch(mip_lattice l, int si, int sj, mip_ivec2 size, int level) {
    mip_vec2 a = mip_texel(l.i, l.j, size, level), b = mip_texel(l.i + si, l.j, size, level);
    mip_vec2 c = mip_texel(l.i, l.j + sj, size, level), d = mip_texel(l.i + si, l.j + sj, size, level);
    float hx = b.x - a.x, hy = c.x - a.x, hxy = d.x - c.x - hx;
    float height = mip_mix(mip_make_vec4(a.x, b.x, c.x, d.x), l.x, l.y);
    float cone = mip_mix(mip_make_vec4(a.y, b.y, c.y, d.y), l.x, l.y);
    return mip_make_vec4(height, hx * l.vx + hy * l.vy + hxy * (l.x * l.vy + l.y * l.vx), hxy * l.vx * l.vy,
                1.0f / fmaxf(cone, 1e-9f));
}

static mip_vec4 mip_ground(mip_course c, mip_ivec2 size, int level) {
    mip_vec4 a = mip_patch(c.cell, c.si, c.sj, mip_level_size(size, level), level);
    if (c.weight == 0.0f) return a;
    mip_vec4 b = mip_patch(c.coarse, c.si, c.sj, mip_level_size(size, level + 1), level + 1);
    return mip_make_vec4(a.x + (b.x - a.x) * c.weight, a.y + (b.y - a.y) * c.weight, a.z + (b.z - a.z) * c.weight,
                a.w + (b.w - a.w) * c.weight); // of slopes: the blend of tangents would be too wide
}

// First t from 0 on at which c + b t + a t t is 0 or less, or 1e30.
static float mip_first_root(float c, float b, float a) {
    float d = b * b - 4.0f * a * c, q = -0.5f * (b + (b < 0.0f ? -1.0f : 1.0f) * sqrtf(fmaxf(d, 0.0f)));
    float first = q != 0.0f ? c / q : -1.0f, second = a != 0.0f ? q / a : -1.0f;
    if (first < 0.0f || (second >= 0.0f && second < first)) first = second;
    return c <= 0.0f ? 0.0f : d >= 0.0f && first >= 0.0f ? first : 1e30f;
}

// How far the course may go on unseen: down to the highest texel, or out of the cone.
static float mip_free_way(mip_course c, float gap, float steepness) {
    float room = gap - 1.0f / 1048576.0f;
    if (c.z > 1.0f) return mip_fall(c.z - 1.0f, c.rise);
    return room > 0.0f ? mip_fall(room, c.rise - c.speed * steepness) : 0.0f;
}

// To the first meeting.
static mip_course mip_fly(mip_course c, int max_steps, mip_ivec2 size, int level) {
    bool done = c.t > c.end;
    for (int steps = 0; !done && steps < max_steps; ++steps) {
        float leave = mip_border(c), left = c.end - c.t;
        mip_vec4 ground = mip_ground(c, size, level);
        float gap = c.z - ground.x, dt = mip_first_root(gap, c.rise - ground.y, -ground.z);
        bool met = dt <= fminf(leave, left);
        c.found = met;
        if (!met) dt = fmaxf(leave, mip_free_way(c, gap, ground.w));
        done = met || dt >= left;
        if (c.found || !done) c = mip_fly_on(c, dt);
    }
    if (!done) c.found = true; // out of steps: shaded where it is
    return c;
}

typedef struct mip_ground_at {
    float height;
    mip_vec2 slope;      // of the cell
    mip_vec2 gentle;     // of the texels' derivatives, interpolated
} mip_ground_at;

// dh/du and dh/dv at a texel, per texel.
static mip_vec2 mip_difference(int i, int j, mip_ivec2 size, int level) {
    i = mip_clampi(i, 0, size.x - 1);
    j = mip_clampi(j, 0, size.y - 1);
    float x = mip_texel(i + 1, j, size, level).x - mip_texel(i - 1, j, size, level).x;
    float y = mip_texel(i, j + 1, size, level).x - mip_texel(i, j - 1, size, level).x;
    if (i > 0 && i + 1 < size.x) x *= 0.5f; // at the border it spans one texel
    if (j > 0 && j + 1 < size.y) y *= 0.5f;
    return mip_make_vec2(x, y);
}

static mip_ground_at mip_look(mip_vec3 box, mip_ivec2 size, int level) {
    mip_ground_at g;
    float x = box.x * (float)(size.x) - 0.5f, y = box.y * (float)(size.y) - 0.5f;
    int i = (int)(floorf(x)), j = (int)(floorf(y));
    j = mip_clampi(j, 0, size.y - 2);
    x -= (float)(i);
    y -= (float)(j);
    mip_vec2 a = mip_texel(i, j, size, level), b = mip_texel(i + 1, j, size, level);
    mip_vec2 c = mip_texel(i, j + 1, size, level), d = mip_texel(i + 1, j + 1, size, level);
    mip_vec4 heights = mip_make_vec4(a.x, b.x, c.x, d.x);
    float hx = heights.y - heights.x, hy = heights.z - heights.x, hxy = heights.w - heights.z - hx;
    float height = mip_mix(heights, x, y);
    g.height = height;
    g.slope = mip_make_vec2((hx + hxy * y) * (float)(size.x), (hy + hxy * x) * (float)(size.y));
    mip_vec2 p = mip_difference(i, j, size, level), q = mip_difference(i + 1, j, size, level);
    mip_vec2 r = mip_difference(i, j + 1, size, level), s = mip_difference(i + 1, j + 1, size, level);
    g.gentle = mip_make_vec2(mip_mix(mip_make_vec4(p.x, q.x, r.x, s.x), x, y) * (float)(size.x),
                    mip_mix(mip_make_vec4(p.y, q.y, r.y, s.y), x, y) * (float)(size.y));
    return g;
}

static mip_ground_at mip_blend(mip_ground_at a, mip_ground_at b, float weight) {
    a.height += (b.height - a.height) * weight;
    a.slope = mip_make_vec2(a.slope.x + (b.slope.x - a.slope.x) * weight, a.slope.y + (b.slope.y - a.slope.y) * weight);
    a.gentle = mip_make_vec2(a.gentle.x + (b.gentle.x - a.gentle.x) * weight,
                    a.gentle.y + (b.gentle.y - a.gentle.y) * weight);
    return a;
}

static mip_vec3 mip_normalize(mip_vec3 a) {
    return mip_scaled(a, 1.0f / sqrtf(mip_dot(a, a)));
}

// Of a surface with these slopes: rows of the way back are the gradients of u, v and z.
static mip_vec3 mip_world_normal(mip_basis b, mip_vec2 slope) {
    mip_vec3 n = mip_along(mip_along(b.to_z, -slope.x, b.to_u), -slope.y, b.to_v);
    return mip_normalize(n);
}

// The side of the rectangle through which a ray came in just where it hit: 1 for u, 2 for v, 0 for none.
static int mip_wall(mip_vec3 o, mip_vec3 d, mip_vec4 bounds, float t) {
    float in_u = mip_clip(mip_make_vec2(0.0f, 1e30f), o.x, d.x, bounds.x, bounds.z).x;
    float in_v = mip_clip(mip_make_vec2(0.0f, 1e30f), o.y, d.y, bounds.y, bounds.w).x;
    float enter = fmaxf(in_u, in_v);
    return enter <= 0.0f || t > enter * 1.00001f ? 0 : in_v > in_u ? 2 : 1;
}

static mip_vec3 mip_world_point(mip_basis b, mip_vec3 box) {
    mip_vec3 p = mip_along(b.origin, box.x - b.offset.x, b.u);
    p = mip_along(p, box.y - b.offset.y, b.v);
    return mip_along(p, box.z - b.level, b.z);
}

// The direction to the light, and how far it is.
static mip_vec4 mip_toward(mip_vec4 light, mip_basis b, mip_vec3 place) {
    mip_vec3 d = mip_make_vec3(light.x, light.y, light.z);
    if (light.w != 0.0f) d = mip_along(d, -1.0f, mip_world_point(b, place));
    float length = sqrtf(mip_dot(d, d));
    return mip_make_vec4(d.x / length, d.y / length, d.z / length, light.w != 0.0f ? length : 1e30f);
}

// A course towards a direction of the world.
static mip_course mip_look_along(mip_basis b, mip_vec3 place, mip_vec3 direction, float t_max,
                                     mip_vec4 bounds, float weight, mip_ivec2 size, int level) {
    mip_vec3 d = mip_box_direction(b, direction);
    mip_vec2 range = mip_clip(mip_make_vec2(0.0f, t_max), place.x, d.x, bounds.x, bounds.z);
    range = mip_clip(range, place.y, d.y, bounds.y, bounds.w);
    return mip_take_off(place, d, range, weight, size, level);
}

// Traces a ray of the world through the relief that the frame puts on a surface, and shades the hit.
static mip_shading mip_shade(mip_effects e, mip_frame frame, mip_vec3 origin, mip_vec3 direction, mip_vec4 gradient, mip_ivec2 size) {
    mip_shading s;
    s.normal = mip_make_vec3(0.0f, 0.0f, 0.0f);
    s.shadow = 1.0f;
    mip_basis basis = mip_make_basis(frame);
    s.level = fminf(fmaxf(mip_level_of(gradient, (float)(size.x), (float)(size.y)) + e.lod_bias, 0.0f), (float)(e.level_count - 1));
    int level = (int)(s.level), cap = (int)(fmaxf(8.0f, ceilf((float)(e.lod_steps) * exp2f(-s.level))));
    if (e.lod_steps == 0 || cap > 8 * (size.x + size.y)) cap = 8 * (size.x + size.y);
    float weight = s.level - (float)(level);
    mip_vec3 o = mip_box_point(basis, origin), d = mip_box_direction(basis, direction);
    mip_vec2 range = mip_make_vec2(0.0f, 1e30f);
    mip_ivec2 coarsest = mip_level_size(size, weight > 0.0f ? level + 1 : level);
    mip_vec2 rim = mip_make_vec2(coarsest.x > 1 ? 0.5f / (float)(coarsest.x) : 0.0f,
                    coarsest.y > 1 ? 0.5f / (float)(coarsest.y) : 0.0f);
    mip_vec4 bounds = mip_make_vec4(0.0f, rim.y, 1.0f, 1.0f - rim.y); // where there is a surface
    range = mip_clip(range, o.x, d.x, bounds.x, bounds.z);
    range = mip_clip(range, o.y, d.y, bounds.y, bounds.w);
    mip_course c = mip_take_off(o, d, range, weight, size, level);
    c = mip_fly(c, cap, size, level);
    s.found = c.found;
    s.t = c.t;
    mip_ivec2 fine = mip_level_size(size, level);
    s.box = mip_make_vec3(((float)(c.cell.i) + (float)(c.si) * c.cell.x + 0.5f) / (float)(fine.x),
                 ((float)(c.cell.j) + (float)(c.sj) * c.cell.y + 0.5f) / (float)(fine.y), c.z);
    if (s.found) {
        mip_ground_at ground = mip_look(s.box, mip_level_size(size, level), level);
        if (weight > 0.0f) {
            mip_ivec2 next = mip_level_size(size, level + 1);
            ground = mip_blend(ground, mip_look(s.box, next, level + 1), weight);
        }
        mip_vec3 normal = mip_world_normal(basis, ground.gentle);
        mip_vec3 place = mip_make_vec3(s.box.x, s.box.y, fmaxf(s.box.z, ground.height + 1.0f / 1048576.0f));
        int wall = mip_wall(o, d, bounds, s.t);
        if (wall > 0) { // on a side of the solid, or rather just beside it
            float before = (wall == 1 ? d.x : d.y) > 0.0f ? -1.0f : 1.0f;
            mip_vec3 across = wall == 1 ? basis.to_u : basis.to_v;
            normal = mip_normalize(mip_scaled(across, before));
            if (wall == 1) place.x += before * fmaxf(1.0f / 1048576.0f, fabsf(place.x) / 4194304.0f);
            if (wall == 2) place.y += before * fmaxf(1.0f / 1048576.0f, fabsf(place.y) / 4194304.0f);
            place.z = s.box.z;
        }
        s.normal = normal;
        mip_vec4 light = mip_toward(e.light, basis, place);
        mip_vec3 ray = mip_make_vec3(light.x, light.y, light.z);
        c = mip_look_along(basis, place, ray, light.w, bounds, weight, size, level);
        c = mip_fly(c, 8 * (size.x + size.y), size, level);
        s.shadow = c.found ? 0.0f : 1.0f;
    }
    return s;
}

