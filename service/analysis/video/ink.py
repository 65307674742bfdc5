"""Colours and letters of the film; OpenCV's order: blue, green, red."""

import cv2
import numpy as np

Colour = tuple[int, int, int]

BACKGROUND: Colour = (34, 34, 34)
TEXT: Colour = (240, 240, 240)
QUIET: Colour = (150, 150, 150)
GRID: Colour = (70, 70, 70)
# ego, the one that f is about, others: the hues of reports and of the dashboard
EGO: Colour = (224, 134, 43)
THREAT: Colour = (185, 122, 232)
OTHER: Colour = (190, 190, 190)
TAKEN_OVER: Colour = (150, 120, 170)
DANGER: Colour = (60, 60, 230)
TURN: Colour = (90, 190, 90)


def write(
    image: np.ndarray, text: str, at: tuple[int, int], size: float = 0.5, colour: Colour = TEXT
) -> None:
    """Text with its lower left corner at `at` (column, row)."""
    thickness = 2 if size > 0.7 else 1
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, thickness, cv2.LINE_AA)
