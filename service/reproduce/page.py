"""The page of an experiment: Markdown, pictures and the results as JSON. Every number comes from the results."""

from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

import msgspec

from service.reproduce.local import Outcome
from service.reproduce.pictures import pictures_of, write_picture
from service.reproduce.tables import Table, tables_of
from service.sim.audited import EVERY
from service.wording import count, duration

SOFTWARE = ("tailroad", "libsumo", "numpy", "scipy", "numba")


def write_page(outcome: Outcome, folder: Path, command: str) -> Path:
    """Write NAME-SCALE.md, its pictures and its JSON into `folder`; returns the page's path."""
    name = f"{outcome.plan.name}-{outcome.plan.scale}"
    beside = folder / name
    beside.mkdir(parents=True, exist_ok=True)
    lines = [f"# {outcome.plan.title} ({outcome.plan.scale})", "", *_introduction(outcome, command), ""]
    for table in tables_of(outcome):
        lines += [f"## {table.title}", "", *markdown(table), "", table.note, ""]
    for file, picture in pictures_of(outcome):
        write_picture(beside / file, picture)
        lines += [f"![{picture.alt}]({name}/{file})", "", f"*{picture.title}. {picture.caption}*", ""]
    path = folder / f"{name}.md"
    path.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")
    (beside / "results.json").write_bytes(
        msgspec.json.format(msgspec.json.encode({"plan": outcome.plan, "results": outcome.results}), indent=1)
        + b"\n"
    )
    return path


def markdown(table: Table) -> Iterable[str]:
    yield "| " + " | ".join(table.head) + " |"
    yield "|" + " --- |" * len(table.head)
    for row in table.rows:
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"


def _introduction(outcome: Outcome, command: str) -> list[str]:
    plan, ran = outcome.plan, outcome.truth.ran
    worker_s = ran.worker_s + sum(r.worker_s for r in outcome.results)
    rollouts = outcome.truth.rollouts + sum(r.rollouts for r in outcome.results)
    world = (
        "all of them in SUMO"
        if outcome.sumo
        else f"without SUMO, one in {EVERY} of them in SUMO too, with the same bits"
    )
    software = ", ".join(f"{name} {version(name)}" for name in SOFTWARE)
    return [
        f"Made by `{command}`, numbers and pictures alike. Interrupted, the same command goes on.",
        "",
        f"Scenario `{plan.truth.scenario}`, ego `{plan.truth.ego}`, f the smallest time to collision. "
        f"{count(rollouts)} rollouts, {duration(worker_s)} of workers' time, {world}. Ground truth: naive Monte Carlo, "
        f"seed {plan.truth.seed}, {count(outcome.truth.rollouts)} rollouts. Intervals are 95%. {software}.",
    ]
