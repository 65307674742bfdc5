"""Everything public stands in the reference."""

import re

import pytest

import ce
import tailroad
from docs.site.docstrings import fenced, listed
from docs.site.generate import reference


@pytest.mark.parametrize("package", [ce, tailroad], ids=lambda p: p.__name__)
def test_the_reference_has_every_public_name_and_no_other(package):
    named = re.findall(rf"^::: {package.__name__}\.(\w+)$", reference(package.__name__), re.M)
    assert len(named) == len(set(named))
    assert set(named) == set(package.__all__)


def test_fields_become_a_list_and_examples_code():
    text = "One sentence.\n\ngamma: the threshold,\nin s\nseed: of it\n\n>>> 1 + 1\n2"
    assert (
        listed(text)
        == "One sentence.\n\n- `gamma`: the threshold,\n    in s\n- `seed`: of it\n\n>>> 1 + 1\n2"
    )
    assert fenced(">>> 1 + 1\n2\n\nafter") == "\n```pycon\n>>> 1 + 1\n2\n```\n\nafter"
