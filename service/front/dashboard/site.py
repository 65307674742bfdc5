"""What all pages share: the line to the service, what jobs told, and how a page is put together of parts.

A part is a piece of a page that is drawn by itself: it comes with the page where it is ready in time, else the browser
asks for it; and the browser asks again when a job tells one of `kinds`.
"""

import asyncio
import hashlib
import logging
import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from service.analysis import wording
from service.front.dashboard import glossary
from service.front.dashboard.book import Book
from service.front.dashboard.link import Link
from service.front.dashboard.live import Live, Rates
from service.front.dashboard.trouble import Trouble, failed_part, trouble_of
from service.remote.client import NoAnswer, Refused

log = logging.getLogger("tailroad.dashboard")

FIRST_PAINT_S = 0.4  # that a page waits for its parts
Load = Callable[["Site", Request], Awaitable[dict[str, Any]]]
# attributes whose values are addresses; what was told by others cannot hold one, as its quotes are escaped
ADDRESS = re.compile(
    r'(\s(?:href|src|action|formaction|data-(?:part|playback|camera|film|scatter|rollouts))=")(/(?!/))'
)
THEMES = ("light", "dark")
STATUS_KINDS = ("status",)


@dataclass(frozen=True)
class Part:
    """A part of a page that is drawn again by itself.

    load: what its template parts/NAME.html needs, with again_s where it is not all there yet
    kinds: of events after which it is drawn again
    label: for those who hear the page
    every_s: drawn again so often in any case
    """

    name: str
    label: str
    load: Load
    kinds: tuple[str, ...] = STATUS_KINDS
    every_s: float | None = None


@dataclass
class Site:
    link: Link
    live: Live
    rates: Rates
    read_only: bool = False
    book: Book = field(default_factory=Book)
    root: str = ""  # path that a proxy has this dashboard under, without a slash at its end

    def __post_init__(self) -> None:
        self.templates = Environment(
            loader=PackageLoader("service.front.dashboard"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        self.templates.globals |= {
            "root": self.root,
            "static": static_address,
            "read_only": self.read_only,
            "words": wording,
        }
        self.templates.globals["glossary"] = glossary
        self.templates.globals["tailroad_version"] = version("tailroad")

    def draw(self, template: str, values: Mapping[str, Any]) -> str:
        return under(self.root, self.templates.get_template(template).render(values))

    async def draw_part(self, part: Part, request: Request) -> tuple[int, str, float | None]:
        """Status, HTML, and after how many seconds to ask again. A part that fails says so in its own place."""
        try:
            values = await part.load(self, request)
            again_s = values.pop("again_s", part.every_s)
            return 200, self.draw(f"parts/{part.name}.html", values), again_s
        except (Refused, NoAnswer) as error:
            trouble = trouble_of(error)
        except Exception:  # a fault of ours: the rest of the page is good
            log.exception("part %s of page %s", part.name, request.url.path)
            trouble = failed_part(part.label)
        return trouble.status, self.draw("parts/trouble.html", {"trouble": trouble}), trouble.again_s

    async def page(
        self,
        request: Request,
        template: str,
        parts: Sequence[Part] = (),
        values: Mapping[str, Any] | None = None,
        status: int = 200,
    ) -> Response:
        """A whole page; `part(NAME)` in its template puts one of the parts in its place."""
        mark = self.live.mark  # before anything is asked: what happens while the page is drawn is told to it
        tasks = {part.name: asyncio.create_task(self.draw_part(part, request)) for part in parts}
        if tasks:
            await asyncio.wait(tasks.values(), timeout=FIRST_PAINT_S)
        frames = {part.name: self._frame(part, request, tasks[part.name]) for part in parts}
        values = {
            **(values or {}),
            "part": frames.__getitem__,
            "here": self.link.here,
            "reason": self.link.reason,
            "path": request.url.path,
            "mark": mark,
            "theme": theme_of(request),
        }
        return HTMLResponse(self.draw(template, values), status)

    def _frame(
        self, part: Part, request: Request, task: "asyncio.Task[tuple[int, str, float | None]]"
    ) -> Markup:
        done = task.done() and task.exception() is None
        html, again_s = (Markup(task.result()[1]), task.result()[2]) if done else (None, 0.0)
        if not task.done():
            task.add_done_callback(lambda late: late.exception())  # told when the browser asks for it
        address = request.url.path.rstrip("/") + f"/parts/{part.name}"
        query = f"?{request.url.query}" if request.url.query else ""
        values = {"part": part, "address": address + query, "html": html, "again_s": again_s}
        return Markup(self.draw("part.html", values))

    def trouble_page(self, request: Request, trouble: Trouble) -> Response:
        values = {
            "trouble": trouble,
            "here": self.link.here,
            "reason": self.link.reason,
            "path": request.url.path,
            "mark": self.live.mark,
            "theme": theme_of(request),
        }
        return HTMLResponse(self.draw("trouble.html", values), trouble.status)


def under(root: str, html: str) -> str:
    """The HTML with all its own addresses below a root."""
    return ADDRESS.sub(lambda found: found[1] + root + found[2], html) if root else html


def theme_of(request: Request) -> str:
    """What the reader has chosen in this browser; "": as the system has it."""
    chosen = request.cookies.get("tailroad-theme", "")
    return chosen if chosen in THEMES else ""


def _digests() -> dict[str, str]:
    folder = files("service.front.dashboard") / "static"
    return {f.name: hashlib.sha256(f.read_bytes()).hexdigest()[:12] for f in folder.iterdir() if f.is_file()}


DIGESTS = _digests()


def static_address(name: str) -> str:
    """Where a file of static/ is, with what it holds in the address: browsers may keep it for good."""
    return f"/static/{name}?v={DIGESTS[name]}"
