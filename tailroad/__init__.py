"""How probable is a dangerous event for this driving policy in real traffic, how sure are we, and how does it fail?

    import tailroad

    run = tailroad.estimate("i80-paper-10s", ego="lidar-paper", gamma=0.7, budget=4_000)
    run.estimate.p, run.estimate.ci
    run.report("out.html")
    run.failures()
    run.replay(1).video("worst.mp4")
    run.to_polars()

estimate      ask, run and answer; resume goes on with a run that was interrupted
compare       egos on the same draws, or runs that there are already
client        a service, whose jobs are runs of the same kind
Run, Replay   what they give
"""

from service.analysis.run import (
    Compared,
    Estimated,
    Interrupted,
    Progress,
    Replay,
    Run,
    compare,
    estimate,
    resume,
)
from service.errors import TailroadError
from service.evaluation.submitit_executor import SubmititExecutor
from service.remote.client.service import RemoteReplay, RemoteRun, Service, client
from service.world.scenario import Scenario, load_scenario

__all__ = [
    "Compared",
    "Estimated",
    "Interrupted",
    "Progress",
    "RemoteReplay",
    "RemoteRun",
    "Replay",
    "Run",
    "Scenario",
    "Service",
    "SubmititExecutor",
    "TailroadError",
    "client",
    "compare",
    "estimate",
    "load_scenario",
    "resume",
]
