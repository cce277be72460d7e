#version 330 core
// conemap.h: frusta with relief, by cone steps.
// Draw 36 vertices for each frustum, no vertex buffer, one winding culled: either will do.
// conemap_frusta: rgba32i, nine texels for each conemap_frustum
// conemap_view_projection takes a column (position, 1) of the world; conemap_eye: (position, 1), or for
// parallel rays (direction, 0); conemap_first: the frustum of instance 0.

uniform isamplerBuffer conemap_frusta;
uniform mat4 conemap_view_projection;
uniform int conemap_first;

struct conemap_frustum {
    vec4 axis_x, axis_y, axis_z; // unit axes; the origin's coordinates
    vec4 lower, upper; // cutting planes y = a x + b z + c; slope of the normal there
    vec4 radii; // of the inner cone at y = 0, its growth; thickness of the shell there, its growth
    vec4 extent; // length of the axis; start and size in the map's v; twist
    ivec4 links; // parent, child, branch, sibling
    ivec4 more; // flags, u_repeat, user
};

// How far above y = base a cutting plane meets the straight line of a cone (radius at y = 0, its growth) in the
// direction in which the plane rises by `tilt`.
float conemap_cut(vec4 plane, float tilt, vec2 cone, float base) {
    return (plane.z - base + tilt * (cone.x + cone.y * base)) / (1.0 - cone.y * tilt);
}

// Corner 0..7 of the pyramid around the shell, cut by the planes, in the frame.
vec3 conemap_corner(conemap_frustum f, int corner) {
    float sx = (corner & 3) == 1 || (corner & 3) == 2 ? 1.0 : -1.0, sz = (corner & 3) >= 2 ? 1.0 : -1.0;
    vec2 cone = vec2(f.radii.x + f.radii.z, f.radii.y + f.radii.w);
    float low = conemap_cut(f.lower, f.lower.x * sx + f.lower.y * sz, cone, 0.0);
    float y = corner < 4 ? low : conemap_cut(f.upper, f.upper.x * sx + f.upper.y * sz, cone, 0.0);
    float reach = max(cone.x + cone.y * y, 0.0);
    return vec3(sx * reach, y, sz * reach);
}

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

// Vertex 0..35 of the twelve triangles around a frustum's shell, in its frame; see conemap_frustum_triangles.
vec3 conemap_bounds(int frustum, int number) {
    const int corners[36] = int[36](0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1, 1, 5, 6, 1, 6, 2, 2, 6, 7, 2, 7, 3, 3, 7, 4, 3, 4, 0);
    return conemap_corner(conemap_load(frustum), corners[number]);
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

out vec3 conemap_place; // in the frustum's frame
flat out int conemap_segment;

void main() {
    int frustum = conemap_first + gl_InstanceID;
    vec3 place = conemap_bounds(frustum, gl_VertexID);
    vec3 position = conemap_place_out_of(conemap_load(frustum), place);
    conemap_place = place;
    conemap_segment = frustum;
    gl_Position = conemap_view_projection * vec4(position, 1.0);
}
