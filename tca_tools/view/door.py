"""Where a page's server listens."""

import socket

from tca_tools.errors import ToolError

LOCAL = "127.0.0.1"


def listening(host: str, port: int) -> socket.socket:
    """A socket that listens there; with port 0 where there is room. Raises ToolError."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise ToolError(f"{host}:{port}: can't serve there ({error.strerror or error}): give another --port") from None


def in_address(host: str) -> str:
    """A host as web addresses have it."""
    return f"[{host}]" if ":" in host else host
