"""A batch file, and the cells of the matrix that it spans.

format = 1
name = "nightly"
scenarios = ["i80-10s", "mine.toml"]     # names, or files relative to this one
egos = ["lidar", "idm"]
gammas = [0.5, 0.2]                       # seconds
methods = ["auto"]                        # and more to compare
budget = 20000
fail_above = 1e-3                         # optional: see `tailroad batch --help`
[options.ce]
rho = 0.1
"""

import hashlib
import re
import tomllib
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from service.errors import InputError

FORMAT = 1
MAX_CELLS = 10_000
MAX_BYTES = 1_000_000
NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"
Text = Annotated[str, Meta(min_length=1, max_length=1000)]
Above0 = Annotated[float, Meta(gt=0.0)]


class Batch(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """See the module's text."""

    format: int
    name: Annotated[str, Meta(pattern=NAME)]
    scenarios: Annotated[tuple[Text, ...], Meta(min_length=1)]
    egos: Annotated[tuple[Text, ...], Meta(min_length=1)]
    gammas: Annotated[tuple[float, ...], Meta(min_length=1)]
    methods: Annotated[tuple[Text, ...], Meta(min_length=1)] = ("auto",)
    budget: Annotated[int, Meta(ge=1, le=2**62)] = 20_000
    rel_error: Above0 | None = None
    confidence: Annotated[float, Meta(gt=0.0, lt=1.0)] = 0.95
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1
    fail_above: Annotated[float, Meta(gt=0.0, lt=1.0)] | None = None
    options: dict[str, dict[str, Any]] = {}  # by method


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """One question of a batch.

    scenario: as the file names it
    content: of its file, where it is one
    """

    scenario: str
    ego: str
    gamma: float
    method: str
    options: dict[str, Any]  # budget, rel_error and confidence among them
    seed: int
    content: dict[str, Any] | None = None

    @property
    def digest(self) -> str:
        """Of all that decides the cell's result."""
        return hashlib.sha256(msgspec.json.encode(self, order="deterministic")).hexdigest()[:16]

    @property
    def title(self) -> str:
        return f"{Path(self.scenario).stem}, {self.ego}, f <= {self.gamma:g}, {self.method}"

    @property
    def folder(self) -> str:
        """A name for a folder of its own."""
        parts = (Path(self.scenario).stem, self.ego, f"{self.gamma:g}", self.method)
        words = "_".join(re.sub(r"[^A-Za-z0-9.-]", "-", part)[:40] for part in parts)
        return f"{words}_{self.digest[:8]}"


def read_batch(path: Path) -> Batch:
    """The batch file; InputError names what is wrong with it."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES} bytes; this is not a batch file")
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        found = msgspec.convert(data, Batch)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {error}; see `tailroad batch --help`") from error
    except ValueError as error:  # not UTF-8, not TOML, or a number with thousands of digits
        raise InputError(f"{path}: not valid TOML: {error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: nested too deeply") from error
    if found.format != FORMAT:
        raise InputError(f"{path}: format {found.format}; this tailroad reads batch format {FORMAT}")
    if not all(abs(gamma) < float("inf") for gamma in found.gammas):
        raise InputError(f"{path}: gammas holds a number that is not finite")
    unused = sorted(set(found.options) - set(found.methods))
    if unused:
        raise InputError(f"{path}: options for {', '.join(unused)}, which methods does not name")
    count = len(found.scenarios) * len(found.egos) * len(found.gammas) * len(found.methods)
    if count > MAX_CELLS:
        raise InputError(f"{path}: {count} cells; give at most {MAX_CELLS}")
    return found


def cells(batch: Batch, folder: Path) -> Iterator[Cell]:
    """The cells, scenario by scenario; scenario files lie relative to `folder`. ScenarioError for a wrong file."""
    from service.world.scenario.load import read_toml

    common = {"budget": batch.budget, "rel_error": batch.rel_error, "confidence": batch.confidence}
    for scenario in batch.scenarios:
        is_file = scenario.endswith(".toml")
        content = read_toml(folder / scenario, scenario) if is_file else None
        name = str(folder / scenario) if is_file else scenario
        for ego, gamma, method in product(batch.egos, batch.gammas, batch.methods):
            options = common | batch.options.get(method, {})
            yield Cell(scenario=name, ego=ego, gamma=gamma, method=method, options=options, seed=batch.seed,
                       content=content)  # fmt: skip
