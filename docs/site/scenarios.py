"""The reference of scenario files: every table with its keys, made from the schema."""

from __future__ import annotations

import ast
import io
import tokenize

from docs.site.gather import ROOT
from service.world.scenario.check_human import WITHIN

SCHEMA = ROOT / "service" / "world" / "scenario" / "schema.py"
# how a class of the schema is called in a file; those without a name are tables in a key's place
TABLES = {
    "Scenario": "",
    "Network": "[network]",
    "Time": "[time]",
    "Drivers": "[drivers]",
    "Safety": "[safety]",
    "Rss": "[safety.rss]",
    "Start": "[start]",
    "Vehicle": "[[vehicles]]",
    "Human": "[human]",
    "Avoidance": "[human.avoidance]",
    "Reaction": "[human.reaction]",
    "Glances": "[human.glances]",
    "NoiseProcess": "[human.noise]",
    "Background": "[background]",
    "CameraSpec": "[camera]",
    "RandomWeather": "[weather]",
    "Beta": "",
    "Uniform": "",
    "TruncatedNormal": "",
    "NormalMixture": "",
    "Fixed": "[fixed]",
    "FixedStart": "[[fixed.starts]]",
}


def page() -> str:
    """Every table of a scenario file."""
    source = SCHEMA.read_text(encoding="utf-8")
    classes = {node.name: node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)}
    comments = _comments(source)
    parts = [
        "# Scenario files",
        "A scenario is a TOML file; `tailroad scenario check FILE` says what is wrong with one, and the built-in ones "
        "lie in [`service/world/scenario`](../../service/world/scenario/i80.toml). A key's unit is the end of its "
        "name; a key without a default must be there. A table that is left out has its defaults, or, where it has keys "
        "that must be there, what it describes is not there.",
    ]
    for name, called in TABLES.items():
        parts.append(f"## {called or _title(name)}")
        if (said := ast.get_docstring(classes[name])) is not None:
            parts.append(" ".join(said.split()))
        parts.append(_keys(classes[name], called, comments))
    return "\n\n".join(parts) + "\n"


def _title(name: str) -> str:
    return "The file" if name == "Scenario" else f"Distribution: {name}"


def _comments(source: str) -> dict[int, str]:
    """Line -> the comment on it."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {t.start[0]: t.string.lstrip("# ") for t in tokens if t.type == tokenize.COMMENT}


def _keys(of: ast.ClassDef, called: str, comments: dict[int, str]) -> str:
    rows = ["| key | what | default | meaning |", "| --- | --- | --- | --- |"]
    for tag in (k.value for k in of.keywords if k.arg == "tag"):
        rows.append(f"| `distribution` | text | must be there | `{ast.literal_eval(tag)}` |")
    lines = {node.lineno for node in of.body}
    for node in of.body:
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        key, default = node.target.id, _default(node.value)
        if isinstance(node.value, ast.Call):
            renamed = [k.value for k in node.value.keywords if k.arg == "name"]
            key = ast.literal_eval(renamed[0]) if renamed else key
        above = "" if node.lineno - 1 in lines else comments.get(node.lineno - 1, "")
        meaning = [comments.get(node.lineno, above)]
        inner = called.removeprefix("[human.").rstrip("]")
        if (bounds := WITHIN.get(f"{inner}.{key}")) is not None and called.startswith("[human."):
            meaning.append(f"{bounds[0]:g} to {bounds[1]:g}")
        kind = ast.unparse(node.annotation).replace(" | None", "").replace("|", "or")
        said = "; ".join(m for m in meaning if m).replace("|", r"\|")
        rows.append(f"| `{key}` | {_kind(kind)} | {default} | {said} |")
    return "\n".join(rows)


def _kind(annotation: str) -> str:
    names = {"float": "number", "int": "whole number", "str": "text", "bool": "true or false"}
    if annotation in names:
        return names[annotation]
    if TABLES.get(annotation):
        return f"table `{TABLES[annotation]}`"
    if annotation.startswith("Literal"):
        return " or ".join(f"`{v}`" for v in ast.literal_eval(annotation.removeprefix("Literal")))
    if annotation.startswith("tuple"):
        inner = annotation.removeprefix("tuple[").removesuffix(", ...]")
        return f"tables `{TABLES[inner]}`" if inner in TABLES else f"list of {names.get(inner, inner)}s"
    if annotation.startswith("dict"):
        return "table of numbers"
    return annotation.lower()


def _default(value: ast.expr | None) -> str:
    if value is None:
        return "must be there"
    if isinstance(value, ast.Call):
        given = [k.value for k in value.keywords if k.arg == "default"]
        return f"`{ast.unparse(given[0])}`" if given else "its defaults"
    if isinstance(value, ast.Constant) and value.value is None:
        return "none"
    return f"`{ast.unparse(value)}`"
