"""What can go wrong, as a small tree.

TailroadError                 everything that a user can put right; its text says what was given and what to do
├── InputError                a file, an option or a value that is not as it must be (exit code 2)
│   └── ScenarioError         a scenario file: names the file, the key and the value
├── SimulationError           the world cannot run: SUMO refused, or a second simulation in one process
├── EgoError                  the ego policy failed or answered nonsense (recorded with the rollout)
├── TooManyFailures           more rollouts failed than the job tolerates
├── StoreError                a run directory that is not one, is damaged, or belongs to another job
│   ├── StoreOutage           the database does not answer now, and may later
│   └── Superseded            another scheduler has taken the database over: this one writes no more
└── WorkerError               no worker process can start
"""

LONGEST_VALUE = 200  # characters of a wrong value that a message shows


class TailroadError(Exception):
    """Something that the user can put right."""


class InputError(TailroadError):
    """An option, a file or a value that is not as it must be."""


class ScenarioError(InputError):
    """A scenario that cannot be used: the file, the key, the value given, and what to do."""

    def __init__(self, source: str, key: str, given: object, remedy: str):
        self.source, self.key, self.given, self.remedy = source, key, given, remedy
        where = f"{source}: {key}" if key else source
        value_text = "" if given is None else f" is {_shortened(repr(given))}"
        super().__init__(f"{where}{value_text}: {remedy}")


class SimulationError(TailroadError):
    """The world cannot run."""


class EgoError(TailroadError):
    """The ego policy failed or answered nonsense."""


class TooManyFailures(TailroadError):
    """More rollouts failed than the job tolerates."""


class StoreError(TailroadError):
    """A run directory that cannot be used."""


class StoreOutage(StoreError):
    """A database that does not answer now."""


class Superseded(StoreError):
    """Another scheduler has taken over."""


class WorkerError(TailroadError):
    """No worker process can start."""


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}..."
