// Puts the page together.
const startPage = async () => {
  const run = readRun(JSON.parse(byName("run").textContent));
  const layers = { image: true, meshes: true, masks: true, boxes: false, points: false, labels: true };
  const state = makeState({ frame: 0, object: null, colouring: "id", truth: run.truth.length > 0, layers, playing: false });
  const images = makeImages(run);

  // switches
  const colourings = Object.keys(COLOURINGS).filter((name) => name !== "error" || run.objects.some((o) => o.error));
  byName("colouring").append(...colourings.map((name) => element("button", { type: "button", value: name, "aria-pressed": String(name === "id"), onclick: () => state.set({ colouring: name }) }, COLOURINGS[name])));
  byName("truth-switch").hidden = !run.truth.length;
  byName("show-truth").addEventListener("change", (event) => state.set({ truth: event.target.checked }));
  all("#layers input").forEach((box) => {
    if ((box.value === "image" && !run.hasImages) || (box.value === "points" && !run.keypoints.length)) { box.parentElement.remove(); return; }
    box.addEventListener("change", () => state.set({ layers: { ...state.now.layers, [box.value]: box.checked } }));
  });

  const sceneLegend = () => byName("scene-legend").replaceChildren(
    ...colouringKeys(state.now.colouring, true), ...run.paths.map((p) => pathKey(p.name)),
    ...(run.truth.length ? [key(swatch("wire", ""), "true mesh")] : []),
    ...(run.objects.some((o) => o.doubts.length) ? [key(swatch("dot", "background:var(--prior);opacity:.45"), "faded: doubtful")] : []),
    element("span", { class: "hint" }, "drag: turn · shift or right button: move · click, then wheel: zoom"),
  );
  const keys = run.keypoints.map(({ name, colour }) => key(swatch("dot", `background:${colour}`), name));
  const shownLegend = () => byName("frame-legend").replaceChildren(...frameLegend(run), ...colouringKeys(state.now.colouring, false), ...(state.now.layers.points ? keys : []));
  state.on(["colouring"], sceneLegend);
  state.on(["colouring", "layers"], shownLegend);
  state.on(["colouring"], () => press(all("#colouring button"), all("#colouring button").find((b) => b.value === state.now.colouring)));
  sceneLegend();
  shownLegend();

  const parts = { viewer: null };
  if (run.frames.length) {
    byName("player").hidden = false;
    await makeFrameView(run, state, images, byName("frame")).draw();  // first, since a browser takes its time to open WebGL
    makePlayer(run, state, parts);
  } else byName("frames").hidden = true;
  makePlan(run, state, byName("map"));
  byName("map-legend").replaceChildren(...mapLegend(run));
  makeCarPanel(run, state, images);
  drawCharts(run, state, byName("charts"));
  listen(run, state);
  dark.addEventListener("change", () => drawPictures(run, images));
  await new Promise((painted) => requestAnimationFrame(() => setTimeout(painted)));
  parts.viewer = openViewer(run, state);
  document.documentElement.dataset.ready = "1";
  performance.mark("ready");
  (window.requestIdleCallback || setTimeout)(() => drawPictures(run, images));
};

const openViewer = (run, state) => {
  const viewer = makeViewer(run, state, document.querySelector(".stage"));
  byName("no-webgl").hidden = viewer !== null;
  byName("view").hidden = viewer === null;
  if (!viewer) return null;
  const offered = Object.entries(STANDPOINTS).filter(([name]) => run.frames.length || name === "start" || name === "top");
  byName("standpoint").append(...offered.map(([name, words]) => element("button", { type: "button", value: name, onclick: () => viewer.stand(name) }, words)));
  viewer.stand("start", true);
  return viewer;
};

// Tables and bars select objects; the row of the selected one is marked. Tracks that are left out lead to their frame.
const listen = (run, state) => {
  const chips = all("main table .chip, .ious .chip");
  chips.forEach((chip) => chip.addEventListener("click", () => state.set({ object: Number(chip.dataset.id) })));
  all("table.objects tbody tr").forEach((row) => row.addEventListener("click", (event) => {
    if (!event.target.closest("button, a")) state.set({ object: Number(row.querySelector(".chip").dataset.id) });
  }));
  all(".bars.ious li").forEach((row) => row.addEventListener("click", () => state.set({ object: Number(row.querySelector(".chip").dataset.id) })));
  state.on(["object"], () => chips.forEach((chip) => {
    const chosen = Number(chip.dataset.id) === state.now.object;
    chip.setAttribute("aria-pressed", String(chosen));
    chip.closest("tr, li").classList.toggle("chosen", chosen);
  }));
  state.on(["object"], ({ object, playing }) => {
    const best = object === null ? null : bestView(run, object), views = run.views.get(object) || [];
    if (best && !playing && !views.some(({ frame }) => frame.at === state.now.frame)) state.set({ frame: best.frame.at });
  });
  all(".to-frame").forEach((button) => {
    const best = bestView(run, Number(button.dataset.id));
    button.hidden = !best;
    if (!best) return;
    button.textContent = `show frame ${best.frame.number}`;
    button.addEventListener("click", () => { state.set({ playing: false, frame: best.frame.at }); byName("frames").scrollIntoView({ block: "start" }); });
  });
};
if (byName("run")) startPage();
