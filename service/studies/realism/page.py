"""The card as an HTML page: facts and pictures put into the template, everything from outside escaped."""

from pathlib import Path
from typing import Any

from markupsafe import Markup

from policies.realism.measures import QUANTITIES
from policies.realism.tails import GAPS, SHARES
from service.analysis.report import ink, page
from service.studies.realism import figures
from service.studies.realism.words import caveats, verdict

FOLDER = Path(__file__).parent


def page_of(facts: dict[str, Any]) -> str:
    """The page, self-contained: style and pictures are inside it."""
    environment = page.environment_of(FOLDER / "templates", page.FOLDER / "templates")
    environment.filters |= {"number": number, "share": share, "span": span}
    return environment.get_template("card.html").render(
        facts=facts,
        style=Markup((page.FOLDER / "style.css").read_text(encoding="utf-8")),
        verdict=verdict(facts),
        caveats=caveats(facts),
        errors={site: figures.error_pictures(facts, site, "twenty") for site in facts["sites"]},
        distributions={site: figures.distribution_pictures(facts, site) for site in facts["sites"]},
        lane_changes=figures.lane_change_picture(facts),
        quantities=QUANTITIES,
        tail_shares=SHARES,
        tail_gaps=GAPS,
        error_labels=figures.ERRORS,
        colours={m: figures.line(facts, m)["color"] for m in facts["labels"]},
        width=ink.WIDTH_IN,
        player="",
    )


def number(value: float | None, digits: int = 3) -> str:
    """A number with `digits` significant digits, "-" for none."""
    if value is None:
        return "-"
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e" in text and abs(value) >= 1 else text


def share(value: float | None) -> str:
    """A share in percent; small ones keep two digits."""
    if value is None:
        return "-"
    percent = 100.0 * value
    return f"{percent:.2g}%" if percent < 10.0 else f"{percent:.0f}%"


def span(interval: list[float | None], say: str = "number") -> str:
    """An interval in words."""
    text = share if say == "share" else number
    return f"{text(interval[0])} to {text(interval[1])}"
