"""What vehicles weigh, by class; the class is read off the size of the box, which is all that a scenario says."""

from collections.abc import Mapping

from service.errors import InputError
from service.world.scenario.schema import Scenario

# class, up to this length (m), mass (kg): typical laden masses, an assumption that --mass replaces
CLASSES = (
    ("motorcycle", 2.8, 300.0),
    ("car", 6.0, 1_600.0),
    ("van or light truck", 8.5, 5_000.0),
    ("truck", 13.0, 15_000.0),
    ("articulated truck", float("inf"), 30_000.0),
)


def class_of(length_m: float) -> tuple[str, float]:
    """Class of a vehicle of that length, and its mass (kg)."""
    return next((name, mass) for name, up_to, mass in CLASSES if length_m <= up_to)


def masses_of(scenario: Scenario, given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Mass (kg) of each vehicle of the scenario, by name.

    given: masses of some of them, in place of their class's. InputError for a vehicle that there is not.
    """
    found = {v.name: class_of(scenario.of(v, "length_m"))[1] for v in scenario.vehicles}
    for name, mass in (given or {}).items():
        if name not in found:
            raise InputError(f"mass of {name!r}: the scenario's vehicles are {', '.join(found)}")
        if not 0.0 < mass < float("inf"):
            raise InputError(f"mass of {name} = {mass}: give kilograms above 0")
        found[name] = mass
    return found
