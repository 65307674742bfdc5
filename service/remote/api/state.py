"""The service itself over the API: what it offers, who works for it, how it is."""

import time
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as Late
from importlib.metadata import version

import msgspec

from service.errors import StoreError
from service.remote.api.catalogue import Catalogue
from service.remote.api.objects import Egos, Health, Scenarios, Tally, Worker, Workers
from service.remote.api.problems import ApiError
from service.remote.api.requests import Nothing, WorkersPage
from service.remote.fleet.service import Fleet

HEALTH_S = 5.0  # in which a scheduler that is well answers


class StateAnswers:
    """What is answered on scenarios, egos, workers and health."""

    def __init__(self, fleet: Fleet, catalogue: Catalogue):
        self._fleet, self._catalogue = fleet, catalogue
        self._began = time.monotonic()
        self._checks = ThreadPoolExecutor(2, thread_name_prefix="api-health")

    def scenarios(self, asked: Nothing) -> Scenarios:
        return self._catalogue.scenarios()

    def egos(self, asked: Nothing) -> Egos:
        return self._catalogue.egos()

    def workers(self, asked: WorkersPage) -> Workers:
        known = sorted((w for w in self._fleet.workers() if w.id > asked.after), key=lambda w: w.id)
        items = tuple(msgspec.convert(w, Worker, from_attributes=True) for w in known[: asked.limit])
        return Workers(items=items, next=items[-1].id if len(known) > asked.limit else None)

    def tally(self, asked: Nothing) -> Tally:
        return self._fleet.tally()

    def health(self, asked: Nothing) -> Health:
        try:
            workers = self._checks.submit(self._fleet.workers).result(HEALTH_S)
            open_jobs = self._checks.submit(self._fleet.open_jobs).result(HEALTH_S)
            self._checks.submit(self._fleet.check).result(HEALTH_S)
        except StoreError as error:
            raise ApiError(
                "unavailable", f"the database is not well: {error}", retry_after_s=HEALTH_S
            ) from error
        except Late as error:
            text = f"the scheduler or its database has not answered for {HEALTH_S:g} s"
            raise ApiError("unavailable", text, retry_after_s=HEALTH_S) from error
        here = [w for w in workers if not w.quarantine]
        return Health(
            status="ok",
            tailroad=version("tailroad"),
            uptime_s=round(time.monotonic() - self._began, 1),
            workers=len(here),
            procs=sum(w.procs for w in here),
            open_jobs=open_jobs,
        )

    def close(self) -> None:
        self._checks.shutdown(wait=False, cancel_futures=True)
