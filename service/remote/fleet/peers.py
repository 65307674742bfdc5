"""Who speaks: the connection that a worker's messages come over, by what the transport knows of it and not by a name.

A vote is an identity's: the certificate it showed, else the host it speaks from. All of this machine are one.
"""

import ipaddress
from dataclasses import dataclass

SHARED = "tailroad-worker"  # a certificate that all workers may share: it names nobody


@dataclass(frozen=True)
class Peer:
    """The other end of a connection; all empty where that is not known, as by way of another router.

    session: of Zenoh, a new one for each process
    certificate: common name of the one it showed, "" for none
    host: its address
    """

    session: str = ""
    certificate: str = ""
    host: str = ""

    @property
    def here(self) -> bool:
        """Whether it is on this machine."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def identity(self) -> str:
        """Whose vote it is; those of whom nothing is known share one."""
        if self.certificate and self.certificate != SHARED:
            return f"certificate {self.certificate}"
        if self.here:
            return "this machine"
        return f"host {self.host}" if self.host else "unknown"

    @property
    def told(self) -> str:
        """For people: certificate or user, and from where; "unknown" where nothing is known."""
        where = "this machine" if self.here else self.host
        if self.certificate and where:
            return f"{self.certificate} from {where}"
        return self.certificate or where or "unknown"

    @property
    def banned(self) -> tuple[str, ...]:
        """What is refused with it when it was found wrong, whatever name comes next: certificate and host. This machine
        itself is not: it decides."""
        own = self.certificate and self.certificate != SHARED
        names = [f"certificate {self.certificate}"] if own else []
        return (*names, *([f"host {self.host}"] if self.host and not self.here else []))


NOBODY = Peer()


def peer_of(session: str, certificate: str | None, address: str) -> Peer:
    """address: of the other end, as Zenoh writes it: tcp/192.168.0.7:41234, tls/[fe80::1]:7447."""
    host = address.partition("/")[2].rpartition(":")[0].strip("[]")
    return Peer(session, certificate or "", host.removeprefix("::ffff:"))
