"""The list of a job's rollouts: what fits, in order, a page of it; and any of them drawn again."""

from __future__ import annotations

import numpy as np

from service.evaluation.listing import Wanted, listing_of
from service.evaluation.pool import OUTCOME_CODES
from service.evaluation.store.chunk import FAILED, Chunk


def chunk(start: int, f: list[float], outcomes: list[str]) -> Chunk:
    codes = np.array([OUTCOME_CODES[name] for name in outcomes], np.uint8)
    return Chunk(start, start + len(f), np.array(f), codes, np.zeros(0, np.int32), {}, 1.0)


CHUNKS = [
    ("estimate", 0, chunk(0, [0.5, np.nan, -1.0], ["horizon", "error", "collision"])),
    ("train", 0, chunk(0, [0.1], ["collision"])),
    ("train", 1, chunk(4, [np.inf, 0.4], ["finished", "off-road"])),
]


def test_rollouts_are_listed_by_f_with_the_failed_ones_last_either_way():
    up, down = listing_of(CHUNKS, Wanted(), "f"), listing_of(CHUNKS, Wanted(), "-f")
    np.testing.assert_array_equal(up.f, [-1.0, 0.1, 0.4, 0.5, np.inf, np.nan])
    np.testing.assert_array_equal(down.f, [np.inf, 0.5, 0.4, 0.1, -1.0, np.nan])
    assert (up.total, up.found) == (6, 6)
    assert list(zip(up.phases, up.iterations.tolist(), up.rows.tolist(), strict=True))[:3] == [
        ("estimate", 0, 2),
        ("train", 0, 0),
        ("train", 1, 5),
    ]


def test_only_those_that_fit_are_listed_and_pages_follow_each_other():
    hit = listing_of(CHUNKS, Wanted(outcome="collision"), "f")
    assert (hit.found, hit.phases, hit.outcomes) == (2, ("estimate", "train"), ("collision", "collision"))
    assert listing_of(CHUNKS, Wanted(phase="train", high=0.3)).rows.tolist() == [0]
    assert listing_of(CHUNKS, Wanted(outcome="error")).found == 1
    assert OUTCOME_CODES["error"] == FAILED
    pages = [listing_of(CHUNKS, Wanted(low=0.0), "f", offset, 2).f.tolist() for offset in (0, 2, 4)]
    assert pages == [[0.1, 0.4], [0.5, np.inf], []]
    assert listing_of([], Wanted(phase="train")).found == 0
