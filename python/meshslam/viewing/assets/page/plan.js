// The map from above: footprints, one-sigma ellipses, paths; turned so that the path runs along the longer side.
const makePlan = (run, state, box) => {
  const path = run.paths[0].points, hulls = run.objects.map((o) => o.footprint);
  const truthHulls = run.truth.map((t) => hullOf(t.place)), points = [...hulls.flat(), ...truthHulls.flat()];
  for (let i = 0; i < path.length; i += 3) points.push([path[i], path[i + 1]]);
  for (const o of run.moving) points.push(...o.places.map(([x, y]) => [x, y]));
  for (const { points: p } of run.paths.slice(1)) {
    const flat = [];
    for (let i = 0; i < p.length; i += 3) flat.push([p[i], p[i + 1]]);
    if (points.length && spanOf([...points, ...flat]) < MOST_WIDER * spanOf(points)) points.push(...flat);  // what drifts away leaves the map
  }
  if (!points.length) points.push([0, 0]);
  const ends = path.length > 3 ? [path[path.length - 3] - path[0], path[path.length - 2] - path[1]] : [1, 0];
  let heading = mainDirection(points);
  if (Math.cos(heading) * ends[0] + Math.sin(heading) * ends[1] < 0) heading += Math.PI;
  const hand = { zoom: 1, x: 0, y: 0 };
  let svg = null, toPage = null, words = [];  // places of numbers: those beside others are left out

  const frameOf = (width) => {
    const across = width > 560 ? heading : heading - Math.PI / 2, c = Math.cos(across), s = Math.sin(across);
    const turned = points.map(([x, y]) => [c * x + s * y, -s * x + c * y]);
    const low = [0, 1].map((k) => Math.min(...turned.map((p) => p[k]))), high = [0, 1].map((k) => Math.max(...turned.map((p) => p[k])));
    const margin = width > 560 ? 36 : 24, size = [0, 1].map((k) => Math.max(high[k] - low[k], 2));
    const tallest = width > 560 ? 560 : 620, scale = Math.min((width - 2 * margin) / size[0], (tallest - 2 * margin) / size[1], 45);
    const height = Math.max(180, size[1] * scale + 2 * margin + 44);
    return { c, s, low, high, scale, height, width };
  };
  const draw = () => {
    const width = box.clientWidth;
    if (!width) return;
    const f = frameOf(width), scale = f.scale * hand.zoom, middle = [0, 1].map((k) => (f.low[k] + f.high[k]) / 2);
    toPage = ([x, y]) => [
      width / 2 + hand.x + (f.c * x + f.s * y - middle[0]) * scale, (f.height - 44) / 2 + hand.y - (-f.s * x + f.c * y - middle[1]) * scale,
    ];
    const joined = (list) => list.map((p) => toPage(p).map((v) => v.toFixed(1)).join(",")).join(" ");
    svg = drawn("svg", { class: "plan", role: "img", "aria-label": "the map from above", viewBox: `0 0 ${width} ${f.height.toFixed(0)}`, width, height: f.height.toFixed(0) });
    const styled = run.paths.map((p) => ({ ...p, ...pathStyle(p.name) })).sort((a, b) => a.order - b.order);
    truthHulls.forEach((hull, i) => svg.append(drawn("polygon", { class: `true${run.truth[i].estimate === null ? " missed" : ""}`, points: joined(hull) })));
    words = [];
    const cars = run.objects.map((o, i) => footprintOf(o, hulls[i], joined, scale, f));
    svg.append(...styled.map((p) => pathOf(p, joined)), ...run.moving.map((o) => wayOf(o, joined)));
    svg.append(...cars, ...endsOf(), scaleBar(f, scale), axes(f), drawn("g", { class: "driving" }), drawn("g", { class: "here" }));
    svg.addEventListener("click", (event) => { const hit = event.target.closest("[data-id]"); if (hit && !hand.moved) state.set({ object: Number(hit.dataset.id) }); });
    box.replaceChildren(svg);
    here();
  };
  const footprintOf = (o, hull, joined, scale, f) => {
    const colour = css(colourOf(o, state.now.colouring)), [x, y] = toPage(o.centre), chosen = o.id === state.now.object;
    const nose = [0.5, 0.66].map((k) => toPage(place(o.matrix, [k * o.dimensions[0], 0, 0])));
    const wide = Math.min(o.dimensions[0], o.dimensions[1]) * scale, inside = wide > 17;
    const tall = Math.max(...hull.map((p) => toPage(p)[1])) - Math.min(...hull.map((p) => toPage(p)[1]));
    const group = drawn("g", { class: `car${chosen ? " chosen" : ""}${o.doubts.length ? " doubtful" : ""}`, "data-id": o.id },
      drawn("title", {}, `${o.category} ${o.id}: ${o.dimensions.map((v) => v.toFixed(2)).join(" × ")} m${o.doubts.length ? `; doubtful: ${o.doubts.join("; ")}` : ""}`),
      drawn("polygon", { points: joined(hull), fill: colour, stroke: colour }),
      drawn("line", { class: "nose", x1: nose[0][0], y1: nose[0][1], x2: nose[1][0], y2: nose[1][1], stroke: colour }));
    if (o.ellipse) {
      const [long, short, angle] = o.ellipse, turn = -(angle - Math.atan2(f.s, f.c)) * 180 / Math.PI;
      group.append(drawn("ellipse", { rx: (long * scale).toFixed(2), ry: (short * scale).toFixed(2), transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${turn.toFixed(1)})` }));
    }
    const at = [x, y + 4 - (inside ? 0 : tall / 2 + 8)];
    if (inside || chosen || !words.some(([u, v]) => Math.abs(u - at[0]) < 24 && Math.abs(v - at[1]) < 15)) {
      words.push(at);
      group.append(drawn("text", { x: at[0].toFixed(1), y: at[1].toFixed(1) }, String(o.id)));
    }
    return group;
  };
  const pathOf = (p, joined) => {
    const list = [];
    for (let i = 0; i < p.points.length; i += 3) list.push([p.points[i], p.points[i + 1]]);
    return drawn("polyline", {
      class: "path", points: joined(list), style: `stroke:var(${p.colour})`, "stroke-width": p.width, "stroke-opacity": p.opacity, "stroke-dasharray": p.dash && p.dash.join(" "),
    });
  };
  const wayOf = (o, joined) => drawn("polyline", { class: "way", points: joined(o.places), style: `stroke:${rgbOf(o)}` }, drawn("title", {}, `${o.category} ${o.id} drives`));
  const driving = (number) => {
    const group = svg.querySelector(".driving"), joined = (list) => list.map((p) => toPage(p).map((v) => v.toFixed(1)).join(",")).join(" ");
    group.replaceChildren(...run.moving.filter((o) => o.at.has(number)).map((o) => {
      const i = o.at.get(number), [x, y] = toPage(o.places[i]), nose = [0.5, 0.66].map((k) => toPage(place(o.poseOf(i), [k * o.length, 0, 0])));
      return drawn("g", { class: "car moving", "data-moving": o.id },
        drawn("title", {}, `${o.category} ${o.id}: ${o.speeds[i].toFixed(1)} m/s, position ± ${o.sigmas[i].toFixed(2)} m`),
        drawn("polygon", { points: joined(o.hullAt(i)), fill: rgbOf(o), stroke: rgbOf(o) }),
        drawn("line", { class: "nose", x1: nose[0][0], y1: nose[0][1], x2: nose[1][0], y2: nose[1][1], stroke: rgbOf(o) }),
        drawn("text", { x: x.toFixed(1), y: (y + 4).toFixed(1) }, String(o.id)));
    }));
  };
  const endsOf = () => {
    if (path.length < 3) return [];
    const [x, y] = toPage([path[0], path[1]]), [u, v] = toPage([path[path.length - 3], path[path.length - 2]]);
    return [drawn("circle", { class: "start", cx: x, cy: y, r: 5 }), drawn("rect", { class: "end", x: u - 4.5, y: v - 4.5, width: 9, height: 9 })];
  };
  const scaleBar = (f, scale) => {
    const longest = 130 / scale, power = 10 ** Math.floor(Math.log10(longest)), length = [5, 2, 1].find((k) => k * power <= longest) * power, y = f.height - 12;
    return drawn("g", { class: "scale" }, drawn("path", { d: `M12,${y - 5}v5h${length * scale}v-5` }), drawn("text", { x: 20 + length * scale, y }, `${+length.toPrecision(2)} m`));
  };
  const axes = (f) => {
    const x = f.width - 40, y = f.height - 34, group = drawn("g", { class: "axes" });
    for (const [name, [a, b]] of [["x", [f.c, -f.s]], ["y", [f.s, f.c]]])
      group.append(drawn("path", { d: `M${x},${y}l${18 * a},${-18 * b}` }), drawn("text", { x: x + 26 * a, y: y - 26 * b + 4 }, name));
    return group;
  };
  const here = () => {
    const group = svg && svg.querySelector(".here"), frame = run.frames[state.now.frame];
    if (!group || !frame) return;
    driving(frame.number);
    const ahead = column(frame.pose, 2), [x, y] = toPage(centreOf(frame.pose)), [u, v] = toPage(plus(centreOf(frame.pose), ahead, 1));
    const angle = Math.atan2(v - y, u - x) * 180 / Math.PI, half = Math.atan(run.camera.width / 2 / run.camera.fx), r = 26;
    const wedge = [-half, half].map((t) => `${(r * Math.cos(t)).toFixed(1)},${(r * Math.sin(t)).toFixed(1)}`);
    group.replaceChildren(drawn("path", { class: "wedge", d: `M0,0L${wedge[0]}A${r},${r} 0 0 1 ${wedge[1]}z` }), drawn("circle", { r: 4.5 }));
    group.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${angle.toFixed(1)})`);
  };
  const refresh = soon(draw);

  // hands: zoom with the wheel once the map has the focus, pinch, drag
  const zoomAt = (factor, x, y) => {
    const before = hand.zoom, width = box.clientWidth, tall = svg ? svg.clientHeight - 44 : 0;
    hand.zoom = Math.min(60, Math.max(1, before * factor));
    const k = hand.zoom / before;
    hand.x = hand.zoom === 1 ? 0 : x - width / 2 - k * (x - width / 2 - hand.x);
    hand.y = hand.zoom === 1 ? 0 : y - tall / 2 - k * (y - tall / 2 - hand.y);
    refresh();
  };
  const down = new Map(), at = (e) => { const r = box.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; };
  box.addEventListener("wheel", (e) => { if (!e.ctrlKey && document.activeElement !== box) return; e.preventDefault(); zoomAt(Math.exp(-e.deltaY * 0.003), ...at(e)); }, { passive: false });
  box.addEventListener("dblclick", (e) => zoomAt(2, ...at(e)));
  box.addEventListener("pointerdown", (e) => { down.set(e.pointerId, e); hand.moved = false; });
  for (const name of ["pointerup", "pointercancel", "pointerleave"]) box.addEventListener(name, (e) => down.delete(e.pointerId));
  box.addEventListener("pointermove", (e) => {
    const before = down.get(e.pointerId);
    if (!before || (hand.zoom === 1 && down.size < 2)) return;
    if (down.size === 2) {
      const other = [...down.values()].find((p) => p.pointerId !== e.pointerId), span = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY) || 1;
      zoomAt(span(e) / span(before), ...at(e));
    } else { hand.x += e.clientX - before.clientX; hand.y += e.clientY - before.clientY; refresh(); }
    if (Math.hypot(e.clientX - before.clientX, e.clientY - before.clientY) > 2) hand.moved = true;
    down.set(e.pointerId, e);
  });
  state.on(["frame"], here);
  state.on(["object", "colouring"], refresh);
  let drawnAt = 0;
  new ResizeObserver(() => { if (box.clientWidth !== drawnAt) refresh(); drawnAt = box.clientWidth; }).observe(box);
  dark.addEventListener("change", refresh);
  draw();
  drawnAt = box.clientWidth;
};

const MOST_WIDER = 1.3;
const rgbOf = ({ colour }) => `rgb(${colour.join(",")})`;
const spanOf = (points) => {
  const side = (k) => points.reduce((high, p) => Math.max(high, p[k]), -Infinity) - points.reduce((low, p) => Math.min(low, p[k]), Infinity);
  return Math.hypot(side(0), side(1));
};
const mainDirection = (points) => {
  const n = points.length, mean = [0, 1].map((k) => points.reduce((sum, p) => sum + p[k], 0) / n);
  let xx = 0, xy = 0, yy = 0;
  for (const [x, y] of points) { const a = x - mean[0], b = y - mean[1]; xx += a * a; xy += a * b; yy += b * b; }
  return 0.5 * Math.atan2(2 * xy, xx - yy);
};
// Convex hull from above of points by three (Andrew's monotone chain).
const hullOf = (flat) => {
  const points = [];
  for (let i = 0; i < flat.length; i += 3) points.push([flat[i], flat[i + 1]]);
  points.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const chain = (list) => {
    const hull = [];
    for (const p of list) {
      while (hull.length > 1) {
        const [a, b] = hull.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        hull.pop();
      }
      hull.push(p);
    }
    return hull.slice(0, -1);
  };
  return [...chain(points), ...chain(points.reverse())];
};
const mapLegend = (run) => [
  ...run.paths.map((p) => pathKey(p.name)),
  element("span", {}, element("i", { class: "start" }), "start"), element("span", {}, element("i", { class: "end" }), "end"),
  ...(run.frames.length ? [element("span", {}, element("i", { class: "here" }), "camera in this frame")] : []),
  ...(run.moving.length ? [element("span", {}, element("i", { class: "way" }), "way of a car that drives; its place in this frame")] : []),
  ...(run.objects.length ? [element("span", {}, element("i", { class: "foot" }), "footprint, tick at the front")] : []),
  ...(run.objects.some((o) => o.ellipse) ? [element("span", {}, element("i", { class: "ellipse" }), "position, 1 σ")] : []),
  ...(run.objects.some((o) => o.doubts.length) ? [element("span", {}, element("i", { class: "foot doubtful" }), "doubtful")] : []),
  ...(run.truth.length ? [element("span", {}, element("i", { class: "foot true" }), "true footprint")] : []),
];
