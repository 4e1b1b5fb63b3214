// What the whole page shows: `frame` (its place), `object` (an id or null), `colouring`, `truth`, `layers`, `playing`.
const makeState = (first) => {
  const now = { ...first }, listeners = [];
  return {
    now,
    set(change) {
      const changed = Object.keys(change).filter((key) => now[key] !== change[key]);
      Object.assign(now, change);
      if (changed.length) for (const [keys, listen] of listeners) if (keys.some((key) => changed.includes(key))) listen(now, changed);
    },
    on(keys, listen) { listeners.push([keys, listen]); },
  };
};

const all = (selector, within = document) => [...within.querySelectorAll(selector)];
const byName = (id) => document.getElementById(id);
const element = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
};
const drawn = (tag, attributes = {}, ...children) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== null && value !== undefined) made.setAttribute(name, value);
  made.append(...children);
  return made;
};
const press = (buttons, chosen) => buttons.forEach((b) => b.setAttribute("aria-pressed", String(b === chosen)));
const fixed = (value, decimals) => (value === null || value === undefined ? "–" : value.toFixed(decimals).replace("-", "−"));
// One call a picture, however often it is asked for.
const soon = (draw) => {
  let waiting = false;
  return () => { if (!waiting) { waiting = true; requestAnimationFrame(() => { waiting = false; draw(); }); } };
};
// Of 2-D pictures: without a GPU a browser would draw them by a software one, in another process, and wait for it.
const BY_CPU = { willReadFrequently: true };
