"""Lenses: undone exactly, refused where they cannot be, and the same picture on every processor."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from service.errors import InputError
from service.world.camera.lens import lens_of
from service.world.scenario.schema import CameraSpec

LENSES = {
    (90.0, (-0.30, 0.09, 0.0, 0.0, 0.0)),
    (66.0, (-0.15, 0.02, 0.001, 0.0, 0.0)),
    (100.0, (-0.25, 0.05, 0.0, 0.001, 0.0)),
    (60.0, (0.20, -0.10, 0.0, 0.0, 0.0)),
    (80.0, (-0.35, 0.15, 0.0, 0.0, -0.03)),
}


@pytest.mark.parametrize(("hfov", "distortion"), sorted(LENSES))
def test_a_pixel_is_found_where_its_ray_is(hfov, distortion):
    """Each place in the level picture, as a ray, comes back to its pixel through OpenCV's projection."""
    spec = CameraSpec(hfov_deg=hfov, distortion=distortion)
    lens = lens_of(spec)
    rays = np.stack([(lens.at[0] + 0.5 - lens.centre_x_px) / lens.focal_px,
                     (lens.at[1] + 0.5 - lens.centre_y_px) / lens.focal_px], axis=-1).reshape(-1, 2)  # fmt: skip
    centre = 0.5 * spec.width_px, 0.5 * spec.height_px
    matrix = np.array([[lens.focal_px, 0.0, centre[0]], [0.0, lens.focal_px, centre[1]], [0.0, 0.0, 1.0]])
    back, _ = cv2.projectPoints(
        np.column_stack([rays, np.ones(len(rays))]), np.zeros(3), np.zeros(3), matrix, np.array(distortion)
    )
    x, y = np.meshgrid(np.arange(spec.width_px) + 0.5, np.arange(spec.height_px) + 0.5)
    assert np.abs(back[:, 0] - np.column_stack([x.ravel(), y.ravel()])).max() < 1e-6


@pytest.mark.parametrize("distortion", [(-1.5, 0.0, 0.0, 0.0, 0.0), (-0.6, 0.0, 0.0, 0.0, 0.0)])
def test_a_lens_that_folds_the_picture_over_is_refused(distortion):
    with pytest.raises(InputError, match=r"distortion .* cannot be undone over the whole picture"):
        lens_of(CameraSpec(hfov_deg=120.0, distortion=distortion))


def test_a_smooth_picture_comes_out_as_it_would_by_floating_point():
    lens = lens_of(CameraSpec(roll_deg=7.0, hfov_deg=90.0, distortion=(-0.30, 0.09, 0.0, 0.0, 0.0)))
    y, x = np.mgrid[: lens.height_px, : lens.width_px]
    picture = np.clip(0.5 * x + 0.4 * y, 0, 255).astype(np.uint8)
    exactly = cv2.remap(picture, *(v.astype(np.float32) for v in lens.at), cv2.INTER_LINEAR)
    assert np.abs(lens.warp(picture)[2:-2, 2:-2].astype(int) - exactly[2:-2, 2:-2].astype(int)).max() <= 1
    kinds = (x // 9 + 40 * (y // 9)).astype(np.uint16)
    assert set(np.unique(lens.warp(kinds, labels=True))) <= set(np.unique(kinds))


SCRIPT = """
import hashlib
import numpy as np
from service.world.camera.lens import lens_of
from service.world.scenario.schema import CameraSpec

lens = lens_of(CameraSpec(width_px=640, height_px=360, roll_deg=11.0, hfov_deg=90.0, distortion=(-0.3, 0.09, 0, 0, 0)))
picture = np.random.default_rng(1).integers(0, 256, (lens.height_px, lens.width_px, 4), dtype=np.uint8)
print(hashlib.sha256(lens.warp(picture).tobytes() + lens.warp(picture[..., 0].copy(), True).tobytes()).hexdigest())
"""


def test_the_picture_is_the_same_without_the_processors_wider_instructions():
    found = set()
    for off in ("", "AVX2,AVX512-SKX", "AVX2,AVX512-SKX,AVX,SSE4.2,SSE4.1"):
        environment = os.environ | {"OPENCV_CPU_DISABLE": off, "PYTHONPATH": str(Path(__file__).parents[4])}
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True
        )
        found.add(done.stdout.split()[-1])
    assert len(found) == 1
