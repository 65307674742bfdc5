"""What a source says, without what changes nothing: comments, docstrings, types and form."""

import ast
from typing import Any

OF_TYPES = ("typing", "collections.abc", "__future__")  # imports that decide nothing
NO_DEEDS = {"annotation", "returns", "type_comment", "type_params", "kind", "ctx"}  # fields of syntax trees


def code_alone(source: str) -> str:
    """What a source does, without comments, docstrings, types and form: the same for every Python that can read it."""
    return _said(ast.parse(source))


def _said(node: Any) -> str:
    if isinstance(node, list):
        return "[" + ";".join(said for said in map(_said, node) if said) + "]"
    if not isinstance(node, ast.AST):
        return repr(node)
    if isinstance(node, ast.ImportFrom) and node.module in OF_TYPES:
        return ""
    if isinstance(node, ast.AnnAssign):
        if node.value is None:
            return ""
        node = ast.Assign([node.target], node.value)
    parts = []
    for name in node._fields:
        value = getattr(node, name, None)
        if name == "body" and isinstance(value, list) and _is_docstring(value):
            value = value[1:]
        if name not in NO_DEEDS and value not in (None, []):
            parts.append(f"{name}={_said(value)}")
    return f"{type(node).__name__}({','.join(parts)})"


def _is_docstring(body: list[Any]) -> bool:
    first = body[0] if body else None
    return (
        isinstance(first, ast.Expr)
        and isinstance(first.value, ast.Constant)
        and isinstance(first.value.value, str)
    )
