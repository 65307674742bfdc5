"""The files that nobody writes: their path in the repository's tree -> text."""

from __future__ import annotations

from docs.site import commands, decisions, objects
from docs.site.gather import ROOT


def pages() -> dict[str, str]:
    """Every page and picture that is made from the sources."""
    return {
        "docs/reference/command-line.md": commands.page(),
        "deploy/decisions/README.md": decisions.index(),
        f"{objects.folder().relative_to(ROOT).as_posix()}/README.md": objects.page(),
    }
