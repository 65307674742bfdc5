"""What a run came to, as it is kept: small, and enough for every table and picture."""

import math
from pathlib import Path

import msgspec
import numpy as np

import ce
from service.errors import StoreError
from service.evaluation.summary import variance_reliable
from service.studies.reproduce.plans import Run


class Reading(msgspec.Struct, frozen=True, kw_only=True):
    """The estimate at one threshold.

    variance_error: relative standard error of std_error squared
    """

    gamma: float
    p: float | None
    std_error: float | None
    low: float | None
    high: float | None
    events: int
    ess: float | None
    variance_error: float | None


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """What a run of a plan came to.

    wall_s: of the sitting that finished it
    worker_s, sim_s: of all its rollouts
    """

    run: Run
    method: str
    rollouts: int
    training: int
    readings: tuple[Reading, ...]
    warnings: tuple[str, ...]
    reliable: bool
    max_weight_share: float
    worker_s: float
    sim_s: float
    wall_s: float
    tailroad: str

    @property
    def estimation(self) -> int:
        return self.rollouts - self.training


def result_of(
    run: Run, estimate: ce.Estimate, gammas: tuple[float, ...], cost: dict[str, float], tailroad: str
) -> Result:
    """The result of a finished run.

    cost: worker_s, sim_s, wall_s
    """
    curve = estimate.curve(gammas)
    readings = tuple(
        Reading(
            gamma=float(gamma),
            p=_known(curve.p[i]),
            std_error=_known(curve.std_error[i]),
            low=_known(curve.low[i]),
            high=_known(curve.high[i]),
            events=int(curve.events[i]),
            ess=_known(curve.ess[i]),
            variance_error=_known(variance_error(estimate, float(gamma))),
        )
        for i, gamma in enumerate(gammas)
    )
    return Result(
        run=run,
        method=estimate.method,
        rollouts=estimate.rollouts,
        training=estimate.training_rollouts,
        readings=readings,
        warnings=tuple(w.name for w in estimate.warnings),
        reliable=variance_reliable(estimate),
        max_weight_share=float(estimate.max_weight_share),
        tailroad=tailroad,
        **cost,
    )


def variance_error(estimate: ce.Estimate, gamma: float) -> float:
    """Relative standard error of the estimate's own variance at a threshold.

    Independent rollouts with terms t_i = w_i 1{f_i <= gamma}: sqrt(sum t^4) / sum t^2, the error of a sum of rare
    squares. R replications: sqrt(2 / (R - 1)), that of a normal sample's variance. NaN without events.
    """
    if isinstance(estimate, ce.ReplicatedEstimate):
        runs = int(estimate.replication.max(initial=-1)) + 1
        return math.sqrt(2.0 / (runs - 1)) if runs > 1 else math.nan
    with np.errstate(invalid="ignore"):
        events = estimate.f <= gamma
    if not events.any():
        return math.nan
    log_w = np.zeros(int(events.sum())) if estimate.log_weights is None else estimate.log_weights[events]
    square = np.exp(2.0 * (log_w - log_w.max()))
    return float(math.sqrt(np.sum(square**2)) / np.sum(square))


def save(path: Path, result: Result) -> None:
    path.write_bytes(msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n")


def load(path: Path) -> Result | None:
    """A result that was kept; None where there is none yet. StoreError for a file that is not one."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Result)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError) as error:
        raise StoreError(
            f"{path} is not a readable result ({error}); remove it to have it made again"
        ) from error


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
