"""The form that submits a job: its fields are made of the schema that the service publishes."""

import json
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from starlette.requests import Request

from service.front.dashboard.pages.job import named, scenario_of, scenarios
from service.front.dashboard.pages.jobs import all_jobs, estimates_of
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import Job
from service.remote.client import Client, Refused
from service.world.scenario.measures import MEASURES

OPTIONS, OWN = "options", "own_scenario"
DEFAULTS = {"scenario": "i80-10s"}  # short, with drivers who err; where the service lists it
SPOKEN_OF = {
    "gamma": ("threshold",),
    OPTIONS: ("option",),
    "rel_error": ("relative half-width",),
}  # words of messages
IN_PASSING = ("method", "ego", "scenario", "measure", "label")  # that messages on something else name, too
LEAST_MEASURED = 20  # rollouts, below which starting the processes is most of their time
MOST_MEASURED = 5  # jobs that are looked at for a measured rollout
# What people call the fields that there are today; a field of a newer service goes by its name in the schema.
WORDS = {
    "scenario": ("Scenario", "One that the service lists; or give your own below."),
    "gamma": ("Threshold γ", "A rollout is dangerous when f ≤ γ, in the unit of the safety measure: with ttc-impact 0 "
              "is a contact, 0.5 half a second before one."),
    "ego": ("Ego", "The driving policy under test."),
    "method": ("Method", "auto chooses by what the first rollouts show; naive draws from P0 itself."),
    "budget": ("Budget", "Rollouts at most, training included."),
    "rel_error": ("Target precision", "Stop when the interval's relative half-width is this small, as in 0.2."),
    "confidence": ("Confidence", "Of the interval."),
    "measure": ("Safety measure", "In place of the scenario's, as in ttc, rss, drac or 'stl: always(ttc_s >= 1.0)'."),
    "noise_mode": ("Action noise", "In place of the scenario's: a stream for each rollout, one for all, or a part of X "
                   "that the method may move."),
    "seed": ("Seed", "The same seed gives the same bits."),
    "priority": ("Priority", "Of two jobs the one of higher priority goes first."),
    "weight": ("Weight", "Share of the workers among jobs of one priority."),
    "max_failed": ("Failed rollouts tolerated", "The job has failed when a larger share of its rollouts fails: 0 ends "
                   "it at the first, 1 never."),
    "label": ("Label", "Words of your own, to find it by."),
    OPTIONS: ("Options of the method", "NAME=VALUE, one a line, as in rho=0.1."),
}  # fmt: skip
# the others are settings for those who want them
FIRST = (
    "label",
    "scenario",
    "ego",
    "measure",
    "gamma",
    "method",
    "budget",
)


@dataclass(frozen=True)
class Field:
    """A field of the form.

    kind: of input
    choices: to select from
    hints: values that it may have, among others
    low, high: in HTML's sense
    error: what is wrong with its value
    """

    name: str
    label: str
    hint: str
    kind: str
    value: str = ""
    required: bool = False
    choices: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    step: str = "any"
    hints: tuple[str, ...] = ()
    longest: int | None = None
    error: str = ""

    @property
    def first(self) -> bool:
        return self.name in FIRST


@dataclass(frozen=True)
class Form:
    fields: tuple[Field, ...]
    own: str = ""  # text of an own scenario
    own_error: str = ""
    error: str = ""  # of the whole
    kept: str = ""  # what of a cloned job is not kept
    # as the service takes them, where nothing is wrong
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def wrong(self) -> bool:
        return bool(self.own_error or self.error) or any(one.error for one in self.fields)


async def empty_form(site: Site, like: Job | None) -> Form:
    """The form with the service's defaults, or with a job's settings."""
    schema = await site.link.ask("schema", _schema, 60.0)
    choices = {
        "scenario": tuple(s.name for s in (await scenarios(site)).items),
        "ego": tuple(e.name for e in (await site.link.ask("egos", lambda client: client.egos(), 10.0)).items),
    }
    given = {} if like is None else _as_given(like)
    own, lost = "", []
    if like is not None:
        scenario = await scenario_of(site, like)
        given |= {"measure": scenario.measure or "", "noise_mode": scenario.noise_mode or ""}
        own = "" if scenario.listed else scenario.text
    fields = [
        _field(name, described, name in schema.get("required", ()), choices.get(name, ()))
        for name, described in schema["properties"].items()
    ]
    fields.sort(key=lambda one: FIRST.index(one.name) if one.first else len(FIRST))
    shown = []
    for one in fields:
        value = given.get(one.name, DEFAULTS.get(one.name, one.value))
        if one.choices and value not in one.choices:
            if one.name in given and not (one.name == "scenario" and own):
                lost.append(f"{one.label.lower()} “{value}”")
            value = one.value
        shown.append(replace(one, value=value))
    kept = f"Not kept, as this service does not offer it now: {', '.join(lost)}." if lost else ""
    return Form(tuple(shown), own, kept=kept)


def _schema(client: Client) -> dict[str, Any]:
    schema = json.loads(client.get("schemas/Submission"))
    return schema["$defs"]["Submission"]


def _field(name: str, described: Mapping[str, Any], required: bool, choices: tuple[str, ...]) -> Field:
    label, hint = WORDS.get(name, (name.replace("_", " ").capitalize(), described.get("description", "")))
    kinds = [one for one in described.get("anyOf", [described]) if one.get("type") != "null"]
    plain = next((one for one in kinds if one.get("type") != "object"), kinds[0])
    default = described.get("default")
    value = "" if default is None or isinstance(default, dict) else str(default)
    made = Field(name, label, hint, "text", value, required)
    choices = choices or tuple(map(str, plain.get("enum", ())))
    if choices:
        if default is None and not required:
            choices = ("", *choices)  # left to the service
        return replace(made, kind="select", choices=choices, value=value or choices[0])
    if plain.get("type") in ("number", "integer"):
        low = plain.get("minimum", plain.get("exclusiveMinimum"))
        high = plain.get("maximum", plain.get("exclusiveMaximum"))
        step = "1" if plain["type"] == "integer" else "any"
        return replace(made, kind="number", low=low, high=high, step=step)
    if plain.get("type") == "boolean":
        return replace(made, kind="select", choices=("false", "true"))
    if plain.get("type") == "object":
        return replace(made, kind="lines")
    hints = tuple(MEASURES) if name == "measure" else ()
    return replace(made, longest=plain.get("maxLength"), hints=hints)


def _as_given(job: Job) -> dict[str, str]:
    """A job's settings as its form shows them."""
    common = {name: job.options.get(name) for name in ("budget", "rel_error", "confidence")}
    more = {k: v for k, v in job.options.items() if k not in common and v is not None}
    values = {"scenario": job.scenario, "ego": job.ego, "gamma": job.gamma, "method": job.method, "seed": job.seed,
              "priority": job.priority, "weight": job.weight, "label": job.label, "measure": job.measure,
              "noise_mode": job.noise_mode, "max_failed": job.max_failed, **common}  # fmt: skip
    given = {name: "" if value is None else str(value) for name, value in values.items()}
    return given | {OPTIONS: "\n".join(f"{name}={json.dumps(value)}" for name, value in more.items())}


def filled(form: Form, sent: Mapping[str, str]) -> Form:
    """The form with what was sent, checked as far as the form itself can tell."""
    values: dict[str, Any] = {}
    fields = []
    for one in form.fields:
        text = sent.get(one.name, "").strip()
        checked = replace(one, value=text)
        try:
            value = _value(checked)
        except ValueError as error:
            checked = replace(checked, error=str(error))
        else:
            if value is not None:
                values[one.name] = value
        fields.append(checked)
    own, own_error = sent.get(OWN, "").strip(), ""
    if own:
        try:
            values["scenario"] = tomllib.loads(own)
        except tomllib.TOMLDecodeError as error:
            own_error = f"This is not TOML: {error}."
    return Form(tuple(fields), own, own_error, values=values)


def _value(one: Field) -> Any:
    """A field's value as the service takes it; None where it is left to the service; ValueError says what is wrong."""
    if one.kind == "lines":
        return dict(_option(line) for line in one.value.splitlines() if line.strip()) or None
    if not one.value:
        if one.required:
            raise ValueError("This is needed.")
        return None
    if one.kind != "number":
        return one.value
    try:
        value = int(one.value) if one.step == "1" else float(one.value)
    except ValueError:
        raise ValueError("Give a whole number." if one.step == "1" else "Give a number.") from None
    if not math.isfinite(value):
        raise ValueError("Give a finite number.")
    return value


def _option(line: str) -> tuple[str, Any]:
    name, equals, text = (part.strip() for part in line.partition("="))
    if not name or not equals:
        raise ValueError(f"“{line.strip()}”: give NAME=VALUE.")
    try:
        return name, json.loads(text)
    except ValueError:
        return name, text


async def submit(site: Site, form: Form) -> tuple[Job | None, Form]:
    """The job, or the form with what the service found wrong."""
    values = dict(form.values)
    scenario, gamma = values.pop("scenario"), values.pop("gamma")
    try:
        return await site.link.order(lambda client: client.submit(scenario, gamma, **values)), form
    except Refused as refused:
        if refused.problem.status not in (400, 413, 422, 404):
            raise
        return None, _with_errors(form, refused)


def _with_errors(form: Form, refused: Refused) -> Form:
    """What the service says beside the fields that it names; else beside the first."""
    named_fields = {wrong.name.partition(".")[0] for wrong in refused.problem.errors}
    known = {one.name for one in form.fields}
    text = refused.problem.detail
    if form.own and not (named_fields & known - {"scenario"}):
        return replace(form, own_error=text)
    at = next((name for name in named_fields if name in known), None) or _meant(text, known)
    if at is None:
        return replace(form, error=text)
    return replace(
        form, fields=tuple(replace(one, error=text) if one.name == at else one for one in form.fields)
    )


def _meant(text: str, known: set[str]) -> str | None:
    """The field that a message speaks of first."""
    places: dict[str, int] = {}
    for name in known:
        for word in (name, *SPOKEN_OF.get(name, ())):
            found = re.search(rf"\b{re.escape(word)}\b", text)
            if found:
                places[name] = min(places.get(name, found.start()), found.start())
    return min(places, key=lambda name: (name in IN_PASSING, places[name]), default=None)


async def forecast(site: Site, request: Request) -> dict[str, Any]:
    """What the rollouts of a job would take, by the last one of the same scenario and ego that has run some."""
    asked = request.query_params
    scenario, ego, budget = asked.get("scenario", ""), asked.get("ego", ""), asked.get("budget", "")
    rollouts = int(budget) if budget.isascii() and budget.isdigit() and len(budget) < 16 else None
    alike = [job for job in await all_jobs(site) if (job.scenario, job.ego) == (scenario, ego)]
    alike.sort(key=lambda job: -job.number)
    by = None
    for job in alike[:MOST_MEASURED]:
        found = (await estimates_of(site, [job])).get(job.id)
        if found is not None and found.rollouts.total >= LEAST_MEASURED and found.worker_s > 0.0:
            by = job, found.worker_s / found.rollouts.total
            break
    workers = await site.link.ask("workers", lambda client: client.workers().items)
    procs = sum(worker.procs for worker in workers if not worker.quarantine)
    return {"scenario": scenario, "ego": ego, "rollouts": rollouts, "by": by, "procs": procs}


FORECAST = Part("forecast", "What it would take", forecast, ())
PARTS = (FORECAST,)


async def liked(site: Site, request: Request) -> Job | None:
    """The job that the form starts from, where the address names one."""
    name = request.query_params.get("like")
    return await named(site, name) if name else None
