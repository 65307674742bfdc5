"""The vision ego's network while it learns (after PilotNet, Bojarski et al. 2016), and its way to an ONNX file."""

from pathlib import Path

import onnx
import torch
from torch import Tensor, nn

from policies.egos.vision import BESIDE, EMERGENCY, FRAME_SHAPE

CHANNELS = (16, 24, 36, 48, 48)  # PilotNet has 24, 36, 48, 64, 64; half the work, as good here
FEATURES = 100
HIDDEN = 64
ACTION_SCALE = (1.0, 0.02)  # m/s^2, rad/s: what one unit of output means
HINTS = 3  # lane offset, heading and curvature, which the picture's features are taught to tell
HINT_SCALE = (0.5, 0.03, 0.0005)  # m, rad, 1/m
SPEED_MPS, RANGE_M, RATE_MPS = 20.0, 100.0, 15.0


class VisionNet(nn.Module):
    """Picture -> five convolutions -> features; features, speed and lidar -> dense layers -> action."""

    beside_scale: Tensor
    action_scale: Tensor

    def __init__(self) -> None:
        super().__init__()
        a, b, c, d, e = CHANNELS
        self.convolutions = nn.Sequential(
            nn.Conv2d(3, a, 5, 2), nn.ReLU(),
            nn.Conv2d(a, b, 5, 2), nn.ReLU(),
            nn.Conv2d(b, c, 5, 2), nn.ReLU(),
            nn.Conv2d(c, d, 3), nn.ReLU(),
            nn.Conv2d(d, e, 3), nn.ReLU(),
            nn.Flatten(),
        )  # fmt: skip
        self.features = nn.Sequential(nn.Linear(e * 18, FEATURES), nn.ReLU())
        self.hints = nn.Linear(FEATURES, HINTS)
        self.dense = nn.Sequential(
            nn.Linear(FEATURES + BESIDE, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, 2)
        )  # fmt: skip
        scale = torch.full((BESIDE,), 1.0 / RATE_MPS)
        scale[0] = 1.0 / SPEED_MPS
        scale[1 : 1 + (BESIDE - 1) // 2] = 1.0 / RANGE_M
        self.register_buffer("beside_scale", scale)
        self.register_buffer("action_scale", torch.tensor(ACTION_SCALE))

    def both(self, frame: Tensor, beside: Tensor) -> tuple[Tensor, Tensor]:
        """Actions in units of ACTION_SCALE and hints in units of HINT_SCALE, (n, 2) and (n, 3)."""
        picture = frame.permute(0, 3, 1, 2).to(torch.float32)
        # each picture on its own scale: night, glare and fog look alike in what matters
        mean = picture.mean(dim=(1, 2, 3), keepdim=True)
        spread = ((picture - mean) ** 2).mean(dim=(1, 2, 3), keepdim=True).sqrt()
        features = self.features(self.convolutions((picture - mean) / (spread + 4.0)))
        seen = (beside * self.beside_scale).clamp(-2.0, 2.0)
        return self.dense(torch.cat([features, seen], 1)), self.hints(features)

    def forward(self, frame: Tensor, beside: Tensor) -> Tensor:
        """Actions (n, 2) in m/s^2 and rad/s for frames (n, 66, 200, 3) uint8 and values (n, 41)."""
        return self.both(frame, beside)[0] * self.action_scale


def export(net: VisionNet, path: Path, emergency: bool = False) -> None:
    """Write the network as ONNX, for one picture at a time or many; emergency: whether the ego brakes and moves over in
    an emergency beside it (policies.egos.emergency)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    example = (torch.zeros((1, *FRAME_SHAPE), dtype=torch.uint8), torch.zeros((1, BESIDE)))
    net.eval()
    torch.onnx.export(
        net, example, str(path), input_names=["frame", "beside"], output_names=["action"], opset_version=17,
        dynamic_axes={"frame": {0: "n"}, "beside": {0: "n"}, "action": {0: "n"}}, dynamo=False,
    )  # fmt: skip
    if emergency:
        model = onnx.load(str(path))
        onnx.helper.set_model_props(model, {EMERGENCY: "yes"})
        onnx.save(model, str(path))
