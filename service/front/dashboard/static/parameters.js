// Parameters against f: cells of all rollouts with the dangerous ones on top, parallel coordinates of these, and their
// list. What is chosen in one is chosen in all.

import { fetched } from "./fetched.js";

const SVG = "http://www.w3.org/2000/svg";
const by = (id) => document.getElementById(id);
const page = by("parameters");
const AXES = 7; // of the parallel coordinates, f beside them
const LISTED = 50;
const BOX = { left: 62, right: 548, top: 12, bottom: 312 }; // of the scatter
const PAR = { left: 46, right: 594, top: 26, bottom: 286 };
const F = "f";

let data = null;
let chosenAxis = 0;
let shown = []; // axes of the parallel coordinates, by number
const brushes = new Map(); // axis number or F -> [low, high]
let circles = [];
let lines = [];

const isNumber = (value) => value !== null && value !== undefined && !Number.isNaN(value);
const short = (value) => (isNumber(value) ? String(Number(value.toPrecision(3))) : "–");

function add(parent, kind, attributes, text = "") {
  const made = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text) made.textContent = text;
  parent.append(made);
  return made;
}

const onto = (value, low, high, start, end) =>
  start + Math.min(Math.max((value - low) / (high - low || 1), 0), 1) * (end - start);

const fEnds = () => [data.f_edges[0], data.f_edges[data.f_edges.length - 1]];
const percent = (share) => `${Number((100 * share).toPrecision(2))}%`;
const said = (axis) => nameOf(axis).join(" ") + (axis.unit ? `, ${axis.unit}` : "");

// Whose it is, and what.
function nameOf({ name, kind }) {
  const [whose, key] = name.includes(".") ? name.split(".") : [kind === "behaviour" ? "drivers'" : "", name];
  return [whose, key.replace(/_(m|mps|deg|s|mmph)$/, "").replaceAll("_", " ")];
}

function valueOf(rollout, axis) {
  return axis === F ? rollout.f : rollout.values[axis];
}

function endsOf(axis) {
  if (axis !== F) return [data.axes[axis].low, data.axes[axis].high];
  const values = data.dangerous.map((one) => one.f).filter(isNumber);
  return values.length ? [Math.min(...values), Math.max(...values)] : fEnds();
}

function isChosen(rollout) {
  for (const [axis, [low, high]] of brushes) {
    const value = valueOf(rollout, axis);
    if (!isNumber(value) || value < low || value > high) return false;
  }
  return true;
}

function drawScatter() {
  const svg = by("scatter");
  const axis = data.axes[chosenAxis];
  const [low, high] = fEnds();
  const toX = (v) => onto(v, axis.low, axis.high, BOX.left, BOX.right);
  const toY = (f) => onto(f, low, high, BOX.bottom, BOX.top);
  svg.replaceChildren();
  const most = Math.max(1, ...axis.counts.flat());
  const scaled = by("scatter-log").checked ? (n) => Math.log1p(n) / Math.log1p(most) : (n) => n / most;
  const cells = add(svg, "g", { class: "cells" });
  axis.counts.forEach((row, j) =>
    row.forEach((n, i) => {
      if (!n) return;
      const width = (BOX.right - BOX.left) / row.length;
      const [top, bottom] = [toY(data.f_edges[j + 1]), toY(data.f_edges[j])];
      const [x, opacity] = [BOX.left + i * width, 0.06 + 0.84 * scaled(n)];
      const at = { x: x.toFixed(1), y: top.toFixed(1), width: (width + 0.3).toFixed(1) };
      add(cells, "rect", { ...at, height: (bottom - top + 0.3).toFixed(1), opacity: opacity.toFixed(3) });
    }),
  );
  drawAxes(svg, axis, low, high, toX, toY);
  const g = toY(data.gamma);
  add(svg, "line", { class: "mark", x1: BOX.left, x2: BOX.right, y1: g, y2: g });
  add(svg, "text", { class: "tick", x: BOX.right, y: g - 4, "text-anchor": "end" }, `γ = ${short(data.gamma)}`);
  const dots = add(svg, "g", { class: "dangerous" });
  circles = data.dangerous.map((one) => {
    const value = one.values[chosenAxis];
    if (!isNumber(value) || !isNumber(one.f)) return null;
    const dot = add(dots, "circle", { cx: toX(value).toFixed(1), cy: toY(one.f).toFixed(1), r: 3.5 });
    add(dot, "title", {}, `rollout ${one.row}: f ${short(one.f)}, ${said(axis)} ${short(value)}`);
    return dot;
  });
  add(svg, "rect", { class: "drag", hidden: "" });
  by("scatter-shows").textContent =
    (axis.counts.length
      ? `Shaded: ${data.sampled.toLocaleString("en")} rollouts, evenly spread over ` +
        `${data.recorded.toLocaleString("en")} on record, of search and estimate; f above ${short(high)} in the ` +
        "uppermost cells. "
      : `Of the ${data.run_again} dangerous rollouts that were run again. `) +
    `Dots: dangerous rollouts of the estimate.` +
    (isNumber(axis.shift_sd) ? ` Their mean lies ${short(axis.shift_sd)} standard deviations from that of all.` : "");
}

function drawAxes(svg, axis, low, high, toX, toY) {
  const edge = { class: "axis" };
  add(svg, "line", { ...edge, x1: BOX.left, x2: BOX.right, y1: BOX.bottom, y2: BOX.bottom });
  add(svg, "line", { ...edge, x1: BOX.left, x2: BOX.left, y1: BOX.top, y2: BOX.bottom });
  for (let i = 0; i <= 4; i++) {
    const [v, f] = [axis.low + (i / 4) * (axis.high - axis.low), low + (i / 4) * (high - low)];
    add(svg, "text", { class: "tick", x: toX(v), y: BOX.bottom + 18, "text-anchor": i < 4 ? "middle" : "end" }, short(v));
    add(svg, "text", { class: "tick", x: BOX.left - 7, y: toY(f) + 4, "text-anchor": "end" }, short(f));
  }
  const middle = (BOX.left + BOX.right) / 2;
  add(svg, "text", { class: "label", x: middle, y: BOX.bottom + 40, "text-anchor": "middle" }, said(axis));
  const up = (BOX.top + BOX.bottom) / 2;
  const turned = { class: "label", x: 14, y: up, "text-anchor": "middle", transform: `rotate(-90 14 ${up})` };
  add(svg, "text", turned, `f, ${data.unit}`);
}

const placeOf = (n) => PAR.left + (n * (PAR.right - PAR.left)) / Math.max(shown.length - 1, 1);

function drawParallel() {
  const svg = by("parallel");
  svg.replaceChildren();
  const all = add(svg, "g", { class: "lines" });
  const height = shown.map((axis) => {
    const [low, high] = endsOf(axis);
    return (v) => onto(v, low, high, PAR.bottom, PAR.top);
  });
  lines = data.dangerous.map((one) => {
    const points = shown
      .map((axis, n) => [placeOf(n), height[n], valueOf(one, axis)])
      .filter(([, , value]) => isNumber(value));
    const text = points.map(([x, up, value]) => `${x.toFixed(1)},${up(value).toFixed(1)}`).join(" ");
    return add(all, "polyline", { points: text });
  });
  shown.forEach((axis, n) => {
    const [low, high] = endsOf(axis);
    const x = placeOf(n);
    const middle = { class: "tick", x, "text-anchor": "middle" };
    add(svg, "line", { class: "axis", x1: x, x2: x, y1: PAR.top, y2: PAR.bottom });
    add(svg, "rect", { class: "grip", "data-n": n, x: x - 16, y: PAR.top, width: 32, height: PAR.bottom - PAR.top });
    add(svg, "rect", { class: "held", "data-n": n, x: x - 7, width: 14, hidden: "" });
    add(svg, "text", { ...middle, y: PAR.top - 10 }, short(high));
    add(svg, "text", { ...middle, y: PAR.bottom + 16 }, short(low));
    const name = axis === F ? ["f", data.unit.split(",")[0]] : nameLines(data.axes[axis]);
    name.forEach((line, k) => add(svg, "text", { ...middle, y: PAR.bottom + 33 + 14 * k }, line));
  });
}

function nameLines(axis) {
  const [whose, words] = nameOf(axis);
  const found = [whose];
  for (const word of words.split(" ")) {
    const last = found[found.length - 1];
    if (found.length > 1 && last.length + word.length < 9) found[found.length - 1] = `${last} ${word}`;
    else found.push(word.length > 9 ? `${word.slice(0, 8)}.` : word);
  }
  return axis.unit ? [...found, axis.unit] : found;
}

function showChosen() {
  const chosen = data.dangerous.map(isChosen);
  const some = brushes.size > 0;
  for (const [made, kind] of [[circles, "dot"], [lines, "line"]]) {
    made.forEach((one, i) => one?.setAttribute("class", some && !chosen[i] ? `${kind} out` : kind));
  }
  const rollouts = data.dangerous.filter((_, i) => chosen[i]);
  const share = rollouts.reduce((sum, one) => sum + one.share, 0);
  const count = `${rollouts.length} of ${data.dangerous.length} dangerous rollouts`;
  const listed = rollouts.length > LISTED ? `; the first ${LISTED} are listed` : "";
  by("chosen-said").textContent = data.dangerous.length
    ? `${some ? `Chosen: ${count}` : `All ${data.dangerous.length} dangerous rollouts shown`}, ` +
      `${percent(share)} of p${listed}.`
    : "There is no dangerous rollout yet.";
  by("chosen-f").textContent = `f, ${data.unit}`;
  by("chosen-axis").textContent = said(data.axes[chosenAxis]);
  by("chosen").tBodies[0].replaceChildren(...rollouts.slice(0, LISTED).map(rowOf));
  for (const held of document.querySelectorAll("#parallel .held")) {
    const axis = shown[Number(held.dataset.n)];
    const brush = brushes.get(axis);
    held.toggleAttribute("hidden", !brush);
    if (!brush) continue;
    const [top, bottom] = brush.map((v) => onto(v, ...endsOf(axis), PAR.bottom, PAR.top)).sort((a, b) => a - b);
    held.setAttribute("y", top);
    held.setAttribute("height", Math.max(bottom - top, 2));
  }
}

function rowOf(one) {
  const row = document.createElement("tr");
  const cell = (kind, text, label, number = false) => {
    const made = row.appendChild(document.createElement(kind));
    made.textContent = text;
    if (label) made.dataset.label = label;
    if (number) made.className = "number";
    return made;
  };
  const head = cell("th", `${one.row}`);
  head.scope = "row";
  head.className = "text";
  cell("td", short(one.f), "f", true);
  cell("td", percent(one.share), "Share of p", true);
  cell("td", short(one.values[chosenAxis]), said(data.axes[chosenAxis]), true);
  const last = cell("td", "");
  last.className = "orders";
  const link = last.appendChild(document.createElement("a"));
  link.className = "button";
  link.textContent = "Replay";
  link.href = `${page.dataset.rollouts}/${one.row}?phase=${one.phase}&iteration=${one.iteration}`;
  return row;
}

function choose(axis, low, high) {
  brushes.set(axis, [Math.min(low, high), Math.max(low, high)]);
}

// Where in the units of an SVG's view box the pointer is.
function pointIn(svg, event) {
  const box = svg.getBoundingClientRect();
  const { width, height } = svg.viewBox.baseVal;
  return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
}

function dragOver(svg, begin, moved) {
  svg.addEventListener("pointerdown", (event) => {
    const from = pointIn(svg, event);
    const what = begin(event, from);
    if (what === null) return;
    svg.setPointerCapture(event.pointerId);
    const move = (later) => moved(what, from, pointIn(svg, later));
    const end = (later) => {
      svg.removeEventListener("pointermove", move);
      const to = pointIn(svg, later);
      if (Math.hypot(to[0] - from[0], to[1] - from[1]) < 4) moved(what, from, null);
    };
    svg.addEventListener("pointermove", move);
    svg.addEventListener("pointerup", end, { once: true });
    svg.addEventListener("pointercancel", end, { once: true });
  });
}

function dragScatter(_, from, to) {
  const axis = data.axes[chosenAxis];
  const drag = by("scatter").querySelector(".drag");
  drag.toggleAttribute("hidden", to === null);
  if (to === null) {
    brushes.delete(chosenAxis);
    brushes.delete(F);
  } else {
    const [x, y] = [[from[0], to[0]].sort((a, b) => a - b), [from[1], to[1]].sort((a, b) => a - b)];
    const place = { x: x[0], y: y[0], width: x[1] - x[0], height: y[1] - y[0] };
    for (const [name, value] of Object.entries(place)) drag.setAttribute(name, value);
    choose(chosenAxis, ...x.map((at) => onto(at, BOX.left, BOX.right, axis.low, axis.high)));
    choose(F, ...y.map((at) => onto(at, BOX.bottom, BOX.top, ...fEnds())));
  }
  showChosen();
}

function dragParallel(axis, from, to) {
  if (to === null) brushes.delete(axis);
  else choose(axis, ...[from[1], to[1]].map((at) => onto(at, PAR.bottom, PAR.top, ...endsOf(axis))));
  showChosen();
}

function begin() {
  const order = data.axes.map((axis, n) => [Math.abs(axis.shift_sd ?? 0), n]).sort((a, b) => b[0] - a[0] || a[1] - b[1]);
  chosenAxis = order[0]?.[1] ?? 0;
  const most = order.slice(0, AXES).map(([, n]) => n);
  const isKnown = (n) => data.dangerous.filter((one) => isNumber(one.values[n])).length > 1;
  const drivers = data.axes.map((_, n) => n).filter((n) => data.axes[n].kind === "behaviour" && isKnown(n));
  shown = [F, ...most, ...drivers.slice(0, 2)];
  const options = data.axes.map((axis, n) => new Option(said(axis), n));
  by("scatter-axis").replaceChildren(...options);
  by("scatter-axis").value = chosenAxis;
  by("brush-axis").replaceChildren(new Option(`f, ${data.unit}`, F), ...options.map((one) => one.cloneNode(true)));
  const few = data.dangerous.length < data.events ? `, ${data.dangerous.length} of them shown` : "";
  by("parameters-said").textContent =
    `${data.axes.length} parameters of ${data.recorded.toLocaleString("en")} rollouts; ` +
    `${data.events.toLocaleString("en")} dangerous in the estimate${few}.`;
  by("parameters-state").hidden = true;
  by("parameters-shown").hidden = false;
  drawScatter();
  drawParallel();
  showChosen();
  for (const id of ["scatter-axis", "scatter-log"]) {
    by(id).addEventListener("change", () => {
      chosenAxis = Number(by("scatter-axis").value);
      drawScatter();
      showChosen();
    });
  }
  dragOver(by("scatter"), () => true, dragScatter);
  dragOver(by("parallel"), (event) => {
    const grip = event.target.closest(".grip, .held");
    return grip === null ? null : shown[Number(grip.dataset.n)];
  }, dragParallel);
  by("brush-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const picked = by("brush-axis").value;
    const end = (id, open) => (by(id).value.trim() === "" ? open : Number(by(id).value));
    const [low, high] = [end("brush-low", -Infinity), end("brush-high", Infinity)];
    if (!Number.isNaN(low) && !Number.isNaN(high)) choose(picked === F ? F : Number(picked), low, high);
    showChosen();
  });
  by("brush-clear").addEventListener("click", () => {
    brushes.clear();
    by("scatter").querySelector(".drag").toggleAttribute("hidden", true);
    showChosen();
  });
}

try {
  data = await fetched(page.dataset.scatter, (text) => (by("parameters-state").textContent = text));
  if (data.axes.length) begin();
  else by("parameters-state").textContent = "There are no rollouts yet whose parameters could be shown.";
} catch (error) {
  by("parameters-state").textContent = error.message;
}
