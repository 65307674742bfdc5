"""What the learned proposals do, how the ego fails and what it looks like: the paper's qualitative analysis."""

from collections.abc import Callable
from pathlib import Path

import msgspec

from service.analysis.exports import write_exports
from service.analysis.failures.events import events_of
from service.analysis.failures.find import Found, find_failures
from service.analysis.failures.rerun import Rerunner
from service.analysis.learned.learn import learned_of
from service.analysis.learned.objects import Learned, Rate
from service.analysis.wording import count, percent, significant
from service.evaluation.record import JobRecord, replay
from service.evaluation.store import RunDirectory
from service.studies.reproduce.local import Watch, finish_run
from service.studies.reproduce.page import Page, made_by, made_with
from service.studies.reproduce.plans import TWO, Run
from service.studies.reproduce.tables import Table, number


class Size(msgspec.Struct, frozen=True):
    """How much is run and looked at.

    gammas: thresholds of the event
    budget: rollouts of each run
    examined: rollouts that are run again for behaviours
    films: of each run
    """

    gammas: tuple[float, ...]
    budget: int
    examined: int
    films: int


SIZES = {
    "smoke": Size((0.75,), 1000, 8, 1),
    "small": Size((0.58,), 2000, 40, 2),
    "medium": Size((0.58, 0.46), 20_000, 300, 3),
    "large": Size((0.58, 0.46, 0.38), 50_000, 500, 3),
    "paper": Size((0.58, 0.46, 0.38, 0.32), 100_000, 1000, 4),
}
SCENARIO, EGO = "i80-paper-10s", "lidar-paper"


class ExaminedRun(msgspec.Struct, frozen=True):
    """A run, looked at."""

    run: Run
    learned: Learned
    failures: msgspec.Raw
    films: tuple[str, ...]


def runs_of(size: Size, seed: int) -> list[Run]:
    """At each threshold the paper's method, kept near P0, and splitting, which shows the event itself."""
    return [
        Run(series=f"{series}, γ = {gamma:g} s", scenario=SCENARIO, ego=EGO, gamma=gamma, method=method,
            options={"budget": size.budget, **options}, seed=seed, noise_mode=noise_mode)
        for gamma in size.gammas
        for series, method, options, noise_mode in TWO
    ]  # fmt: skip


def qualitative_page(
    scale: str, seed: int, out: Path, pages: Path, workers: int, sumo: bool, watch: Watch, command: str
) -> Page:
    """Run what is missing, look at it, and write the films beside the page."""
    size = SIZES[scale]
    name = f"qualitative-{scale}"
    tables: list[Table] = []
    seen: list[ExaminedRun] = []
    words: list[str] = []
    for run in runs_of(size, seed):
        finish_run(run, (run.gamma,), out, workers, sumo, watch)
        with RunDirectory.open(out / run.folder) as store:
            record = replay(store, store.jobs[0])
        with Rerunner(record.job, workers) as rerunner:
            watch.on_part(f"{run.series}: what was learned", 0)
            learned = learned_of(run.series, record, rerunner, size.examined)
            found = find_failures(run.series, record, rerunner, limit=20, most=max(size.examined, 20))
        films = _films(record, found, pages / name, len(seen), size.films, watch.on_part)
        seen.append(ExaminedRun(run, learned, msgspec.Raw(msgspec.json.encode(found.failures)), films))
        tables += [_starts(run, learned), _behaviours(run, learned), _modes(run, found, films, name)]
        shifts = " ".join(_sentence(part) for part in learned.summary) or "No shift stands out of chance."
        words.append(f"**{run.series}.** {shifts} {' '.join(learned.notes)}")
    introduction = [
        made_by(command),
        f'Scenario `{SCENARIO}`, ego `{EGO}`. "Proposal" is the distribution that a search has learned (CE), or the '
        "dangerous rollouts themselves (splitting). Intervals are 95%.",
        *words,
        made_with(),
    ]
    return Page(name, f"Qualitative analysis ({scale})", introduction, tables, [], seen)


def _sentence(part: str) -> str:
    return part[0].upper() + part[1:].removesuffix(".") + "."


def _starts(run: Run, learned: Learned) -> Table:
    """Every start's mean and spread; variances stand apart, because the paper's halved."""
    rows = []
    for p in learned.parameters:
        if p.proposal is None or p.shift_sd is None:
            continue
        low, high = p.shift_sd_ci or (None, None)
        rows.append((p.name, f"{significant(p.base.mean)} → {significant(p.proposal.mean)} {p.unit}",
                     f"{number(p.shift_sd)} ({number(low)} to {number(high)})",
                     number((p.proposal.sd / p.base.sd) ** 2)))  # fmt: skip
    return Table(
        f"{run.series}: starts",
        ("start", "mean, base → proposal", "shift, standard deviations (95% interval)", "ratio of variances"),
        tuple(rows),
        "",
    )


def _behaviours(run: Run, learned: Learned) -> Table:
    rows = tuple((b.what, b.unit, _rate(b.base), _rate(b.proposal)) for b in learned.behaviours)
    again = learned.rollouts_run_again
    return Table(f"{run.series}: how the drivers drive", ("", "unit", "base", "proposal"), rows,
                 f"From {again[0]} and {again[1]} rollouts, run again in SUMO.")  # fmt: skip


def _rate(rate: Rate | None) -> str:
    if rate is None or rate.value is None:
        return "–"
    return f"{number(rate.value)} ({number(rate.low)} to {number(rate.high)})"


def _modes(run: Run, found: Found, films: tuple[str, ...], folder: str) -> Table:
    failures = found.failures
    rows = tuple(
        (m.name, count(m.events), f"{percent(m.share)} ({percent(m.share_ci[0])} to {percent(m.share_ci[1])})",
         f"{significant(m.p, 2)} ({significant(m.ci[0], 2)} to {significant(m.ci[1], 2)})", m.typical)
        for m in failures.modes
    )  # fmt: skip
    links = ", ".join(f"[{film}]({folder}/{film})" for film in films)
    return Table(f"{run.series}: how it fails", ("mode", "rollouts", "share of p", "p", "typically"), rows,
                 " ".join([*failures.notes, f"Films: {links}." if links else ""]).strip())  # fmt: skip


def _films(
    record: JobRecord, found: Found, folder: Path, number_: int, most: int, tell: Callable[[str, int], None]
) -> tuple[str, ...]:
    """A film of the likeliest rollout of each of the first modes."""
    events = events_of(record)
    written = []
    folder.mkdir(parents=True, exist_ok=True)
    for mode in found.failures.modes[:most]:
        position = next((i for i in found.ranking if found.modes.get(i) == mode.mode), None)
        if position is None:
            continue
        ((x, noise_seed),) = events.drawn([position])
        film = f"{number_}-{mode.mode}.mp4"
        title = f"f = {events.f[position]:.3f} s: {mode.name}"
        tell(f"film {film}", 0)
        write_exports(record.problem, x, noise_seed, title, {"mp4": folder / film})
        written.append(film)
    return tuple(written)
