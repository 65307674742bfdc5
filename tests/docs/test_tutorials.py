"""The tutorials' code runs, and prints what the pages show."""

import pytest

from docs.site import tutorials

PAGE = """# A page

```python
x = 2
```

Text.

```python
print(x + 1)
```

```text
old
```

The end.
"""


def test_outputs_stand_below_the_blocks_that_print_them():
    assert tutorials.code_of(PAGE) == ["x = 2\n", "print(x + 1)\n"]
    assert tutorials.shown_on(PAGE) == ["", "old\n"]
    new = tutorials.with_outputs(PAGE, ["", "3\n"])
    assert tutorials.shown_on(new) == ["", "3\n"]
    assert tutorials.with_outputs(PAGE, ["", "old\n"]) == PAGE


def test_a_page_is_run_from_top_to_bottom():
    assert tutorials.outputs_of(PAGE) == ["", "3\n"]


def test_code_that_fails_is_told_with_its_reason():
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        tutorials.outputs_of("```python\n1 / 0\n```\n")


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("path", tutorials.PAGES, ids=lambda p: p.stem)
def test_a_tutorial_prints_what_its_page_shows(path):
    page = path.read_text(encoding="utf-8")
    assert tutorials.outputs_of(page) == tutorials.shown_on(page)
