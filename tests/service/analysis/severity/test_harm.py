"""Change of velocity and risk of injury by hand."""

import math

import numpy as np
import pytest

from service.analysis.severity.harm import FRICTION, RESTITUTION, exchanged_mps, harms_of, injury_risk
from service.analysis.severity.masses import class_of, masses_of
from service.errors import InputError
from service.world import agents as A
from service.world.safety.contact import Contact, contact_of


def contact(ego_side: str, other_side: str, ahead_mps: float, left_mps: float) -> Contact:
    speed = math.hypot(ahead_mps, left_mps)
    return Contact(1, speed, ahead_mps, left_mps, ego_side, "middle", other_side, "middle", "ego")


def test_risks_of_the_published_model():
    assert [round(injury_risk(15.0, area), 3) for area in ("front", "side", "rear")] == [0.142, 0.174, 0.097]


def test_a_plastic_impact_shares_the_velocity_by_the_masses():
    ego, other = harms_of(contact("front", "rear", -12.0, 0.0), 1500.0, 3000.0)
    assert (ego.delta_v_mps, other.delta_v_mps) == pytest.approx((8.0, 4.0))  # momentum: 1500 x 8 = 3000 x 4
    assert (ego.area, other.area) == ("front", "rear")
    assert ego.injury == injury_risk(8.0, "front")


def test_a_front_into_a_side_is_plastic_too():
    assert exchanged_mps(contact("right", "front", -3.0, 4.0)) == pytest.approx(5.0)


def test_sides_slide_along_each_other():
    across = (1.0 + RESTITUTION) * 0.5
    assert exchanged_mps(contact("left", "right", -8.0, -0.5)) == pytest.approx(
        across * math.hypot(1.0, FRICTION)
    )
    slow = contact("left", "right", -0.1, -0.5)  # friction stops what little there is along the sides
    assert exchanged_mps(slow) == pytest.approx(math.hypot(across, 0.1))


def test_from_boxes_to_harm():
    agents = np.zeros((2, A.COLUMNS))
    agents[:, [A.LENGTH_M, A.WIDTH_M, A.ACTIVE, A.COS]] = 4.5, 1.8, 1.0, 1.0
    agents[:, A.SPEED_MPS] = 20.0, 10.0
    agents[1, A.X_M] = 4.4
    found = contact_of(agents, 2, 0)
    assert found is not None
    ego, other = harms_of(found, 1600.0, 1600.0)
    assert (ego.delta_v_mps, ego.area, other.area) == (pytest.approx(5.0), "front", "rear")


def test_masses_go_by_length_unless_they_are_given(make_scenario):
    scenario = make_scenario()
    names = [vehicle.name for vehicle in scenario.vehicles]
    assert set(masses_of(scenario).values()) == {class_of(4.5)[1]}
    assert masses_of(scenario, {names[1]: 9000.0})[names[1]] == 9000.0
    assert [class_of(length)[0] for length in (2.0, 4.5, 7.0, 12.0, 18.0)] == [
        "motorcycle", "car", "van or light truck", "truck", "articulated truck"
    ]  # fmt: skip
    with pytest.raises(InputError, match=names[0]):
        masses_of(scenario, {"nobody": 1.0})
    with pytest.raises(InputError, match="above 0"):
        masses_of(scenario, {names[1]: -1.0})
