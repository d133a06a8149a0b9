// How long the page of tvsgs-view sorts its splats: milliseconds of a core, the least and the median of 15 orders.
//
//     node scripts/view_times.mjs [SPLATS]        default: 2000000, most of them on a ball, in the order of their places
import fs from 'node:fs';
import path from 'node:path';
import {fileURLToPath} from 'node:url';

const count = Number(process.argv[2] ?? 2e6);
const source = path.join(path.dirname(fileURLToPath(import.meta.url)), '../src/report/view/data.js');
let order = null, state = 1;
// As in a worker: the page's own function, which answers by postMessage().
const worker = new Function('postMessage', `let onmessage; ${fs.readFileSync(source)}; sorter(); return data => onmessage({data});`)(
    answer => order = answer.order);
const random = () => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) / 2 ** 32;
const positions = new Float32Array(3 * count);
for (let i = 0; i < count; ++i) {
  const y = 2 * i / count - 1, angle = 400 * y + 0.02 * random(), far = i % 10 ? 1 + 0.01 * random() : 20 * random();
  const r = Math.sqrt(1 - y * y);
  positions.set([far * r * Math.cos(angle), far * y, far * r * Math.sin(angle)], 3 * i);
}
worker({positions});
for (const exactly of [false, true]) {
  const times = [];
  for (let turn = 0; turn < 15; ++turn) {
    const before = process.cpuUsage(), forward = [Math.sin(0.05 * turn), 0, Math.cos(0.05 * turn)];
    worker({forward, offset: 4, near: 0.2, exactly, buffer: order});
    const {user, system} = process.cpuUsage(before);
    times.push((user + system) / 1000);
  }
  times.sort((a, b) => a - b);
  console.log(`${exactly ? 'at rest' : 'moving '}: ${times[0].toFixed(0)} ms, ${times[7].toFixed(0)} ms`);
}
