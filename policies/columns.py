"""Tables of arrays: dataclasses whose fields all have one row for each of the same n things."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np


@dataclass(frozen=True)
class Columns:
    """A table of n rows; each field of a subclass is an array (n, ...)."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def where(self, mask: np.ndarray) -> Self:
        """The rows that `mask` chooses: (n,) truth values, or rows' numbers."""
        return type(self)(*(getattr(self, field.name)[mask] for field in fields(self)))

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """The rows of all `parts`, in their order."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


@dataclass(frozen=True)
class Values(Columns):
    """Values (n,) of one quantity and the vehicle number (n,) of each."""

    x: np.ndarray
    vehicle: np.ndarray
