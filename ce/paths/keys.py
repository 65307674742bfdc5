"""Keys of random streams by (root, node): a child's key is a function of its parent's and its number among its
siblings.

So a path has the same noise whoever drives it, alone or with others. The mixing function is that of SplitMix64
(Steele, Lea and Flood, OOPSLA 2014), whose output for different inputs differs.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

Keys = NDArray[np.uint64]

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
# Numbers of the uses of a key: its own uniform number, the uniform number that keeps a start, then its children.
_OWN, _START, _CHILD = 1, 2, 3


def mixed(keys: Keys, number: NDArray[np.uint64] | int) -> Keys:
    """Another key (n,) for each key (n,) and number."""
    z = np.asarray(keys, dtype=np.uint64) + np.asarray(number, dtype=np.uint64) * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    return np.asarray(z ^ (z >> np.uint64(31)))


def uniform(keys: Keys) -> NDArray[np.float64]:
    """Numbers (n,) in (0, 1): the middles of 2^52 equal parts."""
    return ((keys >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def splitting_uniform(keys: Keys) -> NDArray[np.float64]:
    """The number (n,) by which a node is split or ended."""
    return uniform(mixed(keys, _OWN))


def start_uniform(seeds: Keys) -> NDArray[np.float64]:
    """The number (n,) by which a start is kept."""
    return uniform(mixed(seeds, _START))


def children(keys: Keys, number: NDArray[np.int64] | int) -> Keys:
    """The key (n,) of each node's child of that number, counted from 0; a root's seed is the parent of its first
    node."""
    return mixed(keys, np.asarray(number).astype(np.uint64) + np.uint64(_CHILD))


def normals(keys: Keys, count: int, first: NDArray[np.int64] | int = 0) -> NDArray[np.float64]:
    """Standard normal numbers (n, count) of each key's own stream, from its number `first`, (n,) or one for all, on.

    >>> import numpy as np
    >>> z = normals(np.arange(3, dtype=np.uint64), 4)
    >>> bool((normals(np.arange(3, dtype=np.uint64), 2, first=2) == z[:, 2:]).all())
    True
    """
    own = mixed(mixed(keys, 0), 0)[:, None]
    at = np.asarray(first).astype(np.uint64).reshape(-1, 1) + np.arange(count, dtype=np.uint64)[None, :]
    return np.asarray(ndtri(uniform(mixed(own, at))))
