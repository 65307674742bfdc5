"""A policy that was trained in `service.world.environment`, as a file that is an ego: `--ego onnx:FILE`."""

from pathlib import Path

import torch
from torch import Tensor, nn

from policies import layout
from service.errors import InputError
from service.world.environment import HIGH, LOW, STATE, TrafficEnv


class _Physical(nn.Module):
    """Observations as rollouts have them to actions in m/s^2 and rad/s, by a policy of an environment's spaces."""

    low: Tensor
    high: Tensor

    def __init__(self, actor: nn.Module, scaled: bool, max_turn_rate_radps: float):
        super().__init__()
        self.actor, self.scaled, self.max_turn_rate_radps = actor, scaled, max_turn_rate_radps
        self.register_buffer("low", torch.tensor(LOW, dtype=torch.float32))
        self.register_buffer("high", torch.tensor(HIGH, dtype=torch.float32))

    def forward(self, observation: Tensor) -> Tensor:
        """(1, 51) to (1, 2)."""
        seen = torch.minimum(torch.maximum(observation, self.low), self.high)
        if self.scaled:
            seen = 2.0 * (seen - self.low) / (self.high - self.low) - 1.0
        asked = self.actor(seen).clamp(-1.0, 1.0)
        along, turn = asked[:, :1], asked[:, 1:]
        ahead = along.clamp(min=0.0) * layout.MAX_ACCELERATION_MPS2
        braking = along.clamp(max=0.0) * layout.MAX_DECELERATION_MPS2
        return torch.cat([ahead + braking, turn * self.max_turn_rate_radps], 1)


def export(actor: nn.Module, env: TrafficEnv, path: Path) -> Path:
    """Write a trained policy as ONNX with the signature of `onnx:FILE` egos, and say where.

    actor: observations of `env` (n, 51) float32 to actions of `env` (n, 2)
    env: that it was trained in; its scaling and limits become part of the file

    InputError for an environment with a camera.
    """
    if env.observed != STATE:
        raise InputError(
            f"policies of the observation {env.observed!r} cannot be exported, those of {STATE!r} can: write the ONNX "
            "file by your framework, with the inputs that policies/egos/onnx_file.py names"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    physical = _Physical(actor, env.scaled, env.max_turn_rate_radps).cpu().eval()
    torch.onnx.export(
        physical, (torch.zeros((1, layout.OBSERVATION_SIZE)),), str(path), input_names=["observation"],
        output_names=["action"], opset_version=17, dynamo=False,
    )  # fmt: skip
    return path
