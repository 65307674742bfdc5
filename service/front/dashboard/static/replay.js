// Plays a rollout: the road from above, drawn straight, with the vehicles on it, around the ego.

import { crossAt, seekFrom } from "./charts.js";
import { fetched } from "./fetched.js";

const player = document.getElementById("player");
const by = (id) => document.getElementById(id);
const canvas = by("road");
const EDGE_M = 2.5; // beyond the road's edges
const LEAST_PX = 120;
const MOST_SHARE = 0.5; // of the window's height
const ORDER = ["other", "threat", "ego"]; // the last on top

let data = null;
let at = 0; // state, with the fraction between two
let playing = false;
let before = 0;
let pictures = [];
let colours = {};

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["ink", "quiet", "rule", "road", "lane", "ego", "threat", "other", "ray", "card"]) {
    colours[name] = style.getPropertyValue(`--${name}`).trim();
  }
}

function between(values, exact) {
  const low = Math.floor(exact);
  const a = values[low];
  const b = values[Math.min(low + 1, values.length - 1)];
  if (a === null || a === undefined) return null;
  return b === null || b === undefined ? a : a + (exact - low) * (b - a);
}

function pose(track, exact) {
  const s = between(track.station_m, exact);
  const y = between(track.offset_m, exact);
  const heading = between(track.heading_rad, exact);
  return s === null || y === null ? null : { s, y, heading: heading ?? 0, speed: between(track.speed_mps, exact) };
}

function sized() {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const offsets = data.road.flatMap((line) => line.offset_m).filter((v) => v !== null);
  const low = Math.min(...offsets, -4) - EDGE_M;
  const high = Math.max(...offsets, 4) + EDGE_M;
  const span = Number(by("zoom").value) * Math.min(1, Math.max(width / 900, 0.5));
  const scale = Math.min(width / span, Math.max(MOST_SHARE * window.innerHeight, LEAST_PX) / (high - low));
  const height = Math.max((high - low) * scale, LEAST_PX);
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    canvas.style.height = `${height}px`;
  }
  return { ratio, width, height, scale, middle: (low + high) / 2 };
}

function draw() {
  if (!data) return;
  const { ratio, width, height, scale, middle } = sized();
  const ego = data.tracks.find((track) => track.role === "ego");
  const own = pose(ego, at) ?? { s: 0, y: 0, heading: 0, speed: null };
  const toX = (s) => width / 2 + (s - own.s) * scale;
  const toY = (y) => height / 2 - (y - middle) * scale;
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  drawRoad(pen, toX, toY, width);
  if (by("rays").checked) drawRays(pen, toX, toY, own, scale);
  const placed = ORDER.flatMap((role) => data.tracks.filter((track) => track.role === role))
    .map((track) => ({ track, found: pose(track, at) }))
    .filter((one) => one.found)
    .map((one) => ({ ...one, x: toX(one.found.s), y: toY(one.found.y) }));
  drawAbout(pen, placed);
  for (const one of placed) drawVehicle(pen, one, scale);
  drawLabels(pen, placed, scale);
  drawRuler(pen, width, height, scale);
}

function drawRoad(pen, toX, toY, width) {
  const edges = data.road.filter((line) => line.kind === "edge");
  const stations = data.road_station_m;
  const points = (line) =>
    stations.map((s, i) => [toX(s), line.offset_m[i]]).filter(([x, y]) => y !== null && x > -width && x < 2 * width);
  if (edges.length >= 2) {
    const first = points(edges[0]);
    const last = points(edges[edges.length - 1]).reverse();
    pen.fillStyle = colours.road;
    pen.beginPath();
    [...first, ...last].forEach(([x, y], i) => (i ? pen.lineTo(x, toY(y)) : pen.moveTo(x, toY(y))));
    pen.fill();
  }
  for (const line of data.road) {
    pen.strokeStyle = line.kind === "edge" ? colours.quiet : colours.lane;
    pen.lineWidth = line.kind === "edge" ? 2 : 1.5;
    pen.setLineDash(line.kind === "edge" ? [] : [14, 18]);
    const shown = points(line);
    if (line.kind !== "edge" && shown.length) pen.lineDashOffset = -shown[0][0] % 32;
    pen.beginPath();
    shown.forEach(([x, y], i) => (i ? pen.lineTo(x, toY(y)) : pen.moveTo(x, toY(y))));
    pen.stroke();
  }
  pen.setLineDash([]);
}

function drawRays(pen, toX, toY, own, scale) {
  const reach = data.ray_m[Math.round(at)];
  if (!reach) return;
  pen.strokeStyle = colours.ray;
  pen.fillStyle = colours.ray;
  pen.lineWidth = 1;
  reach.forEach((far, i) => {
    if (far === null || far === undefined) return;
    const angle = own.heading + data.ray_rad[i];
    const x = toX(own.s) + far * scale * Math.cos(angle);
    const y = toY(own.y) - far * scale * Math.sin(angle);
    pen.beginPath();
    pen.moveTo(toX(own.s), toY(own.y));
    pen.lineTo(x, y);
    pen.stroke();
    pen.beginPath();
    pen.arc(x, y, 2, 0, 7);
    pen.fill();
  });
}

// A line from the ego to the one that f is about, with the measure of the moment.
function drawAbout(pen, placed) {
  const ego = placed.find((one) => one.track.role === "ego");
  const about = placed.find((one) => one.track.role === "threat");
  if (!ego || !about) return;
  pen.strokeStyle = colours.threat;
  pen.lineWidth = 1.5;
  pen.setLineDash([5, 4]);
  pen.beginPath();
  pen.moveTo(ego.x, ego.y);
  pen.lineTo(about.x, about.y);
  pen.stroke();
  pen.setLineDash([]);
}

// Names as the text has them, the ego's and that of the one that f is about first; those that would cover one are left out.
function drawLabels(pen, placed, scale) {
  const taken = [];
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "center";
  for (const { track, found, x, y } of [...placed].reverse()) {
    const main = track.role !== "other";
    const text = main && found.speed !== null ? `${track.name} ${found.speed.toFixed(1)} m/s` : track.name;
    const half = pen.measureText(text).width / 2 + 2;
    const half_m = (track.width_m * scale) / 2;
    const line = track.role === "threat" ? y + half_m + 14 : y - half_m - 5; // apart from the ego's where they touch
    const box = [x - half, line - 12, x + half, line + 3];
    if (taken.some((b) => box[0] < b[2] && b[0] < box[2] && box[1] < b[3] && b[1] < box[3])) continue;
    taken.push(box);
    pen.fillStyle = main ? colours[track.role] : colours.ink;
    pen.fillText(text, x, line);
  }
}

function drawVehicle(pen, { x, y, found, track }, scale) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(-found.heading);
  const length = track.length_m * scale;
  const width = track.width_m * scale;
  pen.fillStyle = colours[track.role];
  pen.strokeStyle = colours.card;
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.roundRect(-length / 2, -width / 2, length, width, Math.min(width / 4, 4));
  pen.fill();
  pen.stroke();
  pen.fillStyle = colours.card;
  pen.globalAlpha = 0.75;
  pen.fillRect(length * 0.12, -width * 0.36, length * 0.16, width * 0.72); // windscreen: which way it looks
  pen.restore();
}

function drawRuler(pen, width, height, scale) {
  pen.strokeStyle = colours.ink;
  pen.fillStyle = colours.ink;
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(12, height - 10);
  pen.lineTo(12 + 10 * scale, height - 10);
  pen.stroke();
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "left";
  pen.fillText("10 m", 12, height - 15);
}

function said(value, digits, unit) {
  return value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit}`;
}

function show() {
  const state = Math.min(Math.round(at), data.time_s.length - 1);
  by("time").value = state;
  by("time").setAttribute("aria-valuetext", `${data.time_s[state].toFixed(1)} seconds`);
  const ego = data.tracks.find((track) => track.role === "ego");
  const about = data.tracks.find((track) => track.role === "threat");
  const measure = { ttc: "time to collision", "ttc-impact": "time to contact" }[data.measure] ?? data.measure;
  const [above, below] = data.unit.split(", below 0 ");
  const unit = ` ${(data.measured[state] !== null && data.measured[state] <= 0 && below) || above}`.trimEnd();
  by("now").textContent = [
    `t = ${data.time_s[state].toFixed(1)} s`,
    `${measure} ${said(data.measured[state], 2, unit)}`,
    `ego ${said(ego.speed_mps[state], 1, " m/s")}`,
    `acceleration ${said(data.acceleration_mps2[state], 2, " m/s²")}`,
    ...(about ? [`f is about ${about.name}`] : []),
    ...(data.contact && state === data.time_s.length - 1 ? [data.contact] : []),
  ].join("  ·  ");
  for (const svg of document.querySelectorAll("#over-time svg[data-chart]")) crossAt(svg, between(data.time_s, at));
  const near = pictures.reduce((best, one) => (Math.abs(one.state - at) < Math.abs(best.state - at) ? one : best), pictures[0]);
  if (near && by("camera").dataset.state !== String(near.state)) {
    by("camera").dataset.state = near.state;
    by("camera").src = `data:image/jpeg;base64,${near.jpeg}`;
    by("camera-state").textContent = `At ${near.time_s.toFixed(1)} s; ${pictures.length} pictures over the rollout.`;
  }
  draw();
}

function setPlaying(now) {
  playing = now;
  by("play").textContent = now ? "Pause" : "Play";
  by("play").setAttribute("aria-pressed", String(now));
  if (!now) return;
  if (at >= data.time_s.length - 1) at = 0;
  before = performance.now();
  requestAnimationFrame(step);
}

function step(now) {
  if (!playing) return;
  const last = data.time_s.length - 1;
  const perState = last > 0 ? (data.time_s[last] - data.time_s[0]) / last : 0.1;
  const passed = Math.max(now - before, 0); // a frame may carry a time before the click that asked for it
  at = Math.min(at + (passed / 1000) * (Number(by("speed").value) / perState), last);
  before = now;
  show();
  if (at >= last) setPlaying(false);
  else requestAnimationFrame(step);
}

function seek(state) {
  setPlaying(false);
  at = Math.min(Math.max(state, 0), data.time_s.length - 1);
  show();
}

function toTime(time_s) {
  const later = data.time_s.findIndex((t) => t >= time_s);
  seek(later < 0 ? data.time_s.length - 1 : later);
}

function begin() {
  readColours();
  by("time").max = data.time_s.length - 1;
  by("stage").hidden = false;
  by("player-state").hidden = true;
  const others = data.tracks.map((track) => track.name).join(", ");
  canvas.setAttribute("aria-label", `The road from above with ${others}; the values of the moment stand below it.`);
  by("play").addEventListener("click", () => setPlaying(!playing));
  by("worst").addEventListener("click", () => seek(data.worst));
  by("time").addEventListener("input", () => seek(Number(by("time").value)));
  for (const id of ["zoom", "rays"]) by(id).addEventListener("change", draw);
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("select, input, button, textarea, summary, svg") && event.key !== " ") return;
    const typed = "button, select, textarea, summary, input:not([type=range])"; // where space has its own meaning
    if (event.key === " " && !event.target.matches(typed)) setPlaying(!playing);
    else if (!player.contains(event.target)) return;
    else if (event.key === "ArrowLeft") seek(Math.round(at) - 1);
    else if (event.key === "ArrowRight") seek(Math.round(at) + 1);
    else return;
    event.preventDefault();
  });
  document.addEventListener("click", (event) => {
    const time_s = seekFrom(event, "#over-time");
    if (time_s !== null) toTime(time_s);
  });
  document.addEventListener("shown", show); // the charts have come
  new ResizeObserver(draw).observe(canvas.parentElement);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    readColours();
    draw();
  });
  seek(data.worst);
}

by("camera-load").addEventListener("click", async () => {
  const state = by("camera-state");
  state.textContent = "The pictures are being drawn …";
  try {
    pictures = (await fetched(player.dataset.camera, (text) => (state.textContent = text))) ?? [];
    if (!pictures.length) state.textContent = "There are no pictures of this rollout.";
    by("camera").hidden = !pictures.length;
    if (data) show();
  } catch (error) {
    state.textContent = error.message;
  }
});

player.tabIndex = 0;
try {
  data = await fetched(player.dataset.playback, (text) => (by("player-state").textContent = text));
  if (data?.time_s.length) begin();
  else by("player-state").textContent = "This rollout cannot be replayed: it did not run again; see below.";
} catch (error) {
  by("player-state").textContent = error.message;
}
