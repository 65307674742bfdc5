"""Collecting plane faces with what they are made of; the same faces are drawn and exported."""

from dataclasses import dataclass, field

import numpy as np

from service.world.camera.labels import Label


@dataclass(frozen=True)
class Material:
    """How a face looks: linear reflectance, radiance of its own at night, and retroreflection of headlights."""

    albedo: tuple[float, float, float]
    label: Label
    glow: tuple[float, float, float] = (0.0, 0.0, 0.0)
    retro: float = 1.0


@dataclass(frozen=True)
class Faces:
    """k plane quadrilaterals, counter-clockwise seen from outside; a triangle repeats its last corner."""

    corners: np.ndarray  # (k, 4, 3) m
    normal: np.ndarray  # (k, 3) unit, outwards
    size: np.ndarray  # (k,) m, the mean thickness: area over the longer diagonal
    albedo: np.ndarray  # (k, 3)
    glow: np.ndarray  # (k, 3)
    retro: np.ndarray  # (k,)
    label: np.ndarray  # (k,) uint16

    def __len__(self) -> int:
        return len(self.corners)


@dataclass
class Builder:
    """Grows a list of faces."""

    corners: list[np.ndarray] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)

    def quad(self, corners: object, material: Material, away_from: object = None) -> None:
        """Add a face; where `away_from` is given, it is turned so that its outside is away from that point."""
        points = np.asarray(corners, dtype=np.float64)
        if away_from is not None:
            normal = np.cross(points[2] - points[0], points[3] - points[1])
            if normal @ (points.mean(axis=0) - np.asarray(away_from, dtype=np.float64)) < 0.0:
                points = points[[0, 3, 2, 1]]
        self.corners.append(points)
        self.materials.append(material)

    def both_sides(self, corners: object, material: Material) -> None:
        points = np.asarray(corners, dtype=np.float64)
        self.quad(points, material)
        self.quad(points[[0, 3, 2, 1]], material)

    def box(
        self,
        base: np.ndarray,
        low: float,
        high: float,
        material: Material,
        top: Material | None = None,
        bottom: bool = False,
    ) -> None:
        """An upright prism over the quadrilateral base (4, 2)."""
        base = np.asarray(base, dtype=np.float64)
        middle = np.append(base.mean(axis=0), 0.5 * (low + high))
        at = [np.column_stack([base, np.full(4, z)]) for z in (low, high)]
        for i in range(4):
            j = (i + 1) % 4
            self.quad([at[0][i], at[0][j], at[1][j], at[1][i]], material, middle)
        self.quad(at[1], top or material, middle)
        if bottom:
            self.quad(at[0], material, middle)

    def faces(self) -> Faces:
        k = len(self.corners)
        corners = np.array(self.corners).reshape(k, 4, 3)
        diagonals = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
        normal = np.cross(*diagonals)
        size = 0.5 * np.linalg.norm(normal, axis=1)
        size /= np.maximum(np.maximum(*(np.linalg.norm(d, axis=1) for d in diagonals)), 1e-12)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        return Faces(
            corners,
            normal,
            size,
            np.array([m.albedo for m in self.materials], dtype=np.float64).reshape(k, 3),
            np.array([m.glow for m in self.materials], dtype=np.float64).reshape(k, 3),
            np.array([m.retro for m in self.materials], dtype=np.float64),
            np.array([int(m.label) for m in self.materials], dtype=np.uint16),
        )
