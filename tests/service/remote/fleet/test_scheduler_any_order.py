"""Whatever happens in whatever order, every chunk counts once and the final bits are those of one process.

Hypothesis plays a fleet: it starts and kills workers, delivers answers late, twice or never, lets instructions be
carried out at any time, kills the scheduler, takes the database away, sets the clock, and asks for what a job comes to
at any moment, in the midst of other things too. Then everything that is left
is allowed to finish.
"""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

from service.evaluation.store.states import KeptState, LastState
from service.remote.fleet import events as E
from service.remote.fleet.policy import Policy
from tests.service.remote.fleet.world import ALGORITHMS, World, reference

QUICK = Policy(  # of three jobs one waits for the memory of another
    first_rows=17, max_rows=60, audit_share=0.2, limit_s=30.0, first_limit_s=30.0, open_bytes=2
)
AUDIT_ALL = Policy(
    first_rows=17, max_rows=60, audit_share=1.0, limit_s=30.0, first_limit_s=30.0, open_audits=10**6
)
PLAYS = 10_200
EXPECTED = {method: reference(method) for method in ("naive", "ce")}


class AnyOrder(RuleBasedStateMachine):
    policy = QUICK
    wrong_workers = 0
    audited = True

    @initialize(methods=st.sampled_from([["naive"], ["ce"], ["naive", "ce", "naive"]]))
    def begin(self, methods: list[str]) -> None:
        jobs = {f"j{i}": method for i, method in enumerate(methods)}
        self.world = World(jobs, self.policy, audited=self.audited)
        self.workers = 0
        self.trouble = False
        for i in range(self.wrong_workers):
            self.world.join(f"wrong{i}", 1, wrong=True)

    def _slots(self, lease: bool) -> list:
        return [s for s in self.world.slots.values() if (s.lease is not None) == lease]

    @rule(procs=st.integers(1, 3))
    def a_worker_starts(self, procs: int) -> None:
        if self.workers < 6:
            self.world.join(f"w{self.workers}", procs)
            self.workers += 1

    @precondition(lambda self: self.world.slots)
    @rule(data=st.data(), noticed=st.booleans())
    def a_worker_is_killed(self, data: st.DataObject, noticed: bool) -> None:
        worker = data.draw(st.sampled_from(sorted({name for name, _ in self.world.slots})))
        self.world.leave(worker, noticed)

    @precondition(lambda self: self._slots(lease=False))
    @rule(data=st.data())
    def a_slot_asks(self, data: st.DataObject) -> None:
        slots = self._slots(lease=False)
        self.world.ask(slots[data.draw(st.integers(0, len(slots) - 1))])

    @precondition(lambda self: self._slots(lease=True))
    @rule(data=st.data())
    def a_slot_runs_its_chunk(self, data: st.DataObject) -> None:
        slots = self._slots(lease=True)
        self.world.run(slots[data.draw(st.integers(0, len(slots) - 1))])

    @precondition(lambda self: self._slots(lease=True))
    @rule(data=st.data())
    def a_slot_loses_its_lease(self, data: st.DataObject) -> None:
        slots = self._slots(lease=True)
        slots[data.draw(st.integers(0, len(slots) - 1))].lease = None

    @precondition(lambda self: self.world.answers)
    @rule(data=st.data(), twice=st.booleans())
    def an_answer_arrives(self, data: st.DataObject, twice: bool) -> None:
        self.world.deliver(data.draw(st.integers(0, len(self.world.answers) - 1)), keep=twice)

    @precondition(lambda self: self.world.answers)
    @rule(data=st.data())
    def an_answer_is_lost(self, data: st.DataObject) -> None:
        del self.world.answers[data.draw(st.integers(0, len(self.world.answers) - 1))]

    @precondition(lambda self: self.world.instructions)
    @rule(data=st.data())
    def statistics_are_done(self, data: st.DataObject) -> None:
        self.world.compute(data.draw(st.integers(0, len(self.world.instructions) - 1)))

    @precondition(lambda self: self.world.writes and not self.trouble)
    @rule(times=st.integers(1, 5))
    def the_database_writes(self, times: int) -> None:
        for _ in range(min(times, len(self.world.writes))):
            self.world.write()

    @precondition(lambda self: self.world.writes and not self.trouble)
    @rule()
    def the_database_writes_and_its_answer_is_lost(self) -> None:
        """It is told of as an outage, and asked for again."""
        self.world.write(heard=False)
        self.trouble = True
        self.world.tell(E.StoreTrouble("the server closed the connection unexpectedly"))

    @rule()
    def the_database_comes_and_goes(self) -> None:
        self.trouble = not self.trouble
        self.world.tell(E.StoreTrouble("no space left") if self.trouble else E.StoreWell())

    @rule(seconds=st.sampled_from([-1e6, -1.0, 0.0, 0.3, 3.0, 40.0, 1e6]))
    def time_passes_or_the_clock_jumps(self, seconds: float) -> None:
        self.world.now += seconds
        self.world.tell(E.Tick())

    @rule()
    def the_scheduler_is_killed_and_started_again(self) -> None:
        self.trouble = False
        self.world.begin()

    @rule(data=st.data(), pause=st.booleans())
    def a_job_is_paused_or_resumed(self, data: st.DataObject, pause: bool) -> None:
        job = data.draw(st.sampled_from(sorted(self.world.jobs)))
        self.world.tell(E.Paused(job) if pause else E.Resumed(job))

    @precondition(lambda self: self.world.to_keep)
    @rule(data=st.data())
    def what_a_job_came_to_is_written_down(self, data: st.DataObject) -> None:
        self.world.keep(data.draw(st.integers(0, len(self.world.to_keep) - 1)))

    @rule(data=st.data(), moment=st.integers(0, 12), steps=st.integers(1, 4))
    def somebody_asks_while_things_happen(self, data: st.DataObject, moment: int, steps: int) -> None:
        world = self.world
        job = data.draw(st.sampled_from(sorted(world.jobs)))
        before = world.record.statuses.get(job), world.record.epoch(job)

        def meanwhile() -> None:
            for _ in range(steps):
                if world.instructions:
                    world.compute()
                elif world.writes and not self.trouble:
                    world.write()
                elif world.answers:
                    world.deliver()

        told = world.read(job, moment, meanwhile)
        if before[0] == "done" and before == (world.record.statuses[job], world.record.epoch(job)):
            assert told == EXPECTED[world.jobs[job]]

    @rule(data=st.data())
    def an_earlier_tailroad_has_kept_a_state(self, data: st.DataObject) -> None:
        """Of wherever the job was when somebody asked, and with no checksum."""
        job = data.draw(st.sampled_from(sorted(self.world.jobs)))
        _, step = self.world.statistics.last(job)
        state = ALGORITHMS[self.world.jobs[job]].to_bytes(step.state)
        epoch = self.world.record.epoch(job)
        last = LastState(job, epoch, step.number, "", state)
        self.world.record.states.setdefault((job, epoch), KeptState(last, False))

    def teardown(self) -> None:
        if not hasattr(self, "world"):
            return
        if self.trouble:
            self.world.tell(E.StoreWell())
        self.world.now = max(self.world.now, self.world.scheduler.now)
        for job in self.world.jobs:
            self.world.tell(E.Resumed(job))
        for i in range(3):
            self.world.join(f"last{i}", 2)
        self.world.finish()
        for job, method in self.world.jobs.items():
            assert self.world.record.statuses[job] == "done"
            assert self.world.bits(job) == EXPECTED[method]
            assert self.world.counted_once(job)
        for _ in self.world.to_keep[1:]:
            self.world.keep()
        self.world.begin()  # before the last job is written down
        self.world.statistics.heal()
        assert all(kept.sound for kept in self.world.record.states.values() if self._is_present(kept.last))
        for job, method in self.world.jobs.items():
            assert self.world.bits(job) == EXPECTED[method]
        names = {name for name in self.world.record.quarantined if not name.startswith("host ")}
        good = names - self.world.wrong
        assert not good, f"honest workers in quarantine: {good}"

    def _is_present(self, last: LastState) -> bool:
        return last.epoch == self.world.record.epoch(last.job)


class WithWrongWorkers(AnyOrder):
    """One worker in the fleet is wrong in every value, and all chunks are audited."""

    policy = AUDIT_ALL
    wrong_workers = 1


class BlackBoxes(AnyOrder):
    """Nobody is audited, and every chunk is run again on its worker and on another."""

    policy = AUDIT_ALL
    audited = False

    def teardown(self) -> None:
        super().teardown()
        if hasattr(self, "world"):
            assert all(told["repeated"] > 0 and told["differed"] == 0 for told in self.world.repeated)
            assert not self.world.scheduler.workers.quarantined


@pytest.mark.parametrize("machine", [AnyOrder, WithWrongWorkers, BlackBoxes])
def test_any_order_of_answers_losses_and_crashes_gives_the_same_bits(machine):
    run_state_machine_as_test(machine, settings=_settings(15, 60))


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("number", range(20))
@pytest.mark.parametrize("machine", [AnyOrder, WithWrongWorkers, BlackBoxes])
def test_any_order_in_ten_thousand_plays(machine, number):
    """By seed: the same number plays the same plays."""
    numbered = seed(number)(type(f"{machine.__name__}{number}", (machine,), {}))
    run_state_machine_as_test(numbered, settings=_settings(PLAYS // 60, 150))


def _settings(examples: int, steps: int) -> settings:
    return settings(
        max_examples=examples,
        stateful_step_count=steps,
        deadline=None,
        derandomize=examples < 100,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
