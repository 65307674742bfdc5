"""An ego that fails in every rollout."""

from __future__ import annotations

from policies.egos.idm import IdmEgo

EGO = f"{__name__}:NeverDrives"


class NeverDrives(IdmEgo):
    """Fails when its rollout begins."""

    def reset(self, seed: int) -> None:
        raise RuntimeError("the ego has no engine")
