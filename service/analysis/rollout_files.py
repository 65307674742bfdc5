"""The files that a rollout can be made into, whoever runs it again: this machine or a service."""

from abc import ABC, abstractmethod
from pathlib import Path

FORMATS = {  # what a client may ask for: media type and the file's suffix
    "scenario": ("application/toml", ".toml"),
    "fcd": ("application/xml", ".xml"),
    "mp4": ("video/mp4", ".mp4"),
    "mcap": ("application/octet-stream", ".mcap"),
    "table": ("application/vnd.apache.parquet", ".parquet"),
    "openscenario": ("application/xml", ".xosc"),
}
SUFFIXES = {form: suffix for form, (_, suffix) in FORMATS.items()}


class RolloutFiles(ABC):
    """A rollout as files: each method runs it again, writes the file and gives back its path."""

    def video(self, path: str | Path) -> Path:
        """A film from above and from the ego's camera (.mp4)."""
        return self._write("mp4", path)

    def recording(self, path: str | Path) -> Path:
        """A recording for Foxglove and other viewers of robot logs (.mcap)."""
        return self._write("mcap", path)

    def scenario(self, path: str | Path) -> Path:
        """A scenario file that holds this one rollout (.toml); `tailroad rollout FILE` runs it to the same bit."""
        return self._write("scenario", path)

    def fcd(self, path: str | Path) -> Path:
        """SUMO's floating-car data (.xml)."""
        return self._write("fcd", path)

    def trace(self, path: str | Path) -> Path:
        """Every vehicle at every step (.parquet)."""
        return self._write("table", path)

    def openscenario(self, path: str | Path) -> Path:
        """ASAM OpenSCENARIO XML 1.3, each vehicle on its trajectory (.xosc)."""
        return self._write("openscenario", path)

    @abstractmethod
    def _write(self, form: str, path: str | Path) -> Path:
        """Run the rollout again and write it in a form of `SUFFIXES`."""
