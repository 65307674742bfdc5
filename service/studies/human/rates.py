"""From counts to rates: per million vehicle-km, with exact intervals, and the page that holds them beside what people
do.

Intervals are Fay and Feuer's at 95% (`ce.interval`): Garwood's exact ones for Poisson counts where all weigh the same.
"""

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ce.interval import weighted_gamma
from service.analysis.wording import count, percent, significant
from service.studies.human import counting as C
from service.studies.human.campaign import Counts, Settings
from service.studies.human.published import INVOLVEMENTS, NEAR_CRASHES, NEAR_PER_CRASH, PUBLISHED
from service.studies.reproduce.page import Page, made_by, made_with, write_page
from service.studies.reproduce.tables import Table

CONFIDENCE = 0.95
PARTS = ("first 10 s", "after", "together")
MILLION = 1e6
SPEEDS = (0.05, 0.25, 0.5, 0.75, 0.95)  # quantiles of delta-v


class Rate(msgspec.Struct, frozen=True):
    """Events (pairs that were counted), in so many million vehicle-km; their rate per million with its interval."""

    events: int
    million_km: float
    rate: float
    low: float
    high: float


def rate(weights: np.ndarray, rollouts: int, km: float, each: float = 1.0) -> Rate:
    """Of events with these weights (n,), all 1 where epsilon was the scenario's own, in `rollouts` that drove `km`.

    each: counted things that an event stands for (2: the vehicles of a pair).
    """
    p, variance = weights.sum() / rollouts, float(weights @ weights) / rollouts**2
    largest = (weights.max() if len(weights) else 1.0) / rollouts
    low, high = weighted_gamma(p, variance, largest, CONFIDENCE)
    if km <= 0.0:
        return Rate(len(weights), 0.0, 0.0, 0.0, math.inf)
    per = each * MILLION * rollouts / km
    return Rate(len(weights), km / MILLION, float(p * per), float(low * per), float(high * per))


def weights_of(rows: np.ndarray, sampled: float, wanted: float) -> np.ndarray:
    """Likelihood ratios (n,) of contacts that were counted with epsilon = `sampled`, under epsilon = `wanted`.

    Until then so many glances had begun in a conflict and so many had been suppressed in one; each was an independent
    choice with probability epsilon.
    """
    if sampled == wanted:
        return np.ones(len(rows))
    leaked, resisted = rows[:, 1 + C.LEAKED], rows[:, 1 + C.RESISTED]
    return (wanted / sampled) ** leaked * ((1.0 - wanted) / (1.0 - sampled)) ** resisted


def facts(settings: Settings, counts: Counts, wanted: float | None = None) -> dict[str, Any]:
    """What the page and the JSON file tell; wanted: the epsilon that it is told for, default the one counted with."""
    human = settings.scenario.human
    sampled = None if human is None else human.glances.epsilon
    wanted = sampled if wanted is None else wanted
    rows = counts.contacts[counts.contacts[:, 1 + C.AGAIN] == 0.0]
    weight = np.ones(len(rows)) if sampled is None or wanted is None else weights_of(rows, sampled, wanted)
    early, kinds = rows[:, 1 + C.TIME_S] < C.EARLY_S, rows[:, 1 + C.KIND]
    contact, near = kinds != C.NEAR_CRASH, kinds == C.NEAR_CRASH
    masks = (early, ~early, np.ones(len(rows), dtype=bool))
    tallies = [counts.tallies[0], counts.tallies[1], counts.tallies.sum(axis=0)]
    parts: dict[str, dict[str, Any]] = {}
    for name, mask, tally in zip(PARTS, masks, tallies, strict=True):
        asked = {
            "contacts": (contact, 1.0),
            "involvements": (contact, 2.0),
            "near_crashes": (near, 2.0),
            "near_by_time": (near & (rows[:, 1 + C.CAUSE] == 0.0), 2.0),
            "near_by_deceleration": (near & (rows[:, 1 + C.CAUSE] == 1.0), 2.0),
        } | {kind: (kinds == k, 1.0) for k, kind in enumerate(C.KINDS)}
        parts[name] = {
            key: rate(weight[mask & which], counts.rollouts, float(tally[C.KM]), each)
            for key, (which, each) in asked.items()
        }
    crashed, share = rows[contact], weight[contact]
    again = counts.contacts[(counts.contacts[:, 1 + C.AGAIN] != 0.0)]
    whole = parts["together"]
    return {
        "scenario": settings.scenario.name,
        "ego": settings.ego,
        "seed": settings.seed,
        "epsilon": wanted,
        "counted_with_epsilon": sampled,
        "rollouts": counts.rollouts,
        "outcomes": counts.outcomes,
        "in_sumo": counts.in_sumo,
        "parts": parts,
        "effective_contacts": float(share.sum() ** 2 / (share @ share)) if len(share) else 0.0,
        "delta_v_mps": _quantiles(crashed[:, 1 + C.DELTA_V_MPS], share),
        "looked_away": float(share @ crashed[:, 1 + C.LOOKED_AWAY] / share.sum()) if len(share) else None,
        "secondary_contacts": int((again[:, 1 + C.KIND] != C.NEAR_CRASH).sum()),
        "near_per_crash": whole["near_crashes"].rate / whole["contacts"].rate / 2.0 if len(share) else None,
    }


def _quantiles(values: np.ndarray, weight: np.ndarray) -> list[float]:
    """SPEEDS of weighted values; empty where there are none."""
    if not len(values):
        return []
    order = np.argsort(values)
    below = np.cumsum(weight[order]) / weight.sum()
    return [float(values[order][min(int(np.searchsorted(below, q)), len(values) - 1)]) for q in SPEEDS]


def _said(found: Rate) -> str:
    return f"{significant(found.rate)} ({significant(found.low)} to {significant(found.high)})"


def page(told: list[dict[str, Any]], command: str) -> Page:
    """The page of campaigns in several scenarios."""
    tables = [_table(one) for one in told]
    tables += [_kinds(one) for one in told]
    tables.append(_published())
    return Page("driver-rates", "How often drivers crash", [made_by(command), *_introduction(told), made_with()],
                tables, [], told)  # fmt: skip


def write(told: list[dict[str, Any]], folder: Path, command: str) -> Path:
    """Write driver-rates.md and driver-rates/results.json below `folder`; returns the page's path."""
    plain = json.loads(msgspec.json.encode(told))
    return write_page(page(told, command)._replace(results=plain), folder)


def _introduction(told: list[dict[str, Any]]) -> list[str]:
    lines = [
        "Contacts and near-crashes among the environment vehicles under P0: the ego, driven by the policy named, is "
        "not counted. A contact is the first touch of two boxes that were in none before; an involvement is a vehicle "
        "in one. A near-crash is a pair that comes within 1.5 s of touching (boxes, at their velocities) while one of "
        "them brakes harder than 3 m/s^2 or steers with more than 2 m/s^2 to evade, or that needs more than 0.5 g to "
        "stay apart, and does not touch; its rate is per vehicle, two to a pair. Delta-v is half of the speed of the "
        "two relative to each other (equal masses that stay together). Intervals are 95%, exact for Poisson counts."
    ]
    for one in told:
        if one["epsilon"] is None:
            lines.append(f"`{one['scenario']}` has no human table: its drivers neither look away nor evade.")
            continue
        whole = one["parts"]["together"]
        lines.append(f"`{one['scenario']}`, epsilon = {one['epsilon']:g}: {_verdict(whole, one)}")
    lines.append(
        "Epsilon is the one number to be set on these rates, on the involvements of `i80` over its 2 km; "
        "near-crashes, their ratio to crashes and delta-v are not tuned. NGSIM's own tail cannot set it: extreme "
        "values fitted to its times to collision allow 0 to 11,000 crashes per million km."
    )
    return lines


def _verdict(whole: dict[str, Any], one: dict[str, Any]) -> str:
    found, near = whole["involvements"], whole["near_crashes"]

    def where(value: Rate, band: tuple[float, float], what: str) -> str:
        if band[0] <= value.rate <= band[1]:
            place = "inside"
        else:
            reaches = value.low <= band[1] and value.high >= band[0]
            place = "outside, though its interval reaches," if reaches else "outside"
        return f"{what} {_said(value)}, {place} people's {band[0]:g} to {band[1]:g}"

    ratio = one["near_per_crash"]
    said = "not known, as there was no contact" if ratio is None else significant(ratio)
    return (
        f"{where(found, INVOLVEMENTS, 'involvements')}; {where(near, NEAR_CRASHES, 'near-crashes')}; near-crashes to a "
        f"crash: {said} (people's {NEAR_PER_CRASH[0]:g} to {NEAR_PER_CRASH[1]:g})."
    )


def _table(one: dict[str, Any]) -> Table:
    rows: list[tuple[str, ...]] = []
    for part in PARTS:
        here = one["parts"][part]
        rows.append(
            (part, f"{here['contacts'].million_km:.4f}", f"{here['contacts'].events:.0f}", _said(here["contacts"]),
             _said(here["involvements"]), _said(here["near_crashes"]))
        )  # fmt: skip
    speeds = ", ".join(f"{significant(v)}" for v in one["delta_v_mps"])
    note = (
        f"{count(one['rollouts'])} rollouts, ego `{one['ego']}`, seed {one['seed']}; {one['in_sumo']} of them in SUMO "
        "too, with the same bits. "
        + (f"Delta-v in m/s at the 5, 25, 50, 75 and 95% quantiles: {speeds}. " if speeds else "")
        + (
            f"{percent(one['looked_away'])} of contacts' causers had looked away within 1.5 s. "
            if speeds
            else ""
        )
        + f"Contacts of vehicles that had been in one before: {one['secondary_contacts']}, not counted."
        + _weighed(one)
    )
    return Table(
        f"Rates per million vehicle-km: {one['scenario']}",
        ("", "million vehicle-km", "contacts", "contacts, rate", "involvements", "near-crashes, of vehicles"),
        tuple(rows),
        note,
    )


def _weighed(one: dict[str, Any]) -> str:
    if one["epsilon"] == one["counted_with_epsilon"]:
        return ""
    return (
        f" Counted with epsilon = {one['counted_with_epsilon']:g} and weighed back by the likelihood ratio of the "
        "glances that began or were suppressed in a conflict until then: the contacts are worth "
        f"{one['effective_contacts']:.1f} of equal weight."
    )


def _kinds(one: dict[str, Any]) -> Table:
    whole = one["parts"]["together"]
    found = {kind: whole[kind] for kind in C.KINDS} | {
        "near-crashes by time to touch": whole["near_by_time"],
        "near-crashes by deceleration": whole["near_by_deceleration"],
    }
    rows = tuple((kind, f"{one.events:.0f}", _said(one)) for kind, one in found.items())
    head = ("", "pairs", "rate per million vehicle-km")
    return Table(f"By kind: {one['scenario']}", head, rows, "Contacts count pairs, near-crashes vehicles.")


def _published() -> Table:
    def said(band: tuple[float, float]) -> str:
        return (
            significant(band[0])
            if band[0] == band[1]
            else f"{significant(band[0])} to {significant(band[1])}"
        )

    rows = tuple((p.name, p.unit, said(p.per_million_km), p.source) for p in PUBLISHED)
    return Table("What people do, per million vehicle-km", ("", "unit", "rate", "source"), rows, "")
