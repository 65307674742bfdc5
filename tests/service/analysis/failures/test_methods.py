"""Failures of every method: made-up values of f, and a stand-in for running rollouts again."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import ce
from service.analysis.failures.find import find_failures
from service.analysis.failures.rerun import Rerun, Rerunner
from service.errors import InputError
from service.evaluation.evaluate import evaluate
from service.evaluation.job import Job, Problem, make_job
from service.evaluation.record import replay
from service.evaluation.store import Chunk, RunDirectory
from service.world.scenario import Scenario
from tests.service.analysis.failures.test_modes import PASS, REAR_END

OPTIONS = {
    "naive": {"budget": 1500},
    "ce": {
        "iterations": 2,
        "samples_per_iteration": 400,
        "estimation_rollouts": 800,
        "rho": 0.1,
        "mean_box": 1e-4,
        "max_kl": 2.5,
    },
    "splitting": {"budget": 8000},
}
GAMMA = 0.9


def made_up_f(x: np.ndarray) -> np.ndarray:
    """f of rollouts x (n, d), lower the faster the ego is and the closer its neighbour in lane 2 starts."""
    return 0.1 + 0.05 * np.abs(x[:, 8] - x[:, 0]) + 0.3 * (20.0 - x[:, 3])


class StandIn(Rerunner):
    """Rollouts in which the neighbour starts ahead are rear-ends, the others passes."""

    def run(self, drawn, traced=(), on_done=lambda count: None):
        return [
            Rerun(float(made_up_f(x[None])[0]), "horizon", None, motion=REAR_END if x[8] > x[0] else PASS)
            for x, _ in drawn
        ]


def no_ending(x: np.ndarray) -> np.ndarray:
    return np.zeros(len(x), np.uint8)


@contextmanager
def made_up_run(
    scenario: Scenario, method: str, folder: Path, ended: Callable[[np.ndarray], np.ndarray] = no_ending
) -> Iterator[tuple[RunDirectory, Job]]:
    """A run of `method` whose rollouts have f by `made_up_f` and endings (n,) uint8 by `ended`."""
    job = make_job(scenario, "idm", GAMMA, method, 1, OPTIONS[method])
    problem = Problem(job)
    with RunDirectory.create(folder, (job,)) as store:

        def run_batch(batch: ce.Batch) -> np.ndarray:
            f = made_up_f(batch.x)
            steps = np.full(f.size, 100, np.int32)
            chunk = Chunk(batch.start, batch.stop, f, ended(batch.x), steps, {}, 0.1)
            store.append(job.id, batch.phase, batch.iteration, chunk)
            return f

        evaluate(problem.algorithm, problem.stream_seed, run_batch)
        yield store, job


@pytest.fixture(params=OPTIONS)
def record(request, make_scenario, tmp_path):
    with made_up_run(make_scenario(), request.param, tmp_path / "run") as (store, job):
        return replay(store, job)


def test_failures_of_every_method_are_those_it_met(record):
    found = find_failures("run", record, StandIn(record.job), limit=50)
    failures, estimate = found.failures, record.estimate
    assert failures.events > 10
    assert all(f.same_to_the_bit and f.f <= GAMMA for f in failures.failures)
    x = np.array([x for x, _ in found.examined.events.drawn(found.ranking[:50])])
    density = record.problem.base.log_density(x)
    assert density == pytest.approx([f.log_likelihood for f in failures.failures])
    assert density.tolist() == sorted(density, reverse=True)
    assert {m.mode for m in failures.modes} == {"rear-end", "pass-left"}
    assert sum(m.share for m in failures.modes) == pytest.approx(1.0)
    if failures.examined == failures.events:
        assert sum(m.p for m in failures.modes) == pytest.approx(estimate.p)
    for mode in failures.modes:
        assert mode.share_ci[0] <= mode.share <= mode.share_ci[1]
        assert mode.ci[0] <= mode.p <= mode.ci[1]
        assert 0.1 < mode.share < 0.9  # ahead or behind is as likely
    if record.job.method == "ce":
        assert len({f.weight for f in failures.failures}) > 10
    if record.job.method == "splitting":
        assert any("Markov chains" in note for note in failures.notes)
        assert sum(f.share for f in failures.failures) <= 1.0 + 1e-9
        harmless = next(k for k in record.explicit_batches if ("train", k[1], 0) not in record.explicit)
        with pytest.raises(InputError, match="neither dangerous nor failed"):
            record.redraw("train", harmless[1], 0)
