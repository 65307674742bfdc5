"""Pages: Markdown, pictures and the results as JSON. Every number comes from the results."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from service.analysis.report.ink import Picture
from service.analysis.wording import count, duration
from service.studies.reproduce.local import Outcome
from service.studies.reproduce.pictures import pictures_of, write_picture
from service.studies.reproduce.tables import Table, tables_of
from service.world.sim.audited import EVERY

SOFTWARE = ("tailroad", "libsumo", "numpy", "scipy", "numba")


class Page(NamedTuple):
    """A page of results and what lies beside it.

    name: of its file, and of the folder beside it with the pictures (by file name) and the results
    """

    name: str
    title: str
    introduction: Sequence[str]  # paragraphs
    tables: Sequence[Table]
    pictures: Sequence[tuple[str, Picture]]
    results: Any  # written as results.json


def write_page(page: Page, folder: Path) -> Path:
    """Write NAME.md, and NAME/ with its pictures and results; returns the page's path."""
    beside = folder / page.name
    beside.mkdir(parents=True, exist_ok=True)
    lines = [f"# {page.title}", ""]
    for paragraph in page.introduction:
        lines += [paragraph, ""]
    for table in page.tables:
        lines += [f"## {table.title}", "", *markdown(table), "", *([table.note, ""] if table.note else [])]
    for file, picture in page.pictures:
        write_picture(beside / file, picture)
        lines += [f"![{picture.alt}]({page.name}/{file})", "", f"*{picture.title}. {picture.caption}*", ""]
    path = folder / f"{page.name}.md"
    path.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")
    (beside / "results.json").write_bytes(
        msgspec.json.format(msgspec.json.encode(page.results), indent=1) + b"\n"
    )
    return path


def made_by(command: str, goes_on: bool = True) -> str:
    """The sentence that every page begins with.

    goes_on: an interrupted run is continued by the same command
    """
    return f"Made by `{command}`, numbers and pictures alike." + (
        " Interrupted, the same command goes on." if goes_on else ""
    )


def made_with() -> str:
    """The software's versions."""
    return ", ".join(f"{name} {version(name)}" for name in SOFTWARE) + "."


def page_of(outcome: Outcome, command: str) -> Page:
    """The page of a plan that was carried out."""
    return Page(
        f"{outcome.plan.name}-{outcome.plan.scale}",
        f"{outcome.plan.title} ({outcome.plan.scale})",
        [made_by(command), _introduction(outcome), made_with()],
        tables_of(outcome),
        pictures_of(outcome),
        {"plan": outcome.plan, "results": outcome.results},
    )


def page_of_several(title: str, outcomes: Sequence[Outcome], command: str) -> Page:
    """One page for plans that belong together."""
    plan = outcomes[0].plan
    tables, pictures = [], []
    for i, outcome in enumerate(outcomes):
        own = outcome.plan.title
        tables += [t._replace(title=f"{own}: {t.title[0].lower()}{t.title[1:]}") for t in tables_of(outcome)]
        pictures += [
            (f"{i}-{file}", replace(p, title=f"{own}: {p.title}")) for file, p in pictures_of(outcome)
        ]
    return Page(
        f"{plan.name}-{plan.scale}",
        f"{title} ({plan.scale})",
        [made_by(command), *(f"{o.plan.title}. {_introduction(o)}" for o in outcomes), made_with()],
        tables,
        pictures,
        [{"plan": o.plan, "results": o.results} for o in outcomes],
    )


def markdown(table: Table) -> Iterable[str]:
    yield "| " + " | ".join(table.head) + " |"
    yield "|" + " --- |" * len(table.head)
    for row in table.rows:
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"


def _introduction(outcome: Outcome) -> str:
    plan = outcome.plan
    worker_s = outcome.truth.worker_s + sum(r.worker_s for r in outcome.results)
    rollouts = outcome.truth.rollouts + sum(r.rollouts for r in outcome.results)
    world = (
        "all of them in SUMO"
        if outcome.sumo
        else f"without SUMO, one in {EVERY} of them in SUMO too, with the same bits"
    )
    return (
        f"Scenario `{plan.truth.scenario}`, ego `{plan.truth.ego}`, f the smallest time to collision. "
        f"{count(rollouts)} rollouts, {duration(worker_s)} of workers' time, {world}. Ground truth: naive Monte Carlo, "
        f"seed {plan.truth.seed}, {count(outcome.truth.rollouts)} rollouts. Intervals are 95%."
    )
