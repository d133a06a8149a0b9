// The user interface: panes, keys, buttons, cameras, photographs.
'use strict';

const element = id => document.getElementById(id);
const about = JSON.parse(element('about').textContent);
const query = new URLSearchParams(location.search);

class Viewer {
  constructor(renderer) {
    this.renderer = renderer, this.stage = element('stage'), this.canvas = element('canvas');
    this.panes = [...document.querySelectorAll('.pane')];
    this.show =
        {splats: true, mesh: false, error: false, centres: false, cameras: true, photo: true};
    this.camera = -1;  // index of the camera whose photograph is shown
    this.selected = about.start;
    this.home = viewOf(about.cameras[about.start], about.scene);
    this.view = this.home;
    this.scale = 1, this.movedAt = 0, this.frames = 0, this.asked = false;
    this.still = matchMedia('(prefers-reduced-motion: reduce)');
  }

  async start() {
    for (const [i, run] of about.runs.entries()) {
      say(`Reading ${run.splats.toLocaleString('en')} splats of ${run.name} …`);
      await new Promise(resolve => setTimeout(resolve));  // lets the browser show the text
      const {splats, mesh} = await readRun(run, i);
      // The canvas replaces the picture when its first frame has something to draw.
      await new Promise(resolve => {
        this.renderer.addRun(run, splats, mesh, paletteOf(about.palette), () => {
          resolve();
          this.ask();
        });
        if (splats.count === 0) resolve();
        this.renderer.sort(this.renderer.runs[i].cloud, run.near, this.view, true);
      });
    }
  }

  begin() {
    this.canvas.hidden = false;
    for (const poster of document.querySelectorAll('.poster')) poster.hidden = true;
    element('controls').hidden = false;
    this.panes.forEach(pane => {
      pane.hidden = false;
    });
    if (Number(query.get('zoom')) > 0)
      this.view = zoomed(this.home, Number(query.get('zoom')), about.scene);
    if (query.has('show')) this.showOnly(query.get('show'));
    this.listen();
    new ResizeObserver(() => this.ask()).observe(this.stage);
    this.state();
    this.ask();
  }

  /** Names separated by spaces. */
  showOnly(names) {
    for (const name of Object.keys(this.show)) this.show[name] = names.split(' ').includes(name);
  }

  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(now => this.draw(now));
  }

  /** Reduces the resolution while the view moves and the device is too slow. */
  adapt(now) {
    const moving = now - this.movedAt < 200, gap = now - (this.lastFrame || now);
    this.lastFrame = now;
    if (!moving) {
      this.frames = 0;
      return 1;
    }
    if (++this.frames > 2) {
      if (gap > 45)
        this.scale = Math.max(0.35, 0.85 * this.scale);
      else if (gap < 22)
        this.scale = Math.min(1, 1.05 * this.scale);
    }
    return this.scale;
  }

  draw(now) {
    this.asked = false;
    if (this.canvas.hidden || this.renderer.gl.isContextLost()) return;
    if (this.flight) this.fly(now);
    const box = this.stage.getBoundingClientRect(), ratio = Math.min(devicePixelRatio || 1, 2);
    const tall = box.height > box.width, n = this.panes.length;
    const share = this.adapt(now), resting = now - this.movedAt >= 200,
          count = tall ? [1, n] : [n, 1];
    const width = Math.max(1, Math.floor(box.width / count[0] * ratio)),
          height = Math.max(1, Math.floor(box.height / count[1] * ratio));
    if (this.canvas.width !== width * count[0] || this.canvas.height !== height * count[1])
      this.canvas.width = width * count[0], this.canvas.height = height * count[1];
    this.stage.classList.toggle('tall', tall);
    this.renderer.makeTarget(width, height);
    const drawn = [Math.max(1, Math.round(width * share)), Math.max(1, Math.round(height * share))];
    this.renderer.runs.forEach((run, i) => {
      this.renderer.sort(run.cloud, run.about.near, this.view, resting);
      this.renderer.drawRun(run, this.view, ...drawn, this.show);
      this.renderer.finish(
          null, tall ? 0 : i * width, tall ? (n - 1 - i) * height : 0, width, height, ...drawn);
    });
    for (const pane of this.panes) this.drawOver(pane, width / ratio, height / ratio, ratio);
    // Draw once more, with all pixels and the exact order, when nothing moves.
    if (!resting) this.ask();
  }

  /** Draws camera frusta, and the photograph in the place that its camera shows. */
  drawOver(pane, width, height, ratio) {
    const canvas = pane.querySelector('canvas'), context = canvas.getContext('2d');
    const lens = lensIn(this.view, width, height);
    canvas.width = Math.round(width * ratio), canvas.height = Math.round(height * ratio);
    context.scale(ratio, ratio);
    const photo = pane.querySelector('img'), size = 0.06 * about.scene.radius;
    this.centres = [];
    about.cameras.forEach((camera, i) => {
      const apex = projected(this.view, lens, camera.centre);
      this.centres.push(apex[2] > 0 ? [apex[0] / apex[2], apex[1] / apex[2]] : null);
      if (!this.show.cameras ||
          (i === this.camera && norm(minus(camera.centre, this.view.centre)) < 0.5 * size))
        return;
      const depth = size * camera.fx / camera.width;
      const corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(
          ([x, y]) => projected(
              this.view, lens, placeAt(camera, x * camera.width, y * camera.height, depth)));
      if ([apex, ...corners].some(p => !(p[2] > 0.01 * size))) return;
      const at = p => [p[0] / p[2], p[1] / p[2]];
      context.beginPath();
      for (const c of corners) context.moveTo(...at(apex)), context.lineTo(...at(c));
      corners.forEach((c, k) => context[k ? 'lineTo' : 'moveTo'](...at(c)));
      context.closePath();
      context.setLineDash(camera.test ? [5, 3] : []);
      context.lineWidth = i === this.selected ? 5 : 3.5;
      context.strokeStyle = 'rgba(0, 0, 0, 0.6)';
      context.stroke();
      context.lineWidth = i === this.selected ? 3 : 1.5;
      context.strokeStyle = i === this.selected ? '#f0e442' : camera.test ? '#e69f00' : '#56b4e9';
      context.stroke();
    });
    const camera = about.cameras[this.camera];
    const source = camera && this.show.photo ? element('photo' + this.camera) : null;
    photo.hidden = !(source && source.naturalWidth > 0);
    if (photo.hidden) return;
    const across = source.naturalWidth, down = source.naturalHeight;
    if (photo.src !== source.src) photo.src = source.src;
    photo.style.opacity = element('opacity').value / 100;
    photo.width = across, photo.height = down;
    // Projects the photograph onto a plane at the depth of the scene, by a homography.
    const depth = Math.max(dot(minus(about.scene.middle, camera.centre), camera.rows[2]), size);
    const corner = (x, y) =>
        projected(this.view, lens, placeAt(camera, x * camera.width, y * camera.height, depth));
    const o = corner(0, 0), u = minus(corner(1, 0), o).map(c => c / across),
          v = minus(corner(0, 1), o).map(c => c / down);
    photo.style.transform = `matrix3d(${
            [u[0], u[1], 0, u[2], v[0], v[1], 0, v[2], 0, 0, 1, 0, o[0], o[1], 0, o[2]]
                .map(c => c / depth)
                .join()})`;
  }

  move(view, keepsPhoto) {
    this.flight = null;
    this.view = view, this.movedAt = performance.now();
    if (!keepsPhoto && this.camera >= 0) this.leave();
    this.ask();
  }

  leave() {
    this.camera = -1;
    this.state();
  }

  flyTo(view, done) {
    if (this.still.matches) {
      this.move(view, true);
      done();
      return;
    }
    this.flight = {from: this.view, to: view, start: performance.now(), done};
    this.ask();
  }

  fly(now) {
    const {from, to, start, done} = this.flight, t = Math.min((now - start) / 500, 1);
    this.movedAt = now;
    this.view = t < 1 ? between(from, to, t * t * (3 - 2 * t)) : to;
    if (t < 1) {
      this.ask();
      return;
    }
    this.flight = null;
    done();
  }

  goTo(index) {
    const n = about.cameras.length;
    this.selected = (index + n) % n;
    const camera = about.cameras[this.selected];
    this.camera = -1;
    this.flyTo(viewOf(camera, about.scene), () => {
      this.camera = this.selected;
      this.state();
      const kind = camera.test ? 'a test view' : 'a training view';
      say(`Camera ${this.selected + 1} of ${n}: ${camera.name}, ${kind}` +
          (camera.photo ? '.' : ', photograph not on this page.'));
      this.ask();
    });
    this.state();
  }

  toggle(name) {
    const on = this.show[name] = !this.show[name];
    if (name === 'centres' && on) this.show.splats = false;
    if (name === 'splats' && on) this.show.centres = false;
    this.state();
    say(`${labels[name]}: ${on ? 'shown' : 'hidden'}.`);
    this.ask();
  }

  /** Updates buttons, list and colour scale. */
  state() {
    for (const button of document.querySelectorAll('button[data-show]'))
      button.setAttribute('aria-pressed', String(this.show[button.dataset.show]));
    const slider = element('photograph');
    slider.hidden = !(this.camera >= 0 && about.cameras[this.camera].photo && this.show.photo);
    const scale = element('scale');
    if (scale) scale.hidden = !this.show.error;
    document.querySelectorAll('button[data-camera]').forEach(button => {
      const on = Number(button.dataset.camera) === this.selected;
      if (on)
        button.setAttribute('aria-current', 'true');
      else
        button.removeAttribute('aria-current');
      if (on && this.camera >= 0) {  // scroll only the list; the page stays in place
        const list = button.closest('ul');
        list.scrollLeft =
            button.offsetLeft - list.offsetLeft - 0.5 * (list.clientWidth - button.offsetWidth);
      }
    });
  }

  listen() {
    const canvas = this.canvas, up = about.scene.up, step = 0.12;
    const go = view => this.move(view);
    const acts = {
      left: () => go(turned(this.view, up, step, 0)),
      right: () => go(turned(this.view, up, -step, 0)),
      up: () => go(turned(this.view, up, 0, -step)),
      down: () => go(turned(this.view, up, 0, step)),
      shiftLeft: () => go(shifted(this.view, -0.06, 0)),
      shiftRight: () => go(shifted(this.view, 0.06, 0)),
      shiftUp: () => go(shifted(this.view, 0, -0.06)),
      shiftDown: () => go(shifted(this.view, 0, 0.06)),
      near: () => go(zoomed(this.view, 1 / 1.15, about.scene)),
      far: () => go(zoomed(this.view, 1.15, about.scene)),
      reset: () => {
        this.leave();
        this.flyTo(this.home, () => say('First view.'));
      },
      before: () => this.goTo(this.selected - 1),
      after: () => this.goTo(this.selected + 1),
      camera: () => this.goTo(this.selected),
      splats: () => this.toggle('splats'),
      mesh: () => this.toggle('mesh'),
      error: () => this.toggle('error'),
      centres: () => this.toggle('centres'),
      cameras: () => this.toggle('cameras'),
      photo: () => this.toggle('photo')
    };
    const keys = {
      ArrowLeft: 'left',
      ArrowRight: 'right',
      ArrowUp: 'up',
      ArrowDown: 'down',
      '+': 'near',
      '=': 'near',
      '-': 'far',
      0: 'reset',
      Home: 'reset',
      '[': 'before',
      ']': 'after',
      Enter: 'camera',
      s: 'splats',
      m: 'mesh',
      e: 'error',
      c: 'centres',
      f: 'cameras',
      p: 'photo'
    };
    canvas.addEventListener('keydown', event => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const name = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (!name || !usable(name)) return;
      event.preventDefault();
      const shifts = event.shiftKey && event.key.startsWith('Arrow');
      acts[shifts ? 'shift' + event.key.slice(5) : name]();
    });
    for (const button of document.querySelectorAll('button[data-act], button[data-show]'))
      button.addEventListener('click', () => acts[button.dataset.act || button.dataset.show]());
    for (const button of document.querySelectorAll('button[data-camera]'))
      button.addEventListener('click', () => this.goTo(Number(button.dataset.camera)));
    element('opacity').addEventListener('input', () => this.ask());
    canvas.addEventListener('wheel', event => {  // the page scrolls until the view has the focus
      if (document.activeElement !== canvas) return;
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 30 : 1;
      this.move(zoomed(this.view, Math.exp(event.deltaY * lines / 600), about.scene));
    }, {passive: false});
    canvas.addEventListener('webglcontextlost', event => {
      event.preventDefault();
      fail('This page lost the graphics unit. Reload it to continue.');
    });
    this.listenToPointers();
  }

  listenToPointers() {
    const canvas = this.canvas, fingers = new Map();
    let walked = 0;
    const middle = () => {
      const all = [...fingers.values()], n = all.length;
      const x = all.reduce((s, f) => s + f.x, 0) / n, y = all.reduce((s, f) => s + f.y, 0) / n;
      return {n, x, y, spread: n === 2 ? Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y) : 0};
    };
    canvas.addEventListener('contextmenu', event => event.preventDefault());
    canvas.addEventListener('pointerdown', event => {
      canvas.focus();
      canvas.setPointerCapture(event.pointerId);
      if (fingers.size === 0) walked = 0;
      fingers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    });
    canvas.addEventListener('pointermove', event => {
      if (!fingers.has(event.pointerId)) return;
      const before = middle();
      fingers.set(event.pointerId, {x: event.clientX, y: event.clientY});
      const after = middle(), dx = after.x - before.x, dy = after.y - before.y;
      walked += Math.abs(dx) + Math.abs(dy);
      if (walked < 4) return;  // a click with a small movement
      const pane = this.panes[0].getBoundingClientRect(),
            lens = lensIn(this.view, pane.width, pane.height);
      let view = this.view;
      if (after.n === 2 || event.shiftKey || event.buttons & 6)
        view = shifted(view, -dx / lens.fx, -dy / lens.fy);
      else
        view = turned(view, about.scene.up, -dx * 4 / pane.width, -dy * 4 / pane.width);
      if (before.spread > 10) view = zoomed(view, before.spread / after.spread, about.scene);
      this.move(view);
    });
    const end = event => {
      if (!fingers.delete(event.pointerId) || event.type !== 'pointerup' || walked >= 4) return;
      for (const pane of this.panes) {
        const box = pane.getBoundingClientRect(), x = event.clientX - box.left,
              y = event.clientY - box.top;
        if (!this.show.cameras || x < 0 || y < 0 || x > box.width || y > box.height) continue;
        let best = -1, nearest = 24;
        this.centres.forEach((c, i) => {
          const away = c ? Math.hypot(c[0] - x, c[1] - y) : Infinity;
          if (away < nearest) nearest = away, best = i;
        });
        if (best >= 0) this.goTo(best);
      }
    };
    for (const kind of ['pointerup', 'pointercancel']) canvas.addEventListener(kind, end);
  }
}

const labels = {
  splats: 'Splats',
  mesh: 'Mesh',
  error: 'Colours by error',
  centres: 'Centres',
  cameras: 'Cameras',
  photo: 'Photographs'
};
const usable = name => !(name in labels) || document.querySelector(`button[data-show=${name}]`);
const say = text => {
  element('status').textContent = text;
};

function fail(message) {
  say(message);
  element('status').classList.add('notice');
  element('canvas').hidden = true;
  element('controls').hidden = true;
  document.querySelectorAll('.pane').forEach(pane => {
    pane.hidden = true;
  });
  document.querySelectorAll('.poster').forEach(poster => {
    poster.hidden = false;
  });
  document.querySelectorAll('button[data-camera]').forEach(button => {
    button.disabled = true;
  });
}
