"""What is fetched rather than shown as a page: a rollout for the player, its exports, reports."""

import asyncio
import re
import time
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import msgspec
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from service.analysis.rollout_files import FORMATS
from service.front.dashboard.pages import parameters, rollout
from service.front.dashboard.site import Site
from service.front.dashboard.trouble import PASSING, trouble_of
from service.remote.client import Client, Refused

T = TypeVar("T")
PATIENCE_S = 600.0  # that a download waits until it is made
PAUSE_S = 1.0
SANDBOX = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"  # of a report that is opened in place


class Files:
    """Answers with files."""

    def __init__(self, site: Site):
        self._site = site

    async def playback(self, request: Request) -> Response:
        return await _json(lambda: rollout.played(self._site, rollout.Asked(request)), "playback")

    async def camera(self, request: Request) -> Response:
        return await _json(lambda: rollout.photographed(self._site, rollout.Asked(request)), "camera")

    async def scatter(self, request: Request) -> Response:
        return await _json(lambda: parameters.scatter(self._site, request))

    async def export(self, request: Request) -> Response:
        asked, form = rollout.Asked(request), request.path_params["form"]
        if form not in FORMATS:
            raise HTTPException(404)
        media, suffix = FORMATS[form]
        body = await self._patiently(
            lambda client: client.export(asked.job, asked.row, form, asked.phase, asked.iteration)
        )
        return _download(body, f"{asked.job}-{asked.row}{suffix}", media)

    async def scenario(self, request: Request) -> Response:
        job = request.path_params["job"]
        found = await self._patiently(lambda client: client.scenario(job))
        return _download(found.text.encode(), f"{found.name}.toml", FORMATS["scenario"][0])

    async def report(self, request: Request) -> Response:
        job = request.path_params["job"]
        body = await self._patiently(lambda client: client.report(job).encode())
        return _download(body, f"tailroad-{job}.html", "text/html; charset=utf-8")

    async def report_json(self, request: Request) -> Response:
        job = request.path_params["job"]
        body = await self._patiently(lambda client: client.get(f"jobs/{job}/report.json"))
        return _download(body, f"tailroad-{job}.json", "application/json")

    async def _patiently(self, ask: Callable[[Client], T]) -> T:
        """The answer when it is made; the browser waits."""
        until = time.monotonic() + PATIENCE_S
        while True:
            try:
                return await self._site.link.once(ask)
            except Refused as refused:
                if refused.kind not in PASSING or time.monotonic() > until:
                    raise
                await asyncio.sleep(refused.problem.retry_after_s or PAUSE_S)


async def _json(ask: Callable[[], Awaitable[Any]], part: str = "") -> Response:
    """An answer, or one part of it, for the page's script; a problem with its status, and when to ask again."""
    try:
        found = await ask()
        found = getattr(found, part) if part else found
    except Refused as refused:
        trouble = trouble_of(refused)
        headers = {} if trouble.again_s is None else {"retry-after": f"{trouble.again_s:.3f}"}
        body = msgspec.json.encode({"title": trouble.title, "text": trouble.text})
        return Response(body, trouble.status, headers, "application/json")
    return Response(msgspec.json.encode(found), media_type="application/json")


def _download(body: bytes, name: str, media: str) -> Response:
    plain = re.sub(r"[^A-Za-z0-9._-]", "-", name)
    headers = {"content-disposition": f'attachment; filename="{plain}"', "content-security-policy": SANDBOX}
    return Response(body, headers=headers, media_type=media)
