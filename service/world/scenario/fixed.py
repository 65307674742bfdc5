"""A scenario file that holds one rollout: every random value of it written down, so that it can be run again.

    [fixed]                      the noise seed, the driver weights, and who drove
    [[fixed.starts]]             where each vehicle starts

The rest of the file is the scenario that the rollout was drawn from. Numbers are written with all their digits: they
come back to the bit, and so does f. A value may be changed by hand, to see what would have been.
"""

from typing import Any

import msgspec
import numpy as np
import tomli_w

import ce
from policies.layout import HEAD_SIZE
from service.errors import ScenarioError
from service.world.scenario.noise import Noise, noise_of
from service.world.scenario.renamed import to_written
from service.world.scenario.schema import Fixed, FixedStart, Scenario

STARTS = tuple(key for key in FixedStart.__struct_fields__ if key != "name")


def fixed_of(scenario: Scenario, base: ce.Product, x: np.ndarray, noise_seed: Noise) -> Fixed:
    """The fixed rollout that x (d,), a draw from P0, and its noise seed stand for."""
    values = dict(zip(_names(base), x.tolist(), strict=True))
    starts = tuple(
        FixedStart(name=v.name, **{key: values.pop(f"{v.name}.{key}") for key in scenario.start_names})
        for v in scenario.vehicles
    )
    weights = tuple(values.pop(f"xi[{i}]") for i in range(HEAD_SIZE))
    return Fixed(noise_seed=str(noise_seed), starts=starts, driver_weights=weights, others=values)


def fixed_draw(base: ce.Product, fixed: Fixed, weights_sha256: str, source: str) -> tuple[np.ndarray, Noise]:
    """x (d,) and the noise seed of the fixed rollout.

    ScenarioError where it lacks one of P0's values, or is of other driver weights than `weights_sha256`.
    """
    if fixed.weights_sha256 not in (None, weights_sha256):
        raise ScenarioError(
            source,
            "fixed.weights_sha256",
            fixed.weights_sha256,
            f"the drivers' weights are others now ({weights_sha256}), and would drive otherwise; use the tailroad that "
            "wrote this file, or remove this line to see what its values come to with today's weights",
        )
    values = {
        f"{start.name}.{key}": value
        for start in fixed.starts
        for key in STARTS
        if (value := getattr(start, key)) is not None
    }
    values |= {f"xi[{i}]": weight for i, weight in enumerate(fixed.driver_weights)}
    values |= fixed.others
    names = _names(base)
    for name in names:
        if name not in values:
            raise ScenarioError(
                source, f"fixed.others.{name}", None, "missing; the scenario draws this value"
            )
    for name in sorted(values.keys() - set(names)):
        raise ScenarioError(source, f"fixed.others.{name}", values[name], "the scenario draws no such value")
    return np.array([values[name] for name in names]), noise_of(fixed.noise_seed)


def _names(base: ce.Product) -> tuple[str, ...]:
    assert base.names is not None
    return base.names


def released(scenario: Scenario) -> Scenario:
    """The scenario without its fixed rollout."""
    return msgspec.structs.replace(scenario, fixed=None)


def toml_of(scenario: Scenario, comment: str = "") -> str:
    """The scenario as the text of a file; `comment` lines go before it."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    body = tomli_w.dumps(_given(to_written(msgspec.to_builtins(scenario))))
    return "\n".join([*lines, body]) if lines else body


def _given(value: Any) -> Any:
    """Without what is not given: TOML has no null."""
    if isinstance(value, dict):
        return {key: _given(item) for key, item in value.items() if item is not None and item != {}}
    if isinstance(value, (list, tuple)):
        return [_given(item) for item in value]
    return value
