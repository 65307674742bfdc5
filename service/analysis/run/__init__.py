"""Runs on this machine as Python objects: what carries the command line, and what `import tailroad` gives.

estimate.py    `tailroad.estimate`: a question asked, run and answered
compare.py     `tailroad.compare`: egos on the same draws, or runs
question.py    what was asked for, as jobs
carry_out.py   runs jobs in a run directory, from wherever it stands: the one place that opens or creates one
run.py         a run: its estimates, report, failures, replays and tables
"""

from service.analysis.estimated import Estimated
from service.analysis.run.carry_out import Interrupted, Progress, carry_out, resume
from service.analysis.run.compare import Compared, compare
from service.analysis.run.estimate import estimate
from service.analysis.run.question import jobs_of
from service.analysis.run.run import Replay, Run

__all__ = [
    "Compared",
    "Estimated",
    "Interrupted",
    "Progress",
    "Replay",
    "Run",
    "carry_out",
    "compare",
    "estimate",
    "jobs_of",
    "resume",
]
