"""Windows of recorded scenes as batches for the torch world: some vehicles are driven, others are replayed."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from policies.data.scenes import Scene
from service.training.demonstrations import held_out_vehicles
from service.training.torch_world import CPU, State, TorchRoad, state_of, torch_road
from service.world.sim.road import scene_road

DRIVEN = 6  # in a window: the network drives neighbours at once, with the same weights
REPLAYED = 24  # nearest others; what lies beyond them is hidden behind them


@dataclass(frozen=True)
class Batch:
    """B windows of `steps`: the first DRIVEN columns of `state` are driven.

    replay (steps + 1, B, REPLAYED, 4): x, y, heading, speed, NaN where absent
    target (steps + 1, B, DRIVEN, 3): station m, lateral offset m, speed m/s as recorded
    used (B, DRIVEN): 0 for columns that hold nobody
    """

    state: State
    road: TorchRoad
    replay: Tensor
    target: Tensor
    used: Tensor


class Windows:
    """Windows of the training vehicles of one site's scenes, which share a road."""

    def __init__(self, scenes: list[Scene], held_out: bool = False, device: torch.device = CPU):
        self._scenes, self._device = scenes, device
        self.road = torch_road(scene_road(scenes[0].road), device=device)
        self._states = [np.stack([s.x, s.y, s.heading, s.speed], axis=-1) for s in scenes]
        self._remaining = [_remaining(s.present) for s in scenes]
        self._may = [s.usable & (held_out_vehicles(s) == held_out) for s in scenes]

    def starts(self, steps: int) -> np.ndarray:
        """(n, 3) scene, frame and vehicle of every window of `steps`."""
        found = [
            np.column_stack([np.full(int(ok.sum()), i), *np.nonzero(ok)])
            for i, ok in enumerate(self._long_enough(steps))
        ]
        return np.concatenate(found)

    def _long_enough(self, steps: int) -> list[np.ndarray]:
        return [may & (left > steps) for may, left in zip(self._may, self._remaining, strict=True)]

    def batch(self, starts: np.ndarray, steps: int) -> Batch:
        """The windows (n, 3) that begin at `starts`: the vehicle and its nearest neighbours are driven."""
        n = len(starts)
        now = np.zeros((n, DRIVEN + REPLAYED, 4))
        size = np.ones((n, DRIVEN + REPLAYED, 2))
        present = np.zeros((n, DRIVEN + REPLAYED), dtype=bool)
        replay = np.full((steps + 1, n, REPLAYED, 4), np.nan)
        target = np.zeros((steps + 1, n, DRIVEN, 3))
        station = np.zeros((n, DRIVEN), dtype=np.int64)
        long_enough = self._long_enough(steps)
        for i, (number, frame, vehicle) in enumerate(starts):
            scene, state = self._scenes[number], self._states[number]
            window = slice(frame, frame + steps + 1)
            away = np.hypot(*(state[frame, :, :2] - state[frame, vehicle, :2]).T)
            away = np.where(np.isfinite(away), away, 1e3)
            driven = np.flatnonzero(long_enough[number][frame])
            driven = driven[np.argsort(away[driven], kind="stable")][:DRIVEN]
            others = np.flatnonzero(scene.present[window].any(axis=0))
            others = others[~np.isin(others, driven)]
            others = others[np.argsort(away[others], kind="stable")][:REPLAYED]
            d, o = len(driven), DRIVEN + len(others)
            for columns, who in ((slice(0, d), driven), (slice(DRIVEN, o), others)):
                now[i, columns] = state[frame, who]
                size[i, columns] = np.column_stack([scene.length_m[who], scene.width_m[who]])
                present[i, columns] = scene.present[frame, who]
            replay[:, i, : len(others)] = state[window, others]
            for c, values in enumerate((scene.station, scene.lateral, scene.speed)):
                target[:, i, :d, c] = values[window, driven]
            last = len(self.road.reference) - 1
            station[i, :d] = np.clip(np.round(scene.station[frame, driven]), 0, last)
        now = np.nan_to_num(now)
        used = present[:, :DRIVEN]
        return Batch(
            state_of(np.concatenate([now, size], axis=-1), present, station, device=self._device),
            self.road,
            *(
                torch.as_tensor(table, dtype=torch.float32).to(self._device)
                for table in (replay, target, used)
            ),
        )


def _remaining(present: np.ndarray) -> np.ndarray:
    """(F, N): how many frames in a row a vehicle is there, this one included."""
    left = np.zeros(present.shape, dtype=np.int64)
    count = np.zeros(present.shape[1], dtype=np.int64)
    for frame in range(len(present) - 1, -1, -1):
        count = np.where(present[frame], count + 1, 0)
        left[frame] = count
    return left
