"""What jobs may name: scenarios, roads, weights and egos that come with tailroad or that the service's owner offers.

What a client sends by value names roads and weights out of these, never a file.
"""

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from policies.drivers import shipped
from policies.egos import ego_names
from service.errors import InputError
from service.remote.api.objects import Ego, Egos, ScenarioEntry, Scenarios
from service.remote.api.problems import ApiError, Wrong, short
from service.world.egos.settings import EgoSettings
from service.world.egos.sumo import NAMES as SUMO_EGOS
from service.world.safety.measure import with_measure
from service.world.scenario import Scenario, load_scenario
from service.world.scenario.check import check_road
from service.world.scenario.fixed import toml_of
from service.world.scenario.load import built_in_names, parse_scenario
from service.world.scenario.noise_mode import with_noise_mode
from sumo_nets.corridor import BUILT_IN

BY_VALUE = "the scenario"  # what messages call one that was sent
NOWHERE = Path("/nonexistent")  # no path in it is ever followed


class Catalogue:
    """What jobs may name.

    offered: files of the owner's own scenarios
    services: names of the ego services that are there now
    """

    def __init__(self, offered: Sequence[str] = (), services: Callable[[], Sequence[str]] = lambda: ()):
        self._built_in = {name: load_scenario(name) for name in built_in_names()}
        self._offered: dict[str, Scenario] = {}
        self._services = services
        for file in offered:
            scenario = load_scenario(file)
            if scenario.name in self._built_in or scenario.name in self._offered:
                raise InputError(
                    f"{file}: there is a scenario {scenario.name!r} already; give it another name"
                )
            check_road(scenario, file)
            self._offered[scenario.name] = scenario

    def scenarios(self) -> Scenarios:
        entries = [
            ScenarioEntry(name=name, description=s.description, vehicles=len(s.vehicles), horizon_s=s.time.horizon_s,
                          step_s=s.time.step_s, built_in=name in self._built_in)
            for name, s in (self._built_in | self._offered).items()
        ]  # fmt: skip
        names = tuple(self._offered)
        return Scenarios(items=tuple(entries), roads=BUILT_IN + names, weights=(*shipped(), *names))

    def egos(self) -> Egos:
        found = [Ego(name=name, kind="built-in") for name in (*ego_names(), *SUMO_EGOS)]
        found += [Ego(name=name, kind="class") for name in sorted(EgoSettings.from_environment().python)]
        found += [Ego(name=f"zenoh:{name}", kind="service") for name in sorted(set(self._services()))]
        return Egos(items=tuple(found))

    def named(self, name: str) -> Scenario:
        """The listed scenario of that name."""
        known = self._built_in | self._offered
        if name not in known:
            expected = f"one of {', '.join(known)}, or a scenario by value"
            raise ApiError(
                "not-found",
                f"there is no scenario {short(name)!r}; give {expected}",
                (Wrong("scenario", short(name), expected),),
            )
        return known[name]

    def by_value(self, data: dict[str, Any]) -> Scenario:
        """A client's own scenario; its road and weights may be those of an offered one, by that one's name."""
        own = dict(data)
        own["network"] = self._permitted(own.get("network"), "network", "road", BUILT_IN)
        if "drivers" in own:
            own["drivers"] = self._permitted(own["drivers"], "drivers", "weights", shipped())
        scenario = parse_scenario(own, BY_VALUE, NOWHERE)
        check_road(scenario, BY_VALUE)
        return scenario

    def again(self, scenario: Scenario) -> tuple[str | None, str | None] | None:
        """Measure and noise mode to give beside the scenario's name to have it again, each None where the listed one
        has it; None where the name does not bring it back."""
        listed = (self._built_in | self._offered).get(scenario.name)
        if listed is None:
            return None
        measure, noise_mode = scenario.safety.measure, scenario.drivers.noise_mode
        if with_noise_mode(with_measure(listed, measure), noise_mode) != scenario:
            return None
        return (
            None if listed.safety.measure == measure else measure,
            None if listed.drivers.noise_mode == noise_mode else noise_mode,
        )

    def text_of(self, scenario: Scenario) -> str:
        """The text of a scenario file as `by_value` takes it: the owner's roads and weights by scenario."""
        written = tomllib.loads(toml_of(scenario))
        for name, offered in self._offered.items():
            theirs = tomllib.loads(toml_of(offered))
            if written.get("network") == theirs.get("network"):
                written["network"] = {"road": name}
            own, other = written.get("drivers", {}), theirs.get("drivers", {})
            if (
                "weights" in own
                and own["weights"] == other.get("weights")
                and own["weights"] not in shipped()
            ):
                own["weights"] = name
        return tomli_w.dumps(written)

    def _permitted(self, table: Any, name: str, key: str, built_in: Sequence[str]) -> Any:
        """The table with its file's name made sure of."""
        if not isinstance(table, dict) or not isinstance(table.get(key), str) or table[key] in built_in:
            return table
        given = table[key]
        if given not in self._offered:
            expected = f"one of {', '.join([*built_in, *self._offered])}; files are not taken"
            where = f"{name}.{key}"
            raise ApiError(
                "bad-scenario",
                f"{where} is {short(given)!r}: give {expected}",
                (Wrong(where, short(given), expected),),
            )
        its = msgspec.to_builtins(getattr(self._offered[given], name))
        return its if name == "network" else table | {key: its[key]}
