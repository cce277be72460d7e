// conemap.h: quadtree displacement tracer. A ray lives in the unit box over the map: u, v, z; t counts in lengths of its direction.
// conemap_trace(origin, direction): where a ray first hits the relief, (u, v, z, t); t is -1 if nowhere.
// conemap_map: rg32f, height and tan of the cone; only fetched
// conemap_maxima: maxima over bilinear cells, with all its mips; only fetched
#include <metal_stdlib>
using namespace metal;

struct conemap_shader {
    texture2d<float> conemap_map;
    texture2d<float> conemap_maxima;

    float2 conemap_clip(float2 range, float o, float v, float low, float high) { // of t: low <= o + v t <= high
        float a = (low - o) / v, b = (high - o) / v;
        if (v == 0.0f) return float2(range.x, o >= low && o <= high ? range.y : -1e30f);
        return float2(max(range.x, min(a, b)), min(range.y, max(a, b)));
    }

    // How many cells the block of level k goes on, in the ray's direction, from a cell of it.
    int conemap_ahead(int cell, int count, int k, int s) {
        int low = (cell >> k) << k, high = ((cell >> k) + 1) << k;
        return s < 0 ? cell + 1 - low : (high < count ? high : count) - cell;
    }

    float conemap_texel(int i, int j, int2 size) {
        return conemap_map.read(uint2(clamp(i, 0, size.x - 1), clamp(j, 0, size.y - 1)), 0).r;
    }

    float conemap_mix(float4 h, float x, float y) {
        float low = h.x + (h.y - h.x) * x, high = h.z + (h.w - h.z) * x;
        return low + (high - low) * y;
    }

    // First t in 0..end at which a straight line from clearance c to the one at the end meets 0, or -1.
    float conemap_line_hit(float4 h, float x, float y, float z, float c, float3 v, float end) {
        float last = z + v.z * end - conemap_mix(h, x + v.x * end, y + v.y * end);
        return c <= 0.0f ? 0.0f : last <= 0.0f ? end * (c / (c - last)) : -1.0f;
    }

    // Blocks under the ray are left behind whole, others are entered; in a cell a straight line decides.
    float4 conemap_trace(float3 origin, float3 direction) {
        int2 size = int2(conemap_map.get_width(), conemap_map.get_height());
        float2 range = conemap_clip(float2(0.0f, 1e30f), origin.z, direction.z, 0.0f, 1.0f); // of t over the map
        float ground = direction.z < 0.0f ? range.y : 2e30f; // who gets there has hit: no height is below
        range = conemap_clip(conemap_clip(range, origin.x, direction.x, 0.0f, 1.0f), origin.y, direction.y, 0.0f, 1.0f);
        int i = 0, j = 0, si = direction.x < 0.0f ? -1 : 1, sj = direction.y < 0.0f ? -1 : 1, steps = 0;
        float3 v = float3(max(abs(direction.x) * float(size.x), 1e-20f), max(abs(direction.y) * float(size.y), 1e-20f), direction.z);
        float x = float(si) * (origin.x * float(size.x) - 0.5f), y = float(sj) * (origin.y * float(size.y) - 0.5f), z = origin.z;
        int cells_u = size.x + 1, cells_v = size.y + 1, top = 0;
        for (int side = 1; side < cells_u || side < cells_v; side *= 2) ++top;
        int k = top;
        float t = 0.0f, dt = range.x, hit = -1.0f;
        bool done = range.x > range.y;
        for (; !done && steps < 16 * (size.x + size.y); ++steps) {
            x += v.x * dt; y += v.y * dt; z += v.z * dt; t += dt; // whole cells go to i and j, so x and y keep their bits
            i += si * int(floor(x)); x -= floor(x); j += sj * int(floor(y)); y -= floor(y);
            int cell_u = clamp(si > 0 ? i + 1 : i, 0, cells_u - 1), cell_v = clamp(sj > 0 ? j + 1 : j, 0, cells_v - 1);
            int ahead_u = conemap_ahead(cell_u, cells_u, k, si), ahead_v = conemap_ahead(cell_v, cells_v, k, sj);
            float leave = min((float(ahead_u) + 0.000001f - x) / v.x, (float(ahead_v) + 0.000001f - y) / v.y);
            float left = range.y - t, end = min(leave, left), highest = conemap_maxima.read(uint2(cell_u >> k, cell_v >> k), k).r;
            bool over = min(z, z + v.z * end) > highest;
            done = over && leave >= left;
            if (done) break;
            if (over || k > 0) {
                dt = over ? leave : 0.0f;
                float fall = v.z < 0.0f ? (highest - z) / v.z : 0.0f; // to the block's top
                if (!over && fall > 0.0f && fall < end) dt = fall;
                k = !over ? k - 1 : k < top ? k + 1 : top;
                continue;
            }
            float4 heights = float4(conemap_texel(i, j, size), conemap_texel(i + si, j, size),
                                conemap_texel(i, j + sj, size), conemap_texel(i + si, j + sj, size));
            float height = conemap_mix(heights, x, y);
            hit = conemap_line_hit(heights, x, y, z, z - height, v, end);
            done = hit >= 0.0f || leave >= left;
            if (done) break;
            dt = leave;
            k = top > 0 ? 1 : 0;
        }
        if (done && hit < 0.0f && range.y == ground && range.x <= range.y) hit = range.y - t;
        return float4((float(i) + float(si) * (x + v.x * hit) + 0.5f) / float(size.x),
                    (float(j) + float(sj) * (y + v.y * hit) + 0.5f) / float(size.y), z + v.z * hit, hit >= 0.0f ? t + hit : -1.0f);
    }

    struct conemap_arguments {
        uint conemap_ray_count;
    };
    conemap_arguments conemap_given;
    device const float4 *conemap_rays; // origin, t_min; direction, t_max
    device float4 *conemap_hits; // u, v, z, t, which is -1 without a hit

    void conemap_run(uint ray) {
        if (ray >= conemap_given.conemap_ray_count) return;
        float3 origin = conemap_rays[2u * ray].xyz, direction = conemap_rays[2u * ray + 1u].xyz;
        conemap_hits[ray] = conemap_trace(origin, direction);
    }
};

kernel void conemap_main(
    texture2d<float> conemap_map [[texture(0)]],
    texture2d<float> conemap_maxima [[texture(1)]],
    constant conemap_shader::conemap_arguments &conemap_given [[buffer(2)]],
    device const float4 *conemap_rays [[buffer(0)]],
    device float4 *conemap_hits [[buffer(1)]],
    uint ray [[thread_position_in_grid]]) {
    conemap_shader shader = {
        conemap_map,
        conemap_maxima,
        conemap_given,
        conemap_rays,
        conemap_hits,
    };
    shader.conemap_run(ray);
}
