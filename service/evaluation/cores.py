"""How many cores there are for this process."""

import os


def core_count() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))
