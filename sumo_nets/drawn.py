"""A SUMO network of one road along a line, with parallel lanes: what recordings on a motorway tell of it."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np

from sumo_nets.build import NETCONVERT_OPTIONS, find_netconvert
from sumo_nets.errors import NetworkError


def draw_road(
    points: np.ndarray, lanes: int, lane_width_m: float, speed_mps: float, edge: str, out: Path,
    netconvert: str | None = None,
) -> None:  # fmt: skip
    """Write the network of an edge whose carriageway's middle runs along `points` (n, 2), in m.

    speed_mps: the limit
    edge: its id

    Raises NetworkError where netconvert is missing or fails.
    """
    program = find_netconvert(netconvert)
    ends = "".join(
        f'<node id="{name}" x="{x:.4f}" y="{y:.4f}"/>'
        for name, (x, y) in (("begin", points[0]), ("end", points[-1]))
    )
    shape = " ".join(f"{x:.4f},{y:.4f}" for x, y in points)
    drawn = (
        f'<edge id="{edge}" from="begin" to="end" numLanes="{lanes}" width="{lane_width_m:.3f}" '
        f'speed="{speed_mps:.2f}" spreadType="center" shape="{shape}"/>'
    )
    with tempfile.TemporaryDirectory() as folder:
        nodes, edges = Path(folder) / "road.nod.xml", Path(folder) / "road.edg.xml"
        nodes.write_text(f"<nodes>{ends}</nodes>", encoding="utf-8")
        edges.write_text(f"<edges>{drawn}</edges>", encoding="utf-8")
        command = [program, "-n", str(nodes), "-e", str(edges), *NETCONVERT_OPTIONS, "-o", str(out)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or not out.exists():
        raise NetworkError(f"netconvert failed on {edge}: {done.stderr.strip() or done.stdout.strip()}")
