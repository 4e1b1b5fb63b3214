// The slider, playback by the run's own clock, and the keys.
const makePlayer = (run, state, parts) => {
  const slider = byName("slider"), now = byName("now"), play = byName("play"), last = run.frames.length - 1;
  const timeAt = (at) => run.series.times[run.frames[at].index];
  const show = (frame) => state.set({ frame: Math.min(last, Math.max(0, frame)) });
  slider.max = Math.max(0, last);
  slider.addEventListener("input", () => { state.set({ playing: false }); show(Number(slider.value)); });
  byName("before").addEventListener("click", () => show(state.now.frame - 1));
  byName("after").addEventListener("click", () => show(state.now.frame + 1));
  play.addEventListener("click", () => toggle());

  let began = 0, from = 0, speed = 1;
  const toggle = () => {
    if (!state.now.playing && state.now.frame === last) show(0);
    state.set({ playing: !state.now.playing });
  };
  const begin = () => { began = performance.now(); from = timeAt(state.now.frame); };
  const step = () => {
    if (!state.now.playing) return;
    const wanted = from + speed * (performance.now() - began) / 1000;
    let at = state.now.frame;
    while (at < last && timeAt(at + 1) <= wanted) at++;
    show(at);
    if (at === last) state.set({ playing: false });
    else requestAnimationFrame(step);
  };
  byName("speed").addEventListener("change", (event) => { speed = Number(event.target.value); begin(); });
  state.on(["playing"], ({ playing }) => {
    play.textContent = playing ? "⏸" : "▶";
    play.setAttribute("aria-label", playing ? "pause" : "play");
    if (playing) { begin(); requestAnimationFrame(step); }
  });
  const told = () => {
    const at = state.now.frame, frame = run.frames[at];
    slider.value = at;
    const words = `frame ${frame.number}, ${fixed(timeAt(at), 2)} s`;
    slider.setAttribute("aria-valuetext", words);
    now.replaceChildren(element("b", {}, `frame ${frame.number}`), element("span", {}, ` ${at + 1} of ${last + 1}`), ` · ${fixed(timeAt(at), 2)} s`);
  };
  state.on(["frame"], told);
  told();

  // where the selected object is seen, above the slider
  const strip = byName("seen-in");
  const mark = () => {
    const width = strip.width = Math.max(1, Math.round(strip.clientWidth * (window.devicePixelRatio || 1))), context = strip.getContext("2d", BY_CPU);
    const views = run.views.get(state.now.object) || [], wide = Math.max(2, width / (last + 1));
    context.fillStyle = css(themed("--accent"));
    for (const { frame } of views) context.fillRect((frame.at / Math.max(1, last)) * (width - wide), 0, wide, strip.height);
  };
  state.on(["object"], mark);
  new ResizeObserver(soon(mark)).observe(strip);

  const objects = run.objects.map((o) => o.id);
  const other = (by) => {
    if (!objects.length) return;
    const at = objects.indexOf(state.now.object);
    state.set({ object: objects[at < 0 ? (by > 0 ? 0 : objects.length - 1) : (at + by + objects.length) % objects.length] });
  };
  const next = (selector) => {
    const buttons = all(`${selector} button`), at = buttons.findIndex((b) => b.getAttribute("aria-pressed") === "true");
    if (buttons.length) buttons[(at + 1) % buttons.length].click();
  };
  const keys = {
    ArrowRight: () => { state.set({ playing: false }); show(state.now.frame + 1); },
    ArrowLeft: () => { state.set({ playing: false }); show(state.now.frame - 1); },
    Home: () => show(0), End: () => show(last), " ": toggle,
    j: () => other(1), k: () => other(-1), Escape: () => state.set({ object: null }), c: () => next("#colouring"), v: () => next("#standpoint"),
    "+": () => parts.viewer && parts.viewer.zoom(0.85), "-": () => parts.viewer && parts.viewer.zoom(1.18),
  };
  const turns = { ArrowLeft: [-25, 0], ArrowRight: [25, 0], ArrowUp: [0, 25], ArrowDown: [0, -25] };
  document.addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey || event.target.matches("select, input[type=text]")) return;
    if (event.target === slider && /^Arrow|^Home|^End/.test(event.key) && !event.shiftKey) return;  // the slider does it itself
    if (event.key === " " && event.target.matches("button, input[type=checkbox]")) return;
    const act = event.shiftKey && turns[event.key] ? parts.viewer && (() => parts.viewer.turn(...turns[event.key])) : keys[event.key] || keys[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act();
  });
};
