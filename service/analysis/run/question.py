"""What was asked for, as jobs: a scenario by name, file or value, an ego, thresholds, methods with their options."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from service.errors import InputError
from service.evaluation.job import Job, make_job, told_apart
from service.evaluation.options import COMMON, PATHS, shared_out
from service.world.egos.open import check_ego, meet_ego
from service.world.paths.process import check_paths
from service.world.safety.measure import with_measure
from service.world.scenario import Scenario, load_scenario
from service.world.scenario.check import check_road
from service.world.scenario.noise_mode import NoiseMode, with_noise_mode

# Budget from which method auto drives paths where it can.
LEAST_FOR_PATHS = 2000
BUDGET, CONFIDENCE, METHOD, SEED = 20_000, 0.95, "auto", 1  # where nothing else is said


def scenario_of(
    given: str | Path | Scenario, measure: str | None = None, noise_mode: NoiseMode | None = None
) -> Scenario:
    """The scenario of that name or file, or the one given, with another measure or action noise where these are given.

    ScenarioError and InputError name what is wrong with it, its road included.
    """
    scenario = given if isinstance(given, Scenario) else load_scenario(str(given))
    source = scenario.name if isinstance(given, Scenario) else str(given)
    if measure is not None:
        scenario = with_measure(scenario, measure)
    scenario = with_noise_mode(scenario, noise_mode, source)
    check_road(scenario, source)
    return scenario


def jobs_of(
    scenario: str | Path | Scenario,
    ego: str,
    gamma: float | Sequence[float],
    method: str | Sequence[str] = METHOD,
    *,
    budget: int = BUDGET,
    rel_error: float | None = None,
    confidence: float = CONFIDENCE,
    seed: int | Sequence[int] = SEED,
    measure: str | None = None,
    noise_mode: NoiseMode | None = None,
    options: Mapping[str, Any] | None = None,
    meet: bool = True,
    committor_sha256: str = "",
    here: bool = False,
) -> tuple[Job, ...]:
    """The jobs of a run, checked: one for each method, threshold and seed.

    options: of the methods; each goes to those that have it, and one that none of them has is refused
    meet: open the ego once, so that what is wrong with it is told before a job begins
    committor_sha256: of the committor that the method paths starts from; "" where it trains its own
    here: whether all of it runs in processes of this machine, so that auto may come to drive paths
    """
    asked = scenario_of(scenario, measure, noise_mode)
    methods, gammas, seeds = _each(method, str), _each(gamma, int | float), _each(seed, int)
    own = shared_out(methods, options or {})
    common = dict(zip(COMMON, (budget, rel_error, confidence), strict=True))
    as_paths = {m for m in methods if here and m == METHOD and may_be_paths(asked, ego, common | own[m])}
    jobs = []
    for m in methods:
        used = PATHS if m in as_paths else m
        given = committor_sha256 if used == PATHS else ""
        for g in gammas:
            for s in seeds:
                job = make_job(asked, ego, float(g), used, s, common | own[m], given)
                jobs.append(job if used == m else msgspec.structs.replace(job, name=m))
    if meet:
        meet_ego(ego, asked, check_road(asked, asked.name))
    return told_apart(jobs)


def may_be_paths(scenario: Scenario, ego: str, options: Mapping[str, Any]) -> bool:
    """Whether method auto drives paths: where states can be copied, the budget is worth a pilot, and nothing is asked
    for that paths cannot give.

    options: of auto
    """
    if int(options["budget"]) < LEAST_FOR_PATHS or options.get("rel_error") is not None:
        return False
    if set(options) - set(COMMON):
        return False
    try:
        check_ego(ego)
        check_paths(scenario, ego)
    except InputError:
        return False
    return True


def _each(given: Any, kind: Any) -> tuple[Any, ...]:
    """One or several, each once; InputError where there is none."""
    found = (given,) if isinstance(given, kind) else tuple(dict.fromkeys(given))
    if not found:
        raise InputError("nothing to run: give a threshold, a method and a seed at least")
    return found
