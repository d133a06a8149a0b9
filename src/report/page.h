// Style and script of report.html. The page asks nobody for anything: its policy forbids it.
#pragma once

namespace tvsgs {

inline constexpr const char* kPagePolicy =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

inline constexpr const char* kPageStyle = R"(
:root{color-scheme:light dark;--page:#f4f5f7;--card:#fff;--text:#1b1b1b;--quiet:#55585e;--line:#d5d8dd;--link:#005a9c}
@media (prefers-color-scheme:dark){:root{--page:#0e1013;--card:#16191d;--text:#e8e8e8;--quiet:#aab0b8;--line:#363c44;--link:#7cc4ff}}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--text);font:16px/1.5 system-ui,-apple-system,"Segoe UI",sans-serif}
main,header{max-width:1240px;margin:0 auto;padding:0 16px}
header{padding-top:20px}h1{font-size:1.6rem;margin:0;overflow-wrap:anywhere}h2{font-size:1.25rem;margin:36px 0 10px}
h3{font-size:1rem;margin:18px 0 6px;overflow-wrap:anywhere}p{margin:6px 0 10px;max-width:75ch}
a{color:var(--link)}.quiet{color:var(--quiet)}
nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:2px 18px;margin:10px 0 0;padding:0}nav a{display:inline-block;padding:5px 0}
.notice{border-left:4px solid #d55e00;background:var(--card);padding:8px 12px;max-width:none}
.facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(132px,1fr));gap:10px;margin:16px 0}
.facts div{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:8px 12px}
.facts dt{font-size:.82rem;color:var(--quiet)}.facts dd{margin:0;font-size:1.2rem;font-weight:600;overflow-wrap:anywhere}
.plots{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,420px),1fr));gap:14px;align-items:start}
figure{margin:0;min-width:0}.card{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:10px}
svg.plot{display:block;width:100%;height:auto}
details{margin-top:6px}summary{cursor:pointer;color:var(--link);padding:6px 0}
.scroll{overflow-x:auto;max-height:26rem;overflow-y:auto}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}
th,td{padding:3px 10px;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
th:first-child,td:first-child{text-align:left}.words td,.words th{text-align:left;white-space:normal;overflow-wrap:anywhere}
caption{text-align:left;color:var(--quiet);padding-bottom:4px}
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(46%,210px),1fr));gap:8px}
.pictures img{width:100%;height:auto;display:block;background:#101010;border-radius:3px}
figcaption{font-size:.86rem;color:var(--quiet);padding-top:3px}
.viewer{max-width:900px}.viewer canvas{width:100%;aspect-ratio:4/3;display:block;background:#101010;border-radius:4px;touch-action:pan-y;cursor:grab}
.viewer canvas[hidden]{display:none}.viewer img{width:100%;height:auto;display:block;border-radius:4px}
.viewer canvas:focus-visible,button:focus-visible,a:focus-visible,summary:focus-visible{outline:3px solid #e69f00;outline-offset:2px}
.controls{display:flex;flex-wrap:wrap;gap:6px;margin:8px 0}.controls[hidden]{display:none}
button{font:inherit;min-width:44px;min-height:40px;padding:4px 12px;background:var(--card);color:var(--text);border:1px solid var(--quiet);border-radius:5px;cursor:pointer}
.scale{display:grid;grid-template-columns:auto minmax(60px,240px) auto;gap:8px;align-items:center;justify-content:start;font-size:.86rem;margin-top:8px}
.scale[hidden]{display:none}.scale i{display:block;height:14px;border-radius:2px;print-color-adjust:exact;-webkit-print-color-adjust:exact}
footer{max-width:1240px;margin:36px auto 0;padding:0 16px 28px;color:var(--quiet);font-size:.86rem}
@media screen and (max-width:600px){svg.plot{font-size:15px}svg.plot .title{font-size:17px}main,header{padding:0 10px}.card{padding:4px}.card summary,figcaption{padding-left:6px}}
@media print{:root{color-scheme:light;--page:#fff;--card:#fff;--text:#000;--quiet:#333;--line:#ccc;--link:#000}
body{font-size:10.5pt}nav,.controls,.viewer canvas,details{display:none!important}.viewer img{display:block!important;max-width:12cm}
main,header,footer{max-width:none;padding:0}.plots{grid-template-columns:1fr 1fr}.pictures{grid-template-columns:repeat(5,1fr)}
figure,.facts div,.view{break-inside:avoid}h2,h3,main>p{break-after:avoid}}
)";

/// Draws the points of each .viewer on a canvas in the place of their picture; without script the
/// picture stays. The projection is that of pictures.cpp.
inline constexpr const char* kViewerScript = R"JS(
for (const box of document.querySelectorAll('.viewer')) {
const d = JSON.parse(box.querySelector('script').textContent);
const bytes = s => Uint8Array.from(atob(s), c => c.charCodeAt(0));
const raw = new DataView(bytes(d.positions).buffer), n = raw.byteLength / 6 | 0;
const P = new Float32Array(3 * n);
for (let i = 0; i < 3 * n; ++i) P[i] = raw.getInt16(2 * i, true) / 10000;
const pack = (t, i) => 0xff000000 | t[i + 2] << 16 | t[i + 1] << 8 | t[i];
const own = new Uint32Array(n), rgb = bytes(d.colors);
for (let i = 0; i < n; ++i) own[i] = pack(rgb, 3 * i);
let byError = null;
if (d.errors) {
  const e = bytes(d.errors), palette = bytes(d.palette);
  byError = new Uint32Array(n);
  for (let i = 0; i < n; ++i) byError[i] = pack(palette, 3 * e[i]);
}
let colors = byError || own;
const canvas = box.querySelector('canvas'), context = canvas.getContext('2d');
const start = {yaw: 0, pitch: d.pitch, zoom: 1};
let v = {...start}, asked = false, image = null, pixels = null, depth = null;
function draw() {
  asked = false;
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const w = Math.max(1, Math.round(canvas.clientWidth * ratio)), h = Math.round(w * 0.75);
  if (canvas.width !== w || canvas.height !== h || !image) {
    canvas.width = w; canvas.height = h;
    image = context.createImageData(w, h);
    pixels = new Uint32Array(image.data.buffer); depth = new Float32Array(w * h);
  }
  pixels.fill(0xff101010); depth.fill(1e30);
  const cy = Math.cos(v.yaw), sy = Math.sin(v.yaw), cp = Math.cos(v.pitch), sp = Math.sin(v.pitch);
  const focal = 2.4 * 0.5 * h * v.zoom, r = Math.max(1, Math.round(w / 520 * Math.sqrt(v.zoom)));
  for (let i = 0, j = 0; i < n; ++i, j += 3) {
    const x = cy * P[j] - sy * P[j + 2], z1 = sy * P[j] + cy * P[j + 2];
    const y = cp * P[j + 1] - sp * z1, far = 2.6 - (sp * P[j + 1] + cp * z1);
    if (!(far > 0.05)) continue;
    const s = focal / far, px = Math.floor(0.5 * w + s * x), py = Math.floor(0.5 * h - s * y);
    if (px + r < 0 || py + r < 0 || px - r >= w || py - r >= h) continue;
    for (let b = Math.max(py - r, 0); b <= Math.min(py + r, h - 1); ++b)
      for (let a = Math.max(px - r, 0); a <= Math.min(px + r, w - 1); ++a)
        if (far < depth[b * w + a]) { depth[b * w + a] = far; pixels[b * w + a] = colors[i]; }
  }
  context.putImageData(image, 0, 0);
}
const ask = () => { if (!asked) { asked = true; requestAnimationFrame(draw); } };
function move(yaw, pitch, zoom) {
  v.yaw += yaw;
  v.pitch = Math.max(-1.57, Math.min(1.57, v.pitch + pitch));
  v.zoom = Math.max(0.3, Math.min(12, v.zoom * zoom));
  ask();
}
const step = 0.15, acts = {left: () => move(-step, 0, 1), right: () => move(step, 0, 1),
  up: () => move(0, step, 1), down: () => move(0, -step, 1), near: () => move(0, 0, 1.2),
  far: () => move(0, 0, 1 / 1.2), reset: () => { v = {...start}; ask(); }};
const keys = {ArrowLeft: 'left', ArrowRight: 'right', ArrowUp: 'up', ArrowDown: 'down',
  '+': 'near', '=': 'near', '-': 'far', '0': 'reset', Home: 'reset'};
canvas.addEventListener('keydown', e => {
  if (e.ctrlKey || e.metaKey || e.altKey || !keys[e.key]) return;
  e.preventDefault(); acts[keys[e.key]]();
});
const fingers = new Map();
const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
canvas.addEventListener('pointerdown', e => {
  canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, {x: e.clientX, y: e.clientY});
});
canvas.addEventListener('pointermove', e => {
  const last = fingers.get(e.pointerId);
  if (!last) return;
  const before = fingers.size === 2 ? spread() : 0, k = 4 / canvas.clientWidth / fingers.size;
  const dx = e.clientX - last.x, dy = e.clientY - last.y;
  last.x = e.clientX; last.y = e.clientY;
  move(-dx * k, dy * k, before > 10 ? spread() / before : 1);
});
for (const end of ['pointerup', 'pointercancel'])
  canvas.addEventListener(end, e => fingers.delete(e.pointerId));
canvas.addEventListener('wheel', e => {  // the page scrolls until the view has been chosen
  if (document.activeElement !== canvas) return;
  e.preventDefault(); move(0, 0, Math.exp(-e.deltaY / 500));
}, {passive: false});
for (const button of box.querySelectorAll('button[data-act]'))
  button.addEventListener('click', () => acts[button.dataset.act]());
const toggle = box.querySelector('button[data-colors]'), scale = box.querySelector('.scale');
if (toggle) toggle.addEventListener('click', () => {
  colors = colors === own ? byError : own;
  toggle.setAttribute('aria-pressed', String(colors === own));
  scale.hidden = colors === own;
  ask();
});
box.querySelector('img').hidden = true;
box.querySelector('img').style.display = 'none';
canvas.hidden = false;
box.querySelector('.controls').hidden = false;
new ResizeObserver(ask).observe(canvas);
ask();
}
)JS";

}  // namespace tvsgs
