"""Drivers who see, react and sometimes do not look: their noise, their causes and what they do in a conflict."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from scipy import stats

import ce
from policies.drivers import load_drivers
from policies.egos import load_ego
from service.errors import ScenarioError
from service.world import agents as A
from service.world.scenario.base import base_distribution, causes, lateral_speed, unpack
from service.world.scenario.causes import MODES
from service.world.scenario.check import check_values
from service.world.scenario.fixed import fixed_draw, fixed_of, toml_of
from service.world.scenario.load import load_scenario, parse_scenario
from service.world.scenario.schema import (
    Avoidance,
    Glances,
    Human,
    NoiseProcess,
    NormalMixture,
    Scenario,
)
from service.world.sim import avoidance, minds
from service.world.sim.latent import CHANNELS, GLANCE, LEAK, Latent
from service.world.sim.rollout import Simulator
from service.world.sim.without_sumo import WithoutSumo
from sumo_nets.corridor import load_corridor

NOISE = NoiseProcess(
    acceleration_amplitude=0.4,
    acceleration_correlation_s=0.6,
    turn_rate_amplitude=0.2,
    turn_rate_correlation_s=0.4,
)
LATERAL = NormalMixture(share=0.05, narrow=0.08, wide=0.4, low=-1.5, high=1.5)
ENV = 1  # a row that is not the ego's


def human_scenario(epsilon: float = 0.1, horizon_s: float = 10.0, noise=None, glances=None) -> Scenario:
    """`i80-paper-10s` with human drivers and starts by their lateral speed; the dictionaries change single values."""
    scenario = load_scenario("i80-paper-10s")
    human = Human(
        glances=Glances(epsilon=epsilon, **(glances or {})),
        noise=msgspec.structs.replace(NOISE, **(noise or {})),
    )
    return msgspec.structs.replace(
        scenario,
        name="human",
        human=human,
        time=msgspec.structs.replace(scenario.time, horizon_s=horizon_s),
        start=msgspec.structs.replace(scenario.start, heading_deg=None, lateral_mps=LATERAL),
    )


@pytest.fixture(scope="module")
def drivers():
    return load_drivers("drivers-gail")


@pytest.fixture(scope="module")
def corridor():
    return load_corridor("i80")


def some_causes(scenario: Scenario, seed: int) -> np.ndarray:
    """Causes as P0 draws them; rows that are not an environment vehicle's are zero."""
    base = base_distribution(scenario, load_drivers("drivers-gail"))
    x, _ = ce.draw(base, seed, "estimate", 0, 0, 1)
    return causes(scenario, x[0])


def test_the_causes_are_coordinates_with_names(drivers):
    scenario = human_scenario()
    base = base_distribution(scenario, drivers)
    named = [n for n in base.name_or_index if n.startswith("env4.")]
    assert named == [
        "env4.station_m", "env4.lane_offset_m", "env4.lateral_mps", "env4.speed_mps",
        "env4.reaction_s", "env4.glance_onset_s", "env4.glance_duration_s", "env4.glance_leak",
        "env4.acceleration_mode_1", "env4.acceleration_mode_2", "env4.turn_rate_mode_1", "env4.turn_rate_mode_2",
    ]  # fmt: skip
    assert base.dim == 6 * 4 + 5 * 8 + 404
    assert not any(n.startswith("ego.") and "glance" in n for n in base.name_or_index)
    x, _ = ce.draw(base, 1, "estimate", 0, 0, 4000)
    column = {n: x[:, i] for i, n in enumerate(base.name_or_index)}
    assert np.median(column["env4.reaction_s"]) == pytest.approx(0.9, rel=0.03)
    assert column["env4.glance_duration_s"].min() >= 1.5
    # of all glances of six seconds apart, those beyond 1.5 s
    assert np.mean(column["env4.glance_onset_s"] < 10.0) == pytest.approx(0.21, abs=0.03)


def test_a_draw_gives_its_causes_back(drivers):
    scenario = human_scenario()
    base = base_distribution(scenario, drivers)
    x, _ = ce.draw(base, 2, "estimate", 0, 0, 1)
    table = causes(scenario, x[0])
    names = base.name_or_index
    assert not table[scenario.ego].any()
    assert table[3, 0] == pytest.approx(x[0, names.index("env4.reaction_s")], abs=1e-6)
    assert table[3, MODES + 2] == x[0, names.index("env4.turn_rate_mode_1")]


def test_the_noise_has_its_correlation_whatever_the_modes_hold():
    scenario = human_scenario(horizon_s=20.0)
    latent, rng = Latent(scenario), np.random.default_rng(1)
    paths = []
    for _ in range(3000):
        named = np.zeros((6, MODES + 4))
        named[:, MODES:] = rng.standard_normal((6, 4))
        named[:, 1] = 1e9
        table = latent.realise(rng.standard_normal((200, 6, CHANNELS)), named)
        paths.append(table[:, ENV, :2].copy())
    v = np.array(paths)
    for c, (amplitude, time) in enumerate(((0.4, 0.6), (0.2, 0.4))):
        spread = v[:, :, c].std(axis=0) / amplitude
        assert spread.min() > 0.94
        assert spread.max() < 1.06  # at every step, across the window's end too
        for lag in (1, 5, 10):
            for at in (30, 95, 150):
                r = np.corrcoef(v[:, at, c], v[:, at + lag, c])[0, 1]
                t = 0.1 * lag / time
                assert r == pytest.approx((1.0 + t) * math.exp(-t), abs=0.06)


def test_a_mode_moves_its_own_vehicle_and_action_only():
    scenario = human_scenario()
    latent, rng = Latent(scenario), np.random.default_rng(2)
    normals, named = rng.standard_normal((100, 6, CHANNELS)), some_causes(scenario, 5)
    before = latent.realise(normals, named).copy()
    named[3, MODES + 2] += 3.0  # env4's slowest turn
    after = latent.realise(normals, named)
    moved = after - before
    assert np.abs(moved[:, 3, 1]).min() > 0.0
    assert (moved[:, 3, 1] > 0.0).all()  # to the left all along
    moved[:, 3, 1] = 0.0
    assert not moved.any()


def test_modes_are_orthonormal_and_the_slowest():
    scenario = human_scenario(noise={"modes": 4})
    vectors, roots = Latent(scenario).modes
    np.testing.assert_allclose(
        np.einsum("ckm,ckn->cmn", vectors, vectors), np.stack([np.eye(4)] * 2), atol=1e-9
    )
    r = math.exp(-0.1 / 0.6)
    lag = np.abs(np.subtract.outer(np.arange(100), np.arange(100)))
    covariance = r**lag * (1.0 + lag * (1.0 - r * r) / (1.0 + r * r))
    values = np.linalg.eigvalsh(covariance)[::-1][:4]
    np.testing.assert_allclose(roots[0] ** 2, values, rtol=1e-9)
    np.testing.assert_allclose(covariance @ vectors[0], vectors[0] * values, atol=1e-6)


def test_glances_come_as_often_and_last_as_long_as_the_table_says():
    scenario = human_scenario(horizon_s=400.0)
    latent, rng = Latent(scenario), np.random.default_rng(3)
    seconds = []
    for seed in range(6):
        table = latent.realise(rng.standard_normal((4000, 6, CHANNELS)), some_causes(scenario, seed))
        seconds.append(table[:, 1:, GLANCE].ravel())  # the ego's row has none
        assert not table[:, scenario.ego].any()
    begun = np.concatenate(seconds)
    hers = begun[begun > 0.0]
    assert hers.size / begun.size * 10.0 * 6.0 == pytest.approx(1.0, abs=0.05)
    assert stats.kstest(hers, stats.lognorm(0.65, scale=0.75).cdf).statistic < 0.02


def test_the_first_long_glance_is_where_its_coordinates_say():
    scenario = human_scenario(epsilon=0.3)
    latent, rng = Latent(scenario), np.random.default_rng(4)
    named = some_causes(scenario, 1)
    named[3, 1:4] = 4.23, 2.5, 0.29
    table = latent.realise(rng.standard_normal((100, 6, CHANNELS)), named)
    assert table[42, 3, GLANCE] == 2.5
    assert table[42, 3, LEAK] == 1.0
    others = np.delete(table[:, 3, GLANCE], 42)
    assert (others[:67] < 1.5).all()  # no other long one until it has ended
    named[3, 3] = 0.31
    assert latent.realise(rng.standard_normal((100, 6, CHANNELS)), named)[42, 3, LEAK] == 0.0


@pytest.mark.parametrize(("epsilon", "share"), [(0.0, 0.0), (0.25, 0.25), (1.0, 1.0)])
def test_a_glance_leaks_with_probability_epsilon(epsilon, share):
    scenario = human_scenario(epsilon=epsilon, horizon_s=100.0)
    table = Latent(scenario).realise(
        np.random.default_rng(5).standard_normal((1000, 6, CHANNELS)), some_causes(scenario, 2)
    )
    assert table[:, ENV, LEAK].mean() == pytest.approx(share, abs=0.05)


def two(
    gap_m: float, closing_mps: float, across_m: float = 0.0, across_mps: tuple[float, float] = (0.0, 0.0)
):
    """Two cars on a straight road, the second ahead; what both see."""
    agents, seen = np.zeros((2, A.COLUMNS)), np.zeros((2, avoidance.SEEN))
    agents[:, A.LENGTH_M], agents[:, A.WIDTH_M], agents[:, A.ACTIVE] = 4.5, 1.8, 1.0
    agents[:, A.SPEED_MPS] = 15.0, 15.0 - closing_mps
    seen[:, avoidance.SPEED_MPS] = agents[:, A.SPEED_MPS]
    seen[1, avoidance.STATION_M], seen[1, avoidance.OFFSET_M] = 4.5 + gap_m, across_m
    seen[:, avoidance.ACROSS_MPS] = across_mps
    for i in range(2):
        agents[i, A.LANE_HEADING_RAD] = math.asin(across_mps[i] / agents[i, A.SPEED_MPS])
    return agents, seen


TRAITS = np.array([getattr(Avoidance(), key) for key in Avoidance.__struct_fields__])


def test_a_conflict_ahead_is_told_by_time_and_deceleration():
    def found(*setting, **more):
        agents, seen = two(*setting, **more)
        return avoidance.conflicts(agents, 2, seen, 0, TRAITS)

    required, ttc, own, others = found(20.0, 6.0)
    assert required == pytest.approx(36.0 / 38.0)  # a metre is left
    assert ttc == pytest.approx(20.0 / 6.0)
    assert (own, others) == (0.0, 0.0)
    assert found(40.0, 2.0)[1] == math.inf  # 20 s away
    assert found(20.0, -3.0)[1] == math.inf  # drawing away
    assert found(20.0, 6.0, 3.6)[1] == math.inf  # in the next lane
    cutting_in = found(20.0, 6.0, 3.6, (0.0, -0.9))
    assert cutting_in[1] == pytest.approx(20.0 / 6.0)


def test_a_driver_brakes_after_its_reaction_time_and_no_harder_than_people_do():
    agents, seen = two(20.0, 8.0)
    mind = np.zeros(minds.COLUMNS)
    mind[minds.REACTION_S] = 0.9
    found = avoidance.conflicts(agents, 2, seen, 0, TRAITS)
    actions = [avoidance.respond(agents[0], mind, found, TRAITS, 0.1, 0.3, 0.0)[0] for _ in range(20)]
    first = next(k for k, a in enumerate(actions) if a < 0.0)
    assert 4 <= first <= 9  # the clock runs up to twice as fast
    assert actions[:first] == [0.3] * first
    assert min(actions) == pytest.approx(-(1.25 * found[0] + 0.5))
    jerks = -np.diff(actions[first:]) / 0.1
    assert jerks.max() <= 12.65 + 1e-9
    calm = avoidance.respond(
        agents[0], np.zeros(minds.COLUMNS), (0.0, math.inf, 0.0, 0.0), TRAITS, 0.1, 0.3, 0.0
    )
    assert calm == (0.3, 0.0)


def test_what_a_driver_does_is_mirrored_with_the_road():
    rng = np.random.default_rng(6)
    for _ in range(300):
        gap, closing = rng.uniform(-6.0, 30.0), rng.uniform(-4.0, 8.0)
        across, speeds = rng.uniform(-5.0, 5.0), rng.uniform(-1.2, 1.2, 2)
        answers = []
        for sign in (1.0, -1.0):
            agents, seen = two(gap, closing, sign * across, tuple(sign * speeds))
            mind = np.zeros(minds.COLUMNS)
            mind[minds.SIDE_S] = 5.0
            found = avoidance.conflicts(agents, 2, seen, 0, TRAITS)
            answers.append((found, avoidance.respond(agents[0], mind, found, TRAITS, 0.1, 0.1, sign * 0.01)))
        (left, (a, w)), (right, (b, u)) = answers
        assert left[:2] == right[:2]
        assert left[2:] == (-right[2], -right[3])
        assert a == b
        assert w == pytest.approx(-u, abs=1e-12)


def test_rollouts_have_the_same_bits_in_sumo_and_without(drivers, corridor):
    scenario = human_scenario(epsilon=0.5)
    base = base_distribution(scenario, drivers)
    x, noise = ce.draw(base, 7, "estimate", 0, 0, 12)
    alone = WithoutSumo(scenario, corridor, drivers, "lidar")
    rng = np.random.default_rng(8)
    with Simulator(scenario, corridor, drivers, load_ego("lidar")) as simulator:
        for draw, seed in zip(x, noise.tolist(), strict=True):
            assert simulator.run(draw, seed) == alone.run(draw, seed)
        given = rng.standard_normal((scenario.steps, 6, CHANNELS))
        assert simulator.run(x[0], action_noise=given) == alone.run(x[0], action_noise=given)
    with pytest.raises(ValueError, match="action noise must be float64"):
        alone.run(x[0], action_noise=given[:, :, :2])


@pytest.mark.parametrize("noise", ["drawn", "frozen", "searched"])
def test_drawn_frozen_and_searched_noise_are_the_same_normals(drivers, corridor, noise):
    """The one latent vector: given as an array, from the rollout's seed, from one seed for all, or as a part of X."""
    scenario = human_scenario(horizon_s=2.0)
    scenario = msgspec.structs.replace(
        scenario, drivers=msgspec.structs.replace(scenario.drivers, noise_mode=noise)
    )
    base = base_distribution(scenario, drivers)
    (x,), (seed,) = ce.draw(base, 9, "estimate", 0, 0, 1)
    world = WithoutSumo(scenario, corridor, drivers, "idm")
    first = world.run(x, int(seed))
    other = world.run(x, int(seed) + 1)
    assert (first == other) == (noise != "drawn")
    if noise == "searched":
        count = scenario.action_noise_values
        assert base.name_or_index[-1] == f"env6.leak_noise[{scenario.steps - 1}]"
        given = x[-count:].reshape(scenario.steps, 6, CHANNELS)
        plain = msgspec.structs.replace(
            scenario, drivers=msgspec.structs.replace(scenario.drivers, noise_mode="drawn")
        )
        assert WithoutSumo(plain, corridor, drivers, "idm").run(x[:-count], action_noise=given) == first


def test_lateral_speeds_are_those_drawn():
    scenario = human_scenario()
    x = np.zeros(24 + 40 + 404)
    for i in range(6):
        x[4 * i : 4 * i + 4] = 100.0, 0.1, 0.3 - 0.1 * i, 12.0
    starts, _ = unpack(scenario, x)
    for i, start in enumerate(starts):
        assert start.speed_mps * math.sin(start.lane_heading_rad) == pytest.approx(0.3 - 0.1 * i, abs=1e-12)
    slow = msgspec.structs.replace(
        scenario,
        start=msgspec.structs.replace(scenario.start, lateral_offset_gain=2.0, lateral_speed_power=0.5),
    )
    assert lateral_speed(slow, 0.5, 0.2, 3.5) == pytest.approx(0.2 * 1.5 * math.sqrt(0.5))


def test_a_fixed_rollout_keeps_the_causes(drivers, tmp_path):
    scenario = human_scenario()
    base = base_distribution(scenario, drivers)
    (x,), (seed,) = ce.draw(base, 10, "estimate", 0, 0, 1)
    fixed = fixed_of(scenario, base, x, int(seed))
    assert "env4.glance_onset_s" in fixed.others
    path = tmp_path / "one.toml"
    path.write_text(toml_of(msgspec.structs.replace(scenario, fixed=fixed)), encoding="utf-8")
    again = load_scenario(str(path))
    there, seed_again = fixed_draw(base, again.fixed, "", "one.toml")
    np.testing.assert_array_equal(there, x)
    assert seed_again == int(seed)


WRONG = {
    "glances.epsilon": (1.5, "human.glances.epsilon", "a probability lies between 0 and 1"),
    "noise.modes": (50, "human.noise.modes", "give 0 to 20"),
    "noise.window_s": (200.0, "human.noise.window_s", ""),
    "avoidance.hardest_mps2": (12.0, "human.avoidance.hardest_mps2", "what a vehicle can do"),
    "reaction.median_s": (0.0, "human.reaction.median_s", "people need about 1 s"),
}


@pytest.mark.parametrize("name", WRONG)
def test_values_that_cannot_be_are_refused_by_name(name):
    value, key, remedy = WRONG[name]
    scenario = human_scenario(horizon_s=400.0)
    table, _, field = name.partition(".")
    changed = msgspec.structs.replace(getattr(scenario.human, table), **{field: value})
    wrong = msgspec.structs.replace(
        scenario, human=msgspec.structs.replace(scenario.human, **{table: changed})
    )
    with pytest.raises(ScenarioError) as caught:
        check_values(wrong, "mine.toml")
    assert caught.value.key == key
    assert remedy in str(caught.value)


def test_a_human_table_needs_its_epsilon(tmp_path):
    data = msgspec.to_builtins(human_scenario(), str_keys=True)
    data = msgspec.json.decode(msgspec.json.encode(data))
    del data["human"]["glances"]["epsilon"]
    with pytest.raises(ScenarioError, match=r"human\.glances\.epsilon.*missing"):
        parse_scenario(data, "mine.toml", tmp_path)


@pytest.mark.parametrize(("start", "remedy"), [({"lateral_mps": None}, "or lateral_mps in its place"),
                                               ({"heading_deg": "as before"}, "give one")])  # fmt: skip
def test_headings_are_given_once(start, remedy):
    scenario = human_scenario()
    if "heading_deg" in start:
        start = {"heading_deg": load_scenario("i80-paper-10s").start.heading_deg}
    wrong = msgspec.structs.replace(scenario, start=msgspec.structs.replace(scenario.start, **start))
    with pytest.raises(ScenarioError, match=remedy):
        check_values(wrong, "mine.toml")
