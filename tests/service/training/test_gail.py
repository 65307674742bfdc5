"""Adversarial training on made-up scenes: windows, rewards, and a training that learns and resumes."""

import numpy as np
import pytest
import torch

from policies import layout as O
from policies.data.scenes import Scene, straight_lanes
from service.training import gail
from service.training.adversary import GailSettings, Sampled, train_adversarially
from service.training.demonstrations import recorded_rows
from service.training.ensemble import FLOOR_SD
from service.training.graphical_lasso import cross_validated, graphical_lasso
from service.training.head_spread import lasso_spread
from service.training.network import DriverNet, input_statistics
from service.training.windows import DRIVEN, Windows
from service.world.sim.road import i80_road

FRAMES, VEHICLES, SPEED = 60, 8, 12.0


def made_up_scene() -> Scene:
    """Eight vehicles on four lanes, 12 m/s straight ahead for 6 s."""
    road = straight_lanes("straight", 400.0, 4, 3.6)
    lane = np.arange(VEHICLES) % 4
    time = 0.1 * np.arange(FRAMES)[:, None]
    station = 20.0 + 30.0 * (np.arange(VEHICLES) // 4) + 5.0 * lane + SPEED * time
    lateral = np.broadcast_to((1.5 - lane) * 3.6, station.shape).copy()
    zero = np.zeros_like(station)
    usable = np.ones(station.shape, dtype=bool)
    usable[-1] = False
    return Scene(
        "i80", 0.1, road, np.arange(FRAMES), np.arange(VEHICLES), np.full(VEHICLES, 4.5), np.full(VEHICLES, 1.8),
        station, lateral, zero, zero + SPEED, zero, zero, station, lateral,
        np.broadcast_to(lane, station.shape).copy(), np.zeros(station.shape, np.uint8), usable, VEHICLES,
    )  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """Tiny tensors: a second thread only waits."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return made_up_scene()


@pytest.fixture(scope="module")
def rows(scene) -> Sampled:
    found = recorded_rows(scene)
    return Sampled(
        found.seen, found.action.astype(float), np.full((len(found), 2), [0.2, 0.01]),
        np.full(len(found), 1 / len(found)),
    )  # fmt: skip


def network(rows: Sampled, seed: int = 1) -> DriverNet:
    torch.manual_seed(seed)
    return DriverNet(*input_statistics(rows.seen))


def as_recorded(seen: torch.Tensor) -> torch.Tensor:
    """A policy that does what the made-up drivers do: nothing, with hardly any noise."""
    return torch.cat([torch.zeros(*seen.shape[:-1], 2), torch.full((*seen.shape[:-1], 2), -9.0)], dim=-1)


def window(scene: Scene, steps: int = 20):
    windows = Windows([scene])
    starts = windows.starts(steps)
    return windows.batch(starts[:: len(starts) // 5][:5], steps)


def test_windows_fit_into_the_recording(scene):
    starts = Windows([scene]).starts(20)
    assert starts[:, 1].max() == FRAMES - 21
    batch = window(scene)
    assert batch.used.sum(dim=1).tolist() == [DRIVEN] * 5
    there = ~torch.isnan(batch.replay[0, :, :, 0])
    assert there.sum(dim=1).tolist() == [VEHICLES - DRIVEN] * 5
    assert torch.allclose(batch.target[20, ..., 0] - batch.target[0, ..., 0], torch.tensor(2.0 * SPEED))


def test_the_recorded_policy_stays_on_its_trajectory(scene):
    batch = window(scene)
    noise = torch.zeros(20, 5, DRIVEN, 2)
    driven = gail.drive(as_recorded, batch.state, batch.road, noise, batch.used, batch.replay)
    assert driven.alive.min() == 1.0
    assert gail.trajectory_loss(driven, batch) < 1e-6
    assert gail.safety_loss(driven) == 0.0


def test_losses_tell_where_to_go(scene, rows):
    """A constant acceleration and turn rate: their gradients point back to the recorded motion."""
    batch = window(scene)
    action = torch.tensor([0.5, 0.1], requires_grad=True)

    def policy(seen: torch.Tensor) -> torch.Tensor:
        outputs = as_recorded(seen)
        return torch.cat([outputs[..., :2] + action, outputs[..., 2:]], dim=-1)

    driven = gail.drive(
        policy, batch.state, batch.road, torch.zeros(15, 5, DRIVEN, 2), batch.used, batch.replay
    )
    (gradient,) = torch.autograd.grad(gail.trajectory_loss(driven, batch), action)
    assert gradient[0] > 0.0
    assert gradient[1] > 0.0


def test_vehicles_after_an_incident_no_longer_count(scene):
    batch = window(scene)

    def swerve(seen: torch.Tensor) -> torch.Tensor:
        return as_recorded(seen) + torch.tensor([0.0, 6.0, 0.0, 0.0])

    driven = gail.drive(swerve, batch.state, batch.road, torch.zeros(40, 5, DRIVEN, 2), batch.used, None)
    assert driven.alive[0].min() == 1.0
    assert driven.alive[-1].max() == 0.0
    assert gail.safety_loss(driven) > 0.0


def test_the_discriminator_learns_and_rewards_the_recorded(scene, rows):
    net = network(rows)
    torch.manual_seed(0)
    discriminator = gail.Discriminator(net.mean, net.scale)
    steps = torch.optim.Adam(discriminator.parameters(), lr=3e-3)
    batch = window(scene)
    draws, rng = torch.Generator().manual_seed(2), np.random.default_rng(2)

    def braking(seen: torch.Tensor) -> torch.Tensor:
        return as_recorded(seen) - torch.tensor([1.5, 0.0, 0.0, 0.0])

    noise = torch.zeros(10, 5, DRIVEN, 2)
    wrong = gail.drive(braking, batch.state, batch.road, noise, batch.used, batch.replay)
    right = gail.drive(as_recorded, batch.state, batch.road, noise, batch.used, batch.replay)
    for _ in range(60):
        seen, action = rows.draw(128, rng)
        loss, told_recorded, told_own = gail.discriminator_loss(
            discriminator, wrong, seen, action, 128, draws
        )
        steps.zero_grad()
        loss.backward()
        steps.step()
    assert min(told_recorded, told_own) > 0.9
    assert gail.reward_loss(discriminator, right) < gail.reward_loss(discriminator, wrong)


SMALL = GailSettings(horizons=(3, 6), updates=10, windows=2, road_starts=2, rows=64, warm_up=2, rate=1e-3)


def test_training_approaches_the_recorded_trajectories(scene, rows):
    net = network(rows)
    curve = train_adversarially(net, [Windows([scene])], rows, rows, i80_road(), SMALL, seed=3)
    assert [record["steps"] for record in curve] == [3] * 12 + [6] * 10
    early, late = (np.mean([r["likelihood"] for r in part]) for part in (curve[2:7], curve[-5:]))
    assert late < early
    assert not net.first.weight[:, O.INCIDENT].any()


def test_an_interrupted_training_ends_with_the_same_weights(scene, rows, tmp_path):
    settings = GailSettings(horizons=(4,), updates=4, windows=2, road_starts=2, rows=32, warm_up=1)
    sites = [Windows([scene])]
    whole = network(rows)
    train_adversarially(whole, sites, rows, rows, i80_road(), settings, seed=4)

    class Stopped(Exception):
        pass

    def stop(record: dict) -> None:
        if record["update"] == 3:
            raise Stopped

    checkpoint = tmp_path / "gail.checkpoint"
    with pytest.raises(Stopped):
        train_adversarially(
            network(rows),
            sites,
            rows,
            rows,
            i80_road(),
            settings,
            seed=4,
            checkpoint=checkpoint,
            checkpoint_every=2,
            tick=stop,
        )
    assert checkpoint.is_file()
    resumed = network(rows, seed=9)
    curve = train_adversarially(
        resumed, sites, rows, rows, i80_road(), settings, seed=4, checkpoint=checkpoint
    )
    assert len(curve) == 5
    for a, b in zip(whole.parameters(), resumed.parameters(), strict=True):
        assert torch.equal(a, b)


def test_graphical_lasso_finds_the_known_optimum_of_a_small_problem():
    """Against cvxpy's interior point solution."""
    cp = pytest.importorskip("cvxpy")
    z = np.random.default_rng(5).normal(size=(12, 6)) @ np.diag([1, 1, 1, 1, 2, 2.0])
    sample, penalty = z.T @ z / 12, 0.2
    precision = cp.Variable((6, 6), PSD=True)
    off = np.ones((6, 6)) - np.eye(6)
    cost = cp.trace(sample @ precision) - cp.log_det(precision)
    cp.Problem(cp.Minimize(cost + penalty * cp.sum(cp.multiply(off, cp.abs(precision))))).solve(
        solver="SCS", eps=1e-7
    )
    found = graphical_lasso(sample, penalty, tolerance=1e-6)
    assert found.converged
    assert np.allclose(found.precision, precision.value, atol=5e-3)


def test_graphical_lasso_with_fewer_members_than_weights_is_positive_definite():
    rng = np.random.default_rng(6)
    factor = rng.normal(size=(60, 3))
    z = rng.normal(size=(20, 3)) @ factor.T + rng.normal(size=(20, 60))
    scores = cross_validated(z, (0.3, 5.0), folds=4)
    assert max(scores, key=lambda p: scores[p]) != 5.0  # the common factors are found
    found = graphical_lasso(np.cov(z.T), 0.3)
    assert np.linalg.eigvalsh(found.covariance)[0] > 0.0


def test_the_lasso_of_members_is_positive_definite_and_keeps_their_spread():
    """Members of 40 weights, ten of which never vary; correlated by two factors."""
    rng = np.random.default_rng(7)
    members = np.zeros((20, 40))
    members[:, :30] = 0.05 * (rng.normal(size=(20, 2)) @ rng.normal(size=(2, 30)) + rng.normal(size=(20, 30)))
    members += rng.normal(size=40)
    found = lasso_spread(members, np.eye(40))
    covariance = found.distribution.covariance
    assert np.allclose(found.distribution.mean, members.mean(axis=0))
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    assert np.allclose(np.diag(covariance), members.var(axis=0, ddof=1) + FLOOR_SD**2, rtol=0.02)
    assert all(np.isfinite(score) for score in found.scores.values())
    assert found.report["converged"]
