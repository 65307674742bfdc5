"""Whether SUMO itself can load a network and let a vehicle onto the road, asked in a process of its own.

Some networks end the process that loads them, so that no caller could say what is wrong.

    python -m service.world.sim.sumo_check NETWORK EDGE...
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from service.errors import SimulationError
from service.world.sim.sumo import CONTROLLED_CLASS
from service.world.sim.sumo_library import REFUSALS, close_simulation, open_simulation, options_for

LONGEST_S = 300.0
SHOWN = 300  # characters of what SUMO says
SOURCES = Path(__file__).resolve().parents[3]


def check_in_sumo(network: str, edges: Sequence[str]) -> None:
    """SimulationError, in one line, where SUMO cannot load the network or does not let a vehicle drive its edges."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(SOURCES), os.environ.get("PYTHONPATH", "")])
    }
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__, network, *edges],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=LONGEST_S,
            check=False,
            env=environment,
        )
    except subprocess.TimeoutExpired as error:
        raise SimulationError(
            f"SUMO does not load {network} within {LONGEST_S:g} s; give a smaller part of it"
        ) from error
    if done.returncode == 0:
        return
    said = [line.strip() for line in done.stderr.splitlines() if line.strip().startswith("Error")]
    said = said or [line.strip() for line in done.stderr.splitlines() if line.strip()][-1:]
    reason = " ".join(said)[:SHOWN] or f"its process ended with {done.returncode}"
    raise SimulationError(f"SUMO cannot use {network}: {reason} Build it anew with netconvert")


def main(arguments: list[str]) -> int:
    """Load the network, put a vehicle on each lane of the first edge, and drive a step."""
    network, edges = arguments[0], arguments[1:]
    owner = object()
    try:
        sumo = open_simulation(owner, options_for(network, 0.1))
        sumo.route.add("checked", edges)
        sumo.vehicletype.copy("DEFAULT_VEHTYPE", "checked")
        sumo.vehicletype.setVehicleClass("checked", CONTROLLED_CLASS)
        sumo.vehicle.add("checked", "checked", typeID="checked", departSpeed="0")
        sumo.simulationStep()
        sumo.simulationStep()
    except (SimulationError, *REFUSALS) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    entered = "checked" in sumo.vehicle.getIDList()
    close_simulation(owner)
    if not entered:
        print("Error: it lets no vehicle onto the first edge.", file=sys.stderr)
    return 0 if entered else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
