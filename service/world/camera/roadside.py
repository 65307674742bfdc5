"""What stands beside and above the road: barriers, walls, lamps, gantries, a bridge, plants, buildings, hills."""

import itertools
from collections.abc import Callable

import numpy as np

from service.world.camera.carriageway import SHOULDER_LEFT_M, SHOULDER_RIGHT_M, edge_offsets, points, stations
from service.world.camera.labels import Label
from service.world.camera.quads import Builder, Material
from sumo_nets.corridor import Corridor

CONCRETE = Material((0.33, 0.32, 0.30), Label.BARRIER)
CONCRETE_DARK = Material((0.25, 0.245, 0.235), Label.BARRIER)
STEEL = Material((0.34, 0.35, 0.36), Label.BARRIER)
WALL = (Material((0.30, 0.255, 0.20), Label.WALL), Material((0.27, 0.23, 0.185), Label.WALL))
WALL_CAP = Material((0.36, 0.32, 0.27), Label.WALL)
POLE = Material((0.27, 0.28, 0.29), Label.POLE)
LAMP_HEAD = Material((0.30, 0.30, 0.30), Label.POLE, glow=(1.10, 0.78, 0.42))
SIGN = Material((0.010, 0.115, 0.060), Label.SIGN, retro=10.0, glow=(0.0005, 0.006, 0.003))
SIGN_BACK = Material((0.22, 0.22, 0.23), Label.SIGN)
LETTERS = Material((0.80, 0.80, 0.78), Label.SIGN, retro=10.0, glow=(0.03, 0.03, 0.03))
BRIDGE = Material((0.30, 0.29, 0.275), Label.BRIDGE)
BRIDGE_DARK = Material((0.17, 0.165, 0.16), Label.BRIDGE)
LEAVES = (
    Material((0.040, 0.072, 0.026), Label.PLANT),
    Material((0.055, 0.085, 0.035), Label.PLANT),
    Material((0.030, 0.055, 0.026), Label.PLANT),
)
TRUNK = Material((0.10, 0.075, 0.05), Label.PLANT)
FACADES = (
    (0.34, 0.31, 0.27),
    (0.25, 0.26, 0.28),
    (0.42, 0.40, 0.37),
    (0.30, 0.20, 0.155),
    (0.20, 0.235, 0.27),
)
HILL = (Material((0.125, 0.135, 0.085), Label.TERRAIN), Material((0.145, 0.135, 0.080), Label.TERRAIN))

Free = Callable[[np.ndarray], np.ndarray]  # whether points (n, 2) lie on no lane: (n,) bool
PIECE_M = 10.0


def _offset_line(corridor: Corridor, at: np.ndarray, side: int, beyond_m: float) -> np.ndarray:
    left, right = edge_offsets(corridor, at)
    return points(corridor, at, left + beyond_m if side > 0 else right - beyond_m)


def _prism(b: Builder, lines: list[tuple[np.ndarray, float]], materials: list[Material], keep: np.ndarray,
           closed: bool = True) -> None:  # fmt: skip
    """Faces along the road between neighbouring lines (points (n, 2), z): a profile drawn along the road."""
    pairs = (
        list(zip(lines, [*lines[1:], lines[0]], strict=True)) if closed else list(itertools.pairwise(lines))
    )
    for i in np.flatnonzero(keep):
        middle = np.mean([[*line[i], z] for line, z in lines], axis=0)
        for ((p, zp), (q, zq)), material in zip(pairs, materials, strict=True):
            b.quad([(*p[i], zp), (*p[i + 1], zp), (*q[i + 1], zq), (*q[i], zq)], material, middle)
    runs = np.flatnonzero(np.diff(np.concatenate([[0], keep.astype(int), [0]])))
    for begin, end in runs.reshape(-1, 2):  # the faces at the ends of a run
        for i, j in ((begin, begin + 1), (end, end - 1)):
            inner = np.mean([[*line[j], z] for line, z in lines], axis=0)
            corners = [(*line[i], z) for line, z in lines]
            for k in range(1, len(corners) - 1, 2):
                b.quad(
                    [corners[0], corners[k], corners[k + 1], corners[min(k + 2, len(corners) - 1)]],
                    materials[0],
                    inner,
                )


def concrete_barrier(
    corridor: Corridor, side: int, free: Free, b: Builder, begin_m: float, end_m: float
) -> None:
    """A New Jersey barrier, 0.81 m high, at the outer edge of the shoulder; side: +1 left, -1 right."""
    at = stations(corridor, PIECE_M, begin_m, end_m)
    base = (SHOULDER_LEFT_M if side > 0 else SHOULDER_RIGHT_M) - 0.05
    profile = ((0.0, 0.0), (0.18, 0.33), (0.24, 0.81), (0.40, 0.81), (0.46, 0.33), (0.64, 0.0))
    lines = [(_offset_line(corridor, at, side, base + x), z) for x, z in profile]
    keep = _all_free(lines[2][0], free)
    _prism(b, lines, [CONCRETE_DARK, CONCRETE, CONCRETE, CONCRETE, CONCRETE_DARK, CONCRETE_DARK], keep)


def guard_rail(corridor: Corridor, side: int, free: Free, b: Builder, begin_m: float, end_m: float) -> None:
    """A steel beam on posts."""
    at = stations(corridor, PIECE_M, begin_m, end_m)
    base = SHOULDER_RIGHT_M + 0.3
    lines = [
        (_offset_line(corridor, at, side, base + x), z)
        for x, z in ((0.0, 0.45), (0.0, 0.78), (0.08, 0.78), (0.08, 0.45))
    ]
    keep = _all_free(lines[0][0], free)
    _prism(b, lines, [STEEL] * 4, keep)
    posts = stations(corridor, 4.0, begin_m, end_m)
    where = _offset_line(corridor, posts, side, base + 0.16)
    for p in where[free(where)]:
        b.box(_square(p, 0.07), 0.0, 0.74, POLE)


def sound_wall(corridor: Corridor, side: int, free: Free, b: Builder, begin_m: float, end_m: float, beyond_m: float,
               height_m: float = 4.0) -> None:  # fmt: skip
    """A wall of panels with posts."""
    at = stations(corridor, PIECE_M, begin_m, end_m)
    lines = [
        (_offset_line(corridor, at, side, beyond_m + x), z)
        for x, z in ((0, 0.0), (0, height_m), (0.25, height_m), (0.25, 0.0))
    ]
    keep = _all_free(lines[0][0], free) & _all_free(_offset_line(corridor, at, side, beyond_m - 1.0), free)
    for parity in (0, 1):
        some = keep & (np.arange(len(keep)) % 2 == parity)
        for i in np.flatnonzero(some):
            pair = np.zeros(len(keep), bool)
            pair[i] = True
            _prism(b, lines, [WALL[parity], WALL_CAP, WALL[parity], WALL[parity]], pair)
    for p, q in zip(lines[0][0][:-1][keep], lines[3][0][:-1][keep], strict=True):
        b.box(_square(0.5 * (p + q), 0.22), 0.0, height_m + 0.15, WALL_CAP)


def lamps(
    corridor: Corridor, b: Builder, beyond_m: float, begin_m: float, end_m: float, every_m: float = 55.0
) -> np.ndarray:
    """Street lamps in the median with two arms; returns where their lights are, (n, 3)."""
    at = np.arange(begin_m, end_m, every_m)
    lights = []
    for station in at:
        p, heading = _at(corridor, station, 1, beyond_m)
        b.box(_square(p, 0.11), 0.0, 11.0, POLE)
        across = np.array([-np.sin(heading), np.cos(heading)])
        for sign in (1.0, -1.0):
            tip = p + sign * 2.4 * across
            b.box(_beam(p, tip, 0.05), 10.9, 11.02, POLE, bottom=True)
            b.box(_beam(tip - sign * 0.7 * across, tip, 0.14), 10.78, 10.9, LAMP_HEAD, top=POLE, bottom=True)
            lights.append([*tip, 10.8])
    return np.array(lights).reshape(-1, 3)


def gantry(corridor: Corridor, station: float, b: Builder, left_m: float, right_m: float) -> None:
    """A truss over the carriageway with green signs; left_m, right_m: offsets of its posts."""
    x, y, heading = corridor.to_xy(station, 0.0)
    origin = np.array([float(x), float(y)])
    across = np.array([-np.sin(heading), np.cos(heading)])
    along = np.array([np.cos(heading), np.sin(heading)])
    ends = [origin + left_m * across, origin + right_m * across]
    for p in ends:
        b.box(_square(p, 0.22), 0.0, 8.3, POLE)
    for low in (6.9, 8.1):
        b.box(_beam(ends[0], ends[1], 0.12), low, low + 0.18, POLE, bottom=True)
    count = int(abs(left_m - right_m) / 2.4)
    for i in range(count):
        p, q = (ends[0] + (ends[1] - ends[0]) * t / count for t in (i, i + 1))
        low, high = (7.05, 8.15) if i % 2 else (8.15, 7.05)
        b.both_sides([(*p, low), (*p, low + 0.1), (*q, high + 0.1), (*q, high)], POLE)
    rng = np.random.default_rng(int(station))
    for centre, width in ((right_m + 6.2, 6.4), (0.5 * (left_m + right_m) + 1.0, 5.4), (left_m - 5.6, 3.8)):
        face = origin + centre * across - 0.4 * along
        low, high = 6.3, 9.2
        p, q = face + 0.5 * width * across, face - 0.5 * width * across
        behind = np.array([*(face + along), 7.5])
        b.quad([(*p, low), (*q, low), (*q, high), (*p, high)], SIGN, behind)
        back = along * 0.08
        b.quad([(*(p + back), low), (*(q + back), low), (*(q + back), high), (*(p + back), high)], SIGN_BACK,
               np.array([*(face - along), 7.5]))  # fmt: skip
        near = -0.02 * along
        for z in (8.35, 7.55, 6.7):  # lines of writing, as blocks of letters
            at = 0.5 * width - 0.5
            while at > -0.5 * width + 0.9:
                size = rng.uniform(0.3, 1.1)
                u, v = face + at * across + near, face + max(at - size, -0.5 * width + 0.4) * across + near
                b.quad([(*u, z), (*v, z), (*v, z + 0.42), (*u, z + 0.42)], LETTERS, behind)
                at -= size + 0.22


def bridge(
    corridor: Corridor, station: float, b: Builder, left_m: float, right_m: float, width_m: float = 14.0
) -> None:
    """A road over the road."""
    x, y, heading = corridor.to_xy(station, 0.0)
    origin = np.array([float(x), float(y)])
    across = np.array([-np.sin(heading), np.cos(heading)])
    along = np.array([np.cos(heading), np.sin(heading)])
    reach = 60.0
    for begin in np.arange(right_m - reach, left_m + reach, 15.0):
        end = min(begin + 15.0, left_m + reach)
        side = 0.5 * width_m * along
        base = origin + np.array(
            [begin * across - side, end * across - side, end * across + side, begin * across + side]
        )
        b.box(base, 5.7, 6.9, BRIDGE, bottom=True)
        for shift in (-0.5 * width_m, 0.5 * width_m - 0.3):
            rail = np.array([origin + begin * across + shift * along, origin + end * across + shift * along])
            base = np.array([rail[0], rail[1], rail[1] + 0.3 * along, rail[0] + 0.3 * along])
            b.box(base, 6.9, 7.75, CONCRETE)
    for offset in (left_m, right_m):
        for shift in (-0.35, 0.0, 0.35):
            b.box(_square(origin + offset * across + shift * width_m * along, 0.55), 0.0, 5.7, BRIDGE_DARK)


def plants(corridor: Corridor, side: int, free: Free, b: Builder, rng: np.random.Generator,
           beyond_m: tuple[float, float], every_m: float) -> None:  # fmt: skip
    """Bushes and trees at random places."""
    for station in np.arange(0.0, corridor.length_m + 200.0, every_m):
        p, _ = _at(corridor, station + rng.uniform(0.0, every_m), side, rng.uniform(*beyond_m))
        tall = rng.random() < 0.4
        height, half = (
            (rng.uniform(5.0, 11.0), rng.uniform(1.4, 2.6))
            if tall
            else (rng.uniform(0.8, 2.2), rng.uniform(0.7, 1.6))
        )
        if not free(np.array([p]))[0]:
            continue
        leaves = LEAVES[int(rng.integers(len(LEAVES)))]
        _crown(b, p, 0.32 * height if tall else 0.0, height, half, leaves, rng.uniform(0.0, 1.5))
        if tall:
            b.box(_square(p, 0.16), 0.0, 0.5 * height, TRUNK)


def _crown(
    b: Builder, p: np.ndarray, low: float, high: float, half: float, leaves: Material, turn: float
) -> None:
    """A lump of leaves: rings of five corners."""
    angle = turn + np.arange(5) * np.pi * 0.4
    middle = np.array([*p, 0.5 * (low + high)])
    rings = []
    for share, wide in ((0.0, 0.6), (0.4, 1.0), (1.0, 0.3)):
        z = low + share * (high - low)
        rings.append([(p[0] + wide * half * np.cos(t), p[1] + wide * half * np.sin(t), z) for t in angle])
    for k, (a, c) in enumerate(itertools.pairwise(rings)):
        shade = 0.75 + 0.3 * k
        tone = Material(tuple(float(v * shade) for v in leaves.albedo), leaves.label)  # type: ignore[arg-type]
        for i in range(5):
            j = (i + 1) % 5
            b.quad([a[i], a[j], c[j], c[i]], tone, middle)


def buildings(corridor: Corridor, side: int, free: Free, b: Builder, rng: np.random.Generator, every_m: float,
              beyond_m: tuple[float, float], height_m: tuple[float, float]) -> None:  # fmt: skip
    """Blocks with rows of windows, some lit at night."""
    station = 0.0
    while station < corridor.length_m + 500.0:
        station += rng.uniform(0.6, 1.4) * every_m
        centre, heading = _at(corridor, station, side, rng.uniform(*beyond_m))
        size = rng.uniform(14.0, 34.0, 2)
        floors = int(rng.uniform(*height_m) / 3.4)
        turn = heading + rng.uniform(-0.25, 0.25)
        u = np.array([np.cos(turn), np.sin(turn)]) * size[0]
        v = np.array([-np.sin(turn), np.cos(turn)]) * size[1]
        base = np.array([centre - u - v, centre + u - v, centre + u + v, centre - u + v]) * 1.0
        if not free(np.vstack([base, centre[None]])).all():
            continue
        road = _at(corridor, station, side, 0.0)[0]
        _block(b, base, floors, FACADES[int(rng.integers(len(FACADES)))], road, rng)


def _block(b: Builder, base: np.ndarray, floors: int, colour: tuple[float, float, float], road: np.ndarray,
           rng: np.random.Generator) -> None:  # fmt: skip
    """A building on `base` (4, 2); only what can be seen from the road, which runs past the point `road`."""
    height = floors * 3.4 + 1.2
    wall = Material(colour, Label.BUILDING)
    roof = Material((0.22, 0.21, 0.20), Label.BUILDING)
    middle = np.array([*base.mean(axis=0), 0.5 * height])
    b.box(base, 0.0, height, wall, top=roof)
    step = max(1, -(-floors // 4))  # rows of windows are merged on tall buildings
    for i in range(4):
        p, q = base[i], base[(i + 1) % 4]
        outward = 0.5 * (p + q) - middle[:2]
        outward /= max(float(np.hypot(*outward)), 1e-6)
        towards = road - middle[:2]
        if outward @ towards < -0.3 * np.hypot(*towards):
            continue
        pieces = 2 if floors > 8 and outward @ towards > 0.5 * np.hypot(*towards) else 1
        for floor in range(0, floors, step):
            low = floor * 3.4 + 1.3
            high = min(low + step * 3.4 - 1.7, height - 0.6)
            for k in range(pieces):
                warm = rng.uniform(0.6, 1.0)
                glow = (
                    (0.055 * warm, 0.042 * warm, 0.022 * warm)
                    if rng.random() < 0.34
                    else (0.0006, 0.0006, 0.0008)
                )
                window = Material((0.060, 0.075, 0.090), Label.BUILDING, glow=glow)
                a, c = (p + (q - p) * t + 0.06 * outward for t in ((k + 0.06) / pieces, (k + 0.94) / pieces))
                b.quad([(*a, low), (*c, low), (*c, high), (*a, high)], window, middle)


def hills(
    corridor: Corridor,
    side: int,
    b: Builder,
    distance_m: float,
    height_m: float,
    material: Material,
    seed: int,
) -> None:
    """A ridge far away on one side, and round the end of the road."""
    rng = np.random.default_rng(seed)
    middle = np.array(corridor.to_xy(0.5 * corridor.length_m, 0.0)[:2], float).ravel()
    heading = float(corridor.to_xy(corridor.length_m, 0.0)[2])
    angle = heading - side * np.linspace(-0.9, 2.6, 60)
    turn = np.linspace(0.0, 6.0, 60)
    waves = [rng.uniform(0.3, 1.0) / n * np.sin(n * turn + rng.uniform(0.0, 6.3)) for n in (1, 2, 3, 5, 9)]
    top = np.maximum(height_m * (0.62 + 0.22 * np.sum(waves, axis=0)), 1.0)
    radius = distance_m + 0.5 * corridor.length_m
    foot = np.column_stack([middle[0] + radius * np.cos(angle), middle[1] + radius * np.sin(angle)])
    for i in range(len(foot) - 1):
        corners = [(*foot[i], 0.0), (*foot[i + 1], 0.0), (*foot[i + 1], top[i + 1]), (*foot[i], top[i])]
        b.quad(corners,
               material, np.array([*(2.0 * foot[i] - middle), 0.0]))  # fmt: skip


def _all_free(line: np.ndarray, free: Free) -> np.ndarray:
    """Whether the pieces between neighbouring points (n, 2) lie on no lane: (n - 1,)."""
    keep = np.ones(len(line) - 1, bool)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        keep &= free(line[:-1] + share * (line[1:] - line[:-1]))
    return keep


def _at(corridor: Corridor, station: float, side: int, beyond_m: float) -> tuple[np.ndarray, float]:
    at = np.array([station])
    p = _offset_line(corridor, at, side, beyond_m)[0]
    return p, float(corridor.to_xy(min(max(station, 0.0), corridor.length_m), 0.0)[2])


def _square(p: np.ndarray, half_m: float) -> np.ndarray:
    return np.asarray(p) + half_m * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])


def _beam(p: np.ndarray, q: np.ndarray, half_m: float) -> np.ndarray:
    along = (q - p) / max(float(np.hypot(*(q - p))), 1e-9)
    across = half_m * np.array([-along[1], along[0]])
    return np.array([p - across, q - across, q + across, p + across])
