// conemap.h: frusta with relief, by cone steps.
// fcones_rows: the host's: row 0..8 of a conemap_frustum, as four integers
// fcones_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct fcones_ivec4 {
    int x, y, z, w;
} fcones_ivec4;

typedef struct fcones_vec2 {
    float x, y;
} fcones_vec2;

fcones_ivec4 fcones_rows(int frustum, int row);
fcones_vec2 fcones_fetch(int i, int j);

typedef struct fcones_vec3 {
    float x, y, z;
} fcones_vec3;

typedef struct fcones_frustum_hit {
    bool found;
    bool inside; // the ray began inside
    int frustum, user; // that was hit; its `user`
    int cap; // 1, 2: the flat lower, upper end of a segment
    float t; // in lengths of the direction
    fcones_vec3 position;
    fcones_vec3 uvw; // of the frustum; v 0..1, w the height in the shell
    fcones_vec2 map; // u and v of the map, not wrapped
    fcones_vec3 normal, true_normal; // units: for shading, continuous across joints; of the surface as it is
} fcones_frustum_hit;

static fcones_vec3 fcones_make_vec3(float x, float y, float z) {
    fcones_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static fcones_vec2 fcones_make_vec2(float x, float y) {
    fcones_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static fcones_frustum_hit fcones_no_frustum(float t) {
    fcones_frustum_hit hit;
    hit.found = false;
    hit.inside = false;
    hit.frustum = -1;
    hit.user = 0;
    hit.cap = 0;
    hit.t = t;
    hit.position = fcones_make_vec3(0.0f, 0.0f, 0.0f);
    hit.uvw = hit.position;
    hit.map = fcones_make_vec2(0.0f, 0.0f);
    hit.normal = hit.position;
    hit.true_normal = hit.position;
    return hit;
}

typedef struct fcones_vec4 {
    float x, y, z, w;
} fcones_vec4;

typedef struct fcones_frustum {
    fcones_vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates
    fcones_vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there
    fcones_vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth
    fcones_vec4 extent; // length of the axis; start and size in the map's v; twist
    fcones_ivec4 links; // parent, child, branch, sibling
    fcones_ivec4 more; // flags, u_repeat, user
} fcones_frustum;

static fcones_vec4 fcones_make_vec4(float x, float y, float z, float w) {
    fcones_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float fcones_real(int bits) {
    union {
        int whole;
        float real;
    } both;
    both.whole = bits;
    return both.real;
}

static fcones_vec4 fcones_real4(fcones_ivec4 bits) {
    return fcones_make_vec4(fcones_real(bits.x), fcones_real(bits.y), fcones_real(bits.z), fcones_real(bits.w));
}

// One of a frustum's nine rows, as integers: as floats, a unit could flush its small ones to 0.
static fcones_ivec4 fcones_row(int frustum, int row) {
    return fcones_rows(frustum, row);
}

static fcones_frustum fcones_load(int frustum) {
    fcones_frustum f;
    f.axis_x = fcones_real4(fcones_row(frustum, 0));
    f.axis_y = fcones_real4(fcones_row(frustum, 1));
    f.axis_z = fcones_real4(fcones_row(frustum, 2));
    f.lower = fcones_real4(fcones_row(frustum, 3));
    f.upper = fcones_real4(fcones_row(frustum, 4));
    f.radii = fcones_real4(fcones_row(frustum, 5));
    f.extent = fcones_real4(fcones_row(frustum, 6));
    f.links = fcones_row(frustum, 7);
    f.more = fcones_row(frustum, 8);
    return f;
}

// Narrows (from, to, face) to where g + gv t >= 0; a ray that enters there enters through `face`.
static fcones_vec3 fcones_half(fcones_vec3 span, float g, float gv, float face) {
    float t = gv != 0.0f ? -g / gv : 0.0f;
    if (gv > 0.0f && t > span.x) span = fcones_make_vec3(t, span.y, face);
    if (gv < 0.0f) span.y = fminf(span.y, t);
    if (gv == 0.0f && g < 0.0f) span.y = -1e30f;
    return span;
}

// Where a ray of the frame is between the cutting planes and inside a cone (radius at y = 0, its growth): from, to, and
// the face that it enters through, 0 the cone, 1 the lower plane, 2 the upper; nowhere if from > to. The quadratic is
// set up where the ray is nearest to the axis, its discriminant from the ray's moment about the axis, and solved in
// the form that does not cancel. There is no apex, so cylinders are nothing special, and no mirrored nappe.
static fcones_vec3 fcones_span(fcones_frustum f, fcones_vec2 cone, fcones_vec3 o, fcones_vec3 v, float t_min, float t_max) {
    float seam = 1e-6f * (f.extent.x + cone.x); // by so much neighbours overlap: rounding opens no gap
    fcones_vec3 span = fcones_make_vec3(t_min, t_max, 0.0f);
    span = fcones_half(span, o.y - f.lower.x * o.x - f.lower.y * o.z - f.lower.z + seam,
                        v.y - f.lower.x * v.x - f.lower.y * v.z, 1.0f);
    span = fcones_half(span, f.upper.x * o.x + f.upper.y * o.z + f.upper.z - o.y + seam,
                        f.upper.x * v.x + f.upper.y * v.z - v.y, 2.0f);
    float across = v.x * v.x + v.z * v.z;
    float at = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : span.x;
    at = fminf(fmaxf(at, span.x), span.y);
    float x = o.x + at * v.x, y = o.y + at * v.y, z = o.z + at * v.z, d = sqrtf(x * x + z * z);
    float radius = cone.x + cone.y * y, growth = cone.y * v.y, along = x * v.x + z * v.z;
    fcones_vec3 inside = fcones_half(fcones_make_vec3(span.x - at, span.y - at, span.z), radius, growth, 0.0f);
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
    if (first > inside.x) inside = fcones_make_vec3(first, inside.y, 0.0f);
    inside.y = fminf(inside.y, second);
    span = fcones_make_vec3(fmaxf(span.x, inside.x + at), fminf(span.y, inside.y + at), inside.z);
    return meets && inside.x <= inside.y ? span : fcones_make_vec3(1.0f, 0.0f, 0.0f);
}

typedef struct fcones_shell { // what bounds how fast the map's place changes along a ray
    float turning, nearest; // |x' z - x z'|; t where the ray is nearest to the axis
    float by_v, span; // v moves at by_v / span at most: see fcones_bound_speed
} fcones_shell;

// The angle turns at |x' z - x z'| / d^2. Both cuts y = a x + b z + c, weighted as v weights them, move at no more
// than |(n_lower, n_upper)| / (1 - k n) times |(x, z)'| + k |y'|, n the slopes; span is the least way between them.
static fcones_shell fcones_bound_speed(fcones_frustum f, fcones_vec3 o, fcones_vec3 v) {
    fcones_shell s;
    fcones_vec2 inner = fcones_make_vec2(f.radii.x, f.radii.y), outer = fcones_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
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

typedef struct fcones_uvw { // a place in a frustum, with what it was computed from
    float u, v, w;
    float d, sine, cosine, thickness; // distance from the axis, direction from it; of the shell there
    fcones_vec2 cone; // that of the shell that goes through the place
    float low, high; // y where its straight line there meets the cutting planes
} fcones_uvw;

// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its growth) in the
// direction in which the plane rises by `tilt`.
static float fcones_cut(fcones_vec4 plane, float tilt, fcones_vec2 cone, float base) {
    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0f - cone.y * tilt);
}

// The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. Within 1e-7.
static float fcones_turns(float x, float z) {
    float ax = fabsf(x), az = fabsf(z), large = fmaxf(ax, az), a = large > 0.0f ? fminf(ax, az) / large : 0.0f;
    float base = a > 0.414213562f ? 0.125f : 0.0f; // turned back by an eighth
    if (base > 0.0f) a = (a - 1.0f) / (a + 1.0f);
    float s = a * a;
    float turns = base + a * (0.15915485f + s * (-0.05303445f + s * (0.03131805f - s * 0.01766679f)));
    if (ax > az) turns = 0.25f - turns;
    if (z < 0.0f) turns = 0.5f - turns;
    return x < 0.0f ? 1.0f - turns : turns;
}

static fcones_uvw fcones_locate(fcones_frustum f, fcones_vec3 p) {
    fcones_uvw at;
    at.d = sqrtf(p.x * p.x + p.z * p.z);
    at.sine = at.d > 0.0f ? p.x / at.d : 0.0f;
    at.cosine = at.d > 0.0f ? p.z / at.d : 1.0f;
    at.thickness = f.radii.z + f.radii.w * p.y;
    at.w = at.d - (f.radii.x + f.radii.y * p.y);
    if (at.thickness > 0.0f) at.w = at.w / at.thickness;
    float w = at.thickness > 0.0f ? fminf(fmaxf(at.w, -0.5f), 1.5f) : 0.0f;
    at.cone = fcones_make_vec2(f.radii.x + w * f.radii.z, f.radii.y + w * f.radii.w);
    at.low = fcones_cut(f.lower, f.lower.x * at.sine + f.lower.y * at.cosine, at.cone, 0.0f);
    at.high = fcones_cut(f.upper, f.upper.x * at.sine + f.upper.y * at.cosine, at.cone, 0.0f);
    at.v = at.high != at.low ? (p.y - at.low) / (at.high - at.low) : 0.0f;
    at.u = fcones_turns(p.x, p.z);
    return at;
}

static fcones_vec3 fcones_along(fcones_vec3 o, fcones_vec3 v, float t) {
    return fcones_make_vec3(o.x + t * v.x, o.y + t * v.y, o.z + t * v.z);
}

// The map's u and v, not wrapped.
static fcones_vec2 fcones_map_place(fcones_frustum f, float u, float v) {
    float clamped = fminf(fmaxf(v, 0.0f), 1.0f);
    return fcones_make_vec2((u + clamped * f.extent.w) * (float)(f.more.y), f.extent.y + clamped * f.extent.z);
}

// The same in texels, from the centre of texel (0, 0).
static fcones_vec2 fcones_texels(fcones_frustum f, float u, float v) {
    fcones_vec2 at = fcones_map_place(f, u, v);
    at.y -= floorf(at.y);
    return fcones_make_vec2((at.x - floorf(at.x)) * 64.0f - 0.5f, at.y * 48.0f - 0.5f);
}

static int fcones_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static fcones_vec2 fcones_texel(int i, int j) {
    return fcones_fetch(fcones_repeat(i, 64), fcones_repeat(j, 48));
}

static float fcones_mix(fcones_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height of the relief, and tangent of the cone there.
static fcones_vec2 fcones_relief(fcones_frustum f, float u, float v) {
    fcones_vec2 at = fcones_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y)), si = 1, sj = 1;
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    fcones_vec2 a = fcones_texel(i, j), b = fcones_texel(i + si, j);
    fcones_vec2 c = fcones_texel(i, j + sj), d = fcones_texel(i + si, j + sj);
    fcones_vec4 heights = fcones_make_vec4(a.x, b.x, c.x, d.x);
    float height = fcones_mix(heights, x, y);
    float cone = fcones_mix(fcones_make_vec4(a.y, b.y, c.y, d.y), x, y);
    return fcones_make_vec2(height, cone);
}

// How fast the map's place changes at most, from t to t_end.
static float fcones_map_speed(fcones_frustum f, fcones_shell s, fcones_vec3 o, fcones_vec3 v, float t, float t_end) {
    fcones_vec3 p = fcones_along(o, v, fminf(fmaxf(s.nearest, t), t_end));
    float d2 = p.x * p.x + p.z * p.z;
    float angle = s.turning / fmaxf(d2, 1e-30f), by_v = s.by_v / s.span;
    float by_u = (angle * 0.159154943f + by_v * fabsf(f.extent.w)) * (float)(f.more.y);
    by_v *= fabsf(f.extent.z) * 7.5e-1f;
    return s.span > 0.0f && d2 > 0.0f ? sqrtf(by_u * by_u + by_v * by_v) : 1e30f;
}

// How far the ray is above the relief at t, in heights.
static float fcones_above(fcones_frustum f, fcones_vec3 o, fcones_vec3 v, float t) {
    fcones_uvw at = fcones_locate(f, fcones_along(o, v, t));
    return at.w - fcones_relief(f, at.u, at.v).x;
}

// Cone steps, none shorter than one of 256 equal ones, then halvings: t where the ray meets the relief in a range
// of t, at its end if `solid`; 1e30: it does not. The ray is g above the cone's apex, in the world's units, and
// meets nothing while g + g' t > thickness speed t / tangent.
static float fcones_march(fcones_frustum f, fcones_vec3 o, fcones_vec3 v, fcones_vec2 range, bool solid) {
    float before = range.x, t = range.x;
    bool met = false;
    float least = (range.y - range.x) / (float)(256);
    float thick_end = f.radii.z + f.radii.w * (o.y + range.y * v.y);
    fcones_shell shell = fcones_bound_speed(f, o, v);
    for (int k = 0; k <= 256; ++k) {
        fcones_uvw at = fcones_locate(f, fcones_along(o, v, t));
        fcones_vec2 relief = fcones_relief(f, at.u, at.v);
        met = at.w <= relief.x || (solid && t >= range.y);
        if (met || t >= range.y) break;
        float apex = relief.x + 1.0f / 1048576.0f, g = (at.w - apex) * at.thickness;
        float slope = at.sine * v.x + at.cosine * v.z - (f.radii.y + f.radii.w * apex) * v.y;
        float closing = fmaxf(at.thickness, thick_end) * fcones_map_speed(f, shell, o, v, t, range.y);
        closing -= relief.y * slope;
        before = t;
        t += fmaxf(g <= 0.0f ? 0.0f : closing > 0.0f ? relief.y * g / closing : 1e30f, least);
        if (t > range.y || k + 1 >= 256) t = range.y;
    }
    for (int n = 0; met && n < 10; ++n) {
        float middle = 0.5f * (before + t);
        bool over = fcones_above(f, o, v, middle) > 0.0f;
        before = over ? middle : before;
        t = over ? t : middle;
    }
    return met ? t : 1e30f;
}

// t where a ray of the frame meets the frustum's relief, 1e30 where it does not, and the face; see fcones_span.
static fcones_vec2 fcones_meet(fcones_frustum f, fcones_vec3 o, fcones_vec3 v, float t_min, float t_max) {
    fcones_vec3 inner = fcones_span(f, fcones_make_vec2(f.radii.x, f.radii.y), o, v, t_min, t_max), outer = inner;
    bool solid = inner.x <= inner.y, shell = f.radii.z > 0.0f || f.radii.w > 0.0f;
    if (shell) outer = fcones_span(f, fcones_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, t_min, t_max);
    if (solid && outer.x > outer.y) outer = inner; // by rounding, where there is no shell
    float t = outer.x <= outer.y ? outer.x : 1e30f;
    if (shell && outer.x <= outer.y)
        t = fcones_march(f, o, v, fcones_make_vec2(outer.x, solid ? fmaxf(inner.x, outer.x) : outer.y), solid);
    return fcones_make_vec2(t, t > outer.x ? 0.0f : outer.z);
}

// A direction of the world in the frustum's frame.
static fcones_vec3 fcones_into(fcones_frustum f, fcones_vec3 d) {
    return fcones_make_vec3(f.axis_x.x * d.x + f.axis_x.y * d.y + f.axis_x.z * d.z,
                f.axis_y.x * d.x + f.axis_y.y * d.y + f.axis_y.z * d.z,
                f.axis_z.x * d.x + f.axis_z.y * d.y + f.axis_z.z * d.z);
}

static fcones_vec3 fcones_place_into(fcones_frustum f, fcones_vec3 p) {
    return fcones_into(f, fcones_make_vec3(p.x - f.axis_x.w, p.y - f.axis_y.w, p.z - f.axis_z.w));
}

typedef struct fcones_normals { // in the world, units
    fcones_vec3 shading, plain; // continuous across joints; of the surface as it is
    float away; // how far the place is outside the surface, in the world's units
} fcones_normals;

static fcones_vec3 fcones_unit(fcones_vec3 n) {
    float by = sqrtf(n.x * n.x + n.y * n.y + n.z * n.z);
    by = by > 0.0f ? 1.0f / by : 0.0f;
    return fcones_make_vec3(n.x * by, n.y * by, n.z * by);
}

// The surface normal at a cut [BJCW09 eq. 8]: away from the joint, leaning back along the plane's own normal.
static fcones_vec3 fcones_end_normal(fcones_frustum f, fcones_vec4 plane, fcones_uvw at, float joint) {
    float y = fcones_cut(plane, plane.x * at.sine + plane.y * at.cosine, at.cone, joint);
    float radius = at.cone.x + at.cone.y * joint + at.cone.y * y;
    float wide_x = f.axis_x.x * f.axis_x.x + f.axis_x.y * f.axis_x.y + f.axis_x.z * f.axis_x.z; // 1 if round
    float wide_z = f.axis_z.x * f.axis_z.x + f.axis_z.y * f.axis_z.y + f.axis_z.z * f.axis_z.z;
    y += radius * (plane.x * at.sine * (wide_x - 1.0f) + plane.y * at.cosine * (wide_z - 1.0f));
    if (!(radius > 1e-6f * (f.radii.x + f.radii.z + f.extent.x))) { // the end is a point: the limit
        radius = 1.0f;
        y = 0.0f;
    }
    float across = at.sine * at.sine * wide_x + at.cosine * at.cosine * wide_z;
    float size = sqrtf(radius * radius * across + y * y);
    float lean = plane.w * size / sqrtf(1.0f + plane.x * plane.x * wide_x + plane.y * plane.y * wide_z);
    return fcones_unit(fcones_make_vec3(radius * at.sine + lean * plane.x, y - lean, radius * at.cosine + lean * plane.y));
}

// Height of the relief, and what it grows by per turn of u and per v of the frustum.
static fcones_vec3 fcones_slopes(fcones_frustum f, float u, float v) {
    fcones_vec2 at = fcones_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y));
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    float a = fcones_texel(i, j).x, b = fcones_texel(i + 1, j).x;
    float c = fcones_texel(i, j + 1).x, d = fcones_texel(i + 1, j + 1).x;
    float low = b - a, high = d - c, by_u = (low + (high - low) * y) * 64.0f * (float)(f.more.y);
    float by_v = (c - a + (d - c - b + a) * x) * 48.0f * f.extent.z;
    return fcones_make_vec3(a + low * x + (c - a + (high - low) * x) * y, by_u, by_v + by_u * f.extent.w);
}

// Gradient, times the thickness, of a cut's y: it moves with the angle and with w.
static fcones_vec3 fcones_cut_gradient(fcones_frustum f, fcones_vec4 plane, fcones_uvw at, float y, fcones_vec3 angle, fcones_vec3 w) {
    float tilt = plane.x * at.sine + plane.y * at.cosine, rest = 1.0f - at.cone.y * tilt;
    float a = (at.cone.x + at.cone.y * plane.z) / (rest * rest) * (plane.x * at.cosine - plane.y * at.sine);
    float b = at.thickness > 0.0f ? tilt * (f.radii.z + f.radii.w * y) / rest : 0.0f;
    return fcones_make_vec3(a * angle.x + b * w.x, a * angle.y + b * w.y, a * angle.z + b * w.z);
}

// A gradient of the frame in the world's; with the axes divided by their lengths twice, a direction.
static fcones_vec3 fcones_out_of(fcones_frustum f, fcones_vec3 n) {
    return fcones_make_vec3(f.axis_x.x * n.x + f.axis_y.x * n.y + f.axis_z.x * n.z,
                f.axis_x.y * n.x + f.axis_y.y * n.y + f.axis_z.y * n.z,
                f.axis_x.z * n.x + f.axis_y.z * n.y + f.axis_z.z * n.z);
}

static fcones_normals fcones_find_normals(fcones_frustum f, fcones_uvw at) {
    fcones_vec3 low = fcones_end_normal(f, f.lower, at, 0.0f), high = fcones_end_normal(f, f.upper, at, f.extent.x);
    float m = fminf(fmaxf(at.v, 0.0f), 1.0f), l = 1.0f, height = 0.0f;
    if ((f.more.x & 32) != 0) m = m * m * (3.0f - 2.0f * m); // C1
    l = 1.0f - m;
    fcones_vec3 smoothed = fcones_unit(fcones_make_vec3(l * low.x + m * high.x, l * low.y + m * high.y, l * low.z + m * high.z));
    fcones_vec3 grad_w = fcones_make_vec3(at.sine, -at.cone.y, at.cosine); // all gradients times the thickness
    float steep = sqrtf(1.0f + at.cone.y * at.cone.y);
    smoothed = fcones_make_vec3(smoothed.x * steep, smoothed.y * steep, smoothed.z * steep);
    if (at.thickness > 0.0f && at.d > 1e-6f * f.extent.x) { // the relief's slopes
        float by_d = at.thickness / at.d, span = at.high - at.low;
        fcones_vec3 angle = fcones_make_vec3(at.cosine * by_d, 0.0f, -at.sine * by_d), slopes = fcones_slopes(f, at.u, at.v);
        fcones_vec3 a = fcones_cut_gradient(f, f.lower, at, at.low, angle, grad_w);
        fcones_vec3 b = fcones_cut_gradient(f, f.upper, at, at.high, angle, grad_w);
        float by_u = slopes.y * 0.159154943f, by_v = slopes.z / span, rest = 1.0f - at.v;
        fcones_vec3 s = fcones_make_vec3(by_u * angle.x - by_v * (rest * a.x + at.v * b.x),
                      by_v * (at.thickness - rest * a.y - at.v * b.y),
                      by_u * angle.z - by_v * (rest * a.z + at.v * b.z));
        grad_w = fcones_make_vec3(grad_w.x - s.x, grad_w.y - s.y, grad_w.z - s.z);
        smoothed = fcones_make_vec3(smoothed.x - s.x, smoothed.y - s.y, smoothed.z - s.z);
        height = slopes.x;
    }
    fcones_normals n;
    n.shading = fcones_unit(fcones_out_of(f, smoothed));
    n.plain = fcones_unit(fcones_out_of(f, grad_w));
    n.away = at.thickness > 0.0f ? (at.w - height) * at.thickness : at.w;
    return n;
}

static fcones_vec3 fcones_place_out_of(fcones_frustum f, fcones_vec3 p) {
    fcones_vec4 x = f.axis_x, y = f.axis_y, z = f.axis_z;
    fcones_vec3 d = fcones_out_of(f, fcones_make_vec3(p.x / (x.x * x.x + x.y * x.y + x.z * x.z),
                                    p.y / (y.x * y.x + y.y * y.y + y.z * y.z),
                                    p.z / (z.x * z.x + z.y * z.y + z.z * z.z)));
    return fcones_make_vec3(x.w + d.x, y.w + d.y, z.w + d.z);
}

// The frustum of a chain that a place is beside, a few up or down from `frustum`.
static int fcones_row_beside(int frustum, fcones_vec3 place) {
    for (int k = 0; k < 4; ++k) {
        fcones_frustum f = fcones_load(frustum);
        fcones_vec3 p = fcones_place_into(f, place);
        int next = -1;
        if (p.y < f.lower.x * p.x + f.lower.y * p.z + f.lower.z && (f.more.x & 2) == 0) next = f.links.x;
        if (p.y > f.upper.x * p.x + f.upper.y * p.z + f.upper.z && f.links.y >= 0) next = f.links.y;
        if (next < 0) break;
        frustum = next;
    }
    return frustum;
}

// Adds the normal of a frustum that comes near a place of the world: all of it where the place lies on it, nothing from
// `reach` away. `branch`: it begins inside another one, and counts only above its foot.
static fcones_vec3 fcones_mix_normal(int frustum, fcones_vec3 place, float reach, bool branch, fcones_vec3 sum) {
    fcones_frustum f = fcones_load(frustum);
    fcones_vec3 p = fcones_place_into(f, place);
    float weight = branch ? fminf(fmaxf(4.0f * p.y / (f.radii.x + f.radii.z), 0.0f), 1.0f) : 1.0f;
    if (weight > 0.0f && p.y <= f.extent.x + reach && p.y >= -reach - f.extent.x) {
        fcones_normals n = fcones_find_normals(f, fcones_locate(f, p));
        float near_by = fminf(fmaxf(1.0f - n.away / reach, 0.0f), 1.0f);
        weight *= near_by * near_by * (3.0f - 2.0f * near_by);
        sum = fcones_make_vec3(sum.x + weight * n.shading.x, sum.y + weight * n.shading.y, sum.z + weight * n.shading.z);
    }
    return sum;
}

// Mixes in the branches that leave a frustum's top, but not `except`.
static fcones_vec3 fcones_mix_branches(int first, int except, fcones_vec3 place, fcones_vec3 sum) {
    int branch = first;
    for (int k = 0; k < 64 && branch >= 0; ++k) {
        fcones_vec4 radii = fcones_real4(fcones_row(branch, 5));
        if (branch != except) {
            int beside = fcones_row_beside(branch, place);
            sum = fcones_mix_normal(beside, place, 6.99999988e-1f * (radii.x + radii.z), beside == branch, sum);
        }
        branch = fcones_row(branch, 7).w;
    }
    return sum;
}

// Where branches leave a chain, the normals of the surfaces that meet there are mixed: those of the branches that leave
// the frustum's own chain nearby, and if that chain is itself a branch, of the chain it leaves and its other branches.
static fcones_vec3 fcones_blend(int frustum, fcones_vec3 place, fcones_vec3 normal) {
    int at = fcones_row(frustum, 7).y;
    for (int up = 1; up < 4 && at >= 0; ++up) {
        fcones_ivec4 links = fcones_row(at, 7);
        normal = fcones_mix_branches(links.z, -1, place, normal);
        at = links.y;
    }
    at = frustum;
    for (int down = 0; down < 4 && at >= 0; ++down) {
        fcones_ivec4 links = fcones_row(at, 7);
        normal = fcones_mix_branches(links.z, -1, place, normal);
        if ((fcones_row(at, 8).x & 2) != 0) { // a branch
            fcones_vec4 radii = fcones_real4(fcones_row(at, 5));
            int beside = fcones_row_beside(links.x, place);
            normal = fcones_mix_normal(beside, place, 6.99999988e-1f * (radii.x + radii.z), false, normal);
            normal = fcones_mix_branches(fcones_row(links.x, 7).z, at, place, normal);
            links.x = -1;
        }
        at = links.x;
    }
    return fcones_unit(normal);
}

// All about a place where a ray of the frame meets a frustum.
static fcones_frustum_hit fcones_surface(fcones_frustum f, int frustum, fcones_vec3 p, int face) {
    fcones_frustum_hit hit;
    fcones_uvw at = fcones_locate(f, p);
    fcones_normals n = fcones_find_normals(f, at);
    int free_ends = face == 1 ? 1 + 2 + 8 : face == 2 ? 4 + 16 : 0;
    hit.found = true;
    hit.inside = false;
    hit.frustum = frustum;
    hit.user = f.more.z;
    hit.cap = (f.more.x & free_ends) != 0 ? face : 0; // elsewhere a plane that shows is the rounding of a seam
    hit.t = 0.0f;
    hit.position = fcones_place_out_of(f, p);
    hit.uvw = fcones_make_vec3(at.u, fminf(fmaxf(at.v, 0.0f), 1.0f), at.w);
    hit.map = fcones_map_place(f, at.u, at.v);
    hit.normal = n.shading;
    hit.true_normal = n.plain;
    if (hit.cap != 0) {
        fcones_vec4 lower = f.lower, upper = f.upper;
        fcones_vec3 flat_end = face == 1 ? fcones_make_vec3(lower.x, -1.0f, lower.y) : fcones_make_vec3(-upper.x, 1.0f, -upper.y);
        hit.normal = fcones_unit(fcones_out_of(f, flat_end));
        hit.true_normal = hit.normal;
    }
    if (hit.cap == 0) hit.normal = fcones_blend(frustum, hit.position, hit.normal);
    return hit;
}

// The first hit of a ray of the world with `count` frusta from `first`.
static fcones_frustum_hit fcones_trace_frusta(int first, int count, fcones_vec3 origin, fcones_vec3 direction, float t_min,
                                           float t_max) {
    fcones_frustum_hit hit = fcones_no_frustum(t_max);
    float t = t_max;
    int nearest = -1, face = 0;
    for (int k = first; k < first + count; ++k) {
        fcones_frustum f = fcones_load(k);
        fcones_vec2 met = fcones_meet(f, fcones_place_into(f, origin), fcones_into(f, direction), t_min, t);
        if (met.x < t || (nearest < 0 && met.x <= t)) {
            t = met.x;
            nearest = k;
            face = (int)(met.y);
        }
    }
    if (nearest >= 0) {
        fcones_frustum f = fcones_load(nearest);
        fcones_vec3 p = fcones_along(fcones_place_into(f, origin), fcones_into(f, direction), t);
        hit = fcones_surface(f, nearest, p, face);
        hit.t = t;
        hit.inside = t <= t_min;
    }
    return hit;
}

// What a pixel sees of a frustum whose bounds were drawn there: `place` of the frame, from fcones_bounds; eye as
// fcones_eye, (position, 1) or for parallel rays (direction, 0). Rays begin at the bounds, not at the eye: single
// precision then holds however far the eye is.
static fcones_frustum_hit fcones_see_frustum(int frustum, fcones_vec3 place, fcones_vec4 eye) {
    fcones_frustum f = fcones_load(frustum);
    fcones_frustum_hit hit = fcones_no_frustum(0.0f);
    fcones_vec3 v = fcones_into(f, fcones_make_vec3(eye.x, eye.y, eye.z));
    float back = 1e30f; // how far the ray begins before the place
    if (eye.w != 0.0f) {
        fcones_vec3 from = fcones_place_into(f, fcones_make_vec3(eye.x, eye.y, eye.z));
        v = fcones_make_vec3(place.x - from.x, place.y - from.y, place.z - from.z);
        back = sqrtf(v.x * v.x + v.y * v.y + v.z * v.z);
    }
    v = fcones_unit(v);
    fcones_vec2 met = fcones_meet(f, place, v, -back, 1e30f);
    if (met.x < 1e30f) {
        hit = fcones_surface(f, frustum, fcones_along(place, v, met.x), (int)(met.y));
        fcones_vec3 way = fcones_make_vec3(hit.position.x - eye.x, hit.position.y - eye.y, hit.position.z - eye.z);
        hit.t = eye.w != 0.0f ? sqrtf(way.x * way.x + way.y * way.y + way.z * way.z) : met.x;
        hit.inside = met.x <= -back;
    }
    return hit;
}

// Corner 0..7 of the pyramid around the shell, cut by the planes, in the frame.
static fcones_vec3 fcones_corner(fcones_frustum f, int corner) {
    float sx = (corner & 3) == 1 || (corner & 3) == 2 ? 1.0f : -1.0f, sz = (corner & 3) >= 2 ? 1.0f : -1.0f;
    fcones_vec2 cone = fcones_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float low = fcones_cut(f.lower, f.lower.x * sx + f.lower.y * sz, cone, 0.0f);
    float y = corner < 4 ? low : fcones_cut(f.upper, f.upper.x * sx + f.upper.y * sz, cone, 0.0f);
    float reach = fmaxf(cone.x + cone.y * y, 0.0f);
    return fcones_make_vec3(sx * reach, y, sz * reach);
}

// Vertex 0..35 of the twelve triangles around a frustum's shell, in its frame; see fcones_frustum_triangles.
static fcones_vec3 fcones_bounds(int frustum, int number) {
    static const int corners[36] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, 1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0};
    return fcones_corner(fcones_load(frustum), corners[number]);
}

