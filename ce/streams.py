"""Counter-based random streams: row i of a batch is the same whoever draws it, alone or with others.

Philox 4x64 (Salmon et al., SC 2011) keyed by (seed, kind) with counter (0, chunk, iteration, phase), where
a chunk is 1,000 consecutive rows. The lowest counter word runs, so every chunk has 2^66 words of its own.

Draws use numpy's `Generator.beta` and `standard_normal`, whose algorithms numpy may change between feature
releases; tests pin the first values, so that such a change is noticed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ce.errors import OptionsError
from ce.product import Product

# Rows of a chunk.
CHUNK = 1000
# Numbers of a chunk that a Stream keeps.
MOST_KEPT = 2_000_000
PHASES = {"train": 0, "estimate": 1}
# Any two fixed words: second half of the key.
_X_KIND, _NOISE_KIND = 0x7461696C, 0x726F6164


def checked_seed(seed: int) -> int:
    """seed as an int in [0, 2^64), or OptionsError."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= int(seed) < 2**64:
        raise OptionsError(f"seed must be an integer from 0 to 2**64 - 1, not {seed!r}")
    return int(seed)


def generator(seed: int, kind: int, phase: str, iteration: int, chunk: int) -> np.random.Generator:
    """The random numbers of one chunk of a stream, kept apart from streams of other use by the word `kind`."""
    counter = np.array([0, chunk, iteration, PHASES[phase]], dtype=np.uint64)
    key = np.array([seed, kind], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(counter=counter, key=key))


class Stream:
    """The rows of a batch for one who asks for a few at a time: those of `draw`, to the bit.

    It keeps the last chunk's numbers before they are correlated, which cost as much as correlating some 200 rows.

    proposal: that x is drawn from
    seed: 0 <= seed < 2^64
    phase: "train" or "estimate"
    iteration: number of the batch stream within the phase

    >>> import ce
    >>> stream = ce.Stream(ce.Product([ce.Uniform(0.0, 1.0)]), seed=1, phase="estimate", iteration=0)
    >>> x, noise = stream.draw(10, 14)
    >>> x.shape, noise.shape
    ((4, 1), (4,))
    """

    def __init__(self, proposal: Product, seed: int, phase: str, iteration: int) -> None:
        if phase not in PHASES:
            raise OptionsError(f"phase must be one of {', '.join(PHASES)}, not {phase!r}")
        self._proposal = proposal
        self._key = (checked_seed(seed), phase, iteration)
        self._last: tuple[int, _Chunk] | None = None

    def draw(
        self, start: int, stop: int, correlated: bool = True
    ) -> tuple[NDArray[np.float64], NDArray[np.uint64]]:
        """Rows [start, stop): x (n, d), and a noise seed (n,) for each.

        correlated: False leaves every Normal at its mean, which spares the costliest part where the rest decides
            whether a row is wanted at all
        """
        if not 0 <= start <= stop:
            raise OptionsError(f"rows must satisfy 0 <= start <= stop, not [{start}, {stop})")
        x = np.empty((stop - start, self._proposal.dim))
        for chunk in range(start // CHUNK, -(-stop // CHUNK)):
            first = chunk * CHUNK
            begin, end = max(start - first, 0), min(stop - first, CHUNK)
            into = slice(first + begin - start, first + end - start)
            self._fill(x, into, chunk, np.arange(begin, end), correlated)
        return x, noise_seeds(*self._key, start, stop)

    def rows(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """x (k, d) of rows (k,) that rise, wherever in the batch."""
        x = np.empty((rows.size, self._proposal.dim))
        chunk = rows // CHUNK
        for one in np.unique(chunk).tolist():
            first, after = np.searchsorted(chunk, [one, one + 1]).tolist()
            self._fill(x, slice(first, after), one, rows[first:after] - one * CHUNK, True)
        return x

    def _fill(
        self, x: NDArray[np.float64], into: slice, chunk: int, rows: NDArray[np.int64], correlated: bool
    ) -> None:
        """Write these rows of a chunk into these of x."""
        proposal, drawn = self._proposal, self._chunk(chunk)
        if proposal.beta_columns.size:
            x[into, proposal.beta_columns] = drawn.betas[rows]
        for (at, block), z in zip(proposal.normals, drawn.normals, strict=True):
            x[into, at : at + block.dim] = block.mean + (block.correlator(z[rows]) if correlated else 0.0)
        for (at, marginal), z in zip(proposal.marginals, drawn.marginals, strict=True):
            x[into, at] = marginal.from_standard(marginal.shift + z[rows])

    def _chunk(self, chunk: int) -> "_Chunk":
        if self._last is not None and self._last[0] == chunk:
            return self._last[1]
        proposal, (seed, phase, iteration) = self._proposal, self._key
        source = generator(seed, _X_KIND, phase, iteration, chunk)
        drawn = _Chunk(
            proposal.betas.sample(source, CHUNK) if proposal.beta_columns.size else np.empty((CHUNK, 0)),
            [source.standard_normal((CHUNK, block.dim)) for _, block in proposal.normals],
            [source.standard_normal(CHUNK) for _ in proposal.marginals],
        )
        self._last = (chunk, drawn) if CHUNK * proposal.dim <= MOST_KEPT else None
        return drawn


@dataclass(frozen=True)
class _Chunk:
    """A chunk's numbers before they are correlated.

    betas: (CHUNK, m), of the Betas
    normals: (CHUNK, d), standard normals of each Normal
    marginals: (CHUNK,), standard normals of each other marginal
    """

    betas: NDArray[np.float64]
    normals: list[NDArray[np.float64]]
    marginals: list[NDArray[np.float64]]


def draw(
    proposal: Product, seed: int, phase: str, iteration: int, start: int, stop: int
) -> tuple[NDArray[np.float64], NDArray[np.uint64]]:
    """Rows [start, stop) of a batch: x (n, d) from the proposal and a noise seed (n,) for each rollout.

    Within a chunk all Betas are drawn first, then each Normal's standard normals, then those of each other marginal.
    The whole chunk's numbers are drawn, but only the rows asked for are correlated.

    proposal: that x is drawn from
    seed: 0 <= seed < 2^64
    phase: "train" or "estimate"
    iteration: number of the batch stream within the phase
    start: first row
    stop: the row after the last

    >>> import ce
    >>> base = ce.Product([ce.Uniform(0.0, 1.0)])
    >>> x, noise = ce.draw(base, 1, "estimate", 0, 0, 1000)
    >>> again, _ = ce.draw(base, 1, "estimate", 0, 990, 1000)
    >>> x.shape, noise.dtype, bool((again == x[990:]).all())
    ((1000, 1), dtype('uint64'), True)
    """
    return Stream(proposal, seed, phase, iteration).draw(start, stop)


def noise_seeds(seed: int, phase: str, iteration: int, start: int, stop: int) -> NDArray[np.uint64]:
    """The rollouts' own seeds, (stop - start,), whatever x they go with."""
    noise = np.empty(stop - start, dtype=np.uint64)
    for chunk in range(start // CHUNK, -(-stop // CHUNK)):
        first = chunk * CHUNK
        rows = slice(max(start - first, 0), min(stop - first, CHUNK))
        words = generator(seed, _NOISE_KIND, phase, iteration, chunk).bit_generator.random_raw(CHUNK)
        noise[first + rows.start - start : first + rows.stop - start] = words[rows]
    return noise
