// Draws a state of a rollout: the road from above, drawn straight, around the ego; or as seen from behind it.

import { chase } from "./chase.js";

const EDGE_M = 2.5; // beyond the road's edges
const LEAST_PX = 120;
const ORDER = ["other", "threat", "ego"]; // the last on top

export const colours = {};

export function readColours() {
  const probe = document.body.appendChild(document.createElement("span"));
  for (const name of ["ink", "quiet", "rule", "road", "lane", "ego", "threat", "other", "ray", "card", "sunk"]) {
    probe.style.color = `var(--${name})`;
    colours[name] = getComputedStyle(probe).color;
  }
  probe.remove();
}

export function between(values, exact) {
  const low = Math.floor(exact);
  const a = values[low];
  const b = values[Math.min(low + 1, values.length - 1)];
  if (a === null || a === undefined) return null;
  return b === null || b === undefined ? a : a + (exact - low) * (b - a);
}

export function pose(track, exact) {
  const s = between(track.station_m, exact);
  const y = between(track.offset_m, exact);
  const heading = between(track.heading_rad, exact);
  return s === null || y === null ? null : { s, y, heading: heading ?? 0, speed: between(track.speed_mps, exact) };
}

function sized(canvas, data, view) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const offsets = data.road.flatMap((line) => line.offset_m).filter((v) => v !== null);
  const low = Math.min(...offsets, -4) - EDGE_M;
  const high = Math.max(...offsets, 4) + EDGE_M;
  const span = view.zoom_m * Math.min(1, Math.max(width / 900, 0.5));
  const scale = Math.min(width / span, Math.max(view.most * window.innerHeight, LEAST_PX) / (high - low));
  const height = Math.max((high - low) * scale, LEAST_PX);
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    canvas.style.height = `${height}px`;
  }
  return { ratio, width, height, scale, middle: (low + high) / 2 };
}

// A state (with the fraction between two) on a canvas. view: zoom_m along the road, rays, from ("above", "behind" or
// "hazard": the same turned to the one that f is about), and most, the share of the window's height that it may take.
export function paint(canvas, data, at, view) {
  const { ratio, width, height, scale, middle } = sized(canvas, data, view);
  const ego = data.tracks.find((track) => track.role === "ego");
  const own = pose(ego, at) ?? { s: 0, y: 0, heading: 0, speed: null };
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const known = ORDER.flatMap((role) => data.tracks.filter((track) => track.role === role))
    .map((track) => ({ track, found: pose(track, at) }))
    .filter((one) => one.found);
  if (view.from !== "above") {
    chase(pen, { width, height }, data, own, known, view.from === "hazard", colours);
    return;
  }
  const toX = (s) => width / 2 + (s - own.s) * scale;
  const toY = (y) => height / 2 - (y - middle) * scale;
  drawRoad(pen, data, toX, toY, width);
  if (view.rays) drawRays(pen, data, at, toX, toY, own, scale);
  const placed = known.map((one) => ({ ...one, x: toX(one.found.s), y: toY(one.found.y) }));
  drawAbout(pen, placed);
  for (const one of placed) drawVehicle(pen, one, scale);
  if (view.names !== false) drawLabels(pen, placed, scale);
  drawRuler(pen, width, height, scale);
}

function drawRoad(pen, data, toX, toY, width) {
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

function drawRays(pen, data, at, toX, toY, own, scale) {
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
