"""The card's pictures."""

from typing import Any

import numpy as np

from policies.realism.measures import QUANTITIES
from policies.realism.published import TARGET_HORIZON_S, TARGETS
from service.analysis.report import ink
from service.analysis.report.ink import Picture
from service.studies.realism import models

Facts = dict[str, Any]
PEOPLE = "#1f1f1f"
# Okabe and Ito's colours, with line styles that differ too; the drivers of the card come first
LINES: dict[str, dict[str, Any]] = {
    models.PEOPLE: {"color": "#E69F00", "linestyle": (0, (5, 1))},
    models.IDM: {"color": "#009E73", "linestyle": "-."},
    models.KRAUSS: {"color": "#CC79A7", "linestyle": ":"},
    models.STILL: {"color": "#8c8c8c", "linestyle": (0, (1, 2))},
}
DRIVERS: tuple[dict[str, Any], ...] = (
    {"color": "#D55E00", "linestyle": "-"},
    {"color": "#0072B2", "linestyle": "--"},
)
ERRORS = {
    "position_m": "distance from the recorded position, m",
    "speed_mps": "difference in speed, m/s",
    "lane_offset_m": "difference in lateral position, m",
}


def line(facts: Facts, model: str) -> dict[str, Any]:
    """Keyword arguments of a model's lines."""
    if model in LINES:
        return LINES[model]
    return DRIVERS[0 if model == facts["weights"] else 1]


def error_pictures(facts: Facts, site: str, protocol: str) -> list[Picture]:
    """Errors by horizon, one picture a quantity."""
    of = facts["sites"][site]
    horizons = of["horizons_s"]
    found = []
    for key, label in ERRORS.items():
        sentences = []
        with ink.figure(3.0) as drawn:
            axes = drawn.add_subplot()
            for model, by_protocol in of["models"].items():
                rows = [by_protocol[protocol]["errors"][f"{h:g}"][key] for h in horizons]
                value = [row["rms"] for row in rows]
                low, high = zip(*(row["rms_interval_95"] for row in rows), strict=True)
                style = line(facts, model)
                if model == facts["weights"]:
                    axes.fill_between(horizons, low, high, color=style["color"], alpha=ink.BAND, linewidth=0)
                axes.plot(horizons, value, label=facts["labels"][model], marker="o", markersize=3, **style)
                sentences.append(f"{facts['labels'][model]} {value[-1]:.3g} after {horizons[-1]:g} s")
            if site == "i80" and horizons[-1] >= TARGET_HORIZON_S:
                axes.plot(
                    [TARGET_HORIZON_S], [TARGETS[key][0]], "*", color=PEOPLE, markersize=9, label="target"
                )
            axes.set_xlim(left=0)
            axes.set_ylim(bottom=0)
            axes.set_xlabel("seconds after the recorded start")
            axes.set_ylabel("root mean square")
            axes.legend(loc="upper left", fontsize=7.5)
            found.append(
                ink.picture(
                    drawn,
                    label[0].upper() + label[1:],
                    f"Root mean square {label} against time: " + "; ".join(sentences) + ".",
                    "",
                )
            )
    return found


def distribution_pictures(facts: Facts, site: str) -> list[Picture]:
    """Each quantity's distribution: people and models."""
    found = []
    for key, label in QUANTITIES.items():
        of = facts["sites"][site]["histograms"][key]
        edges = np.array(of["edges"])
        width = np.diff(edges)
        with ink.figure(2.6) as drawn:
            axes = drawn.add_subplot()
            axes.stairs(
                np.array(of["shares"]["people"]) / width, edges, fill=True, color="#d4d4d4", label="people"
            )
            top = 1e-9 + (np.array(of["shares"]["people"]) / width).max()
            for model, shares in of["shares"].items():
                if model in ("people", models.STILL):
                    continue
                axes.stairs(
                    np.array(shares) / width, edges, label=facts["labels"][model], **line(facts, model)
                )
            axes.set_xlabel(label)
            axes.set_ylabel("density")
            axes.set_ylim(0, 1.6 * top)
            if key == "speed_mps":
                axes.legend(loc="upper right", fontsize=7.5)
            own = facts["sites"][site]["models"][facts["weights"]]["twenty"]["distances"][key]
            found.append(
                ink.picture(
                    drawn,
                    label[0].upper() + label[1:],
                    f"Histograms of {label}: people in grey, models as lines. The drivers' Wasserstein distance from "
                    f"people is {own.get('wasserstein')}, their Jensen-Shannon distance {own.get('jensen_shannon')}.",
                    "",
                )
            )
    return found


def lane_change_picture(facts: Facts) -> Picture | None:
    """Recorded lane changes a vehicle-km by lane."""
    sites = facts["data"]["lane_changes"]
    with ink.figure(2.6) as drawn:
        axes = drawn.add_subplot()
        sentences = []
        for i, (site, of) in enumerate(sites.items()):
            rows = [row for row in of["by_lane"] if row["per_vehicle_km"] is not None]
            x = np.array([row["of"] for row in rows]) + 0.36 * (i - 0.5 * (len(sites) - 1))
            axes.bar(x, [row["per_vehicle_km"] for row in rows], width=0.34, label=site,
                     color=("#0072B2", "#E69F00", "#009E73", "#CC79A7")[i % 4])  # fmt: skip
            sentences.append(f"{site} {of['per_vehicle_km']} over all lanes")
        axes.set_xlabel("from lane (1 = leftmost)")
        axes.set_ylabel("changes a vehicle-km")
        axes.legend(fontsize=7.5)
        return ink.picture(
            drawn,
            "Recorded lane changes by lane",
            "Lane changes a vehicle-km by lane: " + "; ".join(sentences) + ".",
            "Between main lanes; ramps apart.",
        )
