"""libsumo, which holds one simulation a process: the only file that imports it."""

import os
import shutil
import sys
from pathlib import Path
from typing import Any

# SUMO looks for its data folder; ours never needs it, and an unset variable costs a warning.
os.environ.setdefault("SUMO_HOME", str(Path(__file__).parent))

import libsumo
import traci
from libsumo import constants

from service.errors import SimulationError

CONSTANTS = constants
REFUSALS = (libsumo.TraCIException, traci.TraCIException)  # SUMO knows no such vehicle, and the like

_owner: object | None = None
_simulation: Any = None


def options_for(network: str, step_s: float) -> list[str]:
    """SUMO's options for simulations here: nothing printed, nobody removed for a collision or for standing still."""
    return [
        "--net-file", network, "--step-length", str(step_s),
        "--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true",
        "--collision.action", "none", "--time-to-teleport", "-1",
    ]  # fmt: skip


def open_simulation(owner: object, options: list[str], gui: bool = False) -> Any:
    """SUMO with a simulation started, `owner`'s until `close_simulation`.

    gui: in a window, at real time

    SimulationError while another's is open, where SUMO refuses the options, and where there is no window to be had.
    """
    global _owner, _simulation
    if _owner is not None:
        raise SimulationError("this process already runs a SUMO simulation; close it first")
    if gui:
        _start_gui(options)
    else:
        try:
            libsumo.start(["sumo", *options])
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            net = options[options.index("--net-file") + 1]
            raise SimulationError(f"SUMO cannot load {net}: {error}") from error
    _owner, _simulation = owner, traci if gui else libsumo
    return _simulation


def close_simulation(owner: object) -> None:
    """End the owner's simulation; nothing where it has none."""
    global _owner
    if _owner is owner:
        _owner = None
        _simulation.close()


def _start_gui(options: list[str]) -> None:
    """SUMO's GUI in a process of its own, stepped through TraCI at real time."""
    beside = Path(sys.executable).parent / "sumo-gui"
    program = shutil.which("sumo-gui") or (str(beside) if beside.exists() else None)
    if program is None:
        raise SimulationError(
            "there is no sumo-gui; install SUMO, or eclipse-sumo from the Python package index"
        )
    if not os.environ.get("DISPLAY") and not os.environ.get("WAYLAND_DISPLAY"):
        raise SimulationError(
            "SUMO's GUI needs a screen, and DISPLAY names none; use --video or --frames here"
        )
    step_ms = round(1000.0 * float(options[options.index("--step-length") + 1]))
    try:
        traci.start([program, *options, "--start", "--quit-on-end", "--delay", str(step_ms)], numRetries=60)
    except (traci.TraCIException, traci.FatalTraCIError, OSError) as error:
        raise SimulationError(f"SUMO's GUI does not start: {error}") from error
