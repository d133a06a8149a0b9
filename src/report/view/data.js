// Decodes the data of the page: splats as SPZ version 3, meshes, pictures.
'use strict';

/**
 * Decodes base64 text. Browsers of before 2025 have only atob(); it gets slices, as 50 MB at once
 * would take three times the memory.
 */
function decodeBase64(text) {
  text = text.trim();
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const padding = text.endsWith('==') ? 2 : text.endsWith('=') ? 1 : 0;
  const bytes = new Uint8Array(text.length / 4 * 3 - padding), slice = 1 << 20;
  for (let from = 0, to = 0; from < text.length; from += slice) {
    const part = atob(text.slice(from, from + slice));
    for (let i = 0; i < part.length; ++i) bytes[to++] = part.charCodeAt(i);
  }
  return bytes;
}

/** Decompresses; `format`: gzip (used by SPZ) or deflate. */
async function inflate(bytes, format) {
  if (typeof DecompressionStream === 'undefined') throw Error('this browser cannot inflate data');
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream(format));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const kPerRow = 1024;  // splats in a row of a texture
const noSplats = () => Uint8Array.of(0x4e, 0x47, 0x53, 0x50, 3, ...Array(11).fill(0));

/**
 * Unpacks SPZ version 3 into rows of textures. `places`: x, y, z as bits of floats, then the bytes
 * of colour and alpha. `shapes`: the bytes of the log scales and of the error, then the rotation.
 * `sh`: the bytes of the coefficients, 16 per texel, layer by layer.
 * The file uses the frame of the page.
 * `errors`: bytes, one a splat, or null; `shift` is added to places.
 */
function unpackSplats(bytes, errors, shift = [0, 0, 0]) {
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
        rotations = scales + 3 * count, rest = rotations + 4 * count;
  const rows = Math.max(1, Math.ceil(count / kPerRow)), cells = rows * kPerRow;
  const places = new Uint32Array(4 * cells), shapes = new Uint32Array(2 * cells);
  const floats = new Float32Array(places.buffer), positions = new Float32Array(3 * count);
  for (let i = 0; i < count; ++i) {
    for (let a = 0; a < 3; ++a) {
      const at = 16 + 9 * i + 3 * a;
      const fixed = (bytes[at] << 8 | bytes[at + 1] << 16 | bytes[at + 2] << 24) >> 8;
      positions[3 * i + a] = floats[4 * i + a] = fixed * unit + shift[a];
    }
    const c = colors + 3 * i, s = scales + 3 * i;
    places[4 * i + 3] = bytes[c] | bytes[c + 1] << 8 | bytes[c + 2] << 16 | bytes[alphas + i] << 24;
    shapes[2 * i] =
        bytes[s] | bytes[s + 1] << 8 | bytes[s + 2] << 16 | (errors ? errors[i] : 255) << 24;
    shapes[2 * i + 1] = head.getUint32(rotations + 4 * i, true);
  }
  const layers = Math.ceil(shBytes / 16), harmonics = new Uint8Array(16 * layers * cells);
  for (let i = 0; i < count; ++i)
    for (let b = 0; b < shBytes; ++b)
      harmonics[16 * ((b >> 4) * cells + i) + (b & 15)] = bytes[rest + shBytes * i + b];
  const sh = new Uint32Array(harmonics.buffer);
  return {count, degree, rows, layers, positions, places, shapes, sh};
}

/** The box of most positions, without the outermost hundredth at each side. */
function boxOf(positions) {
  const n = positions.length / 3, step = Math.max(1, Math.floor(n / 20000));
  const sorted = [0, 1, 2].map(a => {
    const values = [];
    for (let i = 0; i < n; i += step) values.push(positions[3 * i + a]);
    return values.sort((x, y) => x - y);
  });
  const at = share => sorted.map(values => values[Math.round(share * (values.length - 1))] || 0);
  return {low: at(0.01), high: at(0.99)};
}

/** Starts a worker from source text. */
function workerOf(source) {
  const url = URL.createObjectURL(new Blob([source], {type: 'text/javascript'}));
  const worker = new Worker(url);
  URL.revokeObjectURL(url);
  return worker;
}

/** Runs unpackSplats() in a worker, so that the page stays responsive; takes over `bytes`. */
function unpackSplatsAside(bytes, errors, shift) {
  const answer = ({data}) => {
    try {
      const splats = unpackSplats(...data);
      postMessage(
          {splats}, ['positions', 'places', 'shapes', 'sh'].map(name => splats[name].buffer));
    } catch (error) { postMessage({failed: error.message}); }
  };
  const worker = workerOf(`const kPerRow = ${kPerRow};\n${unpackSplats}\nonmessage = ${answer};`);
  return new Promise((resolve, reject) => {
    worker.onmessage = ({data}) => {
      worker.terminate();
      if (data.failed) reject(Error(data.failed));
      resolve(data.splats);
    };
    worker.onerror = event => reject(Error(event.message));
    worker.postMessage([bytes, errors, shift], [bytes.buffer]);
  });
}

/** Unpacks a mesh: positions u16, places u16, colours u8, errors u8, indices u32, in this order. */
function unpackMesh(bytes, about) {
  let at = 0;
  const take = n => bytes.slice(at, at += n);
  const positions = new Uint16Array(take(6 * about.vertices).buffer);
  const places = about.places ? new Uint16Array(take(4 * about.vertices).buffer) : null;
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
  return {positions: padded, looks, places, faces};
}

/**
 * Runs in a worker: sorts splats by depth from back to front. Depths have 24 bits; 16 while the
 * camera moves, which takes half the time. As in the trainer, splats at equal depth are ordered by
 * index.
 */
function sorter() {
  const counts = new Uint32Array(1 << 16), float = new Float32Array(1);
  // Bit patterns of positive floats, which sort like the floats.
  const bits = new Uint32Array(float.buffer);
  const bitsOf = z => {
    float[0] = z;
    return bits[0];
  };
  /** Replaces counts by offsets (exclusive prefix sum); returns the total. */
  const begin = bins => {
    let sum = 0;
    for (let b = 0; b < bins; ++b) {
      const count = counts[b];
      counts[b] = sum, sum += count;
    }
    return sum;
  };
  let positions, n, depths, keys, half, order, low, high;
  const start = () => {
    n = positions.length / 3;
    depths = new Float32Array(n), keys = new Uint32Array(depths.buffer);
    half = new Uint16Array(n), order = new Uint32Array(n);
    low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (let i = 0; i < n; ++i)
      for (let a = 0; a < 3; ++a) {
        const p = positions[3 * i + a];
        if (p < low[a]) low[a] = p;
        if (p > high[a]) high[a] = p;
      }
  };
  onmessage = ({data}) => {
    if (data.positions) {
      positions = data.positions;
      start();
      return;
    }
    const {forward, offset, near, exactly} = data, [fx, fy, fz] = forward;
    const result = data.buffer || new Uint32Array(n);
    let close = offset, far = offset;  // of the box of all centres
    for (let a = 0; a < 3; ++a) {
      close += Math.min(forward[a] * low[a], forward[a] * high[a]);
      far += Math.max(forward[a] * low[a], forward[a] * high[a]);
    }
    const spare = 1e-5 * Math.abs(far - close);  // margin for rounding
    const most = bitsOf(Math.max(far + spare, near)), least = bitsOf(Math.max(close - spare, near));
    const shift = Math.max(0, (exactly ? 8 : 16) - Math.clz32(most - least));
    const mask = exactly ? 0xfff : 0xffff;
    counts.fill(0);
    for (let i = 0, j = 0; i < n; ++i, j += 3) {
      const z = fx * positions[j] + fy * positions[j + 1] + fz * positions[j + 2] + offset;
      if (z > near) {
        depths[i] = z;
        ++counts[most - keys[i] >>> shift & mask];  // farthest first
      } else {
        keys[i] = 0;
      }
    }
    const kept = begin(mask + 1);
    if (!exactly) {
      for (let i = n - 1; i >= 0; --i)
        if (keys[i] !== 0) result[counts[most - keys[i] >>> shift]++] = i;
    } else {
      for (let i = n - 1; i >= 0; --i) {
        if (keys[i] === 0) continue;
        const key = most - keys[i] >>> shift, at = counts[key & mask]++;
        half[at] = key >>> 12, order[at] = i;
      }
      counts.fill(0);
      for (let k = 0; k < kept; ++k) ++counts[half[k]];
      begin(mask + 1);
      for (let k = 0; k < kept; ++k) result[counts[half[k]]++] = order[k];
    }
    postMessage({order: result, count: kept}, [result.buffer]);
  };
}
