"""A campaign of counted rollouts: chunks by numbered draws from P0, on processes, kept as they are done.

A chunk is a line of `counts.jsonl` in the campaign's folder. A campaign that is begun again goes on after the lines
that are there; lines of another scenario, ego or seed are refused. One rollout in EVERY, chosen by its noise seed, is
run in SUMO too and must end in the same state to the bit; where leaks are forced, its tree's stem is.
"""

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import msgspec
import numpy as np

import ce
from policies.drivers import load_drivers
from policies.egos import load_ego
from service.errors import InputError, SimulationError
from service.studies.human.counting import Counter
from service.studies.human.leaks import Tree
from service.studies.human.watching import EVENT, TALLIES
from service.world.scenario.base import base_distribution
from service.world.scenario.check import check_road
from service.world.scenario.human import with_epsilon
from service.world.scenario.load import digest
from service.world.scenario.schema import CameraSpec, Safety, Scenario
from service.world.sim.audited import EVERY
from service.world.sim.rollout import OUTCOMES, Simulator
from service.world.sim.world import World

CHUNK = 250  # rollouts
FILE = "counts.jsonl"


class Settings(msgspec.Struct, frozen=True):
    """What a campaign counts in.

    ego: `idm` or `lidar`, which drives the one vehicle that is not counted
    forced: by trees of forced leaks (`service.studies.human.leaks`), good for every epsilon; the scenario has a human
        table then
    """

    scenario: Scenario
    ego: str
    seed: int
    forced: bool = False

    @property
    def driven(self) -> Scenario:
        """The scenario whose rollouts are driven: nobody leaks by chance where leaks are forced."""
        return with_epsilon(self.scenario, 0.0) if self.forced else self.scenario

    @property
    def key(self) -> str:
        """What two campaigns must have in common for their chunks to be added up: all that the drivers' rollouts depend
        on, which the scenario's name, description, measure and camera are not."""
        driven = msgspec.structs.replace(
            self.driven, name="", description="", safety=Safety(), camera=CameraSpec(), fixed=None
        )
        return f"{digest(driven)}-{self.ego}-{self.seed}" + ("-forced" if self.forced else "")


class Chunk(msgspec.Struct, frozen=True):
    """What `CHUNK` rollouts came to.

    tallies: (2, TALLIES)
    events: rows of `watching`, the rollout's number before them
    outcomes: how many ended how
    in_sumo: how many were run in SUMO too, with the same bits
    """

    key: str
    number: int
    tallies: list[list[float]]
    events: list[list[float]]
    outcomes: dict[str, int]
    in_sumo: int


class Counts(msgspec.Struct, frozen=True):
    """All chunks together; `events` (n, 1 + EVENT)."""

    rollouts: int
    tallies: np.ndarray
    events: np.ndarray
    outcomes: dict[str, int]
    in_sumo: int


class _LastState:
    """Keeps the state in which a rollout ended."""

    def __init__(self) -> None:
        self.agents: np.ndarray = np.zeros(0)

    def see(self, world: World, time_s: float, ttc_s: float, action: tuple[float, float] | None) -> None:
        if action is None:
            self.agents = world.agents.copy()


def count_chunk(settings: Settings, number: int, sumo: bool = True) -> Chunk:
    """Chunk `number` of the campaign; SimulationError where SUMO's world ends otherwise than the compiled one."""
    scenario = settings.driven
    corridor, drivers = check_road(scenario, scenario.name), load_drivers(scenario.drivers.weights)
    counter = Counter(scenario, corridor, drivers, settings.ego)
    tree = Tree(counter) if settings.forced else None
    first = number * CHUNK
    x, seeds = ce.draw(
        base_distribution(scenario, drivers), settings.seed, "estimate", 0, first, first + CHUNK
    )
    tallies, events, outcomes = np.zeros((2, TALLIES)), [], dict.fromkeys(OUTCOMES.values(), 0)
    audited = [k for k in range(CHUNK) if int(seeds[k]) % EVERY == 0] if sumo else []
    ends: dict[int, tuple[str, int, np.ndarray]] = {}
    for k in range(CHUNK):
        if tree is None:
            status, steps, found = counter.run(x[k], int(seeds[k]), tallies)
            end = counter.agents
        else:
            status, steps, end, found = tree.grow(x[k], int(seeds[k]), tallies)
        outcomes[OUTCOMES[status]] += 1
        events += [[float(first + k), *row.tolist()] for row in found]
        if k in audited:
            ends[k] = OUTCOMES[status], steps, end.copy()
    if audited:
        with Simulator(scenario, corridor, drivers, load_ego(settings.ego)) as simulator:
            for k in audited:
                last = _LastState()
                again = simulator.run(x[k], int(seeds[k]), last)
                if (again.outcome, again.steps) != ends[k][:2] or not np.array_equal(last.agents, ends[k][2]):
                    raise SimulationError(
                        f"rollout {first + k} of {scenario.name} (seed {settings.seed}) ended as {ends[k][:2]} without "
                        f"SUMO and as {(again.outcome, again.steps)} with it, or elsewhere: they must be the same to "
                        "the bit; report this"
                    )
    return Chunk(settings.key, number, tallies.tolist(), events, outcomes, len(audited))


def run(
    settings: Settings,
    rollouts: int,
    folder: Path,
    workers: int,
    told: Callable[[int, int], None] = lambda *_: None,
) -> Counts:
    """Count in so many rollouts (rounded up to chunks), on `workers` processes; told(done, wanted) in chunks."""
    wanted = -(-rollouts // CHUNK)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / FILE
    done = {chunk.number: chunk for chunk in _kept(path, settings)}
    missing = [number for number in range(wanted) if number not in done]
    told(wanted - len(missing), wanted)
    if missing:
        with path.open("ab") as file:
            for chunk in _counted(settings, missing, workers):
                file.write(msgspec.json.encode(chunk) + b"\n")
                file.flush()
                done[chunk.number] = chunk
                told(sum(number < wanted for number in done), wanted)
    return added([done[number] for number in range(wanted)])


def _kept(path: Path, settings: Settings) -> Iterator[Chunk]:
    if not path.exists():
        return
    for number, line in enumerate(path.read_bytes().splitlines(keepends=True)):
        try:
            chunk = msgspec.json.decode(line, type=Chunk)
        except msgspec.DecodeError as error:
            if not line.endswith(b"\n"):  # cut off when the campaign was stopped
                path.write_bytes(path.read_bytes()[: -len(line)])
                return
            raise InputError(
                f"{path}, line {number + 1}: not a chunk of counts ({error}); give another --out"
            ) from error
        if chunk.key != settings.key:
            raise InputError(
                f"{path} holds counts of another scenario, epsilon, ego, seed or way to count; give another --out, or "
                "remove it"
            )
        yield chunk


def _counted(settings: Settings, numbers: list[int], workers: int) -> Iterator[Chunk]:
    if workers == 1:
        for number in numbers:
            yield count_chunk(settings, number)
        return
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        tasks = [pool.submit(count_chunk, settings, number) for number in numbers]
        try:
            for task in as_completed(tasks):
                yield task.result()
        finally:
            pool.shutdown(cancel_futures=True)


def added(chunks: list[Chunk]) -> Counts:
    """The chunks' counts together."""
    rows = [row for chunk in chunks for row in chunk.events]
    return Counts(
        rollouts=CHUNK * len(chunks),
        tallies=np.sum([chunk.tallies for chunk in chunks], axis=0).reshape(2, TALLIES),
        events=np.array(rows).reshape(len(rows), 1 + EVENT),
        outcomes={name: sum(chunk.outcomes[name] for chunk in chunks) for name in OUTCOMES.values()},
        in_sumo=sum(chunk.in_sumo for chunk in chunks),
    )
