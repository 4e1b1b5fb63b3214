// Images of frames, decoded when they are first asked for; the last ones are kept.
const KEPT_IMAGES = 30;
const makeImages = (run) => {
  const sources = all("script.image"), kept = new Map();
  const decoded = async (at) => createImageBitmap(new Blob([bytesOf(sources[at].textContent)], { type: "image/jpeg" }));
  return {
    get(at) {
      if (!run.hasImages) return Promise.resolve(null);
      const found = kept.get(at) || decoded(at);
      kept.delete(at);
      kept.set(at, found);  // the last in order
      if (kept.size > KEPT_IMAGES) kept.delete(kept.keys().next().value);
      return found;
    },
  };
};

// Where there is no image: a sky, and a road with lines every 5 metres.
const drawGround = (context, run, pose) => {
  const { camera } = run, eye = centreOf(pose), ahead = column(pose, 2), flat = [ahead[0], ahead[1], 0];
  const sky = css(themed("--sky")), road = css(themed("--road"));
  const horizon = camera.cy + camera.fy * dot(column(pose, 1), flat) / dot(ahead, flat);
  context.fillStyle = sky;
  context.fillRect(-0.5, -0.5, camera.width, camera.height);
  context.fillStyle = road;
  context.fillRect(-0.5, Math.max(-0.5, horizon), camera.width, camera.height - Math.max(-0.5, horizon));
  const heights = run.paths[0].points, middle = [];
  for (let i = 2; i < heights.length; i += 3) middle.push(heights[i]);
  middle.sort((a, b) => a - b);
  run.cameraHeight ??= Math.max(0.5, middle[middle.length >> 1] - run.ground);
  const level = eye[2] - run.cameraHeight, reach = 60, step = 5;
  const seen = (x, y) => {
    const d = [x - eye[0], y - eye[1], level - eye[2]];
    return [dot(column(pose, 0), d), dot(column(pose, 1), d), dot(ahead, d)];
  };
  const pixel = (c) => [(camera.fx * c[0] + camera.skew * c[1]) / c[2] + camera.cx, camera.fy * c[1] / c[2] + camera.cy];
  const line = (a, b) => {
    if (a[2] < 0.5 && b[2] < 0.5) return;
    if (a[2] < 0.5) a = mix(a, b, (0.5 - a[2]) / (b[2] - a[2]));
    if (b[2] < 0.5) b = mix(b, a, (0.5 - b[2]) / (a[2] - b[2]));
    context.moveTo(...pixel(a)); context.lineTo(...pixel(b));
  };
  const snap = (v) => Math.round(v / step) * step, cx = snap(eye[0]), cy = snap(eye[1]);
  context.beginPath();
  for (let k = -reach; k <= reach; k += step) {
    line(seen(cx + k, cy - reach), seen(cx + k, cy + reach));
    line(seen(cx - reach, cy + k), seen(cx + reach, cy + k));
  }
  context.strokeStyle = css(themed("--road-line"));
  context.lineWidth = 1 / context.getTransform().a;
  context.stroke();
};
