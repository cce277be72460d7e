// conemap.h: exact tracer, with effects.
// sieve_shade(effects, frame, origin, direction, t_min, t_max, size): traces a ray of the world and shades what it meets.
// t_min, t_max: the part of the ray that counts; t_min 0 or more.
// size: the map's width and height in texels.
// sieve_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


float sieve_alpha(int i, int j); // the host's

typedef struct sieve_vec2 {
    float x, y;
} sieve_vec2;

sieve_vec2 sieve_fetch(int i, int j);

typedef struct sieve_vec3 {
    float x, y, z;
} sieve_vec3;

typedef struct sieve_shading {
    bool found;
    float t;
    sieve_vec3 box;         // u, v, z
    sieve_vec3 normal;
    float shadow;    // 0 dark to 1 lit
} sieve_shading;

typedef struct sieve_vec4 {
    float x, y, z, w;
} sieve_vec4;

typedef struct sieve_effects {
    sieve_vec4 light;          // towards the light, 0; or its position, 1
    float alpha_cut;     // texels below it are holes
} sieve_effects;

typedef struct sieve_frame {
    sieve_vec3 origin;                     // where the surface has uv_offset
    sieve_vec3 tangent, bitangent, normal; // world per x, y and height
    sieve_vec2 uv_offset, uv_scale;        // map widths per unit of x, and of y
    float depth, level;              // how high z = 1 stands over z = 0; the z of the surface
} sieve_frame;

typedef struct sieve_ivec2 {
    int x, y;
} sieve_ivec2;

static sieve_vec3 sieve_make_vec3(float x, float y, float z) {
    sieve_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

typedef struct sieve_basis {
    sieve_vec3 u, v, z;          // world per u, v and z
    sieve_vec3 to_u, to_v, to_z; // and back
    sieve_vec3 origin;
    sieve_vec2 offset;
    float level;
} sieve_basis;

static sieve_vec3 sieve_scaled(sieve_vec3 a, float scale) {
    return sieve_make_vec3(a.x * scale, a.y * scale, a.z * scale);
}

static sieve_vec3 sieve_cross(sieve_vec3 a, sieve_vec3 b) {
    return sieve_make_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static float sieve_dot(sieve_vec3 a, sieve_vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static sieve_basis sieve_make_basis(sieve_frame frame) {
    sieve_basis b;
    float scale_v = frame.uv_scale.y;
    b.u = sieve_scaled(frame.tangent, 1.0f / frame.uv_scale.x);
    b.v = sieve_scaled(frame.bitangent, 1.0f / scale_v);
    b.z = sieve_scaled(frame.normal, frame.depth);
    b.to_u = sieve_cross(b.v, b.z);
    b.to_v = sieve_cross(b.z, b.u);
    b.to_z = sieve_cross(b.u, b.v);
    float volume = sieve_dot(b.u, b.to_u);
    b.to_u = sieve_scaled(b.to_u, 1.0f / volume);
    b.to_v = sieve_scaled(b.to_v, 1.0f / volume);
    b.to_z = sieve_scaled(b.to_z, 1.0f / volume);
    b.origin = frame.origin;
    b.offset = frame.uv_offset;
    b.level = frame.level;
    return b;
}

// A direction, and a point, of the world in the box.
static sieve_vec3 sieve_box_direction(sieve_basis b, sieve_vec3 d) {
    return sieve_make_vec3(sieve_dot(b.to_u, d), sieve_dot(b.to_v, d), sieve_dot(b.to_z, d));
}

// p + t d
static sieve_vec3 sieve_along(sieve_vec3 p, float t, sieve_vec3 d) {
    return sieve_make_vec3(p.x + t * d.x, p.y + t * d.y, p.z + t * d.z);
}

static sieve_vec3 sieve_box_point(sieve_basis b, sieve_vec3 p) {
    sieve_vec3 d = sieve_box_direction(b, sieve_along(p, -1.0f, b.origin));
    return sieve_make_vec3(d.x + b.offset.x, d.y + b.offset.y, d.z + b.level);
}

static sieve_vec2 sieve_make_vec2(float x, float y) {
    sieve_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static sieve_vec4 sieve_make_vec4(float x, float y, float z, float w) {
    sieve_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static sieve_vec2 sieve_clip(sieve_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return sieve_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return sieve_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

typedef struct sieve_lattice {
    int i, j;           // the texel behind; x and y, the place from there, grow along the ray
    float x, y, vx, vy;
} sieve_lattice;

typedef struct sieve_course {
    sieve_lattice cell;
    sieve_lattice leaf;   // the texels of the alpha map, as squares
    float alpha_cut;
    int wall;               // whose border was crossed last
    bool hole;
    int si, sj;
    float t, end, z, rise, speed;
    bool found;
} sieve_course;

static sieve_lattice sieve_lay(sieve_vec3 o, sieve_vec3 d, float w, float h, float shift) {
    sieve_lattice l;
    l.i = 0;
    l.j = 0;
    l.x = (d.x < 0.0f ? -1.0f : 1.0f) * (o.x * w - shift);
    l.y = (d.y < 0.0f ? -1.0f : 1.0f) * (o.y * h - shift);
    l.vx = fmaxf(fabsf(d.x) * w, 1e-20f);
    l.vy = fmaxf(fabsf(d.y) * h, 1e-20f);
    return l;
}

// Until just over the next border.
static float sieve_stay(sieve_lattice l) {
    return fminf((1.000001f - l.x) / l.vx, (1.000001f - l.y) / l.vy);
}

static sieve_lattice sieve_move(sieve_lattice l, float dt, int si, int sj) {
    l.x += l.vx * dt; l.y += l.vy * dt;
    l.i += si * (int)(floorf(l.x)); l.x -= floorf(l.x); l.j += sj * (int)(floorf(l.y)); l.y -= floorf(l.y);
    return l;
}

static sieve_course sieve_fly_on(sieve_course c, float dt) {
    if (sieve_stay(c.leaf) <= dt) c.wall = (1.0f - c.leaf.x) * c.leaf.vy <= (1.0f - c.leaf.y) * c.leaf.vx ? 1 : 2;
    c.cell = sieve_move(c.cell, dt, c.si, c.sj);
    c.leaf = sieve_move(c.leaf, dt, c.si, c.sj);
    c.t += dt;
    c.z += c.rise * dt;
    return c;
}

// The same without the bend.
static float sieve_fall(float c, float b) {
    return c <= 0.0f ? 0.0f : b < 0.0f ? c / -b : 1e30f;
}

// A flight from o, whose z counts from the base.
static sieve_course sieve_take_off(sieve_vec3 o, sieve_vec3 d, sieve_vec2 range, float alpha_cut, sieve_ivec2 size) {
    sieve_course c;
    c.cell = sieve_lay(o, d, (float)(size.x), (float)(size.y), 0.5f);
    c.leaf = sieve_lay(o, d, (float)(size.x), (float)(size.y), 0.0f);
    c.alpha_cut = alpha_cut;
    c.wall = 0;
    c.hole = true; // what is met at once is met from outside
    c.si = d.x < 0.0f ? -1 : 1;
    c.sj = d.y < 0.0f ? -1 : 1;
    c.t = 0.0f;
    c.z = o.z;
    c.speed = sqrtf(d.x * d.x + d.y * d.y);
    c.found = false;
    c.rise = d.z;
    bool over = range.x <= range.y && range.x * (c.cell.vx + c.cell.vy) < 1e9f; // as far as an int goes
    if (over) c = sieve_fly_on(c, range.x);
    c.end = over ? range.y : -1.0f;
    float up = sieve_fall(-c.z, -c.rise); // to the floor, from below
    if (up > c.end - c.t) c.end = -1.0f;
    if (c.end >= 0.0f) c = sieve_fly_on(c, up);
    c.wall = 0;
    return c;
}

// How long the course stays in its cells.
static float sieve_border(sieve_course c) {
    float leave = sieve_stay(c.cell);
    leave = fminf(leave, sieve_stay(c.leaf));
    return leave;
}

static int sieve_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static sieve_vec2 sieve_texel(int i, int j, sieve_ivec2 size) {
    return sieve_fetch(sieve_clampi(i, 0, size.x - 1), sieve_clampi(j, 0, size.y - 1));
}

static float sieve_mix(sieve_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// The tangent that a stored radius stands for, over a height.
static float sieve_tangent(float stored, float height) {
    float top = 1.0f - height;
    return stored < 1.0f * top ? stored / top : top > 0.0f ? 1.0f : 0.0f;
}

// Height, its growth and bend, and 1 / tan under a course.
static sieve_vec4 sieve_patch(sieve_lattice l, int si, int sj, sieve_ivec2 size) {
    sieve_vec2 a = sieve_texel(l.i, l.j, size), b = sieve_texel(l.i + si, l.j, size);
    sieve_vec2 c = sieve_texel(l.i, l.j + sj, size), d = sieve_texel(l.i + si, l.j + sj, size);
    float hx = b.x - a.x, hy = c.x - a.x, hxy = d.x - c.x - hx;
    float height = sieve_mix(sieve_make_vec4(a.x, b.x, c.x, d.x), l.x, l.y);
    float cone = sieve_mix(sieve_make_vec4(a.y, b.y, c.y, d.y), l.x, l.y);
    return sieve_make_vec4(height, hx * l.vx + hy * l.vy + hxy * (l.x * l.vy + l.y * l.vx), hxy * l.vx * l.vy,
                1.0f / fmaxf(sieve_tangent(cone, height), 1e-9f));
}

static sieve_vec4 sieve_ground(sieve_course c, sieve_ivec2 size) {
    return sieve_patch(c.cell, c.si, c.sj, size);
}

// First t from 0 on at which c + b t + a t t is 0 or less, or 1e30.
static float sieve_first_root(float c, float b, float a) {
    float d = b * b - 4.0f * a * c, q = -0.5f * (b + (b < 0.0f ? -1.0f : 1.0f) * sqrtf(fmaxf(d, 0.0f)));
    float first = q != 0.0f ? c / q : -1.0f, second = a != 0.0f ? q / a : -1.0f;
    if (first < 0.0f || (second >= 0.0f && second < first)) first = second;
    return c <= 0.0f ? 0.0f : d >= 0.0f && first >= 0.0f ? first : 1e30f;
}

static bool sieve_over_hole(sieve_course c, sieve_ivec2 size) {
    int i = c.si > 0 ? c.leaf.i : c.leaf.i - 1, j = c.sj > 0 ? c.leaf.j : c.leaf.j - 1;
    return sieve_alpha(sieve_clampi(i, 0, size.x - 1), sieve_clampi(j, 0, size.y - 1)) < c.alpha_cut;
}

// How far the course may go on unseen: down to the highest texel, or out of the cone.
static float sieve_free_way(sieve_course c, float gap, float steepness) {
    float room = gap - 1.0f / 1048576.0f;
    if (c.z > 1.0f) return sieve_fall(c.z - 1.0f, c.rise);
    return room > 0.0f ? sieve_fall(room, c.rise - c.speed * steepness) : 0.0f;
}

// To the first meeting.
static sieve_course sieve_fly(sieve_course c, int max_steps, sieve_ivec2 size) {
    bool done = c.t > c.end;
    for (int steps = 0; !done && steps < max_steps; ++steps) {
        float leave = sieve_border(c), left = c.end - c.t;
        sieve_vec4 ground = sieve_ground(c, size);
        float gap = c.z - ground.x, dt = sieve_first_root(gap, c.rise - ground.y, -ground.z);
        bool hole = sieve_over_hole(c, size), inside = gap <= 0.0f && c.hole;
        if (hole) dt = sieve_fall(c.z, c.rise); // the floor ends it
        bool met = dt <= fminf(leave, left);
        c.found = met && !hole;
        if (!met) dt = fmaxf(leave, sieve_free_way(c, gap, ground.w));
        c.hole = hole && dt <= leave; // a jump ends over the surface
        done = met || dt >= left;
        if (c.found || !done) c = sieve_fly_on(c, dt);
        if (c.found && !inside) c.wall = 0;
    }
    return c;
}

typedef struct sieve_ground_at {
    float height;
    sieve_vec2 slope;      // of the cell
} sieve_ground_at;

static sieve_ground_at sieve_look(sieve_vec3 box, sieve_ivec2 size) {
    sieve_ground_at g;
    float x = box.x * (float)(size.x) - 0.5f, y = box.y * (float)(size.y) - 0.5f;
    int i = (int)(floorf(x)), j = (int)(floorf(y));
    x -= (float)(i);
    y -= (float)(j);
    sieve_vec2 a = sieve_texel(i, j, size), b = sieve_texel(i + 1, j, size);
    sieve_vec2 c = sieve_texel(i, j + 1, size), d = sieve_texel(i + 1, j + 1, size);
    sieve_vec4 heights = sieve_make_vec4(a.x, b.x, c.x, d.x);
    float hx = heights.y - heights.x, hy = heights.z - heights.x, hxy = heights.w - heights.z - hx;
    float height = sieve_mix(heights, x, y);
    g.height = height;
    g.slope = sieve_make_vec2((hx + hxy * y) * (float)(size.x), (hy + hxy * x) * (float)(size.y));
    return g;
}

static sieve_vec3 sieve_normalize(sieve_vec3 a) {
    return sieve_scaled(a, 1.0f / sqrtf(sieve_dot(a, a)));
}

// Of a surface with these slopes: rows of the way back are the gradients of u, v and z.
static sieve_vec3 sieve_world_normal(sieve_basis b, sieve_vec2 slope) {
    sieve_vec3 n = sieve_along(sieve_along(b.to_z, -slope.x, b.to_u), -slope.y, b.to_v);
    return sieve_normalize(n);
}

// The side of the rectangle through which a ray came in just where it hit: 1 for u, 2 for v, 0 for none.
static int sieve_wall(sieve_vec3 o, sieve_vec3 d, sieve_vec4 bounds, float t) {
    float in_u = sieve_clip(sieve_make_vec2(0.0f, 1e30f), o.x, d.x, bounds.x, bounds.z).x;
    float in_v = sieve_clip(sieve_make_vec2(0.0f, 1e30f), o.y, d.y, bounds.y, bounds.w).x;
    float enter = fmaxf(in_u, in_v);
    return enter <= 0.0f || t > enter * 1.00001f ? 0 : in_v > in_u ? 2 : 1;
}

static sieve_vec3 sieve_world_point(sieve_basis b, sieve_vec3 box) {
    sieve_vec3 p = sieve_along(b.origin, box.x - b.offset.x, b.u);
    p = sieve_along(p, box.y - b.offset.y, b.v);
    return sieve_along(p, box.z - b.level, b.z);
}

// The direction to the light, and how far it is.
static sieve_vec4 sieve_toward(sieve_vec4 light, sieve_basis b, sieve_vec3 place) {
    sieve_vec3 d = sieve_make_vec3(light.x, light.y, light.z);
    if (light.w != 0.0f) d = sieve_along(d, -1.0f, sieve_world_point(b, place));
    float length = sqrtf(sieve_dot(d, d));
    return sieve_make_vec4(d.x / length, d.y / length, d.z / length, light.w != 0.0f ? length : 1e30f);
}

// A course towards a direction of the world.
static sieve_course sieve_look_along(sieve_basis b, sieve_vec3 place, sieve_vec3 direction, float t_max,
                                     sieve_vec4 bounds, float alpha_cut, sieve_ivec2 size) {
    sieve_vec3 d = sieve_box_direction(b, direction);
    sieve_vec2 range = sieve_clip(sieve_make_vec2(0.0f, t_max), place.x, d.x, bounds.x, bounds.z);
    range = sieve_clip(range, place.y, d.y, bounds.y, bounds.w);
    return sieve_take_off(place, d, range, alpha_cut, size);
}

// Traces a ray of the world through the relief that the frame puts on a surface, and shades the hit.
static sieve_shading sieve_shade(sieve_effects e, sieve_frame frame, sieve_vec3 origin, sieve_vec3 direction, float t_min, float t_max, sieve_ivec2 size) {
    sieve_shading s;
    s.normal = sieve_make_vec3(0.0f, 0.0f, 0.0f);
    s.shadow = 1.0f;
    sieve_basis basis = sieve_make_basis(frame);
    sieve_vec3 o = sieve_box_point(basis, origin), d = sieve_box_direction(basis, direction);
    sieve_vec2 range = sieve_make_vec2(t_min, t_max);
    sieve_vec4 bounds = sieve_make_vec4(0.0f, 0.0f, 1.0f, 1.0f); // where there is a surface
    range = sieve_clip(range, o.x, d.x, bounds.x, bounds.z);
    range = sieve_clip(range, o.y, d.y, bounds.y, bounds.w);
    sieve_course c = sieve_take_off(o, d, range, e.alpha_cut, size);
    c = sieve_fly(c, 8 * (size.x + size.y), size);
    s.found = c.found;
    s.t = c.t;
    s.box = sieve_make_vec3(((float)(c.cell.i) + (float)(c.si) * c.cell.x + 0.5f) / (float)(size.x),
                 ((float)(c.cell.j) + (float)(c.sj) * c.cell.y + 0.5f) / (float)(size.y), c.z);
    if (s.found) {
        sieve_ground_at ground = sieve_look(s.box, size);
        sieve_vec3 normal = sieve_world_normal(basis, ground.slope);
        sieve_vec3 place = sieve_make_vec3(s.box.x, s.box.y, fmaxf(s.box.z, ground.height + 1.0f / 1048576.0f));
        int wall = sieve_wall(o, d, bounds, s.t);
        if (c.wall > 0) wall = c.wall;
        if (wall > 0) { // on a side of the solid, or rather just beside it
            float before = (wall == 1 ? d.x : d.y) > 0.0f ? -1.0f : 1.0f;
            sieve_vec3 across = wall == 1 ? basis.to_u : basis.to_v;
            normal = sieve_normalize(sieve_scaled(across, before));
            if (wall == 1) place.x += before * fmaxf(1.0f / 1048576.0f, fabsf(place.x) / 4194304.0f);
            if (wall == 2) place.y += before * fmaxf(1.0f / 1048576.0f, fabsf(place.y) / 4194304.0f);
            place.z = s.box.z;
        }
        s.normal = normal;
        sieve_vec4 light = sieve_toward(e.light, basis, place);
        sieve_vec3 ray = sieve_make_vec3(light.x, light.y, light.z);
        c = sieve_look_along(basis, place, ray, light.w, bounds, e.alpha_cut, size);
        c = sieve_fly(c, 8 * (size.x + size.y), size);
        s.shadow = c.found ? 0.0f : 1.0f;
    }
    return s;
}

