"""Zenoh sessions of router and clients, with scouting off: nobody is found who was not named."""

import json
import re
import socket
import time
from collections.abc import Callable

import zenoh

from service.errors import InputError

ADMITTED_S = 5.0  # in which somebody who listens lets this side in
PROBE_S = 1.0
READER = "reader"  # the role that may only read, in a configuration's metadata
TAKEN = "Address already in use"

zenoh.init_log_from_env_or("error")


class SessionError(InputError):
    """No session: nobody is there, or the address is taken or not allowed."""


class NotAdmitted(SessionError):
    """Somebody listens at the address, and does not let this side in."""


def router_session(listen: list[str], config_file: str | None = None) -> zenoh.Session:
    """A session that is the router itself and listens on endpoints such as tcp/127.0.0.1:7447."""
    config = _config(config_file)
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps(listen))
    config.insert_json5("listen/exit_on_failure", "true")
    where = ", ".join(listen)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if TAKEN in str(error):
            raise SessionError(
                f"cannot listen on {where}: another program listens there, perhaps another `tailroad serve`; stop it, "
                "or give another --listen"
            ) from error
        raise SessionError(f"cannot listen on {where}: {_cause(error)}; check the address") from error


def client_session(
    connect: list[str],
    config_file: str | None = None,
    wait_s: float | None = None,
    report: Callable[[str], None] = lambda line: None,
) -> zenoh.Session:
    """A client's session, connected to one of the endpoints.

    wait_s: until one is there, SessionError after that; NotAdmitted as soon as somebody is there who refuses it. None:
        as long as it takes, whatever is in the way
    report: told once what that is
    """
    until, told = None if wait_s is None else time.monotonic() + wait_s, False
    while True:
        left = ADMITTED_S if until is None else min(ADMITTED_S, max(until - time.monotonic(), 0.1))
        try:
            return _client_session(connect, config_file, left)
        except SessionError as error:
            listening = [endpoint for endpoint in connect if _listens(endpoint)]
            refused = NotAdmitted(
                f"{', '.join(listening)} does not let this side in: it asks for a certificate or password that is not "
                "the one given, or is no tailroad service; see --zenoh-config"
            )
            if until is not None and listening:
                raise refused from error
            if until is not None and time.monotonic() >= until:
                raise
            if not told:
                report(str(refused if listening else error))
                told = True


def is_reader(config_file: str | None) -> bool:
    """Whether a Zenoh configuration is of the read-only role, as make-security writes it."""
    if config_file is None:
        return False
    told = json.loads(_config(config_file).get_json("metadata"))
    return isinstance(told, dict) and told.get("tailroad") == READER


def _listens(endpoint: str) -> bool:
    """Whether somebody takes connections at a TCP or TLS endpoint."""
    host, _, port = endpoint.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")
    if not port.isdigit():
        return False
    try:
        with socket.create_connection((host.strip("[]"), int(port)), PROBE_S):
            return True
    except OSError:
        return False


def _client_session(connect: list[str], config_file: str | None, wait_s: float) -> zenoh.Session:
    config = _config(config_file)
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps(connect))
    config.insert_json5("connect/timeout_ms", str(round(1000 * wait_s)))
    config.insert_json5("connect/exit_on_failure", "true")
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise SessionError(
            f"cannot connect to {', '.join(connect)}: {_cause(error)}; check the address, and whether `tailroad serve` "
            "runs there"
        ) from error


def _config(config_file: str | None) -> zenoh.Config:
    try:
        config = zenoh.Config.from_file(config_file) if config_file else zenoh.Config()
    except zenoh.ZError as error:
        raise InputError(f"{config_file}: not a Zenoh configuration: {error}") from error
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    # messages are small, and where there is no room in shared memory (a container, a full disk) Zenoh would panic
    config.insert_json5("transport/shared_memory/enabled", "false")
    return config


def _cause(error: zenoh.ZError) -> str:
    """What Zenoh says, without the places in its sources."""
    return re.sub(r" at [^ ]+\.rs:\d+\.", "", str(error)).strip(" .")
