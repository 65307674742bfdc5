"""What the README says."""

from __future__ import annotations

import re

import pytest

from docs.site import tutorials
from docs.site.gather import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_is_read_in_a_minute():
    assert len(README.splitlines()) <= 130


@pytest.mark.parametrize(
    "name", ["README.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md")), "docs/tutorials"]
)
def test_code_on_the_front_pages_is_seen_whole_beside_both_columns_of_the_site(name):
    """87 columns of code fit a page at 1280 pixels."""
    of = ROOT / name
    for page in of.glob("*.md") if of.is_dir() else [of]:
        blocks = re.findall(r"^```\w*\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
        assert max((len(line) for block in blocks for line in block.splitlines()), default=0) <= 87, page


def test_the_table_of_what_it_is_worth_is_that_of_the_result_page():
    page = (ROOT / "deploy" / "results" / "beyond-large.md").read_text(encoding="utf-8")
    after = page.partition("## Efficiency by repeated runs, training counted")[2]
    rows = [
        [cell.strip() for cell in line.split("|")[2:-1]]
        for line in after.splitlines()
        if line.startswith("|")
    ]
    measured = dict(zip(rows[0], rows[2], strict=True))
    told = re.findall(r"^\| (0\.\d+) s \| [^|]+ \| ([^|]+) \|$", README, re.M)
    assert len(told) == 4
    for gamma, efficiency in told:
        assert measured[f"γ = {float(gamma):g} s"] == efficiency


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_its_python_prints_what_stands_below_it():
    """4,000 rollouts: minutes."""
    assert tutorials.outputs_of(README) == tutorials.shown_on(README)
