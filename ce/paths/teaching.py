"""A committor for keeps: taught by many rounds of paths of several processes, aimed at many levels in turn.

    round 0     naive paths of a process
    round r     paths kept, split and ended by what was learned, aimed at the next of the levels asked for, or at the
                lowest that enough paths have come to
    at the end  new networks, trained on the lessons of all rounds of all processes

A campaign's pilot does the same with one process and one level, and stops as soon as that is worth it; here nothing is
estimated, and what it costs is paid once.
"""

from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.paths.levels import ladder, reached, to_label
from ce.paths.network import NetworkCommittor
from ce.paths.path_state import POOLED, Falls, pooled
from ce.paths.plan import schedule
from ce.paths.process import Process
from ce.paths.starts import Roots, all_starts, kept_starts, reference_features
from ce.paths.training import Lessons, lessons, trained, untrained
from ce.paths.tree import Driven, drive, seen_by

Array = NDArray[np.float64]

REFERENCE_STARTS, REFERENCE_STREAM = 20_000, 2_000_000
# Numbers of hits at which a round's states are labelled.
LABELLED = (4, 8, 16, 32, 64, 128, 256, 512)
# Hits of the last rounds from which a level is aimed at.
ENOUGH = 8
# Steps of training after a round, rate of all training.
LATER_STEPS, RATE = 800, 4e-3


class Teaching(msgspec.Struct, frozen=True):
    """How long a committor is taught.

    aims: levels that rounds are aimed at in turn, in the unit of the measure; the lowest is the last that is learned
    naive: paths of round 0 of each process
    rounds: after it, of each process
    population: paths of a round in the middle of the horizon
    starts_a_path: starts drawn for each of them
    every: rounds between trainings
    steps: of the training at the end
    """

    aims: tuple[float, ...]
    naive: int = 3000
    rounds: int = 30
    population: float = 450.0
    starts_a_path: int = 60
    every: int = 2
    steps: int = 12_000


class Taught(msgspec.Struct, frozen=True, eq=False):
    """What came of it.

    committor: trained on all rounds
    paths: simulated steps of all rounds, in whole paths
    """

    committor: NetworkCommittor
    paths: float


def teach(
    processes: Sequence[Process[Any]],
    how: Teaching,
    seed: int,
    tell: Callable[[int, int, float], None] = lambda process, number, aim: None,
) -> Taught:
    """Teach a committor.

    processes: whose features mean the same; several egos, for instance
    seed: of all streams
    tell: shown the numbers of the process and of the round, and what it was aimed at
    """
    lowest, steps = min(how.aims), 0.0
    committor: NetworkCommittor | None = None
    taught: list[Lessons] = []
    for number, process in enumerate(processes):
        own = seed + 1_000_003 * number
        reference = reference_features(process, own, REFERENCE_STREAM, REFERENCE_STARTS)
        falls: list[Falls] = []
        driven: Driven | None = None
        starts = how.naive
        for k in range(how.rounds + 1):
            wanted = how.aims[(k - 1) % len(how.aims)]
            aim = float("inf")
            if k == 0 or committor is None or driven is None:
                roots, plan = all_starts(process, own, "train", k, how.naive), None
            else:
                pool = pooled(falls)
                aim = max(wanted, reached(pool.fallen, ENOUGH))
                levels = ladder(pool.fallen, pool.starts, aim, lowest)
                seen = seen_by(committor, levels, driven.record, starts, lowest)
                starts = int(how.population * how.starts_a_path)
                hazard = committor.log_hazard(reference, levels)
                plan = schedule(
                    lowest, levels, hazard, process.checkpoints, starts, how.population, seen=seen
                )
                roots = kept_starts(process, committor, plan, own, "train", k, starts)
            driven = _driven(process, roots, lowest, plan, committor)
            steps += float(driven.steps.sum()) / process.checkpoints[-1]
            falls = [*falls, Falls(driven.fallen, starts)][-POOLED:]
            tell(number, k, aim)
            labelled = to_label(driven.fallen, lowest, LABELLED)
            if labelled.size == 0:
                continue
            taught.append(lessons(driven.record, labelled, own + k))
            if committor is None:
                features = np.concatenate([r.features for r in driven.record])
                committor = untrained(features, lowest, float(labelled[0]), seed)
            if k % how.every == 0 or k < how.every:
                committor = trained(committor, taught, LATER_STEPS, RATE, own + k)
    if committor is None:
        raise ValueError("no path came to any level that could be taught; give more naive paths")
    features = np.concatenate([t.features for t in taught])
    fresh = untrained(features, lowest, committor.level_high, seed)
    return Taught(trained(fresh, taught, how.steps, RATE, seed), steps)


def _driven(
    process: Process[Any], roots: Roots, lowest: float, plan: Any, committor: NetworkCommittor | None
) -> Driven:
    return drive(
        process, roots, np.array([lowest]), process.checkpoints, plan, committor if plan else None, True
    )
