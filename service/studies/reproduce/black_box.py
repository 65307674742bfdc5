"""A black box for the page on other worlds: an ego in a process of its own that answers over Zenoh.

    with black_box("black-box"):        # egos named zenoh:black-box are answered while this lasts

It drives like the `idm` ego, which tailroad is not told.
"""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from service.errors import EgoError
from service.world.egos.settings import EgoSettings

DEADLINE_S = 60.0  # what is measured is the policy, not how busy this machine is

END_S = 10.0  # that it has to end by itself

_CODE = """
import sys
from policies.egos import load_ego
from service.evaluation.parent import end_with_parent
from service.world.egos.sdk import serve
end_with_parent(int(sys.argv[3]))
serve(lambda: load_ego("idm"), sys.argv[1], listen=sys.argv[2])
"""


@contextmanager
def black_box(name: str) -> Iterator[None]:
    """Serve the ego on loopback, and tell worker processes begun meanwhile where it is. EgoError where it cannot."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    process = subprocess.Popen(
        [sys.executable, "-c", _CODE, name, address, str(os.getpid())], stdout=subprocess.PIPE, text=True
    )
    settings = EgoSettings(address, deadline_s=DEADLINE_S, patience_s=DEADLINE_S).as_environment()
    before = {name: os.environ.get(name) for name in settings}
    try:
        assert process.stdout is not None
        if "ready" not in process.stdout.readline():
            raise EgoError("the black box ended before it was ready; its own message is above")
        os.environ.update(settings)
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        process.terminate()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
