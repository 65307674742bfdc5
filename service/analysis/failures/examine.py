"""Look at dangerous rollouts once more: run them again, and name how each came about."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from service.analysis.failures.events import Events
from service.analysis.failures.kinds import NAMES, kind_of
from service.analysis.failures.memory import Memory
from service.analysis.failures.modes import modes_of
from service.analysis.failures.rerun import Rerun, Rerunner

EXAMINED = 400  # dangerous rollouts that are run again and grouped: shares to within 5% of p
BACKGROUND = "background"
UNSEEN = "unseen"
MODE_NAMES = NAMES | {
    BACKGROUND: "a vehicle of the background traffic comes close",
    UNSEEN: "could not be run again",
}
Watch = Callable[[int, int], None]


def look_away(done: int, total: int) -> None:
    pass


@dataclass(frozen=True)
class Examined:
    """Dangerous rollouts of a job that were run again.

    sample: positions of those from which shares are counted
    reruns: of the sample and of others that were asked for, by position
    """

    events: Events
    sample: np.ndarray
    reruns: dict[int, Rerun]


def examine(
    events: Events,
    rerunner: Rerunner,
    others: Collection[int] = (),
    most: int = EXAMINED,
    traced: Collection[int] = (),
    folder: Path | None = None,
    watch: Watch = look_away,
) -> Examined:
    """Run a sample of `most` rollouts and those at positions `others` again, except what `folder` remembers.

    traced: positions to return the traces of; these are always run
    watch: told of (done, total)
    """
    sample = sample_of(events, most)
    positions = sorted({*sample.tolist(), *others, *traced})
    memory = Memory(events.record.job, folder)
    keys = {i: ((int(events.iterations[i]), int(events.rows[i])), float(events.f[i])) for i in positions}
    again = {i: known for i in positions if i not in traced and (known := memory.get(*keys[i])) is not None}
    todo = [i for i in positions if i not in again]
    done = [len(again)]

    def on_done(count: int) -> None:
        done[0] += count
        watch(done[0], len(positions))

    traced_rows = [n for n, i in enumerate(todo) if i in traced]
    for i, fresh in zip(todo, rerunner.run(events.drawn(todo), traced_rows, on_done), strict=True):
        again[i] = fresh
        memory.add(*keys[i], fresh)
    if todo:
        memory.save()
    return Examined(events, sample, again)


def sample_of(events: Events, most: int) -> np.ndarray:
    """The first rows, which are as good a sample as any; of chains and paths, which depend on each other, evenly spread
    ones."""
    n = len(events)
    if events.replication is None or n <= most:
        return np.arange(min(n, most))
    return np.unique(np.linspace(0, n - 1, most).round().astype(np.int64))


def modes_by_position(examined: Sequence[Examined]) -> list[dict[int, str]]:
    """The mode of each rollout of each of them, their samples grouped together.

    A rollout outside the samples goes by the rules alone, so that what else was asked for changes no group.
    """
    sampled = [(n, i) for n, e in enumerate(examined) for i in e.sample.tolist() if e.reruns[i].motion]
    grouped = modes_of([m for n, i in sampled if (m := examined[n].reruns[i].motion) is not None])
    named = dict(zip(sampled, grouped, strict=True))
    return [
        {i: named.get((n, i)) or alone(again) for i, again in e.reruns.items()}
        for n, e in enumerate(examined)
    ]


def alone(again: Rerun) -> str:
    """The mode of a rollout by itself."""
    if again.motion is not None:
        return kind_of(again.motion)
    return UNSEEN if again.error else BACKGROUND


def mode_name(mode: str) -> str:
    """A mode in words."""
    return MODE_NAMES["other" if mode.startswith("other-") else mode]
