"""`tailroad` and its commands, and how errors end: exit code 2 and one clear text, never a traceback for bad input."""

import ast
import importlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click

# Command -> the module that holds it, as `command` or by the name after a colon. It is loaded when it is called, or
# when its help is shown.
SECTIONS = {
    "Estimate, and look at what was found": {
        "estimate": "service.front.cli.estimate",
        "batch": "service.front.cli.batch",
        "compare": "service.front.cli.compare",
        "failures": "service.front.cli.failures",
        "prevent": "service.front.cli.prevent",
        "severity": "service.front.cli.severity",
        "criticality": "service.front.cli.criticality",
        "coverage": "service.front.cli.coverage",
        "accept": "service.front.cli.accept",
        "evidence": "service.front.cli.evidence",
        "replay": "service.front.cli.replay",
        "report": "service.front.cli.report",
        "export": "service.front.cli.export",
        "verify": "service.front.cli.verify",
    },
    "A service and its workers": {
        "serve": "service.front.cli.serve",
        "worker": "service.front.cli.worker",
        "dashboard": "service.front.cli.dashboard",
        "health": "service.front.cli.health",
    },
    "Jobs of a service": {
        "submit": "service.front.cli.submit",
        "jobs": "service.front.cli.jobs",
        "show": "service.front.cli.show",
        "watch": "service.front.cli.watch",
        "pause": "service.front.cli.orders:pause",
        "resume": "service.front.cli.orders:resume",
        "cancel": "service.front.cli.orders:cancel",
        "get": "service.front.cli.get",
        "log": "service.front.cli.log",
    },
    "Roads, scenarios and drivers": {
        "scenario": "service.front.cli.scenario",
        "nets": "service.front.cli.nets",
        "scene": "service.front.cli.scene",
        "rollout": "service.front.cli.rollout",
        "drivers": "service.front.cli.drivers",
        "data": "service.front.cli.data",
        "train": "service.front.cli.train",
    },
    "Of tailroad itself": {
        "reproduce": "service.front.cli.reproduce",
        "bench": "service.front.cli.bench",
        "schema": "service.front.cli.schema",
    },
}
COMMANDS = {name: where for section in SECTIONS.values() for name, where in section.items()}
INTERRUPTED = 130
SUMMARY_LETTERS = 150


class Tailroad(click.Group):
    """A group whose commands are loaded on demand and whose errors are told in one sentence."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module, _, command = COMMANDS[name].partition(":")
        return getattr(importlib.import_module(module), command or "command")

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name, summary_of(name)) for name in commands])

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except KeyboardInterrupt:
            click.echo("\nInterrupted.", err=True)
            raise SystemExit(INTERRUPTED) from None
        except Exception as error:
            if isinstance(error, _told_in_a_sentence()):
                raise BadInput(str(error)) from error
            raise


def summary_of(name: str) -> str:
    """The first sentence of a command's help, read in its source: to import all commands takes seconds.

    Empty where the command's function has no docstring.
    """
    module, _, command = COMMANDS[name].partition(":")
    source = Path(__file__).with_name(module.rpartition(".")[2] + ".py").read_text(encoding="utf-8")
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef) and node.name == (command or "command"):
            told = click.Command(name, help=ast.get_docstring(node) or "")
            return told.get_short_help_str(SUMMARY_LETTERS)
    return ""


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
