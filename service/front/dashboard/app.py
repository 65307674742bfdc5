"""Which address shows what."""

import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from functools import partial
from typing import Any
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from service.analysis.rollout_files import SUFFIXES
from service.front.dashboard.files import Files
from service.front.dashboard.forms import all_sent, local_path, sent
from service.front.dashboard.guard import Guard
from service.front.dashboard.pages import (
    compare,
    failures,
    fleet,
    job,
    jobs,
    learned,
    parameters,
    risk,
    rollout,
    rollouts,
    submit,
    verdict,
)
from service.front.dashboard.pages import log as job_log
from service.front.dashboard.site import Part, Site
from service.front.dashboard.trouble import Trouble, trouble_of
from service.remote.client import Client, NoAnswer, Refused

log = logging.getLogger("tailroad.dashboard")

Handler = Callable[[Request], Awaitable[Response]]


class ImmutableFiles(StaticFiles):
    """Files whose address changes with what they hold, and those that such a script imports, whose does not."""

    def file_response(
        self, full_path: Any, stat_result: Any, scope: Any, *args: Any, **kwargs: Any
    ) -> Response:
        response = super().file_response(full_path, stat_result, scope, *args, **kwargs)
        named = b"v=" in scope.get("query_string", b"")
        response.headers["cache-control"] = "public, max-age=31536000, immutable" if named else "no-cache"
        return response


class Rooted:
    """Takes a root from the paths of requests, where a proxy has left it there."""

    def __init__(self, app: ASGIApp, root: str):
        self._app, self._root = app, root

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._root and scope["type"] == "http" and f"{scope['path']}/".startswith(f"{self._root}/"):
            scope = {**scope, "path": scope["path"].removeprefix(self._root) or "/"}
        await self._app(scope, receive, send)


def make_app(site: Site, names: Sequence[str] = ()) -> ASGIApp:
    """The dashboard as an ASGI application. names: host names that it may be called by."""

    workers = fleet.FleetPage()
    files, job_parts = Files(site), (*job.PARTS, learned.LEARNED)

    def back_to(path: str, status: int = 303) -> Response:
        return RedirectResponse(site.root + path, status)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        site.live.start()
        site.link.start()
        yield

    def parts(path: str, *known: Part) -> Route:
        """The parts of the page at path, each by itself."""
        by_name = {part.name: part for part in known}

        async def answer(request: Request) -> Response:
            part = by_name.get(request.path_params["part"])
            if part is None:
                raise HTTPException(404)
            status, html, again_s = await site.draw_part(part, request)
            headers = {} if again_s is None else {"retry-after": f"{again_s:.3f}"}
            return HTMLResponse(html, status, headers)

        return Route(f"{path.rstrip('/')}/parts/{{part}}", answer)

    async def jobs_page(request: Request) -> Response:
        return await site.page(request, "jobs.html", [jobs.TABLE])

    async def job_page(request: Request) -> Response:
        found = await known_job(request)
        return await site.page(request, "job.html", job_parts, found)

    async def known_job(request: Request) -> dict[str, Any]:
        """What the frame of a job's page needs; a job that there is not is told at once."""
        name = request.path_params["job"]
        try:
            found = await job.named(site, name)
        except NoAnswer:
            return {"job": name, "title": "Job"}  # its parts come when the service is back
        return {"job": name, "title": found.label or name}

    async def failures_page(request: Request) -> Response:
        return await site.page(request, "failures.html", failures.PARTS, await known_job(request))

    async def rollouts_page(request: Request) -> Response:
        return await site.page(request, "rollouts.html", rollouts.PARTS, await known_job(request))

    async def parameters_page(request: Request) -> Response:
        return await site.page(request, "parameters.html", parameters.PARTS, await known_job(request))

    async def verdict_page(request: Request) -> Response:
        return await site.page(request, "verdict.html", verdict.PARTS, await known_job(request))

    async def glossary_page(request: Request) -> Response:
        return await site.page(request, "glossary.html")

    async def log_page(request: Request) -> Response:
        return await site.page(request, "log.html", job_log.PARTS, await known_job(request))

    async def risk_page(request: Request) -> Response:
        values = await known_job(request) | risk.form_values(request)
        return await site.page(request, "risk.html", risk.PARTS, values)

    async def fleet_page(request: Request) -> Response:
        return await site.page(request, "fleet.html", workers.parts)

    async def compare_page(request: Request) -> Response:
        return await site.page(request, "compare.html", compare.PARTS)

    async def rollout_page(request: Request) -> Response:
        asked = rollout.Asked(request)
        beside = await rollout.beside(site, asked, request.query_params.get("beside", ""))
        values = await known_job(request) | {
            "asked": asked,
            "beside": beside,
            "formats": {form: (SUFFIXES[form], said) for form, said in rollout.SAID.items()},
        }
        return await site.page(request, "rollout.html", rollout.PARTS, values)

    async def submit_page(request: Request) -> Response:
        form = await submit.empty_form(site, await submit.liked(site, request))
        if request.method != "POST":
            return await site.page(request, "submit.html", submit.PARTS, {"form": form})
        form = submit.filled(form, await sent(request))
        made = None
        if not form.wrong:
            made, form = await submit.submit(site, form)
        if made is None:
            return await site.page(request, "submit.html", submit.PARTS, {"form": form}, 422)
        return back_to(f"/jobs/{quote(made.id, safe='')}", 303)

    async def order(request: Request) -> Response:
        name, what = request.path_params["job"], request.path_params["order"]
        order = {"cancel": Client.cancel, "pause": Client.pause, "resume": Client.resume}.get(what)
        if order is None:
            raise HTTPException(404)
        back = local_path((await sent(request)).get("back", ""), f"/jobs/{quote(name, safe='')}")
        await site.link.order(lambda client: order(client, name))
        return back_to(back, 303)

    async def chosen(request: Request) -> Response:
        """One order for all the jobs that were chosen in the list."""
        fields = await all_sent(request)
        given, names = dict(fields), [value for name, value in fields if name == "jobs"]
        orders = jobs.orders_on(given.get("order", ""), given.get("tag", ""))
        if orders is None:
            raise HTTPException(404)
        known = {one.id: one for one in await jobs.all_jobs(site)}
        for name in names[: jobs.ROWS]:
            if name in known:
                await site.link.order(partial(orders, job=known[name]))
                site.book.noted(name)
        return back_to(local_path(given.get("back", ""), "/"), 303)

    async def note(request: Request) -> Response:
        name, given = request.path_params["job"], await sent(request)
        text, tags = given.get("text", "").strip(), given.get("tags", "").split(",")
        archived = given.get("archived") == "1"
        await site.link.order(lambda client: client.note(name, text, tags, archived))
        site.book.noted(name)
        return back_to(f"/jobs/{quote(name, safe='')}", 303)

    async def events(request: Request) -> Response:
        if site.live.full:
            return PlainTextResponse("Too many pages are open.\n", 503)
        since = request.headers.get("last-event-id") or request.query_params.get("since", "")
        stream = site.live.stream(request.query_params.get("job"), site.link.here, since)
        return StreamingResponse(stream, media_type="text/event-stream")

    async def trouble(request: Request, error: Exception) -> Response:
        return site.trouble_page(request, trouble_of(error))

    async def wrong_address(request: Request, error: Exception) -> Response:
        status = error.status_code if isinstance(error, HTTPException) else 500
        if status == 404:
            text = f"There is no page {request.url.path[:200]}."
            return site.trouble_page(request, Trouble(404, "No such page", text, "The links above lead on."))
        return PlainTextResponse(f"{getattr(error, 'detail', 'error')}\n", status)

    async def failed(request: Request, error: Exception) -> Response:
        log.exception("page %s", request.url.path, exc_info=error)
        text = "The dashboard failed on this page; its log says more. The jobs go on."
        return site.trouble_page(request, Trouble(500, "The dashboard failed", text))

    routes = [
        Route("/", jobs_page),
        parts("/", jobs.TABLE),
        Route("/submit", submit_page, methods=["GET", "POST"]),
        parts("/submit", *submit.PARTS),
        Route("/chosen", chosen, methods=["POST"]),
        Route("/jobs/{job}", job_page),
        Route("/jobs/{job}/note", note, methods=["POST"]),
        Route("/jobs/{job}/{order}", order, methods=["POST"]),
        parts("/jobs/{job}", *job_parts),
        Route("/jobs/{job}/failures", failures_page),
        parts("/jobs/{job}/failures", *failures.PARTS),
        Route("/jobs/{job}/rollouts", rollouts_page),
        parts("/jobs/{job}/rollouts", *rollouts.PARTS),
        Route("/jobs/{job}/parameters", parameters_page),
        parts("/jobs/{job}/parameters", *parameters.PARTS),
        Route("/jobs/{job}/scatter.json", files.scatter),
        Route("/glossary", glossary_page),
        Route("/jobs/{job}/verdict", verdict_page),
        parts("/jobs/{job}/verdict", *verdict.PARTS),
        Route("/jobs/{job}/log", log_page),
        parts("/jobs/{job}/log", *job_log.PARTS),
        Route("/jobs/{job}/risk", risk_page),
        parts("/jobs/{job}/risk", *risk.PARTS),
        Route("/fleet", fleet_page),
        parts("/fleet", *workers.parts),
        Route("/compare", compare_page),
        parts("/compare", *compare.PARTS),
        Route("/jobs/{job}/rollouts/{row}", rollout_page),
        parts("/jobs/{job}/rollouts/{row}", *rollout.PARTS),
        Route("/jobs/{job}/rollouts/{row}/playback.json", files.playback),
        Route("/jobs/{job}/rollouts/{row}/camera.json", files.camera),
        Route("/jobs/{job}/rollouts/{row}/export/{form}", files.export),
        Route("/jobs/{job}/scenario.toml", files.scenario),
        Route("/jobs/{job}/report", files.report),
        Route("/jobs/{job}/report.json", files.report_json),
        Route("/live", events),
        Mount("/static", ImmutableFiles(packages=[("service.front.dashboard", "static")])),
    ]
    handlers = {Refused: trouble, NoAnswer: trouble, HTTPException: wrong_address, Exception: failed}
    app = Starlette(routes=routes, lifespan=lifespan, exception_handlers=handlers)
    return Rooted(Guard(app, names, site.read_only), site.root)
