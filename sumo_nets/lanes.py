"""All lanes of a SUMO network as polylines: what lies round a corridor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sumo_nets.chain import open_net
from sumo_nets.strips import admits

CAR_CLASSES = {"passenger", "private", "hov", "bus", "coach", "truck", "delivery", "taxi", "trailer"}


@dataclass(frozen=True, eq=False)
class LaneShape:
    """One lane: its middle line `points` (n, 2) in m, from its start to its end."""

    edge: str
    index: int  # SUMO's: 0 is the rightmost
    internal: bool  # inside a junction
    points: np.ndarray
    width_m: float
    speed_mps: float
    hov: bool  # for vehicles with several occupants, not for everybody


def lane_shapes(net_path: str | Path) -> list[LaneShape]:
    """The lanes that cars may use, junctions included; NetworkError where the file is missing or is no network."""
    shapes = []
    for edge in open_net(Path(net_path)).getEdges(withInternal=True):
        for lane in edge.getLanes():
            if not any(admits(lane, kind) for kind in CAR_CLASSES):
                continue
            points = np.array(lane.getShape(), float)[:, :2]
            if len(points) < 2:
                continue
            shapes.append(
                LaneShape(
                    edge.getID(),
                    lane.getIndex(),
                    edge.getFunction() == "internal",
                    points,
                    float(lane.getWidth()),
                    float(lane.getSpeed()),
                    admits(lane, "hov") and not admits(lane, "passenger"),
                )
            )
    return shapes
