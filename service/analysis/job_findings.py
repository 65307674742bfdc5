"""What findings of a job begin with, whatever they are of."""

import msgspec


class JobFindings(msgspec.Struct, frozen=True, kw_only=True):
    """Findings of a job.

    format: of the JSON object, raised when its fields change
    run: name of the run directory
    job: its name in the run
    """

    format: int
    run: str
    job: str
    scenario: str
    ego: str


class MethodFindings(JobFindings, frozen=True, kw_only=True):
    """Findings that rest on what a job's method drew.

    unit: of gamma
    confidence: of the intervals
    """

    method: str
    gamma: float
    unit: str = ""
    confidence: float
