"""The plots of what a job's search learned."""

from typing import Any

import numpy as np

import ce
from service.analysis.learned.parameters import FULL_NAMES, KINDS
from service.analysis.report import ink
from service.analysis.report.facts import XI_OUTPUTS, xi_shifts_sd
from service.analysis.report.ink import Picture
from service.analysis.wording import significant
from service.evaluation.record import JobRecord
from service.world.scenario.base import STARTS

Facts = dict[str, Any]
GRID = 120


def _named(key: str) -> tuple[str, str]:
    """What a coordinate of this key is called, and its unit."""
    name, unit = KINDS[key]
    return FULL_NAMES.get(key, name), unit


def learned_pictures(record: JobRecord, learned: Facts) -> list[Picture]:
    """What a job's search learned: densities where there is a proposal, else the spread of the dangerous rollouts."""
    proposal = record.proposal
    if learned["source"] == "proposal" and proposal is not None:
        return [
            *(marginals(record, proposal, j) for j in range(STARTS)),
            driver_shifts(record, proposal),
        ]
    if learned["source"] == "none":
        return []
    return [spreads(record, learned, j) for j in range(STARTS)]


def marginals(record: JobRecord, proposal: ce.Product, parameter: int) -> Picture:
    """Base and proposal densities of one start parameter, a row a vehicle."""
    base = record.problem.base
    vehicles = record.job.scenario.vehicles
    name, unit = _named(record.job.scenario.start_names[parameter])
    columns = [STARTS * i + parameter for i in range(len(vehicles))]
    # cell centres: at the very ends a density may be infinite
    cells = (np.arange(GRID) + 0.5) / GRID
    grids = [low + (high - low) * cells for low, high in map(base.marginal_range, columns)]
    before = [base.marginal_pdf(at, grid) for at, grid in zip(columns, grids, strict=True)]
    after = [proposal.marginal_pdf(at, grid) for at, grid in zip(columns, grids, strict=True)]
    scale = 0.9 / max(float(np.max(densities)) for densities in before + after)
    shifts = []
    with ink.figure(0.6 + 0.37 * len(vehicles)) as drawn:
        axes = drawn.add_subplot()
        for i, (grid, old, new) in enumerate(zip(grids, before, after, strict=True)):
            row = len(vehicles) - 1 - i
            axes.fill_between(grid, row, row + scale * old, color=ink.BASE, alpha=0.25, linewidth=0)
            axes.plot(grid, row + scale * new, color=ink.colour(record.job.method), linewidth=1.4)
            mean = float(np.sum(grid * new) / np.sum(new) - np.sum(grid * old) / np.sum(old))
            shifts.append(f"{vehicles[i].name} {mean:+.2g}")
        rows = np.arange(len(vehicles))[::-1]
        axes.set_yticks(rows, [ink.name_of(v.name, v.role == "ego") for v in vehicles])
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.set_ylim(-0.05, len(vehicles))
        axes.set_xlabel(f"{name}, {unit}")
        return ink.picture(
            drawn,
            f"Start: {name}",
            f"Densities of {name} under base and proposal for each vehicle; shifts of the mean in {unit}: "
            + ", ".join(shifts)
            + ".",
            "Grey: base distribution P0. Line: the proposal that the estimate is drawn from.",
        )


def spreads(record: JobRecord, learned: Facts, parameter: int) -> Picture:
    """Quantiles of one start under P0 and in the dangerous rollouts, a row a vehicle."""
    vehicles = record.job.scenario.vehicles
    key = record.job.scenario.start_names[parameter]
    name, unit = _named(key)
    mine = [p for p in learned["parameters"] if p["name"].endswith(f".{key}") and p["vehicle"]]
    colour = ink.colour(record.job.method)
    sentences = []
    with ink.figure(0.75 + 0.33 * len(vehicles)) as drawn:
        axes = drawn.add_subplot()
        for i, (vehicle, facts) in enumerate(zip(vehicles, mine, strict=True)):
            row = len(vehicles) - 1 - i
            for spread, up, shade in ((facts["base"], 0.17, ink.BASE), (facts["proposal"], -0.17, colour)):
                axes.plot([spread["q05"], spread["q95"]], [row + up] * 2, color=shade, linewidth=1.2)
                axes.plot(
                    [spread["q25"], spread["q75"]], [row + up] * 2, color=shade, linewidth=4.5, alpha=0.8
                )
                axes.plot(spread["q50"], row + up, "o", color="white", markeredgecolor=shade, markersize=4)
            shift = facts["proposal"]["mean"] - facts["base"]["mean"]
            sentences.append(f"{vehicle.name} {shift:+.2g}")
        axes.set_yticks(
            np.arange(len(vehicles))[::-1], [ink.name_of(v.name, v.role == "ego") for v in vehicles]
        )
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.set_ylim(-0.6, len(vehicles) - 0.4)
        axes.set_xlabel(f"{name}, {unit}")
        return ink.picture(
            drawn,
            f"Start: {name}",
            f"Spread of {name} under P0 and in the dangerous rollouts for each vehicle; means differ, in {unit}: "
            + ", ".join(sentences)
            + ".",
            "Above, grey: base distribution P0. Below: the dangerous rollouts. Thin: 5% to 95%, thick: middle half, "
            "circle: median.",
        )


def driver_shifts(record: JobRecord, proposal: ce.Product) -> Picture:
    shifts = xi_shifts_sd(record, proposal)
    with ink.figure(2.6) as drawn:
        axes = drawn.add_subplot()
        groups = [shifts[k :: len(XI_OUTPUTS)] for k in range(len(XI_OUTPUTS))]
        for k, mine in enumerate(groups):
            spread = (np.arange(mine.size) * 0.618034 % 1.0 - 0.5) * 0.6  # even, not random
            axes.scatter(mine, k + spread, s=5, color=ink.colour(record.job.method), alpha=0.6, linewidths=0)
        axes.axvline(0.0, color=ink.BASE, linewidth=1.0)
        axes.set_yticks(range(len(XI_OUTPUTS)), [o.replace(" of ", "\nof ") for o in XI_OUTPUTS])
        axes.invert_yaxis()
        axes.grid(False, axis="y")
        limit = max(1.1 * float(np.abs(shifts).max()), 1e-3)
        axes.set_xlim(-limit, limit)
        axes.set_xlabel("shift of the weight's mean, in its standard deviations")
        return ink.picture(
            drawn,
            "Drivers: how their weights are shifted",
            "Shift of the mean of each of the driver weights in its standard deviations, by the network's output; "
            + "; ".join(
                f"{o}: largest {significant(float(np.abs(g).max()), 2)}"
                for o, g in zip(XI_OUTPUTS, groups, strict=True)
            )
            + ".",
            f"A dot for each of the {shifts.size} weights of the drivers' last layer, by the output that it acts on.",
        )
