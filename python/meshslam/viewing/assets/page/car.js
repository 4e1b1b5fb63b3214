// The selected object: its figures, doubts in words, the category's mean beside the instance, its views.
const MOST_VIEWS = 24;
const canvasOf = (width, height, label) => {
  const dense = Math.min(2, window.devicePixelRatio || 1);
  return element("canvas", { width: Math.round(width * dense), height: Math.round(height * dense), role: "img", "aria-label": label });
};
const makeCarPanel = (run, state, images) => {
  const body = byName("car-body"), title = byName("car-title");
  const facts = (o) => {
    const rows = [
      ["size", `${o.dimensions.map((v) => v.toFixed(2)).join(" × ")} m`],
      ["position, 1 σ", o.position_sigma === null ? "–" : `${fixed(100 * o.position_sigma, 1)} cm`],
      ["surface measured", o.seen_share === null ? "–" : `${fixed(100 * o.seen_share, 0)}%`],
      ["mask IoU", fixed(o.mask_iou, 3)],
      ["views in the map", String(o.views)],
      ...(o.error ? [["centre to truth", `${fixed(o.error.centre, 2)} m`], ["yaw to truth", `${fixed(o.error.yaw, 1)}°`], ["voxel IoU", fixed(o.error.voxel_iou, 2)]] : []),
    ];
    return element("dl", { class: "facts" }, ...rows.map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value))));
  };
  const compared = (o) => {
    const best = bestView(run, o.id);
    if (!best || !o.first) return [];
    const colour = colourOf(o, "id"), pictures = [["category’s mean, first estimate", o.first], ["instance", o]].map(([words, mesh]) => {
      const canvas = canvasOf(190, 126, `${words} over frame ${best.frame.number}`);
      drawCrop(canvas, run, images, best, mesh, colour);
      return element("figure", {}, canvas, element("figcaption", {}, words));
    });
    return [element("div", { class: "compared" }, ...pictures)];
  };
  const views = (o) => {
    const found = run.views.get(o.id) || [], step = Math.max(1, found.length / MOST_VIEWS);
    const shown = Array.from({ length: Math.min(found.length, MOST_VIEWS) }, (_, i) => found[Math.floor(i * step)]);
    if (!shown.length) return [element("p", { class: "hint" }, "No frame of this page shows it.")];
    const buttons = shown.map((view) => {
      const canvas = canvasOf(126, 84, `frame ${view.frame.number}`);
      drawCrop(canvas, run, images, view, o, colourOf(o, "id"));
      return element("button", { type: "button", "data-frame": view.frame.at, "aria-pressed": String(view.frame.at === state.now.frame), onclick: () => state.set({ playing: false, frame: view.frame.at }) },
        canvas, element("span", {}, `frame ${view.frame.number}`));
    });
    const said = shown.length < found.length ? `${shown.length} of ${found.length} views` : `${found.length} ${found.length === 1 ? "view" : "views"}`;
    return [element("h3", {}, `${said}: mask (dashed) and mesh`), element("div", { class: "views" }, ...buttons)];
  };
  const show = () => {
    const o = run.byId.get(state.now.object), chosen = byName("selected");
    chosen.hidden = !o;
    if (!o) {
      title.textContent = "Selected object";
      const all = element("div", { class: "chips" }, ...run.objects.map((object) => objectChip(run, state, object.id)));
      const words = run.objects.length ? "Select an object here, in the frame, in 3-D, on the map, in a table, or by the keys J and K: it is then shown everywhere." : "No object is in the map.";
      body.replaceChildren(element("p", { class: "hint" }, words), all);
      return;
    }
    title.replaceChildren(swatch("chip-colour", `background:${css(o.colour)}`), `${o.category} ${o.id}`);
    chosen.replaceChildren(`${o.category} ${o.id} `, element("button", { type: "button", class: "clear", "aria-label": "no object", onclick: () => state.set({ object: null }) }, "✕"));
    const doubt = o.doubts.length ? [element("p", { class: "doubt" }, element("b", {}, "Doubtful: "), o.doubts.join("; "), ".")] : [];
    body.replaceChildren(...doubt, facts(o), ...compared(o), ...views(o));
  };
  state.on(["object", "colouring"], show);
  state.on(["frame"], () => all(".views button", body).forEach((b) => b.setAttribute("aria-pressed", String(Number(b.dataset.frame) === state.now.frame))));
  show();
};

// Pictures of tables and lists, one after the other while the page has nothing else to do.
const drawPictures = async (run, images) => {
  for (const canvas of all("canvas.thumb")) {
    const object = run.byId.get(Number(canvas.dataset.id)), best = bestView(run, object.id);
    if (best) await drawCrop(canvas, run, images, best, object, object.colour);
    else canvas.classList.add("none");
  }
  for (const canvas of all("canvas.lost")) {
    const best = bestView(run, Number(canvas.dataset.id)), object = run.byId.get(Number(canvas.dataset.id)) || null;
    if (best) await drawCrop(canvas, run, images, best, object, themed("--prior"));
    else canvas.remove();
  }
};
