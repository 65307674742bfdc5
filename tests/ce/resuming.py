"""An algorithm run twice side by side, the second time read back from its bytes before every batch."""

from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np

import ce


def resumed_at_every_step(
    algorithm: Any, f: Callable[[np.ndarray], np.ndarray], seed: int
) -> Iterator[tuple[ce.Batch, Any]]:
    """Each batch with the state that it led to; fails where the two runs differ in a bit."""
    straight = resumed = algorithm.init(seed)
    while (batch := algorithm.propose(straight)) is not None:
        straight, record = algorithm.update(straight, batch, f(batch.x))
        resumed = algorithm.from_bytes(algorithm.to_bytes(resumed))
        again = algorithm.propose(resumed)
        np.testing.assert_array_equal(again.x, batch.x)
        np.testing.assert_array_equal(again.noise, batch.noise)
        resumed, record_again = algorithm.update(resumed, again, f(again.x))
        assert msgspec.json.encode(record) == msgspec.json.encode(record_again)
        yield batch, straight
    assert ce.to_bytes(straight) == ce.to_bytes(resumed)
