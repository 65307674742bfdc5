"""`tailroad watch JOB`: what a job tells, as it happens."""

import sys
from typing import Any

import click
import msgspec

from service.analysis.run.bars import progress_bar, stderr
from service.front.cli.client_options import client_options
from service.front.cli.main import INTERRUPTED
from service.front.cli.options import json_option
from service.remote.api.objects import Event
from service.remote.client import Client

NOT_DONE = 1


@click.command()
@click.argument("job")
@client_options()
@json_option()
def command(job: str, client: Client, as_json: bool) -> None:
    """Follow JOB until it is over; --json: one event a line.

    Exit codes: 0 the job is done, 1 it was cancelled or has failed, 130 interrupted (the job goes on).
    """
    try:
        status = _as_lines(client, job) if as_json else _as_bar(client, job)
    except KeyboardInterrupt:
        stderr.print("\nNo longer watching; the job goes on.")
        sys.exit(INTERRUPTED)
    sys.exit(0 if status == "done" else NOT_DONE)


def _as_lines(client: Client, job: str) -> str:
    status = ""
    for event in client.watch(job, on_silence=_on_silence):
        click.echo(msgspec.json.encode(event).decode())
        status = _status(event) or status
    return status


def _as_bar(client: Client, job: str) -> str:
    found, status = client.job(job), ""
    with progress_bar() as bar:
        task = bar.add_task(job, total=found.options.get("budget"), note="", completed=found.rollouts or 0)
        for event in client.watch(job, on_silence=_on_silence):
            if event.kind == "progress":
                bar.update(task, completed=event.body["rollouts"])
            elif event.kind == "iteration":
                bar.update(task, note=_note(event.body["record"]))
            else:
                status = _status(event) or status
                stderr.print(f"{event.at[11:19]} {_event_text(event)}", highlight=False)
    return status


def _on_silence(silent_s: float) -> None:
    stderr.print(f"no answer for {silent_s:.0f} s; asking again", highlight=False)


def _status(event: Event) -> str:
    return event.body["status"] if event.kind == "status" else ""


def _event_text(event: Event) -> str:
    body = event.body
    if event.kind == "status":
        return f"{body['status']}: {body['reason']}" if body.get("reason") else str(body["status"])
    return f"{event.kind}: " + ", ".join(f"{key} {value}" for key, value in body.items())


def _note(record: dict[str, Any]) -> str:
    if record.get("phase") == "train":
        return f"search {record['iteration'] + 1}: gamma_k {record['gamma_k']:.3g}, ESS {record['ess']:.0f}"
    return f"p = {record['p']:.3g} [{record['low']:.2g}, {record['high']:.2g}]"
