"""The language of formulas: text in, a program for `service.world.safety.robustness` out.

What binds tighter stands higher; within a line operators are read from the left:

    abs(...) sqrt(...) always(...) eventually(...) historically(...) once(...) not(...)    what a bracket holds
    -a
    *
    + -
    >= <= > <              not in a chain: join two comparisons by `and`
    not always eventually historically once    without a bracket: always ttc_s >= 1 is always(ttc_s >= 1)
    until since            not in a chain
    and
    or
    implies ->             read from the right

Where a stranger could read a formula in two ways it is refused, with both written out: `not (a) > b`, `a - always b`.
The program is flat, in the order in which a stack machine works it out, so no text makes anything recurse.
"""

import difflib
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from service.errors import InputError

LONGEST = 2000  # characters
DEEPEST = 40  # brackets in each other
TEMPORAL = {"always", "eventually", "until", "historically", "once", "since"}
CALLED = {"abs", "sqrt"}  # take a bracket
PREFIX = {"not", "always", "eventually", "historically", "once"} | CALLED
COMPARISONS = {">=", "<=", ">", "<"}
BINDING = {
    "implies": 1,
    "or": 2,
    "and": 3,
    "until": 4,
    "since": 4,
    **dict.fromkeys(PREFIX, 5),
    **dict.fromkeys(COMPARISONS, 6),
    "+": 7,
    "-": 7,
    "*": 8,
    "negative": 9,
}
ARITHMETIC = {"+", "-", "*"}
BINARY = {"and", "or", "implies", "until", "since", "->"} | COMPARISONS | ARITHMETIC
WORDS = {word for word in PREFIX | BINARY if word.isalpha()}
TOKEN = re.compile(
    r"\s*(?:(?P<word>[A-Za-z_]\w*)|(?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<sign>->|>=|<=|[-+*()><]))"
)
TIME = r"(\d+(?:\.\d*)?)\s*(s|ms)?"
INTERVAL = re.compile(rf"\s*\[\s*{TIME}\s*[:,]\s*{TIME}\s*\]")


class Instruction(NamedTuple):
    """One step of a program.

    operator: "signal", "number", "negative", or one of the language's words and signs
    name: of a signal, else ""
    number: of a number, else 0
    window: of a temporal operator with an interval, its first and last step; else None
    """

    operator: str
    name: str = ""
    number: float = 0.0
    window: tuple[int, int] | None = None


class Program(NamedTuple):
    """A formula as a stack machine works it out, and the signals in it in the order of their first mention."""

    instructions: tuple[Instruction, ...]
    signals: tuple[str, ...]


class _Waiting(NamedTuple):
    """An operator that waits for its operands, or a bracket ("(") that is not closed yet.

    called: a prefix with a bracket of its own right behind it, which is all that it takes
    """

    instruction: Instruction
    called: bool = False

    @property
    def binding(self) -> int:
        return BINDING.get(self.instruction.operator, 0)  # a bracket's contents never leave it


def read_formula(formula: str, signals: Sequence[str], step_ms: int, horizon_ms: int) -> Program:
    """The program of a formula; InputError names what is wrong, and at which character.

    signals: the names that there are
    step_ms, horizon_ms: of the rollout; intervals go in whole steps and up to the horizon
    """
    if len(formula) > LONGEST:
        raise InputError(f"a formula of {len(formula)} characters; at most {LONGEST} are taken")
    return _Reader(formula, signals, step_ms, horizon_ms).read()


class _Reader:
    """Dijkstra's shunting yard over the tokens of one formula."""

    def __init__(self, formula: str, signals: Sequence[str], step_ms: int, horizon_ms: int):
        self._formula, self._signals = formula, signals
        self._step_ms, self._horizon_ms = step_ms, horizon_ms
        self._made: list[Instruction] = []
        self._names: list[str] = []
        self._waiting: list[_Waiting] = []
        self._depth = 0

    def read(self) -> Program:
        formula, end = self._formula, len(self._formula.rstrip())
        operand_due, not_closed = True, False
        at = 0
        while at < end:
            if INTERVAL.match(formula, at):
                raise self._refuse(f"an interval follows one of {', '.join(sorted(TEMPORAL))}", at)
            token = TOKEN.match(formula, at)
            if token is None:
                given = formula[at:].strip()[:1]
                raise self._refuse(
                    f"{given!r} is not part of the language; see docs/concepts/question.md", at
                )
            text = token[0].strip()
            after = token.end()
            is_signal = bool(token["word"]) and text not in WORDS
            if is_signal and text not in self._signals:
                raise self._unknown(text, at)
            if operand_due and (text in BINARY - {"-"} or text == ")"):
                raise self._refuse(f"a signal, a number or a bracket is due, not {text!r}", at)
            if not operand_due and not (text in BINARY or text == ")"):
                raise self._refuse(f"an operator is due, not {text!r}", at)
            if not_closed and text in ARITHMETIC | COMPARISONS:
                raise self._refuse(
                    f"it could mean (not (...)) {text} ... or not ((...) {text} ...): write the one you mean",
                    at,
                )
            window = None
            if text in TEMPORAL and (interval := INTERVAL.match(formula, after)):
                window = self._window(interval, after)
                after = interval.end()
            not_closed = False
            if is_signal:
                if text not in self._names:
                    self._names.append(text)
                self._made.append(Instruction("signal", name=text))
            elif token["number"]:
                self._number(text, at)
            elif text == "(":
                self._open(at)
            elif text == ")":
                not_closed = self._close(at)
            elif operand_due:
                called = text != "-" and formula[after:].lstrip().startswith("(")
                self._prefix(text, window, called, at)
            else:
                self._binary("implies" if text == "->" else text, window, at)
            operand_due = text in BINARY or text in PREFIX or text == "("
            at = after
        if operand_due:
            raise self._refuse("it ends where a signal, a number or a bracket is due", end)
        if self._depth:
            are = "s are" if self._depth > 1 else " is"
            raise self._refuse(f"{self._depth} bracket{are} not closed", end)
        if not self._names:
            raise self._refuse(f"it has no signal; there are {', '.join(self._signals)}", 0)
        while self._waiting:
            self._made.append(self._waiting.pop().instruction)
        return Program(tuple(self._made), tuple(self._names))

    def _number(self, text: str, at: int) -> None:
        if not math.isfinite(number := float(text)):
            raise self._refuse(f"the number {text} is too large", at)
        self._made.append(Instruction("number", number=number))

    def _open(self, at: int) -> None:
        self._depth += 1
        if self._depth > DEEPEST:
            raise self._refuse(f"more than {DEEPEST} brackets in each other", at)
        self._waiting.append(_Waiting(Instruction("(")))

    def _close(self, at: int) -> bool:
        """Take what the bracket holds, and the prefix that it belongs to; whether that was `not`."""
        self._depth -= 1
        if self._depth < 0:
            raise self._refuse("')' closes no bracket", at)
        while self._waiting[-1].instruction.operator != "(":
            self._made.append(self._waiting.pop().instruction)
        self._waiting.pop()
        if not (self._waiting and self._waiting[-1].called):
            return False
        self._made.append(self._waiting.pop().instruction)
        return self._made[-1].operator == "not"

    def _prefix(self, text: str, window: tuple[int, int] | None, called: bool, at: int) -> None:
        if text in CALLED and not called:
            raise self._refuse(f"{text} takes a bracket, as in {text}(lane_offset_m)", at)
        operator = "negative" if text == "-" else text
        inside = self._waiting[-1].instruction.operator if self._waiting else "("
        if not called and operator != "negative" and BINDING.get(inside, 0) >= BINDING[">="]:
            raise self._refuse(f"put a bracket around what {text!r} is said of", at)
        self._waiting.append(_Waiting(Instruction(operator, window=window), called))

    def _binary(self, operator: str, window: tuple[int, int] | None, at: int) -> None:
        binding = BINDING[operator]
        while self._waiting and self._waiting[-1].binding >= binding:
            if self._waiting[-1].binding == binding:
                if operator == "implies":  # read from the right
                    break
                if operator in COMPARISONS:
                    raise self._refuse("compare two things at a time and join comparisons by 'and'", at)
                if operator in ("until", "since"):
                    raise self._refuse("put a bracket around one of the two, 'until' or 'since'", at)
            self._made.append(self._waiting.pop().instruction)
        self._waiting.append(_Waiting(Instruction(operator, window=window)))

    def _window(self, found: re.Match[str], at: int) -> tuple[int, int]:
        """An interval in steps; a number without a unit is in seconds, or in the unit of the interval's end."""
        first, first_unit, last, last_unit = found.groups()
        low, high = _ms(first, first_unit or last_unit), _ms(last, last_unit)
        if not (low <= high <= self._horizon_ms and low % self._step_ms == 0 and high % self._step_ms == 0):
            raise self._refuse(
                f"the interval {found[0].strip()} must go forward in whole steps of {self._step_ms} ms, up to the "
                f"horizon of {self._horizon_ms} ms",
                at,
            )
        return round(low) // self._step_ms, round(high) // self._step_ms

    def _unknown(self, text: str, at: int) -> InputError:
        close = difflib.get_close_matches(text, [*self._signals, *WORDS], 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        return self._refuse(f"no signal {text!r}; {hint}there are {', '.join(self._signals)}", at)

    def _refuse(self, what: str, at: int) -> InputError:
        return InputError(f"formula {self._formula[:200]!r}: {what} (character {at + 1})")


def _ms(number: str, unit: str | None) -> float:
    return round(float(number) * (1.0 if unit == "ms" else 1000.0), 6)
