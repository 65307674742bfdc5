"""Which noise a rollout has: that of a seed, or that of a path, whose parts have seeds of their own."""

import re
from itertools import pairwise

import msgspec

from service.errors import InputError

LARGEST = 2**64 - 1
_PART = re.compile(r"([0-9]{1,9}):([0-9]{1,20})")


class PathNoise(msgspec.Struct, frozen=True):
    """The noise of a path that was driven in parts (`service.world.paths`).

    seed: of the path's start
    begins: (parts,) the step at which each part begins, the first at 0
    keys: (parts,) the seed of each part's noise; the last one's goes on to the horizon

    As text it is SEED/BEGIN:KEY/BEGIN:KEY..., which `noise_of` reads.

    >>> str(PathNoise(7, (0, 5), (11, 12))), int(PathNoise(7, (0,), (11,)))
    ('7/0:11/5:12', 7)
    """

    seed: int
    begins: tuple[int, ...]
    keys: tuple[int, ...]

    def __str__(self) -> str:
        return "/".join([str(self.seed), *(f"{b}:{k}" for b, k in zip(self.begins, self.keys, strict=True))])

    def __int__(self) -> int:
        return self.seed


Noise = int | PathNoise


def noise_of(text: str) -> Noise:
    """The noise that a text stands for, as `str` of it wrote it; InputError where it is none.

    >>> noise_of("7"), noise_of("7/0:11/5:12")
    (7, PathNoise(seed=7, begins=(0, 5), keys=(11, 12)))
    """
    seed, *parts = text.split("/")
    found = [_PART.fullmatch(part) for part in parts]
    if not (seed.isascii() and seed.isdigit() and int(seed) <= LARGEST) or not all(found):
        raise _wrong(text)
    if not parts:
        return int(seed)
    begins = tuple(int(one[1]) for one in found if one)
    keys = tuple(int(one[2]) for one in found if one)
    if begins[0] != 0 or any(b <= a for a, b in pairwise(begins)) or max(keys) > LARGEST:
        raise _wrong(text)
    return PathNoise(int(seed), begins, keys)


def _wrong(text: str) -> InputError:
    return InputError(
        f"noise {text[:80]!r}: give a whole number from 0 to 2**64 - 1, or that of a path as SEED/0:KEY/STEP:KEY..., "
        "as `tailroad failures` writes it"
    )
