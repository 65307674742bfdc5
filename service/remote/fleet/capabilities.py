"""What this installation can do, as its workers announce it."""

import os
import shutil
import socket
from importlib.metadata import version
from importlib.util import find_spec

from service.remote.fleet.messages import Capabilities
from service.remote.fleet.versions import versions
from service.world.egos.open import usable_egos


def capabilities(procs: int) -> Capabilities:
    """Of a worker with so many processes on this machine."""
    return Capabilities(
        procs=procs,
        egos=tuple(usable_egos()),
        camera=find_spec("cv2") is not None,
        gpu=shutil.which("nvidia-smi") is not None,
        versions=versions() | {"tailroad": version("tailroad")},
        host=socket.gethostname(),
        pid=os.getpid(),
    )
