"use strict";
const all = (query, root = document) => [...root.querySelectorAll(query)];
const swipes = all(".swipe"), left = document.getElementById("left"), right = document.getElementById("right");
const share = document.getElementById("share");

function choose() {
  for (const swipe of swipes) {
    for (const image of all("img", swipe)) {
      image.classList.toggle("is-left", image.dataset.run === left.value);
      image.classList.toggle("is-right", image.dataset.run === right.value);
    }
    swipe.querySelector(".at-left").textContent = left.selectedOptions[0].textContent;
    swipe.querySelector(".at-right").textContent = right.selectedOptions[0].textContent;
  }
}

function slide(percent) {
  share.value = percent;
  for (const swipe of swipes) swipe.style.setProperty("--share", `${share.value}%`);
}

if (swipes.length) {
  left.addEventListener("change", choose);
  right.addEventListener("change", choose);
  share.addEventListener("input", () => slide(share.value));
  for (const swipe of swipes) {
    const follow = event => {
      const box = swipe.getBoundingClientRect();
      slide(100 * (event.clientX - box.left) / box.width);
    };
    swipe.addEventListener("pointerdown", event => { swipe.setPointerCapture(event.pointerId); follow(event); });
    swipe.addEventListener("pointermove", event => { if (event.buttons) follow(event); });
  }
  const buttons = all("#choice button");
  for (const button of buttons) button.addEventListener("click", () => {
    for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
    for (const swipe of swipes) swipe.hidden = swipe.dataset.frame !== button.dataset.frame;
  });
  choose();
  slide(50);
}

const shown = document.getElementById("shown");
all(".plan > g[class^=run]").forEach((group, place) => {
  const label = document.createElement("label"), box = document.createElement("input"), letter = document.createElement("span");
  box.type = "checkbox";
  box.checked = true;
  box.addEventListener("change", () => { group.style.display = box.checked ? "" : "none"; });
  letter.className = `letter run${place}`;
  letter.textContent = String.fromCharCode(65 + place);
  label.append(box, letter);
  shown.append(label);
});
