"""Coverage of the domain: masses against closed forms, shares of a real run, cells never seen, declared domains."""

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.special import betainc

import tailroad
from service.analysis.coverage.attributes import BY_NAME
from service.analysis.coverage.cover import coverage_of
from service.analysis.coverage.objects import Coverage, Covered
from service.analysis.run.records import record_of
from service.errors import InputError
from service.front.cli.main import main
from service.world.scenario.load import load_scenario
from sumo_nets.corridor import Corridor


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tailroad.Run:
    return tailroad.estimate(
        "i80-paper-10s", ego="idm", gamma=2.0, method="naive", budget=60, measure="ttc-impact", workers=1,
        out=tmp_path_factory.mktemp("coverage") / "run",
    )  # fmt: skip


def named(found: Coverage, name: str) -> Covered:
    return next(one for one in found.attributes if one.attribute == name)


def test_masses_are_those_of_p0_and_shares_add_up(run: tailroad.Run):
    found = run.coverage()
    speeds = named(found, "ego-speed")  # 10 + 10 Beta(2, 2) m/s
    edges = [(v / 3.6 - 10.0) / 10.0 for v in (30, 50, 70, 90)]
    cdf = [float(betainc(2.0, 2.0, min(max(u, 0.0), 1.0))) for u in edges]
    for cell, low, high in zip(speeds.cells[1:4], cdf[:-1], cdf[1:], strict=True):
        assert cell.mass_ci[0] <= high - low <= cell.mass_ci[1]
    assert speeds.never_drawn == ("below 30", "90 to 110", "110 to 130", "130 and above")
    assert found.looked_at == 60
    assert found.events == run.estimate.events >= 3
    for one in found.attributes:
        assert sum(cell.mass for cell in one.cells) == pytest.approx(1.0)
        assert sum(cell.rollouts or 0 for cell in one.cells) == 60
        assert sum(cell.share or 0.0 for cell in one.cells) == pytest.approx(1.0)
        assert sum(cell.events for cell in one.cells) == found.events
    assert named(found, "lanes").cells[5].mass == 1.0  # I-80 has six
    assert [cell.rollouts for cell in named(found, "vehicles").cells] == [0, 60, 0, 0, 0]


def test_cells_never_seen_are_told(run: tailroad.Run):
    """Four of the rollouts, all of them slow: what lies above is drawn by P0 and never seen."""
    record = record_of(run.path)[0]
    speed = record.starts[:, 4 * record.job.scenario.ego + 3]
    slow = replace(record, starts=record.starts[np.argsort(speed)[:4]])
    found = coverage_of("slow", slow)
    assert "70 to 90" in named(found, "ego-speed").never_seen
    assert found.pairs_seen is not None
    assert found.pairs_seen < found.pairs


def test_weather_light_and_density_are_classed_by_their_values(i80: Corridor):
    scenario = load_scenario("i80-data")
    x = np.zeros((3, 4 * 6 + 5))
    x[:, 0:24:4] = 100.0  # all beside each other
    x[:, 24:] = [[30.0, 0.0, 0.12, 0.0, 0.0], [-10.0, 0.0, 39.12, 5.0, 0.0], [-3.0, 0.0, 0.12, -4.0, 0.0]]
    x[1, 4:24:4] = [150.0, 190.0, 210.0, 250.0, 300.0]

    def cells(name: str) -> list[str]:
        return [BY_NAME[name].cells[i] for i in BY_NAME[name].cell_of(scenario, i80, x)]

    assert cells("illumination") == ["day", "night", "twilight"]
    assert cells("rain") == ["dry", "moderate, to 10", "dry"]
    assert cells("visibility") == ["5,000 and above", "below 200", "5,000 and above"]
    # 6 and then 3 vehicles in 200 m of 6 lanes
    assert [float(v) for v in BY_NAME["density"].values(scenario, i80, x)] == pytest.approx([5.0, 2.5, 5.0])


def test_a_domain_is_held_against_what_was_driven(run: tailroad.Run, tmp_path: Path):
    (tmp_path / "odd.toml").write_text(
        'format = 1\nname = "day"\n[domain]\nillumination = ["day", "night"]\nego-speed = ["50 to 70"]\n'
    )
    found = run.coverage(tmp_path / "odd.toml")
    assert found.missing == ("illumination: night",)
    assert [cell.inside for cell in named(found, "ego-speed").cells][:4] == [False, False, True, False]
    assert all(cell.inside for cell in named(found, "lanes").cells)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('format = 2\nname = ""\n[domain]\n', "reads 1"),
        ('format = 1\nname = ""\n[domain]\nluck = []\n', "luck"),
        ('format = 1\nname = ""\n[domain]\nrain = ["wet"]\n', "wet"),
        ('format = 1\nname = ""\nmore = 1\n[domain]\n', "more"),
        ("format = [", "no TOML"),
    ],
)
def test_a_bad_domain_is_told_in_a_sentence(run: tailroad.Run, tmp_path: Path, text: str, says: str):
    (tmp_path / "odd.toml").write_text(text)
    with pytest.raises(InputError, match=says):
        run.coverage(tmp_path / "odd.toml")


def test_the_command_prints_writes_json_and_a_page(run: tailroad.Run, tmp_path: Path):
    page = tmp_path / "page.html"
    answer = CliRunner().invoke(main, ["coverage", str(run.path), "--json", "--page", str(page)])
    assert answer.exit_code == 0, answer.output
    assert msgspec.convert(json.loads(answer.stdout), Coverage) == run.coverage()
    assert "Coverage of the domain" in page.read_text()
    printed = CliRunner().invoke(main, ["coverage", str(run.path)]).output
    assert "illumination" in printed
    assert max(len(line) for line in printed.splitlines()) <= 80


def test_a_method_that_moves_chains_is_covered_too(tmp_path: Path):
    run = tailroad.estimate(
        "i80-paper-10s", ego="idm", gamma=2.0, method="splitting", budget=1000, measure="ttc-impact", workers=1,
        out=tmp_path / "run",
    )  # fmt: skip
    found = run.coverage()
    assert found.looked_at == run.estimate.rollouts.total
    assert sum(cell.share or 0.0 for cell in named(found, "ego-speed").cells) == pytest.approx(1.0)
