"""The guides for newcomers: every command in them exists; `make guides` runs them all."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

from service.front.cli.main import main

ROOT = Path(__file__).parents[2]
GUIDES = sorted(p for p in (ROOT / "deploy" / "guides").glob("*.md") if p.name != "README.md")
# one vehicle of an NGSIM file: 18 columns, feet, a line each tenth of a second
NGSIM_LINE = (
    "{v} {k} 300 {ms} {x:.3f} {y:.3f} 6042842.0 2133118.0 14.3 6.4 2 {speed:.2f} 0.00 {lane} 0 0 0.00 0.00\n"
)


def blocks(guide: Path, kind: str = "sh") -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```", guide.read_text(encoding="utf-8"), re.S | re.M)


def commands() -> list[tuple[str, list[str]]]:
    """Every tailroad command line of the guides, in blocks and in text."""
    found = []
    for guide in GUIDES:
        text = "\n".join([*blocks(guide), *blocks(guide, "text")]).replace("\\\n", " ")
        text += "\n" + "\n".join(re.findall(r"`(tailroad [^`]*)`", guide.read_text(encoding="utf-8")))
        for line in re.findall(r"tailroad ([a-z].*?)(?: \|\|| >| &|\)|$)", text.replace("\n'", " '"), re.M):
            found.append((guide.stem, shlex.split(line.replace("\n", " "), comments=True)))
    return found


@pytest.mark.parametrize(
    ("guide", "words"), commands(), ids=lambda v: v if isinstance(v, str) else " ".join(v)
)
def test_commands_in_the_guides_exist_with_their_options(guide, words):
    trains = words[0] == "train"  # its options are the training script's
    words, command = list(words), main
    while isinstance(command, click.Group):
        command = command.get_command(click.Context(command), words.pop(0))
    assert command is not None, guide
    if trains:
        return
    options = {word.split("=")[0] for word in words if word.startswith("--")}
    assert options <= {name for p in command.params for name in p.opts}, guide


def test_links_in_the_guides_lead_somewhere():
    for guide in GUIDES:
        for target in re.findall(r"\]\(([^)#:]+?)(?:#[^)]*)?\)", guide.read_text(encoding="utf-8")):
            assert (guide.parent / target).exists(), f"{guide.name}: {target}"


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("guide", GUIDES, ids=lambda g: g.stem)
def test_the_guides_can_be_followed_word_by_word(guide, tmp_path):
    """Its blocks, one after the other, by a stranger's shell in an empty folder."""
    lines = [
        NGSIM_LINE.format(v=v, k=k, ms=1113433135300 + 100 * k, x=6.0 + 12 * (v % 6), y=100.0 * v + 3.0 * k,
                          speed=30.0, lane=1 + v % 6)
        for v in range(1, 8)
        for k in range(1, 60)
    ]  # fmt: skip
    (tmp_path / "trajectories-0400-0415.txt").write_text("".join(lines), encoding="utf-8")
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
    }
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", "\n".join(blocks(guide))],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
