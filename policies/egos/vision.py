"""The vision ego: a convolutional network from the camera's picture and the lidar to acceleration and turn rate.

What a vehicle with a camera, a lidar and a speedometer knows: of the 51 values it is given only the speed, the ranges
and the range rates; where the lanes are it has to see. The network is an ONNX file that contains its own
standardisation: inputs `frame` (1, 66, 200, 3) uint8 RGB and `beside` (1, 41) float32, output `action` (1, 2): m/s^2
and rad/s. It runs in ONNX Runtime on one thread: the same bits on one machine; on a processor with other vector
instructions the last bits of an action may differ (deploy/decisions/0033-vision-ego.md).

Where the file's metadata say so, braking and moving over in an emergency stand beside the network
(policies.egos.emergency), from the same lidar. It is given no lane offset there: the ego does not know it.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from policies import layout
from policies.drivers import WeightsError
from policies.egos.emergency import intervene
from policies.egos.protocol import Observation

FRAME_SHAPE = (66, 200, 3)
BESIDE = 1 + 2 * layout.BEAMS  # speed, ranges, range rates
EMERGENCY = "emergency"  # in the file's metadata
WEIGHTS = Path(__file__).resolve().parents[1] / "weights" / "ego-vision.onnx"


def beside(vector: np.ndarray) -> np.ndarray:
    """What goes beside the picture, (..., 41) float32, of observations (..., 51): speed, ranges and range rates."""
    seen = np.concatenate(
        [vector[..., layout.SPEED_MPS : layout.SPEED_MPS + 1], vector[..., layout.RANGE_M :]], axis=-1
    )
    return seen.astype(np.float32)


def vision_card(weights: Path = WEIGHTS) -> dict[str, Any]:
    """The card of the shipped weights: data, command, seed and figures for each weather."""
    return json.loads(weights.with_suffix(".json").read_text(encoding="utf-8"))


class VisionEgo:
    """Drives by what the camera shows; `act` raises ValueError where there is no picture of the right shape."""

    name = "vision"
    wants_camera = True

    def __init__(self, weights: Path = WEIGHTS, providers: Sequence[str] = ("CPUExecutionProvider",)):
        """Load the exported network.

        providers: ONNX Runtime's names of what may run the network, the best first
        """
        import onnxruntime  # here because it takes longer to import than the other egos together

        if not weights.is_file():
            raise WeightsError(f"{weights}: no such weights file")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(str(weights), options, providers=list(providers))
        self.emergency: bool = self._session.get_modelmeta().custom_metadata_map.get(EMERGENCY, "no") == "yes"

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> tuple[float, float]:
        action = self.act_batch([(self, observation)])[0]
        if isinstance(action, ValueError):
            raise action
        return action

    @staticmethod
    def act_batch(
        pairs: Sequence[tuple["VisionEgo", Observation]],
    ) -> list[tuple[float, float] | ValueError]:
        """The actions of egos with the same weights in one run of the network, each as if it were alone.

        In place of an action there is a ValueError where the picture is not one of the right shape.
        """
        answers: list[tuple[float, float] | ValueError] = [(0.0, 0.0)] * len(pairs)
        good: list[int] = []
        frames: list[np.ndarray] = []
        for i, (_, observation) in enumerate(pairs):
            frame = observation.frame
            if frame is not None and frame.shape == FRAME_SHAPE:
                good.append(i)
                frames.append(frame)
            else:
                answers[i] = _no_picture(frame)
        if good:
            seen = beside(np.stack([pairs[i][1].vector for i in good]))
            actions = pairs[0][0]._session.run(None, {"frame": np.stack(frames), "beside": seen})[0]
            for i, (acceleration, turn_rate) in zip(good, actions, strict=True):
                action = float(acceleration), float(turn_rate)
                answers[i] = _in_emergency(pairs[i][1], action) if pairs[0][0].emergency else action
        return answers


def _in_emergency(observation: Observation, action: tuple[float, float]) -> tuple[float, float]:
    known = np.array(observation.vector, dtype=np.float64)
    known[layout.LANE_OFFSET_M] = 0.0
    acceleration, turn_rate = intervene(known, *action)
    return float(acceleration), float(turn_rate)


def _no_picture(frame: np.ndarray | None) -> ValueError:
    given = "none" if frame is None else f"one of shape {frame.shape}"
    return ValueError(
        f"the vision ego needs a picture of shape {FRAME_SHAPE}, not {given}; leave width_px = 200 and "
        "height_px = 66 in the scenario's [camera]"
    )
