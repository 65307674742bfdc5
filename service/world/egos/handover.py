"""An ego that hands over to another driver at a given step of a rollout: what would have happened from there on?"""

from collections.abc import Callable, Mapping
from typing import Any

from policies.egos import EgoPolicy, Observation
from service.errors import InputError


class Handover:
    """Drives by one ego until a step, then by another, chosen before each rollout by `to`.

    Until then the rollout has the same bits as without it. A driver that has `begins_at_onset` knows nothing of what
    came before; any other one is asked at each step from the start, so that what it remembers is there.
    """

    def __init__(self, before: EgoPolicy, others: Mapping[str, EgoPolicy]):
        """InputError where two of them would have SUMO drive."""
        self.name = before.name
        self._before = before
        self._others = dict(others)
        self._after: EgoPolicy = before
        self._step = 0
        self._now = 0
        self._seed = 0
        every = [before, *self._others.values()]
        self.wants_camera = any(getattr(ego, "wants_camera", False) for ego in every)
        self._in_sumo = [ego for ego in every if getattr(ego, "enter", None) is not None]
        if len(self._in_sumo) > 1:
            raise InputError(
                f"egos {' and '.join(ego.name for ego in self._in_sumo)}: SUMO drives the ego by one model a "
                "simulation; give another reference"
            )

    def to(self, name: str | None, step: int = 0) -> None:
        """Hand over to the driver of that name at step `step` of the next rollouts; None: not at all."""
        self._after = self._before if name is None else self._others[name]
        self._step = step

    def reset(self, seed: int) -> None:
        self._now, self._seed = 0, seed
        self._before.reset(seed)
        if self._after is not self._before:
            self._after.reset(seed)

    def act(self, observation: Observation) -> tuple[float, float]:
        step, self._now = self._now, self._now + 1
        if self._after is self._before:
            return self._before.act(observation)
        if step >= self._step:
            return self._after.act(observation)
        if not getattr(self._after, "begins_at_onset", False):
            self._after.act(observation)
        return self._before.act(observation)

    def see_world(self, world: Any) -> None:
        for ego in (self._before, *self._others.values()):
            if (see := getattr(ego, "see_world", None)) is not None:
                see(world)

    @property
    def enter(self) -> Callable[[Any, str], None]:
        """Of the one that SUMO drives; AttributeError, as of any other ego, where there is none."""
        if not self._in_sumo:
            raise AttributeError("enter")
        entering: Callable[[Any, str], None] = getattr(self._in_sumo[0], "enter")  # noqa: B009
        return entering

    @property
    def model(self) -> str:
        """SUMO's, of the one that SUMO drives."""
        return str(getattr(self._in_sumo[0], "model", "")) if self._in_sumo else ""

    def close(self) -> None:
        for ego in (self._before, *self._others.values()):
            if (leave := getattr(ego, "close", None)) is not None:
                leave()
