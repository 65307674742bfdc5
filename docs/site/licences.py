"""The licences of what tailroad needs at run time, from the installed packages: deploy/third-party-licences.md.

python -m docs.site.licences    writes the page anew
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from email.message import Message
from importlib.metadata import Distribution, distribution
from typing import cast

from packaging.requirements import Requirement

from docs.site.gather import ROOT

PAGE = ROOT / "deploy" / "third-party-licences.md"
# extras that the container image installs
IN_THE_IMAGE = ("postgres",)

# What a package's metadata leaves open, read from its licence file.
READ = {
    "eclipse-zenoh": "EPL-2.0 OR Apache-2.0",
    "jinja2": "BSD-3-Clause",
    "lz4": "BSD-3-Clause",
    "matplotlib": "Matplotlib's own, of the kind of PSF-2.0",
    "psycopg": "LGPL-3.0-only",
    "psycopg-binary": "LGPL-3.0-only",
}
_NAMES = {
    "BSD": "BSD-3-Clause",
    "BSD License": "BSD-3-Clause",
    "3-Clause BSD License": "BSD-3-Clause",
    "BSD 3-Clause License": "BSD-3-Clause",
    "MIT License": "MIT",
    "The MIT License (MIT)": "MIT",
    "Apache 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
}

HEAD = """# Licences of what tailroad needs

tailroad itself is under [Apache-2.0](../LICENSE); roads and recordings have [notices of their own](../NOTICE). It is
installed together with the packages below, each under its own licence. Made from the installed packages' metadata by
`python -m docs.site.licences`, for Linux with Python 3.11 and the extras of the container image ({extras}).

**SUMO** (libsumo, traci, sumolib, sumo-data) is under EPL-2.0, or GPL-2.0-or-later, as you choose. tailroad does not
change it and loads it as a library. Whoever hands on the container image, or anything else that holds these packages,
hands on SUMO: say that it is there under EPL-2.0, hand on the licence's text, and say where its source is to be had
(<https://eclipse.dev/sumo/>; the version stands below). Zenoh may be taken under Apache-2.0. psycopg, which the image
holds to reach PostgreSQL, is under LGPL-3.0.

The wheels of numpy, scipy, polars, OpenCV and others hold further libraries in binary form; their licences lie in each
package's `*.dist-info` folder.

| package | version | licence |
| --- | --- | --- |
"""


@dataclass(frozen=True)
class Package:
    """A package that is there at run time.

    needs: names of others that it asks for
    """

    name: str
    version: str
    licence: str
    needs: frozenset[str]


def own_requirements(extras: Sequence[str] = IN_THE_IMAGE) -> list[str]:
    """What tailroad itself needs with these extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [*project["dependencies"], *(r for e in extras for r in project["optional-dependencies"][e])]


def packages(extras: Sequence[str] = IN_THE_IMAGE) -> list[Package]:
    """What an installation with these extras brings along, by name."""
    waiting = own_requirements(extras)
    found: dict[str, Package] = {}
    while waiting:
        need = Requirement(waiting.pop())
        name = _canonical(need.name)
        if need.marker and not any(need.marker.evaluate({"extra": e}) for e in ("", *need.extras)):
            continue
        there = distribution(need.name)
        further = [_without_extra(r) for r in there.requires or () if any(_is_for(r, e) for e in need.extras)]
        if name not in found:
            found[name] = Package(name, there.version, licence_of(there), frozenset())
            further += [r for r in there.requires or () if "extra ==" not in r]
        one = found[name]
        found[name] = replace(one, needs=one.needs | names_of(further))
        waiting += further
    return sorted(found.values(), key=lambda p: p.name)


def names_of(requirements: Iterable[str]) -> frozenset[str]:
    """The names of packages that requirements are of, as the package index writes them."""
    return frozenset(_canonical(Requirement(r).name) for r in requirements)


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _is_for(requirement: str, extra: str) -> bool:
    marker = Requirement(requirement).marker
    return marker is not None and not marker.evaluate({"extra": ""}) and marker.evaluate({"extra": extra})


def _without_extra(requirement: str) -> str:
    need = Requirement(requirement)
    need.marker = None
    return str(need)


def licence_of(package: Distribution) -> str:
    """A package's licence in few words. Raises LookupError where its metadata say nothing of use."""
    about = cast(Message, package.metadata)
    name = _canonical(about["Name"])
    if name in READ:
        return READ[name]
    if about.get("License-Expression"):
        return str(about["License-Expression"])
    stated = (about.get("License") or "").strip().split("\n")[0].strip()
    classified = [
        c.rsplit(" :: ", 1)[1] for c in about.get_all("Classifier") or () if c.startswith("License ::")
    ]
    for words in (stated, *classified):
        if words in _NAMES or re.fullmatch(r"[A-Z][\w.+-]*", words):
            return _NAMES.get(words, words)
    raise LookupError(
        f"{name}: no licence can be read from its metadata; read its licence file and add it to READ"
    )


def page() -> str:
    """The page, as it is kept in the repository."""
    rows = "\n".join(f"| {p.name} | {p.version} | {p.licence} |" for p in packages())
    return HEAD.format(extras=", ".join(f"`{e}`" for e in IN_THE_IMAGE)) + rows + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
