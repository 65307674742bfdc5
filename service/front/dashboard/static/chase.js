// A rollout as seen from behind the ego: boxes on the road in perspective, drawn on a plain canvas.

const BEHIND_M = 9;
const UP_M = 4.5;
const DOWN_RAD = 0.2; // that the camera looks down
const NEAR_M = 1;
const FAR_M = 150;
const CAR_M = 1.5; // height of a vehicle, of which the road knows only length and width
const FIELD = 0.95; // focal length, of the picture's width

// known: vehicles with where they are; hazard: turn to the one that f is about
export function chase(pen, { width, height }, data, own, known, hazard, colours) {
  const about = known.find((one) => one.track.role === "threat")?.found;
  const turned = hazard && about ? Math.atan2(about.y - own.y, about.s - own.s) : own.heading;
  const camera = cameraAt(own, turned, width, height);
  pen.fillStyle = colours.sunk;
  pen.fillRect(0, 0, width, height);
  drawGround(pen, data, own, camera, colours);
  const far = ({ found }) => -camera.depth(found.s, found.y, 0);
  for (const one of [...known].sort((a, b) => far(a) - far(b))) drawBox(pen, one, camera, colours);
}

// Projects (station, offset, height) in metres onto the picture; null behind the camera.
function cameraAt(own, turned, width, height) {
  const [cos, sin] = [Math.cos(turned), Math.sin(turned)];
  const from = { s: own.s - BEHIND_M * cos, y: own.y - BEHIND_M * sin };
  const [down, level] = [Math.sin(DOWN_RAD), Math.cos(DOWN_RAD)];
  const seen = (s, y, z) => {
    const [ds, dy, dz] = [s - from.s, y - from.y, z - UP_M];
    const along = ds * cos + dy * sin;
    return { ahead: along * level - dz * down, left: -ds * sin + dy * cos, up: along * down + dz * level };
  };
  const focal = FIELD * width;
  const project = (s, y, z) => {
    const { ahead, left, up } = seen(s, y, z);
    if (ahead < NEAR_M) return null;
    return [width / 2 - (focal * left) / ahead, height * 0.42 - (focal * up) / ahead];
  };
  return { project, depth: (s, y, z) => seen(s, y, z).ahead };
}

function drawGround(pen, data, own, camera, colours) {
  const stations = data.road_station_m;
  const line = (offsets) =>
    stations
      .map((s, i) => [s, offsets[i]])
      .filter(([s, y]) => y !== null && s > own.s - BEHIND_M - 10 && s < own.s + FAR_M);
  const edges = data.road.filter((one) => one.kind === "edge").map((one) => line(one.offset_m));
  if (edges.length >= 2) {
    const around = [...edges[0], ...edges[edges.length - 1].reverse()].map(([s, y]) => camera.project(s, y, 0));
    fill(pen, around.filter(Boolean), colours.road);
  }
  for (const one of data.road) {
    pen.strokeStyle = one.kind === "edge" ? colours.quiet : colours.lane;
    pen.lineWidth = 1.5;
    pen.setLineDash(one.kind === "edge" ? [] : [10, 12]);
    pen.beginPath();
    let begun = false;
    for (const [s, y] of line(one.offset_m)) {
      const place = camera.project(s, y, 0);
      if (place && begun) pen.lineTo(...place);
      else if (place) pen.moveTo(...place);
      begun ||= place !== null;
    }
    pen.stroke();
  }
  pen.setLineDash([]);
}

function drawBox(pen, { track, found }, camera, colours) {
  const [cos, sin] = [Math.cos(found.heading), Math.sin(found.heading)];
  const corner = (along, across, z) => {
    const [a, b] = [along * track.length_m, across * track.width_m];
    return [found.s + a * cos - b * sin, found.y + a * sin + b * cos, z];
  };
  const low = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(([a, b]) => corner(a, b, 0));
  const high = low.map(([s, y]) => [s, y, CAR_M]);
  const sides = [0, 1, 2, 3].map((i) => [low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]]);
  const middle = (face) => face.reduce((sum, p) => sum + camera.depth(...p), 0) / face.length;
  for (const face of [...sides.sort((a, b) => middle(b) - middle(a)), high]) {
    const places = face.map((p) => camera.project(...p));
    if (places.some((p) => p === null)) continue;
    fill(pen, places, colours[track.role], colours.card);
  }
  const name = camera.project(found.s, found.y, CAR_M + 0.8);
  if (!name) return;
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.fillStyle = colours.ink;
  pen.fillText(track.name, ...name);
}

function fill(pen, places, colour, edge = null) {
  if (!places.length) return;
  pen.fillStyle = colour;
  pen.beginPath();
  places.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.closePath();
  pen.fill();
  if (!edge) return;
  pen.strokeStyle = edge;
  pen.lineWidth = 1;
  pen.stroke();
}
