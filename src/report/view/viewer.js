// The user interface: panes, keys, buttons, cameras, photographs, tools.
'use strict';

const element = id => document.getElementById(id);
const about = JSON.parse(element('about').textContent);
const query = new URLSearchParams(location.search);
const touch = matchMedia('(pointer: coarse)').matches;
const narrow = () => innerWidth <= 600;  // as in page.css

/** Exactly one of these is shown; names as in the page's radio buttons and in its address. */
const modes = {
  splats: {splats: true},
  centres: {centres: true},
  mesh: {mesh: true, look: 'colors'},
  grey: {mesh: true, look: 'plain'},
  normals: {mesh: true, look: 'normals'},
  wires: {mesh: true, look: 'wire'},
  error: {mesh: true, look: 'error', error: true},
  'centre-error': {centres: true, error: true}
};
const modeInput = name => document.querySelector(`input[name=mode][value="${name}"]`);
const modeLabel = name => modeInput(name).nextElementSibling.textContent;

class Viewer {
  constructor(renderer) {
    this.renderer = renderer, this.stage = element('stage'), this.canvas = element('canvas');
    this.panes = [...document.querySelectorAll('.pane')], this.opacity = element('opacity');
    this.mode = 'splats', this.show = {cameras: true, photo: true};
    this.box = null;                           // {low, high}: what lies outside is cut off
    this.measuring = false, this.points = [];  // at most two
    this.camera = -1;                          // index of the camera whose photograph is shown
    this.selected = about.start;
    const scene = about.scene, away = c => norm(minus(c.centre, scene.middle));
    scene.nearest = 1.5 * Math.max(...about.runs.map(run => run.near));
    scene.farthest = 4 * Math.max(scene.radius, ...about.cameras.map(away));
    this.home = viewOf(about.cameras[about.start], scene);
    this.view = this.home;
    this.unread = this.readAddress();
    this.scale = 1, this.movedAt = 0, this.lookedAt = -1e9, this.frames = 0, this.asked = false;
    this.still = matchMedia('(prefers-reduced-motion: reduce)');
  }

  /** Mode and box as the renderer needs them. */
  get shown() { return {...modes[this.mode], box: this.box}; }

  /** Sets the view of the page's address; returns the parts that are not understood. */
  readAddress() {
    const unread = [], read = (name, size, use) => {
      if (!query.has(name)) return;
      const text = query.get(name), values = text.split(',').map(Number);
      const fits =
          size === 0 || (text.trim() && values.length === size && values.every(Number.isFinite));
      if (!fits || use(size ? values : text) === false) unread.push(`${name}=${text}`);
    };
    read('show', 0, name => Boolean(modes[name] && modeInput(name)) && (this.mode = name));
    read('camera', 1, ([n]) => {
      if (!about.cameras[n - 1]) return false;
      this.camera = this.selected = n - 1;
      this.view = viewOf(about.cameras[n - 1], about.scene);
    });
    read('view', 12, v => {
      const part = i => v.slice(3 * i, 3 * i + 3), rows = rowsOf(part(1), part(2));
      if (Math.abs(norm(rows[0]) - 1) + Math.abs(norm(rows[2]) - 1) > 1e-6) return false;
      this.camera = -1;
      this.view = withPivot({...this.view, rows, centre: part(0)}, part(3));
    });
    read('zoom', 1, ([factor]) => {
      if (!(factor > 0)) return false;
      this.camera = -1;
      this.view = zoomed(this.view, factor, about.scene);
    });
    read('box', 6, b => {
      if (![0, 1, 2].every(a => b[a] < b[a + 3])) return false;
      this.box = {low: b.slice(0, 3), high: b.slice(3)};
    });
    return unread;
  }

  /** The page's address with this view. */
  link() {
    const text = list => list.map(x => +x.toPrecision(7)).join(), v = this.view;
    return location.href.split(/[?#]/)[0] + `?show=${this.mode}&camera=${this.selected + 1}` +
        (this.camera < 0 ? `&view=${text([...v.centre, ...v.rows[0], ...v.rows[2], ...v.pivot])}` :
                           '') +
        (this.box ? `&box=${text([...this.box.low, ...this.box.high])}` : '');
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
          if (i === 0) this.stateOfBox();  // newer splats have another extent
          this.ask();
        });
        if (splats.count === 0) resolve();
        this.renderer.sort(this.renderer.runs[i].cloud, run.near, this.view, true);
      });
    }
  }

  begin() {
    showPanes(true);
    this.fold(narrow());
    this.listen();
    this.makeBox();
    new ResizeObserver(() => this.ask()).observe(this.stage);
    this.state();
    this.canvas.focus({preventScroll: true, focusVisible: false});
    say((touch ?
             'One finger turns, two move and zoom, a double tap sets the point to turn about.' :
             'Drag to turn, wheel to zoom, double click sets the point to turn about; ? shows all keys.') +
        (this.unread.length > 0 ?
             ` Not understood in the address, and left out: ${this.unread.join(', ')}.` :
             ''));
    this.ask();
  }

  fold(folded) {
    const button = element('fold');
    element('panel').classList.toggle('folded', folded);
    button.setAttribute('aria-expanded', String(!folded));
    button.textContent = folded ? 'Controls' : 'Hide';
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
      this.renderer.drawRun(run, this.view, ...drawn, this.shown);
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
    this.drawTools(context, lens, width, height);
    const camera = about.cameras[this.camera];
    const source = camera && this.show.photo ? element('photo' + this.camera) : null;
    photo.hidden = !(source && source.naturalWidth > 0);
    if (photo.hidden) return;
    const across = source.naturalWidth, down = source.naturalHeight;
    if (photo.src !== source.src) photo.src = source.src;
    photo.style.opacity = this.opacity.value / 100;
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

  /** Draws the box of the cut, the pivot that the user chose, and the measured distance. */
  drawTools(context, lens, width, height) {
    const at = place => {
      const [x, y, z] = projected(this.view, lens, place);
      return z > 0 ? [x / z, y / z] : null;
    };
    const stroke = (width, color, dashes = []) => {
      context.setLineDash(dashes);
      for (const [w, style] of [[width + 2, 'rgba(0, 0, 0, 0.6)'], [width, color]]) {
        context.lineWidth = w, context.strokeStyle = style;
        context.stroke();
      }
    };
    const line = (a, b) => a && b && (context.moveTo(...a), context.lineTo(...b));
    const ring = (p, r) => p && (context.moveTo(p[0] + r, p[1]), context.arc(...p, r, 0, 7));
    const edges = [], {low, high} = this.box || {},
          side = bits => at([0, 1, 2].map(a => (bits >> a & 1 ? high : low)[a]));
    for (let bits = 0; this.box && bits < 8; ++bits)
      for (const axis of [1, 2, 4])
        if (!(bits & axis)) edges.push([side(bits), side(bits | axis)]);
    context.beginPath();
    for (const edge of edges) line(...edge);
    stroke(1, '#cc79a7');
    const places = this.points.map(at);
    context.beginPath();
    for (const p of places) ring(p, 5);
    if (places.length === 2) line(...places);
    if (this.measuring)
      line([width / 2 - 8, height / 2], [width / 2 + 8, height / 2]),
          line([width / 2, height / 2 - 8], [width / 2, height / 2 + 8]);
    stroke(2, '#f0e442');
    context.beginPath();
    if (this.view.chosen) ring(at(this.view.pivot), 7);
    stroke(1.5, '#fff', [3, 3]);
    if (places.length < 2 || !places[0] || !places[1]) return;
    context.font = '600 15px system-ui, sans-serif';
    context.setLineDash([]);
    context.lineWidth = 4, context.strokeStyle = '#000', context.fillStyle = '#f0e442';
    const label = [
      this.distance(), 0.5 * (places[0][0] + places[1][0]) + 8,
      0.5 * (places[0][1] + places[1][1]) - 8
    ];
    context.strokeText(...label);
    context.fillText(...label);
  }

  distance() {
    const d = norm(minus(this.points[1], this.points[0]));
    return `${Number(d.toPrecision(4))} ${about.unit}`;
  }

  /** What is shown now, in words. */
  now() {
    const n = about.cameras.length, c = about.cameras[this.camera];
    return `${modeLabel(this.mode)}. ` +
        (this.points.length === 2 ? `Distance ${this.distance()}. ` : '') +
        (c ? `Camera ${this.camera + 1} of ${n}: ${c.name}, ${
                 c.test ? 'a test view' : 'a training view'}.` :
             'Free view.');
  }

  move(view, keepsPhoto) {
    this.flight = null;
    this.view = view, this.movedAt = performance.now();
    if (!keepsPhoto && this.camera >= 0) this.leave();
    say(this.now());
    this.ask();
  }

  /** The point of the surface at a place in a pane, in CSS pixels, or null. */
  surfaceAt(index, x, y) {
    const {width, height} = this.panes[index].getBoundingClientRect();
    const depth = this.renderer.depthAt(
        this.renderer.runs[index], this.view, width, height, x, y, this.shown);
    const lens = lensIn(this.view, width, height);
    return depth > 0 ?
        placeAt({...lens, rows: this.view.rows, centre: this.view.centre}, x, y, depth) :
        null;
  }

  /** Zooms; the camera stays in front of the surface on the way to the pivot. */
  zoom(factor) {
    if (factor === 1) return;
    let view = this.view;
    // Pinching moves and zooms in turn, and a look at the surface takes time.
    if (factor < 1 && !view.bounded && performance.now() - this.lookedAt > 250) {
      this.lookedAt = performance.now();
      const box = this.panes[0].getBoundingClientRect();
      const p = projected(view, lensIn(view, box.width, box.height), view.pivot);
      const place = this.surfaceAt(0, p[0] / p[2], p[1] / p[2]);
      const nearer = place && norm(minus(place, view.centre)) < view.distance;
      view = {...(nearer ? withPivot(view, place) : view), bounded: true};
    }
    const next = zoomed(view, factor, about.scene);
    this.move(next);
    if (Math.abs(next.distance / view.distance - 1) < 1e-6)
      say(factor < 1 ? 'This is the nearest view of this point.' : 'This is the farthest view.');
  }

  /** Turns about the surface at this place from now on. */
  pivotAt(index, x, y) {
    const place = this.surfaceAt(index, x, y);
    if (place) this.view = {...withPivot(this.view, place), bounded: true, chosen: true};
    say(place ? 'The view turns about this point.' : 'No surface here; the view turns as before.');
    this.ask();
  }

  addPoint(index, x, y) {
    const place = this.surfaceAt(index, x, y);
    if (place) this.points = this.points.length === 2 ? [place] : [...this.points, place];
    say(!place                       ? 'No surface here.' :
            this.points.length === 1 ? 'First point set; choose the second one.' :
                                       this.now());
    this.ask();
  }

  setMode(name) {
    this.mode = name;
    this.view = {...this.view, bounded: false};
    this.update(this.now());
  }

  measure() {
    this.measuring = !this.measuring, this.points = [];
    if (this.measuring && narrow()) this.fold(true);
    this.update(this.measuring ? `Distance: ${touch ? 'tap' : 'click'} two points.` : this.now());
  }

  /** The box of the meshes and of all but the outermost splats, with a margin. */
  extent() {
    const boxes = this.renderer.runs.flatMap(
        run => [run.about.mesh, run.cloud.count ? run.cloud.box : null].filter(Boolean));
    if (boxes.length === 0) boxes.push({low: this.view.pivot, high: this.view.pivot});
    const low = [0, 1, 2].map(a => Math.min(...boxes.map(b => b.low[a]))),
          high = [0, 1, 2].map(a => Math.max(...boxes.map(b => b.high[a])));
    const margin = 0.1 * norm(minus(high, low)) || 1;
    return {low: low.map(x => x - margin), high: high.map(x => x + margin)};
  }

  /** Makes the sliders of the box. */
  makeBox() {
    for (let k = 0; k < 6; ++k) {
      const row = document.createElement('label'), slider = document.createElement('input');
      const axis = k >> 1, side = k % 2 ? 'high' : 'low';
      row.dataset.name = 'xyz'[axis] + (k % 2 ? ' to' : ' from');
      slider.type = 'range', slider.max = 1000, slider.id = side + axis;
      slider.setAttribute('aria-label', `Box: ${row.dataset.name}`);
      slider.addEventListener('input', () => {
        const {low, high} = this.extent(), step = (high[axis] - low[axis]) / 1000;
        const own = low[axis] + slider.value * step;
        this.box[side][axis] = k % 2 ? Math.max(own, this.box.low[axis] + step) :
                                       Math.min(own, this.box.high[axis] - step);
        this.view = {...this.view, bounded: false};
        this.stateOfBox();
        this.ask();
      });
      row.append(slider, document.createElement('output'));
      element('box').lastElementChild.before(row);
    }
  }

  stateOfBox() {
    element('box').hidden = !this.box;
    if (!this.box) return;
    const {low, high} = this.extent(), numbers = this.boxNumbers();
    for (const [s, side] of ['low', 'high'].entries())
      for (let a = 0; a < 3; ++a) {
        const slider = element(side + a);
        slider.value = 1000 * (this.box[side][a] - low[a]) / (high[a] - low[a]);
        slider.nextElementSibling.textContent = numbers[3 * s + a];
      }
  }

  /** Six numbers in the scene's frame, to a thousandth of the extent. */
  boxNumbers() {
    const {low, high} = this.extent(),
                digits = Math.max(0, Math.ceil(3 - Math.log10(norm(minus(high, low)))));
    return ['low', 'high'].flatMap(
        side => plus(this.box[side], about.origin).map(x => +x.toFixed(Math.min(digits, 9))));
  }

  cut() {
    this.box = this.box ? null : this.extent();
    this.view = {...this.view, bounded: false};
    this.update(this.box ? 'Only the inside of the box is shown.' : 'Nothing is cut off.');
  }

  /** Puts text on the clipboard, and into a field to copy by hand. */
  copy(text, what) {
    const field = element('copied');
    field.value = text, field.hidden = false;
    const done = navigator.clipboard ? navigator.clipboard.writeText(text) : Promise.reject();
    done.then(() => say(`${what} copied.`), () => {
      this.fold(false);
      field.select();
      say(`${what}: copy it from the field.`);
    });
  }

  copyLink() {
    if (location.protocol === 'about:')
      return say('Links need the page on its own: tvsgs-view RUN --out view.html writes it.');
    const link = this.link();
    try {
      history.replaceState(null, '', link);
    } catch (error) {
      // Some browsers keep the address of a local file.
    }
    this.copy(link, 'Link');
  }

  fullScreen() {
    const root = document.documentElement,
          refuse = () => say('The browser allows no full screen here.');
    if (document.fullscreenElement)
      document.exitFullscreen();
    else if (root.requestFullscreen)
      root.requestFullscreen().catch(refuse);
    else
      refuse();
  }

  /** Saves the picture with all that is drawn over it. */
  savePicture() {
    if (this.flight) return say('The view still moves; save the picture when it rests.');
    this.movedAt = -1e9;  // all pixels
    this.draw(performance.now());
    const picture = document.createElement('canvas'), context = picture.getContext('2d');
    picture.width = this.canvas.width, picture.height = this.canvas.height;
    context.drawImage(this.canvas, 0, 0);
    const whole = this.stage.getBoundingClientRect(), ratio = picture.width / whole.width;
    for (const pane of this.panes) {
      const box = pane.getBoundingClientRect(), photo = pane.querySelector('img');
      context.setTransform(
          ratio, 0, 0, ratio, (box.left - whole.left) * ratio, (box.top - whole.top) * ratio);
      context.drawImage(pane.querySelector('canvas'), 0, 0, box.width, box.height);
      if (photo.hidden) continue;
      const p = photo.getBoundingClientRect();  // at its camera it is an upright rectangle
      context.globalAlpha = photo.style.opacity;
      context.drawImage(photo, p.left - box.left, p.top - box.top, p.width, p.height);
      context.globalAlpha = 1;
    }
    const name = `${about.runs[0].name}-${this.mode}.png`;
    picture.toBlob(blob => {
      const a = document.createElement('a');
      a.href = URL.createObjectURL(blob), a.download = name;
      a.click();
      setTimeout(() => URL.revokeObjectURL(a.href), 1000);
      say(`Saved ${name}, ${picture.width} x ${picture.height} pixels.`);
    });
  }

  leave() {
    this.camera = -1;
    this.state();
  }

  flyTo(view, done) {
    if (this.still.matches) {
      this.move(view, true);
      return done();
    }
    this.flight = {from: this.view, to: view, start: performance.now(), done};
    this.ask();
  }

  fly(now) {
    const {from, to, start, done} = this.flight, t = Math.min((now - start) / 500, 1);
    this.movedAt = now;
    this.view = t < 1 ? between(from, to, t * t * (3 - 2 * t)) : to;
    if (t < 1) return this.ask();
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
      this.update(this.now());
    });
    this.state();
  }

  toggle(name) {
    const reason = name === 'photo' ? this.photoMissing() : '';
    if (!reason) this.show[name] = !this.show[name];
    const label = document.querySelector(`button[data-show=${name}]`).firstChild.textContent;
    this.update(reason || `${label}: ${this.show[name] ? 'shown' : 'hidden'}.`);
  }

  /** Why there is no photograph to show; empty: there is one. */
  photoMissing() {
    if (this.camera < 0) return 'Choose a camera first.';
    return about.cameras[this.camera].photo ? '' :
                                              'The photograph of this camera is not on this page.';
  }

  /** Shows a change of the state, and says it. */
  update(text) {
    this.state();
    say(text);
    this.ask();
  }

  /** Updates buttons, list and colour scale. */
  state() {
    modeInput(this.mode).checked = true;
    const pressed = {...this.show, measure: this.measuring, cut: this.box !== null};
    for (const button of document.querySelectorAll('button[aria-pressed]'))
      button.setAttribute(
          'aria-pressed', String(pressed[button.dataset.show || button.dataset.act]));
    const photo = document.querySelector('button[data-show=photo]'), reason = this.photoMissing();
    if (photo) {
      // A disabled button has no focus, and the keys would be lost with it.
      if (reason && document.activeElement === photo) this.canvas.focus({preventScroll: true});
      photo.disabled = reason !== '';
      this.opacity.parentElement.hidden = photo.disabled || !this.show.photo;
      element('why').textContent = reason;
    }
    const scale = element('scale'), mode = modes[this.mode];
    if (scale) scale.hidden = !mode.error;
    this.panes.forEach((pane, i) => {
      const label = pane.querySelector('span'), run = about.runs[i];
      if (label)
        label.textContent = run.name +
            (mode.mesh && !run.mesh       ? ': no mesh' :
                 mode.error && !run.truth ? ': grey, as its truth is not given' :
                                            '');
    });
    this.stage.classList.toggle('measuring', this.measuring);
    this.stateOfBox();
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
    const turn = (right, down) => this.move(turned(this.view, up, -step * right, step * down));
    const shift = (right, down) => this.move(shifted(this.view, 0.06 * right, 0.06 * down));
    const acts = {
      left: () => turn(-1, 0),
      right: () => turn(1, 0),
      up: () => turn(0, -1),
      down: () => turn(0, 1),
      shiftLeft: () => shift(-1, 0),
      shiftRight: () => shift(1, 0),
      shiftUp: () => shift(0, -1),
      shiftDown: () => shift(0, 1),
      ahead: () => this.move(shifted(this.view, 0, 0, 0.06)),
      back: () => this.move(shifted(this.view, 0, 0, -0.06)),
      near: () => this.zoom(1 / 1.15),
      far: () => this.zoom(1.15),
      reset: () => {
        this.mode = 'splats', this.show = {cameras: true, photo: true}, this.box = null;
        this.measuring = false, this.points = [], this.selected = about.start;
        if (this.opacity) this.opacity.value = 50;
        this.leave();
        this.flyTo(this.home, () => say('First view.'));
      },
      before: () => this.goTo(this.selected - 1),
      after: () => this.goTo(this.selected + 1),
      camera: () => {
        const {width, height} = this.panes[0].getBoundingClientRect();
        if (this.measuring)
          this.addPoint(0, width / 2, height / 2);
        else
          this.goTo(this.selected);
      },
      cameras: () => this.toggle('cameras'),
      photo: () => this.toggle('photo'),
      measure: () => this.measure(),
      end: () => this.measuring && this.measure(),
      cut: () => this.cut(),
      copyBox: () => this.copy(`--bbox ${this.boxNumbers().join()}`, 'Box'),
      picture: () => this.savePicture(),
      link: () => this.copyLink(),
      full: () => this.fullScreen(),
      help: () => element('help').showModal(),
      details: () => element('details').showModal()
    };
    // The buttons add theirs.
    const keys = {Enter: 'camera', Escape: 'end', PageUp: 'ahead', PageDown: 'back'};
    for (const button of document.querySelectorAll('button[data-keys]'))
      for (const key of button.dataset.keys.split(' '))
        keys[key] = button.dataset.act || button.dataset.show;
    for (const input of document.querySelectorAll('input[name=mode]')) {
      acts[input.value] = () => this.setMode(input.value);
      keys[input.dataset.key] = input.value;
      input.addEventListener('change', acts[input.value]);
    }
    // Letters also act where a button has the focus.
    const press = event => {
      const single = event.key.length === 1;
      if (event.ctrlKey || event.metaKey || event.altKey || event.target.id === 'copied') return;
      if (event.target !== canvas && (!single || event.key === ' ')) return;
      const name = keys[single ? event.key.toLowerCase() : event.key];
      if (!name) return;
      event.preventDefault();
      const shifts = event.shiftKey && event.key.startsWith('Arrow');
      acts[shifts ? 'shift' + event.key.slice(5) : name]();
    };
    for (const part of [canvas, element('panel')]) part.addEventListener('keydown', press);
    for (const button of document.querySelectorAll('button[data-act], button[data-show]'))
      button.addEventListener('click', () => acts[button.dataset.act || button.dataset.show]());
    element('fold').addEventListener(
        'click', () => this.fold(!element('panel').classList.contains('folded')));
    for (const button of document.querySelectorAll('button[data-camera]'))
      button.addEventListener('click', () => {
        if (narrow()) this.fold(true);
        this.goTo(Number(button.dataset.camera));
      });
    if (this.opacity) this.opacity.addEventListener('input', () => this.ask());
    canvas.addEventListener('wheel', event => {
      // Inside of a report, the report scrolls until the view has the focus.
      if (parent !== window && !(document.hasFocus() && document.activeElement === canvas)) return;
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 30 : 1;
      this.zoom(Math.exp(event.deltaY * lines / 600));
    }, {passive: false});
    canvas.addEventListener('webglcontextlost', event => {
      event.preventDefault();
      fail('This page lost the graphics unit. Reload it to continue.');
    });
    this.listenToPointers();
  }

  listenToPointers() {
    const canvas = this.canvas, fingers = new Map();
    let walked = 0, last = {time: -1e9, x: 0, y: 0};  // the last click
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
      this.move(view);
      if (before.spread > 10) this.zoom(before.spread / after.spread);
    });
    const end = event => {
      if (!fingers.delete(event.pointerId)) return;
      if (fingers.size > 0 || event.button > 0) walked = 4;  // no click
      if (event.type !== 'pointerup' || walked >= 4) return;
      const index = this.panes.findIndex(pane => {
        const box = pane.getBoundingClientRect();
        return event.clientX >= box.left && event.clientX < box.right && event.clientY >= box.top &&
            event.clientY < box.bottom;
      });
      if (index < 0) return;
      const box = this.panes[index].getBoundingClientRect(), x = event.clientX - box.left,
            y = event.clientY - box.top, time = event.timeStamp;
      const twice = time - last.time < 400 && Math.hypot(x - last.x, y - last.y) < 20;
      const before = {view: this.view, camera: this.camera, selected: this.selected};
      if (twice && last.before && !this.measuring) {  // the first click may have gone to a camera
        this.flight = null;
        Object.assign(this, last.before);
        this.state();
      }
      last = {time: twice ? -1e9 : time, x, y, before};
      if (this.measuring)
        this.addPoint(index, x, y);
      else if (twice)
        this.pivotAt(index, x, y);
      else if (this.show.cameras)
        this.clickCamera(x, y);
    };
    for (const kind of ['pointerup', 'pointercancel']) canvas.addEventListener(kind, end);
  }

  clickCamera(x, y) {
    let best = -1, nearest = 24;
    this.centres.forEach((c, i) => {
      const away = c ? Math.hypot(c[0] - x, c[1] - y) : Infinity;
      if (away < nearest) nearest = away, best = i;
    });
    if (best >= 0) this.goTo(best);
  }
}

const say = text => {
  if (element('status').textContent !== text) element('status').textContent = text;
};

/** Shows the panes and their controls, or the pictures that replace them. */
function showPanes(on) {
  for (const part of document.querySelectorAll('#canvas, #controls, #fold, .pane'))
    part.hidden = !on;
  for (const poster of document.querySelectorAll('.poster')) poster.hidden = on;
}

function fail(message) {
  say(message);
  element('panel').classList.remove('folded');
  document.querySelectorAll('dialog[open]').forEach(dialog => dialog.close());
  document.body.classList.add('plain');
  element('status').classList.add('notice');
  showPanes(false);
  for (const button of document.querySelectorAll('button[data-camera]')) button.disabled = true;
}
