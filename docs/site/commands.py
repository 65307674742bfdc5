"""The command-line reference: what `tailroad COMMAND --help` says, as one page."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import EntryPoint

import click

from docs.site.gather import ROOT

_WIDTH = 96


def page() -> str:
    """Every command with its arguments and options."""
    main = _command()
    parts = [
        "# Command line",
        "Made from the commands themselves: `tailroad COMMAND --help` says the same.",
        "Exit codes: 0 done, 2 bad input (the text says what to do), 3 precision not reached within the budget, "
        "130 interrupted.",
    ]
    context = click.Context(main, info_name="tailroad")
    for title, names in sys.modules[type(main).__module__].SECTIONS.items():
        parts.append(f"## {title}")
        for name in names:
            command = main.get_command(context, name)
            assert command is not None
            parts += _told(command, click.Context(command, info_name=name, parent=context))
    return "\n\n".join(parts) + "\n"


def _command() -> click.Group:
    """The command that an installation calls `tailroad`."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = EntryPoint("tailroad", project["scripts"]["tailroad"], "console_scripts").load()
    assert isinstance(found, click.Group)
    return found


def _told(command: click.Command, context: click.Context) -> Iterator[str]:
    """A command, and those below it where it is a group."""
    context.terminal_width = context.max_content_width = _WIDTH
    yield f"### {context.command_path}"
    yield f"```text\n{command.get_help(context)}\n```"
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from _told(below, click.Context(below, info_name=name, parent=context))
