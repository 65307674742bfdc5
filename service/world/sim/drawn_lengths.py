"""Lanes whose length in the file is not the length of the line that is drawn.

SUMO counts positions, gaps and speeds in a lane's stated length; everything here is in metres as drawn. netconvert
gives all lanes of a curved edge one length, the mean of their lines, and files may state any other. Where an edge's
length is not that mean, SUMO is handed a copy of the network in which it is; what is left, a lane beside the mean, is a
factor.
"""

import os
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from sumo_nets.corridor import Corridor
from sumo_nets.readable import opened

NEGLIGIBLE_M, NEGLIGIBLE_SHARE = 0.5, 0.01  # netconvert rounds, and cuts lines at junctions

SHORTEST_M = 2.0


def network_as_drawn(corridor: Corridor) -> tuple[str, Path | None]:
    """The network file for SUMO, and the copy to delete afterwards where one had to be made."""
    path = Path(corridor.net_path)
    try:
        lengths = _lengths_m(path, set(corridor.edges))
    except (OSError, ValueError, ElementTree.ParseError):
        return corridor.net_path, None  # SUMO says what is wrong with it
    if not lengths:
        return corridor.net_path, None
    with opened(path) as file:
        tree = ElementTree.parse(file)
    for edge in tree.getroot().iter("edge"):
        for lane in edge.findall("lane") if edge.get("id") in lengths else ():
            lane.set("length", f"{lengths[edge.get('id', '')]:.2f}")
    handle, name = tempfile.mkstemp(suffix=".net.xml")
    os.close(handle)
    tree.write(name, encoding="UTF-8", xml_declaration=True)
    return name, Path(name)


def _lengths_m(path: Path, edges: set[str]) -> dict[str, float]:
    """The drawn lengths of those of the edges that state another."""
    found = {}
    with opened(path) as file:
        for _, edge in ElementTree.iterparse(file, events=("end",)):
            if edge.tag != "edge":
                continue
            lanes = edge.findall("lane") if edge.get("id") in edges else []
            if lanes:
                drawn = float(np.mean([_length_m(lane.get("shape", "")) for lane in lanes]))
                apart = max(abs(float(lane.get("length", "0")) - drawn) for lane in lanes)
                if apart > NEGLIGIBLE_M + NEGLIGIBLE_SHARE * drawn:
                    found[edge.get("id", "")] = drawn
            edge.clear()
    return found


def stretch(sumo: Any, lane_id: str) -> float:
    """Metres as drawn in one of SUMO's on a lane; 1 in junctions, whose lanes are hardly drawn."""
    points = np.array(sumo.lane.getShape(lane_id) if lane_id else (), float).reshape(-1, 2)
    drawn = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return drawn / float(sumo.lane.getLength(lane_id)) if drawn > SHORTEST_M else 1.0


def _length_m(shape: str) -> float:
    points = np.array([[float(value) for value in point.split(",")[:2]] for point in shape.split()])
    return float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) > 1 else 0.0
