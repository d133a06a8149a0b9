// Draws runs: textures, the order of splats, render targets.
'use strict';

class Renderer {
  /** Throws where there is no WebGL 2. `accumulate`: 16 or 8 bits of the blended sums. */
  constructor(canvas, accumulate) {
    const gl = this.gl = canvas.getContext(
        'webgl2',
        {antialias: false, alpha: false, depth: false, powerPreference: 'high-performance'});
    if (!gl) throw Error('this browser has no WebGL 2, or has switched it off');
    const floats =
        gl.getExtension('EXT_color_buffer_float') || gl.getExtension('EXT_color_buffer_half_float');
    this.bits = floats && accumulate !== 8 ? 16 : 8;
    this.format = this.bits === 16 ? gl.RGBA16F : gl.RGBA8;
    this.programs = {
      colors: this.makeProgram(kScreenVertex, kColorFragment),
      ellipses: this.makeProgram(kEllipseVertex, kEllipseFragment),
      discs: this.makeProgram(kDiscVertex, kDiscFragment),
      mesh: this.makeProgram(kMeshVertex, kMeshFragment),
      finish: this.makeProgram(kScreenVertex, kFinishFragment)
    };
    this.runs = [];
    this.target = null;
    this.nothing = gl.createVertexArray();
  }

  makeProgram(vertex, fragment) {
    const gl = this.gl, handle = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(handle, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
        throw Error('shader: ' + gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(handle);
    if (!gl.getProgramParameter(handle, gl.LINK_STATUS) && !gl.isContextLost())
      throw Error('shaders: ' + gl.getProgramInfoLog(handle));
    const at = {};
    for (let i = 0; i < gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS); ++i) {
      const {name} = gl.getActiveUniform(handle, i);
      at[name] = gl.getUniformLocation(handle, name);
    }
    return {handle, at};
  }

  texture(kind, allocate, fill, filter) {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(kind, texture);
    allocate();
    if (fill) fill();
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(kind, name, filter || gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T])
      gl.texParameteri(kind, name, gl.CLAMP_TO_EDGE);
    return texture;
  }

  flat(format, width, height, layout, type, data) {
    const gl = this.gl;
    return this.texture(
        gl.TEXTURE_2D, () => gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height),
        data &&
            (() => gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, layout, type, data)));
  }

  /** `about`: the page's description of the run; `palette`: 256 x RGBA of errors. */
  addRun(about, splats, mesh, palette, onOrder) {
    const gl = this.gl, run = {about, onOrder};
    run.palette = this.flat(gl.RGBA8, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, palette);
    if (mesh) this.addMesh(run, mesh);
    run.cloud = this.makeCloud(run, splats);
    this.runs.push(run);
    return run;
  }

  /** Uploads splats and starts their sorting worker; they are shown after the first sort. */
  makeCloud(run, splats) {
    const gl = this.gl, {rows, layers} = splats;
    const cloud = {count: splats.count, drawn: 0, degree: splats.degree, rows, colorKey: ''};
    if (rows > gl.getParameter(gl.MAX_TEXTURE_SIZE))
      throw Error(
          `this device's textures hold ${1024 * gl.getParameter(gl.MAX_TEXTURE_SIZE)} ` +
          'splats at most; make the page with --max-splats');
    cloud.places =
        this.flat(gl.RGBA32UI, kPerRow, rows, gl.RGBA_INTEGER, gl.UNSIGNED_INT, splats.places);
    cloud.shapes =
        this.flat(gl.RG32UI, kPerRow, rows, gl.RG_INTEGER, gl.UNSIGNED_INT, splats.shapes);
    const array = gl.TEXTURE_2D_ARRAY, depth = Math.max(layers, 1);
    cloud.sh = this.texture(
        array,
        () =>
            gl.texStorage3D(array, 1, gl.RGBA32UI, layers ? kPerRow : 1, layers ? rows : 1, depth),
        layers &&
            (() => gl.texSubImage3D(
                 array, 0, 0, 0, 0, kPerRow, rows, depth, gl.RGBA_INTEGER, gl.UNSIGNED_INT,
                 splats.sh)));
    cloud.colors = this.flat(this.format, kPerRow, rows);
    cloud.colorTarget = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, cloud.colorTarget);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, cloud.colors, 0);
    cloud.order = gl.createBuffer();
    cloud.quads = gl.createVertexArray();
    gl.bindVertexArray(cloud.quads);
    gl.bindBuffer(gl.ARRAY_BUFFER, cloud.order);
    gl.bufferData(gl.ARRAY_BUFFER, 4 * Math.max(splats.count, 1), gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.bindVertexArray(null);

    cloud.box = boxOf(splats.positions);
    cloud.worker = workerOf(`(${sorter})()`);
    cloud.worker.postMessage({positions: splats.positions}, [splats.positions.buffer]);
    cloud.sorting = false, cloud.sortedFor = null, cloud.spare = null;
    cloud.worker.onmessage = ({data}) => {
      cloud.sorting = false, cloud.drawn = data.count, cloud.spare = data.order;
      gl.bindBuffer(gl.ARRAY_BUFFER, cloud.order);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, data.order, 0, data.count);
      if (run.cloud !== cloud) this.removeCloud(run.cloud), run.cloud = cloud;
      run.onOrder();
    };
    return cloud;
  }

  removeCloud(cloud) {
    const gl = this.gl;
    cloud.worker.terminate();
    for (const name of ['places', 'shapes', 'sh', 'colors']) gl.deleteTexture(cloud[name]);
    gl.deleteFramebuffer(cloud.colorTarget);
    gl.deleteBuffer(cloud.order);
    gl.deleteVertexArray(cloud.quads);
  }

  addMesh(run, mesh) {
    const gl = this.gl;
    run.mesh = gl.createVertexArray(), run.faces = mesh.faces;
    gl.bindVertexArray(run.mesh);
    const attribute = (at, data, type, size = 4) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, type, true, 0, 0);
    };
    attribute(0, mesh.positions, gl.UNSIGNED_SHORT);
    attribute(1, mesh.looks, gl.UNSIGNED_BYTE);
    if (mesh.texture) {
      attribute(2, mesh.places, gl.UNSIGNED_SHORT, 2);
      run.texture = this.texture(gl.TEXTURE_2D, () => {
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, gl.RGB, gl.UNSIGNED_BYTE, mesh.texture);
        gl.generateMipmap(gl.TEXTURE_2D);
      }, null, gl.LINEAR);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    }
    run.triangles = this.indexBuffer(mesh.faces);
  }

  indexBuffer(indices) {
    const gl = this.gl, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    return buffer;
  }

  /** Requests sorting for the view, unless the present order is exact, or close enough. */
  sort(cloud, near, view, exactly) {
    const [fx, fy, fz] = view.rows[2], offset = -dot(view.rows[2], view.centre);
    const last = cloud.sortedFor;
    if (cloud.sorting || cloud.count === 0) return;
    if (last && last.fx === fx && last.fy === fy && last.fz === fz && last.offset === offset &&
        (last.exactly || !exactly))
      return;
    const turned = last ? fx * last.fx + fy * last.fy + fz * last.fz : -1;
    if (last && !exactly && turned > Math.cos(0.5 * Math.PI / 180) &&
        Math.abs(offset - last.offset) < 0.002 * view.distance)
      return;
    cloud.sortedFor = {fx, fy, fz, offset, exactly}, cloud.sorting = true;
    const message = {forward: [fx, fy, fz], offset, near, exactly};
    if (cloud.spare) message.buffer = cloud.spare;
    cloud.worker.postMessage(message, cloud.spare ? [cloud.spare.buffer] : []);
    cloud.spare = null;
  }

  makeTarget(width, height) {
    const gl = this.gl;
    if (this.target && this.target.width === width && this.target.height === height) return;
    if (this.target) {
      gl.deleteTexture(this.target.sums);
      gl.deleteRenderbuffer(this.target.depth);
      gl.deleteFramebuffer(this.target.frame);
    }
    const sums = this.texture(
        gl.TEXTURE_2D, () => gl.texStorage2D(gl.TEXTURE_2D, 1, this.format, width, height), null,
        gl.LINEAR);
    const depth = gl.createRenderbuffer(), frame = gl.createFramebuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, sums, 0);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    this.target = {width, height, sums, depth, frame};
  }

  bind(unit, kind, texture, at) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(kind, texture);
    gl.uniform1i(at, unit);
  }

  setView(at, view, lens, width, height, near, box) {
    const gl = this.gl, [r, d, f] = view.rows, c = view.centre;
    gl.uniform3fv(at.uRight, r), gl.uniform3fv(at.uDown, d), gl.uniform3fv(at.uForward, f);
    gl.uniform3f(at.uOffset, -dot(r, c), -dot(d, c), -dot(f, c));
    gl.uniform4f(at.uLens, lens.fx, lens.fy, lens.cx, lens.cy);
    gl.uniform2f(at.uSize, width, height);
    gl.uniform1f(at.uNear, near);
    gl.uniform3fv(at.uLow, box ? box.low : [-1e38, -1e38, -1e38]);
    gl.uniform3fv(at.uHigh, box ? box.high : [1e38, 1e38, 1e38]);
  }

  /** Updates the splat colours; they depend only on the camera's centre and the kind of colours. */
  colorSplats(run, view, show) {
    const cloud = run.cloud,
          key = show.error ? 'error' :
        cloud.degree === 0 ? 'own' :
                             view.centre.join();
    if (key === cloud.colorKey) return;
    cloud.colorKey = key;
    const gl = this.gl, {handle, at} = this.programs.colors;
    gl.useProgram(handle);
    this.bind(0, gl.TEXTURE_2D, cloud.places, at.uPlaces);
    this.bind(1, gl.TEXTURE_2D, cloud.shapes, at.uShapes);
    this.bind(2, gl.TEXTURE_2D_ARRAY, cloud.sh, at.uSh);
    this.bind(3, gl.TEXTURE_2D, run.palette, at.uPalette);
    gl.uniform1i(at.uCount, cloud.count);
    gl.uniform1i(at.uCoefficients, (cloud.degree + 1) * (cloud.degree + 1) - 1);
    gl.uniform1i(at.uErrors, Boolean(show.error));
    gl.uniform3fv(at.uCentre, view.centre);
    gl.bindFramebuffer(gl.FRAMEBUFFER, cloud.colorTarget);
    gl.viewport(0, 0, kPerRow, cloud.rows);
    gl.bindVertexArray(this.nothing);
    gl.disable(gl.BLEND);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /**
   * Draws a run into the lower left part of the target; `width` and `height` must fit in it.
   * `show`: a mode of the view, and the box of the cut.
   */
  drawRun(run, view, width, height, show) {
    const gl = this.gl, lens = lensIn(view, width, height);
    if (show.splats || show.centres) this.colorSplats(run, view, show);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
    this.clear(width, height);
    if (show.mesh && run.mesh && show.look === 'wire') {
      gl.enable(gl.POLYGON_OFFSET_FILL);
      gl.polygonOffset(1, 1);
      this.drawMesh(run, view, lens, width, height, show.box, 'fill');
      gl.disable(gl.POLYGON_OFFSET_FILL);
    }
    if (show.mesh && run.mesh) this.drawMesh(run, view, lens, width, height, show.box, show.look);
    if (show.splats || show.centres) this.drawSplats(run, view, lens, width, height, show);
  }

  clear(width, height) {
    const gl = this.gl;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  drawMesh(run, view, lens, width, height, box, look) {
    const gl = this.gl, {handle, at} = this.programs.mesh, {low, high} = run.about.mesh;
    gl.useProgram(handle);
    this.setView(at, view, lens, width, height, run.about.near, box);
    this.bind(0, gl.TEXTURE_2D, run.palette, at.uPalette);
    gl.uniform3fv(at.uCorner, low);
    gl.uniform3fv(at.uSpan, minus(high, low));
    this.bind(1, gl.TEXTURE_2D, run.texture || run.palette, at.uTexture);
    gl.uniform1i(at.uLook, looks[look === 'colors' && run.texture ? 'texture' : look]);
    gl.enable(gl.DEPTH_TEST);
    gl.bindVertexArray(run.mesh);
    if (look === 'wire') {
      const next = i => i % 3 === 2 ? i - 2 : i + 1;
      run.edges = run.edges ||
          this.indexBuffer(new Uint32Array(2 * run.faces.length)
                               .map((_, k) => run.faces[k % 2 ? next(k >> 1) : k >> 1]));
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, run.edges);
      gl.drawElements(gl.LINES, 2 * run.faces.length, gl.UNSIGNED_INT, 0);
    } else {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, run.triangles);
      gl.drawElements(gl.TRIANGLES, run.faces.length, gl.UNSIGNED_INT, 0);
    }
    gl.disable(gl.DEPTH_TEST);
  }

  /** `probe`: {pixel, bins} of the shaders, or nothing. */
  drawSplats(run, view, lens, width, height, show, probe) {
    if (run.cloud.drawn === 0) return;
    const gl = this.gl,
          {handle, at} = run.about.discs ? this.programs.discs : this.programs.ellipses;
    gl.useProgram(handle);
    this.setView(at, view, lens, width, height, run.about.near, show.box);
    this.bind(0, gl.TEXTURE_2D, run.cloud.places, at.uPlaces);
    this.bind(1, gl.TEXTURE_2D, run.cloud.shapes, at.uShapes);
    this.bind(2, gl.TEXTURE_2D, run.cloud.colors, at.uColors);
    const u = [-lens.cx / lens.fx, (width - lens.cx) / lens.fx],
          v = [-lens.cy / lens.fy, (height - lens.cy) / lens.fy];
    const du = 0.15 * width / lens.fx, dv = 0.15 * height / lens.fy;
    gl.uniform4f(at.uClamp, u[0] - du, u[1] + du, v[0] - dv, v[1] + dv);
    gl.uniform1f(at.uLowPass, run.about.low_pass);
    gl.uniform1f(at.uLeast, run.about.least_alpha);
    gl.uniform1i(at.uDots, Boolean(show.centres && !probe));
    gl.uniform1i(at.uProbe, Boolean(probe));
    gl.uniform2fv(at.uPixel, probe ? probe.pixel : [0, 0]);
    gl.uniform2fv(at.uBins, probe ? probe.bins : [0, 0]);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindVertexArray(run.cloud.quads);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, run.cloud.drawn);
    gl.disable(gl.BLEND);
  }

  /**
   * Depth of the surface at a pixel of a picture of that size, or 0. Splats: the depth where half
   * of the pixel's opacity is reached.
   */
  depthAt(run, view, width, height, x, y, show) {
    const gl = this.gl, lens = lensIn(view, width, height), probe = this.probe = this.probe || {
      texture: this.flat(gl.RGBA8, kBins, 1),
      depth: gl.createRenderbuffer(),
      frame: gl.createFramebuffer(),
      pixels: new Uint8Array(4 * kBins)
    };
    gl.bindFramebuffer(gl.FRAMEBUFFER, probe.frame);
    gl.bindRenderbuffer(gl.RENDERBUFFER, probe.depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, kBins, 1);
    const at = gl.FRAMEBUFFER;
    gl.framebufferTexture2D(at, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, probe.texture, 0);
    gl.framebufferRenderbuffer(at, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, probe.depth);
    const read = n => gl.readPixels(0, 0, n, 1, gl.RGBA, gl.UNSIGNED_BYTE, probe.pixels);
    if (show.mesh) {
      if (!run.mesh) return 0;
      this.clear(1, 1);
      const shifted = {...lens, cx: lens.cx - x + 0.5, cy: lens.cy - y + 0.5};
      this.drawMesh(run, view, shifted, 1, 1, show.box, 'depth');
      read(1);
      return new DataView(probe.pixels.buffer).getFloat32(0, true);
    }
    let low = run.about.near, range = Math.log(1e6), half = 0;
    for (let pass = 0; pass < 2; ++pass) {
      this.clear(kBins, 1);
      this.drawSplats(run, view, lens, width, height, show, {pixel: [x, y], bins: [low, range]});
      read(kBins);
      const alpha = k => probe.pixels[4 * k + 3];
      if (pass === 0) half = alpha(kBins - 1) / 2;
      if (half < 20) return 0;  // of 255: nearly nothing is here
      let bin = 0;
      while (bin < kBins - 1 && alpha(bin) < half) ++bin;
      low *= Math.exp(range * bin / kBins), range /= kBins;
    }
    return low;
  }

  /** Copies the result of drawRun() into a rectangle of `frame` (null: the canvas). */
  finish(frame, x, y, width, height, drawnWidth, drawnHeight) {
    const gl = this.gl, {handle, at} = this.programs.finish;
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.viewport(x, y, width, height);
    gl.useProgram(handle);
    this.bind(0, gl.TEXTURE_2D, this.target.sums, at.uSums);
    gl.uniform2f(at.uShare, drawnWidth / this.target.width, drawnHeight / this.target.height);
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** RGBA of a picture of that size, rows from the top. */
  picture(run, view, width, height, show) {
    const gl = this.gl;
    this.makeTarget(width, height);
    this.drawRun(run, view, width, height, show);
    const texture = this.flat(gl.RGBA8, width, height), frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    this.finish(frame, 0, 0, width, height, width, height);
    const rows = new Uint8Array(4 * width * height), pixels = new Uint8Array(rows.length);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
    for (let y = 0; y < height; ++y)
      pixels.set(rows.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    gl.deleteFramebuffer(frame);
    gl.deleteTexture(texture);
    return pixels;
  }
}
