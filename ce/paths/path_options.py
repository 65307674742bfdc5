"""Options of the method for paths."""

from dataclasses import dataclass

from ce.checks import at_least, budget_of_at_least, in_range, precision_in_range

LEAST_BUDGET = 200


@dataclass(frozen=True)
class PathOptions:
    """Options of the method for paths.

    budget: simulated steps, in whole paths; training included
    confidence: of the interval, in (0, 1)
    batches: independent batches of the estimate, at least
    naive_paths: of the pilot, driven without splitting, at most an eighth of the budget
    round_paths: simulated steps of a later round of the pilot, in whole paths, at most a fortieth of the budget
    rounds: of the pilot, at most
    training_share: of the budget, for the pilot at most
    starts_a_path: starts drawn for every path that is driven
    floor: least I^beta of a state over its mean at the start
    train_on: whether a committor that is given is trained further
    """

    budget: int = 20_000
    confidence: float = 0.95
    batches: int = 20
    naive_paths: int = 1500
    round_paths: int = 300
    rounds: int = 14
    training_share: float = 0.5
    starts_a_path: int = 40
    floor: float = 0.4
    train_on: bool = False

    def __post_init__(self) -> None:
        budget_of_at_least(LEAST_BUDGET, self.budget, "paths")
        at_least("batches", self.batches, 5)
        at_least("naive_paths", self.naive_paths, 25)
        at_least("round_paths", self.round_paths, 5)
        at_least("rounds", self.rounds, 0)
        at_least("starts_a_path", self.starts_a_path, 1)
        in_range("training_share", self.training_share, 0, 1)
        in_range("floor", self.floor, 0, 1)
        precision_in_range(None, self.confidence)

    @property
    def naive(self) -> int:
        """Paths of the pilot's first round."""
        return min(self.naive_paths, max(self.budget // 8, 25))

    @property
    def population(self) -> float:
        """Paths that a later round of the pilot is to have in the middle of the horizon."""
        return float(min(self.round_paths, max(self.budget // 40, 5))) * 1.5
