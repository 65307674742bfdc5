"""From counts to rates: per million vehicle-km, with exact intervals, and the page that holds them beside what people
do.

Intervals are Garwood's, exact for Poisson counts (Biometrika 28, 1936), at 95%.
"""

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy.special import gammaincinv

from ce.interval import clopper_pearson
from service.analysis.wording import count, significant
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
    """Events in so many million vehicle-km, and their rate per million with its interval."""

    events: float
    million_km: float
    rate: float
    low: float
    high: float


def rate(events: float, km: float, each: float = 1.0) -> Rate:
    """Of `events` that stand for `each` counted things (2: vehicles of a pair)."""
    n = max(events, 0.0)
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(gammaincinv(n, tail)) if n > 0.0 else 0.0
    high = float(gammaincinv(n + 1.0, 1.0 - tail))
    million = km / MILLION
    per = each / million if million > 0.0 else np.inf
    return Rate(n, million, n * per, low * per, high * per)


def facts(settings: Settings, counts: Counts) -> dict[str, Any]:
    """What the page and the JSON file tell."""
    primary = counts.contacts[counts.contacts[:, 1 + C.AGAIN] == 0.0]
    early = primary[:, 1 + C.TIME_S] < C.EARLY_S
    masks = (early, ~early, np.ones(len(primary), dtype=bool))
    tallies = [counts.tallies[0], counts.tallies[1], counts.tallies.sum(axis=0)]
    parts: dict[str, dict[str, Any]] = {}
    for name, mask, tally in zip(PARTS, masks, tallies, strict=True):
        km, found = float(tally[C.KM]), primary[mask]
        parts[name] = {
            "contacts": rate(len(found), km),
            "involvements": rate(len(found), km, 2.0),
            "near_crashes": rate(float(tally[C.NEAR]), km, 2.0),
            "near_by_time": rate(float(tally[C.NEAR_TTC]), km, 2.0),
            "near_by_deceleration": rate(float(tally[C.NEAR_REQUIRED]), km, 2.0),
            "kinds": {
                kind: rate(int((found[:, 1 + C.KIND] == k).sum()), km) for k, kind in enumerate(C.KINDS)
            },
        }
    speeds = primary[:, 1 + C.DELTA_V_MPS]
    human = settings.scenario.human
    return {
        "scenario": settings.scenario.name,
        "ego": settings.ego,
        "seed": settings.seed,
        "epsilon": None if human is None else human.glances.epsilon,
        "rollouts": counts.rollouts,
        "outcomes": counts.outcomes,
        "in_sumo": counts.in_sumo,
        "parts": parts,
        "delta_v_mps": [] if not len(speeds) else np.quantile(speeds, SPEEDS).tolist(),
        "looked_away": int(primary[:, 1 + C.LOOKED_AWAY].sum()),
        "secondary_contacts": int(len(counts.contacts) - len(primary)),
        "near_per_crash": ratio(parts["together"]["near_crashes"], parts["together"]["involvements"]),
    }


def ratio(near: Rate, crashes: Rate) -> tuple[float | None, float, float | None]:
    """Near-crashes to crashes and its 95% interval (exact, of the share of the one among both); None: no upper end."""
    a, b = near.events, crashes.events
    if a + b == 0:
        return None, 0.0, None
    low, high = clopper_pearson(a, int(a + b), CONFIDENCE)
    upper = float(high / (1.0 - high)) if high < 1.0 else None
    return (a / b if b else None), float(low / (1.0 - low)), upper


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
        "Epsilon is the one number that is set on these rates, on the involvements of `i80` over its 2 km; "
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

    middle, low, high = one["near_per_crash"]
    said = "-" if middle is None else significant(middle)
    return (
        f"{where(found, INVOLVEMENTS, 'involvements')}; {where(near, NEAR_CRASHES, 'near-crashes')}; near-crashes to a "
        f"crash {said} ({significant(low)} to {'any number' if high is None else significant(high)}), people's "
        f"{NEAR_PER_CRASH[0]:g} to {NEAR_PER_CRASH[1]:g}."
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
        + f"Of the contacts' causers {one['looked_away']} had been looking away within 1.5 s. Contacts of vehicles "
        f"that had been in one before: {one['secondary_contacts']}, not counted."
    )
    return Table(
        f"Rates per million vehicle-km: {one['scenario']}",
        ("", "million vehicle-km", "contacts", "contacts, rate", "involvements", "near-crashes, of vehicles"),
        tuple(rows),
        note,
    )


def _kinds(one: dict[str, Any]) -> Table:
    whole = one["parts"]["together"]
    found = whole["kinds"] | {
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
