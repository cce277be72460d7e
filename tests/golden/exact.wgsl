// conemap.h: exact tracer. A ray lives in the unit box over the map: u, v, z; t counts in lengths of its direction.
// conemap_trace(origin, direction): where a ray first hits the relief, (u, v, z, t); t is -1 if nowhere.
// conemap_map: rg32f, height and tan of the cone; only fetched
@group(0) @binding(0) var conemap_map: texture_2d<f32>;

fn conemap_clip(range: vec2f, o: f32, v: f32, low: f32, high: f32) -> vec2f { // of t: low <= o + v t <= high
    let a = (low - o) / v;
    let b = (high - o) / v;
    if (v == 0.0) { return vec2f(range.x, select(-1e30, range.y, o >= low && o <= high)); }
    return vec2f(max(range.x, min(a, b)), min(range.y, max(a, b)));
}

fn conemap_texel(i: i32, j: i32, size: vec2i) -> vec2f {
    return textureLoad(conemap_map, vec2i(clamp(i, 0, size.x - 1), clamp(j, 0, size.y - 1)), 0).rg;
}

// First t in 0..end at which a ray from (x, y), c above a bilinear patch, meets it, or -1: a root of c + b t + a t t.
fn conemap_patch_hit(h: vec4f, x: f32, y: f32, c: f32, v: vec3f, end: f32) -> f32 {
    let hx = h.y - h.x;
    let hy = h.z - h.x;
    let hxy = h.w - h.z - hx;
    let b = v.z - hx * v.x - hy * v.y - hxy * (x * v.y + y * v.x);
    let a = -hxy * v.x * v.y;
    let d = b * b - 4.0 * a * c;
    let root = sqrt(max(d, 0.0));
    let hit = select(select(-1.0, -0.5 * (root + b) / a, a < 0.0), 2.0 * c / (root - b), b < 0.0);
    return select(select(-1.0, hit, d >= 0.0 && hit <= end), 0.0, c <= 0.0);
}

// Cone steps; in every cell that the ray enters it is met with the bilinear patch itself.
fn conemap_trace(origin: vec3f, direction: vec3f) -> vec4f {
    let size = vec2i(textureDimensions(conemap_map));
    var range = conemap_clip(vec2f(0.0, 1e30), origin.z, direction.z, 0.0, 1.0); // of t over the map
    let ground = select(2e30, range.y, direction.z < 0.0); // who gets there has hit: no height is below
    range = conemap_clip(conemap_clip(range, origin.x, direction.x, 0.0, 1.0), origin.y, direction.y, 0.0, 1.0);
    var i = 0;
    var j = 0;
    let si = select(1, -1, direction.x < 0.0);
    let sj = select(1, -1, direction.y < 0.0);
    var steps = 0;
    let v = vec3f(max(abs(direction.x) * f32(size.x), 1e-20), max(abs(direction.y) * f32(size.y), 1e-20), direction.z);
    var x = f32(si) * (origin.x * f32(size.x) - 0.5);
    var y = f32(sj) * (origin.y * f32(size.y) - 0.5);
    var z = origin.z;
    var t = 0.0;
    var dt = range.x;
    var hit = -1.0;
    let speed = sqrt(direction.x * direction.x + direction.y * direction.y);
    var done = range.x > range.y;
    for (; !done && steps < 4 * (size.x + size.y); steps++) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * i32(floor(x)); x -= floor(x); j += sj * i32(floor(y)); y -= floor(y);
        let a = conemap_texel(i, j, size);
        let b = conemap_texel(i + si, j, size);
        let c = conemap_texel(i, j + sj, size);
        let d = conemap_texel(i + si, j + sj, size);
        let low = a + (b - a) * x;
        let high = c + (d - c) * x;
        let here = low + (high - low) * y; // height and cone
        let leave = min((1.000001 - x) / v.x, (1.000001 - y) / v.y);
        let left = range.y - t; // just over the border
        hit = conemap_patch_hit(vec4f(a.x, b.x, c.x, d.x), x, y, z - here.x, v, min(leave, left));
        let gap = z - here.x - 1.0 / 1048576.0;
        let closing = speed - here.y * v.z; // to an apex raised by more than rounding
        dt = max(leave, select(select(1e30, here.y * gap / closing, closing > 0.0), 0.0, gap <= 0.0));
        done = hit >= 0.0 || dt >= left;
    }
    if (done && hit < 0.0 && range.y == ground && range.x <= range.y) { hit = range.y - t; }
    return vec4f((f32(i) + f32(si) * (x + v.x * hit) + 0.5) / f32(size.x),
                (f32(j) + f32(sj) * (y + v.y * hit) + 0.5) / f32(size.y), z + v.z * hit, select(-1.0, t + hit, hit >= 0.0));
}

@fragment
fn conemap_main(@location(0) origin: vec3f, @location(1) direction: vec3f) -> @location(0) vec4f {
    let hit = conemap_trace(origin, direction);
    if (hit.w < 0.0) { discard; }
    return hit;
}
