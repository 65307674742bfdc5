"""Dangerous rollouts driven again: the same to the bit until the onset, parts that add up, and what is kept."""

from pathlib import Path

import numpy as np
import pytest

import tailroad
from service.analysis.failures.events import events_of
from service.analysis.prevention.conflict import HandedOver
from service.analysis.prevention.kept import kept
from service.errors import InputError
from service.evaluation.job import Problem

GAMMA = 2.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tailroad.Run:
    return tailroad.estimate(
        "i80-paper-10s", ego="idm", gamma=GAMMA, method="naive", budget=60, measure="ttc-impact",
        out=tmp_path_factory.mktemp("prevent") / "run", workers=1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def found(run: tailroad.Run):
    return run.prevent(references=("fsm", "idm", "r157-cc"))


def test_p_is_what_is_preventable_and_what_is_not(run, found):
    assert found.events == found.examined > 3
    for one in found.references:
        assert one.preventable.p + one.unpreventable.p == pytest.approx(found.p)
        assert one.preventable.events + one.unpreventable.events == found.events
        assert one.preventable.ci[0] <= one.preventable.p <= one.preventable.ci[1]
        assert sum(mode.events for mode in one.modes) == found.events
        assert sum(mode.preventable.p + mode.unpreventable.p for mode in one.modes) == pytest.approx(found.p)
        assert sum(one.outcomes.values()) == found.events
        assert one.failed == 0


def test_the_ego_itself_prevents_nothing(found):
    (itself,) = [one for one in found.references if one.reference == "idm"]
    assert itself.preventable.events == 0
    for rollout in found.rollouts:
        assert rollout.same_to_the_bit
        assert rollout.driven["idm"].f == rollout.f


def test_each_rollout_is_told_with_its_onset(found):
    assert [rollout.rank for rollout in found.rollouts] == list(range(1, found.events + 1))
    for rollout in found.rollouts:
        assert rollout.onset is not None
        assert rollout.onset.before_s >= 0.0
        for driven in rollout.driven.values():
            assert driven.prevented == (driven.f is None or driven.f > GAMMA)


def test_what_was_found_is_kept_for_this_question_alone(run, found):
    record = run.record()
    assert kept(run.path, record.job.id, GAMMA, found.events) == found
    assert kept(run.path, record.job.id, 1.0, found.events) is None
    assert kept(run.path, record.job.id, GAMMA, found.events + 1) is None


def test_an_unknown_reference_is_refused_by_name(run):
    with pytest.raises(InputError, match="r157"):
        run.prevent(references=("r157",))
    with pytest.raises(InputError, match="one at least"):
        run.prevent(references=())


def _until_the_onset(path: Path) -> tuple[bool, bool]:
    """In a process of its own, as SUMO asks: whether states agree until the handover, and differ after it."""
    record = tailroad.resume(path, workers=1).record()
    events = events_of(record)
    ((x, noise_seed),) = events.drawn([int(np.argmin(events.f))])
    with HandedOver(Problem(record.job), ("fsm",)) as world:
        before = world.as_it_was(x, noise_seed)
        at = 20
        after = world.trace_of("fsm", at, x, noise_seed)
    same = before.agents[: at + 1].tobytes() == after.agents[: at + 1].tobytes()
    shorter = min(len(before.agents), len(after.agents))
    return same, before.agents[:shorter].tobytes() != after.agents[:shorter].tobytes()


def test_until_the_handover_every_bit_is_the_same(run):
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert pool.submit(_until_the_onset, run.path).result() == (True, True)
