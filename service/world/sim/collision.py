"""Collision of oriented boxes by the separating axis theorem."""

import numpy as np

from policies.jit import kernel
from service.world import agents as A


@kernel
def overlap(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether the boxes of two vehicles (rows of the agents' array) overlap or touch."""
    dx = b[A.X_M] - a[A.X_M]
    dy = b[A.Y_M] - a[A.Y_M]
    la, wa = 0.5 * a[A.LENGTH_M], 0.5 * a[A.WIDTH_M]
    lb, wb = 0.5 * b[A.LENGTH_M], 0.5 * b[A.WIDTH_M]
    reach = la + wa + lb + wb
    if dx * dx + dy * dy > reach * reach:
        return False
    cosine = abs(a[A.COS] * b[A.COS] + a[A.SIN] * b[A.SIN])
    sine = abs(a[A.COS] * b[A.SIN] - a[A.SIN] * b[A.COS])
    if abs(dx * a[A.COS] + dy * a[A.SIN]) > la + lb * cosine + wb * sine:
        return False
    if abs(dy * a[A.COS] - dx * a[A.SIN]) > wa + lb * sine + wb * cosine:
        return False
    if abs(dx * b[A.COS] + dy * b[A.SIN]) > lb + la * cosine + wa * sine:
        return False
    return abs(dy * b[A.COS] - dx * b[A.SIN]) <= wb + la * sine + wa * cosine


@kernel
def mark_collisions(agents: np.ndarray, count: int) -> None:
    """Set the collision flag of every active vehicle whose box overlaps another's."""
    for i in range(count):
        agents[i, A.COLLISION] = 0.0
    for i in range(count):
        if agents[i, A.ACTIVE] == 0.0:
            continue
        for j in range(i + 1, count):
            if agents[j, A.ACTIVE] != 0.0 and overlap(agents[i], agents[j]):
                agents[i, A.COLLISION] = 1.0
                agents[j, A.COLLISION] = 1.0
