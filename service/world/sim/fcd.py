"""Floating-car data of a rollout in SUMO's format, with the speeds and places that the kernels have.

SUMO's own writer would give what it makes of vehicles that are placed: speeds capped, and 0 at joints.
"""

from pathlib import Path
from typing import IO, Any
from xml.sax.saxutils import quoteattr

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<fcd-export version="1.20">\n'


class FcdWriter:
    """Writes a file that holds the latest rollout; use `begin`, then `see` after each step, then `close`."""

    def __init__(self, path: Path, step_s: float):
        self._path, self._step_s = path, step_s
        self._file: IO[str] | None = None
        self._steps = 0

    def begin(self) -> None:
        self.close()
        self._file = self._path.open("w", encoding="utf-8")
        self._file.write(HEAD)
        self._steps = 0

    def see(self, sumo: Any, placed: dict[str, tuple[float, float, float]]) -> None:
        """The state after a step of SUMO.

        placed: x, y (m, of the front bumper) and speed (m/s) of the vehicles that the kernels drive
        """
        if self._file is None:
            return
        self._file.write(f'    <timestep time="{self._steps * self._step_s:.2f}">\n')
        for name in sorted(sumo.vehicle.getIDList()):
            vehicle = sumo.vehicle
            x, y, speed = placed.get(name) or (*vehicle.getPosition(name), vehicle.getSpeed(name))
            self._file.write(
                f'        <vehicle id={quoteattr(name)} x="{x:.4f}" y="{y:.4f}" angle="{vehicle.getAngle(name):.4f}" '
                f'type={quoteattr(vehicle.getTypeID(name))} speed="{speed:.4f}" '
                f'pos="{vehicle.getLanePosition(name):.4f}" lane={quoteattr(vehicle.getLaneID(name))} '
                f'slope="{vehicle.getSlope(name):.2f}"/>\n'
            )
        self._file.write("    </timestep>\n")
        self._steps += 1

    def close(self) -> None:
        if self._file is not None:
            self._file.write("</fcd-export>\n")
            self._file.close()
            self._file = None
