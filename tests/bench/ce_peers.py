"""Other libraries' estimators on the reference problems, for the calibration table; none is a dependency of `ce`."""

import importlib.metadata
from collections.abc import Callable
from typing import Any

import numpy as np

from ce.standard import from_standard
from tests.reference.problems import Problem

OPENTURNS = ("ot-ce", "ot-nais", "ot-subset")
UQPY = "uqpy-subset"
PEERS = (*OPENTURNS, UQPY)


F = Callable[[Any], Any]


class CallLimit(RuntimeError):
    """f was called more often than a search that ends would."""


def peer(problem: Problem, method: str, budget: int, seed: int, most_calls: int) -> dict[str, Any]:
    """One run of another library's method, in standard-normal space, with a tenth of the budget for each level; a flat
    record."""
    calls = 0

    def f(u: Any) -> Any:
        nonlocal calls
        u = np.array(u)
        calls += u.shape[0]
        if calls > most_calls:
            raise CallLimit(f"more than {most_calls} calls of f")
        return problem.f(from_standard(problem.base, u)) - problem.gamma

    run = _uqpy if method == UQPY else _openturns
    p, half = run(f, problem.base.dim, method, budget // 10, seed)
    return {"p": p, "low": p - half, "high": p + half, "calls": calls, "warned": [], "by": method}


def peer_version(method: str) -> str:
    """The library and its version; ImportError where it is not installed."""
    library = "UQpy" if method == UQPY else "openturns"
    return f"{library} {importlib.metadata.version(library)}"


def _openturns(f: F, d: int, method: str, size: int, seed: int) -> tuple[float, float]:
    """p and the half-width of its 95% interval."""
    import openturns as ot

    ot.Log.Show(ot.Log.NONE)
    ot.RandomGenerator.SetSeed(seed)
    vector = ot.RandomVector(ot.Normal(d))
    function = ot.PythonFunction(d, 1, func_sample=lambda u: f(u).reshape(-1, 1))
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, vector), ot.LessOrEqual(), 0.0)
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
    return result.getProbabilityEstimate(), 0.5 * result.getConfidenceLength(0.95)


def _uqpy(f: F, d: int, method: str, size: int, seed: int) -> tuple[float, float]:
    """Subset simulation with component-wise chains (Au and Beck); its coefficient of variation for dependent chains."""
    import UQpy.distributions
    import UQpy.reliability
    import UQpy.run_model
    import UQpy.sampling

    class Model(UQpy.run_model.RunModel):  # its own wants a file with the model in it
        def __init__(self) -> None:
            self.qoi_list: list[float] = []

        def run(self, samples: Any, append_samples: bool = True) -> None:
            self.qoi_list = [*self.qoi_list, *f(samples)]

    source = np.random.RandomState(seed)
    start = source.standard_normal((size, d))
    chains = UQpy.sampling.ModifiedMetropolisHastings(
        log_pdf_target=[UQpy.distributions.Normal().log_pdf] * d,
        dimension=d,
        n_chains=size // 10,
        random_state=source,
    )
    found = UQpy.reliability.SubsetSimulation(
        runmodel_object=Model(), sampling=chains, samples_init=start, nsamples_per_subset=size
    )
    p = float(found.failure_probability)
    return p, 1.96 * p * float(found.dependent_chains_CoV)
