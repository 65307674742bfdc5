"""How often an ego touches another vehicle under P0, per million km, and in how many contacts it runs into the other.

    tailroad train rates --scenario i80-10s --ego lidar --rollouts 300000 --seed 1 --out DIR --card ego-lidar.json

The rollouts are those of naive Monte Carlo with that seed. Egos that need no SUMO are driven without it, those with a
contact and a hundredth of the others in SUMO as well, with the same bits; other egos are driven in SUMO. The ego runs
into the other where it is the striking vehicle of the contact (service.world.safety.contact). Kept in --out by chunks
of 500 rollouts, in rates-EGO.jsonl: an interrupted run, or one with more rollouts, goes on from there. With --card the
result goes into that weights card too.
"""

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
from rich.progress import Progress

import ce
from policies.egos import ego_digest
from service.errors import InputError
from service.evaluation.job import Problem, make_job
from service.training.metrics import rate, share
from service.world import agents as A
from service.world.safety.contact import Contact
from service.world.scenario import load_scenario
from service.world.scenario.base import unpack
from service.world.scenario.load import digest
from service.world.scenario.schema import Scenario
from service.world.sim.audited import Audited
from service.world.sim.rollout import Simulator
from service.world.sim.without_sumo import WithoutSumo, can_leave_out_sumo

CHUNK = 500  # rollouts
SPEEDS_MPS = (1.0, 2.0, 5.0, 10.0)  # impact speeds at and above which contacts are counted, too


class Touch(msgspec.Struct, frozen=True):
    """A contact of the ego: the rollout's number, its time (s), and what it was."""

    rollout: int
    time_s: float
    contact: Contact


class Chunk(msgspec.Struct, frozen=True):
    """What CHUNK rollouts came to.

    key: what two runs must have in common for their chunks to be added up
    """

    key: str
    number: int
    km: float
    outcomes: dict[str, int]
    contacts: list[Touch]
    in_sumo: int


def key_of(scenario: Scenario, ego: str, seed: int) -> str:
    return f"{digest(scenario)}-{ego}-{ego_digest(ego)[:16]}-{seed}"


class Driven:
    """Rollouts of one ego, with the way it drove."""

    def __init__(self, scenario: Scenario, ego: str, seed: int) -> None:
        self.scenario, self.ego, self.seed = scenario, ego, seed
        self.problem = Problem(make_job(scenario, ego, 0.0, "naive", seed, {}))
        self._runner: Audited | Simulator
        if can_leave_out_sumo(scenario, ego):
            alone = WithoutSumo(scenario, self.problem.corridor, self.problem.drivers, ego)
            self._runner, self._world = Audited(alone, self.problem.simulator, 0.0), alone.world
        else:
            self._runner = self.problem.simulator()
            self._world = self._runner.world

    def close(self) -> None:
        self._runner.close()

    def chunk(self, number: int) -> Chunk:
        """The rollouts with numbers from number * CHUNK on."""
        first = number * CHUNK
        x, seeds = ce.draw(self.problem.base, self.seed, "estimate", 0, first, first + CHUNK)
        km, outcomes, contacts = 0.0, Counter[str](), []
        before = self._runner.in_sumo
        self._runner.begin_chunk()
        for i in range(CHUNK):
            found = self._runner.run(x[i], int(seeds[i]))
            outcomes[found.outcome] += 1
            if found.contact is not None:
                contacts.append(Touch(first + i, found.steps * self.scenario.time.step_s, found.contact))
            row = self._world.agents[self._world.ego]
            start = unpack(self.scenario, x[i])[0][self._world.ego].station_m
            if found.error is None:
                km += (row[A.STATION] * self._world.road.spacing_m + row[A.ALONG_M] - start) / 1000.0
        in_sumo = self._runner.in_sumo - before
        key = key_of(self.scenario, self.ego, self.seed)
        return Chunk(key, number, float(km), dict(outcomes), contacts, in_sumo)


def kept(path: Path, key: str) -> dict[int, Chunk]:
    """Chunks of a run that went before; InputError where the file holds those of another."""
    if not path.is_file():
        return {}
    lines = path.read_bytes().splitlines(keepends=True)
    if lines and not lines[-1].endswith(b"\n"):  # cut off when the run was stopped
        lines = lines[:-1]
        path.write_bytes(b"".join(lines))
    try:
        chunks = [msgspec.json.decode(line, type=Chunk) for line in lines]
    except msgspec.MsgspecError as error:
        raise InputError(f"{path} does not hold chunks of rates ({error}); give another --out") from error
    if any(chunk.key != key for chunk in chunks):
        raise InputError(f"{path} holds rates of another scenario, ego or seed; give another --out")
    return {chunk.number: chunk for chunk in chunks}


def facts(scenario: Scenario, ego: str, chunks: list[Chunk]) -> dict[str, Any]:
    """What the card says of the chunks together."""
    contacts = [touch.contact for chunk in chunks for touch in chunk.contacts]
    km = sum(chunk.km for chunk in chunks)
    outcomes = sum((Counter(chunk.outcomes) for chunk in chunks), Counter[str]())
    own = [contact for contact in contacts if contact.striking == "ego"]
    return {
        "scenario": scenario.name,
        "ego": ego,
        "rollouts": CHUNK * len(chunks),
        "in_sumo": sum(chunk.in_sumo for chunk in chunks),
        "km": round(km, 1),
        "outcomes": dict(outcomes),
        "contacts": rate(len(contacts), km),
        "contacts_by_impact_speed": [
            {"mps": v, **rate(sum(contact.speed_mps >= v for contact in contacts), km)} for v in SPEEDS_MPS
        ],
        "runs_into_the_other": rate(len(own), km),
        "share_that_it_runs_into": share(len(own), len(contacts)) if contacts else None,
        "sides": dict(Counter(f"{c.ego_side} to {c.other_side}" for c in contacts)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="i80-10s", help="[i80-10s]")
    parser.add_argument("--ego", required=True)
    parser.add_argument("--rollouts", type=int, default=300_000, help=f"rounded up to {CHUNK} [300000]")
    parser.add_argument("--seed", type=int, default=1, help="[1]")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--card", type=Path, help="a weights card that takes the result too")
    arguments = parser.parse_args()
    if arguments.rollouts < 1:
        raise InputError(f"--rollouts {arguments.rollouts}: expected at least 1")
    scenario = load_scenario(arguments.scenario)
    key = key_of(scenario, arguments.ego, arguments.seed)
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / f"rates-{arguments.ego}.jsonl"
    found = kept(path, key)
    wanted = range(-(-arguments.rollouts // CHUNK))
    driven = Driven(scenario, arguments.ego, arguments.seed)
    try:
        with Progress() as progress, path.open("ab") as file:
            for number in progress.track(wanted, description=arguments.ego):
                if number not in found:
                    found[number] = driven.chunk(number)
                    file.write(msgspec.json.encode(found[number]) + b"\n")
                    file.flush()
    finally:
        driven.close()
    told = facts(scenario, arguments.ego, [found[number] for number in wanted]) | {
        "command": f"tailroad train rates --scenario {arguments.scenario} --ego {arguments.ego} "
        f"--rollouts {len(wanted) * CHUNK} --seed {arguments.seed} --out DIR"
    }
    if arguments.card is not None:
        card = json.loads(arguments.card.read_text(encoding="utf-8"))
        card.setdefault("rates", {})[scenario.name] = told
        arguments.card.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
