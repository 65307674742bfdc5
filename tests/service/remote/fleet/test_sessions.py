"""Where no session can be had, the message says why and what to do, without Zenoh's sources."""

import socket

import pytest

from service.remote.fleet.sessions import SessionError, router_session


def test_a_port_that_is_taken_is_told_plainly():
    with socket.create_server(("127.0.0.1", 0)) as other:
        where = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(SessionError, match=r"another program listens there.*give another --listen"):
            router_session([where])


def test_an_address_that_cannot_be_is_told_without_places_in_zenoh_s_sources():
    with pytest.raises(SessionError, match="cannot listen on tcp") as caught:
        router_session(["tcp/192.0.2.1:7447"])
    assert ".rs" not in str(caught.value)
