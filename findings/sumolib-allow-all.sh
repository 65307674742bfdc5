#!/usr/bin/env bash
# sumolib 1.28.0: a lane with allow="all" is for a class called "all", and for nobody else.
#
# Expected: allow="all" admits every class, as SUMO itself reads it.
# Seen:     lane.allows("passenger") is False, getPermissions() is {"all"}.
# Ends with 0 while that is so, with 1 once it has changed.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check sumolib==1.28.0
cat > "$folder/seen.py" <<'PYTHON'
import sys
import tempfile
from pathlib import Path

import sumolib

NET = """<net version="1.20"><location netOffset="0,0" convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="!"/>
<edge id="e" from="a" to="b">
<lane id="e_0" index="0" allow="all" speed="29" length="100" shape="0,0 100,0"/></edge></net>
"""
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "all.net.xml"
    path.write_text(NET, encoding="utf-8")
    lane = sumolib.net.readNet(str(path)).getEdge("e").getLanes()[0]
admits, classes = lane.allows("passenger"), set(lane.getPermissions())
print(f'allow="all": allows("passenger") is {admits}, classes {classes}; expected: True')
sys.exit(0 if not admits else 1)
PYTHON
"$folder/venv/bin/python" "$folder/seen.py"
