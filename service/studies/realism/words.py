"""What the card says in words: what is good, what is not, and what the data cannot tell."""

from typing import Any

from policies.realism.measures import QUANTITIES
from service.studies.realism import models

Facts = dict[str, Any]
CLOSE = 1.25  # within this factor of a baseline counts as alike


def verdict(facts: Facts) -> dict[str, list[str]]:
    """Sentences about the drivers: "good" and "not"."""
    good: list[str] = []
    not_good: list[str] = []
    rows = facts["targets"]["rows"]
    for row in rows:
        reached = row["reached"]["twenty"]
        digits = "{:.2g}%" if not row["is_error"] else "{:.3g}"
        scale = 1.0 if row["is_error"] else 100.0
        value, target = (digits.format(scale * x) for x in (reached["value"], row["target"]))
        text = f"{row['label'][0].upper()}{row['label'][1:]}: {value}, target at most {target}"
        if row["is_error"]:
            text += f" (mean over vehicles, as published figures are made: {reached['mean']:.3g})"
        (good if reached["met"] else not_good).append(text + ".")
    site = facts["targets"]["site"]
    of = facts["sites"][site]
    own = of["models"][facts["weights"]]["twenty"]
    _lane_changes(of, own, good, not_good)
    _distributions(of, own, good, not_good)
    _baselines(facts, of, own, good, not_good)
    _stream(facts, not_good)
    return {"good": good, "not": not_good}


def _lane_changes(of: Facts, own: Facts, good: list[str], not_good: list[str]) -> None:
    people, drivers = (x["lane_changes_per_km"] for x in (of["people"], own))
    text = f"Lane changes a vehicle-km: {drivers['value']:.2f}, the same people {people['value']:.2f}"
    low, high = people["interval_95"]
    inside = low is not None and low <= drivers["value"] <= high
    (good if inside else not_good).append(f"{text} (95% interval {low:.2f} to {high:.2f}; few vehicles).")


def _distributions(of: Facts, own: Facts, good: list[str], not_good: list[str]) -> None:
    others = of["people"]["distances_of_training_vehicles"]
    near: list[str] = []
    far: list[str] = []
    for key, label in QUANTITIES.items():
        mine, people = own["distances"][key].get("jensen_shannon"), others[key].get("jensen_shannon")
        if mine is None or people is None:
            continue
        text = f"{label.split(',')[0].split(' up to')[0]} ({mine:.2f}, other people {people:.2f})"
        (near if mine <= CLOSE * people else far).append(text)
    if near:
        good.append(
            "About as far from the held-out people as other people are (Jensen-Shannon): "
            + ", ".join(near)
            + "."
        )
    if far:
        not_good.append("Further from the held-out people than other people are: " + ", ".join(far) + ".")


def _baselines(facts: Facts, of: Facts, own: Facts, good: list[str], not_good: list[str]) -> None:
    horizon = f"{facts['targets']['horizon_s']:g}"
    mine = own["errors"][horizon]["position_m"]["rms"]
    for model, by_protocol in of["models"].items():
        if model in (facts["weights"], models.STILL):
            continue
        theirs = by_protocol["twenty"]["errors"][horizon]["position_m"]["rms"]
        label = facts["labels"][model]
        if mine <= theirs:
            good.append(f"Position after {horizon} s: {mine:.3g} m, {label} {theirs:.3g} m.")
        else:
            not_good.append(
                f"Position after {horizon} s: {mine:.3g} m, {label} is closer with {theirs:.3g} m."
            )


def _stream(facts: Facts, not_good: list[str]) -> None:
    """What the traffic stream shows, if it shows anything wrong."""
    if not facts["stream"]:
        return
    own, recorded = facts["stream"]["models"][facts["weights"]], facts["stream"]["recorded"]
    density, speed = own["density_veh_per_km"], own["speed_mps"]
    text = (
        f"In a dense stream at I-80's demand: {density:.0f} vehicles a km at {speed:.1f} m/s, recorded "
        f"{recorded['density_veh_per_km']:.0f} at {recorded['speed_mps']:.1f} m/s"
    )
    if own["touching_share"] > 0.1:
        text += (
            f"; {100.0 * own['touching_share']:.0f}% of frames are in contact. The drivers cannot free themselves "
            "after a contact, so contacts pile up; handing such vehicles to another driver, as the service does, does "
            "not end them (decision 0081). Do not use these drivers for dense traffic"
        )
    if own["touching_share"] > 0.1 or abs(density / recorded["density_veh_per_km"] - 1.0) > 0.25:
        not_good.append(text + ".")


def caveats(facts: Facts) -> list[str]:
    """What the data cannot tell."""
    found = []
    for site, of in facts["sites"].items():
        found.append(
            f"{site}: {of['held_out_vehicles']} held-out vehicles in {of['windows']} overlapping windows of "
            f"{of['seconds']:g} s. Intervals draw vehicles anew; with so few they are themselves rough."
        )
    changes = facts["data"]["lane_changes"]
    parts = [
        f"{site} {of['lane_changes_main_lanes']} in {of['vehicle_km_main_lanes']:g} vehicle-km"
        for site, of in changes.items()
    ]
    return [
        *found,
        f"Thin evidence across the road: lane changes between main lanes are {', '.join(parts)}, all vehicles taken "
        "together.",
        "Recorded positions come from image tracking. They are smoothed (halved at 0.3 Hz along, 0.2 Hz across the "
        "road) before speeds and accelerations are taken; brakes shorter than about a second do not survive it, so "
        "people's hard brakes are undercounted. Models' motion is smoothed alike, but not for hard brakes.",
        "On I-80 lengths are estimates and widths are assumed (1.9 m): contacts of people and models rest on them.",
        "The I-80 scene is two and a half minutes of congested traffic of one afternoon; the recorded road is 530 m "
        "long, and a vehicle whose leader has left it sees an empty road (in “all at once” this is why everybody "
        "speeds up).",
        "Replayed vehicles do not react: one that is driven into, or that drives into a model from behind, counts as a "
        "contact of the model.",
    ]
