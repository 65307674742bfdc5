"""The command line: `tailroad COMMAND`."""

from service.cli.main import main

__all__ = ["main"]
