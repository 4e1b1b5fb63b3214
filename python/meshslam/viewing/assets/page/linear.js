// Vectors are arrays of three, matrices of OpenGL column by column, poses twelve numbers row by row.
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const plus = (a, b, scale = 1) => [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };
const mix = (a, b, t) => a.map((v, i) => v + t * (b[i] - v));
const times = (a, b) => {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
};
const lookFrom = (eye, right, up, back) => [
  right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
];
const lookAt = (eye, target) => {
  const back = unit(sub(eye, target)), right = unit(cross([0, 0, 1], back));
  return lookFrom(eye, right, cross(back, right), back);
};
const perspective = (fov, aspect, near, far) => {
  const f = 1 / Math.tan(fov / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
};
const column = (pose, k) => [pose[k], pose[4 + k], pose[8 + k]];
const centreOf = (pose) => column(pose, 3);
const place = (pose, p) => [0, 1, 2].map((r) => pose[4 * r] * p[0] + pose[4 * r + 1] * p[1] + pose[4 * r + 2] * p[2] + pose[4 * r + 3]);

// A run's own camera for OpenGL: its intrinsics, pixels of a part (x, y, width, height) of its image.
const cameraMatrix = (camera, pose, [x, y, width, height], near, far) => {
  const projection = [
    2 * camera.fx / width, 0, 0, 0, -2 * camera.skew / width, 2 * camera.fy / height, 0, 0,
    1 - 2 * (camera.cx + 0.5 - x) / width, 2 * (camera.cy + 0.5 - y) / height - 1, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0,
  ];
  return times(projection, lookFrom(centreOf(pose), column(pose, 0), column(pose, 1).map((v) => -v), column(pose, 2).map((v) => -v)));
};

// Which spheres a view shows: its four sides and what is before the eye (Gribb and Hartmann 2001).
const sphereTest = (view) => {
  const row = (r) => [0, 1, 2, 3].map((c) => view[4 * c + r]), w = row(3);
  const planes = [w, ...[0, 1].flatMap((r) => [1, -1].map((sign) => w.map((v, c) => v + sign * row(r)[c])))];
  const scaled = planes.map((p) => { const n = Math.hypot(p[0], p[1], p[2]) || 1; return p.map((v) => v / n); });
  return (centre, radius) => scaled.every((p) => dot(p, centre) + p[3] > -radius);
};
