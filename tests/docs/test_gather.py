"""How the repository's pages become the site's."""

from pathlib import PurePosixPath

import pytest

from docs.site import gather as module
from docs.site.gather import DeadLink, gather
from docs.site.links import rewritten

PAGE = """# A

A [link](x.md), a [long
text](y.md#part), a ![picture](z.png) and [elsewhere](https://example.org), [below](#part), `[code](x.md)`.

```
[code](x.md)
```
"""


def test_links_are_rewritten_outside_of_code_only():
    seen = []

    def to(link: str) -> str:
        seen.append(link)
        return "new"

    done = rewritten(PAGE, to)
    assert seen == ["x.md", "y.md#part", "z.png"]
    assert done.count("(new)") == 3
    assert done.count("[code](x.md)") == 2
    assert rewritten(PAGE, lambda link: link) == PAGE


@pytest.fixture
def repository(tmp_path, monkeypatch):
    for name, text in {
        "README.md": "[guide](deploy/guides/a.md#x) [code](ce/run.py) [folder](ce) ![p](deploy/p.png)",
        "deploy/guides/a.md": "[home](../../README.md)",
        "deploy/p.png": "",
        "ce/README.md": "# ce",
        "ce/run.py": "x = 1\n",
        "docs/index.md": "[overview](../README.md)",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(module, "ROOT", tmp_path)
    return tmp_path


PLACES = {"docs": "", "README.md": "overview.md", "deploy/guides": "how-to"}


def test_pages_have_their_places_and_links_fit(repository, tmp_path):
    into = tmp_path / "build"
    there = gather(PLACES, {}, into)
    assert [str(p) for p in there] == [
        "ce/index.md", "how-to/a.md", "index.md", "overview.md", "source/ce/run.py.md",
    ]  # fmt: skip
    text = (into / "overview.md").read_text(encoding="utf-8")
    assert (
        text == "[guide](how-to/a.md#x) [code](source/ce/run.py.md) [folder](ce/index.md) ![p](deploy/p.png)"
    )
    assert (into / "how-to" / "a.md").read_text(encoding="utf-8") == "[home](../overview.md)"
    assert (into / "deploy" / "p.png").exists()
    assert "x = 1" in (into / "source/ce/run.py.md").read_text(encoding="utf-8")


def test_a_made_page_takes_part(repository, tmp_path):
    (repository / "docs" / "index.md").write_text("[made](made.md)", encoding="utf-8")
    there = gather(PLACES, {"docs/made.md": "[up](../README.md)"}, tmp_path / "build")
    assert PurePosixPath("made.md") in there
    assert (tmp_path / "build" / "made.md").read_text(encoding="utf-8") == "[up](overview.md)"


def test_every_dead_link_is_named(repository, tmp_path):
    (repository / "docs" / "index.md").write_text("[a](gone.md) [b](../gone)", encoding="utf-8")
    with pytest.raises(DeadLink, match=r"docs/index.md: gone.md is not .*\ndocs/index.md: ../gone is not"):
        gather(PLACES, {}, tmp_path / "build")
