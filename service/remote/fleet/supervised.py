"""A child process that is started again when it ends, and is told to end with its parent."""

import logging
import os
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence

log = logging.getLogger("tailroad.serve")

FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0


class SupervisedProcess:
    """The `tailroad` command with these arguments and `--parent` with this process's id; `name`: in messages.

    drain_s: for what it is doing when it is told to stop
    environment: beside this process's
    final: exit codes after which it is not started again
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        drain_s: float,
        environment: Mapping[str, str] | None = None,
        final: Sequence[int] = (),
    ):
        self._name, self._drain_s, self._final = name, drain_s, tuple(final)
        self._command = [sys.executable, "-m", "service.front.cli", *arguments, "--parent", str(os.getpid())]
        self._environment = {**(environment or {}), **os.environ}
        self._stopping = threading.Event()
        self._lock = threading.Lock()
        self._process: subprocess.Popen | None = None
        self._thread = threading.Thread(
            target=self._supervise, name=f"supervised-{arguments[0]}", daemon=True
        )
        self._thread.start()

    def _supervise(self) -> None:
        pause_s = FIRST_PAUSE_S
        while True:
            with self._lock:
                if self._stopping.is_set():
                    return
                self._process = subprocess.Popen(self._command, start_new_session=True, env=self._environment)
            code = self._process.wait()
            if self._stopping.is_set():
                return
            if code in self._final:
                log.error("%s cannot run (above is why); this goes on without it", self._name)
                return
            log.warning("%s ended (exit code %d); starting it again in %g s", self._name, code, pause_s)
            self._stopping.wait(pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)

    def begin_to_stop(self) -> None:
        """Tell it to finish what it does, and to end."""
        with self._lock:
            if not self._stopping.is_set() and self._process is not None:
                self._process.terminate()
            self._stopping.set()

    def stop(self) -> None:
        """Have it end, and wait until it has."""
        self.begin_to_stop()
        if self._process is not None:
            try:
                self._process.wait(self._drain_s)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._thread.join()
