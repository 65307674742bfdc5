"""An ego whose rollouts wait for a test's permission, so that the test decides how far a job in other processes is."""

from __future__ import annotations

import os
from pathlib import Path

from policies.egos.idm import IdmEgo

GATE = "TAILROAD_TEST_GATE"  # names a pipe; each rollout takes a byte from it. Unset: nothing waits
EGO = f"{__name__}:Gated"


class Gate:
    """The test's side of the pipe."""

    def __init__(self, path: Path):
        os.mkfifo(path)
        self._pipe = os.open(path, os.O_RDWR)  # both ways: nobody ever meets its end

    def let(self, rollouts: int) -> None:
        """Let so many rollouts begin; those that were begun and lost count too."""
        assert os.write(self._pipe, bytes(rollouts)) == rollouts

    def close(self) -> None:
        os.close(self._pipe)


class Gated(IdmEgo):
    """Drives like `idm`."""

    def __init__(self) -> None:
        path = os.environ.get(GATE)
        self._pipe = os.open(path, os.O_RDONLY) if path else None

    def reset(self, seed: int) -> None:
        if self._pipe is not None:
            os.read(self._pipe, 1)
        super().reset(seed)
