// The map in 3-D: z up. Turned, moved, zoomed by hand; it goes with the camera, and flies to the selected object.
const FOV = 0.7, STANDPOINTS = { start: "overview", top: "above", follow: "follow", camera: "camera" };
const TRUE_RADIUS_M = 4;
const makeViewer = (run, state, stage) => {
  const canvas = stage.querySelector("canvas"), resolution = () => Math.min(2, window.devicePixelRatio || 1);
  canvas.width = Math.round(canvas.clientWidth * resolution());
  canvas.height = Math.round(canvas.clientHeight * resolution());
  const meshes = makeMeshes(canvas, run);
  if (!meshes) return null;
  const { gl, programs } = meshes, { lines, thin, segments } = programs;
  const extent = extentOf(run), grid = gridOf(extent, run.ground), gridLine = segments(grid.ends);
  const paths = run.paths.map((p) => ({ ...pathStyle(p.name), line: segments(pathEnds(p.points)) })).sort((a, b) => a.order - b.order);
  const wires = programs.wires(joinedEnds(run.truth));
  const spread = Math.ceil(run.frames.length / TRAIL) || 1;
  const trail = segments(run.frames.filter((_, i) => i % spread === 0).flatMap((f) => frustumEnds(run.camera, f.pose, 0.7)));
  const path = run.paths[0].points, reduced = window.matchMedia("(prefers-reduced-motion: reduce)");

  // standpoint
  const ends = path.length > 3 ? [path[path.length - 3] - path[0], path[path.length - 2] - path[1]] : [1, 0];
  const heading = Math.atan2(ends[1], ends[0]), headingAt = (pose) => Math.atan2(column(pose, 2)[1], column(pose, 2)[0]);
  const seen = { target: extent.middle, yaw: 0, pitch: 0.5, distance: 10, stand: "start" };
  // from this direction, the nearest standpoint that sees all points: |x - sx| <= tx (d - z) and |y - sy| <= ty (d - z)
  const fitted = (yaw, pitch) => {
    const { points, middle } = extent, c = Math.cos(pitch), back = [c * Math.cos(yaw), c * Math.sin(yaw), Math.sin(pitch)];
    const right = unit(cross([0, 0, 1], back)), up = cross(back, right), ty = 0.82 * Math.tan(FOV / 2);
    const slopes = [0.9 * Math.tan(FOV / 2) * (canvas.clientWidth / canvas.clientHeight || 1), ty];
    const bounds = [right, up].map((axis, i) => [1, -1].map((sign) =>
      points.reduce((most, p) => { const q = sub(p, middle); return Math.max(most, sign * dot(q, axis) + slopes[i] * dot(q, back)); }, -Infinity)));
    const shift = bounds.map(([a, b]) => (a - b) / 2), needed = Math.max(...bounds.map(([a, b], i) => (a + b) / 2 / slopes[i]));
    const target = middle.map((v, r) => v + shift[0] * right[r] + shift[1] * up[r]), slide = (target[2] - run.ground) / back[2];
    return { target: target.map((v, r) => v - slide * back[r]), yaw, pitch, distance: Math.max(6, needed + slide) };
  };
  const across = () => (canvas.clientWidth > canvas.clientHeight ? heading - Math.PI / 2 : heading + Math.PI);
  const standpoints = {
    start: () => fitted(heading + Math.PI - 0.5, 0.5),
    top: () => fitted(across(), 1.5533),
    follow: (pose) => {
      const yaw = headingAt(pose), eye = centreOf(pose);
      return { target: [eye[0] + 7 * Math.cos(yaw), eye[1] + 7 * Math.sin(yaw), eye[2] - 1], yaw: yaw + Math.PI, pitch: 0.38, distance: 15 };
    },
  };
  const eyeOf = () => plus(seen.target, [Math.cos(seen.pitch) * Math.cos(seen.yaw), Math.cos(seen.pitch) * Math.sin(seen.yaw), Math.sin(seen.pitch)], seen.distance);

  // names of objects
  const names = stage.querySelector("#names");
  const tags = run.objects.map((o) => {
    const tag = element("button", { type: "button", tabindex: -1, "data-id": o.id, class: o.doubts.length ? "doubtful" : "", onclick: () => state.set({ object: o.id }) }, String(o.id));
    return names.appendChild(tag);
  });
  const paintTags = () => tags.forEach((tag, i) => {
    const colour = colourOf(run.objects[i], state.now.colouring);
    tag.style.background = css(colour);
    tag.style.color = inkOn(colour);
    tag.classList.toggle("chosen", run.objects[i].id === state.now.object);
  });

  // drawing
  const drawLine = (what, colour, opacity, width, view, dash = 0, middle = extent.middle, reach = 1e9) => {
    if (!what.count) return;
    const at = lines.at;
    gl.useProgram(lines);
    gl.bindVertexArray(what.array);
    gl.uniformMatrix4fv(at("view"), false, view);
    gl.uniform2f(at("size"), canvas.width, canvas.height);
    gl.uniform1f(at("width"), width * resolution());
    gl.uniform4f(at("colour"), ...colour.map((v) => v / 255), opacity);
    gl.uniform3f(at("middle"), ...middle);
    gl.uniform1f(at("reach"), reach);
    gl.uniform1f(at("dash"), dash);
    gl.drawElements(gl.TRIANGLES, what.count, gl.UNSIGNED_INT, 0);
  };
  const drawWires = (view) => {
    gl.useProgram(thin);
    gl.bindVertexArray(wires.array);
    gl.uniformMatrix4fv(thin.at("view"), false, view);
    gl.uniform4f(thin.at("colour"), ...themed("--truth").map((v) => v / 255), 0.6);
    const shows = sphereTest(view);
    let start = 0;
    for (const t of run.truth) {
      if (shows(t.centre, TRUE_RADIUS_M)) gl.drawArrays(gl.LINES, start, t.ends.length / 3);
      start += t.ends.length / 3;
    }
  };
  const once = (points, draw) => { const made = segments(points); draw(made); made.free(); };
  const letterbox = (width, height) => {  // the part of the image that fills the canvas: all of it, and more above and below
    const { camera } = run, scale = Math.max(camera.width / width, camera.height / height);
    return [(camera.width - scale * width) / 2, (camera.height - scale * height) / 2, scale * width, scale * height];
  };
  const draw = () => {
    const dense = resolution(), width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    meshes.clear(Math.round(width * dense), Math.round(height * dense));
    const frame = run.frames[state.now.frame], through = seen.stand === "camera" && frame;
    const eye = through ? centreOf(frame.pose) : eyeOf(), near = through ? 0.1 : Math.max(0.05, seen.distance / 50);
    const far = (through ? 0 : seen.distance) + 6 * extent.radius + 50;
    const view = through
      ? cameraMatrix(run.camera, frame.pose, letterbox(width, height), near, far)
      : times(perspective(FOV, width / height, near, far), lookAt(eye, seen.target));
    meshes.draw(view, eye, state.now.colouring, (o) => o.doubts.length > 0 && o.id !== state.now.object);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    drawLine(gridLine, themed("--soft"), 0.35, 0.5, view, 0, grid.centre, grid.reach);
    if (state.now.truth && wires.count) drawWires(view);
    gl.depthFunc(gl.LEQUAL);
    const shown = through ? [] : paths;
    for (const p of shown) drawLine(p.line, themed(p.colour), p.opacity, p.width / 2, view, p.dash ? seen.distance / 45 : 0);
    if (!through) drawLine(trail, themed("--path"), 0.3, 0.5, view);
    if (frame && !through) once(frustumEnds(run.camera, frame.pose, FRUSTUM_M), (made) => drawLine(made, themed("--ink"), 1, 1.1, view));
    const chosen = run.byId.get(state.now.object);
    if (chosen) once(boxEnds(chosen), (made) => drawLine(made, themed("--accent"), 1, 1.3, view));
    gl.depthMask(true);
    placeTags(view, near, width, height);
  };
  const placeTags = (view, near, width, height) => {
    const places = run.objects.map((o, i) => {
      const p = [o.centre[0], o.centre[1], o.high[2], 1], c = [0, 1, 3].map((r) => p.reduce((sum, v, k) => sum + view[4 * k + r] * v, 0));
      const first = o.id === state.now.object ? -1e6 : 0;
      return { tag: tags[i], depth: c[2], order: c[2] + first, x: (0.5 + 0.5 * c[0] / c[2]) * width, y: (0.5 - 0.5 * c[1] / c[2]) * height - 6 };
    });
    const kept = [];
    for (const p of places.sort((a, b) => a.order - b.order)) {  // the nearest first
      p.tag.hidden = p.depth < near || p.x < 8 || p.x > width - 8 || p.y < 18 || p.y > height || kept.some((k) => Math.abs(k.x - p.x) < 24 && Math.abs(k.y - p.y) < 18);
      if (!p.tag.hidden) kept.push(p);
      p.tag.style.transform = `translate(${p.x.toFixed(1)}px, ${p.y.toFixed(1)}px) translate(-50%, -100%)`;
    }
  };
  const refresh = soon(draw);

  // motion
  let flight = 0;
  const flyTo = (goal) => {
    cancelAnimationFrame(flight);
    goal.yaw = seen.yaw + Math.atan2(Math.sin(goal.yaw - seen.yaw), Math.cos(goal.yaw - seen.yaw));
    if (reduced.matches) { Object.assign(seen, goal); refresh(); return; }
    const from = { ...seen }, began = performance.now();
    const step = (now) => {
      const t = Math.min(1, Math.max(0, (now - began) / 500)), s = t * t * (3 - 2 * t);
      seen.target = mix(from.target, goal.target, s);
      for (const name of ["yaw", "pitch"]) seen[name] = from[name] + s * (goal[name] - from[name]);
      seen.distance = Math.exp(Math.log(from.distance) + s * Math.log(goal.distance / from.distance));
      refresh();
      if (t < 1) flight = requestAnimationFrame(step);
    };
    flight = requestAnimationFrame(step);
  };
  const goWithCamera = () => {
    const frame = run.frames[state.now.frame];
    if (frame && seen.stand === "follow") { cancelAnimationFrame(flight); Object.assign(seen, standpoints.follow(frame.pose)); }
    refresh();
  };
  const stand = (where, jump = false) => {
    const frame = run.frames[state.now.frame];
    if ((where === "follow" || where === "camera") && !frame) return;
    seen.stand = where;
    press(all("#standpoint button"), all("#standpoint button").find((b) => b.value === where));
    if (where === "camera") { refresh(); return; }
    const goal = standpoints[where](frame && frame.pose);
    if (jump) { Object.assign(seen, goal); refresh(); } else flyTo(goal);
  };
  const free = () => { seen.stand = "free"; press(all("#standpoint button"), null); cancelAnimationFrame(flight); };
  const turn = (dx, dy) => { free(); seen.yaw -= 0.006 * dx; seen.pitch = Math.min(1.5533, Math.max(-0.2, seen.pitch + 0.006 * dy)); };
  const move = (dx, dy) => {
    free();
    const scale = 2 * seen.distance * Math.tan(FOV / 2) / canvas.clientHeight, s = Math.sin(seen.yaw), c = Math.cos(seen.yaw);
    const up = Math.max(Math.sin(seen.pitch), 0.35);
    seen.target = [seen.target[0] + scale * (s * dx - c * dy / up), seen.target[1] + scale * (-c * dx - s * dy / up), seen.target[2]];
  };
  const zoom = (factor) => { free(); seen.distance = Math.min(20 * extent.radius, Math.max(1.5, seen.distance * factor)); };
  const pick = (x, y) => {  // the object under a place of the canvas
    const back = [Math.cos(seen.pitch) * Math.cos(seen.yaw), Math.cos(seen.pitch) * Math.sin(seen.yaw), Math.sin(seen.pitch)];
    const right = unit(cross([0, 0, 1], back)), up = cross(back, right), t = Math.tan(FOV / 2), aspect = canvas.clientWidth / canvas.clientHeight;
    const a = (2 * x / canvas.clientWidth - 1) * t * aspect, b = (1 - 2 * y / canvas.clientHeight) * t;
    const frame = run.frames[state.now.frame], through = seen.stand === "camera" && frame;
    let eye = eyeOf(), ray = plus(plus(back.map((v) => -v), right, a), up, b);
    if (through) {
      const [left, top, wide] = letterbox(canvas.clientWidth, canvas.clientHeight), scale = wide / canvas.clientWidth, { camera } = run;
      const v = (top + y * scale - camera.cy) / camera.fy, u = (left + x * scale - camera.cx - camera.skew * v) / camera.fx;
      eye = centreOf(frame.pose);
      ray = plus(plus(column(frame.pose, 2), column(frame.pose, 0), u), column(frame.pose, 1), v);
    }
    let best = null, nearest = Infinity;
    for (const o of run.objects) {
      let low = 0, high = Infinity;
      for (let k = 0; k < 3; k++) {
        const axis = column(o.matrix, k), d = dot(ray, axis), away = dot(sub(o.centre, eye), axis), half = o.dimensions[k] / 2;
        const [p, q] = [(away - half) / d, (away + half) / d].sort((m, n) => m - n);
        low = Math.max(low, p); high = Math.min(high, q);
      }
      if (low < high && low < nearest) { nearest = low; best = o.id; }
    }
    return best;
  };

  // hands
  const down = new Map();
  let moved = 0;
  canvas.addEventListener("pointerdown", (e) => { down.set(e.pointerId, e); moved = 0; canvas.setPointerCapture(e.pointerId); });
  canvas.addEventListener("pointerup", (e) => {
    if (down.delete(e.pointerId) && moved < 5) {
      const rect = canvas.getBoundingClientRect(), found = pick(e.clientX - rect.left, e.clientY - rect.top);
      if (found !== null) state.set({ object: found });
    }
  });
  canvas.addEventListener("pointercancel", (e) => down.delete(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    const before = down.get(e.pointerId);
    if (!before) return;
    const dx = e.clientX - before.clientX, dy = e.clientY - before.clientY;
    moved += Math.abs(dx) + Math.abs(dy);
    if (moved < 5) return;
    if (down.size === 2) {
      const other = [...down.values()].find((p) => p.pointerId !== e.pointerId);
      const span = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY) || 1;
      zoom(span(before) / span(e));
      move(dx / 2, dy / 2);
    } else if (e.buttons & 2 || e.shiftKey) move(dx, dy);
    else turn(dx, dy);
    down.set(e.pointerId, e);
    refresh();
  });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    if (document.activeElement !== canvas && !e.ctrlKey) return;  // the page scrolls until the view is clicked
    e.preventDefault();
    zoom(Math.exp(Math.min(60, Math.max(-60, e.deltaY)) * 0.004));
    refresh();
  }, { passive: false });

  state.on(["frame"], goWithCamera);
  state.on(["playing"], (now) => { if (now.playing && seen.stand === "start" && extent.radius > 15) stand("follow"); });
  state.on(["colouring", "object"], () => { paintTags(); refresh(); });
  state.on(["truth"], refresh);
  state.on(["object"], (now) => {
    const found = run.byId.get(now.object);
    if (!found || now.playing) return;
    seen.stand = "free";
    press(all("#standpoint button"), null);
    flyTo({ target: [...found.centre], yaw: seen.yaw, pitch: Math.min(Math.max(seen.pitch, 0.3), 0.7), distance: 2.1 * Math.max(4, found.dimensions[0]) });
  });
  new ResizeObserver(() => { if (seen.stand === "start" || seen.stand === "top") stand(seen.stand, true); refresh(); }).observe(canvas);
  dark.addEventListener("change", refresh);
  paintTags();
  return { stand, turn: (dx, dy) => { turn(dx, dy); refresh(); }, zoom: (factor) => { zoom(factor); refresh(); }, seen };
};
