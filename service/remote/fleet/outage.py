"""An outage of the database is no job's end: what was asked is asked again."""

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from service.errors import StoreOutage

RETRY_S = 1.0  # until a database that did not answer is tried again

log = logging.getLogger("tailroad.hub")
T = TypeVar("T")


def while_out(ask: Callable[[], T], stopping: Callable[[], bool]) -> T:
    """What the database says, asked for again while it does not answer; StoreOutage where the service stops."""
    while True:
        try:
            return ask()
        except StoreOutage as error:
            log.error("%s; trying again", error)
            if stopping():
                raise
            time.sleep(RETRY_S)
