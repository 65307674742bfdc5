"""What the check of the built site finds."""

from pathlib import Path

import pytest

from docs.site.check import complaints

HEAD = "<!doctype html><html><body>"


def site(folder: Path, **pages: str) -> Path:
    for name, body in pages.items():
        (folder / f"{name}.html").write_text(HEAD + body, encoding="utf-8")
    (folder / "there.png").write_bytes(b"")
    return folder


def test_a_sound_site_has_no_complaints(tmp_path):
    there = site(
        tmp_path,
        index='<h1 id="top">Top</h1><a href="other.html#deep">other</a> <img src="there.png">',
        other='<h2 id="deep">Deep</h2><a href="index.html">back</a> <a href="https://example.org">elsewhere</a>',
    )
    assert complaints(there) == []


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ('<a href="gone.html">gone</a>', "gone.html leads nowhere"),
        ('<a href="other.html#gone">gone</a>', "other.html#gone names an anchor that is not there"),
        ('<a href="#gone">gone</a>', "#gone names an anchor that is not there"),
        ('<img src="gone.png">', "gone.png leads nowhere"),
        ('<img src="https://example.org/a.png">', "fetches https://example.org/a.png"),
        ('<script src="https://example.org/a.js"></script>', "fetches https://example.org/a.js"),
        ('<link rel="stylesheet" href="https://example.org/a.css">', "fetches https://example.org/a.css"),
        ('<link rel="preconnect" href="https://example.org">', "fetches https://example.org"),
        ('<p style="background: url(https://example.org/a.png)">x</p>', "fetches https://example.org/a.png"),
        ("<style>@import 'https://example.org/a.css';</style>", "fetches https://example.org/a.css"),
    ],
)
def test_what_is_wrong_with_a_page_is_said(tmp_path, body, said):
    there = site(tmp_path, index=f'<a href="other.html">other</a>{body}', other="")
    assert complaints(there) == [f"index.html: {said}"]


def test_a_page_that_no_page_leads_to_is_an_orphan(tmp_path):
    assert complaints(site(tmp_path, index="", lost="")) == ["lost.html: no page leads here"]


def test_a_style_sheet_that_fetches_from_elsewhere_is_found(tmp_path):
    there = site(tmp_path, index="")
    (there / "a.css").write_text("@font-face { src: url('https://example.org/a.woff2') }", encoding="utf-8")
    assert complaints(there) == ["a.css: fetches https://example.org/a.woff2"]
