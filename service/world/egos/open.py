"""An ego by the name that a job gives it."""

import importlib
import re
from collections.abc import Callable
from pathlib import Path

from policies.egos import EgoPolicy, ego_names, load_ego
from policies.egos.onnx_file import PREFIX as ONNX
from policies.egos.onnx_file import OnnxEgo
from service.errors import EgoError, InputError
from service.world.egos.here import HERE, REMOTE, check_held, make_held
from service.world.egos.settings import PYTHON_EGO, EgoSettings
from service.world.egos.sumo import NAMES as SUMO_EGOS
from service.world.egos.sumo import PREFIX as SUMO
from service.world.egos.sumo import SumoEgo
from service.world.scenario.schema import Scenario
from service.world.sim.road import road_of
from service.world.sim.rollout import FrameSource
from sumo_nets.corridor import Corridor

SERVICE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def usable_egos(settings: EgoSettings | None = None) -> list[str]:
    """Names of the egos that this process can run by itself: those that come with tailroad, SUMO's car-following models
    and the user's classes."""
    own = sorted((settings or EgoSettings.from_environment()).python)
    return [*ego_names(), *SUMO_EGOS, *own]


def check_ego(name: str, settings: EgoSettings | None = None) -> None:
    """InputError where this process cannot use an ego of that name, before anything is connected or imported."""
    settings = settings or EgoSettings.from_environment()
    if name.startswith(REMOTE):
        if not SERVICE_NAME.fullmatch(name.removeprefix(REMOTE)):
            raise InputError(
                f"ego {name!r}: the name of an ego service has 1 to 64 letters, digits, '.', '_' and '-'"
            )
    elif name.startswith(HERE):
        check_held(name)
    elif name.startswith(SUMO):
        if name not in SUMO_EGOS:
            raise InputError(f"ego {name!r}: of SUMO's car-following models there are {', '.join(SUMO_EGOS)}")
    elif name.startswith(ONNX):
        if name.removeprefix(ONNX) not in settings.onnx:
            raise InputError(
                f"ego {name!r} is not a file that this process may read; whoever started it must name it, with --ego "
                "or in TAILROAD_ONNX_EGOS"
            )
    elif ":" in name:
        if not PYTHON_EGO.fullmatch(name):
            raise InputError(f"ego {name!r} is neither MODULE:CLASS nor zenoh:NAME nor onnx:FILE")
        if name not in settings.python:
            raise InputError(
                f"ego {name!r} is not one that this process may import; whoever started it must name it, with --ego or "
                "in TAILROAD_PYTHON_EGOS"
            )
    elif name not in ego_names():
        try:
            load_ego(name)
        except ValueError as error:
            raise InputError(
                f"{error}; a service on the network is zenoh:NAME, a class of your own MODULE:CLASS"
            ) from error


def open_ego(
    name: str, scenario: Scenario, corridor: Corridor, settings: EgoSettings | None = None
) -> EgoPolicy:
    """A new ego of that name for this scenario: one that comes with tailroad or SUMO, the user's class or a service.

    InputError for a name that `check_ego` refuses or a class that cannot be made, EgoError where a service cannot be
    reached.
    """
    settings = settings or EgoSettings.from_environment()
    check_ego(name, settings)
    if name.startswith(REMOTE):
        from service.world.egos.remote import RemoteEgo  # Zenoh takes a moment to import

        service = name.removeprefix(REMOTE)
        return RemoteEgo(service, settings, road_of(corridor), scenario.name, scenario.time.step_s)
    if name.startswith(SUMO):
        return SumoEgo(name.removeprefix(SUMO), scenario.time.step_s)
    if name.startswith(ONNX):
        return OnnxEgo(Path(name.removeprefix(ONNX)))
    return _python_ego(name) if ":" in name else load_ego(name)


def camera_elsewhere(
    scenario: Scenario, settings: EgoSettings | None = None
) -> Callable[[], FrameSource] | None:
    """What opens the camera whose pictures a renderer makes elsewhere; None where they are made in this process."""
    settings = settings or EgoSettings.from_environment()
    if settings.renderer is None:
        return None

    def connect() -> FrameSource:
        from service.world.egos.remote_camera import RemoteCamera

        return RemoteCamera(scenario, settings)

    return connect


def meet_ego(name: str, scenario: Scenario, corridor: Corridor) -> None:
    """Open the ego once and close it again: what is wrong with it is told before a job begins, not in each rollout."""
    ego = open_ego(name, scenario, corridor)
    try:
        if (greet := getattr(ego, "greet", None)) is not None:
            greet()
    finally:
        if (close := getattr(ego, "close", None)) is not None:
            close()


def _imported(name: str) -> EgoPolicy:
    module, _, cls = name.partition(":")
    return getattr(importlib.import_module(module), cls)()


def _python_ego(name: str) -> EgoPolicy:
    try:
        ego = make_held(name) if name.startswith(HERE) else _imported(name)
    except Exception as error:  # whatever the user's module raises: name it, and what raised
        raise InputError(f"ego {name!r} cannot be made: {type(error).__name__}: {error}") from error
    for method in ("reset", "act"):
        if not callable(getattr(ego, method, None)):
            raise InputError(f"ego {name!r} has no method {method!r}; see policies/egos/protocol.py")
    if not hasattr(ego, "name"):
        try:
            ego.name = name
        except AttributeError as error:
            raise EgoError(f"ego {name!r} has no name and takes none; give the class a name") from error
    return ego
