// WebGL shaders. Formulas as in projection_math.h, surfel_math.h, sh_math.h and blend_math.h; tests
// compare the pictures.
'use strict';

const kVersion = '#version 300 es\nprecision highp float;\nprecision highp int;\n' +
    'precision highp usampler2D;\nprecision highp usampler2DArray;\n';

/** Values of uLook: how a mesh is drawn. */
const looks = Object.fromEntries([
  'colors', 'plain', 'normals', 'error', 'wire', 'fill', 'depth', 'texture'
].map((name, i) => [name, i]));
const kBins = 1024;  // depths of a probe

const kSplatSource = `
uniform usampler2D uPlaces, uShapes;
ivec2 cellOf(uint splat) { return ivec2(int(splat & 1023u), int(splat >> 10)); }
vec4 bytesOf(uint word) {
  return vec4(word & 255u, word >> 8 & 255u, word >> 16 & 255u, word >> 24);
}
`;

/** A triangle that covers the whole image. */
const kScreenVertex = kVersion + `
out vec2 vAt;
void main() {
  vAt = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.;
  gl_Position = vec4(vAt * 2. - 1., 0, 1);
}`;

/** Computes the colours of all splats as seen from uCentre, once per camera position. */
const kColorFragment = kVersion + kSplatSource + `
uniform usampler2DArray uSh;
uniform sampler2D uPalette;
uniform int uCount, uCoefficients;
uniform bool uErrors;
uniform vec3 uCentre;
out vec4 color;
float coefficient(ivec2 cell, int byte) {
  uvec4 words = texelFetch(uSh, ivec3(cell, byte >> 4), 0);
  uint word = words[byte >> 2 & 3];
  return (float(word >> uint(8 * (byte & 3)) & 255u) - 128.) / 128.;
}
void main() {
  ivec2 cell = ivec2(gl_FragCoord.xy);
  color = vec4(0, 0, 0, 1);
  if (cell.y * 1024 + cell.x >= uCount) return;
  uvec4 place = texelFetch(uPlaces, cell, 0);
  if (uErrors) {
    int level = int(texelFetch(uShapes, cell, 0).x >> 24);
    color = texelFetch(uPalette, ivec2(level, 0), 0);
    return;
  }
  vec3 v = normalize(uintBitsToFloat(place.xyz) - uCentre);
  float x = v.x, y = v.y, z = v.z, xx = x * x, yy = y * y, zz = z * z;
  float Y[15] = float[15](
    -.4886025119029199 * y, .4886025119029199 * z, -.4886025119029199 * x,
    1.0925484305920792 * x * y, -1.0925484305920792 * y * z,
    .31539156525252005 * (2. * zz - xx - yy), -1.0925484305920792 * x * z,
    .5462742152960396 * (xx - yy), -.5900435899266435 * y * (3. * xx - yy),
    2.890611442640554 * x * y * z, -.4570457994644658 * y * (4. * zz - xx - yy),
    .3731763325901154 * z * (2. * zz - 3. * xx - 3. * yy),
    -.4570457994644658 * x * (4. * zz - xx - yy), 1.445305721320277 * z * (xx - yy),
    -.5900435899266435 * x * (xx - 3. * yy));
  vec3 sum = .5 + .28209479177387814 * (bytesOf(place.w).rgb / 255. - .5) / .15;
  for (int k = 0; k < uCoefficients; ++k)
    sum += Y[k] * vec3(coefficient(cell, 3 * k), coefficient(cell, 3 * k + 1),
                       coefficient(cell, 3 * k + 2));
  color = vec4(max(sum, 0.), 1);
}`;

/** Shared by both kinds of splats. \`reach\`: radius in deviations where alpha falls to uLeast. */
const kSplatVertexHead = kVersion + kSplatSource + `
uniform sampler2D uColors;
uniform vec3 uRight, uDown, uForward, uOffset;  // camera_from_world
uniform vec4 uLens, uClamp;                     // fx, fy, cx, cy in px; range of x/z and y/z
uniform vec2 uSize;                             // px
uniform float uNear, uLowPass, uLeast;
uniform vec3 uLow, uHigh;  // of the cut
uniform bool uDots, uProbe;
uniform vec2 uPixel;  // of a probe, px
layout(location = 0) in uint aSplat;
flat out vec4 vColor;
flat out float vProbed;
out vec2 vAt;
vec3 place, p, scales, axisX, axisY, axisZ;
float opacity, reach;
bool fetchSplat() {
  ivec2 cell = cellOf(aSplat);
  uvec4 words = texelFetch(uPlaces, cell, 0);
  uvec2 shape = texelFetch(uShapes, cell, 0).xy;
  place = uintBitsToFloat(words.xyz);
  p = vec3(dot(uRight, place), dot(uDown, place), dot(uForward, place)) + uOffset;
  opacity = float(words.w >> 24) / 255.;
  vColor = vec4(texelFetch(uColors, cell, 0).rgb, opacity);
  gl_Position = vec4(2, 2, 2, 1);  // outside of the image
  vProbed = 0.;
  if (any(lessThan(place, uLow)) || any(greaterThan(place, uHigh))) return false;
  if (!(p.z > uNear) || !(opacity > uLeast)) return false;
  reach = sqrt(2. * log(opacity / uLeast));
  scales = exp(bytesOf(shape.x).xyz / 16. - 10.);
  // The smallest three of (x, y, z, w), stored from the last one on.
  uint c = shape.y, largest = c >> 30;
  vec4 q;
  float sum = 0.;
  for (int i = 3; i >= 0; --i) {
    if (uint(i) == largest) continue;
    float m = float(c & 511u) / 511. * .7071067811865476;
    q[i] = (c & 512u) != 0u ? -m : m;
    sum += m * m;
    c >>= 10;
  }
  q[int(largest)] = sqrt(max(0., 1. - sum));
  q = normalize(q);
  float x = q.x, y = q.y, z = q.z, w = q.w;
  axisX = vec3(1. - 2. * (y * y + z * z), 2. * (x * y + w * z), 2. * (x * z - w * y));
  axisY = vec3(2. * (x * y - w * z), 1. - 2. * (x * x + z * z), 2. * (y * z + w * x));
  axisZ = vec3(2. * (x * z + w * y), 2. * (y * z - w * x), 1. - 2. * (x * x + y * y));
  return true;
}
vec2 corner() { return vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2. - 1.; }
vec2 projected() { return uLens.xy * p.xy / p.z + uLens.zw; }
/// Sets the vertex to px, counted from the top left corner, with the depth scale of meshes.
void put(vec2 px) {
  gl_Position = vec4(2. * px.x / uSize.x - 1., 1. - 2. * px.y / uSize.y,
                     1. - 2. * uNear / p.z, 1);
}
bool dotted() {
  if (!uDots) return false;
  vAt = corner();
  put(projected() + 2. * vAt);
  return true;
}
/// Covers the probe's row; vProbed: depth where the ray of uPixel comes nearest to the centre, in
/// deviations s.
void probe(vec3 s) {
  vec2 slope = (uPixel - uLens.zw) / uLens.xy;
  vec3 ray = slope.x * uRight + slope.y * uDown + uForward;
  vec3 to = p.x * uRight + p.y * uDown + p.z * uForward;
  ray = vec3(dot(ray, axisX), dot(ray, axisY), dot(ray, axisZ)) / s;
  to = vec3(dot(to, axisX), dot(to, axisY), dot(to, axisZ)) / s;
  vProbed = dot(ray, to) / dot(ray, ray);
  if (vProbed > uNear) gl_Position = vec4(corner(), 0, 1);
}
`;

const kSplatFragmentHead = kVersion + `
flat in vec4 vColor;
flat in float vProbed;
in vec2 vAt;
uniform bool uDots, uProbe;
uniform vec2 uBins;  // depth where a probe's bins begin, and the logarithm of their range
out vec4 color;
void blend(float gauss) {
  // The pixel of a bin sums the splats up to the end of the bin.
  if (uProbe && vProbed > uBins.x * exp(uBins.y * ceil(gl_FragCoord.x) / ${kBins}.)) discard;
  float alpha = min(.99, vColor.a * gauss);
  if (!(alpha >= 1. / 255.)) discard;
  color = vec4(vColor.rgb * alpha, alpha);
}
bool dotted() {
  if (!uDots) return false;
  if (dot(vAt, vAt) > 1.) discard;
  color = vec4(vColor.rgb, 1);
  return true;
}
`;

/** Ellipses: vAt is in standard deviations along the image axes of the ellipse. */
const kEllipseVertex = kSplatVertexHead + `
void main() {
  if (!fetchSplat() || dotted()) return;
  vec2 slope = clamp(p.xy / p.z, uClamp.xz, uClamp.yw);
  vec3 T0 = uLens.x / p.z * (uRight - slope.x * uForward);
  vec3 T1 = uLens.y / p.z * (uDown - slope.y * uForward);
  vec2 a = scales.x * vec2(dot(T0, axisX), dot(T1, axisX));
  vec2 b = scales.y * vec2(dot(T0, axisY), dot(T1, axisY));
  vec2 c = scales.z * vec2(dot(T0, axisZ), dot(T1, axisZ));
  // The determinant as a sum of squares; the difference has no precision for thin splats.
  vec3 areas = vec3(a.x * b.y - a.y * b.x, b.x * c.y - b.y * c.x, c.x * a.y - c.y * a.x);
  float det = uLowPass * (uLowPass + dot(a, a) + dot(b, b) + dot(c, c)) + dot(areas, areas);
  if (!(det > 1e-6) || !(det < 1e30)) return;  // too small to be visible, or too large for floats
  float xx = uLowPass + a.x * a.x + b.x * b.x + c.x * c.x;
  float yy = uLowPass + a.y * a.y + b.y * b.y + c.y * c.y;
  float xy = a.x * a.y + b.x * b.y + c.x * c.y;
  float more = .5 * (xx + yy) + length(vec2(.5 * (xx - yy), xy)), less = det / more;
  vec2 axis = xx >= yy ? vec2(more - yy, xy) : vec2(xy, more - xx);
  axis = dot(axis, axis) > 0. ? normalize(axis) : vec2(1, 0);
  if (uProbe) {
    vec2 off = uPixel - projected();
    vAt = vec2(dot(off, axis) / sqrt(more), dot(off, vec2(-axis.y, axis.x)) / sqrt(less));
    if (dot(vAt, vAt) < reach * reach) probe(scales);
    return;
  }
  vAt = reach * corner();
  put(projected() + vAt.x * sqrt(more) * axis + vAt.y * sqrt(less) * vec2(-axis.y, axis.x));
}`;
const kEllipseFragment = kSplatFragmentHead + `
void main() {
  if (!dotted()) blend(exp(-.5 * dot(vAt, vAt)));
}`;

/** Discs, intersected by the ray [2DGS]: vAt is in px from the projected centre. */
const kDiscVertex = kSplatVertexHead + `
flat out vec4 vRows;   // u and v per px and unit of depth
flat out vec3 vDepth;  // slope of the inverse depth, and its value at the centre
flat out vec2 vDot;
bool box(vec2 rx, vec2 ry, vec2 rz, float r, out vec2 middle, out vec2 extent) {
  float d0 = r * r * dot(rz, rz) - p.z * p.z;
  if (!(d0 < 0.)) return false;
  float f = r * r / d0;
  middle = f * vec2(dot(rx, rz), dot(ry, rz));
  extent = sqrt(max(middle * middle - f * vec2(dot(rx, rx), dot(ry, ry)), 1e-4));
  return true;
}
vec3 inCamera(vec3 v) { return vec3(dot(uRight, v), dot(uDown, v), dot(uForward, v)); }
void main() {
  if (!fetchSplat() || dotted()) return;
  vec3 a = scales.x * inCamera(axisX), b = scales.y * inCamera(axisY);
  vec2 at = uLens.xy * p.xy / p.z;
  vec2 rx = vec2(uLens.x * a.x - at.x * a.z, uLens.x * b.x - at.x * b.z);
  vec2 ry = vec2(uLens.y * a.y - at.y * a.z, uLens.y * b.y - at.y * b.z);
  vec2 rz = vec2(a.z, b.z);
  float det = rx.x * ry.y - rx.y * ry.x;
  if (!(det * det > 1e-12 * dot(rx, rx) * dot(ry, ry))) return;  // seen from the edge
  vec2 u = vec2(ry.y, -rx.y) / det, v = vec2(-ry.x, rx.x) / det;
  vRows = vec4(u, v);
  vDepth = vec3(-(rz.x * u + rz.y * v) / p.z, 1. / p.z);
  vec2 middle, extent;
  if (!box(rx, ry, rz, 3., vDot, extent) || !box(rx, ry, rz, reach, middle, extent)) return;
  float blur = reach * .70710678;
  vec2 low = min(middle - extent, vDot - blur), high = max(middle + extent, vDot + blur);
  if (!(max(high.x - low.x, high.y - low.y) < 2e6)) return;
  vec2 centre = projected();
  if (uProbe) {
    vAt = uPixel - centre;
    if (all(greaterThan(vAt, low)) && all(lessThan(vAt, high)))
      probe(vec3(scales.xy, 1e-3 * min(scales.x, scales.y)));
    return;
  }
  low = max(low, -centre - 1.), high = min(high, uSize - centre + 1.);
  if (!(low.x < high.x && low.y < high.y)) return;
  vAt = mix(low, high, .5 * corner() + .5);
  put(centre + vAt);
}`;
const kDiscFragment = kSplatFragmentHead + `
flat in vec4 vRows;
flat in vec3 vDepth;
flat in vec2 vDot;
void main() {
  if (dotted()) return;
  float nearness = dot(vDepth.xy, vAt) + vDepth.z;
  if (!(abs(nearness - 10.025 * vDepth.z) < 9.975 * vDepth.z)) discard;
  vec2 uv = vec2(dot(vRows.xy, vAt), dot(vRows.zw, vAt)) / nearness, off = vAt - vDot;
  blend(exp(-.5 * min(dot(uv, uv), 2. * dot(off, off))));
}`;

const kMeshVertex = kVersion + `
uniform vec3 uRight, uDown, uForward, uOffset, uCorner, uSpan;
uniform vec4 uLens;
uniform vec2 uSize;
uniform float uNear;
layout(location = 0) in vec4 aPlace;
layout(location = 1) in vec4 aLook;  // colour, then error
layout(location = 2) in vec2 aAt;    // place in the texture
out vec2 vAt;
out vec3 vPlace;
out vec3 vWorld;
out vec3 vColor;
out float vError;
void main() {
  vec3 place = uCorner + uSpan * aPlace.xyz;
  vec3 p = vec3(dot(uRight, place), dot(uDown, place), dot(uForward, place)) + uOffset;
  vPlace = p, vWorld = place, vColor = aLook.rgb, vError = aLook.a, vAt = aAt;
  gl_Position = vec4(2. * (uLens.x * p.x + uLens.z * p.z) / uSize.x - p.z,
                     p.z - 2. * (uLens.y * p.y + uLens.w * p.z) / uSize.y,
                     p.z - 2. * uNear, p.z);
}`;
const kMeshFragment = kVersion + `
uniform sampler2D uPalette, uTexture;
uniform vec3 uLow, uHigh;  // of the cut
uniform int uLook;
in vec2 vAt;
in vec3 vPlace;
in vec3 vWorld;
in vec3 vColor;
in float vError;
out vec4 color;
void main() {
  vec3 normal = normalize(cross(dFdx(vPlace), dFdy(vPlace)));
  if (any(lessThan(vWorld, uLow)) || any(greaterThan(vWorld, uHigh))) discard;
  float facing = dot(normal, normalize(vPlace));
  if (facing > 0.) normal = -normal;  // towards the camera
  vec3 own = vColor;
  if (uLook == ${looks.plain}) own = vec3(.85);
  if (uLook == ${looks.error}) own = texelFetch(uPalette, ivec2(int(255. * vError + .5), 0), 0).rgb;
  color = vec4(own * mix(.45, 1., abs(facing)), 1);
  vec3 painted = texture(uTexture, vAt).rgb;  // photographs have their light
  if (uLook == ${looks.texture}) color.rgb = painted;
  if (uLook == ${looks.normals}) color.rgb = .5 + .5 * vec3(normal.x, -normal.yz);
  if (uLook == ${looks.fill}) color.rgb = vec3(.1);
  if (uLook == ${looks.wire}) color.rgb = vec3(.6, .85, 1);
  if (uLook == ${looks.depth}) {
    uint bits = floatBitsToUint(vPlace.z);
    color = vec4(bits & 255u, bits >> 8 & 255u, bits >> 16 & 255u, bits >> 24) / 255.;
  }
}`;

/** Draws the sums of a pane to the canvas, over black. */
const kFinishFragment = kVersion + `
uniform sampler2D uSums;
uniform vec2 uShare;
in vec2 vAt;
out vec4 color;
void main() { color = vec4(texture(uSums, vAt * uShare).rgb, 1); }`;
