"""Options of mixture sampling, and the sizes that follow from them."""

from dataclasses import dataclass

from ce import mode_search
from ce.checks import at_least, budget_of_at_least, in_range, precision_in_range
from ce.errors import BudgetError
from ce.former_names import accepts_former

LEAST_BUDGET = 1000
# Budget below which there is no mode search.
LEAST_FOR_MODE_SEARCH = 5000
# Elites that are kept, a random choice of them.
MOST_ELITES = 10_000
# Dimensions above which iterations are larger.
HIGH_DIMENSION = 100
# Rollouts in an iteration below which modes were seen to be missed (README, "Measured").
SAFE_SIZE = 1000
FORMER_NAMES = {"look_share": "mode_search_share"}


@accepts_former(FORMER_NAMES)
@dataclass(frozen=True)
class MixtureOptions:
    """Options of mixture sampling.

    budget: rollouts at most, training included
    rho: quantile level, in (0, 1)
    samples_per_iteration: rollouts in an iteration of the search (None: a twentieth of the budget, a twelfth in more
        than HIGH_DIMENSION dimensions, at most 10,000, and at least SAFE_SIZE where a tenth of the budget allows it)
    search_share: of the budget, that the search may use
    refinements: batches fitted after the threshold is reached
    base_share: of the base in every proposal, which bounds every weight by 1 / base_share
    ladder_share: of the fit before the last
    mode_search_share: of the budget, for the search for modes that the proposals miss (0: none); formerly look_share
    components: of a fit, at most
    rel_error: relative half-width of the interval to stop at (None: spend the budget)
    confidence: of the interval, in (0, 1)
    batch_size: estimation rollouts in a batch
    """

    budget: int = 100_000
    rho: float = 0.1
    samples_per_iteration: int | None = None
    search_share: float = 0.6
    refinements: int = 2
    base_share: float = 0.1
    ladder_share: float = 0.1
    mode_search_share: float = 0.1
    components: int = 12
    rel_error: float | None = None
    confidence: float = 0.95
    batch_size: int = 5000

    def __post_init__(self) -> None:
        budget_of_at_least(LEAST_BUDGET, self.budget, "mixture")
        at_least("refinements", self.refinements, 0)
        at_least("components", self.components, 1)
        at_least("batch_size", self.batch_size, 1)
        in_range("rho", self.rho, 0, 1)
        in_range("search_share", self.search_share, 0, 1)
        in_range("base_share", self.base_share, 0, 0.5)
        if self.ladder_share != 0:
            in_range("ladder_share", self.ladder_share, 0, 0.5)
        if self.mode_search_share != 0:
            in_range("mode_search_share", self.mode_search_share, 0, 0.5)
        precision_in_range(self.rel_error, self.confidence)
        if self.samples_per_iteration is not None:
            at_least("samples_per_iteration", self.samples_per_iteration, 50)
            if self.samples_per_iteration > self.search_share * self.budget:
                raise BudgetError(
                    f"one iteration of {self.samples_per_iteration} rollouts does not fit into the search's share "
                    f"of a budget of {self.budget}"
                )

    def iteration_size(self, dim: int) -> int:
        """Rollouts in an iteration of the search."""
        part = 20 if dim <= HIGH_DIMENSION else 12
        least = min(SAFE_SIZE, max(self.budget // 10, 200))
        return self.samples_per_iteration or min(max(self.budget // part, least), 10_000)

    def held_rows(self, dim: int) -> int:
        """Rows of `dim` numbers that a state and its open batch hold together at most."""
        hot, chains = self.mode_search_sizes()
        batch = max(self.iteration_size(dim), hot, min(self.batch_size, self.budget))
        visited = hot + (mode_search.KEPT_MOVES + 1) * chains
        return batch + min(MOST_ELITES, self.budget) + visited

    def mode_search_sizes(self) -> tuple[int, int]:
        """Hot rows and chains of the mode search."""
        if self.budget < LEAST_FOR_MODE_SEARCH:
            return 0, 0
        return mode_search.sizes(int(self.mode_search_share * self.budget))

    def most_iterations(self, dim: int) -> int:
        """Fits of the search at most."""
        hot, chains = self.mode_search_sizes()
        left = int(self.search_share * self.budget) - hot - chains * mode_search.MOVES
        return max(left // self.iteration_size(dim), 1)
