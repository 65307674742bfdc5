"""Is a road fit for use: length, lanes, widths, curvature, connections, agreement with surveyed lane lines.

A built-in network states what is expected of it in its corridor.json; a user's is held to wide defaults.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

import numpy as np

from sumo_nets.chain import Chain, open_net
from sumo_nets.corridor import BUILT_IN, Corridor, built_in_folder, load_corridor
from sumo_nets.curves import resample
from sumo_nets.errors import NetworkError

ROUNDED_M = 1e-3  # by which a width is off that was read from a file of centimetres and smoothed


@dataclass(frozen=True)
class Comparison:
    """One surveyed line that should run along the centre of a lane between two stations."""

    line: str  # "source/name" in reference_lines.json
    lane: int  # 1 = leftmost
    from_m: float
    to_m: float
    median_m: float  # tolerances of the lateral distance: its median, 95% and maximum
    p95_m: float
    max_m: float


@dataclass(frozen=True)
class Expected:
    """Tolerances; the defaults are for any road that vehicles can drive at speed."""

    length_m: tuple[float, float] = (20.0, 100_000.0)
    lanes: tuple[int, int] = (1, 20)  # fewest that run through, most side by side
    lane_width_m: tuple[float, float] = (2.5, 6.0)
    max_curvature_per_m: float = 1.0 / 20.0
    max_heading_step_rad_per_m: float = 1.0 / 20.0
    max_curvature_step_per_m2: float = 0.005
    max_boundary_step_m_per_m: float = 0.1
    max_offset_from_net_m: float = 0.5  # between SUMO's drawn lanes and the smooth ones
    comparisons: tuple[Comparison, ...] = ()


@dataclass(frozen=True)
class CheckItem:
    """One thing that was checked."""

    name: str
    found: str
    wanted: str
    passed: bool
    values: dict = field(default_factory=dict)


@dataclass(frozen=True)
class CheckReport:
    """All items of one network; `passed` if every item passed."""

    name: str
    items: tuple[CheckItem, ...]

    @property
    def passed(self) -> bool:
        """Whether every item passed."""
        return all(item.passed for item in self.items)

    def to_dict(self) -> dict:
        """The report as plain values for JSON."""
        return {"name": self.name, "passed": self.passed, "items": [asdict(item) for item in self.items]}

    def __str__(self) -> str:
        rows = [("", "item", "found", "wanted")]
        rows += [("ok" if i.passed else "FAIL", i.name, i.found, i.wanted) for i in self.items]
        widths = [max(len(row[c]) for row in rows) for c in range(3)]
        lines = ["  ".join([*(row[c].ljust(widths[c]) for c in range(3)), row[3]]) for row in rows]
        return "\n".join([f"network {self.name}: {'passed' if self.passed else 'FAILED'}", *lines])


def check(name_or_path: str | Path, edges: Sequence[str] | None = None) -> CheckReport:
    """Check a built-in network or the corridor `edges` of a user's; NetworkError if it cannot be read."""
    road = load_corridor(name_or_path, edges)
    built_in = str(name_or_path) in BUILT_IN
    wanted = expected(road.name) if built_in else Expected()
    items = [
        _within("length", road.length_m, wanted.length_m, "m"),
        _stations(road),
        _lanes(road, wanted),
        _within_array("lane width", _open(road, road.lane_left - road.lane_right), wanted.lane_width_m, "m"),
        _largest("curvature", road.ref_curvature, wanted.max_curvature_per_m, "1/m"),
        _largest(
            "heading step",
            np.diff(road.ref_heading) / road.ds_m,
            wanted.max_heading_step_rad_per_m,
            "rad/m",
        ),
        _largest(
            "curvature step",
            np.diff(road.ref_curvature) / road.ds_m,
            wanted.max_curvature_step_per_m2,
            "1/m per m",
        ),
        _largest(
            "lane boundary step",
            np.diff(np.stack([road.lane_left, road.lane_right]), axis=2) / road.ds_m,
            wanted.max_boundary_step_m_per_m,
            "m per m",
        ),
    ]
    chain = Chain(open_net(Path(road.net_path)), Path(road.net_path), road.edges)
    items += [_connections(chain), _offset_from_net(road, chain, wanted)]
    if wanted.comparisons:
        lines = reference_lines(road.name)
        items += [_compare(road, lines, comparison) for comparison in wanted.comparisons]
    return CheckReport(road.name, tuple(items))


def reference_lines(name: str) -> dict[str, np.ndarray]:
    """The surveyed lines shipped with a built-in network, "source/name" -> points (n, 2) in its frame."""
    text = (built_in_folder(name) / "reference_lines.json").read_text(encoding="utf-8")
    groups = json.loads(text)
    return {
        f"{source}/{line}": np.array(points, float)
        for source in ("cad", "osm")
        for line, points in groups[source].items()
    }


def distance_to_lane(
    road: Corridor, line: np.ndarray, lane: int, from_m: float, to_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Stations of the line's points (every metre) in a range, and their distance (m, left positive) from the
    centre of `lane` (1 = leftmost)."""
    s, offset = road.project(*resample(line, 1.0).T)
    inside = (s >= max(from_m, 0.0)) & (s <= min(to_m, road.length_m))
    if not inside.any():
        raise NetworkError(f"{road.name}: the line does not reach stations {from_m:g} to {to_m:g} m")
    s, offset = s[inside], offset[inside]
    return s, offset - road.lane_center(lane - 1, s)


def expected(name: str) -> Expected:
    """What the corridor.json of a built-in network expects of it."""
    folder = built_in_folder(name)
    given = json.loads((folder / "corridor.json").read_text(encoding="utf-8"))["expected"]
    unknown = set(given) - {f.name for f in fields(Expected)}
    if unknown:
        raise NetworkError(f"{folder / 'corridor.json'}: unknown expectations {sorted(unknown)}")
    comparisons = tuple(Comparison(**c) for c in given.pop("comparisons", ()))
    return Expected(**given, comparisons=comparisons)


def _within(name: str, value: float, limits: tuple[float, float], unit: str) -> CheckItem:
    low, high = limits
    passed = bool(low <= value <= high)
    return CheckItem(name, f"{value:.1f} {unit}", f"{low:g} to {high:g}", passed, {"value": float(value)})


def _within_array(name: str, values: np.ndarray, limits: tuple[float, float], unit: str) -> CheckItem:
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    passed = limits[0] - ROUNDED_M <= low and high <= limits[1] + ROUNDED_M
    found = f"{low:.3f} to {high:.3f} {unit}"
    return CheckItem(name, found, f"{limits[0]:g} to {limits[1]:g}", passed, {"min": low, "max": high})


def _largest(name: str, values: np.ndarray, limit: float, unit: str) -> CheckItem:
    worst = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    values_dict = {"max_abs": worst, "min": float(np.nanmin(values)), "max": float(np.nanmax(values))}
    return CheckItem(name, f"{worst:.2g} {unit}", f"at most {limit:.2g}", worst <= limit, values_dict)


def _open(road: Corridor, values: np.ndarray) -> np.ndarray:
    """Values (L, K+1) without those of closed lanes, which nobody drives on."""
    return values if road.rules is None else np.where(road.rules.closed, np.nan, values)


def _stations(road: Corridor) -> CheckItem:
    chord = np.hypot(np.diff(road.ref_x), np.diff(road.ref_y))
    bend = np.diff(road.ref_heading)
    arc = chord / np.sinc(bend / (2.0 * np.pi))
    worst = float(np.abs(np.cumsum(arc) - road.station_m[1:]).max())
    return CheckItem(
        "station spacing", f"{worst * 1e3:.3f} mm off", "at most 1 mm", worst <= 1e-3, {"max_m": worst}
    )


def _lanes(road: Corridor, wanted: Expected) -> CheckItem:
    present = road.sumo_lane >= 0
    count = present.sum(axis=0)
    turns = np.flatnonzero(np.any(np.diff(present, axis=1), axis=0)) + 1
    starts, ends = np.r_[0, turns], np.r_[turns, len(count)] - 1
    ranges = [
        {"from_m": float(road.station_m[a]), "to_m": float(road.station_m[b]), "lanes": int(count[a])}
        for a, b in zip(starts, ends, strict=True)
    ]
    found = ", ".join(f"{r['lanes']} to {r['to_m']:.0f} m" for r in ranges)
    low, high = wanted.lanes
    through = int(present.all(axis=1).sum())
    passed = bool(through >= low and count.max() <= high)
    values = {"ranges": ranges, "through": through}
    return CheckItem("lanes", found, f"{low} or more throughout, at most {high}", passed, values)


def _connections(chain: Chain) -> CheckItem:
    broken = [f"lane {lane} from {a} to {b}" for a, b, lane in chain.breaks()]
    found = ", ".join(broken) if broken else f"all lanes of {len(chain.edges)} edges"
    return CheckItem("lane connections", found, "no gap", not broken, {"missing": broken})


def _offset_from_net(road: Corridor, chain: Chain, wanted: Expected) -> CheckItem:
    worst = 0.0
    for i, lanes in enumerate(chain.lanes):
        for position, lane in enumerate(lanes):
            points = resample(np.array(lane.getShape(), float)[:, :2], 1.0)
            s, offset = road.project(*points.T)
            centre = road.lane_center(chain.first[i] + position, np.clip(s, 0.0, road.length_m))
            apart = np.abs(offset - centre)[np.isfinite(centre)]
            worst = max(worst, float(apart.max(initial=0.0)))
    limit = wanted.max_offset_from_net_m
    return CheckItem(
        "lanes against SUMO's", f"{worst:.3f} m", f"at most {limit:g}", worst <= limit, {"max_m": worst}
    )


def _compare(road: Corridor, lines: dict[str, np.ndarray], c: Comparison) -> CheckItem:
    _, apart = distance_to_lane(road, lines[c.line], c.lane, c.from_m, c.to_m)
    apart = np.abs(apart)
    median, p95, worst = (float(v) for v in (*np.percentile(apart, [50, 95]), apart.max()))
    return CheckItem(
        f"{c.line} on lane {c.lane}, {c.from_m:g}-{c.to_m:g} m",
        f"{median:.2f} / {p95:.2f} / {worst:.2f} m",
        f"{c.median_m:g} / {c.p95_m:g} / {c.max_m:g} (median / 95% / max)",
        median <= c.median_m and p95 <= c.p95_m and worst <= c.max_m,
        {"median_m": median, "p95_m": p95, "max_m": worst, "points": len(apart)},
    )
