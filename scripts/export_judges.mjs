// What programs that nobody here wrote make of the files of tvsgs-export, and it of theirs.
//
//     node scripts/export_judges.mjs FOLDER [BIN]
//
// FOLDER: where `npm install @adobe/spz gltf-validator three @playcanvas/splat-transform` has been run; what is missing
// is skipped. BIN: folder of tvsgs-export [build/cpu/bin]. Exits with 1 where one disagrees. Never needed to build or test.
import {execFileSync} from 'node:child_process';
import fs from 'node:fs';
import {createRequire} from 'node:module';
import os from 'node:os';
import path from 'node:path';
import {pathToFileURL} from 'node:url';
import zlib from 'node:zlib';

const [folder, bin = 'build/cpu/bin'] = process.argv.slice(2);
if (!folder) {
  console.error('usage: node scripts/export_judges.mjs FOLDER [BIN]');
  process.exit(2);
}
const modules = path.resolve(folder, 'node_modules');
const require = createRequire(path.join(modules, 'x.js'));
const work = fs.mkdtempSync(path.join(os.tmpdir(), 'tvsgs_judges_'));
const file = (name) => path.join(work, name);
const version = (name) => JSON.parse(fs.readFileSync(path.join(modules, name, 'package.json'))).version;
const run = (...words) =>
    execFileSync(path.resolve(bin, 'tvsgs-export'), [...words, '--device', 'cpu', '--quiet'], {stdio: ['ignore', 'pipe', 'inherit']});
let wrong = 0;

// 1. Splats of all kinds, from a generator with a fixed seed; two thirds near, one third far.
const N = 1000;
let state = 12345;
const random = () => (state = (state * 1103515245 + 12345) % 2147483648) / 2147483648;
const normal = () => Math.sqrt(-2 * Math.log(1 - random())) * Math.cos(2 * Math.PI * random());
const rest = 45;
const names = ['x', 'y', 'z', 'nx', 'ny', 'nz', 'f_dc_0', 'f_dc_1', 'f_dc_2'];
for (let i = 0; i < rest; ++i) names.push(`f_rest_${i}`);
names.push('opacity', 'scale_0', 'scale_1', 'scale_2', 'rot_0', 'rot_1', 'rot_2', 'rot_3');
const rows = [];
for (let i = 0; i < N; ++i) {
  const far = i % 3 == 0 ? 100 : 3;
  rows.push([far * normal(), far * normal(), far * normal(), 0, 0, 0]
                .concat([0, 1, 2].map(() => Math.max(-3.2, Math.min(3.2, normal()))))
                .concat(Array.from({length: rest}, () => Math.max(-0.95, Math.min(0.95, 0.25 * normal()))))
                .concat([3 * normal()], [0, 1, 2].map(() => -4 + normal()), [0, 1, 2, 3].map(normal)));
}
function writePly(to) {
  const head = `ply\nformat binary_little_endian 1.0\nelement vertex ${N}\n` +
      names.map((n) => `property float ${n}\n`).join('') + 'end_header\n';
  fs.writeFileSync(to, Buffer.concat([Buffer.from(head), Buffer.from(Float32Array.from(rows.flat()).buffer)]));
}
function readPly(from) {
  const bytes = fs.readFileSync(from), end = bytes.indexOf('end_header\n') + 11;
  const head = bytes.subarray(0, end).toString();
  const has = [...head.matchAll(/property float (\S+)/g)].map((m) => m[1]);
  const count = +head.match(/element vertex (\d+)/)[1];
  const out = [];
  for (let i = 0; i < count; ++i) {
    const splat = {};
    has.forEach((name, p) => splat[name] = bytes.readFloatLE(end + 4 * (i * has.length + p)));
    out.push(splat);
  }
  return out;
}
const all = (splat, prefix, n) => Array.from({length: n}, (_, i) => splat[prefix + i] ?? 0);
const sigmoid = (x) => 1 / (1 + Math.exp(-x));

// 2. Splats in any order are matched by their nearest neighbour; those that 8 bits make invisible may be missing.
function compare(what, ours, theirs, bounds) {
  const most = {};
  const widen = (key, by) => most[key] = Math.max(most[key] ?? 0, Math.abs(by));
  const visible = ours.filter((s) => sigmoid(s.opacity) >= (bounds.visible ?? 0.5 / 255));
  for (const a of visible) {
    let b = null, best = Infinity;
    for (const s of theirs) {
      const d = Math.hypot(s.x - a.x, s.y - a.y, s.z - a.z);
      if (d < best) best = d, b = s;
    }
    for (const c of 'xyz') widen('position', (a[c] - b[c]) / (bounds.log ? 1 + Math.abs(a[c]) : 1));
    for (let c = 0; c < 3; ++c) widen('log_scale', a[`scale_${c}`] - b[`scale_${c}`]);
    for (let c = 0; c < 3; ++c) widen('color', a[`f_dc_${c}`] - b[`f_dc_${c}`]);
    widen('opacity', sigmoid(a.opacity) - sigmoid(b.opacity));
    for (let c = 0; c < 3; ++c)
      for (let k = 0; k < 15; ++k)
        widen(k < 3 ? 'sh_1' : 'sh_rest', a[`f_rest_${15 * c + k}`] - b[`f_rest_${15 * c + k}`]);
    // What the two rotations make of the splat's own axes, of whatever signs.
    const p = all(a, 'rot_', 4), q = all(b, 'rot_', 4), np = Math.hypot(...p), nq = Math.hypot(...q);
    const products = [[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]];
    const turn = (s) => {  // q times a half turn of the splat's axes: a permutation with signs
      const [w, x, y, z] = q;
      return [[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]][s];
    };
    const dot = Math.max(...products.map((_, s) => Math.abs(turn(s).reduce((sum, v, i) => sum + v * p[i], 0)) / np / nq));
    widen('degrees', 2 * Math.acos(Math.min(1, dot)) * 180 / Math.PI);
  }
  const beyond = Object.entries(bounds).filter(([key, bound]) => most[key] > bound);
  const text = Object.entries(most).map(([key, v]) => `${key} ${v.toPrecision(2)}`).join(', ');
  const good = beyond.length == 0 && theirs.length >= visible.length && theirs.length <= N;
  if (!good) ++wrong;
  console.log(`${good ? 'ok  ' : 'FAIL'} ${what}: ${text}` + (beyond.length ? `; beyond ${JSON.stringify(Object.fromEntries(beyond))}` : ''));
}
const SPZ = {position: 2 ** -14 * 1.01, log_scale: 0.0313, color: 0.01308, opacity: 0.00197, sh_1: 0.0352, sh_rest: 0.0665, degrees: 0.25};
const SPZ2 = {...SPZ, degrees: 12};
const LOSSLESS = {position: 1e-5, log_scale: 1e-5, color: 1e-6, opacity: 1e-6, sh_1: 1e-6, sh_rest: 1e-6, degrees: 0.1};
const SOG = {log: true, position: 1.1e-4 * 1.2, log_scale: 0.4, color: 0.3, opacity: 0.00197, sh_1: 1.5, sh_rest: 1.5, degrees: 1};
const SOG_THEIRS = {...SOG, visible: 1 / 255, position: 3e-4, opacity: 0.004, degrees: 2};  // it truncates

async function judge(name, action) {
  if (!fs.existsSync(path.join(modules, name))) return console.log(`skip ${name}: not installed in ${folder}`);
  console.log(`     ${name} ${version(name)}`);
  try {
    await action();
  } catch (error) {
    ++wrong;
    console.log(`FAIL ${name}: ${error.stack}`);
  }
}

writePly(file('in.ply'));
const ours = readPly(file('in.ply'));
run(file('in.ply'), file('v2.spz'), '--spz-version', '2');
run(file('in.ply'), file('v3.spz'), '--spz-sh-bits', '5,4');  // as the library has it
run(file('in.ply'), file('v4.spz'), '--spz-sh-bits', '5,4', '--spz-version', '4');
run(file('in.ply'), file('rdf.spz'), '--frame', 'rdf');
run(file('in.ply'), file('rdf4.spz'), '--frame', 'rdf', '--spz-version', '4');
run(file('in.ply'), file('all.sog'));
run(file('in.ply'), file('all.glb'));
run(file('in.ply'), file('again.ply'));
console.log(`     bytes: ${['in.ply', 'v2.spz', 'v3.spz', 'v4.spz', 'all.sog', 'all.glb'].map((f) => `${f} ${fs.statSync(file(f)).size}`).join(', ')}`);

await judge('@adobe/spz', async () => {
  const spz = await (await import(pathToFileURL(path.join(modules, '@adobe/spz/dist/spz.js')))).default();
  const rdf = spz.CoordinateSystem.RDF;
  const splats = (cloud) => Array.from({length: cloud.numPoints}, (_, i) => {
    const s = {opacity: cloud.alphas[i]};
    'xyz'.split('').forEach((c, a) => s[c] = cloud.positions[3 * i + a]);
    for (let c = 0; c < 3; ++c) s[`scale_${c}`] = cloud.scales[3 * i + c], s[`f_dc_${c}`] = cloud.colors[3 * i + c];
    [3, 0, 1, 2].forEach((from, to) => s[`rot_${to}`] = cloud.rotations[4 * i + from]);
    for (let k = 0; k < 15; ++k)
      for (let c = 0; c < 3; ++c) s[`f_rest_${15 * c + k}`] = cloud.sh[3 * (15 * i + k) + c];
    return s;
  });
  for (const [name, bounds] of [['v2.spz', SPZ2], ['v3.spz', SPZ], ['v4.spz', SPZ]])
    compare(`ours, read by it: ${name}`, ours, splats(spz.loadSpzFromBuffer(fs.readFileSync(file(name)), {to: rdf})), bounds);
  // Its own file, read by us, and byte against byte.
  const sorted = splats(spz.loadSpzFromBuffer(fs.readFileSync(file('v3.spz')), {to: rdf}));
  const cloud = {};
  Object.assign(cloud, {numPoints: N, shDegree: 3, antialiased: false, extensions: [],
    positions: Float32Array.from(ours.flatMap((s) => [s.x, s.y, s.z])), scales: Float32Array.from(ours.flatMap((s) => all(s, 'scale_', 3))),
    rotations: Float32Array.from(ours.flatMap((s) => [s.rot_1, s.rot_2, s.rot_3, s.rot_0])), alphas: Float32Array.from(ours.map((s) => s.opacity)),
    colors: Float32Array.from(ours.flatMap((s) => all(s, 'f_dc_', 3))),
    sh: Float32Array.from(ours.flatMap((s) => Array.from({length: 15}, (_, k) => [0, 1, 2].map((c) => s[`f_rest_${15 * c + k}`])).flat()))});
  const saved = (version) => Buffer.from(spz.saveSpzToBuffer(cloud, {version, from: rdf, sh1Bits: 5, shRestBits: 4}));
  const theirs = saved(3);
  for (const version of [3, 4]) {
    fs.writeFileSync(file('theirs.spz'), saved(version));
    run(file('theirs.spz'), file('theirs.ply'));
    compare(`its own, read by us: version ${version}`, ours, readPly(file('theirs.ply')), {...SPZ, position: 2 ** -13 * 1.01});
  }
  // The same splats in the same order: but for positions, whose bits it does not choose, the bytes are to agree.
  const payload = (b) => zlib.gunzipSync(b);
  const kept = ours.filter((s) => sigmoid(s.opacity) >= 0.5 / 255).length;
  const a = payload(fs.readFileSync(file('v3.spz'))), b = payload(theirs);
  const rowsOf = (bytes, count) => Array.from({length: count}, (_, i) => {
    const at = 16 + 9 * count;
    return [[at + i, 1], [at + count + 3 * i, 3], [at + 4 * count + 3 * i, 3], [at + 7 * count + 4 * i, 4], [at + 11 * count + 45 * i, 45]]
        .map(([begin, size]) => bytes.subarray(begin, begin + size).toString('hex')).join('');
  });
  const known = new Set(rowsOf(b, N)), equal = rowsOf(a, kept).filter((row) => known.has(row)).length;
  const good = equal >= 0.99 * kept;
  if (!good) ++wrong;
  console.log(`${good ? 'ok  ' : 'FAIL'} bytes beside positions: ${equal} of ${sorted.length} splats are the same`);
});

await judge('@playcanvas/splat-transform', async () => {
  const bin2 = path.join(modules, '@playcanvas/splat-transform/bin/cli.mjs');
  const convert = (...words) => execFileSync(process.execPath, [bin2, '-w', '-q', '-g', 'cpu', ...words], {stdio: ['ignore', 'ignore', 'inherit']});
  const turns = +version('@playcanvas/splat-transform').split('.')[0] < 3;  // 3 takes SPZ as RDF
  const [spz, spz4] = turns ? ['v3.spz', 'v4.spz'] : ['rdf.spz', 'rdf4.spz'];
  for (const [name, bounds] of [[spz, SPZ], [spz4, SPZ], ['all.sog', SOG], ['again.ply', LOSSLESS]]) {
    convert(file(name), file('judged.ply'));
    compare(`ours, read by it: ${name}`, ours, readPly(file('judged.ply')), bounds);
  }
  for (const [name, bounds] of [['made.sog', SOG_THEIRS], ['made.glb', LOSSLESS], ['made.ply', LOSSLESS]]) {
    convert(file('in.ply'), file(name));
    run(file(name), file('made_read.ply'));
    compare(`its own, read by us: ${name}`, ours, readPly(file('made_read.ply')), bounds);
  }
});

await judge('gltf-validator', async () => {
  const report = await require('gltf-validator').validateBytes(new Uint8Array(fs.readFileSync(file('all.glb'))), {maxIssues: 1000});
  const unknown = report.issues.messages.filter(
      (m) => !(m.code == 'MESH_PRIMITIVE_INVALID_ATTRIBUTE' && m.pointer.includes('KHR_gaussian_splatting:')) && m.code != 'UNSUPPORTED_EXTENSION');
  if (unknown.length) ++wrong;
  console.log(`${unknown.length ? 'FAIL' : 'ok  '} all.glb: ${report.issues.messages.length - unknown.length} messages, all on an extension ` +
      'that it does not know' + unknown.map((m) => `; ${m.code} ${m.message} ${m.pointer}`).join(''));
});

await judge('three', async () => {
  const load = (name) => import(pathToFileURL(path.join(modules, 'three/examples/jsm/loaders', name)));
  const buffer = (name) => new Uint8Array(fs.readFileSync(file(name))).buffer;
  /// Where it puts the splats, in whichever order.
  const check = (what, positions, signs, bound) => {
    let most = 0;
    for (let i = 0; i < positions.count; ++i) {
      const p = [0, 1, 2].map((c) => signs[c] * positions.array[3 * i + c]);
      most = Math.max(most, Math.min(...ours.map((s) => Math.hypot(s.x - p[0], s.y - p[1], s.z - p[2]))));
    }
    const good = positions.count >= N - 30 && positions.count <= N && most <= bound;
    if (!good) ++wrong;
    console.log(`${good ? 'ok  ' : 'FAIL'} ${what}: ${positions.count} splats, ${most.toPrecision(2)} off`);
  };
  const {SPZLoader} = await load('SPZLoader.js');
  for (const name of ['v2.spz', 'v3.spz', 'v4.spz']) {
    const geometry = await new Promise((done, failed) => new SPZLoader().parse(buffer(name), done, failed));
    check(name, geometry.attributes.position, [1, -1, -1], 1e-4);
  }
  const {GaussianSplatPLYLoader} = await load('GaussianSplatPLYLoader.js');
  check('again.ply', new GaussianSplatPLYLoader().parse(buffer('again.ply')).attributes.position, [1, 1, 1], 1e-5);
  globalThis.self ??= globalThis;  // GLTFLoader is made for browsers
  const {GLTFLoader} = await load('GLTFLoader.js');
  const {GLTFGaussianSplatLoaderExtension} = await load('GLTFGaussianSplatLoaderExtension.js');
  const loader = new GLTFLoader();
  loader.register((parser) => new GLTFGaussianSplatLoaderExtension(parser));
  const gltf = await loader.parseAsync(buffer('all.glb'), '');
  gltf.scene.traverse((o) => {
    if (o.splatGeometry) check('all.glb', o.splatGeometry.attributes.position, [-1, -1, 1], 1e-5);
  });
});

fs.rmSync(work, {recursive: true});
process.exit(wrong ? 1 : 0);
