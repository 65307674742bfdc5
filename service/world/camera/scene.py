"""The scene round a road: built once from its network, sorted into cells, of which a picture needs a few."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from service.world.camera import carriageway, roadside
from service.world.camera.ground import ASPHALT, DIRT, GRASS, LAYERS, SEA, WATER, Ground, GroundBuilder
from service.world.camera.quads import Builder, Faces
from sumo_nets.corridor import Corridor
from sumo_nets.lanes import LaneShape, lane_shapes

CELL_M = 40.0
FREEWAY_MPS = 20.0  # roads at least this fast get barriers, gantries and a second carriageway


class Stage(NamedTuple):
    """The scene as the kernels want it (columns: service.world.camera.columns), by cell; strips by layer first."""

    cells: np.ndarray  # (c, 4) x, y, z of a sphere round a cell's content, and its radius
    strip_start: np.ndarray  # (2 LAYERS, c + 1)
    strips: np.ndarray  # (n, STRIP)
    line_start: np.ndarray  # (c + 1,); within a cell the boldest first
    lines: np.ndarray  # (m, LINE)
    face_start: np.ndarray  # (c + 1,); within a cell the thickest first
    faces: np.ndarray  # (k, FACE)
    country: np.ndarray  # (3,) reflectance of the open country


@dataclass(frozen=True, eq=False)
class Scene:
    """What stands still: flat ground, solid faces, and the street lamps' lights (n, 3)."""

    name: str
    ground: Ground
    faces: Faces
    lamps: np.ndarray
    stage: Stage


def build_scene(corridor: Corridor) -> Scene:
    """The scene of a road; the same corridor gives the same scene. NetworkError where its network cannot be read."""
    return _built(_Key(corridor))


class _Key:
    """A corridor as a key: two with the same network and edges are the same road."""

    def __init__(self, corridor: Corridor):
        self.corridor = corridor

    def _identity(self) -> tuple:
        return (self.corridor.net_path, self.corridor.edges)

    def __hash__(self) -> int:
        return hash(self._identity())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._identity() == other._identity()


@lru_cache(maxsize=4)
def _built(key: _Key) -> Scene:
    corridor = key.corridor
    lanes = lane_shapes(corridor.net_path)
    own = set(corridor.edges)
    others = [lane for lane in lanes if lane.edge not in own and not _within(corridor, lane)]
    hov = _hov_lanes(corridor, [lane for lane in lanes if lane.edge in own])
    fast = max((lane.speed_mps for lane in lanes if lane.edge in own), default=0.0) >= FREEWAY_MPS
    ground, solid = GroundBuilder(), Builder()
    carriageway.pave(corridor, hov, ground)
    for lane in others:
        carriageway.pave_lane(lane, ground)
    free = _free(corridor, others)
    coast = corridor.name == "i80"
    lights = _freeway(corridor, free, coast, ground, solid) if fast else _street(corridor, free, solid)
    flat, faces = Ground.of(ground), solid.faces()
    country = np.array((DIRT if coast else GRASS).albedo)
    return Scene(corridor.name, flat, faces, lights, _stage(flat, faces, country))


def _within(corridor: Corridor, lane: LaneShape) -> bool:
    """Whether a lane lies on the corridor's own surface (connections inside its junctions)."""
    station, offset = corridor.project(*lane.points.T)
    left, right = carriageway.edge_offsets(corridor, station)
    inside = (station >= -1.0) & (station <= corridor.length_m + 1.0)
    return bool((inside & (offset < left + 0.3) & (offset > right - 0.3)).all())


def _hov_lanes(corridor: Corridor, lanes: list[LaneShape]) -> set[int]:
    hov = {(lane.edge, lane.index) for lane in lanes if lane.hov}
    middle = len(corridor.station_m) // 2
    found = set()
    for column in range(corridor.lane_count):
        edge, index = corridor.edge_index[column, middle], corridor.sumo_lane[column, middle]
        if edge >= 0 and (corridor.edges[edge], int(index)) in hov:
            found.add(column)
    return found


def _free(corridor: Corridor, others: list[LaneShape]) -> roadside.Free:
    """A test whether points lie clear of every lane by a margin."""
    samples, widths = [], []
    for lane in others:
        for a, c in zip(lane.points[:-1], lane.points[1:], strict=True):
            steps = np.linspace(0.0, 1.0, max(2, int(np.hypot(*(c - a))) + 1))[:, None]
            samples.append(a + steps * (c - a))
            widths.append(np.full(len(steps), 0.5 * lane.width_m))
    tree = cKDTree(np.concatenate(samples)) if samples else None
    half = np.concatenate(widths) if samples else np.empty(0)

    def free(where: np.ndarray) -> np.ndarray:
        where = np.asarray(where, dtype=np.float64)
        station, offset = corridor.project(*where.T)
        left, right = carriageway.edge_offsets(corridor, station)
        clear = (offset > left + 0.4) | (offset < right - 0.4)
        if tree is not None:
            distance, nearest = tree.query(where)
            clear &= distance > half[nearest] + 0.6
        return clear

    return free


def _freeway(
    corridor: Corridor, free: roadside.Free, coast: bool, ground: GroundBuilder, solid: Builder
) -> np.ndarray:
    """Barriers, the other carriageway, signs, walls, plants and buildings; returns the lamps' lights."""
    length = corridor.length_m
    rng = np.random.default_rng(80)
    ends = (-carriageway.SEALED_BEYOND_M, length + carriageway.SEALED_BEYOND_M)
    roadside.concrete_barrier(corridor, 1, free, solid, *ends)
    at = carriageway.stations(corridor, carriageway.STEP_M, *ends)
    left, _ = carriageway.edge_offsets(corridor, at)
    inner = left + carriageway.SHOULDER_LEFT_M + 0.64
    middle = _mirror(corridor, at, inner, ground, free)
    lights = roadside.lamps(corridor, solid, carriageway.SHOULDER_LEFT_M + 0.3, ends[0] + 20.0, ends[1])
    walls = [(0.09, 0.33), (0.66, 0.93)]
    roadside.guard_rail(corridor, -1, free, solid, *ends)
    for a, c in walls:
        roadside.sound_wall(
            corridor, -1, free, solid, a * length, c * length, carriageway.SHOULDER_RIGHT_M + 3.0
        )
    for station in np.arange(250.0, length - 100.0, 430.0):
        edge, right = carriageway.edge_offsets(corridor, np.array([station]))
        roadside.gantry(corridor, float(station), solid, float(edge[0]) + 2.45, float(right[0]) - 4.4)
    if length > 900.0:
        station = 0.41 * length
        edge, right = carriageway.edge_offsets(corridor, np.array([station]))
        roadside.bridge(corridor, station, solid, float(edge[0]) + 2.5, float(right[0]) - 5.2)
    if coast:
        shore = middle + 9.0
        ground.strip(
            carriageway.points(corridor, at, shore + 2500.0),
            carriageway.points(corridor, at, shore),
            WATER,
            SEA,
        )
    else:
        roadside.plants(corridor, 1, free, solid, rng, (34.0, 60.0), 17.0)
    roadside.plants(corridor, -1, free, solid, rng, (8.5, 16.0), 13.0)
    roadside.buildings(corridor, -1, free, solid, rng, 85.0, (45.0, 110.0), (7.0, 22.0))
    roadside.buildings(corridor, -1, free, solid, rng, 210.0, (130.0, 420.0), (40.0, 105.0))
    roadside.hills(corridor, 1, solid, 3600.0, 210.0, roadside.HILL[0], 3)
    roadside.hills(corridor, 1, solid, 2600.0, 95.0, roadside.HILL[1], 4)
    return lights


def _mirror(
    corridor: Corridor, at: np.ndarray, inner: np.ndarray, ground: GroundBuilder, free: roadside.Free
) -> np.ndarray:
    """The carriageway of the other direction, left of the barrier, where nothing else lies; its outer offset."""
    lanes = max(2, min(corridor.lane_count, 6) - 1)
    outer = inner + 2.0 + lanes * 3.6 + 2.8
    clear = free(carriageway.points(corridor, at, 0.5 * (inner + outer)))
    gap = np.where(clear, 0.0, np.nan)
    near = inner + 1.8 + gap
    ground.strip(carriageway.points(corridor, at, outer + gap), carriageway.points(corridor, at, inner + gap),
                 carriageway.ROAD, carriageway.SHOULDER)  # fmt: skip
    ground.strip(carriageway.points(corridor, at, near + lanes * 3.6), carriageway.points(corridor, at, near),
                 carriageway.LANES, carriageway.ASPHALT)  # fmt: skip
    ground.line(carriageway.points(corridor, at, near + 0.2), carriageway.LINE_M, carriageway.YELLOW)
    ground.line(
        carriageway.points(corridor, at, near + lanes * 3.6 - 0.2), carriageway.LINE_M, carriageway.WHITE
    )
    dashes = np.arange(at[0], at[-1], carriageway.DASH_CYCLE_M)
    for lane in (1, 2):  # those farther off are hidden or too thin
        offset = np.interp(dashes, at, near + lane * 3.6)
        ground.line(
            carriageway.points(corridor, dashes, offset),
            carriageway.LINE_M,
            carriageway.WHITE,
            carriageway.DASH_SHARE,
        )
    return outer


def _street(corridor: Corridor, free: roadside.Free, solid: Builder) -> np.ndarray:
    """A slower road: trees and houses on both sides."""
    rng = np.random.default_rng(81)
    for side in (1, -1):
        roadside.plants(corridor, side, free, solid, rng, (4.0, 9.0), 16.0)
        roadside.buildings(corridor, side, free, solid, rng, 60.0, (38.0, 70.0), (5.0, 14.0))
    return roadside.lamps(corridor, solid, 4.5, 10.0, corridor.length_m)


def _stage(ground: Ground, faces: Faces, country: np.ndarray) -> Stage:
    places = [ground.place, ground.ends.mean(axis=1), faces.corners.mean(axis=1)[:, :2]]
    keys = [np.floor(p / CELL_M).astype(np.int64) for p in places]
    every = np.unique(np.concatenate(keys), axis=0)
    index = {tuple(key): i for i, key in enumerate(every.tolist())}
    strip_cell, line_cell, face_cell = (
        np.array([index[tuple(k)] for k in key.tolist()], dtype=np.int64) for key in keys
    )
    strips = np.concatenate([ground.corners, np.zeros((len(ground.corners), 4, 1))], axis=2)
    corners = [
        (strip_cell, strips),
        (line_cell, np.concatenate([ground.ends, np.zeros((len(ground.ends), 2, 1))], axis=2)),
        (face_cell, faces.corners),
    ]
    cells = np.zeros((len(every), 4))
    for i in range(len(every)):
        inside = np.concatenate([c[cell == i].reshape(-1, 3) for cell, c in corners])
        middle = 0.5 * (inside.min(axis=0) + inside.max(axis=0))
        cells[i] = *middle, np.linalg.norm(inside - middle, axis=1).max()

    def starts(cell: np.ndarray) -> np.ndarray:
        return np.searchsorted(np.sort(cell), np.arange(len(every) + 1)).astype(np.int64)

    s = np.lexsort((strip_cell, ground.layer))
    strip_start = np.zeros((2 * LAYERS, len(every) + 1), np.int64)
    for layer in range(2 * LAYERS):
        base = int((ground.layer < layer).sum())
        strip_start[layer] = base + starts(strip_cell[ground.layer == layer])
    bold = ground.half_m * np.abs(ground.line_albedo[:, 0] - ASPHALT.albedo[0])
    m, k = np.lexsort((-bold, line_cell)), np.lexsort((-faces.size, face_cell))
    strip_table = np.column_stack([ground.corners.reshape(-1, 8), ground.albedo, ground.retro, ground.label])
    line_table = np.column_stack(
        [ground.ends.reshape(-1, 4), ground.half_m, ground.share, ground.line_albedo, ground.line_retro]
    )
    face_table = np.column_stack(
        [
            faces.corners.reshape(-1, 12),
            faces.normal,
            faces.albedo,
            faces.glow,
            faces.size,
            faces.retro,
            faces.label,
        ]
    )
    return Stage(
        cells, strip_start, np.ascontiguousarray(strip_table[s]), starts(line_cell),
        np.ascontiguousarray(line_table[m]), starts(face_cell), np.ascontiguousarray(face_table[k]), country,
    )  # fmt: skip
