"""How the ego fails: the modes with their shares, and the dangerous rollouts in order."""

from typing import Any, Literal, get_args
from urllib.parse import quote, urlencode

import msgspec
from starlette.requests import Request

from service.front.dashboard.pages.job import HEAD, job_of, keep_s
from service.front.dashboard.site import Part, Site

Order = Literal["likelihood", "weight", "f"]
ORDERS = {
    "likelihood": "likeliest under standard traffic first",
    "weight": "those that carry most of the estimate first",
    "f": "the most dangerous first",
}
ENDS = {"horizon": "drove on to the end", "finished": "reached the end of the road"}
BACKGROUND = "background traffic"
FEW, MANY = 20, 100
WHILE_RUNNING_S = 30.0  # finding failures runs rollouts again: not at each batch


async def failures(site: Site, request: Request) -> dict[str, Any]:
    """The failures so far, as the API tells them."""
    job = await job_of(site, request)
    by = request.query_params.get("by", "")
    order = by if by in get_args(Order) or by in ORDERS else "likelihood"
    chosen = {
        "mode": request.query_params.get("mode", "")[:200],
        "other": request.query_params.get("with", "")[:200],
    }
    every = request.query_params.get("all") == "1" or any(chosen.values())
    limit = MANY if every else FEW
    key = f"jobs/{quote(job.id, safe='')}/failures?limit={limit};by={order}"
    found = await site.link.ask(
        ("failures", key, job.status),
        lambda client: msgspec.json.decode(client.get(key)),
        keep_s(job, WHILE_RUNNING_S),
    )
    names = {mode["mode"]: mode["name"] for mode in found["modes"]}
    others = sorted({failure["other"] or BACKGROUND for failure in found["failures"]})
    shown = [
        failure
        for failure in found["failures"]
        if chosen["mode"] in ("", failure["mode"]) and chosen["other"] in ("", failure["other"] or BACKGROUND)
    ]
    return {"chosen": chosen, "others": others, "shown": shown, "all": every,
            "film": lambda failure: film_address(job.id, failure),
            "only": lambda mode: f"/jobs/{quote(job.id, safe='')}/failures?{urlencode({'mode': mode})}",
            "job": job, "found": found, "order": order, "orders": ORDERS, "few": FEW, "many": MANY, "names": names,
            "ends": ENDS, "replay": lambda failure: replay_address(job.id, failure, names)}  # fmt: skip


def replay_address(job: str, failure: dict[str, Any], names: dict[str, str]) -> str:
    """Where a rollout is replayed. names: of modes."""
    mode = names.get(failure["mode"], failure["mode"])
    where = {"iteration": failure["iteration"], "rank": failure["rank"], "mode": mode}
    return f"/jobs/{quote(job, safe='')}/rollouts/{failure['row']}?{urlencode(where)}"


def film_address(job: str, failure: dict[str, Any]) -> str:
    """Where what a player needs of it is."""
    query = urlencode({"iteration": failure["iteration"]})
    return f"/jobs/{quote(job, safe='')}/rollouts/{failure['row']}/playback.json?{query}"


PARTS = (HEAD, Part("failures", "Failures", failures, ("status",), every_s=None))
