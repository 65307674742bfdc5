"""Rare events of random paths: the probability that the smallest value of a measure along a path comes to gamma or
below.

A path is driven from checkpoint to checkpoint by a `Process`; a committor, fixed beforehand, says from which states
the event is still likely; starts are kept and paths split by that (`starts`, `tree`, `plan`). README.md has the
equations.
"""

from ce.paths.estimating import estimate_paths
from ce.paths.network import Net, NetworkCommittor, loaded, saved
from ce.paths.path_estimate import Cost, PathEstimate
from ce.paths.path_options import PathOptions
from ce.paths.path_state import PathBatch, PathState, PathTotals
from ce.paths.plan import Committor, Plan, schedule
from ce.paths.process import Process
from ce.paths.sampling import PathSampling
from ce.paths.simulator import Simulator
from ce.paths.starts import Roots, all_starts, kept_starts
from ce.paths.teaching import Taught, Teaching, teach
from ce.paths.tree import Driven, drive, joined, replay

__all__ = [
    "Committor",
    "Cost",
    "Driven",
    "Net",
    "NetworkCommittor",
    "PathBatch",
    "PathEstimate",
    "PathOptions",
    "PathSampling",
    "PathState",
    "PathTotals",
    "Plan",
    "Process",
    "Roots",
    "Simulator",
    "Taught",
    "Teaching",
    "all_starts",
    "drive",
    "estimate_paths",
    "joined",
    "kept_starts",
    "loaded",
    "replay",
    "saved",
    "schedule",
    "teach",
]
