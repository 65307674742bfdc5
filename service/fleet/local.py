"""The local worker of `tailroad serve`: a process that is started again when it ends, and ends with its parent."""

import logging
import os
import subprocess
import sys
import threading

log = logging.getLogger("tailroad.serve")

FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0
DRAIN_S = 60.0  # for what is being run when the worker is told to stop


class LocalWorker:
    """`tailroad worker` for the scheduler at `endpoint`."""

    def __init__(self, endpoint: str, procs: int, zenoh_config: str | None = None):
        self._command = [sys.executable, "-m", "service.cli", "worker", "--connect", endpoint]
        self._command += ["--procs", str(procs), "--parent", str(os.getpid())]
        self._command += ["--zenoh-config", zenoh_config] if zenoh_config else []
        self._environment = {
            "OPENBLAS_NUM_THREADS": "1"
        } | os.environ  # its processes fill the cores themselves
        self._stopping = threading.Event()
        self._lock = threading.Lock()
        self._process: subprocess.Popen | None = None
        self._thread = threading.Thread(target=self._keep, name="local-worker", daemon=True)
        self._thread.start()

    def _keep(self) -> None:
        pause_s = FIRST_PAUSE_S
        while True:
            with self._lock:
                if self._stopping.is_set():
                    return
                self._process = subprocess.Popen(self._command, start_new_session=True, env=self._environment)
            code = self._process.wait()
            if self._stopping.is_set():
                return
            log.warning("the local worker ended (exit code %d); starting it again in %g s", code, pause_s)
            self._stopping.wait(pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)

    def stop(self) -> None:
        """Let it finish what it runs, and end."""
        with self._lock:
            self._stopping.set()
            if self._process is not None:
                self._process.terminate()
        if self._process is not None:
            try:
                self._process.wait(DRAIN_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._thread.join()
