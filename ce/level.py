"""A level function apart from the event's f: what a search climbs need not be what decides the event.

Where f says little about how near the event is (a contact: f is positive until it happens), a search climbs better
by another number. `levelled` puts the two into one: at or below gamma it is f itself, so that the event and p stay
what they are; above it orders rollouts by their level.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.errors import ResponseError


def levelled(f: ArrayLike, level: ArrayLike, gamma: float) -> NDArray[np.float64]:
    """f (n,) where it is at most gamma or NaN, elsewhere a value above gamma that rises with the level (n,).

    It is gamma + s (1 + l) for l >= 0 and gamma + s / (1 - l) below, l the level and s = max(1, |gamma|); +inf
    stays. A rollout whose level is NaN counts as failed. ResponseError where the two do not fit each other.

    f: low is dangerous, NaN = the rollout failed
    level: low is nearer to the event, in a unit of its own
    gamma: threshold of the event, in the unit of f

    >>> levelled([0.2, 3.0, 3.0, 3.0], [9.0, 2.0, -1.0, 0.0], gamma=0.5).tolist()
    [0.2, 3.5, 1.0, 1.5]
    """
    values, levels = np.asarray(f, dtype=np.float64), np.asarray(level, dtype=np.float64)
    if values.shape != levels.shape:
        raise ResponseError(f"level must give shape {values.shape}, as f does, not {levels.shape}")
    scale = max(1.0, abs(gamma))
    up, down = np.maximum(levels, 0.0), np.minimum(levels, 0.0)
    above = gamma + scale * np.where(levels >= 0.0, 1.0 + up, 1.0 / (1.0 - down))
    above = np.where(np.isnan(levels), np.nan, np.maximum(above, np.nextafter(gamma, np.inf)))
    return np.where((values <= gamma) | np.isnan(values), values, above)
