"""States that an ego reaches among drivers, and what its training makes of them."""

import numpy as np
import pytest

from policies import layout as O
from policies.drivers import load_drivers
from service.training.aggregation import visited_among
from service.training.demonstrations import AGGREGATED
from service.training.ego_lidar import Arguments, labelled, lane_keeping, urgency
from service.training.expert import Expert, lateral_speed, mean_action
from service.training.world import Network
from service.world.sim.road import i80_road


@pytest.fixture(scope="module")
def visits():
    model = load_drivers("drivers-gail")
    ego = load_drivers("ego-lidar")
    arrays = (model.w1, model.b1, model.w2, model.b2, model.mu0.astype(np.float32), model.action_scale)
    own = (ego.w1, ego.b1, ego.w2, ego.b2, ego.mu0.astype(np.float32), ego.action_scale)
    rng = np.random.default_rng(2)
    return visited_among(Network(*own), lambda _: Network(*arrays), i80_road(), 12, rng, seconds=6.0, every=3)


def test_the_egos_states_only(visits):
    assert 12 * 10 < len(visits) <= 12 * 20
    assert set(visits.kind) == {AGGREGATED}
    assert np.unique(visits.trajectory).size == 12
    assert not visits.seen[:, O.INCIDENT].any()
    assert (visits.seen[:, O.RANGE_M : O.RANGE_M + O.BEAMS].min(axis=1) < 20.0).mean() > 0.5  # in company


def test_braking_weighs_more(visits, tmp_path):
    arguments = Arguments(data=tmp_path, out=tmp_path, swerving=0.0)
    weight = urgency(arguments, labelled(visits, Expert()))
    wanted = mean_action(Expert(), visits.seen)[:, 0]
    assert weight.sum() == pytest.approx(1.0)
    assert weight[wanted.argmin()] == weight.max()
    assert np.allclose(weight[wanted >= 0.0], weight.min())


def test_lane_changes_are_left_out(visits):
    kept = lane_keeping(visits)
    assert 0 < len(kept) <= len(visits)
    assert np.abs(lateral_speed(kept.seen)).max() < 0.3
