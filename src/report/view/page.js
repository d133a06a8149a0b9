// Starts the page: reads its data, follows a training, and answers tests.
'use strict';

/** 256 x RGBA: colours of the error levels; the last one marks unmeasured points. */
function paletteOf(text) {
  const rgb = decodeBase64(text), palette = new Uint8Array(1024).fill(255);
  for (let i = 0; i < 256; ++i) palette.set(rgb.subarray(3 * i, 3 * i + 3), 4 * i);
  palette.set([136, 136, 136], 1020);
  return palette;
}

async function readRun(run, index) {
  const data = async (name, format) => {
    const holder = element(name + index);
    if (!holder) return null;
    const bytes = decodeBase64(holder.textContent);
    holder.remove();
    return inflate(bytes, format);
  };
  const errors = await data('errors', 'deflate'), mesh = await data('mesh', 'deflate');
  const splats = await unpackSplatsAside(await data('splats', 'gzip') || noSplats(), errors);
  const holder = element('texture' + index);
  const texture = mesh && holder &&
      await createImageBitmap(new Blob([decodeBase64(holder.textContent)], {type: 'image/jpeg'}));
  if (holder) holder.remove();
  return {splats, mesh: mesh && { ...unpackMesh(mesh, run.mesh), texture }};
}

/** Requests newer splats from the page's server while the training runs. */
async function follow(viewer) {
  // Screen readers announce only the end of the training, not its progress every few seconds.
  const run = viewer.renderer.runs[0], line = element('training'), note = (text, aloud) => {
    if (line.textContent === text) return;
    line.setAttribute('aria-live', aloud ? 'polite' : 'off');
    line.textContent = text;
  };
  for (let last = null; !viewer.canvas.hidden;) {
    let pause = document.hidden ? 5000 : 1000;
    try {
      const state = await (await fetch('api/state')).json();
      if (!state.live && last)
        return note('The training has ended. Reload this page to see the results.', true);
      if (!state.live) {
        note(state.finished ? '' : 'No training with --live yet; this page waits for one.');
        pause = 5000;
      } else if (state.tag !== last) {
        const bytes = new Uint8Array(await (await fetch('api/splats')).arrayBuffer());
        const splats = await patiently(unpackSplatsAside(
            await inflate(bytes, 'gzip'), null, minus(state.origin, about.origin)));
        viewer.renderer.sort(
            viewer.renderer.makeCloud(run, splats), run.about.near, viewer.view, true);
        last = state.tag;
      }
      const count = n => Math.round(n).toLocaleString('en');
      if (state.live)
        note(
            `Training: iteration ${count(state.iteration)} of ${count(state.iterations)}, ` +
            `${count(state.gaussians)} splats, ${count(state.seconds)} s, colours simplified` +
            (state.age > 30 ? `. Nothing new for ${count(state.age)} s.` : '.'));
    } catch (error) {
      note(`No answer from tvsgs-view (${error.message}); is it still running?`, true);
    }
    await new Promise(resolve => setTimeout(resolve, pause));
  }
}

/**
 * For test programs with a virtual clock (?test, ?wait): keeps the clock from running ahead while
 * workers work.
 */
async function patiently(promise) {
  let over = !query.has('test') && !query.has('wait'), sum = 0;
  const end = () => over = true;
  promise.then(end, end);
  while (!over) {
    for (let i = 0; i < 1e6; ++i) sum += Math.sin(i);
    await new Promise(resolve => setTimeout(resolve, 1));
  }
  return promise;
}

/** ?test=CAMERA&width=W&height=H: writes the pixels of the camera's view as text, for tests. */
async function test(viewer) {
  const renderer = viewer.renderer, gl = renderer.gl;
  const camera = about.cameras[Number(query.get('test'))];
  const size = name => Number(query.get(name) || camera[name]);
  const view = viewOf(camera, about.scene), results = [];
  for (const run of renderer.runs) {
    await new Promise(resolve => {
      viewer.ask = resolve;
      run.cloud.sortedFor = null;
      if (run.cloud.count === 0)
        resolve();
      else
        renderer.sort(run.cloud, run.about.near, view, true);
    });
    const pixels = renderer.picture(run, view, size('width'), size('height'), viewer.shown);
    let text = '';
    for (const byte of pixels) text += String.fromCharCode(byte);
    results.push(btoa(text));
  }
  const unmasked = gl.getExtension('WEBGL_debug_renderer_info');
  return {
    width: size('width'),
    height: size('height'),
    bits: renderer.bits,
    error: gl.getError(),
    renderer: gl.getParameter(unmasked ? unmasked.UNMASKED_RENDERER_WEBGL : gl.RENDERER),
    pixels: results
  };
}

async function main() {
  let result;
  document.body.classList.remove('plain');
  try {
    const renderer = new Renderer(element('canvas'), Number(query.get('bits')));
    const viewer = new Viewer(renderer);
    await patiently(viewer.start());
    if (query.has('test')) {
      result = await patiently(test(viewer));
    } else {
      viewer.begin();
      if (about.follow) follow(viewer);
    }
  } catch (error) {
    fail(`No view in 3D: ${error.message}. The pictures below work without it.`);
    if (query.has('test')) result = {failed: error.message};
  }
  if (!result) return;
  const out = document.createElement('pre');
  out.id = 'result';
  out.textContent = JSON.stringify(result);
  document.body.append(out);
}
main();
