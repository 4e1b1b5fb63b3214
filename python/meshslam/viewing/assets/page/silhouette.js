// A mesh as the run's camera sees it: the area that it covers and its contour, as paths in pixels of the image.
const NEAREST_M = 0.1;
const silhouette = (mesh, camera, pose) => {
  const { place: p, topology: { faces, edges } } = mesh, count = p.length / 3;
  const u = new Float32Array(count), v = new Float32Array(count), z = new Float32Array(count);
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  let depth = 0, shown = 0;
  for (let i = 0; i < count; i++) {
    const x = p[3 * i] - pose[3], y = p[3 * i + 1] - pose[7], w = p[3 * i + 2] - pose[11];
    const a = pose[0] * x + pose[4] * y + pose[8] * w, b = pose[1] * x + pose[5] * y + pose[9] * w;
    z[i] = pose[2] * x + pose[6] * y + pose[10] * w;
    depth += z[i] / count;
    if (z[i] < NEAREST_M) continue;
    u[i] = (camera.fx * a + camera.skew * b) / z[i] + camera.cx;
    v[i] = camera.fy * b / z[i] + camera.cy;
    box[0] = Math.min(box[0], u[i]); box[1] = Math.min(box[1], v[i]); box[2] = Math.max(box[2], u[i]); box[3] = Math.max(box[3], v[i]);
    shown++;
  }
  if (!shown || box[2] < 0 || box[3] < 0 || box[0] > camera.width - 1 || box[1] > camera.height - 1) return null;
  const area = new Path2D(), contour = new Path2D(), side = new Int8Array(faces.length / 3);
  for (let f = 0; f < side.length; f++) {
    const [i, j, k] = [faces[3 * f], faces[3 * f + 1], faces[3 * f + 2]];
    if (Math.min(z[i], z[j], z[k]) < NEAREST_M) continue;
    side[f] = (u[j] - u[i]) * (v[k] - v[i]) - (v[j] - v[i]) * (u[k] - u[i]) < 0 ? 1 : -1;
    if (side[f] < 0) continue;
    area.moveTo(u[i], v[i]); area.lineTo(u[j], v[j]); area.lineTo(u[k], v[k]); area.closePath();
  }
  for (let e = 0; e < edges.length; e += 4) {
    const [a, b, f, g] = [edges[e], edges[e + 1], edges[e + 2], edges[e + 3]];
    if (Math.min(z[a], z[b]) < NEAREST_M || (g >= 0 && side[f] === side[g])) continue;
    contour.moveTo(u[a], v[a]); contour.lineTo(u[b], v[b]);
  }
  return { area, contour, depth, box };
};

// The borders of a mask as one path; filled by the even-odd rule it is the mask.
const maskPath = (detection) => {
  if (detection.path) return detection.path;
  const path = new Path2D();
  for (const border of detection.borders) {
    for (let i = 0; i < border.length; i += 2) i ? path.lineTo(border[i], border[i + 1]) : path.moveTo(border[0], border[1]);
    path.closePath();
  }
  detection.path = path;
  return path;
};
