#!/usr/bin/env bash
# netconvert 1.28.0 (eclipse-sumo) reading ASAM OpenDRIVE 1.7: hard shoulders, tapering lanes, permissions.
#
# Expected: a lane of type "stop" (the hard shoulder) is closed to cars, as OpenDRIVE means it; a lane that opens from
#           0 to 3.5 m over 100 m begins where it is wide enough; <access rule="allow" restriction="HOV"/> keeps others
#           off a lane, as restriction="bus" does, or a warning says that it was passed over.
# Seen:     cars may use the "stop" lane; the opening lane is there from its first metre, 1.8 m and then 3.5 m wide;
#           the rule for HOV is passed over without a word, that for buses is kept.
# Ends with 0 while that is so, with 1 once it has changed.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check eclipse-sumo==1.28.0
cat > "$folder/seen.py" <<'PYTHON'
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import sumo

LANE = '<lane id="{id}" type="{type}" level="false"><width sOffset="0" a="{a}" b="{b}" c="0" d="0"/>{more}</lane>'
LANES = "".join(
    LANE.format(id=-number, **lane)
    for number, lane in enumerate(
        (
            dict(type="driving", a="3.5", b="0", more=""),
            dict(type="driving", a="3.5", b="0", more='<access sOffset="0" rule="allow" restriction="bus"/>'),
            dict(type="driving", a="3.5", b="0", more='<access sOffset="0" rule="allow" restriction="HOV"/>'),
            dict(type="driving", a="0", b="0.035", more=""),
            dict(type="stop", a="3.0", b="0", more=""),
        ),
        1,
    )
)
ROAD = f"""<?xml version="1.0"?>
<OpenDRIVE><header revMajor="1" revMinor="7" name="r" north="9" south="-50" east="200" west="0"/>
<road name="r" length="100" id="1" junction="-1"><type s="0" type="motorway"/>
<planView><geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry></planView>
<lanes><laneSection s="0"><center><lane id="0" type="none" level="false"/></center>
<right>{LANES}</right></laneSection></lanes></road></OpenDRIVE>
"""
with tempfile.TemporaryDirectory() as folder:
    road, net = Path(folder) / "road.xodr", Path(folder) / "road.net.xml"
    road.write_text(ROAD, encoding="utf-8")
    program = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    done = subprocess.run([program, f"--opendrive-files={road}", f"--output-file={net}"], capture_output=True, text=True)
    print(f"netconvert ended with {done.returncode}: {(done.stderr.strip() or 'no message')!r}")
    found = [
        (lane.get("index"), lane.get("allow"), lane.get("disallow"), lane.get("width"), lane.get("length"))
        for lane in ElementTree.parse(net).getroot().iterfind("edge/lane")
        if not lane.get("id", ":").startswith(":")
    ]
for row in found:
    print("lane %s: allow %s, disallow %s, width %s, length %s" % row)


def for_cars(row):
    return (row[1] is None or "passenger" in row[1].split()) and "passenger" not in (row[2] or "").split()


lanes = len(found) // 2
stop, opening, carpools, buses = found[:4]
same = lanes == 5 and for_cars(stop) and for_cars(carpools) and not for_cars(buses)
same = same and (opening[3], found[lanes + 1][3]) == ("1.80", "3.50") and "HOV" not in done.stderr
sys.exit(0 if same else 1)
PYTHON
"$folder/venv/bin/python" "$folder/seen.py"
