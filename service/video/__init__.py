"""A rollout as a film: the road from above and the ego's camera side by side, the measure so far, and the actions."""

from service.video.film import write_frames, write_video
from service.video.view import EgoView

__all__ = ["EgoView", "write_frames", "write_video"]
