"""`tailroad` and its commands, and how errors end: exit code 2 and one clear text, never a traceback for bad input."""

import importlib
from importlib.metadata import version
from typing import Any

import click

# Command -> the module that holds it, as `command` or by the name after a colon. It is loaded when it is called:
# `tailroad --help` stays quick.
COMMANDS = {
    "estimate": "service.cli.estimate",
    "rollout": "service.cli.rollout",
    "failures": "service.cli.failures",
    "replay": "service.cli.replay",
    "compare": "service.cli.compare",
    "report": "service.cli.report",
    "reproduce": "service.cli.reproduce",
    "schema": "service.cli.schema",
    "scenario": "service.cli.scenario",
    "scene": "service.cli.scene",
    "nets": "service.cli.nets",
    "train": "service.cli.train",
    "data": "service.cli.data",
    "drivers": "service.cli.drivers",
    "bench": "service.cli.bench",
    "export": "service.cli.export",
    "serve": "service.cli.serve",
    "worker": "service.cli.worker",
    "submit": "service.cli.submit",
    "jobs": "service.cli.jobs",
    "show": "service.cli.show",
    "watch": "service.cli.watch",
    "cancel": "service.cli.orders:cancel",
    "pause": "service.cli.orders:pause",
    "resume": "service.cli.orders:resume",
    "batch": "service.cli.batch",
    "get": "service.cli.get",
    "health": "service.cli.health",
    "dashboard": "service.cli.dashboard",
}
INTERRUPTED = 130


class Tailroad(click.Group):
    """A group whose commands are loaded on demand and whose errors are told in one sentence."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module, _, command = COMMANDS[name].partition(":")
        return getattr(importlib.import_module(module), command or "command")

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except Exception as error:
            if isinstance(error, _told_in_a_sentence()):
                raise BadInput(str(error)) from error
            raise


def _told_in_a_sentence() -> tuple[type[Exception], ...]:
    """Errors that the user can put right; imported only where there is one, as that takes a while."""
    from ce import CeError
    from policies.drivers import WeightsError
    from service.errors import TailroadError
    from sumo_nets.errors import NetworkError

    return TailroadError, CeError, WeightsError, NetworkError


class BadInput(click.ClickException):
    """Something the user can put right."""

    exit_code = 2


@click.group(cls=Tailroad, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(version("tailroad"), prog_name="tailroad")
def main() -> None:
    """How probable is a dangerous event for this driving policy in real traffic, how sure are we, how does it fail?"""
