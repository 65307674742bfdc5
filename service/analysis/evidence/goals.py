"""The claims as a goal structure (GSN Community Standard, version 3): goals, strategy, solutions, context, assumptions.

In Markdown for people and as a picture (.svg): goals are rectangles, strategies parallelograms, solutions circles,
context rounded boxes, assumptions ellipses with an A.
"""

import io
import textwrap
from collections.abc import Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyBboxPatch, Patch, Polygon, Rectangle

from service.analysis.evidence.objects import KEY, MANIFEST, Claims, Group

WIDE, HIGH = 4.2, 2.3  # of a cell
INK, PAPER = "#1b1b1b", "#ffffff"


def markdown(claims: Claims) -> str:
    """The page: the goal structure, each claim with its evidence and the command that makes it again."""
    lines = [
        f"# {claims.title}",
        "",
        f"Made by tailroad on {claims.made}. `tailroad verify FOLDER` checks every file and runs a sample of the",
        f"rollouts again, bit for bit; `minisign -Vm {MANIFEST} -p {KEY}` checks the signature without tailroad. The",
        "commands below make each claim again; run them in a copy of the folder, which they write to.",
        "",
        "![The goal structure](goals.svg)",
        "",
        "## Goal structure (GSN)",
        "",
        f"- **G1** (goal) {claims.title}: what is claimed below is supported.",
        "  - **S1** (strategy) Argument over the runs: for each, how probable danger is, how it fails, how severe it "
        "is and what a competent driver would have prevented.",
    ]
    for group in claims.groups:
        lines += _group(group)
    return "\n".join(lines) + "\n"


def _group(group: Group) -> list[str]:
    lines = [f"    - **{group.id}** (goal) {group.says}"]
    lines += [f"      - **C{group.id[1:]}.{i}** (context) {text}" for i, text in enumerate(group.context, 1)]
    lines += [
        f"      - **A{group.id[1:]}.{i}** (assumption) {text}" for i, text in enumerate(group.assumptions, 1)
    ]
    lines += [f"      - **Warning** {text}" for text in group.warnings]
    for claim in group.claims:
        lines.append(f"      - **{claim.id}** (goal) {claim.says}")
        lines.append(f"        - **Sn{claim.id[1:]}** (solution) [{claim.file}]({claim.file})")
        if claim.command:
            lines.append(f"          - again: `{claim.command}`")
    return lines


def picture(claims: Claims) -> bytes:
    """The same as a picture (.svg)."""
    columns = [max(len(group.claims), 1) for group in claims.groups]
    width = max(sum(columns), 1) + 1
    figure = Figure(figsize=(0.62 * WIDE * width, 0.9 * HIGH * 5))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, WIDE * width)
    axes.set_ylim(-HIGH * 5, 0.2)
    axes.axis("off")
    middle = 0.5 * WIDE * width
    _node(axes, "goal", middle, -0.5 * HIGH, "G1", claims.title)
    _node(axes, "strategy", middle, -1.5 * HIGH, "S1", "Argument over the runs")
    _arrow(axes, middle, -0.5 * HIGH, middle, -1.5 * HIGH)
    left = 0.5 * WIDE
    for group, wide in zip(claims.groups, columns, strict=True):
        at = left + 0.5 * WIDE * wide
        _node(axes, "goal", at, -2.5 * HIGH, group.id, group.says)
        _arrow(axes, middle, -1.5 * HIGH, at, -2.5 * HIGH)
        for i, claim in enumerate(group.claims):
            x = left + (i + 0.5) * WIDE
            _node(axes, "goal", x, -3.5 * HIGH, claim.id, claim.says)
            _arrow(axes, at, -2.5 * HIGH, x, -3.5 * HIGH)
            _node(axes, "solution", x, -4.5 * HIGH, f"Sn{claim.id[1:]}", claim.file.rpartition("/")[2])
            _arrow(axes, x, -3.5 * HIGH, x, -4.5 * HIGH)
        left += WIDE * wide
    _beside(axes, claims.groups)
    out = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "tailroad", "svg.fonttype": "none"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()


def _beside(axes: Axes, groups: Sequence[Group]) -> None:
    """Context and assumptions of all, on the left of the top goal and the strategy."""
    context = sum(len(group.context) for group in groups)
    assumed = sum(len(group.assumptions) for group in groups)
    _node(axes, "context", 0.5 * WIDE, -0.5 * HIGH, "C", f"{context} statements of context: see README.md")
    _node(axes, "assumption", 0.5 * WIDE, -1.5 * HIGH, "A", f"{assumed} assumptions: see README.md")


def _node(axes: Axes, kind: str, x: float, y: float, name: str, text: str) -> None:
    w, h = 0.86 * WIDE, 0.66 * HIGH
    shape: Patch
    if kind == "goal":
        shape = Rectangle((x - 0.5 * w, y - 0.5 * h), w, h)
    elif kind == "strategy":
        lean = 0.12 * w
        shape = Polygon([(x - 0.5 * w + lean, y + 0.5 * h), (x + 0.5 * w + lean, y + 0.5 * h),
                         (x + 0.5 * w - lean, y - 0.5 * h), (x - 0.5 * w - lean, y - 0.5 * h)])  # fmt: skip
    elif kind == "solution":
        shape = Circle((x, y), 0.46 * HIGH)
    elif kind == "context":
        shape = FancyBboxPatch((x - 0.42 * w, y - 0.3 * h), 0.84 * w, 0.6 * h, boxstyle="round,pad=0.2")
    else:
        shape = Ellipse((x, y), w, h)
        axes.text(x + 0.5 * w, y - 0.5 * h, "A", fontsize=7, zorder=3)
    shape.set(facecolor=PAPER, edgecolor=INK, linewidth=0.9, zorder=2)
    axes.add_patch(shape)
    cut = textwrap.wrap(text, 34 if kind != "solution" else 17)
    words = "\n".join(cut[:5]) + (" …" if len(cut) > 5 else "")
    axes.text(x, y, f"{name}\n{words}", ha="center", va="center", fontsize=6.5, color=INK, zorder=3,
              parse_math=False)  # fmt: skip


def _arrow(axes: Axes, x: float, y: float, to_x: float, to_y: float) -> None:
    axes.annotate(
        "", (to_x, to_y + 0.36 * HIGH), (x, y - 0.34 * HIGH), zorder=1,
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 0.8},
    )  # fmt: skip
