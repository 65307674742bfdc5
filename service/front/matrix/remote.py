"""Has a service run cells. A cell's job is known by its label, so that the same command finds it again, anywhere."""

from collections.abc import Iterator, Sequence

import msgspec

from service.errors import InputError
from service.front.matrix.plan import Cell
from service.front.matrix.verdict import Result, result_of
from service.remote.api.objects import OVER
from service.remote.client import Client

COMMON = ("budget", "rel_error", "confidence")
LOST = ("failed", "cancelled", "needs-restart")  # such a job is submitted anew


def submit_all(client: Client, name: str, cells: Sequence[Cell]) -> list[str]:
    """The ids of the cells' jobs; those that there are already are not submitted again."""
    known = {job.label: job for job in client.all_jobs() if job.status not in LOST}
    missing = [cell for cell in cells if _label(name, cell) not in known]
    listed = {entry.name for entry in client.scenarios().items}
    for cell in missing:
        if cell.content is None and cell.scenario not in listed:
            raise InputError(
                f"the service has no scenario {cell.scenario!r}; it has {', '.join(sorted(listed))}"
            )
    found = []
    for cell in cells:
        label = _label(name, cell)
        if label not in known:
            known[label] = client.submit(
                cell.content if cell.content is not None else cell.scenario,
                cell.gamma,
                ego=cell.ego,
                method=cell.method,
                seed=cell.seed,
                label=label,
                options={key: value for key, value in cell.options.items() if key not in COMMON},
                **{key: cell.options[key] for key in COMMON},
            )
        found.append(known[label].id)
    return found


def wait_for_all(
    client: Client, cells: Sequence[Cell], jobs: Sequence[str], limit: float | None
) -> Iterator[Result]:
    """The results in the cells' order, each as soon as it is there."""
    for cell, job in zip(cells, jobs, strict=True):
        view = client.job(job)
        while view.status not in OVER:
            view = client.wait(job)
        summary = msgspec.to_builtins(client.estimate(job)) if view.status == "done" else None
        yield result_of(cell, job, view.status, view.reason, summary, limit)


def _label(name: str, cell: Cell) -> str:
    return f"batch {name} {cell.digest}"
