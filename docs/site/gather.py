"""Copies the repository's pages into one folder, as a site: every page has its place, every link fits.

Pages keep the links that hold in the repository. What a page links to comes along: another page by its new place, a
picture or a film as it is, and a source file as a page that shows it.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path, PurePosixPath

from docs.site import links

ROOT = Path(__file__).parents[2]
AS_THEY_ARE = {".png", ".jpg", ".svg", ".mp4", ".html", ".json", ".npz", ".css", ".js"}
LANGUAGES = {
    ".py": "python",
    ".toml": "toml",
    ".yaml": "yaml",
    ".rs": "rust",
    ".proto": "protobuf",
    ".json5": "json",
}


class DeadLink(Exception):
    """Pages of the repository link to something that is not there."""


def gather(places: dict[str, str], made: dict[str, str], into: Path) -> list[PurePosixPath]:
    """Write the site's pages below `into` and return their places there.

    places: folders of the repository -> folders of the site, the longest that fits counts; "" is the root
    made:   files that are made, in place of those in the repository: their path in the repository's tree -> text
    """
    tracked = _tracked()
    pages = [p for p in tracked if p.suffix == ".md"] + [
        PurePosixPath(p) for p in made if PurePosixPath(p) not in tracked
    ]
    worn = [p for p in tracked if p.is_relative_to("docs/assets")]
    site = {p: _place(p, places) for p in pages + worn}
    waiting: list[PurePosixPath] = list(site)
    done: set[PurePosixPath] = set()
    dead: list[str] = []
    while waiting:
        source = waiting.pop()
        if source in done:
            continue
        done.add(source)
        target = into / site[source]
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.suffix in AS_THEY_ARE and str(source) not in made:
            shutil.copyfile(ROOT / source, target)
            continue
        text = made.get(str(source)) or (ROOT / source).read_text(encoding="utf-8")
        if source.suffix in AS_THEY_ARE:
            target.write_text(text, encoding="utf-8")
            continue
        if source.suffix != ".md":
            target.write_text(_shown(source, text), encoding="utf-8")
            continue

        def to(link: str, page: PurePosixPath = source) -> str:
            named, anchor = links.resolved(page, link)
            found = _found(named, site, tracked)
            if found is None:
                dead.append(f"{page}: {link} is not in the repository")
                return link
            if found not in site:
                site[found] = _place(found, places)
            waiting.append(found)
            return links.relative(site[page], site[found]) + anchor

        target.write_text(links.rewritten(text, to), encoding="utf-8")
    if dead:
        raise DeadLink("\n".join(dead))
    return sorted(p for p in site.values() if p.suffix == ".md")


def _tracked() -> list[PurePosixPath]:
    """The files that belong to the repository, new ones included; all files where there is no git."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"], cwd=ROOT, capture_output=True
    )
    if listed.returncode == 0:
        names = listed.stdout.decode().split("\0")
        return [PurePosixPath(n) for n in sorted(set(names)) if n and (ROOT / n).is_file()]
    hidden = {"build", "runs", "dist"}
    return [
        PurePosixPath(p.relative_to(ROOT))
        for p in sorted(ROOT.rglob("*"))
        if p.is_file() and not any(part in hidden or part[0] == "." for part in p.relative_to(ROOT).parts)
    ]


def _found(
    named: PurePosixPath, site: dict[PurePosixPath, PurePosixPath], tracked: list[PurePosixPath]
) -> PurePosixPath | None:
    """The page or file that a link means; a folder means the page that tells of it."""
    if named in site or named in tracked:
        return named
    return next((p for n in ("README.md", "index.md") if (p := named / n) in site), None)


def _place(source: PurePosixPath, places: dict[str, str]) -> PurePosixPath:
    """A file's place on the site: pages as pages, README.md as its folder's index, sources below source/."""
    if source.suffix not in {".md", *AS_THEY_ARE}:
        return PurePosixPath("source") / f"{source}.md"
    fits = max(
        (p for p in places if source.is_relative_to(p) or str(source) == p), key=lambda p: len(p), default=""
    )
    if fits == str(source):
        return PurePosixPath(places[fits])
    inside = source.relative_to(fits) if fits else source
    name = "index.md" if source.name == "README.md" else source.name
    return PurePosixPath(places.get(fits, "")) / inside.parent / name


def _shown(source: PurePosixPath, text: str) -> str:
    """A source file as a page."""
    fence = "````"
    language = LANGUAGES.get(source.suffix, "text")
    return (
        f"---\nsearch:\n  exclude: true\n---\n\n# `{source}`\n\n{fence}{language}\n{text.rstrip()}\n{fence}\n"
    )
