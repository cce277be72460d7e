// conemap.h: max-mipmap tracer. A ray lives in the unit box over the map: u, v, z; t counts in lengths of its direction.
// conemap_trace(origin, direction, slice): where a ray first hits the relief, (u, v, z, t); t is -1 if nowhere.
// slice: the texture array's.
// conemap_map: rg32f, height and tan of the cone; only fetched
// conemap_maxima: maxima over bilinear cells, with all its mips; only fetched
Texture2DArray<float2> conemap_map : register(t0);
Texture2DArray<float> conemap_maxima : register(t1);

int2 conemap_size() {
    uint width, height, layers;
    conemap_map.GetDimensions(width, height, layers);
    return int2(int(width), int(height));
}

float2 conemap_clip(float2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
    float a = (low - o) / v, b = (high - o) / v;
    if (v == 0.0) return float2(range.x, o >= low && o <= high ? range.y : -1e30);
    return float2(max(range.x, min(a, b)), min(range.y, max(a, b)));
}

int conemap_repeat(int i, int size) {
    return i - int(floor((float(i) + 0.5) / float(size))) * size;
}

// How many cells the block of level k goes on, in the ray's direction, from a cell of it.
int conemap_ahead(int cell, int count, int k, int s) {
    int low = (cell >> k) << k, high = ((cell >> k) + 1) << k;
    return s < 0 ? cell + 1 - low : (high < count ? high : count) - cell;
}

float conemap_texel(int i, int j, int2 size, int slice) {
    return conemap_map.Load(int4(conemap_repeat(i, size.x), clamp(j, 0, size.y - 1), slice, 0)).r;
}

float conemap_mix(float4 h, float x, float y) {
    float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
    return low + (high - low) * y;
}

// First t in 0..end at which a ray from (x, y), c above a bilinear patch, meets it, or -1: a root of c + b t + a t t.
float conemap_patch_hit(float4 h, float x, float y, float c, float3 v, float end) {
    float hx = h.y - h.x, hy = h.z - h.x, hxy = h.w - h.z - hx;
    float b = v.z - hx * v.x - hy * v.y - hxy * (x * v.y + y * v.x), a = -hxy * v.x * v.y;
    float d = b * b - 4.0 * a * c, root = sqrt(max(d, 0.0));
    float hit = b < 0.0 ? 2.0 * c / (root - b) : a < 0.0 ? -0.5 * (root + b) / a : -1.0;
    return c <= 0.0 ? 0.0 : d >= 0.0 && hit <= end ? hit : -1.0;
}

// Blocks under the ray are left behind whole, others are entered; in a cell the patch itself decides.
float4 conemap_trace(float3 origin, float3 direction, int slice) {
    int2 size = conemap_size();
    float2 range = conemap_clip(float2(0.0, 1e30), origin.z, direction.z, 0.0, 1.0); // of t over the map
    float ground = direction.z < 0.0 ? range.y : 2e30; // who gets there has hit: no height is below
    range = conemap_clip(range, origin.y, direction.y, 0.0, 1.0);
    int i = 0, j = 0, si = direction.x < 0.0 ? -1 : 1, sj = direction.y < 0.0 ? -1 : 1, steps = 0;
    float3 v = float3(max(abs(direction.x) * float(size.x), 1e-20), max(abs(direction.y) * float(size.y), 1e-20), direction.z);
    float x = float(si) * (origin.x * float(size.x) - 0.5), y = float(sj) * (origin.y * float(size.y) - 0.5), z = origin.z;
    float reach_end = range.x + 1048576.0 / (v.x + v.y); // farther than a float can tell cells apart
    range.y = min(range.y, reach_end);
    int cells_u = size.x, cells_v = size.y + 1, top = 0;
    for (int side = 1; side < cells_u || side < cells_v; side *= 2) ++top;
    int k = top;
    float t = 0.0, dt = range.x, hit = -1.0;
    bool done = range.x > range.y;
    for (; !done && steps < 256 * (size.x + size.y); ++steps) {
        x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
        i += si * int(floor(x)); x -= floor(x); j += sj * int(floor(y)); y -= floor(y);
        int cell_u = conemap_repeat(si > 0 ? i : i - 1, size.x), cell_v = clamp(sj > 0 ? j + 1 : j, 0, cells_v - 1);
        int ahead_u = conemap_ahead(cell_u, cells_u, k, si), ahead_v = conemap_ahead(cell_v, cells_v, k, sj);
        float leave = min((float(ahead_u) + 0.000001 - x) / v.x, (float(ahead_v) + 0.000001 - y) / v.y);
        float left = range.y - t, end = min(leave, left), highest = conemap_maxima.Load(int4(cell_u >> k, cell_v >> k, slice, k)).r;
        bool over = min(z, z + v.z * end) > highest;
        done = over && leave >= left;
        if (done) break;
        if (over || k > 0) {
            dt = over ? leave : 0.0;
            k = !over ? k - 1 : k < top ? k + 1 : top;
            continue;
        }
        float4 heights = float4(conemap_texel(i, j, size, slice), conemap_texel(i + si, j, size, slice),
                            conemap_texel(i, j + sj, size, slice), conemap_texel(i + si, j + sj, size, slice));
        float height = conemap_mix(heights, x, y);
        hit = conemap_patch_hit(heights, x, y, z - height, v, end);
        done = hit >= 0.0 || leave >= left;
        if (done) break;
        dt = leave;
        k = top > 0 ? 1 : 0;
    }
    if (done && hit < 0.0 && range.y == ground && range.x <= range.y) hit = range.y - t;
    return float4((float(i) + float(si) * (x + v.x * hit) + 0.5) / float(size.x),
                (float(j) + float(sj) * (y + v.y * hit) + 0.5) / float(size.y), z + v.z * hit, hit >= 0.0 ? t + hit : -1.0);
}

StructuredBuffer<float4> conemap_rays : register(t2);   // origin, t_min; direction, t_max
RWStructuredBuffer<float4> conemap_hits : register(u0); // u, v, z, t, which is -1 without a hit
cbuffer conemap_arguments : register(b0) {
    int conemap_slice;
};

[numthreads(64, 1, 1)]
void main(uint3 thread : SV_DispatchThreadID) {
    uint count, stride;
    conemap_rays.GetDimensions(count, stride);
    uint ray = thread.x;
    if (ray >= count / 2) return;
    float3 origin = conemap_rays[2u * ray].xyz, direction = conemap_rays[2u * ray + 1u].xyz;
    conemap_hits[ray] = conemap_trace(origin, direction, conemap_slice);
}
