"""Everything public stands in the reference."""

import re

import pytest

import ce
import tailroad
from docs.site import scenarios
from docs.site.docstrings import fenced, listed
from docs.site.generate import reference
from service.world.scenario import schema


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


def test_every_table_and_key_of_a_scenario_file_is_told():
    told = scenarios.page()
    tables = [
        one for one in vars(schema).values() if isinstance(one, type) and issubclass(one, schema._Table)
    ]
    named = {one.__name__ for one in tables} - {"_Table"}
    assert named == set(scenarios.TABLES)
    for one in tables:
        for key in one.__struct_encode_fields__:
            assert f"| `{key}` |" in told
    glances = told.split("## [human.glances]")[1].split("\n## ")[0]
    assert "| `epsilon` | number | must be there |" in glances
    assert "0 to 1 |" in glances
