"""Claims with what supports them, and the manifest of a folder of evidence."""

from typing import Any

import msgspec

FORMAT = 1
MANIFEST, SIGNATURE, KEY, CLAIMS = "manifest.json", "manifest.json.minisig", "tailroad.pub", "claims.json"


class Claim(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A claim. id: of its goal

    says: in words, with its interval
    file: in the folder, that supports it
    at: where in it, keys and places one below the other; empty: all of it
    value: what stands there
    command: that makes it again from the folder
    """

    id: str
    says: str
    file: str
    at: tuple[str | int, ...] = ()
    value: Any = None
    command: str = ""


class Group(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Claims on one run's job. context: what they hold for; assumptions: without which they do not."""

    id: str
    says: str
    context: tuple[str, ...]
    assumptions: tuple[str, ...]
    warnings: tuple[str, ...]
    claims: tuple[Claim, ...]


class Claims(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that a folder claims."""

    format: int = FORMAT
    title: str
    made: str  # when, UTC
    groups: tuple[Group, ...]


class Manifest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Every file of a folder but itself and its signature: SHA-256 and size by path; runs: run directories in it."""

    format: int = FORMAT
    made: str
    tailroad: str
    files: dict[str, tuple[str, int]]
    runs: tuple[str, ...]
