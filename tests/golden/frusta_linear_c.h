// conemap.h: frusta with relief, by equal steps with v linear.
// flinear_rows: the host's: row 0..8 of a conemap_frustum, as four integers
// flinear_fetch: the host's; height
#include <math.h>
#include <stdbool.h>


typedef struct flinear_ivec4 {
    int x, y, z, w;
} flinear_ivec4;

flinear_ivec4 flinear_rows(int frustum, int row);
float flinear_fetch(int i, int j);

typedef struct flinear_vec3 {
    float x, y, z;
} flinear_vec3;

typedef struct flinear_frustum_hit {
    bool found;
    bool inside; // the ray began inside
    int frustum, user; // that was hit; its `user`
    int cap; // 1, 2: the flat lower, upper end of a segment
    float t; // in lengths of the direction
    flinear_vec3 position;
    flinear_vec3 uvw; // of the frustum; v 0..1, w the height in the shell
    flinear_vec3 normal; // unit, of the surface as it is
    float shadow; // 0 dark to 1 lit
    float occlusion; // 0 closed to 1 open
    float level; // log2 of the texels under a pixel
} flinear_frustum_hit;

typedef struct flinear_vec4 {
    float x, y, z, w;
} flinear_vec4;

typedef struct flinear_frusta_effects {
    flinear_vec4 light; // towards the light, 0; or its position, 1
    int first, count; // frusta that throw shadows
    float light_radius; // radians, or the radius of the ball at a position
    float sky_reach; // what is farther away hides nothing
    int sky_directions;
    float pixel; // how wide a pixel is at distance 1 from the eye; of parallel rays, anywhere
    float lod_bias; // added to the level
    int lod_steps; // the step cap at level 0; 0: none
} flinear_frusta_effects;

static flinear_vec3 flinear_make_vec3(float x, float y, float z) {
    flinear_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static flinear_frustum_hit flinear_no_frustum(float t) {
    flinear_frustum_hit hit;
    hit.found = false;
    hit.inside = false;
    hit.frustum = -1;
    hit.user = 0;
    hit.cap = 0;
    hit.t = t;
    hit.position = flinear_make_vec3(0.0f, 0.0f, 0.0f);
    hit.uvw = hit.position;
    hit.normal = hit.position;
    hit.shadow = 1.0f;
    hit.occlusion = 1.0f;
    hit.level = 0.0f;
    return hit;
}

static float flinear_dot(flinear_vec3 a, flinear_vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

typedef struct flinear_frustum {
    flinear_vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates
    flinear_vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there
    flinear_vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth
    flinear_vec4 extent; // length of the axis; start and size in the map's v; twist
    flinear_ivec4 links; // parent, child, branch, sibling
    flinear_ivec4 more; // flags, u_repeat, user
} flinear_frustum;

static flinear_vec4 flinear_make_vec4(float x, float y, float z, float w) {
    flinear_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float flinear_real(int bits) {
    union {
        int whole;
        float real;
    } both;
    both.whole = bits;
    return both.real;
}

static flinear_vec4 flinear_real4(flinear_ivec4 bits) {
    return flinear_make_vec4(flinear_real(bits.x), flinear_real(bits.y), flinear_real(bits.z), flinear_real(bits.w));
}

// One of a frustum's nine rows, as integers: as floats, a unit could flush its small ones to 0.
static flinear_ivec4 flinear_row(int frustum, int row) {
    return flinear_rows(frustum, row);
}

static flinear_frustum flinear_load(int frustum) {
    flinear_frustum f;
    f.axis_x = flinear_real4(flinear_row(frustum, 0));
    f.axis_y = flinear_real4(flinear_row(frustum, 1));
    f.axis_z = flinear_real4(flinear_row(frustum, 2));
    f.lower = flinear_real4(flinear_row(frustum, 3));
    f.upper = flinear_real4(flinear_row(frustum, 4));
    f.radii = flinear_real4(flinear_row(frustum, 5));
    f.extent = flinear_real4(flinear_row(frustum, 6));
    f.links = flinear_row(frustum, 7);
    f.more = flinear_row(frustum, 8);
    return f;
}

// A direction of the world in the frustum's frame.
static flinear_vec3 flinear_into(flinear_frustum f, flinear_vec3 d) {
    return flinear_make_vec3(f.axis_x.x * d.x + f.axis_x.y * d.y + f.axis_x.z * d.z,
                f.axis_y.x * d.x + f.axis_y.y * d.y + f.axis_y.z * d.z,
                f.axis_z.x * d.x + f.axis_z.y * d.y + f.axis_z.z * d.z);
}

static flinear_vec3 flinear_place_into(flinear_frustum f, flinear_vec3 p) {
    return flinear_into(f, flinear_make_vec3(p.x - f.axis_x.w, p.y - f.axis_y.w, p.z - f.axis_z.w));
}

typedef struct flinear_detail { // what is seen of a shell's relief from far away
    float level; // log2 of the texels under a pixel
    int cap; // most steps
} flinear_detail;

typedef struct flinear_vec2 {
    float x, y;
} flinear_vec2;

// Narrows (from, to, face) to where g + gv t >= 0; a ray that enters there enters through `face`.
static flinear_vec3 flinear_half(flinear_vec3 span, float g, float gv, float face) {
    float t = gv != 0.0f ? -g / gv : 0.0f;
    if (gv > 0.0f && t > span.x) span = flinear_make_vec3(t, span.y, face);
    if (gv < 0.0f) span.y = fminf(span.y, t);
    if (gv == 0.0f && g < 0.0f) span.y = -1e30f;
    return span;
}

// Where a ray of the frame is between the cutting planes and inside a cone (radius at y = 0, its growth): from, to, and
// the face that it enters through, 0 the cone, 1 the lower plane, 2 the upper; nowhere if from > to. The quadratic is
// set up where the ray is nearest to the axis, its discriminant from the ray's moment about the axis, and solved in
// the form that does not cancel. There is no apex, so cylinders are nothing special, and no mirrored nappe.
static flinear_vec3 flinear_span(flinear_frustum f, flinear_vec2 cone, flinear_vec3 o, flinear_vec3 v, float t_min, float t_max) {
    float seam = 1e-6f * (f.extent.x + cone.x); // by so much neighbours overlap: rounding opens no gap
    flinear_vec3 span = flinear_make_vec3(t_min, t_max, 0.0f);
    span = flinear_half(span, o.y - f.lower.x * o.x - f.lower.y * o.z - f.lower.z + seam,
                        v.y - f.lower.x * v.x - f.lower.y * v.z, 1.0f);
    span = flinear_half(span, f.upper.x * o.x + f.upper.y * o.z + f.upper.z - o.y + seam,
                        f.upper.x * v.x + f.upper.y * v.z - v.y, 2.0f);
    float across = v.x * v.x + v.z * v.z;
    float at = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : span.x;
    at = fminf(fmaxf(at, span.x), span.y);
    float x = o.x + at * v.x, y = o.y + at * v.y, z = o.z + at * v.z, d = sqrtf(x * x + z * z);
    float radius = cone.x + cone.y * y, growth = cone.y * v.y, along = x * v.x + z * v.z;
    flinear_vec3 inside = flinear_half(flinear_make_vec3(span.x - at, span.y - at, span.z), radius, growth, 0.0f);
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
    if (first > inside.x) inside = flinear_make_vec3(first, inside.y, 0.0f);
    inside.y = fminf(inside.y, second);
    span = flinear_make_vec3(fmaxf(span.x, inside.x + at), fminf(span.y, inside.y + at), inside.z);
    return meets && inside.x <= inside.y ? span : flinear_make_vec3(1.0f, 0.0f, 0.0f);
}

static flinear_vec2 flinear_make_vec2(float x, float y) {
    flinear_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static flinear_vec3 flinear_along(flinear_vec3 o, flinear_vec3 v, float t) {
    return flinear_make_vec3(o.x + t * v.x, o.y + t * v.y, o.z + t * v.z);
}

// Where a ray enters the shell. pixel: how wide one is at t = 0, and its growth.
static flinear_detail flinear_detail_of(flinear_frusta_effects e, flinear_frustum f, flinear_vec3 o, flinear_vec3 v, flinear_vec2 range, flinear_vec2 pixel) {
    flinear_detail detail;
    flinear_vec3 outer = flinear_span(f, flinear_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, range.x, range.y);
    flinear_vec3 p = flinear_along(o, v, outer.x);
    float width = fmaxf(pixel.x + pixel.y * outer.x, 1e-30f);
    float around = f.radii.x + f.radii.z + (f.radii.y + f.radii.w) * p.y;
    float texels = fmaxf((float)(f.more.y) * 64.0f / fmaxf(6.28318531f * around, 1e-20f), fabsf(f.extent.z) * 48.0f / f.extent.x);
    detail.level = fmaxf(log2f(fmaxf(width * texels, 1e-30f)) + e.lod_bias, 0.0f);
    detail.cap = (int)(fmaxf(8.0f, ceilf((float)(e.lod_steps) * exp2f(-detail.level))));
    if (e.lod_steps == 0 || detail.cap > 100) detail.cap = 100;
    return detail;
}

// One for every 45 degrees between the cutting planes.
static int flinear_pieces(flinear_frustum f) {
    flinear_vec4 a = f.lower, b = f.upper;
    float c = (1.0f + a.x * b.x + a.y * b.y) / sqrtf((1.0f + a.x * a.x + a.y * a.y) * (1.0f + b.x * b.x + b.y * b.y));
    return c >= 0.7071f ? 1 : c >= 0.0f ? 2 : c >= -0.7071f ? 3 : 4;
}

typedef struct flinear_uvw { // a place in a frustum, with what it was computed from
    float u, v, w;
    float d, sine, cosine, thickness; // distance from the axis, direction from it; of the shell there
    flinear_vec2 cone; // that of the shell that goes through the place
    float low, high; // y where its straight line there meets the cutting planes
} flinear_uvw;

// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its growth) in the
// direction in which the plane rises by `tilt`.
static float flinear_cut(flinear_vec4 plane, float tilt, flinear_vec2 cone, float base) {
    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0f - cone.y * tilt);
}

// With exact_u, u is the eccentric anomaly of the cut's ellipse as seen along the axis. What that is counted
// from is e / (1 + sqrt(1 - e^2)) long, with the eccentricity e, and goes linearly with v.
static flinear_vec2 flinear_focus(flinear_frustum f, float v) {
    flinear_vec4 a = f.lower, b = f.upper;
    float k = f.radii.y, share = fminf(fmaxf(v, 0.0f), 1.0f);
    float low = k / (1.0f + sqrtf(fmaxf(1.0f - k * k * (a.x * a.x + a.y * a.y), 0.0f)));
    float high = k / (1.0f + sqrtf(fmaxf(1.0f - k * k * (b.x * b.x + b.y * b.y), 0.0f)));
    low *= 1.0f - share;
    high *= share;
    return flinear_make_vec2(low * a.x + high * b.x, low * a.y + high * b.y);
}

// The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. Within 1e-7.
static float flinear_turns(float x, float z) {
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
static float flinear_turns_of(flinear_frustum f, float x, float z, float v) {
    if ((f.more.x & 64) != 0) { // exact_u
        flinear_vec2 focus = flinear_focus(f, v);
        float gx = x - focus.x, gz = z - focus.y;
        float along = 2.0f * (x * gx + z * gz) / fmaxf(gx * gx + gz * gz, 1e-30f);
        x = along * gx - x;
        z = along * gz - z;
    }
    return flinear_turns(x, z);
}

static flinear_uvw flinear_locate(flinear_frustum f, flinear_vec3 p) {
    flinear_uvw at;
    at.d = sqrtf(p.x * p.x + p.z * p.z);
    at.sine = at.d > 0.0f ? p.x / at.d : 0.0f;
    at.cosine = at.d > 0.0f ? p.z / at.d : 1.0f;
    at.thickness = f.radii.z + f.radii.w * p.y;
    at.w = at.d - (f.radii.x + f.radii.y * p.y);
    if (at.thickness > 0.0f) at.w = at.w / at.thickness;
    float w = at.thickness > 0.0f ? fminf(fmaxf(at.w, -0.5f), 1.5f) : 0.0f;
    at.cone = flinear_make_vec2(f.radii.x + w * f.radii.z, f.radii.y + w * f.radii.w);
    at.low = flinear_cut(f.lower, f.lower.x * at.sine + f.lower.y * at.cosine, at.cone, 0.0f);
    at.high = flinear_cut(f.upper, f.upper.x * at.sine + f.upper.y * at.cosine, at.cone, 0.0f);
    at.v = at.high != at.low ? (p.y - at.low) / (at.high - at.low) : 0.0f;
    at.u = flinear_turns_of(f, at.sine, at.cosine, at.v);
    return at;
}

// Piece k of n of a ray in the shell, along which v is taken for linear: t and v of its ends.
static flinear_vec4 flinear_piece(flinear_frustum f, flinear_vec3 o, flinear_vec3 v, flinear_vec2 range, int k, int n) {
    float a = range.x + (range.y - range.x) * ((float)(k) / (float)(n));
    float b = k + 1 < n ? range.x + (range.y - range.x) * ((float)(k + 1) / (float)(n)) : range.y;
    flinear_uvw from = flinear_locate(f, flinear_along(o, v, a)), to = flinear_locate(f, flinear_along(o, v, b));
    return flinear_make_vec4(a, b, from.v, to.v);
}

// The map's u and v, not wrapped.
static flinear_vec2 flinear_map_place(flinear_frustum f, float u, float v) {
    float clamped = fminf(fmaxf(v, 0.0f), 1.0f);
    return flinear_make_vec2((u + clamped * f.extent.w) * (float)(f.more.y), f.extent.y + clamped * f.extent.z);
}

// The same in texels, from the centre of texel (0, 0).
static flinear_vec2 flinear_texels(flinear_frustum f, float u, float v) {
    flinear_vec2 at = flinear_map_place(f, u, v);
    at.y = fminf(fmaxf(at.y, 0.0f), 1.0f);
    return flinear_make_vec2((at.x - floorf(at.x)) * 64.0f - 0.5f, at.y * 48.0f - 0.5f);
}

static int flinear_repeat(int i, int size) {
    return i - (int)(floorf(((float)(i) + 0.5f) / (float)(size))) * size;
}

static int flinear_clampi(int i, int low, int high) {
    return i < low ? low : i > high ? high : i;
}

static float flinear_texel(int i, int j) {
    return flinear_fetch(flinear_repeat(i, 64), flinear_clampi(j, 0, 48 - 1));
}

static float flinear_mix(flinear_vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height of the relief.
static float flinear_relief(flinear_frustum f, float u, float v) {
    flinear_vec2 at = flinear_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y)), si = 1, sj = 1;
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    flinear_vec4 heights = flinear_make_vec4(flinear_texel(i, j), flinear_texel(i + si, j),
                        flinear_texel(i, j + sj), flinear_texel(i + si, j + sj));
    float height = flinear_mix(heights, x, y);
    return height;
}

// How far the ray is above the relief at t, in heights.
static float flinear_above(flinear_frustum f, flinear_vec3 o, flinear_vec3 v, float t, flinear_vec4 piece) {
    flinear_uvw at = flinear_locate(f, flinear_along(o, v, t));
    if (piece.y > piece.x) at.v = piece.z + (piece.w - piece.z) * ((t - piece.x) / (piece.y - piece.x));
    at.u = flinear_turns_of(f, at.sine, at.cosine, at.v);
    return at.w - flinear_relief(f, at.u, at.v);
}

// Equal steps, then halvings [BJCW09 section 3]: t where the ray meets the relief in a range of t, at its end if
// `solid`; 1e30: it does not.
static float flinear_march(flinear_frustum f, flinear_vec3 o, flinear_vec3 v, flinear_vec2 range, bool solid, int cap) {
    float before = range.x, t = range.x;
    bool met = false;
    int pieces = flinear_pieces(f), next = 1;
    flinear_vec4 piece = flinear_piece(f, o, v, range, 0, pieces);
    for (int k = 0; k <= cap; ++k) {
        t = k < cap ? range.x + (range.y - range.x) * ((float)(k) / (float)(cap)) : range.y;
        if (t > piece.y && next < pieces) {
            piece = flinear_piece(f, o, v, range, next, pieces);
            ++next;
        }
        met = (solid && k == cap) || flinear_above(f, o, v, t, piece) <= 0.0f;
        if (met) break;
        before = t;
    }
    for (int n = 0; met && n < 10; ++n) {
        float middle = 0.5f * (before + t);
        bool over = flinear_above(f, o, v, middle, piece) > 0.0f;
        before = over ? middle : before;
        t = over ? t : middle;
    }
    return met ? t : 1e30f;
}

// t where a ray of the frame meets the frustum's relief, 1e30 where it does not, and the face; see flinear_span.
static flinear_vec2 flinear_meet(flinear_frustum f, flinear_vec3 o, flinear_vec3 v, float t_min, float t_max, int cap) {
    flinear_vec3 inner = flinear_span(f, flinear_make_vec2(f.radii.x, f.radii.y), o, v, t_min, t_max), outer = inner;
    bool solid = inner.x <= inner.y, shell = f.radii.z > 0.0f || f.radii.w > 0.0f;
    if (shell) outer = flinear_span(f, flinear_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, t_min, t_max);
    if (solid && outer.x > outer.y) outer = inner; // by rounding, where there is no shell
    float t = outer.x <= outer.y ? outer.x : 1e30f;
    if (shell && outer.x <= outer.y)
        t = flinear_march(f, o, v, flinear_make_vec2(outer.x, solid ? fmaxf(inner.x, outer.x) : outer.y), solid, cap);
    return flinear_make_vec2(t, t > outer.x ? 0.0f : outer.z);
}

// A gradient of the frame in the world's; with the axes divided by their lengths twice, a direction.
static flinear_vec3 flinear_out_of(flinear_frustum f, flinear_vec3 n) {
    return flinear_make_vec3(f.axis_x.x * n.x + f.axis_y.x * n.y + f.axis_z.x * n.z,
                f.axis_x.y * n.x + f.axis_y.y * n.y + f.axis_z.y * n.z,
                f.axis_x.z * n.x + f.axis_y.z * n.y + f.axis_z.z * n.z);
}

static flinear_vec3 flinear_place_out_of(flinear_frustum f, flinear_vec3 p) {
    flinear_vec4 x = f.axis_x, y = f.axis_y, z = f.axis_z;
    flinear_vec3 d = flinear_out_of(f, flinear_make_vec3(p.x / (x.x * x.x + x.y * x.y + x.z * x.z),
                                    p.y / (y.x * y.x + y.y * y.y + y.z * y.z),
                                    p.z / (z.x * z.x + z.y * z.y + z.z * z.z)));
    return flinear_make_vec3(x.w + d.x, y.w + d.y, z.w + d.z);
}

typedef struct flinear_normals { // in the world, units
    flinear_vec3 plain; // of the surface as it is
} flinear_normals;

typedef struct flinear_uv_gradients { // of u, in radians, and of v, times the thickness
    flinear_vec3 u, v;
} flinear_uv_gradients;

// Gradient, times the thickness, of a cut's y: it moves with the angle and with w.
static flinear_vec3 flinear_cut_gradient(flinear_frustum f, flinear_vec4 plane, flinear_uvw at, float y, flinear_vec3 angle, flinear_vec3 w) {
    float tilt = plane.x * at.sine + plane.y * at.cosine, rest = 1.0f - at.cone.y * tilt;
    float a = (at.cone.x + at.cone.y * plane.z) / (rest * rest) * (plane.x * at.cosine - plane.y * at.sine);
    float b = at.thickness > 0.0f ? tilt * (f.radii.z + f.radii.w * y) / rest : 0.0f;
    return flinear_make_vec3(a * angle.x + b * w.x, a * angle.y + b * w.y, a * angle.z + b * w.z);
}

static flinear_uv_gradients flinear_find_gradients(flinear_frustum f, flinear_uvw at) {
    flinear_uv_gradients g;
    float by_d = at.thickness / at.d, span = at.high - at.low, rest = 1.0f - at.v;
    flinear_vec3 grad_w = flinear_make_vec3(at.sine, -at.cone.y, at.cosine);
    g.u = flinear_make_vec3(at.cosine * by_d, 0.0f, -at.sine * by_d);
    flinear_vec3 a = flinear_cut_gradient(f, f.lower, at, at.low, g.u, grad_w);
    flinear_vec3 b = flinear_cut_gradient(f, f.upper, at, at.high, g.u, grad_w);
    g.v = flinear_make_vec3(-(rest * a.x + at.v * b.x) / span, (at.thickness - rest * a.y - at.v * b.y) / span,
               -(rest * a.z + at.v * b.z) / span);
    if ((f.more.x & 64) != 0) { // exact_u
        flinear_vec2 focus = flinear_focus(f, at.v), low = flinear_focus(f, 0.0f), high = flinear_focus(f, 1.0f);
        float gx = at.sine - focus.x, gz = at.cosine - focus.y, way = fmaxf(gx * gx + gz * gz, 1e-30f);
        float by_angle = (1.0f - focus.x * focus.x - focus.y * focus.y) / way;
        float by_v = -2.0f * (gz * (high.x - low.x) - gx * (high.y - low.y)) / way;
        g.u = flinear_make_vec3(by_angle * g.u.x + by_v * g.v.x, by_angle * g.u.y + by_v * g.v.y, by_angle * g.u.z + by_v * g.v.z);
    }
    return g;
}

// Height of the relief, and what it grows by per turn of u and per v of the frustum.
static flinear_vec3 flinear_slopes(flinear_frustum f, float u, float v) {
    flinear_vec2 at = flinear_texels(f, u, v);
    int i = (int)(floorf(at.x)), j = (int)(floorf(at.y));
    float x = at.x - floorf(at.x), y = at.y - floorf(at.y);
    float a = flinear_texel(i, j), b = flinear_texel(i + 1, j);
    float c = flinear_texel(i, j + 1), d = flinear_texel(i + 1, j + 1);
    float low = b - a, high = d - c, by_u = (low + (high - low) * y) * 64.0f * (float)(f.more.y);
    float by_v = (c - a + (d - c - b + a) * x) * 48.0f * f.extent.z;
    return flinear_make_vec3(a + low * x + (c - a + (high - low) * x) * y, by_u, by_v + by_u * f.extent.w);
}

static flinear_vec3 flinear_unit(flinear_vec3 n) {
    float by = sqrtf(n.x * n.x + n.y * n.y + n.z * n.z);
    by = by > 0.0f ? 1.0f / by : 0.0f;
    return flinear_make_vec3(n.x * by, n.y * by, n.z * by);
}

static flinear_normals flinear_find_normals(flinear_frustum f, flinear_uvw at) {
    flinear_vec3 grad_w = flinear_make_vec3(at.sine, -at.cone.y, at.cosine); // all gradients times the thickness
    if (at.thickness > 0.0f && at.d > 1e-6f * f.extent.x) { // the relief's slopes
        flinear_uv_gradients g = flinear_find_gradients(f, at);
        flinear_vec3 slopes = flinear_slopes(f, at.u, at.v);
        float by_u = slopes.y * 0.159154943f, by_v = slopes.z;
        flinear_vec3 s = flinear_make_vec3(by_u * g.u.x + by_v * g.v.x, by_u * g.u.y + by_v * g.v.y, by_u * g.u.z + by_v * g.v.z);
        grad_w = flinear_make_vec3(grad_w.x - s.x, grad_w.y - s.y, grad_w.z - s.z);
    }
    flinear_normals n;
    n.plain = flinear_unit(flinear_out_of(f, grad_w));
    return n;
}

// Out of the lower (1) or upper (2) cutting plane.
static flinear_vec3 flinear_flat_end(flinear_frustum f, int face) {
    flinear_vec4 lower = f.lower, upper = f.upper;
    return face == 1 ? flinear_make_vec3(lower.x, -1.0f, lower.y) : flinear_make_vec3(-upper.x, 1.0f, -upper.y);
}

// All about a place where a ray of the frame meets a frustum.
static flinear_frustum_hit flinear_surface(flinear_frustum f, int frustum, flinear_vec3 p, int face) {
    flinear_frustum_hit hit = flinear_no_frustum(0.0f);
    flinear_uvw at = flinear_locate(f, p);
    int free_ends = face == 1 ? 1 + 2 + 8 : face == 2 ? 4 + 16 : 0;
    hit.found = true;
    hit.frustum = frustum;
    hit.user = f.more.z;
    hit.cap = (f.more.x & free_ends) != 0 ? face : 0; // elsewhere a plane that shows is the rounding of a seam
    hit.position = flinear_place_out_of(f, p);
    hit.uvw = flinear_make_vec3(at.u, fminf(fmaxf(at.v, 0.0f), 1.0f), at.w);
    flinear_normals n = flinear_find_normals(f, at);
    hit.normal = n.plain;
    if (hit.cap != 0) {
        hit.normal = flinear_unit(flinear_out_of(f, flinear_flat_end(f, face)));
    }
    return hit;
}

// The place of the world, just outside the surface, that light is looked at from.
static flinear_vec3 flinear_lift(flinear_frustum f, flinear_vec3 p, int cap) {
    flinear_uvw at = flinear_locate(f, p);
    float bias = 1e-5f * at.d + 3e-7f * (fabsf(f.axis_x.w) + fabsf(f.axis_y.w) + fabsf(f.axis_z.w) + f.extent.x);
    float out_to = at.d;
    if (at.thickness > 0.0f) {
        float height = flinear_relief(f, at.u, at.v) + 1.0f / 4096.0f;
        out_to = fmaxf(out_to, f.radii.x + f.radii.y * p.y + height * at.thickness);
    }
    out_to += bias;
    if (cap == 0) p = flinear_make_vec3(at.sine * out_to, p.y, at.cosine * out_to);
    else p = flinear_along(p, flinear_unit(flinear_flat_end(f, cap)), bias + 4e-6f * (f.extent.x + f.radii.x + f.radii.z));
    return flinear_place_out_of(f, p);
}

// The direction to the light, and how far it is.
static flinear_vec4 flinear_light_from(flinear_vec4 light, flinear_vec3 place) {
    flinear_vec3 d = flinear_make_vec3(light.x, light.y, light.z);
    if (light.w != 0.0f) d = flinear_along(d, place, -1.0f);
    float way = sqrtf(flinear_dot(d, d));
    return flinear_make_vec4(d.x / way, d.y / way, d.z / way, light.w != 0.0f ? way : 1e29f);
}

// Some direction at right angles to a unit vector.
static flinear_vec3 flinear_side_of(flinear_vec3 n) {
    return flinear_unit(fabsf(n.y) < 0.9f ? flinear_make_vec3(n.z, 0.0f, -n.x) : flinear_make_vec3(0.0f, n.z, -n.y));
}

static flinear_vec3 flinear_cross(flinear_vec3 a, flinear_vec3 b) {
    return flinear_make_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// Point k of n that cover the unit disc evenly.
static flinear_vec2 flinear_spread(int k, int n) {
    float r = sqrtf(((float)(k) + 0.5f) / (float)(n)), angle = 2.39996323f * (float)(k);
    return flinear_make_vec2(r * cosf(angle), r * sinf(angle));
}

// Does a ray of the world meet any of `count` frusta from `first`? For shadows.
static bool flinear_any_frusta(int first, int count, flinear_vec3 origin, flinear_vec3 direction, float t_min, float t_max, flinear_detail detail) {
    bool found = false;
    for (int k = first; k < first + count && !found; ++k) {
        flinear_frustum f = flinear_load(k);
        found = flinear_meet(f, flinear_place_into(f, origin), flinear_into(f, direction), t_min, t_max, detail.cap).x <= t_max;
    }
    return found;
}

// The share of n rays that meet nothing: their directions are axis * along and a point of the disc times `wide`.
static float flinear_free_rays(flinear_frusta_effects e, flinear_vec3 place, flinear_vec3 axis, float wide, bool dome, int n, float reach, flinear_detail detail) {
    flinear_vec3 side = flinear_side_of(axis), other = flinear_cross(axis, side);
    int clear = 0;
    for (int k = 0; k < n; ++k) {
        flinear_vec2 at = flinear_spread(k, n);
        float up = dome ? sqrtf(1.0f - at.x * at.x - at.y * at.y) : 1.0f;
        flinear_vec3 d = flinear_make_vec3(axis.x * up, axis.y * up, axis.z * up);
        d = flinear_unit(flinear_along(flinear_along(d, side, wide * at.x), other, wide * at.y));
        if (!flinear_any_frusta(e.first, e.count, place, d, 0.0f, reach, detail)) ++clear;
    }
    return (float)(clear) / (float)(n);
}

// What the effects tell of a hit.
static flinear_frustum_hit flinear_finish(flinear_frusta_effects e, flinear_frustum_hit hit, flinear_frustum f, flinear_vec3 p, flinear_detail detail) {
    hit.level = detail.level;
    flinear_vec3 place = flinear_lift(f, p, hit.cap);
    flinear_vec4 light = flinear_light_from(e.light, place);
    float wide = e.light.w != 0.0f ? fminf(e.light_radius / light.w, 1.0f) : e.light_radius;
    flinear_vec3 to_light = flinear_make_vec3(light.x, light.y, light.z);
    hit.shadow = flinear_free_rays(e, place, to_light, wide, false, 16, light.w, detail);
    float reach = e.sky_reach > 0.0f ? e.sky_reach : 1e29f;
    hit.occlusion = flinear_free_rays(e, place, hit.normal, 1.0f, true, e.sky_directions, reach, detail);
    return hit;
}

// The first hit of a ray of the world with `count` frusta from `first`.
static flinear_frustum_hit flinear_trace_frusta(flinear_frusta_effects e, int first, int count, flinear_vec3 origin, flinear_vec3 direction, float t_min,
                                           float t_max) {
    flinear_frustum_hit hit = flinear_no_frustum(t_max);
    float t = t_max;
    int nearest = -1, face = 0;
    float growth = e.pixel * sqrtf(flinear_dot(direction, direction));
    for (int k = first; k < first + count; ++k) {
        flinear_frustum f = flinear_load(k);
        flinear_vec3 o = flinear_place_into(f, origin), v = flinear_into(f, direction);
        flinear_detail detail = flinear_detail_of(e, f, o, v, flinear_make_vec2(t_min, t), flinear_make_vec2(0.0f, growth));
        flinear_vec2 met = flinear_meet(f, o, v, t_min, t, detail.cap);
        if (met.x < t || (nearest < 0 && met.x <= t)) {
            t = met.x;
            nearest = k;
            face = (int)(met.y);
        }
    }
    if (nearest >= 0) {
        flinear_frustum f = flinear_load(nearest);
        flinear_vec3 o = flinear_place_into(f, origin), v = flinear_into(f, direction), p = flinear_along(o, v, t);
        flinear_detail detail = flinear_detail_of(e, f, o, v, flinear_make_vec2(t_min, t), flinear_make_vec2(0.0f, growth));
        hit = flinear_surface(f, nearest, p, face);
        hit.t = t;
        hit.inside = t <= t_min;
        hit = flinear_finish(e, hit, f, p, detail);
    }
    return hit;
}

// What a pixel sees of a frustum whose bounds were drawn there: `place` of the frame, from flinear_bounds; eye as
// flinear_eye, (position, 1) or for parallel rays (direction, 0). Rays begin at the bounds, not at the eye: single
// precision then holds however far the eye is.
static flinear_frustum_hit flinear_see_frustum(flinear_frusta_effects e, int frustum, flinear_vec3 place, flinear_vec4 eye) {
    flinear_frustum f = flinear_load(frustum);
    flinear_frustum_hit hit = flinear_no_frustum(0.0f);
    flinear_vec3 v = flinear_into(f, flinear_make_vec3(eye.x, eye.y, eye.z));
    float back = 1e30f; // how far the ray begins before the place
    flinear_vec2 pixel = flinear_make_vec2(e.pixel, 0.0f);
    if (eye.w != 0.0f) {
        flinear_vec3 from = flinear_place_into(f, flinear_make_vec3(eye.x, eye.y, eye.z));
        v = flinear_make_vec3(place.x - from.x, place.y - from.y, place.z - from.z);
        back = sqrtf(v.x * v.x + v.y * v.y + v.z * v.z);
        flinear_vec3 seen = flinear_along(flinear_place_out_of(f, place), flinear_make_vec3(eye.x, eye.y, eye.z), -1.0f);
        pixel = flinear_make_vec2(e.pixel * sqrtf(flinear_dot(seen, seen)), e.pixel * sqrtf(flinear_dot(seen, seen)) / back);
    }
    v = flinear_unit(v);
    flinear_detail detail = flinear_detail_of(e, f, place, v, flinear_make_vec2(-back, 1e30f), pixel);
    flinear_vec2 met = flinear_meet(f, place, v, -back, 1e30f, detail.cap);
    if (met.x < 1e30f) {
        flinear_vec3 p = flinear_along(place, v, met.x);
        hit = flinear_surface(f, frustum, p, (int)(met.y));
        flinear_vec3 way = flinear_make_vec3(hit.position.x - eye.x, hit.position.y - eye.y, hit.position.z - eye.z);
        hit.t = eye.w != 0.0f ? sqrtf(way.x * way.x + way.y * way.y + way.z * way.z) : met.x;
        hit.inside = met.x <= -back;
        hit = flinear_finish(e, hit, f, p, detail);
    }
    return hit;
}

// Corner 0..7 of the pyramid around the shell, cut by the planes, in the frame.
static flinear_vec3 flinear_corner(flinear_frustum f, int corner) {
    float sx = (corner & 3) == 1 || (corner & 3) == 2 ? 1.0f : -1.0f, sz = (corner & 3) >= 2 ? 1.0f : -1.0f;
    flinear_vec2 cone = flinear_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float low = flinear_cut(f.lower, f.lower.x * sx + f.lower.y * sz, cone, 0.0f);
    float y = corner < 4 ? low : flinear_cut(f.upper, f.upper.x * sx + f.upper.y * sz, cone, 0.0f);
    float reach = fmaxf(cone.x + cone.y * y, 0.0f);
    return flinear_make_vec3(sx * reach, y, sz * reach);
}

// Vertex 0..35 of the twelve triangles around a frustum's shell, in its frame; see flinear_frustum_triangles.
static flinear_vec3 flinear_bounds(int frustum, int number) {
    static const int corners[36] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, 1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0};
    return flinear_corner(flinear_load(frustum), corners[number]);
}

