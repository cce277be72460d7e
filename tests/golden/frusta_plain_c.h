// conemap.h: plain frusta.
// fplain_rows: the host's: row 0..8 of a conemap_frustum, as four integers
#include <math.h>
#include <stdbool.h>


typedef struct fplain_ivec4 {
    int x, y, z, w;
} fplain_ivec4;

fplain_ivec4 fplain_rows(int frustum, int row);

typedef struct fplain_vec3 {
    float x, y, z;
} fplain_vec3;

typedef struct fplain_vec2 {
    float x, y;
} fplain_vec2;

typedef struct fplain_frustum_hit {
    bool found;
    bool inside; // the ray began inside
    int frustum, user; // that was hit; its `user`
    int cap; // 1, 2: the flat lower, upper end of a segment
    float t; // in lengths of the direction
    fplain_vec3 position;
    fplain_vec3 uvw; // of the frustum; v 0..1, w the height in the shell
    fplain_vec2 map; // u and v of the map, not wrapped
    fplain_vec3 normal, true_normal; // units: for shading, continuous across joints; of the surface as it is
} fplain_frustum_hit;

static fplain_vec3 fplain_make_vec3(float x, float y, float z) {
    fplain_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static fplain_vec2 fplain_make_vec2(float x, float y) {
    fplain_vec2 v;
    v.x = x;
    v.y = y;
    return v;
}

static fplain_frustum_hit fplain_no_frustum(float t) {
    fplain_frustum_hit hit;
    hit.found = false;
    hit.inside = false;
    hit.frustum = -1;
    hit.user = 0;
    hit.cap = 0;
    hit.t = t;
    hit.position = fplain_make_vec3(0.0f, 0.0f, 0.0f);
    hit.uvw = hit.position;
    hit.map = fplain_make_vec2(0.0f, 0.0f);
    hit.normal = hit.position;
    hit.true_normal = hit.position;
    return hit;
}

typedef struct fplain_vec4 {
    float x, y, z, w;
} fplain_vec4;

typedef struct fplain_frustum {
    fplain_vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates
    fplain_vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there
    fplain_vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth
    fplain_vec4 extent; // length of the axis; start and size in the map's v; twist
    fplain_ivec4 links; // parent, child, branch, sibling
    fplain_ivec4 more; // flags, u_repeat, user
} fplain_frustum;

static fplain_vec4 fplain_make_vec4(float x, float y, float z, float w) {
    fplain_vec4 v;
    v.x = x;
    v.y = y;
    v.z = z;
    v.w = w;
    return v;
}

static float fplain_real(int bits) {
    union {
        int whole;
        float real;
    } both;
    both.whole = bits;
    return both.real;
}

static fplain_vec4 fplain_real4(fplain_ivec4 bits) {
    return fplain_make_vec4(fplain_real(bits.x), fplain_real(bits.y), fplain_real(bits.z), fplain_real(bits.w));
}

// One of a frustum's nine rows, as integers: as floats, a unit could flush its small ones to 0.
static fplain_ivec4 fplain_row(int frustum, int row) {
    return fplain_rows(frustum, row);
}

static fplain_frustum fplain_load(int frustum) {
    fplain_frustum f;
    f.axis_x = fplain_real4(fplain_row(frustum, 0));
    f.axis_y = fplain_real4(fplain_row(frustum, 1));
    f.axis_z = fplain_real4(fplain_row(frustum, 2));
    f.lower = fplain_real4(fplain_row(frustum, 3));
    f.upper = fplain_real4(fplain_row(frustum, 4));
    f.radii = fplain_real4(fplain_row(frustum, 5));
    f.extent = fplain_real4(fplain_row(frustum, 6));
    f.links = fplain_row(frustum, 7);
    f.more = fplain_row(frustum, 8);
    return f;
}

// Narrows (from, to, face) to where g + gv t >= 0; a ray that enters there enters through `face`.
static fplain_vec3 fplain_half(fplain_vec3 span, float g, float gv, float face) {
    float t = gv != 0.0f ? -g / gv : 0.0f;
    if (gv > 0.0f && t > span.x) span = fplain_make_vec3(t, span.y, face);
    if (gv < 0.0f) span.y = fminf(span.y, t);
    if (gv == 0.0f && g < 0.0f) span.y = -1e30f;
    return span;
}

// Where a ray of the frame is between the cutting planes and inside a cone (radius at y = 0, its growth): from, to, and
// the face that it enters through, 0 the cone, 1 the lower plane, 2 the upper; nowhere if from > to. The quadratic is
// set up where the ray is nearest to the axis, its discriminant from the ray's moment about the axis, and solved in
// the form that does not cancel. There is no apex, so cylinders are nothing special, and no mirrored nappe.
static fplain_vec3 fplain_span(fplain_frustum f, fplain_vec2 cone, fplain_vec3 o, fplain_vec3 v, float t_min, float t_max) {
    float seam = 1e-6f * (f.extent.x + cone.x); // by so much neighbours overlap: rounding opens no gap
    fplain_vec3 span = fplain_make_vec3(t_min, t_max, 0.0f);
    span = fplain_half(span, o.y - f.lower.x * o.x - f.lower.y * o.z - f.lower.z + seam,
                        v.y - f.lower.x * v.x - f.lower.y * v.z, 1.0f);
    span = fplain_half(span, f.upper.x * o.x + f.upper.y * o.z + f.upper.z - o.y + seam,
                        f.upper.x * v.x + f.upper.y * v.z - v.y, 2.0f);
    float across = v.x * v.x + v.z * v.z;
    float at = across > 0.0f ? -(o.x * v.x + o.z * v.z) / across : span.x;
    at = fminf(fmaxf(at, span.x), span.y);
    float x = o.x + at * v.x, y = o.y + at * v.y, z = o.z + at * v.z, d = sqrtf(x * x + z * z);
    float radius = cone.x + cone.y * y, growth = cone.y * v.y, along = x * v.x + z * v.z;
    fplain_vec3 inside = fplain_half(fplain_make_vec3(span.x - at, span.y - at, span.z), radius, growth, 0.0f);
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
    if (first > inside.x) inside = fplain_make_vec3(first, inside.y, 0.0f);
    inside.y = fminf(inside.y, second);
    span = fplain_make_vec3(fmaxf(span.x, inside.x + at), fminf(span.y, inside.y + at), inside.z);
    return meets && inside.x <= inside.y ? span : fplain_make_vec3(1.0f, 0.0f, 0.0f);
}

// t where a ray of the frame meets the frustum, 1e30 where it does not, and the face; see fplain_span.
static fplain_vec2 fplain_meet(fplain_frustum f, fplain_vec3 o, fplain_vec3 v, float t_min, float t_max) {
    fplain_vec2 cone = fplain_make_vec2(f.radii.x + 4.00000006e-1f * f.radii.z, f.radii.y + 4.00000006e-1f * f.radii.w);
    fplain_vec3 span = fplain_span(f, cone, o, v, t_min, t_max);
    return span.x <= span.y ? fplain_make_vec2(span.x, span.z) : fplain_make_vec2(1e30f, 0.0f);
}

// A direction of the world in the frustum's frame.
static fplain_vec3 fplain_into(fplain_frustum f, fplain_vec3 d) {
    return fplain_make_vec3(f.axis_x.x * d.x + f.axis_x.y * d.y + f.axis_x.z * d.z,
                f.axis_y.x * d.x + f.axis_y.y * d.y + f.axis_y.z * d.z,
                f.axis_z.x * d.x + f.axis_z.y * d.y + f.axis_z.z * d.z);
}

static fplain_vec3 fplain_place_into(fplain_frustum f, fplain_vec3 p) {
    return fplain_into(f, fplain_make_vec3(p.x - f.axis_x.w, p.y - f.axis_y.w, p.z - f.axis_z.w));
}

static fplain_vec3 fplain_along(fplain_vec3 o, fplain_vec3 v, float t) {
    return fplain_make_vec3(o.x + t * v.x, o.y + t * v.y, o.z + t * v.z);
}

typedef struct fplain_uvw { // a place in a frustum, with what it was computed from
    float u, v, w;
    float d, sine, cosine, thickness; // distance from the axis, direction from it; of the shell there
    fplain_vec2 cone; // that of the shell that goes through the place
    float low, high; // y where its straight line there meets the cutting planes
} fplain_uvw;

// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its growth) in the
// direction in which the plane rises by `tilt`.
static float fplain_cut(fplain_vec4 plane, float tilt, fplain_vec2 cone, float base) {
    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0f - cone.y * tilt);
}

// With exact_u, u is the eccentric anomaly of the cut's ellipse as seen along the axis. What that is counted
// from is e / (1 + sqrt(1 - e^2)) long, with the eccentricity e, and goes linearly with v.
static fplain_vec2 fplain_focus(fplain_frustum f, float v) {
    fplain_vec4 a = f.lower, b = f.upper;
    float k = f.radii.y, share = fminf(fmaxf(v, 0.0f), 1.0f);
    float low = k / (1.0f + sqrtf(fmaxf(1.0f - k * k * (a.x * a.x + a.y * a.y), 0.0f)));
    float high = k / (1.0f + sqrtf(fmaxf(1.0f - k * k * (b.x * b.x + b.y * b.y), 0.0f)));
    low *= 1.0f - share;
    high *= share;
    return fplain_make_vec2(low * a.x + high * b.x, low * a.y + high * b.y);
}

// The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. Within 1e-7.
static float fplain_turns(float x, float z) {
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
static float fplain_turns_of(fplain_frustum f, float x, float z, float v) {
    if ((f.more.x & 64) != 0) { // exact_u
        fplain_vec2 focus = fplain_focus(f, v);
        float gx = x - focus.x, gz = z - focus.y;
        float along = 2.0f * (x * gx + z * gz) / fmaxf(gx * gx + gz * gz, 1e-30f);
        x = along * gx - x;
        z = along * gz - z;
    }
    return fplain_turns(x, z);
}

static fplain_uvw fplain_locate(fplain_frustum f, fplain_vec3 p) {
    fplain_uvw at;
    at.d = sqrtf(p.x * p.x + p.z * p.z);
    at.sine = at.d > 0.0f ? p.x / at.d : 0.0f;
    at.cosine = at.d > 0.0f ? p.z / at.d : 1.0f;
    at.thickness = f.radii.z + f.radii.w * p.y;
    at.w = at.d - (f.radii.x + f.radii.y * p.y);
    if (at.thickness > 0.0f) at.w = at.w / at.thickness;
    float w = at.thickness > 0.0f ? fminf(fmaxf(at.w, -0.5f), 1.5f) : 0.0f;
    at.cone = fplain_make_vec2(f.radii.x + w * f.radii.z, f.radii.y + w * f.radii.w);
    at.low = fplain_cut(f.lower, f.lower.x * at.sine + f.lower.y * at.cosine, at.cone, 0.0f);
    at.high = fplain_cut(f.upper, f.upper.x * at.sine + f.upper.y * at.cosine, at.cone, 0.0f);
    at.v = at.high != at.low ? (p.y - at.low) / (at.high - at.low) : 0.0f;
    at.u = fplain_turns_of(f, at.sine, at.cosine, at.v);
    return at;
}

// A gradient of the frame in the world's; with the axes divided by their lengths twice, a direction.
static fplain_vec3 fplain_out_of(fplain_frustum f, fplain_vec3 n) {
    return fplain_make_vec3(f.axis_x.x * n.x + f.axis_y.x * n.y + f.axis_z.x * n.z,
                f.axis_x.y * n.x + f.axis_y.y * n.y + f.axis_z.y * n.z,
                f.axis_x.z * n.x + f.axis_y.z * n.y + f.axis_z.z * n.z);
}

static fplain_vec3 fplain_place_out_of(fplain_frustum f, fplain_vec3 p) {
    fplain_vec4 x = f.axis_x, y = f.axis_y, z = f.axis_z;
    fplain_vec3 d = fplain_out_of(f, fplain_make_vec3(p.x / (x.x * x.x + x.y * x.y + x.z * x.z),
                                    p.y / (y.x * y.x + y.y * y.y + y.z * y.z),
                                    p.z / (z.x * z.x + z.y * z.y + z.z * z.z)));
    return fplain_make_vec3(x.w + d.x, y.w + d.y, z.w + d.z);
}

// The map's u and v, not wrapped.
static fplain_vec2 fplain_map_place(fplain_frustum f, float u, float v) {
    float clamped = fminf(fmaxf(v, 0.0f), 1.0f);
    return fplain_make_vec2((u + clamped * f.extent.w) * (float)(f.more.y), f.extent.y + clamped * f.extent.z);
}

typedef struct fplain_normals { // in the world, units
    fplain_vec3 shading; // continuous across joints
    fplain_vec3 plain; // of the surface as it is
} fplain_normals;

static fplain_vec3 fplain_unit(fplain_vec3 n) {
    float by = sqrtf(n.x * n.x + n.y * n.y + n.z * n.z);
    by = by > 0.0f ? 1.0f / by : 0.0f;
    return fplain_make_vec3(n.x * by, n.y * by, n.z * by);
}

// The surface normal at a cut [BJCW09 eq. 8]: away from the joint, leaning back along the plane's own normal.
static fplain_vec3 fplain_end_normal(fplain_frustum f, fplain_vec4 plane, fplain_uvw at, float joint) {
    float y = fplain_cut(plane, plane.x * at.sine + plane.y * at.cosine, at.cone, joint);
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
    return fplain_unit(fplain_make_vec3(radius * at.sine + lean * plane.x, y - lean, radius * at.cosine + lean * plane.y));
}

static fplain_normals fplain_find_normals(fplain_frustum f, fplain_uvw at) {
    fplain_vec3 grad_w = fplain_make_vec3(at.sine, -at.cone.y, at.cosine); // all gradients times the thickness
    fplain_vec3 low = fplain_end_normal(f, f.lower, at, 0.0f), high = fplain_end_normal(f, f.upper, at, f.extent.x);
    float m = fminf(fmaxf(at.v, 0.0f), 1.0f), steep = sqrtf(1.0f + at.cone.y * at.cone.y);
    if ((f.more.x & 32) != 0) m = m * m * (3.0f - 2.0f * m); // C1
    float l = 1.0f - m;
    fplain_vec3 smoothed = fplain_unit(fplain_make_vec3(l * low.x + m * high.x, l * low.y + m * high.y, l * low.z + m * high.z));
    smoothed = fplain_make_vec3(smoothed.x * steep, smoothed.y * steep, smoothed.z * steep);
    fplain_normals n;
    n.shading = fplain_unit(fplain_out_of(f, smoothed));
    n.plain = fplain_unit(fplain_out_of(f, grad_w));
    return n;
}

// Out of the lower (1) or upper (2) cutting plane.
static fplain_vec3 fplain_flat_end(fplain_frustum f, int face) {
    fplain_vec4 lower = f.lower, upper = f.upper;
    return face == 1 ? fplain_make_vec3(lower.x, -1.0f, lower.y) : fplain_make_vec3(-upper.x, 1.0f, -upper.y);
}

// All about a place where a ray of the frame meets a frustum.
static fplain_frustum_hit fplain_surface(fplain_frustum f, int frustum, fplain_vec3 p, int face) {
    fplain_frustum_hit hit = fplain_no_frustum(0.0f);
    fplain_uvw at = fplain_locate(f, p);
    int free_ends = face == 1 ? 1 + 2 + 8 : face == 2 ? 4 + 16 : 0;
    hit.found = true;
    hit.frustum = frustum;
    hit.user = f.more.z;
    hit.cap = (f.more.x & free_ends) != 0 ? face : 0; // elsewhere a plane that shows is the rounding of a seam
    hit.position = fplain_place_out_of(f, p);
    hit.uvw = fplain_make_vec3(at.u, fminf(fmaxf(at.v, 0.0f), 1.0f), at.w);
    hit.map = fplain_map_place(f, at.u, at.v);
    fplain_normals n = fplain_find_normals(f, at);
    hit.normal = n.shading;
    hit.true_normal = n.plain;
    if (hit.cap != 0) {
        hit.normal = fplain_unit(fplain_out_of(f, fplain_flat_end(f, face)));
        hit.true_normal = hit.normal;
    }
    return hit;
}

// The first hit of a ray of the world with `count` frusta from `first`.
static fplain_frustum_hit fplain_trace_frusta(int first, int count, fplain_vec3 origin, fplain_vec3 direction, float t_min,
                                           float t_max) {
    fplain_frustum_hit hit = fplain_no_frustum(t_max);
    float t = t_max;
    int nearest = -1, face = 0;
    for (int k = first; k < first + count; ++k) {
        fplain_frustum f = fplain_load(k);
        fplain_vec2 met = fplain_meet(f, fplain_place_into(f, origin), fplain_into(f, direction), t_min, t);
        if (met.x < t || (nearest < 0 && met.x <= t)) {
            t = met.x;
            nearest = k;
            face = (int)(met.y);
        }
    }
    if (nearest >= 0) {
        fplain_frustum f = fplain_load(nearest);
        fplain_vec3 p = fplain_along(fplain_place_into(f, origin), fplain_into(f, direction), t);
        hit = fplain_surface(f, nearest, p, face);
        hit.t = t;
        hit.inside = t <= t_min;
    }
    return hit;
}

// What a pixel sees of a frustum whose bounds were drawn there: `place` of the frame, from fplain_bounds; eye as
// fplain_eye, (position, 1) or for parallel rays (direction, 0). Rays begin at the bounds, not at the eye: single
// precision then holds however far the eye is.
static fplain_frustum_hit fplain_see_frustum(int frustum, fplain_vec3 place, fplain_vec4 eye) {
    fplain_frustum f = fplain_load(frustum);
    fplain_frustum_hit hit = fplain_no_frustum(0.0f);
    fplain_vec3 v = fplain_into(f, fplain_make_vec3(eye.x, eye.y, eye.z));
    float back = 1e30f; // how far the ray begins before the place
    if (eye.w != 0.0f) {
        fplain_vec3 from = fplain_place_into(f, fplain_make_vec3(eye.x, eye.y, eye.z));
        v = fplain_make_vec3(place.x - from.x, place.y - from.y, place.z - from.z);
        back = sqrtf(v.x * v.x + v.y * v.y + v.z * v.z);
    }
    v = fplain_unit(v);
    fplain_vec2 met = fplain_meet(f, place, v, -back, 1e30f);
    if (met.x < 1e30f) {
        hit = fplain_surface(f, frustum, fplain_along(place, v, met.x), (int)(met.y));
        fplain_vec3 way = fplain_make_vec3(hit.position.x - eye.x, hit.position.y - eye.y, hit.position.z - eye.z);
        hit.t = eye.w != 0.0f ? sqrtf(way.x * way.x + way.y * way.y + way.z * way.z) : met.x;
        hit.inside = met.x <= -back;
    }
    return hit;
}

// Corner 0..7 of the pyramid around the shell, cut by the planes, in the frame.
static fplain_vec3 fplain_corner(fplain_frustum f, int corner) {
    float sx = (corner & 3) == 1 || (corner & 3) == 2 ? 1.0f : -1.0f, sz = (corner & 3) >= 2 ? 1.0f : -1.0f;
    fplain_vec2 cone = fplain_make_vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float low = fplain_cut(f.lower, f.lower.x * sx + f.lower.y * sz, cone, 0.0f);
    float y = corner < 4 ? low : fplain_cut(f.upper, f.upper.x * sx + f.upper.y * sz, cone, 0.0f);
    float reach = fmaxf(cone.x + cone.y * y, 0.0f);
    return fplain_make_vec3(sx * reach, y, sz * reach);
}

// Vertex 0..35 of the twelve triangles around a frustum's shell, in its frame; see fplain_frustum_triangles.
static fplain_vec3 fplain_bounds(int frustum, int number) {
    static const int corners[36] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, 1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0};
    return fplain_corner(fplain_load(frustum), corners[number]);
}

