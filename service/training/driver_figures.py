"""The drivers in figures, for their card: on the whole road, on held-out recordings, and what a draw of xi changes."""

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.progress import Progress

from policies import layout as O
from service.training import metrics
from service.training.demonstrations import Rows
from service.training.ensemble import HeadDistribution
from service.training.expert import Expert
from service.training.members import Members
from service.training.network import ACTION_SCALE, network_features
from service.training.run import People, Run, ticks
from service.training.world import Network
from service.world.sim.road import Road

HORIZONS_S = (5.0, 10.0, 20.0)  # of the closed loop
# limits that hold for all drivers learned from these recordings
SEEN_IN_CONGESTION = (
    "Recorded drivers were seen at a mean of 6 m/s (I-80) and 13 m/s (US-101), in congestion. On the almost empty "
    "road of the i80 scenario most of what a driver does comes from the fitted expert's labels, not from recordings."
)
ESTIMATED_SIZES = "Vehicle sizes on I-80 are estimates; widths are assumed."


def origin(
    run: Run[Any],
    name: str,
    method: str,
    people: People,
    aggregated: Rows,
    expert: Expert,
    members: Members,
) -> dict[str, Any]:
    """The entries of the card that say what the drivers are, how they were learned and what from."""
    return {
        "name": name,
        "what": "distribution of human drivers: network 51-200-100-4, last layer N(mu0, Sigma0)",
        "method": method,
        **run.repeated_by(),
        "data": people.card(run.arguments.shares(), aggregated),
        "expert": {**expert.as_dict(), "resampled": members.experts},
    }


def measure(
    check_rollouts: int,
    draw: Callable[[np.random.Generator], Network],
    centre: Network,
    road: Road,
    people: People,
    xi_rng: np.random.Generator,
    check_rng: np.random.Generator,
    progress: Progress,
) -> dict[str, Any]:
    """All metrics of the card; draw: a driver drawn from the fitted distribution, centre: the one at its mean."""
    with ticks(progress, "whole road", check_rollouts) as tick:
        on_road = metrics.whole_road(lambda _: draw(xi_rng), road, check_rollouts, check_rng, tick=tick)
    held, learned = people.held_out(), people.learned_from()
    sd = learned.action.std(axis=0) / ACTION_SCALE
    constant = 0.5 * (held.action / ACTION_SCALE / sd) ** 2 + np.log(sd) + 0.5 * np.log(2.0 * np.pi)
    loop = {}
    for name, part in people.recordings.sites.items():
        loop[name] = metrics.closed_loop(lambda _: draw(xi_rng), part, HORIZONS_S, check_rng)
    return {
        "p0_whole_road": on_road,
        "behind_a_slower_vehicle": metrics.brakes_for_leader(centre, road, check_rng),
        "held_out_open_loop": {
            "rows": len(held),
            "nll_accel_turn_rate": _rounded(_nll(centre, held).mean(axis=0)),
            "nll_on_training_rows": _rounded(_nll(centre, learned).mean(axis=0)),
            "nll_of_a_constant_normal": _rounded(constant.mean(axis=0)),
            **mean_errors(centre, held),
        },
        "held_out_closed_loop": loop,
    }


def mean_errors(network: Network, rows: Rows) -> dict[str, float]:
    """Root mean square errors of the network's mean action on `rows`."""
    h = np.column_stack([network_features(network, rows.seen), np.ones(len(rows))])
    error = (h @ network.head.reshape(-1, O.OUTPUTS))[:, :2] * ACTION_SCALE - rows.action
    accel, turn_rate = np.sqrt(np.mean(error**2, axis=0))
    return {
        "rmse_accel_mps2": round(float(accel), 4),
        "rmse_turn_rate_radps": round(float(turn_rate), 5),
    }


def xi_effects(
    network: Network, members: np.ndarray, distribution: HeadDistribution, rows: dict[str, Rows]
) -> dict[str, Any]:
    """What a draw of xi, and a shift of 0.01 in every weight, change in a driver's actions on each kind of `rows`."""
    result: dict[str, Any] = {}
    for name, some in rows.items():
        pick = np.linspace(0, len(some) - 1, 4000).astype(int)
        h = np.column_stack([network_features(network, some.seen[pick]), np.ones(len(pick))])
        sd = []
        for output in range(O.OUTPUTS):
            block = distribution.covariance[output :: O.OUTPUTS, output :: O.OUTPUTS]
            sd.append(float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", h, block, h)))))
        of_members = np.array([h @ m.reshape(-1, O.OUTPUTS) for m in members]).std(axis=0, ddof=1)
        result[f"output_sd_under_xi_{name}"] = {
            "mean_accel_mps2": round(sd[0] * ACTION_SCALE[0], 4),
            "mean_turn_rate_radps": round(sd[1] * ACTION_SCALE[1], 6),
            "log_std": [round(x, 4) for x in sd[2:]],
            "mean_accel_of_members": round(float(np.sqrt((of_members[:, 0] ** 2).mean())), 4),
            "mean_turn_rate_of_members": round(
                float(np.sqrt((of_members[:, 1] ** 2).mean())) * ACTION_SCALE[1], 6
            ),
        }
        shift = float(0.01 * np.abs(h).sum(axis=1).mean())
        result[f"output_shift_of_0.01_in_all_weights_{name}"] = round(shift, 4)
        result[f"activation_{name}"] = {
            "rms": round(float(np.sqrt((h[:, :-1] ** 2).mean())), 4),
            "active_units_mean": round(float((h[:, :-1] > 0).sum(axis=1).mean()), 1),
        }
    return result


def _nll(centre: Network, rows: Rows) -> np.ndarray:
    return metrics.nll(centre, network_features(centre, rows.seen), rows.action.astype(np.float64))


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(v), 4) for v in values]
