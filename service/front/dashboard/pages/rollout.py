"""One rollout, run once more: what happened, its values over time, and what the player needs."""

import re
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from starlette.exceptions import HTTPException
from starlette.requests import Request

from service.analysis.failures.playback import Playback
from service.analysis.wording import quantity
from service.front.dashboard.charts import Chart, Mark, Series, figure
from service.front.dashboard.link import FOR_GOOD_S
from service.front.dashboard.pages.failures import ENDS
from service.front.dashboard.pages.jobs import all_jobs
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import Job, RolloutView
from service.remote.api.requests import REFERENCES
from service.remote.client import Client, NoAnswer, Refused

MOST_BESIDE = 50  # jobs to choose from
CAMERA_PICTURES = 24
FAR = 6.0  # times the threshold (or 0.5), above which the safety measure is not drawn
NAMES = {
    "ttc": "time to collision",
    "ttc-impact": "time to contact",
}  # of safety measures, where people have one

SAID = {
    "scenario": "Scenario file that brings it back to the bit",
    "fcd": "SUMO floating-car data",
    "mp4": "Film",
    "table": "Every vehicle at every step, as a table (Parquet)",
    "openscenario": "ASAM OpenSCENARIO 1.3, each vehicle on its trajectory",
    "mcap": "MCAP recording for Foxglove and others",
}


class Asked:
    """Which rollout the address names; HTTPException 404 where it names none."""

    def __init__(self, request: Request):
        query = request.query_params
        self.job: str = request.path_params["job"]
        row, iteration = request.path_params["row"], query.get("iteration", "")
        self.phase = query.get("phase", "estimate")
        if not (_is_number(row) and (not iteration or _is_number(iteration))) or self.phase not in (
            "estimate",
            "train",
        ):
            raise HTTPException(404)
        self.reference = query.get("reference", "")
        if self.reference and self.reference not in REFERENCES:
            raise HTTPException(404)
        self.row = int(row)
        self.iteration = int(iteration) if iteration else None

    def ask(self, client: Client, playback: bool = False, camera: int = 0) -> RolloutView:
        return client.rollout(
            self.job,
            self.row,
            self.phase,
            self.iteration,
            playback=playback,
            camera=camera,
            reference=self.reference or None,
        )

    @property
    def key(self) -> tuple:
        return self.job, self.phase, self.iteration, self.row, self.reference

    @property
    def address(self) -> str:
        return f"/jobs/{quote(self.job, safe='')}/rollouts/{self.row}"

    @property
    def query(self) -> str:
        iteration = "" if self.iteration is None else f"&iteration={self.iteration}"
        return f"?phase={self.phase}{iteration}"


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[0-9]{1,18}", text) is not None


async def played(site: Site, asked: Asked) -> RolloutView:
    """The rollout with its playback."""
    return await site.link.ask(
        ("rollout", asked.key), lambda client: asked.ask(client, playback=True), FOR_GOOD_S
    )


async def photographed(site: Site, asked: Asked) -> RolloutView:
    """The rollout with pictures of the ego's camera."""
    return await site.link.ask(
        ("camera", asked.key), lambda client: asked.ask(client, camera=CAMERA_PICTURES), FOR_GOOD_S
    )


@dataclass(frozen=True)
class Beside:
    """What a rollout can be shown beside.

    name: of what is, "" for nothing
    playback: its address
    jobs, references: what there is to choose from
    """

    name: str
    playback: str
    jobs: tuple[Job, ...]
    references: tuple[str, ...]


async def beside(site: Site, asked: Asked, wanted: str) -> Beside:
    """Jobs on the same draws, and reference drivers; wanted: one of them, by its id or name."""
    try:
        jobs = await all_jobs(site)
    except (NoAnswer, Refused):
        jobs = []
    own = next((job for job in jobs if job.id == asked.job), None)
    alike = tuple(
        job for job in reversed(jobs) if own is not None and job.id != own.id and same_draws(job, own)
    )[:MOST_BESIDE]
    other = next((job for job in alike if job.id == wanted), None)
    if wanted in REFERENCES:
        return Beside(
            wanted, f"{asked.address}/playback.json{asked.query}&reference={wanted}", alike, REFERENCES
        )
    if other is None:
        return Beside("", "", alike, REFERENCES)
    address = f"/jobs/{quote(other.id, safe='')}/rollouts/{asked.row}/playback.json{asked.query}"
    return Beside(f"{other.label or other.id} ({other.ego})", address, alike, REFERENCES)


def same_draws(one: Job, other: Job) -> bool:
    """Whether a row of one job and the same row of the other are one draw: both are of P0, with the same seed."""
    what = [(job.scenario, job.seed, job.noise_mode, job.method) for job in (one, other)]
    return what[0] == what[1] and one.method == "naive"


async def facts(site: Site, request: Request) -> dict[str, Any]:
    """What happened in it, with its values over time."""
    view = await played(site, Asked(request))
    playback = view.playback
    return {
        "view": view,
        "ends": ENDS,
        "playback": playback,
        "figures": [] if playback is None else [figure(chart) for chart in over_time(playback)],
    }


def over_time(playback: Playback) -> list[Chart]:
    """Safety measure, actions and speeds over time."""
    time = list(playback.time_s)
    limit = FAR * max(playback.gamma, 0.5)
    near = [value if value is not None and value <= limit else None for value in playback.measured]
    name = NAMES.get(playback.measure, playback.measure)
    unit = f", {playback.unit}" if playback.unit else ""
    least = f"{playback.time_s[playback.worst]:.1f} s" if playback.time_s else "no time"
    ego = next((track for track in playback.tracks if track.role == "ego"), None)
    threat = next((track for track in playback.tracks if track.role == "threat"), None)
    speeds = [
        Series(t.name, time, list(t.speed_mps), tone=tone)
        for t, tone in ((ego, "ego"), (threat, "threat"))
        if t
    ]
    return [
        Chart(
            id="chart-measure",
            title=f"{name.capitalize()} over time",
            shows=f"The ego's {name} in each step, lowest at {least}.",
            x_label="time, s",
            y_label=f"{name}{unit}",
            series=(Series(name, time, near),),
            marks=(Mark("y", playback.gamma, f"γ = {quantity(playback.gamma, playback.unit)}"),),
            y_include=(0.0,),
            note=f"Values above {quantity(limit, playback.unit)} are not drawn.",
        ),
        Chart(
            id="chart-action",
            title="What the ego did",
            shows="The ego's acceleration and turn rate in each step.",
            x_label="time, s",
            y_label="m/s², and 0.1 rad/s",
            series=(
                Series("acceleration, m/s²", time, list(playback.acceleration_mps2), tone=1, kind="steps"),
                Series(
                    "turn rate, 0.1 rad/s",
                    time,
                    [None if value is None else 10.0 * value for value in playback.turn_rate_radps],
                    tone=3,
                    kind="steps",
                ),
            ),
        ),
        Chart(
            id="chart-speed",
            title="Speeds",
            shows="The speed of the ego and of the vehicle that it comes closest to.",
            x_label="time, s",
            y_label="m/s",
            series=tuple(speeds),
        ),
    ]


PARTS = (Part("rollout", "What happened", facts, ()),)
