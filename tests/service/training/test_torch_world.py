"""The differentiable world against the compiled one, and its gradients against finite differences."""

import numpy as np
import pytest
import torch

from policies import layout as O
from service.training.aggregation import winding_road
from service.training.torch_world import State, advance, observe, state_of, torch_road
from service.training.world import BEAM_TABLE, standard_starts
from service.world import agents as A
from service.world.sim import step
from service.world.sim.dynamics import advance as advance_one
from service.world.sim.road import i80_road

VEHICLES = 6


def starts(road, rollouts: int, wide: bool, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.stack([standard_starts(rng, road, VEHICLES, wide) for _ in range(rollouts)])


def tensors(agents: np.ndarray, controlled: int = VEHICLES) -> State:
    """The batch's vehicles (B, N, columns) as a State in double precision."""
    columns = (A.X_M, A.Y_M, A.HEADING_RAD, A.SPEED_MPS, A.LENGTH_M, A.WIDTH_M)
    station = agents[:, :controlled, A.STATION].astype(np.int64)
    return state_of(agents[..., columns], agents[..., A.ACTIVE] > 0, station, torch.float64)


def seen_by_kernels(agents: np.ndarray, road) -> np.ndarray:
    seen = np.zeros((len(agents), VEHICLES, O.OBSERVATION_SIZE))
    for one, out in zip(agents, seen, strict=True):
        step.observe(
            one, VEHICLES, one.shape[0], -1, road.reference, road.lanes, road.spacing_m, BEAM_TABLE,
            BEAM_TABLE, out,
        )  # fmt: skip
    return seen


@pytest.mark.parametrize("name", ["i80", "winding"])
@pytest.mark.parametrize("wide", [False, True])
def test_both_worlds_see_and_move_the_same(name, wide):
    road = i80_road() if name == "i80" else winding_road(np.random.default_rng(1))
    agents = starts(road, 12, wide)
    state, tables = tensors(agents), torch_road(road, torch.float64)
    rng = np.random.default_rng(4)
    for _ in range(40):
        action = rng.normal(0.0, [2.5, 0.02], (len(agents), VEHICLES, 2))
        expected = seen_by_kernels(agents, road)
        seen, place, hit = observe(state, tables)
        assert np.allclose(seen.numpy(), expected, rtol=0.0, atol=1e-8)
        assert np.array_equal(hit.numpy(), agents[..., A.COLLISION] > 0)
        assert np.array_equal(place.off_road.numpy(), agents[..., A.OFF_ROAD] > 0)
        state = advance(state, place, torch.as_tensor(action))
        for one, moves in zip(agents, action, strict=True):
            for agent, (a, w) in zip(one, moves, strict=True):
                advance_one(agent, a, w, 0.1, False)
        assert np.allclose(state.x.numpy(), agents[..., A.X_M], atol=1e-9)
        assert np.allclose(state.y.numpy(), agents[..., A.Y_M], atol=1e-9)


def test_lanes_beside_are_told_apart_and_the_reserved_one_does_not_invite():
    road = i80_road()
    agents = starts(road, 1, wide=False)
    seen, _, _ = observe(tensors(agents), torch_road(road, torch.float64))
    beside = seen[0, :, O.LANE_TO_THE_LEFT : O.LANE_TO_THE_RIGHT + 1].tolist()
    assert beside == [[0, 1], [0, 1], [1, 1], [1, 1], [1, 1], [1, 0]]


def test_replayed_vehicles_follow_their_recording():
    road = i80_road()
    agents = starts(road, 2, wide=False)
    state, tables = tensors(agents, controlled=4), torch_road(road, torch.float64)
    others = torch.full((2, 2, 4), float("nan"), dtype=torch.float64)
    others[0, 1] = torch.tensor([1.0, 2.0, 0.3, 4.0])
    _, place, _ = observe(state, tables)
    moved = advance(state, place, torch.zeros(2, 4, 2, dtype=torch.float64), others)
    assert moved.present[:, 4:].tolist() == [[False, True], [False, False]]
    now = torch.stack([moved.x, moved.y, moved.heading, moved.speed], dim=-1)
    assert torch.equal(now[0, 5], others[0, 1])
    assert moved.present[:, :4].all()


def test_gradients_agree_with_finite_differences():
    """Of a smooth function of everything observed over eight steps, with respect to all actions."""
    road = i80_road()
    state, tables = tensors(starts(road, 2, wide=False)), torch_road(road, torch.float64)
    rng = np.random.default_rng(5)
    weight = torch.as_tensor(rng.normal(size=(8, 2, VEHICLES, O.OBSERVATION_SIZE)))
    weight[..., O.LANE_TO_THE_LEFT : O.INCIDENT + 1] = 0.0

    def value(actions: torch.Tensor) -> torch.Tensor:
        now, total = state, torch.zeros((), dtype=torch.float64)
        for t in range(8):
            seen, place, _ = observe(now, tables)
            total = total + (weight[t] * seen).sum()
            now = advance(now, place, actions[t])
        return total

    actions = torch.as_tensor(rng.normal(0.0, [0.5, 0.01], (8, 2, VEHICLES, 2))).requires_grad_()
    (gradient,) = torch.autograd.grad(value(actions), actions)
    assert torch.isfinite(gradient).all()
    for t, b, v, i in [(0, 0, 0, 0), (0, 1, 3, 1), (2, 0, 2, 1), (4, 1, 5, 0), (6, 0, 1, 0), (6, 1, 1, 1)]:
        h = 1e-6
        moved = torch.zeros_like(actions)
        moved[t, b, v, i] = h
        difference = (value(actions.detach() + moved) - value(actions.detach() - moved)) / (2.0 * h)
        assert gradient[t, b, v, i].item() == pytest.approx(difference.item(), rel=1e-4, abs=1e-5)
