"""Runs the tutorials: the Python of each page, from top to bottom, in an empty folder; what it prints stands below it.

python -m docs.site.tutorials [PAGE ...]    writes the output on the pages anew

A block of code begins with ```python; what it prints is the ```text block that follows it.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import msgspec

from docs.site.gather import ROOT

PAGES = sorted((ROOT / "docs" / "tutorials").glob("[0-9]*.md"))
_BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", re.S | re.M)


def code_of(page: str) -> list[str]:
    """The page's blocks of Python."""
    return [m.group(1) for m in _BLOCK.finditer(page)]


def shown_on(page: str) -> list[str]:
    """What the page says that each block prints."""
    return [m.group(2) or "" for m in _BLOCK.finditer(page)]


def with_outputs(page: str, outputs: list[str]) -> str:
    """The page with these outputs below its blocks."""
    left = iter(outputs)

    def block(match: re.Match[str]) -> str:
        printed = next(left)
        return f"```python\n{match.group(1)}```\n" + (f"\n```text\n{printed}```\n" if printed else "")

    return _BLOCK.sub(block, page)


def outputs_of(page: str) -> list[str]:
    """What each block prints, run in a process and an empty folder of its own. Raises RuntimeError where one fails."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-m", "docs.site.tutorials", "--run"],
            input=msgspec.json.encode(code_of(page)),
            capture_output=True,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
    if done.returncode:
        raise RuntimeError(done.stderr.decode())
    return msgspec.json.decode(done.stdout.splitlines()[-1], type=list[str])


def _run(blocks: list[str]) -> list[str]:
    """Run the blocks one after the other, as one program."""
    names = {"__name__": "__main__"}
    printed = []
    for number, block in enumerate(blocks):
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(block, f"block {number}", "exec"), names)
        printed.append(out.getvalue())
    return printed


def main(arguments: list[str]) -> None:
    if arguments == ["--run"]:
        printed = _run(msgspec.json.decode(sys.stdin.buffer.read(), type=list[str]))
        sys.stdout.write(msgspec.json.encode(printed).decode() + "\n")
        return
    for path in [Path(a) for a in arguments] or PAGES:
        page = path.read_text(encoding="utf-8")
        path.write_text(with_outputs(page, outputs_of(page)), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
