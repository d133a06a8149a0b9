// Moves the camera. A view has: `rows` of camera_from_world (right, down, forward), `centre`, the
// `lens` of a picture {width, height, fx, fy, cx, cy} that is fitted into the canvas, the `pivot`
// of rotations, and its `distance`. `bounded`: the pivot does not lie behind a surface;
// `chosen`: the user chose it.
'use strict';

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, b, scale = 1) => [0, 1, 2].map(i => a[i] + scale * b[i]);
const minus = (a, b) => plus(a, b, -1);
const cross =
    (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = a => Math.sqrt(dot(a, a));
const unit = a => a.map(x => x / (norm(a) || 1));
function rotated(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle), w = cross(axis, v),
        along = dot(axis, v) * (1 - c);
  return [0, 1, 2].map(i => c * v[i] + s * w[i] + along * axis[i]);
}

/** Scales and centres the picture so that it just fits. */
function lensIn(view, width, height) {
  const l = view.lens, s = Math.min(width / l.width, height / l.height);
  return {
    fx: s * l.fx,
    fy: s * l.fy,
    cx: width / 2 + s * (l.cx - l.width / 2),
    cy: height / 2 + s * (l.cy - l.height / 2)
  };
}

function withPivot(view, pivot) {
  return {...view, pivot, distance: norm(minus(pivot, view.centre))};
}

/** The view of a camera; its pivot is the point on its axis nearest to the middle of the scene. */
function viewOf(camera, scene) {
  const view = {rows: camera.rows, centre: camera.centre, lens: camera};
  const ahead = dot(minus(scene.middle, camera.centre), camera.rows[2]);
  return withPivot(view, plus(camera.centre, camera.rows[2], Math.max(ahead, 0.2 * scene.radius)));
}

function turned(view, up, yaw, pitch) {
  const about = (v, axis, angle) => ({
    ...v,
    rows: v.rows.map(r => rotated(r, axis, angle)),
    centre: plus(v.pivot, rotated(minus(v.centre, v.pivot), axis, angle))
  });
  const round = about(view, up, yaw);
  const over = about(round, round.rows[0], pitch);
  const rise = v => Math.abs(dot(v.rows[2], up));
  return rise(over) > 0.996 && rise(over) > rise(round) ? round : over;  // stops before the pole
}

function shifted(view, ...ways) {  // right, down, ahead
  const by = ways.reduce((sum, x, i) => plus(sum, view.rows[i], x * view.distance), [0, 0, 0]);
  return {
    ...view,
    centre: plus(view.centre, by),
    pivot: plus(view.pivot, by),
    bounded: false,
    chosen: false
  };
}

/** Keeps the distance to the pivot between `scene.nearest` and `scene.farthest`. */
function zoomed(view, factor, scene) {
  const far = Math.min(
      Math.max(view.distance * factor, Math.min(scene.nearest, view.distance)),
      Math.max(scene.farthest, view.distance));
  return withPivot(
      {...view, centre: plus(view.pivot, minus(view.centre, view.pivot), far / view.distance)},
      view.pivot);
}

/** Rows of a camera with this viewing direction; `right` need not be perpendicular to it. */
function rowsOf(right, forward) {
  const f = unit(forward), r = unit(plus(right, f, -dot(right, f)));
  return [r, cross(f, r), f];
}

/** Interpolates between two views. */
function between(a, b, share) {
  const mix = (x, y) => x + (y - x) * share, lens = {};
  const mixed = (x, y) => x.map((_, i) => mix(x[i], y[i]));
  for (const key of ['width', 'height', 'fx', 'fy', 'cx', 'cy'])
    lens[key] = mix(a.lens[key], b.lens[key]);
  const rows = rowsOf(mixed(a.rows[0], b.rows[0]), mixed(a.rows[2], b.rows[2]));
  return withPivot({rows, lens, centre: mixed(a.centre, b.centre)}, mixed(a.pivot, b.pivot));
}

/** Homogeneous pixel coordinates of a point. */
function projected(view, lens, place) {
  const d = minus(place, view.centre), [x, y, z] = view.rows.map(r => dot(r, d));
  return [lens.fx * x + lens.cx * z, lens.fy * y + lens.cy * z, z];
}

/** The point at a pixel of a camera's picture, at `depth` in front of the camera. */
function placeAt(camera, x, y, depth) {
  const ray = [(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1];
  return [0, 1, 2].map(
      a => camera.centre[a] + depth * ray.reduce((sum, r, k) => sum + r * camera.rows[k][a], 0));
}
