"use strict";
// The data of a page, unpacked: metres relative to the scene's origin, pixels of the run's camera.

const bytesOf = (text) => {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const found = atob(text), bytes = new Uint8Array(found.length);
  for (let i = 0; i < found.length; i++) bytes[i] = found.charCodeAt(i);
  return bytes;
};
const unpack = (text, Kind) => new Kind(bytesOf(text).buffer);

// Edges of a list of faces: corner, corner, face, the other face or -1, four numbers each.
const edgesOf = (faces, vertices) => {
  const known = new Map(), edges = [];
  for (let f = 0; f < faces.length / 3; f++) for (let k = 0; k < 3; k++) {
    const a = faces[3 * f + k], b = faces[3 * f + (k + 1) % 3], key = Math.min(a, b) * vertices + Math.max(a, b);
    if (known.has(key)) edges[4 * known.get(key) + 3] = f;
    else { known.set(key, edges.length / 4); edges.push(a, b, f, -1); }
  }
  return Int32Array.from(edges);
};

// A mesh in world: its vertices by three, and its topology.
const placedMesh = (matrix, millimetres, topology) => {
  const place = new Float32Array(millimetres.length), m = matrix;
  for (let i = 0; i < place.length; i += 3) for (let r = 0; r < 3; r++)
    place[i + r] = (m[4 * r] * millimetres[i] + m[4 * r + 1] * millimetres[i + 1] + m[4 * r + 2] * millimetres[i + 2]) / 1000 + m[4 * r + 3];
  return { place, topology };
};

const readObjects = (scene) => {
  const topologies = scene.faces.map((text) => ({ faces: unpack(text, Uint32Array) }));
  const means = scene.means.map((text) => unpack(text, Int16Array));
  return scene.objects.map((o) => {
    const packed = unpack(o.vertices, Int16Array), topology = topologies[o.faces];
    topology.edges ??= edgesOf(topology.faces, packed.length / 3);
    const mesh = placedMesh(o.matrix, packed, topology), known = new Float32Array(2 * packed.length / 3).fill(-1);
    if (o.sigma) bytesOf(o.sigma).forEach((v, i) => { known[2 * i] = v / 1000; });
    if (o.seen) bytesOf(o.seen).forEach((v, i) => { known[2 * i + 1] = v; });
    const low = [Infinity, Infinity, Infinity], high = low.map((v) => -v);
    mesh.place.forEach((v, i) => { low[i % 3] = Math.min(low[i % 3], v); high[i % 3] = Math.max(high[i % 3], v); });
    const first = o.first && placedMesh(o.first.matrix, means[o.first.mean], topology);
    const radius = Math.hypot(...o.dimensions) / 2;
    return { ...o, ...mesh, known, low, high, radius, first, centre: [o.matrix[3], o.matrix[7], o.matrix[11]] };
  });
};

const readTruth = (scene) => scene.truth.map((t) => {
  const { place } = placedMesh(t.matrix, unpack(t.vertices, Int16Array), null), edges = unpack(t.edges, Uint16Array);
  const ends = new Float32Array(3 * edges.length);
  edges.forEach((corner, i) => ends.set(place.subarray(3 * corner, 3 * corner + 3), 3 * i));
  return { ...t, place, ends, centre: [t.matrix[3], t.matrix[7], t.matrix[11]] };
});

// What drives: its pose, place and footprint at each of its frames, in world.
const readMoving = (moving) => moving.map((o) => {
  const poses = unpack(o.poses, Float32Array), at = new Map(o.frames.map((number, i) => [number, i]));
  const poseOf = (i) => poses.subarray(12 * i, 12 * i + 12);
  const places = o.frames.map((_, i) => centreOf(poseOf(i)));
  const hullAt = (i) => o.footprint.map(([x, y]) => place(poseOf(i), [x, y, 0]));
  return { ...o, at, poseOf, places, hullAt };
});

const readFrames = (frames) => {
  const poses = unpack(frames.poses, Float32Array), lengths = unpack(frames.border_lengths, Uint16Array);
  const points = unpack(frames.border_points, Int16Array);
  let border = 0, start = 0;
  return frames.ids.map((number, at) => ({
    at, number, index: frames.indices[at], pose: poses.subarray(12 * at, 12 * at + 12),
    detections: frames.detections[at].map((d) => {
      const borders = [];
      for (let k = 0; k < d.borders; k++, border++) {
        borders.push(points.subarray(start, start + 2 * lengths[border]));
        start += 2 * lengths[border];
      }
      return { ...d, borders };
    }),
  }));
};

const readRun = (data) => {
  const objects = readObjects(data.scene), byId = new Map(objects.map((o) => [o.id, o]));
  const frames = readFrames(data.frames), views = new Map();
  for (const frame of frames) for (const detection of frame.detections) if (detection.track !== undefined) {
    if (!views.has(detection.track)) views.set(detection.track, []);
    views.get(detection.track).push({ frame, detection });
  }
  return {
    ...data, objects, byId, moving: readMoving(data.moving || []), frames, views, hasImages: data.frames.images, ground: data.scene.ground,
    truth: readTruth(data.scene), paths: data.paths.map((p) => ({ ...p, points: unpack(p.points, Float32Array) })),
  };
};

// The view that shows a track largest; those that the image's border cuts, or that fill it, only if there is no other.
const bestView = (run, id) => {
  const { width, height } = run.camera;
  const whole = ({ detection: { box: [x, y, w, h] } }) => Math.min(x, y, width - x - w, height - y - h) >= 6 && Math.max(w / 1.5, h) < 0.69 * height;
  const size = (view) => view.detection.box[2] * view.detection.box[3] + (whole(view) ? 1e9 : 0);
  return (run.views.get(id) || []).reduce((best, view) => (!best || size(view) > size(best) ? view : best), null);
};
