"""Risk in words: p as a rate per million kilometres, beside a baseline that the user sets."""

from typing import Any
from urllib.parse import quote

import msgspec
from starlette.requests import Request

from service.front.dashboard.pages.job import HEAD, job_of, keep_s
from service.front.dashboard.site import Part, Site

BASELINES = {
    "police-reported": "human-driven vehicles in police-reported crashes",
    "any-injury": "human-driven vehicles in crashes with any injury reported",
    "any-crash": "human-driven vehicles in crashes of any kind",
    "near-crash": "near-crashes of human drivers in the 100-Car study",
}
OWN = "own"
WHILE_RUNNING_S = 10.0


async def risk(site: Site, request: Request) -> dict[str, Any]:
    """The risk beside the baseline that the address names."""
    job = await job_of(site, request)
    query = request.query_params
    chosen = query.get("baseline", "police-reported")
    rate, source = query.get("rate", "").strip()[:40], query.get("source", "").strip()[:200]
    baseline = rate if chosen == OWN else chosen
    asked = f"baseline={quote(baseline)}" + (f";source={quote(source)}" if chosen == OWN and source else "")
    key = f"jobs/{quote(job.id, safe='')}/risk?{asked}"
    found = await site.link.ask(
        ("risk", key, job.status),
        lambda client: msgspec.json.decode(client.get(key)),
        keep_s(job, WHILE_RUNNING_S),
    )
    return {"job": job, "found": found}


def form_values(request: Request) -> dict[str, Any]:
    """What the form that sets the baseline shows."""
    query = request.query_params
    return {"chosen": query.get("baseline", "police-reported"), "rate": query.get("rate", "")[:40],
            "source": query.get("source", "")[:200], "baselines": BASELINES, "own": OWN}  # fmt: skip


PARTS = (HEAD, Part("risk", "Risk in words", risk, ("status", "iteration")))
