#!/usr/bin/env bash
# libsumo 1.28.0: getAllowed of a lane that nobody may use is an empty list.
#
# Expected: an empty list stands for everybody, as an absent attribute does in network files.
# Seen:     disallow="all" gives an empty list; a lane for everybody gives every class.
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
<edge id="e" from="a" to="b" priority="-1">
<lane id="e_0" index="0" disallow="all" speed="10" length="300" shape="0,0 300,0"/>
<lane id="e_1" index="1" speed="10" length="300" shape="0,3 300,3"/></edge>
<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,3"/>
<junction id="b" type="dead_end" x="300" y="0" incLanes="e_0 e_1" intLanes="" shape="300,0 300,3"/></net>
"""
with tempfile.TemporaryDirectory() as folder:
    net = Path(folder) / "road.net.xml"
    net.write_text(NET, encoding="utf-8")
    libsumo.start(["sumo", "-n", str(net), "--no-warnings", "--no-step-log"])
    nobody, everybody = (len(libsumo.lane.getAllowed(f"e_{i}")) for i in range(2))
    libsumo.close()
print(
    f'classes that getAllowed names: {nobody} for disallow="all", {everybody} for a lane without permissions'
)
sys.exit(0 if nobody == 0 and everybody > 0 else 1)
PYTHON
"$folder/venv/bin/python" "$folder/seen.py"
