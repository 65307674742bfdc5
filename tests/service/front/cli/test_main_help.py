"""`tailroad --help` says of each command what its own help says, and imports none of them."""

from __future__ import annotations

import subprocess
import sys

import click
import pytest

from service.front.cli.main import COMMANDS, SUMMARY_LETTERS, main, summary_of


@pytest.mark.parametrize("name", COMMANDS)
def test_the_summary_is_that_of_the_commands_own_help(name):
    command = main.get_command(click.Context(main), name)
    assert summary_of(name) == command.get_short_help_str(SUMMARY_LETTERS) != ""


def test_help_imports_no_command_and_no_library_of_numbers():
    code = (
        "import sys\nfrom service.front.cli.main import main\n"
        "main(['--help'], standalone_mode=False)\n"
        "print(sorted(m for m in sys.modules if m in ('numpy', 'numba', 'service.front.cli.estimate')))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "estimate" in shown
    assert shown.splitlines()[-1] == "[]"
