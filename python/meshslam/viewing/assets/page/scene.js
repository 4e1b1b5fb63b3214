// What the 3-D view shows beside the meshes: grid, paths, true meshes, the camera, the selected object's box.
const FRUSTUM_M = 1.6, TRAIL = 40;
const frustumEnds = (camera, pose, depth) => {
  const corner = (u, v) => place(pose, [
    depth * (u - camera.cx - camera.skew * (v - camera.cy) / camera.fy) / camera.fx, depth * (v - camera.cy) / camera.fy, depth,
  ]);
  const points = [centreOf(pose), corner(-0.5, -0.5), corner(camera.width - 0.5, -0.5), corner(camera.width - 0.5, camera.height - 0.5), corner(-0.5, camera.height - 0.5)];
  return [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]].flatMap(([a, b]) => [...points[a], ...points[b]]);
};
const boxEnds = (object, margin = 0.08) => {
  const m = object.matrix, [l, w, h] = object.dimensions.map((v) => v / 2 + margin);
  const corner = (k) => place(m, [k & 1 ? l : -l, k & 2 ? w : -w, k & 4 ? h : -h]);
  const pairs = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
  return pairs.flatMap(([a, b]) => [...corner(a), ...corner(b)]);
};
const joinedEnds = (parts) => {
  const all = new Float32Array(parts.reduce((sum, { ends }) => sum + ends.length, 0));
  parts.reduce((start, { ends }) => { all.set(ends, start); return start + ends.length; }, 0);
  return all;
};
const pathEnds = (points) => {
  const ends = [];
  for (let i = 0; i + 3 < points.length; i += 3) ends.push(...points.subarray(i, i + 6));
  return ends;
};

// Middle, radius and points of all that there is to see.
const extentOf = (run) => {
  const points = run.objects.flatMap((o) => [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((r) => (k >> r & 1 ? o.high : o.low)[r])));
  const path = run.paths[0].points, step = 3 * Math.max(1, Math.floor(path.length / 900));
  for (let i = 0; i < path.length; i += step) points.push([...path.subarray(i, i + 3)]);
  if (!points.length) points.push([0, 0, 0]);
  const low = [0, 1, 2].map((r) => Math.min(...points.map((p) => p[r]))), high = [0, 1, 2].map((r) => Math.max(...points.map((p) => p[r])));
  return { points, middle: mix(low, high, 0.5), radius: Math.max(4, Math.hypot(...sub(high, low)) / 2) };
};

const gridOf = (extent, ground) => {
  const { middle, radius } = extent, ends = [];
  const cell = [1, 2, 5, 10, 20, 50, 100, 200, 500].find((c) => 3 * radius / c < 60) || 1000, half = Math.ceil(1.6 * radius / cell) * cell;
  const x = Math.round(middle[0] / cell) * cell, y = Math.round(middle[1] / cell) * cell;
  for (let v = -half; v <= half + 1e-6; v += cell) ends.push(x + v, y - half, ground, x + v, y + half, ground, x - half, y + v, ground, x + half, y + v, ground);
  return { ends, centre: [x, y, ground], reach: half };
};
