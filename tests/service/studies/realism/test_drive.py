"""Models in recorded scenes: the world's own motion, replay untouched, the same seed the same figures."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from policies.baselines.idm_mobil import PARAMETERS
from policies.columns import Values
from policies.data import scenes as S
from service.studies.realism import models
from service.studies.realism.drive import CONSTANT, HUMAN, IDM_MOBIL, NETWORK, Model, drive_scene, road_for
from service.studies.realism.evaluate import PROTOCOLS, evaluate, longest, recorded, windows
from service.studies.realism.krauss import Krauss
from service.studies.realism.people import people
from service.training import world as W
from service.world import agents as A
from service.world.scenario.load import load_scenario
from service.world.scenario.schema import Scenario
from service.world.sim import minds as M
from service.world.sim.latent import GLANCE
from sumo_nets.corridor import load_corridor

SAMPLE = Path(S.__file__).parent / "sample"
VALUES = np.array([25.0, 1.2, 2.0, 1.0, 2.0, 0.2, 0.3, 0.2, 0.02, 0.5, 4.0, 0.6])
FIRST, STEPS = 8, 45


@pytest.fixture(scope="module")
def scene():
    return S.read_i80(SAMPLE / "i80_6s.parquet", SAMPLE / "i80_lanes.json")


@pytest.fixture(scope="module")
def there(scene):
    """A vehicle of a main lane that is there all the time."""
    rows = slice(FIRST, FIRST + STEPS + 1)
    good = scene.present[rows].all(axis=0) & scene.usable[FIRST] & (scene.lane[FIRST] < 6)
    return np.flatnonzero(good)


def test_a_network_drives_as_in_the_world(scene, there, drivers):
    """The same noise through the training world's rollout: the same motion, as long as nobody is touched."""
    road, v = road_for(scene), there[:1]
    driven = drive_scene(
        Model("d", NETWORK, drivers), scene, road, FIRST, STEPS, v, drivers.mu0, np.random.default_rng(5)
    )
    rows = slice(FIRST, FIRST + STEPS + 1)
    others = np.flatnonzero(scene.present[rows].any(axis=0))
    others = others[others != v[0]]
    state = np.stack([scene.x, scene.y, scene.heading, scene.speed], axis=-1)
    agents = np.zeros((1 + len(others), A.COLUMNS))
    everyone = np.concatenate([v, others])
    agents[:, A.LENGTH_M], agents[:, A.WIDTH_M] = scene.length_m[everyone], scene.width_m[everyone]
    agents[0, A.X_M : A.SPEED_MPS + 1] = state[FIRST, v[0]]
    agents[0, A.STATION], agents[0, A.ACTIVE] = round(scene.station[FIRST, v[0]]), 1.0
    network = W.Network(
        drivers.w1, drivers.b1, drivers.w2, drivers.b2, drivers.mu0.astype(np.float32), drivers.action_scale
    )
    noise = np.random.default_rng(5).standard_normal((STEPS, 1, 2))
    replay = np.ascontiguousarray(state[rows][:, others])
    _, trace, _ = W.rollout(agents, road, STEPS, network, noise, controlled=1, replay=replay)
    free = np.cumsum(trace[:, 0, W.T_COLLISION]) == 0
    assert free.sum() > 10
    for name, column in (("station", W.T_STATION_M), ("lateral", W.T_OFFSET_M), ("speed", W.T_SPEED_MPS)):
        assert getattr(driven.scene, name)[free, v[0]] == pytest.approx(trace[free, 0, column], abs=1e-9)


def test_the_others_replay_and_the_same_seed_gives_the_same(scene, there):
    model, road = Model("i", IDM_MOBIL, values=VALUES), road_for(scene)
    who = there[:3]
    first, again = (
        drive_scene(model, scene, road, FIRST, STEPS, who, None, np.random.default_rng(3)) for _ in range(2)
    )
    assert np.array_equal(first.scene.station, again.scene.station, equal_nan=True)
    others = np.setdiff1d(np.arange(len(scene.vehicle_id)), who)
    rows = slice(FIRST, FIRST + STEPS + 1)
    assert np.array_equal(first.scene.station[:, others], scene.station[rows][:, others], equal_nan=True)
    assert np.allclose(first.scene.speed[0, who], scene.speed[FIRST, who])
    assert np.allclose(first.scene.station[0, who], scene.station[FIRST, who], atol=0.05)
    assert len(PARAMETERS) == len(VALUES)


def test_people_drive_among_recorded_vehicles_with_their_own_glances_and_noise(scene, there, drivers):
    road, who = road_for(scene), there[:4]

    def driven(human: Scenario, seed: int = 3):
        model = Model("p", HUMAN, drivers, human=human)
        return drive_scene(model, scene, road, FIRST, STEPS, who, drivers.mu0, np.random.default_rng(seed))

    human = load_scenario("i80")
    first, again, other = driven(human), driven(human), driven(human, 4)
    np.testing.assert_array_equal(first.scene.station, again.scene.station)
    assert not np.array_equal(first.scene.station, other.scene.station, equal_nan=True)
    others = np.setdiff1d(np.arange(len(scene.vehicle_id)), who)
    rows = slice(FIRST, FIRST + STEPS + 1)
    np.testing.assert_array_equal(first.scene.station[:, others], scene.station[rows][:, others])
    assert np.isfinite(first.scene.station[:, who]).all()
    # with glances all the time an acceleration is held; without noise that is the same number again and again
    assert human.human is not None
    glances = msgspec.structs.replace(human.human.glances, every_s=0.5, median_s=9.0, epsilon=1.0)
    still = msgspec.structs.replace(human.human.noise, acceleration_amplitude=0.0, turn_rate_amplitude=0.0)
    away = msgspec.structs.replace(
        human, human=msgspec.structs.replace(human.human, glances=glances, noise=still)
    )
    held = np.diff(driven(away).accel[:-1], axis=0) == 0.0
    assert held.mean() > 0.6
    assert held.mean() > 0.3 + (np.diff(first.accel[:-1], axis=0) == 0.0).mean()


def test_rows_that_are_handed_on_have_no_first_long_glance():
    human = load_scenario("i80")
    happens, minds, traits = people(human, 300, 40, np.random.default_rng(2), staying=False)
    begun = happens[:, :, GLANCE]
    assert (begun[:20] >= human.human.glances.long_s).any()
    assert np.mean(begun[1:] > 0.0) * 10.0 * human.human.glances.every_s == pytest.approx(1.0, abs=0.15)
    assert len(np.unique(minds[:, M.REACTION_S])) == 40
    assert traits.size > 0


def test_constant_speed_keeps_its_speed(scene, there):
    driven = drive_scene(
        Model("c", CONSTANT), scene, road_for(scene), FIRST, STEPS, there, None, np.random.default_rng(1)
    )
    assert np.allclose(driven.scene.speed[:, there], scene.speed[FIRST, there])
    ahead = driven.scene.station[-1, there] - scene.station[FIRST, there]
    assert ahead == pytest.approx(scene.speed[FIRST, there] * STEPS * 0.1, rel=0.05, abs=0.2)  # some turn


def test_every_protocol_measures_the_held_out_vehicles(scene):
    seconds, found = longest([scene])
    assert seconds == 5.0
    held = {int(v) for w in found for v in w.held}
    assert held
    assert all(scene.vehicle_id[v] >= scene.held_out_from for v in held)
    people = recorded([scene], found, seconds)
    data = {name: Values.joined(parts) for name, parts in people.quantity.items()}
    runner = models.idm_mobil(VALUES, [scene], 1)
    for protocol in PROTOCOLS:
        facts, values = evaluate(runner, [scene], found, seconds, protocol, 1, data, np.random.default_rng(1))
        assert facts["vehicles"] == len(held)
        assert list(facts["errors"]) == ["1", "2", "5"]
        position = [facts["errors"][h]["position_m"] for h in facts["errors"]]
        assert position[0]["rms"] < position[1]["rms"] < position[2]["rms"] < 15.0
        assert all(p["mean"] <= p["rms"] for p in position)
        assert set(values["speed_mps"].vehicle) <= {int(scene.vehicle_id[v]) for v in held}
    assert windows([scene], 30.0) == []


def test_sumo_s_driver_follows_a_replayed_leader(scene, there):
    with Krauss(load_corridor("i80"), 1) as sumo:
        driven = sumo.drive_scene(scene, FIRST, STEPS, there[:2])
        again = sumo.drive_scene(scene, FIRST, STEPS, there[:2])
    who = there[:2]
    station, speed = driven.scene.station[:, who], driven.scene.speed[:, who]
    assert np.array_equal(station[0], scene.station[FIRST, who])
    assert (np.diff(station, axis=0) > -0.1).all()
    # how far it gets is what SUMO says of its speed (SUMO's lanes are up to half a metre longer or shorter than drawn)
    assert station[-1] - station[1] == pytest.approx(0.1 * speed[2:].sum(axis=0), rel=0.03, abs=0.6)
    assert np.abs(driven.scene.speed[-1, who] - scene.speed[FIRST + STEPS, who]).max() < 6.0
    assert again.scene.station.shape == driven.scene.station.shape
