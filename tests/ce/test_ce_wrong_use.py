import msgspec
import numpy as np
import pytest

import ce
from tests.reference.problems import BETAS, LINEAR_2


@pytest.mark.parametrize("gamma", [np.nan, np.inf, -np.inf, "low", None])
@pytest.mark.parametrize("method", ce.METHODS)
def test_gamma_must_be_a_finite_number(gamma, method):
    with pytest.raises(ce.ThresholdError):
        ce.estimate(LINEAR_2.f, LINEAR_2.base, gamma, method)


@pytest.mark.parametrize(
    "answer", [lambda x: 1.0, lambda x: x, lambda x: x[:-1, 0], lambda x: ["a"] * len(x), lambda x: None]
)
@pytest.mark.parametrize("method", ce.METHODS)
def test_f_must_give_one_number_a_row(answer, method):
    with pytest.raises(ce.ResponseError, match="f must give"):
        ce.estimate(answer, LINEAR_2.base, 0.0, method, budget=1000)


def test_unknown_methods_and_mismatched_options_are_refused():
    with pytest.raises(ce.OptionsError, match="naive, ce"):
        ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, "subset")
    with pytest.raises(ce.OptionsError, match="NaiveOptions"):
        ce.algorithm("naive", LINEAR_2.base, 0.0, ce.CrossEntropyOptions())
    with pytest.raises(ce.OptionsError, match="AutoOptions"):
        ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, "auto", options=ce.NaiveOptions())
    with pytest.raises(ce.FamilyError):
        ce.estimate(LINEAR_2.f, "base", 0.0, "ce")


@pytest.mark.parametrize("method", ce.METHODS)
def test_states_and_batches_of_another_problem_are_refused(method):
    one, two = (ce.algorithm(method, BETAS.base, gamma) for gamma in (0.2, 0.3))
    state = one.init(0)
    with pytest.raises(ce.StateError, match="another"):
        two.from_bytes(ce.to_bytes(state))
    with pytest.raises(ce.StateError, match="not a"):
        one.from_bytes(b"junk")
    with pytest.raises(ce.StateError, match="not a"):
        one.from_bytes(ce.to_bytes(state)[:-3])
    older = msgspec.msgpack.decode(ce.to_bytes(state)) | {"format": 1}
    for fields in (older, {name: value for name, value in older.items() if name != "phase"}):
        with pytest.raises(ce.StateError, match="format 1, this version reads"):
            one.from_bytes(msgspec.msgpack.encode(fields))
    batch = one.propose(state)
    with pytest.raises(ce.StateError, match="does not answer"):
        one.update(one.init(1), batch, BETAS.f(batch.x))
    after, _ = one.update(state, batch, BETAS.f(batch.x))
    with pytest.raises(ce.StateError, match="does not answer"):
        one.update(after, batch, BETAS.f(batch.x))


def test_a_finished_state_takes_no_more_batches():
    algorithm = ce.algorithm("naive", BETAS.base, 0.2, ce.NaiveOptions(budget=10))
    state = algorithm.init(0)
    batch = algorithm.propose(state)
    state, _ = algorithm.update(state, batch, BETAS.f(batch.x))
    assert algorithm.propose(state) is None
    with pytest.raises(ce.StateError):
        algorithm.update(state, batch, BETAS.f(batch.x))


def test_what_f_raises_passes_through():
    def f(x):
        raise RuntimeError("simulator gone")

    with pytest.raises(RuntimeError, match="simulator gone"):
        ce.estimate(f, BETAS.base, 0.2, "ce")


@pytest.mark.parametrize("method", ce.METHODS)
@pytest.mark.parametrize("event", ["certain", "impossible", "failed"])
def test_every_search_ends_with_a_probability_whatever_f_says(method, event):
    said = {"certain": -1.0, "impossible": np.inf, "failed": np.nan}[event]
    est = ce.estimate(lambda x: np.full(len(x), said), BETAS.base, 0.0, method, budget=2000, seed=1)
    low, high = est.ci
    assert est.rollouts <= 2000
    assert 0.0 <= low <= est.p <= high <= 1.0
    assert est.p == pytest.approx(1.0 if event == "certain" else 0.0, abs=0.01)
    assert event == "certain" or est.warnings
