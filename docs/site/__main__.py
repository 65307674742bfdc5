"""Gathers the pages, has them rendered, and checks the result: `python -m docs.site`."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path, PurePosixPath
from typing import Any

import tomli_w

from docs.site.check import complaints
from docs.site.gather import ROOT, DeadLink, gather
from docs.site.generate import pages


def main() -> int:
    """Build the site into build/docs; 1 where anything about it is wrong."""
    try:
        wrong = build(ROOT / "build")
    except DeadLink as e:
        wrong = [str(e)]
    print("\n".join(wrong) or "The documentation: build/docs/index.html")
    return 1 if wrong else 0


def build(folder: Path) -> list[str]:
    """Build the site into `folder`/docs. Returns what is wrong with it. Raises DeadLink."""
    settings = tomllib.loads((ROOT / "docs" / "site.toml").read_text(encoding="utf-8"))
    project = settings["project"]
    sources = folder / project["docs_dir"]
    shutil.rmtree(sources, ignore_errors=True)
    there = gather(settings.pop("places"), pages(), sources)
    project["nav"] = [_expanded(item, there) for item in project["nav"]]
    named = _named(project["nav"])
    forgotten = [p for p in there if p.parts[0] != "source" and str(p) not in named]
    project["plugins"]["mkdocstrings"]["handlers"]["python"]["paths"] = [str(ROOT)]
    configuration = folder / "zensical.toml"
    configuration.write_text(tomli_w.dumps(settings), encoding="utf-8")
    rendered = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict", "--clean", "-f", configuration],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if rendered.returncode:
        plain = re.sub(r"\x1b\[[\d;]*m", "", rendered.stdout)
        said, _, traceback = plain.partition("Traceback (most recent call last)")
        return [said, *traceback.strip().split("\n")[-3:]]
    return [f"{p}: not in the navigation (docs/site.toml)" for p in forgotten] + complaints(
        folder / project["site_dir"]
    )


def _expanded(item: Any, there: list[PurePosixPath]) -> Any:
    """An entry of the navigation, with a folder's name replaced by the folder's pages."""
    if isinstance(item, dict):
        return {title: _expanded(inner, there) for title, inner in item.items()}
    if isinstance(item, str) and item.endswith("/"):
        inside = [p for p in there if p.parent == PurePosixPath(item)]
        return [str(p) for p in sorted(inside, key=lambda p: (p.name != "index.md", p.name))]
    if isinstance(item, list):
        whole = [_expanded(inner, there) for inner in item]
        return [one for inner in whole for one in (inner if isinstance(inner, list) else [inner])]
    return item


def _named(item: Any) -> set[str]:
    """Every page that the navigation names."""
    if isinstance(item, dict):
        item = list(item.values())
    return {item} if isinstance(item, str) else {page for inner in item for page in _named(inner)}


if __name__ == "__main__":
    sys.exit(main())
