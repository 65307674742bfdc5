"""What the API answers on rollouts: pages and lists of them, and one run once more."""

from typing import Any

import msgspec

from service.analysis.failures.playback import Playback
from service.world.safety.contact import Contact


class _Body(msgspec.Struct, frozen=True, kw_only=True):
    pass


class Rollouts(_Body, frozen=True):
    """A page of the rollouts on record, as columns of the same length.

    row: of the batch (phase, iteration)
    f: null where the rollout failed, for the reason in error
    worker: who ran it
    contact: how the ego and another vehicle touched; null: they did not, or, where the outcome is "collision", it was
        not recorded
    next: give it as `after` for the next page, null: this was the last
    """

    phase: tuple[str, ...]
    iteration: tuple[int, ...]
    row: tuple[int, ...]
    f: tuple[float | None, ...]
    outcome: tuple[str, ...]
    steps: tuple[int, ...]
    error: tuple[str | None, ...]
    worker: tuple[str | None, ...]
    contact: tuple[Contact | None, ...]
    next: str | None


class Listing(_Body, frozen=True):
    """Some of the rollouts on record, as columns of the same length. total: on record; found: of them as were asked
    for; f: null where a rollout failed, and where it is infinite, as nothing was ever on its way to the ego."""

    job: str
    total: int
    found: int
    phase: tuple[str, ...]
    iteration: tuple[int, ...]
    row: tuple[int, ...]
    f: tuple[float | None, ...]
    outcome: tuple[str, ...]


class CameraPicture(_Body, frozen=True):
    """What the ego's camera saw.

    state: its place among the states of the trace
    jpeg: the picture, base64
    """

    state: int
    time_s: float
    jpeg: str


class RolloutView(_Body, frozen=True):
    """A rollout, run once more.

    f: on record
    scenario: text of a scenario file that brings it back to the bit
    trace: columns of the state of every vehicle at every step
    playback: what a player needs
    camera: as many pictures as were asked for

    What was not asked for is null.
    """

    job: str
    phase: str
    iteration: int
    row: int
    noise_seed: str
    f: float | None
    f_again: float | None
    same_to_the_bit: bool
    dangerous: bool
    outcome: str
    error: str | None
    motion: dict[str, Any] | None
    scenario: str
    trace: dict[str, list[Any]] | None
    playback: Playback | None
    camera: tuple[CameraPicture, ...] | None
