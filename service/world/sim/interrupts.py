"""Whose KeyboardInterrupt it is: the user's Ctrl-C, which ends a run, or one that an ego's code raises by itself."""

import signal
import threading
from types import FrameType

_signals = 0


def signals_seen() -> int:
    """How many times Ctrl-C has come so far in this process."""
    return _signals


def listen() -> None:
    """Count the signals of Ctrl-C from now on, where Python's own handler would take them; it still does."""
    if threading.current_thread() is not threading.main_thread():
        return  # handlers are the main thread's to set
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _count)


def is_users(seen_before: int) -> bool:
    """Whether a KeyboardInterrupt that was caught may be the user's.

    seen_before: `signals_seen` before the code that raised it
    """
    if threading.current_thread() is not threading.main_thread():
        return False  # signals interrupt the main thread only
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.SIG_IGN:
        return False
    return handler is not _count or _signals != seen_before


def _count(number: int, frame: FrameType | None) -> None:
    global _signals
    _signals += 1
    signal.default_int_handler(number, frame)
