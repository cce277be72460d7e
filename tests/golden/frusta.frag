#version 330 core
// conemap.h: frusta with relief, by cone steps.
// conemap_frusta: rgba32i, nine texels for each conemap_frustum
// conemap_map: rg32f, height and tan of the cone; only fetched
// conemap_view_projection takes a column (position, 1) of the world; conemap_eye: (position, 1), or for
// parallel rays (direction, 0); conemap_first: the frustum of instance 0.

uniform isamplerBuffer conemap_frusta;
uniform sampler2D conemap_map;
uniform mat4 conemap_view_projection;
uniform vec4 conemap_eye;

struct conemap_frustum_hit {
    bool found;
    bool inside; // the ray began inside
    int frustum, user; // that was hit; its `user`
    int cap; // 1, 2: the flat lower, upper end of a segment
    float t; // in lengths of the direction
    vec3 position;
    vec3 uvw; // of the frustum; v 0..1, w the height in the shell
    vec2 map; // u and v of the map, not wrapped
    vec3 normal, true_normal; // units: for shading, continuous across joints; of the surface as it is
};

struct conemap_frustum {
    vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates
    vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there
    vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth
    vec4 extent; // length of the axis; start and size in the map's v; twist
    ivec4 links; // parent, child, branch, sibling
    ivec4 more; // flags, u_repeat, user
};

vec4 conemap_real4(ivec4 bits) {
    return vec4(intBitsToFloat(bits.x), intBitsToFloat(bits.y), intBitsToFloat(bits.z), intBitsToFloat(bits.w));
}

// One of a frustum's nine rows, as integers: as floats, a unit could flush its small ones to 0.
ivec4 conemap_row(int frustum, int row) {
    return texelFetch(conemap_frusta, 9 * frustum + row);
}

conemap_frustum conemap_load(int frustum) {
    conemap_frustum f;
    f.axis_x = conemap_real4(conemap_row(frustum, 0));
    f.axis_y = conemap_real4(conemap_row(frustum, 1));
    f.axis_z = conemap_real4(conemap_row(frustum, 2));
    f.lower = conemap_real4(conemap_row(frustum, 3));
    f.upper = conemap_real4(conemap_row(frustum, 4));
    f.radii = conemap_real4(conemap_row(frustum, 5));
    f.extent = conemap_real4(conemap_row(frustum, 6));
    f.links = conemap_row(frustum, 7);
    f.more = conemap_row(frustum, 8);
    return f;
}

conemap_frustum_hit conemap_no_frustum(float t) {
    conemap_frustum_hit hit;
    hit.found = false;
    hit.inside = false;
    hit.frustum = -1;
    hit.user = 0;
    hit.cap = 0;
    hit.t = t;
    hit.position = vec3(0.0, 0.0, 0.0);
    hit.uvw = hit.position;
    hit.map = vec2(0.0, 0.0);
    hit.normal = hit.position;
    hit.true_normal = hit.position;
    return hit;
}

// A direction of the world in the frustum's frame.
vec3 conemap_into(conemap_frustum f, vec3 d) {
    return vec3(f.axis_x.x * d.x + f.axis_x.y * d.y + f.axis_x.z * d.z,
                f.axis_y.x * d.x + f.axis_y.y * d.y + f.axis_y.z * d.z,
                f.axis_z.x * d.x + f.axis_z.y * d.y + f.axis_z.z * d.z);
}

vec3 conemap_place_into(conemap_frustum f, vec3 p) {
    return conemap_into(f, vec3(p.x - f.axis_x.w, p.y - f.axis_y.w, p.z - f.axis_z.w));
}

vec3 conemap_unit(vec3 n) {
    float by = sqrt(n.x * n.x + n.y * n.y + n.z * n.z);
    by = by > 0.0 ? 1.0 / by : 0.0;
    return vec3(n.x * by, n.y * by, n.z * by);
}

// Narrows (from, to, face) to where g + gv t >= 0; a ray that enters there enters through `face`.
vec3 conemap_half(vec3 span, float g, float gv, float face) {
    float t = gv != 0.0 ? -g / gv : 0.0;
    if (gv > 0.0 && t > span.x) span = vec3(t, span.y, face);
    if (gv < 0.0) span.y = min(span.y, t);
    if (gv == 0.0 && g < 0.0) span.y = -1e30;
    return span;
}

// Where a ray of the frame is between the cutting planes and inside a cone (radius at y = 0, its growth): from, to, and
// the face that it enters through, 0 the cone, 1 the lower plane, 2 the upper; nowhere if from > to. The quadratic is
// set up where the ray is nearest to the axis, its discriminant from the ray's moment about the axis, and solved in
// the form that does not cancel. There is no apex, so cylinders are nothing special, and no mirrored nappe.
vec3 conemap_span(conemap_frustum f, vec2 cone, vec3 o, vec3 v, float t_min, float t_max) {
    float seam = 1e-6 * (f.extent.x + cone.x); // by so much neighbours overlap: rounding opens no gap
    vec3 span = vec3(t_min, t_max, 0.0);
    span = conemap_half(span, o.y - f.lower.x * o.x - f.lower.y * o.z - f.lower.z + seam,
                        v.y - f.lower.x * v.x - f.lower.y * v.z, 1.0);
    span = conemap_half(span, f.upper.x * o.x + f.upper.y * o.z + f.upper.z - o.y + seam,
                        f.upper.x * v.x + f.upper.y * v.z - v.y, 2.0);
    float across = v.x * v.x + v.z * v.z;
    float at = across > 0.0 ? -(o.x * v.x + o.z * v.z) / across : span.x;
    at = min(max(at, span.x), span.y);
    float x = o.x + at * v.x, y = o.y + at * v.y, z = o.z + at * v.z, d = sqrt(x * x + z * z);
    float radius = cone.x + cone.y * y, growth = cone.y * v.y, along = x * v.x + z * v.z;
    vec3 inside = conemap_half(vec3(span.x - at, span.y - at, span.z), radius, growth, 0.0);
    float a = across - growth * growth, b = along - radius * growth, c = (d - radius) * (d + radius);
    float reach = sqrt(across) * radius, moment = abs(x * v.z - z * v.x);
    float root = (reach - moment) * (reach + moment) + growth * (growth * d * d - 2.0 * along * radius);
    bool meets = span.x <= span.y && (root >= 0.0 || a <= 0.0); // or passes beside
    root = sqrt(max(root, 0.0));
    float q = b < 0.0 ? root - b : -root - b;
    float one = a != 0.0 ? q / a : q > 0.0 ? 1e30 : -1e30, two = q != 0.0 ? c / q : one;
    float first = min(one, two), second = max(one, two);
    if (a < 0.0) { // steeper than the cone: inside it beyond one root, the other is the mirrored nappe's
        second = growth > 0.0 ? 1e30 : first;
        first = growth > 0.0 ? max(one, two) : -1e30;
    }
    if (a == 0.0 && q == 0.0) { // along its straight lines
        first = -1e30;
        second = c > 0.0 ? -1e30 : 1e30;
    }
    if (first > inside.x) inside = vec3(first, inside.y, 0.0);
    inside.y = min(inside.y, second);
    span = vec3(max(span.x, inside.x + at), min(span.y, inside.y + at), inside.z);
    return meets && inside.x <= inside.y ? span : vec3(1.0, 0.0, 0.0);
}

struct conemap_shell { // what bounds how fast the map's place changes along a ray
    float turning, nearest; // |x' z - x z'|; t where the ray is nearest to the axis
    float by_v, span; // v moves at by_v / span at most: see conemap_bound_speed
    float stretch, twist; // u at stretch times the angle and twist times v
};

// With exact_u, u is the eccentric anomaly of the cut's ellipse as seen along the axis. What that is counted
// from is e / (1 + sqrt(1 - e^2)) long, with the eccentricity e, and goes linearly with v.
vec2 conemap_focus(conemap_frustum f, float v) {
    vec4 a = f.lower, b = f.upper;
    float k = f.radii.y, share = min(max(v, 0.0), 1.0);
    float low = k / (1.0 + sqrt(max(1.0 - k * k * (a.x * a.x + a.y * a.y), 0.0)));
    float high = k / (1.0 + sqrt(max(1.0 - k * k * (b.x * b.x + b.y * b.y), 0.0)));
    low *= 1.0 - share;
    high *= share;
    return vec2(low * a.x + high * b.x, low * a.y + high * b.y);
}

// The angle turns at |x' z - x z'| / d^2. Both cuts y = a x + b z + c, weighted as v weights them, move at no more
// than |(n_lower, n_upper)| / (1 - k n) times |(x, z)'| + k |y'|, n the slopes; span is the least way between them.
conemap_shell conemap_bound_speed(conemap_frustum f, vec3 o, vec3 v) {
    conemap_shell s;
    vec2 inner = vec2(f.radii.x, f.radii.y), outer = vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float lower = sqrt(f.lower.x * f.lower.x + f.lower.y * f.lower.y);
    float upper = sqrt(f.upper.x * f.upper.x + f.upper.y * f.upper.y);
    float da = f.upper.x - f.lower.x, db = f.upper.y - f.lower.y, n = max(lower, upper);
    float k = max(abs(inner.y), abs(outer.y)), vy = abs(v.y), across = v.x * v.x + v.z * v.z;
    s.turning = abs(v.x * o.z - o.x * v.z);
    s.nearest = across > 0.0 ? -(o.x * v.x + o.z * v.z) / across : 0.0;
    s.by_v = vy + sqrt(lower * lower + upper * upper) / (1.0 - k * n) * (sqrt(across) + k * vy);
    s.span = max(outer.x + outer.y * f.lower.z, inner.x + inner.y * f.lower.z) / (1.0 - k * lower);
    s.span = (f.upper.z - f.lower.z - s.span * sqrt(da * da + db * db)) / (1.0 + k * upper);
    s.stretch = 1.0;
    s.twist = abs(f.extent.w);
    if ((f.more.x & 64) != 0) { // exact_u
        vec2 a = conemap_focus(f, 0.0), b = conemap_focus(f, 1.0);
        float longer = sqrt(max(a.x * a.x + a.y * a.y, b.x * b.x + b.y * b.y));
        da = b.x - a.x;
        db = b.y - a.y;
        s.stretch = (1.0 + longer) / (1.0 - longer);
        s.twist += 0.318309886 * sqrt(da * da + db * db) / (1.0 - longer);
    }
    return s;
}

struct conemap_uvw { // a place in a frustum, with what it was computed from
    float u, v, w;
    float d, sine, cosine, thickness; // distance from the axis, direction from it; of the shell there
    vec2 cone; // that of the shell that goes through the place
    float low, high; // y where its straight line there meets the cutting planes
};

// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its growth) in the
// direction in which the plane rises by `tilt`.
float conemap_cut(vec4 plane, float tilt, vec2 cone, float base) {
    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0 - cone.y * tilt);
}

// The angle of (x, z) in turns, 0..1: 0 along z, 1/4 along x. Within 1e-7.
float conemap_turns(float x, float z) {
    float ax = abs(x), az = abs(z), large = max(ax, az), a = large > 0.0 ? min(ax, az) / large : 0.0;
    float base = a > 0.414213562 ? 0.125 : 0.0; // turned back by an eighth
    if (base > 0.0) a = (a - 1.0) / (a + 1.0);
    float s = a * a;
    float turns = base + a * (0.15915485 + s * (-0.05303445 + s * (0.03131805 - s * 0.01766679)));
    if (ax > az) turns = 0.25 - turns;
    if (z < 0.0) turns = 0.5 - turns;
    return x < 0.0 ? 1.0 - turns : turns;
}

// u of a place in the direction (x, z), a unit, from the axis.
float conemap_turns_of(conemap_frustum f, float x, float z, float v) {
    if ((f.more.x & 64) != 0) { // exact_u
        vec2 focus = conemap_focus(f, v);
        float gx = x - focus.x, gz = z - focus.y;
        float along = 2.0 * (x * gx + z * gz) / max(gx * gx + gz * gz, 1e-30);
        x = along * gx - x;
        z = along * gz - z;
    }
    return conemap_turns(x, z);
}

conemap_uvw conemap_locate(conemap_frustum f, vec3 p) {
    conemap_uvw at;
    at.d = sqrt(p.x * p.x + p.z * p.z);
    at.sine = at.d > 0.0 ? p.x / at.d : 0.0;
    at.cosine = at.d > 0.0 ? p.z / at.d : 1.0;
    at.thickness = f.radii.z + f.radii.w * p.y;
    at.w = at.d - (f.radii.x + f.radii.y * p.y);
    if (at.thickness > 0.0) at.w = at.w / at.thickness;
    float w = at.thickness > 0.0 ? min(max(at.w, -0.5), 1.5) : 0.0;
    at.cone = vec2(f.radii.x + w * f.radii.z, f.radii.y + w * f.radii.w);
    at.low = conemap_cut(f.lower, f.lower.x * at.sine + f.lower.y * at.cosine, at.cone, 0.0);
    at.high = conemap_cut(f.upper, f.upper.x * at.sine + f.upper.y * at.cosine, at.cone, 0.0);
    at.v = at.high != at.low ? (p.y - at.low) / (at.high - at.low) : 0.0;
    at.u = conemap_turns_of(f, at.sine, at.cosine, at.v);
    return at;
}

vec3 conemap_along(vec3 o, vec3 v, float t) {
    return vec3(o.x + t * v.x, o.y + t * v.y, o.z + t * v.z);
}

// The map's u and v, not wrapped.
vec2 conemap_map_place(conemap_frustum f, float u, float v) {
    float clamped = min(max(v, 0.0), 1.0);
    return vec2((u + clamped * f.extent.w) * float(f.more.y), f.extent.y + clamped * f.extent.z);
}

// The same in texels, from the centre of texel (0, 0).
vec2 conemap_texels(conemap_frustum f, float u, float v, ivec2 size) {
    vec2 at = conemap_map_place(f, u, v);
    at.y -= floor(at.y);
    return vec2((at.x - floor(at.x)) * float(size.x) - 0.5, at.y * float(size.y) - 0.5);
}

int conemap_repeat(int i, int size) {
    return i - int(floor((float(i) + 0.5) / float(size))) * size;
}

vec2 conemap_texel(int i, int j, ivec2 size) {
    return texelFetch(conemap_map, ivec2(conemap_repeat(i, size.x), conemap_repeat(j, size.y)), 0).rg;
}

float conemap_mix(vec4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// Height of the relief, and tangent of the cone there.
vec2 conemap_relief(conemap_frustum f, float u, float v) {
    ivec2 size = textureSize(conemap_map, 0);
    vec2 at = conemap_texels(f, u, v, size);
    int i = int(floor(at.x)), j = int(floor(at.y)), si = 1, sj = 1;
    float x = at.x - floor(at.x), y = at.y - floor(at.y);
    vec2 a = conemap_texel(i, j, size), b = conemap_texel(i + si, j, size);
    vec2 c = conemap_texel(i, j + sj, size), d = conemap_texel(i + si, j + sj, size);
    vec4 heights = vec4(a.x, b.x, c.x, d.x);
    float height = conemap_mix(heights, x, y);
    float cone = conemap_mix(vec4(a.y, b.y, c.y, d.y), x, y);
    return vec2(height, cone);
}

// How fast the map's place changes at most, from t to t_end.
float conemap_map_speed(conemap_frustum f, conemap_shell s, vec3 o, vec3 v, float t, float t_end) {
    vec3 p = conemap_along(o, v, min(max(s.nearest, t), t_end));
    float d2 = p.x * p.x + p.z * p.z;
    float angle = s.turning / max(d2, 1e-30), by_v = s.by_v / s.span;
    float by_u = (s.stretch * angle * 0.159154943 + by_v * s.twist) * float(f.more.y);
    by_v *= abs(f.extent.z);
    return s.span > 0.0 && d2 > 0.0 ? sqrt(by_u * by_u + by_v * by_v) : 1e30;
}

// How far the ray is above the relief at t, in heights.
float conemap_above(conemap_frustum f, vec3 o, vec3 v, float t) {
    conemap_uvw at = conemap_locate(f, conemap_along(o, v, t));
    return at.w - conemap_relief(f, at.u, at.v).x;
}

// Cone steps, none shorter than one of 256 equal ones, then halvings: t where the ray meets the relief in a range
// of t, at its end if `solid`; 1e30: it does not. The ray is g above the cone's apex, in the world's units, and
// meets nothing while g + g' t > thickness speed t / tangent.
float conemap_march(conemap_frustum f, vec3 o, vec3 v, vec2 range, bool solid) {
    float before = range.x, t = range.x;
    bool met = false;
    float least = (range.y - range.x) / float(256);
    float thick_end = f.radii.z + f.radii.w * (o.y + range.y * v.y);
    conemap_shell shell = conemap_bound_speed(f, o, v);
    for (int k = 0; k <= 256; ++k) {
        conemap_uvw at = conemap_locate(f, conemap_along(o, v, t));
        vec2 relief = conemap_relief(f, at.u, at.v);
        met = at.w <= relief.x || (solid && t >= range.y);
        if (met || t >= range.y) break;
        float apex = relief.x + 1.0 / 1048576.0, g = (at.w - apex) * at.thickness;
        float slope = at.sine * v.x + at.cosine * v.z - (f.radii.y + f.radii.w * apex) * v.y;
        float closing = max(at.thickness, thick_end) * conemap_map_speed(f, shell, o, v, t, range.y);
        closing -= relief.y * slope;
        before = t;
        t += max(g <= 0.0 ? 0.0 : closing > 0.0 ? relief.y * g / closing : 1e30, least);
        if (t > range.y || k + 1 >= 256) t = range.y;
    }
    for (int n = 0; met && n < 10; ++n) {
        float middle = 0.5 * (before + t);
        bool over = conemap_above(f, o, v, middle) > 0.0;
        before = over ? middle : before;
        t = over ? t : middle;
    }
    return met ? t : 1e30;
}

// t where a ray of the frame meets the frustum's relief, 1e30 where it does not, and the face; see conemap_span.
vec2 conemap_meet(conemap_frustum f, vec3 o, vec3 v, float t_min, float t_max) {
    vec3 inner = conemap_span(f, vec2(f.radii.x, f.radii.y), o, v, t_min, t_max), outer = inner;
    bool solid = inner.x <= inner.y, shell = f.radii.z > 0.0 || f.radii.w > 0.0;
    if (shell) outer = conemap_span(f, vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w), o, v, t_min, t_max);
    if (solid && outer.x > outer.y) outer = inner; // by rounding, where there is no shell
    float t = outer.x <= outer.y ? outer.x : 1e30;
    if (shell && outer.x <= outer.y)
        t = conemap_march(f, o, v, vec2(outer.x, solid ? max(inner.x, outer.x) : outer.y), solid);
    return vec2(t, t > outer.x ? 0.0 : outer.z);
}

// A gradient of the frame in the world's; with the axes divided by their lengths twice, a direction.
vec3 conemap_out_of(conemap_frustum f, vec3 n) {
    return vec3(f.axis_x.x * n.x + f.axis_y.x * n.y + f.axis_z.x * n.z,
                f.axis_x.y * n.x + f.axis_y.y * n.y + f.axis_z.y * n.z,
                f.axis_x.z * n.x + f.axis_y.z * n.y + f.axis_z.z * n.z);
}

vec3 conemap_place_out_of(conemap_frustum f, vec3 p) {
    vec4 x = f.axis_x, y = f.axis_y, z = f.axis_z;
    vec3 d = conemap_out_of(f, vec3(p.x / (x.x * x.x + x.y * x.y + x.z * x.z),
                                    p.y / (y.x * y.x + y.y * y.y + y.z * y.z),
                                    p.z / (z.x * z.x + z.y * z.y + z.z * z.z)));
    return vec3(x.w + d.x, y.w + d.y, z.w + d.z);
}

struct conemap_normals { // in the world, units
    vec3 shading; // continuous across joints
    vec3 plain; // of the surface as it is
};

// The surface normal at a cut [BJCW09 eq. 8]: away from the joint, leaning back along the plane's own normal.
vec3 conemap_end_normal(conemap_frustum f, vec4 plane, conemap_uvw at, float joint) {
    float y = conemap_cut(plane, plane.x * at.sine + plane.y * at.cosine, at.cone, joint);
    float radius = at.cone.x + at.cone.y * joint + at.cone.y * y;
    float wide_x = f.axis_x.x * f.axis_x.x + f.axis_x.y * f.axis_x.y + f.axis_x.z * f.axis_x.z; // 1 if round
    float wide_z = f.axis_z.x * f.axis_z.x + f.axis_z.y * f.axis_z.y + f.axis_z.z * f.axis_z.z;
    y += radius * (plane.x * at.sine * (wide_x - 1.0) + plane.y * at.cosine * (wide_z - 1.0));
    if (!(radius > 1e-6 * (f.radii.x + f.radii.z + f.extent.x))) { // the end is a point: the limit
        radius = 1.0;
        y = 0.0;
    }
    float across = at.sine * at.sine * wide_x + at.cosine * at.cosine * wide_z;
    float size = sqrt(radius * radius * across + y * y);
    float lean = plane.w * size / sqrt(1.0 + plane.x * plane.x * wide_x + plane.y * plane.y * wide_z);
    return conemap_unit(vec3(radius * at.sine + lean * plane.x, y - lean, radius * at.cosine + lean * plane.y));
}

struct conemap_uv_gradients { // of u, in radians, and of v, times the thickness
    vec3 u, v;
};

// Gradient, times the thickness, of a cut's y: it moves with the angle and with w.
vec3 conemap_cut_gradient(conemap_frustum f, vec4 plane, conemap_uvw at, float y, vec3 angle, vec3 w) {
    float tilt = plane.x * at.sine + plane.y * at.cosine, rest = 1.0 - at.cone.y * tilt;
    float a = (at.cone.x + at.cone.y * plane.z) / (rest * rest) * (plane.x * at.cosine - plane.y * at.sine);
    float b = at.thickness > 0.0 ? tilt * (f.radii.z + f.radii.w * y) / rest : 0.0;
    return vec3(a * angle.x + b * w.x, a * angle.y + b * w.y, a * angle.z + b * w.z);
}

conemap_uv_gradients conemap_find_gradients(conemap_frustum f, conemap_uvw at) {
    conemap_uv_gradients g;
    float by_d = at.thickness / at.d, span = at.high - at.low, rest = 1.0 - at.v;
    vec3 grad_w = vec3(at.sine, -at.cone.y, at.cosine);
    g.u = vec3(at.cosine * by_d, 0.0, -at.sine * by_d);
    vec3 a = conemap_cut_gradient(f, f.lower, at, at.low, g.u, grad_w);
    vec3 b = conemap_cut_gradient(f, f.upper, at, at.high, g.u, grad_w);
    g.v = vec3(-(rest * a.x + at.v * b.x) / span, (at.thickness - rest * a.y - at.v * b.y) / span,
               -(rest * a.z + at.v * b.z) / span);
    if ((f.more.x & 64) != 0) { // exact_u
        vec2 focus = conemap_focus(f, at.v), low = conemap_focus(f, 0.0), high = conemap_focus(f, 1.0);
        float gx = at.sine - focus.x, gz = at.cosine - focus.y, way = max(gx * gx + gz * gz, 1e-30);
        float by_angle = (1.0 - focus.x * focus.x - focus.y * focus.y) / way;
        float by_v = -2.0 * (gz * (high.x - low.x) - gx * (high.y - low.y)) / way;
        g.u = vec3(by_angle * g.u.x + by_v * g.v.x, by_angle * g.u.y + by_v * g.v.y, by_angle * g.u.z + by_v * g.v.z);
    }
    return g;
}

// Height of the relief, and what it grows by per turn of u and per v of the frustum.
vec3 conemap_slopes(conemap_frustum f, float u, float v) {
    ivec2 size = textureSize(conemap_map, 0);
    vec2 at = conemap_texels(f, u, v, size);
    int i = int(floor(at.x)), j = int(floor(at.y));
    float x = at.x - floor(at.x), y = at.y - floor(at.y);
    float a = conemap_texel(i, j, size).x, b = conemap_texel(i + 1, j, size).x;
    float c = conemap_texel(i, j + 1, size).x, d = conemap_texel(i + 1, j + 1, size).x;
    float low = b - a, high = d - c, by_u = (low + (high - low) * y) * float(size.x) * float(f.more.y);
    float by_v = (c - a + (d - c - b + a) * x) * float(size.y) * f.extent.z;
    return vec3(a + low * x + (c - a + (high - low) * x) * y, by_u, by_v + by_u * f.extent.w);
}

conemap_normals conemap_find_normals(conemap_frustum f, conemap_uvw at) {
    vec3 grad_w = vec3(at.sine, -at.cone.y, at.cosine); // all gradients times the thickness
    vec3 low = conemap_end_normal(f, f.lower, at, 0.0), high = conemap_end_normal(f, f.upper, at, f.extent.x);
    float m = min(max(at.v, 0.0), 1.0), steep = sqrt(1.0 + at.cone.y * at.cone.y);
    if ((f.more.x & 32) != 0) m = m * m * (3.0 - 2.0 * m); // C1
    float l = 1.0 - m;
    vec3 smoothed = conemap_unit(vec3(l * low.x + m * high.x, l * low.y + m * high.y, l * low.z + m * high.z));
    smoothed = vec3(smoothed.x * steep, smoothed.y * steep, smoothed.z * steep);
    if (at.thickness > 0.0 && at.d > 1e-6 * f.extent.x) { // the relief's slopes
        conemap_uv_gradients g = conemap_find_gradients(f, at);
        vec3 slopes = conemap_slopes(f, at.u, at.v);
        float by_u = slopes.y * 0.159154943, by_v = slopes.z;
        vec3 s = vec3(by_u * g.u.x + by_v * g.v.x, by_u * g.u.y + by_v * g.v.y, by_u * g.u.z + by_v * g.v.z);
        grad_w = vec3(grad_w.x - s.x, grad_w.y - s.y, grad_w.z - s.z);
        smoothed = vec3(smoothed.x - s.x, smoothed.y - s.y, smoothed.z - s.z);
    }
    conemap_normals n;
    n.shading = conemap_unit(conemap_out_of(f, smoothed));
    n.plain = conemap_unit(conemap_out_of(f, grad_w));
    return n;
}

// Out of the lower (1) or upper (2) cutting plane.
vec3 conemap_flat_end(conemap_frustum f, int face) {
    vec4 lower = f.lower, upper = f.upper;
    return face == 1 ? vec3(lower.x, -1.0, lower.y) : vec3(-upper.x, 1.0, -upper.y);
}

// All about a place where a ray of the frame meets a frustum.
conemap_frustum_hit conemap_surface(conemap_frustum f, int frustum, vec3 p, int face) {
    conemap_frustum_hit hit = conemap_no_frustum(0.0);
    conemap_uvw at = conemap_locate(f, p);
    int free_ends = face == 1 ? 1 + 2 + 8 : face == 2 ? 4 + 16 : 0;
    hit.found = true;
    hit.frustum = frustum;
    hit.user = f.more.z;
    hit.cap = (f.more.x & free_ends) != 0 ? face : 0; // elsewhere a plane that shows is the rounding of a seam
    hit.position = conemap_place_out_of(f, p);
    hit.uvw = vec3(at.u, min(max(at.v, 0.0), 1.0), at.w);
    hit.map = conemap_map_place(f, at.u, at.v);
    conemap_normals n = conemap_find_normals(f, at);
    hit.normal = n.shading;
    hit.true_normal = n.plain;
    if (hit.cap != 0) {
        hit.normal = conemap_unit(conemap_out_of(f, conemap_flat_end(f, face)));
        hit.true_normal = hit.normal;
    }
    return hit;
}

// What a pixel sees of a frustum whose bounds were drawn there: `place` of the frame, from conemap_bounds; eye as
// conemap_eye, (position, 1) or for parallel rays (direction, 0). Rays begin at the bounds, not at the eye: single
// precision then holds however far the eye is.
conemap_frustum_hit conemap_see_frustum(int frustum, vec3 place, vec4 eye) {
    conemap_frustum f = conemap_load(frustum);
    conemap_frustum_hit hit = conemap_no_frustum(0.0);
    vec3 v = conemap_into(f, vec3(eye.x, eye.y, eye.z));
    float back = 1e30; // how far the ray begins before the place
    if (eye.w != 0.0) {
        vec3 from = conemap_place_into(f, vec3(eye.x, eye.y, eye.z));
        v = vec3(place.x - from.x, place.y - from.y, place.z - from.z);
        back = sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
    }
    v = conemap_unit(v);
    vec2 met = conemap_meet(f, place, v, -back, 1e30);
    if (met.x < 1e30) {
        hit = conemap_surface(f, frustum, conemap_along(place, v, met.x), int(met.y));
        vec3 way = vec3(hit.position.x - eye.x, hit.position.y - eye.y, hit.position.z - eye.z);
        hit.t = eye.w != 0.0 ? sqrt(way.x * way.x + way.y * way.y + way.z * way.z) : met.x;
        hit.inside = met.x <= -back;
    }
    return hit;
}

in vec3 conemap_place; // in the frustum's frame
flat in int conemap_segment;
layout(location = 0) out vec4 conemap_normal; // for shading; w: height in the shell
layout(location = 1) out vec4 conemap_coordinates; // u, v of the map; frustum; t

void main() {
    conemap_frustum_hit hit = conemap_see_frustum(conemap_segment, conemap_place, conemap_eye);
    if (!hit.found) discard;
    vec4 clip = conemap_view_projection * vec4(hit.position, 1.0);
    gl_FragDepth = 0.5 * clip.z / clip.w + 0.5;
    conemap_normal = vec4(hit.normal, hit.uvw.z);
    conemap_coordinates = vec4(hit.map, float(hit.frustum), hit.t);
}
