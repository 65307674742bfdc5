"""Parts of an estimate as JSON objects, the same over the API and in reports."""

import msgspec


class EstimateWarning(msgspec.Struct, frozen=True):
    """What bears on how far an estimate can be relied on, and what to do."""

    name: str
    message: str
    remedy: str


class Rollouts(msgspec.Struct, frozen=True):
    """How many there were.

    total: training and estimation, the failed ones among them
    """

    total: int
    training: int
    estimation: int
    failed: int
