"""What one client may ask for, so that the others have their part: by the connection, as the audit log names it."""

import threading
from collections import OrderedDict

from service.remote.api.limits import Bucket, Limits
from service.remote.api.problems import ApiError
from service.remote.fleet.service import Fleet

CLIENTS = 10_000  # that are remembered


class Quotas:
    """The clients of a service."""

    def __init__(self, fleet: Fleet, limits: Limits):
        self._fleet, self._limits = fleet, limits
        self._buckets: OrderedDict[str, Bucket] = OrderedDict()
        self._lock = threading.Lock()

    def ask(self, who: str) -> None:
        """Count a request; ApiError where the client has had its part of them."""
        with self._lock:
            bucket = self._buckets.get(who)
            if bucket is None:
                bucket = self._buckets[who] = Bucket(self._limits.client_requests_per_s, self._limits.burst)
            if len(self._buckets) > CLIENTS:
                self._buckets.popitem(last=False)
        if (wait_s := bucket.wait_s()) > 0.0:
            text = (
                f"{who} asks more than {self._limits.client_requests_per_s:g} times a second; try again in "
            )
            raise ApiError("too-many-requests", f"{text}{wait_s:.2g} s", retry_after_s=round(wait_s, 3))

    def submit(self, who: str) -> None:
        """ApiError where the client has as many open jobs as one may have."""
        most = self._limits.client_open_jobs
        if most < self._limits.open_jobs and len(self._fleet.open_of(who)) >= most:
            raise ApiError(
                "too-many-jobs",
                f"{who} has {most} open jobs, and may have no more; wait for some to end, or cancel some",
                retry_after_s=60.0,
            )
