"""The road around the ego from above, drawn straight with stations to the right, with the time to collision's rays."""

import math
from itertools import pairwise

import cv2
import numpy as np

from service.analysis.trace import Trace
from service.analysis.video.ink import DANGER, EGO, OTHER, TAKEN_OVER, TEXT, THREAT, Colour, write
from service.world import agents as A
from service.world.sensors.lidar import beam_directions, scan
from sumo_nets.corridor import Corridor

SCALE = 11.6  # pixels a metre
EGO_SHARE = 0.42  # of the width, behind the ego
DASH_M, DASH_PERIOD_M = 4, 15  # about as California paints lane lines: 12 ft every 48 ft
DANGER_S = 1.5  # below this both are outlined in red: drivers perceive a conflict (Vogel 2003 uses 1 to 4 s)
WATCHED_S = 10.0  # rays with a longer time to collision are drawn quietly
FREE_RAY_M = 8.0  # how far a ray is drawn that hits nothing
SHIFT = 4  # fractional bits of OpenCV's coordinates

ASPHALT: Colour = (72, 70, 68)
VERGE: Colour = (82, 110, 86)
LINE: Colour = (225, 225, 225)
RAY: Colour = (120, 116, 112)


class TopDown:
    """Draws states of one trace into pictures (height, width, 3). threat: the vehicle that f is about."""

    def __init__(
        self, trace: Trace, corridor: Corridor, width: int, height: int, rays: int, threat: int | None = None
    ):
        self._trace = trace
        self._corridor = corridor
        self._width = width
        self._height = height
        self._threat = threat
        self._beams = beam_directions(rays)
        self._middle = float(np.nanmean([corridor.road_left, corridor.road_right]))  # in the picture's middle

    def draw(self, k: int) -> np.ndarray:
        """The picture of state k."""
        image = np.full((self._height, self._width, 3), VERGE, np.uint8)
        trace = self._trace
        start = float(trace.station_m[k, trace.ego]) - EGO_SHARE * self._width / SCALE
        self._road(image, start)
        if trace.agents[k, trace.ego, A.ACTIVE] != 0.0:
            self._rays(image, k, start)
        for i in range(len(trace.names)):
            self._vehicle(image, k, i, start)
        return image

    def _pixel(
        self, station_m: float | np.ndarray, offset_m: float | np.ndarray, start_m: float
    ) -> np.ndarray:
        """Image coordinates with SHIFT fractional bits."""
        x = (np.asarray(station_m) - start_m) * SCALE
        y = 0.5 * self._height - (np.asarray(offset_m) - self._middle) * SCALE
        return np.round(np.stack(np.broadcast_arrays(x, y), axis=-1) * 2**SHIFT).astype(np.int32)

    def _road(self, image: np.ndarray, start_m: float) -> None:
        corridor = self._corridor
        view = self._width / SCALE
        k = np.arange(
            max(int(start_m / corridor.ds_m) - 1, 0),
            min(int((start_m + view) / corridor.ds_m) + 2, len(corridor.station_m) - 1) + 1,
        )
        if k.size < 2:
            return
        s = corridor.station_m[k]
        left = self._pixel(s, corridor.road_left[k], start_m)
        right = self._pixel(s, corridor.road_right[k], start_m)
        cv2.fillPoly(image, [np.concatenate([left, right[::-1]])], ASPHALT, cv2.LINE_AA, SHIFT)
        for edge in (left, right):
            cv2.polylines(image, [edge], False, LINE, 1, cv2.LINE_AA, SHIFT)
        for lane, boundary in enumerate(corridor.lane_left[1:], start=1):
            for a, b in pairwise(k.tolist()):
                painted = lane == 1 or a % DASH_PERIOD_M < DASH_M  # the line beside the HOV lane is solid
                if painted and not (math.isnan(boundary[a]) or math.isnan(boundary[b])):
                    p, q = self._pixel(corridor.station_m[[a, b]], boundary[[a, b]], start_m)
                    cv2.line(image, p.tolist(), q.tolist(), LINE, 1, cv2.LINE_AA, SHIFT)

    def _heading(self, k: int, i: int) -> float:
        """A vehicle's heading relative to the road."""
        agent = self._trace.agents[k, i]
        station = int(agent[A.STATION])
        bend = agent[A.ALONG_M] * self._corridor.ref_curvature[station]
        return float(agent[A.HEADING_RAD] - self._corridor.ref_heading[station] - bend)

    def _rays(self, image: np.ndarray, k: int, start_m: float) -> None:
        """Each ray up to what it hits, the redder the sooner it would."""
        trace = self._trace
        ego = trace.agents[k, trace.ego]
        ranges, rates = np.empty(len(self._beams)), np.empty(len(self._beams))
        scan(trace.agents[k], trace.agents.shape[1], trace.ego, self._beams, math.inf, ranges, rates)
        heading = self._heading(k, trace.ego)
        turn = np.array([math.cos(heading), math.sin(heading)])
        station, offset = trace.station_m[k, trace.ego], ego[A.OFFSET_M]
        centre = self._pixel(station, offset, start_m).tolist()
        for (x, y), reach, rate in zip(self._beams, ranges, rates, strict=True):
            hit = math.isfinite(reach)
            length = reach if hit else FREE_RAY_M
            along, across = x * turn[0] - y * turn[1], x * turn[1] + y * turn[0]
            end = self._pixel(station + length * along, offset + length * across, start_m).tolist()
            ttc = reach / -rate if hit and rate < 0.0 else math.inf
            share = max(1.0 - ttc / WATCHED_S, 0.0)
            colour = tuple(round((1.0 - share) * a + share * b) for a, b in zip(RAY, DANGER, strict=True))
            cv2.line(image, centre, end, colour, 2 if share > 0.5 else 1, cv2.LINE_AA, SHIFT)
            if share > 0.5:
                cv2.circle(image, end, 4 << SHIFT, colour, -1, cv2.LINE_AA, SHIFT)

    def _vehicle(self, image: np.ndarray, k: int, i: int, start_m: float) -> None:
        trace = self._trace
        agent = trace.agents[k, i]
        if agent[A.ACTIVE] == 0.0:
            return
        heading = self._heading(k, i)
        c, s = math.cos(heading), math.sin(heading)
        half = 0.5 * agent[A.LENGTH_M], 0.5 * agent[A.WIDTH_M]
        station, offset = trace.station_m[k, i], agent[A.OFFSET_M]

        def outline(shape: list[list[float]]) -> np.ndarray:
            corners = np.array(shape) * half
            return self._pixel(
                station + corners[:, 0] * c - corners[:, 1] * s,
                offset + corners[:, 0] * s + corners[:, 1] * c,
                start_m,
            )

        about = i in (trace.ego, self._threat)
        colour = EGO if i == trace.ego else THREAT if about else TAKEN_OVER if agent[A.TAKEN_OVER] else OTHER
        body = outline([[1, 1], [1, -1], [-1, -1], [-1, 1]])
        cv2.fillPoly(image, [body], colour, cv2.LINE_AA, SHIFT)
        if about and (trace.ttc_s[k] < DANGER_S or agent[A.COLLISION]):
            cv2.polylines(image, [body], True, DANGER, 3, cv2.LINE_AA, SHIFT)
        glass = outline([[0.45, 0.8], [0.45, -0.8], [0.2, -0.8], [0.2, 0.8]])
        cv2.fillPoly(image, [glass], (40, 40, 40), cv2.LINE_AA, SHIFT)
        x, y = (body[2] / 2**SHIFT).tolist()
        write(image, f"{trace.names[i]}  {agent[A.SPEED_MPS]:.0f} m/s", (int(x), int(y) + 14), 0.4, TEXT)
