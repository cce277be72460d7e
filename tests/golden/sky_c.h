// conemap.h: exact tracer, with effects.
// sky_shade(effects, frame, origin, direction, size): traces a ray of the world and shades what it meets.
// size: the map's width and height in texels.
// sky_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct sky_vec2 {
    float x, y;
} sky_vec2;

sky_vec2 sky_fetch(int i, int j);

typedef struct sky_vec3 {
    float x, y, z;
} sky_vec3;

typedef struct sky_shading {
    bool found;
    float t;
    sky_vec3 box;         // u, v, z
    sky_vec3 normal;
    float shadow;    // 0 dark to 1 lit
    float occlusion; // 0 closed to 1 open
} sky_shading;

typedef struct sky_vec4 {
    float x, y, z, w;
} sky_vec4;

typedef struct sky_effects {
    sky_vec4 light;          // towards the light, 0; or its position, 1
    float sky_reach;      // what is farther away hides nothing
    int sky_directions;
} sky_effects;

typedef struct sky_frame {
    sky_vec3 origin;                     // where the surface has uv_offset
    sky_vec3 tangent, bitangent, normal; // world per x, y and height
    sky_vec2 uv_offset, uv_scale;        // map widths per unit of x, and of y
    float depth, level;              // how high z = 1 stands over z = 0; the z of the surface
    sky_vec3 curvature;                  // xx, xy, yy
} sky_frame;

typedef struct sky_ivec2 {
    int x, y;
} sky_ivec2;

static sky_vec3 sky_make_vec3(float x, float y, float z) {
    sky_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

typedef struct sky_basis {
    sky_vec3 u, v, z;          // world per u, v and z
    sky_vec3 to_u, to_v, to_z; // and back
    sky_vec3 origin;
    sky_vec2 offset;
    float level;
    sky_vec3 bend;             // the base falls by (x u u + 2 y u v + z v v) / 2
} sky_basis;

static sky_vec3 sky_scaled(sky_vec3 a, float scale) {
    return sky_make_vec3(a.x * scale, a.y * scale, a.z * scale);
}

static sky_vec3 sky_cross(sky_vec3 a, sky_vec3 b) {
    return sky_make_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static float sky_dot(sky_vec3 a, sky_vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static sky_basis sky_make_basis(sky_frame frame) {
    sky_basis b;
    float scale_v = frame.uv_scale.y / 5.0e-1f;
    b.u = sky_scaled(frame.tangent, 1.0f / frame.uv_scale.x);
    b.v = sky_scaled(frame.bitangent, 1.0f / scale_v);
    b.z = sky_scaled(frame.normal, frame.depth);
    b.to_u = sky_cross(b.v, b.z);
    b.to_v = sky_cross(b.z, b.u);
    b.to_z = sky_cross(b.u, b.v);
    float volume = sky_dot(b.u, b.to_u);
    b.to_u = sky_scaled(b.to_u, 1.0f / volume);
    b.to_v = sky_scaled(b.to_v, 1.0f / volume);
    b.to_z = sky_scaled(b.to_z, 1.0f / volume);
    b.origin = frame.origin;
    b.offset = frame.uv_offset;
    b.level = frame.level;
    float x = 1.0f / frame.uv_scale.x, y = 1.0f / scale_v;
    b.bend = sky_make_vec3(frame.curvature.x * x * x / frame.depth, frame.curvature.y * x * y / frame.depth,
                  frame.curvature.z * y * y / frame.depth);
    return b;
}

// A direction, and a point, of the world in the box.
static sky_vec3 sky_box_direction(sky_basis b, sky_vec3 d) {
    return sky_make_vec3(sky_dot(b.to_u, d), sky_dot(b.to_v, d), sky_dot(b.to_z, d));
}

// p + t d
static sky_vec3 sky_along(sky_vec3 p, float t, sky_vec3 d) {
    return sky_make_vec3(p.x + t * d.x, p.y + t * d.y, p.z + t * d.z);
}

static sky_vec3 sky_box_point(sky_basis b, sky_vec3 p) {
    sky_vec3 d = sky_box_direction(b, sky_along(p, -1.0f, b.origin));
    return sky_make_vec3(d.x + b.offset.x, d.y + b.offset.y, d.z + b.level);
}

static sky_vec2 sky_make_vec2(float x, float y) {
    sky_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static sky_vec4 sky_make_vec4(float x, float y, float z, float w) {
    sky_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static sky_vec2 sky_clip(sky_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return sky_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return sky_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

// How far the base lies below its tangent plane, in z.
static float sky_drop(sky_basis b, float u, float v) {
    float x = u - b.offset.x, y = v - b.offset.y;
    return 0.5f * (b.bend.x * x * x + 2.0f * b.bend.y * x * y + b.bend.z * y * y);
}

typedef struct sky_lattice {
    int i, j;           // the texel behind; x and y, the place from there, grow along the ray
    float x, y, vx, vy;
} sky_lattice;

typedef struct sky_course {
    sky_lattice cell;
    int si, sj;
    float t, end, z, rise, speed;
    float bend;             // its height is z + rise t + bend t t
    bool found;
} sky_course;

static sky_lattice sky_lay(sky_vec3 o, sky_vec3 d, float w, float h, float shift) {
    sky_lattice l;
    l.i = 0;
    l.j = 0;
    l.x = (d.x < 0.0f ? -1.0f : 1.0f) * (o.x * w - shift);
    l.y = (d.y < 0.0f ? -1.0f : 1.0f) * (o.y * h - shift);
    l.vx = fmaxf(fabsf(d.x) * w, 1e-20f);
    l.vy = fmaxf(fabsf(d.y) * h, 1e-20f);
    return l;
}

// How that grows along (du, dv), and half of how its growth grows.
static float sky_drop_along(sky_basis b, float u, float v, float du, float dv) {
    float x = u - b.offset.x, y = v - b.offset.y;
    return (b.bend.x * x + b.bend.y * y) * du + (b.bend.y * x + b.bend.z * y) * dv;
}

static float sky_bend_along(sky_basis b, float du, float dv) {
    return 0.5f * (b.bend.x * du * du + 2.0f * b.bend.y * du * dv + b.bend.z * dv * dv);
}

static sky_lattice sky_move(sky_lattice l, float dt, int si, int sj) {
    l.x += l.vx * dt; l.y += l.vy * dt;
    l.i += si * (int)(floorf(l.x)); l.x -= floorf(l.x); l.j += sj * (int)(floorf(l.y)); l.y -= floorf(l.y);
    return l;
}

static sky_course sky_fly_on(sky_course c, float dt) {
    c.cell = sky_move(c.cell, dt, c.si, c.sj);
    c.t += dt;
    c.z += (c.rise + c.bend * dt) * dt;
    c.rise += 2.0f * c.bend * dt;
    return c;
}

// First t from 0 on at which c + b t + a t t is 0 or less, or 1e30.
static float sky_first_root(float c, float b, float a) {
    float d = b * b - 4.0f * a * c, q = -0.5f * (b + (b < 0.0f ? -1.0f : 1.0f) * sqrtf(fmaxf(d, 0.0f)));
    float first = q != 0.0f ? c / q : -1.0f, second = a != 0.0f ? q / a : -1.0f;
    if (first < 0.0f || (second >= 0.0f && second < first)) first = second;
    return c <= 0.0f ? 0.0f : d >= 0.0f && first >= 0.0f ? first : 1e30f;
}

// A flight from o, whose z counts from the base.
static sky_course sky_take_off(sky_basis b, sky_vec3 o, sky_vec3 d, sky_vec2 range, sky_ivec2 size) {
    sky_course c;
    c.cell = sky_lay(o, d, (float)(size.x), (float)(size.y), 0.5f);
    c.si = d.x < 0.0f ? -1 : 1;
    c.sj = d.y < 0.0f ? -1 : 1;
    c.t = 0.0f;
    c.z = o.z;
    c.speed = sqrtf(d.x * d.x + 2.5e-1f * d.y * d.y);
    c.found = false;
    c.rise = d.z + sky_drop_along(b, o.x, o.y, d.x, d.y);
    c.bend = sky_bend_along(b, d.x, d.y);
    bool over = range.x <= range.y && range.x * (c.cell.vx + c.cell.vy) < 1e9f; // as far as an int goes
    if (over) c = sky_fly_on(c, range.x);
    c.end = over ? range.y : -1.0f;
    c.end = fminf(c.end, c.t + 1048576.0f / (c.cell.vx + c.cell.vy)); // a float knows no cells beyond
    float up = sky_first_root(-c.z, -c.rise, -c.bend); // to the floor, from below
    if (up > c.end - c.t) c.end = -1.0f;
    if (c.end >= 0.0f) c = sky_fly_on(c, up);
    return c;
}

// Until just over the next border.
static float sky_stay(sky_lattice l) {
    return fminf((1.000001f - l.x) / l.vx, (1.000001f - l.y) / l.vy);
}

// How long the course stays in its cells.
static float sky_border(sky_course c) {
    float leave = sky_stay(c.cell);
    return leave;
}

static int sky_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int sky_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static sky_vec2 sky_texel(int i, int j, sky_ivec2 size) {
    return sky_fetch(sky_clampi(i, 0, size.x - 1), sky_repeat(j, size.y));
}

static float sky_mix(sky_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height, its growth and bend, and 1 / tan under a course.
static sky_vec4 sky_patch(sky_lattice l, int si, int sj, sky_ivec2 size) {
    sky_vec2 a = sky_texel(l.i, l.j, size), b = sky_texel(l.i + si, l.j, size);
    sky_vec2 c = sky_texel(l.i, l.j + sj, size), d = sky_texel(l.i + si, l.j + sj, size);
    float hx = b.x - a.x, hy = c.x - a.x, hxy = d.x - c.x - hx;
    float height = sky_mix(sky_make_vec4(a.x, b.x, c.x, d.x), l.x, l.y);
    float cone = sky_mix(sky_make_vec4(a.y, b.y, c.y, d.y), l.x, l.y);
    return sky_make_vec4(height, hx * l.vx + hy * l.vy + hxy * (l.x * l.vy + l.y * l.vx), hxy * l.vx * l.vy,
                1.0f / fmaxf(cone, 1e-9f));
}

static sky_vec4 sky_ground(sky_course c, sky_ivec2 size) {
    return sky_patch(c.cell, c.si, c.sj, size);
}

// How far the course may go on unseen: down to the highest texel, or out of the cone.
static float sky_free_way(sky_course c, float gap, float steepness) {
    float room = gap - 1.0f / 1048576.0f;
    if (c.z > 1.0f) return sky_first_root(c.z - 1.0f, c.rise, c.bend);
    return room > 0.0f ? sky_first_root(room, c.rise - c.speed * steepness, c.bend) : 0.0f;
}

// To the first meeting.
static sky_course sky_fly(sky_course c, int max_steps, sky_ivec2 size) {
    bool done = c.t > c.end;
    for (int steps = 0; !done && steps < max_steps; ++steps) {
        float leave = sky_border(c), left = c.end - c.t;
        sky_vec4 ground = sky_ground(c, size);
        float gap = c.z - ground.x, dt = sky_first_root(gap, c.rise - ground.y, c.bend - ground.z);
        bool met = dt <= fminf(leave, left);
        c.found = met;
        if (!met) dt = fmaxf(leave, sky_free_way(c, gap, ground.w));
        done = met || dt >= left;
        if (c.found || !done) c = sky_fly_on(c, dt);
    }
    return c;
}

typedef struct sky_ground_at {
    float height;
    sky_vec2 slope;      // of the cell
} sky_ground_at;

static sky_ground_at sky_look(sky_vec3 box, sky_ivec2 size) {
    sky_ground_at g;
    float x = box.x * (float)(size.x) - 0.5f, y = box.y * (float)(size.y) - 0.5f;
    int i = (int)(floorf(x)), j = (int)(floorf(y));
    i = sky_clampi(i, 0, size.x - 2);
    x -= (float)(i);
    y -= (float)(j);
    sky_vec2 a = sky_texel(i, j, size), b = sky_texel(i + 1, j, size);
    sky_vec2 c = sky_texel(i, j + 1, size), d = sky_texel(i + 1, j + 1, size);
    sky_vec4 heights = sky_make_vec4(a.x, b.x, c.x, d.x);
    float hx = heights.y - heights.x, hy = heights.z - heights.x, hxy = heights.w - heights.z - hx;
    float height = sky_mix(heights, x, y);
    g.height = height;
    g.slope = sky_make_vec2((hx + hxy * y) * (float)(size.x), (hy + hxy * x) * (float)(size.y));
    return g;
}

static sky_vec3 sky_normalize(sky_vec3 a) {
    return sky_scaled(a, 1.0f / sqrtf(sky_dot(a, a)));
}

// Of a surface with these slopes: rows of the way back are the gradients of u, v and z.
static sky_vec3 sky_world_normal(sky_basis b, sky_vec3 box, sky_vec2 slope) {
    float zu = slope.x - sky_drop_along(b, box.x, box.y, 1.0f, 0.0f);
    float zv = slope.y - sky_drop_along(b, box.x, box.y, 0.0f, 1.0f);
    sky_vec3 n = sky_along(sky_along(b.to_z, -zu, b.to_u), -zv, b.to_v);
    return sky_normalize(n);
}

// The side of the rectangle through which a ray came in just where it hit: 1 for u, 2 for v, 0 for none.
static int sky_wall(sky_vec3 o, sky_vec3 d, sky_vec4 bounds, float t) {
    float in_u = sky_clip(sky_make_vec2(0.0f, 1e30f), o.x, d.x, bounds.x, bounds.z).x;
    float in_v = sky_clip(sky_make_vec2(0.0f, 1e30f), o.y, d.y, bounds.y, bounds.w).x;
    float enter = fmaxf(in_u, in_v);
    return enter <= 0.0f || t > enter * 1.00001f ? 0 : in_v > in_u ? 2 : 1;
}

static sky_vec3 sky_world_point(sky_basis b, sky_vec3 box) {
    sky_vec3 p = sky_along(b.origin, box.x - b.offset.x, b.u);
    p = sky_along(p, box.y - b.offset.y, b.v);
    return sky_along(p, box.z - b.level - sky_drop(b, box.x, box.y), b.z);
}

// The direction to the light, and how far it is.
static sky_vec4 sky_toward(sky_vec4 light, sky_basis b, sky_vec3 place) {
    sky_vec3 d = sky_make_vec3(light.x, light.y, light.z);
    if (light.w != 0.0f) d = sky_along(d, -1.0f, sky_world_point(b, place));
    float length = sqrtf(sky_dot(d, d));
    return sky_make_vec4(d.x / length, d.y / length, d.z / length, light.w != 0.0f ? length : 1e30f);
}

// A course towards a direction of the world.
static sky_course sky_look_along(sky_basis b, sky_vec3 place, sky_vec3 direction, float t_max,
                                     sky_vec4 bounds, sky_ivec2 size) {
    sky_vec3 d = sky_box_direction(b, direction);
    sky_vec2 range = sky_clip(sky_make_vec2(0.0f, t_max), place.x, d.x, bounds.x, bounds.z);
    range = sky_clip(range, place.y, d.y, bounds.y, bounds.w);
    return sky_take_off(b, place, d, range, size);
}

// The steepest rise, from low to high, at which a course still touches what lies under it. What was passed below the
// lower flight is below the higher one.
static float sky_horizon(sky_course c, float low, float high, float grain, sky_ivec2 size) {
    float z0 = c.z, begin = c.t, rise = low;
    bool done = c.t > c.end;
    c.rise = low;
    for (int steps = 0; !done && steps < 128 * (size.x + size.y); ++steps) {
        float leave = sky_border(c), left = c.end - c.t, end = fminf(leave, left), t = c.t - begin;
        float above = 1.0f - z0 - c.bend * t * t; // what the highest texel could still do
        if (c.bend >= 0.0f && above <= (rise + grain) * (above > 0.0f ? t : c.end - begin)) break;
        sky_vec4 ground = sky_ground(c, size);
        float gap = c.z - ground.x, b = c.rise - ground.y, a = c.bend - ground.z, most = rise;
        if (sky_first_root(gap, b, a) <= end) { // the greatest of rise - gap / t in this cell
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
        float dt = fmaxf(leave, sky_free_way(c, gap, ground.w));
        done = dt >= left;
        if (!done) c = sky_fly_on(c, dt);
    }
    return rise;
}

// The share of the sky, by horizons: each leaves the cosine-weighted part of a half circle above its slope.
static float sky_sky(sky_basis b, sky_vec3 place, sky_vec3 normal, int directions, float reach, sky_vec4 bounds, sky_ivec2 size) {
    float height = sqrtf(sky_dot(b.z, b.z)), sum = 0.0f;
    sky_vec3 up = sky_scaled(b.z, 1.0f / height), east = sky_normalize(sky_along(b.u, -sky_dot(b.u, up), up));
    sky_vec3 north = sky_cross(up, east);
    for (int k = 0; k < directions; ++k) {
        float angle = 6.2831853f * ((float)(k) + 0.5f) / (float)(directions), zenith = sky_dot(normal, up);
        sky_vec3 direction = sky_along(sky_scaled(east, cosf(angle)), sinf(angle), north);
        float across = sky_dot(normal, direction); // what is behind the surface's own plane is hidden
        float least = zenith > 1e-4f ? -across / zenith : across > 0.0f ? -1e4f : 1e4f;
        sky_course c = sky_look_along(b, place, direction, reach, bounds, size);
        float rise = c.rise, low = fminf(fmaxf(least, -1e4f), 1e4f);
        float slope = (sky_horizon(c, rise + low / height, rise + 1e4f / height, 1.0f / (1024.0f * height), size) -
                       rise) * height;
        float part = 1.0f / (1.0f + slope * slope);
        sum += across * (0.785398163f - 0.5f * atanf(slope) - 0.5f * slope * part) + 0.5f * zenith * part;
    }
    return fminf(fmaxf(2.0f * sum / (float)(directions), 0.0f), 1.0f);
}

// Traces a ray of the world through the relief that the frame puts on a surface, and shades the hit.
static sky_shading sky_shade(sky_effects e, sky_frame frame, sky_vec3 origin, sky_vec3 direction, sky_ivec2 size) {
    sky_shading s;
    s.normal = sky_make_vec3(0.0f, 0.0f, 0.0f);
    s.shadow = 1.0f;
    s.occlusion = 1.0f;
    sky_basis basis = sky_make_basis(frame);
    sky_vec3 o = sky_box_point(basis, origin), d = sky_box_direction(basis, direction);
    sky_vec2 range = sky_make_vec2(0.0f, 1e30f);
    sky_vec2 rim = sky_make_vec2(size.x > 1 ? 0.5f / (float)(size.x) : 0.0f, size.y > 1 ? 0.5f / (float)(size.y) : 0.0f);
    sky_vec4 bounds = sky_make_vec4(rim.x, -1e30f, 1.0f - rim.x, 1e30f); // where there is a surface
    range = sky_clip(range, o.x, d.x, bounds.x, bounds.z);
    range = sky_clip(range, o.y, d.y, bounds.y, bounds.w);
    sky_vec3 from = sky_make_vec3(o.x, o.y, o.z + sky_drop(basis, o.x, o.y)); // z from the base on
    sky_course c = sky_take_off(basis, from, d, range, size);
    c = sky_fly(c, 128 * (size.x + size.y), size);
    s.found = c.found;
    s.t = c.t;
    s.box = sky_make_vec3(((float)(c.cell.i) + (float)(c.si) * c.cell.x + 0.5f) / (float)(size.x),
                 ((float)(c.cell.j) + (float)(c.sj) * c.cell.y + 0.5f) / (float)(size.y), c.z);
    if (s.found) {
        sky_ground_at ground = sky_look(s.box, size);
        sky_vec3 normal = sky_world_normal(basis, s.box, ground.slope);
        sky_vec3 place = sky_make_vec3(s.box.x, s.box.y, fmaxf(s.box.z, ground.height + 1.0f / 1048576.0f));
        int wall = sky_wall(o, d, bounds, s.t);
        if (wall > 0) { // on a side of the solid, or rather just beside it
            float before = (wall == 1 ? d.x : d.y) > 0.0f ? -1.0f : 1.0f;
            sky_vec3 across = wall == 1 ? basis.to_u : basis.to_v;
            normal = sky_normalize(sky_scaled(across, before));
            if (wall == 1) place.x += before * fmaxf(1.0f / 1048576.0f, fabsf(place.x) / 4194304.0f);
            if (wall == 2) place.y += before * fmaxf(1.0f / 1048576.0f, fabsf(place.y) / 4194304.0f);
            place.z = s.box.z;
        }
        s.normal = normal;
        sky_vec4 light = sky_toward(e.light, basis, place);
        sky_vec3 ray = sky_make_vec3(light.x, light.y, light.z);
        c = sky_look_along(basis, place, ray, light.w, bounds, size);
        c = sky_fly(c, 128 * (size.x + size.y), size);
        s.shadow = c.found ? 0.0f : 1.0f;
        float reach = e.sky_reach > 0.0f ? e.sky_reach : 1e30f;
        s.occlusion = sky_sky(basis, place, normal, e.sky_directions, reach, bounds, size);
    }
    return s;
}

