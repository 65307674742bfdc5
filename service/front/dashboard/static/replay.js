// Plays a rollout: the road from above, drawn straight, with the vehicles on it, around the ego.

import { crossAt, seekFrom } from "./charts.js";
import { fetched } from "./fetched.js";
import { between, paint, readColours } from "./road.js";

const player = document.getElementById("player");
const by = (id) => document.getElementById(id);
const canvas = by("road");
const MOST_SHARE = 0.5; // of the window's height

let data = null;
let at = 0; // state, with the fraction between two
let playing = false;
let before = 0;
let pictures = [];
let second = null; // the rollout beside it, in step

function draw() {
  if (!data) return;
  const view = { zoom_m: Number(by("zoom").value), rays: by("rays").checked, from: by("from").value };
  view.most = second ? MOST_SHARE / 2 : MOST_SHARE;
  paint(canvas, data, at, view);
  if (second) paint(by("road-beside"), second, Math.min(at, second.time_s.length - 1), view);
}

// Whether two rollouts begin alike, vehicle by vehicle: the same draw.
function alike(one, other) {
  const places = (rollout) =>
    rollout.tracks.map((track) => `${track.name} ${track.station_m[0]} ${track.offset_m[0]}`).join();
  return places(one) === places(other);
}

async function bringSecond() {
  const box = by("beside");
  if (!box.dataset.playback) return;
  const state = by("beside-state");
  try {
    const found = await fetched(box.dataset.playback, (text) => (state.textContent = text));
    if (!found?.time_s.length) throw new Error("It cannot be replayed.");
    second = found;
    by("time").max = Math.max(data.time_s.length, second.time_s.length) - 1;
    by("beside-stage").hidden = false;
    state.textContent = alike(data, second)
      ? "Both begin alike: the same draw."
      : "These two do not begin alike: they are different draws.";
    show();
  } catch (error) {
    state.textContent = error.message;
  }
}

const lastState = () => Number(by("time").max);

function said(value, digits, unit) {
  return value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit}`;
}

function show() {
  by("time").value = Math.round(at);
  by("now").textContent = words(data, Math.round(at));
  if (second) by("now-beside").textContent = words(second, Math.round(at));
  const time_s = between(data.time_s, Math.min(at, data.time_s.length - 1));
  by("time").setAttribute("aria-valuetext", `${time_s.toFixed(1)} seconds`);
  for (const svg of document.querySelectorAll("#over-time svg[data-chart]")) crossAt(svg, time_s);
  const near = pictures.reduce((best, one) => (Math.abs(one.state - at) < Math.abs(best.state - at) ? one : best), pictures[0]);
  if (near && by("camera").dataset.state !== String(near.state)) {
    by("camera").dataset.state = near.state;
    by("camera").src = `data:image/jpeg;base64,${near.jpeg}`;
    by("camera-state").textContent = `At ${near.time_s.toFixed(1)} s; ${pictures.length} pictures over the rollout.`;
  }
  draw();
}

// The values of a moment.
function words(data, at) {
  const state = Math.min(at, data.time_s.length - 1);
  const ego = data.tracks.find((track) => track.role === "ego");
  const about = data.tracks.find((track) => track.role === "threat");
  const measure = { ttc: "time to collision", "ttc-impact": "time to contact" }[data.measure] ?? data.measure;
  const [above, below] = data.unit.split(", below 0 ");
  const unit = ` ${(data.measured[state] !== null && data.measured[state] <= 0 && below) || above}`.trimEnd();
  return [
    `t = ${data.time_s[state].toFixed(1)} s`,
    `${measure} ${said(data.measured[state], 2, unit)}`,
    `ego ${said(ego.speed_mps[state], 1, " m/s")}`,
    `acceleration ${said(data.acceleration_mps2[state], 2, " m/s²")}`,
    ...(about ? [`f is about ${about.name}`] : []),
    ...(data.contact && state === data.time_s.length - 1 ? [data.contact] : []),
  ].join("  ·  ");
}

function setPlaying(now) {
  playing = now;
  by("play").textContent = now ? "Pause" : "Play";
  by("play").setAttribute("aria-pressed", String(now));
  if (!now) return;
  if (at >= lastState()) at = 0;
  before = performance.now();
  requestAnimationFrame(step);
}

function step(now) {
  if (!playing) return;
  const last = lastState();
  const own = data.time_s.length - 1;
  const perState = own > 0 ? (data.time_s[own] - data.time_s[0]) / own : 0.1;
  const passed = Math.max(now - before, 0); // a frame may carry a time before the click that asked for it
  at = Math.min(at + (passed / 1000) * (Number(by("speed").value) / perState), last);
  before = now;
  show();
  if (at >= last) setPlaying(false);
  else requestAnimationFrame(step);
}

function seek(state) {
  setPlaying(false);
  at = Math.min(Math.max(state, 0), lastState());
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
  for (const id of ["zoom", "rays", "from"]) by(id).addEventListener("change", draw);
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
  const recolour = () => {
    readColours();
    draw();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  document.addEventListener("theme", recolour);
  seek(data.worst);
  void bringSecond();
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
