"""What a form sent."""

from urllib.parse import parse_qsl

from starlette.exceptions import HTTPException
from starlette.requests import Request

MOST_BYTES = 1_000_000
MOST_FIELDS = 100


async def sent(request: Request) -> dict[str, str]:
    """The fields of a form, the last of each name; HTTPException where it is none or too large."""
    return dict(await all_sent(request))


async def all_sent(request: Request) -> list[tuple[str, str]]:
    """The fields of a form, in order; HTTPException where it is none or too large."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/x-www-form-urlencoded":
        raise HTTPException(415, "Send a form.")
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > MOST_BYTES:
            raise HTTPException(413, f"A form of more than {MOST_BYTES:,} bytes.")
    try:
        return parse_qsl(body.decode(), keep_blank_values=True, errors="strict", max_num_fields=MOST_FIELDS)
    except ValueError as error:
        raise HTTPException(400, "The form cannot be read.") from error


def local_path(given: str, otherwise: str) -> str:
    """A path on this dashboard to go back to; `otherwise` for anything that leads elsewhere."""
    inside = (
        given.startswith("/") and not given.startswith("//") and "\\" not in given and given.isprintable()
    )
    return given if inside else otherwise
