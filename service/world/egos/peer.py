"""A service of one name as a worker sees it: found, greeted, asked before a deadline, found again after it was lost."""

import uuid
from collections.abc import Callable

from service.errors import EgoError
from service.world.egos import ego_pb2 as pb
from service.world.egos import messages
from service.world.egos.link import Line, ZenohLine
from service.world.egos.settings import EgoSettings

OpenLine = Callable[[EgoSettings, float], Line]


class Peer:
    """One worker's conversation with the services of a name. The line is opened when it is first needed."""

    def __init__(
        self, name: str, settings: EgoSettings, scenario: str, step_s: float, open_line: OpenLine = ZenohLine
    ):
        self.name = name
        self.worker = uuid.uuid4().hex
        self.welcome: pb.Welcome | None = None
        self._settings = settings
        self._scenario = scenario
        self._step_s = step_s
        self._patience_s = settings.patience_s
        self._open_line = open_line
        self._opened: Line | None = None

    def greet(self) -> pb.Welcome:
        """The service's welcome; EgoError where there is no service or none that speaks our version."""
        if self.welcome is None:
            self.welcome = self._hello()
        return self.welcome

    def ask(self, request: pb.Request, wanted: str, most_bytes: int = messages.MAX_REPLY_BYTES) -> pb.Reply:
        """The service's reply of the kind that is wanted; EgoError for a late one, none, or another."""
        welcome = self.greet()
        try:
            answer = self._line().ask(self.name, welcome.instance, request.SerializeToString())
        except EgoError:
            self.welcome = None  # late or gone: the next rollout looks for a service anew
            raise
        return messages.reply_of(answer, wanted, most_bytes)

    def close(self) -> None:
        """Say goodbye, so that the service can forget this worker."""
        if self._opened is None:
            return
        if self.welcome is not None:
            goodbye = pb.Request(goodbye=pb.Goodbye(worker=self.worker))
            self._opened.tell(self.name, self.welcome.instance, goodbye.SerializeToString())
        self._opened.close()
        self._opened = self.welcome = None

    def _line(self) -> Line:
        if self._opened is None:
            try:
                self._opened = self._open_line(self._settings, self._patience_s)
            except EgoError:
                self._patience_s = 0.0
                raise
        return self._opened

    def _hello(self) -> pb.Welcome:
        """Greet all services of the name and take the one with the fewest workers.

        A service that is missing is waited for, but only once: after a wait in vain the next rollouts fail at once,
        until a service is back.
        """
        if not self._line().wait(self.name, self._patience_s):
            self._patience_s = 0.0
            raise EgoError(f"there is no ego service {self.name!r} at {self._settings.address}")
        hello = pb.Hello(
            version=messages.VERSION,
            worker=self.worker,
            scenario=self._scenario,
            step_s=self._step_s,
            deadline_s=self._settings.deadline_s,
        )
        payload = pb.Request(hello=hello).SerializeToString()
        welcomes, reasons = [], []
        for answer in self._line().ask_all(self.name, payload, self._settings.patience_s):
            try:
                welcomes.append(_checked(messages.reply_of(answer, "welcome").welcome))
            except EgoError as error:
                reasons.append(str(error))
        if not welcomes:
            self._patience_s = 0.0
            why = reasons[0] if reasons else "it does not answer"
            raise EgoError(f"no handshake with ego service {self.name!r}: {why}")
        self._patience_s = self._settings.patience_s
        return min(welcomes, key=lambda w: (w.sessions, w.instance))


def _checked(welcome: pb.Welcome) -> pb.Welcome:
    if welcome.version != messages.VERSION:
        raise EgoError(
            f"it speaks version {welcome.version} of ego.proto; this worker speaks {messages.VERSION}"
        )
    if not (welcome.instance.isalnum() and welcome.instance.isascii() and len(welcome.instance) <= 64):
        raise EgoError(f"its instance {messages.shown(welcome.instance)!r} is not 1 to 64 letters and digits")
    if welcome.camera not in (pb.CAMERA_NONE, pb.CAMERA_RAW, pb.CAMERA_JPEG):
        raise EgoError(f"it wants pictures of an unknown kind {welcome.camera}")
    return welcome
