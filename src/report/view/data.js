// What the page holds: splats as SPZ version 3, meshes, pictures.
'use strict';

/** Bytes of base64 text, in slices: atob() of 50 MB at once takes three times its memory. */
function decodeBase64(text) {
  text = text.trim();
  const padding = text.endsWith('==') ? 2 : text.endsWith('=') ? 1 : 0;
  const bytes = new Uint8Array(text.length / 4 * 3 - padding), slice = 1 << 20;
  for (let from = 0, to = 0; from < text.length; from += slice) {
    const part = atob(text.slice(from, from + slice));
    for (let i = 0; i < part.length; ++i) bytes[to++] = part.charCodeAt(i);
  }
  return bytes;
}

/** `format`: gzip, as SPZ has it, or deflate. */
async function inflate(bytes, format) {
  if (typeof DecompressionStream === 'undefined') throw Error('this browser cannot inflate data');
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream(format));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const kPerRow = 1024;  // splats in a row of a texture
const kNoSplats = new Uint8Array([0x4e, 0x47, 0x53, 0x50, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);

/**
 * SPZ version 3, as rows of textures: `places` has x, y, z as bits of floats, then the bytes of
 * colour and alpha; `shapes` the bytes of the logarithmic scales with that of the error, then the
 * rotation; `sh` the bytes of the coefficients, 16 to a texel, a layer after another.
 * The file's frame is that of the page.
 * @param errors bytes, one a splat, or null
 */
function unpackSplats(bytes, errors) {
  const head = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.byteLength < 16 || head.getUint32(0, true) !== 0x5053474e ||
      head.getUint32(4, true) !== 3)
    throw Error('the splats of this page are damaged');
  const count = head.getUint32(8, true), degree = head.getUint8(12);
  const unit = 1 / (1 << head.getUint8(13));
  const coefficients = (degree + 1) * (degree + 1) - 1, shBytes = 3 * coefficients;
  if (degree > 3 || bytes.byteLength < 16 + count * (20 + shBytes))
    throw Error('the splats of this page are damaged');
  const alphas = 16 + 9 * count, colors = alphas + count, scales = colors + 3 * count,
        rotations = scales + 3 * count, sh = rotations + 4 * count;
  const rows = Math.max(1, Math.ceil(count / kPerRow)), cells = rows * kPerRow;
  const places = new Uint32Array(4 * cells), shapes = new Uint32Array(2 * cells);
  const floats = new Float32Array(places.buffer), positions = new Float32Array(3 * count);
  for (let i = 0; i < count; ++i) {
    for (let a = 0; a < 3; ++a) {
      const at = 16 + 9 * i + 3 * a;
      const fixed = (bytes[at] << 8 | bytes[at + 1] << 16 | bytes[at + 2] << 24) >> 8;
      positions[3 * i + a] = floats[4 * i + a] = fixed * unit;
    }
    const c = colors + 3 * i, s = scales + 3 * i;
    places[4 * i + 3] =
        bytes[c] | bytes[c + 1] << 8 | bytes[c + 2] << 16 | bytes[alphas + i] << 24;
    shapes[2 * i] = bytes[s] | bytes[s + 1] << 8 | bytes[s + 2] << 16 |
                    (errors ? errors[i] : 255) << 24;
    shapes[2 * i + 1] = head.getUint32(rotations + 4 * i, true);
  }
  const layers = Math.ceil(shBytes / 16), harmonics = new Uint8Array(16 * layers * cells);
  for (let i = 0; i < count; ++i)
    for (let b = 0; b < shBytes; ++b)
      harmonics[16 * ((b >> 4) * cells + i) + (b & 15)] = bytes[sh + shBytes * i + b];
  return {count, degree, rows, layers, positions, places, shapes,
          sh: new Uint32Array(harmonics.buffer)};
}

/** Arrays of a mesh: positions u16, colours u8 (x3), errors u8, indices u32, one after another. */
function unpackMesh(bytes, about) {
  let at = 0;
  const take = n => bytes.slice(at, at += n);
  const positions = new Uint16Array(take(6 * about.vertices).buffer);
  const colors = about.colors ? take(3 * about.vertices) : null;
  const errors = about.errors ? take(about.vertices) : null;
  const faces = new Uint32Array(take(12 * about.faces).buffer);
  if (at !== bytes.length) throw Error('the mesh of this page is damaged');
  const looks = new Uint8Array(4 * about.vertices).fill(200);  // colour and error side by side
  for (let i = 0; i < about.vertices; ++i) {
    for (let c = 0; c < 3 && colors; ++c) looks[4 * i + c] = colors[3 * i + c];
    looks[4 * i + 3] = errors ? errors[i] : 255;
  }
  const padded = new Uint16Array(4 * about.vertices);
  for (let i = 0; i < about.vertices; ++i)
    for (let a = 0; a < 3; ++a) padded[4 * i + a] = positions[3 * i + a];
  return {positions: padded, looks, faces};
}

/**
 * Runs in a worker: the order of splats from back to front, all digits of the depths counting; as
 * in the trainer, splats at one depth keep the order of their numbers.
 */
function sorter() {
  let positions, keys, order, spare;
  const bits = new Uint32Array(1), float = new Float32Array(bits.buffer);
  const bitsOf = value => { float[0] = value; return bits[0]; };
  onmessage = ({data}) => {
    if (data.positions) {
      positions = data.positions;
      const n = positions.length / 3;
      keys = new Uint32Array(n);
      return;
    }
    const {forward: [fx, fy, fz], offset, near, id} = data, n = keys.length;
    const result = data.buffer || new Uint32Array(n);
    if (!spare || spare.length !== n) spare = new Uint32Array(n), order = new Uint32Array(n);
    let kept = 0, least = 0xffffffff, most = 0;
    for (let i = 0; i < n; ++i) {
      const z = fx * positions[3 * i] + fy * positions[3 * i + 1] + fz * positions[3 * i + 2] + offset;
      if (!(z > near)) continue;
      const key = bitsOf(z);  // of positive floats, in their order
      if (key < least) least = key;
      if (key > most) most = key;
      keys[i] = key;
      order[kept++] = i;
    }
    const counts = new Uint32Array(65537);
    // Stable and rising; turned round at the end, so splats of one depth are, too.
    const pass = (from, to, shift) => {
      counts.fill(0);
      for (let j = 0; j < kept; ++j) ++counts[(keys[from[j]] - least >>> shift & 65535) + 1];
      for (let b = 0; b < 65536; ++b) counts[b + 1] += counts[b];
      for (let j = 0; j < kept; ++j) to[counts[keys[from[j]] - least >>> shift & 65535]++] = from[j];
    };
    pass(order, spare, 0);
    let sorted = spare;
    if (most - least > 65535) pass(spare, order, 16), sorted = order;
    for (let j = 0; j < kept; ++j) result[j] = sorted[kept - 1 - j];
    postMessage({order: result, count: kept, id}, [result.buffer]);
  };
}
