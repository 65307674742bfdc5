"""Runs on this machine as Python objects: what carries the command line, and what `import tailroad` gives.

estimate.py    `tailroad.estimate`: a question asked, run and answered
compare.py     `tailroad.compare`: egos on the same draws, or runs
question.py    what was asked for, as jobs
carry_out.py   runs jobs in a run directory, from wherever it stands: the one place that opens or creates one
progress.py    how far it is, and who is told; bars.py shows it on a terminal
run.py         a run: its estimates, report, failures, replays and tables
"""

from service.analysis.estimated import Estimated
from service.analysis.run.carry_out import Interrupted, carry_out, resume
from service.analysis.run.compare import Compared, compare
from service.analysis.run.estimate import estimate
from service.analysis.run.progress import Progress
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
