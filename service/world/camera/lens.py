"""What is not a level pinhole: roll and distortion, put on by warping a level pinhole picture that is large enough."""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from service.errors import InputError
from service.world.scenario.schema import CameraSpec

LARGEST_TANGENT = 8.0  # of a ray's angle from the axis
MARGIN_PX = 2
# OpenCV's own, 5 iterations, leave ordinary lenses undone by up to half a pixel
UNTIL = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
UNDONE_PX = 1e-3  # further off than this, a ray is not the pixel's
PARTS = 32  # of a pixel, in which OpenCV's fixed-point maps count


@dataclass(frozen=True)
class Lens:
    """The level pinhole picture to draw, and where in it each pixel is found."""

    width_px: int
    height_px: int
    focal_px: float
    centre_x_px: float
    centre_y_px: float
    at: (
        # (h, w) float64 each: x and y of a pixel in it; None: every pixel in its place
        tuple[np.ndarray, np.ndarray] | None
    )

    def warp(self, picture: np.ndarray, labels: bool = False) -> np.ndarray:
        """The picture as the lens shows it; `labels`: take the nearest value, do not mix."""
        if self.at is None:
            return picture
        if labels:
            return cv2.remap(picture, *self._nearest, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        return cv2.remap(picture, *self._between, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    @cached_property
    def _between(self) -> tuple[np.ndarray, np.ndarray]:
        """Maps of OpenCV's fixed-point kind: with float maps pictures differ by a level between processors."""
        assert self.at is not None
        x, y = (np.rint(values * PARTS).astype(np.int64) for values in self.at)
        whole = np.stack([x // PARTS, y // PARTS], axis=-1).astype(np.int16)
        return whole, ((y % PARTS) * PARTS + x % PARTS).astype(np.uint16)

    @cached_property
    def _nearest(self) -> tuple[np.ndarray, np.ndarray]:
        assert self.at is not None
        return np.stack([np.rint(values) for values in self.at], axis=-1).astype(np.int16), np.empty(
            0, np.uint16
        )


def lens_of(spec: CameraSpec) -> Lens:
    """The lens of a camera; InputError where distortion or angle of view ask for rays that no plane picture holds."""
    width, height = spec.width_px, spec.height_px
    focal = 0.5 * width / math.tan(math.radians(0.5 * spec.hfov_deg))
    if spec.roll_deg == 0.0 and not any(spec.distortion):
        return Lens(width, height, focal, 0.5 * width, 0.5 * height, None)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    matrix = np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])
    coefficients = np.array(spec.distortion or (0.0,) * 5)
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    seen = cv2.undistortPoints(pixels, matrix, coefficients, criteria=UNTIL)[:, 0]
    again, _ = cv2.projectPoints(
        np.column_stack([seen, np.ones(len(seen))]), np.zeros(3), np.zeros(3), matrix, coefficients
    )
    error = np.abs(again[:, 0] - np.column_stack([x.ravel(), y.ravel()])).max()
    if not np.isfinite(seen).all() or np.abs(seen).max() > LARGEST_TANGENT or not error < UNDONE_PX:
        raise InputError(
            f"camera.distortion {list(spec.distortion)} with hfov_deg = {spec.hfov_deg:g} cannot be undone over the "
            "whole picture; give smaller coefficients or a smaller angle of view"
        )
    roll = math.radians(spec.roll_deg)
    level_x = seen[:, 0] * math.cos(roll) - seen[:, 1] * math.sin(roll)
    level_y = seen[:, 0] * math.sin(roll) + seen[:, 1] * math.cos(roll)
    left, right = math.floor(focal * level_x.min()) - MARGIN_PX, math.ceil(focal * level_x.max()) + MARGIN_PX
    top, bottom = math.floor(focal * level_y.min()) - MARGIN_PX, math.ceil(focal * level_y.max()) + MARGIN_PX
    at_x = (focal * level_x - left - 0.5).reshape(height, width)
    at_y = (focal * level_y - top - 0.5).reshape(height, width)
    return Lens(right - left, bottom - top, focal, float(-left), float(-top), (at_x, at_y))
