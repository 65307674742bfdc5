"""`tailroad.compare`: egos on the same draws, or runs that there are already."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from string import ascii_lowercase
from typing import Any

from service.analysis.comparison.compare import comparison_of
from service.analysis.comparison.objects import Comparison
from service.analysis.failures.examine import EXAMINED, Watch, look_away
from service.analysis.notebook import comparison_html
from service.analysis.run.carry_out import MAX_FAILED, Interrupted, carry_out, new_folder, plain
from service.analysis.run.progress import Tell, told
from service.analysis.run.question import BUDGET, CONFIDENCE, SEED, jobs_of
from service.analysis.run.records import record_of
from service.analysis.run.run import Run
from service.errors import InputError
from service.evaluation.cores import core_count
from service.evaluation.pool import WORLDS, InSumo
from service.evaluation.record import JobRecord
from service.evaluation.store import RunDirectory
from service.world.egos.here import ego_name
from service.world.scenario import Scenario
from service.world.scenario.noise_mode import NoiseMode

SAME_DRAWS = "naive"  # the method whose rollouts egos share


@dataclass(frozen=True)
class Compared:
    """Runs beside each other.

    runs: their directories
    comparison: differences and ratios of p, curves, failure modes that came and went
    """

    runs: tuple[Path, ...]
    comparison: Comparison

    def __repr__(self) -> str:
        return f"<Compared {', '.join(str(run) for run in self.runs)}: {self.comparison.pairs[0].summary}>"

    def _repr_html_(self) -> str:
        return comparison_html(self.comparison)

    def report(self, path: str | Path) -> Path:
        """Write the comparison as an HTML page; its path."""
        from service.analysis.report.comparison import write_comparison

        write_comparison(self.comparison, Path(path))
        return Path(path)


def compare(
    what: str | Path | Scenario | Sequence[str | Path | Run],
    egos: Sequence[Any] = (),
    *,
    gamma: float | None = None,
    method: str | None = None,
    budget: int | None = None,
    confidence: float | None = None,
    seed: int | None = None,
    measure: str | None = None,
    noise_mode: NoiseMode | None = None,
    examine: int = EXAMINED,
    out: str | Path | None = None,
    workers: int | None = None,
    in_sumo: InSumo = "some",
    executor: Executor | None = None,
    progress: Tell | bool = True,
    watch: Watch = look_away,
    max_failed: float = MAX_FAILED,
) -> Compared:
    """Compare egos on a scenario, run on the same draws, or runs that there are already.

    what: a scenario, as of `estimate`, with `egos` as names, classes, functions or instances; or run directories or
        Runs, without egos.
    method: of a scenario: default naive, whose rollouts alone are the same draws for every ego; of
        runs: which of their jobs, default one that all have.
    gamma: needed for a scenario; of runs default their own.
    budget, confidence, seed, measure, noise_mode: of a scenario, as of `estimate`; runs have their own.
    examine: dangerous rollouts of each at most that are run again and grouped into failure modes.
    out: folder of the run directories; what it holds already is gone on with.
    watch: told of (done, total) while dangerous rollouts are run again; the rest as of `estimate`.

    >>> import tailroad
    >>> found = tailroad.compare(
    ...     "i80-paper-10s", ["idm", "sumo:Krauss"], gamma=2.0, budget=40, examine=0, out=folder, workers=1
    ... )
    >>> [side.events for side in found.comparison.sides]
    [24, 26]
    """
    count = workers or core_count()
    if isinstance(what, str | Path | Scenario):
        if gamma is None:
            raise InputError("give the event's threshold in the measure's unit, as in --gamma 0.5")
        names = [ego_name(ego) for ego in egos]
        if len(names) < 2 or len(set(names)) < len(names):
            given = ", ".join(names) or "none"
            raise InputError(
                f"--ego: give two or more different egos, as in --ego idm --ego lidar, not {given}"
            )
        jobs = [
            jobs_of(what, name, gamma, method or SAME_DRAWS, budget=BUDGET if budget is None else budget,
                    confidence=CONFIDENCE if confidence is None else confidence, seed=SEED if seed is None else seed,
                    measure=measure, noise_mode=noise_mode)
            for name in names
        ]  # fmt: skip
        folder = Path(out) if out is not None else new_folder("compare", jobs[0][0].scenario.name)
        paths = [
            folder / f"{letter}-{plain(name)}" for letter, name in zip(ascii_lowercase, names, strict=False)
        ]
        try:
            with told(progress, count, lambda one: one.job.ego) as tell:
                for asked, path in zip(jobs, paths, strict=True):
                    carry_out(path, asked, count, tell, max_failed, WORLDS[in_sumo], executor)
        except Interrupted:
            raise Interrupted(folder) from None
        records = [record_of(path)[0] for path in paths]
    else:
        of_scenarios = {
            "ego": tuple(egos) or None, "out": out, "budget": budget, "confidence": confidence, "seed": seed,
            "measure": measure, "noise_mode": noise_mode,
        }  # fmt: skip
        if refused := [name for name, value in of_scenarios.items() if value is not None]:
            options = ", ".join(f"--{name}" for name in refused)
            raise InputError(
                f"runs have their own {', '.join(refused)}: leave out {options}, or name a scenario"
            )
        paths = [one.path if isinstance(one, Run) else Path(one) for one in what]
        records = _records(paths, method, gamma)
    found = comparison_of(records, [str(path) for path in paths], examine, count, paths, watch)
    return Compared(tuple(paths), found)


def _records(runs: Sequence[Path], method: str | None, gamma: float | None) -> list[JobRecord]:
    """The records of the runs' jobs: of the method given, else of the first that all have, else the best of each.

    Raises StoreError where a run cannot be read and InputError where it has no such method.
    """
    if method is None:
        names = []
        for run in runs:
            with RunDirectory.open(run) as store:
                names.append([job.id for job in store.jobs])
        method = next((name for name in names[0] if all(name in others for others in names[1:])), None)
    return [record_of(run, method, gamma)[0] for run in runs]
