"""A dashboard that a proxy has under a path of its own, whether the proxy takes the path off or not."""

from __future__ import annotations

import asyncio
import re

import pytest
from click.testing import CliRunner
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp

from service.front.cli.main import main
from service.front.dashboard.app import Rooted, make_app
from service.front.dashboard.link import Link
from service.front.dashboard.live import Live, Rates
from service.front.dashboard.site import Site, under
from service.remote.client import NoAnswer

OWN = re.compile(r'\s(?:href|action|src|data-part)="(/[^"]*)"')


class Away:
    """A client of a service that is not there."""

    def __getattr__(self, name: str):
        def ask(*values, **more):
            raise NoAnswer("nobody is there")

        return ask


async def get(app: ASGIApp, path: str) -> tuple[int, str]:
    """Status and body of the answer."""
    sent: list[dict] = []

    async def send(message) -> None:
        sent.append(message)

    async def receive() -> dict:
        await asyncio.Event().wait()  # the browser stays
        return {"type": "http.disconnect"}

    path, _, query = path.partition("?")
    scope = {
        "type": "http",
        "method": "GET",
        "path": path,
        "query_string": query.encode(),
        "headers": [(b"host", b"127.0.0.1:1")],
    }
    await app(scope, receive, send)
    return sent[0]["status"], b"".join(message.get("body", b"") for message in sent[1:]).decode()


def test_every_address_of_a_page_is_below_the_root_and_is_answered():
    async def look() -> None:
        rates = Rates()
        site = Site(Link(Away()), Live(Away(), rates), rates, root="/lab/tailroad")  # type: ignore[arg-type]
        app, found = make_app(site), set()
        for page in ("/", "/compare", "/glossary", "/jobs/j1/verdict", "/jobs/j1/parameters"):
            taken_off, left_on = await get(app, page), await get(app, "/lab/tailroad" + page)
            assert left_on[0] == taken_off[0] == 200
            addresses = OWN.findall(left_on[1])
            assert addresses
            assert all(address.startswith("/lab/tailroad/") for address in addresses), addresses
            found.update(addresses)
        for address in sorted(found):
            if "/static/" in address:
                assert (await get(app, address))[0] == 200, address
        site.link.close()

    asyncio.run(look())


def test_only_the_root_itself_is_taken_off():
    async def echo(scope, receive, send):
        await PlainTextResponse(scope["path"])(scope, receive, send)

    async def ask(path: str) -> str:
        return (await get(Rooted(echo, "/lab"), path))[1]

    asked = {"/lab/jobs": "/jobs", "/lab": "/", "/jobs": "/jobs", "/labour/jobs": "/labour/jobs"}
    assert {path: asyncio.run(ask(path)) for path in asked} == asked


def test_addresses_of_others_and_texts_stay_as_they_are():
    html = '<a href="https://x.example/jobs">/jobs</a> <a href="//x/y">z</a> <p>href=&#34;/jobs&#34;</p>'
    assert under("/lab", html) == html
    assert under("/lab", '<a class="b" href="/jobs">') == '<a class="b" href="/lab/jobs">'


@pytest.mark.parametrize("root", ["lab", "/a b", '/"x', "//x"])
def test_a_root_that_is_no_path_is_refused(root: str):
    result = CliRunner().invoke(main, ["dashboard", "--root", root])
    assert result.exit_code == 2
    assert "give a path, as in /tailroad" in result.output
