"""A road in ASAM OpenDRIVE as a SUMO network, by SUMO's netconvert, and what the network no longer says.

netconvert cuts a lane section where a lane becomes wide enough to drive on, and gives each piece one width: a lane that
opens or tapers comes in over all of it. An `<access>` whose restriction it does not know, as for HOV, is passed over.
Lanes of type stop come in as lanes for cars with its own table of types; with TYPES, hard shoulders are closed to motor
vehicles, and bus, taxi and HOV lanes are theirs.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import sumolib

from sumo_nets.asam_xml import root_of
from sumo_nets.build import find_netconvert
from sumo_nets.errors import NetworkError

SPEED_MPS = 36.11  # where a road states none
WIDTH_M = 3.65
FOR_CARS = ("driving", "entry", "exit", "onRamp", "offRamp", "mwyEntry", "mwyExit", "slipLane", "connectingRamp",
            "bidirectional")  # fmt: skip
FOR_SOME = {"bus": "bus", "taxi": "taxi", "HOV": "hov"}
CLOSED = ("stop", "shoulder")
# restrictions of <access> that netconvert keeps
KEPT = (
    "bicycle",
    "bus",
    "delivery",
    "emergency",
    "motorcycle",
    "passengerCar",
    "pedestrian",
    "taxi",
    "truck",
    "trucks",
)
UNEVEN_M = 0.3  # a lane whose width varies by more tapers
LIMIT_S = 300.0
LARGEST_BYTES = 512 << 20
SAMPLES = 9


@dataclass(frozen=True)
class Imported:
    """What came of a file.

    edges: id, lanes and length in m of each edge
    lost: what the network no longer says, a line each
    """

    edges: tuple[tuple[str, int, float], ...]
    lost: tuple[str, ...]


def import_opendrive(path: Path, out: Path, netconvert: str | None = None) -> Imported:
    """Write the SUMO network of an OpenDRIVE file. NetworkError, one line, where it is none or netconvert fails."""
    lost = _lost(_root(path))
    program = find_netconvert(netconvert)
    with tempfile.TemporaryDirectory() as folder:
        types, fresh = Path(folder) / "types.typ.xml", Path(folder) / "net.xml"
        types.write_text(_types(), encoding="utf-8")
        command = [
            program, f"--opendrive-files={path}", f"--type-files={types}", "--opendrive.curve-resolution=1",
            "--offset.disable-normalization", "--no-turnarounds", "--precision=4", f"--output-file={fresh}",
        ]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT_S)
        except subprocess.TimeoutExpired as error:
            raise NetworkError(f"{path}: netconvert took longer than {LIMIT_S:g} s") from error
        if done.returncode or not fresh.exists():
            told = [line for line in done.stderr.splitlines() if line.strip()] or ["it said nothing"]
            raise NetworkError(f"{path}: netconvert could not read it: {told[0].removeprefix('Error: ')}")
        try:
            net = sumolib.net.readNet(str(fresh))
        except Exception as error:  # of any kind: it was not written for files that are wrong
            raise NetworkError(f"{path}: netconvert's network cannot be read ({error})") from error
        edges = tuple((e.getID(), e.getLaneNumber(), float(e.getLength())) for e in net.getEdges())
        if not edges:
            raise NetworkError(f"{path}: no lane in it is for motor vehicles (types {', '.join(FOR_CARS)})")
        out.write_bytes(fresh.read_bytes())
    return Imported(edges, lost)


def _root(path: Path) -> ET.Element:
    root = root_of(path, "OpenDRIVE", LARGEST_BYTES)
    for element in root.iter():  # OpenDRIVE 1.6 and later may name a namespace
        element.tag = element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
    if root.tag != "OpenDRIVE":
        raise NetworkError(f"{path}: <{root.tag[:40]}>; expected an ASAM OpenDRIVE file")
    return root


def _lost(root: ET.Element) -> tuple[str, ...]:
    found = []
    for road in root.iter("road"):
        sections = road.findall("lanes/laneSection")
        starts = [_number(section, "s") for section in sections] + [_number(road, "length")]
        for section, start, end in zip(sections, starts[:-1], starts[1:], strict=True):
            for lane in section.iter("lane"):
                if lane.get("type") not in (*FOR_CARS, *FOR_SOME):
                    continue
                where = f"road {road.get('id')}, lane {lane.get('id')}"
                unknown = sorted({str(a.get("restriction")) for a in lane.iter("access")} - set(KEPT))
                if unknown:
                    found.append(
                        f"{where}: access for {', '.join(unknown)}, which netconvert does not know: edit allow and "
                        "disallow in the network"
                    )
                widths = _widths(lane, end - start)
                if widths and max(widths) - min(widths) > UNEVEN_M:
                    found.append(
                        f"{where}: {widths[0]:.2f} to {widths[-1]:.2f} m wide from {start:.0f} to {end:.0f} m; it "
                        "comes in over all of it, in pieces of one width each"
                    )
    return tuple(found)


def _widths(lane: ET.Element, length: float) -> list[float]:
    """The lane's width at SAMPLES places along its section."""
    parts = sorted(
        ([_number(part, key) for key in ("sOffset", "a", "b", "c", "d")] for part in lane.findall("width")),
        key=lambda part: part[0],
    )
    found = []
    for k in range(SAMPLES if parts else 0):
        at = length * k / (SAMPLES - 1)
        begin, a, b, c, d = next((part for part in reversed(parts) if part[0] <= at), parts[0])
        along = at - begin
        found.append(a + along * (b + along * (c + along * d)))
    return found


def _number(element: ET.Element, key: str) -> float:
    try:
        return float(element.get(key, "0"))
    except ValueError:
        return 0.0


def _types() -> str:
    common = f'priority="1" speed="{SPEED_MPS}" width="{WIDTH_M}"'
    lines = [f'<type id="{name}" {common} disallow="pedestrian rail_urban rail ship"/>' for name in FOR_CARS]
    lines += [f'<type id="{name}" {common} allow="{who}"/>' for name, who in FOR_SOME.items()]
    lines += [f'<type id="{name}" {common} disallow="all"/>' for name in CLOSED]
    return "<types>" + "".join(lines) + "</types>"
