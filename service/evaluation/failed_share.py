"""When so many rollouts failed that what is left of them is no answer."""

from collections.abc import Sequence

MAX_FAILED = 0.1  # share of failed rollouts at which a job is given up, where nothing else is asked for
JUDGED_FROM = 50  # rollouts: a share of fewer says little
SHOWN, LONGEST = 3, 200  # first failed rollouts that are told of, and characters of what each said


def too_many(
    failed: int, rollouts: int, max_failed: float, first: Sequence[str], at_end: bool = False
) -> str:
    """Why so many failed rollouts end a job, "" where they do not: the share, and what the first of them said.

    at_end: the job has no more rollouts; then one whose every rollout failed has failed, whatever is tolerated.
    """
    every = at_end and failed == rollouts
    if not failed or (failed <= max_failed * max(rollouts, JUDGED_FROM) and not every):
        return ""
    told = "; ".join(line if len(line) <= LONGEST else f"{line[:LONGEST]}..." for line in first[:SHOWN])
    share = "all that there were" if every else f"more than the share {max_failed:g} that is tolerated"
    return f"{failed:,} of {rollouts:,} rollouts failed, {share}" + (f": {told}" if told else "")
