"""A Griffe extension: what our docstrings have a form for becomes Markdown.

Fields that stand one a line ("gamma: the threshold, s") become a list, and examples (">>> ...") blocks of code.
"""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

_FIELD = re.compile(r"^(\*{0,2}[A-Za-z_]\w*(?:, \*{0,2}[A-Za-z_]\w*)*): +(\S.*)$")


class Fields(Extension):
    """Rewrites each docstring as it is collected."""

    def on_object(self, *, obj: Object, **settings: Any) -> None:
        if obj.docstring:
            obj.docstring.value = fenced(listed(obj.docstring.value))


def listed(text: str) -> str:
    """The docstring with its fields as a Markdown list; the rest, and what is indented, stays as it is."""
    done: list[str] = []
    within = False
    for line in text.split("\n"):
        field = _FIELD.match(line)
        if field:
            if not within and done and done[-1]:
                done.append("")
            done.append(f"- `{field.group(1)}`: {field.group(2)}")
            within = True
        elif within and line and not line.startswith(("- ", "    ")):
            done.append(f"    {line.strip()}")
        else:
            within = within and bool(line) and line.startswith("    ")
            done.append(line)
    return "\n".join(done)


def fenced(text: str) -> str:
    """The docstring with each example, up to the next blank line, as a block of code."""
    done: list[str] = []
    within = False
    for line in [*text.split("\n"), ""]:
        if line.startswith(">>>") and not within:
            done += ["", "```pycon"]
            within = True
        if within and not line:
            done.append("```")
            within = False
        done.append(line)
    return "\n".join(done).rstrip()
