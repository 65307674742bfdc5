"""The JSON objects of the API as a page, from the published schemas."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from docs.site.gather import ROOT


def folder() -> Path:
    """Where the published schemas lie."""
    return next((ROOT / "service").rglob("schemas/Estimate.json")).parent


def page() -> str:
    """Every object with its fields; an object that several use is told once."""
    definitions: dict[str, dict[str, Any]] = {}
    for file in sorted(folder().glob("*.json")):
        definitions |= json.loads(file.read_text(encoding="utf-8"))["$defs"]
    parts = [
        "# JSON objects",
        "What the API answers and takes. `tailroad schema NAME` and the key `schemas/NAME` give the JSON Schema of "
        "those that are answers or bodies by themselves.",
    ]
    for name, about in sorted(definitions.items()):
        parts += [f"## {name}", about.get("description", "")]
        fields = about.get("properties", {})
        if fields:
            optional = set(fields) - set(about.get("required", ()))
            rows = [
                f"| `{f}` | {_kind(s)} | {_default(s) if f in optional else 'always there'} |"
                for f, s in fields.items()
            ]
            parts.append("\n".join(["| field | type | |", "| --- | --- | --- |", *rows]))
        elif "enum" in about:
            parts.append("One of " + ", ".join(f"`{one}`" for one in about["enum"]) + ".")
    return "\n\n".join(p for p in parts if p) + "\n"


def _kind(schema: dict[str, Any]) -> str:
    """A type in words."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in schema:
        return " or ".join(_kind(one) for one in schema["anyOf"])
    if "enum" in schema:
        return " or ".join(f"`{one}`" for one in schema["enum"])
    if "prefixItems" in schema:
        return "[" + ", ".join(_kind(one) for one in schema["prefixItems"]) + "]"
    if schema.get("type") == "array":
        return f"list of {_kind(schema['items'])}" if schema.get("items") else "list"
    if isinstance(schema.get("additionalProperties"), dict):
        return f"object: name to {_kind(schema['additionalProperties'])}"
    return str(schema.get("type", "anything"))


def _default(schema: dict[str, Any]) -> str:
    return f"default `{json.dumps(schema['default'])}`" if "default" in schema else "may be left out"
