"""The published JSON Schemas of what goes over the wire: files in schemas/, made of the types and checked by a test.

python -m service.remote.api.schemas    writes them anew
"""

from importlib.resources import files
from pathlib import Path
from typing import Any

import msgspec

from service.remote.api.routes import PREFIX, wire_types

FOLDER = files("service.remote.api") / "schemas"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The JSON Schema of a type."""
    return {"$schema": DIALECT, "$id": f"{PREFIX}/schemas/{kind.__name__}"} | msgspec.json.schema(kind)


def text_of(kind: type[msgspec.Struct]) -> str:
    """The schema's file."""
    return msgspec.json.format(msgspec.json.encode(schema_of(kind)), indent=2).decode() + "\n"


def published() -> dict[str, bytes]:
    """The schemas by name, as published."""
    return {name: (FOLDER / f"{name}.json").read_bytes() for name in sorted(wire_types())}


if __name__ == "__main__":
    folder = Path(str(FOLDER))
    folder.mkdir(exist_ok=True)
    for name, kind in wire_types().items():
        (folder / f"{name}.json").write_text(text_of(kind), encoding="utf-8")
