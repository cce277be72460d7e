// conemap.h: exact tracer, with effects.
// plain_shade(effects, frame, origin, direction, gradient, size): traces a ray of the world and shades what it meets.
// gradient: dFdx and dFdy of the surface's own uv.
// size: the map's width and height in texels.
// plain_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct plain_vec2 {
    float x, y;
} plain_vec2;

plain_vec2 plain_fetch(int i, int j);

typedef struct plain_vec3 {
    float x, y, z;
} plain_vec3;

typedef struct plain_hit {
    bool found;
    float t;       // in lengths of the direction
    plain_vec3 position; // u, v, z; u and v are not wrapped
} plain_hit;

typedef struct plain_ivec2 {
    int x, y;
} plain_ivec2;

static plain_vec2 plain_make_vec2(float x, float y) {
    plain_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static plain_vec2 plain_clip(plain_vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0f) return plain_make_vec2(range.x, o >= low && o <= high ? range.y : -1e30f);
    return plain_make_vec2(fmaxf(range.x, fminf(a, b)), fminf(range.y, fmaxf(a, b)));
}

static plain_vec3 plain_make_vec3(float x, float y, float z) {
    plain_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static int plain_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static int plain_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static plain_vec2 plain_texel(int i, int j, plain_ivec2 size) {
    return plain_fetch(plain_clampi(i, 0, size.x - 1), plain_repeat(j, size.y));
}

typedef struct plain_vec4 {
    float x, y, z, w;
} plain_vec4;

static plain_vec4 plain_make_vec4(float x, float y, float z, float w) {
    plain_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float plain_mix(plain_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// First t in 0..end at which a ray from (x, y), c above a bilinear patch, meets it, or -1: a root of c + b t + a t t.
static float plain_patch_hit(plain_vec4 h, float x, float y, float c, plain_vec3 v, float end) {
    float hx = h.y - h.x, hy = h.z - h.x, hxy = h.w - h.z - hx;
    float b = v.z - hx * v.x - hy * v.y - hxy * (x * v.y + y * v.x), a = -hxy * v.x * v.y;
    float d = b * b - 4.0f * a * c, root = sqrtf(fmaxf(d, 0.0f));
    float hit = b < 0.0f ? 2.0f * c / (root - b) : a < 0.0f ? -0.5f * (root + b) / a : -1.0f;
    return c <= 0.0f ? 0.0f : d >= 0.0f && hit <= end ? hit : -1.0f;
}

// Cone steps; in every cell that the ray enters it is met with the bilinear patch itself.
static plain_hit plain_trace(plain_vec3 origin, plain_vec3 direction, float t_min, float t_max, plain_ivec2 size) {
    plain_vec2 range = plain_clip(plain_make_vec2(t_min, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
    float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
    range.y = fminf(range.y, t_max);
    range = plain_clip(range, origin.x, direction.x, 0.0f, 1.0f);
    int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
    plain_vec3 v = plain_make_vec3(fmaxf(fabsf(direction.x) * (float)(size.x), 1e-20f), fmaxf(fabsf(direction.y) * (float)(size.y), 1e-20f), direction.z);
    float x = (float)(si) * (origin.x * (float)(size.x) - 0.5f), y = (float)(sj) * (origin.y * (float)(size.y) - 0.5f), z = origin.z;
    float reach_end = range.x + 1048576.0f / (v.x + v.y); // farther than a float can tell cells apart
    range.y = fminf(range.y, reach_end);
    float t = 0.0f, dt = range.x, hit = -1.0f, speed = sqrtf(direction.x * direction.x + 3.60000014e-1f * direction.y * direction.y);
    bool done = range.x > range.y;
    for (; !done && steps < 64 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * (int)(floorf(x)); x -= floorf(x); j += sj * (int)(floorf(y)); y -= floorf(y);
        plain_vec2 a = plain_texel(i, j, size), b = plain_texel(i + si, j, size);
        plain_vec2 c = plain_texel(i, j + sj, size), d = plain_texel(i + si, j + sj, size);
        plain_vec4 heights = plain_make_vec4(a.x, b.x, c.x, d.x);
        float height = plain_mix(heights, x, y);
        float cone = plain_mix(plain_make_vec4(a.y, b.y, c.y, d.y), x, y);
        float leave = fminf((1.000001f - x) / v.x, (1.000001f - y) / v.y), left = range.y - t; // just over the border
        hit = plain_patch_hit(heights, x, y, z - height, v, fminf(leave, left));
        float gap = z - height - 1.0f / 1048576.0f, closing = speed - cone * v.z; // to an apex raised by more than rounding
        dt = fmaxf(leave, gap <= 0.0f ? 0.0f : closing > 0.0f ? cone * gap / closing : 1e30f);
        done = hit >= 0.0f || dt >= left;
    }
    if (done && hit < 0.0f && range.y == ground && range.x <= range.y) hit = range.y - t;
    dt = fmaxf(hit, 0.0f);
    plain_hit result;
    result.found = hit >= 0.0f;
    result.t = t + dt;
    result.position = plain_make_vec3(((float)(i) + (float)(si) * (x + v.x * dt) + 0.5f) / (float)(size.x), ((float)(j) + (float)(sj) * (y + v.y * dt) + 0.5f) / (float)(size.y), z + v.z * dt);
    return result;
}

typedef struct plain_shading {
    bool found;
    float t;
    plain_vec3 box;         // u, v, z
    plain_vec3 position;
    plain_vec3 normal;
    float depth;
    float shadow;    // 0 dark to 1 lit
    float occlusion; // 0 closed to 1 open
    plain_vec2 uv;
    plain_vec4 gradient;    // dFdx and dFdy of the surface's uv
    float fade;      // 0 relief to 1 normals only
} plain_shading;

typedef struct plain_effects {
    plain_vec4 clip;           // least u and v, greatest u and v
    plain_vec4 clip_z, clip_w; // rows of the matrix: clip z and w of (position, 1)
    plain_vec4 light;          // towards the light, 0; or its position, 1
    float fade_begin;     // pixels that the relief is high
    float fade_end;
} plain_effects;

typedef struct plain_frame {
    plain_vec3 origin;                     // where the surface has uv_offset
    plain_vec3 tangent, bitangent, normal; // world per x, y and height
    plain_vec2 uv_offset, uv_scale;        // map widths per unit of x, and of y
    float depth, level;              // how high z = 1 stands over z = 0; the z of the surface
} plain_frame;

typedef struct plain_basis {
    plain_vec3 u, v, z;          // world per u, v and z
    plain_vec3 to_u, to_v, to_z; // and back
    plain_vec3 origin;
    plain_vec2 offset;
    float level;
} plain_basis;

static plain_vec3 plain_cross(plain_vec3 a, plain_vec3 b) {
    return plain_make_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static float plain_dot(plain_vec3 a, plain_vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static plain_vec3 plain_scaled(plain_vec3 a, float scale) {
    return plain_make_vec3(a.x * scale, a.y * scale, a.z * scale);
}

static plain_basis plain_make_basis(plain_frame frame, plain_vec3 toward) {
    plain_basis b;
    float scale_v = frame.uv_scale.y / 6.00000024e-1f;
    plain_vec3 plane = plain_cross(frame.tangent, frame.bitangent); // seen from behind its normal turns over
    float side = plain_dot(plane, frame.normal) * plain_dot(plane, toward) > 0.0f ? -1.0f : 1.0f;
    b.u = plain_scaled(frame.tangent, 1.0f / frame.uv_scale.x);
    b.v = plain_scaled(frame.bitangent, 1.0f / scale_v);
    b.z = plain_scaled(frame.normal, side * frame.depth);
    b.to_u = plain_cross(b.v, b.z);
    b.to_v = plain_cross(b.z, b.u);
    b.to_z = plain_cross(b.u, b.v);
    float volume = plain_dot(b.u, b.to_u);
    b.to_u = plain_scaled(b.to_u, 1.0f / volume);
    b.to_v = plain_scaled(b.to_v, 1.0f / volume);
    b.to_z = plain_scaled(b.to_z, 1.0f / volume);
    b.origin = frame.origin;
    b.offset = frame.uv_offset;
    b.level = frame.level;
    return b;
}

// From how many pixels high the relief stands: a pixel is its footprint's area over its length.
static float plain_fade_of(plain_basis b, plain_vec4 gradient, float begin, float end) {
    float x = gradient.x * gradient.x + 3.60000014e-1f * gradient.y * gradient.y;
    float y = gradient.z * gradient.z + 3.60000014e-1f * gradient.w * gradient.w;
    float area = 6.00000024e-1f * fabsf(gradient.x * gradient.w - gradient.y * gradient.z), longest = sqrtf(fmaxf(x, y));
    float pixel = longest > 0.0f ? area / longest : 0.0f;
    float faded = (begin - sqrtf(plain_dot(b.z, b.z) / plain_dot(b.u, b.u)) / fmaxf(pixel, 1e-30f)) / (begin - end);
    faded = fminf(fmaxf(faded, 0.0f), 1.0f);
    return faded * faded * (3.0f - 2.0f * faded);
}

// A direction, and a point, of the world in the box.
static plain_vec3 plain_box_direction(plain_basis b, plain_vec3 d) {
    return plain_make_vec3(plain_dot(b.to_u, d), plain_dot(b.to_v, d), plain_dot(b.to_z, d));
}

// p + t d
static plain_vec3 plain_along(plain_vec3 p, float t, plain_vec3 d) {
    return plain_make_vec3(p.x + t * d.x, p.y + t * d.y, p.z + t * d.z);
}

static plain_vec3 plain_box_point(plain_basis b, plain_vec3 p) {
    plain_vec3 d = plain_box_direction(b, plain_along(p, -1.0f, b.origin));
    return plain_make_vec3(d.x + b.offset.x, d.y + b.offset.y, d.z + b.level);
}

// The same without the bend.
static float plain_fall(float c, float b) {
    return c <= 0.0f ? 0.0f : b < 0.0f ? c / -b : 1e30f;
}

// Where a ray meets the base itself, from either side.
static float plain_base(plain_basis b, plain_vec3 o, plain_vec3 d) {
    float over = o.z - b.level, side = over < 0.0f ? -1.0f : 1.0f;
    return plain_fall(side * over, side * d.z);
}

typedef struct plain_ground_at {
    float height;
    plain_vec2 slope;      // of the cell
    plain_vec2 gentle;     // of the texels' derivatives, interpolated
    float steepness; // 1 / tan of the cone
} plain_ground_at;

// dh/du and dh/dv at a texel, per texel.
static plain_vec2 plain_difference(int i, int j, plain_ivec2 size) {
    i = plain_clampi(i, 0, size.x - 1);
    float x = plain_texel(i + 1, j, size).x - plain_texel(i - 1, j, size).x;
    float y = plain_texel(i, j + 1, size).x - plain_texel(i, j - 1, size).x;
    if (i > 0 && i + 1 < size.x) x *= 0.5f; // at the border it spans one texel
    y *= 0.5f;
    return plain_make_vec2(x, y);
}

static plain_ground_at plain_look(plain_vec3 box, plain_ivec2 size) {
    plain_ground_at g;
    float x = box.x * (float)(size.x) - 0.5f, y = box.y * (float)(size.y) - 0.5f;
    int i = (int)(floorf(x)), j = (int)(floorf(y));
    x -= (float)(i);
    y -= (float)(j);
    plain_vec2 a = plain_texel(i, j, size), b = plain_texel(i + 1, j, size);
    plain_vec2 c = plain_texel(i, j + 1, size), d = plain_texel(i + 1, j + 1, size);
    plain_vec4 heights = plain_make_vec4(a.x, b.x, c.x, d.x);
    float hx = heights.y - heights.x, hy = heights.z - heights.x, hxy = heights.w - heights.z - hx;
    float height = plain_mix(heights, x, y);
    g.height = height;
    g.slope = plain_make_vec2((hx + hxy * y) * (float)(size.x), (hy + hxy * x) * (float)(size.y));
    plain_vec2 p = plain_difference(i, j, size), q = plain_difference(i + 1, j, size);
    plain_vec2 r = plain_difference(i, j + 1, size), s = plain_difference(i + 1, j + 1, size);
    g.gentle = plain_make_vec2(plain_mix(plain_make_vec4(p.x, q.x, r.x, s.x), x, y) * (float)(size.x),
                    plain_mix(plain_make_vec4(p.y, q.y, r.y, s.y), x, y) * (float)(size.y));
    float cone = plain_mix(plain_make_vec4(a.y, b.y, c.y, d.y), x, y);
    g.steepness = 1.0f / fmaxf(cone, 1e-9f);
    return g;
}

static plain_vec3 plain_normalize(plain_vec3 a) {
    return plain_scaled(a, 1.0f / sqrtf(plain_dot(a, a)));
}

// Of a surface with these slopes: rows of the way back are the gradients of u, v and z.
static plain_vec3 plain_world_normal(plain_basis b, plain_vec2 slope) {
    plain_vec3 n = plain_along(plain_along(b.to_z, -slope.x, b.to_u), -slope.y, b.to_v);
    return plain_normalize(n);
}

// The side of the rectangle through which a ray came in just where it hit: 1 for u, 2 for v, 0 for none.
static int plain_wall(plain_vec3 o, plain_vec3 d, plain_vec4 bounds, float t) {
    float in_u = plain_clip(plain_make_vec2(0.0f, 1e30f), o.x, d.x, bounds.x, bounds.z).x;
    float in_v = plain_clip(plain_make_vec2(0.0f, 1e30f), o.y, d.y, bounds.y, bounds.w).x;
    float enter = fmaxf(in_u, in_v);
    return enter <= 0.0f || t > enter * 1.00001f ? 0 : in_v > in_u ? 2 : 1;
}

static plain_vec3 plain_world_point(plain_basis b, plain_vec3 box) {
    plain_vec3 p = plain_along(b.origin, box.x - b.offset.x, b.u);
    p = plain_along(p, box.y - b.offset.y, b.v);
    return plain_along(p, box.z - b.level, b.z);
}

// The direction to the light, and how far it is.
static plain_vec4 plain_toward(plain_vec4 light, plain_basis b, plain_vec3 place) {
    plain_vec3 d = plain_make_vec3(light.x, light.y, light.z);
    if (light.w != 0.0f) d = plain_along(d, -1.0f, plain_world_point(b, place));
    float length = sqrtf(plain_dot(d, d));
    return plain_make_vec4(d.x / length, d.y / length, d.z / length, light.w != 0.0f ? length : 1e30f);
}

// Traces a ray of the world through the relief that the frame puts on a surface, and shades the hit.
static plain_shading plain_shade(plain_effects e, plain_frame frame, plain_vec3 origin, plain_vec3 direction, plain_vec4 gradient, plain_ivec2 size) {
    plain_shading s;
    s.position = plain_make_vec3(0.0f, 0.0f, 0.0f);
    s.normal = plain_make_vec3(0.0f, 0.0f, 0.0f);
    s.depth = 0.0f;
    s.shadow = 1.0f;
    s.occlusion = 1.0f;
    plain_basis basis = plain_make_basis(frame, direction);
    plain_basis upright = basis; // before it is flattened
    s.fade = plain_fade_of(basis, gradient, e.fade_begin, e.fade_end);
    frame.depth *= 1.0f - fminf(s.fade, 0.9999f);
    basis = plain_make_basis(frame, direction);
    plain_vec3 o = plain_box_point(basis, origin), d = plain_box_direction(basis, direction);
    plain_vec2 range = plain_make_vec2(0.0f, 1e30f);
    plain_vec4 bounds = plain_make_vec4(fmaxf(e.clip.x, 0.0f), e.clip.y, fminf(e.clip.z, 1.0f), e.clip.w); // where there is a surface
    range = plain_clip(range, o.x, d.x, bounds.x, bounds.z);
    range = plain_clip(range, o.y, d.y, bounds.y, bounds.w);
    plain_vec2 whole = range;
    if (s.fade >= 0.9999f) range.y = -1.0f; // only the base is left
    plain_hit hit = plain_trace(o, d, range.x, range.y, size);
    s.found = hit.found;
    s.t = hit.t;
    s.box = hit.position;
    if (s.fade >= 0.9999f) {
        float base = plain_base(basis, o, d);
        s.found = base >= whole.x * 0.9999f && base <= whole.y;
        s.t = fmaxf(base, whole.x);
        s.box = plain_along(o, s.t, d);
        s.box.z = basis.level;
    }
    s.uv = plain_make_vec2(s.box.x, s.box.y);
    s.gradient = gradient;
    if (s.found) {
        s.position = plain_along(origin, s.t, direction);
        plain_vec3 seen = plain_along(origin, s.t, direction);
        float w = e.clip_w.x * seen.x + e.clip_w.y * seen.y + e.clip_w.z * seen.z + e.clip_w.w;
        s.depth = (e.clip_z.x * seen.x + e.clip_z.y * seen.y + e.clip_z.z * seen.z + e.clip_z.w) / w;
        if (!(w > 0.0f)) s.depth = 0.0f;
        plain_ground_at ground = plain_look(s.box, size);
        plain_vec3 normal = plain_world_normal(upright, ground.slope);
        float stretch = plain_dot(basis.z, basis.z), x = ground.gentle.x * ground.gentle.x / plain_dot(basis.u, basis.u);
        float own = sqrtf(stretch * (x + ground.gentle.y * ground.gentle.y / plain_dot(basis.v, basis.v)));
        float steepest = sqrtf(stretch / plain_dot(basis.u, basis.u)) * (fminf(ground.steepness, 1e6f) - 1.0f / 1.0f);
        float hill = 0.3f * fmaxf(steepest - own, 0.0f);
        s.occlusion = 1.0f / (1.0f + hill * hill);
        plain_vec3 place = plain_make_vec3(s.box.x, s.box.y, fmaxf(s.box.z, ground.height + 1.0f / 1048576.0f));
        int wall = plain_wall(o, d, bounds, s.t);
        if (s.fade >= 0.9999f) wall = 0;
        if (wall > 0) { // on a side of the solid, or rather just beside it
            float before = (wall == 1 ? d.x : d.y) > 0.0f ? -1.0f : 1.0f;
            plain_vec3 across = wall == 1 ? upright.to_u : upright.to_v;
            normal = plain_normalize(plain_scaled(across, before));
            if (wall == 1) place.x += before * fmaxf(1.0f / 1048576.0f, fabsf(place.x) / 4194304.0f);
            if (wall == 2) place.y += before * fmaxf(1.0f / 1048576.0f, fabsf(place.y) / 4194304.0f);
            place.z = s.box.z;
            s.occlusion = 0.5f;
        }
        s.normal = normal;
        plain_vec4 light = plain_toward(e.light, basis, place);
        plain_vec3 ray = plain_make_vec3(light.x, light.y, light.z);
        plain_vec3 lit = plain_box_direction(basis, ray);
        range = plain_make_vec2(0.0f, light.w);
        range = plain_clip(range, place.x, lit.x, bounds.x, bounds.z);
        range = plain_clip(range, place.y, lit.y, bounds.y, bounds.w);
        hit = plain_trace(place, lit, range.x, range.y, size);
        s.shadow = hit.found ? 0.0f : 1.0f;
    }
    return s;
}

