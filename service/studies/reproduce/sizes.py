"""How large each experiment is at each named scale."""

from dataclasses import dataclass

SCALES = ("smoke", "small", "medium", "large", "paper")  # seconds, minutes, an hour, hours, days of a core


@dataclass(frozen=True)
class Search:
    """Algorithm 1: K iterations of N_k rollouts, then `evaluation` rollouts from the proposal kept."""

    iterations: int
    samples: int
    evaluation: int

    @property
    def total(self) -> int:
        return self.iterations * self.samples + self.evaluation


@dataclass(frozen=True)
class Size:
    """How large an experiment of the paper is.

    truth: naive rollouts of the ground truth
    search: of each cross-entropy run, and as many rollouts in all of each of our own estimators
    rhos: quantile levels of Figure 2
    seeds: how often every run is repeated
    """

    truth: int
    search: Search
    rhos: tuple[float, ...]
    seeds: int


@dataclass(frozen=True)
class Ours:
    """Our own estimators.

    truth: rollouts of the ground truth
    gammas: the thresholds aimed at
    series: those that are run, `seeds` times each, with `budget` rollouts
    """

    truth: int
    gammas: tuple[float, ...]
    series: tuple[str, ...]
    seeds: int
    budget: int


PAPER_RHOS = (0.01, 0.05, 0.1, 0.2)
# Table 1 and Figure 2, the lidar ego: the paper has K = 100, N_k = 5,000, 10^5 evaluation rollouts, and 1.3 * 10^6
# naive ones.
LIDAR = {
    "smoke": Size(400, Search(2, 100, 800), (0.1, 0.2), 1),
    "small": Size(10_000, Search(4, 300, 800), (0.01, 0.1), 1),
    "medium": Size(100_000, Search(10, 500, 5000), PAPER_RHOS, 2),
    "large": Size(1_000_000, Search(20, 1000, 20_000), PAPER_RHOS, 2),
    "paper": Size(1_000_000, Search(100, 5000, 100_000), PAPER_RHOS, 1),
}
# Table 2 and Figure 3, the vision ego: K = 20, N_k = 1,000, 50,000 evaluation rollouts against 50,000 naive ones.
VISION = {
    "smoke": Size(100, Search(2, 50, 900), (0.1,), 1),
    "small": Size(1000, Search(4, 100, 600), (0.01,), 1),
    "medium": Size(10_000, Search(10, 300, 5000), (0.01,), 1),
    "large": Size(20_000, Search(20, 500, 10_000), (0.01,), 1),
    "paper": Size(50_000, Search(20, 1000, 50_000), (0.01,), 1),
}
# Our estimators, where p is about 1e-4, 1e-5 and 1e-6.
ALL_SERIES = ("splitting, noise searched", "splitting", "auto", "mixture")
BEYOND = {
    "smoke": Ours(400, (0.5,), ("splitting, noise searched", "splitting"), 2, 1000),
    "small": Ours(10_000, (0.38,), ("splitting, noise searched", "splitting"), 3, 2000),
    "medium": Ours(100_000, (0.38, 0.32), ALL_SERIES[:3], 6, 10_000),
    "large": Ours(1_000_000, (0.3, 0.24), ALL_SERIES[:1], 20, 20_000),
    "paper": Ours(1_000_000, (0.38, 0.3, 0.24), ALL_SERIES, 20, 50_000),
}
# Other worlds: most rollouts in SUMO, a tenth of a second or more of each over 2 km. The black box is asked each step,
# which takes several times as long: it has a part of the rollouts, and one seed.
BLACK_BOX_PART = 0.2
WORLDS = {
    "smoke": Ours(40, (), (), 1, 1000),
    "small": Ours(300, (), (), 1, 1000),
    "medium": Ours(10_000, (), (), 2, 5000),
    "large": Ours(30_000, (), (), 3, 10_000),
    "paper": Ours(100_000, (), (), 5, 20_000),
}
