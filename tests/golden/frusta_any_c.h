// conemap.h: frusta with relief, by cone steps.
// fany_rows: the host's: row 0..8 of a conemap_frustum, as four integers
// fany_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct fany_ivec4 {
    int x, y, z, w;
} fany_ivec4;

typedef struct fany_vec2 {
    float x, y;
} fany_vec2;

fany_ivec4 fany_rows(int frustum, int row);
fany_vec2 fany_fetch(int i, int j);

typedef struct fany_vec3 {
    float x, y, z;
} fany_vec3;

typedef struct fany_vec4 {
    float x, y, z, w;
} fany_vec4;

typedef struct fany_frustum {
    fany_vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates
    fany_vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there
    fany_vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth
    fany_vec4 extent; // length of the axis; start and size in the map's v; twist
    fany_ivec4 links; // parent, child, branch, sibling
    fany_ivec4 more; // flags, u_repeat, user
} fany_frustum;

static fany_vec4 fany_make_vec4(float x, float y, float z, float w) {
    fany_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float fany_real(int bits) {
    union {
        int whole;
        float real;
    } both;
    both.whole = bits;
    return both.real;
}

static fany_vec4 fany_real4(fany_ivec4 bits) {
    return fany_make_vec4(fany_real(bits.x), fany_real(bits.y), fany_real(bits.z), fany_real(bits.w));
}

// One of a frustum's nine rows, as integers: as floats, a unit could flush its small ones to 0.
static fany_ivec4 fany_row(int frustum, int row) {
    return fany_rows(frustum, row);
}

static fany_frustum fany_load(int frustum) {
    fany_frustum f;
    f.axis_x = fany_real4(fany_row(frustum, 0));
    f.axis_y = fany_real4(fany_row(frustum, 1));
    f.axis_z = fany_real4(fany_row(frustum, 2));
    f.lower = fany_real4(fany_row(frustum, 3));
    f.upper = fany_real4(fany_row(frustum, 4));
    f.radii = fany_real4(fany_row(frustum, 5));
    f.extent = fany_real4(fany_row(frustum, 6));
    f.links = fany_row(frustum, 7);
    f.more = fany_row(frustum, 8);
    return f;
}

static fany_vec3 fany_make_vec3(float x, float y, float z) {
    fany_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

// Narrows (from, to, face) to where g + gv t >= 0; a ray that enters there enters through `face`.
static fany_vec3 fany_half(fany_vec3 span, float g, float gv, float face) {
    float t = gv != 0.0f ? -g / gv : 0.0f;
    if (gv > 0.0f && t > span.x) span = fany_make_vec3(t, span.y, face);
    if (gv < 0.0f) span.y = fminf(span.y, t);
    if (gv == 0.0f && g < 0.0f) span.y = -1e30f;
    return span;
}

// Where a ray of the frame is between the cutting planes and inside a cone (radius at y = 0, its growth): from, to, and
// the face that it enters through, 0 the cone, 1 the lower plane, 2 the upper; nowhere if from > to. The quadratic is
// set up where the ray is nearest to the axis, its discriminant from the ray's moment about the axis, and solved in
// the form that does not cancel. There is no apex, so cylinders are nothing special, and no mirrored nappe.
static fany_vec3 fany_span(fany_frustum f, fany_vec2 cone, fany_vec3 o, fany_vec3 v, float t_min, float t_max) {
    float seam = 1e-6f * (f.extent.x + cone.x); // by so much neighbours overlap: rounding opens no gap
    fany_vec3 span = fany_make_vec3(t_min, t_max, 0.0f);
    span = fany_half(span, o.y - f.lower.x * o.x - f.lower.y * o.z - f.lower.z + seam,
                        v.y - f.lower.x * v.x - f.lower.y * v.z, 1.0f);
    span = fany_half(span, f.upper.x * o.x + f.upper.y * o.z + f.upper.z - o.y + seam,
                        f.upper.x * v.x + f.upper.y * v.z - v.y, 2.0f);
    float across = v.x * v.x + v.z * v.z;
    float at = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : span.x;
    at = fminf(fmaxf(at, span.x), span.y);
    float x = o.x + at * v.x, y = o.y + at * v.y, z = o.z + at * v.z, d = sqrtf(x * x + z * z);
    float radius = cone.x + cone.y * y, growth = cone.y * v.y, along = x * v.x + z * v.z;
    fany_vec3 inside = fany_half(fany_make_vec3(span.x - at, span.y - at, span.z), radius, growth, 0.0f);
    float a = across - growth * growth, b = along - radius * growth, c = (d - radius) * (d + radius);
    float reach = sqrtf(across) * radius, moment = fabsf(x * v.z - z * v.x);
    float root = (reach - moment) * (reach + moment) + growth * (growth * d * d - 2.0f * along * radius);
    bool meets = span.x <= span.y && (root >= 0.0f || a <= 0.0f); // or passes beside
    root = sqrtf(fmaxf(root, 0.0f));
    float q = b < 0.0f ? root - b : -root - b;
    float one = a != 0.0f ? q / a : q > 0.0f ? 1e30f : -1e30f, two = q != 0.0f ? c / q : one;
    float first = fminf(one, two), second = fmaxf(one, two);
    if (a < 0.0f) { // steeper than the cone: inside it beyond one root, the other is the mirrored nappe's
        second = growth > 0.0f ? 1e30f : first;
        first = growth > 0.0f ? fmaxf(one, two) : -1e30f;
    }
    if (a == 0.0f && q == 0.0f) { // along its straight lines
        first = -1e30f;
        second = c > 0.0f ? -1e30f : 1e30f;
    }
    if (first > inside.x) inside = fany_make_vec3(first, inside.y, 0.0f);
    inside.y = fminf(inside.y, second);
    span = fany_make_vec3(fmaxf(span.x, inside.x + at), fminf(span.y, inside.y + at), inside.z);
    return meets && inside.x <= inside.y ? span : fany_make_vec3(1.0f, 0.0f, 0.0f);
}

static fany_vec2 fany_make_vec2(float x, float y) {
    fany_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

typedef struct fany_shell { // what bounds how fast the map's place changes along a ray
    float turning, nearest; // |x' z - x z'|; t where the ray is nearest to the axis
    float by_v, span; // v moves at by_v / span at most: see fany_bound_speed
} fany_shell;

// The angle turns at |x' z - x z'| / d^2. Both cuts y = a x + b z + c, weighted as v weights them, move at no more
// than |(n_lower, n_upper)| / (1 - k n) times |(x, z)'| + k |y'|, n the slopes; span is the least way between them.
static fany_shell fany_bound_speed(fany_frustum f, fany_vec3 o, fany_vec3 v) {
    fany_shell s;
    fany_vec2 inner = fany_make_vec2(f.radii.x, f.radii.y), outer = fany_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float lower = sqrtf(f.lower.x * f.lower.x + f.lower.y * f.lower.y);
    float upper = sqrtf(f.upper.x * f.upper.x + f.upper.y * f.upper.y);
    float da = f.upper.x - f.lower.x, db = f.upper.y - f.lower.y, n = fmaxf(lower, upper);
    float k = fmaxf(fabsf(inner.y), fabsf(outer.y)), vy = fabsf(v.y), across = v.x * v.x + v.z * v.z;
    s.turning = fabsf(v.x * o.z - o.x * v.z);
    s.nearest = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : 0.0f;
    s.by_v = vy + sqrtf(lower * lower + upper * upper) / (1.0f - k * n) * (sqrtf(across) + k * vy);
    s.span = fmaxf(outer.x + outer.y * f.lower.z, inner.x + inner.y * f.lower.z) / (1.0f - k * lower);
    s.span = (f.upper.z - f.lower.z - s.span * sqrtf(da * da + db * db)) / (1.0f + k * upper);
    return s;
}

typedef struct fany_uvw { // a place in a frustum, with what it was computed from
    float u, v, w;
    float d, sine, cosine, thickness; // distance from the axis, direction from it; of the shell there
    fany_vec2 cone; // that of the shell that goes through the place
    float low, high; // y where its straight line there meets the cutting planes
} fany_uvw;

// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its growth) in the
// direction in which the plane rises by `tilt`.
static float fany_cut(fany_vec4 plane, float tilt, fany_vec2 cone, float base) {
    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0f - cone.y * tilt);
}

// The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. Within 1e-7.
static float fany_turns(float x, float z) {
    float ax = fabsf(x), az = fabsf(z), large = fmaxf(ax, az), a = large > 0.0f ? fminf(ax, az) / large : 0.0f;
    float base = a > 0.414213562f ? 0.125f : 0.0f; // turned back by an eighth
    if (base > 0.0f) a = (a - 1.0f) / (a + 1.0f);
    float s = a * a;
    float turns = base + a * (0.15915485f + s * (-0.05303445f + s * (0.03131805f - s * 0.01766679f)));
    if (ax > az) turns = 0.25f - turns;
    if (z < 0.0f) turns = 0.5f - turns;
    return x < 0.0f ? 1.0f - turns : turns;
}

static fany_uvw fany_locate(fany_frustum f, fany_vec3 p) {
    fany_uvw at;
    at.d = sqrtf(p.x * p.x + p.z * p.z);
    at.sine = at.d > 0.0f ? p.x / at.d : 0.0f;
    at.cosine = at.d > 0.0f ? p.z / at.d : 1.0f;
    at.thickness = f.radii.z + f.radii.w * p.y;
    at.w = at.d - (f.radii.x + f.radii.y * p.y);
    if (at.thickness > 0.0f) at.w = at.w / at.thickness;
    float w = at.thickness > 0.0f ? fminf(fmaxf(at.w, -0.5f), 1.5f) : 0.0f;
    at.cone = fany_make_vec2(f.radii.x + w * f.radii.z, f.radii.y + w * f.radii.w);
    at.low = fany_cut(f.lower, f.lower.x * at.sine + f.lower.y * at.cosine, at.cone, 0.0f);
    at.high = fany_cut(f.upper, f.upper.x * at.sine + f.upper.y * at.cosine, at.cone, 0.0f);
    at.v = at.high != at.low ? (p.y - at.low) / (at.high - at.low) : 0.0f;
    at.u = fany_turns(p.x, p.z);
    return at;
}

static fany_vec3 fany_along(fany_vec3 o, fany_vec3 v, float t) {
    return fany_make_vec3(o.x + t * v.x, o.y + t * v.y, o.z + t * v.z);
}

// The map's u and v, not wrapped.
static fany_vec2 fany_map_place(fany_frustum f, float u, float v) {
    float clamped = fminf(fmaxf(v, 0.0f), 1.0f);
    return fany_make_vec2((u + clamped * f.extent.w) * (float)(f.more.y), f.extent.y + clamped * f.extent.z);
}

// The same in texels, from the centre of texel (0, 0).
static fany_vec2 fany_texels(fany_frustum f, float u, float v) {
    fany_vec2 at = fany_map_place(f, u, v);
    at.y -= floorf(at.y);
    return fany_make_vec2((at.x - floorf(at.x)) * 64.0f - 0.5f, at.y * 48.0f - 0.5f);
}

static int fany_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static fany_vec2 fany_texel(int i, int j) {
    return fany_fetch(fany_repeat(i, 64), fany_repeat(j, 48));
}

static float fany_mix(fany_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height of the relief, and tangent of the cone there.
static fany_vec2 fany_relief(fany_frustum f, float u, float v) {
    fany_vec2 at = fany_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y)), si = 1, sj = 1;
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    fany_vec2 a = fany_texel(i, j), b = fany_texel(i + si, j);
    fany_vec2 c = fany_texel(i, j + sj), d = fany_texel(i + si, j + sj);
    fany_vec4 heights = fany_make_vec4(a.x, b.x, c.x, d.x);
    float height = fany_mix(heights, x, y);
    float cone = fany_mix(fany_make_vec4(a.y, b.y, c.y, d.y), x, y);
    return fany_make_vec2(height, cone);
}

// How fast the map's place changes at most, from t to t_end.
static float fany_map_speed(fany_frustum f, fany_shell s, fany_vec3 o, fany_vec3 v, float t, float t_end) {
    fany_vec3 p = fany_along(o, v, fminf(fmaxf(s.nearest, t), t_end));
    float d2 = p.x * p.x + p.z * p.z;
    float angle = s.turning / fmaxf(d2, 1e-30f), by_v = s.by_v / s.span;
    float by_u = (angle * 0.159154943f + by_v * fabsf(f.extent.w)) * (float)(f.more.y);
    by_v *= fabsf(f.extent.z);
    return s.span > 0.0f && d2 > 0.0f ? sqrtf(by_u * by_u + by_v * by_v) : 1e30f;
}

// How far the ray is above the relief at t, in heights.
static float fany_above(fany_frustum f, fany_vec3 o, fany_vec3 v, float t) {
    fany_uvw at = fany_locate(f, fany_along(o, v, t));
    return at.w - fany_relief(f, at.u, at.v).x;
}

// Cone steps, none shorter than one of 256 equal ones, then halvings: t where the ray meets the relief in a range
// of t, at its end if `solid`; 1e30: it does not. The ray is g above the cone's apex, in the world's units, and
// meets nothing while g + g' t > thickness speed t / tangent.
static float fany_march(fany_frustum f, fany_vec3 o, fany_vec3 v, fany_vec2 range, bool solid) {
    float before = range.x, t = range.x;
    bool met = false;
    float least = (range.y - range.x) / (float)(256);
    float thick_end = f.radii.z + f.radii.w * (o.y + range.y * v.y);
    fany_shell shell = fany_bound_speed(f, o, v);
    for (int k = 0; k <= 256; ++k) {
        fany_uvw at = fany_locate(f, fany_along(o, v, t));
        fany_vec2 relief = fany_relief(f, at.u, at.v);
        met = at.w <= relief.x || (solid && t >= range.y);
        if (met || t >= range.y) break;
        float apex = relief.x + 1.0f / 1048576.0f, g = (at.w - apex) * at.thickness;
        float slope = at.sine * v.x + at.cosine * v.z - (f.radii.y + f.radii.w * apex) * v.y;
        float closing = fmaxf(at.thickness, thick_end) * fany_map_speed(f, shell, o, v, t, range.y);
        closing -= relief.y * slope;
        before = t;
        t += fmaxf(g <= 0.0f ? 0.0f : closing > 0.0f ? relief.y * g / closing : 1e30f, least);
        if (t > range.y || k + 1 >= 256) t = range.y;
    }
    for (int n = 0; met && n < 10; ++n) {
        float middle = 0.5f * (before + t);
        bool over = fany_above(f, o, v, middle) > 0.0f;
        before = over ? middle : before;
        t = over ? t : middle;
    }
    return met ? t : 1e30f;
}

// t where a ray of the frame meets the frustum's relief, 1e30 where it does not, and the face; see fany_span.
static fany_vec2 fany_meet(fany_frustum f, fany_vec3 o, fany_vec3 v, float t_min, float t_max) {
    fany_vec3 inner = fany_span(f, fany_make_vec2(f.radii.x, f.radii.y), o, v, t_min, t_max), outer = inner;
    bool solid = inner.x <= inner.y, shell = f.radii.z > 0.0f || f.radii.w > 0.0f;
    if (shell) outer = fany_span(f, fany_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, t_min, t_max);
    if (solid && outer.x > outer.y) outer = inner; // by rounding, where there is no shell
    float t = outer.x <= outer.y ? outer.x : 1e30f;
    if (shell && outer.x <= outer.y)
        t = fany_march(f, o, v, fany_make_vec2(outer.x, solid ? fmaxf(inner.x, outer.x) : outer.y), solid);
    return fany_make_vec2(t, t > outer.x ? 0.0f : outer.z);
}

// A direction of the world in the frustum's frame.
static fany_vec3 fany_into(fany_frustum f, fany_vec3 d) {
    return fany_make_vec3(f.axis_x.x * d.x + f.axis_x.y * d.y + f.axis_x.z * d.z,
                f.axis_y.x * d.x + f.axis_y.y * d.y + f.axis_y.z * d.z,
                f.axis_z.x * d.x + f.axis_z.y * d.y + f.axis_z.z * d.z);
}

static fany_vec3 fany_place_into(fany_frustum f, fany_vec3 p) {
    return fany_into(f, fany_make_vec3(p.x - f.axis_x.w, p.y - f.axis_y.w, p.z - f.axis_z.w));
}

// Does a ray of the world meet any of `count` frusta from `first`? For shadows.
static bool fany_any_frusta(int first, int count, fany_vec3 origin, fany_vec3 direction, float t_min, float t_max) {
    bool found = false;
    for (int k = first; k < first + count && !found; ++k) {
        fany_frustum f = fany_load(k);
        found = fany_meet(f, fany_place_into(f, origin), fany_into(f, direction), t_min, t_max).x <= t_max;
    }
    return found;
}

// Corner 0..7 of the pyramid around the shell, cut by the planes, in the frame.
static fany_vec3 fany_corner(fany_frustum f, int corner) {
    float sx = (corner & 3) == 1 || (corner & 3) == 2 ? 1.0f : -1.0f, sz = (corner & 3) >= 2 ? 1.0f : -1.0f;
    fany_vec2 cone = fany_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float low = fany_cut(f.lower, f.lower.x * sx + f.lower.y * sz, cone, 0.0f);
    float y = corner < 4 ? low : fany_cut(f.upper, f.upper.x * sx + f.upper.y * sz, cone, 0.0f);
    float reach = fmaxf(cone.x + cone.y * y, 0.0f);
    return fany_make_vec3(sx * reach, y, sz * reach);
}

// Vertex 0..35 of the twelve triangles around a frustum's shell, in its frame; see fany_frustum_triangles.
static fany_vec3 fany_bounds(int frustum, int number) {
    static const int corners[36] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, 1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0};
    return fany_corner(fany_load(frustum), corners[number]);
}

