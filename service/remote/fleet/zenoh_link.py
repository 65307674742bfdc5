"""Zenoh: how workers and the hub find each other."""

import threading
from functools import partial

import zenoh

from service.remote.fleet.hub import Hub
from service.remote.fleet.messages import (
    MAX_BYTES,
    PREFIX,
    BadMessage,
    Refused,
    Reply,
    Request,
    decode_reply,
    encode,
)
from service.remote.fleet.peers import NOBODY, Peer, peer_of
from service.remote.fleet.sessions import client_session, router_session

__all__ = ["HubLink", "WorkerConnection", "client_session", "router_session"]


class WorkerConnection:
    """A worker's way to the scheduler; the token tells the scheduler when it breaks."""

    def __init__(self, session: zenoh.Session, worker: str):
        self._session = session
        self._worker = worker
        # queries say which session they are of, by any entity of it
        self._source = zenoh.SourceInfo(session.declare_querier(f"{PREFIX}/{worker}/hello").id, 0)
        self._token = session.liveliness().declare_token(f"{PREFIX}/{worker}/alive")

    def ask(self, kind: str, message: Request, timeout_s: float) -> Reply | None:
        """The scheduler's reply; None where none came in time."""
        try:
            replies = self._session.get(
                f"{PREFIX}/{self._worker}/{kind}",
                payload=encode(message),
                timeout=timeout_s,
                target=zenoh.QueryTarget.ALL,
                source_info=self._source,
            )
            for reply in replies:
                if reply.ok is not None:
                    return decode_reply(reply.ok.payload.to_bytes())
        except (zenoh.ZError, BadMessage):
            return None
        return None

    def close(self) -> None:
        self._token.undeclare()


class Links:
    """The connections of a session, by which it knows who asks."""

    def __init__(self, session: zenoh.Session):
        self._session = session
        self._peers: dict[str, Peer] = {}

    def peer(self, query: zenoh.Query) -> Peer:
        """Whose connection a query came over: of those that this session has, the one that it names."""
        if query.source_info is None:
            return NOBODY
        session = str(query.source_info.source_id.zid)
        if session not in self._peers:
            links = self._session.info.links()
            self._peers = {str(li.zid): peer_of(str(li.zid), li.auth_identifier, str(li.dst)) for li in links}
        return self._peers.get(session, NOBODY)


class HubLink:
    """The scheduler's side: hands what workers say to the hub, and tells it who is gone."""

    def __init__(self, session: zenoh.Session, hub: Hub):
        self._session = session
        self._hub = hub
        self._links = Links(session)
        self._queryable = session.declare_queryable(f"{PREFIX}/*/*", self._on_query)
        self._tokens = session.liveliness().declare_subscriber(
            f"{PREFIX}/*/alive", self._on_token, history=True
        )

    def _on_query(self, query: zenoh.Query) -> None:
        worker, kind = str(query.key_expr).rsplit("/", 2)[-2:]
        answer = partial(_reply, query, threading.Lock())
        payload = query.payload
        if payload is None or len(payload) > MAX_BYTES:
            answer(encode(Refused(f"a message of 1 to {MAX_BYTES} bytes is wanted")))
        else:
            self._hub.receive(worker, kind, payload.to_bytes(), answer, self._links.peer(query))

    def _on_token(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self._hub.gone(str(sample.key_expr).rsplit("/", 2)[-2])

    def close(self) -> None:
        self._tokens.undeclare()
        self._queryable.undeclare()


def _reply(query: zenoh.Query, once: threading.Lock, data: bytes) -> None:
    """Answer a query, once."""
    if once.acquire(blocking=False):
        try:
            query.reply(query.key_expr, data)
        except zenoh.ZError:
            pass  # whoever asked is gone
        finally:
            query.drop()
