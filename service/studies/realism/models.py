"""The models of a card, each as something that drives columns of a scene."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from policies.baselines.fit import Fit, fit
from policies.data.recordings import Recordings, following_events, stacked
from policies.data.scenes import Scene
from policies.drivers import DriverModel
from policies.realism.driven import Driven
from service.studies.realism.drive import CONSTANT, HUMAN, IDM_MOBIL, NETWORK, Model, drive_scene, road_for
from service.studies.realism.evaluate import Runner
from service.studies.realism.krauss import Krauss
from service.world.scenario.schema import Scenario
from sumo_nets.corridor import load_corridor

IDM, KRAUSS, STILL = "idm-mobil", "krauss", "constant-speed"
PEOPLE = "human"  # the drivers with a scenario's human table around them
LABELS = {
    IDM: "IDM + MOBIL, fitted",
    KRAUSS: "SUMO's Krauss",
    STILL: "constant speed",
}


def fitted(recordings: Recordings) -> Fit:
    """IDM+MOBIL fitted to the training vehicles of all scenes and to the recordings' car-following events."""
    parts = [recordings.following]
    if recordings.from_pack:  # tables' events are their scenes' already
        parts.append(following_events(recordings.scenes))
    return fit(stacked([event for part in parts for event in part]), recordings.scenes)


def network(name: str, drivers: DriverModel, scenes: list[Scene], seed: int) -> Runner:
    """Drivers with xi ~ N(mu0, Sigma0), one draw a rollout."""
    return _drawn(Model(name, NETWORK, drivers), drivers, scenes, seed)


def human(scenario: Scenario, drivers: DriverModel, scenes: list[Scene], seed: int) -> Runner:
    """As `network`, with the scenario's human table around it."""
    return _drawn(Model(PEOPLE, HUMAN, drivers, human=scenario), drivers, scenes, seed)


def _drawn(model: Model, drivers: DriverModel, scenes: list[Scene], seed: int) -> Runner:
    root = np.linalg.cholesky(drivers.sigma0) if drivers.sigma0.any() else np.zeros_like(drivers.sigma0)

    def head(rng: np.random.Generator) -> np.ndarray:
        return drivers.mu0 + root @ rng.standard_normal(len(root))

    return _in_kernels(model, scenes, seed, head)


def idm_mobil(values: np.ndarray, scenes: list[Scene], seed: int) -> Runner:
    return _in_kernels(Model(IDM, IDM_MOBIL, values=values), scenes, seed, lambda _: None)


def constant_speed(scenes: list[Scene], seed: int) -> Runner:
    return _in_kernels(Model(STILL, CONSTANT), scenes, seed, lambda _: None)


def _in_kernels(
    model: Model, scenes: list[Scene], seed: int, head: Callable[[np.random.Generator], np.ndarray | None]
) -> Runner:
    roads = [road_for(scene) for scene in scenes]

    def drive(number: int, scene: Scene, first: int, steps: int, who: np.ndarray, sample: int) -> Driven:
        rng = np.random.default_rng([seed, number, first, int(who[0]), len(who), sample])
        return drive_scene(model, scene, roads[number], first, steps, who, head(rng), rng)

    return drive


@contextmanager
def krauss(seed: int) -> Iterator[Runner]:
    """SUMO's own driver, in SUMO on the I-80 network."""
    with Krauss(load_corridor("i80"), seed) as sumo:
        yield lambda _, scene, first, steps, who, __: sumo.drive_scene(scene, first, steps, who)
