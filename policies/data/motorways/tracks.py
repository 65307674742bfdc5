"""Tracks recorded at any rate, brought to the 10 Hz of the schema."""

import numpy as np
import polars as pl

from policies.data.ngsim_schema import DT_S

GAP_S = 0.25  # rows further apart are not joined by a line
ROUNDED_S = 1e-6


def at_ten_hertz(rows: pl.DataFrame) -> pl.DataFrame:
    """Rows (vehicle_id, t_s, and columns of numbers) at the tenths of seconds that each track covers.

    Between recorded rows values lie on a straight line: at 25 Hz and 5 m/s^2 that is 1 mm off. `frame` takes the place
    of `t_s`; of two rows of a vehicle at one time the first is taken.
    """
    rows = rows.unique(["vehicle_id", "t_s"], keep="first").sort("vehicle_id", "t_s")
    names = [name for name in rows.columns if name not in ("vehicle_id", "t_s")]
    found = []
    for (vehicle,), track in rows.group_by(["vehicle_id"], maintain_order=True):
        t = track["t_s"].to_numpy()
        frame = np.arange(
            np.ceil((t[0] - ROUNDED_S) / DT_S), np.floor((t[-1] + ROUNDED_S) / DT_S) + 1.0, dtype=np.int64
        )
        at = frame * DT_S
        after = np.clip(np.searchsorted(t, at - ROUNDED_S), 0, len(t) - 1)
        before = np.maximum(after - 1, 0)
        kept = (t[after] - t[before] <= GAP_S) | (np.abs(t[after] - at) <= ROUNDED_S)
        values = {name: np.interp(at, t, track[name].to_numpy())[kept] for name in names}
        found.append(
            pl.DataFrame({"vehicle_id": np.full(kept.sum(), vehicle), "frame": frame[kept]} | values)
        )
    return pl.concat(found)
