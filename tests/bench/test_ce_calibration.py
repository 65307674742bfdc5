"""The calibration stops and goes on where it was, and its table has a row for each problem, method and budget."""

import json

from tests.bench import ce_calibration
from tests.reference.problems import LINEAR_2


def test_it_is_resumable_and_writes_a_table(tmp_path, monkeypatch):
    monkeypatch.setattr(ce_calibration, "KEPT", tmp_path / "kept.jsonl.xz")
    results, table = tmp_path / "runs.jsonl", tmp_path / "table.md"
    arguments = ["--budget", "1000", "--method", "naive", "mixture", "--problem", "linear d=2"]
    arguments += ["--results", str(results), "--table", str(table)]
    said: list[str] = []
    ce_calibration.main(["--seeds", "2", *arguments], said.append)
    first = results.read_text()
    results.write_text(first + '{"problem": "lin')  # stopped while writing
    ce_calibration.main(["--seeds", "3", *arguments], said.append)
    runs = [json.loads(line) for line in results.read_text().splitlines() if line.endswith("}")]
    assert results.read_text().startswith(first)
    assert {(r["method"], r["seed"]) for r in runs} >= {("mixture", s) for s in range(3)}
    rows = [line for line in table.read_text().splitlines() if line.startswith("| linear")]
    assert len(rows) == 2


def test_a_run_of_mixture_is_that_of_auto_where_auto_stays_with_it():
    p = LINEAR_2
    auto, mixture = (ce_calibration.run(p, method, 6000, 3) for method in ("auto", "mixture"))
    assert auto["by"] == "mixture"
    assert auto == mixture
    done = {(p.name, "auto", 6000): [auto | {"seed": 3}, auto | {"seed": 4, "by": "splitting"}]}
    assert ce_calibration.taken_over(done, p, "mixture", 6000, 3) == mixture
    assert ce_calibration.taken_over(done, p, "mixture", 6000, 4) is None
    assert ce_calibration.taken_over(done, p, "ce", 6000, 3) is None


def test_kept_runs_are_where_a_new_results_file_begins(tmp_path, monkeypatch):
    monkeypatch.setattr(ce_calibration, "KEPT", tmp_path / "kept.jsonl.xz")
    said: list[str] = []
    arguments = ["--budget", "1000", "--method", "naive", "--problem", "linear d=2", "--keep"]
    arguments += ["--table", str(tmp_path / "table.md")]
    ce_calibration.main(["--seeds", "2", *arguments, "--results", str(tmp_path / "one.jsonl")], said.append)
    ce_calibration.main(["--seeds", "2", *arguments, "--results", str(tmp_path / "two.jsonl")], said.append)
    one, two = ((tmp_path / name).read_text() for name in ("one.jsonl", "two.jsonl"))
    assert len(two.splitlines()) == 2
    assert sorted(map(json.loads, one.splitlines()), key=lambda r: r["seed"]) == [
        json.loads(line) for line in two.splitlines()
    ]


def test_a_run_is_the_same_to_the_bit_or_to_what_another_processor_rounds():
    run = ce_calibration.run(LINEAR_2, "naive", 1000, 5)
    assert ce_calibration.sameness(run | {"seed": 5}, run) == "the same to the bit"
    assert ce_calibration.sameness(run | {"high": run["high"] * (1 + 1e-9)}, run) == "the same to 1e-07"
    for changed in ({"high": run["high"] * (1 + 1e-6)}, {"calls": 999}, {"warned": ["unknown"]}):
        assert ce_calibration.sameness(run | changed, run) == "another result"


def test_runs_of_an_earlier_version_are_taken_over_only_where_they_are_the_same(tmp_path):
    path = tmp_path / "runs.jsonl"
    right = {"problem": LINEAR_2.name, "method": "naive", "budget": 1000, "seed": 5, "version": "earlier"}
    right |= ce_calibration.run(LINEAR_2, "naive", 1000, 5)
    for record, version in ((right, ce_calibration.version("naive")), (right | {"p": 0.5}, "earlier")):
        path.write_text(json.dumps(record) + "\n")
        ce_calibration.renewed(path, ["naive"], lambda _: None)
        assert json.loads(path.read_text()) == record | {"version": version}
    path.write_text("".join(json.dumps(record) + "\n" for record in (right | {"p": 0.5}, right)))
    ce_calibration.renewed(path, ["naive"], lambda _: None)
    # the later of two
    assert [json.loads(line)["p"] for line in path.read_text().splitlines()] == [right["p"]]
