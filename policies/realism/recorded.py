"""What the recordings show of lane changes, in numbers for the card and for those who train on them."""

from typing import Any

import numpy as np

from policies.data.scenes import Scene
from policies.realism.lane_changes import LaneChanges
from policies.realism.statistics import rounded

SPEED_BINS_MPS = (0.0, 4.0, 8.0, 12.0, 16.0, 40.0)
PERCENTILES = (5, 25, 50, 75, 95)
DESCRIBED = (
    "speed_mps", "duration_s", "lateral_speed_mps", "lead_gap_m", "lead_headway_s", "lead_closing_mps", "lag_gap_m",
    "lag_headway_s", "lag_closing_mps", "lag_min_headway_s", "lag_min_ttc_s",
)  # fmt: skip


def lane_change_facts(scenes: list[Scene], found: LaneChanges) -> dict[str, Any]:
    """Lane changes between main lanes (a recorded road's last lane is its ramp): rates by lane and speed, manoeuvre,
    gaps. Scenes must share their number of lanes."""
    ramp = len(scenes[0].road.lane_left) - 1
    main = found.where((found.lane_from != ramp) & (found.lane_to != ramp))
    by_lane = np.zeros(ramp + 1)
    by_speed = np.zeros(len(SPEED_BINS_MPS) - 1)
    for scene in scenes:
        km = np.nan_to_num(scene.speed) * scene.dt_s / 1000.0
        by_lane += np.bincount(np.where(scene.lane >= 0, scene.lane, 0).ravel(), km.ravel(), ramp + 1)[
            : ramp + 1
        ]
        on = (scene.lane >= 0) & (scene.lane < ramp)
        by_speed += np.histogram(scene.speed[on], SPEED_BINS_MPS, weights=km[on])[0]
    total = float(by_lane[:ramp].sum())
    changed = np.histogram(main.speed_mps, SPEED_BINS_MPS)[0]
    return {
        "vehicle_km_main_lanes": round(total, 1),
        "lane_changes_main_lanes": len(main),
        "per_vehicle_km": rounded(len(main) / total) if total > 0 else None,
        "to_the_left": int((main.lane_to < main.lane_from).sum()),
        "to_the_right": int((main.lane_to > main.lane_from).sum()),
        "from_or_to_the_ramp": len(found) - len(main),
        "by_lane": [_part(i + 1, (main.lane_from == i).sum(), by_lane[i]) for i in range(ramp)],
        "by_speed": [
            _part(f"{low:g} to {high:g} m/s", n, km)
            for low, high, n, km in zip(
                SPEED_BINS_MPS[:-1], SPEED_BINS_MPS[1:], changed, by_speed, strict=True
            )
        ],
        "percentiles": list(PERCENTILES),
        "of_each": {name: _percentiles(getattr(main, name)) for name in DESCRIBED},
    }


def _part(name: object, count: int, km: float) -> dict[str, Any]:
    return {
        "of": name,
        "lane_changes": int(count),
        "vehicle_km": round(float(km), 2),
        "per_vehicle_km": rounded(count / km) if km > 0.1 else None,
    }


def _percentiles(values: np.ndarray) -> dict[str, Any]:
    known = values[~np.isnan(values)]
    if not len(known):
        return {"n": 0, "values": []}
    at = np.percentile(known, PERCENTILES, method="nearest")
    return {"n": len(known), "values": [rounded(x, 2) for x in at]}
