"""An answer that is a file rather than an object."""

from dataclasses import dataclass

JSON = "application/json"


@dataclass(frozen=True)
class File:
    """Its media type and its bytes."""

    media: str
    body: bytes
