"""Small SUMO networks written as text, so that no test needs netconvert."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

LOCATION = '<location netOffset="0.00,0.00" convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="!"/>'


def net_text(edges: dict[str, tuple[np.ndarray, list[float]]], links: list[tuple[str, str, int, int]]) -> str:
    """A .net.xml: edge -> (centre line of the edge, lane widths from the right), and connections between lanes."""
    parts = [f'<?xml version="1.0" encoding="UTF-8"?>\n<net version="1.20">\n{LOCATION}']
    junctions = {}
    for edge, (line, widths) in edges.items():
        tangent = np.gradient(line, axis=0)
        tangent /= np.hypot(*tangent.T)[:, None]
        left = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        parts.append(f'<edge id="{edge}" from="{edge}_a" to="{edge}_b" priority="1">')
        border = -sum(widths) / 2
        for index, width in enumerate(widths):
            points = line + left * (border + width / 2)
            border += width
            shape = " ".join(f"{x:.3f},{y:.3f}" for x, y in points)
            length = np.hypot(*np.diff(points, axis=0).T).sum()
            parts.append(
                f'<lane id="{edge}_{index}" index="{index}" speed="25" length="{length:.2f}" width="{width}"'
                f' shape="{shape}"/>'
            )
        parts.append("</edge>")
        junctions |= {f"{edge}_a": line[0], f"{edge}_b": line[-1]}
    for name, (x, y) in junctions.items():
        parts.append(
            f'<junction id="{name}" type="priority" x="{x:.2f}" y="{y:.2f}" incLanes="" intLanes="" shape=""/>'
        )
    for a, b, from_lane, to_lane in links:
        parts.append(
            f'<connection from="{a}" to="{b}" fromLane="{from_lane}" toLane="{to_lane}" dir="s" state="M"/>'
        )
    return "\n".join([*parts, "</net>"])


@pytest.fixture
def write_net(tmp_path: Path):
    """write_net(name, edges, links) writes a network and returns its path; see `net_text`."""

    def write(name: str, edges: dict, links: list) -> Path:
        path = tmp_path / f"{name}.net.xml"
        path.write_text(net_text(edges, links), encoding="utf-8")
        return path

    return write


@pytest.fixture
def straight(write_net) -> Path:
    """Two straight edges, 12 m apart, six lanes each; the second's rightmost lane is wider (as in SMARTS)."""
    edges = {
        "west": (np.array([[0.0, 15.0], [170.0, 15.0]]), [3.66] * 6),
        "east": (np.array([[182.0, 14.5], [450.0, 14.5]]), [4.66, *[3.66] * 5]),
        "ramp": (np.array([[0.0, -20.0], [170.0, -2.0]]), [3.66]),
    }
    links = [("west", "east", i, i) for i in range(6)] + [("ramp", "east", 0, 0)]
    return write_net("straight", edges, links)


@pytest.fixture
def bend(write_net) -> Path:
    """Three edges on an arc of radius 300 m drawn with a vertex every 15 m; the third has a lane more on the left
    and one less on the right, so two lanes run through."""
    angle = np.arange(0.0, 540.1, 15.0) / 300.0
    arc = np.column_stack([300.0 * np.sin(angle), 300.0 * (1.0 - np.cos(angle))])
    one_lane_left = arc[24:] * (1.0 - 3.5 / 300.0) + np.array([0.0, 3.5])
    edges = {"a": (arc[:13], [3.5] * 3), "b": (arc[12:25], [3.5] * 3), "c": (one_lane_left, [3.5] * 3)}
    links = [("a", "b", i, i) for i in range(3)] + [("b", "c", 1, 0), ("b", "c", 2, 1)]
    return write_net("bend", edges, links)
