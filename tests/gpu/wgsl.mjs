// Emitted WGSL in Dawn (npm webgpu) and naga (npm naga-wasm), MODULES being the folder that npm put them into:
//   node wgsl.mjs MODULES judge FILE...   compiles; what either says of a text, a warning too, is a failure
//   node wgsl.mjs MODULES run FOLDER      runs what dialects.c has written, on whatever Vulkan offers; 77: nothing
import { existsSync, readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { join, resolve } from 'node:path';

const [modules, what, ...rest] = process.argv.slice(2);
const { create, globals } = await import(join(resolve(modules), 'webgpu/index.js'));
Object.assign(globalThis, globals);
globalThis.gpu = create([what === 'run' ? 'backend=vulkan' : 'backend=null']); // kept: it must outlive the device

async function judge(files) {
  const { parseWgsl, validate } = await import(join(resolve(modules), 'naga-wasm/dist/node.js'));
  const device = await (await gpu.requestAdapter()).requestDevice();
  let bad = 0;
  const complain = (file, words) => {
    if (++bad <= 10) console.log(`${file}: ${words}`);
  };
  for (const file of files) {
    const code = readFileSync(file, 'utf8');
    device.pushErrorScope('validation');
    const { messages } = await device.createShaderModule({ code }).getCompilationInfo();
    await device.popErrorScope();
    for (const m of messages) complain(file, `Tint, line ${m.lineNum}: ${m.message}`);
    try {
      const module = parseWgsl(code);
      validate(module).free();
      module.free();
    } catch (error) {
      complain(file, `naga: ${error}`);
    }
  }
  console.log(`wgsl: ${files.length} texts through Tint and naga, ${bad} complaints`);
  return bad ? 1 : 0;
}

// A point for each ray, that a fragment shader gets.
const vertices = `
struct to_fragment {
    @builtin(position) place: vec4f,
    @location(0) origin: vec3f,
    @location(1) direction: vec3f,
}
@group(1) @binding(0) var<storage, read> rays: array<vec4f>;
@vertex
fn vertices(@builtin(vertex_index) n: u32) -> to_fragment {
    let p = (vec2f(f32(n % 32u), f32(n / 32u)) + 0.5) / 16.0 - 1.0;
    return to_fragment(vec4f(p.x, -p.y, 0.0, 1.0), rays[2u * n].xyz, rays[2u * n + 1u].xyz);
}`;

// And what one with effects gets.
const corners = `
struct to_fragment {
    @builtin(position) place: vec4f,
    @location(0) origin: vec3f,
    @location(1) direction: vec3f,
    @location(2) tangent: vec3f,
    @location(3) bitangent: vec3f,
    @location(4) normal: vec3f,
    @location(5) point: vec3f,
    @location(6) uv: vec2f,
}
@group(1) @binding(0) var<storage, read> rays: array<vec4f>;
@vertex
fn vertices(@builtin(vertex_index) n: u32) -> to_fragment {
    let p = (vec2f(f32(n % 32u), f32(n / 32u)) + 0.5) / 16.0 - 1.0;
    let r = 8u * n;
    return to_fragment(vec4f(p.x, -p.y, 0.0, 1.0), rays[r].xyz, rays[r + 1u].xyz, rays[r + 2u].xyz, rays[r + 3u].xyz,
        rays[r + 4u].xyz, rays[r + 5u].xyz, rays[r + 6u].xy);
}`;

// A cone map by its passes, for each of the maps.
async function make(device, folder, n) {
  const is = JSON.parse(readFileSync(join(folder, `${n}.json`), 'utf8')), pipelines = {};
  const { width, height, side, levels, format } = is, channels = { r32float: 1, rg32float: 2, rgba32float: 4 }[format];
  for (let kind = 0; existsSync(join(folder, `${n}_${kind}.in`)); ++kind) {
    const textureOf = (size, mipLevelCount, kept) => device.createTexture({
      size, mipLevelCount, format: kept,
      usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST | GPUTextureUsage.STORAGE_BINDING |
        GPUTextureUsage.COPY_SRC });
    const heights = textureOf([width, height], 1, 'r32float'), maxima = textureOf([side, side], levels, 'r32float');
    const states = [0, 1].map(() => textureOf([width, height], 1, 'r32float'));
    const out = textureOf([width, height], 1, format);
    device.queue.writeTexture(
      { texture: heights }, readFileSync(join(folder, `${n}_${kind}.in`)), { bytesPerRow: width * 4 }, [width, height]);
    for (const p of is.passes) {
      pipelines[p.text] ??= device.createComputePipeline({
        layout: 'auto',
        compute: {
          module: device.createShaderModule({ code: readFileSync(join(folder, p.text), 'utf8') }),
          entryPoint: 'conemap_main',
        },
      });
      const views = [];
      if (p.bits & 1) views.push(states[p.reads].createView());
      if (p.bits & 2) views.push(heights.createView());
      if (p.bits & 4) views.push(maxima.createView(p.own ? { mipLevelCount: p.level } : {}));
      views.push(p.writes < 2 ? states[p.writes].createView() : p.writes === 2 ? out.createView()
        : maxima.createView({ baseMipLevel: p.level, mipLevelCount: 1 }));
      const entries = views.map((resource, binding) => ({ binding, resource }));
      if (p.argued) {
        const buffer = device.createBuffer({ size: 16, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
        device.queue.writeBuffer(buffer, 0, new Int32Array([...p.given, 0]));
        entries.push({ binding: entries.length, resource: { buffer } });
      }
      const encoder = device.createCommandEncoder(), pass = encoder.beginComputePass();
      pass.setPipeline(pipelines[p.text]);
      pass.setBindGroup(0, device.createBindGroup({ layout: pipelines[p.text].getBindGroupLayout(0), entries }));
      pass.dispatchWorkgroups(...p.groups);
      pass.end();
      device.queue.submit([encoder.finish()]);
    }
    const row = Math.ceil(width * channels * 4 / 256) * 256;
    const back = device.createBuffer({ size: row * height, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    const encoder = device.createCommandEncoder();
    encoder.copyTextureToBuffer({ texture: out }, { buffer: back, bytesPerRow: row }, [width, height]);
    device.queue.submit([encoder.finish()]);
    await back.mapAsync(GPUMapMode.READ);
    const all = new Float32Array(back.getMappedRange().slice(0)), made = new Float32Array(width * height * channels);
    for (let j = 0; j < height; ++j)
      made.set(all.subarray(j * row / 4, j * row / 4 + width * channels), j * width * channels);
    writeFileSync(join(folder, `${n}_${kind}.out`), made);
    for (const thing of [heights, maxima, ...states, out, back]) thing.destroy();
  }
}

async function run(folder) {
  const adapter = await gpu.requestAdapter();
  if (!adapter || !adapter.features.has('float32-filterable')) {
    console.log('no Vulkan device that filters floats');
    return 77;
  }
  console.log(adapter.info.description);
  const device = await adapter.requestDevice({
    requiredFeatures: ['float32-filterable'], requiredLimits: { maxColorAttachmentBytesPerSample: 64 } });
  let failed = 0;
  device.onuncapturederror = ({ error }) => {
    if (++failed <= 10) console.log(error.message);
  };
  for (let n = 0; n < 100; ++n) { // tracers, then effects
    if (!existsSync(join(folder, `${n}.wgsl`))) continue;
    const is = JSON.parse(readFileSync(join(folder, `${n}.json`), 'utf8'));
    const code = readFileSync(join(folder, `${n}.wgsl`), 'utf8'), count = is.rays_count;
    const module = device.createShaderModule({ code });
    const targets = Array(is.targets).fill({ format: 'rgba32float' });
    const pipeline = is.compute
      ? device.createComputePipeline({ layout: 'auto', compute: { module, entryPoint: is.entry } })
      : device.createRenderPipeline({
          layout: 'auto',
          vertex: { module: device.createShaderModule({ code: is.lit ? corners : vertices }), entryPoint: 'vertices' },
          fragment: { module, entryPoint: is.entry, targets },
          primitive: { topology: 'point-list' },
        });
    for (let kind = 0; existsSync(join(folder, `${n}_${kind}.in`)); ++kind) {
      const { buffer: file, byteOffset, byteLength } = readFileSync(join(folder, `${n}_${kind}.in`));
      const data = file.slice(byteOffset, byteOffset + byteLength), made = [], entries = [];
      let at = is.given_size ?? 48;
      const bufferOf = (bytes, usage) => {
        const buffer = device.createBuffer({ size: bytes.byteLength, usage: usage | GPUBufferUsage.COPY_DST });
        device.queue.writeBuffer(buffer, 0, bytes);
        made.push(buffer);
        return buffer;
      };
      const given = bufferOf(data.slice(0, at), GPUBufferUsage.UNIFORM);
      if (is.given >= 0) entries.push({ binding: is.given, resource: { buffer: given } });
      for (const [k, binding] of is.images.entries()) {
        const [width, height, slices, levels] = new Int32Array(data, at, 4);
        at += 16;
        const texture = device.createTexture({
          size: [width, height, slices],
          mipLevelCount: levels,
          format: 'rgba32float',
          usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
        });
        made.push(texture);
        for (let mipLevel = 0; mipLevel < levels; ++mipLevel) {
          const w = width >> mipLevel, h = height >> mipLevel, size = w * h * slices * 16;
          device.queue.writeTexture(
            { texture, mipLevel }, data.slice(at, at + size), { bytesPerRow: w * 16, rowsPerImage: h }, [w, h, slices]);
          at += size;
        }
        const resource = texture.createView({ dimension: is.array && k < 5 ? '2d-array' : '2d' });
        if (binding >= 0) entries.push({ binding, resource });
      }
      if (is.sampler >= 0) {
        const mode = (wraps) => (wraps ? 'repeat' : 'clamp-to-edge');
        const resource = device.createSampler({
          addressModeU: mode(is.wrap[0]), addressModeV: mode(is.wrap[1]), magFilter: 'linear', minFilter: 'linear' });
        entries.push({ binding: is.sampler, resource });
      }
      const rays = bufferOf(data.slice(at), GPUBufferUsage.STORAGE), size = count * 16 * is.targets;
      const hits = device.createBuffer({ size, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC });
      const back = device.createBuffer({ size, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
      made.push(hits, back);
      const encoder = device.createCommandEncoder();
      if (is.compute) {
        entries.push({ binding: is.rays, resource: { buffer: rays } });
        entries.push({ binding: is.rays + 1, resource: { buffer: hits } });
        const pass = encoder.beginComputePass();
        pass.setPipeline(pipeline);
        pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries }));
        pass.dispatchWorkgroups(count / 64);
        pass.end();
        encoder.copyBufferToBuffer(hits, 0, back, 0, size);
      } else {
        const pictures = targets.map(({ format }) => device.createTexture({
          size: [32, 32], format, usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC }));
        made.push(...pictures);
        const pass = encoder.beginRenderPass({
          colorAttachments: pictures.map((picture) => ({
            view: picture.createView(), loadOp: 'clear', storeOp: 'store', clearValue: [0, 0, 0, -1] })),
        });
        pass.setPipeline(pipeline);
        pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries }));
        pass.setBindGroup(1, device.createBindGroup({
          layout: pipeline.getBindGroupLayout(1), entries: [{ binding: 0, resource: { buffer: rays } }] }));
        pass.draw(count);
        pass.end();
        pictures.forEach((texture, k) => encoder.copyTextureToBuffer(
          { texture }, { buffer: back, offset: k * count * 16, bytesPerRow: 512 }, [32, count / 32]));
      }
      device.queue.submit([encoder.finish()]);
      await back.mapAsync(GPUMapMode.READ);
      const answers = new Float32Array(back.getMappedRange().slice(0)), out = new Float32Array(answers.length);
      for (let k = 0; k < count; ++k) // targets come one after the other, hits with their numbers beside them
        for (let t = 0; t < is.targets; ++t)
          for (let c = 0; c < 4; ++c)
            out[(k * is.targets + t) * 4 + c] = answers[(is.compute ? k * is.targets + t : t * count + k) * 4 + c];
      writeFileSync(join(folder, `${n}_${kind}.out`), out);
      back.unmap();
      for (const thing of made) thing.destroy();
    }
  }
  for (let n = 100; existsSync(join(folder, `${n}.json`)); n += 100) await make(device, folder, n);
  if (failed) console.log(`${failed} errors`);
  return failed ? 1 : 0;
}

const list = (place) => (existsSync(join(place, '.')) && !place.endsWith('.wgsl')
  ? readdirSync(place).filter((name) => name.endsWith('.wgsl')).map((name) => join(place, name)) : [place]);
process.exit(what === 'run' ? await run(rest[0]) : await judge(rest.flatMap(list)));
