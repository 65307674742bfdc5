"""An operational design domain as a file declares it: of each attribute the cells that lie inside.

format = 1
name = "highway by day"

[domain]                                    # attributes that are not named are not restricted
illumination = ["low sun", "day"]
ego-speed = ["50 to 70", "70 to 90", "90 to 110", "110 to 130"]
"""

import tomllib
from pathlib import Path

import msgspec

from service.analysis.coverage.attributes import BY_NAME
from service.errors import InputError

FORMAT = 1
LARGEST = 1 << 20  # bytes of a file


class Domain(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A declared domain. domain: cells by attribute."""

    format: int
    name: str
    domain: dict[str, tuple[str, ...]]


def load_domain(path: Path) -> Domain:
    """The domain in a file; InputError names what is wrong where."""
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(f"{path}: a domain of more than {LARGEST} bytes is not read")
        found = msgspec.convert(tomllib.loads(path.read_text(encoding="utf-8")), Domain)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {error}; see service/analysis/coverage/domain.py for the form") from error
    except ValueError as error:
        raise InputError(f"{path} is no TOML: {error}") from error
    if found.format != FORMAT:
        raise InputError(f"{path}: format = {found.format}: this version reads {FORMAT}")
    for name, cells in found.domain.items():
        if name not in BY_NAME:
            raise InputError(f"{path}: no attribute {name!r}; there are {', '.join(BY_NAME)}")
        known = BY_NAME[name].cells
        for cell in cells:
            if cell not in known:
                raise InputError(f"{path}: {name} has no cell {cell!r}; it has {'; '.join(known)}")
    return found
