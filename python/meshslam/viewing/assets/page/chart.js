// Line charts over time: a band of three sigmas, lines, the current frame; a click shows the frame there.
const ticksOf = (low, high, count) => {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].find((k) => k * power >= raw) * power;
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high * (1 + 1e-9); k++) found.push(k * step);
  return found;
};
// What drifts away, such as the IMU alone, leaves the chart: the first line and the band decide its height.
const MOST_HIGHER = 3;
// `lines`: name, values (null where unknown), style of paths. `band`: values below which it is filled.
const makeChart = (box, { title, unit, x, xLabel, band, bandName, lines, at, onPick }) => {
  const body = element("div", { class: "chart" }), legend = element("div", { class: "legend" });
  box.append(element("figure", {}, element("figcaption", {}, element("b", {}, title), `, ${unit}`), body, legend));
  const highest = (values) => values.reduce((high, v) => (v > high ? v : high), 1e-6), own = highest([...lines[0].values, ...(band || [])]);
  const top = 1.08 * Math.min(highest(lines.flatMap((l) => l.values).concat(own)), MOST_HIGHER * own), last = x.length ? x[x.length - 1] : 1, first = x.length ? x[0] : 0;
  legend.append(...lines.map((l) => pathKey(l.name)), ...(band ? [key(swatch("box", "background:var(--band)"), bandName)] : []));
  let cursor = null, scaled = null;
  const draw = () => {
    const width = body.clientWidth, height = width > 420 ? 210 : 180, left = 46, right = 8, bottom = 32;
    if (!width) return;
    const px = (v) => left + (width - left - right) * (v - first) / (last - first || 1), py = (v) => 8 + (height - 8 - bottom) * (1 - v / top);
    const svg = drawn("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${title} over ${xLabel}` });
    for (const v of ticksOf(0, top, 4)) svg.append(drawn("line", { class: "grid", x1: left, x2: width - right, y1: py(v), y2: py(v) }), drawn("text", { x: left - 6, y: py(v) + 4, "text-anchor": "end" }, +v.toPrecision(3)));
    for (const v of ticksOf(first, last, width > 420 ? 7 : 4)) svg.append(drawn("line", { class: "grid", x1: px(v), x2: px(v), y1: 8, y2: height - bottom }), drawn("text", { x: px(v), y: height - bottom + 16, "text-anchor": "middle" }, +v.toPrecision(4)));
    svg.append(drawn("text", { x: width - right, y: height - 2, "text-anchor": "end" }, xLabel));
    const thin = Math.max(1, Math.floor(x.length / 1500)), places = x.map((_, i) => i).filter((i) => i % thin === 0 || i === x.length - 1);
    if (band) {
      const above = places.map((i) => `${px(x[i]).toFixed(1)},${py(Math.min(top, band[i])).toFixed(1)}`);
      svg.append(drawn("polygon", { class: "band", points: `${px(first)},${py(0)} ${above.join(" ")} ${px(last)},${py(0)}` }));
    }
    for (const l of [...lines].sort((a, b) => pathStyle(a.name).order - pathStyle(b.name).order)) {
      const style = pathStyle(l.name);
      let pen = "M", d = "";
      for (const i of places) {
        if (l.values[i] === null || l.values[i] === undefined) { pen = "M"; continue; }
        d += `${pen}${px(x[i]).toFixed(1)},${py(l.values[i]).toFixed(1)}`;
        pen = "L";
      }
      svg.append(drawn("path", { class: "line", d, style: `stroke:var(${style.colour})`, "stroke-width": Math.min(2.4, style.width), "stroke-dasharray": style.dash && style.dash.join(" ") }));
    }
    cursor = drawn("line", { class: "cursor", y1: 8, y2: height - bottom });
    svg.append(cursor);
    scaled = px;
    if (onPick) svg.addEventListener("click", (event) => {
      const rect = svg.getBoundingClientRect(), v = first + (last - first) * ((event.clientX - rect.left) - left) / (width - left - right);
      onPick(v);
    });
    body.replaceChildren(svg);
    move();
  };
  const move = () => {
    const v = at ? at() : null;
    if (!cursor) return;
    cursor.toggleAttribute("hidden", v === null);
    if (v !== null) { cursor.setAttribute("x1", scaled(v)); cursor.setAttribute("x2", scaled(v)); }
  };
  let drawnAt = 0;
  const refresh = soon(draw);
  new ResizeObserver(() => { if (body.clientWidth !== drawnAt) refresh(); drawnAt = body.clientWidth; }).observe(body);
  draw();
  drawnAt = body.clientWidth;
  return move;
};

const drawCharts = (run, state, section) => {
  const box = section.querySelector(".charts"), { series } = run, moves = [];
  section.hidden = !series.errors.length && !series.position_sigma && !run.iterations.length;  // what is hidden has no width
  const pick = (time) => {
    const nearest = run.frames.reduce((best, f) => (Math.abs(series.times[f.index] - time) < Math.abs(series.times[best.index] - time) ? f : best), run.frames[0]);
    if (nearest) state.set({ playing: false, frame: nearest.at });
  };
  const at = () => { const frame = run.frames[state.now.frame]; return frame ? series.times[frame.index] : null; };
  for (const [name, unit] of [["position", "m"], ["rotation", "°"]]) {
    const sigma = series[`${name}_sigma`], lines = series.errors.map((e) => ({ name: e.name, values: e[name] }));
    const shared = { x: series.times, xLabel: "time, s", at, onPick: pick };
    if (lines.length) moves.push(makeChart(box, { ...shared, title: `Error of the ${name}`, unit, lines, band: sigma && sigma.map((v) => 3 * v), bandName: "3 σ of the estimate" }));
    if (sigma) moves.push(makeChart(box, { ...shared, title: `Uncertainty of the ${name}, 1 σ`, unit, lines: [{ name: "estimate", values: sigma }] }));
  }
  if (run.iterations.length) makeChart(box, { title: "Error of the path after each iteration", unit: "m", x: run.iterations.map((_, i) => i), xLabel: "iteration", lines: [{ name: "estimate", values: run.iterations }] });
  state.on(["frame"], () => moves.forEach((move) => move()));
};
