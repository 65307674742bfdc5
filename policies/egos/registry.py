"""The ego policies that tailroad brings, by name."""

import difflib
from collections.abc import Callable

from policies.drivers import load_drivers
from policies.egos.idm import IdmEgo
from policies.egos.lidar import LidarEgo
from policies.egos.protocol import EgoPolicy
from policies.egos.vision import VisionEgo

_MAKERS: dict[str, Callable[[], EgoPolicy]] = {
    "idm": IdmEgo,
    "lidar": lambda: LidarEgo(load_drivers("ego-lidar")),
    "vision": VisionEgo,
}


def ego_names() -> list[str]:
    """Names that `load_ego` knows."""
    return sorted(_MAKERS)


def load_ego(name: str) -> EgoPolicy:
    """A new ego policy of that name; ValueError for a name that is not known."""
    if name not in _MAKERS:
        close = difflib.get_close_matches(name, ego_names(), 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise ValueError(f"no ego named {name!r}; {hint}there are {', '.join(ego_names())}")
    return _MAKERS[name]()
