"""The options of a method: which there are, and what is told of one that it has not."""

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, get_type_hints

import msgspec

import ce
from ce.paths import PathOptions
from service.errors import InputError

# that every method has, and every front door a place of its own for
COMMON = (
    "budget",
    "rel_error",
    "confidence",
)
# of ce, that `tailroad estimate` has a flag of its own for
FLAGS_OF_CE = (
    "iterations",
    "samples_per_iteration",
    "rho",
    "step",
    "mean_box",
    "max_kl",
)


PATHS = "paths"  # the method that drives paths with a committor (`ce.paths`), beside those of ce.METHODS
METHODS = (*ce.METHODS, PATHS)
OPTIONS: dict[str, Any] = {**ce.OPTIONS, PATHS: PathOptions}


def option_names(method: str) -> tuple[str, ...]:
    """The options of the method beside COMMON; InputError where there is no such method."""
    return tuple(f.name for f in fields(_kind(method)) if f.name not in COMMON)


def not_an_option(method: str, name: str) -> str:
    """What is told of an option that the method has not."""
    known = option_names(method)
    others = [other for other in METHODS if name in option_names(other)]
    if others:
        return f"method {method} has no option {name!r}; it is one of {', '.join(others)}"
    close = difflib.get_close_matches(name, known, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(known)}"
    return f"method {method} has no option {name!r}; {hint}"


def options_of(method: str, options: Mapping[str, Any]) -> Any:
    """The options as ce takes them. InputError names one that the method has not or that is of another type;
    ce.OptionsError one that is out of its range."""
    kind = _kind(method)
    types = get_type_hints(kind)
    try:
        present = ce.present_options(method, options)
    except TypeError as error:
        raise InputError(f"options of method {method}: {error}") from error
    if method == PATHS:
        if present.get("rel_error") is not None:
            raise InputError(
                "method paths spends its budget and stops at no precision; leave out rel_error, or give it another "
                "method"
            )
        present = {name: value for name, value in present.items() if name != "rel_error"}
    for name, value in present.items():
        if name not in types:
            raise InputError(not_an_option(method, name))
        try:
            msgspec.convert(value, types[name])
        except msgspec.ValidationError as error:
            raise InputError(f"option {name!r} of method {method}: {error}") from error
    return kind(**present)


def shared_out(methods: Iterable[str], options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The options by method: each goes to every method that has it; InputError where none of them has."""
    wanted = tuple(methods)
    for name in options:
        if not any(_has(method, name) for method in wanted):
            raise InputError(
                f"{name} has a place of its own beside the options"
                if name in COMMON
                else "; ".join(not_an_option(method, name) for method in wanted)
            )
    return {
        method: {name: value for name, value in options.items() if _has(method, name)} for method in wanted
    }


def _has(method: str, name: str) -> bool:
    """Whether the method has an option of that name, a former one included."""
    (present,) = ce.present_options(method, {name: None})
    return present in option_names(method)


def _kind(method: str) -> Any:
    if method not in OPTIONS:
        raise InputError(f"no method named {method!r}; there are {', '.join(METHODS)}")
    return OPTIONS[method]
