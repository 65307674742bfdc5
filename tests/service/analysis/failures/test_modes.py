from collections import Counter

import msgspec
import numpy as np
import pytest

from service.analysis.failures.kinds import kind_of
from service.analysis.failures.modes import modes_of
from service.analysis.failures.motion import Motion


def motion(**given: float) -> Motion:
    """What there was at the worst moment; 0 where nothing is said."""
    return Motion(**{f.name: 0 for f in msgspec.structs.fields(Motion)} | given)


PASS = motion(
    other=1, time_s=2.0, ahead_m=0.5, left_m=3.4, gap_along_m=-4.0, gap_across_m=1.6, closing_along_mps=6.0,
    ego_speed_mps=18.0, other_speed_mps=12.0, ray_deg=80.0, before_ahead_m=18.0, before_left_m=3.6,
    other_moved_left_m=-0.1, same_lane=False, same_lane_before=False, left_blocked=True, right_blocked=False,
)  # fmt: skip
REAR_END = msgspec.structs.replace(
    PASS,
    ahead_m=5.0,
    left_m=0.0,
    gap_along_m=0.5,
    gap_across_m=-1.8,
    before_ahead_m=20.0,
    before_left_m=0.0,
    same_lane=True,
    same_lane_before=True,
    left_blocked=False,
)
FAR_AWAY = msgspec.structs.replace(PASS, ahead_m=40.0, gap_along_m=35.5, left_m=7.2, gap_across_m=5.4)


def scattered(motion: Motion, n: int, seed: int, spread: float = 0.3) -> list[Motion]:
    rng = np.random.default_rng(seed)
    return [
        msgspec.structs.replace(
            motion,
            ahead_m=motion.ahead_m + spread * rng.normal(),
            closing_along_mps=motion.closing_along_mps + spread * rng.normal(),
            before_ahead_m=motion.before_ahead_m + spread * rng.normal(),
        )
        for _ in range(n)
    ]


def mixture() -> list[Motion]:
    mirrored = msgspec.structs.replace(PASS, left_m=-3.4, before_left_m=-3.6)
    return [*scattered(PASS, 40, 1), *scattered(REAR_END, 25, 2), *scattered(mirrored, 10, 3)]


def test_what_differs_falls_apart_and_what_is_alike_stays_together():
    assert modes_of(mixture()) == ["pass-left"] * 40 + ["rear-end"] * 25 + ["pass-right"] * 10


@pytest.mark.parametrize("seed", range(5))
def test_modes_do_not_depend_on_the_order_of_the_rollouts(seed):
    motions = [*mixture(), *scattered(FAR_AWAY, 4, 4), *scattered(FAR_AWAY, 3, 5, spread=30.0)]
    modes = modes_of(motions)
    shuffled = np.random.default_rng(seed).permutation(len(motions))
    assert modes_of([motions[i] for i in shuffled]) == [modes[i] for i in shuffled]


def test_a_borderline_rollout_falls_with_those_it_resembles():
    odd = msgspec.structs.replace(PASS, closing_across_mps=1.1, other_across_mps=-1.1)
    assert kind_of(odd) == "side-swipe-left"
    assert modes_of([*scattered(PASS, 40, 1), odd])[-1] == "pass-left"
    many = [*scattered(PASS, 40, 1), *scattered(odd, 10, 2)]
    assert Counter(modes_of(many)) == {"pass-left": 40, "side-swipe-left": 10}


def test_groups_without_a_name_are_told_apart():
    there = msgspec.structs.replace(FAR_AWAY, left_m=-7.2, before_left_m=-7.2, ahead_m=-40.0)
    modes = modes_of([*scattered(FAR_AWAY, 5, 1), *scattered(there, 5, 2)])
    assert len(set(modes[:5])) == len(set(modes[5:])) == 1
    assert set(modes) == {"other-1", "other-2"}


def test_one_rollout_and_none():
    assert modes_of([PASS]) == ["pass-left"]
    assert modes_of([]) == []
    assert modes_of([PASS, PASS]) == ["pass-left", "pass-left"]
