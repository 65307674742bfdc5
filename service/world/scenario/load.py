"""Read a scenario and refuse a wrong one, before any work starts, with the file, the key, the value and a remedy."""

import contextlib
import difflib
import hashlib
import math
import re
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import msgspec

from service.errors import ScenarioError
from service.world.scenario.check import DISTRIBUTIONS, check_values
from service.world.scenario.check_camera import WEATHER_RANGES
from service.world.scenario.renamed import to_stored, written_key
from service.world.scenario.schema import FORMAT, Distribution, Scenario
from sumo_nets.corridor import BUILT_IN

FOLDER = Path(__file__).parent
UNITS = {
    "m": "metres",
    "s": "seconds",
    "deg": "degrees",
    "mps": "metres per second",
    "veh_per_km_lane": "vehicles per kilometre and lane",
}
UNIT_ENDINGS = "|".join(
    [
        "mps",
        "kmh",
        "kph",
        "mph",
        "fps",
        "ms",
        "min",
        "h",
        "km",
        "cm",
        "mm",
        "ft",
        "feet",
        "mi",
        "deg",
        "rad",
        "s",
        "m",
    ]
)
KINDS = {  # msgspec's names of TOML's kinds of values
    "int": "a whole number",
    "float": "a number",
    "str": "text in quotes",
    "bool": "true or false",
    "object": "a table",
    "array": "a list",
}
MAX_BYTES = 1_000_000
TOO_DEEP = "nested too deeply; a scenario has a few levels"


def built_in_names() -> list[str]:
    """Names of the scenarios that come with tailroad."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_scenario(name_or_path: str) -> Scenario:
    """The scenario of that built-in name or file.

    Raises ScenarioError for a file that is missing, is not TOML, has unknown or missing keys, or values that cannot
    be used; the network it names is opened by `service.world.scenario.check.check_road`.
    """
    path = _find(name_or_path)
    source = path.stem if path.parent == FOLDER else str(path)
    return parse_scenario(read_toml(path, source), source, path.parent)


def read_toml(path: Path, source: str) -> dict[str, Any]:
    """What the file `path`, called `source` in messages, says; ScenarioError where it cannot be read."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ScenarioError(source, "", None, f"larger than {MAX_BYTES} bytes; this is not a scenario")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise ScenarioError(source, "", None, f"not a text file in UTF-8: {error}") from error
    except ValueError as error:  # tomllib's own error is one, and so is a number with thousands of digits
        raise ScenarioError(source, "", None, f"not valid TOML: {error}") from error
    except OSError as error:
        raise ScenarioError(source, "", None, f"cannot be read: {error.strerror or error}") from error
    except RecursionError as error:
        raise ScenarioError(source, "", None, TOO_DEEP) from error


def parse_scenario(data: dict[str, Any], source: str, folder: Path) -> Scenario:
    """The scenario in `data`, as read from `source`; paths in it are relative to `folder`."""
    try:
        _refuse_unusable_numbers(data, "", source)
    except RecursionError as error:
        raise ScenarioError(source, "", None, TOO_DEEP) from error
    if data.get("format") != FORMAT:
        raise ScenarioError(
            source,
            "format",
            data.get("format"),
            f"this tailroad reads scenario format {FORMAT}; write format = {FORMAT}",
        )
    data = to_stored(data, source)
    try:
        scenario = msgspec.convert(data, Scenario, strict=True)
    except msgspec.ValidationError as error:
        raise _explain(str(error), data, source) from error
    scenario = _resolve_paths(scenario, source, folder)
    check_values(scenario, source)
    return scenario


def digest(scenario: Scenario) -> str:
    """A hash of everything the scenario file says; paths are part of it, the files they name are not.

    A scenario that does not use what later versions brought keeps its hash.
    """
    said = without_later(msgspec.to_builtins(scenario, order="deterministic"))
    return hashlib.sha256(msgspec.json.encode(said)).hexdigest()[:16]


LATER = {  # fields of tables that later versions brought, with the value that means what scenarios meant before
    "human": None,
    "lateral_mps": None,
    "lateral_offset_gain": 0.0,
    "lateral_full_mps": 7.0,
    "lateral_speed_power": 1.0,
    "lateral_steepest_deg": 20.0,
}


def without_later(value: Any) -> Any:
    """A scenario's tables without the later fields that are as they were before there were any."""
    if isinstance(value, dict):
        return {k: without_later(v) for k, v in value.items() if k not in LATER or v != LATER[k]}
    if isinstance(value, (list, tuple)):
        return [without_later(item) for item in value]
    return value


def _find(name_or_path: str) -> Path:
    built_in = FOLDER / f"{name_or_path}.toml"
    if name_or_path in built_in_names():
        return built_in
    path = Path(name_or_path)
    with contextlib.suppress(OSError, ValueError):  # a name that no file can have
        if path.is_file():
            return path
    if path.suffix == ".toml" or len(path.parts) > 1:
        raise ScenarioError(
            name_or_path, "", None, "no such file; check the path, or see `tailroad scenario list`"
        )
    close = difflib.get_close_matches(name_or_path, built_in_names(), 1)
    hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(built_in_names())}"
    raise ScenarioError(name_or_path, "", None, f"no scenario of that name and no such file; {hint}")


def _resolve_paths(scenario: Scenario, source: str, folder: Path) -> Scenario:
    """Paths relative to the scenario's file become absolute."""

    def absolute(key: str, path: str) -> str:
        try:
            return str((folder / path).resolve())
        except (OSError, ValueError) as error:
            raise ScenarioError(source, key, path, f"not a path ({error}); check it") from error

    network, drivers = scenario.network, scenario.drivers
    if network.road not in BUILT_IN and ("." in network.road or "/" in network.road):  # a file, not a name
        network = msgspec.structs.replace(network, road=absolute("network.road", network.road))
    if drivers.weights.endswith(".safetensors"):
        drivers = msgspec.structs.replace(drivers, weights=absolute("drivers.weights", drivers.weights))
    return msgspec.structs.replace(scenario, network=network, drivers=drivers)


def _refuse_unusable_numbers(value: Any, key: str, source: str) -> None:
    if isinstance(value, dict):
        for name, item in value.items():
            _refuse_unusable_numbers(item, f"{key}.{name}" if key else name, source)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _refuse_unusable_numbers(item, f"{key}[{index}]", source)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ScenarioError(source, key, value, "not a finite number; give a finite one")
    elif isinstance(value, int) and value.bit_length() > 63:
        given = f"an integer of {value.bit_length()} bits"
        raise ScenarioError(source, key, given, "too large; give a number below 9e18")


def _explain(message: str, data: dict[str, Any], source: str) -> ScenarioError:
    """msgspec's message as ours: the key as the file writes it, the value, and what to do."""
    match = re.match(r"(?P<what>.*?)(?: - at `\$\.?(?P<path>.*)`)?$", message, re.S)
    what, path = (match["what"], match["path"] or "") if match else (message, "")
    if unknown := re.match(r"Object contains unknown field `(.*)`", what):
        name = unknown[1]
        key = f"{path}.{name}" if path else name
        return ScenarioError(source, key, _value_at(data, key), _suggest(name, path))
    if missing := re.match(r"Object missing required field `(.*)`", what):
        key = f"{path}.{missing[1]}" if path else missing[1]
        return ScenarioError(source, key, None, f"missing; add it{_unit_hint(missing[1])}")
    return ScenarioError(
        source, written_key(path), _value_at(data, path), _remedy(what, path.rpartition(".")[2])
    )


def _remedy(what: str, key: str) -> str:
    """What to do about msgspec's complaint `what` about the value of `key`."""
    if what.startswith("Invalid") and key in (choices := _choices()):
        return f"give {' or '.join(repr(choice) for choice in choices[key])}"
    expected = re.match(r"Expected `(\w+)(?: \| null)?`, got `(\w+)`", what)
    if not expected:
        return f"{what[:1].lower()}{what[1:]}; see `tailroad scenario show i80` for an example"
    if expected[1] == "object" and key in (*DISTRIBUTIONS, *WEATHER_RANGES):
        return 'give a distribution, as in { distribution = "beta", alpha = 2.0, beta = 2.0, low = 0.0, high = 1.0 }'
    wanted, found = (KINDS.get(kind, kind) for kind in expected.groups())
    return f"give {wanted}{_unit_hint(key)}, not {found}"


def _suggest(name: str, path: str) -> str:
    known = _known_keys(path)
    stem = re.sub(rf"_({UNIT_ENDINGS})$", "", name)
    for key in known:
        ending = next((u for u in UNITS if key == f"{stem}_{u}"), None)
        if ending is not None:
            return f"wrong unit or none; give {UNITS[ending]} as `{key}`"
    close = difflib.get_close_matches(name, known, 1)
    if close:
        return f"unknown key; did you mean `{close[0]}`?"
    return "unknown key; remove it, or see `tailroad scenario show i80` for the keys there are"


def _unit_hint(key: str) -> str:
    for ending, unit in UNITS.items():
        if key.endswith(f"_{ending}"):
            return f", in {unit}"
    return ""


def _tables(annotation: Any) -> list[type[msgspec.Struct]]:
    """The tables among the types that an annotation allows: a table, a list of them, or one of several."""
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return [annotation]
    return [table for part in get_args(annotation) for table in _tables(part)]


def _fields(tables: Iterable[type[msgspec.Struct]]) -> Iterator[msgspec.structs.FieldInfo]:
    for table in tables:
        yield from msgspec.structs.fields(table)


def _tables_at(path: str) -> list[type[msgspec.Struct]]:
    """What tables a scenario may have at `path`, as in "vehicles[2].station_m"."""
    tables: list[type[msgspec.Struct]] = [Scenario]
    for part in re.findall(r"[^.\[\]]+", path):
        if not part.isdigit() and part != "...":  # msgspec writes [...] for any element
            tables = [t for f in _fields(tables) if f.encode_name == part for t in _tables(f.type)]
    return tables


def _known_keys(path: str) -> list[str]:
    """The keys of the table at `path`."""
    tables = _tables_at(path)
    tags = {str(table.__struct_config__.tag_field) for table in tables if table.__struct_config__.tag_field}
    names = {field.encode_name for field in _fields(tables)}
    return sorted({written_key(f"{path}.{name}").rpartition(".")[2] for name in names} | tags)


def _choices() -> dict[str, tuple[str, ...]]:
    """The values of keys that have a few."""
    tables: list[type[msgspec.Struct]] = [Scenario]
    for table in tables:  # grows while it is read
        tables += [t for f in msgspec.structs.fields(table) for t in _tables(f.type) if t not in tables]
    literals = {f.encode_name: get_args(f.type) for f in _fields(tables) if get_origin(f.type) is Literal}
    kinds = tuple(str(kind.__struct_config__.tag) for kind in get_args(Distribution))
    return {"distribution": kinds} | literals


def _value_at(data: Any, path: str) -> Any:
    for part in re.findall(r"[^.\[\]]+", path):
        try:
            data = data[int(part)] if isinstance(data, list) else data[part]
        except (KeyError, IndexError, ValueError, TypeError):
            return None
    return None if isinstance(data, (dict, list)) else data
