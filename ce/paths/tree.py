"""Paths driven from checkpoint to checkpoint, split where they are too heavy for their importance, ended at random
where too light.

At a checkpoint a path of weight w whose target is t has ratio r = w / t. Above SPLIT it becomes floor(r' + u) paths
of weight w / r', r' = min(r, MOST), u uniform; below ROULETTE it goes on with chance r at weight t, or ends. Each
keeps the expected weight, so the weighted number of paths that come to a level is unbiased for any plan that was
fixed before. u and the noise of every segment are functions of the node's key, so any part of the roots gives the
same bits.
"""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.paths import keys
from ce.paths.plan import MOST, ROULETTE, SPLIT, Committor, Plan
from ce.paths.process import Process
from ce.paths.starts import Roots

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


class Recorded(msgspec.Struct, frozen=True, eq=False):
    """The paths that left a checkpoint, to learn from; before and after are of `climbed`.

    features: (n, m, F), at the checkpoint
    weight: (n,)
    parent: (n,), row of the checkpoint before that each comes from, -1 at the first
    before: (n,), smallest measure so far
    after: (n,), smallest measure at the next checkpoint
    """

    features: NDArray[np.float32]
    weight: Array
    parent: Rows
    before: Array
    after: Array


class Fallen(msgspec.Struct, frozen=True, eq=False):
    """Falls of paths' smallest values between checkpoints: a path comes to level b where after <= b < before.

    root: (n,), of the path
    weight: (n,), of the path then
    before: (n,), smallest value so far
    after: (n,), the lower one
    """

    root: Rows
    weight: Array
    before: Array
    after: Array

    @classmethod
    def none(cls) -> "Fallen":
        """No falls."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros(0))

    @classmethod
    def among(cls, root: Rows, weight: Array, before: Array, after: Array) -> "Fallen":
        """Those of these paths that fell."""
        rows = np.flatnonzero(after < before)
        return cls(root[rows], weight[rows], before[rows], after[rows])


def joined_falls(parts: Sequence[Fallen]) -> Fallen:
    """All of them, in their order."""
    return Fallen(*(np.concatenate([getattr(p, n) for p in parts]) for n in Fallen.__struct_fields__))


class Driven(msgspec.Struct, frozen=True, eq=False):
    """What roots came to.

    events: (n, L), weight of each root's paths that came to each level, by when they first did
    hits: (n, L), number of those paths
    steps: (n,), simulated for each root
    begun: (n,), paths begun for each root: itself and every further one by splitting
    root: (k,), of each path that came to its end, in rising order
    weight: (k,), of the path
    value: (k,), its smallest measure; NaN where it failed
    lineage: (k, T) uint64, the keys of its segments, 0 after its end: with x and seed all that a replay needs
    record: one a checkpoint, empty where none was asked for
    outcome: (k,) int64, how each path ended by the process' own code (`outcomes`), 0 where it tells none
    fallen: where paths came to lower values of `climbed`, also of those that roulette ended later
    finals: (k, C), what else the process tells of each path's end (`finals`), C = 0 where it tells nothing
    """

    events: Array
    hits: Rows
    steps: Rows
    begun: Rows
    root: Rows
    weight: Array
    value: Array
    lineage: NDArray[np.uint64]
    record: tuple[Recorded, ...] = ()
    outcome: Rows = msgspec.field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    fallen: Fallen = msgspec.field(default_factory=lambda: Fallen.none())
    finals: Array = msgspec.field(default_factory=lambda: np.zeros((0, 0)))


def climbed(process: Process[Any], states: Any, lowest: float) -> Array:
    """Smallest value so far (n,) of what leads to `lowest`: the process' own level where it has one, the measure
    elsewhere."""
    own = getattr(process, "level", None)
    return process.measure(states) if own is None or lowest > 0.0 else np.asarray(own(states), np.float64)


def drive(
    process: Process[Any],
    roots: Roots,
    levels: Array,
    checkpoints: Sequence[int],
    plan: Plan | None = None,
    committor: Committor | None = None,
    record: bool = False,
) -> Driven:
    """Drive the roots to their ends; without a plan none is split or ended.

    process: the simulator
    roots: (n,), kept starts
    levels: (L,), at which events are counted, in the unit of the measure
    checkpoints: steps, 0 first, the horizon last
    plan: fixed before, with its committor
    record: whether to keep what a committor learns from
    """
    n, segments = roots.size, len(checkpoints) - 1
    states = process.begin(roots.x, roots.seeds)
    root, weight = np.arange(n), roots.weights.copy()
    key = keys.children(roots.seeds, 0)
    lineage = np.zeros((n, segments), dtype=np.uint64)
    smallest, parent, lowest = process.measure(states), np.full(n, -1), float(levels.min())
    low = climbed(process, states, lowest)
    events, hits = np.zeros((n, levels.size)), np.zeros((n, levels.size), dtype=np.int64)
    steps, begun = np.zeros(n, dtype=np.int64), np.ones(n, dtype=np.int64)
    _count(events, hits, root, weight, np.full(n, np.inf), smallest, levels)
    falls = [Fallen.among(root, weight, np.full(n, np.inf), low)]
    ends: list[tuple[Rows, Array, Array, NDArray[np.uint64], Rows, Array]] = []
    recorded: list[Recorded] = []
    for k in range(segments):
        alive = process.alive(states)
        ended = np.flatnonzero(~alive)
        how = _outcomes(process, states)[ended], _finals(process, states, ended)
        ends.append((root[ended], weight[ended], smallest[ended], lineage[ended], *how))
        rows = np.flatnonzero(alive)
        if k and plan is not None and committor is not None and rows.size:
            copies, lighter = _copies(process, states, rows, weight, key, smallest, plan, committor, k)
            weight = weight.copy()
            weight[rows] = lighter
            rows, own = np.repeat(rows, copies), np.arange(int(copies.sum()))
            number = own - np.repeat(np.cumsum(copies) - copies, copies)
            np.add.at(begun, root[rows[number > 0]], 1)
        else:
            number = np.zeros(rows.size, dtype=np.int64)
        states, root, weight, lineage = process.take(states, rows), root[rows], weight[rows], lineage[rows]
        key, parent, smallest, low = key[rows], parent[rows], smallest[rows], low[rows]
        if k:
            key = keys.children(key, number)
        if rows.size == 0:
            break
        lineage[:, k] = key
        features = process.features(states) if record else None
        states = process.advance(states, key, checkpoints[k + 1])
        before, smallest = smallest, process.measure(states)
        above, low = low, climbed(process, states, lowest)
        np.add.at(steps, root, process.steps(states))
        _count(events, hits, root, weight, before, smallest, levels)
        falls.append(Fallen.among(root, weight, above, low))
        if features is not None:
            recorded.append(Recorded(features, weight, parent, above, low))
        parent = np.arange(root.size)
    else:
        how = _outcomes(process, states), _finals(process, states, np.arange(root.size))
        ends.append((root, weight, smallest, lineage, *how))
    at = np.concatenate([e[0] for e in ends])
    order = np.argsort(at, kind="stable")
    weights, values, lineages, outcomes, finals = (
        np.concatenate([e[j] for e in ends])[order] for j in (1, 2, 3, 4, 5)
    )
    return Driven(
        events,
        hits,
        steps,
        begun,
        at[order],
        weights,
        values,
        lineages,
        tuple(recorded),
        outcomes,
        joined_falls(falls),
        finals,
    )


def seen_by(
    committor: Committor, levels: Array, record: Sequence[Recorded], starts: int, gamma: float
) -> list[tuple[Array, Array]]:
    """What `ce.paths.plan.schedule` is told of paths that were seen: log hazard and weight of those still above gamma,
    for each checkpoint from the second on.

    record: of paths that stand for so many starts
    """
    found = []
    for r in record[1:]:
        open_ = ~(r.before <= gamma)
        found.append((committor.log_hazard(r.features[open_], levels), r.weight[open_] / starts))
    return found


def joined(parts: Sequence[Driven]) -> Driven:
    """What consecutive parts of the roots came to, as one: to the bit what all of them driven together come to."""
    first = np.cumsum([0] + [part.events.shape[0] for part in parts])
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("events", "hits", "steps", "begun", "weight", "value", "lineage", "finals")
    }
    root = np.concatenate([part.root + at for part, at in zip(parts, first[:-1], strict=True)])
    depth = max(len(part.record) for part in parts)
    record, shift = [], [0] * len(parts)
    for k in range(depth):
        rows = [part.record[k] for part in parts if len(part.record) > k]
        moved = [
            np.where(part.record[k].parent < 0, -1, part.record[k].parent + shift[i])
            for i, part in enumerate(parts)
            if len(part.record) > k
        ]
        record.append(
            Recorded(
                features=np.concatenate([r.features for r in rows]),
                weight=np.concatenate([r.weight for r in rows]),
                parent=np.concatenate(moved),
                before=np.concatenate([r.before for r in rows]),
                after=np.concatenate([r.after for r in rows]),
            )
        )
        sizes = [part.record[k].weight.size if len(part.record) > k else 0 for part in parts]
        shift = [int(s) for s in np.cumsum([0, *sizes[:-1]])]
    outcome = np.concatenate([part.outcome for part in parts])
    fallen = joined_falls(
        [
            msgspec.structs.replace(part.fallen, root=part.fallen.root + at)
            for part, at in zip(parts, first[:-1], strict=True)
        ]
    )
    return Driven(root=root, record=tuple(record), outcome=outcome, fallen=fallen, **columns)


def replay(
    process: Process[Any],
    x: Array,
    seeds: NDArray[np.uint64],
    lineage: NDArray[np.uint64],
    checkpoints: Sequence[int],
) -> Any:
    """The last states of paths driven again by the keys of their segments (n, T), without splitting: to the same
    bits."""
    states = process.begin(x, seeds)
    for k in range(len(checkpoints) - 1):
        states = process.advance(states, lineage[:, k], checkpoints[k + 1])
    return states


def _outcomes(process: Process[Any], states: Any) -> Rows:
    """How each path stands, by the process' own code, where it tells."""
    told = getattr(process, "outcomes", None)
    if told is None:
        return np.zeros(process.alive(states).size, dtype=np.int64)
    return np.asarray(told(states), dtype=np.int64)


def _finals(process: Process[Any], states: Any, rows: NDArray[np.intp]) -> Array:
    """What else the process tells of these ends (k, C)."""
    told = getattr(process, "finals", None)
    if told is None:
        return np.zeros((rows.size, 0))
    return np.asarray(told(states, rows), dtype=np.float64)


def _copies(
    process: Process[Any],
    states: Any,
    rows: NDArray[np.intp],
    weight: Array,
    key: NDArray[np.uint64],
    smallest: Array,
    plan: Plan,
    committor: Committor,
    checkpoint: int,
) -> tuple[Rows, Array]:
    """How often each of these paths goes on (k,), and the weight (k,) of each of its copies."""
    copies, new = np.ones(rows.size, dtype=np.int64), weight[rows].copy()
    open_ = np.flatnonzero(~(smallest[rows] <= plan.gamma))
    if open_.size == 0:
        return copies, new
    at = rows[open_]
    features = process.features(process.take(states, at))
    target = plan.target(plan.log_importance(committor, features), checkpoint)
    w, u = weight[at], keys.splitting_uniform(key[at])
    ratio = w / target
    into = np.minimum(ratio, MOST)
    split, light = ratio > SPLIT, ratio < ROULETTE
    copies[open_] = np.where(split, np.floor(into + u), np.where(light, u < ratio, 1)).astype(np.int64)
    new[open_] = np.where(split, w / into, np.where(light, target, w))
    return copies, new


def _count(
    events: Array, hits: Rows, root: Rows, weight: Array, before: Array, after: Array, levels: Array
) -> None:
    """Add the paths that came to a level between two checkpoints."""
    for j, level in enumerate(levels):
        new = np.flatnonzero((after <= level) & ~(before <= level))
        np.add.at(events[:, j], root[new], weight[new])
        np.add.at(hits[:, j], root[new], 1)
