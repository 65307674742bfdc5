// A small film of each failure mode: its example, played when somebody asks for it.

import { fetched } from "./fetched.js";
import { paint, readColours } from "./road.js";

const VIEW = { zoom_m: 60, rays: false, from: "above", most: 0.22, names: false };
const PAUSE = 10; // states, at its end
const still = matchMedia("(prefers-reduced-motion: reduce)");

async function play(button) {
  const box = button.closest("[data-film]");
  const [canvas, state] = [box.querySelector("canvas"), box.querySelector(".film-state")];
  button.disabled = true;
  let data;
  try {
    data = await fetched(box.dataset.film, (text) => (state.textContent = text));
    if (!data?.time_s.length) throw new Error("It cannot be replayed.");
  } catch (error) {
    state.textContent = error.message;
    button.disabled = false;
    return;
  }
  state.textContent = "";
  button.hidden = true;
  canvas.hidden = false;
  readColours();
  const last = data.time_s.length - 1;
  const perState = last > 0 ? (data.time_s[last] - data.time_s[0]) / last : 0.1;
  if (still.matches) {
    paint(canvas, data, data.worst, VIEW);
    return;
  }
  const began = performance.now();
  const step = (now) => {
    if (!canvas.isConnected) return;
    const at = (Math.max(now - began, 0) / 1000 / perState) % (last + PAUSE);
    paint(canvas, data, Math.min(at, last), VIEW);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

document.addEventListener("click", (event) => {
  const button = event.target.closest?.("[data-film] button");
  if (button) void play(button);
});
