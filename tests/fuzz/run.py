"""The long fuzz run: python -m tests.fuzz.run --payloads 100000 --seed 1 --out build/fuzz (make fuzz).

Rounds of up to 500 payloads, each with its own seed; after each the counts and the memory are written to
OUT/fuzz-SEED.json, and the same command goes on from there. A payload that ends wrongly stops the run and is shown,
made as small as it gets.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.targets import Target, Targets

ROUND = 500
PAGE = os.sysconf("SC_PAGE_SIZE")


def run_round(target: Target, count: int, number: int) -> Counter[str]:
    """How `count` payloads of a target ended."""
    ends: Counter[str] = Counter()

    @seed(number)
    @settings(max_examples=count, database=None, deadline=None, suppress_health_check=list(HealthCheck),
              phases=(Phase.generate, Phase.shrink))  # fmt: skip
    @given(target.payloads)
    def one(payload: object) -> None:
        ends[target.run(payload)] += 1

    one()
    return ends


def memory_mb() -> float:
    """Of this process, resident."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--payloads", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/fuzz"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    path = asked.out / f"fuzz-{asked.seed}.json"
    done = json.loads(path.read_text()) if path.exists() else {"rounds": {}, "memory_mb": []}
    with tempfile.TemporaryDirectory() as folder, Targets(Path(folder)) as targets:
        rounds = plan(targets.all, asked.payloads)
        for number, (target, count) in enumerate(rounds):
            name = f"{number} {target.name} {count}"
            if name in done["rounds"]:
                continue
            done["rounds"][name] = run_round(target, count, asked.seed * 1_000_003 + number)
            done["memory_mb"].append(round(memory_mb(), 1))
            path.write_text(json.dumps(done, indent=1))
            print(
                f"{number + 1}/{len(rounds)} {target.name}: {dict(done['rounds'][name])}, {memory_mb():.0f} MB",
                flush=True,
            )
    _summary(done, targets.all)


def plan(targets: tuple[Target, ...], payloads: int) -> list[tuple[Target, int]]:
    """The rounds, targets in turn, so that memory is seen for all of them from the beginning to the end."""
    left = {t.name: max(1, round(payloads * t.share)) for t in targets}
    rounds = []
    while any(left.values()):
        for target in targets:
            if count := min(ROUND, left[target.name]):
                left[target.name] -= count
                rounds.append((target, count))
    return rounds


def _summary(done: dict, targets: tuple[Target, ...]) -> None:
    total = 0
    for target in targets:
        ends: Counter[str] = Counter()
        for name, counts in done["rounds"].items():
            if f" {target.name} " in f"{name} ":
                ends.update(counts)
        total += sum(ends.values())
        print(f"{target.name}: {sum(ends.values())} payloads: {dict(ends.most_common())}")
    memory = done["memory_mb"]
    print(f"{total} payloads, no crash; memory {memory[min(len(memory) - 1, len(targets))]} MB after one round of each "
          f"target, {memory[-1]} MB at the end")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
