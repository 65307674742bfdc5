"""The road of a scenario as ASAM OpenDRIVE, by SUMO's netconvert where that is installed.

Its coordinates are those of the SUMO network. What netconvert cannot say in OpenDRIVE is lost: a tapering lane has its
mean shape, stop lines are straight, and what lanes forbid by vehicle class is left out.
"""

import shutil
import subprocess
import sys
from pathlib import Path

from service.errors import SimulationError

TOOL = "netconvert"
MISSING = (
    f"the scenario names no road: {TOOL} of SUMO is not installed (pip install eclipse-sumo); with it the road is "
    "written beside the scenario as ASAM OpenDRIVE"
)
LIMIT_S = 300.0


def netconvert() -> str | None:
    """Where netconvert is: on the path, or beside this Python; None where it is not."""
    return shutil.which(TOOL) or shutil.which(TOOL, path=str(Path(sys.executable).parent))


def write_opendrive(net: str | Path, path: Path) -> None:
    """Write the road of a SUMO network; SimulationError where netconvert is missing or fails."""
    tool = netconvert()
    if tool is None:
        raise SimulationError(MISSING)
    command = [tool, "-s", str(net), "--opendrive-output", str(path), "--no-warnings", "true"]
    made = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
    if made.returncode or not path.exists():
        told = (made.stderr or made.stdout).strip().splitlines()
        raise SimulationError(
            f"{TOOL} could not make {path.name} of {net}: {told[-1] if told else 'it said nothing'}"
        )
