"""Rules of lanes beyond their being reserved: closed strips between open lanes, and no changing out of a lane.

Most networks have none. `changeLeft` and `changeRight` of a lane list the classes that may change; sumolib does not
read them, so they are read from the file here.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from sumo_nets.readable import opened
from sumo_nets.strips import is_closed

if TYPE_CHECKING:
    from sumo_nets.chain import Chain

EVERYBODY = ("", "all")


@dataclass(frozen=True, eq=False)
class Rules:
    """Arrays (L, K+1) of bool over lanes and stations, as those of a corridor.

    closed: no motor vehicle may use the lane
    keeps_left, keeps_right: passenger cars may not change out of the lane to that side
    """

    closed: np.ndarray
    keeps_left: np.ndarray
    keeps_right: np.ndarray


def rules_of(chain: Chain, path: Path, edge_index: np.ndarray) -> Rules | None:
    """The rules along a corridor whose lanes belong to edges `edge_index` (L, K+1); None where there are none."""
    unchanging = _without_change(path, set(chain.edges))
    shape = edge_index.shape
    rules = Rules(np.zeros(shape, bool), np.zeros(shape, bool), np.zeros(shape, bool))
    for i, lanes in enumerate(chain.lanes):
        for position, lane in enumerate(lanes):
            here = edge_index[chain.first[i] + position] == i
            column = chain.first[i] + position
            rules.closed[column, here] = is_closed(lane)
            rules.keeps_left[column, here] = (lane.getID(), "changeLeft") in unchanging
            rules.keeps_right[column, here] = (lane.getID(), "changeRight") in unchanging
    found = rules.closed.any() or rules.keeps_left.any() or rules.keeps_right.any()
    return rules if found else None


def _without_change(path: Path, edges: set[str]) -> set[tuple[str, str]]:
    """(lane, attribute) of the lanes of the edges that passenger cars may not leave to that side."""
    found = set()
    with opened(path) as file:
        for _, element in ElementTree.iterparse(file, events=("end",)):
            if element.tag != "edge":
                continue
            if element.get("id") in edges:
                for lane in element.findall("lane"):
                    for attribute in ("changeLeft", "changeRight"):
                        allowed = lane.get(attribute)
                        if (
                            allowed is not None
                            and allowed not in EVERYBODY
                            and "passenger" not in allowed.split()
                        ):
                            found.add((lane.get("id", ""), attribute))
            element.clear()
    return found
