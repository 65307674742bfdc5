"""The files that nobody writes: their path in the repository's tree -> text."""

from __future__ import annotations

from docs.site import architecture, commands, decisions, objects
from docs.site.gather import ROOT


def pages() -> dict[str, str]:
    """Every page and picture that is made from the sources."""
    icon = ROOT / "service" / "front" / "dashboard" / "static" / "icon.svg"
    return {
        "docs/assets/icon.svg": icon.read_text(encoding="utf-8"),
        "docs/architecture.svg": architecture.picture(),
        "docs/reference/layers.md": f"# Layers\n\nEach imports only what stands below it.\n\n{architecture.table()}\n",
        "docs/reference/command-line.md": commands.page(),
        "deploy/decisions/README.md": decisions.index(),
        f"{objects.folder().relative_to(ROOT).as_posix()}/README.md": objects.page(),
    }
