"""Every warning that an estimate can carry has its place on the page, with a remedy."""

import ast
import re

from docs.site.gather import ROOT

PAGE = (ROOT / "docs" / "concepts" / "warnings.md").read_text(encoding="utf-8")


def raised() -> set[str]:
    """The names of all warnings that `ce` and what runs its jobs make, read from their sources."""
    names = set()
    for source in (path for folder in ("ce", "service/evaluation") for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in (
                "EstimateWarning",
                "ce.EstimateWarning",
            ):
                assert isinstance(node.args[0], ast.Constant), source
                names.add(node.args[0].value)
    return names


def test_the_page_tells_of_every_warning_and_of_no_other():
    told = re.findall(r"^## ([a-z]+(?:-[a-z]+)*)$", PAGE, re.M)
    assert len(told) == len(set(told))
    assert set(told) == raised()


def test_each_warning_has_a_remedy():
    for part in re.split(r"^## ", PAGE, flags=re.M)[1:]:
        if part.split("\n")[0] in raised():
            assert "**Remedy:**" in part, part.split("\n")[0]
