"""Orders are written down: who gave them, and whether they were refused."""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from service.errors import StoreError
from service.remote.api.limits import Bucket
from service.remote.api.problems import problem_of
from service.remote.fleet.service import Fleet

# written down; more are left out, so that nobody fills the database
REFUSALS_PER_S, REFUSALS_BURST_S = 1.0, 100.0
LONGEST = 500  # characters of a refusal

log = logging.getLogger("tailroad.api")


@dataclass
class Order:
    """One order. job: that it is about, or that has come of it."""

    job: str


class Orders:
    """The orders of a service, one after the other: what is counted of a client holds for the next one."""

    def __init__(self, fleet: Fleet):
        self._fleet = fleet
        self._lock = threading.Lock()
        self._refusals = Bucket(REFUSALS_PER_S, REFUSALS_BURST_S)

    @contextmanager
    def written(self, who: str, did: str, job: str) -> Iterator[Order]:
        """Carry out an order inside; StoreError where it was carried out and could not be written down."""
        order = Order(job)
        with self._lock:
            try:
                yield order
            except Exception as error:
                self._refused(who, did, job, problem_of(error, "").detail)
                raise
            self._fleet.log.add(who, did, order.job)

    def _refused(self, who: str, did: str, job: str, why: str) -> None:
        if self._refusals.wait_s() > 0.0:
            log.warning("%s: %s %s refused, and not in the audit log, as there were too many", who, did, job)
            return
        try:
            self._fleet.log.add(who, did, job[:100], why[:LONGEST] or "refused")
        except StoreError as error:
            log.error("%s: %s %s refused, and not in the audit log: %s", who, did, job, error)
