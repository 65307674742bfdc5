"""The report's facts as one JSON object: report.json; `tailroad schema report` prints its JSON Schema.

Numbers that are not known or not finite are null. Seeds are text, because they have 64 bits.
"""

from typing import Any

import msgspec

from service.analysis.coverage.objects import Coverage
from service.analysis.estimate_parts import EstimateWarning, Rollouts
from service.analysis.failures.objects import Failure, Modes
from service.analysis.learned.objects import Learned
from service.analysis.prevention.objects import Prevention
from service.analysis.risk import Risk
from service.analysis.severity.objects import Severity
from service.evaluation.summary import Ending, Impact

FORMAT = 2
Number = float | None


class _Fact(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pass


class Headline(_Fact, frozen=True):
    """The estimate that heads the report.

    settled: without warnings about itself
    failures: how failed rollouts were treated in p, "" where none failed
    doubt: what its record holds against it ("Disputed: ..."), "" for nothing
    """

    job: str
    by_method: str
    answer: str
    answer_interval: str
    settled: bool
    p: Number
    ci: tuple[float, float]
    confidence: float
    rollouts: int
    failures: str = ""
    doubt: str = ""


class ScenarioFacts(_Fact, frozen=True):
    """What was simulated.

    file: what the scenario's file says
    drivers_sha256: of the weights
    """

    name: str
    description: str
    built_in: bool
    road: str
    ego: str
    gamma: float
    measure: str
    measure_words: str
    unit: str
    horizon_s: float
    step_s: float
    vehicles: int
    drivers: str
    noise: str  # noise_mode by its old name
    dimension: int
    drivers_sha256: str
    file: dict[str, Any]
    noise_mode: str = ""


class Progress(_Fact, frozen=True):
    """Rollouts at most, on record, and counted in the estimate so far."""

    planned: int
    recorded: int
    counted: int


class AgainstNaive(_Fact, frozen=True):
    """How a method compares with naive Monte Carlo of the same run; efficiency counts training."""

    method: str
    ratio_of_rare_events: Number
    ratio_of_variances: Number
    efficiency: Number
    variance_reliable: bool
    difference_z: Number


class EstimateTrace(_Fact, frozen=True):
    """The estimate as rollouts came in, training counted."""

    rollouts: tuple[int, ...]
    p: tuple[Number, ...]
    low: tuple[Number, ...]
    high: tuple[Number, ...]


class GammaCurve(_Fact, frozen=True):
    """p at other thresholds, with pointwise intervals."""

    gamma: tuple[float, ...]
    p: tuple[Number, ...]
    low: tuple[Number, ...]
    high: tuple[Number, ...]
    events: tuple[int, ...]


class TrainingStep(_Fact, frozen=True):
    """One iteration of the search: ce.TrainingRecord."""

    iteration: int
    rollouts: int
    gamma_k: Number
    quantile: Number
    elites: int
    ess: Number
    max_weight_share: Number
    events: int
    infinite: int
    failed: int
    step: Number
    kl: Number
    summary: dict[str, Number]
    phase: str


class EstimationStep(_Fact, frozen=True):
    """The estimate after one more batch: ce.EstimationRecord."""

    iteration: int
    rollouts: int
    p: Number
    std_error: Number
    low: Number
    high: Number
    ess: Number
    max_weight_share: Number
    events: int
    failed: int
    phase: str


class FailedRollout(_Fact, frozen=True):
    """A rollout that ended in an error."""

    phase: str
    iteration: int
    row: int
    noise: str  # noise_seed by its old name
    reason: str
    noise_seed: str = ""


class FailedRollouts(_Fact, frozen=True):
    total: int
    listed: tuple[FailedRollout, ...]


class OutputShift(_Fact, frozen=True):
    """Shift of the means of the driver weights that act on one output, in standard deviations under P0."""

    output: str
    weights: int
    rms_shift_sd: float
    max_shift_sd: float


class DriverShift(_Fact, frozen=True):
    """How far the parametric proposal moved the driver weights, and how far it is from P0 in all."""

    outputs: tuple[OutputShift, ...]
    distance_sd: float
    kl_nats: float


class JobFacts(_Fact, frozen=True):
    """A job of the run: what was asked, what it came to, what it cost.

    method_used: what "auto" has come to
    """

    id: str
    method: str
    method_used: str
    method_name: str
    by_method: str
    scenario: str
    measure: str
    unit: str
    ego: str
    gamma: float
    seed: int
    stream_seed: str
    options: dict[str, Any]
    options_without_flag: tuple[str, ...]
    tailroad: str
    p: Number
    std_error: Number
    ci: tuple[float, float]
    confidence: float
    answer: str
    answer_interval: str
    rollouts: Rollouts
    events: int
    ess: Number
    max_weight_share: Number
    pareto_k: Number
    efficiency_vs_naive: Number
    variance_reliable: bool
    against_naive: AgainstNaive | None
    converged: bool
    finished: bool
    progress: Progress
    warnings: tuple[EstimateWarning, ...]
    trace: EstimateTrace
    curve: GammaCurve
    training: tuple[TrainingStep, ...]
    estimation: tuple[EstimationStep, ...]
    outcomes: dict[str, dict[str, int]]  # by phase
    endings: tuple[Ending, ...]
    impacts: tuple[Impact, ...]
    failures: FailedRollouts
    driver_shift: DriverShift | None
    worker_s: float
    sim_s: float
    in_sumo: int
    x_realtime_per_core: Number


class ModesFacts(Modes, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The failure modes of one job of the run, as `tailroad failures --json` prints them, without the list."""


class Dangerous(Failure, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A dangerous rollout that the report shows: as of `tailroad failures --json`, and when its worst moment was."""

    job: str
    method_name: str
    mode_name: str
    steps: int | None
    worst_at_s: Number


class Report(_Fact, frozen=True, kw_only=True):
    """What a run came to. learned, risk and failure_modes are of the job that has met the most dangerous rollouts, but
    that the starts in `learned` are there for every job."""

    format: int = FORMAT
    made: str  # when, UTC
    run: str
    served: bool = False  # a job of a service, else a run directory
    question: str
    headline: Headline
    disagreement: str | None  # what to say where two methods' intervals have nothing in common
    scenario: ScenarioFacts
    jobs: tuple[JobFacts, ...]
    risk: Risk | None
    learned: dict[str, Learned]  # by job
    failure_modes: ModesFacts | None
    dangerous: tuple[Dangerous, ...]
    commands: tuple[str, ...]
    versions: dict[str, str]
    severity: Severity | None = None  # of the contacts among the dangerous rollouts that were run again
    prevention: Prevention | None = (
        None  # as `tailroad prevent` found it before, without the list of rollouts
    )
    coverage: Coverage | None = None  # of the operational design domain
