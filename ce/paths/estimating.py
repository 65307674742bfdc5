"""The whole method against a process in this process."""

from collections.abc import Callable
from typing import Any

from ce.paths.path_estimate import PathEstimate
from ce.paths.path_options import PathOptions
from ce.paths.path_state import PathBatch
from ce.paths.plan import Committor
from ce.paths.process import Process
from ce.paths.sampling import PathSampling
from ce.paths.tree import Driven, drive


def estimate_paths(
    process: Process[Any],
    gamma: float,
    budget: int = 20_000,
    confidence: float = 0.95,
    seed: int = 0,
    options: PathOptions | None = None,
    committor: Committor | None = None,
    run: Callable[[PathBatch], Driven] | None = None,
) -> PathEstimate:
    """Estimate the chance that the smallest measure of a path comes to gamma or below; CeError for wrong use.

    process: the simulator, as `ce.Simulator` or one's own `ce.Process`
    gamma: threshold of the event, in the unit of the measure
    budget: simulated steps, in whole paths; training included
    confidence: of the interval, in (0, 1)
    seed: 0 <= seed < 2^64; same seed, same bits
    options: in place of budget and confidence
    committor: that an earlier run has trained (`est.committor`), so that no training is paid for; None to train one
    run: drives a batch, elsewhere perhaps and in parts; None to drive it here

    >>> import ce, numpy as np
    >>> walk = ce.Simulator(
    ...     base=ce.Product([ce.Normal([0.0], [[0.01]])]),
    ...     start=lambda x: x,
    ...     step=lambda s, z, k: s + 0.1 * z,
    ...     measure=lambda s: 2.5 - s[:, 0],
    ...     horizon=60,
    ... )
    >>> est = ce.estimate_paths(walk, gamma=0.0, budget=2000, seed=1)
    >>> bool(est.ci[0] < 0.00099 < est.ci[1])
    True
    """
    chosen = options or PathOptions(budget=budget, confidence=confidence)
    method = PathSampling(process, gamma, chosen, committor)
    state = method.init(seed)
    while (batch := method.propose(state)) is not None:
        if run is not None:
            driven = run(batch)
        else:
            driven = drive(
                process,
                batch.roots,
                batch.levels,
                method.checkpoints,
                batch.plan,
                method.committor(state),
                batch.record,
            )
        state, _ = method.update(state, batch, driven)
    return method.estimate(state)
