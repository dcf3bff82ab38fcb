"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const colours = {
  "new": "#0a8f3c", "demolished": "#d0302f", "raised": "#7a3fd1", "lowered": "#b8529e", "extended": "#2f9fd0",
  "partly demolished": "#e2711d", "roof replaced": "#c79a00", "unclear": "#6b7280", "not covered": "#9aa4af",
};
const both = document.getElementById("both"), slider = document.getElementById("slider");
const layers = [...document.querySelectorAll("#both .moved")];
const names = "http://www.w3.org/2000/svg";
let scale = 1, left = 0, top_ = 0, chosen = null, shown = null;

function place() {
  for (const layer of layers) {
    layer.style.width = data.width * scale + "px";
    layer.style.height = data.height * scale + "px";
    layer.style.transform = `translate(${left}px, ${top_}px)`;
  }
}
function fit() {
  scale = Math.min(both.clientWidth / data.width, both.clientHeight / data.height);
  left = (both.clientWidth - data.width * scale) / 2;
  top_ = (both.clientHeight - data.height * scale) / 2;
  place();
}
function divide() {
  const share = slider.value / 1000;
  document.getElementById("old").style.clipPath = `inset(0 ${100 * (1 - share)}% 0 0)`;
  document.getElementById("divider").style.left = 100 * share + "%";
}
function draw(svg, paths, colour) {
  svg.setAttribute("viewBox", `0 0 ${data.width} ${data.height}`);
  for (const one of paths) {
    const path = document.createElementNS(names, "path");
    path.setAttribute("d", one.path);
    if (colour) {
      path.style.stroke = colours[one.change];
      path.dataset.id = one.id;
      const title = document.createElementNS(names, "title");
      title.textContent = `${one.id}: ${one.change}; ${one.reason}`;
      path.append(title);
      path.addEventListener("click", () => choose(one.id, false));
    }
    svg.append(path);
  }
}
function choose(id, move) {
  chosen = id;
  for (const path of document.querySelectorAll("#marks path")) path.classList.toggle("chosen", path.dataset.id === id);
  for (const row of document.querySelectorAll("tbody tr")) {
    row.classList.toggle("chosen", row.dataset.id === id);
    if (row.dataset.id === id && !move) row.scrollIntoView({ block: "nearest" });
  }
  if (!move) return;
  const numbers = data.changes.find((one) => one.id === id).path.match(/-?[\d.]+/g).map(Number);
  const x = numbers.filter((_, k) => k % 2 === 0), y = numbers.filter((_, k) => k % 2 === 1);
  const size = Math.max(Math.max(...x) - Math.min(...x), Math.max(...y) - Math.min(...y), 10);
  scale = Math.min(both.clientWidth, both.clientHeight) / (3 * size);
  left = both.clientWidth / 2 - scale * (Math.max(...x) + Math.min(...x)) / 2;
  top_ = both.clientHeight / 2 - scale * (Math.max(...y) + Math.min(...y)) / 2;
  place();
  both.scrollIntoView({ block: "nearest" });
}
function list() {
  const body = document.querySelector("tbody");
  body.replaceChildren();
  for (const one of data.changes) {
    if (shown ? one.change !== shown : one.change === "unchanged") continue;
    const row = body.insertRow();
    row.dataset.id = one.id;
    row.tabIndex = 0;
    for (const [name] of data.columns) row.insertCell().textContent = one[name] ?? "";
    row.addEventListener("click", () => choose(one.id, true));
    row.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(one.id, true); });
  }
}
for (const [, title] of data.columns) {
  const cell = document.createElement("th");
  cell.textContent = title;
  document.querySelector("thead tr").append(cell);
}
for (const name of [null, ...data.verdicts]) {
  const button = document.createElement("button");
  const count = data.changes.filter((one) => name ? one.change === name : one.change !== "unchanged").length;
  button.textContent = `${name ?? "all changes"} (${count})`;
  if (name) button.style.borderColor = colours[name] ?? "";
  button.addEventListener("click", () => { shown = name; list(); });
  document.getElementById("choice").append(button, " ");
}
for (const name of ["old", "new"]) draw(document.querySelector(`#${name} svg`), data.outlines[name] ?? [], false);
draw(document.getElementById("marks"), data.changes.filter((one) => one.change !== "unchanged"), true);
slider.addEventListener("input", divide);
slider.addEventListener("pointerdown", (event) => event.stopPropagation());
both.addEventListener("wheel", (event) => {
  event.preventDefault();
  const factor = Math.exp(-event.deltaY * 0.0015), box = both.getBoundingClientRect();
  const x = event.clientX - box.left, y = event.clientY - box.top;
  left = x - (x - left) * factor;
  top_ = y - (y - top_) * factor;
  scale *= factor;
  place();
}, { passive: false });
let from = null;
both.addEventListener("pointerdown", (event) => { from = [event.clientX - left, event.clientY - top_]; });
window.addEventListener("pointermove", (event) => {
  if (!from) return;
  left = event.clientX - from[0];
  top_ = event.clientY - from[1];
  place();
});
window.addEventListener("pointerup", () => { from = null; });
window.addEventListener("resize", fit);
fit();
divide();
list();
