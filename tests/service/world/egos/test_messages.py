"""Messages of the ego protocol: what the world knows goes out to the bit, and what comes back is checked."""

from __future__ import annotations

import math
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from policies import layout
from policies.egos import Observation
from service.errors import EgoError
from service.world import agents as A
from service.world.egos import ego_pb2 as pb
from service.world.egos import messages

ROOT = Path(__file__).parents[4]
doubles = st.floats(allow_nan=False, width=64)


def test_the_code_made_from_the_schema_is_up_to_date(tmp_path):
    command = [
        sys.executable,
        "-m",
        "grpc_tools.protoc",
        "-I.",
        f"--python_out={tmp_path}",
        f"--pyi_out={tmp_path}",
    ]
    subprocess.run([*command, "service/world/egos/ego.proto"], cwd=ROOT, check=True)
    for name in ("ego_pb2.py", "ego_pb2.pyi"):
        made = (tmp_path / "service/world/egos" / name).read_text(encoding="utf-8")
        assert (ROOT / "service/world/egos" / name).read_text(encoding="utf-8") == made, "run `make schema`"


@settings(max_examples=50, deadline=None)
@given(st.lists(doubles, min_size=layout.OBSERVATION_SIZE, max_size=layout.OBSERVATION_SIZE))
def test_an_observation_comes_out_as_it_went_in_to_the_bit(values):
    vector = np.array(values)
    flags = [layout.LANE_TO_THE_LEFT, layout.LANE_TO_THE_RIGHT, layout.INCIDENT]
    vector[flags] = [1.0, 0.0, 1.0]
    row = np.arange(A.COLUMNS, dtype=np.float64)
    sent = messages.observation_of("w", "r", 7, Observation(vector, 0.7, row), 1.0).SerializeToString()
    seen = pb.Observation.FromString(sent)
    assert messages.vector_of(seen).tobytes() == vector.tobytes()
    assert (seen.worker, seen.rollout, seen.step, seen.time_s) == ("w", "r", 7, 0.7)
    assert (seen.ego.x_m, seen.ego.lane, seen.ego.station_m) == (
        row[A.X_M],
        row[A.LANE] + 1,
        row[A.STATION] + row[A.ALONG_M],
    )


def test_a_picture_comes_out_as_it_went_in():
    frame = np.random.default_rng(0).integers(0, 256, (66, 200, 3), dtype=np.uint8)
    frame[:] = np.sort(frame, axis=1)  # smooth enough for JPEG
    raw = pb.Picture.FromString(messages.picture_of(frame, pb.CAMERA_RAW).SerializeToString())
    assert np.array_equal(messages.frame_of(raw), frame)
    packed = messages.picture_of(frame, pb.CAMERA_JPEG)
    assert len(packed.data) < frame.size / 2
    assert np.abs(messages.frame_of(packed).astype(int) - frame).mean() < 6.0
    for wrong in (
        pb.Picture(encoding="CAMERA_RAW", width=9, height=9, data=b"x"),
        pb.Picture(encoding="CAMERA_JPEG", width=2, height=2, data=b"x"),
        pb.Picture(encoding="CAMERA_JPEG"),
    ):
        with pytest.raises(EgoError):
            messages.frame_of(wrong)


def action(**control) -> pb.Action:
    return pb.Action(rollout="r", step=3, **control)


def answered(message: pb.Action, speed: float = 10.0) -> tuple[float, float]:
    return messages.action_of(message, "r", 3, speed, 4.5)


def test_a_motion_is_taken_as_it_is():
    assert answered(action(motion=pb.Motion(acceleration_mps2=-1.5, turn_rate_radps=0.1))) == (-1.5, 0.1)


def test_pedals_become_a_motion_by_the_bicycle_model():
    acceleration, turn_rate = answered(action(pedals=pb.Pedals(steering_rad=0.1, throttle=0.5)))
    assert acceleration == 0.5 * layout.MAX_ACCELERATION_MPS2
    assert turn_rate == pytest.approx(10.0 * math.tan(0.1) / 2.7, rel=1e-12)
    assert answered(action(pedals=pb.Pedals(throttle=-1.0))) == (-layout.MAX_DECELERATION_MPS2, 0.0)


WRONG = {
    "of another rollout": (
        pb.Action(rollout="s", step=3, motion=pb.Motion()),
        "for step 3 of rollout 's', not step 3 of 'r'",
    ),
    "of another step": (pb.Action(rollout="r", step=2, motion=pb.Motion()), "for step 2 of rollout 'r'"),
    "nan": (action(motion=pb.Motion(acceleration_mps2=math.nan)), "acceleration_mps2 is nan"),
    "infinite": (action(motion=pb.Motion(turn_rate_radps=-math.inf)), "turn_rate_radps is -inf"),
    "far too much": (action(motion=pb.Motion(acceleration_mps2=60.0)), "is 60, beyond 50"),
    "full circle": (action(pedals=pb.Pedals(steering_rad=3.0)), "steering_rad is 3, beyond 1.2"),
    "overthrottle": (action(pedals=pb.Pedals(throttle=1.1)), "throttle is 1.1, beyond 1"),
    "nothing": (action(), "neither motion nor pedals"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_action_is_refused_with_what_is_wrong(case):
    message, told = WRONG[case]
    with pytest.raises(EgoError, match=told):
        answered(message)


def test_a_reply_has_to_be_of_the_kind_that_is_due():
    ready = pb.Reply(ready=pb.Ready(rollout="r")).SerializeToString()
    assert messages.reply_of(ready, "ready").ready.rollout == "r"
    for payload, told in (
        (ready, "the answer is ready where action was due"),
        (b"", "the answer is empty"),
        (b"\xff" * 40, "is not a Reply"),
        (b"\x00" * (messages.MAX_REPLY_BYTES + 1), "has 65537 bytes; at most 65536"),
        (
            pb.Reply(refusal=pb.Refusal(reason="no\x00 cam\nera" * 200)).SerializeToString(),
            r"refused: no\? cam\?era",
        ),
    ):
        with pytest.raises(EgoError, match=told) as caught:
            messages.reply_of(payload, "action")
        assert len(str(caught.value)) < 700
        assert "\n" not in str(caught.value)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_an_action_or_an_ego_error(payload):
    try:
        reply = messages.reply_of(payload, "action")
        acceleration, turn_rate = messages.action_of(reply.action, "", 0, 10.0, 4.5)
    except EgoError:
        return
    assert math.isfinite(acceleration)
    assert math.isfinite(turn_rate)


def test_damaged_replies_are_an_action_or_an_ego_error():
    good = pb.Reply(
        action=action(motion=pb.Motion(acceleration_mps2=1.0, turn_rate_radps=0.1))
    ).SerializeToString()
    generator = np.random.default_rng(1)
    for _ in range(2000):
        damaged = bytearray(good)
        for at in generator.integers(0, len(good), 2):
            damaged[at] = generator.integers(256)
        try:
            answered(messages.reply_of(bytes(damaged), "action").action)
        except EgoError:
            continue
    assert struct.unpack("<d", good[-8:])[0] == 0.1
