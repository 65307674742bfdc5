"""The picture of the layers, drawn from the import contracts and from what the sources really import."""

from __future__ import annotations

import ast
import tomllib
from dataclasses import dataclass
from html import escape
from pathlib import Path

from docs.site.gather import ROOT

ROOMS = "the rooms of service, from the top down"
BELOW = ("policies", "sumo_nets", "ce")
_WIDTH, _PAD, _LINE = 960, 14, 20
_FONT = "font-family='system-ui, sans-serif'"


@dataclass(frozen=True)
class Room:
    """A layer: its module, what it is for, what lies in it from the top down, and what it imports of the others."""

    module: str
    purpose: str
    inside: tuple[str, ...]
    uses: tuple[str, ...]


def rooms() -> list[Room]:
    """The layers from the top down, then the packages that everything stands on."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    contracts = {c["name"]: c for c in settings["importlinter"]["contracts"]}
    layers = [layer for layer in contracts[ROOMS]["layers"] if "|" not in layer]
    within = {
        c["layers"][0].split(" ")[0].rpartition(".")[0]: c["layers"]
        for name, c in contracts.items()
        if c["type"] == "layers" and name != ROOMS
    }
    modules = ["tailroad", *layers, *BELOW]
    imported = {module: _imports(module) for module in modules}
    return [
        Room(
            module,
            _purpose(module),
            tuple(layer.replace(f"{module}.", "") for layer in within.get(module, ())),
            tuple(other for other in modules if other != module and other in imported[module]),
        )
        for module in modules
    ]


def _purpose(module: str) -> str:
    """The first sentence of the package's docstring."""
    text = ast.get_docstring(ast.parse((_folder(module) / "__init__.py").read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split())


def _folder(module: str) -> Path:
    return ROOT / module.replace(".", "/")


def _imports(module: str) -> set[str]:
    """The packages, and rooms of service, that a package's sources import."""
    found = set()
    for source in _folder(module).rglob("*.py"):
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names = [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
            elif isinstance(node, ast.Import):
                names = [a.name for a in node.names]
            else:
                continue
            for name in names:
                parts = name.split(".")
                found.add(".".join(parts[:2]) if parts[0] == "service" else parts[0])
    return found


def picture(layers: list[Room]) -> str:
    """The layers as SVG: each imports only what stands below it."""
    drawn, y = [], _PAD
    for room in layers:
        if room.module in BELOW:
            continue
        lines = _wrapped(room.purpose, 120)
        if room.inside:
            lines += _wrapped("in it, from the top down: " + " › ".join(room.inside), 120)
        lines += _wrapped("imports " + ", ".join(u.replace("service.", "") for u in room.uses), 120)
        height = 40 + _LINE * len(lines)
        drawn.append(
            _box(_PAD, y, _WIDTH - 2 * _PAD, height, room.module.replace("service.", ""), lines, "#e8f0f6")
        )
        y += height + 10
    width = (_WIDTH - 2 * _PAD - 20) // 3
    for i, room in enumerate(r for r in layers if r.module in BELOW):
        lines = _wrapped(room.purpose, 38)
        drawn.append(
            _box(_PAD + i * (width + 10), y, width, 40 + _LINE * 4, room.module, lines[:4], "#f6efe2")
        )
    height = y + 40 + _LINE * 4 + _PAD
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {_WIDTH} {height}' role='img' "
        f"aria-label='Layers of tailroad: each imports only what stands below it'>"
        f"<rect width='{_WIDTH}' height='{height}' fill='#fff'/>{''.join(drawn)}</svg>\n"
    )


def _wrapped(text: str, width: int) -> list[str]:
    lines = [""]
    for word in text.replace("`", "").split():
        if len(lines[-1]) + len(word) >= width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


def _box(x: int, y: int, width: int, height: int, title: str, lines: list[str], colour: str) -> str:
    look = f"font-size='17' font-weight='600' {_FONT} fill='#1f3a4d'"
    heading = f"<text x='{x + 14}' y='{y + 25}' {look}>{escape(title)}</text>"
    text = "".join(
        f"<text x='{x + 14}' y='{y + 48 + _LINE * i}' font-size='14' {_FONT} fill='#333'>{escape(line)}</text>"
        for i, line in enumerate(lines)
    )
    return (
        f"<rect x='{x}' y='{y}' width='{width}' height='{height}' rx='6' fill='{colour}' stroke='#9db3c4'/>"
        f"{heading}{text}"
    )


def table(layers: list[Room]) -> str:
    """The same for readers of text."""
    rows = []
    for room in layers:
        uses = ", ".join(f"`{module}`" for module in room.uses) or "nothing of tailroad"
        rows.append(f"| `{room.module}` | {room.purpose} | {uses} |")
    return "\n".join(["| layer | what | imports |", "| --- | --- | --- |", *rows])
