"""Looks at built pages: every link leads somewhere, every page is reached, nothing is fetched from elsewhere."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# what a browser fetches by itself, and the attribute that says from where
FETCHED = {
    "img": ("src", "srcset"),
    "script": ("src",),
    "source": ("src", "srcset"),
    "video": ("src", "poster"),
    "audio": ("src",),
    "iframe": ("src",),
    "embed": ("src",),
    "object": ("data",),
}
FETCHED_LINKS = {"stylesheet", "icon", "preload", "prefetch", "preconnect", "dns-prefetch", "modulepreload"}


class _Page(HTMLParser):
    """The anchors of a page, what it links to, and what a browser fetches to show it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = {""}
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.in_style = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[n] for n in ("id", "name") if n in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag == "link" and FETCHED_LINKS & set(given.get("rel", "").split()):
            self.fetched.append(given["href"])
        self.fetched += [given[n].split()[0] for n in FETCHED.get(tag, ()) if given.get(n)]
        self.fetched += _in_css(given.get("style", ""))
        self.in_style = tag == "style"

    def handle_endtag(self, tag: str) -> None:
        self.in_style = False

    def handle_data(self, data: str) -> None:
        if self.in_style:
            self.fetched += _in_css(data)


def _in_css(text: str) -> list[str]:
    return re.findall(r"url\(\s*[\"']?([^\"')]+)", text) + re.findall(r"@import\s+[\"']([^\"']+)", text)


def complaints(site: Path) -> list[str]:
    """What is wrong with the site in folder `site`: one line each, none where all is well."""
    pages = {p: _Page(p.read_text(encoding="utf-8")) for p in sorted(site.rglob("*.html")) if _ours(p, site)}
    wrong: list[str] = []
    reached, waiting = {site / "index.html"}, [site / "index.html"]
    while waiting:
        at = waiting.pop()
        name = at.relative_to(site)
        for link in pages[at].links + pages[at].fetched:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            to = (at.parent / unquote(parts.path)).resolve() if parts.path else at
            to = to / "index.html" if to.is_dir() else to
            if not to.is_file():
                wrong.append(f"{name}: {link} leads nowhere")
            elif to in pages and unquote(parts.fragment) not in pages[to].anchors:
                wrong.append(f"{name}: {link} names an anchor that is not there")
            elif to in pages and to not in reached:
                reached.add(to)
                waiting.append(to)
    for path, page in pages.items():
        wrong += [
            f"{path.relative_to(site)}: fetches {f}"
            for f in page.fetched
            if urlsplit(f).netloc or urlsplit(f).scheme not in ("", "data")
        ]
        if path not in reached:
            wrong.append(f"{path.relative_to(site)}: no page leads here")
    for sheet in sorted(site.rglob("*.css")):
        wrong += [
            f"{sheet.relative_to(site)}: fetches {f}"
            for f in _in_css(sheet.read_text(encoding="utf-8"))
            if urlsplit(f).netloc
        ]
    return sorted(set(wrong))


def _ours(page: Path, site: Path) -> bool:
    """Whether the page is one of the site's own: those for lost visitors are reached by none."""
    return page.relative_to(site).as_posix() != "404.html"
