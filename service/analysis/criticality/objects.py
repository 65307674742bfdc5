"""What is told of criticality, as JSON objects. Numbers that are infinite or not known are null."""

import msgspec

from service.analysis.failures.events import Order
from service.analysis.job_findings import JobFindings

FORMAT = 1


class Critical(msgspec.Struct, frozen=True, kw_only=True):
    """A dangerous rollout by the measures of the field, towards the vehicle that the conflict is with.

    rank: as of `tailroad failures`
    share: of p that it carries
    other: the vehicle; None: background traffic, of which nothing is told
    ttc_s, wttc_s, ttb_s, ttr_s: the smallest of all states before a contact; ttb_s and ttr_s None where there was
        nothing to avoid
    too_late_to_brake_s, too_late_to_react_s: the first moment at which braking, or anything, was too late; None: never
    btn: the largest; None: infinite
    tet_s, tit_s2: time exposed, and integrated (Minderhoud and Bovy 2001), below tau_s
    """

    rank: int
    share: float
    f: float
    other: str | None
    error: str | None = None
    ttc_s: float | None = None
    wttc_s: float | None = None
    ttb_s: float | None = None
    ttr_s: float | None = None
    too_late_to_brake_s: float | None = None
    too_late_to_react_s: float | None = None
    btn: float | None = None
    tet_s: float = 0.0
    tit_s2: float = 0.0


class Criticality(JobFindings, frozen=True, kw_only=True):
    """Criticality of a job's first dangerous rollouts.

    tau_s: time to collision below which TET and TIT count
    assumptions: accelerations that the measures rest on
    """

    format: int = FORMAT
    gamma: float
    unit: str
    order: Order
    events: int
    tau_s: float
    assumptions: tuple[str, ...]
    rollouts: tuple[Critical, ...]
