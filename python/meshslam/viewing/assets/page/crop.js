// Small pictures of one detection: its surroundings, its mask, and a mesh's contour.
const MARGIN = 0.22;
const cropWindow = (camera, [x, y, w, h], proportion) => {
  const wide = Math.max(w * (1 + 2 * MARGIN), h * (1 + 2 * MARGIN) * proportion, 24), tall = wide / proportion;
  const inside = (low, size, limit) => (size < limit ? Math.min(Math.max(low, -0.5), limit - size - 0.5) : low);
  return [inside(x + (w - wide) / 2, wide, camera.width), inside(y + (h - tall) / 2, tall, camera.height), wide];
};

// `mesh` null: the mask alone. The canvas has its size already.
const drawCrop = async (canvas, run, images, { frame, detection }, mesh, colour) => {
  const image = await images.get(frame.at), context = canvas.getContext("2d", BY_CPU);
  const [left, top, wide] = cropWindow(run.camera, detection.box, canvas.width / canvas.height), scale = canvas.width / wide;
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.fillStyle = css(themed("--field"));
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.setTransform(scale, 0, 0, scale, -left * scale, -top * scale);
  if (image) context.drawImage(image, -0.5, -0.5, run.camera.width, run.camera.height);
  else drawGround(context, run, frame.pose);
  const mask = maskPath(detection);
  context.fillStyle = css(colour, image ? 0.16 : 0.35);
  context.fill(mask, "evenodd");
  for (const [style, width, dash] of [["#131517", 2.6, []], ["#ffffff", 1.4, [4, 3]]]) {
    context.strokeStyle = style; context.lineWidth = width / scale; context.setLineDash(dash.map((v) => v / scale));
    context.stroke(mask);
  }
  context.setLineDash([]);
  const shown = mesh && silhouette(mesh, run.camera, frame.pose);
  if (!shown) return;
  strokeContour(context, shown, [{ style: css(colour), width: 2.2 / scale }]);
};
