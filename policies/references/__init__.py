"""Reference drivers: what a competent human would have done in a conflict, by published models with their constants.

r157-cc         competent and careful human driver of UN Regulation 157
r157-cc-aeb     the same with automatic emergency braking
r157-5.2.5.2    the bound of the regulation's paragraph on cut-ins, as a driver
fsm             fuzzy safety model of the Joint Research Centre
rss             responsibility-sensitive safety
"""

from collections.abc import Callable

from policies.references.careful import CarefulDriver
from policies.references.fsm import FuzzyDriver
from policies.references.paragraph import ParagraphDriver
from policies.references.protocol import Other, Own, ReferenceDriver
from policies.references.rss import SensitiveDriver

_MADE: dict[str, Callable[[], ReferenceDriver]] = {
    "r157-cc": CarefulDriver,
    "r157-cc-aeb": lambda: CarefulDriver(brake_assist=True),
    "r157-5.2.5.2": ParagraphDriver,
    "fsm": FuzzyDriver,
    "rss": SensitiveDriver,
}
REFERENCES = tuple(_MADE)


def reference_driver(name: str) -> ReferenceDriver:
    """A new reference driver of that name; ValueError for a name that is not known."""
    if name not in _MADE:
        raise ValueError(f"no reference driver named {name!r}; there are {', '.join(REFERENCES)}")
    return _MADE[name]()


__all__ = ["REFERENCES", "Other", "Own", "ReferenceDriver", "reference_driver"]
