"""The calibration stops and goes on where it was, and its table has a row for each problem, method and budget."""

import json

from tests.bench import ce_calibration


def test_it_is_resumable_and_writes_a_table(tmp_path):
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
