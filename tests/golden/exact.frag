#version 330 core
// conemap.h: exact tracer. A ray lives in the unit box over the map: u, v, z; t counts in lengths of its direction.
// conemap_trace(origin, direction): where a ray first hits the relief, (u, v, z, t); t is -1 if nowhere.
// conemap_map: rg32f, height and tan of the cone; only fetched
uniform sampler2D conemap_map;

vec2 conemap_clip(vec2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0) return vec2(range.x, o >= low && o <= high ? range.y : -1e30);
    return vec2(max(range.x, min(a, b)), min(range.y, max(a, b)));
}

vec2 conemap_texel(int i, int j, ivec2 size) {
    return texelFetch(conemap_map, ivec2(clamp(i, 0, size.x - 1), clamp(j, 0, size.y - 1)), 0).rg;
}

// First t in 0..end at which a ray from (x, y), c above a bilinear patch, meets it, or -1: a root of c + b t + a t t.
float conemap_patch_hit(vec4 h, float x, float y, float c, vec3 v, float end) {
    float hx = h.y - h.x, hy = h.z - h.x, hxy = h.w - h.z - hx;
    float b = v.z - hx * v.x - hy * v.y - hxy * (x * v.y + y * v.x), a = -hxy * v.x * v.y;
    float d = b * b - 4.0 * a * c, root = sqrt(max(d, 0.0));
    float hit = b < 0.0 ? 2.0 * c / (root - b) : a < 0.0 ? -0.5 * (root + b) / a : -1.0;
    return c <= 0.0 ? 0.0 : d >= 0.0 && hit <= end ? hit : -1.0;
}

// Cone steps; in every cell that the ray enters it is met with the bilinear patch itself.
vec4 conemap_trace(vec3 origin, vec3 direction) {
    ivec2 size = textureSize(conemap_map, 0);
    vec2 range = conemap_clip(vec2(0.0, 1e30), origin.z, direction.z, 0.0, 1.0); // of t over the map
    float ground = direction.z < 0.0 ? range.y : 2e30; // who gets there has hit: no height is below
    range = conemap_clip(conemap_clip(range, origin.x, direction.x, 0.0, 1.0), origin.y, direction.y, 0.0, 1.0);
    int i = 0, j = 0, si = direction.x < 0.0 ? -1 : 1, sj = direction.y < 0.0 ? -1 : 1, steps = 0;
    vec3 v = vec3(max(abs(direction.x) * float(size.x), 1e-20), max(abs(direction.y) * float(size.y), 1e-20), direction.z);
    float x = float(si) * (origin.x * float(size.x) - 0.5), y = float(sj) * (origin.y * float(size.y) - 0.5), z = origin.z;
    float t = 0.0, dt = range.x, hit = -1.0, speed = sqrt(direction.x * direction.x + direction.y * direction.y);
    bool done = range.x > range.y;
    for (; !done && steps < 4 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * int(floor(x)); x -= floor(x); j += sj * int(floor(y)); y -= floor(y);
        vec2 a = conemap_texel(i, j, size), b = conemap_texel(i + si, j, size);
        vec2 c = conemap_texel(i, j + sj, size), d = conemap_texel(i + si, j + sj, size);
        vec2 low = a + (b - a) * x, high = c + (d - c) * x, here = low + (high - low) * y; // height and cone
        float leave = min((1.000001 - x) / v.x, (1.000001 - y) / v.y), left = range.y - t; // just over the border
        hit = conemap_patch_hit(vec4(a.x, b.x, c.x, d.x), x, y, z - here.x, v, min(leave, left));
        float gap = z - here.x - 1.0 / 1048576.0, closing = speed - here.y * v.z; // to an apex raised by more than rounding
        dt = max(leave, gap <= 0.0 ? 0.0 : closing > 0.0 ? here.y * gap / closing : 1e30);
        done = hit >= 0.0 || dt >= left;
    }
    if (done && hit < 0.0 && range.y == ground && range.x <= range.y) hit = range.y - t;
    return vec4((float(i) + float(si) * (x + v.x * hit) + 0.5) / float(size.x),
                (float(j) + float(sj) * (y + v.y * hit) + 0.5) / float(size.y), z + v.z * hit, hit >= 0.0 ? t + hit : -1.0);
}

in vec3 conemap_origin, conemap_direction;
layout(location = 0) out vec4 conemap_color;
void main() {
    conemap_color = conemap_trace(conemap_origin, conemap_direction);
    if (conemap_color.w < 0.0) discard;
}
