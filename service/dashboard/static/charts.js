// Reads values out of charts: a line follows the pointer or the arrow keys, and the values are told below the picture.

const SVG = "http://www.w3.org/2000/svg";

function told(svg, index) {
  const { points, top, bottom } = JSON.parse(svg.dataset.chart);
  if (!points.length) return;
  const at = Math.min(Math.max(index, 0), points.length - 1);
  svg.dataset.at = at;
  const cross = svg.querySelector(".cross");
  cross.removeAttribute("hidden");
  const line = document.createElementNS(SVG, "line");
  for (const [name, value] of [["x1", points[at][0]], ["x2", points[at][0]], ["y1", top], ["y2", bottom]]) {
    line.setAttribute(name, value);
  }
  cross.replaceChildren(line);
  svg.parentElement.querySelector(".readout").textContent = points[at][1];
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
