"""`tailroad drivers card` on an imported recording: a page that stands alone, and the same facts as JSON."""

import json
import re

import polars as pl
import pytest
from click.testing import CliRunner

from policies.data.ngsim_import import import_file
from service.front.cli.main import main
from service.studies.realism.page import number, share, span

T0_MS = 1113437564900
FOOT = 0.3048


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """Forty seconds of three lanes in NGSIM's own layout: queues that slow down and speed up."""
    folder = tmp_path_factory.mktemp("recording")
    rows, position, speed = [], {}, {}
    for k in range(400):
        for v in range(36):
            lane = 1 + v % 3
            ahead = v - 3
            wanted = 9.0 + 3.0 * ((k // 100) % 2) if ahead < 0 else speed[ahead]
            speed[v] = speed.get(v, 9.0) + max(-0.2, min(0.1, 0.2 * (wanted - speed.get(v, 9.0))))
            position[v] = position.get(v, 250.0 - 20.0 * (v // 3)) + 0.1 * speed[v]
            rows.append(
                f"{v + 1} {k} 400 {T0_MS + 100 * k} {3.7 * (lane - 0.5) / FOOT:.4f} {position[v] / FOOT:.4f} 0 0 15.0 "
                f"6.0 2 {speed[v] / FOOT:.4f} 0 {lane} 0 0 0 9999.99"
            )
    (folder / "made.txt").write_text("\n".join(rows) + "\n", encoding="utf-8")
    import_file(folder / "made.txt", folder / "tables")
    return folder / "tables"


@pytest.fixture(scope="module")
def card(tables, weights_file, tmp_path_factory):
    out = tmp_path_factory.mktemp("card")
    arguments = ["drivers", "card", "--weights", str(weights_file), "--data", str(tables), "--out", str(out)]
    done = CliRunner().invoke(main, [*arguments, "--samples", "1", "--no-krauss", "--seed", "3"])
    assert done.exit_code == 0, (done.output, done.exception)
    return out, done.output


def test_the_card_has_every_model_protocol_and_quantity(card):
    out, said = card
    facts = json.loads((out / "steering-realism.json").read_text())
    (site,) = facts["sites"].values()
    assert site["seconds"] == 5.0  # few held-out vehicles: the shortest windows
    assert (
        set(site["models"])
        == {"steering", "human", "drivers-bc", "idm-mobil", "constant-speed"}
        == set(facts["labels"])
    )
    for by_protocol in site["models"].values():
        for measured in by_protocol.values():
            assert list(measured["errors"]) == ["1", "2", "5"]
            assert set(measured["distances"]) == set(site["histograms"])
            assert 0.0 <= measured["touching_share"]["value"] <= 1.0
    assert site["people"]["lane_changes_per_km"]["value"] == 0.0
    assert [row["target"] for row in facts["targets"]["rows"]] == [12.8, 2.07, 1.12, 0.031, 0.025, 0.0003]
    assert "--seed 3" in facts["command"]
    assert facts["stream"] is None  # tables have no space-time fields
    assert "target 12.8" in said


def test_the_page_stands_alone_and_says_what_is_good_and_what_is_not(card):
    out, _ = card
    page = (out / "steering-realism.html").read_text(encoding="utf-8")
    assert len(page) < 1_500_000
    assert not re.search(r'(?:src|href)="(?!data:|#)', page)
    assert "<script" not in page
    for section in (
        "targets",
        "errors",
        "events",
        "distributions",
        "stream",
        "people",
        "method",
        "caveats",
        "reproduce",
    ):
        assert f'<section id="{section}"' in page
    assert "of 6 targets met" in page
    assert "Not good" in page
    assert page.count("<img ") == len(re.findall(r'<img [^>]*alt="[^"]+"', page)) > 8
    assert "nan" not in re.sub(r"data:image[^\"]*", "", page).lower().replace("dominant", "")


def test_wrong_input_ends_with_2_and_one_sentence(tmp_path):
    arguments = ["drivers", "card", "--data", str(tmp_path), "--out", str(tmp_path)]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 2
    assert "neither the data pack" in done.output
    done = CliRunner().invoke(main, [*arguments, "--weights", "nobody"])
    assert done.exit_code == 2
    assert "nobody" in done.output


def test_recordings_without_a_held_out_vehicle_among_others_are_refused(tables, tmp_path):
    """A road whose last vehicles have nobody behind them: their surroundings are not known."""
    table = pl.read_parquet(tables / "made.parquet")
    table.filter(pl.col("vehicle_id") <= 6).write_parquet(tmp_path / "made.parquet")
    done = CliRunner().invoke(main, ["drivers", "card", "--data", str(tmp_path), "--out", str(tmp_path)])
    assert done.exit_code == 2
    assert "no held-out vehicle" in done.output


def test_numbers_are_said_plainly():
    assert [number(x) for x in (None, 0.0, 1234.0, 0.01234, 12.8)] == ["-", "0", "1234", "0.0123", "12.8"]
    assert [share(x) for x in (None, 0.0, 0.0003, 0.031, 0.5)] == ["-", "0%", "0.03%", "3.1%", "50%"]
    assert span([0.01, 0.2], "share") == "1% to 20%"
