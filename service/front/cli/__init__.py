"""The command line: `tailroad COMMAND`."""

from service.front.cli.main import main

__all__ = ["main"]
