"""What lies flat on the ground: layers of strips, and lines painted on them."""

import itertools
from dataclasses import dataclass, field

import numpy as np

from service.world.camera.labels import Label
from service.world.camera.quads import Material

WATER, ROAD, LANES, WEAR = range(4)  # layers, drawn in this order
LAYERS = 4
GROUP = 4  # pieces of a strip that are drawn as one from afar

ASPHALT = Material((0.098, 0.098, 0.102), Label.ASPHALT, retro=0.8)
SHOULDER = Material((0.125, 0.122, 0.118), Label.SHOULDER, retro=0.8)
TRACK = Material((0.080, 0.080, 0.084), Label.ASPHALT, retro=0.8)
PATCH = Material((0.066, 0.066, 0.070), Label.ASPHALT, retro=0.8)
WHITE = Material((0.62, 0.62, 0.60), Label.MARKING, retro=3.0)
YELLOW = Material((0.60, 0.40, 0.055), Label.MARKING, retro=3.0)
TAR = Material((0.035, 0.035, 0.038), Label.ASPHALT, retro=0.8)
DIRT = Material((0.20, 0.17, 0.115), Label.TERRAIN)
GRASS = Material((0.100, 0.120, 0.050), Label.TERRAIN)
SEA = Material((0.045, 0.070, 0.085), Label.WATER)


@dataclass
class GroundBuilder:
    """Grows strips, as quadrilaterals (4, 2), and lines.

    A strip is there twice: in pieces for near by, and in groups of pieces for afar (wear is not). The pieces of a group
    have the group's place, so that a cell is drawn in the one way or the other without gaps.
    """

    corners: list[np.ndarray] = field(default_factory=list)
    layers: list[int] = field(default_factory=list)  # LAYERS more for the groups
    places: list[np.ndarray] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    ends: list[np.ndarray] = field(default_factory=list)  # (2, 2): from where to where a dash's cycle goes
    half_m: list[float] = field(default_factory=list)
    share: list[float] = field(default_factory=list)  # of the cycle that is painted, from its start
    line_materials: list[Material] = field(default_factory=list)

    def strip(self, left: np.ndarray, right: np.ndarray, layer: int, material: Material) -> None:
        """The band between two polylines (n, 2) of as many points; points that are NaN leave it out."""
        present = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
        for begin in range(0, len(left) - 1, GROUP):
            end = min(begin + GROUP, len(left) - 1)
            whole = bool(present[begin : end + 1].all())
            pieces = [(i, i + 1, layer) for i in range(begin, end)]
            if layer != WEAR:
                pieces += (
                    [(begin, end, layer + LAYERS)] if whole else [(i, j, n + LAYERS) for i, j, n in pieces]
                )
            for i, j, where in pieces:
                if present[i] and present[j]:
                    self.corners.append(np.array([left[i], right[i], right[j], left[j]]))
                    self.layers.append(where)
                    self.places.append(
                        0.5 * (left[begin] + right[end]) if whole else 0.5 * (left[i] + right[j])
                    )
                    self.materials.append(material)

    def line(self, points: np.ndarray, width_m: float, material: Material, share: float = 1.0) -> None:
        """A painted line along the polyline (n, 2), one cycle from each point to the next."""
        for a, b in itertools.pairwise(points):
            if np.isfinite(a).all() and np.isfinite(b).all():
                self.ends.append(np.array([a, b]))
                self.half_m.append(0.5 * width_m)
                self.share.append(share)
                self.line_materials.append(material)


@dataclass(frozen=True)
class Ground:
    """Strips in drawing order and lines; reflectances (n, 3), retro (n,), labels (n,) uint16."""

    corners: np.ndarray  # (n, 4, 2)
    layer: np.ndarray  # (n,)
    place: np.ndarray  # (n, 2) which cell a strip belongs to
    albedo: np.ndarray
    retro: np.ndarray
    label: np.ndarray
    ends: np.ndarray  # (m, 2, 2)
    half_m: np.ndarray  # (m,)
    share: np.ndarray  # (m,)
    line_albedo: np.ndarray
    line_retro: np.ndarray

    @staticmethod
    def of(b: GroundBuilder) -> "Ground":
        return Ground(
            np.array(b.corners).reshape(-1, 4, 2),
            np.array(b.layers, dtype=np.int64),
            np.array(b.places).reshape(-1, 2),
            np.array([m.albedo for m in b.materials], dtype=np.float64).reshape(-1, 3),
            np.array([m.retro for m in b.materials], dtype=np.float64),
            np.array([int(m.label) for m in b.materials], dtype=np.uint16),
            np.array(b.ends).reshape(-1, 2, 2),
            np.array(b.half_m, dtype=np.float64),
            np.array(b.share, dtype=np.float64),
            np.array([m.albedo for m in b.line_materials], dtype=np.float64).reshape(-1, 3),
            np.array([m.retro for m in b.line_materials], dtype=np.float64),
        )
