"use strict";
(() => {
  const all = (selector) => [...document.querySelectorAll(selector)];
  const press = (buttons, chosen) => buttons.forEach((b) => b.setAttribute("aria-pressed", String(b === chosen)));

  const frames = all(".frame"), thumbs = all(".strip button");
  let current = 0;
  const show = (index) => {
    if (!frames.length) return;
    current = (index + frames.length) % frames.length;
    frames.forEach((frame, i) => frame.toggleAttribute("hidden", i !== current));
    press(thumbs, thumbs[current]);
    thumbs[current].scrollIntoView({ block: "nearest", inline: "nearest" });
  };
  thumbs.forEach((thumb, i) => thumb.addEventListener("click", () => show(i)));
  document.addEventListener("keydown", (event) => {
    if (event.target.id === "view" || event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key === "ArrowRight") show(current + 1);
    if (event.key === "ArrowLeft") show(current - 1);
  });
  all("#layers input").forEach((box) => box.addEventListener("change", () =>
    document.getElementById("frames").classList.toggle("no-" + box.value, !box.checked)));

  const stage = document.querySelector(".stage");
  const viewer = makeViewer(JSON.parse(document.getElementById("scene-data").textContent), stage);
  if (!viewer) {
    stage.textContent = "This browser offers no WebGL 2: open map.glb in a glTF viewer.";
    return;
  }
  const colourings = all("#colouring button");
  colourings.forEach((b) => b.addEventListener("click", () => { press(colourings, b); viewer.colourBy(b.value); }));
  all("#standpoint button").forEach((b) => b.addEventListener("click", () => viewer.standAt(b.value)));
  all(".chip").forEach((chip) => chip.addEventListener("click", () => {
    viewer.lookAt(Number(chip.dataset.id));
    document.getElementById("scene").scrollIntoView({ behavior: "smooth", block: "start" });
  }));
})();
