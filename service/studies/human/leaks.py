"""Contacts by forced leaks: a rollout as a tree of all that drivers could have chosen when they nearly looked away.

A glance that would begin in a conflict begins with probability epsilon, an independent choice each time. Counting waits
for such choices; here they are made. The stem is the rollout in which nobody looks away in a conflict. At each glance
that it suppresses, a copy of the state branches off in which that glance begins, and grows branches by the same rule.
An event on a path on which L glances leaked and R were suppressed until then has the path's probability,

    epsilon^L (1 - epsilon)^R,

so that the sum over the tree is, in expectation, what counting finds, for every epsilon at once.

What a tree costs is bounded by lotteries whose prizes keep the expectation (Russian roulette): a branch off a branch,
and one whose glance is short, is grown with a probability and then counts its inverse; and a branch is driven LIVE_S
beyond its glance, then goes on to the end with probability SURVIVES and counts 1 / SURVIVES.
"""

from dataclasses import dataclass

import numpy as np

from service.errors import SimulationError
from service.studies.human.counting import MOST_EVENTS, Counter
from service.studies.human.watching import EVENT, TALLIES, WEIGHT, Memory
from service.world.sim import minds as M
from service.world.sim import step
from service.world.sim.latent import GLANCE, LEAK

LIVE_S = 6.0  # that a branch is driven beyond its glance, before the lottery
SURVIVES = 0.1
SHORT_S, OF_SHORT = 1.0, 0.2  # branches whose glance is shorter than this are grown with this probability
PRIZE = 4.0  # a branch of the L-th order counts at least PRIZE^(L - 1), or is grown with less probability
MOST_WAITING = 5_000  # branches not yet grown
LOTTERIES = 0x1EA4  # of the stream of random numbers


@dataclass(frozen=True)
class Branch:
    """A state, before step k, from which driver `who` looks away in a conflict.

    order: leaks on the way, its own included
    weight: inverse of the probability with which it was grown
    """

    k: int
    who: int
    order: int
    weight: float
    agents: np.ndarray
    minds: np.ndarray
    observations: np.ndarray
    memory: Memory


class Tree:
    """Grows the trees of a counter whose scenario has epsilon = 0."""

    def __init__(self, counter: Counter) -> None:
        self._counter = counter
        self._waiting: list[Branch] = []

    def grow(
        self, x: np.ndarray, noise_seed: int, tallies: np.ndarray
    ) -> tuple[int, int, np.ndarray, np.ndarray]:
        """How the stem ended, its steps, its last state, and the tree's events (n, EVENT); adds the stem's kilometres
        to `tallies`.

        SimulationError where more than MOST_WAITING branches would have to wait.
        """
        counter = self._counter
        lots = np.random.Generator(np.random.Philox(key=[noise_seed, LOTTERIES]))
        self._waiting = []
        events = np.zeros((MOST_EVENTS, EVENT))
        status, found = counter.begin(x, noise_seed, tallies, events)
        status, k, found, halted = counter.go_on(tallies, events, found, status, 0, halting=True)
        while halted:
            self._branch_off(k, -1, 0, 1.0, lots)
            status, k, found, halted = counter.go_on(
                tallies, events, found, status, k, moved=True, halting=True
            )
        end = counter.agents.copy()
        gathered = [events[:found]]
        while self._waiting:
            gathered.append(self._grown(self._waiting.pop(), lots))
        return status, k, end, np.concatenate(gathered)

    def _grown(self, branch: Branch, lots: np.random.Generator) -> np.ndarray:
        """Events of a branch, its own branches left waiting."""
        counter, world = self._counter, self._counter.world
        world.agents[:], world.minds[:], world.observations[:] = (
            branch.agents,
            branch.minds,
            branch.observations,
        )
        counter.memory = branch.memory
        aside, events = np.zeros((2, TALLIES)), np.zeros((MOST_EVENTS, EVENT))
        glance = counter.happens[branch.k, branch.who]
        last, weight, found = counter.happens.shape[0], branch.weight, 0
        stop = branch.k + 1 + int((glance[GLANCE] + LIVE_S) / counter.dt_s)
        glance[LEAK] = 1.0
        status, k, found, halted = counter.go_on(
            aside, events, found, step.RUNNING, branch.k, stop, halting=True
        )
        glance[LEAK] = 0.0
        weighed = 0
        while True:
            if halted:
                self._branch_off(k, branch.who if k == branch.k else -1, branch.order, weight, lots)
            elif status == step.RUNNING and stop < last and lots.random() < SURVIVES:
                events[weighed:found, WEIGHT] *= weight
                weight, weighed, stop = weight / SURVIVES, found, last
            else:
                break
            status, k, found, halted = counter.go_on(
                aside, events, found, status, k, stop, moved=halted, halting=True
            )
        events[weighed:found, WEIGHT] *= weight
        return events[:found]

    def _branch_off(self, k: int, after: int, order: int, weight: float, lots: np.random.Generator) -> None:
        """Leave the branches waiting whose glances step k has just suppressed, of the vehicles after `after`."""
        counter, world = self._counter, self._counter.world
        suppressed = world.minds[:, M.RESISTED] > counter.minds_before[:, M.RESISTED]
        for who in np.flatnonzero(suppressed[after + 1 :]) + after + 1:
            short = counter.happens[k, who, GLANCE] < SHORT_S
            share = min(1.0, weight / PRIZE**order) * (OF_SHORT if short else 1.0)
            if share < 1.0 and lots.random() >= share:
                continue
            if len(self._waiting) >= MOST_WAITING:
                raise SimulationError(
                    f"more than {MOST_WAITING} branches of one rollout wait to be driven; drivers are in conflict all "
                    "the time here: count without forced leaks"
                )
            state = counter.agents_before.copy(), counter.minds_before.copy(), world.observations.copy()
            self._waiting.append(
                Branch(k, int(who), order + 1, weight / share, *state, counter.memory.copy())
            )
