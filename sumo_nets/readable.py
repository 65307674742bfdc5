"""What kind of file a road's is, before anything is made of it: a network, or another of the files that go with one."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO
from xml.etree import ElementTree

from sumo_nets.errors import NetworkError

NEWEST = (1, 99)
OLDEST = (1, 0)  # networks before SUMO 1.0 have other junctions and connections
CONVERT = "netconvert makes a network of it"
OTHERS = {
    "routes": "SUMO's routes: give the .net.xml that they are for",
    "additional": "additional objects of SUMO: give the .net.xml that they are for",
    "configuration": "a configuration of SUMO: give the file that its <net-file> names",
    "sumoConfiguration": "a configuration of SUMO: give the file that its <net-file> names",
    "osm": f"a map of OpenStreetMap, not a SUMO network: {CONVERT}, as in netconvert --osm-files FILE -o road.net.xml",
    "OpenDRIVE": f"an OpenDRIVE road, not a SUMO network: {CONVERT}, as in netconvert --opendrive FILE -o road.net.xml",
    "OpenSCENARIO": "an OpenSCENARIO file, not a SUMO network: give the road that its <LogicFile> names",
    "commonRoad": "a CommonRoad scenario, not a SUMO network: convert its lanelets first (crdesigner), then netconvert",
    "nodes": f"plain nodes of SUMO: {CONVERT}, as in netconvert -n nod.xml -e edg.xml -o road.net.xml",
    "edges": f"plain edges of SUMO: {CONVERT}, as in netconvert -n nod.xml -e edg.xml -o road.net.xml",
    "connections": f"plain connections of SUMO: {CONVERT}, as in netconvert -n nod.xml -e edg.xml -x con.xml",
}


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """The file for reading, unpacked where it is a .gz."""
    with path.open("rb") as file:
        yield gzip.GzipFile(fileobj=file) if path.suffix == ".gz" else file  # type: ignore[misc]


def check_kind(path: Path) -> None:
    """NetworkError for a file that is no SUMO network of a version that can be read, by its first element."""
    try:
        with opened(path) as file:
            _, first = next(iter(ElementTree.iterparse(file, events=("start",))))
    except (ElementTree.ParseError, StopIteration, UnicodeError, LookupError) as error:  # of encodings, too
        raise NetworkError(f"{path} is no XML ({error}); a SUMO network is: give a .net.xml") from error
    except (OSError, EOFError, zlib.error) as error:
        raise NetworkError(f"{path} cannot be read: {error}") from error
    kind = first.tag.rpartition("}")[2]
    if kind != "net":
        what = OTHERS.get(
            kind, f"a file of <{kind[:60]}>, not a SUMO network: run netconvert on what it was made from"
        )
        raise NetworkError(f"{path} is {what}")
    version = first.get("version", "")
    try:
        number = tuple(int(part) for part in version.split(".")[:2])
    except ValueError:
        number = ()
    if version and not OLDEST <= number <= NEWEST:
        raise NetworkError(
            f"{path} is a SUMO network of version {version}, and 1.0 or newer is needed: "
            "netconvert -s FILE -o NEW.net.xml writes it anew"
        )
