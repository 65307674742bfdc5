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
from service.studies.human import watching as W
from service.studies.human.campaign import Counts, Settings
from service.studies.human.published import INVOLVEMENTS, NEAR_CRASHES, NEAR_PER_CRASH, PUBLISHED
from service.studies.reproduce.page import Page, made_by, made_with, write_page
from service.studies.reproduce.tables import Table

CONFIDENCE = 0.95
NORMAL_QUANTILE = 1.959964  # of that confidence, two-sided
EPSILONS = (0.0, 0.01, 0.03, 0.1, 0.15, 0.2, 0.25, 0.3, 0.5)  # of the table of rates by epsilon
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


def rate(weights: np.ndarray, of: np.ndarray, rollouts: int, km: float, each: float = 1.0) -> Rate:
    """Of events with these weights (n,), in the rollouts numbered `of` (n,), of `rollouts` that drove `km` together.

    each: counted things that an event stands for (2: the vehicles of a pair).

    Events of one rollout need not be independent: its weights are added up first. An event that was not seen could
    have counted 1.
    """
    sums = _by_rollout(weights, of)
    p, variance = sums.sum() / rollouts, float(sums @ sums) / rollouts**2
    largest = max(1.0, sums.max(initial=0.0)) / rollouts
    low, high = weighted_gamma(p, variance, largest, CONFIDENCE)
    seen = int(np.sign(weights).sum())
    if km <= 0.0:
        return Rate(seen, 0.0, 0.0, 0.0, math.inf)
    per = each * MILLION * rollouts / km
    return Rate(seen, km / MILLION, float(p * per), float(low * per), float(high * per))


def _by_rollout(weights: np.ndarray, of: np.ndarray) -> np.ndarray:
    return np.bincount(np.unique(of, return_inverse=True)[1], weights) if len(of) else np.zeros(0)


def weights_of(rows: np.ndarray, epsilon: float | None) -> np.ndarray:
    """What events (n, 1 + EVENT) count for: as found (epsilon None), or on trees of forced leaks under that epsilon."""
    if epsilon is None:
        return rows[:, 1 + W.WEIGHT]
    path = epsilon ** rows[:, 1 + W.LEAKED] * (1.0 - epsilon) ** rows[:, 1 + W.RESISTED]
    return rows[:, 1 + W.WEIGHT] * path


def facts(settings: Settings, counts: Counts) -> dict[str, Any]:
    """What the page and the JSON file tell."""
    human = settings.scenario.human
    epsilon = None if human is None else human.glances.epsilon
    rows = counts.events[counts.events[:, 1 + W.AGAIN] == 0.0]
    of, kinds = rows[:, 0], rows[:, 1 + W.KIND]
    weight = weights_of(rows, epsilon if settings.forced else None)
    early = rows[:, 1 + W.TIME_S] < W.EARLY_S
    contact, near = kinds != W.NEAR_CRASH, kinds == W.NEAR_CRASH
    masks = (early, ~early, np.ones(len(rows), dtype=bool))
    tallies = [counts.tallies[0], counts.tallies[1], counts.tallies.sum(axis=0)]
    parts: dict[str, dict[str, Any]] = {}
    for name, mask, tally in zip(PARTS, masks, tallies, strict=True):
        asked = {
            "contacts": (contact, 1.0),
            "involvements": (contact, 2.0),
            "near_crashes": (near, 2.0),
            "near_by_time": (near & (rows[:, 1 + W.CAUSE] == 0.0), 2.0),
            "near_by_deceleration": (near & (rows[:, 1 + W.CAUSE] == 1.0), 2.0),
        } | {kind: (kinds == k, 1.0) for k, kind in enumerate(W.KINDS)}
        parts[name] = {
            key: rate(weight[mask & which], of[mask & which], counts.rollouts, float(tally[W.KM]), each)
            for key, (which, each) in asked.items()
        }
    km = float(tallies[2][W.KM])
    tried = EPSILONS if settings.forced else ()
    crashed, share = rows[contact], weight[contact]
    again = counts.events[(counts.events[:, 1 + W.AGAIN] != 0.0)]
    sums = _by_rollout(share, of[contact])
    return {
        "scenario": settings.scenario.name,
        "ego": settings.ego,
        "seed": settings.seed,
        "epsilon": epsilon,
        "forced": settings.forced,
        "rollouts": counts.rollouts,
        "outcomes": counts.outcomes,
        "in_sumo": counts.in_sumo,
        "parts": parts,
        "by_epsilon": [
            {
                "epsilon": value,
                "involvements": rate(weights_of(crashed, value), of[contact], counts.rollouts, km, 2.0),
                "near_crashes": rate(weights_of(rows[near], value), of[near], counts.rollouts, km, 2.0),
            }
            for value in tried
        ],
        "effective_contacts": float(sums.sum() ** 2 / (sums @ sums)) if sums.any() else 0.0,
        "delta_v_mps": _quantiles(crashed[:, 1 + W.DELTA_V_MPS], share),
        "looked_away": float(share @ crashed[:, 1 + W.LOOKED_AWAY] / share.sum()) if share.any() else None,
        "secondary_contacts": int((again[:, 1 + W.KIND] != W.NEAR_CRASH).sum()),
        "near_per_crash": _ratio(weight, of, near, contact),
    }


def _ratio(
    weight: np.ndarray, of: np.ndarray, near: np.ndarray, contact: np.ndarray
) -> tuple[float, float, float] | None:
    """Near-crashes to a crash, with its interval by the delta method on the logarithm; None without a contact."""
    numbers, rollout = np.unique(of, return_inverse=True)
    above = np.bincount(rollout, weight * near, len(numbers))
    below = np.bincount(rollout, weight * contact, len(numbers))
    if above.sum() <= 0.0 or below.sum() <= 0.0:
        return None
    error = float(np.sqrt(np.sum((above / above.sum() - below / below.sum()) ** 2)))
    value, factor = float(above.sum() / below.sum()), math.exp(NORMAL_QUANTILE * error)
    return value, value / factor, value * factor


def _quantiles(values: np.ndarray, weight: np.ndarray) -> list[float]:
    """SPEEDS of weighted values; empty where none weighs anything."""
    if weight.sum() <= 0.0:
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
    tables += [_by_epsilon(one) for one in told if one["by_epsilon"]]
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
    said = "not known, as there was no contact"
    if ratio is not None:
        value, low, high = ratio
        said = f"{significant(value)} ({significant(low)} to {significant(high)})"
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
    if not one["forced"]:
        return ""
    return (
        " Leaks are forced: each rollout is a tree that branches where a glance was suppressed in a conflict, its "
        "events count epsilon^L (1 - epsilon)^R for L leaks and R suppressed glances until then, kilometres are those "
        f"of its stem; the contacts are worth {one['effective_contacts']:.0f} of equal weight."
    )


def _by_epsilon(one: dict[str, Any]) -> Table:
    rows = tuple(
        (f"{at['epsilon']:g}", _said(at["involvements"]), _said(at["near_crashes"]))
        for at in one["by_epsilon"]
    )
    return Table(
        f"By epsilon, per million vehicle-km: {one['scenario']}",
        ("epsilon", "involvements", "near-crashes, of vehicles"),
        rows,
        "All from the same trees. An interval's upper end allows for a contact without any leak, which counts 1.",
    )


def _kinds(one: dict[str, Any]) -> Table:
    whole = one["parts"]["together"]
    found = {kind: whole[kind] for kind in W.KINDS} | {
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
