"""The README's table is what the kept runs say."""

import lzma

import pytest

import ce
from tests.bench import ce_calibration, ce_which_method
from tests.reference.problems import LINEAR_2


def test_a_cell_has_efficiency_and_honesty():
    p = LINEAR_2.p
    runs = [
        {"p": p * 1.1, "low": p, "high": 2 * p, "calls": 1000, "warned": []},
        {"p": p * 0.9, "low": 0.0, "high": 0.5 * p, "calls": 1000, "warned": []},
        {"p": p * 0.9, "low": 0.0, "high": 0.5 * p, "calls": 1000, "warned": ["few-events"]},
    ]
    assert ce_which_method.cell(LINEAR_2, runs) == "430 / 67%"
    assert ce_which_method.cell(LINEAR_2, [{"p": None}]) == "0 of 1 end"
    assert ce_which_method.cell(LINEAR_2, []) == "-"


@pytest.mark.parametrize(
    ("value", "text"), [(0.7234, "0.72"), (14.2, "14"), (3421.0, "3,400"), (283_000.0, "2.8e5")]
)
def test_numbers_have_two_figures(value, text):
    assert ce_which_method.rounded(value) == text


def test_only_the_table_of_the_readme_is_replaced():
    text = f"a\n{ce_which_method.BEGIN}\nold\n{ce_which_method.END}\nb\n"
    assert (
        ce_which_method.written(text, "new")
        == f"a\n{ce_which_method.BEGIN}\n\nnew\n\n{ce_which_method.END}\nb\n"
    )
    with pytest.raises(ValueError, match="needs the lines"):
        ce_which_method.written("nothing", "new")


def test_the_readme_and_the_table_are_those_of_the_kept_runs(tmp_path):
    runs = tmp_path / "runs.jsonl"
    runs.write_bytes(lzma.decompress(ce_calibration.KEPT.read_bytes()))
    done = ce_calibration.read(runs, any_version=True)
    assert {method for _, method, _ in done} >= set(ce.METHODS)
    text = ce_which_method.README.read_text()
    assert ce_which_method.written(text, ce_which_method.table(done)) == text
    assert ce_calibration.table(done) == (ce_calibration.HERE / "ce_calibration.md").read_text()
