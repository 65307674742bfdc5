"""Rollouts on roads that others make: their side, their permissions, their lengths; SUMO's speeds are the trace's."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import libsumo
import numpy as np
import pytest

import ce
from service.errors import SimulationError
from service.evaluation.job import Problem, make_job
from service.world import agents as A
from service.world.egos.sumo import MODELS
from service.world.scenario import load_scenario
from service.world.scenario.check import check_road
from service.world.sim.sumo_check import check_in_sumo
from tests.sumo_nets.test_nets_strips import connections, edge_text

BASE = [-8.0, -4.8, -1.6]
PLAIN = [""] * 3
BACKGROUND = "\n[background]\ndensity_veh_per_km_lane = 20.0\nspeed_mps = 14.0\n"


def network(lanes: list[str], y: list[float], length: float = 300.0, limit: float = 29.0) -> str:
    """Edges e1 and e2 of 300 m as drawn, `lanes`: further attributes by SUMO's index, `y`: where each is drawn."""
    parts = ['<net version="1.20"><location netOffset="0,0" convBoundary="0,0,600,20" origBoundary="0,0,1,1" '
             'projParameter="!"/>']  # fmt: skip
    for edge, ends, x in (("e1", "ab", 0), ("e2", "bc", 300)):
        parts += edge_text(edge, ends, x, lanes, y, f'speed="{limit}" length="{length}"')
    ids = {edge: " ".join(f"{edge}_{i}" for i in range(len(y))) for edge in ("e1", "e2")}
    parts += [
        '<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,-9"/>',
        f'<junction id="b" type="unregulated" x="300" y="0" incLanes="{ids["e1"]}" intLanes="" shape="300,0 300,-9"/>',
        f'<junction id="c" type="dead_end" x="600" y="0" incLanes="{ids["e2"]}" intLanes="" shape="600,0 600,-9"/>',
    ]
    return "".join([*parts, *connections(len(y)), "</net>"])


@pytest.fixture
def problem(tmp_path: Path, scenario_text: str):
    """problem(net, ego, more): the ego in lane 2, others in 1 and 3, stations 80 to 120, 8 to 10 m/s."""

    def make(
        net: str,
        ego: str = "idm",
        more: str = "",
        lanes: tuple[int, int, int] = (2, 1, 3),
        horizon: float = 10.0,
    ):
        (tmp_path / "made.net.xml").write_text(net, encoding="utf-8")
        head = scenario_text.partition("# Lane 1 is")[0]
        head = head.replace('road = "i80"', 'road = "made.net.xml"\nedges = ["e1", "e2"]')
        head = head.replace("low = 10.0, high = 20.0", "low = 8.0, high = 10.0")
        head = head.replace("horizon_s = 10.0", f"horizon_s = {horizon}")
        vehicles = "".join(
            f'\n[[vehicles]]\nname = "{name}"\nlane = {lane}\n' + ('role = "ego"\n' if name == "ego" else "")
            for name, lane in zip(("ego", "one", "two"), lanes, strict=True)
        )
        path = tmp_path / "made.toml"
        path.write_text(head + vehicles + more, encoding="utf-8")
        scenario = load_scenario(str(path))
        check_road(scenario, str(path))
        return Problem(make_job(scenario, ego, 0.5, "naive", 5, {}))

    return make


def outcomes(problem: Problem, count: int = 4) -> list[tuple[float, str, int]]:
    x, seeds = ce.draw(problem.base, 5, "estimate", 0, 0, count)
    with problem.simulator() as simulator:
        found = [simulator.run(row, int(seed)) for row, seed in zip(x, seeds, strict=True)]
    assert [r.error for r in found] == [None] * count
    return [(r.f, r.outcome, r.steps) for r in found]


def test_the_same_road_counted_from_the_other_side_is_the_same_road(problem):
    assert outcomes(problem(network(PLAIN, BASE))) == outcomes(problem(network(PLAIN, BASE[::-1])))


def test_in_left_hand_traffic_nobody_leaves_the_road(problem):
    left = problem(network(PLAIN, [8.0, 4.8, 1.6]), lanes=(2, 1, 3))
    assert {outcome for _, outcome, _ in outcomes(left, 8)} == {"horizon"}


@pytest.mark.parametrize(
    "lanes",
    [['allow="passenger"'] * 3, ['disallow="hov"'] * 3, ['disallow="truck bus"', 'allow="all"', ""]],
)
def test_whatever_the_permissions_the_rollouts_are_the_same(problem, lanes):
    assert outcomes(problem(network(lanes, BASE))) == outcomes(problem(network(PLAIN, BASE)))


@pytest.mark.parametrize("closed", ['disallow="all"', 'allow="pedestrian"', 'allow="bus"'])
def test_there_is_no_background_where_it_may_not_drive(problem, closed):
    made = problem(network([closed, *PLAIN], [-11.2, *BASE]), more=BACKGROUND)
    x, seeds = ce.draw(made.base, 5, "estimate", 0, 0, 2)
    seen = []

    class Rows:
        def see(self, world, time_s, ttc_s, action):
            seen.append(world.agents[world.vehicles : world.count, A.Y_M].copy())

    with made.simulator() as simulator:
        for row, seed in zip(x, seeds, strict=True):
            assert simulator.run(row, int(seed), Rows()).error is None
    y = np.concatenate(seen)
    assert len(y) > 0
    assert y.min() > -9.6


@pytest.mark.parametrize("length", [900.0, 100.0])
@pytest.mark.parametrize("ego", ["idm", "sumo:Krauss", "sumo:IDM"])
def test_a_length_that_is_stated_but_not_drawn_changes_nothing(problem, ego, length):
    more = BACKGROUND if ego != "sumo:IDM" else ""
    lanes = (2, 1, 3)
    assert outcomes(problem(network(PLAIN, BASE, length), ego, more, lanes), 2) == outcomes(
        problem(network(PLAIN, BASE), ego, more, lanes), 2
    )


class Speeds:
    """SUMO's speed of each placed vehicle beside the kernels'."""

    def __init__(self, names):
        self._names, self.apart = names, []

    def see(self, world, time_s, ttc_s, action):
        known = set(libsumo.vehicle.getIDList())
        for name, agent in zip(self._names, world.agents, strict=False):
            if agent[A.ACTIVE] and name in known:
                self.apart.append(abs(libsumo.vehicle.getSpeed(name) - agent[A.SPEED_MPS]))


@pytest.mark.parametrize("ego", ["idm", "sumo:ACC"])
def test_sumo_has_the_speed_that_vehicles_drive_at(problem, ego, tmp_path):
    """On a road with a limit of 5 m/s, from the first step on."""
    made = problem(network(PLAIN, BASE, limit=5.0), ego, "" if ego == "sumo:ACC" else BACKGROUND)
    x, seeds = ce.draw(made.base, 5, "estimate", 0, 0, 1)
    seen = Speeds(["ego", "one", "two"])
    with made.simulator(fcd=tmp_path / "fcd.xml") as simulator:
        steps = simulator.run(x[0], int(seeds[0]), seen).steps
        speed = simulator._world.agents[:3, A.SPEED_MPS].tolist()
    assert max(seen.apart) < 1e-9
    moments = ET.parse(tmp_path / "fcd.xml").getroot().findall("timestep")
    assert [m.get("time") for m in moments] == [f"{k * 0.1:.2f}" for k in range(steps + 1)]
    last = {v.get("id"): float(v.get("speed")) for v in moments[-1].findall("vehicle")}
    assert [last[name] for name in ("ego", "one", "two")] == pytest.approx(speed, abs=1e-4)
    assert min(float(v.get("speed")) for m in moments for v in m if v.get("id") == "ego") > 1.0


def test_speeds_hold_over_every_joint_of_i80(i80, drivers, make_scenario):
    scenario = make_scenario({"low = 80.0, high = 120.0": "low = 150.0, high = 190.0"})
    made = Problem(make_job(scenario, "sumo:IDM", 0.5, "naive", 5, {}))
    x, seeds = ce.draw(made.base, 5, "estimate", 0, 0, 2)
    seen = Speeds([vehicle.name for vehicle in scenario.vehicles])
    with made.simulator() as simulator:
        for row, seed in zip(x, seeds, strict=True):
            assert simulator.run(row, int(seed), seen).error is None
    assert max(seen.apart) < 1e-9


@pytest.mark.parametrize("model", MODELS)
def test_a_rollout_is_the_same_in_whatever_order_rollouts_come(problem, model):
    """The ego behind a leader in its lane, so that its model is asked."""
    made = problem(
        network(PLAIN, BASE),
        f"sumo:{model}",
        lanes=(2, 1, 3),
        more='\n[[vehicles]]\nname = "leader"\nlane = 2\n'
        'station_m = { distribution = "uniform", low = 130.0, high = 150.0 }\n',
    )
    x, seeds = ce.draw(made.base, 5, "estimate", 0, 0, 6)
    found = []
    for order in (range(6), range(5, -1, -1)):
        with made.simulator() as simulator:
            runs = {k: simulator.run(x[k], int(seeds[k])) for k in order}
        assert all(run.error is None for run in runs.values())
        found.append([(runs[k].f, runs[k].outcome, runs[k].steps) for k in range(6)])
    assert found[0] == found[1]


def test_roads_are_shown_to_sumo_in_a_process_of_its_own(tmp_path):
    good = tmp_path / "good.net.xml"
    good.write_text(network(PLAIN, BASE), encoding="utf-8")
    check_in_sumo(str(good), ["e1", "e2"])
    broken = {
        "no junctions": re.sub(r"<junction.*?/>", "", network(PLAIN, BASE)),
        "no number": network(PLAIN, BASE).replace('speed="29.0"', 'speed="fast"', 1),
        "no edge": network(PLAIN, BASE).replace('to="c"', 'to="z"'),
    }
    for name, text in broken.items():
        path = tmp_path / f"{name.replace(' ', '-')}.net.xml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(
            SimulationError, match=f"SUMO cannot use .*{path.name}: Error.*Build it anew"
        ) as refused:
            check_in_sumo(str(path), ["e1", "e2"])
        assert "\n" not in str(refused.value), name


def test_a_road_beside_the_scenario_is_found_from_anywhere(problem, tmp_path, monkeypatch):
    problem(network(PLAIN, BASE))
    (tmp_path / "made.net.xml").rename(tmp_path / "x.net")
    text = (tmp_path / "made.toml").read_text()
    (tmp_path / "made.toml").write_text(re.sub(r"made\.net\.xml", "x.net", text))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load_scenario("../made.toml").network.road == str(tmp_path / "x.net")
