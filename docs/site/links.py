"""Where the links of a Markdown page lead: found, and rewritten, outside of code."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import PurePosixPath

_FENCE = re.compile(r"^(\s*)(```+|~~~+)")
_CODE = re.compile(r"(`+)(?!`).+?(?<!`)\1(?!`)", re.DOTALL)
_LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\[\]]*\])*\]\()([^()\s]+)((?:\s+\"[^\"]*\")?\))")
_ELSEWHERE = re.compile(r"^[a-z][a-z+.-]*:|^#|^//")


def rewritten(text: str, to: Callable[[str], str]) -> str:
    """The page with the target of each link within the repository replaced by `to(target)`."""
    done: list[str] = []
    paragraph: list[str] = []
    fence = ""
    for line in [*text.split("\n"), None]:
        opened = _FENCE.match(line) if line is not None else None
        if fence or opened or not line:
            if paragraph:
                done.append(_outside_code("\n".join(paragraph), to))
                paragraph = []
            if opened:
                mark = opened.group(2)[:3]
                fence = mark if not fence else "" if mark == fence else fence
            if line is not None:
                done.append(line)
        else:
            paragraph.append(line)
    return "\n".join(done)


def _outside_code(paragraph: str, to: Callable[[str], str]) -> str:
    kept: list[str] = []

    def hide(match: re.Match[str]) -> str:
        kept.append(match.group())
        return f"\0{len(kept) - 1}\0"

    def replace(match: re.Match[str]) -> str:
        before, target, after = match.groups()
        return match.group() if _ELSEWHERE.match(target) else f"{before}{to(target)}{after}"

    hidden = _LINK.sub(replace, _CODE.sub(hide, paragraph))
    return re.sub(r"\0(\d+)\0", lambda m: kept[int(m.group(1))], hidden)


def resolved(page: PurePosixPath, target: str) -> tuple[PurePosixPath, str]:
    """What `target`, written on `page`, names: the path from the repository's root, and the anchor with its #."""
    path, mark, anchor = target.partition("#")
    whole = os.path.normpath(page.parent / path) if path else str(page)
    return PurePosixPath(whole), mark + anchor


def relative(page: PurePosixPath, to: PurePosixPath) -> str:
    """The link from one file of the site to another."""
    return os.path.relpath(to, page.parent).replace(os.sep, "/")
