"""Options of multilevel splitting, and the sizes that follow from them."""

from dataclasses import dataclass

from ce.checks import at_least, budget_of_at_least, in_range, precision_in_range

LEAST_BUDGET = 1000
# Samples of a level in the pilot, at most.
LARGEST_PILOT = 5000
# Samples of a level in a replication, above which there are more replications instead.
LARGEST_REPLICATION = 10_000
# Samples of a level that are held at a time, by as many replications side by side.
MOST_HELD = 20_000


@dataclass(frozen=True)
class SplittingOptions:
    """Options of multilevel splitting.

    budget: rollouts at most, pilot included
    p0: conditional probability of a level, in (0, 1)
    chain: states of a chain, its seed included
    replications: independent runs
    pilot_share: of the budget, for the pilot at most
    rel_error: relative half-width of the interval to stop at, with an interim look after half of the replications; each
        of the two looks has half of 1 - confidence (union bound), so that the interval holds whichever ends the run
    confidence: of the interval, in (0, 1)
    """

    budget: int = 100_000
    p0: float = 0.1
    chain: int = 10
    replications: int = 10
    pilot_share: float = 0.4
    rel_error: float | None = None
    confidence: float = 0.95

    def __post_init__(self) -> None:
        budget_of_at_least(LEAST_BUDGET, self.budget, "splitting")
        at_least("chain", self.chain, 2)
        at_least("replications", self.replications, 5)
        in_range("p0", self.p0, 0, 1)
        in_range("pilot_share", self.pilot_share, 0, 1)
        precision_in_range(self.rel_error, self.confidence)

    @property
    def pilot_size(self) -> int:
        """Samples of a level in the pilot: a multiple of chain."""
        return min(max(self.budget // 50 // self.chain, 10), LARGEST_PILOT // self.chain) * self.chain

    def held_rows(self, dim: int) -> int:
        """Rows of `dim` numbers that a state and its open batch hold together at most."""
        return 2 * min(max(MOST_HELD, self.pilot_size), self.budget)

    @property
    def interim_looks(self) -> int:
        """Looks at the precision: after half of the replications and after all, or after all only."""
        return 1 if self.rel_error is None else 2
