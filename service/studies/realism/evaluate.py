"""Models against held-out vehicles of one site: windows, protocols, and what is measured in them.

one     one held-out vehicle is driven by the model, all others replay and do not react to it
twenty  the held-out vehicles and others drawn at random, MANY in all, are driven at once (with one xi, as in a
        rollout of the service), the others replay: as the published figures were made (20 to 100 at once)
all     every vehicle that is there for the whole window is driven at once

Measured are the held-out vehicles.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from policies.columns import Values
from policies.data.scenes import EDGE_FRAMES, Scene
from policies.realism.driven import Driven, window_of
from policies.realism.measures import QUANTITIES, Counts, counts, errors, quantities, resmoothed
from policies.realism.statistics import distances, rate, root_mean_square, rounded
from policies.realism.tails import gaps, tail_facts, tails

HORIZONS_S = (1.0, 2.0, 5.0, 8.0, 10.0, 15.0, 20.0)
LENGTHS_S = (20.0, 15.0, 10.0, 8.0, 5.0)
EVERY = 0.25  # of a window's length: how far apart windows start
MINIMUM_VEHICLES = 5
ERRORS = ("position_m", "speed_mps", "lane_offset_m")
PROTOCOLS = ("one", "twenty", "all")
MANY = 20
# (scene number, scene, first row, steps, columns, sample number) -> what the model drove
Runner = Callable[[int, Scene, int, int, np.ndarray, int], Driven]


@dataclass(frozen=True)
class Window:
    """Vehicles `held` (columns, held out) of scene `number` from row `first` on; `whole`: all that are there."""

    number: int
    first: int
    held: np.ndarray
    whole: np.ndarray


def windows(scenes: list[Scene], seconds: float) -> list[Window]:
    """Overlapping windows with a held-out vehicle that is there throughout, its neighbours known at the start."""
    found = []
    for number, scene in enumerate(scenes):
        steps, stride = round(seconds / scene.dt_s), round(EVERY * seconds / scene.dt_s)
        for first in range(EDGE_FRAMES, len(scene.frame) - steps, stride):
            there = scene.present[first : first + steps + 1].all(axis=0)
            held = there & scene.usable[first] & (scene.vehicle_id >= scene.held_out_from)
            if held.any():
                found.append(Window(number, first, np.flatnonzero(held), np.flatnonzero(there)))
    return found


def longest(scenes: list[Scene]) -> tuple[float, list[Window]]:
    """The longest window length with MINIMUM_VEHICLES held-out vehicles, and its windows."""
    for seconds in LENGTHS_S:
        found = windows(scenes, seconds)
        if len({(w.number, int(v)) for w in found for v in w.held}) >= MINIMUM_VEHICLES:
            return seconds, found
    return LENGTHS_S[-1], windows(scenes, LENGTHS_S[-1])


@dataclass
class Measured:
    """What one model did in all windows of a site under one protocol, row by row (r rows)."""

    vehicle: list[int]
    error: list[np.ndarray]
    count: list[Counts]
    quantity: dict[str, list[Values]]
    tail: list[np.ndarray]
    accepted: list[tuple[int, float, float]]

    def add(self, driven: Driven, held: np.ndarray, horizons: list[int], offset: int) -> None:
        chosen = np.isin(driven.who, held)
        self.vehicle += [offset + int(i) for i in driven.scene.vehicle_id[driven.who[chosen]]]
        self.error += list(errors(driven, horizons)[chosen])
        self.count += counts(driven.scene, driven.who[chosen], driven.accel[:, chosen])
        smoothed = resmoothed(driven)
        for name, values in quantities(smoothed, driven.who[chosen]).items():
            self.quantity[name].append(Values(values.x, values.vehicle + offset))
        self.tail += list(tails(smoothed, driven.who[chosen], driven.who))
        self.accepted += [(offset + v, lead, lag) for v, lead, lag in gaps(driven.scene, driven.who[chosen])]

    def facts(self, data: dict[str, Values], horizons_s: list[float], rng: np.random.Generator) -> dict:
        vehicle, error = np.array(self.vehicle), np.array(self.error)
        by_horizon: dict[str, dict] = {}
        for h, horizon in enumerate(horizons_s):
            by_horizon[f"{horizon:g}"] = {
                name: root_mean_square(error[:, h, k], vehicle, rng) for k, name in enumerate(ERRORS)
            }
        return {
            "rollouts": len(vehicle),
            "vehicles": len(np.unique(vehicle)),
            "errors": by_horizon,
            **shares(self.count, vehicle, rng),
            "tails": tail_facts(np.array(self.tail), vehicle, self.accepted, rng),
            "distances": {
                name: distances(data[name], Values.joined(self.quantity[name]), rng) for name in QUANTITIES
            },
        }


def empty() -> Measured:
    return Measured([], [], [], {name: [] for name in QUANTITIES}, [], [])


def shares(rows: list[Counts], vehicle: np.ndarray, rng: np.random.Generator) -> dict:
    """Shares of frames, and lane changes a vehicle-km."""
    column = {
        name: np.array([getattr(c, name) for c in rows], dtype=float) for name in Counts.__annotations__
    }
    found = {
        f"{name}_share": rate(column[name], column["frames"], vehicle, rng)
        for name in ("touching", "hard_brakes", "off_road")
    }
    return found | {"lane_changes_per_km": rate(column["lane_changes"], column["km"], vehicle, rng)}


def run(
    runner: Runner, scenes: list[Scene], found: list[Window], seconds: float, protocol: str, samples: int,
) -> Iterator[tuple[Driven, np.ndarray, int]]:  # fmt: skip
    """What the model drove, window by window, with the held-out columns and the scene's number."""
    for window in found:
        scene = scenes[window.number]
        steps = round(seconds / scene.dt_s)
        groups = [np.array([v]) for v in window.held] if protocol == "one" else [_many(window, protocol)]
        for who in groups:
            for sample in range(samples):
                yield (
                    runner(window.number, scene, window.first, steps, who, sample),
                    np.intersect1d(who, window.held),
                    window.number,
                )


def _many(window: Window, protocol: str) -> np.ndarray:
    if protocol == "all":
        return window.whole
    others = np.setdiff1d(window.whole, window.held)
    drawn = np.random.default_rng(window.first).permutation(others)[: max(MANY - len(window.held), 0)]
    return np.concatenate([window.held, np.sort(drawn)])


def recorded(scenes: list[Scene], found: list[Window], seconds: float) -> Measured:
    """The held-out vehicles themselves, in the same windows."""
    measured = empty()
    for window in found:
        scene = window_of(scenes[window.number], window.first, round(seconds / scenes[0].dt_s) + 1)
        offset = OFFSET * window.number
        measured.vehicle += [offset + int(i) for i in scene.vehicle_id[window.held]]
        measured.count += counts(scene, window.held, scene.accel[:, window.held])
        for name, values in quantities(scene, window.held).items():
            measured.quantity[name].append(Values(values.x, values.vehicle + offset))
        measured.tail += list(tails(scene, window.held, np.arange(len(scene.vehicle_id))))
        measured.accepted += [(offset + v, lead, lag) for v, lead, lag in gaps(scene, window.held)]
    return measured


OFFSET = 10_000_000  # scenes number their vehicles anew


def horizons(seconds: float) -> list[float]:
    return [h for h in HORIZONS_S if h <= seconds]


def evaluate(
    runner: Runner, scenes: list[Scene], found: list[Window], seconds: float, protocol: str, samples: int,
    data: dict[str, Values], rng: np.random.Generator, tick: Callable[[], None] = lambda: None,
) -> tuple[dict, dict[str, Values]]:  # fmt: skip
    """Facts of one model under one protocol, and the values that its distributions are drawn from."""
    measured = empty()
    at = [round(h / scenes[0].dt_s) for h in horizons(seconds)]
    for driven, held, number in run(runner, scenes, found, seconds, protocol, samples):
        measured.add(driven, held, at, OFFSET * number)
        tick()
    facts = measured.facts(data, horizons(seconds), rng)
    mean = np.mean([np.abs(e[:, 0]).mean() for e in measured.error])
    facts["mean_position_error_over_horizons_m"] = rounded(float(mean))
    return facts, {name: Values.joined(parts) for name, parts in measured.quantity.items()}
