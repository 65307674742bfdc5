"""The card's facts as one JSON-ready dictionary, and the files they are written to."""

import json
import platform
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from policies.columns import Values
from policies.data.recordings import Recordings, load_recordings
from policies.data.scenes import DataError, Scene, summary
from policies.drivers import DriverModel, load_drivers
from policies.realism import published
from policies.realism.lane_changes import lane_changes
from policies.realism.measures import QUANTITIES, quantities
from policies.realism.recorded import lane_change_facts
from policies.realism.statistics import bins, distances, histogram, rounded
from policies.realism.tails import tail_facts
from service.errors import InputError
from service.studies.realism import models, stream
from service.studies.realism.drive import HUMAN, IDM_MOBIL, NETWORK, Model
from service.studies.realism.evaluate import (
    ERRORS,
    LENGTHS_S,
    PROTOCOLS,
    Measured,
    Runner,
    Window,
    evaluate,
    horizons,
    longest,
    recorded,
    shares,
)
from service.world.scenario.load import load_scenario
from service.world.scenario.schema import Scenario
from sumo_nets.corridor import load_corridor

BASELINE = "drivers-bc"
HISTOGRAM_PROTOCOL = "twenty"


@dataclass(frozen=True)
class Settings:
    """What a realism card is made of.

    weights: a shipped name or a path
    data: the pack's folder or one of imported tables
    samples: rollouts a window of a stochastic model
    with_krauss: SUMO's driver takes minutes
    human: a scenario with a human table, which stands around the weights as one more model
    """

    weights: str
    data: Path
    seed: int = 1
    samples: int = 2
    with_krauss: bool = True
    human: str = "i80"

    @property
    def command(self) -> str:
        return (
            f"tailroad drivers card --weights {self.weights} --data DIR --out DIR --seed {self.seed} "
            f"--samples {self.samples} --human {self.human}" + ("" if self.with_krauss else " --no-krauss")
        )


def make(settings: Settings, tell: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """All facts of the card. Raises DataError and WeightsError."""
    drivers = load_drivers(settings.weights)
    recordings = load_recordings(settings.data)
    human = load_scenario(settings.human)
    if human.human is None:
        raise InputError(
            f"--human {settings.human}: its drivers have no human table; give one that has, as i80"
        )
    tell("fitting IDM and MOBIL")
    fit = models.fitted(recordings)
    name = Path(settings.weights).stem
    labels = {name: f"drivers ({name})"}
    networks = {name: drivers}
    if name != BASELINE:
        networks[BASELINE] = load_drivers(BASELINE)
        labels[BASELINE] = f"behaviour cloning ({BASELINE})"
    labels[models.PEOPLE] = f"{name} who see, react and look away (human table of {settings.human})"
    labels |= models.LABELS
    sites = {}
    for site, scenes in recordings.sites.items():
        seconds, found = longest(scenes)
        if not found:
            continue
        with ExitStack() as stack:
            runners: dict[str, tuple[Runner, int]] = {
                n: (models.network(n, d, scenes, settings.seed), settings.samples)
                for n, d in networks.items()
            }
            runners[models.PEOPLE] = models.human(human, drivers, scenes, settings.seed), settings.samples
            runners[models.IDM] = models.idm_mobil(fit.values, scenes, settings.seed), settings.samples
            if settings.with_krauss:
                runners[models.KRAUSS] = stack.enter_context(models.krauss(settings.seed)), 1
            runners[models.STILL] = models.constant_speed(scenes, settings.seed), 1
            sites[site] = _site(site, scenes, seconds, found, runners, settings.seed, tell)
    if not sites:
        raise DataError(
            f"{settings.data}: no held-out vehicle is recorded for {LENGTHS_S[-1]:g} s with its neighbours; longer "
            "recordings are needed"
        )
    facts = {
        "what": "realism card of the driver model",
        "weights": name,
        "command": settings.command,
        "seed": settings.seed,
        "labels": {k: v for k, v in labels.items() if settings.with_krauss or k != models.KRAUSS},
        "protocols": {"one": "one replaced", "twenty": "twenty at once", "all": "all at once"},
        "method": drivers.card.get("method", ""),
        "taken_over": taken_over(drivers.card),
        "data": _data(recordings),
        "idm_mobil": fit.as_dict(),
        "stream": _stream(settings, networks, human, drivers, fit.values, tell),
        "sites": sites,
        "published": {"sources": list(published.SOURCES), "protocol": published.PROTOCOL},
        "versions": _versions(),
    }
    return facts | {"targets": _targets(facts, name)}


def _site(
    site: str, scenes: list[Scene], seconds: float, found: list[Window], runners: dict[str, tuple[Runner, int]],
    seed: int, tell: Callable[[str], None],
) -> dict[str, Any]:  # fmt: skip
    rng = np.random.default_rng(seed)
    people = recorded(scenes, found, seconds)
    data = {name: Values.joined(parts) for name, parts in people.quantity.items()}
    edges = {name: bins(values) for name, values in data.items()}
    shapes: dict[str, dict[str, list[float]]] = {
        name: {"people": _shape(data[name], edges[name])} for name in data
    }
    measured: dict[str, dict[str, Any]] = {}
    for name, (runner, samples) in runners.items():
        measured[name] = {}
        for protocol in PROTOCOLS:
            tell(f"{site}: {name}, {protocol}")
            facts, values = evaluate(runner, scenes, found, seconds, protocol, samples, data, rng)
            measured[name][protocol] = facts
            if protocol == HISTOGRAM_PROTOCOL:
                for quantity, x in values.items():
                    shapes[quantity][name] = _shape(x, edges[quantity])
    return {
        "seconds": seconds,
        "horizons_s": horizons(seconds),
        "windows": len(found),
        "held_out_vehicles": len(set(people.vehicle)),
        "vehicles_at_once": round(float(np.mean([len(w.whole) for w in found])), 1),
        "people": _people(people, scenes, data, rng),
        "models": measured,
        "histograms": {
            name: {"edges": [round(float(e), 5) for e in edges[name]], "shares": shapes[name]}
            for name in data
        },
    }


def _people(people: Measured, scenes: list[Scene], data: dict[str, Values], rng: np.random.Generator) -> dict:
    """The held-out vehicles themselves, and how far other people (the training vehicles) are from them."""
    others: dict[str, list[Values]] = {name: [] for name in QUANTITIES}
    for number, scene in enumerate(scenes):
        train = np.flatnonzero((scene.vehicle_id < scene.held_out_from) & scene.usable.any(axis=0))
        for name, values in quantities(scene, train).items():
            others[name].append(Values(values.x, values.vehicle + 10_000_000 * number))
    return {
        **shares(people.count, np.array(people.vehicle), rng),
        "tails": tail_facts(np.array(people.tail), np.array(people.vehicle), people.accepted, rng),
        "values": {
            name: {"mean": rounded(float(v.x.mean()), 4), "sd": rounded(float(v.x.std()), 4)}
            for name, v in data.items()
            if len(v.x)
        },
        "distances_of_training_vehicles": {
            name: distances(data[name], Values.joined(parts), rng) for name, parts in others.items()
        },
    }


def _stream(
    settings: Settings, networks: dict[str, DriverModel], human: Scenario, drivers: DriverModel, values: np.ndarray,
    tell: Callable[[str], None],
) -> dict[str, Any] | None:  # fmt: skip
    """The traffic stream at I-80's demand, where the data have it."""
    wanted = stream.demand(settings.data)
    if wanted is None:
        return None
    corridor = load_corridor("i80")
    driving = {name: Model(name, NETWORK, drivers) for name, drivers in networks.items()}
    driving[models.PEOPLE] = Model(models.PEOPLE, HUMAN, drivers, human=human)
    driving[models.IDM] = Model(models.IDM, IDM_MOBIL, values=values)
    found = {}
    for name, model in driving.items():
        tell(f"stream: {name}")
        found[name] = stream.of_model(model, corridor, wanted, None, settings.seed)
    if settings.with_krauss:
        tell("stream: krauss")
        found[models.KRAUSS] = stream.of_sumo(corridor, wanted, settings.seed)
    return {
        "demand_veh_per_h": round(3600.0 * float(wanted.flow.sum(axis=1).mean())),
        "recorded": stream.recorded_facts(wanted),
        "models": found,
    }


def _shape(values: Values, edges: np.ndarray) -> list[float]:
    return [round(float(x), 5) for x in histogram(values, edges)]


def _data(recordings: Recordings) -> dict[str, Any]:
    return {
        "files": recordings.files,
        "passed_over": recordings.passed_over,
        "scenes": [summary(scene) for scene in recordings.scenes],
        "lane_changes": {
            site: lane_change_facts(scenes, lane_changes(scenes)) for site, scenes in recordings.sites.items()
        },
    }


def taken_over(weights_card: dict[str, Any]) -> dict[str, float | list[float]] | None:
    """The weights' own figures on I-80 after 20 s, None where their card has none: one vehicle replaced and, as in the
    service, driven by another driver after a contact."""
    own = weights_card.get("metrics", {}).get("held_out_closed_loop", {}).get("i80", {}).get("20s")
    if own is None:
        return None
    return {
        "position_m": own["rmse_position_m"]["value"],
        "position_m_interval_95": own["rmse_position_m"]["interval_95"],
        "speed_mps": own["rmse_speed_mps"]["value"],
        "lane_offset_m": own["rmse_lateral_m"]["value"],
        "touching_share": own["collision_share"],
        "hard_brakes_share": own["hard_brake_share"],
        "off_road_share": own["off_road_share"],
    }


def _targets(facts: dict[str, Any], name: str) -> dict[str, Any]:
    """Each target beside what the drivers reached on I-80 (or the first site) at the horizon that the target names."""
    site = "i80" if "i80" in facts["sites"] else next(iter(facts["sites"]))
    at = facts["sites"][site]
    horizon = f"{min(published.TARGET_HORIZON_S, at['seconds']):g}"
    rows = []
    for key, (target, label) in published.TARGETS.items():
        reached: dict[str, Any] = {}
        for protocol in PROTOCOLS:
            of = at["models"][name][protocol]
            if key in ERRORS:
                error = of["errors"][horizon][key]
                reached[protocol] = {
                    "value": error["rms"], "interval_95": error["rms_interval_95"], "mean": error["mean"],
                    "mean_interval_95": error["mean_interval_95"], "met": error["rms"] <= target,
                    "met_by_mean": error["mean"] <= target,
                }  # fmt: skip
            else:
                reached[protocol] = {
                    "value": of[key]["value"], "interval_95": of[key]["interval_95"],
                    "met": of[key]["value"] <= target,
                }  # fmt: skip
        rows.append(
            {"key": key, "label": label, "target": target, "is_error": key in ERRORS, "reached": reached}
        )
    return {"site": site, "horizon_s": float(horizon), "rows": rows}


def _versions() -> dict[str, str]:
    import numba
    import polars
    import scipy

    return {
        "python": platform.python_version(),
        **{m.__name__: m.__version__ for m in (np, scipy, numba, polars)},
    }


def write(facts: dict[str, Any], out: Path) -> tuple[Path, Path]:
    """OUT/NAME-realism.html and OUT/NAME-realism.json."""
    from service.studies.realism.page import page_of

    out.mkdir(parents=True, exist_ok=True)
    page, numbers = (out / f"{facts['weights']}-realism.{suffix}" for suffix in ("html", "json"))
    page.write_text(page_of(facts), encoding="utf-8")
    numbers.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    return page, numbers
