// Reads values out of charts: a line follows the pointer or the arrow keys, and the values are told below the picture.

const SVG = "http://www.w3.org/2000/svg";

function told(svg, index) {
  const { points } = JSON.parse(svg.dataset.chart);
  if (!points.length) return;
  const at = Math.min(Math.max(index, 0), points.length - 1);
  svg.dataset.at = at;
  drawCross(svg, points[at][0]);
  svg.parentElement.querySelector(".readout").textContent = points[at][1];
}

function drawCross(svg, x) {
  const { top, bottom } = JSON.parse(svg.dataset.chart);
  const cross = svg.querySelector(".cross");
  cross.removeAttribute("hidden");
  const line = document.createElementNS(SVG, "line");
  for (const [name, value] of [["x1", x], ["x2", x], ["y1", top], ["y2", bottom]]) {
    line.setAttribute(name, value);
  }
  cross.replaceChildren(line);
}

// The line at a value of the (even) x axis.
export function crossAt(svg, value) {
  const { low, high, left, right } = JSON.parse(svg.dataset.chart);
  drawCross(svg, left + ((value - low) / (high - low)) * (right - left));
}

// The value of the x axis where a chart inside `within` was clicked; null for any other click.
export function seekFrom(event, within) {
  const svg = event.target.closest?.(`${within} svg[data-chart]`);
  if (!svg) return null;
  const { low, high, left, right } = JSON.parse(svg.dataset.chart);
  const box = svg.getBoundingClientRect();
  const x = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
  return low + ((x - left) / (right - left)) * (high - low);
}

function nearest(svg, clientX) {
  const { points } = JSON.parse(svg.dataset.chart);
  const box = svg.getBoundingClientRect();
  const x = ((clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
  let best = 0;
  points.forEach((point, i) => {
    if (Math.abs(point[0] - x) < Math.abs(points[best][0] - x)) best = i;
  });
  return best;
}

// The slider over thresholds: what p is at each, on the chart and in words.
function slide(box, place) {
  const known = JSON.parse(box.dataset.thresholds);
  const one = known[place];
  box.querySelector("input").setAttribute("aria-valuetext", one.said);
  box.querySelector("output").textContent = one.said;
  box.querySelector("a").href = document.documentElement.dataset.root + one.rollouts;
  const svg = document.getElementById("chart-curve-picture");
  if (svg) crossAt(svg, one.gamma);
}

const chosen = { place: null }; // keeps through redrawing of the part

function beginSliding() {
  const box = document.querySelector("[data-thresholds]");
  if (!box) return;
  const known = JSON.parse(box.dataset.thresholds);
  const off = (one) => Math.abs(one.gamma - Number(box.dataset.own));
  const own = known.reduce((best, one, i) => (off(one) < off(known[best]) ? i : best), 0);
  const place = chosen.place === null ? own : Math.min(chosen.place, known.length - 1);
  box.querySelector("input").value = place;
  slide(box, place);
}

document.addEventListener("input", (event) => {
  const box = event.target.closest?.("[data-thresholds]");
  if (!box) return;
  chosen.place = Number(event.target.value);
  slide(box, chosen.place);
});
document.addEventListener("shown", beginSliding);
beginSliding();

document.addEventListener("pointermove", (event) => {
  const svg = event.target.closest?.("svg[data-chart]");
  if (svg) told(svg, nearest(svg, event.clientX));
});

document.addEventListener("keydown", (event) => {
  const svg = event.target.closest?.("svg[data-chart]");
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!svg || !step) return;
  event.preventDefault();
  told(svg, svg.dataset.at === undefined ? 0 : Number(svg.dataset.at) + step);
});
