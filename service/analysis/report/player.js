// Plays the rollouts that the page holds as JSON: the road from above around the ego, the measure over time, play and scrub.
"use strict";
(function () {
  const BEHIND_M = 24, AHEAD_M = 32, BEFORE_S = 4;

  function ink(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }

  function nearest(values, at) {
    let low = 0, high = values.length - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (values[middle] <= at) low = middle; else high = middle; }
    return low;
  }

  function prepared(canvas, height) {
    const scale = window.devicePixelRatio || 1, width = canvas.clientWidth;
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    const g = canvas.getContext("2d");
    g.setTransform(scale, 0, 0, scale, 0, 0);
    g.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    return [g, width, height];
  }

  function drawRoad(canvas, d, k) {
    const ego = d.tracks.find(t => t.role === "ego");
    const offsets = d.road.flatMap(l => l.offset_m).filter(v => v !== null);
    const left = Math.max(...offsets) + 1.5, right = Math.min(...offsets) - 1.5;
    const narrow = canvas.clientWidth < 480;
    const behind = narrow ? 16 : BEHIND_M, ahead = narrow ? 20 : AHEAD_M;
    const unit = canvas.clientWidth / (behind + ahead);
    const [g, width, height] = prepared(canvas, Math.max((left - right) * unit, 90));
    const start = ego.station_m[k] - behind;
    const x = s => (s - start) * unit, y = o => (left - o) * unit;
    g.fillStyle = ink("--road");
    g.fillRect(0, 0, width, height);
    for (const line of d.road) {
      g.strokeStyle = ink(line.kind === "edge" ? "--road-edge" : "--road-lane");
      g.lineWidth = line.kind === "edge" ? 2 : 1;
      g.setLineDash(line.kind === "edge" ? [] : [3.6 * unit, 11 * unit]);
      g.lineDashOffset = x(0) * -1;
      g.beginPath();
      let drawing = false;
      const first = nearest(d.road_station_m, start - 10);
      for (let i = first; i < d.road_station_m.length && d.road_station_m[i] < start + behind + ahead + 15; i++) {
        const o = line.offset_m[i];
        if (o === null) { drawing = false; continue; }
        if (drawing) g.lineTo(x(d.road_station_m[i]), y(o)); else g.moveTo(x(d.road_station_m[i]), y(o));
        drawing = true;
      }
      g.stroke();
    }
    g.setLineDash([]);
    const about = d.tracks.find(t => t.role === "threat");
    if (about && about.station_m[k] !== null && ego.station_m[k] !== null) {
      g.strokeStyle = ink("--threat");
      g.setLineDash([4, 3]);
      g.beginPath(); g.moveTo(x(ego.station_m[k]), y(ego.offset_m[k])); g.lineTo(x(about.station_m[k]), y(about.offset_m[k])); g.stroke();
      g.setLineDash([]);
    }
    const order = d.tracks.slice().sort((a, b) => (a.role === "ego") - (b.role === "ego"));
    for (const t of order) {
      if (t.station_m[k] === null) continue;
      g.save();
      g.translate(x(t.station_m[k]), y(t.offset_m[k]));
      g.rotate(-t.heading_rad[k]);
      g.fillStyle = ink("--" + t.role);
      g.strokeStyle = ink("--outline");
      g.lineWidth = 1;
      const l = t.length_m * unit, w = t.width_m * unit;
      g.fillRect(-l / 2, -w / 2, l, w);
      g.strokeRect(-l / 2, -w / 2, l, w);
      g.fillStyle = ink("--glass");
      g.fillRect(l * 0.08, -w * 0.4, l * 0.14, w * 0.8);
      g.restore();
      if (x(t.station_m[k]) > -20 && x(t.station_m[k]) < width + 20) {
        g.fillStyle = ink("--road-text");
        g.textAlign = "center";
        const name = t.name.length > 12 ? t.name.slice(0, 11) + "…" : t.name;
        const tall = y(t.offset_m[k]) + w / 2 + 11;
        g.fillText(name + "  " + t.speed_mps[k].toFixed(0) + " m/s", x(t.station_m[k]), Math.min(tall, height - 3));
      }
    }
  }

  function drawMeasure(canvas, d, k) {
    const [g, width, height] = prepared(canvas, 96);
    const box = { left: 46, right: width - 10, top: 14, bottom: height - 18 };
    const finite = d.measured.filter(v => v !== null);
    if (!finite.length) return;
    const seconds = d.unit === "s";
    const low = Math.min(seconds ? 0 : Infinity, ...finite, d.gamma);
    const high = seconds ? Math.max(4, 3 * d.gamma) : Math.max(...finite, d.gamma) + 1e-9;
    const end = d.time_s[d.time_s.length - 1], begin = d.time_s[0];
    const x = t => box.left + (box.right - box.left) * (t - begin) / Math.max(end - begin, 1e-9);
    const y = v => box.bottom - (box.bottom - box.top) * (Math.min(Math.max(v, low), high) - low) / (high - low);
    g.strokeStyle = ink("--rule");
    g.strokeRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
    g.strokeStyle = ink("--danger");
    g.setLineDash([5, 4]);
    g.beginPath(); g.moveTo(box.left, y(d.gamma)); g.lineTo(box.right, y(d.gamma)); g.stroke();
    g.setLineDash([]);
    g.strokeStyle = ink("--ink");
    g.lineWidth = 1.5;
    g.beginPath();
    let drawing = false;
    d.measured.forEach((v, i) => {
      if (v === null) { drawing = false; return; }
      if (drawing) g.lineTo(x(d.time_s[i]), y(v)); else g.moveTo(x(d.time_s[i]), y(v));
      drawing = true;
    });
    g.stroke();
    g.strokeStyle = g.fillStyle = ink("--danger");
    g.lineWidth = 1;
    g.beginPath(); g.moveTo(x(d.time_s[k]), box.top); g.lineTo(x(d.time_s[k]), box.bottom); g.stroke();
    if (d.measured[k] !== null) { g.beginPath(); g.arc(x(d.time_s[k]), y(d.measured[k]), 3.5, 0, 7); g.fill(); }
    g.fillStyle = ink("--quiet");
    g.textAlign = "right";
    g.fillText(high.toFixed(seconds ? 0 : 1) + (seconds ? "+" : ""), box.left - 5, box.top + 8);
    g.fillText(low.toFixed(seconds ? 0 : 1), box.left - 5, box.bottom);
    g.fillText("γ " + d.gamma, box.left - 5, Math.min(Math.max(y(d.gamma) + 4, box.top + 20), box.bottom - 12));
    g.textAlign = "left";
    g.fillText(d.measure + (d.unit ? ", " + d.unit : ""), box.left, 10);
    g.fillText(begin.toFixed(1) + " s", box.left, height - 5);
    g.textAlign = "right";
    g.fillText(end.toFixed(1) + " s", box.right, height - 5);
  }

  function part(tag, attributes, parent) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    parent.append(made);
    return made;
  }

  function player(holder) {
    const d = JSON.parse(document.getElementById(holder.dataset.rollout).textContent);
    const last = d.time_s.length - 1, step = last > 0 ? (d.time_s[last] - d.time_s[0]) / last : 0.1;
    const label = holder.dataset.label;
    const road = part("canvas", { class: "road", role: "img", "aria-label": "The road from above around the ego: " + label }, holder);
    const curve = part("canvas", { class: "curve", role: "img", "aria-label": d.measure + " over time: " + label }, holder);
    const bar = part("div", { class: "bar" }, holder);
    const play = part("button", { type: "button" }, bar);
    const scrub = part("input", { type: "range", min: 0, max: last, step: 1, "aria-label": "Time of the replay of " + label }, bar);
    const speed = part("select", { "aria-label": "Speed of the replay" }, bar);
    for (const [value, text] of [[1, "1 ×"], [0.5, "½ ×"], [0.25, "¼ ×"]]) part("option", { value }, speed).textContent = text;
    const told = part("output", {}, bar);
    let k = d.worst, running = false, from = 0, at = 0;

    function show() {
      drawRoad(road, d, k);
      drawMeasure(curve, d, k);
      scrub.value = k;
      const value = d.measured[k], a = d.acceleration_mps2[k];
      const said = d.time_s[k].toFixed(1) + " s, " + d.measure + " " + (value === null ? "none" : value.toFixed(2) + " " + d.unit);
      const hit = k === last && d.contact ? ", " + d.contact : "";
      told.textContent = said + hit + (a === null ? "" : ", ego " + (a > 0 ? "+" : "") + a.toFixed(1) + " m/s²");
      scrub.setAttribute("aria-valuetext", said);
    }
    function stop() { running = false; play.textContent = "Play"; }
    function tick(now) {
      if (!running) return;
      // a frame may carry a time before the click that asked for it
      k = Math.min(at + Math.floor(Math.max(now - from, 0) / 1000 * speed.value / step), last);
      show();
      if (k === last) stop(); else requestAnimationFrame(tick);
    }
    function begin() {
      if (k >= Math.min(d.worst, last)) k = Math.max(d.worst - Math.round(BEFORE_S / step), 0);
      running = true; at = k; from = performance.now(); play.textContent = "Pause";
      requestAnimationFrame(tick);
    }
    play.addEventListener("click", () => running ? stop() : begin());
    scrub.addEventListener("input", () => { stop(); k = Number(scrub.value); show(); });
    speed.addEventListener("change", () => { at = k; from = performance.now(); });
    window.addEventListener("resize", show);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
    stop();
    show();
  }

  document.querySelectorAll("[data-rollout]").forEach(player);
})();
