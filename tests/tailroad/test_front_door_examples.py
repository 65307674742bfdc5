"""The examples in the docstrings of what `import tailroad` gives are run, and say what they say there."""

from __future__ import annotations

import doctest
import inspect

import pytest

import tailroad

WITH_EXAMPLES = [
    name
    for name in tailroad.__all__
    if (inspect.isfunction(getattr(tailroad, name)))
    and ">>>" in (inspect.getdoc(getattr(tailroad, name)) or "")
]


def test_the_functions_have_examples():
    assert "estimate" in WITH_EXAMPLES


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_an_example_says_what_comes_out(name: str, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = getattr(tailroad, name)
    (test,) = doctest.DocTestFinder(recurse=False).find(found, name, globs={"folder": tmp_path / "run"})
    told: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS).run(
        test, out=told.append
    )
    assert not told, "".join(told)
