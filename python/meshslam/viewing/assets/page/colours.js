// Colours of objects, by what is asked for; the same in every picture.
const COLOURINGS = { id: "number", sigma: "uncertainty", seen: "seen or prior", error: "error" };
const SIGMAS_M = [0.02, 0.5], VERTEX_SIGMAS_M = [0.02, 0.2], ERRORS_M = [0.02, 1.0];
const RAMP = [[26, 143, 133], [245, 204, 97], [184, 51, 107]];
const RAMP_CSS = `linear-gradient(90deg, ${RAMP.map((c) => `rgb(${c})`).join(", ")})`;

const theme = new Map();  // of the page's colours, as they are now
const dark = window.matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => theme.clear());
const themed = (name) => {
  if (!theme.has(name)) {
    const text = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    theme.set(name, [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16)));
  }
  return theme.get(name);
};
const ramp = (value, [low, high]) => {
  const t = 2 * Math.min(1, Math.max(0, Math.log(Math.max(value, 1e-6) / low) / Math.log(high / low)));
  return (t < 1 ? mix(RAMP[0], RAMP[1], t) : mix(RAMP[1], RAMP[2], t - 1)).map(Math.round);
};
const colourOf = (object, colouring) => {
  const unknown = themed("--prior");
  if (colouring === "sigma") return object.position_sigma === null ? unknown : ramp(object.position_sigma, SIGMAS_M);
  if (colouring === "seen") return object.seen_share === null ? unknown : mix(unknown, themed("--seen"), object.seen_share).map(Math.round);
  if (colouring === "error") return object.error ? ramp(object.error.centre, ERRORS_M) : unknown;
  return object.colour;
};
const css = (rgb, opacity = 1) => `rgb(${rgb[0]} ${rgb[1]} ${rgb[2]} / ${opacity})`;
// Black or white, whichever can be read on a colour (WCAG's relative luminance).
const inkOn = (rgb) => {
  const [r, g, b] = rgb.map((v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.179 ? "#131517" : "#ffffff";
};
const key = (sample, words) => element("span", {}, sample, words);
const swatch = (kind, style) => element("i", { class: kind, style });
const scaleKey = ([low, high], words) => {
  const said = (v) => (v < 1 ? `${Math.round(100 * v)} cm` : `${v} m`);
  return element("span", {}, said(low), swatch("ramp", `background:${RAMP_CSS}`), `${said(high)}: ${words}`);
};
const colouringKeys = (colouring, perVertex) => ({
  id: [],
  sigma: [perVertex ? scaleKey(VERTEX_SIGMAS_M, "1 σ of a vertex") : scaleKey(SIGMAS_M, "1 σ of the position")],
  seen: [key(swatch("dot", "background:var(--seen)"), "seen"), key(swatch("dot", "background:var(--prior)"), "the category’s prior")],
  error: [scaleKey(ERRORS_M, "centre to the true one")],
}[colouring]);
// How paths are drawn: the estimate is a wide band below the others.
const pathStyle = (name) => {
  if (name === "estimate") return { colour: "--path", width: 5, opacity: 0.5, dash: null, order: 0 };
  if (name === "truth") return { colour: "--truth", width: 1.8, opacity: 1, dash: null, order: 2 };
  return { colour: "--other", width: 1.8, opacity: 1, dash: [7, 5], order: 1 };
};
const pathKey = (name) => {
  const { colour, width, opacity, dash } = pathStyle(name);
  const line = drawn("svg", { class: "line", width: 30, height: 10, "aria-hidden": "true" }, drawn("path", {
    d: "M1,5h28", style: `stroke:var(${colour})`, "stroke-width": width, "stroke-opacity": opacity, "stroke-dasharray": dash && dash.join(" "),
  }));
  return element("span", {}, line, name === "truth" ? "true path" : name === "estimate" ? "estimated path" : name);
};
