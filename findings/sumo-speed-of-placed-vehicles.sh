#!/usr/bin/env bash
# libsumo 1.28.0: the speed of a vehicle that moveToXY places each step is not the one it is driven at.
#
# Expected: 25 m/s driven, 2.5 m every 0.1 s, is a speed of 25 m/s in every step.
# Seen:     0 in the first step and the limit's multiple elsewhere; setSpeed before and setPreviousSpeed after the step
#           give 25 everywhere.
# Ends with 0 while that is so, with 1 once it has changed.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check libsumo==1.28.0
cat > "$folder/seen.py" <<'PYTHON'
import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("SUMO_HOME", tempfile.gettempdir())
import libsumo

NET = """<net version="1.20"><location netOffset="0,0" convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="!"/>
<edge id="e" from="a" to="b" priority="-1"><lane id="e_0" index="0" speed="10" length="900" shape="0,0 300,0"/></edge>
<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,1"/>
<junction id="b" type="dead_end" x="300" y="0" incLanes="e_0" intLanes="" shape="300,0 300,1"/></net>
"""


def speeds(path: Path, told: bool) -> list[float]:
    libsumo.start(["sumo", "-n", str(path), "--step-length", "0.1", "--no-warnings", "--no-step-log"])
    libsumo.route.add("r", ["e"])
    libsumo.vehicle.add("v", "r", departSpeed="0")
    libsumo.vehicle.setSpeedMode("v", 0)
    found = []
    for k in range(60):
        libsumo.vehicle.moveToXY("v", "e", 0, 50.0 + 2.5 * k, 0.0, 90.0, 2, 10.0)
        if told:
            libsumo.vehicle.setSpeed("v", 25.0)
        libsumo.simulationStep()
        if told:
            libsumo.vehicle.setPreviousSpeed("v", 25.0)
        found.append(libsumo.vehicle.getSpeed("v"))
    libsumo.close()
    return found


with tempfile.TemporaryDirectory() as folder:
    net = Path(folder) / "road.net.xml"
    net.write_text(NET, encoding="utf-8")
    left, told = speeds(net, False), speeds(net, True)
print(
    f"driven at 25 m/s: SUMO says {left[0]:.2f}, then {min(left[1:]):.2f} to {max(left[1:]):.2f}; expected 25"
)
print(f"with setSpeed and setPreviousSpeed: {min(told):.2f} to {max(told):.2f}")
sys.exit(0 if left[0] == 0.0 and max(left) != 25.0 and set(told) == {25.0} else 1)
PYTHON
"$folder/venv/bin/python" "$folder/seen.py"
