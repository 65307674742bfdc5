"""Makes each peer's environment, and times it in turns with tailroad."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

import ce
from service.evaluation.job import Problem, make_job
from service.world.scenario import load_scenario

SCENARIO = "i80-paper-10s"
SECONDS = 10
HERE = Path(__file__).parent
INSTALL_LIMIT_S, RUN_LIMIT_S = 3600, 1800
MESSAGE_CHARS = 300  # characters of what a program that failed said last


class Peer(msgspec.Struct, frozen=True):
    """Another simulator to time beside ours.

    requirements: what is installed
    script: what is run in its environment
    """

    name: str
    requirements: tuple[str, ...]
    script: str


PEERS = (
    Peer("highway-env", ("highway-env==1.12.1",), "time_highway_env.py"),
    Peer("Scenic", ("scenic==3.1.1",), "time_scenic.py"),
    Peer("TeraSim", ("terasim==0.1.0",), "time_terasim.py"),
)


class Timed(msgspec.Struct, frozen=True, kw_only=True):
    """A simulator's rounds: simulated seconds a second of a core in each.

    failed: why there are none
    """

    name: str
    what: str
    speed: tuple[float, ...] = ()
    failed: str = ""


def timed(rounds: int, rollouts: int, folder: Path, tell: Callable[[str], None]) -> list[Timed]:
    """Every simulator's speed, ours first; peers that cannot be installed or run are told with the reason."""
    ready: dict[str, str] = {}
    for peer in PEERS:
        tell(f"installing {peer.name}")
        ready[peer.name] = _install(peer, folder)
    ours: dict[str, list[float]] = {"idm": [], "lidar": []}
    theirs: dict[str, list[float]] = {}
    what: dict[str, str] = {}
    for number in range(rounds):  # in turns: a busy machine slows all of them
        tell(f"round {number + 1} of {rounds}")
        for ego in ours:
            ours[ego].append(_own(ego, rollouts))
        for peer in PEERS:
            if not ready[peer.name]:
                speed, message = _run(peer, folder)
                theirs.setdefault(peer.name, []).extend(speed)
                if speed:
                    what[peer.name] = message
                else:
                    ready[peer.name] = message
    found = [Timed(name=f"tailroad, ego {ego}", what="SUMO in the loop, drivers' networks, lidar, time to collision",
                   speed=tuple(s)) for ego, s in ours.items()]  # fmt: skip
    for peer in PEERS:
        found.append(
            Timed(name=peer.name, what=what.get(peer.name, ", ".join(peer.requirements)),
                  speed=tuple(theirs.get(peer.name, ())), failed=ready[peer.name])
        )  # fmt: skip
    return found


def _own(ego: str, rollouts: int) -> float:
    """Simulated seconds a second of this core."""
    problem = Problem(make_job(load_scenario(SCENARIO), ego, 0.0, "naive", 1, {}))
    x, noise_seeds = ce.draw(problem.base, 1, "estimate", 0, 0, rollouts)
    with problem.simulator() as simulator:
        simulator.run(x[0], int(noise_seeds[0]))
        began = time.process_time()
        steps = sum(simulator.run(row, int(seed)).steps for row, seed in zip(x, noise_seeds, strict=True))
        taken = time.process_time() - began
    return steps * problem.job.scenario.time.step_s / taken


def _install(peer: Peer, folder: Path) -> str:
    """Make the peer's environment; "" or why it cannot be made."""
    place = folder / peer.name.lower()
    if (place / "ready").exists():
        return ""
    for command in (
        [sys.executable, "-m", "venv", str(place)],
        [str(place / "bin" / "python"), "-m", "pip", "install", "--quiet", *peer.requirements],
    ):
        failed = _failed(command, INSTALL_LIMIT_S)[0]
        if failed:
            return f"cannot be installed: {failed}"
    (place / "ready").write_text("", encoding="utf-8")
    return ""


def _run(peer: Peer, folder: Path) -> tuple[list[float], str]:
    """One round: the median speed of its runs, and what it did; no speed and why."""
    python = folder / peer.name.lower() / "bin" / "python"
    failed, output = _failed([str(python), str(HERE / peer.script), "5", str(SECONDS)], RUN_LIMIT_S)
    if failed:
        return [], f"cannot be run: {failed}"
    result = json.loads(output.splitlines()[-1])
    return [float(np.median(np.array(result["sim_s"]) / np.array(result["core_s"])))], result["what"]


def _failed(command: list[str], limit_s: float) -> tuple[str, str]:
    """ "" and what the command printed, or the last of what it said when it failed."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)[:MESSAGE_CHARS], ""
    if done.returncode:
        return (done.stderr.strip() or f"exit code {done.returncode}")[-MESSAGE_CHARS:].replace("\n", " "), ""
    return "", done.stdout
