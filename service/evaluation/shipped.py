"""The committors that come with tailroad, for the scenarios that come with it.

A committor fits where the rollouts mean the same: the drivers, the starts, the noise, the measure and the length. The
ego may be another; what a committor does not know of it costs precision alone. So a scenario has the committor of a
built-in one whose tables are the same, whatever its name and description.
"""

import hashlib
from importlib import resources

import msgspec

from ce.paths import NetworkCommittor
from service.evaluation.path_store import committor_of
from service.world.scenario.schema import Scenario

_WHAT_IT_IS_CALLED = ("name", "description")


def file_of(name: str) -> str:
    """The file's name of the committor for a built-in scenario."""
    return f"committor-{name}.msgpack"


def card_of(name: str) -> str:
    """The file's name of its card."""
    return f"committor-{name}.json"


def meaning_of(scenario: Scenario) -> str:
    """SHA-256 of all that decides a scenario's rollouts, its name and description left out."""
    tables = msgspec.to_builtins(scenario)
    kept = {key: tables[key] for key in sorted(tables) if key not in _WHAT_IT_IS_CALLED}
    return hashlib.sha256(msgspec.json.encode(kept, order="sorted")).hexdigest()


def shipped_for(scenario: Scenario) -> tuple[NetworkCommittor, bytes] | None:
    """The committor that fits a scenario, and its bytes; None where none comes with tailroad."""
    folder, meaning = resources.files("policies") / "weights", meaning_of(scenario)
    for card in folder.iterdir():
        if card.name.startswith("committor-") and card.name.endswith(".json"):
            told = msgspec.json.decode(card.read_bytes())
            if told["meaning_sha256"] == meaning:
                file = folder / file_of(told["scenario"])
                data = file.read_bytes()
                return committor_of(data, str(file)), data
    return None
