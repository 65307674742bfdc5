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

_CODE = """
import sys
from policies.egos import load_ego
from service.egos.sdk import serve
serve(lambda: load_ego("idm"), sys.argv[1], listen=sys.argv[2])
"""


@contextmanager
def black_box(name: str) -> Iterator[None]:
    """Serve the ego on loopback, and tell worker processes begun meanwhile where it is. EgoError where it cannot."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    process = subprocess.Popen(
        [sys.executable, "-c", _CODE, name, address], stdout=subprocess.PIPE, text=True
    )
    before = os.environ.get("TAILROAD_EGO_ADDRESS")
    try:
        assert process.stdout is not None
        if "ready" not in process.stdout.readline():
            raise EgoError("the black box ended before it was ready; its own message is above")
        os.environ["TAILROAD_EGO_ADDRESS"] = address
        yield
    finally:
        if before is None:
            os.environ.pop("TAILROAD_EGO_ADDRESS", None)
        else:
            os.environ["TAILROAD_EGO_ADDRESS"] = before
        process.terminate()
        process.wait()
