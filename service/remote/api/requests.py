"""What requests may say: parameters of a key, and the body that submits a job. Anything else is refused."""

from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta

from service.evaluation.failed_share import MAX_FAILED

Reference = Literal["r157-cc", "r157-cc-aeb", "r157-5.2.5.2", "fsm", "rss"]
REFERENCES: tuple[str, ...] = get_args(Reference)
MAX_PAGE = 1000
MAX_NOTE = 2000  # characters of words about a job
MAX_ROLLOUTS = 10_000  # of one page
Seed = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Share = Annotated[float, Meta(gt=0.0, lt=1.0)]
PageSize = Annotated[int, Meta(ge=1, le=MAX_PAGE)]
Number = Annotated[int, Meta(ge=0, le=2**63 - 1)]


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class Nothing(_Request, frozen=True):
    pass


class Page(_Request, frozen=True):
    after: Number = 0
    limit: PageSize = 100


class IterationsPage(_Request, frozen=True):
    after: Annotated[int, Meta(ge=-1, le=2**63 - 1)] = -1
    limit: PageSize = 100


class WorkersPage(_Request, frozen=True):
    after: Annotated[str, Meta(max_length=64)] = ""
    limit: PageSize = 100


class AskEstimate(_Request, frozen=True):
    gamma: float | None = None
    confidence: Share | None = None


class AskCurve(_Request, frozen=True):
    """Parameters of `jobs/ID/curve`.

    gammas: thresholds, separated by commas; or `steps` ones at equal distances from low to high (default: from 0 to
        twice the job's gamma, and for `ttc-impact` at least from -5 to 1)
    """

    gammas: Annotated[str, Meta(max_length=20_000)] | None = None
    low: float | None = None
    high: float | None = None
    steps: Annotated[int, Meta(ge=2, le=MAX_PAGE)] = 50
    confidence: Share | None = None


class AskCourse(_Request, frozen=True):
    """Parameters of `jobs/ID/course`.

    points: numbers of rollouts at most, evenly on a logarithmic scale
    """

    points: Annotated[int, Meta(ge=2, le=MAX_PAGE)] = 100
    confidence: Share | None = None


class AskNote(_Request, frozen=True):
    """Parameters of `jobs/ID/note`; what is left out stays as it is.

    text: what is to be known of the job
    tags: words to find it by, separated by commas, in place of those that it has
    archived: whether it is left out of lists unless asked for
    """

    text: Annotated[str, Meta(max_length=MAX_NOTE)] | None = None
    tags: Annotated[str, Meta(max_length=MAX_NOTE)] | None = None
    archived: bool | None = None


class RolloutsPage(_Request, frozen=True):
    """Parameters of `jobs/ID/rollouts`.

    after: `next` of the page before
    limit: rollouts at most
    """

    after: Annotated[str, Meta(max_length=100)] = ""
    limit: Annotated[int, Meta(ge=1, le=MAX_ROLLOUTS)] = 1000


class AskListing(_Request, frozen=True):
    """Parameters of `jobs/ID/listing`.

    phase, outcome: of rollouts of one phase, of those that ended so
    low, high: of f, both included; rollouts that failed have none
    by: in the order of the record, by f, or by f with the highest first
    offset: of the first one, from 0
    """

    phase: Literal["estimate", "train"] | None = None
    outcome: Literal["collision", "off-road", "reversing", "finished", "horizon", "error"] | None = None
    low: float | None = None
    high: float | None = None
    by: Literal["record", "f", "-f"] = "record"
    offset: Number = 0
    limit: PageSize = 100


class AskFailures(_Request, frozen=True):
    """Parameters of `jobs/ID/failures`.

    by: what ranks first
    examine: dangerous rollouts at most to run again and group
    outcome: the rollouts that ended so, whatever their f, instead of those with f <= gamma
    """

    limit: Annotated[int, Meta(ge=1, le=500)] = 20
    by: Literal["likelihood", "weight", "f"] = "likelihood"
    examine: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    outcome: Literal["collision", "off-road", "reversing", "finished", "horizon"] | None = None


class AskSeverity(_Request, frozen=True):
    """Parameters of `jobs/ID/severity`.

    examine: dangerous rollouts at most that are looked at
    """

    examine: Annotated[int, Meta(ge=1, le=10_000)] | None = None


class AskPrevention(_Request, frozen=True):
    """Parameters of `jobs/ID/prevention`.

    reference: one driver, in place of the first three of UN Regulation 157 and the Joint Research Centre
    examine: dangerous rollouts at most to drive again
    onset_ttc_s: time to collision at which a conflict begins
    """

    reference: Reference | None = None
    examine: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    onset_ttc_s: Annotated[float, Meta(gt=0.0, le=1000.0)] | None = None


class AskRollout(_Request, frozen=True):
    """Parameters of `jobs/ID/rollouts/ROW`.

    iteration: of the batch stream that the row counts in (default: that of the estimate)
    trace: columns of every vehicle's state
    playback: what a player needs to show it
    camera: pictures of the ego's camera, evenly over the rollout
    reference: driver in the ego's place from the onset of the conflict on
    """

    phase: Literal["estimate", "train"] = "estimate"
    iteration: Number | None = None
    trace: bool = False
    playback: bool = False
    camera: Annotated[int, Meta(ge=0, le=1000)] = 0
    reference: Reference | None = None


class AskExport(_Request, frozen=True):
    """Parameters of `jobs/ID/rollouts/ROW/export`.

    format: scenario (a scenario file that holds the rollout), fcd (SUMO's floating-car data), mp4 (a film), mcap (a
        recording for viewers of robot logs), table (every vehicle at every step, as Parquet), openscenario (ASAM
        OpenSCENARIO XML 1.3)
    """

    format: Literal["scenario", "fcd", "mp4", "mcap", "table", "openscenario"]
    phase: Literal["estimate", "train"] = "estimate"
    iteration: Number | None = None


class AskLearned(_Request, frozen=True):
    """Parameters of `jobs/ID/learned`.

    rollouts: to run again under base and under proposal each, for the behaviours (0: no behaviours)
    """

    rollouts: Annotated[int, Meta(ge=0, le=10_000)] = 100


class AskScatter(_Request, frozen=True):
    """Parameters of `jobs/ID/scatter`.

    rollouts: dangerous ones at most to run again, for what the drivers did in them (0: none)
    """

    rollouts: Annotated[int, Meta(ge=0, le=10_000)] = 100


class AskRisk(_Request, frozen=True):
    """Parameters of `jobs/ID/risk`.

    baseline: events per million km, or police-reported, any-injury, any-crash or near-crash
    source: where a number is from
    """

    baseline: Annotated[str, Meta(max_length=40)] | None = None
    source: Annotated[str, Meta(max_length=200)] | None = None
    gamma: float | None = None
    confidence: Share | None = None


class AskReport(_Request, frozen=True):
    """Parameters of `jobs/ID/report`.

    drawn: dangerous rollouts to show
    baseline, source: as of the risk
    """

    drawn: Annotated[int, Meta(ge=0, le=20)] = 6
    baseline: Annotated[str, Meta(max_length=40)] | None = None
    source: Annotated[str, Meta(max_length=200)] | None = None


class AskComparison(_Request, frozen=True):
    """Parameters of `comparison`.

    jobs: two or more, separated by commas
    gamma: one threshold for all (default: theirs, which must be the same)
    examine: dangerous rollouts of each at most to run again and group (0: no failure modes)
    """

    jobs: Annotated[str, Meta(min_length=1, max_length=2000)]
    gamma: float | None = None
    examine: Annotated[int, Meta(ge=0, le=10_000)] | None = None


class Submission(_Request, frozen=True):
    """A job to run.

    scenario: the name of a listed one, or a scenario by value (what its file says, as JSON)
    options: of the method, beyond budget, rel_error and confidence
    measure, noise_mode: in place of the scenario's
    max_failed: share of its rollouts that may fail: 0 ends the job at the first, 1 lets any fail
    """

    scenario: Annotated[str, Meta(min_length=1, max_length=64)] | dict[str, Any]
    gamma: float
    ego: Annotated[str, Meta(min_length=1, max_length=200)] = "lidar"
    method: Literal["auto", "naive", "ce", "mixture", "splitting"] = "auto"
    budget: Annotated[int, Meta(ge=1)] = 20_000
    rel_error: Annotated[float, Meta(gt=0.0)] | None = None
    confidence: Share = 0.95
    options: dict[str, Any] = {}
    seed: Seed = 1
    priority: Annotated[int, Meta(ge=-100, le=100)] = 0
    weight: Annotated[float, Meta(ge=0.01, le=100.0)] = 1.0
    label: Annotated[str, Meta(max_length=200)] = ""
    max_failed: Annotated[float, Meta(ge=0.0, le=1.0)] = MAX_FAILED
    measure: Annotated[str, Meta(min_length=1, max_length=2000)] | None = None
    noise_mode: Literal["drawn", "frozen", "searched"] | None = None
