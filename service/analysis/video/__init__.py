"""A rollout as a film: the road from above and the ego's camera side by side, the measure so far, and the actions."""

from service.analysis.video.film import write_frames, write_video
from service.analysis.video.view import EgoView, jpeg_pictures

__all__ = ["EgoView", "jpeg_pictures", "write_frames", "write_video"]
