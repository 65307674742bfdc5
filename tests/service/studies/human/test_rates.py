"""Rates of contacts and near-crashes: what is counted, kept and told; what attention does to them."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

import ce
from policies.drivers import load_drivers
from service.errors import InputError, ScenarioError
from service.front.cli.main import main
from service.studies.human import campaign, leaks, rates
from service.studies.human import watching as W
from service.studies.human.counting import Counter
from service.studies.human.leaks import Tree
from service.world.scenario.base import base_distribution
from service.world.scenario.human import with_epsilon
from service.world.scenario.load import load_scenario
from service.world.scenario.schema import Scenario, Uniform, Vehicle
from sumo_nets.corridor import load_corridor

SMALL = 3.0  # seconds


def uniform(low: float, high: float) -> Uniform:
    return Uniform(low=low, high=high)


def approach(epsilon: float, every_s: float = 6.0) -> Scenario:
    """Three fast cars, each behind a slow one in its lane, and an ego far ahead."""
    scenario = load_scenario("i80-10s")
    start = msgspec.structs.replace(scenario.start, lateral_mps=None, heading_deg=uniform(-0.2, 0.2))
    vehicles = [Vehicle(name="ego", role="ego", lane=3, station_m=uniform(400.0, 410.0))]
    for lane in (1, 4, 6):
        vehicles.append(
            Vehicle(
                name=f"fast{lane}", lane=lane, station_m=uniform(50.0, 70.0), speed_mps=uniform(14.0, 19.0)
            )
        )
        vehicles.append(
            Vehicle(
                name=f"slow{lane}", lane=lane, station_m=uniform(100.0, 120.0), speed_mps=uniform(3.0, 9.0)
            )
        )
    assert scenario.human is not None
    glances = msgspec.structs.replace(scenario.human.glances, epsilon=epsilon, every_s=every_s)
    human = msgspec.structs.replace(scenario.human, glances=glances)
    return msgspec.structs.replace(
        scenario, name="approach", start=start, vehicles=tuple(vehicles), human=human
    )


def look_away(base: ce.Product, x: np.ndarray) -> None:
    """Everybody's long glance begins within 3 s and lasts 5 s."""
    names = base.name_or_index
    onsets = [i for i, n in enumerate(names) if n.endswith("glance_onset_s")]
    lasts = [i for i, n in enumerate(names) if n.endswith("glance_duration_s")]
    x[:, onsets] = np.random.default_rng(4).uniform(0.2, 3.0, (len(x), len(onsets)))
    x[:, lasts] = 5.0


def contacts(scenario: Scenario, rollouts: int, away: bool = False) -> list[np.ndarray]:
    """Of that many rollouts; away: see `look_away`."""
    drivers = load_drivers("drivers-gail")
    base = base_distribution(scenario, drivers)
    counter = Counter(scenario, load_corridor("i80"), drivers, "idm")
    x, seeds = ce.draw(base, 3, "estimate", 0, 0, rollouts)
    if away:
        look_away(base, x)
    found = []
    for draw, seed in zip(x, seeds.tolist(), strict=True):
        _, _, rows = counter.run(draw, seed, np.zeros((2, W.TALLIES)))
        found.append(rows)
    return found


def test_drivers_who_look_do_not_run_into_the_one_ahead():
    found = np.concatenate(contacts(approach(0.0, every_s=1e6), 400))
    found = found[found[:, W.KIND] != W.NEAR_CRASH]
    assert not (found[:, W.KIND] == W.REAR_END).any()
    assert len(found) == 0


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_drivers_who_look_never_run_into_the_one_ahead():
    """10^5 rollouts, three fast cars behind slow ones in each: no rear-end, so below 1.2e-5 a car at 95%."""
    drivers, scenario = load_drivers("drivers-gail"), approach(0.0, every_s=1e6)
    base = base_distribution(scenario, drivers)
    counter = Counter(scenario, load_corridor("i80"), drivers, "idm")
    tallies = np.zeros((2, W.TALLIES))
    for first in range(0, 100_000, 250):
        x, seeds = ce.draw(base, 9, "estimate", 0, first, first + 250)
        for draw, seed in zip(x, seeds.tolist(), strict=True):
            _, _, rows = counter.run(draw, seed, tallies)
            assert not (rows[:, W.KIND] == W.REAR_END).any(), f"rollout {first}, seed {seed}"
    assert tallies[:, W.EVADING_S].sum() > 1e4  # there was something to react to


def test_more_leaks_are_more_contacts():
    counted = [
        sum((rows[:, W.KIND] != W.NEAR_CRASH).sum() for rows in contacts(approach(epsilon), 600, away=True))
        for epsilon in (0.0, 0.3, 1.0)
    ]
    assert counted[0] <= counted[1] <= counted[2]
    assert counted[2] >= counted[0] + 4


def test_a_contact_is_told_with_its_kind_speed_and_cause():
    rows = np.concatenate(contacts(approach(1.0), 600, away=True))
    behind = rows[rows[:, W.KIND] == W.REAR_END]
    assert len(behind) >= 4
    assert set(behind[:, W.FIRST]) <= {1.0, 3.0, 5.0}  # the fast ones
    assert (behind[:, W.CAUSE] == behind[:, W.FIRST]).all()
    assert behind[:, W.LOOKED_AWAY].mean() > 0.8
    assert (behind[:, W.DELTA_V_MPS] < 10.0).all()


def short(epsilon: float = 0.5) -> campaign.Settings:
    scenario = with_epsilon(load_scenario("i80-10s"), epsilon)
    scenario = msgspec.structs.replace(scenario, time=msgspec.structs.replace(scenario.time, horizon_s=SMALL))
    return campaign.Settings(scenario, "idm", 5)


def test_a_campaign_goes_on_after_what_it_has_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "CHUNK", 20)
    whole = campaign.run(short(), 60, tmp_path / "whole", 1)
    campaign.run(short(), 40, tmp_path / "parts", 1)
    path = tmp_path / "parts" / campaign.FILE
    path.write_bytes(path.read_bytes()[:-30])  # it was stopped while it wrote the second chunk
    told: list[tuple[int, int]] = []
    again = campaign.run(short(), 60, tmp_path / "parts", 1, lambda *done: told.append(done))
    assert told == [(1, 3), (2, 3), (3, 3)]
    np.testing.assert_array_equal(again.tallies, whole.tallies)
    assert again.outcomes == whole.outcomes
    assert whole.in_sumo >= 0
    assert whole.tallies[0, W.KM] == pytest.approx(60 * 5 * 0.045, rel=0.1)  # five cars for 3 s at 15 m/s


def test_counts_of_another_epsilon_are_not_added(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "CHUNK", 4)
    campaign.run(short(0.5), 4, tmp_path, 1)
    with pytest.raises(InputError, match="another scenario, epsilon, ego, seed or way to count"):
        campaign.run(short(0.6), 4, tmp_path, 1)
    (tmp_path / campaign.FILE).write_text("nonsense\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 1: not a chunk of counts"):
        campaign.run(short(0.5), 4, tmp_path, 1)


def test_rates_have_garwood_s_interval():
    found = rates.rate(np.ones(3), np.arange(3.0), 1_000_000, 2e6)
    assert (found.events, found.rate, found.million_km) == (3, pytest.approx(1.5), 2.0)
    assert found.low == pytest.approx(0.618672 / 2.0, rel=1e-5)
    assert found.high == pytest.approx(8.767273 / 2.0, rel=1e-5)
    nothing = rates.rate(np.zeros(0), np.zeros(0), 1_000_000, 1e6, 2.0)
    assert (nothing.rate, nothing.low) == (0.0, 0.0)
    assert nothing.high == pytest.approx(2 * 3.688879, rel=1e-6)


def test_events_of_one_rollout_are_one_for_the_interval():
    apart = rates.rate(np.ones(4), np.arange(4.0), 1_000_000, 1e6)
    together = rates.rate(np.ones(4), np.array([7.0, 7.0, 9.0, 9.0]), 1_000_000, 1e6)
    assert together.rate == apart.rate
    assert together.high - together.low > 1.3 * (apart.high - apart.low)


def dangerous(epsilon: float) -> Scenario:
    """As `approach`, nearer, faster, and with brakes too weak for a glance of some seconds."""
    scenario = approach(epsilon)
    assert scenario.human is not None
    vehicles = []
    for vehicle in scenario.vehicles:
        if vehicle.name.startswith("fast"):
            vehicle = msgspec.structs.replace(
                vehicle, speed_mps=uniform(15.0, 19.0), station_m=uniform(70.0, 80.0)
            )
        if vehicle.name.startswith("slow"):
            vehicle = msgspec.structs.replace(
                vehicle, speed_mps=uniform(2.0, 5.0), station_m=uniform(110.0, 125.0)
            )
        vehicles.append(vehicle)
    avoidance = msgspec.structs.replace(scenario.human.avoidance, hardest_mps2=3.0)
    human = msgspec.structs.replace(scenario.human, avoidance=avoidance)
    return msgspec.structs.replace(scenario, vehicles=tuple(vehicles), human=human)


def easier(monkeypatch) -> None:
    """Lotteries that are all played, with prizes small enough for some hundred trees."""
    for name, value in (("SURVIVES", 0.5), ("LIVE_S", 2.0), ("PRIZE", 1.5), ("OF_SHORT", 0.5)):
        monkeypatch.setattr(leaks, name, value)


@pytest.fixture(scope="module")
def grown():
    """Trees of 1200 rollouts, and the same rollouts counted with epsilon 0.2 and 0.5: their events, each with the
    rollout's number before it."""
    drivers, count = load_drivers("drivers-gail"), 1200
    found = {}
    patch = pytest.MonkeyPatch()
    easier(patch)
    for way in ("forced", 0.2, 0.5):
        scenario = dangerous(0.0 if way == "forced" else way)
        base = base_distribution(scenario, drivers)
        counter = Counter(scenario, load_corridor("i80"), drivers, "idm")
        tree, (x, seeds) = Tree(counter), ce.draw(base, 3, "estimate", 0, 0, count)
        look_away(base, x)
        rows = []
        for k in range(count):
            arguments = x[k], int(seeds[k]), np.zeros((2, W.TALLIES))
            events = tree.grow(*arguments)[3] if way == "forced" else counter.run(*arguments)[2]
            rows.append(np.column_stack([np.full(len(events), k), events]))
        found[way] = np.concatenate(rows)
    patch.undo()
    return found, count


@pytest.mark.parametrize("epsilon", [0.2, 0.5])
@pytest.mark.parametrize("near", [False, True])
def test_forced_leaks_find_what_counting_finds(grown, epsilon, near):
    found, count = grown
    sums = []
    for way, value in (("forced", epsilon), (epsilon, None)):
        rows = found[way][found[way][:, 1 + W.AGAIN] == 0.0]
        rows = rows[(rows[:, 1 + W.KIND] == W.NEAR_CRASH) == near]
        sums.append(np.bincount(rows[:, 0].astype(int), rates.weights_of(rows, value), count))
    forced, counted = sums
    difference = forced - counted
    error = difference.std() / np.sqrt(count)
    assert counted.sum() >= 8.0
    assert error < 0.4 * counted.mean()
    assert abs(difference.mean()) < 4.0 * error


def test_a_tree_s_stem_is_the_rollout_without_leaks_and_its_bits_are_the_seed_s():
    drivers, scenario = load_drivers("drivers-gail"), dangerous(0.0)
    base = base_distribution(scenario, drivers)
    counter = Counter(scenario, load_corridor("i80"), drivers, "idm")
    tree, (x, seeds) = Tree(counter), ce.draw(base, 8, "estimate", 0, 0, 80)
    look_away(base, x)
    branches = 0
    for draw, seed in zip(x, seeds.tolist(), strict=True):
        tallies = np.zeros((3, 2, W.TALLIES))
        status, steps, end, events = tree.grow(draw, seed, tallies[0])
        again = tree.grow(draw, seed, tallies[1])
        assert (status, steps) == again[:2]
        np.testing.assert_array_equal(end, again[2])
        np.testing.assert_array_equal(events, again[3])
        plain = counter.run(draw, seed, tallies[2])
        assert plain[:2] == (status, steps)
        np.testing.assert_array_equal(counter.agents, end)
        np.testing.assert_array_equal(events[events[:, W.LEAKED] == 0.0], plain[2])
        np.testing.assert_array_equal(tallies[0], tallies[2])
        np.testing.assert_array_equal(tallies[0], tallies[1])
        branches += (events[:, W.LEAKED] > 0.0).sum()
    assert branches > 0


def test_the_page_tells_what_was_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "CHUNK", 10)
    settings = short()
    told = rates.facts(settings, campaign.run(settings, 10, tmp_path, 1))
    path = rates.write([told], tmp_path / "pages", "tailroad drivers rates i80-10s")
    text = path.read_text(encoding="utf-8")
    assert "epsilon = 0.5" in text
    assert "DOT HS 813 560" in text
    kept = json.loads((tmp_path / "pages" / "driver-rates" / "results.json").read_text(encoding="utf-8"))
    assert kept[0]["parts"]["first 10 s"]["contacts"]["million_km"] > 0.0


@pytest.mark.parametrize("epsilon", ["1.5", "-0.1", "nan"])
def test_an_epsilon_that_is_no_probability_is_refused_by_name(epsilon):
    result = CliRunner().invoke(main, ["drivers", "rates", "i80-10s", "--epsilon", epsilon])
    assert result.exit_code == 2
    assert "human.glances.epsilon" in result.output
    assert "a probability lies between 0 and 1" in result.output


def test_drivers_without_a_human_table_have_no_epsilon():
    with pytest.raises(ScenarioError, match="only drivers with a human table look away"):
        with_epsilon(load_scenario("i80-paper-10s"), 0.5)
