"""Who may ask the dashboard, and the headers that every answer has.

The dashboard has no log-in: whoever reaches its address may use it. What is kept out is other people's web pages in the
user's own browser: names that were made to point at this machine (DNS rebinding) by the Host header, forms and requests
of other sites by Origin and Sec-Fetch-Site, scripts in what the service tells by the content security policy.
"""

from collections.abc import Iterable

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.remote.api.hosts import host_name, is_address

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",  # with none, forms would come without their origin
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
LOCAL_NAMES = ("localhost",)
# Sec-Fetch-Site of a page's own requests, and of an address that somebody typed
SAME = (
    "same-origin",
    "none",
)


class Guard:
    """Passes on what may pass.

    names: host names, beside localhost and any IP address, that browsers may call this by
    read_only: nothing may be changed
    """

    def __init__(self, app: ASGIApp, names: Iterable[str] = (), read_only: bool = False):
        self._app, self._read_only = app, read_only
        self._names = frozenset(name.lower().rstrip(".") for name in (*LOCAL_NAMES, *names))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("cache-control", "no-store")
            await send(message)

        refusal = self._refusal(scope["method"], Headers(scope=scope))
        answer = self._app if refusal is None else PlainTextResponse(refusal[1] + "\n", refusal[0])
        await answer(scope, receive, send_with_headers)

    def _refusal(self, method: str, headers: Headers) -> tuple[int, str] | None:
        """Status and reason, where the request may not pass."""
        hosts = headers.getlist("host")
        name = host_name(hosts[0]) if len(hosts) == 1 else None
        if name is None or not (name in self._names or is_address(name)):
            return 421, (
                "This address is not one that the dashboard answers for. Use localhost or the machine's IP address, or "
                "start it with --name NAME."
            )
        site = headers.get("sec-fetch-site", "none")
        if method in ("GET", "HEAD"):
            if site not in SAME and headers.get("sec-fetch-mode") != "navigate":
                return 403, "Other sites' pages may not read this."
            return None
        if method != "POST":
            return 405, "This is read with GET and told with POST."
        origin = headers.get("origin", "")
        if site not in SAME or origin.partition("://")[2].lower() != hosts[0].lower():
            return 403, "This may be told from the dashboard's own pages only."
        if self._read_only:
            return 403, "This dashboard is read-only: it was started with --read-only."
        return None
