"""Keys of scenario files that have got a clearer name; the old ones are still read.

Scenarios are stored, sent and hashed under the old names, so that stored jobs and their digests stay what they are; a
reader of files and messages meets the new ones.
"""

import functools
import logging
from typing import Any

from service.errors import ScenarioError

# table, stored name, name in files
RENAMED = (
    ("drivers", "noise", "noise_mode"),
    ("camera", "noise_levels", "sensor_noise_levels"),
)

_log = logging.getLogger(__name__)


def to_stored(data: dict[str, Any], source: str) -> dict[str, Any]:
    """The scenario `data`, as read from `source`, with keys as they are stored; a notice where it has an old name.

    Raises ScenarioError where a key is given by both names.
    """
    for table, stored, written in RENAMED:
        values = data.get(table)
        if not isinstance(values, dict):
            continue
        if stored in values and written in values:
            raise ScenarioError(
                source, f"{table}.{stored}", values[stored], f"the old name of `{written}`; remove this one"
            )
        if stored in values:
            _notice(source, f"{table}.{stored}", written)
        if written in values:
            data = data | {table: {stored if key == written else key: value for key, value in values.items()}}
    return data


def to_written(data: dict[str, Any]) -> dict[str, Any]:
    """A scenario's stored keys and values `data` with keys as files have them."""
    for table, stored, written in RENAMED:
        if stored in data.get(table, {}):
            renamed = {written if key == stored else key: value for key, value in data[table].items()}
            data = data | {table: renamed}
    return data


def written_key(key: str) -> str:
    """The dotted `key` of a stored scenario, as files have it."""
    for table, stored, written in RENAMED:
        if key == f"{table}.{stored}":
            return f"{table}.{written}"
    return key


@functools.lru_cache(maxsize=256)
def _notice(source: str, key: str, written: str) -> None:
    """Say once for each source that it has an old name."""
    _log.warning("%s: %s is called %s now; the old name is still read", source, key, written)
