"""A rollout recorded step by step, for videos, plots and tables."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl

from service.evaluation.job import Problem
from service.world import agents as A
from service.world.scenario.noise import Noise
from service.world.sim import minds as M
from service.world.sim.rollout import Rollout, Simulator
from service.world.sim.world import World

TABLE_COLUMNS = {
    "x_m": A.X_M,
    "y_m": A.Y_M,
    "heading_rad": A.HEADING_RAD,
    "speed_mps": A.SPEED_MPS,
    "acceleration_mps2": A.ACCELERATION_MPS2,
    "turn_rate_radps": A.TURN_RATE_RADPS,
    "lane_offset_m": A.LANE_OFFSET_M,
    "offset_m": A.OFFSET_M,
    "length_m": A.LENGTH_M,
    "width_m": A.WIDTH_M,
}


@dataclass(frozen=True)
class Trace:
    """What happened at each of T states of a rollout, the start and the end included.

    agents: (T, vehicles, columns of service.world.agents)
    ttc_s: (T,) the ego's time to collision
    actions: (T - 1, 2) the ego's acceleration (m/s^2) and turn rate (rad/s)
    measured: (T,) the scenario's safety `measure` at each state
    minds: (T, vehicles, columns of service.world.sim.minds) of human drivers; empty where there are none
    """

    names: tuple[str, ...]
    ego: int
    time_s: np.ndarray
    agents: np.ndarray
    ttc_s: np.ndarray
    actions: np.ndarray
    station_spacing_m: float
    rollout: Rollout
    measure: str
    measured: np.ndarray
    minds: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, M.COLUMNS)))

    @property
    def station_m(self) -> np.ndarray:
        """(T, vehicles): how far along the road each vehicle is."""
        return self.agents[:, :, A.STATION] * self.station_spacing_m + self.agents[:, :, A.ALONG_M]

    def table(self) -> pl.DataFrame:
        """A row for each state and vehicle still on the road."""
        steps, vehicles = self.agents.shape[:2]
        columns: dict[str, object] = {
            "time_s": np.repeat(self.time_s, vehicles),
            "vehicle": list(self.names) * steps,
            "ego": np.tile(np.arange(vehicles) == self.ego, steps),
            "station_m": self.station_m.ravel(),
            "lane": self.agents[:, :, A.LANE].astype(np.int32).ravel() + 1,
        }
        for name, column in TABLE_COLUMNS.items():
            columns[name] = self.agents[:, :, column].ravel()
        for name, column in (
            ("collision", A.COLLISION),
            ("off_road", A.OFF_ROAD),
            ("taken_over", A.TAKEN_OVER),
        ):
            columns[name] = self.agents[:, :, column].ravel() != 0.0
        columns["ttc_s"] = np.repeat(self.ttc_s, vehicles)
        columns["f"] = np.repeat(self.measured, vehicles)
        active = self.agents[:, :, A.ACTIVE].ravel() != 0.0
        return pl.DataFrame(columns).filter(pl.Series(active))


@dataclass
class _Recorder:
    time_s: list[float] = field(default_factory=list)
    agents: list[np.ndarray] = field(default_factory=list)
    ttc_s: list[float] = field(default_factory=list)
    actions: list[tuple[float, float]] = field(default_factory=list)
    minds: list[np.ndarray] = field(default_factory=list)

    def see(self, world: World, time_s: float, ttc_s: float, action: tuple[float, float] | None) -> None:
        self.time_s.append(time_s)
        self.agents.append(world.agents[: world.vehicles].copy())
        self.ttc_s.append(ttc_s)
        if world.traits.size:
            self.minds.append(world.minds.copy())
        if action is not None:
            self.actions.append(action)


def record(problem: Problem, simulator: Simulator, x: np.ndarray, noise_seed: Noise) -> Trace:
    """Run the rollout of x (d,) and its noise seed once more, and record it."""
    recorder = _Recorder()
    rollout = simulator.run(x, noise_seed, recorder)
    measured = simulator.measured() if rollout.error is None else np.full(len(recorder.ttc_s), np.nan)
    scenario = problem.job.scenario
    return Trace(
        names=tuple(vehicle.name for vehicle in scenario.vehicles),
        ego=scenario.ego,
        time_s=np.array(recorder.time_s),
        agents=np.array(recorder.agents),
        ttc_s=np.array(recorder.ttc_s),
        actions=np.array(recorder.actions).reshape(-1, 2),
        station_spacing_m=float(problem.corridor.ds_m),
        rollout=rollout,
        measure=scenario.safety.measure,
        measured=np.array(recorder.ttc_s) if measured is None else measured,
        minds=np.array(recorder.minds).reshape(-1, len(scenario.vehicles), M.COLUMNS),
    )


def write_table(trace: Trace, path: Path) -> None:
    """Write the trace as a Parquet file."""
    trace.table().write_parquet(path)
