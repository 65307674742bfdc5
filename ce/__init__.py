"""Rare-event statistics: the probability that f(X) <= gamma, X from a known base distribution, f a black box.

README.md in this folder has the notation, the equations and the conditions behind each warning.
"""

from ce import paths
from ce.auto import Auto, AutoOptions
from ce.beta import Beta
from ce.codec import to_bytes
from ce.comparison import Comparison, compare
from ce.cross_entropy import CrossEntropy, CrossEntropyOptions
from ce.errors import (
    BudgetError,
    CeError,
    FamilyError,
    OptionsError,
    ResponseError,
    StateError,
    ThresholdError,
)
from ce.estimate_warnings import EstimateWarning
from ce.further_marginals import TruncatedLogNormal, TwoNormals
from ce.level import levelled
from ce.marginals import Exponential, Gumbel, LogNormal, Marginal, TruncatedNormal, Uniform, Weibull
from ce.mixture import MixtureOptions, MixtureSampling
from ce.naive import Naive, NaiveOptions
from ce.normal import Normal
from ce.paired import paired
from ce.paths import PathEstimate, PathOptions, PathSampling, Process, Simulator, estimate_paths
from ce.product import Product
from ce.protocol import Algorithm
from ce.records import Batch, EstimationRecord, TrainingRecord
from ce.replicated import ReplicatedEstimate
from ce.results import Curve, Estimate, FailedRollout, Trace, variance_ratio
from ce.robust import Sensitivity, reweighted, sensitivity, worst_case
from ce.run import METHODS, OPTIONS, algorithm, estimate, general_options, present_options
from ce.splitting import Splitting, SplittingOptions
from ce.standard_normal import StandardNormal
from ce.state import AutoState, CrossEntropyState, MixtureState, NaiveState, SplittingState
from ce.streams import Stream, draw

White = StandardNormal  # its former name

__all__ = [
    "METHODS",
    "OPTIONS",
    "Algorithm",
    "Auto",
    "AutoOptions",
    "AutoState",
    "Batch",
    "Beta",
    "BudgetError",
    "CeError",
    "Comparison",
    "CrossEntropy",
    "CrossEntropyOptions",
    "CrossEntropyState",
    "Curve",
    "Estimate",
    "EstimateWarning",
    "EstimationRecord",
    "Exponential",
    "FailedRollout",
    "FamilyError",
    "Gumbel",
    "LogNormal",
    "Marginal",
    "MixtureOptions",
    "MixtureSampling",
    "MixtureState",
    "Naive",
    "NaiveOptions",
    "NaiveState",
    "Normal",
    "OptionsError",
    "PathEstimate",
    "PathOptions",
    "PathSampling",
    "Process",
    "Product",
    "ReplicatedEstimate",
    "ResponseError",
    "Sensitivity",
    "Simulator",
    "Splitting",
    "SplittingOptions",
    "SplittingState",
    "StandardNormal",
    "StateError",
    "Stream",
    "ThresholdError",
    "Trace",
    "TrainingRecord",
    "TruncatedLogNormal",
    "TruncatedNormal",
    "TwoNormals",
    "Uniform",
    "Weibull",
    "White",
    "algorithm",
    "compare",
    "draw",
    "estimate",
    "estimate_paths",
    "general_options",
    "levelled",
    "paired",
    "paths",
    "present_options",
    "reweighted",
    "sensitivity",
    "to_bytes",
    "variance_ratio",
    "worst_case",
]
