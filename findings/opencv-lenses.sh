#!/usr/bin/env bash
# OpenCV 5.0.0: lenses are undone by 5 iterations, and remap with float maps depends on the processor.
#
# Expected: undistortPoints inverts projectPoints; remap gives the same bytes with and without AVX2.
# Seen:     a 90 degree lens with (-0.30, 0.09) is off by more than 0.1 px, by less than 1e-6 with criteria (100, 1e-9);
#           float maps differ by a level, maps of the fixed-point kind (int16, uint16) do not.
# Ends with 0 while that is so, with 1 once it has changed.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
cat > "$folder/seen.py" <<'PYTHON'
import hashlib
import os
import subprocess
import sys

import cv2
import numpy as np

WIDTH, HEIGHT, FOCAL = 640, 360, 320.0
MATRIX = np.array([[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]])
LENS = np.array([-0.30, 0.09, 0.0, 0.0, 0.0])
x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
PIXELS = np.stack([x, y], axis=-1).reshape(-1, 1, 2)


def error_px(**options: object) -> tuple[float, np.ndarray]:
    seen = cv2.undistortPoints(PIXELS, MATRIX, LENS, **options)[:, 0]
    back, _ = cv2.projectPoints(
        np.column_stack([seen, np.ones(len(seen))]), np.zeros(3), np.zeros(3), MATRIX, LENS
    )
    return float(np.abs(back - PIXELS).max()), seen


exact = {"criteria": (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)}
if sys.argv[1:] == ["picture"]:
    turn = np.radians(11.0)
    turned = error_px(**exact)[1] @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    seen = (turned * FOCAL * 0.7 + (WIDTH / 2, HEIGHT / 2)).reshape(HEIGHT, WIDTH, 2)
    picture = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 4), dtype=np.uint8)
    floats = cv2.remap(
        picture,
        *np.moveaxis(seen.astype(np.float32), -1, 0),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    parts = np.rint(seen * 32).astype(np.int64)
    table = ((parts[..., 1] % 32) * 32 + parts[..., 0] % 32).astype(np.uint16)
    fixed = cv2.remap(
        picture, (parts // 32).astype(np.int16), table, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    print(*(hashlib.sha256(made.tobytes()).hexdigest()[:8] for made in (floats, fixed)))
    sys.exit(0)

default, careful = error_px()[0], error_px(**exact)[0]
print(f"undistortPoints: {default:.2g} px off, {careful:.2g} px with criteria (100, 1e-9); expected: 0")
found = [
    subprocess.run([sys.executable, __file__, "picture"], env=os.environ | {"OPENCV_CPU_DISABLE": off},
                   capture_output=True, text=True, check=True).stdout.split()
    for off in ("", "AVX2,AVX512-SKX")
]  # fmt: skip
(float_with, fixed_with), (float_without, fixed_without) = found
print(
    f"remap, with and without AVX2: float maps {float_with} {float_without}, fixed-point {fixed_with} {fixed_without}"
)
sys.exit(
    0
    if default > 0.1 and careful < 1e-6 and float_with != float_without and fixed_with == fixed_without
    else 1
)
PYTHON
"$folder/venv/bin/python" "$folder/seen.py"
