"""Which egos outside tailroad this process may use, and where it finds them: its own configuration.

A job names an ego; what that name may lead to is decided here, by whoever started the process, never by what comes over
the network. The settings are environment variables, so that worker processes have those of the process that started
them:

    TAILROAD_EGO_ADDRESS      where ego services are: one of them, or a Zenoh router; default tcp/127.0.0.1:7447
    TAILROAD_RENDERER         where a renderer is (service/world/egos/renderer.py), if pictures are not to be made here
    TAILROAD_EGO_CONFIG       a Zenoh configuration file instead (TLS, access control)
    TAILROAD_EGO_DEADLINE_S   an answer that takes longer makes the rollout an error; default 1
    TAILROAD_EGO_PATIENCE_S   how long to wait for a service that is not there (yet, or any more); default 10
    TAILROAD_PYTHON_EGOS      Python classes that may be imported as egos: MODULE:CLASS, separated by commas
    TAILROAD_ONNX_EGOS        networks that may be read as egos: files, separated by the sign that separates PATH's
"""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass

from service.errors import InputError

DEFAULT_ADDRESS = "tcp/127.0.0.1:7447"
LONGEST_WAIT_S = 3600.0
PYTHON_EGO = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


@dataclass(frozen=True)
class EgoSettings:
    """See the module's text."""

    address: str = DEFAULT_ADDRESS
    config: str | None = None
    deadline_s: float = 1.0
    patience_s: float = 10.0
    python: frozenset[str] = frozenset()
    renderer: str | None = None
    onnx: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name, value in (("deadline", self.deadline_s), ("patience", self.patience_s)):
            if not (math.isfinite(value) and 0.001 <= value <= LONGEST_WAIT_S):
                raise InputError(
                    f"an ego's {name} of {value:g} s cannot be; give 0.001 to {LONGEST_WAIT_S:g} seconds"
                )
        for address in (self.address, self.renderer):
            if address and not re.fullmatch(r"(tcp|tls|quic|ws|unixsock-stream)/\S{1,200}", address):
                raise InputError(
                    f"{address!r} is not an address of a service; give one as in {DEFAULT_ADDRESS}"
                )
        for spec in self.python:
            if not PYTHON_EGO.fullmatch(spec):
                raise InputError(
                    f"{spec!r} is not a Python class; give MODULE:CLASS, as in mine.egos:Careful"
                )

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> "EgoSettings":
        """The settings of this process; InputError names a variable that cannot be used."""
        default = cls()
        return cls(
            address=environment.get("TAILROAD_EGO_ADDRESS") or default.address,
            config=environment.get("TAILROAD_EGO_CONFIG") or None,
            deadline_s=_seconds(environment, "TAILROAD_EGO_DEADLINE_S", default.deadline_s),
            patience_s=_seconds(environment, "TAILROAD_EGO_PATIENCE_S", default.patience_s),
            renderer=environment.get("TAILROAD_RENDERER") or None,
            python=frozenset(s for s in environment.get("TAILROAD_PYTHON_EGOS", "").split(",") if s),
            onnx=frozenset(s for s in environment.get("TAILROAD_ONNX_EGOS", "").split(os.pathsep) if s),
        )

    def as_environment(self) -> dict[str, str]:
        """The variables that give these settings to worker processes."""
        return {
            "TAILROAD_EGO_ADDRESS": self.address,
            "TAILROAD_EGO_CONFIG": self.config or "",
            "TAILROAD_RENDERER": self.renderer or "",
            "TAILROAD_EGO_DEADLINE_S": repr(self.deadline_s),
            "TAILROAD_EGO_PATIENCE_S": repr(self.patience_s),
            "TAILROAD_PYTHON_EGOS": ",".join(sorted(self.python)),
            "TAILROAD_ONNX_EGOS": os.pathsep.join(sorted(self.onnx)),
        }


def _seconds(environment: Mapping[str, str], name: str, default: float) -> float:
    text = environment.get(name)
    if not text:
        return default
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{name} is {text!r}; give a number of seconds") from error
