"""Which names a server on this machine answers to: other people's web pages can point a name of theirs at it."""

import ipaddress


def host_name(host: str) -> str | None:
    """The name or address of a Host header, without its port; None where it is not one."""
    if host.startswith("["):
        name, _, port = host[1:].partition("]")
        port = port.removeprefix(":")
    else:
        name, _, port = host.partition(":")
    if not name or (port and not (port.isascii() and port.isdigit())):
        return None
    return name.lower().rstrip(".")


def is_address(name: str) -> bool:
    """Whether it is an IP address, which nobody else's name server gives out."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
