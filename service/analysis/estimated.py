"""An estimate as it is told: the same of a run directory, of a service's job, and in `tailroad estimate --json`."""

from typing import Any

import msgspec

from service.analysis.estimate_parts import EstimateWarning, Rollouts
from service.analysis.notebook import estimate_html
from service.analysis.wording import treatment
from service.evaluation.summary import Ending, Impact


class Estimated(msgspec.Struct, frozen=True, kw_only=True):
    """p = P0(f(X) <= gamma), how sure that is, and what it cost. Numbers that are not known are None.

    job: its id
    ci: interval of p at level `confidence`
    unit: of gamma
    ess: effective events
    endings: how its rollouts ended, with probabilities by the same weights
    impacts: contacts at a speed or more, where the measure tells impact speeds
    workers, wall_s: of this sitting
    worker_s, sim_s: of all
    in_sumo: rollouts that SUMO drove; the others were compiled calls of the same bits
    """

    job: str
    p: float | None
    std_error: float | None
    ci: tuple[float, float]
    confidence: float
    gamma: float
    method: str
    rollouts: Rollouts
    events: int
    ess: float | None
    max_weight_share: float | None
    efficiency_vs_naive: float | None
    variance_reliable: bool
    converged: bool
    warnings: tuple[EstimateWarning, ...]
    scenario: str
    ego: str
    seed: int
    options: dict[str, Any]
    tailroad: str
    workers: int
    wall_s: float
    worker_s: float
    sim_s: float
    x_realtime_per_core: float | None
    in_sumo: int = 0
    unit: str = ""
    measure: str = ""
    endings: tuple[Ending, ...] = ()
    impacts: tuple[Impact, ...] = ()

    @property
    def in_short(self) -> str:
        """p with its interval, as a line of a console shows it."""
        p = "not known" if self.p is None else f"{self.p:.3g}"
        treated = treatment(self.rollouts.failed, self.rollouts.total)
        return f"p = {p}, {self.ci[0]:.3g} to {self.ci[1]:.3g}" + (f" ({treated})" if treated else "")

    def _repr_html_(self) -> str:
        return estimate_html(self)
