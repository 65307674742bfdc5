"""The training's device: what `--device` accepts, and that nothing of the world is left on another one.

There may be no GPU here: torch's fake tensors have a device and a shape and no values, and refuse to be mixed with
tensors of another device as real ones do.
"""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="pip install 'tailroad[train]' to test the training")
from torch._subclasses.fake_tensor import FakeTensorMode  # noqa: E402

from policies import layout as O  # noqa: E402
from service.errors import InputError  # noqa: E402
from service.training import gail, torch_world  # noqa: E402
from service.training.adversary import scenario_starts  # noqa: E402
from service.training.device import described, device_of  # noqa: E402
from service.training.drivers import Arguments  # noqa: E402
from service.training.network import DriverNet, exported, on_cpu  # noqa: E402
from service.training.run import Stages, command, public  # noqa: E402
from service.training.windows import Batch  # noqa: E402
from service.world.sim.road import i80_road  # noqa: E402

STEPS, ROLLOUTS = 1, 2


def test_a_gpu_that_is_not_there_is_an_error_that_says_so(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match=r"--device cuda: .* cannot use a GPU here"):
        device_of("cuda")
    assert device_of("auto") == device_of("cpu") == torch.device("cpu")
    assert described(device_of("auto")) == "cpu"


def test_auto_takes_a_gpu_where_torch_sees_one(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert device_of("auto") == device_of("cuda") == torch.device("cuda")
    assert device_of("cpu") == torch.device("cpu")


def test_other_devices_are_refused_with_those_there_are():
    with pytest.raises(InputError, match="--device tpu: expected one of auto, cpu, cuda"):
        device_of("tpu")


def test_a_rollout_and_its_losses_stay_on_the_device(monkeypatch):
    """Driving from the scenario's starts mixes no devices, nor do the losses of it."""
    monkeypatch.setattr(
        torch_world, "_nearest_station", lambda x, y, station, road: station
    )  # it looks at values
    road, gpu = i80_road(), torch.device("cuda")
    with FakeTensorMode(), torch.no_grad():
        state = scenario_starts(np.random.default_rng(1), road, ROLLOUTS, gpu)
        tables = torch_world.torch_road(road, device=gpu)
        with gpu:  # fake modules cannot be moved; they are made there
            net = DriverNet(np.zeros(O.OBSERVATION_SIZE), np.ones(O.OBSERVATION_SIZE))
            judge = gail.Discriminator(net.mean, net.scale)
        noise = torch.zeros(STEPS, *state.station.shape, 2, device=gpu)
        used = torch.ones(state.station.shape, device=gpu)
        driven = gail.drive(net, state, tables, noise, used)
        target = torch.zeros(STEPS + 1, *state.station.shape, 3, device=gpu)
        batch = Batch(state, tables, target, target, used)
        loss = (
            gail.reward_loss(judge, driven) + gail.trajectory_loss(driven, batch) + gail.safety_loss(driven)
        )
        assert loss.device.type == driven.seen.device.type == "cuda"


def test_what_is_handed_on_lies_on_the_cpu():
    net = DriverNet(np.zeros(O.OBSERVATION_SIZE), np.ones(O.OBSERVATION_SIZE))
    assert on_cpu(net) is net
    assert np.isfinite(exported(net, np.zeros((4, O.OBSERVATION_SIZE), np.float32)).head).all()


def test_the_device_is_no_part_of_what_a_card_repeats(tmp_path):
    here, there = (Arguments(tmp_path, tmp_path, device=name) for name in ("cpu", "cuda"))
    assert public(here) == public(there)
    assert command("m", here) == command("m", there) == "tailroad train m --data DIR --out DIR --seed 1"
    assert Stages(here).path("gail", ".checkpoint") != Stages(there).path("gail", ".checkpoint")


def test_a_run_that_goes_on_draws_what_it_would_have_drawn(tmp_path):
    """A network that a stage initialises is the same whether the stages before it were run or read."""
    arguments = Arguments(tmp_path, tmp_path)

    def two_stages() -> tuple[torch.Tensor, torch.Tensor]:
        torch.manual_seed(5)
        stages = Stages(arguments)
        return stages.get("first", torch.Tensor, lambda: torch.rand(3)), torch.rand(3)

    whole, resumed = two_stages(), two_stages()
    assert torch.equal(whole[0], resumed[0])
    assert torch.equal(whole[1], resumed[1])
