"""`tailroad` and its commands, and how errors end: exit code 2 and one clear text, never a traceback for bad input."""

import importlib
from importlib.metadata import version
from typing import Any

import click

# Command -> the module that holds it, loaded when it is called: `tailroad --help` stays quick.
COMMANDS = {
    "estimate": "service.cli.estimate",
    "rollout": "service.cli.rollout",
    "failures": "service.cli.failures",
    "replay": "service.cli.replay",
    "compare": "service.cli.compare",
    "report": "service.cli.report",
    "schema": "service.cli.schema",
    "scenario": "service.cli.scenario",
    "nets": "service.cli.nets",
    "train": "service.cli.train",
    "data": "service.cli.data",
    "drivers": "service.cli.drivers",
    "bench": "service.cli.bench",
    "export": "service.cli.export",
    "serve": "service.cli.serve",
    "worker": "service.cli.worker",
}
INTERRUPTED = 130


class Tailroad(click.Group):
    """A group whose commands are loaded on demand and whose errors are told in one sentence."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        return importlib.import_module(COMMANDS[name]).command

    def invoke(self, ctx: click.Context) -> Any:
        from ce import CeError
        from policies.drivers import WeightsError
        from service.errors import TailroadError
        from sumo_nets.errors import NetworkError

        try:
            return super().invoke(ctx)
        except (TailroadError, CeError, WeightsError, NetworkError) as error:
            raise BadInput(str(error)) from error


class BadInput(click.ClickException):
    """Something the user can put right."""

    exit_code = 2


@click.group(cls=Tailroad, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(version("tailroad"), prog_name="tailroad")
def main() -> None:
    """How probable is a dangerous event for this driving policy in real traffic, how sure are we, how does it fail?"""
