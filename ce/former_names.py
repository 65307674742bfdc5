"""Options under the names that they had in earlier versions, which stay valid."""

import functools
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

T = TypeVar("T")


def accepts_former(names: Mapping[str, str]) -> Callable[[type[T]], type[T]]:
    """A decorator for a class of options: its constructor takes the former names (keys) for the present ones, too."""

    def decorate(kind: type[T]) -> type[T]:
        construct: Callable[..., None] = kind.__init__

        @functools.wraps(construct)
        def init(self: T, *positional: Any, **given: Any) -> None:
            construct(self, *positional, **with_present_names(names, given))

        kind.__init__ = init  # type: ignore[method-assign, assignment]
        return kind

    return decorate


def with_present_names(names: Mapping[str, str], given: Mapping[str, Any]) -> dict[str, Any]:
    """The options given by name, each former name replaced by the present one with a DeprecationWarning.

    Raises TypeError where an option is given under both.

    names: the present name of each former one
    given: the options by name
    """
    present = dict(given)
    for former, name in names.items():
        if former in present:
            if name in present:
                raise TypeError(f"{former} is the former name of {name}; give {name} only")
            warnings.warn(f"option {former} is called {name} now", DeprecationWarning, stacklevel=4)
            present[name] = present.pop(former)
    return present
