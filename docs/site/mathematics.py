r"""A Markdown extension: $x$ and $$x$$ in LaTeX become MathML, which browsers show without a script.

A formula starts and ends next to something that is no space, and a dollar sign before a word or in code is left alone.
A | in a table ends its cell: write \vert there.
"""

from __future__ import annotations

import re
from typing import Any
from xml.etree.ElementTree import Element

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor

BLOCK = r"\$\$(.+?)\$\$"
INLINE = r"(?<![\\$\w])\$(?![\s$])([^$\n]+?)(?<![\s\\])\$(?![\w$])"


class _Formula(InlineProcessor):
    def __init__(self, pattern: str, markdown: Markdown, display: str) -> None:
        super().__init__(pattern, markdown)
        self.compiled_re = re.compile(pattern, re.DOTALL)
        self.display = display

    def handleMatch(  # type: ignore[override]
        self, m: re.Match[str], data: str
    ) -> tuple[Element | str, int, int]:
        assert self.md is not None
        shown = convert(m.group(1), display=self.display)
        if "&#x0005C;" in shown or "\\" in shown:
            raise ValueError(
                f"${m.group(1)}$ has a command that latex2mathml does not know; write it otherwise"
            )
        return self.md.htmlStash.store(shown), m.start(0), m.end(0)


class Mathematics(Extension):
    """Adds formulas to Markdown, before anything else within a line but code."""

    def extendMarkdown(self, md: Markdown) -> None:
        md.inlinePatterns.register(_Formula(BLOCK, md, "block"), "mathematics-block", 186)
        md.inlinePatterns.register(_Formula(INLINE, md, "inline"), "mathematics", 185)


def makeExtension(**settings: Any) -> Mathematics:
    return Mathematics(**settings)
