"""What a `--data` folder holds, whichever kind it is: the data pack, or tables that the user imported.

found = load_recordings("shared/data")       # the pack: I-80 scene, US-101 scenes, Zhu's car-following events
found = load_recordings("tables")            # `tailroad data import` wrote them: NGSIM's own files, say
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from policies.data.neighbours import bumper_gaps, leaders
from policies.data.scenes import (
    I80_FILE,
    I80_LANES,
    US101_FILE,
    US101_LANES,
    DataError,
    Scene,
    read_i80,
    read_us101,
)
from policies.data.tables import is_table, read_tables

ZHU_FILE = "trajectories/zhu_ngsim_cf_events.parquet"
EVENT_S = (15.0, 50.0)  # of a car-following event taken from scenes: as long as Zhu's
EVENT_GAP_M = 60.0


@dataclass(frozen=True)
class Recordings:
    """The recordings that drivers are trained on and compared with.

    sites: scenes by site: "i80" and "us101" of the pack, or each road of tables, called by its first recording

    following (events, steps, 3): gap m, own speed, leader's speed m/s at 10 Hz, NaN after an event's end
    files: sha256 by name
    passed_over: recordings that are no scenes, and why
    from_pack: `following` is Zhu's, not the scenes' own
    """

    sites: dict[str, list[Scene]]
    following: np.ndarray
    files: dict[str, str]
    passed_over: list[str]
    from_pack: bool = False

    @property
    def scenes(self) -> list[Scene]:
        return [scene for scenes in self.sites.values() for scene in scenes]


def load_recordings(data: Path | str) -> Recordings:
    """The recordings of a data pack's folder, of a folder of imported tables, or of one table. Raises DataError."""
    data = Path(data)
    if (data / I80_FILE).is_file():
        names: list[str] = [I80_FILE, I80_LANES, US101_FILE, US101_LANES, ZHU_FILE]
        sites = {"i80": [read_i80(data)], "us101": read_us101(data)}
        return Recordings(sites, zhu_events(data), _digests(data, names), [], from_pack=True)
    if is_table(data):
        scenes, passed_over = read_tables(data)
        folder = data if data.is_dir() else data.parent
        names = [f.name for f in ([data] if data.is_file() else sorted(data.glob("*.parquet")))]
        return Recordings({"tables": scenes}, following_events(scenes), _digests(folder, names), passed_over)
    raise DataError(
        f"{data}: found neither the data pack ({I80_FILE}) nor imported tables (*.parquet in the schema that "
        "'tailroad data schema' prints); import recordings with 'tailroad data import FILE --out DIR'"
    )


def zhu_events(data: Path) -> np.ndarray:
    """Zhu's car-following events of the data pack, see Recordings.following."""
    path = data / ZHU_FILE
    if not path.is_file():
        raise DataError(f"{path}: no such file; --data must name the data pack's folder")
    table = pl.read_parquet(path).sort("event", "k")
    events = [
        part.select("spacing_m", "foll_v_mps", "lead_v_mps").to_numpy()
        for _, part in table.group_by("event", maintain_order=True)
    ]
    return stacked(events)


def following_events(scenes: list[Scene]) -> np.ndarray:
    """The same from scenes: training vehicles behind one leader in one lane for EVENT_S, within EVENT_GAP_M."""
    events = []
    for scene in scenes:
        ahead = leaders(scene)
        gap = bumper_gaps(scene, ahead)
        shortest, longest = (round(t / scene.dt_s) for t in EVENT_S)
        for v in np.flatnonzero(scene.vehicle_id < scene.held_out_from):
            fits = (gap[:, v] > 0.5) & (gap[:, v] < EVENT_GAP_M)
            key = np.where(fits, ahead[:, v], -1)
            cuts = np.flatnonzero(np.diff(key) != 0) + 1
            for rows in np.split(np.arange(len(key)), cuts):
                if key[rows[0]] >= 0 and len(rows) >= shortest:
                    rows = rows[:longest]
                    lead = scene.speed[rows, key[rows[0]]]
                    events.append(np.column_stack([gap[rows, v], scene.speed[rows, v], lead]))
    if not events:
        raise DataError(
            f"no vehicle follows another in one lane for {EVENT_S[0]:g} s; longer recordings are needed"
        )
    return stacked(events)


def stacked(events: list[np.ndarray]) -> np.ndarray:
    """Events (steps, 3) of different lengths as one array, NaN after each one's end."""
    out = np.full((len(events), max(len(e) for e in events), 3), np.nan)
    for i, event in enumerate(events):
        out[i, : len(event)] = event
    return out


def _digests(folder: Path, names: list[str]) -> dict[str, str]:
    for name in names:
        if not (folder / name).is_file():
            raise DataError(f"{folder / name}: no such file; --data must name the data pack's folder")
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in names}
