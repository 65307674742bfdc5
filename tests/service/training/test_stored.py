"""What an interrupted training keeps: the same bits come back, and nothing but the named types."""

from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="pip install 'tailroad[train]' to test the training")

from policies import layout as O  # noqa: E402
from service.errors import InputError  # noqa: E402
from service.training import ego_lidar, stored  # noqa: E402
from service.training.network import DriverNet  # noqa: E402
from service.training.run import Stages  # noqa: E402


@dataclass(frozen=True)
class Kept:
    """Some of everything that the trainings keep."""

    arrays: list[np.ndarray]
    tensors: dict[str, torch.Tensor]
    numbers: dict[float, float]
    free: dict[str, Any]


def test_the_same_bits_come_back(tmp_path):
    rng = np.random.default_rng(1)
    table = rng.standard_normal((4, 3))
    arrays = [
        table,
        np.asfortranarray(table),
        table[:, ::2],
        table > 0.0,
        np.array(2, np.int64),
        np.zeros((0, 5)),
    ]
    kept = Kept(
        arrays,
        {"weights": torch.rand(2, 3), "step": torch.tensor(7.0), "drawn": torch.get_rng_state()},
        {0.01: -1e300, 0.1 + 0.2: float("inf")},
        {
            "state": {0: {"step": torch.tensor(3.0)}},
            "lr": 0.1,
            "count": 3,
            "value": np.float64(0.1),
            "nothing": None,
        },
    )
    stored.save(tmp_path / "one.stage", kept)
    found = stored.load(tmp_path / "one.stage", Kept)
    for a, b in zip(found.arrays, arrays, strict=True):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
        assert a.flags.f_contiguous == b.flags.f_contiguous or not b.flags.contiguous
        assert a.flags.writeable
    for name, tensor in kept.tensors.items():
        assert found.tensors[name].dtype == tensor.dtype
        assert torch.equal(found.tensors[name], tensor)
    assert found.numbers == kept.numbers
    assert found.free == kept.free


def test_a_network_comes_back(tmp_path):
    spread = np.random.default_rng(2).uniform(0.1, 3.0, O.OBSERVATION_SIZE)
    net = DriverNet(spread, 1.0 / spread)
    stored.save(tmp_path / "net.stage", (net, 1))
    found, _ = stored.load(tmp_path / "net.stage", tuple[DriverNet, int])
    for (name, a), (other, b) in zip(net.state_dict().items(), found.state_dict().items(), strict=True):
        assert name == other
        assert torch.equal(a, b)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x80\x05]",
        msgspec.msgpack.encode([1, 2, 3]),
        msgspec.msgpack.encode({"arrays": [1], "tensors": {}, "numbers": {}, "free": {}}),
        msgspec.msgpack.encode(
            {"arrays": [msgspec.msgpack.Ext(9, b"x")], "tensors": {}, "numbers": {}, "free": {}}
        ),
        msgspec.msgpack.encode(
            {"arrays": [msgspec.msgpack.Ext(1, msgspec.msgpack.encode(("|O", (1,), False, b"12345678")))],
             "tensors": {}, "numbers": {}, "free": {}}
        ),  # an array of Python objects
        msgspec.msgpack.encode(
            {"arrays": [msgspec.msgpack.Ext(1, msgspec.msgpack.encode(("<f8", (5,), False, b"12345678")))],
             "tensors": {}, "numbers": {}, "free": {}}
        ),  # five numbers in eight bytes
    ],
)  # fmt: skip
def test_anything_else_is_refused_with_what_to_do(tmp_path, data):
    path = tmp_path / "damaged.stage"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"damaged\.stage: .*delete the file and start the training again"):
        stored.load(path, Kept)


def test_what_cannot_be_kept_is_said_at_once(tmp_path):
    with pytest.raises(NotImplementedError, match="cannot keep a Generator"):
        stored.save(tmp_path / "one.stage", {"rng": np.random.default_rng(1)})
    assert not (tmp_path / "one.stage").exists()


def test_a_stage_is_made_once(tmp_path):
    stages = Stages(ego_lidar.Arguments(data=tmp_path, out=tmp_path))
    made = []

    def make() -> dict[str, int]:
        made.append(1)
        return {"a": 1}

    assert stages.get("one", dict[str, int], make) == stages.get("one", dict[str, int], make) == {"a": 1}
    assert len(made) == 1
    stages.clear()
    assert not list(tmp_path.iterdir())
