"""Reference drivers hit the counts of the public comparison of models for UN Regulation 157, and its closed form."""

import math

import pytest

from policies.references import REFERENCES, Other, Own, reference_driver
from policies.references.careful import CRITICAL_TTC_S, CarefulDriver
from policies.references.cut_in import collides, cut_ins
from policies.references.fsm import critical, proactive
from policies.references.paragraph import avoidable_s

# ec-jrc/JRC-FSM, commit 01b05c2, counted with its own program: collisions among cut-ins with a lateral speed
COUNTS = {
    (110, 70): (1020, {"r157-cc": 212, "r157-5.2.5.2": 125, "fsm": 54, "rss": 54}),
    (50, 20): (1003, {"r157-cc": 310, "r157-5.2.5.2": 188, "fsm": 82, "rss": 87}),
}


@pytest.mark.parametrize("speeds", COUNTS)
@pytest.mark.parametrize("name", ["r157-cc", "r157-5.2.5.2", "fsm", "rss"])
def test_collisions_over_the_public_grid_of_cut_ins(speeds: tuple[int, int], name: str) -> None:
    cases = list(cut_ins(*speeds))
    total, counts = COUNTS[speeds]
    assert len(cases) == total
    if name == "r157-cc":  # there it sees the other once it is in the way, and looks at near cut-ins alone
        driver, within_s = CarefulDriver(perceives_m=math.inf), CRITICAL_TTC_S
    else:
        driver, within_s = reference_driver(name), math.inf
    assert sum(collides(case, driver, within_s) for case in cases) == counts[name]


def test_perceiving_by_the_regulation_avoids_more_cut_ins_than_seeing_them_in_the_way() -> None:
    cases = list(cut_ins(110, 70))
    late = sum(collides(case, CarefulDriver(perceives_m=math.inf)) for case in cases)
    by_rule = sum(collides(case, CarefulDriver()) for case in cases)
    assisted = sum(collides(case, CarefulDriver(brake_assist=True)) for case in cases)
    assert assisted < by_rule < late


def test_the_table_of_the_regulation_follows_from_its_formula() -> None:
    table = {10: 0.48, 20: 0.71, 30: 0.94, 40: 1.18, 50: 1.41, 60: 1.64}
    for kmh, ttc_s in table.items():
        assert round(avoidable_s(kmh / 3.6, 6.0, 0.3 / 2.0 + 0.1), 2) == ttc_s


def in_front(gap_m: float, speed_mps: float) -> Other:
    return Other(True, gap_m, -1.0, speed_mps, 0.0, math.inf, 4.5)


def test_fuzzy_surrogates_by_hand() -> None:
    own = Own(20.0, 0.0)
    # safe 15 + 50 - 100/7*1/2... at 10 m/s ahead: 15 + 50 - 100/14 + 2; unsafe 15 + 400/12 - 100/14
    safe, unsafe = 15.0 + 50.0 - 100.0 / 14.0 + 2.0, 15.0 + 400.0 / 12.0 - 100.0 / 14.0
    assert proactive(own, in_front(safe + 2.0, 10.0)) == 0.0
    assert proactive(own, in_front(unsafe + 2.0, 10.0)) == 1.0
    assert proactive(own, in_front(0.5 * (safe + unsafe) + 2.0, 10.0)) == pytest.approx(0.5)
    # closing at 10 m/s: 7.5 m of delay, then 100/8 or 100/12
    assert critical(own, in_front(7.5 + 12.5, 10.0)) == 0.0
    assert critical(own, in_front(7.5 + 100.0 / 12.0, 10.0)) == 1.0
    assert critical(own, in_front(7.5 + 0.5 * (12.5 + 100.0 / 12.0), 10.0)) == pytest.approx(0.5)
    assert critical(Own(20.0, -10.0), in_front(0.1, 18.0)) == 1.0  # braking now, and still too close
    assert critical(own, in_front(0.1, 25.0)) == 0.0


def test_the_careful_driver_brakes_after_three_quarters_of_a_second_and_builds_up() -> None:
    driver = CarefulDriver()
    asked = [driver.act(Own(20.0, 0.0), [in_front(15.0, 10.0)], 0.1) for _ in range(16)]
    assert asked[:8] == [-0.4] * 8  # 0.75 s, in steps of 0.1 s
    assert asked[8] == pytest.approx(-0.4 - 1.265)
    assert asked[-1] == pytest.approx(-0.774 * 9.81)
    assert asked[8:] == sorted(asked[8:], reverse=True)


@pytest.mark.parametrize("name", REFERENCES)
def test_nobody_brakes_for_what_is_behind_or_far_away_and_a_reset_forgets(name: str) -> None:
    driver = reference_driver(name)
    behind = Other(False, 3.0, -1.0, 30.0, 0.0, math.inf, 4.5)
    assert driver.act(Own(20.0, 0.0), [behind, in_front(500.0, 20.0)], 0.1) == 0.0
    first = [driver.act(Own(20.0, 0.0), [in_front(12.0, 5.0)], 0.1) for _ in range(20)]
    assert min(first) < -5.0
    driver.reset()
    assert [driver.act(Own(20.0, 0.0), [in_front(12.0, 5.0)], 0.1) for _ in range(20)] == first


def test_an_unknown_reference_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="r157-cc"):
        reference_driver("r157")
