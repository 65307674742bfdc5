"""What the results of a batch say about a limit on p, and the exit code that tells it."""

from collections.abc import Sequence
from typing import Any, Literal

import msgspec

PASSED, EXCEEDED, IMPRECISE, INCONCLUSIVE, NOT_RUN = 0, 1, 3, 4, 5  # exit codes
# warnings under which the interval itself cannot be relied on
SHAKY = {"no-rollouts", "unfinished", "threshold-not-reached", "dominant-weight", "heavy-tailed-weights"}
Verdict = Literal["below", "above", "not-below", "inconclusive", "not-run", "estimated"]


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """What a cell came to.

    at: its run directory or its job
    reason: why there is no estimate
    """

    scenario: str
    ego: str
    gamma: float
    method: str
    at: str
    status: str  # done, failed, cancelled
    reason: str = ""
    p: float | None = None
    std_error: float | None = None
    low: float | None = None
    high: float | None = None
    confidence: float | None = None
    rollouts: int = 0
    training: int = 0
    events: int = 0
    failed: int = 0
    converged: bool = False
    imprecise: bool = False  # the precision that was asked for was not reached
    warnings: tuple[str, ...] = ()
    verdict: Verdict = "estimated"


def result_of(
    cell: Any, at: str, status: str, reason: str, summary: dict[str, Any] | None, limit: float | None
) -> Result:
    """The result of a cell from the object that `tailroad estimate --json` prints."""
    where = {"scenario": cell.scenario, "ego": cell.ego, "gamma": cell.gamma, "method": cell.method, "at": at,
             "status": status, "reason": reason}  # fmt: skip
    if summary is None or status != "done":
        return Result(**where, verdict="not-run")
    rollouts = summary["rollouts"]
    found = Result(
        **where,
        p=summary["p"],
        std_error=summary["std_error"],
        low=summary["ci"][0],
        high=summary["ci"][1],
        confidence=summary["confidence"],
        rollouts=rollouts["total"],
        training=rollouts["training"],
        events=summary["events"],
        failed=rollouts["failed"],
        converged=summary["converged"],
        imprecise=cell.options.get("rel_error") is not None and not summary["converged"],
        warnings=tuple(w["name"] for w in summary["warnings"]),
    )
    return msgspec.structs.replace(found, verdict=_verdict(found, limit))


def _verdict(found: Result, limit: float | None) -> Verdict:
    """A cell's verdict against the limit.

    above, below: the whole interval lies there; not-below: its upper end does not; inconclusive: it would lie below,
    but cannot be relied on.
    """
    if limit is None:
        return "estimated"
    if found.low is None or found.high is None or found.p is None:
        return "inconclusive"
    if found.high > limit:
        return "above" if found.low > limit else "not-below"
    # a search that has not met one event may have looked in the wrong place
    blind = "no-events" in found.warnings and found.training > 0
    return "inconclusive" if blind or SHAKY & set(found.warnings) else "below"


def exit_code(results: Sequence[Result]) -> int:
    """The gravest of them all."""
    verdicts = {result.verdict for result in results}
    if verdicts & {"above", "not-below"}:
        return EXCEEDED
    if "not-run" in verdicts:
        return NOT_RUN
    if "inconclusive" in verdicts:
        return INCONCLUSIVE
    return IMPRECISE if any(result.imprecise for result in results) else PASSED
