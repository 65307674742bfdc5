"""Other libraries' estimators on the reference problems, for the calibration table; none is a dependency of `ce`."""

from typing import Any

import numpy as np

from ce.standard import from_standard
from tests.reference.problems import Problem

OPENTURNS = ("ot-ce", "ot-nais", "ot-subset")


class CallLimit(RuntimeError):
    """f was called more often than a search that ends would."""


def openturns(problem: Problem, method: str, budget: int, seed: int, most_calls: int) -> dict[str, Any]:
    """One run of OpenTURNS, in standard-normal space, with a tenth of the budget for each level; a flat record."""
    import openturns as ot

    ot.Log.Show(ot.Log.NONE)
    ot.RandomGenerator.SetSeed(seed)
    d = problem.base.dim
    calls = 0

    def f(u: Any) -> Any:
        nonlocal calls
        u = np.array(u)
        calls += u.shape[0]
        if calls > most_calls:
            raise CallLimit(f"more than {most_calls} calls of f")
        return problem.f(from_standard(problem.base, u)).reshape(-1, 1)

    vector = ot.RandomVector(ot.Normal(d))
    output = ot.CompositeRandomVector(ot.PythonFunction(d, 1, func_sample=f), vector)
    event = ot.ThresholdEvent(output, ot.LessOrEqual(), problem.gamma)
    size = budget // 10
    if method == "ot-nais":
        algorithm = ot.NAIS(event, 0.1)
    elif method == "ot-ce":
        algorithm = ot.StandardSpaceCrossEntropyImportanceSampling(event, 0.1)
    else:
        algorithm = ot.SubsetSampling(event)
    algorithm.setMaximumOuterSampling(size)
    algorithm.setBlockSize(1)
    algorithm.run()
    result = algorithm.getResult()
    p, half = result.getProbabilityEstimate(), 0.5 * result.getConfidenceLength(0.95)
    return {"p": p, "low": p - half, "high": p + half, "calls": calls, "warned": [], "by": method}
