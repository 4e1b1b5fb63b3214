// A mesh as the run's camera sees it: the area that it covers and its contour, as paths in pixels of the image.
const NEAREST_M = 0.1;
// Whether an object's surrounding sphere can be in the image at all, and is not too small to be seen.
const LEAST_PX = 8;
const inSight = ({ centre, radius }, camera, pose) => {
  const d = sub(centre, centreOf(pose)), [x, y, z] = [0, 1, 2].map((k) => dot(column(pose, k), d));
  if (z + radius < NEAREST_M || 2 * radius * camera.fx < LEAST_PX * z) return false;
  const beside = (way, focal, middle, size) => {  // the planes through the camera and the image's sides
    const low = (middle + 0.5) / focal, high = (size - 0.5 - middle) / focal;
    return way < -low * z - radius * Math.hypot(1, low) || way > high * z + radius * Math.hypot(1, high);
  };
  const skewed = x + camera.skew * y / camera.fx;
  return !beside(skewed, camera.fx, camera.cx, camera.width) && !beside(y, camera.fy, camera.cy, camera.height);
};
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
    area.moveTo(u[i], v[i]); area.lineTo(u[j], v[j]); area.lineTo(u[k], v[k]);  // filling closes it
  }
  for (let e = 0; e < edges.length; e += 4) {
    const [a, b, f, g] = [edges[e], edges[e + 1], edges[e + 2], edges[e + 3]];
    if (Math.min(z[a], z[b]) < NEAREST_M || (g >= 0 && side[f] === side[g])) continue;
    contour.moveTo(u[a], v[a]); contour.lineTo(u[b], v[b]);
  }
  return { area, contour, depth, box, u, v, side };
};

// Light on each face of a mesh, 0 to 1, from above and from the side; the same wherever the camera is.
const SHADES = 14;
const lightOf = (mesh) => {
  if (mesh.light) return mesh.light;
  const { place: p, topology: { faces } } = mesh, light = new Uint8Array(faces.length / 3), sun = unit([0.35, 0.25, 0.9]);
  const at = (i) => [p[3 * i], p[3 * i + 1], p[3 * i + 2]];
  for (let f = 0; f < light.length; f++) {
    const a = at(faces[3 * f]), n = unit(cross(sub(at(faces[3 * f + 1]), a), sub(at(faces[3 * f + 2]), a)));
    const lit = 0.30 + 0.25 * (0.5 + 0.5 * n[2]) + 0.35 * Math.max(0, dot(n, sun)) + 0.10 * Math.abs(n[0]);
    light[f] = Math.min(SHADES - 1, Math.floor(SHADES * lit));
  }
  mesh.light = light;
  return light;
};
// Value of each face: the mean of a vertex property, negative where it is not known.
const faceValues = (mesh, which) => {
  const { topology: { faces }, known } = mesh, found = new Float32Array(faces.length / 3);
  for (let f = 0; f < found.length; f++) found[f] = (known[2 * faces[3 * f] + which] + known[2 * faces[3 * f + 1] + which] + known[2 * faces[3 * f + 2] + which]) / 3;
  return found;
};
// Colours of a mesh's faces by colouring: how many there are, which one each face has.
const FACE_COLOURS = 7;
const faceColours = (object, colouring) => {
  if (colouring === "sigma") {
    const [low, high] = VERTEX_SIGMAS_M, at = (k) => low * (high / low) ** (k / (FACE_COLOURS - 1));
    const which = (v) => (v < 0 ? 0 : 1 + Math.round((FACE_COLOURS - 1) * Math.min(1, Math.max(0, Math.log(Math.max(v, 1e-6) / low) / Math.log(high / low)))));
    return { colours: [themed("--prior"), ...Array.from({ length: FACE_COLOURS }, (_, k) => ramp(at(k), VERTEX_SIGMAS_M))], which: Array.from(faceValues(object, 0), which) };
  }
  if (colouring === "seen") return { colours: [themed("--prior"), themed("--seen")], which: Array.from(faceValues(object, 1), (v) => (v > 0.5 ? 1 : 0)) };
  return { colours: [colourOf(object, colouring)], which: null };
};
// Fills a mesh's front faces, lit; small ones in one colour.
const SMALL_PX = 26;
const fillMesh = (pen, object, shown, colouring, scale) => {
  const { u, v, side, box } = shown, { faces } = object.topology;
  if (Math.max(box[2] - box[0], box[3] - box[1]) * scale < SMALL_PX) { pen.fillStyle = css(colourOf(object, colouring)); pen.fill(shown.area); return; }
  const light = lightOf(object), { colours, which } = faceColours(object, colouring), paths = new Map();
  for (let f = 0; f < side.length; f++) {
    if (side[f] <= 0) continue;
    const shade = SHADES * (which ? which[f] : 0) + light[f], path = paths.get(shade) || paths.set(shade, new Path2D()).get(shade);
    const [i, j, k] = [faces[3 * f], faces[3 * f + 1], faces[3 * f + 2]];
    path.moveTo(u[i], v[i]); path.lineTo(u[j], v[j]); path.lineTo(u[k], v[k]); path.lineTo(u[i], v[i]);
  }
  pen.lineWidth = 0.8 / scale;  // over the seams between faces
  for (const [shade, path] of paths) {
    const colour = colours[Math.floor(shade / SHADES)].map((c) => Math.min(255, Math.round(c * (0.2 + 0.95 * (shade % SHADES + 0.5) / SHADES))));
    pen.fillStyle = pen.strokeStyle = css(colour);
    pen.fill(path);
    pen.stroke(path);
  }
};

// Draws what `paint` draws with a pen of its own, around a mesh, then lays it over the picture.
const scratch = document.createElement("canvas");
const laidOver = (context, shown, opacity, paint) => {
  const { canvas } = context, move = context.getTransform(), [x0, y0, x1, y1] = shown.box, margin = 12;
  const left = Math.max(0, Math.floor(move.a * x0 + move.e) - margin), top = Math.max(0, Math.floor(move.d * y0 + move.f) - margin);
  const width = Math.min(canvas.width, Math.ceil(move.a * x1 + move.e) + margin) - left, height = Math.min(canvas.height, Math.ceil(move.d * y1 + move.f) + margin) - top;
  if (width <= 0 || height <= 0) return;
  const pen = scratch.getContext("2d", BY_CPU);
  if (scratch.width < width || scratch.height < height) { scratch.width = Math.max(width, scratch.width); scratch.height = Math.max(height, scratch.height); }
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.globalCompositeOperation = "source-over";
  pen.clearRect(0, 0, width, height);
  pen.setTransform(move.a, 0, 0, move.d, move.e - left, move.f - top);
  pen.lineJoin = pen.lineCap = "round";
  pen.setLineDash([]);
  paint(pen, move.a);
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.globalAlpha = opacity;
  context.drawImage(scratch, 0, 0, width, height, left, top, width, height);
  context.restore();
};
// Strokes the outer side of a contour: what lies inside the area, such as mirrors and wheels, is wiped out again.
const strokeContour = (context, shown, strokes) => laidOver(context, shown, 1, (pen) => {
  for (const { style, width, dash = [] } of strokes) {
    pen.strokeStyle = style; pen.lineWidth = 2 * width; pen.setLineDash(dash);
    pen.stroke(shown.contour);
  }
  pen.globalCompositeOperation = "destination-out";
  pen.fill(shown.area);
});

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
