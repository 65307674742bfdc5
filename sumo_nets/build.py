"""Build a built-in network: raw geometry -> plain XML sources -> SUMO net.

python -m sumo_nets.build sources --geometry DIR     (when the geometry changes; sources are committed)
python -m sumo_nets.build net [--netconvert PATH]    (so is the net; needs SUMO's netconvert, 1.28 was used)
python -m sumo_nets.build lanes                      (so are the lanes read from it, with one processor's bits for all)
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path

from sumo_nets import i80_geometry, us101_geometry
from sumo_nets.corridor import LANES_FILE, built_in_folder, read_corridor
from sumo_nets.errors import NetworkError
from sumo_nets.stored import store_lanes

GEOMETRIES = {"i80": i80_geometry, "us101": us101_geometry}
NETCONVERT_OPTIONS = (
    "--offset.disable-normalization",
    "--no-turnarounds",
    "--junctions.minimal-shape",
    "--precision=4",
    "--default.spreadtype=right",
    "--no-warnings=false",
)


def write_sources(name: str, geometry: Path, folder: Path | None = None) -> list[Path]:
    """Write the plain XML, the corridor's description and the check's reference lines; returns the files."""
    folder = folder or built_in_folder(name)
    sources = GEOMETRIES[name]
    raw = sources.read_geometry(Path(geometry))
    road = sources.make_road(raw)
    texts = {f"{name}.{suffix}.xml": text for suffix, text in road.plain_xml().items()}
    texts["corridor.json"] = json.dumps(sources.description(road), indent=1) + "\n"
    texts["reference_lines.json"] = json.dumps(sources.reference_lines(raw), separators=(",", ":")) + "\n"
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")
    return [folder / file for file in texts]


def find_netconvert(given: str | None = None) -> str:
    """Path of netconvert: as given, else $NETCONVERT, else beside this Python, else on PATH; NetworkError if none."""
    wanted = given or os.environ.get("NETCONVERT") or "netconvert"
    found = shutil.which(wanted, path=sysconfig.get_path("scripts")) or shutil.which(wanted)
    if found is None:
        raise NetworkError(
            f"no program {wanted!r}; netconvert comes with SUMO (for example `pip install eclipse-sumo`): "
            "put it on PATH or give it with --netconvert"
        )
    return found


def build_net(name: str, netconvert: str | None = None, out: Path | None = None) -> Path:
    """Run netconvert on the plain XML of a built-in network; without dates and machine paths in it."""
    folder = built_in_folder(name)
    out = out or folder / f"{name}.net.xml"
    program = find_netconvert(netconvert)
    with tempfile.TemporaryDirectory() as scratch:
        fresh = Path(scratch) / "net.xml"
        files = [
            f"--node-files={folder / f'{name}.nod.xml'}",
            f"--edge-files={folder / f'{name}.edg.xml'}",
            f"--connection-files={folder / f'{name}.con.xml'}",
        ]
        done = subprocess.run(
            [program, *files, *NETCONVERT_OPTIONS, f"--output-file={fresh}"],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode or not fresh.exists():
            raise NetworkError(f"netconvert failed on {folder}: {done.stderr.strip() or done.stdout.strip()}")
        text = fresh.read_text(encoding="utf-8")
    header = f"<!-- {name}: built by `python -m sumo_nets.build net`; data attribution in ATTRIBUTION.md -->"
    out.write_text(re.sub(r"<!--.*?-->", header, text, count=1, flags=re.DOTALL), encoding="utf-8")
    return out


def build_lanes(name: str) -> Path:
    """Read the lanes of a built-in network from its net, and keep them."""
    folder = built_in_folder(name)
    edges = json.loads((folder / "corridor.json").read_text(encoding="utf-8"))["edges"]
    return store_lanes(read_corridor(folder / f"{name}.net.xml", edges, name=name), folder / LANES_FILE)


def main(arguments: list[str] | None = None) -> None:
    """Entry point of `python -m sumo_nets.build`."""
    parser = argparse.ArgumentParser(prog="python -m sumo_nets.build", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    make = commands.add_parser("sources", help="plain XML from the raw geometry files")
    make.add_argument("--geometry", type=Path, required=True, help="folder with the CAD and OSM files")
    net = commands.add_parser("net", help="the SUMO net from the plain XML")
    net.add_argument("--netconvert", help="path of netconvert (default: $NETCONVERT, then PATH)")
    lanes = commands.add_parser("lanes", help="the lanes as arrays from the net")
    for command in (make, net, lanes):
        command.add_argument("--name", default="i80", help="built-in network")
    options = parser.parse_args(arguments)
    try:
        if options.command == "sources":
            written = write_sources(options.name, options.geometry)
        elif options.command == "lanes":
            written = [build_lanes(options.name)]
        else:
            written = [build_net(options.name, options.netconvert)]
    except NetworkError as error:
        parser.exit(2, f"error: {error}\n")
    for path in written:
        print(path)


if __name__ == "__main__":
    main()
