"""The list of jobs and the form that submits one, without a browser."""

from __future__ import annotations

import asyncio
import shlex

import msgspec
import pytest
from starlette.exceptions import HTTPException
from starlette.requests import Request

from service.front.dashboard.book import Book
from service.front.dashboard.forms import MOST_BYTES, local_path, sent
from service.front.dashboard.live import Rates
from service.front.dashboard.pages.job import command_of
from service.front.dashboard.pages.jobs import Asked, Row, in_order, orders_on
from service.front.dashboard.pages.submit import Field, Form, _as_given, _field, _with_errors, filled
from service.remote.api import objects as O
from service.remote.api.objects import Job, Jobs, JobScenario
from service.remote.api.requests import Submission
from service.remote.api.schemas import schema_of
from service.remote.client import Refused


def job(number: int, **changes) -> Job:
    values = {"id": f"j{number}", "number": number, "label": "", "scenario": "i80", "ego": "idm", "gamma": 0.5,
              "method": "ce", "options": {"budget": 100}, "seed": 1, "priority": 0, "weight": 1.0, "at": "",
              "status": "done", "reason": "", "rollouts": None, "leases": 0, "refusals": {}}  # fmt: skip
    return Job(**values | changes)


class Pages:
    """A client of which the pages of jobs alone are asked; remembers what was."""

    def __init__(self, jobs: list[Job]):
        self.list, self.asked = jobs, []

    def jobs(self, after: int, limit: int) -> Jobs:
        self.asked.append(after)
        found = [one for one in self.list if one.number > after]
        more = len(found) > limit
        return Jobs(items=tuple(found[:limit]), next=found[limit - 1].number if more else None)


def request(query: str = "", body: bytes = b"", kind: str = "application/x-www-form-urlencoded") -> Request:
    async def receive() -> dict:
        return {"type": "http.request", "body": body, "more_body": False}

    headers = [(b"content-type", kind.encode())]
    scope = {
        "type": "http",
        "method": "POST",
        "path": "/",
        "query_string": query.encode(),
        "headers": headers,
    }
    return Request(scope, receive)


# -- the list ------------------------------------------------------------------------------------------------


def test_jobs_that_are_over_are_not_read_again():
    client = Pages([job(1), job(2, status="running"), job(3)])
    book = Book()
    assert [one.number for one in book.read(client)] == [1, 2, 3]
    client.list += [job(4)]
    client.list[1] = job(2, status="cancelled")
    assert [one.status for one in book.read(client)] == ["done", "cancelled", "done", "done"]
    book.read(client)
    assert client.asked == [0, 1, 4]


def test_a_job_that_somebody_noted_is_read_again_though_it_is_over():
    client = Pages([job(1), job(2)])
    client.job = lambda name: job(2, note="look", tags=("night",))
    book = Book()
    book.read(client)
    book.noted("j2")
    assert [one.note for one in book.read(client)] == ["", "look"]


def test_archived_jobs_are_left_out_and_tags_and_notes_are_searched():
    old, tagged = job(1, archived=True), job(2, tags=("night",), note="Looks odd")
    assert not Asked().fits(old)
    assert Asked(archived=True).fits(old)
    assert Asked(tag="night").fits(tagged)
    assert not Asked(tag="day").fits(tagged)
    assert Asked(search="NIGHT odd").fits(tagged)


def test_a_column_sorts_and_once_more_the_other_way_round():
    asked = Asked(search="x", page=3)
    assert asked.by("p") == "/?search=x&sort=p"
    assert Asked(sort="p").by("p") == "/?sort=p&turned=1"


def test_orders_on_the_chosen_jobs():
    told: list[tuple] = []

    class Told:
        def note(self, name, **more):
            told.append((name, more))

    tagged = job(3, tags=("night",))
    for order, tag in (("tag", "a,b"), ("untag", "night"), ("archive", ""), ("tag", "")):
        orders_on(order, tag)(Told(), job=tagged)
    assert told == [("j3", {"tags": ["night", "a b"]}), ("j3", {"tags": []}), ("j3", {"archived": True})]
    assert orders_on("explode", "") is None


def test_a_list_of_many_pages_is_read_whole():
    client = Pages([job(n) for n in range(1, 1203)])
    assert len(Book().read(client)) == 1202
    assert client.asked == [0, 500, 1000]


def test_the_search_takes_all_words_and_the_filters_their_value():
    asked = Asked.of(request("search=night+LIDAR&state=done&sort=nonsense&page=x"))
    assert (asked.sort, asked.page) == ("newest", 1)
    assert asked.fits(job(1, label="Night drive", ego="lidar"))
    assert not asked.fits(job(1, label="Night drive"))
    assert not asked.fits(job(1, label="Night drive", ego="lidar", status="failed"))


def test_the_order_is_as_asked_and_unknown_values_go_last():
    rows = [Row(job(n), None, rollouts, 100, None) for n, rollouts in ((1, 5), (2, None), (3, 9), (4, 5))]

    def numbers(**asked) -> list[int]:
        return [row.job.number for row in in_order(rows, Asked(**asked))]

    assert numbers() == [4, 3, 2, 1]
    assert numbers(turned=True) == [1, 2, 3, 4]
    assert numbers(sort="rollouts") == [3, 4, 1, 2]
    assert numbers(sort="rollouts", turned=True) == [4, 1, 3, 2]


def test_the_time_left_follows_from_the_pace():
    assert Row(job(1, status="running"), None, 40, 100, 3.0).left_s == 20.0
    assert Row(job(1, status="paused"), None, 40, 100, 3.0).left_s is None
    assert Row(job(1), None, 100, 100, None).share == 1.0


def test_the_pace_is_of_late_and_forgets_what_was_taken_out():
    clock = [0.0]
    rates = Rates(lambda: clock[0])
    assert rates.of("a") is None
    for at, rollouts in ((0.0, 0), (10.0, 1000), (60.0, 1100), (70.0, 1200)):
        clock[0] = at
        rates.hear("a", rollouts)
    assert rates.of("a") == pytest.approx(10.0)  # since second 60 at the earliest that is kept
    rates.hear("a", 300)
    assert rates.of("a") is None
    clock[0] = 300.0
    assert rates.of("a") is None


def test_the_command_runs_the_same_job_again():
    made = job(
        1,
        scenario="i80-10s",
        gamma=0.25,
        seed=7,
        options={"budget": 9, "rel_error": None, "rho": 0.1, "mix": "a b"},
    )
    listed = JobScenario(job="j1", name="i80-10s", listed=True, measure=None, noise_mode="frozen", text="")
    words = shlex.split(command_of(made, listed))
    own = msgspec.structs.replace(listed, listed=False, noise_mode=None)
    assert shlex.split(command_of(made, own))[2] == "i80-10s.toml"
    assert words == [
        "tailroad", "submit", "i80-10s", "--ego", "idm", "--gamma", "0.25", "--noise-mode", "frozen", "--method",
        "ce", "--seed", "7",
        "--budget", "9", "--option", 'mix="a b"', "--option", "rho=0.1"]  # fmt: skip


# -- forms ---------------------------------------------------------------------------------------------------

FORM = Form((
    Field("gamma", "γ", "", "number", required=True),
    Field("budget", "Budget", "", "number", step="1"),
    Field("options", "Options", "", "lines"),
    Field("scenario", "Scenario", "", "select", choices=("i80",)),
))  # fmt: skip


def test_fields_come_with_their_types():
    form = filled(FORM, {"gamma": "0.5", "budget": "", "options": "rho=0.1\n\nname = x", "scenario": "i80"})
    assert not form.wrong
    assert form.values == {"gamma": 0.5, "options": {"rho": 0.1, "name": "x"}, "scenario": "i80"}


@pytest.mark.parametrize(
    ("given", "at"),
    [({}, "gamma"), ({"gamma": "a"}, "gamma"), ({"gamma": "inf"}, "gamma"), ({"gamma": "1", "budget": "1.5"}, "budget"),
     ({"gamma": "1", "options": "rho"}, "options"), ({"gamma": "1", "options": "=1"}, "options")],
)  # fmt: skip
def test_what_cannot_be_is_said_beside_its_field(given, at):
    assert [one.name for one in filled(FORM, given).fields if one.error] == [at]


def test_an_own_scenario_takes_the_place_of_the_chosen_one():
    assert filled(FORM, {"gamma": "1", "own_scenario": "[a]\nb = 1"}).values["scenario"] == {"a": {"b": 1}}
    assert "not TOML" in filled(FORM, {"gamma": "1", "own_scenario": "a ="}).own_error


def test_a_form_is_read_and_anything_else_refused():
    assert asyncio.run(sent(request(body=b"a=1&b=%C3%A9&b=2"))) == {"a": "1", "b": "2"}
    for body, kind, status in (
        (b"{}", "application/json", 415),
        (b"a=1", "text/plain", 415),
        (b"a=" + b"x" * MOST_BYTES, "application/x-www-form-urlencoded", 413),
        (b"a=%ff", "application/x-www-form-urlencoded", 400),
        (b"&".join(b"a=1" for _ in range(200)), "application/x-www-form-urlencoded", 400),
    ):
        with pytest.raises(HTTPException) as caught:
            asyncio.run(sent(request(body=body, kind=kind)))
        assert caught.value.status_code == status


@pytest.mark.parametrize(
    "given", ["https://evil.example", "//evil.example", "/\\evil.example", "", "jobs", "/a\r\nb"]
)
def test_the_way_back_stays_here(given):
    assert local_path(given, "/otherwise") == "/otherwise"
    assert local_path("/?search=a", "/otherwise") == "/?search=a"


def test_the_form_takes_the_measure_and_the_noise_mode_and_leaves_them_to_the_scenario():
    described = schema_of(Submission)["$defs"]["Submission"]["properties"]
    fields = tuple(_field(name, described[name], False, ()) for name in ("measure", "noise_mode", "method"))
    assert [one.kind for one in fields] == ["text", "select", "select"]
    assert fields[1].choices == ("", "drawn", "frozen", "searched")
    assert fields[2].value == "auto"
    assert filled(Form(fields), {"method": "auto"}).values == {"method": "auto"}
    given = {"measure": "rss", "noise_mode": "searched", "method": "naive"}
    assert filled(Form(fields), given).values == given
    like = _as_given(job(1, measure="rss", noise_mode="frozen"))
    assert (like["measure"], like["noise_mode"]) == ("rss", "frozen")


@pytest.mark.parametrize(
    ("detail", "named_as", "at"),
    [
        ("the cross-entropy method needs a budget of at least 1000, not 5", (), "budget"),
        ("threshold -1 s: the measure 'ttc' is never below 0", (), "gamma"),
        ("there is no scenario 'x'", (O.Wrong("scenario", "x", "one of i80"),), "scenario"),
        ("the scheduler would hold too much", (), None),
    ],
)
def test_what_the_service_finds_wrong_stands_beside_the_field_it_speaks_of(detail, named_as, at):
    refused = Refused(O.Problem("urn:x:bad-job", "t", 422, detail, errors=named_as))
    method = Field("method", "Method", "", "select", choices=("ce",))
    form = _with_errors(filled(Form((*FORM.fields, method)), {"gamma": "1", "scenario": "i80"}), refused)
    assert form.wrong
    assert [one.name for one in form.fields if one.error] == ([at] if at else [])
    assert form.error == ("" if at else detail)
