"""The files that nobody writes: their path in the repository's tree -> text."""

from __future__ import annotations

import ast
import re

from docs.site import architecture, commands, decisions, objects, paths_picture, scenarios
from docs.site.gather import ROOT


def pages() -> dict[str, str]:
    """Every page and picture that is made from the sources."""
    icon = ROOT / "service" / "front" / "dashboard" / "static" / "icon.svg"
    layers = architecture.rooms()
    return {
        "docs/assets/icon.svg": icon.read_text(encoding="utf-8"),
        "docs/reference/ce.md": reference("ce"),
        "docs/reference/tailroad.md": reference("tailroad"),
        "docs/architecture.svg": architecture.picture(layers),
        "docs/concepts/paths.svg": paths_picture.picture(),
        "docs/reference/layers.md": (
            f"# Layers\n\nEach imports only what stands below it.\n\n{architecture.table(layers)}\n"
        ),
        "docs/reference/command-line.md": commands.page(),
        "docs/reference/scenario-files.md": scenarios.page(),
        "deploy/decisions/README.md": decisions.index(),
        f"{objects.folder().relative_to(ROOT).as_posix()}/README.md": objects.page(),
    }


def reference(package: str) -> str:
    """A package's reference: its page, and below it whatever else the package makes public."""
    page = (ROOT / "docs" / "reference" / f"{package}.md").read_text(encoding="utf-8")
    left = public_names(package) - set(re.findall(rf"^::: {package}\.(\w+)$", page, re.M))
    return page + "".join(
        ["\n## Besides\n\n", *(f"::: {package}.{n}\n" for n in sorted(left))] if left else []
    )


def public_names(package: str) -> set[str]:
    """What `__all__` of the package lists."""
    for node in ast.parse((ROOT / package / "__init__.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return set(ast.literal_eval(node.value))
    raise LookupError(f"{package}/__init__.py has no __all__")
