// conemap.h: frusta with relief, by cone steps.
// feffects_rows: the host's: row 0..8 of a conemap_frustum, as four integers
// feffects_fetch: the host's; height, and the cone as stored
#include <math.h>
#include <stdbool.h>


typedef struct feffects_ivec4 {
    int x, y, z, w;
} feffects_ivec4;

typedef struct feffects_vec2 {
    float x, y;
} feffects_vec2;

feffects_ivec4 feffects_rows(int frustum, int row);
feffects_vec2 feffects_fetch(int i, int j);
float feffects_alpha(int i, int j);

typedef struct feffects_vec3 {
    float x, y, z;
} feffects_vec3;

typedef struct feffects_vec4 {
    float x, y, z, w;
} feffects_vec4;

typedef struct feffects_frustum_hit {
    bool found;
    bool inside; // the ray began inside
    int frustum, user; // that was hit; its `user`
    int cap; // 1, 2: the flat lower, upper end of a segment
    float t; // in lengths of the direction
    feffects_vec3 position;
    feffects_vec3 uvw; // of the frustum; v 0..1, w the height in the shell
    feffects_vec2 map; // u and v of the map, not wrapped
    feffects_vec3 normal; // unit, continuous across joints
    float depth;
    float shadow; // 0 dark to 1 lit
    float occlusion; // 0 closed to 1 open
    feffects_vec4 gradient; // how u and v of the map move along the two axes of a pixel's footprint
    float fade; // 0 relief to 1 normals only
} feffects_frustum_hit;

typedef struct feffects_frusta_effects {
    feffects_vec4 clip_z, clip_w; // rows of the matrix: clip z and w of (position, 1)
    feffects_vec4 light; // towards the light, 0; or its position, 1
    int first, count; // frusta that throw shadows
    float alpha_cut; // texels below it are holes
    float pixel; // how wide a pixel is at distance 1 from the eye; of parallel rays, anywhere
    float fade_begin, fade_end; // pixels that the shell is thick
} feffects_frusta_effects;

static feffects_vec3 feffects_make_vec3(float x, float y, float z) {
    feffects_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static feffects_vec2 feffects_make_vec2(float x, float y) {
    feffects_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static feffects_vec4 feffects_make_vec4(float x, float y, float z, float w) {
    feffects_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static feffects_frustum_hit feffects_no_frustum(float t) {
    feffects_frustum_hit hit;
    hit.found = false;
    hit.inside = false;
    hit.frustum = -1;
    hit.user = 0;
    hit.cap = 0;
    hit.t = t;
    hit.position = feffects_make_vec3(0.0f, 0.0f, 0.0f);
    hit.uvw = hit.position;
    hit.map = feffects_make_vec2(0.0f, 0.0f);
    hit.normal = hit.position;
    hit.depth = 0.0f;
    hit.shadow = 1.0f;
    hit.occlusion = 1.0f;
    hit.gradient = feffects_make_vec4(0.0f, 0.0f, 0.0f, 0.0f);
    hit.fade = 0.0f;
    return hit;
}

static float feffects_dot(feffects_vec3 a, feffects_vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

typedef struct feffects_frustum {
    feffects_vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates
    feffects_vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there
    feffects_vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth
    feffects_vec4 extent; // length of the axis; start and size in the map's v; twist
    feffects_ivec4 links; // parent, child, branch, sibling
    feffects_ivec4 more; // flags, u_repeat, user
} feffects_frustum;

static float feffects_real(int bits) {
    union {
        int whole;
        float real;
    } both;
    both.whole = bits;
    return both.real;
}

static feffects_vec4 feffects_real4(feffects_ivec4 bits) {
    return feffects_make_vec4(feffects_real(bits.x), feffects_real(bits.y), feffects_real(bits.z), feffects_real(bits.w));
}

// One of a frustum's nine rows, as integers: as floats, a unit could flush its small ones to 0.
static feffects_ivec4 feffects_row(int frustum, int row) {
    return feffects_rows(frustum, row);
}

static feffects_frustum feffects_load(int frustum) {
    feffects_frustum f;
    f.axis_x = feffects_real4(feffects_row(frustum, 0));
    f.axis_y = feffects_real4(feffects_row(frustum, 1));
    f.axis_z = feffects_real4(feffects_row(frustum, 2));
    f.lower = feffects_real4(feffects_row(frustum, 3));
    f.upper = feffects_real4(feffects_row(frustum, 4));
    f.radii = feffects_real4(feffects_row(frustum, 5));
    f.extent = feffects_real4(feffects_row(frustum, 6));
    f.links = feffects_row(frustum, 7);
    f.more = feffects_row(frustum, 8);
    return f;
}

// A direction of the world in the frustum's frame.
static feffects_vec3 feffects_into(feffects_frustum f, feffects_vec3 d) {
    return feffects_make_vec3(f.axis_x.x * d.x + f.axis_x.y * d.y + f.axis_x.z * d.z,
                f.axis_y.x * d.x + f.axis_y.y * d.y + f.axis_y.z * d.z,
                f.axis_z.x * d.x + f.axis_z.y * d.y + f.axis_z.z * d.z);
}

static feffects_vec3 feffects_place_into(feffects_frustum f, feffects_vec3 p) {
    return feffects_into(f, feffects_make_vec3(p.x - f.axis_x.w, p.y - f.axis_y.w, p.z - f.axis_z.w));
}

typedef struct feffects_detail { // what is seen of a shell's relief from far away
    float fade; // 0 relief to 1 normals only
} feffects_detail;

// Narrows (from, to, face) to where g + gv t >= 0; a ray that enters there enters through `face`.
static feffects_vec3 feffects_half(feffects_vec3 span, float g, float gv, float face) {
    float t = gv != 0.0f ? -g / gv : 0.0f;
    if (gv > 0.0f && t > span.x) span = feffects_make_vec3(t, span.y, face);
    if (gv < 0.0f) span.y = fminf(span.y, t);
    if (gv == 0.0f && g < 0.0f) span.y = -1e30f;
    return span;
}

// Where a ray of the frame is between the cutting planes and inside a cone (radius at y = 0, its growth): from, to, and
// the face that it enters through, 0 the cone, 1 the lower plane, 2 the upper; nowhere if from > to. The quadratic is
// set up where the ray is nearest to the axis, its discriminant from the ray's moment about the axis, and solved in
// the form that does not cancel. There is no apex, so cylinders are nothing special, and no mirrored nappe.
static feffects_vec3 feffects_span(feffects_frustum f, feffects_vec2 cone, feffects_vec3 o, feffects_vec3 v, float t_min, float t_max) {
    float seam = 1e-6f * (f.extent.x + cone.x); // by so much neighbours overlap: rounding opens no gap
    feffects_vec3 span = feffects_make_vec3(t_min, t_max, 0.0f);
    span = feffects_half(span, o.y - f.lower.x * o.x - f.lower.y * o.z - f.lower.z + seam,
                        v.y - f.lower.x * v.x - f.lower.y * v.z, 1.0f);
    span = feffects_half(span, f.upper.x * o.x + f.upper.y * o.z + f.upper.z - o.y + seam,
                        f.upper.x * v.x + f.upper.y * v.z - v.y, 2.0f);
    float across = v.x * v.x + v.z * v.z;
    float at = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : span.x;
    at = fminf(fmaxf(at, span.x), span.y);
    float x = o.x + at * v.x, y = o.y + at * v.y, z = o.z + at * v.z, d = sqrtf(x * x + z * z);
    float radius = cone.x + cone.y * y, growth = cone.y * v.y, along = x * v.x + z * v.z;
    feffects_vec3 inside = feffects_half(feffects_make_vec3(span.x - at, span.y - at, span.z), radius, growth, 0.0f);
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
    if (first > inside.x) inside = feffects_make_vec3(first, inside.y, 0.0f);
    inside.y = fminf(inside.y, second);
    span = feffects_make_vec3(fmaxf(span.x, inside.x + at), fminf(span.y, inside.y + at), inside.z);
    return meets && inside.x <= inside.y ? span : feffects_make_vec3(1.0f, 0.0f, 0.0f);
}

static feffects_vec3 feffects_along(feffects_vec3 o, feffects_vec3 v, float t) {
    return feffects_make_vec3(o.x + t * v.x, o.y + t * v.y, o.z + t * v.z);
}

// Where a ray enters the shell. pixel: how wide one is at t = 0, and its growth.
static feffects_detail feffects_detail_of(feffects_frusta_effects e, feffects_frustum f, feffects_vec3 o, feffects_vec3 v, feffects_vec2 range, feffects_vec2 pixel) {
    feffects_detail detail;
    feffects_vec3 outer = feffects_span(f, feffects_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, range.x, range.y);
    feffects_vec3 p = feffects_along(o, v, outer.x);
    float width = fmaxf(pixel.x + pixel.y * outer.x, 1e-30f);
    float faded = (e.fade_begin - (f.radii.z + f.radii.w * p.y) / width) / (e.fade_begin - e.fade_end);
    faded = fminf(fmaxf(faded, 0.0f), 1.0f);
    faded *= faded * (3.0f - 2.0f * faded);
    detail.fade = faded >= 0.9999f ? 1.0f : faded;
    return detail;
}

// The frustum with its shell shrunk towards a height of 0.0f in it.
static feffects_frustum feffects_flatten(feffects_frustum f, float fade) {
    float at = fade * 0.0f, rest = 1.0f - fade;
    f.radii = feffects_make_vec4(f.radii.x + at * f.radii.z, f.radii.y + at * f.radii.w, rest * f.radii.z, rest * f.radii.w);
    return f;
}

typedef struct feffects_shell { // what bounds how fast the map's place changes along a ray
    float turning, nearest; // |x' z - x z'|; t where the ray is nearest to the axis
    float by_v, span; // v moves at by_v / span at most: see feffects_bound_speed
    float stretch, twist; // u at stretch times the angle and twist times v
} feffects_shell;

// With exact_u, u is the eccentric anomaly of the cut's ellipse as seen along the axis. What that is counted
// from is e / (1 + sqrt(1 - e^2)) long, with the eccentricity e, and goes linearly with v.
static feffects_vec2 feffects_focus(feffects_frustum f, float v) {
    feffects_vec4 a = f.lower, b = f.upper;
    float k = f.radii.y, share = fminf(fmaxf(v, 0.0f), 1.0f);
    float low = k / (1.0f + sqrtf(fmaxf(1.0f - k * k * (a.x * a.x + a.y * a.y), 0.0f)));
    float high = k / (1.0f + sqrtf(fmaxf(1.0f - k * k * (b.x * b.x + b.y * b.y), 0.0f)));
    low *= 1.0f - share;
    high *= share;
    return feffects_make_vec2(low * a.x + high * b.x, low * a.y + high * b.y);
}

// The angle turns at |x' z - x z'| / d^2. Both cuts y = a x + b z + c, weighted as v weights them, move at no more
// than |(n_lower, n_upper)| / (1 - k n) times |(x, z)'| + k |y'|, n the slopes; span is the least way between them.
static feffects_shell feffects_bound_speed(feffects_frustum f, feffects_vec3 o, feffects_vec3 v) {
    feffects_shell s;
    feffects_vec2 inner = feffects_make_vec2(f.radii.x, f.radii.y), outer = feffects_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float lower = sqrtf(f.lower.x * f.lower.x + f.lower.y * f.lower.y);
    float upper = sqrtf(f.upper.x * f.upper.x + f.upper.y * f.upper.y);
    float da = f.upper.x - f.lower.x, db = f.upper.y - f.lower.y, n = fmaxf(lower, upper);
    float k = fmaxf(fabsf(inner.y), fabsf(outer.y)), vy = fabsf(v.y), across = v.x * v.x + v.z * v.z;
    s.turning = fabsf(v.x * o.z - o.x * v.z);
    s.nearest = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : 0.0f;
    s.by_v = vy + sqrtf(lower * lower + upper * upper) / (1.0f - k * n) * (sqrtf(across) + k * vy);
    s.span = fmaxf(outer.x + outer.y * f.lower.z, inner.x + inner.y * f.lower.z) / (1.0f - k * lower);
    s.span = (f.upper.z - f.lower.z - s.span * sqrtf(da * da + db * db)) / (1.0f + k * upper);
    s.stretch = 1.0f;
    s.twist = fabsf(f.extent.w);
    if ((f.more.x & 64) != 0) { // exact_u
        feffects_vec2 a = feffects_focus(f, 0.0f), b = feffects_focus(f, 1.0f);
        float longer = sqrtf(fmaxf(a.x * a.x + a.y * a.y, b.x * b.x + b.y * b.y));
        da = b.x - a.x;
        db = b.y - a.y;
        s.stretch = (1.0f + longer) / (1.0f - longer);
        s.twist += 0.318309886f * sqrtf(da * da + db * db) / (1.0f - longer);
    }
    return s;
}

typedef struct feffects_uvw { // a place in a frustum, with what it was computed from
    float u, v, w;
    float d, sine, cosine, thickness; // distance from the axis, direction from it; of the shell there
    feffects_vec2 cone; // that of the shell that goes through the place
    float low, high; // y where its straight line there meets the cutting planes
} feffects_uvw;

// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its growth) in the
// direction in which the plane rises by `tilt`.
static float feffects_cut(feffects_vec4 plane, float tilt, feffects_vec2 cone, float base) {
    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0f - cone.y * tilt);
}

// The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. Within 1e-7.
static float feffects_turns(float x, float z) {
    float ax = fabsf(x), az = fabsf(z), large = fmaxf(ax, az), a = large > 0.0f ? fminf(ax, az) / large : 0.0f;
    float base = a > 0.414213562f ? 0.125f : 0.0f; // turned back by an eighth
    if (base > 0.0f) a = (a - 1.0f) / (a + 1.0f);
    float s = a * a;
    float turns = base + a * (0.15915485f + s * (-0.05303445f + s * (0.03131805f - s * 0.01766679f)));
    if (ax > az) turns = 0.25f - turns;
    if (z < 0.0f) turns = 0.5f - turns;
    return x < 0.0f ? 1.0f - turns : turns;
}

// u of a place in the direction (x, z), a unit, from the axis.
static float feffects_turns_of(feffects_frustum f, float x, float z, float v) {
    if ((f.more.x & 64) != 0) { // exact_u
        feffects_vec2 focus = feffects_focus(f, v);
        float gx = x - focus.x, gz = z - focus.y;
        float along = 2.0f * (x * gx + z * gz) / fmaxf(gx * gx + gz * gz, 1e-30f);
        x = along * gx - x;
        z = along * gz - z;
    }
    return feffects_turns(x, z);
}

static feffects_uvw feffects_locate(feffects_frustum f, feffects_vec3 p) {
    feffects_uvw at;
    at.d = sqrtf(p.x * p.x + p.z * p.z);
    at.sine = at.d > 0.0f ? p.x / at.d : 0.0f;
    at.cosine = at.d > 0.0f ? p.z / at.d : 1.0f;
    at.thickness = f.radii.z + f.radii.w * p.y;
    at.w = at.d - (f.radii.x + f.radii.y * p.y);
    if (at.thickness > 0.0f) at.w = at.w / at.thickness;
    float w = at.thickness > 0.0f ? fminf(fmaxf(at.w, -0.5f), 1.5f) : 0.0f;
    at.cone = feffects_make_vec2(f.radii.x + w * f.radii.z, f.radii.y + w * f.radii.w);
    at.low = feffects_cut(f.lower, f.lower.x * at.sine + f.lower.y * at.cosine, at.cone, 0.0f);
    at.high = feffects_cut(f.upper, f.upper.x * at.sine + f.upper.y * at.cosine, at.cone, 0.0f);
    at.v = at.high != at.low ? (p.y - at.low) / (at.high - at.low) : 0.0f;
    at.u = feffects_turns_of(f, at.sine, at.cosine, at.v);
    return at;
}

// The map's u and v, not wrapped.
static feffects_vec2 feffects_map_place(feffects_frustum f, float u, float v) {
    float clamped = fminf(fmaxf(v, 0.0f), 1.0f);
    return feffects_make_vec2((u + clamped * f.extent.w) * (float)(f.more.y), f.extent.y + clamped * f.extent.z);
}

// The same in texels, from the centre of texel (0, 0).
static feffects_vec2 feffects_texels(feffects_frustum f, float u, float v) {
    feffects_vec2 at = feffects_map_place(f, u, v);
    at.y -= floorf(at.y);
    return feffects_make_vec2((at.x - floorf(at.x)) * 64.0f - 0.5f, at.y * 48.0f - 0.5f);
}

static int feffects_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static feffects_vec2 feffects_texel(int i, int j) {
    return feffects_fetch(feffects_repeat(i, 64), feffects_repeat(j, 48));
}

static float feffects_mix(feffects_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height of the relief, and tangent of the cone there.
static feffects_vec2 feffects_relief(feffects_frustum f, float u, float v) {
    feffects_vec2 at = feffects_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y)), si = 1, sj = 1;
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    feffects_vec2 a = feffects_texel(i, j), b = feffects_texel(i + si, j);
    feffects_vec2 c = feffects_texel(i, j + sj), d = feffects_texel(i + si, j + sj);
    feffects_vec4 heights = feffects_make_vec4(a.x, b.x, c.x, d.x);
    float height = feffects_mix(heights, x, y);
    float cone = feffects_mix(feffects_make_vec4(a.y, b.y, c.y, d.y), x, y);
    return feffects_make_vec2(height, cone);
}

static bool feffects_over_hole(feffects_frustum f, feffects_uvw at, float alpha_cut) {
    feffects_vec2 p = feffects_texels(f, at.u, at.v);
    int i = (int)(floorf(p.x + 0.5f)), j = (int)(floorf(p.y + 0.5f));
    return feffects_alpha(feffects_repeat(i, 64), feffects_repeat(j, 48)) < alpha_cut;
}

// How fast the map's place changes at most, from t to t_end.
static float feffects_map_speed(feffects_frustum f, feffects_shell s, feffects_vec3 o, feffects_vec3 v, float t, float t_end) {
    feffects_vec3 p = feffects_along(o, v, fminf(fmaxf(s.nearest, t), t_end));
    float d2 = p.x * p.x + p.z * p.z;
    float angle = s.turning / fmaxf(d2, 1e-30f), by_v = s.by_v / s.span;
    float by_u = (s.stretch * angle * 0.159154943f + by_v * s.twist) * (float)(f.more.y);
    by_v *= fabsf(f.extent.z) * 7.5e-1f;
    return s.span > 0.0f && d2 > 0.0f ? sqrtf(by_u * by_u + by_v * by_v) : 1e30f;
}

// How far the ray is above the relief at t, in heights.
static float feffects_above(feffects_frustum f, feffects_vec3 o, feffects_vec3 v, float t, float alpha_cut) {
    feffects_uvw at = feffects_locate(f, feffects_along(o, v, t));
    if (feffects_over_hole(f, at, alpha_cut)) return 1.0f;
    return at.w - feffects_relief(f, at.u, at.v).x;
}

// Cone steps, none shorter than one of 256 equal ones, then halvings: t where the ray meets the relief in a range
// of t, at its end if `solid`; 1e30: it does not. The ray is g above the cone's apex, in the world's units, and
// meets nothing while g + g' t > thickness speed t / tangent.
static float feffects_march(feffects_frustum f, feffects_vec3 o, feffects_vec3 v, feffects_vec2 range, bool solid, float alpha_cut) {
    float before = range.x, t = range.x;
    bool met = false;
    float least = (range.y - range.x) / (float)(256);
    float thick_end = f.radii.z + f.radii.w * (o.y + range.y * v.y);
    feffects_shell shell = feffects_bound_speed(f, o, v);
    for (int k = 0; k <= 256; ++k) {
        feffects_uvw at = feffects_locate(f, feffects_along(o, v, t));
        feffects_vec2 relief = feffects_relief(f, at.u, at.v);
        met = at.w <= relief.x || (solid && t >= range.y);
        met = met && !feffects_over_hole(f, at, alpha_cut);
        if (met || t >= range.y) break;
        float apex = relief.x + 1.0f / 1048576.0f, g = (at.w - apex) * at.thickness;
        float slope = at.sine * v.x + at.cosine * v.z - (f.radii.y + f.radii.w * apex) * v.y;
        float closing = fmaxf(at.thickness, thick_end) * feffects_map_speed(f, shell, o, v, t, range.y);
        closing -= relief.y * slope;
        before = t;
        t += fmaxf(g <= 0.0f ? 0.0f : closing > 0.0f ? relief.y * g / closing : 1e30f, least);
        if (t > range.y || k + 1 >= 256) t = range.y;
    }
    for (int n = 0; met && n < 10; ++n) {
        float middle = 0.5f * (before + t);
        bool over = feffects_above(f, o, v, middle, alpha_cut) > 0.0f;
        before = over ? middle : before;
        t = over ? t : middle;
    }
    return met ? t : 1e30f;
}

// t where a ray of the frame meets the frustum's relief, 1e30 where it does not, and the face; see feffects_span.
static feffects_vec2 feffects_meet(feffects_frustum f, feffects_vec3 o, feffects_vec3 v, float t_min, float t_max, float alpha_cut) {
    feffects_vec3 inner = feffects_span(f, feffects_make_vec2(f.radii.x, f.radii.y), o, v, t_min, t_max), outer = inner;
    bool solid = inner.x <= inner.y, shell = f.radii.z > 0.0f || f.radii.w > 0.0f;
    if (shell) outer = feffects_span(f, feffects_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, t_min, t_max);
    if (solid && outer.x > outer.y) outer = inner; // by rounding, where there is no shell
    // The frustum is hollow: through a hole to the far wall, which is met from within.
    bool core = solid && (inner.z != 0.0f || inner.x <= t_min); // there at once
    float t = 1e30f, end = solid ? fmaxf(inner.x, outer.x) : outer.y;
    if (outer.x <= outer.y && !core) t = feffects_march(f, o, v, feffects_make_vec2(outer.x, end), solid, alpha_cut);
    feffects_uvw at = feffects_locate(f, feffects_along(o, v, inner.y));
    if (t < 1e30f || !solid || at.d < 0.999f * (f.radii.x + f.radii.y * (o.y + inner.y * v.y)))
        return feffects_make_vec2(t, t > outer.x ? 0.0f : outer.z);
    if (!feffects_over_hole(f, at, alpha_cut)) return feffects_make_vec2(inner.y, 3.0f);
    return feffects_make_vec2(feffects_march(f, o, v, feffects_make_vec2(inner.y, fmaxf(inner.y, outer.y)), false, alpha_cut), 3.0f);
}

// A gradient of the frame in the world's; with the axes divided by their lengths twice, a direction.
static feffects_vec3 feffects_out_of(feffects_frustum f, feffects_vec3 n) {
    return feffects_make_vec3(f.axis_x.x * n.x + f.axis_y.x * n.y + f.axis_z.x * n.z,
                f.axis_x.y * n.x + f.axis_y.y * n.y + f.axis_z.y * n.z,
                f.axis_x.z * n.x + f.axis_y.z * n.y + f.axis_z.z * n.z);
}

static feffects_vec3 feffects_place_out_of(feffects_frustum f, feffects_vec3 p) {
    feffects_vec4 x = f.axis_x, y = f.axis_y, z = f.axis_z;
    feffects_vec3 d = feffects_out_of(f, feffects_make_vec3(p.x / (x.x * x.x + x.y * x.y + x.z * x.z),
                                    p.y / (y.x * y.x + y.y * y.y + y.z * y.z),
                                    p.z / (z.x * z.x + z.y * z.y + z.z * z.z)));
    return feffects_make_vec3(x.w + d.x, y.w + d.y, z.w + d.z);
}

typedef struct feffects_normals { // in the world, units
    feffects_vec3 shading; // continuous across joints
    float away; // how far the place is outside the surface, in the world's units
} feffects_normals;

static feffects_vec3 feffects_unit(feffects_vec3 n) {
    float by = sqrtf(n.x * n.x + n.y * n.y + n.z * n.z);
    by = by > 0.0f ? 1.0f / by : 0.0f;
    return feffects_make_vec3(n.x * by, n.y * by, n.z * by);
}

// The surface normal at a cut [BJCW09 eq. 8]: away from the joint, leaning back along the plane's own normal.
static feffects_vec3 feffects_end_normal(feffects_frustum f, feffects_vec4 plane, feffects_uvw at, float joint) {
    float y = feffects_cut(plane, plane.x * at.sine + plane.y * at.cosine, at.cone, joint);
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
    return feffects_unit(feffects_make_vec3(radius * at.sine + lean * plane.x, y - lean, radius * at.cosine + lean * plane.y));
}

typedef struct feffects_uv_gradients { // of u, in radians, and of v, times the thickness
    feffects_vec3 u, v;
} feffects_uv_gradients;

// Gradient, times the thickness, of a cut's y: it moves with the angle and with w.
static feffects_vec3 feffects_cut_gradient(feffects_frustum f, feffects_vec4 plane, feffects_uvw at, float y, feffects_vec3 angle, feffects_vec3 w) {
    float tilt = plane.x * at.sine + plane.y * at.cosine, rest = 1.0f - at.cone.y * tilt;
    float a = (at.cone.x + at.cone.y * plane.z) / (rest * rest) * (plane.x * at.cosine - plane.y * at.sine);
    float b = at.thickness > 0.0f ? tilt * (f.radii.z + f.radii.w * y) / rest : 0.0f;
    return feffects_make_vec3(a * angle.x + b * w.x, a * angle.y + b * w.y, a * angle.z + b * w.z);
}

static feffects_uv_gradients feffects_find_gradients(feffects_frustum f, feffects_uvw at) {
    feffects_uv_gradients g;
    float by_d = at.thickness / at.d, span = at.high - at.low, rest = 1.0f - at.v;
    feffects_vec3 grad_w = feffects_make_vec3(at.sine, -at.cone.y, at.cosine);
    g.u = feffects_make_vec3(at.cosine * by_d, 0.0f, -at.sine * by_d);
    feffects_vec3 a = feffects_cut_gradient(f, f.lower, at, at.low, g.u, grad_w);
    feffects_vec3 b = feffects_cut_gradient(f, f.upper, at, at.high, g.u, grad_w);
    g.v = feffects_make_vec3(-(rest * a.x + at.v * b.x) / span, (at.thickness - rest * a.y - at.v * b.y) / span,
               -(rest * a.z + at.v * b.z) / span);
    if ((f.more.x & 64) != 0) { // exact_u
        feffects_vec2 focus = feffects_focus(f, at.v), low = feffects_focus(f, 0.0f), high = feffects_focus(f, 1.0f);
        float gx = at.sine - focus.x, gz = at.cosine - focus.y, way = fmaxf(gx * gx + gz * gz, 1e-30f);
        float by_angle = (1.0f - focus.x * focus.x - focus.y * focus.y) / way;
        float by_v = -2.0f * (gz * (high.x - low.x) - gx * (high.y - low.y)) / way;
        g.u = feffects_make_vec3(by_angle * g.u.x + by_v * g.v.x, by_angle * g.u.y + by_v * g.v.y, by_angle * g.u.z + by_v * g.v.z);
    }
    return g;
}

// Height of the relief, and what it grows by per turn of u and per v of the frustum.
static feffects_vec3 feffects_slopes(feffects_frustum f, float u, float v) {
    feffects_vec2 at = feffects_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y));
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    float a = feffects_texel(i, j).x, b = feffects_texel(i + 1, j).x;
    float c = feffects_texel(i, j + 1).x, d = feffects_texel(i + 1, j + 1).x;
    float low = b - a, high = d - c, by_u = (low + (high - low) * y) * 64.0f * (float)(f.more.y);
    float by_v = (c - a + (d - c - b + a) * x) * 48.0f * f.extent.z;
    return feffects_make_vec3(a + low * x + (c - a + (high - low) * x) * y, by_u, by_v + by_u * f.extent.w);
}

static feffects_normals feffects_find_normals(feffects_frustum f, feffects_uvw at) {
    feffects_vec3 low = feffects_end_normal(f, f.lower, at, 0.0f), high = feffects_end_normal(f, f.upper, at, f.extent.x);
    float m = fminf(fmaxf(at.v, 0.0f), 1.0f), steep = sqrtf(1.0f + at.cone.y * at.cone.y);
    if ((f.more.x & 32) != 0) m = m * m * (3.0f - 2.0f * m); // C1
    float l = 1.0f - m;
    feffects_vec3 smoothed = feffects_unit(feffects_make_vec3(l * low.x + m * high.x, l * low.y + m * high.y, l * low.z + m * high.z));
    smoothed = feffects_make_vec3(smoothed.x * steep, smoothed.y * steep, smoothed.z * steep);
    float height = 0.0f;
    if (at.thickness > 0.0f && at.d > 1e-6f * f.extent.x) { // the relief's slopes
        feffects_uv_gradients g = feffects_find_gradients(f, at);
        feffects_vec3 slopes = feffects_slopes(f, at.u, at.v);
        float by_u = slopes.y * 0.159154943f, by_v = slopes.z;
        feffects_vec3 s = feffects_make_vec3(by_u * g.u.x + by_v * g.v.x, by_u * g.u.y + by_v * g.v.y, by_u * g.u.z + by_v * g.v.z);
        smoothed = feffects_make_vec3(smoothed.x - s.x, smoothed.y - s.y, smoothed.z - s.z);
        height = slopes.x;
    }
    feffects_normals n;
    n.shading = feffects_unit(feffects_out_of(f, smoothed));
    n.away = at.thickness > 0.0f ? (at.w - height) * at.thickness : at.w;
    return n;
}

// Out of the lower (1) or upper (2) cutting plane.
static feffects_vec3 feffects_flat_end(feffects_frustum f, int face) {
    feffects_vec4 lower = f.lower, upper = f.upper;
    return face == 1 ? feffects_make_vec3(lower.x, -1.0f, lower.y) : feffects_make_vec3(-upper.x, 1.0f, -upper.y);
}

// The frustum of a chain that a place is beside, a few up or down from `frustum`.
static int feffects_row_beside(int frustum, feffects_vec3 place) {
    for (int k = 0; k < 4; ++k) {
        feffects_frustum f = feffects_load(frustum);
        feffects_vec3 p = feffects_place_into(f, place);
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
static feffects_vec3 feffects_mix_normal(int frustum, feffects_vec3 place, float reach, bool branch, feffects_vec3 sum) {
    feffects_frustum f = feffects_load(frustum);
    feffects_vec3 p = feffects_place_into(f, place);
    float weight = branch ? fminf(fmaxf(4.0f * p.y / (f.radii.x + f.radii.z), 0.0f), 1.0f) : 1.0f;
    if (weight > 0.0f && p.y <= f.extent.x + reach && p.y >= -reach - f.extent.x) {
        feffects_normals n = feffects_find_normals(f, feffects_locate(f, p));
        float near_by = fminf(fmaxf(1.0f - n.away / reach, 0.0f), 1.0f);
        weight *= near_by * near_by * (3.0f - 2.0f * near_by);
        sum = feffects_make_vec3(sum.x + weight * n.shading.x, sum.y + weight * n.shading.y, sum.z + weight * n.shading.z);
    }
    return sum;
}

// Mixes in the branches that leave a frustum's top, but not `except`.
static feffects_vec3 feffects_mix_branches(int first, int except, feffects_vec3 place, feffects_vec3 sum) {
    int branch = first;
    for (int k = 0; k < 64 && branch >= 0; ++k) {
        feffects_vec4 radii = feffects_real4(feffects_row(branch, 5));
        if (branch != except) {
            int beside = feffects_row_beside(branch, place);
            sum = feffects_mix_normal(beside, place, 6.99999988e-1f * (radii.x + radii.z), beside == branch, sum);
        }
        branch = feffects_row(branch, 7).w;
    }
    return sum;
}

// Where branches leave a chain, the normals of the surfaces that meet there are mixed: those of the branches that leave
// the frustum's own chain nearby, and if that chain is itself a branch, of the chain it leaves and its other branches.
static feffects_vec3 feffects_blend(int frustum, feffects_vec3 place, feffects_vec3 normal) {
    int at = feffects_row(frustum, 7).y;
    for (int up = 1; up < 4 && at >= 0; ++up) {
        feffects_ivec4 links = feffects_row(at, 7);
        normal = feffects_mix_branches(links.z, -1, place, normal);
        at = links.y;
    }
    at = frustum;
    for (int down = 0; down < 4 && at >= 0; ++down) {
        feffects_ivec4 links = feffects_row(at, 7);
        normal = feffects_mix_branches(links.z, -1, place, normal);
        if ((feffects_row(at, 8).x & 2) != 0) { // a branch
            feffects_vec4 radii = feffects_real4(feffects_row(at, 5));
            int beside = feffects_row_beside(links.x, place);
            normal = feffects_mix_normal(beside, place, 6.99999988e-1f * (radii.x + radii.z), false, normal);
            normal = feffects_mix_branches(feffects_row(links.x, 7).z, at, place, normal);
            links.x = -1;
        }
        at = links.x;
    }
    return feffects_unit(normal);
}

// All about a place where a ray of the frame meets a frustum.
static feffects_frustum_hit feffects_surface(feffects_frustum f, int frustum, feffects_vec3 p, int face) {
    feffects_frustum_hit hit = feffects_no_frustum(0.0f);
    feffects_uvw at = feffects_locate(f, p);
    int free_ends = face == 1 ? 1 + 2 + 8 : face == 2 ? 4 + 16 : 0;
    hit.found = true;
    hit.frustum = frustum;
    hit.user = f.more.z;
    hit.cap = (f.more.x & free_ends) != 0 ? face : 0; // elsewhere a plane that shows is the rounding of a seam
    hit.position = feffects_place_out_of(f, p);
    hit.uvw = feffects_make_vec3(at.u, fminf(fmaxf(at.v, 0.0f), 1.0f), at.w);
    hit.map = feffects_map_place(f, at.u, at.v);
    feffects_normals n = feffects_find_normals(f, at);
    hit.normal = n.shading;
    if (hit.cap != 0) {
        hit.normal = feffects_unit(feffects_out_of(f, feffects_flat_end(f, face)));
    }
    if (hit.cap == 0) hit.normal = feffects_blend(frustum, hit.position, hit.normal);
    return hit;
}

// Some direction at right angles to a unit vector.
static feffects_vec3 feffects_side_of(feffects_vec3 n) {
    return feffects_unit(fabsf(n.y) < 0.9f ? feffects_make_vec3(n.z, 0.0f, -n.x) : feffects_make_vec3(0.0f, n.z, -n.y));
}

static feffects_vec3 feffects_cross(feffects_vec3 a, feffects_vec3 b) {
    return feffects_make_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// How the map's place moves along the two axes of a pixel's footprint on the frustum.
static feffects_vec4 feffects_footprint(feffects_frustum f, feffects_vec3 p, feffects_vec3 direction, float width) {
    feffects_uvw at = feffects_locate(f, p);
    if (!(at.d > 1e-6f * f.extent.x)) return feffects_make_vec4(0.0f, 0.0f, 0.0f, 0.0f);
    float scale = width, repeat = 0.159154943f * (float)(f.more.y);
    if (at.thickness > 0.0f) scale = width / at.thickness;
    else at.thickness = 1.0f;
    feffects_uv_gradients g = feffects_find_gradients(f, at);
    feffects_vec3 n = feffects_unit(feffects_out_of(f, feffects_make_vec3(at.sine, -at.cone.y, at.cosine))), d = feffects_unit(direction);
    float facing = feffects_dot(n, d);
    feffects_vec3 away = feffects_along(d, n, -facing);
    away = facing * facing < 0.9999f ? feffects_unit(away) : feffects_side_of(n);
    feffects_vec3 b = feffects_into(f, feffects_cross(n, away)), a = feffects_into(f, away);
    float far_out = scale / fmaxf(fabsf(facing), 0.015625f);
    feffects_vec2 by_a = feffects_make_vec2(far_out * feffects_dot(g.u, a) * repeat, far_out * feffects_dot(g.v, a));
    feffects_vec2 by_b = feffects_make_vec2(scale * feffects_dot(g.u, b) * repeat, scale * feffects_dot(g.v, b));
    float twist = f.extent.w * (float)(f.more.y), rise = f.extent.z;
    return feffects_make_vec4(by_a.x + by_a.y * twist, by_a.y * rise, by_b.x + by_b.y * twist, by_b.y * rise);
}

// From the cone: the horizon all around is guessed to stand 0.3 times as steep as the steepest.
static float feffects_openness(feffects_frustum f, feffects_vec3 p) {
    feffects_uvw at = feffects_locate(f, p);
    if (!(at.thickness > 0.0f) || !(at.d > 1e-6f * f.extent.x)) return 1.0f;
    feffects_vec3 slopes = feffects_slopes(f, at.u, at.v);
    float per_u = 0.159154943f * at.thickness / at.d, x = slopes.y * per_u;
    float y = slopes.z * at.thickness / (at.high - at.low), own = sqrtf(x * x + y * y);
    float steepness = 1.0f / fmaxf(feffects_relief(f, at.u, at.v).y, 1e-6f) - 1.0f / 1.0f;
    float hill = 0.3f * fmaxf(per_u * (float)(f.more.y) * steepness - own, 0.0f);
    return 1.0f / (1.0f + hill * hill);
}

// The place of the world, just outside the surface, that light is looked at from.
static feffects_vec3 feffects_lift(feffects_frustum f, feffects_vec3 p, int cap, bool within) {
    feffects_uvw at = feffects_locate(f, p);
    float bias = 1e-5f * at.d + 3e-7f * (fabsf(f.axis_x.w) + fabsf(f.axis_y.w) + fabsf(f.axis_z.w) + f.extent.x);
    float out_to = at.d;
    if (at.thickness > 0.0f) {
        float height = feffects_relief(f, at.u, at.v).x + 1.0f / 4096.0f;
        out_to = fmaxf(out_to, f.radii.x + f.radii.y * p.y + height * at.thickness);
    }
    if (within) out_to = fminf(at.d, f.radii.x + f.radii.y * p.y) - 2.0f * bias - at.thickness / 4096.0f;
    out_to += bias;
    if (cap == 0) p = feffects_make_vec3(at.sine * out_to, p.y, at.cosine * out_to);
    else p = feffects_along(p, feffects_unit(feffects_flat_end(f, cap)), bias + 4e-6f * (f.extent.x + f.radii.x + f.radii.z));
    return feffects_place_out_of(f, p);
}

// The direction to the light, and how far it is.
static feffects_vec4 feffects_light_from(feffects_vec4 light, feffects_vec3 place) {
    feffects_vec3 d = feffects_make_vec3(light.x, light.y, light.z);
    if (light.w != 0.0f) d = feffects_along(d, place, -1.0f);
    float way = sqrtf(feffects_dot(d, d));
    return feffects_make_vec4(d.x / way, d.y / way, d.z / way, light.w != 0.0f ? way : 1e29f);
}

// Does a ray of the world meet any of `count` frusta from `first`? For shadows.
static bool feffects_any_frusta(int first, int count, feffects_vec3 origin, feffects_vec3 direction, float t_min, float t_max, feffects_detail detail, float alpha_cut) {
    bool found = false;
    for (int k = first; k < first + count && !found; ++k) {
        feffects_frustum f = feffects_load(k);
        f = feffects_flatten(f, detail.fade);
        found = feffects_meet(f, feffects_place_into(f, origin), feffects_into(f, direction), t_min, t_max, alpha_cut).x <= t_max;
    }
    return found;
}

// What the effects tell of a hit.
static feffects_frustum_hit feffects_finish(feffects_frusta_effects e, feffects_frustum_hit hit, feffects_frustum f, feffects_vec3 p, feffects_vec3 direction, float width, feffects_detail detail) {
    if (hit.inside) hit.normal = feffects_make_vec3(-hit.normal.x, -hit.normal.y, -hit.normal.z);
    float w = feffects_dot(feffects_make_vec3(e.clip_w.x, e.clip_w.y, e.clip_w.z), hit.position) + e.clip_w.w;
    hit.depth = feffects_dot(feffects_make_vec3(e.clip_z.x, e.clip_z.y, e.clip_z.z), hit.position) + e.clip_z.w;
    hit.depth = w > 0.0f ? hit.depth / w : 0.0f;
    hit.gradient = feffects_footprint(f, p, direction, width);
    hit.fade = detail.fade;
    f = feffects_flatten(f, detail.fade);
    if (hit.cap == 0) hit.occlusion = feffects_openness(f, p);
    feffects_vec3 place = feffects_lift(f, p, hit.cap, hit.inside);
    feffects_vec4 light = feffects_light_from(e.light, place);
    bool dark = feffects_any_frusta(e.first, e.count, place, feffects_make_vec3(light.x, light.y, light.z), 0.0f, light.w, detail, e.alpha_cut);
    hit.shadow = dark ? 0.0f : 1.0f;
    return hit;
}

// The first hit of a ray of the world with `count` frusta from `first`.
static feffects_frustum_hit feffects_trace_frusta(feffects_frusta_effects e, int first, int count, feffects_vec3 origin, feffects_vec3 direction, float t_min,
                                           float t_max) {
    feffects_frustum_hit hit = feffects_no_frustum(t_max);
    float t = t_max;
    int nearest = -1, face = 0;
    float growth = e.pixel * sqrtf(feffects_dot(direction, direction));
    for (int k = first; k < first + count; ++k) {
        feffects_frustum f = feffects_load(k);
        feffects_vec3 o = feffects_place_into(f, origin), v = feffects_into(f, direction);
        feffects_detail detail = feffects_detail_of(e, f, o, v, feffects_make_vec2(t_min, t), feffects_make_vec2(0.0f, growth));
        f = feffects_flatten(f, detail.fade);
        feffects_vec2 met = feffects_meet(f, o, v, t_min, t, e.alpha_cut);
        if (met.x < t || (nearest < 0 && met.x <= t)) {
            t = met.x;
            nearest = k;
            face = (int)(met.y);
        }
    }
    if (nearest >= 0) {
        feffects_frustum f = feffects_load(nearest);
        feffects_vec3 o = feffects_place_into(f, origin), v = feffects_into(f, direction), p = feffects_along(o, v, t);
        feffects_detail detail = feffects_detail_of(e, f, o, v, feffects_make_vec2(t_min, t), feffects_make_vec2(0.0f, growth));
        hit = feffects_surface(f, nearest, p, face);
        hit.t = t;
        hit.inside = t <= t_min || face == 3;
        float width = growth * t;
        hit = feffects_finish(e, hit, f, p, direction, width, detail);
    }
    return hit;
}

// What a pixel sees of a frustum whose bounds were drawn there: `place` of the frame, from feffects_bounds; eye as
// feffects_eye, (position, 1) or for parallel rays (direction, 0). Rays begin at the bounds, not at the eye: single
// precision then holds however far the eye is.
static feffects_frustum_hit feffects_see_frustum(feffects_frusta_effects e, int frustum, feffects_vec3 place, feffects_vec4 eye) {
    feffects_frustum f = feffects_load(frustum);
    feffects_frustum_hit hit = feffects_no_frustum(0.0f);
    feffects_vec3 v = feffects_into(f, feffects_make_vec3(eye.x, eye.y, eye.z));
    float back = 1e30f; // how far the ray begins before the place
    feffects_vec2 pixel = feffects_make_vec2(e.pixel, 0.0f);
    if (eye.w != 0.0f) {
        feffects_vec3 from = feffects_place_into(f, feffects_make_vec3(eye.x, eye.y, eye.z));
        v = feffects_make_vec3(place.x - from.x, place.y - from.y, place.z - from.z);
        back = sqrtf(v.x * v.x + v.y * v.y + v.z * v.z);
        feffects_vec3 seen = feffects_along(feffects_place_out_of(f, place), feffects_make_vec3(eye.x, eye.y, eye.z), -1.0f);
        pixel = feffects_make_vec2(e.pixel * sqrtf(feffects_dot(seen, seen)), e.pixel * sqrtf(feffects_dot(seen, seen)) / back);
    }
    v = feffects_unit(v);
    feffects_detail detail = feffects_detail_of(e, f, place, v, feffects_make_vec2(-back, 1e30f), pixel);
    feffects_vec2 met = feffects_meet(feffects_flatten(f, detail.fade), place, v, -back, 1e30f, e.alpha_cut);
    if (met.x < 1e30f) {
        feffects_vec3 p = feffects_along(place, v, met.x);
        hit = feffects_surface(f, frustum, p, (int)(met.y));
        feffects_vec3 way = feffects_make_vec3(hit.position.x - eye.x, hit.position.y - eye.y, hit.position.z - eye.z);
        hit.t = eye.w != 0.0f ? sqrtf(way.x * way.x + way.y * way.y + way.z * way.z) : met.x;
        hit.inside = met.x <= -back || (int)(met.y) == 3;
        feffects_vec3 direction = eye.w != 0.0f ? way : feffects_make_vec3(eye.x, eye.y, eye.z);
        float width = pixel.x + pixel.y * met.x;
        hit = feffects_finish(e, hit, f, p, direction, width, detail);
    }
    return hit;
}

// Corner 0..7 of the pyramid around the shell, cut by the planes, in the frame.
static feffects_vec3 feffects_corner(feffects_frustum f, int corner) {
    float sx = (corner & 3) == 1 || (corner & 3) == 2 ? 1.0f : -1.0f, sz = (corner & 3) >= 2 ? 1.0f : -1.0f;
    feffects_vec2 cone = feffects_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float low = feffects_cut(f.lower, f.lower.x * sx + f.lower.y * sz, cone, 0.0f);
    float y = corner < 4 ? low : feffects_cut(f.upper, f.upper.x * sx + f.upper.y * sz, cone, 0.0f);
    float reach = fmaxf(cone.x + cone.y * y, 0.0f);
    return feffects_make_vec3(sx * reach, y, sz * reach);
}

// Vertex 0..35 of the twelve triangles around a frustum's shell, in its frame; see feffects_frustum_triangles.
static feffects_vec3 feffects_bounds(int frustum, int number) {
    static const int corners[36] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, 1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0};
    return feffects_corner(feffects_load(frustum), corners[number]);
}

