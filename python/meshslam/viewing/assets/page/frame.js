// The current frame: its image or a drawn ground, masks, boxes, key points, and the map's meshes as the camera sees them.
const makeFrameView = (run, state, images, canvas) => {
  const { camera } = run;
  canvas.style.aspectRatio = `${camera.width} / ${camera.height}`;
  let contours = [];  // the nearest first, of the frame that is shown

  const ids = (frame) => new Set(frame.detections.map((d) => d.track).filter((id) => run.byId.has(id)));
  const labelPlaces = (shown, seen, scale) => {
    const places = [], tall = 15 * scale;
    for (const s of [...shown].sort((a, b) => (b.box[2] - b.box[0]) - (a.box[2] - a.box[0]))) {
      const size = Math.max(s.box[2] - s.box[0], s.box[3] - s.box[1]), chosen = s.object.id === state.now.object;
      if (!chosen && size < (seen.has(s.object.id) ? 10 : 34) * scale) continue;
      const wide = (8 * String(s.object.id).length + 9) * scale;
      let x = Math.max(0, Math.min((Math.max(s.box[0], 0) + Math.min(s.box[2], camera.width) - wide) / 2, camera.width - wide));
      let y = Math.max(s.box[1] - tall - 3 * scale, 0);
      for (const p of places) if (x < p.x + p.wide && p.x < x + wide && y < p.y + tall && p.y < y + tall) y = Math.max(0, p.y - tall - scale);
      if (places.some((p) => x < p.x + p.wide && p.x < x + wide && y < p.y + tall && p.y < y + tall)) continue;
      places.push({ ...s, x, y, wide, tall });
    }
    return places;
  };
  const drawMasks = (context, frame, scale, layers) => {
    for (const d of frame.detections) {
      const object = run.byId.get(d.track), colour = object ? colourOf(object, state.now.colouring) : themed("--prior");
      if (layers.masks) {
        context.fillStyle = css(colour, 0.2);
        context.fill(maskPath(d), "evenodd");
        context.setLineDash([4 * scale, 3 * scale]);
        context.strokeStyle = "rgb(255 255 255 / .9)"; context.lineWidth = scale;
        context.stroke(maskPath(d));
        context.setLineDash([]);
      }
      if (layers.boxes) {
        context.strokeStyle = css(colour); context.lineWidth = 1.2 * scale;
        context.strokeRect(d.box[0] - 0.5, d.box[1] - 0.5, d.box[2], d.box[3]);
      }
    }
  };
  const drawTiny = (context, s, colour, opacity, scale) => {
    context.fillStyle = css(colour, opacity * (s.object.doubts.length ? 0.45 : 1));
    context.fill(s.area);
    context.strokeStyle = css(colour); context.lineWidth = scale;
    context.stroke(s.contour);
  };
  const drawMeshes = (context, frame, scale) => {
    const opacity = run.hasImages && state.now.layers.image ? 0.42 : 0.72;
    for (const s of [...contours].reverse()) {  // the farthest first
      const chosen = s.object.id === state.now.object, colour = colourOf(s.object, state.now.colouring);
      const tiny = Math.max(s.box[2] - s.box[0], s.box[3] - s.box[1]) < SMALL_PX * scale;
      if (tiny && !chosen) { drawTiny(context, s, colour, opacity, scale); continue; }
      laidOver(context, s, (s.object.doubts.length && !chosen ? 0.45 : 1) * opacity, (pen, zoom) => fillMesh(pen, s.object, s, state.now.colouring, zoom));
      const dash = s.object.doubts.length ? [5 * scale, 5 * scale] : [];
      strokeContour(context, s, [
        ...(chosen ? [{ style: "#ffffff", width: 3.6 * scale }] : []),
        { style: css(chosen ? themed("--accent") : colour, 0.95), width: (chosen ? 2.2 : 1.3) * scale, dash },
      ]);
    }
  };
  const drawPoints = (context, frame, scale) => {
    for (const d of frame.detections) for (const [which, x, y] of d.points || []) {
      context.beginPath(); context.arc(x, y, 3.5 * scale, 0, 7);
      context.fillStyle = run.keypoints[which] ? run.keypoints[which].colour : "#ffffff";
      context.fill();
      context.strokeStyle = "#ffffff"; context.lineWidth = scale;
      context.stroke();
    }
  };
  const drawLabels = (context, frame, scale) => {
    context.textAlign = "center"; context.textBaseline = "middle";
    for (const p of labelPlaces(contours, ids(frame), scale)) {
      const colour = colourOf(p.object, state.now.colouring), chosen = p.object.id === state.now.object;
      context.fillStyle = css(colour);
      context.beginPath(); context.roundRect(p.x, p.y, p.wide, p.tall, 3 * scale); context.fill();
      if (chosen) { context.strokeStyle = "#ffffff"; context.lineWidth = 1.5 * scale; context.stroke(); }
      context.fillStyle = inkOn(colour);
      context.font = `650 ${12.5 * scale}px system-ui, sans-serif`;
      context.fillText(p.object.id, p.x + p.wide / 2, p.y + p.tall / 2 + 0.5 * scale);
    }
  };
  let asked = 0;
  const draw = async () => {
    const frame = run.frames[state.now.frame], { layers } = state.now, mine = ++asked, width = canvas.clientWidth;
    if (!frame || !width) return;
    const image = layers.image ? await images.get(frame.at).catch(() => null) : null;
    if (mine !== asked) return;  // another frame is wanted by now
    const dense = Math.min(2, Math.max(1, window.devicePixelRatio || 1)), pixels = Math.round(width * dense), rows = Math.round(pixels * camera.height / camera.width);
    if (canvas.width !== pixels || canvas.height !== rows) { canvas.width = pixels; canvas.height = rows; }
    const context = canvas.getContext("2d", BY_CPU), zoom = pixels / camera.width, scale = dense / zoom;  // a pixel of the page, in the image's
    context.setTransform(zoom, 0, 0, zoom, 0.5 * zoom, 0.5 * zoom);
    if (image) context.drawImage(image, -0.5, -0.5, camera.width, camera.height);
    else drawGround(context, run, frame.pose);
    const near = run.objects.filter((object) => inSight(object, camera, frame.pose));
    contours = near.map((object) => ({ object, ...silhouette(object, camera, frame.pose) })).filter((s) => s.area).sort((a, b) => a.depth - b.depth);
    drawMasks(context, frame, scale, layers);
    if (layers.meshes) drawMeshes(context, frame, scale);
    if (layers.points) drawPoints(context, frame, scale);
    if (layers.labels) drawLabels(context, frame, scale);
    canvas.setAttribute("aria-label", `frame ${frame.number}: ${frame.detections.length} detections, ${ids(frame).size} of them of objects in the map`);
    canvas.dataset.frame = frame.number;
    performance.mark("frame");
  };
  const listed = () => {
    const frame = run.frames[state.now.frame], found = frame ? [...ids(frame)].sort((a, b) => a - b) : [];
    byName("in-frame").replaceChildren(...(found.length
      ? [element("span", { class: "hint" }, "in this frame"), ...found.map((id) => objectChip(run, state, id))]
      : [element("span", { class: "hint" }, "no object of the map is detected in this frame")]));
  };
  canvas.addEventListener("click", (event) => {
    const rect = canvas.getBoundingClientRect(), context = canvas.getContext("2d", BY_CPU), frame = run.frames[state.now.frame];
    const x = (event.clientX - rect.left) * canvas.width / rect.width, y = (event.clientY - rect.top) * canvas.height / rect.height;
    const zoom = canvas.width / camera.width, inside = (path, rule) => {
      context.save(); context.setTransform(1, 0, 0, 1, 0, 0);
      const hit = context.isPointInPath(path, x / zoom - 0.5, y / zoom - 0.5, rule);
      context.restore();
      return hit;
    };
    const mask = frame.detections.find((d) => run.byId.has(d.track) && inside(maskPath(d), "evenodd"));
    const mesh = contours.find((s) => inside(s.area, "nonzero"));
    if (mask || mesh) state.set({ object: mask ? mask.track : mesh.object.id });
  });
  const refresh = soon(draw);
  state.on(["frame", "object", "colouring", "layers"], refresh);
  state.on(["frame", "object", "colouring"], listed);
  let drawnAt = canvas.clientWidth;
  new ResizeObserver(() => { if (canvas.clientWidth !== drawnAt) refresh(); drawnAt = canvas.clientWidth; }).observe(canvas);
  dark.addEventListener("change", refresh);
  listed();
  return { draw };
};

// A button that selects an object, marked where it is selected.
const objectChip = (run, state, id) => {
  const object = run.byId.get(id), colour = colourOf(object, state.now.colouring);
  return element("button", {
    type: "button", class: "chip", "data-id": id, "aria-pressed": String(id === state.now.object), onclick: () => state.set({ object: id }),
  }, element("i", { style: `background:${css(colour)}` }), String(id));
};

const frameLegend = (run) => [
  element("span", {}, element("i", { class: "mask" }), "detected mask"),
  element("span", {}, element("i", { class: "solid" }), "contour of the map’s mesh"),
  ...(run.objects.some((o) => o.doubts.length) ? [element("span", {}, element("i", { class: "dashed" }), "of a doubtful one")] : []),
  ...(run.frames.some((f) => f.detections.some((d) => !run.byId.has(d.track))) ? [key(swatch("box", "background:var(--prior)"), "not in the map")] : []),
];
