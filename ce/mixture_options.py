"""Options of mixture sampling, and the sizes that follow from them."""

import math
from dataclasses import dataclass

from ce import look
from ce.checks import at_least, in_range
from ce.errors import BudgetError

LEAST_BUDGET = 1000
LEAST_FOR_LOOK = 5000  # budget
MOST_ELITES = 10_000  # kept, a random choice of them
MANY = 100  # dimensions above which iterations are larger
SAFE_SIZE = 1000  # rollouts in an iteration below which modes were seen to be missed (README, "Measured")


@dataclass(frozen=True)
class MixtureOptions:
    """Options of mixture sampling.

    budget: rollouts at most, training included; rho: quantile level; samples_per_iteration: of the search (None: a
    twentieth of the budget, a twelfth in more than MANY dimensions, at most 10,000, and at least SAFE_SIZE where a
    tenth of the budget allows it); search_share: of the budget that the search may use; refinements: batches fitted
    after the threshold is reached; base_share: of the base in every proposal, which bounds every weight by 1 /
    base_share; ladder_share: of the fit before the last; look_share: of the budget, for the look for what the
    search has missed (0: none); components: at most, in a fit; rel_error: relative half-width to stop at (None:
    spend the budget); batch_size: estimation rollouts in a batch.
    """

    budget: int = 100_000
    rho: float = 0.1
    samples_per_iteration: int | None = None
    search_share: float = 0.6
    refinements: int = 2
    base_share: float = 0.1
    ladder_share: float = 0.1
    look_share: float = 0.1
    components: int = 12
    rel_error: float | None = None
    confidence: float = 0.95
    batch_size: int = 5000

    def __post_init__(self) -> None:
        at_least("budget", self.budget, 1)
        if self.budget < LEAST_BUDGET:
            raise BudgetError(f"method mixture needs a budget of at least {LEAST_BUDGET}, not {self.budget}")
        at_least("refinements", self.refinements, 0)
        at_least("components", self.components, 1)
        at_least("batch_size", self.batch_size, 1)
        in_range("rho", self.rho, 0, 1)
        in_range("search_share", self.search_share, 0, 1)
        in_range("base_share", self.base_share, 0, 0.5)
        if self.ladder_share != 0:
            in_range("ladder_share", self.ladder_share, 0, 0.5)
        if self.look_share != 0:
            in_range("look_share", self.look_share, 0, 0.5)
        in_range("confidence", self.confidence, 0, 1)
        if self.rel_error is not None:
            in_range("rel_error", self.rel_error, 0, math.inf)
        if self.samples_per_iteration is not None:
            at_least("samples_per_iteration", self.samples_per_iteration, 50)
            if self.samples_per_iteration > self.search_share * self.budget:
                raise BudgetError(
                    f"one iteration of {self.samples_per_iteration} rollouts does not fit into the search's share "
                    f"of a budget of {self.budget}"
                )

    def iteration_size(self, dim: int) -> int:
        """Rollouts in an iteration of the search."""
        part = 20 if dim <= MANY else 12
        least = min(SAFE_SIZE, max(self.budget // 10, 200))
        return self.samples_per_iteration or min(max(self.budget // part, least), 10_000)

    def held_rows(self, dim: int) -> int:
        """Rows of `dim` numbers that a state and its open batch hold together at most."""
        hot, chains = self.look_sizes()
        batch = max(self.iteration_size(dim), hot, min(self.batch_size, self.budget))
        looked_at = hot + (look.KEPT_MOVES + 1) * chains
        return batch + min(MOST_ELITES, self.budget) + looked_at

    def look_sizes(self) -> tuple[int, int]:
        """Hot rows and chains of the look."""
        return look.sizes(int(self.look_share * self.budget)) if self.budget >= LEAST_FOR_LOOK else (0, 0)

    def most_iterations(self, dim: int) -> int:
        """Fits of the search at most."""
        hot, chains = self.look_sizes()
        left = int(self.search_share * self.budget) - hot - chains * look.MOVES
        return max(left // self.iteration_size(dim), 1)
