// conemap.h: frusta with relief, by equal steps.
// fsteps_rows: the host's: row 0..8 of a conemap_frustum, as four integers
// fsteps_fetch: the host's; height
#include <math.h>
#include <stdbool.h>


typedef struct fsteps_ivec4 {
    int x, y, z, w;
} fsteps_ivec4;

fsteps_ivec4 fsteps_rows(int frustum, int row);
float fsteps_fetch(int i, int j);

typedef struct fsteps_vec3 {
    float x, y, z;
} fsteps_vec3;

typedef struct fsteps_vec2 {
    float x, y;
} fsteps_vec2;

typedef struct fsteps_frustum_hit {
    bool found;
    bool inside; // the ray began inside
    int frustum, user; // that was hit; its `user`
    int cap; // 1, 2: the flat lower, upper end of a segment
    float t; // in lengths of the direction
    fsteps_vec3 position;
    fsteps_vec3 uvw; // of the frustum; v 0..1, w the height in the shell
    fsteps_vec2 map; // u and v of the map, not wrapped
    fsteps_vec3 normal, true_normal; // units: for shading, continuous across joints; of the surface as it is
} fsteps_frustum_hit;

static fsteps_vec3 fsteps_make_vec3(float x, float y, float z) {
    fsteps_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static fsteps_vec2 fsteps_make_vec2(float x, float y) {
    fsteps_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static fsteps_frustum_hit fsteps_no_frustum(float t) {
    fsteps_frustum_hit hit;
    hit.found = false;
    hit.inside = false;
    hit.frustum = -1;
    hit.user = 0;
    hit.cap = 0;
    hit.t = t;
    hit.position = fsteps_make_vec3(0.0f, 0.0f, 0.0f);
    hit.uvw = hit.position;
    hit.map = fsteps_make_vec2(0.0f, 0.0f);
    hit.normal = hit.position;
    hit.true_normal = hit.position;
    return hit;
}

typedef struct fsteps_vec4 {
    float x, y, z, w;
} fsteps_vec4;

typedef struct fsteps_frustum {
    fsteps_vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates
    fsteps_vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there
    fsteps_vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth
    fsteps_vec4 extent; // length of the axis; start and size in the map's v; twist
    fsteps_ivec4 links; // parent, child, branch, sibling
    fsteps_ivec4 more; // flags, u_repeat, user
} fsteps_frustum;

static fsteps_vec4 fsteps_make_vec4(float x, float y, float z, float w) {
    fsteps_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float fsteps_real(int bits) {
    union {
        int whole;
        float real;
    } both;
    both.whole = bits;
    return both.real;
}

static fsteps_vec4 fsteps_real4(fsteps_ivec4 bits) {
    return fsteps_make_vec4(fsteps_real(bits.x), fsteps_real(bits.y), fsteps_real(bits.z), fsteps_real(bits.w));
}

// One of a frustum's nine rows, as integers: as floats, a unit could flush its small ones to 0.
static fsteps_ivec4 fsteps_row(int frustum, int row) {
    return fsteps_rows(frustum, row);
}

static fsteps_frustum fsteps_load(int frustum) {
    fsteps_frustum f;
    f.axis_x = fsteps_real4(fsteps_row(frustum, 0));
    f.axis_y = fsteps_real4(fsteps_row(frustum, 1));
    f.axis_z = fsteps_real4(fsteps_row(frustum, 2));
    f.lower = fsteps_real4(fsteps_row(frustum, 3));
    f.upper = fsteps_real4(fsteps_row(frustum, 4));
    f.radii = fsteps_real4(fsteps_row(frustum, 5));
    f.extent = fsteps_real4(fsteps_row(frustum, 6));
    f.links = fsteps_row(frustum, 7);
    f.more = fsteps_row(frustum, 8);
    return f;
}

// Narrows (from, to, face) to where g + gv t >= 0; a ray that enters there enters through `face`.
static fsteps_vec3 fsteps_half(fsteps_vec3 span, float g, float gv, float face) {
    float t = gv != 0.0f ? -g / gv : 0.0f;
    if (gv > 0.0f && t > span.x) span = fsteps_make_vec3(t, span.y, face);
    if (gv < 0.0f) span.y = fminf(span.y, t);
    if (gv == 0.0f && g < 0.0f) span.y = -1e30f;
    return span;
}

// Where a ray of the frame is between the cutting planes and inside a cone (radius at y = 0, its growth): from, to, and
// the face that it enters through, 0 the cone, 1 the lower plane, 2 the upper; nowhere if from > to. The quadratic is
// set up where the ray is nearest to the axis, its discriminant from the ray's moment about the axis, and solved in
// the form that does not cancel. There is no apex, so cylinders are nothing special, and no mirrored nappe.
static fsteps_vec3 fsteps_span(fsteps_frustum f, fsteps_vec2 cone, fsteps_vec3 o, fsteps_vec3 v, float t_min, float t_max) {
    float seam = 1e-6f * (f.extent.x + cone.x); // by so much neighbours overlap: rounding opens no gap
    fsteps_vec3 span = fsteps_make_vec3(t_min, t_max, 0.0f);
    span = fsteps_half(span, o.y - f.lower.x * o.x - f.lower.y * o.z - f.lower.z + seam,
                        v.y - f.lower.x * v.x - f.lower.y * v.z, 1.0f);
    span = fsteps_half(span, f.upper.x * o.x + f.upper.y * o.z + f.upper.z - o.y + seam,
                        f.upper.x * v.x + f.upper.y * v.z - v.y, 2.0f);
    float across = v.x * v.x + v.z * v.z;
    float at = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : span.x;
    at = fminf(fmaxf(at, span.x), span.y);
    float x = o.x + at * v.x, y = o.y + at * v.y, z = o.z + at * v.z, d = sqrtf(x * x + z * z);
    float radius = cone.x + cone.y * y, growth = cone.y * v.y, along = x * v.x + z * v.z;
    fsteps_vec3 inside = fsteps_half(fsteps_make_vec3(span.x - at, span.y - at, span.z), radius, growth, 0.0f);
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
    if (first > inside.x) inside = fsteps_make_vec3(first, inside.y, 0.0f);
    inside.y = fminf(inside.y, second);
    span = fsteps_make_vec3(fmaxf(span.x, inside.x + at), fminf(span.y, inside.y + at), inside.z);
    return meets && inside.x <= inside.y ? span : fsteps_make_vec3(1.0f, 0.0f, 0.0f);
}

typedef struct fsteps_uvw { // a place in a frustum, with what it was computed from
    float u, v, w;
    float d, sine, cosine, thickness; // distance from the axis, direction from it; of the shell there
    fsteps_vec2 cone; // that of the shell that goes through the place
    float low, high; // y where its straight line there meets the cutting planes
} fsteps_uvw;

// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its growth) in the
// direction in which the plane rises by `tilt`.
static float fsteps_cut(fsteps_vec4 plane, float tilt, fsteps_vec2 cone, float base) {
    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0f - cone.y * tilt);
}

// The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. Within 1e-7.
static float fsteps_turns(float x, float z) {
    float ax = fabsf(x), az = fabsf(z), large = fmaxf(ax, az), a = large > 0.0f ? fminf(ax, az) / large : 0.0f;
    float base = a > 0.414213562f ? 0.125f : 0.0f; // turned back by an eighth
    if (base > 0.0f) a = (a - 1.0f) / (a + 1.0f);
    float s = a * a;
    float turns = base + a * (0.15915485f + s * (-0.05303445f + s * (0.03131805f - s * 0.01766679f)));
    if (ax > az) turns = 0.25f - turns;
    if (z < 0.0f) turns = 0.5f - turns;
    return x < 0.0f ? 1.0f - turns : turns;
}

static fsteps_uvw fsteps_locate(fsteps_frustum f, fsteps_vec3 p) {
    fsteps_uvw at;
    at.d = sqrtf(p.x * p.x + p.z * p.z);
    at.sine = at.d > 0.0f ? p.x / at.d : 0.0f;
    at.cosine = at.d > 0.0f ? p.z / at.d : 1.0f;
    at.thickness = f.radii.z + f.radii.w * p.y;
    at.w = at.d - (f.radii.x + f.radii.y * p.y);
    if (at.thickness > 0.0f) at.w = at.w / at.thickness;
    float w = at.thickness > 0.0f ? fminf(fmaxf(at.w, -0.5f), 1.5f) : 0.0f;
    at.cone = fsteps_make_vec2(f.radii.x + w * f.radii.z, f.radii.y + w * f.radii.w);
    at.low = fsteps_cut(f.lower, f.lower.x * at.sine + f.lower.y * at.cosine, at.cone, 0.0f);
    at.high = fsteps_cut(f.upper, f.upper.x * at.sine + f.upper.y * at.cosine, at.cone, 0.0f);
    at.v = at.high != at.low ? (p.y - at.low) / (at.high - at.low) : 0.0f;
    at.u = fsteps_turns(p.x, p.z);
    return at;
}

static fsteps_vec3 fsteps_along(fsteps_vec3 o, fsteps_vec3 v, float t) {
    return fsteps_make_vec3(o.x + t * v.x, o.y + t * v.y, o.z + t * v.z);
}

// The map's u and v, not wrapped.
static fsteps_vec2 fsteps_map_place(fsteps_frustum f, float u, float v) {
    float clamped = fminf(fmaxf(v, 0.0f), 1.0f);
    return fsteps_make_vec2((u + clamped * f.extent.w) * (float)(f.more.y), f.extent.y + clamped * f.extent.z);
}

// The same in texels, from the centre of texel (0, 0).
static fsteps_vec2 fsteps_texels(fsteps_frustum f, float u, float v) {
    fsteps_vec2 at = fsteps_map_place(f, u, v);
    at.y -= floorf(at.y);
    return fsteps_make_vec2((at.x - floorf(at.x)) * 64.0f - 0.5f, at.y * 48.0f - 0.5f);
}

static int fsteps_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static float fsteps_texel(int i, int j) {
    return fsteps_fetch(fsteps_repeat(i, 64), fsteps_repeat(j, 48));
}

static float fsteps_mix(fsteps_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height of the relief.
static float fsteps_relief(fsteps_frustum f, float u, float v) {
    fsteps_vec2 at = fsteps_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y)), si = 1, sj = 1;
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    fsteps_vec4 heights = fsteps_make_vec4(fsteps_texel(i, j), fsteps_texel(i + si, j),
                        fsteps_texel(i, j + sj), fsteps_texel(i + si, j + sj));
    float height = fsteps_mix(heights, x, y);
    return height;
}

// How far the ray is above the relief at t, in heights.
static float fsteps_above(fsteps_frustum f, fsteps_vec3 o, fsteps_vec3 v, float t) {
    fsteps_uvw at = fsteps_locate(f, fsteps_along(o, v, t));
    return at.w - fsteps_relief(f, at.u, at.v);
}

// Equal steps, then halvings [BJCW09 section 3]: t where the ray meets the relief in a range of t, at its end if
// `solid`; 1e30: it does not.
static float fsteps_march(fsteps_frustum f, fsteps_vec3 o, fsteps_vec3 v, fsteps_vec2 range, bool solid) {
    float before = range.x, t = range.x;
    bool met = false;
    for (int k = 0; k <= 64; ++k) {
        t = k < 64 ? range.x + (range.y - range.x) * ((float)(k) / (float)(64)) : range.y;
        met = (solid && k == 64) || fsteps_above(f, o, v, t) <= 0.0f;
        if (met) break;
        before = t;
    }
    for (int n = 0; met && n < 10; ++n) {
        float middle = 0.5f * (before + t);
        bool over = fsteps_above(f, o, v, middle) > 0.0f;
        before = over ? middle : before;
        t = over ? t : middle;
    }
    return met ? t : 1e30f;
}

// t where a ray of the frame meets the frustum's relief, 1e30 where it does not, and the face; see fsteps_span.
static fsteps_vec2 fsteps_meet(fsteps_frustum f, fsteps_vec3 o, fsteps_vec3 v, float t_min, float t_max) {
    fsteps_vec3 inner = fsteps_span(f, fsteps_make_vec2(f.radii.x, f.radii.y), o, v, t_min, t_max), outer = inner;
    bool solid = inner.x <= inner.y, shell = f.radii.z > 0.0f || f.radii.w > 0.0f;
    if (shell) outer = fsteps_span(f, fsteps_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, t_min, t_max);
    if (solid && outer.x > outer.y) outer = inner; // by rounding, where there is no shell
    float t = outer.x <= outer.y ? outer.x : 1e30f;
    if (shell && outer.x <= outer.y)
        t = fsteps_march(f, o, v, fsteps_make_vec2(outer.x, solid ? fmaxf(inner.x, outer.x) : outer.y), solid);
    return fsteps_make_vec2(t, t > outer.x ? 0.0f : outer.z);
}

// A direction of the world in the frustum's frame.
static fsteps_vec3 fsteps_into(fsteps_frustum f, fsteps_vec3 d) {
    return fsteps_make_vec3(f.axis_x.x * d.x + f.axis_x.y * d.y + f.axis_x.z * d.z,
                f.axis_y.x * d.x + f.axis_y.y * d.y + f.axis_y.z * d.z,
                f.axis_z.x * d.x + f.axis_z.y * d.y + f.axis_z.z * d.z);
}

static fsteps_vec3 fsteps_place_into(fsteps_frustum f, fsteps_vec3 p) {
    return fsteps_into(f, fsteps_make_vec3(p.x - f.axis_x.w, p.y - f.axis_y.w, p.z - f.axis_z.w));
}

typedef struct fsteps_normals { // in the world, units
    fsteps_vec3 shading, plain; // continuous across joints; of the surface as it is
    float away; // how far the place is outside the surface, in the world's units
} fsteps_normals;

static fsteps_vec3 fsteps_unit(fsteps_vec3 n) {
    float by = sqrtf(n.x * n.x + n.y * n.y + n.z * n.z);
    by = by > 0.0f ? 1.0f / by : 0.0f;
    return fsteps_make_vec3(n.x * by, n.y * by, n.z * by);
}

// The surface normal at a cut [BJCW09 eq. 8]: away from the joint, leaning back along the plane's own normal.
static fsteps_vec3 fsteps_end_normal(fsteps_frustum f, fsteps_vec4 plane, fsteps_uvw at, float joint) {
    float y = fsteps_cut(plane, plane.x * at.sine + plane.y * at.cosine, at.cone, joint);
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
    return fsteps_unit(fsteps_make_vec3(radius * at.sine + lean * plane.x, y - lean, radius * at.cosine + lean * plane.y));
}

// Height of the relief, and what it grows by per turn of u and per v of the frustum.
static fsteps_vec3 fsteps_slopes(fsteps_frustum f, float u, float v) {
    fsteps_vec2 at = fsteps_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y));
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    float a = fsteps_texel(i, j), b = fsteps_texel(i + 1, j);
    float c = fsteps_texel(i, j + 1), d = fsteps_texel(i + 1, j + 1);
    float low = b - a, high = d - c, by_u = (low + (high - low) * y) * 64.0f * (float)(f.more.y);
    float by_v = (c - a + (d - c - b + a) * x) * 48.0f * f.extent.z;
    return fsteps_make_vec3(a + low * x + (c - a + (high - low) * x) * y, by_u, by_v + by_u * f.extent.w);
}

// Gradient, times the thickness, of a cut's y: it moves with the angle and with w.
static fsteps_vec3 fsteps_cut_gradient(fsteps_frustum f, fsteps_vec4 plane, fsteps_uvw at, float y, fsteps_vec3 angle, fsteps_vec3 w) {
    float tilt = plane.x * at.sine + plane.y * at.cosine, rest = 1.0f - at.cone.y * tilt;
    float a = (at.cone.x + at.cone.y * plane.z) / (rest * rest) * (plane.x * at.cosine - plane.y * at.sine);
    float b = at.thickness > 0.0f ? tilt * (f.radii.z + f.radii.w * y) / rest : 0.0f;
    return fsteps_make_vec3(a * angle.x + b * w.x, a * angle.y + b * w.y, a * angle.z + b * w.z);
}

// A gradient of the frame in the world's; with the axes divided by their lengths twice, a direction.
static fsteps_vec3 fsteps_out_of(fsteps_frustum f, fsteps_vec3 n) {
    return fsteps_make_vec3(f.axis_x.x * n.x + f.axis_y.x * n.y + f.axis_z.x * n.z,
                f.axis_x.y * n.x + f.axis_y.y * n.y + f.axis_z.y * n.z,
                f.axis_x.z * n.x + f.axis_y.z * n.y + f.axis_z.z * n.z);
}

static fsteps_normals fsteps_find_normals(fsteps_frustum f, fsteps_uvw at) {
    fsteps_vec3 low = fsteps_end_normal(f, f.lower, at, 0.0f), high = fsteps_end_normal(f, f.upper, at, f.extent.x);
    float m = fminf(fmaxf(at.v, 0.0f), 1.0f), l = 1.0f, height = 0.0f;
    if ((f.more.x & 32) != 0) m = m * m * (3.0f - 2.0f * m); // C1
    l = 1.0f - m;
    fsteps_vec3 smoothed = fsteps_unit(fsteps_make_vec3(l * low.x + m * high.x, l * low.y + m * high.y, l * low.z + m * high.z));
    fsteps_vec3 grad_w = fsteps_make_vec3(at.sine, -at.cone.y, at.cosine); // all gradients times the thickness
    float steep = sqrtf(1.0f + at.cone.y * at.cone.y);
    smoothed = fsteps_make_vec3(smoothed.x * steep, smoothed.y * steep, smoothed.z * steep);
    if (at.thickness > 0.0f && at.d > 1e-6f * f.extent.x) { // the relief's slopes
        float by_d = at.thickness / at.d, span = at.high - at.low;
        fsteps_vec3 angle = fsteps_make_vec3(at.cosine * by_d, 0.0f, -at.sine * by_d), slopes = fsteps_slopes(f, at.u, at.v);
        fsteps_vec3 a = fsteps_cut_gradient(f, f.lower, at, at.low, angle, grad_w);
        fsteps_vec3 b = fsteps_cut_gradient(f, f.upper, at, at.high, angle, grad_w);
        float by_u = slopes.y * 0.159154943f, by_v = slopes.z / span, rest = 1.0f - at.v;
        fsteps_vec3 s = fsteps_make_vec3(by_u * angle.x - by_v * (rest * a.x + at.v * b.x),
                      by_v * (at.thickness - rest * a.y - at.v * b.y),
                      by_u * angle.z - by_v * (rest * a.z + at.v * b.z));
        grad_w = fsteps_make_vec3(grad_w.x - s.x, grad_w.y - s.y, grad_w.z - s.z);
        smoothed = fsteps_make_vec3(smoothed.x - s.x, smoothed.y - s.y, smoothed.z - s.z);
        height = slopes.x;
    }
    fsteps_normals n;
    n.shading = fsteps_unit(fsteps_out_of(f, smoothed));
    n.plain = fsteps_unit(fsteps_out_of(f, grad_w));
    n.away = at.thickness > 0.0f ? (at.w - height) * at.thickness : at.w;
    return n;
}

static fsteps_vec3 fsteps_place_out_of(fsteps_frustum f, fsteps_vec3 p) {
    fsteps_vec4 x = f.axis_x, y = f.axis_y, z = f.axis_z;
    fsteps_vec3 d = fsteps_out_of(f, fsteps_make_vec3(p.x / (x.x * x.x + x.y * x.y + x.z * x.z),
                                    p.y / (y.x * y.x + y.y * y.y + y.z * y.z),
                                    p.z / (z.x * z.x + z.y * z.y + z.z * z.z)));
    return fsteps_make_vec3(x.w + d.x, y.w + d.y, z.w + d.z);
}

// All about a place where a ray of the frame meets a frustum.
static fsteps_frustum_hit fsteps_surface(fsteps_frustum f, int frustum, fsteps_vec3 p, int face) {
    fsteps_frustum_hit hit;
    fsteps_uvw at = fsteps_locate(f, p);
    fsteps_normals n = fsteps_find_normals(f, at);
    int free_ends = face == 1 ? 1 + 2 + 8 : face == 2 ? 4 + 16 : 0;
    hit.found = true;
    hit.inside = false;
    hit.frustum = frustum;
    hit.user = f.more.z;
    hit.cap = (f.more.x & free_ends) != 0 ? face : 0; // elsewhere a plane that shows is the rounding of a seam
    hit.t = 0.0f;
    hit.position = fsteps_place_out_of(f, p);
    hit.uvw = fsteps_make_vec3(at.u, fminf(fmaxf(at.v, 0.0f), 1.0f), at.w);
    hit.map = fsteps_map_place(f, at.u, at.v);
    hit.normal = n.shading;
    hit.true_normal = n.plain;
    if (hit.cap != 0) {
        fsteps_vec4 lower = f.lower, upper = f.upper;
        fsteps_vec3 flat_end = face == 1 ? fsteps_make_vec3(lower.x, -1.0f, lower.y) : fsteps_make_vec3(-upper.x, 1.0f, -upper.y);
        hit.normal = fsteps_unit(fsteps_out_of(f, flat_end));
        hit.true_normal = hit.normal;
    }
    return hit;
}

// The first hit of a ray of the world with `count` frusta from `first`.
static fsteps_frustum_hit fsteps_trace_frusta(int first, int count, fsteps_vec3 origin, fsteps_vec3 direction, float t_min,
                                           float t_max) {
    fsteps_frustum_hit hit = fsteps_no_frustum(t_max);
    float t = t_max;
    int nearest = -1, face = 0;
    for (int k = first; k < first + count; ++k) {
        fsteps_frustum f = fsteps_load(k);
        fsteps_vec2 met = fsteps_meet(f, fsteps_place_into(f, origin), fsteps_into(f, direction), t_min, t);
        if (met.x < t || (nearest < 0 && met.x <= t)) {
            t = met.x;
            nearest = k;
            face = (int)(met.y);
        }
    }
    if (nearest >= 0) {
        fsteps_frustum f = fsteps_load(nearest);
        fsteps_vec3 p = fsteps_along(fsteps_place_into(f, origin), fsteps_into(f, direction), t);
        hit = fsteps_surface(f, nearest, p, face);
        hit.t = t;
        hit.inside = t <= t_min;
    }
    return hit;
}

// What a pixel sees of a frustum whose bounds were drawn there: `place` of the frame, from fsteps_bounds; eye as
// fsteps_eye, (position, 1) or for parallel rays (direction, 0). Rays begin at the bounds, not at the eye: single
// precision then holds however far the eye is.
static fsteps_frustum_hit fsteps_see_frustum(int frustum, fsteps_vec3 place, fsteps_vec4 eye) {
    fsteps_frustum f = fsteps_load(frustum);
    fsteps_frustum_hit hit = fsteps_no_frustum(0.0f);
    fsteps_vec3 v = fsteps_into(f, fsteps_make_vec3(eye.x, eye.y, eye.z));
    float back = 1e30f; // how far the ray begins before the place
    if (eye.w != 0.0f) {
        fsteps_vec3 from = fsteps_place_into(f, fsteps_make_vec3(eye.x, eye.y, eye.z));
        v = fsteps_make_vec3(place.x - from.x, place.y - from.y, place.z - from.z);
        back = sqrtf(v.x * v.x + v.y * v.y + v.z * v.z);
    }
    v = fsteps_unit(v);
    fsteps_vec2 met = fsteps_meet(f, place, v, -back, 1e30f);
    if (met.x < 1e30f) {
        hit = fsteps_surface(f, frustum, fsteps_along(place, v, met.x), (int)(met.y));
        fsteps_vec3 way = fsteps_make_vec3(hit.position.x - eye.x, hit.position.y - eye.y, hit.position.z - eye.z);
        hit.t = eye.w != 0.0f ? sqrtf(way.x * way.x + way.y * way.y + way.z * way.z) : met.x;
        hit.inside = met.x <= -back;
    }
    return hit;
}

// Corner 0..7 of the pyramid around the shell, cut by the planes, in the frame.
static fsteps_vec3 fsteps_corner(fsteps_frustum f, int corner) {
    float sx = (corner & 3) == 1 || (corner & 3) == 2 ? 1.0f : -1.0f, sz = (corner & 3) >= 2 ? 1.0f : -1.0f;
    fsteps_vec2 cone = fsteps_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float low = fsteps_cut(f.lower, f.lower.x * sx + f.lower.y * sz, cone, 0.0f);
    float y = corner < 4 ? low : fsteps_cut(f.upper, f.upper.x * sx + f.upper.y * sz, cone, 0.0f);
    float reach = fmaxf(cone.x + cone.y * y, 0.0f);
    return fsteps_make_vec3(sx * reach, y, sz * reach);
}

// Vertex 0..35 of the twelve triangles around a frustum's shell, in its frame; see fsteps_frustum_triangles.
static fsteps_vec3 fsteps_bounds(int frustum, int number) {
    static const int corners[36] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, 1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0};
    return fsteps_corner(fsteps_load(frustum), corners[number]);
}

