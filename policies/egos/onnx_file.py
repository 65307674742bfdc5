"""An ego that is a network in a file of the user's: `--ego onnx:FILE`.

The file declares its signature, and is refused where it has another:

    input `observation`  (1, 51) float32: the values of policies.layout, in metres, seconds and radians
    input `frame`        (1, height, width, 3) uint8, optional: the camera's picture, as the scenario's [camera] has it
    output `action`      (1, 2) float32: acceleration (m/s^2) and turn rate (rad/s)

It runs in ONNX Runtime on one thread: the same bits on one machine; on a processor with other vector instructions the
last bits of an action may differ.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from policies import layout
from policies.drivers import WeightsError
from policies.egos.protocol import Observation

PREFIX = "onnx:"
LARGEST_BYTES = 1 << 30
OBSERVATION, FRAME, ACTION = "observation", "frame", "action"
SIGNATURE = (
    f"it needs an input {OBSERVATION!r} of float32 (1, {layout.OBSERVATION_SIZE}), may have an input {FRAME!r} of "
    f"uint8 (1, height, width, 3), and has one output {ACTION!r} of float32 (1, 2)"
)


class OnnxEgo:
    """Drives by a network in ONNX; WeightsError for a file that is none, or of another signature."""

    def __init__(self, path: Path):
        import onnxruntime  # here because it takes longer to import than the other egos together

        self.name = f"{PREFIX}{path}"
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        data = _bytes(path)
        try:
            self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # ONNX Runtime raises kinds of its own for whatever is wrong with a file
            raise WeightsError(f"{path} is no ONNX network that can be run: {_line(error)}") from error
        inputs = {one.name: one for one in self._session.get_inputs()}
        outputs = {one.name: one for one in self._session.get_outputs()}
        self.wants_camera = FRAME in inputs
        good = (
            set(inputs) in ({OBSERVATION}, {OBSERVATION, FRAME})
            and set(outputs) == {ACTION}
            and _is(inputs[OBSERVATION], "tensor(float)", (1, layout.OBSERVATION_SIZE))
            and _is(outputs[ACTION], "tensor(float)", (1, 2))
            and (FRAME not in inputs or _is(inputs[FRAME], "tensor(uint8)", (1, None, None, 3)))
        )
        if not good:
            given = ", ".join(
                f"{one.name} {one.type} {one.shape}" for one in (*inputs.values(), *outputs.values())
            )
            raise WeightsError(f"{path} has another signature ({given[:300]}): {SIGNATURE}")
        self._frame_shape = inputs[FRAME].shape[1:] if self.wants_camera else None

    def reset(self, seed: int) -> None:
        """Nothing is kept from one rollout to the next."""

    def act(self, observation: Observation) -> tuple[float, float]:
        """The network's action; ValueError where the picture is missing or of another size."""
        given: dict[str, Any] = {OBSERVATION: observation.vector[None].astype(np.float32)}
        if self._frame_shape is not None:
            frame = observation.frame
            if frame is None or not _fits(frame.shape, self._frame_shape):
                shown = "none" if frame is None else f"one of {frame.shape}"
                raise ValueError(
                    f"the network needs a picture of {self._frame_shape}, not {shown}: see [camera]"
                )
            given[FRAME] = frame[None]
        acceleration, turn_rate = self._session.run([ACTION], given)[0][0]
        return float(acceleration), float(turn_rate)


def _bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise WeightsError(f"{path} has more than {LARGEST_BYTES >> 20} MiB; give a smaller network")
        return path.read_bytes()
    except OSError as error:
        raise WeightsError(f"{path} cannot be read: {error.strerror or error}") from error


def _is(one: Any, kind: str, shape: Sequence[int | None]) -> bool:
    return one.type == kind and len(one.shape) == len(shape) and _fits(shape, one.shape)


def _fits(shape: Sequence[int | None], declared: Sequence[Any]) -> bool:
    """Whether sizes agree; a size that the file names or leaves open is any."""
    return all(a is None or not isinstance(b, int) or a == b for a, b in zip(shape, declared, strict=True))


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
